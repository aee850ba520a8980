//! Grids baked from meshes: against brute force over all triangles, and the meshes that have no inside.

use collision::{BakeParams, Error, Shape, SignedDistanceField, Solid, bake_from_mesh};
use nalgebra::Vector3;
use parry3d::math::Vector;
use parry3d::query::PointQuery;
use parry3d::shape::Triangle;

use crate::meshes::{Mesh, cuboid, sphere, torus};
use crate::random::Random;

/// Sums of a few products of numbers near 1 in single precision.
const ROUND_OFF: f32 = 2e-5;

fn bake((points, triangles): &Mesh, cell: f32) -> SignedDistanceField {
    bake_from_mesh(points, triangles, BakeParams::with_cell(cell)).expect("a closed mesh")
}

pub(crate) fn unsigned((points, triangles): &Mesh, p: Vector3<f32>) -> f32 {
    let at = |v: u32| {
        let [x, y, z] = points[v as usize];
        Vector::new(x, y, z)
    };
    let p = Vector::new(p.x, p.y, p.z);
    triangles
        .iter()
        .map(|t| (Triangle::new(at(t[0]), at(t[1]), at(t[2])).project_local_point(p, true).point - p).length())
        .fold(f32::INFINITY, f32::min)
}

#[test]
fn a_baked_mesh_agrees_with_brute_force_near_the_surface_and_states_its_error() {
    let cell = 0.04;
    let cases = [
        (torus(1.0, 0.3, 48, 24), Shape::Torus { center: Vector3::zeros(), major: 1.0, minor: 0.3 }),
        (
            cuboid([0.6, 0.4, 1.0]),
            Shape::Box { center: Vector3::zeros(), half: Vector3::new(0.6, 0.4, 1.0), rounding: 0.0 },
        ),
        (sphere(0.9, 24), Shape::sphere(Vector3::zeros(), 0.9)),
    ];
    /// The facets of the coarsest of these meshes lie this far beneath the round surface.
    const FACETS: f32 = 0.02;
    for (mesh, shape) in cases {
        let sdf = bake(&mesh, cell);
        let b = sdf.bounds();
        let mut random = Random::new(11);
        for _ in 0..4_000 {
            let p = random.in_box(b.min, b.max);
            let (d, exact) = (sdf.distance(p), unsigned(&mesh, p));
            let signed = if shape.distance(p) < 0.0 { -exact } else { exact };
            if exact < sdf.band() {
                assert!((d - signed).abs() < 0.5 * cell, "{shape:?} at {p:?}: {d} but {signed}");
            }
            if shape.distance(p).abs() > FACETS + 0.5 * cell {
                assert_eq!(d < 0.0, signed < 0.0, "{shape:?}: wrong sign at {p:?}");
            }
            if signed > 0.0 {
                assert!(sdf.lower_bound(p) <= signed + ROUND_OFF, "{shape:?}: no lower bound at {p:?}");
            }
        }
    }
}

#[test]
fn far_blocks_are_filled_with_the_right_sign_and_a_bounded_error() {
    // A ball forty cells across in a wide rim: most blocks are far, in and out.
    let mesh = sphere(2.0, 32);
    let params = BakeParams { margin: 4.0, ..BakeParams::with_cell(0.1) };
    let sdf = bake_from_mesh(&mesh.0, &mesh.1, params).expect("a closed mesh");
    let mut random = Random::new(12);
    for _ in 0..20_000 {
        let p = random.in_box(sdf.bounds().min, sdf.bounds().max);
        let exact = p.norm() - 2.0;
        let d = sdf.distance(p);
        assert!(d - exact <= sdf.far_error() + 0.02 || exact < 0.0, "at {p:?}: {d} but {exact}");
        assert!(exact.abs() < 0.1 || (d < 0.0) == (exact < 0.0), "wrong sign at {p:?}");
    }
}

#[test]
fn any_number_of_threads_bakes_the_same_bytes() {
    let mesh = torus(1.0, 0.3, 32, 16);
    let bits = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let sdf = pool.install(|| bake(&mesh, 0.06));
        let mut random = Random::new(13);
        let samples: Vec<u32> =
            (0..5_000).map(|_| sdf.distance(random.in_box(sdf.bounds().min, sdf.bounds().max)).to_bits()).collect();
        (samples, sdf.max_error().to_bits(), sdf.far_error().to_bits())
    };
    let one = bits(1);
    assert!(one == bits(2) && one == bits(8));
}

#[test]
fn the_cell_follows_the_thinnest_feature_and_yields_to_the_memory_granted() {
    let (points, triangles) = torus(2.0, 0.1, 96, 24);
    let solid = Solid::from_mesh("ring", &points, &triangles, BakeParams::automatic(), 0.3).expect("closed");
    assert!((solid.half_thickness_cm - 0.1).abs() < 0.01, "half thickness {}", solid.half_thickness_cm);
    assert!(solid.sdf.cell() < 0.03);
    let small = BakeParams { max_bytes: 1 << 20, ..BakeParams::automatic() };
    let sdf = bake_from_mesh(&points, &triangles, small).expect("closed");
    assert!(sdf.memory_bytes() <= 1 << 20 && sdf.cell() > solid.sdf.cell());
    let stated = BakeParams { max_bytes: 1 << 20, ..BakeParams::with_cell(0.01) };
    assert!(matches!(bake_from_mesh(&points, &triangles, stated), Err(Error::TooLarge { .. })));
}

#[test]
fn a_mesh_without_an_inside_is_refused_by_the_name_of_its_defect() {
    let refuse = |mesh: &Mesh| bake_from_mesh(&mesh.0, &mesh.1, BakeParams::with_cell(0.1)).expect_err("a defect");
    let sound = cuboid([1.0, 1.0, 1.0]);

    // A box without three of its sides: nobody can say how far in it reaches.
    let mut open = sound.clone();
    open.1.truncate(6);
    assert!(matches!(refuse(&open), Error::OpenMesh { share_pct, .. } if share_pct > 35.0));

    let sheet =
        (vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2], [0, 2, 3], [0, 2, 1]]);
    assert!(matches!(refuse(&sheet), Error::OpenMesh { .. } | Error::NoVolume { .. }));

    let mut broken = sound.clone();
    broken.0[3][1] = f32::NAN;
    assert!(matches!(refuse(&broken), Error::NonFiniteVertex { vertex: 3, .. }));

    let mut dangling = sound.clone();
    dangling.1[5][2] = 99;
    assert!(matches!(refuse(&dangling), Error::UnknownVertex { triangle: 5, vertex: 99, n_vertices: 8 }));

    // A net on a Klein bottle: no way round leads back to the same side.
    assert!(matches!(refuse(&klein_bottle(24, 12)), Error::OneSided { .. }));

    let flat = (sound.0.iter().map(|p| [p[0], p[1], 0.0 * p[2]]).collect(), sound.1.clone());
    assert!(matches!(refuse(&flat), Error::NoVolume { .. } | Error::EmptyMesh { .. }));
    assert!(matches!(refuse(&(vec![], vec![])), Error::EmptyMesh { .. }));
}

/// The figure-eight immersion, its last ring joined to the first turned over.
fn klein_bottle(around: u32, tube: u32) -> Mesh {
    let mut points = Vec::new();
    for i in 0..around {
        let u = std::f32::consts::TAU * i as f32 / around as f32;
        for j in 0..tube {
            let v = std::f32::consts::TAU * j as f32 / tube as f32;
            let (sv, s2v, ch, sh) = (v.sin(), (2.0 * v).sin(), (0.5 * u).cos(), (0.5 * u).sin());
            let r = 2.0 + ch * sv - sh * s2v;
            // Lifted a little, so that no two vertices of the crossing coincide.
            points.push([r * u.cos(), r * u.sin() + 1e-3 * v.cos(), sh * sv + ch * s2v]);
        }
    }
    let at = |i: u32, j: u32| if i < around { i * tube + j % tube } else { (tube - j % tube) % tube };
    let mut triangles = Vec::new();
    for i in 0..around {
        for j in 0..tube {
            triangles.push([at(i, j), at(i, j + 1), at(i + 1, j)]);
            triangles.push([at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]);
        }
    }
    (points, triangles)
}

/// Distances with their sign, of the mesh as it should have been.
fn check_against(name: &str, broken: &Mesh, sound: &Mesh, inside: impl Fn(Vector3<f32>) -> bool, cell: f32) {
    let sdf = bake(broken, cell);
    let mut random = Random::new(31);
    for _ in 0..3_000 {
        let p = random.in_box(sdf.bounds().min, sdf.bounds().max);
        let exact = unsigned(sound, p);
        let signed = if inside(p) { -exact } else { exact };
        let d = sdf.distance(p);
        if exact < sdf.band() {
            assert!((d - signed).abs() < 0.5 * cell, "{name} at {p:?}: {d} but {signed}");
        } else {
            assert_eq!(d < 0.0, signed < 0.0, "{name} at {p:?}: {d} but {signed}");
        }
    }
}

#[test]
fn holes_flipped_triangles_and_a_surface_inside_out_change_nothing() {
    let cell = 0.06;
    let sound = cuboid([0.6, 0.4, 1.0]);
    let in_box = |p: Vector3<f32>| p.x.abs() < 0.6 && p.y.abs() < 0.4 && p.z.abs() < 1.0;
    let mut hole = sound.clone();
    hole.1.pop();
    let mut lid = sound.clone();
    lid.1.truncate(10);
    let mut inward = sound.clone();
    inward.1.iter_mut().for_each(|t| t.swap(0, 1));
    let mut flipped = sound.clone();
    for n in [0, 3, 4, 9] {
        flipped.1[n].swap(0, 1);
    }
    let mut doubled = sound.clone();
    doubled.1.extend(sound.1.clone());
    for (name, mesh) in
        [("hole", hole), ("no lid", lid), ("inside out", inward), ("some flipped", flipped), ("all twice", doubled)]
    {
        check_against(name, &mesh, &sound, in_box, cell);
    }
}

#[test]
fn a_solid_of_overlapping_parts_is_their_union_seen_from_outside() {
    let (a, b) = (sphere(0.8, 20), sphere(0.8, 20));
    let shift = Vector3::new(0.7, 0.1, 0.0);
    let mut both = a.clone();
    let n = both.0.len() as u32;
    both.0.extend(b.0.iter().map(|p| <[f32; 3]>::from(Vector3::from(*p) + shift)));
    both.1.extend(b.1.iter().map(|t| t.map(|v| v + n)));
    let cell = 0.05;
    let sdf = bake(&both, cell);
    let mut random = Random::new(32);
    let (mut n_inside, mut n_outside) = (0, 0);
    for _ in 0..20_000 {
        let p = random.in_box(sdf.bounds().min, sdf.bounds().max);
        let round = (p.norm() - 0.8).min((p - shift).norm() - 0.8);
        if round > 0.02 {
            n_outside += 1;
            assert!((sdf.distance(p) - round).abs() < 0.5 * cell + 0.02 || round > sdf.band(), "{p:?}");
        }
        // Where the balls cross, depth is to the nearest sheet: only the sign counts.
        let deep = p.norm() < 0.7 && ((p - shift).norm() - 0.8).abs() > cell;
        if deep {
            n_inside += 1;
            assert!(sdf.distance(p) < 0.0, "{p:?}");
        }
    }
    assert!(n_inside > 1_000 && n_outside > 1_000);
}

#[test]
fn a_field_moves_and_turns_with_its_mesh() {
    /// Both fields err by at most half a cell near the surface.
    const CELL: f32 = 0.05;
    let mesh = torus(1.0, 0.3, 48, 24);
    let still = bake(&mesh, CELL);
    let mut random = Random::new(33);
    for n in 0..4 {
        let turn =
            nalgebra::UnitQuaternion::from_scaled_axis(random.in_box(Vector3::repeat(-2.0), Vector3::repeat(2.0)));
        let by = nalgebra::Isometry3::from_parts(Vector3::new(n as f32 * 37.0, -5.0, 0.3).into(), turn);
        let moved = (mesh.0.iter().map(|&p| (by * nalgebra::Point3::from(p)).coords.into()).collect(), mesh.1.clone());
        let moved = bake(&moved, CELL);
        for _ in 0..2_000 {
            let p = random.in_box(still.bounds().min, still.bounds().max);
            let (a, b) = (still.distance(p), moved.distance((by * nalgebra::Point3::from(p)).coords));
            if a.abs() < still.band() {
                assert!((a - b).abs() < still.max_error() + moved.max_error() + ROUND_OFF, "{a} but {b}");
            }
        }
    }
}

#[test]
fn size_does_not_matter() {
    let unit = torus(1.0, 0.3, 24, 12);
    let reference = bake(&unit, 0.0625);
    for scale in [2f32.powi(-20), 2f32.powi(20)] {
        let mesh: Mesh = (unit.0.iter().map(|p| p.map(|x| x * scale)).collect(), unit.1.clone());
        let params = BakeParams { margin: 0.5 * scale, ..BakeParams::with_cell(0.0625 * scale) };
        let sdf = bake_from_mesh(&mesh.0, &mesh.1, params).expect("a sound mesh");
        let mut random = Random::new(34);
        for _ in 0..2_000 {
            let p = random.in_box(reference.bounds().min, reference.bounds().max);
            assert_eq!(sdf.distance(p * scale), reference.distance(p) * scale, "powers of two are exact");
        }
        let automatic = BakeParams { max_bytes: 1 << 20, ..BakeParams::automatic() };
        let sdf = bake_from_mesh(&mesh.0, &mesh.1, automatic).expect("a cell that suits the size");
        assert!(sdf.distance(Vector3::new(scale, 0.0, 0.0)) < 0.0 && sdf.distance(Vector3::zeros()) > 0.0);
    }
}

#[test]
fn a_lower_bound_is_never_above_the_distance_far_or_near() {
    // A sharp thin blade and a ring: coarse cells, ridges, points far outside the grid.
    for mesh in [cuboid([1.0, 0.03, 0.5]), torus(1.0, 0.1, 48, 16)] {
        let params = BakeParams { margin: 3.0, ..BakeParams::with_cell(0.03) };
        let sdf = bake_from_mesh(&mesh.0, &mesh.1, params).expect("a closed mesh");
        let mut random = Random::new(35);
        let mut closest = f32::INFINITY;
        for n in 0..6_000 {
            let grow = if n % 4 == 0 { 20.0 } else { 0.0 };
            let p = random.in_box(sdf.bounds().min.add_scalar(-grow), sdf.bounds().max.add_scalar(grow));
            let exact = unsigned(&mesh, p);
            if sdf.distance(p) > 0.0 {
                let below = exact - sdf.lower_bound(p);
                assert!(below >= -ROUND_OFF, "{below} at {p:?}");
                closest = closest.min(below);
            }
        }
        println!(
            "least room under the distance: {closest} cm, errors {} near, {} far",
            sdf.max_error(),
            sdf.far_error()
        );
    }
}

#[test]
fn the_field_is_continuous_where_fine_meets_coarse() {
    let mesh = sphere(2.0, 24);
    let params = BakeParams { margin: 3.0, ..BakeParams::with_cell(0.1) };
    let sdf = bake_from_mesh(&mesh.0, &mesh.1, params).expect("a closed mesh");
    let mut random = Random::new(36);
    let origin = sdf.bounds().min;
    let mut n_checked = 0;
    for _ in 0..20_000 {
        // Points on faces of bricks, four cells apart.
        let mut p = random.in_box(sdf.bounds().min, sdf.bounds().max);
        let axis = (random.unit() * 3.0) as usize;
        p[axis] = origin[axis] + ((p[axis] - origin[axis]) / (4.0 * sdf.cell())).round() * 4.0 * sdf.cell();
        let (mut before, mut after) = (p, p);
        before[axis] -= 1e-4;
        after[axis] += 1e-4;
        let jump = (sdf.distance(after) - sdf.distance(before)).abs();
        assert!(jump <= sdf.steepest() * 2.1e-4 + ROUND_OFF, "{jump} at {p:?}");
        n_checked += 1;
    }
    assert!(n_checked > 0);
}

#[test]
fn a_batch_of_samples_is_each_sample_bit_for_bit() {
    let mesh = torus(1.0, 0.3, 32, 16);
    let params = BakeParams { margin: 2.0, ..BakeParams::with_cell(0.05) };
    let sdf = bake_from_mesh(&mesh.0, &mesh.1, params).expect("a closed mesh");
    let mut random = Random::new(37);
    let n = 5_003;
    let mut points: Vec<Vector3<f32>> = (0..n).map(|_| random.in_box(sdf.bounds().min, sdf.bounds().max)).collect();
    // Runs of eight wholly inside, wholly outside, and mixed; nodes, faces, and what is no number.
    for n in (0..n).step_by(40) {
        points[n] *= 3.0;
    }
    points[16..24].iter_mut().for_each(|p| p.x += 100.0);
    points[33] = sdf.bounds().min;
    points[34] = sdf.bounds().max;
    points[35] = sdf.bounds().center();
    points[50] = Vector3::new(f32::NAN, 0.0, 0.0);
    let [x, y, z] = [0, 1, 2].map(|k: usize| points.iter().map(|p| p[k]).collect::<Vec<_>>());
    let mut out = [(); 4].map(|()| vec![0.0f32; n]);
    // Lengths about those of vectors and blocks, then all.
    for n in (0..140).chain([n]) {
        let [d, gx, gy, gz] = out.each_mut().map(|o| &mut o[..n]);
        sdf.sample([&x[..n], &y[..n], &z[..n]], &mut collision::Samples { distance: d, gradient: [gx, gy, gz] });
        check_batch(&sdf, &points[..n], &out);
    }
}

fn check_batch(sdf: &SignedDistanceField, points: &[Vector3<f32>], out: &[Vec<f32>; 4]) {
    for (k, p) in points.iter().enumerate() {
        let (distance, gradient) = sdf.distance_gradient(*p);
        let single = [distance, gradient.x, gradient.y, gradient.z];
        for (batch, single) in out.iter().map(|o| o[k]).zip(single) {
            let both_nan = batch.is_nan() && single.is_nan();
            assert!(both_nan || batch.to_bits() == single.to_bits(), "{batch} but {single} at {p:?}");
        }
    }
}

#[test]
fn a_field_read_back_from_its_bytes_is_the_same_field() {
    let mesh = torus(1.0, 0.3, 32, 16);
    let sdf = bake(&mesh, 0.06);
    let bytes = sdf.to_bytes();
    let back = SignedDistanceField::from_bytes(&bytes).expect("its own bytes");
    assert_eq!(back.to_bytes(), bytes);
    assert!(back.id() != sdf.id(), "a field made anew is another field");
    let mut random = Random::new(38);
    for _ in 0..5_000 {
        let p = random.in_box(sdf.bounds().min.add_scalar(-1.0), sdf.bounds().max.add_scalar(1.0));
        assert_eq!(sdf.distance(p).to_bits(), back.distance(p).to_bits());
        assert_eq!(sdf.lower_bound(p).to_bits(), back.lower_bound(p).to_bits());
    }
    // Cut short anywhere, or with any early byte changed: an error or a field, never a crash.
    for n in (0..bytes.len()).step_by(97).chain(0..120) {
        assert!(matches!(SignedDistanceField::from_bytes(&bytes[..n]), Err(Error::BadBytes { .. })), "cut at {n}");
    }
    for n in 0..300.min(bytes.len()) {
        let mut broken = bytes.clone();
        broken[n] ^= 0xa5;
        if let Ok(field) = SignedDistanceField::from_bytes(&broken) {
            for _ in 0..50 {
                field.distance(random.in_box(sdf.bounds().min, sdf.bounds().max));
            }
        }
    }
}

#[test]
fn faces_that_pass_through_nodes_let_neither_side_through() {
    // Far from the origin, where coordinates are rounded; long thin triangles; nodes on the faces themselves.
    let cell = 0.015_625;
    for (half, shift) in [([0.25, 0.125, 5.0], 0.0), ([0.25, 0.125, 5.0], 37.3), ([1.0, 0.031_25, 4.0], 9.7)] {
        let mut mesh = cuboid(half);
        mesh.0.iter_mut().for_each(|p| p[2] += shift);
        let params = BakeParams { margin: 4.0 * cell, max_bytes: 1 << 28, ..BakeParams::with_cell(cell) };
        let sdf = bake_from_mesh(&mesh.0, &mesh.1, params).expect("a closed mesh");
        let shape = Shape::Box { center: Vector3::new(0.0, 0.0, shift), half: Vector3::from(half), rounding: 0.0 };
        let mut random = Random::new(39);
        for _ in 0..20_000 {
            let p = random.in_box(sdf.bounds().min, sdf.bounds().max);
            let exact = shape.distance(p);
            if exact.abs() < sdf.band() {
                assert!((sdf.distance(p) - exact).abs() < 0.5 * cell, "{} but {exact} at {p:?}", sdf.distance(p));
            } else {
                assert_eq!(sdf.distance(p) < 0.0, exact < 0.0, "at {p:?}");
            }
        }
    }
}
