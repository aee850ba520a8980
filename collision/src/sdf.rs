//! Signed distance fields of rigid solids, in the solid's own frame (AS16 §5.1).
//!
//! [`grid`] samples, [`bake`] computes the values from a function or a closed mesh, `mesh` refuses what has no inside.
//! Positive outside, negative inside, centimetres throughout.

pub mod bake;
pub mod grid;
pub(crate) mod mesh;

pub use bake::{BakeParams, bake_from_fn, bake_from_mesh};
pub use grid::{Bounds, SignedDistanceField};
