//! Training as a program: killed at random moments, spread over processes, with any number of threads, it ends with the
//! same bytes.
#![allow(clippy::unwrap_used, reason = "test code")]

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, SystemTime};

/// Strands of two blocks, so that their weights can be shared out.
const STRANDS: usize = 8300;
/// Longest life of a process that is to be killed, after it has finished something; a stage or two fit in.
const LONGEST_LIFE: Duration = Duration::from_millis(60);
/// Runs after which a training that gets nowhere has failed.
const MOST_RUNS: usize = 200;

fn scene(folder: &Path) -> PathBuf {
    let path = folder.join("scene.toml");
    let text = format!(
        "name = \"small\"\n[groom]\ngenerator = {{ style = \"straight\", strands = {STRANDS}, length_cm = 3, seed = 1 }}\n\
         particles = 5\nguides = 12\n[train]\nsequences = 3\nseconds_per_sequence = 0.12\nheld_out_seconds = 0\n\n"
    );
    std::fs::write(&path, text).unwrap();
    path
}

fn train(scene: &Path, out: &Path, more: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    command.arg("train").arg(scene).arg("--out").arg(out).args(more).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

fn model(folder: &Path) -> Vec<u8> {
    let mut models = std::fs::read_dir(folder.join("cache")).unwrap().filter_map(|entry| {
        let path = entry.unwrap().path();
        (path.extension().is_some_and(|e| e == "skin")).then(|| std::fs::read(&path).unwrap())
    });
    let model = models.next().expect("a model was trained");
    assert!(models.next().is_none(), "one model only");
    model
}

/// Finished files of the cache and when they were made.
fn files(folder: &Path) -> BTreeMap<PathBuf, SystemTime> {
    let Ok(entries) = std::fs::read_dir(folder.join("cache")) else { return BTreeMap::new() };
    let finished = |path: &PathBuf| path.extension().is_some_and(|e| e == "frames" || e == "stage" || e == "skin");
    let paths = entries.map(|entry| entry.unwrap().path()).filter(finished);
    paths.filter_map(|path| Some((path.clone(), path.metadata().ok()?.modified().ok()?))).collect()
}

fn count(folder: &Path, name: &str, extension: &str) -> usize {
    let is_one = |path: &&PathBuf| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        stem.starts_with(name) && !stem.contains("-cost-") && path.extension().is_some_and(|e| e == extension)
    };
    files(folder).keys().filter(is_one).count()
}

#[test]
fn training_killed_shared_out_or_on_more_threads_ends_with_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let whole = folder.path().join("whole");
    assert!(train(&scene, &whole, &["--jobs", "1"]).status().unwrap().success());
    let expected = model(&whole);

    // Killed at random moments: some while after some more files of the cache appear, with another number of threads each time.
    let killed = folder.path().join("killed");
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    let mut kills = 0;
    loop {
        assert!(kills < MOST_RUNS, "training gets nowhere");
        let before = files(&killed);
        let more = rng.random_range(1..6);
        let jobs = ["1", "2"][kills % 2];
        let mut child = train(&scene, &killed, &["--jobs", jobs]).spawn().unwrap();
        while child.try_wait().unwrap().is_none() && files(&killed).len() < before.len() + more {
            std::thread::sleep(Duration::from_millis(1));
        }
        std::thread::sleep(LONGEST_LIFE.mul_f64(rng.random_range(0.0..1.0)));
        if let Some(status) = child.try_wait().unwrap() {
            assert!(status.success(), "{status}");
            break;
        }
        // SIGKILL on Unix: the process has no say in it.
        child.kill().unwrap();
        child.wait().unwrap();
        kills += 1;
        let after = files(&killed);
        let is_kept = |(path, made): (&PathBuf, &SystemTime)| after.get(path) == Some(made);
        assert!(before.iter().all(is_kept), "a run made again what was there: {before:?}, {after:?}");
    }
    assert!(kills >= 3, "{kills} kills: it was hardly interrupted");
    assert!(model(&killed) == expected, "{kills} kills changed the model");

    // Shared out: sequences to two processes at once, then strands to two more, then put together.
    let shared = folder.path().join("shared");
    let share_out = |shares: [[&str; 2]; 2]| {
        let mut processes = shares.map(|share| train(&scene, &shared, &share).spawn().unwrap());
        for process in &mut processes {
            assert!(process.wait().unwrap().success());
        }
    };
    share_out([["--sequences", "0..2"], ["--sequences", "2..3"]]);
    assert_eq!((count(&shared, "frames-", "frames"), count(&shared, "reduce-", "stage")), (3, 0));
    share_out([["--strands", "0..4000"], ["--strands", "4000..8300"]]);
    assert_eq!((count(&shared, "weights-", "stage"), count(&shared, "model-", "skin")), (2, 0));
    assert!(train(&scene, &shared, &[]).status().unwrap().success());
    assert!(model(&shared) == expected, "shares merge to another model");
}

#[test]
fn shares_that_do_not_exist_are_refused_with_what_does() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    for (share, said) in [
        (["--sequences", "3..4"], "there are 3"),
        (["--strands", "8300..9000"], "there are 8300"),
        (["--strands", "5"], "first..end"),
        (["--sequences", "2..1"], "first..end"),
    ] {
        let output = train(&scene, &folder.path().join("out"), &share).stderr(Stdio::piped()).output().unwrap();
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && text.contains(said), "{share:?}: {text}");
    }
}
