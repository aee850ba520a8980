//! Claims, verdicts and measures said the same way by all experiments.
//!
//! A verdict comes from numbers by a rule in code: nobody decides by looking at them. The limits of the rules stand here, with
//! their reasons.

use super::watch::{Reference, Watched};
use crate::evidence::{Better, Cell, Claim, Measure, Table, Verdict, number, text};
use crate::measures::Measured;

/// Share of near strands inside a solid, or crossed by it, up to which it counts as kept out, per cent: what DESIGN §8 aims at.
pub const CLEAN_PCT: f64 = 2.0;
/// Share inside from which anybody sees it, per cent.
pub const VISIBLE_PCT: f64 = 5.0;
/// Flicker over full space's up to which hair counts as quiet: hair that jumps does ten times as much.
pub const QUIET: f64 = 2.0;
/// Error of near strands up to which a picture looks like full space's, % of length: under a centimetre on 25 cm of hair.
pub const ALIKE_PCT: f64 = 3.0;
/// What rounding on another machine does to shares of strands, in per cent of them.
pub const SHARE_SLACK_PCT: f64 = 1.0;
/// What it does to errors, % of length.
pub const ERROR_SLACK_PCT: f64 = 0.3;

/// Reproduced where all holds, in part where some of it does.
#[must_use]
pub fn verdict(holds: &[bool]) -> Verdict {
    match holds.iter().filter(|&&h| h).count() {
        n if n == holds.len() && n > 0 => Verdict::Reproduced,
        0 => Verdict::NotReproduced,
        _ => Verdict::InPart,
    }
}

/// Whether hair was kept out of solids; nothing is known where no hair came near one.
#[must_use]
pub fn kept_out(m: &Measured) -> Verdict {
    match m.near_strands {
        0 => Verdict::NotTested,
        _ => verdict(&[m.near_strands_inside_pct <= CLEAN_PCT, m.passed_through_pct <= CLEAN_PCT]),
    }
}

/// Whether hair that came near solids is as in full space: little off, and no more than with another way.
#[must_use]
pub fn alike(ours: &Watched, other: &Watched) -> Verdict {
    match ours.quality.beside.near_strands {
        0 => Verdict::NotTested,
        _ => verdict(&[ours.error_pct()[0] <= ALIKE_PCT, ours.error_pct()[0] <= other.error_pct()[0]]),
    }
}

/// A claim of AS16 or MS08.
#[must_use]
pub fn claim(source: &str, claim: &str, paper: &str, ours: String, verdict: Verdict, why: &str) -> Claim {
    Claim {
        source: source.to_owned(),
        claim: claim.to_owned(),
        paper: paper.to_owned(),
        ours,
        verdict,
        why: why.to_owned(),
    }
}

/// A measure of which less is better.
#[must_use]
pub fn lower(name: impl Into<String>, unit: &str, value: f64, slack: f64) -> Measure {
    Measure { name: name.into(), unit: unit.to_owned(), value, better: Better::Lower, slack }
}

/// A measure of which more is better.
#[must_use]
pub fn higher(name: impl Into<String>, unit: &str, value: f64, slack: f64) -> Measure {
    Measure { name: name.into(), unit: unit.to_owned(), value, better: Better::Higher, slack }
}

/// How far a ratio is from one, by factors: 0.3 for 1.3 and for 1/1.3. Frozen hair is as far as hair that jumps.
#[must_use]
pub fn off_one(ratio: f64) -> f64 {
    if ratio > 0.0 { ratio.max(1.0 / ratio) - 1.0 } else { f64::INFINITY }
}

/// All measures of several ways to skin one scene, full space first.
#[must_use]
pub fn table(title: &str, against: &Reference, ways: &[(&str, &Watched)]) -> Table {
    let columns = [
        "way",
        "inside, % of strands in reach",
        "passed through, % of near",
        "deepest, mm",
        "standoff beyond full space, mm",
        "error near, % of length",
        "error all, % of length",
        "flicker, median, um a step",
        "flicker, median, x full space",
        "flicker, 99.9 %, x full space",
        "stretch, 99 %, %",
        "effective guides",
        "in head, %",
    ];
    let full = &against.run.measured;
    let mut rows = vec![vec![
        text("full space"),
        number(full.near_strands_inside_pct, 2),
        number(full.passed_through_pct, 2),
        number(10.0 * full.max_depth_cm, 2),
        number(0.0, 2),
        text(""),
        text(""),
        number(1e4 * full.flicker_near_median_cm, 1),
        number(1.0, 2),
        number(1.0, 2),
        number(100.0 * full.p99_stretch, 2),
        text(""),
        number(full.inside_head_pct, 2),
    ]];
    for (name, way) in ways {
        let m = &way.quality.measured;
        let [flicker, flicker_p999] = way.flicker_over(against);
        let [near, all] = way.error_pct();
        let mut row: Vec<Cell> = vec![text(*name)];
        row.extend(
            [
                m.near_strands_inside_pct,
                m.passed_through_pct,
                10.0 * m.max_depth_cm,
                way.standoff_mm(against),
                near,
                all,
                1e4 * way.quality.beside.flicker_near_median_cm,
                flicker,
                flicker_p999,
                100.0 * m.p99_stretch,
                way.guides(),
                m.inside_head_pct,
            ]
            .map(|value| number(value, 2)),
        );
        rows.push(row);
    }
    Table {
        title: title.to_owned(),
        columns: columns.map(str::to_owned).to_vec(),
        rows,
        note: format!(
            "Inside and passed through of the first {} hairs; standoff, error and flicker beside the first {} in full space, of which {} come near.",
            against.run.n_measured, against.run.n_reference, full.near_strands
        ),
    }
}

/// The measures watched of a way to skin a scene.
#[must_use]
pub fn watched(name: &str, way: &Watched, against: &Reference) -> Vec<Measure> {
    let m = &way.quality.measured;
    let [flicker, flicker_p999] = way.flicker_over(against);
    let mut out = vec![
        lower(format!("inside_pct_{name}"), "%", m.near_strands_inside_pct, SHARE_SLACK_PCT),
        lower(format!("passed_through_pct_{name}"), "% of near", m.passed_through_pct, SHARE_SLACK_PCT),
        // Padding keeps hair out as well.
        lower(format!("standoff_beyond_full_mm_{name}"), "mm", way.standoff_mm(against).abs(), 0.2),
        lower(format!("error_near_pct_{name}"), "% of length", way.error_pct()[0], ERROR_SLACK_PCT),
        lower(format!("flicker_off_one_{name}"), "x", off_one(flicker), 0.3),
        lower(format!("flicker_p999_off_one_{name}"), "x", off_one(flicker_p999), 0.5),
        lower(format!("stretch_p99_pct_{name}"), "%", 100.0 * m.p99_stretch, 0.5),
        lower(format!("not_finite_{name}"), "", (m.nonfinite + way.quality.quarantined) as f64, 0.0),
    ];
    // Where no hair came near there is nothing to watch.
    out.retain(|measure| measure.value.is_finite());
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_claim_holds_in_part_where_some_of_it_does() {
        assert_eq!(verdict(&[true, true]), Verdict::Reproduced);
        assert_eq!(verdict(&[true, false]), Verdict::InPart);
        assert_eq!(verdict(&[false, false]), Verdict::NotReproduced);
        // Nothing looked at is nothing shown.
        assert_eq!(verdict(&[]), Verdict::NotReproduced);
    }

    #[test]
    fn a_solid_that_meets_no_hair_proves_nothing() {
        let none = Measured::default();
        assert_eq!(kept_out(&none), Verdict::NotTested);
        assert_eq!(kept_out(&Measured { near_strands: 9, ..none }), Verdict::Reproduced);
        let inside = Measured { near_strands: 9, near_strands_inside_pct: 50.0, ..none };
        assert_eq!(kept_out(&inside), Verdict::InPart);
        assert_eq!(kept_out(&Measured { passed_through_pct: 50.0, ..inside }), Verdict::NotReproduced);
    }

    #[test]
    fn frozen_hair_is_as_far_from_full_space_as_hair_that_jumps() {
        /// Of a quotient in double precision.
        const ROUND_OFF: f64 = 1e-12;
        assert_eq!(off_one(1.0), 0.0);
        assert!((off_one(4.0) - off_one(0.25)).abs() < ROUND_OFF);
        assert_eq!(off_one(0.0), f64::INFINITY);
        assert!(off_one(1.2) < off_one(1.3) && off_one(0.8) < off_one(0.7));
    }
}
