//! The registry is whole: every node, in every mode, with every socket, has each evaluator, a shader that links, a case
//! that is compared with Cycles, a limit, and its place in the documents; and it says of a node what Blender's
//! declarations say.

mod support;

use cloudparity::graph::evaluate::Evaluation;
use cloudparity::graph::wgsl::Linker;
use cloudparity::graph::{Program, Target};
use cloudparity::measure::nodes::suite;
use cloudparity::measure::nodes::suite::{Case, Selection};
use cloudparity::measure::nodes::{limits, measurements, table};
use cloudparity::media::phase::PhaseFunction;
use cloudparity::nodes::closure::ClosureRole;
use cloudparity::nodes::refused::{self, Part};
use cloudparity::nodes::{
    self, Column, Evaluate, InputSocket, Interval, Mode, NodeEvaluator, NodeType, Oracle, OutputSocket, PropertyValues,
    Real, Role, RunningError, Simplified, always, socket_limits,
};
use cloudparity::scene::bare_scene;
use cloudparity::scene::{Input, SocketType};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde_json::{Map, Value as Json, json};
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Set to renew docs/nodes.md.
const RENEW: &str = "CLOUDPARITY_RENEW_SNAPSHOTS";

/// What stands in result columns before a node runs: a column that keeps it was not written.
const FILLINGS: [f32; 2] = [1234.5, -77.25];

fn evaluated() -> Vec<&'static NodeType> {
    nodes::registry().iter().copied().filter(|node_type| matches!(node_type.role, Role::Evaluated(_))).collect()
}

/// Every mode of a node type with all of its outputs wanted.
fn modes(node_type: &'static NodeType) -> Vec<Mode> {
    let read = |properties: Map<String, Json>| {
        let mode = Mode::read(node_type, &properties, node_type.label).expect("a mode of the suite");
        let outputs = node_type.outputs_of(&mode).map(|output| output.identifier).collect();
        mode.with_wanted(outputs)
    };
    suite::modes(node_type).into_iter().map(read).collect()
}

fn node_evaluator(node_type: &NodeType, mode: &Mode) -> Box<dyn NodeEvaluator> {
    match node_type.role {
        Role::Evaluated(build) => build(mode),
        _ => panic!("{} does not evaluate", node_type.label),
    }
}

fn name(node_type: &NodeType, mode: &Mode) -> String {
    format!("{} [{}]", node_type.label, mode.words().join(" "))
}

/// Input components of a mode.
fn width_in(node_type: &'static NodeType, mode: &Mode) -> usize {
    node_type.inputs_of(mode).map(|socket| socket.kind.components()).sum()
}

/// Runs one evaluator on one point.
fn run<R: Evaluation>(node_evaluator: &dyn NodeEvaluator, inputs: &[f32], width: usize, filling: f32) -> Vec<R> {
    let values: Vec<R> = inputs.iter().map(|&value| R::of(value)).collect();
    let columns: Vec<Column<'_, R>> =
        values.iter().map(|value| Column { values: std::slice::from_ref(value), uniform: false }).collect();
    let mut results = vec![R::of(filling); width];
    let mut slices: Vec<&mut [R]> = results.iter_mut().map(std::slice::from_mut).collect();
    R::run(node_evaluator, &columns, &mut slices);
    results
}

fn same(a: f64, b: f64) -> bool {
    a == b || (a.is_nan() && b.is_nan())
}

/// Runs one evaluator with each filling; says which columns it did not write.
fn written<R: Evaluation>(
    evaluator: &str,
    node_evaluator: &dyn NodeEvaluator,
    inputs: &[f32],
    width: usize,
    wrong: &mut Vec<String>,
) -> Vec<f64> {
    let [first, second] = FILLINGS.map(|filling| {
        run::<R>(node_evaluator, inputs, width, filling).into_iter().map(Real::to_f64).collect::<Vec<f64>>()
    });
    for column in 0..width {
        if !same(first[column], second[column]) {
            wrong.push(format!("{evaluator}: output column {column} of {width} is not written"));
        }
    }
    first
}

/// What is wrong with the evaluators of one mode.
fn faults(node_type: &'static NodeType, mode: &Mode) -> Vec<String> {
    let found = catch_unwind(AssertUnwindSafe(|| {
        let mut wrong = Vec::new();
        let (all, node_evaluator) = (node_type.outputs_of(mode).collect::<Vec<_>>(), node_evaluator(node_type, mode));
        let width: usize = all.iter().map(|output| output.kind.components()).sum();
        if width == 0 {
            wrong.push("no output".to_owned());
        }
        let inputs: Vec<f32> = (0..width_in(node_type, mode)).map(|number| 0.35 + 0.21 * number as f32).collect();
        let single = written::<f32>("f32", node_evaluator.as_ref(), &inputs, width, &mut wrong);
        let oracle = written::<Oracle>("f64 oracle", node_evaluator.as_ref(), &inputs, width, &mut wrong);
        written::<f64>("f64", node_evaluator.as_ref(), &inputs, width, &mut wrong);
        let running = written::<RunningError>("rounding bound", node_evaluator.as_ref(), &inputs, width, &mut wrong);
        if !single.iter().zip(&running).all(|(a, b)| same(*a, *b)) {
            wrong.push(format!("rounding bound: its values {running:?} are not those of f32, {single:?}"));
        }
        let points: Vec<Interval> = inputs.iter().map(|&value| Interval::point(value)).collect();
        let [first, second] = FILLINGS.map(|filling| {
            let mut results = vec![Interval::point(filling); width];
            node_evaluator.bounds(&points, &mut results);
            results
        });
        for column in 0..width {
            if first[column] != second[column] {
                wrong.push(format!("bounds: output column {column} of {width} is not written"));
            }
            for (evaluator, values) in [("f32", &single), ("f64 oracle", &oracle)] {
                if !first[column].contains(values[column]) {
                    wrong.push(format!("bounds: {:?} does not hold {evaluator}'s {}", first[column], values[column]));
                }
            }
        }
        // One output alone: fewer columns, the same values.
        let mut start = 0;
        for output in all.iter().filter(|_| all.len() > 1) {
            let mode = mode.clone().with_wanted(vec![output.identifier]);
            let components = output.kind.components();
            let node_evaluator = self::node_evaluator(node_type, &mode);
            let evaluator = format!("f32 of {} alone", output.identifier);
            let alone = written::<f32>(&evaluator, node_evaluator.as_ref(), &inputs, components, &mut wrong);
            let together = &single[start..start + components];
            if !alone.iter().zip(together).all(|(a, b)| same(*a, *b)) {
                wrong.push(format!("{evaluator}: {alone:?}, together with the others {together:?}"));
            }
            start += components;
        }
        wrong
    }));
    let wrong = found.unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().cloned();
        let text = text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()));
        vec![format!("panics: {}", text.unwrap_or_default())]
    });
    wrong.into_iter().map(|fault| format!("{}: {fault}", name(node_type, mode))).collect()
}

#[track_caller]
fn none(wrong: Vec<String>) {
    let shown: Vec<&String> = wrong.iter().take(20).collect();
    assert!(wrong.is_empty(), "{} faults: {shown:#?}", wrong.len());
}

#[test]
fn every_mode_has_every_evaluator() {
    let all: Vec<(&'static NodeType, Mode)> = evaluated()
        .into_iter()
        .flat_map(|node_type| modes(node_type).into_iter().map(move |mode| (node_type, mode)))
        .collect();
    assert!(all.len() > 250, "{} modes", all.len());
    none(all.par_iter().flat_map(|(node_type, mode)| faults(node_type, mode)).collect());
}

/// Forgets its second output, and its bounds read an input that it does not have.
struct Forgetful;

impl Evaluate for Forgetful {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        outputs[0][0] = inputs[0].values[0];
    }
    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        if outputs.len() == 2 {
            outputs.copy_from_slice(&[inputs[0], inputs[1]]);
        }
    }
}

static VALUE: [InputSocket; 1] = [InputSocket::float("Value", "Value", &[0.0], always)];

const fn forgetful(outputs: &'static [OutputSocket]) -> NodeType {
    NodeType {
        type_name: "test.Forgetful",
        label: "Forgetful",
        module: "forgetful",
        shader: "",
        properties: &[],
        inputs: &VALUE,
        outputs,
        role: Role::Evaluated(|_| Box::new(Forgetful)),
    }
}

#[test]
fn planted_faults_are_found() {
    static VECTOR: [OutputSocket; 1] = [OutputSocket::new("Vector", SocketType::Vector, always)];
    static FLOATS: [OutputSocket; 2] =
        [OutputSocket::new("A", SocketType::Float, always), OutputSocket::new("B", SocketType::Float, always)];
    static ONE: NodeType = forgetful(&VECTOR);
    static TWO: NodeType = forgetful(&FLOATS);
    let found = |node_type: &'static NodeType| {
        let all: Vec<String> = modes(node_type).iter().flat_map(|mode| faults(node_type, mode)).collect();
        all.join("\n")
    };
    let missing = found(&ONE);
    assert!(missing.contains("f32: output column 1 of 3 is not written"), "{missing}");
    assert!(missing.contains("rounding bound: output column 2 of 3 is not written"), "{missing}");
    assert!(missing.contains("bounds: output column 0 of 3 is not written"), "{missing}");
    assert!(found(&TWO).contains("panics: index out of bounds"), "{}", found(&TWO));
    // A node without a limit of its own is told from one whose limit is equality.
    let mode = &modes(&ONE)[0];
    assert!(limits::wgsl(&ONE, mode, "Vector", false).source.starts_with(NO_LIMIT));
}

fn cases() -> Vec<Case> {
    suite::cases(2, 1, None, Selection::Everything).expect("the suite")
}

#[test]
fn every_mode_has_a_shader_that_links() {
    for node_type in evaluated() {
        // What only takes apart or puts together leaves nothing to evaluate.
        let Role::Evaluated(build) = node_type.role else { unreachable!("evaluated() gives no other") };
        let renames = |mode: Mode| {
            let nothing_known = vec![None; width_in(node_type, &mode)];
            matches!(build(&mode).simplify(&nothing_known), Some(Simplified::Renames(_)))
        };
        if node_type.shader.is_empty() && modes(node_type).into_iter().all(renames) {
            continue;
        }
        assert!(!node_type.shader.is_empty(), "{}: no shader", node_type.label);
        assert!(node_type.shader.starts_with("// "), "{}: its shader does not say what it computes", node_type.label);
    }
    let mut known = BTreeSet::new();
    // Variants of a mode differ in their points.
    let mut cases = cases();
    cases.retain(|case| known.insert((case.node, case.mode.trim_end_matches(" distorted").to_owned())));
    let wrong = cases.par_iter().filter_map(|case| {
        let what = |cause: String| Some(format!("{} [{}]: {cause}", case.node, case.mode));
        let program = match case.program() {
            Ok(program) => program,
            Err(cause) => return what(cause.to_string()),
        };
        // A float that feeds a vector needs no node, nor does a mode that passes its input on.
        let is_there = program.instructions.iter().any(|instruction| instruction.node_type.label == case.node);
        let is_passed = program.notes.iter().any(|note| note.node == "Node" && note.action == "simplified");
        let renames = evaluated().iter().any(|node_type| {
            let Role::Evaluated(build) = node_type.role else { return false };
            let mode = Mode::read(node_type, &serde_json::Map::new(), "test").expect("the default mode");
            let nothing_known = vec![None; width_in(node_type, &mode)];
            node_type.label == case.node
                && matches!(build(&mode).simplify(&nothing_known), Some(Simplified::Renames(_)))
        });
        if !is_there && !is_passed && !renames && case.mode != "FLOAT" {
            return what("the program does not hold the node".into());
        }
        let attributes = ", position".repeat(program.attributes.len());
        let entry = format!(
            "#import cloudparity::graph\n\
             @group(0) @binding(0) var<storage, read> position: vec3f;\n\
             @compute @workgroup_size(1)\n\
             fn main() {{ let value = graph::evaluate(position{attributes}); }}\n"
        );
        match Linker::new(&program).and_then(|linker| linker.link("test.wgsl", &entry)) {
            Err(cause) => what(cause.to_string()),
            Ok(module) => {
                let flags = naga::valid::ValidationFlags::all();
                let mut validator = naga::valid::Validator::new(flags, naga::valid::Capabilities::empty());
                validator.validate(&module).err().and_then(|cause| what(cause.into_inner().to_string()))
            }
        }
    });
    none(wrong.collect());
}

#[test]
fn every_socket_of_every_mode_is_compared_with_cycles() {
    let cases = cases();
    let mut wrong = Vec::new();
    for node_type in evaluated().into_iter().filter(|node_type| node_type.type_name.starts_with("ShaderNode")) {
        for mode in modes(node_type) {
            let words = mode.words().join(" ");
            let Some(case) = cases.iter().find(|case| case.node == node_type.label && case.mode == words) else {
                wrong.push(format!("{}: no case", name(node_type, &mode)));
                continue;
            };
            let outputs: Vec<&str> = node_type.outputs_of(&mode).map(|output| output.identifier).collect();
            let compared: Vec<&str> = case.targets.iter().filter_map(|target| target.output.as_deref()).collect();
            if outputs != compared || case.limits.len() != outputs.len() {
                wrong.push(format!("{}: outputs {outputs:?}, compared {compared:?}", name(node_type, &mode)));
            }
            let node = case.scene.graph().nodes.iter().find(|node| node.name == "Node").expect("the node of the case");
            for socket in node_type.inputs_of(&mode) {
                if !matches!(node.inputs.get(socket.identifier), Some(Input::Link { .. })) {
                    wrong.push(format!("{}: input {} does not vary", name(node_type, &mode), socket.identifier));
                }
            }
        }
    }
    none(wrong);
}

/// How the source of a limit begins that no entry gives.
const NO_LIMIT: &str = "no entry";

#[test]
fn every_node_has_a_limit() {
    let mut wrong = Vec::new();
    for node_type in evaluated() {
        for mode in modes(node_type) {
            for output in node_type.outputs_of(&mode) {
                for distorted in [false, true] {
                    let limit = limits::wgsl(node_type, &mode, output.identifier, distorted);
                    if limit.source.starts_with(NO_LIMIT) {
                        wrong.push(format!("{} {}", name(node_type, &mode), output.identifier));
                    }
                }
            }
        }
    }
    none(wrong);
}

#[test]
fn every_mode_was_measured_and_is_within_its_limit() {
    let measured = measurements::errors();
    let renew = "cloudparity modes --summary parity/node-errors.json";
    let known: BTreeSet<(&str, &str)> =
        measured.rows.iter().map(|row| (row.node.as_str(), row.mode.as_str())).collect();
    let cases = cases();
    let wanted: BTreeSet<(&str, &str)> = cases.iter().map(|case| (case.node, case.mode.as_str())).collect();
    let missing: Vec<_> = wanted.difference(&known).take(10).collect();
    let stale: Vec<_> = known.difference(&wanted).take(10).collect();
    assert!(missing.is_empty() && stale.is_empty(), "missing {missing:?}, stale {stale:?}: run {renew}");
    let failing: Vec<_> = measured.rows.iter().filter(|row| !row.pass || row.wgsl_points.is_none()).collect();
    assert!(failing.is_empty(), "beyond their limits, or without WGSL: {failing:?}");
    for row in &measurements::costs().rows {
        assert!(wanted.contains(&(row.node.as_str(), row.mode.as_str())), "a cost of what is not there: {row:?}");
    }
}

#[test]
fn the_document_of_nodes_is_made_from_the_registry() {
    let text = table::table().expect("the table").markdown();
    let path = support::project("docs/nodes.md");
    if std::env::var_os(RENEW).is_some() {
        cloudparity::base::files::write_atomically(&path, text.as_bytes()).expect("the document is written");
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    let different = text.lines().zip(committed.lines()).position(|(new, old)| new != old);
    assert!(
        text == committed,
        "{} differs from the generated text from line {} on. When the change is meant, run \
         {RENEW}=1 cargo test --release --test nodes and review the difference.",
        path.display(),
        different.unwrap_or_else(|| text.lines().count().min(committed.lines().count())) + 1
    );
    for node_type in nodes::registry() {
        assert!(text.contains(node_type.label), "{} is not listed", node_type.label);
    }
}

/// Values of the inputs of a mode, and where the components of a socket stand.
fn place_of(node_type: &'static NodeType, mode: &Mode, identifier: &str) -> Option<std::ops::Range<usize>> {
    let mut first = 0;
    for socket in node_type.inputs_of(mode) {
        let components = socket.kind.components();
        if socket.identifier == identifier {
            return Some(first..first + components);
        }
        first += components;
    }
    None
}

/// What a node or closure makes of inputs.
fn outcome(node_type: &'static NodeType, mode: &Mode, inputs: &[f32]) -> Vec<f64> {
    match node_type.role {
        Role::Evaluated(build) => {
            let width = node_type.outputs_of(mode).map(|output| output.kind.components()).sum();
            run::<f32>(build(mode).as_ref(), inputs, width, 0.0).into_iter().map(f64::from).collect()
        }
        Role::Closure(ClosureRole::Medium(build)) => {
            let (closure, inputs) = (build(mode), inputs.iter().copied().map(f64::from).collect::<Vec<f64>>());
            let found = closure.coefficients(&inputs);
            let mut all = [found.scattering, found.extinction, found.emission].concat();
            all.extend(closure.phase(&inputs).map(|phase| PhaseFunction::new(phase).evaluate(0.3)));
            all
        }
        _ => Vec::new(),
    }
}

#[test]
fn nodes_limit_their_inputs_as_the_table_says() {
    for used in socket_limits::USED {
        let what = format!("{} {}", used.type_name, used.identifier);
        let node_type = nodes::find(used.type_name).unwrap_or_else(|| panic!("{what}: no such node"));
        assert!(node_type.inputs.iter().any(|socket| socket.identifier == used.identifier), "{what}: no such input");
        if matches!(node_type.role, Role::Closure(ClosureRole::Mix)) {
            // The compiler makes factors of it: src/graph/closures.rs.
            continue;
        }
        // Limits of closures are f64, the ends here f32.
        let tolerance = if matches!(node_type.role, Role::Closure(_)) { 1e-3 } else { 0.0 };
        let [low, high] = used.range;
        let inner = match (low.is_finite(), high.is_finite()) {
            // Nothing glows at a few kelvin.
            _ if used.identifier == "Temperature" => 2700.0,
            (true, true) => 0.6 * low + 0.4 * high,
            (true, false) => low + 2.7,
            _ => 0.4 * high,
        };
        let mut has_effect = false;
        let mut random = ChaCha8Rng::seed_from_u64(1);
        for mode in modes(node_type).into_iter().filter(|mode| (used.holds)(mode)) {
            let Some(place) = place_of(node_type, &mode, used.identifier) else { continue };
            for _ in 0..20 {
                let mut inputs: Vec<f32> =
                    (0..width_in(node_type, &mode)).map(|_| random.random_range(0.3..1.7)).collect();
                let mut with = |value: f32| {
                    inputs[place.clone()].fill(value);
                    outcome(node_type, &mode, &inputs)
                };
                let between = with(inner);
                for (end, beyond) in [(low, low - 1.7 - low.abs()), (high, high + 1.7 + high.abs())] {
                    if !end.is_finite() {
                        continue;
                    }
                    let (at_end, beyond_end) = (with(end), with(beyond));
                    let close = |a: f64, b: f64| same(a, b) || (a - b).abs() <= tolerance * b.abs();
                    assert!(
                        at_end.iter().zip(&beyond_end).all(|(a, b)| close(*a, *b)),
                        "{} {}: at {end} {at_end:?}, at {beyond} {beyond_end:?}",
                        name(node_type, &mode),
                        used.identifier
                    );
                    has_effect |= at_end.iter().zip(&between).any(|(a, b)| !close(*a, *b));
                }
            }
        }
        assert!(has_effect, "{what}: a value within the range changes nothing");
    }
}

/// A scene whose only output is a group's: what `nodes` of the group give.
fn in_group(nodes: Vec<Json>, output: Json) -> (cloudparity::scene::Scene, Target) {
    let mut inner = nodes;
    inner.push(json!({"name": "Group Output", "type": "NodeGroupOutput", "properties": {"is_active_output": true},
                      "inputs": {"Socket_0": output}}));
    let graph = json!({
        "material": "Material",
        "nodes": [{"name": "Outer", "type": "ShaderNodeGroup", "group": "Inner"}],
        "groups": [{"name": "Inner", "inputs": [], "nodes": inner,
                    "outputs": [{"identifier": "Socket_0", "name": "Value", "type": "float", "default": 0.0}]}],
    });
    (bare_scene("refused", graph).expect("a scene"), Target::output("Outer", "Socket_0"))
}

#[test]
fn a_refused_node_is_named_with_its_place_the_reason_and_what_to_do() {
    for node in refused::NODES.iter().filter(|node| nodes::find(node.type_name).is_none()) {
        let bad = json!({"name": "Bad", "type": node.type_name, "inputs": {}});
        let (scene, target) = in_group(vec![bad], json!({"node": "Bad", "socket": "Fac"}));
        let error = Program::compile(&scene, &[target]).err().unwrap_or_else(|| panic!("{} compiles", node.label));
        assert_eq!(error.place, "material Material: node Outer/Bad");
        for part in [node.label, node.type_name, node.reason, node.instead] {
            assert!(error.to_string().contains(part), "\"{part}\" is not in: {error}");
        }
    }
}

#[test]
fn refused_nodes_that_reach_nothing_do_not_matter() {
    let all: Vec<Json> = refused::NODES
        .iter()
        .enumerate()
        .map(|(number, node)| json!({"name": format!("Bad {number}"), "type": node.type_name, "inputs": {}}))
        .collect();
    let (scene, target) = in_group(all, json!(0.25));
    let program = Program::compile(&scene, &[target]).unwrap_or_else(|cause| panic!("{cause}"));
    let values = program.evaluate_single(cloudparity::graph::evaluate::Points::new(&[[0.0; 3]])).expect("a value");
    assert_eq!(values, [0.25]);
}

#[test]
fn refused_parts_of_supported_nodes_are_errors_that_name_them() {
    for refused in refused::PARTS {
        let node_type = nodes::find(refused.type_name).expect("parts are those of supported nodes");
        let mut properties = json!({});
        if node_type.properties.iter().any(|property| property.identifier == "attribute_name") {
            properties["attribute_name"] = "density".into();
        }
        let (output, named) = match refused.part {
            Part::Output(identifier) => (identifier, identifier),
            Part::Setting(property, value) => {
                properties[property] = serde_json::from_str(value).unwrap_or_else(|_| value.into());
                let first = node_type.outputs.iter().find(|output| {
                    !refused::parts(refused.type_name).any(|other| other.part == Part::Output(output.identifier))
                });
                (first.expect("an output that is not refused").identifier, value)
            }
        };
        let node = json!({"name": "Node", "type": refused.type_name, "properties": properties, "inputs": {}});
        let (scene, target) = in_group(vec![node], json!({"node": "Node", "socket": output}));
        let what = format!("{} {:?}", refused.type_name, refused.part);
        let error = Program::compile(&scene, &[target]).err().unwrap_or_else(|| panic!("{what} compiles"));
        assert!(error.place.starts_with("material Material: node Outer/Node"), "{what}: {error}");
        assert!(error.to_string().contains(named), "{what}: {error}");
    }
}

/// Blender's declarations of its shader nodes, where the folder beside the project is there.
fn declarations() -> Option<Json> {
    let path = support::project("../shared/spec/nodes.json");
    let Ok(text) = std::fs::read_to_string(&path) else {
        eprintln!("skipped: {} is missing", path.display());
        return None;
    };
    Some(serde_json::from_str(&text).expect("the declarations are JSON"))
}

fn list<'a>(value: &'a Json, key: &str) -> &'a [Json] {
    value[key].as_array().map_or(&[], Vec::as_slice)
}

fn text<'a>(value: &'a Json, key: &str) -> &'a str {
    value[key].as_str().unwrap_or_else(|| panic!("{key} of {value} is no text"))
}

fn texts(value: &Json) -> Vec<&str> {
    value.as_array().into_iter().flatten().filter_map(Json::as_str).collect()
}

/// The end of the graph, which the compiler starts from.
const END: &str = "ShaderNodeOutputMaterial";

/// The node that Blender declares as refused, of which a part is supported here.
const PARTLY: &str = "ShaderNodeAttribute";

#[test]
fn every_node_that_blender_declares_is_supported_or_refused() {
    let Some(declared) = declarations() else { return };
    for node in list(&declared, "nodes").iter().filter(|node| text(node, "bl_idname") != END) {
        let found = nodes::find(text(node, "bl_idname")).unwrap_or_else(|| panic!("{} is missing", node["bl_idname"]));
        assert_eq!(found.label, text(node, "label"));
    }
    let refused: BTreeSet<&str> = list(&declared, "refused").iter().map(|node| text(node, "bl_idname")).collect();
    // The declarations are those of 5.0: a node that came later is in none of them.
    let later = ["ShaderNodeRaycast"];
    let known: BTreeSet<&str> =
        refused::NODES.iter().map(|node| node.type_name).filter(|name| !later.contains(name)).collect();
    assert_eq!(known, refused);
    for name in refused.iter().filter(|name| **name != PARTLY) {
        assert!(nodes::find(name).is_none(), "{name} is supported and refused");
    }
    let outputs: BTreeSet<(&str, &str)> = list(&declared, "nodes")
        .iter()
        .flat_map(|node| list(node, "outputs").iter().map(move |output| (node, output)))
        .filter(|(_, output)| output["status"] == "refuse")
        .map(|(node, output)| (text(node, "bl_idname"), text(output, "identifier")))
        .collect();
    let known: BTreeSet<(&str, &str)> = refused::PARTS
        .iter()
        .filter(|refused| refused.type_name != PARTLY)
        .filter_map(|refused| match refused.part {
            Part::Output(identifier) => Some((refused.type_name, identifier)),
            Part::Setting(..) => None,
        })
        .collect();
    assert_eq!(known, outputs);
}

fn kind_of(declared: &str) -> Option<SocketType> {
    Some(match declared {
        "VALUE" => SocketType::Float,
        "VECTOR" => SocketType::Vector,
        "RGBA" => SocketType::Color,
        // Texts have no value here, as closures have none.
        "SHADER" | "STRING" => SocketType::Shader,
        _ => return None,
    })
}

fn numbers(value: &Json) -> Vec<f32> {
    match value {
        Json::Array(values) => values.iter().filter_map(Json::as_f64).map(|number| number as f32).collect(),
        other => other.as_f64().map(|number| number as f32).into_iter().collect(),
    }
}

#[test]
fn sockets_are_those_that_blender_declares() {
    let Some(declared) = declarations() else { return };
    let mut wrong = Vec::new();
    for node in list(&declared, "nodes") {
        let Some(node_type) = nodes::find(text(node, "bl_idname")) else { continue };
        let mut fault = |what: String| wrong.push(format!("{}: {what}", node_type.label));
        // Sockets of kinds that exist in no mode of a material.
        let inputs: Vec<&Json> = list(node, "inputs").iter().filter(|socket| socket["type"] != "ROTATION").collect();
        let names: Vec<&str> = inputs.iter().map(|socket| text(socket, "identifier")).collect();
        let ours: Vec<&str> = node_type.inputs.iter().map(|socket| socket.identifier).collect();
        if names != ours {
            fault(format!("inputs {ours:?}, declared {names:?}"));
            continue;
        }
        for (socket, declared) in node_type.inputs.iter().zip(inputs) {
            if Some(socket.kind) != kind_of(text(declared, "type")) || socket.label != text(declared, "name") {
                fault(format!("input {} is {:?}, \"{}\": {declared}", socket.identifier, socket.kind, socket.label));
            }
            let default = numbers(&declared["default"]);
            let close = |(ours, theirs): (&f32, &f32)| (ours - theirs).abs() <= 1e-6 * theirs.abs().max(1.0);
            if default.len() < socket.default.len() || !socket.default.iter().zip(&default).all(close) {
                fault(format!("input {}: default {:?}, declared {default:?}", socket.identifier, socket.default));
            }
            let limits: Vec<f32> = numbers(&json!([declared["min"], declared["max"]]));
            let stored: Vec<f32> =
                socket_limits::stored(socket.kind).into_iter().filter(|end| end.is_finite()).collect();
            if limits != stored {
                fault(format!("input {}: limits {stored:?}, declared {limits:?}", socket.identifier));
            }
            if node_type.type_name.starts_with("ShaderNodeTex")
                && socket.generated_when_unlinked != (declared["when_unlinked"] == "generated")
            {
                fault(format!("input {}: reads Generated coordinates or not", socket.identifier));
            }
        }
        let outputs: Vec<(&str, Option<SocketType>)> = list(node, "outputs")
            .iter()
            .filter(|socket| socket["type"] != "ROTATION")
            .map(|socket| (text(socket, "identifier"), kind_of(text(socket, "type"))))
            .collect();
        let ours: Vec<_> = node_type.outputs.iter().map(|socket| (socket.identifier, Some(socket.kind))).collect();
        if outputs != ours {
            fault(format!("outputs {ours:?}, declared {outputs:?}"));
        }
        for entry in list(node, "availability") {
            let properties = entry["when"].as_object().expect("properties of a mode");
            let mode = match Mode::read(node_type, properties, node_type.label) {
                Ok(mode) => mode,
                Err(cause) => {
                    fault(cause.to_string());
                    continue;
                }
            };
            let inputs: Vec<&str> = node_type.inputs_of(&mode).map(|socket| socket.identifier).collect();
            let outputs: Vec<&str> = node_type.outputs_of(&mode).map(|socket| socket.identifier).collect();
            if inputs != texts(&entry["inputs"]) || outputs != texts(&entry["outputs"]) {
                fault(format!("{entry}: inputs {inputs:?}, outputs {outputs:?}"));
            }
        }
    }
    none(wrong);
}

/// Properties of Blender that Cycles ignores, or that the compiler reads for all textures.
const NOT_OF_THE_NODE: [&str; 3] = ["color_mapping", "texture_mapping", "use_alpha"];

#[test]
fn properties_are_those_that_blender_declares() {
    let Some(declared) = declarations() else { return };
    let mut wrong = Vec::new();
    for node in list(&declared, "nodes") {
        let Some(node_type) = nodes::find(text(node, "bl_idname")) else { continue };
        for declared in list(node, "properties") {
            let identifier = text(declared, "identifier");
            if NOT_OF_THE_NODE.contains(&identifier) {
                continue;
            }
            let mut fault = |what: String| wrong.push(format!("{} {identifier}: {what}", node_type.label));
            let Some(property) = node_type.properties.iter().find(|property| property.identifier == identifier) else {
                fault("missing".into());
                continue;
            };
            let default = &declared["default"];
            // Files may hold what the interface no longer takes.
            let in_range = |[low, high]: [f32; 2]| match numbers(&json!([declared["min"], declared["max"]]))[..] {
                [least, most] => low <= least && most <= high,
                _ => false,
            };
            match (&property.values, text(declared, "type")) {
                (PropertyValues::Choice(names), "ENUM") => {
                    let is_refused = |value: &str| {
                        refused::parts(node_type.type_name).any(|refused| match refused.part {
                            Part::Setting(property, refused) => property == identifier && refused == value,
                            Part::Output(_) => false,
                        })
                    };
                    let kept = |value: &&str| !is_refused(value);
                    let items: BTreeSet<&str> = texts(&declared["items"]).into_iter().filter(kept).collect();
                    let ours: BTreeSet<&str> = names.iter().copied().filter(kept).collect();
                    if ours != items || *default != json!(names[0]) {
                        fault(format!("{names:?}, declared {declared}"));
                    }
                }
                (PropertyValues::Flag(flag), "BOOLEAN") if *default == json!(flag) => {}
                (PropertyValues::Integer { default: ours, limits, .. }, "INT")
                    if *default == json!(ours) && in_range(limits.map(|end| end as f32)) => {}
                (PropertyValues::Number { default: ours, limits, .. }, "FLOAT")
                    if numbers(default) == [*ours] && in_range(*limits) => {}
                (PropertyValues::Data { .. } | PropertyValues::Other, "POINTER") => {}
                _ => fault(format!("is not as declared: {declared}")),
            }
        }
    }
    none(wrong);
}
