//! The matrix of AS16 Eq. (4), Σ ω w wᵀ over all hairs, kept from step to step.
//!
//! Weights are quadratic along a hair, so their products are smooth: the matrix is kept at [`KNOTS`] places from root to
//! tip. It changes only for hairs that change set or come into or out of contact. Sums are integers, so the matrix depends
//! on which hairs it holds and not on the order in which they came and went. Hairs in contact are summed a second time by
//! themselves, so that the weight of an idle row enters only where the matrix is read.

use crate::interpolate::ActiveSet;
use io_formats::skinning_model::MAX_ELIGIBLE;
use multiversion::multiversion;

/// Places along a strand where the matrix is kept, root and tip included.
pub(crate) const KNOTS: usize = 8;

/// Floats from here to twice it are spaced by one: added to it, a number is rounded into the mantissa's low bits.
const ROUNDER: f32 = 8_388_608.0;

/// Finest unit of the sums, as a power of one half: what the mantissa's half below [`ROUNDER`] holds.
const MOST_BITS: u32 = 22;

/// A sum over all hairs and one over those in contact, of one pair of guides; one cache line.
pub(crate) type Entry = [[i32; KNOTS]; 2];

/// Which sums a hair enters or leaves: plus or minus one, or zero for a sum that stays.
pub(crate) type Signs = [i32; 2];

#[derive(Debug)]
pub(crate) struct NormalMatrix {
    index: Index,
    /// What sums are multiples of.
    unit: f32,
    /// Guides' diagonals, then the model's pairs.
    entries: Vec<Entry>,
}

/// Where the entry of a pair of guides is.
#[derive(Debug)]
struct Index {
    n_guides: usize,
    /// `n_guides + 1` offsets into `column`: guides above a row's own that share a hair with it, ascending.
    start: Vec<u32>,
    column: Vec<u16>,
    /// Whether a guide is in a row's list, `words` of 64 bits a row, and how many pairs are before each word.
    bits: Vec<u64>,
    before: Vec<u32>,
    words: usize,
}

impl NormalMatrix {
    /// A matrix of zeros. `pairs` are the pairs i < j of guides that may occur together, sorted; `n_strands` bounds the sums.
    pub(crate) fn new(n_guides: usize, pairs: &[[u16; 2]], n_strands: usize) -> Self {
        // The largest sum is that of a guide which all hairs follow alone: one a hair.
        let bits = (i32::MAX as u32 / (n_strands.max(1) as u32)).max(1).ilog2().min(MOST_BITS);
        Self {
            index: Index::new(n_guides, pairs),
            unit: (-f64::from(bits)).exp2() as f32,
            entries: vec![Entry::default(); n_guides + pairs.len()],
        }
    }

    /// Takes a hair into sums and out of others.
    pub(crate) fn add(&mut self, set: &ActiveSet, signs: Signs) {
        accumulate(&self.index, set, 1.0 / self.unit, signs, &mut self.entries);
    }

    /// Guides above `row` that may share a hair with it, each with its entry.
    pub(crate) fn above(&self, row: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        let of = self.index.start[row] as usize..self.index.start[row + 1] as usize;
        let n_guides = self.index.n_guides;
        self.index.column[of.clone()].iter().zip(of).map(move |(&c, k)| (usize::from(c), n_guides + k))
    }

    /// One entry at all knots, rows of hairs out of contact weighed by `idle`. A guide's diagonal is its own entry.
    #[inline(always)]
    pub(crate) fn entry(&self, entry: usize, idle: f32) -> [f32; KNOTS] {
        let [all, contact] = &self.entries[entry];
        let (of_all, of_contact) = (idle * self.unit, (1.0 - idle) * self.unit);
        std::array::from_fn(|k| of_all * all[k] as f32 + of_contact * contact[k] as f32)
    }

    #[cfg(test)]
    pub(crate) fn entries(&self) -> &[Entry] {
        &self.entries
    }
}

impl Index {
    fn new(n_guides: usize, pairs: &[[u16; 2]]) -> Self {
        let words = n_guides.div_ceil(64);
        let mut start = vec![0; n_guides + 1];
        let mut bits = vec![0_u64; n_guides * words];
        for &[i, j] in pairs {
            start[usize::from(i) + 1] += 1;
            bits[usize::from(i) * words + usize::from(j) / 64] |= 1 << (j % 64);
        }
        for row in 0..n_guides {
            start[row + 1] += start[row];
        }
        let mut before = vec![0; n_guides * words];
        for row in 0..n_guides {
            let mut count = start[row];
            for word in row * words..(row + 1) * words {
                before[word] = count;
                count += bits[word].count_ones();
            }
        }
        Self { n_guides, start, column: pairs.iter().map(|p| p[1]).collect(), bits, before, words }
    }

    /// Entry of a pair, `low` below `high`: its rank among the pairs.
    #[inline(always)]
    fn entry_of(&self, low: u16, high: u16) -> usize {
        let word = usize::from(low) * self.words + usize::from(high) / 64;
        debug_assert!(self.bits[word] >> (high % 64) & 1 == 1, "guides {low} and {high} are no pair");
        let within = (self.bits[word] & ((1 << (high % 64)) - 1)).count_ones();
        self.n_guides + (self.before[word] + within) as usize
    }
}

/// Adds `signs` times a hair's products of weights, in units, at all knots.
#[multiversion(targets("x86_64+avx2+fma+popcnt", "aarch64+neon"))]
fn accumulate(index: &Index, set: &ActiveSet, per_unit: f32, signs: Signs, entries: &mut [Entry]) {
    let weights = weights_at_knots(set);
    let guides = &set.guides[..usize::from(set.n)];
    for (a, &low) in guides.iter().enumerate() {
        let scaled = weights[a].map(|w| w * per_unit);
        for (b, &high) in guides.iter().enumerate().skip(a) {
            let entry = &mut entries[if a == b { usize::from(low) } else { index.entry_of(low, high) }];
            for k in 0..KNOTS {
                // Weights are at most one, so the sum stays between 2^23 and 2^24, where bits count units.
                let units = (scaled[k] * weights[b][k] + ROUNDER).to_bits().wrapping_sub(ROUNDER.to_bits()) as i32;
                entry[0][k] += signs[0] * units;
                entry[1][k] += signs[1] * units;
            }
        }
    }
}

/// Weights of a set at every knot, clamped at zero and normalised as in [`ActiveSet::weights_at`].
#[inline(always)]
fn weights_at_knots(set: &ActiveSet) -> [[f32; KNOTS]; MAX_ELIGIBLE] {
    let mut weights = [[0.0; KNOTS]; MAX_ELIGIBLE];
    let mut sum = [0.0; KNOTS];
    let n = usize::from(set.n);
    for b in 0..n {
        let poly = set.weights[b];
        for k in 0..KNOTS {
            let u = k as f32 / (KNOTS - 1) as f32;
            weights[b][k] = ((poly.quad * u + poly.lin) * u + poly.con).max(0.0);
            sum[k] += weights[b][k];
        }
    }
    for w in &mut weights[..n] {
        for k in 0..KNOTS {
            w[k] = if sum[k] > 0.0 { (w[k] / sum[k]).min(1.0) } else { 1.0 / n as f32 };
        }
    }
    weights
}
