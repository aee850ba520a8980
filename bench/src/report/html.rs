//! The report as one page: a summary first, then every claim with its verdict, then a section for each experiment.
//!
//! It works without scripts and without a network, on a telephone, on paper and read aloud: tables have captions and headers, plots
//! and pictures say what they show, and wide tables scroll by themselves. Pictures are within the page where the caller gives
//! their bytes, else beside it.

use super::html_parts::{anchor, base64, escaped, table};
use super::plot::{COLOURS, STYLE, svg};
use super::words::{
    counted, date_words, duration_words, measured_words, memory_words, size_words, verdict_class, verdict_words,
    verdicts_words,
};
use super::{Made, Outcome, Report, Section};
use crate::evidence::{Claim, Findings, Picture, Verdict};
use std::fmt::Write;

/// Where a picture of the report is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PictureBytes {
    /// Within the page: a PNG file's bytes.
    Within(Vec<u8>),
    /// In a file beside it, at the path the picture names.
    Beside,
    /// Nowhere: the page says so.
    Missing,
}

/// The report as a page; `picture` says where each picture's file is.
#[must_use]
pub fn html(report: &Report, picture: &dyn Fn(&Picture) -> PictureBytes) -> String {
    let mut out = String::new();
    let title = "Adaptive hair skinning: what it does, and how well";
    let _ = write!(
        out,
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"><title>{title}</title>\
         <style>{}{STYLE}{COLOURS}{}</style></head><body>",
        include_str!("style.css"),
        include_str!("dark.css")
    );
    let about = &report.about;
    let _ = write!(
        out,
        "<header><p class=\"kicker\">Report of <code>{}</code></p><h1>Adaptive hair skinning</h1>\
         <p class=\"lead\">A full head of hair, combed while it is simulated. A few hundred <em>guide</em> hairs are simulated; every \
         other hair is interpolated from guides chosen anew at each step, so that hair splits around a comb or a hand instead of \
         being dragged through it, and hair that touches a solid pushes back on its guides. This program implements the method of \
         Chai, Zheng and Zhou (2016, <b>AS16</b> below) on the strands of Selle, Lentine and Fedkiw (2008, <b>MS08</b>). \
         This page holds what the two papers claim beside what the program does: every figure of ours comes from the run described \
         <a href=\"#about\">at its end</a>.</p></header><main>",
        escaped(&about.command)
    );
    summary(&mut out, report);
    contents(&mut out, report);
    for (k, section) in report.sections.iter().enumerate() {
        write_section(&mut out, k + 1, section, picture);
    }
    write_about(&mut out, report);
    out.push_str("</main></body></html>\n");
    out
}

fn badge(out: &mut String, verdict: Verdict) {
    let mark = match verdict {
        Verdict::Reproduced => "✓",
        Verdict::InPart => "◐",
        Verdict::NotReproduced => "✗",
        Verdict::NotTested => "·",
    };
    let _ = write!(
        out,
        "<span class=\"verdict {}\"><span aria-hidden=\"true\">{mark}</span> {}</span>",
        verdict_class(verdict),
        verdict_words(verdict)
    );
}

fn summary(out: &mut String, report: &Report) {
    out.push_str("<section id=\"summary\"><h2>In short</h2>");
    let n_claims = report.claims().count();
    let n_found = report.sections.iter().filter(|s| s.findings().is_some()).count();
    let verdicts = report.verdicts();
    let _ =
        write!(out, "<p>{} looked at {} of the papers.", counted(n_found, "experiment"), counted(n_claims, "claim"));
    if n_claims > 0 {
        let told: Vec<String> =
            verdicts.iter().filter(|(_, n)| *n > 0).map(|(verdict, n)| verdicts_words(*verdict, *n)).collect();
        let _ = write!(out, " On the scenes of this run {}.", told.join(", "));
    }
    let _ = write!(out, " Its size is {}.</p>", size_words(report.about.size));
    if n_claims > 0 {
        out.push_str("<div class=\"bar\" aria-hidden=\"true\">");
        for (verdict, n) in verdicts.iter().filter(|(_, n)| *n > 0) {
            let _ = write!(out, "<span class=\"{}\" style=\"flex-grow:{n}\">{n}</span>", verdict_class(*verdict));
        }
        out.push_str("</div>");
    }
    for note in &report.about.notes {
        let _ = write!(out, "<p class=\"warn\">{}</p>", escaped(note));
    }
    for (section, why) in report.failed() {
        let _ = write!(
            out,
            "<p class=\"warn\"><a href=\"#{}\">{}</a> broke off: {}</p>",
            anchor(&section.name),
            escaped(&section.title),
            escaped(why)
        );
    }
    let highlights: Vec<_> = report
        .sections
        .iter()
        .flat_map(|s| s.findings().into_iter().flat_map(move |f| f.highlights.iter().map(move |h| (s, h))))
        .collect();
    if !highlights.is_empty() {
        out.push_str("<ul class=\"highlights\">");
        for (section, words) in highlights {
            let _ = write!(
                out,
                "<li>{} <a class=\"see\" href=\"#{}\">{}</a></li>",
                escaped(words),
                anchor(&section.name),
                escaped(&section.title)
            );
        }
        out.push_str("</ul>");
    }
    if n_claims > 0 {
        claims_table(out, report);
    }
    out.push_str("</section>");
}

/// Every claim in one table; on a narrow screen each becomes a card.
fn claims_table(out: &mut String, report: &Report) {
    out.push_str(
        "<table class=\"claims\"><caption>Every claim looked at</caption><thead><tr><th scope=\"col\">Verdict</th>\
         <th scope=\"col\">Claim</th><th scope=\"col\">The paper</th><th scope=\"col\">Here</th></tr></thead>",
    );
    for section in report.sections.iter().filter(|s| !s.claims().is_empty()) {
        let _ = write!(
            out,
            "<tbody><tr class=\"group\"><th scope=\"rowgroup\" colspan=\"4\"><a href=\"#{}\">{}</a></th></tr>",
            anchor(&section.name),
            escaped(&section.title)
        );
        section.claims().iter().for_each(|claim| claim_row(out, claim));
        out.push_str("</tbody>");
    }
    out.push_str("</table>");
}

fn claim_row(out: &mut String, claim: &Claim) {
    out.push_str("<tr><td>");
    badge(out, claim.verdict);
    let _ = write!(
        out,
        "</td><th scope=\"row\">{} <span class=\"see\">{}</span></th><td data-label=\"The paper\">{}</td>\
             <td data-label=\"Here\">{}</td></tr>",
        escaped(&claim.claim),
        escaped(&claim.source),
        or_dash(&claim.paper),
        or_dash(&claim.ours)
    );
}

fn or_dash(text: &str) -> String {
    if text.trim().is_empty() { "–".to_owned() } else { escaped(text) }
}

fn contents(out: &mut String, report: &Report) {
    if report.sections.is_empty() {
        return;
    }
    out.push_str("<nav aria-label=\"Contents\"><h2>Contents</h2><ol>");
    for section in &report.sections {
        let _ = write!(
            out,
            "<li><a href=\"#{}\">{}</a> <span class=\"source\">{}</span></li>",
            anchor(&section.name),
            escaped(&section.title),
            escaped(&section.source)
        );
    }
    out.push_str("</ol></nav>");
}

fn write_section(out: &mut String, number: usize, section: &Section, picture: &dyn Fn(&Picture) -> PictureBytes) {
    let _ = write!(
        out,
        "<section id=\"{}\" class=\"experiment\"><h2><span class=\"number\">{number}</span> {}</h2><p class=\"source\">{}",
        anchor(&section.name),
        escaped(&section.title),
        escaped(&section.source)
    );
    match &section.outcome {
        Outcome::Failed { why } => {
            let _ = write!(out, "</p><p class=\"warn\">Broke off: {}</p>", escaped(why));
        }
        Outcome::Found { findings, made } => {
            let _ = write!(out, " <span class=\"cost\">{}</span></p>", escaped(&cost_words(made)));
            if made.outdated {
                let _ = write!(
                    out,
                    "<p class=\"warn\">Kept from {}, made {}: the program has changed since.</p>",
                    escaped(&made.commit),
                    date_words(made.at_s)
                );
            }
            write_findings(out, findings, picture);
        }
    }
    out.push_str("</section>");
}

/// What a section cost, in words.
fn cost_words(made: &Made) -> String {
    format!("took {}, {} of CPU", duration_words(made.seconds), duration_words(made.cpu_seconds))
}

fn write_findings(out: &mut String, findings: &Findings, picture: &dyn Fn(&Picture) -> PictureBytes) {
    for paragraph in &findings.paragraphs {
        let _ = write!(out, "<p>{}</p>", escaped(paragraph));
    }
    if !findings.claims.is_empty() {
        out.push_str("<div class=\"verdicts\">");
        findings.claims.iter().for_each(|claim| write_claim(out, claim));
        out.push_str("</div>");
    }
    pictures(out, &findings.pictures, picture);
    if !findings.plots.is_empty() {
        out.push_str("<div class=\"plots\">");
        for plot in &findings.plots {
            let _ = write!(
                out,
                "<figure class=\"curves\"><figcaption>{}</figcaption>{}</figure>",
                escaped(&plot.title),
                svg(plot, None)
            );
        }
        out.push_str("</div>");
    }
    findings.tables.iter().for_each(|t| table(out, t));
    if !findings.measures.is_empty() {
        measures(out, findings);
    }
}

fn write_claim(out: &mut String, claim: &Claim) {
    out.push_str("<div class=\"claim\"><p>");
    badge(out, claim.verdict);
    let _ = write!(out, " {} <span class=\"source\">{}</span></p>", escaped(&claim.claim), escaped(&claim.source));
    let _ = write!(
        out,
        "<dl><dt>The paper</dt><dd>{}</dd><dt>Here</dt><dd>{}</dd>",
        or_dash(&claim.paper),
        or_dash(&claim.ours)
    );
    if !claim.why.trim().is_empty() {
        let _ = write!(out, "<dt>Note</dt><dd>{}</dd>", escaped(&claim.why));
    }
    out.push_str("</dl></div>");
}

/// Pictures whose rows have the same name stand side by side.
fn pictures(out: &mut String, pictures: &[Picture], place: &dyn Fn(&Picture) -> PictureBytes) {
    for row in pictures.chunk_by(|a, b| a.row == b.row) {
        let _ = write!(out, "<div class=\"row\" style=\"--n:{}\">", row.len());
        for picture in row {
            out.push_str("<figure class=\"picture\">");
            let alt = escaped(&picture.caption);
            let _ = match place(picture) {
                PictureBytes::Within(bytes) => write!(
                    out,
                    "<img loading=\"lazy\" alt=\"{alt}\" src=\"data:image/png;base64,{}\"{}>",
                    base64(&bytes),
                    size_of(&bytes)
                ),
                PictureBytes::Beside => {
                    write!(out, "<img loading=\"lazy\" alt=\"{alt}\" src=\"{}\">", escaped(&picture.file))
                }
                PictureBytes::Missing => {
                    write!(
                        out,
                        "<p class=\"missing\" role=\"img\" aria-label=\"{alt}\">no picture: {} is not there</p>",
                        escaped(&picture.file)
                    )
                }
            };
            let _ = write!(out, "<figcaption>{alt}</figcaption></figure>");
        }
        out.push_str("</div>");
    }
}

/// Width and height of a PNG file as attributes, so that nothing moves while pictures appear.
fn size_of(png: &[u8]) -> String {
    let number = |from: usize| png.get(from..from + 4).and_then(|b| b.try_into().ok()).map(u32::from_be_bytes);
    match (png.get(12..16), number(16), number(20)) {
        (Some(b"IHDR"), Some(width), Some(height)) => format!(" width=\"{width}\" height=\"{height}\""),
        _ => String::new(),
    }
}

fn measures(out: &mut String, findings: &Findings) {
    let _ = write!(
        out,
        "<details><summary>{} watched from version to version</summary><div class=\"scroll\" role=\"region\" tabindex=\"0\" \
         aria-label=\"Measures\"><table class=\"measures\"><thead><tr><th scope=\"col\">Measure</th>\
         <th scope=\"col\" class=\"n\">Value</th><th scope=\"col\">Unit</th><th scope=\"col\">Better</th></tr></thead><tbody>",
        counted(findings.measures.len(), "measure")
    );
    for m in &findings.measures {
        let _ = write!(
            out,
            "<tr><th scope=\"row\">{}</th><td class=\"n\">{}</td><td>{}</td><td>{}</td></tr>",
            escaped(&m.name),
            measured_words(m.value),
            or_dash(&m.unit),
            if m.better == crate::evidence::Better::Lower { "less" } else { "more" }
        );
    }
    out.push_str("</tbody></table></div></details>");
}

fn write_about(out: &mut String, report: &Report) {
    let about = &report.about;
    let machine = &about.machine;
    let total = |of: fn(&Made) -> f64| -> f64 {
        let made = report.sections.iter().filter_map(|s| match &s.outcome {
            Outcome::Found { made, .. } => Some(made),
            Outcome::Failed { .. } => None,
        });
        made.map(of).sum()
    };
    out.push_str("<section id=\"about\"><h2>About this run</h2><dl class=\"about\">");
    let rows = [
        ("Command", about.command.clone()),
        ("Version", about.commit.clone()),
        ("Written", date_words(about.written_s)),
        ("Size", size_words(about.size).to_owned()),
        ("Processor", format!("{}, {}", machine.processor, counted(machine.threads, "thread"))),
        ("Memory", memory_words(machine)),
        ("System", machine.system.clone()),
        (
            "Experiments took",
            format!(
                "{}, {} of CPU without what the renderer took",
                duration_words(total(|m| m.seconds)),
                duration_words(total(|m| m.cpu_seconds))
            ),
        ),
    ];
    for (name, words) in rows {
        let _ = write!(out, "<dt>{name}</dt><dd>{}</dd>", escaped(&words));
    }
    let mut drawn: Vec<&str> = Vec::new();
    for section in &report.sections {
        if let Outcome::Found { made, .. } = &section.outcome
            && !made.drawn_by.is_empty()
            && !drawn.contains(&made.drawn_by.as_str())
        {
            drawn.push(&made.drawn_by);
        }
    }
    if !drawn.is_empty() {
        let _ = write!(out, "<dt>Pictures drawn by</dt><dd>{}</dd>", escaped(&drawn.join("; ")));
    }
    out.push_str(
        "</dl><p class=\"note\">The same tables are in <code>report.md</code>, every number with all its digits in \
         <code>report.json</code>, beside this page.</p></section>",
    );
}
