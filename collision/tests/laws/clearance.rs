//! The interpolation check against dense sampling of the closed form around a comb.

use collision::{Shape, ShapeUnion, Solid, clearance, ribbon_is_free, segment_is_free, strand_ribbon_is_free};
use nalgebra::Vector3;

use crate::random::Random;

const TOOTH_RADIUS: f32 = 0.08;
const PITCH: f32 = 0.4;
const RESOLUTION: f32 = 0.04;
/// Share of free pieces that may be called blocked: those that pass within the resolution and the grid's error.
const FALSE_BLOCKED: f32 = 0.12;
/// Distances in single precision, a few centimetres from the origin.
const ROUND_OFF: f32 = 1e-5;

fn comb() -> (ShapeUnion, Solid) {
    let v = Vector3::new;
    let mut shapes = vec![Shape::capsule(v(-1.2, 0.0, 0.0), v(1.2, 0.0, 0.0), 0.2)];
    for n in 0..7 {
        let x = PITCH * (n as f32 - 3.0);
        shapes.push(Shape::capsule(v(x, 0.0, 0.0), v(x, 0.0, -2.5), TOOTH_RADIUS));
    }
    let shape = ShapeUnion::sharp(shapes);
    let solid = Solid::from_shape("comb", &shape, 0.02, TOOTH_RADIUS, 0.3).expect("a sound shape");
    (shape, solid)
}

fn point(random: &mut Random) -> Vector3<f32> {
    random.in_box(Vector3::new(-2.0, -1.0, -3.2), Vector3::new(2.0, 1.0, 0.6))
}

/// Counts of (free in truth, called blocked though free); panics on a piece called free that is not.
fn tally(cases: impl Iterator<Item = (f32, bool)>) -> (usize, usize) {
    let (mut free, mut falsely_blocked) = (0, 0);
    for (n, (least, called_free)) in cases.enumerate() {
        assert!(!called_free || least > -ROUND_OFF, "case {n} is called free at {least}");
        if least > 0.0 {
            free += 1;
            falsely_blocked += usize::from(!called_free);
        }
    }
    (free, falsely_blocked)
}

fn check(kind: &str, (free, falsely_blocked): (usize, usize), n: usize) {
    assert!(free > n / 10 && free < n * 9 / 10, "{kind}: both outcomes must occur, {free} of {n} are free");
    assert!((falsely_blocked as f32) < FALSE_BLOCKED * free as f32, "{kind}: {falsely_blocked} of {free}");
}

#[test]
fn a_segment_called_free_touches_nothing_and_few_free_ones_are_called_blocked() {
    const N: usize = 4_000;
    let (shape, solid) = comb();
    let mut random = Random::new(31);
    let counts = tally((0..N).map(|_| {
        let a = point(&mut random);
        let b = a + random.in_box(Vector3::repeat(-1.0), Vector3::repeat(1.0));
        let least = (0..=600).map(|n| shape.distance(a.lerp(&b, n as f32 / 600.0))).fold(f32::INFINITY, f32::min);
        (least, segment_is_free(&solid.sdf, a, b, RESOLUTION))
    }));
    check("segments", counts, N);
}

#[test]
fn a_ribbon_called_free_touches_nothing_and_few_free_ones_are_called_blocked() {
    const N: usize = 800;
    const SIDE: usize = 80;
    let (shape, solid) = comb();
    let mut random = Random::new(32);
    let counts = tally((0..N).map(|_| {
        let a0 = point(&mut random);
        let [b0, a1, b1] = [(); 3].map(|()| a0 + random.in_box(Vector3::repeat(-0.7), Vector3::repeat(0.7)));
        let mut least = f32::INFINITY;
        for u in 0..=SIDE {
            for v in 0..=SIDE {
                let (u, v) = (u as f32 / SIDE as f32, v as f32 / SIDE as f32);
                least = least.min(shape.distance(a0.lerp(&b0, u).lerp(&a1.lerp(&b1, u), v)));
            }
        }
        (least, ribbon_is_free(&solid.sdf, [a0, b0, a1, b1], RESOLUTION))
    }));
    check("ribbons", counts, N);
}

#[test]
fn a_tooth_between_two_rungs_blocks_the_ribbon_though_every_rung_is_free() {
    let (_, solid) = comb();
    // Two strands run along x on either side of the teeth; rungs stand in the gaps, a pitch apart.
    let strand =
        |y: f32| -> Vec<Vector3<f32>> { (0..6).map(|t| Vector3::new(PITCH * (t as f32 - 2.5), y, -1.5)).collect() };
    let (i, j) = (strand(-0.4), strand(0.4));
    for (a, b) in i.iter().zip(&j) {
        assert!(segment_is_free(&solid.sdf, *a, *b, RESOLUTION));
    }
    assert!(!strand_ribbon_is_free(&solid.sdf, &i, &j, RESOLUTION));
    // Both on one side: free. And beyond the tips: free.
    let near = strand(0.6);
    assert!(strand_ribbon_is_free(&solid.sdf, &j, &near, RESOLUTION));
    let below = |s: &[Vector3<f32>]| -> Vec<Vector3<f32>> { s.iter().map(|p| p - Vector3::z() * 2.0).collect() };
    assert!(strand_ribbon_is_free(&solid.sdf, &below(&i), &below(&j), RESOLUTION));
}

#[test]
fn a_strand_ribbon_is_free_exactly_when_its_ribbons_are_up_to_early_dismissal() {
    let (_, solid) = comb();
    let mut random = Random::new(33);
    let mut outcomes = [0; 2];
    for _ in 0..400 {
        let mut walk = |mut p: Vector3<f32>| -> Vec<Vector3<f32>> {
            (0..9)
                .map(|_| {
                    p += random.in_box(Vector3::new(-0.3, -0.3, -0.4), Vector3::new(0.3, 0.3, 0.0));
                    p
                })
                .collect()
        };
        let start = Vector3::new(walk(Vector3::zeros())[8].x * 2.0, 0.6, 0.5);
        let (i, j) = (walk(start), walk(start + Vector3::x() * 0.5));
        let whole = strand_ribbon_is_free(&solid.sdf, &i, &j, RESOLUTION);
        let each = (0..8).all(|t| ribbon_is_free(&solid.sdf, [i[t], j[t], i[t + 1], j[t + 1]], RESOLUTION));
        // A ball dismissed whole proves more than its pieces can; never less.
        assert!(whole || !each);
        outcomes[usize::from(whole)] += 1;
    }
    assert!(outcomes.iter().all(|&n| n > 40), "both outcomes must occur: {outcomes:?}");
}

#[test]
fn a_wider_clearance_frees_nothing_more() {
    let (_, solid) = comb();
    let mut random = Random::new(34);
    for _ in 0..2_000 {
        let a = point(&mut random);
        let b = a + random.in_box(Vector3::repeat(-0.5), Vector3::repeat(0.5));
        let free = |c: f32| clearance::segment_keeps_clear(&solid.sdf, a, b, c, RESOLUTION);
        // Bisection stops at different depths, so neighbours may differ by a resolution.
        assert!(!free(0.2) || free(0.2 - RESOLUTION - 2.0 * solid.sdf.max_error()));
        assert!(!free(0.0) || free(-RESOLUTION - 2.0 * solid.sdf.max_error()));
    }
}
