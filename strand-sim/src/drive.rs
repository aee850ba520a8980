//! What moves hair from outside the simulation: the scalp at its roots, and particles pinned or driven anywhere.
//!
//! Driven particles, perturbed ones between them included, follow a pose that carries the rest shape, so that a driven
//! end can be moved and twisted alike.

use nalgebra::Isometry3;

/// Motion of the roots over a step.
#[derive(Clone, Copy, Debug)]
pub enum RootMotion<'a> {
    /// All roots are carried by one rigid head: `world_from_head` at the start and the end of the step.
    Head {
        /// At the start.
        before: Isometry3<f64>,
        /// At the end.
        after: Isometry3<f64>,
    },
    /// Every root is carried by its own frame, as those of a scalp that deforms: for each strand the pose that carries
    /// its rest shape, at the start and at the end.
    Frames {
        /// One a strand, at the start.
        before: &'a [Isometry3<f64>],
        /// One a strand, at the end.
        after: &'a [Isometry3<f64>],
    },
}

impl RootMotion<'_> {
    /// Pose that carries a strand's rest shape at a fraction of the step.
    #[must_use]
    pub fn at(&self, strand: usize, alpha: f64) -> Isometry3<f64> {
        match self {
            Self::Head { before, after } => between(before, after, alpha),
            Self::Frames { before, after } => between(&before[strand], &after[strand], alpha),
        }
    }

    pub(crate) fn check(&self, n_strands: usize) {
        if let Self::Frames { before, after } = self {
            assert!(before.len() == n_strands && after.len() == n_strands, "one root frame per strand");
        }
    }
}

/// Particles of one strand that move as told over a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Strand.
    pub strand: u32,
    /// First and last of the hair's own particles that are driven.
    pub particles: (usize, usize),
    /// Pose that carries their rest shape, at the start of the step.
    pub before: Isometry3<f64>,
    /// The same at its end.
    pub after: Isometry3<f64>,
}

impl Drive {
    pub(crate) fn at(&self, alpha: f64) -> Isometry3<f64> {
        between(&self.before, &self.after, alpha)
    }
}

fn between(before: &Isometry3<f64>, after: &Isometry3<f64>, alpha: f64) -> Isometry3<f64> {
    if alpha >= 1.0 {
        return *after;
    }
    before.try_lerp_slerp(after, alpha, 1e-9).unwrap_or(*after)
}
