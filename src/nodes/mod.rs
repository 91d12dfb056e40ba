//! Blender's nodes. One file per node here, one WGSL module of the same name in `shaders/nodes/`.
//!
//! A file holds the node's sockets and modes ([`NodeType`]), its evaluation on batches of points
//! ([`Evaluate`], generic over [`Real`]) and its bounds over a box ([`NodeEvaluator::bounds`]). The graph
//! compiler knows no node by name: it reads [`registry`].
//!
//! Sockets are flattened to scalar components: a vector is three columns. Columns hold one value
//! per point of a batch.

pub mod add_shader;
pub mod additions;
pub mod affine;
pub mod blackbody;
pub mod bounds;
pub mod brick_texture;
pub mod bright_contrast;
pub mod checker_texture;
pub mod clamp;
pub mod closure;
pub mod cloud_texture;
pub mod color_ramp;
pub mod color_space;
pub mod combine_color;
pub mod combine_xyz;
pub mod conversion;
pub mod curve_mapping;
pub mod density_medium;
pub mod ellipsoid_clusters;
pub mod emission;
pub mod float_curve;
pub mod gabor_texture;
pub mod gamma;
pub mod geometry;
pub mod gradient_noise;
pub mod gradient_texture;
pub mod hash;
pub mod hue_saturation;
pub mod invert;
#[cfg(test)]
mod lane_tests;
mod lanes;
pub mod lattice_noise;
pub mod lookup_table;
pub mod magic_texture;
pub mod map_range;
pub mod mapping;
pub mod math;
pub mod mix;
pub mod mix_rgb;
pub mod mix_shader;
pub mod noise_texture;
pub mod normal;
pub mod nudged;
pub mod object_info;
pub mod object_property;
pub mod perlin_fbm;
pub mod point_attribute;
pub mod principled_volume;
pub mod real;
pub mod refused;
pub mod registration;
pub mod rgb;
pub mod rgb_curve;
pub mod rgb_to_bw;
pub mod rotation;
pub mod running_error;
pub mod separate_color;
pub mod separate_xyz;
pub mod socket_limits;
pub mod texture_coordinate;
pub mod texture_lookup;
pub mod texture_mapping;
pub mod value;
pub mod vector_curve;
pub mod vector_math;
pub mod vector_rotate;
pub mod vector_transform;
pub mod volume_absorption;
pub mod volume_coefficients;
pub mod volume_scatter;
pub mod voronoi_texture;
pub mod wave_texture;
pub mod white_noise_texture;

pub use bounds::Interval;
pub use nudged::{Nudge, Nudged};
pub use real::{Oracle, Real};
pub use registration::register;
pub use running_error::RunningError;

use crate::base::arrays::Mapped;
use crate::base::texture::TextureHandle;
use crate::scene::{Release, SocketType};
use serde_json::Value as Json;
use std::sync::Arc;

/// A node type: everything that the compiler, the checks and the documentation need to know.
pub struct NodeType {
    /// Blender's `bl_idname`.
    pub type_name: &'static str,
    /// Blender's label.
    pub label: &'static str,
    /// Stem of the Rust file and of the WGSL module.
    pub module: &'static str,
    /// Text of the WGSL module; empty for types that do not evaluate.
    pub shader: &'static str,
    /// Modes and flags.
    pub properties: &'static [Property],
    /// Inputs in Blender's order, of all modes.
    pub inputs: &'static [InputSocket],
    /// Outputs in Blender's order, of all modes.
    pub outputs: &'static [OutputSocket],
    /// What the compiler does with it.
    pub role: Role,
}

/// What the compiler does with a node of a type.
pub enum Role {
    /// Evaluates: builds the evaluator for a mode.
    Evaluated(fn(&Mode) -> Box<dyn NodeEvaluator>),
    /// Resolved to a coordinate or constant by the compiler.
    Source(fn(&SourceContext, &Mode, &str) -> crate::base::error::Result<SourceValue>),
    /// Makes or joins closures: its inputs are what the renderer asks for.
    Closure(closure::ClosureRole),
}

/// What a [`Role::Source`] output is.
#[derive(Debug, Clone, PartialEq)]
pub enum SourceValue {
    /// Constant components.
    Constant(Vec<f32>),
    /// Constant components of a node that Blender cannot evaluate: what reads them is folded by Cycles alone.
    LateConstant(Vec<f32>),
    /// Components that are the same at every point, but looked up at run time: nothing that reads them is folded.
    PerObject(Vec<f32>),
    /// Affine image of the object-space position: three rows of four.
    Affine([[f32; 4]; 3]),
    /// The object-space position itself.
    Position,
    /// Generated coordinates.
    Generated,
    /// Three values per point, given beside the positions under this name.
    Attribute(String),
    /// The value of the object's grid of densities.
    Grid,
}

/// What a source may need besides its own properties.
pub struct SourceContext<'a> {
    /// Object to world of the shaded object.
    pub matrix_world: &'a crate::scene::Matrix,
    /// The shaded object.
    pub volume: &'a crate::scene::Volume,
    /// Full place of the node, for errors.
    pub place: &'a str,
    /// The node in the file.
    pub node: &'a crate::scene::Node,
    /// Whether the object has a grid of densities.
    pub has_grid: bool,
}

impl Data {
    /// In a few words, for titles of modes.
    pub fn describe(&self) -> String {
        match self {
            Self::Ramp(ramp) => ramp.describe(),
            Self::Curves(curves) => curves.describe(),
            Self::PerlinFbm(cloud) => format!("{:?}", cloud.parameters()),
        }
    }
}

/// A property of a node.
pub struct Property {
    /// Blender's identifier.
    pub identifier: &'static str,
    /// Legal values.
    pub values: PropertyValues,
}

/// Legal values of a property.
pub enum PropertyValues {
    /// One of these names; the first is Blender's default.
    Choice(&'static [&'static str]),
    /// On or off, with the default.
    Flag(bool),
    /// A whole number.
    Integer {
        /// Blender's default.
        default: i32,
        /// Smallest and largest value of the node's interface.
        limits: [i32; 2],
        /// Values that comparisons try; the first is the default.
        probes: &'static [i32],
    },
    /// A number that a node keeps outside of its sockets.
    Number {
        /// Blender's default.
        default: f32,
        /// Smallest and largest value of the node's interface.
        limits: [f32; 2],
        /// Values that comparisons try; the first is the default.
        probes: &'static [f32],
    },
    /// A ramp or curves.
    Data {
        /// Reads what the file holds (nothing: Blender's default) at this place.
        read: fn(Option<&Json>, &str) -> crate::base::error::Result<Data>,
        /// What comparisons try.
        probes: fn() -> Vec<Json>,
    },
    /// A vector that the node keeps in its output of this name, with the default.
    StoredOutput([f32; 3]),
    /// Read by the compiler or by the node's own code.
    Other,
}

/// A property that is neither a name nor a number.
#[derive(Debug, Clone, PartialEq)]
pub enum Data {
    /// A colour ramp.
    Ramp(Arc<color_ramp::Ramp>),
    /// One or several curves.
    Curves(Arc<curve_mapping::CurveMapping>),
    /// A Perlin-FBM cloud.
    PerlinFbm(Arc<perlin_fbm::Cloud>),
}

impl Property {
    /// A choice; the first name is the default.
    pub const fn choice(identifier: &'static str, names: &'static [&'static str]) -> Self {
        Self { identifier, values: PropertyValues::Choice(names) }
    }
    /// A flag with its default.
    pub const fn flag(identifier: &'static str, default: bool) -> Self {
        Self { identifier, values: PropertyValues::Flag(default) }
    }
    /// A whole number.
    pub const fn integer(identifier: &'static str, default: i32, limits: [i32; 2], probes: &'static [i32]) -> Self {
        Self { identifier, values: PropertyValues::Integer { default, limits, probes } }
    }
    /// A number.
    pub const fn number(identifier: &'static str, default: f32, limits: [f32; 2], probes: &'static [f32]) -> Self {
        Self { identifier, values: PropertyValues::Number { default, limits, probes } }
    }
    /// A ramp or curves.
    pub const fn data(
        identifier: &'static str,
        read: fn(Option<&Json>, &str) -> crate::base::error::Result<Data>,
        probes: fn() -> Vec<Json>,
    ) -> Self {
        Self { identifier, values: PropertyValues::Data { read, probes } }
    }
    /// A vector that the node keeps in an output.
    pub const fn stored_output(identifier: &'static str, default: [f32; 3]) -> Self {
        Self { identifier, values: PropertyValues::StoredOutput(default) }
    }
    /// A property that the compiler or the node reads by itself.
    pub const fn other(identifier: &'static str) -> Self {
        Self { identifier, values: PropertyValues::Other }
    }
}

/// An input socket.
pub struct InputSocket {
    /// Blender's identifier, unique within the node.
    pub identifier: &'static str,
    /// Blender's label.
    pub label: &'static str,
    /// Kind of value.
    pub kind: SocketType,
    /// Value where the file stores none.
    pub default: &'static [f32],
    /// Reads Generated coordinates when nothing is linked.
    pub generated_when_unlinked: bool,
    /// Blender folds the node only where this input is linked (White Noise: its unlinked Vector counts as varying).
    pub folds_only_linked: bool,
    /// Blender's interface does not show the stored value, and a constant that is linked cannot take its place.
    pub hides_value: bool,
    /// The socket of Cycles begins with zeros, whatever Blender's default is.
    pub is_zero_in_cycles: bool,
    /// On a Volume object, the text input that names a grid: its value is multiplied in, and this input counts as 0 below 0.
    pub times_grid: Option<&'static str>,
    /// Whether the socket exists in a mode.
    pub exists: fn(&Mode) -> bool,
}

/// An output socket.
pub struct OutputSocket {
    /// Blender's identifier, unique within the node.
    pub identifier: &'static str,
    /// Kind of value.
    pub kind: SocketType,
    /// Whether the socket exists in a mode.
    pub exists: fn(&Mode) -> bool,
}

/// The socket exists in every mode.
pub fn always(_: &Mode) -> bool {
    true
}

impl InputSocket {
    /// A float that exists where `exists` says.
    pub const fn float(
        identifier: &'static str,
        label: &'static str,
        default: &'static [f32; 1],
        exists: fn(&Mode) -> bool,
    ) -> Self {
        Self {
            identifier,
            label,
            kind: SocketType::Float,
            default,
            generated_when_unlinked: false,
            folds_only_linked: false,
            hides_value: false,
            is_zero_in_cycles: false,
            times_grid: None,
            exists,
        }
    }
    /// A vector that exists where `exists` says.
    pub const fn vector(
        identifier: &'static str,
        label: &'static str,
        default: &'static [f32; 3],
        exists: fn(&Mode) -> bool,
    ) -> Self {
        Self {
            identifier,
            label,
            kind: SocketType::Vector,
            default,
            generated_when_unlinked: false,
            folds_only_linked: false,
            hides_value: false,
            is_zero_in_cycles: false,
            times_grid: None,
            exists,
        }
    }
    /// A colour that always exists.
    pub const fn color(identifier: &'static str, label: &'static str, default: &'static [f32; 3]) -> Self {
        Self::color_when(identifier, label, default, always)
    }
    /// A colour that exists where `exists` says.
    pub const fn color_when(
        identifier: &'static str,
        label: &'static str,
        default: &'static [f32; 3],
        exists: fn(&Mode) -> bool,
    ) -> Self {
        Self {
            identifier,
            label,
            kind: SocketType::Color,
            default,
            generated_when_unlinked: false,
            folds_only_linked: false,
            hides_value: false,
            is_zero_in_cycles: true,
            times_grid: None,
            exists,
        }
    }
    /// A closure.
    pub const fn shader(identifier: &'static str) -> Self {
        Self::valueless(identifier, "Shader")
    }
    /// The name of an attribute, which a mesh does not have.
    pub const fn text(identifier: &'static str) -> Self {
        Self::valueless(identifier, identifier)
    }
    const fn valueless(identifier: &'static str, label: &'static str) -> Self {
        Self {
            identifier,
            label,
            kind: SocketType::Shader,
            default: &[],
            generated_when_unlinked: false,
            folds_only_linked: false,
            hides_value: false,
            is_zero_in_cycles: false,
            times_grid: None,
            exists: always,
        }
    }
    /// The same input of a node that Blender folds only where it is linked.
    pub const fn folding_only_linked(self) -> Self {
        Self { folds_only_linked: true, ..self }
    }
    /// The same input where Blender's interface does not show its stored value.
    pub const fn hiding_value(self) -> Self {
        Self { hides_value: true, ..self }
    }
    /// The same input where Cycles' own default is zero and Blender's is not. (That of a colour always is.)
    pub const fn zero_in_cycles(self) -> Self {
        Self { is_zero_in_cycles: true, ..self }
    }
    /// The same input, times the grid that the text input `named_by` names where the object has grids.
    pub const fn times_grid(self, named_by: &'static str) -> Self {
        Self { times_grid: Some(named_by), ..self }
    }
    /// A texture's coordinate input.
    pub const fn coordinate(exists: fn(&Mode) -> bool) -> Self {
        Self {
            identifier: "Vector",
            label: "Vector",
            kind: SocketType::Vector,
            default: &[0.0; 3],
            generated_when_unlinked: true,
            folds_only_linked: false,
            hides_value: true,
            is_zero_in_cycles: false,
            times_grid: None,
            exists,
        }
    }
}

impl OutputSocket {
    /// An output that exists where `exists` says.
    pub const fn new(identifier: &'static str, kind: SocketType, exists: fn(&Mode) -> bool) -> Self {
        Self { identifier, kind, exists }
    }
}

/// A node's properties in one instance, and which of its outputs are wanted.
#[derive(Debug, Clone, PartialEq)]
pub struct Mode {
    choices: Vec<(&'static str, &'static str)>,
    flags: Vec<(&'static str, bool)>,
    integers: Vec<(&'static str, i32)>,
    numbers: Vec<(&'static str, f32)>,
    data: Vec<(&'static str, Data)>,
    stored: Vec<(&'static str, [f32; 3])>,
    wanted: Vec<&'static str>,
    texture: Option<TextureHandle>,
    frame: Option<vector_transform::Frame>,
    release: Release,
}

/// The entry of this name, which the node type declares.
fn declared<'a, T>(entries: &'a [(&'static str, T)], identifier: &str) -> &'a T {
    &entries.iter().find(|(name, _)| *name == identifier).expect("a declared property of this kind").1
}

impl Mode {
    /// Reads the properties of a node of the file. `place` names the node in errors.
    pub fn read(
        node_type: &NodeType,
        properties: &serde_json::Map<String, Json>,
        place: &str,
    ) -> crate::base::error::Result<Self> {
        use crate::base::error::Error;
        for key in properties.keys() {
            let is_property = |property: &&Property| !matches!(property.values, PropertyValues::StoredOutput(_));
            if !node_type.properties.iter().filter(is_property).any(|property| property.identifier == key) {
                let known: Vec<_> =
                    node_type.properties.iter().filter(is_property).map(|property| property.identifier).collect();
                return Err(Error::new(
                    format!("{place}: property {key}"),
                    properties[key].to_string(),
                    format!("one of the properties of {}: {}", node_type.type_name, known.join(", ")),
                    "Remove the property or correct its name.",
                ));
            }
        }
        let mut mode = Self {
            choices: Vec::new(),
            flags: Vec::new(),
            integers: Vec::new(),
            numbers: Vec::new(),
            data: Vec::new(),
            stored: Vec::new(),
            wanted: Vec::new(),
            texture: None,
            frame: None,
            release: Release::V5_0,
        };
        for property in node_type.properties {
            let given = properties.get(property.identifier);
            let wrong = |expected: String| {
                Error::new(
                    format!("{place}: property {}", property.identifier),
                    given.map(ToString::to_string).unwrap_or_default(),
                    expected,
                    "Choose a value that Blender's node offers.",
                )
            };
            match property.values {
                PropertyValues::Choice(names) => {
                    let name = match given {
                        None => names[0],
                        Some(value) => {
                            let added = additions::of(node_type.type_name, property.identifier);
                            let mut known = names.iter().copied().chain(added.map(|addition| addition.value));
                            let found = value.as_str().and_then(|text| known.find(|name| *name == text));
                            found.ok_or_else(|| wrong(format!("one of {}", names.join(", "))))?
                        }
                    };
                    mode.choices.push((property.identifier, name));
                }
                PropertyValues::Flag(default) => {
                    let flag = match given {
                        None => default,
                        Some(value) => value.as_bool().ok_or_else(|| wrong("true or false".into()))?,
                    };
                    mode.flags.push((property.identifier, flag));
                }
                PropertyValues::Integer { default, limits: [low, high], .. } => {
                    let number = match given {
                        None => default,
                        Some(value) => value
                            .as_i64()
                            .and_then(|number| i32::try_from(number).ok())
                            .filter(|number| (low..=high).contains(number))
                            .ok_or_else(|| wrong(format!("a whole number from {low} to {high}")))?,
                    };
                    mode.integers.push((property.identifier, number));
                }
                PropertyValues::Number { default, limits: [low, high], .. } => {
                    let number = match given {
                        None => default,
                        Some(value) => value
                            .as_f64()
                            .map(|number| number as f32)
                            .filter(|number| (low..=high).contains(number))
                            .ok_or_else(|| wrong(format!("a number from {low} to {high}")))?,
                    };
                    mode.numbers.push((property.identifier, number));
                }
                PropertyValues::Data { read, .. } => {
                    let place = format!("{place}: property {}", property.identifier);
                    mode.data.push((property.identifier, read(given, &place)?));
                }
                PropertyValues::StoredOutput(default) => mode.stored.push((property.identifier, default)),
                PropertyValues::Other => {}
            }
        }
        Ok(mode)
    }

    /// The mode of a node type whose only properties are these data.
    pub fn of_data(node_type: &NodeType, data: Vec<(&'static str, Data)>) -> Self {
        debug_assert_eq!(node_type.properties.len(), data.len());
        Self {
            choices: Vec::new(),
            flags: Vec::new(),
            integers: Vec::new(),
            numbers: Vec::new(),
            data,
            stored: Vec::new(),
            wanted: Vec::new(),
            texture: None,
            frame: None,
            release: Release::V5_0,
        }
    }

    /// [`Self::read`] of a node of the file, with the vectors that it keeps in its outputs.
    pub fn of_node(node_type: &NodeType, node: &crate::scene::Node, place: &str) -> crate::base::error::Result<Self> {
        let mut mode = Self::read(node_type, &node.properties, place)?;
        for (identifier, stored) in &mut mode.stored {
            let Some(value) = node.outputs.get(*identifier) else { continue };
            *stored = match value {
                crate::scene::Input::List(values) if values.len() == 3 => [values[0], values[1], values[2]],
                other => {
                    return Err(crate::base::error::Error::new(
                        format!("{place}: output {identifier}"),
                        format!("{other:?}"),
                        "a list of three numbers",
                        "Correct the value, or export the scene again.",
                    ));
                }
            };
        }
        Ok(mode)
    }

    /// The value of a choice property.
    ///
    /// # Panics
    /// When the node type does not declare it: a mistake in the node's own file.
    pub fn choice(&self, identifier: &str) -> &'static str {
        declared::<&'static str>(&self.choices, identifier)
    }

    /// The value of a flag property.
    ///
    /// # Panics
    /// When the node type does not declare it: a mistake in the node's own file.
    pub fn flag(&self, identifier: &str) -> bool {
        *declared(&self.flags, identifier)
    }

    /// The value of a whole-number property.
    ///
    /// # Panics
    /// When the node type does not declare it: a mistake in the node's own file.
    pub fn integer(&self, identifier: &str) -> i32 {
        *declared(&self.integers, identifier)
    }

    /// The value of a number property.
    ///
    /// # Panics
    /// When the node type does not declare it: a mistake in the node's own file.
    pub fn number(&self, identifier: &str) -> f32 {
        *declared(&self.numbers, identifier)
    }

    /// The ramp or the curves of a property.
    ///
    /// # Panics
    /// When the node type does not declare it: a mistake in the node's own file.
    pub fn data(&self, identifier: &str) -> &Data {
        declared(&self.data, identifier)
    }

    /// The vector that the node keeps in an output.
    ///
    /// # Panics
    /// When the node type does not declare it: a mistake in the node's own file.
    pub fn stored_output(&self, identifier: &str) -> [f32; 3] {
        *declared(&self.stored, identifier)
    }

    /// Whether an output is wanted.
    pub fn wants(&self, output: &str) -> bool {
        self.wanted.contains(&output)
    }

    /// The same mode with these outputs wanted.
    pub fn with_wanted(mut self, wanted: Vec<&'static str>) -> Self {
        self.wanted = wanted;
        self
    }

    /// The same mode with the texture that the node reads.
    pub fn with_texture(mut self, texture: TextureHandle) -> Self {
        self.texture = Some(texture);
        self
    }

    /// The texture that the node reads.
    ///
    /// # Panics
    /// When it has none: the compiler gives one to every lookup.
    pub fn texture(&self) -> &TextureHandle {
        self.texture.as_ref().expect("a lookup has a texture")
    }

    /// The same mode with the frame of the shaded object.
    pub fn with_frame(mut self, frame: vector_transform::Frame) -> Self {
        self.frame = Some(frame);
        self
    }

    /// The frame of the shaded object; that of the world where the compiler gave none.
    pub fn frame(&self) -> vector_transform::Frame {
        self.frame.unwrap_or_default()
    }

    /// The same mode with the values of a release of Blender.
    pub fn with_release(mut self, release: Release) -> Self {
        self.release = release;
        self
    }

    /// The release of Blender whose values it has.
    pub fn release(&self) -> Release {
        self.release
    }

    /// Shader definitions of this mode: `PROPERTY_VALUE` for choices, `PROPERTY` for flags that
    /// are on, `OUTPUT_NAME` for wanted outputs; for the values of releases other than 5.0 `BEFORE_BLENDER_5`, or
    /// `SINCE_BLENDER_5_1` and so on up to the release.
    pub fn shader_definitions(&self) -> Vec<String> {
        let choices = self.choices.iter().map(|(name, value)| shader_name(&format!("{name}_{value}")));
        let flags = self.flags.iter().filter(|(_, on)| *on).map(|(name, _)| shader_name(name));
        let outputs = self.wanted.iter().map(|name| shader_name(&format!("output_{name}")));
        let since = [(Release::V5_1, "5_1"), (Release::V5_2, "5_2"), (Release::V5_3, "5_3")];
        let since = since.into_iter().filter(|(first, _)| self.release >= *first);
        let since = since.map(|(_, name)| format!("SINCE_BLENDER_{name}"));
        let release = (self.release == Release::V4_5).then(|| "BEFORE_BLENDER_5".to_owned()).into_iter().chain(since);
        choices.chain(flags).chain(outputs).chain(release).collect()
    }

    /// The mode's numbers as WGSL constants, for the head of the module's text: `const OFFSET: f32 = 0.5f;`.
    pub fn shader_constants(&self) -> String {
        let integers =
            self.integers.iter().map(|(name, value)| format!("const {}: i32 = {value}i;\n", shader_name(name)));
        let numbers =
            self.numbers.iter().map(|(name, value)| format!("const {}: f32 = {value:?}f;\n", shader_name(name)));
        let stored = self.stored.iter().map(|(name, [x, y, z])| {
            format!("const STORED_{}: vec3f = vec3f({x:?}f, {y:?}f, {z:?}f);\n", shader_name(name))
        });
        integers.chain(numbers).chain(stored).collect()
    }

    /// The choices, the flags that are on, numbers and data as words: `MULTIPLY_ADD`, `use_clamp`, `offset 0.5`.
    pub fn words(&self) -> Vec<String> {
        let choices = self.choices.iter().map(|(_, value)| (*value).to_owned());
        let flags = self.flags.iter().filter(|(_, on)| *on).map(|(name, _)| (*name).to_owned());
        let integers = self.integers.iter().map(|(name, value)| format!("{name} {value}"));
        let numbers = self.numbers.iter().map(|(name, value)| format!("{name} {value}"));
        let data = self.data.iter().map(|(_, data)| data.describe());
        choices.chain(flags).chain(integers).chain(numbers).chain(data).collect()
    }
}

/// Upper case with everything but letters and digits as `_`.
pub fn shader_name(text: &str) -> String {
    text.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_uppercase() } else { '_' }).collect()
}

/// One input component of a batch.
#[derive(Clone, Copy)]
pub struct Column<'a, R> {
    /// One value per point.
    pub values: &'a [R],
    /// All values are equal.
    pub uniform: bool,
}

/// A node in one mode, ready to evaluate.
///
/// `inputs` are the existing inputs' components in socket order, `outputs` the wanted outputs'
/// components in socket order; all columns of a call have the same length.
pub trait NodeEvaluator: Send + Sync {
    /// Evaluates as Cycles' SSE4.2 kernel does.
    fn evaluate_f32(&self, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]);
    /// Evaluates in f64 with f32 coordinates and hashes.
    fn evaluate_oracle(&self, inputs: &[Column<'_, Oracle>], outputs: &mut [&mut [Oracle]]);
    /// Evaluates in f64 throughout.
    fn evaluate_unrounded(&self, inputs: &[Column<'_, f64>], outputs: &mut [&mut [f64]]);
    /// Evaluates in f32 with a bound on what fusing and the like may change.
    fn evaluate_running_error(&self, inputs: &[Column<'_, RunningError>], outputs: &mut [&mut [RunningError]]);
    /// Evaluates in f32 with the last bits of results moved, as the thread's [`Nudge`] says.
    fn evaluate_nudged(&self, inputs: &[Column<'_, Nudged>], outputs: &mut [&mut [Nudged]]);
    /// Encloses every value that any evaluator can give for inputs within the intervals.
    fn bounds(&self, inputs: &[Interval], outputs: &mut [Interval]);
    /// Value for constant inputs by Blender's own folding, where it differs from evaluation.
    fn fold(&self, _inputs: &[f32]) -> Option<Vec<f32>> {
        None
    }
    /// Value for constant inputs by Cycles' folding of what Blender did not fold, where it differs from evaluation.
    fn fold_late(&self, _inputs: &[f32]) -> Option<Vec<f32>> {
        None
    }
    /// Whether Blender evaluates the node by itself where all inputs are constant. What reads a node that it does not fold
    /// is not constant for it either.
    fn folds_early(&self) -> bool {
        true
    }
    /// Whether Cycles evaluates the node beforehand where its inputs are constant and Blender has not: what reads one that it
    /// does not fold is not simplified either.
    fn folds_late(&self) -> bool {
        true
    }
    /// WGSL declarations for the head of the instance's text: tables.
    fn shader_constants(&self) -> String {
        String::new()
    }
    /// Textures that it reads. Before [`Self::shader_constants`] the instance's text declares `TEXELS_0`, `TEXELS_1` ...: the first word
    /// of each in the program's data.
    fn textures(&self) -> Vec<TextureHandle> {
        Vec::new()
    }
    /// What it does in this mode that its shader does not, if there is anything.
    fn without_shader(&self) -> Option<&'static str> {
        None
    }
    /// Cycles' simplification for some constant inputs (`None` marks a varying component).
    fn simplify(&self, _inputs: &[Option<f32>]) -> Option<Simplified> {
        None
    }
    /// Cycles' simplification for inputs that are linked to one output: `equal` tells it of two components.
    fn simplify_links(&self, _inputs: &[Option<f32>], _equal: &dyn Fn(usize, usize) -> bool) -> Option<Simplified> {
        None
    }
}

/// Result of a simplification.
#[derive(Debug, Clone, PartialEq)]
pub enum Simplified {
    /// The output equals these input components: Cycles leaves the node out.
    Inputs(Vec<usize>),
    /// The output's components are these input components, taken apart or put together: nothing to evaluate, but for
    /// Cycles a node still.
    Renames(Vec<usize>),
    /// The output is constant.
    Constant(Vec<f32>),
}

/// Evaluation written once for every number type, with the node's bounds and folding rules.
pub trait Evaluate: Send + Sync {
    /// See [`NodeEvaluator`].
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]);
    /// See [`NodeEvaluator::bounds`].
    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]);
    /// See [`NodeEvaluator::fold`].
    fn fold_constants(&self, _inputs: &[f32]) -> Option<Vec<f32>> {
        None
    }
    /// See [`NodeEvaluator::fold_late`].
    fn fold_constants_late(&self, _inputs: &[f32]) -> Option<Vec<f32>> {
        None
    }
    /// See [`NodeEvaluator::folds_early`].
    fn folds_early(&self) -> bool {
        true
    }
    /// See [`NodeEvaluator::folds_late`].
    fn folds_late(&self) -> bool {
        true
    }
    /// See [`NodeEvaluator::shader_constants`].
    fn shader_constants(&self) -> String {
        String::new()
    }
    /// See [`NodeEvaluator::textures`].
    fn textures(&self) -> Vec<TextureHandle> {
        Vec::new()
    }
    /// See [`NodeEvaluator::without_shader`].
    fn without_shader(&self) -> Option<&'static str> {
        None
    }
    /// See [`NodeEvaluator::simplify`].
    fn simplify_constants(&self, _inputs: &[Option<f32>]) -> Option<Simplified> {
        None
    }
    /// See [`NodeEvaluator::simplify_links`].
    fn simplify_linked(&self, _inputs: &[Option<f32>], _equal: &dyn Fn(usize, usize) -> bool) -> Option<Simplified> {
        None
    }
    /// A faster evaluation with the same bits; false where there is none for these inputs.
    fn evaluate_fast(&self, _inputs: &[Column<'_, f32>], _outputs: &mut [&mut [f32]]) -> bool {
        false
    }
}

impl<T: Evaluate> NodeEvaluator for T {
    fn evaluate_f32(&self, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) {
        if !self.evaluate_fast(inputs, outputs) {
            self.evaluate(inputs, outputs);
        }
    }
    fn evaluate_oracle(&self, inputs: &[Column<'_, Oracle>], outputs: &mut [&mut [Oracle]]) {
        self.evaluate(inputs, outputs);
    }
    fn evaluate_unrounded(&self, inputs: &[Column<'_, f64>], outputs: &mut [&mut [f64]]) {
        self.evaluate(inputs, outputs);
    }
    fn evaluate_running_error(&self, inputs: &[Column<'_, RunningError>], outputs: &mut [&mut [RunningError]]) {
        self.evaluate(inputs, outputs);
    }
    fn evaluate_nudged(&self, inputs: &[Column<'_, Nudged>], outputs: &mut [&mut [Nudged]]) {
        self.evaluate(inputs, outputs);
    }
    fn bounds(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        self.enclose(inputs, outputs);
    }
    fn fold(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        self.fold_constants(inputs)
    }
    fn fold_late(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        self.fold_constants_late(inputs)
    }
    fn folds_early(&self) -> bool {
        Evaluate::folds_early(self)
    }
    fn folds_late(&self) -> bool {
        Evaluate::folds_late(self)
    }
    fn shader_constants(&self) -> String {
        Evaluate::shader_constants(self)
    }
    fn textures(&self) -> Vec<TextureHandle> {
        Evaluate::textures(self)
    }
    fn without_shader(&self) -> Option<&'static str> {
        Evaluate::without_shader(self)
    }
    fn simplify(&self, inputs: &[Option<f32>]) -> Option<Simplified> {
        self.simplify_constants(inputs)
    }
    fn simplify_links(&self, inputs: &[Option<f32>], equal: &dyn Fn(usize, usize) -> bool) -> Option<Simplified> {
        self.simplify_linked(inputs, equal)
    }
}

/// Applies `function` to `I` input components starting at `offset`, point by point.
#[inline(always)]
pub fn map<R: Real, const I: usize>(
    inputs: &[Column<'_, R>],
    offsets: [usize; I],
    output: &mut [R],
    function: impl Fn([R; I]) -> R,
) {
    let columns = offsets.mapped(|offset| &inputs[offset].values[..output.len()]);
    for (index, result) in output.iter_mut().enumerate() {
        *result = function(columns.mapped(|column| column[index]));
    }
}

/// Points that [`map_vector`] computes before it stores them.
const ABREAST: usize = 64;

/// Computes the three columns of a vector or colour point by point from the columns at `offsets`. Results go through memory that
/// nothing else can be in, so that what holds no decisions is computed for several points at once.
#[inline(always)]
pub fn map_vector<R: Real, const I: usize>(
    inputs: &[Column<'_, R>],
    offsets: [usize; I],
    outputs: &mut [&mut [R]],
    function: impl Fn([R; I]) -> [R; 3],
) {
    let outputs = vector_output(outputs);
    let count = outputs[0].len();
    for start in (0..count).step_by(ABREAST) {
        let range = start..count.min(start + ABREAST);
        let columns = offsets.mapped(|offset| &inputs[offset].values[range.clone()]);
        let mut results = [[R::of(0.0); ABREAST]; 3];
        for index in 0..range.len() {
            let result = function(columns.mapped(|column| column[index]));
            for axis in 0..3 {
                results[axis][index] = result[axis];
            }
        }
        for axis in 0..3 {
            outputs[axis][range.clone()].copy_from_slice(&results[axis][..range.len()]);
        }
    }
}

/// The vector instructions of this machine, looked up once.
pub fn lane_level() -> fearless_simd::Level {
    static LEVEL: std::sync::OnceLock<fearless_simd::Level> = std::sync::OnceLock::new();
    *LEVEL.get_or_init(fearless_simd::Level::new)
}

/// The columns of one point.
pub fn columns_at<'a, R>(inputs: &[Column<'a, R>], index: usize) -> Vec<Column<'a, R>> {
    inputs.iter().map(|column| Column { values: &column.values[index..=index], uniform: true }).collect()
}

/// The three columns of a vector's output. As slices of their own they stay where they are while a loop writes to them, which a
/// compiler cannot know of what `outputs` points to: it looks there again after every value.
#[inline(always)]
pub fn vector_output<'a, R>(outputs: &'a mut [&mut [R]]) -> [&'a mut [R]; 3] {
    let [x, y, z] = outputs else { unreachable!("an output of {} components, not a vector", outputs.len()) };
    let count = x.len();
    [x, &mut y[..count], &mut z[..count]]
}

/// Reads three components of point `index` starting at column `first`.
#[inline(always)]
pub fn vector_at<R: Real>(inputs: &[Column<'_, R>], first: usize, index: usize) -> [R; 3] {
    [inputs[first].values[index], inputs[first + 1].values[index], inputs[first + 2].values[index]]
}

/// Every node type that this version evaluates, in the order of the documentation, and then those that [`register`] has added.
pub fn registry() -> &'static [&'static NodeType] {
    static REGISTRY: &[&NodeType] = &[
        &texture_coordinate::TYPE,
        &geometry::TYPE,
        &object_info::TYPE,
        &separate_xyz::TYPE,
        &combine_xyz::TYPE,
        &value::TYPE,
        &math::TYPE,
        &vector_math::TYPE,
        &mapping::TYPE,
        &vector_rotate::TYPE,
        &vector_transform::TYPE,
        &normal::TYPE,
        &map_range::TYPE,
        &clamp::TYPE,
        &mix::TYPE,
        &mix_rgb::TYPE,
        &noise_texture::TYPE,
        &voronoi_texture::TYPE,
        &brick_texture::TYPE,
        &gabor_texture::TYPE,
        &white_noise_texture::TYPE,
        &gradient_texture::TYPE,
        &wave_texture::TYPE,
        &magic_texture::TYPE,
        &checker_texture::TYPE,
        &rgb::TYPE,
        &separate_color::TYPE,
        &combine_color::TYPE,
        &color_ramp::TYPE,
        &float_curve::TYPE,
        &rgb_curve::TYPE,
        &vector_curve::TYPE,
        &invert::TYPE,
        &gamma::TYPE,
        &bright_contrast::TYPE,
        &hue_saturation::TYPE,
        &rgb_to_bw::TYPE,
        &blackbody::TYPE,
        &principled_volume::TYPE,
        &volume_scatter::TYPE,
        &volume_absorption::TYPE,
        &volume_coefficients::TYPE,
        &emission::TYPE,
        &add_shader::TYPE,
        &mix_shader::TYPE,
        &point_attribute::TYPE,
        &conversion::TYPE,
        &affine::TYPE,
    ];
    registration::all(REGISTRY)
}

/// Node types of ours that stand for published densities: scene files may hold them, Blender has none of them.
pub static OWN: &[&NodeType] =
    &[&perlin_fbm::TYPE, &lattice_noise::TYPE, &cloud_texture::TYPE, &ellipsoid_clusters::TYPE];

/// The node type of Blender's `bl_idname`, or of ours.
pub fn find(type_name: &str) -> Option<&'static NodeType> {
    registry().iter().chain(OWN).copied().find(|node_type| node_type.type_name == type_name)
}

impl NodeType {
    /// Inputs that exist in `mode`.
    pub fn inputs_of<'a>(&'static self, mode: &'a Mode) -> impl Iterator<Item = &'static InputSocket> + 'a {
        self.inputs.iter().filter(|socket| (socket.exists)(mode))
    }
    /// Outputs that exist in `mode`.
    pub fn outputs_of<'a>(&'static self, mode: &'a Mode) -> impl Iterator<Item = &'static OutputSocket> + 'a {
        self.outputs.iter().filter(|socket| (socket.exists)(mode))
    }
}
