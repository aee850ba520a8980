//! Deforming bodies: exact at their keys, continuous between them, bounds that hold over time, and rigid motion as a
//! special case (MS08 §5.1).

use collision::{
    BakeParams, DeformingSolid, DistanceField, Error, KeyedMesh, MovingBody, MovingDeformingSolid, MovingSolid, Solid,
    SolidPose, deepest_on_segment,
};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use crate::meshes::{sphere, torus};
use crate::random::Random;

const CELL_CM: f32 = 0.1;
/// A few units in the last place of coordinates of a few centimetres.
const ROUND_OFF_CM: f32 = 1e-5;

fn moved(points: &[[f32; 3]], by: &Isometry3<f64>) -> Vec<[f32; 3]> {
    points.iter().map(|&p| (by.cast::<f32>() * Point3::from(p)).coords.into()).collect()
}

fn bake(times_s: &[f64], positions: &[Vec<[f32; 3]>], triangles: &[[u32; 3]]) -> DeformingSolid {
    let mesh = KeyedMesh { times_s, positions, triangles };
    DeformingSolid::from_keys("body", mesh, BakeParams::with_cell(CELL_CM), 0.3).expect("a sound body")
}

/// A ball that is squeezed, turned and moved over three keys a tenth of a second apart.
fn wobbling() -> DeformingSolid {
    let (points, triangles) = sphere(1.0, 12);
    let at = |squeeze: f32, pose: Isometry3<f64>| {
        let points: Vec<_> = points.iter().map(|p| [p[0] * squeeze, p[1] / squeeze, p[2]]).collect();
        moved(&points, &pose)
    };
    let keys = [
        at(1.0, Isometry3::identity()),
        at(1.2, Isometry3::new(Vector3::new(0.5, 0.2, 0.0), Vector3::new(0.0, 0.0, 0.3))),
        at(0.9, Isometry3::new(Vector3::new(0.4, -0.3, 0.6), Vector3::new(0.2, 0.0, 0.3))),
    ];
    bake(&[0.0, 0.1, 0.2], &keys, &triangles)
}

fn random_point(random: &mut Random, reach: f32) -> Vector3<f32> {
    random.in_box(Vector3::repeat(-reach), Vector3::repeat(reach))
}

#[test]
fn a_rigid_motion_given_as_keys_is_that_of_the_rigid_solid() {
    let (points, triangles) = torus(1.5, 0.4, 48, 24);
    let rigid = Solid::from_mesh("ring", &points, &triangles, BakeParams::with_cell(CELL_CM), 0.3).unwrap();
    let cases = [
        ("moved", Isometry3::translation(1.3, -0.4, 0.2)),
        ("turned", Isometry3::new(Vector3::zeros(), Vector3::new(0.1, 0.05, 0.15))),
        ("moved and turned", Isometry3::new(Vector3::new(0.6, 0.3, 0.0), Vector3::new(0.1, 0.05, 0.15))),
    ];
    for (name, end) in cases {
        let keys = bake(&[0.0, 0.04], &[points.clone(), moved(&points, &end)], &triangles);
        let still = SolidPose::still(Isometry3::identity());
        let deforming = MovingDeformingSolid { solid: &keys, pose: still, from_s: 0.0, to_s: 0.04 };
        let rigid = MovingSolid { solid: &rigid, pose: SolidPose { from: Isometry3::identity(), to: end } };
        // A chord lies r angle²/8 inside its arc, on both ways; each field errs by its grid.
        let angle = end.rotation.angle() as f32;
        let tolerance = 2.0 * 1.9 * angle * angle / 8.0 + keys.keys()[0].max_error() + rigid.solid.sdf.max_error();
        let mut random = Random::new(7);
        let (mut worst, mut n_near) = (0.0f32, 0);
        for k in 0..20_000 {
            let p = random_point(&mut random, 3.0).cast::<f64>();
            let alpha = f64::from(k % 11) / 10.0;
            let truth = {
                let p = rigid.pose.at(alpha).inverse_transform_point(&Point3::from(p));
                rigid.solid.sdf.distance(p.coords.cast())
            };
            if truth.abs() < 0.2 {
                n_near += 1;
                worst = worst.max((deforming.distance_at(p, alpha) - truth).abs());
            }
        }
        println!("{name}: {n_near} points near the surface, largest difference {worst} cm of {tolerance} cm");
        assert!(n_near > 500 && worst < tolerance, "{name}: {worst} of {tolerance}");
    }
}

#[test]
fn a_body_is_exact_at_its_keys_and_continuous_between_them() {
    /// Time across which the field may change by no more than its fastest point moves, s.
    const INSTANT_S: f64 = 1e-5;
    let body = wobbling();
    let mut random = Random::new(1);
    for _ in 0..2000 {
        let p = random_point(&mut random, 2.0);
        for (key, &t) in body.times_s().iter().enumerate() {
            assert_eq!(body.at(t).distance(p).to_bits(), body.keys()[key].distance(p).to_bits());
            let jump = (body.at(t + INSTANT_S).distance(p) - body.at(t - INSTANT_S).distance(p)).abs();
            // Weights, feet and surface each move by at most the longest way.
            let most = 3.0 * body.max_speed(t - INSTANT_S, t + INSTANT_S) * 2.0 * INSTANT_S;
            assert!(jump <= most as f32 + ROUND_OFF_CM, "{jump} cm across key {key} at {p:?}");
        }
    }
}

#[test]
fn a_distance_bound_holds_over_the_time_its_movement_is_taken_off() {
    let body = wobbling();
    let pose = SolidPose { from: Isometry3::identity(), to: Isometry3::new(Vector3::x() * 0.3, Vector3::z() * 0.1) };
    // The step begins and ends between keys and spans one.
    let moving = MovingDeformingSolid { solid: &body, pose, from_s: 0.03, to_s: 0.17 };
    let mut random = Random::new(3);
    let mut tightest = f32::MAX;
    for _ in 0..20_000 {
        let p = random_point(&mut random, 3.0).cast::<f64>();
        let (a, b) = (f64::from(random.unit()), f64::from(random.unit()));
        let (early, late) = (a.min(b), a.max(b));
        let in_body = moving.pose.at(early).inverse_transform_point(&Point3::from(p)).coords.cast();
        let bound = moving.field_at(early).lower_bound(in_body) - (moving.max_displacement() * (late - early)) as f32;
        let then = moving.distance_at(p, late);
        // A sample may understate the distance by as much as it may overstate it.
        assert!(bound <= then + moving.field_at(late).max_error(), "bound {bound} above {then} at {p:?}");
        if bound > 0.0 {
            tightest = tightest.min(then - bound);
        }
    }
    println!("tightest bound: {tightest} cm below the distance");
}

#[test]
fn the_deepest_point_of_a_segment_is_that_of_dense_sampling() {
    const SPACING_CM: f32 = 0.1;
    /// Refinement between samples a tenth apart ends at an eightieth; a distance changes by at most about that.
    const CLOSE_CM: f32 = 0.02;
    let body = wobbling();
    let mut random = Random::new(9);
    let mut hits = 0;
    for k in 0..3000 {
        let field = body.at(0.2 * f64::from(k % 17) / 16.0);
        let (a, b) = (random_point(&mut random, 2.0), random_point(&mut random, 2.0));
        let dense = (0..=400).map(|k| field.distance(a.lerp(&b, k as f32 / 400.0))).fold(f32::MAX, f32::min);
        match deepest_on_segment(&field, a, b, SPACING_CM, 0.0) {
            Some(hit) => {
                hits += 1;
                assert!((hit.distance - dense).abs() < CLOSE_CM, "{} against {dense}", hit.distance);
                assert!((hit.normal.norm() - 1.0).abs() < ROUND_OFF_CM);
            }
            None => assert!(dense > -CLOSE_CM, "missed {dense}"),
        }
    }
    assert!(hits > 500, "only {hits} segments met the body");
}

#[test]
fn surface_velocity_is_that_of_the_vertices_and_of_what_carries_them() {
    /// The lattice smooths the motion between its nodes, and a key's surface is half a way from where it is read: share
    /// of the speed.
    const SHARE: f64 = 0.1;
    let (points, triangles) = sphere(1.0, 16);
    // Turning about y by 0.2 radian in a tenth of a second: a surface that moves along itself.
    let turn = Isometry3::rotation(Vector3::y() * 0.2);
    let body = bake(&[0.0, 0.1], &[points.clone(), moved(&points, &turn)], &triangles);
    let pose = SolidPose { from: Isometry3::identity(), to: Isometry3::translation(0.0, 0.1, 0.0) };
    // The body's clock runs at half speed: 0.05 s of it over a step of 0.1 s.
    let moving = MovingDeformingSolid { solid: &body, pose, from_s: 0.0, to_s: 0.05 };
    for p in points.iter().map(|&p| Vector3::from(p).cast::<f64>()) {
        let world = p + Vector3::y() * 0.05;
        let truth = Vector3::y().cross(&p) * (0.2 / 0.1 * 0.5) + Vector3::y();
        let error = (moving.velocity_at(world, 0.5, 0.1) - truth).norm();
        assert!(error < SHARE * truth.norm(), "{error} cm/s at {p:?}");
    }
    assert_eq!(body.velocity(Vector3::x(), 0.2), Vector3::zeros(), "still after the last key");
    assert_eq!(body.velocity(Vector3::x(), -0.1), Vector3::zeros(), "still before the first");
}

#[test]
fn a_body_carried_rigidly_moves_as_a_rigid_one() {
    let (points, triangles) = sphere(1.0, 12);
    let body = bake(&[0.0, 1.0], &[points.clone(), points.clone()], &triangles);
    let rigid = Solid::from_mesh("ball", &points, &triangles, BakeParams::with_cell(CELL_CM), 0.3).unwrap();
    let to = Isometry3::from_parts(
        Vector3::new(0.4, 0.0, 0.1).into(),
        UnitQuaternion::from_scaled_axis(Vector3::new(0.3, 0.0, 0.0)),
    );
    let pose = SolidPose { from: Isometry3::identity(), to };
    let deforming = MovingDeformingSolid { solid: &body, pose, from_s: 0.0, to_s: 0.5 };
    let rigid = MovingSolid { solid: &rigid, pose };
    let mut random = Random::new(5);
    for _ in 0..2000 {
        let p = random_point(&mut random, 2.0).cast::<f64>();
        assert!((deforming.distance_at(p, 1.0) - rigid.distance_at_end(p)).abs() < ROUND_OFF_CM);
        let apart = deforming.velocity_at(p, 0.3, 0.01) - MovingBody::velocity_at(&rigid, p, 0.3, 0.01);
        assert!(apart.norm() < f64::from(ROUND_OFF_CM));
    }
    assert_eq!(deforming.max_displacement(), MovingBody::max_displacement(&rigid));
}

#[test]
fn a_bake_is_the_same_bytes_for_any_number_of_threads() {
    let sampled = |n_threads: usize| -> Vec<u32> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        let body = pool.install(wobbling);
        let mut random = Random::new(2);
        (0..2000).map(|k| body.at(f64::from(k) * 1e-4).distance(random_point(&mut random, 2.0)).to_bits()).collect()
    };
    let one = sampled(1);
    assert_eq!(one, sampled(2));
    assert_eq!(one, sampled(8));
}

#[test]
fn keys_that_are_not_a_motion_are_refused_by_name() {
    let (points, triangles) = sphere(1.0, 4);
    let key = || points.clone();
    let check = |times_s: &[f64], positions: &[Vec<[f32; 3]>]| {
        let mesh = KeyedMesh { times_s, positions, triangles: &triangles };
        DeformingSolid::from_keys("body", mesh, BakeParams::with_cell(0.2), 0.3).unwrap_err()
    };
    assert_eq!(check(&[0.0], &[key()]), Error::TooFewKeys { n_keys: 1 });
    assert_eq!(check(&[0.0, 1.0, 2.0], &[key(), key()]), Error::KeyTimes { n_keys: 2, n_times: 3 });
    let unordered = Error::UnorderedKeys { key: 1, time_s: 1.0, before_s: 1.0 };
    assert_eq!(check(&[1.0, 1.0], &[key(), key()]), unordered);
    assert!(matches!(check(&[f64::NAN, 1.0], &[key(), key()]), Error::UnorderedKeys { key: 1, .. }));
    let ragged = check(&[0.0, 1.0], &[key(), points[1..].to_vec()]);
    assert_eq!(ragged, Error::RaggedKey { key: 1, n_vertices: points.len() - 1, expected: points.len() });
    let flat: Vec<_> = points.iter().map(|p| [p[0], 0.0, p[2]]).collect();
    assert!(matches!(check(&[0.0, 1.0], &[key(), flat]), Error::BadKey { key: 1, .. }));
}
