//! Contact of strand segments with solids: penalty and sticking inside the implicit matrix (AS16 §5.1, §7.1).
//!
//! A strand is tested along its segments, since a comb's tooth is thinner than the spacing of particles; the force at the
//! deepest point of a segment acts on its two ends by barycentric weight. The penalty is k n nᵀ on two neighbouring
//! particles, so it stays within the band and its stiffness is bounded by accuracy, not by the step.

use crate::bearing::Bearings;
use crate::lanes::{LANES, Lane, Lane3};
use crate::rig::Topology;
use crate::solve::banded::BandedMatrix;
use crate::step::{Span, StepInput, StepParams, Work};
use crate::system::{Batch, BatchState, StrandSystem, get, set};
use crate::watch::{Reach, Sights};
use collision::friction::slip_factor;
use collision::{DistanceField, MovingBody, MovingDeformingSolid, MovingSolid, SegmentContact, deepest_between};
use nalgebra::{Isometry3, Vector3};

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
    /// Whether a substep in which friction lets go of what it held is solved again with what it may hold; otherwise that
    /// acts from the next substep on.
    pub solve_torn_again: bool,
}

impl ContactParams {
    /// A hair's own radius and grid error as offset; stiff enough to leave a hundredth of a penetration.
    #[must_use]
    pub fn standard() -> Self {
        Self {
            offset_cm: 0.012,
            stiffness_over_inertia: 100.0,
            max_push_speed: 50.0,
            spacing_over_half_thickness: 0.6,
            solve_torn_again: true,
        }
    }
}

/// One segment of one strand touching one solid during one substep.
#[derive(Clone, Copy, Debug)]
pub struct Contact {
    /// Lane of the strand.
    pub lane: usize,
    /// Particles at the segment's ends, in the order of the matrix with the fixed ones counted.
    pub ends: [usize; 2],
    /// Barycentric weights of the ends.
    pub weight: [f64; 2],
    /// Outward normal in the world frame.
    pub normal: Vector3<f64>,
    /// Gap at the old positions against the solid's new pose, cm; negative inside.
    pub gap: f64,
    /// Penalty stiffness, dyn/cm.
    pub stiffness: f64,
    /// Velocity of the solid at the contact relative to what carries the strand, cm/s.
    pub solid_velocity: Vector3<f64>,
    /// Coulomb coefficient.
    pub friction: f64,
    /// Damping across the normal, dyn·s/cm, by which friction acts in the solve; zero of a contact that slides, which is
    /// slowed after it.
    pub grip: f64,
    /// Speed across the normal that friction would leave a lone particle, cm/s; positive.
    pub slip: f64,
    /// Velocity that prescribed ends contribute at the contact, cm/s.
    pub known: Vector3<f64>,
}

/// Damping across the normal of a contact that sticks, as a multiple of a particle's m/h: what would slide by g h² a
/// substep creeps by a hundred-thousandth of it.
const GRIP_OVER_INERTIA: f64 = 1e5;

/// Friction is asked to stop what slides up to this often as fast as a lone particle that it could stop: particles bear more
/// than their own weight, that of the perturbed ones beside them or a load that bends the hair.
const CARRIED: f64 = 3.0;

/// Least slip of a contact that is torn from where it stuck, as a share of the speed that friction stops in a substep.
const CREEP: f64 = 0.02;

/// How far a contact may draw a strand back before it is let go, cm: a twentieth of a hair's weight.
const PULLED_CM: f64 = 1e-5;

/// A point between a segment's ends is a contact of its own where it is deeper than both by this, cm.
const DEEPER_CM: f32 = 1e-4;

/// Gaps up to this are watched, so that a strand closing in stops at the surface and not behind it, cm.
const WATCHED_GAP_CM: f64 = 0.1;

/// What forces may add to a strand's movement within a substep, cm: gravity adds 0.025 in 5 ms.
const UNFORESEEN_CM: f64 = 0.03;

/// Farthest that a strand's own movement within a substep is looked ahead, cm.
const FARTHEST_CM: f64 = 0.5;

/// A point where a strand is nearest a solid.
#[derive(Clone, Copy, Debug)]
pub struct NearPoint {
    /// Segment, from particle `segment` to the next.
    pub segment: usize,
    /// Position along it, 0 to 1.
    pub s: f64,
    /// Outward normal in the world frame.
    pub normal: Vector3<f64>,
    /// Signed distance less the contact offset, cm.
    pub gap: f64,
}

/// Visits the deepest point of every segment of a strand that comes within watching distance of a solid posed at
/// `world_from_solid`, from particle `first` on; returns a lower bound of the strand's distance to the solid, cm.
pub fn near_points(
    particles: std::ops::Range<usize>,
    position: impl Fn(usize) -> Vector3<f64>,
    moving: &MovingSolid,
    world_from_solid: &Isometry3<f64>,
    params: &ContactParams,
    visit: impl FnMut(NearPoint),
) -> f64 {
    let (solid, reach) = (moving.solid, |_| params.reach());
    near_points_in(particles, position, &solid.sdf, solid.half_thickness_cm, world_from_solid, params, reach, visit)
}

/// As [`near_points`], for any field at one moment, of a body of the given half-thickness (cm), and with a watching
/// distance for each segment (cm).
pub fn near_points_in(
    particles: std::ops::Range<usize>,
    position: impl Fn(usize) -> Vector3<f64>,
    field: &impl DistanceField,
    half_thickness_cm: f32,
    world_from_solid: &Isometry3<f64>,
    params: &ContactParams,
    reach: impl Fn(usize) -> f64,
    mut visit: impl FnMut(NearPoint),
) -> f64 {
    let spacing = half_thickness_cm * params.spacing_over_half_thickness as f32;
    let solid_from_world = world_from_solid.inverse();
    near_segments(particles, position, field, &solid_from_world, reach, |i, ends, distance, reach| {
        if let Some(hit) = deepest_between(field, ends, distance, spacing, reach) {
            visit(NearPoint::new(i, &hit, world_from_solid, params));
        }
    })
}

/// Visits every segment of a strand that may come within its reach of a field, with its ends in the solid's frame and their
/// distances; returns a lower bound of the strand's distance to the solid, cm.
fn near_segments(
    particles: std::ops::Range<usize>,
    position: impl Fn(usize) -> Vector3<f64>,
    field: &impl DistanceField,
    solid_from_world: &Isometry3<f64>,
    reach: impl Fn(usize) -> f64,
    mut visit: impl FnMut(usize, [Vector3<f32>; 2], [f32; 2], f32),
) -> f64 {
    let in_solid = |i: usize| solid_from_world.transform_point(&position(i).into()).coords.cast::<f32>();
    let mut a = in_solid(particles.start);
    let mut distance_a = field.lower_bound(a);
    let mut clear = distance_a;
    for i in particles.start..particles.end - 1 {
        let b = in_solid(i + 1);
        let distance_b = field.lower_bound(b);
        // A distance changes by at most the length walked.
        let least = 0.5 * (distance_a + distance_b - (b - a).norm());
        clear = clear.min(least);
        let reach = reach(i) as f32;
        if least < reach {
            visit(i, [a, b], [field.distance(a), field.distance(b)], reach);
        }
        (a, distance_a) = (b, distance_b);
    }
    f64::from(clear)
}

/// Visits where a segment may bear on a solid within its reach: its far end, its near end if no segment before it has
/// that, and the deepest point between where that is deeper. Hair that lies flat bears on all its particles: the deepest
/// point alone would jump from end to end, and what it leaves fall for a substep.
#[inline(always)]
fn bearing_points(
    field: &impl DistanceField,
    ends: [Vector3<f32>; 2],
    distance: [f32; 2],
    spacing: f32,
    reach: f32,
    is_first: bool,
    mut visit: impl FnMut(&SegmentContact),
) {
    let Some(hit) = deepest_between(field, ends, distance, spacing, reach) else { return };
    for e in usize::from(!is_first)..2 {
        let s = e as f32;
        if hit.s == s {
            visit(&hit);
        } else if distance[e] < reach {
            visit(&SegmentContact { s, distance: distance[e], normal: field.outward_normal(ends[e]).1 });
        }
    }
    if hit.distance < distance[0].min(distance[1]) - DEEPER_CM {
        visit(&hit);
    }
}

impl ContactParams {
    /// Distance within which a strand is watched, cm.
    #[must_use]
    pub fn reach(&self) -> f64 {
        self.offset_cm + WATCHED_GAP_CM
    }
}

impl StrandSystem {
    /// Finds the contacts of all lanes at the solids' poses at the end of a substep.
    pub(crate) fn find_contacts(
        &self,
        batch: &Batch,
        state: &mut BatchState,
        input: &StepInput,
        params: &StepParams,
        span: Span,
        work: &mut Work,
    ) {
        state.sights.truncate(input.solids.len());
        let strands = Strands { system: self, batch, topology: &self.topologies[batch.topology], input, params, span };
        for (k, moving) in input.solids.iter().enumerate() {
            strands.meet_rigid(moving, k, state, work);
        }
        if state.clearance.len() != input.deforming.len() {
            state.clearance.clear();
            // Nothing is known of a new body: its distance bound starts below zero.
            state.clearance.resize(input.deforming.len(), [-1.0; LANES]);
        }
        for (k, moving) in input.deforming.iter().enumerate() {
            strands.meet_deforming(moving, k, state, work);
        }
        work.sort_contacts();
    }
}

/// The strands of a batch during one substep.
struct Strands<'a> {
    system: &'a StrandSystem,
    batch: &'a Batch,
    topology: &'a Topology,
    input: &'a StepInput<'a>,
    params: &'a StepParams,
    span: Span,
}

impl Strands<'_> {
    /// Finds the contacts with rigid solid `k`.
    fn meet_rigid(&self, moving: &MovingSolid, k: usize, state: &mut BatchState, work: &mut Work) {
        let (topology, params, span) = (self.topology, &self.params.contact, self.span);
        let field = &moving.solid.sdf;
        if state.sights.len() <= k {
            state.sights.push(Sights::new(field, self.system.n_main));
        }
        state.sights[k].turn_to(field);
        let world_from_solid = moving.pose.at(span.end);
        let spacing = moving.solid.half_thickness_cm * params.spacing_over_half_thickness as f32;
        let friction = f64::from(moving.solid.friction);
        // A strand meets the solid, seen where the substep ends, within what it moves itself and what forces add to that.
        let reach = Reach { still: params.offset_cm + UNFORESEEN_CM, h: span.h, farthest: FARTHEST_CM };
        let motion = [&state.position[..], &state.velocity[..]];
        let mut view = std::mem::take(&mut work.view);
        let solid_from_world = world_from_solid.inverse();
        let solid_motion = moving.pose.velocity_field(self.input.dt);
        let n_lanes = self.batch.strands.len();
        let first = topology.first_free_main();
        view.look(field, &solid_from_world, motion, topology, n_lanes, reach, &mut state.sights[k], |met| {
            let is_first = met.segment == first;
            bearing_points(field, met.ends, met.distance, spacing, met.reach, is_first, |hit| {
                let near = NearPoint::new(met.segment, hit, &world_from_solid, params);
                self.add_contact(near, met.lane, motion, |at| solid_motion.at(at), friction, &mut state.bearings, work);
            });
        });
        work.view = view;
    }

    /// Finds the contacts with one deforming body, whose distance bounds are `state.clearance[k]`.
    fn meet_deforming(&self, moving: &MovingDeformingSolid, k: usize, state: &mut BatchState, work: &mut Work) {
        let (topology, params, span, n_main) = (self.topology, &self.params.contact, self.span, self.system.n_main);
        let first = topology.first_free_main();
        let by_solid = moving.max_displacement() * (span.end - span.begin);
        let speed = |i: usize, lane: usize| get(&state.velocity[topology.rig_of_main(i)], lane).norm();
        // A strand meets the solid, seen where the substep ends, within what it moves itself and what forces add to that.
        let reach = |speed: f64| params.offset_cm + UNFORESEEN_CM + (speed * span.h).min(FARTHEST_CM);
        let fastest: [f64; LANES] =
            std::array::from_fn(|lane| (first..n_main).map(|i| speed(i, lane)).fold(0.0, f64::max));
        let is_clear = |lane: usize| state.clearance[k][lane] - by_solid > reach(fastest[lane]);
        let n_lanes = self.batch.strands.len();
        if (0..n_lanes).all(is_clear) {
            return;
        }
        let world_from_solid = moving.pose().at(span.end);
        let solid_from_world = world_from_solid.inverse();
        let field = &moving.field_at(span.end);
        let spacing = moving.half_thickness_cm() * params.spacing_over_half_thickness as f32;
        let friction = f64::from(moving.friction());
        for lane in 0..n_lanes {
            if state.clearance[k][lane] - by_solid > reach(fastest[lane]) {
                continue;
            }
            let position = |i: usize| get(&state.position[topology.rig_of_main(i)], lane);
            let motion = [&state.position[..], &state.velocity[..]];
            let velocity_at = |at| moving.velocity_at(at, span.end, self.input.dt);
            let watched = |i: usize| reach(speed(i, lane).max(speed(i + 1, lane)));
            let visit = |i: usize, ends: [Vector3<f32>; 2], distance: [f32; 2], reach: f32| {
                bearing_points(field, ends, distance, spacing, reach, i == first, |hit| {
                    let near = NearPoint::new(i, hit, &world_from_solid, params);
                    self.add_contact(near, lane, motion, velocity_at, friction, &mut state.bearings, work);
                });
            };
            let clear = near_segments(first..n_main, position, field, &solid_from_world, watched, visit);
            // The bound is as of before this substep's movement, which is subtracted with the rest.
            state.clearance[k][lane] = clear + by_solid;
        }
    }

    /// Keeps the contact of one lane at a point near a solid: in the solve if it would be at the surface within the substep
    /// with no force but those from outside (by its own velocity alone if it pulled when last solved for), and to stick if
    /// friction might stop it.
    #[inline(always)]
    fn add_contact(
        &self,
        near: NearPoint,
        lane: usize,
        [position, velocity]: [&[Lane3]; 2],
        velocity_of_solid: impl Fn(Vector3<f64>) -> Vector3<f64>,
        friction: f64,
        bearings: &mut Bearings,
        work: &mut Work,
    ) {
        let (topology, h) = (self.topology, self.span.h);
        let ends = [topology.rig_of_main(near.segment), topology.rig_of_main(near.segment + 1)];
        let at = |of: &[Lane3]| near.between(get(&of[ends[0]], lane), get(&of[ends[1]], lane));
        let solid_velocity = velocity_of_solid(at(position));
        let mass = self.batch.mass[ends[1]][lane];
        let mut found = Contact::at(&near, lane, ends, solid_velocity, friction, mass, h, &self.params.contact);
        if ends[0] < topology.n_kinematic {
            found.known = work.known_velocity(ends[0], lane) * found.weight[0];
        }
        let now = at(velocity);
        let free = now + self.acceleration(&near, lane, ends) * h;
        // Speed into the solid that the contact has to take away.
        let pressed = -(near.gap / h + near.normal.dot(&free));
        let (pulled, torn) = bearings.of(&found);
        if pressed <= 0.0 || (pulled && !near.is_closing(now, h)) {
            work.watched.push(found);
            return;
        }
        let stopped = friction * pressed;
        let is_slow = found.across(now - solid_velocity).norm_squared() < (CARRIED * stopped).powi(2);
        found.slip = (found.across(free - solid_velocity).norm() - stopped).max(CREEP * stopped);
        if torn > 0.0 {
            // What an impact allowed is no measure of what follows it.
            found.grip = torn.min(CARRIED * stopped * mass / h) / found.slip;
        } else if is_slow {
            found.grip = GRIP_OVER_INERTIA * mass / h;
        }
        work.contacts.push(found);
    }

    /// Acceleration that gravity and outside forces give at a point, cm/s².
    #[inline(always)]
    fn acceleration(&self, near: &NearPoint, lane: usize, ends: [usize; 2]) -> Vector3<f64> {
        let forces = self.input.forces;
        if forces.is_empty() {
            return self.params.gravity;
        }
        let first = self.batch.strands[lane] as usize * self.system.n_main + near.segment;
        let of = |e: usize| forces[first + e] / self.batch.mass[ends[e]][lane];
        self.params.gravity + near.between(of(0), of(1))
    }
}

impl NearPoint {
    fn new(segment: usize, hit: &SegmentContact, world_from_solid: &Isometry3<f64>, params: &ContactParams) -> Self {
        Self {
            segment,
            s: f64::from(hit.s),
            normal: (world_from_solid.rotation * hit.normal.cast::<f64>()).normalize(),
            gap: f64::from(hit.distance) - params.offset_cm,
        }
    }

    /// Whether a strand moving at `velocity` (cm/s) is at the surface within `h` seconds.
    #[must_use]
    pub fn is_closing(&self, velocity: Vector3<f64>, h: f64) -> bool {
        self.gap + h * self.normal.dot(&velocity) < 0.0
    }

    /// A quantity at the point, from its values at the segment's two ends.
    #[must_use]
    pub fn between(&self, a: Vector3<f64>, b: Vector3<f64>) -> Vector3<f64> {
        a * (1.0 - self.s) + b * self.s
    }
}

impl Contact {
    /// The contact at a point near a solid over a substep of `h` seconds. Only for a strand that is closing in, or the
    /// penalty would pull. `mass` is that of a particle, g.
    #[must_use]
    pub fn at(
        near: &NearPoint,
        lane: usize,
        ends: [usize; 2],
        solid_velocity: Vector3<f64>,
        friction: f64,
        mass: f64,
        h: f64,
        params: &ContactParams,
    ) -> Self {
        let fastest = params.max_push_speed + solid_velocity.norm();
        Self {
            lane,
            ends,
            weight: [1.0 - near.s, near.s],
            normal: near.normal,
            gap: near.gap.max(-fastest * h),
            stiffness: params.stiffness_over_inertia * mass / (h * h),
            solid_velocity,
            friction,
            grip: 0.0,
            slip: 0.0,
            known: Vector3::zeros(),
        }
    }

    /// Moves a strand that a substep of `h` seconds left inside the solid, after all, to the surface, and takes the
    /// velocity into the solid from it, with the friction that goes with that (MS08 §4 step 5). `position` has moved from
    /// `old`; the first `n_fixed` particles are prescribed. The solve cannot see what forces drive into a solid that velocity alone does not, nor what strain
    /// limiting moves after it.
    pub fn push_out(
        &self,
        n_fixed: usize,
        h: f64,
        mass: &[Lane],
        old: &[Lane3],
        position: &mut [Lane3],
        velocity: &mut [Lane3],
    ) {
        let lane = self.lane;
        let at = |of: &[Lane3]| {
            get(&of[self.ends[0]], lane) * self.weight[0] + get(&of[self.ends[1]], lane) * self.weight[1]
        };
        let gap = self.gap + self.normal.dot(&(at(position) - at(old)));
        let ends = || self.ends.into_iter().zip(self.weight).filter(|&(p, _)| p >= n_fixed);
        let inv_mass: f64 = ends().map(|(p, w)| w * w / mass[p][lane]).sum();
        if gap >= 0.0 || inv_mass <= 0.0 {
            return;
        }
        let relative = at(velocity) - self.solid_velocity;
        let along = self.normal.dot(&relative);
        let sliding = relative - self.normal * along;
        let inward = along.min(0.0);
        // What a solve that saw the contact would have changed the normal velocity by bounds what friction may.
        let held = self.friction * (-gap / h - inward);
        let slowed = sliding * (-(held / sliding.norm().max(f64::MIN_POSITIVE)).min(1.0));
        for (p, w) in ends() {
            let share = w / mass[p][lane] / inv_mass;
            let x = get(&position[p], lane) + (slowed * h - self.normal * gap) * share;
            set(&mut position[p], lane, x);
            let v = get(&velocity[p], lane) + (slowed - self.normal * inward) * share;
            set(&mut velocity[p], lane, v);
        }
    }

    /// The part of a vector across the normal.
    #[inline(always)]
    fn across(&self, v: Vector3<f64>) -> Vector3<f64> {
        v - self.normal * self.normal.dot(&v)
    }

    /// Adds the penalty k (gap + h n·v) n and the grip, implicit in the new velocities, to one lane of the system whose
    /// first `n_fixed` particles are prescribed.
    #[inline(always)]
    pub fn add_to(&self, n_fixed: usize, h: f64, matrix: &mut BandedMatrix, rhs: &mut [Lane]) {
        let known = h * self.normal.dot(&self.known);
        let mut push = self.normal * (-h * self.stiffness * (self.gap + known));
        // h² k n nᵀ + h c (I - n nᵀ)
        let around = h * self.grip;
        let along = h * h * self.stiffness - around;
        if self.grip > 0.0 {
            push += self.across(self.solid_velocity - self.known) * around;
        }
        for e in 0..2 {
            if self.ends[e] < n_fixed || self.weight[e] == 0.0 {
                continue;
            }
            let row = self.ends[e] - n_fixed;
            for p in 0..3 {
                rhs[3 * row + p][self.lane] += self.weight[e] * push[p];
            }
            for f in 0..=e {
                if self.ends[f] < n_fixed || self.weight[f] == 0.0 {
                    continue;
                }
                let weights = self.weight[e] * self.weight[f];
                let block = matrix.block(row, self.ends[f] - n_fixed);
                for p in 0..3 {
                    let pushed = weights * along * self.normal[p];
                    for q in 0..3 {
                        block[3 * p + q][self.lane] += pushed * self.normal[q];
                    }
                    block[4 * p][self.lane] += weights * around;
                }
            }
        }
    }

    /// What the solved velocities say a contact exerts.
    #[inline(always)]
    pub(crate) fn reaction(&self, h: f64, velocity: &[Lane3]) -> Reaction {
        let at = self.velocity(velocity);
        let pressing = -self.stiffness * (self.gap + h * self.normal.dot(&at));
        let gripping = if self.grip > 0.0 { self.grip * self.across(at - self.solid_velocity).norm() } else { 0.0 };
        Reaction { pressing, gripping }
    }

    /// Whether a solve has the contact draw the strand back, which no surface does.
    #[inline(always)]
    pub(crate) fn is_pulled(&self, reaction: &Reaction) -> bool {
        reaction.pressing < -self.stiffness * PULLED_CM
    }

    /// Slows what slides, on velocities that a solve of `h` seconds has found with this reaction.
    #[inline(always)]
    pub(crate) fn slow(&self, reaction: &Reaction, n_fixed: usize, h: f64, mass: &[Lane], velocity: &mut [Lane3]) {
        if self.grip == 0.0 && reaction.pressing > 0.0 {
            let impulse = self.friction_impulse(reaction.pressing, n_fixed, h, mass, velocity);
            self.push(impulse, n_fixed, mass, velocity);
        }
    }

    /// Velocity at the contact of particles that have these.
    #[inline(always)]
    fn velocity(&self, of: &[Lane3]) -> Vector3<f64> {
        get(&of[self.ends[0]], self.lane) * self.weight[0] + get(&of[self.ends[1]], self.lane) * self.weight[1]
    }

    /// Impulse by which friction under a normal force (dyn) slows what slides, g·cm/s.
    #[inline(always)]
    fn friction_impulse(
        &self,
        pressing: f64,
        n_fixed: usize,
        h: f64,
        mass: &[Lane],
        velocity: &[Lane3],
    ) -> Vector3<f64> {
        // Effective mass of the contact point: an impulse J there moves it by J Σ w²/m.
        let ends = self.ends.into_iter().zip(self.weight).filter(|&(p, _)| p >= n_fixed);
        let inv_mass: f64 = ends.map(|(p, w)| w * w / mass[p][self.lane]).sum();
        if inv_mass <= 0.0 {
            return Vector3::zeros();
        }
        let sliding = self.across(self.velocity(velocity) - self.solid_velocity);
        let (speed, mass) = (sliding.norm() as f32, (1.0 / inv_mass) as f32);
        let left = slip_factor(speed, self.friction as f32, pressing as f32, mass, h as f32);
        sliding * ((f64::from(left) - 1.0) / inv_mass)
    }

    /// An impulse (g·cm/s) at the contact on its two particles.
    #[inline(always)]
    fn push(&self, impulse: Vector3<f64>, n_fixed: usize, mass: &[Lane], velocity: &mut [Lane3]) {
        for (p, w) in self.ends.into_iter().zip(self.weight) {
            if p >= n_fixed {
                let v = get(&velocity[p], self.lane) + impulse * (w / mass[p][self.lane]);
                set(&mut velocity[p], self.lane, v);
            }
        }
    }

    /// Coulomb friction on the solved velocities of one contact that slides; returns the force on the strand, normal and
    /// tangential together, dyn. `velocity` and `mass` hold one entry per particle, the first `n_fixed` prescribed.
    /// Departure from AS16 §7.1: the normal force is the one the implicit solve found, not an estimate before it.
    pub fn apply_friction(&self, n_fixed: usize, h: f64, mass: &[Lane], velocity: &mut [Lane3]) -> Vector3<f64> {
        let pressing = self.reaction(h, velocity).pressing;
        if pressing <= 0.0 {
            return Vector3::zeros();
        }
        let impulse = self.friction_impulse(pressing, n_fixed, h, mass, velocity);
        self.push(impulse, n_fixed, mass, velocity);
        self.normal * pressing + impulse / h
    }
}

/// What a contact exerts on its strand.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reaction {
    /// Along the outward normal, dyn; negative where it pulls.
    pub pressing: f64,
    /// Size of what the grip exerts across it, dyn.
    pub gripping: f64,
}
