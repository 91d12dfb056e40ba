//! Pieces of published systems against their closed forms: ranges, profiles over the height, streets of clouds, steps by distance.

mod support;

use cloudparity::engines::march::distance_levels::{DistanceLevels, camera_level, ray_steps};
use cloudparity::engines::node_graph::{GraphDensity, Input, NodeGraph};
use cloudparity::graph::evaluate::Points;
use cloudparity::scene::Scene;
use serde_json::Value;
use support::published::{numbers, published};

/// What nodes give at places, as f32 evaluates them. A density has no sign: the negative part is asked for by itself.
fn evaluate(make: impl Fn(&mut NodeGraph) -> Input, places: &[[f32; 3]]) -> Vec<f64> {
    let scene = Scene::load(&support::project("parity/scenes/linear-ramp.scene.json")).expect("a scene");
    let part = |sign: f64| {
        let mut graph = NodeGraph::default();
        let found = make(&mut graph);
        let density = graph.multiply(found, sign);
        let density = graph.maximum(density, 0.0);
        let program = GraphDensity { graph, density }.program("test", &scene).expect("a program");
        program.evaluate_single(Points::new(places)).expect("values")
    };
    let (positive, negative) = (part(1.0), part(-1.0));
    positive.iter().zip(negative).map(|(above, below)| f64::from(*above) - f64::from(below)).collect()
}

/// Unit roundoff of f32.
const UNIT: f64 = 0.5 * f32::EPSILON as f64;

#[test]
fn ranges_are_mapped_as_published() {
    let Some(golden) = published("remap") else { return };
    for row in golden["rows"].as_array().expect("rows") {
        let [x, low, high, to_low, to_high, expected] = numbers(row)[..] else { panic!("six numbers") };
        let found = evaluate(
            |graph| {
                let place = graph.place();
                let [x, _, _] = graph.separate(&place);
                graph.remap(&x, [low.into(), high.into()], [to_low, to_high], false)
            },
            &[[x as f32, 0.0, 0.0]],
        )[0];
        // Every number is rounded to f32 (1 each), then come two differences, a quotient, a product and a sum (1 each); a difference keeps the
        // absolute error of its parts, which is what makes it large where they are nearly equal.
        let slope = ((to_high - to_low) / (high - low)).abs();
        let cancelled = |a: f64, b: f64| (a.abs() + b.abs()) / (a - b).abs();
        let own = (x - low).abs() * slope * (3.0 + cancelled(high, low) + cancelled(to_high, to_low));
        let bound = 2.0 * UNIT * (expected.abs() + to_low.abs() + own + slope * (x.abs() + low.abs()));
        assert!((found - expected).abs() <= bound, "{row}: {found}, bound {bound:e}");
    }
}

#[test]
fn an_empty_range_divides_nothing() {
    let found = evaluate(
        |graph| {
            let place = graph.place();
            let [x, _, _] = graph.separate(&place);
            graph.remap(&x, [0.5.into(), 0.5.into()], [0.25, 1.0], false)
        },
        &[[0.2, 0.0, 0.0], [0.5, 0.0, 0.0], [7.0, 0.0, 0.0]],
    );
    // Blender's Map Range, and what is right for `best` (BE-10).
    assert_eq!(found, [0.0; 3]);
}

#[test]
fn profiles_over_the_height_are_those_published() {
    let Some(golden) = published("height_profiles") else { return };
    let heights = numbers(&golden["h"]);
    let places: Vec<[f32; 3]> = heights.iter().map(|&height| [height as f32, 0.0, 0.0]).collect();
    let over = |profile: &dyn Fn(&mut NodeGraph, &Input) -> Input| {
        evaluate(
            |graph| {
                let place = graph.place();
                let [height, _, _] = graph.separate(&place);
                profile(graph, &height)
            },
            &places,
        )
    };
    // Slopes of up to 12.5 times the height's rounding, and the roundings of a few products of numbers up to 3.
    let check = |name: &str, found: Vec<f64>, expected: &Value, bound: &dyn Fn(f64) -> f64| {
        for ((height, found), expected) in heights.iter().zip(found).zip(numbers(expected)) {
            assert!((found - expected).abs() <= bound(*height), "{name} at {height}: {found}, not {expected}");
        }
    };
    let few = |_: f64| 64.0 * UNIT;
    check("trapezoid", over(&|graph, height| graph.trapezoid(height)), &golden["trapezoid_015_085"], &few);
    let fades = over(&|graph, height| graph.fades(height, height, [0.08, 0.12]));
    check("fades", fades, &golden["bottom_top_fade_008_012"], &few);
    for (bias, expected) in golden["takram_semicircle"].as_object().expect("by bias") {
        let bias: f64 = bias.parse().expect("a number");
        let found = over(&|graph, height| {
            let kept = graph.remap(height, [0.0.into(), 1.0.into()], [0.0, 1.0], true);
            let off = graph.off_middle(&kept, bias);
            graph.subtract(1.0, off)
        });
        // The slope 4 (2 y - 1) b y / h, y = h^b, times the height's rounding, and that of the power (2 units).
        let bound = move |height: f64| {
            let y = height.clamp(1e-3, 1.0).powf(bias);
            UNIT * (16.0 + 4.0 * (2.0 * y - 1.0).abs() * y * (2.0 * bias + 4.0))
        };
        check(&format!("semicircle of {bias}"), found, expected, &bound);
    }
    let density = over(&|graph, height| {
        let kept = graph.remap(height, [0.0.into(), 1.0.into()], [0.0, 1.0], true);
        graph.multiply_add(kept, 0.75, 0.25)
    });
    check("density profile", density, &golden["takram_density_profile_default"], &few);
}

#[test]
fn streets_are_bands_about_their_spines() {
    let Some(golden) = published("spine") else { return };
    for row in golden["rows"].as_array().expect("rows") {
        let [px, pz, ax, az, bx, bz, radius, distance, mask] = numbers(row)[..] else { panic!("nine numbers") };
        let place = [[px as f32, pz as f32, 0.0]];
        let at = |graph: &mut NodeGraph| {
            let place = graph.place();
            let [x, z, _] = graph.separate(&place);
            [x, z]
        };
        let line = [[ax, az], [bx, bz]];
        let found = evaluate(
            |graph| {
                let [x, z] = at(graph);
                graph.distance_to_line([&x, &z], &line)
            },
            &place,
        )[0];
        // Coordinates and the projection's parts (up to the segment's length) carry some eight roundings each, which a distance keeps as they are.
        let size = [px, pz, ax, az, bx, bz].iter().fold(0.0, |sum: f64, coordinate| sum + coordinate.abs());
        let error = 8.0 * UNIT * (size + distance);
        assert!((found - distance).abs() <= error, "{row}: {found}, bound {error:e}");
        let band = evaluate(
            |graph| {
                let [x, z] = at(graph);
                graph.spine_band([&x, &z], &line, radius, 1.0)
            },
            &place,
        )[0];
        // The cubic's slope is at most 1.5.
        assert!((band - mask).abs() <= 1.5 * error / radius + 16.0 * UNIT, "{row}: {band}");
    }
}

#[test]
fn the_nearest_piece_of_a_line_counts() {
    let line = [[0.0, 0.0], [10.0, 0.0], [10.0, 0.0], [10.0, 10.0]];
    let places = [[5.0, 3.0, 0.0], [12.0, 5.0, 0.0], [-3.0, 4.0, 0.0], [13.0, -4.0, 0.0], [10.0, 14.0, 0.0]];
    let found = evaluate(
        |graph| {
            let place = graph.place();
            let [x, z, _] = graph.separate(&place);
            graph.distance_to_line([&x, &z], &line)
        },
        &places,
    );
    assert!(found.iter().zip([3.0, 2.0, 5.0, 5.0, 4.0]).all(|(found, expected)| (found - expected).abs() < 1e-5));
}

#[test]
fn steps_by_distance_are_those_published() {
    let Some(golden) = published("lod") else { return };
    let mut from = 0.0;
    for row in golden["camera_levels"].as_array().expect("rows") {
        let steps = [1, 2].map(|column| row[column].as_u64().expect("a number") as u32);
        let below = row[0].as_f64().unwrap_or(1e6);
        for distance in [from, below - 1e-6] {
            assert_eq!(camera_level(distance), steps, "{distance}");
        }
        from = below;
    }
    for row in golden["ray_rows"].as_array().expect("rows") {
        let [steps, distance, divisor, iterations] = numbers(row)[..] else { panic!("four numbers") };
        let found = ray_steps(steps as u32, distance);
        assert_eq!(found, divisor, "{row}");
        assert_eq!(found as u32, iterations as u32, "{row}");
        let levels = |with_rest, beyond_asked| DistanceLevels { metres: 10.0, with_rest, beyond_asked };
        let asked = steps as u32;
        assert_eq!(levels(true, true).steps_of(asked, distance / 10.0), divisor, "{row}");
        let corrected = levels(false, false).steps_of(asked, distance / 10.0);
        assert_eq!(corrected, divisor.round().min(steps), "{row}");
        assert!(divisor <= f64::from(levels(true, true).most_steps(asked)), "{row}");
        assert!(corrected <= f64::from(levels(false, false).most_steps(asked)), "{row}");
    }
}
