//! Node types that a program adds to the registry at run time: those of other crates, and those of tests.
//!
//! An added type is a node like any other: the compiler, the evaluators, the linker of shaders, the comparison with Cycles and the
//! table of nodes find it in the registry. It cannot be removed again, because programs hold on to their types.

use crate::base::error::{Error, Result};
use crate::nodes::NodeType;
use std::sync::{PoisonError, RwLock};

/// Types that the compiler treats by name, before it asks the registry.
const STRUCTURE: [&str; 6] =
    ["NodeFrame", "NodeGroupInput", "NodeGroupOutput", "NodeReroute", "ShaderNodeGroup", "ShaderNodeOutputMaterial"];

/// The built-in types with the added ones behind them; empty while nothing was added.
static EXTENDED: RwLock<&'static [&'static NodeType]> = RwLock::new(&[]);

/// The built-in types, or these and the added ones.
pub(super) fn all(built_in: &'static [&'static NodeType]) -> &'static [&'static NodeType] {
    let extended = *EXTENDED.read().unwrap_or_else(PoisonError::into_inner);
    if extended.is_empty() { built_in } else { extended }
}

/// Adds a node type to the registry, for the rest of the process.
///
/// Type name, label and module have to be its own: files name a node by the first, commands by the second, and shaders keep
/// instances apart by the third.
///
/// ```
/// use cloudparity::nodes::{self, NodeType, Role, SourceValue};
///
/// static HALF: NodeType = NodeType {
///     type_name: "example.Half",
///     label: "Half",
///     module: "half",
///     shader: "",
///     properties: &[],
///     inputs: &[],
///     outputs: &[nodes::OutputSocket::new("Value", cloudparity::scene::SocketType::Float, nodes::always)],
///     role: Role::Source(|_, _, _| Ok(SourceValue::Constant(vec![0.5]))),
/// };
/// nodes::register(&HALF).expect("nothing else has this name");
/// assert!(nodes::find("example.Half").is_some());
/// assert!(nodes::register(&HALF).is_err());
/// ```
pub fn register(node_type: &'static NodeType) -> Result<()> {
    let built_in = super::registry();
    let mut extended = EXTENDED.write().unwrap_or_else(PoisonError::into_inner);
    // What another thread has added since is in `extended`.
    let known = if extended.is_empty() { built_in } else { *extended };
    let refused = |found: String, expected: &str| {
        Err(Error::new(
            format!("node type {}", node_type.type_name),
            found,
            expected,
            "Give the type names of its own, and register it once.",
        ))
    };
    if STRUCTURE.contains(&node_type.type_name) {
        return refused("a type that the compiler resolves itself".into(), "a node that evaluates, or a closure");
    }
    type Name = fn(&NodeType) -> &'static str;
    let names: [Name; 3] = [|known| known.type_name, |known| known.label, |known| known.module];
    for (what, name) in ["type name", "label", "module"].into_iter().zip(names) {
        if known.iter().any(|known| name(known) == name(node_type)) {
            return refused(
                format!("the {what} \"{}\", which the registry holds already", name(node_type)),
                "a type name, a label and a module that no other type has",
            );
        }
    }
    let longer: Vec<&'static NodeType> = known.iter().copied().chain([node_type]).collect();
    // Leaked once per added type: the registry is borrowed for as long as the process lives.
    *extended = Box::leak(longer.into_boxed_slice());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::{registry, value};

    #[test]
    fn what_is_known_is_refused() {
        let before = registry().len();
        let error = register(&value::TYPE).expect_err("Value is built in");
        assert!(error.to_string().contains("type name \"ShaderNodeValue\""), "{error}");
        assert_eq!(registry().len(), before);
    }

    #[test]
    fn names_of_the_registry_are_unique() {
        let all = registry();
        for (number, one) in all.iter().enumerate() {
            for other in &all[..number] {
                assert_ne!(one.type_name, other.type_name);
                assert_ne!(one.label, other.label);
                assert_ne!(one.module, other.module);
            }
            assert!(!STRUCTURE.contains(&one.type_name), "{}", one.type_name);
        }
    }
}
