//! "Add a node" of ARCHITECTURE.md, followed step by step with a toy: what the section says is enough, and it says no
//! more.
//!
//! The toy folds values about 0 and limits them: min(|value|, limit), with the sign changed where it inverts. All of it
//! is exact, so every evaluator has to give the same values.

mod support;

use cloudparity::graph::evaluate::{Arithmetic, Points};
use cloudparity::graph::wgsl::Linker;
use cloudparity::graph::{Program, Target};
use cloudparity::measure::nodes::{limits, suite, table};
use cloudparity::nodes::{
    self, Column, Evaluate, InputSocket, Interval, Mode, NodeType, OutputSocket, Property, Real, Role, always,
    socket_limits, vector_at,
};
use cloudparity::scene::{Scene, SocketType};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::json;

// Step 1: the node.

static TOY: NodeType = NodeType {
    type_name: "ShaderNodeToyFold",
    label: "Toy Fold",
    module: "toy_fold",
    shader: SHADER,
    properties: &[Property::choice("data_type", &["FLOAT", "VECTOR"]), Property::flag("invert", false)],
    inputs: &[
        InputSocket::float("Value", "Value", &[0.5], is_float),
        InputSocket::vector("Vector", "Vector", &[0.0; 3], is_vector),
        InputSocket::float("Limit", "Limit", &[1.0], always),
    ],
    outputs: &[
        OutputSocket::new("Result", SocketType::Float, is_float),
        OutputSocket::new("Vector", SocketType::Vector, is_vector),
        OutputSocket::new("Largest", SocketType::Float, is_vector),
    ],
    role: Role::Evaluated(|mode| {
        Box::new(ToyFold {
            is_vector: is_vector(mode),
            inverts: mode.flag("invert"),
            wants_vector: mode.wants("Vector"),
            wants_largest: mode.wants("Largest"),
        })
    }),
};

fn is_float(mode: &Mode) -> bool {
    mode.choice("data_type") == "FLOAT"
}

fn is_vector(mode: &Mode) -> bool {
    !is_float(mode)
}

struct ToyFold {
    is_vector: bool,
    inverts: bool,
    wants_vector: bool,
    wants_largest: bool,
}

impl ToyFold {
    fn folded<R: Real>(&self, value: R, limit: R) -> R {
        let folded = value.abs().lesser(limit);
        if self.inverts { -folded } else { folded }
    }
}

impl Evaluate for ToyFold {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        for index in 0..inputs[0].values.len() {
            if !self.is_vector {
                outputs[0][index] = self.folded(inputs[0].values[index], inputs[1].values[index]);
                continue;
            }
            let limit = inputs[3].values[index];
            let folded = vector_at(inputs, 0, index).map(|value| self.folded(value, limit));
            let mut column = 0;
            if self.wants_vector {
                for value in folded {
                    outputs[column][index] = value;
                    column += 1;
                }
            }
            if self.wants_largest {
                outputs[column][index] = folded[0].greater(folded[1]).greater(folded[2]);
            }
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let folded = |value: Interval, limit: Interval| {
            let folded = value.abs().lesser(limit);
            if self.inverts { -folded } else { folded }
        };
        if !self.is_vector {
            outputs[0] = folded(inputs[0], inputs[1]);
            return;
        }
        let all = [0, 1, 2].map(|axis| folded(inputs[axis], inputs[3]));
        let mut rest = outputs;
        if self.wants_vector {
            let (vector, after) = rest.split_at_mut(3);
            vector.copy_from_slice(&all);
            rest = after;
        }
        if self.wants_largest {
            rest[0] = all[0].greater(all[1]).greater(all[2]);
        }
    }
}

// Step 2: its shader.

const SHADER: &str = "// Toy node: min(|value|, limit), with the sign changed where it inverts. DATA_TYPE_FLOAT or
// DATA_TYPE_VECTOR; INVERT. Exact.

fn folded(value: f32, limit: f32) -> f32 {
#ifdef INVERT
    return -min(abs(value), limit);
#else
    return min(abs(value), limit);
#endif
}

#ifdef DATA_TYPE_VECTOR
struct Outputs {
#ifdef OUTPUT_VECTOR
    vector: vec3f,
#endif
#ifdef OUTPUT_LARGEST
    largest: f32,
#endif
}

fn evaluate(vector: vec3f, limit: f32) -> Outputs {
    var result: Outputs;
    let all = vec3f(folded(vector.x, limit), folded(vector.y, limit), folded(vector.z, limit));
#ifdef OUTPUT_VECTOR
    result.vector = all;
#endif
#ifdef OUTPUT_LARGEST
    result.largest = max(max(all.x, all.y), all.z);
#endif
    return result;
}
#else
fn evaluate(value: f32, limit: f32) -> f32 {
    return folded(value, limit);
}
#endif
";

/// The toy's own formula in plain numbers: the vector and its largest component, or a number.
fn expected(position: [f32; 3], is_vector: bool, inverts: bool) -> Vec<f32> {
    let folded = |value: f32, limit: f32| {
        let smaller = if value.abs() < limit { value.abs() } else { limit };
        if inverts { -smaller } else { smaller }
    };
    if !is_vector {
        return vec![folded(position[0], 0.75)];
    }
    let all = position.map(|value| folded(value, position[1]));
    let largest = all.into_iter().fold(f32::NEG_INFINITY, f32::max);
    vec![all[0], all[1], all[2], largest]
}

/// A graph of the toy, its limit stored for floats and linked for vectors.
fn scene(is_vector: bool, inverts: bool) -> Scene {
    let inputs = if is_vector {
        json!({"Vector": {"node": "Coordinate", "socket": "Object"}, "Limit": {"node": "Separate", "socket": "Y"}})
    } else {
        json!({"Value": {"node": "Separate", "socket": "X"}, "Limit": 0.75})
    };
    let kind = if is_vector { "VECTOR" } else { "FLOAT" };
    let nodes = json!([
        {"name": "Coordinate", "type": "ShaderNodeTexCoord"},
        {"name": "Separate", "type": "ShaderNodeSeparateXYZ",
         "inputs": {"Vector": {"node": "Coordinate", "socket": "Object"}}},
        {"name": "Fold", "type": TOY.type_name, "properties": {"data_type": kind, "invert": inverts}, "inputs": inputs},
    ]);
    cloudparity::scene::bare_scene("toy", json!({"material": "Material", "nodes": nodes, "groups": []}))
        .expect("a scene")
}

fn program(is_vector: bool, inverts: bool, outputs: &[&str]) -> cloudparity::Result<Program> {
    let targets: Vec<Target> = outputs.iter().map(|output| Target::output("Fold", output)).collect();
    Program::compile(&scene(is_vector, inverts), &targets)
}

/// Every set of outputs that a graph may ask the toy for, with the components of [`expected`] that they are.
const WANTED: [(bool, &[&str], std::ops::Range<usize>); 4] = [
    (false, &["Result"], 0..1),
    (true, &["Vector", "Largest"], 0..4),
    (true, &["Vector"], 0..3),
    (true, &["Largest"], 3..4),
];

fn points() -> Vec<[f32; 3]> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut points: Vec<[f32; 3]> = (0..500).map(|_| std::array::from_fn(|_| random.random_range(-2.0..2.0))).collect();
    points.extend([[0.0; 3], [0.75, 0.75, -0.75], [-3.0, -1.0, 2.0]]);
    points
}

/// The CPU in f32 and f64 gives the toy's formula, and its bounds hold it.
fn check_on_the_cpu() {
    let points = points();
    let at = Points::new(&points);
    for (is_vector, outputs, components) in WANTED {
        for inverts in [false, true] {
            let program = program(is_vector, inverts, outputs).expect("the toy compiles");
            let wanted: Vec<f32> = points
                .iter()
                .flat_map(|&point| expected(point, is_vector, inverts)[components.clone()].to_vec())
                .collect();
            assert_eq!(program.evaluate_single(at).expect("values"), wanted, "{outputs:?} {inverts}");
            for arithmetic in [Arithmetic::Oracle, Arithmetic::Unrounded] {
                let found = program.evaluate(at, arithmetic).expect("values");
                assert!(found.iter().zip(&wanted).all(|(a, b)| *a == f64::from(*b)), "{arithmetic:?} {outputs:?}");
            }
            let rounding = program.rounding_bounds(at).expect("bounds");
            assert!(rounding.iter().all(|&bound| bound < 1e-6), "exact operations have no rounding");
            let width = wanted.len() / points.len();
            let mut narrow = 0;
            for (point, values) in points.iter().zip(wanted.chunks(width)) {
                let bounds = program.bounds(point.map(|x| x - 0.1), point.map(|x| x + 0.1)).expect("bounds");
                for (bounds, &value) in bounds.iter().zip(values) {
                    assert!(bounds.contains(f64::from(value)), "{point:?}: {bounds:?} does not hold {value}");
                    narrow += usize::from(bounds.high - bounds.low < 0.3);
                }
            }
            assert!(narrow > points.len() / 2, "bounds say something: {narrow}");
        }
    }
}

/// Evaluates a program once.
const ENTRY: &str = "#import cloudparity::graph
@group(0) @binding(0) var<storage, read> position: vec3f;
@compute @workgroup_size(1)
fn main() { let value = graph::evaluate(position); }
";

/// The shader links in every mode, and gives the same values on the adapter.
fn check_the_shader() {
    let gpu = support::require("vulkan").then(|| cloudparity::gpu::Gpu::open().expect("an adapter"));
    let points = points();
    for (is_vector, outputs, _) in WANTED {
        for inverts in [false, true] {
            let program = program(is_vector, inverts, outputs).expect("the toy compiles");
            let linked = Linker::new(&program).and_then(|linker| linker.link("test.wgsl", ENTRY));
            let module = linked.unwrap_or_else(|cause| panic!("{cause}"));
            let names: Vec<_> = module.functions.iter().filter_map(|(_, function)| function.name.as_deref()).collect();
            assert!(names.contains(&"toy_fold_1i_evaluate"), "{names:?}");
            if let Some(gpu) = &gpu {
                let kernel = gpu.field(&program).expect("a kernel");
                let found = kernel.evaluate(Points::new(&points)).expect("values");
                let wanted = program.evaluate_single(Points::new(&points)).expect("values");
                assert_eq!(found, wanted, "{outputs:?} {inverts}");
            }
        }
    }
}

/// What the steps of the section begin with: the first name in each that is written as code.
fn steps_of(section: &str) -> Vec<&str> {
    let is_step = |line: &&str| line.split_once(". ").is_some_and(|(number, _)| number.parse::<u32>().is_ok());
    section.lines().filter(is_step).filter_map(|line| line.split('`').nth(1)).collect()
}

#[test]
fn the_section_on_adding_a_node_names_the_steps_that_a_toy_needs() {
    let mut followed: Vec<&str> = Vec::new();

    followed.push("src/nodes/<module>.rs");
    let modes = suite::modes(&TOY);
    assert_eq!(modes.len(), 4);

    followed.push("shaders/nodes/<module>.wgsl");
    assert_eq!(TOY.shader, SHADER);

    // Another crate's twin of the lines in `registry()`.
    followed.push("src/nodes/mod.rs");
    let error = program(false, false, &["Result"]).err().expect("a type that is not registered");
    assert!(error.to_string().contains("the node type ShaderNodeToyFold"), "{error}");
    nodes::register(&TOY).expect("the toy is new");
    assert!(nodes::find(TOY.type_name).is_some_and(|found| std::ptr::eq(found, &TOY)));
    assert!(std::ptr::eq(*nodes::registry().last().expect("types"), &TOY));
    assert!(nodes::register(&TOY).is_err(), "it is registered once");
    check_on_the_cpu();
    check_the_shader();

    // Without an entry it is held to equality.
    followed.push("src/measure/nodes/limits.rs");
    for properties in &modes {
        let mode = Mode::read(&TOY, properties, "toy").expect("a mode");
        for output in TOY.outputs_of(&mode) {
            let wgsl = limits::wgsl(&TOY, &mode, output.identifier, false);
            let cpu = limits::cpu(&TOY, &mode, output.identifier);
            assert!(!wgsl.allows(1.0, 1.000_000_1) && !cpu.allows(1.0, 1.000_000_1));
        }
    }

    // All of its properties act in all modes, and normal values are ordinary for it.
    followed.push("src/measure/nodes/suite.rs");
    let cases = suite::cases(16, 1, Some(TOY.label), suite::Selection::Everything).expect("cases");
    assert_eq!(cases.iter().map(|case| case.targets.len()).sum::<usize>(), 2 + 2 * 2);
    for case in &cases {
        let (program, positions) = (case.program().expect("the case compiles"), case.positions());
        let points = Points { positions: &positions, attributes: &case.attributes };
        assert_eq!(
            program.evaluate_single(points).expect("values").len(),
            positions.len() * program.output_components()
        );
    }

    // It takes every value as it is.
    followed.push("src/nodes/socket_limits.rs");
    assert!(TOY.inputs.iter().all(|socket| socket_limits::used_of(TOY.type_name, socket.identifier).is_none()));

    // Blender does not have it, so nothing is measured; the table says so.
    followed.push("parity/node-errors.json");
    let table = table::table().expect("the table");
    let entry = table.nodes.iter().find(|node| node.label == TOY.label).expect("the toy is listed");
    assert_eq!(entry.modes.len(), 4);
    assert!(entry.modes.iter().all(|mode| mode.errors.is_none()));

    followed.push("docs/nodes.md");
    assert!(entry.about.starts_with("Toy node: min(|value|, limit)"), "{}", entry.about);
    assert!(entry.evaluators.contains(&"WGSL") && entry.evaluators.contains(&"bounds"));
    let text = table.markdown();
    for part in [
        "## Toy Fold",
        "| data_type | FLOAT, VECTOR | FLOAT |",
        "| Vector | Vector | vector | 0, 0, 0 |  | data_type: VECTOR |",
    ] {
        assert!(text.contains(part), "\"{part}\" is not in the document");
    }

    let architecture = std::fs::read_to_string(support::project("ARCHITECTURE.md")).expect("the document");
    let (_, section) = architecture.split_once("## Add a node\n").expect("the section");
    let section = section.split("\n## ").next().unwrap_or_default();
    assert_eq!(steps_of(section), followed);
    assert!(section.contains("`nodes::register`"), "the section says how a type of another crate is added");
}
