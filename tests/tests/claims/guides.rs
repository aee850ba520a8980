//! Laws of the guides of a runtime (AS16 §7.1): what they meet, what becomes of them when a head is put elsewhere, and the
//! integrator that AS16 §7.2 compares with.

use adaptive_runtime::{DftlParams, GuideIntegrator, Runtime, RuntimeParams, StepInput};
use collision::{BakeParams, DeformingSolid, KeyedMesh, MovingDeformingSolid, Solid, SolidPose};
use hair_tests::models::{N_PARTICLES, Row};
use hair_tests::scenes::rod;
use hair_tests::tolerance::SINGLE_ROUND_OFF_CM;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use strand_sim::InteractionParams;

const DT: f64 = 0.01;

type Triangles = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// A box of given half-widths about the origin, counter-clockwise from outside.
fn cuboid(half: [f32; 3]) -> Triangles {
    let corner = |k: usize| [0, 1, 2].map(|c| if k >> c & 1 == 1 { half[c] } else { -half[c] });
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]: &[u32; 4]| [[a, b, c], [a, c, d]]).collect();
    ((0..8).map(corner).collect(), triangles)
}

fn at(x: f64, y: f64, z: f64) -> Isometry3<f64> {
    Translation3::new(x, y, z).into()
}

fn runtime(params: RuntimeParams, solids: Vec<Solid>, poses: &[Isometry3<f64>]) -> Runtime {
    Runtime::new(Row::parted().model(), params, Isometry3::identity(), None, solids, poses).unwrap()
}

fn step(runtime: &mut Runtime, head: Isometry3<f64>, poses: &[Isometry3<f64>]) {
    runtime.step(&StepInput { dt: DT, world_from_head: head, world_from_solids: poses });
}

/// Where each guide is at a height, z in cm.
fn crossings(runtime: &Runtime, y: f32) -> Vec<f32> {
    let guides = runtime.guides_in_head().chunks_exact(N_PARTICLES);
    guides
        .map(|guide| {
            let pair = guide.windows(2).find(|p| p[0][1] >= y && p[1][1] < y).expect("a guide that long");
            let s = (pair[0][1] - y) / (pair[0][1] - pair[1][1]);
            pair[0][2] + s * (pair[1][2] - pair[0][2])
        })
        .collect()
}

#[test]
fn a_bar_thrown_through_the_hair_in_one_step_takes_guides_along_if_it_has_triangles() {
    /// Half the bar's thickness, cm.
    const HALF_CM: f32 = 0.15;
    const HEIGHT_CM: f64 = -10.0;
    let (positions, triangles) = cuboid([8.0, HALF_CM, HALF_CM]);
    for with_triangles in [true, false] {
        let mut bar = Solid::from_mesh("bar", &positions, &triangles, BakeParams::automatic(), 0.0).unwrap();
        if !with_triangles {
            bar.surface = None;
        }
        let poses = |z: f64| [at(0.0, HEIGHT_CM, z)];
        let mut runtime = runtime(RuntimeParams::adaptive(), vec![bar], &poses(-7.0));
        // 11 m/s: past the hair between one substep and the next, so that no field sees it there.
        step(&mut runtime, Isometry3::identity(), &poses(4.0));
        let in_front = crossings(&runtime, HEIGHT_CM as f32).iter().filter(|&&z| z >= 4.0).count();
        let expected = if with_triangles { Row::parted().guides.len() } else { 0 };
        assert_eq!(in_front, expected, "with triangles: {with_triangles}");
    }
}

#[test]
fn a_solid_with_triangles_far_away_changes_no_byte() {
    let (positions, triangles) = cuboid([2.0, 0.2, 0.2]);
    let far = [at(0.0, -10.0, -60.0)];
    let hash = |solid: Solid| {
        let mut runtime = runtime(RuntimeParams::adaptive(), vec![solid], &far);
        for k in 0..20 {
            step(&mut runtime, Isometry3::rotation(Vector3::y() * 0.02 * f64::from(k)), &far);
        }
        runtime.state_hash()
    };
    let bare = rod(0.2, 4.0, 0.0);
    let covered = bare.clone().with_surface(&positions, &triangles).unwrap();
    assert_eq!(hash(bare), hash(covered));
}

#[test]
fn a_head_put_elsewhere_keeps_its_hair_as_it_moves() {
    let turned = Isometry3::from_parts(
        Translation3::new(300.0, -20.0, 80.0),
        UnitQuaternion::from_scaled_axis(Vector3::y() * 1.3),
    );
    // A turn about the vertical leaves gravity as it is.
    let run = |put: bool| {
        let mut runtime = runtime(RuntimeParams::adaptive(), vec![], &[]);
        let swing = |k: i32| Isometry3::rotation(Vector3::z() * 0.3 * (0.1 * f64::from(k)).sin());
        for k in 0..40 {
            let there = if put && k >= 20 { turned } else { Isometry3::identity() };
            if put && k == 20 {
                runtime.put_head(&(there * swing(k - 1)));
            }
            step(&mut runtime, there * swing(k), &[]);
        }
        runtime.guides_in_head().to_vec()
    };
    let (stayed, put) = (run(false), run(true));
    let largest = stayed
        .iter()
        .zip(&put)
        .map(|(a, b)| f64::from((Vector3::from(*a) - Vector3::from(*b)).norm()))
        .fold(0.0, f64::max);
    assert!(largest < SINGLE_ROUND_OFF_CM, "{largest} cm");
}

#[test]
fn a_body_that_changes_its_shape_pushes_guides() {
    /// How far the body grows into the hair, cm.
    const GROWN_CM: f32 = 2.0;
    let (small, triangles) = cuboid([8.0, 2.0, 1.0]);
    let behind = |p: &[f32; 3], grown: f32| [p[0], p[1] - 10.0, p[2] - 2.0 + if p[2] > 0.0 { grown } else { 0.0 }];
    let keys: Vec<Vec<_>> = [0.0, GROWN_CM].map(|g| small.iter().map(|p| behind(p, g)).collect()).into();
    let mesh = KeyedMesh { times_s: &[0.0, 0.3], positions: &keys, triangles: &triangles };
    let body = DeformingSolid::from_keys("body", mesh, BakeParams::with_cell(0.25), 0.0).unwrap();
    let mut runtime = runtime(RuntimeParams::adaptive(), vec![], &[]);
    for k in 0..30 {
        let from_s = DT * f64::from(k);
        let pose = SolidPose::still(Isometry3::identity());
        let moving = [MovingDeformingSolid { solid: &body, pose, from_s, to_s: from_s + DT }];
        let input = StepInput { dt: DT, world_from_head: Isometry3::identity(), world_from_solids: &[] };
        runtime.step_among(&input, &moving);
    }
    // Its front ends a centimetre past the roots' plane.
    for z in crossings(&runtime, -10.0) {
        assert!(z > 0.95, "left at z = {z} cm");
    }
}

#[test]
fn follow_the_leader_keeps_lengths_in_a_runtime() {
    let params = RuntimeParams {
        guide_integrator: GuideIntegrator::FollowTheLeader(DftlParams::standard()),
        ..RuntimeParams::adaptive()
    };
    let mut runtime = runtime(params, vec![], &[]);
    let lengths = |guides: &[[f32; 3]]| -> Vec<f32> {
        guides
            .chunks_exact(N_PARTICLES)
            .flat_map(|g| g.windows(2).map(|p| (Vector3::from(p[1]) - Vector3::from(p[0])).norm()).collect::<Vec<_>>())
            .collect()
    };
    let (rest, before) = (lengths(runtime.guides_in_head()), runtime.guides_in_head().to_vec());
    for k in 0..100 {
        step(&mut runtime, Isometry3::rotation(Vector3::z() * 0.6 * (0.15 * f64::from(k)).sin()), &[]);
    }
    for (now, rest) in lengths(runtime.guides_in_head()).iter().zip(&rest) {
        assert!(f64::from((now - rest).abs()) < SINGLE_ROUND_OFF_CM, "{now} cm, at rest {rest}");
    }
    assert!(runtime.guides_in_head() != before, "the guides never moved");
}

#[test]
fn guides_that_meet_are_the_same_bytes_for_any_number_of_threads() {
    let params =
        RuntimeParams { guide_interaction: Some(InteractionParams::rubbing_sampled(0.5)), ..RuntimeParams::adaptive() };
    let run = |n_threads: usize, params: RuntimeParams| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        pool.install(|| {
            let mut runtime = runtime(params, vec![], &[]);
            for k in 0..60 {
                step(&mut runtime, Isometry3::rotation(Vector3::z() * 0.8 * (0.2 * f64::from(k)).sin()), &[]);
            }
            runtime.state_hash()
        })
    };
    let one = run(1, params);
    assert!(one == run(2, params) && one == run(8, params));
    let alone = RuntimeParams { guide_interaction: None, ..params };
    assert!(one != run(1, alone), "the guides never met");
}
