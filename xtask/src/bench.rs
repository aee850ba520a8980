//! `xtask bench`: what is measured apart from whole scenes of the salon.

mod strand_scenes;

use anyhow::Result;

/// Options of `xtask bench`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, clap::Subcommand)]
enum What {
    /// The tests of single hairs and a tuft of MS08 Fig. 10, 11, 13: figures and pictures.
    StrandScenes(strand_scenes::Args),
}

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    match args.what {
        What::StrandScenes(args) => strand_scenes::run(args),
    }
}
