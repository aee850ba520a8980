//! Per strand and particle, the Gram matrix H = EᵀE of what single guides leave unexplained: the data of AS16 Eq. (7).
//!
//! Column g of E stacks B_g(i, f) s*_i - s_i(f) over all frames. Because weights sum to one, the objective of Eq. (7) is
//! wᵀ H w for every subset of the guides: one streaming pass over the frames serves all 2^k - 1 problems. Residuals are
//! formed before they are multiplied, which avoids the cancellation of expanding the square. Strands are independent and
//! frames come in order: same bytes for any number of threads.

use io_formats::{FrameSource, UniformGroom};
use multiversion::multiversion;
use rayon::prelude::*;

use crate::eligible::Eligible;
use crate::error::Result;
use crate::transforms::{FrameTransforms, NUMBERS};
use io_formats::guide_transform::Blend;

/// Frames are held in memory up to this many bytes, so that a strand's matrices are visited once for several frames.
const FRAME_BYTES: usize = 64 << 20;
/// More frames at a time gain nothing.
const MOST_FRAMES: usize = 16;

/// Gram matrices of one strand.
#[derive(Debug, Clone, PartialEq)]
pub struct StrandGram {
    /// Number of eligible guides, k.
    pub n_guides: usize,
    /// Particles.
    pub n_particles: usize,
    /// `k (k + 1) / 2 * n_particles` sums (cm²) over frames: for each pair of guides a <= b, in the order of
    /// [`pair_index`], one number per particle.
    pub values: Vec<f64>,
}

/// Where the pair a <= b of k guides is: pairs are ordered by a, then b.
#[must_use]
pub fn pair_index(k: usize, a: usize, b: usize) -> usize {
    a * (2 * k + 1 - a) / 2 + (b - a)
}

impl StrandGram {
    /// All zero.
    #[must_use]
    pub fn zeros(n_guides: usize, n_particles: usize) -> Self {
        Self { n_guides, n_particles, values: vec![0.0; n_guides * (n_guides + 1) / 2 * n_particles] }
    }

    /// The entry of guides `a` and `b`, in any order, at a particle (cm²).
    ///
    /// # Panics
    /// If there is no such guide or particle.
    #[must_use]
    pub fn at(&self, particle: usize, a: usize, b: usize) -> f64 {
        self.values[pair_index(self.n_guides, a.min(b), a.max(b)) * self.n_particles + particle]
    }
}

/// One thread's residuals.
#[derive(Default)]
struct Residuals {
    rest: Vec<f64>,
    moved: Vec<f64>,
    of_guides: Vec<f64>,
}

/// Accumulates the matrices of `strands` over all frames. `rest` holds s* of all strands (cm, head frame). `on_frame` hears
/// how many frames are done.
///
/// # Errors
/// When a frame cannot be read.
///
/// # Panics
/// If a strand or guide does not exist.
pub fn accumulate(
    frames: &dyn FrameSource,
    rest: &UniformGroom,
    guide_strands: &[u32],
    eligible: &Eligible,
    strands: &[u32],
    blend: Blend,
    on_frame: &mut dyn FnMut(u64),
) -> Result<Vec<StrandGram>> {
    let n = rest.n_particles;
    let n_points = rest.points.len();
    let at_once = (FRAME_BYTES / (n_points * 12)).clamp(1, MOST_FRAMES).min(frames.n_frames().max(1));
    let mut points = vec![vec![[0.0_f32; 3]; n_points]; at_once];
    let mut transforms = vec![FrameTransforms::default(); at_once];
    let mut grams: Vec<StrandGram> =
        strands.iter().map(|&s| StrandGram::zeros(eligible.of(s as usize).len(), n)).collect();
    for first in (0..frames.n_frames()).step_by(at_once) {
        let n_now = at_once.min(frames.n_frames() - first);
        for at in 0..n_now {
            frames.read(first + at, &mut points[at])?;
            transforms[at].fill(rest, guide_strands, &points[at], blend);
        }
        let (points, transforms) = (&points[..n_now], &transforms[..n_now]);
        grams.par_iter_mut().zip(strands).for_each_init(Residuals::default, |residuals, (gram, &strand)| {
            let strand = strand as usize;
            for (frame, transforms) in points.iter().zip(transforms) {
                let current = &frame[strand * n..(strand + 1) * n];
                residuals.fill(rest.strand(strand), current, eligible.of(strand), transforms);
                add_products(&mut gram.values, &residuals.of_guides, n);
            }
        });
        on_frame((first + n_now) as u64);
    }
    Ok(grams)
}

impl Residuals {
    /// Residuals (cm) of each guide alone: per guide three arrays over particles.
    fn fill(&mut self, rest: &[[f32; 3]], current: &[[f32; 3]], guides: &[u16], transforms: &FrameTransforms) {
        let n = rest.len();
        self.rest.resize(3 * n, 0.0);
        self.moved.resize(3 * n, 0.0);
        self.of_guides.resize(guides.len() * 3 * n, 0.0);
        for i in 0..n {
            for c in 0..3 {
                let x = f64::from(rest[i][c]);
                self.rest[c * n + i] = x;
                self.moved[c * n + i] = f64::from(current[i][c]) - x;
            }
        }
        for (out, &guide) in self.of_guides.chunks_exact_mut(3 * n).zip(guides) {
            add_residual(out, &self.rest, &self.moved, transforms.of_guide(usize::from(guide)), n);
        }
    }
}

/// out = linear * rest + offset - moved, three arrays over particles each.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn add_residual(out: &mut [f64], rest: &[f64], moved: &[f64], transform: &[f32], n: usize) {
    assert!(out.len() == 3 * n && rest.len() == 3 * n && moved.len() == 3 * n && transform.len() == NUMBERS * n);
    let (x, yz) = rest.split_at(n);
    let (y, z) = yz.split_at(n);
    for c in 0..3 {
        let row = &transform[3 * c * n..3 * (c + 1) * n];
        let (l0, l12) = row.split_at(n);
        let (l1, l2) = l12.split_at(n);
        let offset = &transform[(9 + c) * n..(10 + c) * n];
        let moved = &moved[c * n..(c + 1) * n];
        let out = &mut out[c * n..(c + 1) * n];
        for i in 0..n {
            out[i] = f64::from(l0[i]) * x[i] + f64::from(l1[i]) * y[i] + f64::from(l2[i]) * z[i] + f64::from(offset[i])
                - moved[i];
        }
    }
}

/// Adds the products of every pair of residuals, particle by particle.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn add_products(sums: &mut [f64], residuals: &[f64], n: usize) {
    let mut pairs = sums.chunks_exact_mut(n);
    let mut rest = residuals;
    while !rest.is_empty() {
        let (ax, ayz) = rest[..3 * n].split_at(n);
        let (ay, az) = ayz.split_at(n);
        for b in rest.chunks_exact(3 * n) {
            let (bx, byz) = b.split_at(n);
            let (by, bz) = byz.split_at(n);
            let Some(sum) = pairs.next() else { return };
            for i in 0..n {
                sum[i] += ax[i] * bx[i] + ay[i] * by[i] + az[i] * bz[i];
            }
        }
        rest = &rest[3 * n..];
    }
}

#[cfg(test)]
mod tests {
    use io_formats::guide_transform::{Blend, DisplacementTransform, guide_transforms};
    use io_formats::{FrameInfo, MemoryFrames};
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    /// Sums of about a hundred products of `f32` residuals of some cm.
    const ROUND_OFF: f64 = 1e-4;

    #[test]
    fn pairs_are_numbered_without_gaps() {
        for k in 1..=9 {
            let all: Vec<usize> = (0..k).flat_map(|a| (a..k).map(move |b| pair_index(k, a, b))).collect();
            assert_eq!(all, (0..k * (k + 1) / 2).collect::<Vec<_>>());
        }
    }

    #[test]
    fn the_matrix_is_the_sum_of_products_of_residuals() {
        const N: usize = 5;
        let mut rng = Pcg64Mcg::seed_from_u64(4);
        let mut shape = |from: Option<&[[f32; 3]]>| -> Vec<[f32; 3]> {
            (0..4 * N)
                .map(|at| {
                    let base = from.map_or([at as f32 * 0.3, (at % N) as f32, 1.0], |p| p[at]);
                    base.map(|x| x + rng.random_range(-0.2..0.2))
                })
                .collect()
        };
        let rest = UniformGroom { n_strands: 4, n_particles: N, points: shape(None) };
        let mut frames = MemoryFrames::new(4, N);
        let recorded: Vec<Vec<[f32; 3]>> = (0..20).map(|_| shape(Some(&rest.points))).collect();
        for (f, points) in recorded.iter().enumerate() {
            let info = FrameInfo { sequence: 0, time_s: f as f64 };
            frames.push(info, points).expect("the frame has the right number of points");
        }
        let guides = [0_usize, 2, 3];
        let eligible = Eligible { start: vec![0, 1, 4, 5, 6], guides: vec![0, 0, 1, 2, 1, 2] };
        let grams = accumulate(&frames, &rest, &guides.map(|g| g as u32), &eligible, &[1], Blend::Rigid, &mut |_| {})
            .expect("the frames can be read");
        let mut expected = [[[0.0_f64; 3]; 3]; N];
        for points in &recorded {
            let residuals: Vec<Vec<[f32; 3]>> = guides
                .iter()
                .map(|&g| {
                    let mut t = [DisplacementTransform::default(); N];
                    guide_transforms(rest.strand(g), &points[g * N..(g + 1) * N], Blend::Rigid, &mut t);
                    (0..N)
                        .map(|i| {
                            let p = t[i].apply(rest.strand(1)[i]);
                            [0, 1, 2].map(|c| p[c] - points[N + i][c])
                        })
                        .collect()
                })
                .collect();
            for i in 0..N {
                for a in 0..3 {
                    for b in 0..3 {
                        let (ra, rb) = (residuals[a][i], residuals[b][i]);
                        expected[i][a][b] += (0..3).map(|c| f64::from(ra[c]) * f64::from(rb[c])).sum::<f64>();
                    }
                }
            }
        }
        for i in 0..N {
            for a in 0..3 {
                for b in 0..3 {
                    let found = grams[0].at(i, a, b);
                    assert!((found - expected[i][a][b]).abs() < ROUND_OFF, "{found} {}", expected[i][a][b]);
                }
            }
        }
    }
}
