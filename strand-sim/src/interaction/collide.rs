//! Hairs do not pass through hairs within a step: step 6 of MS08 §4, after Bridson, Fedkiw, Anderson 2002 §7.3.
//!
//! Every pair whose swept boxes overlap is tested over the whole step; a crossing is undone by an impulse on the average
//! velocity, which moves the end positions, and what moved is tested again, for a fixed number of sweeps. In the last
//! sweeps a pair that still crosses loses all its relative motion. Linked pairs are passed over. Invariant: if the report
//! leaves nothing unresolved, no unlinked pair crossed.

use super::stiction::LinkSet;
use super::{FourPoints, Strands, friction_impulse, segment_at};
use crate::error::Error;
use collision::segment_pair::{Hit, Sweep, between, first_crossing};
use collision::spatial_hash::{PairList, SegmentGrid};
use nalgebra::Vector3;

/// Times the crossings of one sweep are gone through before new ones are looked for.
const ROUNDS: usize = 4;

/// Shortest vector that still has a direction, cm or cm².
const SHORTEST: f64 = 1e-12;

/// How crossings are undone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CollideParams {
    /// Share of the approach speed given back, 0 to 1.
    pub restitution: f64,
    /// Coulomb coefficient.
    pub friction: f64,
    /// Sweeps that answer with impulses.
    pub sweeps: usize,
    /// Further sweeps that make pairs still crossing move as one.
    pub sticky_sweeps: usize,
    /// Distance that counts as touching, cm.
    pub tolerance_cm: f64,
}

impl CollideParams {
    /// Inelastic; friction of dry hair on hair.
    #[must_use]
    pub fn standard() -> Self {
        Self { restitution: 0.0, friction: 0.3, sweeps: 4, sticky_sweeps: 8, tolerance_cm: 1e-6 }
    }

    /// Checks every constant.
    ///
    /// # Errors
    /// [`Error::BadInteraction`] naming the first constant out of range.
    pub fn validate(&self) -> Result<(), Error> {
        let bad = |name, value, expected| Err(Error::BadInteraction { name, value, expected });
        if !(0.0..=1.0).contains(&self.restitution) {
            return bad("restitution", self.restitution, "between 0 and 1");
        }
        if !(self.friction >= 0.0 && self.friction.is_finite()) {
            return bad("friction", self.friction, "finite and not negative");
        }
        if !(self.tolerance_cm > 0.0 && self.tolerance_cm.is_finite()) {
            return bad("tolerance_cm", self.tolerance_cm, "positive and finite");
        }
        Ok(())
    }
}

/// What a collision pass met.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CollisionReport {
    /// Pairs that would have crossed had nothing been done.
    pub crossings: usize,
    /// Answers given, over all sweeps.
    pub answered: usize,
    /// Sweeps used, the last one finding nothing new unless pairs are left.
    pub sweeps: usize,
    /// Pairs that still cross.
    pub unresolved: usize,
}

/// Buffers of a collision pass, kept from step to step.
#[derive(Clone, Debug, Default)]
pub struct CollisionWorkspace {
    grid: SegmentGrid,
    crossings: PairList<()>,
    /// Per segment: moved since it was last tested.
    moved: Vec<bool>,
}

/// Changes `end_position` (cm), one per particle, so that no unlinked pair crosses on the way from `strands` to it; the
/// same change of velocity goes to `velocity` (cm/s).
/// Implements MS08 §5.3: edge/edge collisions of Bridson 2002, stuck pairs ignored and no rigid impact groups.
pub fn collide(
    strands: &Strands,
    end_position: &mut [Vector3<f64>],
    velocity: &mut [Vector3<f64>],
    links: &LinkSet,
    params: &CollideParams,
    dt: f64,
    workspace: &mut CollisionWorkspace,
) -> CollisionReport {
    let mut report = CollisionReport::default();
    let CollisionWorkspace { grid, crossings, moved } = workspace;
    moved.clear();
    moved.resize(strands.n_segments(), true);
    let n_sweeps = params.sweeps + params.sticky_sweeps;
    for sweep in 0..=n_sweeps {
        find_crossings(strands, end_position, links, params.tolerance_cm, grid, crossings, moved);
        let found = crossings.pairs().len();
        if sweep == 0 {
            report.crossings = found;
        }
        if found == 0 {
            return report;
        }
        if sweep == n_sweeps {
            report.unresolved = found;
            return report;
        }
        report.sweeps += 1;
        moved.fill(false);
        for _ in 0..ROUNDS {
            let mut answered = 0;
            for pair in crossings.pairs() {
                let hit = crossing_of(strands, end_position, pair.i as usize, pair.j as usize, params.tolerance_cm);
                if let Some(hit) = hit {
                    let points = FourPoints::new(strands, pair.i, pair.j, hit.s, hit.t);
                    if sweep < params.sweeps {
                        bounce(strands, &points, &hit, params, dt, end_position, velocity);
                    } else {
                        join(strands, &points, dt, end_position, velocity);
                    }
                    mark_moved(strands, pair.i as usize, moved);
                    mark_moved(strands, pair.j as usize, moved);
                    answered += 1;
                }
            }
            report.answered += answered;
            if answered == 0 {
                break;
            }
        }
        // A pair whose answer moved nothing must still be found again, so as to be counted.
        for pair in crossings.pairs() {
            moved[pair.i as usize] = true;
        }
    }
    report
}

/// How many unlinked pairs cross on the way from `strands` to `end_position`. A pair that touches within `tolerance_cm`
/// may be counted as well.
pub fn passes(
    strands: &Strands,
    end_position: &[Vector3<f64>],
    links: &LinkSet,
    tolerance_cm: f64,
    workspace: &mut CollisionWorkspace,
) -> usize {
    let CollisionWorkspace { grid, crossings, moved } = workspace;
    moved.clear();
    moved.resize(strands.n_segments(), true);
    find_crossings(strands, end_position, links, tolerance_cm, grid, crossings, moved);
    crossings.pairs().len()
}

/// Crossing pairs with at least one segment that moved since the last search.
fn find_crossings(
    strands: &Strands,
    end_position: &[Vector3<f64>],
    links: &LinkSet,
    tolerance_cm: f64,
    grid: &mut SegmentGrid,
    crossings: &mut PairList<()>,
    moved: &[bool],
) {
    grid.rebuild(strands.n_segments(), tolerance_cm, |i| Sweep {
        start: strands.segment(i),
        end: segment_at(end_position, strands.first_particle(i)),
    });
    grid.collect_active(
        crossings,
        |i| moved[i],
        |i, j| {
            if !strands.may_meet(i, j) || links.is_linked(i, j) {
                return None;
            }
            crossing_of(strands, end_position, i, j, tolerance_cm).map(|_| ())
        },
    );
}

#[inline(always)]
fn crossing_of(strands: &Strands, end_position: &[Vector3<f64>], i: usize, j: usize, tolerance_cm: f64) -> Option<Hit> {
    let (a, b) = (strands.first_particle(i), strands.first_particle(j));
    first_crossing(
        &segment_at(strands.position, a),
        &segment_at(end_position, a),
        &segment_at(strands.position, b),
        &segment_at(end_position, b),
        tolerance_cm,
    )
}

/// Marks a segment and its neighbours on the strand, which share its ends.
fn mark_moved(strands: &Strands, segment: usize, moved: &mut [bool]) {
    let per_strand = strands.n_particles - 1;
    let k = segment % per_strand;
    moved[segment] = true;
    if k > 0 {
        moved[segment - 1] = true;
    }
    if k + 1 < per_strand {
        moved[segment + 1] = true;
    }
}

/// An impulse at the places that touch, along the normal of both segments at that time, on the average velocity.
fn bounce(
    strands: &Strands,
    points: &FourPoints,
    hit: &Hit,
    params: &CollideParams,
    dt: f64,
    end_position: &mut [Vector3<f64>],
    velocity: &mut [Vector3<f64>],
) {
    let inv_mass = points.inv_mass(strands.inv_mass);
    if inv_mass <= 0.0 {
        return;
    }
    let [a, _, b, _] = points.particles;
    let at = |first| between(&segment_at(strands.position, first), &segment_at(end_position, first), hit.time);
    let (on_a, on_b) = (at(a), at(b));
    let before = points.difference(strands.position);
    let relative = (points.difference(end_position) - before) / dt;
    // Parallel segments have no common normal; what separated the points before the step serves.
    let cross = (on_a[1] - on_a[0]).cross(&(on_b[1] - on_b[0])).try_normalize(SHORTEST);
    let Some(normal) = cross.or_else(|| before.try_normalize(SHORTEST)) else { return };
    let speed = relative.dot(&normal);
    // Points that meet during the step approach along the normal, whichever way it was oriented.
    let impulse = -(1.0 + params.restitution) * speed / inv_mass;
    let sliding = relative - normal * speed;
    let total = normal * impulse + friction_impulse(&sliding, inv_mass, params.friction * impulse.abs());
    points.push(strands.inv_mass, &total, velocity);
    points.push(strands.inv_mass, &(total * dt), end_position);
}

/// Takes all relative motion from the four particles: they move on with their common momentum, or with the kinematic
/// ones among them. Pairwise, this stands in for the rigid impact zones that MS08 leaves out.
fn join(
    strands: &Strands,
    points: &FourPoints,
    dt: f64,
    end_position: &mut [Vector3<f64>],
    velocity: &mut [Vector3<f64>],
) {
    let (mut sum, mut mass, mut n_fixed, mut fixed) = (Vector3::zeros(), 0.0, 0.0, Vector3::zeros());
    for p in points.particles {
        let moved = end_position[p] - strands.position[p];
        let inv_mass = strands.inv_mass[p];
        if inv_mass > 0.0 {
            sum += moved / inv_mass;
            mass += 1.0 / inv_mass;
        } else {
            fixed += moved;
            n_fixed += 1.0;
        }
    }
    let common = if n_fixed > 0.0 { fixed / n_fixed } else { sum / mass };
    for p in points.particles {
        if strands.inv_mass[p] > 0.0 {
            let change = common - (end_position[p] - strands.position[p]);
            end_position[p] += change;
            velocity[p] += change / dt;
        }
    }
}
