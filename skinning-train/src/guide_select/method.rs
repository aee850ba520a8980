//! The ways to select guides, by one name each.
//!
//! Sparse coding is the method; the others are what it is compared with, trained by the same steps afterwards.

use std::str::FromStr;

use io_formats::{FrameSource, UniformGroom};

use super::graph::{GuideParts, graph_guides};
use super::spread::{random_guides, uniform_guides};
use crate::error::{Error, Result};
use crate::params::TrainParams;

/// How guides are selected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GuideMethod {
    /// Sparse coding of the motion: AS16 Eq. (9), (10).
    SparseCoding,
    /// The graph of strands that move alike: Chai et al. 2014, as in AS16 Fig. 9.
    Graph,
    /// Drawn at random.
    Random,
    /// Spread evenly over the scalp.
    Uniform,
}

/// How a strand's eligible guides are chosen among all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EligibleRule {
    /// Coefficients of sparse coding over the guides: AS16 §6.3. Goes with every method.
    SparseCoding,
    /// Guides of the strand's own and the adjacent parts: Chai et al. 2014. Needs [`GuideMethod::Graph`].
    Parts,
}

impl GuideMethod {
    /// All methods, with their names.
    pub const ALL: [(&'static str, Self); 4] = [
        ("sparse_coding", Self::SparseCoding),
        ("graph", Self::Graph),
        ("random", Self::Random),
        ("uniform", Self::Uniform),
    ];

    /// The name that [`FromStr`] knows it by.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::SparseCoding => "sparse_coding",
            Self::Graph => "graph",
            Self::Random => "random",
            Self::Uniform => "uniform",
        }
    }
}

impl FromStr for GuideMethod {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let known = Self::ALL.iter().find(|(n, _)| *n == name).map(|(_, method)| *method);
        known.ok_or_else(|| Error::BadParameter {
            name: "guide_method",
            value: name.to_owned(),
            expected: format!("it must be one of {}", Self::ALL.map(|(n, _)| n).join(", ")),
        })
    }
}

/// Guides by a method that needs no signals: their strands, ascending, and the parts they stand for where there are any.
/// `None` for sparse coding. `on_frame` hears of frames read.
///
/// # Errors
/// When a frame cannot be read.
///
/// # Panics
/// If there are fewer strands than guides, or `rest` (cm, head frame) is not the hair of the frames.
pub fn compared_guides(
    frames: &dyn FrameSource,
    rest: &UniformGroom,
    params: &TrainParams,
    on_frame: &mut dyn FnMut(u64),
) -> Result<Option<(Vec<u32>, Option<GuideParts>)>> {
    let n = params.n_guides;
    Ok(match params.guide_method {
        GuideMethod::SparseCoding => None,
        GuideMethod::Graph => {
            let parts = graph_guides(frames, rest, n, &params.graph, params.seed, on_frame)?;
            Some((parts.guide_strands.clone(), Some(parts)))
        }
        GuideMethod::Random => Some((random_guides(rest.n_strands, n, params.seed), None)),
        GuideMethod::Uniform => {
            let roots: Vec<[f32; 3]> = rest.points.chunks_exact(rest.n_particles).map(|s| s[0]).collect();
            Some((uniform_guides(&roots, n), None))
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_are_known_by_their_names_and_others_are_named_in_the_error() {
        for (name, method) in GuideMethod::ALL {
            assert_eq!(name.parse::<GuideMethod>().expect("a name of the list"), method);
            assert_eq!(method.name(), name);
        }
        let error = "metis".parse::<GuideMethod>().expect_err("no such method").to_string();
        assert!(error.contains("metis") && error.contains("uniform"), "{error}");
    }
}
