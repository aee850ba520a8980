//! How far a change of set would move a hair, or how far from where it is held it would put it: the cost of AS16 Eq. (3), states compared by
//! position.
//!
//! Both skinned strands are made with the kernel of [`crate::interpolate`], lanes along the strand.

use super::decode;
use crate::interpolate::{TransformArrays, interpolate};
use crate::params::WeightRule;
use io_formats::guide_transform::Blend;
use io_formats::skinning_model::SkinningModel;
use multiversion::multiversion;

/// Lanes worked on together.
const WIDTH: usize = 8;

/// What all strands share: positions along a strand, and how much each lane counts.
#[derive(Clone, Debug)]
pub(super) struct Lanes {
    pub u: Vec<f32>,
    /// One for particles, zero for padding.
    pub counts: Vec<f32>,
}

impl Lanes {
    pub fn new(n_particles: usize, pad: usize) -> Self {
        let last = n_particles - 1;
        Self {
            u: (0..pad).map(|i| i.min(last) as f32 / last as f32).collect(),
            counts: (0..pad).map(|i| if i <= last { 1.0 } else { 0.0 }).collect(),
        }
    }
}

/// A hair where it is, to compare sets with; buffers are kept from hair to hair.
#[derive(Clone, Debug, Default)]
pub(super) struct Shift {
    /// Three arrays (x, y, z) each, as for [`interpolate`].
    rest: Vec<f32>,
    current: Vec<f32>,
    candidate: Vec<f32>,
}

impl Shift {
    /// Begins a hair under its present set.
    pub fn begin(
        &mut self,
        (model, weights): (&SkinningModel, WeightRule),
        lanes: &Lanes,
        transforms: &TransformArrays,
        (strand, set): (usize, u16),
    ) {
        let pad = transforms.pad;
        for buffer in [&mut self.rest, &mut self.current, &mut self.candidate] {
            buffer.resize(3 * pad, 0.0);
        }
        // Of guides that do not turn, rest positions are the same in both strands and cancel: zeros do as well.
        if model.blend == Blend::Rigid {
            let points = model.rest_of(strand);
            for c in 0..3 {
                for i in 0..pad {
                    self.rest[c * pad + i] = points[i.min(points.len() - 1)][c];
                }
            }
        }
        let set = decode(model, strand, set, weights);
        interpolate(&self.rest, &lanes.u, &set, transforms, &mut self.current);
    }

    /// Moves the hair by what it carries, an offset of as many values; returns how far that is (RMS, cm).
    pub fn carry(&mut self, offset: &[f32], lanes: &Lanes, n_particles: u32) -> f32 {
        self.candidate.copy_from_slice(&self.current);
        self.current.iter_mut().zip(offset).for_each(|(x, d)| *x += d);
        self.between(lanes, n_particles)
    }

    /// RMS distance (cm) between the hair under `set` and where it is.
    pub fn to(
        &mut self,
        (model, weights): (&SkinningModel, WeightRule),
        lanes: &Lanes,
        transforms: &TransformArrays,
        (strand, set): (usize, u16),
    ) -> f32 {
        let set = decode(model, strand, set, weights);
        interpolate(&self.rest, &lanes.u, &set, transforms, &mut self.candidate);
        self.between(lanes, model.n_particles)
    }

    fn between(&self, lanes: &Lanes, n_particles: u32) -> f32 {
        (squared_distance(&self.current, &self.candidate, &lanes.counts) / n_particles as f32).sqrt()
    }
}

#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn squared_distance(a: &[f32], b: &[f32], counts: &[f32]) -> f32 {
    let pad = counts.len();
    let mut sum = [0.0f32; WIDTH];
    for c in 0..3 {
        let of = c * pad..(c + 1) * pad;
        let lanes = a[of.clone()].as_chunks::<WIDTH>().0.iter().zip(b[of].as_chunks::<WIDTH>().0);
        for ((x, y), n) in lanes.zip(counts.as_chunks::<WIDTH>().0) {
            for l in 0..WIDTH {
                let d = x[l] - y[l];
                sum[l] = (d * n[l]).mul_add(d, sum[l]);
            }
        }
    }
    sum.iter().sum()
}
