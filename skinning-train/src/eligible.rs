//! The eligible guides of every strand: AS16 §6.3, last step.
//!
//! Eq. (9) is solved once more with the guides' own signals as dictionary, codes not negative, since skinning weights are
//! not. Guides whose coefficient reaches the threshold are eligible, the largest first when there are too many; where
//! there are too few, the guides nearest in motion join. A guide is eligible for itself alone: it is simulated, not
//! interpolated.

use serde::{Deserialize, Serialize};

use crate::guide_select::nearest::squared_distance;
use crate::guide_select::sparse_coding::code_signals;
use crate::reduce::Signals;

/// Eligible guides of all strands, in CSR form.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Eligible {
    /// `n_strands + 1` offsets into `guides`.
    pub start: Vec<u32>,
    /// Guide ids, ascending within a strand.
    pub guides: Vec<u16>,
}

/// How many guides a strand gets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EligibleParams {
    /// β of AS16 Eq. (9).
    pub sparsity: f64,
    /// ε of AS16 §6.3: coefficients below it do not count.
    pub min_weight: f64,
    /// Guides a strand gets at least, as far as there are so many.
    pub min_guides: usize,
    /// Guides a strand gets at most.
    pub max_guides: usize,
}

impl Eligible {
    /// Number of strands.
    #[must_use]
    pub fn n_strands(&self) -> usize {
        self.start.len() - 1
    }

    /// Guide ids of one strand, ascending.
    ///
    /// # Panics
    /// If there is no such strand.
    #[must_use]
    pub fn of(&self, strand: usize) -> &[u16] {
        &self.guides[self.start[strand] as usize..self.start[strand + 1] as usize]
    }

    /// Guide pairs i < j that are eligible together for some strand, sorted.
    #[must_use]
    pub fn pairs(&self) -> Vec<[u16; 2]> {
        let mut pairs = Vec::new();
        for strand in 0..self.n_strands() {
            let guides = self.of(strand);
            for (at, &i) in guides.iter().enumerate() {
                pairs.extend(guides[at + 1..].iter().map(|&j| [i, j]));
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    }
}

/// Chooses the eligible guides of every strand. `guide_strands` holds the strand of each guide, all distinct.
///
/// # Panics
/// If a guide strand does not exist.
#[must_use]
pub fn choose_eligible(signals: &Signals, guide_strands: &[u32], params: &EligibleParams) -> Eligible {
    let atoms: Vec<f64> = guide_strands.iter().flat_map(|&s| signals.of(s as usize)).copied().collect();
    let (codes, _) = code_signals(signals, &atoms, params.sparsity, true);
    let mut guide_of_strand = vec![None; signals.n_strands()];
    for (guide, &strand) in guide_strands.iter().enumerate() {
        guide_of_strand[strand as usize] = Some(guide as u16);
    }
    let mut eligible = Eligible { start: vec![0], guides: Vec::new() };
    for (strand, code) in codes.iter().enumerate() {
        let mut chosen = match guide_of_strand[strand] {
            Some(itself) => vec![itself],
            None => {
                let mut chosen = strongest(code, params);
                if chosen.len() < params.min_guides {
                    fill_with_nearest(&mut chosen, signals.of(strand), &atoms, params.min_guides);
                }
                chosen
            }
        };
        chosen.sort_unstable();
        eligible.guides.extend(chosen);
        eligible.start.push(eligible.guides.len() as u32);
    }
    eligible
}

/// Guides whose coefficient reaches the threshold, at most as many as allowed, the largest coefficients first.
fn strongest(code: &[(u32, f64)], params: &EligibleParams) -> Vec<u16> {
    let mut kept: Vec<(u32, f64)> = code.iter().copied().filter(|&(_, a)| a >= params.min_weight).collect();
    kept.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    kept.iter().take(params.max_guides).map(|&(j, _)| j as u16).collect()
}

fn fill_with_nearest(chosen: &mut Vec<u16>, signal: &[f64], atoms: &[f64], wanted: usize) {
    let mut others: Vec<(f64, u16)> = atoms
        .chunks_exact(signal.len())
        .enumerate()
        .map(|(j, atom)| (squared_distance(signal, atom), j as u16))
        .filter(|(_, j)| !chosen.contains(j))
        .collect();
    others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let missing = wanted.saturating_sub(chosen.len());
    chosen.extend(others.iter().take(missing).map(|&(_, j)| j));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn params() -> EligibleParams {
        EligibleParams { sparsity: 0.15, min_weight: 0.01, min_guides: 3, max_guides: 4 }
    }

    /// Strands 0 to 5 are the guides: five axes, and one far along the first.
    fn signals() -> Signals {
        let mut coords = Vec::new();
        for axis in 0..5 {
            coords.extend((0..5).map(|c| if c == axis { 1.0 } else { 0.0 }));
        }
        coords.extend([4.0, 0.0, 0.0, 0.0, 0.0]);
        coords.extend([0.2, 0.3, 0.4, 0.5, 0.6]);
        coords.extend([0.0, 0.0, 0.95, 0.1, 0.05]);
        Signals { rank: 5, coords, scale: 1.0, lost_energy: 0.0 }
    }

    #[test]
    fn a_guide_is_eligible_for_itself_alone() {
        let eligible = choose_eligible(&signals(), &[0, 1, 2, 3, 4, 5], &params());
        for guide in 0..6 {
            assert_eq!(eligible.of(guide), [guide as u16]);
        }
    }

    #[test]
    fn the_largest_coefficients_are_kept_and_missing_ones_filled_with_the_nearest() {
        let eligible = choose_eligible(&signals(), &[0, 1, 2, 3, 4, 5], &params());
        // Five coefficients, four places: the smallest goes.
        assert_eq!(eligible.of(6), [1, 2, 3, 4]);
        // Only guides 2 and 3 survive the penalty; the next nearest signal is guide 4.
        assert_eq!(eligible.of(7), [2, 3, 4]);
        assert_eq!(eligible.pairs(), [[1, 2], [1, 3], [1, 4], [2, 3], [2, 4], [3, 4]]);
    }

    #[test]
    fn with_few_guides_every_strand_gets_them_all() {
        let eligible = choose_eligible(&signals(), &[0, 3], &params());
        assert_eq!(eligible.of(7), [0, 1]);
        assert_eq!(eligible.n_strands(), 8);
    }
}
