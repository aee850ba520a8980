//! One linearly implicit solve of a batch (MS08 §4.1): assembly and factorisation, a block row at a time.
//!
//! Solves (M(1 + hγ) + hB + h²K) v = M V + h (f + F(X)) for the velocities v of the free particles, which move by h v from
//! where the solve starts, X with velocities V. A row is factored as soon as the springs that reach it are in, so that
//! matrix and factor pass through the first-level cache once.

use crate::altitude::altitude_lanes;
use crate::body_contact::Contact;
use crate::forces::{Implicit, linearise, linearise_at};
use crate::lanes::{self, LANES, Lane, Lane3, ZERO};
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
            assemble_row(problem, p, matrix, rhs);
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

/// Lower triangle of a symmetric 3×3 block in every lane, entries in the order of [`LOWER`].
type Symmetric = [Lane; 6];

/// Row and column of each entry of a [`Symmetric`].
const LOWER: [(usize, usize); 6] = [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)];

/// Entry of a [`Symmetric`] at a row and column.
const ENTRY: [[usize; 3]; 3] = [[0, 1, 3], [1, 2, 4], [3, 4, 5]];

/// Particles joined by an altitude spring with the one that ends its tetrahedron.
const BEFORE: usize = 3;

/// Writes block row `p` and adds to those before it whatever ends at particle `p`: its inertia, the springs to it and the
/// altitude spring of the tetrahedron it is the last corner of. What a spring and that tetrahedron add to one block is
/// summed first, so that each block is read and written once, and a block that is new is not read at all.
#[inline(always)]
fn assemble_row(problem: &Problem, p: usize, matrix: &mut BandedMatrix, rhs: &mut [Lane]) {
    let n_kin = problem.topology.n_kinematic;
    let row = p - n_kin;
    for apart in BEFORE + 1..=matrix.reach().min(row) {
        *matrix.block(row, row - apart) = [ZERO; 9];
    }
    let mut diagonal = inertia_and_drag(problem, p, &mut rhs[3 * row..3 * row + 3]);
    // Springs to the corners of the tetrahedron, by corner.
    let mut to_corner = [[ZERO; 6]; BEFORE];
    for k in problem.topology.springs_to(p) {
        let spring = problem.topology.springs[k];
        let block = spring_block(problem, k, spring, rhs);
        for e in 0..6 {
            diagonal[e] = lanes::add(&diagonal[e], &block[e]);
        }
        if spring.a + BEFORE >= p {
            to_corner[spring.a + BEFORE - p] = block;
        } else if spring.a >= n_kin {
            let a = spring.a - n_kin;
            add_lower(matrix.block(a, a), &block);
            let across = matrix.block(row, a);
            for i in 0..3 {
                for j in 0..3 {
                    across[3 * i + j] = lanes::sub(&across[3 * i + j], &block[ENTRY[i][j]]);
                }
            }
        }
    }
    add_altitude(problem, p, &to_corner, &mut diagonal, matrix, rhs);
    let block = matrix.block(row, row);
    for (e, (i, j)) in LOWER.into_iter().enumerate() {
        block[3 * i + j] = diagonal[e];
    }
}

/// Inertia and the drag of still air on one particle, the sole part of the matrix that no spring makes; wind goes into `rhs`.
#[inline(always)]
fn inertia_and_drag(problem: &Problem, p: usize, rhs: &mut [Lane]) -> Symmetric {
    let mass = &problem.batch.mass[p];
    let (near, far) = problem.topology.around[p];
    let (near, far) = (&problem.start[near], &problem.start[far]);
    let mut t = [ZERO; 3];
    for c in 0..3 {
        t[c] = lanes::sub(&far[c], &near[c]);
    }
    let norm2 = lanes::dot(&t, &t);
    let inv = lanes::inv_sqrt(&norm2);
    let (mut across, mut less_along) = (ZERO, ZERO);
    for l in 0..LANES {
        across[l] = problem.h * problem.drag_per_s * mass[l];
        less_along[l] = (ALONG_OVER_ACROSS - 1.0) * across[l];
    }
    for c in 0..3 {
        t[c] = lanes::mul(&t[c], &inv);
    }
    let mut block = [ZERO; 6];
    let around = lanes::add(mass, &across);
    for (e, (i, j)) in LOWER.into_iter().enumerate() {
        let pushed = lanes::mul(&less_along, &t[i]);
        block[e] = if i == j { lanes::mul_add(&pushed, &t[j], &around) } else { lanes::mul(&pushed, &t[j]) };
    }
    if !problem.air.is_empty() {
        let air = &problem.air[p];
        let along = lanes::dot(&t, air);
        for c in 0..3 {
            for l in 0..LANES {
                let dragged = ((ALONG_OVER_ACROSS - 1.0) * along[l]).mul_add(t[c][l], air[c][l]);
                rhs[c][l] += across[l] * dragged;
            }
        }
    }
    block
}

/// Adds the force of spring `k` to the right side and returns what it adds to its two diagonal blocks, and with the
/// opposite sign to the one between them. A prescribed near end's velocity moves to the right side.
#[inline(always)]
fn spring_block(problem: &Problem, k: usize, spring: Spring, rhs: &mut [Lane]) -> Symmetric {
    let (batch, n_kin, h) = (problem.batch, problem.topology.n_kinematic, problem.h);
    let (stiffness, damping) = (&batch.stiffness[spring.kind as usize], &batch.damping[spring.kind as usize]);
    let inv_rest = &batch.inv_rest_length[k];
    let ends = [&problem.start[spring.a], &problem.start[spring.b]];
    let s = match problem.guess {
        None => linearise(ends[0], ends[1], stiffness, inv_rest, damping, h, problem.implicit),
        Some(guess) => {
            let at = [&guess[spring.a], &guess[spring.b]];
            linearise_at(ends, at, stiffness, inv_rest, damping, h, problem.implicit)
        }
    };
    // along·ddᵀ + around·I
    let mut block = [ZERO; 6];
    for (e, (i, j)) in LOWER.into_iter().enumerate() {
        let pushed = lanes::mul(&s.along, &s.direction[i]);
        block[e] = if i == j {
            lanes::mul_add(&pushed, &s.direction[j], &s.around)
        } else {
            lanes::mul(&pushed, &s.direction[j])
        };
    }
    let step = [h; LANES];
    let b = 3 * (spring.b - n_kin);
    for i in 0..3 {
        rhs[b + i] = lanes::neg_mul_add(&step, &s.force[i], &rhs[b + i]);
    }
    if spring.a >= n_kin {
        let a = 3 * (spring.a - n_kin);
        for i in 0..3 {
            rhs[a + i] = lanes::mul_add(&step, &s.force[i], &rhs[a + i]);
        }
        return block;
    }
    let known = &problem.kinematic[spring.a];
    for i in 0..3 {
        for j in 0..3 {
            rhs[b + i] = lanes::mul_add(&block[ENTRY[i][j]], &known[j], &rhs[b + i]);
        }
    }
    block
}

/// Adds the altitude spring of the tetrahedron whose last particle is `last` (MS08 §3.2), together with the springs
/// `to_corner` from its other corners to the last one; what falls on the last one's diagonal block goes to `diagonal`.
#[inline(always)]
fn add_altitude(
    problem: &Problem,
    last: usize,
    to_corner: &[Symmetric; BEFORE],
    diagonal: &mut Symmetric,
    matrix: &mut BandedMatrix,
    rhs: &mut [Lane],
) {
    let (n_kin, h, first) = (problem.topology.n_kinematic, problem.h, last - BEFORE);
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
            u[c][k] = lanes::mul(&s.weight[c], &s.direction[k]);
        }
    }
    if problem.guess.is_some() {
        length = ZERO;
        for c in 0..4 {
            for k in 0..3 {
                length = lanes::mul_add(&u[c][k], &start[c][k], &length);
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
    // A prescribed corner's new velocity pulls the others along.
    for c in 0..n_kin.saturating_sub(first) {
        let known = lanes::dot(&u[c], &problem.kinematic[first + c]);
        pull = lanes::mul_add(&along, &known, &pull);
    }
    for c in 0..4 {
        if first + c < n_kin {
            continue;
        }
        let row = first + c - n_kin;
        let mut pushed = [ZERO; 3];
        for k in 0..3 {
            pushed[k] = lanes::mul(&along, &u[c][k]);
            rhs[3 * row + k] = lanes::neg_mul_add(&pull, &u[c][k], &rhs[3 * row + k]);
        }
        for other in 0..c {
            if first + other < n_kin {
                continue;
            }
            let block = matrix.block(row, first + other - n_kin);
            for i in 0..3 {
                for j in 0..3 {
                    let e = 3 * i + j;
                    block[e] = if c == BEFORE {
                        // First to write here.
                        let across = &to_corner[other][ENTRY[i][j]];
                        lanes::mul_sub(&pushed[i], &u[other][j], across)
                    } else {
                        lanes::mul_add(&pushed[i], &u[other][j], &block[e])
                    };
                }
            }
        }
        let mut own = [ZERO; 6];
        for (e, (i, j)) in LOWER.into_iter().enumerate() {
            let spring = if c == BEFORE { &diagonal[e] } else { &to_corner[c][e] };
            own[e] = lanes::mul_add(&pushed[i], &u[c][j], spring);
        }
        if c == BEFORE {
            *diagonal = own;
        } else {
            add_lower(matrix.block(row, row), &own);
        }
    }
}

/// Adds to the lower triangle of a diagonal block, the only part of it that is used.
#[inline(always)]
fn add_lower(target: &mut Block, block: &Symmetric) {
    for (e, (i, j)) in LOWER.into_iter().enumerate() {
        target[3 * i + j] = lanes::add(&target[3 * i + j], &block[e]);
    }
}
