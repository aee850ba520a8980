//! What a question about points and segments needs to know of a distance field, at rest or between two key frames.
//!
//! Samples may overstate the distance by a known error, and a field that deforms need not change by at most one
//! centimetre per centimetre. What is sure is therefore asked of the field itself: [`DistanceField::surely`] and
//! [`DistanceField::lower_bound`] bound a distance that does.

use nalgebra::Vector3;

use crate::sdf::SignedDistanceField;

/// A signed distance that can be sampled, cm, in the frame of what it belongs to.
pub trait DistanceField {
    /// Signed distance at `p`.
    fn distance(&self, p: Vector3<f32>) -> f32;

    /// With `d` sampled at `p`: at a distance `r` from `p` the surface's distance is at least `surely(d) - r`.
    fn surely(&self, d: f32) -> f32;

    /// A lower bound of the distance at `p` that changes by at most `r` over a path of `r` cm.
    fn lower_bound(&self, p: Vector3<f32>) -> f32;

    /// Largest amount by which a sample near the surface overstates the distance.
    fn max_error(&self) -> f32;

    /// Signed distance and unit normal out of the solid at `p`.
    fn outward_normal(&self, p: Vector3<f32>) -> (f32, Vector3<f32>);
}

impl DistanceField for SignedDistanceField {
    #[inline(always)]
    fn distance(&self, p: Vector3<f32>) -> f32 {
        self.distance(p)
    }

    #[inline(always)]
    fn surely(&self, d: f32) -> f32 {
        self.surely(d)
    }

    #[inline(always)]
    fn lower_bound(&self, p: Vector3<f32>) -> f32 {
        self.lower_bound(p)
    }

    #[inline(always)]
    fn max_error(&self) -> f32 {
        self.max_error()
    }

    #[inline(always)]
    fn outward_normal(&self, p: Vector3<f32>) -> (f32, Vector3<f32>) {
        self.outward_normal(p)
    }
}

impl<F: DistanceField + ?Sized> DistanceField for &F {
    #[inline(always)]
    fn distance(&self, p: Vector3<f32>) -> f32 {
        (**self).distance(p)
    }

    #[inline(always)]
    fn surely(&self, d: f32) -> f32 {
        (**self).surely(d)
    }

    #[inline(always)]
    fn lower_bound(&self, p: Vector3<f32>) -> f32 {
        (**self).lower_bound(p)
    }

    #[inline(always)]
    fn max_error(&self) -> f32 {
        (**self).max_error()
    }

    #[inline(always)]
    fn outward_normal(&self, p: Vector3<f32>) -> (f32, Vector3<f32>) {
        (**self).outward_normal(p)
    }
}
