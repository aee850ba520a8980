//! Cliques of the guide graph among one hair's eligible guides: exact, since there are at most nine.
//!
//! A departure from AS16 Algorithm 1, which grows one clique per guide of the whole head greedily and lets a hair have its share
//! of each: what matters to a hair is only the graph among its own guides, and there all maximal cliques are found at once
//! (docs/DEVIATIONS.md).

use crate::graph::GuideGraph;
use io_formats::skinning_model::MAX_ELIGIBLE;

/// The graph among a hair's eligible guides: bit b of row a says that guides a and b may be blended; a row has its own bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LocalGraph {
    rows: [u16; MAX_ELIGIBLE],
    n: usize,
}

impl LocalGraph {
    /// The part of `graph` between the guides in `eligible`.
    pub fn of(graph: &GuideGraph, eligible: &[u16]) -> Self {
        Self::from_edges(eligible.len(), |a, b| graph.has_edge(usize::from(eligible[a]), usize::from(eligible[b])))
    }

    fn from_edges(n: usize, has_edge: impl Fn(usize, usize) -> bool) -> Self {
        let mut rows = [0; MAX_ELIGIBLE];
        for a in 0..n {
            rows[a] |= 1 << a;
            for b in 0..a {
                let edge = u16::from(has_edge(a, b));
                rows[a] |= edge << b;
                rows[b] |= edge << a;
            }
        }
        Self { rows, n }
    }

    /// Whether all guides of a mask may be blended with one another.
    pub fn is_clique(&self, mask: u16) -> bool {
        bits(mask).all(|b| mask & !self.rows[b] == 0)
    }

    /// Calls `sink` with every clique that no other guide can join, each once, in a fixed order.
    pub fn maximal_cliques(&self, mut sink: impl FnMut(u16)) {
        self.extend(0, (1 << self.n) - 1, 0, &mut sink);
    }

    /// Bron and Kerbosch's search with a pivot: `clique` is to grow by `candidates`; what `done` holds was tried before.
    fn extend(&self, clique: u16, mut candidates: u16, mut done: u16, sink: &mut impl FnMut(u16)) {
        if candidates == 0 {
            if done == 0 {
                sink(clique);
            }
            return;
        }
        let neighbours = |b: usize| self.rows[b] & !(1 << b);
        let Some(pivot) = bits(candidates | done).max_by_key(|&b| (candidates & neighbours(b)).count_ones()) else {
            return;
        };
        for b in bits(candidates & !neighbours(pivot)) {
            self.extend(clique | 1 << b, candidates & neighbours(b), done & neighbours(b), sink);
            candidates &= !(1 << b);
            done |= 1 << b;
        }
    }
}

/// Indices of the bits that are set, ascending.
pub(super) fn bits(mut mask: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = mask.trailing_zeros() as usize;
        (mask != 0).then(|| {
            mask &= mask - 1;
            bit
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A graph whose edges are the bits of a number mixed from `seed`.
    fn graph(n: usize, seed: u64) -> LocalGraph {
        let mixed = (seed + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let edges = mixed ^ mixed >> 29;
        // Denser and sparser ones in turn.
        let edges = if seed.is_multiple_of(2) { edges | edges.rotate_left(17) } else { edges };
        LocalGraph::from_edges(n, |a, b| edges >> ((a * (a - 1) / 2 + b) % 64) & 1 == 1)
    }

    #[test]
    fn maximal_cliques_are_those_found_by_trying_all_masks() {
        let mut seen = [0; 12];
        for n in 1..=MAX_ELIGIBLE {
            for seed in 0..400 {
                let graph = graph(n, seed);
                let full = (1u16 << n) - 1;
                let plain = |mask: u16| {
                    (0..n).all(|a| {
                        (0..n).all(|b| mask >> a & 1 == 0 || mask >> b & 1 == 0 || graph.rows[a] >> b & 1 == 1)
                    })
                };
                let cliques: Vec<u16> = (1..=full).filter(|&m| plain(m)).collect();
                assert!((1..=full).all(|m| graph.is_clique(m) == plain(m)));
                let mut expected: Vec<u16> =
                    cliques.iter().copied().filter(|&m| !cliques.iter().any(|&c| c != m && c & m == m)).collect();
                let mut found = Vec::new();
                graph.maximal_cliques(|m| found.push(m));
                found.sort_unstable();
                expected.sort_unstable();
                assert_eq!(found, expected);
                seen[found.len().min(11)] += 1;
            }
        }
        assert!(seen[1] > 50 && seen[2..8].iter().all(|&n| n > 50), "graphs too much alike: {seen:?}");
    }
}
