//! A scene run in one of the modes compared, measured while it runs.

use crate::error::Error;
use crate::measures::{Measured, Observer, Reach, in_reach};
use crate::world::World;
use adaptive_runtime::{Runtime, RuntimeParams, StageTimings, StepInput, StepReport};
use cpu_time::ProcessTime;
use io_formats::FrameSource;
use io_formats::groom::UniformGroom;
use io_formats::skinning_model::SkinningModel;
use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};
use strand_sim::StepParams;

/// The modes compared: ways to move the same hair with the same guides.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// The whole method.
    Adaptive,
    /// Each hair's best-trained set at all times.
    Fixed,
    /// Hairs do not push back on guides.
    NoTwoWay,
    /// No correction of single strands.
    NoResidual,
    /// AS16 to the letter.
    Paper,
    /// Every strand simulated.
    FullSpace,
}

impl Mode {
    /// All modes, in the order of a comparison.
    pub const ALL: [Self; 6] =
        [Self::Adaptive, Self::NoTwoWay, Self::NoResidual, Self::Paper, Self::Fixed, Self::FullSpace];

    /// As written on a command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Adaptive => "adaptive",
            Self::Fixed => "fixed",
            Self::NoTwoWay => "no-two-way",
            Self::NoResidual => "no-residual",
            Self::Paper => "paper",
            Self::FullSpace => "full-space",
        }
    }

    /// Parameters of the runtime; `None` where every strand is simulated.
    #[must_use]
    pub fn params(self) -> Option<RuntimeParams> {
        match self {
            Self::Adaptive => Some(RuntimeParams::adaptive()),
            Self::Fixed => Some(RuntimeParams::fixed()),
            Self::NoTwoWay => Some(RuntimeParams::no_two_way()),
            Self::NoResidual => {
                let mut params = RuntimeParams::adaptive();
                params.residual.correction = adaptive_runtime::Correction::None;
                Some(params)
            }
            Self::Paper => Some(RuntimeParams::paper()),
            Self::FullSpace => None,
        }
    }
}

impl std::str::FromStr for Mode {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        Self::ALL
            .into_iter()
            .find(|mode| mode.name() == name)
            .ok_or_else(|| Error::UnknownMode { name: name.to_owned(), known: Self::ALL.map(Self::name).join(", ") })
    }
}

/// What all modes of one scene are measured against.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reference {
    /// Strands in reach of solids by step, from a run blind to them.
    pub reach: Reach,
    /// The full-space run.
    pub full: Option<RunResult>,
    /// Full-space positions at each read, step 0 first.
    pub frames: Vec<Vec<[f32; 3]>>,
}

/// Mean distance to the full-space run over the outer half of strands, as a share of strand length, per cent (RMS).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ErrorPct {
    /// Over all strands.
    pub all: f64,
    /// Over near strands.
    pub near: f64,
    /// Of hair that does not move on its head, over all strands.
    pub rigid: f64,
}

/// A run's figures.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RunResult {
    /// Steps taken.
    pub steps: usize,
    /// Simulated time, s.
    pub sim_seconds: f64,
    /// CPU time of all threads over steps and reads, s.
    pub cpu_seconds: f64,
    /// Wall time of the same, s.
    pub wall_seconds: f64,
    /// The measures of the scene.
    pub measured: Measured,
    /// Distance to the full-space run, where there is one.
    pub error: Option<ErrorPct>,
    /// 1/Σw², mean over steps and near strands.
    pub effective_guides_near: f64,
    /// The same over all strands.
    pub effective_guides_all: f64,
    /// Hash of the last state.
    pub state_hash: u64,
    /// Stage names and wall seconds.
    pub stages: Vec<(String, f64)>,
    /// Strands corrected one by one, mean per step.
    pub corrected_strands: f64,
    /// Strands in contact, mean per step.
    pub strands_in_contact: f64,
    /// Set changes, mean per step.
    pub set_changes: f64,
    /// Share of guide pairs connected, mean over steps.
    pub connectivity: f64,
    /// Strands put back because their state was not finite.
    pub quarantined: u64,
}

/// The positions of all hair after the last step, brought up to date: the one place where a run looks at hair.
pub fn read_positions(runtime: &mut Runtime) -> &[[f32; 3]] {
    runtime.read();
    runtime.positions()
}

/// Runs the scene with guides and hair blind to its solids and notes which strands they would meet at each step.
///
/// # Errors
/// A model or scene the runtime refuses.
pub fn blind_reach(world: &World, model: &SkinningModel, mut progress: impl FnMut(usize)) -> Result<Reach, Error> {
    let mut runtime = Runtime::new(
        model.clone(),
        RuntimeParams::fixed(),
        world.world_from_head(0.0),
        Some(world.head.clone()),
        Vec::new(),
        &[],
    )?;
    let dt = world.scene.step_s;
    let rest: Vec<[f32; 3]> = (0..runtime.n_strands()).flat_map(|s| model.rest_of(s).to_vec()).collect();
    let mut reach = Reach::new();
    for step in 0..world.n_steps() {
        let t = step as f64 * dt;
        runtime.step(&StepInput { dt, world_from_head: world.world_from_head(t + dt), world_from_solids: &[] });
        let solids = world.moving_solids(t, dt);
        let n = runtime.n_particles();
        reach.push(in_reach(read_positions(&mut runtime), &rest, n, &solids));
        progress(step + 1);
    }
    Ok(reach)
}

/// Whatever moves the hair of a run.
enum Hair {
    Skinned(Box<Runtime>),
    Full(Box<crate::full_space::FullSpace>),
}

/// Runs a scene in `mode`. `progress` hears of each step; `on_read` gets time and positions at step 0 and at each
/// picture's time.
///
/// # Errors
/// A model or scene the runtime refuses.
pub fn run(
    world: &World,
    model: &SkinningModel,
    mode: Mode,
    reference: &Reference,
    mut progress: impl FnMut(usize),
    mut on_read: impl FnMut(f64, &[[f32; 3]]),
) -> Result<RunResult, Error> {
    let n = model.n_particles as usize;
    let n_strands = model.n_strands as usize;
    let rest: Vec<[f32; 3]> = (0..n_strands).flat_map(|s| model.rest_of(s).to_vec()).collect();
    let head_at_start = world.world_from_head(0.0);
    let mut hair = match mode.params() {
        Some(params) => Hair::Skinned(Box::new(Runtime::new(
            model.clone(),
            params,
            head_at_start,
            Some(world.head.clone()),
            world.solids.clone(),
            &world.world_from_solids(0.0),
        )?)),
        None => {
            let rest = UniformGroom { n_strands, n_particles: n, points: rest.clone() };
            Hair::Full(Box::new(world.full_space(&rest, &StepParams::standard())?))
        }
    };
    let mut observer = Observer::new(&rest, n, &reference.reach);
    let mut positions = rest.clone();
    if let Hair::Full(full) = &hair {
        full.positions(&mut positions);
    } else if let Hair::Skinned(runtime) = &hair {
        positions.copy_from_slice(runtime.positions());
    }
    on_read(0.0, &positions);
    let dt = world.scene.step_s;
    let mut out = RunResult { sim_seconds: world.n_steps() as f64 * dt, ..RunResult::default() };
    let (mut cpu, mut wall) = (Duration::ZERO, Duration::ZERO);
    let mut timings = StageTimings::default();
    let mut errors = ErrorSum::new(&rest, n, observer.near());
    let (mut effective_near, mut effective_all) = (0.0, 0.0);
    let mut reads = 0;
    for step in 0..world.n_steps() {
        let t = step as f64 * dt;
        let world_from_head = world.world_from_head(t + dt);
        let solids = world.moving_solids(t, dt);
        let head = world.moving_head(t, dt);
        let poses = world.world_from_solids(t + dt);
        let is_read = world.is_read(step + 1);
        let (cpu_clock, wall_clock) = (ProcessTime::now(), Instant::now());
        let report = match &mut hair {
            Hair::Skinned(runtime) => {
                let report = runtime.step(&StepInput { dt, world_from_head, world_from_solids: &poses });
                if is_read {
                    positions.copy_from_slice(read_positions(runtime));
                }
                report
            }
            Hair::Full(full) => {
                let mut all = solids.clone();
                all.push(head);
                let report = full.step(dt, &world_from_head, &all);
                StepReport { quarantined: report.quarantined, ..StepReport::default() }
            }
        };
        cpu += cpu_clock.elapsed();
        wall += wall_clock.elapsed();
        timings.add(&report.timings);
        out.corrected_strands += f64::from(report.corrected_strands);
        out.strands_in_contact += f64::from(report.strands_in_contact);
        out.set_changes += f64::from(report.set_changes);
        out.connectivity += report.connectivity;
        out.quarantined += u64::from(report.quarantined);
        match &mut hair {
            Hair::Skinned(runtime) => {
                if !is_read {
                    runtime.read();
                }
                observer.observe(runtime.positions(), &solids, Some(&head));
                let mean = |strands: &mut dyn Iterator<Item = u32>| {
                    let (mut sum, mut count) = (0.0, 0.0);
                    strands.for_each(|s| {
                        sum += runtime.effective_guides(s as usize);
                        count += 1.0;
                    });
                    if count > 0.0 { sum / count } else { 0.0 }
                };
                effective_near += mean(&mut observer.near().iter().copied());
                effective_all += mean(&mut (0..n_strands as u32));
            }
            Hair::Full(full) => {
                full.positions(&mut positions);
                observer.observe(&positions, &solids, Some(&head));
            }
        }
        if is_read {
            reads += 1;
            on_read(t + dt, &positions);
            if let Some(frame) = reference.frames.get(reads) {
                errors.add(&positions, frame, &world_from_head.cast());
            }
        }
        progress(step + 1);
    }
    let steps = world.n_steps();
    let per_step = 1.0 / steps.max(1) as f64;
    out.steps = steps;
    out.cpu_seconds = cpu.as_secs_f64();
    out.wall_seconds = wall.as_secs_f64();
    out.measured = observer.finish();
    out.error = (errors.count > 0).then(|| errors.finish());
    out.effective_guides_near = effective_near * per_step;
    out.effective_guides_all = effective_all * per_step;
    out.stages = timings.named().iter().map(|&(name, s)| (name.to_owned(), s)).collect();
    out.corrected_strands *= per_step;
    out.strands_in_contact *= per_step;
    out.set_changes *= per_step;
    out.connectivity *= per_step;
    out.state_hash = match &hair {
        Hair::Skinned(runtime) => runtime.state_hash(),
        Hair::Full(_) => hash_positions(&positions),
    };
    Ok(out)
}

/// Lets a model's guides follow recorded frames: each hair's best-trained set skins it, nothing else moves it. `on_frame` gets
/// the positions skinned and those recorded, both in the head frame.
///
/// # Errors
/// A model or frame that cannot be used.
pub fn replay(
    model: &SkinningModel,
    frames: &dyn FrameSource,
    mut on_frame: impl FnMut(&[[f32; 3]], &[[f32; 3]]),
) -> Result<(), Error> {
    let (n, n_strands) = (model.n_particles as usize, model.n_strands as usize);
    let still = Isometry3::identity();
    let mut skinned = Runtime::new(model.clone(), RuntimeParams::fixed(), still, None, Vec::new(), &[])?;
    let (mut recorded, mut guides) = (vec![[0.0; 3]; n_strands * n], Vec::new());
    for frame in 0..frames.n_frames() {
        frames.read(frame, &mut recorded)?;
        guides.clear();
        for &s in &model.guide_strands {
            guides.extend_from_slice(&recorded[s as usize * n..(s as usize + 1) * n]);
        }
        skinned.replay(&guides, &still);
        on_frame(skinned.positions(), &recorded);
    }
    Ok(())
}

/// Error of skinning alone on frames that training has not seen. `progress` hears of each frame.
///
/// # Errors
/// As [`replay`].
pub fn replayed_error(
    model: &SkinningModel,
    frames: &dyn FrameSource,
    mut progress: impl FnMut(usize),
) -> Result<ErrorPct, Error> {
    let rest: Vec<[f32; 3]> = (0..model.n_strands as usize).flat_map(|s| model.rest_of(s).to_vec()).collect();
    let mut errors = ErrorSum::new(&rest, model.n_particles as usize, &[]);
    let mut done = 0;
    replay(model, frames, |skinned, recorded| {
        errors.add(skinned, recorded, &Isometry3::identity());
        done += 1;
        progress(done);
    })?;
    Ok(errors.finish())
}

/// FNV-1a over the bits of all positions.
fn hash_positions(positions: &[[f32; 3]]) -> u64 {
    positions
        .iter()
        .flatten()
        .fold(0xcbf2_9ce4_8422_2325, |hash, x| (hash ^ u64::from(x.to_bits())).wrapping_mul(0x0100_0000_01b3))
}

/// Squared distances to the full-space run, in units of strand length.
pub(crate) struct ErrorSum<'a> {
    rest: &'a [[f32; 3]],
    n: usize,
    length: Vec<f32>,
    is_near: Vec<bool>,
    all: f64,
    near: f64,
    rigid: f64,
    pub(crate) count: u64,
    near_count: u64,
}

impl<'a> ErrorSum<'a> {
    pub(crate) fn new(rest: &'a [[f32; 3]], n: usize, near: &[u32]) -> Self {
        let length: Vec<f32> = rest
            .chunks_exact(n)
            .map(|s| s.windows(2).map(|w| (Vector3::from(w[1]) - Vector3::from(w[0])).norm()).sum())
            .collect();
        let mut is_near = vec![false; length.len()];
        near.iter().for_each(|&s| is_near[s as usize] = true);
        Self { rest, n, length, is_near, all: 0.0, near: 0.0, rigid: 0.0, count: 0, near_count: 0 }
    }

    pub(crate) fn add(&mut self, positions: &[[f32; 3]], reference: &[[f32; 3]], world_from_head: &Isometry3<f32>) {
        for s in 0..self.length.len() {
            for i in s * self.n + self.n / 2..(s + 1) * self.n {
                let full = Vector3::from(reference[i]);
                let share = |p: Vector3<f32>| f64::from((p - full).norm_squared() / (self.length[s] * self.length[s]));
                let error = share(positions[i].into());
                let carried = (world_from_head * nalgebra::Point3::from(self.rest[i])).coords;
                self.rigid += share(carried);
                self.all += error;
                self.count += 1;
                if self.is_near[s] {
                    self.near += error;
                    self.near_count += 1;
                }
            }
        }
    }

    pub(crate) fn finish(&self) -> ErrorPct {
        let rms = |sum: f64, count: u64| if count > 0 { 100.0 * (sum / count as f64).sqrt() } else { 0.0 };
        ErrorPct {
            all: rms(self.all, self.count),
            near: rms(self.near, self.near_count),
            rigid: rms(self.rigid, self.count),
        }
    }
}
