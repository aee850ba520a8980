//! What dictionary learning keeps of all codes, and how atoms follow from it (Mairal et al. 2010, Algorithm 2).
//!
//! Two sums over signals: code by code and signal by code. Each signal is in them with its latest code only.

use super::vectors::{add_scaled, combine, dot};

/// Sum of squared codes below which an atom cannot be updated.
const UNUSED: f64 = 1e-10;
/// Atoms between two matrix products of an update.
const UPDATED_AT_ONCE: usize = 32;

/// The sufficient statistics of Mairal 2010, §3.1: code by code (A, n x n) and signal by code (B, n x rank, atom-major).
pub(crate) struct Sums {
    codes: Vec<f64>,
    signals: Vec<f64>,
    rank: usize,
}

impl Sums {
    /// Sums over no signals.
    pub(crate) fn zeros(n: usize, rank: usize) -> Self {
        Self { codes: vec![0.0; n * n], signals: vec![0.0; n * rank], rank }
    }

    /// Puts a signal's new code in the place of its old one. A departure from Mairal 2010, who lets old batches fade: with
    /// all signals at hand nothing stale need stay.
    pub(crate) fn exchange(&mut self, signal: &[f64], old: &[(u32, f64)], new: &[(u32, f64)]) {
        let n = self.signals.len() / self.rank;
        for (code, sign) in [(old, -1.0), (new, 1.0)] {
            for &(j, a) in code {
                let row = &mut self.codes[j as usize * n..(j as usize + 1) * n];
                code.iter().for_each(|&(l, b)| row[l as usize] += sign * a * b);
            }
        }
        // Most atoms are in both, and both are ascending.
        let (mut old, mut new) = (old.iter().peekable(), new.iter().peekable());
        while let Some(&&(j, _)) = match (old.peek(), new.peek()) {
            (Some(o), Some(n)) => Some(if o.0 < n.0 { o } else { n }),
            (one, other) => one.or(other),
        } {
            let gone = old.next_if(|o| o.0 == j).map_or(0.0, |o| o.1);
            let come = new.next_if(|n| n.0 == j).map_or(0.0, |n| n.1);
            let at = j as usize * self.rank;
            add_scaled(&mut self.signals[at..at + self.rank], come - gone, signal);
        }
    }

    /// Drops all that is known of one atom.
    pub(crate) fn forget(&mut self, j: usize) {
        let n = self.signals.len() / self.rank;
        self.codes[j * n..(j + 1) * n].fill(0.0);
        (0..n).for_each(|l| self.codes[l * n + j] = 0.0);
        self.signals[j * self.rank..(j + 1) * self.rank].fill(0.0);
    }

    /// Block coordinate descent on the sums (Mairal 2010, Algorithm 2), one atom after the other, each projected onto the
    /// unit ball. What atoms of a block share with all atoms is one matrix product; what changed since within the block
    /// is put right one by one.
    pub(crate) fn update_atoms(&self, atoms: &mut [f64]) {
        let rank = self.rank;
        let n = atoms.len() / rank;
        let mut shared = vec![0.0; UPDATED_AT_ONCE * rank];
        let mut moved = vec![0.0; UPDATED_AT_ONCE * rank];
        for first in (0..n).step_by(UPDATED_AT_ONCE) {
            let last = (first + UPDATED_AT_ONCE).min(n);
            let shared = &mut shared[..(last - first) * rank];
            combine(shared, atoms, &self.codes[first * n..last * n], rank);
            for j in first..last {
                let at = j - first;
                let weight = self.codes[j * n + j];
                let (before, rest) = moved.split_at_mut(at * rank);
                let change = &mut rest[..rank];
                change.fill(0.0);
                if weight <= UNUSED {
                    continue;
                }
                add_scaled(change, 1.0 / weight, &self.signals[j * rank..(j + 1) * rank]);
                add_scaled(change, -1.0 / weight, &shared[at * rank..(at + 1) * rank]);
                for (l, moved) in before.chunks_exact(rank).enumerate() {
                    add_scaled(change, -self.codes[j * n + first + l] / weight, moved);
                }
                let atom = &mut atoms[j * rank..(j + 1) * rank];
                add_scaled(change, 1.0, atom);
                let length = dot(change, change).sqrt().max(1.0);
                for (x, new) in atom.iter_mut().zip(change.iter_mut()) {
                    let bounded = *new / length;
                    *new = bounded - *x;
                    *x = bounded;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::guide_select::vectors::unit;

    /// Of sums of some hundred products near one.
    const ROUND_OFF: f64 = 1e-12;

    fn signals(rng: &mut Pcg64Mcg, n: usize, rank: usize) -> Vec<Vec<f64>> {
        (0..n).map(|_| (0..rank).map(|_| rng.random_range(-1.0..1.0)).collect()).collect()
    }

    #[test]
    fn sums_hold_the_latest_code_of_every_signal() {
        let mut rng = Pcg64Mcg::seed_from_u64(12);
        let signals = signals(&mut rng, 40, 8);
        let mut sums = Sums::zeros(6, 8);
        let mut codes: Vec<Vec<(u32, f64)>> = vec![Vec::new(); 40];
        for round in 0..3 {
            for (s, code) in codes.iter_mut().enumerate() {
                let new: Vec<(u32, f64)> = (0..6)
                    .filter(|j| (s + round + j) % 3 != 0)
                    .map(|j| (j as u32, rng.random_range(-1.0..1.0)))
                    .collect();
                sums.exchange(&signals[s], code, &new);
                *code = new;
            }
        }
        let (mut by_code, mut by_signal) = (vec![0.0; 36], vec![0.0; 48]);
        for (s, code) in codes.iter().enumerate() {
            for &(j, a) in code {
                code.iter().for_each(|&(l, b)| by_code[j as usize * 6 + l as usize] += a * b);
                (0..8).for_each(|d| by_signal[j as usize * 8 + d] += a * signals[s][d]);
            }
        }
        let far = |a: &[f64], b: &[f64]| a.iter().zip(b).fold(0.0_f64, |m, (x, y)| m.max((x - y).abs()));
        assert!(far(&sums.codes, &by_code) < ROUND_OFF && far(&sums.signals, &by_signal) < ROUND_OFF);
    }

    #[test]
    fn blocks_of_atoms_move_as_one_atom_after_the_other_would() {
        // More atoms than a block, and a dimension that fills no vector.
        let (n, rank) = (UPDATED_AT_ONCE + 9, 19);
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let signals = signals(&mut rng, 300, rank);
        let mut atoms: Vec<f64> = (0..n).flat_map(|s| unit(&signals[s])).collect();
        let mut sums = Sums::zeros(n, rank);
        for s in 0..300 {
            let mut code: Vec<(u32, f64)> =
                (0..4).map(|_| (rng.random_range(0..n as u32), rng.random_range(-1.0..1.0))).collect();
            code.sort_by_key(|c| c.0);
            code.dedup_by_key(|c| c.0);
            sums.exchange(&signals[s], &[], &code);
        }
        let mut plain = atoms.clone();
        for j in 0..n {
            let weight = sums.codes[j * n + j];
            if weight > UNUSED {
                let mut step = sums.signals[j * rank..(j + 1) * rank].to_vec();
                for l in 0..n {
                    add_scaled(&mut step, -sums.codes[j * n + l], &plain[l * rank..(l + 1) * rank]);
                }
                let atom = &mut plain[j * rank..(j + 1) * rank];
                add_scaled(atom, 1.0 / weight, &step);
                let length = dot(atom, atom).sqrt().max(1.0);
                atom.iter_mut().for_each(|x| *x /= length);
            }
        }
        sums.update_atoms(&mut atoms);
        for (x, expected) in atoms.iter().zip(&plain) {
            assert!((x - expected).abs() < ROUND_OFF, "{x} {expected}");
        }
    }
}
