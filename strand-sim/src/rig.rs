//! The springs of a strand (MS08 §3.2, Fig. 7): which particles exist, which pairs are joined, and how strongly.
//!
//! A strand is a strip of triangles, every three consecutive rig particles one of them. Where the hair is curly its own
//! particles make the strip; where it is straight they are collinear and can represent neither bending nor twist, so a
//! perturbed particle stands beside every segment there. Particles are stored in strip order, so every spring joins
//! particles at most four places apart and a strand's matrix is banded.

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

/// Index of the altitude springs' constants, after those of [`SpringKind`].
pub(crate) const ALTITUDE: usize = 3;

/// Sets of spring constants: one for each [`SpringKind`] and one for altitude springs.
pub(crate) const N_CONSTANTS: usize = 4;

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

/// Which segments of a strand have a perturbed particle beside them, one entry a segment from the root.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Perturbed(pub Vec<bool>);

impl Perturbed {
    /// MS08 Fig. 7a, curly hair: none.
    #[must_use]
    pub fn nowhere(n_main: usize) -> Self {
        Self(vec![false; n_main - 1])
    }

    /// MS08 Fig. 7b, straight hair: all.
    #[must_use]
    pub fn everywhere(n_main: usize) -> Self {
        Self(vec![true; n_main - 1])
    }

    /// Perturbed particles.
    #[must_use]
    pub fn count(&self) -> usize {
        self.0.iter().filter(|&&p| p).count()
    }
}

/// The spring network shared by all strands of one particle count that are perturbed in the same places.
#[derive(Clone, Debug)]
pub struct Topology {
    /// Where perturbed particles stand.
    pub perturbed: Perturbed,
    /// Particles of the hair itself.
    pub n_main: usize,
    /// All particles, perturbed ones included.
    pub n_rig: usize,
    /// Springs, ordered by their far particle.
    pub springs: Vec<Spring>,
    /// For each rig particle the end of the run of `springs` whose far particle it is.
    pub springs_end: Vec<usize>,
    /// Rig particles at the root that move with the scalp: enough to fix position and orientation.
    pub n_kinematic: usize,
    /// Largest `b - a` over all springs.
    pub reach: usize,
    /// For each rig particle the two of the hair's own particles around it: their difference is the hair's direction there.
    pub around: Vec<(usize, usize)>,
    rig_of_main: Vec<usize>,
}

/// Least number of particles that gives every kind of spring a place beyond the kinematic root.
pub const MIN_PARTICLES: usize = 5;

impl Topology {
    /// The network of a strand of `perturbed.0.len() + 1` particles, at least [`MIN_PARTICLES`].
    #[must_use]
    pub fn new(perturbed: &Perturbed) -> Self {
        let n_main = perturbed.0.len() + 1;
        let mut rig_of_main = Vec::with_capacity(n_main);
        let mut n_rig = 0;
        for i in 0..n_main {
            rig_of_main.push(n_rig);
            n_rig += 1 + usize::from(perturbed.0.get(i) == Some(&true));
        }
        let mut springs = Vec::new();
        let mut join = |a: usize, b: usize, kind| springs.push(Spring { a, b, kind });
        let is_main_pair = |a: usize, b: usize, apart: usize| {
            rig_of_main.binary_search(&a).is_ok_and(|i| rig_of_main.get(i + apart) == Some(&b))
        };
        for b in 1..n_rig {
            join(b - 1, b, SpringKind::Edge);
            if b >= 2 {
                // The third side of a perturbed triangle is the hair's own segment.
                let kind = if is_main_pair(b - 2, b, 1) { SpringKind::Edge } else { SpringKind::Bend };
                join(b - 2, b, kind);
            }
            if b >= 3 {
                let kind = if is_main_pair(b - 3, b, 2) { SpringKind::Bend } else { SpringKind::Torsion };
                join(b - 3, b, kind);
            }
            if b >= 4 && is_main_pair(b - 4, b, 2) {
                join(b - 4, b, SpringKind::Bend);
            }
        }
        springs.sort_by_key(|s| (s.b, s.a));
        let springs_end = (0..n_rig).map(|b| springs.partition_point(|s| s.b <= b)).collect();
        let reach = springs.iter().map(|s| s.b - s.a).max().unwrap_or(0);
        let mut around = Vec::with_capacity(n_rig);
        for i in 0..n_main {
            around.push((rig_of_main[i.saturating_sub(1)], rig_of_main[(i + 1).min(n_main - 1)]));
            if perturbed.0.get(i) == Some(&true) {
                around.push((rig_of_main[i], rig_of_main[i + 1]));
            }
        }
        let perturbed = perturbed.clone();
        Self { perturbed, n_main, n_rig, springs, springs_end, n_kinematic: 3, reach, around, rig_of_main }
    }

    /// Springs whose far particle is `b`.
    #[inline]
    #[must_use]
    pub fn springs_to(&self, b: usize) -> std::ops::Range<usize> {
        let start = if b == 0 { 0 } else { self.springs_end[b - 1] };
        start..self.springs_end[b]
    }

    /// Tetrahedra of the strip: every four consecutive rig particles, the last of them `last`.
    #[must_use]
    pub fn n_tetrahedra(&self) -> usize {
        self.n_rig - 3
    }

    /// Rig index of the hair's `i`-th particle.
    #[inline]
    #[must_use]
    pub fn rig_of_main(&self, i: usize) -> usize {
        self.rig_of_main[i]
    }

    /// Rig index of the perturbed particle beside segment `j`, if there is one.
    #[inline]
    #[must_use]
    pub fn rig_of_perturbed(&self, j: usize) -> Option<usize> {
        self.perturbed.0[j].then(|| self.rig_of_main[j] + 1)
    }

    /// First of the hair's own particles that is free to move.
    #[must_use]
    pub fn first_free_main(&self) -> usize {
        self.rig_of_main.partition_point(|&p| p < self.n_kinematic)
    }

    /// Mass of each rig particle (g) of a strand with spacing `h_cm`. Perturbed particles share the strand's mass: each
    /// segment's is divided equally among the particles that bound or flank it, so the total is that of the hair.
    #[must_use]
    pub fn masses(&self, material: &Material, h_cm: f64) -> Vec<f64> {
        let segment = material.linear_density_g_per_cm * h_cm;
        let mut mass = vec![0.0; self.n_rig];
        for j in 0..self.n_main - 1 {
            let of = self.rig_of_main[j]..=self.rig_of_main[j + 1];
            let share = segment / of.clone().count() as f64;
            for p in of {
                mass[p] += share;
            }
        }
        mass
    }
}

/// Stiffness (dyn) and damping (dyn·s/cm) of the altitude springs in a strand of spacing `h_cm`.
#[must_use]
pub fn altitude_constants(material: &Material, h_cm: f64) -> (f64, f64) {
    (material.altitude_dyn / (h_cm * h_cm), material.altitude_damping)
}

impl SpringKind {
    /// Stiffness (force at strain one, dyn) and damping (dyn·s/cm) in a strand of spacing `h_cm`.
    #[must_use]
    pub fn constants(self, material: &Material, h_cm: f64) -> (f64, f64) {
        // EI and GJ of the network go as k·h²; this keeps the fibre the same at every resolution.
        let per_h2 = 1.0 / (h_cm * h_cm);
        match self {
            Self::Edge => (material.stretch_dyn, material.stretch_damping),
            Self::Bend => (material.bend_dyn * per_h2, material.bend_damping),
            Self::Torsion => (material.twist_dyn * per_h2, material.twist_damping),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shapes() -> Vec<Perturbed> {
        let partly = Perturbed((0..24).map(|j| (6..12).contains(&j)).collect());
        vec![Perturbed::nowhere(25), Perturbed::everywhere(25), partly]
    }

    #[test]
    fn springs_span_at_most_four_places() {
        for perturbed in shapes() {
            let topology = Topology::new(&perturbed);
            assert!(topology.reach <= 4 && topology.springs.iter().all(|s| s.a < s.b && s.b - s.a <= topology.reach));
        }
    }

    #[test]
    fn a_straight_rig_of_25_particles_has_49() {
        assert_eq!(Topology::new(&Perturbed::everywhere(25)).n_rig, 49);
    }

    #[test]
    fn perturbed_particles_stand_only_where_asked() {
        let topology = Topology::new(&shapes()[2]);
        assert_eq!(topology.n_rig, 25 + 6);
        for j in 0..24 {
            assert_eq!(topology.rig_of_perturbed(j).is_some(), (6..12).contains(&j), "segment {j}");
        }
    }

    #[test]
    fn every_segment_is_an_edge_and_every_second_neighbour_a_bend_exactly_once() {
        for perturbed in shapes() {
            let t = Topology::new(&perturbed);
            for (apart, kind) in [(1, SpringKind::Edge), (2, SpringKind::Bend)] {
                for i in 0..t.n_main - apart {
                    let (a, b) = (t.rig_of_main(i), t.rig_of_main(i + apart));
                    let found: Vec<_> = t.springs.iter().filter(|s| (s.a, s.b) == (a, b)).collect();
                    assert_eq!(found.len(), 1, "{i} to {}", i + apart);
                    assert_eq!(found[0].kind, kind);
                }
            }
        }
    }

    #[test]
    fn particle_masses_add_up_to_the_hair() {
        let material = Material::straight();
        for perturbed in shapes() {
            let total: f64 = Topology::new(&perturbed).masses(&material, 1.1).iter().sum();
            let hair = material.linear_density_g_per_cm * 24.0 * 1.1;
            assert!((total / hair - 1.0).abs() < 1e-12);
        }
    }
}
