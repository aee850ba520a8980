//! Eight strands side by side: the unit every solve works in.
//!
//! A scalar of the algorithm is an array over strands of equal topology, so plain loops over it become vector
//! instructions. Inside the solve `mul_add` is used throughout: exactly rounded, hence the same bits on every machine.
//! Outside it is avoided, since without the machine's own instruction it becomes a function call.

/// Strands solved together.
pub const LANES: usize = 8;

/// One scalar for each strand of a batch.
pub type Lane = [f64; LANES];

/// A vector for each strand of a batch: x, y, z.
pub type Lane3 = [Lane; 3];

/// A lane of zeros.
pub const ZERO: Lane = [0.0; LANES];

macro_rules! lanewise {
    ($(#[$doc:meta])* $name:ident($($x:ident),+) = $value:expr) => {
        $(#[$doc])*
        #[inline(always)]
        pub(crate) fn $name($($x: &Lane),+) -> Lane {
            let mut out = ZERO;
            for l in 0..LANES {
                $(let $x = $x[l];)+
                out[l] = $value;
            }
            out
        }
    };
}

// Whole lanes as values: the compiler turns each into one or two vector instructions, where a loop that indexes several
// nested arrays in place may stay scalar.
lanewise!(
    /// a + b
    add(a, b) = a + b
);
lanewise!(
    /// a - b
    sub(a, b) = a - b
);
lanewise!(
    /// a b
    mul(a, b) = a * b
);
lanewise!(
    /// a b + c, rounded once.
    mul_add(a, b, c) = a.mul_add(b, c)
);
lanewise!(
    /// a b - c, rounded once.
    mul_sub(a, b, c) = a.mul_add(b, -c)
);
lanewise!(
    /// c - a b, rounded once.
    neg_mul_add(a, b, c) = (-a).mul_add(b, c)
);

/// Least number that [`inv_sqrt`] takes the root of: what is smaller counts as this.
const LEAST_SQUARE: f64 = 1e-36;

/// 1/√x to within a few roundings, of a positive number up to 1e38; of what is larger or not a number, not a number or zero.
///
/// A root and a quotient in double precision keep the divider busy for longer than all else that a spring asks for: here
/// both are taken in single precision, exactly rounded like all the rest, and one step of third order makes up for it.
#[inline(always)]
pub(crate) fn inv_sqrt(x: &Lane) -> Lane {
    let mut out = ZERO;
    for l in 0..LANES {
        out[l] = inv_sqrt_of(x[l]);
    }
    out
}

/// [`inv_sqrt`] of one lane.
#[inline(always)]
pub(crate) fn inv_sqrt_of(x: f64) -> f64 {
    let x = x.max(LEAST_SQUARE);
    let seed = f64::from(1.0 / (x as f32).sqrt());
    // x seed² = 1 - e, and (1 - e)^(-1/2) = 1 + e/2 + 3e²/8 + ...; e is some 1e-7.
    let e = (-(x * seed)).mul_add(seed, 1.0);
    (seed * e).mul_add(0.375_f64.mul_add(e, 0.5), seed)
}

/// Scalar product of two vectors.
#[inline(always)]
pub(crate) fn dot(a: &Lane3, b: &Lane3) -> Lane {
    mul_add(&a[0], &b[0], &mul_add(&a[1], &b[1], &mul(&a[2], &b[2])))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Roundings that the reciprocal root may be off by: those of its seed's correction.
    const FEW_ROUNDINGS: f64 = 4.0 * f64::EPSILON;

    #[test]
    fn the_reciprocal_root_is_right_to_a_few_roundings_over_its_range() {
        let mut seed = 3_u64;
        for _ in 0..100_000 {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let share = (seed >> 11) as f64 / (1_u64 << 53) as f64;
            let x = 10_f64.powf(share.mul_add(73.0, -35.0));
            let (found, expected) = (inv_sqrt_of(x), 1.0 / x.sqrt());
            assert!((found / expected - 1.0).abs() <= FEW_ROUNDINGS, "{x}: {found}, not {expected}");
        }
        assert!(inv_sqrt_of(0.0).is_finite());
    }
}
