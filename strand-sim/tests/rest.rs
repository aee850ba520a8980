//! Laws of rest lengths that hold a style: no sag where the fibre can bear its weight, and no pretence where it cannot.

use collision::{MovingSolid, Shape, Solid, SolidPose};
use nalgebra::{Isometry3, Vector3};
use strand_sim::{Material, RestReport, StepInput, StepParams, StepWorkspace, StrandSystem};

const N: usize = 25;

/// Hanging strands with waves: `amplitude` cm across, roots a centimetre apart.
fn waves(n_strands: usize, amplitude: f64) -> Vec<Vector3<f64>> {
    (0..n_strands)
        .flat_map(|s| {
            let phase = 0.7 * s as f64;
            (0..N).map(move |i| {
                let t = i as f64 / (N - 1) as f64;
                let across = amplitude * t.min(0.2) * 5.0;
                let angle = 14.0 * t + phase;
                Vector3::new(s as f64 + across * angle.sin(), -20.0 * t, across * angle.cos())
            })
        })
        .collect()
}

/// Strands that stand out sideways, `length` cm.
fn arms(length: f64) -> Vec<Vector3<f64>> {
    (0..N).map(|i| Vector3::new(length * i as f64 / (N - 1) as f64, 0.0, 0.0)).collect()
}

struct Held {
    report: Option<RestReport>,
    first_step_cm: f64,
    second_cm: f64,
}

/// How far hair is from its style after a step and after a second.
fn hold(points: &[Vector3<f64>], material: Material, balanced: bool) -> Held {
    let head = Isometry3::identity();
    let params = StepParams::standard();
    let mut system = StrandSystem::new(points, N, material).expect("valid strands");
    let mut state = system.rest_state(&head);
    let report = balanced.then(|| system.balance(&mut state, &head, &[], &params));
    let mut workspace = StepWorkspace::default();
    let off = |state: &_| {
        let positions = system.positions(state);
        positions.iter().zip(points).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    };
    system.step(&mut state, &StepInput::still(0.01, head), &params, &mut workspace);
    let first_step_cm = off(&state);
    for _ in 0..99 {
        system.step(&mut state, &StepInput::still(0.01, head), &params, &mut workspace);
    }
    Held { report, first_step_cm, second_cm: off(&state) }
}

#[test]
fn a_wavy_groom_that_is_balanced_does_not_sag() {
    /// A tenth of a hair's thickness in the first step; then what round-off and the strain limit leave.
    const STILL_CM: f64 = 1e-3;
    const SECOND_CM: f64 = 1e-2;
    let points = waves(6, 0.8);
    let (free, held) = (hold(&points, Material::wavy(), false), hold(&points, Material::wavy(), true));
    let report = held.report.expect("balanced");
    println!(
        "{report:?}; first step {} and {} cm; a second {} and {} cm",
        free.first_step_cm, held.first_step_cm, free.second_cm, held.second_cm
    );
    assert_eq!(report.given_up, 0);
    assert!(report.residual_before > 0.5 && report.residual_after < 1e-3, "{report:?}");
    assert!(held.first_step_cm < STILL_CM && held.second_cm < SECOND_CM);
    assert!(free.second_cm > 20.0 * SECOND_CM, "unbalanced hair was to sag");
}

#[test]
fn a_short_bristle_stands_and_a_long_arm_is_given_up() {
    let (short, long) = (arms(1.5), arms(25.0));
    let (stands, falls) = (hold(&short, Material::straight(), true), hold(&long, Material::straight(), true));
    println!("{:?} {} cm; {:?} {} cm", stands.report, stands.second_cm, falls.report, falls.second_cm);
    assert_eq!(stands.report.expect("balanced").held, 1);
    assert!(stands.second_cm < 1e-3, "{}", stands.second_cm);
    let report = falls.report.expect("balanced");
    assert_eq!(report.given_up, 1);
    assert!(report.residual_after > 0.1, "what cannot be held is reported: {report:?}");
}

#[test]
fn what_a_partly_supported_strand_lacks_is_the_share_that_springs_do_not_carry() {
    /// Round-off of solves with springs of 3e5 dyn and supports of 1e3 dyn/cm, over a residual of weights.
    const ROUND_OFF: f64 = 1e-9;
    /// What the refinements leave of a strand that is held where it presses on a support: measured 0.007.
    const HELD: f64 = 0.01;
    const MISSING: [f64; 5] = [0.25, 0.5, 0.75, 0.875, 1.0];
    let shape = Shape::sphere(Vector3::zeros(), 1.0);
    let ball = Solid::from_shape("ball", &shape.into(), 0.1, 1.0, 0.0).expect("a ball can be baked");
    let head = Isometry3::identity();
    let params = StepParams::standard();
    let mut in_part = 0;
    for length in [6.0, 9.0, 12.0, 18.0, 25.0] {
        // The ball bears the arm a fifth of the way out, so that the linear solve presses on it with many weights.
        let below = Vector3::new(0.2 * length, -1.0 - params.contact.offset_cm, 0.0);
        let moving =
            [MovingSolid { solid: &ball, pose: SolidPose::still(Isometry3::translation(below.x, below.y, 0.0)) }];
        let mut system = StrandSystem::new(&arms(length), N, Material::straight()).expect("valid strands");
        let mut state = system.rest_state(&head);
        let report = system.balance(&mut state, &head, &moving, &params);
        println!("{length} cm: {report:?}");
        let missing = report.residual_after / report.residual_before;
        if report.held == 1 {
            assert!(missing < HELD, "{report:?}");
        } else {
            assert!(MISSING.iter().any(|m| (missing - m).abs() < ROUND_OFF), "{length} cm: {missing}");
            in_part += 1;
        }
    }
    assert!(in_part > 0, "some arm was to be too long to be held");
}

#[test]
fn a_settled_shape_is_kept_and_its_state_carried_rigidly() {
    /// What round-off and the strain limit leave in half a second of hanging still, cm.
    const STILL_CM: f64 = 1e-3;
    let (styled, params) = (waves(4, 0.8), StepParams::standard());
    let upright = Isometry3::identity();
    let material = Material { air_drag_per_s: 8.0, ..Material::wavy() };
    let mut system = StrandSystem::new(&styled, N, material).expect("valid strands");
    let (mut state, mut workspace) = (system.rest_state(&upright), StepWorkspace::default());
    for _ in 0..300 {
        system.step(&mut state, &StepInput::still(0.01, upright), &params, &mut workspace);
    }
    let settled = system.positions(&state);
    let off = |system: &StrandSystem, state: &_, rest: &[Vector3<f64>]| {
        system.positions(state).iter().zip(rest).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    };
    assert!(off(&system, &state, &styled) > 0.1, "the hair was to sag");
    let (mut held, report) = system.hold_settled(&settled, &[], &params).expect("the same particles");
    assert_eq!(report.given_up, 0, "{report:?}");
    assert_eq!(off(&system, &held, &settled), 0.0, "a settled shape is kept to the bit");
    for _ in 0..50 {
        system.step(&mut held, &StepInput::still(0.01, upright), &params, &mut workspace);
    }
    let moved = off(&system, &held, &settled);
    println!("{report:?}, moved by {moved} cm");
    assert!(moved < STILL_CM, "{moved}");
    let there = Isometry3::new(Vector3::new(3.0, -2.0, 5.0), Vector3::y() * 0.7);
    let expected: Vec<_> = system.positions(&held).iter().map(|p| there.transform_point(&(*p).into()).coords).collect();
    assert!(off(&system, &held.carried(&there), &expected) < 1e-12);
}
