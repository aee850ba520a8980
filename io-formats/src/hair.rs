//! Cem Yuksel's `.hair` files: a 128-byte header, then the arrays whose bit is set, in the order segments, points,
//! thickness, transparency, colours. Only segments and points are read.
//!
//! Real files carry the magic in lower case, and may lack the segment array (all strands then have `default_segments`).
//! Each array's size is compared with what is left of the file before it is read.

use std::io::Write as _;
use std::path::Path;

use crate::bytes::{ByteReader, f32_at, printable_start, read_file};
use crate::envelope::{publish, temporary_path};
use crate::error::{Error, Result};
use crate::groom::{Groom, LengthUnit};

const HEADER_BYTES: u64 = 128;
const INFO_BYTES: usize = 88;
const HAS_SEGMENTS: u32 = 1;
const HAS_POINTS: u32 = 2;

/// Reads a `.hair` file whose coordinates are in `unit`. Strands may still be degenerate, see [`Groom::validate`].
///
/// # Errors
/// When the file cannot be read, is cut short, or its counts or coordinates cannot be right.
pub fn read_hair(path: &Path, unit: LengthUnit) -> Result<Groom> {
    parse_hair(path, &read_file(path)?, unit)
}

/// [`read_hair`] from bytes; `path` serves the error texts.
///
/// # Errors
/// As [`read_hair`].
pub fn parse_hair(path: &Path, bytes: &[u8], unit: LengthUnit) -> Result<Groom> {
    let mut r = ByteReader::new(path, bytes);
    let magic = r.take(4, 1, "magic")?;
    if !magic.eq_ignore_ascii_case(b"HAIR") {
        return Err(Error::BadMagic { path: path.to_path_buf(), format: "hair", found: printable_start(bytes) });
    }
    let n_strands = r.u32("strand count")?;
    let n_points = r.u32("point count")?;
    let bits = r.u32("array bits")?;
    let default_segments = r.u32("default segments")?;
    r.seek(0);
    r.take(HEADER_BYTES, 1, "header")?;
    if n_strands == 0 {
        return Err(r.bad("strand count", 4, "no strands"));
    }
    if bits & HAS_POINTS == 0 {
        return Err(r.bad("array bits", 12, format!("{bits:#x} announces no points")));
    }

    let segments_offset = r.offset();
    let point_counts: Vec<u32> = if bits & HAS_SEGMENTS != 0 {
        let raw = r.take(u64::from(n_strands), 2, "segment counts")?;
        raw.chunks_exact(2).map(|b| u32::from(u16::from_le_bytes([b[0], b[1]])) + 1).collect()
    } else {
        let expected = u64::from(n_strands) * (u64::from(default_segments) + 1);
        if expected != u64::from(n_points) {
            let why = format!(
                "{n_strands} strands of {default_segments} default segments need {expected} points, the header says {n_points}"
            );
            return Err(r.bad("point count", 8, why));
        }
        // Each strand takes at least one point, so the file's length bounds the strand count here too.
        let bytes_left = (bytes.len() as u64).saturating_sub(HEADER_BYTES);
        if u64::from(n_strands) * 12 > bytes_left {
            return Err(Error::Truncated {
                path: path.to_path_buf(),
                field: "points",
                offset: HEADER_BYTES,
                needed: expected.saturating_mul(12),
                available: bytes_left,
            });
        }
        vec![default_segments + 1; n_strands as usize]
    };
    let counted: u64 = point_counts.iter().map(|&n| u64::from(n)).sum();
    if counted != u64::from(n_points) {
        let why = format!("segments add up to {counted} points, the header says {n_points}");
        return Err(r.bad("segment counts", segments_offset, why));
    }

    let points_offset = r.offset();
    let raw = r.take(u64::from(n_points), 12, "points")?;
    let points = scaled_points(&r, raw, 3, points_offset, unit)?;
    Ok(Groom { point_counts, points })
}

/// Points from packed floats of which the first three of each `stride` are used; refuses non-finite ones.
pub(crate) fn scaled_points(
    r: &ByteReader<'_>,
    raw: &[u8],
    stride: usize,
    offset: u64,
    unit: LengthUnit,
) -> Result<Vec<[f32; 3]>> {
    let cm = unit.cm_per_unit();
    let n = raw.len() / (4 * stride);
    let mut points = Vec::with_capacity(n);
    for i in 0..n {
        let p: [f32; 3] = std::array::from_fn(|k| (f64::from(f32_at(raw, i * stride + k)) * cm) as f32);
        if p.iter().any(|x| !x.is_finite()) {
            let at = offset + (i * stride * 4) as u64;
            return Err(r.bad("points", at, format!("point {i} is not finite")));
        }
        points.push(p);
    }
    Ok(points)
}

/// Writes a `.hair` file with a segment array and points, in `unit`.
///
/// # Errors
/// When a strand has no points or more than 65,536, counts do not add up, or the file cannot be written.
pub fn write_hair(path: &Path, groom: &Groom, unit: LengthUnit) -> Result<()> {
    let bytes = hair_bytes(path, groom, unit)?;
    let temporary = temporary_path(path);
    let mut file = std::fs::File::create(&temporary).map_err(Error::io("create", &temporary))?;
    file.write_all(&bytes).map_err(Error::io("write", &temporary))?;
    publish(file, &temporary, path)
}

fn hair_bytes(path: &Path, groom: &Groom, unit: LengthUnit) -> Result<Vec<u8>> {
    let refuse = |reason: String| Error::CannotWrite { path: path.to_path_buf(), reason };
    let n_counted: u64 = groom.point_counts.iter().map(|&n| u64::from(n)).sum();
    if n_counted != groom.points.len() as u64 {
        return Err(Error::PointCountMismatch { n_points: groom.points.len(), n_counted });
    }
    let n_strands = u32::try_from(groom.n_strands()).map_err(|_| refuse("too many strands".into()))?;
    let n_points = u32::try_from(groom.points.len()).map_err(|_| refuse("too many points".into()))?;
    let mut out = Vec::with_capacity(HEADER_BYTES as usize + groom.n_strands() * 2 + groom.points.len() * 12);
    out.extend_from_slice(b"HAIR");
    for word in [n_strands, n_points, HAS_SEGMENTS | HAS_POINTS, 0] {
        out.extend_from_slice(&word.to_le_bytes());
    }
    // Default thickness, transparency and colour: unused by readers that only want the curves.
    for value in [0.01_f32, 0.0, 0.5, 0.5, 0.5] {
        out.extend_from_slice(&value.to_le_bytes());
    }
    let mut info = [0_u8; INFO_BYTES];
    let text = b"adaptive hair skinning";
    info[..text.len()].copy_from_slice(text);
    out.extend_from_slice(&info);
    for (i, &n) in groom.point_counts.iter().enumerate() {
        let segments = n
            .checked_sub(1)
            .and_then(|s| u16::try_from(s).ok())
            .ok_or_else(|| refuse(format!("strand {i} has {n} points; the format holds 1 to 65536")))?;
        out.extend_from_slice(&segments.to_le_bytes());
    }
    let per_cm = 1.0 / unit.cm_per_unit();
    for x in groom.points.iter().flatten() {
        out.extend_from_slice(&((f64::from(*x) * per_cm) as f32).to_le_bytes());
    }
    Ok(out)
}
