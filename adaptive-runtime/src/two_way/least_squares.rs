//! AS16 Eq. (4) solved exactly: dense normal equations built from every row anew, in double precision.
//!
//! The reference for [`super::conjugate`], and a choice of its own where cost does not matter.

use super::ContactPoint;
use crate::interpolate::ActiveSet;
use nalgebra::Vector3;
use rayon::prelude::*;

pub(crate) const ABSENT: u16 = u16::MAX;

#[derive(Debug)]
pub(crate) struct LeastSquares {
    /// Hairs with rows, and whether each is in contact.
    rows: Vec<(u32, bool)>,
    systems: Vec<System>,
}

#[derive(Debug, Default)]
struct System {
    matrix: Vec<f64>,
    rhs: Vec<[f64; 3]>,
    /// Sum of contact forces each guide answers, before the solve.
    wanted: Vec<[f64; 3]>,
}

impl LeastSquares {
    pub(crate) fn new(n_particles: usize) -> Self {
        Self { rows: Vec::new(), systems: (0..n_particles).map(|_| System::default()).collect() }
    }

    /// Solves for the `n_involved` guides whose `place` is not [`ABSENT`]. `contacts` are sorted by strand.
    pub(crate) fn solve<'s>(
        &mut self,
        n_strands: usize,
        set_of: &(impl Fn(usize) -> &'s ActiveSet + Sync),
        contacts: &[ContactPoint],
        n_involved: usize,
        place: &[u16],
        idle: f64,
        ridge: f64,
    ) {
        self.rows.clear();
        let mut next = 0;
        for strand in 0..n_strands {
            let first = next;
            while contacts.get(next).is_some_and(|c| c.strand as usize == strand) {
                next += 1;
            }
            let set = set_of(strand);
            if set.guides[..usize::from(set.n)].iter().any(|&g| place[usize::from(g)] != ABSENT) {
                self.rows.push((strand as u32, first < next));
            }
        }
        let (rows, last) = (&self.rows, self.systems.len() - 1);
        self.systems.par_iter_mut().enumerate().for_each(|(i, system)| {
            let u = i as f32 / last as f32;
            system.build(n_involved, place, rows, u, set_of, idle, ridge);
            system.add_contacts(place, contacts, i, u, set_of);
            system.solve(n_involved);
        });
    }

    /// Force on one particle of a guide that takes part, dyn.
    pub(crate) fn answer(&self, local: usize, particle: usize) -> Vector3<f64> {
        self.systems[particle].rhs[local].into()
    }

    /// Weighted sum of the contact forces it answers, dyn.
    pub(crate) fn wanted(&self, local: usize, particle: usize) -> Vector3<f64> {
        self.systems[particle].wanted[local].into()
    }
}

impl System {
    /// Matrix of one particle index.
    /// Implements AS16 Eq. (4), with rows of hairs out of contact weighed by `idle` and a ridge, since the matrix is rank
    /// deficient where no hair depends on a guide.
    fn build<'s>(
        &mut self,
        n: usize,
        place: &[u16],
        rows: &[(u32, bool)],
        u: f32,
        set_of: &impl Fn(usize) -> &'s ActiveSet,
        idle: f64,
        ridge: f64,
    ) {
        self.matrix.clear();
        self.matrix.resize(n * n, 0.0);
        for &(strand, in_contact) in rows {
            let set = set_of(strand as usize);
            let weights = set.weights_at(u);
            let row_weight = if in_contact { 1.0 } else { idle };
            for a in 0..usize::from(set.n) {
                let ga = place[usize::from(set.guides[a])];
                if ga == ABSENT {
                    continue;
                }
                let wa = row_weight * f64::from(weights[a]);
                for b in 0..=a {
                    let gb = place[usize::from(set.guides[b])];
                    if gb != ABSENT {
                        let (hi, lo) = (usize::from(ga.max(gb)), usize::from(ga.min(gb)));
                        self.matrix[hi * n + lo] += wa * f64::from(weights[b]);
                    }
                }
            }
        }
        let mean: f64 = (0..n).map(|k| self.matrix[k * n + k]).sum::<f64>() / n as f64;
        let ridge = ridge * mean + f64::MIN_POSITIVE.sqrt();
        for k in 0..n {
            self.matrix[k * n + k] += ridge;
        }
        self.rhs.clear();
        self.rhs.resize(n, [0.0; 3]);
    }

    /// Right side of particle `i`: contacts act on both ends of their segment.
    fn add_contacts<'s>(
        &mut self,
        place: &[u16],
        contacts: &[ContactPoint],
        i: usize,
        u: f32,
        set_of: &impl Fn(usize) -> &'s ActiveSet,
    ) {
        for contact in contacts.iter().filter(|c| c.is_finite()) {
            let segment = usize::from(contact.segment);
            let share = if segment == i {
                1.0 - f64::from(contact.s)
            } else if segment + 1 == i {
                f64::from(contact.s)
            } else {
                continue;
            };
            let set = set_of(contact.strand as usize);
            let weights = set.weights_at(u);
            for (&guide, &w) in set.guides[..usize::from(set.n)].iter().zip(&weights) {
                let to = &mut self.rhs[usize::from(place[usize::from(guide)])];
                for c in 0..3 {
                    to[c] += share * f64::from(w) * f64::from(contact.force[c]);
                }
            }
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
