//! Linearly implicit spring forces of a batch (MS08 §4.1).
//!
//! A spring's direction d is frozen where the solve starts from, so its elastic force is linear in the new positions and
//! the implicit term projects on d only. Frozen directions leave the turning of a taut spring explicit, which bounds the
//! step by the time a transverse wave takes to cross one segment; the positive part of the geometric stiffness,
//! max(T, 0)/l (I - ddᵀ), removes that bound, keeps the band and stays positive definite (docs/DEVIATIONS.md).

use crate::lanes::{self, LANES, Lane, Lane3, ZERO};

/// Shortest spring length divided by, cm: a collapsed spring has no direction and exerts no force.
const SHORTEST_CM: f64 = 1e-9;

/// What of the springs' stiffness a solve takes into its matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Implicit {
    /// 1 to take the elastic forces at the new positions, 0 to take them where the solve starts from.
    pub elastic: f64,
    /// 1 to add the positive geometric stiffness, 0 for MS08 to the letter.
    pub geometric: f64,
    /// Tension that turning is taken to meet at least, dyn: zero keeps the matrix definite.
    pub least_tension: f64,
}

/// A spring's linearisation in every lane.
pub(crate) struct Linearised {
    /// Unit direction from `a` to `b`.
    pub direction: Lane3,
    /// Force on `a`, and against it on `b`, at the start of the solve, dyn.
    pub force: Lane3,
    /// Impulse per relative velocity along the direction, g; what it has beyond `around`.
    pub along: Lane,
    /// Impulse per relative velocity in every direction, g.
    pub around: Lane,
}

/// Linearises one spring between `from` and `to` over a solve of `h` seconds.
/// Implements MS08 §4.1: F = -(k/l0)(d·(x_b - x_a) - l0) d at the new positions with d of the old.
#[inline(always)]
pub(crate) fn linearise(
    from: &Lane3,
    to: &Lane3,
    stiffness: &Lane,
    inv_rest_length: &Lane,
    damping: &Lane,
    h: f64,
    implicit: Implicit,
) -> Linearised {
    let mut out = Linearised { direction: [ZERO; 3], force: [ZERO; 3], along: ZERO, around: ZERO };
    for l in 0..LANES {
        let (ex, ey, ez) = (to[0][l] - from[0][l], to[1][l] - from[1][l], to[2][l] - from[2][l]);
        let square = ex.mul_add(ex, ey.mul_add(ey, ez * ez));
        let inv = lanes::inv_sqrt_of(square.max(SHORTEST_CM * SHORTEST_CM));
        let length = square * inv;
        let d = [ex * inv, ey * inv, ez * inv];
        let tension = stiffness[l] * length.mul_add(inv_rest_length[l], -1.0);
        let elastic = implicit.elastic * h;
        let geometric = implicit.geometric * elastic * tension.max(implicit.least_tension) * inv;
        for c in 0..3 {
            out.direction[c][l] = d[c];
            out.force[c][l] = tension * d[c];
        }
        out.along[l] = h * (elastic.mul_add(stiffness[l] * inv_rest_length[l], damping[l]) - geometric);
        out.around[l] = h * geometric;
    }
    out
}

/// As [`linearise`], with directions and geometric stiffness of a better guess of the new positions than the start:
/// the next Newton iteration, its directions refrozen at `guess_from` and `guess_to`.
#[inline(always)]
pub(crate) fn linearise_at(
    [from, to]: [&Lane3; 2],
    [guess_from, guess_to]: [&Lane3; 2],
    stiffness: &Lane,
    inv_rest_length: &Lane,
    damping: &Lane,
    h: f64,
    implicit: Implicit,
) -> Linearised {
    let mut out = linearise(guess_from, guess_to, stiffness, inv_rest_length, damping, h, implicit);
    for l in 0..LANES {
        let e: [f64; 3] = std::array::from_fn(|c| to[c][l] - from[c][l]);
        let d: [f64; 3] = std::array::from_fn(|c| out.direction[c][l]);
        let along = e[0].mul_add(d[0], e[1].mul_add(d[1], e[2] * d[2]));
        let tension = stiffness[l] * along.mul_add(inv_rest_length[l], -1.0);
        // What the geometric stiffness adds between the start and the guess.
        let around = out.around[l] / (h * h);
        for c in 0..3 {
            out.force[c][l] = tension.mul_add(d[c], around * (e[c] - along * d[c]));
        }
    }
    out
}
