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

    /// The cells of points of the head frame, given by axis; the corner cell, 0, for all points outside the box, in its rim
    /// or not finite.
    #[inline(always)]
    pub(crate) fn cells_of<const N: usize>(&self, p: &[[f32; N]; 3], inv_cell: f32) -> [u32; N] {
        self.indices(&self.places(p, inv_cell, 0.0))
    }

    /// As [`Lattice::cells_of`] the cells whose centres are next below points in each direction, and how far past those
    /// centres the points are, in cells.
    #[inline(always)]
    pub(crate) fn bases_of<const N: usize>(&self, p: &[[f32; N]; 3], inv_cell: f32) -> ([u32; N], [[f32; N]; 3]) {
        let places = self.places(p, inv_cell, 0.5);
        let mut past = [[0.0; N]; 3];
        for c in 0..3 {
            for l in 0..N {
                past[c][l] = places[c][l] - places[c][l] as i32 as f32;
            }
        }
        (self.indices(&places), past)
    }

    #[inline(always)]
    fn places<const N: usize>(&self, p: &[[f32; N]; 3], inv_cell: f32, centre: f32) -> [[f32; N]; 3] {
        let mut places = [[0.0; N]; 3];
        for c in 0..3 {
            let first = self.first[c] as f32 + centre;
            for l in 0..N {
                places[c][l] = p[c][l] * inv_cell - first;
            }
        }
        places
    }

    #[inline(always)]
    fn indices<const N: usize>(&self, places: &[[f32; N]; 3]) -> [u32; N] {
        let dims = [self.dims[0] as i32, self.dims[1] as i32, self.dims[2] as i32];
        let [nx, ny, _] = dims;
        let most = [dims[0] - 1 - RIM, dims[1] - 1 - RIM, dims[2] - 1 - RIM];
        let mut index = [0; N];
        for l in 0..N {
            // Truncation is the floor for all that is kept; what is not a number becomes zero, in the rim.
            let at = [places[0][l] as i32, places[1][l] as i32, places[2][l] as i32];
            let low = (at[0] >= RIM) & (at[1] >= RIM) & (at[2] >= RIM);
            let inside = low & (at[0] <= most[0]) & (at[1] <= most[1]) & (at[2] <= most[2]);
            let i = at[2].wrapping_mul(ny).wrapping_add(at[1]).wrapping_mul(nx).wrapping_add(at[0]);
            index[l] = if inside { i as u32 } else { 0 };
        }
        index
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
    pub(crate) fn in_head_frame(&self, p: [f32; 3]) -> [f32; 3] {
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

    /// As [`Frame::in_head_frame`], many points by axis.
    #[inline(always)]
    pub(crate) fn lanes_in_head<const N: usize>(&self, p: &[[f32; N]; 3]) -> [[f32; N]; 3] {
        if self.is_head {
            return *p;
        }
        let (mut out, t) = ([[0.0; N]; 3], self.translation);
        for c in 0..3 {
            let m = self.columns[c];
            for l in 0..N {
                out[c][l] = m[0] * (p[0][l] - t[0]) + m[1] * (p[1][l] - t[1]) + m[2] * (p[2][l] - t[2]);
            }
        }
        out
    }

    /// A direction of the head frame in that of the positions.
    #[inline(always)]
    pub(crate) fn out_of_head(&self, d: [f32; 3]) -> [f32; 3] {
        if self.is_head {
            return d;
        }
        let m = &self.columns;
        std::array::from_fn(|c| m[0][c] * d[0] + m[1][c] * d[1] + m[2][c] * d[2])
    }
}
