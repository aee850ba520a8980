//! `xtask bench collision`: what distance fields cost and how far they are off.

use crate::progress::{Bars, Stages};
use crate::report::write_beside;
use anyhow::{Result, ensure};
use hair_bench::collision_bench::{Row, baking, errors, sampling};
use hair_bench::collision_checks::{culling, interpolation_check};
use hair_bench::comb_sweeps::sweeps;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Options of `xtask bench collision`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Also write the figures to this file.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Only this part: baking, sampling, errors, check, sweeps or culling.
    #[arg(long)]
    only: Option<String>,
    /// Directory of solids from elsewhere; those absent are left out.
    #[arg(long)]
    solids: Option<PathBuf>,
}

/// A part is handed where solids from elsewhere lie, and a bar for its progress.
type Part = fn(&Path, &mut Stages) -> Result<Vec<Row>>;

const PARTS: [(&str, Part); 6] = [
    ("baking", |solids, _| Ok(baking(solids)?)),
    ("sampling", |solids, _| Ok(sampling(solids)?)),
    ("errors", |solids, _| Ok(errors(solids)?)),
    ("check", |_, _| Ok(owned(interpolation_check()?))),
    ("sweeps", |_, bar| Ok(owned(sweeps(&mut |done, total| bar.set("sweeps", done, total))?))),
    ("culling", |_, _| Ok(owned(culling()?))),
];

/// Rows whose names are known beforehand, beside those named after solids.
fn owned(rows: Vec<hair_bench::strand_bench::Row>) -> Vec<Row> {
    rows.into_iter().map(|(name, unit, value)| (name.to_owned(), unit, value)).collect()
}

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
    let bars = Bars::new();
    for (name, part) in PARTS.iter().filter(|p| wanted(p.0)) {
        let mut stages = bars.stages();
        stages.set(name, 0, 1);
        let rows = part(solids, &mut stages)?;
        stages.finish();
        for (name, unit, value) in rows {
            println!("{name:<36} {value:>10.3} {unit}");
            figures.insert(name, json!(value));
        }
    }
    if let Some(path) = &args.json {
        write_beside(path, &serde_json::to_vec_pretty(&Value::Object(figures))?)?;
    }
    Ok(())
}
