//! The deepest point of a segment in a solid: a tooth that passes between two particles is a contact all the same.
//!
//! A distance changes by at most one centimetre per centimetre, so a segment whose middle is far enough away is dismissed
//! after one sample, and along the others the march strides by what the last sample guarantees. Near the surface samples
//! lie no farther apart than `max_spacing`; the best is then refined between its neighbours.

use nalgebra::Vector3;

use crate::sdf::DistanceField;

/// Where a segment comes deepest into a solid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SegmentContact {
    /// Position along the segment, 0 at its first end and 1 at its second.
    pub s: f32,
    /// Signed distance there, cm.
    pub distance: f32,
    /// Unit normal out of the solid there, solid's frame.
    pub normal: Vector3<f32>,
}

/// Halvings of the sample spacing around the deepest sample.
const REFINEMENTS: usize = 3;
/// Most samples per segment: guards against a spacing of zero.
const MAX_SAMPLES: usize = 4096;

/// The deepest point of the segment `a`-`b` (solid's frame, cm) if its distance is below `threshold`, else `None`.
///
/// Samples lie at most `max_spacing` cm apart wherever the solid is near. A stretch that is below the threshold over less
/// than `max_spacing` may be missed, so pass the solid's half-thickness or less.
pub fn deepest_on_segment<F: DistanceField>(
    sdf: &F,
    a: Vector3<f32>,
    b: Vector3<f32>,
    max_spacing: f32,
    threshold: f32,
) -> Option<SegmentContact> {
    let along = b - a;
    let length = along.norm();
    let middle = sdf.distance(a + along * 0.5);
    if middle.is_nan() || sdf.surely(middle) - sdf.max_error() >= threshold + 0.5 * length {
        return None;
    }

    let spacing = max_spacing.max(length / MAX_SAMPLES as f32).max(f32::MIN_POSITIVE);
    let (mut best_t, mut best_d) = (0.5 * length, middle);
    let inv_length = if length > 0.0 { 1.0 / length } else { 0.0 };
    let sample = |t: f32| sdf.distance(a + along * (t * inv_length));
    let mut t = 0.0;
    loop {
        let d = sample(t);
        if d < best_d {
            (best_t, best_d) = (t, d);
        }
        if t >= length {
            break;
        }
        // Nothing within reach can sample deeper than what is wanted; the second error is that of the sample there.
        let reach = sdf.surely(d) - sdf.max_error() - best_d.min(threshold);
        t = (t + reach.max(spacing)).min(length);
    }
    if best_d < threshold + spacing {
        let mut step = 0.5 * spacing;
        for _ in 0..REFINEMENTS {
            for t in [(best_t - step).max(0.0), (best_t + step).min(length)] {
                let d = sample(t);
                if d < best_d {
                    (best_t, best_d) = (t, d);
                }
            }
            step *= 0.5;
        }
    }
    if best_d >= threshold {
        return None;
    }
    let s = best_t * inv_length;
    let (distance, normal) = sdf.outward_normal(a + along * s);
    Some(SegmentContact { s, distance, normal })
}
