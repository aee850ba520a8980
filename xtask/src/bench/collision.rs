//! `xtask bench collision`: what distance fields cost and how far they are off.

use crate::report::write_beside;
use anyhow::{Result, ensure};
use hair_bench::collision_bench::{Part, baking, errors, sampling};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Options of `xtask bench collision`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Also write the figures to this file.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Only this part: baking, sampling or errors.
    #[arg(long)]
    only: Option<String>,
    /// Directory of solids from elsewhere; those absent are left out.
    #[arg(long)]
    solids: Option<PathBuf>,
}

const PARTS: [(&str, Part); 3] = [("baking", baking), ("sampling", sampling), ("errors", errors)];

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    let wanted = |name: &str| args.only.as_deref().is_none_or(|only| only == name);
    ensure!(
        PARTS.iter().any(|p| wanted(p.0)),
        "there is no part {}; see --help",
        args.only.as_deref().unwrap_or_default()
    );
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/solids");
    let solids = args.solids.as_deref().unwrap_or(&beside);
    let mut figures = Map::new();
    for (_, part) in PARTS.iter().filter(|p| wanted(p.0)) {
        for (name, unit, value) in part(solids)? {
            println!("{name:<36} {value:>10.3} {unit}");
            figures.insert(name, json!(value));
        }
    }
    if let Some(path) = &args.json {
        write_beside(path, &serde_json::to_vec_pretty(&Value::Object(figures))?)?;
    }
    Ok(())
}
