//! Stick or slip: the friction model of AS16 §7.1, after Bridson 2002.
//!
//! Friction takes at most `mu f_r dt / m` of tangential velocity: all of it when that suffices (stuck), else that much. It
//! never reverses the sliding and never touches the normal part.

use nalgebra::Vector3;

/// Velocity (cm/s, relative to the solid) after friction over a step of `dt` seconds, for hair of `mass` grams pressed on
/// by `normal_force` dyn along the unit `normal`. A mass of zero sticks.
pub fn friction_velocity(
    relative_velocity: Vector3<f32>,
    normal: Vector3<f32>,
    friction: f32,
    normal_force: f32,
    mass: f32,
    dt: f32,
) -> Vector3<f32> {
    let along_normal = normal * relative_velocity.dot(&normal);
    let tangential = relative_velocity - along_normal;
    along_normal + tangential * slip_factor(tangential.norm(), friction, normal_force, mass, dt)
}

/// Share of a tangential speed (cm/s) that friction leaves: 0 when the contact sticks.
pub fn slip_factor(speed: f32, friction: f32, normal_force: f32, mass: f32, dt: f32) -> f32 {
    let impulse = friction * normal_force.max(0.0) * dt;
    if impulse <= 0.0 {
        return 1.0;
    }
    // Products instead of quotients: neither speed nor mass may be zero in a denominator.
    let momentum = speed * mass;
    if momentum <= impulse { 0.0 } else { 1.0 - impulse / momentum }
}
