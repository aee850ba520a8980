//! `xtask view`: pictures of a scene by a graphics driver: still, around, or as it moves; as PNG and as video.
//!
//! The renderer takes minutes to build and is a program of its own (`hair-draw`), built by cargo when first asked for.
//! Without a driver it says what to install.

mod draw;
mod frames;

use anyhow::Result;
use hair_bench::run::Mode;
use std::path::PathBuf;

/// What hair is coloured by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Colour {
    Brown,
    Blonde,
    Red,
    Black,
    /// A colour for the guide that counts most at a strand's middle; needs --run.
    Guide,
    /// The largest weight at a strand's middle, blue for 0 to red for 1; needs --run.
    Weight,
    /// Pale outside solids, yellow to red inside.
    Penetration,
    /// Blue at rest to red at --fastest; needs --run.
    Velocity,
}

/// Options of `xtask view`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A scene (.toml; see docs/SCENE.md), a built-in one (salon), or a groom (.hair, .tfx, .data, .ply; needs --unit).
    scene: String,
    /// Unit of a bare groom: m, cm, mm, in, or centimetres per unit as a number.
    #[arg(long)]
    unit: Option<String>,
    /// Run the scene in this mode, as `run-scene` does (training if need be), and draw it as it moves; else its hair at rest.
    #[arg(long, value_name = "MODE")]
    run: Option<Mode>,
    /// Also run in this mode, draw the same pictures of it, and print how far the two are apart (PSNR of the whole
    /// pictures, as NI20 Table 1).
    #[arg(long, value_name = "MODE", requires = "run")]
    against: Option<Mode>,
    /// Seconds to run at most; the whole scene without it.
    #[arg(long, requires = "run")]
    seconds: Option<f64>,
    /// What hair is coloured by.
    #[arg(long, value_enum, default_value = "brown")]
    colour: Colour,
    /// Speed shown in red with --colour velocity, cm/s.
    #[arg(long, default_value_t = 30.0)]
    fastest: f32,
    /// Depth shown in red with --colour penetration, cm.
    #[arg(long, default_value_t = 0.1)]
    worst: f32,
    /// Pictures once around, from the scene's camera on; with --run, the camera goes around once during the run.
    #[arg(long, value_name = "PICTURES")]
    turntable: Option<usize>,
    /// Turn the scene's camera about the vertical through what it looks at first, degrees.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    turn: f32,
    /// Height of the pictures in pixels; the scene's without it. The width follows.
    #[arg(long)]
    height: Option<usize>,
    /// Drawn pixels along each axis for one of the picture, with four samples each: 1 is quick, 2 smooth.
    #[arg(long, default_value_t = 2)]
    supersampling: usize,
    /// Draw curves through every particle rather than B-splines, which round off what bends; --colour penetration always does.
    #[arg(long)]
    through: bool,
    /// Also write a video (.mp4, by ffmpeg), so many frames a second; the scene's number for a run if 0.
    #[arg(long, value_name = "FPS", num_args = 0..=1, default_missing_value = "0")]
    video: Option<f64>,
    /// Also write every picture of several to a file of its own.
    #[arg(long)]
    each: bool,
    /// Worker threads; 0 uses all cores.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Folder of results and cache: `OUT/<scene>/view*.png`, and OUT/cache.
    #[arg(long, default_value = "out")]
    out: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// A scene that cannot be made or run, no driver, a file that cannot be written.
pub fn run(args: &Args) -> Result<()> {
    draw::run(args)
}
