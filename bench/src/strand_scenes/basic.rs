//! The basic mass/spring model that MS08 Fig. 13(a) shows hair stretch in: edge and bending springs, nothing else.
//!
//! No torsion, no altitude springs, no perturbed particles, no strain limit, no hair-hair interaction, and explicit
//! integration: velocities from forces, positions from velocities (symplectic Euler). An explicit step bounds the
//! stiffness that springs may have (dt < 2 √(m/k)), which is why such hair stretches: it is as stiff as its step allows.
//! A baseline to compare with; nothing else of the workspace uses it.

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

/// Constants of the basic model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BasicParams {
    /// Length of an explicit step, s.
    pub dt: f64,
    /// Mass per length, g/cm.
    pub linear_density_g_per_cm: f64,
    /// Air drag, 1/s.
    pub drag_per_s: f64,
    /// Acceleration of gravity, cm/s².
    pub gravity: Vector3<f64>,
    /// Bending springs over edge springs.
    pub bend_share: f64,
    /// Damping of the springs as a share of the critical one.
    pub damping: f64,
}

/// Share of the stability bound of an explicit step that the springs use.
const OF_STABLE: f64 = 0.5;

/// Particles at the root that move with the scalp, as many as give the hair a direction.
const KINEMATIC: usize = 2;

impl BasicParams {
    /// MS08's typical step of 0.6 ms, and springs as stiff as it carries.
    #[must_use]
    pub fn paper() -> Self {
        Self {
            dt: 6e-4,
            linear_density_g_per_cm: 5e-5,
            drag_per_s: 1.0,
            gravity: Vector3::new(0.0, -981.0, 0.0),
            bend_share: 0.1,
            damping: 0.1,
        }
    }

    /// Stiffness per length (dyn/cm) of edge springs between particles `spacing_cm` apart.
    #[must_use]
    pub fn edge_per_cm(&self, spacing_cm: f64) -> f64 {
        // The fastest mode of a chain of equal masses has ω² = 4 k/m, and bending springs add their share of it.
        let mass = self.linear_density_g_per_cm * spacing_cm;
        OF_STABLE * OF_STABLE * mass / (self.dt * self.dt * (1.0 + self.bend_share))
    }
}

/// Hair of the basic model.
#[derive(Clone, Debug)]
pub struct BasicHair {
    params: BasicParams,
    n: usize,
    rest: Vec<Vector3<f64>>,
    position: Vec<Vector3<f64>>,
    velocity: Vec<Vector3<f64>>,
}

impl BasicHair {
    /// Strands of `n` points each (strand-major, root first, cm), still.
    #[must_use]
    pub fn new(points: &[Vector3<f64>], n: usize, params: BasicParams) -> Self {
        Self {
            params,
            n,
            rest: points.to_vec(),
            position: points.to_vec(),
            velocity: vec![Vector3::zeros(); points.len()],
        }
    }

    /// Positions, strand-major, root first, cm.
    #[must_use]
    pub fn positions(&self) -> &[Vector3<f64>] {
        &self.position
    }

    /// Advances by `dt` seconds while the head goes from one pose to another.
    pub fn step(&mut self, dt: f64, before: &Isometry3<f64>, after: &Isometry3<f64>) {
        let n_sub = (dt / self.params.dt).ceil().max(1.0) as usize;
        let h = dt / n_sub as f64;
        let (params, n) = (self.params, self.n);
        let strands = self.position.par_chunks_mut(n).zip(self.velocity.par_chunks_mut(n)).zip(self.rest.par_chunks(n));
        strands.for_each(|((position, velocity), rest)| {
            let spacing = rest.windows(2).map(|w| (w[1] - w[0]).norm()).sum::<f64>() / (n - 1) as f64;
            let mass = params.linear_density_g_per_cm * spacing;
            let edge = params.edge_per_cm(spacing);
            for k in 1..=n_sub {
                let pose = before.lerp_slerp(after, k as f64 / n_sub as f64);
                for i in 0..KINEMATIC {
                    let target = (pose * Point3::from(rest[i])).coords;
                    velocity[i] = (target - position[i]) / h;
                    position[i] = target;
                }
                for (apart, stiffness) in [(1, edge), (2, params.bend_share * edge)] {
                    let damping = params.damping * 2.0 * (stiffness * mass).sqrt();
                    for i in 0..n - apart {
                        let j = i + apart;
                        let (x, length) = (position[j] - position[i], (rest[j] - rest[i]).norm());
                        let Some(d) = x.try_normalize(1e-9) else { continue };
                        let pull = stiffness * (x.norm() - length) + damping * d.dot(&(velocity[j] - velocity[i]));
                        let kick = d * (pull * h / mass);
                        velocity[i] += kick;
                        velocity[j] -= kick;
                    }
                }
                for i in KINEMATIC..n {
                    velocity[i] = (velocity[i] + params.gravity * h) / (1.0 + h * params.drag_per_s);
                    position[i] += velocity[i] * h;
                }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strand_scenes::straight_strand;

    #[test]
    fn a_hanging_chain_stretches_by_the_weight_below_each_spring() {
        /// Of the stretch at the root: bending springs carry the ends a little otherwise, and swinging dies out.
        const SHARE: f64 = 0.03;
        let params = BasicParams { bend_share: 0.0, drag_per_s: 20.0, ..BasicParams::paper() };
        let n = 26;
        let rest = straight_strand(Vector3::zeros(), -Vector3::y(), 25.0, n);
        let mut hair = BasicHair::new(&rest, n, params);
        let pose = Isometry3::identity();
        for _ in 0..400 {
            hair.step(0.01, &pose, &pose);
        }
        let x = hair.positions();
        let stretch = (x[2] - x[1]).norm() - 1.0;
        let expected = 24.0 * params.linear_density_g_per_cm * 981.0 / params.edge_per_cm(1.0);
        assert!((stretch / expected - 1.0).abs() < SHARE, "{stretch} for {expected}");
    }
}
