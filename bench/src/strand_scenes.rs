//! The paper's own tests of single hairs and a tuft (MS08 Fig. 10, 11, 13): each a scene with frames to draw and figures.
//!
//! [`buckling`]: a hair forced into a loop, and one twisted until it gives way; [`crossing`]: one hair pulled off another;
//! [`curls`]: curls stretched, dropped and hung; [`tuft`]: a shaken tuft in three models; [`basic`]: the basic
//! mass/spring model that the paper sets its own against. A scene is a plain function of its parameters: same
//! parameters, same figures, for any thread count.

pub mod basic;
pub mod buckling;
pub mod crossing;
pub mod curls;
pub mod shape;
pub mod tuft;

use crate::error::Error;
use nalgebra::{Isometry3, Vector3};
use strand_sim::interaction::{CollisionWorkspace, LinkSet};
use strand_sim::{
    Drive, InteractionParams, InteractionReport, InteractionWorkspace, Material, RootMotion, StepInput, StepParams,
    StepWorkspace, StrandState, StrandSystem,
};

/// What a scene looked like at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Since the start, s.
    pub time_s: f64,
    /// Positions, strand-major, root first, cm.
    pub positions: Vec<Vector3<f64>>,
}

/// A scene over time.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Film {
    /// Particles of each strand.
    pub n_particles: usize,
    /// In order of time.
    pub frames: Vec<Frame>,
}

impl Film {
    /// An empty film of strands of so many particles.
    #[must_use]
    pub fn new(n_particles: usize) -> Self {
        Self { n_particles, frames: Vec::new() }
    }
}

/// Strands on their way, each root with a frame of its own, with or without hair that meets hair.
pub struct Stage {
    system: StrandSystem,
    state: StrandState,
    links: LinkSet,
    params: StepParams,
    interaction: Option<InteractionParams>,
    plain: StepWorkspace,
    meeting: InteractionWorkspace,
    passing: CollisionWorkspace,
    roots: Vec<Isometry3<f64>>,
    time_s: f64,
    film: Film,
}

impl Stage {
    /// Strands of `n_particles` points at rest in the shape given (strand-major, root first, cm), every root frame the
    /// identity.
    ///
    /// # Errors
    /// Strands that cannot be simulated.
    pub fn new(
        points: &[Vector3<f64>],
        n_particles: usize,
        material: Material,
        params: StepParams,
        interaction: Option<InteractionParams>,
    ) -> Result<Self, Error> {
        let system = StrandSystem::new(points, n_particles, material)?;
        if let Some(interaction) = &interaction {
            interaction.validate()?;
        }
        let roots = vec![Isometry3::identity(); system.n_strands()];
        Ok(Self {
            state: system.rest_state(&Isometry3::identity()),
            system,
            links: LinkSet::default(),
            params,
            interaction,
            plain: StepWorkspace::default(),
            meeting: InteractionWorkspace::default(),
            passing: CollisionWorkspace::default(),
            roots,
            time_s: 0.0,
            film: Film::new(n_particles),
        })
    }

    /// One step of `dt` seconds over which the roots go to `roots`, one frame a strand.
    pub fn step(&mut self, dt: f64, roots: &[Isometry3<f64>], drives: &[Drive]) -> InteractionReport {
        let input = StepInput {
            dt,
            time_s: self.time_s,
            roots: RootMotion::Frames { before: &self.roots, after: roots },
            solids: &[],
            forces: &[],
            deforming: &[],
            surfaces: &[],
            drives,
            wind: None,
        };
        let (system, state, params) = (&self.system, &mut self.state, &self.params);
        let report = match &self.interaction {
            None => InteractionReport {
                step: system.step(state, &input, params, &mut self.plain),
                ..InteractionReport::default()
            },
            Some(interaction) => {
                system.step_interacting(state, &mut self.links, &input, params, interaction, &mut self.meeting)
            }
        };
        self.roots.copy_from_slice(roots);
        self.time_s += dt;
        report
    }

    /// One step with the roots where they are.
    pub fn rest(&mut self, dt: f64, drives: &[Drive]) -> InteractionReport {
        let roots = self.roots.clone();
        self.step(dt, &roots, drives)
    }

    /// Positions, strand-major, root first, cm.
    #[must_use]
    pub fn positions(&self) -> Vec<Vector3<f64>> {
        self.system.positions(&self.state)
    }

    /// Since the start, s.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// The strands' springs.
    #[must_use]
    pub fn system(&self) -> &StrandSystem {
        &self.system
    }

    /// Force through a cut across a segment of a strand, on what lies beyond it, dyn.
    #[must_use]
    pub fn cut_force(&self, strand: usize, segment: usize) -> Vector3<f64> {
        self.system.cut_force(&self.state, strand, segment)
    }

    /// Links held.
    #[must_use]
    pub fn links(&self) -> &LinkSet {
        &self.links
    }

    /// Pairs of segments, stuck ones included, that cross on the straight way from `before` to where the strands are.
    pub fn passes_since(&mut self, before: &[Vector3<f64>]) -> usize {
        self.system.count_passes(before, &self.positions(), &LinkSet::default(), &mut self.passing)
    }

    /// As [`Self::passes_since`], with pairs left out that stick together.
    pub fn unlinked_passes_since(&mut self, before: &[Vector3<f64>]) -> usize {
        self.system.count_passes(before, &self.positions(), &self.links, &mut self.passing)
    }

    /// Keeps what is seen now.
    pub fn shoot(&mut self) {
        let positions = self.positions();
        self.film.frames.push(Frame { time_s: self.time_s, positions });
    }

    /// What was kept.
    #[must_use]
    pub fn into_film(self) -> Film {
        self.film
    }
}

/// A straight strand of `n` points from `root`, `length_cm` long, along `direction`.
#[must_use]
pub fn straight_strand(root: Vector3<f64>, direction: Vector3<f64>, length_cm: f64, n: usize) -> Vec<Vector3<f64>> {
    let step = direction.normalize() * (length_cm / (n - 1) as f64);
    (0..n).map(|i| root + step * i as f64).collect()
}

/// From 0 to 1 over `of`, starting and ending without a jerk.
#[must_use]
pub fn ease(t: f64, of: f64) -> f64 {
    let x = (t / of).clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}
