//! Laws of the parts of a correction.

use super::*;

const PAD: usize = 32;
const N: usize = 25;

/// Three arrays of `PAD` values of strands a centimetre a segment, bent by `bend`.
fn strand(bend: f32) -> Vec<f32> {
    let mut x = vec![0.0; 3 * PAD];
    for i in 1..PAD {
        let angle = bend * i as f32;
        let step = [angle.sin(), -angle.cos(), 0.0];
        for c in 0..3 {
            x[c * PAD + i] = x[c * PAD + i - 1] + step[c];
        }
    }
    x
}

fn lengths(x: &[f32]) -> Vec<f32> {
    let at = |i: usize| Vector3::from(particle(x, PAD, i));
    (N_FIXED..N).map(|i| (at(i) - at(i - 1)).norm()).collect()
}

#[test]
fn lengths_are_kept_and_that_gives_no_velocity() {
    /// Lengths and differences of positions of up to 25 cm in single precision.
    const ROUND_OFF_CM: f32 = 2e-5;
    let (skin, mut x) = (strand(0.02), strand(-0.05));
    // Stretched as free flight and pushes leave it.
    for (k, v) in x.iter_mut().enumerate() {
        *v *= 1.0 + 0.05 * ((k % 5) as f32);
    }
    let mut offset: Vec<f32> = (0..3 * PAD).map(|k| 0.1 * (k as f32).sin()).collect();
    let moved: Vec<f32> = x.iter().zip(&offset).map(|(x, d)| x - d).collect();
    assert!(lengths(&x).iter().any(|l| (l - 1.0).abs() > 0.1));
    keep_lengths(&skin, &skin, &mut x, &mut offset, PAD, N);
    for (now, wanted) in lengths(&x).iter().zip(lengths(&skin)) {
        assert!((now - wanted).abs() < ROUND_OFF_CM, "{now} {wanted}");
    }
    for ((x, d), before) in x.iter().zip(&offset).zip(&moved) {
        assert!(
            (x - d - before).abs() < ROUND_OFF_CM,
            "velocity is what the strand has moved from its offset at the start"
        );
    }
}
