//! A report's files: the page, Markdown, JSON, pictures and plots, each whole or not at all.

use super::kept::{PICTURES, REPORT};
use crate::report::write_beside;
use anyhow::{Context, Result};
use hair_bench::evidence::Picture;
use hair_bench::report::{PictureBytes, Report, html, json, markdown, svg_file};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Pictures up to this size are within the page as a rule, larger ones beside it, bytes.
pub const WITHIN: usize = 200_000;

/// Writes the report into a folder; `from` is where each section's pictures lie now. Those of up to `within_bytes` go into the page.
///
/// # Errors
/// A file that cannot be read or written.
pub fn write(report: &Report, from: &[Option<PathBuf>], to: &Path, within_bytes: usize) -> Result<()> {
    for folder in [PICTURES, "plots"].map(|name| to.join(name)) {
        std::fs::create_dir_all(&folder).with_context(|| format!("creating {}", folder.display()))?;
    }
    let mut within = BTreeMap::new();
    for (section, folder) in report.sections.iter().zip(from) {
        let Some(findings) = section.findings() else { continue };
        for picture in &findings.pictures {
            let Some(folder) = folder else { continue };
            let Ok(bytes) = std::fs::read(folder.join(&picture.file)) else { continue };
            write_beside(&to.join(&picture.file), &bytes)?;
            within.insert(picture.file.clone(), bytes);
        }
        for (k, plot) in findings.plots.iter().enumerate() {
            let name = format!("plots/{}-{}.svg", section.name, k + 1);
            write_beside(&to.join(name), svg_file(plot).as_bytes())?;
        }
    }
    let place = |picture: &Picture| match within.get(&picture.file) {
        Some(bytes) if bytes.len() <= within_bytes => PictureBytes::Within(bytes.clone()),
        Some(_) => PictureBytes::Beside,
        None => PictureBytes::Missing,
    };
    write_beside(&to.join(REPORT), json(report)?.as_bytes())?;
    write_beside(&to.join("report.md"), markdown(report).as_bytes())?;
    write_beside(&to.join("report.html"), html(report, &place).as_bytes())
}
