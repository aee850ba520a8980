//! Finished results of long stages, kept on disk by what they were made from.
//!
//! A stage's file is named by the stage and the hash of its inputs, so nothing is ever out of date: what changes an input
//! is another file. Files appear whole or not at all (see [`crate::envelope`]). While a stage is being made its lock is held:
//! a second process that wants the same stage waits and then takes the result, and a process that is killed lets go. What
//! a stage cost is kept beside it, so that a run taken up again still knows; costs never enter another stage.

use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};
use std::time::Instant;

use cpu_time::ProcessTime;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::{xxh3_64, xxh3_64_with_seed};

use crate::envelope::{self, Kind};
use crate::error::{Error, Result};

/// Version of the envelope's use; what a stage holds is versioned by its key.
const VERSION: u32 = 1;

/// What making a stage took.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct StageCost {
    /// Wall-clock seconds.
    pub wall_s: f64,
    /// CPU seconds of all threads.
    pub cpu_s: f64,
    /// Bytes of the stage's file.
    pub bytes: u64,
}

impl StageCost {
    /// Starts measuring.
    #[must_use]
    pub fn clock() -> StageClock {
        StageClock { wall: Instant::now(), cpu: ProcessTime::now() }
    }

    /// Length of a file; zero if there is none.
    #[must_use]
    pub fn bytes_of(path: &Path) -> u64 {
        std::fs::metadata(path).map_or(0, |m| m.len())
    }
}

/// Wall-clock and CPU time since a moment.
#[derive(Debug, Clone, Copy)]
pub struct StageClock {
    wall: Instant,
    cpu: ProcessTime,
}

impl StageClock {
    /// What has passed since; no bytes.
    #[must_use]
    pub fn cost(&self) -> StageCost {
        StageCost { wall_s: self.wall.elapsed().as_secs_f64(), cpu_s: self.cpu.elapsed().as_secs_f64(), bytes: 0 }
    }

    /// What has passed since, with the bytes of the file that came of it.
    #[must_use]
    pub fn cost_of(&self, path: &Path) -> StageCost {
        StageCost { bytes: StageCost::bytes_of(path), ..self.cost() }
    }
}

impl std::ops::AddAssign for StageCost {
    fn add_assign(&mut self, other: Self) {
        self.wall_s += other.wall_s;
        self.cpu_s += other.cpu_s;
        self.bytes += other.bytes;
    }
}

/// Hash of a stage: its name and all it is made from, in order.
#[must_use]
pub fn stage_key(stage: &str, parts: &[u64]) -> u64 {
    let bytes: Vec<u8> = parts.iter().flat_map(|p| p.to_le_bytes()).collect();
    xxh3_64_with_seed(&bytes, xxh3_64(stage.as_bytes()))
}

/// Hash of a value by how it prints: of parameters, which are few and print all they hold.
#[must_use]
pub fn hash_of(value: &impl std::fmt::Debug) -> u64 {
    xxh3_64(format!("{value:?}").as_bytes())
}

/// A directory of finished stages.
#[derive(Debug, Clone)]
pub struct StageCache {
    directory: PathBuf,
}

/// Held while a stage is being made; let go when dropped, or when the process ends in whatever way.
#[derive(Debug)]
pub struct StageLock {
    _file: File,
    path: PathBuf,
}

impl Drop for StageLock {
    fn drop(&mut self) {
        // Removed while it is held: who waits for this file finds it gone and takes the next of its name.
        let _ = std::fs::remove_file(&self.path);
    }
}

impl StageCache {
    /// The cache in a directory, which is made.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn in_directory(directory: &Path) -> Result<Self> {
        std::fs::create_dir_all(directory).map_err(Error::io("create", directory))?;
        Ok(Self { directory: directory.to_path_buf() })
    }

    /// Where the stage is, or will be.
    #[must_use]
    pub fn path(&self, stage: &str, key: u64) -> PathBuf {
        self.directory.join(format!("{stage}-{key:016x}.stage"))
    }

    /// A stage's result; none when it has not been made.
    ///
    /// # Errors
    /// When its file cannot be read or is damaged: delete it, and it is made again.
    pub fn load<T: DeserializeOwned>(&self, stage: &str, key: u64) -> Result<Option<T>> {
        let path = self.path(stage, key);
        let payload = match envelope::read(&path, Kind::TRAINING_STAGE, VERSION) {
            Ok(payload) => payload,
            Err(Error::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(e),
        };
        let decode = |reason: String| Error::Decode { path, what: "training stage", reason };
        match postcard::take_from_bytes(&payload) {
            Ok((value, [])) => Ok(Some(value)),
            Ok((_, rest)) => Err(decode(format!("{} bytes are left over", rest.len()))),
            Err(e) => Err(decode(e.to_string())),
        }
    }

    /// Keeps a stage's result.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn save<T: Serialize>(&self, stage: &str, key: u64, value: &T) -> Result<()> {
        let path = self.path(stage, key);
        let payload =
            postcard::to_stdvec(value).map_err(|e| Error::CannotWrite { path: path.clone(), reason: e.to_string() })?;
        envelope::write(&path, Kind::TRAINING_STAGE, VERSION, &payload)
    }

    /// Waits until nobody else makes the stage. Look for its result again before making it.
    ///
    /// # Errors
    /// When the lock cannot be made.
    pub fn lock(&self, stage: &str, key: u64) -> Result<StageLock> {
        let path = self.directory.join(format!("{stage}-{key:016x}.lock"));
        loop {
            let file = OpenOptions::new()
                .create(true)
                .truncate(false)
                .write(true)
                .open(&path)
                .map_err(Error::io("create", &path))?;
            file.lock().map_err(Error::io("lock", &path))?;
            // Whoever held it may have removed it meanwhile; a lock on a removed file keeps nobody out.
            if is_still_there(&file, &path) {
                return Ok(StageLock { _file: file, path });
            }
        }
    }

    /// What making the stage took; none if it was never noted, or the note cannot be read: nothing depends on it.
    #[must_use]
    pub fn cost(&self, stage: &str, key: u64) -> Option<StageCost> {
        self.load(&cost_name(stage), key).ok().flatten()
    }

    /// Notes what making the stage took.
    ///
    /// # Errors
    /// When the note cannot be written.
    pub fn note_cost(&self, stage: &str, key: u64, cost: StageCost) -> Result<()> {
        self.save(&cost_name(stage), key, &cost)
    }
}

fn cost_name(stage: &str) -> String {
    format!("{stage}-cost")
}

#[cfg(unix)]
fn is_still_there(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (file.metadata(), std::fs::metadata(path)) {
        (Ok(held), Ok(named)) => (held.dev(), held.ino()) == (named.dev(), named.ino()),
        _ => false,
    }
}

#[cfg(not(unix))]
fn is_still_there(_: &File, path: &Path) -> bool {
    path.exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_comes_back_as_it_was_kept_under_its_own_key_only() {
        let directory = tempfile::tempdir().unwrap();
        let cache = StageCache::in_directory(&directory.path().join("stages")).unwrap();
        let value = vec![(1_u32, -2.5_f64), (7, f64::MIN_POSITIVE)];
        assert_eq!(cache.load::<Vec<(u32, f64)>>("reduce", 5).unwrap(), None);
        cache.save("reduce", 5, &value).unwrap();
        assert_eq!(cache.load("reduce", 5).unwrap(), Some(value));
        assert_eq!(cache.load::<Vec<(u32, f64)>>("reduce", 6).unwrap(), None);
        assert_eq!(cache.load::<Vec<(u32, f64)>>("guides", 5).unwrap(), None);
        assert_eq!(cache.cost("reduce", 5), None);
        let cost = StageCost { wall_s: 1.5, cpu_s: 2.5, bytes: 3 };
        cache.note_cost("reduce", 5, cost).unwrap();
        assert_eq!(cache.cost("reduce", 5), Some(cost));
    }

    #[test]
    fn a_damaged_stage_is_an_error_and_not_another_result() {
        let directory = tempfile::tempdir().unwrap();
        let cache = StageCache::in_directory(directory.path()).unwrap();
        cache.save("guides", 1, &vec![3_u32, 9]).unwrap();
        let path = cache.path("guides", 1);
        let sound = std::fs::read(&path).unwrap();
        for at in 0..sound.len() {
            let mut broken = sound.clone();
            broken[at] ^= 4;
            std::fs::write(&path, &broken).unwrap();
            assert!(cache.load::<Vec<u32>>("guides", 1).is_err(), "byte {at}");
        }
        std::fs::write(&path, &sound).unwrap();
        assert!(cache.load::<u8>("guides", 1).is_err(), "another type leaves bytes over");
    }

    #[test]
    fn one_at_a_time_makes_a_stage() {
        use std::sync::atomic::{AtomicU32, Ordering};
        let directory = tempfile::tempdir().unwrap();
        let cache = StageCache::in_directory(directory.path()).unwrap();
        let (inside, made) = (AtomicU32::new(0), AtomicU32::new(0));
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    let _lock = cache.lock("frames", 2).unwrap();
                    assert_eq!(inside.fetch_add(1, Ordering::SeqCst), 0, "two makers at once");
                    if cache.load::<u32>("frames", 2).unwrap().is_none() {
                        cache.save("frames", 2, &made.fetch_add(1, Ordering::SeqCst)).unwrap();
                    }
                    inside.fetch_sub(1, Ordering::SeqCst);
                });
            }
        });
        assert_eq!(made.load(Ordering::SeqCst), 1);
    }

    #[test]
    fn keys_tell_names_numbers_and_their_order_apart() {
        let keys = [
            stage_key("a", &[1, 2]),
            stage_key("a", &[2, 1]),
            stage_key("a", &[1]),
            stage_key("b", &[1, 2]),
            stage_key("a", &[]),
        ];
        let mut distinct = keys.to_vec();
        distinct.sort_unstable();
        distinct.dedup();
        assert_eq!(distinct.len(), keys.len());
    }
}
