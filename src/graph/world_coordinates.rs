//! What nodes of coordinates give in a world, where that is another value than in a volume.
//!
//! Measured with Cycles 5.0.1: Generated, Object and Position are the direction that is looked in, Normal, True Normal, Incoming and
//! Reflection its opposite, and UV is 0.

use crate::nodes::SourceValue;
use crate::scene::{Node, SocketType};

pub(super) const COORDINATES: &str = "ShaderNodeTexCoord";
pub(super) const GEOMETRY: &str = "ShaderNodeNewGeometry";

/// The negative of the direction.
const REVERSED: SourceValue =
    SourceValue::Affine([[-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]]);

/// What a node of coordinates gives in a world, where that is another value than in a volume.
pub(super) fn coordinate(node: &Node, output: &str) -> Option<(SocketType, SourceValue)> {
    let value = match (node.kind.as_str(), output) {
        // Cycles looks up a coordinate that a world lacks when it evaluates: nothing that reads it is folded.
        (COORDINATES, "UV") => SourceValue::PerObject(vec![0.0; 3]),
        (COORDINATES, "Normal" | "Reflection") | (GEOMETRY, "Normal" | "True Normal" | "Incoming") => REVERSED,
        _ => return None,
    };
    Some((SocketType::Vector, value))
}
