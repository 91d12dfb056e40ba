//! Bounds over boxes: no sample may lie outside, for every node in every mode and for the cloud.
//!
//! Small by default. `cloudparity bounds` runs the full size on a scene; CLOUDPARITY_BOUNDS_BOXES
//! and CLOUDPARITY_BOUNDS_SAMPLES set the number of boxes per mode and of samples per box here.

mod support;

use cloudparity::graph::Program;
use cloudparity::graph::bounds::Bounds3;
use cloudparity::graph::bounds_check::{Survey, layer, points_in, violations};
use cloudparity::graph::evaluate::{Arithmetic, Points};
use cloudparity::measure::nodes::suite::modes_of;
use cloudparity::nodes::{Column, Interval, Mode, NodeEvaluator, NodeType, Oracle, Role, registry};
use cloudparity::scene::Release;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

fn size(name: &str, default: usize) -> usize {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// Nodes with other values than those of Blender 5.0, and the releases that have them.
const CHANGED: [(&str, &[Release]); 10] = [
    ("Voronoi Texture", &[Release::V4_5, Release::V5_3]),
    ("Math", &[Release::V4_5, Release::V5_1]),
    ("Vector Math", &[Release::V4_5, Release::V5_1]),
    ("RGB to BW", &[Release::V4_5, Release::V5_1]),
    ("Blackbody", &[Release::V5_1]),
    ("Brick Texture", &[Release::V5_1]),
    ("Vector Transform", &[Release::V5_1]),
    ("Magic Texture", &[Release::V5_2]),
    ("Mix", &[Release::V5_3]),
    ("Mix (Legacy)", &[Release::V5_3]),
];

/// Every mode of a node type, with all outputs; with the values of each release where these differ.
fn modes(node_type: &'static NodeType) -> Vec<Mode> {
    let read = |properties| {
        let mode = Mode::read(node_type, &properties, "test").expect("a combination of the node's own values");
        let outputs = node_type.outputs_of(&mode).map(|output| output.identifier).collect();
        mode.with_wanted(outputs)
    };
    let of = |release: Release| modes_of(node_type, release).into_iter().map(read);
    let changed = CHANGED.iter().filter(|(label, _)| *label == node_type.label).flat_map(|(_, releases)| *releases);
    let others = changed.flat_map(|release| of(*release).map(|mode| mode.with_release(*release)));
    of(Release::default()).chain(others).collect()
}

/// A number as graphs hold them, with zeros, integers, tiny and huge ones among them.
fn number(random: &mut ChaCha8Rng, hostile: bool) -> f32 {
    match random.random_range(0..if hostile { 14 } else { 10 }) {
        0 => 0.0,
        1 => random.random_range(-4_i32..=4) as f32,
        2..=5 => random.random_range(-2.0..2.0),
        6..=8 => random.random_range(-20.0..20.0),
        9 => random.random_range(0.0..1.0),
        10 => 10_f32.powf(random.random_range(-12.0..12.0)) * if random.random() { 1.0 } else { -1.0 },
        11 => random.random_range(-1e9..1e9),
        12 => [f32::MAX, f32::MIN, 1e-40, -1e-40, 3e38, f32::MIN_POSITIVE][random.random_range(0..6)],
        _ => [f32::INFINITY, f32::NEG_INFINITY][random.random_range(0..2)],
    }
}

/// An interval: a point, a narrow one, one from number to number.
fn interval(random: &mut ChaCha8Rng, hostile: bool) -> Interval {
    let first = number(random, hostile);
    let second = match random.random_range(0..3) {
        0 => first,
        1 => first + 10_f32.powf(random.random_range(-4.0..0.0)),
        _ => number(random, hostile),
    };
    Interval::new(first.min(second), first.max(second))
}

/// A value of the interval: an end, or between.
fn value_in(interval: Interval, random: &mut ChaCha8Rng) -> f32 {
    match random.random_range(0..6) {
        0 => interval.low,
        1 => interval.high,
        2 if interval.has_zero() => 0.0,
        3 => interval.low.round().clamp(interval.low, interval.high),
        _ => {
            let t: f64 = random.random();
            let [low, high] = interval.ends().map(|end| end.clamp(f64::from(f32::MIN), f64::from(f32::MAX)));
            ((low + t * (high - low)) as f32).clamp(interval.low, interval.high)
        }
    }
}

/// Intervals of a texture's inputs: a box of coordinates, and parameters that mostly are points.
fn texture_inputs(node_type: &'static NodeType, mode: &Mode, random: &mut ChaCha8Rng, hostile: bool) -> Vec<Interval> {
    let side = 0.5_f32.powf(random.random_range(-2.0..9.0));
    let mut inputs = Vec::new();
    for socket in node_type.inputs_of(mode) {
        for _ in 0..socket.kind.components() {
            let around = |low: f32, high: f32, random: &mut ChaCha8Rng| {
                let value = random.random_range(low..high);
                let spread = if random.random_range(0..5) == 0 { random.random_range(0.0..0.6) } else { 0.0 };
                Interval::new(value, value + spread)
            };
            inputs.push(match socket.identifier {
                "Vector" | "W" => {
                    let place = match random.random_range(0..20) {
                        0 => random.random_range(-2e6..2e6),
                        1 if hostile => number(random, true),
                        2 => random.random_range(-5_i32..5) as f32,
                        _ => random.random_range(-5.0..5.0),
                    };
                    let side = if random.random_range(0..5) == 0 { 0.0 } else { side };
                    Interval::new(place, (place + side).max(place))
                }
                "Scale" => around(-3.0, 4.0, random),
                "Detail" if random.random_range(0..3) == 0 => Interval::point(random.random_range(0..4) as f32),
                "Detail" => around(-0.5, 3.5, random),
                "Roughness" => around(-0.2, 1.3, random),
                "Lacunarity" => around(-0.5, 3.0, random),
                "Distortion" if random.random() => Interval::point(0.0),
                "Exponent" => match random.random_range(0..6) {
                    0 => around(-4.0, 40.0, random),
                    1 => Interval::point([0.0, 0.01, 60.0, -1.0][random.random_range(0..4)]),
                    _ => Interval::point(random.random_range(0.25..8.0)),
                },
                "Randomness" if random.random() => Interval::ONE,
                "Smoothness" => around(-0.1, 1.2, random),
                "Distortion" | "Randomness" => around(-1.0, 2.0, random),
                _ if hostile && random.random_range(0..8) == 0 => Interval::point(number(random, true)),
                _ => around(-1.0, 2.0, random),
            });
        }
    }
    inputs
}

/// Evaluates a node at points and counts the values outside of the bounds.
fn outside(node_evaluator: &dyn NodeEvaluator, inputs: &[Vec<f32>], bounds: &[Interval]) -> (usize, String) {
    let count = inputs.first().map_or(1, Vec::len);
    let columns: Vec<Column<'_, f32>> = inputs.iter().map(|values| Column { values, uniform: false }).collect();
    let mut single = vec![vec![0.0_f32; count]; bounds.len()];
    let mut slices: Vec<&mut [f32]> = single.iter_mut().map(Vec::as_mut_slice).collect();
    node_evaluator.evaluate_f32(&columns, &mut slices);
    let wide: Vec<Vec<Oracle>> =
        inputs.iter().map(|values| values.iter().map(|&x| Oracle(f64::from(x))).collect()).collect();
    let columns: Vec<Column<'_, Oracle>> = wide.iter().map(|values| Column { values, uniform: false }).collect();
    let mut oracle = vec![vec![Oracle(0.0); count]; bounds.len()];
    let mut slices: Vec<&mut [Oracle]> = oracle.iter_mut().map(Vec::as_mut_slice).collect();
    node_evaluator.evaluate_oracle(&columns, &mut slices);
    let mut found = 0;
    let mut example = String::new();
    for point in 0..count {
        let values = [
            single.iter().map(|column| f64::from(column[point])).collect::<Vec<f64>>(),
            oracle.iter().map(|column| column[point].0).collect(),
        ];
        for (kind, values) in ["f32", "f64"].into_iter().zip(values) {
            let here = violations(bounds, &values);
            if here > 0 && found == 0 {
                let at: Vec<f32> = inputs.iter().map(|column| column[point]).collect();
                example = format!("{kind} at {at:?}: {values:?} outside of {bounds:?}");
            }
            found += here;
        }
    }
    (found, example)
}

/// Whether a type's inputs are a texture's.
fn is_texture(node_type: &NodeType) -> bool {
    node_type.type_name.contains("Tex")
}

fn check_mode(node_type: &'static NodeType, mode: &Mode, boxes: usize, samples: usize, seed: u64) -> Vec<String> {
    let Role::Evaluated(build) = node_type.role else { return Vec::new() };
    let node_evaluator = build(mode);
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let width = node_type.outputs_of(mode).map(|output| output.kind.components()).sum();
    let components: usize = node_type.inputs_of(mode).map(|socket| socket.kind.components()).sum();
    let mut failures = Vec::new();
    for number in 0..boxes {
        // A third of the boxes holds extreme numbers.
        let hostile = number % 3 == 2;
        let intervals = if is_texture(node_type) {
            texture_inputs(node_type, mode, &mut random, hostile)
        } else {
            (0..components).map(|_| interval(&mut random, hostile)).collect()
        };
        let mut bounds = vec![Interval::EVERYTHING; width];
        node_evaluator.bounds(&intervals, &mut bounds);
        let inputs: Vec<Vec<f32>> =
            intervals.iter().map(|&interval| (0..samples).map(|_| value_in(interval, &mut random)).collect()).collect();
        let (found, example) = outside(node_evaluator.as_ref(), &inputs, &bounds);
        if found > 0 {
            failures.push(format!(
                "{} {}: {found} values, box {intervals:?}; {example}",
                node_type.label,
                mode.words().join(" ")
            ));
        }
    }
    failures
}

/// Every mode of the node types for which `chosen` holds.
fn check(chosen: impl Fn(&NodeType) -> bool, boxes: usize, samples: usize) {
    let boxes = size("CLOUDPARITY_BOUNDS_BOXES", boxes);
    let samples = size("CLOUDPARITY_BOUNDS_SAMPLES", samples);
    let all: Vec<(&'static NodeType, Mode)> = registry()
        .iter()
        .filter(|node_type| chosen(node_type))
        .flat_map(|node_type| modes(node_type).into_iter().map(move |mode| (*node_type, mode)))
        .collect();
    assert!(!all.is_empty(), "no node chosen");
    let failures: Vec<String> = all
        .par_iter()
        .enumerate()
        .flat_map(|(number, (node_type, mode))| check_mode(node_type, mode, boxes, samples, number as u64))
        .collect();
    let shown: Vec<&String> = failures.iter().take(12).collect();
    assert!(failures.is_empty(), "{} boxes with values outside: {shown:#?}", failures.len());
}

#[test]
fn values_of_arithmetic_nodes_lie_within_their_bounds() {
    check(|node_type| !is_texture(node_type), 600, 60);
}

#[test]
fn values_of_noise_lie_within_their_bounds() {
    check(|node_type| node_type.label == "Noise Texture", 60, 60);
}

#[test]
fn values_of_voronoi_lie_within_their_bounds() {
    check(|node_type| node_type.label == "Voronoi Texture", 12, 25);
}

#[test]
fn values_of_other_textures_lie_within_their_bounds() {
    let has_a_test_of_its_own = ["Noise Texture", "Voronoi Texture"];
    check(|node_type| is_texture(node_type) && !has_a_test_of_its_own.contains(&node_type.label), 60, 40);
}

#[test]
fn values_of_the_cloud_lie_within_its_bounds() {
    let scene = support::scene("procedural-clouds");
    let program = Program::density(&scene).expect("the cloud compiles");
    let mut place = layer(&scene, 0.5);
    place.low[2] = 0.0;
    let survey = Survey { layer: place, boxes: 300, samples: 200, grid: 64, cells: 1_000, refine: 0, seed: 7 };
    let report = survey.run(&program).expect("a scene without attributes has bounds");
    assert_eq!(report.violations, 0, "{report}");
    let grid = report.grid.expect("a grid was asked for");
    assert!(grid.proven_empty_share > 0.8, "{grid:?}");
}

#[test]
fn values_of_the_shader_lie_within_the_clouds_bounds() {
    if !support::require("vulkan") {
        return;
    }
    let scene = support::scene("procedural-clouds");
    let program = Program::density(&scene).expect("the cloud compiles");
    let gpu = cloudparity::gpu::Gpu::open().expect("an adapter");
    let kernel = gpu.field(&program).expect("the cloud's shader");
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let places: Vec<Bounds3> = (0..64)
        .map(|_| {
            let side = 0.5_f32.powf(random.random_range(3.0..9.0));
            let low = [random.random_range(-1.0..0.8), random.random_range(-1.0..0.8), random.random_range(0.0..0.3)];
            Bounds3::new(low, low.map(|x| x + side))
        })
        .collect();
    let points: Vec<[f32; 3]> = places.iter().flat_map(|place| points_in(place, 100, &mut random)).collect();
    let values = kernel.evaluate(Points::new(&points)).expect("values");
    let bounds = program.bounds_many(&places).expect("bounds");
    for ((bounds, values), place) in bounds.iter().zip(values.chunks(100)).zip(&places) {
        let values: Vec<f64> = values.iter().copied().map(f64::from).collect();
        assert_eq!(violations(std::slice::from_ref(bounds), &values), 0, "{place:?}: {bounds:?}");
    }
}

#[test]
fn refined_bounds_are_narrower_and_still_hold() {
    let scene = support::scene("procedural-clouds");
    let program = Program::density(&scene).expect("the cloud compiles");
    let place = Bounds3::new([0.1, 0.2, 0.2], [0.225, 0.325, 0.325]);
    let plain = program.bounds_many(&[place]).expect("bounds")[0];
    let refined = program.bounds_refined(&[place], 2).expect("bounds")[0];
    assert!(refined.high <= plain.high && refined.low >= plain.low, "{refined:?} {plain:?}");
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let points = points_in(&place, 2_000, &mut random);
    let values = program.evaluate(Points::new(&points), Arithmetic::Single).expect("values");
    assert_eq!(violations(&[refined], &values), 0);
}

#[test]
fn a_planted_violation_is_found() {
    let node_type = cloudparity::nodes::find("ShaderNodeMath").expect("Math is registered");
    let mut properties = serde_json::Map::new();
    properties.insert("operation".into(), "MULTIPLY".into());
    let mode = Mode::read(node_type, &properties, "test").expect("a mode of Math").with_wanted(vec!["Value"]);
    let Role::Evaluated(build) = node_type.role else { panic!("Math evaluates") };
    let node_evaluator = build(&mode);
    let inputs = [Interval::new(1.0, 2.0), Interval::new(3.0, 4.0)];
    let mut bounds = [Interval::EVERYTHING];
    node_evaluator.bounds(&inputs, &mut bounds);
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let values: Vec<Vec<f32>> =
        inputs.iter().map(|&interval| (0..200).map(|_| value_in(interval, &mut random)).collect()).collect();
    assert_eq!(outside(node_evaluator.as_ref(), &values, &bounds).0, 0);
    // Narrower by 1e-3 of its width: the products of ends fall outside.
    let margin = 1e-3 * (bounds[0].high - bounds[0].low);
    let narrowed = [Interval::new(bounds[0].low + margin, bounds[0].high - margin)];
    assert!(outside(node_evaluator.as_ref(), &values, &narrowed).0 > 0);
}
