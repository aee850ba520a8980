//! Poses over a step.

use collision::{MovingSolid, Shape, Solid, SolidPose};
use nalgebra::{Isometry3, Point3, Vector3};

use crate::random::Random;

/// Products of numbers near ten in double precision.
const ROUND_OFF: f64 = 1e-9;
const DT: f64 = 0.01;

fn poses(random: &mut Random) -> SolidPose {
    let mut vector = |r: f32| random.in_box(Vector3::repeat(-r), Vector3::repeat(r)).cast::<f64>();
    let from = Isometry3::new(vector(10.0), vector(2.0));
    SolidPose { from, to: Isometry3::new(vector(1.0), vector(0.3)) * from }
}

#[test]
fn a_pose_is_blended_from_its_start_to_its_end() {
    let mut random = Random::new(51);
    for _ in 0..200 {
        let pose = poses(&mut random);
        for (alpha, end) in [(0.0, pose.from), (1.0, pose.to)] {
            assert!((pose.at(alpha).to_homogeneous() - end.to_homogeneous()).norm() < ROUND_OFF);
        }
    }
}

#[test]
fn velocity_is_the_way_of_the_material_point_over_the_step() {
    let mut random = Random::new(52);
    for _ in 0..200 {
        let pose = poses(&mut random);
        let material = Point3::from(random.in_box(Vector3::repeat(-2.0), Vector3::repeat(2.0)).cast::<f64>());
        let (start, end) = (pose.from * material, pose.to * material);
        let v = pose.velocity_at(end.coords, DT);
        assert!((v * DT - (end - start)).norm() < ROUND_OFF);
        assert_eq!(pose.velocity_at(end.coords, 0.0), Vector3::zeros());
        assert!((pose.velocity_field(DT).at(end.coords) - v).norm() * DT < ROUND_OFF);
        assert_eq!(pose.velocity_field(0.0).at(end.coords), Vector3::zeros());
    }
}

#[test]
fn no_point_of_the_solid_travels_farther_than_stated() {
    let shape = Shape::capsule(Vector3::new(-1.0, 0.0, 0.0), Vector3::new(1.0, 0.5, 0.0), 0.2);
    let solid = Solid::from_shape("rod", &shape.into(), 0.1, 0.2, 0.3).expect("a sound shape");
    let mut random = Random::new(53);
    for _ in 0..200 {
        let moving = MovingSolid { solid: &solid, pose: poses(&mut random) };
        let p = Point3::from(random.in_box(solid.sdf.bounds().min, solid.sdf.bounds().max).cast::<f64>());
        let path: f64 = (0..50)
            .map(|n| (moving.pose.at((n + 1) as f64 / 50.0) * p - moving.pose.at(n as f64 / 50.0) * p).norm())
            .sum();
        assert!(path <= moving.max_displacement() + ROUND_OFF);
    }
    let still = MovingSolid { solid: &solid, pose: SolidPose::still(Isometry3::identity()) };
    assert_eq!(still.max_displacement(), 0.0);
}

#[test]
fn distance_at_the_end_is_that_of_the_solid_moved() {
    let shape = Shape::sphere(Vector3::zeros(), 1.0);
    let solid = Solid::from_shape("ball", &shape.into(), 0.1, 1.0, 0.3).expect("a sound shape");
    let mut random = Random::new(54);
    for _ in 0..200 {
        let moving = MovingSolid { solid: &solid, pose: poses(&mut random) };
        let center = moving.pose.to.translation.vector;
        let p = center + random.in_box(Vector3::repeat(-0.85), Vector3::repeat(0.85)).cast::<f64>();
        let expected = (p - center).norm() as f32 - 1.0;
        // At its centre a ball's distance has a cone's tip, which a grid blunts by most of a cell.
        let blunt = if expected < -0.7 { 0.1 } else { 0.02 };
        assert!((moving.distance_at_end(p) - expected).abs() <= blunt);
        let q = moving.pose.solid_from_world(1.0) * Point3::from(p.cast::<f32>());
        assert!((q.coords.norm() - 1.0 - expected).abs() < 1e-4);
    }
}
