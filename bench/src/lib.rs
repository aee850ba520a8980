//! Generated scenes and what is seen of them.
//!
//! - [`shapes`]: solids made of closed forms (sphere, rod, comb, head) and their meshes
//! - [`grooms`]: a combed head of hair of any strand count, from a seed
//! - [`picture`]: pictures without a window
//!
//! Centimetre, gram, second. Everything here is a function of its parameters and seed: the same bytes on any machine
//! with the same floating-point library, for any thread count.

mod error;
pub mod grooms;
pub mod picture;
pub mod shapes;

pub use error::Error;
