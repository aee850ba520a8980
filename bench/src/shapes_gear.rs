//! Generated gears: a toothed ring on spokes, cut through between them, as one closed mesh.
//!
//! The gear lies about the z axis and is made of cells between circles and rays, some left out; every cell has a floor and a
//! lid, and a wall where its neighbour is missing. So the mesh is closed whatever is cut out.

use std::f32::consts::TAU;

use collision::{BakeParams, Solid};
use io_formats::TriMesh;
use nalgebra::Vector3;

use crate::error::Error;
use crate::shapes::DEFAULT_FRICTION;

/// A spur gear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GearParams {
    /// Teeth, at least three.
    pub teeth: usize,
    /// Spokes, at least two; between them the gear is cut through.
    pub spokes: usize,
    /// Radius at the tips of the teeth, cm.
    pub radius_cm: f32,
    /// Height of a tooth, cm.
    pub tooth_cm: f32,
    /// Radius of the bore, cm.
    pub bore_cm: f32,
    /// Thickness along z, cm.
    pub width_cm: f32,
}

impl GearParams {
    /// A gear the size of a hand, its teeth as wide as a finger.
    pub fn large() -> Self {
        Self { teeth: 18, spokes: 5, radius_cm: 5.0, tooth_cm: 0.7, bore_cm: 0.8, width_cm: 1.2 }
    }
}

/// Rays across a tooth and the gap after it.
const RAYS_PER_TOOTH: usize = 12;
/// Share of the radius below the teeth at which the cuts begin and end.
const CUT: [f32; 2] = [0.38, 0.78];

/// The mesh of a gear, in its own frame, outwards.
///
/// # Errors
/// Too few teeth or spokes, lengths that are not positive, teeth or a bore that leave no ring.
pub fn gear_mesh(params: GearParams) -> Result<TriMesh, Error> {
    let GearParams { teeth, spokes, radius_cm, tooth_cm, bore_cm, width_cm } = params;
    check("teeth", teeth as f32, 3.0)?;
    check("spokes", spokes as f32, 2.0)?;
    for (name, value) in [("tooth_cm", tooth_cm), ("bore_cm", bore_cm), ("width_cm", width_cm)] {
        check(name, value, f32::MIN_POSITIVE)?;
    }
    let root = radius_cm - tooth_cm;
    check("radius_cm", root * CUT[0], bore_cm * 1.01)?;
    let n = teeth * RAYS_PER_TOOTH;
    let radius = |ring: usize, ray: usize| match ring {
        0 => bore_cm,
        1 => CUT[0] * root,
        2 => CUT[1] * root,
        _ => {
            // A tooth rises, stays, falls, and leaves a gap, a quarter of its pitch each.
            let phase = (ray % RAYS_PER_TOOTH) as f32 * 4.0 / RAYS_PER_TOOTH as f32;
            root + tooth_cm * (phase.min(3.0 - phase)).clamp(0.0, 1.0)
        }
    };
    // A quarter of the way round belongs to the spokes.
    let is_cut = |ray: usize| (ray * spokes) % n >= n / 4;
    let is_solid = |ring: i32, ray: usize| (0..3).contains(&ring) && !(ring == 1 && is_cut(ray % n));
    let mut mesh = TriMesh::default();
    for side in [-0.5, 0.5] {
        for ring in 0..4 {
            for ray in 0..n {
                let (sin, cos) = (TAU * ray as f32 / n as f32).sin_cos();
                let r = radius(ring, ray);
                mesh.vertices.push([r * cos, r * sin, side * width_cm]);
            }
        }
    }
    let at = |side: usize, ring: usize, ray: usize| ((side * 4 + ring) * n + ray % n) as u32;
    let mut quad = |[a, b, c, d]: [u32; 4]| mesh.triangles.extend([[a, b, c], [a, c, d]]);
    for ring in 0..3 {
        for ray in (0..n).filter(|&ray| is_solid(ring as i32, ray)) {
            let corners = |side| {
                [at(side, ring, ray), at(side, ring + 1, ray), at(side, ring + 1, ray + 1), at(side, ring, ray + 1)]
            };
            let [a, b, c, d] = corners(0);
            let [e, f, g, h] = corners(1);
            quad([a, d, c, b]);
            quad([e, f, g, h]);
            let before = (ray + n - 1) % n;
            let walls = [
                (ring as i32 - 1, ray, [a, e, h, d]),
                (ring as i32 + 1, ray, [b, c, g, f]),
                (ring as i32, before, [a, b, f, e]),
                (ring as i32, ray + 1, [d, h, g, c]),
            ];
            for (_, _, wall) in walls.iter().filter(|(ring, ray, _)| !is_solid(*ring, *ray)) {
                quad(*wall);
            }
        }
    }
    // Corners of what was cut out belong to no cell.
    let mut used = vec![u32::MAX; mesh.vertices.len()];
    let mut kept = Vec::new();
    for v in mesh.triangles.iter_mut().flatten() {
        if used[*v as usize] == u32::MAX {
            used[*v as usize] = kept.len() as u32;
            kept.push(mesh.vertices[*v as usize]);
        }
        *v = used[*v as usize];
    }
    mesh.vertices = kept;
    Ok(mesh)
}

/// A gear as a solid.
///
/// # Errors
/// As [`gear_mesh`].
pub fn gear(params: GearParams) -> Result<Solid, Error> {
    let mesh = gear_mesh(params)?;
    Solid::from_mesh("gear", &mesh.vertices, &mesh.triangles, BakeParams::automatic(), DEFAULT_FRICTION)
        .map_err(|source| Error::Bake { name: "gear".to_owned(), source })
}

/// A place in the middle of a cut and one in a spoke, for tests and pictures.
pub fn cut_and_spoke(params: &GearParams) -> [Vector3<f32>; 2] {
    let r = 0.5 * (CUT[0] + CUT[1]) * (params.radius_cm - params.tooth_cm);
    let place = |share: f32| {
        let (sin, cos) = (TAU * share / params.spokes as f32).sin_cos();
        Vector3::new(r * cos, r * sin, 0.0)
    };
    [place(0.62), place(0.125)]
}

fn check(name: &'static str, value: f32, least: f32) -> Result<(), Error> {
    if value.is_finite() && value >= least {
        Ok(())
    } else {
        Err(Error::BadParameter { name, value: f64::from(value), least: f64::from(least) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gear_is_closed_and_free_between_its_teeth_and_spokes() {
        let params = GearParams::large();
        let mesh = gear_mesh(params).unwrap();
        assert!(mesh.is_closed(), "{} edges", mesh.boundary_edge_count());
        let solid = gear(params).unwrap();
        let [cut, spoke] = cut_and_spoke(&params);
        assert!(solid.sdf.distance(cut) > 0.3, "{}", solid.sdf.distance(cut));
        assert!(solid.sdf.distance(spoke) < -0.2, "{}", solid.sdf.distance(spoke));
        assert!(solid.sdf.distance(Vector3::zeros()) > 0.5 * params.bore_cm);
        let pitch = TAU / params.teeth as f32;
        for tooth in 0..params.teeth {
            let at = |share: f32| {
                let (sin, cos) = (pitch * (tooth as f32 + share)).sin_cos();
                Vector3::new(cos, sin, 0.0) * (params.radius_cm - 0.4 * params.tooth_cm)
            };
            assert!(solid.sdf.distance(at(0.375)) < 0.0 && solid.sdf.distance(at(0.875)) > 0.0, "tooth {tooth}");
        }
        assert!(gear_mesh(GearParams { bore_cm: 4.0, ..params }).is_err());
    }
}
