//! When a strand needs no query at all: its last distance bound, less everything that moved since.
//!
//! A signed distance changes by at most what the point and the solid moved. As long as the remainder stays positive
//! the strand is clear, whatever lies between.

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

    /// Every point of the strand is surely this far from the solid, cm, the grid's error taken off.
    pub fn at_least(distance_cm: f32) -> Self {
        Self { remaining: distance_cm }
    }

    /// Takes off what the strand and the solid moved over a step (cm), jumps of the strand's guide set included.
    pub fn moved(&mut self, strand_cm: f32, solid_cm: f32) {
        self.remaining -= strand_cm.max(0.0) + solid_cm.max(0.0);
    }

    /// Whether the strand is surely farther than `reach` cm. Not a number counts as no.
    pub fn clears(&self, reach: f32) -> bool {
        self.remaining > reach
    }
}
