//! What hair-hair interaction costs on a full head: seconds of each stage, with a hash of the result.
//!
//! `interaction_study [n_strands] [n_particles] [reach_cm]` prints one CSV row for each stage and step; the strands hang
//! from a scalp of 9 cm radius and are shaken.

#![allow(clippy::print_stdout, reason = "a program whose output is its table")]

use nalgebra::Vector3;
use std::time::Instant;
use strand_sim::interaction::{
    CollideParams, CollisionWorkspace, LinkSet, NearPairs, RepulsionParams, StictionParams, StictionWorkspace, Strands,
    collide, repel,
};
use strand_sim::solve::coupled::{CoupledParams, CoupledWorkspace, RankOne, solve_coupled};

const DT: f64 = 5e-4;

fn unit(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    ((*seed >> 11) as f64) / ((1_u64 << 53) as f64)
}

/// Strands of 25 cm from the upper half of a sphere, out and down, each with its own slight waves.
fn head(n_strands: usize, n_particles: usize) -> Vec<Vector3<f64>> {
    let mut points = Vec::with_capacity(n_strands * n_particles);
    let (h, mut seed) = (25.0 / (n_particles - 1) as f64, 1);
    for s in 0..n_strands {
        let up = 1.0 - (s as f64 + 0.5) / n_strands as f64;
        let angle = 2.399_963_229_728_653 * s as f64;
        let out = Vector3::new(angle.cos(), 0.0, angle.sin());
        let outward = out * (1.0 - up * up).sqrt() + Vector3::y() * up;
        let mut at = outward * 9.0;
        let (wave, phase) = (0.4 * unit(&mut seed), 6.3 * unit(&mut seed));
        for i in 0..n_particles {
            points.push(at);
            let along = i as f64 * h;
            let fall = (along / 6.0).min(1.0);
            let sway = Vector3::new((along + phase).sin(), 0.0, (1.3 * along + phase).cos()) * wave;
            at += (outward * (1.0 - fall) - Vector3::y() * fall + sway).normalize() * h;
        }
    }
    points
}

fn hash(values: &[Vector3<f64>]) -> u64 {
    values.iter().flat_map(|v| [v.x, v.y, v.z]).fold(0, |h: u64, x| (h ^ x.to_bits()).wrapping_mul(0x100_0000_01b3))
}

fn main() {
    let argument = |k: usize, default: f64| std::env::args().nth(k).and_then(|a| a.parse().ok()).unwrap_or(default);
    let (n_strands, n_particles) = (argument(1, 10_000.0) as usize, argument(2, 50.0) as usize);
    let reach_cm = argument(3, 0.1);
    let mut position = head(n_strands, n_particles);
    let mass = 5e-5 * 25.0 / (n_particles - 1) as f64;
    let inv_mass: Vec<f64> = (0..position.len()).map(|p| if p % n_particles < 3 { 0.0 } else { 1.0 / mass }).collect();
    let mut seed = 2;
    let mut velocity: Vec<_> = (0..position.len())
        .map(|p| {
            if inv_mass[p] > 0.0 { Vector3::from_fn(|_, _| 200.0 * (unit(&mut seed) - 0.5)) } else { Vector3::zeros() }
        })
        .collect();
    let stiction = StictionParams { make_cm: reach_cm, break_cm: 2.0 * reach_cm, ..StictionParams::dry() };
    let repulsion = RepulsionParams { thickness_cm: reach_cm, ..RepulsionParams::standard() };
    let (mut near, mut links, mut stiction_workspace) =
        (NearPairs::default(), LinkSet::default(), StictionWorkspace::default());
    let (mut collision_workspace, mut coupled_workspace) = (CollisionWorkspace::default(), CoupledWorkspace::default());
    let mut springs = Vec::new();
    println!("step,stage,seconds,count,hash");
    for step in 0..4 {
        let strands = Strands::new(n_particles, &position, &inv_mass);
        let row = |stage: &str, start: Instant, count: usize, values: &[Vector3<f64>]| {
            println!("{step},{stage},{:.4},{count},{:016x}", start.elapsed().as_secs_f64(), hash(values));
        };
        let start = Instant::now();
        near.find(&strands, reach_cm);
        row("near", start, near.pairs().len(), &[]);
        let start = Instant::now();
        let report = links.update(&strands, near.pairs(), &stiction, &mut stiction_workspace);
        row("stiction", start, report.held, &[]);
        let start = Instant::now();
        links.springs(&strands, &stiction, &mut springs);
        row("springs", start, springs.len(), &[]);
        let start = Instant::now();
        let report = repel(&strands, near.pairs(), &LinkSet::default(), &repulsion, DT, &mut velocity);
        row("repel_all", start, report.pushed, &velocity);
        let start = Instant::now();
        let report = repel(&strands, near.pairs(), &links, &repulsion, DT, &mut velocity);
        row("repel_unlinked", start, report.pushed, &velocity);
        let ranked: Vec<_> = springs
            .iter()
            .map(|s| RankOne {
                unknowns: s.particles,
                weights: s.weights,
                direction: s.direction,
                coefficient: s.coefficient(DT),
            })
            .collect();
        let momentum: Vec<_> = velocity.iter().map(|v| v * mass).collect();
        let mut solved = velocity.clone();
        let start = Instant::now();
        let divide = |r: &[Vector3<f64>], z: &mut [Vector3<f64>]| {
            for (z, r) in z.iter_mut().zip(r) {
                *z = r / mass;
            }
        };
        let params = CoupledParams::standard();
        let report = solve_coupled(&ranked, &momentum, &mut solved, divide, &params, &mut coupled_workspace);
        row("coupled", start, report.iterations, &solved);
        let mut end: Vec<_> = position.iter().zip(&velocity).map(|(x, v)| x + v * DT).collect();
        let start = Instant::now();
        let params = CollideParams::standard();
        let report = collide(&strands, &mut end, &mut velocity, &links, &params, DT, &mut collision_workspace);
        row("collide", start, report.crossings, &end);
        println!("{step},unresolved,0,{},0", report.unresolved);
        position = end;
    }
}
