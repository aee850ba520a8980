//! Finished pictures: labels, sheets of several, and PNG files.
//!
//! A file is written beside its target and renamed over it, so that a reader never sees half a picture.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::error::Error;

/// A picture of 8 bits per channel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// `3 * width * height` bytes: red, green, blue, row by row from the top.
    pub rgb: Vec<u8>,
}

impl Image {
    /// Writes `text` in white on the top left corner; digits, letters, `.`, `-`, `:`, `%` are known, others leave a gap.
    pub fn draw_label(&mut self, text: &str) {
        let dot = (self.height / 160).max(1);
        self.draw_text([2 * dot, 2 * dot], dot, text, [255; 3]);
    }

    /// Writes `text` from a left and top pixel on, five dots high and four wide a letter, each dot a square of pixels.
    pub fn draw_text(&mut self, [left, top]: [usize; 2], dot: usize, text: &str, color: [u8; 3]) {
        for (n, c) in text.chars().enumerate() {
            for (row, bits) in glyph(c).into_iter().enumerate() {
                for column in (0..3).filter(|column| bits >> (2 - column) & 1 == 1) {
                    self.fill(left + (4 * n + column) * dot, top + row * dot, dot, color);
                }
            }
        }
    }

    /// As [`Self::draw_label`], with a time in seconds.
    pub fn draw_time(&mut self, seconds: f64) {
        self.draw_label(&format!("{seconds:.2} s"));
    }

    /// A square of one colour, as far as it lies within the picture.
    pub fn fill(&mut self, left: usize, top: usize, side: usize, color: [u8; 3]) {
        for y in top..(top + side).min(self.height) {
            for x in left..(left + side).min(self.width) {
                self.rgb[3 * (y * self.width + x)..][..3].copy_from_slice(&color);
            }
        }
    }

    /// Writes a PNG file.
    ///
    /// # Errors
    /// What the operating system or the encoder (a picture of no size) says.
    pub fn write_png(&self, path: &Path) -> Result<(), Error> {
        let io = |source| Error::Io { path: path.to_owned(), source };
        let png = |source| Error::Png { path: path.to_owned(), source };
        let beside = path.with_extension("png.part");
        let mut file = BufWriter::new(File::create(&beside).map_err(io)?);
        let mut encoder = png::Encoder::new(&mut file, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header().map_err(png)?;
        writer.write_image_data(&self.rgb).map_err(png)?;
        writer.finish().map_err(png)?;
        file.flush().map_err(io)?;
        drop(file);
        fs::rename(&beside, path).map_err(io)
    }
}

/// Pictures side by side in rows of `columns`, each in a field of the largest size among them, with a thin black gap.
pub fn contact_sheet(images: &[Image], columns: usize) -> Image {
    const GAP: usize = 2;
    let columns = columns.clamp(1, images.len().max(1));
    let rows = images.len().div_ceil(columns);
    let field = |size: fn(&Image) -> usize| images.iter().map(size).max().unwrap_or(0) + GAP;
    let (across, down) = (field(|i| i.width), field(|i| i.height));
    let (width, height) = (columns * across - GAP, (rows * down).saturating_sub(GAP));
    let mut sheet = Image { width, height, rgb: vec![0; 3 * width * height] };
    for (n, image) in images.iter().enumerate() {
        let (left, top) = (n % columns * across, n / columns * down);
        for y in 0..image.height {
            let row = &image.rgb[3 * y * image.width..3 * (y + 1) * image.width];
            sheet.rgb[3 * ((top + y) * width + left)..][..row.len()].copy_from_slice(row);
        }
    }
    sheet
}

/// Five rows of three bits, the leftmost highest.
fn glyph(c: char) -> [u8; 5] {
    match c {
        '0' => [7, 5, 5, 5, 7],
        '1' => [2, 6, 2, 2, 7],
        '2' => [7, 1, 7, 4, 7],
        '3' => [7, 1, 3, 1, 7],
        '4' => [5, 5, 7, 1, 1],
        '5' => [7, 4, 7, 1, 7],
        '6' => [7, 4, 7, 5, 7],
        '7' => [7, 1, 2, 2, 2],
        '8' => [7, 5, 7, 5, 7],
        '9' => [7, 5, 7, 1, 7],
        's' => [3, 4, 2, 1, 6],
        'a' => [2, 5, 7, 5, 5],
        'b' => [6, 5, 6, 5, 6],
        'c' => [3, 4, 4, 4, 3],
        'd' => [6, 5, 5, 5, 6],
        'e' => [7, 4, 6, 4, 7],
        'f' => [7, 4, 6, 4, 4],
        'g' => [3, 4, 5, 5, 3],
        'h' => [5, 5, 7, 5, 5],
        'i' => [7, 2, 2, 2, 7],
        'j' => [1, 1, 1, 5, 2],
        'k' => [5, 5, 6, 5, 5],
        'l' => [4, 4, 4, 4, 7],
        'm' => [5, 7, 7, 5, 5],
        'n' => [6, 5, 5, 5, 5],
        'o' => [2, 5, 5, 5, 2],
        'p' => [6, 5, 6, 4, 4],
        'q' => [2, 5, 5, 6, 3],
        'r' => [6, 5, 6, 5, 5],
        't' => [7, 2, 2, 2, 2],
        'u' => [5, 5, 5, 5, 7],
        'v' => [5, 5, 5, 5, 2],
        'w' => [5, 5, 7, 7, 5],
        'x' => [5, 5, 2, 5, 5],
        'y' => [5, 5, 2, 2, 2],
        'z' => [7, 1, 2, 4, 7],
        '%' => [5, 1, 2, 4, 5],
        '.' => [0, 0, 0, 0, 2],
        ':' => [0, 2, 0, 2, 0],
        '-' => [0, 0, 7, 0, 0],
        _ => [0; 5],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(width: usize, height: usize, value: u8) -> Image {
        Image { width, height, rgb: vec![value; 3 * width * height] }
    }

    #[test]
    fn a_sheet_holds_every_picture_in_reading_order() {
        let sheet = contact_sheet(&[plain(4, 3, 10), plain(4, 3, 20), plain(2, 3, 30)], 2);
        assert_eq!((sheet.width, sheet.height), (10, 8));
        let at = |x: usize, y: usize| sheet.rgb[3 * (y * sheet.width + x)];
        assert_eq!([at(0, 0), at(4, 0), at(6, 0), at(1, 5), at(3, 5)], [10, 0, 20, 30, 0]);
        assert!(contact_sheet(&[], 3).rgb.is_empty());
    }

    #[test]
    fn a_label_marks_only_its_corner_and_digits_differ() {
        let mut labels: Vec<Image> = (0..10)
            .map(|n| {
                let mut image = plain(60, 160, 0);
                image.draw_label(&n.to_string());
                assert!(image.rgb.contains(&255) && image.rgb[3 * 60 * 10..].iter().all(|&c| c == 0));
                image
            })
            .collect();
        labels.dedup();
        assert_eq!(labels.len(), 10);
    }

    #[test]
    fn a_written_picture_reads_back_the_same() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("picture.png");
        let mut image = plain(7, 5, 200);
        image.draw_time(1.25);
        image.write_png(&path).expect("written");
        let file = std::io::BufReader::new(File::open(&path).expect("there"));
        let mut reader = png::Decoder::new(file).read_info().expect("a header");
        let mut rgb = vec![0; reader.output_buffer_size().expect("a size")];
        let info = reader.next_frame(&mut rgb).expect("a picture");
        assert_eq!((info.width, info.height), (7, 5));
        assert_eq!(rgb, image.rgb);
        assert_eq!(fs::read_dir(dir.path()).expect("a folder").count(), 1, "nothing is left beside it");
    }
}
