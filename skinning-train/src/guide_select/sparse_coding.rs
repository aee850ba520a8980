//! Atoms that represent all motion signals sparsely: AS16 Eq. (9) by online dictionary learning (Mairal et al. 2010, the
//! method AS16 §6.3 cites).
//!
//! Mini-batches of signals are coded against the present dictionary, two sums of the codes are updated, and the atoms
//! follow by block coordinate descent on those sums, each kept within the unit ball (without a bound the penalty would
//! shrink codes by growing atoms). Older batches fade from the sums, since their codes belong to a dictionary that is
//! gone. Batches have a fixed order and codes are reduced in it: same inputs, same bytes, for any number of threads.

use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::lasso::{Lasso, LassoStatus, LassoWorkspace};
use crate::reduce::Signals;

/// Optimality of codes while atoms still move.
const LEARNING_TOLERANCE: f64 = 1e-4;
/// Optimality of codes that are reported or used.
pub const FINAL_TOLERANCE: f64 = 1e-7;
/// How fast old batches fade: batch t keeps (1 - 1/t)^FADING of the sums before it.
const FADING: f64 = 2.0;
/// Sum of squared codes below which an atom cannot be updated.
const UNUSED: f64 = 1e-10;

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
    /// Mean over signals of the objective of AS16 Eq. (9): with the first atoms, then after each epoch.
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
    let mut atoms = first_atoms(signals, n, &mut rng);
    let mut objective = Vec::with_capacity(params.epochs + 1);
    let mut coded = code_all(signals, &atoms, params.sparsity);
    objective.push(coded.mean_objective());

    // The sums of Mairal 2010: code by code (n x n) and signal by code (n x rank, atom-major).
    let (mut code_sum, mut signal_sum) = (vec![0.0; n * n], vec![0.0; n * rank]);
    let mut n_batches = 0.0_f64;
    for epoch in 0..params.epochs {
        order.shuffle(&mut rng);
        for batch in order.chunks(params.batch.max(1)) {
            n_batches += 1.0;
            let fade = (1.0 - 1.0 / n_batches).powf(FADING);
            code_sum.iter_mut().for_each(|x| *x *= fade);
            signal_sum.iter_mut().for_each(|x| *x *= fade);
            let gram = gram(&atoms, rank);
            let codes: Vec<Vec<(u32, f64)>> = batch
                .par_iter()
                .map_init(Coder::default, |coder, &s| {
                    coder.code(&gram, &atoms, signals.of(s), params.sparsity, false, LEARNING_TOLERANCE).0
                })
                .collect();
            for (&s, code) in batch.iter().zip(&codes) {
                for &(j, a) in code {
                    let j = j as usize;
                    for &(l, b) in code {
                        code_sum[j * n + l as usize] += a * b;
                    }
                    add_scaled(&mut signal_sum[j * rank..(j + 1) * rank], a, signals.of(s));
                }
            }
            update_atoms(&mut atoms, &code_sum, &signal_sum, rank);
        }
        coded = code_all(signals, &atoms, params.sparsity);
        // Not after the last epoch: what is returned must be what was coded.
        if epoch + 1 < params.epochs {
            for j in reseed_unused(&mut atoms, signals, &coded) {
                code_sum[j * n..(j + 1) * n].fill(0.0);
                (0..n).for_each(|l| code_sum[l * n + j] = 0.0);
                signal_sum[j * rank..(j + 1) * rank].fill(0.0);
            }
        }
        objective.push(coded.mean_objective());
        on_epoch(epoch as u64 + 1);
    }
    Dictionary { atoms, n_atoms: n, codes: coded.codes, objective, n_stopped: coded.n_stopped }
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
    let gram = gram(atoms, signals.rank);
    let coded: Vec<_> = (0..signals.n_strands())
        .into_par_iter()
        .map_init(Coder::default, |coder, s| {
            coder.code(&gram, atoms, signals.of(s), sparsity, non_negative, FINAL_TOLERANCE)
        })
        .collect();
    let n_stopped = coded.iter().filter(|(_, status)| *status == LassoStatus::Stopped).count();
    (coded.into_iter().map(|(code, _)| code).collect(), n_stopped)
}

/// `n` distinct signals of unit length, each drawn with a chance that goes with the energy the best of those before it
/// leaves unexplained: plain random draws would crowd where hair is dense.
fn first_atoms(signals: &Signals, n: usize, rng: &mut Pcg64Mcg) -> Vec<f64> {
    let energy = |s: usize| dot(signals.of(s), signals.of(s));
    let mut left: Vec<f64> = (0..signals.n_strands()).map(energy).collect();
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
        let atom = unit(signals.of(chosen));
        left.par_iter_mut().enumerate().for_each(|(s, left)| {
            let along = dot(signals.of(s), &atom);
            *left = left.min((energy(s) - along * along).max(0.0));
        });
        atoms.extend(atom);
    }
    atoms
}

struct Coded {
    codes: Vec<Vec<(u32, f64)>>,
    objectives: Vec<f64>,
    n_stopped: usize,
}

impl Coded {
    fn mean_objective(&self) -> f64 {
        self.objectives.iter().sum::<f64>() / self.objectives.len() as f64
    }
}

fn code_all(signals: &Signals, atoms: &[f64], sparsity: f64) -> Coded {
    let (codes, n_stopped) = code_signals(signals, atoms, sparsity, false);
    let objectives =
        codes.par_iter().enumerate().map(|(s, code)| objective(signals.of(s), atoms, code, sparsity)).collect();
    Coded { codes, objectives, n_stopped }
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
    correlations: Vec<f64>,
    code: Vec<f64>,
    workspace: LassoWorkspace,
}

impl Coder {
    fn code(
        &mut self,
        gram: &[f64],
        atoms: &[f64],
        signal: &[f64],
        sparsity: f64,
        non_negative: bool,
        tolerance: f64,
    ) -> (Vec<(u32, f64)>, LassoStatus) {
        self.correlations.clear();
        self.correlations.extend(atoms.chunks_exact(signal.len()).map(|atom| dot(atom, signal)));
        let n_atoms = self.correlations.len();
        self.code.resize(n_atoms, 0.0);
        let lasso = Lasso { gram, n_atoms, penalty: sparsity, non_negative, tolerance };
        let status = lasso.solve(&self.correlations, &mut self.code, &mut self.workspace);
        let used = self.code.iter().enumerate().filter(|(_, a)| **a != 0.0).map(|(j, &a)| (j as u32, a)).collect();
        (used, status)
    }
}

/// Block coordinate descent on the sums, one atom after the other, each projected onto the unit ball.
fn update_atoms(atoms: &mut [f64], code_sum: &[f64], signal_sum: &[f64], rank: usize) {
    let n = atoms.len() / rank;
    let mut step = vec![0.0; rank];
    for j in 0..n {
        let weight = code_sum[j * n + j];
        if weight <= UNUSED {
            continue;
        }
        step.copy_from_slice(&signal_sum[j * rank..(j + 1) * rank]);
        for l in 0..n {
            let shared = code_sum[j * n + l];
            if shared != 0.0 {
                add_scaled(&mut step, -shared, &atoms[l * rank..(l + 1) * rank]);
            }
        }
        let atom = &mut atoms[j * rank..(j + 1) * rank];
        add_scaled(atom, 1.0 / weight, &step);
        let length = dot(atom, atom).sqrt();
        if length > 1.0 {
            atom.iter_mut().for_each(|x| *x /= length);
        }
    }
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

/// All products of atoms, `n_atoms * n_atoms`.
fn gram(atoms: &[f64], rank: usize) -> Vec<f64> {
    let n = atoms.len() / rank;
    let mut gram = vec![0.0; n * n];
    gram.par_chunks_mut(n).enumerate().for_each(|(j, row)| {
        let atom = &atoms[j * rank..(j + 1) * rank];
        for (x, other) in row.iter_mut().zip(atoms.chunks_exact(rank)) {
            *x = dot(atom, other);
        }
    });
    gram
}

/// The vector scaled to length 1; unchanged when it has none.
fn unit(v: &[f64]) -> Vec<f64> {
    let length = dot(v, v).sqrt();
    if length > 0.0 { v.iter().map(|x| x / length).collect() } else { v.to_vec() }
}

/// Four sums side by side: one would wait for itself at every term.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (mut a4, mut b4) = (a.chunks_exact(4), b.chunks_exact(4));
    for (x, y) in (&mut a4).zip(&mut b4) {
        for lane in 0..4 {
            sums[lane] += x[lane] * y[lane];
        }
    }
    let rest: f64 = a4.remainder().iter().zip(b4.remainder()).map(|(x, y)| x * y).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

fn add_scaled(out: &mut [f64], scale: f64, v: &[f64]) {
    for (x, y) in out.iter_mut().zip(v) {
        *x += scale * y;
    }
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
        assert!(o[o.len() - 1] < LEAST_GAIN * o[0], "{o:?}");
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
        let coded = code_all(&signals, &atoms, 0.15);
        assert_eq!(reseed_unused(&mut atoms, &signals, &coded), [1]);
        assert!((dot(&atoms[8..16], &atoms[8..16]) - 1.0).abs() < 1e-12);
    }
}
