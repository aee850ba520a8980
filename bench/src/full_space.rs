//! Every strand simulated: the source of training frames and the reference that a run is compared with.

use crate::error::Error;
use crate::world::World;
use collision::{MovingSolid, Solid, SolidPose};
use io_formats::groom::UniformGroom;
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};
use strand_sim::interaction::{ContactSampling, LinkSet};
use strand_sim::wind::{GustyWind, WindField};
use strand_sim::{
    InteractionParams, InteractionReport, InteractionWorkspace, Material, StepInput, StepParams, StepReport,
    StepWorkspace, StrandState, StrandSystem,
};

/// All strands of a groom on a head.
pub struct FullSpace {
    system: StrandSystem,
    state: StrandState,
    workspace: StepWorkspace,
    /// Present where hairs rub on each other.
    friction: Option<Friction>,
    params: StepParams,
    world_from_head: Isometry3<f64>,
    n: usize,
    wind: Option<GustyWind>,
    time_s: f64,
}

/// How hairs rub on each other.
struct Friction {
    params: InteractionParams,
    links: LinkSet,
    workspace: InteractionWorkspace,
    report: InteractionReport,
}

/// Thickness at which each of so many hairs stands for its share of a head's 100,000 of a tenth of a millimetre: as much
/// cross-section together; at most half a millimetre.
#[must_use]
pub fn thickness_cm(n_strands: usize) -> f64 {
    const REAL_CM: f64 = 0.01;
    const ON_A_HEAD: f64 = 100_000.0;
    const MOST_CM: f64 = 0.05;
    (REAL_CM * (ON_A_HEAD / n_strands.max(1) as f64).sqrt()).min(MOST_CM)
}

/// Distance between the planes on which so many hairs are looked at for contacts: twice as far in dense hair, which has
/// twice the contacts a hair, so that about as many of a hair's are treated (60 to 90 at 20,000
/// hairs, 55 to 70 at 150,000).
fn spacing_cm(n_strands: usize) -> f64 {
    const STANDARD_FOR: f64 = 40_000.0;
    ContactSampling::standard().spacing_cm * (n_strands as f64 / STANDARD_FOR).clamp(1.0, 2.0)
}

/// How hairs of a head of so many rub on each other (AS16 §7.1).
#[must_use]
pub fn rubbing_params(n_strands: usize) -> InteractionParams {
    let sampling = ContactSampling { spacing_cm: spacing_cm(n_strands), ..ContactSampling::standard() };
    InteractionParams { sampling: Some(sampling), ..InteractionParams::rubbing_sampled(thickness_cm(n_strands)) }
}

/// Longest time strands are given to come to rest, s.
const SETTLE_S: f64 = 1.6;
const SETTLE_STEP_S: f64 = 0.02;
/// Air drag while settling, 1/s: high, since only where it ends matters.
const SETTLE_DRAG: f64 = 8.0;
/// Strands that settle together: few enough that what is at rest early need not wait for the rest of the head.
const SETTLE_TOGETHER: usize = 64;
/// Steps between looks at whether strands still move.
const SETTLE_CHECK_STEPS: usize = 5;
/// Strands of which no particle moves faster than this on average between two looks are at rest, cm/s.
const SETTLED_CM_PER_S: f64 = 1.0;

/// The groom as it hangs on its head: strands that lay inside the head are out of it, and nothing moves any more.
///
/// `progress` is told the share done, 0 to 1.
///
/// # Errors
/// Strands that cannot be simulated.
pub fn settle(
    groom: &UniformGroom,
    head: &Solid,
    material: Material,
    params: &StepParams,
    progress: impl Fn(f64) + Sync,
) -> Result<UniformGroom, Error> {
    let n = groom.n_particles;
    let material = Material { air_drag_per_s: SETTLE_DRAG, ..material };
    let mut points = groom.points.clone();
    let (done, n_strands) = (AtomicUsize::new(0), groom.n_strands.max(1));
    points.par_chunks_mut(SETTLE_TOGETHER * n).try_for_each(|points| {
        settle_few(points, n, head, material, params)?;
        let settled = done.fetch_add(points.len() / n, Ordering::Relaxed) + points.len() / n;
        progress(settled as f64 / n_strands as f64);
        Ok::<(), Error>(())
    })?;
    Ok(UniformGroom { points, ..*groom })
}

/// Steps a few strands until they are at rest.
fn settle_few(
    points: &mut [[f32; 3]],
    n_particles: usize,
    head: &Solid,
    material: Material,
    params: &StepParams,
) -> Result<(), Error> {
    let head = [MovingSolid { solid: head, pose: SolidPose::still(Isometry3::identity()) }];
    let styled: Vec<Vector3<f64>> = points.iter().map(|&p| Vector3::from(p).cast()).collect();
    let mut system = StrandSystem::new(&styled, n_particles, material)?;
    let mut state = system.rest_state(&Isometry3::identity());
    system.balance(&mut state, &Isometry3::identity(), &head, params);
    let mut strands = FullSpace::of(system, state, params, n_particles);
    let n_steps = (SETTLE_S / SETTLE_STEP_S) as usize;
    let most_cm = SETTLED_CM_PER_S * SETTLE_CHECK_STEPS as f64 * SETTLE_STEP_S;
    let (mut before, mut now) = (points.to_vec(), Vec::new());
    for step in 1..=n_steps {
        strands.step(SETTLE_STEP_S, &Isometry3::identity(), &head);
        if step % SETTLE_CHECK_STEPS == 0 {
            strands.positions_in_head(&mut now);
            let moved = before
                .iter()
                .zip(&now)
                .fold(0.0, |most: f32, (a, b)| most.max((Vector3::from(*a) - Vector3::from(*b)).norm()));
            if f64::from(moved) <= most_cm {
                break;
            }
            std::mem::swap(&mut before, &mut now);
        }
    }
    strands.positions_in_head(&mut now);
    points.copy_from_slice(&now);
    Ok(())
}

impl FullSpace {
    /// Strands styled as `groom`, starting in equilibrium in the shape `rest` on the head, which is at the identity.
    ///
    /// # Errors
    /// Strands that cannot be simulated.
    pub fn new(
        groom: &UniformGroom,
        rest: &UniformGroom,
        head: &Solid,
        material: Material,
        params: &StepParams,
    ) -> Result<Self, Error> {
        let points = |groom: &UniformGroom| -> Vec<Vector3<f64>> {
            groom.points.iter().map(|&p| Vector3::from(p).cast()).collect()
        };
        let n = groom.n_particles;
        let upright = Isometry3::identity();
        let mut system = StrandSystem::new(&points(groom), n, material)?;
        let head = MovingSolid { solid: head, pose: SolidPose::still(upright) };
        let (state, held) = system.hold_settled(&points(rest), &[head], params)?;
        tracing::info!(?held, "settled shape");
        Ok(Self::of(system, state, params, n))
    }

    /// The same hairs in the same state, with buffers of their own. Of hairs that have not been stepped since they were made this is what
    /// making them anew gives, without what that takes.
    #[must_use]
    pub fn again(&self) -> Self {
        let mut copy = Self::of(self.system.clone(), self.state.clone(), &self.params, self.n);
        copy.world_from_head = self.world_from_head;
        (copy.wind, copy.time_s) = (self.wind, self.time_s);
        copy.friction = self.friction.as_ref().map(|friction| Friction {
            params: friction.params,
            links: friction.links.clone(),
            workspace: InteractionWorkspace::default(),
            report: friction.report,
        });
        copy
    }

    /// The same hairs with friction on each other (AS16 §7.1).
    #[must_use]
    pub fn rubbing(self) -> Self {
        let params = rubbing_params(self.system.n_strands());
        self.meeting(params)
    }

    /// The same hairs meeting each other as told.
    #[must_use]
    pub fn meeting(mut self, params: InteractionParams) -> Self {
        let report = InteractionReport::default();
        let workspace = InteractionWorkspace::default();
        self.friction = Some(Friction { params, links: LinkSet::default(), workspace, report });
        self
    }

    /// The same hairs in moving air, of which their drag is towards the wind's velocity (MS08 §6, Fig. 2).
    #[must_use]
    pub fn in_wind(mut self, wind: GustyWind) -> Self {
        self.wind = Some(wind);
        self
    }

    /// What hairs that meet each other did over the last step.
    #[must_use]
    pub fn met(&self) -> Option<&InteractionReport> {
        self.friction.as_ref().map(|friction| &friction.report)
    }

    fn of(system: StrandSystem, state: StrandState, params: &StepParams, n: usize) -> Self {
        let world_from_head = Isometry3::identity();
        let workspace = StepWorkspace::default();
        let params = *params;
        Self { system, state, workspace, friction: None, params, world_from_head, n, wind: None, time_s: 0.0 }
    }

    /// Advances all strands; `solids` includes the head.
    pub fn step(&mut self, dt: f64, world_from_head: &Isometry3<f64>, solids: &[MovingSolid]) -> StepReport {
        let carried = StepInput::carried(dt, self.world_from_head, *world_from_head);
        let wind = self.wind.as_ref().map(|wind| wind as &dyn WindField);
        let input = StepInput { solids, wind, time_s: self.time_s, ..carried };
        self.time_s += dt;
        self.world_from_head = *world_from_head;
        if let Some(Friction { params, links, workspace, report }) = &mut self.friction {
            *report = self.system.step_interacting(&mut self.state, links, &input, &self.params, params, workspace);
            return report.step;
        }
        self.system.step(&mut self.state, &input, &self.params, &mut self.workspace)
    }

    /// Writes world positions, strand-major, cm.
    pub fn positions(&self, out: &mut Vec<[f32; 3]>) {
        self.write(&Isometry3::identity(), out);
    }

    /// Writes head-frame positions, strand-major, cm.
    pub fn positions_in_head(&self, out: &mut Vec<[f32; 3]>) {
        self.write(&self.world_from_head.inverse(), out);
    }

    fn write(&self, to: &Isometry3<f64>, out: &mut Vec<[f32; 3]>) {
        out.resize(self.system.n_strands() * self.n, [0.0; 3]);
        self.system.read(&self.state, |s, i, x, _| {
            out[s * self.n + i] = to.transform_point(&Point3::from(x)).coords.cast::<f32>().into();
        });
    }
}

impl World {
    /// All strands of this world's groom, at rest in `rest`, with friction on each other if the scene asks for it.
    ///
    /// # Errors
    /// Strands that cannot be simulated.
    pub fn full_space(&self, rest: &UniformGroom, params: &StepParams) -> Result<FullSpace, Error> {
        let full = FullSpace::new(&self.groom, rest, &self.head, self.material, params)?;
        Ok(if self.scene.train.friction { full.rubbing() } else { full })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grooms::{GroomParams, Style, generate};
    use crate::shapes;

    #[test]
    fn hair_in_a_wind_leans_with_it_and_hair_in_still_air_stays() {
        /// What hair at rest on a head that stands still may move in half a second, cm.
        const STILL_CM: f64 = 0.05;
        let head = shapes::head().expect("a head");
        let params =
            GroomParams { style: Style::Straight, strands: 24, particles: 16, length_cm: 15.0, seed: 2, head: &head };
        let groom = generate(&params).expect("a groom");
        let (material, step) = (Material::straight(), StepParams::standard());
        let rest = settle(&groom, &head, material, &step, |_| {}).expect("hair at rest");
        let tips = |wind: Option<GustyWind>| {
            let mut full = FullSpace::new(&groom, &rest, &head, material, &step).expect("hair");
            if let Some(wind) = wind {
                full = full.in_wind(wind);
            }
            let upright = Isometry3::identity();
            for _ in 0..50 {
                full.step(0.01, &upright, &[MovingSolid { solid: &head, pose: SolidPose::still(upright) }]);
            }
            let mut now = Vec::new();
            full.positions(&mut now);
            let moved = |s: usize| f64::from(now[s * 16 + 15][0] - rest.points[s * 16 + 15][0]);
            (0..24).map(moved).sum::<f64>() / 24.0
        };
        let wind = |x: f64| GustyWind { mean: Vector3::new(x, 0.0, 0.0), gust: 0.0, wavelength_cm: 30.0 };
        assert!(tips(None).abs() < STILL_CM, "{}", tips(None));
        let (right, left) = (tips(Some(wind(300.0))), tips(Some(wind(-300.0))));
        assert!(right > 10.0 * STILL_CM && left < -10.0 * STILL_CM, "{left} {right}");
    }
}
