//! Atoms that represent all motion signals sparsely: AS16 Eq. (9) by online dictionary learning (Mairal et al. 2010, the
//! method AS16 §6.3 cites).
//!
//! Mini-batches of signals are coded against the present dictionary, two sums of the codes are updated, and the atoms
//! follow by block coordinate descent on those sums, each kept within the unit ball (without a bound the penalty would
//! shrink codes by growing atoms). A signal's new code takes the place of its old one in the sums, and starts from it.
//! Batches have a fixed order and codes are reduced in it: same inputs, same bytes, for any number of threads.

use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::lasso::{Lasso, LassoStatus, LassoWorkspace};
use super::sums::Sums;
use super::vectors::{add_scaled, dot, multiply, products, unit};
use crate::reduce::Signals;

/// Optimality of codes while atoms still move.
const LEARNING_TOLERANCE: f64 = 1e-4;
/// Optimality of codes that are reported or used.
pub const FINAL_TOLERANCE: f64 = 1e-7;
/// Signals looked at for each first atom.
const CANDIDATES_PER_ATOM: usize = 64;
/// So few are all looked at: it costs next to nothing.
const LEAST_CANDIDATES: usize = 4096;
/// Signals coded by one task, whose products with all atoms are one matrix product.
const BLOCK: usize = 32;

/// What to learn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SparseCodingParams {
    /// Number of atoms: of guides to select.
    pub n_atoms: usize,
    /// β of AS16 Eq. (9), in shares of the mean squared length of a signal.
    pub sparsity: f64,
    /// Passes over all signals.
    pub epochs: usize,
    /// Signals per mini-batch.
    pub batch: usize,
    /// Seed of the first atoms and of the order of signals.
    pub seed: u64,
}

/// Atoms, the codes of all signals over them, and how learning went.
#[derive(Debug, Clone, PartialEq)]
pub struct Dictionary {
    /// `n_atoms * rank` coordinates, atom-major, each atom of length at most 1.
    pub atoms: Vec<f64>,
    /// Number of atoms.
    pub n_atoms: usize,
    /// Codes of all signals, strand-major: per signal the atoms it uses, ascending, with their coefficients.
    pub codes: Vec<Vec<(u32, f64)>>,
    /// Mean over signals of the objective of AS16 Eq. (9): for each epoch with the atoms each signal was coded over, which
    /// move on, and at the end with the atoms returned.
    pub objective: Vec<f64>,
    /// Codes of the last pass that stopped before they were optimal.
    pub n_stopped: usize,
}

/// Learns atoms for `signals`, starting from signals drawn apart from each other.
/// Implements AS16 Eq. (9), without the ½ that common libraries put before the square: their penalty is β/2.
/// An atom no signal used during an epoch is replaced by the signal represented worst.
///
/// # Panics
/// If there are fewer signals than atoms, or no atoms.
pub fn learn_dictionary(signals: &Signals, params: &SparseCodingParams, on_epoch: &mut dyn FnMut(u64)) -> Dictionary {
    let (n, rank, n_signals) = (params.n_atoms, signals.rank, signals.n_strands());
    assert!(n >= 1 && n <= n_signals, "{n} atoms cannot be learned from {n_signals} signals");
    let mut rng = Pcg64Mcg::seed_from_u64(params.seed);
    let mut order: Vec<usize> = (0..n_signals).collect();
    let energies: Vec<f64> = (0..n_signals).into_par_iter().map(|s| dot(signals.of(s), signals.of(s))).collect();
    let mut atoms = first_atoms(signals, &energies, n, &mut rng);
    let mut objective = Vec::with_capacity(params.epochs + 1);
    let mut coded = Coded::zeros(n_signals);
    let mut sums = Sums::zeros(n, rank);
    for epoch in 0..params.epochs {
        order.shuffle(&mut rng);
        for batch in order.chunks(params.batch.max(1)) {
            let new = code_some(signals, batch, &coded.codes, &atoms, params.sparsity, false, LEARNING_TOLERANCE);
            for (&s, new) in batch.iter().zip(new) {
                sums.exchange(signals.of(s), &coded.codes[s], &new.code);
                coded.put(s, new, energies[s]);
            }
            sums.update_atoms(&mut atoms);
        }
        objective.push(coded.mean_objective());
        // Not after the last epoch: nothing would make use of them.
        if epoch + 1 < params.epochs {
            for j in reseed_unused(&mut atoms, signals, &coded) {
                sums.forget(j);
            }
        }
        on_epoch(epoch as u64 + 1);
    }
    let all: Vec<usize> = (0..n_signals).collect();
    let last = code_some(signals, &all, &coded.codes, &atoms, params.sparsity, false, FINAL_TOLERANCE);
    let n_stopped = last.iter().filter(|c| c.status == LassoStatus::Stopped).count();
    let terms: Vec<f64> = last
        .par_iter()
        .enumerate()
        .map(|(s, c)| self::objective(signals.of(s), &atoms, &c.code, params.sparsity))
        .collect();
    objective.push(terms.iter().sum::<f64>() / n_signals as f64);
    let codes = last.into_iter().map(|c| c.code).collect();
    Dictionary { atoms, n_atoms: n, codes, objective, n_stopped }
}

/// Codes of all `signals` over the given atoms, not negative if so asked: Eq. (9) with the dictionary fixed.
/// Returns per strand the atoms used, ascending, with their coefficients, and how many codes stopped early.
#[must_use]
pub fn code_signals(
    signals: &Signals,
    atoms: &[f64],
    sparsity: f64,
    non_negative: bool,
) -> (Vec<Vec<(u32, f64)>>, usize) {
    let all: Vec<usize> = (0..signals.n_strands()).collect();
    let coded = code_some(signals, &all, &[], atoms, sparsity, non_negative, FINAL_TOLERANCE);
    let n_stopped = coded.iter().filter(|c| c.status == LassoStatus::Stopped).count();
    (coded.into_iter().map(|c| c.code).collect(), n_stopped)
}

/// `n` distinct signals of unit length, each drawn with a chance that goes with the energy the best of those before it
/// leaves unexplained: plain random draws would crowd where hair is dense. Of very many signals only some are looked at,
/// drawn plainly: every atom costs a pass over all of them.
fn first_atoms(signals: &Signals, energies: &[f64], n: usize, rng: &mut Pcg64Mcg) -> Vec<f64> {
    let mut from: Vec<usize> = (0..energies.len()).collect();
    let most = (CANDIDATES_PER_ATOM * n).max(LEAST_CANDIDATES);
    if from.len() > most {
        from.shuffle(rng);
        from.truncate(most);
        // In the order they lie in memory.
        from.sort_unstable();
    }
    let mut left: Vec<f64> = from.iter().map(|&s| energies[s]).collect();
    let mut atoms = Vec::with_capacity(n * signals.rank);
    let mut drawn = vec![false; left.len()];
    for _ in 0..n {
        let mut at = rng.random::<f64>() * left.iter().sum::<f64>();
        let mut chosen = None;
        for s in (0..left.len()).filter(|&s| !drawn[s]) {
            // The last one stands in where round-off leaves none, or nothing is left to explain.
            chosen = Some(s);
            at -= left[s];
            if at < 0.0 {
                break;
            }
        }
        let Some(chosen) = chosen else { break };
        drawn[chosen] = true;
        left[chosen] = 0.0;
        let atom = unit(signals.of(from[chosen]));
        left.par_iter_mut().zip(&from).for_each(|(left, &s)| {
            let along = dot(signals.of(s), &atom);
            *left = left.min((energies[s] - along * along).max(0.0));
        });
        atoms.extend(atom);
    }
    atoms
}

/// The code of one signal: the atoms it uses, ascending, with their coefficients.
struct Code {
    code: Vec<(u32, f64)>,
    /// Its term of Eq. (9) without the signal's energy: what the code saves, negative.
    saved: f64,
    status: LassoStatus,
}

/// The latest codes of all signals, each over the atoms there were when it was coded.
struct Coded {
    codes: Vec<Vec<(u32, f64)>>,
    /// Terms of Eq. (9), up to round-off of a signal's energy.
    objectives: Vec<f64>,
}

impl Coded {
    fn zeros(n: usize) -> Self {
        Self { codes: vec![Vec::new(); n], objectives: vec![0.0; n] }
    }

    fn put(&mut self, s: usize, new: Code, energy: f64) {
        self.codes[s] = new.code;
        self.objectives[s] = energy + new.saved;
    }

    fn mean_objective(&self) -> f64 {
        self.objectives.iter().sum::<f64>() / self.objectives.len() as f64
    }
}

/// |u - G a|² + β |a|₁ of one signal: its term of AS16 Eq. (9).
#[must_use]
pub fn objective(signal: &[f64], atoms: &[f64], code: &[(u32, f64)], sparsity: f64) -> f64 {
    let rank = signal.len();
    let mut residual = signal.to_vec();
    let mut length = 0.0;
    for &(j, a) in code {
        add_scaled(&mut residual, -a, &atoms[j as usize * rank..(j as usize + 1) * rank]);
        length += a.abs();
    }
    dot(&residual, &residual) + sparsity * length
}

/// One thread's memory for coding.
#[derive(Default)]
struct Coder {
    block: Vec<f64>,
    correlations: Vec<f64>,
    code: Vec<f64>,
    workspace: LassoWorkspace,
}

/// Codes the signals of `which`, each starting from its code in `start` where there is one. A code of before is a good
/// start: atoms move little between two passes.
fn code_some(
    signals: &Signals,
    which: &[usize],
    start: &[Vec<(u32, f64)>],
    atoms: &[f64],
    sparsity: f64,
    non_negative: bool,
    tolerance: f64,
) -> Vec<Code> {
    let rank = signals.rank;
    let n_atoms = atoms.len() / rank;
    let gram = products(atoms, atoms, rank);
    let lasso = Lasso { gram: &gram, n_atoms, penalty: sparsity, non_negative, tolerance };
    let coded: Vec<Vec<Code>> = which
        .par_chunks(BLOCK)
        .map_init(Coder::default, |coder, some| {
            coder.block.clear();
            some.iter().for_each(|&s| coder.block.extend_from_slice(signals.of(s)));
            coder.correlations.resize(some.len() * n_atoms, 0.0);
            multiply(&mut coder.correlations, atoms, &coder.block, rank);
            coder.code.resize(n_atoms, 0.0);
            let each = some.iter().zip(coder.correlations.chunks_exact(n_atoms));
            each.map(|(&s, correlations)| {
                coder.code.fill(0.0);
                start.get(s).into_iter().flatten().for_each(|&(j, a)| coder.code[j as usize] = a);
                let status = lasso.solve(correlations, &mut coder.code, &mut coder.workspace);
                let code: Vec<(u32, f64)> =
                    coder.code.iter().enumerate().filter(|(_, a)| **a != 0.0).map(|(j, &a)| (j as u32, a)).collect();
                // |u - G a|² - |u|² is aᵀ GᵀG a - 2 aᵀ Gᵀu.
                let mut saved = 0.0;
                for &(j, a) in &code {
                    let row = &gram[j as usize * n_atoms..(j as usize + 1) * n_atoms];
                    let along: f64 = code.iter().map(|&(l, b)| row[l as usize] * b).sum();
                    saved += a * (along - 2.0 * correlations[j as usize]) + sparsity * a.abs();
                }
                Code { code, saved, status }
            })
            .collect()
        })
        .collect();
    coded.into_iter().flatten().collect()
}

/// Replaces atoms that no signal uses by the signals represented worst, one each; returns which were replaced.
fn reseed_unused(atoms: &mut [f64], signals: &Signals, coded: &Coded) -> Vec<usize> {
    let rank = signals.rank;
    let mut used = vec![false; atoms.len() / rank];
    coded.codes.iter().flatten().for_each(|&(j, _)| used[j as usize] = true);
    let mut worst: Vec<usize> = (0..signals.n_strands()).collect();
    worst.sort_by(|&a, &b| coded.objectives[b].total_cmp(&coded.objectives[a]).then(a.cmp(&b)));
    let unused: Vec<usize> = (0..used.len()).filter(|&j| !used[j]).collect();
    for (&j, &s) in unused.iter().zip(&worst) {
        atoms[j * rank..(j + 1) * rank].copy_from_slice(&unit(signals.of(s)));
    }
    unused
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rises of the objective between epochs that mini-batches may cause, relative.
    const BATCH_NOISE: f64 = 0.02;
    /// Learning starts from signals drawn well apart, so little is left to gain here.
    const LEAST_GAIN: f64 = 0.98;

    /// Signals that are each one or two of `n` planted unit directions, plus a little noise.
    fn planted(n: usize, rank: usize, n_signals: usize) -> (Vec<Vec<f64>>, Signals) {
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        let mut draw = |scale: f64| -> Vec<f64> { (0..rank).map(|_| scale * rng.random_range(-1.0..1.0)).collect() };
        let planted: Vec<Vec<f64>> = (0..n).map(|_| unit(&draw(1.0))).collect();
        let mut coords = Vec::new();
        for s in 0..n_signals {
            let mut signal = draw(0.01);
            add_scaled(&mut signal, 1.0, &planted[s % n]);
            if s % 3 == 0 {
                add_scaled(&mut signal, 0.7, &planted[(s / 3) % n]);
            }
            coords.extend(signal);
        }
        (planted, Signals { rank, coords, scale: 1.0, lost_energy: 0.0 })
    }

    fn params(n_atoms: usize) -> SparseCodingParams {
        SparseCodingParams { n_atoms, sparsity: 0.15, epochs: 15, batch: 32, seed: 1 }
    }

    #[test]
    fn learning_lowers_the_objective() {
        let (_, signals) = planted(12, 16, 600);
        let dictionary = learn_dictionary(&signals, &params(12), &mut |_| {});
        let o = &dictionary.objective;
        let energies: Vec<f64> = (0..600).map(|s| dot(signals.of(s), signals.of(s))).collect();
        let first = first_atoms(&signals, &energies, 12, &mut Pcg64Mcg::seed_from_u64(params(12).seed));
        let (codes, _) = code_signals(&signals, &first, 0.15, false);
        let at_first = (0..600).map(|s| objective(signals.of(s), &first, &codes[s], 0.15)).sum::<f64>() / 600.0;
        assert!(o[o.len() - 1] < LEAST_GAIN * at_first, "{at_first}, then {o:?}");
        assert!(o.windows(2).all(|w| w[1] <= w[0] * (1.0 + BATCH_NOISE)), "{o:?}");
        let total: f64 =
            (0..600).map(|s| objective(signals.of(s), &dictionary.atoms, &dictionary.codes[s], 0.15)).sum();
        assert!((total / 600.0 - o[o.len() - 1]).abs() < 1e-12, "the last objective is that of what is returned");
    }

    #[test]
    fn planted_directions_are_found_and_atoms_stay_in_the_unit_ball() {
        let (planted, signals) = planted(8, 16, 800);
        let dictionary = learn_dictionary(&signals, &params(8), &mut |_| {});
        for atom in dictionary.atoms.chunks_exact(16) {
            assert!(dot(atom, atom) <= 1.0 + 1e-12);
        }
        let found =
            planted.iter().filter(|p| dictionary.atoms.chunks_exact(16).any(|atom| dot(p, atom).abs() > 0.95)).count();
        assert!(found >= 7, "{found} of 8 directions found");
    }

    #[test]
    fn an_unused_atom_is_replaced() {
        let (_, signals) = planted(6, 8, 120);
        let mut atoms: Vec<f64> = (0..6).flat_map(|s| unit(signals.of(s))).collect();
        atoms[8..16].fill(0.0);
        let mut coded = Coded::zeros(120);
        let all: Vec<usize> = (0..120).collect();
        for (s, new) in code_some(&signals, &all, &[], &atoms, 0.15, false, FINAL_TOLERANCE).into_iter().enumerate() {
            coded.put(s, new, dot(signals.of(s), signals.of(s)));
        }
        assert_eq!(reseed_unused(&mut atoms, &signals, &coded), [1]);
        assert!((dot(&atoms[8..16], &atoms[8..16]) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_dictionary_has_the_same_bytes_for_any_number_of_threads() {
        let (_, signals) = planted(12, 16, 600);
        let learn = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads");
            pool.install(|| learn_dictionary(&signals, &params(12), &mut |_| {}))
        };
        let one = learn(1);
        for threads in [2, 8] {
            assert!(learn(threads) == one, "{threads} threads");
        }
    }
}
