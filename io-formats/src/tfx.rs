//! TressFX `.tfx` files, versions 3 and 4: a header, then arrays at stated byte offsets (0 = absent). Only positions are read.
//!
//! Version 4 has a header of 160 bytes and positions `f32[4]`, the inverse mass in w. It is not used: in real files it
//! marks the root only, or the first two points, or nothing reliable. Version 3 has 296 bytes and positions `f32[3]`.

use std::path::Path;

use crate::bytes::{ByteReader, printable_start, read_file};
use crate::error::{Error, Result};
use crate::groom::{Groom, LengthUnit};
use crate::hair::scaled_points;

/// What differs between the versions.
struct Layout {
    header_bytes: u64,
    /// Where the offset of the positions stands.
    offset_at: u64,
    /// Numbers per vertex.
    stride: usize,
}

const VERSION_3: Layout = Layout { header_bytes: 296, offset_at: 144, stride: 3 };
const VERSION_4: Layout = Layout { header_bytes: 160, offset_at: 12, stride: 4 };

const MAX_VERTICES_PER_STRAND: u32 = 4096;

/// Reads a `.tfx` file whose coordinates are in `unit`. Strands may still be degenerate, see [`Groom::validate`].
///
/// # Errors
/// When the file cannot be read, is neither version 3 nor 4, is cut short, or its counts or coordinates cannot be right.
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
    let layout = match version {
        3.0..4.0 => VERSION_3,
        4.0..5.0 => VERSION_4,
        _ => {
            return Err(Error::UnsupportedVersion {
                path: path.to_path_buf(),
                format: "TressFX",
                found: format!("{version}"),
                hint: "versions 3 and 4 are read".into(),
            });
        }
    };
    let n_strands = r.u32("strand count")?;
    let n_vertices = r.u32("vertices per strand")?;
    r.seek(0);
    r.take(layout.header_bytes, 1, "header")?;
    r.seek(layout.offset_at);
    let position_offset = r.u32("position offset")?;
    if n_strands == 0 {
        return Err(r.bad("strand count", 4, "no strands"));
    }
    // The format asks for a power of two from 4 to 64; other counts read just as well.
    if !(2..=MAX_VERTICES_PER_STRAND).contains(&n_vertices) {
        let why = format!("{n_vertices} is outside 2 to {MAX_VERTICES_PER_STRAND}");
        return Err(r.bad("vertices per strand", 8, why));
    }
    if u64::from(position_offset) < layout.header_bytes {
        let why = format!("{position_offset} lies inside the header (0 means absent)");
        return Err(r.bad("position offset", layout.offset_at, why));
    }
    r.seek(u64::from(position_offset));
    let raw = r.take(u64::from(n_strands) * u64::from(n_vertices), 4 * layout.stride as u64, "positions")?;
    let points = scaled_points(&r, raw, layout.stride, u64::from(position_offset), unit)?;
    Ok(Groom { point_counts: vec![n_vertices; n_strands as usize], points })
}
