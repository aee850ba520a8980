//! Curves as SVG: round ticks, axes by factors where asked, a legend, marks and dashes besides colours.
//!
//! Every curve has a colour of its own that also those tell apart who see few (after Okabe and Ito), a dash of its own, and a mark
//! of its own where points are few. Colours are those of the page, light or dark; in a file of its own the picture brings them.
//! A point that is not finite, or not positive on an axis by factors, interrupts its curve.

use super::html_parts::escaped;
use super::words::number_words;
use crate::evidence::Plot;
use std::fmt::Write;

const WIDTH: f64 = 540.0;
/// Left, right, top, bottom of the field.
const FIELD: [f64; 4] = [64.0, 524.0, 30.0, 268.0];
/// Below the field: labels of ticks, then the name of the axis.
const BELOW: f64 = 46.0;
/// Height of a line of the legend.
const LEGEND_LINE: f64 = 19.0;
/// Width of a letter at the size of the legend, rather too much than too little.
const LETTER: f64 = 6.9;
/// Length of the piece of curve in the legend.
const SAMPLE: f64 = 30.0;
/// Kinds of curves told apart.
const KINDS: usize = 8;
/// More points than this on a curve have no marks.
const MOST_MARKS: usize = 16;
const DASHES: [&str; 4] = ["", "7 4", "2 3", "9 3 2 3"];

/// Colours of a file of its own; the page has the same by the same names.
pub(super) const COLOURS: &str = ".plot{--ink:#22262b;--faint:#8a8f96;--grid:#e2e0da;--paper:#fffefb;\
--c0:#0072b2;--c1:#d55e00;--c2:#00845c;--c3:#b0568f;--c4:#8a6a00;--c5:#1f8fc7;--c6:#555a60;--c7:#a03020}";

/// What a plot is drawn with wherever it stands.
pub(super) const STYLE: &str = ".plot{font:13px system-ui,sans-serif;fill:var(--ink)}\
.plot .grid{stroke:var(--grid);stroke-width:1}\
.plot .axis{stroke:var(--faint);stroke-width:1}\
.plot .curve{fill:none;stroke-width:2;stroke-linejoin:round;stroke-linecap:round}\
.plot .mark{stroke-width:1.5}\
.plot .tick{fill:var(--faint);font-size:12px}\
.plot .k0{stroke:var(--c0)}.plot .k1{stroke:var(--c1)}.plot .k2{stroke:var(--c2)}.plot .k3{stroke:var(--c3)}\
.plot .k4{stroke:var(--c4)}.plot .k5{stroke:var(--c5)}.plot .k6{stroke:var(--c6)}.plot .k7{stroke:var(--c7)}";

/// A plot as a file of its own, on paper.
#[must_use]
pub fn svg_file(plot: &Plot) -> String {
    svg(plot, Some(&format!("<style>{COLOURS}{STYLE}.plot{{background:#fffefb}}</style>")))
}

/// A plot within a page that has [`STYLE`]; `style` is put into it where there is no such page.
pub(super) fn svg(plot: &Plot, style: Option<&str>) -> String {
    let [left, right, top, bottom] = FIELD;
    let x = Axis::over(plot.curves.iter().flat_map(|c| c.1.iter().map(|p| p[0])), plot.log_x, false);
    let y = Axis::over(plot.curves.iter().flat_map(|c| c.1.iter().map(|p| p[1])), plot.log_y, true);
    let legend = legend(plot);
    let height = bottom + BELOW + LEGEND_LINE * legend.last().map_or(0.0, |(_, row)| row + 1.0);
    let mut out = String::new();
    let namespace = if style.is_some() { " xmlns=\"http://www.w3.org/2000/svg\"" } else { "" };
    let said = said(plot);
    let _ = write!(
        out,
        "<svg class=\"plot\"{namespace} viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"{}\">{}",
        escaped(&said),
        style.unwrap_or_default()
    );
    let at_x = |v: f64| left + (right - left) * x.share(v);
    let at_y = |v: f64| bottom - (bottom - top) * y.share(v);
    for (value, words) in &y.ticks {
        let at = at_y(*value);
        let _ = write!(out, "<path class=\"grid\" d=\"M{left} {at:.1}H{right}\"/>");
        let _ = write!(
            out,
            "<text class=\"tick\" x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{words}</text>",
            left - 8.0,
            at + 4.0
        );
    }
    for (value, words) in &x.ticks {
        let at = at_x(*value);
        let _ = write!(out, "<path class=\"axis\" d=\"M{at:.1} {bottom}v5\"/>");
        let _ = write!(
            out,
            "<text class=\"tick\" x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{words}</text>",
            bottom + 19.0
        );
    }
    let _ = write!(out, "<path class=\"axis\" d=\"M{left} {bottom}H{right}\"/>");
    let by_factors = |log: bool| if log { " (by factors)" } else { "" };
    let _ = write!(out, "<text x=\"4\" y=\"15\">{}{}</text>", escaped(&plot.y), by_factors(plot.log_y));
    let _ = write!(
        out,
        "<text x=\"{right}\" y=\"{}\" text-anchor=\"end\">{}{}</text>",
        bottom + 38.0,
        escaped(&plot.x),
        by_factors(plot.log_x)
    );
    if x.ticks.is_empty() || y.ticks.is_empty() {
        let _ = write!(
            out,
            "<text class=\"tick\" x=\"{}\" y=\"{}\" text-anchor=\"middle\">no points to show</text>",
            0.5 * (left + right),
            0.5 * (top + bottom)
        );
    }
    for (n, (_, points)) in plot.curves.iter().enumerate() {
        curve(&mut out, n, points, |p| (x.shows(p[0]) && y.shows(p[1])).then(|| [at_x(p[0]), at_y(p[1])]));
    }
    for ((n, (name, points)), (from, row)) in plot.curves.iter().enumerate().zip(&legend) {
        let (from, line) = (4.0 + from, bottom + BELOW + LEGEND_LINE * row + 8.0);
        let ends = [[from, line], [from + SAMPLE, line]];
        let _ = write!(out, "<path class=\"curve k{}\"{} d=\"M{from:.1} {line:.1}h{SAMPLE}\"/>", n % KINDS, dash_of(n));
        if marked(points) {
            mark(&mut out, n, [0.5 * (ends[0][0] + ends[1][0]), line]);
        }
        let _ = write!(out, "<text x=\"{:.1}\" y=\"{:.1}\">{}</text>", from + SAMPLE + 7.0, line + 4.5, escaped(name));
    }
    out.push_str("</svg>");
    out
}

/// A plot in a sentence, for those who do not see it.
fn said(plot: &Plot) -> String {
    let names: Vec<&str> = plot.curves.iter().map(|(name, _)| name.as_str()).collect();
    format!("{}: {} over {}; {}", plot.title, plot.y, plot.x, names.join(", "))
}

/// Left edge and line of each entry of the legend.
fn legend(plot: &Plot) -> Vec<(f64, f64)> {
    let (mut from, mut row) = (0.0, 0.0);
    let mut out = Vec::new();
    for (name, _) in &plot.curves {
        let width = SAMPLE + 7.0 + LETTER * name.chars().count() as f64 + 20.0;
        if from > 0.0 && from + width > WIDTH {
            (from, row) = (0.0, row + 1.0);
        }
        out.push((from, row));
        from += width;
    }
    out
}

fn dash_of(n: usize) -> String {
    match DASHES[n % DASHES.len()] {
        "" => String::new(),
        dash => format!(" stroke-dasharray=\"{dash}\""),
    }
}

fn marked(points: &[[f64; 2]]) -> bool {
    points.len() <= MOST_MARKS
}

fn curve(out: &mut String, n: usize, points: &[[f64; 2]], place: impl Fn(&[f64; 2]) -> Option<[f64; 2]>) {
    let placed: Vec<_> = points.iter().map(place).collect();
    let mut path = String::new();
    let mut pen_down = false;
    for at in &placed {
        if let Some([x, y]) = at {
            let _ = write!(path, "{}{x:.1} {y:.1}", if pen_down { "L" } else { "M" });
        }
        pen_down = at.is_some();
    }
    if path.is_empty() {
        return;
    }
    let _ = write!(out, "<path class=\"curve k{}\"{} d=\"{path}\"/>", n % KINDS, dash_of(n));
    if marked(points) {
        placed.iter().flatten().for_each(|&at| mark(out, n, at));
    }
}

/// A circle, square, triangle or cross, filled for the first four curves and hollow for the next.
fn mark(out: &mut String, n: usize, [x, y]: [f64; 2]) {
    let shape = match n % 4 {
        0 => format!("M{:.1} {y:.1}a3.5 3.5 0 1 0 7 0a3.5 3.5 0 1 0 -7 0z", x - 3.5),
        1 => format!("M{:.1} {:.1}h6.4v6.4h-6.4z", x - 3.2, y - 3.2),
        2 => format!("M{x:.1} {:.1}l4 7h-8z", y - 4.2),
        _ => format!("M{:.1} {y:.1}l4 -4l4 4l-4 4z", x - 4.0),
    };
    let kind = n % KINDS;
    let fill = if (n / 4).is_multiple_of(2) { format!("var(--c{kind})") } else { "var(--paper)".to_owned() };
    let _ = write!(out, "<path class=\"mark k{kind}\" style=\"fill:{fill}\" d=\"{shape}\"/>");
}

/// One axis: what it spans, and its round values.
struct Axis {
    from: f64,
    to: f64,
    log: bool,
    ticks: Vec<(f64, String)>,
}

impl Axis {
    /// The axis that shows these values; without any to show it has no ticks. From zero, if it is near enough and `to_zero`.
    fn over(values: impl Iterator<Item = f64>, log: bool, to_zero: bool) -> Self {
        let shown = values.filter(|v| v.is_finite() && (!log || *v > 0.0));
        let (mut low, mut high) = shown.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        if low > high {
            return Self { from: 0.0, to: 1.0, log: false, ticks: Vec::new() };
        }
        if log {
            return Self::by_factors(low, high);
        }
        if to_zero && low >= 0.0 && low < 0.6 * high {
            low = 0.0;
        }
        if high - low <= 1e-9 * high.abs().max(low.abs()) {
            // All alike: the value stands in the middle.
            let half = if high == 0.0 { 1.0 } else { 0.5 * high.abs() };
            (low, high) = (low - half, high + half);
        }
        let step = round_step((high - low) / 5.0);
        let (first, last) = ((low / step + 1e-9).floor(), (high / step - 1e-9).ceil());
        let (from, to) = if to_zero { (first * step, last * step) } else { (low, high) };
        let digits = (-(step.log10() + 1e-9).floor()).clamp(0.0, 12.0) as usize;
        let count = (last - first) as usize;
        let inside = |v: f64| v >= from - 1e-6 * step && v <= to + 1e-6 * step;
        let ticks = (0..=count)
            .map(|k| (first + k as f64) * step)
            .filter(|v| inside(*v))
            .map(|v| (v, number_words(v, digits)))
            .collect();
        Self { from, to, log: false, ticks }
    }

    fn by_factors(low: f64, high: f64) -> Self {
        let (from, to) = (low.log10(), high.log10());
        let (from, to) = if to - from < 0.3 { (from - 0.15, to + 0.15) } else { (from - 0.03, to + 0.03) };
        let of_decade: &[f64] = match to - from {
            d if d < 1.2 => &[1.0, 2.0, 3.0, 4.0, 5.0, 7.0],
            d if d < 2.6 => &[1.0, 2.0, 5.0],
            _ => &[1.0],
        };
        let every = ((to - from) / 6.0).ceil().max(1.0) as i32;
        let mut ticks = Vec::new();
        for decade in from.floor() as i32..=to.ceil() as i32 {
            for m in of_decade.iter().filter(|_| decade.rem_euclid(every) == 0) {
                let value = m * 10f64.powi(decade);
                if (from..=to).contains(&value.log10()) {
                    let words = if (-4..6).contains(&decade) {
                        number_words(value, (-decade).max(0) as usize)
                    } else {
                        format!("{m}e{decade}")
                    };
                    ticks.push((value, words));
                }
            }
        }
        Self { from, to, log: true, ticks }
    }

    fn shows(&self, value: f64) -> bool {
        value.is_finite() && (!self.log || value > 0.0) && !self.ticks.is_empty()
    }

    /// Where a value lies, 0 at the beginning to 1 at the end.
    fn share(&self, value: f64) -> f64 {
        let value = if self.log { value.log10() } else { value };
        (value - self.from) / (self.to - self.from)
    }
}

/// The least of 1, 2 and 5 times a power of ten that is no less than `step`.
fn round_step(step: f64) -> f64 {
    let power = 10f64.powf(step.log10().floor());
    let least = [1.0, 2.0, 5.0].into_iter().find(|m| m * power >= step * (1.0 - 1e-9));
    least.unwrap_or(10.0) * power
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(axis: &Axis) -> Vec<&str> {
        axis.ticks.iter().map(|(_, words)| words.as_str()).collect()
    }

    #[test]
    fn ticks_are_round_and_hold_the_values() {
        let axis = Axis::over([0.3, 9.7].into_iter(), false, true);
        assert_eq!(words(&axis), ["0", "2", "4", "6", "8", "10"]);
        let axis = Axis::over([-0.013, 0.021].into_iter(), false, true);
        assert_eq!(words(&axis), ["-0.02", "-0.01", "0.00", "0.01", "0.02", "0.03"]);
        let axis = Axis::over([150_000.0, 10_000.0].into_iter(), true, false);
        assert_eq!(words(&axis), ["10,000", "20,000", "50,000", "100,000"]);
        let axis = Axis::over([1e-3, 1e9].into_iter(), true, false);
        assert!(axis.ticks.len() >= 4 && axis.ticks.len() <= 8, "{:?}", words(&axis));
    }

    #[test]
    fn an_axis_shows_what_it_is_given_and_nothing_else() {
        for values in [vec![], vec![f64::NAN, f64::INFINITY]] {
            assert!(Axis::over(values.into_iter(), false, true).ticks.is_empty());
        }
        assert!(Axis::over([0.0, -1.0].into_iter(), true, true).ticks.is_empty());
        for log in [false, true] {
            let one = Axis::over([7.0].into_iter(), log, true);
            assert!(one.shows(7.0) && (0.2..0.8).contains(&one.share(7.0)), "one value stands near the middle");
        }
    }

    #[test]
    fn a_point_that_is_not_finite_interrupts_its_curve() {
        let points = vec![[0.0, 1.0], [1.0, 2.0], [2.0, f64::NAN], [3.0, 1.0], [4.0, 0.5]];
        let plot = Plot { curves: vec![("a".to_owned(), points)], ..Plot::default() };
        let drawn = svg(&plot, None);
        let from = drawn.find("class=\"curve k0\"").expect("a curve");
        let path = &drawn[from..from + drawn[from..].find("/>").expect("its end")];
        assert_eq!((path.matches('M').count(), path.matches('L').count()), (2, 2));
        assert!(!drawn.contains("NaN"));
    }

    #[test]
    fn curves_differ_by_more_than_colour() {
        let curves = (0..8).map(|k| (format!("curve {k}"), vec![[0.0, f64::from(k)], [1.0, 2.0]])).collect();
        let drawn = svg(&Plot { curves, ..Plot::default() }, None);
        let mut kinds: Vec<String> = (0..8)
            .map(|k| {
                let from = drawn.find(&format!("class=\"mark k{k}\"")).expect("a mark");
                let style = &drawn[from..from + drawn[from..].find("/>").expect("its end")];
                // Shape (commands of the path) and fill, without colour and place.
                let shape: String =
                    style.split(" d=").nth(1).expect("a path").chars().filter(char::is_ascii_alphabetic).collect();
                format!("{shape}{}", style.contains("--paper"))
            })
            .collect();
        kinds.sort();
        kinds.dedup();
        assert_eq!(kinds.len(), 8);
    }
}
