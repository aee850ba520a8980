//! Which segments of a batch may touch a rigid solid: what was last sampled at each particle, less what it moved since.
//!
//! Points are compared in the solid's frame, where the field does not move: a sample of it stays true however the solid is
//! carried, thrown or held still, and of no other field. A distance changes by at most the field's steepest slope times
//! the way, and a segment is nowhere nearer than half of what its ends' distances exceed its length by. The bounds are
//! never too high, so contacts are the same bytes as if every particle were sampled anew (AS16 §5.1 along segments).

use crate::lanes::{self, LANES, Lane, Lane3};
use crate::rig::Topology;
use collision::{FieldId, SignedDistanceField};
use multiversion::multiversion;
use nalgebra::{Isometry3, Vector3};

/// A scalar for each strand of a batch in the precision that fields are sampled in.
type Single = [f32; LANES];

/// One particle in every lane, where a field was last sampled.
#[derive(Clone, Copy, Debug)]
struct Sight {
    /// Place in the solid's frame, cm.
    at: [Single; 3],
    /// The field's lower bound there less what rounding may add to it, cm; minus infinity before the first sample.
    bound: Single,
}

const UNSEEN: Sight = Sight { at: [[0.0; LANES]; 3], bound: [f32::NEG_INFINITY; LANES] };

/// What a batch remembers of one field.
#[derive(Clone, Debug)]
pub(crate) struct Sights {
    field: FieldId,
    /// One entry for each of the hair's own particles.
    particles: Vec<Sight>,
}

impl Sights {
    /// Nothing seen yet of `field` by strands of `n_main` particles.
    pub fn new(field: &SignedDistanceField, n_main: usize) -> Self {
        Self { field: field.id(), particles: vec![UNSEEN; n_main] }
    }

    /// Forgets everything unless it is of `field`.
    pub fn turn_to(&mut self, field: &SignedDistanceField) {
        if self.field != field.id() {
            self.field = field.id();
            self.particles.fill(UNSEEN);
        }
    }
}

/// How far around a strand a solid is looked for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reach {
    /// For a strand at rest, cm.
    pub still: f64,
    /// Time for which its own velocity is looked ahead, s.
    pub h: f64,
    /// Farthest it is looked ahead, cm.
    pub farthest: f64,
}

/// Where a batch is seen from a solid; buffers of a worker, one entry for each of the hair's own particles.
#[derive(Debug, Default)]
pub(crate) struct View {
    /// Places in the solid's frame, cm.
    at: Vec<[Single; 3]>,
    /// Distances sampled in this view, where `is_sampled`, cm.
    distance: Vec<Single>,
    is_sampled: Vec<u8>,
    /// Squared speeds, cm²/s².
    speed2: Vec<Single>,
    /// Distance within which the segment from the particle to the next is looked at, cm.
    reach: Vec<Single>,
    /// Lanes whose segment from the particle to the next may come within reach.
    may_meet: Vec<u8>,
}

/// A segment within reach of a solid.
pub(crate) struct Met {
    /// First of its two particles.
    pub segment: usize,
    pub lane: usize,
    /// Its ends in the solid's frame, cm.
    pub ends: [Vector3<f32>; 2],
    /// Distances sampled there, cm.
    pub distance: [f32; 2],
    /// Distance within which it is looked at, cm.
    pub reach: f32,
}

impl View {
    /// Looks at the batch from a solid; calls `meet` for every segment, from particle `first` on, that may come within
    /// its reach, lane by lane of a segment, segments in order.
    pub fn look(
        &mut self,
        field: &SignedDistanceField,
        solid_from_world: &Isometry3<f64>,
        [position, velocity]: [&[Lane3]; 2],
        topology: &Topology,
        n_lanes: usize,
        reach: Reach,
        sights: &mut Sights,
        mut meet: impl FnMut(Met),
    ) {
        let n_main = topology.n_main;
        if self.at.len() < n_main {
            self.at.resize(n_main, [[0.0; LANES]; 3]);
            self.distance.resize(n_main, [0.0; LANES]);
            self.is_sampled.resize(n_main, 0);
            self.speed2.resize(n_main, [0.0; LANES]);
            self.reach.resize(n_main, [0.0; LANES]);
            self.may_meet.resize(n_main, 0);
        }
        let first = topology.first_free_main();
        let slope = field.steepest();
        if !find_segments(self, solid_from_world, position, velocity, topology, slope, reach, &sights.particles) {
            return;
        }
        let present = u8::MAX >> (LANES - n_lanes);
        for i in first..n_main - 1 {
            let mut lanes = self.may_meet[i] & present;
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize;
                lanes &= lanes - 1;
                let (a, distance_a) = self.sample(field, i, lane, sights);
                let (b, distance_b) = self.sample(field, i + 1, lane, sights);
                // A distance changes by at most the length walked.
                let least = half_excess(field.surely(distance_a), field.surely(distance_b), norm(b - a));
                let reach = self.reach[i][lane];
                if least < reach {
                    meet(Met { segment: i, lane, ends: [a, b], distance: [distance_a, distance_b], reach });
                }
            }
        }
    }

    /// The distance at a particle, sampled at most once a view.
    fn sample(
        &mut self,
        field: &SignedDistanceField,
        i: usize,
        lane: usize,
        sights: &mut Sights,
    ) -> (Vector3<f32>, f32) {
        let at = Vector3::from(std::array::from_fn(|c| self.at[i][c][lane]));
        if self.is_sampled[i] >> lane & 1 == 0 {
            let distance = field.distance(at);
            self.is_sampled[i] |= 1 << lane;
            self.distance[i][lane] = distance;
            let bound = field.surely(distance);
            let sight = &mut sights.particles[i];
            for c in 0..3 {
                sight.at[c][lane] = at[c];
            }
            sight.bound[lane] = bound - field.round_off(bound);
        }
        (at, self.distance[i][lane])
    }
}

/// Least distance along a segment of a length whose ends have these.
#[inline(always)]
fn half_excess(a: f32, b: f32, length: f32) -> f32 {
    0.5 * (a + b - length)
}

/// As the vector code sums it, so that both see the same length.
#[inline(always)]
fn norm(v: Vector3<f32>) -> f32 {
    (v.x * v.x + v.y * v.y + v.z * v.z).sqrt()
}

/// Fills a view but for its samples; returns whether any segment may come within reach.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn find_segments(
    view: &mut View,
    solid_from_world: &Isometry3<f64>,
    position: &[Lane3],
    velocity: &[Lane3],
    topology: &Topology,
    steepest: f32,
    reach: Reach,
    sights: &[Sight],
) -> bool {
    let turn = solid_from_world.rotation.to_rotation_matrix().into_inner();
    let shift = solid_from_world.translation.vector;
    let first = topology.first_free_main();
    let (mut bound_before, mut any) = ([f32::NEG_INFINITY; LANES], 0);
    for i in first..topology.n_main {
        let p = topology.rig_of_main(i);
        let x = &position[p];
        for c in 0..3 {
            let [tx, ty, tz] = [[turn[(c, 0)]; LANES], [turn[(c, 1)]; LANES], [turn[(c, 2)]; LANES]];
            let row = lanes::mul_add(&tz, &x[2], &[shift[c]; LANES]);
            let row = lanes::mul_add(&tx, &x[0], &lanes::mul_add(&ty, &x[1], &row));
            view.at[i][c] = single(&row);
        }
        let v = &velocity[p];
        view.speed2[i] = single(&lanes::dot(v, v));
        view.is_sampled[i] = 0;
        let (at, sight) = (&view.at[i], &sights[i]);
        let mut bound = [0.0; LANES];
        for l in 0..LANES {
            let [x, y, z] = [0, 1, 2].map(|c: usize| at[c][l] - sight.at[c][l]);
            bound[l] = sight.bound[l] - steepest * (x * x + y * y + z * z).sqrt();
        }
        if i > first {
            let before = &view.at[i - 1];
            let mut far = [0.0; LANES];
            let mut excess = [0.0; LANES];
            for l in 0..LANES {
                let fastest = view.speed2[i - 1][l].max(view.speed2[i][l]).sqrt();
                far[l] = reach.still as f32 + (fastest * reach.h as f32).min(reach.farthest as f32);
                let [x, y, z] = [0, 1, 2].map(|c: usize| at[c][l] - before[c][l]);
                let length = (x * x + y * y + z * z).sqrt();
                excess[l] = half_excess(bound_before[l], bound[l], length);
            }
            let mut near = 0;
            for l in 0..LANES {
                // Not a number is near.
                near |= u8::from(!(excess[l] >= far[l])) << l;
            }
            view.reach[i - 1] = far;
            view.may_meet[i - 1] = near;
            any |= near;
        }
        bound_before = bound;
    }
    any != 0
}

#[inline(always)]
fn single(of: &Lane) -> Single {
    let mut out = [0.0; LANES];
    for l in 0..LANES {
        out[l] = of[l] as f32;
    }
    out
}
