//! What steps and reads cost: CPU time of all threads, beside a copy of the rest positions on the same threads and chunks.

use super::{Figure, Subject, power_law, quantile, resident_mb, resized};
use crate::chart::Curve;
use crate::error::Error;
use crate::full_space::FullSpace;
use crate::run::read_positions;
use crate::world::World;
use adaptive_runtime::{RuntimeParams, StageTimings, neighbours_together};
use collision::MovingSolid;
use cpu_time::ProcessTime;
use io_formats::groom::UniformGroom;
use io_formats::skinning_model::SkinningModel;
use rayon::prelude::*;
use std::time::Instant;
use strand_sim::StepParams;

/// Copies timed; the best counts, since whatever else a machine does only ever adds time.
const COPIES: usize = 20;

/// One step of a timed loop.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepCost {
    /// CPU time of the step, s.
    pub step_s: f64,
    /// CPU time of the read after it, s; zero where there was none.
    pub read_s: f64,
    /// Whether hair was read after it.
    pub is_read: bool,
}

/// A timed loop of steps and reads.
#[derive(Clone, Debug, Default)]
pub struct LoopCost {
    /// Step by step.
    pub steps: Vec<StepCost>,
    /// Simulated time, s.
    pub sim_s: f64,
    /// Wall time of steps and reads, s.
    pub wall_s: f64,
    /// Wall time of reads, s.
    pub read_wall_s: f64,
    /// Wall time by stage, reads apart.
    pub stages: StageTimings,
    /// Strands in contact, mean over steps.
    pub strands_in_contact: f64,
    /// Set changes, mean over steps.
    pub set_changes: f64,
    /// Strands put back because their state was not finite.
    pub quarantined: u64,
    /// Coordinates read that were not finite.
    pub nonfinite: u64,
}

impl LoopCost {
    /// CPU time of all steps and reads, s.
    #[must_use]
    pub fn cpu_s(&self) -> f64 {
        self.steps.iter().map(|s| s.step_s + s.read_s).sum()
    }

    /// CPU times of steps with their reads, or of those without, s.
    #[must_use]
    pub fn times(&self, reading: bool) -> Vec<f64> {
        self.steps.iter().filter(|s| s.is_read == reading).map(|s| s.step_s + s.read_s).collect()
    }
}

/// Which steps of a loop are followed by a read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reads {
    /// As many a second as the scene has pictures.
    Pictures,
    /// Every step.
    All,
}

/// Steps and reads from `from` to `to` (s), timed; the way to `from` is gone untimed. Times past the scene's length begin it
/// again.
///
/// # Errors
/// A model or scene the runtime refuses.
pub fn time_loop(
    subject: &Subject,
    from: f64,
    to: f64,
    reads: Reads,
    mut progress: impl FnMut(usize),
) -> Result<LoopCost, Error> {
    let dt = subject.dt();
    let [first, last] = [from, to].map(|t| (t / dt).round() as usize);
    let period = subject.world.n_steps().max(1);
    // As a host does that loads a model for speed.
    let (model, _) = neighbours_together(subject.model)?;
    let mut runtime = Subject { model: &model, ..*subject }.runtime()?;
    let mut out = LoopCost { sim_s: (last - first) as f64 * dt, ..LoopCost::default() };
    for step in 1..=last {
        // The last state of a round is the first of the next.
        let in_round = (step - 1) % period + 1;
        let t = in_round as f64 * dt;
        let world_from_solids = subject.world.world_from_solids(t);
        let input = adaptive_runtime::StepInput {
            dt,
            world_from_head: subject.world.world_from_head(t),
            world_from_solids: &world_from_solids,
        };
        let mut cost =
            StepCost { is_read: reads == Reads::All || subject.world.is_read(in_round), ..StepCost::default() };
        let (cpu, wall) = (ProcessTime::now(), Instant::now());
        let report = runtime.step(&input);
        cost.step_s = cpu.elapsed().as_secs_f64();
        let stepped = wall.elapsed().as_secs_f64();
        let mut read = 0.0;
        if cost.is_read {
            let (cpu, wall) = (ProcessTime::now(), Instant::now());
            std::hint::black_box(read_positions(&mut runtime));
            cost.read_s = cpu.elapsed().as_secs_f64();
            read = wall.elapsed().as_secs_f64();
            let positions = runtime.positions();
            out.nonfinite += positions.par_iter().filter(|p| !p.iter().all(|x| x.is_finite())).count() as u64;
        }
        progress(step);
        if step <= first {
            continue;
        }
        out.wall_s += stepped + read;
        out.read_wall_s += read;
        out.stages.add(&report.timings);
        out.strands_in_contact += f64::from(report.strands_in_contact);
        out.set_changes += f64::from(report.set_changes);
        out.quarantined += u64::from(report.quarantined);
        out.steps.push(cost);
    }
    let n = out.steps.len().max(1) as f64;
    out.strands_in_contact /= n;
    out.set_changes /= n;
    Ok(out)
}

/// CPU time of a copy of all rest positions into a warm buffer, on all threads, best of twenty; s.
#[must_use]
pub fn copy_cost(model: &SkinningModel) -> f64 {
    let n = model.n_particles as usize;
    let rest: Vec<[f32; 3]> = (0..model.n_strands as usize).flat_map(|s| model.rest_of(s).to_vec()).collect();
    let mut out = rest.clone();
    let chunk = n * (model.n_strands as usize).div_ceil(8 * rayon::current_num_threads()).max(1);
    let mut best = f64::INFINITY;
    for _ in 0..COPIES {
        let clock = ProcessTime::now();
        out.par_chunks_mut(chunk).zip(rest.par_chunks(chunk)).for_each(|(to, from)| to.copy_from_slice(from));
        best = best.min(clock.elapsed().as_secs_f64());
        std::hint::black_box(&mut out);
    }
    best
}

/// The salon: CPU and wall seconds a simulated second, hair read once a picture; without correction between hairs, the headline,
/// and with it.
///
/// # Errors
/// As [`time_loop`].
pub fn salon(subject: &Subject, progress: impl FnMut(usize)) -> Result<Vec<Figure>, Error> {
    let seconds = subject.world.scene.seconds;
    let cost = time_loop(subject, 0.0, seconds, Reads::Pictures, progress)?;
    let mut params = subject.params;
    params.hair_hair.enabled = true;
    let corrected = time_loop(&Subject { params, ..*subject }, 0.0, seconds, Reads::Pictures, |_| {})?;
    let of = subject.size();
    let per = |total: f64| total / cost.sim_s;
    let mut rows = vec![
        Figure::new("cpu_s_per_sim_s", "s/s", per(cost.cpu_s()), &of),
        Figure::new("cpu_s_per_sim_s_hair_hair", "s/s", corrected.cpu_s() / corrected.sim_s, &of),
        Figure::new("wall_s_per_sim_s", "s/s", per(cost.wall_s), &of),
        Figure::new("reads_cpu_s_per_sim_s", "s/s", per(cost.steps.iter().map(|s| s.read_s).sum()), &of),
        Figure::new("strands_in_contact", "mean", cost.strands_in_contact, &of),
        Figure::new("set_changes_per_step", "mean", cost.set_changes, &of),
        Figure::new("nonfinite", "", (cost.nonfinite + cost.quarantined) as f64, &of),
    ];
    let steps = cost.steps.len() as f64;
    for (name, seconds) in cost.stages.named() {
        rows.push(Figure::new(format!("salon_{name}_wall_ms_per_step"), "ms", 1e3 * seconds / steps, &of));
    }
    Ok(rows)
}

/// A step that interpolates every hair, and interpolation alone, over the copy; measured from `from` to `to` (s), where the solid
/// is in the hair.
///
/// # Errors
/// As [`time_loop`].
pub fn copy(subject: &Subject, from: f64, to: f64, progress: impl FnMut(usize)) -> Result<Vec<Figure>, Error> {
    let cost = time_loop(subject, from, to, Reads::All, progress)?;
    let copy = copy_cost(subject.model);
    let of = subject.size();
    let full: Vec<f64> = cost.times(true);
    let reads: Vec<f64> = cost.steps.iter().map(|s| s.read_s).collect();
    let best = |times: &[f64]| times.iter().copied().fold(f64::INFINITY, f64::min);
    Ok(vec![
        Figure::new("copy_cpu_ms", "ms", 1e3 * copy, &of),
        Figure::new("full_step_over_copy", "x, median", quantile(&full, 0.5) / copy, &of),
        Figure::new("full_step_cpu_ms", "ms, median", 1e3 * quantile(&full, 0.5), &of),
        Figure::new("interpolation_over_copy", "x, best", best(&reads) / copy, &of),
        Figure::new("interpolation_cpu_ms", "ms, best", 1e3 * best(&reads), &of),
        Figure::new("interpolation_median_over_copy", "x, median", quantile(&reads, 0.5) / copy, &of),
    ])
}

/// The 99th percentile of a step's CPU time over the median, of steps that are read and of others, over `rounds` of the scene.
///
/// # Errors
/// As [`time_loop`].
pub fn tail(subject: &Subject, rounds: usize, progress: impl FnMut(usize)) -> Result<Vec<Figure>, Error> {
    let seconds = subject.world.scene.seconds * rounds as f64;
    let cost = time_loop(subject, 0.0, seconds, Reads::Pictures, progress)?;
    let of = format!("{}, {} steps", subject.size(), cost.steps.len());
    let mut rows = Vec::new();
    let mut worst: f64 = 0.0;
    for (reading, name) in [(true, "reading"), (false, "other")] {
        let times = cost.times(reading);
        let ratio = quantile(&times, 0.99) / quantile(&times, 0.5).max(f64::MIN_POSITIVE);
        worst = worst.max(ratio);
        rows.push(Figure::new(format!("p99_over_median_{name}"), "x", ratio, &of));
        rows.push(Figure::new(format!("median_ms_{name}"), "ms", 1e3 * quantile(&times, 0.5), &of));
        rows.push(Figure::new(format!("max_ms_{name}"), "ms", 1e3 * quantile(&times, 1.0), &of));
    }
    rows.insert(0, Figure::new("p99_over_median", "x, worse of two", worst, &of));
    Ok(rows)
}

/// What AS16 Table 2 and §7.3 say of a scene.
#[derive(Clone, Copy, Debug)]
pub struct PaperRow {
    /// CPU wall time of a step, ms.
    pub step_ms: f64,
    /// Full-space step, ms.
    pub full_ms: f64,
    /// Memory of the reduced model, MB.
    pub memory_mb: f64,
}

/// One row of AS16 Table 2 with the shares of §7.3: times and memory as here, the ratio to a full-space step measured beside it.
///
/// # Errors
/// A model, scene or strands that cannot be used.
pub fn table_row(
    subject: &Subject,
    paper: PaperRow,
    full_steps: usize,
    progress: impl FnMut(usize),
) -> Result<Vec<Figure>, Error> {
    let runtime_mb = memory_of_runtime(subject)?;
    let cost = time_loop(subject, 0.0, subject.world.scene.seconds, Reads::Pictures, progress)?;
    let of = subject.size();
    let name = &subject.world.scene.name;
    let n_steps = cost.steps.len() as f64;
    let step_ms = 1e3 * cost.cpu_s() / n_steps;
    let mut rows = vec![
        Figure::new(format!("{name}_step_cpu_ms"), "ms", step_ms, &of),
        Figure::new(format!("{name}_step_wall_ms"), "ms", 1e3 * cost.wall_s / n_steps, &of),
        Figure::new(format!("{name}_paper_step_ms"), "ms, AS16", paper.step_ms, &of),
    ];
    let mut shares: Vec<(&str, f64)> = Vec::new();
    let mut add = |part: &'static str, seconds: f64| match shares.iter_mut().find(|s| s.0 == part) {
        Some(share) => share.1 += seconds,
        None => shares.push((part, seconds)),
    };
    for (stage, seconds) in cost.stages.named() {
        add(part_of(stage), seconds);
    }
    add("interpolation", cost.read_wall_s);
    let total: f64 = shares.iter().map(|s| s.1).sum();
    for (part, seconds) in shares {
        rows.push(Figure::new(format!("{name}_{part}_pct"), "% of wall", 100.0 * seconds / total, &of));
    }
    if let Some(mb) = runtime_mb {
        rows.push(Figure::new(format!("{name}_memory_mb"), "MB", mb, &of));
        rows.push(Figure::new(format!("{name}_paper_memory_mb"), "MB, AS16", paper.memory_mb, &of));
    }
    if full_steps > 0 {
        let full_ms = 1e3 * full_step_cost(subject, full_steps)?;
        rows.push(Figure::new(format!("{name}_full_step_cpu_ms"), "ms", full_ms, &of));
        rows.push(Figure::new(format!("{name}_full_over_ours"), "x", full_ms / step_ms, &of));
        rows.push(Figure::new(format!("{name}_paper_full_over_ours"), "x, AS16", paper.full_ms / paper.step_ms, &of));
    }
    Ok(rows)
}

/// Memory that a runtime takes once it has stepped and read, its own copy of the model included, MB.
fn memory_of_runtime(subject: &Subject) -> Result<Option<f64>, Error> {
    let before = resident_mb();
    let mut runtime = subject.runtime()?;
    subject.step_to(&mut runtime, subject.dt());
    std::hint::black_box(read_positions(&mut runtime));
    Ok(before.and_then(|before| resident_mb().map(|after| after - before)))
}

/// The part of AS16 §7.3 that a stage belongs to.
fn part_of(stage: &str) -> &'static str {
    match stage {
        "guide_sim" => "guide_simulation",
        "graph" | "clusters" | "assign" | "assignment" => "grouping_assignment",
        "assign_interpolate" | "interpolate" | "read" => "interpolation",
        "two_way" => "two_way",
        _ => "hair_contact",
    }
}

/// CPU time of a step that simulates every strand of the subject, mean of `steps` after a first one, s.
fn full_step_cost(subject: &Subject, steps: usize) -> Result<f64, Error> {
    let mut full = full_space(subject.world, subject.model, subject.model.n_strands as usize)?;
    let dt = subject.dt();
    let mut total = 0.0;
    // Where the solid is in the hair: the middle of the scene.
    let begin = (0.5 * subject.world.n_steps() as f64).floor() * dt;
    for step in 0..=steps {
        let t = begin + step as f64 * dt;
        let clock = ProcessTime::now();
        step_full(&mut full, subject.world, t, dt);
        if step > 0 {
            total += clock.elapsed().as_secs_f64();
        }
    }
    Ok(total / steps.max(1) as f64)
}

/// Every strand of the first `n` simulated, at rest as the model is.
///
/// # Errors
/// Strands that cannot be simulated.
pub(super) fn full_space(world: &World, model: &SkinningModel, n: usize) -> Result<FullSpace, Error> {
    let n_particles = model.n_particles as usize;
    let rest: Vec<[f32; 3]> = (0..n).flat_map(|s| model.rest_of(s).to_vec()).collect();
    let mut styled = rest.clone();
    let groom = world.groom.points.chunks_exact(n_particles);
    for (strand, drawn) in styled.chunks_exact_mut(n_particles).zip(groom) {
        // Hair that was moved or added to the model has no groom of its own; its rest shape serves.
        if strand[0] == drawn[0] {
            strand.copy_from_slice(drawn);
        }
    }
    let of = |points| UniformGroom { n_strands: n, n_particles, points };
    FullSpace::new(&of(styled), &of(rest), &world.head, world.material, &StepParams::standard())
}

/// One full-space step from time `t` (s) of the scene on.
pub(super) fn step_full(full: &mut FullSpace, world: &World, t: f64, dt: f64) {
    let mut all: Vec<MovingSolid> = world.moving_solids(t, dt);
    all.push(world.moving_head(t, dt));
    full.step(dt, &world.world_from_head(t + dt), &all);
}

/// Cost over the number of hairs: CPU of a step with its share of reads and of a read, from `from` to `to` (s), with fitted
/// exponents; the curves are in ms.
///
/// # Errors
/// As [`time_loop`].
pub fn over_hairs(
    subject: &Subject,
    counts: &[usize],
    from: f64,
    to: f64,
    mut progress: impl FnMut(usize),
) -> Result<(Vec<Figure>, Vec<Curve>), Error> {
    let mut points = Vec::new();
    for &n in counts {
        let model = resized(subject.model, n, 1)?;
        points.push((
            n,
            model.n_guides(),
            time_loop(&Subject { model: &model, ..*subject }, from, to, Reads::Pictures, |_| {})?,
        ));
        progress(points.len());
    }
    Ok(scaling_rows("hairs", &points))
}

/// Cost over the number of guides, as [`over_hairs`], of models trained with as many.
///
/// # Errors
/// As [`time_loop`].
pub fn over_guides(
    world: &World,
    params: RuntimeParams,
    models: &[SkinningModel],
    from: f64,
    to: f64,
) -> Result<(Vec<Figure>, Vec<Curve>), Error> {
    let mut points = Vec::new();
    for model in models {
        let subject = Subject { world, model, params };
        points.push((
            model.n_guides(),
            model.n_strands as usize,
            time_loop(&subject, from, to, Reads::Pictures, |_| {})?,
        ));
    }
    Ok(scaling_rows("guides", &points))
}

fn scaling_rows(over: &str, points: &[(usize, usize, LoopCost)]) -> (Vec<Figure>, Vec<Curve>) {
    let other = if over == "hairs" { "guides" } else { "hairs" };
    let (mut rows, mut curves) = (Vec::new(), [Vec::new(), Vec::new()]);
    for (n, with, cost) in points {
        let reads = cost.steps.iter().filter(|s| s.is_read).count().max(1) as f64;
        let step_ms = 1e3 * cost.steps.iter().map(|s| s.step_s).sum::<f64>() / cost.steps.len().max(1) as f64;
        let read_ms = 1e3 * cost.steps.iter().map(|s| s.read_s).sum::<f64>() / reads;
        let of = format!("{n} {over}, {with} {other}");
        rows.push(Figure::new(format!("step_ms_{n}_{over}"), "ms", step_ms, &of));
        rows.push(Figure::new(format!("read_ms_{n}_{over}"), "ms", read_ms, &of));
        curves[0].push([*n as f64, step_ms]);
        curves[1].push([*n as f64, read_ms]);
    }
    let of = format!("{} sizes", points.len());
    for (name, curve) in ["step", "read"].iter().zip(&curves) {
        rows.push(Figure::new(format!("{name}_exponent_{over}"), "", power_law(curve).0, &of));
    }
    let [step, read] = curves;
    let named = |name: &str, points| Curve { name: name.to_owned(), points };
    (rows, vec![named("step", step), named("read", read)])
}
