//! Samples with gradient a second and core near a head-sized ball and a row of teeth: one by one and in batches.

use collision::{Samples, Shape, ShapeUnion, SignedDistanceField, Solid};
use nalgebra::Vector3;
use std::time::Instant;

const POINTS: usize = 1 << 14;
const ROUNDS: usize = 200;

fn near(sdf: &SignedDistanceField, reach: f32) -> [Vec<f32>; 3] {
    let mut seed = 1u64;
    let mut unit = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 40) as f32 / (1u64 << 24) as f32
    };
    let (low, size) = (sdf.bounds().min, sdf.bounds().size());
    let mut points = [Vec::new(), Vec::new(), Vec::new()];
    while points[0].len() < POINTS {
        // Strands: steps of a millimetre from a random start near the surface.
        let mut p = low + Vector3::new(unit() * size.x, unit() * size.y, unit() * size.z);
        let step = Vector3::new(unit() - 0.5, unit() - 0.5, unit() - 0.5).normalize() * 0.1;
        for _ in 0..32 {
            if sdf.distance(p).abs() > reach {
                break;
            }
            for k in 0..3 {
                points[k].push(p[k]);
            }
            p += step;
        }
    }
    points.map(|mut p| {
        p.truncate(POINTS);
        p
    })
}

fn main() {
    let tooth = |x: f32| Shape::capsule(Vector3::new(x, 0.0, 0.0), Vector3::new(x, 0.0, -4.0), 0.08);
    let comb = ShapeUnion::sharp((0..13).map(|n| tooth(0.4 * n as f32)).collect());
    let ball = Shape::sphere(Vector3::zeros(), 9.0).into();
    for (name, shape, cell, reach) in [("head", ball, 0.25, 1.0), ("comb", comb, 0.02, 0.2)] {
        let sdf = Solid::from_shape(name, &shape, cell, 0.08, 0.3).expect("a sound shape").sdf;
        let p = near(&sdf, reach);
        let mut out = [const { Vec::new() }; 4].map(|_: Vec<f32>| vec![0.0f32; POINTS]);
        let mut best = [f64::INFINITY; 2];
        let mut sum = 0.0f64;
        for _ in 0..ROUNDS {
            let begin = Instant::now();
            let [d, x, y, z] = &mut out;
            sdf.sample([&p[0], &p[1], &p[2]], &mut Samples { distance: d, gradient: [x, y, z] });
            best[0] = best[0].min(begin.elapsed().as_secs_f64());
            let begin = Instant::now();
            for n in 0..POINTS {
                let (d, g) = sdf.distance_gradient(Vector3::new(p[0][n], p[1][n], p[2][n]));
                out[0][n] = d;
                for k in 0..3 {
                    out[k + 1][n] = g[k];
                }
            }
            best[1] = best[1].min(begin.elapsed().as_secs_f64());
            sum += f64::from(out[0][7]);
        }
        let [batch, single] = best.map(|s| POINTS as f64 / s / 1e6);
        println!(
            "{name}: {batch:.0} M samples/s in batches, {single:.0} M one by one ({} B, {sum:.3})",
            sdf.memory_bytes()
        );
    }
}
