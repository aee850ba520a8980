//! Strands and surfaces that nothing may go through (MS08 §5.1): a tooth too fast for any straight way past it.

use collision::SolidPose;
use collision::segment_pair::{Sweep, between};
use collision::surface::{MovingSurface, Surface};
use nalgebra::{Isometry3, Point3, Vector3};
use strand_sim::interaction::LinkSet;
use strand_sim::{
    InteractionParams, InteractionWorkspace, Material, StepInput, StepParams, StepReport, StepWorkspace, StrandState,
    StrandSystem, Substeps,
};

const DT_S: f64 = 0.005;
const PARTICLES: usize = 13;
/// Two runs whose poses differ by round-off: far above what that grows to in a step, far below any way in it (cm).
const SAME_CM: f64 = 1e-9;

/// A tooth of a millimetre, short enough along z for one strand, at the end of an arm of three millimetres and a half.
fn tooth() -> Surface {
    let half = [0.05, 0.05, 0.1];
    let corner = |c: i32| [0, 1, 2].map(|k| if c >> k & 1 == 1 { half[k] } else { -half[k] });
    let points: Vec<_> = (0..8).map(corner).map(|[x, y, z]| [x, y - 0.35, z]).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles: Vec<_> = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    Surface::new(&points, &triangles).expect("a sound mesh")
}

/// Half a turn about the last held particle of the first strand, from one side of the hair below round to the other.
fn round_the_held_end() -> SolidPose {
    let turned = |angle: f64| Isometry3::new(Vector3::new(0.0, -1.0, 0.0), Vector3::z() * angle);
    SolidPose { from: turned(-0.5), to: turned(2.6) }
}

/// Strands that hang from y = 0, a centimetre a particle, three millimetres apart along z.
fn hanging(strands: usize) -> StrandSystem {
    let points: Vec<_> = (0..strands)
        .flat_map(|s| (0..PARTICLES).map(move |i| Vector3::new(0.0, -(i as f64), 0.3 * s as f64)))
        .collect();
    StrandSystem::new(&points, PARTICLES, Material::straight()).expect("a sound scene")
}

fn params() -> StepParams {
    StepParams { substeps: Substeps::Fixed(1), ..StepParams::standard() }
}

fn part(pose: &SolidPose, k: usize, pieces: usize) -> SolidPose {
    let at = |k: usize| pose.at(k as f64 / pieces as f64);
    SolidPose { from: at(k), to: at(k + 1) }
}

/// The step in so many pieces, by hand.
fn in_pieces(system: &StrandSystem, state: &mut StrandState, tooth: &Surface, pieces: usize) -> Vec<StepReport> {
    let mut workspace = StepWorkspace::default();
    let mut one = |k: usize| {
        let surfaces = [MovingSurface { surface: tooth, pose: part(&round_the_held_end(), k, pieces) }];
        let input = StepInput { surfaces: &surfaces, ..StepInput::still(DT_S / pieces as f64, Isometry3::identity()) };
        system.step(state, &input, &params(), &mut workspace)
    };
    (0..pieces).map(&mut one).collect()
}

/// Whether a segment that goes straight is in the tooth at any of a thousand times.
fn is_met(tooth: &Surface, pose: &SolidPose, sweep: &Sweep) -> bool {
    (0..=1_000).map(|k| f64::from(k) / 1_000.0).any(|time| {
        let pose = pose.at(time);
        let seen = between(&sweep.start, &sweep.end, time);
        tooth.is_hit_by(&seen.map(|x| pose.inverse_transform_point(&Point3::from(x)).coords))
    })
}

#[test]
fn a_strand_that_no_straight_way_takes_past_a_tooth_goes_where_smaller_steps_lead() {
    let (system, tooth) = (hanging(1), tooth());
    let mut state = system.rest_state(&Isometry3::identity());
    let report = in_pieces(&system, &mut state, &tooth, 1);
    assert_eq!((report[0].refined, report[0].passing), (1, 0), "{report:?}");

    let (pieces, by_hand) = [4, 16, 64, 256]
        .into_iter()
        .find_map(|pieces| {
            let mut state = system.rest_state(&Isometry3::identity());
            let reports = in_pieces(&system, &mut state, &tooth, pieces);
            reports.iter().all(|r| r.refined == 0).then_some((pieces, state))
        })
        .expect("some number of pieces is fine enough");
    let (ours, theirs) = (system.positions(&state), system.positions(&by_hand));
    let off = ours.iter().zip(&theirs).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    assert!(off < SAME_CM, "{off} cm from what {pieces} pieces give");
    assert!(ours.iter().any(|x| x.x > 1.0), "the strand was hardly pushed: {ours:?}");

    // And every one of those ways is free.
    let mut state = system.rest_state(&Isometry3::identity());
    let mut workspace = StepWorkspace::default();
    for k in 0..pieces {
        let before = system.positions(&state);
        let pose = part(&round_the_held_end(), k, pieces);
        let surfaces = [MovingSurface { surface: &tooth, pose }];
        let input = StepInput { surfaces: &surfaces, ..StepInput::still(DT_S / pieces as f64, Isometry3::identity()) };
        system.step(&mut state, &input, &params(), &mut workspace);
        let after = system.positions(&state);
        for i in 0..PARTICLES - 1 {
            let sweep = Sweep { start: [before[i], before[i + 1]], end: [after[i], after[i + 1]] };
            assert!(!is_met(&tooth, &pose, &sweep), "segment {i} of piece {k}");
        }
    }
}

#[test]
fn no_strand_feels_that_another_goes_in_pieces() {
    let (system, tooth) = (hanging(5), tooth());
    let mut with = system.rest_state(&Isometry3::identity());
    let report = in_pieces(&system, &mut with, &tooth, 1);
    assert_eq!((report[0].refined, report[0].passing), (1, 0), "the tooth meets the first strand only: {report:?}");
    let mut without = system.rest_state(&Isometry3::identity());
    let params = params();
    system.step(&mut without, &StepInput::still(DT_S, Isometry3::identity()), &params, &mut StepWorkspace::default());
    assert_eq!(system.positions(&with)[PARTICLES..], system.positions(&without)[PARTICLES..]);

    let alone = hanging(1);
    let mut state = alone.rest_state(&Isometry3::identity());
    in_pieces(&alone, &mut state, &tooth, 1);
    assert_eq!(system.positions(&with)[..PARTICLES], alone.positions(&state)[..]);
}

#[test]
fn strands_that_meet_each_other_go_through_no_tooth_either() {
    let (system, tooth) = (hanging(5), tooth());
    let mut state = system.rest_state(&Isometry3::identity());
    let surfaces = [MovingSurface { surface: &tooth, pose: round_the_held_end() }];
    let input = StepInput { surfaces: &surfaces, ..StepInput::still(DT_S, Isometry3::identity()) };
    let report = system.step_interacting(
        &mut state,
        &mut LinkSet::default(),
        &input,
        &params(),
        &InteractionParams::dry(),
        &mut InteractionWorkspace::default(),
    );
    assert_eq!((report.step.refined, report.step.passing), (1, 0), "{report:?}");
    assert!(system.positions(&state)[..PARTICLES].iter().any(|x| x.x > 1.0));
}
