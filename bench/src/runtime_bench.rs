//! What the runtime costs on whole heads, and what it is worth: the figures of AS16 §7 as DESIGN's measures define them.
//!
//! Times are CPU time of all threads over steps and reads and nothing else: poses are made outside the clock, and what looks at
//! every step runs apart, untimed (results do not depend on how often hair is read). Ratios are of two things timed in
//! one process. Every figure carries the size it was measured at.
//!
//! - [`cost`]: the loop of steps and reads, the copy it is held against, tails, shares of stages, scaling
//! - [`quality`]: solids swept through a head, measured at every step, beside full space
//! - [`situations`]: what happens after a solid has left, AS16 Fig. 6, modes against full space, ten minutes of salon

pub mod cost;
pub mod quality;
pub mod situations;

use crate::error::Error;
use crate::world::World;
use adaptive_runtime::{Runtime, RuntimeParams, StepInput, StepReport};
use io_formats::skinning_model::SkinningModel;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// One measured number.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Its name, also in files.
    pub name: String,
    /// Its unit.
    pub unit: &'static str,
    /// The number; none where there is nothing to measure yet.
    pub value: Option<f64>,
    /// What it was measured on.
    pub of: String,
}

impl Figure {
    /// A figure.
    #[must_use]
    pub fn new(name: impl Into<String>, unit: &'static str, value: f64, of: &str) -> Self {
        Self { name: name.into(), unit, value: Some(value), of: of.to_owned() }
    }

    /// One that cannot be measured yet; `why` stands for what it was measured on.
    #[must_use]
    pub fn missing(name: &str, unit: &'static str, why: &str) -> Self {
        Self { name: name.to_owned(), unit, value: None, of: why.to_owned() }
    }
}

/// A head of hair in a scene, and how it is skinned.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// The scene.
    pub world: &'a World,
    /// The trained model.
    pub model: &'a SkinningModel,
    /// How the runtime works.
    pub params: RuntimeParams,
}

impl Subject<'_> {
    /// Strands, particles and guides, in words.
    #[must_use]
    pub fn size(&self) -> String {
        let m = self.model;
        format!("{}: {} x {}, {} guides", self.world.scene.name, m.n_strands, m.n_particles, m.n_guides())
    }

    /// The hair at rest where the scene begins.
    ///
    /// # Errors
    /// A model or scene the runtime refuses.
    pub fn runtime(&self) -> Result<Runtime, Error> {
        Ok(Runtime::new(
            self.model.clone(),
            self.params,
            self.world.world_from_head(0.0),
            Some(self.world.head.clone()),
            self.world.solids.clone(),
            &self.world.world_from_solids(0.0),
        )?)
    }

    /// Length of a step, s.
    #[must_use]
    pub fn dt(&self) -> f64 {
        self.world.scene.step_s
    }

    /// One step to the scene's state at time `t`, s.
    pub fn step_to(&self, runtime: &mut Runtime, t: f64) -> StepReport {
        let world_from_solids = self.world.world_from_solids(t);
        runtime.step(&StepInput {
            dt: self.dt(),
            world_from_head: self.world.world_from_head(t),
            world_from_solids: &world_from_solids,
        })
    }
}

/// The first `n` hairs of a trained head, or more hairs than it has: copies set off to the side by up to half a millimetre.
/// Guides are kept, after the others where they are not among the first; so a prefix is as even as the generator's.
///
/// # Errors
/// None for a sound model.
pub fn resized(model: &SkinningModel, n: usize, seed: u64) -> Result<SkinningModel, Error> {
    const ASIDE_CM: f32 = 0.05;
    let whole = model.n_strands;
    let n = n.min(u32::MAX as usize / 2) as u32;
    let mut strands: Vec<u32> = (0..n).map(|s| s % whole).collect();
    if n < whole {
        let past = |kept: u32| model.guide_strands.iter().copied().filter(move |&s| s >= kept);
        let mut kept = n;
        // A shorter prefix loses guides, which then need room of their own.
        while kept > 0 && kept as usize + past(kept).count() > n as usize {
            kept = n.saturating_sub(past(kept).count() as u32).min(kept - 1);
        }
        strands.truncate(kept as usize);
        let mut guides: Vec<u32> = past(kept).collect();
        guides.sort_unstable();
        strands.extend(guides);
    }
    let mut out = model.pick(&strands)?;
    let n_coords = model.n_particles as usize * 3;
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    for strand in out.rest_in_head.chunks_exact_mut(n_coords).skip(whole as usize) {
        let aside: [f32; 3] = random.random();
        for p in strand.chunks_exact_mut(3) {
            (0..3).for_each(|c| p[c] += (2.0 * aside[c] - 1.0) * ASIDE_CM);
        }
    }
    Ok(out)
}

/// Memory of this process that lies in memory now, MB; none where the system does not tell.
#[must_use]
pub fn resident_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmRSS:"))?;
    let kilobytes: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kilobytes / 1024.0)
}

/// Exponent p and factor a of the power law y = a x^p nearest to points in logarithms.
#[must_use]
pub fn power_law(points: &[[f64; 2]]) -> (f64, f64) {
    let n = points.len().max(1) as f64;
    let logs: Vec<[f64; 2]> = points.iter().map(|p| [p[0].ln(), p[1].ln()]).collect();
    let mean = |c: usize| logs.iter().map(|p| p[c]).sum::<f64>() / n;
    let (mx, my) = (mean(0), mean(1));
    let sxy: f64 = logs.iter().map(|p| (p[0] - mx) * (p[1] - my)).sum();
    let sxx: f64 = logs.iter().map(|p| (p[0] - mx).powi(2)).sum();
    let exponent = if sxx > 0.0 { sxy / sxx } else { 0.0 };
    (exponent, (my - exponent * mx).exp())
}

/// The value below which a share `q` lies; zero of nothing.
#[must_use]
pub fn quantile(values: &[f64], q: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = (q * sorted.len() as f64).ceil() as usize;
    sorted.get(at.clamp(1, sorted.len().max(1)) - 1).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use io_formats::guide_transform::Blend;
    use io_formats::skinning_model::WeightPoly;
    use strand_sim::Material;

    /// Strands in a row, the named ones guides; each follows the first guide.
    fn row(n_strands: u32, guide_strands: Vec<u32>) -> SkinningModel {
        let n_particles = 4;
        let shape = |s: u32| (0..n_particles).flat_map(move |i| [s as f32, -(i as f32), 0.0]);
        let n = n_strands as usize;
        SkinningModel {
            provenance: 1,
            n_strands,
            n_particles,
            groom_in_head: guide_strands.iter().flat_map(|&s| shape(s)).collect(),
            rest_in_head: (0..n_strands).flat_map(shape).collect(),
            guide_strands,
            eligible_start: (0..=n_strands).collect(),
            eligible: vec![0; n],
            set_start: (0..=n_strands).collect(),
            set_mask: vec![1; n],
            set_rms_error_cm: vec![0.0; n],
            coeff_start: (0..n_strands).collect(),
            coeffs: vec![WeightPoly { quad: 0.0, lin: 0.0, con: 1.0 }.to_bits(); n],
            stand_in_start: (0..=n_strands).collect(),
            stand_in: vec![0; n],
            pairs: Vec::new(),
            position_scale: Vec::new(),
            velocity_scale: Vec::new(),
            velocity_weight: 0.5,
            max_distance: 1.0,
            release_distance: 2.0,
            blend: Blend::Rigid,
            material: adaptive_runtime::record_of(&Material::straight()),
        }
    }

    #[test]
    fn fewer_hairs_are_a_prefix_and_the_guides() {
        let whole = row(100, vec![3, 50, 19, 97]);
        for n in [4, 10, 19, 20, 21, 51, 60, 99] {
            let few = resized(&whole, n, 1).expect("a sound model");
            few.validate().expect("a sound model");
            assert!(few.n_strands as usize <= n && few.n_strands as usize + 4 >= n, "{n}: {}", few.n_strands);
            let kept = few.n_strands as usize - whole.guide_strands.iter().filter(|&&s| s as usize >= n).count();
            for s in 0..kept.saturating_sub(4) {
                assert_eq!(few.rest_of(s), whole.rest_of(s));
            }
            for (a, b) in few.guide_strands.iter().zip(&whole.guide_strands) {
                assert_eq!(few.rest_of(*a as usize), whole.rest_of(*b as usize));
            }
        }
        assert_eq!(resized(&whole, 100, 1).expect("a sound model"), whole);
    }

    #[test]
    fn more_hairs_are_all_of_them_and_copies_beside() {
        let whole = row(10, vec![3, 7]);
        let more = resized(&whole, 34, 1).expect("a sound model");
        more.validate().expect("a sound model");
        assert_eq!((more.n_strands, &more.guide_strands), (34, &whole.guide_strands));
        for s in 0..34 {
            let aside: Vec<f32> = more.rest_of(s).iter().zip(whole.rest_of(s % 10)).map(|(a, b)| a[0] - b[0]).collect();
            assert!(aside.iter().all(|x| (x - aside[0]).abs() < 1e-5 && x.abs() <= 0.0501), "{s}: {aside:?}");
            assert_eq!(aside[0] == 0.0, s < 10, "{s}");
        }
    }

    #[test]
    fn a_power_law_is_found_again() {
        let points: Vec<[f64; 2]> = [50.0, 120.0, 400.0, 1600.0].map(|x: f64| [x, 0.3 * x.powf(1.7)]).to_vec();
        let (exponent, factor) = power_law(&points);
        assert!((exponent - 1.7).abs() < 1e-12 && (factor - 0.3).abs() < 1e-12, "{exponent} {factor}");
    }

    #[test]
    fn a_quantile_is_a_value_that_so_many_do_not_exceed() {
        let values: Vec<f64> = (1..=200).rev().map(f64::from).collect();
        assert_eq!([0.0, 0.5, 0.99, 1.0].map(|q| quantile(&values, q)), [1.0, 100.0, 198.0, 200.0]);
        assert_eq!(quantile(&[], 0.5), 0.0);
    }
}
