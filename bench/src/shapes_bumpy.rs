//! A ball with bumps as an even net of triangles: what bakes are timed with.

use std::collections::HashMap;

use io_formats::TriMesh;
use nalgebra::Vector3;

/// An icosahedron whose faces were split into four `level` times (20 · 4^level triangles), bent onto a bumpy ball of about
/// `radius_cm`.
#[must_use]
pub fn bumpy_ball(level: u32, radius_cm: f64) -> TriMesh {
    let golden = 0.5 * (1.0 + 5f64.sqrt());
    let mut points: Vec<Vector3<f64>> = Vec::new();
    for (a, b) in [(1.0, golden), (1.0, -golden), (-1.0, golden), (-1.0, -golden)] {
        points.extend([Vector3::new(0.0, a, b), Vector3::new(a, b, 0.0), Vector3::new(b, 0.0, a)]);
    }
    points.iter_mut().for_each(|p| *p /= p.norm());
    /// Neighbours of an icosahedron on the unit ball are 1.05 apart, others 1.7 and more.
    const EDGE: f64 = 1.2;
    let mut faces: Vec<[u32; 3]> = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                let [p, q, r] = [a, b, c].map(|n: usize| points[n]);
                if [p - q, q - r, r - p].iter().all(|e| e.norm() < EDGE) {
                    let outwards = (q - p).cross(&(r - p)).dot(&p) > 0.0;
                    faces.push(if outwards { [a, b, c] } else { [a, c, b] }.map(|n| n as u32));
                }
            }
        }
    }
    for _ in 0..level {
        let mut middle_of: HashMap<[u32; 2], u32> = HashMap::new();
        let mut split = Vec::with_capacity(4 * faces.len());
        for &[a, b, c] in &faces {
            let [ab, bc, ca] = [[a, b], [b, c], [c, a]].map(|[a, b]| {
                *middle_of.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                    let middle = points[a as usize] + points[b as usize];
                    points.push(middle / middle.norm());
                    points.len() as u32 - 1
                })
            });
            split.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        faces = split;
    }
    let bent = points.iter().map(|u| {
        let bumps = 0.08 * (9.0 * u.x).sin() * (8.0 * u.y).sin() + 0.05 * (11.0 * u.z).sin();
        (u * (radius_cm * (1.0 + bumps))).cast::<f32>().into()
    });
    TriMesh { vertices: bent.collect(), triangles: faces }
}
