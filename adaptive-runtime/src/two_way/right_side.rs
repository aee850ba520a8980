//! The right side of AS16 Eq. (4): what contacts on hairs add up to on each particle of their guides, Σ w I.
//!
//! Points are cut into a few runs by their number alone, summed run by run in parallel, and the runs in order: the same
//! points give the same bytes for any number of threads.

use super::ContactPoint;
use crate::interpolate::ActiveSet;
use io_formats::skinning_model::MAX_ELIGIBLE;
use multiversion::multiversion;
use rayon::prelude::*;

/// Points below which a run is not worth the clearing of its sums.
const POINTS_PER_RUN: usize = 4096;

/// Most runs.
const MAX_RUNS: usize = 4;

/// Values of two particles: x, y, z and one that pads.
const PAIR: usize = 8;

#[derive(Debug)]
pub(crate) struct RightSide {
    n_particles: usize,
    stride: usize,
    runs: Vec<Run>,
    used: usize,
}

#[derive(Debug)]
struct Run {
    /// Guide-major, dyn: `stride` values a guide, [`PAIR`] for two particles.
    sums: Vec<f32>,
    /// The same for the strand at hand, zero between strands.
    forces: Vec<f32>,
    /// Guides some hair in contact depends on; the sums of the others are zero.
    touched: Vec<bool>,
}

impl RightSide {
    pub(crate) fn new(n_guides: usize, n_particles: usize) -> Self {
        let stride = n_particles.div_ceil(2) * PAIR;
        let run =
            || Run { sums: vec![0.0; n_guides * stride], forces: vec![0.0; stride], touched: vec![false; n_guides] };
        Self { n_particles, stride, runs: (0..MAX_RUNS).map(|_| run()).collect(), used: 0 }
    }

    /// Sums points, sorted by strand. A force that is not finite counts as none.
    pub(crate) fn gather<'s>(&mut self, contacts: &[ContactPoint], set_of: &(impl Fn(usize) -> &'s ActiveSet + Sync)) {
        self.used = contacts.len().div_ceil(POINTS_PER_RUN).min(MAX_RUNS);
        if self.used == 0 {
            return;
        }
        let (length, n, stride) = (contacts.len().div_ceil(self.used), self.n_particles, self.stride);
        self.used = contacts.len().div_ceil(length);
        self.runs[..self.used].par_iter_mut().zip(contacts.par_chunks(length)).for_each(|(run, points)| {
            for (sums, touched) in run.sums.chunks_mut(stride).zip(&mut run.touched) {
                if std::mem::take(touched) {
                    sums.fill(0.0);
                }
            }
            for points in points.chunk_by(|a, b| a.strand == b.strand) {
                let set = set_of(points[0].strand as usize);
                for &guide in &set.guides[..usize::from(set.n)] {
                    run.touched[usize::from(guide)] = true;
                }
                add_points(points, set, n, &mut run.forces, &mut run.sums);
            }
        });
        let (first, others) = self.runs.split_at_mut(1);
        let first = &mut first[0];
        for run in &others[..self.used - 1] {
            for (guide, _) in run.touched.iter().enumerate().filter(|(_, touched)| **touched) {
                first.touched[guide] = true;
                let of = guide * stride..(guide + 1) * stride;
                for (sum, more) in first.sums[of.clone()].iter_mut().zip(&run.sums[of]) {
                    *sum += more;
                }
            }
        }
    }

    /// Lists the guides that some hair in contact depends on, ascending.
    pub(crate) fn involved(&self, out: &mut Vec<u16>) {
        out.clear();
        if self.used > 0 {
            let touched = self.runs[0].touched.iter().enumerate().filter(|(_, touched)| **touched);
            out.extend(touched.map(|(guide, _)| guide as u16));
        }
    }

    /// Σ w I at one particle of a guide, dyn.
    #[inline]
    pub(crate) fn at(&self, guide: usize, particle: usize) -> [f32; 3] {
        let at = guide * self.stride + 4 * particle;
        let of: &[f32] = &self.runs[0].sums[at..at + 3];
        [of[0], of[1], of[2]]
    }
}

/// Adds the points of one strand, two particles of four values to a vector. `forces` is zero before and after.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn add_points(points: &[ContactPoint], set: &ActiveSet, n_particles: usize, forces: &mut [f32], sums: &mut [f32]) {
    let (mut first, mut last) = (usize::MAX, 0);
    for point in points.iter().filter(|p| p.is_finite()) {
        let i = usize::from(point.segment);
        (first, last) = (first.min(i / 2), last.max(i.div_ceil(2)));
        let ([x, y, z], s, t) = (point.force, point.s, 1.0 - point.s);
        let more = [t * x, t * y, t * z, 0.0, s * x, s * y, s * z, 0.0];
        let to: &mut [f32] = &mut forces[4 * i..4 * i + PAIR];
        for l in 0..PAIR {
            to[l] += more[l];
        }
    }
    if first > last {
        return;
    }
    let (n, stride, step) = (usize::from(set.n), forces.len(), 1.0 / (n_particles - 1) as f32);
    for pair in first..=last {
        let (near, far) = ((2 * pair) as f32 * step, ((2 * pair + 1) as f32 * step).min(1.0));
        let u = [near, near, near, near, far, far, far, far];
        let mut weights = [[0.0_f32; PAIR]; MAX_ELIGIBLE];
        let mut total = [0.0_f32; PAIR];
        for (w, poly) in weights.iter_mut().zip(&set.weights[..n]) {
            for l in 0..PAIR {
                w[l] = ((poly.quad * u[l] + poly.lin) * u[l] + poly.con).max(0.0);
                total[l] += w[l];
            }
        }
        let from: &mut [f32] = &mut forces[pair * PAIR..(pair + 1) * PAIR];
        // As `ActiveSet::weights_at`: clamped weights are normalised, and all alike where none is left. Without a branch,
        // or lanes would be taken apart.
        let mut scaled = [0.0; PAIR];
        let mut alike = [0.0_f32; PAIR];
        for l in 0..PAIR {
            alike[l] = if total[l] > 0.0 { 0.0 } else { 1.0 };
            scaled[l] = from[l] / alike[l].mul_add(n as f32, total[l]);
            from[l] = 0.0;
        }
        for (w, &guide) in weights.iter().zip(&set.guides[..n]) {
            let at = usize::from(guide) * stride + pair * PAIR;
            let to: &mut [f32] = &mut sums[at..at + PAIR];
            for l in 0..PAIR {
                to[l] = (w[l] + alike[l]).mul_add(scaled[l], to[l]);
            }
        }
    }
}
