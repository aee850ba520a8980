//! What a run is judged by: one definition each, used by every report.
//!
//! Solids here are all but the head, which is reported apart; the first centimetre from the root is left out. A strand is
//! sampled every half millimetre along its segments: particles alone would miss a tooth.
//!
//! - *in reach at a step*: a strand that, computed blind to the solid, comes within its least half-thickness of it then;
//!   *near*: in reach at some step. Both are fixed per scene, the same for every mode.
//! - *inside at a step*: a strand in reach with a sample deeper than max(0.05 mm, 2 % of the half-thickness).
//! - *passed through*: a strand with a sample that, swept from step to step at no more than half a millimetre of motion,
//!   crosses the middle of a solid: it is inside twice running with opposite ways out.
//! - *standoff*: least distance to the solids, averaged over strands in reach.
//! - *flicker*: length of the second difference of a particle's position per step.
//! - *stretch*: |l/l0 - 1| of segments.

use crate::histogram::Histogram;
use collision::{MovingSolid, Solid, deepest_on_segment};
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Distance between samples along a strand, cm.
const SAMPLE_CM: f32 = 0.05;
/// Relative motion per sweep position, cm.
const SWEEP_CM: f64 = 0.05;
/// Arc length from the root that is left out, cm.
const ROOT_CM: f32 = 1.0;
/// Least depth that counts as inside, cm.
const LEAST_DEPTH_CM: f32 = 0.005;
/// Depth that counts as inside as a share of a solid's half-thickness.
const DEPTH_SHARE: f32 = 0.02;

/// Strands in reach of solids, by step, ascending.
pub type Reach = Vec<Vec<u32>>;

/// What was measured over a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Strands in all.
    pub n_strands: usize,
    /// Strands that come into reach.
    pub near_strands: usize,
    /// Mean over steps of the share of strands in reach that are inside, per cent.
    pub near_strands_inside_pct: f64,
    /// Share of near strands crossed, per cent.
    pub passed_through_pct: f64,
    /// Deepest sample, cm.
    pub max_depth_cm: f64,
    /// Mean least distance of strands in reach, cm.
    pub mean_standoff_cm: f64,
    /// Mean stretch.
    pub mean_stretch: f64,
    /// 99th percentile of stretch.
    pub p99_stretch: f64,
    /// Largest stretch.
    pub max_stretch: f64,
    /// Median second difference over near strands, cm.
    pub flicker_near_median_cm: f64,
    /// 99.9th percentile of it.
    pub flicker_near_p999_cm: f64,
    /// Median second difference over all strands, cm.
    pub flicker_all_median_cm: f64,
    /// 99.9th percentile of it.
    pub flicker_all_p999_cm: f64,
    /// Strands with a sample inside the head, mean over steps, per cent of all.
    pub inside_head_pct: f64,
    /// Coordinates that were not finite, summed over steps.
    pub nonfinite: u64,
    /// Steps observed.
    pub steps: usize,
}

/// Accumulates the measures of one run.
pub struct Observer<'a> {
    n: usize,
    reach: &'a Reach,
    near: Vec<u32>,
    is_near: Vec<bool>,
    rest_length: Vec<f32>,
    first_sampled: Vec<u16>,
    previous: Vec<[f32; 3]>,
    before_previous: Vec<[f32; 3]>,
    step: usize,
    inside_share: f64,
    steps_with_reach: usize,
    passed: Vec<bool>,
    max_depth: f32,
    standoff: f64,
    standoff_count: u64,
    stretch: Histogram,
    flicker_near: Histogram,
    flicker_all: Histogram,
    head_inside: f64,
    nonfinite: u64,
}

/// What one strand does in one step.
#[derive(Clone, Copy, Default)]
struct StrandStep {
    inside: bool,
    depth: f32,
    distance: f32,
    crossed: bool,
}

impl<'a> Observer<'a> {
    /// An observer of strands that rest in `rest` (any frame, strand-major, `n` particles each).
    #[must_use]
    pub fn new(rest: &[[f32; 3]], n: usize, reach: &'a Reach) -> Self {
        let n_strands = rest.len() / n;
        let mut is_near = vec![false; n_strands];
        reach.iter().flatten().for_each(|&s| is_near[s as usize] = true);
        let near = (0..n_strands as u32).filter(|&s| is_near[s as usize]).collect();
        let rest_length: Vec<f32> =
            rest.chunks_exact(n).flat_map(|strand| strand.windows(2).map(|w| distance(w[0], w[1]))).collect();
        Self {
            n,
            reach,
            near,
            is_near,
            first_sampled: rest_length.chunks_exact(n - 1).map(first_sampled).collect(),
            rest_length,
            previous: Vec::new(),
            before_previous: Vec::new(),
            step: 0,
            inside_share: 0.0,
            steps_with_reach: 0,
            passed: vec![false; n_strands],
            max_depth: 0.0,
            standoff: 0.0,
            standoff_count: 0,
            stretch: Histogram::new(),
            flicker_near: Histogram::new(),
            flicker_all: Histogram::new(),
            head_inside: 0.0,
            nonfinite: 0,
        }
    }

    /// Takes in the state after a step: world positions, solids with their motion over the step, the head likewise.
    pub fn observe(&mut self, positions: &[[f32; 3]], solids: &[MovingSolid], head: Option<&MovingSolid>) {
        let n = self.n;
        self.nonfinite += positions.iter().flatten().filter(|x| !x.is_finite()).count() as u64;
        if self.previous.is_empty() {
            self.previous = positions.to_vec();
        }
        let empty = Vec::new();
        let in_reach = self.reach.get(self.step).unwrap_or(&empty);
        let results: Vec<StrandStep> = in_reach
            .par_iter()
            .map(|&s| {
                let of = s as usize * n..(s as usize + 1) * n;
                let first = usize::from(self.first_sampled[s as usize]);
                strand_step(&positions[of.clone()], &self.previous[of], first, solids)
            })
            .collect();
        if !results.is_empty() {
            self.steps_with_reach += 1;
            self.inside_share += results.iter().filter(|r| r.inside).count() as f64 / results.len() as f64;
        }
        for (r, &s) in results.iter().zip(in_reach) {
            self.passed[s as usize] |= r.crossed;
            self.max_depth = self.max_depth.max(r.depth);
            self.standoff += f64::from(r.distance.max(0.0));
            self.standoff_count += 1;
        }
        if let Some(head) = head {
            self.observe_head(positions, head);
        }
        self.observe_shape(positions);
        // Before the first state there was none: a difference of two is no second difference.
        if self.step > 0 {
            std::mem::swap(&mut self.before_previous, &mut self.previous);
        }
        self.previous.clear();
        self.previous.extend_from_slice(positions);
        self.step += 1;
    }

    fn observe_head(&mut self, positions: &[[f32; 3]], head: &MovingSolid) {
        let n = self.n;
        let head_from_world = head.pose.to.inverse().cast::<f32>();
        let inside = positions
            .par_chunks_exact(n)
            .zip(&self.first_sampled)
            .filter(|(strand, first)| {
                strand[usize::from(**first)..]
                    .iter()
                    .any(|&p| head.solid.sdf.distance((head_from_world * Point3::from(p)).coords) < -LEAST_DEPTH_CM)
            })
            .count();
        self.head_inside += inside as f64 / (positions.len() / n) as f64;
    }

    fn observe_shape(&mut self, positions: &[[f32; 3]]) {
        let n = self.n;
        for (s, strand) in positions.chunks_exact(n).enumerate() {
            for (w, &l0) in strand.windows(2).zip(&self.rest_length[s * (n - 1)..]) {
                self.stretch.add((distance(w[0], w[1]) / l0 - 1.0).abs());
            }
            if self.before_previous.is_empty() {
                continue;
            }
            for i in s * n + 2..(s + 1) * n {
                let size = second_difference(self.before_previous[i], self.previous[i], positions[i]);
                self.flicker_all.add(size);
                if self.is_near[s] {
                    self.flicker_near.add(size);
                }
            }
        }
    }

    /// Strands that come into reach at some step.
    #[must_use]
    pub fn near(&self) -> &[u32] {
        &self.near
    }

    /// The measures of all steps observed.
    #[must_use]
    pub fn finish(&self) -> Measured {
        let share = |sum: f64, count: f64| if count > 0.0 { sum / count } else { 0.0 };
        let passed = self.near.iter().filter(|&&s| self.passed[s as usize]).count() as f64;
        Measured {
            n_strands: self.is_near.len(),
            near_strands: self.near.len(),
            near_strands_inside_pct: 100.0 * share(self.inside_share, self.steps_with_reach as f64),
            passed_through_pct: 100.0 * share(passed, self.near.len() as f64),
            max_depth_cm: f64::from(self.max_depth),
            mean_standoff_cm: share(self.standoff, self.standoff_count as f64),
            mean_stretch: self.stretch.mean(),
            p99_stretch: self.stretch.quantile(0.99),
            max_stretch: self.stretch.max(),
            flicker_near_median_cm: self.flicker_near.quantile(0.5),
            flicker_near_p999_cm: self.flicker_near.quantile(0.999),
            flicker_all_median_cm: self.flicker_all.quantile(0.5),
            flicker_all_p999_cm: self.flicker_all.quantile(0.999),
            inside_head_pct: 100.0 * share(self.head_inside, self.step as f64),
            nonfinite: self.nonfinite,
            steps: self.step,
        }
    }
}

/// Strands that come within each solid's least half-thickness of it: what is in reach at one step of a blind run.
#[must_use]
pub fn in_reach(positions: &[[f32; 3]], rest: &[[f32; 3]], n: usize, solids: &[MovingSolid]) -> Vec<u32> {
    positions
        .par_chunks_exact(n)
        .zip(rest.par_chunks_exact(n))
        .enumerate()
        .filter(|(_, (strand, rest))| {
            let lengths: Vec<f32> = rest.windows(2).map(|w| distance(w[0], w[1])).collect();
            let first = usize::from(first_sampled(&lengths));
            solids.iter().any(|moving| {
                let solid_from_world = moving.pose.to.inverse().cast::<f32>();
                let reach = moving.solid.half_thickness_cm;
                strand[first..].windows(2).any(|w| {
                    let [a, b] = [w[0], w[1]].map(|p| (solid_from_world * Point3::from(p)).coords);
                    deepest_on_segment(&moving.solid.sdf, a, b, SAMPLE_CM, reach).is_some()
                })
            })
        })
        .map(|(s, _)| s as u32)
        .collect()
}

/// Strands with a sample inside a solid at the end of its motion: for pictures that show which.
#[must_use]
pub fn strands_inside(positions: &[[f32; 3]], n: usize, solids: &[MovingSolid]) -> Vec<bool> {
    positions
        .par_chunks_exact(n)
        .map(|strand| {
            let lengths: Vec<f32> = strand.windows(2).map(|w| distance(w[0], w[1])).collect();
            let first = usize::from(first_sampled(&lengths));
            first < n && strand_step(strand, strand, first, solids).inside
        })
        .collect()
}

fn first_sampled(lengths: &[f32]) -> u16 {
    let mut sum = 0.0;
    for (i, l) in lengths.iter().enumerate() {
        sum += l;
        if sum >= ROOT_CM {
            return i as u16 + 1;
        }
    }
    lengths.len() as u16
}

/// Flicker of one particle: the length of the second difference of its positions at three steps, cm.
#[must_use]
pub fn second_difference(a: [f32; 3], b: [f32; 3], c: [f32; 3]) -> f32 {
    let d: [f32; 3] = std::array::from_fn(|k| c[k] - 2.0 * b[k] + a[k]);
    (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    (Vector3::from(b) - Vector3::from(a)).norm()
}

fn strand_step(now: &[[f32; 3]], before: &[[f32; 3]], first: usize, solids: &[MovingSolid]) -> StrandStep {
    let mut out = StrandStep { distance: f32::INFINITY, ..StrandStep::default() };
    for moving in solids {
        let solid = moving.solid;
        let allowed = LEAST_DEPTH_CM.max(DEPTH_SHARE * solid.half_thickness_cm);
        let at_end = moving.pose.to.inverse().cast::<f32>();
        for w in now[first..].windows(2) {
            let [a, b] = [w[0], w[1]].map(|p| (at_end * Point3::from(p)).coords);
            let least = least_distance(solid, a, b);
            out.distance = out.distance.min(least);
            out.depth = out.depth.max(-least);
            out.inside |= least < -allowed;
        }
        out.crossed |= crosses(now, before, first, moving);
    }
    out
}

/// Least sampled distance of a segment to a solid, or a lower bound of it where that is more than a sample away.
fn least_distance(solid: &Solid, a: Vector3<f32>, b: Vector3<f32>) -> f32 {
    let length = (b - a).norm();
    let n_samples = (length / SAMPLE_CM).ceil().clamp(1.0, 4096.0) as usize;
    let mut least = f32::INFINITY;
    let mut k = 0;
    while k <= n_samples {
        let d = solid.sdf.distance(a.lerp(&b, k as f32 / n_samples as f32));
        least = least.min(d);
        // A distance changes by at most the length walked: samples that cannot be nearer are skipped.
        let safe = (solid.sdf.surely(d) - least.max(0.0)).max(0.0) / SAMPLE_CM;
        k += (safe as usize).max(1);
    }
    least
}

/// Whether some sample of the strand crosses the middle of the solid between the two states.
fn crosses(now: &[[f32; 3]], before: &[[f32; 3]], first: usize, moving: &MovingSolid) -> bool {
    let sdf = &moving.solid.sdf;
    let mut moved: f64 = 0.0;
    for (p, q) in now.iter().zip(before) {
        moved = moved.max(f64::from(distance(*p, *q)));
    }
    let n_sweeps = ((moved + moving.max_displacement()) / SWEEP_CM).ceil().clamp(1.0, 400.0) as usize;
    let poses: Vec<Isometry3<f32>> =
        (0..=n_sweeps).map(|k| moving.pose.at(k as f64 / n_sweeps as f64).inverse().cast()).collect();
    for i in first..now.len() - 1 {
        let [a0, b0, a1, b1] = [before[i], before[i + 1], now[i], now[i + 1]].map(Vector3::from);
        let at = |pose: &Isometry3<f32>, alpha: f32, s: f32| {
            let p = a0.lerp(&a1, alpha).lerp(&b0.lerp(&b1, alpha), s);
            (pose * Point3::from(p)).coords
        };
        let length = (b1 - a1).norm().max((b0 - a0).norm());
        let middle = sdf.lower_bound(at(&poses[n_sweeps], 1.0, 0.5));
        if middle > 0.5 * length + (moved + moving.max_displacement()) as f32 {
            continue;
        }
        let n_samples = (length / SAMPLE_CM).ceil().clamp(1.0, 4096.0) as usize;
        for k in 0..n_samples {
            let s = (k as f32 + 0.5) / n_samples as f32;
            let mut last: Option<Vector3<f32>> = None;
            for (sweep, pose) in poses.iter().enumerate() {
                let (d, gradient) = sdf.distance_gradient(at(pose, sweep as f32 / n_sweeps as f32, s));
                let inside = (d < 0.0).then_some(gradient);
                if let (Some(out), Some(out_before)) = (inside, last)
                    && out.dot(&out_before) < 0.0
                {
                    return true;
                }
                last = inside;
            }
        }
    }
    false
}

#[cfg(test)]
mod cheats;

#[cfg(test)]
mod tests {
    use super::*;
    use collision::SolidPose;

    fn line(x: f32) -> Vec<[f32; 3]> {
        (0..25).map(|i| [x, -(i as f32), 0.0]).collect()
    }

    fn rod() -> Solid {
        crate::shapes::rod(0.1, 4.0).expect("a valid rod")
    }

    fn across(y: f64) -> Isometry3<f64> {
        // The rod's axis along z, at height y.
        Isometry3::translation(0.0, y, 0.0) * Isometry3::rotation(Vector3::x() * std::f64::consts::FRAC_PI_2)
    }

    fn run(from: f32, to: f32) -> Measured {
        let solid = rod();
        let moving = MovingSolid { solid: &solid, pose: SolidPose::still(across(-10.37)) };
        let reach = vec![vec![0], vec![0]];
        let mut observer = Observer::new(&line(0.0), 25, &reach);
        observer.observe(&line(from), &[moving], None);
        observer.observe(&line(to), &[moving], None);
        observer.finish()
    }

    #[test]
    fn a_strand_that_jumps_over_a_rod_has_passed_through_it() {
        let measured = run(-0.5, 0.5);
        assert_eq!(measured.near_strands_inside_pct, 0.0);
        assert_eq!(measured.passed_through_pct, 100.0);
    }

    #[test]
    fn a_strand_that_touches_and_leaves_has_not() {
        let measured = run(-0.5, -0.08);
        assert_eq!(measured.near_strands_inside_pct, 50.0);
        assert_eq!(measured.passed_through_pct, 0.0);
    }

    #[test]
    fn a_rod_between_two_particles_is_seen() {
        let measured = run(0.0, 0.0);
        assert_eq!(measured.near_strands_inside_pct, 100.0);
        assert!((measured.max_depth_cm - 0.1).abs() < 0.03);
    }

    #[test]
    fn a_strand_is_marked_where_a_step_counts_it_as_inside() {
        let solid = rod();
        for (x, is_inside) in [(0.0, true), (0.05, true), (0.5, false)] {
            let moving = MovingSolid { solid: &solid, pose: SolidPose::still(across(-10.37)) };
            assert_eq!(strands_inside(&line(x), 25, &[moving]), vec![is_inside], "{x}");
            assert_eq!(run(x, x).near_strands_inside_pct > 0.0, is_inside, "{x}");
        }
    }

    #[test]
    fn the_first_centimetre_is_left_out() {
        let solid = rod();
        let moving = MovingSolid { solid: &solid, pose: SolidPose::still(across(-0.4)) };
        assert!(in_reach(&line(0.0), &line(0.0), 25, &[moving]).is_empty());
        let moving = MovingSolid { solid: &solid, pose: SolidPose::still(across(-1.6)) };
        assert_eq!(in_reach(&line(0.0), &line(0.0), 25, &[moving]), vec![0]);
    }
}
