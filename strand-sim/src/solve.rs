//! Linear solves of a batch of strands.

pub mod banded;
