//! The interpolation check on real solids, beside the exact test on their triangles, and what culling by bounds keeps.
#![allow(clippy::print_stdout, reason = "figures are said beside the law that holds them")]

use collision::{BakeParams, Error, Solid};
use hair_bench::collision_checks::{check_segments, cull};
use hair_tests::shared_data;
use io_formats::{LengthUnit, read_mesh};

/// Segments tried near each solid.
const SEGMENTS: usize = 100_000;

/// Size of what is only a shape and not of a known unit, cm: an ornament on a hair clip.
const ORNAMENT_CM: f32 = 6.0;

fn no_false_free(file: &str, unit: LengthUnit, to_size: Option<f32>) {
    let Some(path) = shared_data(file) else { return };
    let mut mesh = read_mesh(&path, unit).unwrap();
    if let Some(size) = to_size {
        let (low, high) = mesh.bounds().unwrap();
        let largest = (0..3).map(|k| high[k] - low[k]).fold(0.0, f32::max);
        for p in &mut mesh.vertices {
            *p = p.map(|x| x * size / largest);
        }
    }
    let baked = Solid::from_mesh(file, &mesh.vertices, &mesh.triangles, BakeParams::automatic(), 0.2);
    if let Err(error @ Error::TouchesBounds { .. }) = &baked {
        // Signs went wrong at flat triangles of the file: there is no field, and so nothing that it calls free.
        println!("skipped: {file} is refused: {error}");
        return;
    }
    let solid = baked.unwrap();
    let report = check_segments(&solid, &mesh, SEGMENTS, 81).unwrap();
    println!(
        "{file}: cell {} cm, half-thickness {} cm, {report:?}, {:.2} % of the free called blocked",
        solid.sdf.cell(),
        solid.half_thickness_cm,
        report.false_blocked_pct()
    );
    assert_eq!(report.false_free, 0);
    assert!(report.hit > SEGMENTS / 50 && report.judged - report.hit > SEGMENTS / 50, "hardly tried: {report:?}");
}

#[test]
fn no_segment_called_free_touches_a_real_comb() {
    no_false_free("solids/comb.stl", LengthUnit::Mm, None);
}

#[test]
fn no_segment_called_free_touches_a_real_gear() {
    no_false_free("solids/gear.stl", LengthUnit::Mm, Some(3.134_18));
}

#[test]
fn no_segment_called_free_touches_a_real_armadillo() {
    no_false_free("solids/armadillo.obj", LengthUnit::Cm, Some(ORNAMENT_CM));
}

#[test]
fn strands_dismissed_by_their_bounds_would_have_found_nothing() {
    let report = cull(2_000, 25, 30).unwrap();
    assert!(report.same && report.found > 100, "{report:?}");
    assert!(report.asked_pct < 50.0, "hardly anything was dismissed: {report:?}");
}
