//! Solids from what a host has at hand: balls, rods, meshes; each baked into a distance field once.
//!
//! Friction is Coulomb's coefficient against hair (AS16 Table 1). A cell of zero is chosen here.

use crate::error::Error;
use crate::guard::workers;
use collision::{BakeParams, Shape, ShapeUnion, Solid};
use nalgebra::Vector3;

/// A solid in its own frame, baked.
#[derive(Debug)]
pub struct AhSolid {
    pub(crate) solid: Solid,
}

/// A rod with round ends.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct AhRod {
    /// One end of its axis, cm, solid's frame.
    pub a: [f32; 3],
    /// The other end; the same as `a` for a ball.
    pub b: [f32; 3],
    /// cm.
    pub radius: f32,
}

/// What is common to all solids.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface {
    /// Friction coefficient.
    pub friction: f32,
    /// Edge of a grid cell, cm; zero chooses.
    pub cell_cm: f32,
}

impl AhSolid {
    /// The union of rods, such as the teeth and the back of a comb.
    pub(crate) fn rods(rods: &[AhRod], surface: Surface) -> Result<Self, Error> {
        surface.check()?;
        let mut thinnest = f32::INFINITY;
        for rod in rods {
            positive("a rod's radius", rod.radius)?;
            for &x in rod.a.iter().chain(&rod.b) {
                finite("an end of a rod", x)?;
            }
            thinnest = thinnest.min(rod.radius);
        }
        let shapes = rods.iter().map(|rod| Shape::capsule(Vector3::from(rod.a), Vector3::from(rod.b), rod.radius));
        let union = ShapeUnion::sharp(shapes.collect());
        let cell = if surface.cell_cm > 0.0 { surface.cell_cm } else { cell_of_radius(thinnest) };
        let bake = || Solid::from_shape("rods", &union, cell, thinnest, surface.friction).map_err(Error::Solid);
        Ok(Self { solid: workers(0)?.install(bake)? })
    }

    /// A mesh.
    pub(crate) fn mesh(positions: &[[f32; 3]], triangles: &[[u32; 3]], surface: Surface) -> Result<Self, Error> {
        surface.check()?;
        let params =
            if surface.cell_cm > 0.0 { BakeParams::with_cell(surface.cell_cm) } else { BakeParams::automatic() };
        let bake = || Solid::from_mesh("mesh", positions, triangles, params, surface.friction).map_err(Error::Solid);
        Ok(Self { solid: workers(0)?.install(bake)? })
    }
}

impl Surface {
    fn check(self) -> Result<(), Error> {
        for (what, value) in [("friction", self.friction), ("cell_cm", self.cell_cm)] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(Error::Value { what, value: value.into(), expected: "finite and not negative" });
            }
        }
        Ok(())
    }
}

/// Edge of a grid cell for a surface of this radius, cm.
///
/// Between nodes c apart the distance to a ball of radius r is off by c²/8r along each curved direction: held to 0.02 mm, and
/// thin rods get two and a half cells a radius at least.
fn cell_of_radius(radius: f32) -> f32 {
    const MAX_ERROR_CM: f32 = 0.002;
    (8.0 * MAX_ERROR_CM * radius).sqrt().min(0.4 * radius)
}

fn positive(what: &'static str, value: f32) -> Result<(), Error> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(Error::Value { what, value: value.into(), expected: "finite and greater than zero" })
}

fn finite(what: &'static str, value: f32) -> Result<(), Error> {
    if value.is_finite() {
        return Ok(());
    }
    Err(Error::Value { what, value: value.into(), expected: "finite" })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twice what [`cell_of_radius`] promises: a ball is curved in two directions.
    const CELL_ERROR_CM: f32 = 0.004;

    #[test]
    fn balls_and_rods_are_where_they_were_put() {
        let surface = Surface { friction: 0.3, cell_cm: 0.0 };
        for (rod, on_it) in [
            (AhRod { a: [1.0, 2.0, 3.0], b: [1.0, 2.0, 3.0], radius: 9.0 }, [1.0, 2.0, 12.0]),
            (AhRod { a: [0.0; 3], b: [0.0, -4.0, 0.0], radius: 0.1 }, [0.1, -2.0, 0.0]),
        ] {
            let solid = AhSolid::rods(&[rod], surface).unwrap().solid;
            let distance = solid.sdf.distance(on_it.into());
            assert!(distance.abs() < CELL_ERROR_CM, "{distance} of {rod:?}");
            assert_eq!((solid.half_thickness_cm, solid.friction), (rod.radius, 0.3));
        }
    }

    #[test]
    fn solids_that_make_no_sense_are_refused() {
        let ball = AhRod { a: [0.0; 3], b: [0.0; 3], radius: 1.0 };
        let smooth = Surface { friction: 0.0, cell_cm: 0.0 };
        for (rods, surface) in [
            (&[AhRod { radius: -1.0, ..ball }][..], smooth),
            (&[AhRod { radius: f32::NAN, ..ball }], smooth),
            (&[ball, AhRod { a: [0.0, f32::INFINITY, 0.0], ..ball }], smooth),
            (&[ball], Surface { friction: -0.1, ..smooth }),
            (&[ball], Surface { cell_cm: f32::NAN, ..smooth }),
            (&[], smooth),
        ] {
            assert!(AhSolid::rods(rods, surface).is_err(), "{rods:?} {surface:?}");
        }
        assert!(AhSolid::mesh(&[[0.0; 3]; 3], &[[0, 1, 2]], smooth).is_err());
    }
}
