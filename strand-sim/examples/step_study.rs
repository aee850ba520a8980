//! Which step hangs still and follows a fine run: error and CPU of the candidates at a guide step of 10 ms.
//!
//! Prints one CSV row for each motion and candidate; the numbers stand in docs/DEVIATIONS.md. The first rows of a motion
//! say how far two fine runs are from each other: below that an error says nothing.

#![allow(clippy::print_stdout, reason = "a program whose output is its table")]

use nalgebra::{Isometry3, Translation3, Vector3};
use std::time::Instant;
use strand_sim::{Material, Scheme, StepInput, StepParams, StepWorkspace, StrandSystem, Substeps};

const N_STRANDS: usize = 64;
const N_FRAMES: usize = 200;

/// Strands fanned out from a scalp, 25 cm long, draped to hang.
fn tuft() -> Vec<Vector3<f64>> {
    let mut points = Vec::new();
    for s in 0..N_STRANDS {
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
    let tau = std::f64::consts::TAU;
    match motion {
        "falling" => Isometry3::identity(),
        // 2 g at 2 Hz from side to side.
        "shaken" => {
            Translation3::new(2.0 * 981.0 / (2.0 * tau).powi(2) * (1.0 - (2.0 * tau * t).cos()), 0.0, 0.0).into()
        }
        // A swing of a third of g at 1 Hz, near the hair's own.
        "swung" => Translation3::new(327.0 / tau.powi(2) * (1.0 - (tau * t).cos()), 0.0, 0.0).into(),
        _ => Isometry3::rotation(Vector3::y() * 0.8 * (tau * t).sin()),
    }
}

struct Outcome {
    frames: Vec<Vec<Vector3<f64>>>,
    us_per_strand_step: f64,
    max_strain: f64,
    /// Mean kinetic measure at the end: RMS movement over the last frame, cm.
    restless: f64,
}

/// Positions every 10 ms of steps of `dt` seconds.
fn run(points: &[Vector3<f64>], motion: &str, dt: f64, params: &StepParams) -> Outcome {
    let system = StrandSystem::new(points, 25, Material::straight()).expect("valid tuft");
    let mut state = system.rest_state(&head_pose(motion, 0.0));
    let mut workspace = StepWorkspace::default();
    let (mut frames, mut cpu, mut max_strain) = (Vec::new(), 0.0, 0.0_f64);
    let per_frame = (0.01 / dt).round() as usize;
    for step in 0..N_FRAMES * per_frame {
        let t = step as f64 * dt;
        let input = StepInput::carried(dt, head_pose(motion, t), head_pose(motion, t + dt));
        let clock = Instant::now();
        system.step(&mut state, &input, params, &mut workspace);
        cpu += clock.elapsed().as_secs_f64();
        if (step + 1) % per_frame == 0 {
            let positions = system.positions(&state);
            for (now, rest) in positions.chunks(25).zip(points.chunks(25)) {
                for (w, r) in now.windows(2).zip(rest.windows(2)) {
                    max_strain = max_strain.max(((w[1] - w[0]).norm() / (r[1] - r[0]).norm() - 1.0).abs());
                }
            }
            frames.push(positions);
        }
    }
    let n = frames.len();
    let restless = rms(&frames[n - 1..], &frames[n - 2..n - 1]);
    Outcome { frames, us_per_strand_step: cpu * 1e6 / (N_STRANDS * N_FRAMES) as f64, max_strain, restless }
}

fn rms(a: &[Vec<Vector3<f64>>], b: &[Vec<Vector3<f64>>]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (x, y) in a.iter().flatten().zip(b.iter().flatten()) {
        sum += (x - y).norm_squared();
        count += 1.0;
    }
    f64::sqrt(sum / count)
}

/// Steps tried for quiet hanging, longest first, s.
const STEPS_S: [f64; 7] = [1.0 / 24.0, 0.02, 0.01, 0.005, 0.0025, 0.00125, 6e-4];

/// Speed below which a strand counts as hanging quietly, cm/s.
const QUIET_CM_PER_S: f64 = 0.05;

/// How long a strand hangs before it is watched for two seconds, s: a slow curl still swings then, but ever less.
const HANGING_S: f64 = 2.0;

/// Whether strands come to hang quietly, in air that damps any swing: the RMS speed of the last second is below that of the
/// second before, or below [`QUIET_CM_PER_S`]. A step too long jitters at a level that does not fall.
fn hangs_quietly(points: &[Vector3<f64>], n: usize, dt: f64, params: &StepParams) -> bool {
    /// Least fall in a second of what air at 4/s is to damp at least as exp(-t).
    const FALL: f64 = 0.7;
    let material = Material { air_drag_per_s: 4.0, ..Material::straight() };
    let system = StrandSystem::new(points, n, material).expect("valid strands");
    let mut state = system.rest_state(&Isometry3::identity());
    let mut workspace = StepWorkspace::default();
    let input = StepInput::still(dt, Isometry3::identity());
    let mut before = system.positions(&state);
    let mut speed_over = |seconds: f64| {
        let (mut sum, mut count) = (0.0, 0.0);
        for _ in 0..(seconds / dt).round() as usize {
            if system.step(&mut state, &input, params, &mut workspace).quarantined > 0 {
                return f64::INFINITY;
            }
            // What moves, not what velocities say: limits on length move particles too.
            let now = system.positions(&state);
            sum += now.iter().zip(&before).map(|(a, b)| (a - b).norm_squared()).sum::<f64>() / (dt * dt);
            count += now.len() as f64;
            before = now;
        }
        f64::sqrt(sum / count)
    };
    if speed_over(HANGING_S).is_infinite() {
        return false;
    }
    let (earlier, last) = (speed_over(1.0), speed_over(1.0));
    last < QUIET_CM_PER_S || last < FALL * earlier
}

/// For each rig, length and candidate the largest step that hangs quietly.
fn hanging(with: impl Fn(Scheme, bool, f64) -> StepParams) {
    println!("rig,length_cm,particles,candidate,largest_quiet_step_ms,bound_of_frozen_tension_ms");
    let lean = |n: usize, length: f64, k: usize| {
        let (sin, cos) = (0.05 + 0.1 * k as f64).sin_cos();
        let h = length / (n - 1) as f64;
        (0..n).map(move |i| Vector3::new(h * i as f64 * sin, -h * i as f64 * cos, 0.0)).collect::<Vec<_>>()
    };
    let coil = |n: usize, length: f64, k: usize| {
        let h = length / (n - 1) as f64;
        let mut at = Vector3::new(k as f64, 0.0, 0.0);
        (0..n)
            .map(|i| {
                let here = at;
                let turn = 0.6 * i as f64;
                at += Vector3::new(0.6 * turn.cos(), -0.8, 0.6 * turn.sin()) * h;
                here
            })
            .collect::<Vec<_>>()
    };
    for (n, length) in [(25, 12.0), (25, 25.0), (25, 50.0), (50, 50.0), (100, 25.0)] {
        for rig in ["straight", "curly"] {
            let shape = |k: usize| if rig == "straight" { lean(n, length, k) } else { coil(n, length, k) };
            let points: Vec<_> = (0..8).flat_map(shape).collect();
            for (name, params) in [
                ("MS08 trapezoidal", with(Scheme::Trapezoidal, false, 0.1)),
                ("MS08 backward Euler", with(Scheme::TwoSolves, false, 0.1)),
                ("frozen", with(Scheme::BackwardEuler, false, 0.01)),
                ("length-kept", with(Scheme::BackwardEuler, false, 0.0)),
                ("geometric", with(Scheme::BackwardEuler, true, 0.01)),
            ] {
                // Every shorter step is to be quiet too.
                let quiet = |&&dt: &&f64| hangs_quietly(&points, n, dt, &params);
                let largest = 1e3 * STEPS_S.iter().rev().take_while(quiet).last().copied().unwrap_or(f64::NAN);
                let h = length / (n - 1) as f64;
                let bound = 1e3 * h / (981.0 * length).sqrt();
                println!("{rig},{length},{n},{name},{largest:.2},{bound:.2}");
            }
        }
    }
}

fn main() {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("first use of the pool");
    let points = tuft();
    let base = StepParams::standard();
    let with = |scheme, geometric_stiffness, iterations, substeps, strain_limit| StepParams {
        scheme,
        geometric_stiffness,
        iterations,
        substeps: Substeps::Fixed(substeps),
        strain_limit,
        ..base
    };
    let mut candidates = vec![
        ("MS08 trapezoidal x1".to_owned(), with(Scheme::Trapezoidal, false, 1, 1, 0.1)),
        ("MS08 trapezoidal x20".to_owned(), with(Scheme::Trapezoidal, false, 1, 20, 0.1)),
        ("MS08 backward Euler x1".to_owned(), with(Scheme::TwoSolves, false, 1, 1, 0.1)),
        ("MS08 backward Euler x20".to_owned(), with(Scheme::TwoSolves, false, 1, 20, 0.1)),
        ("trapezoidal geometric x4".to_owned(), with(Scheme::Trapezoidal, true, 1, 4, 0.01)),
        ("trapezoidal length-kept x4".to_owned(), with(Scheme::Trapezoidal, false, 1, 4, 0.0)),
    ];
    for (name, scheme) in [("", Scheme::BackwardEuler)] {
        for n in [1, 2, 4, 8] {
            candidates.push((format!("{name}geometric x{n}"), with(scheme, true, 1, n, 0.01)));
        }
        candidates.push((format!("{name}geometric refrozen x2"), with(scheme, true, 2, 2, 0.01)));
        candidates.push((format!("{name}geometric length-kept x2"), with(scheme, true, 1, 2, 0.0)));
        for n in [1, 2, 3, 4, 8] {
            candidates.push((format!("{name}frozen x{n}"), with(scheme, false, 1, n, 0.01)));
        }
        candidates.push((format!("{name}refrozen x2"), with(scheme, false, 2, 2, 0.01)));
        for n in [1, 2, 3, 4, 8] {
            candidates.push((format!("{name}length-kept x{n}"), with(scheme, false, 1, n, 0.0)));
        }
        candidates.push((format!("{name}refrozen length-kept x2"), with(scheme, false, 2, 2, 0.0)));
    }
    if std::env::args().any(|a| a == "hanging") {
        hanging(|scheme, geometric, limit| with(scheme, geometric, 1, 1, limit));
        return;
    }
    let only = std::env::args().nth(1).unwrap_or_default();
    println!("motion,candidate,rms_first_half_second_cm,rms_two_seconds_cm,max_strain,restless_cm,us_per_strand_step");
    for motion in ["falling", "swung", "shaken", "turned"] {
        let fine = |dt, scheme| run(&points, motion, dt, &with(scheme, true, 2, 1, 0.01)).frames;
        let reference = fine(0.0005, Scheme::BackwardEuler);
        let row = |name: &str, o: &Outcome| {
            println!(
                "{motion},{name},{:.4},{:.4},{:.4},{:.5},{:.2}",
                rms(&o.frames[..50], &reference[..50]),
                rms(&o.frames, &reference),
                o.max_strain,
                o.restless,
                o.us_per_strand_step
            );
        };
        row(
            "(backward Euler at 0.25 ms)",
            &run(&points, motion, 0.00025, &with(Scheme::BackwardEuler, true, 2, 1, 0.01)),
        );
        for (name, params) in candidates.iter().filter(|(name, _)| name.contains(&only)) {
            row(name, &run(&points, motion, 0.01, params));
        }
    }
}
