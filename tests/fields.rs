//! Fields against live Cycles: the cloud, every mode of every node, random graphs, and a planted
//! difference that must be found.

mod support;

use cloudparity::base::error::Result;
use cloudparity::bridge::Message;
use cloudparity::gpu::Gpu;
use cloudparity::graph::evaluate::Points;
use cloudparity::graph::{Program, Target, target};
use cloudparity::measure::domain;
use cloudparity::measure::errors::values::equal;
use cloudparity::measure::fields;
use cloudparity::measure::fields::{Domain, Evaluator, Figures};
use cloudparity::measure::nodes::random_graphs::{Cycles, Judge, Kind, Reference, Trial, Values};
use cloudparity::measure::nodes::suite;
use cloudparity::measure::nodes::suite::Selection;
use cloudparity::measure::nodes::{random_graphs, settings};
use cloudparity::nodes::{Column, Evaluate, Interval, Nudge, Real};
use cloudparity::scene::{Input, Scene};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde_json::json;

/// Points per comparison of the cloud: a second of Cycles.
const POINTS: usize = 16384;

/// Points per mode: all special values meet in every socket, and the suite takes half a minute.
const MODE_POINTS: usize = 576;

fn compare(requests: &[fields::Request<'_>]) -> Vec<Figures> {
    let (found, _) = fields::compare(requests, |_| {}).expect("Cycles answers");
    found.into_iter().flat_map(|comparisons| fields::figures(comparisons).into_values()).collect()
}

fn points(scene: &Scene, domain: Domain, seed: u64) -> Vec<[f32; 3]> {
    let program = Program::density(scene).expect("the scene compiles");
    domain::points(domain, scene, &program, POINTS, seed).expect("points")
}

fn density(scene: &Scene) -> Target {
    target::density(scene).expect("a closing node")
}

#[test]
fn the_cloud_equals_cycles_bit_for_bit() {
    if !support::require("bpy") {
        return;
    }
    let scene = support::scene("procedural-clouds");
    let drawn: Vec<Scene> = (0..3)
        .map(|seed| {
            let mut changed = scene.clone();
            settings::draw(&mut changed, &mut ChaCha8Rng::seed_from_u64(seed)).expect("inputs to draw");
            changed
        })
        .collect();
    let mut cases: Vec<(&Scene, Target, Vec<[f32; 3]>)> = [Domain::Box, Domain::Wide, Domain::Adversarial]
        .map(|domain| (&scene, density(&scene), points(&scene, domain, 1)))
        .into();
    cases.extend(drawn.iter().map(|scene| (scene, density(scene), points(scene, Domain::Box, 2))));
    for inner in ["Noise Texture.Fac", "Voronoi Texture.003.Distance", "Voronoi Texture.004.Distance", "Math.004.Value"]
    {
        let target = Target::parse(inner, scene.graph()).expect("a node of the cloud");
        cases.push((&scene, target, points(&scene, Domain::Box, 3)));
    }
    let requests: Vec<fields::Request<'_>> = cases
        .iter()
        .map(|(scene, target, positions)| fields::Request {
            scene,
            target: target.clone(),
            positions,
            evaluators: &[Evaluator::Cpu],
            rounding_bound: false,
        })
        .collect();
    for ((_, target, _), found) in cases.iter().zip(compare(&requests)) {
        assert_eq!(found.points, POINTS);
        assert_eq!((found.differing, found.one_sided_nonfinite), (0, 0), "{}: {:?}", target.name(), found.worst);
    }
}

#[test]
fn the_cloud_on_the_adapter_has_the_bits_of_the_cpu() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("an adapter");
    assert!(gpu.has_exact_kernels() || gpu.adapter().backend != "Vulkan", "Vulkan takes SPIR-V");
    let scene = support::scene("procedural-clouds");
    let program = Program::density(&scene).expect("the scene compiles");
    let kernel = gpu.field(&program).expect("it compiles");
    let mut domains = vec![Domain::Box, Domain::Wide];
    // Of 16,384 of these points an H100 has other values at 411: denormal numbers and infinities are a driver's own affair.
    domains.extend(gpu.adapter().is_software().then_some(Domain::Adversarial));
    for domain in domains {
        let positions = points(&scene, domain, 11);
        let [ours, theirs] = [
            program.evaluate_single(Points::new(&positions)).expect("values"),
            kernel.evaluate(Points::new(&positions)).expect("values"),
        ];
        let differing = ours.iter().zip(&theirs).filter(|(a, b)| !equal(**a, **b)).count();
        assert_eq!(differing, 0, "{domain:?} on {}", gpu.adapter().name);
        assert!(ours.iter().any(|&value| value != 0.0), "{domain:?}: there is a cloud");
    }
}

#[test]
fn a_planted_difference_is_found() {
    if !support::require("bpy") {
        return;
    }
    let scene = support::scene("procedural-clouds");
    let positions = points(&scene, Domain::Box, 1);
    let mut planted = scene.clone();
    let texture = planted.graph_mut().groups[0].nodes.iter_mut().find(|node| node.name == "Voronoi Texture.003");
    let scale = texture.expect("a node of the cloud").inputs.get_mut("Scale").expect("a stored scale");
    assert_eq!(*scale, Input::Number(2.0));
    // 1e-6 relative: some eight units in the last place of one constant.
    *scale = Input::Number(2.000_002);
    let request = fields::Request {
        scene: &planted,
        target: density(&planted),
        positions: &positions,
        evaluators: &[Evaluator::Cpu],
        rounding_bound: false,
    };
    // Both sides get the planted scene and agree; then ours gets the other one and must not.
    let (agreeing, _) = fields::compare(std::slice::from_ref(&request), |_| {}).expect("Cycles answers");
    assert_eq!(agreeing[0][0].1.differing(), 0);
    let job = cloudparity::bridge::probe::Job {
        scene: &planted,
        positions: &positions,
        attributes: &[],
        targets: vec![density(&planted)],
        repeat: 1,
        samples: 1,
    };
    let answers = cloudparity::bridge::probe::ask(&[job], cloudparity::bridge::CyclesKernel::Sse42, |_| {});
    let theirs = answers.expect("Cycles answers").jobs.remove(0).values.remove(0);
    let program = Program::density(&scene).expect("the scene compiles");
    let (ours, _) = fields::evaluate(&program, Points::new(&positions), Evaluator::Cpu, None).expect("evaluates");
    let found = fields::Comparison::new(&positions, &ours, &theirs).expect("equal lengths").figures(Some(0.0));
    assert_eq!(found.agrees(), Some(false));
    assert!(found.differing > 0 && found.max_error > 0.0 && found.max_error < 1e-3, "{found:?}");
}

#[test]
fn wgsl_is_within_its_rounding_bound_and_a_planted_difference_is_not() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = cloudparity::gpu::Gpu::open().expect("an adapter");
    let scene = support::scene("procedural-clouds");
    let program = Program::density(&scene).expect("the scene compiles");
    for domain in [Domain::Box, Domain::Wide, Domain::Adversarial] {
        let positions = points(&scene, domain, 3);
        let at = cloudparity::graph::evaluate::Points::new(&positions);
        let evaluated = |program: &Program, evaluator, gpu| {
            fields::evaluate(program, at, evaluator, gpu).expect("the program evaluates").0
        };
        let cpu = evaluated(&program, Evaluator::Cpu, None);
        let bounds = program.rounding_bounds(at).expect("bounds");
        let judged = |ours: &[f32]| {
            let mut found = fields::Comparison::new(&positions, ours, &cpu).expect("equal lengths");
            found.bound(&bounds);
            found.figures(Evaluator::Gpu.limit()).rounding_bound.expect("asked for")
        };
        let found = judged(&evaluated(&program, Evaluator::Gpu, Some(&gpu)));
        assert_eq!(found.beyond, 0, "{domain:?}: {found:?}");
        let mut planted = scene.clone();
        planted.set("Medium Noise/Scale=1.001").expect("an input of the group");
        let changed = Program::density(&planted).expect("the scene compiles");
        let found = judged(&evaluated(&changed, Evaluator::Cpu, None));
        assert!(found.beyond > 0, "{domain:?}: the bound explains a changed constant: {found:?}");
    }
}

#[test]
fn every_mode_of_every_node_is_within_its_limit() {
    if !support::require("bpy") {
        return;
    }
    let cases = suite::cases(MODE_POINTS, 1, None, Selection::Everything).expect("the suite");
    let outcome = suite::run(&cases, None, false, |_| {}).expect("Cycles answers");
    let wrong: Vec<String> = outcome.rows.iter().filter(|row| !row.pass).map(|row| format!("{row:?}")).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(outcome.rows.len() > 400, "every output has a row: {}", outcome.rows.len());
}

#[test]
fn wgsl_is_within_its_limit_on_arithmetic() {
    if !support::require("bpy") || !support::require("vulkan") {
        return;
    }
    let gpu = cloudparity::gpu::Gpu::open().expect("an adapter");
    for label in ["Math", "Vector Math", "Map Range", "Clamp"] {
        let cases = suite::cases(MODE_POINTS, 1, Some(label), Selection::Everything).expect("the suite");
        let outcome = suite::run(&cases, Some(&gpu), false, |_| {}).expect("Cycles answers");
        let wrong: Vec<String> = outcome.rows.iter().filter(|row| !row.pass).map(|row| format!("{row:?}")).collect();
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    }
}

#[test]
fn random_graphs_equal_cycles() {
    if !support::require("bpy") {
        return;
    }
    let mut graphs: Vec<_> = (0..48).map(|seed| random_graphs::generate(seed, 64).expect("a graph")).collect();
    random_graphs::with_folded_textures(&mut graphs, |_: Message| ()).expect("Blender folds textures");
    let judge = Judge { gpu: None, compile: &random_graphs::compile };
    let outcomes = random_graphs::run(&graphs, &judge, &mut Cycles(|_: Message| ()));
    let wrong: Vec<String> = outcomes
        .iter()
        .filter(|outcome| !outcome.failures.is_empty())
        .map(|outcome| format!("seed {}: {:?}", outcome.seed, outcome.failures))
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    let figures = || outcomes.iter().filter_map(|outcome| outcome.cpu.as_ref());
    let outputs: usize = figures().map(|found| found.outputs).sum();
    let of_library: usize = figures().map(|found| found.outputs_of_library).sum();
    assert!(of_library > 0 && of_library + 100 < outputs, "{of_library} of {outputs} outputs call the C library");
    let (values, equal) = figures().fold((0, 0), |(a, b), found| (a + found.values, b + found.equal));
    assert!(100 * equal > 90 * values, "{equal} of {values} values are equal");
}

#[test]
fn random_graphs_agree_with_their_shaders() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = cloudparity::gpu::Gpu::open().expect("an adapter");
    let graphs: Vec<_> = (200..203).map(|seed| random_graphs::generate(seed, 64).expect("a graph")).collect();
    let judge = Judge { gpu: Some(&gpu), compile: &random_graphs::compile };
    let outcomes = random_graphs::run(&graphs, &judge, &mut Ours);
    let wrong: Vec<String> = outcomes
        .iter()
        .filter(|outcome| !outcome.failures.is_empty())
        .map(|outcome| format!("seed {}: {:?}", outcome.seed, outcome.failures))
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    let compared: usize = outcomes.iter().filter_map(|outcome| Some(outcome.wgsl.as_ref()?.values)).sum();
    assert!(compared > 300, "{compared} ordinary values");
}

/// Up to Blender 4.5 cells were hashed as floats. Coordinates are far from 0 and beyond 2^24, too, where corners have no neighbours.
#[test]
fn cells_of_blender_4_5_are_the_same_in_shaders() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = cloudparity::gpu::Gpu::open().expect("an adapter");
    let graphs: Vec<_> = [("2D", "F1"), ("3D", "F2"), ("4D", "F1"), ("3D", "SMOOTH_F1"), ("4D", "DISTANCE_TO_EDGE")]
        .into_iter()
        .zip(0..)
        .map(|((dimensions, feature), seed)| {
            let graph = json!({"material": "Material", "groups": [], "blender": "4.5", "nodes": [
                {"name": "Position", "type": "ShaderNodeTexCoord"},
                {"name": "Voronoi", "type": "ShaderNodeTexVoronoi",
                 "inputs": {"Vector": {"node": "Position", "socket": "Object"}, "Scale": 1.0, "Randomness": 0.9},
                 "properties": {"feature": feature, "voronoi_dimensions": dimensions}},
            ]});
            let outputs: &[&str] = if feature == "DISTANCE_TO_EDGE" { &["Distance"] } else { &["Distance", "Color"] };
            let trial = Trial {
                scene: cloudparity::scene::bare_scene("cells of 4.5", graph).expect("a scene"),
                targets: outputs.iter().map(|output| Target::output("Voronoi", output)).collect(),
                positions: (0..128)
                    .map(|index: i32| {
                        let far = [1.0, 1.0, 1000.0, 3.0e7][index as usize % 4];
                        [0.37 * index as f32 - 20.0, far * (0.3 * (index % 3) as f32 - 0.2), -0.21 * index as f32]
                    })
                    .collect(),
                attributes: Vec::new(),
            };
            random_graphs::RandomGraph { seed, trial }
        })
        .collect();
    let judge = Judge { gpu: Some(&gpu), compile: &random_graphs::compile };
    for outcome in random_graphs::run(&graphs, &judge, &mut Ours) {
        assert!(outcome.failures.is_empty(), "seed {}: {:?}", outcome.seed, outcome.failures);
        // Places beyond 2^24, a quarter of them, may have values that shaders are not judged by.
        assert!(outcome.wgsl.as_ref().is_some_and(|found| found.values >= 96), "seed {}", outcome.seed);
    }
}

/// With an exponent of 0 every root is infinite, and the search finds nothing. With a negative one a site is infinitely near
/// wherever a point has one of its coordinates.
#[test]
fn with_unusual_inputs_shaders_find_what_voronoi_finds() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = cloudparity::gpu::Gpu::open().expect("an adapter");
    let plain = |exponent: f64| json!({"Exponent": exponent, "Randomness": 0.0, "Scale": 1.0});
    // Later octaves without Lacunarity are infinitely large, and a scale of 0 makes all positions 0.
    let without_scale = json!({"Scale": {"node": "Nothing", "socket": "Value"}, "Detail": 2.0, "Lacunarity": 0.0});
    let graphs: Vec<_> =
        [("F1", plain(0.0)), ("F2", plain(0.0)), ("F1", plain(-0.43)), ("F2", plain(-0.43)), ("F1", without_scale)]
            .into_iter()
            .zip(0..)
            .map(|((feature, inputs), seed)| {
                let graph = json!({"material": "Material", "groups": [], "nodes": [
                    {"name": "Position", "type": "ShaderNodeTexCoord"},
                    // 0 at every point, which nothing folds.
                    {"name": "Nothing", "type": "ShaderNodeMath", "properties": {"operation": "LESS_THAN"},
                     "inputs": {"Value": {"node": "Position", "socket": "Object"}, "Value_001": -1000.0}},
                    {"name": "Voronoi", "type": "ShaderNodeTexVoronoi", "inputs": inputs,
                     "properties": {"feature": feature, "distance": "MINKOWSKI"}},
                ]});
                let trial = Trial {
                    scene: cloudparity::scene::bare_scene("unusual inputs", graph).expect("a scene"),
                    targets: ["Distance", "Color", "Position"].map(|output| Target::output("Voronoi", output)).to_vec(),
                    positions: (0..64)
                        .map(|index| [0.125 * index as f32, 0.3 * (index % 3) as f32, -0.25 * index as f32])
                        .collect(),
                    attributes: Vec::new(),
                };
                random_graphs::RandomGraph { seed, trial }
            })
            .collect();
    let judge = Judge { gpu: Some(&gpu), compile: &random_graphs::compile };
    for outcome in random_graphs::run(&graphs, &judge, &mut Ours) {
        assert!(outcome.failures.is_empty(), "seed {}: {:?}", outcome.seed, outcome.failures);
        // Without a scale the sums of the octaves are not ordinary numbers, positions are.
        let components = if outcome.seed == 4 { 3 } else { 6 };
        let values = outcome.wgsl.map_or(0, |figures| figures.values);
        assert!(values >= 64 * components, "seed {}: {values} ordinary values", outcome.seed);
    }
}

#[test]
fn a_nudge_moves_what_the_library_computes_and_nothing_else() {
    let (mut still, mut moving) = (0, 0);
    for seed in 0..24 {
        let trial = random_graphs::generate(seed, 64).expect("a graph").trial;
        let program = Program::compile(&trial.scene, &trial.targets).expect("the graph compiles");
        let plain = program.evaluate_single(trial.points()).expect("values");
        // The generic text, nothing nudged, has the bits of the fast one.
        let same = program.evaluate_nudged(trial.points(), Nudge::Nothing).expect("values");
        let width = program.output_components();
        let names: Vec<&str> =
            program.outputs.iter().flat_map(|output| vec![output.name.as_str(); output.operands.len()]).collect();
        // (The hash of a NaN depends on its bits, which are the processor's. Every node's output is a target.)
        let has_nan = |at: usize| plain[at / width * width..][..width].iter().any(|value| value.is_nan());
        let other = (0..plain.len()).find(|&at| !equal(plain[at], same[at]) && !has_nan(at));
        let place =
            other.map(|at| format!("{} at point {}: {} and {}", names[at % width], at / width, plain[at], same[at]));
        assert_eq!(place, None, "seed {seed}");
        let up = program.evaluate_nudged(trial.points(), Nudge::Library(1)).expect("values");
        let of_library = program.outputs_of_library(trial.points()).expect("values");
        let widths: Vec<usize> = program.outputs.iter().map(|output| output.operands.len()).collect();
        let width: usize = widths.iter().sum();
        let mut first = 0;
        for (components, of_library) in widths.into_iter().zip(of_library) {
            let component = |values: &[f32], point: usize| values[point * width + first..][..components].to_vec();
            let moves = (0..trial.positions.len())
                .any(|point| component(&plain, point).iter().zip(component(&up, point)).any(|(a, b)| !equal(*a, b)));
            assert!(of_library || !moves, "seed {seed}: an output moves without the library");
            still += usize::from(!of_library);
            moving += usize::from(moves);
            first += components;
        }
    }
    assert!(still > 100 && moving > 20, "{still} outputs without the library, {moving} that move");
}

#[test]
fn constants_that_are_folded_are_nudged_too() {
    let graph = json!({"material": "Material", "groups": [], "nodes": [
        {"name": "Value", "type": "ShaderNodeValue", "outputs": {"Value": 0.7}},
        {"name": "Sine", "type": "ShaderNodeMath", "properties": {"operation": "SINE"},
         "inputs": {"Value": {"node": "Value", "socket": "Value"}}},
    ]});
    let scene = cloudparity::scene::bare_scene("folded", graph).expect("a scene");
    let constant = |nudge| {
        let program = Program::compile_nudged(&scene, &[Target::output("Sine", "Value")], nudge).expect("it compiles");
        assert!(program.instructions.is_empty());
        let points = cloudparity::graph::evaluate::Points::new(&[[0.0; 3]]);
        program.evaluate_single(points).expect("a value")[0]
    };
    let plain = constant(Nudge::Nothing);
    assert_eq!(plain, 0.7_f32.sin());
    assert_eq!(constant(Nudge::Library(1)), plain.next_up());
    assert_eq!(constant(Nudge::Library(2)), plain.next_down());
}

/// Our own values in the place of Cycles'.
struct Ours;

impl Reference for Ours {
    fn values(&mut self, trials: &[&Trial]) -> Vec<Result<Values>> {
        let of_trial = |trial: &&Trial| -> Result<Values> {
            let program = Program::compile(&trial.scene, &trial.targets)?;
            let values = program.evaluate_single(trial.points())?;
            let width = program.output_components();
            let mut first = 0;
            let of_output = |components: usize| -> Vec<f32> {
                let found = values.chunks(width).flat_map(|point| point[first..first + components].to_vec()).collect();
                first += components;
                found
            };
            Ok(program.outputs.iter().map(|output| output.operands.len()).map(of_output).collect())
        };
        trials.iter().map(of_trial).collect()
    }
}

/// Clamp with a mistake: above the upper end, a value one part in a million too large.
struct WrongClamp;

impl Evaluate for WrongClamp {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        for index in 0..outputs[0].len() {
            let [value, low, high] = [0, 1, 2].map(|column| inputs[column].values[index]);
            let clamped = value.clamped(low, high);
            outputs[0][index] = if value > high { clamped * R::of(1.000_001) } else { clamped };
        }
    }

    fn enclose(&self, _inputs: &[Interval], outputs: &mut [Interval]) {
        outputs.fill(Interval::EVERYTHING);
    }
}

/// The compiler with the mistake planted.
fn planted(scene: &Scene, targets: &[Target], nudge: Option<Nudge>) -> Result<Program> {
    let mut program = random_graphs::compile(scene, targets, nudge)?;
    for instruction in &mut program.instructions {
        let properties_are_plain = instruction.mode.words().contains(&"MINMAX".to_owned());
        if instruction.node_type.type_name == "ShaderNodeClamp" && properties_are_plain {
            instruction.evaluator = Box::new(WrongClamp);
        }
    }
    Ok(program)
}

#[test]
fn a_wrong_kernel_is_found_and_its_graph_becomes_small() {
    let judge = Judge { gpu: None, compile: &planted };
    let folder = tempfile::tempdir().expect("a folder");
    let mut kept = 0;
    for seed in 0..120 {
        let graph = random_graphs::generate(seed, 32).expect("a graph");
        let mut outcome = random_graphs::run(std::slice::from_ref(&graph), &judge, &mut Ours).remove(0);
        if outcome.failures.is_empty() {
            continue;
        }
        assert!(outcome.nodes > 8, "the graph is not small already");
        random_graphs::keep(&graph, &mut outcome, &judge, &mut Ours, folder.path()).expect("a folder to write to");
        for saved in &outcome.saved {
            assert_eq!(saved.failure.kind, Kind::Cpu, "seed {seed}: {:?}", saved.failure);
            assert!(saved.nodes <= 5, "seed {seed}: {} nodes are left", saved.nodes);
            let scene = Scene::load(&saved.path).expect("a scene file");
            assert!(scene.graph().nodes.iter().any(|node| node.kind == "ShaderNodeClamp"));
            let record = saved.path.to_string_lossy().replace(".scene.json", ".failure.json");
            let record = std::fs::read_to_string(record).expect("a record beside it");
            assert!(record.contains("\"position\": [") && record.contains("\"target\": \""), "{record}");
        }
        kept += outcome.saved.len();
        if kept >= 2 {
            return;
        }
    }
    panic!("the mistake was found in {kept} of 120 graphs");
}
