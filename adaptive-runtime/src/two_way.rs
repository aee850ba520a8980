//! Effective forces on guides from the contact of normal hairs (AS16 §5.2).
//!
//! The least-squares problem couples guides particle index by particle index only, so there are as many small systems as
//! particles, solved in parallel. Only guides that some hair in contact depends on take part. Two departures, both in
//! docs/DEVIATIONS.md: rows of hairs out of contact weigh less, since to the letter they dilute the force by the share of
//! hairs in contact; and a guide's force never opposes the sum of the contacts it answers.

use crate::interpolate::ActiveSet;
use crate::params::TwoWayParams;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Contact forces on one normal hair.
#[derive(Clone, Debug)]
pub(crate) struct ContactRow {
    pub strand: u32,
    /// dyn, one per particle.
    pub forces: Vec<Vector3<f64>>,
}

#[derive(Debug)]
pub(crate) struct TwoWay {
    n_particles: usize,
    /// Guide-major, dyn: what acts on the guides in the next step.
    pub(crate) forces: Vec<Vector3<f64>>,
    /// Guides in the systems, ascending, and for each guide its place among them.
    involved: Vec<u16>,
    place: Vec<u16>,
    /// Hairs with rows: strand and, if in contact, index of its forces.
    rows: Vec<(u32, Option<u32>)>,
    systems: Vec<System>,
}

#[derive(Debug, Default)]
struct System {
    matrix: Vec<f64>,
    rhs: Vec<[f64; 3]>,
    /// Sum of contact forces each guide answers, before the solve.
    wanted: Vec<[f64; 3]>,
}

const ABSENT: u16 = u16::MAX;

impl TwoWay {
    pub(crate) fn new(n_guides: usize, n_particles: usize) -> Self {
        Self {
            n_particles,
            forces: vec![Vector3::zeros(); n_guides * n_particles],
            involved: Vec::with_capacity(n_guides),
            place: vec![ABSENT; n_guides],
            rows: Vec::new(),
            systems: (0..n_particles).map(|_| System::default()).collect(),
        }
    }

    /// Solves for the forces of the next step; returns how many guides take part.
    pub(crate) fn update<'s>(
        &mut self,
        n_strands: usize,
        set_of: impl Fn(usize) -> &'s ActiveSet + Sync,
        contacts: &[ContactRow],
        particle_mass: impl Fn(usize) -> f64,
        params: &TwoWayParams,
    ) -> usize {
        for force in &mut self.forces {
            *force *= params.memory;
        }
        self.gather(n_strands, &set_of, contacts);
        if self.involved.is_empty() {
            return 0;
        }
        let n = self.n_particles;
        let (rows, place, n_involved) = (&self.rows, &self.place, self.involved.len());
        self.systems.par_iter_mut().enumerate().for_each(|(i, system)| {
            let u = i as f32 / (n - 1) as f32;
            system.build(n_involved, place, rows, u, &set_of, |c| contacts[c as usize].forces[i], params);
            system.solve(n_involved);
        });
        let kept = 1.0 - params.memory;
        for (local, &guide) in self.involved.iter().enumerate() {
            let limit = params.max_acceleration * particle_mass(usize::from(guide));
            for (i, system) in self.systems.iter().enumerate() {
                let force = Vector3::from(system.rhs[local]);
                if force.dot(&Vector3::from(system.wanted[local])) <= 0.0 {
                    continue;
                }
                let total = &mut self.forces[usize::from(guide) * n + i];
                *total += force * kept;
                let size = total.norm();
                if size > limit {
                    *total *= limit / size;
                }
            }
        }
        n_involved
    }

    fn gather<'s>(&mut self, n_strands: usize, set_of: &impl Fn(usize) -> &'s ActiveSet, contacts: &[ContactRow]) {
        self.place.fill(ABSENT);
        self.involved.clear();
        self.rows.clear();
        for contact in contacts {
            let set = set_of(contact.strand as usize);
            for &guide in &set.guides[..usize::from(set.n)] {
                if self.place[usize::from(guide)] == ABSENT {
                    self.place[usize::from(guide)] = 0;
                    self.involved.push(guide);
                }
            }
        }
        if self.involved.is_empty() {
            return;
        }
        self.involved.sort_unstable();
        for (local, &guide) in self.involved.iter().enumerate() {
            self.place[usize::from(guide)] = local as u16;
        }
        // Contacts are ordered by strand, so one walk pairs them.
        let mut next = 0;
        for strand in 0..n_strands {
            let contact = contacts.get(next).filter(|c| c.strand as usize == strand).map(|_| next as u32);
            next += usize::from(contact.is_some());
            let set = set_of(strand);
            if set.guides[..usize::from(set.n)].iter().any(|&g| self.place[usize::from(g)] != ABSENT) {
                self.rows.push((strand as u32, contact));
            }
        }
    }
}

impl System {
    /// Normal equations of one particle index.
    /// Implements AS16 Eq. (4), with rows of hairs out of contact weighed by `idle_row_weight` and a ridge, since the
    /// matrix is rank deficient where no hair depends on a guide.
    fn build<'s>(
        &mut self,
        n: usize,
        place: &[u16],
        rows: &[(u32, Option<u32>)],
        u: f32,
        set_of: &impl Fn(usize) -> &'s ActiveSet,
        force: impl Fn(u32) -> Vector3<f64>,
        params: &TwoWayParams,
    ) {
        self.matrix.clear();
        self.matrix.resize(n * n, 0.0);
        self.rhs.clear();
        self.rhs.resize(n, [0.0; 3]);
        for &(strand, contact) in rows {
            let set = set_of(strand as usize);
            let weights = set.weights_at(u);
            let row_weight = if contact.is_some() { 1.0 } else { params.idle_row_weight };
            let wanted = contact.map(&force);
            for a in 0..usize::from(set.n) {
                let ga = place[usize::from(set.guides[a])];
                if ga == ABSENT {
                    continue;
                }
                let ga = usize::from(ga);
                let wa = row_weight * f64::from(weights[a]);
                for b in 0..=a {
                    let gb = place[usize::from(set.guides[b])];
                    if gb != ABSENT {
                        let (hi, lo) = (ga.max(usize::from(gb)), ga.min(usize::from(gb)));
                        self.matrix[hi * n + lo] += wa * f64::from(weights[b]);
                    }
                }
                if let Some(wanted) = wanted {
                    for c in 0..3 {
                        self.rhs[ga][c] += wa * wanted[c];
                    }
                }
            }
        }
        let mean: f64 = (0..n).map(|k| self.matrix[k * n + k]).sum::<f64>() / n as f64;
        let ridge = params.ridge * mean + f64::MIN_POSITIVE.sqrt();
        for k in 0..n {
            self.matrix[k * n + k] += ridge;
        }
        self.wanted.clear();
        self.wanted.extend_from_slice(&self.rhs);
    }

    /// Dense Cholesky in place; the ridge keeps every pivot positive.
    fn solve(&mut self, n: usize) {
        let m = &mut self.matrix;
        for row in 0..n {
            for col in 0..=row {
                let mut sum = m[row * n + col];
                for k in 0..col {
                    sum -= m[row * n + k] * m[col * n + k];
                }
                m[row * n + col] = if row == col { sum.max(f64::MIN_POSITIVE).sqrt() } else { sum / m[col * n + col] };
            }
        }
        for row in 0..n {
            for k in 0..row {
                let earlier = self.rhs[k];
                for c in 0..3 {
                    self.rhs[row][c] -= m[row * n + k] * earlier[c];
                }
            }
            self.rhs[row] = self.rhs[row].map(|x| x / m[row * n + row]);
        }
        for row in (0..n).rev() {
            for k in row + 1..n {
                let later = self.rhs[k];
                for c in 0..3 {
                    self.rhs[row][c] -= m[k * n + row] * later[c];
                }
            }
            self.rhs[row] = self.rhs[row].map(|x| x / m[row * n + row]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use io_formats::skinning_model::{MAX_ELIGIBLE, WeightPoly};

    fn set(guides: &[(u16, f32)]) -> ActiveSet {
        let mut set = ActiveSet { n: guides.len() as u8, guides: [0; MAX_ELIGIBLE], ..ActiveSet::EMPTY };
        for (k, &(guide, weight)) in guides.iter().enumerate() {
            set.guides[k] = guide;
            set.weights[k] = WeightPoly { quad: 0.0, lin: 0.0, con: weight };
        }
        set
    }

    fn letter() -> TwoWayParams {
        TwoWayParams {
            enabled: true,
            stiffness_over_inertia: 1.0,
            idle_row_weight: 1.0,
            ridge: 1e-12,
            memory: 0.0,
            max_acceleration: f64::INFINITY,
        }
    }

    /// Relative effect of the ridge and of rounding on a well-conditioned system.
    const SOLVER_AGREEMENT: f64 = 1e-6;

    #[test]
    fn forces_skinned_from_guides_are_given_back() {
        let sets = [set(&[(0, 0.7), (1, 0.3)]), set(&[(1, 0.5), (2, 0.5)]), set(&[(0, 0.2), (2, 0.8)])];
        let planted = [Vector3::new(1.0, 0.2, 0.0), Vector3::new(0.8, 0.0, 0.3), Vector3::new(1.2, 0.1, 0.1)];
        let contacts: Vec<_> = (0..3)
            .map(|s| {
                let active = &sets[s];
                let force = (0..usize::from(active.n))
                    .map(|k| planted[usize::from(active.guides[k])] * f64::from(active.weights[k].con))
                    .sum::<Vector3<f64>>();
                ContactRow { strand: s as u32, forces: vec![force; 4] }
            })
            .collect();
        let mut two_way = TwoWay::new(3, 4);
        assert_eq!(two_way.update(3, |s| &sets[s], &contacts, |_| 1.0, &letter()), 3);
        for guide in 0..3 {
            for i in 0..4 {
                assert!((two_way.forces[guide * 4 + i] - planted[guide]).norm() < SOLVER_AGREEMENT);
            }
        }
    }

    #[test]
    fn without_contact_no_guide_is_pushed() {
        let sets = [set(&[(0, 1.0)])];
        let mut two_way = TwoWay::new(1, 3);
        assert_eq!(two_way.update(1, |s| &sets[s], &[], |_| 1.0, &letter()), 0);
        assert!(two_way.forces.iter().all(|f| *f == Vector3::zeros()));
    }

    #[test]
    fn rows_out_of_contact_dilute_the_force_less_when_weighed_less() {
        let sets: Vec<_> = (0..10).map(|_| set(&[(0, 1.0)])).collect();
        let contacts = [ContactRow { strand: 0, forces: vec![Vector3::x(); 3] }];
        let force = |idle: f64| {
            let mut two_way = TwoWay::new(1, 3);
            two_way.update(10, |s| &sets[s], &contacts, |_| 1.0, &TwoWayParams { idle_row_weight: idle, ..letter() });
            two_way.forces[0].x
        };
        assert!((force(1.0) - 0.1).abs() < SOLVER_AGREEMENT);
        assert!((force(0.0) - 1.0).abs() < SOLVER_AGREEMENT);
    }
}
