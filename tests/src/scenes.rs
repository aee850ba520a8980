//! Strands, solids and their motions for laws of the simulator: a few hairs, one solid, one second.

use collision::{MovingSolid, Shape, Solid, SolidPose};
use nalgebra::{Isometry3, Translation3, Vector3};
use strand_sim::{Material, StepInput, StepParams, StepReport, StepWorkspace, StrandState, StrandSystem};

/// Particles of every strand here.
pub const N_PARTICLES: usize = 25;

/// Length of every strand here, cm.
pub const LENGTH_CM: f64 = 24.0;

/// The guides' step, s.
pub const DT: f64 = 0.01;

/// A straight strand from `root` along `direction`, particles 1 cm apart.
#[must_use]
pub fn straight(root: Vector3<f64>, direction: Vector3<f64>) -> Vec<Vector3<f64>> {
    let direction = direction.normalize();
    (0..N_PARTICLES).map(|i| root + direction * i as f64).collect()
}

/// A helix of radius 1 cm about a line from `root` downwards: no three particles are in line.
#[must_use]
pub fn helix(root: Vector3<f64>) -> Vec<Vector3<f64>> {
    let at = |i: usize| {
        let angle = 0.9 * i as f64;
        root + Vector3::new(angle.cos() - 1.0, -0.4 * i as f64, angle.sin())
    };
    (0..N_PARTICLES).map(at).collect()
}

/// Strands of both rigs side by side, from straight out to hanging.
#[must_use]
pub fn mixed_strands(n: usize) -> Vec<Vector3<f64>> {
    let strand = |s: usize| {
        let root = Vector3::new(2.0 * s as f64, 0.0, 0.0);
        if s % 3 == 2 { helix(root) } else { straight(root, Vector3::new(0.1 * s as f64, -1.0, 0.3)) }
    };
    (0..n).flat_map(strand).collect()
}

/// A ball about its frame's origin.
///
/// # Panics
/// Never for a radius of more than a millimetre.
#[must_use]
pub fn ball(radius: f32) -> Solid {
    let shape = Shape::sphere(Vector3::zeros(), radius);
    Solid::from_shape("ball", &shape.into(), 0.1 * radius, radius, 0.0).expect("a ball can be baked")
}

/// A thin rod along z about its frame's origin: a comb's tooth.
///
/// # Panics
/// Never for a radius of more than a tenth of a millimetre.
#[must_use]
pub fn rod(radius: f32, length: f32, friction: f32) -> Solid {
    let end = Vector3::new(0.0, 0.0, 0.5 * length);
    let shape = Shape::capsule(-end, end, radius);
    Solid::from_shape("rod", &shape.into(), 0.4 * radius, radius, friction).expect("a rod can be baked")
}

/// A solid moving straight.
#[must_use]
pub fn sliding<'a>(solid: &'a Solid, from: Vector3<f64>, to: Vector3<f64>) -> MovingSolid<'a> {
    let at = |p: Vector3<f64>| Isometry3::from_parts(Translation3::from(p), Default::default());
    MovingSolid { solid, pose: SolidPose { from: at(from), to: at(to) } }
}

/// A set of strands on its way.
pub struct Tuft {
    /// Strands and springs.
    pub system: StrandSystem,
    /// Where they are.
    pub state: StrandState,
    /// How a step is taken.
    pub params: StepParams,
    workspace: StepWorkspace,
    head: Isometry3<f64>,
}

impl Tuft {
    /// Strands of [`N_PARTICLES`] points at rest on a head at the origin.
    ///
    /// # Panics
    /// If the strands cannot be simulated.
    #[must_use]
    pub fn new(points: &[Vector3<f64>], material: Material, params: StepParams) -> Self {
        let system = StrandSystem::new(points, N_PARTICLES, material).expect("strands made by code are sound");
        let head = Isometry3::identity();
        let state = system.rest_state(&head);
        Self { system, state, params, workspace: StepWorkspace::default(), head }
    }

    /// One step with the head going to `head`, among solids.
    pub fn step(&mut self, head: Isometry3<f64>, solids: &[MovingSolid]) -> StepReport {
        let input = StepInput { solids, ..StepInput::carried(DT, self.head, head) };
        self.head = head;
        self.system.step(&mut self.state, &input, &self.params, &mut self.workspace)
    }

    /// Moves the head with its hair as if it had always stood there; the state is not touched.
    pub fn place_head(&mut self, head: Isometry3<f64>) {
        self.head = head;
    }

    /// So many steps with the head where it is and no solids.
    pub fn rest_for(&mut self, steps: usize) {
        for _ in 0..steps {
            self.step(self.head, &[]);
        }
    }

    /// Positions, strand-major, root first.
    #[must_use]
    pub fn positions(&self) -> Vec<Vector3<f64>> {
        self.system.positions(&self.state)
    }
}

/// Standard parameters without gravity.
#[must_use]
pub fn weightless() -> StepParams {
    StepParams { gravity: Vector3::zeros(), ..StepParams::standard() }
}

/// Largest distance between equal particles, cm.
#[must_use]
pub fn largest_difference(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(p, q)| (p - q).norm()).fold(0.0, f64::max)
}

/// Points at most half a millimetre apart along one strand from particle `first` on.
#[must_use]
pub fn dense_samples(strand: &[Vector3<f64>], first: usize) -> Vec<Vector3<f64>> {
    let mut out = Vec::new();
    for w in strand[first..].windows(2) {
        let n = ((w[1] - w[0]).norm() / 0.05).ceil().max(1.0) as usize;
        out.extend((0..n).map(|k| w[0].lerp(&w[1], k as f64 / n as f64)));
    }
    out.extend(strand.last());
    out
}
