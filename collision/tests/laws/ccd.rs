//! Continuous detection of segments against moving surfaces, tried against time cut into thousands of pieces.

use crate::mesh_bake::unsigned;
use crate::meshes;
use crate::random::Random;
use collision::SolidPose;
use collision::ccd::first_touch;
use collision::segment_pair::{Sweep, between, closest_points};
use collision::surface::Surface;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

/// Distance that counts as a touch, cm.
const TOLERANCE: f64 = 1e-3;

/// Pieces a step is cut into by the reference.
const PIECES: usize = 2_000;

fn vector(random: &mut Random, size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| f64::from(random.between(-1.0, 1.0)) * size)
}

fn pose(random: &mut Random, shift: f64, turn: f64) -> SolidPose {
    let from = Isometry3::from_parts(
        Translation3::from(vector(random, shift)),
        UnitQuaternion::from_scaled_axis(vector(random, 3.0)),
    );
    let to = Isometry3::from_parts(
        Translation3::from(from.translation.vector + vector(random, shift)),
        UnitQuaternion::from_scaled_axis(vector(random, turn)) * from.rotation,
    );
    SolidPose { from, to }
}

/// The segment in the solid's frame at a fraction of the step.
fn seen(pose: &SolidPose, sweep: &Sweep, time: f64) -> [Vector3<f64>; 2] {
    let pose = pose.at(time);
    between(&sweep.start, &sweep.end, time).map(|x| pose.inverse_transform_point(&Point3::from(x)).coords)
}

/// The first piece of the step in which the segment is found in the surface.
fn first_found(surface: &Surface, pose: &SolidPose, sweep: &Sweep) -> Option<f64> {
    (0..=PIECES).map(|k| k as f64 / PIECES as f64).find(|&time| surface.is_hit_by(&seen(pose, sweep, time)))
}

fn surfaces() -> Vec<Surface> {
    // A tooth of two millimetres, a blade, a ring.
    [meshes::cuboid([0.1, 0.1, 2.0]), meshes::cuboid([1.5, 0.02, 1.0]), meshes::torus(1.0, 0.3, 24, 12)]
        .iter()
        .map(|(points, triangles)| Surface::new(points, triangles).expect("a good mesh"))
        .collect()
}

#[test]
fn no_touch_is_missed_and_none_is_late() {
    let mut random = Random::new(41);
    let (mut touches, mut misses) = (0, 0);
    for surface in surfaces() {
        for _ in 0..1_000 {
            let pose = pose(&mut random, 2.0, 2.0);
            let a = vector(&mut random, 1.5);
            let b = a + vector(&mut random, 0.8);
            let sweep = Sweep { start: [a, b], end: [a, b].map(|p| p + vector(&mut random, 0.5)) };
            let hit = first_touch(&surface, &pose, &sweep, TOLERANCE);
            match first_found(&surface, &pose, &sweep) {
                Some(time) => {
                    touches += 1;
                    let hit = hit.expect("a touch was missed");
                    assert!(hit.time <= time, "reported at {} what was there at {time}", hit.time);
                }
                None => misses += 1,
            }
        }
    }
    assert!(touches > 200 && misses > 200, "{touches} touches, {misses} misses: the law was hardly tried");
}

#[test]
fn what_is_reported_comes_within_the_tolerance() {
    let mut random = Random::new(42);
    let mut hits = 0;
    for surface in surfaces() {
        for _ in 0..1_000 {
            let pose = pose(&mut random, 2.0, 2.0);
            let a = vector(&mut random, 1.5);
            let sweep = Sweep { start: [a, a + vector(&mut random, 0.8)], end: [a, a + vector(&mut random, 0.8)] };
            let Some(hit) = first_touch(&surface, &pose, &sweep, TOLERANCE) else { continue };
            hits += 1;
            let segment = seen(&pose, &sweep, hit.time);
            let on_segment = segment[0] + (segment[1] - segment[0]) * hit.s;
            let distance = (on_segment - hit.point).norm();
            assert!(distance <= TOLERANCE, "{distance} cm off");
            // The point is on the triangle named.
            let [corners, _] = surface.corners(hit.triangle as usize);
            let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).normalize();
            assert!(normal.dot(&(hit.point - corners[0])).abs() < 1e-9);
            assert!((hit.normal.norm() - 1.0).abs() < 1e-9);
            // And up to then the segment is free.
            let before = (0..100).map(|k| hit.time * f64::from(k) / 100.0);
            assert!(hit.time == 0.0 || before.into_iter().all(|t| !surface.is_hit_by(&seen(&pose, &sweep, t))));
        }
    }
    assert!(hits > 200, "{hits} hits: the law was hardly tried");
}

#[test]
fn a_tooth_between_two_particles_is_found_at_every_offset() {
    // A tooth of two millimetres goes through a segment of eight in one step, far from either end.
    let (points, triangles) = meshes::cuboid([0.1, 0.1, 2.0]);
    let surface = Surface::new(&points, &triangles).expect("a good mesh");
    for k in 0..=1_000 {
        let along = -0.5 + 0.001 * f64::from(k);
        let from = Isometry3::translation(along, -2.0, 0.0);
        let pose = SolidPose { from, to: Isometry3::translation(along, 3.0, 0.0) };
        let segment = [Vector3::new(-0.4, 0.0, 0.0), Vector3::new(0.4, 0.0, 0.0)];
        let hit = first_touch(&surface, &pose, &Sweep::still(segment), TOLERANCE);
        // Its front is a face, so all of it arrives at once, at 1.9 of 5 cm.
        let meets = along.abs() <= 0.5;
        assert_eq!(hit.is_some(), meets, "offset {along}");
        assert!(hit.is_none_or(|hit| (hit.time - 0.38).abs() < TOLERANCE));
    }
}

#[test]
fn a_blade_that_spins_past_in_one_step_is_met() {
    // Half a turn: at both ends of the step the blade is clear of the segment, and on the chord its tip stays clear too.
    let (points, triangles) = meshes::cuboid([2.0, 0.02, 0.5]);
    let surface = Surface::new(&points, &triangles).expect("a good mesh");
    let turned = |angle: f64| Isometry3::rotation(Vector3::z() * angle);
    let pose = SolidPose { from: turned(0.3), to: turned(2.9) };
    let out = |radius: f64| Sweep::still([Vector3::new(0.0, radius, -0.2), Vector3::new(0.0, radius, 0.2)]);
    let hit = first_touch(&surface, &pose, &out(1.9), TOLERANCE).expect("the blade sweeps over it");
    let angle = 0.3 + 2.6 * hit.time;
    assert!((angle - std::f64::consts::FRAC_PI_2).abs() < 0.02, "met at {angle} rad");
    assert!(first_touch(&surface, &pose, &out(2.1), TOLERANCE).is_none(), "out of its reach");
}

#[test]
fn a_shared_motion_of_solid_and_hair_changes_nothing() {
    let mut random = Random::new(43);
    let surface = &surfaces()[2];
    for _ in 0..200 {
        let pose = pose(&mut random, 1.0, 1.0);
        let a = vector(&mut random, 1.5);
        let sweep = Sweep { start: [a, a + vector(&mut random, 0.8)], end: [a, a + vector(&mut random, 0.8)] };
        let shift = vector(&mut random, 5.0);
        let moved = SolidPose { from: pose.from, to: Translation3::from(shift) * pose.to };
        let with = Sweep { start: sweep.start, end: sweep.end.map(|p| p + shift) };
        let (one, other) =
            (first_touch(surface, &pose, &sweep, TOLERANCE), first_touch(surface, &moved, &with, TOLERANCE));
        assert_eq!(one.is_some(), other.is_some());
        assert!(one.zip(other).is_none_or(|(one, other)| (one.time - other.time).abs() < 1e-2));
    }
}

#[test]
fn the_boxes_hide_no_triangle_from_a_segment() {
    const PARTS: usize = 64;
    /// Single precision of the plain distance, cm.
    const ROUND_OFF: f64 = 1e-5;
    let mut random = Random::new(45);
    let mut within = 0;
    for mesh in [meshes::torus(1.0, 0.3, 24, 12), meshes::cuboid([0.1, 0.1, 2.0]), meshes::cuboid([1.5, 0.02, 1.0])] {
        let surface = Surface::new(&mesh.0, &mesh.1).expect("a good mesh");
        for _ in 0..1_000 {
            let a = vector(&mut random, 2.0);
            let segment = [a, a + vector(&mut random, 1.5)];
            let length = (segment[1] - segment[0]).norm();
            // No box, no segment: points against every triangle.
            let plain = (0..=PARTS)
                .map(|k| segment[0].lerp(&segment[1], k as f64 / PARTS as f64))
                .map(|p| f64::from(unsigned(&mesh, p.cast())))
                .fold(f64::INFINITY, f64::min);
            let found = surface.distance_within(&segment, 10.0);
            assert!(found <= plain + ROUND_OFF, "{found} where a point is {plain} away");
            assert!(found >= plain - 0.5 * length / PARTS as f64 - ROUND_OFF, "{found} where points are {plain} away");
            let reach = f64::from(random.between(0.0, 1.0));
            assert_eq!(surface.is_within(&segment, reach), found <= reach, "within {reach}, at {found}");
            within += usize::from(found <= reach);
        }
    }
    assert!(within > 500 && within < 2_500, "{within} of 3000 within reach: the law was hardly tried");
}

#[test]
fn units_do_not_matter() {
    let scaled = |pose: &Isometry3<f64>, by: f64| {
        Isometry3::from_parts(Translation3::from(pose.translation.vector * by), pose.rotation)
    };
    let (points, triangles) = meshes::torus(1.0, 0.3, 24, 12);
    let plain = Surface::new(&points, &triangles).expect("a good mesh");
    // Powers of two scale every number exactly: a millionth and a million.
    for by in [2.0_f64.powi(-20), 2.0_f64.powi(20)] {
        let larger: Vec<_> = points.iter().map(|p| p.map(|x| x * by as f32)).collect();
        let larger = Surface::new(&larger, &triangles).expect("a good mesh");
        let mut random = Random::new(44);
        let mut hits = 0;
        for _ in 0..500 {
            let pose = pose(&mut random, 2.0, 2.0);
            let a = vector(&mut random, 1.5);
            let sweep = Sweep { start: [a, a + vector(&mut random, 0.8)], end: [a, a + vector(&mut random, 0.8)] };
            let large_pose = SolidPose { from: scaled(&pose.from, by), to: scaled(&pose.to, by) };
            let large = Sweep { start: sweep.start.map(|x| x * by), end: sweep.end.map(|x| x * by) };
            let one = first_touch(&plain, &pose, &sweep, TOLERANCE);
            let other = first_touch(&larger, &large_pose, &large, TOLERANCE * by);
            hits += usize::from(one.is_some());
            assert_eq!(one.map(|h| (h.time, h.triangle, h.point * by)), other.map(|h| (h.time, h.triangle, h.point)));
        }
        assert!(hits > 50, "{hits} hits: the law was hardly tried");
    }
}

#[test]
fn a_face_that_moves_meets_a_segment_that_rests() {
    let triangles = [[0, 1, 2]];
    let at = |z: f32| [[-1.0, -1.0, z], [1.0, -1.0, z], [0.0, 1.0, z]];
    let surface = Surface::moving(&at(0.0), &at(2.0), &triangles).expect("a good mesh");
    let still = SolidPose::still(Isometry3::identity());
    let flat = |z: f64| Sweep::still([Vector3::new(-0.1, 0.0, z), Vector3::new(0.1, 0.0, z)]);
    let hit = first_touch(&surface, &still, &flat(0.5), TOLERANCE).expect("met on the way");
    assert!((hit.time - 0.25).abs() < TOLERANCE && (hit.normal - Vector3::z()).norm() < 1e-6);
    assert!(first_touch(&surface, &still, &flat(2.1), TOLERANCE).is_none());
    // A segment carried along is never met.
    let along = Sweep { start: flat(0.5).start, end: flat(2.5).start };
    assert!(first_touch(&surface, &still, &along, TOLERANCE).is_none());
}

#[test]
fn what_is_broken_meets_nothing_or_is_refused() {
    let (points, triangles) = meshes::cuboid([1.0; 3]);
    let surface = Surface::new(&points, &triangles).expect("a good mesh");
    let still = SolidPose::still(Isometry3::identity());
    let broken = Sweep { start: [Vector3::zeros(); 2], end: [Vector3::repeat(f64::NAN), Vector3::zeros()] };
    assert!(first_touch(&surface, &still, &broken, TOLERANCE).is_none());
    let lost = SolidPose { from: Isometry3::identity(), to: Isometry3::translation(f64::INFINITY, 0.0, 0.0) };
    assert!(first_touch(&surface, &lost, &Sweep::still([Vector3::zeros(); 2]), TOLERANCE).is_none());
    assert!(Surface::new(&[], &[]).is_err());
    assert!(Surface::new(&points, &[[0, 1, 99]]).is_err());
    assert!(Surface::new(&[[f32::NAN; 3]], &[[0, 0, 0]]).is_err());
    assert!(Surface::moving(&points, &points[1..], &triangles).is_err());
    // A triangle of no area is a segment, or a point.
    let line = Surface::new(&[[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], &[[0, 1, 2]]).expect("no harm in it");
    let across = Sweep {
        start: [Vector3::new(0.5, 1.0, -1.0), Vector3::new(0.5, 1.0, 1.0)],
        end: [Vector3::new(0.5, -1.0, -1.0), Vector3::new(0.5, -1.0, 1.0)],
    };
    let hit = first_touch(&line, &still, &across, TOLERANCE).expect("an edge is met like any other");
    assert!((hit.time - 0.5).abs() < TOLERANCE);
    let axis = [Vector3::zeros(), Vector3::new(2.0, 0.0, 0.0)];
    assert!(closest_points(&axis, &between(&across.start, &across.end, hit.time)).distance2.sqrt() <= TOLERANCE);
}
