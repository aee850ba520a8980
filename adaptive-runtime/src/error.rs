//! What can be wrong with a model or a scene handed to the runtime.

/// Why a runtime could not be built.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The skinning model breaks an invariant.
    #[error("the skinning model cannot be used")]
    Model(#[from] io_formats::Error),
    /// The guides' springs cannot be built.
    #[error("the guides cannot be simulated")]
    Guides(#[from] strand_sim::Error),
    /// A parameter outside its range.
    #[error("runtime parameter {name} is {value}; it must be {expected}")]
    BadParameter {
        /// Field name.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
    /// More of something than the runtime can keep.
    #[error("{given} {what} given; the runtime takes {most} at most")]
    TooMany {
        /// Of what.
        what: &'static str,
        /// How many.
        given: usize,
        /// How many it takes.
        most: usize,
    },
    /// More solids than the runtime was built for, or fewer.
    #[error("the step names {given} solid poses, but the runtime has {expected} solids")]
    SolidCount {
        /// Poses given.
        given: usize,
        /// Solids known.
        expected: usize,
    },
}
