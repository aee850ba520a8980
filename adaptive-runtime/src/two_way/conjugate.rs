//! AS16 Eq. (4) by a few conjugate-gradient steps from the answer of the step before, eight particle indices to a vector.
//!
//! Particle indices do not couple, so each lane is a system of its own and groups of lanes run in parallel. Only guides
//! that some hair in contact depends on take part. The number of steps is fixed and sums run in guide order: the same
//! input gives the same bytes.

use super::normal_matrix::{KNOTS, NormalMatrix};
use multiversion::multiversion;
use rayon::prelude::*;

/// Particle indices worked on together.
pub(crate) const WIDTH: usize = 8;

type Lanes = [f32; WIDTH];
type Lanes3 = [Lanes; 3];

const ZERO3: Lanes3 = [[0.0; WIDTH]; 3];

/// Keeps a diagonal that no hair contributes to from dividing by zero.
const LEAST_RIDGE: f32 = 1e-20;

#[derive(Debug)]
pub(crate) struct Conjugate {
    /// Rows of the guides that take part, upper part without the diagonal.
    rows: Rows,
    groups: Vec<Group>,
}

#[derive(Debug)]
struct Rows {
    start: Vec<u32>,
    column: Vec<u16>,
    /// At the knots: diagonals, then `column`'s entries.
    at_knots: Vec<[f32; KNOTS]>,
}

/// The systems of eight particle indices.
#[derive(Debug)]
struct Group {
    /// Weight of each knot at each particle index.
    stencil: [Lanes; KNOTS],
    /// Knots with any weight.
    knots: std::ops::Range<usize>,
    matrix: Vec<Lanes>,
    inverse_diagonal: Vec<Lanes>,
    right: Vec<Lanes3>,
    answer: Vec<Lanes3>,
    residual: Vec<Lanes3>,
    direction: Vec<Lanes3>,
    product: Vec<Lanes3>,
}

impl Conjugate {
    /// Room for all guides and pairs is taken here, so that no solve allocates.
    pub(crate) fn new(n_guides: usize, n_pairs: usize, n_particles: usize) -> Self {
        let groups = (0..n_particles.div_ceil(WIDTH))
            .map(|g| {
                let stencil = stencil(n_particles, g * WIDTH);
                let used = |k: &usize| stencil[*k].iter().any(|&h| h != 0.0);
                let first = (0..KNOTS).find(used).unwrap_or(0);
                let last = (0..KNOTS).rev().find(used).unwrap_or(0);
                Group {
                    stencil,
                    knots: first..last + 1,
                    matrix: Vec::with_capacity(n_guides + n_pairs),
                    inverse_diagonal: Vec::with_capacity(n_guides),
                    right: Vec::with_capacity(n_guides),
                    answer: Vec::with_capacity(n_guides),
                    residual: Vec::with_capacity(n_guides),
                    direction: Vec::with_capacity(n_guides),
                    product: Vec::with_capacity(n_guides),
                }
            })
            .collect();
        let rows = Rows {
            start: Vec::with_capacity(n_guides + 1),
            column: Vec::with_capacity(n_pairs),
            at_knots: Vec::with_capacity(n_guides + n_pairs),
        };
        Self { rows, groups }
    }

    /// Solves for the guides in `involved` (ascending; `place` is where each stands in it, or any other value).
    ///
    /// `right(local, particle)` is the right side, `guess` what to start from; [`Conjugate::answer`] then has the result.
    pub(crate) fn solve(
        &mut self,
        matrix: &NormalMatrix,
        involved: &[u16],
        place: &[u16],
        idle: f64,
        ridge: f64,
        iterations: u32,
        n_particles: usize,
        right: impl Fn(usize, usize) -> [f32; 3] + Sync,
        guess: impl Fn(usize, usize) -> [f32; 3] + Sync,
    ) {
        self.rows.gather(matrix, involved, place, idle as f32);
        let (rows, n) = (&self.rows, involved.len());
        self.groups.par_iter_mut().enumerate().for_each(|(g, group)| {
            let first = g * WIDTH;
            let lanes = WIDTH.min(n_particles - first);
            group.right.clear();
            group.right.resize(n, ZERO3);
            group.answer.clear();
            group.answer.resize(n, ZERO3);
            let mut any = false;
            for local in 0..n {
                for l in 0..lanes {
                    let (b, x) = (right(local, first + l), guess(local, first + l));
                    for c in 0..3 {
                        group.right[local][c][l] = b[c];
                        group.answer[local][c][l] = x[c];
                        any |= b[c] != 0.0;
                    }
                }
            }
            if any {
                group.assemble(rows, ridge as f32);
                iterate(group, rows, iterations);
            } else {
                group.answer.fill(ZERO3);
            }
        });
    }

    /// Force of the last solve on one particle of a guide that takes part, dyn.
    #[inline]
    pub(crate) fn answer(&self, local: usize, particle: usize) -> [f32; 3] {
        let of = &self.groups[particle / WIDTH].answer[local];
        std::array::from_fn(|c| of[c][particle % WIDTH])
    }
}

impl Rows {
    fn gather(&mut self, matrix: &NormalMatrix, involved: &[u16], place: &[u16], idle: f32) {
        self.start.clear();
        self.start.push(0);
        self.column.clear();
        self.at_knots.clear();
        self.at_knots.extend(involved.iter().map(|&g| matrix.entry(usize::from(g), idle)));
        for &guide in involved {
            for (above, entry) in matrix.above(usize::from(guide)) {
                let local = place[above];
                if involved.get(usize::from(local)).is_some_and(|&g| usize::from(g) == above) {
                    self.column.push(local);
                    self.at_knots.push(matrix.entry(entry, idle));
                }
            }
            self.start.push(self.column.len() as u32);
        }
    }
}

/// Weights of the four knots around each of eight particle indices: the cubic through them.
/// Particle indices past the tip repeat it.
fn stencil(n_particles: usize, first: usize) -> [Lanes; KNOTS] {
    let mut weights = [[0.0; WIDTH]; KNOTS];
    for l in 0..WIDTH {
        let i = (first + l).min(n_particles - 1);
        let at = i as f64 / (n_particles - 1) as f64 * (KNOTS - 1) as f64;
        let from = (at.floor() as usize).clamp(1, KNOTS - 3) - 1;
        for k in from..from + 4 {
            let others = (from..from + 4).filter(|&j| j != k);
            weights[k][l] = others.map(|j| (at - j as f64) / (k as f64 - j as f64)).product::<f64>() as f32;
        }
    }
    weights
}

impl Group {
    /// The matrix at this group's particle indices, with a ridge, since it is rank deficient where no hair depends on a guide.
    fn assemble(&mut self, rows: &Rows, ridge: f32) {
        let n = self.right.len();
        self.matrix.clear();
        self.matrix.resize(rows.at_knots.len(), [0.0; WIDTH]);
        blend_knots(&self.stencil, self.knots.clone(), &rows.at_knots, &mut self.matrix);
        let mut added = [0.0; WIDTH];
        for diagonal in &self.matrix[..n] {
            for l in 0..WIDTH {
                added[l] += diagonal[l];
            }
        }
        for x in &mut added {
            *x = (*x * ridge / n as f32).max(0.0) + LEAST_RIDGE;
        }
        self.inverse_diagonal.clear();
        for diagonal in &mut self.matrix[..n] {
            for l in 0..WIDTH {
                // Between knots the cubic may pass below zero where a weight is clamped.
                diagonal[l] = diagonal[l].max(0.0) + added[l];
            }
            self.inverse_diagonal.push(diagonal.map(|d| 1.0 / d));
        }
    }
}

#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn blend_knots(stencil: &[Lanes; KNOTS], knots: std::ops::Range<usize>, at_knots: &[[f32; KNOTS]], out: &mut [Lanes]) {
    for (values, out) in at_knots.iter().zip(out) {
        for k in knots.clone() {
            for l in 0..WIDTH {
                out[l] = stencil[k][l].mul_add(values[k], out[l]);
            }
        }
    }
}

/// Conjugate gradients, preconditioned by the diagonal; each component of each lane goes its own way.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn iterate(group: &mut Group, rows: &Rows, iterations: u32) {
    let n = group.right.len();
    let Group { matrix, inverse_diagonal, right, answer, residual, direction, product, .. } = group;
    product.clear();
    product.resize(n, ZERO3);
    multiply(rows, matrix, answer, product);
    residual.clear();
    direction.clear();
    let mut energy = ZERO3;
    for g in 0..n {
        let mut r = ZERO3;
        let mut z = ZERO3;
        for c in 0..3 {
            for l in 0..WIDTH {
                r[c][l] = right[g][c][l] - product[g][c][l];
                z[c][l] = r[c][l] * inverse_diagonal[g][l];
                energy[c][l] = r[c][l].mul_add(z[c][l], energy[c][l]);
            }
        }
        residual.push(r);
        direction.push(z);
    }
    for _ in 0..iterations {
        multiply(rows, matrix, direction, product);
        let mut curvature = ZERO3;
        for g in 0..n {
            for c in 0..3 {
                for l in 0..WIDTH {
                    curvature[c][l] = direction[g][c][l].mul_add(product[g][c][l], curvature[c][l]);
                }
            }
        }
        let mut along = ZERO3;
        for c in 0..3 {
            for l in 0..WIDTH {
                // A lane at its answer, or where rounding left no curvature, stays where it is.
                along[c][l] = if curvature[c][l] > 0.0 { energy[c][l] / curvature[c][l] } else { 0.0 };
            }
        }
        let mut left = ZERO3;
        for g in 0..n {
            for c in 0..3 {
                for l in 0..WIDTH {
                    answer[g][c][l] = along[c][l].mul_add(direction[g][c][l], answer[g][c][l]);
                    let r = (-along[c][l]).mul_add(product[g][c][l], residual[g][c][l]);
                    residual[g][c][l] = r;
                    left[c][l] = (r * inverse_diagonal[g][l]).mul_add(r, left[c][l]);
                }
            }
        }
        let mut carry = ZERO3;
        for c in 0..3 {
            for l in 0..WIDTH {
                carry[c][l] = if energy[c][l] > 0.0 { left[c][l] / energy[c][l] } else { 0.0 };
            }
        }
        energy = left;
        for g in 0..n {
            for c in 0..3 {
                for l in 0..WIDTH {
                    direction[g][c][l] =
                        carry[c][l].mul_add(direction[g][c][l], residual[g][c][l] * inverse_diagonal[g][l]);
                }
            }
        }
    }
}

/// `out` = matrix times `x`, from its upper part.
#[inline(always)]
fn multiply(rows: &Rows, matrix: &[Lanes], x: &[Lanes3], out: &mut [Lanes3]) {
    let n = x.len();
    for g in 0..n {
        for c in 0..3 {
            for l in 0..WIDTH {
                out[g][c][l] = matrix[g][l] * x[g][c][l];
            }
        }
    }
    for row in 0..n {
        let of = rows.start[row] as usize..rows.start[row + 1] as usize;
        let own = x[row];
        let mut sum = out[row];
        for (&column, m) in rows.column[of.clone()].iter().zip(&matrix[n + of.start..n + of.end]) {
            let (theirs, to) = (&x[usize::from(column)], &mut out[usize::from(column)]);
            for c in 0..3 {
                for l in 0..WIDTH {
                    sum[c][l] = m[l].mul_add(theirs[c][l], sum[c][l]);
                    to[c][l] = m[l].mul_add(own[c][l], to[c][l]);
                }
            }
        }
        out[row] = sum;
    }
}
