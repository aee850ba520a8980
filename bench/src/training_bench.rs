//! What the kernels of training cost, and how far they are from a general solver.
//!
//! Problems of AS16 Eq. (7) are drawn at random: residuals of guides that share an error, some of them equal, fewer rows
//! than guides, or no error at all. Objectives are compared as exactly as the matrix is given, in twice the precision:
//! where the optimum is a billionth of the diagonal, plain evaluation is off by more than what is asked.

use adaptive_runtime::record_of;
use collision::{MovingSolid, SolidPose};
use cpu_time::ThreadTime;
use io_formats::{FrameInfo, MemoryFrames};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use skinning_train::subset_lanes::SubsetLanes;
use skinning_train::subset_weights::{
    Square, SubsetWeights, interior_point, quadratic_form_exactly, ridge, solve_general,
};
use skinning_train::{TrainInputs, TrainParams, train};
use strand_sim::{Material, StepParams};

use crate::error::Error;
use crate::full_space::{FullSpace, settle};
use crate::grooms::{GroomParams, Style, generate};
use crate::head_motion::{HeadMotionParams, random_head_motion};
use crate::shapes;
use crate::strand_bench::Row;

/// Guides of the largest problem.
const MOST: usize = 9;

/// One problem: minimise wᵀ H w over w >= 0, Σw = 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Problem {
    /// Number of guides.
    pub k: usize,
    /// Gram matrix of residuals (cm²).
    pub h: Square,
    /// What is added to its diagonal.
    pub ridge: f64,
}

impl Problem {
    /// The matrix whose form is minimised.
    #[must_use]
    pub fn ridged(&self) -> Square {
        let mut h = self.h;
        (0..self.k).for_each(|g| h[g][g] += self.ridge);
        h
    }
}

/// `n` problems of `k` guides from a seed, every tenth of them degenerate in one of several ways.
#[must_use]
pub fn random_problems(k: usize, n: usize, seed: u64) -> Vec<Problem> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    (0..n).map(|at| random_problem(k, at, &mut rng)).collect()
}

fn random_problem(k: usize, at: usize, rng: &mut Pcg64Mcg) -> Problem {
    // Fewer rows than guides leave H singular but for the ridge.
    let n_rows = [3, 6, 30, 300][at % 4];
    let shared = [0.0, 0.3, 3.0][at % 3];
    let common: Vec<f64> = (0..n_rows).map(|_| shared * rng.random_range(-1.0..1.0)).collect();
    let mut residuals: Vec<Vec<f64>> = (0..k)
        .map(|_| {
            let size = 10.0_f64.powf(rng.random_range(-2.0..0.5));
            common.iter().map(|c| c + size * rng.random_range(-1.0..1.0)).collect()
        })
        .collect();
    match at % 10 {
        // Two guides that move alike; all of them; no error at all; one guide that explains everything.
        0 if k > 1 => residuals[k - 1] = residuals[k - 2].clone(),
        3 if at.is_multiple_of(7) => residuals = vec![common; k],
        6 if at.is_multiple_of(7) => residuals.iter_mut().for_each(|r| r.fill(0.0)),
        9 if at.is_multiple_of(7) => residuals[0].fill(0.0),
        _ => {}
    }
    let mut h = [[0.0; MOST]; MOST];
    for a in 0..k {
        for b in 0..k {
            h[a][b] = residuals[a].iter().zip(&residuals[b]).map(|(x, y)| x * y).sum();
        }
    }
    Problem { k, h, ridge: ridge(&h, k, n_rows / 3) }
}

/// How the walk and the general solver agree.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Agreement {
    /// Problems both solved.
    pub compared: usize,
    /// Problems the general solver gave up on.
    pub given_up: usize,
    /// Largest excess of the walk's objective over the general solver's, relative. Both points are feasible: the lower
    /// value is the better answer.
    pub walk_above: f64,
    /// Largest excess of the general solver's objective over the walk's, relative.
    pub general_above: f64,
}

/// Solves `n` random problems of two to nine guides both ways.
#[must_use]
pub fn agreement(n: usize, seed: u64) -> Agreement {
    let mut found = Agreement::default();
    let mut lanes = SubsetLanes::default();
    for k in 2..=MOST {
        let problems = random_problems(k, n.div_ceil(MOST - 1), seed + k as u64);
        walk(&mut lanes, k, &problems);
        for (at, problem) in problems.iter().enumerate() {
            let Some(general) = solve_general(&problem.h, k, problem.ridge) else {
                found.given_up += 1;
                continue;
            };
            let mut w = [0.0; MOST];
            (0..k).for_each(|g| w[g] = lanes.weight((1 << k) - 1, g, at));
            let ours = quadratic_form_exactly(&problem.ridged(), k, &w);
            let general = quadratic_form_exactly(&problem.ridged(), k, &general);
            found.compared += 1;
            found.walk_above = found.walk_above.max(ours / general - 1.0);
            found.general_above = found.general_above.max(general / ours - 1.0);
        }
    }
    found
}

/// All subsets of some problems of `k` guides.
fn walk(lanes: &mut SubsetLanes, k: usize, problems: &[Problem]) {
    lanes.reset(k, problems.len());
    for (at, problem) in problems.iter().enumerate() {
        lanes.set(at, &problem.h, problem.ridge);
    }
    lanes.solve();
}

/// The agreement as rows.
///
/// # Errors
/// None.
pub fn errors() -> Result<Vec<Row>, Error> {
    const PROBLEMS: usize = 10_000;
    let found = agreement(PROBLEMS, 7);
    Ok(vec![
        ("qp_compared", "of 10000", found.compared as f64),
        ("qp_max_error", "x", found.walk_above.max(found.general_above)),
        ("qp_walk_above_general", "x", found.walk_above),
    ])
}

/// Problems a second and core: all subsets counted at nine guides, whole problems at four; beside them the plain walk and the
/// general solver.
///
/// # Errors
/// None.
pub fn speed() -> Result<Vec<Row>, Error> {
    // As many as a strand of 25 particles has that move.
    const AT_ONCE: usize = 24;
    const WALKS: usize = 40;
    let mut rows = Vec::new();
    for (k, names) in [
        (4, ["qp_per_s_core_k4", "qp_plain_per_s_core_k4", "qp_subsets_per_s_core_k4", "qp_general_per_s_core_k4"]),
        (9, ["qp_strands_per_s_core_k9", "qp_plain_per_s_core_k9", "qp_per_s_core_k9", "qp_general_per_s_core_k9"]),
    ] {
        let problems = random_problems(k, AT_ONCE * WALKS, 5);
        let mut lanes = SubsetLanes::default();
        let fast = per_second(problems.len(), || problems.chunks(AT_ONCE).for_each(|some| walk(&mut lanes, k, some)));
        let mut plain = SubsetWeights::default();
        let slow = per_second(problems.len(), || problems.iter().for_each(|p| plain.solve(&p.h, k, p.ridge)));
        let few = &problems[..AT_ONCE];
        let general = per_second(few.len(), || {
            for p in few {
                std::hint::black_box(interior_point(&p.ridged(), k, 1.0, false));
            }
        });
        let subsets = ((1 << k) - 1) as f64;
        if k == 9 {
            rows.push((names[0], "1/s", fast / AT_ONCE as f64));
            rows.push((names[1], "1/s", slow * subsets));
        } else {
            rows.push((names[0], "1/s", fast));
            rows.push((names[1], "1/s", slow));
        }
        rows.push((names[2], "1/s", fast * subsets));
        rows.push((names[3], "1/s", general));
    }
    Ok(rows)
}

/// Errors of weights fitted along the strand by degree, on frames of a generated head that moves at random: as shares of the
/// free weights (RMS of the difference over RMS), and as RMS positions over those of free weights (AS16 Eq. 7's residual).
///
/// # Errors
/// Strands that cannot be simulated, frames that cannot be trained from.
pub fn fits() -> Result<Vec<Row>, Error> {
    const STRANDS: usize = 1500;
    const GUIDES: usize = 60;
    const PARTICLES: usize = 25;
    const SEQUENCES: u32 = 2;
    const SECONDS: f64 = 2.0;
    const STEP_S: f64 = 0.01;
    const STEPS_A_FRAME: usize = 4;
    let head = shapes::head()?;
    let groom = generate(&GroomParams {
        style: Style::Straight,
        strands: STRANDS,
        particles: PARTICLES,
        length_cm: 25.0,
        seed: 3,
        head: &head,
    })?;
    let params = StepParams::standard();
    let material = Material::straight();
    let rest = settle(&groom, &head, material, &params, |_| {})?;
    let mut frames = MemoryFrames::new(STRANDS, PARTICLES);
    let mut positions = Vec::new();
    for sequence in 0..SEQUENCES {
        let motion = random_head_motion(11, u64::from(sequence), SECONDS, &HeadMotionParams::lively());
        let mut full = FullSpace::new(&groom, &rest, &head, material, &params)?;
        for step in 1..=(SECONDS / STEP_S).round() as usize {
            let now = step as f64 * STEP_S;
            let (from, to) = (motion.pose_at(now - STEP_S), motion.pose_at(now));
            full.step(STEP_S, &to, &[MovingSolid { solid: &head, pose: SolidPose { from, to } }]);
            if step % STEPS_A_FRAME == 0 {
                full.positions_in_head(&mut positions);
                frames.push(FrameInfo { sequence, time_s: now }, &positions)?;
            }
        }
    }
    let inputs = TrainInputs { rest: &rest, groom: &groom, material: record_of(&material), provenance: 0 };
    let (_, report) = train(&frames, &inputs, &TrainParams::standard(GUIDES), &mut |_| {})?;
    let fit = &report.fit;
    let of_weights = |error: f64| 100.0 * error / fit.free_weight;
    let of_positions = |error: f64| 100.0 * (error / fit.free_cm - 1.0);
    Ok(vec![
        ("linear_error_pct", "%", of_weights(fit.linear_weight)),
        ("quadratic_error_pct", "%", of_weights(fit.quadratic_weight)),
        ("cubic_error_pct", "%", of_weights(fit.cubic_weight)),
        ("linear_residual_excess_pct", "%", of_positions(fit.linear_cm)),
        ("quadratic_residual_excess_pct", "%", of_positions(fit.quadratic_cm)),
        ("cubic_residual_excess_pct", "%", of_positions(fit.cubic_cm)),
        ("free_residual_cm", "cm", fit.free_cm),
    ])
}

/// How often a second `work` does `n` things, on this thread: the best of several turns.
fn per_second(n: usize, mut work: impl FnMut()) -> f64 {
    const TURNS: usize = 12;
    let mut best = f64::INFINITY;
    for _ in 0..TURNS {
        let begin = ThreadTime::now();
        work();
        best = best.min(begin.elapsed().as_secs_f64());
    }
    n as f64 / best
}
