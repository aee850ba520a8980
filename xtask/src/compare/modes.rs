//! `xtask compare SCENE`: one scene in several modes, one table.

use super::Args;
use crate::pipeline::{describe, load_scene, prepare, reference};
use crate::progress::Bars;
use crate::report::{print_table, run_json, write_beside};
use anyhow::Result;
use hair_bench::run::{Mode, run as run_mode};
use serde_json::Value;

/// Runs the scene.
///
/// # Errors
/// A scene that cannot be made or run, a file that cannot be written.
pub fn run(args: &Args, scene: &str) -> Result<()> {
    let bars = Bars::new();
    let prepared = prepare(load_scene(scene, None)?, &args.out, &bars)?;
    let world = prepared.world();
    println!("{}: {}", world.scene.name, describe(world));
    let reference = reference(&prepared, true, &bars)?;
    let modes = if args.modes.is_empty() { Mode::ALL.to_vec() } else { args.modes.clone() };
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
