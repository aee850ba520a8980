//! A tuft of hair on a shaken head in three models (MS08 Fig. 13).
//!
//! (a) the basic mass/spring model; (b) the full model, every hair for itself; (c) the full model with stiction, repulsion
//! and collisions. The same hair, the same motion. A *pass* is a pair of segments of which one goes through the other
//! within a step; passes of pairs that stick together count too, whatever the model does about them.

use super::basic::{BasicHair, BasicParams};
use super::shape::strains;
use super::{Film, Frame, Stage};
use crate::error::Error;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde::Serialize;
use std::f64::consts::TAU;
use strand_sim::interaction::{LinkSet, NearPairs, Strands};
use strand_sim::{InteractionParams, Material, StepParams, StrandSystem, Substeps};

/// Step, s: short and whole, so that a pass between two steps is a pass.
const DT: f64 = 0.0025;

/// Distance below which two hairs count as side by side, cm.
const NEIGHBOUR_CM: f64 = 0.1;

/// A tuft of straight hair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tuft {
    /// Hairs.
    pub n_strands: usize,
    /// Particles of each.
    pub n_particles: usize,
    /// Length of a hair, cm.
    pub length_cm: f64,
    /// Radius of the patch that they grow on, cm.
    pub radius_cm: f64,
    /// Of the irregularities of roots and directions.
    pub seed: u64,
}

impl Tuft {
    /// 300 hairs of 20 cm.
    #[must_use]
    pub fn standard() -> Self {
        Self { n_strands: 300, n_particles: 30, length_cm: 20.0, radius_cm: 1.5, seed: 7 }
    }

    /// Its points, strand-major, root first, cm: a patch of scalp that faces down and outwards, hair leaning all ways.
    #[must_use]
    pub fn points(&self) -> Vec<Vector3<f64>> {
        const LEAN: f64 = 0.12;
        let mut random = Pcg64Mcg::seed_from_u64(self.seed);
        let mut points = Vec::with_capacity(self.n_strands * self.n_particles);
        for s in 0..self.n_strands {
            // Sunflower: even at any count.
            let radius = self.radius_cm * ((s as f64 + 0.5) / self.n_strands as f64).sqrt();
            let (sin, cos) = (2.399_963 * s as f64).sin_cos();
            let root = Vector3::new(radius * cos, 0.0, radius * sin);
            let jitter = Vector3::from(random.random::<[f64; 3]>()).add_scalar(-0.5) * LEAN;
            let out = (root * 0.08 - Vector3::y() + jitter).normalize();
            // Slightly curved, each its own way: no two hairs are parallel.
            let bend = Vector3::from(random.random::<[f64; 3]>()).add_scalar(-0.5) * 0.02;
            let (mut at, mut direction) = (root, out);
            let step = self.length_cm / (self.n_particles - 1) as f64;
            for _ in 0..self.n_particles {
                points.push(at);
                at += direction * step;
                direction = (direction + bend * step).normalize();
            }
        }
        points
    }
}

/// The head's pose: shaken from side to side at 2 Hz and turned at 1.5 Hz, from rest.
#[must_use]
pub fn shaken(t: f64) -> Isometry3<f64> {
    let rise = super::ease(t, 0.5);
    let shift = Vector3::new(4.0 * (2.0 * TAU * t).sin(), 0.0, 2.0 * (1.5 * TAU * t).sin()) * rise;
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.5 * rise * (1.5 * TAU * t).sin());
    Isometry3::from_parts(Translation3::from(shift), turn)
}

/// What one model of the tuft did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct TuftFigures {
    /// Largest strain of any segment at any time.
    pub largest_strain: f64,
    /// Mean over time of the 99th percentile of strain over segments.
    pub p99_strain: f64,
    /// Pairs of segments that went through each other, over all steps.
    pub passes: usize,
    /// The same without pairs that stuck together.
    pub unlinked_passes: usize,
    /// Links held, mean over the last half.
    pub links: f64,
    /// Pairs of segments of different hairs nearer than a millimetre, a hair, mean over the last half.
    pub neighbours: f64,
    /// Distance of a hair's outer half from the tuft's axis, RMS, mean over the last half, cm: how much room it takes.
    pub spread_cm: f64,
    /// Strands whose state was not finite.
    pub quarantined: u32,
}

/// How the tuft is modelled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TuftModel {
    /// MS08 Fig. 13(a).
    Basic(BasicParams),
    /// MS08 Fig. 13(b) without, (c) with hair that meets hair.
    Full(Option<InteractionParams>),
}

/// Shakes a tuft for so many seconds.
///
/// # Errors
/// Strands that cannot be simulated.
pub fn shake(tuft: &Tuft, model: TuftModel, seconds: f64) -> Result<(TuftFigures, Film), Error> {
    let rest = tuft.points();
    let n = tuft.n_particles;
    let params = StepParams { substeps: Substeps::Fixed(1), ..StepParams::standard() };
    let mut observer = Observer::new(&rest, tuft)?;
    let n_steps = (seconds / DT).round() as usize;
    let mut roots = vec![Isometry3::identity(); tuft.n_strands];
    match model {
        TuftModel::Basic(basic) => {
            let mut hair = BasicHair::new(&rest, n, basic);
            for step in 0..n_steps {
                let t = DT * step as f64;
                hair.step(DT, &shaken(t), &shaken(t + DT));
                observer.look(step, n_steps, hair.positions(), &LinkSet::default());
            }
        }
        TuftModel::Full(interaction) => {
            let mut stage = Stage::new(&rest, n, Material::straight(), params, interaction)?;
            for step in 0..n_steps {
                roots.fill(shaken(DT * (step + 1) as f64));
                let report = stage.step(DT, &roots, &[]);
                observer.figures.quarantined += report.step.quarantined;
                observer.look(step, n_steps, &stage.positions(), stage.links());
            }
        }
    }
    Ok(observer.finish(n_steps))
}

/// Gathers what is measured, step by step.
struct Observer {
    /// For its count of passes only.
    system: StrandSystem,
    rest: Vec<Vector3<f64>>,
    n: usize,
    before: Vec<Vector3<f64>>,
    inv_mass: Vec<f64>,
    near: NearPairs,
    passing: strand_sim::interaction::CollisionWorkspace,
    sorted: Vec<f64>,
    figures: TuftFigures,
    film: Film,
}

impl Observer {
    fn new(rest: &[Vector3<f64>], tuft: &Tuft) -> Result<Self, Error> {
        let n = tuft.n_particles;
        let system = StrandSystem::new(rest, n, Material::straight())?;
        let mut inv_mass = Vec::new();
        system.inverse_masses(&mut inv_mass);
        Ok(Self {
            system,
            rest: rest.to_vec(),
            n,
            before: rest.to_vec(),
            inv_mass,
            near: NearPairs::default(),
            passing: Default::default(),
            sorted: Vec::new(),
            figures: TuftFigures::default(),
            film: Film { n_particles: n, frames: vec![Frame { time_s: 0.0, positions: rest.to_vec() }] },
        })
    }

    fn look(&mut self, step: usize, n_steps: usize, now: &[Vector3<f64>], links: &LinkSet) {
        const PICTURES: usize = 7;
        let n_strands = (now.len() / self.n) as f64;
        self.sorted.clear();
        self.sorted.extend(strains(now, &self.rest, self.n).map(f64::abs));
        self.sorted.sort_unstable_by(f64::total_cmp);
        let f = &mut self.figures;
        f.largest_strain = f.largest_strain.max(self.sorted.last().copied().unwrap_or(0.0));
        f.p99_strain += self.sorted[self.sorted.len() * 99 / 100];
        f.passes += self.system.count_passes(&self.before, now, &LinkSet::default(), &mut self.passing);
        f.unlinked_passes += self.system.count_passes(&self.before, now, links, &mut self.passing);
        if 2 * step >= n_steps {
            let strands = Strands::new(self.n, now, &self.inv_mass);
            self.near.find(&strands, NEIGHBOUR_CM);
            f.neighbours += self.near.pairs().len() as f64 / n_strands;
            f.links += links.links().len() as f64;
            f.spread_cm += spread(now, self.n);
        }
        if (step + 1).is_multiple_of(n_steps.div_ceil(PICTURES)) || step + 1 == n_steps {
            self.film.frames.push(Frame { time_s: DT * (step + 1) as f64, positions: now.to_vec() });
        }
        self.before.clear();
        self.before.extend_from_slice(now);
    }

    fn finish(mut self, n_steps: usize) -> (TuftFigures, Film) {
        let half = (n_steps - n_steps / 2) as f64;
        let f = &mut self.figures;
        f.p99_strain /= n_steps as f64;
        f.neighbours /= half;
        f.links /= half;
        f.spread_cm /= half;
        (self.figures, self.film)
    }
}

/// Root mean square distance of the outer halves from the mean hair, particle by particle, cm.
fn spread(positions: &[Vector3<f64>], n: usize) -> f64 {
    let n_strands = (positions.len() / n) as f64;
    let mut sum = 0.0;
    for i in n / 2..n {
        let mean = positions.chunks_exact(n).map(|s| s[i]).sum::<Vector3<f64>>() / n_strands;
        sum += positions.chunks_exact(n).map(|s| (s[i] - mean).norm_squared()).sum::<f64>();
    }
    (sum / (n_strands * (n - n / 2) as f64)).sqrt()
}
