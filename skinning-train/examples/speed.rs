//! Trains on a synthetic head of hair and prints what every stage took and what the report says:
//! `cargo run --release -p skinning-train --example speed -- [strands] [guides] [frames]`.
#![allow(clippy::print_stdout, reason = "a program, not the library")]

use io_formats::{FrameInfo, MaterialRecord, MemoryFrames, UniformGroom};
use nalgebra::{Rotation3, Vector3};
use skinning_train::{TrainInputs, TrainParams, train};

const N_PARTICLES: usize = 25;

/// Strands on a dome, 24 cm long, whose segments turn about axes that wander over time and over the head: lengths stay.
/// Each strand adds a little of its own, so that guides cannot explain everything.
fn head(n_strands: usize, time: f32, amplitude: f32) -> Vec<[f32; 3]> {
    let mut points = Vec::with_capacity(n_strands * N_PARTICLES);
    for s in 0..n_strands {
        let (turn, height) = (s as f32 * 2.399_963, 1.0 - 1.4 * (s as f32 + 0.5) / n_strands as f32);
        let radius = (1.0 - height * height).sqrt();
        let out = Vector3::new(radius * turn.cos(), height, radius * turn.sin());
        let own = (s as f32 * 12.989_8).sin();
        let mut p = 8.5 * out;
        for i in 0..N_PARTICLES {
            points.push([p.x, p.y, p.z]);
            let u = i as f32 / (N_PARTICLES - 1) as f32;
            let hang = (1.6 * u).min(1.0);
            let curl = 0.3 * Vector3::new((9.0 * u + own).sin(), 0.0, (9.0 * u + own).cos()) * u;
            let rest = (out * (1.0 - hang) - Vector3::y() * hang + curl).normalize();
            let delay = 0.8 * u;
            let axis = Vector3::new(
                (2.1 * time + 0.9 * out.x - delay).sin() + 0.4 * (5.3 * time + 2.0 * out.y - 2.0 * delay).sin(),
                0.3 * (1.3 * time + out.x).sin(),
                (1.7 * time + 0.9 * out.z - delay).cos() + 0.1 * own * (7.0 * time + own).sin(),
            );
            p += Rotation3::new(axis * (amplitude * 0.5 * u.sqrt())) * rest;
        }
    }
    points
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut counts = std::env::args().skip(1).map(|a| a.parse::<usize>());
    let mut next = |preset: usize| counts.next().unwrap_or(Ok(preset));
    let (n_strands, n_guides, n_frames) = (next(5000)?, next(100)?, next(150)?);
    let groom = UniformGroom { n_strands, n_particles: N_PARTICLES, points: head(n_strands, 0.0, 0.0) };
    let mut frames = MemoryFrames::new(n_strands, N_PARTICLES);
    for f in 0..n_frames {
        let info = FrameInfo { sequence: (f * 3 / n_frames) as u32, time_s: f as f64 * 0.04 };
        frames.push(info, &head(n_strands, f as f32 * 0.04, 1.0))?;
    }
    let material = MaterialRecord {
        stretch_dyn: 3e5,
        bend: 30.0,
        twist: 15.0,
        stretch_damping: 10.0,
        bend_damping: 0.05,
        twist_damping: 0.05,
        friction: 0.05,
        linear_density_g_per_cm: 5e-5,
        air_drag_per_s: 1.0,
    };
    let inputs = TrainInputs { rest: &groom, groom: &groom, material, provenance: 0 };
    let start = std::time::Instant::now();
    let params = TrainParams::standard(n_guides);
    let (model, report) = train(&frames, &inputs, &params, &mut |_| {})?;
    println!("{n_strands} strands, {n_guides} guides, {n_frames} frames: {:.1} s", start.elapsed().as_secs_f64());
    println!("{report:#?}");
    println!("{} sets, {} coefficient triples", model.set_mask.len(), model.coeffs.len());
    Ok(())
}
