//! How time is cut and integrated: the schemes agree as the step shrinks, each at its own order, and adaptive substeps
//! follow the motion (MS08 §4, §6).

use nalgebra::{Isometry3, Vector3};
use strand_sim::{Material, Scheme, StepInput, StepParams, StepWorkspace, StrandState, StrandSystem, Substeps};

const N_PARTICLES: usize = 13;
const DT_S: f64 = 0.01;
const SCHEMES: [Scheme; 3] = [Scheme::BackwardEuler, Scheme::Trapezoidal, Scheme::TwoSolves];

/// Strands that stick out sideways, each its own way, and bend a little.
fn groom(n_strands: usize) -> Vec<Vector3<f64>> {
    let strand = |s: usize| {
        let turn = 2.4 * s as f64;
        let (out, up) = (Vector3::new(turn.cos(), 0.0, turn.sin()), Vector3::y() * (0.01 * (s % 7) as f64));
        (0..N_PARTICLES).map(move |i| {
            let x = i as f64;
            out * (3.0 + 0.8 * x) + up * (x * x)
        })
    };
    (0..n_strands).flat_map(strand).collect()
}

/// Where a strand released sideways is after a time, by steps of `h` seconds.
fn swung(params: &StepParams, h: f64, time_s: f64) -> Vec<Vector3<f64>> {
    let system = StrandSystem::new(&groom(1), N_PARTICLES, Material::straight()).expect("a sound scene");
    let (mut state, mut workspace) = (system.rest_state(&Isometry3::identity()), StepWorkspace::default());
    for _ in 0..(time_s / h).round() as usize {
        let report = system.step(&mut state, &StepInput::still(h, Isometry3::identity()), params, &mut workspace);
        assert_eq!(report.quarantined, 0);
    }
    system.positions(&state)
}

fn apart(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

#[test]
fn schemes_agree_on_a_swinging_strand_as_the_step_shrinks() {
    /// Largest distance between any two schemes after 0.1 s of steps of 0.25 ms, the tip having fallen by 5.7 cm: measured
    /// 0.0096 cm.
    const AGREE_CM: f64 = 0.02;
    const TIME_S: f64 = 0.1;
    let ends = SCHEMES.map(|scheme| swung(&StepParams::paper(scheme), 0.25e-3, TIME_S));
    let fallen = -ends[0][N_PARTICLES - 1].y;
    let mut worst = 0.0f64;
    for (i, j) in [(0, 1), (0, 2), (1, 2)] {
        let off = apart(&ends[i], &ends[j]);
        println!("{:?} and {:?}: {off} cm apart, fallen {fallen} cm", SCHEMES[i], SCHEMES[j]);
        worst = worst.max(off);
    }
    assert!(fallen > 2.0, "the strand hardly swings: {fallen}");
    assert!(worst < AGREE_CM, "{worst}");
}

/// Errors (cm) at steps of 1, 0.5, 0.25 and 0.125 ms after a swing of 64 ms, and the orders between them. The truth is
/// the trapezoidal rule at a step of 8 microseconds.
fn convergence(scheme: Scheme, geometric_stiffness: bool) -> (Vec<f64>, Vec<f64>) {
    const TIME_S: f64 = 0.064;
    // A strain limit that is never reached: it would make the error jump.
    let params = |scheme| StepParams { strain_limit: 1.0, ..StepParams::paper(scheme) };
    let fine = swung(&params(Scheme::Trapezoidal), 1e-3 / 128.0, TIME_S);
    let params = StepParams { geometric_stiffness, ..params(scheme) };
    let errors: Vec<_> = (0..4).map(|k| apart(&swung(&params, 1e-3 / f64::from(1 << k), TIME_S), &fine)).collect();
    let orders: Vec<_> = errors.windows(2).map(|e| (e[0] / e[1]).log2()).collect();
    (errors, orders)
}

/// Orders measured between successive halvings lie this close to the scheme's own.
const ORDER_OFF: f64 = 0.25;

#[test]
fn halving_the_step_halves_the_error_of_backward_euler() {
    let (plain, orders) = convergence(Scheme::BackwardEuler, false);
    println!("backward Euler: errors {plain:?} cm, orders {orders:?}");
    assert!(orders.iter().all(|order| (order - 1.0).abs() < ORDER_OFF), "{orders:?}");
    // Turning resisted implicitly costs accuracy, the more the coarser the step; it vanishes with the step all the same.
    let (geometric, orders) = convergence(Scheme::BackwardEuler, true);
    println!("with geometric stiffness: errors {geometric:?} cm, orders {orders:?}");
    assert!(orders.iter().all(|&order| order > 1.0), "{orders:?}");
    assert!(geometric[0] > plain[0], "{geometric:?} against {plain:?}");
}

#[test]
fn halving_the_step_quarters_the_error_of_the_trapezoidal_rule() {
    let (errors, orders) = convergence(Scheme::Trapezoidal, false);
    println!("trapezoidal rule: errors {errors:?} cm, orders {orders:?}");
    assert!(orders.iter().all(|order| (order - 2.0).abs() < ORDER_OFF), "{orders:?}");
    let (backward, _) = convergence(Scheme::BackwardEuler, false);
    assert!(errors.iter().zip(&backward).all(|(a, b)| a < b));
}

#[test]
fn two_solves_over_whole_steps_are_first_order() {
    // The order falls to one from above: 1.46, 1.30, 1.17.
    let (errors, orders) = convergence(Scheme::TwoSolves, false);
    println!("two solves: errors {errors:?} cm, orders {orders:?}");
    assert!(errors.is_sorted_by(|a, b| a > b), "{errors:?}");
    assert!((orders[2] - 1.0).abs() < ORDER_OFF, "{orders:?}");
}

/// Steps a groom on a head that starts to turn about y, and gives the substeps of the last step.
fn substeps_at(turn_rate: f64, substeps: Substeps) -> u32 {
    let system = StrandSystem::new(&groom(5), N_PARTICLES, Material::straight()).expect("a sound scene");
    let params = StepParams { substeps, gravity: Vector3::zeros(), ..StepParams::standard() };
    let (mut state, mut workspace) = (system.rest_state(&Isometry3::identity()), StepWorkspace::default());
    let head = |k: u32| Isometry3::rotation(Vector3::y() * (turn_rate * DT_S * f64::from(k)));
    let mut last = 0;
    for k in 0..5 {
        let report = system.step(&mut state, &StepInput::carried(DT_S, head(k), head(k + 1)), &params, &mut workspace);
        last = report.substeps;
    }
    last
}

#[test]
fn adaptive_substeps_grow_with_speed_between_one_and_the_most() {
    const MOST: usize = 12;
    let adaptive = Substeps::Adaptive { strain: 0.1, courant: 0.3, most: MOST };
    let rates = [0.0, 1.0, 4.0, 16.0, 64.0, 256.0];
    let counts: Vec<_> = rates.iter().map(|&rate| substeps_at(rate, adaptive)).collect();
    println!("substeps at {rates:?} rad/s: {counts:?}");
    assert_eq!(counts[0], 1, "hair at rest takes one");
    assert_eq!(counts[rates.len() - 1], MOST as u32);
    assert!(counts.is_sorted(), "{counts:?}");
    assert!(counts.iter().any(|&n| n > 1 && n < MOST as u32), "none in between: {counts:?}");
    assert_eq!(substeps_at(4.0, Substeps::Fixed(0)), 1, "no step is left out");
    // A limit of zero asks for no end of substeps.
    assert_eq!(substeps_at(4.0, Substeps::Adaptive { strain: 0.0, courant: 0.0, most: 7 }), 7);
}

/// Steps strands in a given order under adaptive substeps; gives positions as bits in the strands' own order, and counts.
fn stepped(order: &[usize], n_threads: usize) -> (Vec<[u64; 3]>, Vec<u32>) {
    let points = groom(order.len());
    let ordered: Vec<_> =
        order.iter().flat_map(|&s| points[s * N_PARTICLES..][..N_PARTICLES].iter().copied()).collect();
    let system = StrandSystem::new(&ordered, N_PARTICLES, Material::straight()).expect("a sound scene");
    let substeps = Substeps::Adaptive { strain: 0.02, courant: 0.1, most: 20 };
    let params = StepParams { substeps, ..StepParams::standard() };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().expect("a sound scene");
    pool.install(|| {
        let (mut state, mut workspace): (StrandState, _) =
            (system.rest_state(&Isometry3::identity()), StepWorkspace::default());
        let head = |k: u32| Isometry3::rotation(Vector3::y() * (0.02 * f64::from(k * k)));
        let counts = (0..8)
            .map(|k| {
                let input = StepInput::carried(DT_S, head(k), head(k + 1));
                system.step(&mut state, &input, &params, &mut workspace).substeps
            })
            .collect();
        let x = system.positions(&state);
        let mut bits = vec![[0; 3]; x.len()];
        for (k, &s) in order.iter().enumerate() {
            for i in 0..N_PARTICLES {
                bits[s * N_PARTICLES + i] = x[k * N_PARTICLES + i].map(f64::to_bits).into();
            }
        }
        (bits, counts)
    })
}

#[test]
fn adaptive_steps_do_not_depend_on_batches_or_threads() {
    const N_STRANDS: usize = 37;
    let forward: Vec<_> = (0..N_STRANDS).collect();
    let shuffled: Vec<_> = (0..N_STRANDS).map(|k| 5 * k % N_STRANDS).collect();
    let truth = stepped(&forward, 1);
    println!("substeps {:?}", truth.1);
    assert!(truth.1.iter().any(|&n| n > 1), "{:?}", truth.1);
    assert!(truth == stepped(&forward, 2) && truth == stepped(&forward, 8), "threads change the result");
    assert!(truth == stepped(&shuffled, 1), "batches change the result");
}
