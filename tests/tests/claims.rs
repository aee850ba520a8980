//! What AS16 and MS08 promise, on small scenes.

mod ms08_figures;
mod real_solids;
mod runtime;
mod strands;
mod strands_in_contact;
