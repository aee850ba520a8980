//! A solid swept through a head: the runtime at full size, measured at every step on its first strands, beside full space.
//!
//! Every prefix of a generated groom is an even, sparser groom, so the first strands stand for all. Three numbers of strands: all
//! that are simulated; those *measured*, whose share inside and passed through counts; and those of the *reference*, which
//! are simulated one by one as well and on which flicker, standoff and error are compared.

use super::cost::{full_space, step_full};
use super::{Figure, Subject, resized};
use crate::error::Error;
use crate::measures::{Measured, Observer, Reach};
use crate::run::{ErrorPct, ErrorSum, blind_reach, read_positions};
use adaptive_runtime::{Runtime, RuntimeParams};
use io_formats::skinning_model::SkinningModel;

/// What is compared with: the same for every way to skin the hair.
#[derive(Clone, Debug, Default)]
pub struct FullRun {
    /// Strands in reach at each step, of those measured.
    pub reach: Reach,
    /// Strands measured.
    pub n_measured: usize,
    /// Strands simulated one by one; 0 for none.
    pub n_reference: usize,
    /// Their measures.
    pub measured: Measured,
    /// Their positions at each read, strand-major.
    pub frames: Vec<Vec<[f32; 3]>>,
}

/// How one way to skin the hair did.
#[derive(Clone, Debug, Default)]
pub struct Quality {
    /// Of the strands measured.
    pub measured: Measured,
    /// Of the strands of the reference.
    pub beside: Measured,
    /// Distance to full space, where there is one.
    pub error: Option<ErrorPct>,
    /// 1/Σw² at each step, mean over measured strands that come into reach at some time; over all measured ones.
    pub effective: Vec<[f64; 2]>,
    /// Strands put back because their state was not finite.
    pub quarantined: u64,
}

/// The reach of the first `n_measured` strands, and the run of the first `n_reference` in full space.
///
/// # Errors
/// A model, scene or strands that cannot be used.
pub fn full_run(
    subject: &Subject,
    n_measured: usize,
    n_reference: usize,
    mut progress: impl FnMut(usize),
) -> Result<FullRun, Error> {
    full_run_watched(subject, n_measured, n_reference, |step, _| progress(step))
}

/// As [`full_run`]; `watch` is shown each step's number, from one, and the reference's positions after it.
///
/// # Errors
/// As [`full_run`].
pub fn full_run_watched(
    subject: &Subject,
    n_measured: usize,
    n_reference: usize,
    mut watch: impl FnMut(usize, &[[f32; 3]]),
) -> Result<FullRun, Error> {
    let (world, model) = (subject.world, subject.model);
    let n = model.n_particles as usize;
    let n_measured = n_measured.min(model.n_strands as usize);
    let n_reference = n_reference.min(n_measured);
    // Blind hair does not know its neighbours: fewer strands give the same.
    let few = resized(model, n_measured + model.n_guides(), 1)?;
    let mut reach = blind_reach(world, &few, |_| {})?;
    cut(&mut reach, n_measured);
    let mut out = FullRun { reach, n_measured, n_reference, ..FullRun::default() };
    if n_reference == 0 {
        return Ok(out);
    }
    let mut reach = out.reach.clone();
    cut(&mut reach, n_reference);
    let mut observer = Observer::new(&rest_of_first(model, n_reference), n, &reach);
    let mut full = full_space(world, model, n_reference)?;
    let mut positions = Vec::new();
    let dt = subject.dt();
    for step in 0..world.n_steps() {
        let t = step as f64 * dt;
        step_full(&mut full, world, t, dt);
        full.positions(&mut positions);
        observer.observe(&positions, &world.moving_solids(t, dt), Some(&world.moving_head(t, dt)));
        if world.is_read(step + 1) {
            out.frames.push(positions.clone());
        }
        watch(step + 1, &positions);
    }
    out.measured = observer.finish();
    Ok(out)
}

/// Runs the subject and measures every step.
///
/// # Errors
/// A model or scene the runtime refuses.
pub fn measure(subject: &Subject, against: &FullRun, mut progress: impl FnMut(usize)) -> Result<Quality, Error> {
    measure_watched(subject, against, |step, _| progress(step))
}

/// As [`measure`]; `watch` is shown each step's number, from one, and the hair as read after it.
///
/// # Errors
/// As [`measure`].
pub fn measure_watched(
    subject: &Subject,
    against: &FullRun,
    mut watch: impl FnMut(usize, &Runtime),
) -> Result<Quality, Error> {
    let (world, model) = (subject.world, subject.model);
    let n = model.n_particles as usize;
    let (n_measured, n_reference) = (against.n_measured, against.n_reference);
    let mut few = against.reach.clone();
    cut(&mut few, n_reference);
    let rest = rest_of_first(model, n_measured);
    let beside_rest = &rest[..n_reference * n];
    let mut observer = Observer::new(&rest, n, &against.reach);
    let mut beside = Observer::new(beside_rest, n, &few);
    let near = observer.near().to_vec();
    let mut errors = ErrorSum::new(beside_rest, n, beside.near());
    let mut runtime = subject.runtime()?;
    let mut out = Quality::default();
    let mut reads = 0;
    let dt = subject.dt();
    for step in 0..world.n_steps() {
        let t = step as f64 * dt;
        let report = subject.step_to(&mut runtime, t + dt);
        out.quarantined += u64::from(report.quarantined);
        let effective = |strands: &mut dyn Iterator<Item = u32>| {
            let (sum, count) =
                strands.fold((0.0, 0.0), |(sum, count), s| (sum + runtime.effective_guides(s as usize), count + 1.0));
            if count > 0.0 { sum / count } else { 0.0 }
        };
        out.effective.push([effective(&mut near.iter().copied()), effective(&mut (0..n_measured as u32).step_by(10))]);
        let positions = &read_positions(&mut runtime)[..n_measured * n];
        let (solids, head) = (world.moving_solids(t, dt), world.moving_head(t, dt));
        observer.observe(positions, &solids, Some(&head));
        if n_reference > 0 {
            let positions = &positions[..n_reference * n];
            beside.observe(positions, &solids, None);
            if world.is_read(step + 1)
                && let Some(frame) = against.frames.get(reads)
            {
                errors.add(positions, frame, &world.world_from_head(t + dt).cast());
                reads += 1;
            }
        }
        watch(step + 1, &runtime);
    }
    out.measured = observer.finish();
    out.beside = beside.finish();
    out.error = (errors.count > 0).then(|| errors.finish());
    Ok(out)
}

/// A solid swept through a head, as rows named `<measure>_<name>`.
#[must_use]
pub fn rows(name: &str, subject: &Subject, against: &FullRun, quality: &Quality) -> Vec<Figure> {
    let all = format!("{}, measured on {}", subject.size(), against.n_measured);
    let mut out = Vec::new();
    let m = &quality.measured;
    let mean = |c: usize| quality.effective.iter().map(|e| e[c]).sum::<f64>() / quality.effective.len().max(1) as f64;
    let mut add = |what: &str, unit, value, of: &str| out.push(Figure::new(format!("{what}_{name}"), unit, value, of));
    add("near_strands_inside_pct", "%", m.near_strands_inside_pct, &all);
    add("passed_through_pct", "% of near", m.passed_through_pct, &all);
    add("near_strands_pct", "% of all", 100.0 * m.near_strands as f64 / m.n_strands.max(1) as f64, &all);
    add("steps_with_tenth_in_reach_pct", "% of steps", tenth_in_reach_pct(against), &all);
    add("max_depth_cm", "cm", m.max_depth_cm, &all);
    add("p99_stretch", "", m.p99_stretch, &all);
    add("max_stretch", "", m.max_stretch, &all);
    add("effective_guides_near", "mean", mean(0), &all);
    add("effective_guides_all", "mean", mean(1), &all);
    add("inside_head_pct", "% of all", m.inside_head_pct, &all);
    add("nonfinite", "", (m.nonfinite + quality.quarantined) as f64, &all);
    if against.n_reference > 0 {
        let of = format!("{}, beside {} in full space", subject.size(), against.n_reference);
        let (b, full) = (&quality.beside, &against.measured);
        let ratio = |a: f64, b: f64| if b > 0.0 { a / b } else { f64::NAN };
        add("standoff_over_full_cm", "cm", b.mean_standoff_cm - full.mean_standoff_cm, &of);
        add("standoff_cm", "cm", b.mean_standoff_cm, &of);
        add("full_space_inside_pct", "%", full.near_strands_inside_pct, &of);
        add("flicker_near", "x", ratio(b.flicker_near_median_cm, full.flicker_near_median_cm), &of);
        add("flicker_near_p999", "x", ratio(b.flicker_near_p999_cm, full.flicker_near_p999_cm), &of);
        add("flicker_all", "x", ratio(b.flicker_all_median_cm, full.flicker_all_median_cm), &of);
        add("flicker_all_p999", "x", ratio(b.flicker_all_p999_cm, full.flicker_all_p999_cm), &of);
        if let Some(e) = quality.error {
            add("error_near_pct", "% of length", e.near, &of);
            add("error_all_pct", "% of length", e.all, &of);
            add("error_rigid_pct", "% of length", e.rigid, &of);
        }
    }
    out
}

/// Share of steps at which a tenth of the strands or more are in reach, per cent.
fn tenth_in_reach_pct(against: &FullRun) -> f64 {
    let enough = |reach: &&Vec<u32>| 10 * reach.len() >= against.n_measured.max(1);
    100.0 * against.reach.iter().filter(enough).count() as f64 / against.reach.len().max(1) as f64
}

/// The same subject skinned in another way.
#[must_use]
pub fn with<'a>(subject: &Subject<'a>, params: RuntimeParams) -> Subject<'a> {
    Subject { params, ..*subject }
}

/// Drops strands from `n` on.
fn cut(reach: &mut Reach, n: usize) {
    for strands in reach {
        strands.truncate(strands.partition_point(|&s| (s as usize) < n));
    }
}

fn rest_of_first(model: &SkinningModel, n: usize) -> Vec<[f32; 3]> {
    (0..n).flat_map(|s| model.rest_of(s).to_vec()).collect()
}
