//! One interactive step: the only place that knows the order of the stages.

use crate::assign::decode;
use crate::correct::{Hold, MAX_SOLIDS, Members, Outcome, Skins, Surroundings, Travel, Work, correct};
use crate::graph::EdgeRule;
use crate::params::{CliqueRule, Correction, MAX_STEPS_PER_MEETING};
use crate::response::{Elasticity, Response};
use crate::runtime::{Responses, Runtime, Worker};
use crate::solid_in_head::SolidInHead;
use crate::strands::{GROUP, Wake};
use crate::timings::{StageTimings, timed};
use crate::two_way::{ContactPoint, Round};
use arrayvec::ArrayVec;
use collision::{MovingDeformingSolid, MovingSolid, Solid, SolidPose};
use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;
use std::cell::RefCell;

/// Groups of strands that one worker's part holds.
const GROUPS_PER_PART: usize = 16;

thread_local! {
    /// Buffers of a thread: larger than what they are used on, so not one for each part.
    static WORK: RefCell<Work> = RefCell::new(Work::default());
}

/// Strands of a part.
pub(crate) const PART: usize = GROUPS_PER_PART * GROUP;

/// Times whose ratio is as near to one are the same.
const SAME_TIME: f64 = 1e-9;

/// The largest power of two that is neither more than `share` nor than `most`; at least one.
fn steps_within(share: f32, most: usize) -> usize {
    let mut steps = 1;
    while 2 * steps <= most && share >= 2.0 * steps as f32 {
        steps *= 2;
    }
    steps
}

/// What drives a step.
#[derive(Clone, Copy, Debug)]
pub struct StepInput<'a> {
    /// Length of the step, s.
    pub dt: f64,
    /// Head pose at its end.
    pub world_from_head: Isometry3<f64>,
    /// Pose of each solid at its end, in the order the runtime was built with.
    pub world_from_solids: &'a [Isometry3<f64>],
}

/// What a step met.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepReport {
    /// Time by stage.
    pub timings: StageTimings,
    /// Segment contacts of guides.
    pub guide_contacts: u64,
    /// Strands looked at one by one for contact.
    pub corrected_strands: u32,
    /// Strands pushed by a solid.
    pub strands_in_contact: u32,
    /// Deepest that a strand is left in a solid where it was looked at, cm; zero for none.
    pub deepest_cm: f32,
    /// Guides pushed by normal hairs.
    pub guides_pushed: u32,
    /// Hairs that changed their guide set.
    pub set_changes: u32,
    /// Share of guide pairs connected.
    pub connectivity: f64,
    /// Strands put back because their state was not finite.
    pub quarantined: u32,
}

impl Runtime {
    /// Advances the hair by one step. Positions stay as last read until [`Runtime::read`].
    ///
    /// # Panics
    /// If the number of poses is not that of the solids.
    pub fn step(&mut self, input: &StepInput) -> StepReport {
        self.step_among(input, &[])
    }

    /// As [`Self::step`] among bodies that change their shape, which only guides meet.
    ///
    /// # Panics
    /// As [`Self::step`].
    pub fn step_among(&mut self, input: &StepInput, deforming: &[MovingDeformingSolid]) -> StepReport {
        assert_eq!(input.world_from_solids.len(), self.solids.len(), "one pose per solid");
        let mut report = StepReport::default();
        // The solids are lent to the stages while the rest of the runtime is written.
        let solids = std::mem::take(&mut self.solids);
        let head = self.head.take();
        let moving: ArrayVec<MovingSolid, MAX_SOLIDS> = solids
            .iter()
            .enumerate()
            .map(|(k, solid)| MovingSolid {
                solid,
                pose: SolidPose { from: self.world_from_solids[k], to: input.world_from_solids[k] },
            })
            .collect();
        let moving_head = head.as_ref().map(|solid| MovingSolid {
            solid,
            pose: SolidPose { from: self.world_from_head, to: input.world_from_head },
        });
        self.pasts.push(&self.guides.arrays, &self.world_from_head, &self.world_from_solids, self.time);
        let in_head = self.in_head(&solids, input, 1);
        let guide_report = timed(&mut report.timings.guide_sim, || {
            let all: ArrayVec<MovingSolid, { MAX_SOLIDS + 1 }> = moving.iter().copied().chain(moving_head).collect();
            let carried = strand_sim::StepInput::carried(input.dt, self.world_from_head, input.world_from_head);
            // Hair lies on the head all the time: its field is enough.
            let surfaces: ArrayVec<_, MAX_SOLIDS> = moving.iter().filter_map(MovingSolid::surface).collect();
            let (solids, surfaces, forces) = (&all, &surfaces, &self.two_way.forces);
            let step = strand_sim::StepInput { solids, surfaces, deforming, forces, ..carried };
            self.guides.step(&step, &input.world_from_head, &self.params.guides)
        });
        report.guide_contacts = guide_report.contacts;
        report.quarantined += guide_report.quarantined;
        self.world_from_head = input.world_from_head;
        self.time += input.dt;
        let (before, now) = (&self.pasts.back(1).transforms, &self.guides.arrays);
        self.strands.travel(&self.model, before, now, &in_head, &mut self.travelled);

        let every = u64::from(self.params.assign.steps_per_choice);
        let turn = self.step_number % every;
        if self.params.assign.adapt && turn == 0 {
            timed(&mut report.timings.graph, || {
                let rule = EdgeRule {
                    similarity: self.params.assign.similarity,
                    distance: self.params.assign.edge_distance,
                    avoidance: self.params.assign.avoidance,
                    gap_resolution: self.params.gap_resolution,
                    gap_period: self.params.gap_period,
                };
                let offsets = self.strands.offsets_to_leave_by(self.time, &self.params);
                self.assignment.ask(&self.model, &mut self.graph, &self.params.assign, offsets);
                let motion = self.guides.motion(&input.world_from_head, &moving);
                self.graph.update(&self.model, &motion, &moving, rule);
            });
            if self.params.assign.cliques == CliqueRule::Grown {
                timed(&mut report.timings.clusters, || self.clusters.update(&self.graph));
            }
        }
        if self.params.assign.adapt && turn == every / 2 {
            report.set_changes = timed(&mut report.timings.assignment, || self.assign(self.step_number / every));
        }
        report.connectivity = self.graph.connectivity();

        let near =
            !in_head.is_empty() && (self.params.residual.correction != Correction::None || self.params.two_way.enabled);
        if near {
            let mut hair_contact = std::time::Duration::ZERO;
            timed(&mut hair_contact, || self.meet_solids(input, &solids, head.as_ref(), &mut report));
            report.timings.hair_contact = hair_contact;
        }
        report.guides_pushed = timed(&mut report.timings.two_way, || self.push_back(input.dt)) as u32;

        self.world_from_solids.copy_from_slice(input.world_from_solids);
        self.step_number += 1;
        drop((moving, in_head));
        self.solids = solids;
        self.head = head;
        report
    }

    /// Chooses each hair's set, for the `choice`th time; returns how many changed.
    fn assign(&mut self, choice: u64) -> u32 {
        let (assign, residual, transforms) = (&self.params.assign, &self.params.residual, &self.guides.arrays);
        let (model, graph, clusters) = (&self.model, &self.graph, &self.clusters);
        let offsets = self.strands.offsets_to_leave_by(self.time, &self.params);
        let changes = self.assignment.update(model, graph, clusters, transforms, assign, offsets, choice, &self.sets);
        for change in changes {
            let s = change.strand as usize;
            let active = decode(model, s, change.set, assign.weights);
            self.sets[s] = change.set;
            self.two_way.set_changed(change.strand, &self.strands.active[s], &active);
            let (rate, least) = (residual.return_rate, residual.rest_cm);
            self.strands.change_set(s, active, transforms, self.time, rate, least, &mut self.skins);
        }
        changes.len() as u32
    }

    fn fit_workers(&mut self, n: usize) {
        if self.workers.len() < n {
            self.workers.resize_with(n, Worker::default);
        }
    }

    /// Tables for strands last met up to `most` steps ago.
    fn fit_responses(&mut self, most: usize) {
        let residual = &self.params.residual;
        let of = Elasticity {
            spacing_cm: self.spacing_cm,
            material: &self.material,
            gravity_cm_per_s2: self.params.guides.gravity.norm(),
            return_rate: residual.return_rate,
        };
        let (n, pad) = (self.strands.n_particles, self.strands.pad);
        for steps in 1..=most {
            let over = self.time - self.pasts.back(steps).time;
            let known = self.responses.get(steps - 1).map_or(f64::NAN, |known| known.over);
            // Sums of equal steps differ by round-off, which a table of them does not see.
            if (known - over).abs() <= SAME_TIME * over {
                continue;
            }
            let by_substeps = (1..=residual.max_substeps).map(|k| Response::new(n, pad, of, over / k as f64)).collect();
            let table = Responses { over, by_substeps };
            match self.responses.get_mut(steps - 1) {
                Some(known) => *known = table,
                None => self.responses.push(table),
            }
        }
    }

    /// The solids on their way over the last `steps` steps, the one of `input` included.
    fn in_head<'a>(
        &self,
        solids: &'a [Solid],
        input: &StepInput,
        steps: usize,
    ) -> ArrayVec<SolidInHead<'a>, MAX_SOLIDS> {
        let past = self.pasts.back(steps);
        let (before, now) = (past.world_from_head.inverse(), input.world_from_head.inverse());
        let poses = past.world_from_solids.iter().zip(input.world_from_solids);
        solids
            .iter()
            .zip(poses)
            .map(|(solid, (from, to))| SolidInHead::new(solid, SolidPose { from: before * from, to: now * to }))
            .collect()
    }

    /// Corrects every strand that may be in reach of a solid, and leaves what holds them in the workers.
    ///
    /// A part of the strands is met in every step where it moves fast against solids, else in every second or fourth, parts taking
    /// turns.
    fn meet_solids(&mut self, input: &StepInput, solids: &[Solid], head: Option<&Solid>, report: &mut StepReport) {
        let residual = &self.params.residual;
        let most = if residual.correction == Correction::Carried { residual.steps_per_meeting } else { 1 };
        let motion = residual.motion_per_meeting as f32
            * solids.iter().map(|s| s.half_thickness_cm).fold(f32::INFINITY, f32::min);
        self.fit_workers(self.strands.groups.len().div_ceil(GROUPS_PER_PART));
        self.fit_responses(most);
        let on_their_way: ArrayVec<_, MAX_STEPS_PER_MEETING> =
            (1..=most).map(|steps| self.in_head(solids, input, steps)).collect();
        let strands = &mut self.strands;
        let (n, pad) = (strands.n_particles, strands.pad);
        let (rest, active, u) = (&strands.rest, &strands.active, &strands.u);
        let (params, responses) = (&self.params, &self.responses);
        let length_cm = (self.spacing_cm * (n - 1) as f64) as f32;
        let (step, time) = (self.step_number, self.time);
        let since: ArrayVec<(Surroundings, Skins), MAX_STEPS_PER_MEETING> = (1..=most)
            .map(|steps| {
                let past = self.pasts.back(steps);
                let (solids, responses) = (&on_their_way[steps - 1], &responses[steps - 1].by_substeps);
                let (dt, steps) = (time - past.time, steps as u64);
                let around = Surroundings { dt, time, step, steps, solids, head, params, responses, length_cm, pad, n };
                (around, Skins { rest, u, active, transforms: &self.guides.arrays, before: &past.transforms, pad })
            })
            .collect();
        strands
            .groups
            .par_chunks_mut(GROUPS_PER_PART)
            .zip(strands.slots.par_chunks_mut(PART))
            .zip(strands.wakes.par_chunks_mut(PART))
            .zip(strands.fades.par_chunks_mut(PART))
            .zip(strands.carried.par_chunks_mut(PART * 6 * pad))
            .zip(self.workers.par_iter_mut())
            .enumerate()
            .for_each(|(part, (((((groups, slots), wakes), fades), carried), worker))| {
                let due = groups.iter().filter(|group| group.wake.is_due(group.travel, time));
                let fastest = due.fold(0.0f32, |most, group| most.max(group.last_travel));
                let every = steps_within(motion / fastest, most);
                worker.lost = 0;
                if !(step as usize + part).is_multiple_of(every) {
                    return;
                }
                let steps = (step + 1 - worker.met).min(most as u64) as usize;
                let (around, skins) = &since[steps - 1];
                let Worker { met, deepest, holds, near, pushed, lost } = worker;
                holds.clear();
                (*near, *pushed, *deepest, *met) = (0, 0, 0.0, step + 1);
                let members = slots
                    .chunks_mut(GROUP)
                    .zip(wakes.chunks_mut(GROUP))
                    .zip(fades.chunks_mut(GROUP))
                    .zip(carried.chunks_mut(GROUP * 6 * pad));
                for (group, (((slots, wakes), fades), carried)) in groups.iter_mut().zip(members) {
                    let last = (group.travel - group.met) as f32;
                    group.met = group.travel;
                    if !group.wake.is_due(group.travel, time) {
                        continue;
                    }
                    let mut awake = [0u8; GROUP];
                    let mut n_awake = 0;
                    for (k, wake) in wakes.iter().enumerate() {
                        if wake.is_due(group.travel, time) {
                            awake[n_awake] = k as u8;
                            n_awake += 1;
                        }
                    }
                    let travel = Travel { total: group.travel, last, next: every as f32 * group.last_travel };
                    let mut members = Members { slots, wakes, fades, carried };
                    let awake = &awake[..n_awake];
                    WORK.with_borrow_mut(|work| {
                        correct(around, skins, &mut members, awake, travel, work, holds, &mut |outcome, depth| {
                            *deepest = deepest.max(depth);
                            match outcome {
                                Outcome::Away => {}
                                Outcome::Near => *near += 1,
                                Outcome::Pushed => (*near, *pushed) = (*near + 1, *pushed + 1),
                                Outcome::Lost => *lost += 1,
                            }
                        });
                    });
                    let never = Wake { at: f64::INFINITY, from: f64::INFINITY };
                    group.wake = members.wakes.iter().fold(never, |first, wake| first.first(*wake));
                }
            });
        for worker in &self.workers {
            report.corrected_strands += worker.near;
            report.strands_in_contact += worker.pushed;
            report.quarantined += worker.lost;
            report.deepest_cm = report.deepest_cm.max(worker.deepest);
        }
    }

    /// Effective forces of this step's contacts on the guides, for the next step.
    fn push_back(&mut self, dt: f64) -> usize {
        if !self.params.two_way.enabled {
            return 0;
        }
        self.contact_points.clear();
        let masses = &self.particle_masses;
        let turn = self.world_from_head.rotation;
        for worker in &self.workers {
            for hold in &worker.holds {
                let stiffness =
                    self.params.two_way.stiffness_over_inertia * f64::from(masses[hold.strand as usize]) / (dt * dt);
                let force = turn * (Vector3::from(hold.held).cast::<f64>() * stiffness);
                let &Hold { strand, segment, s, .. } = hold;
                self.contact_points.push(ContactPoint { strand, segment, s, force: force.cast::<f32>().into() });
            }
        }
        self.contact_points.sort_unstable_by_key(|point| (point.strand, point.segment, point.s.to_bits()));
        let mass = |guide: usize| f64::from(masses[self.model.guide_strands[guide] as usize]);
        let active = &self.strands.active;
        let set_of = |s: usize| &active[s];
        self.two_way.update(Round::First, active.len(), set_of, &self.contact_points, mass, &self.params.two_way)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strands_go_unmet_as_long_as_motion_allows_and_never_longer() {
        for most in [1, 2, 4] {
            for share in [0.0, 0.5, 1.0, 1.9, 2.0, 3.9, 4.0, 100.0, f32::INFINITY] {
                let steps = steps_within(share, most);
                assert!(steps.is_power_of_two() && steps <= most && (steps == 1 || steps as f32 <= share));
                assert!(2 * steps > most || 2.0 * steps as f32 > share, "{share} of {most}: {steps}");
            }
            assert_eq!(steps_within(f32::NAN, most), 1, "what is not a number is met at once");
        }
    }
}
