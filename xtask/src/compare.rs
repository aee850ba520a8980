//! `xtask compare`: one scene in several modes, one table.

use crate::pipeline::{describe, load_scene, prepare, reference, use_threads};
use crate::progress::Bars;
use crate::report::{print_table, run_json, write_beside};
use anyhow::Result;
use hair_bench::run::{Mode, run as run_mode};
use serde_json::Value;
use std::path::PathBuf;

/// Options of `xtask compare`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A scene (.toml; see docs/SCENE.md), or a built-in one: salon.
    scene: String,
    /// Modes to run, in order; all by default.
    #[arg(long, value_delimiter = ',')]
    modes: Vec<Mode>,
    /// Worker threads; 0 uses all cores. The result does not depend on it.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Folder of results and cache.
    #[arg(long, default_value = "out")]
    out: PathBuf,
    /// Also write the figures of all modes to this file.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    use_threads(args.threads)?;
    let bars = Bars::new();
    let prepared = prepare(load_scene(&args.scene, None)?, &args.out, &bars)?;
    let world = prepared.world();
    println!("{}: {}", world.scene.name, describe(world));
    let reference = reference(&prepared, true, &bars)?;
    let modes = if args.modes.is_empty() { Mode::ALL.to_vec() } else { args.modes };
    let mut rows = Vec::new();
    for mode in modes {
        if let (Mode::FullSpace, Some(full)) = (mode, &reference.full) {
            rows.push((mode, full.clone()));
            continue;
        }
        let bar = bars.bar(mode.name(), world.n_steps() as u64);
        let result = run_mode(world, &prepared.model, mode, &reference, |s| bar.set_position(s as u64), |_, _| ())?;
        bar.finish_and_clear();
        rows.push((mode, result));
    }
    print_table(&rows, &reference);
    if let Some(path) = &args.json {
        let all: Vec<Value> = rows.iter().map(|(mode, run)| run_json(*mode, run, &reference)).collect();
        write_beside(path, serde_json::to_string_pretty(&all)?.as_bytes())?;
    }
    Ok(())
}
