//! From atoms to guides: for each atom the strand whose signal is nearest, AS16 Eq. (10).
//!
//! Atoms are bounded by the unit ball, signals are not, so each atom is first given the length of the signals that use
//! it, or the match would favour short hair. Two atoms may choose the same strand; the later one then takes its next
//! nearest, so that exactly as many distinct guides result as there are atoms.

use rayon::prelude::*;

use super::sparse_coding::Dictionary;
use super::vectors::dot;
use crate::reduce::Signals;

/// Strands searched by one task; the best of each are compared in order.
const BLOCK: usize = 1024;

/// The strands that serve as guides, ascending: one for each atom, all distinct.
/// Implements AS16 Eq. (10), after rescaling each atom. Atoms choose in order of use, the most used one first; of equally
/// near strands the first.
#[must_use]
pub fn nearest_strands(signals: &Signals, dictionary: &Dictionary) -> Vec<u32> {
    let (rank, n) = (signals.rank, dictionary.n_atoms);
    let scales = atom_scales(signals, dictionary);
    let mut use_of_atom = vec![0.0; n];
    dictionary.codes.iter().flatten().for_each(|&(j, a)| use_of_atom[j as usize] += a.abs());
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| use_of_atom[b].total_cmp(&use_of_atom[a]).then(a.cmp(&b)));

    let mut taken = vec![false; signals.n_strands()];
    let mut guides = Vec::with_capacity(n);
    for j in order {
        let atom: Vec<f64> = dictionary.atoms[j * rank..(j + 1) * rank].iter().map(|x| scales[j] * x).collect();
        if let Some(strand) = nearest_free(signals, &atom, &taken) {
            taken[strand] = true;
            guides.push(strand as u32);
        }
    }
    guides.sort_unstable();
    guides
}

/// Per atom, the factor that brings it nearest, in the least-squares sense, to the signals using it. Each counts by the
/// square of its code: a signal that hardly uses an atom says little about it. A negative factor turns the atom round.
fn atom_scales(signals: &Signals, dictionary: &Dictionary) -> Vec<f64> {
    let (rank, n) = (signals.rank, dictionary.n_atoms);
    let (mut along, mut weight) = (vec![0.0; n], vec![0.0; n]);
    for (s, code) in dictionary.codes.iter().enumerate() {
        for &(j, a) in code {
            let j = j as usize;
            along[j] += a * a * dot(signals.of(s), &dictionary.atoms[j * rank..(j + 1) * rank]);
            weight[j] += a * a;
        }
    }
    (0..n)
        .map(|j| {
            let atom = &dictionary.atoms[j * rank..(j + 1) * rank];
            let squared = weight[j] * dot(atom, atom);
            if squared > 0.0 { along[j] / squared } else { 1.0 }
        })
        .collect()
}

/// The strand nearest to `target` among those not taken.
fn nearest_free(signals: &Signals, target: &[f64], taken: &[bool]) -> Option<usize> {
    let best_of_blocks: Vec<Option<(f64, usize)>> = taken
        .par_chunks(BLOCK)
        .enumerate()
        .map(|(block, taken)| {
            let mut best: Option<(f64, usize)> = None;
            for (at, _) in taken.iter().enumerate().filter(|(_, taken)| !**taken) {
                let strand = block * BLOCK + at;
                let distance = squared_distance(signals.of(strand), target);
                if best.is_none_or(|(d, _)| distance < d) {
                    best = Some((distance, strand));
                }
            }
            best
        })
        .collect();
    let mut best: Option<(f64, usize)> = None;
    for (distance, strand) in best_of_blocks.into_iter().flatten() {
        if best.is_none_or(|(d, _)| distance < d) {
            best = Some((distance, strand));
        }
    }
    best.map(|(_, strand)| strand)
}

pub(crate) fn squared_distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn signals(points: &[[f64; 2]]) -> Signals {
        Signals { rank: 2, coords: points.concat(), scale: 1.0, lost_energy: 0.0 }
    }

    #[test]
    fn atoms_of_unit_length_find_the_long_signals_that_use_them() {
        let signals = signals(&[[1.0, 0.1], [3.0, 0.0], [0.1, 1.0], [0.0, 2.0], [0.0, 2.1]]);
        let dictionary = Dictionary {
            atoms: vec![1.0, 0.0, 0.0, 1.0],
            n_atoms: 2,
            codes: vec![vec![(0, 0.1)], vec![(0, 2.9)], vec![], vec![(1, 1.9)], vec![(1, 2.0)]],
            objective: vec![],
            n_stopped: 0,
        };
        assert_eq!(nearest_strands(&signals, &dictionary), [1, 4]);
    }

    #[test]
    fn atoms_that_agree_still_give_distinct_guides() {
        let signals = signals(&[[1.0, 0.0], [0.9, 0.0], [0.0, 1.0], [0.5, 0.5]]);
        let dictionary = Dictionary {
            atoms: [[1.0, 0.0]; 3].concat(),
            n_atoms: 3,
            codes: vec![vec![]; 4],
            objective: vec![],
            n_stopped: 0,
        };
        assert_eq!(nearest_strands(&signals, &dictionary), [0, 1, 3]);
    }
}
