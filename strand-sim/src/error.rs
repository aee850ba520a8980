//! What can be wrong with the strands a simulation is asked to step.

/// Why a strand system could not be built.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Fewer particles per strand than the springs span.
    #[error("strands have {n_particles} particles, but the springs need at least {minimum}; resample the groom")]
    TooFewParticles {
        /// Particles per strand given.
        n_particles: usize,
        /// Least number accepted.
        minimum: usize,
    },
    /// The point buffer does not hold a whole number of strands.
    #[error("{n_points} points are not a whole number of strands of {n_particles} particles")]
    RaggedPoints {
        /// Points given.
        n_points: usize,
        /// Particles per strand.
        n_particles: usize,
    },
    /// A coordinate is not a number.
    #[error("strand {strand}, particle {particle} has a non-finite coordinate")]
    NonFinite {
        /// Strand index.
        strand: usize,
        /// Particle index.
        particle: usize,
    },
    /// A strand too short to carry springs.
    #[error("strand {strand} is {length_cm} cm long; drop strands shorter than {minimum_cm} cm before simulating")]
    TooShort {
        /// Strand index.
        strand: usize,
        /// Its arc length, cm.
        length_cm: f64,
        /// Shortest accepted, cm.
        minimum_cm: f64,
    },
    /// A material constant outside its range.
    #[error("material constant {name} is {value}; it must be {expected}")]
    BadMaterial {
        /// Field name.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
    /// A constant of hair-hair interaction outside its range.
    #[error("interaction constant {name} is {value}; it must be {expected}")]
    BadInteraction {
        /// Field name.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
}
