//! Writing a program as WGSL and linking it with the modules of `shaders/`.
//!
//! A node's module is written once with conditions for its modes; an instance is the same text with
//! the conditions of one mode resolved, under a name of its own. Instances that are equal are
//! shared. After linking, everything that no entry point reaches is removed, so the shader holds
//! nothing of a node that the graph does not use.

use crate::graph::constants::{SharedConstants, SharedNumber};
use crate::graph::{Operand, Program};

use crate::base::choice::choice;
use crate::base::error::{Error, Result};
use crate::base::files::sha256;
use crate::base::texture::TextureHandle;
use crate::nodes::shader_name;
use crate::scene::SocketType;
use naga_oil::compose::preprocess::Preprocessor;
use naga_oil::compose::{
    ComposableModuleDescriptor, Composer, ComposerError, ErrSource, ImportDefinition, NagaModuleDescriptor,
    ShaderDefValue, get_preprocessor_data,
};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fmt::Write;
use std::sync::{LazyLock, Mutex, PoisonError};

/// Modules that node modules import, in dependency order.
const SHARED: &[(&str, &str)] = &[
    ("nodes/shared/numeric.wgsl", include_str!("../../shaders/nodes/shared/numeric.wgsl")),
    ("nodes/shared/color_space.wgsl", include_str!("../../shaders/nodes/shared/color_space.wgsl")),
    ("nodes/shared/blend.wgsl", include_str!("../../shaders/nodes/shared/blend.wgsl")),
    ("nodes/shared/hash.wgsl", include_str!("../../shaders/nodes/shared/hash.wgsl")),
    ("nodes/shared/gradient_noise.wgsl", include_str!("../../shaders/nodes/shared/gradient_noise.wgsl")),
    ("nodes/shared/words.wgsl", include_str!("../../shaders/nodes/shared/words.wgsl")),
    ("nodes/shared/texture.wgsl", include_str!("../../shaders/nodes/shared/texture.wgsl")),
];

/// Words of a row of the picture that a fragment shader has its data in: a width that every adapter's textures may have.
pub const ROW: u32 = 2048;

/// What the words of programs import.
const WORDS: SharedConstants =
    SharedConstants { path: "cloudparity::words::constants", numbers: &[("ROW", SharedNumber::Unsigned(ROW))] };

/// Composers that nobody uses at the moment. One compiles a score of regular expressions, which takes longer than most compositions.
static COMPOSERS: Mutex<Vec<Composer>> = Mutex::new(Vec::new());

/// One for all texts, for the same reason.
static PREPROCESSOR: LazyLock<Preprocessor> = LazyLock::new(Preprocessor::default);

/// What programs read whose constants are in a buffer.
const NUMBERS: (&str, &str) = ("nodes/shared/numbers.wgsl", include_str!("../../shaders/nodes/shared/numbers.wgsl"));

/// Import path of the specialised graph.
pub const PROGRAM_PATH: &str = "cloudparity::graph";

/// Modules that every linker has, in dependency order: phase functions, steps, air, source terms of light models.
const LIGHT: &[(&str, &str)] = &[
    ("media/mesh.wgsl", include_str!("../../shaders/media/mesh.wgsl")),
    ("media/phase.wgsl", include_str!("../../shaders/media/phase.wgsl")),
    ("media/transfer.wgsl", include_str!("../../shaders/media/transfer.wgsl")),
    ("engines/air.wgsl", include_str!("../../shaders/engines/air.wgsl")),
    ("engines/light/harmonics.wgsl", include_str!("../../shaders/engines/light/harmonics.wgsl")),
    ("engines/rays.wgsl", include_str!("../../shaders/engines/rays.wgsl")),
    ("engines/light/terms.wgsl", include_str!("../../shaders/engines/light/terms.wgsl")),
];

choice! {
    "lowercase",
    /// Target languages of `cloudparity shader`.
    pub enum Language {
        /// WebGPU Shading Language.
        Wgsl,
        /// SPIR-V 1.3 binary.
        Spirv,
        /// OpenGL Shading Language 4.50.
        Glsl,
        /// High Level Shading Language, shader model 6.0.
        Hlsl,
        /// Metal Shading Language 2.4.
        Msl,
    }
}

/// A text that takes part in a composition.
enum Part {
    /// A module: path and text.
    Module(String, String),
    /// One instance of a node's module: its name, path, text and definitions.
    Instance { name: String, path: String, text: String, definitions: Vec<String> },
}

/// Modules that are kept at most; then all are forgotten.
const MOST_KEPT: usize = 64;

/// Modules that were linked, by the hash of all that they are made of: a picture of other numbers, or from another place, links the same
/// text again, and composing it takes longer than a small picture.
static LINKED: LazyLock<Mutex<HashMap<String, naga::Module>>> = LazyLock::new(Mutex::default);

/// Composes a shader from the modules in `shaders/`, a program, and an entry text.
pub struct Linker {
    /// What it is composed of, in dependency order.
    parts: Vec<Part>,
    /// Whether what all programs import is there.
    has_shared: bool,
    /// Instances of node modules by module and definitions, and how many there are of each module.
    instances: HashMap<String, String>,
    counts: HashMap<&'static str, usize>,
    /// Textures of the programs in the order of their words.
    textures: Vec<TextureHandle>,
    constants: Constants,
}

/// Where the constants of programs stand; a constant of 0 stays in the text, where it leaves out what it leaves out.
enum Constants {
    InText,
    /// In a buffer, in this order.
    InBuffer(Vec<f32>),
    /// Computed from parameters; those that were written so far.
    OfParameters(ProgramParameters, usize),
}

/// A constant that follows from parameters in proportion.
#[derive(Debug, Clone, PartialEq)]
pub struct Computed {
    /// Its value where all parameters are 0.
    pub at_zero: f64,
    /// What it grows by with parameters, by their numbers.
    pub slopes: Vec<(usize, f64)>,
}

/// Parameters in a uniform that constants of a program depend on, affinely.
#[derive(Debug, Clone, Default)]
pub struct ProgramParameters {
    /// Names of the uniform's fields: identifiers that do not end in a digit.
    pub fields: Vec<String>,
    /// For each constant that is not 0, in the order of [`Linker::numbers`]; none where it depends on nothing.
    pub constants: Vec<Option<Computed>>,
}

impl ProgramParameters {
    /// Import path of the uniform: `parameters`, binding 8 of group 0.
    pub const BINDING: u32 = 8;
    /// Name of the struct in the linked module.
    pub const STRUCT: &'static str = "parameters_Parameters";

    /// Bytes of the uniform.
    pub fn bytes(&self) -> usize {
        4 * self.fields.len().next_multiple_of(4)
    }

    fn module(&self) -> String {
        let mut text = String::from("#define_import_path cloudparity::parameters\nstruct Parameters {\n");
        for field in &self.fields {
            line(&mut text, format_args!("    {field}: f32,"));
        }
        for number in self.fields.len()..self.bytes() / 4 {
            let letter = char::from(b'a' + (number % 4) as u8);
            line(&mut text, format_args!("    padding_{letter}: f32,"));
        }
        let binding = Self::BINDING;
        line(&mut text, format_args!("}}\n@group(0) @binding({binding}) var<uniform> parameters: Parameters;"));
        text
    }

    /// A constant as text; none where it depends on no parameter.
    fn expression(&self, number: usize) -> Option<String> {
        let Computed { at_zero, slopes } = self.constants.get(number)?.as_ref()?;
        let mut text = format!("({:?}f", *at_zero as f32);
        for (field, slope) in slopes {
            text += &format!(" + {:?}f * parameters.{}", *slope as f32, self.fields[*field]);
        }
        Some(text + ")")
    }
}

impl Linker {
    /// A linker with the shared modules and the instances and text of `program`, which is then
    /// importable as [`PROGRAM_PATH`]: `fn evaluate(position: vec3f, ...) -> f32` (or `vec3f`, or a
    /// struct `Outputs` for several outputs); each attribute is a further `vec3f` argument.
    pub fn new(program: &Program) -> Result<Self> {
        let mut linker = Self::bare();
        linker.add_program(PROGRAM_PATH, program)?;
        Ok(linker)
    }

    /// The same, but constants of this program and of those that are added lie in a buffer, binding 1 of group 1: programs that differ in
    /// numbers alone have one text. A constant of 0 stays in the text, where it leaves out what it leaves out.
    pub fn with_numbers(program: &Program) -> Result<Self> {
        let mut linker = Self::bare();
        linker.add(NUMBERS.0, NUMBERS.1);
        linker.constants = Constants::InBuffer(Vec::new());
        linker.add_program(PROGRAM_PATH, program)?;
        Ok(linker)
    }

    /// The same, but constants are computed from parameters in a uniform ([`ProgramParameters`]).
    pub fn with_parameters(program: &Program, parameters: &ProgramParameters) -> Result<Self> {
        let mut linker = Self::bare();
        linker.add("generated/parameters.wgsl", &parameters.module());
        linker.constants = Constants::OfParameters(parameters.clone(), 0);
        linker.add_program(PROGRAM_PATH, program)?;
        Ok(linker)
    }

    /// The constants in the order of the buffer; none where they are elsewhere.
    pub fn numbers(&self) -> &[f32] {
        match &self.constants {
            Constants::InBuffer(numbers) => numbers,
            Constants::InText | Constants::OfParameters(..) => &[],
        }
    }

    /// Adds another program under an import path of its own, with a function as that of [`Self::new`]. Textures that programs share are
    /// there once.
    pub fn add_program(&mut self, import_path: &str, program: &Program) -> Result<()> {
        if let Some(node) = program.instructions.iter().find(|node| node.node_type.shader.is_empty()) {
            return Err(Error::new(
                format!("node {}", node.label),
                node.node_type.label,
                "nodes with a shader: this one is evaluated on the CPU only",
                "Evaluate on the CPU.",
            )
            .with_setting("backend"));
        }
        for node in &program.instructions {
            if let Some(found) = node.evaluator.without_shader() {
                return Err(Error::new(
                    format!("node {}", node.label),
                    found,
                    "what its shader does: this mode is evaluated on the CPU only",
                    "Evaluate on the CPU, or take another mode.",
                )
                .with_setting("backend"));
            }
        }
        if !std::mem::replace(&mut self.has_shared, true) {
            self.add_constants(&WORDS);
            for (path, source) in SHARED {
                self.add(path, source);
            }
        }
        let text = self.program_text(import_path, program)?;
        self.add(&format!("generated/{}.wgsl", import_path.replace("::", "/")), &text);
        Ok(())
    }

    /// Textures that the programs read, in the order of their words: contents of binding 0 of group 1.
    pub fn textures(&self) -> &[TextureHandle] {
        &self.textures
    }

    /// The first word of a texture in the data of the programs, put behind the others where it is new.
    fn first_word(&mut self, texture: TextureHandle) -> usize {
        let words = |textures: &[TextureHandle]| textures.iter().map(|texture| texture.texels().word_count()).sum();
        match self.textures.iter().position(|known| *known == texture) {
            Some(number) => words(&self.textures[..number]),
            None => {
                self.textures.push(texture);
                words(&self.textures[..self.textures.len() - 1])
            }
        }
    }

    /// A linker without a program, for kernels that read none. Phase functions, steps and source terms can be imported from it, as from
    /// every one.
    pub fn bare() -> Self {
        let mut linker = Self {
            parts: Vec::new(),
            has_shared: false,
            instances: HashMap::new(),
            counts: HashMap::new(),
            textures: Vec::new(),
            constants: Constants::InText,
        };
        LIGHT.iter().for_each(|(path, source)| linker.add(path, source));
        linker
    }

    /// Adds an importable module; its `#define_import_path` names it.
    pub fn add(&mut self, path: &str, source: &str) {
        self.parts.push(Part::Module(path.to_owned(), source.to_owned()));
    }

    /// Adds numbers that Rust hands to the kernel, before what imports them.
    pub fn add_constants(&mut self, constants: &SharedConstants) {
        self.add(constants.path, &constants.text());
    }

    /// Links the entry text and removes what no entry point reaches.
    pub fn link(self, path: &str, source: &str) -> Result<naga::Module> {
        self.link_with(path, source, &[])
    }

    /// [`Self::link`] with definitions for the conditions of the entry text and of what it imports.
    pub fn link_with(self, path: &str, source: &str, definitions: &[&str]) -> Result<naga::Module> {
        let hash = self.hash(path, source, definitions);
        let linked = || LINKED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(module) = linked().get(&hash) {
            return Ok(module.clone());
        }
        let module = self.composed(path, source, definitions)?;
        let mut linked = linked();
        if linked.len() == MOST_KEPT {
            linked.clear();
        }
        linked.insert(hash, module.clone());
        Ok(module)
    }

    /// A hash of all that a composition depends on.
    fn hash(&self, path: &str, source: &str, definitions: &[&str]) -> String {
        let mut all = Vec::new();
        let mut note = |text: &str| {
            // With its length, so that no two lists of texts are one.
            all.extend((text.len() as u64).to_le_bytes());
            all.extend(text.as_bytes());
        };
        for part in &self.parts {
            match part {
                Part::Module(path, text) => ["module", path, text].into_iter().for_each(&mut note),
                Part::Instance { name, path, text, definitions } => {
                    ["instance", name, path, text].into_iter().for_each(&mut note);
                    definitions.iter().for_each(|one| note(one));
                }
            }
        }
        ["entry", path, source].into_iter().chain(definitions.iter().copied()).for_each(&mut note);
        sha256(&all)
    }

    fn composed(&self, path: &str, source: &str, definitions: &[&str]) -> Result<naga::Module> {
        let at_rest = || COMPOSERS.lock().unwrap_or_else(PoisonError::into_inner);
        let mut composer = at_rest().pop().unwrap_or_default();
        let module = self.composed_by(&mut composer, path, source, definitions);
        composer.module_sets.clear();
        composer.module_index.clear();
        at_rest().push(composer);
        module
    }

    fn composed_by(
        &self,
        composer: &mut Composer,
        path: &str,
        source: &str,
        definitions: &[&str],
    ) -> Result<naga::Module> {
        for part in &self.parts {
            match part {
                Part::Module(path, source) => {
                    let descriptor = ComposableModuleDescriptor { source, file_path: path, ..Default::default() };
                    let added = composer.add_composable_module(descriptor).map(|_| ());
                    added.map_err(|cause| failure(composer, path, &cause))?;
                }
                Part::Instance { name, path, text, definitions } => {
                    add_instance(composer, name, path, text, definitions)?;
                }
            }
        }
        let shader_defs = definitions.iter().map(|&name| (name.to_owned(), ShaderDefValue::Bool(true))).collect();
        let descriptor = NagaModuleDescriptor { source, file_path: path, shader_defs, ..Default::default() };
        let mut module = match composer.make_naga_module(descriptor) {
            Ok(module) => module,
            Err(cause) => return Err(failure(composer, path, &cause)),
        };
        naga::compact::compact(&mut module, naga::compact::KeepUnused::No);
        rename(&mut module);
        Ok(module)
    }

    /// Adds the instances that `program` needs and returns its own text.
    fn program_text(&mut self, import_path: &str, program: &Program) -> Result<String> {
        let mut body = String::new();
        let mut names = vec![String::new(); program.registers];
        for (number, instruction) in program.instructions.iter().enumerate() {
            let mut definitions = instruction.mode.shader_definitions();
            let mut arguments = Vec::new();
            let mut component = 0;
            for socket in instruction.node_type.inputs_of(&instruction.mode) {
                let operands = &instruction.inputs[component..component + socket.kind.components()];
                component += operands.len();
                if operands.iter().all(|operand| matches!(operand, Operand::Constant(value) if *value == 0.0)) {
                    definitions.push(shader_name(&format!("input_{}_is_zero", socket.identifier)));
                }
                arguments.push(self.expression(operands, &names, &instruction.label)?);
            }
            let module = instruction.node_type.module;
            let mut constants = instruction.mode.shader_constants();
            for (number, texture) in instruction.evaluator.textures().into_iter().enumerate() {
                line(&mut constants, format_args!("const TEXELS_{number}: u32 = {}u;", self.first_word(texture)));
            }
            constants += &instruction.evaluator.shader_constants();
            let key = format!("{module} {} {constants}", definitions.join(" "));
            let instance = match self.instances.get(&key) {
                Some(instance) => instance.clone(),
                None => {
                    let count = self.counts.entry(module).or_default();
                    *count += 1;
                    // A letter last: the composer reserves names that end in a digit.
                    let instance = format!("{module}_{count}i");
                    let path = format!("nodes/{module}.wgsl");
                    let text = with_constants(instruction.node_type.shader, &constants);
                    self.parts.push(Part::Instance { name: instance.clone(), path, text, definitions });
                    self.instances.insert(key, instance.clone());
                    instance
                }
            };
            let variable = format!("n{number}v");
            line(&mut body, format_args!("    // {}", comment(&instruction.label)));
            line(&mut body, format_args!("    let {variable} = {instance}::evaluate({});", arguments.join(", ")));
            let single = instruction.node_type.outputs_of(&instruction.mode).count() == 1;
            let mut register = instruction.first_register;
            for (identifier, kind) in &instruction.outputs {
                let value = if single {
                    variable.clone()
                } else {
                    format!("{variable}.{}", shader_name(identifier).to_lowercase())
                };
                for axis in 0..kind.components() {
                    names[register] =
                        if kind.components() == 1 { value.clone() } else { format!("{value}.{}", AXES[axis]) };
                    register += 1;
                }
            }
        }
        let mut text = format!("#define_import_path {import_path}\n\n");
        match self.constants {
            Constants::InText => {}
            Constants::InBuffer(_) => text.push_str("#import cloudparity::numbers::numbers\n\n"),
            Constants::OfParameters(..) => text.push_str("#import cloudparity::parameters::parameters\n\n"),
        }
        let attributes: String = (0..program.attributes.len()).map(|number| format!(", a{number}v: vec3f")).collect();
        let expressions: Vec<String> = program
            .outputs
            .iter()
            .map(|output| self.expression(&output.operands, &names, &output.name))
            .collect::<Result<_>>()?;
        let kinds: Vec<&str> = program.outputs.iter().map(|output| type_name(output.kind)).collect();
        let (kind, value) = match expressions.as_slice() {
            [one] => (kinds[0].to_owned(), one.clone()),
            several => {
                text.push_str("struct Outputs {\n");
                for (number, kind) in kinds.iter().enumerate() {
                    line(&mut text, format_args!("    o{number}v: {kind},"));
                }
                text.push_str("}\n\n");
                ("Outputs".to_owned(), format!("Outputs({})", several.join(", ")))
            }
        };
        line(&mut text, format_args!("fn evaluate(position: vec3f{attributes}) -> {kind} {{"));
        text.push_str(&body);
        line(&mut text, format_args!("    return {value};\n}}"));
        Ok(text)
    }

    /// One component as WGSL.
    fn scalar(&mut self, operand: &Operand, names: &[String], place: &str) -> Result<String> {
        Ok(match operand {
            Operand::Constant(value) if value.is_finite() => match &mut self.constants {
                Constants::InBuffer(numbers) if *value != 0.0 => {
                    numbers.push(*value);
                    format!("numbers[{}]", numbers.len() - 1)
                }
                Constants::OfParameters(parameters, next) if *value != 0.0 => {
                    *next += 1;
                    parameters.expression(*next - 1).unwrap_or_else(|| format!("{value:?}f"))
                }
                _ => format!("{value:?}f"),
            },
            Operand::Constant(value) => {
                return Err(Error::new(
                    format!("shader: {place}"),
                    format!("the constant {value}"),
                    "a finite constant (WGSL has no infinities and no NaN)",
                    "Change the settings that lead to it, or evaluate on the CPU.",
                ));
            }
            Operand::Position(axis) => format!("position.{}", AXES[*axis]),
            Operand::Attribute(number, axis) => format!("a{number}v.{}", AXES[*axis]),
            Operand::Register(register) => names[*register].clone(),
        })
    }

    /// One socket's components as WGSL; a whole vector is named as such.
    fn expression(&mut self, operands: &[Operand], names: &[String], place: &str) -> Result<String> {
        let parts: Vec<String> =
            operands.iter().map(|operand| self.scalar(operand, names, place)).collect::<Result<_>>()?;
        if parts.len() == 1 {
            return Ok(parts[0].clone());
        }
        if let Some(whole) = parts[0].strip_suffix(".x")
            && parts.iter().zip(AXES).all(|(part, axis)| *part == format!("{whole}.{axis}"))
        {
            return Ok(whole.to_owned());
        }
        Ok(format!("vec3f({})", parts.join(", ")))
    }
}

fn failure(composer: &Composer, path: &str, cause: &ComposerError) -> Error {
    Error::new(
        format!("shader {path}"),
        cause.emit_to_string(composer),
        "a module that composes and validates",
        "This is a defect of the program: report it with the scene file.",
    )
}

/// Adds one instance of a node's module under `instance`.
///
/// The definitions of a composition are shared by all its modules, so the conditions are
/// resolved here, before the composer sees the text. The preprocessor also turns imports into
/// decorated names, which the composer refuses in a text that it is handed; hence the module is
/// added empty, with its imports, and receives its text afterwards.
fn add_instance(
    composer: &mut Composer,
    instance: &str,
    path: &str,
    source: &str,
    definitions: &[String],
) -> Result<()> {
    let definitions: HashMap<String, ShaderDefValue> =
        definitions.iter().map(|name| (name.clone(), ShaderDefValue::Bool(true))).collect();
    let (_, imports, _) = get_preprocessor_data(source);
    let mut merged: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for import in imports {
        merged.entry(import.import).or_default().extend(import.items);
    }
    let imports: Vec<ImportDefinition> = merged
        .into_iter()
        .map(|(import, items)| ImportDefinition { import, items: items.into_iter().collect() })
        .collect();
    let descriptor = ComposableModuleDescriptor {
        source: "",
        file_path: path,
        as_name: Some(instance.to_owned()),
        additional_imports: &imports,
        ..Default::default()
    };
    let added = composer.add_composable_module(descriptor).map(|_| ());
    added.map_err(|cause| failure(composer, path, &cause))?;
    let text = PREPROCESSOR.preprocess(source, &definitions).map_err(|inner| {
        let source = ErrSource::Constructing { path: path.to_owned(), source: source.to_owned(), offset: 0 };
        failure(composer, path, &ComposerError { inner, source })
    })?;
    let module = composer.module_sets.get_mut(instance).expect("the module was just added");
    module.sanitized_source = text.preprocessed_source;
    Ok(())
}

/// A module's text with declarations behind its imports.
fn with_constants(source: &str, constants: &str) -> String {
    if constants.is_empty() {
        return source.to_owned();
    }
    let is_import = |line: &str| line.trim_start().starts_with("#import");
    let imports =
        source.lines().collect::<Vec<_>>().iter().rposition(|line| is_import(line)).map_or(0, |last| last + 1);
    let (head, body): (Vec<_>, Vec<_>) = source.lines().enumerate().partition(|(number, _)| *number < imports);
    let text = |lines: Vec<(usize, &str)>| lines.into_iter().map(|(_, line)| format!("{line}\n")).collect::<String>();
    format!("{}{constants}{}", text(head), text(body))
}

const AXES: [&str; 3] = ["x", "y", "z"];

fn line(text: &mut String, parts: std::fmt::Arguments<'_>) {
    writeln!(text, "{parts}").expect("writing to a string cannot fail");
}

/// A name of the user as the text of a comment. A line break of any kind would end the comment, and
/// the composer reads `#` as the start of a command.
fn comment(name: &str) -> String {
    let is_unsafe = |c: char| c.is_control() || matches!(c, '\u{2028}' | '\u{2029}' | '#' | '*' | '"' | ':');
    name.chars().map(|c| if is_unsafe(c) { ' ' } else { c }).collect()
}

fn type_name(kind: SocketType) -> &'static str {
    if kind.components() == 1 { "f32" } else { "vec3f" }
}

/// Gives functions and types the names that a person reads: `math_1i_evaluate`, not the composer's
/// decorated form.
fn rename(module: &mut naga::Module) {
    let plain = |name: &str| undecorate(name);
    for (_, function) in module.functions.iter_mut() {
        function.name = function.name.as_deref().map(plain);
    }
    for (_, variable) in module.global_variables.iter_mut() {
        variable.name = variable.name.as_deref().map(plain);
    }
    for (_, constant) in module.constants.iter_mut() {
        constant.name = constant.name.as_deref().map(plain);
    }
    let types: Vec<_> = module.types.iter().map(|(handle, kind)| (handle, kind.clone())).collect();
    for (handle, mut kind) in types {
        // A type that keeps its name stays: the arena refuses to replace one by its equal.
        let Some(name) = kind.name.as_deref().map(plain) else { continue };
        if kind.name.as_deref() != Some(name.as_str()) {
            kind.name = Some(name);
            module.types.replace(handle, kind);
        }
    }
}

/// `itemX_naga_oil_mod_XBASE32X` as `module_item`.
fn undecorate(name: &str) -> String {
    const MARK: &str = "X_naga_oil_mod_X";
    let Some((item, rest)) = name.split_once(MARK) else { return name.to_owned() };
    // The code may hold the letter that ends it: the last one of the run counts.
    let run = rest.find(|c: char| !c.is_ascii_uppercase() && !c.is_ascii_digit()).unwrap_or(rest.len());
    let Some(end) = rest[..run].rfind('X') else { return name.to_owned() };
    let (encoded, tail) = (&rest[..end], &rest[end + 1..]);
    let mut bits = 0_u32;
    let mut count = 0;
    let mut module = String::new();
    for digit in encoded.bytes() {
        let value = match digit {
            b'A'..=b'Z' => digit - b'A',
            b'2'..=b'7' => digit - b'2' + 26,
            _ => return name.to_owned(),
        };
        bits = (bits << 5) | u32::from(value);
        count += 5;
        if count >= 8 {
            count -= 8;
            module.push(char::from((bits >> count) as u8));
        }
    }
    let module = module.rsplit("::").next().unwrap_or_default();
    format!("{module}_{item}{tail}")
}

/// Entry point that evaluates the density at the points of a storage buffer.
const STANDALONE: &str = include_str!("../../shaders/graph/density_at_points.wgsl");

/// The density function with an entry point, as bytes of `language`.
pub fn standalone(program: &Program, language: Language) -> Result<Vec<u8>> {
    let module = Linker::new(program)?.link("graph/density_at_points.wgsl", STANDALONE)?;
    write(&module, language)
}

/// The same with constants that are computed from parameters in a uniform, binding 8 of group 0.
pub fn standalone_with_parameters(
    program: &Program,
    parameters: &ProgramParameters,
    language: Language,
) -> Result<Vec<u8>> {
    let linker = Linker::with_parameters(program, parameters)?;
    write(&linker.link("graph/density_at_points.wgsl", STANDALONE)?, language)
}

/// Validates with what every WebGPU implementation offers.
pub fn validate(module: &naga::Module) -> Result<naga::valid::ModuleInfo> {
    let flags = naga::valid::ValidationFlags::all();
    naga::valid::Validator::new(flags, naga::valid::Capabilities::empty()).validate(module).map_err(|cause| {
        Error::new(
            "shader",
            cause.into_inner().to_string(),
            "a valid module",
            "This is a defect of the program: report it with the scene file.",
        )
    })
}

/// The largest f32 as the writer of naga puts it: the shortest decimals that round to it, which are a little more. Chromium's compiler refuses
/// a literal above the largest number.
const LARGEST_IN_DECIMALS: &str = "340282350000000000000000000000000000000f";

/// The same number exactly.
const LARGEST: &str = "0x1.fffffep+127f";

/// Writes a module in a language.
pub fn write(module: &naga::Module, language: Language) -> Result<Vec<u8>> {
    use naga::back;
    let info = validate(module)?;
    let failure = |cause: String| {
        Error::new("shader", cause, "a module that the language can express", "Choose another target language.")
    };
    let entry = module.entry_points.first().map(|entry| entry.name.clone()).unwrap_or_default();
    Ok(match language {
        Language::Wgsl => back::wgsl::write_string(module, &info, back::wgsl::WriterFlags::empty())
            .map_err(|cause| failure(cause.to_string()))?
            .replace(LARGEST_IN_DECIMALS, LARGEST)
            .into_bytes(),
        Language::Spirv => {
            let options = back::spv::Options { lang_version: (1, 3), ..Default::default() };
            let words =
                back::spv::write_vec(module, &info, &options, None).map_err(|cause| failure(cause.to_string()))?;
            words.iter().flat_map(|word| word.to_le_bytes()).collect()
        }
        Language::Glsl => {
            // GLSL has no groups; the numbers of the only group stay.
            let bindings = module.global_variables.iter().filter_map(|(_, variable)| variable.binding);
            let options = back::glsl::Options {
                version: back::glsl::Version::Desktop(450),
                binding_map: bindings.filter_map(|place| Some((place, u8::try_from(place.binding).ok()?))).collect(),
                ..Default::default()
            };
            let pipeline = back::glsl::PipelineOptions {
                shader_stage: naga::ShaderStage::Compute,
                entry_point: entry,
                multiview: None,
            };
            let mut text = String::new();
            back::glsl::Writer::new(
                &mut text,
                module,
                &info,
                &options,
                &pipeline,
                naga::proc::BoundsCheckPolicies::default(),
            )
            .and_then(|mut writer| writer.write())
            .map_err(|cause| failure(cause.to_string()))?;
            text.into_bytes()
        }
        Language::Hlsl => {
            let options = back::hlsl::Options { fake_missing_bindings: true, ..Default::default() };
            let pipeline = back::hlsl::PipelineOptions::default();
            let mut text = String::new();
            back::hlsl::Writer::new(&mut text, &options, &pipeline)
                .write(module, &info, None)
                .map_err(|cause| failure(cause.to_string()))?;
            text.into_bytes()
        }
        Language::Msl => {
            let options =
                back::msl::Options { fake_missing_bindings: true, lang_version: (2, 4), ..Default::default() };
            back::msl::write_string(module, &info, &options, &back::msl::PipelineOptions::default())
                .map_err(|cause| failure(cause.to_string()))?
                .0
                .into_bytes()
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_number_is_written_so_that_every_compiler_takes_it() {
        let source = "@group(0) @binding(0) var<storage, read_write> result: f32;
            @compute @workgroup_size(1) fn main() { result = max(result, -3.40282347e38); }";
        let module = Linker::bare().link("largest.wgsl", source).expect("it links");
        let text = String::from_utf8(write(&module, Language::Wgsl).expect("WGSL")).expect("text");
        assert!(text.contains("-0x1.fffffep+127f"), "{text}");
        let again = naga::front::wgsl::parse_str(&text).expect("it parses");
        let again = String::from_utf8(write(&again, Language::Wgsl).expect("WGSL")).expect("text");
        assert!(again.contains("-0x1.fffffep+127f"), "another number: {again}");
    }
}
