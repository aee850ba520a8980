//! The wrapper of our own files: magic, kind, version, payload length, xxh3-64 of the payload, payload.
//!
//! Files appear whole or not at all: written beside their destination, flushed to disk, then renamed. A reader checks
//! magic, kind, version, length against the file, and checksum, in this order, each with its own error; nothing is
//! allocated on the word of a header.

use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use crate::bytes::printable_start;
use crate::error::{Error, Result};

/// First bytes of every file of ours.
pub const MAGIC: [u8; 8] = *b"HAIRSKIN";

/// Bytes before the payload.
pub const HEADER_BYTES: usize = 32;

/// Bytes read and hashed together: a part of the second-level cache.
const HASHED_AT_ONCE: usize = 256 << 10;

/// What a file holds, as a four-letter tag.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kind(pub [u8; 4]);

impl Kind {
    /// A trained skinning model.
    pub const SKINNING_MODEL: Self = Self(*b"SKIN");
    /// Recorded frames (their own header follows the tag, see [`crate::frames`]).
    pub const FRAME_STORE: Self = Self(*b"FRAM");
    /// The finished result of one training stage, kept so that a killed run can go on.
    pub const TRAINING_STAGE: Self = Self(*b"TRST");
    /// A solid baked to a distance field.
    pub const BAKED_SOLID: Self = Self(*b"BSDF");
}

impl std::fmt::Display for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            Self::SKINNING_MODEL => f.write_str("skinning model"),
            Self::FRAME_STORE => f.write_str("frame store"),
            Self::TRAINING_STAGE => f.write_str("training stage"),
            Self::BAKED_SOLID => f.write_str("baked solid"),
            Self(tag) => write!(f, "file of kind \"{}\"", tag.escape_ascii()),
        }
    }
}

/// Writes `payload` as a file of `kind`, replacing `path` only once all bytes are on disk.
///
/// # Errors
/// When a file operation fails; `path` is then as it was.
pub fn write(path: &Path, kind: Kind, version: u32, payload: &[u8]) -> Result<()> {
    let temporary = temporary_path(path);
    let mut file = File::create(&temporary).map_err(Error::io("create", &temporary))?;
    let mut header = Vec::with_capacity(HEADER_BYTES);
    header.extend_from_slice(&MAGIC);
    header.extend_from_slice(&kind.0);
    header.extend_from_slice(&version.to_le_bytes());
    header.extend_from_slice(&(payload.len() as u64).to_le_bytes());
    header.extend_from_slice(&xxh3_64(payload).to_le_bytes());
    file.write_all(&header).map_err(Error::io("write", &temporary))?;
    file.write_all(payload).map_err(Error::io("write", &temporary))?;
    publish(file, &temporary, path)
}

/// Reads the payload of a file of `kind` and `version`.
///
/// # Errors
/// When the file cannot be read, is none of ours, of another kind or version, cut short or damaged.
pub fn read(path: &Path, kind: Kind, version: u32) -> Result<Vec<u8>> {
    let (mut file, promised, checksum) = open(path, kind, version)?;
    let mut payload = Vec::with_capacity(usize::try_from(promised).unwrap_or(0));
    file.read_to_end(&mut payload).map_err(Error::io("read", path))?;
    if payload.len() as u64 != promised || xxh3_64(&payload) != checksum {
        return Err(Error::Checksum { path: path.to_path_buf(), part: "the payload".into() });
    }
    Ok(payload)
}

/// A file at the start of its payload, the payload's length and its checksum.
fn open(path: &Path, kind: Kind, version: u32) -> Result<(File, u64, u64)> {
    let mut file = File::open(path).map_err(Error::io("read", path))?;
    let file_bytes = file.metadata().map_err(Error::io("read", path))?.len();
    let mut header = Vec::with_capacity(HEADER_BYTES);
    (&mut file).take(HEADER_BYTES as u64).read_to_end(&mut header).map_err(Error::io("read", path))?;
    check_tag(path, &header, HEADER_BYTES, kind, version)?;
    let promised = u64_at(&header, 16);
    let actual = file_bytes.saturating_sub(HEADER_BYTES as u64);
    if promised != actual {
        return Err(Error::WrongLength { path: path.to_path_buf(), promised, actual });
    }
    Ok((file, promised, u64_at(&header, 24)))
}

/// The payload of a file, read in order into where it stays: nothing is held twice. What was read is to be believed only
/// once [`PayloadReader::finish`] has found its checksum right.
pub(crate) struct PayloadReader<'a> {
    path: &'a Path,
    file: File,
    hash: Xxh3,
    offset: u64,
    length: u64,
    checksum: u64,
}

impl<'a> PayloadReader<'a> {
    /// Opens a file of `kind` and `version` and checks its header, length included.
    pub(crate) fn open(path: &'a Path, kind: Kind, version: u32) -> Result<Self> {
        let (file, length, checksum) = open(path, kind, version)?;
        Ok(Self { path, file, hash: Xxh3::new(), offset: 0, length, checksum })
    }

    /// Bytes read so far.
    pub(crate) fn offset(&self) -> u64 {
        self.offset
    }

    /// An [`Error::BadField`] for the field that starts at `offset`.
    pub(crate) fn bad(&self, field: &'static str, offset: u64, reason: String) -> Error {
        Error::BadField { path: self.path.to_path_buf(), field, offset, reason }
    }

    /// Fails unless `count * size` more bytes are there; `count` may come straight from the file.
    pub(crate) fn expect(&self, count: u64, size: usize, field: &'static str) -> Result<()> {
        let (needed, available) = (count.saturating_mul(size as u64), self.length - self.offset);
        if needed > available {
            let (path, offset) = (self.path.to_path_buf(), self.offset);
            return Err(Error::Truncated { path, field, offset, needed, available });
        }
        Ok(())
    }

    /// Fills `out` with the next bytes.
    pub(crate) fn fill(&mut self, out: &mut [u8], field: &'static str) -> Result<()> {
        self.expect(out.len() as u64, 1, field)?;
        // Hashed while they are in the cache.
        for piece in out.chunks_mut(HASHED_AT_ONCE) {
            self.file.read_exact(piece).map_err(Error::io("read", self.path))?;
            self.hash.update(piece);
        }
        self.offset += out.len() as u64;
        Ok(())
    }

    /// The next bytes, as many as a number has.
    pub(crate) fn number<const N: usize>(&mut self, field: &'static str) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        self.fill(&mut bytes, field)?;
        Ok(bytes)
    }

    /// Reads to the end and compares the checksum.
    pub(crate) fn finish(mut self) -> Result<()> {
        let left = self.length - self.offset;
        let mut rest = vec![0; HASHED_AT_ONCE.min(usize::try_from(left).unwrap_or(HASHED_AT_ONCE))];
        while self.offset < self.length {
            let n = rest.len().min((self.length - self.offset) as usize);
            self.fill(&mut rest[..n], "the end")?;
        }
        if self.hash.digest() != self.checksum {
            return Err(Error::Checksum { path: self.path.to_path_buf(), part: "the payload".into() });
        }
        match left {
            0 => Ok(()),
            _ => Err(self.bad("the end", self.length - left, format!("{left} bytes are left over"))),
        }
    }
}

/// Checks magic, kind and version at the start of `header`, which should have `header_bytes` bytes.
pub(crate) fn check_tag(path: &Path, header: &[u8], header_bytes: usize, kind: Kind, version: u32) -> Result<()> {
    let start = &header[..header.len().min(MAGIC.len())];
    if start != &MAGIC[..start.len()] || start.is_empty() {
        let found = printable_start(header);
        return Err(Error::BadMagic { path: path.to_path_buf(), format: "hair skinning", found });
    }
    if header.len() < header_bytes {
        return Err(Error::Truncated {
            path: path.to_path_buf(),
            field: "header",
            offset: 0,
            needed: header_bytes as u64,
            available: header.len() as u64,
        });
    }
    let found = Kind([header[8], header[9], header[10], header[11]]);
    if found != kind {
        return Err(Error::WrongKind {
            path: path.to_path_buf(),
            expected: kind.to_string(),
            found: found.to_string(),
        });
    }
    let found = u32::from_le_bytes([header[12], header[13], header[14], header[15]]);
    if found != version {
        let format = match kind {
            Kind::SKINNING_MODEL => "skinning model",
            Kind::FRAME_STORE => "frame store",
            Kind::TRAINING_STAGE => "training stage",
            _ => "hair skinning",
        };
        let hint = if found < version {
            format!(
                "it is older than this program (version {version}): make it again, by training where it was trained"
            )
        } else {
            format!("it is newer than this program (version {version}): update the program, or make the file again")
        };
        return Err(Error::UnsupportedVersion { path: path.to_path_buf(), format, found: found.to_string(), hint });
    }
    Ok(())
}

/// Where a file is written before it takes its name.
pub(crate) fn temporary_path(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".tmp");
    path.with_file_name(name)
}

/// Flushes `file` to disk and gives it its name.
pub(crate) fn publish(file: File, temporary: &Path, path: &Path) -> Result<()> {
    file.sync_all().map_err(Error::io("flush", temporary))?;
    drop(file);
    std::fs::rename(temporary, path).map_err(Error::io("rename", temporary))
}

/// The little-endian `u64` at `at`.
pub(crate) fn u64_at(bytes: &[u8], at: usize) -> u64 {
    let mut word = [0; 8];
    word.copy_from_slice(&bytes[at..at + 8]);
    u64::from_le_bytes(word)
}
