//! TressFX `.tfx` files, version 4: a 160-byte header, then arrays at stated byte offsets (0 = absent). Only positions are
//! read, `f32[4]` per vertex with the inverse mass in w.
//!
//! w is not used: in real files it marks the root only, or the first two points, or nothing reliable. Version 3 has another
//! header and `f32[3]` positions; it is told apart by its version field and refused.

use std::path::Path;

use crate::bytes::{ByteReader, printable_start, read_file};
use crate::error::{Error, Result};
use crate::groom::{Groom, LengthUnit};
use crate::hair::scaled_points;

const HEADER_BYTES: u64 = 160;
const MAX_VERTICES_PER_STRAND: u32 = 4096;

/// Reads a version 4 `.tfx` file whose coordinates are in `unit`. Strands may still be degenerate, see [`Groom::validate`].
///
/// # Errors
/// When the file cannot be read, is not version 4, is cut short, or its counts or coordinates cannot be right.
pub fn read_tfx(path: &Path, unit: LengthUnit) -> Result<Groom> {
    parse_tfx(path, &read_file(path)?, unit)
}

/// [`read_tfx`] from bytes; `path` serves the error texts.
///
/// # Errors
/// As [`read_tfx`].
pub fn parse_tfx(path: &Path, bytes: &[u8], unit: LengthUnit) -> Result<Groom> {
    let mut r = ByteReader::new(path, bytes);
    let version = r.f32("version")?;
    if !(1.0..100.0).contains(&version) {
        return Err(Error::BadMagic { path: path.to_path_buf(), format: "TressFX", found: printable_start(bytes) });
    }
    if !(4.0..5.0).contains(&version) {
        let hint = if (3.0..4.0).contains(&version) {
            "this is a version 3 file, whose layout differs; convert it to version 4 first"
        } else {
            "only version 4 is read"
        };
        return Err(Error::UnsupportedVersion {
            path: path.to_path_buf(),
            format: "TressFX",
            found: format!("{version}"),
            hint: hint.into(),
        });
    }
    let n_strands = r.u32("strand count")?;
    let n_vertices = r.u32("vertices per strand")?;
    let position_offset = r.u32("position offset")?;
    r.seek(0);
    r.take(HEADER_BYTES, 1, "header")?;
    if n_strands == 0 {
        return Err(r.bad("strand count", 4, "no strands"));
    }
    // The format asks for a power of two from 4 to 64; other counts read just as well.
    if !(2..=MAX_VERTICES_PER_STRAND).contains(&n_vertices) {
        let why = format!("{n_vertices} is outside 2 to {MAX_VERTICES_PER_STRAND}");
        return Err(r.bad("vertices per strand", 8, why));
    }
    if u64::from(position_offset) < HEADER_BYTES {
        let why = format!("{position_offset} lies inside the header (0 means absent)");
        return Err(r.bad("position offset", 12, why));
    }
    r.seek(u64::from(position_offset));
    let raw = r.take(u64::from(n_strands) * u64::from(n_vertices), 16, "positions")?;
    let points = scaled_points(&r, raw, 4, u64::from(position_offset), unit)?;
    Ok(Groom { point_counts: vec![n_vertices; n_strands as usize], points })
}
