//! Penalty and friction: conservation, and the two cases of AS16 §7.1.

use collision::cull::DistanceBound;
use collision::friction::slip_factor;
use collision::{PenaltyParams, SegmentContact, Shape, Solid, friction_velocity, penalty_force, penalty_on_segment};
use nalgebra::Vector3;

use crate::random::Random;

/// Sums of a few products in single precision, relative to their size.
const ROUND_OFF: f32 = 1e-5;
const PARAMS: PenaltyParams = PenaltyParams { stiffness: 2.0, damping: 1e-3, skin: 0.05 };

fn unit(random: &mut Random) -> Vector3<f32> {
    random.in_box(Vector3::repeat(-1.0), Vector3::repeat(1.0)).normalize()
}

#[test]
fn a_contact_inside_a_segment_keeps_force_and_moment() {
    let mut random = Random::new(41);
    for _ in 0..1_000 {
        let contact =
            SegmentContact { s: random.unit(), distance: random.between(-0.2, 0.05), normal: unit(&mut random) };
        let (a, b) = (unit(&mut random), unit(&mut random) * 2.0);
        let force = penalty_on_segment(&contact, Vector3::zeros(), Vector3::zeros(), &PARAMS);
        let whole = penalty_force(contact.distance, contact.normal, Vector3::zeros(), &PARAMS);
        assert!((force.on_a + force.on_b - whole).norm() <= ROUND_OFF);
        let moment = a.cross(&force.on_a) + b.cross(&force.on_b);
        assert!((moment - a.lerp(&b, contact.s).cross(&whole)).norm() <= ROUND_OFF);
        assert!((force.normal_force - whole.norm()).abs() <= ROUND_OFF);
    }
}

#[test]
fn a_solid_pushes_and_never_pulls() {
    let n = Vector3::z();
    assert_eq!(penalty_force(0.06, n, Vector3::zeros(), &PARAMS), Vector3::zeros());
    assert!(penalty_force(0.04, n, Vector3::zeros(), &PARAMS).z > 0.0);
    assert!(penalty_force(0.0, n, -n * 10.0, &PARAMS).z > penalty_force(0.0, n, Vector3::zeros(), &PARAMS).z);
    assert_eq!(penalty_force(0.0, n, n * 1e6, &PARAMS), Vector3::zeros());
}

#[test]
fn friction_never_reverses_the_sliding_nor_touches_the_normal_velocity() {
    let mut random = Random::new(42);
    let mut stuck = 0;
    for _ in 0..5_000 {
        let n = unit(&mut random);
        let v = unit(&mut random) * random.between(0.0, 50.0);
        let (force, mass) = (random.between(0.0, 0.5), 1e-4);
        let after = friction_velocity(v, n, 0.3, force, mass, 0.01);
        assert!((after.dot(&n) - v.dot(&n)).abs() <= ROUND_OFF * 50.0);
        let (t0, t1) = (v - n * v.dot(&n), after - n * after.dot(&n));
        assert!(t1.dot(&t0) >= -ROUND_OFF * 2500.0 && t1.norm() <= t0.norm() + ROUND_OFF * 50.0);
        let loss = 0.3 * force * 0.01 / mass;
        let expected = (t0.norm() - loss).max(0.0);
        assert!((t1.norm() - expected).abs() <= ROUND_OFF * 100.0, "{} not {expected}", t1.norm());
        stuck += usize::from(expected == 0.0);
    }
    assert!(stuck > 500 && stuck < 4_500, "both cases must occur: {stuck}");
}

#[test]
fn friction_is_finite_without_speed_mass_or_force() {
    assert_eq!(slip_factor(0.0, 0.3, 1.0, 1e-4, 0.01), 0.0);
    assert_eq!(slip_factor(1.0, 0.3, 1.0, 0.0, 0.01), 0.0);
    assert_eq!(slip_factor(1.0, 0.3, 0.0, 0.0, 0.01), 1.0);
    assert_eq!(slip_factor(1.0, 0.3, -1.0, 1e-4, 0.01), 1.0);
}

#[test]
fn a_strand_cleared_by_its_bound_is_outside_after_any_such_movement() {
    let shape = Shape::sphere(Vector3::zeros(), 1.0);
    let ball = Solid::from_shape("ball", &shape.into(), 0.1, 1.0, 0.3).expect("a sound shape");
    let mut random = Random::new(43);
    let mut cleared = 0;
    for _ in 0..5_000 {
        let p = unit(&mut random) * random.between(1.0, 3.0);
        let mut bound = DistanceBound::at_least(ball.sdf.lower_bound(p));
        let (strand, solid) = (random.between(0.0, 0.5), random.between(0.0, 0.5));
        bound.moved(strand, solid);
        if bound.clears(0.0) {
            cleared += 1;
            // Both in the worst direction.
            let moved = p - unit(&mut random) * strand - unit(&mut random) * solid;
            assert!(shape.distance(moved) > 0.0);
        }
    }
    assert!(cleared > 1_000);
    assert!(!DistanceBound::unknown().clears(0.0));
}
