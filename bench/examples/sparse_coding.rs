//! Dictionary learning on one matrix, for comparison with another library: `bench/scripts/compare_spams.py` runs it.
//!
//! Arguments: `made DIMENSIONS SIGNALS ATOMS BETA PASSES BATCH FOLDER`, or `frames FILE RANK ATOMS BETA PASSES BATCH FOLDER`.
//! Writes `long.f64`, `signals.f64` (in their own span where they are longer than many) and `atoms.f64` (signal by signal, atom
//! by atom, little endian) to the folder and prints one line of JSON: shape, objective of AS16 Eq. (9), CPU seconds of all
//! threads.
#![allow(clippy::print_stdout, reason = "a program talks to whoever runs it")]

use std::error::Error;
use std::path::{Path, PathBuf};

use cpu_time::ProcessTime;
use io_formats::frames::FrameStore;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use skinning_train::guide_select::sparse_coding::{SparseCodingParams, learn_dictionary};
use skinning_train::reduce::{Signals, reduce};

/// Signals of `dims` numbers like those of hair: some hundred ways to move, smooth in their order of size, a few of them in
/// each signal, and noise.
fn made(dims: usize, n_signals: usize) -> Signals {
    const MOTIONS: usize = 160;
    const PER_SIGNAL: usize = 5;
    const NOISE: f64 = 0.1;
    let mut rng = Pcg64Mcg::seed_from_u64(2010);
    let mut motions = Vec::with_capacity(MOTIONS);
    for _ in 0..MOTIONS {
        let mut motion: Vec<f64> =
            (0..dims).map(|d| rng.random_range(-1.0..1.0) / (1.0 + 10.0 * d as f64 / dims as f64)).collect();
        let length = motion.iter().map(|x| x * x).sum::<f64>().sqrt();
        motion.iter_mut().for_each(|x| *x /= length);
        motions.push(motion);
    }
    let mut coords = Vec::with_capacity(dims * n_signals);
    for _ in 0..n_signals {
        let noise = NOISE / (dims as f64).sqrt();
        let mut signal: Vec<f64> = (0..dims).map(|_| noise * rng.random_range(-1.0..1.0)).collect();
        for _ in 0..PER_SIGNAL {
            let motion = &motions[rng.random_range(0..MOTIONS)];
            let share = rng.random_range(-1.0..1.0);
            signal.iter_mut().zip(motion).for_each(|(x, m)| *x += share * m);
        }
        coords.extend(signal);
    }
    let scale = (n_signals as f64 / coords.iter().map(|x| x * x).sum::<f64>()).sqrt();
    coords.iter_mut().for_each(|x| *x *= scale);
    Signals { rank: dims, coords, scale, lost_energy: 0.0 }
}

fn write(folder: &Path, name: &str, values: &[f64]) -> std::io::Result<()> {
    let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
    std::fs::write(folder.join(name), bytes)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let mut next = || args.next().ok_or("too few arguments; see the head of this file");
    let signals = match next()?.as_str() {
        "made" => {
            let dims = next()?.parse()?;
            made(dims, next()?.parse()?)
        }
        _ => {
            let frames = FrameStore::open(&PathBuf::from(next()?))?;
            reduce(&frames, next()?.parse()?, 16, 1, &mut |_| {})?
        }
    };
    let params = SparseCodingParams {
        n_atoms: next()?.parse()?,
        sparsity: next()?.parse()?,
        epochs: next()?.parse()?,
        batch: next()?.parse()?,
        seed: 1,
    };
    let folder = PathBuf::from(next()?);
    let begin = ProcessTime::now();
    // Longer than many: the other library gets the triangular factor of a QR decomposition too.
    let coded = signals.in_own_span();
    let reduced_s = begin.elapsed().as_secs_f64();
    let dictionary = learn_dictionary(&coded, &params, &mut |_| {});
    let seconds = begin.elapsed().as_secs_f64();
    let objective = dictionary.objective[dictionary.objective.len() - 1];
    let used: usize = dictionary.codes.iter().map(Vec::len).sum();
    write(&folder, "long.f64", &signals.coords)?;
    write(&folder, "signals.f64", &coded.coords)?;
    write(&folder, "atoms.f64", &dictionary.atoms)?;
    println!(
        "{{\"dims\": {}, \"signals\": {}, \"atoms\": {}, \"objective\": {objective}, \"cpu_s\": {seconds}, \"qr_cpu_s\": {reduced_s}, \"span\": {}, \"per_code\": {}}}",
        signals.rank,
        signals.n_strands(),
        dictionary.n_atoms,
        coded.rank,
        used as f64 / signals.n_strands() as f64
    );
    Ok(())
}
