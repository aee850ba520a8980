//! `xtask run-scene`: a scene from groom to pictures, cache and measures.

use crate::painter::{Painter, camera};
use crate::pipeline::{describe, load_scene, prepare, reference, use_threads};
use crate::progress::Bars;
use crate::report::{print_stages, print_table, run_json, write_beside};
use anyhow::{Context, Result};
use hair_bench::picture::contact_sheet;
use hair_bench::run::{Mode, run as run_mode};
use hair_bench::world::World;
use io_formats::usd::{CurvesLook, UsdaTiming, UsdaWriter};
use std::path::{Path, PathBuf};

/// Options of `xtask run-scene`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A scene (.toml; see docs/SCENE.md), or a built-in one: salon.
    scene: String,
    /// How the hair is moved: adaptive (the whole method), fixed (each hair's best-trained set at all times; same guides,
    /// same guide contact, nothing else), no-two-way (hairs do not push back on guides), no-residual (no correction of
    /// single hairs near solids), paper (to the letter), full-space (every strand simulated).
    #[arg(long, default_value = "adaptive")]
    mode: Mode,
    /// Worker threads; 0 uses all cores. The result does not depend on it.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Folder of results and cache: `OUT/<scene>/<mode>.usda`, `.png` and `.json`, and OUT/cache.
    #[arg(long, default_value = "out")]
    out: PathBuf,
    /// Also write the figures to this file.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Skip the full-space run that error and flicker are measured against.
    #[arg(long)]
    no_reference: bool,
    /// Skip the animation cache.
    #[arg(long)]
    no_cache: bool,
    /// Draw pictures by the plain rasteriser built in, rather than by a graphics driver where there is one.
    #[arg(long)]
    plain: bool,
    /// Pictures on the contact sheet.
    #[arg(long, default_value_t = 9)]
    pictures: usize,
}

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    use_threads(args.threads)?;
    let bars = Bars::new();
    let prepared = prepare(load_scene(&args.scene, None)?, &args.out, &bars)?;
    let world = prepared.world();
    println!("{}: {}", world.scene.name, describe(world));
    let reference = reference(&prepared, !args.no_reference, &bars)?;
    let mode = args.mode;
    let folder = args.out.join(&world.scene.name);
    std::fs::create_dir_all(&folder).with_context(|| format!("creating {}", folder.display()))?;

    let mut frames: Vec<(f64, Vec<[f32; 3]>)> = Vec::new();
    let bar = bars.bar(mode.name(), world.n_steps() as u64);
    let result = run_mode(
        world,
        &prepared.model,
        mode,
        &reference,
        |s| bar.set_position(s as u64),
        |t, points| {
            frames.push((t, points.to_vec()));
        },
    )?;
    bar.finish_and_clear();

    let file = |extension: &str| folder.join(format!("{}.{extension}", mode.name()));
    if args.pictures > 0 {
        let mut painter = if args.plain { Painter::plain() } else { Painter::best(&bars) };
        if let Some(note) = painter.note() {
            println!("{note}");
        }
        let bar = bars.bar("pictures", args.pictures as u64);
        let last = frames.len() - 1;
        let chosen: Vec<_> = (0..args.pictures).map(|k| &frames[last * k / (args.pictures - 1).max(1)]).collect();
        let mut images = Vec::with_capacity(chosen.len());
        for (t, points) in chosen {
            images.push(painter.picture(world, *t, points, None, camera(world))?);
            bar.inc(1);
        }
        bar.finish_and_clear();
        let columns = (args.pictures as f64).sqrt().ceil() as usize;
        contact_sheet(&images, columns).write_png(&file("png"))?;
        println!("pictures: {}", file("png").display());
    }
    if !args.no_cache {
        let bar = bars.bar("cache", frames.len() as u64);
        write_cache(world, &frames, &file("usda"), |k| bar.set_position(k as u64))?;
        bar.finish_and_clear();
        println!("animation: {} (USD BasisCurves)", file("usda").display());
    }
    let rows = [(mode, result)];
    print_table(&rows, &reference);
    print_stages(&rows[0].1);
    let text = serde_json::to_string_pretty(&run_json(mode, &rows[0].1, &reference))?;
    write_beside(&file("json"), text.as_bytes())?;
    if let Some(path) = &args.json {
        write_beside(path, text.as_bytes())?;
    }
    Ok(())
}

/// Writes hair and solids over time for other software.
fn write_cache(world: &World, frames: &[(f64, Vec<[f32; 3]>)], path: &Path, progress: impl Fn(usize)) -> Result<()> {
    let timing = UsdaTiming { fps: world.scene.fps, start: 0, n_frames: frames.len() };
    let mut writer = UsdaWriter::create(path, timing)?;
    let counts = vec![world.groom.n_particles as u32; world.groom.n_strands];
    writer.write_curves("Hair", &counts, CurvesLook::brown(), |frame, points| {
        points.copy_from_slice(&frames[frame].1);
        progress(frame + 1);
        Ok(())
    })?;
    let head: Vec<_> = frames.iter().map(|(t, _)| world.world_from_head(*t)).collect();
    writer.write_mesh("Head", &world.head_mesh, &head)?;
    for (k, (solid, mesh)) in world.solids.iter().zip(&world.solid_meshes).enumerate() {
        let poses: Vec<_> = frames.iter().map(|(t, _)| world.world_from_solids(*t)[k]).collect();
        writer.write_mesh(&solid.name, mesh, &poses)?;
    }
    writer.finish()?;
    Ok(())
}
