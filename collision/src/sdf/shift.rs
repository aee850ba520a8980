//! Where the points of a deforming body go from one key frame to the next, as a field over space (the Δt v of MS08 §5.1).
//!
//! Only surface points are known to move; any other point moves as its nearest surface point does. The paper takes the
//! mean of the velocities so extended from both key frames. Both are read at the same place, so their mean is stored.
//! The field is smooth near the surface, and a coarse lattice carries it; outside the lattice its border goes on.

use nalgebra::Vector3;
use parry3d::math::Vector;
use parry3d::query::PointQueryWithLocation;
use parry3d::shape::TriMesh;
use rayon::prelude::*;

use crate::error::Error;
use crate::sdf::{Bounds, SignedDistanceField};

/// Displacements between two key frames on a lattice, sampled by trilinear interpolation.
#[derive(Debug, Clone)]
pub(crate) struct ShiftField {
    origin: Vector3<f32>,
    inv_cell: f32,
    /// Nodes along x, y, z; at least 2 each.
    nodes: [usize; 3],
    /// `nodes[0] * nodes[1] * nodes[2]` displacements, x fastest, cm.
    values: Vec<Vector3<f32>>,
}

impl ShiftField {
    /// The mean over `surfaces` of the displacement of the nearest surface point; `shift` has one entry per vertex, cm.
    ///
    /// # Errors
    /// A lattice past `max_bytes`.
    pub fn bake(
        surfaces: &[&TriMesh],
        shift: &[Vector3<f32>],
        bounds: Bounds,
        cell: f32,
        max_bytes: usize,
    ) -> Result<Self, Error> {
        // The plan counts four bytes a node.
        let nodes = SignedDistanceField::plan(&bounds, cell, max_bytes / 3)?;
        let [nx, ny, nz] = nodes;
        let mut values = vec![Vector3::zeros(); nx * ny * nz];
        let share = 1.0 / surfaces.len() as f32;
        values.par_chunks_mut(nx).enumerate().for_each(|(row, out)| {
            for (i, v) in out.iter_mut().enumerate() {
                let at = Vector3::new(i as f32, (row % ny) as f32, (row / ny) as f32);
                let p = bounds.min + at * cell;
                *v = surfaces.iter().map(|mesh| carried(mesh, shift, p)).sum::<Vector3<f32>>() * share;
            }
        });
        Ok(Self { origin: bounds.min, inv_cell: 1.0 / cell, nodes, values })
    }

    /// Displacement of what is at `p`, cm.
    #[inline]
    pub fn at(&self, p: Vector3<f32>) -> Vector3<f32> {
        let g = (p - self.origin) * self.inv_cell;
        let [nx, ny, nz] = self.nodes;
        let (i, tx) = split(g.x, nx);
        let (j, ty) = split(g.y, ny);
        let (k, tz) = split(g.z, nz);
        let row = |j: usize, k: usize| {
            let first = (k * ny + j) * nx + i;
            self.values[first].lerp(&self.values[first + 1], tx)
        };
        let slab = |k: usize| row(j, k).lerp(&row(j + 1, k), ty);
        slab(k).lerp(&slab(k + 1), tz)
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        self.values.len() * size_of::<Vector3<f32>>()
    }
}

/// Cell along an axis of `n` nodes and the fraction across it, clamped to the lattice.
#[inline(always)]
fn split(g: f32, n: usize) -> (usize, f32) {
    let g = g.clamp(0.0, (n - 1) as f32);
    // A coordinate that is not a number converts to zero.
    let i = (g as i32 as usize).min(n - 2);
    (i, g - i as f32)
}

/// Displacement of the point of the surface nearest to `p`.
fn carried(mesh: &TriMesh, shift: &[Vector3<f32>], p: Vector3<f32>) -> Vector3<f32> {
    let (_, (triangle, location)) = mesh.project_local_point_and_get_location(Vector::new(p.x, p.y, p.z), false);
    let corners = mesh.indices()[triangle as usize];
    let weights = location.barycentric_coordinates().unwrap_or([1.0, 0.0, 0.0]);
    (0..3).map(|k| shift[corners[k] as usize] * weights[k]).sum()
}
