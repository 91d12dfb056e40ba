//! Attribution at a small size: shares add up to the whole error, and a planted error is found in its stage.

mod support;

use cloudparity::measure::attribution::file::AttributionFile;
use cloudparity::measure::attribution::stage::Stage;
use cloudparity::measure::attribution::{self, Attributed, Results};
use cloudparity::measure::experiment::{Outcome, Settings};
use std::path::Path;

/// Two scenes: several orders of scattering, and one alone.
const FILE: &str = r#"
    format = "cloudparity-attribution/1"
    title = "small"
    resolution = [12, 9]
    truth = { samples = 256, replicas = 6 }
    exact = { steps = 96, light_steps = 48, rays = 16 }
    orders = 4
    scenes = [{ file = "cube-multiple-scattering.scene.json" }, { file = "linear-ramp.scene.json", volume_bounces = 0 }]
    engines = [
        { name = "coarse", density = "graph", steps = 3, light_steps = 1, light = "octaves", jitter = "table", cache = { cells = 4 } },
        { name = "extinction", density = "graph", steps = 96, light_steps = 48, sub_pixels = 4, exact = ["orders", "ambient"], plant = { extinction = 1.2 } },
        { name = "mean cosine", density = "graph", steps = 96, light_steps = 48, sub_pixels = 4, exact = ["orders", "ambient"], plant = { anisotropy = 0.2 } },
        { name = "shift", density = "graph", steps = 96, light_steps = 48, sub_pixels = 4, exact = ["orders", "ambient"], plant = { shift = [0.5, 0.25] } },
        { name = "gamma", density = "graph", steps = 96, light_steps = 48, sub_pixels = 4, exact = ["orders", "ambient"], plant = { gamma = 1.2 } },
    ]
"#;

fn run(text: &str, folder: &Path) -> Results {
    let file = AttributionFile::parse(text, "test").expect("an attribution");
    let scenes = file.load_scenes(&support::project("parity/scenes"), "test").expect("scenes");
    let outcome = attribution::run(file, scenes, folder, &Settings::default(), &|_, _| ());
    let Outcome::All(results) = outcome.expect("results") else { panic!("there are no shards") };
    results
}

#[test]
fn shares_add_up_and_planted_errors_are_found() {
    let folder = tempfile::tempdir().expect("a folder");
    let found = run(FILE, folder.path());
    assert_eq!(found.attributed.len(), 10);
    let stages = |one: &Attributed| one.shares.iter().map(|share| share.stage).collect::<Vec<_>>();
    for one in &found.attributed {
        // In every order the shares add up, but for roundings.
        let difference = one.relmse.value - one.remainder.value;
        assert!((one.sum() - difference).abs() <= 1e-12 * (1.0 + difference.abs()), "{one:?}");
        let brightness: f64 = one.shares.iter().map(|share| share.brightness.value).sum();
        let wanted = one.brightness.value - one.brightness_remainder.value;
        assert!((brightness - wanted).abs() < 1e-12, "{one:?}");
        // 4 standard errors of 5 degrees of freedom: 1 % of such cases would lie beyond; these are few and their seeds are fixed.
        let remainder = one.remainder;
        assert!(remainder.value.abs() <= 4.0 * remainder.standard_error, "{one:?}");
        let largest =
            one.shares.iter().max_by(|a, b| a.relmse.value.total_cmp(&b.relmse.value)).expect("stages differ");
        assert!(largest.relmse.value > 4.0 * largest.relmse.standard_error, "noise is no share: {one:?}");
        // So do the maps.
        let maps = one.shares.iter().map(|share| mean_of(&folder.path().join(&share.map))).sum::<f64>();
        let truth = mean_of(&folder.path().join(&one.compared[1]));
        // Pixels are f32.
        assert!((maps - wanted * truth).abs() < 1e-6 * truth, "{maps} {wanted} {truth}");
    }
    let coarse = [&found.attributed[0], &found.attributed[5]];
    let several = stages(coarse[0]);
    assert!([Stage::Orders, Stage::Ambient, Stage::ViewRay, Stage::Shadow].iter().all(|stage| several.contains(stage)));
    assert!(coarse[0].drawn_orders.is_some(), "more sets than orders ask for");
    // Octaves imitate what this scene has not: more than one order.
    assert!(stages(coarse[1]).contains(&Stage::Orders));
    for (engine, stage) in [
        ("extinction", Stage::Field),
        ("mean cosine", Stage::Phase),
        ("shift", Stage::Filter),
        ("gamma", Stage::Display),
    ] {
        for one in found.attributed.iter().filter(|one| one.engine == engine) {
            let share = one.shares.iter().find(|share| share.stage == stage).expect("the stage differs");
            assert!(one.part(share) >= 0.9, "{engine}: {one:?}");
            assert!(!stages(one).contains(&Stage::Orders), "given as exact");
        }
    }
    // Nothing is measured twice, and what is written is what was found.
    assert_eq!(run(FILE, folder.path()), found);
    let text = std::fs::read_to_string(folder.path().join("attribution.json")).expect("it is there");
    assert_eq!(serde_json::from_str::<Results>(&text).expect("results"), found);
    let csv = std::fs::read_to_string(folder.path().join("attribution.csv")).expect("it is there");
    let shares: usize = found.attributed.iter().map(|one| one.shares.len()).sum();
    assert_eq!(csv.lines().count(), 1 + 2 * found.attributed.len() + shares);
    let page = cloudparity::report::write_report(folder.path(), &[]).expect("a report");
    let html = std::fs::read_to_string(page).expect("it is there");
    // In the caption and in a row.
    assert_eq!(html.matches("left where all are exact").count(), 2 * found.attributed.len());
    let figures = std::fs::read_to_string(folder.path().join("figures.csv")).expect("it is there");
    assert_eq!(figures.matches("attribution,").count(), 2 * found.attributed.len() + 3 * shares);
}

/// Mean over pixels and colours.
/// Cycles' replicas are subsets of its samples. In a homogeneous cube the two renderers agree, so that nothing is left but noise.
#[test]
fn beside_cycles_what_is_left_is_the_difference_of_renderers() {
    if !support::require("bpy") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let text = FILE.replace("orders = 4", "orders = 4\n    cycles = { samples = 256 }");
    let text = text.replace(r#", { file = "linear-ramp.scene.json", volume_bounces = 0 }"#, "");
    let mut file = AttributionFile::parse(&text, "test").expect("an attribution");
    file.engines.truncate(1);
    let found = run(&toml::to_string(&file).expect("it serialises"), folder.path());
    let [one] = found.attributed.as_slice() else { panic!("one engine in one scene") };
    let difference = one.relmse.value - one.remainder.value;
    assert!((one.sum() - difference).abs() <= 1e-12 * (1.0 + difference.abs()), "{one:?}");
    assert!(one.remainder.value.abs() <= 4.0 * one.remainder.standard_error, "{one:?}");
    assert!(
        one.remainder.standard_error < 0.1 * one.relmse.value,
        "the noise of both renderers says something: {one:?}"
    );
}

fn mean_of(path: &Path) -> f64 {
    let image = cloudparity::scene::image::Image::read_exr(path).expect("a picture");
    let sum: f64 = image.pixels.iter().flat_map(|pixel| &pixel[..3]).map(|&value| f64::from(value)).sum();
    sum / (3 * image.pixels.len()) as f64
}

#[test]
fn mistakes_are_named() {
    let error = |from: &str, to: &str| {
        assert!(FILE.contains(from), "{from}");
        AttributionFile::parse(&FILE.replacen(from, to, 1), "a.toml").expect_err("refused")
    };
    assert!(error("attribution/1", "attribution/2").expected.contains("cloudparity-attribution/1"));
    assert!(error("orders = 4", "orders = 1").place.contains("orders"));
    assert!(error("orders = 4", "orders = 4\n    cycles = { samples = 0 }").place.contains("cycles.samples"));
    let published = FILE.replacen("\"graph\"", "\"perlin-fbm\"", 1);
    let published = published.replace("orders = 4", "orders = 4\n    cycles = { samples = 4 }");
    let refused = AttributionFile::parse(&published, "a.toml").expect_err("Cycles has no such density");
    assert!(refused.place.contains("engines[0].density"), "{refused}");
    assert!(error("rays = 16", "rays = 257").expected.contains("256"));
    assert!(error("steps = 3", "steps = 0").place.contains("engines[0]"));
    assert!(error("\"mean cosine\"", "\"extinction\"").place.contains("engines[2].name"));
    assert!(error("gamma = 1.2", "gamma = 0.0").place.contains("engines[4].plant"));
    assert!(error("[\"orders\", \"ambient\"]", "[\"order\"]").to_string().contains("ambient"));
    assert!(error("light = \"octaves\"", "light = \"moon\"").place.contains("engines[0].light"));
    assert!(error("replicas = 6", "replicas = 5").place.contains("truth"));
    assert!(error("title = \"small\"", "titel = \"small\"").to_string().contains("titel"));
}
