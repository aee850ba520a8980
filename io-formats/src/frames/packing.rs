//! Positions of one frame in few bytes: rounded to a stated step, and of each strand what a straight line does not foretell.
//!
//! Coordinates become whole multiples of [`STEP_CM`]. Along a strand the next is foretold by going on as before; what is
//! left is small, is written with as many bits as the strand's largest needs, and comes back exactly. Strands are
//! independent of each other and of other frames. Invariant: unpacking gives each coordinate to half a step, and packing that
//! again gives the same bytes.

/// Coordinates are kept in multiples of this, cm: a quarter of a hundredth of a millimetre.
pub const STEP_CM: f32 = 1.0 / 4096.0;

/// Bytes before the bits of a strand: its first coordinates, the way to its second particle, and three widths.
const STRAND_HEADER: usize = 12 + 12 + 3;

fn rounded(x: f32) -> Option<i32> {
    let steps = (f64::from(x) / f64::from(STEP_CM)).round();
    (steps.abs() < f64::from(1 << 30)).then_some(steps as i32)
}

/// Whole numbers of either sign as those from zero up, small ones first.
fn zigzag(x: i32) -> u32 {
    ((x << 1) ^ (x >> 31)) as u32
}

fn unzigzag(x: u32) -> i32 {
    (x >> 1) as i32 ^ -((x & 1) as i32)
}

/// Adds whole strands of `n` particles. On failure the index of a point that is not finite or too far away: past 2.6 km.
pub(super) fn pack(points: &[[f32; 3]], n: usize, out: &mut Vec<u8>) -> Result<(), usize> {
    let mut left: Vec<u32> = vec![0; n];
    let mut steps: Vec<i32> = vec![0; n];
    for (s, strand) in points.chunks_exact(n).enumerate() {
        let header = out.len();
        out.resize(header + STRAND_HEADER, 0);
        for axis in 0..3 {
            for (i, p) in strand.iter().enumerate() {
                steps[i] = rounded(p[axis]).ok_or(s * n + i)?;
            }
            let way = if n > 1 { steps[1].wrapping_sub(steps[0]) } else { 0 };
            let mut all = 0;
            for i in 2..n {
                let foretold = steps[i - 1].wrapping_mul(2).wrapping_sub(steps[i - 2]);
                left[i] = zigzag(steps[i].wrapping_sub(foretold));
                all |= left[i];
            }
            let width = 32 - all.leading_zeros();
            out[header + 4 * axis..][..4].copy_from_slice(&steps[0].to_le_bytes());
            out[header + 12 + 4 * axis..][..4].copy_from_slice(&way.to_le_bytes());
            out[header + 24 + axis] = width as u8;
            let (mut pending, mut n_pending) = (0_u64, 0);
            for &x in left.iter().skip(2) {
                pending |= u64::from(x) << n_pending;
                n_pending += width;
                while n_pending >= 8 {
                    out.push(pending as u8);
                    pending >>= 8;
                    n_pending -= 8;
                }
            }
            if n_pending > 0 {
                out.push(pending as u8);
            }
        }
    }
    Ok(())
}

/// Reads back what [`pack`] wrote for as many points; none where the bytes are not that.
pub(super) fn unpack(mut bytes: &[u8], n: usize, out: &mut [[f32; 3]]) -> Option<()> {
    for strand in out.chunks_exact_mut(n) {
        let (header, mut rest) = bytes.split_at_checked(STRAND_HEADER)?;
        let number = |at: usize| i32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
        for axis in 0..3 {
            let width = u32::from(header[24 + axis]);
            if width > 32 {
                return None;
            }
            let n_bytes = (n.saturating_sub(2) * width as usize).div_ceil(8);
            let (own, after) = rest.split_at_checked(n_bytes)?;
            rest = after;
            let (mut before, mut way) = (number(4 * axis), number(12 + 4 * axis));
            strand[0][axis] = before as f32 * STEP_CM;
            let (mut pending, mut n_pending) = (0_u64, 0);
            let mut own = own.iter();
            for (i, p) in strand.iter_mut().enumerate().skip(1) {
                if i > 1 {
                    while n_pending < width {
                        pending |= u64::from(*own.next()?) << n_pending;
                        n_pending += 8;
                    }
                    let x = (pending & ((1_u64 << width) - 1)) as u32;
                    pending >>= width;
                    n_pending -= width;
                    way = way.wrapping_add(unzigzag(x));
                }
                before = before.wrapping_add(way);
                p[axis] = before as f32 * STEP_CM;
            }
        }
        bytes = rest;
    }
    bytes.is_empty().then_some(())
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    fn strands(n_strands: usize, n: usize, size: f32, seed: u64) -> Vec<[f32; 3]> {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        (0..n_strands * n).map(|_| [(); 3].map(|()| random.random_range(-size..size))).collect()
    }

    fn there_and_back(points: &[[f32; 3]], n: usize) -> (usize, Vec<[f32; 3]>) {
        let mut bytes = Vec::new();
        pack(points, n, &mut bytes).unwrap();
        let mut out = vec![[f32::NAN; 3]; points.len()];
        unpack(&bytes, n, &mut out).unwrap();
        let mut again = Vec::new();
        pack(&out, n, &mut again).unwrap();
        assert_eq!(again, bytes);
        for cut in 0..bytes.len().min(200) {
            assert!(unpack(&bytes[..cut], n, &mut out.clone()).is_none());
        }
        assert!(unpack(&[&bytes[..], &[0]].concat(), n, &mut out.clone()).is_none());
        (bytes.len(), out)
    }

    #[test]
    fn every_coordinate_comes_back_to_half_a_step() {
        for (n, size) in [(1, 10.0), (2, 10.0), (3, 1e-4), (25, 30.0), (25, 4_000.0), (7, 1e-30)] {
            let points = strands(20, n, size, 1);
            let (_, back) = there_and_back(&points, n);
            for (a, b) in points.as_flattened().iter().zip(back.as_flattened()) {
                assert!((a - b).abs() <= 0.5 * STEP_CM, "{a} came back as {b}");
            }
        }
        // Farther away single precision itself is coarser than half a step.
        let far = strands(5, 10, 2e5, 2);
        let (_, back) = there_and_back(&far, 10);
        assert!(far.as_flattened().iter().zip(back.as_flattened()).all(|(a, b)| (a - b).abs() <= 1.0 / 64.0));
    }

    #[test]
    fn smooth_strands_take_a_third_of_their_bytes_at_most() {
        let points: Vec<[f32; 3]> = (0..1_000)
            .flat_map(|s| {
                let s = s as f32;
                (0..25).map(move |i| {
                    let t = i as f32;
                    [s.sin() + (0.1 * t).sin(), -t, s.cos() + 0.02 * t * t]
                })
            })
            .collect();
        let (bytes, _) = there_and_back(&points, 25);
        assert!(3 * bytes <= 12 * points.len(), "{bytes} bytes for {}", 12 * points.len());
    }

    #[test]
    fn what_has_no_place_is_named() {
        for bad in [f32::NAN, f32::INFINITY, 1e6] {
            let mut points = strands(3, 5, 1.0, 3);
            points[7][1] = bad;
            assert_eq!(pack(&points, 5, &mut Vec::new()), Err(7));
        }
    }
}
