//! The runtime behind a C interface: what an engine links, with the header `include/adaptive_hair.h`.
//!
//! Everything a host can get wrong is a status and a message, never a crash: null and misaligned pointers, poses that are
//! no poses, files that are no models. Panics are caught at the border. What the calls mean is said once, in the header,
//! which is generated from `ffi` and `types` by `cargo run -p adaptive-runtime-c --example header`.
//!
//! `ffi` is the only module with unsafe code: it turns pointers into references and calls the safe ones.

mod error;
pub mod ffi;
mod guard;
mod hair;
mod solids;
pub mod types;

pub use hair::{AhHair, AhModel};
pub use solids::{AhRod, AhSolid};
