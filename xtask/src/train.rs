//! `xtask train`: a skinning model for a groom or scene.

use crate::pipeline::{Prepared, Workshop, describe, held_out_error, load_scene};
use crate::presets::Preset;
use crate::progress::Bars;
use crate::recording::StepSeconds;
use crate::report::write_beside;
use anyhow::{Result, bail};
use hair_bench::chart::{Curve, draw};
use hair_bench::picture::Image;
use hair_bench::run::ErrorPct;
use io_formats::StageCost;
use io_formats::scene::MotionUse;
use serde_json::{Value, json};
use skinning_train::{JudgedFit, TrainReport};
use std::ops::Range;
use std::path::PathBuf;
use std::time::Instant;

/// Options of `xtask train`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A scene (.toml), a groom (.hair, .tfx, .data, .ply; needs --unit), or a built-in scene: salon, full-head, head-20k.
    #[arg(default_value = "full-head")]
    input: String,
    /// Length unit of a bare groom file: m, cm, mm, in, or centimetres per unit. No default: units are never guessed.
    #[arg(long)]
    unit: Option<String>,
    /// How much to train, in place of what the scene says.
    #[arg(long)]
    preset: Option<Preset>,
    /// Only record the head motions of these numbers, as in 0..2 (training, validation, held out, in this order), and stop.
    /// Processes that share the folder may take other numbers at the same time.
    #[arg(long, value_parser = range, conflicts_with = "strands")]
    sequences: Option<Range<usize>>,
    /// Only solve the weights of the blocks of strands that begin in this range, as in 0..50000, and stop; what comes before
    /// is done if need be. Processes that share the folder may take other strands at the same time.
    #[arg(long, value_parser = range)]
    strands: Option<Range<usize>>,
    /// Where to copy the model; by default it stays in the cache only.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Folder of results and cache.
    #[arg(long, default_value = "out")]
    out: PathBuf,
    /// Worker threads; 0 uses all cores. The result does not depend on it.
    #[arg(long, alias = "threads", default_value_t = 0)]
    jobs: usize,
    /// Also draw the errors by number of guides to this PNG; needs a validation motion.
    #[arg(long)]
    plot: Option<PathBuf>,
    /// Also write the figures to this file.
    #[arg(long)]
    json: Option<PathBuf>,
}

fn range(text: &str) -> Result<Range<usize>, String> {
    let parsed = text.split_once("..").and_then(|(a, b)| Some(a.trim().parse().ok()?..b.trim().parse().ok()?));
    match parsed {
        Some(range) if range.start < range.end => Ok(range),
        _ => Err(format!("{text:?} is no range: write first..end, as in 0..2 for the first two")),
    }
}

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    crate::pipeline::use_threads(args.jobs)?;
    let begin = Instant::now();
    let bars = Bars::new();
    let mut scene = load_scene(&args.input, args.unit.as_deref())?;
    if let Some(preset) = args.preset {
        preset.apply(&mut scene);
    }
    let workshop = Workshop::open(scene, &args.out, &bars)?;
    if let Some(numbers) = args.sequences {
        let n = workshop.motions.len();
        if numbers.start >= n {
            bail!("--sequences {}..{}: there are {n}, counted from 0", numbers.start, numbers.end);
        }
        println!("recorded {} of {n} head motions", workshop.record(numbers)?);
        return Ok(());
    }
    if let Some(strands) = args.strands {
        let n = workshop.world.groom.n_strands;
        if strands.start >= n {
            bail!("--strands {}..{}: there are {n}, counted from 0", strands.start, strands.end);
        }
        workshop.solve(strands.clone())?;
        println!("solved the blocks of strands that begin in {}..{}", strands.start, strands.end.min(n));
        return Ok(());
    }
    if args.plot.is_some() && workshop.motions_for(MotionUse::Validation).next().is_none() {
        bail!("--plot draws errors on a validation motion, and the scene has none: set train.validation_seconds");
    }
    let prepared = workshop.train()?;
    let held_out = held_out_error(&prepared, &bars)?;
    let (by_guides, judging) = prepared.workshop.error_by_guides()?;
    let steps = step_seconds(&prepared)?;
    let load_s = {
        let clock = Instant::now();
        io_formats::SkinningModel::load(&prepared.path)?;
        clock.elapsed().as_secs_f64()
    };
    let mut costs = stage_costs(&prepared);
    if !by_guides.is_empty() {
        costs.push(("errors by guides".to_owned(), judging));
    }
    let model = &prepared.model;
    println!("{}", describe(prepared.world()));
    println!("model {:016x}: {} guides, {} sets kept", model.provenance, model.n_guides(), model.set_mask.len());
    if !prepared.trained_now {
        println!("taken from the cache");
    }
    println!(
        "{:.1} MB, loads in {load_s:.2} s; halves change no weight by more than {:.1e}",
        StageCost::bytes_of(&prepared.path) as f64 / 1e6,
        prepared.report.largest_rounding
    );
    print_costs(&costs);
    print_report(&prepared.report);
    let (with_friction, plain) = steps;
    if let Some(step) = with_friction {
        println!("a step of all strands as recorded: {:.3} s, {:.3} CPU-s", step.wall_s, step.cpu_s);
    }
    if let Some(step) = plain {
        println!("a step without friction between hairs: {:.3} s, {:.3} CPU-s", step.wall_s, step.cpu_s);
    }
    if let Some(error) = held_out {
        println!(
            "held-out head motion, guides replayed: error {:.2} % of hair length; rigid hair {:.2} %",
            error.all, error.rigid
        );
    }
    for judged in &by_guides {
        println!(
            "{:>5} guides: {:.3} cm on the frames trained on, {:.3} on validation ({} strands)",
            judged.n_guides, judged.trained_cm, judged.judged_cm, judged.n_strands
        );
    }
    let total_s = begin.elapsed().as_secs_f64();
    let peak = peak_memory_bytes();
    println!(
        "this run took {total_s:.0} s{}",
        peak.map_or(String::new(), |b| format!(" and {:.2} GB at most", b as f64 / 1e9))
    );
    if let Some(path) = &args.model {
        model.save(path)?;
        println!("written to {}", path.display());
    }
    if let Some(path) = &args.plot {
        plot(&by_guides).write_png(path)?;
    }
    if let Some(path) = &args.json {
        let mut figures = figures(&prepared, &costs, steps, held_out, total_s, peak);
        figures["model_load_seconds"] = json!(load_s);
        figures["error_by_guides"] = json!(by_guides);
        write_beside(path, serde_json::to_string_pretty(&figures)?.as_bytes())?;
    }
    Ok(())
}

fn plot(by_guides: &[JudgedFit]) -> Image {
    let curve = |name: &str, cm: fn(&JudgedFit) -> f64| Curve {
        name: name.to_owned(),
        points: by_guides.iter().map(|j| [j.n_guides as f64, cm(j)]).collect(),
    };
    let curves = [curve("validation", |j| j.judged_cm), curve("trained on", |j| j.trained_cm)];
    draw("error by number of guides", "guides", "cm rms", &curves)
}

/// Seconds per full-space step as recorded, and without friction where recorded with it.
fn step_seconds(prepared: &Prepared<'_>) -> Result<(Option<StepSeconds>, Option<StepSeconds>)> {
    let workshop = &prepared.workshop;
    let recorder = workshop.recorder();
    let recorded = recorder.seconds_per_step(workshop.motions_for(MotionUse::Train));
    let first = workshop.motions_for(MotionUse::Train).next().filter(|_| prepared.world().scene.train.friction);
    let plain = match first {
        Some(motion) => Some(recorder.seconds_per_plain_step(&recorder.settled()?, motion)?),
        None => None,
    };
    Ok((recorded, plain))
}

/// What every stage took when it was made.
pub fn stage_costs(prepared: &Prepared<'_>) -> Vec<(String, StageCost)> {
    let workshop = &prepared.workshop;
    let recorder = workshop.recorder();
    let mut costs = Vec::new();
    costs.extend(recorder.rest_cost().map(|cost| ("settle".to_owned(), cost)));
    for (name, used_for) in [
        ("frames", MotionUse::Train),
        ("validation frames", MotionUse::Validation),
        ("held-out frames", MotionUse::HeldOut),
    ] {
        let (mut sum, mut any) = (StageCost::default(), false);
        for motion in workshop.motions_for(used_for) {
            if let Some(cost) = recorder.cost(motion) {
                sum += cost;
                any = true;
            }
        }
        if any {
            costs.push((name.to_owned(), sum));
        }
    }
    costs.extend(prepared.report.stages.iter().cloned());
    costs
}

fn print_costs(costs: &[(String, StageCost)]) {
    println!("  {:<20} {:>10} {:>10} {:>10}", "stage", "seconds", "CPU-s", "MB kept");
    let mut sum = StageCost::default();
    for (stage, cost) in costs {
        println!("  {stage:<20} {:>10.2} {:>10.2} {:>10.2}", cost.wall_s, cost.cpu_s, cost.bytes as f64 / 1e6);
        sum += *cost;
    }
    println!("  {:<20} {:>10.2} {:>10.2} {:>10.2}", "all", sum.wall_s, sum.cpu_s, sum.bytes as f64 / 1e6);
}

/// The most memory this process has held, where the system says.
fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kilobytes: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kilobytes * 1024)
}

fn figures(
    prepared: &Prepared<'_>,
    costs: &[(String, StageCost)],
    (recorded, plain): (Option<StepSeconds>, Option<StepSeconds>),
    held_out: Option<ErrorPct>,
    total_s: f64,
    peak: Option<u64>,
) -> Value {
    let (model, report, scene) = (&prepared.model, &prepared.report, &prepared.world().scene);
    let stages: serde_json::Map<String, Value> = costs
        .iter()
        .map(|(n, c)| (n.clone(), json!({ "seconds": c.wall_s, "cpu_seconds": c.cpu_s, "bytes": c.bytes })))
        .collect();
    let motions: Vec<Value> = prepared
        .workshop
        .motions
        .iter()
        .map(|m| json!({ "name": m.name, "use": format!("{:?}", m.used_for), "seconds": m.seconds }))
        .collect();
    let fit = &report.fit;
    json!({
        "provenance": format!("{:016x}", model.provenance),
        "n_strands": model.n_strands,
        "n_particles": model.n_particles,
        "n_guides": model.n_guides(),
        "n_frames": report.n_frames,
        "frames_per_second": scene.train.fps,
        "friction": scene.train.friction,
        "motions": motions,
        "stages": stages,
        "stage_seconds_sum": costs.iter().map(|(_, c)| c.wall_s).sum::<f64>(),
        "stage_cpu_seconds_sum": costs.iter().map(|(_, c)| c.cpu_s).sum::<f64>(),
        "this_run_seconds": total_s,
        "trained_in_this_run": prepared.trained_now,
        "peak_memory_bytes": peak,
        "model_bytes": StageCost::bytes_of(&prepared.path),
        "step_seconds": recorded.map(|s| s.wall_s),
        "step_cpu_seconds": recorded.map(|s| s.cpu_s),
        "step_seconds_without_friction": plain.map(|s| s.wall_s),
        "step_cpu_seconds_without_friction": plain.map(|s| s.cpu_s),
        "rank": report.rank,
        "lost_energy": report.lost_energy,
        "sparse_objective": report.sparse_objective,
        "mean_eligible": report.mean_eligible,
        "mean_kept_sets": report.mean_kept_sets,
        "sets": model.set_mask.len(),
        "fit_free_cm": fit.free_cm,
        "fit_linear_cm": fit.linear_cm,
        "fit_cm": fit.quadratic_cm,
        "fit_cubic_cm": fit.cubic_cm,
        "linear_error_pct": 100.0 * fit.linear_weight / fit.free_weight,
        "quadratic_error_pct": 100.0 * fit.quadratic_weight / fit.free_weight,
        "cubic_error_pct": 100.0 * fit.cubic_weight / fit.free_weight,
        "largest_rounding": report.largest_rounding,
        "fit_chosen_blend_cm": report.compared_chosen.quadratic_cm,
        "fit_other_blend_cm": report.compared_other.quadratic_cm,
        "max_distance": model.max_distance,
        "connected": report.connected,
        "connected_paper": report.connected_paper,
        "held_out_error_pct": held_out.map(|e| e.all),
        "held_out_rigid_error_pct": held_out.map(|e| e.rigid),
    })
}

/// The figures of training that tell whether it went well.
fn print_report(report: &TrainReport) {
    let fit = &report.fit;
    println!(
        "{} frames, reduced to {} dimensions losing {:.1e} of the energy",
        report.n_frames, report.rank, report.lost_energy
    );
    println!("{:.1} eligible guides and {:.0} kept sets a strand", report.mean_eligible, report.mean_kept_sets);
    println!(
        "fit, RMS: {:.3} cm with quadratic weights, {:.3} free, {:.3} linear",
        fit.quadratic_cm, fit.free_cm, fit.linear_cm
    );
    println!(
        "on {} strands: {:.3} cm, {:.3} with the other blend",
        report.n_compared, report.compared_chosen.quadratic_cm, report.compared_other.quadratic_cm
    );
    println!(
        "delta {:.1}: {:.1} % of guide pairs connected in training ({:.1} % with the paper's constants)",
        report.max_distance,
        100.0 * report.connected,
        100.0 * report.connected_paper
    );
}
