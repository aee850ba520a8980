//! Cells of the head frame: which box of them a read needs, and which cell a particle is in.
//!
//! Cell `i` along an axis covers `[i, i + 1)` times the cell's edge from the head frame's origin, whatever the box: cells at
//! rest are cells ever after. A box is whole blocks of [`ALIGN`] cells, so that it halves to the coarsest level.

use nalgebra::{Isometry3, Matrix3};

/// Boxes start and end at multiples of this many cells.
pub(crate) const ALIGN: i32 = 8;

/// Cells at each face of a box that hold no particle: smoothing then stays inside it.
pub(crate) const RIM: i32 = 2;

/// Most cells along an axis: hair that flies farther than this is not counted.
const MAX_SIDE: i32 = 256;

/// A box of cells; x runs fastest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Lattice {
    /// Lattice coordinates of its first cell.
    pub first: [i32; 3],
    /// Cells along each axis.
    pub dims: [usize; 3],
}

impl Lattice {
    /// The box around points between `low` and `high` (cm, head frame).
    pub(crate) fn around(low: [f32; 3], high: [f32; 3], cell: f32) -> Self {
        let mut lattice = Self::default();
        for c in 0..3 {
            let first = (((low[c] / cell).floor() as i32).max(-MAX_SIDE) - RIM).div_euclid(ALIGN) * ALIGN;
            let last = ((high[c] / cell).floor() as i32).min(first + MAX_SIDE) + RIM;
            lattice.first[c] = first;
            lattice.dims[c] = ((last - first + 1).max(1) as usize).next_multiple_of(ALIGN as usize);
        }
        lattice
    }

    pub(crate) fn n_cells(&self) -> usize {
        self.dims[0] * self.dims[1] * self.dims[2]
    }

    /// Cells of a plane of constant z.
    pub(crate) fn plane(&self) -> usize {
        self.dims[0] * self.dims[1]
    }

    /// Centre of a cell, cm.
    pub(crate) fn centre(&self, at: [usize; 3], cell: f32) -> [f32; 3] {
        std::array::from_fn(|c| (self.first[c] as f32 + at[c] as f32 + 0.5) * cell)
    }

    /// The cell of a point of the head frame and the point's place in cells from the box's corner; the corner cell, 0, for
    /// all points outside the box, in its rim or not finite.
    #[inline(always)]
    pub(crate) fn cell_of(&self, p: [f32; 3], inv_cell: f32) -> (usize, [f32; 3]) {
        let place: [f32; 3] = std::array::from_fn(|c| p[c] * inv_cell - self.first[c] as f32);
        // Truncation is the floor for all that is kept; what is not a number becomes zero, in the rim.
        let at: [i32; 3] = std::array::from_fn(|c| place[c] as i32);
        let inside = (0..3).fold(true, |inside, c| inside & (at[c] >= RIM) & (at[c] < self.dims[c] as i32 - RIM));
        let index = (at[2] as usize).wrapping_mul(self.dims[1]).wrapping_add(at[1] as usize);
        let index = index.wrapping_mul(self.dims[0]).wrapping_add(at[0] as usize);
        (if inside { index } else { 0 }, place)
    }
}

/// The frame that positions are given in, as seen from the head.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    /// Columns of `world_from_head`'s rotation.
    columns: [[f32; 3]; 3],
    translation: [f32; 3],
    is_head: bool,
}

impl Frame {
    pub(crate) fn new(world_from_head: &Isometry3<f64>) -> Self {
        let m: Matrix3<f32> = world_from_head.rotation.to_rotation_matrix().matrix().cast();
        Self {
            columns: std::array::from_fn(|c| [m[(0, c)], m[(1, c)], m[(2, c)]]),
            translation: world_from_head.translation.vector.cast().into(),
            is_head: *world_from_head == Isometry3::identity(),
        }
    }

    /// A point in the head frame.
    #[inline(always)]
    pub(crate) fn to_head(&self, p: [f32; 3]) -> [f32; 3] {
        if self.is_head {
            return p;
        }
        let t = self.translation;
        let d = [p[0] - t[0], p[1] - t[1], p[2] - t[2]];
        std::array::from_fn(|c| {
            let m = self.columns[c];
            m[0] * d[0] + m[1] * d[1] + m[2] * d[2]
        })
    }

    /// A direction of the head frame in that of the positions.
    #[inline(always)]
    pub(crate) fn from_head(&self, d: [f32; 3]) -> [f32; 3] {
        if self.is_head {
            return d;
        }
        let m = &self.columns;
        std::array::from_fn(|c| m[0][c] * d[0] + m[1][c] * d[1] + m[2][c] * d[2])
    }
}
