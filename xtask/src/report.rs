//! Tables and JSON of runs.

use anyhow::{Context, Result};
use hair_bench::run::{Mode, Reference, RunResult};
use serde_json::{Value, json};
use std::path::Path;

/// Writes a file beside its place and renames it there, so that no reader sees half of one.
pub fn write_beside(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut name = path.as_os_str().to_owned();
    name.push(".tmp");
    std::fs::write(&name, bytes).with_context(|| format!("writing {}", path.display()))?;
    std::fs::rename(&name, path).with_context(|| format!("renaming to {}", path.display()))
}

fn ratio(value: f64, reference: Option<f64>) -> Option<f64> {
    reference.filter(|r| *r > 0.0).map(|r| value / r)
}

/// Flicker of a run over full space's: near median, near 99.9th percentile, all median, all 99.9th percentile.
fn flicker(run: &RunResult, reference: &Reference) -> [Option<f64>; 4] {
    let m = &run.measured;
    let full = reference.full.as_ref().map(|f| f.measured);
    [
        ratio(m.flicker_near_median_cm, full.map(|f| f.flicker_near_median_cm)),
        ratio(m.flicker_near_p999_cm, full.map(|f| f.flicker_near_p999_cm)),
        ratio(m.flicker_all_median_cm, full.map(|f| f.flicker_all_median_cm)),
        ratio(m.flicker_all_p999_cm, full.map(|f| f.flicker_all_p999_cm)),
    ]
}

/// Strands in reach of a solid, mean over the steps that have any.
fn mean_in_reach(reference: &Reference) -> f64 {
    let steps = reference.reach.iter().filter(|r| !r.is_empty());
    let (sum, count) = steps.fold((0, 0), |(sum, count), r| (sum + r.len(), count + 1));
    sum as f64 / f64::from(count.max(1))
}

/// Steps with at least so many strands in reach.
fn steps_in_reach(reference: &Reference, strands: usize) -> usize {
    reference.reach.iter().filter(|r| r.len() >= strands.max(1)).count()
}

/// Every figure of a run.
pub fn run_json(mode: Mode, run: &RunResult, reference: &Reference) -> Value {
    let m = &run.measured;
    let [near_median, near_p999, all_median, all_p999] = flicker(run, reference);
    let stages: serde_json::Map<String, Value> = run.stages.iter().map(|(name, s)| (name.clone(), json!(s))).collect();
    json!({
        "mode": mode.name(),
        "steps": run.steps,
        "sim_seconds": run.sim_seconds,
        "cpu_seconds": run.cpu_seconds,
        "wall_seconds": run.wall_seconds,
        "cpu_s_per_sim_s": run.cpu_seconds / run.sim_seconds.max(1e-9),
        "near_strands": m.near_strands,
        "mean_in_reach": mean_in_reach(reference),
        "steps_with_tenth_in_reach": steps_in_reach(reference, m.n_strands / 10),
        "near_strands_inside_pct": m.near_strands_inside_pct,
        "passed_through_pct": m.passed_through_pct,
        "max_depth_cm": m.max_depth_cm,
        "mean_standoff_cm": m.mean_standoff_cm,
        "full_space_standoff_cm": reference.full.as_ref().map(|f| f.measured.mean_standoff_cm),
        "inside_head_pct": m.inside_head_pct,
        "mean_stretch": m.mean_stretch,
        "p99_stretch": m.p99_stretch,
        "max_stretch": m.max_stretch,
        "flicker": near_median,
        "flicker_near_p999": near_p999,
        "flicker_all": all_median,
        "flicker_all_p999": all_p999,
        "flicker_near_median_cm": m.flicker_near_median_cm,
        "error_all_pct": run.error.map(|e| e.all),
        "error_near_pct": run.error.map(|e| e.near),
        "error_rigid_pct": run.error.map(|e| e.rigid),
        "mean_effective_guides": run.effective_guides_near,
        "mean_effective_guides_all": run.effective_guides_all,
        "corrected_strands": run.corrected_strands,
        "strands_in_contact": run.strands_in_contact,
        "set_changes_per_step": run.set_changes,
        "connectivity": run.connectivity,
        "nonfinite": m.nonfinite + run.quarantined,
        "state_hash": format!("{:016x}", run.state_hash),
        "stages": stages,
    })
}

/// Prints one row per run.
pub fn print_table(rows: &[(Mode, RunResult)], reference: &Reference) {
    println!(
        "{:<12} {:>8} {:>8} {:>8} {:>9} {:>8} {:>8} {:>15} {:>15} {:>7} {:>9}",
        "mode",
        "inside %",
        "passed %",
        "depth mm",
        "standoff",
        "error %",
        "near %",
        "stretch p99/max",
        "flicker med/p999",
        "guides",
        "CPU-s/s"
    );
    for (mode, run) in rows {
        let m = &run.measured;
        let [near_median, near_p999, ..] = flicker(run, reference);
        let show = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), |x| format!("{x:.2}"));
        println!(
            "{:<12} {:>8.2} {:>8.2} {:>8.2} {:>6.2} mm {:>8} {:>8} {:>15} {:>15} {:>7.2} {:>9.2}",
            mode.name(),
            m.near_strands_inside_pct,
            m.passed_through_pct,
            10.0 * m.max_depth_cm,
            10.0 * m.mean_standoff_cm,
            show(run.error.map(|e| e.all)),
            show(run.error.map(|e| e.near)),
            format!("{:.3}/{:.3}", m.p99_stretch, m.max_stretch),
            format!("{}/{}", show(near_median), show(near_p999)),
            run.effective_guides_near,
            run.cpu_seconds / run.sim_seconds.max(1e-9),
        );
    }
    if let Some((_, run)) = rows.first() {
        println!(
            "near strands: {} of {}, {:.0} in reach at a time, a tenth or more in {} of {} steps; rigid hair's error: {} %",
            run.measured.near_strands,
            run.measured.n_strands,
            mean_in_reach(reference),
            steps_in_reach(reference, run.measured.n_strands / 10),
            run.steps,
            run.error.map_or_else(|| "-".to_owned(), |e| format!("{:.2}", e.rigid))
        );
    }
}

/// Prints the time by stage of one run.
pub fn print_stages(run: &RunResult) {
    println!(
        "{} steps, {:.2} s simulated, {:.2} s of CPU, {:.2} s of wall clock",
        run.steps, run.sim_seconds, run.cpu_seconds, run.wall_seconds
    );
    let total: f64 = run.stages.iter().map(|(_, s)| s).sum();
    for (name, seconds) in &run.stages {
        println!("  {name:<20} {:>7.3} s {:>5.1} %", seconds, 100.0 * seconds / total.max(1e-9));
    }
    println!(
        "  per step: {:.0} strands corrected, {:.0} in contact, {:.0} set changes; {:.1} % of guide pairs connected",
        run.corrected_strands,
        run.strands_in_contact,
        run.set_changes,
        100.0 * run.connectivity
    );
}
