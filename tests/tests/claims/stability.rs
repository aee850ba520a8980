//! What the integrator of MS08 §4 keeps in hand: any step up to a frame, any stiffness, a head shaken for a hundred seconds; and
//! that directions frozen over a step make backward Euler lose energy, always (MS08 §4.1).

use hair_tests::scenes::{DT, N_PARTICLES, Tuft, helix, mixed_strands, straight};
use hair_tests::shared_data;
use io_formats::{Bvh, MotionEnd, PoseMotion};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use strand_sim::reference::PlainStrand;
use strand_sim::{Material, StepInput, StepParams, StepWorkspace, StrandSystem};

/// Farthest a particle may be from its root, as a multiple of the strand's length: strain limiting leaves one in a hundred.
const REACH: f64 = 1.1;

/// Largest stretch of a segment allowed in a hundred seconds of shaking; strain limiting leaves one in a hundred.
const STRETCH: f64 = 0.1;

/// Length of each strand, cm.
fn lengths(points: &[Vector3<f64>]) -> Vec<f64> {
    points.chunks(N_PARTICLES).map(|s| s.windows(2).map(|w| (w[1] - w[0]).norm()).sum()).collect()
}

/// Shaken from side to side, 2 g at 2 Hz, while it nods.
fn shaken(t: f64) -> Isometry3<f64> {
    let phase = std::f64::consts::TAU * 2.0 * t;
    let aside = Translation3::new(12.4 * (1.0 - phase.cos()), 0.0, 0.0);
    Isometry3::from_parts(aside, UnitQuaternion::from_scaled_axis(Vector3::new(0.4, 0.7, 0.0) * phase.sin()))
}

/// Hair whose springs are all `factor` times those of straight hair.
fn scaled(factor: f64) -> Material {
    let m = Material::straight();
    Material {
        stretch_dyn: factor * m.stretch_dyn,
        bend_dyn: factor * m.bend_dyn,
        twist_dyn: factor * m.twist_dyn,
        altitude_dyn: factor * m.altitude_dyn,
        ..m
    }
}

/// Strands at rest, shaken in steps of `dt`: nothing is put back at rest and nothing leaves its root's reach.
fn check_bounded(points: &[Vector3<f64>], dt: f64, stretch_dyn: f64, seconds: f64) {
    let material = scaled(stretch_dyn / Material::straight().stretch_dyn);
    let system = StrandSystem::new(points, N_PARTICLES, material).unwrap();
    let (params, mut workspace) = (StepParams::standard(), StepWorkspace::default());
    let mut state = system.rest_state(&shaken(0.0));
    let reach: Vec<_> = lengths(points).iter().map(|l| REACH * l).collect();
    for k in 0..(seconds / dt).ceil() as usize {
        let (before, after) = (shaken(dt * k as f64), shaken(dt * (k + 1) as f64));
        let report = system.step(&mut state, &StepInput::carried(dt, before, after), &params, &mut workspace);
        assert_eq!(report.quarantined, 0, "step {k} of {dt} s, {stretch_dyn} dyn");
        let mut root = Vector3::zeros();
        system.read(&state, |s, i, x, v| {
            if i == 0 {
                root = x;
            }
            let far = (x - root).norm();
            // Not a number fails too.
            assert!(
                far <= reach[s],
                "strand {s}, particle {i} is {far} cm off after step {k} of {dt} s, {stretch_dyn} dyn"
            );
            assert!(v.iter().all(|c| c.is_finite()));
        });
    }
}

#[test]
fn hair_of_any_stiffness_is_bounded_at_any_step() {
    let tuft: Vec<_> =
        [straight(Vector3::zeros(), Vector3::new(1.0, -1.0, 0.2)), helix(Vector3::new(3.0, 0.0, 0.0))].concat();
    for stretch_dyn in [1e3, 1e4, 1e5, 1e6, 1e7, 1e8] {
        for (dt, seconds) in [(1e-4, 0.2), (1e-3, 1.0), (1e-2, 5.0), (1.0 / 24.0, 10.0)] {
            check_bounded(&tuft, dt, stretch_dyn, seconds);
        }
    }
}

/// Change of the energy of the linear model over one step, and its scale: kinetic energy and that of springs whose directions
/// are those of the step's start.
fn energy_change(strand: &mut PlainStrand, h: f64, params: &StepParams) -> (f64, f64) {
    // Momentum and the impulse of springs; without damping a term's coefficient is h² k / l0.
    let (right_side, terms) = (strand.right_side(h, Vector3::zeros()), strand.spring_terms(h));
    let altitudes = strand.altitude_terms(h);
    let (mass, old) = (strand.masses().to_vec(), strand.velocities().to_vec());
    strand.step(h, &Isometry3::identity(), params);
    let new = strand.velocities();
    let kinetic = |v: &[Vector3<f64>]| mass.iter().zip(v).map(|(m, v)| 0.5 * m * v.norm_squared()).sum::<f64>();
    let impulses = right_side.iter().zip(&mass).zip(&old).map(|((r, m), v)| r - v * *m);
    let done_by_springs: f64 = impulses.zip(new).map(|(impulse, v)| impulse.dot(v)).sum();
    let at = |p: usize| new.get(p).copied().unwrap_or_default();
    let stiffening: f64 = terms.iter().map(|t| 0.5 * t.along * t.direction.dot(&(at(t.b) - at(t.a))).powi(2)).sum();
    // Altitude springs are of the same form, their candidate frozen with their direction.
    let (mut done_by_altitudes, mut stiffened) = (0.0, stiffening);
    for t in &altitudes {
        let rate: f64 = t.corners.iter().zip(&t.slope).map(|(&p, slope)| slope.dot(&at(p))).sum();
        done_by_altitudes -= t.pull * rate;
        stiffened += 0.5 * t.along * rate * rate;
    }
    let change = kinetic(new) - kinetic(&old) - done_by_springs - done_by_altitudes + stiffened;
    (change, kinetic(new) + kinetic(&old) + done_by_springs.abs() + done_by_altitudes.abs() + stiffened)
}

#[test]
fn with_directions_frozen_backward_euler_never_gains_energy() {
    /// Round-off of a banded solve whose springs differ 1e4-fold, as a share of the energies that the sum is of.
    const ROUND_OFF: f64 = 1e-9;
    const SHAKES: usize = 20;
    let undamped = Material {
        stretch_damping: 0.0,
        bend_damping: 0.0,
        twist_damping: 0.0,
        altitude_damping: 0.0,
        air_drag_per_s: 0.0,
        ..Material::straight()
    };
    let points = mixed_strands(3);
    let system = StrandSystem::new(&points, N_PARTICLES, undamped).unwrap();
    let params = StepParams { gravity: Vector3::zeros(), strain_limit: f64::INFINITY, ..StepParams::standard() };
    let mut rng = Pcg64Mcg::seed_from_u64(11);
    let (mut steps, mut lost) = (0, 0);
    for shake in 0..SHAKES {
        // Random shapes, springs stretched and pressed by up to a third, that random velocities grow from.
        // The root stands still: whoever moves it does work.
        let moved = |(i, p): (usize, &Vector3<f64>)| {
            p + Vector3::from_fn(|_, _| if i % N_PARTICLES < 3 { 0.0 } else { rng.random_range(-0.15..0.15) })
        };
        let shape: Vec<_> = points.iter().enumerate().map(moved).collect();
        let state = system.state_of_shape(&shape, &Isometry3::identity()).unwrap();
        for s in 0..3 {
            for h in [1e-4, 1e-3, 1e-2, 1.0 / 24.0] {
                let mut strand = PlainStrand::of(&system, &state, s);
                for step in 0..20 {
                    let (change, scale) = energy_change(&mut strand, h, &params);
                    assert!(
                        change <= ROUND_OFF * scale,
                        "shake {shake}, strand {s}, step {step} of {h} s: {change} of {scale}"
                    );
                    steps += 1;
                    lost += usize::from(change < -0.01 * scale);
                }
            }
        }
    }
    assert!(lost > steps / 2, "energy was to be lost: {lost} of {steps}");
}

/// Turns at the given speed about an axis that is drawn anew every so often.
struct Violent {
    rng: Pcg64Mcg,
    axis: Vector3<f64>,
    left_s: f64,
    head: Isometry3<f64>,
}

impl Violent {
    const SPEED: f64 = 1300.0 * std::f64::consts::PI / 180.0;

    fn new(seed: u64) -> Self {
        Self { rng: Pcg64Mcg::seed_from_u64(seed), axis: Vector3::y(), left_s: 0.0, head: Isometry3::identity() }
    }

    fn next(&mut self) -> Isometry3<f64> {
        if self.left_s <= 0.0 {
            let turn = Vector3::from_fn(|_, _| self.rng.random_range(-1.0..1.0));
            self.axis = turn.try_normalize(1e-6).unwrap_or_else(Vector3::y);
            self.left_s = self.rng.random_range(0.05..0.3);
        }
        self.left_s -= DT;
        let turn = UnitQuaternion::from_scaled_axis(self.axis * (Self::SPEED * DT));
        self.head.rotation = UnitQuaternion::new_normalize((turn * self.head.rotation).into_inner());
        self.head
    }
}

/// A hundred seconds of a motion in steps of 10 ms on 32 strands around a head.
fn check_endures(mut pose_at_step: impl FnMut(usize) -> Isometry3<f64>) {
    let points: Vec<_> = mixed_strands(32)
        .chunks(N_PARTICLES)
        .enumerate()
        .flat_map(|(s, strand)| {
            // Roots on a ball of 9 cm, hair turned to stand out from it.
            let angle = 2.4 * s as f64;
            let out = Vector3::new(angle.cos(), 1.0 - s as f64 / 16.0, angle.sin()).normalize();
            let turn = UnitQuaternion::rotation_between(&-Vector3::y(), &out).unwrap_or_default();
            strand.iter().map(|p| out * 9.0 + turn * (p - strand[0])).collect::<Vec<_>>()
        })
        .collect();
    let mut tuft = Tuft::new(&points, Material::straight(), StepParams::standard());
    let rest: Vec<_> = points.windows(2).map(|w| (w[1] - w[0]).norm()).collect();
    let (mut longest, mut fastest): (f64, f64) = (0.0, 0.0);
    for k in 1..=10_000 {
        let report = tuft.step(pose_at_step(k), &[]);
        assert_eq!(report.quarantined, 0, "step {k}");
        let mut before = Vector3::zeros();
        tuft.system.read(&tuft.state, |s, i, x, v| {
            assert!(x.iter().chain(v.iter()).all(|c| c.is_finite()), "strand {s}, particle {i}, step {k}");
            if i > 0 {
                longest = longest.max((x - before).norm() / rest[s * N_PARTICLES + i - 1] - 1.0);
            }
            before = x;
            fastest = fastest.max(v.norm());
        });
    }
    assert!(longest < STRETCH, "stretched by {longest} at {fastest} cm/s");
    assert!(fastest > 100.0, "the hair was to be shaken");
}

#[test]
fn hair_endures_a_hundred_seconds_of_turning_at_1300_degrees_a_second() {
    let mut head = Violent::new(5);
    check_endures(|_| head.next());
}

#[test]
fn hair_endures_a_hundred_seconds_of_a_recorded_kick() {
    let Some(path) = shared_data("motion/bandai_kick_normal_001.bvh") else { return };
    let bvh = Bvh::read(&path).unwrap();
    let head = bvh.joint_index("Head").unwrap();
    let motion = PoseMotion::from_bvh(&bvh, head, 1.0, 0, Vector3::new(0.0, -8.0, 0.0), MotionEnd::Hold).unwrap();
    let duration = motion.duration_s();
    // Forth and back, so that the loop has no jump.
    check_endures(|k| {
        let t = (k as f64 * DT) % (2.0 * duration);
        motion.pose_at(t.min(2.0 * duration - t))
    });
}
