//! What experiments found, kept: a folder for each, named by size, experiment and a hash of the program.
//!
//! `OUT/cache/compare/<size>/<experiment>-<hash>/` holds `findings.json`, written last and by renaming, and the pictures beside
//! it: a folder without the file is that of a run cut short, and is made again. Two processes that want the same one wait for
//! each other.

use super::about::Program;
use crate::report::write_beside;
use anyhow::{Context, Result};
use hair_bench::evidence::{Findings, Size};
use hair_bench::report::{Made, Outcome, Report};
use io_formats::StageCache;
use io_formats::stage_cache::StageLock;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Folder of pictures, in a kept folder as in a report's.
pub const PICTURES: &str = "pictures";
const FINDINGS: &str = "findings.json";
/// A report's file of all its findings.
pub const REPORT: &str = "report.json";

/// Findings with how they were made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Kept {
    /// How they were made.
    pub made: Made,
    /// What was found.
    pub findings: Findings,
}

/// Kept findings and the folder they lie in.
pub struct Found {
    pub kept: Kept,
    pub folder: PathBuf,
}

/// Findings of one size.
pub struct Store {
    folder: PathBuf,
    locks: StageCache,
    program: Program,
    /// Findings without pictures are others than those with.
    mark: &'static str,
    size: Size,
    /// Folder of a report, which keeps findings too.
    report: Option<PathBuf>,
}

impl Store {
    /// The store of a size, for a version of the program.
    ///
    /// # Errors
    /// A folder that cannot be made.
    pub fn open(out: &Path, size: Size, program: &Program, no_pictures: bool) -> Result<Self> {
        let name = match size {
            Size::Smoke => "smoke",
            Size::Quick => "quick",
            Size::Full => "full",
        };
        let folder = out.join("cache").join("compare").join(name);
        let locks = StageCache::in_directory(&folder)?;
        let mark = if no_pictures { "-bare" } else { "" };
        Ok(Self { folder, locks, program: program.clone(), mark, size, report: None })
    }

    /// The same, with what a report in `folder` tells of other programs: one kept in a repository outlives every cache.
    pub fn with_report(self, folder: &Path) -> Self {
        Self { report: Some(folder.to_path_buf()).filter(|_| self.mark.is_empty()), ..self }
    }

    /// This program's version.
    pub fn program(&self) -> &Program {
        &self.program
    }

    /// The folder of an experiment.
    pub fn folder(&self, experiment: &str) -> PathBuf {
        self.folder.join(format!("{experiment}-{:016x}{}", self.program.hash, self.mark))
    }

    /// Waits until nobody else runs the experiment.
    ///
    /// # Errors
    /// A lock that cannot be made.
    pub fn lock(&self, experiment: &str) -> Result<StageLock> {
        Ok(self.locks.lock(&format!("{experiment}{}", self.mark), self.program.hash)?)
    }

    /// What this program found; none if it did not run yet, or not to its end.
    pub fn load(&self, experiment: &str) -> Option<Found> {
        read(&self.folder(experiment))
    }

    /// What the last other program found that got to its end.
    pub fn load_other(&self, experiment: &str) -> Option<Found> {
        let hash = |name: &str| {
            let rest = name.strip_prefix(experiment)?.strip_prefix('-')?.strip_suffix(self.mark)?;
            (rest.len() == 16 && rest.bytes().all(|b| b.is_ascii_hexdigit())).then_some(())
        };
        let entries = std::fs::read_dir(&self.folder);
        let named = entries.into_iter().flatten().flatten().filter(|e| e.file_name().to_str().and_then(hash).is_some());
        let found = named.filter_map(|e| read(&e.path()));
        let told = self.report.iter().filter_map(|folder| told(folder, self.size, experiment));
        found.chain(told).max_by_key(|found| (found.kept.made.at_s, found.folder.clone()))
    }

    /// Makes the experiment's folder anew.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn clear(&self, experiment: &str) -> Result<PathBuf> {
        let folder = self.folder(experiment);
        if folder.exists() {
            std::fs::remove_dir_all(&folder).with_context(|| format!("emptying {}", folder.display()))?;
        }
        std::fs::create_dir_all(&folder).with_context(|| format!("creating {}", folder.display()))?;
        Ok(folder)
    }

    /// Keeps what was found. Answers it as it will be read: a report made at once and one made from what is kept are the same.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn save(&self, experiment: &str, kept: &Kept) -> Result<Found> {
        let path = self.folder(experiment).join(FINDINGS);
        write_beside(&path, serde_json::to_string_pretty(kept)?.as_bytes())?;
        self.load(experiment).with_context(|| format!("{} does not read back", path.display()))
    }
}

/// What a report of this size tells of an experiment.
fn told(folder: &Path, size: Size, experiment: &str) -> Option<Found> {
    let text = std::fs::read_to_string(folder.join(REPORT)).ok()?;
    let report: Report = serde_json::from_str(&text).ok()?;
    let section = report.sections.into_iter().find(|section| section.name == experiment)?;
    match section.outcome {
        Outcome::Found { findings, made } if report.about.size == size => {
            Some(Found { kept: Kept { made, findings }, folder: folder.to_path_buf() })
        }
        _ => None,
    }
}

fn read(folder: &Path) -> Option<Found> {
    let text = std::fs::read_to_string(folder.join(FINDINGS)).ok()?;
    // What an earlier version wrote otherwise is not there for this one.
    Some(Found { kept: serde_json::from_str(&text).ok()?, folder: folder.to_path_buf() })
}
