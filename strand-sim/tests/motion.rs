//! What moves hair from outside: driven and pinned particles, root motion, wind.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::FRAC_1_SQRT_2;
use strand_sim::wind::UniformWind;
use strand_sim::{Drive, Material, RootMotion, StepInput, StepParams, StepWorkspace, StrandState, StrandSystem};

const N_PARTICLES: usize = 25;
const DT_S: f64 = 0.01;
/// A few units in the last place of coordinates of ten centimetres, over a few steps.
const ROUND_OFF_CM: f64 = 1e-10;

/// Hair that hardly resists bending, and that air soon brings to rest.
fn limp() -> Material {
    let straight = Material::straight();
    Material {
        bend_dyn: 1e-4 * straight.bend_dyn,
        twist_dyn: 1e-4 * straight.twist_dyn,
        altitude_dyn: 1e-4 * straight.altitude_dyn,
        air_drag_per_s: 10.0,
        ..straight
    }
}

fn line(from: Vector3<f64>, step: Vector3<f64>) -> Vec<Vector3<f64>> {
    (0..N_PARTICLES).map(|i| from + step * i as f64).collect()
}

struct Run {
    system: StrandSystem,
    state: StrandState,
    params: StepParams,
    workspace: StepWorkspace,
}

impl Run {
    fn new(points: &[Vector3<f64>], material: Material, gravity: f64) -> Self {
        let system = StrandSystem::new(points, N_PARTICLES, material).expect("a sound strand");
        let params = StepParams { gravity: Vector3::new(0.0, -gravity, 0.0), ..StepParams::standard() };
        Self { state: system.rest_state(&Isometry3::identity()), system, params, workspace: StepWorkspace::default() }
    }

    fn step(&mut self, input: &StepInput) -> Vec<Vector3<f64>> {
        let report = self.system.step(&mut self.state, input, &self.params, &mut self.workspace);
        assert_eq!(report.quarantined, 0);
        self.system.positions(&self.state)
    }

    fn velocities(&self) -> Vec<Vector3<f64>> {
        let mut out = vec![Vector3::zeros(); self.system.n_strands() * N_PARTICLES];
        self.system.read(&self.state, |s, i, _, v| out[s * N_PARTICLES + i] = v);
        out
    }
}

#[test]
fn a_driven_particle_is_exactly_where_it_is_told() {
    let points = line(Vector3::zeros(), Vector3::new(0.3, -0.3, 0.0));
    let mut run = Run::new(&points, Material::straight(), 981.0);
    let pose = |t: f64| {
        Isometry3::new(Vector3::new(2.0 * t, (9.0 * t).sin(), -t), Vector3::new(0.3, 1.0, 0.0) * (7.0 * t).sin())
    };
    for k in 0..40 {
        let (t0, t1) = (DT_S * f64::from(k), DT_S * f64::from(k + 1));
        let drive = [Drive { strand: 0, particles: (11, 13), before: pose(t0), after: pose(t1) }];
        let x = run.step(&StepInput { drives: &drive, ..StepInput::still(DT_S, Isometry3::identity()) });
        for i in 11..=13 {
            let told = pose(t1).transform_point(&Point3::from(points[i])).coords;
            assert!((x[i] - told).norm() < ROUND_OFF_CM, "particle {i} is {} cm off", (x[i] - told).norm());
        }
    }
}

#[test]
fn drives_of_one_strand_leave_the_others_alone() {
    let mut points = line(Vector3::zeros(), Vector3::new(0.4, 0.0, 0.0));
    let n = points.len();
    points.extend_from_within(..);
    for p in &mut points[n..] {
        p.z += 3.0;
    }
    let (mut alone, mut driven) =
        (Run::new(&points, Material::straight(), 981.0), Run::new(&points, Material::straight(), 981.0));
    let still = StepInput::still(DT_S, Isometry3::identity());
    for _ in 0..20 {
        let pin = Isometry3::identity();
        let drives = [Drive { strand: 1, particles: (20, 24), before: pin, after: pin }];
        let (a, b) = (alone.step(&still), driven.step(&StepInput { drives: &drives, ..still }));
        assert_eq!(a[..n], b[..n]);
        assert!((a[2 * n - 1] - b[2 * n - 1]).norm() > 0.01, "the pinned strand falls too");
    }
}

/// Sag (cm) of a chain of a given length between two points of one height that are `span` apart.
fn catenary_sag(length: f64, span: f64) -> f64 {
    // 2 c sinh(span / 2c) = length, by bisection: the left side falls in c.
    let (mut low, mut high) = (0.05 * span, 100.0 * span);
    for _ in 0..200 {
        let c = 0.5 * (low + high);
        if 2.0 * c * (0.5 * span / c).sinh() > length { low = c } else { high = c }
    }
    low * ((0.5 * span / low).cosh() - 1.0)
}

#[test]
fn a_strand_pinned_at_both_ends_hangs_as_a_chain() {
    /// A chain of 22 links against its continuous curve, and what bending is left: share of the sag. Measured 0.0001.
    const SHARE: f64 = 0.005;
    const SPACING_CM: f64 = 0.8;
    const MOVED_IN_CM: f64 = 5.0;
    let points = line(Vector3::zeros(), Vector3::x() * SPACING_CM);
    let mut run = Run::new(&points, limp(), 981.0);
    let at = |way: f64| Isometry3::translation(-way, 0.0, 0.0);
    let mut x = Vec::new();
    for k in 0..400 {
        // Half a second to bring the ends together, and then the time to come to rest.
        let way = |k: u32| MOVED_IN_CM * (f64::from(k) / 50.0).min(1.0);
        let drives = [Drive { strand: 0, particles: (23, 24), before: at(way(k)), after: at(way(k + 1)) }];
        x = run.step(&StepInput { drives: &drives, ..StepInput::still(DT_S, Isometry3::identity()) });
    }
    // Two particles are held at either end.
    let (length, span) = (22.0 * SPACING_CM, x[23].x - x[1].x);
    let sag = -x.iter().map(|p| p.y).fold(f64::MAX, f64::min);
    let expected = catenary_sag(length, span);
    let fastest = run.velocities().iter().map(Vector3::norm).fold(0.0, f64::max);
    println!("sag {sag} cm, of the chain {expected} cm; still moving at {fastest} cm/s");
    assert!((sag - expected).abs() < SHARE * expected, "{sag} against {expected}");
    let skew = (1..12).map(|i| (x[12 - i].y - x[12 + i].y).abs()).fold(0.0, f64::max);
    assert!(skew < SHARE * sag, "one side hangs {skew} cm lower");
}

#[test]
fn twisting_a_driven_part_turns_the_hair_beyond_it() {
    const TWIST: f64 = 1.0;
    /// Nothing holds the tail, so it follows the twist; share of it left undone by slow relaxation.
    const SHARE: f64 = 0.05;
    // Straight along x for 6 cm, then off to the side: the tail shows how the straight part is turned.
    let points: Vec<_> = (0..N_PARTICLES)
        .map(|i| {
            let s = 0.4 * i as f64;
            Vector3::new(s.min(6.0), 0.0, (s - 6.0).max(0.0))
        })
        .collect();
    let mut run = Run::new(&points, Material { air_drag_per_s: 10.0, ..Material::straight() }, 0.0);
    let twisted = |a: f64| Isometry3::rotation(Vector3::x() * (TWIST * a));
    let mut x = Vec::new();
    for k in 0..400 {
        let way = |k: u32| (f64::from(k) / 100.0).min(1.0);
        let drives = [Drive { strand: 0, particles: (4, 7), before: twisted(way(k)), after: twisted(way(k + 1)) }];
        x = run.step(&StepInput { drives: &drives, ..StepInput::still(DT_S, Isometry3::identity()) });
    }
    let tip = x[N_PARTICLES - 1];
    // Turning about +x takes +z towards -y.
    let turned = (-tip.y).atan2(tip.z);
    println!("tail turned by {turned} of {TWIST} radian");
    assert!((turned - TWIST).abs() < SHARE * TWIST, "{turned}");
}

#[test]
fn root_frames_that_agree_are_a_head_to_the_last_bit() {
    let mut points = line(Vector3::zeros(), Vector3::new(0.3, -0.3, 0.0));
    points.extend(line(Vector3::new(1.0, 0.0, 2.0), Vector3::new(0.0, -0.4, 0.1)));
    let (mut by_head, mut by_frames) =
        (Run::new(&points, Material::straight(), 981.0), Run::new(&points, Material::straight(), 981.0));
    let pose = |k: u32| Isometry3::new(Vector3::x() * (0.1 * f64::from(k)), Vector3::y() * (0.05 * f64::from(k)));
    for k in 0..20 {
        let carried = StepInput::carried(DT_S, pose(k), pose(k + 1));
        let (before, after) = ([pose(k); 2], [pose(k + 1); 2]);
        let framed = StepInput { roots: RootMotion::Frames { before: &before, after: &after }, ..carried };
        assert_eq!(by_head.step(&carried), by_frames.step(&framed));
    }
}

#[test]
fn each_root_frame_moves_its_own_strand_only() {
    let mut points = line(Vector3::zeros(), Vector3::new(0.0, -0.4, 0.0));
    points.extend(line(Vector3::new(3.0, 0.0, 0.0), Vector3::new(0.0, -0.4, 0.0)));
    // Without gravity a strand at rest whose frame stands still has no reason to move.
    let mut run = Run::new(&points, Material::straight(), 0.0);
    let still = Isometry3::identity();
    let mut x = Vec::new();
    for k in 0..20 {
        let at = |k: u32| Isometry3::translation(0.0, 0.0, 0.05 * f64::from(k));
        let (before, after) = ([still, at(k)], [still, at(k + 1)]);
        let roots = RootMotion::Frames { before: &before, after: &after };
        x = run.step(&StepInput { roots, ..StepInput::still(DT_S, still) });
    }
    for (now, rest) in x[..N_PARTICLES].iter().zip(&points) {
        assert!((now - rest).norm() < ROUND_OFF_CM);
    }
    assert!((x[N_PARTICLES] - points[N_PARTICLES] - Vector3::z()).norm() < ROUND_OFF_CM);
}

#[test]
fn wind_drags_along_the_fibre_half_as_much_as_across() {
    /// A substep is backward Euler in the drag, and springs have hardly answered: share of the velocity.
    const SHARE: f64 = 1e-3;
    const INSTANT_S: f64 = 1e-5;
    const WIND_CM_PER_S: f64 = 100.0;
    let material = Material::straight();
    let tip_velocity = |wind: Vector3<f64>| {
        let mut run = Run::new(&line(Vector3::zeros(), Vector3::x() * 0.8), material, 0.0);
        let air = UniformWind(wind);
        run.step(&StepInput { wind: Some(&air), ..StepInput::still(INSTANT_S, Isometry3::identity()) });
        run.velocities()[N_PARTICLES - 1]
    };
    let across = tip_velocity(Vector3::y() * WIND_CM_PER_S);
    let along = tip_velocity(Vector3::x() * WIND_CM_PER_S);
    let expected = WIND_CM_PER_S * material.air_drag_per_s * INSTANT_S;
    println!("after {INSTANT_S} s: {} cm/s across, {} cm/s along, {expected} cm/s expected across", across.y, along.x);
    assert!((across.y - expected).abs() < SHARE * expected);
    assert!((along.x - 0.5 * expected).abs() < SHARE * expected);
    // A skew wind moves hair askew of itself: the along part counts half.
    let skew = tip_velocity(Vector3::new(1.0, 1.0, 0.0) * (WIND_CM_PER_S * FRAC_1_SQRT_2));
    assert!((skew.x / skew.y - 0.5).abs() < SHARE);
}

#[test]
fn limp_hair_streams_out_along_a_steady_wind() {
    /// Cosine of the angle between hair and wind; the root's clamped part points elsewhere.
    const ALIGNED: f64 = 0.95;
    const OFF_PLANE_CM: f64 = 0.1;
    let wind = Vector3::new(0.6, 0.0, 0.8);
    let mut run = Run::new(&line(Vector3::zeros(), Vector3::new(0.0, -0.4, 0.0)), limp(), 0.0);
    let air = UniformWind(wind * 200.0);
    let mut x = Vec::new();
    for _ in 0..300 {
        x = run.step(&StepInput { wind: Some(&air), ..StepInput::still(DT_S, Isometry3::identity()) });
    }
    let tail = (x[24] - x[8]).normalize();
    println!("cosine of the angle between the tail and the wind: {}", tail.dot(&wind));
    assert!(tail.dot(&wind) > ALIGNED);
    // Nothing in the scene points out of the plane of the rest shape and the wind but the rig's perturbed particles.
    let across = Vector3::y().cross(&wind);
    let off = x.iter().map(|p| p.dot(&across).abs()).fold(0.0, f64::max);
    println!("{off} cm out of the plane");
    assert!(off < OFF_PLANE_CM, "{off}");
}

#[test]
fn hair_carried_with_the_wind_comes_to_feel_none() {
    /// What is left of the start, after three seconds of a relaxation ten times a second.
    const LEFT_CM: f64 = 1e-3;
    let points = line(Vector3::zeros(), Vector3::new(0.2, -0.3, 0.0));
    let wind = Vector3::new(0.0, 0.0, 50.0);
    let air = UniformWind(wind);
    let at =
        |k: u32| Isometry3::from_parts(Translation3::from(wind * (DT_S * f64::from(k))), UnitQuaternion::identity());
    let material = Material { air_drag_per_s: 10.0, ..Material::straight() };
    let mut run = Run::new(&points, material, 0.0);
    let mut x = Vec::new();
    for k in 0..300 {
        x = run.step(&StepInput { wind: Some(&air), ..StepInput::carried(DT_S, at(k), at(k + 1)) });
    }
    let left = x
        .iter()
        .zip(&points)
        .map(|(x, rest)| (x - at(300).transform_point(&Point3::from(*rest)).coords).norm())
        .fold(0.0, f64::max);
    println!("{left} cm from rest in the moving frame");
    assert!(left < LEFT_CM, "{left}");
}
