//! All that a scene file does wrong at once, by its schema: a reader stops at the first.

use crate::base::error::Error;
use jsonschema::error::ValidationErrorKind;
use jsonschema::{ValidationError, Validator};
use serde_json::Value as Json;
use std::sync::LazyLock;

/// As many as are listed.
const MOST: usize = 40;

/// The error that lists what the schema refuses in a document; none where that is not more than one thing, which the reader says better.
pub(super) fn all(document: &Json, place: &str) -> Option<Error> {
    static VALIDATOR: LazyLock<Option<Validator>> = LazyLock::new(|| jsonschema::validator_for(&super::schema()).ok());
    let validator = VALIDATOR.as_ref()?;
    let mut found: Vec<String> = validator.iter_errors(document).flat_map(|error| lines(&error)).collect();
    found.dedup();
    if found.len() < 2 {
        return None;
    }
    let further = found.len().saturating_sub(MOST);
    let listed: String = found.iter().take(MOST).map(|line| format!("\n  {line}")).collect();
    let rest = if further > 0 { format!("\n  and {further} more") } else { String::new() };
    Some(Error::new(
        place,
        format!("{} errors:{listed}{rest}\n", found.len()),
        "what the scene schema says (cloudparity schema prints it)",
        "Correct the values at these paths; docs/scene-format.md has a short example.",
    ))
}

/// A line per thing that is wrong.
fn lines(error: &ValidationError<'_>) -> Vec<String> {
    let at = error.instance_path().to_string();
    let place = json_path(&at);
    match error.kind() {
        ValidationErrorKind::Required { property } => {
            vec![format!("{place}: no {}", property.as_str().unwrap_or_default())]
        }
        ValidationErrorKind::AdditionalProperties { unexpected } => {
            unexpected.iter().map(|name| format!("{place}: \"{name}\", which is not known there")).collect()
        }
        ValidationErrorKind::AnyOf { context } | ValidationErrorKind::OneOfNotValid { context } => {
            // Of what may stand there, that which came closest: whose errors lie deepest, and are fewest.
            let depth = |branch: &Vec<ValidationError<'_>>| {
                branch.iter().map(|error| error.instance_path().to_string().matches('/').count()).max().unwrap_or(0)
            };
            let of_type = |branch: &&Vec<ValidationError<'_>>| {
                !branch.iter().any(|error| {
                    matches!(error.kind(), ValidationErrorKind::Type { .. }) && error.instance_path().to_string() == at
                })
            };
            let mut branches: Vec<&Vec<ValidationError<'_>>> = context.iter().filter(of_type).collect();
            branches.sort_by_key(|branch| (std::cmp::Reverse(depth(branch)), branch.len()));
            match branches.first() {
                Some(branch) => branch.iter().flat_map(lines).collect(),
                None => vec![format!("{place}: {error}")],
            }
        }
        _ => vec![format!("{place}: {error}")],
    }
}

/// A JSON pointer as the other errors write places.
fn json_path(pointer: &str) -> String {
    let mut path = String::from("$");
    for part in pointer.split('/').skip(1) {
        let part = part.replace("~1", "/").replace("~0", "~");
        if part.parse::<usize>().is_ok() {
            path += &format!("[{part}]");
        } else {
            path += &format!(".{part}");
        }
    }
    path
}
