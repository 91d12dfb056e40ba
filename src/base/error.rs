//! The one error type: where it happened, what was found there, what was expected, what to do.

/// A failure that a user can act on.
///
/// Every field is a short phrase; [`std::fmt::Display`] joins them into one line. The library
/// never prints and never panics on input: it returns this, and the program's edge prints it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{place}: found {found}; expected {expected}. {remedy}")]
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
