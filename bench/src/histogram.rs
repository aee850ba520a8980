//! Quantiles of a stream of sizes in fixed memory: bins of equal ratio.

/// Least size told apart from zero.
const LEAST: f32 = 1e-7;
/// Bins per factor of two.
const PER_OCTAVE: usize = 16;
const OCTAVES: usize = 40;

/// Counts of sizes in bins four per cent wide.
#[derive(Clone, Debug)]
pub struct Histogram {
    counts: Vec<u64>,
    n: u64,
    sum: f64,
    max: f32,
}

impl Default for Histogram {
    fn default() -> Self {
        Self::new()
    }
}

impl Histogram {
    /// An empty one.
    #[must_use]
    pub fn new() -> Self {
        Self { counts: vec![0; PER_OCTAVE * OCTAVES + 1], n: 0, sum: 0.0, max: 0.0 }
    }

    /// Adds a size; one that is not finite is left out.
    pub fn add(&mut self, size: f32) {
        if !size.is_finite() {
            return;
        }
        let bin = if size <= LEAST { 0 } else { ((size / LEAST).log2() * PER_OCTAVE as f32) as usize + 1 };
        let last = self.counts.len() - 1;
        self.counts[bin.min(last)] += 1;
        self.n += 1;
        self.sum += f64::from(size);
        self.max = self.max.max(size);
    }

    /// The size below which a share `q` of all lie, to four per cent; zero when empty.
    #[must_use]
    pub fn quantile(&self, q: f64) -> f64 {
        let wanted = (q * self.n as f64).ceil() as u64;
        let mut seen = 0;
        for (bin, &count) in self.counts.iter().enumerate() {
            seen += count;
            if seen >= wanted && seen > 0 {
                return if bin == 0 { 0.0 } else { f64::from(LEAST) * ((bin as f64 - 0.5) / PER_OCTAVE as f64).exp2() };
            }
        }
        f64::from(self.max)
    }

    /// Mean of all sizes; zero when empty.
    #[must_use]
    pub fn mean(&self) -> f64 {
        if self.n == 0 { 0.0 } else { self.sum / self.n as f64 }
    }

    /// Largest size.
    #[must_use]
    pub fn max(&self) -> f64 {
        f64::from(self.max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_within_a_bin() {
        let mut histogram = Histogram::new();
        (1..=1000).for_each(|k| histogram.add(k as f32 * 1e-3));
        for q in [0.1, 0.5, 0.99] {
            assert!((histogram.quantile(q) / q - 1.0).abs() < 0.045);
        }
        assert!((histogram.mean() - 0.5005).abs() < 1e-4);
    }
}
