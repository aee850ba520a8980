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
use hair_bench::sparse_signals::made;
use io_formats::frames::FrameStore;
use skinning_train::guide_select::sparse_coding::{SparseCodingParams, learn_dictionary};
use skinning_train::reduce::reduce;

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
