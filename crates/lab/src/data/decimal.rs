//! Numbers of tables: decimals whose thousands may be set apart by commas.

/// Powers of ten that are exact.
const POWERS: [f64; 16] = [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15];
/// Digits that any double holds exactly.
const EXACT_DIGITS: usize = 15;

/// The number that `text` is, rounded to the nearest double.
pub(super) fn parse(text: &str) -> Option<f64> {
    plain(text.as_bytes()).or_else(
        || {
            if text.contains(',') { ungrouped(text)?.parse().ok() } else { text.parse().ok() }
        },
    )
}

/// The same for digits with or without sign, point and commas between thousands, which nearly all numbers are; none for others.
///
/// Up to 15 digits and their power of ten are both exact, so their quotient is the nearest double (Clinger 1990).
fn plain(text: &[u8]) -> Option<f64> {
    let (negative, text) = match text {
        [b'-', rest @ ..] => (true, rest),
        rest => (false, rest),
    };
    let (mut mantissa, mut digits, mut point) = (0_u64, 0, None);
    let mut comma = None;
    for &byte in text {
        match byte {
            b'0'..=b'9' => {
                mantissa = mantissa.wrapping_mul(10).wrapping_add(u64::from(byte - b'0'));
                digits += 1;
            }
            b'.' if point.is_none() => point = Some(digits),
            b',' if point.is_none() && comma.map_or((1..=3).contains(&digits), |at| digits == at + 3) => {
                comma = Some(digits);
            }
            _ => return None,
        }
    }
    let whole = point.unwrap_or(digits);
    if digits == 0 || digits > EXACT_DIGITS || comma.is_some_and(|at| whole != at + 3) {
        return None;
    }
    let value = mantissa as f64 / POWERS[digits - whole];
    Some(if negative { -value } else { value })
}

/// `text` without the commas between its thousands; none if a comma stands elsewhere, as in `12,5`.
fn ungrouped(text: &str) -> Option<String> {
    let (whole, fraction) = text.split_once('.').map_or((text, None), |(whole, fraction)| (whole, Some(fraction)));
    let mut groups = whole.split(',');
    let first = groups.next().unwrap_or_default();
    let mut digits = first.to_owned();
    for group in groups {
        if group.len() != 3
            || first.trim_start_matches(['-', '+']).len() > 3
            || fraction.is_some_and(|f| f.contains(','))
        {
            return None;
        }
        digits += group;
    }
    if let Some(fraction) = fraction {
        digits = digits + "." + fraction;
    }
    Some(digits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commas_stand_between_thousands_only() {
        for (text, expected) in [
            ("1,156", Some(1156.0)),
            ("-12,345,678.5", Some(-12_345_678.5)),
            ("1156", Some(1156.0)),
            ("12,345,678,901,234,567", Some(12_345_678_901_234_567.0)),
            ("12,5", None),
            ("1234,567", None),
            ("1,15,600", None),
            ("1,156,", None),
            ("1.5,000", None),
            ("1,5.000", None),
        ] {
            assert_eq!(parse(text), expected, "{text}");
        }
    }

    #[test]
    fn numbers_are_those_of_the_standard_library_to_the_bit() {
        let numbers =
            ["0", "-0", "-0.0", ".5", "5.", "-5.359", "2230502.921", "1118846980200", "0.1", "0.000000000000001"];
        let odd = [
            "+7",
            "1e3",
            "NaN",
            "inf",
            "999999999999999",
            "9999999999999999",
            "123456789012345678.9",
            "0.30000000000000004",
        ];
        let none = ["", "-", ".", "-.", "--1", "1.2.3", "1 2", "0x1", "five", "1_000"];
        for text in numbers.into_iter().chain(odd).chain(none) {
            let expected: Option<f64> = text.parse().ok();
            assert_eq!(parse(text).map(f64::to_bits), expected.map(f64::to_bits), "{text}");
        }
        let mut state = 1_u64;
        for _ in 0..20_000 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let text = format!("{}.{:0width$}", state >> 44, (state >> 20) % 1000, width = (state % 8) as usize);
            assert_eq!(parse(&text).map(f64::to_bits), text.parse().ok().map(f64::to_bits), "{text}");
        }
    }
}
