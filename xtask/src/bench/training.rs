//! `xtask bench training`: what the kernels of training cost, how far they are from a general solver, and how well weights
//! fit along the strand, and how guides by sparse coding do beside others. Sparse coding beside another
//! library: on matrices made again, over what bench/scripts/compare_spams.py kept of it.

use super::guides;
use crate::report::write_beside;
use anyhow::{Result, ensure};
use hair_bench::sparse_signals::beside_spams;
use hair_bench::strand_bench::Row;
use hair_bench::training_bench::{errors, fits, speed};
use serde_json::{Map, Value, json};
use std::path::PathBuf;

/// Options of `xtask bench training`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Also write the figures to this file.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Only this part: speed, errors, fits, spams or guides.
    #[arg(long)]
    only: Option<String>,
    /// Strands of each head that ways to select guides are compared on.
    #[arg(long, default_value_t = 5000)]
    strands: usize,
    /// Draw the held-out error over the number of guides to this PNG file.
    #[arg(long)]
    plot: Option<PathBuf>,
}

type Part = (&'static str, fn() -> Result<Vec<Row>, hair_bench::Error>);

const PARTS: [Part; 4] = [("speed", speed), ("errors", errors), ("fits", fits), ("spams", beside_spams)];

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    let wanted = |name: &str| args.only.as_deref().is_none_or(|only| only == name);
    ensure!(
        PARTS.iter().any(|p| wanted(p.0)) || wanted("guides"),
        "there is no part {}; see --help",
        args.only.as_deref().unwrap_or_default()
    );
    let mut figures = Map::new();
    for (_, part) in PARTS.iter().filter(|p| wanted(p.0)) {
        for (name, unit, value) in part()? {
            // Rates run to hundreds of millions, errors to the last bit.
            let shown = if value == 0.0 || (1e-3..1e6).contains(&value) {
                format!("{value:.3}")
            } else {
                format!("{value:.3e}")
            };
            println!("{name:<36} {shown:>12} {unit}");
            figures.insert(name.to_owned(), json!(value));
        }
    }
    if wanted("guides") {
        guides::run(args.strands, &mut figures, args.plot.as_deref())?;
    }
    if let Some(path) = &args.json {
        write_beside(path, &serde_json::to_vec_pretty(&Value::Object(figures))?)?;
    }
    Ok(())
}
