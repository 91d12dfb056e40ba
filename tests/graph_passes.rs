//! Graph passes: groups, reroutes, muted nodes and conversions in place; constants folded by Blender's
//! rules, neutral constants simplified, equal nodes merged, unread ones dropped. Each rule is checked on
//! the program that is left; the last tests ask live Cycles for the same graphs.

mod support;

use cloudparity::bridge::{CyclesKernel, probe};
use cloudparity::graph::evaluate::Points;
use cloudparity::graph::{Operand, Program, Target};
use cloudparity::measure::errors::values::equal;
use cloudparity::measure::nodes::suite::{attribute_name, attribute_nodes, modes};
use cloudparity::nodes::{self, Mode};
use cloudparity::scene::Scene;
use cloudparity::scene::bare_scene;
use serde_json::{Map, Value as Json, json};

/// Sockets that one probe job can read.
const TARGETS_PER_JOB: usize = 30;

/// Values of the attribute that varying inputs read: ordinary ones and such that x*0 is not 0.
const VARYING: [[f32; 3]; 8] = [
    [0.25, 0.5, 0.75],
    [-1.5, 2.25, 0.1],
    [0.0, 1.0, -1.0],
    [3.7, -0.3, 12.0],
    [f32::NAN, f32::INFINITY, f32::NEG_INFINITY],
    [f32::INFINITY, f32::NEG_INFINITY, f32::NAN],
    [1e30, -1e30, 1e-30],
    [f32::MAX, f32::MIN, 1e-40],
];

fn link(node: &str, socket: &str) -> Json {
    json!({"node": node, "socket": socket})
}

fn node(name: &str, kind: &str, properties: Json, inputs: Json) -> Json {
    json!({"name": name, "type": format!("ShaderNode{kind}"), "properties": properties, "inputs": inputs})
}

fn math(name: &str, operation: &str, inputs: Json) -> Json {
    node(name, "Math", json!({"operation": operation}), inputs)
}

fn vector_math(name: &str, operation: &str, inputs: Json) -> Json {
    node(name, "VectorMath", json!({"operation": operation}), inputs)
}

/// X, Y or Z of the varying attribute.
fn varying(axis: &str) -> Json {
    link("Separate 0", axis)
}

/// All of the varying attribute.
fn varying_vector() -> Json {
    link("Attribute 0", "Vector")
}

fn muted(mut node: Json, bypass: Json) -> Json {
    node["muted"] = true.into();
    node["bypass"] = bypass;
    node
}

fn reroute(name: &str, kind: &str, input: Json) -> Json {
    json!({"name": name, "type": "NodeReroute", "socket_type": kind, "inputs": {"Input": input}})
}

fn socket(identifier: &str, kind: &str, default: Json) -> Json {
    json!({"identifier": identifier, "name": identifier, "type": kind, "default": default})
}

/// A group with inputs (identifier, type, default), outputs (the same and what feeds it), nodes.
fn group(name: &str, inputs: &[(&str, &str, Json)], outputs: &[(&str, &str, Json)], nodes: Vec<Json>) -> Json {
    let inputs: Vec<Json> = inputs.iter().map(|(name, kind, default)| socket(name, kind, default.clone())).collect();
    let zero = |kind: &str| match kind {
        "vector" => json!([0.0, 0.0, 0.0]),
        "color" => json!([0.0, 0.0, 0.0, 1.0]),
        _ => json!(0.0),
    };
    let ends: Map<String, Json> = outputs.iter().map(|(name, _, input)| ((*name).to_owned(), input.clone())).collect();
    let outputs: Vec<Json> = outputs.iter().map(|(name, kind, _)| socket(name, kind, zero(kind))).collect();
    let mut nodes = nodes;
    nodes.push(json!({"name": "Group Output", "type": "NodeGroupOutput", "properties": {"is_active_output": true}, "inputs": ends}));
    json!({"name": name, "inputs": inputs, "outputs": outputs, "nodes": nodes})
}

fn use_of(name: &str, group: &str, inputs: Json) -> Json {
    json!({"name": name, "type": "ShaderNodeGroup", "group": group, "inputs": inputs})
}

fn inner(identifier: &str) -> Json {
    json!({"group_input": identifier})
}

/// A graph of these nodes beside the varying attribute.
/// Vector "V" of which only X varies, and its components "P".
fn mixed_vector() -> Json {
    node("V", "CombineXYZ", json!({}), json!({"X": varying("X"), "Y": 0.0, "Z": 1.0}))
}

fn mixed_parts() -> Json {
    node("P", "SeparateXYZ", json!({}), json!({"Vector": link("V", "Vector")}))
}

fn scene(nodes: &[Json], groups: &[Json]) -> Scene {
    let mut all: Vec<Json> = attribute_nodes(0).into();
    all.push(json!({"name": "Texture Coordinate", "type": "ShaderNodeTexCoord"}));
    all.extend_from_slice(nodes);
    bare_scene("passes", json!({"material": "Material", "nodes": all, "groups": groups})).expect("a legal graph")
}

fn compiled(nodes: &[Json], groups: &[Json], name: &str, socket: &str) -> Program {
    let program = Program::compile(&scene(nodes, groups), &[Target::output(name, socket)]);
    program.unwrap_or_else(|cause| panic!("{cause}"))
}

/// Values of the only output at the varying attribute, point by point.
fn values(program: &Program) -> Vec<f32> {
    let attributes = [(attribute_name(0), VARYING.to_vec())];
    let positions = [[0.1, 0.2, 0.3]; VARYING.len()];
    program.evaluate_single(Points { positions: &positions, attributes: &attributes }).expect("values")
}

/// The output as constants, if it is constant.
fn constants(program: &Program) -> Option<Vec<f32>> {
    let components = program.outputs[0].operands.iter().map(|operand| match operand {
        Operand::Constant(value) => Some(*value),
        _ => None,
    });
    components.collect()
}

#[track_caller]
fn assert_folds_to(nodes: &[Json], name: &str, socket: &str, expected: &[f32]) {
    let program = compiled(nodes, &[], name, socket);
    let found = constants(&program).unwrap_or_else(|| panic!("{name}.{socket} is not constant"));
    assert!(program.instructions.is_empty(), "nothing is left to evaluate");
    let same = found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| equal(*a, *b));
    assert!(same, "{found:?} instead of {expected:?}: {nodes:?}");
    assert!(program.notes.iter().any(|note| note.action == "folded"), "{:?}", program.notes);
}

#[test]
fn constants_fold_by_blenders_rules_and_varying_inputs_do_not() {
    let power = |base: Json| math("M", "POWER", json!({"Value": base, "Value_001": -1.0}));
    assert_folds_to(&[power(json!(0.0))], "M", "Value", &[f32::INFINITY]);
    assert_eq!(values(&compiled(&[power(varying("X"))], &[], "M", "Value"))[2], 0.0, "0^-1 on the varying path");

    let power = |base: Json| vector_math("M", "POWER", json!({"Vector": base, "Vector_001": [-1.0, 2.0, 0.5]}));
    assert_folds_to(&[power(json!([0.0, 3.0, 4.0]))], "M", "Vector", &[f32::INFINITY, 9.0, 2.0]);
    assert_eq!(values(&compiled(&[power(varying_vector())], &[], "M", "Vector"))[6], 0.0);

    let modulo = |a: Json| vector_math("M", "MODULO", json!({"Vector": a, "Vector_001": [0.0, 3.0, -2.5]}));
    // The exact remainder; the rounded quotient of the varying path would leave another one.
    assert_folds_to(&[modulo(json!([1.0, 1e8, 7.0]))], "M", "Vector", &[f32::NAN, 1.0, 2.0]);
    assert_eq!(values(&compiled(&[modulo(varying_vector())], &[], "M", "Vector"))[0], 0.0, "x mod 0");

    let range = |value: Json, clamp: bool| {
        let inputs = json!({"Value": value, "From Min": 2.0, "From Max": 2.0, "To Min": 5.0, "To Max": 7.0});
        node("M", "MapRange", json!({"clamp": clamp}), inputs)
    };
    assert_folds_to(&[range(json!(0.3), false)], "M", "Result", &[5.0]);
    assert_folds_to(&[range(json!(0.3), true)], "M", "Result", &[5.0]);
    assert_eq!(values(&compiled(&[range(varying("X"), false)], &[], "M", "Result"))[0], 0.0);
    assert_eq!(values(&compiled(&[range(varying("X"), true)], &[], "M", "Result"))[0], 5.0);

    let stepped = |value: Json| {
        let inputs =
            json!({"Value": value, "From Min": 0.0, "From Max": 1.0, "To Min": 0.0, "To Max": 1.0, "Steps": -3.0});
        node("M", "MapRange", json!({"interpolation_type": "STEPPED", "clamp": false}), inputs)
    };
    // floor(0.25 * (-3 + 1)) / -3.
    assert_folds_to(&[stepped(json!(0.25))], "M", "Result", &[-1.0 / -3.0]);
    assert_eq!(values(&compiled(&[stepped(varying("X"))], &[], "M", "Result"))[0], 0.0);
}

#[test]
fn constants_fold_through_a_whole_graph() {
    let nodes = [
        json!({"name": "V", "type": "ShaderNodeValue", "outputs": {"Value": 3.0}}),
        math("A", "MULTIPLY", json!({"Value": link("V", "Value"), "Value_001": 2.0})),
        node("C", "CombineXYZ", json!({}), json!({"X": link("A", "Value"), "Y": 1.0, "Z": -1.0})),
        vector_math("L", "DOT_PRODUCT", json!({"Vector": link("C", "Vector"), "Vector_001": [1.0, 2.0, 3.0]})),
        math("B", "ADD", json!({"Value": link("L", "Value"), "Value_001": varying("X")})),
    ];
    assert_folds_to(&nodes[..4], "L", "Value", &[5.0]);
    let program = compiled(&nodes, &[], "B", "Value");
    assert_eq!(program.instructions.len(), 1, "only the sum is left");
    assert_eq!(values(&program)[0], 5.25);
    let clamped =
        node("M", "Math", json!({"operation": "POWER", "use_clamp": true}), json!({"Value": 0.0, "Value_001": -1.0}));
    assert_folds_to(&[clamped], "M", "Value", &[1.0]);
}

/// What a simplified node is.
enum Left {
    Varying,
    Constant(f32),
    Evaluated,
}

#[test]
fn neutral_and_absorbing_constants_simplify() {
    use Left::{Constant, Evaluated, Varying};
    let cases: [(&str, Option<f32>, Option<f32>, Left); 20] = [
        ("ADD", None, Some(0.0), Varying),
        ("ADD", Some(0.0), None, Varying),
        ("ADD", None, Some(1.0), Evaluated),
        ("SUBTRACT", None, Some(0.0), Varying),
        ("SUBTRACT", Some(0.0), None, Evaluated),
        ("MULTIPLY", None, Some(1.0), Varying),
        ("MULTIPLY", Some(1.0), None, Varying),
        ("MULTIPLY", None, Some(0.0), Constant(0.0)),
        ("MULTIPLY", Some(0.0), None, Constant(0.0)),
        ("MULTIPLY", None, Some(2.0), Evaluated),
        ("DIVIDE", None, Some(1.0), Varying),
        ("DIVIDE", Some(0.0), None, Constant(0.0)),
        ("DIVIDE", None, Some(0.0), Evaluated),
        ("DIVIDE", Some(1.0), None, Evaluated),
        ("POWER", None, Some(0.0), Constant(1.0)),
        ("POWER", Some(1.0), None, Constant(1.0)),
        ("POWER", None, Some(1.0), Varying),
        ("POWER", Some(0.0), None, Evaluated),
        ("MODULO", None, Some(0.0), Evaluated),
        ("MINIMUM", Some(0.0), None, Evaluated),
    ];
    for (operation, a, b, left) in cases {
        let what = format!("{operation} {a:?} {b:?}");
        let operand = |value: Option<f32>| value.map_or_else(|| varying("X"), |value| json!(value));
        let program =
            compiled(&[math("M", operation, json!({"Value": operand(a), "Value_001": operand(b)}))], &[], "M", "Value");
        let clamped = node(
            "M",
            "Math",
            json!({"operation": operation, "use_clamp": true}),
            json!({"Value": operand(a), "Value_001": operand(b)}),
        );
        assert_eq!(
            compiled(&[clamped], &[], "M", "Value").instructions.len(),
            1,
            "{what}: a clamp has to be evaluated"
        );
        match left {
            Evaluated => assert_eq!(program.instructions.len(), 1, "{what}"),
            Varying => {
                assert!(program.instructions.is_empty(), "{what}");
                assert_eq!(program.outputs[0].operands, [Operand::Attribute(0, 0)], "{what}");
            }
            Constant(value) => assert_eq!(constants(&program), Some(vec![value]), "{what}"),
        }
        if !matches!(left, Evaluated) {
            assert!(program.notes.iter().any(|note| note.node == "M" && note.action == "simplified"), "{what}");
        }
    }
    for (operation, a, b, left) in [
        ("ADD", None, Some([0.0; 3]), 0),
        ("ADD", Some([0.0; 3]), None, 0),
        ("ADD", None, Some([0.0, 0.0, 1.0]), 1),
        ("SUBTRACT", None, Some([0.0; 3]), 0),
        ("MULTIPLY", None, Some([1.0; 3]), 0),
        ("MULTIPLY", None, Some([0.0; 3]), 0),
        ("MULTIPLY", None, Some([1.0, 1.0, 0.0]), 1),
        ("DIVIDE", None, Some([1.0; 3]), 0),
        ("DIVIDE", Some([0.0; 3]), None, 0),
        ("DIVIDE", None, Some([0.0; 3]), 0),
        ("CROSS_PRODUCT", None, Some([0.0; 3]), 0),
        ("DOT_PRODUCT", Some([0.0; 3]), None, 0),
        ("DISTANCE", None, Some([0.0; 3]), 1),
    ] {
        let operand = |value: Option<[f32; 3]>| value.map_or_else(varying_vector, |value| json!(value));
        let node = vector_math("M", operation, json!({"Vector": operand(a), "Vector_001": operand(b)}));
        let output = if matches!(operation, "DOT_PRODUCT" | "DISTANCE") { "Value" } else { "Vector" };
        let program = compiled(&[node], &[], "M", output);
        assert_eq!(program.instructions.len(), left, "{operation} {a:?} {b:?}");
    }
}

#[test]
fn equal_nodes_merge_and_different_ones_do_not() {
    let pair = |first: Json, second: Json| {
        let mut nodes = vec![first, second];
        nodes[0]["name"] = "A".into();
        nodes[1]["name"] = "B".into();
        nodes.push(math("Sum", "ADD", json!({"Value": link("A", "Value"), "Value_001": link("B", "Value")})));
        compiled(&nodes, &[], "Sum", "Value")
    };
    let sine = |input: Json| math("", "SINE", json!({"Value": input}));
    let merged = pair(sine(varying("X")), sine(varying("X")));
    assert_eq!(merged.instructions.len(), 2);
    assert!(merged.notes.iter().any(|note| note.node == "B" && note.action == "merged" && note.reason == "equal to A"));
    assert_eq!(values(&merged)[0], 2.0 * values(&compiled(&[sine(varying("X"))], &[], "", "Value"))[0]);
    for (what, first, second) in [
        ("another input", sine(varying("X")), sine(varying("Y"))),
        ("another operation", sine(varying("X")), math("", "COSINE", json!({"Value": varying("X")}))),
        (
            "another flag",
            sine(varying("X")),
            node("", "Math", json!({"operation": "SINE", "use_clamp": true}), json!({"Value": varying("X")})),
        ),
        (
            "a constant of the other sign of zero",
            math("", "ARCTAN2", json!({"Value": varying("X"), "Value_001": 0.0})),
            math("", "ARCTAN2", json!({"Value": varying("X"), "Value_001": -0.0})),
        ),
    ] {
        let program = pair(first, second);
        assert_eq!(program.instructions.len(), 3, "{what}");
        assert!(!program.notes.iter().any(|note| note.action == "merged"), "{what}");
    }
}

#[test]
fn a_constant_in_a_vector_that_varies_is_none_for_what_reads_it() {
    let read = |reader: Json, socket: &str| compiled(&[mixed_vector(), mixed_parts(), reader], &[], "M", socket);
    // 0 * x is 0 where the 0 is a constant, and NaN at an infinity where it is not.
    let product = read(math("M", "MULTIPLY", json!({"Value": link("P", "Y"), "Value_001": varying("Y")})), "Value");
    assert_eq!(product.instructions.len(), 1);
    assert!(values(&product)[4].is_nan());
    let texture = json!({"Vector": link("P", "Z"), "W": varying("X")});
    let texture = read(node("M", "TexNoise", json!({"noise_dimensions": "4D"}), texture), "Fac");
    assert!(!texture.notes.iter().any(|note| note.action == "replaced"), "{:?}", texture.notes);
}

#[test]
fn a_constant_coordinate_reads_generated() {
    let texture = |vector: Json| {
        let inputs = json!({"Vector": vector, "W": varying("X")});
        let texture = node("M", "TexNoise", json!({"noise_dimensions": "4D"}), inputs);
        let early = node("Early", "CombineXYZ", json!({}), json!({"X": 0.5, "Y": 0.25, "Z": 2.0}));
        let late = node("Late", "CombineColor", json!({}), json!({"Red": 0.5, "Green": 0.25, "Blue": 2.0}));
        compiled(&[early, late, texture], &[], "M", "Fac")
    };
    let unlinked = values(&texture(json!([0.5, 0.25, 2.0])));
    for linked in [link("Early", "Vector"), link("Late", "Color")] {
        let program = texture(linked);
        assert!(program.notes.iter().any(|note| note.node == "M" && note.action == "replaced"), "{:?}", program.notes);
        assert!(values(&program).iter().zip(&unlinked).all(|(ours, theirs)| equal(*ours, *theirs)));
    }
}

#[test]
fn what_the_output_does_not_reach_is_dropped() {
    let nodes = [
        math("Used", "SINE", json!({"Value": varying("X")})),
        math("Absorbed", "SINE", json!({"Value": varying("Y")})),
        math("Zero", "MULTIPLY", json!({"Value": link("Absorbed", "Value"), "Value_001": 0.0})),
        math("Sum", "ADD", json!({"Value": link("Used", "Value"), "Value_001": link("Zero", "Value")})),
        math("Aside", "SINE", json!({"Value": varying("Z")})),
    ];
    let program = compiled(&nodes, &[], "Sum", "Value");
    let labels: Vec<_> = program.instructions.iter().map(|instruction| instruction.label.as_str()).collect();
    assert_eq!(labels, ["Used"]);
    let action =
        |name: &str| program.notes.iter().filter(|note| note.node == name).map(|note| note.action).collect::<Vec<_>>();
    assert_eq!(action("Absorbed"), ["dropped"]);
    assert_eq!(action("Aside"), ["dropped"]);
    assert_eq!(action("Zero"), ["simplified"]);
    assert_eq!(action("Sum"), ["simplified"]);
    // Of a node with several outputs only the wanted ones stay.
    let voronoi = node("V", "TexVoronoi", json!({}), json!({"Vector": varying_vector()}));
    let program = compiled(&[voronoi], &[], "V", "Color");
    assert_eq!(program.instructions[0].outputs.iter().map(|(name, _)| *name).collect::<Vec<_>>(), ["Color"]);
    assert_eq!(program.registers, 3);
}

#[test]
fn an_unlinked_texture_reads_generated_coordinates() {
    let noise = |name: &str, inputs: Json| node(name, "TexNoise", json!({}), inputs);
    let nodes = [
        noise("A", json!({})),
        noise("B", json!({"Vector": link("Texture Coordinate", "Generated")})),
        // A stored value of the hidden socket has no effect.
        noise("C", json!({"Vector": [7.0, 8.0, 9.0]})),
        math("AB", "ADD", json!({"Value": link("A", "Fac"), "Value_001": link("B", "Fac")})),
        math("ABC", "ADD", json!({"Value": link("AB", "Value"), "Value_001": link("C", "Fac")})),
    ];
    let program = compiled(&nodes, &[], "ABC", "Value");
    let textures = program.instructions.iter().filter(|instruction| instruction.node_type.module == "noise_texture");
    assert_eq!(textures.count(), 1, "the three read the same coordinates");
    // The texture space decides what they are.
    let mut moved = scene(&nodes, &[]);
    moved.volume.texture_space.location = [1.0, 2.0, 3.0];
    let moved = Program::compile(&moved, &[Target::output("A", "Fac")]).expect("a program");
    assert_ne!(values(&moved), values(&compiled(&nodes, &[], "A", "Fac")));
}

#[test]
fn a_group_used_twice_is_put_in_place_twice() {
    let wave = group(
        "Wave",
        &[("x", "float", json!(0.5)), ("y", "float", json!(0.25))],
        &[("out", "float", link("Sum", "Value"))],
        vec![
            math("Sine", "SINE", json!({"Value": inner("x")})),
            math(
                "Sum",
                "MULTIPLY_ADD",
                json!({"Value": link("Sine", "Value"), "Value_001": inner("y"), "Value_002": 1.0}),
            ),
        ],
    );
    let sum = |first: Json, second: Json| {
        let nodes = [
            use_of("A", "Wave", first),
            use_of("B", "Wave", second),
            math("Sum", "ADD", json!({"Value": link("A", "out"), "Value_001": link("B", "out")})),
        ];
        compiled(&nodes, std::slice::from_ref(&wave), "Sum", "Value")
    };
    let different = sum(json!({"x": varying("X")}), json!({"x": varying("Y"), "y": 2.0}));
    let labels: Vec<_> = different.instructions.iter().map(|instruction| instruction.label.as_str()).collect();
    assert_eq!(labels, ["A/Sine", "A/Sum", "B/Sine", "B/Sum", "Sum"]);
    let [x, y] = [0.25_f32.sin(), 0.5_f32.sin()];
    assert!((values(&different)[0] - (x * 0.25 + 1.0 + y * 2.0 + 1.0)).abs() < 1e-6);
    let equal = sum(json!({"x": varying("X")}), json!({"x": varying("X")}));
    assert_eq!(equal.instructions.len(), 3, "equal uses merge");
    let folded = sum(json!({}), json!({"x": 0.5, "y": 0.25}));
    assert!(folded.instructions.is_empty(), "defaults of the interface are constants");
}

/// A graph to ask Cycles for.
struct Case {
    label: String,
    nodes: Vec<Json>,
    groups: Vec<Json>,
    node: String,
    socket: String,
    /// Largest |ours - Cycles| / max(1, |Cycles|); 0 asks for equal values.
    limit: f32,
}

#[derive(Default)]
struct Cases(Vec<Case>);

impl Cases {
    /// Adds a case; its nodes and groups get names of their own.
    fn add(
        &mut self,
        label: impl Into<String>,
        nodes: Vec<Json>,
        groups: Vec<Json>,
        node: &str,
        socket: &str,
        limit: f32,
    ) {
        let prefix = format!("{} ", self.0.len());
        let rename = |tree: &[Json]| tree.iter().map(|node| renamed(node, tree, &prefix)).collect::<Vec<_>>();
        let groups = groups.iter().map(|group| {
            let mut group = group.clone();
            group["name"] = format!("{prefix}{}", group["name"].as_str().expect("a name")).into();
            let tree = group["nodes"].as_array().expect("a list").clone();
            group["nodes"] = rename(&tree).into();
            group
        });
        let case = Case {
            label: label.into(),
            groups: groups.collect(),
            nodes: rename(&nodes),
            node: format!("{prefix}{node}"),
            socket: socket.into(),
            limit,
        };
        self.0.push(case);
    }

    /// Compares every case with Cycles; one line for each that differs.
    fn differences(&self) -> Vec<String> {
        let attributes = [(attribute_name(0), VARYING.to_vec())];
        let positions: Vec<[f32; 3]> =
            (0..VARYING.len()).map(|row| [0.3 * row as f32 - 1.0, 0.2, 0.05 * row as f32]).collect();
        let scenes: Vec<(&[Case], Scene)> = self
            .0
            .chunks(TARGETS_PER_JOB)
            .map(|cases| {
                let nodes: Vec<Json> = cases.iter().flat_map(|case| case.nodes.clone()).collect();
                let groups: Vec<Json> = cases.iter().flat_map(|case| case.groups.clone()).collect();
                (cases, scene(&nodes, &groups))
            })
            .collect();
        let targets =
            |cases: &[Case]| cases.iter().map(|case| Target::output(&case.node, &case.socket)).collect::<Vec<_>>();
        let jobs: Vec<probe::Job<'_>> = scenes
            .iter()
            .map(|(cases, scene)| probe::Job {
                scene,
                positions: &positions,
                attributes: &attributes,
                targets: targets(cases),
                repeat: 1,
                samples: 1,
            })
            .collect();
        let answers = probe::ask(&jobs, CyclesKernel::Sse42, |_| {}).expect("Cycles answers");
        let mut found = Vec::new();
        for ((cases, scene), answer) in scenes.iter().zip(&answers.jobs) {
            for ((case, target), theirs) in cases.iter().zip(targets(cases)).zip(&answer.values) {
                let program =
                    Program::compile(scene, &[target]).unwrap_or_else(|cause| panic!("{}: {cause}", case.label));
                let points = Points { positions: &positions, attributes: &attributes };
                let ours = program.evaluate_single(points).expect("values");
                assert_eq!(ours.len(), theirs.len(), "{}", case.label);
                let agrees = |ours: f32, theirs: f32| {
                    equal(ours, theirs) || (ours - theirs).abs() <= case.limit * theirs.abs().max(1.0)
                };
                if let Some(at) = ours.iter().zip(theirs).position(|(ours, theirs)| !agrees(*ours, *theirs)) {
                    found.push(format!("{}: value {at} is {:?}, Cycles has {:?}", case.label, ours[at], theirs[at]));
                }
            }
        }
        found
    }

    #[track_caller]
    fn agree(&self) {
        let differences = self.differences();
        assert!(differences.is_empty(), "{} of {}:\n{}", differences.len(), self.0.len(), differences.join("\n"));
    }
}

/// The node with its name, its group's name and its links to nodes of `tree` prefixed.
fn renamed(node: &Json, tree: &[Json], prefix: &str) -> Json {
    let mut node = node.clone();
    let own = |name: &str| tree.iter().any(|node| node["name"] == name);
    for input in node["inputs"].as_object_mut().into_iter().flat_map(Map::values_mut) {
        if let Some(name) = input.get("node").and_then(Json::as_str).filter(|name| own(name)) {
            input["node"] = format!("{prefix}{name}").into();
        }
    }
    for key in ["name", "group"] {
        if let Some(name) = node.get(key).and_then(Json::as_str) {
            node[key] = format!("{prefix}{name}").into();
        }
    }
    node
}

/// Constants in all inputs, three at a time by position: ordinary, zero, equal, negative, large.
const CONSTANTS: [[f32; 3]; 9] = [
    [0.5, 0.5, 0.5],
    [0.0, -1.0, 2.0],
    [2.0, 0.0, 1.0],
    [-2.5, 3.0, 0.5],
    [1.0, 1.0, 0.0],
    [7.3, -2.1, 0.0],
    [-7.3, 2.1, -3.0],
    [0.0, 0.0, 0.0],
    [1e8, 3.0, 0.1],
];

/// A node of this type and mode whose inputs are constants of [`CONSTANTS`], starting at `first`.
fn constant_node(node_type: &'static nodes::NodeType, properties: &Map<String, Json>, first: usize) -> Json {
    let mode = Mode::read(node_type, properties, node_type.label).expect("a mode of the registry");
    let inputs: Map<String, Json> = node_type
        .inputs_of(&mode)
        .enumerate()
        .map(|(index, socket)| {
            let row = CONSTANTS[first % CONSTANTS.len()];
            let value = if socket.kind.components() == 3 {
                json!([row[index % 3], row[(index + 1) % 3], row[(index + 2) % 3]])
            } else {
                json!(row[index % 3])
            };
            (socket.identifier.to_owned(), value)
        })
        .collect();
    json!({"name": "M", "type": node_type.type_name, "properties": properties, "inputs": inputs})
}

#[test]
fn cycles_folds_the_same_constants() {
    if !support::require("bpy") {
        return;
    }
    let mut cases = Cases::default();
    for (kind, sets) in
        [("ShaderNodeMath", 9), ("ShaderNodeVectorMath", 9), ("ShaderNodeMapRange", 9), ("ShaderNodeClamp", 5)]
    {
        let node_type = nodes::find(kind).expect("a registered node");
        for (number, properties) in modes(node_type).iter().enumerate() {
            let mode = Mode::read(node_type, properties, kind).expect("a mode of the registry");
            // Every mode with three of the sets; which ones goes around.
            for set in 0..3 {
                let node = constant_node(node_type, properties, (number + set * 4) % sets);
                let output = node_type.outputs_of(&mode).next().expect("an output").identifier;
                // Elementary functions of two libraries: both are within an ulp or two.
                let label = format!("{} {} of {}", node_type.label, mode.words().join(" "), node["inputs"]);
                cases.add(label, vec![node], vec![], "M", output, 5e-7);
            }
        }
    }
    cases.agree();
}

#[test]
fn cycles_folds_constant_textures() {
    if !support::require("bpy") {
        return;
    }
    let mut cases = Cases::default();
    for (kind, inputs) in [
        ("TexNoise", json!({"W": 0.7, "Vector": link("C", "Vector"), "Detail": 3.5, "Distortion": 0.4})),
        ("TexVoronoi", json!({"W": 0.7, "Vector": link("C", "Vector"), "Detail": 1.5})),
        ("TexVoronoi", json!({"W": 0.7, "Vector": link("C", "Vector"), "Detail": -1.5})),
    ] {
        let node_type = nodes::find(&format!("ShaderNode{kind}")).expect("a registered node");
        for properties in modes(node_type) {
            let mode = Mode::read(node_type, &properties, kind).expect("a mode of the registry");
            let own: Map<String, Json> = inputs
                .as_object()
                .expect("an object")
                .iter()
                .filter(|(name, _)| node_type.inputs_of(&mode).any(|socket| socket.identifier == *name))
                .map(|(name, value)| (name.clone(), value.clone()))
                .collect();
            let nodes = vec![
                node("C", "CombineXYZ", json!({}), json!({"X": 0.3, "Y": -1.2, "Z": 2.7})),
                node("M", kind, properties.into(), own.into()),
            ];
            let output = node_type.outputs_of(&mode).next().expect("an output").identifier;
            let label = format!("{kind} {} {}", mode.words().join(" "), inputs["Detail"]);
            cases.add(label, nodes, vec![], "M", output, 5e-7);
        }
    }
    cases.agree();
}

#[test]
fn cycles_simplifies_the_same_constants() {
    if !support::require("bpy") {
        return;
    }
    let mut cases = Cases::default();
    for operation in ["ADD", "SUBTRACT", "MULTIPLY", "DIVIDE", "POWER", "MODULO", "MINIMUM", "MULTIPLY_ADD", "COMPARE"]
    {
        for constant in [0.0, 1.0, -1.0, 2.0] {
            for (a, b) in [(varying("X"), json!(constant)), (json!(constant), varying("X"))] {
                let mut inputs = json!({"Value": a, "Value_001": b});
                if matches!(operation, "MULTIPLY_ADD" | "COMPARE") {
                    inputs["Value_002"] = 0.0.into();
                }
                let nodes = vec![math("M", operation, inputs)];
                cases.add(format!("{operation} {a} {b}"), nodes, vec![], "M", "Value", 0.0);
            }
        }
    }
    for operation in ["ADD", "SUBTRACT", "MULTIPLY", "DIVIDE", "CROSS_PRODUCT", "DOT_PRODUCT", "POWER", "MULTIPLY_ADD"]
    {
        for constant in [[0.0; 3], [1.0; 3], [0.0, 1.0, 0.0], [2.0, 2.0, 2.0]] {
            for (a, b) in [(varying_vector(), json!(constant)), (json!(constant), varying_vector())] {
                let mut inputs = json!({"Vector": a, "Vector_001": b});
                if operation == "MULTIPLY_ADD" {
                    inputs["Vector_002"] = json!([0.0, 0.0, 0.0]);
                }
                let nodes = vec![vector_math("M", operation, inputs)];
                let output = if operation == "DOT_PRODUCT" { "Value" } else { "Vector" };
                cases.add(format!("vector {operation} {a} {b}"), nodes, vec![], "M", output, 0.0);
            }
        }
    }
    for (vector, scale) in [
        (varying_vector(), json!(0.0)),
        (varying_vector(), json!(1.0)),
        (json!([0.0, 0.0, 0.0]), varying("X")),
        (json!([1.0, 1.0, 1.0]), varying("X")),
        (json!([0.0, 1.0, 0.0]), varying("X")),
    ] {
        let nodes = vec![vector_math("M", "SCALE", json!({"Vector": vector, "Scale": scale}))];
        cases.add(format!("SCALE {vector} {scale}"), nodes, vec![], "M", "Vector", 0.0);
    }
    // What is left shows in what comes after: the product of a constant 0 is 0, and a blend of one link with itself is that link.
    let product = |of: Json| vector_math("M", "MULTIPLY", json!({"Vector": of, "Vector_001": varying_vector()}));
    let nothing = vector_math("N", "DIVIDE", json!({"Vector": varying_vector(), "Vector_001": [0.0, 0.0, 0.0]}));
    cases.add("DIVIDE by 0", vec![nothing, product(link("N", "Vector"))], vec![], "M", "Vector", 0.0);
    let white = node("N", "Gamma", json!({}), json!({"Color": [1.0, 1.0, 1.0, 1.0], "Gamma": varying("X")}));
    let black = vector_math("D", "SUBTRACT", json!({"Vector": link("N", "Color"), "Vector_001": [1.0, 1.0, 1.0]}));
    cases.add("Gamma of white", vec![white, black, product(link("D", "Vector"))], vec![], "M", "Vector", 0.0);
    let blend = |of: Json, with: Json, kind: &str| {
        let [a, b] = ["A", "B"].map(|side| format!("{side}_{kind}"));
        let inputs = json!({"Factor_Float": varying("Y"), a: of, b: with});
        let properties = json!({"data_type": kind.to_uppercase(), "clamp_factor": false});
        (node("M", "Mix", properties, inputs), format!("Result_{kind}"))
    };
    let same = math("N", "POWER", json!({"Value": varying("X"), "Value_001": 1.0}));
    let (mixed, output) = blend(link("N", "Value"), varying("X"), "Float");
    cases.add("POWER 1", vec![same, mixed], vec![], "M", &output, 0.0);
    let same = vector_math("N", "SCALE", json!({"Vector": varying_vector(), "Scale": 1.0}));
    let (mixed, output) = blend(link("N", "Vector"), varying_vector(), "Vector");
    cases.add("SCALE 1", vec![same, mixed], vec![], "M", &output, 0.0);
    for (kind, factor, input, value, output) in [
        ("FloatCurve", "Factor", "Value", varying("X"), "Value"),
        ("VectorCurve", "Fac", "Vector", varying_vector(), "Vector"),
        ("RGBCurve", "Fac", "Color", varying_vector(), "Color"),
    ] {
        let nodes = vec![node("M", kind, json!({}), json!({factor: 0.0, input: value}))];
        cases.add(format!("{kind} without effect"), nodes, vec![], "M", output, 0.0);
    }
    for operation in ["ADD", "MULTIPLY", "DIVIDE", "POWER"] {
        for (a, b) in [(link("P", "Y"), varying("X")), (varying("X"), link("P", "Z"))] {
            let nodes = vec![mixed_vector(), mixed_parts(), math("M", operation, json!({"Value": a, "Value_001": b}))];
            cases.add(format!("{operation} and a component"), nodes, vec![], "M", "Value", 0.0);
        }
    }
    for operation in ["ADD", "MULTIPLY"] {
        for constant in [0.0, 1.0] {
            let inputs = json!({"Value": varying("X"), "Value_001": constant});
            let nodes = vec![node("M", "Math", json!({"operation": operation, "use_clamp": true}), inputs)];
            cases.add(format!("clamped {operation} {constant}"), nodes, vec![], "M", "Value", 0.0);
        }
    }
    cases.agree();
}

/// A zero's sign shows in what White Noise makes of its bits. (No input is NaN here: a NaN has many bit patterns.)
#[test]
fn cycles_loses_the_same_signs_of_zeros() {
    if !support::require("bpy") {
        return;
    }
    let mut cases = Cases::default();
    let point = || link("O", "Vector");
    let white =
        |dimensions: &str, inputs: Json| node("M", "TexWhiteNoise", json!({"noise_dimensions": dimensions}), inputs);
    // Others for each case: Cycles takes nodes for equal that differ in the sign of a zero alone, and keeps one of them.
    let coordinates = |number: usize| {
        let offset = json!({"Vector": link("Texture Coordinate", "Object"), "Vector_001": [number, 0.0, 0.0]});
        [vector_math("O", "ADD", offset), node("T", "SeparateXYZ", json!({}), json!({"Vector": point()}))]
    };
    let x = || link("T", "X");
    let white_vector = |vector: Json| white("4D", json!({"Vector": vector, "W": x()}));
    let white_w = |w: Json| white("4D", json!({"Vector": point(), "W": w}));
    // Zeros: one that Blender hands over, and two that Cycles folds.
    let zero = || json!({"name": "Z", "type": "ShaderNodeValue", "inputs": {}, "outputs": {"Value": -0.0}});
    let late = || {
        let color = node("C", "CombineColor", json!({}), json!({"Red": 1.0}));
        let parts = node("S", "SeparateColor", json!({}), json!({"Color": link("C", "Color")}));
        let product = |name: &str, of: Json, by: f32| math(name, "MULTIPLY", json!({"Value": of, "Value_001": by}));
        vec![color, parts, product("Y", link("S", "Red"), -1e-30), product("Z", link("Y", "Value"), 1e-30)]
    };
    let late_vector = || {
        let color = node("C", "CombineColor", json!({}), json!({"Red": 1.0, "Blue": 1.0}));
        let product =
            |name: &str, of: Json, by: [f32; 3]| vector_math(name, "MULTIPLY", json!({"Vector": of, "Vector_001": by}));
        let small = product("Y", link("C", "Color"), [-1e-30, 1.0, 1.0]);
        vec![color, small, product("Z", link("Y", "Vector"), [1e-30, 1.0, 1.0])]
    };
    let mut add = |label: String, mut nodes: Vec<Json>, output: &str| {
        nodes.extend(coordinates(cases.0.len() + 2));
        cases.add(label, nodes, vec![], "M", output, 0.0);
    };

    for vector in [[-0.0, 0.0, 0.0], [-0.0; 3], [-0.0, 0.0, 1.0], [0.0, -0.0, 2.0]] {
        let [x, y, z] = vector;
        let combined = || node("Z", "CombineXYZ", json!({}), json!({"X": x, "Y": y, "Z": z}));
        let color = || node("Z", "CombineColor", json!({}), json!({"Red": x, "Green": y, "Blue": z}));
        add(format!("stored {vector:?}"), vec![white_vector(json!(vector))], "Value");
        add(format!("folded {vector:?}"), vec![white("3D", json!({"Vector": vector}))], "Value");
        add(format!("linked {vector:?}"), vec![combined(), white_vector(link("Z", "Vector"))], "Value");
        add(
            format!("linked and folded {vector:?}"),
            vec![combined(), white("3D", json!({"Vector": link("Z", "Vector")}))],
            "Value",
        );
        add(format!("combined by Cycles {vector:?}"), vec![color(), white_vector(link("Z", "Color"))], "Value");
        for (what, given, source) in [
            ("stored", json!(vector), None),
            ("linked", link("Z", "Vector"), Some(combined())),
            ("combined by Cycles", link("Z", "Color"), Some(color())),
        ] {
            let product = vector_math("N", "MULTIPLY", json!({"Vector": given, "Vector_001": point()}));
            let reader = white("3D", json!({"Vector": link("N", "Vector")}));
            let nodes = source.into_iter().chain([product, reader]).collect();
            add(format!("{what} factor {vector:?}"), nodes, "Value");
        }
    }
    add("folded vector".into(), [late_vector(), vec![white_vector(link("Z", "Vector"))]].concat(), "Value");
    add("stored W".into(), vec![white_w(json!(-0.0))], "Value");
    add("folded W".into(), vec![white("1D", json!({"W": -0.0}))], "Value");
    for (what, source) in [("Blender's", vec![zero()]), ("Cycles'", late())] {
        let with = |nodes: Vec<Json>| [source.clone(), nodes].concat();
        let given = || link("Z", "Value");
        let angle = math("N", "ARCTAN2", json!({"Value": given(), "Value_001": x()}));
        // Zeros of the sign that the third value brings in, if it has one.
        let negative = math("A", "ARCTAN2", json!({"Value": -0.0, "Value_001": x()}));
        let sum = json!({"Value": link("A", "Value"), "Value_001": 0.5, "Value_002": given()});
        let sum = math("N", "MULTIPLY_ADD", sum);
        let combined = node("N", "CombineXYZ", json!({}), json!({"X": given(), "Y": x(), "Z": given()}));
        let read = |output: &str| white("1D", json!({"W": link("N", output)}));
        add(format!("{what} zero as W"), with(vec![white_w(given())]), "Value");
        add(format!("{what} zero alone"), with(vec![white("1D", json!({"W": given()}))]), "Value");
        add(format!("{what} zero as a vector"), with(vec![white_vector(given())]), "Color");
        add(format!("{what} zero as a first value"), with(vec![angle, read("Value")]), "Value");
        add(format!("{what} zero as a third value"), with(vec![negative, sum, read("Value")]), "Value");
        let reader = white("3D", json!({"Vector": link("N", "Vector")}));
        add(format!("{what} zero as components"), with(vec![combined, reader]), "Value");
    }
    for (what, value) in [("first", "Value"), ("third", "Value_002")] {
        let negative = math("A", "ARCTAN2", json!({"Value": -0.0, "Value_001": x()}));
        let mut inputs = json!({"Value": link("A", "Value"), "Value_001": 0.5, "Value_002": link("A", "Value")});
        inputs[value] = (-0.0).into();
        let nodes = vec![negative, math("N", "MULTIPLY_ADD", inputs), white("1D", json!({"W": link("N", "Value")}))];
        add(format!("stored {what} value"), nodes, "Value");
    }
    let blend = json!({"Factor_Float": x(), "A_Float": -0.0, "B_Float": -0.0});
    let reader = white("1D", json!({"W": link("N", "Result_Float")}));
    add("blended".into(), vec![node("N", "Mix", json!({"data_type": "FLOAT"}), blend), reader], "Value");
    cases.agree();
}

#[test]
fn cycles_resolves_links_the_same_way() {
    if !support::require("bpy") {
        return;
    }
    let mut cases = Cases::default();
    let read = |input: Json| math("M", "MULTIPLY", json!({"Value": input, "Value_001": 2.0}));
    let read_vector =
        |input: Json| vector_math("M", "MULTIPLY", json!({"Vector": input, "Vector_001": [2.0, 3.0, 4.0]}));

    // Conversions (a colour comes out of a texture).
    let voronoi = |name: &str| node(name, "TexVoronoi", json!({}), json!({"Vector": varying_vector(), "Scale": 3.0}));
    cases.add("vector to float", vec![read(varying_vector())], vec![], "M", "Value", 0.0);
    cases.add("float to vector", vec![read_vector(varying("Y"))], vec![], "M", "Vector", 0.0);
    cases.add("colour to float", vec![voronoi("V"), read(link("V", "Color"))], vec![], "M", "Value", 0.0);
    cases.add("colour to vector", vec![voronoi("V"), read_vector(link("V", "Color"))], vec![], "M", "Vector", 0.0);
    let constant = || node("C", "CombineXYZ", json!({}), json!({"X": 0.3, "Y": -1.2, "Z": 2.7}));
    cases.add("constant vector to float", vec![constant(), read(link("C", "Vector"))], vec![], "M", "Value", 5e-7);

    // Reroutes. Blender gives a reroute the type of what feeds it.
    for (kind, input, source) in [
        ("float", varying("X"), None),
        ("vector", varying_vector(), None),
        ("color", link("V", "Color"), Some(voronoi("V"))),
        // Blender makes the reroute a direction.
        ("vector", link("V", "Normal"), Some(node("V", "Normal", json!({}), json!({"Normal": varying_vector()})))),
    ] {
        let nodes = |reader: Json| {
            let reroutes = [reroute("R", kind, input.clone()), reroute("Q", kind, link("R", "Output"))];
            source.iter().cloned().chain(reroutes).chain([reader]).collect::<Vec<_>>()
        };
        let label = format!("{kind} through two reroutes");
        cases.add(format!("{label} to float"), nodes(read(link("Q", "Output"))), vec![], "M", "Value", 0.0);
        cases.add(format!("{label} to vector"), nodes(read_vector(link("Q", "Output"))), vec![], "M", "Vector", 0.0);
    }

    // Links that lead to nothing: the reading socket has its own value, which is another one in each.
    let dead = || muted(node("D", "TexCoord", json!({}), json!({})), json!({}));
    let unfed = || json!({"name": "D", "type": "NodeReroute", "socket_type": "float", "inputs": {}});
    let stored = || muted(math("D", "ADD", json!({"Value": 3.0, "Value_001": 4.0})), json!({"Value": "Value"}));
    let clamp = |input: Json| node("M", "Clamp", json!({}), json!({"Value": input, "Min": -9.0, "Max": 9.0}));
    let range = |input: Json| node("M", "MapRange", json!({}), json!({"Value": varying("X"), "To Max": input}));
    for (what, source, output) in
        [("muted node", dead(), "Object"), ("reroute", unfed(), "Output"), ("muted constant", stored(), "Value")]
    {
        let readers = [
            ("Math", read(link("D", output)), "Value"),
            ("Clamp", clamp(link("D", output)), "Result"),
            ("Map Range", range(link("D", output)), "Result"),
            ("Vector Math", read_vector(link("D", output)), "Vector"),
        ];
        for (reader, node, socket) in readers {
            cases.add(format!("{what} to {reader}"), vec![source.clone(), node], vec![], "M", socket, 0.0);
        }
        let pass =
            group("G", &[("Socket_1", "float", json!(0.75))], &[("Socket_2", "float", inner("Socket_1"))], vec![]);
        let user = use_of("U", "G", json!({"Socket_1": link("D", output)}));
        let nodes = vec![source, user, clamp(link("U", "Socket_2"))];
        cases.add(format!("{what} to a group"), nodes, vec![pass], "M", "Result", 0.0);
    }

    // Muted nodes.
    let x = || json!({"Value": varying("X"), "Value_001": varying("Y")});
    let both = || json!({"Vector": varying_vector(), "Vector_001": [1.0, 2.0, 3.0]});
    let whole = || json!({"Vector": varying_vector()});
    let mute: Vec<(&str, Json, &str)> = vec![
        ("Math", muted(math("N", "ADD", x()), json!({"Value": "Value"})), "Value"),
        (
            "Math of constants",
            muted(math("N", "ADD", json!({"Value": 3.0, "Value_001": 4.0})), json!({"Value": "Value"})),
            "Value",
        ),
        (
            "Math of a vector",
            muted(math("N", "ADD", json!({"Value": varying_vector()})), json!({"Value": "Value"})),
            "Value",
        ),
        ("Vector Math", muted(vector_math("N", "ADD", both()), json!({"Vector": "Vector"})), "Vector"),
        ("Vector Math Length", muted(vector_math("N", "LENGTH", whole()), json!({"Value": "Vector"})), "Value"),
        (
            "Separate XYZ",
            muted(node("N", "SeparateXYZ", json!({}), whole()), json!({"X": "Vector", "Y": "Vector", "Z": "Vector"})),
            "Y",
        ),
        (
            "Combine XYZ",
            muted(node("N", "CombineXYZ", json!({}), json!({"X": varying("X"), "Y": 2.0})), json!({"Vector": "X"})),
            "Vector",
        ),
        (
            "Map Range",
            muted(
                node("N", "MapRange", json!({}), json!({"Value": varying("X"), "To Max": 3.0})),
                json!({"Result": "Value"}),
            ),
            "Result",
        ),
        (
            "Clamp",
            muted(node("N", "Clamp", json!({}), json!({"Value": varying("X")})), json!({"Result": "Value"})),
            "Result",
        ),
        ("Texture Coordinate", muted(node("N", "TexCoord", json!({}), json!({})), json!({})), "Object"),
    ];
    for (label, node, output) in mute {
        cases.add(
            format!("muted {label}, read as float"),
            vec![node.clone(), read(link("N", output))],
            vec![],
            "M",
            "Value",
            0.0,
        );
        cases.add(
            format!("muted {label}, read as vector"),
            vec![node, read_vector(link("N", output))],
            vec![],
            "M",
            "Vector",
            0.0,
        );
    }

    // Groups.
    for (outer, within) in
        [("float", "float"), ("vector", "float"), ("float", "vector"), ("color", "float"), ("vector", "color")]
    {
        let zero = |kind: &str| match kind {
            "vector" => json!([0.5, 0.25, 0.125]),
            "color" => json!([0.5, 0.25, 0.125, 1.0]),
            _ => json!(0.75),
        };
        let through =
            group("G", &[("Socket_1", outer, zero(outer))], &[("Socket_2", within, inner("Socket_1"))], vec![]);
        let nodes = |input: Json| vec![use_of("U", "G", input), read_vector(link("U", "Socket_2"))];
        for (what, input) in [("vector", varying_vector()), ("float", varying("X"))] {
            let label = format!("{what} through a group from {outer} to {within}");
            cases.add(label, nodes(json!({"Socket_1": input})), vec![through.clone()], "M", "Vector", 0.0);
        }
        let label = format!("default through a group from {outer} to {within}");
        cases.add(label, nodes(json!({"Socket_1": zero(outer)})), vec![through.clone()], "M", "Vector", 5e-7);
        let mut nodes = nodes(json!({"Socket_1": link("C", "Vector")}));
        nodes.push(constant());
        let label = format!("constant vector through a group from {outer} to {within}");
        cases.add(label, nodes, vec![through], "M", "Vector", 5e-7);
    }
    let mute_constant = vec![
        constant(),
        muted(math("N", "ADD", json!({"Value": link("C", "Vector")})), json!({"Value": "Value"})),
        read_vector(link("N", "Value")),
    ];
    cases.add("constant vector through a muted Math", mute_constant, vec![], "M", "Vector", 5e-7);
    let double = || {
        group(
            "Double",
            &[("Socket_1", "float", json!(0.5))],
            &[("Socket_2", "float", link("D", "Value"))],
            vec![math("D", "ADD", json!({"Value": inner("Socket_1"), "Value_001": inner("Socket_1")}))],
        )
    };
    let outer = || {
        group(
            "Outer",
            &[("Socket_1", "float", json!(0.5))],
            &[("Socket_2", "float", link("E", "Value"))],
            vec![
                use_of("First", "Double", json!({"Socket_1": inner("Socket_1")})),
                use_of("Second", "Double", json!({"Socket_1": link("First", "Socket_2")})),
                math("E", "SUBTRACT", json!({"Value": link("Second", "Socket_2"), "Value_001": inner("Socket_1")})),
            ],
        )
    };
    let uses = |inputs: Json| vec![use_of("U", "Outer", inputs), read(link("U", "Socket_2"))];
    cases.add("nested groups", uses(json!({"Socket_1": varying("X")})), vec![double(), outer()], "M", "Value", 0.0);
    cases.add("nested groups of constants", uses(json!({"Socket_1": 0.3})), vec![double(), outer()], "M", "Value", 0.0);
    let mute_group = vec![
        muted(use_of("U", "Outer", json!({"Socket_1": varying("X")})), json!({"Socket_2": "Socket_1"})),
        read(link("U", "Socket_2")),
    ];
    cases.add("muted group", mute_group, vec![double(), outer()], "M", "Value", 0.0);
    let closed = || group("Closed", &[], &[("Socket_2", "float", json!(0.7))], vec![]);
    let closed_use = || vec![use_of("U", "Closed", json!({})), read(link("U", "Socket_2"))];
    cases.add("a constant group output", closed_use(), vec![closed()], "M", "Value", 0.0);
    let mut mute_closed = closed_use();
    mute_closed[0] = muted(mute_closed[0].clone(), json!({}));
    cases.add("muted group without inputs", mute_closed, vec![closed()], "M", "Value", 0.0);

    // Unlinked coordinates.
    let noise = node("M", "TexNoise", json!({}), json!({"Scale": 3.0}));
    cases.add("unlinked Noise Texture", vec![noise], vec![], "M", "Fac", 0.0);
    let voronoi = node("M", "TexVoronoi", json!({}), json!({"Scale": 3.0}));
    cases.add("unlinked Voronoi Texture", vec![voronoi], vec![], "M", "Distance", 0.0);
    cases.agree();
}
