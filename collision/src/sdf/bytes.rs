//! A distance field as bytes and back, so that a program may keep what it baked.
//!
//! Little-endian: version, box, counts, trust, quanta, table, values. Reading checks every count against the length and every place
//! of the table against the values, so that no field made of damaged bytes can be sampled outside its memory. Whether
//! the numbers are the right ones is for a checksum to say.

use nalgebra::Vector3;

use crate::error::Error;
use crate::sdf::SignedDistanceField;
use crate::sdf::bricks::{BRICK, COARSE, LINE, LINES, Layout, Line, VALUES};
use crate::sdf::grid::Trust;

/// Changes with the layout of the bytes or with what a bake computes.
pub const FIELD_VERSION: u32 = 2;

/// Numbers before the table.
const HEADER: usize = 16;

impl SignedDistanceField {
    /// The field as bytes; the same field gives the same bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let layout = self.layout();
        let (origin, nodes) = (self.origin(), self.nodes());
        let mut out = Vec::with_capacity(4 * (HEADER + layout.table.len()) + layout.bytes());
        let mut put = |word: u32| out.extend_from_slice(&word.to_le_bytes());
        put(FIELD_VERSION);
        for x in [origin.x, origin.y, origin.z, self.cell()] {
            put(x.to_bits());
        }
        for n in nodes {
            put(n as u32);
        }
        for x in [self.max_error(), self.band(), self.far_error()] {
            put(x.to_bits());
        }
        put(layout.lines.len() as u32);
        put(layout.quantum.to_bits());
        put(layout.coarse_quantum.to_bits());
        for _ in 14..HEADER {
            put(0);
        }
        layout.table.iter().for_each(|&entry| put(entry));
        out.extend(layout.lines.iter().flat_map(|line| line.0).flat_map(i16::to_le_bytes));
        out
    }

    /// The field that [`Self::to_bytes`] wrote.
    ///
    /// # Errors
    /// [`Error::BadBytes`] for bytes of another version, cut short, or with places outside their own values.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        let bad = |reason| Err(Error::BadBytes { reason });
        if bytes.len() < 4 * HEADER || !bytes.len().is_multiple_of(4) {
            return bad("they are cut short");
        }
        let words = |from: usize, n: usize| {
            bytes[4 * from..4 * (from + n)].chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        };
        let mut head = [0; HEADER];
        head.iter_mut().zip(words(0, HEADER)).for_each(|(h, w)| *h = w);
        if head[0] != FIELD_VERSION {
            return bad("they are of another version");
        }
        let [ox, oy, oz, cell] = [1, 2, 3, 4].map(|n: usize| f32::from_bits(head[n]));
        let nodes = [5, 6, 7].map(|n: usize| head[n] as usize);
        let [max_error, band, far_error] = [8, 9, 10].map(|n: usize| f32::from_bits(head[n]));
        let [quantum, coarse_quantum] = [12, 13].map(|n: usize| f32::from_bits(head[n]));
        let origin = Vector3::new(ox, oy, oz);
        let sound = origin.iter().all(|x| x.is_finite())
            && cell.is_finite()
            && cell > 0.0
            && [quantum, coarse_quantum].iter().all(|x| x.is_finite() && *x > 0.0)
            && [max_error, band, far_error].iter().all(|x| x.is_finite() && *x >= 0.0)
            && nodes.iter().all(|&n| (2..=1 << 30).contains(&n));
        if !sound {
            return bad("their numbers are out of range");
        }
        let count = nodes.map(|n| (n - 1).div_ceil(BRICK));
        let n_lines = head[11] as usize;
        let n_bricks = count.iter().try_fold(1usize, |a, &n| a.checked_mul(n)).unwrap_or(usize::MAX);
        let n_line_words = n_lines.saturating_mul(LINE / 2);
        let n_words = n_bricks.checked_add(n_line_words).and_then(|n| n.checked_add(HEADER));
        if n_words != Some(bytes.len() / 4) || !n_lines.is_multiple_of(LINES) {
            return bad("their length is not that of their counts");
        }
        let table: Vec<u32> = words(HEADER, n_bricks).collect();
        let lines: Vec<Line> = bytes[4 * (HEADER + n_bricks)..]
            .chunks_exact(2 * LINE)
            .map(|line| Line(std::array::from_fn(|n| i16::from_le_bytes([line[2 * n], line[2 * n + 1]]))))
            .collect();
        let reaches = |entry: u32| {
            let first = (entry & !COARSE) as usize;
            if entry & COARSE != 0 { first + 1 } else { first + VALUES }
        };
        if table.iter().any(|&entry| reaches(entry) > n_lines * LINE) {
            return bad("their table points outside their values");
        }
        let trust = Trust { max_error, band, far_error };
        Ok(Self::from_layout(origin, cell, nodes, Layout { count, table, lines, quantum, coarse_quantum }, trust))
    }
}
