//! How a report writes numbers and words: few digits, thin spaces between thousands, powers of ten.

use serde_json::Value;

/// Stands for a figure that was not measured.
pub const ABSENT: &str = "–";

/// Three significant digits; `2.84×10⁻⁴` below 0.001 and from 100 000 on.
pub fn figure(value: Option<f64>) -> String {
    let Some(value) = value else { return ABSENT.into() };
    if !value.is_finite() {
        return if value.is_nan() {
            "NaN"
        } else if value > 0.0 {
            "∞"
        } else {
            "−∞"
        }
        .into();
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

/// A figure with its standard error in units of its last digit: `0.0779(9)`, `2.34(5)×10⁻⁴`.
///
/// Digits by the rule of the Particle Data Group (Review of Particle Physics, Introduction, section 5.3, "Rounding"): of the three leading
/// digits of the error, 100 to 354 are rounded to two digits, 355 to 949 to one, 950 to 999 to 1000 of which two are kept; the figure has the
/// same last place. An error of 0 means that the figure is exact, so it stands alone; of an error that is no number the brackets say so.
pub fn uncertain(value: f64, standard_error: f64) -> String {
    uncertain_with(value, standard_error, true)
}

/// The same; small figures have a power of ten only where `powers` is true, so that those of a column can do without.
pub fn uncertain_with(value: f64, standard_error: f64, powers: bool) -> String {
    if !value.is_finite() || standard_error == 0.0 {
        return figure(Some(value));
    }
    if !standard_error.is_finite() || standard_error < 0.0 {
        return format!("{}(NaN)", figure(Some(value)));
    }
    let (digits, place) = leading_digits(standard_error);
    let exponent = exponent_of(value).max(exponent_of(standard_error));
    if place > 0 || (powers && exponent < -3) {
        let exponent = exponent.max(place);
        let decimals = usize::try_from(exponent - place).unwrap_or(0);
        let mantissa = plain_zero(format!("{:.decimals$}", value / 10_f64.powi(exponent)));
        return format!("{mantissa}({digits})×10{}", superscript(exponent)).replace('-', "−");
    }
    let decimals = usize::try_from(-place).unwrap_or(0);
    format!("{}({digits})", plain_zero(format!("{value:.decimals$}"))).replace('-', "−")
}

/// One or two digits of an error above 0 and the power of ten of the last of them.
fn leading_digits(error: f64) -> (u32, i32) {
    let (three, exponent) = rounded(error, 2);
    match three {
        100..=354 => {
            let (digits, exponent) = rounded(error, 1);
            (digits, exponent - 1)
        }
        355..=949 => rounded(error, 0),
        _ => (10, exponent),
    }
}

/// A number above 0 rounded to so many digits behind its first: all digits as a whole number, and the power of ten of the first.
fn rounded(value: f64, behind: usize) -> (u32, i32) {
    let text = format!("{value:.behind$e}");
    let (digits, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    (digits.replace('.', "").parse().unwrap_or(0), exponent.parse().unwrap_or(0))
}

/// The power of ten of a number's first digit; that of 0 is below all.
fn exponent_of(value: f64) -> i32 {
    if value == 0.0 { i32::MIN } else { rounded(value.abs(), 2).1 }
}

/// A number without the sign of a zero.
fn plain_zero(text: String) -> String {
    if text.contains(|letter: char| letter.is_ascii_digit() && letter != '0') { text } else { text.replace('-', "") }
}

/// Numbers of one column, at one precision: all with as many decimals as show two digits of the smallest and three of the largest, or all with
/// a power of ten and three digits where their sizes are too small or too far apart for that. Whole numbers stay whole.
pub fn column(values: &[f64]) -> Vec<String> {
    let sizes = || values.iter().copied().filter(|value| value.is_finite() && *value != 0.0).map(exponent_of);
    let (smallest, largest) = (sizes().min().unwrap_or(0), sizes().max().unwrap_or(0));
    let is_whole = |value: &f64| !value.is_finite() || (value.fract() == 0.0 && value.abs() < 1e6);
    let has_powers = smallest < -4 || largest > 5 || largest - smallest > 5;
    let decimals = usize::try_from((1 - smallest).max(2 - largest)).unwrap_or(0);
    let show = |&value: &f64| match value {
        value if !value.is_finite() => figure(Some(value)),
        0.0 => "0".into(),
        value if values.iter().all(is_whole) => format!("{value:.0}").replace('-', "−"),
        value if has_powers => {
            let text = format!("{value:.2e}");
            let (digits, exponent) = text.split_once('e').unwrap_or((&text, "0"));
            format!("{digits}×10{}", superscript(exponent.parse().unwrap_or(0))).replace('-', "−")
        }
        value => plain_zero(format!("{value:.decimals$}")).replace('-', "−"),
    };
    values.iter().map(show).collect()
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

    /// What the notebooks' Python is held to, too.
    const UNCERTAIN: &str = include_str!("../../parity/uncertain-figures.json");

    #[test]
    fn uncertain_figures_are_rounded_by_the_rule_of_the_particle_data_group() {
        let cases: Vec<(String, Option<f64>, Option<f64>, String)> = serde_json::from_str(UNCERTAIN).expect("cases");
        assert!(cases.len() > 20);
        for (what, value, error, text) in cases {
            let [value, error] = [value, error].map(|number| number.unwrap_or(f64::NAN));
            assert_eq!(uncertain(value, error), text, "{what}: {value} {error}");
        }
        assert_eq!(uncertain(f64::NEG_INFINITY, 1.0), "−∞");
        assert_eq!(uncertain(1.0, f64::INFINITY), "1(NaN)");
        assert_eq!(uncertain_with(0.000_234_12, 0.000_005_2, false), "0.000234(5)");
    }

    #[test]
    fn a_column_has_one_precision() {
        assert_eq!(column(&[9.014, 10.2, 15.33]), ["9.0", "10.2", "15.3"]);
        assert_eq!(column(&[0.164, 0.087, 0.0539]), ["0.164", "0.087", "0.054"]);
        assert_eq!(column(&[-0.001, 1.0]), ["−0.0010", "1.0000"]);
        assert_eq!(column(&[5.06e-7, 0.0, 0.612]), ["5.06×10⁻⁷", "0", "6.12×10⁻¹"]);
        assert_eq!(column(&[1.0, 320.0, 0.0]), ["1", "320", "0"]);
        assert_eq!(column(&[0.5, f64::NAN, f64::INFINITY]), ["0.500", "NaN", "∞"]);
        assert_eq!(column(&[]), Vec::<String>::new());
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
