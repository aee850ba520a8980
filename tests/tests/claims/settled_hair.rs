//! Hair that has settled on a head starts in equilibrium: rest lengths are found that hold every strand where it came to lie.

use collision::{MovingSolid, Solid, SolidPose};
use hair_bench::grooms::{GroomParams, Style, generate};
use hair_bench::shapes;
use hair_tests::scenes::DT;
use nalgebra::{Isometry3, Vector3};
use strand_sim::{Material, RestReport, StepInput, StepParams, StepWorkspace, StrandState, StrandSystem};

const N_PARTICLES: usize = 25;
const N_STRANDS: usize = 300;

/// Air drag while settling, 1/s.
const DRAG: f64 = 8.0;

fn step_for(seconds: f64, system: &StrandSystem, state: &mut StrandState, head: &MovingSolid) {
    let (params, mut workspace) = (StepParams::standard(), StepWorkspace::default());
    let solids = [*head];
    let input = StepInput { solids: &solids, ..StepInput::still(DT, Isometry3::identity()) };
    for _ in 0..(seconds / DT).round() as usize {
        system.step(state, &input, &params, &mut workspace);
    }
}

struct Settled {
    report: RestReport,
    /// Root mean square distance of all particles from the settled shape after half a second, cm.
    moved_cm: f64,
}

fn settle(style: Style, head: &Solid) -> Settled {
    let params = StepParams::standard();
    let groom = GroomParams { style, strands: N_STRANDS, particles: N_PARTICLES, length_cm: 25.0, seed: 1, head };
    let points: Vec<_> = generate(&groom).unwrap().points.iter().map(|&p| Vector3::from(p).cast()).collect();
    let still = MovingSolid { solid: head, pose: SolidPose::still(Isometry3::identity()) };
    let upright = Isometry3::identity();
    let material = if style == Style::Straight { Material::straight() } else { Material::wavy() };
    let mut system = StrandSystem::new(&points, N_PARTICLES, Material { air_drag_per_s: DRAG, ..material }).unwrap();
    let mut state = system.rest_state(&upright);
    system.balance(&mut state, &upright, &[still], &params);
    step_for(2.0, &system, &mut state, &still);
    let rest = system.positions(&state);
    let mut system = StrandSystem::new(&points, N_PARTICLES, material).unwrap();
    let (mut state, report) = system.hold_settled(&rest, &[still], &params).unwrap();
    step_for(0.5, &system, &mut state, &still);
    let now = system.positions(&state);
    let squares: f64 = now.iter().zip(&rest).map(|(a, b)| (a - b).norm_squared()).sum();
    Settled { report, moved_cm: (squares / now.len() as f64).sqrt() }
}

#[test]
fn hair_that_has_settled_on_a_head_is_held_there() {
    /// Strands given up: measured 6 of 300 straight and one wavy, bent where they buckle. With perturbed particles where they
    /// are placed 17 were, with residuals of 4e5 weights.
    const GIVEN_UP: usize = 6;
    /// Residual of all particles, weights: measured 0.9 and 0.2, all of it in strands given up.
    const RESIDUAL: f64 = 1.5;
    /// Root mean square movement in half a second: measured 0.008 and 0.009 cm.
    const MOVED_CM: f64 = 0.015;
    let head = shapes::head().unwrap();
    for style in [Style::Straight, Style::Wavy] {
        let Settled { report, moved_cm } = settle(style, &head);
        println!("{style:?}: {report:?}, moved by {moved_cm} cm");
        assert!(report.given_up <= GIVEN_UP && report.held + report.given_up == N_STRANDS, "{style:?}: {report:?}");
        assert!(report.residual_after < RESIDUAL && report.residual_after < report.residual_before, "{report:?}");
        assert!(moved_cm < MOVED_CM, "{style:?}: {moved_cm} cm");
    }
}
