//! Laws of reports: the page, Markdown and JSON say the same; nothing but what was found is in them; the same report gives the
//! same bytes.

use super::*;
use crate::evidence::{Better, Measure, Picture, Plot, Table, number, text};

const NASTY: &str = "a <script>alert('x')</script> & \"b\" | `c` *d* [e](f)";

fn claim(verdict: Verdict, claim: &str) -> Claim {
    Claim {
        source: "AS16 §7".to_owned(),
        claim: claim.to_owned(),
        paper: "46 ms".to_owned(),
        ours: NASTY.to_owned(),
        verdict,
        why: String::new(),
    }
}

/// A report with everything in it that can go wrong.
fn report() -> Report {
    let findings = Findings {
        highlights: vec!["Hair stays out of the comb: 0.02 % inside.".to_owned()],
        paragraphs: vec![NASTY.to_owned()],
        tables: vec![Table {
            title: "A table".to_owned(),
            columns: vec!["mode".to_owned(), "inside %".to_owned(), "hairs".to_owned()],
            rows: vec![
                vec![text("adaptive"), number(0.0234, 2), number(150_000.0, 0)],
                vec![text("fixed"), number(f64::NAN, 2), text("")],
            ],
            note: "Of 5,000".to_owned(),
        }],
        plots: vec![Plot {
            title: "Curves".to_owned(),
            x: "t, s".to_owned(),
            y: "guides".to_owned(),
            curves: vec![("ours".to_owned(), vec![[0.0, 1.5], [1.0, 2.5]]), ("none".to_owned(), Vec::new())],
            ..Plot::default()
        }],
        pictures: vec![Picture { caption: NASTY.to_owned(), file: "pictures/p.png".to_owned(), row: "r".to_owned() }],
        claims: vec![claim(Verdict::Reproduced, "first"), claim(Verdict::NotReproduced, "second")],
        measures: vec![Measure {
            name: "inside_pct".to_owned(),
            unit: "%".to_owned(),
            value: 0.023_456,
            better: Better::Lower,
            slack: 0.1,
        }],
    };
    let section = |name: &str, outcome| Section {
        name: name.to_owned(),
        title: format!("About {name}"),
        source: "AS16 Fig. 10".to_owned(),
        outcome,
    };
    Report {
        about: About {
            command: "cargo xtask compare --smoke".to_owned(),
            size: Size::Smoke,
            commit: "0123abc".to_owned(),
            written_s: 1_000_000_000,
            machine: Machine { processor: "a <processor>".to_owned(), threads: 2, ..Machine::default() },
            notes: vec!["pictures left out".to_owned()],
        },
        sections: vec![
            section("salon", Outcome::Found { findings, made: Made::default() }),
            section("gears", Outcome::Failed { why: NASTY.to_owned() }),
        ],
    }
}

fn page(report: &Report) -> String {
    html(report, &|_| PictureBytes::Missing)
}

/// What a reader sees of a page: its text, with entities read.
fn read(page: &str) -> String {
    let mut out = String::new();
    for part in page.split('<').skip(1) {
        out.push_str(part.split_once('>').map_or("", |(_, words)| words));
        out.push('\n');
    }
    for (entity, letter) in [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&#39;", "'"), ("&amp;", "&")] {
        out = out.replace(entity, letter);
    }
    out
}

#[test]
fn page_and_markdown_and_json_hold_the_same_numbers() {
    let report = report();
    let (page, markdown, json) = (read(&page(&report)), markdown(&report), json(&report).unwrap());
    for words in ["0.02", "150,000", "46 ms", "0.02346", "Of 5,000", "0.02 % inside", "0123abc", "2001-09-09"] {
        assert!(page.contains(words), "the page lacks {words}");
        assert!(markdown.contains(words), "Markdown lacks {words}");
    }
    let back: Report = serde_json::from_str(&json).unwrap();
    assert_eq!(markdown, super::markdown(&back));
    assert_eq!(page, read(&html(&back, &|_| PictureBytes::Missing)));
}

#[test]
fn text_is_text_wherever_it_stands() {
    let report = report();
    let page = page(&report);
    assert!(!page.contains("<script"), "findings must not become markup");
    assert!(read(&page).contains(NASTY));
    let markdown = markdown(&report);
    assert!(!markdown.contains("<script") && !markdown.contains("[e](f)"));
    // Fields of Markdown's tables are told apart by bars that are not escaped.
    let bars = |line: &str| line.matches('|').count() - line.matches("\\|").count();
    for line in markdown.lines().filter(|line| line.starts_with("| reproduced") || line.starts_with("| not")) {
        assert_eq!(bars(line), 6, "{line}");
    }
}

#[test]
fn a_failure_is_told_on_the_first_page_and_in_its_section() {
    let report = report();
    let page = read(&page(&report));
    assert_eq!(page.matches(&format!("broke off: {NASTY}")).count(), 1);
    assert_eq!(page.matches(&format!("Broke off: {NASTY}")).count(), 1);
    assert!(markdown(&report).contains("> About gears broke off"));
}

#[test]
fn kept_findings_of_another_version_say_so() {
    let mut report = report();
    assert!(!page(&report).contains("the program has changed since"));
    if let Outcome::Found { made, .. } = &mut report.sections[0].outcome {
        (made.outdated, made.commit) = (true, "fedcba9".to_owned());
    }
    assert!(read(&page(&report)).contains("Kept from fedcba9"));
    assert!(markdown(&report).contains("Kept from fedcba9"));
}

#[test]
fn a_page_asks_for_nothing_but_pictures_beside_it() {
    let report = report();
    for place in [PictureBytes::Missing, PictureBytes::Beside, PictureBytes::Within(vec![1, 2, 3])] {
        let page = html(&report, &|_| place.clone());
        assert!(
            !page.contains("http") && !page.contains("url(") && !page.contains("@import") && !page.contains("<link")
        );
        let sources: Vec<&str> = page.split(" src=\"").skip(1).filter_map(|s| s.split('"').next()).collect();
        match place {
            PictureBytes::Missing => assert!(sources.is_empty()),
            PictureBytes::Beside => assert_eq!(sources, ["pictures/p.png"]),
            PictureBytes::Within(_) => assert_eq!(sources, ["data:image/png;base64,AQID"]),
        }
    }
}

#[test]
fn the_same_report_gives_the_same_bytes() {
    let (a, b) = (report(), report());
    assert_eq!(page(&a), page(&b));
    assert_eq!(markdown(&a), markdown(&b));
    assert_eq!(json(&a).unwrap(), json(&b).unwrap());
    // What is kept and read again is the same report.
    let back: Report = serde_json::from_str(&json(&a).unwrap()).unwrap();
    assert_eq!(json(&back).unwrap(), json(&a).unwrap());
}

#[test]
fn verdicts_are_counted_by_kind() {
    assert_eq!(report().verdicts().map(|(_, n)| n), [1, 0, 1, 0]);
}

/// Relative luminance of a colour written `#rrggbb` or `#rgb` (WCAG 2.2).
fn luminance(colour: &str) -> f64 {
    let digits = &colour[1..];
    let each = digits.len() / 3;
    let channel = |k: usize| {
        let part = &digits[k * each..(k + 1) * each];
        let part = if each == 1 { part.repeat(2) } else { part.to_owned() };
        let c = f64::from(u8::from_str_radix(&part, 16).unwrap()) / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    };
    0.2126 * channel(0) + 0.7152 * channel(1) + 0.0722 * channel(2)
}

fn contrast(a: &str, b: &str) -> f64 {
    let (a, b) = (luminance(a), luminance(b));
    (a.max(b) + 0.05) / (a.min(b) + 0.05)
}

#[test]
fn words_and_curves_stand_out_from_paper_by_day_and_by_night() {
    // Of words and of graphics, as WCAG 2.2 asks (1.4.3, 1.4.11).
    const WORDS: f64 = 4.5;
    const CURVES: f64 = 3.0;
    let style = [include_str!("style.css"), plot::COLOURS].concat();
    for rules in [style.as_str(), include_str!("dark.css")] {
        let colour = |name: &str| {
            let rest = rules.split(&format!("--{name}:")).nth(1).unwrap_or_else(|| panic!("--{name} has no colour"));
            rest.split([';', '}']).next().unwrap().to_owned()
        };
        for paper in ["paper", "card"].map(colour) {
            for name in ["ink", "faint", "link", "yes", "partly", "no", "untested"] {
                let found = contrast(&colour(name), &paper);
                assert!(found >= WORDS, "{name} on {paper}: {found:.2}");
            }
        }
        for k in 0..8 {
            let found = contrast(&colour(&format!("c{k}")), &colour("paper"));
            assert!(found >= CURVES, "c{k}: {found:.2}");
        }
    }
}
