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
    (points, ring(around, tube))
}

/// An axis-aligned box about the origin.
pub fn cuboid(half: [f32; 3]) -> Mesh {
    let points = (0..8).map(|c| [0, 1, 2].map(|k: usize| if c >> k & 1 == 1 { half[k] } else { -half[k] })).collect();
    let quads: [[u32; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    (points, triangles)
}

/// A wheel about the y axis with a hole and so many teeth, flat above and below.
pub fn gear(teeth: u32, inner: f32, outer: f32, tooth: f32, half_height: f32) -> Mesh {
    const TUBE: u32 = 4;
    let around = 4 * teeth;
    let mut points = Vec::new();
    for i in 0..around {
        let (s, c) = (2.0 * PI * i as f32 / around as f32).sin_cos();
        let rim = if i % 4 < 2 { outer + tooth } else { outer };
        for (r, y) in [(rim, half_height), (inner, half_height), (inner, -half_height), (rim, -half_height)] {
            points.push([r * c, y, r * s]);
        }
    }
    (points, ring(around, TUBE))
}

/// A flat comb of square teeth: spine along x above z = 0, teeth along -z, `half_depth` thick along y.
pub fn flat_comb(teeth: usize, width: f32, gap: f32, length: f32, half_depth: f32) -> Mesh {
    let columns = 2 * teeth - 1;
    // Columns alternate tooth and gap; the spine is solid over all of them.
    let solid = |i: i32, k: i32| i >= 0 && (i as usize) < columns && (k == 1 || k == 0 && i % 2 == 0);
    let x = |i: usize| (i / 2) as f32 * (width + gap) + if i % 2 == 1 { width } else { 0.0 };
    let middle = 0.5 * x(columns);
    let z = [-length, 0.0, 3.0 * width];
    let mut points = Vec::new();
    for i in 0..=columns {
        for j in [-half_depth, half_depth] {
            for level in z {
                points.push([x(i) - middle, j, level]);
            }
        }
    }
    let at = |[i, j, k]: [usize; 3]| (6 * i + 3 * j + k) as u32;
    let mut triangles = Vec::new();
    let mut quad = |p: [[usize; 3]; 4], turned: bool| {
        let [a, b, c, d] = p.map(at);
        let faces = if turned { [[a, c, b], [a, d, c]] } else { [[a, b, c], [a, c, d]] };
        triangles.extend(faces);
    };
    for i in 0..columns {
        for k in 0..2 {
            if !solid(i as i32, k as i32) {
                continue;
            }
            quad([[i, 0, k], [i + 1, 0, k], [i + 1, 0, k + 1], [i, 0, k + 1]], false);
            quad([[i, 1, k], [i + 1, 1, k], [i + 1, 1, k + 1], [i, 1, k + 1]], true);
            for side in 0..2 {
                if !solid(i as i32 + 2 * side as i32 - 1, k as i32) {
                    let n = i + side;
                    quad([[n, 0, k], [n, 1, k], [n, 1, k + 1], [n, 0, k + 1]], side == 0);
                }
                if !solid(i as i32, k as i32 + 2 * side as i32 - 1) {
                    let n = k + side;
                    quad([[i, 0, n], [i + 1, 0, n], [i + 1, 1, n], [i, 1, n]], side == 0);
                }
            }
        }
    }
    (points, triangles)
}

/// A ball drawn out and dented, about as smooth as a head.
pub fn blob(radius: f32, rings: u32) -> Mesh {
    let (mut points, triangles) = sphere(radius, rings);
    for p in &mut points {
        let wave = 1.0 + 0.08 * (3.0 * p[0] / radius).sin() * (2.0 * p[1] / radius + 1.0).cos();
        *p = [p[0] * 0.85 * wave, p[1] * 1.1 * wave, p[2] * wave];
    }
    (points, triangles)
}

/// Triangles between the points of a ring closed both ways, `tube` points at each of `around` places.
fn ring(around: u32, tube: u32) -> Vec<[u32; 3]> {
    let at = |i: u32, j: u32| i % around * tube + j % tube;
    let mut triangles = Vec::new();
    for i in 0..around {
        for j in 0..tube {
            triangles.push([at(i, j), at(i, j + 1), at(i + 1, j)]);
            triangles.push([at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]);
        }
    }
    triangles
}
