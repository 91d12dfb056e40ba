//! Every node in every mode against Cycles: generated graphs of one node whose inputs are attributes.
//!
//! Each input reads an attribute, so nothing is constant and Blender folds nothing. Arithmetic nodes
//! get normal values of standard deviation 3 mixed with special ones. Textures get two kinds of
//! points: *wild* ones, with parameters far beyond their limits and special coordinates, and
//! *ordinary* ones, on which WGSL is judged (it promises nothing for NaN, infinities and denormals).

use crate::base::error::{Error, Result};
use crate::bridge::{CyclesKernel, Message, probe};
use crate::gpu::Gpu;
use crate::graph::evaluate::Points;
use crate::graph::{Program, Target};
use crate::measure::errors::values::{equal, ulp_distance};
use crate::measure::nodes::limits;
use crate::measure::nodes::limits::Limit;
use crate::nodes::{self, Mode, NodeType, PropertyValues, Role, additions};
use crate::scene::{Release, Scene, bare_scene};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use serde_json::{Map, Value as Json, json};

/// Points per mode that the published figures were measured with.
pub const POINTS: usize = 9216;

/// Voronoi textures visit up to 625 cells in 16 octaves per point, so they get this share.
const VORONOI_SHARE: (usize, usize) = (2, 9);

/// Share of arithmetic inputs and wild coordinates that are special values.
const SPECIAL_SHARE: f64 = 0.25;

/// Standard deviation of ordinary values.
const DEVIATION: f32 = 3.0;

/// Values that evaluators treat specially: zeros, whole numbers, halves, large magnitudes with and
/// without fractions, denormals, infinities and NaN.
const SPECIAL: [f32; 36] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    2.0,
    -2.0,
    3.0,
    -7.0,
    0.5,
    -0.5,
    1.5,
    -2.5,
    1e3,
    -1e3,
    1e5,
    -1e5,
    1e6,
    1e7,
    -1e7,
    1e9,
    -1e9,
    2_147_483_648.0,
    1e30,
    -1e30,
    1e38,
    -1e38,
    1e-9,
    -1e-9,
    1e-38,
    1e-40,
    -1e-40,
    1e-45,
    0.999_999_94,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::NAN,
];

/// Nodes besides textures of which WGSL is judged at values as one would set them: the arithmetic of others is as accurate
/// anywhere.
const HAS_ORDINARY_VALUES: [&str; 12] = [
    "mapping",
    "vector_rotate",
    "mix",
    "mix_rgb",
    "color_ramp",
    "float_curve",
    "rgb_curve",
    "vector_curve",
    "combine_color",
    "hue_saturation",
    "gamma",
    "blackbody",
];

/// Outputs of Separate XYZ.
const AXES: [&str; 3] = ["X", "Y", "Z"];

/// A graph of one node, its inputs and what is compared.
pub struct Case {
    /// Blender's label of the node.
    pub node: &'static str,
    /// Its mode in words.
    pub mode: String,
    /// The graph.
    pub scene: Scene,
    /// Values of the inputs.
    pub attributes: Vec<(String, Vec<[f32; 3]>)>,
    /// Outputs to compare.
    pub targets: Vec<Target>,
    /// Which points WGSL is judged on.
    pub judged: Vec<bool>,
    /// Limits per output.
    pub limits: Vec<Limits>,
}

/// What an output may differ by.
pub struct Limits {
    /// f32 on the CPU.
    pub cpu: Limit,
    /// WGSL on ordinary points.
    pub wgsl: Limit,
}

/// One output of one mode. Serialises as a row of `modes.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ModeComparison {
    /// Blender's label of the node.
    pub node: String,
    /// The mode in words.
    pub mode: String,
    /// Output socket.
    pub output: String,
    /// Points compared.
    pub points: usize,
    /// Largest |ours - Cycles| / max(1, |Cycles|) where both are finite.
    pub cpu_max_error: f64,
    /// Points that are not equal.
    pub cpu_differing: usize,
    /// Points where exactly one side is finite.
    pub cpu_one_sided_nonfinite: usize,
    /// Ordinary points: all inputs and Cycles' values are normal numbers or 0, and textures have parameters as one sets them. WGSL is judged on these.
    pub ordinary_points: usize,
    /// Those that are not equal.
    pub ordinary_differing: usize,
    /// Largest error of them, as `cpu_max_error`.
    pub ordinary_max_error: f64,
    /// The point with that error, as `cpu_worst`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ordinary_worst: Option<String>,
    /// Points that WGSL is judged on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wgsl_points: Option<usize>,
    /// Largest error of WGSL, as `cpu_max_error`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wgsl_max_error: Option<f64>,
    /// The same in units in the last place.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wgsl_max_ulp: Option<u32>,
    /// Points of WGSL beyond its limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wgsl_beyond: Option<usize>,
    /// Those of them that are within their own rounding bound ([`Program::rounding_bounds`]): the
    /// limits are largest values of a few thousand points, and some points are worse conditioned.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wgsl_explained: Option<usize>,
    /// What Cycles' own AVX2 kernel differs by from its SSE4.2 kernel at the points that WGSL is judged on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub avx2_max_error: Option<f64>,
    /// Largest error of the CPU that passes.
    pub limit: f64,
    /// Where it comes from.
    pub limit_source: &'static str,
    /// What WGSL may differ by.
    pub wgsl_limit: String,
    /// Whether everything that was evaluated is within its limit.
    pub pass: bool,
    /// The point with the largest CPU error: input components in socket order, ours, Cycles'.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cpu_worst: Option<String>,
    /// The same of WGSL, of those beyond the limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wgsl_worst: Option<String>,
}

/// All modes of a node type that differ from each other, as Blender 5.0 has them.
pub fn modes(node_type: &NodeType) -> Vec<Map<String, Json>> {
    modes_of(node_type, Release::default())
}

/// [`modes`] as a release has them: with what was added since 5.0, last.
pub fn modes_of(node_type: &NodeType, release: Release) -> Vec<Map<String, Json>> {
    let mut modes = vec![Map::new()];
    for property in node_type.properties {
        let values: Vec<Json> = match property.values {
            PropertyValues::Choice(names) => {
                let added = additions::of(node_type.type_name, property.identifier);
                let added = added.filter(|addition| addition.since <= release).map(|addition| addition.value);
                names.iter().copied().chain(added).map(Json::from).collect()
            }
            PropertyValues::Flag(_) => vec![false.into(), true.into()],
            PropertyValues::Integer { probes, .. } => probes.iter().map(|&number| number.into()).collect(),
            PropertyValues::Number { probes, .. } => probes.iter().map(|&number| json_number(number)).collect(),
            PropertyValues::Data { probes, .. } => probes(),
            PropertyValues::StoredOutput(_) | PropertyValues::Other => continue,
        };
        modes = modes
            .into_iter()
            .flat_map(|mode| {
                values.iter().map(move |value| {
                    let mut mode = mode.clone();
                    mode.insert(property.identifier.to_owned(), value.clone());
                    mode
                })
            })
            .collect();
    }
    modes.retain(|mode| is_own_mode(node_type, mode));
    modes
}

/// The shortest decimal that gives the same f32, as scene files write numbers.
pub fn json_number(value: f32) -> Json {
    value.to_string().parse::<f64>().map_or(Json::Null, Json::from)
}

/// Whether every property of the mode has an effect on it: Voronoi's metric does nothing in one dimension and for edges
/// and radii, nor does normalisation for radii and for noise but fBM; blends and limits of results are for colours, factors by
/// component for vectors; the direction of a wave that is not the active one and a frequency of a squash by 1 do nothing.
fn is_own_mode(node_type: &NodeType, mode: &Map<String, Json>) -> bool {
    let is = |property: &str, value: &str| mode.get(property).and_then(Json::as_str) == Some(value);
    let normalizes = mode.get("normalize") == Some(&Json::Bool(true));
    match node_type.module {
        "mix" => {
            let clamps = mode.get("clamp_result") == Some(&Json::Bool(true));
            (is("data_type", "VECTOR") || is("factor_mode", "UNIFORM"))
                && (is("data_type", "RGBA") || (is("blend_type", "MIX") && !clamps))
        }
        // From a space to itself is the identity for every type.
        "vector_transform" => {
            mode.get("convert_from") != mode.get("convert_to")
                || (is("convert_from", "WORLD") && is("vector_type", "VECTOR"))
        }
        "mix_rgb" => mode.get("use_alpha") != Some(&Json::Bool(true)),
        "wave_texture" => {
            let idle = if is("wave_type", "BANDS") { "rings_direction" } else { "bands_direction" };
            is(idle, "X")
        }
        "brick_texture" => {
            let number = |property: &str| mode.get(property).and_then(Json::as_f64);
            number("squash") != Some(1.0) || number("squash_frequency") == Some(2.0)
        }
        "noise_texture" => normalizes || is("noise_type", "FBM"),
        "voronoi_texture" => {
            let radius = is("feature", "N_SPHERE_RADIUS");
            let has_metric = !is("voronoi_dimensions", "1D") && !is("feature", "DISTANCE_TO_EDGE") && !radius;
            (has_metric || is("distance", "EUCLIDEAN")) && !(radius && normalizes)
        }
        _ => true,
    }
}

/// Which modes and points a suite holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Selection {
    /// Every mode; half of a texture's points are wild, and Voronoi textures have fewer.
    Everything,
    /// Outputs that jump, all points ordinary; modes that differ in the normalisation of distances, which
    /// these outputs do not show, once.
    Jumping,
}

/// [`cases_of`] Blender 5.0.
pub fn cases(points: usize, seed: u64, node: Option<&str>, selection: Selection) -> Result<Vec<Case>> {
    cases_of(Release::default(), points, seed, node, selection)
}

/// Every case with the values of a release of Blender, which is also asked for its own, with about `points` points each; `node`
/// restricts to one label.
pub fn cases_of(
    release: Release,
    points: usize,
    seed: u64,
    node: Option<&str>,
    selection: Selection,
) -> Result<Vec<Case>> {
    let mut cases = Vec::new();
    let evaluated = || nodes::registry().iter().filter(|node| matches!(node.role, Role::Evaluated(_)));
    for node_type in evaluated().filter(|node| node.type_name.starts_with("ShaderNode")) {
        if node.is_none_or(|label| label == node_type.label) {
            for properties in modes_of(node_type, release) {
                if selection == Selection::Jumping {
                    let mode = Mode::read(node_type, &properties, node_type.label)?;
                    let normalized = properties.get("normalize") == Some(&Json::Bool(true));
                    if normalized
                        || !node_type.outputs_of(&mode).any(|output| jumps(node_type, &mode, output.identifier))
                    {
                        continue;
                    }
                }
                let has_variants = matches!(node_type.module, "noise_texture" | "wave_texture");
                let variants: &[bool] = if has_variants { &[false, true] } else { &[false] };
                for &distorted in variants {
                    let seed = seed.wrapping_add(cases.len() as u64);
                    cases.push(Case::of_node(node_type, &properties, distorted, (points, seed), selection)?);
                }
            }
        }
    }
    let conversions = node.is_none_or(|label| label == nodes::conversion::TYPE.label);
    if conversions && selection == Selection::Everything {
        for from in ["VECTOR", "COLOR", "FLOAT"] {
            cases.push(Case::of_conversion(from, points, seed.wrapping_add(cases.len() as u64))?);
        }
    }
    if cases.is_empty() {
        let labels: Vec<&str> = evaluated().map(|node| node.label).collect();
        return Err(Error::new(
            "node",
            format!("\"{}\"", node.unwrap_or_default()),
            format!("one of: {}", labels.join(", ")),
            "Write Blender's label of the node.",
        )
        .with_setting("node"));
    }
    cases.iter_mut().for_each(|case| case.scene.graph_mut().blender = release);
    Ok(cases)
}

/// Whether a last bit may decide between two values of an output that are far apart.
fn jumps(node_type: &NodeType, mode: &Mode, output: &str) -> bool {
    limits::wgsl(node_type, mode, output, false).jumps
}

/// Nodes that read attribute number `number`: its vector, and its three components.
pub fn attribute_nodes(number: usize) -> [Json; 2] {
    let name = format!("Attribute {number}");
    [
        json!({
            "name": name, "type": "ShaderNodeAttribute",
            "properties": {"attribute_type": "GEOMETRY", "attribute_name": attribute_name(number)},
        }),
        json!({
            "name": format!("Separate {number}"), "type": "ShaderNodeSeparateXYZ",
            "inputs": {"Vector": {"node": name, "socket": "Vector"}},
        }),
    ]
}

/// Name of an attribute of the mesh.
pub fn attribute_name(number: usize) -> String {
    format!("input {number}")
}

/// A normally distributed number (Box and Muller).
pub fn normal(random: &mut ChaCha8Rng, deviation: f32) -> f32 {
    let (u, v): (f64, f64) = (1.0 - random.random::<f64>(), random.random());
    ((-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()) as f32 * deviation
}

/// A special value, or else a normal one.
pub fn special_or_normal(random: &mut ChaCha8Rng) -> f32 {
    if random.random_bool(SPECIAL_SHARE) {
        SPECIAL[random.random_range(0..SPECIAL.len())]
    } else {
        let deviation = random.random_range(2.0..4.0);
        normal(random, deviation)
    }
}

fn uniform(random: &mut ChaCha8Rng, low: f32, high: f32) -> f32 {
    low + (high - low) * random.random::<f32>()
}

/// A texture's parameter far beyond its limits, or a coordinate.
fn wild(random: &mut ChaCha8Rng, module: &str, socket: &str) -> f32 {
    match (module, socket) {
        ("blackbody", _) if random.random() => return uniform(random, 0.0, 14_000.0),
        ("combine_color", "Red") | ("hue_saturation", "Hue") if random.random() => return uniform(random, -0.5, 1.5),
        // Beyond, ten steps amplify the last bit of the C library's sine to the whole range.
        ("magic_texture", "Distortion") => return uniform(random, -2.7, 2.7),
        ("gabor_texture", "Anisotropy") => return uniform(random, -1.0, 2.0),
        ("gabor_texture", "Frequency") => return normal(random, DEVIATION),
        _ => {}
    }
    match socket {
        "Detail" => uniform(random, -1.0, 17.0),
        "Roughness" | "Detail Roughness" => uniform(random, -0.4, 1.5),
        "Lacunarity" => uniform(random, -1.5, 50.0),
        "Smoothness" | "Randomness" => uniform(random, -1.0, 2.0),
        "Exponent" => uniform(random, -1.0, 100.0),
        "Scale" | "Offset" | "Gain" | "Distortion" | "Detail Scale" => normal(random, DEVIATION),
        _ => special_or_normal(random),
    }
}

/// A texture's parameter as one would set it: Detail up to 4, half of them whole.
fn ordinary(random: &mut ChaCha8Rng, module: &str, socket: &str, distorted: bool) -> f32 {
    match (module, socket) {
        ("mix", "Factor_Float" | "Factor_Vector") | ("mix_rgb", "Fac") => return uniform(random, -0.25, 1.25),
        ("combine_color", _) | ("hue_saturation", "Hue" | "Fac" | "Color") => return uniform(random, 0.0, 1.0),
        ("hue_saturation", _) => return uniform(random, 0.0, 2.0),
        // The quotient by a scale near 0 has no relative accuracy.
        ("mapping", "Scale") => return if random.random() { 1.0 } else { -1.0 } * uniform(random, 0.25, 4.0),
        ("color_ramp", _) => return uniform(random, -0.2, 1.2),
        ("float_curve", "Factor") | ("rgb_curve" | "vector_curve", "Fac") => return uniform(random, 0.0, 1.0),
        ("float_curve" | "rgb_curve" | "vector_curve", _) => return uniform(random, -1.5, 2.0),
        ("gamma", "Color") => return uniform(random, -0.25, 2.0),
        ("gamma", _) => return uniform(random, -2.0, 5.0),
        ("blackbody", _) => return uniform(random, 0.0, 14_000.0),
        ("magic_texture", "Distortion") => return uniform(random, 0.5, 1.0),
        ("brick_texture", "Mortar Size") => return uniform(random, 0.02, 0.1),
        ("brick_texture", "Mortar Smooth") => return uniform(random, 0.2, 1.0),
        ("brick_texture", "Bias") => return uniform(random, -1.0, 1.0),
        ("brick_texture", "Brick Width") => return uniform(random, 0.3, 1.0),
        ("brick_texture", "Row Height") => return uniform(random, 0.15, 0.5),
        ("brick_texture", "Color1" | "Color2" | "Mortar") => return uniform(random, 0.0, 1.0),
        ("gabor_texture", "Frequency") => return uniform(random, 0.5, 4.0),
        // Half of them without scattered directions, which is a branch of its own.
        ("gabor_texture", "Anisotropy") => return if random.random() { 1.0 } else { uniform(random, 0.0, 1.0) },
        _ => {}
    }
    match socket {
        "Detail" if random.random() && !distorted => random.random_range(0..=4) as f32,
        "Detail" => uniform(random, 0.0, 4.0),
        "Lacunarity" if distorted => uniform(random, 1.7, 2.3),
        "Lacunarity" => 2.0,
        "Scale" => 5.0,
        "Distortion" if !distorted => 0.0,
        "Exponent" => uniform(random, 0.5, 2.7),
        "Detail Scale" => uniform(random, 0.5, 2.0),
        "Smoothness" | "Roughness" | "Detail Roughness" | "Randomness" | "Offset" | "Gain" | "Distortion" => {
            uniform(random, 0.0, 1.0)
        }
        _ => normal(random, DEVIATION),
    }
}

impl Case {
    fn of_node(
        node_type: &'static NodeType,
        properties: &Map<String, Json>,
        distorted: bool,
        (points, seed): (usize, u64),
        selection: Selection,
    ) -> Result<Self> {
        let wild_points = selection == Selection::Everything;
        let mode = Mode::read(node_type, properties, node_type.label)?;
        let texture = node_type.inputs.iter().any(|socket| socket.generated_when_unlinked);
        let halves = texture || HAS_ORDINARY_VALUES.contains(&node_type.module);
        let points = match node_type.module {
            "voronoi_texture" if wild_points => (points * VORONOI_SHARE.0 / VORONOI_SHARE.1).max(2),
            _ => points.max(2),
        };
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut graph: Vec<Json> = Vec::new();
        let mut inputs = Map::new();
        // Columns of scalar components: floats share attributes, three at a time.
        let mut attributes: Vec<Vec<[f32; 3]>> = Vec::new();
        let mut free: Vec<(usize, usize)> = Vec::new();
        for socket in node_type.inputs_of(&mode) {
            let fresh = socket.kind.components() == 3 || free.is_empty();
            if fresh {
                graph.extend(attribute_nodes(attributes.len()));
                attributes.push(vec![[0.0; 3]; points]);
            }
            let last = attributes.len() - 1;
            let (number, axes) = if socket.kind.components() == 3 {
                let source = format!("Attribute {last}");
                inputs.insert(socket.identifier.into(), json!({"node": source, "socket": "Vector"}));
                (last, 0..3)
            } else {
                if fresh {
                    free = vec![(last, 2), (last, 1), (last, 0)];
                }
                let (number, axis) = free.pop().expect("a fresh attribute has three axes");
                let source = format!("Separate {number}");
                inputs.insert(socket.identifier.into(), json!({"node": source, "socket": AXES[axis]}));
                (number, axis..axis + 1)
            };
            for (index, row) in attributes[number].iter_mut().enumerate() {
                for value in &mut row[axes.clone()] {
                    *value = match (halves, index % 2) {
                        (false, _) => special_or_normal(&mut random),
                        (true, 0) if wild_points => wild(&mut random, node_type.module, socket.identifier),
                        (true, _) => ordinary(&mut random, node_type.module, socket.identifier, distorted),
                    };
                }
            }
        }
        graph.push(json!({"name": "Node", "type": node_type.type_name, "properties": properties, "inputs": inputs}));
        let mut words = mode.words();
        words.extend(distorted.then(|| "distorted".to_owned()));
        let outputs: Vec<_> = node_type
            .outputs_of(&mode)
            .filter(|output| wild_points || jumps(node_type, &mode, output.identifier))
            .collect();
        let attributes: Vec<(String, Vec<[f32; 3]>)> =
            attributes.into_iter().enumerate().map(|(number, values)| (attribute_name(number), values)).collect();
        // WGSL promises no sign of zero. Hashed lattice cells and arctan2 depend on it.
        let signed_zero =
            texture || node_type.module == "white_noise_texture" || mode.words().contains(&"ARCTAN2".to_owned());
        let judged = judged(&attributes, points, signed_zero, |index| !(halves && wild_points) || index % 2 == 1);
        Ok(Self {
            node: node_type.label,
            mode: words.join(" "),
            scene: bare_scene("mode", json!({"material": "Material", "nodes": graph, "groups": []}))?,
            attributes,
            targets: outputs.iter().map(|output| Target::output("Node", output.identifier)).collect(),
            judged,
            limits: outputs
                .iter()
                .map(|output| Limits {
                    cpu: limits::cpu(node_type, &mode, output.identifier),
                    wgsl: limits::wgsl(node_type, &mode, output.identifier, distorted),
                })
                .collect(),
        })
    }

    /// A link whose ends have different types. Colours come through a group: its interface says so.
    fn of_conversion(from: &str, points: usize, seed: u64) -> Result<Self> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut graph: Vec<Json> = attribute_nodes(0).into();
        let combine = |link: Json| json!({"name": "Node", "type": "ShaderNodeCombineXYZ", "inputs": {"X": link}});
        let mut groups = Vec::new();
        match from {
            "VECTOR" => graph.push(combine(json!({"node": "Attribute 0", "socket": "Vector"}))),
            "FLOAT" => graph.push(json!({
                "name": "Node", "type": "ShaderNodeVectorMath", "properties": {"operation": "ABSOLUTE"},
                "inputs": {"Vector": {"node": "Separate 0", "socket": "X"}},
            })),
            _ => {
                graph.push(json!({
                    "name": "Node", "type": "ShaderNodeGroup", "group": "Luminance",
                    "inputs": {"Socket_1": {"node": "Attribute 0", "socket": "Vector"}},
                }));
                groups.push(json!({
                    "name": "Luminance",
                    "inputs": [{"identifier": "Socket_1", "name": "Color", "type": "color", "default": [0, 0, 0, 1]}],
                    "outputs": [{"identifier": "Socket_0", "name": "Vector", "type": "vector", "default": [0, 0, 0]}],
                    "nodes": [
                        combine(json!({"group_input": "Socket_1"})),
                        {"name": "Group Output", "type": "NodeGroupOutput", "properties": {"is_active_output": true},
                         "inputs": {"Socket_0": {"node": "Node", "socket": "Vector"}}},
                    ],
                }));
            }
        }
        let output = if groups.is_empty() { "Vector" } else { "Socket_0" };
        let mut values = vec![[0.0_f32; 3]; points.max(2)];
        values.iter_mut().for_each(|row| *row = row.map(|_| special_or_normal(&mut random)));
        let attributes = vec![(attribute_name(0), values)];
        let judged = judged(&attributes, points.max(2), false, |_| true);
        Ok(Self {
            node: nodes::conversion::TYPE.label,
            mode: from.to_owned(),
            scene: bare_scene("conversion", json!({"material": "Material", "nodes": graph, "groups": groups}))?,
            attributes,
            targets: vec![Target::output("Node", output)],
            judged,
            limits: vec![Limits { cpu: limits::EQUAL, wgsl: limits::CONVERSION }],
        })
    }

    /// One position per point: nothing reads it.
    pub fn positions(&self) -> Vec<[f32; 3]> {
        vec![[0.0; 3]; self.judged.len()]
    }

    /// Compiles the graph for all targets.
    pub fn program(&self) -> Result<Program> {
        Program::compile(&self.scene, &self.targets)
    }

    fn rows(&self, theirs: &[Vec<f32>], avx2: Option<&[Vec<f32>]>, gpu: Option<&Gpu>) -> Result<Vec<ModeComparison>> {
        let program = self.program()?;
        let positions = self.positions();
        let points = Points { positions: &positions, attributes: &self.attributes };
        let cpu = program.evaluate_single(points)?;
        let wgsl = gpu.map(|gpu| gpu.field(&program)?.evaluate(points)).transpose()?;
        let width = program.output_components();
        let mut first = 0;
        let mut rows = Vec::new();
        for (number, ((target, theirs), limits)) in self.targets.iter().zip(theirs).zip(&self.limits).enumerate() {
            let components = theirs.len() / positions.len();
            let ours = |values: &[f32], index: usize| {
                values[index * width + first..index * width + first + components].to_vec()
            };
            let mut found = Tally::default();
            let mut ordinary = Tally::default();
            let mut shader = Tally::default();
            let mut fused = Tally::default();
            let mut beyond = Vec::new();
            for index in 0..positions.len() {
                let range = index * components..(index + 1) * components;
                let reference = &theirs[range.clone()];
                found.add(&ours(&cpu, index), reference, &limits.cpu, || self.describe(index));
                let normal = reference.iter().all(|value| value.is_normal() || *value == 0.0);
                if !self.judged[index] || !normal {
                    continue;
                }
                ordinary.add(&ours(&cpu, index), reference, &limits.cpu, || self.describe(index));
                if let Some(wgsl) = &wgsl {
                    let before = shader.beyond;
                    shader.add(&ours(wgsl, index), reference, &limits.wgsl, || self.describe(index));
                    if shader.beyond > before {
                        beyond.push(index);
                    }
                }
                if let Some(avx2) = avx2 {
                    fused.add(&avx2[number][range], reference, &limits.wgsl, || self.describe(index));
                }
            }
            if let Some(wgsl) = &wgsl {
                let bounds = self.rounding_bounds(&program, &beyond)?;
                shader.explained = beyond
                    .iter()
                    .zip(bounds.chunks(width))
                    .filter(|&(&index, bounds)| {
                        let reference = &theirs[index * components..(index + 1) * components];
                        let found = ours(wgsl, index);
                        found
                            .iter()
                            .zip(reference)
                            .zip(&bounds[first..first + components])
                            .all(|((ours, theirs), bound)| (f64::from(*ours) - f64::from(*theirs)).abs() <= *bound)
                    })
                    .count();
            }
            first += components;
            let has_shader = wgsl.is_some();
            rows.push(ModeComparison {
                node: self.node.to_owned(),
                mode: self.mode.clone(),
                output: target.output.clone().unwrap_or_default(),
                points: positions.len(),
                cpu_max_error: found.max_error,
                cpu_differing: found.differing,
                cpu_one_sided_nonfinite: found.one_sided,
                ordinary_points: ordinary.points,
                ordinary_differing: ordinary.differing,
                ordinary_max_error: ordinary.max_error,
                ordinary_worst: ordinary.worst,
                wgsl_points: has_shader.then_some(shader.points),
                wgsl_max_error: has_shader.then_some(shader.max_error),
                wgsl_max_ulp: has_shader.then_some(shader.max_ulp),
                wgsl_beyond: has_shader.then_some(shader.beyond),
                wgsl_explained: has_shader.then_some(shader.explained),
                avx2_max_error: avx2.is_some().then_some(fused.max_error),
                limit: limits.cpu.error,
                limit_source: limits.cpu.source,
                wgsl_limit: limits.wgsl.describe(),
                pass: found.passes(&limits.cpu) && (!has_shader || shader.passes(&limits.wgsl)),
                cpu_worst: found.worst,
                wgsl_worst: shader.worst.filter(|_| shader.beyond > 0),
            });
        }
        Ok(rows)
    }

    /// Rounding bounds at some of the points.
    fn rounding_bounds(&self, program: &Program, indices: &[usize]) -> Result<Vec<f64>> {
        let attributes: Vec<(String, Vec<[f32; 3]>)> = self
            .attributes
            .iter()
            .map(|(name, values)| (name.clone(), indices.iter().map(|&index| values[index]).collect()))
            .collect();
        let positions = vec![[0.0; 3]; indices.len()];
        program.rounding_bounds(Points { positions: &positions, attributes: &attributes })
    }

    fn describe(&self, index: usize) -> String {
        let inputs: Vec<String> = self.attributes.iter().map(|(_, values)| format!("{:?}", values[index])).collect();
        inputs.join(" ")
    }
}

/// Points whose inputs are all normal numbers or zeros (+0 only with `signed_zero`) and that `kind`
/// lets pass.
fn judged(
    attributes: &[(String, Vec<[f32; 3]>)],
    points: usize,
    signed_zero: bool,
    kind: impl Fn(usize) -> bool,
) -> Vec<bool> {
    let normal = |value: &f32| value.is_normal() || (*value == 0.0 && !(signed_zero && value.is_sign_negative()));
    (0..points)
        .map(|index| kind(index) && attributes.iter().all(|(_, values)| values[index].iter().all(normal)))
        .collect()
}

/// What is counted while points are compared.
#[derive(Debug, Default)]
pub(super) struct Tally {
    points: usize,
    differing: usize,
    one_sided: usize,
    beyond: usize,
    explained: usize,
    max_error: f64,
    max_ulp: u32,
    worst: Option<String>,
    worst_rank: f64,
}

impl Tally {
    pub(super) fn add(&mut self, ours: &[f32], theirs: &[f32], limit: &Limit, describe: impl Fn() -> String) {
        self.points += 1;
        let pairs = || ours.iter().copied().zip(theirs.iter().copied());
        if pairs().all(|(a, b)| equal(a, b)) {
            return;
        }
        self.differing += 1;
        self.one_sided += usize::from(pairs().any(|(a, b)| a.is_finite() != b.is_finite()));
        self.beyond += usize::from(!pairs().all(|(a, b)| limit.allows(a, b)));
        let mut rank = 0.0_f64;
        for (a, b) in pairs().filter(|(a, b)| !equal(*a, *b)) {
            if a.is_finite() && b.is_finite() {
                let error = limits::relative_error(a, b);
                self.max_error = self.max_error.max(error);
                self.max_ulp = self.max_ulp.max(ulp_distance(a, b));
                rank = rank.max(error);
            } else {
                rank = f64::INFINITY;
            }
        }
        if self.worst.is_none() || rank > self.worst_rank {
            self.worst_rank = rank;
            self.worst = Some(format!("inputs {}: ours {ours:?}, Cycles {theirs:?}", describe()));
        }
    }

    /// A row without WGSL: node, mode and output, and the limit.
    pub(super) fn row(self, (node, mode, output): (&str, &str, &str), limit: &Limit) -> ModeComparison {
        ModeComparison {
            node: node.to_owned(),
            mode: mode.to_owned(),
            output: output.to_owned(),
            points: self.points,
            cpu_max_error: self.max_error,
            cpu_differing: self.differing,
            cpu_one_sided_nonfinite: self.one_sided,
            ordinary_points: 0,
            ordinary_differing: 0,
            ordinary_max_error: 0.0,
            ordinary_worst: None,
            wgsl_points: None,
            wgsl_max_error: None,
            wgsl_max_ulp: None,
            wgsl_beyond: None,
            wgsl_explained: None,
            avx2_max_error: None,
            limit: limit.error,
            limit_source: limit.source,
            wgsl_limit: String::new(),
            pass: self.passes(limit),
            cpu_worst: self.worst,
            wgsl_worst: None,
        }
    }

    fn passes(&self, limit: &Limit) -> bool {
        self.beyond - self.explained <= limit.allowed_points(self.points)
    }
}

/// Rows of a suite and the Blender that they were measured with.
pub struct ModeComparisons {
    /// One per output and mode.
    pub rows: Vec<ModeComparison>,
    /// Blender's version.
    pub blender: String,
}

/// Compares all cases, in one Blender process; with `avx2` another one measures how far Cycles' own
/// AVX2 kernel is from the SSE4.2 kernel at the same points.
pub fn run(cases: &[Case], gpu: Option<&Gpu>, avx2: bool, mut receive: impl FnMut(Message)) -> Result<ModeComparisons> {
    let positions: Vec<Vec<[f32; 3]>> = cases.iter().map(Case::positions).collect();
    let jobs: Vec<probe::Job<'_>> = cases
        .iter()
        .zip(&positions)
        .map(|(case, positions)| probe::Job {
            scene: &case.scene,
            positions,
            attributes: &case.attributes,
            targets: case.targets.clone(),
            repeat: 1,
            samples: 1,
        })
        .collect();
    let answers = probe::ask(&jobs, CyclesKernel::Sse42, &mut receive)?;
    let fused = if avx2 { Some(probe::ask(&jobs, CyclesKernel::Default, &mut receive)?) } else { None };
    let mut rows = Vec::new();
    for (number, (case, answer)) in cases.iter().zip(&answers.jobs).enumerate() {
        let fused = fused.as_ref().map(|answers| answers.jobs[number].values.as_slice());
        rows.extend(case.rows(&answer.values, fused, gpu)?);
    }
    Ok(ModeComparisons { rows, blender: answers.blender })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_mode_compiles_and_is_listed_once() {
        let cases = cases(4, 1, None, Selection::Everything).expect("the suite");
        let count = |label: &str| cases.iter().filter(|case| case.node == label).count();
        assert_eq!(count("Math"), 82);
        assert_eq!(count("Vector Math"), 29);
        assert_eq!(count("Map Range"), 16);
        assert_eq!(count("Clamp"), 2);
        // 4 dimensions x (5 types + fBM unnormalised) x (plain, distorted).
        assert_eq!(count("Noise Texture"), 48);
        // 1D: 3 features x 2, edge x 2, radius; 2D to 4D: 3 features x 4 metrics x 2, edge x 2, radius.
        assert_eq!(count("Voronoi Texture"), 9 + 3 * 27);
        for case in &cases {
            let program = case.program().expect("every mode compiles");
            assert_eq!(program.outputs.len(), case.targets.len());
        }
    }

    #[test]
    fn every_evaluated_node_of_the_registry_has_cases() {
        let cases = cases(4, 1, None, Selection::Everything).expect("the suite");
        for node_type in nodes::registry() {
            let internal = node_type.type_name == nodes::affine::TYPE.type_name;
            if matches!(node_type.role, Role::Evaluated(_)) && !internal {
                assert!(cases.iter().any(|case| case.node == node_type.label), "{}", node_type.label);
            }
        }
    }

    #[test]
    fn floats_share_attributes() {
        let clamp = nodes::find("ShaderNodeClamp").expect("registered");
        let case = Case::of_node(clamp, &modes(clamp)[0], false, (8, 1), Selection::Everything).expect("a case");
        assert_eq!(case.attributes.len(), 1);
    }
}
