//! The guide graph (AS16 §4.1–4.3): an edge where two guides move alike and nothing stands between them.
//!
//! Only pairs that are eligible together for some hair need an edge. Motion is compared in the head frame, so a fast turn
//! of the whole head disconnects nothing, with a second, larger threshold for letting go. An update tells which edges
//! changed, of those pairs alone that some hair asks for; what the interpolation check knows is kept from step to step ([`gap`]), its decisions are those of testing
//! every ribbon anew, unless that is spread over several steps.

mod gap;
mod similarity;
#[cfg(test)]
mod tests;

use crate::params::EdgeDistance;
use collision::MovingSolid;
use gap::GapCheck;
use io_formats::skinning_model::SkinningModel;
use nalgebra::Vector3;
use rayon::prelude::*;
use similarity::{PackedMotion, tip_distance};

/// Pairs decided together, one bit each in a word of flips.
const BLOCK: usize = 64;

/// Edges between guides, with the motion distance of every pair that may have one.
#[derive(Clone, Debug)]
pub struct GuideGraph {
    n_guides: usize,
    words: usize,
    /// `words` per guide: bit j of guide i's row.
    adjacency: Vec<u64>,
    /// Candidate neighbours in CSR form, ascending: (guide, index into `distance`).
    neighbour_start: Vec<u32>,
    neighbours: Vec<(u16, u32)>,
    /// How far apart each pair of the model is, as the rule measures it; that of a pair blocked by a solid is an old one.
    distance: Vec<f32>,
    connected: Vec<bool>,
    n_connected: usize,
    /// Pairs of each block of [`BLOCK`] that changed in the last update, as bits and as a list.
    changed: Vec<u64>,
    flipped: Vec<u32>,
    /// Pairs of each block that the next update is to decide, and that the last one did, as bits.
    asked: Vec<u64>,
    asked_before: Vec<u64>,
    packed: PackedMotion,
    gap: GapCheck,
    n_updates: u64,
}

/// What an edge needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EdgeRule {
    pub similarity: bool,
    pub distance: EdgeDistance,
    pub avoidance: bool,
    /// Resolution of the interpolation check as a multiple of a solid's least half-thickness.
    pub gap_resolution: f32,
    /// Steps between full looks at a pair that is neither surely free nor surely blocked; pairs take turns.
    pub gap_period: u32,
}

/// Positions and velocities of all guides, guide-major, `n_particles` each.
pub(crate) struct GuideMotion<'a> {
    pub n_particles: usize,
    /// cm, head frame.
    pub position_in_head: &'a [[f32; 3]],
    /// cm/s, head frame.
    pub velocity_in_head: &'a [[f32; 3]],
    /// For each solid the guides' positions in its frame at the end of the step, cm.
    pub position_in_solids: &'a [Vec<Vector3<f32>>],
}

impl GuideGraph {
    pub(crate) fn new(model: &SkinningModel) -> Self {
        let n_guides = model.n_guides();
        let words = n_guides.div_ceil(64);
        let mut lists: Vec<Vec<(u16, u32)>> = vec![Vec::new(); n_guides];
        for (k, &[i, j]) in model.pairs.iter().enumerate() {
            lists[usize::from(i)].push((j, k as u32));
            lists[usize::from(j)].push((i, k as u32));
        }
        let mut neighbour_start = vec![0];
        let mut neighbours = Vec::new();
        for mut list in lists {
            list.sort_unstable();
            neighbours.extend(list);
            neighbour_start.push(neighbours.len() as u32);
        }
        let mut graph = Self {
            n_guides,
            words,
            adjacency: vec![0; n_guides * words],
            neighbour_start,
            neighbours,
            distance: vec![0.0; model.pairs.len()],
            connected: vec![true; model.pairs.len()],
            n_connected: model.pairs.len(),
            changed: vec![0; model.pairs.len().div_ceil(BLOCK)],
            flipped: Vec::with_capacity(model.pairs.len()),
            asked: vec![!0; model.pairs.len().div_ceil(BLOCK)],
            asked_before: vec![0; model.pairs.len().div_ceil(BLOCK)],
            packed: PackedMotion::default(),
            gap: GapCheck::default(),
            n_updates: 0,
        };
        model.pairs.iter().for_each(|&pair| graph.toggle(pair));
        graph
    }

    /// Guides.
    #[must_use]
    pub fn n_guides(&self) -> usize {
        self.n_guides
    }

    /// Whether the guides may be blended.
    #[must_use]
    pub fn has_edge(&self, i: usize, j: usize) -> bool {
        self.adjacency[i * self.words + j / 64] >> (j % 64) & 1 == 1
    }

    /// Has the next update, and any after it, decide every pair.
    pub(crate) fn ask_all(&mut self) {
        self.asked.fill(!0);
    }

    /// Has the next update decide none, but those asked for with [`Self::ask_among`] from now on: others keep what they are.
    pub(crate) fn ask_none(&mut self) {
        self.asked.fill(0);
    }

    /// Has the next update decide the pairs among some guides, ascending.
    pub(crate) fn ask_among(&mut self, guides: &[u16]) {
        for (k, &i) in guides.iter().enumerate() {
            let of = self.neighbour_start[usize::from(i)] as usize..self.neighbour_start[usize::from(i) + 1] as usize;
            let neighbours = &self.neighbours[of];
            for &j in &guides[k + 1..] {
                if let Ok(at) = neighbours.binary_search_by_key(&j, |&(guide, _)| guide) {
                    let pair = neighbours[at].1 as usize;
                    self.asked[pair / BLOCK] |= 1 << (pair % BLOCK);
                }
            }
        }
    }

    /// Share of candidate pairs that are connected, each as it was when last decided.
    #[must_use]
    pub fn connectivity(&self) -> f64 {
        if self.connected.is_empty() {
            return 1.0;
        }
        self.n_connected as f64 / self.connected.len() as f64
    }

    /// Pairs whose edge appeared or vanished in the last update, as indices into the model's pairs, ascending.
    #[must_use]
    pub fn flipped(&self) -> &[u32] {
        &self.flipped
    }

    /// Whether a pair of the model, by its index, is connected.
    #[must_use]
    pub fn is_connected(&self, pair: u32) -> bool {
        self.connected[pair as usize]
    }

    /// Guides that may ever share an edge with `guide`, with the pair's index.
    pub(crate) fn candidates(&self, guide: usize) -> &[(u16, u32)] {
        &self.neighbours[self.neighbour_start[guide] as usize..self.neighbour_start[guide + 1] as usize]
    }

    pub(crate) fn pair_distance(&self, pair: u32) -> f32 {
        self.distance[pair as usize]
    }

    fn toggle(&mut self, [i, j]: [u16; 2]) {
        let (i, j) = (usize::from(i), usize::from(j));
        self.adjacency[i * self.words + j / 64] ^= 1 << (j % 64);
        self.adjacency[j * self.words + i / 64] ^= 1 << (i % 64);
    }

    /// Decides anew every edge that is asked for, for the guides' current motion.
    pub(crate) fn update(
        &mut self,
        model: &SkinningModel,
        motion: &GuideMotion,
        solids: &[MovingSolid],
        rule: EdgeRule,
    ) {
        let update = self.n_updates;
        self.n_updates += 1;
        let solids = if rule.avoidance { solids } else { &[] };
        self.packed.pack(motion);
        let packed = &self.packed;
        let (gap, known, expiry) = self.gap.begin(model.pairs.len(), motion, solids, rule.gap_resolution);
        let [n_known, n_expiry] = gap.strides();
        // Chunks of nothing do not count, so no solid has one of a single, unused value.
        let kept = known.par_chunks_mut((BLOCK * n_known).max(1)).zip(expiry.par_chunks_mut((BLOCK * n_expiry).max(1)));
        let blocks = self
            .changed
            .par_iter_mut()
            .zip(self.distance.par_chunks_mut(BLOCK))
            .zip(self.connected.par_chunks_mut(BLOCK))
            .enumerate();
        let (asked, asked_before) = (&self.asked, &self.asked_before);
        let decide = |block: usize,
                      changed: &mut u64,
                      distance: &mut [f32],
                      connected: &mut [bool],
                      known: &mut [gap::Known],
                      expiry: &mut [f32]| {
            *changed = 0;
            for (k, (distance, connected)) in distance.iter_mut().zip(connected).enumerate() {
                let pair = model.pairs[block * BLOCK + k];
                let known = &mut known[k * n_known..(k + 1) * n_known];
                let expiry = &mut expiry[k * n_expiry..(k + 1) * n_expiry];
                gap.count(pair, known, expiry);
                if asked[block] >> k & 1 == 0 {
                    continue;
                }
                // What was found before others alone were asked for may be long ago.
                let is_turn = asked_before[block] >> k & 1 == 0
                    || (update + (block * BLOCK + k) as u64).is_multiple_of(u64::from(rule.gap_period));
                // The check first: most pairs it settles in less time than their distance takes.
                let now = gap.is_free(pair, known, expiry, is_turn) && {
                    *distance = measure(model, block * BLOCK + k, packed, motion, rule.distance);
                    is_similar(model, *distance, *connected, rule)
                };
                *changed |= u64::from(now != *connected) << k;
                *connected = now;
            }
        };
        if n_known == 0 {
            blocks.for_each(|(block, ((changed, distance), connected))| {
                decide(block, changed, distance, connected, &mut [], &mut []);
            });
        } else {
            blocks.zip(kept).for_each(|((block, ((changed, distance), connected)), (known, expiry))| {
                decide(block, changed, distance, connected, known, expiry);
            });
        }
        self.asked_before.copy_from_slice(&self.asked);
        self.flipped.clear();
        for block in 0..self.changed.len() {
            let mut bits = self.changed[block];
            while bits != 0 {
                self.flipped.push((block * BLOCK) as u32 + bits.trailing_zeros());
                bits &= bits - 1;
            }
        }
        for at in 0..self.flipped.len() {
            let pair = self.flipped[at] as usize;
            self.toggle(model.pairs[pair]);
            if self.connected[pair] {
                self.n_connected += 1;
            } else {
                self.n_connected -= 1;
            }
        }
    }
}

#[cfg(test)]
impl GuideGraph {
    /// Makes the edges those given, as an update would.
    pub(crate) fn set_edges(&mut self, model: &SkinningModel, edges: &[bool]) {
        self.flipped.clear();
        self.flipped.extend((0..edges.len()).filter(|&k| edges[k] != self.connected[k]).map(|k| k as u32));
        for at in 0..self.flipped.len() {
            self.toggle(model.pairs[self.flipped[at] as usize]);
        }
        self.connected.copy_from_slice(edges);
        self.n_connected = edges.iter().filter(|&&e| e).count();
    }
}

fn measure(model: &SkinningModel, pair: usize, packed: &PackedMotion, motion: &GuideMotion, rule: EdgeDistance) -> f32 {
    let [i, j] = model.pairs[pair].map(usize::from);
    match rule {
        EdgeDistance::Motion => {
            packed.distance(i, j, [model.position_scale[pair], model.velocity_scale[pair]], model.velocity_weight)
        }
        EdgeDistance::Tips { .. } => tip_distance(motion, i, j),
    }
}

fn is_similar(model: &SkinningModel, distance: f32, connected: bool, rule: EdgeRule) -> bool {
    let limit = match rule.distance {
        EdgeDistance::Motion if connected => model.release_distance,
        EdgeDistance::Motion => model.max_distance,
        EdgeDistance::Tips { d_max_cm } => d_max_cm,
    };
    !rule.similarity || distance < limit
}
