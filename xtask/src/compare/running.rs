//! Experiments run one by one: what is kept is not run again, what fails is told and does not stop the others.

use super::kept::{Found, Kept, Store};
use super::place::Station;
use crate::progress::Bars;
use anyhow::Result;
use cpu_time::ProcessTime;
use hair_bench::evidence::Experiment;
use hair_bench::report::{Made, Outcome, Section, duration_words};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::time::Instant;

/// Whether to run at all.
#[derive(Clone, Copy, Debug, Default)]
pub struct How {
    /// Findings of another version serve as well.
    pub keep: bool,
    /// Findings of this version do not.
    pub fresh: bool,
}

/// A section and where its pictures lie.
pub struct Ran {
    pub section: Section,
    pub folder: Option<PathBuf>,
}

/// Runs experiments, or takes what is kept of them.
///
/// # Errors
/// Findings that cannot be kept: what experiments meet themselves is in their sections.
pub fn all(experiments: &[Experiment], place: &dyn Station, store: &Store, how: How, bars: &Bars) -> Result<Vec<Ran>> {
    // What each took before, in whatever version, tells how long is left.
    let took: Vec<Option<f64>> = experiments
        .iter()
        .map(|e| store.load(e.name).or_else(|| store.load_other(e.name)).map(|found| found.kept.made.seconds))
        .collect();
    let mut out = Vec::with_capacity(experiments.len());
    for (k, experiment) in experiments.iter().enumerate() {
        let head = format!("[{}/{}] {}", k + 1, experiments.len(), experiment.name);
        out.push(one(experiment, place, store, how, bars, &|| {
            let left: Vec<f64> = took[k..].iter().flatten().copied().collect();
            let known = (!left.is_empty()).then(|| format!("about {} left", duration_words(left.iter().sum())));
            let unknown = took.len() - k - left.len();
            let unknown = (unknown > 0).then(|| format!("{unknown} that never ran to come"));
            let words: Vec<String> = [known, unknown].into_iter().flatten().collect();
            bars.note(&format!("{head}: {}", words.join(", ")));
        })?);
    }
    Ok(out)
}

fn one(
    experiment: &Experiment,
    place: &dyn Station,
    store: &Store,
    how: How,
    bars: &Bars,
    say: &dyn Fn(),
) -> Result<Ran> {
    let section = |outcome| {
        let Experiment { name, title, source, .. } = *experiment;
        Section { name: name.to_owned(), title: title.to_owned(), source: source.to_owned(), outcome }
    };
    let ran = |Found { kept: Kept { mut made, findings }, folder }, outdated| {
        made.outdated = outdated;
        Ran { section: section(Outcome::Found { findings, made }), folder: Some(folder) }
    };
    let _lock = store.lock(experiment.name)?;
    if !how.fresh
        && let Some(found) = store.load(experiment.name)
    {
        return Ok(ran(found, false));
    }
    if how.keep
        && let Some(found) = store.load_other(experiment.name)
    {
        return Ok(ran(found, true));
    }
    say();
    let folder = store.clear(experiment.name)?;
    place.begin(experiment.name, &folder);
    let (wall, cpu) = (Instant::now(), ProcessTime::now());
    let result = catch_unwind(AssertUnwindSafe(|| (experiment.run)(place.as_place())));
    let (seconds, cpu_seconds) = (wall.elapsed().as_secs_f64(), cpu.elapsed().as_secs_f64());
    let drawn_by = place.end().unwrap_or_default();
    let why = match result {
        Ok(Ok(mut findings)) => {
            if !place.draws() {
                findings.pictures.clear();
            }
            let made = Made {
                seconds,
                cpu_seconds,
                commit: store.program().commit.clone(),
                outdated: false,
                at_s: super::about::now_s(),
                drawn_by,
            };
            return Ok(ran(store.save(experiment.name, &Kept { made, findings })?, false));
        }
        Ok(Err(error)) => chain(&error),
        Err(panic) => format!("a bug: {}", said(&*panic)),
    };
    bars.note(&format!("{} broke off: {why}", experiment.name));
    Ok(Ran { section: section(Outcome::Failed { why }), folder: None })
}

/// An error and its causes, each said once.
fn chain(error: &dyn std::error::Error) -> String {
    let mut words = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let more = error.to_string();
        if !words.ends_with(&more) {
            words = format!("{words}: {more}");
        }
        cause = error.source();
    }
    words
}

/// What somebody said who gave up.
fn said(panic: &(dyn std::any::Any + Send)) -> String {
    let words = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    words.unwrap_or("no words").to_owned()
}

#[cfg(test)]
mod tests;
