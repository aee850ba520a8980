//! A skinning model made by hand: hair in a row, every set of guides kept.
//!
//! Strands stand along x and hang along -y with a slight bend. Weights follow from distance: near guides weigh more, more
//! so towards the tip. What a trained model would know better does not matter to laws that hold for any model.

use adaptive_runtime::record_of;
use io_formats::skinning_model::{SkinningModel, WeightPoly};
use strand_sim::Material;

/// Particles of every strand.
pub const N_PARTICLES: usize = 25;

/// A row of hair with some of its strands as guides.
#[derive(Debug, Clone)]
pub struct Row {
    /// Place of each strand along x, cm.
    pub x: Vec<f32>,
    /// Which of them are guides, at most nine, ascending.
    pub guides: Vec<u32>,
    /// Length of every strand, cm.
    pub length: f32,
}

impl Row {
    /// Twenty strands 3 mm apart with a gap of 1.2 cm in the middle, and three guides on each side of it.
    #[must_use]
    pub fn parted() -> Self {
        let half = |k: usize| 0.6 + 0.3 * k as f32;
        let x = (0..10).rev().map(|k| -half(k)).chain((0..10).map(half)).collect();
        Self { x, guides: vec![0, 4, 8, 11, 15, 19], length: 18.0 }
    }

    /// Twenty strands 2 mm apart with three guides: both ends and the middle.
    #[must_use]
    pub fn of_three_guides() -> Self {
        Self { x: (0..20).map(|k| 0.2 * k as f32).collect(), guides: vec![0, 10, 19], length: 18.0 }
    }

    /// Rest shape of a strand at `x`: hanging, with a bend that differs from strand to strand.
    #[must_use]
    pub fn shape(&self, x: f32) -> Vec<[f32; 3]> {
        let step = self.length / (N_PARTICLES - 1) as f32;
        let at = |i: usize| {
            let u = i as f32 / (N_PARTICLES - 1) as f32;
            [x + 0.1 * u * u, -step * i as f32, (0.6 + 0.05 * x) * u * u]
        };
        (0..N_PARTICLES).map(at).collect()
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> SkinningModel {
        let n_guides = self.guides.len();
        let guide_x: Vec<f32> = self.guides.iter().map(|&s| self.x[s as usize]).collect();
        let mut model = SkinningModel {
            provenance: 1,
            n_strands: self.x.len() as u32,
            n_particles: N_PARTICLES as u32,
            groom_in_head: guide_x.iter().flat_map(|&x| self.shape(x)).flatten().collect(),
            rest_in_head: self.x.iter().flat_map(|&x| self.shape(x)).flatten().collect(),
            guide_strands: self.guides.clone(),
            eligible_start: vec![0],
            eligible: Vec::new(),
            set_start: vec![0],
            set_mask: Vec::new(),
            set_rms_error_cm: Vec::new(),
            coeff_start: Vec::new(),
            coeffs: Vec::new(),
            stand_in_start: vec![0],
            stand_in: Vec::new(),
            pairs: Vec::new(),
            position_scale: Vec::new(),
            velocity_scale: Vec::new(),
            velocity_weight: 5.0,
            max_distance: 4.0,
            release_distance: 6.0,
            blend: io_formats::guide_transform::Blend::Rigid,
            material: record_of(&Material::straight()),
        };
        for (s, &x) in self.x.iter().enumerate() {
            // A guide follows itself alone, as in training.
            let own = self.guides.iter().position(|&g| g as usize == s);
            let eligible: Vec<usize> = own.map_or_else(|| (0..n_guides).collect(), |g| vec![g]);
            add_strand(&mut model, &eligible, |g| (guide_x[g] - x).abs().max(0.05));
        }
        for i in 0..n_guides {
            for j in i + 1..n_guides {
                model.pairs.push([i as u16, j as u16]);
                // At rest every pair is at distance one.
                model.position_scale.push(N_PARTICLES as f32 * (guide_x[i] - guide_x[j]).powi(2));
                model.velocity_scale.push(N_PARTICLES as f32 * 100.0);
            }
        }
        model
    }
}

fn add_strand(model: &mut SkinningModel, eligible: &[usize], distance: impl Fn(usize) -> f32) {
    let n_masks = (1_u16 << eligible.len()) - 1;
    model.eligible.extend(eligible.iter().map(|&g| g as u16));
    for mask in 1..=n_masks {
        let members: Vec<usize> = (0..eligible.len()).filter(|b| mask >> b & 1 == 1).map(|b| eligible[b]).collect();
        let share = |power: i32| -> Vec<f32> {
            let raw: Vec<f32> = members.iter().map(|&g| distance(g).powi(-power)).collect();
            let sum: f32 = raw.iter().sum();
            raw.iter().map(|w| w / sum).collect()
        };
        let (root, tip) = (share(1), share(2));
        model.set_mask.push(mask);
        // More guides fit better.
        model.set_rms_error_cm.push(0.1 / members.len() as f32);
        model.coeff_start.push(model.coeffs.len() as u32);
        for (r, t) in root.iter().zip(&tip) {
            model.coeffs.push(WeightPoly { quad: 0.0, lin: t - r, con: *r }.to_bits());
        }
        model.stand_in.push(mask - 1);
    }
    model.eligible_start.push(model.eligible.len() as u32);
    model.set_start.push(model.set_mask.len() as u32);
    model.stand_in_start.push(model.stand_in.len() as u32);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_made_by_hand_are_valid() {
        for row in [Row::parted(), Row::of_three_guides()] {
            row.model().validate().unwrap();
        }
    }
}
