//! Laws of runs: nothing is run twice, nothing old is shown as new, one failure is one failure.

use super::*;
use crate::compare::about::Program;
use crate::compare::writing;
use hair_bench::Error;
use hair_bench::evidence::{Findings, Picture, Place, Size, Trained, View, number};
use hair_bench::report::{About, Machine, Report};
use io_formats::scene::Scene;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A place without anything.
struct Nowhere;

fn nothing<T>() -> Result<T, Error> {
    Err(Error::Place { what: "nothing".to_owned(), source: "nowhere".into() })
}

impl Place for Nowhere {
    fn size(&self) -> Size {
        Size::Smoke
    }
    fn scene(&self, _: &str) -> Result<Scene, Error> {
        nothing()
    }
    fn trained(&self, _: Scene) -> Result<Trained, Error> {
        nothing()
    }
    fn draw(&self, _: &str, _: &str, _: &str, _: &View) -> Result<Picture, Error> {
        nothing()
    }
    fn data(&self, _: &str) -> Option<PathBuf> {
        None
    }
    fn progress(&self, _: &str, _: usize, _: usize) {}
}

impl Station for Nowhere {
    fn begin(&self, _: &str, _: &Path) {}
    fn end(&self) -> Option<String> {
        None
    }
    fn draws(&self) -> bool {
        true
    }
    fn as_place(&self) -> &dyn Place {
        self
    }
}

fn experiment(name: &'static str, run: fn(&dyn Place) -> Result<Findings, Error>) -> Experiment {
    Experiment { name, title: name, source: "AS16", run }
}

fn store(folder: &Path, hash: u64) -> Store {
    let program = Program { commit: format!("commit {hash}"), hash };
    Store::open(folder, Size::Smoke, &program, false).unwrap()
}

/// A third, which no short decimal tells.
fn a_third(_: &dyn Place) -> Result<Findings, Error> {
    Ok(Findings { paragraphs: vec![format!("{:?}", number(1.0 / 3.0, 3))], ..Findings::default() })
}

fn findings(ran: &Ran) -> Option<&Findings> {
    ran.section.findings()
}

fn made(ran: &Ran) -> &Made {
    match &ran.section.outcome {
        Outcome::Found { made, .. } => made,
        Outcome::Failed { why } => panic!("{why}"),
    }
}

#[test]
fn a_run_cut_short_goes_on_where_it_was() {
    static RUNS: [AtomicUsize; 3] = [const { AtomicUsize::new(0) }; 3];
    static BROKEN: AtomicUsize = AtomicUsize::new(1);
    fn count(k: usize) -> Result<Findings, Error> {
        RUNS[k].fetch_add(1, Ordering::Relaxed);
        Ok(Findings::default())
    }
    let experiments = [
        experiment("first", |_| count(0)),
        experiment("second", |_| if BROKEN.swap(0, Ordering::Relaxed) == 1 { nothing() } else { count(1) }),
        experiment("third", |_| count(2)),
    ];
    let dir = tempfile::tempdir().unwrap();
    let (bars, store) = (Bars::new(), store(dir.path(), 1));
    let run = || all(&experiments, &Nowhere, &store, How::default(), &bars).unwrap();
    let outcomes = run().iter().map(|r| findings(r).is_some()).collect::<Vec<_>>();
    assert_eq!(outcomes, [true, false, true], "one failure stops nothing else");
    // What is left of an experiment that was killed: a folder without findings.
    std::fs::remove_file(store.folder("third").join("findings.json")).unwrap();
    assert!(run().iter().all(|r| findings(r).is_some()));
    assert!(run().iter().all(|r| findings(r).is_some()));
    assert_eq!(RUNS.each_ref().map(|n| n.load(Ordering::Relaxed)), [1, 1, 2]);
}

#[test]
fn a_changed_program_shows_nothing_old_unless_asked_and_then_says_so() {
    let experiments = [experiment("e", a_third)];
    let dir = tempfile::tempdir().unwrap();
    let bars = Bars::new();
    let run = |hash, how| all(&experiments, &Nowhere, &store(dir.path(), hash), how, &bars).unwrap().remove(0);
    let keep = How { keep: true, fresh: false };
    assert_eq!(made(&run(1, How::default())).commit, "commit 1");
    let old = run(2, keep);
    assert!(made(&old).outdated && made(&old).commit == "commit 1");
    let new = run(2, How::default());
    assert!(!made(&new).outdated && made(&new).commit == "commit 2");
    assert!(!made(&run(2, keep)).outdated, "what is up to date comes first");
}

#[test]
fn a_report_outlives_the_cache_and_gives_up_its_findings_only_when_asked_and_only_at_its_size() {
    let experiments = [experiment("e", a_third)];
    let dir = tempfile::tempdir().unwrap();
    let bars = Bars::new();
    let (out, to) = (dir.path().join("out"), dir.path().join("report"));
    let first = all(&experiments, &Nowhere, &store(&out, 1), How::default(), &bars).unwrap().remove(0);
    let report = |size| Report { about: About { size, ..about() }, sections: vec![first.section.clone()] };
    let keep = How { keep: true, fresh: false };
    let run = |how| {
        let store = store(&out, 2).with_report(&to);
        all(&experiments, &Nowhere, &store, how, &bars).unwrap().remove(0)
    };
    for (size, how, old) in [(Size::Smoke, keep, true), (Size::Full, keep, false), (Size::Smoke, How::default(), false)]
    {
        let _ = std::fs::remove_dir_all(&out);
        writing::write(&report(size), std::slice::from_ref(&first.folder), &to, 0).unwrap();
        let ran = run(how);
        assert_eq!(made(&ran).outdated, old, "{size:?} {how:?}");
        assert_eq!(made(&ran).commit, if old { "commit 1" } else { "commit 2" });
        assert_eq!(findings(&ran), findings(&first), "a third stays a third");
    }
}

fn about() -> About {
    About {
        command: String::new(),
        size: Size::Smoke,
        commit: String::new(),
        written_s: 0,
        machine: Machine::default(),
        notes: Vec::new(),
    }
}

#[test]
fn what_is_kept_is_what_was_reported() {
    let experiments = [experiment("e", a_third)];
    let dir = tempfile::tempdir().unwrap();
    let (bars, store) = (Bars::new(), store(dir.path(), 7));
    let run = || all(&experiments, &Nowhere, &store, How::default(), &bars).unwrap().remove(0).section;
    assert_eq!(run(), run());
}

#[test]
fn a_panic_is_a_failure_of_its_experiment_alone() {
    let experiments = [experiment("bad", |_| panic!("three left feet")), experiment("good", a_third)];
    let dir = tempfile::tempdir().unwrap();
    let (bars, store) = (Bars::new(), store(dir.path(), 1));
    let ran = all(&experiments, &Nowhere, &store, How::default(), &bars).unwrap();
    assert!(matches!(&ran[0].section.outcome, Outcome::Failed { why } if why.contains("three left feet")));
    assert!(findings(&ran[1]).is_some());
}
