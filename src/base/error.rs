//! The one error type: where it happened, what was found there, what was expected, what to do.

use std::borrow::Cow;

/// A failure that a user can act on.
///
/// Every field is a short phrase; [`std::fmt::Display`] joins them, with control characters of
/// names escaped: no name of a file or of something in it breaks a line or speaks to the terminal.
/// Lines that [`Error::found`] lists begin with two spaces and stay lines. The library never prints
/// and never panics on input: it returns this, and the program's edge prints it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{}: found {}; expected {}. {}",
    plain_line(place),
    plain_lines(found),
    plain_line(expected),
    plain_line(remedy)
)]
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
        }
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
