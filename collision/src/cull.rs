//! When a strand needs no query at all: its last distance bound, less everything that moved since.
//!
//! A signed distance changes by at most what the point and the solid moved. As long as the remainder stays positive
//! the strand is clear, whatever lies between.

use crate::sdf::SignedDistanceField;

/// A lower bound on the distance between a strand and one solid, kept from step to step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DistanceBound {
    /// Every point of the strand was surely this far from the solid, less what moved since; cm.
    remaining: f32,
}

impl DistanceBound {
    /// Nothing known: the strand must be queried.
    pub fn unknown() -> Self {
        Self { remaining: f32::NEG_INFINITY }
    }

    /// From a least distance sampled on the strand, less the grid's error and half the largest gap (cm) between samples.
    pub fn from_samples(sdf: &SignedDistanceField, least: f32, largest_gap: f32) -> Self {
        Self { remaining: sdf.surely(least) - 0.5 * largest_gap }
    }

    /// Takes off what the strand and the solid moved over a step (cm), jumps of the strand's guide set included.
    pub fn moved(&mut self, strand_cm: f32, solid_cm: f32) {
        self.remaining -= strand_cm.max(0.0) + solid_cm.max(0.0);
    }

    /// The bound, cm.
    pub fn remaining(&self) -> f32 {
        self.remaining
    }

    /// Whether the strand is surely farther than `reach` cm. Not a number counts as no.
    pub fn clears(&self, reach: f32) -> bool {
        self.remaining > reach
    }
}

/// Whether a point last seen at `last_distance` (cm, grid error taken off) surely still is outside after these movements.
pub fn needs_no_query(last_distance: f32, point_moved_cm: f32, solid_moved_cm: f32) -> bool {
    last_distance - point_moved_cm - solid_moved_cm > 0.0
}
