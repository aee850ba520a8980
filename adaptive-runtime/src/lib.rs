//! One interactive step of adaptive hair skinning, after Chai, Zheng, Zhou, *Adaptive Skinning for Interactive Hair-Solid
//! Simulation* (AS16): a model in, positions out.
//!
//! A few hundred guides are simulated; every other hair follows guides chosen anew at each step, so that hair splits
//! around a solid; hairs that touch a solid push back on their guides. See [`Runtime`] and [`RuntimeParams`].

mod assign;
mod clusters;
mod error;
mod graph;
mod guides;
mod hair_contact;
mod interpolate;
mod params;
mod runtime;
mod step;
#[cfg(test)]
mod test_model;
mod timings;
mod two_way;

pub use clusters::Clusters;
pub use error::Error;
pub use graph::GuideGraph;
pub use guides::{material_of, record_of};
pub use params::{AssignParams, CliqueRule, EdgeDistance, ResidualParams, RuntimeParams, TwoWayParams, WeightRule};
pub use runtime::Runtime;
pub use step::{StepInput, StepReport};
pub use timings::StageTimings;
