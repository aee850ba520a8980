//! Computes a signed distance field, from a function or from a closed triangle mesh (AS16 §5.1).
//!
//! A mesh is baked in two levels: exact distances on a coarse lattice of block corners, then exact distances at every
//! node of the blocks that may come near the surface; the nodes of far blocks are filled trilinearly from the corners.
//! Every cell within [`SignedDistanceField::band`] of the surface has eight exact corners. Each node is computed
//! on its own, so the result is the same bytes for any number of threads.

use nalgebra::Vector3;
use parry3d::math::Vector;
use parry3d::query::PointQuery;
use parry3d::shape::TriMesh;
use rayon::prelude::*;

use crate::error::Error;
use crate::sdf::grid::{Bounds, SignedDistanceField, Trust};
use crate::sdf::mesh::ClosedMesh;
use crate::thickness::smallest_half_thickness;

/// How a mesh is turned into a grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BakeParams {
    /// Edge of a grid cell, cm; `None` takes a quarter of the smallest half-thickness, or more if memory demands it.
    pub cell: Option<f32>,
    /// Most bytes the grid may take.
    pub max_bytes: usize,
    /// Width of the rim of free space around the solid's bounding box, cm; at least two cells are kept in any case.
    pub margin: f32,
}

impl BakeParams {
    /// Cell from the thinnest feature, 64 MiB, half a centimetre of free space around.
    pub fn automatic() -> Self {
        Self { cell: None, max_bytes: DEFAULT_MAX_BYTES, margin: 0.5 }
    }

    /// As [`Self::automatic`], with a stated cell in cm.
    pub fn with_cell(cell: f32) -> Self {
        Self { cell: Some(cell), ..Self::automatic() }
    }
}

/// Memory granted to a grid unless stated otherwise.
const DEFAULT_MAX_BYTES: usize = 64 << 20;
/// Fine cells along the edge of a block.
const BLOCK: usize = 8;
/// Exact cells are kept to this many cells from the surface.
const BAND_CELLS: f32 = 4.0;
/// Interpolation errs most at cell centres for a quadratic, not for every function: what is measured there gets a quarter more.
const SAFETY: f32 = 1.25;
/// Cells across the smallest half-thickness.
const CELLS_PER_HALF_THICKNESS: f32 = 4.0;

/// Bakes the distance function `f` (cm, in the solid's frame, changing by at most 1 cm per cm) over `bounds`.
///
/// # Errors
/// A cell or box that is not positive, a grid past 1 GiB, a value that is not finite, a solid that reaches the box's faces.
pub fn bake_from_fn(
    bounds: Bounds,
    cell: f32,
    f: impl Fn(Vector3<f32>) -> f32 + Sync,
) -> Result<SignedDistanceField, Error> {
    let nodes = SignedDistanceField::plan(&bounds, cell, 1 << 30)?;
    let lattice = Lattice { origin: bounds.min, cell, nodes };
    let values = lattice.fill(|at| f(lattice.position(at)));
    check_values(&lattice, &values)?;

    let exact = Trust { max_error: 0.0, band: f32::MAX, far_error: 0.0 };
    let field = SignedDistanceField::from_values(bounds.min, cell, nodes, values, exact);
    let error = measure(&lattice, &field, |_| true, &f, cell).max(round_off(&bounds));
    Ok(SignedDistanceField::from_values(
        bounds.min,
        cell,
        nodes,
        field.into_values(),
        Trust { max_error: error, band: f32::MAX, far_error: error },
    ))
}

/// Bakes a closed, outward-facing triangle mesh (cm, in the solid's frame).
///
/// # Errors
/// Refuses, naming the defect, meshes that are empty, open, non-manifold, inconsistently wound, inside out or not finite;
/// and a stated cell whose grid would exceed [`BakeParams::max_bytes`].
pub fn bake_from_mesh(
    positions: &[[f32; 3]],
    triangles: &[[u32; 3]],
    params: BakeParams,
) -> Result<SignedDistanceField, Error> {
    bake_closed(&ClosedMesh::new(positions, triangles)?, params)
}

/// Bakes a mesh already checked.
pub(crate) fn bake_closed(closed: &ClosedMesh, params: BakeParams) -> Result<SignedDistanceField, Error> {
    let mesh = &closed.mesh;
    if !(params.margin.is_finite() && params.margin >= 0.0) {
        return Err(Error::BadParameter { name: "margin", value: params.margin, above: 0.0 });
    }
    let (bounds, cell, nodes) = plan_mesh(mesh, closed.bounds, &params)?;
    let _span = tracing::debug_span!("bake", cell, ?nodes).entered();

    let exact = |p: Vector3<f32>| mesh_distance(mesh, p);
    let lattice = Lattice { origin: bounds.min, cell, nodes };
    let blocks = Blocks::new(&lattice, BAND_CELLS * cell, exact);
    let values =
        lattice.fill(|at| if blocks.touches_near(at) { exact(lattice.position(at)) } else { blocks.coarse_value(at) });
    check_values(&lattice, &values)?;

    let draft = Trust { max_error: 0.0, band: f32::MAX, far_error: 0.0 };
    let field = SignedDistanceField::from_values(bounds.min, cell, nodes, values, draft);
    let slack = round_off(&bounds);
    let max_error = measure(&lattice, &field, |at| blocks.is_near(at), exact, cell).max(slack);
    // Filled cells err most in the middle of a block, where every weight is largest.
    let far_error = (blocks.measure_far(&lattice, &field, exact)).max(max_error);
    Ok(SignedDistanceField::from_values(
        bounds.min,
        cell,
        nodes,
        field.into_values(),
        Trust { max_error, band: BAND_CELLS * cell, far_error },
    ))
}

/// Distances carry an error of a few units in the last place of the coordinates.
fn round_off(bounds: &Bounds) -> f32 {
    8.0 * f32::EPSILON * bounds.min.abs().sup(&bounds.max.abs()).max()
}

/// Signed distance to a closed mesh, by the pseudo-normal of the nearest feature.
fn mesh_distance(mesh: &TriMesh, p: Vector3<f32>) -> f32 {
    let p = Vector::new(p.x, p.y, p.z);
    let nearest = mesh.project_local_point(p, false);
    let d = (p - nearest.point).length();
    if nearest.is_inside { -d } else { d }
}

/// Box, cell and node counts of a mesh's grid.
fn plan_mesh(mesh: &TriMesh, solid: Bounds, params: &BakeParams) -> Result<(Bounds, f32, [usize; 3]), Error> {
    /// Each retry enlarges the cell by this factor; 200 of them span eight orders of magnitude.
    const GROWTH: f32 = 1.1;
    const RETRIES: usize = 200;

    let rim = |cell: f32| solid.grown(params.margin.max(2.0 * cell));
    if let Some(cell) = params.cell {
        let bounds = rim(cell);
        return Ok((bounds, cell, SignedDistanceField::plan(&bounds, cell, params.max_bytes)?));
    }
    let mut cell = smallest_half_thickness(mesh) / CELLS_PER_HALF_THICKNESS;
    let mut retries = 0;
    loop {
        let bounds = rim(cell);
        match SignedDistanceField::plan(&bounds, cell, params.max_bytes) {
            Ok(nodes) => return Ok((bounds, cell, nodes)),
            Err(Error::TooLarge { .. }) if retries < RETRIES => cell *= GROWTH,
            Err(e) => return Err(e),
        }
        retries += 1;
    }
}

/// Node positions of a grid; `at` are node indices along x, y, z.
#[derive(Clone, Copy)]
struct Lattice {
    origin: Vector3<f32>,
    cell: f32,
    nodes: [usize; 3],
}

impl Lattice {
    fn position(&self, at: [usize; 3]) -> Vector3<f32> {
        self.origin + Vector3::from(at.map(|n| n as f32)) * self.cell
    }

    /// The value of `f` at every node, x fastest, in parallel over rows.
    fn fill(&self, f: impl Fn([usize; 3]) -> f32 + Sync) -> Vec<f32> {
        let [nx, ny, nz] = self.nodes;
        let mut values = vec![0.0; nx * ny * nz];
        values.par_chunks_mut(nx).enumerate().for_each(|(row, out)| {
            for (i, v) in out.iter_mut().enumerate() {
                *v = f([i, row % ny, row / ny]);
            }
        });
        values
    }

    fn node(&self, index: usize) -> [usize; 3] {
        let [nx, ny, _] = self.nodes;
        [index % nx, index / nx % ny, index / (nx * ny)]
    }

    fn on_face(&self, at: [usize; 3]) -> bool {
        (0..3).any(|k| at[k] == 0 || at[k] + 1 == self.nodes[k])
    }
}

fn check_values(lattice: &Lattice, values: &[f32]) -> Result<(), Error> {
    let fault = values.par_iter().enumerate().find_map_first(|(n, &d)| {
        let at = lattice.node(n);
        let position: [f32; 3] = lattice.position(at).into();
        if !d.is_finite() {
            Some(Error::NonFiniteDistance { position })
        } else if d <= 0.0 && lattice.on_face(at) {
            Some(Error::TouchesBounds { distance: d, position })
        } else {
            None
        }
    });
    fault.map_or(Ok(()), Err)
}

/// Largest overstatement of the distance at the centres of the cells chosen, and largest error of either sign within a
/// cell of the surface; cells deep inside do not count, since nobody asks them for clearance.
fn measure(
    lattice: &Lattice,
    field: &SignedDistanceField,
    chosen: impl Fn([usize; 3]) -> bool + Sync,
    exact: impl Fn(Vector3<f32>) -> f32 + Sync,
    cell: f32,
) -> f32 {
    let [nx, ny, nz] = lattice.nodes.map(|n| n - 1);
    let half = Vector3::repeat(0.5 * cell);
    let worst = (0..ny * nz)
        .into_par_iter()
        .map(|row| {
            let mut worst = 0.0f32;
            for i in 0..nx {
                let at = [i, row % ny, row / ny];
                let p = lattice.position(at) + half;
                let sampled = field.distance(p);
                // Farther out the error varies slowly: every eighth centre stands for its neighbours.
                let skipped = sampled > BAND_CELLS * cell && (at[0] | at[1] | at[2]) & 1 == 1;
                if sampled < -cell || skipped || !chosen(at) {
                    continue;
                }
                let excess = sampled - exact(p);
                worst = worst.max(if sampled <= cell { excess.abs() } else { excess });
            }
            worst
        })
        .reduce(|| 0.0, f32::max);
    worst * SAFETY
}

/// The coarse level: exact distances at block corners, and which blocks may come near the surface.
struct Blocks {
    /// Blocks along each axis; the last may stick out of the grid.
    count: [usize; 3],
    corners: Lattice,
    values: Vec<f32>,
    near: Vec<bool>,
}

impl Blocks {
    fn new(fine: &Lattice, band: f32, exact: impl Fn(Vector3<f32>) -> f32 + Sync) -> Self {
        let count = fine.nodes.map(|n| (n - 1).div_ceil(BLOCK));
        let edge = BLOCK as f32 * fine.cell;
        let corners = Lattice { origin: fine.origin, cell: edge, nodes: count.map(|n| n + 1) };
        let values = corners.fill(|at| exact(corners.position(at)));
        let [bx, by, bz] = count;
        // No point of a block is farther from its nearest corner than half the diagonal.
        let reach = band + 0.5 * edge * 3f32.sqrt();
        let near = (0..bx * by * bz)
            .map(|n| {
                let at = [n % bx, n / bx % by, n / (bx * by)];
                (0..8).any(|c| values[corner_index(&corners, at, c)].abs() <= reach)
            })
            .collect();
        Self { count, corners, values, near }
    }

    fn near_block(&self, at: [usize; 3]) -> bool {
        self.near[(at[2] * self.count[1] + at[1]) * self.count[0] + at[0]]
    }

    /// Whether the cell with first node `at` belongs to a near block.
    fn is_near(&self, at: [usize; 3]) -> bool {
        self.near_block(at.map(|n| n / BLOCK))
    }

    /// Whether any block that has node `at` on its border or inside is near.
    fn touches_near(&self, at: [usize; 3]) -> bool {
        let range = |k: usize| {
            let upper = (at[k] / BLOCK).min(self.count[k] - 1);
            let lower = if at[k].is_multiple_of(BLOCK) { (at[k] / BLOCK).saturating_sub(1) } else { upper };
            lower..=upper
        };
        range(2).any(|z| range(1).any(|y| range(0).any(|x| self.near_block([x, y, z]))))
    }

    /// Trilinear value at fine node `at`.
    fn coarse_value(&self, at: [usize; 3]) -> f32 {
        let block = [0, 1, 2].map(|k: usize| (at[k] / BLOCK).min(self.count[k] - 1));
        let t = [0, 1, 2].map(|k: usize| (at[k] - block[k] * BLOCK) as f32 / BLOCK as f32);
        (0..8)
            .map(|c| {
                let weight: f32 = (0..3).map(|k| if c >> k & 1 == 1 { t[k] } else { 1.0 - t[k] }).product();
                weight * self.values[corner_index(&self.corners, block, c)]
            })
            .sum()
    }

    /// Largest overstatement at the centres of far blocks outside the solid.
    fn measure_far(
        &self,
        fine: &Lattice,
        field: &SignedDistanceField,
        exact: impl Fn(Vector3<f32>) -> f32 + Sync,
    ) -> f32 {
        let [bx, by, _] = self.count;
        let half = Vector3::repeat(0.5 * BLOCK as f32 * fine.cell);
        let worst = self
            .near
            .par_iter()
            .enumerate()
            .filter(|&(_, &near)| !near)
            .map(|(n, _)| {
                let at = [n % bx, n / bx % by, n / (bx * by)];
                // The last block may stick out; outside the grid sampling is a bound of its own.
                let p = (self.corners.position(at) + half).inf(&field.bounds().max);
                let sampled = field.distance(p);
                if sampled > 0.0 { sampled - exact(p) } else { 0.0 }
            })
            .reduce(|| 0.0, f32::max);
        worst * SAFETY
    }
}

/// Index of corner `c` (bits: x, y, z) of block `at`.
fn corner_index(corners: &Lattice, at: [usize; 3], c: usize) -> usize {
    let [nx, ny, _] = corners.nodes;
    ((at[2] + (c >> 2 & 1)) * ny + at[1] + (c >> 1 & 1)) * nx + at[0] + (c & 1)
}
