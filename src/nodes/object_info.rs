//! Object Info (`ShaderNodeObjectInfo`): place, colour, indices and a random number of the shaded object.
//!
//! They are the same at every point, but Cycles looks them up while it renders: nothing that reads them is folded. Random is a
//! hash of the object's name; instances, which take it from their instancer, do not exist here.

use crate::base::error::Error;
use crate::nodes::hash::jenkins;
use crate::nodes::real::Real;
use crate::nodes::{NodeType, OutputSocket, Role, SourceValue, always};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeObjectInfo",
    label: "Object Info",
    module: "object_info",
    shader: "",
    properties: &[],
    inputs: &[],
    outputs: &[
        OutputSocket::new("Location", SocketType::Vector, always),
        OutputSocket::new("Color", SocketType::Color, always),
        OutputSocket::new("Alpha", SocketType::Float, always),
        OutputSocket::new("Object Index", SocketType::Float, always),
        OutputSocket::new("Material Index", SocketType::Float, always),
        OutputSocket::new("Random", SocketType::Float, always),
    ],
    role: Role::Source(|context, _, output| {
        let volume = context.volume;
        let [red, green, blue, alpha] = volume.color;
        Ok(SourceValue::PerObject(match output {
            "Location" => volume.matrix_world[..3].iter().map(|row| row[3]).collect(),
            "Color" => vec![red, green, blue],
            "Alpha" => vec![alpha],
            "Object Index" => vec![volume.pass_index as f32],
            "Material Index" => vec![volume.material_pass_index as f32],
            "Random" => vec![random_of(&volume.object)],
            other => {
                return Err(Error::new(
                    format!("{}: output {other}", context.place),
                    format!("the {other} output of Object Info"),
                    "Location, Color, Alpha, Object Index, Material Index or Random",
                    "Use one of these outputs.",
                ));
            }
        }))
    }),
};

/// The number in [0, 1] of an object's name.
fn random_of(name: &str) -> f32 {
    let identity = name.bytes().fold(0_u32, |hash, byte| hash.wrapping_mul(37).wrapping_add(u32::from(byte)));
    f32::from_hash_32(jenkins([identity, 0]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_the_numbers_of_cycles() {
        assert_eq!(random_of("Cube"), 0.313_141_94);
        assert_eq!(random_of("v"), 0.761_823);
    }
}
