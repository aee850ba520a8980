//! The step of strands that meet each other: MS08 §4's nine steps with stiction, self repulsion and self collisions.
//!
//! The order is that of the plain step; between its stages all strands are looked at together. Stiction springs couple the
//! implicit solves: each strand is solved on its own first, and conjugate gradients with the strands' factors as
//! preconditioner find what the links change. Positions and velocities of the hair's own particles travel through flat
//! arrays; perturbed particles follow the two they stand between.

use super::rubbing::RubbingWork;
use super::{Span, StepInput, StepParams, StepReport, StepWorkspace, Work};
use crate::drive::RootMotion;
use crate::error::Error;
use crate::implicit;
use crate::interaction::{
    CollideParams, CollisionReport, CollisionWorkspace, ContactSampling, LinkReport, LinkSet, LinkSpring, NearPairs,
    RepulsionParams, RepulsionReport, StictionParams, StictionWorkspace, Strands, collide, passes, repel,
};
use crate::lanes::LANES;
use crate::solve::coupled::{CoupledParams, CoupledWorkspace, NO_UNKNOWN, RankOne, solve_coupled};
use crate::step_size::count_substeps;
use crate::system::{Batch, BatchState, StrandState, StrandSystem, get, set};
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// How hairs meet each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InteractionParams {
    /// Sticking.
    pub stiction: StictionParams,
    /// Keeping apart.
    pub repulsion: RepulsionParams,
    /// Which contacts are looked at, once a step; `None` looks at every one in every substep. Sticking and
    /// collisions need that.
    pub sampling: Option<ContactSampling>,
    /// Not passing through; `None` leaves crossings as they are.
    pub collision: Option<CollideParams>,
    /// When the coupled solve stops.
    pub coupled: CoupledParams,
}

impl InteractionParams {
    /// Dry, loose hair; the coupled solve stops at a thousandth, far below what link constants are known to.
    #[must_use]
    pub fn dry() -> Self {
        Self {
            stiction: StictionParams::dry(),
            repulsion: RepulsionParams::standard(),
            sampling: None,
            collision: Some(CollideParams::standard()),
            coupled: CoupledParams { relative_tolerance: 1e-3, max_iterations: 50 },
        }
    }

    /// Hairs of a thickness (cm) that press and rub on each other, but neither stick nor are followed through crossings:
    /// the friction of AS16 §7.1, which asks for no coupled solve. Every contact in every substep.
    #[must_use]
    pub fn rubbing(thickness_cm: f64) -> Self {
        let repulsion = RepulsionParams { thickness_cm, ..RepulsionParams::standard() };
        Self { stiction: StictionParams::off(), repulsion, collision: None, ..Self::dry() }
    }

    /// As [`Self::rubbing`] at a cost that grows with the number of hairs alone: contacts are found by sampling.
    #[must_use]
    pub fn rubbing_sampled(thickness_cm: f64) -> Self {
        Self { sampling: Some(ContactSampling::standard()), ..Self::rubbing(thickness_cm) }
    }

    /// Checks every constant.
    ///
    /// # Errors
    /// [`Error::BadInteraction`] naming the first constant out of range.
    pub fn validate(&self) -> Result<(), Error> {
        self.stiction.validate()?;
        self.repulsion.validate()?;
        if let Some(sampling) = &self.sampling {
            sampling.validate()?;
            let links = if self.collision.is_none() { self.stiction.max_links } else { usize::MAX };
            if links > 0 {
                let expected = "zero, and no collisions, where contacts are sampled";
                return Err(Error::BadInteraction { name: "max_links", value: links as f64, expected });
            }
        }
        self.collision.map_or(Ok(()), |c| c.validate())
    }
}

impl InteractionParams {
    /// How contacts are sampled: where hair sticks or must not cross, not at all.
    fn sampling(&self) -> Option<&ContactSampling> {
        self.sampling.as_ref().filter(|_| self.stiction.max_links == 0 && self.collision.is_none())
    }
}

/// What interacting hair did over a step; counts are of the last substep but for sums named as such.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct InteractionReport {
    /// Strands and solids.
    pub step: StepReport,
    /// Links made, broken and held.
    pub links: LinkReport,
    /// Pairs kept apart.
    pub repulsion: RepulsionReport,
    /// Pairs stopped from crossing; `unresolved` is summed over the substeps.
    pub collision: CollisionReport,
    /// Preconditioner solves, summed over the substeps.
    pub coupled_iterations: usize,
    /// Time in the strands' own solves, contact with solids included.
    pub integrate: Duration,
    /// Time in the search for near pairs, repulsion and collisions.
    pub collide: Duration,
    /// Time in making links and in the coupled solve.
    pub stick: Duration,
}

/// Buffers of an interacting step, kept from step to step.
#[derive(Debug, Default)]
pub struct InteractionWorkspace {
    works: Vec<Work>,
    near: NearPairs,
    near_after: NearPairs,
    /// Where contacts are sampled, all that is used.
    rubbing: RubbingWork,
    plain: StepWorkspace,
    stiction: StictionWorkspace,
    collision: CollisionWorkspace,
    coupled: CoupledWorkspace,
    springs: Vec<LinkSpring>,
    links: Vec<RankOne>,
    /// Right side and solution of the coupled solve, batch by batch, particle by particle, a lane at a time.
    pulled: Vec<Vector3<f64>>,
    change: Vec<Vector3<f64>>,
    /// First unknown of each batch.
    first_unknown: Vec<usize>,
    inv_mass: Vec<f64>,
    position: Vec<Vector3<f64>>,
    next: Vec<Vector3<f64>>,
    velocity: Vec<Vector3<f64>>,
    before: Vec<Vector3<f64>>,
    /// Velocities as seen from the head, before and after collisions.
    seen: Vec<Vector3<f64>>,
    seen_before: Vec<Vector3<f64>>,
}

impl StrandSystem {
    /// Advances `state` by one step of strands that meet each other; `links` belongs to the state.
    ///
    /// # Panics
    /// As [`StrandSystem::step`].
    pub fn step_interacting(
        &self,
        state: &mut StrandState,
        links: &mut LinkSet,
        input: &StepInput,
        params: &StepParams,
        interaction: &InteractionParams,
        workspace: &mut InteractionWorkspace,
    ) -> InteractionReport {
        self.check_input(state, input);
        let mut report = InteractionReport::default();
        if self.batches.is_empty() {
            return report;
        }
        if let Some(sampling) = interaction.sampling() {
            let (w, thickness_cm) = (&mut workspace.rubbing, interaction.repulsion.thickness_cm);
            timed(&mut report.collide, || self.look_for_contacts(state, sampling, thickness_cm, input, w));
            timed(&mut report.integrate, || report.step = self.step(state, input, params, &mut workspace.plain));
            timed(&mut report.collide, || {
                report.repulsion = self.rub_after(state, input, &interaction.repulsion, report.step.quarantined > 0, w);
            });
            return report;
        }
        workspace.prepare(self);
        self.free_inverse_masses(input, &mut workspace.inv_mass);
        let n_substeps = count_substeps(self, state, input.dt, params.substeps);
        report.step.substeps = n_substeps as u32;
        self.each_batch(state, &mut workspace.works, |batch, state, work| {
            work.report = StepReport::default();
            self.sample_air(batch, state, input, work);
        });
        for k in 0..n_substeps {
            let n = n_substeps as f64;
            let span = Span { begin: k as f64 / n, end: (k + 1) as f64 / n, h: input.dt / n };
            self.substep_interacting(state, links, input, params, interaction, span, workspace, &mut report);
        }
        self.each_batch(state, &mut workspace.works, |batch, state, work| self.quarantine(batch, state, input, work));
        for work in &workspace.works {
            report.step.contacts += work.report.contacts;
            report.step.quarantined += work.report.quarantined;
            report.step.touches += work.report.touches;
            report.step.refined += work.report.refined;
            report.step.passing += work.report.passing;
        }
        report
    }

    fn substep_interacting(
        &self,
        state: &mut StrandState,
        links: &mut LinkSet,
        input: &StepInput,
        params: &StepParams,
        interaction: &InteractionParams,
        span: Span,
        w: &mut InteractionWorkspace,
        report: &mut InteractionReport,
    ) {
        let h = params.scheme.solve_length(span.h);
        // Step 1: every strand's own solve, then what the links change.
        timed(&mut report.integrate, || {
            self.each_batch(state, &mut w.works, |batch, state, work| {
                self.predict(batch, state, input, params, span, work);
            });
        });
        timed(&mut report.collide, || {
            self.gather(&mut w.position, |b, p, lane| get(&state.batches[b].position[p], lane));
            let strands = Strands::new(self.n_main, &w.position, &w.inv_mass);
            report.links.broken = links.release(&strands, &interaction.stiction);
            let thickness_cm = interaction.repulsion.thickness_cm;
            w.near.find_to_link(&strands, links, &interaction.stiction, thickness_cm);
        });
        timed(&mut report.stick, || {
            let strands = Strands::new(self.n_main, &w.position, &w.inv_mass);
            let made = links.renew(&strands, w.near.pairs(), &interaction.stiction, &mut w.stiction);
            report.links = LinkReport { broken: report.links.broken, ..made };
            links.springs(&strands, &interaction.stiction, &mut w.springs);
            report.coupled_iterations += self.couple(&interaction.coupled, h, 1.0, w);
        });
        timed(&mut report.integrate, || {
            self.each_batch(state, &mut w.works, |batch, state, work| {
                self.rub(batch, h, work);
                self.advance(batch, state, params, span, work);
            });
        });
        // Steps 3, 4 and 6: the velocity that moves positions is made to keep hairs apart, then positions not to cross.
        timed(&mut report.collide, || {
            let two = params.scheme.is_two_solves();
            self.gather(&mut w.next, |b, p, lane| get(&w.works[b].next[p], lane));
            w.velocity.clear();
            w.velocity.extend(w.next.iter().zip(&w.position).map(|(b, a)| (b - a) / span.h));
            w.before.clone_from(&w.velocity);
            let strands = Strands::new(self.n_main, &w.position, &w.inv_mass);
            report.repulsion = repel(&strands, w.near.pairs(), links, &interaction.repulsion, span.h, &mut w.velocity);
            w.next.clear();
            w.next.extend(w.velocity.iter().zip(&w.position).map(|(v, x)| x + v * span.h));
            // Repulsion in a clump stretches hair again.
            self.limit_flat(params.strain_limit, &w.inv_mass, &mut w.next);
            if let Some(collision) = &interaction.collision {
                if two {
                    // With a second solve only what collisions change reaches the velocity.
                    w.before.clone_from(&w.velocity);
                }
                let unresolved = report.collision.unresolved;
                report.collision = match &input.roots {
                    RootMotion::Head { .. } => {
                        let poses = [input.roots.at(0, span.begin), input.roots.at(0, span.end)];
                        collide_as_seen_from(&poses, self.n_main, links, collision, span.h, w)
                    }
                    RootMotion::Frames { .. } => {
                        let (next, velocity) = (&mut w.next, &mut w.velocity);
                        collide(&strands, next, velocity, links, collision, span.h, &mut w.collision)
                    }
                };
                report.collision.unresolved += unresolved;
            } else if two {
                w.before.clone_from(&w.velocity);
            }
            for (v, before) in w.velocity.iter_mut().zip(&w.before) {
                *v -= before;
            }
            let InteractionWorkspace { works, next, velocity, .. } = w;
            let (next, change) = (&*next, &*velocity);
            self.each_batch(state, works, |batch, state, work| {
                self.scatter(batch, state, work, next, change, two);
                self.hold_off(batch, state, input, params, span, work);
            });
        });
        // Steps 7 to 9.
        if params.scheme.is_two_solves() {
            timed(&mut report.integrate, || {
                self.each_batch(state, &mut w.works, |batch, state, work| {
                    self.evolve(batch, state, input, params, span, work);
                });
            });
            timed(&mut report.stick, || {
                self.gather(&mut w.position, |b, p, lane| get(&w.works[b].start[p], lane));
                let strands = Strands::new(self.n_main, &w.position, &w.inv_mass);
                links.springs(&strands, &interaction.stiction, &mut w.springs);
                report.coupled_iterations += self.couple(&interaction.coupled, h, 0.0, w);
            });
            timed(&mut report.integrate, || {
                self.each_batch(state, &mut w.works, |batch, _, work| self.rub(batch, h, work));
            });
        }
        timed(&mut report.integrate, || {
            self.each_batch(state, &mut w.works, |batch, state, work| {
                self.finish(batch, state, input, params, span, work);
            });
        });
        if params.scheme.is_two_solves() {
            timed(&mut report.collide, || {
                self.gather(&mut w.velocity, |b, p, lane| get(&state.batches[b].velocity[p], lane));
                w.before.clone_from(&w.velocity);
                let reach = interaction.repulsion.thickness_cm;
                let strands = Strands::new(self.n_main, &w.next, &w.inv_mass);
                w.near_after.find(&strands, reach);
                repel(&strands, w.near_after.pairs(), links, &interaction.repulsion, span.h, &mut w.velocity);
                for (v, before) in w.velocity.iter_mut().zip(&w.before) {
                    *v -= before;
                }
                let InteractionWorkspace { works, velocity, .. } = w;
                let change = &*velocity;
                self.each_batch(state, works, |batch, state, _| {
                    self.add_velocity(batch, change, &mut state.velocity);
                });
            });
        }
    }

    /// Solves (A + C) v = b for the velocities that the strands' own solves, A v₀ = b, have found without the links C:
    /// the change v - v₀ has the right side -h Σ T w d - C v₀. Returns the preconditioner solves done.
    fn couple(&self, params: &CoupledParams, h: f64, elastic: f64, w: &mut InteractionWorkspace) -> usize {
        if w.springs.is_empty() {
            return 0;
        }
        let n = self.n_main;
        w.pulled.fill(Vector3::zeros());
        w.links.clear();
        for spring in &w.springs {
            let mut unknowns = [NO_UNKNOWN; 4];
            let mut speed = Vector3::zeros();
            for k in 0..4 {
                let (strand, i) = (spring.particles[k] as usize / n, spring.particles[k] as usize % n);
                let (batch, lane) = self.place[strand];
                let topology = &self.topologies[self.batches[batch as usize].topology];
                let p = topology.rig_of_main(i);
                speed += get(&w.works[batch as usize].next_velocity[p], lane as usize) * spring.weights[k];
                if p >= topology.n_kinematic {
                    let free = p - topology.n_kinematic;
                    unknowns[k] = (w.first_unknown[batch as usize] + free * LANES + lane as usize) as u32;
                }
            }
            let coefficient = h * (elastic * h * spring.stiffness_per_cm + spring.damping);
            let pull = h * spring.tension + coefficient * spring.direction.dot(&speed);
            for k in (0..4).filter(|&k| unknowns[k] != NO_UNKNOWN) {
                w.pulled[unknowns[k] as usize] -= spring.direction * (pull * spring.weights[k]);
            }
            w.links.push(RankOne { unknowns, weights: spring.weights, direction: spring.direction, coefficient });
        }
        w.change.fill(Vector3::zeros());
        let InteractionWorkspace { works, links, pulled, change, coupled, first_unknown, .. } = w;
        let precondition = |r: &[Vector3<f64>], z: &mut [Vector3<f64>]| {
            split(z, first_unknown).zip(works.par_iter_mut()).zip(first_unknown.par_iter()).for_each(
                |((z, work), &first)| {
                    let n_free = z.len() / LANES;
                    for p in 0..n_free {
                        for l in 0..LANES {
                            let from = r[first + p * LANES + l];
                            for c in 0..3 {
                                work.velocity[3 * p + c][l] = from[c];
                            }
                        }
                    }
                    implicit::solve_again(&work.matrix, &mut work.velocity[..3 * n_free]);
                    for p in 0..n_free {
                        for l in 0..LANES {
                            z[p * LANES + l] = Vector3::from_fn(|c, _| work.velocity[3 * p + c][l]);
                        }
                    }
                },
            );
        };
        let report = solve_coupled(links, pulled, change, precondition, params, coupled);
        self.batches.par_iter().zip(works.par_iter_mut()).zip(first_unknown.par_iter()).for_each(
            |((batch, work), &first)| {
                let topology = &self.topologies[batch.topology];
                for p in topology.n_kinematic..topology.n_rig {
                    for lane in 0..batch.strands.len() {
                        let change = change[first + (p - topology.n_kinematic) * LANES + lane];
                        let v = get(&work.next_velocity[p], lane) + change;
                        set(&mut work.next_velocity[p], lane, v);
                    }
                }
                work.hold_driven();
            },
        );
        report.iterations
    }

    /// Unlinked pairs of segments that cross on the straight way from one state to another, for reports.
    #[must_use]
    pub fn count_passes(
        &self,
        from: &[Vector3<f64>],
        to: &[Vector3<f64>],
        links: &LinkSet,
        workspace: &mut CollisionWorkspace,
    ) -> usize {
        let mut inv_mass = Vec::new();
        self.inverse_masses(&mut inv_mass);
        passes(
            &Strands::new(self.n_main, from, &inv_mass),
            to,
            links,
            CollideParams::standard().tolerance_cm,
            workspace,
        )
    }

    /// Reciprocal masses of the hair's own particles, strand-major, 1/g; zero for those that move with the scalp.
    pub fn inverse_masses(&self, out: &mut Vec<f64>) {
        out.clear();
        out.resize(self.n_strands * self.n_main, 0.0);
        for batch in &self.batches {
            let topology = &self.topologies[batch.topology];
            for (lane, &strand) in batch.strands.iter().enumerate() {
                for i in topology.first_free_main()..self.n_main {
                    out[strand as usize * self.n_main + i] = 1.0 / batch.mass[topology.rig_of_main(i)][lane];
                }
            }
        }
    }

    /// As [`Self::inverse_masses`] over a step: particles driven in it are moved by nothing else either.
    pub(super) fn free_inverse_masses(&self, input: &StepInput, out: &mut Vec<f64>) {
        self.inverse_masses(out);
        for drive in input.drives {
            let strand = &mut out[drive.strand as usize * self.n_main..][..self.n_main];
            strand[drive.particles.0..=drive.particles.1].fill(0.0);
        }
    }

    /// Strain limiting (MS08 §4.2) of the hair's own particles, strand-major.
    fn limit_flat(&self, limit: f64, inv_mass: &[f64], position: &mut [Vector3<f64>]) {
        let strands = position.par_chunks_mut(self.n_main).zip(inv_mass.par_chunks(self.n_main));
        strands.enumerate().for_each(|(strand, (x, inv_mass))| {
            let (batch, lane) = self.place[strand];
            let length = &self.batches[batch as usize].segment_length;
            for i in (1..self.n_main).filter(|&i| inv_mass[i] > 0.0) {
                let (e, longest) = (x[i] - x[i - 1], (1.0 + limit) * length[i - 1][lane as usize]);
                if e.norm() > longest {
                    x[i] = x[i - 1] + e * (longest / e.norm());
                }
            }
        });
    }

    fn each_batch(
        &self,
        state: &mut StrandState,
        works: &mut [Work],
        run: impl Fn(&Batch, &mut BatchState, &mut Work) + Sync,
    ) {
        let states = self.batches.par_iter().zip(state.batches.par_iter_mut());
        states.zip(works.par_iter_mut()).for_each(|((batch, state), work)| run(batch, state, work));
    }

    /// One vector of every particle of the hair's own, strand-major, from its batch, place in the rig and lane.
    pub(super) fn gather(
        &self,
        out: &mut Vec<Vector3<f64>>,
        read: impl Fn(usize, usize, usize) -> Vector3<f64> + Sync,
    ) {
        out.resize(self.n_strands * self.n_main, Vector3::zeros());
        out.par_chunks_mut(self.n_main).enumerate().for_each(|(strand, out)| {
            let (batch, lane) = self.place[strand];
            let topology = &self.topologies[self.batches[batch as usize].topology];
            for (i, out) in out.iter_mut().enumerate() {
                *out = read(batch as usize, topology.rig_of_main(i), lane as usize);
            }
        });
    }

    /// Puts positions that other hairs have changed back, and their change of velocity on the velocity that goes on:
    /// the one just solved for, or the old one if it is yet to be evolved.
    fn scatter(
        &self,
        batch: &Batch,
        state: &mut BatchState,
        work: &mut Work,
        next: &[Vector3<f64>],
        change: &[Vector3<f64>],
        is_two_solves: bool,
    ) {
        let topology = &self.topologies[batch.topology];
        for (lane, &strand) in batch.strands.iter().enumerate() {
            let next = &next[strand as usize * self.n_main..][..self.n_main];
            let mut moved_before = Vector3::zeros();
            for (i, x) in next.iter().enumerate() {
                let p = topology.rig_of_main(i);
                let moved = x - get(&work.next[p], lane);
                set(&mut work.next[p], lane, *x);
                if let Some(q) = i.checked_sub(1).and_then(|j| topology.rig_of_perturbed(j))
                    && q >= topology.n_kinematic
                {
                    let beside = get(&work.next[q], lane) + (moved_before + moved) * 0.5;
                    set(&mut work.next[q], lane, beside);
                }
                moved_before = moved;
            }
        }
        self.add_velocity(batch, change, if is_two_solves { &mut state.velocity } else { &mut work.next_velocity });
    }

    /// Adds a change of velocity; perturbed particles get that of the middle of their segment.
    pub(super) fn add_velocity(&self, batch: &Batch, change: &[Vector3<f64>], velocity: &mut [crate::lanes::Lane3]) {
        let topology = &self.topologies[batch.topology];
        for (lane, &strand) in batch.strands.iter().enumerate() {
            let change = &change[strand as usize * self.n_main..][..self.n_main];
            for i in topology.first_free_main()..self.n_main {
                let p = topology.rig_of_main(i);
                let v = get(&velocity[p], lane) + change[i];
                set(&mut velocity[p], lane, v);
                if let Some(q) = topology.rig_of_perturbed(i - 1).filter(|&q| q >= topology.n_kinematic) {
                    let v = get(&velocity[q], lane) + (change[i - 1] + change[i]) * 0.5;
                    set(&mut velocity[q], lane, v);
                }
            }
        }
    }
}

impl InteractionWorkspace {
    fn prepare(&mut self, system: &StrandSystem) {
        if self.works.len() == system.batches.len() {
            return;
        }
        self.works = system.batches.iter().map(|b| Work::of_topology(&system.topologies[b.topology])).collect();
        self.first_unknown.clear();
        let mut sum = 0;
        for batch in &system.batches {
            let topology = &system.topologies[batch.topology];
            self.first_unknown.push(sum);
            sum += LANES * (topology.n_rig - topology.n_kinematic);
        }
        self.pulled.resize(sum, Vector3::zeros());
        self.change.resize(sum, Vector3::zeros());
    }
}

/// Collisions with the head's motion taken out: hair moves little then, and fewer pairs need to be looked at.
fn collide_as_seen_from(
    [before, after]: &[Isometry3<f64>; 2],
    n_main: usize,
    links: &LinkSet,
    params: &CollideParams,
    h: f64,
    w: &mut InteractionWorkspace,
) -> CollisionReport {
    let carry = |by: &Isometry3<f64>, points: &mut [Vector3<f64>]| {
        points.par_iter_mut().for_each(|x| *x = by.transform_point(&Point3::from(*x)).coords);
    };
    carry(&before.inverse(), &mut w.position);
    carry(&after.inverse(), &mut w.next);
    w.seen.clear();
    w.seen.extend(w.next.iter().zip(&w.position).map(|(b, a)| (b - a) / h));
    w.seen_before.clone_from(&w.seen);
    let strands = Strands::new(n_main, &w.position, &w.inv_mass);
    let report = collide(&strands, &mut w.next, &mut w.seen, links, params, h, &mut w.collision);
    carry(after, &mut w.next);
    for (v, (now, then)) in w.velocity.iter_mut().zip(w.seen.iter().zip(&w.seen_before)) {
        *v += after.rotation * (now - then);
    }
    report
}

/// A vector of unknowns cut at the first one of each batch.
fn split<'a>(
    vector: &'a mut [Vector3<f64>],
    first_unknown: &[usize],
) -> impl IndexedParallelIterator<Item = &'a mut [Vector3<f64>]> {
    let mut pieces = Vec::with_capacity(first_unknown.len());
    let (mut rest, mut at) = (vector, 0);
    for &end in first_unknown.iter().skip(1) {
        let (piece, after) = rest.split_at_mut(end - at);
        pieces.push(piece);
        (rest, at) = (after, end);
    }
    pieces.push(rest);
    pieces.into_par_iter()
}

fn timed<T>(sum: &mut Duration, run: impl FnOnce() -> T) -> T {
    let clock = Instant::now();
    let out = run();
    *sum += clock.elapsed();
    out
}
