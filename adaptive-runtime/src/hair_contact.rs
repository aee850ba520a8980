//! Residual correction of strands near solids: what guides alone cannot resolve (our own; docs/DEVIATIONS.md).
//!
//! Guides stand more than a centimetre apart and a comb's teeth a few millimetres, so a hair also carries an offset of its
//! own from the skinned strand. The offset moves as a linearised strand: tension from the hair hanging below, bending, and
//! near-inextensible segments pull it back; solids push it through the same implicit contact as any simulated strand; what
//! nothing holds returns at a stated rate. It has a velocity, so it neither flickers nor snaps, and the jump of a changed
//! guide set fades out through it. Eight strands are solved side by side.

use crate::params::ResidualParams;
use collision::{MovingSolid, PenaltyParams, SegmentContact, penalty_on_segment};
use multiversion::multiversion;
use nalgebra::{UnitQuaternion, Vector3};
use rayon::prelude::*;
use strand_sim::lanes::{LANES, Lane, Lane3, ZERO};
use strand_sim::solve::banded::BandedMatrix;
use strand_sim::{Contact, ContactParams, Material, near_points};

/// Particles at the root that carry no offset: they sit in the scalp.
pub(crate) const N_FIXED: usize = 2;

/// Bending stiffness (dyn·cm²) per force of a bend spring (dyn at 1 cm spacing): measured on the straight rig.
const BENDING_PER_SPRING: f64 = 0.07;

/// Stiffness that keeps a segment's length, as a multiple of m/h².
const LENGTH_STIFFNESS: f64 = 400.0;

/// Largest share by which a skinned segment's length may differ from rest and still be kept.
const LENGTH_SLACK: f64 = 0.05;

/// Arc length from the root within which contact with the head is left to the scalp, cm.
const ROOT_FREE_CM: f64 = 1.0;

/// One strand's part in a batch, as the runtime holds it: slices of `n_particles`.
pub(crate) struct LaneInput<'a> {
    /// World positions at the start of the step, offset included, cm.
    pub before: &'a [[f32; 3]],
    /// Skinned world positions at its end, cm.
    pub after: &'a [[f32; 3]],
    /// Offset and its velocity at the start, head frame, cm and cm/s.
    pub offset: &'a [[f32; 3]],
    pub offset_velocity: &'a [[f32; 3]],
    /// Rest positions, cm, any frame.
    pub rest: &'a [[f32; 3]],
    /// Whether a solid other than the head may be met in this step; if not, only the offset moves.
    pub near: bool,
}

/// Up to eight strands with all they carry through a step.
#[derive(Debug)]
pub(crate) struct ContactBatch {
    pub strands: Vec<u32>,
    before: Vec<Lane3>,
    after: Vec<Lane3>,
    pub offset: Vec<Lane3>,
    pub velocity: Vec<Lane3>,
    /// How far contact holds each strand away from its guides, along the contacts' normals at the end of the step, cm.
    pub held: Vec<Lane3>,
    mass: Vec<Lane>,
    /// Rest length per segment, cm.
    rest_length: Vec<Lane>,
    /// Tension per length of each segment, dyn/cm.
    string: Vec<Lane>,
    /// Bending stiffness over spacing cubed, dyn/cm.
    beam: Lane,
    /// First particle beyond the root's free length.
    first_for_head: [usize; LANES],
    near: [bool; LANES],
    /// Whether the lane met a solid this step.
    pub touched: [bool; LANES],
    /// Lower bound of the distance to any solid but the head at the end of the step, cm.
    pub clearance: Lane,
}

/// Buffers of one worker.
#[derive(Debug)]
struct Slot {
    matrix: BandedMatrix,
    rhs: Vec<Lane>,
    contacts: Vec<Contact>,
    position: Vec<Lane3>,
}

#[derive(Debug, Default)]
pub(crate) struct HairContact {
    batches: Vec<ContactBatch>,
    n_used: usize,
    slots: Vec<Slot>,
}

/// What a residual step depends on.
pub(crate) struct ResidualInput<'a> {
    pub dt: f64,
    /// Solids, the head not among them.
    pub solids: &'a [MovingSolid<'a>],
    /// The head, if hair near solids is to stay out of it too.
    pub head: Option<MovingSolid<'a>>,
    pub params: &'a ResidualParams,
    pub contact: &'a ContactParams,
    pub material: &'a Material,
    pub gravity_cm_per_s2: f64,
    /// Rotation of the head at the start of the step.
    pub world_from_head_before: UnitQuaternion<f64>,
}

impl ContactBatch {
    fn new(n: usize) -> Self {
        let lanes3 = || vec![[ZERO; 3]; n];
        Self {
            strands: Vec::with_capacity(LANES),
            before: lanes3(),
            after: lanes3(),
            offset: lanes3(),
            velocity: lanes3(),
            held: lanes3(),
            mass: vec![ZERO; n],
            rest_length: vec![ZERO; n - 1],
            string: vec![ZERO; n - 1],
            beam: ZERO,
            first_for_head: [N_FIXED; LANES],
            near: [false; LANES],
            touched: [false; LANES],
            clearance: ZERO,
        }
    }

    fn load(&mut self, lane: usize, strand: &LaneInput, input: &ResidualInput) {
        let n = self.before.len();
        let (material, gravity) = (input.material, input.gravity_cm_per_s2);
        let wide = |p: [f32; 3]| -> Vector3<f64> { Vector3::from(p).cast() };
        self.near[lane] = strand.near;
        for i in 0..n {
            // The offset was kept in the head frame; the step starts at the head's old pose.
            let offset = input.world_from_head_before * wide(strand.offset[i]);
            set(&mut self.before[i], lane, wide(strand.before[i]) - offset);
            set(&mut self.after[i], lane, wide(strand.after[i]));
            set(&mut self.offset[i], lane, offset);
            set(&mut self.velocity[i], lane, input.world_from_head_before * wide(strand.offset_velocity[i]));
        }
        let mut length = 0.0;
        self.first_for_head[lane] = n - 1;
        for j in 0..n - 1 {
            let d = wide(strand.rest[j + 1]) - wide(strand.rest[j]);
            self.rest_length[j][lane] = d.norm();
            length += d.norm();
            if length >= ROOT_FREE_CM {
                self.first_for_head[lane] = self.first_for_head[lane].min(j + 1);
            }
        }
        let h = length / (n - 1) as f64;
        let density = material.linear_density_g_per_cm;
        let mut below = length;
        for j in 0..n - 1 {
            below -= self.rest_length[j][lane];
            // The weight of what hangs below the segment, and half of its own.
            self.string[j][lane] = density * gravity * (below + 0.5 * h) / h;
        }
        self.beam[lane] = BENDING_PER_SPRING * material.bend_dyn / (h * h * h);
        for i in 0..n {
            self.mass[i][lane] = density * h;
        }
    }
}

impl ContactBatch {
    /// Copies the first strand into the lanes past the last, so that every lane's system is sound.
    fn repeat_first_lane(&mut self) {
        let n_strands = self.strands.len();
        let repeat = |values: &mut Lane| {
            let first = values[0];
            values[n_strands..].fill(first);
        };
        for vectors in [&mut self.before, &mut self.after, &mut self.offset, &mut self.velocity] {
            vectors.iter_mut().flatten().for_each(repeat);
        }
        for scalars in [&mut self.mass, &mut self.rest_length, &mut self.string] {
            scalars.iter_mut().for_each(repeat);
        }
        repeat(&mut self.beam);
    }
}

impl HairContact {
    /// Starts a new step with its list of strands.
    pub(crate) fn list(&mut self, n_particles: usize, strands: impl Iterator<Item = u32>) {
        for batch in &mut self.batches[..self.n_used] {
            batch.strands.clear();
        }
        self.n_used = 0;
        for strand in strands {
            if self.n_used == 0 || self.batches[self.n_used - 1].strands.len() == LANES {
                if self.n_used == self.batches.len() {
                    self.batches.push(ContactBatch::new(n_particles));
                }
                self.n_used += 1;
            }
            self.batches[self.n_used - 1].strands.push(strand);
        }
    }

    /// The strands of this step with their results, in the order they were added.
    pub(crate) fn batches(&self) -> &[ContactBatch] {
        &self.batches[..self.n_used]
    }

    /// Moves all listed strands through the step; `strand` gives what the runtime holds of each.
    pub(crate) fn solve<'s>(&mut self, input: &ResidualInput, strand: impl Fn(u32) -> LaneInput<'s> + Sync) {
        if self.n_used == 0 {
            return;
        }
        let n = self.batches[0].before.len();
        let n_slots = (4 * rayon::current_num_threads()).min(self.n_used);
        let slice = self.n_used.div_ceil(n_slots);
        while self.slots.len() < n_slots {
            self.slots.push(Slot {
                matrix: BandedMatrix::new(n - N_FIXED, 2),
                rhs: vec![ZERO; 3 * (n - N_FIXED)],
                contacts: Vec::with_capacity(4 * LANES * n),
                position: vec![[ZERO; 3]; n],
            });
        }
        self.batches[..self.n_used].par_chunks_mut(slice).zip(self.slots.par_iter_mut()).for_each(|(batches, slot)| {
            for batch in batches {
                for lane in 0..batch.strands.len() {
                    batch.load(lane, &strand(batch.strands[lane]), input);
                }
                batch.repeat_first_lane();
                step_batch(batch, slot, input);
            }
        });
    }
}

fn step_batch(batch: &mut ContactBatch, slot: &mut Slot, input: &ResidualInput) {
    let n = batch.before.len();
    batch.touched = [false; LANES];
    batch.held.fill([ZERO; 3]);
    batch.clearance = [f64::INFINITY; LANES];
    let n_substeps = substeps(batch, input);
    let h = input.dt / n_substeps as f64;
    for sub in 0..n_substeps {
        let alpha = (sub + 1) as f64 / n_substeps as f64;
        // The skinned strand is carried to the end of the substep first; the offset answers what that meets.
        for i in 0..n {
            for c in 0..3 {
                for l in 0..LANES {
                    let skin = batch.before[i][c][l] + alpha * (batch.after[i][c][l] - batch.before[i][c][l]);
                    slot.position[i][c][l] = skin + batch.offset[i][c][l];
                }
            }
        }
        slot.contacts.clear();
        if input.params.contact {
            let last = sub + 1 == n_substeps;
            for solid in input.solids {
                find(batch, slot, solid, alpha, h, input, [N_FIXED - 1; LANES], last);
            }
            if let Some(head) = &input.head {
                find(batch, slot, head, alpha, h, input, batch.first_for_head, false);
            }
        }
        assemble_and_solve(batch, h, input, slot);
        for contact in &slot.contacts {
            let force = contact.apply_friction(N_FIXED, h, &batch.mass, &mut batch.velocity);
            if force == Vector3::zeros() {
                continue;
            }
            batch.touched[contact.lane] = true;
            if sub + 1 == n_substeps {
                let [a, b] = contact.ends;
                let offset = get(&batch.offset[a], contact.lane) * contact.weight[0]
                    + get(&batch.offset[b], contact.lane) * contact.weight[1];
                let held = contact.normal * contact.normal.dot(&offset).max(0.0);
                for (p, w) in contact.ends.into_iter().zip(contact.weight) {
                    let sum = get(&batch.held[p], contact.lane) + held * w;
                    set(&mut batch.held[p], contact.lane, sum);
                }
            }
        }
        for i in N_FIXED..n {
            for c in 0..3 {
                for l in 0..LANES {
                    batch.offset[i][c][l] += h * batch.velocity[i][c][l];
                }
            }
        }
    }
    // The bound was measured before the last substep's movement.
    for lane in 0..batch.strands.len() {
        let fastest = batch.velocity.iter().map(|v| get(v, lane).norm_squared()).fold(0.0, f64::max).sqrt();
        batch.clearance[lane] -= h * fastest;
    }
}

/// Substeps such that no strand of the batch near a solid moves more than a part of its half-thickness in one.
fn substeps(batch: &ContactBatch, input: &ResidualInput) -> usize {
    if !batch.near[..batch.strands.len()].contains(&true) {
        return 1;
    }
    let mut moved: f64 = 0.0;
    for (a, b) in batch.before.iter().zip(&batch.after) {
        for l in 0..batch.strands.len() {
            moved = moved.max((get(b, l) - get(a, l)).norm_squared());
        }
    }
    let most = input
        .solids
        .iter()
        .map(|s| {
            let step = input.params.motion_per_substep * f64::from(s.solid.half_thickness_cm);
            (moved.sqrt() + s.max_displacement()) / step
        })
        .fold(1.0, f64::max);
    // A position that is not finite must not become a count.
    if most.is_finite() { (most.ceil() as usize).clamp(1, input.params.max_substeps) } else { 1 }
}

/// Finds the contacts of all lanes with one solid, posed at fraction `alpha` of the step.
fn find(
    batch: &mut ContactBatch,
    slot: &mut Slot,
    moving: &MovingSolid,
    alpha: f64,
    h: f64,
    input: &ResidualInput,
    first: [usize; LANES],
    record_clearance: bool,
) {
    let n = batch.before.len();
    let world_from_solid = moving.pose.at(alpha);
    let (position, contacts) = (&slot.position, &mut slot.contacts);
    for lane in (0..batch.strands.len()).filter(|&lane| batch.near[lane]) {
        let at = |i: usize| get(&position[i], lane);
        let clear = near_points(first[lane]..n, at, moving, &world_from_solid, input.contact, |near| {
            let ends = [near.segment, near.segment + 1];
            let of = |v: &[Lane3]| near.between(get(&v[ends[0]], lane), get(&v[ends[1]], lane));
            let carried = (of(&batch.after) - of(&batch.before)) / input.dt;
            let solid_velocity = moving.pose.velocity_at(of(position), input.dt) - carried;
            let (friction, mass) = (f64::from(moving.solid.friction), batch.mass[ends[1]][lane]);
            let velocity = of(&batch.velocity);
            if near.is_closing(velocity, h) {
                contacts.push(Contact::at(&near, lane, ends, solid_velocity, friction, mass, h, input.contact));
            }
        });
        if record_clearance {
            batch.clearance[lane] = batch.clearance[lane].min(clear);
        }
    }
}

/// Penalty forces (dyn) on a strand that is not corrected, from how deep it lies in the solids at the end of the step and
/// how fast it goes on; returns whether there are any. `forces` has one entry per particle and is overwritten.
/// Implements AS16 §5.1 along segments, by [`collision::penalty`].
pub(crate) fn penalty_forces(
    now: &[[f32; 3]],
    before: &[[f32; 3]],
    solids: &[MovingSolid],
    stiffness: f64,
    dt: f64,
    params: &ContactParams,
    forces: &mut [Vector3<f64>],
) -> bool {
    forces.fill(Vector3::zeros());
    // Damping that stops in one step what the stiffness pushes back in one.
    let penalty = PenaltyParams { stiffness: stiffness as f32, damping: (stiffness * dt) as f32, skin: 0.0 };
    let mut any = false;
    for moving in solids {
        let at = |i: usize| Vector3::from(now[i]).cast::<f64>();
        let velocity = |i: usize| {
            let own = (Vector3::from(now[i]) - Vector3::from(before[i])) / dt as f32;
            own - moving.pose.velocity_at(at(i), dt).cast::<f32>()
        };
        near_points(N_FIXED - 1..now.len(), at, moving, &moving.pose.to, params, |near| {
            let (a, b) = (near.segment, near.segment + 1);
            let contact =
                SegmentContact { s: near.s as f32, distance: near.gap as f32, normal: near.normal.cast::<f32>() };
            let force = penalty_on_segment(&contact, velocity(a), velocity(b), &penalty);
            forces[a] += force.on_a.cast::<f64>();
            forces[b] += force.on_b.cast::<f64>();
            any |= force.normal_force > 0.0;
        });
    }
    any
}

/// One implicit solve for the velocities of the offsets.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn assemble_and_solve(batch: &mut ContactBatch, h: f64, input: &ResidualInput, slot: &mut Slot) {
    let n = batch.before.len();
    let (matrix, rhs) = (&mut slot.matrix, &mut slot.rhs);
    matrix.clear();
    let params = input.params;
    let inertia = 1.0 + h * params.damping + (h * params.return_rate).powi(2);
    let returning = h * params.return_rate * params.return_rate;
    for i in N_FIXED..n {
        for c in 0..3 {
            let row = 3 * (i - N_FIXED) + c;
            let block = matrix.block(i - N_FIXED, i - N_FIXED);
            for l in 0..LANES {
                block[4 * c][l] = batch.mass[i][l] * inertia;
                rhs[row][l] = batch.mass[i][l] * (batch.velocity[i][c][l] - returning * batch.offset[i][c][l]);
            }
        }
    }
    for j in N_FIXED - 1..n - 1 {
        add_segment(batch, &slot.position, j, h, matrix, rhs);
    }
    for i in N_FIXED..n - 1 {
        add_bend(batch, i, h, matrix, rhs);
    }
    for contact in &slot.contacts {
        contact.add_to(N_FIXED, h, matrix, rhs);
    }
    matrix.factor();
    matrix.solve(rhs);
    for i in N_FIXED..n {
        for c in 0..3 {
            batch.velocity[i][c] = rhs[3 * (i - N_FIXED) + c];
        }
    }
}

/// Tension and near-inextensibility of segment `j`: force `string (d_b - d_a)` plus a stiff spring along its direction.
#[inline(always)]
fn add_segment(
    batch: &ContactBatch,
    position: &[Lane3],
    j: usize,
    h: f64,
    matrix: &mut BandedMatrix,
    rhs: &mut [Lane],
) {
    let mut direction = [ZERO; 3];
    let mut along = ZERO;
    let mut along_impulse = ZERO;
    let mut around = ZERO;
    for l in 0..LANES {
        let e: [f64; 3] = std::array::from_fn(|c| position[j + 1][c][l] - position[j][c][l]);
        let s: [f64; 3] = std::array::from_fn(|c| batch.after[j + 1][c][l] - batch.after[j][c][l]);
        let length = (e[0] * e[0] + e[1] * e[1] + e[2] * e[2]).sqrt();
        let skinned = (s[0] * s[0] + s[1] * s[1] + s[2] * s[2]).sqrt();
        let rest = batch.rest_length[j][l];
        let wanted = skinned.max(rest * (1.0 - LENGTH_SLACK)).min(rest * (1.0 + LENGTH_SLACK));
        let inv = 1.0 / length.max(1e-9);
        for c in 0..3 {
            direction[c][l] = e[c] * inv;
        }
        let stiff = LENGTH_STIFFNESS * batch.mass[j + 1][l];
        along[l] = stiff;
        along_impulse[l] = stiff / h * (length - wanted);
        around[l] = h * h * batch.string[j][l];
    }
    for c in 0..3 {
        for l in 0..LANES {
            let stretch = batch.offset[j + 1][c][l] - batch.offset[j][c][l];
            let impulse = along_impulse[l] * direction[c][l] + h * batch.string[j][l] * stretch;
            if j + 1 >= N_FIXED {
                rhs[3 * (j + 1 - N_FIXED) + c][l] -= impulse;
            }
            if j >= N_FIXED {
                rhs[3 * (j - N_FIXED) + c][l] += impulse;
            }
        }
    }
    for p in 0..3 {
        for q in 0..3 {
            for l in 0..LANES {
                let mut entry = along[l] * direction[p][l] * direction[q][l];
                if p == q {
                    entry += around[l];
                }
                let b = j + 1 - N_FIXED;
                matrix.block(b, b)[3 * p + q][l] += entry;
                if j >= N_FIXED {
                    matrix.block(b - 1, b - 1)[3 * p + q][l] += entry;
                    matrix.block(b, b - 1)[3 * p + q][l] -= entry;
                }
            }
        }
    }
}

/// Bending at particle `i`: energy ½ beam |d_{i-1} - 2 d_i + d_{i+1}|².
#[inline(always)]
fn add_bend(batch: &ContactBatch, i: usize, h: f64, matrix: &mut BandedMatrix, rhs: &mut [Lane]) {
    const STENCIL: [f64; 3] = [1.0, -2.0, 1.0];
    for c in 0..3 {
        let mut curvature = ZERO;
        for k in 0..3 {
            for l in 0..LANES {
                curvature[l] += STENCIL[k] * batch.offset[i + k - 1][c][l];
            }
        }
        for a in 0..3 {
            if i + a < N_FIXED + 1 {
                continue;
            }
            let row = i + a - 1 - N_FIXED;
            for l in 0..LANES {
                rhs[3 * row + c][l] -= h * batch.beam[l] * STENCIL[a] * curvature[l];
            }
            for b in 0..=a {
                if i + b < N_FIXED + 1 {
                    continue;
                }
                let block = matrix.block(row, i + b - 1 - N_FIXED);
                for l in 0..LANES {
                    block[4 * c][l] += h * h * batch.beam[l] * STENCIL[a] * STENCIL[b];
                }
            }
        }
    }
}

#[inline(always)]
pub(crate) fn get(v: &Lane3, lane: usize) -> Vector3<f64> {
    Vector3::new(v[0][lane], v[1][lane], v[2][lane])
}

#[inline(always)]
fn set(v: &mut Lane3, lane: usize, value: Vector3<f64>) {
    v[0][lane] = value.x;
    v[1][lane] = value.y;
    v[2][lane] = value.z;
}
