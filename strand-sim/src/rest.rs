//! Rest lengths with which a styled groom hangs still: no sag on the first step.
//!
//! Under gravity the springs must carry the hair, Σ T d = -m g at every free particle. Of all tensions that do, the ones
//! of least strain energy are those of the linear response: solve K u = m g with K = Σ (k/l) d dᵀ at the groom's own
//! shape and take T = (k/l) d·(u_b - u_a). The rest length l0 = k l / (k + T) then gives each spring exactly that tension
//! in the groom's shape. One banded solve per strand.

use crate::forces::{Linearised, add_spring, linearise};
use crate::lanes::{LANES, Lane, ZERO};
use crate::solve::banded::BandedMatrix;
use crate::system::StrandSystem;
use nalgebra::Vector3;

/// Largest pre-tension and pre-compression of a spring as a fraction of its stiffness. Beyond it a rest length would
/// collapse or run away; the strand then starts out of balance and the report says by how much.
const MAX_PRESTRESS: (f64, f64) = (-0.5, 1.0);

/// How still the strands are after the rest lengths were set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestReport {
    /// Largest net force on a free particle over its weight.
    pub max_residual_over_weight: f64,
    /// Strands with a residual above a hundredth of the weight.
    pub out_of_balance: usize,
}

impl StrandSystem {
    /// Sets rest lengths so that gravity (cm/s², head frame) is balanced in the shape the system was built in.
    pub fn balance_gravity(&mut self, gravity_in_head: &Vector3<f64>) -> RestReport {
        let mut report = RestReport { max_residual_over_weight: 0.0, out_of_balance: 0 };
        let weight_scale = gravity_in_head.norm();
        if weight_scale == 0.0 {
            return report;
        }
        for batch in &mut self.batches {
            let topology = &self.topologies[batch.topology];
            let n_kin = topology.n_kinematic;
            let n_dof = 3 * (topology.n_rig - n_kin);
            let mut matrix = BandedMatrix::new(n_dof / 3, topology.reach);
            let mut u = vec![ZERO; n_dof];
            for p in n_kin..topology.n_rig {
                for c in 0..3 {
                    for l in 0..LANES {
                        u[3 * (p - n_kin) + c][l] = batch.mass[p][l] * gravity_in_head[c];
                    }
                }
            }
            let weight = u.clone();
            let still = vec![[ZERO; 3]; topology.n_rig];
            let springs: Vec<Linearised> = topology
                .springs
                .iter()
                .enumerate()
                .map(|(k, s)| {
                    let (a, b) = (&batch.rest_in_head[s.a], &batch.rest_in_head[s.b]);
                    linearise(a, b, &batch.stiffness[k], &batch.inv_rest_length[k], &ZERO, 1.0)
                })
                .collect();
            for (spring, s) in topology.springs.iter().zip(&springs) {
                // Unstressed springs: no tension, `along` is k/l for a unit step.
                add_spring(topology, *spring, s, 0.0, &still, &mut matrix, &mut u);
            }
            matrix.factor();
            matrix.solve(&mut u);
            let mut net = weight;
            for (k, spring) in topology.springs.iter().enumerate() {
                let displacement = |p: usize, c: usize, l: usize| if p < n_kin { 0.0 } else { u[3 * (p - n_kin) + c][l] };
                let mut tension: Lane = ZERO;
                for l in 0..LANES {
                    let stretch: f64 = (0..3)
                        .map(|c| springs[k].direction[c][l] * (displacement(spring.b, c, l) - displacement(spring.a, c, l)))
                        .sum();
                    let stiffness = batch.stiffness[k][l];
                    let wanted = stiffness * batch.inv_rest_length[k][l] * stretch / stiffness;
                    let strain = if wanted.is_finite() { wanted.clamp(MAX_PRESTRESS.0, MAX_PRESTRESS.1) } else { 0.0 };
                    tension[l] = strain * stiffness;
                    // l0 = k l / (k + T)
                    batch.inv_rest_length[k][l] *= 1.0 + strain;
                    for c in 0..3 {
                        let pull = tension[l] * springs[k].direction[c][l];
                        if spring.a >= n_kin {
                            net[3 * (spring.a - n_kin) + c][l] += pull;
                        }
                        if spring.b >= n_kin {
                            net[3 * (spring.b - n_kin) + c][l] -= pull;
                        }
                    }
                }
            }
            for lane in 0..batch.strands.len() {
                let mut worst: f64 = 0.0;
                for p in n_kin..topology.n_rig {
                    let force: f64 = (0..3).map(|c| net[3 * (p - n_kin) + c][lane].powi(2)).sum();
                    worst = worst.max(force.sqrt() / (batch.mass[p][lane] * weight_scale));
                }
                report.max_residual_over_weight = report.max_residual_over_weight.max(worst);
                report.out_of_balance += usize::from(worst > 0.01);
            }
        }
        report
    }
}
