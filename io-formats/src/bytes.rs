//! Bounds-checked reading of little-endian fields: each read names its field, and a length is compared with what is left
//! of the file before anything is allocated.

use std::path::Path;

use crate::error::{Error, Result};

/// Reads a file whole.
pub(crate) fn read_file(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).map_err(Error::io("read", path))
}

/// A position in a file held in memory.
pub(crate) struct ByteReader<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    offset: usize,
}

impl<'a> ByteReader<'a> {
    pub(crate) fn new(path: &'a Path, bytes: &'a [u8]) -> Self {
        Self { path, bytes, offset: 0 }
    }

    pub(crate) fn offset(&self) -> u64 {
        self.offset as u64
    }

    /// Moves to an absolute offset, which may lie past the end: the next read then says so.
    pub(crate) fn seek(&mut self, offset: u64) {
        self.offset = usize::try_from(offset).unwrap_or(usize::MAX);
    }

    /// The next `count * size` bytes; `count` may come straight from the file.
    pub(crate) fn take(&mut self, count: u64, size: u64, field: &'static str) -> Result<&'a [u8]> {
        let available = (self.bytes.len() as u64).saturating_sub(self.offset as u64);
        let needed = count.saturating_mul(size);
        if needed > available {
            return Err(Error::Truncated {
                path: self.path.to_path_buf(),
                field,
                offset: self.offset as u64,
                needed,
                available,
            });
        }
        let start = self.offset;
        self.offset += needed as usize;
        Ok(&self.bytes[start..self.offset])
    }

    pub(crate) fn u32(&mut self, field: &'static str) -> Result<u32> {
        let b = self.take(1, 4, field)?;
        Ok(u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
    }

    pub(crate) fn f32(&mut self, field: &'static str) -> Result<f32> {
        Ok(f32::from_bits(self.u32(field)?))
    }

    /// An [`Error::BadField`] for the field that starts at `offset`.
    pub(crate) fn bad(&self, field: &'static str, offset: u64, reason: impl Into<String>) -> Error {
        Error::BadField { path: self.path.to_path_buf(), field, offset, reason: reason.into() }
    }
}

/// The `index`-th little-endian `f32` of `bytes`.
pub(crate) fn f32_at(bytes: &[u8], index: usize) -> f32 {
    let b = &bytes[4 * index..4 * index + 4];
    f32::from_le_bytes([b[0], b[1], b[2], b[3]])
}

/// The first bytes of a file, printable, for error texts.
pub(crate) fn printable_start(bytes: &[u8]) -> String {
    let shown: Vec<u8> = bytes.iter().take(8).copied().collect();
    format!("\"{}\"", shown.escape_ascii())
}
