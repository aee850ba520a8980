//! What AS16 and MS08 promise, on small scenes.

mod comb_sweeps;
mod guides;
mod hair_at_rest_on_solids;
mod interpolation_check;
mod mechanics;
mod ms08_figures;
mod real_solids;
mod recorded_motion;
mod runtime;
mod settled_hair;
mod stability;
mod strands;
mod strands_in_contact;
mod strands_that_pass;
mod subset_weights;
