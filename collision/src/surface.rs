//! The surface of a solid as triangles, in double precision, with a hierarchy of boxes: what exact tests ask.
//!
//! Triangles may move: corners go linearly from a start to an end, as between two keys of an animated mesh. Invariant: the
//! boxes contain what they stand for after rounding to single precision.

use crate::error::Error;
use crate::segment_pair::{Closest, Segment, closest_points};
use crate::solid::SolidPose;
use nalgebra::{Point3, Vector3};
use parry3d::bounding_volume::Aabb;
use parry3d::math::Vector;
use parry3d::partitioning::{Bvh, BvhBuildStrategy};

/// Triangles of a solid in its own frame, cm.
#[derive(Clone, Debug)]
pub struct Surface {
    start: Vec<Vector3<f64>>,
    end: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
    bvh: Bvh,
    /// Largest coordinate of any corner, and longest way of one over the step, cm.
    size: f64,
    largest_travel: f64,
}

/// A surface on its way through a step.
#[derive(Clone, Copy, Debug)]
pub struct MovingSurface<'a> {
    /// What moves.
    pub surface: &'a Surface,
    /// From where to where.
    pub pose: SolidPose,
}

/// Round-off of a corner's place anywhere in a scene, cm.
const ROUND_OUT_CM: f64 = 1e-6;

/// Round-off of a comparison with a box, relative to the coordinates.
const BOX_ROUND_OFF: f64 = 1e-14;

/// Corners of a triangle, cm.
pub type Triangle = [Vector3<f64>; 3];

impl Surface {
    /// A surface that does not change its shape.
    ///
    /// # Errors
    /// [`Error::NonFiniteVertex`], [`Error::UnknownVertex`], or [`Error::EmptyMesh`] where there is no triangle.
    pub fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Result<Self, Error> {
        Self::moving(positions, positions, triangles)
    }

    /// A surface whose corners go linearly from one place to another over the step.
    ///
    /// # Errors
    /// As [`Self::new`], and [`Error::Unusable`] if the two shapes differ in their number of vertices.
    pub fn moving(start: &[[f32; 3]], end: &[[f32; 3]], triangles: &[[u32; 3]]) -> Result<Self, Error> {
        let n_vertices = start.len();
        if end.len() != n_vertices {
            return Err(Error::Unusable {
                reason: format!("{n_vertices} vertices at the start of the step and {} at its end", end.len()),
            });
        }
        for positions in [start, end] {
            if let Some(vertex) = positions.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
                return Err(Error::NonFiniteVertex { vertex, position: positions[vertex] });
            }
        }
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= n_vertices) {
                return Err(Error::UnknownVertex { triangle, vertex, n_vertices });
            }
        }
        if triangles.is_empty() {
            return Err(Error::EmptyMesh { n_vertices, n_triangles: 0 });
        }
        let corner =
            |positions: &[[f32; 3]]| -> Vec<_> { positions.iter().map(|p| Vector3::from(*p).cast::<f64>()).collect() };
        let leaves = triangles.iter().enumerate().map(|(i, t)| {
            let points = t.iter().flat_map(|&v| [start[v as usize], end[v as usize]]);
            let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
            for p in points {
                for c in 0..3 {
                    (low[c], high[c]) = (low[c].min(p[c]), high[c].max(p[c]));
                }
            }
            (i, Aabb::new(Vector::new(low[0], low[1], low[2]), Vector::new(high[0], high[1], high[2])))
        });
        let bvh = Bvh::from_iter(BvhBuildStrategy::Binned, leaves);
        let (start, end) = (corner(start), corner(end));
        let size = start.iter().chain(&end).map(|p| p.amax()).fold(0.0, f64::max);
        let largest_travel = start.iter().zip(&end).map(|(a, b)| (b - a).norm()).fold(0.0, f64::max);
        Ok(Self { start, end, triangles: triangles.to_vec(), bvh, size, largest_travel })
    }

    /// Largest coordinate of any vertex, cm.
    pub(crate) fn size(&self) -> f64 {
        self.size
    }

    /// Longest way of any vertex over the step, cm.
    pub(crate) fn largest_travel(&self) -> f64 {
        self.largest_travel
    }

    /// Number of triangles.
    #[must_use]
    pub fn n_triangles(&self) -> usize {
        self.triangles.len()
    }

    /// Corners of a triangle at the start and at the end of the step.
    #[must_use]
    pub fn corners(&self, triangle: usize) -> [Triangle; 2] {
        let corners = self.triangles[triangle].map(|v| v as usize);
        [corners.map(|v| self.start[v]), corners.map(|v| self.end[v])]
    }

    /// Triangles whose boxes over the step come within `margin` cm of the box from `low` to `high`.
    pub(crate) fn triangles_near<'a>(
        &'a self,
        low: Vector3<f64>,
        high: Vector3<f64>,
        margin: f64,
    ) -> impl Iterator<Item = u32> + 'a {
        let down = |x: f64| ((x - margin) as f32).next_down();
        let up = |x: f64| ((x + margin) as f32).next_up();
        let low = Vector::new(down(low.x), down(low.y), down(low.z));
        let high = Vector::new(up(high.x), up(high.y), up(high.z));
        self.bvh.leaves(move |node| {
            let (a, b) = (node.mins(), node.maxs());
            a.x <= high.x && a.y <= high.y && a.z <= high.z && low.x <= b.x && low.y <= b.y && low.z <= b.z
        })
    }

    /// Triangles whose boxes over the step come within `margin` cm of a segment. No axis separates what is returned: the
    /// box's own three and their products with the segment's direction (Ericson, Real-Time Collision Detection, §5.3.3).
    pub(crate) fn triangles_near_segment<'a>(
        &'a self,
        segment: &Segment,
        margin: f64,
    ) -> impl Iterator<Item = u32> + use<'a> {
        let middle = (segment[0] + segment[1]) * 0.5;
        let half = (segment[1] - segment[0]) * 0.5;
        let reach = half.abs();
        let margin = margin + BOX_ROUND_OFF * (middle.amax() + reach.amax() + self.size);
        self.bvh.leaves(move |node| {
            let (a, b) = (node.mins(), node.maxs());
            let low = Vector3::new(f64::from(a.x), f64::from(a.y), f64::from(a.z));
            let high = Vector3::new(f64::from(b.x), f64::from(b.y), f64::from(b.z));
            let size = (high - low) * 0.5 + Vector3::repeat(margin);
            let away = middle - (low + high) * 0.5;
            let turned = half.cross(&away);
            away.x.abs() <= size.x + reach.x
                && away.y.abs() <= size.y + reach.y
                && away.z.abs() <= size.z + reach.z
                && turned.x.abs() <= size.y * reach.z + size.z * reach.y
                && turned.y.abs() <= size.z * reach.x + size.x * reach.z
                && turned.z.abs() <= size.x * reach.y + size.y * reach.x
        })
    }

    /// Distance of a segment, in the surface's frame at the start of the step, cm; infinite where it exceeds `at_most`.
    #[must_use]
    pub fn distance_within(&self, segment: &Segment, at_most: f64) -> f64 {
        let nearest2 = self
            .triangles_near_segment(segment, at_most)
            .map(|t| closest_to_triangle(segment, &self.corners(t as usize)[0]).distance2)
            .fold(f64::INFINITY, f64::min);
        if nearest2 <= at_most * at_most { nearest2.sqrt() } else { f64::INFINITY }
    }

    /// Whether a segment, in the surface's frame at the start of the step, comes within so many cm of it.
    #[must_use]
    pub fn is_within(&self, segment: &Segment, distance: f64) -> bool {
        self.triangles_near_segment(segment, distance)
            .any(|t| closest_to_triangle(segment, &self.corners(t as usize)[0]).distance2 <= distance * distance)
    }

    /// Box (world, cm) that holds the surface all through a step, carried by `pose`.
    #[must_use]
    pub fn bounds_over(&self, pose: &SolidPose) -> [Vector3<f64>; 2] {
        let root = self.bvh.root_aabb();
        let corners = root.vertices().map(|v| Point3::new(f64::from(v.x), f64::from(v.y), f64::from(v.z)));
        let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for corner in corners {
            for place in [pose.from * corner, pose.to * corner] {
                (low, high) = (low.inf(&place.coords), high.sup(&place.coords));
            }
        }
        // Corners turn about an origin that goes straight: they leave the chord by no more than the arc's height.
        let arm = corners.iter().map(|c| c.coords.norm()).fold(0.0, f64::max);
        let turn = (pose.to.rotation * pose.from.rotation.inverse()).angle();
        let bulge = Vector3::repeat(arm * (1.0 - (0.5 * turn).cos()) + ROUND_OUT_CM);
        [low - bulge, high + bulge]
    }

    /// Whether a segment, in the surface's frame at the start of the step, touches or pierces it. Ends that are not
    /// finite touch nothing.
    #[must_use]
    pub fn is_hit_by(&self, segment: &Segment) -> bool {
        self.is_within(segment, 0.0)
    }

    /// Whether the bilinear patch between the rungs `[a0, b0]` and `[a1, b1]`, in the surface's frame at the start of the
    /// step, cm, touches the surface: the exact form of [`crate::clearance::ribbon_is_free`].
    ///
    /// Two triangles stand for a piece of the patch once it leaves them by at most `tolerance` cm. No touch is missed; a
    /// patch that passes within twice the tolerance may be reported. Corners that are not finite touch nothing.
    #[must_use]
    pub fn ribbon_is_hit(&self, corners: [Vector3<f64>; 4], tolerance: f64) -> bool {
        if !corners.iter().all(|p| p.iter().all(|x| x.is_finite())) {
            return false;
        }
        let size = corners.iter().map(|p| p.amax()).fold(0.0, f64::max);
        self.piece_is_hit(&corners, tolerance.max(RIBBON_ROUND_OFF * size))
    }

    /// Whether the ribbon between two strands (surface's frame, cm, root first) touches the surface at any of their rungs
    /// or between two. Strands of unequal count are compared up to the shorter.
    #[must_use]
    pub fn strand_ribbon_is_hit(&self, strand_i: &[Vector3<f64>], strand_j: &[Vector3<f64>], tolerance: f64) -> bool {
        match (strand_i, strand_j) {
            ([a], [b, ..]) | ([a, ..], [b]) => self.is_hit_by(&[*a, *b]),
            _ => strand_i
                .windows(2)
                .zip(strand_j.windows(2))
                .any(|(i, j)| self.ribbon_is_hit([i[0], j[0], i[1], j[1]], tolerance)),
        }
    }

    fn piece_is_hit(&self, corners: &[Vector3<f64>; 4], tolerance: f64) -> bool {
        let [a0, b0, a1, b1] = *corners;
        // The patch is its two triangles and the product of its places, at most a quarter, times the twist.
        let leaves = 0.25 * ((a0 - a1) - (b0 - b1)).norm();
        let (low, high) = corners.iter().fold((a0, a0), |(low, high), p| (low.inf(p), high.sup(p)));
        let halves = [[a0, b0, b1], [a0, b1, a1]];
        let mut near = false;
        for t in self.triangles_near(low, high, leaves) {
            let face = self.corners(t as usize)[0];
            // Sides of the patch are its own: touched, they need no finer look.
            if [[a0, b0], [b0, b1], [b1, a1], [a1, a0]].iter().any(|s| closest_to_triangle(s, &face).distance2 <= 0.0) {
                return true;
            }
            near = near || halves.iter().any(|half| triangles_within(half, &face, leaves));
        }
        if !near || leaves <= tolerance {
            return near;
        }
        let (across, along) = ((b0 - a0).norm().max((b1 - a1).norm()), (a1 - a0).norm().max((b1 - b0).norm()));
        let pieces = if across > along {
            let (m0, m1) = ((a0 + b0) * 0.5, (a1 + b1) * 0.5);
            [[a0, m0, a1, m1], [m0, b0, m1, b1]]
        } else {
            let (ma, mb) = ((a0 + a1) * 0.5, (b0 + b1) * 0.5);
            [[a0, b0, ma, mb], [ma, mb, a1, b1]]
        };
        pieces.iter().any(|piece| self.piece_is_hit(piece, tolerance))
    }
}

/// Finest tolerance of a ribbon relative to its coordinates: twelve digits are left for the geometry.
const RIBBON_ROUND_OFF: f64 = 1e-12;

/// Whether two triangles come within `distance` cm of each other: at their nearest, a side of one of them takes part.
fn triangles_within(one: &Triangle, other: &Triangle, distance: f64) -> bool {
    let sides = |t: &Triangle| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let within = |side: &Segment, t: &Triangle| closest_to_triangle(side, t).distance2 <= distance * distance;
    sides(one).iter().any(|side| within(side, other)) || sides(other).iter().any(|side| within(side, one))
}

/// The closest points of a segment and a triangle: `s` is the place on the segment, `offset` goes from the triangle to the
/// segment, `t` is not used. A segment through the triangle is at no distance.
pub(crate) fn closest_to_triangle(segment: &Segment, triangle: &Triangle) -> Closest {
    let [a, b, c] = *triangle;
    let normal = (b - a).cross(&(c - a));
    let heights = segment.map(|x| normal.dot(&(x - a)));
    if heights[0] * heights[1] <= 0.0 && heights[0] != heights[1] {
        let s = heights[0] / (heights[0] - heights[1]);
        let x = segment[0] + (segment[1] - segment[0]) * s;
        if is_above(&x, triangle, &normal) {
            return Closest { s, t: 0.0, offset: Vector3::zeros(), distance2: 0.0 };
        }
    }
    let mut best = Closest { s: 0.0, t: 0.0, offset: Vector3::zeros(), distance2: f64::INFINITY };
    for (p, q) in [(a, b), (b, c), (c, a)] {
        let found = closest_points(segment, &[p, q]);
        if found.distance2 < best.distance2 {
            best = Closest { offset: -found.offset, ..found };
        }
    }
    // An end over the face is nearer to it than to any edge.
    let normal2 = normal.norm_squared();
    for (k, x) in segment.iter().enumerate() {
        if normal2 > 0.0 && is_above(x, triangle, &normal) {
            let distance2 = heights[k] * heights[k] / normal2;
            if distance2 < best.distance2 {
                best = Closest { s: k as f64, t: 0.0, offset: normal * (heights[k] / normal2), distance2 };
            }
        }
    }
    best
}

/// Whether a point lies over a triangle, seen along its normal; the border counts.
fn is_above(x: &Vector3<f64>, triangle: &Triangle, normal: &Vector3<f64>) -> bool {
    (0..3).all(|k| {
        let (p, q) = (triangle[k], triangle[(k + 1) % 3]);
        normal.dot(&(q - p).cross(&(x - p))) >= 0.0
    })
}
