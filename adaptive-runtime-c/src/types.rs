//! Plain structs and numbers that cross the border, and their way to and from the types of the runtime.
//!
//! All of it is `repr(C)` with fields that any bits are valid for: a host may hand over anything, and is told if it makes
//! no sense. Lengths in cm.

use crate::error::Error;
use adaptive_runtime::{Correction, RuntimeParams, StepReport};
use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Version of this header, to compare with ah_version(): 10,000 x major + 100 x minor + patch.
pub const AH_VERSION: u32 = 100;

/// The whole method: hair splits around solids and pushes back on its guides.
pub const AH_MODE_ADAPTIVE: u32 = 0;
/// As AH_MODE_ADAPTIVE, but hair does not push back on its guides.
pub const AH_MODE_NO_TWO_WAY: u32 = 1;
/// Ordinary skinning: every hair keeps its guides, and only guides meet solids.
pub const AH_MODE_FIXED: u32 = 2;
/// The paper of 2016 to the letter, as far as parameters reach.
pub const AH_MODE_PAPER: u32 = 3;

/// Most stages a step may consist of.
pub const AH_MAX_STAGES: usize = 16;

/// How a call went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
pub enum AhStatus {
    /// As asked.
    Ok = 0,
    /// An argument is null or out of range; nothing has changed.
    BadArgument = 1,
    /// The file is not there, damaged, or no skinning model of this version.
    BadModel = 2,
    /// The shape or mesh encloses nothing, or its grid would be too large.
    BadSolid = 3,
    /// The model's guides cannot be simulated, or a parameter is out of range.
    CannotCreate = 4,
    /// Worker threads could not be started.
    NoThreads = 5,
    /// A defect of the library, caught; the hair it happened to is broken.
    Panicked = 6,
    /// The hair met a defect before; it can only be destroyed.
    Broken = 7,
}

/// Where a head or a solid is: a point p of it is at rotation p + translation in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct AhPose {
    /// cm.
    pub translation: [f64; 3],
    /// Unit quaternion x, y, z, w.
    pub rotation: [f64; 4],
}

/// How hair behaves; fill with ah_params_default and change what you like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct AhParams {
    /// One of AH_MODE_*.
    pub mode: u32,
    /// Whether hair pushes back on its guides; 0 is no, anything else yes.
    pub two_way: u32,
    /// Whether hairs near solids are corrected one by one. Without it, hair between guides passes through thin solids.
    pub residual: u32,
    /// Whether hairs keep apart from each other in what is read; a read then costs several times as much.
    pub hair_hair: u32,
    /// Worker threads of this hair; 0 for one a core. Results do not depend on it.
    pub n_threads: u32,
}

/// What a step met.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct AhReport {
    /// Contacts of guide segments with solids.
    pub guide_contacts: u64,
    /// Hairs corrected one by one.
    pub corrected_strands: u32,
    /// Hairs in contact with a solid.
    pub strands_in_contact: u32,
    /// Guides that hairs push.
    pub guides_pushed: u32,
    /// Hairs that follow other guides than before.
    pub set_changes: u32,
    /// Hairs put back because their state was not finite: 0 unless something is wrong.
    pub quarantined: u32,
    /// Stages in stage_s.
    pub n_stages: u32,
    /// Share of guide pairs that may be blended, 0 to 1.
    pub connectivity: f64,
    /// Deepest that a hair is left in a solid where it was looked at, cm; 0 for none.
    pub deepest_cm: f64,
    /// Wall time of each stage, s; their names are ah_stage_name(0) and so on.
    pub stage_s: [f64; AH_MAX_STAGES],
}

/// How far from one the square of a quaternion's length, and a matrix's products of columns, may be: single precision with
/// many products behind it, and no scale that could be meant.
const RIGID: f64 = 1e-3;

impl AhPose {
    /// No rotation, no translation.
    pub fn identity() -> Self {
        Self { translation: [0.0; 3], rotation: [0.0, 0.0, 0.0, 1.0] }
    }

    /// A pose from the three rows of `[R | t]`.
    pub(crate) fn from_rows(m: &[f32]) -> Result<Self, Error> {
        if let Some(&value) = m.iter().find(|x| !x.is_finite()) {
            let (what, value) = ("the matrix", f64::from(value));
            return Err(Error::Value { what, value, expected: "finite in all its numbers" });
        }
        let at = |row: usize, column: usize| f64::from(m[4 * row + column]);
        let rotation = Matrix3::from_fn(at);
        // Columns of a rotation are unit vectors at right angles; a mirror is off by two in the determinant alone.
        let by = (rotation.transpose() * rotation - Matrix3::identity()).abs().max().max(1.0 - rotation.determinant());
        if by > RIGID {
            return Err(Error::NotRigid { by });
        }
        let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
        Ok(Self { translation: [at(0, 3), at(1, 3), at(2, 3)], rotation: [q.i, q.j, q.k, q.w] })
    }

    /// The pose as the runtime wants it.
    pub(crate) fn isometry(&self, what: &'static str) -> Result<Isometry3<f64>, Error> {
        if let Some(&value) = self.translation.iter().chain(&self.rotation).find(|x| !x.is_finite()) {
            return Err(Error::Value { what, value, expected: "finite in all its numbers" });
        }
        let [x, y, z, w] = self.rotation;
        let q = Quaternion::new(w, x, y, z);
        if (q.norm_squared() - 1.0).abs() > RIGID {
            return Err(Error::Value { what, value: q.norm(), expected: "of length one in its quaternion" });
        }
        let translation: Vector3<f64> = self.translation.into();
        Ok(Isometry3::from_parts(Translation3::from(translation), UnitQuaternion::from_quaternion(q)))
    }
}

impl AhParams {
    /// What a mode is made of.
    pub(crate) fn of_mode(mode: u32) -> Result<Self, Error> {
        let preset = preset(mode)?;
        Ok(Self {
            mode,
            two_way: preset.two_way.enabled.into(),
            residual: u32::from(preset.residual.correction == Correction::Carried),
            hair_hair: 0,
            n_threads: 0,
        })
    }

    /// The parameters of the runtime.
    pub(crate) fn runtime_params(&self) -> Result<RuntimeParams, Error> {
        let mut params = preset(self.mode)?;
        params.two_way.enabled = self.two_way != 0;
        params.residual.correction = if self.residual == 0 { Correction::None } else { Correction::Carried };
        params.hair_hair.enabled = self.hair_hair != 0;
        Ok(params)
    }
}

impl From<&StepReport> for AhReport {
    fn from(report: &StepReport) -> Self {
        let mut stage_s = [0.0; AH_MAX_STAGES];
        let stages = report.timings.named();
        for (to, (_, seconds)) in stage_s.iter_mut().zip(stages) {
            *to = seconds;
        }
        Self {
            guide_contacts: report.guide_contacts,
            corrected_strands: report.corrected_strands,
            strands_in_contact: report.strands_in_contact,
            guides_pushed: report.guides_pushed,
            set_changes: report.set_changes,
            quarantined: report.quarantined,
            n_stages: stages.len().min(AH_MAX_STAGES) as u32,
            connectivity: report.connectivity,
            deepest_cm: f64::from(report.deepest_cm),
            stage_s,
        }
    }
}

fn preset(mode: u32) -> Result<RuntimeParams, Error> {
    match mode {
        AH_MODE_ADAPTIVE => Ok(RuntimeParams::adaptive()),
        AH_MODE_NO_TWO_WAY => Ok(RuntimeParams::no_two_way()),
        AH_MODE_FIXED => Ok(RuntimeParams::fixed()),
        AH_MODE_PAPER => Ok(RuntimeParams::paper()),
        _ => Err(Error::Value { what: "mode", value: mode.into(), expected: "one of AH_MODE_*" }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    /// Coordinates of a few cm through a matrix in single precision.
    const ROUND_OFF_CM: f64 = 1e-5;

    #[test]
    fn a_matrix_and_its_pose_move_points_alike() {
        let m = [0.0, -1.0, 0.0, 3.0, 0.8, 0.0, -0.6, -4.0, 0.6, 0.0, 0.8, 5.0];
        let pose = AhPose::from_rows(&m).unwrap().isometry("pose").unwrap();
        let p = Point3::new(1.0, 2.0, 3.0);
        let by_matrix = Vector3::new(-2.0 + 3.0, 0.8 - 1.8 - 4.0, 0.6 + 2.4 + 5.0);
        assert!((pose * p - Point3::from(by_matrix)).norm() < ROUND_OFF_CM);
    }

    #[test]
    fn scales_mirrors_and_numbers_that_are_none_are_no_poses() {
        let identity = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        assert_eq!(AhPose::from_rows(&identity).unwrap(), AhPose::identity());
        for (place, value) in
            [(0, 1.1), (0, -1.0), (1, 0.1), (0, f32::NAN), (3, f32::NAN), (4, 3e38), (5, f32::INFINITY)]
        {
            let mut m = identity;
            m[place] = value;
            assert!(AhPose::from_rows(&m).is_err(), "{value} at {place}");
        }
        let stretched = AhPose { rotation: [0.0, 0.0, 0.0, 1.1], ..AhPose::identity() };
        let nowhere = AhPose { translation: [f64::NAN, 0.0, 0.0], ..AhPose::identity() };
        assert!(stretched.isometry("pose").is_err() && nowhere.isometry("pose").is_err());
    }

    #[test]
    fn a_modes_defaults_are_that_mode() {
        for mode in [AH_MODE_ADAPTIVE, AH_MODE_NO_TWO_WAY, AH_MODE_FIXED, AH_MODE_PAPER] {
            assert_eq!(AhParams::of_mode(mode).unwrap().runtime_params().unwrap(), preset(mode).unwrap());
        }
        assert!(AhParams::of_mode(4).is_err());
    }

    #[test]
    fn switches_reach_the_runtime() {
        let params = AhParams { two_way: 0, residual: 7, ..AhParams::of_mode(AH_MODE_PAPER).unwrap() };
        let params = params.runtime_params().unwrap();
        assert!(!params.two_way.enabled && params.residual.correction == Correction::Carried);
    }

    #[test]
    fn the_headers_version_is_the_packages() {
        let parts = [env!("CARGO_PKG_VERSION_MAJOR"), env!("CARGO_PKG_VERSION_MINOR"), env!("CARGO_PKG_VERSION_PATCH")];
        let packed = parts.iter().fold(0, |sum, part| 100 * sum + part.parse::<u32>().unwrap());
        assert_eq!(packed, AH_VERSION);
    }
}
