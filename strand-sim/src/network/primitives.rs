//! Meshes on which networks are shown and tested: a solid torus and the surfaces of a torus and a hemisphere.
//!
//! All lie on or above y = 0 with y their axis; lengths in cm.

use nalgebra::Vector3;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Points and the corners of tetrahedra.
pub type TetrahedralMesh = (Vec<Vector3<f64>>, Vec<[u32; 4]>);

/// Points and the corners of triangles, counter-clockwise from outside.
pub type TriangleMesh = (Vec<Vector3<f64>>, Vec<[u32; 3]>);

/// A solid torus of circular section lying on y = 0: `n_around` rings of `n_across`² cells, each cut into six tetrahedra
/// along one diagonal, the same in all, so that neighbours agree on their common face.
#[must_use]
pub fn solid_torus(n_around: u32, n_across: u32, major: f64, minor: f64) -> TetrahedralMesh {
    let side = n_across + 1;
    let mut points = Vec::new();
    for i in 0..n_around {
        let (sin, cos) = (TAU * f64::from(i) / f64::from(n_around)).sin_cos();
        for j in 0..side {
            for k in 0..side {
                let place = |j: u32| 2.0 * f64::from(j) / f64::from(n_across) - 1.0;
                let (u, v) = (place(j), place(k));
                // The square of cells onto the disc, without corners that meet at a straight angle.
                let out = major + minor * u * (1.0 - v * v / 2.0).sqrt();
                let up = minor * (1.0 + v * (1.0 - u * u / 2.0).sqrt());
                points.push(Vector3::new(out * cos, up, out * sin));
            }
        }
    }
    let index = |i: u32, j: u32, k: u32| (i % n_around) * side * side + j * side + k;
    let mut tetrahedra = Vec::new();
    for i in 0..n_around {
        for j in 0..n_across {
            for k in 0..n_across {
                // Kuhn's subdivision: one tetrahedron for each order in which the three axes are walked.
                for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
                    let mut at = [i, j, k];
                    let mut corners = [index(i, j, k); 4];
                    for (corner, axis) in corners[1..].iter_mut().zip(order) {
                        at[axis] += 1;
                        *corner = index(at[0], at[1], at[2]);
                    }
                    let x = corners.map(|c| points[c as usize]);
                    if (x[1] - x[0]).dot(&(x[2] - x[0]).cross(&(x[3] - x[0]))) < 0.0 {
                        corners.swap(2, 3);
                    }
                    tetrahedra.push(corners);
                }
            }
        }
    }
    (points, tetrahedra)
}

/// The surface of a torus lying on y = 0.
#[must_use]
pub fn torus_surface(n_around: u32, n_section: u32, major: f64, minor: f64) -> TriangleMesh {
    let mut points = Vec::new();
    for i in 0..n_around {
        let (sin, cos) = (TAU * f64::from(i) / f64::from(n_around)).sin_cos();
        for j in 0..n_section {
            // Half a cell off the symmetry plane, so that flattening puts no two points at one place.
            let (up, out) = (TAU * (f64::from(j) + 0.25) / f64::from(n_section)).sin_cos();
            let out = major + minor * out;
            points.push(Vector3::new(out * cos, minor * (1.0 + up), out * sin));
        }
    }
    let index = |i: u32, j: u32| (i % n_around) * n_section + j % n_section;
    let mut triangles = Vec::new();
    for i in 0..n_around {
        for j in 0..n_section {
            let [a, b, c, d] = [index(i, j), index(i, j + 1), index(i + 1, j), index(i + 1, j + 1)];
            triangles.extend([[a, b, d], [a, d, c]]);
        }
    }
    (points, triangles)
}

/// The upper half of a sphere standing on y = 0, open below: `n_rings` rings of `n_around` points and the pole.
#[must_use]
pub fn hemisphere_surface(n_around: u32, n_rings: u32, radius: f64) -> TriangleMesh {
    let mut points = Vec::new();
    for j in 0..n_rings {
        let (up, out) = (FRAC_PI_2 * f64::from(j) / f64::from(n_rings)).sin_cos();
        for i in 0..n_around {
            // Every other ring is turned by half a cell: all triangles near equilateral.
            let angle = TAU * (f64::from(i) + f64::from(j % 2) / 2.0) / f64::from(n_around);
            points.push(Vector3::new(out * angle.cos(), up, out * angle.sin()) * radius);
        }
    }
    let pole = n_rings * n_around;
    points.push(Vector3::new(0.0, radius, 0.0));
    let index = |i: u32, j: u32| j * n_around + i % n_around;
    let mut triangles = Vec::new();
    for i in 0..n_around {
        for j in 0..n_rings - 1 {
            let [a, b, c, d] = [index(i, j), index(i + 1, j), index(i, j + 1), index(i + 1, j + 1)];
            if j % 2 == 0 {
                triangles.extend([[a, c, b], [b, c, d]]);
            } else {
                triangles.extend([[a, c, d], [a, d, b]]);
            }
        }
        triangles.push([index(i, n_rings - 1), pole, index(i + 1, n_rings - 1)]);
    }
    (points, triangles)
}
