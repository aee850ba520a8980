//! How cost grows with hairs and with guides: curves and fitted exponents (AS16 §7.3, DESIGN §8).

use super::heads::{Amount, adaptive, resize, salon};
use crate::chart::Curve;
use crate::error::Error;
use crate::evidence::{Experiment, Findings, Place, Plot, Size, Table, number, text};
use crate::runtime_bench::cost::{over_guides, over_hairs};
use crate::runtime_bench::power_law;
use crate::training_motions::train_little;

/// The experiment.
pub const EXPERIMENT: Experiment =
    Experiment { name: "scaling", title: "Cost over hairs and guides", source: "AS16 Table 2, §7.3", run };

/// While the comb of the salon is in the hair, s.
const IN_HAIR_S: [f64; 2] = [0.8, 1.2];

/// Numbers of hairs, numbers of guides, and the hairs those guide.
fn counts(size: Size) -> (Vec<usize>, Vec<usize>, usize) {
    match size {
        Size::Smoke => (vec![1_250, 2_500, 5_000], vec![25, 50, 100], 1_000),
        Size::Quick => (vec![2_500, 5_000, 10_000, 20_000], vec![50, 100, 200], 2_000),
        Size::Full => {
            (vec![10_000, 20_000, 50_000, 100_000, 150_000, 300_000], vec![50, 100, 200, 400, 800, 1_600], 20_000)
        }
    }
}

fn run(place: &dyn Place) -> Result<Findings, Error> {
    let head = salon(place)?;
    let subject = adaptive(&head);
    let (hairs, guides, guided) = counts(place.size());
    let [from, to] = IN_HAIR_S;
    let (_, by_hairs) =
        over_hairs(&subject, &hairs, from, to, |done| place.progress("cost over hairs", done, hairs.len()))?;
    let mut models = Vec::new();
    for &n in &guides {
        let mut scene = head.world.scene.clone();
        train_little(&mut scene);
        resize(&mut scene, Amount { hairs: guided, guides: n, measured: 0, reference: 0 });
        models.push(place.trained(scene)?.model);
        place.progress("models with more guides", models.len(), guides.len());
    }
    let (_, by_guides) = over_guides(&head.world, subject.params, &models, from, to)?;
    let mut out = Findings {
        paragraphs: vec![format!(
            "CPU time of a step and of a read of all hair while the comb is in the hair. Fewer hairs are the first of the head, more are copies \
             beside them, with {} guides always; over guides, each model was trained for its number on {guided} hairs.",
            head.model.n_guides()
        )],
        ..Findings::default()
    };
    for (over, curves) in [("hairs", by_hairs), ("guides", by_guides)] {
        out.tables.push(exponents(over, &curves));
        out.plots.push(Plot {
            title: format!("Cost over {over}"),
            x: over.to_owned(),
            y: "CPU time, ms".to_owned(),
            log_x: true,
            log_y: true,
            curves: curves.into_iter().map(|c| (c.name, c.points)).collect(),
        });
    }
    Ok(out)
}

fn exponents(over: &str, curves: &[Curve]) -> Table {
    let counts: Vec<f64> = curves.first().map(|c| c.points.iter().map(|p| p[0]).collect()).unwrap_or_default();
    let mut columns = vec!["CPU time, ms".to_owned()];
    columns.extend(counts.iter().map(|n| format!("{n} {over}")));
    columns.push("exponent".to_owned());
    let row = |c: &Curve| {
        let mut row = vec![text(c.name.clone())];
        row.extend(c.points.iter().map(|p| number(p[1], 2)));
        row.push(number(power_law(&c.points).0, 2));
        row
    };
    Table {
        title: format!("Cost over {over}"),
        columns,
        rows: curves.iter().map(row).collect(),
        note: "The exponent is of the power law nearest in logarithms.".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_of_exponents_is_as_wide_as_its_columns_and_finds_a_square_law() {
        /// Of logarithms and a quotient in double precision.
        const ROUND_OFF: f64 = 1e-12;
        let points = [10.0, 20.0, 40.0].map(|x: f64| [x, 0.5 * x * x]).to_vec();
        let table = exponents("guides", &[Curve { name: "step".to_owned(), points }]);
        assert_eq!(table.rows[0].len(), table.columns.len());
        let Some(crate::evidence::Cell::Number { value, .. }) = table.rows[0].last() else { panic!("no exponent") };
        assert!((value - 2.0).abs() < ROUND_OFF, "{value}");
    }
}
