//! `--check` and `--write-baseline`: measures held to those of an earlier version, `docs/benchmarks/baseline-<size>.json`.

use super::Args;
use crate::report::write_beside;
use crate::workspace_root;
use anyhow::{Context, Result, ensure};
use hair_bench::baseline::{Baseline, Change, told};
use hair_bench::evidence::{Measure, Size};
use hair_bench::report::{Report, counted};
use std::path::PathBuf;

fn path(size: Size) -> PathBuf {
    let name = match size {
        Size::Smoke => "smoke",
        Size::Quick => "quick",
        Size::Full => "full",
    };
    workspace_root().join("docs/benchmarks").join(format!("baseline-{name}.json"))
}

fn read(size: Size) -> Result<Baseline> {
    let path = path(size);
    let text = std::fs::read_to_string(&path)
        .with_context(|| format!("reading the baseline {}; --write-baseline makes one", path.display()))?;
    serde_json::from_str(&text).with_context(|| format!("reading the baseline {}", path.display()))
}

/// Compares with the baseline, or writes it, as asked.
///
/// # Errors
/// A measure that got worse; a baseline that cannot be read or written.
pub fn baseline(args: &Args, report: &Report) -> Result<()> {
    let size = args.size();
    let measured: Vec<(&str, &[Measure])> =
        report.sections.iter().filter_map(|s| Some((s.name.as_str(), &s.findings()?.measures[..]))).collect();
    if args.write_baseline {
        ensure!(report.failed().next().is_none(), "no baseline is made of a run in which experiments broke off");
        // What was not run keeps its baseline.
        let keeps = !args.only.is_empty() && path(size).exists();
        let mut baseline = if keeps { read(size)? } else { Baseline::of(size, []) };
        baseline.take(measured.iter().copied());
        let mut text = serde_json::to_string_pretty(&baseline)?;
        text.push('\n');
        write_beside(&path(size), text.as_bytes())?;
        println!("baseline: {}", path(size).display());
    }
    if args.check {
        let compared = read(size)?.compare(measured);
        print!("{}", told(&compared));
        let worse = compared.iter().filter(|c| c.change == Change::Worse).count();
        ensure!(worse == 0, "{} worse than before by more than the slack allowed", counted(worse, "measure"));
    }
    Ok(())
}
