//! Repulsion between near hairs that do not stick: steps 3 and 9 of MS08 §4, after Bridson, Fedkiw, Anderson 2002 §7.2.
//!
//! Per pair: an inelastic impulse stops what approaches, a limited spring pushes apart what is nearer than the thickness,
//! and Coulomb friction acts on the sliding. Pairs are taken one after the other in ascending order, each seeing what the
//! earlier ones did. Invariant: linear momentum of free particles is kept; without friction angular momentum too, since
//! the impulse acts along the line that joins its two points.

use super::stiction::LinkSet;
use super::{FourPoints, Near, Strands, friction_impulse};
use crate::error::Error;
use collision::spatial_hash::Pair;
use nalgebra::Vector3;
use std::ops::AddAssign;

/// Closest distance at which a pair still has a direction to be pushed apart in, cm.
const SHORTEST_CM: f64 = 1e-9;

/// How near hairs repel each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RepulsionParams {
    /// Distance below which two hairs are in contact, cm.
    pub thickness_cm: f64,
    /// Repulsive force per overlap, dyn/cm.
    pub stiffness: f64,
    /// Share of the overlap that repulsion may remove in one step.
    pub max_share: f64,
    /// Coulomb coefficient.
    pub friction: f64,
}

impl RepulsionParams {
    /// A tenth of the overlap a step as in Bridson 2002; half a millimetre of thickness, some six real hairs, since far
    /// fewer hairs are simulated than grow; friction of dry hair on hair.
    #[must_use]
    pub fn standard() -> Self {
        Self { thickness_cm: 0.05, stiffness: 1.0, max_share: 0.1, friction: 0.3 }
    }

    /// Checks every constant.
    ///
    /// # Errors
    /// [`Error::BadInteraction`] naming the first constant out of range.
    pub fn validate(&self) -> Result<(), Error> {
        let constants = [
            ("thickness_cm", self.thickness_cm),
            ("stiffness", self.stiffness),
            ("max_share", self.max_share),
            ("friction", self.friction),
        ];
        match constants.into_iter().find(|(_, value)| !(*value >= 0.0 && value.is_finite())) {
            Some((name, value)) => Err(Error::BadInteraction { name, value, expected: "finite and not negative" }),
            None => Ok(()),
        }
    }
}

/// What repulsion met.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RepulsionReport {
    /// Pairs nearer than the thickness and not linked.
    pub touching: usize,
    /// Pairs an impulse was applied to.
    pub pushed: usize,
}

impl AddAssign for RepulsionReport {
    fn add_assign(&mut self, other: Self) {
        self.touching += other.touching;
        self.pushed += other.pushed;
    }
}

/// Changes velocities (cm/s) so that near pairs neither approach nor stay overlapped. `near` are pairs of `strands` as
/// they lie now, ascending; linked ones and those beyond the thickness are passed over.
/// Implements MS08 §5.3: edge/edge repulsion of Bridson 2002.
pub fn repel(
    strands: &Strands,
    near: &[Pair<Near>],
    links: &LinkSet,
    params: &RepulsionParams,
    dt: f64,
    velocity: &mut [Vector3<f64>],
) -> RepulsionReport {
    let mut report = RepulsionReport::default();
    let mut field = Flat { inv_mass: strands.inv_mass, velocity };
    for pair in near.iter().filter(|pair| !links.is_linked(pair.i as usize, pair.j as usize)) {
        report += repel_pair(strands, pair, params, dt, &mut field);
    }
    report
}

/// Velocities and masses, however they lie in memory.
pub(super) trait Field {
    /// As [`FourPoints::difference`] of velocities.
    fn difference(&mut self, points: &FourPoints) -> Vector3<f64>;
    /// As [`FourPoints::inv_mass`].
    fn inv_mass(&mut self, points: &FourPoints) -> f64;
    /// As [`FourPoints::push`] of velocities.
    fn push(&mut self, points: &FourPoints, impulse: &Vector3<f64>);
}

/// One vector of each for all particles.
struct Flat<'a> {
    inv_mass: &'a [f64],
    velocity: &'a mut [Vector3<f64>],
}

impl Field for Flat<'_> {
    #[inline(always)]
    fn difference(&mut self, points: &FourPoints) -> Vector3<f64> {
        points.difference(self.velocity)
    }

    #[inline(always)]
    fn inv_mass(&mut self, points: &FourPoints) -> f64 {
        points.inv_mass(self.inv_mass)
    }

    #[inline(always)]
    fn push(&mut self, points: &FourPoints, impulse: &Vector3<f64>) {
        points.push(self.inv_mass, impulse, self.velocity);
    }
}

/// Keeps one pair apart.
#[inline(always)]
pub(super) fn repel_pair(
    strands: &Strands,
    pair: &Pair<Near>,
    params: &RepulsionParams,
    dt: f64,
    field: &mut impl Field,
) -> RepulsionReport {
    let distance2 = pair.data.offset.norm_squared();
    // Exactly crossing pairs have no side to be pushed to; the next step's motion gives them one.
    if distance2 >= params.thickness_cm * params.thickness_cm || distance2 < SHORTEST_CM * SHORTEST_CM {
        return RepulsionReport::default();
    }
    let points = FourPoints::new(strands, pair.i, pair.j, pair.data.s, pair.data.t);
    let inv_mass = field.inv_mass(&points);
    if inv_mass <= 0.0 {
        return RepulsionReport::default();
    }
    let distance = distance2.sqrt();
    let normal = pair.data.offset / distance;
    let relative = field.difference(&points);
    let speed = relative.dot(&normal);
    // Of hair that has gone wrong nothing passes to others: it is put back at the end of the step.
    if !speed.is_finite() {
        return RepulsionReport::default();
    }
    let impulse = normal_impulse(speed, params.thickness_cm - distance, inv_mass, params, dt);
    if impulse > 0.0 {
        let sliding = relative - normal * speed;
        let total = normal * impulse + friction_impulse(&sliding, inv_mass, params.friction * impulse);
        field.push(&points, &total);
    }
    RepulsionReport { touching: 1, pushed: usize::from(impulse > 0.0) }
}

/// Impulse along the normal, never negative: what stops the approach, then a spring of the overlap, limited so that the
/// pair does not separate by more than its share of the overlap a step.
#[inline(always)]
fn normal_impulse(speed: f64, overlap: f64, inv_mass: f64, params: &RepulsionParams, dt: f64) -> f64 {
    let stopping = (-speed).max(0.0) / inv_mass;
    let wanted = params.max_share * overlap / dt - speed.max(0.0);
    stopping + (dt * params.stiffness * overlap).min(wanted / inv_mass).max(0.0)
}
