//! Bakes a closed mesh: exact distances at the nodes of all bricks that may come near its surface, and at their corners
//! elsewhere.
//!
//! Distances come from the tree of triangles; the sign from winding numbers, asked once for each set of nodes that are
//! surely on one side: two nodes are, where their balls free of surface cover the way between them. Nodes on the face of
//! a coarse brick take its value, so that the field is continuous; they lie farther than the band. Work is cut into blocks of
//! 16³ cells whatever the number of threads, so the bytes do not depend on it.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::error::Error;
use crate::sdf::BakeParams;
use crate::sdf::bake::{Lattice, SAFETY, overstatement, round_off};
use crate::sdf::bricks::{
    BRICK, COARSE, COARSE_QUANTA, EDGE, LINE, Layout, Line, NODES, VALUES, fine_quantum, first_corner, in_quanta,
    lines, node, quantum,
};
use crate::sdf::grid::{Bounds, SignedDistanceField, Trust};
use crate::sdf::mesh::ClosedMesh;
use crate::sdf::tree::{Hint, Nearby, TriangleTree};
use crate::thickness::smallest_half_thickness;

/// Cells across the smallest half-thickness.
const CELLS_PER_HALF_THICKNESS: f32 = 4.0;
/// Most bricks of a grid, so that places in it fit 31 bits.
const MAX_BRICKS: usize = (1 << 31) / VALUES - 1;
/// Fine cells, bricks and nodes along the edge of a block.
const BLOCK: usize = 16;
const BLOCK_BRICKS: usize = BLOCK / BRICK;
const BLOCK_NODES: usize = BLOCK + 1;
/// Bytes of a brick.
const BRICK_BYTES: usize = VALUES * size_of::<i16>();

/// How far from the surface the middle of a brick may be for the brick to be fine, in cells: half the diagonal of a brick, and
/// the diagonal of a cell, so that every cell within the band has exact corners.
fn reach_cells(params: &BakeParams) -> f32 {
    params.band_cells + 3f32.sqrt() * (0.5 * BRICK as f32 + 1.0)
}

/// Bakes a mesh already closed.
pub(crate) fn bake_closed(closed: &ClosedMesh, params: BakeParams) -> Result<SignedDistanceField, Error> {
    for (name, value) in [("margin", params.margin), ("band_cells", params.band_cells)] {
        if value.is_nan() || value < 0.0 || (name == "margin" && value.is_infinite()) {
            return Err(Error::BadParameter { name, value, above: 0.0 });
        }
    }
    let mut coarse = plan(closed, &params)?;
    let _span = tracing::debug_span!("bake", cell = coarse.cell, bricks = coarse.near.len()).entered();
    coarse.take_signs(closed);

    let blocks: Vec<BakedBlock> = (0..coarse.n_blocks())
        .into_par_iter()
        .map_init(Buffers::default, |buffers, n| Block::new(&coarse, n).bake(closed, buffers))
        .collect();
    let mut layout = Layout {
        count: coarse.count,
        table: vec![0; coarse.near.len()],
        lines: Vec::new(),
        quantum: coarse.quantum,
        coarse_quantum: coarse.coarse_quantum,
    };
    layout.lines.reserve_exact(blocks.iter().map(|b| b.lines.len()).sum());
    let (mut near_error, mut far_error) = (0.0f32, 0.0f32);
    for block in &blocks {
        let base = (layout.lines.len() * LINE) as u32;
        for &(brick, entry) in &block.entries {
            layout.table[brick] = entry + base;
        }
        layout.lines.extend_from_slice(&block.lines);
        near_error = near_error.max(block.near_error);
        far_error = far_error.max(block.far_error);
    }
    let bounds = coarse.bounds();
    let max_error = (near_error * SAFETY).max(round_off(&bounds));
    let trust = Trust {
        max_error,
        band: (params.band_cells * coarse.cell).min(f32::MAX),
        far_error: (far_error * SAFETY).max(max_error),
    };
    let nodes = coarse.count.map(|n| n * BRICK + 1);
    Ok(SignedDistanceField::from_layout(coarse.corners.origin, coarse.cell, nodes, layout, trust))
}

/// Box, cell and near bricks of a mesh's grid.
fn plan(closed: &ClosedMesh, params: &BakeParams) -> Result<Coarse, Error> {
    /// Bytes go as a power between two and three of the cell, so a few retries find one that fits.
    const RETRIES: usize = 100;
    const DOWN: f32 = 0.8;
    let rim = |cell: f32| closed.bounds.grown(params.margin.min(closed.bounds.size().norm()).max(2.0 * cell));
    if let Some(cell) = params.cell {
        return Coarse::new(closed, rim(cell), cell, params);
    }
    let wanted = smallest_half_thickness(&closed.indexed()?) / CELLS_PER_HALF_THICKNESS;
    // Where the near bricks are at least a layer as thick as their reach on one side of the surface. It fails to be that many
    // where layers overlap between thin parts: then the way goes down again first.
    let least_bytes = closed.area() * reach_cells(params) / (BRICK * BRICK * BRICK) as f32 * BRICK_BYTES as f32;
    let least_cell = (least_bytes / params.max_bytes.max(1) as f32).sqrt();
    let mut cell = if least_cell.is_finite() { wanted.max(least_cell) } else { wanted };
    while cell > wanted && Coarse::new(closed, rim(cell), cell, params).is_ok() {
        cell = wanted.max(cell * DOWN);
    }
    let mut retries = 0;
    loop {
        match Coarse::new(closed, rim(cell), cell, params) {
            Err(Error::TooLarge { bytes, max_bytes, .. }) if retries < RETRIES => {
                let over = bytes as f32 / max_bytes.max(1) as f32;
                cell *= over.cbrt().clamp(1.02, 100.0);
            }
            other => return other,
        }
        retries += 1;
    }
}

/// The coarse level: distances at the corners of bricks, and which bricks may come near the surface.
struct Coarse {
    /// Edge of a fine cell, cm.
    cell: f32,
    /// Bricks along x, y, z.
    count: [usize; 3],
    /// Corners of bricks.
    corners: Lattice,
    /// Distances at the corners, without sign in cm, and then, by [`Self::take_signs`], with it in quanta of fine bricks, a
    /// whole number of those of coarse ones.
    at_corners: Vec<f32>,
    /// Distances at the middles of bricks, without sign, cm.
    at_middles: Vec<f32>,
    near: Vec<bool>,
    /// Within this distance the grid is fine, cm.
    band: f32,
    /// Quanta of fine and of coarse bricks, cm.
    quantum: f32,
    coarse_quantum: f32,
}

impl Coarse {
    fn new(closed: &ClosedMesh, bounds: Bounds, cell: f32, params: &BakeParams) -> Result<Self, Error> {
        let fine = SignedDistanceField::plan(&bounds, cell, usize::MAX);
        let count = match fine {
            Ok(nodes) => nodes.map(|n| (n - 1).div_ceil(BRICK)),
            Err(Error::TooLarge { nodes, bytes, .. }) => {
                return Err(Error::TooLarge { nodes, bytes, max_bytes: params.max_bytes });
            }
            Err(e) => return Err(e),
        };
        let n_bricks: usize = count.iter().product();
        let too_large = |n_near: usize| {
            let n_blocks: usize = count.iter().map(|n| n.div_ceil(BLOCK_BRICKS)).product();
            let n_stored = if n_near == n_bricks { n_near } else { n_near + n_blocks };
            let bytes = n_stored * BRICK_BYTES + n_bricks * size_of::<u32>();
            let nodes = count.map(|n| n * BRICK + 1);
            let full = bytes > params.max_bytes || n_stored > MAX_BRICKS;
            if full { Err(Error::TooLarge { nodes, bytes, max_bytes: params.max_bytes }) } else { Ok(()) }
        };
        // The table alone may be too much: then no distance need be asked.
        too_large(0)?;
        let edge = BRICK as f32 * cell;
        let corners = Lattice { origin: bounds.min, cell: edge, nodes: count.map(|n| n + 1) };
        let middles = Lattice { origin: bounds.min + Vector3::repeat(0.5 * edge), cell: edge, nodes: count };
        let reach = reach_cells(params) * cell;
        // Of most grids only the blocks about the surface have near bricks: the others need not be asked for their number.
        let blocks = count.map(|n| n.div_ceil(BLOCK_BRICKS));
        let block_edge = BLOCK as f32 * cell;
        let block_middles =
            Lattice { origin: bounds.min + Vector3::repeat(0.5 * block_edge), cell: block_edge, nodes: blocks };
        // From the middle of a block to those of its bricks, and what is rounded on the way.
        let in_block = 0.5 * 3f32.sqrt() * (block_edge - edge) * 1.001;
        let may_be_near: Vec<bool> =
            distances(&closed.tree, &block_middles).iter().map(|&d| d <= reach + in_block).collect();
        let is_wanted = |at: [usize; 3]| may_be_near[block_middles.index(at.map(|n| n / BLOCK_BRICKS))];
        let mut at_middles = vec![f32::INFINITY; n_bricks];
        add_distances(&closed.tree, &middles, is_wanted, &mut at_middles);
        let near: Vec<bool> = at_middles.iter().map(|&d| d <= reach).collect();
        too_large(near.iter().filter(|&&near| near).count())?;
        add_distances(&closed.tree, &middles, |at| !is_wanted(at), &mut at_middles);
        let at_corners = distances(&closed.tree, &corners);
        // No node of a brick is farther from its middle than this; what it takes from a coarse one is a mean of its corners.
        let half_diagonal = 0.5 * 3f32.sqrt() * edge;
        let largest = |distances: &[f32], of: &dyn Fn(usize) -> bool| {
            (0..distances.len()).filter(|&n| of(n)).map(|n| distances[n]).fold(0.0, f32::max)
        };
        let quantum_near = fine_quantum(cell, (largest(&at_middles, &|n| near[n]) + half_diagonal) * 1.001);
        let coarse_quantum = quantum(quantum_near * COARSE_QUANTA, largest(&at_corners, &|_| true) * 1.001);
        let quantum = quantum_near;
        Ok(Self {
            cell,
            count,
            corners,
            at_corners,
            at_middles,
            near,
            band: params.band_cells * cell,
            quantum,
            coarse_quantum,
        })
    }

    fn bounds(&self) -> Bounds {
        Bounds::new(self.corners.origin, self.corners.position(self.count))
    }

    /// What the distances at two ends of a way must exceed together for balls around them to cover it, whatever was rounded: a
    /// way straight through a face would else let one side through to the other.
    fn surely_covered(&self, way: f32) -> f32 {
        way + 4.0 * round_off(&self.bounds())
    }

    fn n_blocks(&self) -> usize {
        self.count.iter().map(|n| n.div_ceil(BLOCK_BRICKS)).product()
    }

    fn brick(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.count[1] + y) * self.count[0] + x
    }

    /// Gives the distances at the corners their signs.
    fn take_signs(&mut self, closed: &ClosedMesh) {
        let unknown = vec![Side::Unknown; self.corners.n_nodes()];
        let mut flood = Flood { sides: unknown, queue: Vec::new() };
        let lattice = self.corners;
        flood.run(lattice.nodes, self.surely_covered(lattice.cell), &self.at_corners, |n| {
            closed.is_inside(lattice.position(lattice.node(n)))
        });
        let in_one = self.coarse_quantum / self.quantum;
        for (d, side) in self.at_corners.iter_mut().zip(&flood.sides) {
            let signed = if *side == Side::Inside { -*d } else { *d };
            *d = f32::from(in_quanta(signed, self.coarse_quantum)) * in_one;
        }
    }

    /// Trilinear value of a far brick at `t`, fractions across it, as it will be sampled; in quanta of fine bricks.
    fn value_in(&self, brick: [usize; 3], t: [f32; 3]) -> f32 {
        let at = |x: usize, y: usize, z: usize| {
            self.at_corners[self.corners.index([brick[0] + x, brick[1] + y, brick[2] + z])]
        };
        let x = |y, z| at(0, y, z) + t[0] * (at(1, y, z) - at(0, y, z));
        let y0 = x(0, 0) + t[1] * (x(1, 0) - x(0, 0));
        let y1 = x(0, 1) + t[1] * (x(1, 1) - x(0, 1));
        y0 + t[2] * (y1 - y0)
    }
}

/// Distances without sign at all nodes of a lattice.
fn distances(tree: &TriangleTree, lattice: &Lattice) -> Vec<f32> {
    let mut out = vec![0.0; lattice.n_nodes()];
    add_distances(tree, lattice, |_| true, &mut out);
    out
}

/// Distances without sign at those nodes of a lattice that are wanted; others stay.
fn add_distances(
    tree: &TriangleTree,
    lattice: &Lattice,
    is_wanted: impl Fn([usize; 3]) -> bool + Sync,
    out: &mut [f32],
) {
    let [nx, ny, _] = lattice.nodes;
    out.par_chunks_mut(nx * ny).enumerate().for_each_init(Vec::new, |points, (k, slab)| {
        let mut hint: Hint = 0;
        for (j, row) in slab.chunks_mut(nx).enumerate() {
            let mut begin = 0;
            while begin < nx {
                let wanted = is_wanted([begin, j, k]);
                let n = (begin..nx).take_while(|&i| is_wanted([i, j, k]) == wanted).count();
                if wanted {
                    points.clear();
                    points.extend((begin..begin + n).map(|i| lattice.position([i, j, k])));
                    tree.distances(points, &mut hint, &mut row[begin..begin + n]);
                }
                begin += n;
            }
        }
    });
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    /// Not asked for.
    Ignored,
    Unknown,
    Inside,
    Outside,
}

/// Carries what is known of some nodes of a lattice to all that are surely on the same side.
#[derive(Debug, Default)]
struct Flood {
    sides: Vec<Side>,
    queue: Vec<usize>,
}

impl Flood {
    /// Sides of all nodes that are unknown; those known already must be in the queue. `is_inside` is asked for one node of
    /// each set that hangs together; neighbours do whose distances sum to more than `least`.
    fn run(&mut self, nodes: [usize; 3], least: f32, distance: &[f32], is_inside: impl Fn(usize) -> bool) {
        self.spread(nodes, least, distance);
        for n in 0..self.sides.len() {
            if self.sides[n] == Side::Unknown {
                self.sides[n] = if is_inside(n) { Side::Inside } else { Side::Outside };
                self.queue.push(n);
                self.spread(nodes, least, distance);
            }
        }
    }

    fn spread(&mut self, [nx, ny, nz]: [usize; 3], least: f32, distance: &[f32]) {
        while let Some(n) = self.queue.pop() {
            let (side, d) = (self.sides[n], distance[n].abs());
            let [i, j, k] = [n % nx, n / nx % ny, n / (nx * ny)];
            let mut visit = |there: bool, m: usize| {
                if there && self.sides[m] == Side::Unknown && d + distance[m].abs() > least {
                    self.sides[m] = side;
                    self.queue.push(m);
                }
            };
            visit(i > 0, n.wrapping_sub(1));
            visit(i + 1 < nx, n + 1);
            visit(j > 0, n.wrapping_sub(nx));
            visit(j + 1 < ny, n + nx);
            visit(k > 0, n.wrapping_sub(nx * ny));
            visit(k + 1 < nz, n + nx * ny);
        }
    }
}

/// A block's share of the field.
struct BakedBlock {
    /// Bricks of the grid and where their values begin, counted from the block's own.
    entries: Vec<(usize, u32)>,
    lines: Vec<Line>,
    near_error: f32,
    far_error: f32,
}

/// What a worker reuses from block to block.
#[derive(Default)]
struct Buffers {
    /// Distances at the block's nodes, cm.
    distance: Vec<f32>,
    flood: Flood,
    /// For each brick of the block, the triangles near it, and whether they are few.
    nearby: Vec<(Nearby, bool)>,
}

/// 4³ bricks of the grid, less at its far faces.
struct Block<'a> {
    coarse: &'a Coarse,
    /// First brick along x, y, z, and bricks.
    first: [usize; 3],
    count: [usize; 3],
    /// Nodes of the block.
    lattice: Lattice,
}

const BLOCK_SHAPE: [usize; 3] = [BLOCK_NODES; 3];

impl<'a> Block<'a> {
    fn new(coarse: &'a Coarse, n: usize) -> Self {
        let blocks = coarse.count.map(|n| n.div_ceil(BLOCK_BRICKS));
        let at = [n % blocks[0], n / blocks[0] % blocks[1], n / (blocks[0] * blocks[1])];
        let first = at.map(|b| b * BLOCK_BRICKS);
        let count = [0, 1, 2].map(|k: usize| BLOCK_BRICKS.min(coarse.count[k] - first[k]));
        // Nodes by their place in the whole grid, so that blocks that share one agree on it.
        let lattice = Lattice { origin: coarse.corners.origin, cell: coarse.cell, nodes: BLOCK_SHAPE };
        Self { coarse, first, count, lattice }
    }

    /// Bricks of the block, as steps from the first.
    fn bricks(&self) -> impl Iterator<Item = [usize; 3]> + use<> {
        let [nx, ny, nz] = self.count;
        (0..nx * ny * nz).map(move |n| [n % nx, n / nx % ny, n / (nx * ny)])
    }

    fn in_grid(&self, brick: [usize; 3]) -> [usize; 3] {
        [0, 1, 2].map(|k: usize| self.first[k] + brick[k])
    }

    fn is_near(&self, brick: [usize; 3]) -> bool {
        self.coarse.near[self.coarse.brick(self.in_grid(brick))]
    }

    /// Position of a node of the block, counted from its first.
    fn position(&self, at: [usize; 3]) -> Vector3<f32> {
        self.lattice.position([0, 1, 2].map(|k: usize| self.first[k] * BRICK + at[k]))
    }

    fn bake(&self, closed: &ClosedMesh, buffers: &mut Buffers) -> BakedBlock {
        let mut out = BakedBlock { entries: Vec::new(), lines: Vec::new(), near_error: 0.0, far_error: 0.0 };
        if self.bricks().any(|b| self.is_near(b)) {
            self.fine_distances(closed, buffers);
        }
        for (n, brick) in self.bricks().enumerate().filter(|&(_, b)| self.is_near(b)) {
            out.entries.push((self.coarse.brick(self.in_grid(brick)), (out.lines.len() * LINE) as u32));
            let mut values = [0i16; NODES];
            for (n, value) in values.iter_mut().enumerate() {
                let at = [n % EDGE, n / EDGE % EDGE, n / (EDGE * EDGE)];
                let at = [0, 1, 2].map(|k: usize| brick[k] * BRICK + at[k]);
                *value = match self.constrained(at) {
                    // Whole, as bricks say.
                    Some(in_quanta) => in_quanta as i16,
                    None => in_quanta(buffers.distance[self.lattice.index(at)], self.coarse.quantum),
                };
            }
            let near = buffers.nearby[n].1.then_some(&buffers.nearby[n].0);
            self.measure(closed, near, brick, &values, &mut out);
            out.lines.extend_from_slice(&lines(&values));
        }
        if !self.bricks().all(|b| self.is_near(b)) {
            self.add_coarse(&mut out);
        }
        out
    }

    /// Signed distances at all nodes of near bricks.
    fn fine_distances(&self, closed: &ClosedMesh, buffers: &mut Buffers) {
        let Buffers { distance, flood, nearby } = buffers;
        let n_nodes = self.lattice.n_nodes();
        let mut points = [Vector3::zeros(); BLOCK_NODES];
        distance.clear();
        distance.resize(n_nodes, f32::INFINITY);
        flood.sides.clear();
        flood.sides.resize(n_nodes, Side::Ignored);
        for brick in self.bricks().filter(|&b| self.is_near(b)) {
            for z in 0..EDGE {
                for y in 0..EDGE {
                    let at = [brick[0] * BRICK, brick[1] * BRICK + y, brick[2] * BRICK + z];
                    flood.sides[self.lattice.index(at)..][..EDGE].fill(Side::Unknown);
                }
            }
        }
        self.distances_by_brick(closed, &flood.sides, nearby, distance);
        let mut hint: Hint = 0;
        for row in 0..BLOCK_NODES * BLOCK_NODES {
            let (j, k) = (row % BLOCK_NODES, row / BLOCK_NODES);
            let base = self.lattice.index([0, j, k]);
            let sides = &flood.sides[base..][..BLOCK_NODES];
            let asked = |i: usize, distance: &[f32]| sides[i] != Side::Ignored && distance[base + i] == f32::INFINITY;
            let mut begin = 0;
            while let Some(i) = (begin..BLOCK_NODES).find(|&i| asked(i, distance)) {
                let n = (i..BLOCK_NODES).take_while(|&i| asked(i, distance)).count();
                for (l, p) in points[..n].iter_mut().enumerate() {
                    *p = self.position([i + l, j, k]);
                }
                closed.tree.distances(&points[..n], &mut hint, &mut distance[base + i..][..n]);
                begin = i + n;
            }
        }
        // Corners of bricks have their signs already.
        for z in 0..=self.count[2] {
            for y in 0..=self.count[1] {
                for x in 0..=self.count[0] {
                    let n = self.lattice.index([x * BRICK, y * BRICK, z * BRICK]);
                    if flood.sides[n] == Side::Unknown {
                        let d = self.coarse.at_corners[self.coarse.corners.index(self.in_grid([x, y, z]))];
                        flood.sides[n] = if d < 0.0 { Side::Inside } else { Side::Outside };
                        flood.queue.push(n);
                    }
                }
            }
        }
        flood.run(BLOCK_SHAPE, self.coarse.surely_covered(self.coarse.cell), distance, |n| {
            closed.is_inside(self.position(self.lattice.node(n)))
        });
        for (d, side) in distance.iter_mut().zip(&flood.sides) {
            if *side == Side::Inside {
                *d = -*d;
            }
        }
    }

    /// Distances without sign at the nodes of near bricks that have few triangles near them.
    fn distances_by_brick(
        &self,
        closed: &ClosedMesh,
        sides: &[Side],
        nearby: &mut Vec<(Nearby, bool)>,
        distance: &mut [f32],
    ) {
        nearby.resize_with(BLOCK_BRICKS * BLOCK_BRICKS * BLOCK_BRICKS, Default::default);
        let (mut at, mut points) = ([0; NODES], [Vector3::zeros(); NODES]);
        let mut found = [0.0; NODES];
        for (brick, (near, are_few)) in self.bricks().zip(nearby.iter_mut()) {
            *are_few = self.is_near(brick) && self.gather(closed, brick, near);
            if !*are_few {
                continue;
            }
            let mut n = 0;
            for node in 0..NODES {
                let in_block = [node % EDGE, node / EDGE % EDGE, node / (EDGE * EDGE)];
                let in_block = [0, 1, 2].map(|k: usize| brick[k] * BRICK + in_block[k]);
                let index = self.lattice.index(in_block);
                // What bricks share is asked once.
                if sides[index] != Side::Ignored && distance[index] == f32::INFINITY {
                    (at[n], points[n]) = (index, self.position(in_block));
                    n += 1;
                }
            }
            closed.tree.distances_among(near, &points[..n], &mut found[..n]);
            for (&index, &d) in at[..n].iter().zip(&found[..n]) {
                distance[index] = d;
            }
        }
    }

    /// Finds the triangles that points of a brick may have nearest.
    fn gather(&self, closed: &ClosedMesh, brick: [usize; 3], near: &mut Nearby) -> bool {
        let half_diagonal = 0.5 * 3f32.sqrt() * BRICK as f32 * self.coarse.cell;
        let middle = self.position(brick.map(|b| b * BRICK)) + Vector3::repeat(0.5 * BRICK as f32 * self.coarse.cell);
        let rounded = round_off(&self.coarse.bounds());
        let distance = self.coarse.at_middles[self.coarse.brick(self.in_grid(brick))];
        closed.tree.gather(middle, distance + 2.0 * rounded, half_diagonal + 2.0 * rounded, near)
    }

    /// The value that a node takes from a coarse brick that it lies on; none where all around are fine.
    fn constrained(&self, at: [usize; 3]) -> Option<f32> {
        if at.iter().all(|n| n % BRICK != 0) {
            return None;
        }
        let in_grid = [0, 1, 2].map(|k: usize| self.first[k] * BRICK + at[k]);
        for side in 0..8 {
            let mut brick = [0; 3];
            let mut t = [0.0; 3];
            let mut exists = true;
            for k in 0..3 {
                let before = side >> k & 1;
                let on_face = in_grid[k] % BRICK == 0;
                // Only a node on the face belongs to the brick before, and the last brick ends at the grid's face.
                exists &= before == 0 || (on_face && in_grid[k] > 0);
                brick[k] = (in_grid[k] / BRICK).wrapping_sub(before);
                exists &= brick[k] < self.coarse.count[k];
                t[k] = if before == 1 { 1.0 } else { (in_grid[k] % BRICK) as f32 / BRICK as f32 };
            }
            if exists && !self.coarse.near[self.coarse.brick(brick)] {
                return Some(self.coarse.value_in(brick, t));
            }
        }
        None
    }

    /// Compares a brick with exact distances at the middles of its cells.
    fn measure(
        &self,
        closed: &ClosedMesh,
        nearby: Option<&Nearby>,
        brick: [usize; 3],
        values: &[i16; NODES],
        out: &mut BakedBlock,
    ) {
        let cell = self.coarse.cell;
        let brick_middle = self.coarse.at_middles[self.coarse.brick(self.in_grid(brick))];
        // No cell of the brick is within two of the surface: one cell of eight stands for the others.
        let step = if brick_middle > (0.5 * BRICK as f32 * 3f32.sqrt() + 2.0) * cell { 2 } else { 1 };
        let mut hint: Hint = 0;
        for part in 0..if step == 2 { 1 } else { 8 } {
            let first = [part & 1, part >> 1 & 1, part >> 2].map(|n| 2 * n);
            let at: [[usize; 3]; 8] = std::array::from_fn(|l| [0, 1, 2].map(|k: usize| first[k] + (l >> k & 1) * step));
            let middle = |at: [usize; 3]| {
                self.position([0, 1, 2].map(|k: usize| brick[k] * BRICK + at[k])) + Vector3::repeat(0.5 * cell)
            };
            let mut exact = [0.0; 8];
            match nearby {
                Some(near) => closed.tree.distances_among(near, &at.map(middle), &mut exact),
                None => closed.tree.distances(&at.map(middle), &mut hint, &mut exact),
            }
            for l in 0..8 {
                let [x, y, z] = at[l];
                let corners: [f32; 8] = std::array::from_fn(|c| {
                    f32::from(values[node(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2))]) * self.coarse.quantum
                });
                let sampled = corners.iter().sum::<f32>() / 8.0;
                let largest = corners.iter().fold(0.0f32, |a, &b| if b.abs() > a.abs() { b } else { a });
                // A value inside may be deeper by a quantum than it is.
                let reach = self.coarse.surely_covered(0.5 * 3f32.sqrt() * cell) + self.coarse.quantum;
                let one_side = exact[l] + largest.abs() > reach;
                let is_inside = if one_side { largest < 0.0 } else { closed.is_inside(middle(at[l])) };
                let exact = if is_inside { -exact[l] } else { exact[l] };
                let error = overstatement(sampled, exact, cell);
                let worst = if sampled > self.coarse.band { &mut out.far_error } else { &mut out.near_error };
                *worst = worst.max(error);
            }
        }
    }

    /// Adds the coarse brick that serves the block's far bricks.
    fn add_coarse(&self, out: &mut BakedBlock) {
        let base = out.lines.len() * LINE;
        let mut values = [0i16; NODES];
        let in_one = self.coarse.quantum / self.coarse.coarse_quantum;
        for (n, value) in values.iter_mut().enumerate() {
            let at = [n % EDGE, n / EDGE % EDGE, n / (EDGE * EDGE)];
            if (0..3).all(|k| at[k] <= self.count[k]) {
                *value = (self.coarse.at_corners[self.coarse.corners.index(self.in_grid(at))] * in_one) as i16;
            }
        }
        out.lines.extend_from_slice(&lines(&values));
        for brick in self.bricks().filter(|&b| !self.is_near(b)) {
            let [x, y, z] = brick;
            let in_grid = self.coarse.brick(self.in_grid(brick));
            out.entries.push((in_grid, (base as u32 + first_corner(x as u32, y as u32, z as u32)) | COARSE));
            let sampled = self.coarse.value_in(self.in_grid(brick), [0.5; 3]) * self.coarse.quantum;
            if sampled > 0.0 {
                out.far_error = out.far_error.max(sampled - self.coarse.at_middles[in_grid]);
            }
        }
    }
}
