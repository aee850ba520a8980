//! Combs swept at random through strands: what goes through, with and without continuous detection.
//!
//! The truth is time cut into thin pieces, each tried exactly against the comb's triangles: nothing of the detection under
//! test is used to judge it.

use crate::error::Error;
use crate::shapes::{self, CombParams};
use crate::strand_bench::Row;
use collision::ccd::first_touch;
use collision::contact::deepest_on_segment;
use collision::segment_pair::{Segment, Sweep, between};
use collision::surface::{MovingSurface, Surface};
use collision::{MovingSolid, Solid, SolidPose};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use strand_sim::{Material, StepInput, StepParams, StepWorkspace, StrandState, StrandSystem, Substeps};

/// What a number of sweeps came to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SweepReport {
    /// Sweeps.
    pub sweeps: usize,
    /// Segments that a tooth went through or into over a step, by the truth.
    pub met: usize,
    /// Of these, found by nothing that was tried.
    pub tunnelled: usize,
    /// Steps that strands took in pieces.
    pub refined: usize,
    /// Segments for which the step said that it could not hold them off.
    pub given_up: usize,
}

impl SweepReport {
    fn add(self, other: Self) -> Self {
        Self {
            sweeps: self.sweeps + other.sweeps,
            met: self.met + other.met,
            tunnelled: self.tunnelled + other.tunnelled,
            refined: self.refined + other.refined,
            given_up: self.given_up + other.given_up,
        }
    }
}

/// Length of a step, s: a substep of the guides' step of 10 ms.
const STEP_S: f64 = 0.005;

/// Length of a comb's way through the hair, cm.
const WAY_CM: f64 = 15.0;

/// Longest way of any point of the comb in one piece of the truth, cm: a quarter of a tooth's radius.
const PIECE_CM: f64 = 0.02;

/// Strands of a scene and particles of each, a centimetre apart.
const STRANDS: usize = 4;
const PARTICLES: usize = 25;

/// A comb with its triangles.
pub struct Comb {
    solid: Solid,
    surface: Surface,
}

impl Comb {
    /// The dressing comb.
    ///
    /// # Errors
    /// As [`shapes::comb`].
    pub fn dressing() -> Result<Self, Error> {
        let params = CombParams::dressing();
        let solid = shapes::comb(params)?;
        let (mut points, mut triangles) = (Vec::new(), Vec::new());
        let half_width = 0.5 * params.pitch_cm * (params.teeth - 1) as f32;
        let end = half_width + params.spine_radius_cm;
        let spine = [-Vector3::x() * end, Vector3::x() * end];
        add_rod(spine, [params.spine_radius_cm; 2], &mut points, &mut triangles);
        let tip_radius = 0.75 * params.tooth_radius_cm;
        for k in 0..params.teeth {
            let root = Vector3::x() * (params.pitch_cm * k as f32 - half_width);
            let tip = root - Vector3::z() * (params.tooth_length_cm - tip_radius);
            add_rod([root, tip], [params.tooth_radius_cm, tip_radius], &mut points, &mut triangles);
        }
        let surface =
            Surface::new(&points, &triangles).map_err(|source| Error::Bake { name: "comb".to_owned(), source })?;
        Ok(Self { solid, surface })
    }
}

/// A rod with round ends as a closed mesh: long faces, for its sides are straight. It lies inside the true rod by two
/// hundredths of the radius at most.
fn add_rod(ends: [Vector3<f32>; 2], radii: [f32; 2], points: &mut Vec<[f32; 3]>, triangles: &mut Vec<[u32; 3]>) {
    const SIDES: u32 = 16;
    const CAP_RINGS: u32 = 4;
    let axis = (ends[1] - ends[0]).normalize();
    let u = axis.cross(&if axis.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() }).normalize();
    let v = axis.cross(&u);
    let first = points.len() as u32;
    let n_rings = 2 * (CAP_RINGS + 1);
    for ring in 0..n_rings {
        let cap = usize::from(ring > CAP_RINGS);
        let step = if cap == 0 { ring } else { ring - 1 };
        let polar = std::f32::consts::PI * step as f32 / (2 * CAP_RINGS) as f32;
        for side in 0..SIDES {
            let turn = std::f32::consts::TAU * side as f32 / SIDES as f32;
            let out = (u * turn.cos() + v * turn.sin()) * polar.sin() - axis * polar.cos();
            points.push((ends[cap] + out * radii[cap]).into());
        }
    }
    for ring in 0..n_rings - 1 {
        for side in 0..SIDES {
            let at = |ring: u32, side: u32| first + ring * SIDES + side % SIDES;
            triangles.push([at(ring, side), at(ring, side + 1), at(ring + 1, side)]);
            triangles.push([at(ring + 1, side), at(ring, side + 1), at(ring + 1, side + 1)]);
        }
    }
}

fn vector(random: &mut Pcg64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| random.random_range(-1.0..1.0))
}

/// Where the comb is after so many steps: a straight way in any direction at 1 to 5 m/s through about the middle of the
/// hair, turning at up to ten radians a second.
struct Way {
    through: Isometry3<f64>,
    per_step: Vector3<f64>,
    turn_per_step: Vector3<f64>,
}

impl Way {
    fn random(random: &mut Pcg64) -> Self {
        let direction = vector(random).try_normalize(1e-3).unwrap_or_else(Vector3::x);
        let through = Isometry3::from_parts(
            Translation3::from(
                Vector3::new(0.0, -12.0, 0.0) + vector(random).component_mul(&Vector3::new(2.0, 8.0, 2.0)),
            ),
            UnitQuaternion::from_scaled_axis(vector(random) * std::f64::consts::PI),
        );
        Self {
            through,
            per_step: direction * (random.random_range(100.0..500.0) * STEP_S),
            turn_per_step: vector(random) * (10.0 * STEP_S),
        }
    }

    /// Steps of the whole way, at least one.
    fn steps(&self) -> usize {
        ((WAY_CM / self.per_step.norm()).round() as usize).max(1)
    }

    fn at(&self, step: usize) -> Isometry3<f64> {
        let k = step as f64 - 0.5 * self.steps() as f64;
        Isometry3::from_parts(
            Translation3::from(self.through.translation.vector + self.per_step * k),
            UnitQuaternion::from_scaled_axis(self.turn_per_step * k) * self.through.rotation,
        )
    }

    /// One step in the middle of the way.
    fn middle(&self) -> SolidPose {
        self.step(self.steps() / 2)
    }

    fn step(&self, k: usize) -> SolidPose {
        SolidPose { from: self.at(k), to: self.at(k + 1) }
    }
}

/// Whether the segment is found in the surface in any piece of the step but the first, at which it may start inside.
fn is_met(comb: &Comb, pose: &SolidPose, way: &Sweep) -> bool {
    let travel = pose.max_displacement(&comb.solid.sdf.bounds());
    let hair = (0..2).map(|e| (way.end[e] - way.start[e]).norm()).fold(0.0, f64::max);
    let pieces = ((travel + hair) / PIECE_CM).ceil() as usize;
    let [low, high] = comb.surface.bounds_over(pose);
    let points = [way.start[0], way.start[1], way.end[0], way.end[1]];
    let apart = (0..3).any(|c| points.iter().all(|p| p[c] < low[c]) || points.iter().all(|p| p[c] > high[c]));
    let seen = |time: f64| -> Segment {
        let pose = pose.at(time);
        between(&way.start, &way.end, time).map(|x| pose.inverse_transform_point(&Point3::from(x)).coords)
    };
    if apart || comb.surface.is_hit_by(&seen(0.0)) {
        return false;
    }
    // Runs of pieces in which nothing can come from where it is halfway to a touch need no look at each.
    let mut runs = vec![(1, pieces)];
    while let Some((first, last)) = runs.pop() {
        let middle = usize::midpoint(first, last);
        let seen = seen(middle as f64 / pieces as f64);
        if first == last {
            if comb.surface.is_hit_by(&seen) {
                return true;
            }
        } else if comb.surface.is_within(&seen, PIECE_CM * (last - first) as f64) {
            runs.extend([(first, middle), (middle + 1, last)]);
        }
    }
    false
}

/// Whether the comb comes near the particles at the roots, which no solid moves.
fn meets_roots(comb: &Comb, pose: &SolidPose) -> bool {
    const AWAY_CM: f64 = 0.3;
    let points = hanging();
    points
        .chunks_exact(PARTICLES)
        .any(|strand| first_touch(&comb.surface, pose, &Sweep::still([strand[0], strand[1]]), AWAY_CM).is_some())
}

/// Strands that hang from y = 0, half a centimetre apart.
fn hanging() -> Vec<Vector3<f64>> {
    (0..STRANDS)
        .flat_map(|s| (0..PARTICLES).map(move |i| Vector3::new(0.5 * s as f64 - 0.75, -(i as f64), 0.0)))
        .collect()
}

/// Detection: strands stay where they are, one step a sweep. The first report is with continuous detection, the second with
/// the distance field at the end of the step only.
pub fn detection(comb: &Comb, sweeps: usize, seed: u64) -> [SweepReport; 2] {
    let points = hanging();
    let one = |k: usize| {
        let mut random = Pcg64::seed_from_u64(seed + k as u64);
        let pose = Way::random(&mut random).middle();
        let mut reports = [SweepReport { sweeps: 1, ..SweepReport::default() }; 2];
        for strand in points.chunks_exact(PARTICLES) {
            for ends in strand.windows(2) {
                let way = Sweep::still([ends[0], ends[1]]);
                if !is_met(comb, &pose, &way) {
                    continue;
                }
                let found = first_touch(&comb.surface, &pose, &way, 1e-3).is_some();
                let local = way.end.map(|x| pose.to.inverse_transform_point(&Point3::from(x)).coords.cast::<f32>());
                let spacing = comb.solid.half_thickness_cm;
                let at_end = deepest_on_segment(&comb.solid.sdf, local[0], local[1], spacing, 0.0).is_some();
                for (report, found) in reports.iter_mut().zip([found, at_end]) {
                    report.met += 1;
                    report.tunnelled += usize::from(!found);
                }
            }
        }
        reports
    };
    (0..sweeps).into_par_iter().map(one).reduce(|| [SweepReport::default(); 2], |a, b| [a[0].add(b[0]), a[1].add(b[1])])
}

/// Response: strands are simulated as guides are while the comb goes through them, with contact by the distance
/// field alone or followed exactly as well. A step is taken as one, so that its end is where a straight way leads.
///
/// # Errors
/// None in practice: the strands are fixed.
pub fn response(comb: &Comb, sweeps: usize, seed: u64, exact: bool) -> Result<SweepReport, Error> {
    let system = StrandSystem::new(&hanging(), PARTICLES, Material::straight())?;
    let one = |workspace: &mut StepWorkspace, k: usize| {
        let mut random = Pcg64::seed_from_u64(seed + k as u64);
        let mut way = Way::random(&mut random);
        // Roots are held: a comb that goes through them is in the skull.
        while (0..way.steps()).any(|k| meets_roots(comb, &way.step(k))) {
            way = Way::random(&mut random);
        }
        let mut state = system.rest_state(&Isometry3::identity());
        let mut report = SweepReport { sweeps: 1, ..SweepReport::default() };
        for k in 0..way.steps() {
            report = report.add(judged_step(comb, &system, &mut state, &way, k, exact, workspace));
        }
        report.met = report.tunnelled;
        report
    };
    let workers = (0..sweeps).into_par_iter().map_init(StepWorkspace::default, one);
    Ok(workers.reduce(SweepReport::default, SweepReport::add))
}

/// One step of simulated strands. Where a strand took it in pieces the step is taken again in as many, all strands alike, so
/// that every way is straight and the truth sees all of it.
fn judged_step(
    comb: &Comb,
    system: &StrandSystem,
    state: &mut StrandState,
    way: &Way,
    k: usize,
    exact: bool,
    workspace: &mut StepWorkspace,
) -> SweepReport {
    const MOST_PIECES: usize = 1024;
    let params = StepParams { substeps: Substeps::Fixed(1), ..StepParams::standard() };
    let (begin, whole) = (state.clone(), way.step(k));
    let mut pieces = 1;
    loop {
        let mut report = SweepReport::default();
        let mut refined = 0;
        for piece in 0..pieces {
            let at = |piece: usize| whole.at(piece as f64 / pieces as f64);
            let pose = SolidPose { from: at(piece), to: at(piece + 1) };
            let solids = [MovingSolid { solid: &comb.solid, pose }];
            let surfaces = [MovingSurface { surface: &comb.surface, pose }];
            let input = StepInput {
                solids: &solids,
                surfaces: if exact { &surfaces } else { &[] },
                ..StepInput::still(STEP_S / pieces as f64, Isometry3::identity())
            };
            let before = system.positions(state);
            let step = system.step(state, &input, &params, workspace);
            refined += step.refined;
            report.given_up += step.passing as usize;
            let after = system.positions(state);
            for strand in 0..STRANDS {
                for i in strand * PARTICLES..(strand + 1) * PARTICLES - 1 {
                    let way = Sweep { start: [before[i], before[i + 1]], end: [after[i], after[i + 1]] };
                    report.tunnelled += usize::from(is_met(comb, &pose, &way));
                }
            }
        }
        if refined == 0 || pieces == MOST_PIECES {
            return SweepReport { refined: usize::from(pieces > 1), ..report };
        }
        state.clone_from(&begin);
        pieces *= 4;
    }
}

/// Ten thousand sweeps, half of them past strands at rest and half through simulated ones, and what goes through of either.
/// `progress` is told how many sweeps are done, and of how many.
///
/// # Errors
/// As [`Comb::dressing`] and [`response`].
pub fn sweeps(progress: &mut dyn FnMut(u64, u64)) -> Result<Vec<Row>, Error> {
    const HALF: usize = 5_000;
    const AT_A_TIME: usize = 100;
    let comb = Comb::dressing()?;
    let [followed, at_end] = detection(&comb, HALF, 1);
    let (mut by_field, mut held_off) = (SweepReport::default(), SweepReport::default());
    for first in (0..HALF).step_by(AT_A_TIME) {
        progress((HALF + first) as u64, 2 * HALF as u64);
        by_field = by_field.add(response(&comb, AT_A_TIME, 1 + first as u64, false)?);
        held_off = held_off.add(response(&comb, AT_A_TIME, 1 + first as u64, true)?);
    }
    Ok(vec![
        ("sweeps", "", (followed.sweeps + held_off.sweeps) as f64),
        ("tunnelled_with_ccd", "", (followed.tunnelled + held_off.tunnelled) as f64),
        ("tunnelled_without_ccd", "", (at_end.tunnelled + by_field.tunnelled) as f64),
        ("tunnelled_at_rest_with_ccd", "", followed.tunnelled as f64),
        ("tunnelled_at_rest_without_ccd", "", at_end.tunnelled as f64),
        ("steps_in_pieces_with_ccd", "", held_off.refined as f64),
        ("given_up_with_ccd", "", held_off.given_up as f64),
    ])
}
