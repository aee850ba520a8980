//! One interactive step of adaptive hair skinning, after Chai, Zheng, Zhou, *Adaptive Skinning for Interactive Hair-Solid
//! Simulation* (AS16): a model in, positions out.
//!
//! A few hundred guides are simulated; every other hair follows guides chosen anew at each step, so that hair splits
//! around a solid; hairs that touch a solid push back on their guides. See [`Runtime`] and [`RuntimeParams`].

mod assign;
mod clusters;
mod correct;
mod error;
mod graph;
mod guides;
mod guides_dftl;
mod hair_hair;
mod interpolate;
mod kernels;
mod look;
mod offset;
mod params;
mod past;
mod planes;
mod read;
mod response;
mod runtime;
mod solid_in_head;
mod step;
mod strands;
#[cfg(test)]
mod test_model;
mod timings;
mod two_way;

pub use clusters::Clusters;
pub use error::Error;
pub use graph::GuideGraph;
pub use guides::{material_of, record_of};
pub use hair_hair::{HairHairParams, HairHairReport};
pub use params::{
    AssignParams, CliqueRule, Correction, DftlParams, EdgeDistance, GuideIntegrator, MAX_STEPS_PER_MEETING,
    ResidualParams, RuntimeParams, TwoWayParams, TwoWaySolve, WeightRule,
};
pub use runtime::{Runtime, neighbours_together};
pub use step::{StepInput, StepReport};
pub use timings::StageTimings;
