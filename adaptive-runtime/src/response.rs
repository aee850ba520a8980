//! How a strand near solids moves between its contacts, and how it yields to them: a hanging, bending strand about the skinned
//! one, stepped by implicit Euler.
//!
//! Tension from the hair hanging below, bending and a weak spring draw the offset d back:
//! d'' = -c d' - (w² + K/m) d. A step of h solves (1/h² + c/h + w² + K/m) d = d_0 (1/h² + c/h) + v_0/h plus contact over mass. The matrix depends
//! on the material, the spacing of particles and h only, so its inverse is one small table for the whole head: it takes a
//! strand through a step, and its columns are the shapes in which the strand yields to a push at one place.

use crate::kernels::{StepFreely, Yield, run};
use crate::offset::N_FIXED;
use nalgebra::DMatrix;
use strand_sim::Material;

/// Bending stiffness (dyn·cm²) per force of a bend spring (dyn at 1 cm spacing): measured on the straight rig.
const BENDING_PER_SPRING: f64 = 0.07;

/// Least yield of a pushed point as a share of that of the particles beside it.
const LEAST_YIELD: f32 = 0.6;

/// Rate at which offsets of hair of this material return, given that of straight hair, 1/s: a spring of the same mass swings faster by the root of
/// its stiffness, and bending is what draws a curl back to its guides.
pub(crate) fn return_rate(of_straight: f64, material: &Material) -> f64 {
    of_straight * (material.bend_dyn / Material::straight().bend_dyn).max(0.0).sqrt()
}

/// What strands are made of, as far as their offsets feel it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Elasticity<'a> {
    pub spacing_cm: f64,
    pub material: &'a Material,
    pub gravity_cm_per_s2: f64,
    /// Rate w of the spring that draws offsets back, damped critically: c = 2w; 1/s.
    pub return_rate: f64,
}

/// Displacement of every particle under a push at any one, and the step.
#[derive(Clone, Debug)]
pub(crate) struct Response {
    pad: usize,
    /// Factors of the offset and of the velocity on the right side.
    keeps: f32,
    carries: f32,
    /// One row of `pad` values for each particle pushed, zero at the root and in the padding.
    rows: Vec<f32>,
}

impl Response {
    /// Of strands of `n` particles in rows of `pad` values, for steps of `step_s`.
    pub(crate) fn new(n: usize, pad: usize, of: Elasticity, step_s: f64) -> Self {
        let free = n.saturating_sub(N_FIXED);
        let keeps = keeps(of.return_rate, step_s);
        let mut rows = vec![0.0; n * pad];
        // Inertia alone makes the matrix definite, so there is a factor.
        if let Some(factor) = matrix(n, of, step_s).cholesky() {
            let inverse = factor.inverse();
            for i in 0..free {
                for j in 0..free {
                    rows[(i + N_FIXED) * pad + j + N_FIXED] = inverse[(i, j)] as f32;
                }
            }
        }
        Self { pad, keeps: keeps as f32, carries: (1.0 / step_s) as f32, rows }
    }

    /// Where the strand goes in a step if nothing holds it: `skin` and what becomes of the offset; all three arrays of `pad` values.
    pub(crate) fn advance(&self, skin: &[f32], offset: &[f32], velocity: &[f32], x: &mut [f32]) {
        run(StepFreely {
            rows: &self.rows[N_FIXED * self.pad..],
            first: N_FIXED,
            pad: self.pad,
            keeps: self.keeps,
            carries: self.carries,
            skin,
            offset,
            velocity,
            x,
        });
    }

    /// Moves the point at `s` of segment `segment` by `by`, and the strand `x` with it. Next to the root, where the point yields less than
    /// its neighbours, by less; not at all if it cannot move.
    pub(crate) fn push_at(&self, segment: usize, s: f32, by: [f32; 3], x: &mut [f32]) {
        let (a, b) = self.rows[segment * self.pad..(segment + 2) * self.pad].split_at(self.pad);
        let own = (1.0 - s) * ((1.0 - s) * a[segment] + s * b[segment])
            + s * ((1.0 - s) * a[segment + 1] + s * b[segment + 1]);
        // Next to the root a point yields less than what lies beyond it, which no push there may fling about.
        let most = (1.0 - s) * a[segment].max(a[segment + 1]) + s * b[segment].max(b[segment + 1]);
        let yields = own.max(LEAST_YIELD * most);
        let scale = if yields > 0.0 { 1.0 / yields } else { 0.0 };
        run(Yield { shapes: [a, b], weights: [(1.0 - s) * scale, s * scale], by, x });
    }
}

/// Factor of the offset at the start: 1/h² + c/h.
fn keeps(return_rate: f64, step_s: f64) -> f64 {
    1.0 / (step_s * step_s) + 2.0 * return_rate / step_s
}

/// 1/h² + c/h + w² + K/m over the particles that move.
fn matrix(n: usize, of: Elasticity, step_s: f64) -> DMatrix<f64> {
    let free = n.saturating_sub(N_FIXED);
    let Elasticity { spacing_cm: h, material, gravity_cm_per_s2, return_rate } = of;
    let mut matrix = DMatrix::<f64>::identity(free, free) * (keeps(return_rate, step_s) + return_rate * return_rate);
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
    matrix
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_model::Noise;
    use nalgebra::DVector;

    const PAD: usize = 32;

    fn response() -> Response {
        let material = Material::straight();
        let of = Elasticity { spacing_cm: 1.0, material: &material, gravity_cm_per_s2: 981.0, return_rate: 5.0 };
        Response::new(25, PAD, of, 0.01)
    }

    /// Displacement of all particles when the point at `s` of `segment` is moved by one.
    fn shape_at(segment: usize, s: f32) -> Vec<f32> {
        let mut x = vec![0.0; 3 * PAD];
        response().push_at(segment, s, [1.0, 0.0, 0.0], &mut x);
        x.truncate(PAD);
        x
    }

    #[test]
    fn an_offset_left_alone_comes_to_rest_and_its_energy_never_grows() {
        let response = response();
        let (skin, mut velocity) = (vec![0.0; 3 * PAD], vec![0.0; 3 * PAD]);
        let mut offset = vec![0.0; 3 * PAD];
        offset[..PAD].copy_from_slice(&shape_at(12, 0.5));
        let mut x = vec![0.0; 3 * PAD];
        let mut size = f32::INFINITY;
        for step in 0..300 {
            response.advance(&skin, &offset, &velocity, &mut x);
            for i in 0..3 * PAD {
                velocity[i] = (x[i] - offset[i]) / 0.01;
            }
            offset.copy_from_slice(&x);
            let now: f32 = offset.iter().map(|d| d * d).sum::<f32>().sqrt();
            assert!(step % 100 != 99 || now < 0.3 * size, "{step} {now} {size}");
            if step % 100 == 99 {
                size = now;
            }
        }
        assert!(size < 1e-3);
    }

    #[test]
    fn a_step_solves_its_equation_and_a_push_is_a_force_at_one_place() {
        /// Of the right side, in single precision, times what sums of 23 terms lose.
        const ROUND_OFF: f64 = 1e-5;
        let material = Material::straight();
        let mut noise = Noise::new(3);
        for step_s in [0.01, 0.00125] {
            let of = Elasticity { spacing_cm: 1.0, material: &material, gravity_cm_per_s2: 981.0, return_rate: 5.0 };
            let (response, matrix) = (Response::new(25, PAD, of, step_s), matrix(25, of, step_s));
            let free = |x: &[f32]| DVector::from_iterator(25 - N_FIXED, x[N_FIXED..25].iter().map(|&x| f64::from(x)));
            let mut random = |size: f32| -> Vec<f32> { (0..3 * PAD).map(|_| size * (noise.next() - 0.5)).collect() };
            let (offset, velocity) = (random(2.0), random(40.0));
            let mut x = vec![0.0; 3 * PAD];
            response.advance(&vec![0.0; 3 * PAD], &offset, &velocity, &mut x);
            for c in 0..3 {
                let part = |v: &[f32]| free(&v[c * PAD..(c + 1) * PAD]);
                let right = part(&offset) * keeps(5.0, step_s) + part(&velocity) / step_s;
                let residual = &matrix * part(&x) - &right;
                assert!(residual.amax() < ROUND_OFF * right.amax(), "{} of {}", residual.amax(), right.amax());
            }
            // What moves a point is a force on the two particles beside it, shared as the point is.
            let (segment, s) = (12, 0.3);
            let mut x = vec![0.0; 3 * PAD];
            response.push_at(segment, s, [0.2, 0.0, 0.0], &mut x);
            let force = &matrix * free(&x[..PAD]);
            let (a, b) = (force[segment - N_FIXED], force[segment + 1 - N_FIXED]);
            assert!((a / (a + b) - 0.7).abs() < 1e-4, "{a} {b}");
            for (i, f) in force.iter().enumerate() {
                let at = i + N_FIXED;
                assert!(at == segment || at == segment + 1 || f.abs() < 1e-4 * (a + b), "{at}: {f}");
            }
        }
    }

    #[test]
    fn two_offsets_step_as_their_sum_does() {
        let response = response();
        let (skin, still) = (vec![0.0; 3 * PAD], vec![0.0; 3 * PAD]);
        let step = |offset: &[f32]| {
            let mut x = vec![0.0; 3 * PAD];
            response.advance(&skin, offset, &still, &mut x);
            x
        };
        let (mut a, mut b) = (vec![0.0; 3 * PAD], vec![0.0; 3 * PAD]);
        a[..PAD].copy_from_slice(&shape_at(8, 0.2));
        b[PAD..2 * PAD].copy_from_slice(&shape_at(20, 0.7));
        let both: Vec<f32> = a.iter().zip(&b).map(|(a, b)| a + b).collect();
        for ((x, y), z) in step(&a).iter().zip(step(&b)).zip(step(&both)) {
            assert!((x + y - z).abs() < 1e-5);
        }
    }

    #[test]
    fn the_pushed_point_moves_by_one_and_the_root_not_at_all() {
        for segment in 2..24 {
            for s in [0.0, 0.3, 1.0] {
                let shape = shape_at(segment, s);
                let there = (1.0 - s) * shape[segment] + s * shape[segment + 1];
                assert!((there - 1.0).abs() < 1e-5, "{segment} {s} {there}");
                assert!(shape.iter().all(|x| x.abs() < 1.5), "nothing moves much farther than what is pushed");
                assert!(shape[..N_FIXED].iter().chain(&shape[25..]).all(|&x| x == 0.0));
            }
        }
    }

    #[test]
    fn a_push_beside_the_root_flings_nothing() {
        for s in [0.0, 1e-6, 0.01, 0.3, 1.0] {
            let shape = shape_at(N_FIXED - 1, s);
            assert!(shape.iter().all(|x| x.abs() < 2.5), "{s} {shape:?}");
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
        let shape = shape_at(12, 0.0);
        assert!(shape[3].abs() < 0.1 && shape[24].abs() < 0.1, "{shape:?}");
        assert!(shape[11] > 0.5 && shape[13] > 0.5, "{shape:?}");
    }
}
