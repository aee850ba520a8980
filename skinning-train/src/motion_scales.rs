//! What makes guide motions comparable: A_ij and B_ij of AS16 §7.1, and thresholds for the distance of Eq. (2) that fit.
//!
//! Both terms of Eq. (2) average to one over training by construction, so the distance averages 1 + σ: with σ = 5 the
//! paper's threshold of 2 would part most guides in the very motion they were trained on. The threshold is therefore a
//! stated percentile of the distance over the training frames of all pairs that may meet; connectivity is reported for
//! both. Positions and velocities are those of the head frame, so a fast turn of the head parts nobody.

use io_formats::FrameSource;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::error::Result;

/// σ of AS16 Eq. (2), the paper's value.
pub const PAPER_VELOCITY_WEIGHT: f32 = 5.0;
/// δ of AS16 Eq. (2), the paper's value.
pub const PAPER_MAX_DISTANCE: f32 = 2.0;
/// Pairs that hardly move against each other get at least this share of the median scale, or any touch would part them.
const FLOOR: f64 = 1e-3;
/// Where nothing moves at all (cm², cm²/s²).
const LEAST_SCALE: f64 = 1e-9;

/// How thresholds are set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibrationParams {
    /// σ of AS16 Eq. (2).
    pub velocity_weight: f32,
    /// Percentile of the distance that becomes δ, 0 to 100.
    pub percentile: f64,
    /// An edge disappears at this multiple of δ; at least 1.
    pub release_factor: f32,
}

/// Scales of the pairs, thresholds, and what they do to the training motion.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct MotionScales {
    /// A_ij of each pair (cm²).
    pub position_scale: Vec<f32>,
    /// B_ij of each pair (cm²/s²).
    pub velocity_scale: Vec<f32>,
    /// δ: an edge appears below it.
    pub max_distance: f32,
    /// An edge disappears above it.
    pub release_distance: f32,
    /// Share of pairs and frames whose distance is below δ.
    pub connected: f64,
    /// The same with the paper's σ = 5 and δ = 2.
    pub connected_paper: f64,
}

/// Head-frame positions of the guides in all frames.
struct Tracks {
    /// `n_frames * n_guides * n_particles` points.
    points: Vec<[f32; 3]>,
    n_guides: usize,
    n_particles: usize,
    /// Per frame, the frames that give its velocity and the time between them, unless its sequence is a single frame.
    neighbours: Vec<Option<(usize, usize, f64)>>,
}

/// Measures the scales of `pairs` of guides over all frames and sets the thresholds.
///
/// # Errors
/// When a frame cannot be read.
///
/// # Panics
/// If a guide or its strand does not exist.
pub fn calibrate(
    frames: &dyn FrameSource,
    guide_strands: &[u32],
    pairs: &[[u16; 2]],
    params: &CalibrationParams,
    on_frame: &mut dyn FnMut(u64),
) -> Result<MotionScales> {
    let tracks = Tracks::read(frames, guide_strands, on_frame)?;
    // Squared differences of each pair: positions in every frame, velocities where there are any.
    let differences: Vec<Vec<(f64, Option<f64>)>> = pairs.par_iter().map(|p| tracks.differences(*p)).collect();
    let position_scale = floored(differences.iter().map(|d| mean(d.iter().map(|x| x.0))).collect());
    let velocity_scale = floored(differences.iter().map(|d| mean(d.iter().filter_map(|x| x.1))).collect());

    let distances = |sigma: f32| -> Vec<f32> {
        let scales = position_scale.iter().zip(&velocity_scale);
        let all = differences.iter().zip(scales).flat_map(|(d, (&a, &b))| {
            d.iter().filter_map(move |&(p, v)| v.map(|v| (p / a + f64::from(sigma) * v / b) as f32))
        });
        all.collect()
    };
    let mut ours = distances(params.velocity_weight);
    let below = |all: &[f32], limit: f32| all.iter().filter(|&&d| d < limit).count() as f64 / all.len().max(1) as f64;
    let max_distance = percentile(&mut ours, params.percentile).unwrap_or(PAPER_MAX_DISTANCE);
    Ok(MotionScales {
        max_distance,
        release_distance: max_distance * params.release_factor,
        connected: below(&ours, max_distance),
        connected_paper: below(&distances(PAPER_VELOCITY_WEIGHT), PAPER_MAX_DISTANCE),
        position_scale: position_scale.iter().map(|&x| x as f32).collect(),
        velocity_scale: velocity_scale.iter().map(|&x| x as f32).collect(),
    })
}

impl Tracks {
    fn read(frames: &dyn FrameSource, guide_strands: &[u32], on_frame: &mut dyn FnMut(u64)) -> Result<Self> {
        let (n_frames, n_particles) = (frames.n_frames(), frames.n_particles());
        let mut points = Vec::with_capacity(n_frames * guide_strands.len() * n_particles);
        let mut frame = vec![[0.0_f32; 3]; frames.n_strands() * n_particles];
        for f in 0..n_frames {
            frames.read(f, &mut frame)?;
            for &s in guide_strands {
                points.extend_from_slice(&frame[s as usize * n_particles..(s as usize + 1) * n_particles]);
            }
            on_frame(f as u64 + 1);
        }
        // Central differences; at the ends of a sequence the one neighbour there is.
        let neighbours = (0..n_frames)
            .map(|f| {
                let sequence = frames.info(f).sequence;
                let before = if f > 0 && frames.info(f - 1).sequence == sequence { f - 1 } else { f };
                let after = if f + 1 < n_frames && frames.info(f + 1).sequence == sequence { f + 1 } else { f };
                let time = frames.info(after).time_s - frames.info(before).time_s;
                (time > 0.0).then_some((before, after, time))
            })
            .collect();
        Ok(Self { points, n_guides: guide_strands.len(), n_particles, neighbours })
    }

    fn of(&self, frame: usize, guide: u16) -> &[[f32; 3]] {
        let at = (frame * self.n_guides + usize::from(guide)) * self.n_particles;
        &self.points[at..at + self.n_particles]
    }

    /// Per frame, |p_i - p_j|² and |v_i - v_j|², positions and velocities stacked over particles.
    fn differences(&self, [i, j]: [u16; 2]) -> Vec<(f64, Option<f64>)> {
        let one = |frame: usize, at: usize, c: usize| f64::from(self.of(frame, i)[at][c] - self.of(frame, j)[at][c]);
        let all = |f: &dyn Fn(usize, usize) -> f64| -> f64 {
            (0..self.n_particles).map(|at| (0..3).map(|c| f(at, c).powi(2)).sum::<f64>()).sum()
        };
        (0..self.neighbours.len())
            .map(|f| {
                let position = all(&|at, c| one(f, at, c));
                let velocity = self.neighbours[f]
                    .map(|(before, after, time)| all(&|at, c| (one(after, at, c) - one(before, at, c)) / time));
                (position, velocity)
            })
            .collect()
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0_usize), |(sum, n), x| (sum + x, n + 1));
    sum / n.max(1) as f64
}

fn floored(mut scales: Vec<f64>) -> Vec<f64> {
    let mut sorted = scales.clone();
    sorted.sort_by(f64::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let floor = (FLOOR * median).max(LEAST_SCALE);
    scales.iter_mut().for_each(|x| *x = x.max(floor));
    scales
}

/// The value that `percent` of all values do not exceed; reorders them.
fn percentile(values: &mut [f32], percent: f64) -> Option<f32> {
    if values.is_empty() {
        return None;
    }
    let rank = (percent / 100.0 * values.len() as f64).ceil() as usize;
    let at = rank.clamp(1, values.len()) - 1;
    Some(*values.select_nth_unstable_by(at, f32::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use io_formats::{FrameInfo, MemoryFrames};

    use super::*;

    const DT: f64 = 0.02;
    /// Relative, of `f32` positions.
    const ROUND_OFF: f32 = 1e-4;

    /// Three guides of three particles that drift apart at 0, 1 and 3 cm/s; two sequences, the second starting afresh.
    fn drifting() -> MemoryFrames {
        let mut frames = MemoryFrames::new(3, 3);
        for sequence in 0..2 {
            for f in 0..50 {
                let t = f as f64 * DT;
                let points: Vec<[f32; 3]> = (0..9)
                    .map(|at| {
                        [(at / 3) as f32 + [0.0, 1.0, 3.0][at / 3] * t as f32, -((at % 3) as f32), sequence as f32]
                    })
                    .collect();
                frames
                    .push(FrameInfo { sequence, time_s: t }, &points)
                    .expect("the frame has the right number of points");
            }
        }
        frames
    }

    fn params(percentile: f64) -> CalibrationParams {
        CalibrationParams { velocity_weight: 5.0, percentile, release_factor: 1.3 }
    }

    fn check(percentile: f64) -> MotionScales {
        let pairs = [[0, 1], [0, 2], [1, 2]];
        calibrate(&drifting(), &[0, 1, 2], &pairs, &params(percentile), &mut |_| {}).expect("the frames can be read")
    }

    #[test]
    fn scales_are_the_mean_squared_differences_and_do_not_see_the_cut_between_sequences() {
        let scales = check(99.5);
        for (b, v) in scales.velocity_scale.iter().zip([1.0_f32, 3.0, 2.0]) {
            // Three particles, each at the difference of speeds.
            assert!((b - 3.0 * v * v).abs() < 100.0 * ROUND_OFF * b, "{b}");
        }
        let expected: f64 = (0..50).map(|f| 3.0 * (1.0 + f as f64 * DT).powi(2)).sum::<f64>() / 50.0;
        assert!((scales.position_scale[0] - expected as f32).abs() < ROUND_OFF * expected as f32);
    }

    #[test]
    fn the_threshold_keeps_the_stated_share_and_the_papers_constants_do_not() {
        let scales = check(90.0);
        assert!((scales.connected - 0.9).abs() < 0.03, "{}", scales.connected);
        // Velocities are constant here, so their term alone is 5 throughout.
        assert_eq!(scales.connected_paper, 0.0);
        assert_eq!(scales.release_distance, scales.max_distance * 1.3);
        assert!(check(99.5).max_distance > scales.max_distance);
    }

    #[test]
    fn a_pair_at_rest_gets_a_floor() {
        assert_eq!(floored(vec![0.0, 2.0, 4.0]), [0.002, 2.0, 4.0]);
        assert!(floored(vec![0.0])[0] > 0.0);
    }
}
