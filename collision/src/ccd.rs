//! When a moving segment first touches a moving solid, between the ends of a step: point/triangle and edge/edge at once,
//! in the solid's frame, its rotation included.
//!
//! Seen from a turning solid an end of a segment moves on a curve. Time is halved: an interval is dropped only when the
//! distance at its middle exceeds all relative motion left in it, the curve's bulge counted. Where DESIGN asks which
//! feature meets which, the distance of segment and triangle answers for all of them. Invariant: no touch is missed; what is
//! reported came within the tolerance. A segment that is inside from start to end touches nothing. MS08 §5.1, Bridson,
//! Fedkiw, Anderson 2002 §7.4.

use crate::segment_pair::{Segment, Sweep, between};
use crate::solid::SolidPose;
use crate::surface::{Surface, Triangle, closest_to_triangle};
use nalgebra::{Point3, Vector3};

/// Halvings of the step at most; below 2⁻⁴⁰ of it time itself is round-off.
const MAX_DEPTH: u32 = 40;

/// Intervals looked at for one triangle before the search stops and reports where it stands: only motions that slide along
/// the surface at about the tolerance get this far.
const MAX_INTERVALS: u32 = 4096;

/// Round-off allowed in a distance, relative to the coordinates.
const DISTANCE_ROUND_OFF: f64 = 1e-13;

/// Shortest offset that still has a direction, cm.
const SHORTEST_CM: f64 = 1e-9;

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
    let (low, high) =
        [start[1], end[0], end[1]].iter().fold((start[0], start[0]), |(low, high), p| (low.inf(p), high.sup(p)));
    // Between its ends the curve leaves its chord by an eighth of its second derivative.
    let margin = tolerance + 0.125 * path.bend;
    if !(low.iter().chain(high.iter()).all(|x| x.is_finite()) && margin.is_finite()) {
        return None;
    }
    let mut first: Option<SurfaceHit> = None;
    for triangle in surface.triangles_near(low, high, margin) {
        let until = first.map_or(1.0, |hit| hit.time);
        if let Some(hit) = path.first_touch(surface, triangle, tolerance, until) {
            // Among touches at one time the lowest triangle counts, whatever the order of the search.
            if first.is_none_or(|f| (hit.time, hit.triangle) < (f.time, f.triangle)) {
                first = Some(hit);
            }
        }
    }
    first
}

/// The way of a segment as seen from the solid.
struct Path<'a> {
    pose: &'a SolidPose,
    sweep: &'a Sweep,
    /// Bound on the second derivative of any of its points by the fraction of the step, cm.
    bend: f64,
}

impl<'a> Path<'a> {
    fn new(pose: &'a SolidPose, sweep: &'a Sweep) -> Self {
        // x = Rᵀ(X - c), with X - c linear in time and Ṙ = [ω]R: ẍ = Rᵀ(ω×(ω×(X - c)) - 2ω×(Ẋ - ċ)).
        let turn = (pose.to.rotation * pose.from.rotation.inverse()).angle();
        let shift = pose.to.translation.vector - pose.from.translation.vector;
        let (mut speed, mut arm): (f64, f64) = (0.0, 0.0);
        for k in 0..2 {
            let (a, b) = (sweep.start[k] - pose.from.translation.vector, sweep.end[k] - pose.to.translation.vector);
            speed = speed.max((sweep.end[k] - sweep.start[k] - shift).norm());
            arm = arm.max(a.norm()).max(b.norm());
        }
        Self { pose, sweep, bend: turn * (turn * arm + 2.0 * speed) }
    }

    /// The segment at a fraction of the step, in the solid's frame.
    fn at(&self, time: f64) -> Segment {
        let pose = self.pose.at(time);
        between(&self.sweep.start, &self.sweep.end, time).map(|x| pose.inverse_transform_point(&Point3::from(x)).coords)
    }

    fn first_touch(&self, surface: &Surface, triangle: u32, tolerance: f64, until: f64) -> Option<SurfaceHit> {
        let corners = surface.corners(triangle as usize);
        let corners_at =
            |time: f64| -> Triangle { [0, 1, 2].map(|k| corners[0][k] + (corners[1][k] - corners[0][k]) * time) };
        let mut pending = [(0.0, 0, [Vector3::zeros(); 2], [Vector3::zeros(); 2]); MAX_DEPTH as usize + 2];
        pending[0] = (0.0, 0, self.at(0.0), self.at(1.0));
        let (mut n_pending, mut looked_at) = (1, 0);
        while n_pending > 0 {
            n_pending -= 1;
            let (begin, depth, from, to) = pending[n_pending];
            if begin > until {
                continue;
            }
            let length = 1.0 / (1u64 << depth) as f64;
            let middle = begin + 0.5 * length;
            let (segment, face) = (self.at(middle), corners_at(middle));
            let closest = closest_to_triangle(&segment, &face);
            let scale = segment.iter().chain(&face).map(|x| x.amax()).fold(0.0, f64::max);
            let reach = 0.5 * relative_motion(&from, &to, &corners, length)
                + 0.25 * self.bend * length * length
                + DISTANCE_ROUND_OFF * scale;
            if closest.distance2 > reach * reach {
                continue;
            }
            looked_at += 1;
            // Within the interval no distance is off by more than `reach` from that at the middle, itself below it.
            if reach <= 0.5 * tolerance || depth == MAX_DEPTH || looked_at == MAX_INTERVALS {
                return Some(self.hit(begin, triangle, &from, &corners_at(begin)));
            }
            pending[n_pending] = (middle, depth + 1, segment, to);
            pending[n_pending + 1] = (begin, depth + 1, from, segment);
            n_pending += 2;
        }
        None
    }

    fn hit(&self, time: f64, triangle: u32, segment: &Segment, face: &Triangle) -> SurfaceHit {
        let closest = closest_to_triangle(segment, face);
        let [a, b, c] = *face;
        let point = segment[0] + (segment[1] - segment[0]) * closest.s - closest.offset;
        let normal = closest.offset.try_normalize(SHORTEST_CM).or_else(|| {
            let outward = (b - a).cross(&(c - a));
            outward.try_normalize(f64::MIN_POSITIVE)
        });
        SurfaceHit { time, s: closest.s, triangle, point, normal: normal.unwrap_or_else(Vector3::zeros) }
    }
}

/// Largest change of the chord between any point of the segment and any of the triangle over an interval: at a pair of
/// corners, since it is convex in both places.
fn relative_motion(from: &Segment, to: &Segment, corners: &[Triangle; 2], length: f64) -> f64 {
    let mut largest: f64 = 0.0;
    for k in 0..2 {
        for c in 0..3 {
            largest = largest.max((to[k] - from[k] - (corners[1][c] - corners[0][c]) * length).norm_squared());
        }
    }
    largest.sqrt()
}
