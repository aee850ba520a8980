//! What contact asks of a body on its way through a step, be it rigid or deforming.

use nalgebra::Vector3;

use crate::sdf::DistanceField;
use crate::solid::{MovingSolid, SolidPose};

/// A body on its way through a step; fractions of the step run from 0 to 1.
pub trait MovingBody {
    /// What carries the body's frame.
    fn pose(&self) -> &SolidPose;

    /// Its distance field at a fraction of the step, in the body's frame.
    fn field_at(&self, alpha: f64) -> impl DistanceField;

    /// Half the thickness of its thinnest feature, cm.
    fn half_thickness_cm(&self) -> f32;

    /// Coulomb friction coefficient against hair.
    fn friction(&self) -> f32;

    /// Length of the step times the highest speed of any of its points at any time of it, cm: over any part of the step
    /// no bound of a distance falls by more than that part of it.
    fn max_displacement(&self) -> f64;

    /// Velocity (cm/s) over a step of `dt` seconds of the body's point that is at `point` (world, cm) at a fraction of
    /// the step. Zero when `dt` is not positive.
    fn velocity_at(&self, point: Vector3<f64>, alpha: f64, dt: f64) -> Vector3<f64>;
}

impl MovingBody for MovingSolid<'_> {
    #[inline(always)]
    fn pose(&self) -> &SolidPose {
        &self.pose
    }

    #[inline(always)]
    fn field_at(&self, _: f64) -> impl DistanceField {
        &self.solid.sdf
    }

    fn half_thickness_cm(&self) -> f32 {
        self.solid.half_thickness_cm
    }

    fn friction(&self) -> f32 {
        self.solid.friction
    }

    fn max_displacement(&self) -> f64 {
        MovingSolid::max_displacement(self)
    }

    fn velocity_at(&self, point: Vector3<f64>, _: f64, dt: f64) -> Vector3<f64> {
        self.pose.velocity_at(point, dt)
    }
}
