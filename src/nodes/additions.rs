//! Values of choice properties that came after Blender 5.0.
//!
//! [`crate::nodes::PropertyValues::Choice`] lists what 5.0 offers, so that what is drawn from these lists stays the same.

use crate::base::error::{Error, Result};
use crate::scene::Release;
use serde_json::{Map, Value as Json};

/// A value that a release of Blender added.
pub struct Addition {
    /// Blender's `bl_idname` of the node.
    pub type_name: &'static str,
    /// The choice property.
    pub property: &'static str,
    /// The value.
    pub value: &'static str,
    /// The first release that has it.
    pub since: Release,
}

/// Every addition.
pub static ADDITIONS: &[Addition] =
    &[Addition { type_name: "ShaderNodeVectorMath", property: "operation", value: "ROUND", since: Release::V5_1 }];

/// The values that were added to a property, oldest first.
pub fn of(type_name: &str, property: &str) -> impl Iterator<Item = &'static Addition> {
    ADDITIONS.iter().filter(move |addition| addition.type_name == type_name && addition.property == property)
}

/// Rejects a value that the release whose values the graph has does not know. `place` names the node.
pub fn check(type_name: &str, properties: &Map<String, Json>, release: Release, place: &str) -> Result<()> {
    let is_set = |addition: &&Addition| {
        addition.type_name == type_name
            && properties.get(addition.property).and_then(Json::as_str) == Some(addition.value)
            && addition.since > release
    };
    let Some(Addition { property, value, since, .. }) = ADDITIONS.iter().find(is_set) else { return Ok(()) };
    Err(Error::new(
        format!("{place}: property {property}"),
        format!("{value}, which Blender {since} added, in a graph with the values of {release}"),
        format!("values of {since} or later"),
        format!("Export the .blend with the values of {since}, or write \"blender\": \"{since}\" into the graph."),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn an_addition_needs_values_of_its_release() {
        let properties = json!({"operation": "ROUND"});
        let check = |release| check("ShaderNodeVectorMath", properties.as_object().expect("one"), release, "node N");
        for release in [Release::V4_5, Release::V5_0] {
            let error = check(release).expect_err("rejected").to_string();
            assert!(error.contains("node N: property operation") && error.contains("the values of 5.1"), "{error}");
        }
        for release in [Release::V5_1, Release::V5_2, Release::V5_3] {
            assert_eq!(check(release), Ok(()));
        }
    }
}
