//! Solids of scenes, baked from closed forms, and surface meshes of any solid for pictures and export.
//!
//! Frames: a sphere about the origin; a rod along y; a comb with its spine along x through the origin and its teeth along
//! -z; a head about the origin, y up, face along +z.

use collision::{Bounds, Shape, ShapeUnion, SignedDistanceField, Solid, bake_from_fn};
use io_formats::mesh::TriMesh;
use nalgebra::Vector3;
use std::sync::OnceLock;

use crate::error::Error;

/// Coulomb friction of hair on the built-in solids, unless changed by the scene.
pub const DEFAULT_FRICTION: f32 = 0.3;
/// Cells across a radius: trilinear interpolation of a round rod then errs by about 1 % of its radius.
const CELLS_PER_RADIUS: f32 = 4.0;
/// Grid cell of the head, cm.
const HEAD_CELL_CM: f32 = 0.25;

/// A ball about the origin; `radius` in cm.
///
/// # Errors
/// A radius that is not positive and finite, or too large to bake.
pub fn sphere(radius: f32) -> Result<Solid, Error> {
    // Curvature alone matters here: a sixteenth of the radius errs as little as a quarter does on a thin rod.
    bake("sphere", &Shape::sphere(Vector3::zeros(), radius).into(), radius / 16.0, radius)
}

/// A rod along y about the origin with round ends; `length` (cm) between the centres of its caps.
///
/// # Errors
/// A radius that is not positive and finite, a negative length, or a rod too long for its radius to bake.
pub fn rod(radius: f32, length: f32) -> Result<Solid, Error> {
    check("length", length, 0.0)?;
    let end = Vector3::y() * (0.5 * length);
    bake("rod", &Shape::capsule(-end, end, radius).into(), radius / CELLS_PER_RADIUS, radius)
}

/// A row of round teeth on a round spine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CombParams {
    /// Number of teeth, at least one.
    pub teeth: usize,
    /// Distance between the axes of neighbouring teeth, cm.
    pub pitch_cm: f32,
    /// Radius of a tooth where it leaves the spine, cm; the round tip has three quarters of it.
    pub tooth_radius_cm: f32,
    /// Length of a tooth from the spine's axis to the tip, cm.
    pub tooth_length_cm: f32,
    /// Radius of the spine, cm.
    pub spine_radius_cm: f32,
}

impl CombParams {
    /// A wide-toothed dressing comb: 13 teeth, 4 mm apart, 1.6 mm thick, 4 cm long.
    pub fn dressing() -> Self {
        Self { teeth: 13, pitch_cm: 0.4, tooth_radius_cm: 0.08, tooth_length_cm: 4.0, spine_radius_cm: 0.25 }
    }
}

/// A comb: spine along x about the origin, teeth along -z.
///
/// # Errors
/// Lengths that are not positive and finite, no teeth, or a comb too large for its thin teeth to bake.
pub fn comb(params: CombParams) -> Result<Solid, Error> {
    let CombParams { teeth, pitch_cm, tooth_radius_cm, tooth_length_cm, spine_radius_cm } = params;
    check("teeth", teeth as f32, 1.0)?;
    check("pitch_cm", pitch_cm, 0.0)?;
    check("tooth_radius_cm", tooth_radius_cm, 0.0)?;
    check("tooth_length_cm", tooth_length_cm, 0.0)?;
    check("spine_radius_cm", spine_radius_cm, tooth_radius_cm)?;
    let tip_radius = 0.75 * tooth_radius_cm;
    let half_width = 0.5 * pitch_cm * (teeth - 1) as f32;
    let end = Vector3::x() * (half_width + spine_radius_cm);
    let spine = Shape::capsule(-end, end, spine_radius_cm);
    let tooth = Shape::Capsule {
        a: Vector3::zeros(),
        b: Vector3::z() * -(tooth_length_cm - tip_radius),
        radius_a: tooth_radius_cm,
        radius_b: tip_radius,
    };
    // All teeth are alike and side by side, so the nearest is the one nearest along the spine: no need to ask them all.
    let distance = |p: Vector3<f32>| {
        let nearest = ((p.x + half_width) / pitch_cm).round().clamp(0.0, (teeth - 1) as f32);
        let in_tooth = p - Vector3::x() * (pitch_cm * nearest - half_width);
        spine.distance(p).min(tooth.distance(in_tooth))
    };
    let wide = half_width + 2.0 * spine_radius_cm + RIM_CM;
    let thick = spine_radius_cm + RIM_CM;
    let bounds = Bounds::new(Vector3::new(-wide, -thick, -tooth_length_cm - RIM_CM), Vector3::new(wide, thick, thick));
    let sdf = bake_from_fn(bounds, tip_radius / COMB_CELLS_PER_RADIUS, distance)
        .map_err(|source| Error::Bake { name: "comb".to_owned(), source })?;
    Ok(Solid::new("comb", sdf, tip_radius, DEFAULT_FRICTION))
}

/// Free space around a comb's grid, cm.
const RIM_CM: f32 = 0.3;
/// Grid cells across a tooth's radius: errs by a hundredth of a millimetre on a tooth of two, in half the memory of finer ones.
const COMB_CELLS_PER_RADIUS: f32 = 3.0;

/// Middle of the cranium in the head's frame, cm: directions over the scalp are taken from here.
pub const CRANIUM_CENTER: [f32; 3] = [0.0, 1.0, -0.8];

/// The built-in head with neck, shoulders and the upper body that long hair falls on.
///
/// # Errors
/// None in practice: the shapes are fixed.
pub fn head() -> Result<Solid, Error> {
    Ok(head_and_mesh()?.0)
}

/// The head with its surface, made once a process: nothing about it can be chosen, and its field takes seconds.
pub(crate) fn head_and_mesh() -> Result<(Solid, TriMesh), Error> {
    static MADE: OnceLock<(Solid, TriMesh)> = OnceLock::new();
    if let Some(made) = MADE.get() {
        return Ok(made.clone());
    }
    // Tighter than the union's own bounds, which allow for every member blending with every other.
    let bounds = Bounds::new(Vector3::new(-19.5, -36.0, -12.5), Vector3::new(19.5, 11.5, 12.5));
    let shape = head_shape();
    let sdf = bake_from_fn(bounds, HEAD_CELL_CM, |p| shape.distance(p))
        .map_err(|source| Error::Bake { name: "head".to_owned(), source })?;
    let head = Solid::new("head", sdf, 1.0, DEFAULT_FRICTION);
    let mesh = solid_mesh(&head);
    Ok(MADE.get_or_init(|| (head, mesh)).clone())
}

fn head_shape() -> ShapeUnion {
    let v = Vector3::new;
    let cone = |a, b, radius_a, radius_b| Shape::Capsule { a, b, radius_a, radius_b };
    let mut shapes = vec![
        Shape::Ellipsoid { center: v(0.0, 1.0, -0.8), radii: v(7.7, 8.6, 9.3) },
        // Face and jaw, chin, nose.
        Shape::Ellipsoid { center: v(0.0, -4.0, 2.6), radii: v(5.9, 7.2, 6.0) },
        Shape::sphere(v(0.0, -9.3, 6.0), 1.9),
        cone(v(0.0, 0.2, 8.3), v(0.0, -2.8, 9.3), 0.6, 0.9),
        // Neck.
        cone(v(0.0, -6.0, -1.5), v(0.0, -19.0, -2.8), 5.0, 5.4),
    ];
    for side in [-1.0, 1.0] {
        // Ear, slope of the shoulder, upper arm.
        shapes.push(Shape::Ellipsoid { center: v(side * 7.4, -1.2, -0.6), radii: v(0.9, 2.8, 1.6) });
        shapes.push(cone(v(side * 2.0, -21.5, -3.0), v(side * 13.0, -25.0, -3.0), 4.9, 4.6));
        shapes.push(cone(v(side * 13.0, -25.0, -3.0), v(side * 13.8, -30.5, -3.0), 4.6, 4.3));
    }
    // Chest and back.
    shapes.push(Shape::Box { center: v(0.0, -28.5, -2.2), half: v(13.5, 6.5, 7.5), rounding: 6.4 });
    ShapeUnion { shapes, smoothing: 2.0 }
}

fn bake(name: &str, shape: &ShapeUnion, cell: f32, half_thickness: f32) -> Result<Solid, Error> {
    check("radius", half_thickness, 0.0)?;
    Solid::from_shape(name, shape, cell, half_thickness, DEFAULT_FRICTION)
        .map_err(|source| Error::Bake { name: name.to_owned(), source })
}

fn check(name: &'static str, value: f32, least: f32) -> Result<(), Error> {
    if value.is_finite() && value >= least {
        Ok(())
    } else {
        Err(Error::BadParameter { name, value: f64::from(value), least: f64::from(least) })
    }
}

/// A triangle mesh of a solid's surface in its own frame, outward facing, at the resolution of its grid or of
/// half its thinnest feature, whichever is coarser.
pub fn solid_mesh(solid: &Solid) -> TriMesh {
    surface(&solid.sdf, solid.sdf.cell().max(0.5 * solid.half_thickness_cm.min(1.0)))
}

/// Extracts the zero surface on a lattice of the given spacing (cm): one vertex per cell that the surface crosses, on
/// the surface near the mean of its edge crossings, and one quad per crossed edge.
pub fn surface(sdf: &SignedDistanceField, spacing: f32) -> TriMesh {
    const NONE: u32 = u32::MAX;
    let bounds = sdf.bounds();
    let [nx, ny, nz] = [0, 1, 2].map(|k: usize| (bounds.size()[k] / spacing).ceil() as usize + 1);
    let at = |i: usize, j: usize, k: usize| bounds.min + Vector3::new(i as f32, j as f32, k as f32) * spacing;
    let node = |i: usize, j: usize, k: usize| (k * ny + j) * nx + i;
    let mut value = vec![0.0f32; nx * ny * nz];
    for k in 0..nz {
        for j in 0..ny {
            for i in 0..nx {
                value[node(i, j, k)] = sdf.distance(at(i, j, k));
            }
        }
    }

    let mut mesh = TriMesh::default();
    let mut vertex_of = vec![NONE; nx * ny * nz];
    for k in 0..nz - 1 {
        for j in 0..ny - 1 {
            for i in 0..nx - 1 {
                let corner = |c: usize| [i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)];
                let d = |c: usize| {
                    let [i, j, k] = corner(c);
                    value[node(i, j, k)]
                };
                let mut sum = Vector3::zeros();
                let mut n = 0;
                for (a, b) in EDGES {
                    let (da, db) = (d(a), d(b));
                    if (da < 0.0) != (db < 0.0) {
                        let [pa, pb] = [corner(a), corner(b)].map(|[i, j, k]| at(i, j, k));
                        sum += pa.lerp(&pb, da / (da - db));
                        n += 1;
                    }
                }
                if n == 0 {
                    continue;
                }
                let mut p = sum / n as f32;
                // One step onto the surface, kept short so that the vertex stays in its cell's neighbourhood.
                let (d, normal) = sdf.outward_normal(p);
                p -= normal * d.clamp(-0.5 * spacing, 0.5 * spacing);
                vertex_of[node(i, j, k)] = mesh.vertices.len() as u32;
                mesh.vertices.push(p.into());
            }
        }
    }

    // Every lattice edge whose ends differ in sign is shared by four cells, whose vertices make a quad.
    for k in 1..nz - 1 {
        for j in 1..ny - 1 {
            for i in 1..nx - 1 {
                let here = value[node(i, j, k)] < 0.0;
                let cells = |u: [usize; 3], w: [usize; 3]| {
                    let cell = |a: usize, b: usize| {
                        vertex_of[node(i - a * u[0] - b * w[0], j - a * u[1] - b * w[1], k - a * u[2] - b * w[2])]
                    };
                    [cell(1, 1), cell(0, 1), cell(0, 0), cell(1, 0)]
                };
                for (next, quad) in [
                    (node(i + 1, j, k), cells([0, 1, 0], [0, 0, 1])),
                    (node(i, j + 1, k), cells([0, 0, 1], [1, 0, 0])),
                    (node(i, j, k + 1), cells([1, 0, 0], [0, 1, 0])),
                ] {
                    if here == (value[next] < 0.0) || quad.contains(&NONE) {
                        continue;
                    }
                    let [a, b, c, d] = quad;
                    let faces = if here { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] };
                    mesh.triangles.extend(faces);
                }
            }
        }
    }
    mesh
}

/// The twelve edges of a cell, as pairs of corners (bits: x, y, z).
const EDGES: [(usize, usize); 12] =
    [(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meshes_of_the_built_in_solids_are_closed_face_outwards_and_lie_on_the_surface() {
        /// Two adjacent crossings of a cell are joined by straight edges: off by a part of the lattice spacing.
        const OFF_SURFACE: f32 = 0.05;
        let small = CombParams { teeth: 3, tooth_length_cm: 1.5, ..CombParams::dressing() };
        for solid in [sphere(2.0), rod(0.3, 3.0), comb(small)] {
            let solid = solid.expect("a sound solid");
            let mesh = solid_mesh(&solid);
            assert_eq!(mesh.boundary_edge_count(), 0, "{}", solid.name);
            for v in &mesh.vertices {
                assert!(solid.sdf.distance(Vector3::from(*v)).abs() < OFF_SURFACE, "{} at {v:?}", solid.name);
            }
            let volume: f32 = mesh
                .triangles
                .iter()
                .map(|t| {
                    let [a, b, c] = t.map(|v| Vector3::from(mesh.vertices[v as usize]));
                    a.dot(&b.cross(&c)) / 6.0
                })
                .sum();
            assert!(volume > 0.0, "{} is inside out", solid.name);
        }
    }

    #[test]
    fn every_tooth_of_a_comb_is_solid_and_every_gap_is_free() {
        let params = CombParams::dressing();
        let comb = comb(params).expect("a sound comb");
        let half = 0.5 * params.pitch_cm * (params.teeth - 1) as f32;
        for n in 0..params.teeth {
            let x = params.pitch_cm * n as f32 - half;
            for z in [-0.5, -2.0, -3.8] {
                assert!(comb.sdf.distance(Vector3::new(x, 0.0, z)) < -0.5 * params.tooth_radius_cm);
                let gap = comb.sdf.distance(Vector3::new(x + 0.5 * params.pitch_cm, 0.0, z));
                assert!(gap > 0.5 * params.pitch_cm - 1.2 * params.tooth_radius_cm, "gap {gap} at {x}, {z}");
            }
        }
        assert!(comb.sdf.cell() <= 0.25 * params.tooth_radius_cm);
    }

    #[test]
    fn solids_of_no_size_are_refused() {
        assert!(sphere(0.0).is_err() && sphere(f32::NAN).is_err() && rod(0.1, -1.0).is_err());
        assert!(comb(CombParams { teeth: 0, ..CombParams::dressing() }).is_err());
    }
}
