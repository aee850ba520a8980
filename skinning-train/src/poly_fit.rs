//! Quadratics along the strand: AS16 Eq. (8), in u = i / (n - 1) with i from 0 (the paper counts particles from 1, and fits
//! in i itself; the curve is the same).
//!
//! The fit is linear in the weights, by one matrix that depends only on the particle count. So the fits of one set sum to
//! exactly one, as the weights do, before negative values are clamped and the rest normalised; that is done wherever the
//! weights are used, here as in the runtime.

use io_formats::WeightPoly;
use nalgebra::{DMatrix, Matrix2, Matrix3, Vector2, Vector3};

/// quad u² + lin u + con, as fitted.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Quadratic {
    /// Coefficient of u².
    pub quad: f64,
    /// Coefficient of u.
    pub lin: f64,
    /// Value at the root.
    pub con: f64,
}

impl Quadratic {
    /// The value at `u` in 0 (root) to 1 (tip).
    #[must_use]
    pub fn at(&self, u: f64) -> f64 {
        (self.quad * u + self.lin) * u + self.con
    }

    /// Half-precision bits, as the model file keeps them.
    #[must_use]
    pub fn to_bits(&self) -> [u16; 3] {
        WeightPoly { quad: self.quad as f32, lin: self.lin as f32, con: self.con as f32 }.to_bits()
    }

    /// What half-precision bits stand for.
    #[must_use]
    pub fn from_bits(bits: [u16; 3]) -> Self {
        let p = WeightPoly::from_bits(bits);
        Self { quad: f64::from(p.quad), lin: f64::from(p.lin), con: f64::from(p.con) }
    }
}

/// cub u³ + quad u² + lin u + con: no model keeps it, only errors are compared (AS16 §6.1).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cubic {
    /// Coefficient of u³.
    pub cub: f64,
    /// The rest.
    pub rest: Quadratic,
}

impl Cubic {
    /// The value at `u` in 0 (root) to 1 (tip).
    #[must_use]
    pub fn at(&self, u: f64) -> f64 {
        ((self.cub * u + self.rest.quad) * u + self.rest.lin) * u + self.rest.con
    }
}

/// The least-squares projections for one particle count.
#[derive(Debug, Clone, PartialEq)]
pub struct PolyFit {
    /// u of each particle.
    pub u: Vec<f64>,
    /// Per particle, what a unit of weight there adds to quad, lin, con.
    pub quadratic: Vec<[f64; 3]>,
    /// Per particle, what a unit of weight there adds to slope and value at the root of the best straight line.
    pub linear: Vec<[f64; 2]>,
    /// Per particle, what a unit of weight there adds to cub, quad, lin, con; of three particles, the quadratic.
    pub cubic: Vec<[f64; 4]>,
}

impl PolyFit {
    /// The projections for strands of `n_particles`; `None` with fewer than three, which no quadratic fits uniquely.
    #[must_use]
    pub fn new(n_particles: usize) -> Option<Self> {
        if n_particles < 3 {
            return None;
        }
        let u: Vec<f64> = (0..n_particles).map(|i| i as f64 / (n_particles - 1) as f64).collect();
        let basis = DMatrix::from_fn(n_particles, 3, |i, d| u[i].powi(2 - d as i32));
        let products = basis.transpose() * &basis;
        let square: Matrix3<f64> = products.fixed_view::<3, 3>(0, 0).into_owned();
        let inverse = square.try_inverse()?;
        let line: Matrix2<f64> = products.fixed_view::<2, 2>(1, 1).into_owned();
        let line_inverse = line.try_inverse()?;
        let quadratic: Vec<[f64; 3]> = u.iter().map(|&u| (inverse * Vector3::new(u * u, u, 1.0)).into()).collect();
        let linear = u.iter().map(|&u| (line_inverse * Vector2::new(u, 1.0)).into()).collect();
        let cubic = if n_particles == 3 {
            quadratic.iter().map(|&[quad, lin, con]| [0.0, quad, lin, con]).collect()
        } else {
            // Not by the normal equations, whose condition is the square of this one's.
            let basis = DMatrix::from_fn(n_particles, 4, |i, d| u[i].powi(3 - d as i32));
            let inverse = basis.pseudo_inverse(f64::EPSILON).ok()?;
            inverse.column_iter().map(|c| [c[0], c[1], c[2], c[3]]).collect()
        };
        Some(Self { u, quadratic, linear, cubic })
    }

    /// Number of particles.
    #[must_use]
    pub fn n_particles(&self) -> usize {
        self.u.len()
    }

    /// The quadratic nearest to `weights`, one per particle.
    /// Implements AS16 Eq. (8), all particles counting alike.
    ///
    /// # Panics
    /// If there are fewer weights than particles.
    #[must_use]
    pub fn fit(&self, weights: &[f64]) -> Quadratic {
        let mut q = Quadratic::default();
        for (i, share) in self.quadratic.iter().enumerate() {
            q.quad += share[0] * weights[i];
            q.lin += share[1] * weights[i];
            q.con += share[2] * weights[i];
        }
        q
    }

    /// The straight line nearest to `weights`, as a quadratic without curvature: what AS16 §6.1 compares with.
    ///
    /// # Panics
    /// If there are fewer weights than particles.
    #[must_use]
    pub fn fit_line(&self, weights: &[f64]) -> Quadratic {
        let mut q = Quadratic::default();
        for (i, share) in self.linear.iter().enumerate() {
            q.lin += share[0] * weights[i];
            q.con += share[1] * weights[i];
        }
        q
    }

    /// The cubic nearest to `weights`, one per particle.
    ///
    /// # Panics
    /// If there are fewer weights than particles.
    #[must_use]
    pub fn fit_cubic(&self, weights: &[f64]) -> Cubic {
        let mut q = Cubic::default();
        for (i, share) in self.cubic.iter().enumerate() {
            q.cub += share[0] * weights[i];
            q.rest.quad += share[1] * weights[i];
            q.rest.lin += share[2] * weights[i];
            q.rest.con += share[3] * weights[i];
        }
        q
    }
}

/// Evaluates the quadratics of one set at `u`, clamps negative values and scales the rest to sum to one; weights past the
/// set are left. The unclamped sum is one, so what remains cannot vanish.
pub fn weights_at(set: &[Quadratic], u: f64, out: &mut [f64]) {
    let mut total = 0.0;
    for (w, q) in out.iter_mut().zip(set) {
        *w = q.at(u).max(0.0);
        total += *w;
    }
    for w in &mut out[..set.len()] {
        *w /= total;
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    /// Round-off of a 3 x 3 normal system with condition near 1e3.
    const ROUND_OFF: f64 = 1e-11;

    #[test]
    fn a_quadratic_is_its_own_fit() {
        for n in [3, 4, 25, 64] {
            let fit = PolyFit::new(n).expect("three particles or more");
            let planted = Quadratic { quad: -0.8, lin: 0.9, con: 0.1 };
            let weights: Vec<f64> = fit.u.iter().map(|&u| planted.at(u)).collect();
            let found = fit.fit(&weights);
            for (a, b) in [(found.quad, planted.quad), (found.lin, planted.lin), (found.con, planted.con)] {
                assert!((a - b).abs() < ROUND_OFF, "{found:?}");
            }
        }
    }

    #[test]
    fn the_residual_of_a_fit_is_orthogonal_to_every_quadratic_and_line() {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let fit = PolyFit::new(25).expect("three particles or more");
        let weights: Vec<f64> = (0..25).map(|_| rng.random_range(0.0..1.0)).collect();
        for (found, degrees) in [(fit.fit(&weights), 3), (fit.fit_line(&weights), 2)] {
            for degree in 0..degrees {
                let product: f64 = fit.u.iter().zip(&weights).map(|(&u, w)| (w - found.at(u)) * u.powi(degree)).sum();
                assert!(product.abs() < ROUND_OFF, "degree {degree}: {product:e}");
            }
        }
        let cubic = fit.fit_cubic(&weights);
        for degree in 0..4 {
            let product: f64 = fit.u.iter().zip(&weights).map(|(&u, w)| (w - cubic.at(u)) * u.powi(degree)).sum();
            assert!(product.abs() < ROUND_OFF, "degree {degree}: {product:e}");
        }
        let flat = PolyFit::new(3).expect("three particles");
        assert_eq!(flat.fit_cubic(&weights[..3]), Cubic { cub: 0.0, rest: flat.fit(&weights[..3]) });
        assert!(PolyFit::new(2).is_none());
    }

    #[test]
    fn the_fits_of_one_set_sum_to_one_and_their_weights_too() {
        let mut rng = Pcg64Mcg::seed_from_u64(6);
        let fit = PolyFit::new(25).expect("three particles or more");
        let mut weights = vec![vec![0.0; 25]; 5];
        for i in 0..25 {
            let raw: Vec<f64> = (0..5).map(|_| rng.random_range(0.0_f64..1.0).powi(4)).collect();
            let total: f64 = raw.iter().sum();
            (0..5).for_each(|g| weights[g][i] = raw[g] / total);
        }
        let set: Vec<Quadratic> = weights.iter().map(|w| fit.fit(w)).collect();
        for &u in &fit.u {
            assert!((set.iter().map(|q| q.at(u)).sum::<f64>() - 1.0).abs() < ROUND_OFF);
            let mut w = [0.0; 5];
            weights_at(&set, u, &mut w);
            assert!(w.iter().all(|&w| w >= 0.0) && (w.iter().sum::<f64>() - 1.0).abs() < ROUND_OFF, "{w:?}");
        }
    }
}
