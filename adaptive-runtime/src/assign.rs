//! Choice of a guide set for each hair (AS16 §4.3), on masks over its at most nine eligible guides.
//!
//! A set whose members no longer form a clique is left for the candidate that moves the hair least. AS16 Eq. (3) to the
//! letter then never leaves a set while it is a clique, so hairs drift to single guides for good; here a set also grows
//! back, to one that trained better and moves the hair little (docs/DEVIATIONS.md). Either way the jump is handed to the
//! residual, which fades it out.

use crate::clusters::Clusters;
use crate::graph::GuideGraph;
use crate::interpolate::{ActiveSet, TransformArrays};
use crate::params::AssignParams;
use io_formats::skinning_model::{MAX_ELIGIBLE, SkinningModel};

/// Buffers of one worker.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scratch {
    /// The hair carried rigidly by each eligible guide, `n_particles` each, head frame.
    carried: Vec<[f32; 3]>,
    current: Vec<[f32; 3]>,
    masks: Vec<u16>,
}

/// Set of a hair within its kept sets when all its guides may be used: the best-trained one.
pub(crate) fn best_set(model: &SkinningModel, strand: usize) -> u16 {
    let sets = model.sets_of(strand);
    sets.stand_in[sets.stand_in.len() - 1]
}

/// Decodes a hair's kept set for interpolation.
pub(crate) fn decode(model: &SkinningModel, strand: usize, set: u16) -> ActiveSet {
    let eligible = model.eligible_of(strand);
    let first = model.set_start[strand] as usize;
    let mask = model.set_mask[first + usize::from(set)];
    let mut out = ActiveSet::EMPTY;
    let bits = (0..eligible.len()).filter(|b| mask >> b & 1 == 1);
    for (slot, (bit, weights)) in bits.zip(model.weights_of_set(first + usize::from(set))).enumerate() {
        out.guides[slot] = eligible[bit];
        out.weights[slot] = weights;
        out.n = slot as u8 + 1;
    }
    out
}

/// The set a hair should use from now on, or `None` to keep the current one.
/// Implements AS16 Algorithm 1 lines 16-23 and Eq. (3), states compared by position.
pub(crate) fn choose(
    model: &SkinningModel,
    strand: usize,
    current: u16,
    graph: &GuideGraph,
    clusters: &Clusters,
    transforms: &TransformArrays,
    params: &AssignParams,
    may_grow: bool,
    scratch: &mut Scratch,
) -> Option<u16> {
    let sets = model.sets_of(strand);
    let eligible = model.eligible_of(strand);
    let current_mask = sets.masks[usize::from(current)];
    let holds = is_clique(current_mask, eligible, graph);
    if holds && (!may_grow || params.growth_tolerance_cm < 0.0 || current == sets.stand_in[sets.stand_in.len() - 1]) {
        return None;
    }
    collect_masks(eligible, graph, clusters, &mut scratch.masks);
    if holds {
        // Growing back: only cliques that contain the current set, and of each only its best-trained set.
        let trained = sets.rms_error_cm[usize::from(current)];
        let mut best: Option<(f32, u16)> = None;
        for &mask in scratch.masks.iter().filter(|&&m| m & current_mask == current_mask) {
            let candidate = sets.stand_in[usize::from(mask) - 1];
            let error = sets.rms_error_cm[usize::from(candidate)];
            if error < best.map_or(trained, |(e, _)| e) {
                best = Some((error, candidate));
            }
        }
        let (_, candidate) = best?;
        carry_by_all(model, strand, transforms, scratch);
        blend(model, strand, current, scratch);
        let shift = shift_cm(model, strand, candidate, scratch);
        return (shift <= params.growth_tolerance_cm).then_some(candidate);
    }
    carry_by_all(model, strand, transforms, scratch);
    blend(model, strand, current, scratch);
    let allowed = |mask: u16, masks: &[u16]| masks.iter().any(|m| m & mask == mask);
    let mut least = f32::INFINITY;
    for (k, &mask) in sets.masks.iter().enumerate() {
        if allowed(mask, &scratch.masks) {
            least = least.min(shift_cm(model, strand, k as u16, scratch));
        }
    }
    let mut best: Option<(f32, u16)> = None;
    for (k, &mask) in sets.masks.iter().enumerate() {
        let error = sets.rms_error_cm[k];
        if allowed(mask, &scratch.masks)
            && best.is_none_or(|(e, _)| error < e)
            && shift_cm(model, strand, k as u16, scratch) <= least + params.cost_tolerance_cm
        {
            best = Some((error, k as u16));
        }
    }
    best.map(|(_, k)| k)
}

fn is_clique(mask: u16, eligible: &[u16], graph: &GuideGraph) -> bool {
    let of = |bit: usize| usize::from(eligible[bit]);
    (0..eligible.len())
        .filter(|a| mask >> a & 1 == 1)
        .all(|a| (0..a).filter(|b| mask >> b & 1 == 1).all(|b| graph.has_edge(of(a), of(b))))
}

/// The hair's share of every cluster: distinct masks over its eligible guides, ascending.
fn collect_masks(eligible: &[u16], graph: &GuideGraph, clusters: &Clusters, masks: &mut Vec<u16>) {
    masks.clear();
    for &e in eligible {
        let e = usize::from(e);
        // A cluster holding this guide grew around it or around one that may be its neighbour.
        for center in std::iter::once(e).chain(graph.candidates(e).iter().map(|&(g, _)| usize::from(g))) {
            if clusters.contains(center, e) {
                let mask = eligible
                    .iter()
                    .enumerate()
                    .filter(|&(_, &g)| clusters.contains(center, usize::from(g)))
                    .fold(0, |m, (b, _)| m | 1 << b);
                masks.push(mask);
            }
        }
    }
    masks.sort_unstable();
    masks.dedup();
}

fn carry_by_all(model: &SkinningModel, strand: usize, transforms: &TransformArrays, scratch: &mut Scratch) {
    let rest = model.rest_of(strand);
    let pad = transforms.pad;
    scratch.carried.clear();
    for &guide in model.eligible_of(strand) {
        let t = transforms.of_guide(usize::from(guide));
        for (i, r) in rest.iter().enumerate() {
            let at = |k: usize| t[k * pad + i];
            scratch.carried.push(std::array::from_fn(|c| {
                r[c] + (at(3 * c) * r[0] + at(3 * c + 1) * r[1] + at(3 * c + 2) * r[2] + at(9 + c))
            }));
        }
    }
}

fn blend(model: &SkinningModel, strand: usize, set: u16, scratch: &mut Scratch) {
    let n = model.n_particles as usize;
    let mut current = std::mem::take(&mut scratch.current);
    current.clear();
    current.resize(n, [0.0; 3]);
    blend_into(model, strand, set, &scratch.carried, |i, p| current[i] = p);
    scratch.current = current;
}

/// RMS distance between the hair under `set` and under the current one, cm: the cost of AS16 Eq. (3).
fn shift_cm(model: &SkinningModel, strand: usize, set: u16, scratch: &Scratch) -> f32 {
    let mut sum = 0.0;
    blend_into(model, strand, set, &scratch.carried, |i, p| {
        let q = scratch.current[i];
        sum += (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2) + (p[2] - q[2]).powi(2);
    });
    (sum / model.n_particles as f32).sqrt()
}

fn blend_into(
    model: &SkinningModel,
    strand: usize,
    set: u16,
    carried: &[[f32; 3]],
    mut sink: impl FnMut(usize, [f32; 3]),
) {
    let n = model.n_particles as usize;
    let first = model.set_start[strand] as usize;
    let mask = model.set_mask[first + usize::from(set)];
    let active = decode(model, strand, set);
    let mut bits = [0; MAX_ELIGIBLE];
    for (slot, bit) in (0..MAX_ELIGIBLE).filter(|b| mask >> b & 1 == 1).enumerate() {
        bits[slot] = bit;
    }
    for i in 0..n {
        let weights = active.weights_at(i as f32 / (n - 1) as f32);
        let mut p = [0.0; 3];
        for slot in 0..usize::from(active.n) {
            let c = carried[bits[slot] * n + i];
            for k in 0..3 {
                p[k] += weights[slot] * c[k];
            }
        }
        sink(i, p);
    }
}
