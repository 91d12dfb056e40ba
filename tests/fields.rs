//! Fields against live Cycles: the cloud, every mode of every node, random graphs, and a planted
//! difference that must be found.

mod support;

use cloudparity::field::suite::Selection;
use cloudparity::field::{self, Domain, Evaluator, Figures, suite};
use cloudparity::field::{domain, random_graphs, settings};
use cloudparity::graph::{Program, Target, target};
use cloudparity::scene::{Input, Scene};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Points per comparison of the cloud: a second of Cycles.
const POINTS: usize = 16384;

/// Points per mode: all special values meet in every socket, and the suite takes half a minute.
const MODE_POINTS: usize = 576;

fn compare(requests: &[field::Request<'_>]) -> Vec<Figures> {
    let (found, _) = field::compare(requests, |_| {}).expect("Cycles answers");
    found.into_iter().flat_map(|comparisons| field::figures(comparisons).into_values()).collect()
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
    let requests: Vec<field::Request<'_>> = cases
        .iter()
        .map(|(scene, target, positions)| field::Request {
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
    let request = field::Request {
        scene: &planted,
        target: density(&planted),
        positions: &positions,
        evaluators: &[Evaluator::Cpu],
        rounding_bound: false,
    };
    // Both sides get the planted scene and agree; then ours gets the other one and must not.
    let (agreeing, _) = field::compare(std::slice::from_ref(&request), |_| {}).expect("Cycles answers");
    assert_eq!(agreeing[0][0].1.differing(), 0);
    let job = cloudparity::blender::probe::Job {
        scene: &planted,
        positions: &positions,
        attributes: &[],
        targets: vec![density(&planted)],
        repeat: 1,
    };
    let answers = cloudparity::blender::probe::ask(&[job], cloudparity::blender::Kernel::Sse42, |_| {});
    let theirs = answers.expect("Cycles answers").jobs.remove(0).values.remove(0);
    let program = Program::density(&scene).expect("the scene compiles");
    let (ours, _) =
        field::evaluate(&program, cloudparity::graph::evaluate::Points::new(&positions), Evaluator::Cpu, None)
            .expect("evaluates");
    let found = field::Comparison::new(&positions, &ours, &theirs).expect("equal lengths").figures(Some(0.0));
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
            field::evaluate(program, at, evaluator, gpu).expect("the program evaluates").0
        };
        let cpu = evaluated(&program, Evaluator::Cpu, None);
        let bounds = program.rounding_bounds(at).expect("bounds");
        let judged = |ours: &[f32]| {
            let mut found = field::Comparison::new(&positions, ours, &cpu).expect("equal lengths");
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
    let graphs: Vec<_> = (0..100).map(|seed| random_graphs::generate(seed, 64).expect("a graph")).collect();
    let folder = std::env::temp_dir().join("cloudparity-failed-graphs");
    let outcomes = random_graphs::run(&graphs, &folder, |_| {}).expect("Cycles answers");
    let wrong: Vec<String> =
        outcomes.iter().filter(|outcome| !outcome.pass).map(|outcome| format!("{outcome:?}")).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(outcomes.iter().filter(|outcome| !outcome.library).count() >= 40, "the bit-exact class is not empty");
}
