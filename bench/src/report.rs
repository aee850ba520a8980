//! The report of `cargo xtask compare`: what experiments found, as one page, as Markdown and as JSON.
//!
//! - [`Report`]: plain data, the same for all three; [`html`], [`markdown`] and [`json`] write it down
//! - `plot`: curves as SVG; `words`: numbers and verdicts as they are written everywhere
//!
//! A function of its input: the same report gives the same bytes. What it says of the papers comes from [`Claim`]s, what it says
//! of this program from findings; it holds no figure of its own. Text is escaped wherever it goes, numbers that are not finite
//! show as a dash, and the page asks nothing of a network or a script.

mod html;
mod html_parts;
mod markdown;
mod plot;
mod words;

pub use html::{PictureBytes, html};
pub use markdown::markdown;
pub use plot::svg_file;
pub use words::{counted, date_words, duration_words, shown, size_words, verdict_words, verdicts_words};

use crate::evidence::{Claim, Findings, Size, Verdict};
use serde::{Deserialize, Serialize};

/// A report.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// How it came about.
    pub about: About,
    /// One section for each experiment, in order.
    pub sections: Vec<Section>,
}

/// How a report came about.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// What was typed.
    pub command: String,
    /// How large experiments were run.
    pub size: Size,
    /// The program's version: a commit, and whether it was changed since.
    pub commit: String,
    /// When the report was written, seconds since 1970 (UTC).
    pub written_s: u64,
    /// The machine.
    pub machine: Machine,
    /// What a reader should know of this run: pictures left out, drawn another way.
    pub notes: Vec<String>,
}

/// What an experiment ran on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// Name of the processor's model, as it gives it.
    pub processor: String,
    /// Threads used.
    pub threads: usize,
    /// Memory, GiB, where it is known.
    pub memory_gib: Option<f64>,
    /// Operating system and architecture.
    pub system: String,
}

/// What became of one experiment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Section {
    /// Its name on the command line; anchors and files are named after it.
    pub name: String,
    /// Its heading.
    pub title: String,
    /// Where the papers have it.
    pub source: String,
    /// What it found, or why it found nothing.
    pub outcome: Outcome,
}

/// How an experiment ended.
#[expect(clippy::large_enum_variant, reason = "there are a few dozen of them, and most are the large one")]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// It found something.
    Found {
        /// What.
        findings: Findings,
        /// At what cost, and by which version.
        made: Made,
    },
    /// It broke off.
    Failed {
        /// Why.
        why: String,
    },
}

/// How findings were made.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Made {
    /// Wall-clock time, s.
    pub seconds: f64,
    /// CPU time of all threads, without what the renderer took, s.
    pub cpu_seconds: f64,
    /// The program's version then.
    pub commit: String,
    /// Whether the program has changed since, so that the findings are those of another one.
    pub outdated: bool,
    /// When, seconds since 1970 (UTC).
    pub at_s: u64,
    /// What drew its pictures; empty where there are none.
    pub drawn_by: String,
}

impl Section {
    /// What was found, if anything.
    #[must_use]
    pub fn findings(&self) -> Option<&Findings> {
        match &self.outcome {
            Outcome::Found { findings, .. } => Some(findings),
            Outcome::Failed { .. } => None,
        }
    }

    /// Its claims.
    #[must_use]
    pub fn claims(&self) -> &[Claim] {
        self.findings().map_or(&[], |f| &f.claims)
    }
}

impl Report {
    /// Claims with their sections, in order.
    pub fn claims(&self) -> impl Iterator<Item = (&Section, &Claim)> {
        self.sections.iter().flat_map(|section| section.claims().iter().map(move |claim| (section, claim)))
    }

    /// How many claims ended each way, the best first.
    #[must_use]
    pub fn verdicts(&self) -> [(Verdict, usize); 4] {
        [Verdict::Reproduced, Verdict::InPart, Verdict::NotReproduced, Verdict::NotTested]
            .map(|verdict| (verdict, self.claims().filter(|(_, claim)| claim.verdict == verdict).count()))
    }

    /// Sections that failed.
    pub fn failed(&self) -> impl Iterator<Item = (&Section, &str)> {
        self.sections.iter().filter_map(|section| match &section.outcome {
            Outcome::Failed { why } => Some((section, why.as_str())),
            Outcome::Found { .. } => None,
        })
    }
}

/// The report as JSON: every number as it was found; null for what is not finite.
///
/// # Errors
/// None that plain data can meet.
pub fn json(report: &Report) -> Result<String, serde_json::Error> {
    let mut text = serde_json::to_string(report)?;
    text.push('\n');
    Ok(text)
}

#[cfg(test)]
mod tests;
