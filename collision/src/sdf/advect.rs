//! The distance field of a deforming body between two key frames, by two-sided semi-Lagrangian interpolation
//! (MS08 §5.1, Fig. 15c).
//!
//! A point is traced back to the earlier key and on to the later one along the body's motion, and what is found there is
//! blended. At either key the field is exactly that key's, so it is continuous over any number of keys, and a thin part
//! that moves farther than its own width is still there midway, where blending the two fields in place loses it.

use nalgebra::Vector3;

use crate::sdf::field::DistanceField;
use crate::sdf::grid::unit_or;
use crate::sdf::shift::ShiftField;
use crate::sdf::{Bounds, SignedDistanceField};

/// A body at one moment between two key frames. Cheap to make.
#[derive(Debug, Clone, Copy)]
pub struct DeformedField<'a> {
    pub(crate) earlier: &'a SignedDistanceField,
    pub(crate) later: &'a SignedDistanceField,
    pub(crate) shift: &'a ShiftField,
    /// Longest way of any surface point between the two keys, cm.
    pub(crate) longest: f32,
    /// Half the longest way between any two successive keys of the body, cm.
    pub(crate) slack: f32,
    /// Fraction of the way from the earlier key to the later.
    pub(crate) a: f32,
}

impl DeformedField<'_> {
    /// Where `p` comes from at the earlier key, and where it is on the way to at the later.
    #[inline(always)]
    fn feet(&self, p: Vector3<f32>) -> [Vector3<f32>; 2] {
        let shift = self.shift.at(p);
        [p - shift * self.a, p + shift * (1.0 - self.a)]
    }

    #[inline(always)]
    fn mix(&self, earlier: f32, later: f32) -> f32 {
        (1.0 - self.a) * earlier + self.a * later
    }

    /// Signed distance at `p`, cm.
    /// Implements MS08 §5.1: φ(x, α) = (1 - α) φ_n(x - α Δt v) + α φ_{n+1}(x + (1 - α) Δt v).
    #[inline]
    pub fn distance(&self, p: Vector3<f32>) -> f32 {
        let [from, to] = self.feet(p);
        self.mix(self.earlier.distance(from), self.later.distance(to))
    }

    /// The two keys' distances blended in place: what the two-sided field is better than (MS08 Fig. 15a).
    pub fn distance_blended_in_place(&self, p: Vector3<f32>) -> f32 {
        self.mix(self.earlier.distance(p), self.later.distance(p))
    }

    /// Displacement of what is at `p` from the earlier key to the later, cm.
    pub fn shift(&self, p: Vector3<f32>) -> Vector3<f32> {
        self.shift.at(p)
    }

    /// The box both keys lie in.
    pub fn bounds(&self) -> Bounds {
        let (a, b) = (self.earlier.bounds(), self.later.bounds());
        Bounds::new(a.min.inf(&b.min), a.max.sup(&b.max))
    }
}

impl DistanceField for DeformedField<'_> {
    #[inline]
    fn distance(&self, p: Vector3<f32>) -> f32 {
        DeformedField::distance(self, p)
    }

    fn surely(&self, d: f32) -> f32 {
        // The two-sided field lies within 2 a (1 - a) of the longest way from the keys blended in place, which is
        // 1-Lipschitz: away from p the field may lose that much twice, besides the length walked.
        let bent = 4.0 * self.a * (1.0 - self.a) * self.longest;
        // Both feet's samples differ by at most twice the longest way: within the band both are.
        let band = self.earlier.band().min(self.later.band());
        let near = d + 2.0 * self.longest <= band;
        let error = if near { self.max_error() } else { self.earlier.far_error().max(self.later.far_error()) };
        d - error - bent
    }

    /// Of the keys blended in place, less the most by which the two-sided field lies below at any time: so it falls no
    /// faster in time than the surface moves.
    fn lower_bound(&self, p: Vector3<f32>) -> f32 {
        self.mix(self.earlier.lower_bound(p), self.later.lower_bound(p)) - self.slack
    }

    fn max_error(&self) -> f32 {
        self.earlier.max_error().max(self.later.max_error())
    }

    /// The gradient without its term in the motion's own gradient, which is of second order in the motion between keys
    /// and breaks where the nearest surface point jumps.
    fn outward_normal(&self, p: Vector3<f32>) -> (f32, Vector3<f32>) {
        let [from, to] = self.feet(p);
        let (d0, g0) = self.earlier.distance_gradient(from);
        let (d1, g1) = self.later.distance_gradient(to);
        let gradient = g0 * (1.0 - self.a) + g1 * self.a;
        let nearer =
            || if self.a < 0.5 { self.earlier.outward_normal(from).1 } else { self.later.outward_normal(to).1 };
        (self.mix(d0, d1), unit_or(gradient, nearer))
    }
}
