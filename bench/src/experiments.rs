//! The papers' scenes and comparisons, run anew: each an [`Experiment`] that hands its findings to the report.
//!
//! [`heads`] says how much hair each size has; [`watch`] runs one scene in several ways; [`words`] turns numbers into
//! claims and verdicts. The others are one comparison of AS16 or MS08 each. No figure of ours is written down here: all come from
//! the run; the papers' figures are constants with their source.

mod adaptation;
mod correction;
mod criteria;
mod guides;
pub mod heads;
mod mass_spring;
mod salon;
mod scaling;
mod single_hairs;
mod skinning;
mod solids;
mod tables;
mod two_guides;
pub mod watch;
pub mod words;

use crate::evidence::Experiment;

/// All experiments, in the order of the report.
#[must_use]
pub fn all() -> Vec<Experiment> {
    vec![
        salon::STRAIGHT,
        salon::CURLY,
        solids::GEARS,
        solids::BALL,
        solids::HAND,
        two_guides::EXPERIMENT,
        correction::EXPERIMENT,
        criteria::EXPERIMENT,
        adaptation::EXPERIMENT,
        skinning::EXPERIMENT,
        guides::EXPERIMENT,
        tables::PARAMETERS,
        tables::COSTS,
        scaling::EXPERIMENT,
        mass_spring::HEADS,
        single_hairs::EXPERIMENT,
        mass_spring::COSTS,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn every_experiment_has_a_name_of_its_own_and_a_source() {
        let all = all();
        let names: HashSet<&str> = all.iter().map(|e| e.name).collect();
        assert_eq!(names.len(), all.len());
        for e in &all {
            assert!(e.source.contains("AS16") || e.source.contains("MS08"), "{}: {}", e.name, e.source);
            assert!(e.name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-'), "{}", e.name);
            assert!(!e.title.is_empty());
        }
    }
}
