//! The orchestrator: every command of the project, one file each.
//!
//! Commands print what they did to standard output and progress to standard error; a failure prints the chain of its
//! causes and exits with code 1. What the libraries log is shown on standard error as `RUST_LOG` asks.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program talks to whoever runs it")]

mod bench;
mod ci;
mod compare;
mod convert;
mod painter;
mod paper_map;
mod pipeline;
mod presets;
mod progress;
mod recording;
mod report;
mod run_scene;
mod tidy;
mod train;
mod view;

use clap::{Parser, Subcommand};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use tracing_subscriber::EnvFilter;

/// Adaptive hair skinning: train a model of a head of hair, run it in a scene, compare what comes out.
///
/// Lengths are centimetres, masses grams, times seconds, angles degrees unless an option says otherwise. What a file holds
/// in other units is converted when it is read; its unit is stated, never guessed. `RUST_LOG` (default `warn`) sets what is
/// logged to standard error.
#[derive(Parser)]
#[command(name = "cargo xtask", version, about, long_about)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Train a skinning model for a groom or a scene.
    Train(train::Args),
    /// Run a scene: train if need be, simulate, measure, write pictures and an animation cache.
    RunScene(run_scene::Args),
    /// What the papers claim beside what the program does, as a report; or one scene in several modes, side by side.
    Compare(compare::Args),
    /// Measure parts on their own.
    Bench(bench::Args),
    /// Pictures of a scene by a graphics driver, that of a card or Mesa's: still, around, or as it moves.
    View(view::Args),
    /// Convert a groom to .hair, or a mesh to .obj.
    Convert(convert::Args),
    /// Check everything: format, lints, tests, docs, licences, tidiness, paper map.
    Ci(ci::Args),
    /// Check what compilers do not: file headers and sizes, dependency edges, prints in libraries, stray paths.
    Tidy,
    /// Collect where the papers' equations live into docs/PAPER_MAP.md.
    PaperMap(PaperMapArgs),
}

#[derive(clap::Args)]
struct PaperMapArgs {
    /// Write nothing; fail if the file is stale, an equation has two homes, or a required one has none.
    #[arg(long)]
    check: bool,
}

fn main() -> ExitCode {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("warn"));
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).init();
    match run(Cli::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let mut said = error.to_string();
            eprintln!("error: {said}");
            for cause in error.chain().skip(1).map(ToString::to_string) {
                // Some errors quote their cause; it is not said twice.
                if !said.ends_with(&cause) {
                    eprintln!("  caused by: {cause}");
                }
                said = cause;
            }
            ExitCode::FAILURE
        }
    }
}

fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::View(args) => view::run(&args),
        Command::Train(args) => train::run(args),
        Command::RunScene(args) => run_scene::run(args),
        Command::Compare(args) => compare::run(args),
        Command::Bench(args) => bench::run(args),
        Command::Convert(args) => convert::run(args),
        Command::Ci(args) => ci::run(&workspace_root(), args),
        Command::Tidy => run_tidy(&workspace_root()),
        Command::PaperMap(args) => run_paper_map(&workspace_root(), args.check),
    }
}

/// Where the workspace lies: the folder above this package.
fn workspace_root() -> PathBuf {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.parent().unwrap_or(package).to_path_buf()
}

fn run_tidy(root: &Path) -> anyhow::Result<()> {
    let violations = tidy::check(root)?;
    for violation in &violations {
        println!("{violation}");
    }
    anyhow::ensure!(violations.is_empty(), "tidy found {} violations", violations.len());
    println!("tidy: nothing to complain about");
    Ok(())
}

fn run_paper_map(root: &Path, check: bool) -> anyhow::Result<()> {
    let map = paper_map::collect(root)?;
    if !check {
        let path = map.write(root)?;
        println!("wrote {}", path.display());
    }
    let complaints = map.complaints(root)?;
    for complaint in &complaints {
        println!("{complaint}");
    }
    anyhow::ensure!(complaints.is_empty(), "the paper map has {} faults", complaints.len());
    if check {
        println!("paper map: {} homes, all in order", map.n_homes());
    }
    Ok(())
}
