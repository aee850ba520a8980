//! Laws of rest lengths that hold a style: no sag where the fibre can bear its weight, and no pretence where it cannot.

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
