//! Cliques of the guide graph (AS16 Algorithm 1, lines 1–15): one grown around every guide.
//!
//! The algorithm removes, of any two neighbours that are not connected, the one whose motion differs more from the guide
//! the clique grows around. Taking neighbours in order of that difference and keeping each that is connected to all kept
//! before it is the same removal, done nearest first.

use crate::graph::GuideGraph;
use rayon::prelude::*;

/// One clique per guide, as bit rows over guides; buffers are kept from step to step.
#[derive(Clone, Debug)]
pub struct Clusters {
    words: usize,
    members: Vec<u64>,
    /// Per guide, candidate neighbours sorted by motion distance.
    order: Vec<Vec<(f32, u16)>>,
}

impl Clusters {
    pub(crate) fn new(graph: &GuideGraph) -> Self {
        let n = graph.n_guides();
        let words = n.div_ceil(64);
        let order = (0..n).map(|g| Vec::with_capacity(graph.candidates(g).len())).collect();
        Self { words, members: vec![0; n * words], order }
    }

    /// Cliques.
    #[must_use]
    pub fn n(&self) -> usize {
        self.order.len()
    }

    /// Whether `guide` is in the clique grown around `center`.
    #[must_use]
    pub fn contains(&self, center: usize, guide: usize) -> bool {
        self.members[center * self.words + guide / 64] >> (guide % 64) & 1 == 1
    }

    /// Guides in the clique grown around `center`.
    pub fn members(&self, center: usize) -> impl Iterator<Item = usize> + '_ {
        (0..self.n()).filter(move |&g| self.contains(center, g))
    }

    /// Grows all cliques anew.
    /// Implements AS16 Algorithm 1 lines 1-15.
    pub(crate) fn update(&mut self, graph: &GuideGraph) {
        let words = self.words;
        if words == 0 {
            return;
        }
        self.members.par_chunks_mut(words).zip(self.order.par_iter_mut()).enumerate().for_each(
            |(center, (members, order))| {
                order.clear();
                order.extend(
                    graph
                        .candidates(center)
                        .iter()
                        .filter(|&&(g, _)| graph.has_edge(center, usize::from(g)))
                        .map(|&(g, pair)| (graph.pair_distance(pair), g)),
                );
                order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                members.fill(0);
                members[center / 64] |= 1 << (center % 64);
                let mut kept = 0;
                for k in 0..order.len() {
                    let guide = usize::from(order[k].1);
                    if order[..kept].iter().all(|&(_, other)| graph.has_edge(guide, usize::from(other))) {
                        members[guide / 64] |= 1 << (guide % 64);
                        order[kept] = order[k];
                        kept += 1;
                    }
                }
            },
        );
    }
}
