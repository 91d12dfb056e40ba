//! The node graph of a world: what each direction sends.
//!
//! A world is evaluated where a ray leaves the scene. Its position is the unit vector of the ray's travel, and the same are
//! Generated and Object; Normal, True Normal, Incoming and Reflection are its negative, and UV is 0 (measured with
//! Blender 5.0.1 over a sphere of directions: equal to 1e-6). Object with another object chosen is the direction as a
//! position in that object's frame. A Background is an emission: Color * Strength, negative ones too.

use crate::base::error::{Error, Result};
use crate::graph::evaluate::Shared;
use crate::graph::flatten::with_flattener;
use crate::graph::world_coordinates::{COORDINATES, GEOMETRY};
use crate::graph::{Program, passes};
use crate::nodes::{self, NodeType, Role, emission};
use crate::scene::{Graph, Node, SocketType, TextureSpace, Volume};
use glam::DVec3;
use serde_json::{Value as Json, json};

const BACKGROUND: &str = "ShaderNodeBackground";
/// Types that join closures in a world.
const JOINING: [&str; 2] = ["ShaderNodeAddShader", "ShaderNodeMixShader"];

/// Types that evaluate in a volume, but whose values in a world are not known: the spaces of Vector Transform are those
/// of the shaded object and of the camera.
const LEFT_OUT: [&str; 1] = ["ShaderNodeVectorTransform"];

/// Stands for the shaded object: a frame in which Generated, too, is the position.
pub(super) fn directions() -> Volume {
    Volume { texture_space: TextureSpace { location: [0.5; 3], size: [0.5; 3] }, ..Volume::default() }
}

/// The type of a node that a closure comes from; any value emits.
pub(super) fn closure_type(node: &Node, place: &str) -> Result<&'static NodeType> {
    if node.kind == BACKGROUND {
        return Ok(&emission::TYPE);
    }
    let node_type = nodes::find(&node.kind).ok_or_else(|| nodes::refused::error(place.to_owned(), &node.kind))?;
    let fits = !matches!(node_type.role, Role::Closure(_))
        || node.kind == emission::TYPE.type_name
        || JOINING.contains(&node.kind.as_str());
    if fits {
        return Ok(node_type);
    }
    Err(Error::new(
        place.to_owned(),
        format!("{}, which fills a volume", node_type.label),
        "Background, Emission, Add Shader or Mix Shader, or a colour",
        "Make the world of these, or export it as a picture of its nodes.",
    ))
}

/// The node types of a world that are evaluated, each with the outputs that are, or null for all:
/// `{"ShaderNodeTexNoise": null, "ShaderNodeTexCoord": ["Generated", ...]}`.
pub fn vocabulary() -> serde_json::Map<String, Json> {
    let evaluated = nodes::registry().iter().filter(|node_type| matches!(node_type.role, Role::Evaluated(_)));
    let names = evaluated.map(|node_type| node_type.type_name).filter(|name| !LEFT_OUT.contains(name));
    let plain = ["ShaderNodeValue", "ShaderNodeRGB", emission::TYPE.type_name, BACKGROUND].into_iter().chain(JOINING);
    let mut types: serde_json::Map<String, Json> =
        names.chain(plain).map(|name| (name.to_owned(), Json::Null)).collect();
    types.insert(COORDINATES.into(), json!(["Generated", "Normal", "UV", "Object", "Reflection"]));
    types.insert(GEOMETRY.into(), json!(["Position", "Normal", "True Normal", "Incoming"]));
    types
}

impl Program {
    /// Compiles the graph of a world: one colour, the radiance that arrives against the direction of travel given as position.
    pub fn world(graph: &Graph) -> Result<Self> {
        let shaded = directions();
        let (mut flat, radiance) = with_flattener(graph, &shaded, |flattener| {
            flattener.is_world = true;
            flattener.world_radiance()
        })?;
        flat.outputs.push(("world".into(), SocketType::Color, radiance));
        Ok(passes::run(flat))
    }
}

/// What a world sends, by direction.
pub struct WorldValues {
    values: Shared,
    hash: String,
}

impl WorldValues {
    /// Compiles the graph of a world.
    pub fn compile(graph: &Graph) -> Result<Self> {
        let program = Program::world(graph)?;
        let hash = program.content_hash();
        Ok(Self { values: Shared::new(program)?, hash })
    }

    /// The program of the graph ([`Program::world`]).
    pub fn program(&self) -> &Program {
        self.values.program()
    }

    /// Calls `see` with the radiance from each of these directions, unit vectors that point away from the scene, in their
    /// order. The bits are those of Cycles; what is no finite number is 0.
    pub fn radiance(&self, directions: &[DVec3], mut see: impl FnMut(usize, [f64; 3])) {
        let positions: Vec<[f32; 3]> = directions.iter().map(|direction| direction.as_vec3().to_array()).collect();
        self.values.evaluate(&positions, |values| {
            for (number, radiance) in values.as_chunks::<3>().0.iter().enumerate() {
                see(number, radiance.map(|value| if value.is_finite() { f64::from(value) } else { 0.0 }));
            }
        });
    }
}

impl std::fmt::Debug for WorldValues {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("WorldValues").field("hash", &self.hash).finish_non_exhaustive()
    }
}

impl PartialEq for WorldValues {
    fn eq(&self, other: &Self) -> bool {
        self.hash == other.hash
    }
}
