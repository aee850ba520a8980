//! Frames in, skinning model out: the stages of AS16 §6 in order.
//!
//! reduce -> guides (Eqs. 9, 10) -> eligible -> scales (§7.1) -> gram (Eq. 7's data) -> subsets (Algorithm 2) -> compare.
//! Frames are only ever streamed; strands are treated in blocks whose Gram matrices fit a stated amount of memory. Same
//! inputs, same model bytes, for any number of threads. No simulation is stepped and no solid is seen.

use std::time::Instant;

use io_formats::guide_transform::Blend;
use io_formats::{FrameSource, MaterialRecord, SkinningModel, UniformGroom};
use rayon::prelude::*;
use tracing::info_span;

use crate::eligible::{Eligible, EligibleParams, choose_eligible};
use crate::error::{Error, Result};
use crate::gram::accumulate;
use crate::guide_select::method::{EligibleRule, compared_guides};
use crate::guide_select::nearest::nearest_strands;
use crate::guide_select::part_eligible::choose_eligible_of_parts;
use crate::guide_select::sparse_coding::{SparseCodingParams, learn_dictionary};
use crate::motion_scales::{CalibrationParams, MotionScales, calibrate};
use crate::params::{FitError, Progress, TrainParams, TrainReport};
use crate::poly_fit::PolyFit;
use crate::reduce::{Signals, reduce};
use crate::subsets::{FullSetError, StrandSets, SubsetsWorkspace, strand_sets};

/// Gram matrices held at a time.
const GRAM_BYTES: usize = 512 << 20;
/// Strands solved between two reports of progress.
const SOLVED_AT_ONCE: usize = 512;

/// What a model is trained from, beside the frames.
#[derive(Debug, Clone, Copy)]
pub struct TrainInputs<'a> {
    /// Rest state s* (cm, head frame): what is blended at runtime, best the settled hair.
    pub rest: &'a UniformGroom,
    /// Styled shape (cm, head frame): what the guides' springs are built from.
    pub groom: &'a UniformGroom,
    /// Material of the strands in the frames.
    pub material: MaterialRecord,
    /// Hash of everything the frames and parameters were made from; kept in the model.
    pub provenance: u64,
}

/// Trains a skinning model. `progress` hears of every stage as it goes on.
///
/// # Errors
/// When inputs do not describe the same hair, parameters are out of range, there are too few frames or particles, a frame
/// cannot be read or is not finite.
pub fn train(
    frames: &dyn FrameSource,
    inputs: &TrainInputs<'_>,
    params: &TrainParams,
    progress: &mut dyn FnMut(Progress),
) -> Result<(SkinningModel, TrainReport)> {
    let fit = check_inputs(frames, inputs, params)?;
    let mut run = Run { report: TrainReport::default(), progress };
    run.report.n_strands = frames.n_strands();
    run.report.n_frames = frames.n_frames();
    let n_frames = frames.n_frames() as u64;

    let signals =
        run.stage("reduce", 2 * n_frames, |tick| reduce(frames, params.rank, params.oversample, params.seed, tick))?;
    run.report.rank = signals.rank;
    run.report.lost_energy = signals.lost_energy;
    let compared = run.stage("guides", n_frames, |tick| compared_guides(frames, inputs.rest, params, tick))?;
    let (guide_strands, parts) = compared.unwrap_or_else(|| (run.select_guides(&signals, params), None));
    run.report.n_guides = guide_strands.len();
    let eligible = run.stage("eligible", 1, |tick| -> Result<Eligible> {
        let limits = EligibleParams {
            sparsity: params.sparsity,
            min_weight: params.min_weight,
            min_guides: params.min_eligible,
            max_guides: params.max_eligible,
        };
        match parts.filter(|_| params.eligible_rule == EligibleRule::Parts) {
            Some(parts) => choose_eligible_of_parts(frames, inputs.rest, &parts, &limits, tick),
            None => Ok(choose_eligible(&signals, &guide_strands, &limits)),
        }
    })?;
    drop(signals);
    let pairs = eligible.pairs();
    let scales = run.stage("scales", n_frames, |tick| {
        let calibration = CalibrationParams {
            velocity_weight: params.velocity_weight,
            percentile: params.distance_percentile,
            release_factor: params.release_factor,
        };
        calibrate(frames, &guide_strands, &pairs, &calibration, tick)
    })?;

    let mut sets = SetArrays::new();
    let mut full = Vec::with_capacity(frames.n_strands());
    for block in blocks(&eligible, inputs.rest.n_particles) {
        let solved = run.solve_block(frames, inputs.rest, &guide_strands, &eligible, &block, &fit, params)?;
        for strand in &solved {
            sets.push(strand)?;
            full.push(strand.full);
        }
    }
    run.summarise(&eligible, &guide_strands, &sets, &full);
    run.compare_blends(frames, inputs.rest, &guide_strands, &eligible, &full, &fit, params)?;
    run.report.n_pairs = pairs.len();
    run.report.max_distance = scales.max_distance;
    run.report.connected = scales.connected;
    run.report.connected_paper = scales.connected_paper;

    let model = assemble(inputs, params, guide_strands, eligible, pairs, scales, sets)?;
    model.validate()?;
    Ok((model, run.report))
}

fn check_inputs(frames: &dyn FrameSource, inputs: &TrainInputs<'_>, params: &TrainParams) -> Result<PolyFit> {
    let (frame_strands, frame_particles) = (frames.n_strands(), frames.n_particles());
    for (what, groom) in [("the rest shape", inputs.rest), ("the groom", inputs.groom)] {
        let (n_strands, n_particles) = (groom.n_strands, groom.n_particles);
        let whole = groom.points.len() == n_strands * n_particles;
        if n_strands != frame_strands || n_particles != frame_particles || !whole {
            return Err(Error::ShapeMismatch { what, n_strands, n_particles, frame_strands, frame_particles });
        }
        if let Some(at) = groom.points.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            return Err(Error::NonFinite { what: what.to_owned(), strand: at / n_particles });
        }
    }
    params.check(frame_strands)?;
    // One frame shows a pose, not a motion.
    if frames.n_frames() < 2 {
        return Err(Error::TooFewFrames { n_frames: frames.n_frames(), needed: 2 });
    }
    PolyFit::new(frame_particles).ok_or(Error::TooFewParticles { n_particles: frame_particles })
}

/// Blocks of strands whose Gram matrices fit the memory set aside for them.
fn blocks(eligible: &Eligible, n_particles: usize) -> Vec<Vec<u32>> {
    let mut blocks = Vec::new();
    let (mut block, mut bytes) = (Vec::new(), 0);
    for strand in 0..eligible.n_strands() {
        let k = eligible.of(strand).len();
        bytes += k * (k + 1) / 2 * n_particles * size_of::<f64>();
        block.push(strand as u32);
        if bytes >= GRAM_BYTES {
            blocks.push(std::mem::take(&mut block));
            bytes = 0;
        }
    }
    if !block.is_empty() {
        blocks.push(block);
    }
    blocks
}

/// The report under way and whom to tell.
struct Run<'a> {
    report: TrainReport,
    progress: &'a mut dyn FnMut(Progress),
}

impl Run<'_> {
    /// Runs one stage, timing it and passing its progress on. A stage that comes again adds to its time.
    fn stage<T>(&mut self, stage: &'static str, total: u64, work: impl FnOnce(&mut dyn FnMut(u64)) -> T) -> T {
        let _span = info_span!("train", stage).entered();
        let start = Instant::now();
        (self.progress)(Progress { stage, done: 0, total });
        let result = work(&mut |done| (self.progress)(Progress { stage, done, total }));
        (self.progress)(Progress { stage, done: total, total });
        let seconds = start.elapsed().as_secs_f64();
        tracing::debug!(stage, seconds, "stage done");
        match self.report.stage_seconds.iter_mut().find(|(name, _)| *name == stage) {
            Some((_, sum)) => *sum += seconds,
            None => self.report.stage_seconds.push((stage, seconds)),
        }
        result
    }

    fn select_guides(&mut self, signals: &Signals, params: &TrainParams) -> Vec<u32> {
        let coding = SparseCodingParams {
            n_atoms: params.n_guides,
            sparsity: params.sparsity,
            epochs: params.epochs,
            batch: params.batch,
            seed: params.seed,
        };
        let (dictionary, guides) = self.stage("guides", params.epochs as u64, |tick| {
            let dictionary = learn_dictionary(signals, &coding, tick);
            let guides = nearest_strands(signals, &dictionary);
            (dictionary, guides)
        });
        self.report.sparse_objective = dictionary.objective;
        self.report.n_stopped_codes = dictionary.n_stopped;
        guides
    }

    /// Gram matrices, then all sets, of a block of strands.
    fn solve_block(
        &mut self,
        frames: &dyn FrameSource,
        rest: &UniformGroom,
        guide_strands: &[u32],
        eligible: &Eligible,
        block: &[u32],
        fit: &PolyFit,
        params: &TrainParams,
    ) -> Result<Vec<StrandSets>> {
        let n_frames = frames.n_frames();
        let grams = self.stage("gram", n_frames as u64, |tick| {
            accumulate(frames, rest, guide_strands, eligible, block, params.blend, tick)
        })?;
        Ok(self.stage("subsets", block.len() as u64, |tick| {
            let mut solved = Vec::with_capacity(block.len());
            for some in grams.chunks(SOLVED_AT_ONCE) {
                solved.par_extend(some.par_iter().map_init(SubsetsWorkspace::default, |ws, gram| {
                    strand_sets(gram, n_frames, fit, params.min_weight, ws)
                }));
                tick(solved.len() as u64);
            }
            solved
        }))
    }

    fn summarise(&mut self, eligible: &Eligible, guide_strands: &[u32], sets: &SetArrays, full: &[FullSetError]) {
        let n_normal = full.len() - guide_strands.len();
        let per_normal = |total: usize| (total - guide_strands.len()) as f64 / n_normal.max(1) as f64;
        // A guide has itself as only eligible guide and only set, without error.
        self.report.mean_eligible = per_normal(eligible.guides.len());
        self.report.mean_kept_sets = per_normal(sets.mask.len());
        self.report.fit = fit_error(full.iter(), n_normal);
        self.report.largest_rounding = sets.largest_rounding;
    }

    /// Fit errors of the kind of transform trained for and of the other, on strands spread evenly over those that are not guides.
    fn compare_blends(
        &mut self,
        frames: &dyn FrameSource,
        rest: &UniformGroom,
        guide_strands: &[u32],
        eligible: &Eligible,
        trained: &[FullSetError],
        fit: &PolyFit,
        params: &TrainParams,
    ) -> Result<()> {
        let normal: Vec<u32> = (0..trained.len() as u32).filter(|s| guide_strands.binary_search(s).is_err()).collect();
        let n = params.n_compared.min(normal.len());
        if n == 0 {
            return Ok(());
        }
        let chosen: Vec<u32> = (0..n).map(|i| normal[i * normal.len() / n]).collect();
        let n_frames = frames.n_frames();
        let other = match params.blend {
            Blend::Translation => Blend::Rigid,
            Blend::Rigid => Blend::Translation,
        };
        let errors = self.stage("compare", n_frames as u64, |tick| -> Result<Vec<FullSetError>> {
            let grams = accumulate(frames, rest, guide_strands, eligible, &chosen, other, tick)?;
            let solve = |ws: &mut SubsetsWorkspace, gram| strand_sets(gram, n_frames, fit, params.min_weight, ws).full;
            Ok(grams.par_iter().map_init(SubsetsWorkspace::default, solve).collect())
        })?;
        self.report.n_compared = n;
        self.report.compared_chosen = fit_error(chosen.iter().map(|&s| &trained[s as usize]), n);
        self.report.compared_other = fit_error(errors.iter(), n);
        Ok(())
    }
}

fn fit_error<'a>(squares: impl Iterator<Item = &'a FullSetError>, n: usize) -> FitError {
    let mut sum = [0.0; 8];
    for e in squares {
        let terms = [
            e.free_squared_cm,
            e.quadratic_squared_cm,
            e.linear_squared_cm,
            e.cubic_squared_cm,
            e.free_weight_squared,
            e.quadratic_weight_squared,
            e.linear_weight_squared,
            e.cubic_weight_squared,
        ];
        sum.iter_mut().zip(terms).for_each(|(s, t)| *s += t);
    }
    let root = |at: usize| (sum[at] / n.max(1) as f64).sqrt();
    FitError {
        free_cm: root(0),
        quadratic_cm: root(1),
        linear_cm: root(2),
        cubic_cm: root(3),
        free_weight: root(4),
        quadratic_weight: root(5),
        linear_weight: root(6),
        cubic_weight: root(7),
    }
}

/// The model's arrays over sets, growing strand by strand.
struct SetArrays {
    start: Vec<u32>,
    mask: Vec<u16>,
    rms_error_cm: Vec<f32>,
    coeff_start: Vec<u32>,
    coeffs: Vec<[u16; 3]>,
    stand_in_start: Vec<u32>,
    stand_in: Vec<u16>,
    largest_rounding: f64,
}

impl SetArrays {
    fn new() -> Self {
        Self {
            start: vec![0],
            mask: Vec::new(),
            rms_error_cm: Vec::new(),
            coeff_start: Vec::new(),
            coeffs: Vec::new(),
            stand_in_start: vec![0],
            stand_in: Vec::new(),
            largest_rounding: 0.0,
        }
    }

    fn push(&mut self, strand: &StrandSets) -> Result<()> {
        let mut at = self.coeffs.len();
        for mask in &strand.masks {
            self.coeff_start.push(numbered("coeffs", at)?);
            at += mask.count_ones() as usize;
        }
        self.mask.extend_from_slice(&strand.masks);
        self.rms_error_cm.extend_from_slice(&strand.rms_error_cm);
        self.coeffs.extend_from_slice(&strand.coeffs);
        self.stand_in.extend_from_slice(&strand.stand_in);
        self.start.push(numbered("set_mask", self.mask.len())?);
        self.stand_in_start.push(numbered("stand_in", self.stand_in.len())?);
        self.largest_rounding = self.largest_rounding.max(strand.largest_rounding);
        Ok(())
    }
}

fn numbered(what: &'static str, count: usize) -> Result<u32> {
    u32::try_from(count).map_err(|_| Error::TooLarge { what, count })
}

fn assemble(
    inputs: &TrainInputs<'_>,
    params: &TrainParams,
    guide_strands: Vec<u32>,
    eligible: Eligible,
    pairs: Vec<[u16; 2]>,
    scales: MotionScales,
    sets: SetArrays,
) -> Result<SkinningModel> {
    let groom_in_head =
        guide_strands.iter().flat_map(|&s| inputs.groom.strand(s as usize)).flatten().copied().collect();
    Ok(SkinningModel {
        provenance: inputs.provenance,
        n_strands: numbered("rest_in_head", inputs.rest.n_strands)?,
        n_particles: numbered("rest_in_head", inputs.rest.n_particles)?,
        groom_in_head,
        rest_in_head: inputs.rest.points.iter().flatten().copied().collect(),
        guide_strands,
        eligible_start: eligible.start,
        eligible: eligible.guides,
        set_start: sets.start,
        set_mask: sets.mask,
        set_rms_error_cm: sets.rms_error_cm,
        coeff_start: sets.coeff_start,
        coeffs: sets.coeffs,
        stand_in_start: sets.stand_in_start,
        stand_in: sets.stand_in,
        pairs,
        position_scale: scales.position_scale,
        velocity_scale: scales.velocity_scale,
        velocity_weight: params.velocity_weight,
        max_distance: scales.max_distance,
        release_distance: scales.release_distance,
        blend: params.blend,
        material: inputs.material,
    })
}
