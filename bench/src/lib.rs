//! Generated scenes and what is seen of them.
//!
//! - [`shapes`]: solids made of closed forms (sphere, rod, comb, head) and their meshes
//! - [`shapes_gear`], [`shapes_hand`]: gears cut through, a hand that closes and opens, as closed meshes
//! - [`grooms`]: a combed head of hair of any strand count, from a seed
//! - [`picture`]: pictures without a window
//! - [`baked`]: solids of meshes, baked once and kept
//! - [`world`]: a scene made real; [`full_space`]: every strand of it simulated
//! - [`head_motion`]: random head motion; [`training_motions`]: what is trained on, and what is kept apart
//! - [`comb_sweeps`]: combs swept through strands, and what goes through
//! - [`collision_checks`]: the interpolation check beside exact tests, and what culling saves
//! - [`collision_bench`]: what distance fields cost, and their errors
//! - [`sparse_signals`]: dictionary learning beside what another library reached on the same matrices
//! - [`strand_scenes`]: the tests of MS08 on single hairs and a tuft
//! - [`training_bench`]: what the kernels of training cost, and how far they are from a general solver
//! - [`chart`]: curves over a number, as a picture
//! - [`guide_comparison`]: ways to select guides, judged on motion they were not trained on
//! - [`runtime_bench`]: what the runtime costs on whole heads, and what it is worth
//! - [`evidence`]: what experiments hand to the report; [`experiments`]: the papers' comparisons, run anew; [`report`]: the page,
//!   Markdown and JSON made of what they find; [`baseline`]: what got worse since an earlier version
//! - [`run`]: a scene run in one of the modes compared; [`measures`]: what it is judged by
//!
//! Centimetre, gram, second. Everything here is a function of its parameters and seed: the same bytes on any machine
//! with the same floating-point library, for any thread count.

pub mod baked;
pub mod baseline;
pub mod chart;
pub mod collision_bench;
pub mod collision_checks;
pub mod comb_sweeps;
mod error;
pub mod evidence;
pub mod experiments;
pub mod full_space;
pub mod grooms;
pub mod guide_comparison;
pub mod head_motion;
mod histogram;
pub mod measures;
pub mod picture;
pub mod report;
pub mod run;
pub mod runtime_bench;
pub mod shapes;
pub mod shapes_bumpy;
pub mod shapes_gear;
pub mod shapes_hand;
pub mod sparse_signals;
pub mod strand_bench;
pub mod strand_scenes;
pub mod training_bench;
pub mod training_motions;
pub mod world;

pub use error::Error;
