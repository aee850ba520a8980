//! The interpolation check on the field against the exact tests on the triangles it was baked from.
#![allow(clippy::print_stdout, reason = "figures are said beside the law that holds them")]

use crate::meshes::{self, Mesh};
use crate::random::Random;
use collision::clearance::{proven_distance, proven_distance_at};
use collision::surface::Surface;
use collision::{BakeParams, Error, Solid, ribbon_is_free, segment_is_free, strand_ribbon_is_free};
use nalgebra::Vector3;

/// Segments tried near each solid.
const SEGMENTS: usize = 100_000;

/// Ribbons tried near each solid; an exact ribbon costs some hundred exact segments.
const RIBBONS: usize = 5_000;

/// How near to the bilinear patch the exact form goes, cm: far below a cell of any solid here.
const TOLERANCE_CM: f64 = 1e-4;

/// How near to the surface a piece comes that is called blocked though it touches nothing, in cells. Such a piece has a
/// middle where nothing is proven, or a sixteenth of a cell at most, so the mean of the nodes' squared distances is at most 3/4 +
/// 1/256 of a squared cell; no point is farther than the mean of the nodes' distances and of its own to them, which is at most the root of 3/4.
const NEAR_CELLS: f64 = 1.7343;

struct Trial {
    name: &'static str,
    solid: Solid,
    surface: Surface,
    mesh: Mesh,
}

fn trial(name: &'static str, mesh: Mesh, params: BakeParams) -> Trial {
    let solid = Solid::from_mesh(name, &mesh.0, &mesh.1, params, 0.3).expect("a closed mesh");
    let surface = Surface::new(&mesh.0, &mesh.1).expect("a good mesh");
    Trial { name, solid, surface, mesh }
}

fn trials() -> Vec<Trial> {
    let automatic = BakeParams::automatic();
    vec![
        trial("head", meshes::blob(9.0, 24), BakeParams::with_cell(0.4)),
        trial("comb", meshes::flat_comb(7, 0.15, 0.25, 2.5, 0.1), automatic),
        trial("gear", meshes::gear(12, 0.5, 1.6, 0.3, 0.2), automatic),
        trial("torus", meshes::torus(1.5, 0.3, 32, 16), automatic),
        // Thinner than a cell and between its nodes: most of the sheet leaves no trace in the signs of the grid.
        trial("thin sheet", meshes::cuboid([1.0, 0.004, 0.8]), BakeParams::with_cell(0.05)),
        trial("needle", meshes::cuboid([0.011, 0.007, 1.0]), BakeParams::with_cell(0.06)),
    ]
}

/// A point near the surface: over a triangle, up to `reach` cm away.
fn near(mesh: &Mesh, reach: f32, random: &mut Random) -> Vector3<f32> {
    let t = mesh.1[(random.unit() * mesh.1.len() as f32) as usize % mesh.1.len()];
    let [a, b, c] = t.map(|v| Vector3::from(mesh.0[v as usize]));
    let (mut u, mut v) = (random.unit(), random.unit());
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    let reach = Vector3::repeat(reach * random.unit());
    a + (b - a) * u + (c - a) * v + random.in_box(-reach, reach)
}

fn exact(p: Vector3<f32>) -> Vector3<f64> {
    p.cast()
}

/// A point inside the solid, with nothing of it touching: exact tests on surfaces do not see those.
fn is_inside(trial: &Trial, p: Vector3<f32>) -> bool {
    trial.solid.sdf.distance(p) < 0.0
}

#[test]
fn no_segment_called_free_touches_the_mesh() {
    for trial in trials() {
        let mut random = Random::new(71);
        let (sdf, cell) = (&trial.solid.sdf, trial.solid.sdf.cell());
        let (mut hit, mut free, mut falsely_blocked) = (0, 0, 0);
        for n in 0..SEGMENTS {
            let (from, length) = (near(&trial.mesh, 6.0 * cell, &mut random), 16.0 * cell * random.unit());
            let b = from + random.in_box(Vector3::repeat(-length), Vector3::repeat(length));
            let called_free = segment_is_free(sdf, from, b, cell);
            if trial.surface.is_hit_by(&[exact(from), exact(b)]) {
                hit += 1;
                assert!(!called_free, "{}: segment {n}, {from:?} to {b:?}, is called free and pierces", trial.name);
            } else if !is_inside(&trial, from) {
                free += 1;
                falsely_blocked += usize::from(!called_free);
                let near = NEAR_CELLS * f64::from(cell);
                let distance = trial.surface.distance_within(&[exact(from), exact(b)], near);
                assert!(called_free || distance <= near, "{}: segment {n} is blocked from afar", trial.name);
            }
        }
        let share = falsely_blocked as f64 / free as f64;
        println!(
            "{}: cell {cell} cm, {hit} hit, {free} free, {:.1} % of them called blocked",
            trial.name,
            100.0 * share
        );
        assert!(hit > SEGMENTS / 20 && free > SEGMENTS / 20, "{}: hardly tried: {hit}, {free}", trial.name);
    }
}

#[test]
fn no_point_of_the_mesh_is_proven_free() {
    // This sheet lies a tenth of a cell off the nodes, where a sample errs more than at the centre of its cell.
    let params = BakeParams { margin: 0.505, ..BakeParams::with_cell(0.05) };
    let sheet = trial("sheet off the nodes", meshes::cuboid([1.0, 0.0005, 0.8]), params);
    for trial in trials().into_iter().chain([sheet]) {
        let (sdf, mut random) = (&trial.solid.sdf, Random::new(75));
        for n in 0..SEGMENTS {
            let p = near(&trial.mesh, 0.0, &mut random);
            let d = sdf.distance(p);
            assert!(proven_distance(sdf, d) <= 0.0, "{}: point {n}, {p:?} is proven free at {d}", trial.name);
        }
    }
}

#[test]
fn what_is_proven_at_a_place_is_no_more_than_the_exact_distance_and_no_less_than_of_the_sample_alone() {
    const POINTS: usize = 20_000;
    /// Distances of single precision, some centimetres from the origin.
    const ROUND_OFF_CM: f64 = 1e-5;
    for trial in trials() {
        let (sdf, mut random) = (&trial.solid.sdf, Random::new(76));
        let (cell, mut tighter) = (sdf.cell(), 0);
        for n in 0..POINTS {
            let p = near(&trial.mesh, 5.0 * cell, &mut random);
            let (of_sample, proven) = (proven_distance(sdf, sdf.distance(p)), proven_distance_at(sdf, p));
            assert!(proven >= of_sample, "{}: point {n}", trial.name);
            tighter += usize::from(proven > of_sample + 0.05 * cell);
            if proven > 0.0 {
                let within = 2.0 * f64::from(proven);
                let exact = trial.surface.distance_within(&[exact(p), exact(p)], within);
                assert!(f64::from(proven) <= exact + ROUND_OFF_CM, "{}: point {n}: {proven} but {exact}", trial.name);
            }
        }
        assert!(tighter > POINTS / 10, "{}: {tighter} gained by it", trial.name);
    }
}

#[test]
fn no_ribbon_called_free_touches_the_mesh() {
    for trial in trials() {
        let mut random = Random::new(72);
        let (sdf, cell) = (&trial.solid.sdf, trial.solid.sdf.cell());
        let (mut hit, mut free, mut falsely_blocked) = (0, 0, 0);
        for n in 0..RIBBONS {
            let (a0, size) = (near(&trial.mesh, 6.0 * cell, &mut random), 10.0 * cell * random.unit());
            let [b0, a1, b1] = [(); 3].map(|()| a0 + random.in_box(Vector3::repeat(-size), Vector3::repeat(size)));
            let called_free = ribbon_is_free(sdf, [a0, b0, a1, b1], cell);
            if trial.surface.ribbon_is_hit([a0, b0, a1, b1].map(exact), TOLERANCE_CM) {
                hit += 1;
                assert!(!called_free, "{}: ribbon {n} is called free and touches", trial.name);
            } else if !is_inside(&trial, a0) {
                free += 1;
                falsely_blocked += usize::from(!called_free);
            }
        }
        let share = falsely_blocked as f64 / free as f64;
        println!("{}: {hit} hit, {free} free, {:.1} % of them called blocked", trial.name, 100.0 * share);
        assert!(hit > RIBBONS / 20 && free > RIBBONS / 20, "{}: hardly tried: {hit}, {free}", trial.name);
    }
}

#[test]
fn the_exact_ribbon_agrees_with_its_lines() {
    // Dense lines of the patch pierce the surface only where the patch does; and the patch only within the tolerance and
    // the spacing of the lines of one that does.
    const LINES: usize = 200;
    let trial = trial("torus", meshes::torus(1.5, 0.3, 32, 16), BakeParams::automatic());
    let mut random = Random::new(73);
    let (mut hits, mut misses) = (0, 0);
    for n in 0..2_000 {
        let a0 = exact(near(&trial.mesh, 0.4, &mut random));
        let [b0, a1, b1] = [(); 3].map(|()| a0 + exact(random.in_box(Vector3::repeat(-0.7), Vector3::repeat(0.7))));
        let hit = trial.surface.ribbon_is_hit([a0, b0, a1, b1], TOLERANCE_CM);
        let lines = (0..=LINES).map(|k| k as f64 / LINES as f64).map(|v| [a0.lerp(&a1, v), b0.lerp(&b1, v)]);
        let pierced = lines.clone().any(|line| trial.surface.is_hit_by(&line));
        assert!(hit || !pierced, "ribbon {n}: a line of it pierces");
        if hit {
            hits += 1;
            let spacing = (a1 - a0).norm().max((b1 - b0).norm()) / LINES as f64;
            let within = spacing + 2.0 * TOLERANCE_CM;
            assert!(lines.into_iter().any(|line| trial.surface.distance_within(&line, within) <= within), "ribbon {n}");
        } else {
            misses += 1;
        }
    }
    assert!(hits > 200 && misses > 200, "{hits} hits, {misses} misses: the law was hardly tried");
}

#[test]
fn a_tooth_between_two_rungs_is_found_at_every_offset_by_both_forms() {
    // Teeth of two millimetres, rungs eight apart: at most offsets every rung is free.
    let trial = trial("tooth", meshes::cuboid([0.1, 0.1, 2.0]), BakeParams::automatic());
    let sdf = &trial.solid.sdf;
    let mut between_rungs = 0;
    for k in 0..=1_600 {
        let x = -0.8 + 0.001 * k as f32;
        let strand = |y: f32| -> Vec<Vector3<f32>> {
            (0..3).map(|t| Vector3::new(x + 0.8 * (t as f32 - 1.0), y, 0.3)).collect()
        };
        let (i, j) = (strand(-0.5), strand(0.5));
        let (ei, ej): (Vec<_>, Vec<_>) = (i.iter().map(|p| exact(*p)).collect(), j.iter().map(|p| exact(*p)).collect());
        assert!(!strand_ribbon_is_free(sdf, &i, &j, sdf.cell()), "by the field, at {x}");
        assert!(trial.surface.strand_ribbon_is_hit(&ei, &ej, TOLERANCE_CM), "by the triangles, at {x}");
        between_rungs += usize::from(ei.iter().zip(&ej).all(|(a, b)| !trial.surface.is_hit_by(&[*a, *b])));
        // Both on one side: nothing stands between.
        let beyond: Vec<_> = j.iter().map(|p| p + Vector3::y()).collect();
        assert!(strand_ribbon_is_free(sdf, &j, &beyond, sdf.cell()));
        let beyond: Vec<_> = beyond.iter().map(|p| exact(*p)).collect();
        assert!(!trial.surface.strand_ribbon_is_hit(&ej, &beyond, TOLERANCE_CM));
    }
    assert!(between_rungs > 1_000, "rungs were free at {between_rungs} offsets only");
}

#[test]
fn a_tooth_between_two_particles_of_one_strand_is_found_at_every_offset_by_both_forms() {
    let trial = trial("tooth", meshes::cuboid([0.1, 0.1, 2.0]), BakeParams::automatic());
    let sdf = &trial.solid.sdf;
    for k in 0..=1_000 {
        // The segment's ends are a centimetre apart and clear of the tooth, which stands anywhere between them, and the
        // segment passes through it at any depth.
        let along = -0.38 + 0.76 * k as f32 / 1_000.0;
        for depth in [-0.0999, -0.05, 0.0, 0.07, 0.0999] {
            let (a, b) = (Vector3::new(along - 0.5, depth, 0.3), Vector3::new(along + 0.5, depth, 0.3));
            assert!(sdf.distance(a) > 0.0 && sdf.distance(b) > 0.0, "the ends alone tell nothing");
            assert!(!segment_is_free(sdf, a, b, sdf.cell()), "by the field, at {along}, {depth}");
            assert!(trial.surface.is_hit_by(&[exact(a), exact(b)]), "by the triangles, at {along}, {depth}");
        }
    }
}

#[test]
fn a_solid_of_any_size_is_judged_alike() {
    for scale in [1e-6f32, 1.0, 1e6] {
        let (points, triangles) = meshes::torus(1.5 * scale, 0.3 * scale, 24, 12);
        let params = BakeParams { cell: Some(0.05 * scale), max_bytes: 64 << 20, margin: 0.5 * scale, band_cells: 2.0 };
        let solid = Solid::from_mesh("ring", &points, &triangles, params, 0.3).expect("a closed mesh");
        let surface = Surface::new(&points, &triangles).expect("a good mesh");
        let (mut outcomes, mut random) = ([0; 2], Random::new(74));
        for n in 0..2_000 {
            let a = random.in_box(Vector3::repeat(-2.0), Vector3::repeat(2.0)) * scale;
            let b = a + random.in_box(Vector3::repeat(-1.0), Vector3::repeat(1.0)) * scale;
            let free = segment_is_free(&solid.sdf, a, b, 0.05 * scale);
            let hit = surface.is_hit_by(&[exact(a), exact(b)]);
            assert!(!(free && hit), "scale {scale}, segment {n}");
            outcomes[usize::from(free)] += 1;
            let ribbon = [a, b, b + Vector3::x() * scale, a + Vector3::y() * scale];
            let ribbon_hit = surface.ribbon_is_hit(ribbon.map(exact), 1e-4 * f64::from(scale));
            assert!(ribbon_hit || !hit, "a side of a ribbon is part of it");
            assert!(!(ribbon_hit && ribbon_is_free(&solid.sdf, ribbon, 0.05 * scale)), "scale {scale}, ribbon {n}");
        }
        assert!(outcomes.iter().all(|&n| n > 150), "scale {scale}: {outcomes:?}");
    }
}

#[test]
fn what_is_not_finite_is_never_free_and_never_a_hang() {
    let trial = trial("tooth", meshes::cuboid([0.1, 0.1, 2.0]), BakeParams::automatic());
    let sdf = &trial.solid.sdf;
    let good = Vector3::new(1.0, 2.0, 3.0);
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -f32::MAX] {
        for axis in 0..3 {
            let mut p = good;
            p[axis] = bad;
            assert!(!bad.is_finite() || !segment_is_free(sdf, p, -p, 0.1), "through the middle of everything");
            if bad.is_finite() {
                continue;
            }
            assert!(!segment_is_free(sdf, p, good, 0.1) && !segment_is_free(sdf, good, p, 0.1));
            assert!(!ribbon_is_free(sdf, [good, p, good, good], 0.1));
            assert!(!strand_ribbon_is_free(sdf, &[good, p, good, good], &[good; 4], 0.1));
            let (g, p) = (exact(good), exact(p));
            assert!(!trial.surface.is_hit_by(&[g, p]));
            assert!(!trial.surface.ribbon_is_hit([g, p, g, g], TOLERANCE_CM));
            assert!(trial.surface.distance_within(&[g, p], 1.0).is_infinite());
        }
    }
    // Resolutions that make no sense are taken as the finest.
    let (a, b) = (Vector3::new(-1.0, 0.1001, 0.0), Vector3::new(1.0, 0.1001, 0.0));
    for resolution in [0.0, -1.0, f32::NAN, f32::MIN_POSITIVE] {
        assert!(!segment_is_free(sdf, a, b, resolution), "it grazes within a cell");
        assert!(segment_is_free(sdf, a + Vector3::y(), b + Vector3::y(), resolution));
        assert!(!segment_is_free(sdf, Vector3::zeros(), Vector3::zeros(), resolution));
        assert!(!ribbon_is_free(sdf, [a, b, a + Vector3::z(), b + Vector3::z()], resolution));
    }
    assert!(!trial.surface.ribbon_is_hit([exact(a), exact(b), exact(a), exact(b)], f64::NAN));
    assert!(trial.surface.ribbon_is_hit([exact(a), exact(b), -exact(a), -exact(b)], 0.0));
    assert!(strand_ribbon_is_free(sdf, &[], &[], 0.1) && !trial.surface.strand_ribbon_is_hit(&[], &[], TOLERANCE_CM));
}

#[test]
fn triangles_of_no_area_are_met_as_lines_and_points() {
    let line = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
    let surface = Surface::new(&line, &[[0, 1, 2], [1, 1, 1]]).expect("no harm in it");
    let v = Vector3::<f64>::new;
    assert!(surface.is_hit_by(&[v(0.5, -1.0, 0.0), v(0.5, 1.0, 0.0)]));
    assert!(!surface.is_hit_by(&[v(0.5, -1.0, 0.1), v(0.5, 1.0, 0.1)]));
    // A patch across the line, flat and twisted.
    let flat = [v(0.5, -1.0, -1.0), v(0.5, 1.0, -1.0), v(0.5, -1.0, 1.0), v(0.5, 1.0, 1.0)];
    assert!(surface.ribbon_is_hit(flat, TOLERANCE_CM));
    assert!(!surface.ribbon_is_hit(flat.map(|p| p + Vector3::x() * 2.0), TOLERANCE_CM));
    let twisted = [v(0.3, -1.0, -1.0), v(0.7, 1.0, -1.0), v(0.7, -1.0, 1.0), v(0.3, 1.0, 1.0)];
    assert!(surface.ribbon_is_hit(twisted, TOLERANCE_CM));
    assert!(matches!(Surface::new(&line, &[]), Err(Error::EmptyMesh { n_vertices: 3, n_triangles: 0 })));
}
