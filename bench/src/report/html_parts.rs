//! What pages are put together from: escaped text, pictures as text, tables.
//!
//! Everything that comes from findings goes through [`escaped`]; nothing else writes it into a page.

use super::words::shown;
use crate::evidence::{Cell, Table};
use std::fmt::Write;

/// Text that shows as it is, within elements and within attributes.
pub(super) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            // What a page may not hold.
            c if c.is_control() && c != '\n' => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// Bytes in 64 letters (RFC 4648).
pub(super) fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let at = |k: usize| u32::from(three.get(k).copied().unwrap_or(0));
        let bits = at(0) << 16 | at(1) << 8 | at(2);
        for k in 0..4 {
            let letter = char::from(LETTERS[(bits >> (18 - 6 * k) & 63) as usize]);
            out.push(if k <= three.len() { letter } else { '=' });
        }
    }
    out
}

/// A name that anchors may have.
pub(super) fn anchor(name: &str) -> String {
    let letters = name.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' });
    format!("s-{}", letters.collect::<String>())
}

/// Whether a column holds numbers, so that it is set flush right.
fn is_numeric(table: &Table, column: usize) -> bool {
    table.rows.iter().any(|row| matches!(row.get(column), Some(Cell::Number { .. })))
}

/// A table that scrolls by itself where it is too wide.
pub(super) fn table(out: &mut String, table: &Table) {
    let _ = write!(
        out,
        "<figure class=\"table\"><div class=\"scroll\" role=\"region\" tabindex=\"0\" aria-label=\"{}\"><table>",
        escaped(&table.title)
    );
    let _ = write!(out, "<caption>{}</caption><thead><tr>", escaped(&table.title));
    let class: Vec<&str> =
        (0..table.columns.len()).map(|c| if is_numeric(table, c) { " class=\"n\"" } else { "" }).collect();
    for (name, class) in table.columns.iter().zip(&class) {
        let _ = write!(out, "<th scope=\"col\"{class}>{}</th>", escaped(name));
    }
    out.push_str("</tr></thead><tbody>");
    for row in &table.rows {
        out.push_str("<tr>");
        for (c, cell) in row.iter().enumerate() {
            let class = class.get(c).copied().unwrap_or_default();
            let words = escaped(&shown(cell));
            let _ = if c == 0 {
                write!(out, "<th scope=\"row\"{class}>{words}</th>")
            } else {
                write!(out, "<td{class}>{words}</td>")
            };
        }
        out.push_str("</tr>");
    }
    out.push_str("</tbody></table></div>");
    if !table.note.is_empty() {
        let _ = write!(out, "<p class=\"note\">{}</p>", escaped(&table.note));
    }
    out.push_str("</figure>");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_written_as_the_standard_says() {
        let cases = [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")];
        for (bytes, letters) in cases {
            assert_eq!(base64(bytes.as_bytes()), letters);
        }
        assert_eq!(base64(&[0xfb, 0xff, 0xfe]), "+//+");
    }

    #[test]
    fn no_text_becomes_markup() {
        assert_eq!(escaped("<b a='\"&\u{7}>"), "&lt;b a=&#39;&quot;&amp;\u{fffd}&gt;");
        assert_eq!(anchor("fig-6 <rod>"), "s-fig-6--rod-");
    }
}
