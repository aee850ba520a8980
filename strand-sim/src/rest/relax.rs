//! Where perturbed particles are in hair that is bent: the hair's own particles held, theirs moved to equilibrium.
//!
//! A shape says where the hair's own particles are; perturbed ones are placed beside them as in straight hair (MS08 Fig. 6d),
//! which in bent hair strains their edges by a thousandth, thousands of times its weight. A few backward Euler steps with
//! directions frozen (MS08 §4.1), each from a standstill, take them to where springs and weight balance. Invariant: no other
//! particle moves, and a strand's result does not depend on its batch.

use super::Tangent;
use crate::implicit::{self, Driven, Problem};
use crate::lanes::{LANES, ZERO};
use crate::step::{StepParams, Work};
use crate::system::{Batch, BatchState, StrandState, StrandSystem, get, set};
use rayon::prelude::*;

/// Length of one step, s: inertia is then a hundredth of the softest springs, which keeps a particle that turns far in hand.
const STEP_S: f64 = 0.02;

/// Steps at most; directions settle within some ten.
const MAX_STEPS: usize = 60;

/// Farthest a particle moves in a step, as a share of the segment beside it: frozen directions hold no farther.
const LONGEST_MOVE: f64 = 0.2;

/// Movement in a step at which a strand is done, cm: round-off of a solve with springs of 3e5 dyn.
const DONE_CM: f64 = 1e-12;

impl StrandSystem {
    /// Moves the perturbed particles of `state` to equilibrium among the hair's own particles, which stay.
    pub(super) fn relax_perturbed(&self, state: &mut StrandState, params: &StepParams) {
        self.batches
            .par_iter()
            .zip(state.batches.par_iter_mut())
            .for_each_init(|| Work::new(self), |work, (batch, state)| self.relax_batch(batch, state, params, work));
    }

    fn relax_batch(&self, batch: &Batch, state: &mut BatchState, params: &StepParams, work: &mut Work) {
        let topology = &self.topologies[batch.topology];
        let (n_kin, n_rig) = (topology.n_kinematic, topology.n_rig);
        let perturbed: Vec<(usize, usize)> = (0..self.n_main - 1)
            .filter_map(|segment| Some((segment, topology.rig_of_perturbed(segment)?)))
            .filter(|&(_, p)| p >= n_kin)
            .collect();
        if perturbed.is_empty() {
            return;
        }
        let held: Vec<Driven> = (0..self.n_main)
            .map(|i| topology.rig_of_main(i))
            .filter(|&particle| particle >= n_kin)
            .flat_map(|particle| (0..LANES).map(move |lane| Driven { lane, particle, velocity: [0.0; 3] }))
            .collect();
        let still = vec![[ZERO; 3]; n_kin];
        let mut done = [false; LANES];
        for _ in 0..MAX_STEPS {
            let rhs = &mut work.velocity[..3 * (n_rig - n_kin)];
            batch.fill_weight(n_kin, n_rig, &(params.gravity * STEP_S), rhs);
            let problem = Problem {
                topology,
                batch,
                start: &state.position,
                guess: None,
                kinematic: &still,
                h: STEP_S,
                implicit: Tangent::Frozen.implicit(),
                drag_per_s: 0.0,
                air: &[],
                contacts: &[],
                driven: &held,
            };
            implicit::solve(&problem, &mut work.matrix, rhs);
            for lane in 0..LANES {
                if done[lane] {
                    continue;
                }
                let mut farthest: f64 = 0.0;
                for &(segment, p) in &perturbed {
                    let row = 3 * (p - n_kin);
                    let velocity = nalgebra::Vector3::new(rhs[row][lane], rhs[row + 1][lane], rhs[row + 2][lane]);
                    let longest = LONGEST_MOVE * batch.segment_length[segment][lane];
                    let moved = (velocity * STEP_S).cap_magnitude(longest);
                    if !moved.iter().all(|c| c.is_finite()) {
                        continue;
                    }
                    farthest = farthest.max(moved.norm());
                    let x = get(&state.position[p], lane) + moved;
                    set(&mut state.position[p], lane, x);
                }
                done[lane] = farthest < DONE_CM;
            }
            if done.iter().all(|&d| d) {
                return;
            }
        }
    }
}
