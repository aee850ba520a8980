//! Situations that one number does not catch: hair after a solid has left it, AS16 Fig. 6 with either criterion alone, every way
//! to skin beside full space, minutes of salon without end.

use super::cost::StepCost;
use super::quality::{FullRun, Quality, full_run, measure, with};
use super::{Figure, Subject, resident_mb};
use crate::error::Error;
use crate::run::read_positions;
use adaptive_runtime::{Correction, DftlParams, GuideIntegrator, RuntimeParams, neighbours_together};
use cpu_time::ProcessTime;
use rayon::prelude::*;

/// Share of the level of guides that counts as returned.
const RETURNED: f64 = 0.95;
/// Distance of tips beyond which guides count as apart where that alone decides (AS16 §7.2), cm: a few times that of neighbours.
const TIPS_APART_CM: f32 = 4.0;

/// How long after the last strand was in reach near strands follow 95 % as many guides as before the first was; the scene
/// must go on long enough after its solids have left.
///
/// # Errors
/// As [`measure`].
pub fn recovery(subject: &Subject, n_measured: usize, progress: impl FnMut(usize)) -> Result<Vec<Figure>, Error> {
    let against = full_run(subject, n_measured, 0, |_| {})?;
    let quality = measure(subject, &against, progress)?;
    Ok(recovery_of(subject, &against, &quality))
}

/// As [`recovery`], of a run that has been measured.
#[must_use]
pub fn recovery_of(subject: &Subject, against: &FullRun, quality: &Quality) -> Vec<Figure> {
    let of = format!("{}, measured on {}", subject.size(), against.n_measured);
    let touched = |k: &usize| !against.reach[*k].is_empty();
    let n = against.reach.len();
    let (Some(first), Some(last)) = ((0..n).find(touched), (0..n).rev().find(touched)) else {
        return vec![Figure::missing("guides_recovery_s", "s", "no strand came into reach")];
    };
    let near = |k: usize| quality.effective[k][0];
    let level = near(first.saturating_sub(1));
    let least = (first..=last).map(near).fold(f64::INFINITY, f64::min);
    let back = (last..n).find(|&k| near(k) >= RETURNED * level);
    let dt = subject.dt();
    vec![
        match back {
            Some(k) => Figure::new("guides_recovery_s", "s", (k - last) as f64 * dt, &of),
            None => Figure::missing("guides_recovery_s", "s", "the scene ended before guides were back to 95 %"),
        },
        Figure::new("guides_before", "mean", level, &of),
        Figure::new("guides_least", "mean", least, &of),
        Figure::new("guides_when_left", "mean", near(last), &of),
        Figure::new("guides_at_end", "mean", near(n - 1), &of),
        Figure::new("seconds_after_solid_left", "s", (n - 1 - last) as f64 * dt, &of),
    ]
}

/// Both criteria of AS16 §4 and either alone, with and without the correction of single strands, which hides what guides do.
#[must_use]
pub fn criteria() -> Vec<(String, RuntimeParams)> {
    let mut out = Vec::new();
    for (suffix, correction) in [("", true), ("_uncorrected", false)] {
        for (name, similarity, avoidance) in
            [("both", true, true), ("similarity", true, false), ("avoidance", false, true)]
        {
            let mut params = RuntimeParams::adaptive();
            params.assign.similarity = similarity;
            params.assign.avoidance = avoidance;
            if !correction {
                params.residual.correction = Correction::None;
            }
            out.push((format!("{name}{suffix}"), params));
        }
    }
    out
}

/// Particles moved out one by one at the end of a step (Chai 2014).
fn position() -> RuntimeParams {
    let mut params = RuntimeParams::adaptive();
    params.residual.correction = Correction::Position;
    params
}

/// The whole method without something.
fn without(something: impl Fn(&mut RuntimeParams)) -> RuntimeParams {
    let mut params = RuntimeParams::adaptive();
    something(&mut params);
    params
}

/// Guides by dynamic follow-the-leader (AS16 §7.2).
fn follow_the_leader() -> RuntimeParams {
    let guide_integrator = GuideIntegrator::FollowTheLeader(DftlParams::standard());
    RuntimeParams { guide_integrator, ..RuntimeParams::adaptive() }
}

/// Ways to skin that errors are compared over.
#[must_use]
pub fn ways() -> Vec<(String, RuntimeParams)> {
    let named = |name: &str, params| (name.to_owned(), params);
    vec![
        named("adaptive", RuntimeParams::adaptive()),
        named("no_two_way", RuntimeParams::no_two_way()),
        named("paper", RuntimeParams::paper()),
        named("fixed", RuntimeParams::fixed()),
        named("fixed_corrected", without(|params| params.assign.adapt = false)),
        named("left_at_once", without(|params| params.assign.leave_gain_cm = -1.0)),
        named("tip_distance", RuntimeParams::tip_distance(TIPS_APART_CM)),
        named("distance_weights", RuntimeParams::distance_weights(true)),
        named("fixed_distance_weights", RuntimeParams::distance_weights(false)),
        named("position", position()),
        named("follow_the_leader", follow_the_leader()),
    ]
}

/// Error to full space, share inside, flicker and guides of several ways to skin, in one situation.
///
/// # Errors
/// As [`measure`].
pub fn compared(
    situation: &str,
    subject: &Subject,
    ways: &[(String, RuntimeParams)],
    against: &FullRun,
    mut progress: impl FnMut(usize),
) -> Result<Vec<Figure>, Error> {
    let of =
        format!("{}, measured on {}, beside {} in full space", subject.size(), against.n_measured, against.n_reference);
    let mut out = Vec::new();
    for (at, (way, params)) in ways.iter().enumerate() {
        let quality = measure(&with(subject, *params), against, |_| {})?;
        let mut add = |what: &str, unit, value| {
            out.push(Figure::new(format!("{what}_{situation}_{way}"), unit, value, &of));
        };
        let e = quality.error.unwrap_or_default();
        add("error_pct", "% of length", e.all);
        if !subject.world.solids.is_empty() {
            let full = against.measured.flicker_near_p999_cm.max(f64::MIN_POSITIVE);
            add("error_near_pct", "% of length", e.near);
            add("inside_pct", "%", quality.measured.near_strands_inside_pct);
            add("passed_pct", "% of near", quality.measured.passed_through_pct);
            add("flicker_p999", "x", quality.beside.flicker_near_p999_cm / full);
            add("guides", "mean", quality.effective.iter().map(|e| e[0]).sum::<f64>() / quality.effective.len() as f64);
        }
        if at == 0 {
            add("error_rigid_pct", "% of length", e.rigid);
        }
        progress(at + 1);
    }
    Ok(out)
}

/// The scene again and again for `seconds` of its time, its solids put back at the start of each round while hair goes on:
/// non-finite values, growth of memory after the first round, drift of time.
///
/// # Errors
/// As [`super::cost::time_loop`].
pub fn endurance(subject: &Subject, seconds: f64, mut progress: impl FnMut(usize)) -> Result<Vec<Figure>, Error> {
    let dt = subject.dt();
    let period = subject.world.n_steps().max(1);
    let n_steps = ((seconds / dt).round() as usize).max(3 * period);
    // As a host does that loads a model for speed.
    let (model, _) = neighbours_together(subject.model)?;
    let mut runtime = Subject { model: &model, ..*subject }.runtime()?;
    let (mut nonfinite, mut quarantined) = (0, 0);
    let (mut first_mb, mut most_mb): (Option<f64>, f64) = (None, 0.0);
    let mut rounds: Vec<f64> = Vec::new();
    let mut round_s = 0.0;
    for step in 1..=n_steps {
        let in_round = (step - 1) % period + 1;
        if in_round == 1 {
            // Swept back within a step, solids would tear through all hair on their way.
            for (solid, pose) in subject.world.world_from_solids(0.0).iter().enumerate() {
                runtime.put_solid(solid, pose);
            }
        }
        let mut cost = StepCost { is_read: subject.world.is_read(in_round), ..StepCost::default() };
        let clock = ProcessTime::now();
        let report = subject.step_to(&mut runtime, in_round as f64 * dt);
        cost.step_s = clock.elapsed().as_secs_f64();
        if cost.is_read {
            let clock = ProcessTime::now();
            let positions = read_positions(&mut runtime);
            cost.read_s = clock.elapsed().as_secs_f64();
            nonfinite += positions.par_iter().filter(|p| !p.iter().all(|x| x.is_finite())).count();
        }
        quarantined += report.quarantined;
        round_s += cost.step_s + cost.read_s;
        if in_round == period {
            rounds.push(std::mem::take(&mut round_s) / (period as f64 * dt));
            // The first round touches every buffer.
            if let Some(mb) = resident_mb() {
                first_mb = first_mb.or(Some(mb));
                most_mb = most_mb.max(mb);
            }
        }
        progress(step);
    }
    let of = format!("{}, {:.0} s", subject.size(), n_steps as f64 * dt);
    let last = rounds.last().copied().unwrap_or(0.0);
    let mut out = vec![
        Figure::new("endurance_nonfinite", "", nonfinite as f64, &of),
        Figure::new("endurance_quarantined", "", f64::from(quarantined), &of),
        Figure::new("endurance_cpu_s_per_sim_s", "s/s", rounds.iter().sum::<f64>() / rounds.len().max(1) as f64, &of),
        Figure::new("endurance_last_round_over_first", "x", last / rounds.first().copied().unwrap_or(1.0), &of),
    ];
    if let Some(first) = first_mb {
        out.push(Figure::new("endurance_memory_growth_mb", "MB", most_mb - first, &of));
        out.push(Figure::new("endurance_memory_mb", "MB", most_mb, &of));
    }
    Ok(out)
}
