//! The report as Markdown: the same text, tables and claims as the page, for those who read it in a terminal or a repository.
//!
//! Plots and pictures are linked as files beside it: plot `k` (from 1) of experiment `e` is `plots/e-k.svg`.

use super::words::{
    counted, date_words, duration_words, measured_words, memory_words, shown, size_words, verdict_words,
};
use super::{Outcome, Report};
use crate::evidence::{Findings, Table};
use std::fmt::Write;

/// The report as Markdown.
#[must_use]
pub fn markdown(report: &Report) -> String {
    let mut out = String::from("# Adaptive hair skinning\n\n");
    let about = &report.about;
    let _ = writeln!(
        out,
        "Report of `{}`, {}; {}. What the papers AS16 (Chai, Zheng, Zhou 2016) and MS08 (Selle, Lentine, Fedkiw 2008) claim, beside \
         what this program does.\n",
        about.command.replace('`', "'"),
        date_words(about.written_s),
        size_words(about.size)
    );
    let told: Vec<String> =
        report.verdicts().iter().map(|(verdict, n)| format!("{n} {}", verdict_words(*verdict))).collect();
    let _ = writeln!(out, "{}: {}.\n", counted(report.claims().count(), "claim"), told.join(", "));
    for note in &about.notes {
        let _ = writeln!(out, "> {}\n", escaped(note));
    }
    for (section, why) in report.failed() {
        let _ = writeln!(out, "> {} broke off: {}\n", escaped(&section.title), escaped(why));
    }
    let highlights = report.sections.iter().filter_map(|s| s.findings()).flat_map(|f| &f.highlights);
    let highlights: String = highlights.map(|h| format!("- {}\n", escaped(h))).collect();
    if !highlights.is_empty() {
        let _ = writeln!(out, "{highlights}");
    }
    if report.claims().next().is_some() {
        out.push_str("| verdict | claim | source | the paper | here |\n| --- | --- | --- | --- | --- |\n");
        for (_, c) in report.claims() {
            let fields = [verdict_words(c.verdict), &c.claim, &c.source, &c.paper, &c.ours].map(field);
            let _ = writeln!(out, "| {} |", fields.join(" | "));
        }
        out.push('\n');
    }
    for (k, section) in report.sections.iter().enumerate() {
        let _ = writeln!(out, "## {}. {}\n\n{}\n", k + 1, escaped(&section.title), escaped(&section.source));
        match &section.outcome {
            Outcome::Failed { why } => {
                let _ = writeln!(out, "Broke off: {}\n", escaped(why));
            }
            Outcome::Found { findings, made } => {
                if made.outdated {
                    let _ = writeln!(out, "> Kept from {}: the program has changed since.\n", escaped(&made.commit));
                }
                let (wall, cpu) = (duration_words(made.seconds), duration_words(made.cpu_seconds));
                write_findings(&mut out, &section.name, findings);
                let _ = writeln!(out, "Took {wall}, {cpu} of CPU.\n");
            }
        }
    }
    let machine = &about.machine;
    let _ = writeln!(
        out,
        "## About this run\n\n- version: {}\n- processor: {}, {}\n- memory: {}\n- system: {}",
        escaped(&about.commit),
        escaped(&machine.processor),
        counted(machine.threads, "thread"),
        memory_words(machine),
        escaped(&machine.system)
    );
    out
}

fn write_findings(out: &mut String, experiment: &str, findings: &Findings) {
    for paragraph in &findings.paragraphs {
        let _ = writeln!(out, "{}\n", escaped(paragraph));
    }
    for c in &findings.claims {
        let why = if c.why.trim().is_empty() { String::new() } else { format!(" {}", escaped(&c.why)) };
        let _ = writeln!(
            out,
            "- **{}**: {} ({}). The paper: {}. Here: {}.{why}",
            verdict_words(c.verdict),
            escaped(&c.claim),
            escaped(&c.source),
            field(&c.paper),
            field(&c.ours)
        );
    }
    if !findings.claims.is_empty() {
        out.push('\n');
    }
    for picture in &findings.pictures {
        let _ = writeln!(out, "![{}]({})\n", escaped(&picture.caption), picture.file.replace(' ', "%20"));
    }
    for (k, plot) in findings.plots.iter().enumerate() {
        let _ = writeln!(out, "![{}](plots/{experiment}-{}.svg)\n", escaped(&plot.title), k + 1);
    }
    findings.tables.iter().for_each(|t| write_table(out, t));
    if !findings.measures.is_empty() {
        out.push_str("| measure | value | unit | better |\n| --- | ---: | --- | --- |\n");
        for m in &findings.measures {
            let better = if m.better == crate::evidence::Better::Lower { "less" } else { "more" };
            let _ =
                writeln!(out, "| {} | {} | {} | {better} |", field(&m.name), measured_words(m.value), field(&m.unit));
        }
        out.push('\n');
    }
}

fn write_table(out: &mut String, table: &Table) {
    let _ = writeln!(out, "**{}**\n", escaped(&table.title));
    let names: Vec<String> = table.columns.iter().map(|c| field(c)).collect();
    let _ = writeln!(out, "| {} |\n|{}", names.join(" | "), " --- |".repeat(names.len()));
    for row in &table.rows {
        let fields: Vec<String> = row.iter().map(|cell| field(&shown(cell))).collect();
        let _ = writeln!(out, "| {} |", fields.join(" | "));
    }
    out.push('\n');
    if !table.note.is_empty() {
        let _ = writeln!(out, "{}\n", escaped(&table.note));
    }
}

/// Text of one field of a table: never empty.
fn field(text: &str) -> String {
    if text.trim().is_empty() { "–".to_owned() } else { escaped(text) }
}

/// Text that shows as it is, on one line.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '\\' | '`' | '*' | '_' | '[' | ']' | '|' | '#' => {
                out.push('\\');
                out.push(c);
            }
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '&' => out.push_str("&amp;"),
            c if c.is_whitespace() || c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}
