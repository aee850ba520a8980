//! From the pressure to strands: the displacement field on the grid, then each strand moved by it with its lengths kept.
//!
//! The field is trilinear between cell centres, so neighbours move alike. Along a strand it is smoothed, then only turns
//! segments: each keeps its length and takes the direction that the displaced one has, and the strand is the sum of its
//! segments from the last fixed particle on. A strand that would move farther than it may is drawn back towards where it was.

use super::HairHairParams;
use super::density::{Density, displacement};
use super::lattice::{Frame, Lattice};
use super::pressure::Pressure;
use multiversion::multiversion;
use rayon::prelude::*;

/// Passes of smoothing by 1 2 1 along the strand.
const SMOOTHINGS: usize = 2;

/// Displacement and friction at cell centres.
#[derive(Debug, Default)]
pub(crate) struct Field {
    /// Displacement (cm, head frame) and a spare, four values a cell.
    shift: Vec<f32>,
    /// Share of motion taken away times the neighbours' mean motion, and the share, four values a cell; empty without
    /// friction.
    rub: Vec<f32>,
    /// Whether any of the eight cells from this one on moves what is between their centres.
    live: Vec<u8>,
}

/// What bounds a particle's way.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    /// Farthest a particle moves, cm.
    pub max_shift: f32,
    pub inv_cell: f32,
}

impl Field {
    /// The displacement that a pressure makes: against its gradient, never into the head, `max_shift_cm` at most.
    pub(crate) fn spread(&mut self, lattice: &Lattice, pressure: &Pressure, params: &HairHairParams) {
        let n_cells = lattice.n_cells();
        self.shift.resize(4 * n_cells, 0.0);
        self.rub.clear();
        let [nx, ny, nz] = lattice.dims;
        let plane = lattice.plane();
        let (p, open) = (pressure.values(), pressure.open());
        let scale = -0.5 / params.cell_cm;
        self.shift.par_chunks_mut(4 * plane).enumerate().for_each(|(z, out)| {
            out.fill(0.0);
            if z == 0 || z + 1 == nz {
                return;
            }
            for y in 1..ny - 1 {
                for x in 1..nx - 1 {
                    let i = z * plane + y * nx + x;
                    if open[i] == 0.0 {
                        continue;
                    }
                    // Nothing flows through a face of the head.
                    let mut u = [1, nx, plane]
                        .map(|s| scale * (open[i + s] * (p[i + s] - p[i]) + open[i - s] * (p[i] - p[i - s])));
                    let size2 = u[0] * u[0] + u[1] * u[1] + u[2] * u[2];
                    if size2 == 0.0 {
                        continue;
                    }
                    if size2 > params.max_shift_cm * params.max_shift_cm {
                        u = u.map(|x| x * params.max_shift_cm / size2.sqrt());
                    }
                    if pressure.has_head() {
                        u = keep_off_head(u, pressure.away_from_head(i), params.cell_cm);
                    }
                    out[4 * (y * nx + x)..][..3].copy_from_slice(&u);
                }
            }
        });
        self.find_live(lattice);
    }

    /// Adds friction: the share of motion that is taken away in each cell, more where hair is denser.
    pub(crate) fn rub(&mut self, lattice: &Lattice, density: &Density, friction: f32) {
        self.rub.resize(4 * lattice.n_cells(), 0.0);
        let plane = lattice.plane();
        self.rub.par_chunks_mut(4 * plane).enumerate().for_each(|(z, out)| {
            for (i, out) in out.chunks_exact_mut(4).enumerate() {
                let (mean, dense) = density.motion_at(z * plane + i);
                let share = friction * dense;
                out.copy_from_slice(&[share * mean[0], share * mean[1], share * mean[2], share]);
            }
        });
    }

    fn find_live(&mut self, lattice: &Lattice) {
        let [nx, ny, nz] = lattice.dims;
        let plane = lattice.plane();
        self.live.resize(lattice.n_cells(), 0);
        let shift = &self.shift;
        let moves = |i: usize| shift[4 * i] != 0.0 || shift[4 * i + 1] != 0.0 || shift[4 * i + 2] != 0.0;
        self.live.par_chunks_mut(plane).enumerate().for_each(|(z, live)| {
            live.fill(0);
            if z + 1 == nz {
                return;
            }
            for y in 0..ny - 1 {
                for x in 0..nx - 1 {
                    let any = [0, 1, nx, nx + 1, plane, plane + 1, plane + nx, plane + nx + 1]
                        .iter()
                        .any(|&k| moves(z * plane + y * nx + x + k));
                    live[y * nx + x] = u8::from(any);
                }
            }
        });
    }
}

/// Takes out what would lead a point within a cell of its centre into the head.
fn keep_off_head(u: [f32; 3], (distance, away): (f32, [f32; 3]), cell: f32) -> [f32; 3] {
    // Points that take part of this cell's displacement are up to a cell's diagonal nearer.
    let room = (distance - 3.0f32.sqrt() * cell).max(0.0);
    let inward = -(u[0] * away[0] + u[1] * away[1] + u[2] * away[2]) - room;
    if inward <= 0.0 { u } else { std::array::from_fn(|c| u[c] + inward * away[c]) }
}

/// Buffers of one piece of strands: values along one strand by axis.
#[derive(Clone, Debug)]
pub(crate) struct Scratch {
    at: [Vec<f32>; 3],
    shift: [Vec<f32>; 3],
    segment: [Vec<f32>; 3],
}

impl Scratch {
    pub(crate) fn new(n_particles: usize) -> Self {
        let zeros = || std::array::from_fn(|_| vec![0.0; n_particles]);
        Self { at: zeros(), shift: zeros(), segment: zeros() }
    }
}

/// What moves a strand.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StrandMove<'a> {
    pub lattice: &'a Lattice,
    pub field: &'a Field,
    pub limits: Limits,
    /// Particles that stay.
    pub n_fixed: usize,
    pub frame: &'a Frame,
    /// Its positions at the read before, with their frame, where there is friction.
    pub previous: Option<(&'a [[f32; 3]], &'a Frame)>,
}

impl StrandMove<'_> {
    /// Moves a strand; whether it did.
    pub(crate) fn apply(
        &self,
        strand: &mut [[f32; 3]],
        clearance: &(impl Fn(usize) -> f32 + Sync),
        strand_idx: usize,
        scratch: &mut Scratch,
    ) -> bool {
        let n_fixed = self.n_fixed.max(1);
        if strand.len() <= n_fixed || !gather(self, strand, n_fixed, scratch) {
            return false;
        }
        let limit = self.limits.max_shift.min(clearance(strand_idx));
        if !(limit > 0.0) {
            return false;
        }
        let farthest = keep_lengths(n_fixed, scratch);
        // Not a number goes nowhere.
        if !(farthest > 0.0 && farthest.is_finite()) {
            return false;
        }
        let share = if farthest > limit { limit / farthest } else { 1.0 };
        for i in n_fixed..strand.len() {
            let moved = self.frame.from_head(std::array::from_fn(|c| share * scratch.shift[c][i]));
            strand[i] = std::array::from_fn(|c| strand[i][c] + moved[c]);
        }
        true
    }
}

/// Finds where the strand is in the head frame and what the field moves each particle by; whether it moves any.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn gather(case: &StrandMove, strand: &[[f32; 3]], n_fixed: usize, scratch: &mut Scratch) -> bool {
    let (field, lattice) = (case.field, case.lattice);
    let mut live = 0;
    for (i, &p) in strand.iter().enumerate() {
        let p = case.frame.to_head(p);
        let (cell, place) = lattice.cell_of(p, case.limits.inv_cell);
        let mut u = [0.0f32; 4];
        if cell != 0 && i >= n_fixed {
            let (base, [x, y, z]) = base_of(lattice, place);
            let moves = field.live[base];
            live |= moves;
            if moves != 0 {
                u = trilinear(&field.shift, lattice, base, [x, y, z]);
            }
            if let Some((before, frame)) = case.previous {
                let rub = trilinear(&field.rub, lattice, base, [x, y, z]);
                let d = displacement(p, frame.to_head(before[i]));
                for c in 0..3 {
                    let against = rub[c] - rub[3] * d[c];
                    u[c] += against;
                    live |= u8::from(against != 0.0);
                }
            }
        }
        for c in 0..3 {
            scratch.at[c][i] = p[c];
            scratch.shift[c][i] = u[c];
        }
    }
    live != 0
}

/// The cell whose centre is next below a place in each direction, and how far past its centre the place is, in cells.
#[inline(always)]
fn base_of(lattice: &Lattice, place: [f32; 3]) -> (usize, [f32; 3]) {
    let from_centre = place.map(|x| x - 0.5);
    let at = from_centre.map(|x| x as i32);
    let base = (at[2] as usize * lattice.dims[1] + at[1] as usize) * lattice.dims[0] + at[0] as usize;
    (base, std::array::from_fn(|c| from_centre[c] - at[c] as f32))
}

/// Four values between cell centres; neighbours along x lie side by side and are read as one.
#[inline(always)]
fn trilinear(values: &[f32], lattice: &Lattice, base: usize, [x, y, z]: [f32; 3]) -> [f32; 4] {
    let (row, plane) = (lattice.dims[0], lattice.plane());
    let mut sum = [0.0f32; 8];
    let corners = [(0, (1.0 - y) * (1.0 - z)), (row, y * (1.0 - z)), (plane, (1.0 - y) * z), (plane + row, y * z)];
    for (stride, weight) in corners {
        let pair = &values[4 * (base + stride)..][..8];
        for l in 0..8 {
            sum[l] = pair[l].mul_add(weight, sum[l]);
        }
    }
    std::array::from_fn(|l| x.mul_add(sum[l + 4] - sum[l], sum[l]))
}

/// Turns a displacement into one that keeps every segment's length; how far it moves the farthest particle, cm.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn keep_lengths(n_fixed: usize, scratch: &mut Scratch) -> f32 {
    let Scratch { at, shift, segment } = scratch;
    let n = at[0].len();
    for _ in 0..SMOOTHINGS {
        for c in 0..3 {
            let (from, to) = (&shift[c], &mut segment[c]);
            for i in n_fixed..n - 1 {
                to[i] = 0.25 * (from[i - 1] + from[i + 1]) + 0.5 * from[i];
            }
            to[n - 1] = 0.5 * (from[n - 2] + from[n - 1]);
            to[..n_fixed].fill(0.0);
            std::mem::swap(&mut shift[c], &mut segment[c]);
        }
    }
    // What each segment's end moves against its start, once the displaced segment has its length again.
    let [x, y, z] = at;
    let [ux, uy, uz] = shift;
    let [sx, sy, sz] = segment;
    for i in n_fixed..n {
        let d = [x[i] - x[i - 1], y[i] - y[i - 1], z[i] - z[i - 1]];
        let q = [d[0] + (ux[i] - ux[i - 1]), d[1] + (uy[i] - uy[i - 1]), d[2] + (uz[i] - uz[i - 1])];
        let length2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        let displaced2 = q[0] * q[0] + q[1] * q[1] + q[2] * q[2];
        let scale = if displaced2 > 0.0 { (length2 / displaced2).sqrt() } else { 1.0 };
        (sx[i], sy[i], sz[i]) = (q[0] * scale - d[0], q[1] * scale - d[1], q[2] * scale - d[2]);
    }
    let mut farthest2 = 0.0f32;
    let mut sum = [0.0f32; 3];
    for i in n_fixed..n {
        sum = [sum[0] + sx[i], sum[1] + sy[i], sum[2] + sz[i]];
        (ux[i], uy[i], uz[i]) = (sum[0], sum[1], sum[2]);
        farthest2 = farthest2.max(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
    }
    farthest2.sqrt()
}
