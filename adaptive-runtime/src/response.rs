//! How a strand yields where a solid pushes it: the shape of a hanging, bending strand held away at one point.
//!
//! A strand pushed at one place is drawn along by its weight and its stiffness near that place, and by its inertia not far
//! from it. The shape is that of the linearised strand under a point force acting for a stated time,
//! (1/τ² + K/m) d = f/m with K the tension of the hair hanging below and the bending stiffness; it depends on the material and the spacing of
//! particles only, so it is one small table for the whole head.

use crate::offset::N_FIXED;
use nalgebra::DMatrix;
use strand_sim::Material;

/// Bending stiffness (dyn·cm²) per force of a bend spring (dyn at 1 cm spacing): measured on the straight rig.
const BENDING_PER_SPRING: f64 = 0.07;

/// Displacement of every particle under a push at any one.
#[derive(Clone, Debug)]
pub(crate) struct Response {
    pad: usize,
    /// One row of `pad` values for each particle pushed, zero at the root and in the padding.
    rows: Vec<f32>,
}

impl Response {
    /// Of strands of `n` particles, `spacing_cm` apart, in rows of `pad` values.
    pub(crate) fn new(
        n: usize,
        pad: usize,
        spacing_cm: f64,
        material: &Material,
        gravity_cm_per_s2: f64,
        time_s: f64,
    ) -> Self {
        let free = n.saturating_sub(N_FIXED);
        let h = spacing_cm;
        let mut matrix = DMatrix::<f64>::identity(free, free) / (time_s * time_s);
        let mut add = |i: usize, j: usize, value: f64| {
            if i >= N_FIXED && j >= N_FIXED {
                matrix[(i - N_FIXED, j - N_FIXED)] += value;
            }
        };
        for j in N_FIXED.saturating_sub(1)..n.saturating_sub(1) {
            // The weight below the middle of the segment, over the particles' mass and spacing.
            let string = gravity_cm_per_s2 * ((n - 1 - j) as f64 - 0.5) / h;
            for (a, b, sign) in [(j, j, 1.0), (j + 1, j + 1, 1.0), (j, j + 1, -1.0), (j + 1, j, -1.0)] {
                add(a, b, sign * string);
            }
        }
        let mass = material.linear_density_g_per_cm * h;
        let beam = BENDING_PER_SPRING * material.bend_dyn / (h * h * h * mass);
        for i in N_FIXED..n.saturating_sub(1) {
            const STENCIL: [f64; 3] = [1.0, -2.0, 1.0];
            for a in 0..3 {
                for b in 0..3 {
                    add(i + a - 1, i + b - 1, beam * STENCIL[a] * STENCIL[b]);
                }
            }
        }
        let mut rows = vec![0.0; n * pad];
        // Inertia alone makes the matrix definite, so there is a factor.
        if let Some(factor) = matrix.cholesky() {
            let inverse = factor.inverse();
            for i in 0..free {
                for j in 0..free {
                    rows[(i + N_FIXED) * pad + j + N_FIXED] = inverse[(i, j)] as f32;
                }
            }
        }
        Self { pad, rows }
    }

    /// Displacement of all particles when the point at `s` of segment `segment` is moved by one, into `out` (`pad` values).
    /// All zero if that point cannot move.
    #[inline(always)]
    pub(crate) fn to_push_at(&self, segment: usize, s: f32, out: &mut [f32]) {
        let (a, b) = self.rows[segment * self.pad..(segment + 2) * self.pad].split_at(self.pad);
        let own = (1.0 - s) * ((1.0 - s) * a[segment] + s * b[segment])
            + s * ((1.0 - s) * a[segment + 1] + s * b[segment + 1]);
        let scale = if own > 0.0 { 1.0 / own } else { 0.0 };
        let (wa, wb) = ((1.0 - s) * scale, s * scale);
        for ((o, x), y) in out.iter_mut().zip(a).zip(b) {
            *o = wa * *x + wb * *y;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAD: usize = 32;

    fn response() -> Response {
        Response::new(25, PAD, 1.0, &Material::straight(), 981.0, 0.03)
    }

    #[test]
    fn the_pushed_point_moves_by_one_and_the_root_not_at_all() {
        let mut shape = [0.0; PAD];
        for segment in 2..24 {
            for s in [0.0, 0.3, 1.0] {
                response().to_push_at(segment, s, &mut shape);
                let there = (1.0 - s) * shape[segment] + s * shape[segment + 1];
                assert!((there - 1.0).abs() < 1e-5);
                assert!(shape[..N_FIXED].iter().chain(&shape[25..]).all(|&x| x == 0.0));
            }
        }
    }

    #[test]
    fn a_push_is_answered_alike_both_ways() {
        // Maxwell's reciprocity: the table is symmetric.
        let response = response();
        for i in 0..25 {
            for j in 0..25 {
                let (a, b) = (response.rows[i * PAD + j], response.rows[j * PAD + i]);
                assert!((a - b).abs() <= 1e-6 * a.abs().max(1e-12));
            }
        }
    }

    #[test]
    fn what_is_far_from_the_push_moves_little() {
        let mut shape = [0.0; PAD];
        response().to_push_at(12, 0.0, &mut shape);
        assert!(shape[3].abs() < 0.2 && shape[24].abs() < 0.5, "{shape:?}");
        assert!(shape[11] > 0.7 && shape[13] > 0.7, "{shape:?}");
    }
}
