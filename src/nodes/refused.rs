//! What of Blender's shader nodes is refused, why, and what comes nearest to it.
//!
//! Whole node types ([`NODES`]) and parts of node types that are otherwise supported ([`PARTS`]). A value is never put in the
//! place of a refused one: a graph that holds it where it reaches the volume is an error; elsewhere it does not matter.
//! Type names and labels are those of Blender 5.0.1, and of 5.3.0 what came later.

use crate::base::error::Error;

/// A node type that is refused.
pub struct RefusedNode {
    /// Blender's `bl_idname`.
    pub type_name: &'static str,
    /// Blender's label.
    pub label: &'static str,
    /// Why, as the end of the sentence "the node ...".
    pub reason: &'static str,
    /// The nearest thing that is possible: a sentence.
    pub instead: &'static str,
}

/// A part of a supported node type that is refused.
pub struct RefusedPart {
    /// Blender's `bl_idname` of the node.
    pub type_name: &'static str,
    /// Which part.
    pub part: Part,
    /// Why, as the end of the sentence "the part ...".
    pub reason: &'static str,
    /// The nearest thing that is possible: a sentence.
    pub instead: &'static str,
}

/// A part of a node type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// An output socket, by identifier.
    Output(&'static str),
    /// A property with this value; flags have the values "true" and "false".
    Setting(&'static str, &'static str),
}

const fn node(
    type_name: &'static str,
    label: &'static str,
    reason: &'static str,
    instead: &'static str,
) -> RefusedNode {
    RefusedNode { type_name, label, reason, instead }
}

const fn output(
    type_name: &'static str,
    identifier: &'static str,
    reason: &'static str,
    instead: &'static str,
) -> RefusedPart {
    RefusedPart { type_name, part: Part::Output(identifier), reason, instead }
}

const fn setting(
    type_name: &'static str,
    property: &'static str,
    value: &'static str,
    reason: &'static str,
    instead: &'static str,
) -> RefusedPart {
    RefusedPart { type_name, part: Part::Setting(property, value), reason, instead }
}

const ZONE: &str = "is an end of a zone, which Blender rolls out before it renders, by rules that were not measured";
const ZONE_INSTEAD: &str = "Make a node group of what the zone holds, and use it once per round.";
const BUNDLE: &str = "packs several values into one link, which Blender takes apart before it renders";
const BUNDLE_INSTEAD: &str = "Link the values one by one.";
const CLOSURE_ZONE: &str = "belongs to a zone that hands a part of the graph on as a value";
const CLOSURE_ZONE_INSTEAD: &str = "Make a node group of the zone and use it where the zone is evaluated.";
const SURFACE: &str = "describes the light at a surface, and a volume has none";
const SURFACE_INSTEAD: &str =
    "Close the volume with Principled Volume, Volume Scatter, Volume Absorption, Volume Coefficients or Emission.";
const EEVEE: &str = "exists in EEVEE only; Cycles renders nothing with it";
const RAYS: &str = "traces rays against surfaces, so that it is no function of the point";
const FALLOFF_INSTEAD: &str =
    "Take a distance instead: Texture Coordinate, Object, then Vector Math, Length, and Map Range.";
const NORMAL: &str = "compares the ray with the normal of a surface, and a volume has none";
const FACTOR_INSTEAD: &str = "Store the factor in a Value node.";
const DIRECTION_INSTEAD: &str = "Store the direction in a Combine XYZ or a Normal node.";
const MOVED_INSTEAD: &str =
    "Move the coordinates of the textures instead: Vector Math, Add, before their Vector inputs.";
const GEOMETRY: &str = "reads data of a geometry that a volume does not have";
const NUMBER_INSTEAD: &str = "Store the number in a Value node, or the colour in a Color node.";
const OTHER_OUTPUT: &str = "ends a shader of something else than a material, so that it cannot close a volume";
const OTHER_OUTPUT_INSTEAD: &str = "Close the volume at the input Volume of a Material Output.";
const LINE_STYLE: &str = "belongs to the line styles of Freestyle";
const FILE: &str = "reads a file";
const PICTURE_INSTEAD: &str =
    "Rebuild it from procedural textures, or bake the density into an OpenVDB grid and use a Volume object.";

/// Every refused node type, by type name.
pub static NODES: &[RefusedNode] = &[
    node(
        "GeometryNodeMenuSwitch",
        "Menu Switch",
        "chooses by a menu, which Blender resolves before it renders, by rules that were not measured",
        "Link the chosen input itself, or choose with Mix and a factor of 0 or 1.",
    ),
    node("GeometryNodeRepeatInput", "Repeat Input", ZONE, ZONE_INSTEAD),
    node("GeometryNodeRepeatOutput", "Repeat Output", ZONE, ZONE_INSTEAD),
    node("NodeClosureInput", "Closure Input", CLOSURE_ZONE, CLOSURE_ZONE_INSTEAD),
    node("NodeClosureOutput", "Closure Output", CLOSURE_ZONE, CLOSURE_ZONE_INSTEAD),
    node("NodeCombineBundle", "Combine Bundle", BUNDLE, BUNDLE_INSTEAD),
    node("NodeEvaluateClosure", "Evaluate Closure", CLOSURE_ZONE, CLOSURE_ZONE_INSTEAD),
    node("NodeSeparateBundle", "Separate Bundle", BUNDLE, BUNDLE_INSTEAD),
    node("ShaderNodeAmbientOcclusion", "Ambient Occlusion", RAYS, FALLOFF_INSTEAD),
    node(
        "ShaderNodeAttribute",
        "Attribute",
        "reads data of a geometry, an instancer or a view layer; only the density grid of a Volume object is known here",
        "Use a Volume object and the output Fac with the name density, or store the number in a Value node.",
    ),
    node(
        "ShaderNodeBackground",
        "Background",
        "lights the world and fills no volume",
        "Let the volume itself shine with Emission; the world's colour is a field of the scene file.",
    ),
    node("ShaderNodeBevel", "Bevel", RAYS, DIRECTION_INSTEAD),
    node("ShaderNodeBsdfAnisotropic", "Glossy BSDF", SURFACE, SURFACE_INSTEAD),
    node("ShaderNodeBsdfDiffuse", "Diffuse BSDF", SURFACE, SURFACE_INSTEAD),
    node("ShaderNodeBsdfGlass", "Glass BSDF", SURFACE, SURFACE_INSTEAD),
    node("ShaderNodeBsdfHair", "Hair BSDF", SURFACE, SURFACE_INSTEAD),
    node("ShaderNodeBsdfHairPrincipled", "Principled Hair BSDF", SURFACE, SURFACE_INSTEAD),
    node("ShaderNodeBsdfMetallic", "Metallic BSDF", SURFACE, SURFACE_INSTEAD),
    node("ShaderNodeBsdfPrincipled", "Principled BSDF", SURFACE, SURFACE_INSTEAD),
    node("ShaderNodeBsdfRayPortal", "Ray Portal BSDF", SURFACE, SURFACE_INSTEAD),
    node("ShaderNodeBsdfRefraction", "Refraction BSDF", SURFACE, SURFACE_INSTEAD),
    node("ShaderNodeBsdfSheen", "Sheen BSDF", SURFACE, SURFACE_INSTEAD),
    node("ShaderNodeBsdfToon", "Toon BSDF", SURFACE, SURFACE_INSTEAD),
    node("ShaderNodeBsdfTranslucent", "Translucent BSDF", SURFACE, SURFACE_INSTEAD),
    node("ShaderNodeBsdfTransparent", "Transparent BSDF", SURFACE, "Leave the input Volume, or this branch, unlinked."),
    node("ShaderNodeBump", "Bump", "turns the normal of a surface, and a volume has none", MOVED_INSTEAD),
    node(
        "ShaderNodeCameraData",
        "Camera Data",
        "depends on the camera and on the ray, so that it is no function of the point",
        "Use Texture Coordinate, output Object, with the camera as its object: its Z is the negative view depth, its \
         length the view distance.",
    ),
    node("ShaderNodeDisplacement", "Displacement", "moves a surface, and a volume has none", MOVED_INSTEAD),
    node("ShaderNodeEeveeSpecular", "Specular BSDF", EEVEE, SURFACE_INSTEAD),
    node("ShaderNodeFresnel", "Fresnel", NORMAL, FACTOR_INSTEAD),
    node("ShaderNodeHairInfo", "Curves Info", GEOMETRY, NUMBER_INSTEAD),
    node("ShaderNodeHoldout", "Holdout", SURFACE, SURFACE_INSTEAD),
    node("ShaderNodeLayerWeight", "Layer Weight", NORMAL, FACTOR_INSTEAD),
    node(
        "ShaderNodeLightFalloff",
        "Light Falloff",
        "shapes the light of a lamp and has no meaning in a volume",
        FALLOFF_INSTEAD,
    ),
    node(
        "ShaderNodeLightPath",
        "Light Path",
        "depends on the ray, so that a density made of it is no field",
        "Store what holds for the wanted rays in a Value node: 1 for Is Camera Ray in a picture of single scattering.",
    ),
    node(
        "ShaderNodeNormalMap",
        "Normal Map",
        "turns the normal of a surface by its texture coordinates, and a volume has neither",
        DIRECTION_INSTEAD,
    ),
    node(
        "ShaderNodeOutputAOV",
        "AOV Output",
        "writes a render pass and feeds nothing, so that it cannot reach the volume",
        "Ask for the value by its target, NODE.SOCKET (`cloudparity eval`).",
    ),
    node("ShaderNodeOutputLight", "Light Output", OTHER_OUTPUT, OTHER_OUTPUT_INSTEAD),
    node("ShaderNodeOutputLineStyle", "Line Style Output", OTHER_OUTPUT, OTHER_OUTPUT_INSTEAD),
    node("ShaderNodeOutputWorld", "World Output", OTHER_OUTPUT, OTHER_OUTPUT_INSTEAD),
    node("ShaderNodeParticleInfo", "Particle Info", GEOMETRY, NUMBER_INSTEAD),
    node("ShaderNodePointInfo", "Point Info", GEOMETRY, NUMBER_INSTEAD),
    node(
        "ShaderNodeRadialTiling",
        "Radial Tiling",
        "was not measured against Cycles yet",
        "Make sectors of an angle: Math, Arctan2, of X and Y, then Math, Wrap.",
    ),
    node("ShaderNodeRaycast", "Raycast", RAYS, FALLOFF_INSTEAD),
    node(
        "ShaderNodeScript",
        "Script",
        "runs a program in Open Shading Language",
        "Rebuild its formula from Math and Vector Math nodes.",
    ),
    node("ShaderNodeShaderToRGB", "Shader to RGB", EEVEE, NUMBER_INSTEAD),
    node(
        "ShaderNodeSqueeze",
        "Squeeze Value (Legacy)",
        "is a node of old files that Cycles does not evaluate",
        "Rebuild 1 / (1 + exp(-width (value - center))) from Math nodes.",
    ),
    node(
        "ShaderNodeSubsurfaceScattering",
        "Subsurface Scattering",
        SURFACE,
        "Scatter in the volume itself: Volume Scatter and Volume Absorption, added.",
    ),
    node("ShaderNodeTangent", "Tangent", "needs the surface that a ray hits, and a volume has none", DIRECTION_INSTEAD),
    node(
        "ShaderNodeTexEnvironment",
        "Environment Texture",
        FILE,
        "Put the picture around the scene: `world.image` of the scene file; in a volume use procedural textures.",
    ),
    node("ShaderNodeTexIES", "IES Texture", FILE, FALLOFF_INSTEAD),
    node("ShaderNodeTexImage", "Image Texture", FILE, PICTURE_INSTEAD),
    node(
        "ShaderNodeTexSky",
        "Sky Texture",
        "computes the light of a sky, which was not measured against Cycles",
        "Render the sky into a picture and put it around the scene; in a volume store the colour in a Color node.",
    ),
    node(
        "ShaderNodeUVAlongStroke",
        "UV Along Stroke",
        LINE_STYLE,
        "Use the output Object or Generated of Texture Coordinate.",
    ),
    node(
        "ShaderNodeUVMap",
        "UV Map",
        "reads texture coordinates of a surface, and a volume has none",
        "Use the output Object or Generated of Texture Coordinate.",
    ),
    node(
        "ShaderNodeVectorDisplacement",
        "Vector Displacement",
        "moves a surface, and a volume has none",
        MOVED_INSTEAD,
    ),
    node("ShaderNodeVertexColor", "Color Attribute", GEOMETRY, NUMBER_INSTEAD),
    node(
        "ShaderNodeVolumeInfo",
        "Volume Info",
        "reads grids of a Volume object by fixed names",
        "Use Attribute, output Fac, with the name density.",
    ),
    node(
        "ShaderNodeWavelength",
        "Wavelength",
        "was not measured against Cycles yet",
        "Store the colour in a Color node, or the range of colours in a Color Ramp.",
    ),
    node(
        "ShaderNodeWireframe",
        "Wireframe",
        "needs the triangle that a ray hits, and a volume has none",
        FALLOFF_INSTEAD,
    ),
];

const COORDINATE: &str = "ShaderNodeTexCoord";
const GEOMETRY_NODE: &str = "ShaderNodeNewGeometry";
const OBJECT_INSTEAD: &str = "Use the output Object.";
const POSITION_INSTEAD: &str = "Use the output Position.";
const TOWARDS_RAY: &str = "is the direction back along the ray in a volume, so that it is no function of the point";
const CONSTANT_IN_VOLUMES: &str = "describes a place on a surface; Cycles gives every point of a volume the same value";

/// Refused parts of node types that are otherwise supported, by type name.
pub static PARTS: &[RefusedPart] = &[
    output("ShaderNodeAttribute", "Color", GEOMETRY, "Use the output Fac on a Volume object."),
    output("ShaderNodeAttribute", "Alpha", GEOMETRY, "Use the output Fac on a Volume object."),
    output(GEOMETRY_NODE, "Normal", TOWARDS_RAY, POSITION_INSTEAD),
    output(GEOMETRY_NODE, "Tangent", "is NaN in a volume", POSITION_INSTEAD),
    output(GEOMETRY_NODE, "True Normal", TOWARDS_RAY, POSITION_INSTEAD),
    output(GEOMETRY_NODE, "Incoming", TOWARDS_RAY, POSITION_INSTEAD),
    output(GEOMETRY_NODE, "Parametric", CONSTANT_IN_VOLUMES, POSITION_INSTEAD),
    output(GEOMETRY_NODE, "Backfacing", CONSTANT_IN_VOLUMES, POSITION_INSTEAD),
    output(GEOMETRY_NODE, "Pointiness", CONSTANT_IN_VOLUMES, POSITION_INSTEAD),
    output(GEOMETRY_NODE, "Random Per Island", CONSTANT_IN_VOLUMES, "Use the output Random of Object Info."),
    output(COORDINATE, "Normal", TOWARDS_RAY, OBJECT_INSTEAD),
    output(COORDINATE, "UV", CONSTANT_IN_VOLUMES, "Use the output Object or Generated."),
    output(
        COORDINATE,
        "Camera",
        "depends on the camera, which is not the field's",
        "Use the output Object with the camera as its object.",
    ),
    output(COORDINATE, "Window", "depends on the pixel that is rendered", OBJECT_INSTEAD),
    output(COORDINATE, "Reflection", "depends on the ray", OBJECT_INSTEAD),
    setting(
        COORDINATE,
        "from_instancer",
        "true",
        "takes the coordinates of another object's instances, which are not supported",
        "Switch From Instancer off.",
    ),
    setting(
        "ShaderNodeVectorTransform",
        "convert_from",
        "CAMERA",
        "depends on the camera, which is not the field's",
        "Use Texture Coordinate, output Object, with the camera as its object.",
    ),
    setting(
        "ShaderNodeVectorTransform",
        "convert_to",
        "CAMERA",
        "depends on the camera, which is not the field's",
        "Use Texture Coordinate, output Object, with the camera as its object.",
    ),
];

/// The entry of a refused node type; none for supported types and for those that Blender does not have.
pub fn find(type_name: &str) -> Option<&'static RefusedNode> {
    NODES.iter().find(|node| node.type_name == type_name)
}

/// The refused parts of a node type.
pub fn parts(type_name: &str) -> impl Iterator<Item = &'static RefusedPart> {
    PARTS.iter().filter(move |part| part.type_name == type_name)
}

/// The error for a node whose type is not in the registry; `place` names the node with the groups around it.
pub fn error(place: String, type_name: &str) -> Error {
    match find(type_name) {
        Some(node) => Error::new(
            place,
            format!("{} ({type_name}), which {}", node.label, node.reason),
            "a supported node (`cloudparity nodes` lists them)",
            format!("{} A node that does not reach the volume does not matter.", node.instead),
        ),
        None => {
            let labels = super::registry().iter().map(|node_type| node_type.label);
            let known: Vec<_> = labels.filter(|label| !label.starts_with('(')).collect();
            Error::new(
                place,
                format!("the node type {type_name}"),
                format!("one of the supported nodes: {}", known.join(", ")),
                "Replace the node; one that does not reach the volume does not matter.",
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_are_sorted_and_none_stands_twice() {
        assert!(NODES.windows(2).all(|pair| pair[0].type_name < pair[1].type_name));
        let mut parts: Vec<String> = PARTS.iter().map(|part| format!("{} {:?}", part.type_name, part.part)).collect();
        parts.sort();
        assert!(parts.windows(2).all(|pair| pair[0] != pair[1]));
    }

    #[test]
    fn texts_join_into_sentences() {
        let texts = NODES.iter().map(|node| (node.type_name, node.reason, node.instead));
        for (name, reason, instead) in texts.chain(PARTS.iter().map(|part| (part.type_name, part.reason, part.instead)))
        {
            assert!(reason.starts_with(char::is_lowercase) && !reason.ends_with('.'), "{name}: {reason}");
            assert!(instead.starts_with(char::is_uppercase) && instead.ends_with('.'), "{name}: {instead}");
        }
    }

    #[test]
    fn the_error_says_what_and_why_and_what_else() {
        let text = error("material M: node Clouds/Path".into(), "ShaderNodeLightPath").to_string();
        for part in
            ["material M: node Clouds/Path", "Light Path", "ShaderNodeLightPath", "depends on the ray", "Value node"]
        {
            assert!(text.contains(part), "\"{part}\" is not in: {text}");
        }
        let text = error("material M: node Old".into(), "ShaderNodeTexMusgrave").to_string();
        assert!(text.contains("the node type ShaderNodeTexMusgrave") && text.contains("Noise Texture"), "{text}");
    }
}
