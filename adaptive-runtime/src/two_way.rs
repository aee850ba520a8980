//! Effective forces on guides from the contact of normal hairs (AS16 §5.2).
//!
//! The least-squares problem of AS16 Eq. (4) couples guides particle index by particle index only. Only guides that some
//! hair in contact depends on take part. Two departures, both in docs/DEVIATIONS.md: rows of hairs out of contact weigh
//! less, since to the letter they dilute the force by the share of hairs in contact; and a guide's force never opposes the
//! sum of the contacts it answers. The matrix is kept from step to step and solved by a few steps of conjugate gradients;
//! the exact solution is there as a choice.

mod conjugate;
mod least_squares;
mod normal_matrix;
mod right_side;

use crate::interpolate::ActiveSet;
use crate::params::{TwoWayParams, TwoWaySolve};
use conjugate::Conjugate;
use io_formats::skinning_model::SkinningModel;
use least_squares::{ABSENT, LeastSquares};
use nalgebra::Vector3;
use normal_matrix::NormalMatrix;
use right_side::RightSide;

/// A contact force at one place along a normal hair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ContactPoint {
    pub strand: u32,
    /// Segment from particle `segment` to the next.
    pub segment: u16,
    /// Place along the segment, 0 to 1: the force acts on its ends by 1 - s and s.
    pub s: f32,
    /// dyn, world frame.
    pub force: [f32; 3],
}

impl ContactPoint {
    #[inline(always)]
    fn is_finite(&self) -> bool {
        self.s.is_finite() && self.force.iter().all(|x| x.is_finite())
    }
}

/// Which estimate within one step an update is, if guides are pushed and hairs looked at again within a step (AS16 §5.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Round {
    /// The first of a step: what is remembered of the step before fades once.
    First,
    /// Another of the same step: the contacts are those still left after the forces so far, and add to them.
    #[allow(dead_code, reason = "for steps that iterate; tests use it")]
    Again,
}

/// Forces below this (dyn) are dropped: a hundred-millionth of the weight of a guide's particle.
const LEAST_FORCE: f64 = 1e-9;

#[derive(Debug)]
pub(crate) struct TwoWay {
    n_particles: usize,
    /// Guide-major, dyn: what acts on the guides in the next step.
    pub(crate) forces: Vec<Vector3<f64>>,
    /// What is remembered of the step before, and what the rounds of this step have answered.
    carried: Vec<Vector3<f64>>,
    answered: Vec<Vector3<f64>>,
    /// Answer of the last first round, dyn: what the next one starts from.
    guess: Vec<[f32; 3]>,
    /// Strands in contact at the last update, ascending, and as one bit each.
    in_contact: Vec<u32>,
    contact_bits: Vec<u64>,
    /// Guides that take part, ascending, and for each guide its place among them.
    involved: Vec<u16>,
    place: Vec<u16>,
    right: RightSide,
    /// Absent if the solve builds its own.
    matrix: Option<NormalMatrix>,
    conjugate: Conjugate,
    least_squares: LeastSquares,
}

impl TwoWay {
    /// No hair in contact. `pairs` are the pairs i < j of guides that may occur together in a set, sorted.
    pub(crate) fn new<'s>(
        n_guides: usize,
        n_particles: usize,
        pairs: &[[u16; 2]],
        sets: impl ExactSizeIterator<Item = &'s ActiveSet>,
        params: &TwoWayParams,
    ) -> Self {
        let n_strands = sets.len();
        let keeps_matrix = params.enabled && params.solve != TwoWaySolve::LeastSquares;
        let matrix = keeps_matrix.then(|| {
            let mut matrix = NormalMatrix::new(n_guides, pairs, n_strands);
            sets.for_each(|set| matrix.add(set, [1, 0]));
            matrix
        });
        Self {
            n_particles,
            forces: vec![Vector3::zeros(); n_guides * n_particles],
            carried: vec![Vector3::zeros(); n_guides * n_particles],
            answered: vec![Vector3::zeros(); n_guides * n_particles],
            guess: vec![[0.0; 3]; n_guides * n_particles],
            in_contact: Vec::with_capacity(n_strands),
            contact_bits: vec![0; n_strands.div_ceil(64)],
            involved: Vec::with_capacity(n_guides),
            place: vec![ABSENT; n_guides],
            right: RightSide::new(n_guides, n_particles),
            matrix,
            conjugate: Conjugate::new(n_guides, if keeps_matrix { pairs.len() } else { 0 }, n_particles),
            least_squares: LeastSquares::new(n_particles),
        }
    }

    pub(crate) fn of_model<'s>(
        model: &SkinningModel,
        sets: impl ExactSizeIterator<Item = &'s ActiveSet>,
        params: &TwoWayParams,
    ) -> Self {
        Self::new(model.n_guides(), model.n_particles as usize, &model.pairs, sets, params)
    }

    /// To be told of every change of a strand's set, before the next update.
    pub(crate) fn set_changed(&mut self, strand: u32, old: &ActiveSet, new: &ActiveSet) {
        let Some(matrix) = &mut self.matrix else { return };
        let in_contact = (self.contact_bits[strand as usize / 64] >> (strand % 64) & 1) as i32;
        matrix.add(old, [-1, -in_contact]);
        matrix.add(new, [1, in_contact]);
    }

    /// Solves for the forces of the next step; returns how many guides take part.
    ///
    /// `contacts` are sorted by strand; `set_of` gives each strand's current set.
    pub(crate) fn update<'s>(
        &mut self,
        round: Round,
        n_strands: usize,
        set_of: impl Fn(usize) -> &'s ActiveSet + Sync,
        contacts: &[ContactPoint],
        particle_mass: impl Fn(usize) -> f64,
        params: &TwoWayParams,
    ) -> usize {
        debug_assert!(contacts.is_sorted_by_key(|c| c.strand), "contacts are sorted by strand");
        debug_assert!(contacts.iter().all(|c| usize::from(c.segment) + 1 < self.n_particles), "a segment has two ends");
        if round == Round::First {
            for (carried, force) in self.carried.iter_mut().zip(&self.forces) {
                *carried = force * params.memory;
            }
            self.answered.fill(Vector3::zeros());
        }
        self.note_contacts(contacts, &set_of);
        self.right.gather(contacts, &set_of);
        self.place.fill(ABSENT);
        self.right.involved(&mut self.involved);
        for (local, &guide) in self.involved.iter().enumerate() {
            self.place[usize::from(guide)] = local as u16;
        }
        if !self.involved.is_empty() {
            match params.solve {
                TwoWaySolve::LeastSquares => self.solve_exactly(n_strands, &set_of, contacts, params),
                TwoWaySolve::ConjugateGradients { iterations } => self.solve_by_steps(round, iterations, params),
            }
        } else if round == Round::First {
            self.guess.fill([0.0; 3]);
        }
        self.combine(particle_mass, params);
        self.involved.len()
    }

    /// Takes hairs that came into contact into the matrix, and those that left it out.
    fn note_contacts<'s>(&mut self, contacts: &[ContactPoint], set_of: &impl Fn(usize) -> &'s ActiveSet) {
        let Some(matrix) = &mut self.matrix else { return };
        let mut before = self.in_contact.iter().copied().peekable();
        for points in contacts.chunk_by(|a, b| a.strand == b.strand) {
            let strand = points[0].strand;
            while let Some(left) = before.next_if(|&s| s < strand) {
                matrix.add(set_of(left as usize), [0, -1]);
                self.contact_bits[left as usize / 64] &= !(1 << (left % 64));
            }
            if before.next_if_eq(&strand).is_none() {
                matrix.add(set_of(strand as usize), [0, 1]);
                self.contact_bits[strand as usize / 64] |= 1 << (strand % 64);
            }
        }
        for left in before {
            matrix.add(set_of(left as usize), [0, -1]);
            self.contact_bits[left as usize / 64] &= !(1 << (left % 64));
        }
        self.in_contact.clear();
        self.in_contact.extend(contacts.chunk_by(|a, b| a.strand == b.strand).map(|points| points[0].strand));
    }

    fn solve_exactly<'s>(
        &mut self,
        n_strands: usize,
        set_of: &(impl Fn(usize) -> &'s ActiveSet + Sync),
        contacts: &[ContactPoint],
        params: &TwoWayParams,
    ) {
        let n_involved = self.involved.len();
        let (idle, ridge) = (params.idle_row_weight, params.ridge);
        self.least_squares.solve(n_strands, set_of, contacts, n_involved, &self.place, idle, ridge);
        for (local, &guide) in self.involved.iter().enumerate() {
            for i in 0..self.n_particles {
                let answered = &mut self.answered[usize::from(guide) * self.n_particles + i];
                let (force, wanted) = (self.least_squares.answer(local, i), self.least_squares.wanted(local, i));
                if force.dot(&wanted) > 0.0 {
                    *answered += force;
                }
            }
        }
    }

    fn solve_by_steps(&mut self, round: Round, iterations: u32, params: &TwoWayParams) {
        let Some(matrix) = &self.matrix else { return };
        let n = self.n_particles;
        let (right, guess, involved) = (&self.right, &self.guess, &self.involved);
        self.conjugate.solve(
            matrix,
            involved,
            &self.place,
            params.idle_row_weight,
            params.ridge,
            iterations,
            n,
            |local, i| right.at(usize::from(involved[local]), i),
            |local, i| if round == Round::First { guess[usize::from(involved[local]) * n + i] } else { [0.0; 3] },
        );
        if round == Round::First {
            self.guess.fill([0.0; 3]);
        }
        for (local, &guide) in self.involved.iter().enumerate() {
            for i in 0..n {
                let at = usize::from(guide) * n + i;
                let force = self.conjugate.answer(local, i);
                if round == Round::First {
                    self.guess[at] = force;
                }
                let force = Vector3::from(force).cast::<f64>();
                if force.dot(&Vector3::from(self.right.at(usize::from(guide), i)).cast()) > 0.0 {
                    self.answered[at] += force;
                }
            }
        }
    }

    /// Forces of the next step from what is remembered and what this step's rounds answered, bounded in size.
    fn combine(&mut self, particle_mass: impl Fn(usize) -> f64, params: &TwoWayParams) {
        let (n, kept) = (self.n_particles, 1.0 - params.memory);
        for (guide, forces) in self.forces.chunks_mut(n).enumerate() {
            let of = guide * n..(guide + 1) * n;
            let (carried, answered) = (&self.carried[of.clone()], &self.answered[of]);
            let any = |values: &[Vector3<f64>]| values.iter().any(|v| *v != Vector3::zeros());
            if !any(carried) && !any(answered) {
                forces.fill(Vector3::zeros());
                continue;
            }
            let limit = params.max_acceleration * particle_mass(guide);
            for (force, (carried, answered)) in forces.iter_mut().zip(carried.iter().zip(answered)) {
                let total = carried + answered * kept;
                let size = total.norm();
                *force = if size > limit {
                    total * (limit / size)
                } else if size > LEAST_FORCE {
                    total
                } else {
                    Vector3::zeros()
                };
            }
        }
    }
}

#[cfg(test)]
mod tests;
