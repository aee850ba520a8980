//! One time step of a strand system: MS08 §4's nine steps in order, with one implicit solve or two.
//!
//! [`Scheme`] says how velocities are integrated; strain limiting, contact and roots are the same for all. A step is cut
//! into substeps. Strands that do not interact never wait for each other: each batch takes all its substeps while it is in
//! cache. Batches run in parallel and the result is the same for any number of threads.

mod finer;
pub mod interacting;
mod rubbing;

use crate::bearing::Bearings;
use crate::body_contact::{Contact, ContactParams, Reaction};
use crate::drive::{Drive, RootMotion};
use crate::forces::Implicit;
use crate::implicit::{self, Driven, Problem};
use crate::lanes::{LANES, Lane, Lane3, ZERO};
use crate::rig::Topology;
use crate::solve::banded::BandedMatrix;
use crate::step::finer::Finer;
use crate::step_size::{Substeps, count_substeps};
use crate::strain_limit::limit_strain;
use crate::surface_contact::SurfaceWork;
use crate::system::{Batch, BatchState, StrandState, StrandSystem, get, set, transform};
use crate::watch::View;
use crate::wind::WindField;
use collision::surface::MovingSurface;
use collision::{MovingBody, MovingDeformingSolid, MovingSolid};
use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;

/// How velocities are integrated over a substep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scheme {
    /// One solve over the substep; its velocity moves the positions. First order.
    BackwardEuler,
    /// MS08 §4: a solve over half the substep for the positions, another for the velocity by the trapezoidal rule.
    Trapezoidal,
    /// MS08 §4 with both solves over the whole substep, by backward Euler.
    TwoSolves,
}

impl Scheme {
    /// Whether the velocity is solved for again once positions are known.
    fn is_two_solves(self) -> bool {
        matches!(self, Self::Trapezoidal | Self::TwoSolves)
    }

    /// Length of each solve in a substep of `h` seconds.
    fn solve_length(self, h: f64) -> f64 {
        if self == Self::Trapezoidal { 0.5 * h } else { h }
    }
}

/// How a step is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepParams {
    /// Integration within a substep.
    pub scheme: Scheme,
    /// How a step is cut.
    pub substeps: Substeps,
    /// Linear solves per substep, each with directions refrozen where the one before led; at least one.
    pub iterations: usize,
    /// Whether springs resist turning implicitly: max(T, 0)/l (I - ddᵀ) beyond MS08's frozen directions.
    pub geometric_stiffness: bool,
    /// Acceleration of gravity, cm/s².
    pub gravity: Vector3<f64>,
    /// Largest stretch left after a step, as a fraction of a segment's length.
    pub strain_limit: f64,
    /// Contact with solids.
    pub contact: ContactParams,
}

impl StepParams {
    /// The guide step of 10 ms: standard gravity along -y; measured in docs/DEVIATIONS.md against a step of 0.5 ms.
    #[must_use]
    pub fn standard() -> Self {
        Self {
            scheme: Scheme::BackwardEuler,
            substeps: Substeps::Fixed(2),
            iterations: 1,
            geometric_stiffness: false,
            gravity: Vector3::new(0.0, -981.0, 0.0),
            strain_limit: 0.01,
            contact: ContactParams::standard(),
        }
    }

    /// MS08 §4 as printed: directions frozen, strain limited at a tenth, one step a step.
    #[must_use]
    pub fn paper(scheme: Scheme) -> Self {
        Self { scheme, substeps: Substeps::Fixed(1), geometric_stiffness: false, strain_limit: 0.1, ..Self::standard() }
    }
}

/// What drives a step.
#[derive(Clone, Copy, Debug)]
pub struct StepInput<'a> {
    /// Length of the step, s.
    pub dt: f64,
    /// Time at its start, s; read by the wind only.
    pub time_s: f64,
    /// How the roots move over it.
    pub roots: RootMotion<'a>,
    /// Solids with their motion over the step.
    pub solids: &'a [MovingSolid<'a>],
    /// Deforming bodies with their motion over the step.
    pub deforming: &'a [MovingDeformingSolid<'a>],
    /// Surfaces that no segment may go through on its way, with their motion over the step: exact, after contact with the
    /// fields of solids, which takes fast and thin ones for absent. Usually those of some of the solids.
    pub surfaces: &'a [MovingSurface<'a>],
    /// Further forces on the hair's own particles, strand-major, dyn; held over the step. Empty for none.
    pub forces: &'a [Vector3<f64>],
    /// Particles pinned or driven beyond the roots, ordered by strand.
    pub drives: &'a [Drive],
    /// Moving air; still if absent.
    pub wind: Option<&'a dyn WindField>,
}

impl StepInput<'_> {
    /// A step of `dt` seconds over which the head moves from one pose to another and nothing else happens.
    #[must_use]
    pub fn carried(dt: f64, before: Isometry3<f64>, after: Isometry3<f64>) -> Self {
        let roots = RootMotion::Head { before, after };
        Self {
            dt,
            time_s: 0.0,
            roots,
            solids: &[],
            deforming: &[],
            surfaces: &[],
            forces: &[],
            drives: &[],
            wind: None,
        }
    }

    /// A step of `dt` seconds with the head held at a pose.
    #[must_use]
    pub fn still(dt: f64, world_from_head: Isometry3<f64>) -> Self {
        Self::carried(dt, world_from_head, world_from_head)
    }
}

/// What a step met.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StepReport {
    /// Substeps taken.
    pub substeps: u32,
    /// Segment contacts handled, summed over substeps.
    pub contacts: u64,
    /// Touches of surfaces answered, summed over substeps.
    pub touches: u32,
    /// Strands that took a substep in smaller pieces since no straight way past a surface was found, summed over substeps.
    pub refined: u32,
    /// Segments left going through a surface all the same, summed over substeps.
    pub passing: u32,
    /// Strands whose state was not finite and was put back at rest.
    pub quarantined: u32,
}

/// Buffers of a step, reused from step to step.
#[derive(Debug, Default)]
pub struct StepWorkspace {
    slots: Vec<Work>,
}

/// Buffers of one worker.
#[derive(Debug)]
pub(crate) struct Work {
    pub(crate) matrix: BandedMatrix,
    /// Unknowns of the solve, three lanes a free particle.
    pub(crate) velocity: Vec<Lane>,
    /// Positions that elastic forces are taken at, per rig particle.
    start: Vec<Lane3>,
    /// Where the solve leads, per rig particle.
    pub(crate) next: Vec<Lane3>,
    pub(crate) next_velocity: Vec<Lane3>,
    air: Vec<Lane3>,
    /// Contacts with solids that strands close in on: part of the solve.
    pub(crate) contacts: Vec<Contact>,
    /// The others, watched in case the step ends in the solid all the same.
    pub(crate) watched: Vec<Contact>,
    pub(crate) driven: Vec<Driven>,
    pub(crate) surface: SurfaceWork,
    /// For strands that go a substep in pieces.
    finer: Option<Box<Finer>>,
    /// What they exert, in the same order.
    reactions: Vec<Reaction>,
    pub(crate) view: View,
    report: StepReport,
}

/// Upper bound of parallel slices, as a multiple of the thread count: contacts make some batches dearer than others.
const SLICES_PER_THREAD: usize = 8;

/// Part of a step, as fractions of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Span {
    pub begin: f64,
    pub end: f64,
    /// Its length, s.
    pub h: f64,
}

impl StrandSystem {
    /// Advances `state` by one step.
    ///
    /// # Panics
    /// If `state` is not one of this system, or a buffer of `input` has another length than documented.
    pub fn step(
        &self,
        state: &mut StrandState,
        input: &StepInput,
        params: &StepParams,
        workspace: &mut StepWorkspace,
    ) -> StepReport {
        self.check_input(state, input);
        if self.batches.is_empty() {
            return StepReport::default();
        }
        let n_substeps = count_substeps(self, state, input.dt, params.substeps);
        let n_slices = self.batches.len().min(SLICES_PER_THREAD * rayon::current_num_threads());
        let slice = self.batches.len().div_ceil(n_slices);
        while workspace.slots.len() < n_slices {
            workspace.slots.push(Work::new(self));
        }
        self.batches
            .par_chunks(slice)
            .zip(state.batches.par_chunks_mut(slice))
            .zip(workspace.slots.par_iter_mut())
            .for_each(|((batches, states), work)| {
                work.report = StepReport::default();
                for (batch, state) in batches.iter().zip(states) {
                    self.sample_air(batch, state, input, work);
                    for k in 0..n_substeps {
                        let n = n_substeps as f64;
                        let span = Span { begin: k as f64 / n, end: (k + 1) as f64 / n, h: input.dt / n };
                        self.set_out(batch, state, input, params, span, work);
                        self.hold_off(batch, state, input, params, span, work);
                        self.arrive(batch, state, input, params, span, work);
                    }
                    self.quarantine(batch, state, input, work);
                }
            });
        let n_used = self.batches.len().div_ceil(slice);
        let sum = StepReport { substeps: n_substeps as u32, ..StepReport::default() };
        workspace.slots[..n_used].iter().fold(sum, |sum, work| StepReport {
            contacts: sum.contacts + work.report.contacts,
            touches: sum.touches + work.report.touches,
            refined: sum.refined + work.report.refined,
            passing: sum.passing + work.report.passing,
            quarantined: sum.quarantined + work.report.quarantined,
            ..sum
        })
    }

    /// A substep up to new positions in `work.next` that no surface has been asked about.
    fn set_out(
        &self,
        batch: &Batch,
        state: &mut BatchState,
        input: &StepInput,
        params: &StepParams,
        span: Span,
        work: &mut Work,
    ) {
        self.predict(batch, state, input, params, span, work);
        self.rub(batch, params.scheme.solve_length(span.h), work);
        self.advance(batch, state, params, span, work);
    }

    /// The rest of a substep.
    fn arrive(
        &self,
        batch: &Batch,
        state: &mut BatchState,
        input: &StepInput,
        params: &StepParams,
        span: Span,
        work: &mut Work,
    ) {
        if params.scheme.is_two_solves() {
            self.evolve(batch, state, input, params, span, work);
            self.rub(batch, params.scheme.solve_length(span.h), work);
        }
        self.finish(batch, state, input, params, span, work);
    }

    fn check_input(&self, state: &StrandState, input: &StepInput) {
        assert_eq!(state.batches.len(), self.batches.len(), "state of another system");
        assert!(
            input.forces.is_empty() || input.forces.len() == self.n_strands * self.n_main,
            "one force per particle"
        );
        input.roots.check(self.n_strands);
        assert!(input.drives.is_sorted_by_key(|d| d.strand), "drives ordered by strand");
    }

    /// MS08 §4 step 1: the velocities that move the positions, into `work.next_velocity`.
    fn predict(
        &self,
        batch: &Batch,
        state: &mut BatchState,
        input: &StepInput,
        params: &StepParams,
        span: Span,
        work: &mut Work,
    ) {
        let topology = &self.topologies[batch.topology];
        let n_rig = topology.n_rig;
        self.drive_particles(batch, state, input, span, work);
        work.contacts.clear();
        work.watched.clear();
        self.find_contacts(batch, state, input, params, span, work);
        work.report.contacts += work.contacts.len() as u64;
        work.start[..n_rig].copy_from_slice(&state.position);
        let h = params.scheme.solve_length(span.h);
        let geometric = f64::from(u8::from(params.geometric_stiffness));
        let elastic = Implicit { elastic: 1.0, geometric, least_tension: 0.0 };
        for iteration in 0..params.iterations.max(1) {
            self.solve(batch, state, input, params, elastic, h, iteration > 0, work);
            if iteration + 1 < params.iterations {
                work.move_on(n_rig, h);
            }
        }
        if work.let_go(&mut state.bearings, h) && params.contact.solve_torn_again {
            self.solve(batch, state, input, params, elastic, h, params.iterations > 1, work);
        }
    }

    /// Friction with solids on the velocities a solve of `h` seconds has found.
    fn rub(&self, batch: &Batch, h: f64, work: &mut Work) {
        let n_kin = self.topologies[batch.topology].n_kinematic;
        work.reactions.clear();
        work.reactions.extend(work.contacts.iter().map(|contact| contact.reaction(h, &work.next_velocity)));
        for (contact, reaction) in work.contacts.iter().zip(&work.reactions) {
            contact.slow(reaction, n_kin, h, &batch.mass, &mut work.next_velocity);
        }
    }

    /// MS08 §4 steps 2, 4 and 5: new positions, into `work.next`, their stretch limited and outside the solids.
    fn advance(&self, batch: &Batch, state: &BatchState, params: &StepParams, span: Span, work: &mut Work) {
        let topology = &self.topologies[batch.topology];
        // Of the trapezoidal rule, the velocity halfway moves the whole step.
        work.move_on(topology.n_rig, span.h);
        limit_strain(topology, batch, &mut work.next, params.strain_limit);
        for contact in work.contacts.iter().chain(&work.watched) {
            let n_kin = topology.n_kinematic;
            contact.push_out(n_kin, span.h, &batch.mass, &state.position, &mut work.next, &mut work.next_velocity);
        }
        for d in &work.driven {
            for c in 0..3 {
                work.next[d.particle][c][d.lane] = state.position[d.particle][c][d.lane] + span.h * d.velocity[c];
            }
        }
    }

    /// The last of step 5: nothing goes through a surface.
    fn hold_off(
        &self,
        batch: &Batch,
        state: &BatchState,
        input: &StepInput,
        params: &StepParams,
        span: Span,
        work: &mut Work,
    ) {
        if !input.surfaces.is_empty() {
            let found = self.stop_at_surfaces(batch, state, input, span, u8::MAX, work);
            work.report.touches += found.answered;
            if found.passing != 0 {
                self.go_finer(batch, state, input, params, span, found.passing, work);
            }
        }
    }

    /// MS08 §4 step 7: the velocity at the end of a solve with positions known, into `work.next_velocity`.
    fn evolve(
        &self,
        batch: &Batch,
        state: &mut BatchState,
        input: &StepInput,
        params: &StepParams,
        span: Span,
        work: &mut Work,
    ) {
        let h = params.scheme.solve_length(span.h);
        let middle = h / span.h;
        for p in 0..self.topologies[batch.topology].n_rig {
            for c in 0..3 {
                for l in 0..LANES {
                    let (old, new) = (state.position[p][c][l], work.next[p][c][l]);
                    work.start[p][c][l] = old + middle * (new - old);
                }
            }
        }
        for contact in &mut work.contacts {
            // Only the normal velocity is constrained here: nothing is left to push out.
            contact.gap = -h * contact.normal.dot(&contact.solid_velocity);
        }
        // Positions are known, so elastic forces are too: taking them implicitly would count them twice.
        let known = Implicit { elastic: 0.0, geometric: 0.0, least_tension: 0.0 };
        self.solve(batch, state, input, params, known, h, false, work);
        if work.let_go(&mut state.bearings, h) && params.contact.solve_torn_again {
            self.solve(batch, state, input, params, known, h, false, work);
        }
    }

    /// MS08 §4 step 8, and the new state takes the old one's place.
    fn finish(
        &self,
        batch: &Batch,
        state: &mut BatchState,
        input: &StepInput,
        params: &StepParams,
        span: Span,
        work: &mut Work,
    ) {
        let topology = &self.topologies[batch.topology];
        let (n_kin, n_rig) = (topology.n_kinematic, topology.n_rig);
        if params.scheme == Scheme::Trapezoidal {
            for p in n_kin..n_rig {
                for c in 0..3 {
                    for l in 0..LANES {
                        work.next_velocity[p][c][l] = 2.0 * work.next_velocity[p][c][l] - state.velocity[p][c][l];
                    }
                }
            }
        }
        account_movement(state, &work.next[..n_rig], input, span.end - span.begin);
        state.position.copy_from_slice(&work.next[..n_rig]);
        state.velocity.copy_from_slice(&work.next_velocity[..n_rig]);
    }

    /// One implicit solve from `work.start`; the result is in `work.next_velocity`. Directions are those of `work.next`
    /// if `refrozen`.
    fn solve(
        &self,
        batch: &Batch,
        state: &BatchState,
        input: &StepInput,
        params: &StepParams,
        implicit: Implicit,
        h: f64,
        refrozen: bool,
        work: &mut Work,
    ) {
        let topology = &self.topologies[batch.topology];
        let (n_kin, n_rig) = (topology.n_kinematic, topology.n_rig);
        let rhs = &mut work.velocity[..3 * (n_rig - n_kin)];
        for p in n_kin..n_rig {
            for c in 0..3 {
                for l in 0..LANES {
                    let start = state.velocity[p][c][l] + h * params.gravity[c];
                    rhs[3 * (p - n_kin) + c][l] = batch.mass[p][l] * start;
                }
            }
        }
        if !input.forces.is_empty() {
            for (lane, &strand) in batch.strands.iter().enumerate() {
                for i in topology.first_free_main()..self.n_main {
                    let force = input.forces[strand as usize * self.n_main + i];
                    for c in 0..3 {
                        rhs[3 * (topology.rig_of_main(i) - n_kin) + c][lane] += h * force[c];
                    }
                }
            }
        }
        let problem = Problem {
            topology,
            batch,
            start: &work.start[..n_rig],
            guess: refrozen.then_some(&work.next[..n_rig]),
            kinematic: &work.next_velocity[..n_kin],
            h,
            implicit,
            drag_per_s: self.material.air_drag_per_s,
            air: &work.air,
            contacts: &work.contacts,
            driven: &work.driven,
        };
        implicit::solve(&problem, &mut work.matrix, rhs);
        for p in n_kin..n_rig {
            for c in 0..3 {
                work.next_velocity[p][c] = rhs[3 * (p - n_kin) + c];
            }
        }
        work.hold_driven();
    }

    /// Velocities of the roots and of driven particles over the substep.
    fn drive_particles(&self, batch: &Batch, state: &BatchState, input: &StepInput, span: Span, work: &mut Work) {
        let topology = &self.topologies[batch.topology];
        let of_strand = |strand: u32| input.roots.at(strand as usize, span.end);
        // One head carries all.
        let common = matches!(input.roots, RootMotion::Head { .. }).then(|| of_strand(batch.strands[0]));
        for lane in 0..LANES {
            let root = common.unwrap_or_else(|| of_strand(batch.strands[lane.min(batch.strands.len() - 1)]));
            for p in 0..topology.n_kinematic {
                let target = transform(&root, get(&batch.rest_in_head[p], lane));
                set(&mut work.next_velocity[p], lane, (target - get(&state.position[p], lane)) / span.h);
            }
        }
        work.driven.clear();
        for (lane, &strand) in batch.strands.iter().enumerate() {
            let first = input.drives.partition_point(|d| d.strand < strand);
            for drive in input.drives[first..].iter().take_while(|d| d.strand == strand) {
                let pose = drive.at(span.end);
                for p in topology.rig_of_main(drive.particles.0)..=topology.rig_of_main(drive.particles.1) {
                    if p >= topology.n_kinematic {
                        let target = transform(&pose, get(&batch.rest_in_head[p], lane));
                        let velocity = (target - get(&state.position[p], lane)) / span.h;
                        work.driven.push(Driven { lane, particle: p, velocity: velocity.into() });
                    }
                }
            }
        }
        work.driven.sort_unstable_by_key(|d| (d.particle, d.lane));
    }

    /// Air velocity at every particle, as of the start of the step.
    fn sample_air(&self, batch: &Batch, state: &BatchState, input: &StepInput, work: &mut Work) {
        work.air.clear();
        let Some(wind) = input.wind else { return };
        for position in &state.position {
            let mut air = [ZERO; 3];
            for lane in 0..batch.strands.len() {
                set(&mut air, lane, wind.velocity(get(position, lane), input.time_s));
            }
            work.air.push(air);
        }
    }

    fn quarantine(&self, batch: &Batch, state: &mut BatchState, input: &StepInput, work: &mut Work) {
        if all_finite(state) {
            return;
        }
        for (lane, &strand) in batch.strands.iter().enumerate() {
            if state.position.iter().chain(&state.velocity).all(|v| v.iter().all(|c| c[lane].is_finite())) {
                continue;
            }
            let root = input.roots.at(strand as usize, 1.0);
            for p in 0..state.position.len() {
                set(&mut state.position[p], lane, transform(&root, get(&batch.rest_in_head[p], lane)));
                set(&mut state.velocity[p], lane, Vector3::zeros());
            }
            for clearance in &mut state.clearance {
                clearance[lane] = -1.0;
            }
            state.bearings.forget(lane);
            work.report.quarantined += 1;
        }
    }
}

impl Work {
    /// Room for any batch of a system.
    pub(crate) fn new(system: &StrandSystem) -> Self {
        let n_rig = system.topologies.iter().map(|t| t.n_rig).max().unwrap_or(0);
        let reach = system.topologies.iter().map(|t| t.reach).max().unwrap_or(0);
        Self::of_size(n_rig, reach, system.n_main)
    }

    /// Room for the batches of one topology.
    fn of_topology(topology: &Topology) -> Self {
        Self::of_size(topology.n_rig, topology.reach, topology.n_main)
    }

    fn of_size(n_rig: usize, reach: usize, n_main: usize) -> Self {
        Self {
            matrix: BandedMatrix::new(n_rig, reach),
            velocity: vec![ZERO; 3 * n_rig],
            start: vec![[ZERO; 3]; n_rig],
            next: vec![[ZERO; 3]; n_rig],
            next_velocity: vec![[ZERO; 3]; n_rig],
            air: Vec::new(),
            contacts: Vec::with_capacity(LANES * n_main),
            watched: Vec::with_capacity(LANES * n_main),
            reactions: Vec::with_capacity(LANES * n_main),
            driven: Vec::new(),
            surface: SurfaceWork::default(),
            finer: None,
            view: View::default(),
            report: StepReport::default(),
        }
    }

    /// Driven particles have exactly the velocity they are given.
    fn hold_driven(&mut self) {
        for d in &self.driven {
            for c in 0..3 {
                self.next_velocity[d.particle][c][d.lane] = d.velocity[c];
            }
        }
    }

    /// `next = start + h next_velocity`.
    fn move_on(&mut self, n_rig: usize, h: f64) {
        for p in 0..n_rig {
            for c in 0..3 {
                for l in 0..LANES {
                    self.next[p][c][l] = self.start[p][c][l] + h * self.next_velocity[p][c][l];
                }
            }
        }
    }

    /// Remembers what a solve of `h` seconds has found of the contacts; returns whether to solve again, since some are torn
    /// from where they stuck. The strands that are so let go of what they would pull at, too.
    fn let_go(&mut self, bearings: &mut Bearings, h: f64) -> bool {
        let Self { contacts, watched, reactions, next_velocity, .. } = self;
        reactions.clear();
        reactions.extend(contacts.iter().map(|contact| contact.reaction(h, next_velocity)));
        let mut torn = 0_u8;
        for (contact, reaction) in contacts.iter_mut().zip(reactions.iter()) {
            torn |= u8::from(bearings.learn(contact, reaction)) << contact.lane;
        }
        if torn == 0 {
            return false;
        }
        let mut reaction = reactions.iter();
        contacts.retain(|contact| {
            let is_pulled = reaction.next().is_some_and(|r| contact.is_pulled(r));
            let leaves = is_pulled && torn >> contact.lane & 1 != 0;
            if leaves {
                watched.push(*contact);
            }
            !leaves
        });
        true
    }

    /// Orders contacts as the solve takes them.
    pub(crate) fn sort_contacts(&mut self) {
        self.contacts.sort_unstable_by(|a, b| {
            (a.ends[1], a.lane).cmp(&(b.ends[1], b.lane)).then_with(|| a.gap.total_cmp(&b.gap))
        });
    }

    /// Velocities of the particles whose motion is given.
    pub(crate) fn known_velocity(&self, particle: usize, lane: usize) -> Vector3<f64> {
        get(&self.next_velocity[particle], lane)
    }
}

/// Lowers every distance bound by what strand and solid move on the way to `next`.
fn account_movement(state: &mut BatchState, next: &[Lane3], input: &StepInput, fraction: f64) {
    if state.clearance.is_empty() {
        return;
    }
    let mut moved = ZERO;
    for (new, old) in next.iter().zip(&state.position) {
        for l in 0..LANES {
            let d = (new[0][l] - old[0][l]).powi(2) + (new[1][l] - old[1][l]).powi(2) + (new[2][l] - old[2][l]).powi(2);
            moved[l] = moved[l].max(d);
        }
    }
    for (clearance, moving) in state.clearance.iter_mut().zip(input.deforming) {
        let by_solid = fraction * moving.max_displacement();
        for l in 0..LANES {
            clearance[l] -= moved[l].sqrt() + by_solid;
        }
    }
}

/// Whether every lane of a batch is finite: a sum is finite only if all its terms are.
fn all_finite(state: &BatchState) -> bool {
    let mut sum = ZERO;
    for v in state.position.iter().chain(&state.velocity) {
        for c in v {
            for l in 0..LANES {
                sum[l] += 0.0 * c[l];
            }
        }
    }
    sum.iter().all(|s| s.is_finite())
}
