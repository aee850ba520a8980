//! Where the papers' equations live: collects the "Implements ..." lines of doc comments into docs/PAPER_MAP.md.
//!
//! A numbered equation has one home: the function whose doc names paper and number together. An algorithm may be split by
//! line range. The form is fixed, `/// Implements AS16 Eq. (4), ...`; several references may share one sentence, and a
//! number without a paper belongs to the paper named before it.

use crate::tidy::files;
use anyhow::Context;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The map's file, relative to the workspace.
const MAP: &str = "docs/PAPER_MAP.md";

/// Papers by their keys.
const PAPERS: [&str; 4] = ["AS16", "MS08", "NI20", "LOD03"];

/// What must have a home. AS16 Eq. (1) is superseded by Eq. (5) in the paper itself.
const REQUIRED: [(&str, Item); 11] = [
    ("AS16", Item::Equation(2)),
    ("AS16", Item::Equation(3)),
    ("AS16", Item::Equation(4)),
    ("AS16", Item::Equation(5)),
    ("AS16", Item::Equation(6)),
    ("AS16", Item::Equation(7)),
    ("AS16", Item::Equation(8)),
    ("AS16", Item::Equation(9)),
    ("AS16", Item::Equation(10)),
    ("AS16", Item::Algorithm(1)),
    ("AS16", Item::Algorithm(2)),
];

/// Something a paper numbers.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Item {
    /// A section: may have many homes.
    Section(String),
    /// An equation: one home.
    Equation(u32),
    /// An algorithm: one home, or several with line ranges that do not meet.
    Algorithm(u32),
}

impl std::fmt::Display for Item {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Section(number) => write!(f, "§{number}"),
            Self::Equation(number) => write!(f, "Eq. ({number})"),
            Self::Algorithm(number) => write!(f, "Algorithm {number}"),
        }
    }
}

/// One place that implements an item.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Home {
    /// First and last line of an algorithm, if stated.
    pub lines: Option<(u32, u32)>,
    /// File, relative to the workspace.
    pub file: PathBuf,
    /// Function or type.
    pub function: String,
    /// The whole sentence.
    pub says: String,
}

/// All homes, by paper and item.
#[derive(Debug, Default)]
pub struct PaperMap {
    homes: BTreeMap<(String, Item), Vec<Home>>,
}

/// Reads every source file of the workspace.
///
/// # Errors
/// When a file cannot be read.
pub fn collect(root: &Path) -> anyhow::Result<PaperMap> {
    let mut map = PaperMap::default();
    for path in files(root)?.into_iter().filter(|p| p.extension().is_some_and(|e| e == "rs")) {
        let text = std::fs::read_to_string(root.join(&path)).with_context(|| format!("reading {}", path.display()))?;
        map.add_file(&path, &text);
    }
    Ok(map)
}

impl PaperMap {
    /// Homes in all.
    pub fn n_homes(&self) -> usize {
        self.homes.values().map(Vec::len).sum()
    }

    /// Writes docs/PAPER_MAP.md; returns its path.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, root: &Path) -> anyhow::Result<PathBuf> {
        let path = root.join(MAP);
        std::fs::write(&path, self.to_markdown()).with_context(|| format!("writing {MAP}"))?;
        Ok(path)
    }

    /// Everything wrong: required items without a home, equations with two, a stale file.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn complaints(&self, root: &Path) -> anyhow::Result<Vec<String>> {
        let mut out = self.faults();
        let committed = std::fs::read_to_string(root.join(MAP)).with_context(|| format!("reading {MAP}"))?;
        if committed != self.to_markdown() {
            out.push(format!("{MAP}:1: is stale; run `cargo xtask paper-map` and commit the result"));
        }
        Ok(out)
    }

    fn faults(&self) -> Vec<String> {
        let mut out = Vec::new();
        for (paper, item) in REQUIRED {
            if !self.homes.contains_key(&(paper.to_owned(), item.clone())) {
                out.push(format!("{MAP}:1: {paper} {item} has no home; write `/// Implements {paper} {item}` at it"));
            }
        }
        for ((paper, item), homes) in &self.homes {
            for (k, home) in homes.iter().enumerate() {
                let other = homes[..k].iter().find(|other| match item {
                    Item::Section(_) => false,
                    Item::Equation(_) => true,
                    Item::Algorithm(_) => match (home.lines, other.lines) {
                        (Some(a), Some(b)) => a.0 <= b.1 && b.0 <= a.1,
                        _ => true,
                    },
                });
                if let Some(other) = other {
                    out.push(format!(
                        "{}:1: {paper} {item} is implemented by {} and by {} in {}; one home is enough",
                        home.file.display(),
                        home.function,
                        other.function,
                        other.file.display()
                    ));
                }
            }
        }
        out
    }

    fn to_markdown(&self) -> String {
        let mut out = String::from(
            "# Paper map\n\nWhich function implements which equation, algorithm or section. Generated by `cargo xtask paper-map` from\n\
             the `Implements ...` lines of doc comments; do not edit. AS16: Chai et al. 2016. MS08: Selle et al. 2008.\n\n\
             | paper | item | file | function | says |\n| --- | --- | --- | --- | --- |\n",
        );
        for ((paper, item), homes) in &self.homes {
            let mut homes: Vec<_> = homes.iter().collect();
            homes.sort();
            for home in homes {
                let lines = home.lines.map_or(String::new(), |(a, b)| format!(", lines {a}-{b}"));
                let file = home.file.display();
                out += &format!(
                    "| {paper} | {item}{lines} | {file} | `{}` | {} |\n",
                    home.function,
                    home.says.replace('|', "\\|")
                );
            }
        }
        out
    }

    fn add_file(&mut self, path: &Path, text: &str) {
        let lines: Vec<&str> = text.lines().map(str::trim).collect();
        for (k, line) in lines.iter().enumerate() {
            if !line.starts_with("/// Implements ") {
                continue;
            }
            let doc = lines[k..].iter().map_while(|l| l.strip_prefix("///"));
            let words: Vec<&str> = doc.flat_map(str::split_whitespace).collect();
            let says = first_sentence(&words);
            let function = lines[k..].iter().find_map(|l| item_name(l)).unwrap_or_else(|| "?".to_owned());
            for (paper, item, range) in references(&says) {
                let home =
                    Home { lines: range, file: path.to_path_buf(), function: function.clone(), says: says.clone() };
                let homes = self.homes.entry((paper, item)).or_default();
                if !homes.contains(&home) {
                    homes.push(home);
                }
            }
        }
    }
}

/// The words up to the first full stop that ends a sentence and not an abbreviation.
fn first_sentence(words: &[&str]) -> String {
    const ABBREVIATIONS: [&str; 5] = ["Eq.", "Eqs.", "Fig.", "e.g.", "i.e."];
    let ends = |w: &&str| w.ends_with('.') && !ABBREVIATIONS.iter().any(|a| w.trim_start_matches('(') == *a);
    let n = words.iter().position(ends).map_or(words.len(), |k| k + 1);
    words[..n].join(" ").trim_end_matches('.').to_owned()
}

/// Name of the function, type or constant that a line declares.
fn item_name(line: &str) -> Option<String> {
    if line.starts_with("//") || line.starts_with('#') {
        return None;
    }
    let mut words = line.split(|c: char| !(c.is_alphanumeric() || c == '_')).filter(|w| !w.is_empty());
    words.find(|w| ["fn", "struct", "enum", "trait", "const", "type"].contains(w))?;
    words.next().map(str::to_owned)
}

/// Paper, item and, of an algorithm, its lines if stated.
type Reference = (String, Item, Option<(u32, u32)>);

/// What a sentence refers to.
fn references(sentence: &str) -> Vec<Reference> {
    let mut out = Vec::new();
    let mut paper: Option<&str> = None;
    let words: Vec<&str> = sentence.split_whitespace().map(|w| w.trim_end_matches([',', ';', ':'])).collect();
    let mut in_equations = false;
    for (k, word) in words.iter().enumerate() {
        if let Some(key) = PAPERS.iter().find(|key| word == *key) {
            paper = Some(key);
            continue;
        }
        let Some(paper) = paper else { continue };
        if *word == "Eq." || *word == "Eqs." {
            in_equations = true;
        } else if let Some(number) = parenthesised(word).filter(|_| in_equations) {
            out.push((paper.to_owned(), Item::Equation(number), None));
        } else if let Some(section) = word.strip_prefix('§') {
            in_equations = false;
            out.push((paper.to_owned(), Item::Section(section.trim_end_matches('.').to_owned()), None));
        } else if *word == "Algorithm" {
            in_equations = false;
            if let Some(number) = words.get(k + 1).and_then(|w| w.parse().ok()) {
                let range = words.get(k + 2).filter(|w| **w == "lines").and_then(|_| line_range(words.get(k + 3)?));
                out.push((paper.to_owned(), Item::Algorithm(number), range));
            }
        } else if *word != "and" {
            in_equations = false;
        }
    }
    out
}

fn parenthesised(word: &str) -> Option<u32> {
    word.strip_prefix('(')?.strip_suffix(')')?.parse().ok()
}

fn line_range(word: &str) -> Option<(u32, u32)> {
    let (first, last) = word.split_once('-').unwrap_or((word, word));
    Some((first.parse().ok()?, last.parse().ok()?))
}

#[cfg(test)]
mod unit {
    use super::*;

    fn map(text: &str) -> PaperMap {
        let mut map = PaperMap::default();
        map.add_file(Path::new("a/src/b.rs"), text);
        map
    }

    #[test]
    fn several_references_share_a_sentence() {
        let found = references(
            "Implements AS16 Algorithm 1 lines 16-23 and Eq. (3), states by position, weights by AS16 Eq. (6) only",
        );
        let items: Vec<_> = found.iter().map(|(paper, item, range)| format!("{paper} {item} {range:?}")).collect();
        assert_eq!(items, ["AS16 Algorithm 1 Some((16, 23))", "AS16 Eq. (3) None", "AS16 Eq. (6) None"]);
        assert_eq!(references("Implements MS08 §4.1: F = 2")[0].1, Item::Section("4.1".to_owned()));
        assert_eq!(references("Implements AS16 Eqs. (9), (10)").len(), 2);
    }

    #[test]
    fn a_reference_after_the_first_sentence_is_no_home() {
        let map = map(
            "/// Implements AS16 Eq. (2), in the\n/// head frame. Unlike AS16 Eq. (5) it is short.\n#[inline]\npub(crate) fn f() {}\n",
        );
        assert_eq!(map.n_homes(), 1);
        let home = &map.homes[&("AS16".to_owned(), Item::Equation(2))][0];
        assert_eq!((home.function.as_str(), home.says.as_str()), ("f", "Implements AS16 Eq. (2), in the head frame"));
    }

    #[test]
    fn an_equation_with_two_homes_is_a_fault_and_a_section_is_not() {
        let twice = |what: &str| {
            let text = format!("/// Implements AS16 {what}.\nfn f() {{}}\n/// Implements AS16 {what}.\nfn g() {{}}\n");
            map(&text).faults().iter().filter(|c| c.contains("one home is enough")).count()
        };
        assert_eq!(twice("Eq. (2)"), 1);
        assert_eq!(twice("§4.2"), 0);
        assert_eq!(twice("Algorithm 1 lines 1-15"), 1);
    }

    #[test]
    fn line_ranges_that_do_not_meet_share_an_algorithm() {
        let text = "/// Implements AS16 Algorithm 1 lines 1-15.\nfn f() {}\n/// Implements AS16 Algorithm 1 lines 16-23.\nfn g() {}\n";
        assert!(!map(text).faults().iter().any(|c| c.contains("one home")));
    }

    #[test]
    fn a_required_item_without_a_home_is_a_fault() {
        assert_eq!(map("").faults().len(), REQUIRED.len());
    }
}
