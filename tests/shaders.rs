//! Generated shaders: every target language, every node in every mode, every file of `shaders/`, and
//! nothing in a shader that its graph does not use.

mod support;

use assert_cmd::Command;
use cloudparity::base::error::Result;
use cloudparity::base::texture::{Outside, TexelFormat, Texture, TextureFilter, TextureHandle};
use cloudparity::engines;
use cloudparity::graph::build::IDENTITY;
use cloudparity::graph::wgsl::{self, Linker};
use cloudparity::graph::{Program, Target};
use cloudparity::integrators::{march, path};
use cloudparity::measure::nodes::suite::modes;
use cloudparity::nodes::perlin_fbm::{self, Cloud, Parameters};
use cloudparity::nodes::{self, Data, Mode, NodeType, Role};
use cloudparity::nodes::{cloud_texture, ellipsoid_clusters, lattice_noise};
use cloudparity::scene::bare_scene;
use rayon::prelude::*;
use serde_json::{Map, Value as Json, json};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Set to renew the committed WGSL of the cloud.
const RENEW: &str = "CLOUDPARITY_RENEW_SNAPSHOTS";

/// Nodes per generated module: what all modules share is parsed once for this many.
const NODES_PER_MODULE: usize = 12;

/// Every file below a folder of the project with this ending, sorted.
fn files_below(folder: &str, ending: &str) -> Vec<PathBuf> {
    let mut open = vec![support::project(folder)];
    let mut found = Vec::new();
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder of the project") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                open.push(path);
            } else if path.to_string_lossy().ends_with(ending) {
                found.push(path);
            }
        }
    }
    found.sort();
    assert!(!found.is_empty(), "no {ending} in {folder}");
    found
}

/// Validates with all of naga's capabilities (native) and with those of every WebGPU implementation; and no vector of integers is chosen by one of
/// bools, which GLSL ES 3.00 writes as a `mix` that it has for floats alone.
fn validate(what: &str, module: &naga::Module) {
    for capabilities in [naga::valid::Capabilities::all(), naga::valid::Capabilities::empty()] {
        let mut validator = naga::valid::Validator::new(naga::valid::ValidationFlags::all(), capabilities);
        let info = validator.validate(module).unwrap_or_else(|cause| {
            panic!("{what} with {capabilities:?}: {}", cause.into_inner());
        });
        for (handle, function) in module.functions.iter() {
            assert!(!chooses_integers(module, function, &info[handle]), "{what}: {:?} chooses integers", function.name);
        }
    }
}

fn chooses_integers(module: &naga::Module, function: &naga::Function, info: &naga::valid::FunctionInfo) -> bool {
    use naga::{Expression, ScalarKind, TypeInner};
    let kind = |handle: naga::Handle<Expression>| info[handle].ty.inner_with(&module.types).clone();
    function.expressions.iter().any(|(_, expression)| match *expression {
        Expression::Select { condition, accept, .. } => {
            let is_integer = matches!(kind(accept).scalar_kind(), Some(ScalarKind::Sint | ScalarKind::Uint));
            matches!(kind(condition), TypeInner::Vector { .. }) && is_integer
        }
        _ => false,
    })
}

#[test]
fn an_integer_chosen_by_a_vector_is_found() {
    let source = |value: &str| {
        let text = format!("fn chosen(a: {value}, b: {value}, c: vec2<bool>) -> {value} {{ return select(a, b, c); }}");
        naga::front::wgsl::parse_str(&text).expect("WGSL")
    };
    validate("floats", &source("vec2f"));
    assert!(std::panic::catch_unwind(|| validate("integers", &source("vec2u"))).is_err());
}

/// Names of functions and of structs.
fn declared_names(module: &naga::Module) -> BTreeSet<String> {
    let functions = module.functions.iter().filter_map(|(_, function)| function.name.clone());
    functions.chain(module.types.iter().filter_map(|(_, kind)| kind.name.clone())).collect()
}

#[test]
fn every_scene_gives_a_shader_in_every_language() {
    let tools = support::require("spirv-tools");
    for scene in files_below("parity/scenes", ".scene.json") {
        let folder = tempfile::tempdir().expect("a temporary folder");
        // A grid's file is read by Blender's Python; tests/volume_grid.rs has its shader.
        if std::fs::read_to_string(&scene).expect("a scene").contains("\"type\": \"grid\"") {
            continue;
        }
        for (language, ending, start) in [
            ("wgsl", "wgsl", ""),
            ("spirv", "spv", "\u{3}\u{2}#\u{7}"),
            ("glsl", "comp", "#version 450 core\n"),
            ("hlsl", "hlsl", ""),
            ("msl", "metal", "// language: metal2.4\n"),
        ] {
            let output = folder.path().join(format!("shader.{ending}"));
            Command::new(env!("CARGO_BIN_EXE_cloudparity"))
                .args(["shader".as_ref(), scene.as_os_str(), "--language".as_ref(), language.as_ref(), "-o".as_ref()])
                .arg(&output)
                .assert()
                .success();
            let bytes = std::fs::read(&output).expect("the shader");
            assert!(bytes.len() > 100 && bytes.starts_with(start.as_bytes()), "{} {language}", scene.display());
            let checker = match language {
                "spirv" => Some(("spirv-val", vec!["--target-env", "vulkan1.1"])),
                "glsl" => Some(("glslangValidator", vec![])),
                _ => None,
            };
            if let Some((program, arguments)) = checker.filter(|_| tools) {
                Command::new(program).args(arguments).arg(&output).assert().success();
            }
            if language == "wgsl" {
                // The text is complete and names nothing that WGSL reserves.
                let text = String::from_utf8(bytes).expect("text");
                let module = naga::front::wgsl::parse_str(&text)
                    .unwrap_or_else(|cause| panic!("{}: {}", scene.display(), cause.emit_to_string(&text)));
                validate(&scene.display().to_string(), &module);
            }
        }
    }
}

#[test]
fn the_checkers_refuse_a_damaged_shader() {
    if !support::require("spirv-tools") {
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let program = Program::density(&support::scene("procedural-clouds")).expect("the cloud compiles");
    let mut binary = wgsl::standalone(&program, wgsl::Language::Spirv).expect("SPIR-V");
    binary.truncate(binary.len() - 4);
    let path = folder.path().join("cut.spv");
    std::fs::write(&path, binary).expect("a temporary file");
    Command::new("spirv-val").arg(&path).assert().failure();
    let text = String::from_utf8(wgsl::standalone(&program, wgsl::Language::Glsl).expect("GLSL")).expect("text");
    let path = folder.path().join("cut.comp");
    std::fs::write(&path, text.replacen("float", "flaot", 1)).expect("a temporary file");
    Command::new("glslangValidator").arg(&path).assert().failure();
}

#[test]
fn the_cloud_is_written_as_committed() {
    let program = Program::density(&support::scene("procedural-clouds")).expect("the cloud compiles");
    let text = String::from_utf8(wgsl::standalone(&program, wgsl::Language::Wgsl).expect("WGSL")).expect("text");
    let path = support::project("parity/snapshots/procedural-clouds.wgsl");
    if std::env::var_os(RENEW).is_some() {
        cloudparity::base::files::write_atomically(&path, text.as_bytes()).expect("the snapshot is written");
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    let different = text.lines().zip(committed.lines()).position(|(new, old)| new != old);
    assert!(
        text == committed,
        "{} differs from the generated text from line {} on. When the change is meant, run \
         {RENEW}=1 cargo test --release --test shaders and review the difference.",
        path.display(),
        different.unwrap_or_else(|| text.lines().count().min(committed.lines().count())) + 1
    );
}

#[test]
fn the_cloud_holds_nothing_that_it_does_not_use() {
    let scene = support::scene("procedural-clouds");
    let program = Program::density(&scene).expect("the cloud compiles");
    let module = linked(&program);
    let names = declared_names(&module);
    let modules: BTreeSet<&str> = program.instructions.iter().map(|instruction| instruction.node_type.module).collect();
    for name in &names {
        assert!(!name.contains("naga_oil"), "a name that nobody can read: {name}");
        // Modes that the cloud does not have, and nodes that it does not hold.
        let is_texture = ["voronoi", "noise_texture"].iter().any(|module| name.starts_with(module));
        for absent in ["smooth", "edge", "ridged", "hybrid", "hetero", "fbm"] {
            assert!(!is_texture || !name.contains(absent), "{name} is in the cloud's shader");
        }
        for node_type in nodes::registry().iter().filter(|node_type| !node_type.shader.is_empty()) {
            let is_of_node = name
                .strip_prefix(node_type.module)
                .is_some_and(|rest| rest.starts_with('_') && rest[1..].starts_with(|c: char| c.is_ascii_digit()));
            assert!(!is_of_node || modules.contains(node_type.module), "{name} is in the cloud's shader");
        }
    }
    // The same question finds them in a graph that has them.
    let minkowski = json!({"distance": "MINKOWSKI", "feature": "SMOOTH_F1"});
    let voronoi = nodes::find("ShaderNodeTexVoronoi").expect("a registered node");
    let mode = minkowski.as_object().expect("an object").clone();
    let names = declared_names(&linked(&program_of(voronoi, &[mode], Inputs::Linked, None).expect("a program")));
    assert!(names.iter().any(|name| name.contains("smooth")), "{names:?}");
}

/// Outputs of Separate XYZ.
const AXES: [&str; 3] = ["X", "Y", "Z"];

/// What the inputs of a generated node are.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Inputs {
    /// All linked to something that varies.
    Linked,
    /// All but the first are the constant 0, for which modules hold shorter code.
    Zero,
}

/// A program of one node per mode, each with all outputs wanted or with the one of this number; none
/// where no mode has that output.
fn program_of(
    node_type: &'static NodeType,
    modes: &[Map<String, Json>],
    inputs: Inputs,
    output: Option<usize>,
) -> Option<Program> {
    let mut graph = vec![
        json!({"name": "Coordinate", "type": "ShaderNodeTexCoord"}),
        json!({"name": "Separate", "type": "ShaderNodeSeparateXYZ",
               "inputs": {"Vector": {"node": "Coordinate", "socket": "Object"}}}),
    ];
    let mut targets = Vec::new();
    for (number, properties) in modes.iter().enumerate() {
        let mode = Mode::read(node_type, properties, node_type.label).expect("a mode of the registry");
        let mut stored = Map::new();
        for (index, socket) in node_type.inputs_of(&mode).enumerate() {
            let is_vector = socket.kind.components() == 3;
            let value = match (inputs == Inputs::Linked || index == 0, is_vector) {
                (true, true) => json!({"node": "Coordinate", "socket": "Object"}),
                (true, false) => json!({"node": "Separate", "socket": AXES[index % 3]}),
                (false, true) => json!([0.0, 0.0, 0.0]),
                (false, false) => json!(0.0),
            };
            stored.insert(socket.identifier.to_owned(), value);
        }
        let name = format!("Node {number}");
        graph.push(json!({"name": name, "type": node_type.type_name, "properties": properties, "inputs": stored}));
        let outputs: Vec<_> = node_type.outputs_of(&mode).collect();
        match output {
            None => targets.extend(outputs.iter().map(|output| Target::output(&name, output.identifier))),
            // A mode with a single output was asked for it when all were.
            Some(wanted) if outputs.len() > 1 => {
                targets.extend(outputs.get(wanted).map(|output| Target::output(&name, output.identifier)));
            }
            Some(_) => {}
        }
    }
    let scene = bare_scene("modes", json!({"material": "Material", "nodes": graph, "groups": []})).expect("a scene");
    let what = || format!("{} {modes:?} {inputs:?} {output:?}", node_type.label);
    (!targets.is_empty())
        .then(|| Program::compile(&scene, &targets).unwrap_or_else(|cause| panic!("{}: {cause}", what())))
}

/// Links a program to an entry that evaluates it once.
fn linked(program: &Program) -> naga::Module {
    let entry = "#import cloudparity::graph\n\
        @group(0) @binding(0) var<storage, read> position: vec3f;\n\
        @compute @workgroup_size(1)\n\
        fn main() { let value = graph::evaluate(position); }\n";
    Linker::new(program).and_then(|linker| linker.link("test.wgsl", entry)).unwrap_or_else(|cause| {
        panic!("{cause}\n{}", program.instructions.iter().map(|i| i.label.as_str()).collect::<String>())
    })
}

fn evaluated_types() -> impl Iterator<Item = &'static NodeType> {
    nodes::registry().iter().copied().filter(|node_type| matches!(node_type.role, Role::Evaluated(_)))
}

/// Every mode of every node, linked and validated; the names of all functions by module of a node.
fn link_every_mode() -> BTreeSet<String> {
    let mut work = Vec::new();
    for node_type in evaluated_types() {
        let most_outputs = node_type.outputs.len();
        for chunk in modes(node_type).chunks(NODES_PER_MODULE) {
            for inputs in [Inputs::Linked, Inputs::Zero] {
                let single = (0..most_outputs).map(Some);
                work.extend(
                    std::iter::once(None).chain(single).map(|output| (node_type, chunk.to_vec(), inputs, output)),
                );
            }
        }
    }
    let linked_programs: Vec<BTreeSet<String>> = work
        .into_par_iter()
        .filter_map(|(node_type, modes, inputs, output)| {
            let program = program_of(node_type, &modes, inputs, output)?;
            let module = linked(&program);
            validate(&format!("{} {modes:?} {inputs:?} {output:?}", node_type.label), &module);
            Some(declared_names(&module))
        })
        .collect();
    assert!(linked_programs.len() >= 50, "only {} modules", linked_programs.len());
    linked_programs.into_iter().flatten().collect()
}

/// A texture with a mapping of its own, which the compiler puts before it.
fn link_mapped_texture() -> BTreeSet<String> {
    let texture = |name: &str, kind: &str| {
        json!({
            "name": name, "type": "ShaderNodeTexGradient",
            "properties": {"texture_mapping": {
                "vector_type": kind, "translation": [1, 0, 0], "rotation": [0, 0, 0.5], "scale": [2, 1, 1],
                "mapping_x": "X", "mapping_y": "Y", "mapping_z": "Z",
            }},
        })
    };
    let nodes = [texture("Point", "POINT"), texture("Normal", "NORMAL")];
    let scene = bare_scene("mapped", json!({"material": "Material", "nodes": nodes, "groups": []})).expect("a scene");
    let targets = ["Point", "Normal"].map(|name| Target::output(name, "Fac"));
    let module = linked(&Program::compile(&scene, &targets).expect("the textures compile"));
    validate("textures with mappings", &module);
    declared_names(&module)
}

/// A file of `shaders/`.
struct Shader {
    /// Below `shaders/`, with slashes.
    path: String,
    text: String,
    import_path: Option<String>,
    is_entry: bool,
}

fn shaders() -> BTreeMap<String, Shader> {
    let root = support::project("shaders");
    files_below("shaders", ".wgsl")
        .into_iter()
        .map(|file| {
            let below: &Path = file.strip_prefix(&root).expect("a file below the folder");
            let path = below.iter().map(|part| part.to_string_lossy()).collect::<Vec<_>>().join("/");
            let text = std::fs::read_to_string(&file).expect("a shader");
            let import_path =
                text.lines().find_map(|line| line.strip_prefix("#define_import_path ")).map(str::to_owned);
            let is_entry = ["@compute", "@vertex", "@fragment"].iter().any(|stage| text.contains(stage));
            (path.clone(), Shader { path, text, import_path, is_entry })
        })
        .collect()
}

/// Names that a text has conditions on.
fn definitions(text: &str) -> BTreeSet<String> {
    text.lines()
        .filter(|line| line.starts_with("#if") || line.starts_with("#else if"))
        .filter_map(|line| line.split(' ').next_back().map(str::to_owned))
        .collect()
}

/// Texel formats, filters and outsides in turn, so that three textures have all of them.
fn textures() -> [TextureHandle; 3] {
    [
        (TexelFormat::F32, TextureFilter::Trilinear, Outside::Clamp),
        (TexelFormat::F16, TextureFilter::Nearest, Outside::Repeat),
        (TexelFormat::Unorm8, TextureFilter::Trilinear, Outside::Zero),
    ]
    .map(|(format, filter, outside)| {
        let values = (0..27).map(|number| number as f32).collect();
        TextureHandle::new(Texture::store([3; 3], values, format, filter, outside, "a test").expect("ordinary values"))
    })
}

/// A program that reads a texture, with the position as its index.
fn lookup(texture: TextureHandle) -> Program {
    Program::of_texture("texture", texture, IDENTITY)
}

/// A small cloud of Perlin-FBM.
fn perlin_fbm_cloud() -> Program {
    let cloud = Cloud::new(Parameters { texture_size: 8, ..Parameters::default() }).expect("in range");
    let mode = Mode::of_data(&perlin_fbm::TYPE, vec![(perlin_fbm::PARAMETERS, Data::PerlinFbm(Arc::new(cloud)))]);
    Program::of_node("Perlin-FBM", &perlin_fbm::TYPE, mode, IDENTITY)
}

/// Nodes of ours that no file of Blender holds, linked and validated.
fn link_own_nodes() -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let in_modes =
        [&lattice_noise::TYPE, &cloud_texture::TYPE, &ellipsoid_clusters::TYPE].into_iter().flat_map(|node| {
            let read = |properties| Mode::read(node, &properties, "test").expect("a mode of the node");
            let mode = move |properties| Program::of_node(node.module, node, read(properties), IDENTITY);
            modes(node).into_iter().map(mode).collect::<Vec<_>>()
        });
    for program in textures().map(lookup).into_iter().chain([perlin_fbm_cloud()]).chain(in_modes) {
        let module = linked(&program);
        validate("a node of ours", &module);
        names.extend(declared_names(&module));
    }
    names
}

/// A world that sends the direction that it is seen in.
fn world() -> Result<Program> {
    let link = |node: &str, socket: &str| json!({"node": node, "socket": socket});
    let graph = json!({"material": "World", "groups": [], "nodes": [
        {"name": "Seen", "type": "ShaderNodeTexCoord", "properties": {}, "inputs": {}},
        {"name": "B", "type": "ShaderNodeBackground", "properties": {}, "inputs": {"Color": link("Seen", "Generated"), "Strength": 1.0}},
        {"name": "World Output", "type": "ShaderNodeOutputWorld", "properties": {}, "inputs": {"Surface": link("B", "Background")}},
    ]});
    Program::world(&serde_json::from_value(graph).expect("well formed"))
}

/// A linker with all that entries import: a program, two averages, a world, the constants of every kernel, and a system's own terms.
fn linker(program: &Program) -> Result<Linker> {
    let mut linker = Linker::new(program)?;
    for constants in
        [&engines::march::gpu::CONSTANTS, &engines::march::camera::CONSTANTS, &march::CONSTANTS, &path::CONSTANTS]
    {
        linker.add_constants(constants);
    }
    let [along, around, _] = textures();
    linker.add_program("cloudparity::averages::along", &lookup(along))?;
    linker.add_program("cloudparity::averages::around", &lookup(around))?;
    linker.add_program(path::WORLD_PATH, &world()?)?;
    let terms = "#define_import_path cloudparity::engines::own_terms\n\
                 fn source(place: vec3f, height: f32, extinction: f32) -> vec3f { return vec3f(height * extinction) + place; }\n";
    linker.add("generated/terms.wgsl", terms);
    Ok(linker)
}

#[test]
fn every_mode_and_every_file_links_and_validates() {
    let mut names = link_every_mode();
    names.extend(link_mapped_texture());
    names.extend(link_own_nodes());
    let all = shaders();
    let mut used: BTreeSet<String> = BTreeSet::new();
    // A program without textures, one with a single texture, and one with three.
    let programs = [
        Program::density(&support::scene("procedural-clouds")).expect("the cloud compiles"),
        lookup(textures()[0].clone()),
        perlin_fbm_cloud(),
    ];
    let mut check = |program: &Program, path: &str, definitions: &[&str]| {
        let name = format!("{path} {definitions:?}");
        let module = linker(program).and_then(|linker| linker.link_with(path, &all[path].text, definitions));
        let module = module.unwrap_or_else(|cause| panic!("{name}: {cause}"));
        assert!(!module.entry_points.is_empty(), "{name}: no entry point");
        validate(&name, &module);
        names.extend(declared_names(&module));
    };
    // What makes a whole picture, a fragment or a kernel, has no entry but its own, which is linked below.
    const PARTS: [&str; 3] = ["IN_PICTURE", "IN_FRAGMENT", "IN_FRAME"];
    const PICTURE: (&str, &[&str], naga::ShaderStage) =
        ("engines/picture.wgsl", &["IN_PICTURE", "IN_FRAGMENT"], naga::ShaderStage::Fragment);
    const FRAME: (&str, &[&str], naga::ShaderStage) =
        ("engines/frame.wgsl", &["IN_PICTURE", "IN_FRAME"], naga::ShaderStage::Compute);
    let check_picture = |(path, own, stage): (&str, &[&str], naga::ShaderStage), definitions: &[&str]| {
        let name = format!("{path} {definitions:?}");
        for program in &programs {
            let linked = linker(program).and_then(|mut linker| {
                let data = "#define_import_path cloudparity::engines::data\n\
                            const CELLS: u32 = 1u;\nconst MAPS: u32 = 2u;\nconst SUNS: u32 = 3u;\n";
                linker.add("generated/data.wgsl", data);
                for path in ["engines/march.wgsl", "engines/camera.wgsl", "engines/passes/compositing.wgsl"] {
                    linker.add(path, &all[path].text);
                }
                linker.link_with(path, &all[path].text, &[definitions, own].concat())
            });
            let module = linked.unwrap_or_else(|cause| panic!("{name}: {cause}"));
            let entries: Vec<_> = module.entry_points.iter().map(|entry| entry.stage).collect();
            assert_eq!(entries, [stage], "{name}");
            validate(&name, &module);
        }
    };
    for shader in all.values().filter(|shader| shader.is_entry && ![PICTURE.0, FRAME.0].contains(&&*shader.path)) {
        let reads_program = shader.text.contains("#import cloudparity::graph");
        for program in &programs[..if reads_program { programs.len() } else { 1 }] {
            check(program, &shader.path, &[]);
        }
        // Each definition alone.
        for definition in definitions(&shader.text).into_iter().filter(|definition| !PARTS.contains(&&**definition)) {
            check(&programs[1], &shader.path, &[&definition]);
        }
        used.insert(shader.path.clone());
    }
    let march = &all["engines/march.wgsl"];
    // Rays that a kernel or a fragment makes have one interval, so they are in no mesh; nor have they air. Fragments have no light from below, nor
    // parts of a view.
    let is_for_frames =
        |definition: &str| !PARTS.contains(&definition) && definition != "MESH" && !definition.starts_with("AIR");
    let is_for_fragments =
        |definition: &str| is_for_frames(definition) && !["GROUND", "SHADOW_CASCADES"].contains(&definition);
    for definition in definitions(&march.text).into_iter().filter(|definition| is_for_frames(definition)) {
        check_picture(FRAME, &[&definition]);
        if is_for_fragments(&definition) {
            check_picture(PICTURE, &[&definition]);
        }
    }
    check_picture(PICTURE, &["BACKGROUND"]);
    let of_compositing = definitions(&all["engines/passes/compositing.wgsl"].text);
    for definition in of_compositing.into_iter().filter(|definition| definition != "PER_PIXEL") {
        if is_for_frames(&definition) {
            check_picture(FRAME, &["BACKGROUND", &definition]);
            check_picture(FRAME, &[&definition]);
        }
    }
    // The march of engines with all terms, in a box, in a shell and in a mesh, with one sun and with several.
    let terms = [
        "OCTAVES",
        "COMPRESSION",
        "SILVER",
        "POWDER",
        "AMBIENT_GRADIENT",
        "BODY",
        "COARSE_SHADOW",
        "TERMS",
        "SHADOW_TO_EXIT",
        "SHADOW_AT_MOST",
        "SHADOW_GROWTH",
        "SHADOW_BY_ANGLE",
        "SHADOW_MAP",
        "DRAINE",
        "OWN_PHASE",
        "RAY_POWDER",
        "BOOST",
        "BOOST_BY_ANGLE",
        "PHASE_TWICE",
        "LEFTOVER_RESCALED",
        "STEP_GROWTH",
    ];
    const AIR: [&str; 8] = [
        "AIR",
        "AIR_HAZE",
        "AIR_PERSPECTIVE",
        "AIR_SHAFTS",
        "AIR_RAYS",
        "AIR_ALPHA_TWICE",
        "GROUND",
        "SHADOW_CASCADES",
    ];
    for more in [
        &[][..],
        &["SHELL"],
        &["MESH"],
        &["SEVERAL_SUNS"],
        &["LEFTOVER_DROPPED"],
        &["NO_SUN", "SHELL", "EMPTY_CELLS"],
        &AIR,
    ] {
        let definitions = [&terms, more].concat();
        check(&programs[2], "engines/march.wgsl", &definitions);
        if definitions.iter().all(|definition| is_for_frames(definition)) {
            check_picture(FRAME, &definitions);
        }
        if definitions.iter().all(|definition| is_for_fragments(definition)) {
            check_picture(PICTURE, &definitions);
        }
    }
    used.extend([PICTURE.0, FRAME.0].map(str::to_owned));
    let conditions: Vec<(&str, usize)> =
        ["engines/march.wgsl", "integrators/march/march.wgsl", "engines/passes/compositing.wgsl"]
            .map(|path| (path, definitions(&all[path].text).len()))
            .to_vec();
    // Conditions that the search finds: were it blind, nothing would be tried.
    assert_eq!(conditions.iter().map(|(_, count)| *count).collect::<Vec<_>>(), [48, 7, 8], "{conditions:?}");
    // Constants in a buffer, which has no function of its own: the kernel has its binding, and programs that differ in a number have one text.
    let linked = |program: &Program| {
        let source = "#import cloudparity::graph\n@group(0) @binding(0) var<storage, read_write> found: f32;\n\
                      @compute @workgroup_size(1) fn main() { found = graph::evaluate(vec3f(found)); }";
        let linker = Linker::with_numbers(program).expect("it links");
        let numbers = linker.numbers().to_vec();
        let module = linker.link("numbers", source).expect("it links");
        validate("numbers", &module);
        (numbers, module)
    };
    // From 1, which is left out where it multiplies, the text does change.
    let scaled = |text: &str| {
        let mut scene = support::scene("procedural-clouds");
        scene.set(text).expect("it has one");
        Program::density(&scene).expect("the cloud compiles")
    };
    let (numbers, module) = linked(&scaled("Large Noise/Scale=1.5"));
    let (others, other) = linked(&scaled("Large Noise/Scale=1.7"));
    assert!(numbers.len() == others.len() && numbers != others);
    let text = |module: &naga::Module| wgsl::write(module, wgsl::Language::Wgsl).expect("WGSL");
    assert!(text(&module) == text(&other), "a number that changes is no change of the kernel");
    let mut places = module.global_variables.iter().filter_map(|(_, variable)| variable.binding);
    assert!(places.any(|place| (place.group, place.binding) == (1, 1)));
    used.insert("nodes/shared/numbers.wgsl".into());
    // Stands in for quotients and roots in kernels for hardware: tests/single_precision.rs runs it, src/gpu/exact.rs tests where it stands in.
    used.insert("gpu/exact.wgsl".into());
    for shader in all.values().filter(|shader| !shader.is_entry) {
        let stem = Path::new(&shader.path).file_stem().expect("a name").to_string_lossy().into_owned();
        let prefix = match &shader.import_path {
            // Shared modules keep their name; a node's module becomes one instance per mode.
            Some(path) => format!("{}_", path.rsplit("::").next().unwrap_or(path)),
            None => format!("{stem}_1i_"),
        };
        if names.iter().any(|name| name.starts_with(&prefix)) {
            used.insert(shader.path.clone());
        }
    }
    let unused: Vec<_> = all.keys().filter(|path| !used.contains(*path)).collect();
    assert!(unused.is_empty(), "linked into no generated module: {unused:?}\nnames: {names:?}");
}
