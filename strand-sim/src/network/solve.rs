//! Conjugate gradients with a diagonal preconditioner on a network's implicit matrix, which is never assembled.
//!
//! Every spring adds along·(w⊗d)(w⊗d)ᵀ, and a taut one around·(w⊗I)(w⊗I)ᵀ besides, to the masses on the diagonal: both
//! positive semidefinite, so the method applies to any state. Held particles keep their value.

use super::NetworkParams;
use nalgebra::Vector3;

/// One spring's share of the matrix.
#[derive(Clone, Copy, Debug)]
pub(super) struct Element {
    n_corners: usize,
    corners: [usize; 4],
    weight: [f64; 4],
    direction: Vector3<f64>,
    along: f64,
    around: f64,
}

impl Element {
    pub(super) fn edge([a, b]: [usize; 2], direction: Vector3<f64>, along: f64, around: f64) -> Self {
        Self { n_corners: 2, corners: [a, b, 0, 0], weight: [-1.0, 1.0, 0.0, 0.0], direction, along, around }
    }

    pub(super) fn altitude(corners: [usize; 4], weight: [f64; 4], direction: Vector3<f64>, along: f64) -> Self {
        Self { n_corners: 4, corners, weight, direction, along, around: 0.0 }
    }
}

/// Vectors of the iteration, one entry per particle.
#[derive(Debug, Default)]
pub(super) struct Solver {
    residual: Vec<Vector3<f64>>,
    search: Vec<Vector3<f64>>,
    image: Vec<Vector3<f64>>,
    preconditioner: Vec<Vector3<f64>>,
}

impl Solver {
    /// Solves for `x`, starting from what it holds. Returns the iterations taken and whether the tolerance was met.
    pub(super) fn solve(
        &mut self,
        elements: &[Element],
        diagonal: impl Fn(usize) -> Vector3<f64>,
        fixed: &[bool],
        rhs: &[Vector3<f64>],
        x: &mut [Vector3<f64>],
        params: &NetworkParams,
    ) -> (usize, bool) {
        let n = rhs.len();
        self.preconditioner.clear();
        self.preconditioner.extend((0..n).map(&diagonal));
        for e in elements {
            for (&c, w) in e.corners[..e.n_corners].iter().zip(e.weight) {
                let squares = e.direction.component_mul(&e.direction);
                self.preconditioner[c] += (squares * e.along + Vector3::repeat(e.around)) * (w * w);
            }
        }
        for entry in &mut self.preconditioner {
            *entry = entry.map(|v| 1.0 / v);
        }
        self.image.resize(n, Vector3::zeros());
        apply(elements, &diagonal, fixed, x, &mut self.image);
        self.residual.clear();
        self.search.clear();
        let mut norm = 0.0;
        let mut rho = 0.0;
        for p in 0..n {
            let r = if fixed[p] { Vector3::zeros() } else { rhs[p] - self.image[p] };
            let z = r.component_mul(&self.preconditioner[p]);
            if !fixed[p] {
                norm += rhs[p].component_mul(&self.preconditioner[p]).dot(&rhs[p]);
            }
            rho += r.dot(&z);
            self.residual.push(r);
            self.search.push(z);
        }
        let target = params.tolerance * params.tolerance * norm;
        for iteration in 0..params.max_iterations {
            if rho <= target {
                return (iteration, true);
            }
            for p in 0..n {
                if fixed[p] {
                    self.search[p] = Vector3::zeros();
                }
            }
            apply(elements, &diagonal, fixed, &self.search, &mut self.image);
            let curvature: f64 = self.search.iter().zip(&self.image).map(|(s, a)| s.dot(a)).sum();
            if curvature.is_nan() || curvature <= 0.0 {
                return (iteration, false);
            }
            let alpha = rho / curvature;
            let mut next = 0.0;
            for p in 0..n {
                x[p] += self.search[p] * alpha;
                self.residual[p] -= self.image[p] * alpha;
                let r = self.residual[p];
                next += r.component_mul(&self.preconditioner[p]).dot(&r);
            }
            let beta = next / rho;
            rho = next;
            for p in 0..n {
                self.search[p] = self.residual[p].component_mul(&self.preconditioner[p]) + self.search[p] * beta;
            }
        }
        (params.max_iterations, rho <= target)
    }
}

/// `image = A x`, rows of held particles zero.
fn apply(
    elements: &[Element],
    diagonal: impl Fn(usize) -> Vector3<f64>,
    fixed: &[bool],
    x: &[Vector3<f64>],
    image: &mut [Vector3<f64>],
) {
    for p in 0..x.len() {
        image[p] = diagonal(p).component_mul(&x[p]);
    }
    for e in elements {
        let mut relative = Vector3::zeros();
        for k in 0..e.n_corners {
            relative += x[e.corners[k]] * e.weight[k];
        }
        let impulse = e.direction * (e.along * e.direction.dot(&relative)) + relative * e.around;
        for k in 0..e.n_corners {
            image[e.corners[k]] += impulse * e.weight[k];
        }
    }
    for p in 0..x.len() {
        if fixed[p] {
            image[p] = Vector3::zeros();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    /// Residual asked of the iteration; its condition number here is below 1e3.
    const TOLERANCE: f64 = 1e-13;
    const AGREEMENT: f64 = 1e-10;

    #[test]
    fn the_iteration_agrees_with_a_dense_solve_around_held_particles() {
        let n = 7;
        let direction = |i: usize| Vector3::new(i as f64 - 2.0, 1.5, 0.3 * i as f64).normalize();
        let mut elements = Vec::new();
        for i in 0..n - 1 {
            elements.push(Element::edge([i, i + 1], direction(i), 3.0 + i as f64, 0.4));
        }
        for i in 0..n - 3 {
            let corners = [i, i + 1, i + 2, i + 3];
            elements.push(Element::altitude(corners, [0.2, -0.7, 0.8, -0.3], direction(i + 1), 5.0));
        }
        let diagonal = |p: usize| Vector3::new(1.0, 2.0 + p as f64, 1.0);
        let mut fixed = vec![false; n];
        fixed[2] = true;
        let mut dense = DMatrix::zeros(3 * n, 3 * n);
        for p in 0..n {
            for k in 0..3 {
                dense[(3 * p + k, 3 * p + k)] += diagonal(p)[k];
            }
        }
        for e in &elements {
            for (i, &p) in e.corners[..e.n_corners].iter().enumerate() {
                for (j, &q) in e.corners[..e.n_corners].iter().enumerate() {
                    for (a, b) in (0..9).map(|m| (m / 3, m % 3)) {
                        let identity = if a == b { e.around } else { 0.0 };
                        let entry = e.along * e.direction[a] * e.direction[b] + identity;
                        dense[(3 * p + a, 3 * q + b)] += e.weight[i] * e.weight[j] * entry;
                    }
                }
            }
        }
        let rhs: Vec<_> = (0..n).map(|p| Vector3::new(1.0, -(p as f64), 0.5 * p as f64)).collect();
        let mut x = vec![Vector3::new(0.1, 0.2, -0.3); n];
        let held = x[2];
        let mut b = DVector::from_iterator(3 * n, rhs.iter().flat_map(|r| [r.x, r.y, r.z]));
        for k in 0..3 {
            dense.row_mut(6 + k).fill(0.0);
            dense[(6 + k, 6 + k)] = 1.0;
            b[6 + k] = held[k];
        }
        let expected = dense.lu().solve(&b).expect("masses make it regular");
        let params = NetworkParams { tolerance: TOLERANCE, ..NetworkParams::standard() };
        let (_, converged) = Solver::default().solve(&elements, diagonal, &fixed, &rhs, &mut x, &params);
        assert!(converged);
        for p in 0..n {
            for k in 0..3 {
                assert!((x[p][k] - expected[3 * p + k]).abs() < AGREEMENT * expected.amax());
            }
        }
    }
}
