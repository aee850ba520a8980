//! Tolerances of the laws, each with its reason.

/// Double-precision rounding over coordinates of some tens of centimetres, carried through a few hundred steps, cm.
pub const ROUND_OFF_CM: f64 = 1e-9;

/// Single-precision rounding of a position some tens of centimetres from the origin, cm: four units in the last place.
pub const SINGLE_ROUND_OFF_CM: f64 = 4.0 * 64.0 * f32::EPSILON as f64;

/// How near a strand may come to a surface beneath the contact offset, cm. Contact is a penalty: what holds a hair off is a
/// hundredth of the penetration it would have, and a sample may lie between two that were pushed.
pub const CONTACT_SLACK_CM: f64 = 0.01;

/// Movement in a second that no picture shows, cm.
pub const STILL_CM: f64 = 1e-6;

/// Depth from which a hair counts as inside a solid, cm: half a tenth of a millimetre, as in the measures of the salon.
pub const INSIDE_CM: f32 = 0.005;
