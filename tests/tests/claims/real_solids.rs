//! Solids that no one here made: the real head and comb become distance fields, also where they are open or inside out; what is mostly hole is refused by name.

use collision::{BakeParams, Error, Solid, bake_from_mesh};
use hair_tests::shared_data;
use io_formats::{LengthUnit, TriMesh, read_mesh};
use nalgebra::Vector3;

fn solid_of(file: &str, unit: LengthUnit) -> Option<(TriMesh, Solid)> {
    let mesh = read_mesh(&shared_data(file)?, unit).unwrap();
    let solid = Solid::from_mesh(file, &mesh.vertices, &mesh.triangles, BakeParams::automatic(), 0.2).unwrap();
    Some((mesh, solid))
}

/// Surface points are at distance zero, and a little along the normal either way it has the right sign.
fn check_surface(mesh: &TriMesh, solid: &Solid, step: f32) {
    let error = solid.sdf.max_error() + 1e-3 * step;
    let mut signs_wrong = 0;
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|v| Vector3::from(mesh.vertices[v as usize]));
        let middle = (a + b + c) / 3.0;
        let normal = (b - a).cross(&(c - a));
        assert!(solid.sdf.distance(middle).abs() <= error, "{middle}: {}", solid.sdf.distance(middle));
        let Some(normal) = normal.try_normalize(1e-12) else { continue };
        let outside = solid.sdf.distance(middle + normal * step);
        let inside = solid.sdf.distance(middle - normal * step);
        signs_wrong += usize::from(outside <= -error) + usize::from(inside >= error);
    }
    assert_eq!(signs_wrong, 0);
    let (low, high) = mesh.bounds().unwrap();
    let far = Vector3::from(high) + Vector3::repeat(30.0);
    // Outside the grid the distance is a lower bound, and never negative.
    let gap = (far - Vector3::from(high)).norm();
    let diagonal = (Vector3::from(high) - Vector3::from(low)).norm();
    let d = solid.sdf.distance(far);
    assert!(d > 0.0 && d <= gap + diagonal, "{d}");
}

#[test]
fn a_real_head_becomes_a_distance_field() {
    let Some((mesh, head)) = solid_of("solids/sintel_collider.obj", LengthUnit::M) else { return };
    check_surface(&mesh, &head, 0.05);
    let (low, high) = mesh.bounds().unwrap();
    let middle = (Vector3::from(low) + Vector3::from(high)) / 2.0;
    assert!(head.sdf.distance(middle) < -1.0, "the middle of a head is inside it");
}

#[test]
fn a_real_comb_keeps_the_gaps_between_its_teeth() {
    let Some((mesh, comb)) = solid_of("solids/comb.stl", LengthUnit::Mm) else { return };
    check_surface(&mesh, &comb, 0.005);
    assert!(comb.half_thickness_cm < 0.15, "teeth are a millimetre or two thick: {}", comb.half_thickness_cm);
    // Across the teeth the sign changes many times: they are apart in the field too.
    let (low, high) = mesh.bounds().unwrap();
    let size = Vector3::from(high) - Vector3::from(low);
    let along = if size.z >= size.x { 2 } else { 0 };
    let most = (0..40)
        .map(|k| {
            let mut p = (Vector3::from(low) + Vector3::from(high)) / 2.0;
            let across = 2 - along;
            p[across] = low[across] + size[across] * (k as f32 + 0.5) / 40.0;
            let inside: Vec<bool> = (0..2000)
                .map(|i| {
                    p[along] = low[along] + size[along] * i as f32 / 1999.0;
                    comb.sdf.distance(p) < 0.0
                })
                .collect();
            inside.windows(2).filter(|w| w[0] != w[1]).count()
        })
        .max();
    assert!(most >= Some(40), "at most {most:?} crossings along a line across the teeth");
}

#[test]
fn an_open_bust_and_a_horse_inside_out_become_solids_and_a_scalp_is_refused() {
    for (file, unit) in [("solids/sintel_bust.obj", LengthUnit::M), ("solids/horse.ply", LengthUnit::M)] {
        let Some((mesh, solid)) = solid_of(file, unit) else { continue };
        let (low, high) = mesh.bounds().unwrap();
        let corner = Vector3::from(low) - Vector3::repeat(0.2);
        assert!(solid.sdf.distance(corner) > 0.0, "{file}: outside is outside");
        let n_inside = (0..10_000)
            .filter(|n| {
                let share = Vector3::new((n % 25) as f32, (n / 25 % 20) as f32, (n / 500) as f32 + 0.5);
                let size = Vector3::from(high) - Vector3::from(low);
                let at = share.component_div(&Vector3::new(25.0, 20.0, 20.0)).component_mul(&size);
                solid.sdf.distance(Vector3::from(low) + at) < 0.0
            })
            .count();
        assert!((500..9_000).contains(&n_inside), "{file}: {n_inside} of 10,000 inside");
    }
    let Some(path) = shared_data("solids/usc_scalp.obj") else { return };
    let mesh = read_mesh(&path, LengthUnit::M).unwrap();
    let error = bake_from_mesh(&mesh.vertices, &mesh.triangles, BakeParams::with_cell(1.0)).unwrap_err();
    assert!(matches!(error, Error::OpenMesh { n_edges, .. } if n_edges > 0), "{error}");
    assert!(error.to_string().contains("boundary edges"), "{error}");
}
