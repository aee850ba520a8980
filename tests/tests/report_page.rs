//! The report's page in a real browser: what it shows, at the width of a telephone and of a desk.
//!
//! A page made of constructed findings, with everything that goes wrong in it, is laid out by Chromium without a window, twice,
//! in frames of a page that measures them: the report itself has no script. Skipped by name where there is no such browser;
//! `CHROME` names one that is elsewhere.

use hair_bench::evidence::{Better, Claim, Findings, Measure, Picture, Plot, Size, Table, Verdict, number, text};
use hair_bench::report::{About, Machine, Made, Outcome, PictureBytes, Report, Section, html};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Widths of a telephone and of a desk, CSS pixels.
const WIDTHS: [u32; 2] = [400, 1280];
/// Rows of the long table.
const LONG: usize = 300;
/// A browser that takes longer than this hangs; on a busy machine it takes seconds.
const PATIENCE: Duration = Duration::from_secs(240);

const NASTY: &str =
    "</p><script>document.title='taken over'</script><img src=http://example.com/x.png onerror=alert(1)> & \"' ©";

fn browser() -> Option<PathBuf> {
    let names =
        ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "chromium-headless-shell"];
    let on_path = |name: &&str| {
        let folders = std::env::var_os("PATH").unwrap_or_default();
        std::env::split_paths(&folders).map(|folder| folder.join(name)).find(|file| file.is_file())
    };
    let found = std::env::var_os("CHROME").map(PathBuf::from).or_else(|| names.iter().find_map(on_path));
    if found.is_none() {
        eprintln!("skipped: there is no Chromium here; install it (Debian: chromium) or name one by CHROME");
    }
    found
}

fn claim(verdict: Verdict, k: usize) -> Claim {
    Claim {
        source: "AS16 §7.2, Fig. 5".to_owned(),
        claim: format!("claim {k}: {NASTY}"),
        paper: "50 ms".to_owned(),
        ours: "a word of one hundred letters ".to_owned() + &"x".repeat(100),
        verdict,
        why: if k == 1 { NASTY.to_owned() } else { String::new() },
    }
}

fn plots() -> Vec<Plot> {
    let curve = |k: usize| {
        let point = |i: usize| [i as f64, (1.0 + k as f64) * (1.0 + 0.1 * i as f64)];
        (format!("curve number {k} of several"), (0..40).map(point).collect::<Vec<_>>())
    };
    let plot = |title: &str, log, curves| Plot {
        title: title.to_owned(),
        x: "time, s".to_owned(),
        y: format!("guides {NASTY}"),
        log_x: log,
        log_y: log,
        curves,
    };
    vec![
        plot("Eight curves", false, (0..8).map(curve).collect()),
        plot(
            "By factors, with zero and no number",
            true,
            vec![("a".to_owned(), vec![[0.0, 1.0], [1.0, f64::NAN], [1e3, 5.0], [1e6, 50.0]])],
        ),
        plot("Nothing", false, Vec::new()),
    ]
}

/// The smallest picture there is: one grey pixel, by the project's own writer.
fn pixel() -> Vec<u8> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("pixel.png");
    let image = hair_bench::picture::Image { width: 8, height: 6, rgb: vec![128; 144] };
    image.write_small_png(&path, 2).unwrap();
    std::fs::read(path).unwrap()
}

fn report() -> Report {
    let wide = 14;
    let rows = (0..LONG).map(|r| {
        let cell = |c: usize| match (r + c) % 7 {
            0 => number(f64::NAN, 2),
            1 => text(""),
            _ => number(1e6 / (1.0 + r as f64) * (c as f64 - 3.0), 2),
        };
        std::iter::once(text(format!("row {r}"))).chain((1..wide).map(cell)).collect()
    });
    let findings = Findings {
        highlights: vec![NASTY.to_owned()],
        paragraphs: vec![NASTY.to_owned(), "w".repeat(200)],
        tables: vec![Table {
            title: "A long and wide table".to_owned(),
            columns: (0..wide).map(|c| format!("column {c}")).collect(),
            rows: rows.collect(),
            note: NASTY.to_owned(),
        }],
        plots: plots(),
        pictures: [("there.png", "r"), ("missing.png", "r"), ("there.png", "s")]
            .map(|(file, row)| Picture { caption: NASTY.to_owned(), file: file.to_owned(), row: row.to_owned() })
            .to_vec(),
        claims: [Verdict::Reproduced, Verdict::InPart, Verdict::NotReproduced, Verdict::NotTested]
            .into_iter()
            .enumerate()
            .map(|(k, verdict)| claim(verdict, k))
            .collect(),
        measures: vec![Measure {
            name: "a_measure_with_a_name_as_long_as_they_are".to_owned(),
            unit: "%".to_owned(),
            value: f64::NAN,
            better: Better::Lower,
            slack: 0.0,
        }],
    };
    let section = |name: &str, outcome| Section {
        name: name.to_owned(),
        title: format!("About {name} {NASTY}"),
        source: "AS16 Fig. 10".to_owned(),
        outcome,
    };
    Report {
        about: About {
            command: NASTY.to_owned(),
            size: Size::Smoke,
            commit: "0123abc".to_owned(),
            written_s: 1_000_000_000,
            machine: Machine { threads: 2, ..Machine::default() },
            notes: vec![NASTY.to_owned()],
        },
        sections: vec![
            section("one", Outcome::Found { findings, made: Made::default() }),
            section("two", Outcome::Failed { why: NASTY.to_owned() }),
        ],
    }
}

/// A page that holds the report in a frame of each width and writes down what it finds there, all of it before its load has ended:
/// a browser asked for what became of a page waits for that, and on a busy machine for nothing later.
const MEASURE: &str = "
addEventListener('load', () => {
  const seen = [];
  for (const frame of document.querySelectorAll('iframe')) {
    const page = frame.contentDocument, all = (s) => [...page.querySelectorAll(s)];
    const box = (e) => { const b = e.getBoundingClientRect(); return [b.width, b.height]; };
    seen.push({
      inner: frame.contentWindow.innerWidth, scroll: page.documentElement.scrollWidth,
      title: page.title, h1: all('h1').map((e) => e.innerText),
      headings: all('section.experiment h2').map((e) => e.innerText),
      front: all('.claims .verdict').map((e) => e.innerText.trim()),
      verdicts: all('.claim .verdict').map((e) => e.innerText.trim()),
      visible: all('.verdict').every((e) => box(e)[0] > 20 && box(e)[1] > 8),
      rows: all('figure.table table').map((t) => t.tBodies[0].rows.length),
      cells: all('figure.table table').map((t) => t.tBodies[0].rows[0].cells.length),
      headers: all('table').every((t) => t.tHead.querySelectorAll('th[scope=col]').length > 0),
      svgs: all('svg').map(box), labels: all('svg').map((e) => e.getAttribute('aria-label')),
      drawn: all('svg').map((e) => [...e.querySelectorAll('path.curve')].filter((p) => p.getTotalLength() > 0).length),
      images: [...page.images].map((i) => [i.naturalWidth, i.alt]), missing: all('.missing').map((e) => e.innerText),
      scripts: page.scripts.length,
      asked: frame.contentWindow.performance.getEntriesByType('resource').map((e) => e.name).filter((n) => !n.startsWith('data:')),
      text: page.body.innerText.slice(0, 20000),
      smallest: Math.min(...all('svg text').map((e) => e.getBoundingClientRect().height)),
    });
  }
  document.getElementById('seen').textContent = JSON.stringify(seen);
});";

fn measured(browser: &Path, page: &str) -> Vec<Value> {
    let dir = tempfile::tempdir().unwrap();
    // A load waits for pictures, but not for those that are fetched when they come into view.
    let within = page.replace("loading=\"lazy\"", "").replace('&', "&amp;").replace('"', "&quot;");
    let frame =
        |width: &u32| format!("<iframe width={width} height=3000 style='border:0' srcdoc=\"{within}\"></iframe>");
    let frames: String = WIDTHS.iter().map(frame).collect();
    let wrapper = format!("<!DOCTYPE html><meta charset=utf-8><script>{MEASURE}</script><pre id=seen></pre>{frames}");
    let file = dir.path().join("wrapper.html");
    std::fs::write(&file, wrapper).unwrap();
    let dumped = dir.path().join("dom.html");
    let mut child = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--hide-scrollbars"])
        .arg("--dump-dom")
        .arg(format!("--user-data-dir={}", dir.path().join("profile").display()))
        .arg(&file)
        .stdin(Stdio::null())
        .stdout(std::fs::File::create(&dumped).unwrap())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let begin = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if begin.elapsed() > PATIENCE {
            child.kill().unwrap();
            child.wait().unwrap();
            panic!("{} did not answer", browser.display());
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    let dom = std::fs::read_to_string(&dumped).unwrap();
    let from = dom.find("<pre id=\"seen\">").expect("the wrapper's own element") + "<pre id=\"seen\">".len();
    let words = dom[from..].split("</pre>").next().unwrap();
    let words = words.replace("&lt;", "<").replace("&gt;", ">").replace("&nbsp;", "\u{a0}").replace("&amp;", "&");
    serde_json::from_str(&words).unwrap_or_else(|e| panic!("{e}: {words}"))
}

fn strings(value: &Value) -> Vec<&str> {
    value.as_array().unwrap().iter().map(|v| v.as_str().unwrap()).collect()
}

#[test]
fn a_browser_shows_all_of_a_report_at_every_width() {
    let Some(browser) = browser() else { return };
    let png = pixel();
    let page = html(&report(), &|picture| match picture.file.as_str() {
        "there.png" => PictureBytes::Within(png.clone()),
        _ => PictureBytes::Missing,
    });
    let frames = measured(&browser, &page);
    assert_eq!(frames.len(), WIDTHS.len());
    for (seen, width) in frames.iter().zip(WIDTHS) {
        assert_eq!(seen["inner"], width);
        assert_eq!(seen["scroll"], width, "nothing but tables scrolls sideways");

        assert_eq!(seen["scripts"], 0);
        assert_eq!(strings(&seen["asked"]), [""; 0], "nothing is asked of a network");
        assert_eq!(seen["title"], "Adaptive hair skinning: what it does, and how well");
        assert_eq!(strings(&seen["h1"]), ["Adaptive hair skinning"]);
        let headings = strings(&seen["headings"]);
        assert_eq!(headings.len(), 2);
        assert!(headings.iter().all(|h| h.contains("<script>")), "text shows as it is: {headings:?}");
        let all = ["✓ reproduced", "◐ in part", "✗ not reproduced", "· not tested"];
        assert_eq!(strings(&seen["front"]), all);
        assert_eq!(strings(&seen["verdicts"]), all);
        assert_eq!(seen["visible"], true);

        assert_eq!(seen["rows"], serde_json::json!([LONG]));
        assert_eq!(seen["cells"], serde_json::json!([14]));
        assert_eq!(seen["headers"], true);
        let svgs: Vec<[f64; 2]> = serde_json::from_value(seen["svgs"].clone()).unwrap();
        assert_eq!(svgs.len(), 3);
        assert!(svgs.iter().all(|[w, h]| *w > 300.0 && *h > 150.0 && *w <= f64::from(width)), "{svgs:?}");
        // The piece in the legend counts as one; of a curve without two points in a row there is only that.
        assert_eq!(seen["drawn"], serde_json::json!([16, 2, 0]));
        assert!(strings(&seen["labels"]).iter().all(|l| l.contains("over time, s")));
        assert!(seen["smallest"].as_f64().unwrap() >= 9.0, "words in plots can be read: {}", seen["smallest"]);

        let images: Vec<(u32, String)> = serde_json::from_value(seen["images"].clone()).unwrap();
        assert_eq!(images, [(8, NASTY.to_owned()), (8, NASTY.to_owned())]);
        assert_eq!(strings(&seen["missing"]), ["no picture: missing.png is not there"]);
        assert!(seen["text"].as_str().unwrap().contains("broke off"));
    }
}
