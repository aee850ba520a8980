//! All strands at once: (A + C) v = b, where A is what each strand's own springs make of it and C the links between them.
//!
//! A is block diagonal and factored already; C is a sum of the rank-one springs of MS08 §4.1. Conjugate gradients with A
//! as the preconditioner never multiply by A: z = A⁻¹ r is asked for, and A z = r is then known, so A p follows by the
//! recurrence of p. Without links one solve is the answer; with them the iterations grow with the links' stiffness
//! relative to A, not with A's own condition. Invariant: sums run in fixed pieces, hence the same bits for any number of
//! threads; nothing is allocated once warm.

use nalgebra::Vector3;
use rayon::prelude::*;

/// Unknowns or links handled as one piece; fixed, so that sums do not depend on the thread count.
const CHUNK: usize = 2048;

/// Index of a particle that is no unknown: its prescribed velocity is the caller's business on the right side.
pub const NO_UNKNOWN: u32 = u32::MAX;

/// A link: it adds `coefficient` (w⊗d)(w⊗d)ᵀ to the matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RankOne {
    /// Unknowns it joins, [`NO_UNKNOWN`] where a particle is prescribed.
    pub unknowns: [u32; 4],
    /// Weight w of each.
    pub weights: [f64; 4],
    /// Unit direction d.
    pub direction: Vector3<f64>,
    /// Impulse per relative velocity, g; not negative.
    pub coefficient: f64,
}

impl RankOne {
    /// d · Σ w v.
    #[inline(always)]
    fn measure(&self, v: &[Vector3<f64>]) -> f64 {
        let mut sum = Vector3::zeros();
        for k in 0..4 {
            if self.unknowns[k] != NO_UNKNOWN {
                sum += v[self.unknowns[k] as usize] * self.weights[k];
            }
        }
        self.direction.dot(&sum)
    }
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoupledParams {
    /// Residual accepted, relative to the right side, both in the norm of A⁻¹.
    pub relative_tolerance: f64,
    /// Preconditioner solves at most, the first one included.
    pub max_iterations: usize,
}

impl CoupledParams {
    /// A millionth, at most 100 solves.
    #[must_use]
    pub fn standard() -> Self {
        Self { relative_tolerance: 1e-6, max_iterations: 100 }
    }
}

/// How a solve ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CoupledStatus {
    /// The tolerance was met.
    Converged,
    /// The iterations ran out; the best so far is in `v`.
    IterationLimit,
    /// A sum was not finite or not positive; `v` holds what was reached before it, or zero if there was nothing.
    Breakdown,
}

/// What a solve did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoupledReport {
    /// How it ended.
    pub status: CoupledStatus,
    /// Preconditioner solves done.
    pub iterations: usize,
    /// Residual reached, relative to the right side, in the norm of A⁻¹.
    pub relative_residual: f64,
}

/// Buffers of a solve, kept from step to step.
#[derive(Clone, Debug, Default)]
pub struct CoupledWorkspace {
    residual: Vec<Vector3<f64>>,
    solved: Vec<Vector3<f64>>,
    search: Vec<Vector3<f64>>,
    /// A times the search direction, by recurrence.
    a_search: Vec<Vector3<f64>>,
    /// What the links pull with, given the vector measured last: coefficient · d · Σ w v, one per link.
    pull: Vec<f64>,
    /// First entry in `ends` of each unknown; one more than there are unknowns.
    first_end: Vec<u32>,
    /// The link ends on each unknown, as 4 · link + place, ascending.
    ends: Vec<u32>,
    /// Sums over pieces.
    partial: Vec<[f64; 2]>,
}

/// Solves (A + C) v = b. `precondition(r, z)` writes A⁻¹ r to z; the links and `b` count unknowns as it does.
/// On entry `v` is a guess, such as the last step's velocities, or zero: it may save iterations and never spoils them.
///
/// # Panics
/// If `v` and `b` differ in length.
pub fn solve_coupled(
    links: &[RankOne],
    b: &[Vector3<f64>],
    v: &mut [Vector3<f64>],
    mut precondition: impl FnMut(&[Vector3<f64>], &mut [Vector3<f64>]),
    params: &CoupledParams,
    workspace: &mut CoupledWorkspace,
) -> CoupledReport {
    assert_eq!(b.len(), v.len(), "one unknown per entry of the right side");
    let w = workspace;
    w.index(links, b.len());
    // A of the guess is unknown, but A⁻¹ of what its links pull is a direction whose image under A is known. With the
    // right guess its end is the answer; a search along it cannot make a wrong one worse than none.
    let has_guess = w.measure(links, v);
    if has_guess {
        pulled(links, &w.pull, &w.first_end, &w.ends, &mut w.a_search);
    }
    precondition(b, v);
    let mut iterations = 1;
    let scale = dot(&mut w.partial, b, v, b, v)[0];
    let report = |status, iterations, rz: f64| {
        let relative_residual = if scale > 0.0 { (rz.max(0.0) / scale).sqrt() } else { 0.0 };
        CoupledReport { status, iterations, relative_residual }
    };
    if !(scale >= 0.0 && scale.is_finite()) {
        v.fill(Vector3::zeros());
        return report(CoupledStatus::Breakdown, iterations, f64::INFINITY);
    }
    if links.is_empty() || scale == 0.0 {
        return report(CoupledStatus::Converged, iterations, 0.0);
    }
    // With A v = b the residual is what the links pull.
    w.measure(links, v);
    pulled(links, &w.pull, &w.first_end, &w.ends, &mut w.residual);
    if has_guess {
        precondition(&w.a_search, &mut w.search);
        iterations += 1;
        w.step(links, v);
    }
    let goal = params.relative_tolerance * params.relative_tolerance * scale;
    // Directions are conjugate among themselves, not to that of the guess: the first one starts afresh.
    let mut rz_before = f64::INFINITY;
    loop {
        precondition(&w.residual, &mut w.solved);
        iterations += 1;
        let rz = dot(&mut w.partial, &w.residual, &w.solved, &w.residual, &w.solved)[0];
        if rz >= 0.0 && rz <= goal {
            return report(CoupledStatus::Converged, iterations, rz);
        }
        if iterations >= params.max_iterations {
            return report(CoupledStatus::IterationLimit, iterations, rz);
        }
        w.turn(rz / rz_before);
        rz_before = rz;
        if !w.step(links, v) {
            return report(CoupledStatus::Breakdown, iterations, rz);
        }
    }
}

impl CoupledWorkspace {
    /// Sizes the buffers and lists, for each unknown, the link ends on it.
    fn index(&mut self, links: &[RankOne], n: usize) {
        for buffer in [&mut self.residual, &mut self.solved, &mut self.search, &mut self.a_search] {
            buffer.resize(n, Vector3::zeros());
        }
        self.pull.resize(links.len(), 0.0);
        self.first_end.clear();
        self.first_end.resize(n + 1, 0);
        for link in links {
            for unknown in link.unknowns.into_iter().filter(|&u| u != NO_UNKNOWN) {
                self.first_end[unknown as usize] += 1;
            }
        }
        let mut sum = 0;
        for first in &mut self.first_end {
            sum += *first;
            *first = sum;
        }
        self.ends.resize(sum as usize, 0);
        // Backwards from each unknown's last place: what is left is its first one, and its ends ascend.
        for (l, link) in links.iter().enumerate().rev() {
            for place in (0..4).rev().filter(|&place| link.unknowns[place] != NO_UNKNOWN) {
                let first = &mut self.first_end[link.unknowns[place] as usize];
                *first -= 1;
                self.ends[*first as usize] = 4 * l as u32 + place as u32;
            }
        }
    }

    /// Measures a vector by every link; false if none pulls.
    fn measure(&mut self, links: &[RankOne], v: &[Vector3<f64>]) -> bool {
        self.pull.par_chunks_mut(CHUNK).zip(links.par_chunks(CHUNK)).for_each(|(pulls, links)| {
            for (pull, link) in pulls.iter_mut().zip(links) {
                *pull = link.coefficient * link.measure(v);
            }
        });
        self.pull.iter().any(|&pull| pull != 0.0)
    }

    /// p ← z + β p, and with it A p ← r + β A p.
    fn turn(&mut self, beta: f64) {
        let solved = self.solved.par_chunks(CHUNK).zip(self.residual.par_chunks(CHUNK));
        self.search.par_chunks_mut(CHUNK).zip(self.a_search.par_chunks_mut(CHUNK)).zip(solved).for_each(
            |((p, ap), (z, r))| {
                for k in 0..p.len() {
                    // The first direction must not see what an earlier solve left behind.
                    (p[k], ap[k]) = if beta == 0.0 { (z[k], r[k]) } else { (z[k] + p[k] * beta, r[k] + ap[k] * beta) };
                }
            },
        );
    }

    /// Goes along the search direction to where the residual is square to it; false if there is no such place.
    fn step(&mut self, links: &[RankOne], v: &mut [Vector3<f64>]) -> bool {
        let mut search = std::mem::take(&mut self.search);
        self.measure(links, &search);
        let [mut curvature, slope] = dot(&mut self.partial, &search, &self.a_search, &search, &self.residual);
        for (pull, link) in self.pull.iter().zip(links) {
            if link.coefficient > 0.0 {
                curvature += pull * pull / link.coefficient;
            }
        }
        std::mem::swap(&mut self.search, &mut search);
        let alpha = slope / curvature;
        if !(curvature > 0.0 && alpha.is_finite()) {
            return false;
        }
        let Self { residual, search, a_search, pull, first_end, ends, .. } = self;
        let directions = search.par_chunks(CHUNK).zip(a_search.par_chunks(CHUNK));
        v.par_chunks_mut(CHUNK).zip(residual.par_chunks_mut(CHUNK)).zip(directions).enumerate().for_each(
            |(chunk, ((v, r), (p, ap)))| {
                for k in 0..v.len() {
                    v[k] += p[k] * alpha;
                    r[k] -= (ap[k] - pulled_at(links, pull, first_end, ends, chunk * CHUNK + k)) * alpha;
                }
            },
        );
        true
    }
}

/// -C v, given what the links pull with.
fn pulled(links: &[RankOne], pull: &[f64], first_end: &[u32], ends: &[u32], out: &mut [Vector3<f64>]) {
    out.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, out)| {
        for (k, out) in out.iter_mut().enumerate() {
            *out = pulled_at(links, pull, first_end, ends, chunk * CHUNK + k);
        }
    });
}

/// One entry of -C v: gathered in a fixed order, where scattering would need locks.
#[inline(always)]
fn pulled_at(links: &[RankOne], pull: &[f64], first_end: &[u32], ends: &[u32], unknown: usize) -> Vector3<f64> {
    let mut sum = Vector3::zeros();
    for &end in &ends[first_end[unknown] as usize..first_end[unknown + 1] as usize] {
        let (link, place) = ((end / 4) as usize, (end % 4) as usize);
        sum -= links[link].direction * (links[link].weights[place] * pull[link]);
    }
    sum
}

/// a·b and c·d, summed piece by piece in order.
fn dot(
    partial: &mut Vec<[f64; 2]>,
    a: &[Vector3<f64>],
    b: &[Vector3<f64>],
    c: &[Vector3<f64>],
    d: &[Vector3<f64>],
) -> [f64; 2] {
    partial.resize(a.len().div_ceil(CHUNK), [0.0; 2]);
    partial.par_iter_mut().enumerate().for_each(|(chunk, sum)| {
        *sum = [0.0; 2];
        for k in chunk * CHUNK..((chunk + 1) * CHUNK).min(a.len()) {
            *sum = [sum[0] + a[k].dot(&b[k]), sum[1] + c[k].dot(&d[k])];
        }
    });
    partial.iter().fold([0.0; 2], |sum, p| [sum[0] + p[0], sum[1] + p[1]])
}
