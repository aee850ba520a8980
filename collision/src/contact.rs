//! The deepest point of a segment in a solid: a tooth that passes between two particles is a contact all the same.
//!
//! A distance changes by at most one centimetre per centimetre, so a segment whose ends are far enough away is dismissed
//! at once, and along the others the march strides by what the last sample guarantees. Near the surface samples lie no
//! farther apart than `max_spacing`; the best is then refined between its neighbours, by the slope of the distance.

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

/// Most points looked at to refine the best sample.
const REFINEMENTS: usize = 4;
/// Gain of depth, as a share of the sample spacing, below which refinement ends.
const LEAST_GAIN: f32 = 1.0 / 256.0;
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
    deepest_between(sdf, [a, b], [sdf.distance(a), sdf.distance(b)], max_spacing, threshold)
}

/// As [`deepest_on_segment`], with the distances at the two ends known.
pub fn deepest_between<F: DistanceField>(
    sdf: &F,
    [a, b]: [Vector3<f32>; 2],
    [at_a, at_b]: [f32; 2],
    max_spacing: f32,
    threshold: f32,
) -> Option<SegmentContact> {
    let along = b - a;
    let length = along.norm();
    // What a sample guarantees around it, less the error of a sample there.
    let sure = |d: f32| sdf.surely(d) - sdf.max_error();
    if (at_a + at_b).is_nan() || sure(at_a) + sure(at_b) - length >= 2.0 * threshold {
        return None;
    }
    let spacing = max_spacing.max(length / MAX_SAMPLES as f32).max(f32::MIN_POSITIVE);
    // As few equal parts as are no longer than the spacing.
    let part = length / (length / spacing).ceil().max(1.0);
    let inv_length = if length > 0.0 { 1.0 / length } else { 0.0 };
    let place = |t: f32| a + along * (t * inv_length);

    // The best sample and those before and after it.
    let mut last = Sample { t: 0.0, d: at_a };
    let (mut before, mut best) = (last, last);
    let mut after = None;
    while last.t < length {
        // Nothing within reach can sample deeper than what is wanted.
        let t = last.t + (sure(last.d) - best.d.min(threshold)).max(part);
        // The last part ends at `b` but for rounding.
        let next = if t >= length - 0.5 * part || sure(at_b) - best.d.min(threshold) > length - t {
            Sample { t: length, d: at_b }
        } else {
            Sample { t, d: sdf.distance(place(t)) }
        };
        if next.d < best.d {
            (before, best, after) = (last, next, None);
        } else if after.is_none() {
            after = Some(next);
        }
        last = next;
    }
    if best.d >= threshold + part {
        return None;
    }
    let (best, normal) = refine(sdf, place, along * inv_length, before, best, after.unwrap_or(best), part);
    (best.d < threshold).then_some(SegmentContact { s: best.t * inv_length, distance: best.d, normal })
}

/// Distance `d` at `t` cm from the segment's first end.
#[derive(Clone, Copy)]
struct Sample {
    t: f32,
    d: f32,
}

/// Moves the best sample towards the lowest point between its neighbours; returns it with the normal there. A step goes
/// to the lowest point of the parabola with the slope at the best point and the height of the neighbour downhill of it,
/// which is right for a smooth surface and at most a quarter of the way wrong for a sharp one.
#[inline(always)]
fn refine<F: DistanceField>(
    sdf: &F,
    place: impl Fn(f32) -> Vector3<f32>,
    direction: Vector3<f32>,
    mut before: Sample,
    mut best: Sample,
    mut after: Sample,
    part: f32,
) -> (Sample, Vector3<f32>) {
    let (d, mut normal) = sdf.outward_normal(place(best.t));
    best.d = d;
    for _ in 0..REFINEMENTS {
        let slope = normal.dot(&direction);
        let downhill = if slope > 0.0 { before } else { after };
        let way = downhill.t - best.t;
        // Of a convex function no more than this is to be gained.
        if (slope * way).abs() <= LEAST_GAIN * part {
            break;
        }
        let bend = (downhill.d - best.d - slope * way) / (way * way);
        let step = -0.5 * slope / bend;
        // Never all the way, nor past the neighbour, whatever the samples say.
        let share = if bend > 0.0 { (step / way).clamp(0.05, 0.95) } else { 0.5 };
        let t = best.t + share * way;
        let (d, there) = sdf.outward_normal(place(t));
        let next = Sample { t, d };
        let is_lower = next.d < best.d;
        // What lies uphill of the lower of the two ends the range on that side.
        let uphill = if is_lower { best } else { next };
        if is_lower == (slope > 0.0) {
            after = uphill;
        } else {
            before = uphill;
        }
        if is_lower {
            (best, normal) = (next, there);
        }
    }
    (best, normal)
}
