//! Dictionary learning beside SPAMS, the library of the method's authors (AS16 §6.3), without having it at hand.
//!
//! SPAMS's objectives on generated matrices are kept in docs/benchmarks/sparse_coding.json, as `bench/scripts/compare_spams.py`
//! wrote them; here the same matrices are made again and our dictionary is learned on them now. What the file says we
//! reached then must come out again where nothing changed: it ties the kept figures to the matrix.

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use skinning_train::guide_select::sparse_coding::{SparseCodingParams, learn_dictionary};
use skinning_train::reduce::Signals;

use crate::error::Error;
use crate::strand_bench::Row;

/// Cases of the file: their names, and those of the rows.
const CASES: [(&str, &str); 2] =
    [("long_1000_of_15000", "objective_over_spams_long"), ("made_15000_of_1000", "objective_over_spams_many")];
const KEPT: &str = include_str!("../../docs/benchmarks/sparse_coding.json");

/// Signals of `dims` numbers like those of hair: some hundred ways to move, smooth in their order of size, a few of them in
/// each signal, and noise. A function of its arguments alone: products, sums and square roots of numbers from one seed.
#[must_use]
pub fn made(dims: usize, n_signals: usize) -> Signals {
    const MOTIONS: usize = 160;
    const PER_SIGNAL: usize = 5;
    const NOISE: f64 = 0.1;
    let mut rng = Pcg64Mcg::seed_from_u64(2010);
    let mut motions = Vec::with_capacity(MOTIONS);
    for _ in 0..MOTIONS {
        let mut motion: Vec<f64> =
            (0..dims).map(|d| rng.random_range(-1.0..1.0) / (1.0 + 10.0 * d as f64 / dims as f64)).collect();
        let length = motion.iter().map(|x| x * x).sum::<f64>().sqrt();
        motion.iter_mut().for_each(|x| *x /= length);
        motions.push(motion);
    }
    let mut coords = Vec::with_capacity(dims * n_signals);
    for _ in 0..n_signals {
        let noise = NOISE / (dims as f64).sqrt();
        let mut signal: Vec<f64> = (0..dims).map(|_| noise * rng.random_range(-1.0..1.0)).collect();
        for _ in 0..PER_SIGNAL {
            let motion = &motions[rng.random_range(0..MOTIONS)];
            let share = rng.random_range(-1.0..1.0);
            signal.iter_mut().zip(motion).for_each(|(x, m)| *x += share * m);
        }
        coords.extend(signal);
    }
    let scale = (n_signals as f64 / coords.iter().map(|x| x * x).sum::<f64>()).sqrt();
    coords.iter_mut().for_each(|x| *x *= scale);
    Signals { rank: dims, coords, scale, lost_energy: 0.0 }
}

/// Our objective over SPAMS's for each kept case, and the larger of them.
///
/// # Errors
/// None of the kept file's own: what a case lacks makes its ratio not a number.
pub fn beside_spams() -> Result<Vec<Row>, Error> {
    let kept: serde_json::Value = serde_json::from_str(KEPT).unwrap_or_default();
    let mut rows = Vec::new();
    let mut largest = f64::NEG_INFINITY;
    for (case, row) in CASES {
        let ratio = objective_over_kept(&kept[case]);
        largest = if ratio.is_nan() { ratio } else { largest.max(ratio) };
        rows.push((row, "x", ratio));
    }
    rows.push(("objective_over_spams", "x", largest));
    Ok(rows)
}

/// Learns on the matrix of a case and divides by what SPAMS reached on it.
fn objective_over_kept(case: &serde_json::Value) -> f64 {
    let number = |name: &str| case[name].as_f64().unwrap_or(f64::NAN);
    let count = |name: &str| case[name].as_u64().unwrap_or(1) as usize;
    let signals = made(count("dims"), count("signals")).in_own_span();
    let params = SparseCodingParams {
        n_atoms: count("atoms"),
        sparsity: number("beta"),
        epochs: count("passes"),
        batch: count("batch"),
        seed: 1,
    };
    let dictionary = learn_dictionary(&signals, &params, &mut |_| {});
    dictionary.objective[dictionary.objective.len() - 1] / number("spams_objective")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two solvers of one convex problem, each to its own tolerance, and another order of sums.
    const SAME_OBJECTIVE: f64 = 1e-6;

    #[test]
    fn the_matrix_is_the_one_that_spams_was_run_on() {
        let kept: serde_json::Value = serde_json::from_str(KEPT).expect("a file of figures");
        let case = &kept[CASES[0].0];
        let then = case["objective_over_spams"].as_f64().expect("a ratio");
        let now = objective_over_kept(case);
        assert!(
            (now - then).abs() < SAME_OBJECTIVE,
            "{now} now, {then} in the file; if learning changed, run SPAMS again"
        );
    }
}
