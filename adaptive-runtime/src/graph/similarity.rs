//! How differently two guides move (AS16 §4.1): Eq. (2) over packed guides, and the distance of tips to compare with.
//!
//! Each guide's positions, then its velocities, stand in one row padded with zeros to whole vectors, so that a pair is two
//! rows subtracted. Lanes are summed in a fixed order.

use super::GuideMotion;
use multiversion::multiversion;

/// Values worked on together.
const WIDTH: usize = 16;

/// Positions and velocities of all guides: per guide two rows of `half` values, in the order of the input, zeros at the end.
#[derive(Clone, Debug, Default)]
pub(super) struct PackedMotion {
    half: usize,
    values: Vec<f32>,
}

impl PackedMotion {
    /// Takes over a step's motion.
    pub fn pack(&mut self, motion: &GuideMotion) {
        let n = motion.n_particles;
        self.half = (3 * n).next_multiple_of(WIDTH);
        let n_guides = motion.position_in_head.len() / n;
        self.values.resize(2 * n_guides * self.half, 0.0);
        for (guide, rows) in self.values.chunks_exact_mut(2 * self.half).enumerate() {
            let (position, velocity) = rows.split_at_mut(self.half);
            let of = guide * n..(guide + 1) * n;
            position[..3 * n].copy_from_slice(motion.position_in_head[of.clone()].as_flattened());
            velocity[..3 * n].copy_from_slice(motion.velocity_in_head[of].as_flattened());
        }
    }

    /// How differently guides `i` and `j` move.
    /// Implements AS16 Eq. (2), positions and velocities in the head frame.
    pub fn distance(
        &self,
        i: usize,
        j: usize,
        [position_scale, velocity_scale]: [f32; 2],
        velocity_weight: f32,
    ) -> f32 {
        let row = 2 * self.half;
        let [position, velocity] =
            squared_distances(&self.values[i * row..(i + 1) * row], &self.values[j * row..(j + 1) * row]);
        position / position_scale + velocity_weight * velocity / velocity_scale
    }
}

/// Squared distances of the two halves of two rows.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn squared_distances(a: &[f32], b: &[f32]) -> [f32; 2] {
    let half = a.len() / 2;
    let mut out = [0.0; 2];
    for (h, total) in out.iter_mut().enumerate() {
        let of = h * half..(h + 1) * half;
        let mut sum = [0.0f32; WIDTH];
        for (x, y) in a[of.clone()].as_chunks::<WIDTH>().0.iter().zip(b[of].as_chunks::<WIDTH>().0) {
            for l in 0..WIDTH {
                let d = x[l] - y[l];
                sum[l] = d.mul_add(d, sum[l]);
            }
        }
        *total = sum.iter().sum();
    }
    out
}

/// Distance of two guides' tips, cm.
pub(super) fn tip_distance(motion: &GuideMotion, i: usize, j: usize) -> f32 {
    let tip = |g: usize| motion.position_in_head[(g + 1) * motion.n_particles - 1];
    let (a, b) = (tip(i), tip(j));
    (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Single-precision sums of some seventy squares in another order.
    const ROUND_OFF: f32 = 1e-5;

    #[test]
    fn packed_guides_are_as_far_apart_as_plain_sums_say() {
        let at = |k: usize| [0, 1, 2].map(|c| ((7 * k + 3 * c) as f32).sin() * 12.0);
        for n in [2, 16, 25, 33] {
            let position: Vec<[f32; 3]> = (0..2 * n).map(at).collect();
            let velocity: Vec<[f32; 3]> = (1..=2 * n).map(|k| at(3 * k)).collect();
            let motion = GuideMotion {
                n_particles: n,
                position_in_head: &position,
                velocity_in_head: &velocity,
                position_in_solids: &[],
            };
            let mut packed = PackedMotion::default();
            packed.pack(&motion);
            let plain = |of: &[[f32; 3]]| -> f64 {
                (0..3 * n).map(|k| f64::from(of.as_flattened()[k] - of.as_flattened()[3 * n + k]).powi(2)).sum()
            };
            let expected = plain(&position) / 3.0 + 5.0 * plain(&velocity) / 7.0;
            let found = f64::from(packed.distance(0, 1, [3.0, 7.0], 5.0));
            assert!((found - expected).abs() <= f64::from(ROUND_OFF) * expected, "{n}: {found} for {expected}");
        }
    }
}
