//! Runs of one scene in several ways, looked at while they go: pictures at the same moments, flicker and error over time.
//!
//! What is measured is defined in [`crate::measures`] and [`crate::runtime_bench::quality`]; here it is only kept step by step. All
//! ways of a scene are held against one run in full space.

use crate::error::Error;
use crate::evidence::{Picture, Place, View};
use crate::measures::{second_difference, strands_inside};
use crate::run::ErrorSum;
use crate::runtime_bench::quality::{FullRun, Quality, full_run_watched, measure_watched};
use crate::runtime_bench::{Subject, quantile};
use crate::world::World;
use adaptive_runtime::Runtime;

/// Second difference over a step below which hair is at rest, cm: two micrometres, two thousandths of what gravity alone
/// does to a falling hair.
const AT_REST_CM: f64 = 2e-4;
/// Share of second differences below the flicker that is plotted.
const FLICKER_QUANTILE: f64 = 0.999;

/// A scene in full space, with what is held against it.
pub struct Reference {
    /// Reach, measures and frames.
    pub run: FullRun,
    /// Flicker of its near strands over time, (s, mm).
    pub flicker: Vec<[f64; 2]>,
    /// Its hair at the moments asked for.
    pub shots: Vec<Vec<[f32; 3]>>,
    rest: Vec<[f32; 3]>,
    near: Vec<u32>,
}

/// One way to skin the scene's hair.
pub struct Watched {
    /// The measures.
    pub quality: Quality,
    /// Flicker of near strands of the reference over time, (s, mm).
    pub flicker: Vec<[f64; 2]>,
    /// Error of near strands over time, (s, % of length).
    pub error: Vec<[f64; 2]>,
    /// Its hair at the moments asked for: all of it.
    pub shots: Vec<Vec<[f32; 3]>>,
}

impl Watched {
    /// Flicker over full space's: near strands' median and 99.9th percentile. There is no median to hold against where most of full
    /// space's hair is at rest.
    #[must_use]
    pub fn flicker_over(&self, reference: &Reference) -> [f64; 2] {
        let (ours, full) = (&self.quality.beside, &reference.run.measured);
        let ratio = |a: f64, b: f64, least: f64| if b > least { a / b } else { f64::NAN };
        [
            ratio(ours.flicker_near_median_cm, full.flicker_near_median_cm, AT_REST_CM),
            ratio(ours.flicker_near_p999_cm, full.flicker_near_p999_cm, 0.0),
        ]
    }

    /// Standoff beyond full space's, mm.
    #[must_use]
    pub fn standoff_mm(&self, reference: &Reference) -> f64 {
        10.0 * (self.quality.beside.mean_standoff_cm - reference.run.measured.mean_standoff_cm)
    }

    /// Error of near and of all strands, % of length.
    #[must_use]
    pub fn error_pct(&self) -> [f64; 2] {
        let e = self.quality.error.unwrap_or_default();
        [e.near, e.all]
    }

    /// Effective guides of near strands, mean over the scene.
    #[must_use]
    pub fn guides(&self) -> f64 {
        let effective = &self.quality.effective;
        effective.iter().map(|e| e[0]).sum::<f64>() / effective.len().max(1) as f64
    }
}

/// Steps, counted from one, at which the scene is read at or after the moments (s).
#[must_use]
pub fn steps_at(world: &World, moments: &[f64]) -> Vec<usize> {
    let last = world.n_steps();
    moments.iter().map(|t| ((t / world.scene.step_s).round() as usize).clamp(1, last)).collect()
}

/// Runs the first `n_reference` hairs in full space and finds what is near.
///
/// # Errors
/// A model, scene or strands that cannot be used.
pub fn reference(
    place: &dyn Place,
    subject: &Subject,
    n_measured: usize,
    n_reference: usize,
    moments: &[f64],
) -> Result<Reference, Error> {
    let (world, n) = (subject.world, subject.model.n_particles as usize);
    let (at, steps) = (steps_at(world, moments), world.n_steps());
    let what = format!("{}, full space", world.scene.name);
    let mut all = Flicker::new(subject.dt(), n);
    let mut shots = vec![Vec::new(); moments.len()];
    let mut kept: Vec<Vec<[f32; 3]>> = Vec::new();
    let run = full_run_watched(subject, n_measured, n_reference, |step, positions| {
        shoot(&at, step, positions, &mut shots);
        kept.push(positions.to_vec());
        if kept.len() > 3 {
            kept.remove(0);
        }
        all.steps.push(kept.as_slice().try_into().ok().map(|[a, b, c]: &[Vec<[f32; 3]>; 3]| strand_flicker(a, b, c)));
        place.progress(&what, step, steps);
    })?;
    let near = near_of(&run);
    let rest: Vec<[f32; 3]> = (0..run.n_reference).flat_map(|s| subject.model.rest_of(s).to_vec()).collect();
    Ok(Reference { flicker: all.of(&near), run, shots, rest, near })
}

/// Runs the subject beside the reference.
///
/// # Errors
/// A model or scene the runtime refuses.
pub fn watch(place: &dyn Place, subject: &Subject, against: &Reference, moments: &[f64]) -> Result<Watched, Error> {
    watch_each(place, subject, against, moments, |_, _| {})
}

/// As [`watch`]; `look` is shown each step's number, from one, and the runtime after it.
///
/// # Errors
/// As [`watch`].
pub fn watch_each(
    place: &dyn Place,
    subject: &Subject,
    against: &Reference,
    moments: &[f64],
    mut look: impl FnMut(usize, &Runtime),
) -> Result<Watched, Error> {
    let (world, n) = (subject.world, subject.model.n_particles as usize);
    let (at, steps, dt) = (steps_at(world, moments), world.n_steps(), subject.dt());
    let points = against.run.n_reference * n;
    let mut flicker = Flicker::new(dt, n);
    let mut error = Vec::new();
    let mut shots = vec![Vec::new(); moments.len()];
    let mut kept: Vec<Vec<[f32; 3]>> = Vec::new();
    let mut reads = 0;
    let quality = measure_watched(subject, &against.run, |step, runtime| {
        let positions = runtime.positions();
        shoot(&at, step, positions, &mut shots);
        let positions = &positions[..points];
        kept.push(positions.to_vec());
        if kept.len() > 3 {
            kept.remove(0);
        }
        flicker
            .steps
            .push(kept.as_slice().try_into().ok().map(|[a, b, c]: &[Vec<[f32; 3]>; 3]| strand_flicker(a, b, c)));
        if world.is_read(step)
            && let Some(frame) = against.run.frames.get(reads)
        {
            let t = step as f64 * dt;
            let mut sum = ErrorSum::new(&against.rest, n, &against.near);
            sum.add(positions, frame, &world.world_from_head(t).cast());
            error.push([t, sum.finish().near]);
            reads += 1;
        }
        look(step, runtime);
        place.progress(&world.scene.name, step, steps);
    })?;
    Ok(Watched { quality, flicker: flicker.of(&against.near), error, shots })
}

fn shoot(at: &[usize], step: usize, positions: &[[f32; 3]], shots: &mut [Vec<[f32; 3]>]) {
    for (_, shot) in at.iter().zip(shots).filter(|(wanted, _)| **wanted == step) {
        *shot = positions.to_vec();
    }
}

/// Strands of the reference that come into reach at some time.
fn near_of(run: &FullRun) -> Vec<u32> {
    let mut is_near = vec![false; run.n_reference];
    for &s in run.reach.iter().flatten() {
        if let Some(near) = is_near.get_mut(s as usize) {
            *near = true;
        }
    }
    (0..run.n_reference as u32).filter(|&s| is_near[s as usize]).collect()
}

/// Second differences of all particles, cm.
fn strand_flicker(a: &[[f32; 3]], b: &[[f32; 3]], c: &[[f32; 3]]) -> Vec<f32> {
    a.iter().zip(b).zip(c).map(|((a, b), c)| second_difference(*a, *b, *c)).collect()
}

/// Second differences of every particle at every step that has two before it.
struct Flicker {
    dt: f64,
    n: usize,
    steps: Vec<Option<Vec<f32>>>,
}

impl Flicker {
    fn new(dt: f64, n: usize) -> Self {
        Self { dt, n, steps: Vec::new() }
    }

    /// A high percentile over the named strands by step, (s, mm).
    fn of(&self, near: &[u32]) -> Vec<[f64; 2]> {
        let of_step = |(step, sizes): (usize, &Option<Vec<f32>>)| {
            let sizes = sizes.as_ref()?;
            let particles = |&s: &u32| &sizes[s as usize * self.n + 2..(s as usize + 1) * self.n];
            let values: Vec<f64> = near.iter().flat_map(particles).map(|&x| f64::from(x)).collect();
            Some([(step + 1) as f64 * self.dt, 10.0 * quantile(&values, FLICKER_QUANTILE)])
        };
        self.steps.iter().enumerate().filter_map(of_step).collect()
    }
}

/// Hair and what of it is inside a solid, linear RGB.
const MARKED: [[f32; 3]; 2] = [[0.26, 0.135, 0.06], [0.9, 0.02, 0.02]];

/// How several ways are shown side by side.
#[derive(Clone, Copy)]
pub struct Row<'a> {
    /// Its name, also in files.
    pub name: &'a str,
    /// Time, s.
    pub t: f64,
    /// The first so many hairs of each way.
    pub n_strands: usize,
    /// Whether hair that is inside a solid is red.
    pub marks: bool,
}

/// The same moment in several ways, side by side.
///
/// # Errors
/// As [`Place::draw`].
pub fn side_by_side(
    place: &dyn Place,
    world: &World,
    row: Row,
    ways: &[(&str, &[[f32; 3]])],
) -> Result<Vec<Picture>, Error> {
    let (n, t, dt) = (world.groom.n_particles, row.t, world.scene.step_s);
    let mut pictures = Vec::new();
    for (way, positions) in ways {
        let positions = &positions[..positions.len().min(row.n_strands.saturating_mul(n))];
        let colors: Option<Vec<[f32; 3]>> = row.marks.then(|| {
            let inside = strands_inside(positions, n, &world.moving_solids((t - dt).max(0.0), dt.min(t)));
            inside.into_iter().map(|inside| MARKED[usize::from(inside)]).collect()
        });
        let view = View { world, t, positions, colors: colors.as_deref(), turn: 0.0 };
        let words = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' };
        let name = format!("{}-{}", row.name, way.chars().map(words).collect::<String>());
        pictures.push(place.draw(&name, &format!("{way}, {t:.2} s"), row.name, &view)?);
    }
    Ok(pictures)
}
