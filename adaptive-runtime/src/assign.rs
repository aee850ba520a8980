//! Choice of a guide set for each hair (AS16 §4.3), on masks over its at most nine eligible guides.
//!
//! A set whose members no longer form a clique is left, for the candidate that moves the hair least; and here only where that brings
//! guides nearer to where solids hold the hair, for fewer guides say less of a hair that follows all of them well (docs/DEVIATIONS.md). AS16 Eq. (3) to the
//! letter then never leaves a set while it is a clique, so hairs drift to single guides for good; here a set also grows
//! back, to one that trained better and moves the hair little (docs/DEVIATIONS.md). Either way the caller makes of the jump
//! an offset that fades. Driven by events: only hairs whose set an edge's loss broke, and those that want to grow and whose
//! turn it is, are looked at; what is chosen is what looking at all of them would choose. Where hairs leave sets only if something holds them
//! off, edges are asked for by those alone that may change ([`Assignment::ask`]).

mod cliques;
mod distance_weights;
mod index;
mod letter;
mod shift;
#[cfg(test)]
mod tests;

use crate::clusters::Clusters;
use crate::graph::GuideGraph;
use crate::interpolate::{ActiveSet, TransformArrays};
use crate::params::{AssignParams, CliqueRule, WeightRule};
use crate::strands::Offsets;
use cliques::{LocalGraph, bits};
use index::PairIndex;
use io_formats::skinning_model::{SkinningModel, StrandSets};
use rayon::prelude::*;
use shift::{Lanes, Shift};

/// A hair's new set: its index within the hair's kept sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SetChange {
    pub strand: u32,
    pub set: u16,
}

/// Set of a hair within its kept sets when all its guides may be used: the best-trained one.
pub(crate) fn best_set(model: &SkinningModel, strand: usize) -> u16 {
    let sets = model.sets_of(strand);
    sets.stand_in[sets.stand_in.len() - 1]
}

/// Decodes a hair's kept set for interpolation.
pub(crate) fn decode(model: &SkinningModel, strand: usize, set: u16, weights: WeightRule) -> ActiveSet {
    let eligible = model.eligible_of(strand);
    let at = model.set_start[strand] as usize + usize::from(set);
    let mut out = ActiveSet::EMPTY;
    for (slot, bit) in bits(model.set_mask[at]).enumerate() {
        out.guides[slot] = eligible[bit];
        out.n = slot as u8 + 1;
    }
    match weights {
        WeightRule::Trained => out.weights.iter_mut().zip(model.weights_of_set(at)).for_each(|(w, of)| *w = of),
        WeightRule::Distance => {
            out.weights = distance_weights::distance_weights(model, strand, &out.guides[..usize::from(out.n)]);
        }
    }
    out
}

/// What a step's choices read.
#[derive(Clone, Copy)]
struct Choosing<'a> {
    model: &'a SkinningModel,
    graph: &'a GuideGraph,
    clusters: &'a Clusters,
    transforms: &'a TransformArrays,
    params: &'a AssignParams,
    lanes: &'a Lanes,
    /// Where hairs are held, if broken sets are left for that alone.
    offsets: Option<Offsets<'a>>,
}

/// One hair as its choice sees it.
struct Hair<'a> {
    graph: &'a GuideGraph,
    eligible: &'a [u16],
    sets: StrandSets<'a>,
}

/// Buffers of one hair's choice.
#[derive(Clone, Debug, Default)]
struct Choice {
    /// Sets to choose from, and how far each moves the hair, cm.
    candidates: Vec<u16>,
    moves: Vec<f32>,
    masks: Vec<u16>,
    shift: Shift,
    carried: Vec<f32>,
}

/// What came of looking at a hair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    Change(u16),
    /// Nothing better is there until an edge appears.
    Content,
    /// It is to be looked at again: a better set would move the hair too far for now, or its broken one still serves best.
    Wanting,
}

/// Results of one worker.
#[derive(Clone, Debug, Default)]
struct Worker {
    changes: Vec<SetChange>,
    content: Vec<u32>,
    wanting: Vec<u32>,
    choice: Choice,
}

/// Finds the hairs to look at in each step; buffers are kept from step to step.
#[derive(Clone, Debug)]
pub(crate) struct Assignment {
    index: PairIndex,
    lanes: Lanes,
    /// Mask of each hair's present set.
    mask: Vec<u16>,
    /// One bit per hair: its set lost an edge.
    broken: Vec<u64>,
    /// One bit per hair: a better set may be there.
    wanting: Vec<u64>,
    /// One bit per hair: it has the best set there is.
    best: Vec<u64>,
    /// One bit per hair: its edges are known, and it may change.
    asked: Vec<u64>,
    due: Vec<u32>,
    workers: Vec<Worker>,
    changes: Vec<SetChange>,
}

impl Assignment {
    /// For hairs that all have their [`best_set`], all edges there.
    pub fn new(model: &SkinningModel, graph: &GuideGraph) -> Self {
        let n = model.n_strands as usize;
        let words = n.div_ceil(64);
        let mask = (0..n).map(|s| model.sets_of(s).masks[usize::from(best_set(model, s))]).collect();
        let mut assignment = Self {
            index: PairIndex::new(model),
            lanes: Lanes::new(model.n_particles as usize, crate::interpolate::padded(model.n_particles as usize)),
            mask,
            broken: vec![0; words],
            wanting: vec![0; words],
            best: vec![0; words],
            asked: vec![!0; words],
            due: Vec::new(),
            workers: Vec::new(),
            changes: Vec::new(),
        };
        for s in 0..n {
            assignment.best[s / 64] |= 1 << (s % 64);
            // A set of guides that no pair of the model joins is none.
            if !LocalGraph::of(graph, model.eligible_of(s)).is_clique(assignment.mask[s]) {
                assignment.broken[s / 64] |= 1 << (s % 64);
            }
        }
        assignment
    }

    /// Asks the graph for the edges of hairs that may change: those held off by more than [`AssignParams::leave_gain_cm`] and those that follow
    /// less than their best set; without `offsets` for all. To be called before each update of the graph.
    pub fn ask(
        &mut self,
        model: &SkinningModel,
        graph: &mut GuideGraph,
        params: &AssignParams,
        offsets: Option<Offsets>,
    ) {
        let Some(offsets) = offsets else {
            self.asked.fill(!0);
            graph.ask_all();
            return;
        };
        let n_strands = self.mask.len();
        self.asked.par_iter_mut().zip(&self.best).enumerate().with_min_len(WORDS_PER_TASK).for_each(
            |(word, (asked, best))| {
                *asked = 0;
                for s in 64 * word..n_strands.min(64 * (word + 1)) {
                    let bit = 1 << (s % 64);
                    if best & bit == 0 || offsets.is_held_off(s, params.leave_gain_cm) {
                        *asked |= bit;
                    }
                }
            },
        );
        graph.ask_none();
        for (word, &asked) in self.asked.iter().enumerate() {
            let mut asked = asked;
            while asked != 0 {
                graph.ask_among(model.eligible_of(64 * word + asked.trailing_zeros() as usize));
                asked &= asked - 1;
            }
        }
    }

    /// Hairs that change their set, ascending: the caller is to apply all of them to `sets`, which holds each hair's present one.
    /// To be called once after each update of the graph. With `offsets` broken sets are left by [`AssignParams::leave_gain_cm`], else at once.
    pub fn update(
        &mut self,
        model: &SkinningModel,
        graph: &GuideGraph,
        clusters: &Clusters,
        transforms: &TransformArrays,
        params: &AssignParams,
        offsets: Option<Offsets>,
        choice_number: u64,
        sets: &[u16],
    ) -> &[SetChange] {
        self.mark(graph);
        self.collect_due(params, choice_number);
        let choosing = Choosing { model, graph, clusters, transforms, params, lanes: &self.lanes, offsets };
        let n_workers = (4 * rayon::current_num_threads()).min(self.due.len().div_ceil(LEAST_PER_WORKER)).max(1);
        let share = self.due.len().div_ceil(n_workers).max(1);
        if self.workers.len() < n_workers {
            self.workers.resize_with(n_workers, Worker::default);
        }
        for worker in &mut self.workers {
            worker.changes.clear();
            worker.content.clear();
            worker.wanting.clear();
        }
        let look = |(due, worker): (&[u32], &mut Worker)| {
            for &strand in due {
                match choosing.look_at(strand as usize, sets[strand as usize], &mut worker.choice) {
                    Outcome::Change(set) => worker.changes.push(SetChange { strand, set }),
                    Outcome::Content => worker.content.push(strand),
                    Outcome::Wanting => worker.wanting.push(strand),
                }
            }
        };
        if n_workers == 1 {
            look((&self.due, &mut self.workers[0]));
        } else {
            self.due.par_chunks(share).zip(self.workers.par_iter_mut()).for_each(look);
        }
        self.changes.clear();
        for worker in &self.workers {
            for &strand in &worker.content {
                self.wanting[strand as usize / 64] &= !(1 << (strand % 64));
            }
            for &strand in &worker.wanting {
                self.wanting[strand as usize / 64] |= 1 << (strand % 64);
            }
            for &change in &worker.changes {
                let s = change.strand as usize;
                let bit = 1 << (s % 64);
                self.mask[s] = model.sets_of(s).masks[usize::from(change.set)];
                if change.set == best_set(model, s) {
                    self.best[s / 64] |= bit;
                    self.wanting[s / 64] &= !bit;
                } else {
                    self.best[s / 64] &= !bit;
                    self.wanting[s / 64] |= bit;
                }
            }
            self.changes.extend_from_slice(&worker.changes);
        }
        &self.changes
    }

    /// Takes over the graph's changes: a lost edge breaks the sets that use it, a new one lets hairs want more.
    fn mark(&mut self, graph: &GuideGraph) {
        for &pair in graph.flipped() {
            if graph.is_connected(pair) {
                for (s, _) in self.index.strands_of(pair) {
                    let (word, bit) = (s as usize / 64, 1 << (s % 64));
                    self.wanting[word] |= bit & !self.best[word];
                }
            } else {
                for (s, both) in self.index.strands_of(pair) {
                    let broken = u64::from(self.mask[s as usize] & both == both);
                    self.broken[s as usize / 64] |= broken << (s % 64);
                }
            }
        }
    }

    fn collect_due(&mut self, params: &AssignParams, choice_number: u64) {
        self.due.clear();
        let again = params.growth_tolerance_cm >= 0.0 || params.leave_gain_cm >= 0.0;
        for word in 0..self.broken.len() {
            let wanting = match params.cliques {
                CliqueRule::Local => self.wanting[word],
                // Grown cliques change with motion alone.
                CliqueRule::Grown => self.wanting[word] | !self.best[word],
            };
            let asked = self.asked[word];
            let mut due = self.broken[word] & asked;
            self.wanting[word] |= self.broken[word] & !asked;
            self.broken[word] = 0;
            if again && wanting & asked != 0 {
                due |= wanting & asked & turn_of_word(choice_number, word, params.growth_period);
            }
            while due != 0 {
                let s = (word * 64) as u32 + due.trailing_zeros();
                due &= due - 1;
                if (s as usize) < self.mask.len() {
                    self.due.push(s);
                }
            }
        }
    }
}

/// Words of hairs worth another task.
const WORDS_PER_TASK: usize = 64;

/// Hairs worth another worker.
const LEAST_PER_WORKER: usize = 64;

/// Whether a hair may try to grow in a step: hairs take turns. The plain form of [`turn_of_word`].
#[cfg(test)]
fn is_turn(choice_number: u64, strand: u64, period: u32) -> bool {
    (choice_number + strand).is_multiple_of(u64::from(period))
}

/// Which of the 64 hairs of a word may try to grow in a step: hair `s` where `choice_number + s` is a multiple of the period.
fn turn_of_word(choice_number: u64, word: usize, period: u32) -> u64 {
    let period = u64::from(period);
    let first = (period - (choice_number + 64 * word as u64) % period) % period;
    let mut turns = 0;
    let mut bit = first;
    while bit < 64 {
        turns |= 1 << bit;
        bit += period;
    }
    turns
}

impl Choosing<'_> {
    fn look_at(&self, strand: usize, current: u16, choice: &mut Choice) -> Outcome {
        let hair =
            Hair { graph: self.graph, eligible: self.model.eligible_of(strand), sets: self.model.sets_of(strand) };
        let local = LocalGraph::of(self.graph, hair.eligible);
        let mask = hair.sets.masks[usize::from(current)];
        if local.is_clique(mask) {
            self.grow(strand, current, &hair, &local, choice)
        } else {
            self.leave(strand, current, &hair, &local, choice)
        }
    }

    /// A better-trained set of those that stand in for a clique around the present set, if it moves the hair little.
    fn grow(&self, strand: usize, current: u16, hair: &Hair, local: &LocalGraph, choice: &mut Choice) -> Outcome {
        if self.params.growth_tolerance_cm < 0.0 {
            return Outcome::Content;
        }
        let sets = &hair.sets;
        let mask = sets.masks[usize::from(current)];
        let error = |set: u16| sets.rms_error_cm[usize::from(set)];
        let candidate = match self.params.cliques {
            CliqueRule::Grown => letter::grown(hair, self.clusters, choice, mask),
            CliqueRule::Local => {
                let mut best: Option<u16> = None;
                local.maximal_cliques(|clique| {
                    if clique & mask == mask {
                        let set = sets.stand_in[usize::from(clique) - 1];
                        if best.is_none_or(|b| error(set) < error(b)) {
                            best = Some(set);
                        }
                    }
                });
                best
            }
        };
        let Some(candidate) = candidate.filter(|&c| error(c) < error(current)) else {
            return Outcome::Content;
        };
        let of = (self.model, self.params.weights);
        choice.shift.begin(of, self.lanes, self.transforms, (strand, current));
        let moved = choice.shift.to(of, self.lanes, self.transforms, (strand, candidate));
        if moved <= self.params.growth_tolerance_cm { Outcome::Change(candidate) } else { Outcome::Wanting }
    }

    /// Of the candidates that move the hair least, the best-trained one.
    /// Implements AS16 Eq. (3), states compared by position.
    ///
    /// A departure: AS16 takes C ∩ G for every eligible set G. Here G is the present set, of which little is lost, and all guides:
    /// of each clique C the kept sets that stand in for what it leaves of the two. Others lie between these and cost a shift each.
    ///
    /// Another: where solids hold the hair is known, that is its state, and the broken set a candidate too.
    fn leave(&self, strand: usize, current: u16, hair: &Hair, local: &LocalGraph, choice: &mut Choice) -> Outcome {
        let of = (self.model, self.params.weights);
        let mut held_off = None;
        if let Some(offsets) = &self.offsets {
            let Choice { shift, carried, .. } = &mut *choice;
            // At best a candidate puts the hair where it is.
            if !offsets.write(strand, self.params.leave_gain_cm, carried) {
                return Outcome::Wanting;
            }
            shift.begin(of, self.lanes, self.transforms, (strand, current));
            let by = shift.carry(&carried[..3 * offsets.pad], self.lanes, self.model.n_particles);
            if by <= self.params.leave_gain_cm {
                return Outcome::Wanting;
            }
            held_off = Some(by);
        }
        let sets = &hair.sets;
        let mask = sets.masks[usize::from(current)];
        match self.params.cliques {
            CliqueRule::Grown => letter::choose(hair, self.clusters, choice),
            CliqueRule::Local => {
                let candidates = &mut choice.candidates;
                candidates.clear();
                local.maximal_cliques(|clique| {
                    for share in [clique & mask, clique] {
                        if share != 0 {
                            let set = sets.stand_in[usize::from(share) - 1];
                            if !candidates.contains(&set) {
                                candidates.push(set);
                            }
                        }
                    }
                });
                // By index, so that the order of the search decides nothing.
                candidates.sort_unstable();
            }
        }
        if held_off.is_none() {
            if let [only] = choice.candidates[..] {
                return Outcome::Change(only);
            }
            choice.shift.begin(of, self.lanes, self.transforms, (strand, current));
        }
        choice.moves.clear();
        for &candidate in &choice.candidates {
            let moved = choice.shift.to(of, self.lanes, self.transforms, (strand, candidate));
            // A guide that is not finite must not keep the hair on a broken set.
            choice.moves.push(if moved.is_finite() { moved } else { f32::INFINITY });
        }
        let least = choice.moves.iter().copied().fold(f32::INFINITY, f32::min);
        if held_off.is_some_and(|by| least + self.params.leave_gain_cm >= by) {
            return Outcome::Wanting;
        }
        let near = choice.candidates.iter().zip(&choice.moves);
        let error = |set: u16| sets.rms_error_cm[usize::from(set)];
        let mut best: Option<u16> = None;
        for (&set, &moved) in near {
            if moved <= least + self.params.cost_tolerance_cm && best.is_none_or(|b| error(set) < error(b)) {
                best = Some(set);
            }
        }
        best.map_or(Outcome::Content, Outcome::Change)
    }
}
