//! What tests across crates share: small scenes made by code, tolerances with their reasons, and where third-party data lies
//! when it is there.
//!
//! Everything here is a function of its parameters, so a law that fails fails again. Lengths in cm.
#![allow(clippy::print_stderr, clippy::expect_used, reason = "helpers of tests say what they skip and stop at once")]

pub mod models;
pub mod scenes;
pub mod tolerance;

use std::path::{Path, PathBuf};

/// A third-party file, or `None`, said aloud, where it is not there: such files are not part of the repository.
#[must_use]
pub fn shared_data(relative: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data").join(relative);
    if path.exists() {
        return Some(path);
    }
    eprintln!("skipped: {relative} is not here");
    None
}

/// The result of `work` in a pool of so many threads.
///
/// # Panics
/// If the pool cannot be started.
pub fn with_threads<T: Send>(n_threads: usize, work: impl FnOnce() -> T + Send) -> T {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().expect("a pool of worker threads");
    pool.install(work)
}
