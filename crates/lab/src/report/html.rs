//! Text for HTML: escaping, numbers, and templates that are filled in one pass.

use std::fmt::Write as _;

use crate::metrics::Interval;

/// `text` with the characters escaped that mean something in HTML text or a quoted attribute.
pub(crate) fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            // HTML has no control characters but white space, not even as references.
            c if c.is_control() && !c.is_whitespace() => escaped.push('\u{fffd}'),
            c => escaped.push(c),
        }
    }
    escaped
}

/// `value` with a fixed number of decimals, a real minus sign, and a dash where there is no number.
pub(crate) fn number(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return "–".into();
    }
    if value.abs() >= 1e9 {
        return format!("{value:.2e}").replace('-', "−");
    }
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        // A rounded zero has no sign.
        Some(digits) if digits.bytes().all(|b| b == b'0' || b == b'.') => digits.into(),
        Some(digits) => format!("−{digits}"),
        None => text,
    }
}

/// `[low, high]`, or nothing if neither end is a number.
pub(crate) fn range(interval: Interval, scale: f64, decimals: usize) -> String {
    if !interval.low.is_finite() && !interval.high.is_finite() {
        return String::new();
    }
    format!("[{}, {}]", number(scale * interval.low, decimals), number(scale * interval.high, decimals))
}

/// `template` with each `{{name}}` replaced by its value. Values are not scanned again, so they may hold anything.
pub(crate) fn fill(template: &str, values: &[(&str, &str)]) -> String {
    let mut filled = String::new();
    let mut rest = template;
    while let Some((before, after)) = rest.split_once("{{") {
        let (name, behind) = after.split_once("}}").expect("our templates close their braces");
        let (_, value) = values.iter().find(|(key, _)| *key == name).expect("our templates name known values");
        filled.push_str(before);
        filled.push_str(value);
        rest = behind;
    }
    filled + rest
}

/// A section with its heading and a muted sentence below it (HTML); nothing if the content is empty.
pub(crate) fn section(heading: &str, note: &str, content: &str) -> String {
    if content.is_empty() {
        return String::new();
    }
    let mut html = format!("<section>\n<h2>{heading}</h2>\n");
    if !note.is_empty() {
        let _ = writeln!(html, "<p class=\"note\">{note}</p>");
    }
    html + content + "</section>\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escaped_text_opens_no_tag_and_closes_no_attribute() {
        assert_eq!(escape("<a href=\"x\">&'\u{0}\n"), "&lt;a href=&quot;x&quot;&gt;&amp;&#39;\u{fffd}\n");
    }

    #[test]
    fn numbers_are_printed_for_people() {
        assert_eq!(number(-0.001, 2), "0.00");
        assert_eq!(number(-1.256, 2), "−1.26");
        assert_eq!(number(f64::NAN, 2), "–");
        assert_eq!(number(f64::MAX, 2), "1.80e308");
        let interval = Interval { mean: 0.5, low: -0.25, high: f64::INFINITY };
        assert_eq!(range(interval, 100.0, 1), "[−25.0, –]");
    }

    #[test]
    fn values_are_not_taken_for_templates() {
        assert_eq!(fill("a {{x}} b {{y}}", &[("x", "{{y}}"), ("y", "}}")]), "a {{y}} b }}");
    }
}
