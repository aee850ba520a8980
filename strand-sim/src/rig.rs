//! The springs of a strand (MS08 §3.2, Fig. 7): which particles exist, which pairs are joined, and how strongly.
//!
//! Curly hair uses its own particles; straight hair gets one perturbed particle beside every segment, since collinear
//! particles can represent neither bending nor twist. Particles are stored in strand order with the perturbed ones
//! interleaved, so every spring joins particles at most four places apart and a strand's matrix is banded.

pub mod perturb;

use crate::material::Material;

/// What a spring resists; its constants come from the material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpringKind {
    /// Between neighbours along the hair, and the sides of the triangles that perturbed particles form.
    Edge,
    /// Between particles on either side of one particle.
    Bend,
    /// Between opposite corners of neighbouring triangles.
    Torsion,
}

/// A spring between rig particles `a < b`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spring {
    /// Rig particle nearer the root.
    pub a: usize,
    /// Rig particle farther from the root.
    pub b: usize,
    /// What it resists.
    pub kind: SpringKind,
}

/// Which of the two rigs of MS08 Fig. 7 a strand uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum RigKind {
    /// Fig. 7a: no perturbed particles.
    Curly,
    /// Fig. 7b: a perturbed particle beside every segment.
    Straight,
}

/// The spring network shared by all strands of one rig kind and particle count.
#[derive(Clone, Debug)]
pub struct Topology {
    /// Rig kind.
    pub kind: RigKind,
    /// Particles of the hair itself.
    pub n_main: usize,
    /// All particles, perturbed ones included.
    pub n_rig: usize,
    /// Springs, ordered by their far particle.
    pub springs: Vec<Spring>,
    /// Rig particles at the root that move with the scalp: enough to fix position and orientation.
    pub n_kinematic: usize,
    /// Largest `b - a` over all springs.
    pub reach: usize,
}

/// Least number of particles that gives every kind of spring a place beyond the kinematic root.
pub const MIN_PARTICLES: usize = 5;

impl Topology {
    /// The network of `n_main` particles, `n_main >= MIN_PARTICLES`.
    #[must_use]
    pub fn new(kind: RigKind, n_main: usize) -> Self {
        let mut springs = Vec::new();
        let mut join = |a: usize, b: usize, kind| springs.push(Spring { a, b, kind });
        let n_segments = n_main - 1;
        let (n_rig, reach) = match kind {
            RigKind::Curly => {
                for (span, kind) in [(1, SpringKind::Edge), (2, SpringKind::Bend), (3, SpringKind::Torsion)] {
                    for a in 0..n_main - span {
                        join(a, a + span, kind);
                    }
                }
                (n_main, 3)
            }
            RigKind::Straight => {
                let main = |i: usize| 2 * i;
                let extra = |j: usize| 2 * j + 1;
                for j in 0..n_segments {
                    join(main(j), main(j + 1), SpringKind::Edge);
                    join(main(j), extra(j), SpringKind::Edge);
                    join(extra(j), main(j + 1), SpringKind::Edge);
                    if j + 1 < n_segments {
                        join(main(j), main(j + 2), SpringKind::Bend);
                        join(extra(j), extra(j + 1), SpringKind::Bend);
                        join(main(j), extra(j + 1), SpringKind::Torsion);
                        join(extra(j), main(j + 2), SpringKind::Torsion);
                    }
                }
                (n_main + n_segments, 4)
            }
        };
        springs.sort_by_key(|s| (s.b, s.a));
        Self { kind, n_main, n_rig, springs, n_kinematic: 3, reach }
    }

    /// Rig index of the hair's `i`-th particle.
    #[must_use]
    pub fn rig_of_main(&self, i: usize) -> usize {
        match self.kind {
            RigKind::Curly => i,
            RigKind::Straight => 2 * i,
        }
    }

    /// First of the hair's own particles that is free to move.
    #[must_use]
    pub fn first_free_main(&self) -> usize {
        match self.kind {
            RigKind::Curly => self.n_kinematic,
            RigKind::Straight => self.n_kinematic.div_ceil(2),
        }
    }

    /// Stiffness (force at strain one, dyn) and damping (dyn·s/cm) of a spring in a strand of spacing `h_cm`.
    #[must_use]
    pub fn constants(&self, kind: SpringKind, material: &Material, h_cm: f64) -> (f64, f64) {
        // EI and GJ of the network go as k·h²; this keeps the fibre the same at every resolution.
        let per_h2 = 1.0 / (h_cm * h_cm);
        match kind {
            SpringKind::Edge => (material.stretch_dyn, material.stretch_damping),
            SpringKind::Bend => (material.bend_dyn * per_h2, material.bend_damping),
            SpringKind::Torsion => (material.twist_dyn * per_h2, material.twist_damping),
        }
    }

    /// Mass of each rig particle (g) of a strand with spacing `h_cm`. Perturbed particles share the strand's mass: each
    /// segment's is divided equally among the particles that bound or flank it, so the total is that of the hair.
    #[must_use]
    pub fn masses(&self, material: &Material, h_cm: f64) -> Vec<f64> {
        let segment = material.linear_density_g_per_cm * h_cm;
        let mut mass = vec![0.0; self.n_rig];
        for j in 0..self.n_main - 1 {
            match self.kind {
                RigKind::Curly => {
                    mass[j] += segment / 2.0;
                    mass[j + 1] += segment / 2.0;
                }
                RigKind::Straight => {
                    for p in 2 * j..=2 * j + 2 {
                        mass[p] += segment / 3.0;
                    }
                }
            }
        }
        mass
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn springs_span_at_most_the_stated_reach() {
        for kind in [RigKind::Curly, RigKind::Straight] {
            let topology = Topology::new(kind, 25);
            assert_eq!(topology.springs.iter().map(|s| s.b - s.a).max(), Some(topology.reach));
        }
    }

    #[test]
    fn a_straight_rig_of_25_particles_has_49() {
        assert_eq!(Topology::new(RigKind::Straight, 25).n_rig, 49);
    }

    #[test]
    fn particle_masses_add_up_to_the_hair() {
        let material = Material::straight();
        for kind in [RigKind::Curly, RigKind::Straight] {
            let total: f64 = Topology::new(kind, 25).masses(&material, 1.1).iter().sum();
            let hair = material.linear_density_g_per_cm * 24.0 * 1.1;
            assert!((total / hair - 1.0).abs() < 1e-12);
        }
    }
}
