//! Closed meshes with known shape.

use std::f32::consts::PI;

pub type Mesh = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// A ball about the origin; the seam and the poles hold duplicate vertices, which baking has to weld.
pub fn sphere(radius: f32, rings: u32) -> Mesh {
    let around = 2 * rings;
    let mut points = Vec::new();
    for i in 0..=rings {
        let polar = PI * i as f32 / rings as f32;
        for j in 0..=around {
            // The last column repeats the first to the bit, and each pole is one point.
            let turn = 2.0 * PI * (j % around) as f32 / around as f32;
            let across = if i == 0 || i == rings { 0.0 } else { polar.sin() };
            points.push([radius * across * turn.cos(), radius * polar.cos(), radius * across * turn.sin()]);
        }
    }
    let mut triangles = Vec::new();
    for i in 0..rings {
        for j in 0..around {
            let at = |i: u32, j: u32| i * (around + 1) + j;
            triangles.push([at(i, j), at(i, j + 1), at(i + 1, j)]);
            triangles.push([at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]);
        }
    }
    (points, triangles)
}

/// A ring about the y axis.
pub fn torus(major: f32, minor: f32, around: u32, tube: u32) -> Mesh {
    let mut points = Vec::new();
    for i in 0..around {
        let (s, c) = (2.0 * PI * i as f32 / around as f32).sin_cos();
        for j in 0..tube {
            let (st, ct) = (2.0 * PI * j as f32 / tube as f32).sin_cos();
            points.push([(major + minor * ct) * c, minor * st, (major + minor * ct) * s]);
        }
    }
    let mut triangles = Vec::new();
    for i in 0..around {
        for j in 0..tube {
            let at = |i: u32, j: u32| i % around * tube + j % tube;
            triangles.push([at(i, j), at(i, j + 1), at(i + 1, j)]);
            triangles.push([at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]);
        }
    }
    (points, triangles)
}

/// An axis-aligned box about the origin.
pub fn cuboid(half: [f32; 3]) -> Mesh {
    let points = (0..8).map(|c| [0, 1, 2].map(|k: usize| if c >> k & 1 == 1 { half[k] } else { -half[k] })).collect();
    let quads: [[u32; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    (points, triangles)
}
