//! What can go wrong in training: inputs that do not fit together, frames that cannot be used, parameters out of range.
//!
//! Each variant names what was found, what was expected and what to do. Errors of files come through unchanged.

/// Why a skinning model could not be trained.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A frame could not be read, or the finished model breaks an invariant of its format.
    #[error(transparent)]
    Formats(#[from] io_formats::Error),
    /// Two inputs describe different hair.
    #[error(
        "{what} has {n_strands} strands of {n_particles} particles, but the frames have {frame_strands} of {frame_particles}; \
         use the groom that the frames were recorded from"
    )]
    ShapeMismatch {
        /// The input that differs from the frames.
        what: &'static str,
        /// Its strands.
        n_strands: usize,
        /// Its particles per strand.
        n_particles: usize,
        /// Strands of the frames.
        frame_strands: usize,
        /// Particles per strand of the frames.
        frame_particles: usize,
    },
    /// A quadratic along the strand needs three particles.
    #[error("strands have {n_particles} particles, at least 3 are needed; resample the groom")]
    TooFewParticles {
        /// Particles per strand.
        n_particles: usize,
    },
    /// There is too little motion to learn from.
    #[error("{n_frames} frames were given, at least {needed} are needed; record a longer motion")]
    TooFewFrames {
        /// Frames given.
        n_frames: usize,
        /// Frames needed.
        needed: usize,
    },
    /// A position that is not a number.
    #[error("{what}: strand {strand} has a position that is not finite; record the frames again, or drop the strand")]
    NonFinite {
        /// `rest shape`, `groom` or the frame.
        what: String,
        /// First offending strand.
        strand: usize,
    },
    /// A parameter outside its range.
    #[error("parameter {name} is {value}; {expected}")]
    BadParameter {
        /// Name of the field of the parameters.
        name: &'static str,
        /// The value given.
        value: String,
        /// The values that would do.
        expected: String,
    },
    /// More entries than the model file can number.
    #[error(
        "{what} has {count} entries, the model file numbers at most 2^32 - 1; train fewer strands, or keep fewer sets"
    )]
    TooLarge {
        /// The array of the model.
        what: &'static str,
        /// Its entries.
        count: usize,
    },
    /// A kept stage that was there a moment ago.
    #[error("the kept stage {stage} was removed while it was in use; leave the folder alone and train again")]
    LostStage {
        /// The stage.
        stage: &'static str,
    },
    /// A decomposition of the motion did not converge.
    #[error("the {what} of the motion did not converge; check the frames for extreme positions")]
    NoDecomposition {
        /// The decomposition.
        what: &'static str,
    },
}

/// What the functions of this crate return.
pub type Result<T> = std::result::Result<T, Error>;
