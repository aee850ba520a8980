//! The lasso of one signal over a fixed dictionary, from the dictionary's Gram matrix: the inner problem of AS16 Eq. (9).
//!
//! Minimises |u - D a|² + penalty |a|₁ (no ½, as printed), optionally over a ≥ 0. Neighbouring hairs move alike, so atoms
//! are strongly correlated and plain coordinate descent crawls. Here the coordinate that violates optimality most joins
//! the active set, coordinate descent passes over that set find signs, and a Cholesky solve jumps to the minimiser of
//! the present signs, as far as they hold; atoms that depend on others give way. No move raises the objective.

/// How often a coordinate may join before the solve stops early, per atom.
const JOINS_PER_ATOM: usize = 4;
/// Relaxation rounds of one active set.
const ROUNDS: usize = 50;
/// Pivots below this share of their diagonal entry count as dependent atoms.
const DEPENDENT: f64 = 1e-11;

/// How a solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LassoStatus {
    /// Every optimality condition holds within the tolerance.
    Converged,
    /// The iteration limit came first; the code is usable, its objective no higher than at the start.
    Stopped,
}

/// A dictionary, as its Gram matrix, and the penalty.
#[derive(Debug, Clone, Copy)]
pub struct Lasso<'a> {
    /// `n_atoms * n_atoms` products of atoms, symmetric.
    pub gram: &'a [f64],
    /// Number of atoms.
    pub n_atoms: usize,
    /// Weight of |a|₁: β of AS16 Eq. (9).
    pub penalty: f64,
    /// Whether codes must not be negative.
    pub non_negative: bool,
    /// Allowed violation of the optimality conditions, relative to the largest correlation of the signal with an atom.
    pub tolerance: f64,
}

/// Memory of [`Lasso::solve`], kept between signals.
#[derive(Debug, Clone, Default)]
pub struct LassoWorkspace {
    /// Correlation of each atom with the residual, D^T (u - D a).
    slack: Vec<f64>,
    active: Vec<usize>,
    factor: Vec<f64>,
    target: Vec<f64>,
}

impl Lasso<'_> {
    /// Solves for the code of a signal u given `correlations` = D^T u, starting from `code`: zeros, or what solved a problem
    /// much like this one. Both have one entry per atom. Where the minimiser is unique the start does not show.
    ///
    /// # Panics
    /// If a length differs from the number of atoms, or codes that must not be negative start so.
    pub fn solve(&self, correlations: &[f64], code: &mut [f64], ws: &mut LassoWorkspace) -> LassoStatus {
        let n = self.n_atoms;
        assert!(correlations.len() == n && code.len() == n && self.gram.len() == n * n, "one entry per atom");
        let largest = correlations.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
        let tolerance = self.tolerance * largest.max(0.5 * self.penalty);
        ws.active.clear();
        ws.active.extend((0..n).filter(|&j| code[j] != 0.0));
        if !ws.active.is_empty() {
            assert!(!self.non_negative || code.iter().all(|a| *a >= 0.0), "a start that is not allowed");
            self.refresh(correlations, code, ws);
            self.relax(correlations, code, ws, tolerance);
        }
        for _ in 0..=JOINS_PER_ATOM * n {
            self.refresh(correlations, code, ws);
            let mut worst = (tolerance, None);
            for j in 0..n {
                let violation = self.violation(ws.slack[j], code[j]);
                if violation > worst.0 && self.gram[j * n + j] > 0.0 {
                    worst = (violation, Some(j));
                }
            }
            let Some(joining) = worst.1 else { return LassoStatus::Converged };
            if !ws.active.contains(&joining) {
                ws.active.push(joining);
            }
            self.relax(correlations, code, ws, tolerance);
        }
        LassoStatus::Stopped
    }

    /// How far coordinate `a` is from optimal, given its correlation with the residual.
    fn violation(&self, slack: f64, a: f64) -> f64 {
        let half = 0.5 * self.penalty;
        if a > 0.0 {
            (slack - half).abs()
        } else if a < 0.0 {
            (slack + half).abs()
        } else if self.non_negative {
            slack - half
        } else {
            slack.abs() - half
        }
    }

    fn refresh(&self, correlations: &[f64], code: &[f64], ws: &mut LassoWorkspace) {
        ws.slack.clear();
        ws.slack.extend_from_slice(correlations);
        for &j in &ws.active {
            let a = code[j];
            if a != 0.0 {
                let column = &self.gram[j * self.n_atoms..(j + 1) * self.n_atoms];
                for (s, g) in ws.slack.iter_mut().zip(column) {
                    *s -= a * g;
                }
            }
        }
    }

    /// Brings the active set to its optimum; atoms whose code becomes zero leave it.
    fn relax(&self, correlations: &[f64], code: &mut [f64], ws: &mut LassoWorkspace, tolerance: f64) {
        for _ in 0..ROUNDS {
            let moved = self.descend(code, ws);
            ws.active.retain(|&j| code[j] != 0.0);
            if moved <= tolerance || self.jump(correlations, code, ws) {
                return;
            }
            ws.active.retain(|&j| code[j] != 0.0);
            self.refresh(correlations, code, ws);
        }
    }

    /// One pass of coordinate descent over the active set; returns the largest change of a correlation it caused.
    fn descend(&self, code: &mut [f64], ws: &mut LassoWorkspace) -> f64 {
        let n = self.n_atoms;
        let half = 0.5 * self.penalty;
        let mut moved = 0.0_f64;
        for at in 0..ws.active.len() {
            let j = ws.active[at];
            let scale = self.gram[j * n + j];
            let pull = ws.slack[j] + scale * code[j];
            let shrunk = if pull > half {
                pull - half
            } else if pull < -half && !self.non_negative {
                pull + half
            } else {
                0.0
            };
            let change = shrunk / scale - code[j];
            if change != 0.0 {
                code[j] = shrunk / scale;
                moved = moved.max(change.abs() * scale);
                for &l in &ws.active {
                    ws.slack[l] -= change * self.gram[j * n + l];
                }
            }
        }
        moved
    }

    /// Moves the active codes to the minimiser of their signs, or until the first of them reaches zero. True when the
    /// minimiser was reached. Where the active atoms are dependent one of them gives way instead.
    fn jump(&self, correlations: &[f64], code: &mut [f64], ws: &mut LassoWorkspace) -> bool {
        let (n, m) = (self.n_atoms, ws.active.len());
        let half = 0.5 * self.penalty;
        ws.factor.clear();
        ws.target.clear();
        for (row, &j) in ws.active.iter().enumerate() {
            ws.factor.extend(ws.active.iter().map(|&l| self.gram[j * n + l]));
            debug_assert_eq!(ws.factor.len(), (row + 1) * m);
            ws.target.push(correlations[j] - half * code[j].signum());
        }
        if let Some(row) = cholesky_solve(&mut ws.factor, &mut ws.target) {
            self.slide(code, ws, row);
            return false;
        }
        let mut step = 1.0;
        let mut blocking = None;
        for (&j, &target) in ws.active.iter().zip(&ws.target) {
            if target * code[j] <= 0.0 {
                let reach = code[j] / (code[j] - target);
                if reach < step {
                    step = reach;
                    blocking = Some(j);
                }
            }
        }
        for (&j, &target) in ws.active.iter().zip(&ws.target) {
            code[j] = if step == 1.0 { target } else { code[j] + step * (target - code[j]) };
        }
        match blocking {
            Some(j) => {
                code[j] = 0.0;
                false
            }
            None => true,
        }
    }

    /// The active atom at `row` is a sum of those before it. Trading it for them changes |a|₁ but not D a: done in the
    /// direction that does not raise |a|₁, until a code reaches zero.
    fn slide(&self, code: &mut [f64], ws: &mut LassoWorkspace, row: usize) {
        let m = ws.active.len();
        let trade = &mut ws.target;
        trade.fill(0.0);
        for r in (0..row).rev() {
            let mut sum = ws.factor[row * m + r];
            for t in r + 1..row {
                sum += ws.factor[t * m + r] * trade[t];
            }
            trade[r] = -sum / ws.factor[r * m + r];
        }
        trade[row] = 1.0;
        let slope: f64 = ws.active.iter().zip(trade.iter()).map(|(&j, v)| code[j].signum() * v).sum();
        let direction = if slope > 0.0 { -1.0 } else { 1.0 };
        let mut first = (f64::INFINITY, None);
        for (&j, v) in ws.active.iter().zip(trade.iter()) {
            let rate = direction * v * code[j].signum();
            if rate < 0.0 && code[j].abs() / -rate < first.0 {
                first = (code[j].abs() / -rate, Some(j));
            }
        }
        if let (step, Some(blocking)) = first {
            for (&j, v) in ws.active.iter().zip(trade.iter()) {
                code[j] += step * direction * v;
            }
            code[blocking] = 0.0;
        }
    }
}

/// Solves the symmetric system `a x = b` in place (x in `b`). Otherwise returns the first row that depends on those before
/// it; they are then factored, and that row holds its coordinates in the factor.
fn cholesky_solve(a: &mut [f64], b: &mut [f64]) -> Option<usize> {
    let m = b.len();
    for r in 0..m {
        let diagonal = a[r * m + r];
        for c in 0..=r {
            let mut sum = a[r * m + c];
            for t in 0..c {
                sum -= a[r * m + t] * a[c * m + t];
            }
            if c < r {
                a[r * m + c] = sum / a[c * m + c];
            } else if sum > DEPENDENT * diagonal {
                a[r * m + r] = sum.sqrt();
            } else {
                return Some(r);
            }
        }
        for t in 0..r {
            b[r] -= a[r * m + t] * b[t];
        }
        b[r] /= a[r * m + r];
    }
    for r in (0..m).rev() {
        for t in r + 1..m {
            b[r] -= a[t * m + r] * b[t];
        }
        b[r] /= a[r * m + r];
    }
    None
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    /// Optimality is asked of the solver to this, relative to the largest correlation, and checked ten times looser.
    const TOLERANCE: f64 = 1e-9;
    /// Of objectives of two codes that both satisfy the conditions to that tolerance.
    const SAME_VALUE: f64 = 1e-8;

    struct Planted {
        gram: Vec<f64>,
        correlations: Vec<f64>,
        signal_squared: f64,
    }

    /// Atoms that share a common part of size `shared`, like the motion signals of neighbouring hairs.
    fn planted(rng: &mut Pcg64Mcg, n: usize, dims: usize, shared: f64) -> Planted {
        let mut draw = |k: usize| -> Vec<f64> { (0..k).map(|_| rng.random_range(-1.0..1.0)).collect() };
        let common = draw(dims);
        let atoms: Vec<Vec<f64>> =
            (0..n).map(|_| draw(dims).iter().zip(&common).map(|(a, b)| a + shared * b).collect()).collect();
        let signal: Vec<f64> = draw(dims).iter().zip(&common).map(|(a, b)| a + shared * b).collect();
        let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(x, y)| x * y).sum() };
        let gram = atoms.iter().flat_map(|a| atoms.iter().map(move |b| dot(a, b))).collect();
        let correlations = atoms.iter().map(|a| dot(a, &signal)).collect();
        Planted { gram, correlations, signal_squared: dot(&signal, &signal) }
    }

    fn objective(p: &Planted, penalty: f64, a: &[f64]) -> f64 {
        let n = a.len();
        let mut total = p.signal_squared;
        for j in 0..n {
            total += penalty * a[j].abs() - 2.0 * a[j] * p.correlations[j];
            for l in 0..n {
                total += a[j] * a[l] * p.gram[j * n + l];
            }
        }
        total
    }

    fn check(p: &Planted, penalty: f64, non_negative: bool) -> Vec<f64> {
        let n = p.correlations.len();
        let lasso = Lasso { gram: &p.gram, n_atoms: n, penalty, non_negative, tolerance: TOLERANCE };
        let mut code = vec![0.0; n];
        let status = lasso.solve(&p.correlations, &mut code, &mut LassoWorkspace::default());
        assert_eq!(status, LassoStatus::Converged);
        // From another code the same comes out, as far as the minimum is one point: its value in any case.
        let mut again: Vec<f64> = (0..n).map(|j| if j % 2 == 0 { 0.3 } else { 0.0 }).collect();
        assert_eq!(lasso.solve(&p.correlations, &mut again, &mut LassoWorkspace::default()), LassoStatus::Converged);
        let (from_zero, from_other) = (objective(p, penalty, &code), objective(p, penalty, &again));
        assert!((from_zero - from_other).abs() < SAME_VALUE * (1.0 + p.signal_squared), "{from_zero} {from_other}");
        let largest = p.correlations.iter().fold(0.5 * penalty, |m, c| m.max(c.abs()));
        for j in 0..n {
            let residual: f64 = p.correlations[j] - (0..n).map(|l| p.gram[j * n + l] * code[l]).sum::<f64>();
            let violation = if code[j] != 0.0 {
                (residual - 0.5 * penalty * code[j].signum()).abs()
            } else if non_negative {
                residual - 0.5 * penalty
            } else {
                residual.abs() - 0.5 * penalty
            };
            assert!(violation <= 10.0 * TOLERANCE * largest, "atom {j}: {violation:e}");
            assert!(!non_negative || code[j] >= 0.0);
        }
        code
    }

    #[test]
    fn codes_satisfy_the_optimality_conditions_of_the_lasso() {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        for round in 0..300 {
            let (n, dims) = (rng.random_range(1..30), rng.random_range(1..20));
            let shared = [0.0, 1.0, 30.0][round % 3];
            let p = planted(&mut rng, n, dims, shared);
            let penalty = rng.random_range(0.01..1.0);
            for non_negative in [false, true] {
                let code = check(&p, penalty, non_negative);
                // Convex: no nearby code may do better.
                let best = objective(&p, penalty, &code);
                for j in 0..n {
                    let mut other = code.clone();
                    other[j] += 1e-3;
                    assert!(objective(&p, penalty, &other) >= best - 1e-9 * (1.0 + p.signal_squared));
                }
            }
        }
    }

    #[test]
    fn orthogonal_atoms_give_soft_thresholded_correlations() {
        let p = Planted {
            gram: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            correlations: vec![0.5, -0.4, 0.05],
            signal_squared: 1.0,
        };
        assert_eq!(check(&p, 0.2, false), [0.4, -0.30000000000000004, 0.0]);
        assert_eq!(check(&p, 0.2, true), [0.4, 0.0, 0.0]);
    }

    #[test]
    fn equal_atoms_do_not_stop_the_solve() {
        let p = Planted { gram: vec![1.0; 4], correlations: vec![0.7, 0.7], signal_squared: 1.0 };
        let code = check(&p, 0.2, false);
        assert!((code[0] + code[1] - 0.6).abs() < 1e-9, "{code:?}");
    }
}
