//! Into how many substeps a step is cut: fixed, or from strain rate and Courant number (MS08 §6).
//!
//! The count is one for all strands, so that a strand's result depends on its own motion and on the fastest of all, never
//! on how strands are batched.

use crate::lanes::LANES;
use crate::system::{StrandState, StrandSystem};
use rayon::prelude::*;

/// Number of substeps of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Substeps {
    /// Always this many, at least one.
    Fixed(usize),
    /// As few as keep every segment within both bounds.
    Adaptive {
        /// Largest change of a segment's length over a substep, as a share of it.
        strain: f64,
        /// Largest movement of a segment's ends relative to each other over a substep, as a share of its length.
        courant: f64,
        /// No more than this many.
        most: usize,
    },
}

/// Substeps of a step of `dt` seconds from `state`.
pub(crate) fn count_substeps(system: &StrandSystem, state: &StrandState, dt: f64, substeps: Substeps) -> usize {
    let (strain, courant, most) = match substeps {
        Substeps::Fixed(n) => return n.max(1),
        Substeps::Adaptive { strain, courant, most } => (strain, courant, most),
    };
    let fastest = |s: usize| -> (f64, f64) {
        let (batch, state) = (&system.batches[s], &state.batches[s]);
        let topology = &system.topologies[batch.topology];
        let (mut stretching, mut turning) = (0.0_f64, 0.0_f64);
        for j in 0..topology.n_main - 1 {
            let (a, b) = (topology.rig_of_main(j), topology.rig_of_main(j + 1));
            for l in 0..LANES {
                let e: [f64; 3] = std::array::from_fn(|c| state.position[b][c][l] - state.position[a][c][l]);
                let v: [f64; 3] = std::array::from_fn(|c| state.velocity[b][c][l] - state.velocity[a][c][l]);
                let dot = |a: &[f64; 3], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
                let length2 = dot(&e, &e).max(f64::MIN_POSITIVE);
                stretching = stretching.max(dot(&e, &v).abs() / length2);
                turning = turning.max((dot(&v, &v) / length2).sqrt());
            }
        }
        (stretching, turning)
    };
    let (stretching, turning) = (0..system.batches.len())
        .into_par_iter()
        .map(fastest)
        .reduce(|| (0.0, 0.0), |a, b| (a.0.max(b.0), a.1.max(b.1)));
    let wanted = (dt * stretching / strain).max(dt * turning / courant).ceil();
    // A rate that is not finite asks for the most.
    if wanted < most as f64 { (wanted as usize).max(1) } else { most.max(1) }
}
