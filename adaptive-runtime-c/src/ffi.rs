//! The entries a host calls, and the only module that trusts a pointer.
//!
//! Each entry turns its arguments into references, calls a safe function and writes the result; all of that runs in
//! `guarded`. Null and misaligned pointers are answered with a status; that a pointer otherwise points to what its
//! type says is the host's word. The doc comments here are the header's.
#![allow(unsafe_code, reason = "a C interface is handed pointers; every other module is safe")]
#![allow(
    clippy::missing_safety_doc,
    reason = "these comments are the header's: what each pointer must be is said there"
)]

use crate::error::{Error, last};
use crate::guard::{guarded, guarded_or};
use crate::hair::{AhHair, AhModel};
use crate::solids::{AhRod, AhSolid, Surface};
use crate::types::{AH_VERSION, AhParams, AhPose, AhReport, AhStatus};
use io_formats::SkinningModel;
use std::ffi::{CStr, CString, c_char};
use std::mem::MaybeUninit;
use std::path::Path;
use std::sync::OnceLock;

/// Version of the library: 10,000 x major + 100 x minor + patch. Structs are laid out as in the header if it is AH_VERSION.
#[unsafe(no_mangle)]
pub extern "C" fn ah_version() -> u32 {
    AH_VERSION
}

/// What went wrong in the last call on this thread that failed, in English; never null, valid until the next that fails.
#[unsafe(no_mangle)]
pub extern "C" fn ah_last_error() -> *const c_char {
    last()
}

/// Loads a skinning model, as `cargo xtask train` writes it. `path` is UTF-8. Free it with ah_model_free.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_model_load(path: *const c_char, out: *mut *mut AhModel) -> AhStatus {
    guarded(|| {
        // SAFETY: the host's word: a string that ends in zero, and a place for a pointer.
        let (path, out) = unsafe { (text(path, "path")?, place(out, "out")?) };
        let model = SkinningModel::load(Path::new(path)).map_err(Error::Model)?;
        out.write(Box::into_raw(Box::new(AhModel { model })));
        Ok(())
    })
}

/// Frees a model; null is allowed. Hair made from it keeps its own copy.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_model_free(model: *mut AhModel) {
    // SAFETY: the host's word: from ah_model_load, and freed once.
    unsafe { free(model) }
}

/// A ball about `center` (x, y, z) in the solid's frame. `friction` is Coulomb's coefficient; `cell_cm` the resolution of its
/// distance field, 0 to choose. Free it with ah_solid_free.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_solid_sphere(
    center: *const f32,
    radius_cm: f32,
    friction: f32,
    cell_cm: f32,
    out: *mut *mut AhSolid,
) -> AhStatus {
    guarded(|| {
        // SAFETY: the host's word: three numbers, and a place for a pointer.
        let (center, out) = unsafe { (slice(center.cast::<[f32; 3]>(), 1, "center")?[0], place(out, "out")?) };
        let ball = AhRod { a: center, b: center, radius: radius_cm };
        out.write(Box::into_raw(Box::new(AhSolid::rods(&[ball], Surface { friction, cell_cm })?)));
        Ok(())
    })
}

/// The union of rods with round ends, such as one tooth or a whole comb; the rest as ah_solid_sphere.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_solid_rods(
    rods: *const AhRod,
    n_rods: usize,
    friction: f32,
    cell_cm: f32,
    out: *mut *mut AhSolid,
) -> AhStatus {
    guarded(|| {
        // SAFETY: the host's word: so many rods, and a place for a pointer.
        let (rods, out) = unsafe { (slice(rods, n_rods, "rods")?, place(out, "out")?) };
        out.write(Box::into_raw(Box::new(AhSolid::rods(rods, Surface { friction, cell_cm })?)));
        Ok(())
    })
}

/// A triangle mesh: `positions` are 3 `n_vertices` coordinates (cm, solid's frame), `triangles` 3 `n_triangles` indices of
/// vertices. It may have holes and overlap itself, but must have an inside; a cell_cm of 0 takes a quarter of its
/// thinnest feature. Baking may take seconds. The rest as ah_solid_sphere.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_solid_mesh(
    positions: *const f32,
    n_vertices: usize,
    triangles: *const u32,
    n_triangles: usize,
    friction: f32,
    cell_cm: f32,
    out: *mut *mut AhSolid,
) -> AhStatus {
    guarded(|| {
        // SAFETY: the host's word: three numbers a vertex, three a triangle, and a place for a pointer.
        let (positions, triangles, out) = unsafe {
            (
                slice(positions.cast(), n_vertices, "positions")?,
                slice(triangles.cast(), n_triangles, "triangles")?,
                place(out, "out")?,
            )
        };
        out.write(Box::into_raw(Box::new(AhSolid::mesh(positions, triangles, Surface { friction, cell_cm })?)));
        Ok(())
    })
}

/// Frees a solid; null is allowed. Hair made with it keeps its own copy.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_solid_free(solid: *mut AhSolid) {
    // SAFETY: the host's word: from ah_solid_*, and freed once.
    unsafe { free(solid) }
}

/// Fills `out` with the parameters of a mode, one of AH_MODE_*.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_params_default(mode: u32, out: *mut AhParams) -> AhStatus {
    guarded(|| {
        // SAFETY: the host's word: a place for parameters.
        let out = unsafe { place(out, "out") }?;
        out.write(AhParams::of_mode(mode)?);
        Ok(())
    })
}

/// Fills `out` with the pose of a matrix [R | t], 3 rows of 4 numbers, row after row, that takes column vectors to the world.
/// It must be rigid: no scale, no mirror.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_pose_from_matrix(rows: *const f32, out: *mut AhPose) -> AhStatus {
    guarded(|| {
        // SAFETY: the host's word: twelve numbers, and a place for a pose.
        let (rows, out) = unsafe { (slice(rows, 12, "rows")?, place(out, "out")?) };
        out.write(AhPose::from_rows(rows)?);
        Ok(())
    })
}

/// Hair at rest on a head at the given pose. Model and solids are copied. `head` is the head and body in the head's frame, or
/// null for none; `solids` and `solid_poses` are `n_solids` each, in the order by which solids are named from then on, and
/// may be null if there are none. Destroy it with ah_destroy.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_create(
    model: *const AhModel,
    params: *const AhParams,
    head_pose: *const AhPose,
    head: *const AhSolid,
    solids: *const *const AhSolid,
    solid_poses: *const AhPose,
    n_solids: usize,
    out: *mut *mut AhHair,
) -> AhStatus {
    guarded(|| {
        // SAFETY: the host's word: each points to what its type says, or is null.
        let (model, params, head_pose, out) = unsafe {
            (shared(model, "model")?, shared(params, "params")?, shared(head_pose, "head_pose")?, place(out, "out")?)
        };
        // SAFETY: the host's word: so many pointers to solids and so many poses.
        let (solids, poses) =
            unsafe { (slice(solids, n_solids, "solids")?, slice(solid_poses, n_solids, "solid_poses")?) };
        // SAFETY: the host's word, as for every solid below.
        let head = if head.is_null() { None } else { Some(unsafe { shared(head, "head") }?) };
        let solids: Vec<&AhSolid> =
            // SAFETY: the host's word: each points to a solid, or is null.
            solids.iter().map(|&solid| unsafe { shared(solid, "one of solids") }).collect::<Result<_, _>>()?;
        out.write(Box::into_raw(Box::new(AhHair::new(model, params, head_pose, head, &solids, poses)?)));
        Ok(())
    })
}

/// Destroys hair and with it its positions; null is allowed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_destroy(hair: *mut AhHair) {
    // SAFETY: the host's word: from ah_create, and destroyed once.
    unsafe { free(hair) }
}

/// Where the head is at the end of the next step; it stays there until it is set again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_set_head_pose(hair: *mut AhHair, pose: *const AhPose) -> AhStatus {
    guarded(|| {
        // SAFETY: the host's word: hair that no other call uses, and a pose.
        let (hair, pose) = unsafe { (exclusive(hair, "hair")?, shared(pose, "pose")?) };
        hair.set_head_pose(pose)
    })
}

/// Where a solid is at the end of the next step; it stays there until it is set again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_set_solid_pose(hair: *mut AhHair, solid: u32, pose: *const AhPose) -> AhStatus {
    guarded(|| {
        // SAFETY: the host's word: hair that no other call uses, and a pose.
        let (hair, pose) = unsafe { (exclusive(hair, "hair")?, shared(pose, "pose")?) };
        hair.set_solid_pose(solid, pose)
    })
}

/// Puts the head elsewhere at once, with all its hair as it is: for a head that jumps, which a step would have tear at its hair.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_put_head(hair: *mut AhHair, pose: *const AhPose) -> AhStatus {
    guarded(|| {
        // SAFETY: the host's word: hair that no other call uses, and a pose.
        let (hair, pose) = unsafe { (exclusive(hair, "hair")?, shared(pose, "pose")?) };
        hair.put_head(pose)
    })
}

/// Puts a solid elsewhere at once: for one that appears, leaves or jumps, which a step would sweep through all hair on its way.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_put_solid(hair: *mut AhHair, solid: u32, pose: *const AhPose) -> AhStatus {
    guarded(|| {
        // SAFETY: the host's word: hair that no other call uses, and a pose.
        let (hair, pose) = unsafe { (exclusive(hair, "hair")?, shared(pose, "pose")?) };
        hair.put_solid(solid, pose)
    })
}

/// Advances the hair by `dt_s` seconds (0.01 is what it is made for) to the poses set. `report` may be null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_step(hair: *mut AhHair, dt_s: f64, report: *mut AhReport) -> AhStatus {
    guarded(|| {
        // SAFETY: the host's word: hair that no other call uses, and a place for a report.
        let hair = unsafe { exclusive(hair, "hair") }?;
        // SAFETY: as above.
        let report = if report.is_null() { None } else { Some(unsafe { place(report, "report") }?) };
        let met = hair.step(dt_s)?;
        if let Some(report) = report {
            report.write(met);
        }
        Ok(())
    })
}

/// Brings the positions of all hair up to date with the last step. Needed only when they are wanted: hair does not move
/// otherwise for being read more often or less.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_read(hair: *mut AhHair) -> AhStatus {
    guarded(|| {
        // SAFETY: the host's word: hair that no other call uses.
        unsafe { exclusive(hair, "hair") }?.read()
    })
}

/// Positions in the world as of the last ah_read, cm: ah_n_strands x ah_n_particles x 3 floats, strand after strand, each from
/// root to tip. Valid until the next ah_read or ah_destroy. Null on failure.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_positions(hair: *const AhHair) -> *const f32 {
    // SAFETY: the host's word: hair that no other call changes.
    ask(std::ptr::null(), || Ok(unsafe { shared(hair, "hair") }?.runtime()?.positions().as_ptr().cast()))
}

/// Positions as of the ah_read before that, for motion blur; otherwise as ah_positions.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_previous_positions(hair: *const AhHair) -> *const f32 {
    // SAFETY: the host's word: hair that no other call changes.
    ask(std::ptr::null(), || Ok(unsafe { shared(hair, "hair") }?.runtime()?.previous_positions().as_ptr().cast()))
}

/// Strands; 0 on failure.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_n_strands(hair: *const AhHair) -> usize {
    // SAFETY: the host's word: hair that no other call changes.
    ask(0, || Ok(unsafe { shared(hair, "hair") }?.runtime()?.n_strands()))
}

/// Particles of each strand; 0 on failure.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_n_particles(hair: *const AhHair) -> usize {
    // SAFETY: the host's word: hair that no other call changes.
    ask(0, || Ok(unsafe { shared(hair, "hair") }?.runtime()?.n_particles()))
}

/// Guides among the strands; 0 on failure.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_n_guides(hair: *const AhHair) -> usize {
    // SAFETY: the host's word: hair that no other call changes.
    ask(0, || Ok(unsafe { shared(hair, "hair") }?.runtime()?.model().n_guides()))
}

/// Solids the hair was created with; 0 on failure.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ah_n_solids(hair: *const AhHair) -> usize {
    // SAFETY: the host's word: hair that no other call changes.
    ask(0, || Ok(unsafe { shared(hair, "hair") }?.n_solids()))
}

/// Name of a stage of AhReport; null past the last.
#[unsafe(no_mangle)]
pub extern "C" fn ah_stage_name(stage: u32) -> *const c_char {
    static NAMES: OnceLock<Vec<CString>> = OnceLock::new();
    ask(std::ptr::null(), || {
        let names = NAMES.get_or_init(|| {
            let stages = adaptive_runtime::StageTimings::default().named();
            stages.iter().map(|(name, _)| CString::new(*name).unwrap_or_default()).collect()
        });
        Ok(names.get(stage as usize).map_or(std::ptr::null(), |name| name.as_ptr()))
    })
}

/// An entry that answers with a value.
fn ask<T: Copy>(fallback: T, work: impl FnOnce() -> Result<T, Error>) -> T {
    guarded_or(fallback, work).1
}

/// # Safety
/// If not null and aligned, `p` points to a `T` that nothing writes to meanwhile.
unsafe fn shared<'a, T>(p: *const T, what: &'static str) -> Result<&'a T, Error> {
    check(p, what)?;
    // SAFETY: the caller's.
    Ok(unsafe { &*p })
}

/// # Safety
/// If not null and aligned, `p` points to a `T` that nothing else uses meanwhile.
unsafe fn exclusive<'a, T>(p: *mut T, what: &'static str) -> Result<&'a mut T, Error> {
    check(p, what)?;
    // SAFETY: the caller's.
    Ok(unsafe { &mut *p })
}

/// A place for a result, which is written to and never read.
///
/// # Safety
/// If not null and aligned, `p` points to memory for a `T` that nothing else uses meanwhile.
unsafe fn place<'a, T>(p: *mut T, what: &'static str) -> Result<&'a mut MaybeUninit<T>, Error> {
    check(p, what)?;
    // SAFETY: the caller's; what is there need not be a `T` yet.
    Ok(unsafe { &mut *p.cast() })
}

/// # Safety
/// If not null and aligned, `p` points to `n` of `T` that nothing writes to meanwhile; it is not looked at if `n` is 0.
unsafe fn slice<'a, T>(p: *const T, n: usize, what: &'static str) -> Result<&'a [T], Error> {
    if n == 0 {
        return Ok(&[]);
    }
    check(p, what)?;
    if n.checked_mul(size_of::<T>()).is_none_or(|bytes| bytes > isize::MAX as usize) {
        return Err(Error::TooLong { what, n });
    }
    // SAFETY: the caller's, and no longer than memory can be.
    Ok(unsafe { std::slice::from_raw_parts(p, n) })
}

/// # Safety
/// If not null, `p` points to a string that ends in zero and that nothing writes to meanwhile.
unsafe fn text<'a>(p: *const c_char, what: &'static str) -> Result<&'a str, Error> {
    check(p, what)?;
    // SAFETY: the caller's.
    unsafe { CStr::from_ptr(p) }.to_str().map_err(|_| Error::NotUtf8 { what })
}

fn check<T>(p: *const T, what: &'static str) -> Result<(), Error> {
    if p.is_null() {
        return Err(Error::Null { what });
    }
    if !p.is_aligned() {
        return Err(Error::Misaligned { what });
    }
    Ok(())
}

/// # Safety
/// `p` is null or came from `Box::into_raw`, and is not used again.
unsafe fn free<T>(p: *mut T) {
    if !p.is_null() {
        // SAFETY: the caller's. A panic of a destructor stays here; memory may then be lost, which is the lesser evil.
        guarded(|| {
            drop(unsafe { Box::from_raw(p) });
            Ok(())
        });
    }
}
