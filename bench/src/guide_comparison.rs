//! Ways to select guides, judged on head motion they were not trained on: AS16 Fig. 9, and the fits of §6.1.
//!
//! Hair is generated, simulated in full on random head motion and recorded once; every model is trained on the same frames
//! and judged on the same others: its guides follow the recorded ones, the rest is skinned by the runtime with quadratic
//! weights as stored and all eligible guides as far as their set is kept. Guides themselves, which have no error, do not
//! count. Errors are RMS over particles and frames in cm, and over the outer half of strands in shares of their length.

use adaptive_runtime::record_of;
use collision::{MovingSolid, Solid, SolidPose};
use io_formats::frames::FrameSource;
use io_formats::groom::UniformGroom;
use io_formats::guide_transform::Blend;
use io_formats::skinning_model::MAX_ELIGIBLE;
use io_formats::{FrameInfo, MemoryFrames, SkinningModel};
use rayon::prelude::*;
use skinning_train::eligible::Eligible;
use skinning_train::gram::{StrandGram, accumulate};
use skinning_train::poly_fit::PolyFit;
use skinning_train::subset_lanes::SubsetLanes;
use skinning_train::subset_weights::{Square, ridge};
use skinning_train::{EligibleRule, GuideMethod, TrainInputs, TrainParams, train};
use strand_sim::{Material, StepParams};

use crate::error::Error;
use crate::full_space::{FullSpace, settle};
use crate::grooms::{GroomParams, Style, generate};
use crate::head_motion::{HeadMotionParams, random_head_motion};
use crate::run::replay;
use crate::shapes;

/// Step of the simulation, s.
const STEP_S: f64 = 0.01;
/// Every so many steps a frame is recorded.
const STEPS_A_FRAME: usize = 4;
/// Seeds of the head's motion: what is held out shares nothing with what is trained on.
const TRAINING_SEED: u64 = 11;
const HELD_OUT_SEED: u64 = 7411;
/// Particles that every guide alone puts this near (cm, RMS) take the weights of the next: as training does it.
const QUIET_CM: f64 = 1e-3;

/// Guides selected in one way, with eligible guides chosen in one way.
pub const WAYS: [(&str, GuideMethod, EligibleRule); 5] = [
    ("sparse_coding", GuideMethod::SparseCoding, EligibleRule::SparseCoding),
    ("graph", GuideMethod::Graph, EligibleRule::SparseCoding),
    ("graph_parts", GuideMethod::Graph, EligibleRule::Parts),
    ("random", GuideMethod::Random, EligibleRule::SparseCoding),
    ("uniform", GuideMethod::Uniform, EligibleRule::SparseCoding),
];

/// What is compared on.
#[derive(Debug, Clone, PartialEq)]
pub struct ComparisonParams {
    /// Styles of hair with their names.
    pub styles: Vec<(&'static str, Style)>,
    /// Strands of each head.
    pub strands: usize,
    /// Numbers of guides.
    pub guides: Vec<usize>,
    /// Sequences trained on.
    pub sequences: u32,
    /// Length of each, s.
    pub seconds: f64,
    /// Length of the sequence held out, s.
    pub held_out_seconds: f64,
    /// Number of guides with which fits along the strand are compared.
    pub guides_of_fits: usize,
    /// Strands on which they are.
    pub strands_of_fits: usize,
}

impl ComparisonParams {
    /// 5,000 straight and 5,000 curly strands; 50 to 400 guides; four sequences of 1.25 s, 2 s held out.
    #[must_use]
    pub fn standard() -> Self {
        Self {
            styles: vec![("straight", Style::Straight), ("curly", Style::Curly)],
            strands: 5000,
            guides: vec![50, 100, 200, 400],
            sequences: 4,
            seconds: 1.25,
            held_out_seconds: 2.0,
            guides_of_fits: 200,
            strands_of_fits: 1000,
        }
    }
}

/// Errors of one trained model, guides left out.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ModelError {
    /// RMS distance over all particles (cm).
    pub cm: f64,
    /// RMS distance over the outer half of strands, in shares of their length (%).
    pub pct: f64,
}

/// One model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelRow {
    /// Style of the hair.
    pub style: &'static str,
    /// One of [`WAYS`].
    pub way: &'static str,
    /// Guides.
    pub n_guides: usize,
    /// Mean number of eligible guides.
    pub mean_eligible: f64,
    /// RMS error (cm) with quadratic weights on the frames trained on.
    pub training_cm: f64,
    /// Errors on the motion held out.
    pub held_out: ModelError,
}

/// How fitted weights do beside free ones, at one kind of transform.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitRow {
    /// Style of the hair.
    pub style: &'static str,
    /// How guides move hairs.
    pub blend: Blend,
    /// RMS residual of AS16 Eq. (7) (cm) with free weights: frames trained on, held out.
    pub free_cm: [f64; 2],
    /// The same with weights of degree 1, 2, 3 along the strand, clamped and normalised.
    pub fitted_cm: [[f64; 2]; 3],
    /// RMS difference to free weights over their RMS (%), for degree 1, 2, 3.
    pub weight_pct: [f64; 3],
}

/// All that was found.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Comparison {
    /// By style, way and number of guides.
    pub models: Vec<ModelRow>,
    /// By style and transform, with guides by sparse coding.
    pub fits: Vec<FitRow>,
}

/// A recorded head of hair.
struct Recorded {
    groom: UniformGroom,
    rest: UniformGroom,
    material: Material,
    training: MemoryFrames,
    held_out: MemoryFrames,
}

/// Trains and judges all models. `progress` hears in words what is being done.
///
/// # Errors
/// Strands that cannot be simulated, frames that cannot be trained from.
pub fn compare(params: &ComparisonParams, mut progress: impl FnMut(&str)) -> Result<Comparison, Error> {
    let mut found = Comparison::default();
    for &(style, shape) in &params.styles {
        progress(&format!("{style}: recording"));
        let hair = record(params, shape)?;
        for &n_guides in &params.guides {
            for (way, guide_method, eligible_rule) in WAYS {
                progress(&format!("{style}: {n_guides} guides, {way}"));
                let how = TrainParams { guide_method, eligible_rule, n_compared: 0, ..TrainParams::standard(n_guides) };
                let material = record_of(&hair.material);
                let inputs = TrainInputs { rest: &hair.rest, groom: &hair.groom, material, provenance: 0 };
                let (model, report) = train(&hair.training, &inputs, &how, &mut |_| {})?;
                found.models.push(ModelRow {
                    style,
                    way,
                    n_guides,
                    mean_eligible: report.mean_eligible,
                    training_cm: report.fit.quadratic_cm,
                    held_out: replayed(&model, &hair.held_out)?,
                });
                if guide_method == GuideMethod::SparseCoding && n_guides == params.guides_of_fits {
                    for blend in [Blend::Translation, Blend::Rigid] {
                        found.fits.push(fits(style, &hair, &model, blend, params.strands_of_fits)?);
                    }
                }
            }
        }
    }
    Ok(found)
}

fn record(params: &ComparisonParams, style: Style) -> Result<Recorded, Error> {
    const PARTICLES: usize = 25;
    let head = shapes::head()?;
    let groom = generate(&GroomParams {
        style,
        strands: params.strands,
        particles: PARTICLES,
        length_cm: 25.0,
        seed: 3,
        head: &head,
    })?;
    let material = match style {
        Style::Straight => Material::straight(),
        Style::Wavy => Material::wavy(),
        Style::Curly => Material::curly(),
    };
    let step = StepParams::standard();
    let rest = settle(&groom, &head, material, &step, |_| {})?;
    let mut training = MemoryFrames::new(params.strands, PARTICLES);
    for sequence in 0..params.sequences {
        let at = (TRAINING_SEED, sequence, params.seconds);
        record_sequence(&groom, &rest, &head, material, &step, at, &mut training)?;
    }
    let mut held_out = MemoryFrames::new(params.strands, PARTICLES);
    record_sequence(&groom, &rest, &head, material, &step, (HELD_OUT_SEED, 0, params.held_out_seconds), &mut held_out)?;
    Ok(Recorded { groom, rest, material, training, held_out })
}

/// Records a head motion, given by seed, number and length in seconds.
fn record_sequence(
    groom: &UniformGroom,
    rest: &UniformGroom,
    head: &Solid,
    material: Material,
    params: &StepParams,
    (seed, sequence, seconds): (u64, u32, f64),
    out: &mut MemoryFrames,
) -> Result<(), Error> {
    let motion = random_head_motion(seed, u64::from(sequence), seconds, &HeadMotionParams::lively());
    let mut full = FullSpace::new(groom, rest, head, material, params)?;
    let mut positions = Vec::new();
    for step in 1..=(seconds / STEP_S).round() as usize {
        let now = step as f64 * STEP_S;
        let (from, to) = (motion.pose_at(now - STEP_S), motion.pose_at(now));
        full.step(STEP_S, &to, &[MovingSolid { solid: head, pose: SolidPose { from, to } }]);
        if step % STEPS_A_FRAME == 0 {
            full.positions_in_head(&mut positions);
            out.push(FrameInfo { sequence, time_s: now }, &positions)?;
        }
    }
    Ok(())
}

/// Errors of a model whose guides follow recorded `frames` of the same hair.
///
/// # Errors
/// A model the runtime refuses, a frame that cannot be read.
pub fn replayed(model: &SkinningModel, frames: &dyn FrameSource) -> Result<ModelError, Error> {
    let (n, n_strands) = (model.n_particles as usize, model.n_strands as usize);
    let length: Vec<f64> = (0..n_strands)
        .map(|s| model.rest_of(s).windows(2).map(|w| squared_distance(&w[0], &w[1]).sqrt()).sum())
        .collect();
    let normal: Vec<usize> =
        (0..n_strands).filter(|&s| model.guide_strands.binary_search(&(s as u32)).is_err()).collect();
    let (mut squares, mut shares) = (0.0, 0.0);
    replay(model, frames, |skinned, recorded| {
        for &s in &normal {
            for i in 0..n {
                let squared = squared_distance(&skinned[s * n + i], &recorded[s * n + i]);
                squares += squared;
                shares += if i >= n / 2 { squared / (length[s] * length[s]) } else { 0.0 };
            }
        }
    })?;
    let strand_frames = (normal.len() * frames.n_frames()).max(1) as f64;
    Ok(ModelError {
        cm: (squares / (strand_frames * n as f64)).sqrt(),
        pct: 100.0 * (shares / (strand_frames * (n - n / 2) as f64)).sqrt(),
    })
}

fn squared_distance(a: &[f32; 3], b: &[f32; 3]) -> f64 {
    (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)).sum()
}

/// Fits of every degree on strands spread evenly over those that are not guides, by the model's guides and eligible guides.
fn fits(
    style: &'static str,
    hair: &Recorded,
    model: &SkinningModel,
    blend: Blend,
    n_strands: usize,
) -> Result<FitRow, Error> {
    let normal: Vec<u32> = (0..model.n_strands).filter(|s| model.guide_strands.binary_search(s).is_err()).collect();
    let n_chosen = n_strands.min(normal.len());
    let chosen: Vec<u32> = (0..n_chosen).map(|i| normal[i * normal.len() / n_chosen]).collect();
    let eligible = Eligible { start: model.eligible_start.clone(), guides: model.eligible.clone() };
    let gram = |frames| accumulate(frames, &hair.rest, &model.guide_strands, &eligible, &chosen, blend, &mut |_| {});
    let (trained, held_out) = (gram(&hair.training)?, gram(&hair.held_out)?);
    let n = hair.rest.n_particles;
    let fit = PolyFit::new(n).ok_or(skinning_train::Error::TooFewParticles { n_particles: n })?;
    let n_frames = [hair.training.n_frames(), hair.held_out.n_frames()];
    let sums: Vec<FitSums> = trained
        .par_iter()
        .zip(&held_out)
        .map_init(SubsetLanes::default, |lanes, (trained, held_out)| {
            FitSums::of_strand(&free_weights(trained, n_frames[0], lanes), [trained, held_out], &fit)
        })
        .collect();
    let mut total = FitSums::default();
    sums.iter().for_each(|s| total.add(s));
    let rms = |which: usize, frames: usize| {
        (total.squares[which][frames] / (n_chosen * n * n_frames[frames]).max(1) as f64).sqrt()
    };
    Ok(FitRow {
        style,
        blend,
        free_cm: [rms(0, 0), rms(0, 1)],
        fitted_cm: [1, 2, 3].map(|degree| [rms(degree, 0), rms(degree, 1)]),
        weight_pct: total.apart.map(|apart| 100.0 * (apart / total.weights).sqrt()),
    })
}

/// The optimum of AS16 Eq. (7) over all eligible guides of a strand, particle-major.
fn free_weights(gram: &StrandGram, n_frames: usize, lanes: &mut SubsetLanes) -> Vec<[f64; MAX_ELIGIBLE]> {
    let (k, n) = (gram.n_guides, gram.n_particles);
    lanes.reset(k, n);
    let mut quiet = vec![false; n];
    for i in 0..n {
        let mut h: Square = [[0.0; MAX_ELIGIBLE]; MAX_ELIGIBLE];
        for a in 0..k {
            (0..k).for_each(|b| h[a][b] = gram.at(i, a, b));
        }
        lanes.set(i, &h, ridge(&h, k, n_frames));
        quiet[i] = (0..k).map(|g| h[g][g]).sum::<f64>() <= (k * n_frames) as f64 * QUIET_CM * QUIET_CM;
    }
    lanes.solve();
    let mut weights = vec![[0.0; MAX_ELIGIBLE]; n];
    for i in (0..n).rev() {
        if quiet[i] && i + 1 < n {
            weights[i] = weights[i + 1];
        } else {
            (0..k).for_each(|g| weights[i][g] = lanes.weight((1 << k) - 1, g, i));
        }
    }
    weights
}

/// Sums over strands.
#[derive(Default)]
struct FitSums {
    /// Squared residuals (cm²) of free weights and of degrees 1 to 3, on either set of frames.
    squares: [[f64; 2]; 4],
    weights: f64,
    apart: [f64; 3],
}

impl FitSums {
    fn of_strand(free: &[[f64; MAX_ELIGIBLE]], grams: [&StrandGram; 2], fit: &PolyFit) -> Self {
        let k = grams[0].n_guides;
        let mut sums = Self::default();
        let mut values = vec![[[0.0; MAX_ELIGIBLE]; 3]; free.len()];
        for g in 0..k {
            let of_guide: Vec<f64> = free.iter().map(|w| w[g]).collect();
            let (line, quadratic, cubic) = (fit.fit_line(&of_guide), fit.fit(&of_guide), fit.fit_cubic(&of_guide));
            for (value, &u) in values.iter_mut().zip(&fit.u) {
                (value[0][g], value[1][g], value[2][g]) = (line.at(u), quadratic.at(u), cubic.at(u));
            }
        }
        // A strand of one guide has weight one by definition.
        let per_weight = if k > 1 { 1.0 / (k * free.len()) as f64 } else { 0.0 };
        for (i, (free, values)) in free.iter().zip(&values).enumerate() {
            let mut add = |which: usize, w: &[f64; MAX_ELIGIBLE]| {
                for (sum, gram) in sums.squares[which].iter_mut().zip(grams) {
                    let row = |a: usize| -> f64 { (0..k).map(|b| gram.at(i, a, b) * w[b]).sum() };
                    *sum += (0..k).map(|a| w[a] * row(a)).sum::<f64>().max(0.0);
                }
            };
            add(0, free);
            sums.weights += per_weight * free.iter().map(|w| w * w).sum::<f64>();
            for (degree, value) in values.iter().enumerate() {
                let mut w = value.map(|w| w.max(0.0));
                let total: f64 = w.iter().sum();
                w.iter_mut().for_each(|w| *w /= total);
                add(degree + 1, &w);
                sums.apart[degree] += per_weight * w.iter().zip(free).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
            }
        }
        sums
    }

    fn add(&mut self, other: &Self) {
        for (sum, of) in self.squares.iter_mut().flatten().zip(other.squares.iter().flatten()) {
            *sum += of;
        }
        self.weights += other.weights;
        self.apart.iter_mut().zip(other.apart).for_each(|(sum, of)| *sum += of);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What quadratics cost and recorded positions are rounded to: without motion nothing else is left.
    const ROUNDED_CM: f64 = 1e-3;

    #[test]
    fn a_model_whose_guides_stand_still_has_no_error_on_frames_at_rest() {
        let head = shapes::head().expect("a head");
        let groom = generate(&GroomParams {
            style: Style::Straight,
            strands: 60,
            particles: 8,
            length_cm: 12.0,
            seed: 1,
            head: &head,
        })
        .expect("a groom");
        let mut moving = MemoryFrames::new(60, 8);
        for f in 0..12 {
            let shift = |at: usize| 0.3 * (at % 8) as f32 * (0.5 * f as f32 + 0.01 * at as f32).sin();
            let points: Vec<[f32; 3]> =
                groom.points.iter().enumerate().map(|(at, p)| [p[0] + shift(at), p[1], p[2]]).collect();
            moving.push(FrameInfo { sequence: 0, time_s: f64::from(f) }, &points).expect("a frame of its size");
        }
        let mut still = MemoryFrames::new(60, 8);
        still.push(FrameInfo { sequence: 0, time_s: 0.0 }, &groom.points).expect("a frame of its size");
        let material = record_of(&Material::straight());
        let inputs = TrainInputs { rest: &groom, groom: &groom, material, provenance: 0 };
        let (model, report) = train(&moving, &inputs, &TrainParams::standard(10), &mut |_| {}).expect("a model");
        let at_rest = replayed(&model, &still).expect("errors");
        assert!(at_rest.cm < ROUNDED_CM && at_rest.pct < ROUNDED_CM, "{at_rest:?}");
        // On the frames trained on, the runtime must find what training states, up to where the full set is not kept.
        let again = replayed(&model, &moving).expect("errors");
        let stated = report.fit.quadratic_cm;
        assert!(again.cm > 0.5 * stated && again.cm < 1.5 * stated, "{again:?}, stated {stated}");
    }
}
