//! One time step of a strand system: linearly implicit backward Euler with substeps.
//!
//! Per substep: kinematic roots, contacts, one banded solve for the new velocities (MS08 §4.1), friction, strain limiting
//! (MS08 §4.2), positions. MS08 §4 takes a second solve for the velocity; the single solve is backward Euler on both, see
//! docs/DEVIATIONS.md. Strands do not meet each other here, so batches run in parallel and the result is the same for
//! any number of threads.

use crate::body_contact::{Contact, ContactParams};
use crate::forces::{add_spring, linearise};
use crate::lanes::{LANES, Lane, Lane3, ZERO};
use crate::solve::banded::BandedMatrix;
use crate::strain_limit::limit_strain;
use crate::system::{Batch, BatchState, StrandState, StrandSystem, get, set, transform};
use collision::MovingSolid;
use multiversion::multiversion;
use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;

/// How a step is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepParams {
    /// Linear solves per step, each over an equal part of it.
    pub substeps: usize,
    /// Acceleration of gravity, cm/s².
    pub gravity: Vector3<f64>,
    /// Largest stretch left after a step, as a fraction of a segment's length.
    pub strain_limit: f64,
    /// Contact with solids.
    pub contact: ContactParams,
}

impl StepParams {
    /// Standard gravity along -y, four substeps: measured in docs/DEVIATIONS.md against a step of 0.5 ms.
    #[must_use]
    pub fn standard() -> Self {
        Self {
            substeps: 4,
            gravity: Vector3::new(0.0, -981.0, 0.0),
            strain_limit: 0.01,
            contact: ContactParams::standard(),
        }
    }
}

/// What drives a step.
#[derive(Clone, Copy, Debug)]
pub struct StepInput<'a> {
    /// Length of the step, s.
    pub dt: f64,
    /// Head pose at its start.
    pub world_from_head_before: Isometry3<f64>,
    /// Head pose at its end.
    pub world_from_head_after: Isometry3<f64>,
    /// Solids with their motion over the step.
    pub solids: &'a [MovingSolid<'a>],
    /// Further forces on the hair's own particles, strand-major, dyn; held over the step. Empty for none.
    pub forces: &'a [Vector3<f64>],
}

/// What a step met.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StepReport {
    /// Segment contacts handled, summed over substeps.
    pub contacts: u64,
    /// Strands whose state was not finite and was put back at rest.
    pub quarantined: u32,
}

/// Buffers of a step, reused from step to step.
#[derive(Debug, Default)]
pub struct StepWorkspace {
    slots: Vec<Slot>,
}

/// Buffers of one worker.
#[derive(Debug)]
struct Slot {
    matrix: Vec<BandedMatrix>,
    velocity: Vec<Lane>,
    old_position: Vec<Lane3>,
    contacts: Vec<Contact>,
    report: StepReport,
}

/// Upper bound of parallel slices, as a multiple of the thread count: contacts make some batches dearer than others.
const SLICES_PER_THREAD: usize = 8;

impl StrandSystem {
    /// Advances `state` by one step.
    ///
    /// # Panics
    /// If `state` is not one of this system, or `forces` is neither empty nor one entry per particle.
    pub fn step(
        &self,
        state: &mut StrandState,
        input: &StepInput,
        params: &StepParams,
        workspace: &mut StepWorkspace,
    ) -> StepReport {
        assert_eq!(state.batches.len(), self.batches.len(), "state of another system");
        assert!(
            input.forces.is_empty() || input.forces.len() == self.n_strands * self.n_main,
            "one force per particle"
        );
        if self.batches.is_empty() {
            return StepReport::default();
        }
        let n_slices = self.batches.len().min(SLICES_PER_THREAD * rayon::current_num_threads());
        let slice = self.batches.len().div_ceil(n_slices);
        while workspace.slots.len() < n_slices {
            workspace.slots.push(self.slot());
        }
        self.batches
            .par_chunks(slice)
            .zip(state.batches.par_chunks_mut(slice))
            .zip(workspace.slots.par_iter_mut())
            .for_each(|((batches, states), slot)| {
                slot.report = StepReport::default();
                for (batch, state) in batches.iter().zip(states) {
                    self.step_batch(batch, state, input, params, slot);
                }
            });
        let n_used = self.batches.len().div_ceil(slice);
        workspace.slots[..n_used].iter().fold(StepReport::default(), |sum, slot| StepReport {
            contacts: sum.contacts + slot.report.contacts,
            quarantined: sum.quarantined + slot.report.quarantined,
        })
    }

    fn slot(&self) -> Slot {
        let matrix =
            self.topologies.iter().map(|t| BandedMatrix::new(t.n_rig - t.n_kinematic, t.reach)).collect::<Vec<_>>();
        let n_dof = self.topologies.iter().map(|t| 3 * (t.n_rig - t.n_kinematic)).max().unwrap_or(0);
        let n_rig = self.topologies.iter().map(|t| t.n_rig).max().unwrap_or(0);
        Slot {
            matrix,
            velocity: vec![ZERO; n_dof],
            old_position: vec![[ZERO; 3]; n_rig],
            contacts: Vec::with_capacity(LANES * self.n_main),
            report: StepReport::default(),
        }
    }

    fn step_batch(
        &self,
        batch: &Batch,
        state: &mut BatchState,
        input: &StepInput,
        params: &StepParams,
        slot: &mut Slot,
    ) {
        let topology = &self.topologies[batch.topology];
        let n_kin = topology.n_kinematic;
        let h = input.dt / params.substeps as f64;
        if state.clearance.len() != input.solids.len() {
            state.clearance.clear();
            // Nothing is known of a new solid: its distance bound starts below zero.
            state.clearance.resize(input.solids.len(), [-1.0; LANES]);
        }
        for sub in 0..params.substeps {
            let (begin, end) = (sub as f64 / params.substeps as f64, (sub + 1) as f64 / params.substeps as f64);
            let head = interpolate(&input.world_from_head_before, &input.world_from_head_after, end);
            let n_rig = topology.n_rig;
            slot.old_position[..n_rig].copy_from_slice(&state.position);
            for p in 0..n_kin {
                for l in 0..LANES {
                    let target = transform(&head, get(&batch.rest_in_head[p], l));
                    let moved = (target - get(&state.position[p], l)) / h;
                    set(&mut state.velocity[p], l, moved);
                }
            }
            slot.contacts.clear();
            self.find_contacts(batch, state, input, params, (begin, end), h, &mut slot.contacts);
            slot.report.contacts += slot.contacts.len() as u64;
            self.solve_velocities(batch, state, input, params, h, slot);
            for contact in &slot.contacts {
                contact.apply_friction(n_kin, h, &batch.mass, &mut state.velocity);
            }
            for p in 0..n_rig {
                for c in 0..3 {
                    for l in 0..LANES {
                        state.position[p][c][l] += h * state.velocity[p][c][l];
                    }
                }
            }
            limit_strain(topology, batch, &mut state.position, params.strain_limit);
            account_movement(state, &slot.old_position[..n_rig], input.solids, end - begin);
        }
        for lane in 0..batch.strands.len() {
            if !lane_is_finite(state, lane) {
                self.put_back(batch, state, lane, &input.world_from_head_after);
                slot.report.quarantined += 1;
            }
        }
    }

    /// Fills `state.velocity` with the velocities at the end of the substep.
    fn solve_velocities(
        &self,
        batch: &Batch,
        state: &mut BatchState,
        input: &StepInput,
        params: &StepParams,
        h: f64,
        slot: &mut Slot,
    ) {
        let topology = &self.topologies[batch.topology];
        let matrix = &mut slot.matrix[batch.topology];
        let rhs = &mut slot.velocity[..3 * matrix.n_blocks()];
        self.external_impulses(batch, state, input, params, h, rhs);
        assemble_and_solve(self, batch, state, h, matrix, rhs, &slot.contacts);
        for p in topology.n_kinematic..topology.n_rig {
            for c in 0..3 {
                state.velocity[p][c] = rhs[3 * (p - topology.n_kinematic) + c];
            }
        }
    }

    /// Momentum each free particle starts with, plus the impulses of gravity and of the caller's forces.
    fn external_impulses(
        &self,
        batch: &Batch,
        state: &BatchState,
        input: &StepInput,
        params: &StepParams,
        h: f64,
        rhs: &mut [Lane],
    ) {
        let topology = &self.topologies[batch.topology];
        let n_kin = topology.n_kinematic;
        for p in n_kin..topology.n_rig {
            for c in 0..3 {
                let pull = h * params.gravity[c];
                for l in 0..LANES {
                    rhs[3 * (p - n_kin) + c][l] = batch.mass[p][l] * (state.velocity[p][c][l] + pull);
                }
            }
        }
        if input.forces.is_empty() {
            return;
        }
        for (lane, &strand) in batch.strands.iter().enumerate() {
            for i in topology.first_free_main()..self.n_main {
                let force = input.forces[strand as usize * self.n_main + i];
                for c in 0..3 {
                    rhs[3 * (topology.rig_of_main(i) - n_kin) + c][lane] += h * force[c];
                }
            }
        }
    }

    fn put_back(&self, batch: &Batch, state: &mut BatchState, lane: usize, world_from_head: &Isometry3<f64>) {
        for p in 0..state.position.len() {
            set(&mut state.position[p], lane, transform(world_from_head, get(&batch.rest_in_head[p], lane)));
            set(&mut state.velocity[p], lane, Vector3::zeros());
        }
        for clearance in &mut state.clearance {
            clearance[lane] = -1.0;
        }
    }
}

/// Builds and solves (M(1 + hγ) + hS) v = rhs for the free particles; the solution replaces `rhs`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn assemble_and_solve(
    system: &StrandSystem,
    batch: &Batch,
    state: &BatchState,
    h: f64,
    matrix: &mut BandedMatrix,
    rhs: &mut [Lane],
    contacts: &[Contact],
) {
    let topology = &system.topologies[batch.topology];
    let n_kin = topology.n_kinematic;
    matrix.clear();
    let drag = 1.0 + h * system.material.air_drag_per_s;
    for p in n_kin..topology.n_rig {
        for c in 0..3 {
            let entry = &mut matrix.block(p - n_kin, p - n_kin)[4 * c];
            for l in 0..LANES {
                entry[l] = batch.mass[p][l] * drag;
            }
        }
    }
    for (k, spring) in topology.springs.iter().enumerate() {
        let s = linearise(
            &state.position[spring.a],
            &state.position[spring.b],
            &batch.stiffness[k],
            &batch.inv_rest_length[k],
            &batch.damping[k],
            h,
        );
        add_spring(topology, *spring, &s, h, &state.velocity, matrix, rhs);
    }
    for contact in contacts {
        contact.add_to(n_kin, h, matrix, rhs);
    }
    matrix.factor();
    matrix.solve(rhs);
}

fn interpolate(before: &Isometry3<f64>, after: &Isometry3<f64>, alpha: f64) -> Isometry3<f64> {
    if alpha >= 1.0 {
        return *after;
    }
    before.try_lerp_slerp(after, alpha, 1e-9).unwrap_or(*after)
}

/// Lowers every distance bound by what strand and solid have moved since it was measured.
fn account_movement(state: &mut BatchState, old_position: &[Lane3], solids: &[MovingSolid], fraction: f64) {
    if solids.is_empty() {
        return;
    }
    let mut moved = ZERO;
    for (new, old) in state.position.iter().zip(old_position) {
        for l in 0..LANES {
            let d = (new[0][l] - old[0][l]).powi(2) + (new[1][l] - old[1][l]).powi(2) + (new[2][l] - old[2][l]).powi(2);
            moved[l] = moved[l].max(d);
        }
    }
    for (clearance, solid) in state.clearance.iter_mut().zip(solids) {
        let by_solid = fraction * solid.max_displacement();
        for l in 0..LANES {
            clearance[l] -= moved[l].sqrt() + by_solid;
        }
    }
}

fn lane_is_finite(state: &BatchState, lane: usize) -> bool {
    state.position.iter().chain(&state.velocity).all(|v| v.iter().all(|c| c[lane].is_finite()))
}
