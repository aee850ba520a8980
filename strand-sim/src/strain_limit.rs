//! Strain limiting biased from the root (MS08 §4.2).
//!
//! March from the root and, where a segment is stretched beyond the limit, move only its far particle. Only the positions
//! are changed, as in the paper: the velocity that the next step starts from keeps the springs' own answer.

use crate::lanes::{LANES, Lane3};
use crate::rig::Topology;
use crate::system::Batch;

/// Shortens every segment stretched by more than `limit` to that limit, root to tip.
pub(crate) fn limit_strain(topology: &Topology, batch: &Batch, position: &mut [Lane3], limit: f64) {
    for i in topology.first_free_main()..topology.n_main {
        let (near, far) = (topology.rig_of_main(i - 1), topology.rig_of_main(i));
        for l in 0..LANES {
            let longest = (1.0 + limit) * batch.segment_length[i - 1][l];
            pull_to(position, near, far, l, longest);
            // A perturbed particle hangs on the end of its segment nearer the root.
            if let Some(perturbed) = topology.rig_of_perturbed(i - 1).filter(|&p| p >= topology.n_kinematic) {
                pull_to(position, near, perturbed, l, longest);
            }
        }
    }
}

fn pull_to(position: &mut [Lane3], near: usize, far: usize, l: usize, longest: f64) {
    let d: [f64; 3] = std::array::from_fn(|c| position[far][c][l] - position[near][c][l]);
    let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
    if length > longest {
        let scale = longest / length;
        for c in 0..3 {
            position[far][c][l] = position[near][c][l] + d[c] * scale;
        }
    }
}
