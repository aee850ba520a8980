//! `cargo xtask ci`: all that must hold before a change is taken, in order, each step with its time.
//!
//! A step that fails does not hide the ones after it: all run, and the last line names those that failed.

use crate::{run_paper_map, run_tidy};
use anyhow::{Context, bail};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

/// Experiments whose measures are held to their baseline at every change, without pictures: what of them takes three minutes or so on
/// two cores. `xtask compare --smoke --check` does all.
const CHECKED: &str = "salon-straight,hairy-ball,hand,two-guides,correction,criteria,adaptation,guides";

/// Options of `xtask ci`.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Args {
    /// Also build and test the renderer, which takes minutes more: wgpu is the largest thing that anything here depends on.
    #[arg(long)]
    viewer: bool,
}

/// Runs every step.
///
/// # Errors
/// Names the steps that failed.
pub fn run(root: &Path, args: Args) -> anyhow::Result<()> {
    let begin = Instant::now();
    let mut failed = Vec::new();
    let mut step = |name: &'static str, work: &dyn Fn() -> anyhow::Result<()>| {
        println!("== {name}");
        let clock = Instant::now();
        let result = work();
        let seconds = clock.elapsed().as_secs_f64();
        match result {
            Ok(()) => println!("== {name}: ok, {seconds:.1} s"),
            Err(error) => {
                println!("== {name}: FAILED, {seconds:.1} s: {error:#}");
                failed.push(name);
            }
        }
    };
    step("fmt", &|| cargo(root, &["fmt", "--all", "--", "--check"], &[]));
    step("clippy", &|| {
        cargo(root, &["clippy", "--release", "--workspace", "--all-targets", "--", "-D", "warnings"], &[])
    });
    step("test", &|| cargo(root, &["test", "--release", "--workspace", "--no-fail-fast"], &[]));
    step("compare", &|| {
        let compare =
            ["compare", "--smoke", "--no-pictures", "--check", "--report", "out/ci-report", "--only", CHECKED];
        cargo(root, &[&["run", "--release", "--package", "xtask", "--"], &compare[..]].concat(), &[])
    });
    if args.viewer {
        // Without a driver its tests say that they are skipped.
        step("viewer", &|| {
            let with_driver = ["--release", "--package", "hair-viewer", "--features", "gpu"];
            cargo(root, &[&["clippy"], &with_driver[..], &["--all-targets", "--", "-D", "warnings"]].concat(), &[])?;
            cargo(root, &[&["test"], &with_driver[..], &["--no-fail-fast"]].concat(), &[])
        });
    }
    // The same profile as clippy: both need only the metadata of dependencies, which is then built once.
    step("doc", &|| cargo(root, &["doc", "--release", "--workspace", "--no-deps"], &[("RUSTDOCFLAGS", "-D warnings")]));
    step("deny", &|| deny(root));
    step("tidy", &|| run_tidy(root));
    step("paper-map", &|| run_paper_map(root, true));
    let seconds = begin.elapsed().as_secs_f64();
    if failed.is_empty() {
        println!("ci: all steps passed in {seconds:.0} s");
        Ok(())
    } else {
        bail!("ci failed after {seconds:.0} s in: {}", failed.join(", "))
    }
}

fn cargo(root: &Path, args: &[&str], environment: &[(&str, &str)]) -> anyhow::Result<()> {
    let program = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let status = Command::new(program)
        .args(args)
        .envs(environment.iter().copied())
        .current_dir(root)
        .status()
        .with_context(|| format!("starting cargo {}", args.join(" ")))?;
    anyhow::ensure!(status.success(), "cargo {} ended with {status}", args.join(" "));
    Ok(())
}

fn deny(root: &Path) -> anyhow::Result<()> {
    let found = Command::new("cargo-deny").arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    if !found.is_ok_and(|status| status.success()) {
        bail!("cargo-deny is not installed; run `cargo install cargo-deny --locked`");
    }
    // Advisories need a database from the network; licences, bans and sources do not.
    cargo(root, &["deny", "check", "licenses", "bans", "sources"], &[])
}
