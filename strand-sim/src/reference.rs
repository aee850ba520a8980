//! One strand, one step, written plainly: what the batched solve of [`crate::StrandSystem`] is held to, in result and in
//! time.
//!
//! Backward Euler with directions frozen (MS08 §4.1), springs and altitude springs entry by entry into a scalar band, its
//! Cholesky factor, then strain limiting (MS08 §4.2). No solids, no wind, no other hair.

use crate::altitude::{AltitudeRest, altitude};
use crate::rig::{ALTITUDE, N_CONSTANTS, Topology};
use crate::solve::jacobi_cg::{PRESCRIBED, SpringTerm};
use crate::step::StepParams;
use crate::system::{StrandState, StrandSystem, get, transform};
use crate::wind::ALONG_OVER_ACROSS;
use nalgebra::{Isometry3, Matrix3, Vector3};

/// One altitude spring of a step: its length grows by Σ slope·x over its corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AltitudeTerm {
    /// Free rig particles of the tetrahedron, [`PRESCRIBED`] for those that are not free.
    pub corners: [usize; 4],
    /// Change of length with each corner.
    pub slope: [Vector3<f64>; 4],
    /// Impulse at the start of the step, g·cm/s: corner c gets minus it times its slope.
    pub pull: f64,
    /// Further impulse per rate of length, g.
    pub along: f64,
}

/// A strand taken out of its batch.
#[derive(Clone, Debug)]
pub struct PlainStrand {
    topology: Topology,
    rest_in_head: Vec<Vector3<f64>>,
    mass: Vec<f64>,
    stiffness: [f64; N_CONSTANTS],
    damping: [f64; N_CONSTANTS],
    inv_rest_length: Vec<f64>,
    altitude_rest: Vec<AltitudeRest>,
    segment_length: Vec<f64>,
    drag_per_s: f64,
    /// Rig particles, cm.
    position: Vec<Vector3<f64>>,
    /// Rig particles, cm/s.
    velocity: Vec<Vector3<f64>>,
    band: Vec<f64>,
    rhs: Vec<f64>,
}

impl PlainStrand {
    /// Strand `strand` of a system, as it is in `state`.
    ///
    /// # Panics
    /// If the system has no such strand or the state is of another system.
    #[must_use]
    pub fn of(system: &StrandSystem, state: &StrandState, strand: usize) -> Self {
        let (b, lane) = system.place[strand];
        let (batch, state, lane) = (&system.batches[b as usize], &state.batches[b as usize], lane as usize);
        let topology = system.topologies[batch.topology].clone();
        let n = 3 * (topology.n_rig - topology.n_kinematic);
        Self {
            rest_in_head: batch.rest_in_head.iter().map(|v| get(v, lane)).collect(),
            mass: batch.mass.iter().map(|m| m[lane]).collect(),
            stiffness: batch.stiffness.map(|k| k[lane]),
            damping: batch.damping.map(|b| b[lane]),
            inv_rest_length: batch.inv_rest_length.iter().map(|l| l[lane]).collect(),
            altitude_rest: batch.altitude_rest.iter().map(|r| r.get(lane)).collect(),
            segment_length: batch.segment_length.iter().map(|l| l[lane]).collect(),
            drag_per_s: system.material.air_drag_per_s,
            position: state.position.iter().map(|v| get(v, lane)).collect(),
            velocity: state.velocity.iter().map(|v| get(v, lane)).collect(),
            band: vec![0.0; n * 3 * (topology.reach + 1)],
            rhs: vec![0.0; n],
            topology,
        }
    }

    /// Position of the hair's `i`-th particle, cm.
    #[must_use]
    pub fn position(&self, i: usize) -> Vector3<f64> {
        self.position[self.topology.rig_of_main(i)]
    }

    /// One step of `h` seconds that ends with the head at `world_from_head`; of `params`, gravity and strain limit are
    /// read.
    pub fn step(&mut self, h: f64, world_from_head: &Isometry3<f64>, params: &StepParams) {
        let n_kin = self.topology.n_kinematic;
        for p in 0..n_kin {
            self.velocity[p] = (transform(world_from_head, self.rest_in_head[p]) - self.position[p]) / h;
        }
        self.assemble(h, params.gravity);
        factor(&mut self.band, self.rhs.len(), 3 * (self.topology.reach + 1));
        solve(&self.band, &mut self.rhs, 3 * (self.topology.reach + 1));
        for (p, v) in self.velocity.iter_mut().enumerate().skip(n_kin) {
            *v = Vector3::from_column_slice(&self.rhs[3 * (p - n_kin)..3 * (p - n_kin) + 3]);
        }
        for (x, v) in self.position.iter_mut().zip(&self.velocity) {
            *x += v * h;
        }
        for i in self.topology.first_free_main()..self.topology.n_main {
            let longest = (1.0 + params.strain_limit) * self.segment_length[i - 1];
            let (near, far) = (self.topology.rig_of_main(i - 1), self.topology.rig_of_main(i));
            self.pull_to(near, far, longest);
            if let Some(q) = self.topology.rig_of_perturbed(i - 1).filter(|&q| q >= n_kin) {
                self.pull_to(near, q, longest);
            }
        }
    }

    /// Springs of the linear system of a step of `h` seconds, for a solver that takes them one by one; altitude springs
    /// left out. Unknowns are the free rig particles; `masses` gives their diagonal.
    #[must_use]
    pub fn spring_terms(&self, h: f64) -> Vec<SpringTerm> {
        let n_kin = self.topology.n_kinematic;
        let unknown = |p: usize| p.checked_sub(n_kin).unwrap_or(PRESCRIBED);
        let springs = self.topology.springs.iter().zip(&self.inv_rest_length).filter(|(s, _)| s.b >= n_kin);
        springs
            .map(|(s, inv_rest)| {
                let (k, b) = (self.stiffness[s.kind as usize], self.damping[s.kind as usize]);
                let direction = (self.position[s.b] - self.position[s.a]).normalize();
                SpringTerm {
                    a: unknown(s.a),
                    b: unknown(s.b),
                    direction,
                    along: h * (h * k * inv_rest + b),
                    around: 0.0,
                }
            })
            .collect()
    }

    /// The altitude springs as a step of `h` seconds takes them, directions frozen where the strand is.
    #[must_use]
    pub fn altitude_terms(&self, h: f64) -> Vec<AltitudeTerm> {
        let n_kin = self.topology.n_kinematic;
        let terms = (0..self.topology.n_tetrahedra()).filter_map(|first| {
            let x = [first, first + 1, first + 2, first + 3];
            let a = altitude(&x.map(|p| self.position[p]), &self.altitude_rest[first])?;
            let k = self.stiffness[ALTITUDE] * a.per_length;
            Some(AltitudeTerm {
                corners: x.map(|p| p.checked_sub(n_kin).unwrap_or(PRESCRIBED)),
                slope: a.weight.map(|w| a.direction * w),
                pull: h * k * (a.length - a.rest_length),
                along: h * (h * k + self.damping[ALTITUDE]),
            })
        });
        terms.collect()
    }

    /// Masses of the free rig particles, g.
    #[must_use]
    pub fn masses(&self) -> &[f64] {
        &self.mass[self.topology.n_kinematic..]
    }

    /// Velocities of the free rig particles, cm/s.
    #[must_use]
    pub fn velocities(&self) -> &[Vector3<f64>] {
        &self.velocity[self.topology.n_kinematic..]
    }

    /// Right side of a step of `h` seconds: momentum, and impulses of gravity, springs and prescribed particles; altitude
    /// springs and drag left out.
    #[must_use]
    pub fn right_side(&self, h: f64, gravity: Vector3<f64>) -> Vec<Vector3<f64>> {
        let n_kin = self.topology.n_kinematic;
        let mut out: Vec<_> =
            (n_kin..self.topology.n_rig).map(|p| (self.velocity[p] + gravity * h) * self.mass[p]).collect();
        for (s, inv_rest) in self.topology.springs.iter().zip(&self.inv_rest_length).filter(|(s, _)| s.b >= n_kin) {
            let (k, b) = (self.stiffness[s.kind as usize], self.damping[s.kind as usize]);
            let e = self.position[s.b] - self.position[s.a];
            let d = e.normalize();
            let impulse = d * (h * k * (e.norm() * inv_rest - 1.0));
            out[s.b - n_kin] -= impulse;
            if s.a >= n_kin {
                out[s.a - n_kin] += impulse;
            } else {
                out[s.b - n_kin] += d * (h * (h * k * inv_rest + b) * d.dot(&self.velocity[s.a]));
            }
        }
        out
    }

    fn assemble(&mut self, h: f64, gravity: Vector3<f64>) {
        self.band.fill(0.0);
        self.rhs.fill(0.0);
        let n_kin = self.topology.n_kinematic;
        for p in n_kin..self.topology.n_rig {
            let (near, far) = self.topology.around[p];
            let t = (self.position[far] - self.position[near]).normalize();
            let drag = Matrix3::identity() + t * t.transpose() * (ALONG_OVER_ACROSS - 1.0);
            self.add_block(p, p, &((Matrix3::identity() + drag * (h * self.drag_per_s)) * self.mass[p]));
            self.push(p, (self.velocity[p] + gravity * h) * self.mass[p]);
        }
        for k in 0..self.topology.springs.len() {
            let s = self.topology.springs[k];
            let (stiffness, damping) = (self.stiffness[s.kind as usize], self.damping[s.kind as usize]);
            let e = self.position[s.b] - self.position[s.a];
            let d = e.normalize();
            let tension = stiffness * (e.norm() * self.inv_rest_length[k] - 1.0);
            let coefficient = h * (h * stiffness * self.inv_rest_length[k] + damping);
            self.add_rank_one(&[(s.a, -1.0), (s.b, 1.0)], d, h * tension, coefficient);
        }
        for first in 0..self.topology.n_tetrahedra() {
            let x = [first, first + 1, first + 2, first + 3];
            let Some(a) = altitude(&x.map(|p| self.position[p]), &self.altitude_rest[first]) else { continue };
            let k = self.stiffness[ALTITUDE] * a.per_length;
            let coefficient = h * (h * k + self.damping[ALTITUDE]);
            let ends = [0, 1, 2, 3].map(|c| (x[c], a.weight[c]));
            self.add_rank_one(&ends, a.direction, h * k * (a.length - a.rest_length), coefficient);
        }
    }

    /// Adds the spring whose length grows by Σ w d·x: `pull` is its impulse, `coefficient` its impulse per velocity.
    fn add_rank_one(&mut self, ends: &[(usize, f64)], d: Vector3<f64>, pull: f64, coefficient: f64) {
        let n_kin = self.topology.n_kinematic;
        let known: f64 = ends.iter().filter(|e| e.0 < n_kin).map(|&(p, w)| w * d.dot(&self.velocity[p])).sum();
        for &(p, w) in ends.iter().filter(|e| e.0 >= n_kin) {
            self.push(p, d * (-w * (pull + coefficient * known)));
            for &(q, u) in ends.iter().filter(|e| e.0 >= n_kin && e.0 <= p) {
                self.add_block(p, q, &(d * d.transpose() * (coefficient * w * u)));
            }
        }
    }

    fn push(&mut self, p: usize, impulse: Vector3<f64>) {
        let at = 3 * (p - self.topology.n_kinematic);
        for c in 0..3 {
            self.rhs[at + c] += impulse[c];
        }
    }

    fn add_block(&mut self, p: usize, q: usize, block: &Matrix3<f64>) {
        let (n_kin, width) = (self.topology.n_kinematic, 3 * (self.topology.reach + 1));
        for r in 0..3 {
            for c in 0..3 {
                let (row, col) = (3 * (p - n_kin) + r, 3 * (q - n_kin) + c);
                if col <= row {
                    self.band[row * width + width - 1 + col - row] += block[(r, c)];
                }
            }
        }
    }

    fn pull_to(&mut self, near: usize, far: usize, longest: f64) {
        let e = self.position[far] - self.position[near];
        if e.norm() > longest {
            self.position[far] = self.position[near] + e * (longest / e.norm());
        }
    }
}

/// Cholesky factor of a symmetric band: row by row, `width` entries each, the last of them the diagonal.
fn factor(band: &mut [f64], n: usize, width: usize) {
    for row in 0..n {
        for col in row.saturating_sub(width - 1)..=row {
            let mut sum = band[row * width + width - 1 + col - row];
            for k in row.saturating_sub(width - 1)..col {
                if k + width > col {
                    sum -= band[row * width + width - 1 + k - row] * band[col * width + width - 1 + k - col];
                }
            }
            band[row * width + width - 1 + col - row] =
                if col == row { sum.sqrt() } else { sum / band[col * width + width - 1] };
        }
    }
}

fn solve(band: &[f64], rhs: &mut [f64], width: usize) {
    let n = rhs.len();
    for row in 0..n {
        let mut sum = rhs[row];
        for col in row.saturating_sub(width - 1)..row {
            sum -= band[row * width + width - 1 + col - row] * rhs[col];
        }
        rhs[row] = sum / band[row * width + width - 1];
    }
    for row in (0..n).rev() {
        rhs[row] /= band[row * width + width - 1];
        for col in row.saturating_sub(width - 1)..row {
            rhs[col] -= band[row * width + width - 1 + col - row] * rhs[row];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Material, StepInput, StepWorkspace, Substeps};
    use nalgebra::Translation3;

    /// What two orders of summation may differ by after half a second of shaking, cm.
    const GROWN_ROUND_OFF_CM: f64 = 1e-6;

    #[test]
    fn the_batched_step_agrees_with_the_plain_one() {
        let mut points = Vec::new();
        for s in 0..11 {
            let mut at = Vector3::new(f64::from(s), 0.0, 0.0);
            for i in 0..25 {
                points.push(at);
                // Straight, curly, and straight with a curly end.
                let turn = [0.0, 0.9, if i < 12 { 0.0 } else { 0.9 }][s as usize % 3] * f64::from(i);
                let side = if turn == 0.0 { 0.1 } else { 0.7 };
                at += Vector3::new(side * turn.cos(), -0.7, side * turn.sin());
            }
        }
        let system = StrandSystem::new(&points, 25, Material::straight()).expect("valid strands");
        let params = StepParams { substeps: Substeps::Fixed(1), ..StepParams::standard() };
        let head = |k: u32| Isometry3::from(Translation3::new((0.4 * f64::from(k)).sin(), 0.0, 0.0));
        let mut state = system.rest_state(&head(0));
        let mut plain: Vec<_> = (0..11).map(|s| PlainStrand::of(&system, &state, s)).collect();
        let mut workspace = StepWorkspace::default();
        for k in 0..100 {
            system.step(&mut state, &StepInput::carried(0.005, head(k), head(k + 1)), &params, &mut workspace);
            for (s, strand) in plain.iter_mut().enumerate() {
                strand.step(0.005, &head(k + 1), &params);
                assert_eq!(
                    strand.topology.perturbed,
                    system.topologies[system.batches[system.place[s].0 as usize].topology].perturbed
                );
            }
        }
        let positions = system.positions(&state);
        for (s, strand) in plain.iter().enumerate() {
            for i in 0..25 {
                let off = (strand.position(i) - positions[25 * s + i]).norm();
                assert!(off < GROWN_ROUND_OFF_CM, "strand {s} particle {i}: {off} cm");
            }
        }
        let moved = positions.iter().zip(&points).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(moved > 1.0, "the strands were to move");
    }
}
