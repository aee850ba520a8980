//! Solids, and questions about points and segments.
//!
//! A [`Solid`] is a signed distance field in its own frame, baked once; every question is asked in that frame. A
//! [`DeformingSolid`] has one for each key frame and is interpolated between them (MS08 §5.1). The crate
//! knows nothing of skinning or springs: it sees points, segments and ribbons between segments.
//!
//! - [`sdf`]: the field on a grid, baked from a mesh or a function (AS16 §5.1)
//! - [`shapes`]: closed forms, for tools and tests
//! - [`contact`]: the deepest point of a segment
//! - [`clearance`]: the interpolation check between two guides (AS16 §4.2)
//! - [`penalty`], [`friction`]: contact forces (AS16 §5.1, §7.1)
//! - [`cull`]: when a strand needs no query at all
//! - [`spatial_hash`], [`segment_pair`]: which hair segments are near each other, and which cross (MS08 §5.2, §5.3)
//!
//! Centimetre, gram, second; positive distances are outside. Queries neither fail nor allocate; what has no inside is
//! refused when it is baked.
//!
//! ```
//! use collision::{contact, shapes::Shape, Solid};
//! use nalgebra::Vector3;
//!
//! let tooth = Shape::capsule(Vector3::zeros(), Vector3::new(0.0, 0.0, -3.0), 0.1);
//! let tooth = Solid::from_shape("tooth", &tooth.into(), 0.025, 0.1, 0.3)?;
//! // Both ends of the segment are half a centimetre away, and yet it is pierced.
//! let (a, b) = (Vector3::new(-0.5, 0.0, -1.0), Vector3::new(0.5, 0.0, -1.0));
//! let hit = contact::deepest_on_segment(&tooth.sdf, a, b, tooth.half_thickness_cm, 0.0);
//! assert!(hit.is_some_and(|hit| hit.distance < -0.08));
//! # Ok::<(), collision::Error>(())
//! ```

mod body;
pub mod ccd;
pub mod clearance;
pub mod contact;
pub mod cull;
mod deforming;
mod error;
pub mod friction;
mod lanes;
pub mod penalty;
pub mod sdf;
pub mod segment_pair;
pub mod shapes;
mod solid;
pub mod spatial_hash;
pub mod surface;
mod thickness;

pub use body::MovingBody;
pub use clearance::{ribbon_is_free, segment_is_free, strand_ribbon_is_free};
pub use contact::{SegmentContact, deepest_between, deepest_on_segment};
pub use deforming::{DeformingSolid, KeyedMesh, MovingDeformingSolid};
pub use error::Error;
pub use friction::friction_velocity;
pub use penalty::{PenaltyParams, SegmentForce, penalty_force, penalty_on_segment};
pub use sdf::{
    BakeParams, Bounds, DeformedField, DistanceField, FIELD_VERSION, FieldId, Samples, SignedDistanceField,
    bake_from_fn, bake_from_mesh,
};
pub use shapes::{Shape, ShapeUnion};
pub use solid::{MovingSolid, Solid, SolidPose, VelocityField};
