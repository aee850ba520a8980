//! Laws of the hair-hair correction, on two bundles of straight strands.

use super::density::Density;
use super::lattice::{Frame, Lattice};
use super::reference;
use super::{HairHair, HairHairParams, ReadPoses};
use collision::Solid;
use collision::shapes::{Shape, ShapeUnion};
use nalgebra::{Isometry3, Vector3};

/// Particles a strand; a centimetre apart.
const N: usize = 13;

/// Particles that stay.
const N_FIXED: usize = 2;

/// Strands a bundle.
const PER_BUNDLE: usize = 800;

/// How far apart the bundles' middles are, cm.
const APART_CM: f32 = 6.0;

/// Half the width of a bundle, cm.
const HALF_WIDTH_CM: f32 = 1.5;

/// Single-precision rounding of places some hundred centimetres from the origin, through a dozen sums, cm.
const ROUND_OFF_CM: f32 = 1e-4;

/// Relative rounding of a length of a centimetre between places some tens of centimetres from the origin.
const LENGTH_ROUND_OFF: f32 = 1e-5;

/// A particle that rounding puts into the next cell changes counts by one there, the displacement by a few times this, cm.
const ONE_COUNT_CM: f32 = 5e-3;

/// A number between -1 and 1 from a counter (an integer hash), so that cases are the same everywhere.
fn noise(k: usize) -> f32 {
    let mut x = (k as u32).wrapping_add(0x9e37_79b9).wrapping_mul(0x85eb_ca6b);
    x = (x ^ (x >> 15)).wrapping_mul(0xc2b2_ae35);
    x = (x ^ (x >> 13)).wrapping_mul(0x27d4_eb2f);
    ((x ^ (x >> 16)) >> 8) as f32 / 8_388_608.0 - 1.0
}

/// Two bundles that hang side by side.
fn groom() -> Vec<[f32; 3]> {
    let strand = |s: usize| {
        let side = if s < PER_BUNDLE { -0.5 } else { 0.5 };
        let x = side * APART_CM + HALF_WIDTH_CM * noise(3 * s);
        let (y, z) = (0.5 * noise(3 * s + 1), HALF_WIDTH_CM * noise(3 * s + 2));
        (0..N).map(move |i| [x, y - i as f32, z])
    };
    (0..2 * PER_BUNDLE).flat_map(strand).collect()
}

/// Each strand turned about its last fixed particle, by an angle of its own, in the plane of x and y.
fn swung(hair: &[[f32; 3]], angle: impl Fn(usize) -> f32) -> Vec<[f32; 3]> {
    let mut out = hair.to_vec();
    for (s, strand) in out.chunks_exact_mut(N).enumerate() {
        let (sin, cos) = angle(s).sin_cos();
        let [x, y, _] = strand[N_FIXED - 1];
        for p in &mut strand[N_FIXED..] {
            let d = [p[0] - x, p[1] - y];
            (p[0], p[1]) = (x + cos * d[0] - sin * d[1], y + sin * d[0] + cos * d[1]);
        }
    }
    out
}

/// The bundles swung into one another, until their tips are in the same place.
fn pressed() -> Vec<[f32; 3]> {
    let angle = (0.5 * APART_CM / (N - N_FIXED) as f32).asin();
    swung(&groom(), |s| if s < PER_BUNDLE { angle } else { -angle })
}

fn hair_hair(params: HairHairParams) -> HairHair {
    HairHair::new(&groom(), N, N_FIXED, None, params).expect("parameters in range")
}

fn in_head<'a>() -> ReadPoses<'a> {
    ReadPoses { world_from_head: Isometry3::identity(), previous: None }
}

fn free(_: usize) -> f32 {
    f32::MAX
}

fn turned() -> Isometry3<f64> {
    Isometry3::new(Vector3::new(30.0, -12.0, 55.0), Vector3::new(0.4, 1.1, -0.6))
}

fn moved_by(pose: &Isometry3<f64>, hair: &[[f32; 3]]) -> Vec<[f32; 3]> {
    hair.iter().map(|&p| crate::runtime::to_world(pose, p)).collect()
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>().sqrt()
}

fn farthest(a: &[[f32; 3]], b: &[[f32; 3]]) -> f32 {
    a.iter().zip(b).map(|(&a, &b)| distance(a, b)).fold(0.0, f32::max)
}

fn worst_stretch(before: &[[f32; 3]], after: &[[f32; 3]]) -> f32 {
    let lengths = |hair: &[[f32; 3]]| -> Vec<f32> {
        hair.chunks_exact(N).flat_map(|s| s.windows(2).map(|w| distance(w[0], w[1]))).collect()
    };
    lengths(before).iter().zip(lengths(after)).map(|(l0, l)| (l / l0 - 1.0).abs()).fold(0.0, f32::max)
}

fn bits(hair: &[[f32; 3]]) -> Vec<[u32; 3]> {
    hair.iter().map(|p| p.map(f32::to_bits)).collect()
}

#[test]
fn hair_at_rest_is_left_exactly_alone() {
    for pose in [Isometry3::identity(), turned()] {
        let rest = moved_by(&pose, &groom());
        let mut hair = rest.clone();
        let poses = ReadPoses { world_from_head: pose, previous: None };
        let report = hair_hair(HairHairParams::standard()).correct(&mut hair, &poses, free);
        assert_eq!(report.moved_strands, 0);
        assert_eq!(bits(&hair), bits(&rest));
    }
}

#[test]
fn no_cell_is_in_excess_at_rest_even_without_slack() {
    let rest = groom();
    let params = HairHairParams { slack: f32::EPSILON * 64.0, ..HairHairParams::standard() };
    let mut density = Density::at_rest(&rest, &params);
    density.count(&rest, N, &Frame::new(&Isometry3::identity()));
    let (mean, peak) = density.excess_over_rest(&params);
    assert_eq!((mean, peak), (0.0, 0.0));
}

#[test]
fn bundles_pressed_into_one_another_separate_towards_the_density_at_rest() {
    let mut hair = pressed();
    let mut stage = hair_hair(HairHairParams::standard());
    let excess: Vec<f32> = (0..4).map(|_| stage.correct(&mut hair, &in_head(), free).mean_excess).collect();
    // Where they overlap they are twice as dense as at rest, and about half of the hair overlaps.
    assert!(excess[0] > 0.1, "{excess:?}");
    assert!(excess[1] < 0.6 * excess[0], "{excess:?}");
    assert!(excess[3] < 0.25 * excess[0], "{excess:?}");
}

#[test]
fn the_correction_moves_and_turns_with_the_head() {
    let start = pressed();
    let mut here = start.clone();
    let mut stage = hair_hair(HairHairParams::standard());
    stage.correct(&mut here, &in_head(), free);
    let pose = turned();
    let mut there = moved_by(&pose, &start);
    stage.correct(&mut there, &ReadPoses { world_from_head: pose, previous: None }, free);
    let difference = farthest(&moved_by(&pose, &here), &there);
    assert!(farthest(&here, &start) > 20.0 * ONE_COUNT_CM);
    assert!(difference < ONE_COUNT_CM, "{difference}");
}

#[test]
fn lengths_are_kept_to_round_off_and_roots_stay() {
    let start = pressed();
    let mut hair = start.clone();
    let report = hair_hair(HairHairParams { max_shift_cm: 5.0, ..HairHairParams::standard() }).correct(
        &mut hair,
        &in_head(),
        free,
    );
    assert!(report.moved_strands > 0);
    let stretch = worst_stretch(&start, &hair);
    assert!(stretch < LENGTH_ROUND_OFF, "{stretch}");
    for (a, b) in start.chunks_exact(N).zip(hair.chunks_exact(N)) {
        assert_eq!(bits(&a[..N_FIXED]), bits(&b[..N_FIXED]));
    }
}

#[test]
fn a_strand_moves_no_farther_than_its_clearance_and_hardly_shrinks_for_it() {
    // Drawn back by a chord: a segment turned by a right angle at most would lose 1 - 1/√2; those here turn by a quarter of it.
    const SHRINK: f32 = 0.05;
    let start = pressed();
    let mut hair = start.clone();
    let clearance = |s: usize| if s.is_multiple_of(3) { 0.0 } else { 0.02 * (s % 3) as f32 };
    let params = HairHairParams { max_shift_cm: 0.3, ..HairHairParams::standard() };
    let report = hair_hair(params).correct(&mut hair, &in_head(), clearance);
    assert!(report.moved_strands > 0);
    let mut reached = 0;
    for (s, (a, b)) in start.chunks_exact(N).zip(hair.chunks_exact(N)).enumerate() {
        let moved = farthest(a, b);
        assert!(moved <= clearance(s) + ROUND_OFF_CM, "strand {s} moved {moved}");
        reached += usize::from(moved > 0.9 * clearance(s) && clearance(s) > 0.0);
    }
    assert!(reached > 0, "no strand came near its clearance");
    assert!(worst_stretch(&start, &hair) < SHRINK);
}

#[test]
fn the_fast_path_agrees_with_the_plain_one() {
    // The plain one solves to convergence by Gauss-Seidel on one grid, in double precision: what is left are counts in single
    // precision and what is too small to be moved. Shares of the farthest that a particle moves.
    const CONVERGED: f32 = 0.01;
    // Twelve sweeps a level from coarse to fine stop short of convergence.
    const STANDARD: f32 = 0.05;
    let start = pressed();
    for (sweeps, tolerance) in [(400, CONVERGED), (HairHairParams::standard().sweeps, STANDARD)] {
        let params = HairHairParams { sweeps, ..HairHairParams::standard() };
        let plain = reference::correct(&groom(), &start, N, N_FIXED, &params);
        let mut hair = start.clone();
        hair_hair(params).correct(&mut hair, &in_head(), free);
        let (difference, moved) = (farthest(&plain, &hair), farthest(&start, &hair));
        assert!(moved > 0.1, "{moved}");
        assert!(difference < tolerance * moved, "{sweeps} sweeps: {difference} of {moved}");
    }
}

#[test]
fn the_bytes_do_not_depend_on_the_number_of_threads() {
    let (start, before) = (pressed(), groom());
    let run = |n_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().expect("a pool of worker threads");
        pool.install(|| {
            let mut hair = start.clone();
            let previous = Some((&before[..], Isometry3::identity()));
            let mut stage = hair_hair(HairHairParams::with_friction());
            let report =
                stage.correct(&mut hair, &ReadPoses { world_from_head: Isometry3::identity(), previous }, free);
            (bits(&hair), report)
        })
    };
    let one = run(1);
    assert!(one.1.moved_strands > 0);
    assert_eq!(one, run(2));
    assert_eq!(one, run(8));
}

#[test]
fn a_second_read_does_not_remember_the_first() {
    let (start, mut stage) = (pressed(), hair_hair(HairHairParams::standard()));
    let mut first = start.clone();
    stage.correct(&mut first, &in_head(), free);
    // Another box, another pressure in between.
    let mut elsewhere = swung(&groom(), |_| 1.2);
    stage.correct(&mut elsewhere, &in_head(), free);
    let mut again = start.clone();
    stage.correct(&mut again, &in_head(), free);
    assert_eq!(bits(&first), bits(&again));
}

/// Sum over particles of the squared motion against the mean of their cell, cm².
fn relative_motion(now: &[[f32; 3]], before: &[[f32; 3]], at: &[[f32; 3]], cell: f32) -> f64 {
    let mut cells: std::collections::BTreeMap<[i32; 3], Vec<[f64; 3]>> = std::collections::BTreeMap::new();
    for ((p, q), place) in now.iter().zip(before).zip(at) {
        let d = std::array::from_fn(|c| f64::from(p[c] - q[c]));
        cells.entry(place.map(|x| (x / cell).floor() as i32)).or_default().push(d);
    }
    let of_cell = |motions: &Vec<[f64; 3]>| -> f64 {
        let mean: [f64; 3] = std::array::from_fn(|c| motions.iter().map(|d| d[c]).sum::<f64>() / motions.len() as f64);
        motions.iter().map(|d| (0..3).map(|c| (d[c] - mean[c]).powi(2)).sum::<f64>()).sum()
    };
    cells.values().map(of_cell).sum()
}

#[test]
fn friction_takes_relative_motion_away_and_never_adds_any() {
    let rest = groom();
    let cases: [&dyn Fn(usize) -> f32; 4] = [
        &|s| 0.1 * noise(s),                          // every strand by itself
        &|s| if s < PER_BUNDLE { 0.1 } else { -0.1 }, // bundles against each other, not rubbing
        &|s| 0.1 * rest[s * N][2],                    // a shear
        &|s| if noise(s) > 0.9 { 0.3 } else { 0.0 },  // a few strands drawn through the others
    ];
    for (k, angle) in cases.into_iter().enumerate() {
        for friction in [0.3, 1.0] {
            let before = swung(&rest, angle);
            let params = HairHairParams { friction, ..HairHairParams::standard() };
            let mut hair = rest.clone();
            let poses =
                ReadPoses { world_from_head: Isometry3::identity(), previous: Some((&before, Isometry3::identity())) };
            hair_hair(params).correct(&mut hair, &poses, free);
            // Neighbours are those that friction sees: within two cells.
            let was = relative_motion(&rest, &before, &rest, 2.0 * params.cell_cm);
            let is = relative_motion(&hair, &before, &rest, 2.0 * params.cell_cm);
            assert!(is <= was, "case {k}, friction {friction}: {was} became {is}");
            // A bundle that turns as one and a shear are even around each hair: no neighbour holds it back.
            if k == 0 || k == 3 {
                assert!(
                    is < (1.0 - 0.5 * f64::from(friction)) * was,
                    "case {k}, friction {friction}: {was} became {is}"
                );
            }
        }
    }
}

#[test]
fn hair_that_moves_with_the_head_is_not_rubbed() {
    let rest = groom();
    let before = moved_by(&turned(), &rest);
    let pose = Isometry3::new(Vector3::new(32.0, -12.0, 50.0), Vector3::new(0.1, 1.3, -0.6));
    let now = moved_by(&pose, &rest);
    let mut hair = now.clone();
    let poses = ReadPoses { world_from_head: pose, previous: Some((&before, turned())) };
    hair_hair(HairHairParams::with_friction()).correct(&mut hair, &poses, free);
    let moved = farthest(&now, &hair);
    assert!(moved < ROUND_OFF_CM, "{moved}");
}

#[test]
fn hair_is_not_pushed_into_the_head() {
    // A ball beside the place where the bundles meet, touching the hair. Directions are interpolated over half a centimetre of a
    // ball of 3 cm and come out too short by a hundredth or two: so much of a way of half a centimetre is left.
    const INTO_CM: f32 = 0.02;
    // Particles are set back singly there.
    const STRETCH: f32 = 0.05;
    let start = pressed();
    let centre = Vector3::new(0.0, -10.0, HALF_WIDTH_CM + 3.0);
    let ball = ShapeUnion::sharp(vec![Shape::sphere(centre, 3.0)]);
    let head = Solid::from_shape("ball", &ball, 0.1, 3.0, 0.3).expect("a ball bakes");
    let params = HairHairParams { max_shift_cm: 5.0, ..HairHairParams::standard() };
    let into = |head: Option<&Solid>| {
        let mut stage = HairHair::new(&groom(), N, N_FIXED, head, params).expect("parameters in range");
        let mut hair = start.clone();
        stage.correct(&mut hair, &in_head(), free);
        let stretch = worst_stretch(&start, &hair);
        assert!(stretch < STRETCH, "{stretch}");
        start
            .iter()
            .zip(&hair)
            .map(|(&a, &b)| ball.distance(Vector3::from(a)).min(0.0) - ball.distance(Vector3::from(b)))
            .fold(0.0, f32::max)
    };
    let (blind, seeing) = (into(None), into(Some(&head)));
    assert!(blind > 4.0 * INTO_CM, "{blind}");
    assert!(seeing < INTO_CM, "{seeing}, blind {blind}");
}

#[test]
fn what_is_not_a_number_stays_where_it_is_and_spoils_nothing() {
    let mut hair = pressed();
    hair[5 * N + 7] = [f32::NAN; 3];
    hair[9 * N + 12] = [f32::INFINITY, 0.0, 0.0];
    hair_hair(HairHairParams::with_friction()).correct(&mut hair, &in_head(), free);
    let finite = hair.iter().filter(|p| p.iter().all(|x| x.is_finite())).count();
    assert_eq!(finite, hair.len() - 2);
}

#[test]
fn a_parameter_out_of_range_is_named() {
    let params = HairHairParams { cell_cm: 0.0, ..HairHairParams::standard() };
    let error = HairHair::new(&groom(), N, N_FIXED, None, params).expect_err("no cell is of size zero");
    assert!(error.to_string().contains("hair_hair.cell_cm"), "{error}");
}

#[test]
fn a_box_is_whole_blocks_with_a_rim() {
    let lattice = Lattice::around([-3.2, 0.1, 7.0], [4.0, 0.2, 19.9], 0.5);
    for c in 0..3 {
        assert_eq!(lattice.first[c].rem_euclid(8), 0);
        assert_eq!(lattice.dims[c] % 8, 0);
    }
    let cell = |p: [f32; 3]| lattice.cells_of(&p.map(|x| [x]), 2.0)[0];
    assert_ne!(cell([-3.2, 0.1, 7.0]), 0);
    assert_ne!(cell([4.0, 0.2, 19.9]), 0);
    assert_eq!(cell([4.0, 0.2, 40.0]), 0);
    assert_eq!(cell([f32::NAN, 0.2, 19.9]), 0);
}
