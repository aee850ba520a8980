//! `xtask train`: a skinning model for a groom or scene.

use crate::pipeline::{describe, held_out_error, load_scene, prepare};
use crate::progress::Bars;
use crate::report::write_beside;
use anyhow::Result;
use serde_json::json;
use skinning_train::TrainReport;
use std::path::PathBuf;

/// Options of `xtask train`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A scene (.toml), a groom (.hair, .tfx, .data, .ply; needs --unit), or a built-in scene: salon.
    input: String,
    /// Length unit of a bare groom file: m, cm, mm, in, or centimetres per unit. No default: units are never guessed.
    #[arg(long)]
    unit: Option<String>,
    /// Where to copy the model; by default it stays in the cache only.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Folder of results and cache.
    #[arg(long, default_value = "out")]
    out: PathBuf,
    /// Worker threads; 0 uses all cores. The result does not depend on it.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Also write the figures to this file.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    crate::pipeline::use_threads(args.threads)?;
    let bars = Bars::new();
    let prepared = prepare(load_scene(&args.input, args.unit.as_deref())?, &args.out, &bars)?;
    let model = &prepared.model;
    println!("{}", describe(&prepared.world));
    println!("model {:016x}: {} guides, {} sets kept", model.provenance, model.n_guides(), model.set_mask.len());
    let mut figures = json!({
        "provenance": format!("{:016x}", model.provenance),
        "n_strands": model.n_strands,
        "n_particles": model.n_particles,
        "n_guides": model.n_guides(),
        "sets": model.set_mask.len(),
        "max_distance": model.max_distance,
    });
    match &prepared.report {
        None => println!("taken from the cache"),
        Some(report) => {
            for (stage, seconds) in &report.stage_seconds {
                println!("  {stage:<20} {seconds:>8.2} s");
            }
            print_report(report);
            figures["stages"] = report.stage_seconds.iter().map(|(n, s)| ((*n).to_owned(), json!(s))).collect();
            figures["fit_cm"] = json!(report.fit.quadratic_cm);
            figures["fit_linear_cm"] = json!(report.fit.linear_cm);
            figures["mean_eligible"] = json!(report.mean_eligible);
            figures["mean_kept_sets"] = json!(report.mean_kept_sets);
            figures["lost_energy"] = json!(report.lost_energy);
        }
    }
    if let Some(error) = held_out_error(&prepared, &bars)? {
        println!(
            "held-out head motion, guides replayed: error {:.2} % of hair length; rigid hair {:.2} %",
            error.all, error.rigid
        );
        figures["held_out_error_pct"] = json!(error.all);
        figures["held_out_rigid_error_pct"] = json!(error.rigid);
    }
    if let Some(path) = &args.model {
        model.save(path)?;
        println!("written to {}", path.display());
    }
    if let Some(path) = &args.json {
        write_beside(path, serde_json::to_string_pretty(&figures)?.as_bytes())?;
    }
    Ok(())
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
