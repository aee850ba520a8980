//! Penalty forces that push hair out of a solid (AS16 §5.1), along whole segments.
//!
//! A contact inside a segment acts on both end particles by barycentric weight, which keeps force and moment. The force
//! never pulls: damping may cancel the push of a leaving hair, not reverse it.

use nalgebra::Vector3;

use crate::contact::SegmentContact;

/// How hard a solid pushes back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PenaltyParams {
    /// Force per depth, dyn/cm. An explicit step of `dt` is stable up to about `4 m / dt^2`.
    pub stiffness: f32,
    /// Force per approach velocity, dyn s/cm.
    pub damping: f32,
    /// Distance from the surface at which the push begins, cm.
    pub skin: f32,
}

/// A contact's force on the end particles of its segment, dyn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SegmentForce {
    /// On the first end.
    pub on_a: Vector3<f32>,
    /// On the second end.
    pub on_b: Vector3<f32>,
    /// Size of the whole push, f_r of AS16 §7.1: what friction is proportional to.
    pub normal_force: f32,
}

/// Size (dyn, not negative) of the push at signed `distance` (cm) for hair that moves at `approach` (cm/s) along the
/// outward normal, relative to the solid; negative approaches.
pub fn penalty_magnitude(distance: f32, approach: f32, params: &PenaltyParams) -> f32 {
    let depth = params.skin - distance;
    if depth > 0.0 { (params.stiffness * depth - params.damping * approach).max(0.0) } else { 0.0 }
}

/// Force (dyn) on a point at signed `distance` (cm) with outward unit `normal`, moving at `relative_velocity` (cm/s) to
/// the solid.
pub fn penalty_force(
    distance: f32,
    normal: Vector3<f32>,
    relative_velocity: Vector3<f32>,
    params: &PenaltyParams,
) -> Vector3<f32> {
    normal * penalty_magnitude(distance, relative_velocity.dot(&normal), params)
}

/// Force of a contact on its segment's ends, which move at `velocity_a` and `velocity_b` (cm/s) relative to the solid.
pub fn penalty_on_segment(
    contact: &SegmentContact,
    velocity_a: Vector3<f32>,
    velocity_b: Vector3<f32>,
    params: &PenaltyParams,
) -> SegmentForce {
    let velocity = velocity_a.lerp(&velocity_b, contact.s);
    let normal_force = penalty_magnitude(contact.distance, velocity.dot(&contact.normal), params);
    let force = contact.normal * normal_force;
    SegmentForce { on_a: force * (1.0 - contact.s), on_b: force * contact.s, normal_force }
}
