//! The correction written plainly in double precision, to compare with: no lanes, no levels, no packed counts, no head.

use super::HairHairParams;
use super::apply::LEAST_CM;
use std::collections::BTreeMap;

type Cell = [i32; 3];

/// Cells around the hair that pressure may reach into.
const REACH: i32 = 8;

/// Change of pressure in a sweep at which it has converged, cm².
const CONVERGED: f64 = 1e-9;

fn cell_of(p: [f32; 3], h: f64) -> Cell {
    p.map(|x| (f64::from(x) / h).floor() as i32)
}

/// Sum over particles around a cell of what they carry, by 1 2 1 along each axis.
fn smoothed(sums: &BTreeMap<Cell, f64>, at: Cell) -> f64 {
    let weight = |d: i32| if d == 0 { 0.5 } else { 0.25 };
    let mut sum = 0.0;
    for x in -1..=1 {
        for y in -1..=1 {
            for z in -1..=1 {
                let there = sums.get(&[at[0] + x, at[1] + y, at[2] + z]).copied().unwrap_or(0.0);
                sum += weight(x) * weight(y) * weight(z) * there;
            }
        }
    }
    sum
}

fn sums(hair: &[[f32; 3]], carried: &[f64], h: f64) -> BTreeMap<Cell, f64> {
    let mut sums = BTreeMap::new();
    for (&p, c) in hair.iter().zip(carried) {
        *sums.entry(cell_of(p, h)).or_insert(0.0) += c;
    }
    sums
}

/// What each particle may have around it.
fn allowed(rest: &[[f32; 3]], h: f64) -> Vec<f64> {
    let counts = sums(rest, &vec![1.0; rest.len()], h);
    let own: Vec<f64> = rest.iter().map(|&p| smoothed(&counts, cell_of(p, h))).collect();
    let carried = sums(rest, &own, h);
    let raise = |at: Cell| {
        let mut worst = 1.0f64;
        for k in 0..27 {
            let c = [at[0] + k % 3 - 1, at[1] + k / 3 % 3 - 1, at[2] + k / 9 - 1];
            let (n, s) = (smoothed(&counts, c), smoothed(&carried, c));
            worst = worst.max(if s > 0.0 { n * n / s } else { 1.0 });
        }
        worst
    };
    rest.iter().zip(own).map(|(&p, a)| a * raise(cell_of(p, h))).collect()
}

/// Corrects `hair`, given in the head frame, without friction and far from solids.
pub(crate) fn correct(
    rest: &[[f32; 3]],
    hair: &[[f32; 3]],
    n: usize,
    n_fixed: usize,
    params: &HairHairParams,
) -> Vec<[f32; 3]> {
    let h = f64::from(params.cell_cm);
    let allowed = allowed(rest, h);
    let thin = f64::from(params.thin) * allowed.iter().sum::<f64>() / allowed.len() as f64;
    let counts = sums(hair, &vec![1.0; hair.len()], h);
    let carried = sums(hair, &allowed, h);
    let all = || hair.iter().chain(rest).map(|&p| cell_of(p, h));
    let low: Cell = std::array::from_fn(|c| all().map(|p| p[c]).min().unwrap_or(0) - REACH);
    let dims: [usize; 3] =
        std::array::from_fn(|c| (all().map(|p| p[c]).max().unwrap_or(0) + REACH - low[c] + 1) as usize);
    let index = |x: usize, y: usize, z: usize| (z * dims[1] + y) * dims[0] + x;
    let mut source = vec![0.0; dims[0] * dims[1] * dims[2]];
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                let at = [low[0] + x as i32, low[1] + y as i32, low[2] + z as i32];
                let (count, sum) = (smoothed(&counts, at), smoothed(&carried, at));
                let most = if count > 0.0 { (f64::from(1.0 + params.slack) * sum / count).max(thin) } else { 1.0 };
                let excess = (count / most - 1.0).min(1.0);
                source[index(x, y, z)] = h * h * if excess > 0.0 { f64::from(params.gain) * excess } else { excess };
            }
        }
    }
    let pressure = solve(&source, dims);
    let u = |x: usize, y: usize, z: usize| {
        let d = |a: usize, b: usize| -0.5 * (pressure[a] - pressure[b]) / h;
        let u = [
            d(index(x + 1, y, z), index(x - 1, y, z)),
            d(index(x, y + 1, z), index(x, y - 1, z)),
            d(index(x, y, z + 1), index(x, y, z - 1)),
        ];
        let size = u.iter().map(|x| x * x).sum::<f64>().sqrt();
        let shorter = (size.min(f64::from(params.max_shift_cm)) - f64::from(LEAST_CM)).max(0.0);
        u.map(|x| if size > 0.0 { x * shorter / size } else { 0.0 })
    };
    let mut out = hair.to_vec();
    for strand in out.chunks_exact_mut(n) {
        let was: Vec<[f64; 3]> = strand.iter().map(|p| p.map(f64::from)).collect();
        let mut shift = vec![[0.0; 3]; n];
        for i in n_fixed..n {
            let place: [f64; 3] = std::array::from_fn(|c| was[i][c] / h - f64::from(low[c]) - 0.5);
            for k in 0..8 {
                let near = [k & 1, (k >> 1) & 1, k >> 2];
                let weight: f64 =
                    (0..3).map(|c| if near[c] == 1 { place[c].fract() } else { 1.0 - place[c].fract() }).product();
                let at: [usize; 3] = std::array::from_fn(|c| place[c] as usize + near[c]);
                let of_cell = u(at[0], at[1], at[2]);
                shift[i] = std::array::from_fn(|c| shift[i][c] + weight * of_cell[c]);
            }
        }
        for _ in 0..2 {
            let from = shift.clone();
            for i in n_fixed..n {
                let after = from[(i + 1).min(n - 1)];
                shift[i] = std::array::from_fn(|c| 0.25 * (from[i - 1][c] + after[c]) + 0.5 * from[i][c]);
            }
        }
        let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let mut at = was[n_fixed - 1];
        for i in n_fixed..n {
            let old: [f64; 3] = std::array::from_fn(|c| was[i][c] - was[i - 1][c]);
            let new: [f64; 3] = std::array::from_fn(|c| old[c] + shift[i][c] - shift[i - 1][c]);
            at = std::array::from_fn(|c| at[c] + new[c] * length(old) / length(new));
            strand[i] = at.map(|x| x as f32);
        }
    }
    out
}

/// Projected Gauss-Seidel to convergence.
fn solve(source: &[f64], dims: [usize; 3]) -> Vec<f64> {
    let mut p = vec![0.0f64; source.len()];
    let strides = [1, dims[0], dims[0] * dims[1]];
    loop {
        let mut change = 0.0f64;
        for z in 1..dims[2] - 1 {
            for y in 1..dims[1] - 1 {
                for x in 1..dims[0] - 1 {
                    let i = z * strides[2] + y * strides[1] + x;
                    let sum: f64 = strides.iter().map(|&s| p[i - s] + p[i + s]).sum();
                    let new = ((sum + source[i]) / 6.0).max(0.0);
                    change = change.max((new - p[i]).abs());
                    p[i] = new;
                }
            }
        }
        if change < CONVERGED {
            return p;
        }
    }
}
