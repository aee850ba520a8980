//! `xtask bench strand-sim`: the cost of the strand simulator, as ratios measured in one run and seconds of whole heads.

use crate::report::write_beside;
use anyhow::{Result, ensure};
use hair_bench::strand_bench::{Row, TABLE_2, full_head, guides, scaling, solvers, table_row};
use serde_json::{Map, Value, json};
use std::path::PathBuf;

/// Options of `xtask bench strand-sim`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Also write the figures to this file.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Only this part: full, solvers, guides, scaling or table.
    #[arg(long)]
    only: Option<String>,
}

type Part = (&'static str, fn() -> Result<Vec<Row>, hair_bench::Error>);

/// The full head comes first: the largest memory the process has had is then its own.
const PARTS: [Part; 4] = [("full", full_head), ("solvers", solvers), ("guides", guides), ("scaling", scaling)];

/// Frames timed of each row of MS08 Table 2.
const FRAMES: usize = 1;

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    let wanted = |name: &str| args.only.as_deref().is_none_or(|only| only == name);
    ensure!(
        PARTS.iter().any(|p| wanted(p.0)) || wanted("table"),
        "there is no part {}; see --help",
        args.only.as_deref().unwrap_or_default()
    );
    let mut figures = Map::new();
    for (_, part) in PARTS.iter().filter(|p| wanted(p.0)) {
        for (name, unit, value) in part()? {
            println!("{name:<36} {value:>10.3} {unit}");
            figures.insert(name.to_owned(), json!(value));
        }
    }
    if wanted("table") {
        table_2(&mut figures)?;
    }
    if let Some(path) = &args.json {
        write_beside(path, &serde_json::to_vec_pretty(&Value::Object(figures))?)?;
    }
    Ok(())
}

/// All rows of MS08 Table 2, a frame of 1/24 s with stiction, repulsion and collisions, beside the paper's.
fn table_2(figures: &mut Map<String, Value>) -> Result<()> {
    println!(
        "MS08 Table 2 (a frame)      strands      s   integrate collide stiction   paper min    links  crossing  solves"
    );
    let mut rows = Vec::new();
    for (name, strands) in TABLE_2 {
        let row = table_row(name, strands, FRAMES)?;
        let [integrate, collide, stick] = row.split.map(|d| d.as_secs_f64());
        println!(
            "{name:<22} {:>6} x {:<2} {:>8.2} {:>8.2} {:>8.2} {:>8.2} {:>10} {:>9} {:>8} {:>7.1}",
            row.strands.0,
            row.strands.1,
            row.seconds,
            integrate,
            collide,
            stick,
            row.paper_minutes,
            row.links,
            row.unresolved,
            row.coupled_iterations
        );
        rows.push(json!({
            "name": name, "strands": row.strands.0, "particles": row.strands.1, "s_per_frame": row.seconds,
            "integrate_s": integrate, "collide_s": collide, "stiction_s": stick, "paper_min_per_frame": row.paper_minutes,
            "links": row.links, "unresolved": row.unresolved, "coupled_iterations_per_step": row.coupled_iterations,
        }));
    }
    let seconds = |k: usize| rows[k]["s_per_frame"].as_f64().unwrap_or(f64::NAN);
    let ratio = seconds(0) / seconds(1);
    println!("{:<36} {ratio:>10.3} x", "interaction_10k_over_5k");
    println!("{:<36} {:>10.3} s", "long_10k_x50_s_per_frame", seconds(0));
    figures.insert("interaction_10k_over_5k".to_owned(), json!(ratio));
    figures.insert("long_10k_x50_s_per_frame".to_owned(), json!(seconds(0)));
    figures.insert("ms08_table_2".to_owned(), Value::Array(rows));
    Ok(())
}
