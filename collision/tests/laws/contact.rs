//! Segments against thin solids.

use collision::{Shape, SignedDistanceField, Solid, deepest_on_segment};
use nalgebra::Vector3;

use crate::random::Random;

const TOOTH_RADIUS: f32 = 0.08;

fn tooth() -> SignedDistanceField {
    let shape = Shape::capsule(Vector3::zeros(), Vector3::new(0.0, 0.0, -3.0), TOOTH_RADIUS);
    Solid::from_shape("tooth", &shape.into(), 0.02, TOOTH_RADIUS, 0.3).expect("a sound shape").sdf
}

#[test]
fn a_tooth_between_two_particles_is_still_a_contact() {
    let sdf = tooth();
    // Particles one centimetre apart, the tooth anywhere between them, a little above or below the segment.
    for offset in 0..=100 {
        for lift in [-0.05f32, 0.0, 0.05] {
            let x = -0.01 * offset as f32;
            let (a, b) = (Vector3::new(x, lift, -1.5), Vector3::new(x + 1.0, lift, -1.5));
            let hit = deepest_on_segment(&sdf, a, b, TOOTH_RADIUS, 0.0);
            let hit = hit.unwrap_or_else(|| panic!("tooth missed at offset {x}, lift {lift}"));
            let depth = TOOTH_RADIUS - lift.abs();
            assert!((hit.distance + depth).abs() < 0.02, "offset {x}: depth {} not {depth}", -hit.distance);
            assert!((hit.s + x).abs() < 0.03, "offset {x}: found at {}", hit.s);
            assert!(lift == 0.0 || hit.normal.y * lift > 0.0, "pushed the wrong way at offset {x}");
        }
    }
}

#[test]
fn the_deepest_point_is_as_deep_as_dense_sampling_finds() {
    const SPACING: f32 = 0.05;
    /// Refinement leaves a quarter of an eighth of the spacing on either side, at slope 1.
    const REFINED: f32 = SPACING / 8.0 + 1e-4;
    let sdf = tooth();
    let mut random = Random::new(21);
    let (low, high) = (Vector3::new(-0.8, -0.8, -3.6), Vector3::new(0.8, 0.8, 0.5));
    let mut hits = 0;
    for _ in 0..5_000 {
        let (a, b) = (random.in_box(low, high), random.in_box(low, high));
        let threshold = random.between(-0.02, 0.1);
        let dense = (0..=2_000).map(|n| sdf.distance(a.lerp(&b, n as f32 / 2_000.0))).fold(f32::INFINITY, f32::min);
        match deepest_on_segment(&sdf, a, b, SPACING, threshold) {
            Some(hit) => {
                hits += 1;
                assert!(hit.distance < threshold && (0.0..=1.0).contains(&hit.s));
                assert!(hit.distance <= dense + REFINED, "{a:?} {b:?}: {} but {dense}", hit.distance);
                assert!((hit.normal.norm() - 1.0).abs() < 1e-5);
            }
            None => assert!(dense >= threshold - 0.5 * SPACING, "missed {dense} under {threshold}: {a:?} {b:?}"),
        }
    }
    assert!(hits > 500, "the case must meet the tooth often: {hits}");
}

#[test]
fn a_segment_of_no_length_is_a_point_and_one_that_is_not_a_number_is_no_contact() {
    let sdf = tooth();
    let inside = Vector3::new(0.01, 0.0, -1.0);
    let hit = deepest_on_segment(&sdf, inside, inside, 0.05, 0.0).expect("inside");
    assert_eq!(hit.distance, sdf.distance(inside));
    let nan = Vector3::repeat(f32::NAN);
    assert!(deepest_on_segment(&sdf, nan, inside, 0.05, 0.0).is_none());
    assert!(deepest_on_segment(&sdf, inside, inside + Vector3::x(), 0.0, 0.0).is_some(), "a spacing of zero ends");
}
