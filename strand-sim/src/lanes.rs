//! Eight strands side by side: the unit every solve works in.
//!
//! A scalar of the algorithm is an array over strands of equal topology, so plain loops over it become vector
//! instructions. Inside the solve `mul_add` is used throughout: exactly rounded, hence the same bits on every machine.
//! Outside it is avoided, since without the machine's own instruction it becomes a function call.

/// Strands solved together.
pub const LANES: usize = 8;

/// One scalar for each strand of a batch.
pub type Lane = [f64; LANES];

/// A vector for each strand of a batch: x, y, z.
pub type Lane3 = [Lane; 3];

/// A lane of zeros.
pub const ZERO: Lane = [0.0; LANES];
