//! Names of training's stages: hashes of what each is made from, so that no stage is ever taken for another.

use io_formats::skinning_model;
use io_formats::stage_cache::{hash_of, stage_key};

use crate::params::TrainParams;

/// Raised whenever a change makes the result of a stage of equal inputs differ.
const STAGES_VERSION: u64 = 1;

/// Keys of all stages of a training.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Keys<'a> {
    /// Hash of everything frames, shapes and material were made from.
    pub inputs: u64,
    pub params: &'a TrainParams,
}

impl Keys<'_> {
    pub fn reduce(&self) -> u64 {
        let p = self.params;
        stage_key("reduce", &[STAGES_VERSION, self.inputs, hash_of(&(p.rank, p.oversample, p.seed))])
    }

    pub fn guides(&self) -> u64 {
        let p = self.params;
        let chosen = hash_of(&(p.n_guides, p.sparsity, p.epochs, p.batch, p.seed));
        stage_key("guides", &[self.reduce(), chosen, hash_of(&(p.guide_method, p.graph))])
    }

    pub fn eligible(&self) -> u64 {
        let p = self.params;
        let limits = hash_of(&(p.eligible_rule, p.sparsity, p.min_weight, p.min_eligible, p.max_eligible));
        stage_key("eligible", &[self.guides(), limits])
    }

    pub fn scales(&self) -> u64 {
        let p = self.params;
        let calibration = hash_of(&(p.velocity_weight, p.distance_percentile, p.release_factor));
        stage_key("scales", &[self.eligible(), calibration])
    }

    fn weights(&self) -> u64 {
        let p = self.params;
        stage_key("weights", &[self.eligible(), hash_of(&(p.min_weight, p.blend))])
    }

    /// Of one block of strands.
    pub fn block(&self, block: usize) -> u64 {
        stage_key("block", &[self.weights(), self.params.strands_per_block as u64, block as u64])
    }

    pub fn compare(&self, n_compared: usize) -> u64 {
        stage_key("compare", &[self.weights(), n_compared as u64])
    }

    pub fn judge(&self, n_strands: usize, judged: u64) -> u64 {
        stage_key("judge", &[self.weights(), n_strands as u64, judged])
    }

    pub fn model(&self) -> u64 {
        stage_key("model", &[self.weights(), self.scales(), u64::from(skinning_model::VERSION)])
    }
}

/// What a model trained with `params` will be named by: a hash of everything it is made from. `inputs` is the hash given as
/// [`crate::TrainInputs::provenance`].
#[must_use]
pub fn model_key(inputs: u64, params: &TrainParams) -> u64 {
    Keys { inputs, params }.model()
}
