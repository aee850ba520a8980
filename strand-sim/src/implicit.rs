//! One linearly implicit solve of a batch (MS08 §4.1): assembly and factorisation, a block row at a time.
//!
//! Solves (M(1 + hγ) + hB + h²K) v = M V + h (f + F(X)) for the velocities v of the free particles, which move by h v from
//! where the solve starts, X with velocities V. A row is factored as soon as the springs that reach it are in, so that
//! matrix and factor pass through the first-level cache once.

use crate::altitude::altitude_lanes;
use crate::body_contact::Contact;
use crate::forces::{Implicit, Linearised, linearise, linearise_at};
use crate::lanes::{LANES, Lane, Lane3, ZERO};
use crate::rig::{ALTITUDE, Spring, Topology};
use crate::solve::banded::{BandedMatrix, Block};
use crate::system::Batch;
use crate::wind::ALONG_OVER_ACROSS;
use multiversion::multiversion;

/// A particle made to move: its row of the system is replaced by a mass that nothing else moves.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Driven {
    pub lane: usize,
    /// Rig particle.
    pub particle: usize,
    /// Velocity it gets, cm/s.
    pub velocity: [f64; 3],
}

/// Mass of a driven particle, g: what springs add to its row is less than a billionth of it.
const DRIVEN_MASS: f64 = 1e10;

/// What a solve works on.
pub(crate) struct Problem<'a> {
    pub topology: &'a Topology,
    pub batch: &'a Batch,
    /// Where the solve starts, per rig particle, cm.
    pub start: &'a [Lane3],
    /// Guess of where it ends, to freeze directions at; the start if absent.
    pub guess: Option<&'a [Lane3]>,
    /// Velocities of the kinematic particles, cm/s; further entries are not read.
    pub kinematic: &'a [Lane3],
    /// Length of the solve, s.
    pub h: f64,
    pub implicit: Implicit,
    /// Rate at which air takes up velocity across the hair, 1/s.
    pub drag_per_s: f64,
    /// Air velocity at every rig particle, cm/s; empty for still air.
    pub air: &'a [Lane3],
    /// Ordered by the far end.
    pub contacts: &'a [Contact],
    /// Ordered by particle.
    pub driven: &'a [Driven],
}

/// Solves; `rhs` holds momentum and impulses of outside forces, three lanes a free particle, and is replaced by the new
/// velocities. `matrix` is left factored.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
pub(crate) fn solve(problem: &Problem, matrix: &mut BandedMatrix, rhs: &mut [Lane]) {
    let topology = problem.topology;
    let n_kin = topology.n_kinematic;
    let n_free = topology.n_rig - n_kin;
    let reach = topology.reach;
    matrix.resize(n_free, reach);
    let (mut contacts, mut driven) = (problem.contacts, problem.driven);
    for step in 0..n_free + reach {
        if step < n_free {
            let p = step + n_kin;
            matrix.clear_row(step);
            add_inertia_and_drag(problem, p, matrix.block(step, step), &mut rhs[3 * step..3 * step + 3]);
            for k in topology.springs_to(p) {
                let spring = topology.springs[k];
                let (stiffness, damping) =
                    (&problem.batch.stiffness[spring.kind as usize], &problem.batch.damping[spring.kind as usize]);
                let inv_rest = &problem.batch.inv_rest_length[k];
                let ends = [&problem.start[spring.a], &problem.start[spring.b]];
                let s = match problem.guess {
                    None => linearise(ends[0], ends[1], stiffness, inv_rest, damping, problem.h, problem.implicit),
                    Some(guess) => {
                        let at = [&guess[spring.a], &guess[spring.b]];
                        linearise_at(ends, at, stiffness, inv_rest, damping, problem.h, problem.implicit)
                    }
                };
                add_spring(n_kin, spring, &s, problem.h, problem.kinematic, matrix, rhs);
            }
            if p >= 3 {
                add_altitude(problem, p, matrix, rhs);
            }
            while let Some((contact, rest)) = contacts.split_first().filter(|(c, _)| c.ends[1] == p) {
                contact.add_to(n_kin, problem.h, matrix, rhs);
                contacts = rest;
            }
            while let Some((d, rest)) = driven.split_first().filter(|(d, _)| d.particle == p) {
                let block = matrix.block(step, step);
                for c in 0..3 {
                    block[4 * c][d.lane] = DRIVEN_MASS;
                    rhs[3 * step + c][d.lane] = DRIVEN_MASS * d.velocity[c];
                }
                driven = rest;
            }
        }
        if step >= reach {
            matrix.factor_row(step - reach);
            matrix.solve_forward_row(step - reach, rhs);
        }
    }
    matrix.solve_back(rhs);
}

/// `rhs = A⁻¹ rhs` with the factor that [`solve`] left: the preconditioner of coupled strands.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
pub(crate) fn solve_again(matrix: &BandedMatrix, rhs: &mut [Lane]) {
    matrix.solve(rhs);
}

#[inline(always)]
fn add_inertia_and_drag(problem: &Problem, p: usize, block: &mut Block, rhs: &mut [Lane]) {
    let mass = &problem.batch.mass[p];
    let (near, far) = problem.topology.around[p];
    let mut t = [ZERO; 3];
    for l in 0..LANES {
        let d: [f64; 3] = std::array::from_fn(|c| problem.start[far][c][l] - problem.start[near][c][l]);
        let norm2 = d[0].mul_add(d[0], d[1].mul_add(d[1], d[2] * d[2]));
        let inv = 1.0 / norm2.max(f64::MIN_POSITIVE).sqrt();
        for c in 0..3 {
            t[c][l] = d[c] * inv;
        }
    }
    for l in 0..LANES {
        let across = problem.h * problem.drag_per_s * mass[l];
        let less_along = (ALONG_OVER_ACROSS - 1.0) * across;
        for a in 0..3 {
            for b in 0..=a {
                block[3 * a + b][l] = less_along * t[a][l] * t[b][l];
            }
            block[4 * a][l] += mass[l] + across;
        }
    }
    if problem.air.is_empty() {
        return;
    }
    let air = &problem.air[p];
    for l in 0..LANES {
        let across = problem.h * problem.drag_per_s * mass[l];
        let along = t[0][l].mul_add(air[0][l], t[1][l].mul_add(air[1][l], t[2][l] * air[2][l]));
        for c in 0..3 {
            rhs[c][l] += across * ((ALONG_OVER_ACROSS - 1.0) * along).mul_add(t[c][l], air[c][l]);
        }
    }
}

/// Adds a spring to the matrix and the right side. `velocity` is read for the kinematic particles only.
#[inline(always)]
fn add_spring(
    n_kin: usize,
    spring: Spring,
    s: &Linearised,
    h: f64,
    velocity: &[Lane3],
    matrix: &mut BandedMatrix,
    rhs: &mut [Lane],
) {
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
            rhs[3 * b + p][l] -= h * s.force[p][l];
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
            rhs[3 * a + p][l] += h * s.force[p][l];
        }
    }
}

/// Adds the altitude spring of the tetrahedron whose last particle is `last` (MS08 §3.2).
#[inline(always)]
fn add_altitude(problem: &Problem, last: usize, matrix: &mut BandedMatrix, rhs: &mut [Lane]) {
    let (n_kin, h, first) = (problem.topology.n_kinematic, problem.h, last - 3);
    let corners = |of: &'_ [Lane3]| -> [Lane3; 4] { [of[first], of[first + 1], of[first + 2], of[last]] };
    let start = corners(problem.start);
    let at = problem.guess.map_or(start, corners);
    let s = altitude_lanes([&at[0], &at[1], &at[2], &at[3]], &problem.batch.altitude_rest[first]);
    let (stiffness, damping) = (&problem.batch.stiffness[ALTITUDE], &problem.batch.damping[ALTITUDE]);
    // Weight times direction: how the length changes with each corner.
    let mut u = [[ZERO; 3]; 4];
    let mut length = s.length;
    for c in 0..4 {
        for k in 0..3 {
            for l in 0..LANES {
                u[c][k][l] = s.weight[c][l] * s.direction[k][l];
            }
        }
    }
    if problem.guess.is_some() {
        length = ZERO;
        for c in 0..4 {
            for k in 0..3 {
                for l in 0..LANES {
                    length[l] = u[c][k][l].mul_add(start[c][k][l], length[l]);
                }
            }
        }
    }
    let (mut pull, mut along) = (ZERO, ZERO);
    for l in 0..LANES {
        let k = stiffness[l] * s.per_length[l];
        // Without a spring there is no damper either.
        let b = if s.per_length[l] > 0.0 { damping[l] } else { 0.0 };
        pull[l] = h * k * (length[l] - s.rest_length[l]);
        along[l] = h * (problem.implicit.elastic * h).mul_add(k, b);
    }
    for c in 0..4 {
        if first + c < n_kin {
            // Its new velocity is prescribed and pulls the others along.
            for l in 0..LANES {
                let v = &problem.kinematic[first + c];
                let known = u[c][0][l].mul_add(v[0][l], u[c][1][l].mul_add(v[1][l], u[c][2][l] * v[2][l]));
                pull[l] = along[l].mul_add(known, pull[l]);
            }
            continue;
        }
        let row = first + c - n_kin;
        let mut pushed = [ZERO; 3];
        for k in 0..3 {
            for l in 0..LANES {
                pushed[k][l] = along[l] * u[c][k][l];
            }
        }
        for other in n_kin.saturating_sub(first)..=c {
            let block = matrix.block(row, first + other - n_kin);
            for p in 0..3 {
                for q in 0..3 {
                    for l in 0..LANES {
                        block[3 * p + q][l] = pushed[p][l].mul_add(u[other][q][l], block[3 * p + q][l]);
                    }
                }
            }
        }
    }
    for c in n_kin.saturating_sub(first)..4 {
        let row = first + c - n_kin;
        for k in 0..3 {
            for l in 0..LANES {
                rhs[3 * row + k][l] = (-pull[l]).mul_add(u[c][k][l], rhs[3 * row + k][l]);
            }
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
