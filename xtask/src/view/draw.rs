//! The pictures of `xtask view`: a scene's hair and solids handed to the renderer, and what comes back to files.

use super::frames::{Frame, check, each_frame};
use super::{Args, Colour};
use crate::painter::{camera, sized, solids, start};
use crate::pipeline::use_threads;
use crate::progress::Bars;
use anyhow::{Context, Result};
use hair_bench::picture::contact_sheet;
use hair_bench::run::Mode;
use hair_bench::world::World;
use hair_viewer::{
    BLONDE, BROWN, Camera, ColourBy, Curve, HORN, Image, RenderProcess, SKIN, Scene, Strands, Video, psnr,
};
use nalgebra::Vector3;
use std::f32::consts::TAU;
use std::path::PathBuf;

/// Pictures on the sheet that shows several.
const ON_SHEET: usize = 9;

pub(super) fn run(args: &Args) -> Result<()> {
    for mode in [Some(args.run), args.against.map(Some)].into_iter().flatten() {
        check(args.colour, mode)?;
    }
    use_threads(args.threads)?;
    let bars = Bars::new();
    let mut renderer = start(&bars)?;
    let mut others = Vec::new();
    if let Some(mode) = args.against {
        let bar = bars.bar(mode.name(), 1);
        each_picture(args, Some(mode), &mut renderer, &bars, &mut |_, image, _, n_pictures| {
            bar.set_length(n_pictures as u64);
            bar.inc(1);
            others.push(image);
            Ok(())
        })?;
        bar.finish_and_clear();
    }
    let (mut output, mut apart) = (None, Vec::new());
    each_picture(args, args.run, &mut renderer, &bars, &mut |world, mut image, t, n_pictures| {
        let output = match &mut output {
            Some(output) => output,
            empty => empty.insert(Output::create(args, world, &bars, n_pictures)?),
        };
        if let Some(other) = others.get(output.n_done) {
            apart.push(psnr(&image, other)?);
        }
        if args.run.is_some() {
            image.draw_time(t);
        }
        output.push(image)
    })?;
    output.context("a scene without a moment to draw")?.finish(renderer.adapter())?;
    if let (Some(run), Some(against)) = (args.run, args.against) {
        // Equal pictures, as both begin with, are infinitely alike: they have no part in a mean.
        let finite: Vec<f64> = apart.iter().copied().filter(|x| x.is_finite()).collect();
        let mean = finite.iter().sum::<f64>() / finite.len() as f64;
        let least = finite.iter().copied().fold(f64::INFINITY, f64::min);
        println!(
            "PSNR of {} against {}: mean {mean:.2} dB, least {least:.2} dB over {} pictures; {} more are equal",
            run.name(),
            against.name(),
            finite.len(),
            apart.len() - finite.len()
        );
    }
    Ok(())
}

/// Draws every picture of a mode (none: of hair at rest) and hands on each with its time and the number of all.
fn each_picture(
    args: &Args,
    mode: Option<Mode>,
    renderer: &mut RenderProcess,
    bars: &Bars,
    then: &mut dyn FnMut(&World, Image, f64, usize) -> Result<()>,
) -> Result<()> {
    each_frame(args, mode, bars, &mut |world, frame, n, n_frames| {
        let around = if n_frames == 1 { args.turntable.unwrap_or(1).max(1) } else { 1 };
        let n_pictures = around * n_frames;
        let depths = if args.colour == Colour::Penetration { depths(world, frame) } else { Vec::new() };
        for k in n * around..(n + 1) * around {
            let turn = if args.turntable.is_some() { TAU * k as f32 / n_pictures as f32 } else { 0.0 };
            let camera = sized(camera(world), args.height).turned(args.turn.to_radians() + turn);
            then(world, draw(renderer, world, frame, &depths, camera, args)?, frame.t, n_pictures)?;
        }
        Ok(())
    })
}

/// Where pictures go.
struct Output {
    stem: PathBuf,
    each: bool,
    video: Option<(Video, PathBuf)>,
    n_pictures: usize,
    n_done: usize,
    sheet: Vec<Image>,
    bar: crate::progress::Bar,
}

impl Output {
    fn create(args: &Args, world: &World, bars: &Bars, n_pictures: usize) -> Result<Self> {
        let camera = sized(camera(world), args.height);
        let folder = args.out.join(&world.scene.name);
        std::fs::create_dir_all(&folder).with_context(|| format!("creating {}", folder.display()))?;
        let mode = args.run.map_or_else(String::new, |mode| format!("-{}", mode.name()));
        let colour = format!("{:?}", args.colour).to_lowercase();
        let stem = folder.join(format!("view{mode}-{colour}"));
        let video = match args.video {
            Some(fps) => {
                let fps = if fps > 0.0 { fps } else { world.scene.fps };
                let path = stem.with_extension("mp4");
                Some((Video::create(&path, camera.width, camera.height, fps)?, path))
            }
            None => None,
        };
        let bar = bars.bar("pictures", n_pictures as u64);
        Ok(Self { stem, each: args.each, video, n_pictures, n_done: 0, sheet: Vec::new(), bar })
    }

    fn push(&mut self, image: Image) -> Result<()> {
        if let Some((video, _)) = &mut self.video {
            video.push(&image)?;
        }
        if self.each && self.n_pictures > 1 {
            let name = format!("{}-{:04}.png", self.stem.display(), self.n_done);
            image.write_png(name.as_ref())?;
        }
        if self.n_done == on_sheet(self.sheet.len(), self.n_pictures) {
            self.sheet.push(image);
        }
        self.n_done += 1;
        self.bar.inc(1);
        Ok(())
    }

    fn finish(self, adapter: &str) -> Result<()> {
        self.bar.finish_and_clear();
        let columns = (self.sheet.len() as f64).sqrt().ceil() as usize;
        let path = self.stem.with_extension("png");
        contact_sheet(&self.sheet, columns).write_png(&path)?;
        println!("{} pictures by {adapter}: {}", self.n_done, path.display());
        if let Some((video, path)) = self.video {
            video.finish()?;
            println!("video: {}", path.display());
        }
        Ok(())
    }
}

/// Number of the picture at place `k` of the sheet: the first, the last, and as many evenly between as there is room for.
fn on_sheet(k: usize, n_pictures: usize) -> usize {
    let room = ON_SHEET.min(n_pictures);
    if room > 1 { k * (n_pictures - 1) / (room - 1) } else { k }
}

/// Depth of each particle in whatever solid it is deepest in, cm.
fn depths(world: &World, frame: &Frame) -> Vec<f32> {
    let mut solids = world.moving_solids(frame.t, 0.0);
    solids.push(world.moving_head(frame.t, 0.0));
    let deepest = |p: &[f32; 3]| {
        let point = Vector3::from(*p).cast();
        solids.iter().map(|solid| -solid.distance_at_end(point)).fold(f32::NEG_INFINITY, f32::max)
    };
    frame.positions.iter().map(deepest).collect()
}

fn draw(
    renderer: &mut RenderProcess,
    world: &World,
    frame: &Frame,
    depths: &[f32],
    camera: Camera,
    args: &Args,
) -> Result<Image> {
    let colour = match args.colour {
        Colour::Brown => ColourBy::Hair(BROWN),
        Colour::Blonde => ColourBy::Hair(BLONDE),
        Colour::Red => ColourBy::Hair([0.28, 0.075, 0.022]),
        Colour::Black => ColourBy::Hair([0.016, 0.012, 0.010]),
        Colour::Guide => ColourBy::Guide(&frame.guides),
        Colour::Weight => ColourBy::Weight(&frame.weights),
        Colour::Penetration => ColourBy::Penetration { depths, worst_cm: args.worst },
        Colour::Velocity => ColourBy::Velocity { speeds: &frame.speeds, fastest: args.fastest },
    };
    let mut scene = Scene { supersampling: args.supersampling, ..Scene::new(camera) };
    let mut strands = Strands::new(&frame.positions, world.groom.n_particles, colour);
    // What is inside a solid is to be seen where it is.
    if args.through || args.colour == Colour::Penetration {
        strands.curve = Curve::Through;
    }
    scene.strands.push(strands);
    // Skin would pass for one of the colours of a measure.
    let of_solids = if matches!(colour, ColourBy::Hair(_)) { [SKIN, HORN] } else { [[0.16, 0.17, 0.19]; 2] };
    scene.solids = solids(world, frame.t, of_solids);
    Ok(renderer.picture(&scene)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sheet_holds_the_first_and_the_last_and_no_picture_twice() {
        for n_pictures in 1..200 {
            let chosen: Vec<usize> = (0..ON_SHEET.min(n_pictures)).map(|k| on_sheet(k, n_pictures)).collect();
            assert_eq!((chosen[0], chosen[chosen.len() - 1]), (0, n_pictures - 1));
            assert!(chosen.windows(2).all(|pair| pair[0] < pair[1]), "{n_pictures}: {chosen:?}");
            // What comes after the last has no place: the sheet is full.
            assert!(on_sheet(chosen.len(), n_pictures) >= n_pictures);
        }
    }
}
