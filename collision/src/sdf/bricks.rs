//! How the values of a distance field lie in memory: bricks of 4³ cells, fine or coarse, a cache line for every 2³ cells.
//!
//! A line is 3³ nodes, x fastest, those on its faces stored with every line that has them: the eight corners of a cell stand at
//! fixed places from the first, and a sample reads one line. A table says for each brick of the grid where its
//! lines begin. Where the surface is far, one brick with nodes four cells apart serves 4³ of them, and the table points at the
//! one cell of it that is the brick. Values are whole numbers of one quantum in all fine bricks, and of another, sixteen times a power of two as
//! large, in all coarse ones: what a coarse brick interpolates at the fine nodes of its faces is then a whole number too.
//! Invariant: neighbours agree exactly on the face between them, so the field is continuous.

use rayon::prelude::*;

/// Cells along the edge of a brick; cells of a coarse brick are this many fine cells long.
pub(super) const BRICK: usize = 4;
/// Nodes along the edge of a brick.
pub(super) const EDGE: usize = BRICK + 1;
/// Nodes of a brick.
pub(super) const NODES: usize = EDGE * EDGE * EDGE;
/// Cells along the edge of what a line holds.
const PART: usize = 2;
/// Values from a node to the next along y and along z, in a line.
const ROW: usize = PART + 1;
const SLAB: usize = ROW * ROW;
/// Values of a line, the last five unused.
pub(super) const LINE: usize = 32;
/// Lines of a brick.
pub(super) const LINES: usize = 8;
/// Values from a brick to the next.
pub(super) const VALUES: usize = LINES * LINE;
/// Mark of the table: the place is a cell of a coarse brick.
pub(super) const COARSE: u32 = 1 << 31;
/// First corners of the four edges along x of a cell, at (y, z) = (0,0), (1,0), (0,1), (1,1), from its first corner on.
pub(super) const CORNERS: [usize; 4] = [0, ROW, SLAB, SLAB + ROW];
/// Values from the first corner of a cell to past its last.
pub(super) const SPAN: usize = SLAB + ROW + 2;
/// Finest quantum, as a share of a cell: slopes are then good to a two-thousandth, and 16 bits reach sixteen cells.
const FINEST: f32 = 1.0 / 2048.0;
/// Quanta of a fine brick in one of a coarse one, at least: halves of halves along two axes of a face are sixteenths.
pub(super) const COARSE_QUANTA: f32 = (BRICK * BRICK) as f32;

/// Values of 2³ cells.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Line(pub [i16; LINE]);

impl Line {
    pub const ZERO: Self = Self([0; LINE]);
}

/// The bricks of a grid.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Layout {
    /// Bricks along x, y, z.
    pub count: [usize; 3],
    /// For each brick, x fastest, its first value, or that of its cell in a coarse brick with [`COARSE`] set.
    pub table: Vec<u32>,
    /// [`LINES`] a brick.
    pub lines: Vec<Line>,
    /// What one stands for in fine and in coarse bricks, cm.
    pub quantum: f32,
    pub coarse_quantum: f32,
}

/// Offset of node (x, y, z) among the nodes of a brick.
#[inline(always)]
pub(super) fn node(x: usize, y: usize, z: usize) -> usize {
    x + EDGE * y + EDGE * EDGE * z
}

/// First corner of cell (x, y, z) of a brick; higher bits of the coordinates do not matter.
#[inline(always)]
pub(super) fn first_corner(x: u32, y: u32, z: u32) -> u32 {
    let line = (x >> 1 & 1) | (y & 2) | (z & 2) << 1;
    line * LINE as u32 + (x & 1) + ROW as u32 * (y & 1) + SLAB as u32 * (z & 1)
}

/// A power of two times a cell, or times a quantum, that takes values up to `largest` to 16 bits.
pub(super) fn quantum(finest: f32, largest: f32) -> f32 {
    let mut quantum = finest;
    while largest > quantum * f32::from(i16::MAX) {
        quantum *= 2.0;
    }
    quantum
}

/// The quantum of fine bricks with values up to `largest` cm.
pub(super) fn fine_quantum(cell: f32, largest: f32) -> f32 {
    quantum(cell * FINEST, largest)
}

/// A distance in whole quanta, never more than it is: what bounds a distance from below still does.
#[inline]
pub(super) fn in_quanta(distance: f32, quantum: f32) -> i16 {
    (distance / quantum).floor() as i16
}

/// The lines of a brick.
pub(super) fn lines(nodes: &[i16; NODES]) -> [Line; LINES] {
    std::array::from_fn(|n| {
        let [x, y, z] = [n & 1, n >> 1 & 1, n >> 2].map(|first| first * PART);
        let mut line = Line::ZERO;
        for k in 0..ROW {
            for j in 0..ROW {
                let from = node(x, y + j, z + k);
                line.0[ROW * j + SLAB * k..][..ROW].copy_from_slice(&nodes[from..from + ROW]);
            }
        }
        line
    })
}

impl Layout {
    /// Fine everywhere; `values` holds `nodes[0] * nodes[1] * nodes[2]` distances, x fastest, cm.
    pub fn dense(nodes: [usize; 3], cell: f32, values: &[f32]) -> Self {
        let [nx, ny, nz] = nodes;
        assert_eq!(values.len(), nx * ny * nz, "one value per node");
        let largest = values.par_iter().map(|v| v.abs()).reduce(|| 0.0, f32::max);
        let quantum = fine_quantum(cell, largest);
        let count = nodes.map(|n| (n - 1).div_ceil(BRICK));
        let n_bricks: usize = count.iter().product();
        let mut bricks = vec![Line::ZERO; n_bricks * LINES];
        bricks.par_chunks_mut(LINES).enumerate().for_each(|(n, brick)| {
            let [bx, by, bz] = [n % count[0], n / count[0] % count[1], n / (count[0] * count[1])].map(|b| b * BRICK);
            let mut at_nodes = [0; NODES];
            for z in 0..EDGE.min(nz - bz) {
                for y in 0..EDGE.min(ny - by) {
                    let from = ((bz + z) * ny + by + y) * nx + bx;
                    for x in 0..EDGE.min(nx - bx) {
                        at_nodes[node(x, y, z)] = in_quanta(values[from + x], quantum);
                    }
                }
            }
            brick.copy_from_slice(&lines(&at_nodes));
        });
        let table = (0..n_bricks).map(|n| (n * VALUES) as u32).collect();
        Self { count, table, lines: bricks, quantum, coarse_quantum: quantum * COARSE_QUANTA }
    }

    /// The eight corner values of a cell in quanta: pairs along x, at (y, z) = (0,0), (1,0), (0,1), (1,1).
    #[inline(always)]
    pub fn corners(&self, first: usize) -> [[i16; 2]; 4] {
        let line = &self.lines[first / LINE].0;
        // No cell of a line begins past the thirteenth value; the mask saves asking.
        let v = &line[first % (LINE / 2)..][..SPAN];
        let pair = |c: usize| [v[c], v[c + 1]];
        // Not by `map`, which the compiler leaves as a call.
        [pair(CORNERS[0]), pair(CORNERS[1]), pair(CORNERS[2]), pair(CORNERS[3])]
    }

    #[inline(always)]
    pub fn entry(&self, bx: usize, by: usize, bz: usize) -> u32 {
        self.table[(bz * self.count[1] + by) * self.count[0] + bx]
    }

    pub fn bytes(&self) -> usize {
        size_of_val(self.lines.as_slice()) + self.table.len() * size_of::<u32>()
    }

    /// Largest gradient, in cm a cell, over all cells that are not inside throughout, bounded by the largest slopes
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
                    let per_cell = self.coarse_quantum / BRICK as f32;
                    return self.slope2(base) * (per_cell * per_cell);
                }
                let brick = [n % cx, n / cx % cy, n / (cx * cy)];
                let cells = [0, 1, 2].map(|k: usize| BRICK.min(nodes[k] - 1 - brick[k] * BRICK));
                let mut most = 0.0f32;
                for z in 0..cells[2] {
                    for y in 0..cells[1] {
                        for x in 0..cells[0] {
                            most = most.max(self.slope2(base + first_corner(x as u32, y as u32, z as u32) as usize));
                        }
                    }
                }
                most * (self.quantum * self.quantum)
            })
            .reduce(|| 0.0, f32::max);
        most.sqrt()
    }

    /// Squared bound of the gradient in one cell, in quanta an edge, zero where all of it is inside.
    fn slope2(&self, first: usize) -> f32 {
        let c = self.corners(first).map(|pair| pair.map(f32::from));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sdf::bake::BakeParams;
    use crate::sdf::mesh::ClosedMesh;
    use crate::sdf::mesh_bake::bake_closed;

    /// Value at node `at` of a brick, in quanta of fine bricks, by the brick's own numbers; in whole sixteenths it is exact.
    fn value(layout: &Layout, brick: [usize; 3], at: [usize; 3]) -> f32 {
        let entry = layout.entry(brick[0], brick[1], brick[2]);
        let first = (entry & !COARSE) as usize;
        if entry & COARSE == 0 {
            // The cell that has the node as its first corner, or its last along an axis.
            let cell = at.map(|n| n.min(BRICK - 1));
            let [x, y, z] = [0, 1, 2].map(|k: usize| at[k] - cell[k]);
            let [i, j, k] = cell.map(|n| n as u32);
            return f32::from(layout.corners(first + first_corner(i, j, k) as usize)[y + 2 * z][x]);
        }
        let c = layout.corners(first).map(|pair| pair.map(f32::from));
        let [x, y, z] = at.map(|n| n as f32 / BRICK as f32);
        let edges = c.map(|[a, b]| a + x * (b - a));
        let (y0, y1) = (edges[0] + y * (edges[1] - edges[0]), edges[2] + y * (edges[3] - edges[2]));
        (y0 + z * (y1 - y0)) * (layout.coarse_quantum / layout.quantum)
    }

    #[test]
    fn neighbours_agree_exactly_at_every_node_of_the_face_between_them() {
        // A wedge, slanting against the grid; fine, coarse, and a band that makes the range of the values wide.
        let points = [[-1.0, -0.4, -0.3], [1.0, -0.5, 0.1], [0.0, 0.8, 0.0], [0.1, 0.0, 1.3]];
        let closed = ClosedMesh::new(&points, &[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]).expect("a tetrahedron");
        for band_cells in [0.0, 2.0, 30.0] {
            let params = BakeParams { margin: 2.0, band_cells, ..BakeParams::with_cell(0.043) };
            let field = bake_closed(&closed, params).expect("a sound mesh");
            let layout = field.layout();
            let n_bricks = layout.table.len();
            let n_coarse = layout.table.iter().filter(|&entry| entry & COARSE != 0).count();
            assert!(n_coarse > n_bricks / 10 && n_coarse < n_bricks, "{n_coarse} of {n_bricks}: hardly tried");
            for n in 0..n_bricks {
                let [cx, cy, _] = layout.count;
                let here = [n % cx, n / cx % cy, n / (cx * cy)];
                for axis in 0..3 {
                    let mut next = here;
                    next[axis] += 1;
                    if next[axis] == layout.count[axis] {
                        continue;
                    }
                    for (u, v) in (0..EDGE * EDGE).map(|n| (n % EDGE, n / EDGE)) {
                        let (mut last, mut first) = ([0; 3], [0; 3]);
                        (last[axis], first[axis]) = (BRICK, 0);
                        for at in [&mut last, &mut first] {
                            (at[(axis + 1) % 3], at[(axis + 2) % 3]) = (u, v);
                        }
                        assert_eq!(value(layout, here, last), value(layout, next, first), "{here:?} and {next:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_distance_in_quanta_is_never_above_it_and_less_than_one_below() {
        for cell in [1e-6f32, 0.013, 1.0, 7.7e5] {
            for n in -40_000..40_000 {
                let distance = n as f32 * 3.1e-3 * cell;
                let q = fine_quantum(cell, 130.0 * cell);
                let kept = f32::from(in_quanta(distance, q)) * q;
                // One rounding of the quotient.
                let round_off = f32::EPSILON * distance.abs();
                assert!(kept <= distance + round_off && distance < kept + q + round_off, "{distance} kept as {kept}");
            }
        }
    }
}
