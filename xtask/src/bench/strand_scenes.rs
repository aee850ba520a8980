//! `xtask bench strand-scenes`: the tests of MS08 Fig. 10, 11, 13 as a table, and each as a sheet of pictures over time.

use crate::report::write_beside;
use anyhow::{Context, Result, ensure};
use hair_bench::picture::{Camera, Image, contact_sheet, render};
use hair_bench::strand_scenes::basic::BasicParams;
use hair_bench::strand_scenes::buckling::{ClampedHair, critical_twist, push_into_loop, twist};
use hair_bench::strand_scenes::crossing::pull_across;
use hair_bench::strand_scenes::curls::{Curl, drop_curls, hang_wavy, stretch_and_release};
use hair_bench::strand_scenes::tuft::{Tuft, TuftModel, shake};
use hair_bench::strand_scenes::{Film, Frame};
use hair_viewer::{BROWN, ColourBy, Strands};
use nalgebra::Vector3;
use serde::Serialize;
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};
use strand_sim::interaction::StictionParams;
use strand_sim::{InteractionParams, Material};

/// Options of `xtask bench strand-scenes`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder of the pictures, one sheet a scene.
    #[arg(long, default_value = "out/strand-scenes")]
    out: PathBuf,
    /// Also write the figures of all scenes to this file.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Only this scene: loop, twist, crossing, stretch, drop, waviness or tuft.
    #[arg(long)]
    only: Option<String>,
}

/// One way of running a scene: what it is called, its figures and what was seen.
struct Shown {
    name: &'static str,
    figures: Value,
    film: Film,
}

/// A scene: its name, its runs, how wide hair is drawn (cm) and from where (radian about y from the front).
type Scene = (&'static str, fn() -> Result<Vec<Shown>>, f32, f32);

const SCENES: [Scene; 7] = [
    ("loop", run_loop, 0.12, 0.35),
    ("twist", run_twist, 0.08, 0.35),
    ("crossing", run_crossing, 0.08, 0.5),
    ("stretch", run_stretch, 0.12, 0.0),
    ("drop", run_drop, 0.12, 0.0),
    ("waviness", run_waviness, 0.12, 0.0),
    ("tuft", run_tuft, 0.03, 0.3),
];

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    let chosen: Vec<&Scene> = SCENES.iter().filter(|s| args.only.as_deref().is_none_or(|name| name == s.0)).collect();
    ensure!(!chosen.is_empty(), "there is no scene {}; see --help", args.only.unwrap_or_default());
    std::fs::create_dir_all(&args.out).with_context(|| format!("creating {}", args.out.display()))?;
    let mut all = Map::new();
    for (name, scene, width_cm, turn) in chosen {
        let shown = scene().with_context(|| format!("running scene {name}"))?;
        let mut figures = Map::new();
        for run in &shown {
            println!("{name}, {}", run.name);
            print_figures(&run.figures);
            figures.insert(run.name.to_owned(), run.figures.clone());
        }
        all.insert((*name).to_owned(), Value::Object(figures));
        let path = args.out.join(format!("{name}.png"));
        draw(&path, &shown, *width_cm, *turn)?;
        println!("  -> {}", path.display());
    }
    if let Some(path) = &args.json {
        write_beside(path, serde_json::to_string_pretty(&all)?.as_bytes())?;
    }
    Ok(())
}

fn shown<F: Serialize>(name: &'static str, (figures, film): (F, Film)) -> Result<Shown> {
    Ok(Shown { name, figures: serde_json::to_value(figures)?, film })
}

fn run_loop() -> Result<Vec<Shown>> {
    let hair = ClampedHair::standard();
    Ok(vec![
        shown("pushed", push_into_loop(&hair, 0.7, 0.0, 0.1)?)?,
        shown("pushed and turned once", push_into_loop(&hair, 0.7, 1.0, 0.1)?)?,
    ])
}

fn run_twist() -> Result<Vec<Shown>> {
    let hair = ClampedHair { n_particles: 81, ..ClampedHair::standard() };
    let critical = critical_twist(&hair, 0.005, 0.1)?;
    Ok(vec![
        shown("ends 0.5 % nearer", (critical, Film::new(hair.n_particles)))?,
        // At a turn a second the loop still swings from its snap when it is wound on, and whips through itself.
        shown("ends 40 % nearer", twist(&hair, 0.4, 3.4, 0.5, true)?)?,
    ])
}

fn run_crossing() -> Result<Vec<Shown>> {
    let pull = |name, stiction| shown(name, pull_across(Material::straight(), stiction, 5.0)?);
    Ok(vec![pull("dry", StictionParams::dry())?, pull("without stiction", StictionParams::off())?])
}

fn run_stretch() -> Result<Vec<Shown>> {
    Ok(vec![shown("pulled to 1.6 times", stretch_and_release(&Curl::standard(), Material::curly(), 1.6)?)?])
}

fn run_drop() -> Result<Vec<Shown>> {
    Ok(vec![shown("soft, medium, stiff", drop_curls(&Curl::standard(), Material::wavy(), &[0.25, 1.0, 4.0])?)?])
}

fn run_waviness() -> Result<Vec<Shown>> {
    Ok(vec![shown("straight, wavy, evenly wavy, curly", hang_wavy(Material::curly())?)?])
}

fn run_tuft() -> Result<Vec<Shown>> {
    const SECONDS: f64 = 1.5;
    let tuft = Tuft::standard();
    let run = |name, model| shown(name, shake(&tuft, model, SECONDS)?);
    Ok(vec![
        run("basic", TuftModel::Basic(BasicParams::paper()))?,
        run("full", TuftModel::Full(None))?,
        run("full, hair meets hair", TuftModel::Full(Some(InteractionParams::dry())))?,
    ])
}

/// One figure a line; long lists are left to the JSON.
fn print_figures(figures: &Value) {
    const LONGEST_LIST: usize = 6;
    let number = |v: &Value| match v.as_f64() {
        Some(x) if v.is_f64() => format!("{x:.5}"),
        _ => v.to_string(),
    };
    for (name, value) in figures.as_object().into_iter().flatten() {
        let text = match value.as_array() {
            Some(list) if list.len() > LONGEST_LIST => format!("{} samples", list.len()),
            Some(list) => list.iter().map(number).collect::<Vec<_>>().join(" "),
            None => number(value),
        };
        println!("  {name:<24} {text}");
    }
}

/// A row of pictures for each run, all from one place, close enough to fill them.
fn draw(path: &Path, runs: &[Shown], width_cm: f32, turn: f32) -> Result<()> {
    const SIZE: usize = 320;
    const FIELD_OF_VIEW: f32 = 0.45;
    let points = || runs.iter().flat_map(|r| &r.film.frames).flat_map(|f: &Frame| &f.positions);
    let finite = || points().filter(|p| p.iter().all(|x| x.is_finite()));
    let first = finite().next().copied().unwrap_or_default();
    let (low, high) = finite().fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
    let middle = (low + high) * 0.5;
    let radius = finite().map(|p| (p - middle).norm()).fold(0.1, f64::max) as f32;
    let distance = 1.05 * radius / (0.5 * FIELD_OF_VIEW).sin();
    let camera = Camera::around(middle.cast::<f32>().into(), distance, turn, SIZE, SIZE);
    let columns = runs.iter().map(|r| r.film.frames.len()).max().unwrap_or(1);
    let mut images: Vec<Image> = Vec::new();
    for run in runs.iter().filter(|r| !r.film.frames.is_empty()) {
        for frame in &run.film.frames {
            let points: Vec<[f32; 3]> = frame.positions.iter().map(|p: &Vector3<f64>| p.cast::<f32>().into()).collect();
            let mut scene = hair_viewer::Scene::new(Camera { vertical_fov: FIELD_OF_VIEW, ..camera });
            let strands = Strands::new(&points, run.film.n_particles, ColourBy::Hair(BROWN));
            scene.strands.push(Strands { width_cm, ..strands });
            let mut image = render(&scene)?;
            image.draw_time(frame.time_s);
            images.push(image);
        }
        let blank = Image { width: SIZE, height: SIZE, rgb: vec![0; 3 * SIZE * SIZE] };
        images.resize(images.len().next_multiple_of(columns), blank);
    }
    contact_sheet(&images, columns).write_png(path).with_context(|| format!("drawing {}", path.display()))
}
