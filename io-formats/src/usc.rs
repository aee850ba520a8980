//! USC-HairSalon and Hair20K `.data` files: a strand count, then for each strand its point count and `f32[3]` points.
//!
//! A strand of one point marks a root without hair and is left out. Strands otherwise have 100 points; other counts read
//! just as well.

use std::path::Path;

use crate::bytes::{ByteReader, read_file};
use crate::error::Result;
use crate::groom::{Groom, LengthUnit};
use crate::hair::scaled_points;

/// Reads a `.data` file whose coordinates are in `unit`. Strands may still be degenerate, see [`Groom::validate`].
///
/// # Errors
/// When the file cannot be read, is cut short or goes on after its strands, or its counts or coordinates cannot be right.
pub fn read_data(path: &Path, unit: LengthUnit) -> Result<Groom> {
    parse_data(path, &read_file(path)?, unit)
}

/// [`read_data`] from bytes; `path` serves the error texts.
///
/// # Errors
/// As [`read_data`].
pub fn parse_data(path: &Path, bytes: &[u8], unit: LengthUnit) -> Result<Groom> {
    let mut r = ByteReader::new(path, bytes);
    let n_strands = r.u32("strand count")?;
    if i32::try_from(n_strands).is_err() {
        return Err(r.bad("strand count", 0, format!("{} strands", n_strands as i32)));
    }
    let mut groom = Groom::default();
    for strand in 0..n_strands {
        let at = r.offset();
        let n_points = r.u32("point count")?;
        if n_points == 0 || i32::try_from(n_points).is_err() {
            return Err(r.bad("point count", at, format!("strand {strand} has {} points", n_points as i32)));
        }
        let from = r.offset();
        let raw = r.take(u64::from(n_points), 12, "points")?;
        let points = scaled_points(&r, raw, 3, from, unit)?;
        if n_points > 1 {
            groom.point_counts.push(n_points);
            groom.points.extend(points);
        }
    }
    if r.offset() != bytes.len() as u64 {
        let left = bytes.len() as u64 - r.offset();
        return Err(r.bad("end", r.offset(), format!("{left} bytes follow the last strand; this is no .data groom")));
    }
    Ok(groom)
}
