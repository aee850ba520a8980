//! Recorded hair frames in, skinning model out: the precomputation of AS16 §6.
//!
//! [`train`] selects guides by sparse coding (Eqs. 9, 10), chooses each strand's eligible guides, computes weights for all
//! of their subsets (Eq. 7, Algorithm 2), fits them along the strand (Eq. 8), and calibrates when guides count as moving
//! alike (§7.1). Frames are streamed through [`io_formats::FrameSource`]; nothing is simulated and no solid is seen. Same
//! inputs, same bytes, for any number of threads.
//!
//! ```
//! use io_formats::{FrameInfo, MaterialRecord, MemoryFrames, UniformGroom};
//! use skinning_train::{TrainInputs, TrainParams, train};
//!
//! // Twelve strands of five particles that sway, each a little later than its neighbour.
//! let shape = |t: f32| -> Vec<[f32; 3]> {
//!     let at = |k: usize| (k / 5, (k % 5) as f32);
//!     (0..60).map(at).map(|(s, i)| [s as f32 + 0.1 * i * i * (t + 0.2 * s as f32).sin(), -i, 0.0]).collect()
//! };
//! let groom = UniformGroom { n_strands: 12, n_particles: 5, points: shape(0.0) };
//! let mut frames = MemoryFrames::new(12, 5);
//! for f in 0..30 {
//!     frames.push(FrameInfo { sequence: 0, time_s: 0.05 * f as f64 }, &shape(0.3 * f as f32))?;
//! }
//! let material = MaterialRecord {
//!     stretch_dyn: 3e5, bend: 30.0, twist: 15.0, stretch_damping: 10.0, bend_damping: 0.05, twist_damping: 0.05,
//!     friction: 0.05, linear_density_g_per_cm: 5e-5, air_drag_per_s: 1.0,
//! };
//! let inputs = TrainInputs { rest: &groom, groom: &groom, material, provenance: 1 };
//! let (model, report) = train(&frames, &inputs, &TrainParams::standard(4), &mut |_| {})?;
//! assert_eq!(model.n_guides(), 4);
//! assert!(report.fit.free_cm <= report.fit.quadratic_cm);
//! # Ok::<(), skinning_train::Error>(())
//! ```

mod assemble;
mod keys;

pub mod driver;
pub mod eligible;
pub mod error;
pub mod gram;
pub mod guide_select;
pub mod motion_scales;
pub mod params;
pub mod poly_fit;
pub mod reduce;
pub mod stand_ins;
pub mod subset_lanes;
pub mod subset_weights;
pub mod subsets;
pub mod transforms;

pub use driver::{Guides, TrainInputs, Trainer, train};
pub use error::{Error, Result};
pub use keys::model_key;
pub use params::{EligibleRule, FitError, GuideMethod, JudgedFit, Progress, TrainParams, TrainReport};
