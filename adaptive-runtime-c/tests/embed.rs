//! A host in C gets what a host in Rust gets: the C program of this folder, linked with the static library, against the
//! runtime driven directly.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "test code")]

use adaptive_runtime::{Runtime, RuntimeParams, StepInput};
use collision::{Shape, Solid};
use hair_tests::models::Row;
use io_formats::SkinningModel;
use nalgebra::{Isometry3, Vector3};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// What the static library needs beside itself on Linux: `rustc --print native-static-libs`.
const SYSTEM_LIBRARIES: [&str; 4] = ["-lpthread", "-ldl", "-lm", "-lgcc_s"];

#[test]
fn a_host_in_c_gets_the_bytes_that_a_host_in_rust_gets() {
    if !has_compiler("c") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (model, program) = (folder.path().join("tiny.skin"), folder.path().join("embed"));
    Row::parted().model().save(&model).unwrap();
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let built = Command::new("cc")
        .args(["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-I"])
        .arg(package.join("include"))
        .arg(package.join("tests/embed.c"))
        .arg(static_library())
        .args(SYSTEM_LIBRARIES)
        .arg("-o")
        .arg(&program)
        .output()
        .unwrap();
    said_nothing(&built);
    let ran = Command::new(&program).arg(&model).output().unwrap();
    // Failures on the way print nothing either: the library leaves the host's output alone.
    assert!(ran.status.success() && ran.stderr.is_empty(), "{}", String::from_utf8_lossy(&ran.stderr));
    assert_eq!(String::from_utf8_lossy(&ran.stdout).trim_end(), in_rust(&model));
}

#[test]
fn the_header_is_good_for_cpp() {
    if !has_compiler("c++") {
        return;
    }
    let header = Path::new(env!("CARGO_MANIFEST_DIR")).join("include/adaptive_hair.h");
    let mut compiler = Command::new("cc");
    compiler.args(["-x", "c++", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]).arg(header);
    said_nothing(&compiler.output().unwrap());
}

/// The line that the C program prints, from the same motions.
fn in_rust(model: &Path) -> String {
    let at = |x: f64, y: f64, z: f64| Isometry3::translation(x, y, z);
    let axis = |z: f32| Vector3::new(0.0, 0.0, z);
    // The cells that the library chooses for these radii.
    let cell = |radius: f32| (8.0 * 0.002 * radius).sqrt().min(0.4 * radius);
    let solids = [Shape::capsule(axis(0.0), axis(0.0), 1.5), Shape::capsule(axis(-2.0), axis(2.0), 0.2)];
    let solids = solids.into_iter().zip([1.5, 0.2]);
    let solids = solids.map(|(shape, r)| Solid::from_shape("rods", &shape.into(), cell(r), r, 0.3).unwrap()).collect();
    let mut poses = [at(0.5, -8.0, -3.0), at(1.5, -5.0, -4.0)];
    let model = SkinningModel::load(model).unwrap();
    let mut hair = Runtime::new(model, RuntimeParams::adaptive(), Isometry3::identity(), None, solids, &poses).unwrap();
    let mut most_in_contact = 0;
    for step in 1..=40 {
        let step = f64::from(step);
        poses[0] = at(0.5, -8.0, -3.0 + 0.1 * step);
        let world_from_head = at(0.01 * step, 0.0, 0.0);
        let report = hair.step(&StepInput { dt: 0.01, world_from_head, world_from_solids: &poses });
        most_in_contact = report.strands_in_contact.max(most_in_contact);
    }
    assert!(most_in_contact > 0, "a ball that touches no hair tells nothing");
    let coordinates = read_positions(&mut hair).iter().flatten();
    let hash = coordinates
        .fold(0xcbf2_9ce4_8422_2325_u64, |hash, x| (hash ^ u64::from(x.to_bits())).wrapping_mul(0x0100_0000_01b3));
    format!("{} {} {most_in_contact} {hash:016x}", hair.n_strands(), hair.n_particles())
}

fn read_positions(hair: &mut Runtime) -> &[[f32; 3]] {
    hair.read();
    hair.positions()
}

fn said_nothing(compiler: &Output) {
    assert!(compiler.status.success(), "{}", String::from_utf8_lossy(&compiler.stderr));
}

/// Whether `cc` compiles the language; said aloud where it does not.
fn has_compiler(language: &str) -> bool {
    let run = Command::new("cc")
        .args(["-x", language, "-fsyntax-only", "-"])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    let has = run.is_ok_and(|status| status.success());
    if !has {
        eprintln!("skipped: cc does not compile {language} here");
    }
    has
}

/// The static library built with this test: beside it, or one folder up.
fn static_library() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let folders = test.ancestors().skip(1).take(2);
    let files = folders.flat_map(|folder| std::fs::read_dir(folder).unwrap()).map(|entry| entry.unwrap().path());
    let is_it = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with("libadaptive_hair") && name.ends_with(".a")
    };
    // Builds before this one may have left theirs.
    files.filter(is_it).max_by_key(|path| path.metadata().unwrap().modified().unwrap()).unwrap()
}
