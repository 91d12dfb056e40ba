//! Published values of closed forms, where they are there.

use serde_json::Value;

/// The values of a file; `None` where they are missing.
pub fn published(name: &str) -> Option<Value> {
    let path = super::project(&format!("../shared/golden/encyclopedia/{name}.json"));
    let Ok(text) = std::fs::read_to_string(&path) else {
        eprintln!("skipped: {} is missing", path.display());
        return None;
    };
    Some(serde_json::from_str(&text).expect("JSON"))
}

/// A list of numbers.
pub fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|item| item.as_f64().expect("a number")).collect()
}
