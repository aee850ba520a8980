//! What `cargo xtask tidy` checks: the rules of ARCHITECTURE.md that no compiler enforces.
//!
//! Every violation is reported with file and line, none is fixed. The same checks run as a test of `hair-tests`, which is
//! why this file knows nothing of the command line. Files are found by walking the workspace: build output, results and
//! hidden folders other than `.ci` and `.cargo` are not part of it.

use anyhow::Context;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A rule broken at a place.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Violation {
    /// File, relative to the workspace.
    pub file: PathBuf,
    /// Line, from 1.
    pub line: usize,
    /// What is wrong and what to do.
    pub what: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.file.display(), self.line, self.what)
    }
}

/// A file longer than this holds more than one idea.
const MAX_LINES: usize = 1100;

/// Packages whose code must neither print, exit nor be left unfinished.
const LIBRARIES: [&str; 8] = [
    "io-formats",
    "collision",
    "strand-sim",
    "skinning-train",
    "adaptive-runtime",
    "adaptive-runtime-c",
    "bench",
    "viewer",
];

/// Packages that see neither files nor folders.
const FILE_FREE: [&str; 4] = ["collision", "strand-sim", "adaptive-runtime", "adaptive-runtime-c"];

/// Every package with the packages of the workspace it may depend on, development dependencies included.
const MAY_DEPEND_ON: [(&str, &[&str]); 10] = [
    ("io-formats", &[]),
    ("collision", &[]),
    ("strand-sim", &["collision"]),
    ("skinning-train", &["io-formats"]),
    ("adaptive-runtime", &["collision", "io-formats", "strand-sim"]),
    ("hair-viewer", &[]),
    ("hair-bench", &["adaptive-runtime", "collision", "hair-viewer", "io-formats", "skinning-train", "strand-sim"]),
    (
        "xtask",
        &["adaptive-runtime", "collision", "hair-bench", "hair-viewer", "io-formats", "skinning-train", "strand-sim"],
    ),
    ("hair-tests", &["adaptive-runtime", "collision", "hair-bench", "io-formats", "skinning-train", "strand-sim"]),
    // Its tests take the models made by hand.
    ("adaptive-runtime-c", &["adaptive-runtime", "collision", "hair-tests", "io-formats"]),
];

/// Checks the workspace at `root`; violations are ordered by file and line.
///
/// # Errors
/// When a file cannot be read or `cargo metadata` fails.
pub fn check(root: &Path) -> anyhow::Result<Vec<Violation>> {
    let mut out = Vec::new();
    for path in files(root)? {
        let Ok(text) = std::fs::read_to_string(root.join(&path)) else {
            // Not text: a picture or a fixture.
            continue;
        };
        let mut report = |line: usize, what: String| out.push(Violation { file: path.clone(), line, what });
        check_paths(&text, &mut report);
        if path.extension().is_some_and(|e| e == "rs") {
            check_source(&path, &text, &mut report);
        }
    }
    check_dependencies(root, &mut out)?;
    out.sort();
    Ok(out)
}

/// All files of the workspace, relative to `root`, in order.
///
/// # Errors
/// When a folder cannot be read.
pub fn files(root: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut out = Vec::new();
    let mut folders = vec![PathBuf::new()];
    while let Some(folder) = folders.pop() {
        let at = root.join(&folder);
        for entry in std::fs::read_dir(&at).with_context(|| format!("listing {}", at.display()))? {
            let entry = entry.with_context(|| format!("listing {}", at.display()))?;
            let name = entry.file_name();
            let name = name.to_string_lossy();
            let path = folder.join(&*name);
            let kind = entry.file_type().with_context(|| format!("looking at {}", path.display()))?;
            let hidden = name.starts_with('.') && name != ".ci" && name != ".cargo";
            let output = folder.as_os_str().is_empty() && (name == "target" || name == "out");
            if kind.is_dir() && !hidden && !output {
                folders.push(path);
            } else if kind.is_file() && name != ".git" {
                // A file of that name is how a second working tree finds its repository.
                out.push(path);
            }
        }
    }
    out.sort();
    Ok(out)
}

/// Paths that exist on one machine only.
fn check_paths(text: &str, report: &mut impl FnMut(usize, String)) {
    // Put together here, so that this file does not accuse itself.
    const ROOTS: [&str; 5] = [
        concat!("/", "home/"),
        concat!("/", "root/"),
        concat!("/", "work/"),
        concat!("/", "tmp/"),
        concat!("/", "Users/"),
    ];
    for (k, line) in text.lines().enumerate() {
        for root in ROOTS {
            let starts_path =
                |at: usize| !line[..at].chars().next_back().is_some_and(|c| c.is_alphanumeric() || "./_-".contains(c));
            if line.match_indices(root).any(|(at, _)| starts_path(at)) {
                report(k + 1, format!("names {root}, which is one machine's; use a path relative to the workspace"));
            }
        }
    }
}

fn check_source(path: &Path, text: &str, report: &mut impl FnMut(usize, String)) {
    if !text.starts_with("//!") {
        report(1, "does not open with `//!`; say what the file computes and what is invariant".to_owned());
    }
    let n_lines = text.lines().count();
    if n_lines > MAX_LINES {
        report(MAX_LINES, format!("has {n_lines} lines, more than {MAX_LINES}; look for the second idea"));
    }
    for (k, line) in text.lines().enumerate() {
        if line.ends_with([' ', '\t', '\r']) {
            report(k + 1, "has white space at the end".to_owned());
        }
        if line.contains('\t') {
            report(k + 1, "has a tab; indent with spaces".to_owned());
        }
    }
    check_unsafe(text, report);
    let mut parts = path.components().map(|c| c.as_os_str().to_string_lossy());
    let (package, room) = (parts.next().unwrap_or_default(), parts.next().unwrap_or_default());
    if room == "src" && LIBRARIES.contains(&&*package) {
        check_library(text, FILE_FREE.contains(&&*package), report);
    }
}

fn check_unsafe(text: &str, report: &mut impl FnMut(usize, String)) {
    const FORMS: [&str; 3] = [concat!("unsafe", " {"), concat!("unsafe", " fn"), concat!("unsafe", " impl")];
    let says_why = text.contains("allow(unsafe_code, reason");
    for (k, line) in code_lines(text) {
        if !says_why && FORMS.iter().any(|form| line.contains(form)) {
            report(
                k,
                "is unsafe in a file that does not say why; add `#![allow(unsafe_code, reason = ...)]`".to_owned(),
            );
        }
    }
}

fn check_library(text: &str, file_free: bool, report: &mut impl FnMut(usize, String)) {
    const FORBIDDEN: [(&str, &str); 4] = [
        ("println!", "prints; emit `tracing` events"),
        ("process::exit", "ends the process; return an error"),
        ("todo!", "is unfinished"),
        ("unimplemented!", "is unfinished"),
    ];
    let tests_from = text.lines().position(|l| l.trim() == "#[cfg(test)]").map_or(usize::MAX, |k| {
        // An attribute of one item does not end the library; one of a module does.
        if text.lines().nth(k + 1).is_some_and(|l| l.trim_start().starts_with("mod ")) { k } else { usize::MAX }
    });
    for (k, line) in code_lines(text).filter(|&(k, _)| k <= tests_from) {
        for (token, why) in FORBIDDEN {
            if line.contains(token) {
                report(k, format!("{token} in a library {why}"));
            }
        }
        if file_free && (line.contains("std::fs") || line.contains("File::")) {
            report(k, "touches files; only io-formats, bench and the programs do".to_owned());
        }
    }
}

/// Lines that are not comments, numbered from 1.
fn code_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().map(|(k, line)| (k + 1, line)).filter(|(_, line)| !line.trim_start().starts_with("//"))
}

/// Whether package `of` may depend on `to`; packages of others are not our concern here.
fn may_depend(of: &str, to: &str) -> bool {
    let ours = MAY_DEPEND_ON.iter().any(|(name, _)| *name == to);
    !ours || MAY_DEPEND_ON.iter().any(|(name, allowed)| *name == of && allowed.contains(&to))
}

fn check_dependencies(root: &Path, out: &mut Vec<Violation>) -> anyhow::Result<()> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let answer = Command::new(cargo)
        .args(["metadata", "--no-deps", "--offline", "--format-version", "1"])
        .current_dir(root)
        .output()
        .context("running cargo metadata")?;
    anyhow::ensure!(
        answer.status.success(),
        "cargo metadata failed: {}",
        String::from_utf8_lossy(&answer.stderr).trim()
    );
    let metadata: serde_json::Value = serde_json::from_slice(&answer.stdout).context("reading cargo metadata")?;
    let packages = metadata["packages"].as_array().context("cargo metadata lists no packages")?;
    for package in packages {
        let name = package["name"].as_str().unwrap_or_default();
        let manifest = Path::new(package["manifest_path"].as_str().unwrap_or_default());
        let file = manifest.strip_prefix(root).unwrap_or(manifest).to_path_buf();
        let text = std::fs::read_to_string(manifest).with_context(|| format!("reading {}", manifest.display()))?;
        let line_of = |what: &str| text.lines().position(|l| l.starts_with(what)).map_or(1, |k| k + 1);
        if !MAY_DEPEND_ON.iter().any(|(of, _)| *of == name) {
            let what =
                format!("package {name} has no place in the dependency rules; give it one, and in ARCHITECTURE.md");
            out.push(Violation { file, line: line_of("name"), what });
            continue;
        }
        for dependency in package["dependencies"].as_array().into_iter().flatten() {
            let to = dependency["name"].as_str().unwrap_or_default();
            if !may_depend(name, to) {
                let what = format!("{name} must not depend on {to} (ARCHITECTURE.md, who may depend on whom)");
                out.push(Violation { file: file.clone(), line: line_of(to), what });
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod unit {
    use super::*;

    fn complaints(check: impl FnOnce(&mut dyn FnMut(usize, String))) -> Vec<(usize, String)> {
        let mut out = Vec::new();
        check(&mut |line, what| out.push((line, what)));
        out
    }

    fn lines(path: &str, text: &str) -> Vec<usize> {
        complaints(|mut report| check_source(Path::new(path), text, &mut report))
            .into_iter()
            .map(|(line, _)| line)
            .collect()
    }

    #[test]
    fn a_file_without_a_header_is_found() {
        assert_eq!(lines("collision/src/x.rs", "fn x() {}\n"), [1]);
        assert!(lines("collision/src/x.rs", "//! X.\nfn x() {}\n").is_empty());
    }

    #[test]
    fn prints_count_in_libraries_but_not_in_their_tests_or_comments() {
        let text = concat!(
            "//! X.\n// print",
            "ln!\nfn x() { print",
            "ln!(); }\n#[cfg(test)]\nmod tests { print",
            "ln!() }\n"
        );
        assert_eq!(lines("collision/src/x.rs", text), [3]);
        assert!(lines("xtask/src/x.rs", text).is_empty());
        assert!(lines("collision/examples/x.rs", text).is_empty());
    }

    #[test]
    fn white_space_at_the_end_and_tabs_are_found() {
        assert_eq!(lines("tests/src/x.rs", "//! X. \nfn x() {}\n\tfn y() {}\n"), [1, 3]);
    }

    #[test]
    fn paths_of_one_machine_are_found_and_relative_ones_are_not() {
        let text = concat!("see /", "home/me\nsee ../shared/", "work/x and https://a/", "root/b\n");
        assert_eq!(complaints(|mut report| check_paths(text, &mut report)).len(), 1);
    }

    #[test]
    fn runtime_and_trainer_do_not_know_each_other() {
        assert!(!may_depend("adaptive-runtime", "skinning-train") && !may_depend("skinning-train", "adaptive-runtime"));
        assert!(!may_depend("strand-sim", "io-formats") && !may_depend("collision", "strand-sim"));
        assert!(may_depend("xtask", "hair-bench") && may_depend("collision", "nalgebra"));
    }

    #[test]
    fn the_rules_have_no_circle() {
        // Packages are listed so that each depends on those before it only.
        for (k, (_, allowed)) in MAY_DEPEND_ON.iter().enumerate() {
            let before = |to: &&&str| MAY_DEPEND_ON[..k].iter().any(|(name, _)| name == *to);
            assert_eq!(allowed.iter().filter(before).count(), allowed.len());
        }
    }
}
