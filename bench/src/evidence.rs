//! What experiments hand to the report: tables, curves, pictures, claims of the papers, and measures that must not get worse.
//!
//! An [`Experiment`] is a name, a source in the papers and a function; it runs at one of three [`Size`]s and reaches trained models,
//! the renderer and the terminal only through its [`Place`], so that it knows nothing of files. Its [`Findings`] are plain data:
//! kept as JSON, they make the report again without running anything. Numbers that are not finite, which JSON has no word for,
//! are null there and come back as not a number.

use crate::error::Error;
use crate::world::World;
use io_formats::scene::Scene;
use io_formats::skinning_model::SkinningModel;
use io_formats::stage_cache::StageCost;
use serde::{Deserialize, Serialize};

/// How large an experiment is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Size {
    /// All of them within a few minutes: what every change is checked with.
    Smoke,
    /// All of them within ten minutes on two cores, large enough to look at.
    Quick,
    /// The papers' numbers of hairs and guides.
    Full,
}

/// What an experiment found: a section of the report.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Findings {
    /// What somebody who reads the report's first page only should know: a sentence each, with figures of this run.
    #[serde(default)]
    pub highlights: Vec<String>,
    /// What was done, and what is to be seen; plain text.
    pub paragraphs: Vec<String>,
    /// Numbers.
    pub tables: Vec<Table>,
    /// Curves.
    pub plots: Vec<Plot>,
    /// Pictures, in order; side by side where they share a row.
    pub pictures: Vec<Picture>,
    /// What the papers claim, and what was found.
    pub claims: Vec<Claim>,
    /// Numbers watched from one version to the next.
    pub measures: Vec<Measure>,
}

/// Rows of numbers under names.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Table {
    /// What it shows, and at what size.
    pub title: String,
    /// Names of columns, the first of the rows' names; units belong to them.
    pub columns: Vec<String>,
    /// As many cells as columns each.
    pub rows: Vec<Vec<Cell>>,
    /// Words below it.
    pub note: String,
}

/// One field of a table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Cell {
    /// A number and the digits after its point that are shown.
    Number {
        /// The number; not finite shows as a dash.
        #[serde(with = "or_null")]
        value: f64,
        /// Digits after the point.
        digits: u8,
    },
    /// Words; empty shows as a dash.
    Text(String),
}

/// Curves over one quantity.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Plot {
    /// What it shows.
    pub title: String,
    /// Quantity and unit along x.
    pub x: String,
    /// Quantity and unit along y.
    pub y: String,
    /// Whether x grows by factors.
    pub log_x: bool,
    /// Whether y does.
    pub log_y: bool,
    /// Name and points (x, y) of each curve; one that is not finite interrupts it.
    #[serde(with = "points_or_null")]
    pub curves: Vec<(String, Vec<[f64; 2]>)>,
}

/// A picture beside the report.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Picture {
    /// What is seen.
    pub caption: String,
    /// File name, in the folder of the report.
    pub file: String,
    /// Pictures of one row have the same name here.
    pub row: String,
}

/// Whether a claim of a paper was found to hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// It holds.
    Reproduced,
    /// Part of it holds.
    InPart,
    /// It does not.
    NotReproduced,
    /// It was not looked at, or cannot be on this machine.
    NotTested,
}

/// A claim of a paper beside what was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Claim {
    /// Paper and section, `AS16 §7.2, Fig. 5`.
    pub source: String,
    /// What it says, in our words.
    pub claim: String,
    /// Its figure.
    pub paper: String,
    /// Ours.
    pub ours: String,
    /// Whether it holds.
    pub verdict: Verdict,
    /// Why it does not, or what to keep in mind.
    pub why: String,
}

/// Which way a measure is better.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Better {
    /// Less is better.
    Lower,
    /// More is better.
    Higher,
}

/// A number that must not get worse from one version to the next. Times are no measures: machines differ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measure {
    /// Name, unique in its experiment: `passed_through_pct_adaptive`.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// The number.
    #[serde(with = "or_null")]
    pub value: f64,
    /// Which way is better.
    pub better: Better,
    /// By how much it may be worse than its baseline, in its own unit, before that counts: what another machine's rounding does.
    pub slack: f64,
}

/// A world and a model trained for it.
pub struct Trained {
    /// The scene made real.
    pub world: World,
    /// Its model.
    pub model: SkinningModel,
    /// What every stage of training took when it was made, in order; hair is simulated in those of [`SIMULATED`].
    pub training: Vec<(String, StageCost)>,
}

/// Stages of training that simulate every hair.
pub const SIMULATED: [&str; 4] = ["settle", "frames", "validation frames", "held-out frames"];

/// What is drawn in one picture.
pub struct View<'a> {
    /// Scene, head and solids.
    pub world: &'a World,
    /// Time of the solids' and head's poses, s.
    pub t: f64,
    /// World positions, strand-major, cm.
    pub positions: &'a [[f32; 3]],
    /// Colour of each strand, linear RGB; none for hair.
    pub colors: Option<&'a [[f32; 3]]>,
    /// The camera is turned around the head by so much, radian.
    pub turn: f32,
}

/// Where an experiment runs: what it needs of files, renderer and terminal.
pub trait Place {
    /// How large to run.
    fn size(&self) -> Size;

    /// A scene that comes with the program.
    ///
    /// # Errors
    /// There is no such scene.
    fn scene(&self, name: &str) -> Result<Scene, Error>;

    /// A scene's world and its trained model, kept from one run to the next.
    ///
    /// # Errors
    /// Whatever making or training it meets.
    fn trained(&self, scene: Scene) -> Result<Trained, Error>;

    /// Draws a view into a file of the report's folder, named after `name`.
    ///
    /// # Errors
    /// Whatever drawing or writing meets.
    fn draw(&self, name: &str, caption: &str, row: &str, view: &View) -> Result<Picture, Error>;

    /// Where a mesh of the real data lies that tests may use, if it is there: `solids/bunny.obj`.
    fn data(&self, name: &str) -> Option<std::path::PathBuf>;

    /// Says how far `what` is.
    fn progress(&self, what: &str, done: usize, of: usize);
}

/// A question to the program, and how it is answered.
#[derive(Clone, Copy)]
pub struct Experiment {
    /// Name on a command line and in files.
    pub name: &'static str,
    /// Its heading.
    pub title: &'static str,
    /// Where the papers have it.
    pub source: &'static str,
    /// Runs it.
    pub run: fn(&dyn Place) -> Result<Findings, Error>,
}

/// Shorthand for a number in a table.
#[must_use]
pub fn number(value: f64, digits: u8) -> Cell {
    Cell::Number { value, digits }
}

/// Shorthand for words in a table.
#[must_use]
pub fn text(words: impl Into<String>) -> Cell {
    Cell::Text(words.into())
}

/// A number, or null where it is not finite.
mod or_null {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(super) fn serialize<S: Serializer>(value: &f64, to: S) -> Result<S::Ok, S::Error> {
        Some(*value).filter(|v| v.is_finite()).serialize(to)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
        Ok(Option::deserialize(from)?.unwrap_or(f64::NAN))
    }
}

/// Curves, with null for what of a point is not finite.
mod points_or_null {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    type Curves<T> = Vec<(String, Vec<[T; 2]>)>;

    pub(super) fn serialize<S: Serializer>(curves: &Curves<f64>, to: S) -> Result<S::Ok, S::Error> {
        let written = |[x, y]: &[f64; 2]| [*x, *y].map(|v| Some(v).filter(|v| v.is_finite()));
        let curves: Vec<(&str, Vec<_>)> =
            curves.iter().map(|(name, points)| (name.as_str(), points.iter().map(written).collect())).collect();
        curves.serialize(to)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Curves<f64>, D::Error> {
        let curves: Curves<Option<f64>> = Vec::deserialize(from)?;
        let read = |point: [Option<f64>; 2]| point.map(|v| v.unwrap_or(f64::NAN));
        Ok(curves.into_iter().map(|(name, points)| (name, points.into_iter().map(read).collect())).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn findings_come_back_from_json_and_what_is_not_finite_as_not_a_number() {
        let findings = Findings {
            tables: vec![Table {
                columns: vec!["a".to_owned(), "b".to_owned(), "c".to_owned()],
                rows: vec![vec![number(0.25, 2), text("|<&\"\u{3b2}"), number(f64::INFINITY, 1)]],
                ..Table::default()
            }],
            plots: vec![Plot { curves: vec![("c".to_owned(), vec![[1.0, 2.0], [f64::NAN, 3.0]])], ..Plot::default() }],
            ..Findings::default()
        };
        let json = serde_json::to_string(&findings).expect("plain data");
        let back: Findings = serde_json::from_str(&json).expect("as written");
        assert_eq!(serde_json::to_string(&back).expect("plain data"), json);
        assert_eq!(back.tables[0].rows[0][..2], findings.tables[0].rows[0][..2]);
        assert!(matches!(back.tables[0].rows[0][2], Cell::Number { value, digits: 1 } if value.is_nan()));
        assert_eq!(back.plots[0].curves[0].1[0], [1.0, 2.0]);
        assert!(back.plots[0].curves[0].1[1][0].is_nan());
    }
}
