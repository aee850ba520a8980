//! Rigid motions as timed poses: how a head or a solid moves in the world (cm, seconds).
//!
//! Between keys translation is linear and rotation spherical linear; before the first and after the last key the pose
//! holds. A motion taken from a BVH joint is relative to its first used frame, so that `pose_at(0)` is the identity and
//! the hair starts at rest where the groom puts it.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::bvh::Bvh;
use crate::error::{Error, Result};

/// Largest turn between neighbouring keys of [`PoseMotion::about_pivot`]: the pivot then strays from its path by less than
/// 4e-5 of its distance from the origin.
const MAX_TURN_RAD: f64 = 1.0 * std::f64::consts::PI / 180.0;

/// Most intermediate keys in one gap; reached only by nonsense.
const MAX_INSERTED: usize = 1000;

/// One timed pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseKey {
    /// Time in seconds.
    pub time_s: f64,
    /// Where the origin goes (cm).
    pub translation_cm: Vector3<f64>,
    /// Rotation about the origin, applied first.
    pub rotation: UnitQuaternion<f64>,
}

/// A rigid motion; without keys the body rests at the identity.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PoseMotion {
    /// Keys in order of time.
    pub keys: Vec<PoseKey>,
}

/// What a recorded motion does after its last frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MotionEnd {
    /// Keep the last pose.
    Hold,
    /// Play backwards and forwards again until this time (s), so that no pose jumps.
    Repeat {
        /// Time to fill, in seconds.
        until_s: f64,
    },
}

impl PoseMotion {
    /// A body that does not move.
    #[must_use]
    pub fn still() -> Self {
        Self::default()
    }

    /// Keys whose rotations turn about `pivot_cm`, expressed as poses of the origin: each key maps `p` to
    /// `pivot + rotation * (p - pivot) + translation`. Keys are inserted where a turn is large, so that the pivot does
    /// not cut corners in between.
    ///
    /// # Errors
    /// As [`PoseMotion::validate`].
    pub fn about_pivot(keys: &[PoseKey], pivot_cm: Vector3<f64>) -> Result<Self> {
        let plain = Self { keys: keys.to_vec() };
        plain.validate()?;
        let mut out = Vec::with_capacity(keys.len());
        for (i, key) in keys.iter().enumerate() {
            if let Some(last) = i.checked_sub(1).map(|j| keys[j]).filter(|_| pivot_cm != Vector3::zeros()) {
                let turn = last.rotation.angle_to(&key.rotation);
                let n = ((turn / MAX_TURN_RAD).ceil() as usize).clamp(1, MAX_INSERTED);
                for k in 1..n {
                    let time_s = last.time_s + (key.time_s - last.time_s) * k as f64 / n as f64;
                    out.push(shifted(key_of(time_s, plain.pose_at(time_s)), pivot_cm));
                }
            }
            out.push(shifted(*key, pivot_cm));
        }
        Ok(Self { keys: out })
    }

    /// The motion of a BVH joint relative to frame `skip_frames`, whose time becomes 0, turning about `pivot_cm` (the
    /// head's own pivot) instead of the joint: `pose_at(0)` is the identity. Axes are those of the file.
    ///
    /// # Errors
    /// When there is no such joint or fewer than one frame is left.
    pub fn from_bvh(
        bvh: &Bvh,
        joint: usize,
        cm_per_unit: f64,
        skip_frames: usize,
        pivot_cm: Vector3<f64>,
        end: MotionEnd,
    ) -> Result<Self> {
        Self::from_bvh_turned(bvh, joint, cm_per_unit, skip_frames, 0.0, pivot_cm, end)
    }

    /// [`PoseMotion::from_bvh`] with the file's world first turned by `yaw_rad` about y, so that the actor faces where
    /// the head does: what is a nod in the file is then a nod of the head.
    ///
    /// # Errors
    /// As [`PoseMotion::from_bvh`].
    pub fn from_bvh_turned(
        bvh: &Bvh,
        joint: usize,
        cm_per_unit: f64,
        skip_frames: usize,
        yaw_rad: f64,
        pivot_cm: Vector3<f64>,
        end: MotionEnd,
    ) -> Result<Self> {
        let yaw = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), yaw_rad);
        if joint >= bvh.n_joints() {
            return Err(Error::BadMotion { reason: format!("joint {joint} of {}", bvh.n_joints()) });
        }
        if skip_frames >= bvh.n_frames() {
            let reason = format!("{skip_frames} frames are skipped, the file has {}", bvh.n_frames());
            return Err(Error::BadMotion { reason });
        }
        if !(cm_per_unit.is_finite() && cm_per_unit > 0.0) {
            return Err(Error::BadMotion { reason: format!("{cm_per_unit} cm per unit") });
        }
        let first = bvh.world_pose(skip_frames, joint);
        let mut keys: Vec<PoseKey> = (skip_frames..bvh.n_frames())
            .map(|frame| {
                let pose = bvh.world_pose(frame, joint);
                PoseKey {
                    time_s: (frame - skip_frames) as f64 * bvh.frame_time(),
                    translation_cm: yaw * (pose.translation.vector - first.translation.vector) * cm_per_unit,
                    rotation: yaw * pose.rotation * first.rotation.inverse() * yaw.inverse(),
                }
            })
            .collect();
        // Exactly the identity, not its round-off: a hair at rest then stays put to the last bit.
        keys[0].translation_cm = Vector3::zeros();
        keys[0].rotation = UnitQuaternion::identity();
        if let MotionEnd::Repeat { until_s } = end {
            repeat(&mut keys, bvh.frame_time(), until_s)?;
        }
        Self::about_pivot(&keys, pivot_cm)
    }

    /// The pose at time `t` (s); the nearest end's pose outside the keys.
    #[must_use]
    pub fn pose_at(&self, t: f64) -> Isometry3<f64> {
        let after = self.keys.partition_point(|k| k.time_s <= t);
        match (after.checked_sub(1).map(|i| &self.keys[i]), self.keys.get(after)) {
            (None, None) => Isometry3::identity(),
            (Some(k), None) | (None, Some(k)) => Isometry3::from_parts(k.translation_cm.into(), k.rotation),
            (Some(a), Some(b)) => {
                let s = (t - a.time_s) / (b.time_s - a.time_s);
                let translation: Translation3<f64> = a.translation_cm.lerp(&b.translation_cm, s).into();
                // By axis and angle: the arc cosine of the usual slerp is off by 1e-7 rad for small turns, and undefined
                // for half a turn, where any of the ways round will do.
                let rotation = a.rotation * (a.rotation.inverse() * b.rotation).powf(s);
                Isometry3::from_parts(translation, rotation)
            }
        }
    }

    /// Time of the last key (s), 0 without keys.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.keys.last().map_or(0.0, |k| k.time_s)
    }

    /// Checks that keys are finite and their times strictly ascending.
    ///
    /// # Errors
    /// [`Error::BadMotion`] naming the first offending key.
    pub fn validate(&self) -> Result<()> {
        for (i, key) in self.keys.iter().enumerate() {
            let finite = key.time_s.is_finite()
                && key.translation_cm.iter().all(|x| x.is_finite())
                && key.rotation.coords.iter().all(|x| x.is_finite());
            if !finite {
                return Err(Error::BadMotion { reason: format!("key {i} is not finite") });
            }
        }
        match self.keys.windows(2).position(|w| w[0].time_s >= w[1].time_s) {
            Some(i) => {
                let (a, b) = (self.keys[i].time_s, self.keys[i + 1].time_s);
                Err(Error::BadMotion { reason: format!("key {} at {b} s does not come after {a} s", i + 1) })
            }
            None => Ok(()),
        }
    }
}

fn key_of(time_s: f64, pose: Isometry3<f64>) -> PoseKey {
    PoseKey { time_s, translation_cm: pose.translation.vector, rotation: pose.rotation }
}

fn shifted(key: PoseKey, pivot: Vector3<f64>) -> PoseKey {
    PoseKey { translation_cm: key.translation_cm + (pivot - key.rotation * pivot), ..key }
}

/// Appends the keys backwards, then forwards, and so on, until `until_s`.
fn repeat(keys: &mut Vec<PoseKey>, frame_time: f64, until_s: f64) -> Result<()> {
    const MAX_KEYS: f64 = 1e7;
    if !(until_s.is_finite() && until_s / frame_time < MAX_KEYS) {
        return Err(Error::BadMotion { reason: format!("cannot repeat a motion until {until_s} s") });
    }
    let n = keys.len();
    if n < 2 {
        return Ok(());
    }
    let period = 2 * (n - 1);
    while keys[keys.len() - 1].time_s < until_s {
        let i = keys.len();
        let phase = i % period;
        let source = keys[if phase < n { phase } else { period - phase }];
        keys.push(PoseKey { time_s: i as f64 * frame_time, ..source });
    }
    Ok(())
}
