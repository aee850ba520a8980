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

fn unsigned((points, triangles): &Mesh, p: Vector3<f32>) -> f32 {
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

    let mut open = sound.clone();
    open.1.pop();
    assert!(matches!(refuse(&open), Error::OpenMesh { n_edges: 3, .. }));

    let mut inward = sound.clone();
    inward.1.iter_mut().for_each(|t| t.swap(0, 1));
    assert!(matches!(refuse(&inward), Error::InwardFacing { volume_cm3 } if (volume_cm3 + 8.0).abs() < 1e-6));

    let mut twisted = sound.clone();
    twisted.1[0].swap(0, 1);
    assert!(matches!(refuse(&twisted), Error::InconsistentWinding { n_edges: 3, .. }));

    let mut crowded = sound.clone();
    crowded.0.push([3.0, 3.0, 3.0]);
    let fin = sound.1[0];
    crowded.1.extend([[fin[0], fin[1], 8], [fin[1], fin[0], 8]]);
    assert!(matches!(refuse(&crowded), Error::NonManifold { n_edges: 1, .. }));

    let mut broken = sound.clone();
    broken.0[3][1] = f32::NAN;
    assert!(matches!(refuse(&broken), Error::NonFiniteVertex { vertex: 3, .. }));

    let mut dangling = sound.clone();
    dangling.1[5][2] = 99;
    assert!(matches!(refuse(&dangling), Error::UnknownVertex { triangle: 5, vertex: 99, n_vertices: 8 }));

    let flat = (sound.0.iter().map(|p| [p[0], p[1], 0.0 * p[2]]).collect(), sound.1.clone());
    assert!(matches!(refuse(&flat), Error::NoVolume { .. } | Error::EmptyMesh { .. } | Error::NonManifold { .. }));
    assert!(matches!(refuse(&(vec![], vec![])), Error::EmptyMesh { .. }));
}
