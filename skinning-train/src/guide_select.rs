//! Which strands become guides: sparse coding of the motion (AS16 Eq. 9), then the hair nearest to each atom (Eq. 10).
//!
//! All of that works on motion signals of reduced dimension ([`crate::reduce`]), scaled as described there. What it is
//! compared with ([`method`]) does not: guides by a graph of strands that move alike, at random, or spread evenly.

pub mod graph;
pub mod lasso;
pub mod method;
mod near;
pub mod nearest;
pub mod part_eligible;
pub mod partition;
pub mod sparse_coding;
pub mod spread;
mod sums;
mod vectors;
