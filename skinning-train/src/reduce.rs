//! Motion signals of reduced dimension: the u_s of AS16 §6.3, projected by a randomised SVD with a stated error.
//!
//! The signal of a strand stacks its head-frame positions over all frames: positions as Eq. (9) says, not displacements
//! from rest, so strands of different shape differ even where they move alike. Tangents follow from positions and are not
//! stacked. Frames are streamed twice, a few at a time: once against a random matrix for the range of the signals, once
//! against an orthonormal basis of it. The basis keeps lengths and angles, so Eq. (9) and (10) are solved in it as they
//! are, up to the stated error. All signals share one factor that makes their mean squared length 1: the residual of
//! Eq. (9) is then a share of the mean energy of a signal, and β = 0.15 the price, in such shares, of a unit of code.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par, Side};
use io_formats::FrameSource;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Strands converted and multiplied at a time: a block of 25-particle strands stays within the second-level cache.
const BLOCK: usize = 256;

/// Signals in an orthonormal basis of reduced dimension.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Signals {
    /// Dimension.
    pub rank: usize,
    /// `n_strands * rank` coordinates, strand-major, scaled to mean squared length 1 before the projection.
    pub coords: Vec<f64>,
    /// What was multiplied onto positions (1/cm).
    pub scale: f64,
    /// Share of the signals' energy outside the basis: 1 - |projected|² / |all|², from exact norms.
    pub lost_energy: f64,
}

impl Signals {
    /// Number of signals.
    #[must_use]
    pub fn n_strands(&self) -> usize {
        self.coords.len() / self.rank
    }

    /// The signal of one strand, `rank` coordinates.
    ///
    /// # Panics
    /// If there is no such strand.
    #[must_use]
    pub fn of(&self, strand: usize) -> &[f64] {
        &self.coords[strand * self.rank..(strand + 1) * self.rank]
    }
}

impl Signals {
    /// The same signals in their own span: at most as many dimensions as signals, with all lengths and angles kept (the
    /// triangular factor of a QR decomposition). Eq. (9) and (10) are what they were, and cheaper where signals are longer than
    /// they are many. Atoms over it are not atoms over the original coordinates.
    #[must_use]
    pub fn in_own_span(&self) -> Self {
        let n = self.n_strands();
        if self.rank <= n {
            return self.clone();
        }
        faer::set_global_parallelism(Par::Seq);
        let tall = MatRef::from_column_major_slice(&self.coords, self.rank, n);
        let qr = tall.qr();
        let triangle = qr.thin_R();
        let coords = (0..n).flat_map(|s| (0..n).map(move |d| if d <= s { triangle[(d, s)] } else { 0.0 })).collect();
        Self { rank: n, coords, ..*self }
    }
}

/// Streams `frames` and returns all strands' signals in at most `rank` dimensions. `oversample` further dimensions sharpen
/// the basis before it is cut. `on_frame` hears of every frame read, of twice the number of frames.
///
/// # Errors
/// When a frame cannot be read or is not finite, there is no motion at all, or a decomposition fails.
pub fn reduce(
    frames: &dyn FrameSource,
    rank: usize,
    oversample: usize,
    seed: u64,
    on_frame: &mut dyn FnMut(u64),
) -> Result<Signals> {
    // Parallel over frames and strands here; a library that splits sums by thread would make the bytes depend on them.
    faer::set_global_parallelism(Par::Seq);
    let (n_strands, n_frames) = (frames.n_strands(), frames.n_frames());
    let rows = 3 * frames.n_particles();
    let width = (rank + oversample).min(n_strands).min(rows * n_frames);
    let rank = rank.min(width);

    let sketch = sketch(frames, &random_signs(n_strands, width, seed), width, on_frame)?;
    let total: f64 = sketch.iter().map(|(_, energy)| energy).sum();
    if total <= 0.0 {
        return Err(Error::NoDecomposition { what: "singular value decomposition" });
    }
    let stacked = Mat::from_fn(rows * n_frames, width, |r, c| sketch[r / rows].0[(r % rows, c)]);
    drop(sketch);
    let basis = stacked.qr().compute_thin_Q();
    drop(stacked);
    let mut coords = project(frames, basis.as_ref(), on_frame)?;
    drop(basis);

    let rotation = leading_directions(&coords, width, rank)?;
    let scale = (n_strands as f64 / total).sqrt();
    coords = coords.par_chunks(width).flat_map_iter(|c| rotated(&rotation, c, scale)).collect();
    let kept: f64 = coords.iter().map(|x| x * x).sum::<f64>() / n_strands as f64;
    Ok(Signals { rank, coords, scale, lost_energy: (1.0 - kept).max(0.0) })
}

/// `n_strands * width` entries of one and minus one, column-major by `width`.
fn random_signs(n_strands: usize, width: usize, seed: u64) -> Mat<f64> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    Mat::from_fn(n_strands, width, |_, _| if rng.random::<bool>() { 1.0 } else { -1.0 })
}

/// Per frame: its rows of the signal matrix times `signs`, and its energy (cm²).
fn sketch(
    frames: &dyn FrameSource,
    signs: &Mat<f64>,
    width: usize,
    on_frame: &mut dyn FnMut(u64),
) -> Result<Vec<(Mat<f64>, f64)>> {
    let (n_strands, n_frames) = (frames.n_strands(), frames.n_frames());
    let n_particles = frames.n_particles();
    let rows = 3 * n_particles;
    let at_once = rayon::current_num_threads().max(1) * 2;
    let mut all = Vec::with_capacity(n_frames);
    for first in (0..n_frames).step_by(at_once) {
        let last = (first + at_once).min(n_frames);
        let some: Vec<Result<(Mat<f64>, f64)>> = (first..last)
            .into_par_iter()
            .map(|f| {
                let mut frame = vec![[0.0_f32; 3]; n_strands * n_particles];
                frames.read(f, &mut frame)?;
                let mut product = Mat::zeros(rows, width);
                let mut energy = 0.0;
                let mut block = Vec::new();
                for start in (0..n_strands).step_by(BLOCK) {
                    let n = BLOCK.min(n_strands - start);
                    widen(&frame[start * n_particles..(start + n) * n_particles], &mut block);
                    let block_energy: f64 = block.iter().map(|x| x * x).sum();
                    if !block_energy.is_finite() {
                        return Err(first_non_finite(&frame, n_particles, f));
                    }
                    energy += block_energy;
                    matmul(
                        product.as_mut(),
                        Accum::Add,
                        MatRef::from_column_major_slice(&block, rows, n),
                        signs.as_ref().subrows(start, n),
                        1.0,
                        Par::Seq,
                    );
                }
                Ok((product, energy))
            })
            .collect();
        for one in some {
            all.push(one?);
            on_frame(all.len() as u64);
        }
    }
    Ok(all)
}

/// Coordinates of all signals in `basis` (`rows * n_frames` by width): strand-major, width numbers each.
fn project(frames: &dyn FrameSource, basis: MatRef<'_, f64>, on_frame: &mut dyn FnMut(u64)) -> Result<Vec<f64>> {
    let (n_strands, n_frames, n_particles) = (frames.n_strands(), frames.n_frames(), frames.n_particles());
    let (rows, width) = (3 * n_particles, basis.ncols());
    let mut coords = vec![0.0; n_strands * width];
    let mut frame = vec![[0.0_f32; 3]; n_strands * n_particles];
    for f in 0..n_frames {
        frames.read(f, &mut frame)?;
        let part = basis.subrows(f * rows, rows).transpose();
        coords.par_chunks_mut(width * BLOCK).zip(frame.par_chunks(n_particles * BLOCK)).for_each_init(
            Vec::new,
            |block, (coords, points)| {
                widen(points, block);
                let n = points.len() / n_particles;
                matmul(
                    MatMut::from_column_major_slice_mut(coords, width, n),
                    Accum::Add,
                    part,
                    MatRef::from_column_major_slice(block, rows, n),
                    1.0,
                    Par::Seq,
                );
            },
        );
        on_frame((n_frames + f + 1) as u64);
    }
    Ok(coords)
}

/// The `rank` directions of largest energy among `width` coordinates, direction-major.
fn leading_directions(coords: &[f64], width: usize, rank: usize) -> Result<Vec<f64>> {
    let signals = MatRef::from_column_major_slice(coords, width, coords.len() / width);
    let mut energy = Mat::<f64>::zeros(width, width);
    matmul(energy.as_mut(), Accum::Replace, signals, signals.transpose(), 1.0, Par::Seq);
    let eigen = energy
        .self_adjoint_eigen(Side::Lower)
        .map_err(|_| Error::NoDecomposition { what: "eigenvalue decomposition" })?;
    // Eigenvalues come in rising order.
    let vectors = eigen.U();
    Ok((0..rank).flat_map(|d| (0..width).map(move |r| vectors[(r, width - 1 - d)])).collect())
}

fn rotated(directions: &[f64], coords: &[f64], scale: f64) -> Vec<f64> {
    directions
        .chunks_exact(coords.len())
        .map(|d| scale * d.iter().zip(coords).map(|(a, b)| a * b).sum::<f64>())
        .collect()
}

fn widen(points: &[[f32; 3]], out: &mut Vec<f64>) {
    out.clear();
    out.extend(points.iter().flatten().map(|&x| f64::from(x)));
}

fn first_non_finite(frame: &[[f32; 3]], n_particles: usize, f: usize) -> Error {
    let point = frame.iter().position(|p| p.iter().any(|x| !x.is_finite())).unwrap_or(0);
    Error::NonFinite { what: format!("frame {f}"), strand: point / n_particles }
}

#[cfg(test)]
mod tests {
    use io_formats::{FrameInfo, MemoryFrames};

    use super::*;

    /// Of squared lengths near 1, from `f32` positions.
    const ROUND_OFF: f64 = 1e-6;

    /// Strands whose signals are mixtures of `n_modes` random ones.
    fn mixtures(n_strands: usize, n_particles: usize, n_frames: usize, n_modes: usize) -> MemoryFrames {
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let mut frames = MemoryFrames::new(n_strands, n_particles);
        let shares: Vec<f64> = (0..n_strands * n_modes).map(|_| rng.random_range(-1.0..1.0)).collect();
        for f in 0..n_frames {
            let modes: Vec<f64> = (0..n_modes * n_particles * 3).map(|_| rng.random_range(-9.0..9.0)).collect();
            let points: Vec<[f32; 3]> = (0..n_strands * n_particles)
                .map(|at| {
                    let (s, i) = (at / n_particles, at % n_particles);
                    [0, 1, 2].map(|c| {
                        let sum: f64 =
                            (0..n_modes).map(|m| shares[s * n_modes + m] * modes[(m * n_particles + i) * 3 + c]).sum();
                        sum as f32
                    })
                })
                .collect();
            let info = FrameInfo { sequence: 0, time_s: f as f64 * 0.02 };
            frames.push(info, &points).expect("the frame has the right number of points");
        }
        frames
    }

    fn distances(frames: &MemoryFrames) -> (Vec<f64>, f64) {
        let (n, p) = (frames.n_strands(), frames.n_particles());
        let mut squared = vec![0.0; n * n];
        let mut total = 0.0;
        let mut frame = vec![[0.0_f32; 3]; n * p];
        for f in 0..frames.n_frames() {
            frames.read(f, &mut frame).expect("the frame is there");
            total += frame.iter().flatten().map(|&x| f64::from(x).powi(2)).sum::<f64>();
            for a in 0..n {
                for b in 0..n {
                    for i in 0..p {
                        for c in 0..3 {
                            squared[a * n + b] += f64::from(frame[a * p + i][c] - frame[b * p + i][c]).powi(2);
                        }
                    }
                }
            }
        }
        (squared, total)
    }

    #[test]
    fn signals_of_low_rank_keep_all_their_distances() {
        let frames = mixtures(40, 5, 12, 6);
        let signals = reduce(&frames, 6, 4, 9, &mut |_| {}).expect("finite frames");
        assert!(signals.lost_energy < ROUND_OFF, "{}", signals.lost_energy);
        let (squared, total) = distances(&frames);
        let factor = 40.0 / total;
        for a in 0..40 {
            for b in 0..40 {
                let d: f64 = signals.of(a).iter().zip(signals.of(b)).map(|(x, y)| (x - y).powi(2)).sum();
                assert!((d - factor * squared[a * 40 + b]).abs() < ROUND_OFF, "strands {a}, {b}");
            }
        }
    }

    #[test]
    fn the_stated_loss_is_what_is_missing_and_falls_with_the_rank() {
        let frames = mixtures(60, 5, 10, 12);
        let mut last = 1.0;
        for rank in [1, 3, 6, 12] {
            let signals = reduce(&frames, rank, 8, 2, &mut |_| {}).expect("finite frames");
            let kept: f64 = signals.coords.iter().map(|x| x * x).sum::<f64>() / 60.0;
            assert!((1.0 - kept - signals.lost_energy).abs() < ROUND_OFF);
            assert!(signals.lost_energy <= last + ROUND_OFF);
            last = signals.lost_energy;
        }
        assert!(last < ROUND_OFF, "twelve mixed modes need no more than twelve dimensions");
    }

    #[test]
    fn long_signals_keep_their_products_in_their_own_span() {
        let mut rng = Pcg64Mcg::seed_from_u64(13);
        let coords = (0..5 * 70).map(|_| rng.random_range(-1.0..1.0)).collect();
        let long = Signals { rank: 70, coords, scale: 1.0, lost_energy: 0.0 };
        let short = long.in_own_span();
        assert_eq!((short.rank, short.n_strands()), (5, 5));
        let product =
            |s: &Signals, a: usize, b: usize| -> f64 { s.of(a).iter().zip(s.of(b)).map(|(x, y)| x * y).sum() };
        for a in 0..5 {
            for b in 0..5 {
                assert!((product(&long, a, b) - product(&short, a, b)).abs() < 1e-12, "signals {a}, {b}");
            }
        }
        assert_eq!(short.in_own_span(), short);
    }

    #[test]
    fn a_position_that_is_not_a_number_is_named() {
        let mut frames = mixtures(4, 3, 2, 2);
        let mut points = vec![[0.5_f32; 3]; 12];
        points[7] = [0.0, f32::NAN, 0.0];
        frames.push(FrameInfo { sequence: 0, time_s: 1.0 }, &points).expect("the frame has the right number of points");
        match reduce(&frames, 2, 2, 1, &mut |_| {}) {
            Err(Error::NonFinite { what, strand }) => assert_eq!((what.as_str(), strand), ("frame 2", 2)),
            other => panic!("{other:?}"),
        }
    }
}
