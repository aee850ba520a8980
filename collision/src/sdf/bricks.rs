//! How the values of a distance field lie in memory: bricks of 4³ cells with all their corners, fine or coarse.
//!
//! A brick is 5³ nodes, x fastest, those on its faces stored with every brick that has them, so that the eight corners of
//! a cell stand at fixed places from the first. A table says for each brick of the grid where its nodes begin. Where the
//! surface is far, one brick with nodes four cells apart serves 4³ of them, and the table points at the one cell of it that
//! is the brick. Invariant: neighbours agree on the face between them, so the field is continuous.

use rayon::prelude::*;

/// Cells along the edge of a brick; cells of a coarse brick are this many fine cells long.
pub(super) const BRICK: usize = 4;
/// Nodes from one to the next along y and along z.
pub(super) const ROW: usize = BRICK + 1;
pub(super) const SLAB: usize = ROW * ROW;
/// Nodes of a brick.
pub(super) const NODES: usize = ROW * SLAB;
/// Values from a brick to the next: whole cache lines.
pub(super) const VALUES: usize = 128;
/// Mark of the table: the place is a cell of a coarse brick.
pub(super) const COARSE: u32 = 1 << 31;
/// First corners of the four edges along x of a cell, at (y, z) = (0,0), (1,0), (0,1), (1,1), from its first corner on.
pub(super) const CORNERS: [usize; 4] = [0, ROW, SLAB, SLAB + ROW];
/// Values from the first corner of a cell to past its last.
pub(super) const SPAN: usize = SLAB + ROW + 2;

/// The bricks of a grid.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Layout {
    /// Bricks along x, y, z.
    pub count: [usize; 3],
    /// For each brick, x fastest, its first value, or that of its cell in a coarse brick with [`COARSE`] set.
    pub table: Vec<u32>,
    /// [`VALUES`] a brick, the last three unused; cm.
    pub values: Vec<f32>,
}

/// Offset of node (x, y, z) of a brick.
#[inline(always)]
pub(super) fn node(x: usize, y: usize, z: usize) -> usize {
    x + ROW * y + SLAB * z
}

impl Layout {
    /// Fine everywhere; `values` holds `nodes[0] * nodes[1] * nodes[2]` distances, x fastest.
    pub fn dense(nodes: [usize; 3], values: &[f32]) -> Self {
        let [nx, ny, nz] = nodes;
        assert_eq!(values.len(), nx * ny * nz, "one value per node");
        let count = nodes.map(|n| (n - 1).div_ceil(BRICK));
        let n_bricks: usize = count.iter().product();
        let mut bricks = vec![0.0; n_bricks * VALUES];
        bricks.par_chunks_mut(VALUES).enumerate().for_each(|(n, brick)| {
            let [bx, by, bz] = [n % count[0], n / count[0] % count[1], n / (count[0] * count[1])].map(|b| b * BRICK);
            for z in 0..ROW.min(nz - bz) {
                for y in 0..ROW.min(ny - by) {
                    let from = ((bz + z) * ny + by + y) * nx + bx;
                    let n_x = ROW.min(nx - bx);
                    brick[node(0, y, z)..][..n_x].copy_from_slice(&values[from..from + n_x]);
                }
            }
        });
        let table = (0..n_bricks).map(|n| (n * VALUES) as u32).collect();
        Self { count, table, values: bricks }
    }

    #[inline(always)]
    pub fn entry(&self, bx: usize, by: usize, bz: usize) -> u32 {
        self.table[(bz * self.count[1] + by) * self.count[0] + bx]
    }

    pub fn bytes(&self) -> usize {
        self.values.len() * size_of::<f32>() + self.table.len() * size_of::<u32>()
    }

    /// Largest gradient, in values a cell, over all cells that are not inside throughout, bounded by the largest slopes
    /// along the three axes; `nodes` as many as the grid has, cells past them do not count.
    pub fn steepest(&self, nodes: [usize; 3]) -> f32 {
        let [cx, cy, _] = self.count;
        let most = self
            .table
            .par_iter()
            .enumerate()
            .map(|(n, &entry)| {
                let base = (entry & !COARSE) as usize;
                if entry & COARSE != 0 {
                    return self.slope2(base) / (BRICK * BRICK) as f32;
                }
                let brick = [n % cx, n / cx % cy, n / (cx * cy)];
                let cells = [0, 1, 2].map(|k: usize| BRICK.min(nodes[k] - 1 - brick[k] * BRICK));
                let mut most = 0.0f32;
                for z in 0..cells[2] {
                    for y in 0..cells[1] {
                        for x in 0..cells[0] {
                            most = most.max(self.slope2(base + node(x, y, z)));
                        }
                    }
                }
                most
            })
            .reduce(|| 0.0, f32::max);
        most.sqrt()
    }

    /// Squared bound of the gradient in one cell, zero where all of it is inside.
    fn slope2(&self, first: usize) -> f32 {
        let v = &self.values[first..first + SPAN];
        let c = CORNERS.map(|c| [v[c], v[c + 1]]);
        if c.iter().flatten().all(|&d| d < 0.0) {
            return 0.0;
        }
        let mut slope = [0.0f32; 3];
        for [a, b] in c {
            slope[0] = slope[0].max((b - a).abs());
        }
        for n in 0..2 {
            slope[1] = slope[1].max((c[1][n] - c[0][n]).abs()).max((c[3][n] - c[2][n]).abs());
            slope[2] = slope[2].max((c[2][n] - c[0][n]).abs()).max((c[3][n] - c[1][n]).abs());
        }
        slope[0] * slope[0] + slope[1] * slope[1] + slope[2] * slope[2]
    }
}
