//! The skinning model: all that passes from training to the runtime (AS16 §6), one set of arrays in CSR form.
//!
//! Per strand: its eligible guides, the guide sets kept by training with their weight polynomials, and for each of the
//! other combinations the kept set that stands in for it, always a subset so that a blocked guide cannot come back.
//! Its bytes are laid out in docs/MODEL_FORMAT.md. [`SkinningModel::validate`] checks every invariant a reader relies on; a model that passes cannot make one panic.

mod file;
mod pick;

use std::path::Path;

use half::f16;
use half::slice::{HalfBitsSliceExt, HalfFloatSliceExt};
use serde::{Deserialize, Serialize};

use crate::envelope::{self, Kind};
use crate::error::{Error, Result};
use crate::guide_transform::Blend;

/// Version of the model file.
pub const VERSION: u32 = 2;

/// Most eligible guides of a strand; masks and stand-in tables are sized by it.
pub const MAX_ELIGIBLE: usize = 9;

/// How far the weights of a set may sum from one, at three places along the strand; beyond it the file is not a fit.
const MAX_WEIGHT_SUM_ERROR: f32 = 0.25;

/// Trained weights and everything the runtime needs beside the scene.
#[derive(Clone, PartialEq, Debug)]
pub struct SkinningModel {
    /// Hash of the inputs and parameters the model was trained from.
    pub provenance: u64,
    /// Number of strands.
    pub n_strands: u32,
    /// Particles per strand.
    pub n_particles: u32,
    /// `n_guides * n_particles * 3` coordinates (cm): the styled shape the guides' springs are built from.
    pub groom_in_head: Vec<f32>,
    /// `n_strands * n_particles * 3` coordinates (cm), strand-major, root first: the rest state s* of AS16.
    pub rest_in_head: Vec<f32>,
    /// Strand of each guide; all distinct.
    pub guide_strands: Vec<u32>,
    /// `n_strands + 1` offsets into `eligible`.
    pub eligible_start: Vec<u32>,
    /// Guide ids, ascending within a strand, 1 to [`MAX_ELIGIBLE`] each.
    pub eligible: Vec<u16>,
    /// `n_strands + 1` offsets into `set_mask`, `set_rms_error_cm` and `coeff_start`.
    pub set_start: Vec<u32>,
    /// Kept sets, ascending within a strand; bit b stands for the strand's b-th eligible guide.
    pub set_mask: Vec<u16>,
    /// Root mean square training error of each kept set (cm).
    pub set_rms_error_cm: Vec<f32>,
    /// For each kept set, where its triples begin in `coeffs`; it has as many as its mask has bits, set after set.
    pub coeff_start: Vec<u32>,
    /// Per guide of a set, in bit order: half-precision bits of quad, lin, con in u = i / (n_particles - 1).
    pub coeffs: Vec<[u16; 3]>,
    /// `n_strands + 1` offsets into `stand_in`; a strand with k eligible guides has 2^k - 1 entries.
    pub stand_in_start: Vec<u32>,
    /// For mask m, at entry m - 1: index within the strand of the kept set that stands in, a subset of m.
    pub stand_in: Vec<u16>,
    /// Guide pairs i < j that are eligible together for some strand, sorted.
    pub pairs: Vec<[u16; 2]>,
    /// A_ij of AS16 §7.1 for each pair.
    pub position_scale: Vec<f32>,
    /// B_ij of AS16 §7.1 for each pair.
    pub velocity_scale: Vec<f32>,
    /// sigma of AS16 Eq. (2).
    pub velocity_weight: f32,
    /// delta of AS16 Eq. (2), calibrated: an edge appears below it.
    pub max_distance: f32,
    /// An edge disappears above it; at least `max_distance`.
    pub release_distance: f32,
    /// How guides move hairs: what the weights were trained for.
    pub blend: Blend,
    /// Material of the guides.
    pub material: MaterialRecord,
}

/// Material of a strand: spring constants in dyn as in AS16 Table 1.
#[derive(Serialize, Deserialize, Clone, Copy, PartialEq, Debug)]
pub struct MaterialRecord {
    /// Stretch spring constant, dyn.
    pub stretch_dyn: f64,
    /// Bend spring constant, dyn.
    pub bend: f64,
    /// Torsion and altitude spring constant, dyn.
    pub twist: f64,
    /// Damping of stretch springs, dyn s.
    pub stretch_damping: f64,
    /// Damping of bend springs, dyn s.
    pub bend_damping: f64,
    /// Damping of torsion and altitude springs, dyn s.
    pub twist_damping: f64,
    /// Coulomb friction between hair and solids.
    pub friction: f64,
    /// Mass per length, g/cm.
    pub linear_density_g_per_cm: f64,
    /// Drag of air on velocity, 1/s.
    pub air_drag_per_s: f64,
}

impl MaterialRecord {
    /// All constants, in the order of the fields.
    pub(crate) fn constants(&self) -> [f64; 9] {
        let m = self;
        [
            m.stretch_dyn,
            m.bend,
            m.twist,
            m.stretch_damping,
            m.bend_damping,
            m.twist_damping,
            m.friction,
            m.linear_density_g_per_cm,
            m.air_drag_per_s,
        ]
    }
}

/// Weight of one guide along a strand: quad u² + lin u + con.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct WeightPoly {
    /// Coefficient of u².
    pub quad: f32,
    /// Coefficient of u.
    pub lin: f32,
    /// Value at the root.
    pub con: f32,
}

impl WeightPoly {
    /// From half-precision bits of quad, lin, con.
    #[must_use]
    pub fn from_bits(bits: [u16; 3]) -> Self {
        let [quad, lin, con] = bits.map(|b| f16::from_bits(b).to_f32());
        Self { quad, lin, con }
    }

    /// Half-precision bits of quad, lin, con, rounded to nearest.
    #[must_use]
    pub fn to_bits(self) -> [u16; 3] {
        [self.quad, self.lin, self.con].map(|x| f16::from_f32(x).to_bits())
    }

    /// The weight at `u` in 0 (root) to 1 (tip).
    #[must_use]
    pub fn at(self, u: f32) -> f32 {
        (self.quad * u + self.lin) * u + self.con
    }
}

/// The kept sets of one strand.
#[derive(Clone, Copy, Debug)]
pub struct StrandSets<'a> {
    /// Masks, ascending; bit b stands for the strand's b-th eligible guide.
    pub masks: &'a [u16],
    /// Training error of each set (cm).
    pub rms_error_cm: &'a [f32],
    /// Where each set's triples begin in `coeffs`.
    pub coeff_start: &'a [u32],
    /// For mask m at entry m - 1: index into `masks` of the set that stands in.
    pub stand_in: &'a [u16],
}

impl SkinningModel {
    /// Number of guides.
    #[must_use]
    pub fn n_guides(&self) -> usize {
        self.guide_strands.len()
    }

    /// Eligible guide ids of a strand, ascending.
    ///
    /// # Panics
    /// If there is no such strand.
    #[must_use]
    pub fn eligible_of(&self, strand: usize) -> &[u16] {
        &self.eligible[csr(&self.eligible_start, strand)]
    }

    /// Kept sets of a strand.
    ///
    /// # Panics
    /// If there is no such strand.
    #[must_use]
    pub fn sets_of(&self, strand: usize) -> StrandSets<'_> {
        let sets = csr(&self.set_start, strand);
        StrandSets {
            masks: &self.set_mask[sets.clone()],
            rms_error_cm: &self.set_rms_error_cm[sets.clone()],
            coeff_start: &self.coeff_start[sets],
            stand_in: &self.stand_in[csr(&self.stand_in_start, strand)],
        }
    }

    /// Weight polynomials of a set, numbered over the whole model, in the bit order of its mask.
    ///
    /// # Panics
    /// If there is no such set.
    pub fn weights_of_set(&self, set: usize) -> impl ExactSizeIterator<Item = WeightPoly> + '_ {
        let start = self.coeff_start[set] as usize;
        let n = self.set_mask[set].count_ones() as usize;
        self.coeffs[start..start + n].iter().map(|&bits| WeightPoly::from_bits(bits))
    }

    /// Rest positions (cm) of a strand as `n_particles` triples of coordinates.
    ///
    /// # Panics
    /// If there is no such strand.
    #[must_use]
    pub fn rest_of(&self, strand: usize) -> &[[f32; 3]] {
        let n = self.n_particles as usize * 3;
        bytemuck::cast_slice(&self.rest_in_head[strand * n..(strand + 1) * n])
    }

    /// Writes the model, after validating it.
    ///
    /// # Errors
    /// When an invariant is broken or the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<()> {
        self.validate()?;
        envelope::write(path, Kind::SKINNING_MODEL, VERSION, &file::to_bytes(self))
    }

    /// Reads a model and validates it.
    ///
    /// # Errors
    /// When the file is not a whole, undamaged model of this version, or an invariant is broken.
    pub fn load(path: &Path) -> Result<Self> {
        let model = file::read(path)?;
        model.validate()?;
        Ok(model)
    }

    /// Checks every invariant a reader relies on.
    ///
    /// # Errors
    /// Names the field and the first place where it is broken.
    pub fn validate(&self) -> Result<()> {
        self.check_shapes()?;
        self.check_strands()?;
        self.check_pairs()?;
        self.check_numbers()
    }

    fn check_shapes(&self) -> Result<()> {
        let (n_strands, n_particles) = (u64::from(self.n_strands), u64::from(self.n_particles));
        if n_strands == 0 || n_particles < 2 {
            return Err(bad("n_strands", format!("{n_strands} strands of {n_particles} particles")));
        }
        let n_guides = self.guide_strands.len() as u64;
        if n_guides == 0 || n_guides > u64::from(u16::MAX) {
            return Err(bad("guide_strands", format!("{n_guides} guides, 1 to 65535 are possible")));
        }
        // Saturating: a product beyond u64 cannot equal a real length.
        let coords = |n: u64| n.saturating_mul(n_particles).saturating_mul(3);
        check_len("groom_in_head", self.groom_in_head.len(), coords(n_guides))?;
        check_len("rest_in_head", self.rest_in_head.len(), coords(n_strands))?;
        check_csr("eligible_start", &self.eligible_start, n_strands, self.eligible.len())?;
        check_csr("set_start", &self.set_start, n_strands, self.set_mask.len())?;
        check_csr("stand_in_start", &self.stand_in_start, n_strands, self.stand_in.len())?;
        check_len("set_rms_error_cm", self.set_rms_error_cm.len(), self.set_mask.len() as u64)?;
        check_len("coeff_start", self.coeff_start.len(), self.set_mask.len() as u64)?;
        check_len("position_scale", self.position_scale.len(), self.pairs.len() as u64)?;
        check_len("velocity_scale", self.velocity_scale.len(), self.pairs.len() as u64)?;
        let mut guides = self.guide_strands.clone();
        guides.sort_unstable();
        if let Some(w) = guides.windows(2).find(|w| w[0] == w[1]) {
            return Err(bad("guide_strands", format!("strand {} is named twice", w[0])));
        }
        match guides.last() {
            Some(&last) if u64::from(last) >= n_strands => {
                Err(bad("guide_strands", format!("strand {last} of {n_strands}")))
            }
            _ => Ok(()),
        }
    }

    fn check_strands(&self) -> Result<()> {
        let n_guides = self.n_guides();
        for strand in 0..self.n_strands as usize {
            let eligible = self.eligible_of(strand);
            let k = eligible.len();
            if !(1..=MAX_ELIGIBLE).contains(&k) {
                return Err(bad(
                    "eligible",
                    format!("strand {strand} has {k} eligible guides, 1 to {MAX_ELIGIBLE} are possible"),
                ));
            }
            if !ascending(eligible) || usize::from(eligible[k - 1]) >= n_guides {
                let why = format!("strand {strand}: {eligible:?} is not ascending, or names a guide past {n_guides}");
                return Err(bad("eligible", why));
            }
            let sets = self.sets_of(strand);
            let full = (1_u16 << k) - 1;
            if sets.masks.is_empty() || !ascending(sets.masks) {
                return Err(bad("set_mask", format!("strand {strand}: masks are missing or not ascending")));
            }
            if sets.masks[0] == 0 || sets.masks[sets.masks.len() - 1] > full {
                return Err(bad("set_mask", format!("strand {strand}: a mask is not within 1 to {full}")));
            }
            if sets.stand_in.len() != usize::from(full) {
                let why = format!("strand {strand}: {} entries, {k} guides need {full}", sets.stand_in.len());
                return Err(bad("stand_in", why));
            }
            for (entry, &set) in sets.stand_in.iter().enumerate() {
                let mask = entry as u16 + 1;
                match sets.masks.get(usize::from(set)) {
                    Some(&kept) if kept & !mask == 0 => {}
                    Some(&kept) => {
                        let why = format!("strand {strand}: {kept:#b} stands in for {mask:#b} but is no subset");
                        return Err(bad("stand_in", why));
                    }
                    None => {
                        let why = format!("strand {strand}: set {set} of {}", sets.masks.len());
                        return Err(bad("stand_in", why));
                    }
                }
            }
        }
        let mut begin = 0;
        for (set, (&start, &mask)) in self.coeff_start.iter().zip(&self.set_mask).enumerate() {
            let end = begin + u64::from(mask.count_ones());
            if u64::from(start) != begin || end > self.coeffs.len() as u64 {
                let why = format!("set {set} has triples {start} to {end} of {}, set after set", self.coeffs.len());
                return Err(bad("coeff_start", why));
            }
            begin = end;
        }
        if begin != self.coeffs.len() as u64 {
            return Err(bad("coeffs", format!("has {} triples, the sets' masks have {begin} bits", self.coeffs.len())));
        }
        self.check_weights()
    }

    /// Weights of a set sum to one; by linearity their sum is the weight of the summed coefficients.
    fn check_weights(&self) -> Result<()> {
        const AT_ONCE: usize = 256;
        let mut wide = Vec::new();
        for first in (0..self.set_mask.len()).step_by(AT_ONCE) {
            let masks = &self.set_mask[first..(first + AT_ONCE).min(self.set_mask.len())];
            let n: u32 = masks.iter().map(|m| m.count_ones()).sum();
            let begin = self.coeff_start[first] as usize;
            let bits: &[u16] = bytemuck::cast_slice(&self.coeffs[begin..begin + n as usize]);
            wide.resize(bits.len(), 0.0);
            // Many at once, since one by one each would ask what the processor can do.
            bits.reinterpret_cast::<f16>().convert_to_f32_slice(&mut wide);
            let mut triples = wide.chunks_exact(3);
            for (at, mask) in masks.iter().enumerate() {
                let mut total = WeightPoly { quad: 0.0, lin: 0.0, con: 0.0 };
                for w in triples.by_ref().take(mask.count_ones() as usize) {
                    total = WeightPoly { quad: total.quad + w[0], lin: total.lin + w[1], con: total.con + w[2] };
                }
                // A sum that is finite at three places has nothing in it that is not.
                for u in [0.0, 0.5, 1.0] {
                    let sum = total.at(u);
                    if !sum.is_finite() || (sum - 1.0).abs() > MAX_WEIGHT_SUM_ERROR {
                        let set = first + at;
                        return Err(bad("coeffs", format!("weights of set {set} sum to {sum} at u = {u}, not to one")));
                    }
                }
            }
        }
        Ok(())
    }

    fn check_pairs(&self) -> Result<()> {
        if let Some(i) = self.pairs.iter().position(|p| p[0] >= p[1] || usize::from(p[1]) >= self.n_guides()) {
            return Err(bad("pairs", format!("pair {i} is {:?} with {} guides", self.pairs[i], self.n_guides())));
        }
        if let Some(i) = self.pairs.windows(2).position(|w| w[0] >= w[1]) {
            return Err(bad("pairs", format!("pairs {i} and {} are out of order or equal", i + 1)));
        }
        Ok(())
    }

    fn check_numbers(&self) -> Result<()> {
        check_each("groom_in_head", &self.groom_in_head, "finite", f32::is_finite)?;
        check_each("rest_in_head", &self.rest_in_head, "finite", f32::is_finite)?;
        check_each("set_rms_error_cm", &self.set_rms_error_cm, "finite and not negative", |x| {
            x.is_finite() && x >= 0.0
        })?;
        check_each("position_scale", &self.position_scale, "finite and not negative", |x| x.is_finite() && x >= 0.0)?;
        check_each("velocity_scale", &self.velocity_scale, "finite and not negative", |x| x.is_finite() && x >= 0.0)?;
        let distances = [self.velocity_weight, self.max_distance, self.release_distance];
        check_each("velocity_weight, max_distance, release_distance", &distances, "finite and not negative", |x| {
            x.is_finite() && x >= 0.0
        })?;
        if self.release_distance < self.max_distance {
            let why = format!("{} is below max_distance {}", self.release_distance, self.max_distance);
            return Err(bad("release_distance", why));
        }
        let m = &self.material;
        if m.constants().iter().any(|x| !x.is_finite() || *x < 0.0) || m.linear_density_g_per_cm <= 0.0 {
            return Err(bad("material", format!("{m:?} holds a negative or non-finite constant, or no mass")));
        }
        Ok(())
    }
}

fn csr(start: &[u32], row: usize) -> std::ops::Range<usize> {
    start[row] as usize..start[row + 1] as usize
}

fn bad(field: &'static str, reason: String) -> Error {
    Error::BadModel { field, reason }
}

fn ascending<T: PartialOrd>(values: &[T]) -> bool {
    values.windows(2).all(|w| w[0] < w[1])
}

fn check_len(field: &'static str, actual: usize, expected: u64) -> Result<()> {
    if actual as u64 == expected {
        Ok(())
    } else {
        Err(bad(field, format!("has {actual} entries, {expected} are needed")))
    }
}

fn check_csr(field: &'static str, start: &[u32], n_rows: u64, n_entries: usize) -> Result<()> {
    check_len(field, start.len(), n_rows.saturating_add(1))?;
    let whole = start.first() == Some(&0) && start.last().is_some_and(|&e| e as usize == n_entries);
    if !whole || start.windows(2).any(|w| w[0] > w[1]) {
        return Err(bad(field, format!("offsets do not rise from 0 to {n_entries}")));
    }
    Ok(())
}

fn check_each(field: &'static str, values: &[f32], law: &str, holds: impl Fn(f32) -> bool) -> Result<()> {
    match values.iter().position(|&x| !holds(x)) {
        Some(i) => Err(bad(field, format!("entry {i} is {}, not {law}", values[i]))),
        None => Ok(()),
    }
}
