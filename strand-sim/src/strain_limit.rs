//! Strain limiting biased from the root (MS08 §4.2).
//!
//! March from the root and, where a segment is stretched beyond the limit, move only its far particle. Only the positions
//! are changed, as in the paper: the velocity that the next step starts from keeps the springs' own answer.

use crate::lanes::{self, LANES, Lane, Lane3, ZERO};
use crate::rig::Topology;
use crate::system::Batch;
use multiversion::multiversion;

/// Shortens every segment stretched by more than `limit` to that limit, root to tip.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
pub(crate) fn limit_strain(topology: &Topology, batch: &Batch, position: &mut [Lane3], limit: f64) {
    for i in topology.first_free_main()..topology.n_main {
        let (near, far) = (topology.rig_of_main(i - 1), topology.rig_of_main(i));
        let longest = batch.segment_length[i - 1].map(|length| (1.0 + limit) * length);
        let from = position[near];
        pull_to(&from, &mut position[far], &longest);
        // A perturbed particle hangs on the end of its segment nearer the root.
        if let Some(perturbed) = topology.rig_of_perturbed(i - 1).filter(|&p| p >= topology.n_kinematic) {
            pull_to(&from, &mut position[perturbed], &longest);
        }
    }
}

#[inline(always)]
fn pull_to(near: &Lane3, far: &mut Lane3, longest: &Lane) {
    let mut d = [ZERO; 3];
    for c in 0..3 {
        d[c] = lanes::sub(&far[c], &near[c]);
    }
    let (mut length, mut scale) = (ZERO, ZERO);
    for l in 0..LANES {
        length[l] = (d[0][l] * d[0][l] + d[1][l] * d[1][l] + d[2][l] * d[2][l]).sqrt();
        scale[l] = longest[l] / length[l];
    }
    for c in 0..3 {
        for l in 0..LANES {
            let pulled = near[c][l] + d[c][l] * scale[l];
            far[c][l] = if length[l] > longest[l] { pulled } else { far[c][l] };
        }
    }
}
