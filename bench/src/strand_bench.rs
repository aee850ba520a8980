//! What the strand simulator costs: ratios of two things timed in one run, and seconds of whole heads.
//!
//! Every figure is CPU time of all threads unless it says wall clock. Pairs that make a ratio take turns, and the best of
//! several turns counts, since whatever else a machine does only ever adds time.

use crate::error::Error;
use crate::grooms::{GroomParams, Style, generate};
use crate::shapes::{self, CombParams};
use collision::{MovingSolid, Solid, SolidPose};
use cpu_time::ProcessTime;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::time::{Duration, Instant};
use strand_sim::interaction::{CollideParams, LinkSet};
use strand_sim::reference::PlainStrand;
use strand_sim::solve::jacobi_cg::{JacobiWorkspace, solve_jacobi};
use strand_sim::wind::{GustyWind, WindField};
use strand_sim::{
    InteractionParams, InteractionWorkspace, Material, RootMotion, StepInput, StepParams, StepWorkspace, StrandState,
    StrandSystem, Substeps,
};

/// Hair of a head, being shaken.
struct Head {
    solid: Solid,
    system: StrandSystem,
    state: StrandState,
    time_s: f64,
}

/// Shape of a head of hair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shape {
    Straight,
    /// Coils of a turn in four particles.
    Curly,
}

/// One row: a name, its unit, its value.
pub type Row = (&'static str, &'static str, f64);

/// A step of the guides, s.
const STEP_S: f64 = 0.01;

impl Head {
    fn new(shape: Shape, strands: usize, particles: usize, length_cm: f32) -> Result<Self, Error> {
        let solid = shapes::head()?;
        let groom =
            generate(&GroomParams { style: Style::Straight, strands, particles, length_cm, seed: 1, head: &solid })?;
        let mut points: Vec<Vector3<f64>> = groom.points.iter().map(|&p| Vector3::from(p).cast()).collect();
        if shape == Shape::Curly {
            for strand in points.chunks_exact_mut(particles) {
                curl(strand);
            }
        }
        let system = StrandSystem::new(&points, particles, Material::straight())?;
        let state = system.rest_state(&Isometry3::identity());
        Ok(Self { solid, system, state, time_s: 0.0 })
    }

    /// The head turned from side to side, half a radian either way, once a second.
    fn pose(time_s: f64) -> Isometry3<f64> {
        let turn = 0.5 * (std::f64::consts::TAU * time_s).sin();
        Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_axis_angle(&Vector3::y_axis(), turn))
    }

    fn motion(&self, dt: f64) -> (Isometry3<f64>, Isometry3<f64>) {
        (Self::pose(self.time_s), Self::pose(self.time_s + dt))
    }

    /// Lets the hair fall onto the head held still, each strand by itself.
    fn settle(&mut self, steps: usize) {
        let (still, mut workspace) = (Self::pose(0.0), StepWorkspace::default());
        let solids = [MovingSolid { solid: &self.solid, pose: SolidPose { from: still, to: still } }];
        for _ in 0..steps {
            let input = StepInput { solids: &solids, ..StepInput::carried(STEP_S, still, still) };
            self.system.step(&mut self.state, &input, &StepParams::standard(), &mut workspace);
        }
    }

    fn step(&mut self, dt: f64, params: &StepParams, comb: Option<MovingSolid>, workspace: &mut StepWorkspace) {
        let (from, to) = self.motion(dt);
        let mut solids = vec![MovingSolid { solid: &self.solid, pose: SolidPose { from, to } }];
        solids.extend(comb);
        let input = StepInput { solids: &solids, ..StepInput::carried(dt, from, to) };
        self.system.step(&mut self.state, &input, params, workspace);
        self.time_s += dt;
    }
}

/// Winds a strand around its own middle line: coils of 0.6 cm across the line's direction.
fn curl(strand: &mut [Vector3<f64>]) {
    let n = strand.len();
    let line = strand.to_vec();
    for i in 1..n {
        let t = (line[(i + 1).min(n - 1)] - line[i - 1]).normalize();
        let u = t.cross(&if t.x.abs() < 0.6 { Vector3::x() } else { Vector3::z() }).normalize();
        let angle = 1.6 * i as f64;
        let radius = 0.6 * (i as f64 / 4.0).min(1.0);
        strand[i] = line[i] + (u * angle.cos() + t.cross(&u) * angle.sin()) * radius;
    }
}

/// CPU time of all threads that `run` takes.
fn cpu(run: impl FnOnce()) -> f64 {
    let clock = ProcessTime::now();
    run();
    clock.elapsed().as_secs_f64()
}

fn wall(run: impl FnOnce()) -> f64 {
    let clock = Instant::now();
    run();
    clock.elapsed().as_secs_f64()
}

/// `direct_over_cg` and `simd_over_plain`: how many times faster the batched direct step of a strand is than conjugate
/// gradients on its springs alone, and than the same step written plainly for one strand.
///
/// # Errors
/// As the generators.
pub fn solvers() -> Result<Vec<Row>, Error> {
    const N: usize = 256;
    const TURNS: usize = 8;
    const STEPS: usize = 10;
    const TOLERANCE: f64 = 1e-6;
    let mut head = Head::new(Shape::Straight, N, 25, 25.0)?;
    let params = StepParams { substeps: Substeps::Fixed(1), ..StepParams::standard() };
    let mut workspace = StepWorkspace::default();
    let h = 0.5 * STEP_S;
    let free = |head: &mut Head, workspace: &mut StepWorkspace| {
        let (from, to) = head.motion(h);
        head.system.step(&mut head.state, &StepInput::carried(h, from, to), &params, workspace);
        head.time_s += h;
    };
    for _ in 0..40 {
        free(&mut head, &mut workspace);
    }
    let mut plain: Vec<_> = (0..N).map(|s| PlainStrand::of(&head.system, &head.state, s)).collect();
    let (mut batched_s, mut plain_s, mut cg_s) = (f64::INFINITY, f64::INFINITY, f64::INFINITY);
    let mut cg_workspace = JacobiWorkspace::default();
    for _ in 0..TURNS {
        // Both move on from the same state over the same time, so that both solve the same systems.
        let mut solved: f64 = 0.0;
        for strand in &plain {
            let (springs, b) = (strand.spring_terms(h), strand.right_side(h, params.gravity));
            let mut v = strand.velocities().to_vec();
            solved += cpu(|| {
                solve_jacobi(strand.masses(), &springs, &b, &mut v, TOLERANCE, 100_000, &mut cg_workspace);
            });
        }
        cg_s = cg_s.min(solved);
        let from = head.time_s;
        batched_s = batched_s.min(
            cpu(|| {
                for _ in 0..STEPS {
                    free(&mut head, &mut workspace);
                }
            }) / STEPS as f64,
        );
        plain_s = plain_s.min(
            cpu(|| {
                for k in 0..STEPS {
                    let pose = Head::pose(from + (k + 1) as f64 * h);
                    for strand in &mut plain {
                        strand.step(h, &pose, &params);
                    }
                }
            }) / STEPS as f64,
        );
    }
    Ok(vec![
        ("direct_over_cg", "x", cg_s / batched_s),
        ("simd_over_plain", "x", plain_s / batched_s),
        ("solve_us_per_strand", "us", 1e6 * batched_s / N as f64),
    ])
}

/// `guide_us_per_strand_step_curly` and `_straight`: one 10 ms step of 400 guides of 25 particles on a turning head with a
/// comb drawn through at half a metre a second.
///
/// # Errors
/// As the generators.
pub fn guides() -> Result<Vec<Row>, Error> {
    const N: usize = 400;
    let comb = shapes::comb(CombParams::dressing())?;
    let mut rows = Vec::new();
    for (shape, name) in
        [(Shape::Curly, "guide_us_per_strand_step_curly"), (Shape::Straight, "guide_us_per_strand_step_straight")]
    {
        let mut head = Head::new(shape, N, 25, 25.0)?;
        let (params, mut workspace) = (StepParams::standard(), StepWorkspace::default());
        for _ in 0..50 {
            head.step(STEP_S, &params, None, &mut workspace);
        }
        let mut best = f64::INFINITY;
        for turn in 0..8 {
            let at = |k: usize| {
                let down = 0.5 * (10 * (turn % 3) + k) as f64;
                let turned = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::PI);
                Isometry3::from_parts(Translation3::new(0.0, 2.0 - down, -9.0), turned)
            };
            let took = cpu(|| {
                for k in 0..10 {
                    let moving = MovingSolid { solid: &comb, pose: SolidPose { from: at(k), to: at(k + 1) } };
                    head.step(STEP_S, &params, Some(moving), &mut workspace);
                }
            });
            best = best.min(took / 10.0);
        }
        rows.push((name, "us", 1e6 * best / N as f64));
    }
    Ok(rows)
}

/// `cost_100k_over_1k`: CPU time per strand of a step without interaction, of 100,000 over that of 1,000.
///
/// # Errors
/// As the generators.
pub fn scaling() -> Result<Vec<Row>, Error> {
    let params = StepParams::standard();
    let mut small = Head::new(Shape::Straight, 1_000, 25, 25.0)?;
    let mut large = Head::new(Shape::Straight, 100_000, 25, 25.0)?;
    let (mut small_workspace, mut large_workspace) = (StepWorkspace::default(), StepWorkspace::default());
    let (mut small_s, mut large_s) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..5 {
        // Both heads are at the same point of their motion whenever they are timed.
        let steps = cpu(|| small.step(STEP_S, &params, None, &mut small_workspace));
        small_s = small_s.min(steps / 1_000.0);
        let steps = cpu(|| large.step(STEP_S, &params, None, &mut large_workspace));
        large_s = large_s.min(steps / 100_000.0);
    }
    Ok(vec![("cost_100k_over_1k", "x", large_s / small_s), ("us_per_strand_step_100k", "us", 1e6 * large_s)])
}

/// `full_150k_x25_s_per_step` (wall clock) and `full_150k_peak_gb`: every strand of a full head, without interaction.
///
/// # Errors
/// As the generators.
pub fn full_head() -> Result<Vec<Row>, Error> {
    let mut head = Head::new(Shape::Straight, 150_000, 25, 25.0)?;
    let (params, mut workspace) = (StepParams::standard(), StepWorkspace::default());
    let mut best = f64::INFINITY;
    for _ in 0..4 {
        best = best.min(wall(|| head.step(STEP_S, &params, None, &mut workspace)));
    }
    let mut rows = vec![("full_150k_x25_s_per_step", "s", best)];
    rows.extend(peak_gb().map(|gb| ("full_150k_peak_gb", "GB", gb)));
    Ok(rows)
}

/// Largest memory this process has had so far, where the system says.
fn peak_gb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? * 1024.0 / 1e9)
}

/// A row of MS08 Table 2: particles as the paper counts them (perturbed ones included), its minutes a frame, ours.
#[derive(Clone, Debug)]
pub struct TableRow {
    /// The paper's name of the row.
    pub name: &'static str,
    /// Strands and particles of each.
    pub strands: (usize, usize),
    /// Minutes a frame in the paper, on up to 16 cores of its day.
    pub paper_minutes: f64,
    /// Seconds of wall clock a frame of 1/24 s.
    pub seconds: f64,
    /// The same, split: strands' own solves, collisions, stiction.
    pub split: [Duration; 3],
    /// Links held at the end, pairs left crossing over all frames, preconditioner solves a step.
    pub links: usize,
    /// Pairs that still crossed when sweeps ran out, over all frames.
    pub unresolved: usize,
    /// Preconditioner solves a step.
    pub coupled_iterations: f64,
}

/// Steps before hair that was set down on a head stays where it is, near enough: a second.
const SETTLING_STEPS: usize = 100;

/// Steps a frame of 1/24 s is cut into.
const STEPS_PER_FRAME: usize = 4;

/// A row of the table, by its name in [`TABLE_2`].
///
/// # Errors
/// As the generators.
pub fn table_row(name: &'static str, strands: usize, n_frames: usize) -> Result<TableRow, Error> {
    let (shape, particles, length, wind, paper_minutes) = match name {
        "curly" => (Shape::Curly, 50, 40.0, false, 4.0),
        "straight short" => (Shape::Straight, 25, 15.0, false, 10.0),
        "straight short wind" => (Shape::Straight, 25, 15.0, true, 12.0),
        "straight long (5k)" => (Shape::Straight, 50, 40.0, false, 17.0),
        _ => (Shape::Straight, 50, 40.0, false, 38.0),
    };
    let mut head = Head::new(shape, strands, particles, length)?;
    let wind = wind.then_some(GustyWind { mean: Vector3::new(300.0, 0.0, 100.0), gust: 150.0, wavelength_cm: 30.0 });
    let params = StepParams { substeps: Substeps::Fixed(1), ..StepParams::standard() };
    // A head of packed hair leaves crossings whatever the number of sweeps (MS08 §7); more than these gain little.
    let collision = Some(CollideParams { sweeps: 1, sticky_sweeps: 1, ..CollideParams::standard() });
    let interaction = InteractionParams { collision, ..InteractionParams::dry() };
    let (mut links, mut workspace) = (LinkSet::default(), InteractionWorkspace::default());
    let dt = 1.0 / (24.0 * STEPS_PER_FRAME as f64);
    let mut row = TableRow {
        name,
        strands: (strands, particles),
        paper_minutes,
        seconds: 0.0,
        split: [Duration::ZERO; 3],
        links: 0,
        unresolved: 0,
        coupled_iterations: 0.0,
    };
    head.settle(SETTLING_STEPS);
    // The first frame makes all the links at once and is left out.
    for frame in 0..=n_frames {
        for _ in 0..STEPS_PER_FRAME {
            let (from, to) = head.motion(dt);
            let solids = [MovingSolid { solid: &head.solid, pose: SolidPose { from, to } }];
            let input = StepInput {
                solids: &solids,
                time_s: head.time_s,
                roots: RootMotion::Head { before: from, after: to },
                wind: wind.as_ref().map(|w| w as &dyn WindField),
                ..StepInput::carried(dt, from, to)
            };
            let clock = Instant::now();
            let report = head.system.step_interacting(
                &mut head.state,
                &mut links,
                &input,
                &params,
                &interaction,
                &mut workspace,
            );
            head.time_s += dt;
            if frame > 0 {
                row.seconds += clock.elapsed().as_secs_f64() / n_frames as f64;
                for (sum, part) in row.split.iter_mut().zip([report.integrate, report.collide, report.stick]) {
                    *sum += part / n_frames as u32;
                }
                row.unresolved += report.collision.unresolved;
                row.coupled_iterations += report.coupled_iterations as f64 / (n_frames * STEPS_PER_FRAME) as f64;
                row.links = report.links.held;
            }
        }
    }
    Ok(row)
}

/// The rows of MS08 Table 2 and how many strands each has.
pub const TABLE_2: [(&str, usize); 5] = [
    ("straight long (10k)", 10_000),
    ("straight long (5k)", 5_000),
    ("straight short", 10_000),
    ("straight short wind", 10_000),
    ("curly", 5_000),
];
