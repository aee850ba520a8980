//! Seconds spent in each stage of a step, as plain data; names as in the profile spans.

use std::time::{Duration, Instant};

/// Wall time by stage of one step, or summed over many.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StageTimings {
    /// Guides: contact and dynamics.
    pub guide_sim: Duration,
    /// Similarity and interpolation check.
    pub graph: Duration,
    /// Cliques.
    pub clusters: Duration,
    /// Choice of sets.
    pub assignment: Duration,
    /// Interpolation and residual correction of strands near solids.
    pub hair_contact: Duration,
    /// Effective forces on guides.
    pub two_way: Duration,
}

impl StageTimings {
    /// Stage names and seconds, in the order of a step.
    #[must_use]
    pub fn named(&self) -> [(&'static str, f64); 6] {
        [
            ("guide_sim", self.guide_sim.as_secs_f64()),
            ("graph", self.graph.as_secs_f64()),
            ("clusters", self.clusters.as_secs_f64()),
            ("assignment", self.assignment.as_secs_f64()),
            ("hair_contact", self.hair_contact.as_secs_f64()),
            ("two_way", self.two_way.as_secs_f64()),
        ]
    }

    /// Adds another step's.
    pub fn add(&mut self, other: &Self) {
        self.guide_sim += other.guide_sim;
        self.graph += other.graph;
        self.clusters += other.clusters;
        self.assignment += other.assignment;
        self.hair_contact += other.hair_contact;
        self.two_way += other.two_way;
    }
}

/// Runs `stage`, storing its wall time.
pub(crate) fn timed<T>(into: &mut Duration, stage: impl FnOnce() -> T) -> T {
    let clock = Instant::now();
    let out = stage();
    *into = clock.elapsed();
    out
}
