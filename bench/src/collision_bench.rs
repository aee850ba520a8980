//! What distance fields cost and how far they are off: seconds and bytes of baking, samples a second, errors against every
//! triangle in turn.
//!
//! The truth is plain: the least distance over all triangles, and the sum of all their solid angles, in double precision.

use std::path::Path;
use std::time::Instant;

use collision::{BakeParams, Samples, SignedDistanceField, bake_from_mesh};
use cpu_time::ThreadTime;
use io_formats::{LengthUnit, TriMesh, read_mesh};
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use crate::error::Error;
use crate::shapes::{self, CombParams};
use crate::shapes_bumpy::bumpy_ball;
use crate::shapes_gear::{GearParams, gear_mesh};
use crate::shapes_hand::Hand;

/// One row: a name, its unit, its value.
pub type Row = (String, &'static str, f64);

/// Bakes repeated, the fastest counts.
const BAKES: usize = 3;

/// Baking: every cell of 128³ of 81,920 triangles, then each solid as it comes.
///
/// # Errors
/// A solid that cannot be read or baked.
pub fn baking(solids: &Path) -> Result<Vec<Row>, Error> {
    const RADIUS_CM: f64 = 5.0;
    let ball = bumpy_ball(6, RADIUS_CM);
    let (low, high) = ball.bounds().unwrap_or_default();
    let size = (0..3).map(|k| high[k] - low[k]).fold(0.0, f32::max);
    let mut rows = Vec::new();
    // 124 cells across the ball and two on either side.
    let near = BakeParams { margin: 0.0, ..BakeParams::with_cell(size / 124.0) };
    let whole = BakeParams { band_cells: f32::INFINITY, ..near };
    for (name, params) in [("82k_128", whole), ("82k_128_near", near)] {
        let (field, seconds) = timed("ball", &ball, params)?;
        rows.push((format!("bake_{name}_s"), "s", seconds));
        rows.push((format!("bake_{name}_mb"), "MB", field.memory_bytes() as f64 / 1e6));
    }
    for (name, mesh) in meshes(solids)? {
        let (field, seconds) = timed(&name, &mesh, BakeParams::automatic())?;
        rows.push((format!("bake_{name}_s"), "s", seconds));
        rows.push((format!("bake_{name}_mb"), "MB", field.memory_bytes() as f64 / 1e6));
        rows.push((format!("bake_{name}_cell"), "cm", f64::from(field.cell())));
    }
    Ok(rows)
}

fn timed(name: &str, mesh: &TriMesh, params: BakeParams) -> Result<(SignedDistanceField, f64), Error> {
    let mut best = f64::INFINITY;
    let mut field = None;
    for _ in 0..BAKES {
        let begin = Instant::now();
        field = Some(bake(name, mesh, params)?);
        best = best.min(begin.elapsed().as_secs_f64());
    }
    match field {
        Some(field) => Ok((field, best)),
        None => Ok((bake(name, mesh, params)?, best)),
    }
}

fn bake(name: &str, mesh: &TriMesh, params: BakeParams) -> Result<SignedDistanceField, Error> {
    bake_from_mesh(&mesh.vertices, &mesh.triangles, params)
        .map_err(|source| Error::Bake { name: name.to_owned(), source })
}

/// Samples with gradient a second and core, in batches and one by one, at points along hair near a head and near a comb.
///
/// # Errors
/// None in practice: the solids are built in.
pub fn sampling(_: &Path) -> Result<Vec<Row>, Error> {
    const ROUNDS: usize = 100;
    let mut rows = Vec::new();
    for (solid, reach_cm) in [(shapes::head()?, 1.0), (shapes::comb(CombParams::dressing())?, 0.3)] {
        let field = &solid.sdf;
        let points = along_hair(field, reach_cm);
        let n = points[0].len();
        let mut out = [(); 4].map(|()| vec![0.0f32; n]);
        let mut best = [f64::INFINITY; 2];
        for _ in 0..ROUNDS {
            let [distance, x, y, z] = &mut out;
            let begin = ThreadTime::now();
            field.sample([&points[0], &points[1], &points[2]], &mut Samples { distance, gradient: [x, y, z] });
            best[0] = best[0].min(begin.elapsed().as_secs_f64());
            let begin = ThreadTime::now();
            for k in 0..n {
                let (d, g) = field.distance_gradient(Vector3::new(points[0][k], points[1][k], points[2][k]));
                (out[0][k], out[1][k], out[2][k], out[3][k]) = (d, g.x, g.y, g.z);
            }
            best[1] = best[1].min(begin.elapsed().as_secs_f64());
        }
        let [batch, single] = best.map(|s| n as f64 / s / 1e6);
        rows.push((format!("msamples_per_s_core_{}", solid.name), "M/s", batch));
        rows.push((format!("msamples_per_s_core_{}_singly", solid.name), "M/s", single));
    }
    let least = rows.iter().step_by(2).map(|r| r.2).fold(f64::INFINITY, f64::min);
    rows.push(("msamples_per_s_core".to_owned(), "M/s", least));
    Ok(rows)
}

/// Points a centimetre apart along short strands near the surface, strand by strand.
fn along_hair(field: &SignedDistanceField, reach_cm: f32) -> [Vec<f32>; 3] {
    const STRANDS: usize = 1024;
    const PARTICLES: usize = 25;
    let mut random = Pcg64Mcg::seed_from_u64(7);
    let (low, size) = (field.bounds().min, field.bounds().size());
    let mut points = [(); 3].map(|()| Vec::with_capacity(STRANDS * PARTICLES));
    while points[0].len() < STRANDS * PARTICLES {
        let mut p = low + size.map(|s| s * random.random::<f32>());
        if field.distance(p).abs() > reach_cm {
            continue;
        }
        let heading = Vector3::from_fn(|_, _| random.random::<f32>() - 0.5).normalize();
        for _ in 0..PARTICLES {
            for k in 0..3 {
                points[k].push(p[k]);
            }
            // Along the surface, as hair that lies on it.
            let (d, normal) = field.outward_normal(p);
            let along = heading - normal * heading.dot(&normal);
            p += along * 0.3 - normal * (d - 0.5 * reach_cm).clamp(-0.1, 0.1);
        }
    }
    points
}

/// Errors of each solid's field against every triangle: near the surface and within its box.
///
/// # Errors
/// A solid that cannot be read or baked.
pub fn errors(solids: &Path) -> Result<Vec<Row>, Error> {
    let mut rows = Vec::new();
    for (name, mesh) in meshes(solids)? {
        let field = bake(&name, &mesh, BakeParams::automatic())?;
        let Found { largest_cells, wrong_signs, over_bound } = compare(&field, &mesh);
        // Where a mesh is open the truth itself has no sign near its holes, nor a distance to what closes them.
        if mesh.is_closed() {
            rows.push((format!("error_{name}"), "cells", largest_cells));
            rows.push((format!("over_bound_{name}"), "of 1500", over_bound as f64));
        }
        rows.push((format!("wrong_signs_{name}"), "of 1500", wrong_signs as f64));
    }
    Ok(rows)
}

struct Found {
    /// Largest error within the field's band, in cells.
    largest_cells: f64,
    /// Points farther than a cell from the surface on its wrong side.
    wrong_signs: usize,
    /// Points outside whose lower bound is above their distance by more than rounding.
    over_bound: usize,
}

fn compare(field: &SignedDistanceField, mesh: &TriMesh) -> Found {
    const POINTS: usize = 1500;
    /// Distances are single precision, coordinates up to some tens of centimetres.
    const ROUND_OFF_CM: f64 = 2e-5;
    let mut random = Pcg64Mcg::seed_from_u64(11);
    let cell = field.cell();
    let bounds = field.bounds();
    let points: Vec<Vector3<f32>> = (0..POINTS)
        .map(|n| {
            if n % 3 == 2 {
                return bounds.min + bounds.size().map(|s| s * random.random::<f32>());
            }
            let t = mesh.triangles[random.random_range(0..mesh.triangles.len())];
            let [a, b, c] = t.map(|v| Vector3::from(mesh.vertices[v as usize]));
            let (u, v) = (random.random::<f32>(), random.random::<f32>());
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            let away = Vector3::from_fn(|_, _| random.random::<f32>() - 0.5) * (8.0 * cell);
            a + (b - a) * u + (c - a) * v + away
        })
        .collect();
    let judged: Vec<(f64, bool, bool)> = points
        .par_iter()
        .map(|p| {
            let (distance, winding) = truth(mesh, p.cast());
            let sampled = f64::from(field.distance(*p));
            // An open mesh winds by a fraction where nobody can tell.
            let clear = (winding.abs() - winding.abs().round()).abs() < 0.1;
            let inside = winding.abs() > 0.5;
            let signed = if inside { -distance } else { distance };
            let wrong = clear && distance > f64::from(cell) && (sampled < 0.0) != inside;
            let over = sampled > 0.0 && f64::from(field.lower_bound(*p)) > signed + ROUND_OFF_CM;
            let error = if distance <= f64::from(field.band()) { (sampled - signed).abs() } else { 0.0 };
            (error / f64::from(cell), wrong, over)
        })
        .collect();
    Found {
        largest_cells: judged.iter().map(|j| j.0).fold(0.0, f64::max),
        wrong_signs: judged.iter().filter(|j| j.1).count(),
        over_bound: judged.iter().filter(|j| j.2).count(),
    }
}

/// Distance to the nearest of all triangles, and how often all of them wind around.
fn truth(mesh: &TriMesh, p: Vector3<f64>) -> (f64, f64) {
    let (mut least, mut angle) = (f64::INFINITY, 0.0);
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|v| Vector3::from(mesh.vertices[v as usize]).cast::<f64>() - p);
        least = least.min(to_triangle(a, b, c));
        let [la, lb, lc] = [a.norm(), b.norm(), c.norm()];
        let denominator = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        angle += 2.0 * a.dot(&b.cross(&c)).atan2(denominator);
    }
    (least, angle / (2.0 * std::f64::consts::TAU))
}

/// Distance of the origin to a triangle.
fn to_triangle(a: Vector3<f64>, b: Vector3<f64>, c: Vector3<f64>) -> f64 {
    let edge = |a: Vector3<f64>, b: Vector3<f64>| {
        let e = b - a;
        let s = if e.norm_squared() > 0.0 { (-a.dot(&e) / e.norm_squared()).clamp(0.0, 1.0) } else { 0.0 };
        (a + e * s).norm()
    };
    let normal = (b - a).cross(&(c - a));
    let is_left = |a: Vector3<f64>, b: Vector3<f64>| (b - a).cross(&-a).dot(&normal) >= 0.0;
    let on_edges = edge(a, b).min(edge(b, c)).min(edge(c, a));
    let over_face = normal.norm() > 0.0 && is_left(a, b) && is_left(b, c) && is_left(c, a);
    if over_face { on_edges.min((a.dot(&normal) / normal.norm()).abs()) } else { on_edges }
}

/// Generated solids, and those of the directory that are there, in centimetres.
fn meshes(solids: &Path) -> Result<Vec<(String, TriMesh)>, Error> {
    let hand = Hand::new(0.15)?;
    let halfway = TriMesh { vertices: hand.posed(0.6), triangles: hand.mesh.triangles.clone() };
    let mut out = vec![("made_gear".to_owned(), gear_mesh(GearParams::large())?), ("made_hand".to_owned(), halfway)];
    // Scaled to their size in life where the file is normalised.
    let files = [
        ("armadillo", "armadillo.obj", LengthUnit::Cm, 20.0),
        ("comb", "comb.stl", LengthUnit::Mm, 1.0),
        ("gear", "gear.stl", LengthUnit::Mm, 1.0),
        ("hand", "hand_closed.obj", LengthUnit::Cm, 18.0),
        ("horse_inside_out", "horse.ply", LengthUnit::M, 1.0),
        ("bust_open", "sintel_bust.obj", LengthUnit::M, 1.0),
    ];
    for (name, file, unit, scale) in files {
        let path = solids.join(file);
        if path.exists() {
            out.push((name.to_owned(), read_mesh(&path, unit)?.scaled(scale)));
        }
    }
    Ok(out)
}
