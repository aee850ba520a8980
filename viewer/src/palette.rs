//! Small files: a picture in the few colours that tell it best, as PNG with a palette.
//!
//! Hair is a noise of a few hues, which PNG keeps badly in full colour; in a palette the same picture takes a fraction of that. The palette halves, again and again, the box of colours that spreads farthest (median cut, Heckbert 1982).

use crate::error::Error;
use crate::image::Image;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::Path;

/// Bits of each channel that colours are told apart by.
const BITS: u32 = 6;

/// A range of colours with how often each occurs.
struct Range {
    colours: Vec<([u8; 3], u64)>,
}

impl Range {
    fn count(&self) -> u64 {
        self.colours.iter().map(|c| c.1).sum()
    }

    /// Channel of the widest spread, and that spread times how many pixels see it.
    fn spread(&self) -> (usize, u64) {
        let wide = |k: usize| {
            let of = || self.colours.iter().map(|c| c.0[k]);
            u64::from(of().max().unwrap_or(0) - of().min().unwrap_or(0))
        };
        let channel = (0..3).max_by_key(|&k| wide(k)).unwrap_or(0);
        // Few pixels far apart are seen as well as many close together: the root weighs both.
        (channel, wide(channel) * (self.count() as f64).sqrt() as u64)
    }

    /// The half of the pixels that are brighter in the channel of the widest spread.
    fn halve(&mut self) -> Self {
        let (channel, _) = self.spread();
        self.colours.sort_by_key(|c| (c.0[channel], c.0));
        let half = self.count() / 2;
        let mut sum = 0;
        let at = self.colours.iter().position(|c| {
            sum += c.1;
            sum > half
        });
        let at = at.unwrap_or(0).clamp(1, self.colours.len() - 1);
        Self { colours: self.colours.split_off(at) }
    }

    fn mean(&self) -> [u8; 3] {
        let count = self.count().max(1);
        [0, 1, 2].map(|k| {
            let sum: u64 = self.colours.iter().map(|(c, n)| u64::from(c[k]) * n).sum();
            ((sum + count / 2) / count) as u8
        })
    }
}

impl Image {
    /// The picture in at most `n_colours` (1 to 256) colours: the palette, and the number of each pixel's colour.
    #[must_use]
    pub fn in_few_colours(&self, n_colours: usize) -> (Vec<[u8; 3]>, Vec<u8>) {
        let key = |p: &[u8]| p.iter().fold(0_u32, |bits, &c| bits << BITS | u32::from(c) >> (8 - BITS));
        let pixels = || self.rgb.as_chunks::<3>().0;
        let mut seen: BTreeMap<u32, ([u64; 3], u64)> = BTreeMap::new();
        for p in pixels() {
            let (sum, count) = seen.entry(key(p)).or_default();
            (0..3).for_each(|k| sum[k] += u64::from(p[k]));
            *count += 1;
        }
        let colours = seen.values().map(|(sum, n)| (sum.map(|s| ((s + n / 2) / n) as u8), *n)).collect();
        let mut boxes = vec![Range { colours }];
        while boxes.len() < n_colours.clamp(1, 256) {
            let widest = (0..boxes.len()).filter(|&k| boxes[k].colours.len() > 1).max_by_key(|&k| boxes[k].spread().1);
            let Some(widest) = widest else { break };
            let half = boxes[widest].halve();
            boxes.push(half);
        }
        let palette: Vec<[u8; 3]> = boxes.iter().map(Range::mean).collect();
        let nearest = |p: [u8; 3]| {
            let apart = |c: &[u8; 3]| -> u32 { (0..3).map(|k| u32::from(c[k].abs_diff(p[k])).pow(2)).sum() };
            (0..palette.len()).min_by_key(|&k| apart(&palette[k])).unwrap_or(0) as u8
        };
        let of_key: BTreeMap<u32, u8> =
            seen.iter().map(|(key, (sum, n))| (*key, nearest(sum.map(|s| (s / n) as u8)))).collect();
        let indices = pixels().iter().map(|p| of_key[&key(p)]).collect();
        (palette, indices)
    }

    /// Writes a PNG file in at most `n_colours` (1 to 256) colours.
    ///
    /// # Errors
    /// What the operating system or the encoder (a picture of no size) says.
    pub fn write_small_png(&self, path: &Path, n_colours: usize) -> Result<(), Error> {
        let io = |source| Error::Io { path: path.to_owned(), source };
        let png = |source| Error::Png { path: path.to_owned(), source };
        let (palette, indices) = self.in_few_colours(n_colours);
        let beside = path.with_extension("png.part");
        let mut file = BufWriter::new(File::create(&beside).map_err(io)?);
        let mut encoder = png::Encoder::new(&mut file, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Indexed);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_palette(palette.into_flattened());
        encoder.set_compression(png::Compression::High);
        // Numbers of colours have no order: differences between neighbours tell nothing.
        encoder.set_filter(png::Filter::NoFilter);
        let mut writer = encoder.write_header().map_err(png)?;
        writer.write_image_data(&indices).map_err(png)?;
        writer.finish().map_err(png)?;
        file.flush().map_err(io)?;
        drop(file);
        fs::rename(&beside, path).map_err(io)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gradient() -> Image {
        let (width, height) = (64, 48);
        let pixel = |n: usize| [(n % width * 4) as u8, (n / width * 5) as u8, 90];
        Image { width, height, rgb: (0..width * height).flat_map(pixel).collect() }
    }

    #[test]
    fn few_colours_are_kept_as_they_are() {
        let colours = [[255, 0, 0], [0, 128, 255], [10, 10, 10]];
        let image = Image { width: 5, height: 3, rgb: (0..15).flat_map(|n| colours[n % 3]).collect() };
        let (palette, indices) = image.in_few_colours(64);
        assert_eq!(palette.len(), 3);
        assert!(indices.iter().enumerate().all(|(n, &k)| palette[usize::from(k)] == colours[n % 3]));
    }

    #[test]
    fn more_colours_come_closer() {
        let image = gradient();
        let apart = |n_colours: usize| {
            let (palette, indices) = image.in_few_colours(n_colours);
            assert!(palette.len() <= n_colours);
            let off = |(p, &k): (&[u8; 3], &u8)| -> u64 {
                (0..3).map(|c| u64::from(p[c].abs_diff(palette[usize::from(k)][c])).pow(2)).sum()
            };
            image.rgb.as_chunks().0.iter().zip(&indices).map(off).sum::<u64>()
        };
        let errors = [1, 4, 16, 64, 256].map(apart);
        assert!(errors.windows(2).all(|pair| pair[1] < pair[0] / 2), "{errors:?}");
    }

    #[test]
    fn a_small_file_reads_back_in_its_palette() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("picture.png");
        // Hair, as far as files go: noise of one hue.
        let bright = |n: u32| (n.wrapping_mul(2_654_435_769) >> 25) as u8;
        let pixel = |n: u32| [60 + bright(n), 30 + bright(n) / 2, 10 + bright(n) / 4];
        let image = Image { width: 64, height: 48, rgb: (0..64 * 48).flat_map(pixel).collect() };
        image.write_small_png(&path, 16).expect("written");
        let mut decoder = png::Decoder::new(std::io::BufReader::new(File::open(&path).expect("there")));
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info().expect("a header");
        let mut rgb = vec![0; reader.output_buffer_size().expect("a size")];
        reader.next_frame(&mut rgb).expect("a picture");
        let (palette, indices) = image.in_few_colours(16);
        let wanted: Vec<u8> = indices.iter().flat_map(|&k| palette[usize::from(k)]).collect();
        assert_eq!(rgb, wanted);
        let full = dir.path().join("full.png");
        image.write_png(&full).expect("written");
        let bytes = |path: &Path| fs::metadata(path).expect("there").len();
        assert!(2 * bytes(&path) < bytes(&full), "{} and {}", bytes(&path), bytes(&full));
    }
}
