//! Which strands become guides: sparse coding of the motion (AS16 Eq. 9), then the hair nearest to each atom (Eq. 10).
//!
//! All of it works on motion signals of reduced dimension ([`crate::reduce`]), scaled as described there.

pub mod graph;
pub mod lasso;
mod near;
pub mod nearest;
pub mod partition;
pub mod sparse_coding;
pub mod spread;
mod sums;
mod vectors;
