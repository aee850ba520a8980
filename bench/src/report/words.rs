//! Numbers, times and verdicts in words: one way each, for the page, for Markdown and for terminals.
//!
//! A number shows as many digits as its cell says, thousands set apart; what is not finite is a dash, and a zero
//! has no sign.

use super::Machine;
use crate::evidence::{Cell, Size, Verdict};

/// A cell as it is read.
#[must_use]
pub fn shown(cell: &Cell) -> String {
    match cell {
        Cell::Number { value, digits } => number_words(*value, usize::from(*digits)),
        Cell::Text(words) if words.trim().is_empty() => "–".to_owned(),
        Cell::Text(words) => words.clone(),
    }
}

/// A number with so many digits after its point.
pub(super) fn number_words(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let plain = format!("{value:.digits$}");
    let (sign, plain) = match plain.strip_prefix('-') {
        // What rounds to zero is zero.
        Some(rest) if rest.bytes().any(|b| (b'1'..=b'9').contains(&b)) => ("-", rest),
        Some(rest) => ("", rest),
        None => ("", plain.as_str()),
    };
    let (whole, rest) = plain.split_at(plain.find('.').unwrap_or(plain.len()));
    format!("{sign}{}{rest}", thousands(whole))
}

/// A number with as many digits as tell something: four that count.
pub(super) fn measured_words(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let digits = (3.0 - value.abs().log10().floor()).clamp(0.0, 9.0);
    let words = number_words(value, digits as usize);
    if words.contains('.') { words.trim_end_matches('0').trim_end_matches('.').to_owned() } else { words }
}

fn thousands(digits: &str) -> String {
    if digits.len() < 4 {
        return digits.to_owned();
    }
    let first = digits.len() % 3;
    let mut out = digits[..first].to_owned();
    for (k, three) in digits.as_bytes()[first..].chunks(3).enumerate() {
        if first + k > 0 {
            out.push(',');
        }
        out.extend(three.iter().map(|&b| char::from(b)));
    }
    out
}

/// A verdict.
#[must_use]
pub fn verdict_words(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Reproduced => "reproduced",
        Verdict::InPart => "in part",
        Verdict::NotReproduced => "not reproduced",
        Verdict::NotTested => "not tested",
    }
}

/// So many claims with a verdict: `3 hold`, `2 hold in part`.
#[must_use]
pub fn verdicts_words(verdict: Verdict, n: usize) -> String {
    let s = if n == 1 { "s" } else { "" };
    match verdict {
        Verdict::Reproduced => format!("{n} hold{s}"),
        Verdict::InPart => format!("{n} hold{s} in part"),
        Verdict::NotReproduced => format!("{n} {} not", if n == 1 { "does" } else { "do" }),
        Verdict::NotTested => format!("{n} {} not tested", if n == 1 { "was" } else { "were" }),
    }
}

/// A verdict as a name for styles.
pub(super) fn verdict_class(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Reproduced => "yes",
        Verdict::InPart => "partly",
        Verdict::NotReproduced => "no",
        Verdict::NotTested => "untested",
    }
}

/// What a size means.
#[must_use]
pub fn size_words(size: Size) -> &'static str {
    match size {
        Size::Smoke => "smoke, heads of a few thousand hairs, to see that nothing got worse",
        Size::Quick => "quick, smaller heads than the papers', large enough to look at",
        Size::Full => "full, the papers' numbers of hairs and guides",
    }
}

/// So many things: `1 claim`, `3 claims`.
#[must_use]
pub fn counted(n: usize, one: &str) -> String {
    if n == 1 { format!("1 {one}") } else { format!("{n} {one}s") }
}

/// How much memory a machine has.
pub(super) fn memory_words(machine: &Machine) -> String {
    machine.memory_gib.map_or_else(|| "unknown".to_owned(), |gib| format!("{gib:.0} GiB"))
}

/// Seconds, as people say them.
#[must_use]
pub fn duration_words(seconds: f64) -> String {
    if !seconds.is_finite() {
        return "–".to_owned();
    }
    if seconds < 99.5 {
        return if seconds < 9.95 { format!("{seconds:.1} s") } else { format!("{seconds:.0} s") };
    }
    let minutes = (seconds / 60.0).round() as u64;
    if minutes < 100 { format!("{minutes} min") } else { format!("{} h {} min", minutes / 60, minutes % 60) }
}

/// Date and time (UTC) of so many seconds since 1970.
#[must_use]
pub fn date_words(seconds: u64) -> String {
    let (days, of_day) = (seconds / 86_400, seconds % 86_400);
    // Years counted from March, in eras of 400, so that the day that comes every fourth year is the last one (Hinnant 2013).
    let z = days + 719_468;
    let (era, day) = (z / 146_097, z % 146_097);
    let year = (day - day / 1_460 + day / 36_524 - day / 146_096) / 365;
    let of_year = day - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let of_month = of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    let year = year + 400 * era + u64::from(month < 3);
    format!("{year}-{month:02}-{of_month:02} {:02}:{:02} UTC", of_day / 3_600, of_day / 60 % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_as_they_are_read() {
        let cases: [(f64, usize, &str); 9] = [
            (0.0, 2, "0.00"),
            (-0.001, 2, "0.00"),
            (-0.006, 2, "-0.01"),
            (1234.5, 1, "1,234.5"),
            (12345.678, 1, "12,345.7"),
            (150_000.0, 0, "150,000"),
            (-1_234_567.0, 0, "-1,234,567"),
            (f64::NAN, 3, "–"),
            (f64::NEG_INFINITY, 0, "–"),
        ];
        for (value, digits, words) in cases {
            assert_eq!(number_words(value, digits), words);
        }
        assert_eq!(
            [0.0, 0.012_345, 1.5, 99.996, 150_000.0].map(measured_words),
            ["0", "0.01235", "1.5", "100", "150,000"]
        );
    }

    #[test]
    fn dates_are_those_of_the_calendar() {
        let cases = [
            (0, "1970-01-01 00:00 UTC"),
            (951_782_399, "2000-02-28 23:59 UTC"),
            (951_782_400, "2000-02-29 00:00 UTC"),
            (4_107_542_399, "2100-02-28 23:59 UTC"),
            (4_107_542_400, "2100-03-01 00:00 UTC"),
        ];
        for (seconds, words) in cases {
            assert_eq!(date_words(seconds), words);
        }
    }

    #[test]
    fn times_are_as_people_say_them() {
        assert_eq!(
            [0.04, 9.96, 99.0, 120.0, 7_300.0, f64::NAN].map(duration_words),
            ["0.0 s", "10 s", "99 s", "2 min", "2 h 2 min", "–"]
        );
    }
}
