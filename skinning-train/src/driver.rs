//! Frames in, skinning model out: the stages of AS16 §6 in order.
//!
//! reduce -> guides (Eqs. 9, 10) -> eligible -> scales (§7.1) -> weights (Eq. 7's data, Algorithm 2; block by block of
//! strands) -> compare. Each stage is keyed by a hash of what it is made from; with a cache it is taken from there, so a
//! training that was cut off goes on after its last whole stage or block, and blocks may be solved by several processes.
//! Frames are only ever streamed. Same inputs, same model bytes, for any number of threads and however often it was cut
//! off. No simulation is stepped and no solid is seen.

use std::collections::BTreeMap;
use std::ops::Range;

use io_formats::guide_transform::Blend;
use io_formats::{FrameSource, MaterialRecord, SkinningModel, StageCache, StageCost, UniformGroom};
use rayon::prelude::*;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use tracing::info_span;

use crate::assemble::{SetArrays, assemble};
use crate::eligible::{Eligible, EligibleParams, choose_eligible};
use crate::error::{Error, Result};
use crate::gram::{StrandGram, accumulate};
use crate::guide_select::graph::GuideParts;
use crate::guide_select::method::{EligibleRule, compared_guides};
use crate::guide_select::nearest::nearest_strands;
use crate::guide_select::part_eligible::choose_eligible_of_parts;
use crate::guide_select::sparse_coding::{SparseCodingParams, learn_dictionary};
use crate::keys::Keys;
use crate::motion_scales::{CalibrationParams, MotionScales, calibrate};
use crate::params::{FitError, JudgedFit, Progress, TrainParams, TrainReport};
use crate::poly_fit::PolyFit;
use crate::reduce::reduce;
use crate::subsets::{FullSetError, SubsetsWorkspace, best_set_error, strand_sets};

/// Gram matrices held at a time: blocks that fit share one pass over the frames.
const GRAM_BYTES: usize = 1536 << 20;
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
    /// Hash of everything the frames, shapes and material were made from: the name under which stages are kept.
    pub provenance: u64,
}

/// The guides of a head and who may follow them.
#[derive(Debug, Clone, PartialEq)]
pub struct Guides {
    /// Strand of each guide, ascending.
    pub strands: Vec<u32>,
    /// Eligible guides of every strand.
    pub eligible: Eligible,
}

impl Guides {
    /// Strands spread evenly over those that are not guides, at most `n` of them.
    fn sample(&self, n_strands: usize, n: usize) -> Vec<u32> {
        let normal: Vec<u32> = (0..n_strands as u32).filter(|s| self.strands.binary_search(s).is_err()).collect();
        let n = n.min(normal.len());
        (0..n).map(|i| normal[i * normal.len() / n]).collect()
    }
}

/// What is kept of choosing guides.
#[derive(Serialize, Deserialize)]
struct ChosenGuides {
    strands: Vec<u32>,
    /// Where guides stand for parts of a graph.
    parts: Option<GuideParts>,
    objective: Vec<f64>,
    n_stopped: usize,
    rank: usize,
    lost_energy: f64,
}

/// A training under way.
pub struct Trainer<'a> {
    frames: &'a dyn FrameSource,
    inputs: TrainInputs<'a>,
    params: &'a TrainParams,
    fit: PolyFit,
    cache: Option<&'a StageCache>,
    report: TrainReport,
    /// Kept stages whose cost is in the report.
    noted: Vec<u64>,
    progress: &'a mut dyn FnMut(Progress),
}

/// Trains a skinning model, keeping nothing on disk. `progress` hears of every stage as it goes on.
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
    Trainer::new(frames, *inputs, params, None, progress)?.finish()
}

impl<'a> Trainer<'a> {
    /// Checks everything that can be checked before any frame is read. Without a `cache` every stage is done anew.
    ///
    /// # Errors
    /// When inputs do not describe the same hair, parameters are out of range, there are too few frames or particles.
    pub fn new(
        frames: &'a dyn FrameSource,
        inputs: TrainInputs<'a>,
        params: &'a TrainParams,
        cache: Option<&'a StageCache>,
        progress: &'a mut dyn FnMut(Progress),
    ) -> Result<Self> {
        let fit = check_inputs(frames, &inputs, params)?;
        let report =
            TrainReport { n_strands: frames.n_strands(), n_frames: frames.n_frames(), ..TrainReport::default() };
        Ok(Self { frames, inputs, params, fit, cache, report, noted: Vec::new(), progress })
    }

    fn keys(&self) -> Keys<'a> {
        Keys { inputs: self.inputs.provenance, params: self.params }
    }

    /// Blocks of strands that begin within `strands`.
    fn blocks_in(&self, strands: &Range<usize>) -> Range<usize> {
        let per_block = self.params.strands_per_block;
        let first = strands.start.div_ceil(per_block);
        first..strands.end.min(self.frames.n_strands()).div_ceil(per_block).max(first)
    }

    fn strands_of(&self, block: usize) -> Range<usize> {
        let per_block = self.params.strands_per_block;
        block * per_block..((block + 1) * per_block).min(self.frames.n_strands())
    }

    fn eligible_params(&self) -> EligibleParams {
        let p = self.params;
        EligibleParams {
            sparsity: p.sparsity,
            min_weight: p.min_weight,
            min_guides: p.min_eligible,
            max_guides: p.max_eligible,
        }
    }

    fn calibration(&self) -> CalibrationParams {
        let p = self.params;
        CalibrationParams {
            velocity_weight: p.velocity_weight,
            percentile: p.distance_percentile,
            release_factor: p.release_factor,
        }
    }

    /// Chooses the guides and each strand's eligible ones, or takes what the cache has.
    ///
    /// # Errors
    /// When a frame cannot be read or is not finite, or a stage cannot be kept.
    pub fn choose_guides(&mut self) -> Result<Guides> {
        let (frames, rest, params) = (self.frames, self.inputs.rest, self.params);
        let n_frames = frames.n_frames() as u64;
        let (guides_key, eligible_key) = (self.keys().guides(), self.keys().eligible());
        let signals = if self.is_kept("guides", guides_key) && self.is_kept("eligible", eligible_key) {
            self.note_kept("reduce", self.keys().reduce());
            None
        } else {
            Some(self.stage("reduce", self.keys().reduce(), 2 * n_frames, |tick| {
                reduce(frames, params.rank, params.oversample, params.seed, tick)
            })?)
        };
        let of_signals = |stage: &'static str| signals.as_ref().ok_or(Error::LostStage { stage });
        let coding = SparseCodingParams {
            n_atoms: params.n_guides,
            sparsity: params.sparsity,
            epochs: params.epochs,
            batch: params.batch,
            seed: params.seed,
        };
        let chosen: ChosenGuides = self.stage("guides", guides_key, params.epochs as u64, |tick| {
            let signals = of_signals("guides")?;
            if let Some((strands, parts)) = compared_guides(frames, rest, params, tick)? {
                let (rank, lost_energy) = (signals.rank, signals.lost_energy);
                return Ok(ChosenGuides { strands, parts, objective: Vec::new(), n_stopped: 0, rank, lost_energy });
            }
            let dictionary = learn_dictionary(signals, &coding, tick);
            Ok(ChosenGuides {
                strands: nearest_strands(signals, &dictionary),
                parts: None,
                objective: dictionary.objective,
                n_stopped: dictionary.n_stopped,
                rank: signals.rank,
                lost_energy: signals.lost_energy,
            })
        })?;
        let strands = chosen.strands;
        let limits = self.eligible_params();
        let parts = chosen.parts.filter(|_| params.eligible_rule == EligibleRule::Parts);
        let eligible = self.stage("eligible", eligible_key, 1, |tick| match &parts {
            Some(parts) => choose_eligible_of_parts(frames, rest, parts, &limits, tick),
            None => Ok(choose_eligible(of_signals("eligible")?, &strands, &limits)),
        })?;
        drop(signals);
        let report = &mut self.report;
        report.rank = chosen.rank;
        report.lost_energy = chosen.lost_energy;
        report.sparse_objective = chosen.objective;
        report.n_stopped_codes = chosen.n_stopped;
        report.n_guides = strands.len();
        Ok(Guides { strands, eligible })
    }

    /// When guides count as moving alike: the pairs that may meet, and their scales.
    fn scale(&mut self, guides: &Guides) -> Result<(Vec<[u16; 2]>, MotionScales)> {
        let pairs = guides.eligible.pairs();
        let (frames, calibration) = (self.frames, self.calibration());
        let scales = self.stage("scales", self.keys().scales(), frames.n_frames() as u64, |tick| {
            calibrate(frames, &guides.strands, &pairs, &calibration, tick)
        })?;
        let report = &mut self.report;
        report.n_pairs = pairs.len();
        report.max_distance = scales.max_distance;
        report.connected = scales.connected;
        report.connected_paper = scales.connected_paper;
        Ok((pairs, scales))
    }

    /// Solves the blocks of strands that begin within `strands` and keeps them in the cache, for another process to
    /// finish with. Blocks kept already are passed over.
    ///
    /// # Errors
    /// When a frame cannot be read or a block cannot be kept.
    pub fn solve_weights(&mut self, strands: Range<usize>) -> Result<()> {
        let guides = self.choose_guides()?;
        self.solve_blocks(&guides, self.blocks_in(&strands)).map(drop)
    }

    /// Does what is left of the training and puts the model together.
    ///
    /// # Errors
    /// When a frame cannot be read or is not finite, a stage cannot be kept, or the model breaks an invariant.
    pub fn finish(mut self) -> Result<(SkinningModel, TrainReport)> {
        let guides = self.choose_guides()?;
        let (pairs, scales) = self.scale(&guides)?;
        let all = self.blocks_in(&(0..self.frames.n_strands()));
        let mut solved = self.solve_blocks(&guides, all.clone())?;
        let mut sets = SetArrays::new();
        for block in all {
            let next = match solved.remove(&block) {
                Some(next) => next,
                None => self.kept_block(block)?,
            };
            sets.append(next)?;
        }
        self.summarise(&guides, &sets);
        self.compare_blends(&guides, &sets.full)?;
        let model = assemble(&self.inputs, self.params, self.keys().model(), guides, pairs, scales, sets)?;
        model.validate()?;
        Ok((model, self.report))
    }

    fn kept_block(&mut self, block: usize) -> Result<SetArrays> {
        let key = self.keys().block(block);
        self.note_kept("weights", key);
        let kept = self.cache.map(|cache| cache.load("weights", key)).transpose()?;
        kept.flatten().ok_or(Error::LostStage { stage: "weights" })
    }

    /// Solves what of `blocks` the cache does not have. Returns blocks that could not be kept.
    fn solve_blocks(&mut self, guides: &Guides, blocks: Range<usize>) -> Result<BTreeMap<usize, SetArrays>> {
        let n_particles = self.frames.n_particles();
        let missing: Vec<usize> = blocks.filter(|&b| !self.is_kept("weights", self.keys().block(b))).collect();
        let bytes = |run: &Self, block| -> usize {
            let pairs = run.strands_of(block).map(|s| guides.eligible.of(s).len()).map(|k| k * (k + 1) / 2);
            pairs.sum::<usize>() * n_particles * size_of::<f64>()
        };
        let mut solved = BTreeMap::new();
        let mut first = 0;
        while first < missing.len() {
            let mut end = first + 1;
            let mut held = bytes(self, missing[first]);
            while end < missing.len() && held + bytes(self, missing[end]) <= GRAM_BYTES {
                held += bytes(self, missing[end]);
                end += 1;
            }
            self.solve_pass(guides, &missing[first..end], &mut solved)?;
            first = end;
        }
        Ok(solved)
    }

    /// One pass over the frames for as many blocks as fit into memory.
    fn solve_pass(&mut self, guides: &Guides, blocks: &[usize], solved: &mut BTreeMap<usize, SetArrays>) -> Result<()> {
        // Whoever else works at one of these finishes first; a block it kept is then taken from there.
        let mut locks = Vec::new();
        let mut ours = Vec::new();
        for &block in blocks {
            if let Some(cache) = self.cache {
                let key = self.keys().block(block);
                let lock = cache.lock("weights", key)?;
                if cache.path("weights", key).exists() {
                    continue;
                }
                locks.push(lock);
            }
            ours.push(block);
        }
        let strands: Vec<u32> = ours.iter().flat_map(|&b| self.strands_of(b)).map(|s| s as u32).collect();
        if strands.is_empty() {
            return Ok(());
        }
        let n_frames = self.frames.n_frames();
        let (frames, rest, blend) = (self.frames, self.inputs.rest, self.params.blend);
        let (mut grams, gram_cost) = self.measured("gram", n_frames as u64, |tick| {
            accumulate(frames, rest, &guides.strands, &guides.eligible, &strands, blend, tick)
        })?;
        let mut left = grams.drain(..);
        let mut n_solved = 0;
        for &block in &ours {
            let clock = StageCost::clock();
            let n = self.strands_of(block).len();
            let mut sets = SetArrays::new();
            let grams: Vec<StrandGram> = left.by_ref().take(n).collect();
            for some in grams.chunks(SOLVED_AT_ONCE) {
                let (fit, min_weight) = (&self.fit, self.params.min_weight);
                let strand_sets: Vec<_> = some
                    .par_iter()
                    .map_init(SubsetsWorkspace::default, |ws, gram| strand_sets(gram, n_frames, fit, min_weight, ws))
                    .collect();
                strand_sets.iter().try_for_each(|s| sets.push(s))?;
                n_solved += some.len();
                let (done, total) = (n_solved as u64, strands.len() as u64);
                (self.progress)(Progress { stage: "weights", done, total });
            }
            let mut cost = clock.cost();
            let share = n as f64 / strands.len() as f64;
            cost.wall_s += share * gram_cost.wall_s;
            cost.cpu_s += share * gram_cost.cpu_s;
            match self.cache {
                Some(cache) => {
                    let key = self.keys().block(block);
                    cache.save("weights", key, &sets)?;
                    cost.bytes = StageCost::bytes_of(&cache.path("weights", key));
                    cache.note_cost("weights", key, cost)?;
                }
                None => {
                    self.note("weights", cost);
                    solved.insert(block, sets);
                }
            }
        }
        drop(locks);
        Ok(())
    }

    fn summarise(&mut self, guides: &Guides, sets: &SetArrays) {
        let n_guides = guides.strands.len();
        let n_normal = sets.full.len() - n_guides;
        let per_normal = |total: usize| (total - n_guides) as f64 / n_normal.max(1) as f64;
        // A guide has itself as only eligible guide and only set, without error.
        self.report.mean_eligible = per_normal(guides.eligible.guides.len());
        self.report.mean_kept_sets = per_normal(sets.mask.len());
        self.report.fit = fit_error(sets.full.iter(), n_normal);
        self.report.largest_rounding = sets.largest_rounding;
    }

    /// How well guides alone serve, before the weights of all strands are worth solving: errors with quadratic weights on a
    /// sample of strands, on the frames trained on and on others. `judged` is hashed as `judged_key`.
    ///
    /// # Errors
    /// When a frame cannot be read or is not finite, or a stage cannot be kept.
    pub fn judge(&mut self, judged: &dyn FrameSource, judged_key: u64) -> Result<JudgedFit> {
        let guides = self.choose_guides()?;
        let chosen = guides.sample(self.frames.n_strands(), self.params.n_compared);
        let (frames, rest, blend) = (self.frames, self.inputs.rest, self.params.blend);
        let (fit, min_weight) = (self.fit.clone(), self.params.min_weight);
        let total = (frames.n_frames() + judged.n_frames()) as u64;
        let key = self.keys().judge(chosen.len(), judged_key);
        self.stage("judge", key, total, |tick| {
            let (strands, eligible) = (&guides.strands, &guides.eligible);
            let trained = accumulate(frames, rest, strands, eligible, &chosen, blend, tick)?;
            let on_others = accumulate(judged, rest, strands, eligible, &chosen, blend, &mut |done| {
                tick(frames.n_frames() as u64 + done);
            })?;
            let errors: Vec<[f64; 2]> = trained
                .par_iter()
                .zip(&on_others)
                .map_init(SubsetsWorkspace::default, |ws, (trained, other)| {
                    let sets = strand_sets(trained, frames.n_frames(), &fit, min_weight, ws);
                    [(trained, frames.n_frames()), (other, judged.n_frames())]
                        .map(|(gram, n)| best_set_error(&sets, gram, n, &fit))
                })
                .collect();
            let rms = |at: usize| (errors.iter().map(|e| e[at]).sum::<f64>() / errors.len().max(1) as f64).sqrt();
            Ok(JudgedFit { n_guides: strands.len(), n_strands: chosen.len(), trained_cm: rms(0), judged_cm: rms(1) })
        })
    }

    /// Fit errors of the kind of transform trained for and of the other, on strands spread evenly over those that are not guides.
    fn compare_blends(&mut self, guides: &Guides, trained: &[FullSetError]) -> Result<()> {
        let chosen = guides.sample(trained.len(), self.params.n_compared);
        let n = chosen.len();
        if n == 0 {
            return Ok(());
        }
        let n_frames = self.frames.n_frames();
        let other = match self.params.blend {
            Blend::Translation => Blend::Rigid,
            Blend::Rigid => Blend::Translation,
        };
        let key = self.keys().compare(n);
        let (frames, rest) = (self.frames, self.inputs.rest);
        let (fit, min_weight) = (self.fit.clone(), self.params.min_weight);
        let errors: Vec<FullSetError> = self.stage("compare", key, n_frames as u64, |tick| {
            let grams = accumulate(frames, rest, &guides.strands, &guides.eligible, &chosen, other, tick)?;
            let solve = |ws: &mut SubsetsWorkspace, gram| strand_sets(gram, n_frames, &fit, min_weight, ws).full;
            Ok(grams.par_iter().map_init(SubsetsWorkspace::default, solve).collect())
        })?;
        self.report.n_compared = n;
        self.report.compared_chosen = fit_error(chosen.iter().map(|&s| &trained[s as usize]), n);
        self.report.compared_other = fit_error(errors.iter(), n);
        Ok(())
    }

    /// What the stages done or taken so far have cost.
    #[must_use]
    pub fn costs(&self) -> &[(String, StageCost)] {
        &self.report.stages
    }

    fn is_kept(&self, stage: &str, key: u64) -> bool {
        self.cache.is_some_and(|cache| cache.path(stage, key).exists())
    }

    /// One stage: from the cache, or made, kept, and its cost noted.
    fn stage<T: Serialize + DeserializeOwned>(
        &mut self,
        stage: &'static str,
        key: u64,
        total: u64,
        make: impl FnOnce(&mut dyn FnMut(u64)) -> Result<T>,
    ) -> Result<T> {
        let Some(cache) = self.cache else {
            let (value, cost) = self.measured(stage, total, make)?;
            self.note(stage, cost);
            return Ok(value);
        };
        if let Some(value) = cache.load(stage, key)? {
            self.note_kept(stage, key);
            return Ok(value);
        }
        let lock = cache.lock(stage, key)?;
        let value = match cache.load(stage, key)? {
            Some(value) => value,
            None => {
                let (value, cost) = self.measured(stage, total, make)?;
                cache.save(stage, key, &value)?;
                let path = cache.path(stage, key);
                cache.note_cost(stage, key, StageCost { bytes: StageCost::bytes_of(&path), ..cost })?;
                value
            }
        };
        drop(lock);
        self.note_kept(stage, key);
        Ok(value)
    }

    /// Runs something that tells how far it is, and measures it.
    fn measured<T>(
        &mut self,
        stage: &'static str,
        total: u64,
        work: impl FnOnce(&mut dyn FnMut(u64)) -> Result<T>,
    ) -> Result<(T, StageCost)> {
        let _span = info_span!("train", stage).entered();
        let clock = StageCost::clock();
        (self.progress)(Progress { stage, done: 0, total });
        let result = work(&mut |done| (self.progress)(Progress { stage, done, total }))?;
        (self.progress)(Progress { stage, done: total, total });
        let cost = clock.cost();
        tracing::debug!(stage, wall_s = cost.wall_s, cpu_s = cost.cpu_s, "stage done");
        Ok((result, cost))
    }

    /// Adds what a stage in the cache once took, once.
    fn note_kept(&mut self, stage: &str, key: u64) {
        if self.noted.contains(&key) {
            return;
        }
        self.noted.push(key);
        if let Some(cost) = self.cache.and_then(|cache| cache.cost(stage, key)) {
            self.note(stage, cost);
        }
    }

    /// Adds to what a stage is known to have taken.
    fn note(&mut self, stage: &str, cost: StageCost) {
        match self.report.stages.iter_mut().find(|(name, _)| name == stage) {
            Some((_, sum)) => *sum += cost,
            None => self.report.stages.push((stage.to_owned(), cost)),
        }
    }
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
