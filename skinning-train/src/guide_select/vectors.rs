//! Products and sums of many vectors of one length, stored one after the other.
//!
//! Matrix products are of blocks of fixed size, each on one thread, and sums have a fixed order: the bytes do not depend on
//! the number of threads.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use multiversion::multiversion;
use rayon::prelude::*;

/// Vectors in a block of a matrix product.
const VECTORS_AT_ONCE: usize = 32;

/// All products of the vectors in `a` with those in `b`, b-major.
pub(crate) fn products(a: &[f64], b: &[f64], rank: usize) -> Vec<f64> {
    let (n_a, n_b) = (a.len() / rank, b.len() / rank);
    let mut out = vec![0.0; n_a * n_b];
    out.par_chunks_mut(n_a * VECTORS_AT_ONCE)
        .zip(b.par_chunks(rank * VECTORS_AT_ONCE))
        .for_each(|(out, b)| multiply(out, a, b, rank));
    out
}

/// Products of the vectors in `a` with those in `b`, b-major, on this thread.
pub(crate) fn multiply(out: &mut [f64], a: &[f64], b: &[f64], rank: usize) {
    let (n_a, n_b) = (a.len() / rank, b.len() / rank);
    matmul(
        MatMut::from_column_major_slice_mut(out, n_a, n_b),
        Accum::Replace,
        MatRef::from_column_major_slice(a, rank, n_a).transpose(),
        MatRef::from_column_major_slice(b, rank, n_b),
        1.0,
        Par::Seq,
    );
}

/// Sums of all atoms, one for each row of `shares`.
pub(crate) fn combine(out: &mut [f64], atoms: &[f64], shares: &[f64], rank: usize) {
    let n = atoms.len() / rank;
    let n_sums = shares.len() / n;
    matmul(
        MatMut::from_column_major_slice_mut(out, rank, n_sums),
        Accum::Replace,
        MatRef::from_column_major_slice(atoms, rank, n),
        MatRef::from_column_major_slice(shares, n, n_sums),
        1.0,
        Par::Seq,
    );
}

/// The vector scaled to length 1; unchanged when it has none.
pub(crate) fn unit(v: &[f64]) -> Vec<f64> {
    let length = dot(v, v).sqrt();
    if length > 0.0 { v.iter().map(|x| x / length).collect() } else { v.to_vec() }
}

/// Sixteen sums side by side: one would wait for itself at every term.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    const SUMS: usize = 16;
    let mut sums = [0.0; SUMS];
    let (a_whole, a_rest) = a.as_chunks::<SUMS>();
    let (b_whole, b_rest) = b.as_chunks::<SUMS>();
    for (x, y) in a_whole.iter().zip(b_whole) {
        for lane in 0..SUMS {
            sums[lane] += x[lane] * y[lane];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(x, y)| x * y).sum();
    let mut n = SUMS;
    while n > 1 {
        n /= 2;
        for lane in 0..n {
            sums[lane] += sums[lane + n];
        }
    }
    sums[0] + rest
}

#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
pub(crate) fn add_scaled(out: &mut [f64], scale: f64, v: &[f64]) {
    for (x, y) in out.iter_mut().zip(v) {
        *x += scale * y;
    }
}
