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

/// Scalar product of two vectors.
#[inline(always)]
pub(crate) fn dot(a: &Lane3, b: &Lane3) -> Lane {
    mul_add(&a[0], &b[0], &mul_add(&a[1], &b[1], &mul(&a[2], &b[2])))
}
