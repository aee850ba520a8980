//! Choice of a set to the letter of AS16 Algorithm 1: from the hair's share of every clique grown around a guide, all kept sets.

use super::cliques::bits;
use super::{Choice, Hair};
use crate::clusters::Clusters;
use crate::graph::GuideGraph;
use io_formats::skinning_model::StrandSets;

/// The set a hair whose present one is broken changes to.
/// Implements AS16 Algorithm 1 lines 16-23.
pub(super) fn choose(hair: &Hair, clusters: &Clusters, choice: &mut Choice) {
    collect_masks(hair.eligible, hair.graph, clusters, &mut choice.masks);
    choice.candidates.clear();
    for (k, &mask) in hair.sets.masks.iter().enumerate() {
        if choice.masks.iter().any(|m| m & mask == mask) {
            choice.candidates.push(k as u16);
        }
    }
}

/// The best-trained set of those that stand in for a cluster's share that contains `current`.
pub(super) fn grown(hair: &Hair, clusters: &Clusters, choice: &mut Choice, current: u16) -> Option<u16> {
    collect_masks(hair.eligible, hair.graph, clusters, &mut choice.masks);
    let containing = choice.masks.iter().copied().filter(|m| m & current == current);
    containing.map(|m| stand_in(&hair.sets, m)).min_by(|&a, &b| {
        let error = |set: u16| hair.sets.rms_error_cm[usize::from(set)];
        error(a).total_cmp(&error(b))
    })
}

fn stand_in(sets: &StrandSets, mask: u16) -> u16 {
    sets.stand_in[usize::from(mask) - 1]
}

/// The hair's share of every cluster: distinct masks over its eligible guides, ascending.
fn collect_masks(eligible: &[u16], graph: &GuideGraph, clusters: &Clusters, masks: &mut Vec<u16>) {
    masks.clear();
    for &e in eligible {
        let e = usize::from(e);
        // A cluster holding this guide grew around it or around one that may be its neighbour.
        for center in std::iter::once(e).chain(graph.candidates(e).iter().map(|&(g, _)| usize::from(g))) {
            if clusters.contains(center, e) {
                let all = (1 << eligible.len()) - 1;
                masks.push(
                    bits(all)
                        .filter(|&b| clusters.contains(center, usize::from(eligible[b])))
                        .fold(0, |m, b| m | 1 << b),
                );
            }
        }
    }
    masks.sort_unstable();
    masks.dedup();
}
