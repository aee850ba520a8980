//! When a moving segment first touches a moving solid, between the ends of a step: point/triangle and edge/edge at once,
//! in the solid's frame, its rotation included.
//!
//! Seen from a turning solid an end of a segment moves on a curve. Time is halved: an interval is dropped only when the
//! distance at its middle exceeds all relative motion left in it, the curve's bulge counted. Where DESIGN asks which
//! feature meets which, the distance of segment and triangle answers for all of them. Invariant: no touch is missed; what is
//! reported came within the tolerance. A segment that is inside from start to end touches nothing. MS08 §5.1, Bridson,
//! Fedkiw, Anderson 2002 §7.4.

use crate::segment_pair::{Closest, Segment, Sweep, between};
use crate::solid::SolidPose;
use crate::surface::{Surface, Triangle, closest_to_triangle};
use nalgebra::{Point3, Vector3};

/// Halvings of the step at most; below 2⁻⁴⁰ of it time itself is round-off.
const MAX_DEPTH: u32 = 40;

/// Intervals looked at before the search stops and reports where it stands: only motions that slide along the surface at
/// about the tolerance get this far.
const MAX_INTERVALS: u32 = 1 << 14;

/// Round-off allowed in a distance, relative to the coordinates.
const DISTANCE_ROUND_OFF: f64 = 1e-13;

/// Shortest offset that still has a direction, relative to the coordinates.
const SHORTEST: f64 = 1e-10;

/// First touch of a segment and a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceHit {
    /// When, 0 at the start of the step, 1 at its end; up to here the segment is free.
    pub time: f64,
    /// Place on the segment, 0 at its first end.
    pub s: f64,
    /// The triangle met.
    pub triangle: u32,
    /// Point of the surface, cm, in the solid's frame at that time.
    pub point: Vector3<f64>,
    /// Unit vector from the surface to the segment, in the solid's frame at that time; of a segment that lies in the
    /// surface, the triangle's own normal.
    pub normal: Vector3<f64>,
}

/// First time a segment that moves linearly in the world touches a surface that `pose` carries, or None.
///
/// Every touch is reported; so may be an approach to within `tolerance` cm. Ends that are not finite touch nothing.
/// Implements MS08 §5.1: a tooth cannot pass between two particles within a step.
#[must_use]
pub fn first_touch(surface: &Surface, pose: &SolidPose, sweep: &Sweep, tolerance: f64) -> Option<SurfaceHit> {
    let path = Path::new(pose, sweep);
    let (start, end) = (path.at(0.0), path.at(1.0));
    let finite = start.iter().chain(&end).all(|p| p.iter().all(|x| x.is_finite()));
    if !(finite && path.bend.is_finite()) {
        return None;
    }
    let mut pending = [(0.0, 0, start, end); MAX_DEPTH as usize + 2];
    let (mut n_pending, mut looked_at) = (1, 0);
    // The earliest interval is always the next: the first that holds a touch is the answer.
    while n_pending > 0 {
        n_pending -= 1;
        let (begin, depth, from, to) = pending[n_pending];
        let length = 1.0 / (1u64 << depth) as f64;
        let middle = begin + 0.5 * length;
        let segment = path.at(middle);
        let reach = Reach::new(surface, &path, [&from, &to, &segment], length);
        if !reach.comes_near(&segment, middle) {
            continue;
        }
        looked_at += 1;
        // Within the interval no distance is off by more than the reach from that at the middle, itself below it.
        if reach.widest <= 0.5 * tolerance || depth == MAX_DEPTH || looked_at == MAX_INTERVALS {
            return reach.nearest(&from, begin);
        }
        pending[n_pending] = (middle, depth + 1, segment, to);
        pending[n_pending + 1] = (begin, depth + 1, from, segment);
        n_pending += 2;
    }
    None
}

/// How far any point of the segment and any of the surface may come from their distance halfway through an interval.
struct Reach<'a> {
    surface: &'a Surface,
    /// The segment at both ends of the interval.
    ends: [&'a Segment; 2],
    /// Length of the interval as a fraction of the step.
    length: f64,
    /// What rounding and the bulge of the curve add to half the relative motion, cm.
    beyond: f64,
    /// The reach to whatever triangle moves most, cm.
    widest: f64,
}

impl<'a> Reach<'a> {
    fn new(surface: &'a Surface, path: &Path, [from, to, segment]: [&'a Segment; 3], length: f64) -> Self {
        let size = segment.iter().map(|x| x.amax()).fold(surface.size(), f64::max);
        let beyond = 0.25 * path.bend * length * length + DISTANCE_ROUND_OFF * size;
        let own = (0..2).map(|k| (to[k] - from[k]).norm()).fold(0.0, f64::max);
        let widest = 0.5 * (own + surface.largest_travel() * length) + beyond;
        Self { surface, ends: [from, to], length, beyond, widest }
    }

    /// Whether some triangle halfway through the interval is nearer than the two may have moved.
    fn comes_near(&self, segment: &Segment, middle: f64) -> bool {
        self.surface.triangles_near_segment(segment, self.widest).any(|t| {
            let corners = self.surface.corners(t as usize);
            let reach = 0.5 * relative_motion(self.ends, &corners, self.length) + self.beyond;
            closest_to_triangle(segment, &at(&corners, middle)).distance2 <= reach * reach
        })
    }

    /// The nearest triangle at the start of the interval; at one distance the lowest, whatever the order of the search.
    fn nearest(&self, segment: &Segment, time: f64) -> Option<SurfaceHit> {
        let mut first: Option<(u32, Closest)> = None;
        for triangle in self.surface.triangles_near_segment(segment, 2.0 * self.widest) {
            let closest = closest_to_triangle(segment, &at(&self.surface.corners(triangle as usize), time));
            let is_nearer = |(t, c): (u32, Closest)| (closest.distance2, triangle) < (c.distance2, t);
            if first.is_none_or(is_nearer) {
                first = Some((triangle, closest));
            }
        }
        let (triangle, closest) = first?;
        let [a, b, c] = at(&self.surface.corners(triangle as usize), time);
        let point = segment[0] + (segment[1] - segment[0]) * closest.s - closest.offset;
        let outward = (b - a).cross(&(c - a));
        let shortest = SHORTEST * segment.iter().map(|x| x.amax()).fold(self.surface.size(), f64::max);
        let normal = closest.offset.try_normalize(shortest).or_else(|| outward.try_normalize(f64::MIN_POSITIVE));
        Some(SurfaceHit { time, s: closest.s, triangle, point, normal: normal.unwrap_or_else(Vector3::zeros) })
    }
}

/// A triangle at a fraction of the step.
fn at(corners: &[Triangle; 2], time: f64) -> Triangle {
    [0, 1, 2].map(|k| corners[0][k] + (corners[1][k] - corners[0][k]) * time)
}

/// The way of a segment as seen from the solid.
struct Path<'a> {
    pose: &'a SolidPose,
    /// Rotation over the step as a scaled axis.
    turn: Vector3<f64>,
    sweep: &'a Sweep,
    /// Bound on the second derivative of any of its points by the fraction of the step, cm.
    bend: f64,
}

impl<'a> Path<'a> {
    fn new(pose: &'a SolidPose, sweep: &'a Sweep) -> Self {
        // x = Rᵀ(X - c), with X - c linear in time and Ṙ = [ω]R: ẍ = Rᵀ(ω×(ω×(X - c)) - 2ω×(Ẋ - ċ)).
        let turn = pose.turn();
        let angle = turn.norm();
        let shift = pose.to.translation.vector - pose.from.translation.vector;
        let (mut speed, mut arm): (f64, f64) = (0.0, 0.0);
        for k in 0..2 {
            let (a, b) = (sweep.start[k] - pose.from.translation.vector, sweep.end[k] - pose.to.translation.vector);
            speed = speed.max((sweep.end[k] - sweep.start[k] - shift).norm());
            arm = arm.max(a.norm()).max(b.norm());
        }
        Self { pose, turn, sweep, bend: angle * (angle * arm + 2.0 * speed) }
    }

    /// The segment at a fraction of the step, in the solid's frame.
    fn at(&self, time: f64) -> Segment {
        let pose = self.pose.turned_at(time, self.turn);
        between(&self.sweep.start, &self.sweep.end, time).map(|x| pose.inverse_transform_point(&Point3::from(x)).coords)
    }
}

/// Largest change of the chord between any point of the segment and any of the triangle over an interval: at a pair of
/// corners, since it is convex in both places.
fn relative_motion([from, to]: [&Segment; 2], corners: &[Triangle; 2], length: f64) -> f64 {
    let mut largest: f64 = 0.0;
    for k in 0..2 {
        for c in 0..3 {
            largest = largest.max((to[k] - from[k] - (corners[1][c] - corners[0][c]) * length).norm_squared());
        }
    }
    largest.sqrt()
}
