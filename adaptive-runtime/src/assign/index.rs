//! Which hairs an edge of the guide graph concerns: those that both of its guides are eligible for.

use super::cliques::bits;
use io_formats::skinning_model::SkinningModel;

/// From each pair of the model to its hairs, in CSR form.
#[derive(Clone, Debug)]
pub(super) struct PairIndex {
    start: Vec<u32>,
    /// Ascending for each pair.
    strand: Vec<u32>,
    /// The pair's two bits in the strand's masks.
    both: Vec<u16>,
}

impl PairIndex {
    pub fn new(model: &SkinningModel) -> Self {
        let mut start = vec![0u32; model.pairs.len() + 1];
        for_each(model, |pair, _, _| start[pair + 1] += 1);
        for pair in 0..model.pairs.len() {
            start[pair + 1] += start[pair];
        }
        let n = start[model.pairs.len()] as usize;
        let (mut strand, mut both) = (vec![0; n], vec![0; n]);
        let mut next = start.clone();
        for_each(model, |pair, s, mask| {
            let at = next[pair] as usize;
            (strand[at], both[at]) = (s, mask);
            next[pair] += 1;
        });
        Self { start, strand, both }
    }

    /// Hairs of a pair, ascending, each with the pair's bits in its masks.
    pub fn strands_of(&self, pair: u32) -> impl Iterator<Item = (u32, u16)> + '_ {
        let of = self.start[pair as usize] as usize..self.start[pair as usize + 1] as usize;
        self.strand[of.clone()].iter().copied().zip(self.both[of].iter().copied())
    }
}

/// Calls `sink` with (pair, strand, bits) for all pairs of all strands, by strand. A pair that the model leaves out has no edge that
/// could change.
fn for_each(model: &SkinningModel, mut sink: impl FnMut(usize, u32, u16)) {
    for s in 0..model.n_strands {
        let eligible = model.eligible_of(s as usize);
        for a in bits((1 << eligible.len()) - 1) {
            for b in 0..a {
                // Ascending, as the model's pairs are.
                if let Ok(pair) = model.pairs.binary_search(&[eligible[b], eligible[a]]) {
                    sink(pair, s, 1 << a | 1 << b);
                }
            }
        }
    }
}
