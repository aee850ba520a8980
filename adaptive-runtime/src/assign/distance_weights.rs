//! Weights from distances (AS16 §7.2, "Working with Other Skinning Methods"): a skinning that was not trained, to compare with.
//!
//! A departure: AS16 takes the distances of the moving hair, which is what the weights are to give; here they are those at rest,
//! so that what a step or a read returns does not depend on when others were taken. And the runtime's weights are quadratics along
//! the strand: those through Eq. (11) at root, middle and tip. They sum to one everywhere; what is negative between is cut off as
//! it is of trained ones.

use io_formats::skinning_model::{MAX_ELIGIBLE, SkinningModel, WeightPoly};
use nalgebra::Vector3;

/// Least distance, cm: a hair that stands where a guide does follows it alone.
const LEAST_CM: f32 = 1e-4;

/// Weights of a hair's guides.
/// Implements AS16 Eq. (11) at three places of the strand at rest.
pub(super) fn distance_weights(model: &SkinningModel, strand: usize, guides: &[u16]) -> [WeightPoly; MAX_ELIGIBLE] {
    let n = model.n_particles as usize;
    let middle = (n - 1) / 2;
    let u = middle as f32 / (n - 1) as f32;
    let [root, between, tip] = [0, middle, n - 1].map(|i| reciprocal_distances(model, strand, guides, i));
    let mut out = [WeightPoly { quad: 0.0, lin: 0.0, con: 0.0 }; MAX_ELIGIBLE];
    for (g, poly) in out.iter_mut().enumerate().take(guides.len()) {
        let whole = tip[g] - root[g];
        // Two particles have no middle: a straight line.
        let quad = if middle == 0 { 0.0 } else { (between[g] - root[g] - whole * u) / (u * (u - 1.0)) };
        *poly = WeightPoly { quad, lin: whole - quad, con: root[g] };
    }
    out
}

/// Eq. (11) at particle `i`.
fn reciprocal_distances(model: &SkinningModel, strand: usize, guides: &[u16], i: usize) -> [f32; MAX_ELIGIBLE] {
    let p = Vector3::from(model.rest_of(strand)[i]);
    let mut out = [0.0; MAX_ELIGIBLE];
    for (&guide, out) in guides.iter().zip(&mut out) {
        let of_guide = model.rest_of(model.guide_strands[usize::from(guide)] as usize)[i];
        *out = 1.0 / (p - Vector3::from(of_guide)).norm().max(LEAST_CM);
    }
    let sum: f32 = out.iter().sum();
    out.map(|d| d / sum)
}
