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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::jacobi_cg::{JacobiWorkspace, PRESCRIBED, SpringTerm, solve_jacobi};
    use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

    /// Asked of the iteration, and what the solution then owes the dense one at the conditions used here.
    const TIGHT: CoupledParams = CoupledParams { relative_tolerance: 1e-12, max_iterations: 400 };
    const SOLUTION: f64 = 1e-9;

    struct Random(u64);

    impl Random {
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((self.0 >> 11) as f64) / ((1_u64 << 52) as f64) - 1.0
        }

        fn vector(&mut self) -> Vector3<f64> {
            Vector3::from_fn(|_, _| self.next())
        }
    }

    /// Chains of unit springs between particles of unit mass, factored, and random links of a given strength.
    struct Problem {
        n_each: usize,
        chains: Vec<DMatrix<f64>>,
        factors: Vec<Cholesky<f64, Dyn>>,
        links: Vec<RankOne>,
        b: Vec<Vector3<f64>>,
    }

    impl Problem {
        fn new(seed: u64, n_strands: usize, n_each: usize, n_links: usize, strength: f64) -> Self {
            let mut random = Random(seed);
            let chains: Vec<_> = (0..n_strands)
                .map(|_| {
                    let mut a = DMatrix::identity(3 * n_each, 3 * n_each);
                    for i in 0..n_each - 1 {
                        let d = random.vector().normalize();
                        let block = d * d.transpose() * 30.0;
                        for (row, col, sign) in [(i, i, 1.0), (i + 1, i + 1, 1.0), (i, i + 1, -1.0), (i + 1, i, -1.0)] {
                            let mut view = a.fixed_view_mut::<3, 3>(3 * row, 3 * col);
                            view += block * sign;
                        }
                    }
                    a
                })
                .collect();
            let factors = chains.iter().map(|a| a.clone().cholesky().expect("definite")).collect();
            let links = (0..n_links)
                .map(|_| {
                    let mut unknowns = [NO_UNKNOWN; 4];
                    for side in 0..2 {
                        let strand = ((random.next().abs() * n_strands as f64) as usize).min(n_strands - 1);
                        let at = ((random.next().abs() * (n_each - 1) as f64) as usize).min(n_each - 2);
                        unknowns[2 * side] = (strand * n_each + at) as u32;
                        unknowns[2 * side + 1] = (strand * n_each + at + 1) as u32;
                        // Some hang on a root, which is no unknown.
                        if at == 0 {
                            unknowns[2 * side] = NO_UNKNOWN;
                        }
                    }
                    let (s, t) = (random.next().abs(), random.next().abs());
                    let weights = [s - 1.0, -s, 1.0 - t, t];
                    RankOne { unknowns, weights, direction: random.vector().normalize(), coefficient: strength }
                })
                .collect();
            let b = (0..n_strands * n_each).map(|_| random.vector()).collect();
            Self { n_each, chains, factors, links, b }
        }

        fn precondition(&self, r: &[Vector3<f64>], z: &mut [Vector3<f64>]) {
            for (strand, factor) in self.factors.iter().enumerate() {
                let range = strand * self.n_each..(strand + 1) * self.n_each;
                let solved = factor.solve(&flat(&r[range.clone()]));
                for (k, z) in z[range].iter_mut().enumerate() {
                    *z = solved.fixed_rows::<3>(3 * k).into();
                }
            }
        }

        fn solve(&self, guess: &[Vector3<f64>], params: &CoupledParams) -> (Vec<Vector3<f64>>, CoupledReport) {
            let mut v = guess.to_vec();
            let mut workspace = CoupledWorkspace::default();
            let report =
                solve_coupled(&self.links, &self.b, &mut v, |r, z| self.precondition(r, z), params, &mut workspace);
            (v, report)
        }

        fn dense(&self) -> Vec<Vector3<f64>> {
            let n = 3 * self.b.len();
            let mut a = DMatrix::<f64>::zeros(n, n);
            for (strand, chain) in self.chains.iter().enumerate() {
                let (at, size) = (3 * strand * self.n_each, 3 * self.n_each);
                a.view_mut((at, at), (size, size)).copy_from(chain);
            }
            for link in &self.links {
                let mut w = DVector::<f64>::zeros(n);
                for k in (0..4).filter(|&k| link.unknowns[k] != NO_UNKNOWN) {
                    let mut rows = w.fixed_rows_mut::<3>(3 * link.unknowns[k] as usize);
                    rows += link.direction * link.weights[k];
                }
                a += &w * w.transpose() * link.coefficient;
            }
            let x = a.cholesky().expect("definite").solve(&flat(&self.b));
            (0..self.b.len()).map(|k| x.fixed_rows::<3>(3 * k).into()).collect()
        }

        fn zero(&self) -> Vec<Vector3<f64>> {
            vec![Vector3::zeros(); self.b.len()]
        }
    }

    fn flat(v: &[Vector3<f64>]) -> DVector<f64> {
        DVector::from_iterator(3 * v.len(), v.iter().flat_map(|x| [x.x, x.y, x.z]))
    }

    fn assert_near(a: &[Vector3<f64>], b: &[Vector3<f64>]) {
        assert!((flat(a) - flat(b)).norm() < SOLUTION * flat(b).norm());
    }

    #[test]
    fn the_coupled_solve_agrees_with_a_dense_one() {
        for (seed, strength) in [(1, 0.1), (2, 3.0), (3, 300.0)] {
            let problem = Problem::new(seed, 8, 10, 60, strength);
            let (v, report) = problem.solve(&problem.zero(), &TIGHT);
            assert_eq!(report.status, CoupledStatus::Converged);
            assert!(report.iterations > 2 && report.relative_residual <= TIGHT.relative_tolerance);
            assert_near(&v, &problem.dense());
            // Any guess leads to the same answer.
            let guess: Vec<_> = problem.b.iter().map(|b| b * 100.0 + Vector3::x()).collect();
            assert_near(&problem.solve(&guess, &TIGHT).0, &problem.dense());
        }
    }

    #[test]
    fn without_links_the_first_solve_is_the_answer() {
        let problem = Problem::new(4, 5, 8, 0, 0.0);
        let (v, report) = problem.solve(&problem.zero(), &TIGHT);
        assert_eq!((report.status, report.iterations), (CoupledStatus::Converged, 1));
        let mut direct = problem.zero();
        problem.precondition(&problem.b, &mut direct);
        assert_eq!(v, direct);
    }

    #[test]
    fn the_answer_as_guess_is_recognised() {
        let problem = Problem::new(5, 8, 10, 60, 30.0);
        let params = CoupledParams { relative_tolerance: 1e-8, ..TIGHT };
        let (_, cold) = problem.solve(&problem.zero(), &params);
        let (_, warm) = problem.solve(&problem.dense(), &params);
        // One solve for b, one for the guess, one that finds nothing left.
        assert_eq!(warm.iterations, 3);
        assert!(cold.iterations > 10);
    }

    #[test]
    fn a_solve_cut_short_says_so_and_is_better_than_none() {
        let problem = Problem::new(6, 8, 10, 60, 30.0);
        let (v, report) =
            problem.solve(&problem.zero(), &CoupledParams { relative_tolerance: 1e-12, max_iterations: 6 });
        assert_eq!((report.status, report.iterations), (CoupledStatus::IterationLimit, 6));
        let mut unlinked = problem.zero();
        problem.precondition(&problem.b, &mut unlinked);
        let dense = flat(&problem.dense());
        assert!((flat(&v) - &dense).norm() < 0.5 * (flat(&unlinked) - &dense).norm());
    }

    #[test]
    fn broken_numbers_end_the_solve() {
        let mut problem = Problem::new(7, 4, 6, 10, 1.0);
        problem.b[5].y = f64::NAN;
        let (_, report) = problem.solve(&problem.zero(), &TIGHT);
        assert_eq!(report.status, CoupledStatus::Breakdown);
        problem.b.fill(Vector3::zeros());
        let (v, report) = problem.solve(&problem.zero(), &TIGHT);
        assert_eq!((report.status, v), (CoupledStatus::Converged, problem.zero()));
    }

    #[test]
    fn the_coupled_solve_does_not_depend_on_the_thread_count() {
        let problem = Problem::new(8, 700, 10, 4_000, 3.0);
        let with = |n_threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().expect("threads");
            pool.install(|| problem.solve(&problem.zero(), &CoupledParams::standard()))
        };
        let one = with(1);
        assert_eq!(one.1.status, CoupledStatus::Converged);
        assert!(with(2) == one && with(8) == one);
    }

    #[test]
    fn the_plain_solve_of_one_strand_agrees_with_a_dense_one() {
        let (n, mut random) = (20, Random(9));
        let mass: Vec<f64> = (0..n).map(|_| 1.0 + 0.5 * random.next()).collect();
        let mut springs: Vec<_> = (0..n - 1)
            .map(|a| SpringTerm { a, b: a + 1, direction: random.vector().normalize(), along: 50.0, around: 2.0 })
            .collect();
        springs.push(SpringTerm { a: PRESCRIBED, b: 0, direction: Vector3::x(), along: 100.0, around: 0.5 });
        let mut dense = DMatrix::from_diagonal(&DVector::from_fn(3 * n, |k, _| mass[k / 3]));
        for s in &springs {
            let block = s.direction * s.direction.transpose() * s.along + nalgebra::Matrix3::identity() * s.around;
            for (row, col, sign) in [(s.a, s.a, 1.0), (s.b, s.b, 1.0), (s.a, s.b, -1.0), (s.b, s.a, -1.0)] {
                if row != PRESCRIBED && col != PRESCRIBED {
                    let mut view = dense.fixed_view_mut::<3, 3>(3 * row, 3 * col);
                    view += block * sign;
                }
            }
        }
        let b: Vec<_> = (0..n).map(|_| random.vector()).collect();
        let expected = dense.cholesky().expect("definite").solve(&flat(&b));
        let (mut v, mut workspace) = (vec![Vector3::zeros(); n], JacobiWorkspace::default());
        let cold = solve_jacobi(&mass, &springs, &b, &mut v, 1e-12, 1_000, &mut workspace);
        assert!(cold.converged && (flat(&v) - &expected).norm() < SOLUTION * expected.norm());
        // From the answer only the residual is looked at.
        let warm = solve_jacobi(&mass, &springs, &b, &mut v, 1e-11, 1_000, &mut workspace);
        assert!(warm.converged && warm.iterations == 1 && cold.iterations > 10);
        v.fill(Vector3::zeros());
        let short = solve_jacobi(&mass, &springs, &b, &mut v, 1e-12, 3, &mut workspace);
        assert!(!short.converged && short.iterations == 3 && short.relative_residual > 1e-12);
    }
}
