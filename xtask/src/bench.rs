//! `xtask bench`: what is measured apart from whole scenes of the salon.

mod collision;
mod guides;
mod runtime;
mod strand_scenes;
mod strand_sim;
mod training;

use anyhow::Result;

/// Options of `xtask bench`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, clap::Subcommand)]
enum What {
    /// Distance fields: seconds and bytes of baking, samples a second, errors against every triangle.
    Collision(collision::Args),
    /// The runtime on whole heads: cost beside a copy, AS16 Table 2, scaling, solids swept through, minutes of salon.
    Runtime(runtime::Args),
    /// The tests of single hairs and a tuft of MS08 Fig. 10, 11, 13: figures and pictures.
    StrandScenes(strand_scenes::Args),
    /// The cost of the strand simulator: ratios measured in one run, MS08 Table 2, a full head.
    StrandSim(strand_sim::Args),
    /// The kernels of training: subset weights a second, and their errors against a general solver.
    Training(training::Args),
}

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    match args.what {
        What::Collision(args) => collision::run(args),
        What::Runtime(args) => runtime::run(args),
        What::StrandScenes(args) => strand_scenes::run(args),
        What::StrandSim(args) => strand_sim::run(args),
        What::Training(args) => training::run(args),
    }
}
