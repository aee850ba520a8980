//! Real files no one in this project wrote, counted and measured; skipped where they are absent.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "test code")]

mod common;

use common::shared_data;
use io_formats::bvh::T_POSE_JUMP_DEG_PER_S;
use io_formats::groom::arc_length;
use io_formats::mesh::read_mesh;
use io_formats::scene::{HeadShape, SolidShape};
use io_formats::{Bvh, Error, Groom, LengthUnit, MotionEnd, PoseMotion, Scene, TriMesh, read_groom};
use nalgebra::{Isometry3, Vector3};

fn groom(name: &str, unit: LengthUnit) -> Option<Groom> {
    Some(read_groom(&shared_data(&format!("grooms/{name}"))?, unit).unwrap())
}

fn mesh(name: &str, unit: LengthUnit) -> Option<TriMesh> {
    Some(read_mesh(&shared_data(&format!("solids/{name}"))?, unit).unwrap())
}

fn motion(name: &str) -> Option<Bvh> {
    Some(Bvh::read(&shared_data(&format!("motion/{name}"))?).unwrap())
}

/// Strand count, points of every strand, and shortest and longest strand (cm).
fn check_groom(groom: &Groom, n_strands: usize, n_points: u32, min_cm: f64, max_cm: f64) {
    assert_eq!(groom.n_strands(), n_strands);
    assert!(groom.point_counts.iter().all(|&n| n == n_points));
    for (i, strand) in groom.strands().enumerate() {
        let length = arc_length(strand);
        assert!(min_cm <= length && length <= max_cm, "strand {i} is {length} cm long");
    }
    groom.validate().unwrap();
    let uniform = groom.resample(25).unwrap();
    for (i, strand) in groom.strands().enumerate() {
        let particles = uniform.strand(i);
        assert_eq!((particles[0], particles[24]), (strand[0], strand[strand.len() - 1]));
        assert!(arc_length(particles) <= arc_length(strand) * (1.0 + 1e-5));
    }
}

#[test]
fn straight_hair_has_no_segment_array_and_ten_thousand_strands() {
    let Some(groom) = groom("straight.hair", LengthUnit::Other(0.38)) else { return };
    check_groom(&groom, 10_000, 16, 55.0 * 0.38 - 1.0, 107.0 * 0.38 + 1.0);
}

#[test]
fn sintels_hair_is_a_quarter_of_a_metre_at_most() {
    let Some(groom) = groom("sintel_hair_16pts.tfx", LengthUnit::M) else { return };
    check_groom(&groom, 11_400, 16, 2.4, 24.9);
}

#[test]
fn the_mohawk_has_nearly_degenerate_strands_that_still_have_a_direction() {
    let Some(groom) = groom("ratboy_mohawk.tfx", LengthUnit::M) else { return };
    check_groom(&groom, 2_228, 32, 7e-4, 100.0);
    // Read as if in millimetres, the shortest fall below what has a direction, and are named.
    let Some(mut small) = self::groom("ratboy_mohawk.tfx", LengthUnit::Mm) else { return };
    let error = small.validate().unwrap_err();
    assert!(matches!(error, Error::DegenerateStrand { .. }) && error.to_string().contains("check the unit"), "{error}");
    let before = small.n_strands();
    let n_dropped = small.drop_degenerate();
    assert!(n_dropped > 0 && small.n_strands() == before - n_dropped);
    small.validate().unwrap();
}

#[test]
fn real_tressfx_files_of_both_versions_are_read() {
    if let Some(groom) = groom("sintel_lite_guides_32pts.tfx", LengthUnit::Cm) {
        check_groom(&groom, 228, 32, 1.0, 40.0);
    }
    // A head radius of 26.5 units is about 10 cm.
    for (name, n_strands) in [("front_top", 876), ("side", 3_066), ("back", 517), ("tail", 474)] {
        let Some(groom) = groom(&format!("ponytail/{name}.tfx"), LengthUnit::Other(0.38)) else { return };
        check_groom(&groom, n_strands, 16, 0.5, 80.0);
    }
    let Some(fur) = groom("bear_fur_4pts.tfx", LengthUnit::Cm) else { return };
    assert_eq!((fur.n_strands(), fur.points.len()), (48_113, 4 * 48_113));
}

#[test]
fn real_usc_strands_are_read() {
    for name in ["cstrands00127.data", "cstrands00017.data", "cstrands00154.data"] {
        let Some(groom) = groom(name, LengthUnit::Other(82.0)) else { return };
        check_groom(&groom, 5, 100, 5.0, 120.0);
    }
}

#[test]
fn real_strands_of_a_simulator_are_read_without_their_padding() {
    if let Some(ball) = groom("curly_ball_1024_freefall.ply", LengthUnit::Cm) {
        // Every strand is 27.949 cm long, to what six digits leave.
        check_groom(&ball, 1_024, 41, 27.94, 27.96);
    }
    let Some(man) = groom("man_hair_init_700.ply", LengthUnit::Cm) else { return };
    assert_eq!((man.n_strands(), man.points.len()), (781, 22_152));
    for strand in man.strands() {
        let length = arc_length(strand);
        assert!(
            (15..=41).contains(&strand.len()) && (10.0..31.0).contains(&length),
            "{} points, {length}",
            strand.len()
        );
    }
}

/// Counts after merging, and whether the mesh is closed.
fn check_mesh(mesh: &TriMesh, n_vertices: usize, n_triangles: usize, closed: bool) {
    assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (n_vertices, n_triangles));
    assert_eq!(mesh.is_closed(), closed, "{} boundary edges", mesh.boundary_edge_count());
}

#[test]
fn real_solids_have_their_known_counts_and_holes() {
    if let Some(comb) = mesh("comb.stl", LengthUnit::Mm) {
        check_mesh(&comb, 746, 1_488, true);
        let (lo, hi) = comb.bounds().unwrap();
        for (k, size) in [3.2, 0.28, 10.0].into_iter().enumerate() {
            assert!((hi[k] - lo[k] - size).abs() < 0.01, "axis {k}: {lo:?} to {hi:?}");
        }
    }
    for (name, unit, vertices, triangles, closed) in [
        ("sintel_collider.obj", LengthUnit::M, 341, 678, true),
        ("sintel_bust.obj", LengthUnit::M, 3_046, 5_952, false),
        ("usc_scalp.obj", LengthUnit::M, 439, 820, false),
        ("featuretype.stl", LengthUnit::Inch, 1_722, 3_476, true),
        ("gear.stl", LengthUnit::Mm, 3_353, 6_730, true),
        ("brush_handle.obj", LengthUnit::Cm, 5_429, 10_862, true),
        ("hand_closed.obj", LengthUnit::Other(19.0), 7_993, 15_982, true),
        ("bunny.obj", LengthUnit::Other(10.0), 3_301, 6_598, true),
    ] {
        if let Some(mesh) = mesh(name, unit) {
            check_mesh(&mesh, vertices, triangles, closed);
        }
    }
}

/// Frames, joints, frame time, the head's name, and its fastest turn (degrees a second) after skipped frames.
fn check_motion(name: &str, n: (usize, usize), frame_time: f64, skip: usize, max_deg_per_s: f64) {
    let Some(bvh) = motion(name) else { return };
    assert_eq!((bvh.n_frames(), bvh.n_joints()), n, "{name}");
    assert!((bvh.frame_time() - frame_time).abs() < 1e-4);
    let head = bvh.joint_index("Head").unwrap();
    assert_eq!(bvh.initial_jump_deg_per_s(head) > T_POSE_JUMP_DEG_PER_S, skip == 1, "{name}");
    let fastest = (skip + 1..bvh.n_frames())
        .map(|f| bvh.world_pose(f - 1, head).rotation.angle_to(&bvh.world_pose(f, head).rotation))
        .fold(0.0, f64::max)
        .to_degrees()
        / bvh.frame_time();
    // The known figures are rounded.
    assert!((fastest / max_deg_per_s - 1.0).abs() < 0.02, "{name}: {fastest} deg/s");

    let pivot = Vector3::new(0.0, -8.0, 0.0);
    let motion = PoseMotion::from_bvh(&bvh, head, 1.0, skip, pivot, MotionEnd::Hold).unwrap();
    motion.validate().unwrap();
    assert_eq!(motion.pose_at(0.0), Isometry3::identity());
    let duration = (bvh.n_frames() - skip - 1) as f64 * bvh.frame_time();
    assert!((motion.duration_s() - duration).abs() < 1e-9);
}

#[test]
fn real_motions_have_their_known_lengths_and_speeds() {
    check_motion("cmu_01_01.bvh", (2_752, 31), 1.0 / 120.0, 1, 840.0);
    check_motion("bandai_bow_happy_001.bvh", (138, 22), 1.0 / 30.0, 0, 303.0);
    check_motion("bandai_kick_normal_001.bvh", (358, 22), 1.0 / 30.0, 0, 1_282.0);
    check_motion("mocapbank.bvh", (455, 19), 1.0 / 30.0, 0, 229.0);
}

#[test]
fn the_bowing_head_goes_down_and_comes_back_in_centimetres() {
    let Some(bvh) = motion("mocapbank.bvh") else { return };
    let head = bvh.joint_index("Head").unwrap();
    let heights: Vec<f64> = (0..bvh.n_frames()).map(|f| bvh.world_pose(f, head).translation.y).collect();
    let (lo, hi) = heights.iter().fold((f64::MAX, f64::MIN), |(lo, hi), &y| (lo.min(y), hi.max(y)));
    assert!((lo - 67.0).abs() < 2.0 && (hi - 149.0).abs() < 2.0, "{lo} to {hi}");
}

#[test]
fn a_scene_of_real_files_loads_whole() {
    let Some(hair) = shared_data("grooms/sintel_hair_16pts.tfx") else { return };
    let data = hair.parent().unwrap().parent().unwrap();
    let text = r#"
        name = "sintel shakes her head"
        seconds = 30.0
        [groom]
        file = "grooms/sintel_hair_16pts.tfx"
        unit = "m"
        translate_cm = [0.0, -155.0, 0.0]
        [head]
        mesh = "solids/sintel_collider.obj"
        unit = "m"
        pivot_cm = [0.0, -5.0, 0.0]
        [head.motion]
        bvh = "motion/cmu_01_01.bvh"
        joint = "Head"
        unit = 5.6
        skip_frames = 1
        repeat = true
        [[solid]]
        name = "comb"
        mesh = "solids/comb.stl"
        unit = "mm"
        center = true
        rotate_deg = [90.0, 0.0, 0.0]
    "#;
    let scene = Scene::from_toml(text, data).unwrap();
    let groom = scene.groom.source.load_file().unwrap().unwrap();
    groom.validate().unwrap();
    let highest = groom.points.iter().map(|p| p[1]).fold(f32::MIN, f32::max);
    assert!(highest > 5.0 && highest < 20.0, "{highest} cm above the head's middle");

    let HeadShape::Mesh(head) = &scene.head.shape else { panic!("the head is a mesh") };
    assert!(head.load().unwrap().is_closed());
    let motion = scene.head_motion().unwrap();
    assert!(motion.duration_s() >= scene.seconds, "the motion fills the scene");
    assert_eq!(motion.pose_at(0.0), Isometry3::identity());

    let SolidShape::Mesh(comb) = &scene.solids[0].shape else { panic!("the comb is a mesh") };
    let (lo, hi) = comb.load().unwrap().bounds().unwrap();
    // Turned about x, the teeth's length now runs along y.
    assert!((hi[1] - lo[1] - 10.0).abs() < 0.01 && (hi[1] + lo[1]).abs() < 1e-4, "{lo:?} to {hi:?}");
}
