//! Laws of the forces on guides: what exact and stepwise solves share, and how near the second is to the first.

use super::*;
use crate::params::{TwoWayParams, TwoWaySolve};
use io_formats::skinning_model::{MAX_ELIGIBLE, WeightPoly};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

const EXACT: TwoWaySolve = TwoWaySolve::LeastSquares;
const STEPS: TwoWaySolve = TwoWaySolve::ConjugateGradients { iterations: 6 };
/// Enough to be at the answer of the kept matrix.
const MANY_STEPS: TwoWaySolve = TwoWaySolve::ConjugateGradients { iterations: 60 };

/// Relative effect of the ridge and of forces in single precision on a well-conditioned system.
const SOLVER_AGREEMENT: f64 = 1e-6;

/// Relative effect of products of weights rounded to 2^-22 and of a solve in single precision.
const SINGLE_AGREEMENT: f64 = 1e-4;

/// Relative effect of the matrix between knots, where clamped weights have corners.
const KNOT_AGREEMENT: f64 = 1e-2;

fn set(guides: &[(u16, f32)]) -> ActiveSet {
    let mut set = ActiveSet { n: guides.len() as u8, guides: [0; MAX_ELIGIBLE], ..ActiveSet::EMPTY };
    for (k, &(guide, weight)) in guides.iter().enumerate() {
        set.guides[k] = guide;
        set.weights[k] = WeightPoly { quad: 0.0, lin: 0.0, con: weight };
    }
    set
}

fn letter(solve: TwoWaySolve) -> TwoWayParams {
    TwoWayParams {
        enabled: true,
        solve,
        stiffness_over_inertia: 1.0,
        idle_row_weight: 1.0,
        ridge: 1e-12,
        memory: 0.0,
        max_acceleration: f64::INFINITY,
    }
}

fn push(strand: u32, segment: u16, force: [f32; 3]) -> ContactPoint {
    ContactPoint { strand, segment, s: 0.0, force }
}

fn all_pairs(n_guides: u16) -> Vec<[u16; 2]> {
    (0..n_guides).flat_map(|i| (i + 1..n_guides).map(move |j| [i, j])).collect()
}

fn two_way(n_guides: u16, n_particles: usize, sets: &[ActiveSet], params: &TwoWayParams) -> TwoWay {
    TwoWay::new(usize::from(n_guides), n_particles, &all_pairs(n_guides), sets.iter(), params)
}

fn update(two_way: &mut TwoWay, sets: &[ActiveSet], contacts: &[ContactPoint], params: &TwoWayParams) -> usize {
    two_way.update(Round::First, sets.len(), |s| &sets[s], contacts, |_| 1.0, params)
}

const N_GUIDES: u16 = 24;
const N_PARTICLES: usize = 25;

/// A set of one to six guides near `place`, weights quadratic along the strand, summing to about one, some clamped.
fn random_set(rng: &mut Pcg64Mcg, place: f32) -> ActiveSet {
    let first = (place * f32::from(N_GUIDES - 6)) as u16;
    let mut out = ActiveSet::EMPTY;
    for guide in first..first + 6 {
        if rng.random_bool(0.4) {
            continue;
        }
        out.guides[usize::from(out.n)] = guide;
        let (quad, lin) = (rng.random_range(-0.3..0.3), rng.random_range(-0.3..0.3));
        out.weights[usize::from(out.n)] = WeightPoly { quad, lin, con: rng.random_range(0.1..0.6) };
        out.n += 1;
    }
    if out.n == 0 { set(&[(first, 1.0)]) } else { out }
}

/// 2,000 hairs of 24 guides, half of them in contact from the middle of the strand on.
fn head(seed: u64) -> (Vec<ActiveSet>, Vec<ContactPoint>) {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let sets: Vec<_> = (0..2000).map(|k| random_set(&mut rng, k as f32 / 2000.0)).collect();
    let mut contacts = Vec::new();
    for strand in 0..2000 {
        for segment in 10..22 {
            if strand % 2 == 0 && rng.random_bool(0.3) {
                let force = [rng.random_range(0.0..1.0), rng.random_range(-0.3..0.3), rng.random_range(-0.3..0.3)];
                contacts.push(ContactPoint { strand, segment, s: rng.random_range(0.0..1.0), force });
            }
        }
    }
    (sets, contacts)
}

fn relative_difference(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    let apart: f64 = a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum();
    (apart / b.iter().map(|b| b.norm_squared()).sum::<f64>()).sqrt()
}

#[test]
fn forces_skinned_from_guides_are_given_back() {
    let sets = [set(&[(0, 0.75), (1, 0.25)]), set(&[(1, 0.5), (2, 0.5)]), set(&[(0, 0.25), (2, 0.75)])];
    let planted = [Vector3::new(1.0, 0.2, 0.0), Vector3::new(0.8, 0.0, 0.3), Vector3::new(1.2, 0.1, 0.1)];
    let contacts: Vec<_> = (0..3_u32)
        .flat_map(|s| {
            let active = &sets[s as usize];
            let force = (0..usize::from(active.n))
                .map(|k| planted[usize::from(active.guides[k])] * f64::from(active.weights[k].con))
                .sum::<Vector3<f64>>();
            (0..3).map(move |i| push(s, i, force.cast::<f32>().into()))
        })
        .collect();
    for (solve, tolerance) in [(EXACT, SOLVER_AGREEMENT), (MANY_STEPS, SINGLE_AGREEMENT)] {
        let mut two_way = two_way(3, 4, &sets, &letter(solve));
        assert_eq!(update(&mut two_way, &sets, &contacts, &letter(solve)), 3);
        for guide in 0..3 {
            for i in 0..3 {
                let off = (two_way.forces[guide * 4 + i] - planted[guide]).norm();
                assert!(off < tolerance, "{solve:?}: {off:e}");
            }
            assert_eq!(two_way.forces[guide * 4 + 3], Vector3::zeros(), "no contact touches the tip");
        }
    }
}

#[test]
fn a_force_within_a_segment_is_shared_by_its_ends() {
    let sets = [set(&[(0, 1.0)])];
    for solve in [EXACT, STEPS] {
        let mut two_way = two_way(1, 3, &sets, &letter(solve));
        let contact = ContactPoint { strand: 0, segment: 1, s: 0.25, force: [4.0, 0.0, 0.0] };
        update(&mut two_way, &sets, &[contact], &letter(solve));
        for (force, expected) in two_way.forces.iter().zip([0.0, 3.0, 1.0]) {
            assert!((force - Vector3::x() * expected).norm() < SINGLE_AGREEMENT, "{solve:?}: {force:?}");
        }
    }
}

#[test]
fn without_contact_no_guide_is_pushed() {
    let sets = [set(&[(0, 1.0)])];
    for solve in [EXACT, STEPS] {
        let mut two_way = two_way(1, 3, &sets, &letter(solve));
        assert_eq!(update(&mut two_way, &sets, &[], &letter(solve)), 0);
        assert!(two_way.forces.iter().all(|f| *f == Vector3::zeros()));
        // And none is left once contact has ended, without memory.
        assert_eq!(update(&mut two_way, &sets, &[push(0, 0, [1.0; 3])], &letter(solve)), 1);
        assert!(two_way.forces[0].norm() > 1.0);
        assert_eq!(update(&mut two_way, &sets, &[], &letter(solve)), 0);
        assert!(two_way.forces.iter().all(|f| *f == Vector3::zeros()));
    }
}

#[test]
fn rows_out_of_contact_dilute_the_force_less_when_weighed_less() {
    let sets: Vec<_> = (0..10).map(|_| set(&[(0, 1.0)])).collect();
    let contacts = [push(0, 0, [1.0, 0.0, 0.0])];
    for (solve, tolerance) in [(EXACT, SOLVER_AGREEMENT), (STEPS, SINGLE_AGREEMENT)] {
        let force = |idle: f64| {
            let params = TwoWayParams { idle_row_weight: idle, ..letter(solve) };
            let mut two_way = two_way(1, 3, &sets, &params);
            update(&mut two_way, &sets, &contacts, &params);
            two_way.forces[0].x
        };
        assert!((force(1.0) - 0.1).abs() < tolerance);
        assert!((force(0.0) - 1.0).abs() < tolerance);
    }
}

#[test]
fn contacts_of_one_direction_push_no_guide_against_it() {
    let (sets, mut contacts) = head(5);
    contacts.iter_mut().for_each(|c| c.force = [0.0, c.force[0], 0.0]);
    for solve in [EXACT, STEPS] {
        let params = TwoWayParams { idle_row_weight: 0.05, ridge: 1e-3, ..letter(solve) };
        let mut two_way = two_way(N_GUIDES, N_PARTICLES, &sets, &params);
        update(&mut two_way, &sets, &contacts, &params);
        assert!(two_way.forces.iter().all(|f| f.x == 0.0 && f.y >= 0.0 && f.z == 0.0));
        assert!(two_way.forces.iter().map(|f| f.y).sum::<f64>() > 0.0);
    }
}

#[test]
fn the_kept_matrix_solved_in_steps_agrees_with_least_squares() {
    for seed in 0..4 {
        let (sets, contacts) = head(seed);
        let params = |solve| TwoWayParams { idle_row_weight: 0.05, ridge: 1e-3, ..letter(solve) };
        let forces = |solve| {
            let mut two_way = two_way(N_GUIDES, N_PARTICLES, &sets, &params(solve));
            // The second update starts from the first.
            for _ in 0..2 {
                update(&mut two_way, &sets, &contacts, &params(solve));
            }
            two_way.forces
        };
        let off = relative_difference(&forces(STEPS), &forces(EXACT));
        assert!(off < KNOT_AGREEMENT, "{off}");
    }
}

#[test]
fn the_matrix_does_not_depend_on_how_it_came_about() {
    let mut rng = Pcg64Mcg::seed_from_u64(11);
    let (mut sets, contacts) = head(3);
    let params = letter(STEPS);
    let mut wandered = two_way(N_GUIDES, N_PARTICLES, &sets, &params);
    for _ in 0..5 {
        for _ in 0..500 {
            let s = rng.random_range(0..sets.len());
            let new = random_set(&mut rng, s as f32 / sets.len() as f32);
            let old = std::mem::replace(&mut sets[s], new);
            wandered.set_changed(s as u32, &old, &sets[s]);
        }
        let some: Vec<_> = contacts.iter().copied().filter(|c| (c.strand / 8).is_multiple_of(3)).collect();
        let from = rng.random_range(0..some.len());
        update(&mut wandered, &sets, &some[from..], &params);
    }
    update(&mut wandered, &sets, &contacts, &params);
    let mut built = two_way(N_GUIDES, N_PARTICLES, &sets, &params);
    update(&mut built, &sets, &contacts, &params);
    let entries = |t: &TwoWay| t.matrix.as_ref().map(|m| m.entries().to_vec());
    assert_eq!(entries(&wandered), entries(&built));
    assert!(entries(&built).is_some_and(|e| e.iter().any(|e| e[1] != [0; 8])));
}

#[test]
fn the_same_forces_come_from_any_number_of_threads() {
    let (sets, contacts) = head(7);
    // More points than one run takes.
    let contacts: Vec<_> = contacts.iter().flat_map(|c| [*c; 4]).collect();
    for solve in [EXACT, STEPS] {
        let run = |n_threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            pool.install(|| {
                let params = TwoWayParams { memory: 0.5, ..letter(solve) };
                let mut two_way = two_way(N_GUIDES, N_PARTICLES, &sets, &params);
                for first in [0, contacts.len() / 3, 0] {
                    update(&mut two_way, &sets, &contacts[first..], &params);
                }
                two_way.forces.iter().flat_map(|f| [f.x, f.y, f.z]).map(f64::to_bits).collect::<Vec<_>>()
            })
        };
        let one = run(1);
        assert!(one == run(2) && one == run(8), "{solve:?}");
    }
}

#[test]
fn memory_fades_once_a_step_and_rounds_of_a_step_add() {
    let sets = [set(&[(0, 1.0)])];
    let contacts = [push(0, 0, [1.0, 0.0, 0.0])];
    for solve in [EXACT, STEPS] {
        let params = TwoWayParams { memory: 0.75, ..letter(solve) };
        let mut two_way = two_way(1, 3, &sets, &params);
        let mut expect = |round, contacts: &[ContactPoint], expected: f64| {
            two_way.update(round, 1, |s| &sets[s], contacts, |_| 1.0, &params);
            let force = two_way.forces[0].x;
            assert!((force - expected).abs() < SINGLE_AGREEMENT, "{solve:?} {round:?}: {force}");
        };
        expect(Round::First, &contacts, 0.25);
        expect(Round::Again, &contacts, 0.5);
        expect(Round::Again, &[], 0.5);
        expect(Round::First, &contacts, 0.75 * 0.5 + 0.25);
        expect(Round::First, &[], 0.75 * (0.75 * 0.5 + 0.25));
    }
}

#[test]
fn no_force_exceeds_its_bound() {
    let (sets, contacts) = head(9);
    for solve in [EXACT, STEPS] {
        let params = TwoWayParams { max_acceleration: 0.1, ..letter(solve) };
        let mut two_way = two_way(N_GUIDES, N_PARTICLES, &sets, &params);
        update(&mut two_way, &sets, &contacts, &params);
        let largest = two_way.forces.iter().map(|f| f.norm()).fold(0.0, f64::max);
        assert!((largest - 0.1).abs() < SOLVER_AGREEMENT, "{largest}");
    }
}

#[test]
fn a_force_that_is_no_number_counts_as_none() {
    let (sets, contacts) = head(13);
    for solve in [EXACT, STEPS] {
        let forces = |force| {
            let mut two_way = two_way(N_GUIDES, N_PARTICLES, &sets, &letter(solve));
            let mut contacts = contacts.clone();
            contacts[17].force = force;
            update(&mut two_way, &sets, &contacts, &letter(solve));
            two_way.forces
        };
        assert_eq!(forces([f32::NAN, 1.0, f32::INFINITY]), forces([0.0; 3]));
    }
}
