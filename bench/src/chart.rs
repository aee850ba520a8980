//! Curves over a number, drawn with the same pixels as pictures of hair: axes from zero, one colour a curve, names in it.
//!
//! For figures that a table holds too: it shows which curve lies lower, and where they meet.

use crate::picture::Image;

/// One curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Its name, in small letters, digits and spaces.
    pub name: String,
    /// Points (x, y), by x, none negative.
    pub points: Vec<[f64; 2]>,
}

/// Colours told apart also by those who see few: after Okabe and Ito.
const COLORS: [[u8; 3]; 6] =
    [[0, 114, 178], [213, 94, 0], [230, 159, 0], [120, 120, 120], [0, 158, 115], [204, 121, 167]];
const WIDTH: usize = 900;
const HEIGHT: usize = 600;
/// Left, right, top, bottom edges of the field.
const FIELD: [f64; 4] = [90.0, 870.0, 60.0, 530.0];
/// Pixels of a dot of text.
const DOT: usize = 3;
const INK: [u8; 3] = [40; 3];
const GRID: [u8; 3] = [225; 3];

/// Draws the curves under a title; `x` and `y` name the axes.
#[must_use]
pub fn draw(title: &str, x: &str, y: &str, curves: &[Curve]) -> Image {
    let mut image = Image { width: WIDTH, height: HEIGHT, rgb: vec![255; 3 * WIDTH * HEIGHT] };
    let [left, right, top, bottom] = FIELD;
    let largest = |c: usize| curves.iter().flat_map(|k| &k.points).fold(0.0_f64, |m, p| m.max(p[c]));
    let (step_x, step_y) = (round_step(largest(0)), round_step(largest(1)));
    let most = |c: usize, step: f64| (largest(c) / step).ceil().max(1.0) * step;
    let (most_x, most_y) = (most(0, step_x), most(1, step_y));
    let place = |p: &[f64; 2]| [left + (right - left) * p[0] / most_x, bottom - (bottom - top) * p[1] / most_y];
    for n in 0..=(most_x / step_x).round() as usize {
        let value = n as f64 * step_x;
        line(&mut image, place(&[value, 0.0]), place(&[value, most_y]), 1, GRID);
        let at = place(&[value, 0.0]);
        image.draw_text([at[0] as usize - 10, at[1] as usize + 10], DOT, &number(value, step_x), INK);
    }
    for n in 0..=(most_y / step_y).round() as usize {
        let value = n as f64 * step_y;
        line(&mut image, place(&[0.0, value]), place(&[most_x, value]), 1, GRID);
        let down = (place(&[0.0, value])[1] as usize).saturating_sub(7);
        image.draw_text([20, down], DOT, &number(value, step_y), INK);
    }
    image.draw_text([FIELD[0] as usize, 6], DOT, title, INK);
    image.draw_text([20, 28], DOT, y, INK);
    image.draw_text([(0.5 * (left + right)) as usize - 60, HEIGHT - 34], DOT, x, INK);
    for (n, (curve, color)) in curves.iter().zip(COLORS.iter().cycle()).enumerate() {
        for pair in curve.points.windows(2) {
            line(&mut image, place(&pair[0]), place(&pair[1]), 3, *color);
        }
        for point in &curve.points {
            let [x, y] = place(point);
            image.fill((x - 4.0).max(0.0) as usize, (y - 4.0).max(0.0) as usize, 9, *color);
        }
        image.draw_text([WIDTH - 260, 70 + 24 * n], DOT, &curve.name, *color);
    }
    image
}

/// One, two or five times a power of ten, so that four to ten of it reach `most`.
fn round_step(most: f64) -> f64 {
    let rough = most.max(f64::MIN_POSITIVE) / 8.0;
    let power = 10.0_f64.powf(rough.log10().floor());
    [1.0, 2.0, 5.0, 10.0].iter().map(|m| m * power).find(|step| *step >= rough).unwrap_or(10.0 * power)
}

/// A multiple of `step`, with as many decimals as tell neighbours apart.
fn number(value: f64, step: f64) -> String {
    let decimals = (-step.log10()).ceil().clamp(0.0, 9.0) as usize;
    format!("{value:.decimals$}")
}

fn line(image: &mut Image, a: [f64; 2], b: [f64; 2], width: usize, color: [u8; 3]) {
    let steps = (b[0] - a[0]).abs().max((b[1] - a[1]).abs()).ceil().max(1.0);
    for n in 0..=steps as usize {
        let t = n as f64 / steps;
        let at = [0, 1].map(|c| (a[c] + t * (b[c] - a[c]) - 0.5 * (width - 1) as f64).round().max(0.0) as usize);
        image.fill(at[0], at[1], width, color);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_curve_passes_through_its_points_in_its_colour() {
        let curves = [
            Curve { name: "a".to_owned(), points: vec![[50.0, 4.0], [400.0, 1.0]] },
            Curve { name: "b".to_owned(), points: vec![[50.0, 2.0], [400.0, 3.0]] },
        ];
        let image = draw("t", "x", "y", &curves);
        let [left, right, top, bottom] = FIELD;
        for (curve, color) in curves.iter().zip(COLORS) {
            for p in &curve.points {
                let x = (left + (right - left) * p[0] / 400.0) as usize;
                let y = (bottom - (bottom - top) * p[1] / 4.0) as usize;
                assert_eq!(image.rgb[3 * (y * image.width + x)..][..3], color, "{p:?}");
            }
        }
    }

    #[test]
    fn steps_of_the_axes_are_round_and_neither_few_nor_many() {
        for (most, step) in [(400.0, 50.0), (4.0, 0.5), (7.3, 1.0), (16.0, 2.0), (0.17, 0.05)] {
            assert!((round_step(most) - step).abs() < 1e-12, "{most}: {}", round_step(most));
        }
    }
}
