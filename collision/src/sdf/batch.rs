//! Many samples at once: the arithmetic of eight points in vector instructions, their reads one by one.
//!
//! Points come as three arrays and go out as four. Results are those of [`SignedDistanceField::distance_gradient`] bit for
//! bit; points outside the grid are handed to it.

use multiversion::multiversion;
use nalgebra::Vector3;

use crate::lanes::{F8, LANES};
use crate::sdf::SignedDistanceField;
use crate::sdf::bricks::{BRICK, COARSE, CORNERS, Layout, ROW, SLAB, SPAN};

/// Places and what is found there, one entry for each point in every array; cm.
#[derive(Debug)]
pub struct Samples<'a> {
    /// Signed distances.
    pub distance: &'a mut [f32],
    /// Gradients along x, y and z.
    pub gradient: [&'a mut [f32]; 3],
}

/// What sampling needs of a field.
#[derive(Clone, Copy)]
struct Grid<'a> {
    origin: [f32; 3],
    inv_cell: f32,
    /// Largest grid coordinate, and first node of the last cell, along each axis.
    last: [f32; 3],
    last_cell: [u32; 3],
    layout: &'a Layout,
}

impl SignedDistanceField {
    /// Signed distances and gradients at points (solid's frame, cm) given by their coordinates along x, y and z.
    ///
    /// # Panics
    /// When the arrays are not of one length.
    pub fn sample(&self, points: [&[f32]; 3], out: &mut Samples) {
        let n = points[0].len();
        let whole = points.iter().all(|p| p.len() == n) && out.gradient.iter().all(|g| g.len() == n);
        assert!(whole && out.distance.len() == n, "one entry for each point");
        let bounds = self.nodes();
        let grid = Grid {
            origin: self.origin().into(),
            inv_cell: self.inv_cell(),
            last: bounds.map(|n| (n - 1) as f32),
            last_cell: bounds.map(|n| n as u32 - 2),
            layout: self.layout(),
        };
        sample_inside(grid, points, out, &mut |n, out| {
            let p = Vector3::new(points[0][n], points[1][n], points[2][n]);
            let (distance, gradient) = self.distance_gradient(p);
            out.distance[n] = distance;
            for k in 0..3 {
                out.gradient[k][n] = gradient[k];
            }
        });
    }
}

/// Coordinates along an axis in the grid, and whether they are in it.
#[inline(always)]
fn to_grid(points: &[f32], origin: f32, inv_cell: f32, last: f32) -> ([f32; LANES], bool) {
    let mut g = [0.0; LANES];
    let mut inside = true;
    for l in 0..LANES {
        g[l] = (points[l] - origin) * inv_cell;
        inside &= (g[l] >= 0.0) & (g[l] <= last);
    }
    (g, inside)
}

/// Where single precision counts in ones; larger grids are sampled point by point.
const ONES: f32 = 8_388_608.0;

/// The whole part of a number from zero to below 2^22: the conversion that asks for nothing else is no vector instruction.
#[inline(always)]
fn floor(x: f32) -> u32 {
    let rounded = (x + ONES) - ONES;
    let below = rounded - if rounded > x { 1.0 } else { 0.0 };
    (below + ONES).to_bits() & 0x7f_ffff
}

/// A number below 2^23 as it is.
#[inline(always)]
fn small(n: u32) -> f32 {
    f32::from_bits(n | ONES.to_bits()) - ONES
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn sample_inside(grid: Grid, points: [&[f32]; 3], out: &mut Samples, singly: &mut dyn FnMut(usize, &mut Samples)) {
    let n = points[0].len();
    let Grid { origin, inv_cell, last, last_cell, layout } = grid;
    let [count_x, count_y, _] = layout.count.map(|n| n as u32);
    let countable = last.iter().all(|&n| n < 0.5 * ONES);
    let mut begin = 0;
    while begin + LANES <= n {
        let lanes = begin..begin + LANES;
        let (gx, in_x) = to_grid(&points[0][lanes.clone()], origin[0], inv_cell, last[0]);
        let (gy, in_y) = to_grid(&points[1][lanes.clone()], origin[1], inv_cell, last[1]);
        let (gz, in_z) = to_grid(&points[2][lanes.clone()], origin[2], inv_cell, last[2]);
        if !(in_x & in_y & in_z & countable) {
            for l in lanes {
                singly(l, out);
            }
            begin += LANES;
            continue;
        }
        let mut cell = [[0u32; LANES]; 3];
        let mut brick = [0u32; LANES];
        let mut within = [0u32; LANES];
        for l in 0..LANES {
            let i = floor(gx[l]).min(last_cell[0]);
            let j = floor(gy[l]).min(last_cell[1]);
            let k = floor(gz[l]).min(last_cell[2]);
            const B: u32 = BRICK as u32;
            brick[l] = ((k / B) * count_y + j / B) * count_x + i / B;
            within[l] = i % B + ROW as u32 * (j % B) + SLAB as u32 * (k % B);
            cell[0][l] = i;
            cell[1][l] = j;
            cell[2][l] = k;
        }
        let mut entry = [0u32; LANES];
        for l in 0..LANES {
            entry[l] = layout.table[brick[l] as usize];
        }
        let mut first = [0u32; LANES];
        let mut per_edge = [0.0f32; LANES];
        let mut t = [[0.0f32; LANES]; 3];
        for l in 0..LANES {
            let coarse = entry[l] & COARSE != 0;
            first[l] = (entry[l] & !COARSE) + if coarse { 0 } else { within[l] };
            let whole = if coarse { BRICK as u32 - 1 } else { 0 };
            per_edge[l] = if coarse { 1.0 / BRICK as f32 } else { 1.0 };
            t[0][l] = (gx[l] - small(cell[0][l] & !whole)) * per_edge[l];
            t[1][l] = (gy[l] - small(cell[1][l] & !whole)) * per_edge[l];
            t[2][l] = (gz[l] - small(cell[2][l] & !whole)) * per_edge[l];
        }
        let mut a = [[0.0f32; LANES]; 4];
        let mut b = [[0.0f32; LANES]; 4];
        for l in 0..LANES {
            let v = &layout.values[first[l] as usize..first[l] as usize + SPAN];
            for e in 0..4 {
                a[e][l] = v[CORNERS[e]];
                b[e][l] = v[CORNERS[e] + 1];
            }
        }
        // As for a single point, lane by lane.
        let (tx, ty, tz) = (F8(t[0]), F8(t[1]), F8(t[2]));
        let (a0, a1, a2, a3) = (F8(a[0]), F8(a[1]), F8(a[2]), F8(a[3]));
        let (dx0, dx1, dx2, dx3) = (F8(b[0]) - a0, F8(b[1]) - a1, F8(b[2]) - a2, F8(b[3]) - a3);
        let (x0, x1, x2, x3) = (a0 + tx * dx0, a1 + tx * dx1, a2 + tx * dx2, a3 + tx * dx3);
        let (dy0, dy1) = (x1 - x0, x3 - x2);
        let (y0, y1) = (x0 + ty * dy0, x2 + ty * dy1);
        let (ex0, ex1) = (dx0 + ty * (dx1 - dx0), dx2 + ty * (dx3 - dx2));
        let per_cm = F8::splat(inv_cell) * F8(per_edge);
        let distance = y0 + tz * (y1 - y0);
        let gradient_x = (ex0 + tz * (ex1 - ex0)) * per_cm;
        let gradient_y = (dy0 + tz * (dy1 - dy0)) * per_cm;
        let gradient_z = (y1 - y0) * per_cm;
        out.distance[lanes.clone()].copy_from_slice(&distance.0);
        out.gradient[0][lanes.clone()].copy_from_slice(&gradient_x.0);
        out.gradient[1][lanes.clone()].copy_from_slice(&gradient_y.0);
        out.gradient[2][lanes].copy_from_slice(&gradient_z.0);
        begin += LANES;
    }
    for l in begin..n {
        singly(l, out);
    }
}
