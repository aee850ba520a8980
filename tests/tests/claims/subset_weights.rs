//! AS16 §6.1: weights of guide subsets, beside a general solver of quadratic programs.

use hair_bench::training_bench::agreement;

/// Objectives of the two are the same to this, relative: what an interior-point solver can do near the ridge.
const SAME_OBJECTIVE: f64 = 1e-9;
/// Both answers are feasible and H is positive definite, so a better one cannot lie below the walk's by more than round-off.
const ROUND_OFF: f64 = 1e-13;

#[test]
fn subset_weights_reach_the_objective_of_a_general_solver_on_ten_thousand_problems() {
    let found = agreement(10_000, 7);
    assert_eq!((found.compared, found.given_up), (10_000, 0));
    assert!(found.walk_above < ROUND_OFF, "{found:?}");
    assert!(found.general_above < SAME_OBJECTIVE, "{found:?}");
}
