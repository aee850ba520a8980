//! Rigid solids: a distance field with a name, and where it stands at the two ends of a step.
//!
//! Poses are kept in double precision, so that a solid far from the world's origin moves smoothly; points are taken into
//! the solid's frame before they become single precision. Between the ends of a step the pose is blended (translation
//! linearly, rotation at constant angular velocity); the bound on movement holds for that path.

use std::sync::Arc;

use nalgebra::{Isometry3, Matrix3, Point3, UnitQuaternion, Vector3};

use crate::error::Error;
use crate::sdf::mesh::ClosedMesh;
use crate::sdf::mesh_bake::bake_closed;
use crate::sdf::{BakeParams, Bounds, SignedDistanceField, bake_from_fn};
use crate::shapes::ShapeUnion;
use crate::surface::{MovingSurface, Surface};
use crate::thickness::smallest_half_thickness;

/// A rigid solid in its own frame.
#[derive(Debug, Clone)]
pub struct Solid {
    /// Name, for reports.
    pub name: String,
    /// Signed distance to its surface, solid's frame.
    pub sdf: SignedDistanceField,
    /// Half the thickness of its thinnest feature, cm: contact is sampled no coarser than this.
    pub half_thickness_cm: f32,
    /// Coulomb friction coefficient against hair, as AS16 Table 1.
    pub friction: f32,
    /// Its triangles, for tests along the whole way of a step; none of a solid that is only a field.
    pub surface: Option<Arc<Surface>>,
}

impl Solid {
    /// A solid of a field alone.
    #[must_use]
    pub fn new(name: &str, sdf: SignedDistanceField, half_thickness_cm: f32, friction: f32) -> Self {
        Self { name: name.to_owned(), sdf, half_thickness_cm, friction, surface: None }
    }

    /// The same solid with triangles (solid's frame, cm) that stand for its surface, such as a mesh of a shape in closed form.
    ///
    /// # Errors
    /// As [`Surface::new`].
    pub fn with_surface(self, positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Result<Self, Error> {
        Ok(Self { surface: Some(Arc::new(Surface::new(positions, triangles)?)), ..self })
    }

    /// Bakes closed-form shapes with a rim of half a centimetre, at the given cell (cm).
    ///
    /// # Errors
    /// An empty union, a cell that is not positive, a grid past 1 GiB.
    pub fn from_shape(
        name: &str,
        shape: &ShapeUnion,
        cell: f32,
        half_thickness_cm: f32,
        friction: f32,
    ) -> Result<Self, Error> {
        const RIM_CM: f32 = 0.5;
        let bounds = shape.bounds().ok_or(Error::EmptyMesh { n_vertices: 0, n_triangles: 0 })?;
        let sdf = bake_from_fn(bounds.grown(RIM_CM.max(2.0 * cell)), cell, |p| shape.distance(p))?;
        Ok(Self::new(name, sdf, half_thickness_cm, friction))
    }

    /// Bakes a mesh (cm), measures its thinnest feature and keeps its triangles.
    ///
    /// # Errors
    /// As [`crate::bake_from_mesh`].
    pub fn from_mesh(
        name: &str,
        positions: &[[f32; 3]],
        triangles: &[[u32; 3]],
        params: BakeParams,
        friction: f32,
    ) -> Result<Self, Error> {
        let closed = ClosedMesh::new(positions, triangles)?;
        let half_thickness_cm = smallest_half_thickness(&closed.indexed()?);
        Self::new(name, bake_closed(&closed, params)?, half_thickness_cm, friction).with_surface(positions, triangles)
    }
}

/// Where a solid stands at the start and at the end of a step (`world_from_solid`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolidPose {
    /// `world_from_solid` at the start.
    pub from: Isometry3<f64>,
    /// `world_from_solid` at the end.
    pub to: Isometry3<f64>,
}

impl SolidPose {
    /// A solid that does not move.
    pub fn still(world_from_solid: Isometry3<f64>) -> Self {
        Self { from: world_from_solid, to: world_from_solid }
    }

    /// `world_from_solid` at a fraction of the step, 0 at the start and 1 at the end.
    pub fn at(&self, alpha: f64) -> Isometry3<f64> {
        self.turned_at(alpha, self.turn())
    }

    /// [`Self::at`] with [`Self::turn`] known.
    pub(crate) fn turned_at(&self, alpha: f64, turn: Vector3<f64>) -> Isometry3<f64> {
        let translation = self.from.translation.vector.lerp(&self.to.translation.vector, alpha);
        Isometry3::from_parts(translation.into(), UnitQuaternion::from_scaled_axis(turn * alpha) * self.from.rotation)
    }

    /// `solid_from_world` at a fraction of the step, in single precision.
    pub fn solid_from_world(&self, alpha: f64) -> Isometry3<f32> {
        self.at(alpha).inverse().cast()
    }

    /// Rotation over the step as a scaled axis in world axes, radian; the shorter way round.
    pub(crate) fn turn(&self) -> Vector3<f64> {
        (self.to.rotation * self.from.rotation.inverse()).scaled_axis()
    }

    /// Mean velocity (cm/s) over a step of `dt` seconds of the solid's material point that is at `point` (world, cm) at
    /// the end of the step. Zero when `dt` is not positive.
    pub fn velocity_at(&self, point: Vector3<f64>, dt: f64) -> Vector3<f64> {
        if dt <= 0.0 {
            return Vector3::zeros();
        }
        let material = self.to.inverse_transform_point(&Point3::from(point));
        (point - (self.from * material).coords) / dt
    }

    /// [`Self::velocity_at`] for many points.
    pub fn velocity_field(&self, dt: f64) -> VelocityField {
        if dt <= 0.0 {
            return VelocityField { per_cm: Matrix3::zeros(), at_origin: Vector3::zeros() };
        }
        let before_from_after = self.from * self.to.inverse();
        let turned = before_from_after.rotation.to_rotation_matrix().into_inner();
        VelocityField {
            per_cm: (Matrix3::identity() - turned) / dt,
            at_origin: -before_from_after.translation.vector / dt,
        }
    }

    /// Longest path (cm) that any point of a box in the solid's frame travels over the step.
    pub fn max_displacement(&self, bounds: &Bounds) -> f64 {
        let linear = (self.to.translation.vector - self.from.translation.vector).norm();
        // The frame's origin moves straight and everything turns about it.
        linear + self.turn().norm() * f64::from(bounds.max_distance_from(&Vector3::zeros()))
    }
}

/// Mean velocity over a step of the points of a rigid solid, by where they are at its end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VelocityField {
    per_cm: Matrix3<f64>,
    at_origin: Vector3<f64>,
}

impl VelocityField {
    /// Velocity (cm/s) of the material point that is at `point` (world, cm) at the end of the step.
    #[inline(always)]
    pub fn at(&self, point: Vector3<f64>) -> Vector3<f64> {
        self.per_cm * point + self.at_origin
    }
}

/// A solid on its way through one step.
#[derive(Debug, Clone, Copy)]
pub struct MovingSolid<'a> {
    /// What moves.
    pub solid: &'a Solid,
    /// From where to where.
    pub pose: SolidPose,
}

impl<'a> MovingSolid<'a> {
    /// Its triangles on the same way, if it has any.
    #[must_use]
    pub fn surface(&self) -> Option<MovingSurface<'a>> {
        self.solid.surface.as_deref().map(|surface| MovingSurface { surface, pose: self.pose })
    }

    /// Longest path (cm) that any point of the solid travels over the step. Never too small.
    pub fn max_displacement(&self) -> f64 {
        self.pose.max_displacement(&self.solid.sdf.bounds())
    }

    /// Signed distance (cm) at a world point with the solid where it stands at the end of the step.
    pub fn distance_at_end(&self, point: Vector3<f64>) -> f32 {
        let p = self.pose.to.inverse_transform_point(&Point3::from(point));
        self.solid.sdf.distance(p.coords.cast())
    }
}
