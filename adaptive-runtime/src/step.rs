//! One interactive step: the only place that knows the order of the stages.

use crate::assign::decode;
use crate::graph::EdgeRule;
use crate::hair_contact::{LaneInput, N_FIXED, ResidualInput, get, penalty_forces};
use crate::interpolate::interpolate;
use crate::params::{CliqueRule, TwoWayParams};
use crate::runtime::{Runtime, Strand, Worker, to_world};
use crate::timings::{StageTimings, timed};
use crate::two_way::ContactRow;
use collision::cull::DistanceBound;
use collision::{MovingSolid, SolidPose};
use io_formats::skinning_model::SkinningModel;
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use strand_sim::Material;
use strand_sim::lanes::Lane3;

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
    /// Strands corrected one by one.
    pub corrected_strands: u32,
    /// Strands in contact with a solid.
    pub strands_in_contact: u32,
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
    /// Advances the hair by one step.
    ///
    /// # Panics
    /// If the number of poses is not that of the solids.
    pub fn step(&mut self, input: &StepInput) -> StepReport {
        assert_eq!(input.world_from_solids.len(), self.solids.len(), "one pose per solid");
        let mut report = StepReport::default();
        // The solids are lent to the stages while the rest of the runtime is written.
        let solids = std::mem::take(&mut self.solids);
        let head = self.head.take();
        let moving: Vec<MovingSolid> = solids
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
        std::mem::swap(&mut self.positions, &mut self.previous);

        let guide_report = timed(&mut report.timings.guide_sim, || {
            let mut all: Vec<MovingSolid> = moving.clone();
            all.extend(moving_head);
            let carried = strand_sim::StepInput::carried(input.dt, self.world_from_head, input.world_from_head);
            let step = strand_sim::StepInput { solids: &all, forces: &self.two_way.forces, ..carried };
            self.guides.step(&step, &input.world_from_head, &self.params.guides)
        });
        report.guide_contacts = guide_report.contacts;
        report.quarantined += guide_report.quarantined;

        if self.params.assign.adapt {
            timed(&mut report.timings.graph, || {
                let rule = EdgeRule {
                    similarity: self.params.assign.similarity,
                    distance: self.params.assign.edge_distance,
                    avoidance: self.params.assign.avoidance,
                    gap_resolution: self.params.gap_resolution,
                    gap_period: self.params.gap_period,
                };
                let motion = self.guides.motion(&input.world_from_head, &moving);
                self.graph.update(&self.model, &motion, &moving, rule);
            });
            if self.params.assign.cliques == CliqueRule::Grown {
                timed(&mut report.timings.clusters, || self.clusters.update(&self.graph));
            }
            report.set_changes = timed(&mut report.timings.assign, || self.assign());
        }
        report.connectivity = self.graph.connectivity();

        timed(&mut report.timings.interpolate, || self.interpolate_and_mark(input, &moving));
        let mut hair_contact = std::time::Duration::ZERO;
        timed(&mut hair_contact, || self.correct(input, &moving, moving_head, &mut report));
        report.timings.hair_contact = hair_contact;
        report.guides_pushed = timed(&mut report.timings.two_way, || self.push_back()) as u32;

        self.world_from_head = input.world_from_head;
        self.world_from_solids.copy_from_slice(input.world_from_solids);
        self.step_number += 1;
        self.solids = solids;
        self.head = head;
        report
    }

    /// Chooses the sets of this step; a hair stays where it is: what the change of set would move it by becomes offset. Returns
    /// how many hairs changed.
    fn assign(&mut self) -> u32 {
        let (n, pad) = (self.n_particles(), self.pad);
        let changes = self.assignment.update(
            &self.model,
            &self.graph,
            &self.clusters,
            &self.guides.arrays,
            &self.params.assign,
            self.step_number,
            &self.sets,
        );
        let (mut before, mut after) = (vec![0.0; 3 * pad], vec![0.0; 3 * pad]);
        for change in changes {
            let s = change.strand as usize;
            let rest = &self.rest[s * 3 * pad..(s + 1) * 3 * pad];
            let strand = &mut self.strands[s];
            interpolate(rest, &self.u, &strand.active_set, &self.guides.arrays, &mut before);
            self.sets[s] = change.set;
            strand.active_set = decode(&self.model, s, change.set, self.params.assign.weights);
            interpolate(rest, &self.u, &strand.active_set, &self.guides.arrays, &mut after);
            for i in N_FIXED..n {
                for c in 0..3 {
                    self.offset[s * n + i][c] += before[c * pad + i] - after[c * pad + i];
                }
            }
            strand.has_offset = true;
        }
        changes.len() as u32
    }

    /// Interpolates each hair and marks those to be corrected.
    fn interpolate_and_mark(&mut self, input: &StepInput, moving: &[MovingSolid]) {
        let n = self.n_particles();
        let n_strands = self.strands.len();
        let n_workers = (8 * rayon::current_num_threads()).min(n_strands.max(1));
        let slice = n_strands.div_ceil(n_workers).max(1);
        if self.workers.len() < n_workers {
            self.workers.resize_with(n_workers, Worker::default);
        }
        let pass = Pass {
            params: &self.params,
            transforms: &self.guides.arrays,
            rest: &self.rest,
            u: &self.u,
            pad: self.pad,
            previous: &self.previous,
            moving,
            world_from_head: input.world_from_head,
            moved_by_solids: moving.iter().map(MovingSolid::max_displacement).fold(0.0, f64::max) as f32,
        };
        self.strands
            .par_chunks_mut(slice)
            .zip(self.positions.par_chunks_mut(slice * n))
            .zip(self.offset.par_chunks_mut(slice * n))
            .zip(self.workers.par_iter_mut())
            .enumerate()
            .for_each(|(chunk, (((strands, positions), offsets), worker))| {
                for (k, strand) in strands.iter_mut().enumerate() {
                    let of = k * n..(k + 1) * n;
                    pass.strand(chunk * slice + k, strand, &mut positions[of.clone()], &mut offsets[of], worker);
                }
            });
    }

    /// Interpolates every strand from its current set at the guides' current state; no correction.
    pub(crate) fn interpolate_all(&mut self) {
        let n = self.n_particles();
        let pad = self.pad;
        let mut skin = vec![0.0; 3 * pad];
        for s in 0..self.strands.len() {
            let rest = &self.rest[s * 3 * pad..(s + 1) * 3 * pad];
            interpolate(rest, &self.u, &self.strands[s].active_set, &self.guides.arrays, &mut skin);
            for i in 0..n {
                let p = [skin[i], skin[pad + i], skin[2 * pad + i]];
                self.positions[s * n + i] = to_world(&self.world_from_head, p);
            }
        }
    }

    /// Residual correction of the marked strands; leaves their contact forces in `contact_rows`.
    fn correct(
        &mut self,
        input: &StepInput,
        moving: &[MovingSolid],
        head: Option<MovingSolid>,
        report: &mut StepReport,
    ) {
        let n = self.n_particles();
        self.spare_rows.append(&mut self.contact_rows);
        // Strands near a solid first: a batch without any of them takes a single substep.
        let strands = &self.strands;
        let listed = |near: bool| {
            let wanted = move |strand: &Strand| strand.listed && strand.near == near;
            (0..strands.len() as u32).filter(move |&s| wanted(&strands[s as usize]))
        };
        self.hair_contact.list(n, listed(true).chain(listed(false)));
        let (before, after) = (&self.previous, &self.positions);
        let (offset, offset_velocity, model) = (&self.offset, &self.offset_velocity, &self.model);
        let residual = ResidualInput {
            dt: input.dt,
            solids: moving,
            head,
            params: &self.params.residual,
            contact: &self.params.guides.contact,
            material: &self.material,
            gravity_cm_per_s2: self.params.guides.gravity.norm(),
            world_from_head_before: self.world_from_head.rotation,
        };
        self.hair_contact.solve(&residual, |s| {
            let of = s as usize * n..(s as usize + 1) * n;
            LaneInput {
                before: &before[of.clone()],
                after: &after[of.clone()],
                offset: &offset[of.clone()],
                offset_velocity: &offset_velocity[of],
                rest: model.rest_of(s as usize),
                near: strands[s as usize].near,
            }
        });
        if !self.params.residual.contact && self.params.two_way.enabled {
            for (s, _) in self.strands.iter().enumerate().filter(|(_, strand)| strand.near) {
                let mut row = take_row(&mut self.spare_rows, s as u32, n);
                let (now, before) = (&self.positions[s * n..(s + 1) * n], &self.previous[s * n..(s + 1) * n]);
                let stiffness = penalty_stiffness(&self.model, &self.material, &self.params.two_way, s, input.dt);
                let contact = &self.params.guides.contact;
                if penalty_forces(now, before, moving, stiffness, input.dt, contact, &mut row.forces) {
                    report.strands_in_contact += 1;
                    self.contact_rows.push(row);
                } else {
                    self.spare_rows.push(row);
                }
            }
        }
        let head_from_world = input.world_from_head.rotation.inverse();
        for batch in self.hair_contact.batches() {
            report.corrected_strands += batch.strands.len() as u32;
            for (lane, &s) in batch.strands.iter().enumerate() {
                let stiffness =
                    penalty_stiffness(&self.model, &self.material, &self.params.two_way, s as usize, input.dt);
                let strand = &mut self.strands[s as usize];
                let of = s as usize * n;
                if !lane_is_finite(&batch.offset, lane) || !lane_is_finite(&batch.velocity, lane) {
                    report.quarantined += 1;
                    clear(strand, &mut self.offset[of..of + n], &mut self.offset_velocity[of..of + n]);
                    continue;
                }
                let mut largest: f64 = 0.0;
                for i in N_FIXED..n {
                    let (d, v) = (get(&batch.offset[i], lane), get(&batch.velocity[i], lane));
                    largest = largest.max(d.norm_squared()).max(v.norm_squared() * 1e-4);
                    let p = &mut self.positions[of + i];
                    for c in 0..3 {
                        p[c] += d[c] as f32;
                    }
                    self.offset[of + i] = (head_from_world * d).cast::<f32>().into();
                    self.offset_velocity[of + i] = (head_from_world * v).cast::<f32>().into();
                }
                if strand.near && self.params.residual.contact {
                    strand.clearance = DistanceBound::at_least(batch.clearance[lane] as f32);
                }
                if largest.sqrt() < self.params.residual.rest_cm && !batch.touched[lane] {
                    // What is dropped here is below what a position can show.
                    clear(strand, &mut self.offset[of..of + n], &mut self.offset_velocity[of..of + n]);
                } else {
                    strand.has_offset = true;
                }
                if batch.touched[lane] {
                    report.strands_in_contact += 1;
                    let mut row = take_row(&mut self.spare_rows, s, n);
                    // The penalty that the uncorrected hair would meet, from how far contact holds it off its guides.
                    for i in 0..n {
                        row.forces[i] = get(&batch.held[i], lane) * stiffness;
                    }
                    self.contact_rows.push(row);
                }
            }
        }
    }

    /// Effective forces of this step's contacts on the guides, for the next step.
    fn push_back(&mut self) -> usize {
        if !self.params.two_way.enabled {
            return 0;
        }
        let (model, material) = (&self.model, &self.material);
        let mass = |guide: usize| particle_mass(model, material, model.guide_strands[guide] as usize);
        let strands = &self.strands;
        self.two_way.update(strands.len(), |s| &strands[s].active_set, &self.contact_rows, mass, &self.params.two_way)
    }
}

/// Mass of one particle of a strand, g.
fn particle_mass(model: &SkinningModel, material: &Material, strand: usize) -> f64 {
    let rest = model.rest_of(strand);
    let length: f32 = rest.windows(2).map(|w| (Vector3::from(w[1]) - Vector3::from(w[0])).norm()).sum();
    material.linear_density_g_per_cm * f64::from(length) / (rest.len() - 1) as f64
}

/// Penalty stiffness on a normal hair, dyn/cm.
fn penalty_stiffness(model: &SkinningModel, material: &Material, params: &TwoWayParams, strand: usize, dt: f64) -> f64 {
    params.stiffness_over_inertia * particle_mass(model, material, strand) / (dt * dt)
}

/// A row from the spare ones, or a new one.
fn take_row(spare: &mut Vec<ContactRow>, strand: u32, n: usize) -> ContactRow {
    let mut row = spare.pop().unwrap_or_else(|| ContactRow { strand, forces: vec![Vector3::zeros(); n] });
    row.strand = strand;
    row
}

fn clear(strand: &mut Strand, offset: &mut [[f32; 3]], velocity: &mut [[f32; 3]]) {
    strand.has_offset = false;
    offset.fill([0.0; 3]);
    velocity.fill([0.0; 3]);
}

fn lane_is_finite(values: &[Lane3], lane: usize) -> bool {
    values.iter().all(|v| get(v, lane).iter().all(|x| x.is_finite()))
}

/// What the pass over strands reads.
struct Pass<'a> {
    params: &'a crate::params::RuntimeParams,
    transforms: &'a crate::interpolate::TransformArrays,
    rest: &'a [f32],
    u: &'a [f32],
    pad: usize,
    previous: &'a [[f32; 3]],
    moving: &'a [MovingSolid<'a>],
    world_from_head: Isometry3<f64>,
    moved_by_solids: f32,
}

impl Pass<'_> {
    fn strand(
        &self,
        s: usize,
        strand: &mut Strand,
        positions: &mut [[f32; 3]],
        offset: &mut [[f32; 3]],
        worker: &mut Worker,
    ) {
        let n = positions.len();
        let pad = self.pad;
        let rest = &self.rest[s * 3 * pad..(s + 1) * 3 * pad];
        worker.skin.resize(3 * pad, 0.0);
        interpolate(rest, self.u, &strand.active_set, self.transforms, &mut worker.skin);
        let mut moved: f32 = 0.0;
        for i in 0..n {
            let p = to_world(&self.world_from_head, [worker.skin[i], worker.skin[pad + i], worker.skin[2 * pad + i]]);
            let q = self.previous[s * n + i];
            moved = moved.max((p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2) + (p[2] - q[2]).powi(2));
            positions[i] = p;
        }
        strand.near = false;
        if self.params.residual.contact || self.params.two_way.enabled {
            // A distance changes by no more than strand and solid have moved since it was measured. The offset moves at
            // most as far as it is long, and is measured anew while it is there.
            strand.clearance.moved(moved.sqrt(), self.moved_by_solids);
            let carried = offset.iter().map(|d| d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).fold(0.0, f32::max).sqrt();
            let reach = self.params.guides.contact.reach() as f32 + carried;
            if !strand.clearance.clears(reach) {
                strand.clearance = self.measure_clearance(positions);
                strand.near = !strand.clearance.clears(reach);
            }
        }
        strand.listed = strand.has_offset || (strand.near && self.params.residual.contact);
    }

    /// Lower bound of a strand's distance to any solid at the end of the step, cm.
    fn measure_clearance(&self, positions: &[[f32; 3]]) -> DistanceBound {
        let mut least = f32::INFINITY;
        for moving in self.moving {
            let solid_from_world = moving.pose.to.inverse();
            let sdf = &moving.solid.sdf;
            let mut before: Option<(Vector3<f32>, f32)> = None;
            for &p in positions {
                let x: Vector3<f64> = Vector3::from(p).cast();
                let x = solid_from_world.transform_point(&Point3::from(x)).coords.cast::<f32>();
                let d = sdf.lower_bound(x);
                if let Some((y, e)) = before {
                    least = least.min(0.5 * (d + e - (x - y).norm()));
                }
                before = Some((x, d));
            }
        }
        DistanceBound::at_least(least)
    }
}
