//! How far two pictures are apart.

use crate::error::Error;
use crate::image::Image;

/// Peak signal-to-noise ratio of two pictures, dB: `10 log10(255^2 / e)` with `e` the mean squared difference over all
/// pixels and channels. Infinite for equal pictures. NI20 Table 1 compares rendered hair by it.
///
/// # Errors
/// When the sizes differ.
pub fn psnr(a: &Image, b: &Image) -> Result<f64, Error> {
    if (a.width, a.height) != (b.width, b.height) {
        return Err(Error::SizesDiffer { a: [a.width, a.height], b: [b.width, b.height] });
    }
    for image in [a, b] {
        let expected = 3 * image.width * image.height;
        if image.rgb.len() != expected {
            return Err(Error::Length { what: "a picture", found: image.rgb.len(), expected });
        }
    }
    // Whole numbers: the sum is exact in any order.
    let sum: u64 = a.rgb.iter().zip(&b.rgb).map(|(&x, &y)| u64::from(x.abs_diff(y)).pow(2)).sum();
    let mean = sum as f64 / a.rgb.len().max(1) as f64;
    Ok(if sum == 0 { f64::INFINITY } else { 10.0 * (255.0 * 255.0 / mean).log10() })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One logarithm of a ratio of exact numbers.
    const ROUND_OFF: f64 = 1e-12;

    fn plain(width: usize, height: usize, value: u8) -> Image {
        Image { width, height, rgb: vec![value; 3 * width * height] }
    }

    #[test]
    fn equal_pictures_are_infinitely_alike_and_black_and_white_not_at_all() {
        assert_eq!(psnr(&plain(5, 4, 90), &plain(5, 4, 90)).unwrap(), f64::INFINITY);
        assert_eq!(psnr(&plain(5, 4, 0), &plain(5, 4, 255)).unwrap(), 0.0);
    }

    #[test]
    fn a_difference_of_one_everywhere_is_48_db_and_in_one_of_a_hundred_20_more() {
        let expected = 20.0 * 255f64.log10();
        assert!((psnr(&plain(20, 15, 90), &plain(20, 15, 91)).unwrap() - expected).abs() < ROUND_OFF);
        let mut few = plain(20, 15, 90);
        few.rgb.iter_mut().step_by(100).for_each(|c| *c -= 1);
        assert!((psnr(&plain(20, 15, 90), &few).unwrap() - expected - 20.0).abs() < ROUND_OFF);
    }

    #[test]
    fn the_order_of_two_pictures_does_not_matter_and_their_sizes_must_agree() {
        let (a, mut b) = (plain(6, 6, 10), plain(6, 6, 250));
        b.rgb[7] = 3;
        assert_eq!(psnr(&a, &b).unwrap(), psnr(&b, &a).unwrap());
        assert!(matches!(psnr(&plain(6, 5, 0), &a), Err(Error::SizesDiffer { a: [6, 5], b: [6, 6] })));
        b.rgb.pop();
        assert!(matches!(psnr(&a, &b), Err(Error::Length { found: 107, expected: 108, .. })));
    }
}
