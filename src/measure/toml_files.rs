//! Files that people write in TOML: reading them, with the place of what is wrong.

use crate::base::error::{Error, Result};

/// An error at a path within a file.
pub(crate) fn at(error: Error, place: &str, path: &str) -> Error {
    Error { place: format!("{place}, {path}"), ..error }
}

/// What to do about a file that cannot be read, by the reader's message. `variant` is what `defects` was once called.
pub(crate) fn remedy(message: &str, document: &str) -> String {
    if message.contains("unknown field `variant`") {
        return "Write defects = \"all\" in the place of \"as-published\", defects = \"none\" in that of \"fixed\"."
            .into();
    }
    format!("Correct it; {document} describes the format.")
}

/// Reads TOML; an error has the line and the path of what is wrong, and names the document that describes the format.
pub(crate) fn read_toml<T: serde::de::DeserializeOwned>(text: &str, place: &str, document: &str) -> Result<T> {
    let error = |cause: &toml::de::Error, path: Option<String>| {
        let line = cause.span().map(|span| text[..span.start.min(text.len())].lines().count().max(1));
        let mut place = line.map_or_else(|| place.to_owned(), |line| format!("{place}, line {line}"));
        if let Some(path) = path {
            place += &format!(", {path}");
        }
        Error::new(place, cause.message(), "a file of this kind", remedy(cause.message(), document))
    };
    let deserializer = toml::Deserializer::parse(text).map_err(|cause| error(&cause, None))?;
    serde_path_to_error::deserialize(deserializer).map_err(|cause| {
        let path = cause.path().to_string();
        error(&cause.into_inner(), Some(path))
    })
}
