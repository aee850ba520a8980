//! Seconds and bytes of baking a bumpy ball of 81,920 triangles: every node of a grid of 128³ cells, and fine near the
//! surface only.

use collision::{BakeParams, bake_from_mesh};
use std::time::Instant;

/// An icosahedron whose faces were split into four `level` times, bent onto a ball with bumps.
fn bumpy(level: u32) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let g = 0.5 * (1.0 + 5f64.sqrt());
    let mut points: Vec<[f64; 3]> = Vec::new();
    for (a, b) in [(1.0, g), (1.0, -g), (-1.0, g), (-1.0, -g)] {
        points.extend([[0.0, a, b], [a, b, 0.0], [b, 0.0, a]]);
    }
    let length = |p: [f64; 3]| p.iter().map(|x| x * x).sum::<f64>().sqrt();
    let apart = |p: [f64; 3], q: [f64; 3]| length([p[0] - q[0], p[1] - q[1], p[2] - q[2]]);
    let mut faces: Vec<[u32; 3]> = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                let [p, q, r] = [a, b, c].map(|n| points[n]);
                if [apart(p, q), apart(q, r), apart(r, p)].iter().all(|&d| d < 2.1) {
                    let normal = [
                        (q[1] - p[1]) * (r[2] - p[2]) - (q[2] - p[2]) * (r[1] - p[1]),
                        (q[2] - p[2]) * (r[0] - p[0]) - (q[0] - p[0]) * (r[2] - p[2]),
                        (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]),
                    ];
                    let out = (0..3).map(|k| normal[k] * p[k]).sum::<f64>() > 0.0;
                    faces.push(if out { [a, b, c] } else { [a, c, b] }.map(|n| n as u32));
                }
            }
        }
    }
    for _ in 0..level {
        let mut middle_of = std::collections::HashMap::new();
        let mut split = Vec::with_capacity(4 * faces.len());
        for &[a, b, c] in &faces {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(a, b): (u32, u32)| {
                *middle_of.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    let m: [f64; 3] = std::array::from_fn(|k| points[a as usize][k] + points[b as usize][k]);
                    let l = length(m) / length(points[0]);
                    points.push(m.map(|x| x / l));
                    points.len() as u32 - 1
                })
            });
            split.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        faces = split;
    }
    let bent = points.iter().map(|&p| {
        let u = p.map(|x| x / length(p));
        let r = 5.0 * (1.0 + 0.08 * (9.0 * u[0]).sin() * (8.0 * u[1]).sin() + 0.05 * (11.0 * u[2]).sin());
        u.map(|x| (x * r) as f32)
    });
    (bent.collect(), faces)
}

fn main() {
    let (points, triangles) = bumpy(6);
    println!("{} vertices, {} triangles", points.len(), triangles.len());
    let cell = 12.0 / 127.0;
    for band_cells in [f32::INFINITY, 2.0] {
        for _ in 0..3 {
            let begin = Instant::now();
            let params = BakeParams { band_cells, margin: 0.2, ..BakeParams::with_cell(cell) };
            let sdf = bake_from_mesh(&points, &triangles, params).expect("a sound mesh");
            println!(
                "band {band_cells}: {:?} nodes, {:.3} s, {:.1} MB, errors {:.5} near {:.5} far, cell {cell:.4} cm, steepest {}",
                sdf.nodes(),
                begin.elapsed().as_secs_f64(),
                sdf.memory_bytes() as f64 / 1e6,
                sdf.max_error(),
                sdf.far_error(),
                sdf.steepest()
            );
        }
    }
}
