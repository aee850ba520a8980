//! Grids baked from closed forms, and the closed forms themselves.

use collision::{Bounds, Error, Shape, ShapeUnion, SignedDistanceField, bake_from_fn};
use nalgebra::Vector3;

use crate::random::Random;

const CELL: f32 = 0.05;
/// Sums of a few products of numbers near 1 in single precision.
const ROUND_OFF: f32 = 2e-5;

fn shapes() -> Vec<Shape> {
    let v = Vector3::new;
    vec![
        Shape::sphere(v(0.1, 0.0, -0.2), 0.8),
        Shape::capsule(v(-0.7, 0.0, 0.0), v(0.5, 0.4, 0.3), 0.2),
        Shape::Capsule { a: v(0.0, 0.0, 0.0), b: v(0.0, 0.0, -1.5), radius_a: 0.3, radius_b: 0.1 },
        Shape::Box { center: v(0.0, 0.1, 0.0), half: v(0.5, 0.3, 0.7), rounding: 0.1 },
        Shape::Torus { center: v(0.0, 0.0, 0.0), major: 0.8, minor: 0.2 },
        Shape::Ellipsoid { center: v(0.0, 0.0, 0.0), radii: v(0.6, 0.9, 0.4) },
    ]
}

fn bake(shape: &Shape) -> SignedDistanceField {
    bake_from_fn(shape.bounds().grown(0.3), CELL, |p| shape.distance(p)).expect("a sound shape")
}

/// Least distance to points strewn densely over the surface, found by marching random points onto it.
fn brute_force(shape: &Shape, cloud: &[Vector3<f32>], p: Vector3<f32>) -> f32 {
    let least = cloud.iter().map(|c| (c - p).norm()).fold(f32::INFINITY, f32::min);
    if shape.distance(p) < 0.0 { -least } else { least }
}

#[test]
fn every_closed_form_is_the_distance_to_the_nearest_point_of_its_own_surface() {
    /// 60 000 points on a few square centimetres lie about 0.01 cm apart; the nearest is off by far less than that.
    const CLOUD_GAP: f32 = 0.012;
    for shape in shapes() {
        let mut random = Random::new(7);
        let bounds = shape.bounds().grown(0.2);
        let mut cloud = Vec::new();
        while cloud.len() < 60_000 {
            // Newton steps along a numerical gradient end on the zero set, whatever the distance claims elsewhere.
            let mut p = random.in_box(bounds.min, bounds.max);
            for _ in 0..8 {
                let h = 1e-3;
                let slope = |e: Vector3<f32>| (shape.distance(p + e * h) - shape.distance(p - e * h)) / (2.0 * h);
                let g = Vector3::new(slope(Vector3::x()), slope(Vector3::y()), slope(Vector3::z()));
                p -= g * (shape.distance(p) / g.norm_squared().max(0.1));
            }
            if shape.distance(p).abs() < 1e-4 {
                cloud.push(p);
            }
        }
        for _ in 0..100 {
            let p = random.in_box(bounds.min, bounds.max);
            let (claimed, found) = (shape.distance(p), brute_force(&shape, &cloud, p));
            assert!((claimed - found).abs() < CLOUD_GAP, "{shape:?} at {p:?}: {claimed} but {found}");
        }
    }
}

#[test]
fn a_grid_differs_from_the_closed_form_by_less_than_half_a_cell() {
    for shape in shapes() {
        let sdf = bake(&shape);
        let mut random = Random::new(1);
        let b = sdf.bounds();
        for _ in 0..20_000 {
            let p = random.in_box(b.min, b.max);
            let (grid, exact) = (sdf.distance(p), shape.distance(p));
            assert!((grid - exact).abs() < 0.5 * CELL, "{shape:?} at {p:?}: {grid} but {exact}");
            assert!(grid - exact <= sdf.max_error() || exact < -CELL, "{shape:?}: stated error exceeded at {p:?}");
            if exact.abs() > 0.5 * CELL {
                assert_eq!(grid < 0.0, exact < 0.0, "{shape:?}: wrong sign at {p:?}");
            }
        }
    }
}

#[test]
fn outside_the_grid_the_distance_is_a_lower_bound_and_at_least_the_distance_to_the_box() {
    for shape in shapes() {
        let sdf = bake(&shape);
        let b = sdf.bounds();
        let mut random = Random::new(2);
        for _ in 0..20_000 {
            let p = random.in_box(b.min.add_scalar(-5.0), b.max.add_scalar(5.0));
            let to_box = (p - p.sup(&b.min).inf(&b.max)).norm();
            let (d, exact) = (sdf.distance(p), shape.distance(p));
            if exact > -CELL {
                assert!(sdf.lower_bound(p) <= exact + ROUND_OFF, "{shape:?} at {p:?}");
            }
            if to_box > 0.0 {
                assert!(d <= exact + sdf.max_error() + ROUND_OFF, "{shape:?} at {p:?}");
                assert!(d >= to_box - ROUND_OFF, "{shape:?} at {p:?}");
            }
        }
    }
}

#[test]
fn the_field_is_continuous_across_the_faces_of_its_grid() {
    let sdf = bake(&shapes()[1]);
    let b = sdf.bounds();
    let mut random = Random::new(3);
    let h = 1e-4;
    for _ in 0..2_000 {
        let mut p = random.in_box(b.min, b.max);
        let axis = (random.unit() * 3.0) as usize;
        p[axis] = b.max[axis];
        let (mut inside, mut outside) = (p, p);
        inside[axis] -= h;
        outside[axis] += h;
        assert!((sdf.distance(inside) - sdf.distance(outside)).abs() < 4.0 * h);
    }
}

#[test]
fn the_gradient_is_that_of_the_interpolant() {
    /// Central differences over a two-hundredth of a cell, with values near 1 rounded to 6e-8.
    const DIFFERENCE_ERROR: f32 = 2e-2;
    for shape in shapes() {
        let sdf = bake(&shape);
        let b = sdf.bounds();
        let mut random = Random::new(4);
        let h = 0.005 * CELL;
        for _ in 0..2_000 {
            // Middle of a cell's range, so that both differences stay within one cell; outside as well.
            let cellwise = |x: f32, o: f32| o + (((x - o) / CELL).floor() + 0.3 + 0.4 * 0.37) * CELL;
            let p = random.in_box(b.min.add_scalar(-1.0), b.max.add_scalar(1.0)).zip_map(&b.min, cellwise);
            let (d, g) = sdf.distance_gradient(p);
            assert!((d - sdf.distance(p)).abs() <= ROUND_OFF);
            for axis in 0..3 {
                let mut e = Vector3::zeros();
                e[axis] = h;
                let slope = (sdf.distance(p + e) - sdf.distance(p - e)) / (2.0 * h);
                assert!((slope - g[axis]).abs() < DIFFERENCE_ERROR, "{shape:?} {p:?} axis {axis}: {slope} {}", g[axis]);
            }
        }
    }
}

#[test]
fn a_normal_has_unit_length_and_leads_outwards_even_where_the_gradient_vanishes() {
    for shape in shapes() {
        let sdf = bake(&shape);
        let mut random = Random::new(5);
        let b = sdf.bounds();
        let mut points: Vec<_> = (0..2_000).map(|_| random.in_box(b.min, b.max)).collect();
        // The middle of a ball, of a box and of a torus: gradients of zero.
        points.push(shape.bounds().center());
        for p in points {
            let (d, n) = sdf.outward_normal(p);
            assert!((n.norm() - 1.0).abs() < ROUND_OFF, "{shape:?} at {p:?}: {n:?}");
            // Farther out there are ridges, from which every way leads closer to something.
            if d.abs() < CELL {
                let h = 0.2 * CELL;
                assert!(shape.distance(p + n * h) > shape.distance(p) - 0.5 * h, "{shape:?} at {p:?}");
            }
        }
    }
}

#[test]
fn a_union_is_the_least_of_its_members_and_smoothing_only_adds_material() {
    let members = shapes();
    let sharp = ShapeUnion::sharp(members.clone());
    let smooth = ShapeUnion { shapes: members.clone(), smoothing: 0.3 };
    let bounds = smooth.bounds().expect("members");
    let mut random = Random::new(6);
    for _ in 0..5_000 {
        let p = random.in_box(bounds.min, bounds.max);
        let q = random.in_box(bounds.min, bounds.max);
        let least = members.iter().map(|s| s.distance(p)).fold(f32::INFINITY, f32::min);
        assert_eq!(sharp.distance(p), least);
        assert!(smooth.distance(p) <= least);
        let (dp, dq) = (smooth.distance(p), smooth.distance(q));
        assert!((dp - dq).abs() <= (p - q).norm() + ROUND_OFF, "blends stay 1-Lipschitz");
    }
}

#[test]
fn a_solid_that_reaches_its_box_or_is_not_finite_is_refused() {
    let ball = Shape::sphere(Vector3::zeros(), 1.0);
    let tight = Bounds::new(Vector3::repeat(-1.0), Vector3::repeat(0.9));
    assert!(matches!(bake_from_fn(tight, 0.1, |p| ball.distance(p)), Err(Error::TouchesBounds { .. })));
    let wide = ball.bounds().grown(0.5);
    assert!(matches!(bake_from_fn(wide, 0.1, |p| p.x.ln()), Err(Error::NonFiniteDistance { .. })));
    for cell in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let refused = bake_from_fn(wide, cell, |p| ball.distance(p));
        assert!(matches!(refused, Err(Error::BadParameter { name: "cell", .. })));
    }
    assert!(matches!(bake_from_fn(wide, 1e-4, |p| ball.distance(p)), Err(Error::TooLarge { .. })));
}
