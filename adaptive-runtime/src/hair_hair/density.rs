//! Particles counted on the grid, and how much denser hair is than at rest.
//!
//! Every particle carries the density it had around it at rest. A cell may hold what its particles carry on the average, so
//! hair is compared with itself wherever it goes: two bundles pressed into one another are twice as dense as either. Counts are integers,
//! summed from one grid a worker: the sums do not depend on who counted what. Densities are particles a cell, smoothed by
//! 1 2 1 along each axis; with cells of half the particles' spacing this takes out the layers that even spacing makes.

use super::HairHairParams;
use super::apply::LANES;
use super::lattice::{Frame, Lattice};
use multiversion::multiversion;
use rayon::prelude::*;

/// A count of one in the upper bits of a cell's word; the lower hold the sum of what particles carry.
const ONE: u64 = 1 << 40;

/// Of a word, the bits of the sum.
const SUM: u64 = ONE - 1;

/// Quanta of displacement to a cm: 2.4 µm. Displacements are cut off at [`JUMP_CM`], so that 65,535 particles fit into a cell.
const QUANTA_PER_CM: f32 = 4096.0;

/// A particle that moved farther than this since the read before has jumped, which is no rubbing.
const JUMP_CM: f32 = 8.0;

/// Every how many strands one is looked at to find the box of a read.
const BOX_STRIDE: usize = 8;

/// How far other strands may be outside the box of those looked at, cm.
const BOX_MARGIN_CM: f32 = 1.0;

/// Counts of a read against those at rest.
#[derive(Debug)]
pub(crate) struct Density {
    cell: f32,
    /// Bounds of the rest positions, cm.
    rest_bounds: [[f32; 3]; 2],
    /// Per particle the density it may have around it, in `unit`s of particles a cell.
    allowed: Vec<u16>,
    unit: f32,
    /// Mean of it over particles, particles a cell.
    mean_allowed: f32,
    lattice: Lattice,
    /// One grid of words per worker; the first ends up with the sum.
    workers: Vec<Vec<u64>>,
    /// Displacement sums per worker, three and a spare per cell.
    motion: Vec<Vec<[i32; 4]>>,
    count: Vec<f32>,
    carried: Vec<f32>,
    excess: Vec<f32>,
    spare: Vec<f32>,
    /// Mean and peak excess, and particles, by plane.
    by_plane: Vec<[f32; 3]>,
    /// Smoothed displacement sums, cm, by axis.
    mean_motion: [Vec<f32>; 3],
}

impl Density {
    /// Counts hair at rest, and gives each particle what it may have around it.
    pub(crate) fn at_rest(rest: &[[f32; 3]], params: &HairHairParams) -> Self {
        let mut density = Self {
            cell: params.cell_cm,
            rest_bounds: bounds(rest.iter().copied()),
            allowed: vec![0; rest.len()],
            unit: 1.0,
            mean_allowed: 1.0,
            lattice: Lattice::default(),
            workers: Vec::new(),
            motion: Vec::new(),
            count: Vec::new(),
            carried: Vec::new(),
            excess: Vec::new(),
            spare: Vec::new(),
            by_plane: Vec::new(),
            mean_motion: Default::default(),
        };
        if rest.is_empty() {
            return density;
        }
        let [low, high] = density.rest_bounds;
        let lattice = Lattice::around(low, high, density.cell);
        let inv_cell = 1.0 / density.cell;
        let cells: Vec<u32> = rest.iter().map(|&p| lattice.cells_of(&p.map(|x| [x]), inv_cell)[0]).collect();
        let sum_by_cell = |of: &dyn Fn(usize) -> f32| {
            let mut sum = vec![0.0; lattice.n_cells()];
            cells.iter().for_each(|&c| sum[c as usize] += of(c as usize));
            let mut spare = vec![0.0; sum.len()];
            smooth(&lattice, &mut sum, &mut spare);
            sum
        };
        let count = sum_by_cell(&|_| 1.0);
        let carried = sum_by_cell(&|c| count[c]);
        // Where hair is densest, the mean of what particles carry is less than what is there. The density a particle carries
        // is raised by the worst such ratio among the cells it counts in: then no cell is in excess at rest.
        let ratio: Vec<f32> = count
            .iter()
            .zip(&carried)
            .map(|(&n, &c)| if n > 0.0 && c > 0.0 { (n * n / c).max(1.0) } else { 1.0 })
            .collect();
        let raised = |c: usize| count[c] * worst_around(&lattice, &ratio, c);
        let top = cells.iter().map(|&c| raised(c as usize)).fold(f32::MIN_POSITIVE, f32::max);
        density.unit = top / f32::from(u16::MAX);
        let mut sum = 0.0;
        for (allowed, &c) in density.allowed.iter_mut().zip(&cells) {
            let of_particle = raised(c as usize);
            *allowed = (of_particle / density.unit).ceil() as u16;
            sum += f64::from(of_particle);
        }
        density.mean_allowed = (sum / rest.len() as f64) as f32;
        density
    }

    /// Counts the particles of a read; returns the box they were counted in. All of the hair at rest is in it, and what
    /// moves farther out than every strand looked at, by a centimetre, is not.
    pub(crate) fn count(&mut self, positions: &[[f32; 3]], n_particles: usize, frame: &Frame) -> Lattice {
        let looked_at = positions.chunks_exact(n_particles).step_by(BOX_STRIDE).flat_map(|strand| {
            [strand[n_particles / 2], strand[n_particles - 1]].into_iter().map(|p| frame.in_head_frame(p))
        });
        let [mut low, mut high] = bounds(looked_at);
        for c in 0..3 {
            low[c] = (low[c] - BOX_MARGIN_CM).min(self.rest_bounds[0][c]);
            high[c] = (high[c] + BOX_MARGIN_CM).max(self.rest_bounds[1][c]);
        }
        self.lattice = Lattice::around(low, high, self.cell);
        let (lattice, inv_cell) = (self.lattice, 1.0 / self.cell);
        let n_cells = lattice.n_cells();
        let n_workers = rayon::current_num_threads();
        let per_worker = positions.len().div_ceil(n_workers).max(1);
        self.workers.resize_with(n_workers, Vec::new);
        self.workers
            .par_iter_mut()
            .zip(positions.par_chunks(per_worker))
            .zip(self.allowed.par_chunks(per_worker))
            .for_each(|((words, points), allowed)| {
                words.clear();
                words.resize(n_cells, 0);
                splat(points, allowed, frame, &lattice, inv_cell, words);
                words[0] = 0;
            });
        let used = positions.len().div_ceil(per_worker);
        for buffer in [&mut self.count, &mut self.carried, &mut self.excess, &mut self.spare] {
            buffer.resize(n_cells, 0.0);
        }
        let (plane, workers, unit) = (lattice.plane(), &self.workers[..used], self.unit);
        self.count.par_chunks_mut(plane).zip(self.carried.par_chunks_mut(plane)).enumerate().for_each(
            |(k, (count, carried))| {
                for i in 0..plane {
                    let word: u64 = workers.iter().map(|words| words[k * plane + i]).sum();
                    count[i] = (word >> 40) as f32;
                    carried[i] = (word & SUM) as f32 * unit;
                }
            },
        );
        smooth(&lattice, &mut self.count, &mut self.spare);
        smooth(&lattice, &mut self.carried, &mut self.spare);
        lattice
    }

    /// How much denser than allowed each cell of the last count is; the mean over particles and the largest.
    pub(crate) fn excess_over_rest(&mut self, params: &HairHairParams) -> (f32, f32) {
        let plane = self.lattice.plane();
        let (slack, thin) = (1.0 + params.slack, params.thin * self.mean_allowed);
        self.by_plane.resize(self.lattice.dims[2], [0.0; 3]);
        self.excess
            .par_chunks_mut(plane)
            .zip(self.count.par_chunks(plane))
            .zip(self.carried.par_chunks(plane))
            .zip(&mut self.by_plane)
            .for_each(|(((excess, count), carried), of_plane)| {
                excess_of(count, carried, slack, thin, excess);
                *of_plane = [0.0; 3];
                for (&e, &n) in excess.iter().zip(count) {
                    *of_plane = [of_plane[0] + e.max(0.0) * n, of_plane[1].max(e), of_plane[2] + n];
                }
            });
        let sum = |k: usize| self.by_plane.iter().map(|p| f64::from(p[k])).sum::<f64>();
        let peak = self.by_plane.iter().fold(0.0f32, |peak, p| peak.max(p[1]));
        ((sum(0) / sum(2).max(1.0)) as f32, peak)
    }

    /// What [`Density::excess_over_rest`] found, per cell: -1 where there is no hair, 0 where it is as dense as it may be.
    pub(crate) fn excess(&self) -> &[f32] {
        &self.excess
    }

    /// Sums the displacement of particles since the read before, in the head frame, by cell.
    pub(crate) fn add_motion(
        &mut self,
        positions: &[[f32; 3]],
        frame: &Frame,
        previous: &[[f32; 3]],
        previous_frame: &Frame,
    ) {
        let (lattice, inv_cell) = (self.lattice, 1.0 / self.cell);
        let n_cells = lattice.n_cells();
        let per_worker = positions.len().div_ceil(self.workers.len()).max(1);
        self.motion.resize_with(self.workers.len(), Vec::new);
        self.motion.par_iter_mut().zip(positions.par_chunks(per_worker)).zip(previous.par_chunks(per_worker)).for_each(
            |((sums, points), before)| {
                sums.clear();
                sums.resize(n_cells, [0; 4]);
                splat_motion((points, frame), (before, previous_frame), &lattice, inv_cell, sums);
                sums[0] = [0; 4];
            },
        );
        let used = positions.len().div_ceil(per_worker);
        let (plane, sums) = (lattice.plane(), &self.motion[..used]);
        for c in 0..3 {
            self.mean_motion[c].resize(n_cells, 0.0);
            self.mean_motion[c].par_chunks_mut(plane).enumerate().for_each(|(k, out)| {
                for i in 0..plane {
                    let sum: i64 = sums.iter().map(|sums| i64::from(sums[k * plane + i][c])).sum();
                    out[i] = sum as f32 / QUANTA_PER_CM;
                }
            });
            smooth(&lattice, &mut self.mean_motion[c], &mut self.spare);
        }
    }

    /// Mean displacement around a cell since the read before (cm, head frame) and how dense hair is there, 0 to 1 of what it
    /// may be.
    #[inline(always)]
    pub(crate) fn motion_at(&self, cell: usize) -> ([f32; 3], f32) {
        let n = self.count[cell];
        let scale = if n > 0.0 { 1.0 / n } else { 0.0 };
        (std::array::from_fn(|c| self.mean_motion[c][cell] * scale), (1.0 + self.excess[cell]).clamp(0.0, 1.0))
    }
}

/// Displacement of a particle between two reads in the head frame, nothing if it has jumped.
#[inline(always)]
pub(crate) fn displacement(now: [f32; 3], before: [f32; 3]) -> [f32; 3] {
    let d: [f32; 3] = std::array::from_fn(|c| now[c] - before[c]);
    let near = (0..3).fold(true, |near, c| near & (d[c].abs() <= JUMP_CM));
    if near { d } else { [0.0; 3] }
}

/// Up to [`LANES`] points by axis; those missing are at the origin.
#[inline(always)]
fn by_axis(points: &[[f32; 3]]) -> [[f32; LANES]; 3] {
    let mut out = [[0.0; LANES]; 3];
    for (l, p) in points.iter().enumerate() {
        (out[0][l], out[1][l], out[2][l]) = (p[0], p[1], p[2]);
    }
    out
}

/// Adds each particle's count and what it carries to its cell.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn splat(points: &[[f32; 3]], allowed: &[u16], frame: &Frame, lattice: &Lattice, inv_cell: f32, words: &mut [u64]) {
    for (points, allowed) in points.chunks(LANES).zip(allowed.chunks(LANES)) {
        let cells = lattice.cells_of(&frame.lanes_in_head(&by_axis(points)), inv_cell);
        for (&cell, &a) in cells.iter().zip(allowed) {
            words[cell as usize] += ONE + u64::from(a);
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn splat_motion(
    (points, frame): (&[[f32; 3]], &Frame),
    (before, previous_frame): (&[[f32; 3]], &Frame),
    lattice: &Lattice,
    inv_cell: f32,
    sums: &mut [[i32; 4]],
) {
    for (points, before) in points.chunks(LANES).zip(before.chunks(LANES)) {
        let now = frame.lanes_in_head(&by_axis(points));
        let then = previous_frame.lanes_in_head(&by_axis(before));
        let cells = lattice.cells_of(&now, inv_cell);
        for l in 0..points.len() {
            let d = displacement([now[0][l], now[1][l], now[2][l]], [then[0][l], then[1][l], then[2][l]]);
            let sum = &mut sums[cells[l] as usize];
            for c in 0..3 {
                // A cell past 65,535 particles wraps, as every other order of summing would.
                sum[c] = sum[c].wrapping_add((d[c] * QUANTA_PER_CM) as i32);
            }
        }
    }
}

#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn excess_of(count: &[f32], carried: &[f32], slack: f32, thin: f32, excess: &mut [f32]) {
    for ((e, &n), &c) in excess.iter_mut().zip(count).zip(carried) {
        // n / max(slack c/n, thin) - 1, without dividing where there is nothing.
        let allowed = (slack * c).max(thin * n);
        let ratio = if n > 0.0 { n * n / allowed } else { 0.0 };
        // Hair twice as dense as allowed is spread as far as one pass can; more asked for would only leave the linear range.
        *e = (ratio - 1.0).min(1.0);
    }
}

/// Smooths by 1 2 1 along each axis, in place; the box's outermost cells hold nothing within the rim.
pub(crate) fn smooth(lattice: &Lattice, values: &mut Vec<f32>, spare: &mut Vec<f32>) {
    for stride in [1, lattice.dims[0], lattice.plane()] {
        spare.par_chunks_mut(lattice.plane()).enumerate().for_each(|(k, out)| {
            smooth_plane(values, k * lattice.plane(), stride, out);
        });
        std::mem::swap(values, spare);
    }
}

#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn smooth_plane(values: &[f32], first: usize, stride: usize, out: &mut [f32]) {
    // The box's first and last cells, one stride deep, stay empty: nothing is within one cell of them in this direction.
    let (from, to) = (first.max(stride), (first + out.len()).min(values.len() - stride));
    out.fill(0.0);
    if from < to {
        let below = &values[from - stride..to - stride];
        let above = &values[from + stride..to + stride];
        let here = &values[from..to];
        for (((o, &a), &b), &c) in out[from - first..].iter_mut().zip(below).zip(here).zip(above) {
            *o = 0.25 * (a + c) + 0.5 * b;
        }
    }
}

/// Largest value in the 27 cells around a cell that holds a particle.
fn worst_around(lattice: &Lattice, values: &[f32], cell: usize) -> f32 {
    let (row, plane) = (lattice.dims[0], lattice.plane());
    let mut worst = 0.0f32;
    for z in 0..3 {
        for y in 0..3 {
            let middle = cell + z * plane + y * row - plane - row;
            worst = values[middle - 1..=middle + 1].iter().fold(worst, |w, &v| w.max(v));
        }
    }
    worst
}

fn bounds(points: impl Iterator<Item = [f32; 3]>) -> [[f32; 3]; 2] {
    points.fold([[f32::MAX; 3], [f32::MIN; 3]], |[low, high], p| {
        [std::array::from_fn(|c| low[c].min(p[c])), std::array::from_fn(|c| high[c].max(p[c]))]
    })
}
