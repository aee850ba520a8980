//! Symmetric positive definite block-banded systems, one per lane, by Cholesky factorisation without pivoting.
//!
//! Every force of MS08 §4.1 joins particles at most four places apart, so a strand's implicit matrix has at most four 3×3
//! blocks left of the diagonal and its factor fills nothing else: the direct solve is linear in the strand's length and
//! needs no tolerance. Working in blocks keeps nine independent sums in registers; entry by entry the same factorisation
//! waits on one sum at a time and takes four times as long.

use crate::lanes::{LANES, Lane, ZERO, inv_sqrt_of};

/// A 3×3 block in every lane, row-major.
pub type Block = [Lane; 9];

const ZERO_BLOCK: Block = [ZERO; 9];

/// A block-banded matrix for each lane, and after [`BandedMatrix::factor`] its Cholesky factor.
#[derive(Clone, Debug)]
pub struct BandedMatrix {
    n_blocks: usize,
    reach: usize,
    /// Block row by block row, `reach + 1` blocks each: block columns `row - reach ..= row`. Blocks left of column 0
    /// stay zero; of a diagonal block only the lower triangle is used.
    band: Vec<Block>,
}

impl BandedMatrix {
    /// `n_blocks` × `n_blocks` blocks of zeros, `reach` of them left of the diagonal.
    #[must_use]
    pub fn new(n_blocks: usize, reach: usize) -> Self {
        Self { n_blocks, reach, band: vec![ZERO_BLOCK; n_blocks * (reach + 1)] }
    }

    /// Block rows.
    #[must_use]
    pub fn n_blocks(&self) -> usize {
        self.n_blocks
    }

    /// Gives the matrix another size, reusing its memory; entries are left as they are.
    pub fn resize(&mut self, n_blocks: usize, reach: usize) {
        (self.n_blocks, self.reach) = (n_blocks, reach);
        self.band.resize(n_blocks * (reach + 1), ZERO_BLOCK);
    }

    /// Sets every entry to zero.
    pub fn clear(&mut self) {
        self.band.fill(ZERO_BLOCK);
    }

    /// Sets the entries of one block row to zero.
    #[inline(always)]
    pub fn clear_row(&mut self, row: usize) {
        let width = self.reach + 1;
        self.band[row * width..(row + 1) * width].fill(ZERO_BLOCK);
    }

    /// Block columns left of the diagonal that a row may have.
    #[must_use]
    pub fn reach(&self) -> usize {
        self.reach
    }

    /// The block at `row >= col`, `row - col <= reach`.
    #[inline(always)]
    pub fn block(&mut self, row: usize, col: usize) -> &mut Block {
        &mut self.band[row * (self.reach + 1) + self.reach + col - row]
    }

    /// Replaces the matrix by its lower Cholesky factor, diagonal entries stored inverted. A pivot that is not positive
    /// (only possible where the matrix was not finite or not definite) is replaced by minus one: the lane's result is
    /// then wrong but finite, and the caller's check of the state isolates it.
    #[inline(always)]
    pub fn factor(&mut self) {
        for row in 0..self.n_blocks {
            self.factor_row(row);
        }
    }

    /// Factors one block row; the rows before it are factored.
    #[inline(always)]
    pub fn factor_row(&mut self, row: usize) {
        let width = self.reach + 1;
        let first = row.saturating_sub(self.reach);
        let (above, here) = self.band.split_at_mut(row * width);
        // Block column c of this row sits at slot `c + reach - row`, of block row j at `c + reach - j`.
        for col in first..row {
            let other = &above[col * width..(col + 1) * width];
            let slot = col + self.reach - row;
            let mut acc = here[slot];
            for k in first..col {
                subtract_product(&mut acc, &here[k + self.reach - row], &other[k + self.reach - col]);
            }
            divide_by_lower(&mut acc, &other[self.reach]);
            here[slot] = acc;
        }
        let mut acc = here[self.reach];
        for k in first..row {
            subtract_square(&mut acc, &here[k + self.reach - row]);
        }
        factor_block(&mut acc);
        here[self.reach] = acc;
    }

    /// Whether a lane's matrix, factored, was positive definite.
    #[must_use]
    pub fn is_definite(&self, lane: usize) -> bool {
        let diagonal = self.band.chunks_exact(self.reach + 1).take(self.n_blocks).map(|row| &row[self.reach]);
        diagonal.flat_map(|d| [d[0][lane], d[4][lane], d[8][lane]]).all(|inverse_root| inverse_root > 0.0)
    }

    /// Solves with the factor, in place; `rhs` holds three lanes a block row.
    #[inline(always)]
    pub fn solve(&self, rhs: &mut [Lane]) {
        for row in 0..self.n_blocks {
            self.solve_forward_row(row, rhs);
        }
        self.solve_back(rhs);
    }

    /// Forward substitution of one block row; those before it are done.
    #[inline(always)]
    pub fn solve_forward_row(&self, row: usize, rhs: &mut [Lane]) {
        let width = self.reach + 1;
        let mut acc = [rhs[3 * row], rhs[3 * row + 1], rhs[3 * row + 2]];
        for col in row.saturating_sub(self.reach)..row {
            let block = &self.band[row * width + col + self.reach - row];
            for p in 0..3 {
                for q in 0..3 {
                    for l in 0..LANES {
                        acc[p][l] = (-block[3 * p + q][l]).mul_add(rhs[3 * col + q][l], acc[p][l]);
                    }
                }
            }
        }
        let d = &self.band[row * width + self.reach];
        for l in 0..LANES {
            let x = acc[0][l] * d[0][l];
            let y = (-d[3][l]).mul_add(x, acc[1][l]) * d[4][l];
            let z = (-d[7][l]).mul_add(y, (-d[6][l]).mul_add(x, acc[2][l])) * d[8][l];
            (rhs[3 * row][l], rhs[3 * row + 1][l], rhs[3 * row + 2][l]) = (x, y, z);
        }
    }

    /// Back substitution of all rows.
    #[inline(always)]
    pub fn solve_back(&self, rhs: &mut [Lane]) {
        let width = self.reach + 1;
        for row in (0..self.n_blocks).rev() {
            let d = &self.band[row * width + self.reach];
            for l in 0..LANES {
                let z = rhs[3 * row + 2][l] * d[8][l];
                let y = (-d[7][l]).mul_add(z, rhs[3 * row + 1][l]) * d[4][l];
                let x = (-d[3][l]).mul_add(y, (-d[6][l]).mul_add(z, rhs[3 * row][l])) * d[0][l];
                (rhs[3 * row][l], rhs[3 * row + 1][l], rhs[3 * row + 2][l]) = (x, y, z);
            }
            for col in row.saturating_sub(self.reach)..row {
                let block = &self.band[row * width + col + self.reach - row];
                for q in 0..3 {
                    for p in 0..3 {
                        for l in 0..LANES {
                            rhs[3 * col + q][l] =
                                (-block[3 * p + q][l]).mul_add(rhs[3 * row + p][l], rhs[3 * col + q][l]);
                        }
                    }
                }
            }
        }
    }
}

/// `acc -= a bᵀ`.
#[inline(always)]
fn subtract_product(acc: &mut Block, a: &Block, b: &Block) {
    for p in 0..3 {
        for q in 0..3 {
            for k in 0..3 {
                for l in 0..LANES {
                    acc[3 * p + q][l] = (-a[3 * p + k][l]).mul_add(b[3 * q + k][l], acc[3 * p + q][l]);
                }
            }
        }
    }
}

/// `acc -= a aᵀ`, lower triangle only.
#[inline(always)]
fn subtract_square(acc: &mut Block, a: &Block) {
    for p in 0..3 {
        for q in 0..=p {
            for k in 0..3 {
                for l in 0..LANES {
                    acc[3 * p + q][l] = (-a[3 * p + k][l]).mul_add(a[3 * q + k][l], acc[3 * p + q][l]);
                }
            }
        }
    }
}

/// `x ← x L⁻ᵀ` for a factored diagonal block L.
#[inline(always)]
fn divide_by_lower(x: &mut Block, lower: &Block) {
    for p in 0..3 {
        for l in 0..LANES {
            let a = x[3 * p][l] * lower[0][l];
            let b = (-a).mul_add(lower[3][l], x[3 * p + 1][l]) * lower[4][l];
            let c = (-b).mul_add(lower[7][l], (-a).mul_add(lower[6][l], x[3 * p + 2][l])) * lower[8][l];
            (x[3 * p][l], x[3 * p + 1][l], x[3 * p + 2][l]) = (a, b, c);
        }
    }
}

/// Cholesky factor of a diagonal block's lower triangle, diagonal inverted.
#[inline(always)]
fn factor_block(d: &mut Block) {
    for l in 0..LANES {
        d[0][l] = inverse_root(d[0][l]);
        d[3][l] *= d[0][l];
        d[6][l] *= d[0][l];
        d[4][l] = inverse_root((-d[3][l]).mul_add(d[3][l], d[4][l]));
        d[7][l] = (-d[6][l]).mul_add(d[3][l], d[7][l]) * d[4][l];
        d[8][l] = inverse_root((-d[7][l]).mul_add(d[7][l], (-d[6][l]).mul_add(d[6][l], d[8][l])));
    }
}

#[inline(always)]
fn inverse_root(pivot: f64) -> f64 {
    if pivot > 0.0 { inv_sqrt_of(pivot) } else { -1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    /// Relative difference accepted between two direct solvers on systems of condition below 1e4.
    const SOLVER_AGREEMENT: f64 = 1e-11;

    fn pseudo_random(seed: &mut u64) -> f64 {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((*seed >> 11) as f64) / ((1_u64 << 53) as f64) - 0.5
    }

    #[test]
    fn the_banded_solve_agrees_with_a_dense_one_in_every_lane() {
        for (n_blocks, reach) in [(1, 4), (3, 4), (22, 3), (46, 4)] {
            let (n, mut seed) = (3 * n_blocks, 7);
            let mut banded = BandedMatrix::new(n_blocks, reach);
            let mut dense = vec![DMatrix::<f64>::zeros(n, n); LANES];
            for row in 0..n {
                for col in 3 * (row / 3).saturating_sub(reach)..=row {
                    for lane in 0..LANES {
                        let value = pseudo_random(&mut seed) + if row == col { 16.0 } else { 0.0 };
                        banded.block(row / 3, col / 3)[3 * (row % 3) + col % 3][lane] = value;
                        dense[lane][(row, col)] = value;
                        dense[lane][(col, row)] = value;
                    }
                }
            }
            let mut x: Vec<Lane> = (0..n).map(|_| std::array::from_fn(|_| pseudo_random(&mut seed))).collect();
            let rhs = x.clone();
            banded.factor();
            banded.solve(&mut x);
            for lane in 0..LANES {
                let b = DVector::from_iterator(n, rhs.iter().map(|v| v[lane]));
                let expected = dense[lane].clone().cholesky().expect("diagonally dominant").solve(&b);
                for row in 0..n {
                    assert!((x[row][lane] - expected[row]).abs() < SOLVER_AGREEMENT * expected.amax());
                }
            }
        }
    }
}
