//! What the interpolation check calls free and blocked beside the exact test on the triangles (AS16 §4.2), and what the
//! distance bounds of strands save when a comb stands in a head of hair.
//!
//! The exact tests share nothing with the fields they judge but the mesh. Both are functions of their seeds.

use crate::error::Error;
use crate::grooms::{GroomParams, Style, generate};
use crate::shapes::{self, CombParams, solid_mesh};
use crate::strand_bench::Row;
use collision::contact::deepest_on_segment;
use collision::cull::DistanceBound;
use collision::surface::Surface;
use collision::{BakeParams, MovingSolid, Solid, SolidPose, segment_is_free};
use cpu_time::ProcessTime;
use io_formats::TriMesh;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// What the check on a field said of segments near a solid, beside the exact test on its triangles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CheckReport {
    /// Segments that start outside the solid: those judged.
    pub judged: usize,
    /// Of these, such as touch the surface.
    pub hit: usize,
    /// Segments called free that touch.
    pub false_free: usize,
    /// Segments called blocked.
    pub blocked: usize,
    /// Of these, such as do not touch.
    pub false_blocked: usize,
    /// How near to the surface the farthest of those comes, cells.
    pub false_blocked_within: f64,
}

impl CheckReport {
    fn add(self, other: Self) -> Self {
        Self {
            judged: self.judged + other.judged,
            hit: self.hit + other.hit,
            false_free: self.false_free + other.false_free,
            blocked: self.blocked + other.blocked,
            false_blocked: self.false_blocked + other.false_blocked,
            false_blocked_within: self.false_blocked_within.max(other.false_blocked_within),
        }
    }

    /// Share of the segments that touch nothing and are called blocked, percent.
    #[must_use]
    pub fn false_blocked_pct(&self) -> f64 {
        100.0 * self.false_blocked as f64 / (self.judged - self.hit).max(1) as f64
    }

    /// Share of the segments called blocked that touch nothing, percent.
    #[must_use]
    pub fn blocked_falsely_pct(&self) -> f64 {
        100.0 * self.false_blocked as f64 / self.blocked.max(1) as f64
    }
}

/// Share of a solid's half-thickness down to which the runtime looks: its standard `gap_resolution`.
const GAP_RESOLUTION: f32 = 0.5;

/// Farther than any segment that is called blocked, cm.
const FAR_CM: f64 = 5.0;

/// Longest segment tried and farthest start from the surface, cm: guides are a centimetre or two apart.
const REACH_CM: f32 = 2.0;

/// Tries `n` random segments of up to 2 cm a side, starting outside within 2 cm of the solid's surface.
///
/// # Errors
/// [`Error::Bake`] of a mesh that has no surface.
pub fn check_segments(solid: &Solid, mesh: &TriMesh, n: usize, seed: u64) -> Result<CheckReport, Error> {
    let surface = Surface::new(&mesh.vertices, &mesh.triangles)
        .map_err(|source| Error::Bake { name: solid.name.clone(), source })?;
    let resolution = GAP_RESOLUTION * solid.half_thickness_cm;
    let segments: Vec<[Vector3<f32>; 2]> = {
        let mut random = Pcg64::seed_from_u64(seed);
        (0..n).map(|_| segment_near(mesh, &mut random)).collect()
    };
    let judge = |&[a, b]: &[Vector3<f32>; 2]| {
        if solid.sdf.distance(a) <= 0.0 {
            return CheckReport::default();
        }
        let free = segment_is_free(&solid.sdf, a, b, resolution);
        let hit = surface.is_hit_by(&[a.cast(), b.cast()]);
        CheckReport {
            judged: 1,
            hit: usize::from(hit),
            false_free: usize::from(free && hit),
            blocked: usize::from(!free),
            false_blocked: usize::from(!free && !hit),
            false_blocked_within: if free || hit {
                0.0
            } else {
                surface.distance_within(&[a.cast(), b.cast()], FAR_CM) / f64::from(solid.sdf.cell())
            },
        }
    };
    Ok(segments.par_iter().map(judge).reduce(CheckReport::default, CheckReport::add))
}

fn segment_near(mesh: &TriMesh, random: &mut Pcg64) -> [Vector3<f32>; 2] {
    let [a, b, c] =
        mesh.triangles[random.random_range(0..mesh.triangles.len())].map(|v| Vector3::from(mesh.vertices[v as usize]));
    let (u, v): (f32, f32) = (random.random(), random.random());
    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
    let mut step = |size: f32| {
        let scale = size * random.random::<f32>();
        Vector3::from_fn(|_, _| random.random_range(-1.0..1.0f32)) * scale
    };
    let from = a + (b - a) * u + (c - a) * v + step(REACH_CM);
    [from, from + step(REACH_CM)]
}

/// 100,000 segments near each of the built-in head, the dressing comb and a sphere, all baked from their meshes: those falsely
/// called free; those falsely called blocked, as a share of those that touch nothing and of those called blocked; and
/// how near to the surface the farthest of these comes.
///
/// # Errors
/// As the generators.
pub fn interpolation_check() -> Result<Vec<Row>, Error> {
    const SEGMENTS: usize = 100_000;
    let names = [
        ["head_false_free", "head_false_blocked_pct", "head_blocked_falsely_pct", "head_false_blocked_within"],
        ["comb_false_free", "comb_false_blocked_pct", "comb_blocked_falsely_pct", "comb_false_blocked_within"],
        ["sphere_false_free", "sphere_false_blocked_pct", "sphere_blocked_falsely_pct", "sphere_false_blocked_within"],
    ];
    let solids = [(shapes::head()?, 0.2), (shapes::comb(CombParams::dressing())?, 0.02), (shapes::sphere(2.0)?, 0.1)];
    let mut rows = Vec::new();
    for ((shape, cell), [false_free, false_blocked_pct, blocked_falsely_pct, within]) in solids.into_iter().zip(names) {
        let mesh = solid_mesh(&shape);
        let mut solid =
            Solid::from_mesh(&shape.name, &mesh.vertices, &mesh.triangles, BakeParams::with_cell(cell), 0.2)
                .map_err(|source| Error::Bake { name: shape.name.clone(), source })?;
        // The extracted mesh has slivers whose thickness is none of the solid's.
        solid.half_thickness_cm = shape.half_thickness_cm;
        let report = check_segments(&solid, &mesh, SEGMENTS, 7)?;
        rows.push((false_free, "segments", report.false_free as f64));
        rows.push((false_blocked_pct, "% of free", report.false_blocked_pct()));
        rows.push((blocked_falsely_pct, "% of blocked", report.blocked_falsely_pct()));
        rows.push((within, "cells", report.false_blocked_within));
    }
    Ok(rows)
}

/// A head of hair that turns stiffly with the head while a comb goes through it.
struct CombedHead {
    /// Head frame, cm, strand-major.
    points: Vec<Vector3<f64>>,
    particles: usize,
    comb: Solid,
}

/// Length of a step, s.
const STEP_S: f64 = 0.01;

/// Distance within which a segment is in contact or watched, cm: the standard of `strand_sim::ContactParams::reach`.
const REACH_OF_CONTACT_CM: f32 = 0.112;

/// Places of particles in the world, cm.
type Particles<'a> = &'a [[f32; 3]];

/// What a strand's segments are to the comb: how many are within reach, and the sum of their distances, cm.
type Found = (u64, f64);

impl CombedHead {
    fn new(strands: usize, particles: usize) -> Result<Self, Error> {
        let head = shapes::head()?;
        let groom = generate(&GroomParams {
            style: Style::Straight,
            strands,
            particles,
            length_cm: 25.0,
            seed: 1,
            head: &head,
        })?;
        let points = groom.points.iter().map(|&p| Vector3::from(p).cast()).collect();
        Ok(Self { points, particles, comb: shapes::comb(CombParams::dressing())? })
    }

    /// The head turned from side to side, half a radian either way, once a second.
    fn head_at(time_s: f64) -> Isometry3<f64> {
        let turn = 0.5 * (std::f64::consts::TAU * time_s).sin();
        Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_axis_angle(&Vector3::y_axis(), turn))
    }

    /// The comb behind the head, teeth inwards, drawn down at half a metre a second.
    fn comb_at(time_s: f64) -> Isometry3<f64> {
        let teeth_inwards = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::PI);
        Isometry3::from_parts(Translation3::new(0.0, 2.0 - 50.0 * time_s, -13.0), teeth_inwards)
    }

    fn moving(&self, step: usize) -> MovingSolid<'_> {
        let at = |step: usize| Self::comb_at(step as f64 * STEP_S);
        MovingSolid { solid: &self.comb, pose: SolidPose { from: at(step), to: at(step + 1) } }
    }

    /// Where the hair is after so many steps (world, cm).
    fn place(&self, step: usize, positions: &mut Vec<[f32; 3]>) {
        let head = Self::head_at(step as f64 * STEP_S);
        positions.clear();
        positions.extend(self.points.iter().map(|p| -> [f32; 3] { (head * Point3::from(*p)).coords.cast().into() }));
    }

    /// What is done for a strand that may touch: every segment asks the field.
    fn ask(&self, strand: &[[f32; 3]], comb_from_world: &Isometry3<f64>) -> Found {
        let at = |p: &[f32; 3]| in_comb(p, comb_from_world);
        let (mut found, mut a) = ((0, 0.0), at(&strand[0]));
        for p in &strand[1..] {
            let b = at(p);
            let (sdf, spacing) = (&self.comb.sdf, self.comb.half_thickness_cm);
            if let Some(hit) = deepest_on_segment(sdf, a, b, spacing, REACH_OF_CONTACT_CM) {
                found = (found.0 + 1, found.1 + f64::from(hit.distance));
            }
            a = b;
        }
        found
    }

    /// The bound of the runtime: from the particles' distances and the lengths between them.
    fn measure(&self, strand: &[[f32; 3]], comb_from_world: &Isometry3<f64>) -> DistanceBound {
        let mut least = f32::INFINITY;
        let mut before: Option<(Vector3<f32>, f32)> = None;
        for p in strand {
            let x = in_comb(p, comb_from_world);
            let d = self.comb.sdf.lower_bound(x);
            if let Some((y, e)) = before {
                least = least.min(0.5 * (d + e - (x - y).norm()));
            }
            before = Some((x, d));
        }
        DistanceBound::at_least(least)
    }

    /// One step: what all strands find, and how many segments were asked for it.
    fn step(
        &self,
        step: usize,
        [previous, positions]: [Particles; 2],
        bounds: &mut [DistanceBound],
        culled: bool,
    ) -> (u64, f64, u64) {
        let moving = self.moving(step);
        let comb_from_world = moving.pose.to.inverse();
        let by_comb = moving.max_displacement() as f32;
        let n = self.particles;
        let visit = |((strand, before), bound): ((Particles, Particles), &mut DistanceBound)| {
            if culled {
                let moved = strand
                    .iter()
                    .zip(before)
                    .map(|(p, q)| (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2) + (p[2] - q[2]).powi(2));
                bound.moved(moved.fold(0.0, f32::max).sqrt(), by_comb);
                if !bound.clears(REACH_OF_CONTACT_CM) {
                    *bound = self.measure(strand, &comb_from_world);
                }
                if bound.clears(REACH_OF_CONTACT_CM) {
                    return (0, 0.0, 0);
                }
            }
            let (found, distances) = self.ask(strand, &comb_from_world);
            (found, distances, strand.len() as u64 - 1)
        };
        let strands = positions.par_chunks_exact(n).zip(previous.par_chunks_exact(n));
        let visited: Vec<_> = strands.zip(bounds.par_iter_mut()).map(visit).collect();
        visited.into_iter().fold((0, 0.0, 0), |a, b| (a.0 + b.0, a.1 + b.1, a.2 + b.2))
    }

    fn bounds(&self) -> Vec<DistanceBound> {
        vec![DistanceBound::unknown(); self.points.len() / self.particles]
    }
}

fn in_comb(p: &[f32; 3], comb_from_world: &Isometry3<f64>) -> Vector3<f32> {
    comb_from_world.transform_point(&Point3::from(Vector3::from(*p).cast::<f64>())).coords.cast()
}

/// What culling by distance bounds changed over some steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CullReport {
    /// Segments within reach of the comb over all steps, each asked.
    pub found: u64,
    /// Whether culling found the same ones at the same distances.
    pub same: bool,
    /// Segments asked with culling, percent of all.
    pub asked_pct: f64,
    /// How many times faster the steps are.
    pub speed_up: f64,
}

/// Draws a comb through a head of so many strands and particles, with and without the distance bounds that the
/// runtime keeps for each strand; CPU time of all threads, the better of two turns each.
///
/// # Errors
/// As the generators.
pub fn cull(strands: usize, particles: usize, steps: usize) -> Result<CullReport, Error> {
    const TURNS: usize = 2;
    let head = CombedHead::new(strands, particles)?;
    let mut seconds = [f64::INFINITY; 2];
    let mut results = [(0, 0.0, 0); 2];
    for _ in 0..TURNS {
        for (k, culled) in [false, true].into_iter().enumerate() {
            let mut bounds = head.bounds();
            let (mut sum, mut took) = ((0, 0.0, 0), 0.0);
            let (mut previous, mut positions) = (Vec::new(), Vec::new());
            head.place(0, &mut positions);
            for step in 0..steps {
                std::mem::swap(&mut previous, &mut positions);
                head.place(step + 1, &mut positions);
                let clock = ProcessTime::now();
                let found = head.step(step, [&previous, &positions], &mut bounds, culled);
                // The first step measures every bound, once for a whole scene.
                took += if step == 0 { 0.0 } else { clock.elapsed().as_secs_f64() };
                sum = (sum.0 + found.0, sum.1 + found.1, sum.2 + found.2);
            }
            (seconds[k], results[k]) = (seconds[k].min(took), sum);
        }
    }
    let [all, culled] = results;
    Ok(CullReport {
        found: all.0,
        same: all.0 == culled.0 && all.1 == culled.1,
        asked_pct: 100.0 * culled.2 as f64 / all.2 as f64,
        speed_up: seconds[0] / seconds[1],
    })
}

/// `culled_over_unculled`: how many times faster 150,000 strands of 25 particles ask a comb in the hair when strands are
/// dismissed by their distance bounds; `culled_missed`: 1 if anything found differs.
///
/// # Errors
/// As the generators.
pub fn culling() -> Result<Vec<Row>, Error> {
    let report = cull(150_000, 25, 30)?;
    Ok(vec![
        ("culled_over_unculled", "x", report.speed_up),
        ("culled_segments_asked_pct", "%", report.asked_pct),
        ("culled_segments_found", "segments", report.found as f64),
        ("culled_missed", "", f64::from(u8::from(!report.same))),
    ])
}
