//! Two segments: their closest points, and whether they cross while their ends move linearly.
//!
//! Crossing means being coplanar and touching at one time. Instead of solving the coplanarity cubic, whose double and
//! missing roots are where edge/edge tests fail, time is halved: an interval is dropped only when the cubic provably
//! keeps its sign there, or when the distance at its middle exceeds all relative motion left in it. Invariant: no
//! crossing is missed, parallel and degenerate motions included; what is reported came within the tolerance. Bridson,
//! Fedkiw, Anderson 2002 §7.4, used by MS08 §5.3.

use nalgebra::Vector3;

/// Both ends of a segment, cm.
pub type Segment = [Vector3<f64>; 2];

/// A segment at the start and at the end of a step, its ends moving linearly; cm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sweep {
    /// At the start.
    pub start: Segment,
    /// At the end.
    pub end: Segment,
}

impl Sweep {
    /// A segment that stays where it is.
    #[must_use]
    pub fn still(segment: Segment) -> Self {
        Self { start: segment, end: segment }
    }
}

/// Squared sine of the angle below which two segments count as parallel: their crossing then lies closer to an end than
/// any tolerance in use, and the end-to-segment distances stand in for it.
const PARALLEL_SIN2: f64 = 1e-24;

/// Round-off allowed in a coplanarity coefficient, relative to the product of the lengths it is made of.
const CUBIC_ROUND_OFF: f64 = 1e-13;

/// Round-off allowed in a distance, relative to the coordinates.
const DISTANCE_ROUND_OFF: f64 = 1e-14;

/// Intervals looked at before the search stops and reports what it stands at: only motions that graze at a distance
/// far below their length, in one plane, get this far.
const MAX_INTERVALS: u32 = 4096;

/// Halvings of the step at most; below 2⁻⁴⁰ of it time itself is round-off.
const MAX_DEPTH: u32 = 40;

/// The closest points of two segments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Closest {
    /// Place on the first segment, 0 at its first end, 1 at its second.
    pub s: f64,
    /// Place on the second segment.
    pub t: f64,
    /// From the first segment's point to the second's, cm.
    pub offset: Vector3<f64>,
    /// Squared distance, cm².
    pub distance2: f64,
}

/// Closest points of two segments. A crossing inside both is the minimum; otherwise the minimum is at one of the four
/// ends. Segments of no length are points; among equal distances the first found is kept.
#[inline]
pub fn closest_points(a: &Segment, b: &Segment) -> Closest {
    let (u, v, w) = (a[1] - a[0], b[1] - b[0], b[0] - a[0]);
    let (uu, vv) = (u.norm_squared(), v.norm_squared());
    let cross = u.cross(&v);
    let cross2 = cross.norm_squared();
    if cross2 > PARALLEL_SIN2 * uu * vv {
        let s = w.cross(&v).dot(&cross) / cross2;
        let t = w.cross(&u).dot(&cross) / cross2;
        if (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t) {
            return closest_at(&w, &u, &v, s, t);
        }
    }
    let (wu, wv, uv) = (w.dot(&u), w.dot(&v), u.dot(&v));
    let fraction = |along: f64, length2: f64| if length2 > 0.0 { (along / length2).clamp(0.0, 1.0) } else { 0.0 };
    let mut best = closest_at(&w, &u, &v, 0.0, fraction(-wv, vv));
    for (s, t) in [(1.0, fraction(uv - wv, vv)), (fraction(wu, uu), 0.0), (fraction(wu + uv, uu), 1.0)] {
        let other = closest_at(&w, &u, &v, s, t);
        if other.distance2 < best.distance2 {
            best = other;
        }
    }
    best
}

#[inline(always)]
fn closest_at(w: &Vector3<f64>, u: &Vector3<f64>, v: &Vector3<f64>, s: f64, t: f64) -> Closest {
    let offset = w + v * t - u * s;
    Closest { s, t, offset, distance2: offset.norm_squared() }
}

/// First touch of two moving segments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// When, 0 at the start of the step, 1 at its end.
    pub time: f64,
    /// Place on the first segment.
    pub s: f64,
    /// Place on the second segment.
    pub t: f64,
    /// Distance left at that time, cm: within the tolerance, but for searches cut short.
    pub distance: f64,
}

/// First time two segments cross while all four ends move linearly from `start` to `end`, or None.
///
/// Every crossing is reported. A pair that comes within `tolerance` cm without crossing may be reported as well; so may,
/// after some thousand intervals, one that slides along in a single plane at a distance far below its motion.
/// Non-finite ends report nothing.
/// Implements MS08 §5.3: edge/edge detection of Bridson 2002 over one step.
pub fn first_crossing(
    a_start: &Segment,
    a_end: &Segment,
    b_start: &Segment,
    b_end: &Segment,
    tolerance: f64,
) -> Option<Hit> {
    let motion = relative_motion(a_start, a_end, b_start, b_end);
    if !motion.is_finite() {
        return None;
    }
    let scale = [a_start, a_end, b_start, b_end].iter().flat_map(|s| s.iter()).map(|x| x.amax()).fold(0.0, f64::max);
    let slack = DISTANCE_ROUND_OFF * scale;
    let at = |time: f64| closest_points(&between(a_start, a_end, time), &between(b_start, b_end, time));
    // The whole step first: most pairs end here, before the cubic is formed.
    let middle = at(0.5);
    if exceeds(&middle, 0.5 * motion + slack) {
        return None;
    }
    let (cubic, round_off) = coplanarity(a_start, a_end, b_start, b_end);
    if keeps_sign(&cubic, round_off) {
        return None;
    }
    let mut pending = [(0.0, 0, cubic); MAX_DEPTH as usize + 2];
    let mut n_pending = 1;
    let mut looked_at = 0;
    while n_pending > 0 {
        n_pending -= 1;
        let (begin, depth, cubic) = pending[n_pending];
        if keeps_sign(&cubic, round_off) {
            continue;
        }
        let half = 0.5 / (1u64 << depth) as f64;
        let closest = at(begin + half);
        let reach = half * motion + slack;
        if exceeds(&closest, reach) {
            continue;
        }
        looked_at += 1;
        // Within the interval no distance is off by more than `reach` from that at the middle, which itself is below it.
        if reach <= 0.5 * tolerance || depth == MAX_DEPTH || looked_at == MAX_INTERVALS {
            return Some(Hit { time: begin + half, s: closest.s, t: closest.t, distance: closest.distance2.sqrt() });
        }
        let (early, late) = halves(&cubic);
        pending[n_pending] = (begin + half, depth + 1, late);
        pending[n_pending + 1] = (begin, depth + 1, early);
        n_pending += 2;
    }
    None
}

/// The segment at a fraction of its way.
#[inline(always)]
pub fn between(start: &Segment, end: &Segment, time: f64) -> Segment {
    [start[0] + (end[0] - start[0]) * time, start[1] + (end[1] - start[1]) * time]
}

/// Whether the distance is surely larger. Not a number counts as no.
#[inline(always)]
fn exceeds(closest: &Closest, distance: f64) -> bool {
    closest.distance2 > distance * distance
}

/// Largest distance any point of one segment moves relative to any of the other, cm. Relative motion is bilinear in the
/// two places, its norm convex in each: the largest is at a pair of ends.
#[inline(always)]
fn relative_motion(a_start: &Segment, a_end: &Segment, b_start: &Segment, b_end: &Segment) -> f64 {
    let (da, db) = ([a_end[0] - a_start[0], a_end[1] - a_start[1]], [b_end[0] - b_start[0], b_end[1] - b_start[1]]);
    let mut largest: f64 = 0.0;
    for p in da {
        for q in db {
            let moved = (q - p).norm_squared();
            if moved.is_nan() {
                return f64::NAN;
            }
            largest = largest.max(moved);
        }
    }
    largest.sqrt()
}

/// Bernstein coefficients of the signed volume spanned by the two segments, and the round-off in them. The volume is a
/// triple product of vectors linear in time: the product of their end values in all orders, averaged.
fn coplanarity(a_start: &Segment, a_end: &Segment, b_start: &Segment, b_end: &Segment) -> ([f64; 4], f64) {
    let (u0, u1) = (a_start[1] - a_start[0], a_end[1] - a_end[0]);
    let (v0, v1) = (b_start[1] - b_start[0], b_end[1] - b_end[0]);
    let (w0, w1) = (b_start[0] - a_start[0], b_end[0] - a_end[0]);
    let (c00, c01, c10, c11) = (u0.cross(&v0), u0.cross(&v1), u1.cross(&v0), u1.cross(&v1));
    let mixed = c01 + c10;
    let cubic =
        [c00.dot(&w0), (c00.dot(&w1) + mixed.dot(&w0)) / 3.0, (c11.dot(&w0) + mixed.dot(&w1)) / 3.0, c11.dot(&w1)];
    let size = |x: &Vector3<f64>, y: &Vector3<f64>| x.amax().max(y.amax());
    // Differences of coordinates carry the round-off of the coordinates themselves.
    let place = a_start.iter().chain(a_end).chain(b_start).chain(b_end).map(|x| x.amax()).fold(0.0, f64::max);
    let (u, v, w) = (size(&u0, &u1), size(&v0, &v1), size(&w0, &w1));
    (cubic, CUBIC_ROUND_OFF * (u * v * w + place * f64::EPSILON / CUBIC_ROUND_OFF * (u * v + v * w + u * w) * 8.0))
}

/// Whether all coefficients stand clear of zero on one side: then so does the cubic between them.
#[inline(always)]
fn keeps_sign(cubic: &[f64; 4], round_off: f64) -> bool {
    cubic.iter().all(|&c| c > round_off) || cubic.iter().all(|&c| c < -round_off)
}

/// The cubic over the two halves of its interval (de Casteljau).
#[inline(always)]
fn halves(c: &[f64; 4]) -> ([f64; 4], [f64; 4]) {
    let (ab, bc, cd) = (0.5 * (c[0] + c[1]), 0.5 * (c[1] + c[2]), 0.5 * (c[2] + c[3]));
    let (abc, bcd) = (0.5 * (ab + bc), 0.5 * (bc + cd));
    let middle = 0.5 * (abc + bcd);
    ([c[0], ab, abc, middle], [middle, bcd, cd, c[3]])
}
