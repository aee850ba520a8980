//! Eight numbers at a time, as plain arrays that the compiler turns into vector instructions.
//!
//! Every operation is that of one number, lane by lane, in the order written: results are the same bits for any vector
//! width and for one number alone.

use std::ops::{Add, Mul, Sub};

/// Numbers side by side.
pub(crate) const LANES: usize = 8;

/// Eight numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(32))]
pub(crate) struct F8(pub [f32; LANES]);

impl F8 {
    pub const ZERO: Self = Self([0.0; LANES]);

    #[inline(always)]
    pub fn splat(x: f32) -> Self {
        Self([x; LANES])
    }

    #[inline(always)]
    pub fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = self;
        for l in 0..LANES {
            out.0[l] = f(self.0[l], other.0[l]);
        }
        out
    }

    /// The lesser of two; the second where either is not a number.
    #[inline(always)]
    pub fn least(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }

    /// The greater of two; the second where either is not a number.
    #[inline(always)]
    pub fn greatest(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    /// Within 0 and 1; not a number becomes zero.
    #[inline(always)]
    pub fn clamp01(self) -> Self {
        self.greatest(Self::ZERO).least(Self::splat(1.0))
    }

    /// Lanes less than another's, lane 0 in the lowest bit.
    #[inline(always)]
    pub fn less(self, other: Self) -> u8 {
        let mut mask = 0;
        for l in 0..LANES {
            mask |= u8::from(self.0[l] < other.0[l]) << l;
        }
        mask
    }

    /// The least of all lanes.
    #[cfg(test)]
    pub fn least_lane(self) -> f32 {
        let v = self.0;
        let least = |a: f32, b: f32| if a < b { a } else { b };
        let four = [least(v[0], v[4]), least(v[1], v[5]), least(v[2], v[6]), least(v[3], v[7])];
        least(least(four[0], four[2]), least(four[1], four[3]))
    }
}

impl Add for F8 {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl Sub for F8 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}

impl Mul for F8 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

/// Sum of three products.
#[inline(always)]
pub(crate) fn dot(a: [F8; 3], b: [F8; 3]) -> F8 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
