//! The plain way to solve one strand: conjugate gradients on its springs, matrix-free, diagonal preconditioner.
//!
//! A reference for the direct banded solve, in result and in time: MS08 solves its implicit springs (§4.1) by conjugate
//! gradients, and so do most hair simulators after it. Springs of 10⁵ dyn on particles of 10⁻⁵ g condition the system
//! badly, which is why the direct solve exists.

use nalgebra::Vector3;

/// Index of an end whose velocity is prescribed: its column is the caller's business on the right side.
pub const PRESCRIBED: usize = usize::MAX;

/// One spring of the matrix: ends a and b get `along` d dᵀ + `around` I on the diagonal, its negative beside it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpringTerm {
    /// Unknown at one end, or [`PRESCRIBED`].
    pub a: usize,
    /// Unknown at the other end, or [`PRESCRIBED`].
    pub b: usize,
    /// Unit direction, frozen.
    pub direction: Vector3<f64>,
    /// Impulse per relative velocity along the direction, g: dt (dt k/l0 + damping).
    pub along: f64,
    /// Impulse per relative velocity in every direction, g; zero in MS08.
    pub around: f64,
}

impl SpringTerm {
    #[inline(always)]
    fn times(&self, v: &Vector3<f64>) -> Vector3<f64> {
        self.direction * (self.along * self.direction.dot(v)) + v * self.around
    }
}

/// What a solve did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JacobiReport {
    /// Whether the tolerance was met.
    pub converged: bool,
    /// Multiplications by the matrix.
    pub iterations: usize,
    /// Norm of the residual over that of the right side.
    pub relative_residual: f64,
}

/// Buffers, kept from strand to strand.
#[derive(Clone, Debug, Default)]
pub struct JacobiWorkspace {
    inv_diagonal: Vec<Vector3<f64>>,
    residual: Vec<Vector3<f64>>,
    search: Vec<Vector3<f64>>,
    image: Vec<Vector3<f64>>,
}

/// Solves (M + Σ springs) v = b from the guess in `v`. `mass` is the diagonal, g.
///
/// # Panics
/// If `mass`, `b` and `v` differ in length.
pub fn solve_jacobi(
    mass: &[f64],
    springs: &[SpringTerm],
    b: &[Vector3<f64>],
    v: &mut [Vector3<f64>],
    relative_tolerance: f64,
    max_iterations: usize,
    workspace: &mut JacobiWorkspace,
) -> JacobiReport {
    assert!(mass.len() == b.len() && b.len() == v.len(), "one mass and one unknown per entry of the right side");
    let JacobiWorkspace { inv_diagonal, residual, search, image } = workspace;
    let n = b.len();
    inv_diagonal.clear();
    inv_diagonal.extend(mass.iter().map(|&m| Vector3::repeat(m)));
    for spring in springs {
        let diagonal = spring.direction.component_mul(&spring.direction) * spring.along;
        for end in [spring.a, spring.b].into_iter().filter(|&end| end != PRESCRIBED) {
            inv_diagonal[end] += diagonal.add_scalar(spring.around);
        }
    }
    inv_diagonal.iter_mut().for_each(|d| *d = d.map(|x| 1.0 / x));
    image.resize(n, Vector3::zeros());
    multiply(mass, springs, v, image);
    residual.clear();
    residual.extend(b.iter().zip(image.iter()).map(|(b, av)| b - av));
    search.clear();
    search.extend(residual.iter().zip(inv_diagonal.iter()).map(|(r, d)| r.component_mul(d)));
    let scale = dot(b, b);
    let goal = relative_tolerance * relative_tolerance * scale;
    let mut rz = dot(residual, search);
    let mut iterations = 1;
    loop {
        let rr = dot(residual, residual);
        if rr <= goal || iterations >= max_iterations {
            let relative_residual = if rr == 0.0 { 0.0 } else { (rr / scale).sqrt() };
            return JacobiReport { converged: rr <= goal, iterations, relative_residual };
        }
        multiply(mass, springs, search, image);
        iterations += 1;
        let alpha = rz / dot(search, image);
        for k in 0..n {
            v[k] += search[k] * alpha;
            residual[k] -= image[k] * alpha;
        }
        let rz_before = rz;
        rz = (0..n).map(|k| residual[k].dot(&residual[k].component_mul(&inv_diagonal[k]))).sum();
        for k in 0..n {
            search[k] = residual[k].component_mul(&inv_diagonal[k]) + search[k] * (rz / rz_before);
        }
    }
}

fn multiply(mass: &[f64], springs: &[SpringTerm], v: &[Vector3<f64>], out: &mut [Vector3<f64>]) {
    for k in 0..v.len() {
        out[k] = v[k] * mass[k];
    }
    for spring in springs {
        let at = |end: usize| if end == PRESCRIBED { Vector3::zeros() } else { v[end] };
        let pull = spring.times(&(at(spring.b) - at(spring.a)));
        if spring.a != PRESCRIBED {
            out[spring.a] -= pull;
        }
        if spring.b != PRESCRIBED {
            out[spring.b] += pull;
        }
    }
}

fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}
