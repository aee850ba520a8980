//! Which step hangs still and follows the 0.5 ms run: error and CPU of several substep counts at a guide step of 10 ms.
//!
//! Prints one CSV row for each motion and substep count; the numbers stand in docs/DEVIATIONS.md.

#![allow(clippy::print_stdout, reason = "a program whose output is its table")]

use nalgebra::{Isometry3, Translation3, Vector3};
use std::time::Instant;
use strand_sim::{Material, StepInput, StepParams, StepWorkspace, StrandSystem};

/// Strands fanned out from a scalp, 25 cm long, draped to hang.
fn tuft(n_strands: usize) -> Vec<Vector3<f64>> {
    let mut points = Vec::new();
    for s in 0..n_strands {
        let angle = 0.1 * s as f64;
        let out = Vector3::new(angle.cos(), 0.0, angle.sin());
        let mut at = out * 8.0;
        for i in 0..25 {
            points.push(at);
            let turn = (f64::from(i) / 6.0).min(1.0) * 1.45;
            at += out * turn.cos() * (25.0 / 24.0) - Vector3::y() * turn.sin() * (25.0 / 24.0);
        }
    }
    points
}

fn head_pose(motion: &str, t: f64) -> Isometry3<f64> {
    match motion {
        "still" => Isometry3::identity(),
        // 2 g at 2 Hz from side to side.
        "shaken" => {
            let omega = std::f64::consts::TAU * 2.0;
            Translation3::new(2.0 * 981.0 / (omega * omega) * (1.0 - (omega * t).cos()), 0.0, 0.0).into()
        }
        _ => Isometry3::rotation(Vector3::y() * 0.8 * (std::f64::consts::TAU * t).sin()),
    }
}

/// Positions every 10 ms, CPU seconds, largest strain.
fn run(points: &[Vector3<f64>], motion: &str, dt: f64, substeps: usize) -> (Vec<Vec<Vector3<f64>>>, f64, f64) {
    let params = StepParams { substeps, ..StepParams::standard() };
    let system = StrandSystem::new(points, 25, Material::straight()).expect("valid tuft");
    let mut state = system.rest_state(&head_pose(motion, 0.0));
    let mut workspace = StepWorkspace::default();
    let (mut frames, mut cpu, mut strain) = (Vec::new(), 0.0, 0.0_f64);
    let per_frame = (0.01 / dt).round() as usize;
    for step in 0..200 * per_frame {
        let t = step as f64 * dt;
        let input = StepInput {
            dt,
            world_from_head_before: head_pose(motion, t),
            world_from_head_after: head_pose(motion, t + dt),
            solids: &[],
            forces: &[],
        };
        let clock = Instant::now();
        system.step(&mut state, &input, &params, &mut workspace);
        cpu += clock.elapsed().as_secs_f64();
        if (step + 1) % per_frame == 0 {
            let positions = system.positions(&state);
            for (now, rest) in positions.chunks(25).zip(points.chunks(25)) {
                for (w, r) in now.windows(2).zip(rest.windows(2)) {
                    strain = strain.max(((w[1] - w[0]).norm() / (r[1] - r[0]).norm() - 1.0).abs());
                }
            }
            frames.push(positions);
        }
    }
    (frames, cpu, strain)
}

fn main() {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("first use of the pool");
    let points = tuft(64);
    println!("motion,substeps,rms_cm,tip_drift_cm,max_strain,us_per_strand_step");
    for motion in ["still", "shaken", "turned"] {
        let (reference, _, _) = run(&points, motion, 0.0005, 1);
        for substeps in [1, 2, 4, 8] {
            let (frames, cpu, strain) = run(&points, motion, 0.01, substeps);
            let (mut sum, mut count) = (0.0, 0.0);
            for (a, b) in frames.iter().zip(&reference) {
                for (x, y) in a.iter().zip(b) {
                    sum += (x - y).norm_squared();
                    count += 1.0;
                }
            }
            let drift = (frames[199][24] - points[24]).norm();
            println!(
                "{motion},{substeps},{:.4},{drift:.4},{strain:.4},{:.2}",
                f64::sqrt(sum / count),
                cpu * 1e6 / (64.0 * 200.0)
            );
        }
    }
}
