//! What `xtask view` draws: hair at rest, or a run read at each picture's time, with what the colours need.

use super::{Args, Colour};
use crate::pipeline::{load_scene, prepare};
use crate::progress::Bars;
use adaptive_runtime::{Runtime, StepInput};
use anyhow::{Context, Result, bail};
use hair_bench::run::{Mode, Reference};
use hair_bench::world::World;
use io_formats::BakeCache;
use io_formats::skinning_model::SkinningModel;
use nalgebra::Point3;

/// Hair at one time, and what its colour needs to know.
pub struct Frame {
    /// Time, s.
    pub t: f64,
    /// Positions in the world, cm.
    pub positions: Vec<[f32; 3]>,
    /// Guide that counts most, one per strand; empty unless asked for.
    pub guides: Vec<u32>,
    /// Its weight, one per strand; empty unless asked for.
    pub weights: Vec<f32>,
    /// Speeds, one per particle, cm/s; empty unless asked for.
    pub speeds: Vec<f32>,
}

/// Whether frames of this mode (none: hair at rest) know what the colour needs.
///
/// # Errors
/// Says what they lack.
pub fn check(colour: Colour, mode: Option<Mode>) -> Result<()> {
    match (colour, mode) {
        (Colour::Guide | Colour::Weight | Colour::Velocity, None) => {
            bail!("hair at rest has no {colour:?} to colour by: add --run adaptive")
        }
        (Colour::Guide | Colour::Weight, Some(Mode::FullSpace)) => bail!("full space has no guides to colour by"),
        _ => Ok(()),
    }
}

/// Makes the world and hands `draw` each frame of a mode (none: of hair at rest) with the number of it and of all.
pub fn each_frame(
    args: &Args,
    mode: Option<Mode>,
    bars: &Bars,
    draw: &mut dyn FnMut(&World, &Frame, usize, usize) -> Result<()>,
) -> Result<()> {
    let mut scene = load_scene(&args.scene, args.unit.as_deref())?;
    let Some(mode) = mode else {
        let solids = BakeCache::in_directory(&args.out.join("cache").join("solids"));
        let spinner = bars.spinner("scene");
        let world = World::build_with(scene, Some(&solids), |what| spinner.set_message(what.to_owned()))?;
        spinner.finish_and_clear();
        let pose = world.world_from_head(0.0).cast::<f32>();
        let positions = world.groom.points.iter().map(|&p| (pose * Point3::from(p)).coords.into()).collect();
        let frame = Frame { t: 0.0, positions, guides: Vec::new(), weights: Vec::new(), speeds: Vec::new() };
        return draw(&world, &frame, 0, 1);
    };
    if let Some(seconds) = args.seconds {
        scene.seconds = seconds.min(scene.seconds);
    }
    let prepared = prepare(scene, &args.out, bars)?;
    let world = prepared.world();
    let n_frames = (0..=world.n_steps()).filter(|&step| world.is_read(step)).count();
    if mode.params().is_some() {
        skinned(args, world, &prepared.model, mode, n_frames, draw)
    } else {
        full_space(args, world, &prepared.model, n_frames, draw)
    }
}

fn skinned(
    args: &Args,
    world: &World,
    model: &SkinningModel,
    mode: Mode,
    n_frames: usize,
    draw: &mut dyn FnMut(&World, &Frame, usize, usize) -> Result<()>,
) -> Result<()> {
    let params = mode.params().context("a mode that skins")?;
    let (head, poses) = (world.world_from_head(0.0), world.world_from_solids(0.0));
    let mut runtime =
        Runtime::new(model.clone(), params, head, Some(world.head.clone()), world.solids.clone(), &poses)?;
    let dt = world.scene.step_s;
    let mut before = runtime.positions().to_vec();
    let mut n = 0;
    for step in 0..=world.n_steps() {
        let t = step as f64 * dt;
        if step > 0 {
            let poses = world.world_from_solids(t);
            runtime.step(&StepInput { dt, world_from_head: world.world_from_head(t), world_from_solids: &poses });
        }
        let read = world.is_read(step);
        // A speed is that of the last step, for which the state before it is read too.
        let wanted = args.colour == Colour::Velocity && step < world.n_steps() && world.is_read(step + 1);
        if read || wanted {
            runtime.read();
        }
        if read {
            let positions = runtime.positions().to_vec();
            let particles = world.groom.n_particles;
            let most =
                |s: usize| runtime.weights(s, particles / 2).fold((0, 0.0), |a, b| if b.1 > a.1 { b } else { a });
            let strands =
                0..if matches!(args.colour, Colour::Guide | Colour::Weight) { runtime.n_strands() } else { 0 };
            let (guides, weights) = strands.map(most).map(|(g, w)| (u32::from(g), w)).unzip();
            let speeds = speeds(args, &before, &positions, if step > 0 { dt } else { f64::INFINITY });
            draw(world, &Frame { t, positions, guides, weights, speeds }, n, n_frames)?;
            n += 1;
        }
        if wanted {
            before.copy_from_slice(runtime.positions());
        }
    }
    Ok(())
}

fn full_space(
    args: &Args,
    world: &World,
    model: &SkinningModel,
    n_frames: usize,
    draw: &mut dyn FnMut(&World, &Frame, usize, usize) -> Result<()>,
) -> Result<()> {
    let (mut before, mut n, mut result) = (None::<(f64, Vec<[f32; 3]>)>, 0, Ok(()));
    let on_read = |t: f64, points: &[[f32; 3]]| {
        // A driver that fails fails again: the first reason is kept.
        if result.is_ok() {
            let speeds = match &before {
                Some((then, from)) => speeds(args, from, points, t - then),
                None => speeds(args, points, points, 1.0),
            };
            let frame = Frame { t, positions: points.to_vec(), guides: Vec::new(), weights: Vec::new(), speeds };
            result = draw(world, &frame, n, n_frames);
            n += 1;
            before = Some((t, points.to_vec()));
        }
    };
    hair_bench::run::run(world, model, Mode::FullSpace, &Reference::default(), |_| {}, on_read)?;
    result
}

fn speeds(args: &Args, from: &[[f32; 3]], to: &[[f32; 3]], seconds: f64) -> Vec<f32> {
    if args.colour != Colour::Velocity {
        return Vec::new();
    }
    let distance = |(a, b): (&[f32; 3], &[f32; 3])| (Point3::from(*b) - Point3::from(*a)).norm();
    from.iter().zip(to).map(distance).map(|d| d / seconds as f32).collect()
}
