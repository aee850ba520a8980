//! Computes a signed distance field, from a function or from a triangle mesh (AS16 §5.1).
//!
//! A function is evaluated at every node. A mesh is baked fine near its surface and coarse elsewhere, see `mesh_bake`.
//! Each node is computed on its own, so the result is the same bytes for any number of threads.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::error::Error;
use crate::sdf::bricks::Layout;
use crate::sdf::grid::{Bounds, SignedDistanceField, Trust};
use crate::sdf::mesh::ClosedMesh;
use crate::sdf::mesh_bake::bake_closed;

/// How a mesh is turned into a grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BakeParams {
    /// Edge of a grid cell, cm; `None` takes a quarter of the smallest half-thickness, or more if memory demands it.
    pub cell: Option<f32>,
    /// Most bytes the grid may take.
    pub max_bytes: usize,
    /// Width of the rim of free space around the solid's bounding box, cm; at least two cells are kept in any case, and
    /// no more than the solid's own size.
    pub margin: f32,
    /// Cells from the surface within which the grid is fine and its nodes are exact; infinite for the whole grid.
    pub band_cells: f32,
}

impl BakeParams {
    /// Cell from the thinnest feature, 64 MiB, half a centimetre of free space around, fine to two cells from the surface.
    pub fn automatic() -> Self {
        Self { cell: None, max_bytes: DEFAULT_MAX_BYTES, margin: 0.5, band_cells: 2.0 }
    }

    /// As [`Self::automatic`], with a stated cell in cm.
    pub fn with_cell(cell: f32) -> Self {
        Self { cell: Some(cell), ..Self::automatic() }
    }
}

/// Memory granted to a grid unless stated otherwise.
const DEFAULT_MAX_BYTES: usize = 64 << 20;
/// Beyond this many cells from the surface the error varies slowly: every eighth cell stands for its neighbours.
const MEASURED_CELLS: f32 = 4.0;
/// Interpolation errs most at cell centres for a quadratic, not for every function: what is measured there gets a quarter more.
pub(super) const SAFETY: f32 = 1.25;

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
    let field = SignedDistanceField::from_layout(bounds.min, cell, nodes, Layout::dense(nodes, cell, &values), exact);
    let error = measure(&lattice, &field, &f, cell).max(round_off(&bounds));
    Ok(field.trusted(Trust { max_error: error, band: f32::MAX, far_error: error }))
}

/// Bakes a triangle mesh (cm, in the solid's frame). Inside is what it winds around: it may overlap itself, be put together
/// from parts, be inside out, and have holes, which are closed. Depths inside are to the nearest triangle, also to one
/// that lies inside.
///
/// # Errors
/// Refuses, naming the defect, meshes that are empty, not finite, flat, one-sided, or mostly holes; and a stated cell
/// whose grid would exceed [`BakeParams::max_bytes`].
pub fn bake_from_mesh(
    positions: &[[f32; 3]],
    triangles: &[[u32; 3]],
    params: BakeParams,
) -> Result<SignedDistanceField, Error> {
    bake_closed(&ClosedMesh::new(positions, triangles)?, params)
}

/// Distances carry an error of a few units in the last place of the coordinates.
pub(super) fn round_off(bounds: &Bounds) -> f32 {
    8.0 * f32::EPSILON * bounds.min.abs().sup(&bounds.max.abs()).max()
}

/// Node positions of a grid; `at` are node indices along x, y, z.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lattice {
    pub origin: Vector3<f32>,
    pub cell: f32,
    pub nodes: [usize; 3],
}

impl Lattice {
    pub fn position(&self, at: [usize; 3]) -> Vector3<f32> {
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

    pub fn n_nodes(&self) -> usize {
        self.nodes.iter().product()
    }

    pub fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.nodes[1] + j) * self.nodes[0] + i
    }

    pub fn node(&self, index: usize) -> [usize; 3] {
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

/// Largest overstatement of the distance at the centres of cells, and largest error of either sign within a cell of the
/// surface; cells deep inside do not count, since nobody asks them for clearance.
fn measure(
    lattice: &Lattice,
    field: &SignedDistanceField,
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
                let skipped = sampled > MEASURED_CELLS * cell && (at[0] | at[1] | at[2]) & 1 == 1;
                if !skipped {
                    worst = worst.max(overstatement(sampled, exact(p), cell));
                }
            }
            worst
        })
        .reduce(|| 0.0, f32::max);
    worst * SAFETY
}

/// What one sample contributes to the error of a field whose distance there is `exact`.
pub(super) fn overstatement(sampled: f32, exact: f32, cell: f32) -> f32 {
    let excess = sampled - exact;
    if sampled < -cell {
        0.0
    } else if sampled <= cell {
        excess.abs()
    } else {
        excess
    }
}
