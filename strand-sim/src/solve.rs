//! Linear solves of a batch of strands.

pub mod banded;
pub mod coupled;
pub mod jacobi_cg;
