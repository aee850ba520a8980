//! The error type of this crate.

use std::path::PathBuf;

use thiserror::Error;

/// Why a groom, solid or picture could not be made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// A solid could not be baked.
    #[error("cannot bake solid {name}: {source}")]
    Bake {
        /// The solid's name.
        name: String,
        /// What was wrong with it.
        source: collision::Error,
    },
    /// A groom file holds strands that cannot be used.
    #[error("groom {path} cannot be used; drop_degenerate in the scene leaves out strands without length", path = path.display())]
    Groom {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: Box<io_formats::Error>,
    },
    /// A file of the scene could not be read or written.
    #[error(transparent)]
    Format(#[from] io_formats::Error),
    /// Strands could not be simulated.
    #[error(transparent)]
    Strands(#[from] strand_sim::Error),
    /// The runtime refused the model or its parameters.
    #[error(transparent)]
    Runtime(#[from] adaptive_runtime::Error),
    /// A model could not be trained.
    #[error(transparent)]
    Training(#[from] skinning_train::Error),
    /// A recorded motion is not as long as the scene asks.
    #[error("{name} lasts {length:.3} s, the scene asks for {seconds} s of it; ask for less, or skip fewer frames")]
    ShortMotion {
        /// The motion.
        name: String,
        /// Seconds asked for.
        seconds: f64,
        /// Seconds there are.
        length: f64,
    },
    /// The same stretch of a recording would be trained on and judged by.
    #[error(
        "frames {first} to {last} of {path} have two uses; what is judged on must not be trained on",
        path = path.display()
    )]
    MixedMotion {
        /// The file.
        path: PathBuf,
        /// First frame used twice.
        first: usize,
        /// Last one.
        last: usize,
    },
    /// No mode has this name.
    #[error("there is no mode {name}; the modes are {known}")]
    UnknownMode {
        /// The name given.
        name: String,
        /// The names that exist.
        known: String,
    },
    /// What an experiment asked of its place could not be had.
    #[error("{what}: {source}")]
    Place {
        /// What was asked for.
        what: String,
        /// Why it could not be had.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A parameter is out of its range.
    #[error("{name} is {value}, but must be finite and at least {least}")]
    BadParameter {
        /// The parameter.
        name: &'static str,
        /// The value given.
        value: f64,
        /// Least value that makes sense.
        least: f64,
    },
    /// The head given has no scalp where hair could grow.
    #[error(
        "no scalp found on solid {name}: hair grows on a head about the origin, face along +z, as built by `shapes::head`"
    )]
    NoScalp {
        /// The solid's name.
        name: String,
    },
    /// A picture could not be drawn or written.
    #[error(transparent)]
    Picture(#[from] hair_viewer::Error),
}
