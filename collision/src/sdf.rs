//! Signed distance fields of solids, in the solid's own frame (AS16 §5.1, MS08 §5.1).
//!
//! [`grid`] samples, [`bake`] computes the values from a function or a closed mesh, `mesh` refuses what has no inside.
//! [`advect`] interpolates between key frames of a body that deforms.
//! Positive outside, negative inside, centimetres throughout.

pub mod advect;
pub mod bake;
pub(crate) mod bricks;
pub mod field;
pub mod grid;
pub(crate) mod mesh;
pub(crate) mod mesh_bake;
pub(crate) mod shift;
pub(crate) mod tree;

pub use advect::DeformedField;
pub use bake::{BakeParams, bake_from_fn, bake_from_mesh};
pub use field::DistanceField;
pub use grid::{Bounds, FieldId, SignedDistanceField};
