//! Many samples at once: the arithmetic of eight points in vector instructions, their reads one by one.
//!
//! Points come as three arrays and go out as four. They are taken in blocks, and a block in passes: places, then the table,
//! then the corners, then the arithmetic. Reads that wait for nothing but memory stand side by side so, and their misses
//! overlap. A last block that is not full is filled up with whatever was there before. Results are those of [`SignedDistanceField::distance_gradient`] bit for
//! bit: points outside the grid are sampled where it is nearest to them, and what lies between is added as it does.

use multiversion::multiversion;
use nalgebra::Vector3;

use crate::lanes::{F8, LANES};
use crate::sdf::SignedDistanceField;
use crate::sdf::bricks::{BRICK, COARSE, Layout, first_corner};

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
    cell: f32,
    /// Largest grid coordinate, and first node of the last cell, along each axis.
    last: [f32; 3],
    last_cell: [u32; 3],
    layout: &'a Layout,
    /// Centimetres, and slope, that one stands for in fine and in coarse cells.
    scales: [[f32; 2]; 2],
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
            cell: self.cell(),
            last: bounds.map(|n| (n - 1) as f32),
            last_cell: bounds.map(|n| n as u32 - 2),
            layout: self.layout(),
            scales: [self.scales(false), self.scales(true)],
        };
        let mut singly = |n: usize, out: &mut Samples| {
            let p = Vector3::new(points[0][n], points[1][n], points[2][n]);
            let (distance, gradient) = self.distance_gradient(p);
            out.distance[n] = distance;
            for k in 0..3 {
                out.gradient[k][n] = gradient[k];
            }
        };
        // A block is cleared at each call: a few points take a small one.
        match n {
            ..=FEW => sample_inside::<FEW>(grid, points, out, &mut singly),
            _ => sample_inside::<MANY>(grid, points, out, &mut singly),
        }
    }
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

/// Points whose corners are fetched before any is used: enough for the misses of many to overlap, few enough that
/// what is kept of them stays in the nearest cache.
const MANY: usize = 64;
const FEW: usize = 16;

/// What one pass leaves for the next, an entry for each point of a block.
struct Passes<const BLOCK: usize> {
    /// Coordinates in the grid, then fractions across the cell.
    t: [[f32; BLOCK]; 3],
    /// First node of the point's cell along each axis.
    cell: [[u32; BLOCK]; 3],
    /// Brick, then where the cell's corners begin.
    place: [u32; BLOCK],
    /// First corner within a fine brick.
    within: [u32; BLOCK],
    quantum: [f32; BLOCK],
    slope: [f32; BLOCK],
    /// The four edges along x of the cell, two values each.
    edges: [[[i16; 2]; BLOCK]; 4],
    /// How far the point lies outside along each axis, cm; zero within the grid.
    gap: [[f32; BLOCK]; 3],
    /// Zero for points in the grid.
    outside: [u32; BLOCK],
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn sample_inside<const BLOCK: usize>(
    grid: Grid,
    points: [&[f32]; 3],
    out: &mut Samples,
    singly: &mut dyn FnMut(usize, &mut Samples),
) {
    let n = points[0].len();
    let Grid { origin, inv_cell, cell: cell_cm, last, last_cell, layout, scales } = grid;
    let [count_x, count_y, _] = layout.count.map(|n| n as u32);
    let countable = last.iter().all(|&n| n < 0.5 * ONES);
    let mut passes = Passes::<BLOCK> {
        t: [[0.0; BLOCK]; 3],
        cell: [[0; BLOCK]; 3],
        place: [0; BLOCK],
        within: [0; BLOCK],
        quantum: [0.0; BLOCK],
        slope: [0.0; BLOCK],
        edges: [[[0; 2]; BLOCK]; 4],
        gap: [[0.0; BLOCK]; 3],
        outside: [0; BLOCK],
    };
    let Passes { t, cell, place, within, quantum, slope, edges, gap, outside } = &mut passes;
    let mut begin = 0;
    while begin < n && countable {
        let size = BLOCK.min(n - begin);
        // A few points take as few passes.
        let filled = size.next_multiple_of(LANES);
        *outside = [0; BLOCK];
        for k in 0..3 {
            t[k][..size].copy_from_slice(&points[k][begin..begin + size]);
            for l in 0..filled {
                let g = (t[k][l] - origin[k]) * inv_cell;
                let held = if g >= 0.0 { g } else { 0.0 };
                let held = if held <= last[k] { held } else { last[k] };
                outside[l] |= u32::from(held != g);
                gap[k][l] = (g - held) * cell_cm;
                let c = floor(held);
                t[k][l] = held;
                cell[k][l] = if c < last_cell[k] { c } else { last_cell[k] };
            }
        }
        const B: u32 = BRICK as u32;
        for l in 0..filled {
            let [i, j, k] = [cell[0][l], cell[1][l], cell[2][l]];
            place[l] = ((k / B) * count_y + j / B) * count_x + i / B;
            within[l] = first_corner(i, j, k);
        }
        for l in 0..filled {
            place[l] = layout.table[place[l] as usize];
        }
        for l in 0..filled {
            let coarse = place[l] & COARSE != 0;
            place[l] = (place[l] & !COARSE) + if coarse { 0 } else { within[l] };
            let whole = if coarse { BRICK as u32 - 1 } else { 0 };
            let share = if coarse { 1.0 / BRICK as f32 } else { 1.0 };
            quantum[l] = if coarse { scales[1][0] } else { scales[0][0] };
            slope[l] = if coarse { scales[1][1] } else { scales[0][1] };
            t[0][l] = (t[0][l] - small(cell[0][l] & !whole)) * share;
            t[1][l] = (t[1][l] - small(cell[1][l] & !whole)) * share;
            t[2][l] = (t[2][l] - small(cell[2][l] & !whole)) * share;
        }
        for l in 0..filled {
            let corners = layout.corners(place[l] as usize);
            for e in 0..4 {
                edges[e][l] = corners[e];
            }
        }
        for first in (0..filled).step_by(LANES) {
            let lanes = first..first + LANES;
            let read = |from: &[f32; BLOCK]| {
                let mut v = F8::ZERO;
                v.0.copy_from_slice(&from[lanes.clone()]);
                v
            };
            let mut a = [F8::ZERO; 4];
            let mut b = [F8::ZERO; 4];
            for e in 0..4 {
                let pairs = &edges[e][lanes.clone()];
                for l in 0..LANES {
                    a[e].0[l] = f32::from(pairs[l][0]);
                    b[e].0[l] = f32::from(pairs[l][1]);
                }
            }
            // As for a single point, lane by lane.
            let (tx, ty, tz) = (read(&t[0]), read(&t[1]), read(&t[2]));
            let [a0, a1, a2, a3] = a;
            let (dx0, dx1, dx2, dx3) = (b[0] - a0, b[1] - a1, b[2] - a2, b[3] - a3);
            let (x0, x1, x2, x3) = (a0 + tx * dx0, a1 + tx * dx1, a2 + tx * dx2, a3 + tx * dx3);
            let (dy0, dy1) = (x1 - x0, x3 - x2);
            let (y0, y1) = (x0 + ty * dy0, x2 + ty * dy1);
            let (ex0, ex1) = (dx0 + ty * (dx1 - dx0), dx2 + ty * (dx3 - dx2));
            let slope = read(slope);
            let mut distance = (y0 + tz * (y1 - y0)) * read(quantum);
            let mut gradient_x = (ex0 + tz * (ex1 - ex0)) * slope;
            let mut gradient_y = (dy0 + tz * (dy1 - dy0)) * slope;
            let mut gradient_z = (y1 - y0) * slope;
            if outside[lanes.clone()].iter().fold(0, |a, b| a | b) != 0 {
                for l in 0..LANES {
                    // Along an axis on which the point is outside, the nearest place of the grid does not move with it.
                    let along = [gradient_x.0[l], gradient_y.0[l], gradient_z.0[l]];
                    let gap = [gap[0][first + l], gap[1][first + l], gap[2][first + l]];
                    let d = if distance.0[l] > 0.0 { distance.0[l] } else { 0.0 };
                    let total = (gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2] + d * d).sqrt();
                    let turned = |k: usize| (gap[k] + if gap[k] == 0.0 { along[k] } else { 0.0 } * d) / total;
                    let out = outside[first + l] != 0;
                    let turns = out & (total > 0.0);
                    distance.0[l] = if out { total } else { distance.0[l] };
                    gradient_x.0[l] = if turns { turned(0) } else { along[0] };
                    gradient_y.0[l] = if turns { turned(1) } else { along[1] };
                    gradient_z.0[l] = if turns { turned(2) } else { along[2] };
                }
            }
            // Straight to where it belongs: gathered in a block first, wide copies would wait for the narrower stores.
            let n_here = LANES.min(size - first);
            let to = begin + first..begin + first + n_here;
            if n_here == LANES {
                out.distance[to.clone()].copy_from_slice(&distance.0);
                out.gradient[0][to.clone()].copy_from_slice(&gradient_x.0);
                out.gradient[1][to.clone()].copy_from_slice(&gradient_y.0);
                out.gradient[2][to].copy_from_slice(&gradient_z.0);
            } else {
                out.distance[to.clone()].copy_from_slice(&distance.0[..n_here]);
                out.gradient[0][to.clone()].copy_from_slice(&gradient_x.0[..n_here]);
                out.gradient[1][to.clone()].copy_from_slice(&gradient_y.0[..n_here]);
                out.gradient[2][to].copy_from_slice(&gradient_z.0[..n_here]);
            }
            if first + LANES >= size {
                break;
            }
        }
        if outside.iter().fold(0, |a, b| a | b) != 0 {
            for l in (begin..begin + size).filter(|&l| outside[l - begin] != 0) {
                if out.distance[l].is_nan() {
                    singly(l, out);
                }
            }
        }
        begin += size;
    }
    for l in begin..n {
        singly(l, out);
    }
}
