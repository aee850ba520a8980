//! Linearly implicit spring forces of a batch (MS08 §4.1).
//!
//! A spring's direction d is frozen at the start of the step, so its elastic force is linear in the new positions and the
//! implicit term projects on d only. Frozen directions leave the turning of a taut spring explicit, which bounds the step
//! by the time a transverse wave takes to cross one segment; the positive part of the geometric stiffness,
//! max(T, 0)/l (I - ddᵀ), removes that bound, keeps the band and stays positive definite (docs/DEVIATIONS.md).

use crate::lanes::{LANES, Lane, Lane3, ZERO};
use crate::rig::{Spring, Topology};
use crate::solve::banded::{BandedMatrix, Block};

/// Shortest spring length divided by, cm: a collapsed spring has no direction and exerts no force.
const SHORTEST_CM: f64 = 1e-9;

/// A spring's linearisation in every lane.
pub(crate) struct Linearised {
    /// Unit direction from `a` to `b`.
    pub direction: Lane3,
    /// Tension at the old positions, dyn; negative pushes.
    pub tension: Lane,
    /// Impulse per relative velocity along the direction, g.
    pub along: Lane,
    /// Impulse per relative velocity in every direction, g; `along` is what the direction has beyond it.
    pub around: Lane,
}

/// Linearises one spring over a step of `dt`.
/// Implements MS08 §4.1: F = -(k/l0)(d·(x_b - x_a) - l0) d at the new positions with d of the old.
#[inline(always)]
pub(crate) fn linearise(
    from: &Lane3,
    to: &Lane3,
    stiffness: &Lane,
    inv_rest_length: &Lane,
    damping: &Lane,
    dt: f64,
) -> Linearised {
    let mut out = Linearised { direction: [ZERO; 3], tension: ZERO, along: ZERO, around: ZERO };
    for l in 0..LANES {
        let (ex, ey, ez) = (to[0][l] - from[0][l], to[1][l] - from[1][l], to[2][l] - from[2][l]);
        let length = ex.mul_add(ex, ey.mul_add(ey, ez * ez)).sqrt();
        let inv = 1.0 / length.max(SHORTEST_CM);
        out.direction[0][l] = ex * inv;
        out.direction[1][l] = ey * inv;
        out.direction[2][l] = ez * inv;
        let tension = stiffness[l] * length.mul_add(inv_rest_length[l], -1.0);
        let geometric = dt * tension.max(0.0) * inv;
        out.tension[l] = tension;
        out.along[l] = dt * (dt.mul_add(stiffness[l] * inv_rest_length[l], damping[l]) - geometric);
        out.around[l] = dt * geometric;
    }
    out
}

/// Adds a spring to the matrix and the right side. `velocity` is read for the kinematic particles only.
#[inline(always)]
pub(crate) fn add_spring(
    topology: &Topology,
    spring: Spring,
    s: &Linearised,
    dt: f64,
    velocity: &[Lane3],
    matrix: &mut BandedMatrix,
    rhs: &mut [Lane],
) {
    let n_kin = topology.n_kinematic;
    if spring.b < n_kin {
        return;
    }
    let b = spring.b - n_kin;
    // along·ddᵀ + around·I
    let mut block = [ZERO; 9];
    for p in 0..3 {
        for q in 0..3 {
            for l in 0..LANES {
                let product = s.along[l] * s.direction[p][l] * s.direction[q][l];
                block[3 * p + q][l] = if p == q { product + s.around[l] } else { product };
            }
        }
    }
    accumulate(matrix.block(b, b), &block, 1.0);
    for p in 0..3 {
        for l in 0..LANES {
            rhs[3 * b + p][l] -= dt * s.tension[l] * s.direction[p][l];
        }
    }
    if spring.a < n_kin {
        // The near end's new velocity is prescribed: its column moves to the right side.
        for p in 0..3 {
            for q in 0..3 {
                for l in 0..LANES {
                    rhs[3 * b + p][l] = block[3 * p + q][l].mul_add(velocity[spring.a][q][l], rhs[3 * b + p][l]);
                }
            }
        }
        return;
    }
    let a = spring.a - n_kin;
    accumulate(matrix.block(a, a), &block, 1.0);
    accumulate(matrix.block(b, a), &block, -1.0);
    for p in 0..3 {
        for l in 0..LANES {
            rhs[3 * a + p][l] += dt * s.tension[l] * s.direction[p][l];
        }
    }
}

#[inline(always)]
fn accumulate(target: &mut Block, block: &Block, sign: f64) {
    for e in 0..9 {
        for l in 0..LANES {
            target[e][l] = sign.mul_add(block[e][l], target[e][l]);
        }
    }
}
