//! Hair rubs on hair around a plain step: the friction of AS16 §7.1 at a cost that whole heads can bear.
//!
//! Contacts are sampled (`interaction::slices`) where the last step left the hair; strands take the step on their own; then
//! what moved them is taken as the velocity that repulsion acts on, and positions and velocities change by as much. Within
//! the step, where MS08 §4 has repulsion, every strand's matrix would have to be kept until all have met
//! (docs/DEVIATIONS.md). Invariant: what rubbing changes keeps the momentum of free
//! particles of the hair's own; perturbed ones follow.

use super::StepInput;
use crate::interaction::{Blocks, ContactSampling, RepulsionParams, RepulsionReport, SliceSearch, Strands};
use crate::lanes::LANES;
use crate::system::{StrandState, StrandSystem, get};
use nalgebra::Vector3;
use rayon::prelude::*;

/// Buffers of rubbing, kept from step to step.
#[derive(Debug, Default)]
pub(super) struct RubbingWork {
    slices: SliceSearch,
    contacts: Blocks,
    inv_mass: Vec<f64>,
    position: Vec<Vector3<f64>>,
    velocity: Vec<Vector3<f64>>,
    before: Vec<Vector3<f64>>,
}

impl StrandSystem {
    /// Finds the contacts of the coming step.
    pub(super) fn look_for_contacts(
        &self,
        state: &StrandState,
        sampling: &ContactSampling,
        thickness_cm: f64,
        input: &StepInput,
        w: &mut RubbingWork,
    ) {
        self.free_inverse_masses(input, &mut w.inv_mass);
        self.gather(&mut w.position, |b, p, lane| get(&state.batches[b].position[p], lane));
        let strands = Strands::new(self.n_main, &w.position, &w.inv_mass);
        w.slices.find(&strands, thickness_cm, sampling, &mut w.contacts);
    }

    /// Gives hairs in contact the impulses of the step just taken: what moved them is changed, and their velocities by as
    /// much. `any_put_back`: whether the step had to put strands back.
    /// Implements AS16 §7.1: friction between hairs, after Bridson 2002.
    pub(super) fn rub_after(
        &self,
        state: &mut StrandState,
        input: &StepInput,
        repulsion: &RepulsionParams,
        any_put_back: bool,
        w: &mut RubbingWork,
    ) -> RepulsionReport {
        let dt = input.dt;
        self.gather(&mut w.velocity, |b, p, lane| get(&state.batches[b].position[p], lane));
        let moved = w.velocity.par_iter_mut().zip(&w.position).with_min_len(CHUNK);
        moved.for_each(|(v, before)| *v = (*v - before) / dt);
        if any_put_back {
            self.leave_out_those_put_back(state, w);
        }
        w.before.clone_from(&w.velocity);
        let strands = Strands::new(self.n_main, &w.position, &w.inv_mass);
        let report = w.contacts.repel(&strands, repulsion, dt, &mut w.velocity);
        let change = w.velocity.par_iter_mut().zip(&mut w.before).with_min_len(CHUNK);
        change.for_each(|(v, before)| {
            *v -= *before;
            *before = *v * dt;
        });
        let (change, moved) = (&*w.velocity, &*w.before);
        let batches = self.batches.par_iter().zip(state.batches.par_iter_mut());
        batches.for_each(|(batch, state)| {
            self.add_velocity(batch, change, &mut state.velocity);
            self.add_velocity(batch, moved, &mut state.position);
            // What was known of distances to deforming bodies held for where the step had left the hair.
            state.clearance.fill([f64::NEG_INFINITY; LANES]);
        });
        report
    }

    /// Strands put back in this step did not move to where they are: they stand still, and nothing moves them.
    fn leave_out_those_put_back(&self, state: &StrandState, w: &mut RubbingWork) {
        let strands = w.velocity.par_chunks_mut(self.n_main).zip(w.inv_mass.par_chunks_mut(self.n_main));
        strands.zip(&self.place).for_each(|((velocity, inv_mass), &(batch, lane))| {
            // A strand at rest may be taken for one of them, and loses nothing by it.
            let is_still = |v| get(v, lane as usize) == Vector3::zeros();
            if state.batches[batch as usize].velocity.iter().all(is_still) {
                velocity.fill(Vector3::zeros());
                inv_mass.fill(0.0);
            }
        });
    }
}

/// Particles handled as one piece of parallel work.
const CHUNK: usize = 4096;
