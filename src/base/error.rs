//! The one error type: where it happened, what was found there, what was expected, what to do.

use std::borrow::Cow;

/// A failure that a user can act on.
///
/// Every field is a short phrase; [`std::fmt::Display`] joins them, with control characters of
/// names escaped: no name of a file or of something in it breaks a line or speaks to the terminal.
/// Lines that [`Error::found`] lists begin with two spaces and stay lines. The library never prints
/// and never panics on input: it returns this, and the program's edge prints it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}", described(self))]
pub struct Error {
    /// File, JSON path, line, node or command line argument.
    pub place: String,
    /// What was there.
    pub found: String,
    /// What should have been there.
    pub expected: String,
    /// The next step for the user.
    pub remedy: String,
    /// Names of the settings that the remedy speaks of, such as `density_cache`: whoever asked knows how they are given, the command line
    /// by its options, a window by its sliders.
    pub settings: Vec<&'static str>,
    /// Further faults of the same input, none of which has others: whoever mends it learns of all at once.
    pub others: Vec<Error>,
}

/// One line; of several faults a line that counts them and a numbered line each.
fn described(error: &Error) -> String {
    let line = |Error { place, found, expected, remedy, .. }: &Error| {
        let [place, expected, remedy] = [place, expected, remedy].map(|text| plain_line(text));
        format!("{place}: found {}; expected {expected}. {remedy}", plain_lines(found))
    };
    if error.others.is_empty() {
        return line(error);
    }
    let faults = std::iter::once(error).chain(&error.others);
    let lines: String =
        faults.enumerate().map(|(index, fault)| format!("\n  {}. {}", index + 1, line(fault))).collect();
    format!("{} faults:{lines}", 1 + error.others.len())
}

/// The result type of the whole library.
pub type Result<T> = std::result::Result<T, Error>;

/// A text in one line: control characters escaped as in Rust, `\n` for a line break.
pub fn plain_line(text: &str) -> Cow<'_, str> {
    if !text.chars().any(is_escaped) {
        return Cow::Borrowed(text);
    }
    let one = |c: char| if is_escaped(c) { c.escape_default().to_string() } else { c.to_string() };
    Cow::Owned(text.chars().map(one).collect())
}

/// Control characters, and those that turn the direction of text or break lines elsewhere.
fn is_escaped(c: char) -> bool {
    c.is_control() || matches!(c, '\u{2028}' | '\u{2029}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// The same of a text that may list things: line breaks before two spaces, and at the end, stay.
pub fn plain_lines(text: &str) -> Cow<'_, str> {
    if !text.contains('\n') {
        return plain_line(text);
    }
    let (body, end) = text.strip_suffix('\n').map_or((text, ""), |body| (body, "\n"));
    let lines: Vec<Cow<'_, str>> = body.split("\n  ").map(plain_line).collect();
    Cow::Owned(lines.join("\n  ") + end)
}

impl Error {
    /// Builds an error from its four parts. What was found may be an empty text of a file, which is said.
    pub fn new(
        place: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        let found = found.into();
        Self {
            place: place.into(),
            found: if found.trim().is_empty() { "an empty text".to_owned() } else { found },
            expected: expected.into(),
            remedy: remedy.into(),
            settings: Vec::new(),
            others: Vec::new(),
        }
    }

    /// Several faults of one input as one error; each is reported once. `None` where there is none.
    pub fn of_all(faults: impl IntoIterator<Item = Self>) -> Option<Self> {
        let mut distinct: Vec<Self> = Vec::new();
        for mut fault in faults {
            let others = std::mem::take(&mut fault.others);
            for fault in std::iter::once(fault).chain(others) {
                if !distinct.contains(&fault) {
                    distinct.push(fault);
                }
            }
        }
        let mut distinct = distinct.into_iter();
        let first = distinct.next()?;
        Some(Self { others: distinct.collect(), ..first })
    }

    /// The error with every fault's place changed: whoever calls knows the file that it is in.
    #[must_use]
    pub fn map_place(self, mut change: impl FnMut(String) -> String) -> Self {
        let others = self.others.into_iter().map(|fault| Self { place: change(fault.place), ..fault }).collect();
        Self { place: change(self.place), others, ..self }
    }

    /// Names a setting that the remedy speaks of.
    #[must_use]
    pub fn with_setting(mut self, setting: &'static str) -> Self {
        self.settings.push(setting);
        self
    }

    /// An operating system failure on a file.
    pub fn io(path: &std::path::Path, expected: &str, cause: &std::io::Error) -> Self {
        Self::new(
            path.display().to_string(),
            cause.to_string(),
            expected,
            "Check the path, its permissions and the free space.",
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_do_not_break_lines() {
        let error = Error::new("a\nb\x1b[31m.json", "\"x\ny\"", "e\t", "Do\r it.");
        assert_eq!(error.to_string(), r#"a\nb\u{1b}[31m.json: found "x\ny"; expected e\t. Do\r it."#);
        let list = Error::new("f", "2 errors:\n  $.a: \"p\nq\"\n  $.b\n", "é ß", "R.");
        assert_eq!(list.to_string(), "f: found 2 errors:\n  $.a: \"p\\nq\"\n  $.b\n; expected é ß. R.");
    }
}
