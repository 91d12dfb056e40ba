//! How a report writes numbers and words: few digits, thin spaces between thousands, powers of ten.

use serde_json::Value;

/// Stands for a figure that was not measured.
pub const ABSENT: &str = "–";

/// Three significant digits; `2.84×10⁻⁴` below 0.001 and from 100 000 on.
pub fn figure(value: Option<f64>) -> String {
    let Some(value) = value else { return ABSENT.into() };
    if !value.is_finite() {
        return if value.is_nan() { "NaN".into() } else { "∞".into() };
    }
    if value == 0.0 {
        return "0".into();
    }
    let scientific = format!("{value:.2e}");
    let (digits, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if (-3..5).contains(&exponent) {
        let decimals = usize::try_from(2 - exponent).unwrap_or(0);
        return trimmed(&format!("{value:.decimals$}")).replace('-', "−");
    }
    format!("{}×10{}", trimmed(digits), superscript(exponent)).replace('-', "−")
}

/// A share as percent, three significant digits.
pub fn percent(share: Option<f64>) -> String {
    share.map_or(ABSENT.into(), |share| format!("{}\u{202f}%", figure(Some(100.0 * share))))
}

/// The same with a plus sign where it applies.
pub fn signed_percent(share: Option<f64>) -> String {
    let sign = if share.is_some_and(|share| share > 0.0) { "+" } else { "" };
    format!("{sign}{}", percent(share))
}

/// A whole number with a narrow space between thousands.
pub fn count(value: Option<u64>) -> String {
    let Some(value) = value else { return ABSENT.into() };
    let digits = value.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}

/// Wall time: milliseconds, seconds or minutes.
pub fn seconds(value: Option<f64>) -> String {
    match value {
        None => ABSENT.into(),
        Some(s) if s < 1.0 => format!("{}\u{202f}ms", figure(Some(1000.0 * s))),
        Some(s) if s < 120.0 => format!("{}\u{202f}s", figure(Some(s))),
        Some(s) => format!("{}\u{202f}min {:02}\u{202f}s", (s.round() / 60.0).floor(), s.round() % 60.0),
    }
}

/// Points per second with a metric prefix.
pub fn rate(value: Option<f64>) -> String {
    let Some(value) = value else { return ABSENT.into() };
    let (scale, prefix) =
        [(1e9, "G"), (1e6, "M"), (1e3, "k")].into_iter().find(|(scale, _)| value >= *scale).unwrap_or((1.0, ""));
    format!("{}\u{202f}{prefix}/s", figure(Some(value / scale)))
}

/// A ratio, `3.4×`.
pub fn ratio(value: Option<f64>) -> String {
    value.map_or(ABSENT.into(), |value| format!("{}×", figure(Some(value))))
}

/// Any JSON value in one line.
pub fn plain(value: &Value) -> String {
    match value {
        Value::Null => ABSENT.into(),
        Value::String(text) => text.clone(),
        Value::Number(number) => match number.as_u64() {
            Some(whole) => count(Some(whole)),
            None => figure(number.as_f64()),
        },
        Value::Bool(flag) => if *flag { "yes" } else { "no" }.into(),
        Value::Array(items) => items.iter().map(plain).collect::<Vec<_>>().join(", "),
        Value::Object(fields) => {
            fields.iter().map(|(key, item)| format!("{key} {}", plain(item))).collect::<Vec<_>>().join(", ")
        }
    }
}

/// The text with an upper case first letter.
pub fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map(|first| first.to_uppercase().chain(letters).collect()).unwrap_or_default()
}

fn trimmed(text: &str) -> &str {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { text }
}

fn superscript(exponent: i32) -> String {
    exponent
        .to_string()
        .chars()
        .map(|digit| match digit.to_digit(10) {
            Some(d) => ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][d as usize],
            None => '⁻',
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_three_digits() {
        let cases = [
            (0.0, "0"),
            (1.0, "1"),
            (51.3836, "51.4"),
            (-0.0257, "−0.0257"),
            (99_999.0, "1×10⁵"),
            (12_345.6, "12346"),
            (0.000_284_36, "2.84×10⁻⁴"),
            (-1e-12, "−1×10⁻¹²"),
            (f64::NAN, "NaN"),
        ];
        for (value, text) in cases {
            assert_eq!(figure(Some(value)), text);
        }
        assert_eq!(figure(None), ABSENT);
    }

    #[test]
    fn units_follow_the_size() {
        assert_eq!(count(Some(1_234_567)), "1\u{202f}234\u{202f}567");
        assert_eq!(seconds(Some(0.012)), "12\u{202f}ms");
        assert_eq!(seconds(Some(542.94)), "9\u{202f}min 03\u{202f}s");
        assert_eq!(rate(Some(12_300_000.0)), "12.3\u{202f}M/s");
        assert_eq!(ratio(Some(3.4)), "3.4×");
        assert_eq!(signed_percent(Some(0.000_407)), "+0.0407\u{202f}%");
    }
}
