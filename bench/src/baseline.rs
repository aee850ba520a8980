//! Measures of an earlier version, and what got worse since.
//!
//! A measure is worse where it is on the wrong side of its baseline by more than the slack kept with that baseline: a program
//! cannot loosen its own bounds. One that is no number any more is worse, too. New and vanished measures are told, not judged.

use crate::evidence::{Better, Measure, Size};
use crate::report::counted;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Measures by experiment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Baseline {
    /// How large experiments were run.
    pub size: Size,
    /// Measures of each experiment, by name.
    pub experiments: BTreeMap<String, BTreeMap<String, Kept>>,
}

/// A measure's baseline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Kept {
    /// Its value then; null if it was no number.
    pub value: Option<f64>,
    /// Its unit.
    pub unit: String,
    /// Which way is better.
    pub better: Better,
    /// By how much it may be worse.
    pub slack: f64,
}

/// What became of a measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Change {
    /// Worse by more than its slack.
    Worse,
    /// Better by more than its slack: the baseline could be raised.
    Better,
    /// As it was, within its slack.
    Same,
    /// There was none of this name.
    New,
    /// There is none of this name any more.
    Vanished,
}

/// A measure beside its baseline.
#[derive(Clone, Debug, PartialEq)]
pub struct Compared {
    /// Its experiment.
    pub experiment: String,
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Its baseline.
    pub then: Option<f64>,
    /// Its value.
    pub now: Option<f64>,
    /// By how much it may be worse.
    pub slack: f64,
    /// What became of it.
    pub change: Change,
}

/// Digits of a baseline's numbers that count: its slacks are far larger than what is left out.
const DIGITS: i32 = 6;

fn rounded(value: f64) -> Option<f64> {
    if value == 0.0 || !value.is_finite() {
        return value.is_finite().then_some(0.0);
    }
    let power = DIGITS - 1 - value.abs().log10().floor() as i32;
    // Through text: what is written is what is compared.
    format!("{value:.0$}", power.clamp(0, 300) as usize).parse().ok()
}

impl Baseline {
    /// A baseline of what experiments measured.
    #[must_use]
    pub fn of<'a>(size: Size, measured: impl IntoIterator<Item = (&'a str, &'a [Measure])>) -> Self {
        let mut baseline = Self { size, experiments: BTreeMap::new() };
        baseline.take(measured);
        baseline
    }

    /// Replaces the measures of these experiments; those of others stay.
    pub fn take<'a>(&mut self, measured: impl IntoIterator<Item = (&'a str, &'a [Measure])>) {
        for (experiment, measures) in measured {
            let kept = measures.iter().map(|m| {
                let Measure { name, unit, value, better, slack } = m;
                (name.clone(), Kept { value: rounded(*value), unit: unit.clone(), better: *better, slack: *slack })
            });
            self.experiments.insert(experiment.to_owned(), kept.collect());
        }
    }

    /// Measures beside their baselines, experiment by experiment; experiments that were not run are left out.
    #[must_use]
    pub fn compare<'a>(&self, measured: impl IntoIterator<Item = (&'a str, &'a [Measure])>) -> Vec<Compared> {
        let none = BTreeMap::new();
        let mut out = Vec::new();
        for (experiment, measures) in measured {
            let kept = self.experiments.get(experiment).unwrap_or(&none);
            for m in measures {
                let now = rounded(m.value);
                let (then, slack, change) = match kept.get(&m.name) {
                    Some(k) => (k.value, k.slack, k.judge(now)),
                    None => (None, m.slack, Change::New),
                };
                let (experiment, name, unit) = (experiment.to_owned(), m.name.clone(), m.unit.clone());
                out.push(Compared { experiment, name, unit, then, now, slack, change });
            }
            for (name, k) in kept.iter().filter(|(name, _)| measures.iter().all(|m| m.name != **name)) {
                out.push(Compared {
                    experiment: experiment.to_owned(),
                    name: name.clone(),
                    unit: k.unit.clone(),
                    then: k.value,
                    now: None,
                    slack: k.slack,
                    change: Change::Vanished,
                });
            }
        }
        out
    }
}

impl Kept {
    fn judge(&self, now: Option<f64>) -> Change {
        let (Some(then), Some(now)) = (self.value, now) else {
            return match (self.value, now) {
                (Some(_), None) => Change::Worse,
                (None, Some(_)) => Change::Better,
                _ => Change::Same,
            };
        };
        let gain = match self.better {
            Better::Lower => then - now,
            Better::Higher => now - then,
        };
        // A slack that is no number allows nothing.
        let slack = if self.slack.is_finite() { self.slack.max(0.0) } else { 0.0 };
        if gain < -slack {
            Change::Worse
        } else if gain > slack {
            Change::Better
        } else {
            Change::Same
        }
    }
}

/// The comparison as lines of text: what is worse first, then what changed otherwise, then how many stayed.
#[must_use]
pub fn told(compared: &[Compared]) -> String {
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v}"));
    let mut out = String::new();
    for (change, words) in
        [(Change::Worse, "worse"), (Change::Vanished, "vanished"), (Change::New, "new"), (Change::Better, "better")]
    {
        for c in compared.iter().filter(|c| c.change == change) {
            let (then, now) = (number(c.then), number(c.now));
            out += &format!(
                "{words:<9} {:<20} {:<44} {then:>12} -> {now:>12} {:<8} slack {}\n",
                c.experiment, c.name, c.unit, c.slack
            );
        }
    }
    let same = compared.iter().filter(|c| c.change == Change::Same).count();
    out += &format!("{} as before, within their slack\n", counted(same, "measure"));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measure(name: &str, value: f64, better: Better, slack: f64) -> Measure {
        Measure { name: name.to_owned(), unit: "%".to_owned(), value, better, slack }
    }

    fn change(then: f64, now: f64, better: Better) -> Change {
        let (then, now) = ([measure("m", then, better, 0.5)], [measure("m", now, better, 99.0)]);
        Baseline::of(Size::Smoke, [("e", &then[..])]).compare([("e", &now[..])])[0].change
    }

    #[test]
    fn worse_is_what_lies_past_the_slack_of_its_baseline() {
        use Better::{Higher, Lower};
        let cases = [
            (1.0, 1.5, Lower, Change::Same),
            (1.0, 1.51, Lower, Change::Worse),
            (1.0, 0.49, Lower, Change::Better),
            (1.0, 0.51, Higher, Change::Same),
            (1.0, 0.49, Higher, Change::Worse),
            (1.0, 1.51, Higher, Change::Better),
            (1.0, f64::NAN, Lower, Change::Worse),
            (1.0, f64::INFINITY, Higher, Change::Worse),
            (f64::NAN, 1.0, Lower, Change::Better),
            (f64::NAN, f64::NAN, Lower, Change::Same),
        ];
        for (then, now, better, expected) in cases {
            assert_eq!(change(then, now, better), expected, "{then} to {now}, {better:?}");
        }
    }

    #[test]
    fn what_is_new_or_gone_is_told_and_what_was_not_run_is_not() {
        let [a, b] = ["a", "b"].map(|name| [measure(name, 1.0, Better::Lower, 0.0)]);
        let baseline = Baseline::of(Size::Smoke, [("e", &a[..]), ("not run", &a[..])]);
        let compared = baseline.compare([("e", &b[..])]);
        let changes: Vec<_> = compared.iter().map(|c| (c.name.as_str(), c.change)).collect();
        assert_eq!(changes, [("b", Change::New), ("a", Change::Vanished)]);
    }

    #[test]
    fn a_baseline_compared_with_itself_has_nothing_to_tell() {
        let measures: Vec<Measure> = [0.0, -0.0, 1e-9, 123_456.789, 0.1 + 0.2, f64::NAN]
            .into_iter()
            .enumerate()
            .map(|(k, v)| measure(&k.to_string(), v, Better::Lower, 0.0))
            .collect();
        let baseline = Baseline::of(Size::Smoke, [("e", &measures[..])]);
        let json = serde_json::to_string(&baseline).expect("plain data");
        let back: Baseline = serde_json::from_str(&json).expect("as written");
        let compared = back.compare([("e", &measures[..])]);
        assert!(compared.iter().all(|c| c.change == Change::Same), "{}", told(&compared));
    }
}
