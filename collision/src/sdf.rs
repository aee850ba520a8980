//! Signed distance fields of solids, in the solid's own frame (AS16 §5.1, MS08 §5.1).
//!
//! [`grid`] samples, [`batch`] many points at once, from bricks that are fine near the surface; [`bake`] computes the values
//! from a function or a mesh, `mesh` closes it or refuses what has no inside, `tree` answers for its triangles; [`bytes`] keep them.
//! [`advect`] interpolates between key frames of a body that deforms.
//! Positive outside, negative inside, centimetres throughout.

pub mod advect;
pub mod bake;
pub mod batch;
pub(crate) mod bricks;
pub mod bytes;
pub mod field;
pub mod grid;
pub(crate) mod mesh;
pub(crate) mod mesh_bake;
pub(crate) mod shift;
pub(crate) mod tree;

pub use advect::DeformedField;
pub use bake::{BakeParams, bake_from_fn, bake_from_mesh};
pub use batch::Samples;
pub use bytes::FIELD_VERSION;
pub use field::DistanceField;
pub use grid::{Bounds, FieldId, SignedDistanceField};
