//! Weights of every subset of a strand's eligible guides at one particle: AS16 Eq. (7), all 2^k - 1 problems in one walk.
//!
//! Each problem is: minimise wᵀ H w over w >= 0, Σw = 1, on the guides of one mask. Its minimiser without the sign
//! condition is H⁻¹1, scaled. Where that has a negative weight the optimum lies on the boundary, at a subset without one
//! of the negative guides; subsets come before their supersets in numeric order, so it is known already. Masks that
//! differ by their lowest bit share all other rows of the Cholesky factor, which grows by one row per mask.
//! A stated ridge makes H positive definite, hence every optimum unique: guides that move alike share their weight.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT};
use io_formats::frames::STEP_CM;
use io_formats::skinning_model::MAX_ELIGIBLE;
use multiversion::multiversion;

/// Ridge per mean diagonal entry of H.
const RELATIVE_RIDGE: f64 = 1e-9;
/// Differences below this (cm) are round-off of recorded positions: they must not decide between guides.
const POSITION_NOISE_CM: f64 = 0.5 * STEP_CM as f64;
/// Accuracy asked of the general solver, absolute and relative, after scaling to unit mean diagonal.
const GENERAL_TOLERANCE: f64 = 1e-12;
/// Rounds of scaling and solving: whether unknowns are scaled too.
const GENERAL_ROUNDS: [bool; 4] = [false, false, true, true];

/// A symmetric matrix over eligible guides; rows and columns past k are not read.
pub type Square = [[f64; MAX_ELIGIBLE]; MAX_ELIGIBLE];

/// What is added to the diagonal of H: 1e-9 of its mean, and the noise of `n_frames` recorded positions.
#[must_use]
pub fn ridge(h: &Square, k: usize, n_frames: usize) -> f64 {
    ridge_of_trace((0..k).map(|g| h[g][g]).sum(), k, n_frames)
}

/// [`ridge`], from the sum of the `k` diagonal entries of H.
#[must_use]
pub fn ridge_of_trace(trace: f64, k: usize, n_frames: usize) -> f64 {
    RELATIVE_RIDGE * trace / k as f64 + n_frames as f64 * POSITION_NOISE_CM * POSITION_NOISE_CM
}

/// wᵀ H w.
#[must_use]
pub fn quadratic_form(h: &Square, k: usize, w: &[f64; MAX_ELIGIBLE]) -> f64 {
    let mut total = 0.0;
    for a in 0..k {
        let row: f64 = (0..k).map(|b| h[a][b] * w[b]).sum();
        total += w[a] * row;
    }
    total
}

/// wᵀ H w / (Σw)² in twice the working precision: near the ridge, plain sums lose seven digits of it to cancellation.
#[must_use]
pub fn quadratic_form_exactly(h: &Square, k: usize, w: &[f64; MAX_ELIGIBLE]) -> f64 {
    let (mut value, mut sum) = ([0.0; 2], [0.0; 2]);
    for a in 0..k {
        sum = plus(sum, w[a]);
        for b in 0..k {
            let (product, rest) = times(w[a], w[b]);
            let (term, term_rest) = times(product, h[a][b]);
            value = plus(plus(value, term), rest.mul_add(h[a][b], term_rest));
        }
    }
    let total = sum[0] + sum[1];
    (value[0] + value[1]) / (total * total)
}

/// a b, and what rounding left of it.
fn times(a: f64, b: f64) -> (f64, f64) {
    let product = a * b;
    (product, a.mul_add(b, -product))
}

/// A sum of two parts and a number; the second part is what the first cannot hold.
fn plus([high, low]: [f64; 2], x: f64) -> [f64; 2] {
    let sum = high + x;
    let of_x = sum - high;
    [sum, low + (high - (sum - of_x)) + (x - of_x)]
}

/// Memory and results of [`SubsetWeights::solve`].
#[derive(Debug, Clone)]
pub struct SubsetWeights {
    /// By mask: the weights where the optimum is inside, else unused.
    weights: Vec<[f64; MAX_ELIGIBLE]>,
    /// By mask: the least value of wᵀ (H + ridge) w.
    objective: Vec<f64>,
    /// By mask: the subset whose guides carry the optimum.
    support: Vec<u16>,
}

impl Default for SubsetWeights {
    fn default() -> Self {
        let n = 1 << MAX_ELIGIBLE;
        Self { weights: vec![[0.0; MAX_ELIGIBLE]; n], objective: vec![0.0; n], support: vec![0; n] }
    }
}

impl SubsetWeights {
    /// Solves for all subsets of `k` guides; `ridge` is added to the diagonal of `h` and must be positive.
    /// Implements AS16 Eq. (7), from the Gram matrix of residuals. Ties go to the subset without the lowest guide.
    ///
    /// # Panics
    /// If k is not 1 to 9.
    pub fn solve(&mut self, h: &Square, k: usize, ridge: f64) {
        assert!((1..=MAX_ELIGIBLE).contains(&k), "{k} eligible guides");
        walk(self, h, k, ridge);
    }

    /// Weights of the guides for one mask, by bit; zero outside the mask.
    ///
    /// # Panics
    /// If the mask has more than nine bits.
    #[must_use]
    pub fn of(&self, mask: u16) -> &[f64; MAX_ELIGIBLE] {
        &self.weights[usize::from(self.support[usize::from(mask)])]
    }

    /// The guides with a weight above zero for one mask, but for ties.
    ///
    /// # Panics
    /// If the mask has more than nine bits.
    #[must_use]
    pub fn support(&self, mask: u16) -> u16 {
        self.support[usize::from(mask)]
    }

    /// The least value of wᵀ (H + ridge) w for one mask (cm², summed over frames).
    ///
    /// # Panics
    /// If the mask has more than nine bits.
    #[must_use]
    pub fn objective(&self, mask: u16) -> f64 {
        self.objective[usize::from(mask)]
    }
}

/// [`SubsetWeights::solve`]. Only for its `mul_add`, which is a function call where the machine's own instruction is not used.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn walk(all: &mut SubsetWeights, h: &Square, k: usize, ridge: f64) {
    // The factor L D Lᵀ of the present mask, one row per guide from its highest bit down, and what follows from it.
    let mut factor: Square = [[0.0; MAX_ELIGIBLE]; MAX_ELIGIBLE];
    let mut unscaled = [0.0; MAX_ELIGIBLE];
    let mut inverse_pivot = [0.0; MAX_ELIGIBLE];
    let mut forward = [0.0; MAX_ELIGIBLE];
    let mut scaled = [0.0; MAX_ELIGIBLE];
    let mut guide_at = [0; MAX_ELIGIBLE];
    for mask in 1..1_usize << k {
        let last = mask.count_ones() as usize - 1;
        let guide = mask.trailing_zeros() as usize;
        guide_at[last] = guide;
        let mut pivot = h[guide][guide] + ridge;
        let mut ahead = 1.0;
        for c in 0..last {
            let mut sum = h[guide][guide_at[c]];
            for t in 0..c {
                sum = less_product(unscaled[t], factor[c][t], sum);
            }
            unscaled[c] = sum;
            let entry = sum * inverse_pivot[c];
            factor[last][c] = entry;
            pivot = less_product(entry, sum, pivot);
            ahead = less_product(entry, forward[c], ahead);
        }
        // A Schur complement of H + ridge is at least the ridge; below it there is only round-off.
        inverse_pivot[last] = 1.0 / pivot.max(ridge);
        forward[last] = ahead;
        scaled[last] = ahead * inverse_pivot[last];

        let mut x = scaled;
        let (mut total, mut negative) = (0.0, 0_usize);
        for t in (0..=last).rev() {
            for r in 0..t {
                x[r] = less_product(factor[t][r], x[t], x[r]);
            }
            total += x[t];
            if x[t] < 0.0 {
                negative |= 1 << guide_at[t];
            }
        }
        if negative == 0 {
            // The least value is 1 / (1ᵀ H⁻¹ 1).
            let objective = 1.0 / total;
            let weights = &mut all.weights[mask];
            *weights = [0.0; MAX_ELIGIBLE];
            for r in 0..=last {
                weights[guide_at[r]] = x[r] * objective;
            }
            all.objective[mask] = objective;
            all.support[mask] = mask as u16;
        } else {
            let mut best = f64::INFINITY;
            while negative != 0 {
                let child = mask & !(negative & negative.wrapping_neg());
                if all.objective[child] < best {
                    best = all.objective[child];
                    all.support[mask] = all.support[child];
                }
                negative &= negative - 1;
            }
            all.objective[mask] = best;
        }
    }
}

/// c - a b, rounded once.
#[inline(always)]
fn less_product(a: f64, b: f64, c: f64) -> f64 {
    (-a).mul_add(b, c)
}

/// The same problem for one set of `k` guides by a general interior-point solver: the reference in tests, and the path for
/// a problem the walk does not cover. `None` when the solver gives up.
///
/// Its tolerances are absolute where objectives are below one, so the problem is scaled by its diagonal, solved, scaled by
/// the objective found and solved again, later with its unknowns scaled too; by powers of two, which leave the problem what
/// it is. The best point of all rounds counts.
#[must_use]
pub fn solve_general(h: &Square, k: usize, ridge: f64) -> Option<[f64; MAX_ELIGIBLE]> {
    let mut ridged = *h;
    (0..k).for_each(|g| ridged[g][g] += ridge);
    let mut scale = (0..k).map(|g| ridged[g][g]).sum::<f64>() / k as f64;
    let mut best: Option<(f64, [f64; MAX_ELIGIBLE])> = None;
    for scale_unknowns in GENERAL_ROUNDS {
        let Some(w) = interior_point(&ridged, k, scale.log2().round().exp2(), scale_unknowns) else { continue };
        let objective = quadratic_form_exactly(&ridged, k, &w);
        if best.is_none_or(|(least, _)| objective < least) {
            best = Some((objective, w));
        }
        if objective > 0.0 {
            scale = objective;
        }
    }
    best.map(|(_, w)| w)
}

/// The point the solver finds for H over `scale`, on the simplex; in unknowns of like size if so asked. `None` when it gives up.
#[must_use]
pub fn interior_point(h: &Square, k: usize, scale: f64, scale_unknowns: bool) -> Option<[f64; MAX_ELIGIBLE]> {
    // In unknowns w_g sizes_g all diagonal entries are near one: that serves where one guide errs far less than others.
    let size = |g: usize| if scale_unknowns { (0.5 * (h[g][g] / scale).log2()).round().exp2() } else { 1.0 };
    let sizes: Vec<f64> = (0..k).map(size).collect();
    // Upper triangle, column by column. The solver minimises ½ xᵀ P x.
    let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
    for c in 0..k {
        for r in 0..=c {
            rows.push(r);
            values.push(2.0 * h[r][c] / (scale * sizes[r] * sizes[c]));
        }
        starts.push(rows.len());
    }
    let p = CscMatrix::new(k, k, starts, rows, values);
    // One row for the sum, one per sign: A x + s = b.
    let a_starts = (0..=k).map(|c| 2 * c).collect();
    let a_rows = (0..k).flat_map(|c| [0, c + 1]).collect();
    let a_values = sizes.iter().flat_map(|size| [1.0 / size, -1.0]).collect();
    let a = CscMatrix::new(k + 1, k, a_starts, a_rows, a_values);
    let mut b = vec![0.0; k + 1];
    b[0] = 1.0;
    let settings = DefaultSettings {
        verbose: false,
        tol_gap_abs: GENERAL_TOLERANCE,
        tol_gap_rel: GENERAL_TOLERANCE,
        tol_feas: GENERAL_TOLERANCE,
        ..DefaultSettings::default()
    };
    let cones = [ZeroConeT(1), NonnegativeConeT(k)];
    let mut solver = DefaultSolver::new(&p, &vec![0.0; k], &a, &b, &cones, settings).ok()?;
    solver.solve();
    if !matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved) {
        return None;
    }
    let mut w = [0.0; MAX_ELIGIBLE];
    for g in 0..k {
        w[g] = solver.solution.x[g].max(0.0) / sizes[g];
    }
    let total: f64 = w.iter().sum();
    Some(w.map(|w| w / total))
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    /// Agreement of objectives with the general solver, as a share of the objective.
    const SAME_OBJECTIVE: f64 = 1e-9;
    /// Round-off of weights.
    const ROUND_OFF: f64 = 1e-12;

    /// Gram matrix of residuals of `k` guides that share an error of size `shared`; `equal` makes the last two the same.
    fn problem(rng: &mut Pcg64Mcg, k: usize, n_rows: usize, shared: f64, equal: bool) -> Square {
        let common: Vec<f64> = (0..n_rows).map(|_| shared * rng.random_range(-1.0..1.0)).collect();
        let mut residuals: Vec<Vec<f64>> = (0..k)
            .map(|_| {
                let size = 10.0_f64.powf(rng.random_range(-2.0..0.5));
                common.iter().map(|c| c + size * rng.random_range(-1.0..1.0)).collect()
            })
            .collect();
        if equal && k > 1 {
            residuals[k - 1] = residuals[k - 2].clone();
        }
        let mut h = [[0.0; MAX_ELIGIBLE]; MAX_ELIGIBLE];
        for a in 0..k {
            for b in 0..k {
                h[a][b] = residuals[a].iter().zip(&residuals[b]).map(|(x, y)| x * y).sum();
            }
        }
        h
    }

    fn ridged(h: &Square, k: usize, ridge: f64) -> Square {
        let mut out = *h;
        (0..k).for_each(|g| out[g][g] += ridge);
        out
    }

    /// The matrix of the guides in `mask` alone.
    fn restrict(h: &Square, mask: usize) -> (Square, Vec<usize>) {
        let guides: Vec<usize> = (0..MAX_ELIGIBLE).filter(|g| mask >> g & 1 == 1).collect();
        let mut out = [[0.0; MAX_ELIGIBLE]; MAX_ELIGIBLE];
        for (r, &a) in guides.iter().enumerate() {
            for (c, &b) in guides.iter().enumerate() {
                out[r][c] = h[a][b];
            }
        }
        (out, guides)
    }

    fn check_laws(h: &Square, k: usize, walk: &SubsetWeights, ridge: f64) {
        let with_ridge = ridged(h, k, ridge);
        for mask in 1..1_u16 << k {
            let w = walk.of(mask);
            assert!((w.iter().sum::<f64>() - 1.0).abs() < ROUND_OFF, "mask {mask:b}: {w:?}");
            for g in 0..MAX_ELIGIBLE {
                assert!(w[g] >= 0.0 && (w[g] == 0.0 || mask >> g & 1 == 1), "mask {mask:b}: {w:?}");
            }
            for g in (0..k).filter(|g| mask >> g & 1 == 1 && mask.count_ones() > 1) {
                let smaller = walk.objective(mask & !(1 << g));
                assert!(walk.objective(mask) <= smaller * (1.0 + 1e-6), "mask {mask:b} is worse than without {g}");
            }
            // First-order optimality: no guide of the mask has a smaller slope than the set as a whole.
            let value = quadratic_form(&with_ridge, k, w);
            let trace: f64 = (0..k).map(|g| with_ridge[g][g]).sum();
            for g in (0..k).filter(|g| mask >> g & 1 == 1) {
                let slope: f64 = (0..k).map(|b| with_ridge[g][b] * w[b]).sum();
                assert!(slope >= value - 1e-9 * trace, "mask {mask:b}, guide {g}: {slope:e} < {value:e}");
            }
        }
    }

    #[test]
    fn the_walk_agrees_with_the_general_solver_on_thousands_of_problems() {
        let mut rng = Pcg64Mcg::seed_from_u64(7);
        let mut walk = SubsetWeights::default();
        let mut n_compared = 0;
        for round in 0..400 {
            let k = rng.random_range(1..=MAX_ELIGIBLE);
            // Fewer rows than guides make H singular but for the ridge.
            let n_rows = [3, 6, 30, 300][round % 4];
            let h = problem(&mut rng, k, n_rows, [0.0, 0.3, 3.0][round % 3], round % 5 == 0);
            let ridge = ridge(&h, k, n_rows / 3);
            walk.solve(&h, k, ridge);
            check_laws(&h, k, &walk, ridge);
            for _ in 0..8 {
                let mask = rng.random_range(1..1_usize << k);
                let (part, guides) = restrict(&ridged(&h, k, ridge), mask);
                let Some(w) = solve_general(&part, guides.len(), 0.0) else { continue };
                // Both points are feasible, so the lower value is the better answer: the walk must not be above. Where the
                // general solver is, it is the limit: its steps are not exact.
                let general = quadratic_form_exactly(&part, guides.len(), &w);
                let ours = quadratic_form_exactly(&ridged(&h, k, ridge), k, walk.of(mask as u16));
                assert!(ours <= general * (1.0 + ROUND_OFF), "round {round}: {ours:e} > {general:e}");
                assert!(general <= ours * (1.0 + SAME_OBJECTIVE), "round {round}: {general:e} > {ours:e}");
                n_compared += 1;
            }
        }
        assert!(n_compared > 3000, "the general solver gave up on too many problems: {n_compared} compared");
    }

    #[test]
    fn guides_that_move_alike_share_their_weight() {
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        let h = problem(&mut rng, 4, 60, 0.1, true);
        let mut walk = SubsetWeights::default();
        let ridge = ridge(&h, 4, 20);
        walk.solve(&h, 4, ridge);
        let pair = walk.of(0b1100);
        assert!((pair[2] - 0.5).abs() < 1e-6 && (pair[3] - 0.5).abs() < 1e-6, "{pair:?}");
        assert!(walk.of(0b1111).iter().all(|w| w.is_finite()));
    }

    #[test]
    fn without_any_error_weights_are_even() {
        let h = [[0.0; MAX_ELIGIBLE]; MAX_ELIGIBLE];
        let mut walk = SubsetWeights::default();
        walk.solve(&h, 3, ridge(&h, 3, 100));
        for (g, w) in walk.of(0b111)[..3].iter().enumerate() {
            assert!((w - 1.0 / 3.0).abs() < ROUND_OFF, "guide {g}: {w}");
        }
    }

    #[test]
    fn a_single_guide_has_weight_one() {
        let mut rng = Pcg64Mcg::seed_from_u64(8);
        let h = problem(&mut rng, 9, 60, 0.5, false);
        let mut walk = SubsetWeights::default();
        walk.solve(&h, 9, ridge(&h, 9, 20));
        for g in 0..9 {
            assert!((walk.of(1 << g)[g] - 1.0).abs() < ROUND_OFF);
        }
    }
}
