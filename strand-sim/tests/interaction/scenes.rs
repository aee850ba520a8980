//! Reproducible strands for the laws.

use nalgebra::{UnitQuaternion, Vector3};
use strand_sim::interaction::Strands;

/// Reproducible random numbers (SplitMix64).
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in a cube around the origin.
    pub fn in_cube(&mut self, half_size: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| (2.0 * self.unit() - 1.0) * half_size)
    }

    pub fn rotation(&mut self) -> UnitQuaternion<f64> {
        let axis = (self.in_cube(1.0) + Vector3::new(1e-3, 0.0, 0.0)).normalize();
        UnitQuaternion::new(axis * (self.unit() * std::f64::consts::TAU))
    }
}

/// Positions, velocities and reciprocal masses of a set of strands.
#[derive(Clone)]
pub struct Scene {
    pub n_particles: usize,
    pub position: Vec<Vector3<f64>>,
    pub velocity: Vec<Vector3<f64>>,
    pub inv_mass: Vec<f64>,
}

impl Scene {
    pub fn new(n_particles: usize) -> Self {
        Self { n_particles, position: Vec::new(), velocity: Vec::new(), inv_mass: Vec::new() }
    }

    /// Adds a gently waving strand of centimetre segments along a direction.
    pub fn add_strand(&mut self, random: &mut Random, root: Vector3<f64>, along: Vector3<f64>, velocity: Vector3<f64>) {
        let (wave, phase) = (random.in_cube(0.5), random.unit() * std::f64::consts::TAU);
        for i in 0..self.n_particles {
            let i = i as f64;
            self.position.push(root + along * i + wave * (0.4 * i + phase).sin());
            self.velocity.push(velocity + random.in_cube(20.0));
            // Masses differ within a strand as at its tip and root, to try every formula with unequal ones.
            self.inv_mass.push((1.0 + random.unit()) / 5e-5);
        }
    }

    /// Strands of 25 particles all through each other, fast.
    pub fn tangle(seed: u64, n_strands: usize, half_size: f64, speed: f64) -> Self {
        let mut random = Random::new(seed);
        let mut scene = Self::new(25);
        for _ in 0..n_strands {
            let along = random.rotation() * Vector3::x() * 0.4;
            let root = random.in_cube(half_size) - along * 12.0;
            let velocity = random.in_cube(speed);
            scene.add_strand(&mut random, root, along, velocity);
        }
        scene
    }

    /// Makes the first `n` particles of every strand kinematic.
    pub fn with_roots(mut self, n: usize) -> Self {
        for strand in self.inv_mass.chunks_mut(self.n_particles) {
            strand[..n].fill(0.0);
        }
        self
    }

    pub fn strands(&self) -> Strands<'_> {
        Strands::new(self.n_particles, &self.position, &self.inv_mass)
    }

    pub fn momentum(&self) -> Vector3<f64> {
        self.velocity.iter().zip(&self.inv_mass).filter(|(_, w)| **w > 0.0).map(|(v, w)| v / *w).sum()
    }

    pub fn angular_momentum(&self) -> Vector3<f64> {
        let free = self.velocity.iter().zip(&self.position).zip(&self.inv_mass).filter(|(_, w)| **w > 0.0);
        free.map(|((v, x), w)| x.cross(v) / *w).sum()
    }

    pub fn energy(&self) -> f64 {
        let free = self.velocity.iter().zip(&self.inv_mass).filter(|(_, w)| **w > 0.0);
        free.map(|(v, w)| 0.5 * v.norm_squared() / *w).sum()
    }

    /// Sum of the magnitudes that cancel in the momentum: what its round-off is relative to.
    pub fn momentum_scale(&self) -> f64 {
        let free = self.velocity.iter().zip(&self.inv_mass).filter(|(_, w)| **w > 0.0);
        free.map(|(v, w)| v.norm() / *w).sum()
    }
}

/// The result of `run` in pools of 1, 2 and 8 threads; all must be the same.
pub fn with_any_thread_count<T: PartialEq + Send>(run: impl Fn() -> T + Sync) -> T {
    let with = |n_threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().expect("threads");
        pool.install(&run)
    };
    let one = with(1);
    assert!(one == with(2), "two threads differ from one");
    assert!(one == with(8), "eight threads differ from one");
    one
}
