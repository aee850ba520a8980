#!/usr/bin/env python3
"""Dictionary learning beside SPAMS, the library of the method's authors, on the same matrices.

    pip install 'numpy<2' spams-bin
    cargo build --release -p hair-bench --example sparse_coding
    python bench/scripts/compare_spams.py [--frames STORE.frames] [--json FILE]

Both start from their own first atoms and make the same number of passes in batches of the same size, on one thread. AS16
Eq. (9) has no 1/2 before the square: lambda is beta / 2. Both dictionaries are judged by one solver (SPAMS's lasso). Where
signals are longer than they are many, SPAMS gets them after an exact QR, its time included. CPU seconds of the process.
"""

import argparse
import json
import os
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
import spams

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / "target" / "release" / "examples" / "sparse_coding"
# name, arguments that make the signals, atoms, beta, passes, batch
CASES = [
    ("long_1000_of_15000", ["made", "15000", "1000"], 100, 0.15, 8, 256),
    ("made_15000_of_1000", ["made", "1000", "15000"], 100, 0.15, 8, 256),
]


def objective(signals, atoms, beta):
    codes = spams.lasso(signals, D=np.asfortranarray(atoms), lambda1=beta / 2, mode=2, numThreads=1)
    residual = signals - atoms @ codes.toarray()
    return float(((residual**2).sum() + beta * np.abs(codes).sum()) / signals.shape[1])


def run(name, source, n_atoms, beta, passes, batch):
    with tempfile.TemporaryDirectory() as folder:
        command = [str(PROGRAM), *source, str(n_atoms), str(beta), str(passes), str(batch), folder]
        ours = json.loads(subprocess.check_output(command, env={**os.environ, "RAYON_NUM_THREADS": "1"}))
        long = np.fromfile(f"{folder}/long.f64").reshape(ours["signals"], ours["dims"]).T.copy(order="F")
        signals = np.fromfile(f"{folder}/signals.f64").reshape(ours["signals"], ours["span"]).T.copy(order="F")
        atoms = np.fromfile(f"{folder}/atoms.f64").reshape(n_atoms, ours["span"]).T.copy(order="F")
    begin = time.process_time()
    reduced = np.asfortranarray(np.linalg.qr(long, mode="r")) if ours["dims"] > ours["signals"] else long
    qr_s = time.process_time() - begin
    begin = time.process_time()
    theirs = spams.trainDL(
        reduced, K=n_atoms, lambda1=beta / 2, mode=2, iter=passes * -(-ours["signals"] // batch), batchsize=batch,
        numThreads=1, verbose=False,
    )
    spams_s = time.process_time() - begin
    row = {
        "dims": ours["dims"], "signals": ours["signals"], "atoms": n_atoms, "beta": beta, "passes": passes,
        "batch": batch, "codes_per_signal": ours["per_code"],
        "objective": objective(signals, atoms, beta), "spams_objective": objective(reduced, theirs, beta),
        "cpu_s": ours["cpu_s"], "of_it_qr_cpu_s": ours["qr_cpu_s"], "spams_cpu_s": spams_s, "spams_qr_cpu_s": qr_s,
    }
    row["objective_over_spams"] = row["objective"] / row["spams_objective"]
    row["stated_objective"] = ours["objective"]
    print(
        f"{name:<22} objective {row['objective']:.6f} (stated {ours['objective']:.6f}), SPAMS {row['spams_objective']:.6f}: "
        f"{row['objective_over_spams']:.4f}; CPU {row['cpu_s']:.2f} s ({ours['qr_cpu_s']:.2f} QR), SPAMS {spams_s + qr_s:.2f} s ({qr_s:.2f} QR)",
        flush=True,
    )
    return row


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--frames", help="recorded frames of a groom, compared too")
    parser.add_argument("--json", help="also write the figures to this file")
    parser.add_argument("--only", help="only this case")
    args = parser.parse_args()
    cases = list(CASES)
    if args.frames:
        cases += [("groom_beta_0.015", ["frames", args.frames, "96"], 100, 0.015, 8, 256)]
        cases += [("groom_beta_0.15", ["frames", args.frames, "96"], 100, 0.15, 8, 256)]
    figures = {case[0]: run(*case) for case in cases if args.only in (None, case[0])}
    if args.json:
        Path(args.json).write_text(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    main()
