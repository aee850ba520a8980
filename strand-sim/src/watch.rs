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
    /// Distances sampled in this view, at the ends of segments that may come within reach, cm.
    distance: Vec<Single>,
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
        // All samples first, none of which waits for another.
        let mut ends = 0;
        for i in first..n_main {
            let leaving = if i + 1 < n_main { self.may_meet[i] & present } else { 0 };
            for lane in lanes_of(ends | leaving) {
                self.sample(field, i, lane, sights);
            }
            ends = leaving;
        }
        for i in first..n_main - 1 {
            for lane in lanes_of(self.may_meet[i] & present) {
                let [a, b] = [i, i + 1].map(|i| self.place(i, lane));
                let distance = [self.distance[i][lane], self.distance[i + 1][lane]];
                // A distance changes by at most the length walked.
                let least = half_excess(field.surely(distance[0]), field.surely(distance[1]), norm(b - a));
                let reach = self.reach[i][lane];
                if least < reach {
                    meet(Met { segment: i, lane, ends: [a, b], distance, reach });
                }
            }
        }
    }

    #[inline(always)]
    fn place(&self, i: usize, lane: usize) -> Vector3<f32> {
        Vector3::from(std::array::from_fn(|c| self.at[i][c][lane]))
    }

    /// Samples the distance at a particle and remembers it.
    #[inline(always)]
    fn sample(&mut self, field: &SignedDistanceField, i: usize, lane: usize, sights: &mut Sights) {
        let at = self.place(i, lane);
        let distance = field.distance(at);
        self.distance[i][lane] = distance;
        let bound = field.surely(distance);
        let sight = &mut sights.particles[i];
        for c in 0..3 {
            sight.at[c][lane] = at[c];
        }
        sight.bound[lane] = bound - field.round_off(bound);
    }
}

/// Lanes whose bit is set, the first first.
#[inline(always)]
fn lanes_of(mut bits: u8) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = bits.trailing_zeros() as usize;
        bits &= bits.wrapping_sub(1);
        (lane < LANES).then_some(lane)
    })
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
                near |= u8::from((excess[l] < far[l]) | excess[l].is_nan()) << l;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Material, StepInput, StepParams, StepWorkspace, StrandState, StrandSystem};
    use collision::{MovingSolid, Shape, ShapeUnion, Solid, SolidPose};
    use nalgebra::{Translation3, UnitQuaternion};

    const N_MAIN: usize = 16;
    const DT_S: f64 = 0.01;

    fn v(x: f32, y: f32, z: f32) -> Vector3<f32> {
        Vector3::new(x, y, z)
    }

    fn head() -> Solid {
        Solid::from_shape("head", &Shape::sphere(v(0.0, 0.0, 0.0), 5.0).into(), 0.25, 1.0, 0.3).expect("a sound shape")
    }

    fn comb() -> Solid {
        let tooth = |k: i32| {
            let x = 0.4 * k as f32;
            Shape::capsule(v(x, 0.0, 0.0), v(x, 0.0, -3.0), 0.08)
        };
        let shape = ShapeUnion { shapes: (-6..=6).map(tooth).collect(), smoothing: 0.0 };
        Solid::from_shape("comb", &shape, 0.04, 0.08, 0.3).expect("a sound shape")
    }

    /// Strands straight and curly that stand on the back of the head.
    fn strands() -> StrandSystem {
        let mut points = Vec::new();
        for s in 0..29 {
            let (turn, tilt) = (0.2 * f64::from(s % 6) - 0.5, 0.2 * f64::from(s / 6) - 0.3);
            let out = Vector3::new(turn.sin(), tilt.sin(), -turn.cos()).normalize();
            let across = out.cross(&Vector3::y()).normalize();
            for i in 0..N_MAIN {
                let angle = 1.6 * i as f64;
                let radius = if s % 2 == 0 { 0.0 } else { 0.4 * (i as f64 / 4.0).min(1.0) };
                points
                    .push(out * (5.05 + 0.5 * i as f64) + (across * angle.cos() + Vector3::y() * angle.sin()) * radius);
            }
        }
        StrandSystem::new(&points, N_MAIN, Material::straight()).expect("sound strands")
    }

    fn turned(angle: f64) -> Isometry3<f64> {
        Isometry3::rotation(Vector3::y() * angle)
    }

    /// Poses of head and comb at the end of step `k`: the head shakes, the comb is drawn down and put back every 15 steps.
    fn poses(k: usize) -> [Isometry3<f64>; 2] {
        let down = 2.0 - 0.5 * (k % 15) as f64;
        let facing = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::PI);
        [turned(0.5 * (0.06 * k as f64).sin()), Isometry3::from_parts(Translation3::new(0.3, down, -8.5), facing)]
    }

    /// Bits of all positions and velocities.
    fn bits(system: &StrandSystem, state: &StrandState) -> Vec<u64> {
        let mut out = Vec::new();
        system.read(state, |_, _, x, v| out.extend(x.iter().chain(v.iter()).map(|c| c.to_bits())));
        out
    }

    /// Runs the scene, on the given number of threads; `forget` says whether every step starts without sights.
    fn run(system: &StrandSystem, [head, comb, other]: [&Solid; 3], n_threads: usize, forget: bool) -> (Vec<u64>, u64) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().expect("threads");
        pool.install(|| {
            let (mut state, mut workspace) = (system.rest_state(&turned(0.0)), StepWorkspace::default());
            let (mut trace, mut contacts) = (Vec::new(), 0);
            for k in 0..160 {
                let ([head_from, comb_from], [head_to, comb_to]) = (poses(k), poses(k + 1));
                // Put back in place without a path: over this step it stands still where it is put.
                let comb_from = if (k + 1) % 15 == 0 { comb_to } else { comb_from };
                let on_head = MovingSolid { solid: head, pose: SolidPose { from: head_from, to: head_to } };
                let tool = if k / 10 % 2 == 0 { comb } else { other };
                let in_hand = MovingSolid { solid: tool, pose: SolidPose { from: comb_from, to: comb_to } };
                // Solids come, go, change places and are exchanged for others of the same shape.
                let solids = match k / 5 % 4 {
                    0 => vec![on_head],
                    1 => vec![on_head, in_hand],
                    2 => vec![in_hand, on_head],
                    _ => vec![in_hand],
                };
                if forget {
                    state.batches.iter_mut().for_each(|b| b.sights.clear());
                }
                let input = StepInput { solids: &solids, ..StepInput::carried(DT_S, head_from, head_to) };
                contacts += system.step(&mut state, &input, &StepParams::standard(), &mut workspace).contacts;
                trace.extend(bits(system, &state));
            }
            (trace, contacts)
        })
    }

    #[test]
    fn what_is_remembered_of_solids_changes_no_bit_for_any_number_of_threads() {
        let (system, head, comb) = (strands(), head(), comb());
        // Elsewhere in its own frame, so that a bound that outlived its solid would be wrong.
        let shape = Shape::sphere(v(0.0, 1.0, -1.0), 1.5).into();
        let ball = Solid::from_shape("ball", &shape, 0.1, 1.5, 0.3).expect("a sound shape");
        let solids = [&head, &comb, &ball];
        let (expected, contacts) = run(&system, solids, 1, true);
        assert!(contacts > 1_000, "the scene must meet the solids: {contacts} contacts");
        for n_threads in [1, 2, 8] {
            assert!(run(&system, solids, n_threads, false) == (expected.clone(), contacts), "{n_threads} threads");
        }
    }

    #[test]
    fn a_remembered_sample_never_promises_more_than_a_new_one_finds() {
        for solid in [head(), comb()] {
            let field = &solid.sdf;
            let mut seed = 5_u64;
            let mut random = || {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (seed >> 40) as f32 / (1_u64 << 24) as f32 - 0.5
            };
            let mut kept = 0;
            for _ in 0..200_000 {
                let size = field.bounds().size() * 1.5;
                let p = field.bounds().center() + v(random() * size.x, random() * size.y, random() * size.z);
                let away = v(random(), random(), random()) * 4.0 * (random() + 0.5).powi(4);
                let bound = field.lower_bound(p);
                let promised = bound - field.round_off(bound) - field.steepest() * norm(p + away - p);
                if promised > 0.0 {
                    kept += 1;
                    assert!(promised <= field.lower_bound(p + away), "{p:?} {away:?}");
                }
            }
            assert!(kept > 20_000, "the case must keep bounds often: {kept}");
        }
    }

    #[test]
    fn hair_that_hangs_clear_of_a_solid_that_turns_in_place_is_not_sampled_again() {
        let (system, head) = (strands(), head());
        let (mut state, mut workspace) = (system.rest_state(&turned(0.0)), StepWorkspace::default());
        let far = Isometry3::translation(0.0, 40.0, 0.0);
        let bounds = |state: &StrandState| -> Vec<_> {
            let seen = |b: &crate::system::BatchState| b.sights[0].particles.iter().map(|s| s.at).collect::<Vec<_>>();
            state.batches.iter().map(seen).collect()
        };
        let mut step = |state: &mut StrandState, angle: f64| {
            let pose = SolidPose { from: far, to: far * turned(angle) };
            let solids = [MovingSolid { solid: &head, pose }];
            let input = StepInput { solids: &solids, ..StepInput::still(DT_S, turned(0.0)) };
            system.step(state, &input, &StepParams::standard(), &mut workspace);
        };
        step(&mut state, 0.1);
        let first = bounds(&state);
        for _ in 0..5 {
            step(&mut state, 0.1);
            assert!(bounds(&state) == first);
        }
    }
}
