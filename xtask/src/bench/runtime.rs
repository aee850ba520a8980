//! `xtask bench runtime`: what the runtime costs on whole heads, and what it is worth: the salon at full size, a full step beside a
//! copy, AS16 Table 2, scaling, combs and a ball swept through a head, and what happens in the long run.
//!
//! One model serves most parts: that of `train salon-full --preset bench`. Its first hairs are smaller heads, copies of them
//! larger ones.

use crate::painter::{Painter, camera};
use crate::pipeline::{Workshop, load_scene, prepare, use_threads};
use crate::presets::Preset;
use crate::progress::Bars;
use crate::report::write_beside;
use anyhow::{Context, Result, ensure};
use hair_bench::chart::{Curve, draw};
use hair_bench::picture::contact_sheet;
use hair_bench::run::read_positions;
use hair_bench::runtime_bench::quality::{FullRun, full_run, measure, rows};
use hair_bench::runtime_bench::{Figure, Subject, cost, resized, situations};
use hair_bench::training_motions::held_out_motion;
use hair_bench::world::World;
use io_formats::scene::{GroomSource, Scene};
use io_formats::skinning_model::SkinningModel;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Options of `xtask bench runtime`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Also write the figures to this file.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Only these parts: salon, copy, tail, combs, sphere (the default: what a full head does within minutes), tables, scaling,
    /// errors, recovery, criteria, endurance, pictures.
    #[arg(long, value_delimiter = ',')]
    only: Vec<String>,
    /// A model of the scene salon-full, however trained, instead of one trained for benchmarks.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Hairs of the head: the first of the trained model's 150,000, or copies of them.
    #[arg(long)]
    hairs: Option<usize>,
    /// Hairs whose share inside solids is counted.
    #[arg(long, default_value_t = 10_000)]
    measured: usize,
    /// Hairs simulated one by one beside them, for standoff, flicker and error.
    #[arg(long, default_value_t = 2_000)]
    reference: usize,
    /// Minutes of salon in the part `endurance`.
    #[arg(long, default_value_t = 10.0)]
    minutes: f64,
    /// Folder of results and cache.
    #[arg(long, default_value = "out")]
    out: PathBuf,
    /// Draw cost over hairs and guides, and the pictures, into this folder.
    #[arg(long)]
    plot: Option<PathBuf>,
    /// Worker threads; 0 uses all cores.
    #[arg(long, default_value_t = 0)]
    threads: usize,
}

const PARTS: [&str; 12] = [
    "salon",
    "copy",
    "tail",
    "combs",
    "sphere",
    "tables",
    "scaling",
    "errors",
    "recovery",
    "criteria",
    "endurance",
    "pictures",
];
/// Those that a full head does within minutes.
const DEFAULT_PARTS: usize = 5;

/// While the comb of the salon is in the hair, s.
const IN_HAIR_S: [f64; 2] = [0.8, 1.2];
/// Rounds of the salon that the tail of step times is taken over.
const TAIL_ROUNDS: usize = 4;
/// Full-space steps timed beside each scene of AS16 Table 2.
const FULL_STEPS: usize = 2;
/// Hairs of the parts that compare many ways to skin.
const COMPARED_HAIRS: usize = 20_000;
/// Seconds the salon goes on after the comb has left, where guides are watched on their way back.
const AFTER_S: f64 = 2.5;

/// What is at hand while parts run.
struct Bench<'a> {
    args: &'a Args,
    bars: &'a Bars,
    figures: Map<String, Value>,
    sizes: Map<String, Value>,
}

impl Bench<'_> {
    fn take(&mut self, rows: Vec<Figure>) {
        for Figure { name, unit, value, of } in rows {
            let shown = value.map_or_else(|| "-".to_owned(), |v| format!("{v:.4}"));
            println!("{name:<44} {shown:>12} {unit:<12} {of}");
            self.figures.insert(name.clone(), json!(value));
            self.sizes.insert(name, json!(of));
        }
    }

    fn steps(&self, name: &str, steps: usize) -> impl FnMut(usize) + use<> {
        let bar = self.bars.bar(name, steps as u64);
        move |step| {
            bar.set_position(step as u64);
            if step == steps {
                bar.finish_and_clear();
            }
        }
    }
}

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    use_threads(args.threads)?;
    for part in &args.only {
        ensure!(PARTS.contains(&part.as_str()), "there is no part {part}; the parts are {}", PARTS.join(", "));
    }
    let wanted = |name: &str| {
        let by_default = args.only.is_empty() && PARTS[..DEFAULT_PARTS].contains(&name);
        by_default || args.only.iter().any(|only| only == name)
    };
    let bars = Bars::new();
    let mut bench = Bench { args: &args, bars: &bars, figures: Map::new(), sizes: Map::new() };
    let salon = match &args.model {
        Some(path) => {
            let world = Workshop::open(load_scene("salon-full", None)?, &args.out, &bars)?.world;
            let model = SkinningModel::load(path).with_context(|| format!("the model {}", path.display()))?;
            ensure!(
                (model.n_strands as usize, model.n_particles as usize)
                    == (world.groom.n_strands, world.groom.n_particles),
                "{} has {} x {} strands, salon-full {} x {}; train it with `xtask train salon-full`",
                path.display(),
                model.n_strands,
                model.n_particles,
                world.groom.n_strands,
                world.groom.n_particles
            );
            Head { world, model }
        }
        None => Head::of("salon-full", &args.out, &bars)?,
    };
    let world = &salon.world;
    let of_size;
    let model = match args.hairs.filter(|&n| n != salon.model.n_strands as usize) {
        Some(n) => {
            of_size = resized(&salon.model, n, 1)?;
            &of_size
        }
        None => &salon.model,
    };
    let params = adaptive_runtime::RuntimeParams::adaptive();
    let subject = Subject { world, model, params };
    let n_steps = world.n_steps();
    if wanted("salon") {
        let rows = cost::salon(&subject, bench.steps("salon", n_steps))?;
        bench.take(rows);
    }
    if wanted("copy") {
        let steps = (IN_HAIR_S[1] / subject.dt()).round() as usize;
        let rows = cost::copy(&subject, IN_HAIR_S[0], IN_HAIR_S[1], bench.steps("beside a copy", steps))?;
        bench.take(rows);
    }
    if wanted("tail") {
        let rows = cost::tail(&subject, TAIL_ROUNDS, bench.steps("tail", TAIL_ROUNDS * n_steps))?;
        bench.take(rows);
    }
    if wanted("combs") {
        for (name, scene) in [
            ("comb", "salon-full"),
            ("comb_fine", "comb-fine"),
            ("comb_coarse", "comb-coarse"),
            ("comb_fast", "comb-fast"),
        ] {
            swept(&mut bench, &subject, name, scene)?;
        }
        let standoff = bench.figures.get("standoff_over_full_cm_comb").cloned().unwrap_or_default();
        bench.figures.insert("standoff_over_full_cm".to_owned(), standoff);
    }
    if wanted("sphere") {
        swept(&mut bench, &subject, "sphere", "sphere-sweep")?;
    }
    if wanted("tables") {
        tables(&mut bench, &salon)?;
    }
    if wanted("scaling") {
        scaling(&mut bench, &salon)?;
    }
    let few = resized(&salon.model, COMPARED_HAIRS.min(model.n_strands as usize), 1)?;
    let few = Subject { model: &few, ..subject };
    if wanted("errors") {
        errors(&mut bench, &few)?;
    }
    if wanted("recovery") {
        let mut scene = world.scene.clone();
        scene.seconds += AFTER_S;
        let longer = world.staged(scene, None)?;
        let subject = Subject { world: &longer, ..few };
        let rows = situations::recovery(&subject, args.measured, bench.steps("recovery", longer.n_steps()))?;
        bench.take(rows);
    }
    if wanted("criteria") {
        for (name, scene) in [("rod", "fig6-rod"), ("lift", "fig6-lift")] {
            compare(&mut bench, &few, name, world.staged(load_scene(scene, None)?, None)?, &situations::criteria())?;
        }
    }
    if wanted("endurance") {
        let seconds = 60.0 * args.minutes;
        let steps = (seconds / subject.dt()).round() as usize;
        let rows = situations::endurance(&subject, seconds, bench.steps("endurance", steps.max(3 * n_steps)))?;
        bench.take(rows);
    }
    if wanted("pictures") {
        pictures(&mut bench, &subject)?;
    }
    if let Some(path) = &args.json {
        bench.figures.insert("measured_on".to_owned(), Value::Object(bench.sizes));
        write_beside(path, &serde_json::to_vec_pretty(&Value::Object(bench.figures))?)?;
    }
    Ok(())
}

/// A world and its model.
struct Head {
    world: World,
    model: SkinningModel,
}

impl Head {
    /// Those of a built-in scene, trained no more than benchmarks need.
    fn of(scene: &str, out: &Path, bars: &Bars) -> Result<Self> {
        let mut scene = load_scene(scene, None)?;
        Preset::Bench.apply(&mut scene);
        Self::trained(scene, out, bars)
    }

    fn trained(scene: Scene, out: &Path, bars: &Bars) -> Result<Self> {
        let prepared = prepare(scene, out, bars)?;
        Ok(Self { world: prepared.workshop.world, model: prepared.model })
    }
}

/// One solid of one scene swept through the head.
fn swept(bench: &mut Bench, subject: &Subject, name: &str, scene: &str) -> Result<()> {
    let world = subject.world.staged(load_scene(scene, None)?, None)?;
    let subject = Subject { world: &world, ..*subject };
    let against = beside(bench, &subject, name)?;
    let quality = measure(&subject, &against, bench.steps(name, world.n_steps()))?;
    bench.take(rows(name, &subject, &against, &quality));
    Ok(())
}

fn beside(bench: &Bench, subject: &Subject, name: &str) -> Result<FullRun> {
    let progress = bench.steps(&format!("{name}, full space"), subject.world.n_steps());
    Ok(full_run(subject, bench.args.measured, bench.args.reference, progress)?)
}

/// Several ways to skin in one situation.
fn compare(
    bench: &mut Bench,
    subject: &Subject,
    name: &str,
    world: World,
    ways: &[(String, adaptive_runtime::RuntimeParams)],
) -> Result<()> {
    let subject = Subject { world: &world, ..*subject };
    let against = beside(bench, &subject, name)?;
    let rows = situations::compared(name, &subject, ways, &against, bench.steps(name, ways.len()))?;
    bench.take(rows);
    Ok(())
}

/// Ways to skin on head motion that nothing was trained on, without solids, and among solids.
fn errors(bench: &mut Bench, few: &Subject) -> Result<()> {
    const SECONDS: f64 = 2.0;
    let ways = situations::ways();
    let mut scene: Scene = few.world.scene.clone();
    scene.solids.clear();
    scene.seconds = SECONDS;
    let mut moved = few.world.staged(scene, None)?;
    moved.head_motion = held_out_motion(&few.world.scene, SECONDS);
    compare(bench, few, "held_out", moved, &ways)?;
    for (name, scene) in [("comb", "salon-full"), ("sphere", "sphere-sweep")] {
        compare(bench, few, name, few.world.staged(load_scene(scene, None)?, None)?, &ways)?;
    }
    Ok(())
}

/// The scenes of AS16 Table 2.
fn tables(bench: &mut Bench, salon: &Head) -> Result<()> {
    let (out, bars) = (bench.args.out.clone(), bench.bars);
    let paper = |step_ms, full_s: f64, memory_mb| cost::PaperRow { step_ms, full_ms: 1e3 * full_s, memory_mb };
    let mut row = |world: &World, model: &SkinningModel, paper| -> Result<()> {
        let subject = Subject { world, model, params: adaptive_runtime::RuntimeParams::adaptive() };
        let rows = cost::table_row(&subject, paper, FULL_STEPS, bench.steps(&world.scene.name, world.n_steps()))?;
        bench.take(rows);
        Ok(())
    };
    row(&salon.world, &salon.model, paper(50.0, 60.0, 400.0))?;
    for (scene, paper) in [("gears", paper(46.0, 20.0, 120.0)), ("hairy-ball", paper(32.0, 15.0, 80.0))] {
        let head = Head::of(scene, &out, bars)?;
        row(&head.world, &head.model, paper)?;
    }
    Ok(())
}

/// Cost over hairs and guides.
fn scaling(bench: &mut Bench, salon: &Head) -> Result<()> {
    const HAIRS: [usize; 7] = [10_000, 20_000, 50_000, 100_000, 150_000, 300_000, 600_000];
    const GUIDES: [usize; 6] = [50, 100, 200, 400, 800, 1_600];
    let params = adaptive_runtime::RuntimeParams::adaptive();
    let subject = Subject { world: &salon.world, model: &salon.model, params };
    let [from, to] = IN_HAIR_S;
    let progress = bench.steps("over hairs", HAIRS.len());
    let (rows, curves) = cost::over_hairs(&subject, &HAIRS, from, to, progress)?;
    bench.take(rows);
    plot(bench, "hairs", &curves)?;
    let mut models = Vec::new();
    for guides in GUIDES {
        let mut scene = load_scene("salon-full", None)?;
        Preset::Bench.apply(&mut scene);
        if let GroomSource::Generated(groom) = &mut scene.groom.source {
            groom.strands = COMPARED_HAIRS;
        }
        scene.groom.guides = guides;
        models.push(Head::trained(scene, &bench.args.out, bench.bars)?.model);
    }
    let (rows, curves) = cost::over_guides(&salon.world, params, &models, from, to)?;
    bench.take(rows);
    plot(bench, "guides", &curves)
}

fn plot(bench: &Bench, over: &str, curves: &[Curve]) -> Result<()> {
    let Some(folder) = &bench.args.plot else { return Ok(()) };
    std::fs::create_dir_all(folder).with_context(|| format!("creating {}", folder.display()))?;
    draw(&format!("cpu over {over}"), over, "ms", curves).write_png(&folder.join(format!("cost-over-{over}.png")))?;
    Ok(())
}

/// Every scene of this head at three moments.
fn pictures(bench: &mut Bench, subject: &Subject) -> Result<()> {
    const SCENES: [&str; 7] =
        ["salon-full", "comb-fine", "comb-coarse", "comb-fast", "sphere-sweep", "fig6-rod", "fig6-lift"];
    /// Shares of a scene.
    const MOMENTS: [f64; 3] = [0.25, 0.5, 0.9];
    let folder = bench.args.plot.clone().unwrap_or_else(|| bench.args.out.clone());
    std::fs::create_dir_all(&folder).with_context(|| format!("creating {}", folder.display()))?;
    let mut painter = Painter::best(bench.bars);
    if let Some(note) = painter.note() {
        println!("{note}");
    }
    for name in SCENES {
        let world = subject.world.staged(load_scene(name, None)?, None)?;
        let subject = Subject { world: &world, ..*subject };
        let (mut runtime, n_steps) = (subject.runtime()?, world.n_steps());
        let mut progress = bench.steps(name, n_steps);
        let at = MOMENTS.map(|share| (share * n_steps as f64).round() as usize);
        let mut images = Vec::new();
        for step in 1..=n_steps {
            let t = step as f64 * subject.dt();
            subject.step_to(&mut runtime, t);
            if at.contains(&step) {
                images.push(painter.picture(&world, t, read_positions(&mut runtime), None, camera(&world))?);
            }
            progress(step);
        }
        let path = folder.join(format!("{name}.png"));
        contact_sheet(&images, images.len()).write_png(&path)?;
        println!("pictures: {}", path.display());
    }
    Ok(())
}
