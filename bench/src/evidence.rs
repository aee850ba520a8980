//! What experiments hand to the report: tables, curves, pictures, claims of the papers, and measures that must not get worse.
//!
//! An [`Experiment`] is a name, a source in the papers and a function; it runs at one of three [`Size`]s and reaches trained models,
//! the renderer and the terminal only through its [`Place`], so that it knows nothing of files. Its [`Findings`] are plain data:
//! kept as JSON, they make the report again without running anything.

use crate::error::Error;
use crate::world::World;
use io_formats::scene::Scene;
use io_formats::skinning_model::SkinningModel;
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
    /// Name and points (x, y) of each curve.
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
}

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
