//! Laws of motions: the BVH reader on hand-made files, and poses between keys.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "test code")]

use std::f64::consts::PI;
use std::path::Path;

use io_formats::{Bvh, Error, MotionEnd, PoseKey, PoseMotion};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

/// Double-precision round-off of a few products of rotations.
const ROUND_OFF: f64 = 1e-12;
/// A turn is a quaternion's arc cosine, which loses half the digits near zero.
const ANGLE_ROUND_OFF: f64 = 1e-7;
/// How far a pivot 10 cm from the origin may stray between inserted keys.
const PIVOT_STRAY_CM: f64 = 4e-4;

/// CRLF, tabs, a colon in a name, brace on its own line and at the end of one, e-notation, 3 and 6 channels.
const SMALL: &str = "HIERARCHY\r\nROOT rig:Hips\r\n{\r\n\tOFFSET 0 0 0\r\n\
    \tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\r\n\
    \tJOINT Neck Upper {\r\n\t\tOFFSET 0 1e1 0\r\n\t\tCHANNELS 3 Yrotation Xrotation Zrotation\r\n\
    \t\tJOINT Head\r\n\t\t{\r\n\t\t\tOFFSET 7 7 7\r\n\t\t\tCHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation\r\n\
    \t\t\tEnd Site\r\n\t\t\t{\r\n\t\t\t\tOFFSET 0 1 0\r\n\t\t\t}\r\n\t\t}\r\n\t}\r\n}\r\n\
    MOTION\r\nFrames:\t2\r\nFrame Time: 5.0e-1\r\n\
    1 2 3 90 0 0  0 0 0  0 5 0 0 0 0\r\n\
    1 2 3 0 0 0  90 90 0  0 5 0 0 0 -9e1\r\n";

fn small() -> Bvh {
    Bvh::parse(Path::new("small.bvh"), SMALL.as_bytes()).unwrap()
}

fn near(a: Point3<f64>, b: [f64; 3]) -> bool {
    (a - Point3::from(b)).norm() < ROUND_OFF * 100.0
}

fn key(t: f64, x: f64, turn_y: f64) -> PoseKey {
    PoseKey {
        time_s: t,
        translation_cm: Vector3::new(x, 0.0, 0.0),
        rotation: UnitQuaternion::from_axis_angle(&Vector3::y_axis(), turn_y),
    }
}

#[test]
fn joints_pose_by_offset_or_position_and_rotate_in_channel_order() {
    let bvh = small();
    assert_eq!((bvh.n_frames(), bvh.n_joints(), bvh.frame_time()), (2, 3, 0.5));
    assert_eq!(bvh.joint_names().collect::<Vec<_>>(), ["rig:Hips", "Neck Upper", "Head"]);
    let head = bvh.joint_index("Head").unwrap();
    // Hips turned 90 degrees about z: up becomes -x. The head's position channels replace its offset.
    assert!(near(bvh.world_pose(0, head) * Point3::origin(), [1.0 - 10.0 - 5.0, 2.0, 3.0]));
    // Neck: y by 90 then, in its own turned frame, x by 90: its y axis goes to z, then to x.
    assert!(near(bvh.world_pose(1, 1) * Point3::new(0.0, 1.0, 0.0), [1.0 + 1.0, 12.0, 3.0]));
    assert!(near(bvh.world_pose(1, head) * Point3::origin(), [1.0 + 5.0, 12.0, 3.0]));
}

#[test]
fn a_byte_order_mark_is_no_part_of_the_file() {
    let marked = format!("\u{feff}{SMALL}");
    assert_eq!(Bvh::parse(Path::new("small.bvh"), marked.as_bytes()).unwrap().n_joints(), 3);
}

#[test]
fn an_unknown_joint_is_refused_with_the_names_there_are() {
    let error = small().joint_index("head").unwrap_err().to_string();
    assert!(error.contains("small.bvh") && error.contains("rig:Hips, Neck Upper, Head"), "{error}");
}

#[test]
fn every_cut_of_a_bvh_before_its_last_value_is_refused() {
    let end = SMALL.trim_end().len();
    for n in 0..end - 4 {
        let error = Bvh::parse(Path::new("small.bvh"), &SMALL.as_bytes()[..n]).unwrap_err();
        assert!(matches!(error, Error::BadLine { .. }), "{n} bytes: {error}");
    }
}

#[test]
fn wrong_lines_of_a_bvh_are_refused_with_their_number() {
    for (from, to, expected) in [
        ("Frames:\t2", "Frames:\t99999999999", "do not fit"),
        ("Frames:\t2", "Frames:\t18446744073709551615", "do not fit"),
        ("Frames:\t2", "Frames:\t-2", "bad frame count"),
        ("Frames:\t2", "Frames:\t0", "no motion"),
        ("5.0e-1", "0", "not positive"),
        ("5.0e-1", "inf", "not a finite number"),
        ("-9e1", "NaN", "line 24"),
        ("-9e1", "", "14 values, 15 are needed"),
        ("CHANNELS 3", "CHANNELS 4", "4 channels announced, 3 named"),
        ("Yrotation Xrotation Zrotation", "Yrotation Wrotation Zrotation", "Wrotation"),
        ("OFFSET 0 1e1 0", "OFFSET 0 1e1", "line 7"),
        ("JOINT Head", "ROOT Head", "out of place"),
        ("HIERARCHY", "HIERARCHY!", "line 1"),
        ("End Site", "End", "cannot understand"),
        ("\t\tJOINT Head", "\t\tCHANNELS 1 Xrotation\r\n\t\tJOINT Head", "once"),
    ] {
        let text = SMALL.replacen(from, to, 1);
        assert_ne!(text, SMALL);
        let error = Bvh::parse(Path::new("small.bvh"), text.as_bytes()).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("line "), "{from:?} -> {to:?}: {error}");
    }
    assert!(Bvh::parse(Path::new("small.bvh"), b"HIERARCHY\n\xff").is_err());
}

#[test]
fn a_very_deep_hierarchy_does_not_exhaust_the_stack() {
    let mut text = String::from("HIERARCHY\nROOT r\n{\nCHANNELS 1 Xrotation\n");
    for i in 0..9_000 {
        text += &format!("JOINT j{i} {{\nCHANNELS 1 Xrotation\n");
    }
    text += &"}\n".repeat(9_001);
    text += &format!("MOTION\nFrames: 1\nFrame Time: 1\n{}\n", "0 ".repeat(9_001));
    let bvh = Bvh::parse(Path::new("deep.bvh"), text.as_bytes()).unwrap();
    assert_eq!(bvh.world_pose(0, 9_000), Isometry3::identity());
}

#[test]
fn the_jump_of_an_added_first_pose_is_reported() {
    let bvh = small();
    // The hips turn 90 degrees in half a second.
    assert!((bvh.initial_jump_deg_per_s(0) - 180.0).abs() < 1e-6);
}

#[test]
fn a_motion_from_bvh_starts_at_the_identity_and_turns_about_the_pivot() {
    let bvh = small();
    let pivot = Vector3::new(0.0, 10.0, 0.0);
    let motion = PoseMotion::from_bvh(&bvh, 0, 2.0, 0, pivot, MotionEnd::Hold).unwrap();
    assert_eq!(motion.pose_at(0.0), Isometry3::identity());
    assert_eq!(motion.pose_at(-1.0), Isometry3::identity());
    motion.validate().unwrap();
    // The hips turn -90 degrees about z without moving: the pivot stays, also on the way there.
    for i in 0..=100 {
        let moved = motion.pose_at(0.005 * f64::from(i)) * Point3::from(pivot);
        assert!((moved - Point3::from(pivot)).norm() < PIVOT_STRAY_CM, "{moved}");
    }
    let top = motion.pose_at(0.5) * Point3::new(0.0, 11.0, 0.0);
    assert!(near(top, [1.0, 10.0, 0.0]), "{top}");
    assert_eq!(motion.pose_at(99.0), motion.pose_at(0.5), "the last pose holds");
}

#[test]
fn a_turned_motion_tilts_where_the_turned_actor_would() {
    // The hips turn -90 degrees about z; an actor turned 90 degrees about y turns about x instead.
    let pivot = Vector3::new(1.0, 2.0, 3.0);
    let end = MotionEnd::Hold;
    let motion = PoseMotion::from_bvh_turned(&small(), 0, 1.0, 0, PI / 2.0, pivot, end).unwrap();
    let expected = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -PI / 2.0);
    assert!(motion.pose_at(0.5).rotation.angle_to(&expected) < ANGLE_ROUND_OFF);
    assert!(near(motion.pose_at(0.5) * Point3::from(pivot), [1.0, 2.0, 3.0]));
    assert_eq!(motion.pose_at(0.0), Isometry3::identity());
}

#[test]
fn skipped_frames_are_not_in_the_motion() {
    let motion = PoseMotion::from_bvh(&small(), 0, 1.0, 1, Vector3::zeros(), MotionEnd::Hold).unwrap();
    assert_eq!(motion.duration_s(), 0.0);
    for (joint, skip, unit) in [(0, 2, 1.0), (3, 0, 1.0), (0, 0, 0.0), (0, 0, f64::NAN)] {
        assert!(PoseMotion::from_bvh(&small(), joint, unit, skip, Vector3::zeros(), MotionEnd::Hold).is_err());
    }
}

#[test]
fn a_repeated_motion_runs_back_without_a_jump() {
    let end = MotionEnd::Repeat { until_s: 2.3 };
    let motion = PoseMotion::from_bvh(&small(), 0, 1.0, 0, Vector3::zeros(), end).unwrap();
    assert!(motion.duration_s() >= 2.3);
    for (a, b) in [(0.3, 0.7), (0.1, 1.1), (0.5, 1.5), (0.0, 2.0)] {
        let turn = motion.pose_at(a).rotation.angle_to(&motion.pose_at(b).rotation);
        assert!(turn < ANGLE_ROUND_OFF, "{a} and {b} s differ by {turn}");
    }
    let endless = MotionEnd::Repeat { until_s: f64::INFINITY };
    assert!(PoseMotion::from_bvh(&small(), 0, 1.0, 0, Vector3::zeros(), endless).is_err());
}

#[test]
fn poses_between_keys_are_linear_and_spherical_and_the_ends_hold() {
    let motion = PoseMotion { keys: vec![key(1.0, 0.0, 0.0), key(2.0, 8.0, 1.0), key(4.0, 8.0, 1.0)] };
    motion.validate().unwrap();
    let pose = motion.pose_at(1.25);
    assert!((pose.translation.x - 2.0).abs() < ROUND_OFF);
    assert!((pose.rotation.angle() - 0.25).abs() < ANGLE_ROUND_OFF);
    assert_eq!(motion.pose_at(0.0), motion.pose_at(1.0));
    assert_eq!(motion.pose_at(9.0), motion.pose_at(4.0));
    assert_eq!(PoseMotion::still().pose_at(3.0), Isometry3::identity());
}

#[test]
fn half_a_turn_between_keys_gives_a_pose_all_the_same() {
    let motion = PoseMotion { keys: vec![key(0.0, 0.0, 0.0), key(1.0, 0.0, PI)] };
    for i in 0..=10 {
        assert!(motion.pose_at(f64::from(i) / 10.0).rotation.coords.iter().all(|x| x.is_finite()));
    }
}

#[test]
fn keys_about_a_pivot_keep_the_pivot_on_its_path() {
    let pivot = Vector3::new(0.0, 0.0, 10.0);
    let motion = PoseMotion::about_pivot(&[key(0.0, 0.0, 0.0), key(2.0, 4.0, 2.5)], pivot).unwrap();
    motion.validate().unwrap();
    for i in 0..=200 {
        let t = f64::from(i) / 100.0;
        let moved = motion.pose_at(t) * Point3::from(pivot);
        let expected = Point3::from(pivot + Vector3::new(2.0 * t, 0.0, 0.0));
        assert!((moved - expected).norm() < PIVOT_STRAY_CM, "at {t} s: {moved}");
    }
}

#[test]
fn keys_out_of_order_or_not_finite_are_refused() {
    for keys in [
        vec![key(1.0, 0.0, 0.0), key(1.0, 0.0, 0.0)],
        vec![key(1.0, 0.0, 0.0), key(0.5, 0.0, 0.0)],
        vec![key(0.0, f64::NAN, 0.0)],
        vec![key(f64::NAN, 0.0, 0.0)],
        vec![key(0.0, 0.0, f64::NAN)],
    ] {
        assert!(matches!(PoseMotion { keys }.validate(), Err(Error::BadMotion { .. })));
    }
}
