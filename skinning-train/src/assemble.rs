//! From the sets of single strands to the arrays of the model file.
//!
//! Blocks of strands are solved apart, by whichever process, and joined in order: offsets within a block start at zero and
//! are moved when blocks are joined, so the model's bytes do not depend on who solved which block.

use io_formats::SkinningModel;
use serde::{Deserialize, Serialize};

use crate::driver::{Guides, TrainInputs};
use crate::error::{Error, Result};
use crate::motion_scales::MotionScales;
use crate::params::TrainParams;
use crate::subsets::{FullSetError, StrandSets};

/// The kept sets of a block of strands, as the model has them, and how well they explain it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct SetArrays {
    pub start: Vec<u32>,
    pub mask: Vec<u16>,
    pub rms_error_cm: Vec<f32>,
    pub coeff_start: Vec<u32>,
    pub coeffs: Vec<[u16; 3]>,
    pub stand_in_start: Vec<u32>,
    pub stand_in: Vec<u16>,
    pub largest_rounding: f64,
    /// Per strand.
    pub full: Vec<FullSetError>,
}

impl SetArrays {
    pub fn new() -> Self {
        Self {
            start: vec![0],
            mask: Vec::new(),
            rms_error_cm: Vec::new(),
            coeff_start: Vec::new(),
            coeffs: Vec::new(),
            stand_in_start: vec![0],
            stand_in: Vec::new(),
            largest_rounding: 0.0,
            full: Vec::new(),
        }
    }

    pub fn push(&mut self, strand: &StrandSets) -> Result<()> {
        let mut at = self.coeffs.len();
        for mask in &strand.masks {
            self.coeff_start.push(numbered("coeffs", at)?);
            at += mask.count_ones() as usize;
        }
        self.mask.extend_from_slice(&strand.masks);
        self.rms_error_cm.extend_from_slice(&strand.rms_error_cm);
        self.coeffs.extend_from_slice(&strand.coeffs);
        self.stand_in.extend_from_slice(&strand.stand_in);
        self.start.push(numbered("set_mask", self.mask.len())?);
        self.stand_in_start.push(numbered("stand_in", self.stand_in.len())?);
        self.largest_rounding = self.largest_rounding.max(strand.largest_rounding);
        self.full.push(strand.full);
        Ok(())
    }

    /// Adds the strands of the next block.
    pub fn append(&mut self, next: Self) -> Result<()> {
        let moved = |what, from: &[u32], by: usize, out: &mut Vec<u32>| -> Result<()> {
            let by = numbered(what, by)?;
            for &x in from {
                out.push(x.checked_add(by).ok_or(Error::TooLarge { what, count: x as usize + by as usize })?);
            }
            Ok(())
        };
        moved("coeffs", &next.coeff_start, self.coeffs.len(), &mut self.coeff_start)?;
        moved("set_mask", &next.start[1..], self.mask.len(), &mut self.start)?;
        moved("stand_in", &next.stand_in_start[1..], self.stand_in.len(), &mut self.stand_in_start)?;
        self.mask.extend(next.mask);
        self.rms_error_cm.extend(next.rms_error_cm);
        self.coeffs.extend(next.coeffs);
        self.stand_in.extend(next.stand_in);
        self.largest_rounding = self.largest_rounding.max(next.largest_rounding);
        self.full.extend(next.full);
        Ok(())
    }
}

fn numbered(what: &'static str, count: usize) -> Result<u32> {
    u32::try_from(count).map_err(|_| Error::TooLarge { what, count })
}

/// The model of all strands' sets.
pub(crate) fn assemble(
    inputs: &TrainInputs<'_>,
    params: &TrainParams,
    provenance: u64,
    guides: Guides,
    pairs: Vec<[u16; 2]>,
    scales: MotionScales,
    sets: SetArrays,
) -> Result<SkinningModel> {
    let Guides { strands: guide_strands, eligible } = guides;
    let groom_in_head =
        guide_strands.iter().flat_map(|&s| inputs.groom.strand(s as usize)).flatten().copied().collect();
    Ok(SkinningModel {
        provenance,
        n_strands: numbered("rest_in_head", inputs.rest.n_strands)?,
        n_particles: numbered("rest_in_head", inputs.rest.n_particles)?,
        groom_in_head,
        rest_in_head: inputs.rest.points.iter().flatten().copied().collect(),
        guide_strands,
        eligible_start: eligible.start,
        eligible: eligible.guides,
        set_start: sets.start,
        set_mask: sets.mask,
        set_rms_error_cm: sets.rms_error_cm,
        coeff_start: sets.coeff_start,
        coeffs: sets.coeffs,
        stand_in_start: sets.stand_in_start,
        stand_in: sets.stand_in,
        pairs,
        position_scale: scales.position_scale,
        velocity_scale: scales.velocity_scale,
        velocity_weight: params.velocity_weight,
        max_distance: scales.max_distance,
        release_distance: scales.release_distance,
        blend: params.blend,
        material: inputs.material,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn strand(masks: &[u16]) -> StrandSets {
        let n: usize = masks.iter().map(|m| m.count_ones() as usize).sum();
        StrandSets {
            masks: masks.to_vec(),
            rms_error_cm: masks.iter().map(|&m| f32::from(m)).collect(),
            coeffs: (0..n as u16).map(|c| [c, c + 1, masks.len() as u16]).collect(),
            stand_in: vec![0; 3],
            full: FullSetError { free_squared_cm: n as f64, ..FullSetError::default() },
            largest_rounding: 0.1 * n as f64,
        }
    }

    #[test]
    fn blocks_joined_are_the_arrays_of_all_strands() {
        let strands = [strand(&[1, 2]), strand(&[1, 2, 3]), strand(&[1]), strand(&[2, 3]), strand(&[1, 3])];
        let of = |range: std::ops::Range<usize>| {
            let mut sets = SetArrays::new();
            strands[range].iter().for_each(|s| sets.push(s).unwrap());
            sets
        };
        for cut in 0..=strands.len() {
            let mut joined = SetArrays::new();
            joined.append(of(0..cut)).unwrap();
            joined.append(of(cut..strands.len())).unwrap();
            assert_eq!(joined, of(0..strands.len()), "cut at {cut}");
        }
    }
}
