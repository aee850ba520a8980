//! The force that a strand's springs carry through a cut across one of its segments: what a clamp there would feel.
//!
//! Edge, bending, torsion and altitude springs that join particles on either side are summed as MS08 §3.2 has them, without
//! damping: on a strand at rest the cut force balances all that acts beyond the cut.

use crate::altitude::altitude;
use crate::lanes::Lane3;
use crate::rig::ALTITUDE;
use crate::system::{StrandState, StrandSystem, get};
use nalgebra::Vector3;

impl StrandSystem {
    /// Force on the part of a strand beyond the root end of one of its segments, from the part before, dyn.
    ///
    /// # Panics
    /// If there is no such strand or segment.
    #[must_use]
    pub fn cut_force(&self, state: &StrandState, strand: usize, segment: usize) -> Vector3<f64> {
        let (batch, lane) = self.place[strand];
        let (batch, position, lane) =
            (&self.batches[batch as usize], &state.batches[batch as usize].position, lane as usize);
        let topology = &self.topologies[batch.topology];
        let last_before = topology.rig_of_main(segment);
        let at = |p: usize| get(&position[p] as &Lane3, lane);
        let mut force = Vector3::zeros();
        for (k, spring) in topology.springs.iter().enumerate() {
            if spring.a <= last_before && last_before < spring.b {
                let along = at(spring.b) - at(spring.a);
                let strain = along.norm() * batch.inv_rest_length[k][lane] - 1.0;
                force -= along.normalize() * (batch.stiffness[spring.kind as usize][lane] * strain);
            }
        }
        for first in 0..topology.n_tetrahedra() {
            if !(first..first + 3).contains(&last_before) {
                continue;
            }
            let corners = [0, 1, 2, 3].map(|c| at(first + c));
            if let Some(a) = altitude(&corners, &batch.altitude_rest[first].get(lane)) {
                let pull = batch.stiffness[ALTITUDE][lane] * a.per_length * (a.length - a.rest_length);
                for c in (0..4).filter(|c| first + c > last_before) {
                    force -= a.direction * (pull * a.weight[c]);
                }
            }
        }
        force
    }
}
