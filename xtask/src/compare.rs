//! `xtask compare`: what the papers claim beside what the program does, as a report; or one scene in several modes, as a table.
//!
//! Experiments run one by one; what each finds is kept (`kept.rs`) under a hash of the program and all it reads, so that a killed
//! run goes on where it was and a changed program shows no old figures. One that fails does not keep the others from running.

mod about;
mod check;
mod kept;
mod modes;
mod place;
mod running;
mod writing;

use crate::pipeline::use_threads;
use crate::progress::Bars;
use anyhow::{Result, bail, ensure};
use hair_bench::evidence::{Experiment, Size};
use hair_bench::experiments;
use hair_bench::report::{Outcome, Report, duration_words, verdict_words};
use hair_bench::run::Mode;
use std::path::PathBuf;

/// Options of `xtask compare`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A scene (.toml; see docs/SCENE.md) or a built-in one (salon) to run in several modes; without it, the report of all
    /// experiments.
    scene: Option<String>,
    /// Smaller heads than the papers', under ten minutes on two cores; the default.
    #[arg(long, conflicts_with_all = ["full", "smoke", "scene"])]
    quick: bool,
    /// The papers' numbers of hairs and guides; the first time with an hour of training.
    #[arg(long, conflicts_with_all = ["smoke", "scene"])]
    full: bool,
    /// Small heads: what every change is checked with.
    #[arg(long, conflicts_with = "scene")]
    smoke: bool,
    /// Only these experiments.
    #[arg(long, value_delimiter = ',', value_name = "NAME", conflicts_with = "scene")]
    only: Vec<String>,
    /// Print the experiments' names, and end.
    #[arg(long, conflicts_with = "scene")]
    list: bool,
    /// Show what an earlier version of the program found, here or in the report that is written over, rather than run again; the
    /// report says which version.
    #[arg(long, conflicts_with = "scene")]
    keep: bool,
    /// Run experiments again though nothing has changed.
    #[arg(long, conflicts_with_all = ["keep", "scene"])]
    fresh: bool,
    /// Draw no pictures.
    #[arg(long, conflicts_with = "scene")]
    no_pictures: bool,
    /// Draw pictures by the plain rasteriser built in, rather than by a graphics driver where there is one.
    #[arg(long, conflicts_with = "scene")]
    plain: bool,
    /// Leave pictures beside the page instead of within it: half the bytes where both are kept.
    #[arg(long, conflicts_with = "scene")]
    beside: bool,
    /// Fail if a measure is worse than its baseline, docs/benchmarks/baseline-smoke.json (of --smoke) or its like.
    #[arg(long, conflicts_with = "scene")]
    check: bool,
    /// Make what was measured the new baseline.
    #[arg(long, conflicts_with_all = ["check", "scene"])]
    write_baseline: bool,
    /// Folder of the report: report.html, report.md, report.json, its pictures and plots.
    #[arg(long, default_value = "out/report", conflicts_with = "scene")]
    report: PathBuf,
    /// Modes to run, in order; all by default. With a scene.
    #[arg(long, value_delimiter = ',', requires = "scene")]
    modes: Vec<Mode>,
    /// Also write the figures of all modes to this file. With a scene.
    #[arg(long, requires = "scene")]
    json: Option<PathBuf>,
    /// Worker threads; 0 uses all cores. No result but time depends on it.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Folder of results and cache.
    #[arg(long, default_value = "out")]
    out: PathBuf,
}

impl Args {
    fn size(&self) -> Size {
        if self.full {
            Size::Full
        } else if self.smoke {
            Size::Smoke
        } else {
            Size::Quick
        }
    }
}

/// Runs the command.
///
/// # Errors
/// An experiment that failed, a measure worse than its baseline, a scene or file that cannot be used.
pub fn run(args: Args) -> Result<()> {
    if args.list {
        for experiment in experiments::all() {
            println!("{:<20} {} ({})", experiment.name, experiment.title, experiment.source);
        }
        return Ok(());
    }
    use_threads(args.threads)?;
    match &args.scene {
        Some(scene) => modes::run(&args, scene),
        None => evidence(&args),
    }
}

fn evidence(args: &Args) -> Result<()> {
    let chosen = choose(experiments::all(), &args.only)?;
    let bars = Bars::new();
    let program = about::program()?;
    let pictures = if args.no_pictures { place::Pictures::None } else { place::Pictures::Best { plain: args.plain } };
    let place = place::Workplace::new(args.size(), &args.out, pictures, &bars);
    let store = kept::Store::open(&args.out, args.size(), &program, args.no_pictures)?.with_report(&args.report);
    let how = running::How { keep: args.keep, fresh: args.fresh };
    let ran = running::all(&chosen, &place, &store, how, &bars)?;
    let (sections, folders): (Vec<_>, Vec<_>) = ran.into_iter().map(|r| (r.section, r.folder)).unzip();
    let report = Report { about: about::about(args.size(), &program, place.notes()), sections };
    let within = if args.beside { 0 } else { writing::WITHIN };
    writing::write(&report, &folders, &args.report, within)?;
    tell(&report);
    println!("report: {}", args.report.join("report.html").display());
    let verdict = check::baseline(args, &report);
    let failed: Vec<&str> = report.failed().map(|(section, _)| section.name.as_str()).collect();
    if !failed.is_empty() {
        verdict.err().iter().for_each(|e| eprintln!("{e:#}"));
        bail!("experiments broke off: {}", failed.join(", "));
    }
    verdict
}

/// The experiments of these names, in their own order; all without names.
fn choose(all: Vec<Experiment>, only: &[String]) -> Result<Vec<Experiment>> {
    for name in only {
        let known = || all.iter().map(|e| e.name).collect::<Vec<_>>().join(", ");
        ensure!(all.iter().any(|e| e.name == name), "there is no experiment {name}; there are {}", known());
    }
    Ok(all.into_iter().filter(|e| only.is_empty() || only.iter().any(|name| name == e.name)).collect())
}

/// Verdicts on the terminal.
fn tell(report: &Report) {
    for section in &report.sections {
        match &section.outcome {
            Outcome::Found { findings, made } => {
                println!("{} ({})", section.title, duration_words(made.seconds));
                for claim in &findings.claims {
                    println!("  {:<15} {}: {}", verdict_words(claim.verdict), claim.claim, claim.ours);
                }
            }
            Outcome::Failed { why } => println!("{}: BROKE OFF: {why}", section.title),
        }
    }
    let counts: Vec<String> = report.verdicts().iter().map(|(v, n)| format!("{n} {}", verdict_words(*v))).collect();
    println!("claims: {}", counts.join(", "));
}
