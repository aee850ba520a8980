//! A model of other strands made of a trained one's: fewer of them, or more.
//!
//! Cost grows with strands, error with what was trained; a head of any size for measuring one needs no training of its own.
//! Invariant: what a strand was trained to do is copied bit for bit, and guides keep their numbers.

use super::{SkinningModel, bad, csr};
use crate::error::Result;

impl SkinningModel {
    /// A model of these strands, in this order. A strand may be taken more than once; a guide is the first of its copies.
    ///
    /// # Errors
    /// A strand that does not exist, or a guide's strand that is not among them.
    pub fn pick(&self, strands: &[u32]) -> Result<Self> {
        if let Some(&s) = strands.iter().find(|&&s| s >= self.n_strands) {
            return Err(bad("n_strands", format!("strand {s} of {} is asked for", self.n_strands)));
        }
        let mut first = vec![u32::MAX; self.n_strands as usize];
        for (at, &s) in strands.iter().enumerate().rev() {
            first[s as usize] = at as u32;
        }
        let guide_strands: Vec<u32> = self.guide_strands.iter().map(|&s| first[s as usize]).collect();
        if let Some(g) = guide_strands.iter().position(|&s| s == u32::MAX) {
            let why = format!("guide {g} is strand {}, which is not among those picked", self.guide_strands[g]);
            return Err(bad("guide_strands", why));
        }
        let n_coords = self.n_particles as usize * 3;
        let mut out = Self {
            n_strands: strands.len() as u32,
            rest_in_head: Vec::with_capacity(strands.len() * n_coords),
            guide_strands,
            eligible_start: vec![0],
            eligible: Vec::new(),
            set_start: vec![0],
            set_mask: Vec::new(),
            set_rms_error_cm: Vec::new(),
            coeff_start: Vec::new(),
            coeffs: Vec::new(),
            stand_in_start: vec![0],
            stand_in: Vec::new(),
            groom_in_head: self.groom_in_head.clone(),
            pairs: self.pairs.clone(),
            position_scale: self.position_scale.clone(),
            velocity_scale: self.velocity_scale.clone(),
            ..*self
        };
        for &s in strands {
            let s = s as usize;
            out.rest_in_head.extend_from_slice(&self.rest_in_head[s * n_coords..(s + 1) * n_coords]);
            out.eligible.extend_from_slice(self.eligible_of(s));
            let of = self.sets_of(s);
            for (&mask, &start) in of.masks.iter().zip(of.coeff_start) {
                let start = start as usize;
                out.coeff_start.push(out.coeffs.len() as u32);
                out.coeffs.extend_from_slice(&self.coeffs[start..start + mask.count_ones() as usize]);
            }
            out.set_mask.extend_from_slice(of.masks);
            out.set_rms_error_cm.extend_from_slice(of.rms_error_cm);
            out.stand_in.extend_from_slice(&self.stand_in[csr(&self.stand_in_start, s)]);
            out.eligible_start.push(out.eligible.len() as u32);
            out.set_start.push(out.set_mask.len() as u32);
            out.stand_in_start.push(out.stand_in.len() as u32);
        }
        Ok(out)
    }
}
