//! A host program: loads a skinning model, turns the head, moves a ball into the hair, steps, and reads where hair is.
//!
//! `cargo run --release -p adaptive-runtime --example embed -- MODEL.skin`, with a model that `cargo xtask train` wrote. Every
//! step moves head and solids to their poses at its end; lengths in cm.
#![allow(clippy::print_stdout, reason = "an example that prints what it found")]

use adaptive_runtime::{Runtime, RuntimeParams, StepInput};
use collision::{Shape, Solid};
use io_formats::SkinningModel;
use nalgebra::{Isometry3, Vector3};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: embed MODEL.skin")?;
    let model = SkinningModel::load(path.as_ref())?;

    // The ball starts ten centimetres in front of the middle of all hair, and moves through it.
    let points = model.rest_in_head.as_chunks::<3>().0;
    let sum: Vector3<f64> = points.iter().map(|&p| Vector3::from(p).cast::<f64>()).sum();
    let middle = sum / points.len() as f64;
    let ball = Solid::from_shape("ball", &Shape::sphere(Vector3::zeros(), 3.0).into(), 0.2, 3.0, 0.3)?;
    let ball_at = |time: f64| Isometry3::from(middle + Vector3::new(0.0, 0.0, 10.0 - 20.0 * time));
    let head_at = |time: f64| Isometry3::rotation(Vector3::y() * 0.2 * (5.0 * time).sin());

    let mut hair = Runtime::new(model, RuntimeParams::adaptive(), head_at(0.0), None, vec![ball], &[ball_at(0.0)])?;
    let dt = 0.01;
    for step in 1..=50 {
        let time = f64::from(step) * dt;
        let report = hair.step(&StepInput { dt, world_from_head: head_at(time), world_from_solids: &[ball_at(time)] });
        if step % 10 == 0 {
            hair.read();
            let moved = hair.positions().iter().zip(hair.previous_positions());
            let furthest = moved.map(|(a, b)| (Vector3::from(*a) - Vector3::from(*b)).norm()).fold(0.0, f32::max);
            println!(
                "{time:.1} s: {} of {} hairs touch the ball, {furthest:.2} cm moved at most since the last line",
                report.strands_in_contact,
                hair.n_strands()
            );
        }
    }
    Ok(())
}
