//! Random head motion for training (NI20 §5.2): random key poses, SLERPed in between under a speed limit.

use io_formats::motion::{PoseKey, PoseMotion};
use nalgebra::{UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Range of the head's turns and how fast it makes them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadMotionParams {
    /// Largest turn about x (nod), y (shake) and z (tilt), radians.
    pub range: [f64; 3],
    /// Largest angular speed, radian/s.
    pub max_speed: f64,
    /// Largest displacement of the pivot, cm.
    pub shift_cm: f64,
    /// Longest rest at a key pose, s.
    pub max_rest_s: f64,
}

impl HeadMotionParams {
    /// A lively but human head.
    #[must_use]
    pub fn lively() -> Self {
        Self { range: [0.6, 1.1, 0.45], max_speed: 5.0, shift_cm: 3.0, max_rest_s: 0.3 }
    }
}

/// Keys per second of the sampled motion: a smooth course is sampled finely enough for linear pieces.
const KEYS_PER_S: f64 = 60.0;

/// A motion of the given length from the identity, the same for the same seed and sequence.
#[must_use]
pub fn random_head_motion(seed: u64, sequence: u64, seconds: f64, params: &HeadMotionParams) -> PoseMotion {
    let mut rng = Pcg64Mcg::seed_from_u64(seed ^ sequence.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let mut uniform = |limit: f64| if limit > 0.0 { rng.random_range(-limit..=limit) } else { 0.0 };
    // Course: arrival time, rotation, shift; the head rests from arrival until the next departure.
    let mut course = vec![(0.0, UnitQuaternion::identity(), Vector3::zeros())];
    let mut t = 0.0;
    while t < seconds {
        let (_, from, _) = course[course.len() - 1];
        let [x, y, z] = params.range.map(&mut uniform);
        let to = UnitQuaternion::from_euler_angles(x, y, z);
        let shift = Vector3::from_fn(|_, _| uniform(params.shift_cm));
        // Eased motion peaks at one and a half times its mean speed; up to twice as slow at random.
        let pace = 0.75 + 0.25 * uniform(1.0);
        let duration = (1.5 * from.angle_to(&to) / (params.max_speed * pace)).max(0.15);
        let rest = (0.5 + 0.5 * uniform(1.0)) * params.max_rest_s;
        course.push((t + duration, to, shift));
        course.push((t + duration + rest, to, shift));
        t += duration + rest;
    }
    let n_keys = (seconds * KEYS_PER_S).ceil() as usize;
    let keys = (0..=n_keys)
        .map(|k| {
            let time_s = k as f64 / KEYS_PER_S;
            let next = course.partition_point(|c| c.0 <= time_s).clamp(1, course.len() - 1);
            let (a, b) = (&course[next - 1], &course[next]);
            let s = ((time_s - a.0) / (b.0 - a.0).max(1e-9)).clamp(0.0, 1.0);
            let eased = s * s * (3.0 - 2.0 * s);
            // Exactly the first pose at its time, not its round-off: hair at rest then stays put to the last bit.
            let rotation = if eased > 0.0 { a.1.slerp(&b.1, eased) } else { a.1 };
            PoseKey { time_s, translation_cm: a.2.lerp(&b.2, eased), rotation }
        })
        .collect();
    PoseMotion { keys }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_head_never_turns_faster_than_the_limit() {
        let params = HeadMotionParams::lively();
        for sequence in 0..20 {
            let motion = random_head_motion(7, sequence, 5.0, &params);
            for w in motion.keys.windows(2) {
                let speed = w[0].rotation.angle_to(&w[1].rotation) / (w[1].time_s - w[0].time_s);
                assert!(speed <= 1.001 * params.max_speed, "{speed}");
            }
        }
    }

    #[test]
    fn sequences_of_one_seed_differ_and_repeat() {
        let motion = |sequence| random_head_motion(7, sequence, 2.0, &HeadMotionParams::lively());
        assert_eq!(motion(1), motion(1));
        assert_ne!(motion(1), motion(2));
        assert_eq!(motion(1).pose_at(0.0), nalgebra::Isometry3::identity());
    }
}
