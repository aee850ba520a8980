//! Contact of strand segments with solids: penalty inside the implicit matrix, friction after it (AS16 §5.1, §7.1).
//!
//! A strand is tested along its segments, since a comb's tooth is thinner than the spacing of particles; the force at the
//! deepest point of a segment acts on its two ends by barycentric weight. The penalty is k n nᵀ on two neighbouring
//! particles, so it stays within the band and its stiffness is bounded by accuracy, not by the step.

use crate::lanes::{LANES, Lane};
use crate::rig::Topology;
use crate::solve::banded::BandedMatrix;
use crate::step::{StepInput, StepParams};
use crate::system::{Batch, BatchState, StrandSystem, get, set};
use collision::deepest_on_segment;
use collision::friction::slip_factor;
use nalgebra::Vector3;

/// Constants of hair-solid contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactParams {
    /// Distance kept between a strand's centre line and a surface, cm.
    pub offset_cm: f64,
    /// Penalty stiffness as a multiple of a particle's m/h²: what remains of a penetration after a substep is about its
    /// reciprocal.
    pub stiffness_over_inertia: f64,
    /// Fastest a strand found inside a solid is pushed out, beyond the solid's own speed, cm/s.
    pub max_push_speed: f64,
    /// Spacing at which a segment near a surface is sampled, as a multiple of the solid's least half-thickness.
    pub spacing_over_half_thickness: f64,
}

impl ContactParams {
    /// A hair's own radius and grid error as offset; stiff enough to leave a hundredth of a penetration.
    #[must_use]
    pub fn standard() -> Self {
        Self { offset_cm: 0.012, stiffness_over_inertia: 100.0, max_push_speed: 50.0, spacing_over_half_thickness: 0.5 }
    }
}

/// One segment touching one solid during one substep.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contact {
    lane: usize,
    /// Rig particles at the segment's ends.
    ends: [usize; 2],
    /// Barycentric weights of the ends.
    weight: [f64; 2],
    /// Outward normal in the world frame.
    normal: Vector3<f64>,
    /// Gap at the old positions against the solid's new pose, cm; negative inside.
    gap: f64,
    /// Penalty stiffness, dyn/cm.
    stiffness: f64,
    /// Velocity of the solid at the contact, cm/s.
    solid_velocity: Vector3<f64>,
    friction: f64,
    /// Velocities of the ends where they are kinematic, zero otherwise.
    known: Vector3<f64>,
}

/// Gaps up to this are watched, so that a strand closing in stops at the surface and not behind it, cm.
const WATCHED_GAP_CM: f64 = 0.1;

impl StrandSystem {
    /// Finds the contacts of all lanes at the solids' poses at the end of the substep `span` (fractions of the step).
    pub(crate) fn find_contacts(
        &self,
        batch: &Batch,
        state: &mut BatchState,
        input: &StepInput,
        params: &StepParams,
        span: (f64, f64),
        h: f64,
        contacts: &mut Vec<Contact>,
    ) {
        let topology = &self.topologies[batch.topology];
        let first = topology.first_free_main();
        let contact = &params.contact;
        let reach = contact.offset_cm + WATCHED_GAP_CM;
        for (k, moving) in input.solids.iter().enumerate() {
            let world_from_solid = moving.pose.at(span.1);
            let solid_from_world = world_from_solid.inverse();
            let sdf = &moving.solid.sdf;
            let spacing = moving.solid.half_thickness_cm * contact.spacing_over_half_thickness as f32;
            for lane in 0..batch.strands.len() {
                if state.clearance[k][lane] - moving.max_displacement() * (span.1 - span.0) > reach {
                    continue;
                }
                let in_solid = |i: usize| -> Vector3<f32> {
                    let x = get(&state.position[topology.rig_of_main(i)], lane);
                    solid_from_world.transform_point(&x.into()).coords.cast::<f32>()
                };
                let mut a = in_solid(first);
                let mut distance_a = sdf.lower_bound(a);
                let mut clear = distance_a;
                for i in first..self.n_main - 1 {
                    let b = in_solid(i + 1);
                    let distance_b = sdf.lower_bound(b);
                    // A distance field changes by at most the distance walked.
                    let least = 0.5 * (distance_a + distance_b - (b - a).norm());
                    clear = clear.min(least);
                    if least < reach as f32
                        && let Some(hit) = deepest_on_segment(sdf, a, b, spacing, reach as f32)
                    {
                        let ends = [topology.rig_of_main(i), topology.rig_of_main(i + 1)];
                        let s = f64::from(hit.s);
                        let weight = [1.0 - s, s];
                        let normal = (world_from_solid.rotation * hit.normal.cast::<f64>()).normalize();
                        let velocity = get(&state.velocity[ends[0]], lane) * weight[0]
                            + get(&state.velocity[ends[1]], lane) * weight[1];
                        let gap = f64::from(hit.distance) - contact.offset_cm;
                        if gap + h * normal.dot(&velocity) < 0.0 {
                            let at = get(&state.position[ends[0]], lane) * weight[0]
                                + get(&state.position[ends[1]], lane) * weight[1];
                            let solid_velocity = moving.pose.velocity_at(at, input.dt);
                            let fastest = contact.max_push_speed + solid_velocity.norm();
                            let known = if ends[0] < topology.n_kinematic {
                                get(&state.velocity[ends[0]], lane) * weight[0]
                            } else {
                                Vector3::zeros()
                            };
                            contacts.push(Contact {
                                lane,
                                ends,
                                weight,
                                normal,
                                gap: gap.max(-fastest * h),
                                stiffness: contact.stiffness_over_inertia * batch.mass[ends[1]][lane] / (h * h),
                                solid_velocity,
                                friction: f64::from(moving.solid.friction),
                                known,
                            });
                        }
                    }
                    (a, distance_a) = (b, distance_b);
                }
                // The bound is kept as of before this substep's movement, which is subtracted with the rest.
                state.clearance[k][lane] = f64::from(clear) + moving.max_displacement() * (span.1 - span.0);
            }
        }
    }

    /// Coulomb friction of every contact on the solved velocities.
    /// Departure from AS16 §7.1: the normal force is the one the implicit solve found, not an estimate before it.
    pub(crate) fn apply_friction(
        &self,
        batch: &Batch,
        state: &mut BatchState,
        params: &ContactParams,
        h: f64,
        contacts: &[Contact],
    ) {
        let topology = &self.topologies[batch.topology];
        debug_assert!(params.offset_cm >= 0.0);
        for c in contacts {
            let [a, b] = c.ends;
            let velocity = get(&state.velocity[a], c.lane) * c.weight[0] + get(&state.velocity[b], c.lane) * c.weight[1];
            let force = -c.stiffness * (c.gap + h * c.normal.dot(&velocity));
            if force <= 0.0 {
                continue;
            }
            // Effective mass of the contact point: an impulse J there moves it by J Σ w²/m.
            let free = |p: usize| p >= topology.n_kinematic;
            let inv_mass: f64 = c
                .ends
                .iter()
                .zip(c.weight)
                .filter(|(p, _)| free(**p))
                .map(|(&p, w)| w * w / batch.mass[p][c.lane])
                .sum();
            if inv_mass <= 0.0 {
                continue;
            }
            let relative = velocity - c.solid_velocity;
            let tangential = relative - c.normal * c.normal.dot(&relative);
            let left = slip_factor(
                tangential.norm() as f32,
                c.friction as f32,
                force as f32,
                (1.0 / inv_mass) as f32,
                h as f32,
            );
            let change = tangential * (f64::from(left) - 1.0);
            for (&p, w) in c.ends.iter().zip(c.weight) {
                if free(p) {
                    let share = w / batch.mass[p][c.lane] / inv_mass;
                    let v = get(&state.velocity[p], c.lane) + change * share;
                    set(&mut state.velocity[p], c.lane, v);
                }
            }
        }
    }
}

impl Contact {
    /// Adds the penalty k (gap + h n·v) n, implicit in the new velocities, to one lane of the system.
    #[inline(always)]
    pub(crate) fn add_to(&self, topology: &Topology, h: f64, matrix: &mut BandedMatrix, rhs: &mut [Lane]) {
        debug_assert!(self.lane < LANES);
        let n_kin = topology.n_kinematic;
        let known = h * self.normal.dot(&self.known);
        for e in 0..2 {
            if self.ends[e] < n_kin {
                continue;
            }
            let row = self.ends[e] - n_kin;
            for p in 0..3 {
                rhs[3 * row + p][self.lane] -= h * self.stiffness * self.weight[e] * (self.gap + known) * self.normal[p];
                for f in 0..=e {
                    if self.ends[f] < n_kin {
                        continue;
                    }
                    let weights = h * h * self.stiffness * self.weight[e] * self.weight[f];
                    let block = matrix.block(row, self.ends[f] - n_kin);
                    for q in 0..3 {
                        block[3 * p + q][self.lane] += weights * self.normal[p] * self.normal[q];
                    }
                }
            }
        }
    }
}
