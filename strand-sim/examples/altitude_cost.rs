//! Measures the altitude kernel: nanoseconds per tetrahedron of a batch of eight strands, over curly strands of 25
//! particles that stay in cache, with the rest lengths streamed as a step would.

#![allow(clippy::print_stdout, reason = "a program whose output is its figure")]

use multiversion::multiversion;
use std::time::Instant;
use strand_sim::altitude::{AltitudeRest, AltitudeRestLanes, altitude_lanes};
use strand_sim::lanes::{LANES, Lane3, ZERO};

const N_PARTICLES: usize = 25;
const N_BATCHES: usize = 50;
const N_ROUNDS: usize = 400;

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn sweep(position: &[Lane3], rest: &[AltitudeRestLanes], sum: &mut f64) {
    for (t, rest) in rest.iter().enumerate() {
        let [a, b, c, d] = [0, 1, 2, 3].map(|p| &position[t + p]);
        let spring = altitude_lanes([a, b, c, d], rest);
        for l in 0..LANES {
            *sum += spring.length[l] * spring.weight[2][l] + spring.direction[1][l] * spring.per_length[l];
        }
    }
}

fn main() {
    let mut batches = Vec::new();
    for batch in 0..N_BATCHES {
        let mut position = vec![[ZERO; 3]; N_PARTICLES];
        for (i, p) in position.iter_mut().enumerate() {
            for l in 0..LANES {
                let angle = (0.8 + 0.01 * l as f64 + 0.001 * batch as f64) * i as f64;
                (p[0][l], p[1][l], p[2][l]) = (angle.cos(), -0.4 * i as f64, angle.sin());
            }
        }
        let rest: Vec<_> = (0..N_PARTICLES - 3)
            .map(|t| {
                let corners = |l: usize| {
                    [0, 1, 2, 3].map(|p| {
                        let x = &position[t + p];
                        nalgebra::Vector3::new(x[0][l], x[1][l], x[2][l])
                    })
                };
                let mut lanes = AltitudeRest::new(&corners(0)).splat();
                for l in 0..LANES {
                    lanes.set(l, &AltitudeRest::new(&corners(l)));
                }
                lanes
            })
            .collect();
        batches.push((position, rest));
    }
    let mut best = f64::INFINITY;
    let mut sum = 0.0;
    for _ in 0..N_ROUNDS {
        let start = Instant::now();
        for (position, rest) in &batches {
            sweep(position, rest, &mut sum);
        }
        best = best.min(start.elapsed().as_secs_f64());
    }
    let per_batch = best / (N_BATCHES * (N_PARTICLES - 3)) as f64;
    println!("{:.0} ns per tetrahedron of {LANES} strands (checksum {sum:.6e})", per_batch * 1e9);
}
