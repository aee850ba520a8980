//! A pressure that is never negative spreads hair that is too dense, as far as there is room for it.
//!
//! Displaced by u, hair of excess e needs div u >= e. The least such flow is the gradient of a pressure p >= 0 with
//! -lap p >= e, one of the two an equality everywhere: hair with room around it (e < 0) is filled before it presses on
//! what is beyond. Solved by projected Jacobi sweeps, from a grid of eight times the cell down: every cell reads only the sweep
//! before, so the result does not depend on threads. Cells whose centre is in the head let nothing through.

use super::HairHairParams;
use super::lattice::Lattice;
use collision::Solid;
use multiversion::multiversion;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Levels of the grid; the coarsest has cells of eight times the edge.
const LEVELS: usize = 4;

/// Share of a full Jacobi step: a full one does not damp the checkerboard.
const RELAX: f32 = 0.85;

/// One level of the grid.
#[derive(Clone, Debug, Default)]
struct Level {
    lattice: Lattice,
    /// One where hair may be, zero in the head.
    open: Vec<f32>,
    /// [`RELAX`] over the number of open neighbours, zero in the head.
    weight: Vec<f32>,
    /// Excess times the square of the cell's edge.
    source: Vec<f32>,
    pressure: Vec<f32>,
    spare: Vec<f32>,
}

/// The solver and its buffers.
#[derive(Debug)]
pub(crate) struct Pressure {
    head: Option<Solid>,
    cell: f32,
    /// Where the levels' `open` holds for.
    lattice: Lattice,
    levels: Vec<Level>,
    /// Distance to the head at cell centres, cm.
    head_distance: Vec<f32>,
    /// Direction away from the head and distance to it, four values a cell.
    away: Vec<f32>,
}

impl Pressure {
    pub(crate) fn new(head: Option<Solid>, cell: f32) -> Self {
        Self {
            head,
            cell,
            lattice: Lattice::default(),
            levels: vec![Level::default(); LEVELS],
            head_distance: Vec::new(),
            away: Vec::new(),
        }
    }

    /// Solves for the pressure of an excess per cell; without `pressed` it is zero.
    pub(crate) fn solve(&mut self, lattice: &Lattice, excess: &[f32], pressed: bool, params: &HairHairParams) {
        self.fit(lattice);
        let h2 = self.cell * self.cell;
        // Below, each level starts from the one above it.
        self.levels.iter_mut().for_each(|level| level.pressure.fill(0.0));
        if !pressed {
            return;
        }
        self.levels[0].source.iter_mut().zip(excess).for_each(|(s, &e)| *s = h2 * e.max(params.gain * e));
        for k in 1..LEVELS {
            let (fine, coarse) = self.levels.split_at_mut(k);
            coarse[0].restrict(&fine[k - 1]);
        }
        for k in (0..LEVELS).rev() {
            if k + 1 < LEVELS {
                let (fine, coarse) = self.levels.split_at_mut(k + 1);
                fine[k].prolong(&coarse[0]);
            }
            // The coarsest level has nothing to start from, and costs a 512th of the finest.
            let sweeps = if k + 1 == LEVELS { 4 * params.sweeps } else { params.sweeps };
            for _ in 0..sweeps {
                self.levels[k].sweep();
            }
        }
    }

    /// Pressure per cell, cm².
    pub(crate) fn values(&self) -> &[f32] {
        &self.levels[0].pressure
    }

    /// One where hair may be, zero in the head, per cell.
    pub(crate) fn open(&self) -> &[f32] {
        &self.levels[0].open
    }

    /// Direction away from the head (three values) and distance to it (cm) by cell; empty without a head.
    pub(crate) fn head(&self) -> &[f32] {
        &self.away
    }

    /// The four values of [`Pressure::head`] for a cell.
    #[inline(always)]
    pub(crate) fn head_at(&self, index: usize) -> Option<&[f32]> {
        self.away.get(4 * index..4 * index + 4)
    }

    /// Sizes the buffers for a box and finds which of its cells are open.
    fn fit(&mut self, lattice: &Lattice) {
        if self.lattice == *lattice {
            return;
        }
        self.lattice = *lattice;
        let cell = self.cell;
        self.levels[0].resize(*lattice);
        if let Some(head) = &self.head {
            self.head_distance.resize(lattice.n_cells(), 0.0);
            let (plane, row) = (lattice.plane(), lattice.dims[0]);
            let distance = self.head_distance.par_chunks_mut(plane);
            distance.zip(self.levels[0].open.par_chunks_mut(plane)).enumerate().for_each(|(z, (distance, open))| {
                for i in 0..plane {
                    let centre = lattice.centre([i % row, i / row, z], cell);
                    distance[i] = head.sdf.distance(Vector3::from(centre));
                    open[i] = f32::from(u8::from(distance[i] > 0.0));
                }
            });
            let d = &self.head_distance;
            let difference = |i: usize, stride: usize| {
                let (above, below) = ((i + stride).min(d.len() - 1), i.saturating_sub(stride));
                d[above] - d[below]
            };
            self.away.resize(4 * lattice.n_cells(), 0.0);
            self.away.par_chunks_mut(4).enumerate().with_min_len(row).for_each(|(i, out)| {
                let g = [1, row, plane].map(|stride| difference(i, stride));
                let length = (g[0] * g[0] + g[1] * g[1] + g[2] * g[2]).sqrt();
                let scale = if length > 0.0 { 1.0 / length } else { 0.0 };
                out.copy_from_slice(&[g[0] * scale, g[1] * scale, g[2] * scale, d[i]]);
            });
        } else {
            self.levels[0].open.fill(1.0);
        }
        self.levels[0].weigh();
        for k in 1..LEVELS {
            let (fine, coarse) = self.levels.split_at_mut(k);
            coarse[0].resize(Lattice { first: [0; 3], dims: fine[k - 1].lattice.dims.map(|n| n / 2) });
            coarse[0].open_over(&fine[k - 1]);
            coarse[0].weigh();
        }
    }
}

impl Level {
    fn resize(&mut self, lattice: Lattice) {
        self.lattice = lattice;
        for buffer in [&mut self.open, &mut self.weight, &mut self.source, &mut self.pressure, &mut self.spare] {
            buffer.clear();
            buffer.resize(lattice.n_cells(), 0.0);
        }
    }

    /// Finds the weights of open cells; those at the box's faces stay zero, and their pressure with them.
    fn weigh(&mut self) {
        let [nx, ny, nz] = self.lattice.dims;
        let plane = self.lattice.plane();
        for z in 1..nz - 1 {
            for y in 1..ny - 1 {
                for i in z * plane + y * nx + 1..z * plane + y * nx + nx - 1 {
                    let open: f32 = [1, nx, plane].iter().map(|&s| self.open[i - s] + self.open[i + s]).sum();
                    self.weight[i] = self.open[i] * RELAX / open.max(1.0);
                }
            }
        }
    }

    /// The eight cells of a finer level in a cell of this one.
    fn children(fine: &Lattice, [x, y, z]: [usize; 3]) -> [usize; 8] {
        std::array::from_fn(|k| {
            ((2 * z + (k >> 2)) * fine.dims[1] + 2 * y + ((k >> 1) & 1)) * fine.dims[0] + 2 * x + (k & 1)
        })
    }

    /// Opens the cells of which half or more is open.
    fn open_over(&mut self, fine: &Self) {
        let [nx, ny, _] = self.lattice.dims;
        for (i, open) in self.open.iter_mut().enumerate() {
            let of_children = Self::children(&fine.lattice, [i % nx, i / nx % ny, i / nx / ny]).map(|c| fine.open[c]);
            *open = f32::from(u8::from(of_children.iter().sum::<f32>() >= 4.0));
        }
    }

    /// Means of the finer level's source over open cells, for cells of four times the face.
    fn restrict(&mut self, fine: &Self) {
        let [nx, ny, _] = self.lattice.dims;
        let plane = self.lattice.plane();
        self.source.par_chunks_mut(plane).enumerate().for_each(|(z, source)| {
            for (i, out) in source.iter_mut().enumerate() {
                let (mut sum, mut open) = (0.0, 0.0);
                for c in Self::children(&fine.lattice, [i % nx, (i / nx) % ny, z]) {
                    sum += fine.open[c] * fine.source[c];
                    open += fine.open[c];
                }
                *out = if open > 0.0 { 4.0 * sum / open } else { 0.0 };
            }
        });
    }

    /// Starts from the coarser level's pressure.
    fn prolong(&mut self, coarse: &Self) {
        let [nx, ny, _] = self.lattice.dims;
        let [cx, cy, _] = coarse.lattice.dims;
        let plane = self.lattice.plane();
        self.pressure.par_chunks_mut(plane).zip(self.weight.par_chunks(plane)).enumerate().for_each(
            |(z, (pressure, weight))| {
                for y in 0..ny {
                    let from = &coarse.pressure[(z / 2 * cy + y / 2) * cx..][..cx];
                    for x in 0..nx {
                        let open = weight[y * nx + x] > 0.0;
                        pressure[y * nx + x] = if open { from[x / 2] } else { 0.0 };
                    }
                }
            },
        );
    }

    /// One projected Jacobi sweep.
    fn sweep(&mut self) {
        let (lattice, plane) = (self.lattice, self.lattice.plane());
        let (p, weight, source) = (&self.pressure, &self.weight, &self.source);
        self.spare.par_chunks_mut(plane).enumerate().for_each(|(z, out)| {
            if 0 < z && z + 1 < lattice.dims[2] {
                relax_plane(p, weight, source, &lattice, z, out);
            }
        });
        std::mem::swap(&mut self.pressure, &mut self.spare);
    }
}

/// p <- max(0, p + RELAX (mean of open neighbours + h² e / neighbours - p)), in one plane.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn relax_plane(p: &[f32], weight: &[f32], source: &[f32], lattice: &Lattice, z: usize, out: &mut [f32]) {
    let [nx, ny, _] = lattice.dims;
    let plane = lattice.plane();
    for y in 1..ny - 1 {
        let at = z * plane + y * nx + 1;
        let row = |from: usize| &p[from..from + nx - 2];
        let (here, left, right) = (row(at), row(at - 1), row(at + 1));
        let (front, back, below, above) = (row(at - nx), row(at + nx), row(at - plane), row(at + plane));
        let (w, s) = (&weight[at..at + nx - 2], &source[at..at + nx - 2]);
        let out = &mut out[y * nx + 1..y * nx + nx - 1];
        for i in 0..nx - 2 {
            let sum = (left[i] + right[i]) + (front[i] + back[i]) + (below[i] + above[i]);
            // A closed cell has weight and pressure zero and keeps them.
            out[i] = ((1.0 - RELAX) * here[i] + w[i] * (sum + s[i])).max(0.0);
        }
    }
}
