//! A small model made by hand for the tests of this crate: guides on a lattice, hairs between them, all subsets of few guides kept.

use io_formats::guide_transform::Blend;
use io_formats::skinning_model::{MaterialRecord, SkinningModel, WeightPoly};

/// Numbers without pattern in 0 to 1, the same for each seed.
pub(crate) struct Noise(u64);

impl Noise {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    pub fn next(&mut self) -> f32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }
}

/// `columns` by `rows` guides 1.3 cm apart, 24 cm long, hanging down, and `n_hairs` hairs between them, each with its nearest 4 to 9
/// guides eligible. The guides' strands come first.
pub(crate) fn lattice(columns: usize, rows: usize, n_particles: usize, n_hairs: usize, blend: Blend) -> SkinningModel {
    let mut noise = Noise::new(5);
    let n_guides = columns * rows;
    let mut roots: Vec<[f32; 2]> =
        (0..n_guides).map(|g| [1.3 * (g % columns) as f32, 1.3 * (g / columns) as f32]).collect();
    for _ in 0..n_hairs {
        roots.push([1.3 * (columns - 1) as f32 * noise.next(), 1.3 * (rows - 1) as f32 * noise.next()]);
    }
    let n_strands = roots.len();
    let mut rest_in_head = Vec::new();
    for (s, root) in roots.iter().enumerate() {
        for i in 0..n_particles {
            let down = 24.0 * i as f32 / (n_particles - 1) as f32;
            // Each a little bent, in its own way.
            let bend = 0.002 * ((s % 7) as f32 - 3.0) * down * down;
            rest_in_head.extend([root[0] + bend, -down, root[1] - 0.5 * bend]);
        }
    }
    let mut model = SkinningModel {
        provenance: 0,
        n_strands: n_strands as u32,
        n_particles: n_particles as u32,
        groom_in_head: rest_in_head[..3 * n_guides * n_particles].to_vec(),
        rest_in_head,
        guide_strands: (0..n_guides as u32).collect(),
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
        max_distance: 6.0,
        release_distance: 8.0,
        blend,
        material: MaterialRecord {
            stretch_dyn: 3e5,
            bend: 30.0,
            twist: 15.0,
            stretch_damping: 10.0,
            bend_damping: 0.05,
            twist_damping: 0.05,
            friction: 0.1,
            linear_density_g_per_cm: 5e-5,
            air_drag_per_s: 0.0,
        },
    };
    for (s, root) in roots.iter().enumerate() {
        let mut near: Vec<(f32, u16)> =
            (0..n_guides).map(|g| ((roots[g][0] - root[0]).hypot(roots[g][1] - root[1]), g as u16)).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.truncate(4 + s % 6);
        let mut eligible: Vec<u16> = near.iter().map(|&(_, g)| g).collect();
        eligible.sort_unstable();
        add_sets(&mut model, eligible.len(), &mut noise);
        for (b, &j) in eligible.iter().enumerate() {
            model.pairs.extend(eligible[..b].iter().map(|&i| [i, j]));
        }
        model.eligible.extend(eligible);
        model.eligible_start.push(model.eligible.len() as u32);
    }
    model.pairs.sort_unstable();
    model.pairs.dedup();
    for &[i, j] in &model.pairs {
        let apart = |c: usize| roots[usize::from(i)][c] - roots[usize::from(j)][c];
        model.position_scale.push(n_particles as f32 * (apart(0).powi(2) + apart(1).powi(2)));
        model.velocity_scale.push(n_particles as f32 * 400.0);
    }
    model.validate().expect("the model is whole");
    model
}

/// Keeps single guides and some of the sets of up to five, with weights that sum to one and errors that mostly fall with size.
fn add_sets(model: &mut SkinningModel, k: usize, noise: &mut Noise) {
    let full = (1u16 << k) - 1;
    let first = model.set_mask.len();
    for mask in 1..=full {
        let size = mask.count_ones();
        if size > 1 && (size > 5 || noise.next() < 0.4) {
            continue;
        }
        model.coeff_start.push(model.coeffs.len() as u32);
        model.set_mask.push(mask);
        model.set_rms_error_cm.push((0.5 + noise.next()) / size as f32);
        let raw: Vec<f32> = (0..size).map(|_| 0.2 + noise.next()).collect();
        let slopes: Vec<f32> = (0..size).map(|_| 0.2 * (noise.next() - 0.5)).collect();
        let (sum, mean) = (raw.iter().sum::<f32>(), slopes.iter().sum::<f32>() / size as f32);
        for (w, slope) in raw.iter().zip(&slopes) {
            let poly = WeightPoly { quad: 0.5 * (slope - mean), lin: slope - mean, con: w / sum };
            model.coeffs.push(poly.to_bits());
        }
    }
    let masks = &model.set_mask[first..];
    let errors = &model.set_rms_error_cm[first..];
    for mask in 1..=full {
        let within = (0..masks.len()).filter(|&k| masks[k] & !mask == 0);
        let best = within.min_by(|&a, &b| errors[a].total_cmp(&errors[b]));
        model.stand_in.push(best.expect("single guides are kept") as u16);
    }
    model.set_start.push(model.set_mask.len() as u32);
    model.stand_in_start.push(model.stand_in.len() as u32);
}
