//! What a host can get wrong is answered, entry by entry, and changes nothing.
#![allow(unsafe_code, reason = "calls the C interface as a host does")]
#![allow(clippy::unwrap_used, reason = "test code")]

use adaptive_hair::ffi::*;
use adaptive_hair::types::{AH_MODE_ADAPTIVE, AhParams, AhPose, AhReport, AhStatus};
use adaptive_hair::{AhHair, AhModel, AhRod, AhSolid};
use hair_tests::models::Row;
use std::ffi::{CStr, CString};
use std::ptr::{null, null_mut};

const CENTER: [f32; 3] = [0.0; 3];

fn last_error() -> String {
    // SAFETY: never null, and no call on this thread fails meanwhile.
    unsafe { CStr::from_ptr(ah_last_error()) }.to_str().unwrap().to_owned()
}

/// Checks that a call was refused, with words that name the argument.
#[track_caller]
fn refused(status: AhStatus, names: &str) {
    assert_eq!(status, AhStatus::BadArgument);
    assert!(last_error().contains(names), "{} does not name {names}", last_error());
}

fn params() -> AhParams {
    let mut params = std::mem::MaybeUninit::uninit();
    // SAFETY: a place for parameters, which the call fills.
    unsafe {
        assert_eq!(ah_params_default(AH_MODE_ADAPTIVE, params.as_mut_ptr()), AhStatus::Ok);
        AhParams { n_threads: 1, ..params.assume_init() }
    }
}

/// A model written to a file and loaded again by the interface; to be freed.
fn model() -> *mut AhModel {
    let file = tempfile::NamedTempFile::new().unwrap();
    Row::of_three_guides().model().save(file.path()).unwrap();
    let path = CString::new(file.path().to_str().unwrap()).unwrap();
    let mut model = null_mut();
    // SAFETY: a string and a place.
    assert_eq!(unsafe { ah_model_load(path.as_ptr(), &mut model) }, AhStatus::Ok, "{}", last_error());
    model
}

/// Hair without solids; to be destroyed.
fn hair() -> *mut AhHair {
    let (model, mut hair) = (model(), null_mut());
    // SAFETY: all point to what they say; no solids.
    unsafe {
        let status = ah_create(model, &params(), &AhPose::identity(), null(), null(), null(), 0, &mut hair);
        assert_eq!(status, AhStatus::Ok, "{}", last_error());
        ah_model_free(model);
    }
    hair
}

#[test]
fn null_pointers_are_refused_by_name() {
    let (mut model_out, mut solid_out, mut hair_out) = (null_mut(), null_mut(), null_mut());
    let pose = AhPose::identity();
    let (model, hair) = (model(), hair());
    // SAFETY: what is not null points to what it says.
    unsafe {
        refused(ah_model_load(null(), &mut model_out), "path");
        refused(ah_model_load(c"x".as_ptr(), null_mut()), "out");
        refused(ah_solid_sphere(null(), 1.0, 0.3, 0.0, &mut solid_out), "center");
        refused(ah_solid_sphere(CENTER.as_ptr(), 1.0, 0.3, 0.0, null_mut()), "out");
        refused(ah_solid_rods(null(), 1, 0.3, 0.0, &mut solid_out), "rods");
        refused(ah_solid_mesh(null(), 4, [0; 12].as_ptr(), 4, 0.3, 0.0, &mut solid_out), "positions");
        refused(ah_solid_mesh([0.0; 12].as_ptr(), 4, null(), 4, 0.3, 0.0, &mut solid_out), "triangles");
        refused(ah_params_default(AH_MODE_ADAPTIVE, null_mut()), "out");
        refused(ah_pose_from_matrix(null(), null_mut()), "rows");
        refused(ah_create(null(), &params(), &pose, null(), null(), null(), 0, &mut hair_out), "model");
        refused(ah_create(model, null(), &pose, null(), null(), null(), 0, &mut hair_out), "params");
        refused(ah_create(model, &params(), null(), null(), null(), null(), 0, &mut hair_out), "head_pose");
        refused(ah_create(model, &params(), &pose, null(), null(), &pose, 1, &mut hair_out), "solids");
        refused(ah_create(model, &params(), &pose, null(), &null(), &pose, 1, &mut hair_out), "one of solids");
        refused(ah_create(model, &params(), &pose, null(), null(), null(), 0, null_mut()), "out");
        refused(ah_set_head_pose(null_mut(), &pose), "hair");
        refused(ah_set_head_pose(hair, null()), "pose");
        refused(ah_set_solid_pose(hair, 0, null()), "pose");
        refused(ah_step(null_mut(), 0.01, null_mut()), "hair");
        refused(ah_read(null_mut()), "hair");
        assert!(ah_positions(null()).is_null() && ah_previous_positions(null()).is_null());
        assert_eq!(
            (ah_n_strands(null()), ah_n_particles(null()), ah_n_guides(null()), ah_n_solids(null())),
            (0, 0, 0, 0)
        );
        ah_model_free(null_mut());
        ah_solid_free(null_mut());
        ah_destroy(null_mut());
        ah_destroy(hair);
        ah_model_free(model);
    }
    assert!(model_out.is_null() && solid_out.is_null() && hair_out.is_null(), "nothing is made by a call that fails");
}

#[test]
fn values_out_of_range_are_refused_by_name() {
    let (mut solid, mut hair_out): (*mut AhSolid, *mut AhHair) = (null_mut(), null_mut());
    let (model, hair) = (model(), hair());
    let pose = AhPose::identity();
    let nowhere = AhPose { translation: [f64::NAN; 3], ..pose };
    let with = |change: fn(&mut AhParams)| {
        let mut params = params();
        change(&mut params);
        params
    };
    // SAFETY: all pointers point to what they say, but for one that is refused by its address.
    unsafe {
        refused(ah_model_load(c"\xff".as_ptr(), &mut null_mut()), "UTF-8");
        refused(ah_solid_sphere(CENTER.as_ptr(), -1.0, 0.3, 0.0, &mut solid), "radius");
        refused(ah_solid_sphere(CENTER.as_ptr(), 1.0, f32::NAN, 0.0, &mut solid), "friction");
        let odd = CENTER.as_ptr().cast::<u8>().add(1).cast::<f32>();
        refused(ah_solid_sphere(odd, 1.0, 0.3, 0.0, &mut solid), "aligned");
        let rod = AhRod { a: CENTER, b: CENTER, radius: 1.0 };
        refused(ah_solid_rods(&rod, usize::MAX / 8, 0.3, 0.0, &mut solid), "memory");
        refused(ah_pose_from_matrix([2.0_f32; 12].as_ptr(), &mut AhPose::identity()), "rigid");
        refused(ah_params_default(9, &mut params()), "mode");
        let params_of_no_mode = with(|p| p.mode = 9);
        refused(ah_create(model, &params_of_no_mode, &pose, null(), null(), null(), 0, &mut hair_out), "mode");
        refused(ah_create(model, &params(), &nowhere, null(), null(), null(), 0, &mut hair_out), "head");
        refused(ah_set_head_pose(hair, &nowhere), "head");
        refused(ah_set_solid_pose(hair, 0, &pose), "solid 0");
        for dt in [0.0, -0.01, f64::NAN, f64::INFINITY] {
            refused(ah_step(hair, dt, null_mut()), "dt_s");
        }
        // An empty union and a flat mesh are solids' faults, and say what is wrong with them.
        assert_eq!(ah_solid_rods(null(), 0, 0.3, 0.0, &mut solid), AhStatus::BadSolid);
        assert_eq!(
            ah_solid_mesh([0.0; 9].as_ptr(), 3, [0, 1, 2].as_ptr(), 1, 0.3, 0.0, &mut solid),
            AhStatus::BadSolid
        );
        assert!(last_error().contains("vertices"), "{}", last_error());
        assert!(solid.is_null() && hair_out.is_null());
        // All is as before: the hair rests where it was.
        assert_eq!(ah_step(hair, 0.01, null_mut()), AhStatus::Ok);
        ah_destroy(hair);
        ah_model_free(model);
    }
}

#[test]
fn files_that_are_no_models_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("no.skin");
    let c_path = CString::new(path.to_str().unwrap()).unwrap();
    let mut whole = Vec::new();
    Row::of_three_guides().model().save(&path).unwrap();
    whole.extend(std::fs::read(&path).unwrap());
    let mut damaged = whole.clone();
    damaged[whole.len() / 2] ^= 1;
    for bytes in [&b""[..], b"not a model", &whole[..whole.len() - 1], &damaged] {
        std::fs::write(&path, bytes).unwrap();
        let mut model = null_mut();
        // SAFETY: a string and a place.
        let status = unsafe { ah_model_load(c_path.as_ptr(), &mut model) };
        assert_eq!((status, model), (AhStatus::BadModel, null_mut()));
        assert!(last_error().contains("no.skin"), "{}", last_error());
    }
}

#[test]
fn roots_follow_the_head_and_what_was_read_stays_until_the_next_read() {
    /// Coordinates of a few cm in single precision.
    const ROUND_OFF_CM: f32 = 1e-5;
    let hair = hair();
    // SAFETY: hair of this test alone; positions are looked at before the next read.
    unsafe {
        let n = 3 * ah_n_strands(hair) * ah_n_particles(hair);
        let rest = std::slice::from_raw_parts(ah_positions(hair), n).to_vec();
        // A quarter turn about z, and two centimetres up, as a matrix.
        let rows = [0.0_f32, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 1.0, 0.0];
        let mut pose = AhPose::identity();
        assert_eq!(ah_pose_from_matrix(rows.as_ptr(), &mut pose), AhStatus::Ok);
        assert_eq!(ah_set_head_pose(hair, &pose), AhStatus::Ok);
        let mut report = std::mem::MaybeUninit::<AhReport>::uninit();
        assert_eq!(ah_step(hair, 0.01, report.as_mut_ptr()), AhStatus::Ok);
        assert_eq!(ah_read(hair), AhStatus::Ok);
        let now = std::slice::from_raw_parts(ah_positions(hair), n);
        let stride = 3 * ah_n_particles(hair);
        for (now, rest) in now.chunks(stride).zip(rest.chunks(stride)) {
            let carried = [-rest[1], rest[0] + 2.0, rest[2]];
            assert!((0..3).all(|c| (now[c] - carried[c]).abs() < ROUND_OFF_CM), "{:?} {carried:?}", &now[..3]);
        }
        // The read before was at creation.
        assert_eq!(std::slice::from_raw_parts(ah_previous_positions(hair), n), rest);
        let report = report.assume_init();
        let names: Vec<_> = (0..report.n_stages).map(|k| CStr::from_ptr(ah_stage_name(k)).to_str().unwrap()).collect();
        assert!(names.contains(&"guide_sim") && ah_stage_name(report.n_stages).is_null(), "{names:?}");
        ah_destroy(hair);
    }
}
