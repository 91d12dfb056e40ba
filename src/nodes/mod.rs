//! Blender's nodes. One file per node here, one WGSL module of the same name in `shaders/nodes/`.
//!
//! A file holds the node's sockets and modes ([`NodeType`]), its evaluation on batches of points
//! ([`Evaluate`], generic over [`Real`]) and its bounds over a box ([`Kernel::bounds`]). The graph
//! compiler knows no node by name: it reads [`registry`].
//!
//! Sockets are flattened to scalar components: a vector is three columns. Columns hold one value
//! per point of a batch.

pub mod add_shader;
pub mod affine;
pub mod blackbody;
pub mod bounds;
pub mod clamp;
pub mod closure;
pub mod combine_xyz;
pub mod conversion;
pub mod emission;
pub mod gradient_noise;
pub mod hash;
#[cfg(test)]
mod lane_tests;
pub mod map_range;
pub mod math;
pub mod mix_shader;
pub mod noise_texture;
pub mod point_attribute;
pub mod principled_volume;
pub mod real;
pub mod running_error;
pub mod separate_xyz;
pub mod texture_coordinate;
pub mod value;
pub mod vector_math;
pub mod volume_absorption;
pub mod volume_coefficients;
pub mod volume_grid_lookup;
pub mod volume_scatter;
pub mod voronoi_texture;

pub use bounds::Interval;
pub use real::{Oracle, Real};
pub use running_error::RunningError;

use crate::scene::SocketType;
use crate::volume_grid::GridHandle;
use serde_json::Value as Json;

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
    /// Evaluates: builds the kernel for a mode.
    Evaluated(fn(&Mode) -> Box<dyn Kernel>),
    /// Resolved to a coordinate or constant by the compiler.
    Source(fn(&SourceContext, &Mode, &str) -> crate::error::Result<SourceValue>),
    /// Makes or joins closures: its inputs are what the renderer asks for.
    Closure(closure::ClosureRole),
}

/// What a [`Role::Source`] output is.
#[derive(Debug, Clone, PartialEq)]
pub enum SourceValue {
    /// Constant components.
    Constant(Vec<f32>),
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
    /// Full place of the node, for errors.
    pub place: &'a str,
    /// The node in the file.
    pub node: &'a crate::scene::Node,
    /// Whether the object has a grid of densities.
    pub has_grid: bool,
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
    /// Read by the node's own code.
    Other,
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
    /// A property that the node reads by itself.
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
        Self { identifier, label, kind: SocketType::Float, default, generated_when_unlinked: false, exists }
    }
    /// A vector that exists where `exists` says.
    pub const fn vector(
        identifier: &'static str,
        label: &'static str,
        default: &'static [f32; 3],
        exists: fn(&Mode) -> bool,
    ) -> Self {
        Self { identifier, label, kind: SocketType::Vector, default, generated_when_unlinked: false, exists }
    }
    /// A colour that always exists.
    pub const fn color(identifier: &'static str, label: &'static str, default: &'static [f32; 3]) -> Self {
        Self { identifier, label, kind: SocketType::Color, default, generated_when_unlinked: false, exists: always }
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
            exists: always,
        }
    }
    /// A texture's coordinate input.
    pub const fn coordinate(exists: fn(&Mode) -> bool) -> Self {
        Self {
            identifier: "Vector",
            label: "Vector",
            kind: SocketType::Vector,
            default: &[0.0; 3],
            generated_when_unlinked: true,
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
    wanted: Vec<&'static str>,
    grid: Option<GridHandle>,
}

impl Mode {
    /// Reads the properties of a node of the file. `place` names the node in errors.
    pub fn read(
        node_type: &NodeType,
        properties: &serde_json::Map<String, Json>,
        place: &str,
    ) -> crate::error::Result<Self> {
        use crate::error::Error;
        for key in properties.keys() {
            if !node_type.properties.iter().any(|property| property.identifier == key) {
                let known: Vec<_> = node_type.properties.iter().map(|property| property.identifier).collect();
                return Err(Error::new(
                    format!("{place}: property {key}"),
                    properties[key].to_string(),
                    format!("one of the properties of {}: {}", node_type.type_name, known.join(", ")),
                    "Remove the property or correct its name.",
                ));
            }
        }
        let mut mode = Self { choices: Vec::new(), flags: Vec::new(), wanted: Vec::new(), grid: None };
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
                        Some(value) => value
                            .as_str()
                            .and_then(|text| names.iter().find(|name| **name == text))
                            .ok_or_else(|| wrong(format!("one of {}", names.join(", "))))?,
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
                PropertyValues::Other => {}
            }
        }
        Ok(mode)
    }

    /// The value of a choice property.
    ///
    /// # Panics
    /// When the node type does not declare it: a mistake in the node's own file.
    pub fn choice(&self, identifier: &str) -> &'static str {
        self.choices.iter().find(|(name, _)| *name == identifier).expect("a declared choice property").1
    }

    /// The value of a flag property.
    ///
    /// # Panics
    /// When the node type does not declare it: a mistake in the node's own file.
    pub fn flag(&self, identifier: &str) -> bool {
        self.flags.iter().find(|(name, _)| *name == identifier).expect("a declared flag property").1
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

    /// The same mode with the grid that the node reads.
    pub fn with_grid(mut self, grid: GridHandle) -> Self {
        self.grid = Some(grid);
        self
    }

    /// The grid that the node reads.
    ///
    /// # Panics
    /// When it has none: the compiler gives one to every lookup.
    pub fn grid(&self) -> &GridHandle {
        self.grid.as_ref().expect("a lookup has a grid")
    }

    /// Shader definitions of this mode: `PROPERTY_VALUE` for choices, `PROPERTY` for flags that
    /// are on, `OUTPUT_NAME` for wanted outputs.
    pub fn shader_definitions(&self) -> Vec<String> {
        let choices = self.choices.iter().map(|(name, value)| shader_name(&format!("{name}_{value}")));
        let flags = self.flags.iter().filter(|(_, on)| *on).map(|(name, _)| shader_name(name));
        let outputs = self.wanted.iter().map(|name| shader_name(&format!("output_{name}")));
        choices.chain(flags).chain(outputs).collect()
    }

    /// The choices and the flags that are on, as words: `MULTIPLY_ADD`, `use_clamp`.
    pub fn words(&self) -> Vec<String> {
        let choices = self.choices.iter().map(|(_, value)| (*value).to_owned());
        choices.chain(self.flags.iter().filter(|(_, on)| *on).map(|(name, _)| (*name).to_owned())).collect()
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
pub trait Kernel: Send + Sync {
    /// Evaluates as Cycles' SSE4.2 kernel does.
    fn evaluate_f32(&self, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]);
    /// Evaluates in f64 with f32 coordinates and hashes.
    fn evaluate_oracle(&self, inputs: &[Column<'_, Oracle>], outputs: &mut [&mut [Oracle]]);
    /// Evaluates in f64 throughout.
    fn evaluate_unrounded(&self, inputs: &[Column<'_, f64>], outputs: &mut [&mut [f64]]);
    /// Evaluates in f32 with a bound on what fusing and the like may change.
    fn evaluate_running_error(&self, inputs: &[Column<'_, RunningError>], outputs: &mut [&mut [RunningError]]);
    /// Encloses every value that any evaluator can give for inputs within the intervals.
    fn bounds(&self, inputs: &[Interval], outputs: &mut [Interval]);
    /// Value for constant inputs by Blender's own folding, where it differs from evaluation.
    fn fold(&self, _inputs: &[f32]) -> Option<Vec<f32>> {
        None
    }
    /// Cycles' simplification for some constant inputs (`None` marks a varying component).
    fn simplify(&self, _inputs: &[Option<f32>]) -> Option<Simplified> {
        None
    }
}

/// Result of a simplification.
#[derive(Debug, Clone, PartialEq)]
pub enum Simplified {
    /// The output equals these input components.
    Inputs(Vec<usize>),
    /// The output is constant.
    Constant(Vec<f32>),
}

/// Evaluation written once for every number type, with the node's bounds and folding rules.
pub trait Evaluate: Send + Sync {
    /// See [`Kernel`].
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]);
    /// See [`Kernel::bounds`].
    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]);
    /// See [`Kernel::fold`].
    fn fold_constants(&self, _inputs: &[f32]) -> Option<Vec<f32>> {
        None
    }
    /// See [`Kernel::simplify`].
    fn simplify_constants(&self, _inputs: &[Option<f32>]) -> Option<Simplified> {
        None
    }
    /// A faster evaluation with the same bits; false where there is none for these inputs.
    fn evaluate_fast(&self, _inputs: &[Column<'_, f32>], _outputs: &mut [&mut [f32]]) -> bool {
        false
    }
}

impl<T: Evaluate> Kernel for T {
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
    fn bounds(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        self.enclose(inputs, outputs);
    }
    fn fold(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        self.fold_constants(inputs)
    }
    fn simplify(&self, inputs: &[Option<f32>]) -> Option<Simplified> {
        self.simplify_constants(inputs)
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
    let columns = offsets.map(|offset| &inputs[offset].values[..output.len()]);
    for (index, result) in output.iter_mut().enumerate() {
        *result = function(columns.map(|column| column[index]));
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

/// Reads three components of point `index` starting at column `first`.
#[inline(always)]
pub fn vector_at<R: Real>(inputs: &[Column<'_, R>], first: usize, index: usize) -> [R; 3] {
    [inputs[first].values[index], inputs[first + 1].values[index], inputs[first + 2].values[index]]
}

/// Every node type that this version evaluates, in the order of the documentation.
pub fn registry() -> &'static [&'static NodeType] {
    static REGISTRY: &[&NodeType] = &[
        &texture_coordinate::TYPE,
        &separate_xyz::TYPE,
        &combine_xyz::TYPE,
        &value::TYPE,
        &math::TYPE,
        &vector_math::TYPE,
        &map_range::TYPE,
        &clamp::TYPE,
        &noise_texture::TYPE,
        &voronoi_texture::TYPE,
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
    REGISTRY
}

/// The node type of Blender's `bl_idname`.
pub fn find(type_name: &str) -> Option<&'static NodeType> {
    registry().iter().copied().find(|node_type| node_type.type_name == type_name)
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
