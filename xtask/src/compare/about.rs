//! Which program, on which machine: what a report says of how it came about.

use crate::workspace_root;
use anyhow::{Context, Result};
use hair_bench::evidence::Size;
use hair_bench::report::{About, Machine};
use std::path::Path;
use std::process::Command;
use std::time::{SystemTime, UNIX_EPOCH};
use xxhash_rust::xxh3::Xxh3;

/// What figures depend on, relative to the workspace: everything that is built but what only writes reports and runs checks.
const SOURCES: [&str; 11] = [
    "Cargo.lock",
    "Cargo.toml",
    "io-formats/src",
    "collision/src",
    "strand-sim/src",
    "skinning-train/src",
    "adaptive-runtime/src",
    "viewer/src",
    "bench/src",
    "bench/scenes",
    "xtask/src",
];

/// Of those, what no figure depends on.
const BESIDES: [&str; 19] = [
    "bench/src/report.rs",
    "bench/src/report",
    "bench/src/baseline.rs",
    "xtask/src/bench.rs",
    "xtask/src/bench",
    "xtask/src/ci.rs",
    "xtask/src/compare.rs",
    "xtask/src/compare/about.rs",
    "xtask/src/compare/check.rs",
    "xtask/src/compare/kept.rs",
    "xtask/src/compare/modes.rs",
    "xtask/src/compare/running.rs",
    "xtask/src/compare/running",
    "xtask/src/compare/writing.rs",
    "xtask/src/convert.rs",
    "xtask/src/paper_map.rs",
    "xtask/src/progress.rs",
    "xtask/src/run_scene.rs",
    "xtask/src/tidy.rs",
];

/// A version of the program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Program {
    /// Its commit, in words.
    pub commit: String,
    /// Hash of all its figures depend on.
    pub hash: u64,
}

/// This program's version, from its sources.
///
/// # Errors
/// A source that cannot be read.
pub fn program() -> Result<Program> {
    let root = workspace_root();
    Ok(Program { commit: commit(&root), hash: hash(&root)? })
}

fn hash(root: &Path) -> Result<u64> {
    let mut files = Vec::new();
    for source in SOURCES {
        collect(root, source, &mut files)?;
    }
    files.sort();
    let mut hasher = Xxh3::new();
    data(&root.join("../shared/data"), &mut hasher);
    for file in files {
        let bytes = std::fs::read(root.join(&file)).with_context(|| format!("reading {file}"))?;
        hasher.update(file.as_bytes());
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(&bytes);
    }
    Ok(hasher.digest())
}

/// What real data there is: names and sizes, since whole meshes are long to read.
fn data(folder: &Path, hasher: &mut Xxh3) {
    let mut entries: Vec<_> = std::fs::read_dir(folder).into_iter().flatten().flatten().collect();
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        hasher.update(entry.file_name().as_encoded_bytes());
        match entry.metadata() {
            Ok(found) if found.is_dir() => data(&entry.path(), hasher),
            Ok(found) => hasher.update(&found.len().to_le_bytes()),
            Err(_) => {}
        }
    }
}

/// Files at or under a path, but for those that no figure depends on; names with `/` on every system.
fn collect(root: &Path, path: &str, out: &mut Vec<String>) -> Result<()> {
    if BESIDES.contains(&path) {
        return Ok(());
    }
    let at = root.join(path);
    if !at.is_dir() {
        out.push(path.to_owned());
        return Ok(());
    }
    for entry in std::fs::read_dir(&at).with_context(|| format!("listing {}", at.display()))? {
        let name = entry.with_context(|| format!("listing {}", at.display()))?.file_name();
        collect(root, &format!("{path}/{}", name.to_string_lossy()), out)?;
    }
    Ok(())
}

fn commit(root: &Path) -> String {
    let git = |args: &[&str]| {
        let answer = Command::new("git").args(args).current_dir(root).output().ok()?;
        answer.status.success().then(|| String::from_utf8_lossy(&answer.stdout).trim().to_owned())
    };
    let Some(commit) = git(&["rev-parse", "--short=12", "HEAD"]) else {
        return "unknown: not a git repository".to_owned();
    };
    match git(&["status", "--porcelain", "--untracked-files=no"]) {
        Some(changed) if changed.is_empty() => commit,
        _ => format!("{commit}, changed since"),
    }
}

/// Seconds since 1970.
pub fn now_s() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs())
}

/// How a report of this program, here and now, comes about.
pub fn about(size: Size, program: &Program, notes: Vec<String>) -> About {
    let words: Vec<String> = std::env::args().skip(1).collect();
    About {
        command: format!("cargo xtask {}", words.join(" ")),
        size,
        commit: program.commit.clone(),
        written_s: now_s(),
        machine: machine(),
        notes,
    }
}

fn machine() -> Machine {
    let read = |path: &str, key: &str| {
        let text = std::fs::read_to_string(path).ok()?;
        let line = text.lines().find(|line| line.starts_with(key))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    };
    let kib = read("/proc/meminfo", "MemTotal").and_then(|words| words.split(' ').next()?.parse::<f64>().ok());
    Machine {
        processor: read("/proc/cpuinfo", "model name").unwrap_or_else(|| "unknown".to_owned()),
        threads: rayon::current_num_threads(),
        memory_gib: kib.map(|kib| kib / f64::from(1 << 20)),
        system: format!("{}, {}", std::env::consts::OS, std::env::consts::ARCH),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_source_named_is_there() {
        let root = workspace_root();
        for path in SOURCES.iter().chain(&BESIDES) {
            assert!(root.join(path).exists(), "{path} has moved");
        }
    }

    #[test]
    fn figures_depend_on_the_simulator_and_not_on_how_reports_look() {
        let mut files = Vec::new();
        SOURCES.iter().for_each(|source| collect(&workspace_root(), source, &mut files).unwrap());
        for file in
            ["strand-sim/src/step.rs", "bench/src/measures.rs", "bench/scenes/salon.toml", "xtask/src/pipeline.rs"]
        {
            assert!(files.iter().any(|f| f == file), "{file} counts");
        }
        assert!(files.iter().all(|f| !f.contains("report/style.css") && !f.ends_with("tidy.rs")));
    }
}
