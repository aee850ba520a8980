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

/// Every displacement is taken shorter by this, cm, about half a hair's thickness: hair that would move less stays as it is,
/// and costs nothing.
pub(crate) const LEAST_CM: f32 = 5e-3;

/// See [`Field`].
const MOVES: u8 = 1;

/// See [`Field`].
const NEAR_HEAD: u8 = 2;

/// Displacement and friction at cell centres.
#[derive(Debug, Default)]
pub(crate) struct Field {
    /// Displacement (cm, head frame) and a spare, four values a cell.
    shift: Vec<f32>,
    /// Share of motion taken away times the neighbours' mean motion, and the share, four values a cell; empty without
    /// friction.
    rub: Vec<f32>,
    /// By cell [`MOVES`] if any of the eight cells from this one on moves what is between their centres, [`NEAR_HEAD`] if the
    /// head is near.
    flags: Vec<u8>,
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
        let slope = -0.5 / params.cell_cm;
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
                        .map(|s| slope * (open[i + s] * (p[i + s] - p[i]) + open[i - s] * (p[i] - p[i - s])));
                    let size2 = u[0] * u[0] + u[1] * u[1] + u[2] * u[2];
                    if size2 < LEAST_CM * LEAST_CM {
                        continue;
                    }
                    let size = size2.sqrt();
                    let scale = (size.min(params.max_shift_cm) - LEAST_CM).max(0.0) / size;
                    u = [u[0] * scale, u[1] * scale, u[2] * scale];
                    if let Some(head) = pressure.head_at(i) {
                        u = keep_off_head(u, head, params.cell_cm);
                    }
                    out[4 * (y * nx + x)..][..3].copy_from_slice(&u);
                }
            }
        });
        self.find_flags(lattice, pressure, params);
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

    fn find_flags(&mut self, lattice: &Lattice, pressure: &Pressure, params: &HairHairParams) {
        let [nx, ny, nz] = lattice.dims;
        let plane = lattice.plane();
        self.flags.resize(lattice.n_cells(), 0);
        let shift = &self.shift;
        let moves = |i: usize| shift[4 * i] != 0.0 || shift[4 * i + 1] != 0.0 || shift[4 * i + 2] != 0.0;
        // A point between centres is within a diagonal of the first.
        let near = params.max_shift_cm + 3.0f32.sqrt() * params.cell_cm;
        self.flags.par_chunks_mut(plane).enumerate().for_each(|(z, flags)| {
            flags.fill(0);
            if z + 1 == nz {
                return;
            }
            for y in 0..ny - 1 {
                for x in 0..nx - 1 {
                    let i = z * plane + y * nx + x;
                    let corners = [0, 1, nx, nx + 1, plane, plane + 1, plane + nx, plane + nx + 1];
                    let any = corners.iter().any(|&k| moves(i + k));
                    let near_head = pressure.head_at(i).is_some_and(|head| head[3] < near);
                    flags[y * nx + x] = if any { MOVES } else { 0 } | if near_head { NEAR_HEAD } else { 0 };
                }
            }
        });
        // The corner stands for all that is not in the box.
        self.flags[0] = 0;
    }
}

/// Takes out what would lead a point within a cell of its centre into the head, given the direction away from the head and
/// the distance to it.
fn keep_off_head(u: [f32; 3], head: &[f32], cell: f32) -> [f32; 3] {
    // Points that take part of this cell's displacement are up to a cell's diagonal nearer.
    turned_away(u, head, (head[3] - 3.0f32.sqrt() * cell).max(0.0))
}

/// A displacement less what it leads farther than `room` towards the head.
#[inline(always)]
fn turned_away(u: [f32; 3], away: &[f32], room: f32) -> [f32; 3] {
    let beyond = (-(u[0] * away[0] + u[1] * away[1] + u[2] * away[2]) - room).max(0.0);
    [u[0] + beyond * away[0], u[1] + beyond * away[1], u[2] + beyond * away[2]]
}

/// Strands moved together, one a lane.
pub(crate) const LANES: usize = 8;

/// One coordinate of equal particles of [`LANES`] strands.
type Lane = [f32; LANES];

/// Buffers of one piece of strands: by particle and axis.
#[derive(Clone, Debug)]
pub(crate) struct Scratch {
    at: Vec<[Lane; 3]>,
    shift: Vec<[Lane; 3]>,
    spare: Vec<[Lane; 3]>,
    /// By particle a bit for each strand whose particle may come near the head.
    near_head: Vec<u8>,
}

impl Scratch {
    pub(crate) fn new(n_particles: usize) -> Self {
        let zeros = vec![[[0.0; LANES]; 3]; n_particles];
        Self { at: zeros.clone(), shift: zeros.clone(), spare: zeros, near_head: vec![0; n_particles] }
    }
}

/// What moves a group of strands.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StrandMove<'a> {
    pub lattice: &'a Lattice,
    pub field: &'a Field,
    /// Direction away from the head and distance to it (cm) by cell, empty without a head.
    pub head: &'a [f32],
    pub limits: Limits,
    pub n_particles: usize,
    /// Particles that stay, one at least.
    pub n_fixed: usize,
    pub frame: &'a Frame,
    /// The strands at the read before, with their frame, where there is friction.
    pub previous: Option<(&'a [[f32; 3]], &'a Frame)>,
}

impl StrandMove<'_> {
    /// Moves up to [`LANES`] strands, the first of them `first`; how many it moved.
    pub(crate) fn apply(
        &self,
        strands: &mut [[f32; 3]],
        clearance: &(impl Fn(usize) -> f32 + Sync),
        first: usize,
        scratch: &mut Scratch,
    ) -> u32 {
        if self.n_particles <= self.n_fixed {
            return 0;
        }
        let live = gather(self, strands, scratch);
        if live == [false; LANES] {
            return 0;
        }
        let limit =
            std::array::from_fn(|l| if live[l] { self.limits.max_shift.min(clearance(first + l)) } else { 0.0 });
        let share = keep_lengths(self.n_fixed, &limit, scratch);
        let mut moved = 0;
        for (l, strand) in strands.chunks_exact_mut(self.n_particles).enumerate() {
            if share[l] > 0.0 {
                for (i, p) in strand.iter_mut().enumerate().skip(self.n_fixed) {
                    let shift = &scratch.shift[i];
                    let mut u = [share[l] * shift[0][l], share[l] * shift[1][l], share[l] * shift[2][l]];
                    if scratch.near_head[i] & (1 << l) != 0 {
                        u = self.off_head(u, [scratch.at[i][0][l], scratch.at[i][1][l], scratch.at[i][2][l]]);
                    }
                    let u = self.frame.out_of_head(u);
                    *p = [p[0] + u[0], p[1] + u[1], p[2] + u[2]];
                }
                moved += 1;
            }
        }
        moved
    }

    /// Keeps a particle out of the head, or as deep in it as it is: sums of turned segments do not follow the field exactly.
    /// This alone changes lengths, those of segments along the head.
    fn off_head(&self, u: [f32; 3], at: [f32; 3]) -> [f32; 3] {
        let ([base], past) = self.lattice.bases_of(&at.map(|x| [x]), self.limits.inv_cell);
        let head = trilinear(self.head, self.lattice, base as usize, past.map(|x| x[0]));
        // Between centres the distance to a ball of radius r is too large by up to h²/(4 r): room is left for one of 2 cm.
        let margin = 0.125 / (self.limits.inv_cell * self.limits.inv_cell);
        turned_away(u, &head, (head[3] - margin).max(0.0))
    }
}

/// Finds where strands are in the head frame and what the field moves each particle by; which strands it moves.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn gather(case: &StrandMove, strands: &[[f32; 3]], scratch: &mut Scratch) -> [bool; LANES] {
    let (field, lattice, n) = (case.field, case.lattice, case.n_particles);
    let n_strands = strands.len() / n;
    let mut live = [false; LANES];
    for i in 0..n {
        let mut at = [[0.0f32; LANES]; 3];
        for l in 0..n_strands {
            let p = strands[l * n + i];
            (at[0][l], at[1][l], at[2][l]) = (p[0], p[1], p[2]);
        }
        at = case.frame.lanes_in_head(&at);
        let mut shift = [[0.0f32; LANES]; 3];
        let mut near_head = 0;
        // Four values a strand, the fourth unused: all four are kept, or they are not worked on together.
        let mut moves = [[0.0f32; 4]; LANES];
        if i >= case.n_fixed {
            let (base, past) = lattice.bases_of(&at, case.limits.inv_cell);
            for l in 0..n_strands {
                let (b, past) = (base[l] as usize, [past[0][l], past[1][l], past[2][l]]);
                let flags = field.flags[b];
                near_head |= u8::from(flags & NEAR_HEAD != 0) << l;
                if flags & MOVES != 0 {
                    moves[l] = trilinear(&field.shift, lattice, b, past);
                    live[l] = true;
                }
                if let Some((before, frame)) = case.previous
                    && b != 0
                {
                    let rub = trilinear(&field.rub, lattice, b, past);
                    let d = displacement([at[0][l], at[1][l], at[2][l]], frame.in_head_frame(before[l * n + i]));
                    for c in 0..3 {
                        let against = rub[c] - rub[3] * d[c];
                        moves[l][c] += against;
                        live[l] |= against != 0.0;
                    }
                }
            }
        }
        for l in 0..LANES {
            (shift[0][l], shift[1][l], shift[2][l]) = (moves[l][0], moves[l][1], moves[l][2]);
        }
        scratch.at[i] = at;
        scratch.shift[i] = shift;
        scratch.near_head[i] = near_head;
    }
    live
}

/// Four values between cell centres; neighbours along x lie side by side and are read as one.
#[inline(always)]
fn trilinear(values: &[f32], lattice: &Lattice, base: usize, [x, y, z]: [f32; 3]) -> [f32; 4] {
    let (row, plane) = (lattice.dims[0], lattice.plane());
    let corner = |stride: usize| -> &[f32; 8] {
        let at = 4 * (base + stride);
        values[at..at + 8].first_chunk().unwrap_or(&[0.0; 8])
    };
    let [a, b, c, d] = [corner(0), corner(row), corner(plane), corner(plane + row)];
    let mut sum = [0.0f32; 8];
    for l in 0..8 {
        let low = y.mul_add(b[l] - a[l], a[l]);
        let high = y.mul_add(d[l] - c[l], c[l]);
        sum[l] = z.mul_add(high - low, low);
    }
    let mut out = [0.0; 4];
    for l in 0..4 {
        out[l] = x.mul_add(sum[l + 4] - sum[l], sum[l]);
    }
    out
}

/// Turns displacements into ones that keep every segment's length; the share of them that a strand may take, which is
/// zero for one that does not move or is not a number.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn keep_lengths(n_fixed: usize, limit: &Lane, scratch: &mut Scratch) -> Lane {
    let Scratch { at, shift, spare, .. } = scratch;
    let n = at.len();
    for _ in 0..SMOOTHINGS {
        for i in n_fixed..n {
            // The tip stands for what would come after it.
            let after = shift[(i + 1).min(n - 1)];
            for c in 0..3 {
                for l in 0..LANES {
                    spare[i][c][l] = 0.25 * (shift[i - 1][c][l] + after[c][l]) + 0.5 * shift[i][c][l];
                }
            }
        }
        std::mem::swap(shift, spare);
        shift[..n_fixed].fill([[0.0; LANES]; 3]);
    }
    let mut sum = [[0.0f32; LANES]; 3];
    let mut before = [[0.0f32; LANES]; 3];
    let mut farthest2 = [0.0f32; LANES];
    for i in n_fixed..n {
        let (mut length2, mut displaced2, mut moved2) = ([0.0f32; LANES], [0.0f32; LANES], [0.0f32; LANES]);
        let (mut d, mut q) = ([[0.0f32; LANES]; 3], [[0.0f32; LANES]; 3]);
        let here = shift[i];
        for c in 0..3 {
            for l in 0..LANES {
                d[c][l] = at[i][c][l] - at[i - 1][c][l];
                q[c][l] = d[c][l] + (here[c][l] - before[c][l]);
                length2[l] += d[c][l] * d[c][l];
                displaced2[l] += q[c][l] * q[c][l];
            }
        }
        let mut scale = [0.0f32; LANES];
        for l in 0..LANES {
            // A segment of no length keeps none.
            scale[l] = (length2[l] / displaced2[l].max(f32::MIN_POSITIVE)).sqrt();
        }
        for c in 0..3 {
            for l in 0..LANES {
                sum[c][l] += q[c][l] * scale[l] - d[c][l];
                moved2[l] += sum[c][l] * sum[c][l];
            }
        }
        for l in 0..LANES {
            // Unlike `max` this lets through what is not a number.
            farthest2[l] = if moved2[l] <= farthest2[l] { farthest2[l] } else { moved2[l] };
        }
        shift[i] = sum;
        before = here;
    }
    let mut share = [0.0; LANES];
    for l in 0..LANES {
        let farthest = farthest2[l].sqrt();
        let may = farthest > 0.0 && farthest.is_finite() && limit[l] > 0.0;
        share[l] = if may { (limit[l] / farthest).min(1.0) } else { 0.0 };
    }
    share
}
