//! `xtask bench training --only guides`: ways to select guides side by side, as tables, figures and a picture.

use anyhow::Result;
use hair_bench::chart::{Curve, draw};
use hair_bench::guide_comparison::{Comparison, ComparisonParams, ModelRow, WAYS, compare};
use io_formats::guide_transform::Blend;
use serde_json::{Map, Value, json};
use std::path::Path;

/// Compares, prints tables in Markdown, adds figures and draws the error over the number of guides.
pub fn run(strands: usize, figures: &mut Map<String, Value>, plot: Option<&Path>) -> Result<()> {
    let params = ComparisonParams { strands, ..ComparisonParams::standard() };
    let found = compare(&params, |what| eprintln!("{what}"))?;
    print_models(&params, &found);
    print_fits(&found);
    add_figures(&params, &found, figures);
    if let Some(path) = plot {
        let curves: Vec<Curve> = WAYS
            .iter()
            .map(|&(way, _, _)| Curve {
                name: way.replace('_', " "),
                points: params.guides.iter().map(|&n| [n as f64, over_styles(&found, way, n)]).collect(),
            })
            .collect();
        let image = draw("held out error by number of guides", "guides", "% of length", &curves);
        image.write_png(path)?;
    }
    Ok(())
}

fn rows<'a>(found: &'a Comparison, way: &str, n: usize) -> impl Iterator<Item = &'a ModelRow> {
    found.models.iter().filter(move |r| r.way == way && r.n_guides == n)
}

/// Root mean square over styles of the error on held-out motion (% of length).
fn over_styles(found: &Comparison, way: &str, n: usize) -> f64 {
    let squares: Vec<f64> = rows(found, way, n).map(|r| r.held_out.pct * r.held_out.pct).collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

fn print_models(params: &ComparisonParams, found: &Comparison) {
    println!("| hair | guides | way | eligible | trained on, cm | held out, cm | held out, % of length |");
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    for row in &found.models {
        println!(
            "| {} | {} | {} | {:.2} | {:.3} | {:.3} | {:.2} |",
            row.style, row.n_guides, row.way, row.mean_eligible, row.training_cm, row.held_out.cm, row.held_out.pct
        );
    }
    println!(
        "\n| held out, % of length, both styles | {} |",
        params.guides.iter().map(usize::to_string).collect::<Vec<_>>().join(" | ")
    );
    println!("| --- |{}", " --- |".repeat(params.guides.len()));
    for (way, _, _) in WAYS {
        let all: Vec<String> = params.guides.iter().map(|&n| format!("{:.2}", over_styles(found, way, n))).collect();
        println!("| {way} | {} |", all.join(" | "));
    }
}

fn name(blend: Blend) -> &'static str {
    match blend {
        Blend::Translation => "translation",
        Blend::Rigid => "rigid",
    }
}

fn print_fits(found: &Comparison) {
    println!("\n| hair | B_g | frames | free, cm | linear, cm | quadratic, cm | cubic, cm |");
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    for row in &found.fits {
        for (at, frames) in ["trained on", "held out"].into_iter().enumerate() {
            let [linear, quadratic, cubic] = row.fitted_cm.map(|f| f[at]);
            println!(
                "| {} | {} | {frames} | {:.4} | {linear:.4} | {quadratic:.4} | {cubic:.4} |",
                row.style,
                name(row.blend),
                row.free_cm[at]
            );
        }
    }
    println!("\n| hair | B_g | RMS(linear - w) / RMS(w), % | quadratic | cubic |\n| --- | --- | --- | --- | --- |");
    for row in &found.fits {
        let [linear, quadratic, cubic] = row.weight_pct;
        println!("| {} | {} | {linear:.2} | {quadratic:.2} | {cubic:.2} |", row.style, name(row.blend));
    }
}

fn add_figures(params: &ComparisonParams, found: &Comparison, figures: &mut Map<String, Value>) {
    let mut put = |key: String, value: f64| figures.insert(key, json!(value));
    for row in &found.models {
        let key = format!("guides_{}_{}_{}", row.style, row.way, row.n_guides);
        put(format!("{key}_held_out_pct"), row.held_out.pct);
        put(format!("{key}_held_out_cm"), row.held_out.cm);
        put(format!("{key}_training_cm"), row.training_cm);
        put(format!("{key}_mean_eligible"), row.mean_eligible);
    }
    for (way, _, _) in WAYS {
        for &n in &params.guides {
            put(format!("guides_{way}_{n}_held_out_pct"), over_styles(found, way, n));
        }
    }
    for row in &found.fits {
        let key = format!("fit_{}_{}", row.style, name(row.blend));
        for (at, frames) in ["training", "held_out"].into_iter().enumerate() {
            put(format!("{key}_free_{frames}_cm"), row.free_cm[at]);
            for (degree, residual) in ["linear", "quadratic", "cubic"].into_iter().zip(row.fitted_cm) {
                put(format!("{key}_{degree}_{frames}_cm"), residual[at]);
            }
        }
        for (degree, share) in ["linear", "quadratic", "cubic"].into_iter().zip(row.weight_pct) {
            put(format!("{key}_{degree}_weight_pct"), share);
        }
    }
}
