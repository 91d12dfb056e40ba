//! Sequences and ablations at a small size: what must be exact is, and figures are those of the pictures.

mod support;

use cloudparity::measure::experiment::{Outcome, Settings};
use cloudparity::measure::sequence;
use cloudparity::measure::sequence::file::SequenceFile;
use cloudparity::measure::study::Study;
use cloudparity::measure::study::file::StudyFile;

const SEQUENCE: &str = r#"
    format = "cloudparity-sequence/1"
    title = "small"
    resolution = [16, 9]
    frames = 20
    warm_up = 17
    scene = { file = "cloud-layer.scene.json" }
    engine = { density = "bolt", steps = 4, light_steps = 1 }
    motions = [{ name = "still" }, { name = "camera", turn = 20.0 }, { name = "clouds", seconds = 20.0 }]
    truth = { every = 2, path = { samples = 1, replicas = 6 } }
    reconstructions = [
        { name = "every ray" },
        { name = "more steps", steps = 8 },
        { name = "in place", how = { history = 0.9, reprojects = false } },
        { name = "checkerboard", how = { rays = "checkerboard" } },
        { name = "bayer", how = { rays = "bayer" } },
    ]
"#;

#[test]
fn ways_to_make_frames_cost_what_they_must() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = SequenceFile::parse(SEQUENCE, "test").expect("a sequence");
    let scene = file.scene(&support::project("parity/scenes")).expect("a scene");
    let run = || {
        let outcome = sequence::run(file.clone(), scene.clone(), folder.path(), &Settings::default(), &|_, _| ());
        let Outcome::All(results) = outcome.expect("results") else { panic!("there are no shards") };
        results
    };
    let found = run();
    assert_eq!(found.measured.len(), 15);
    let of = |motion: &str, way: &str| {
        found.measured.iter().find(|one| one.motion == motion && one.way == way).expect("it was measured")
    };
    for motion in ["still", "camera", "clouds"] {
        let plain = of(motion, "every ray");
        assert_eq!((plain.difference, plain.flicker, plain.rays), (0.0, 0.0, 1.0));
        assert_eq!((plain.relmse_change.value, plain.relmse_change.standard_error), (0.0, 0.0));
        assert!(of(motion, "more steps").difference > 0.0);
    }
    // What stands still is exact as soon as every pixel had its ray; a blend of equal pictures is that picture.
    for (way, rays) in [("in place", 1.0), ("checkerboard", 0.5), ("bayer", 12.0 / 144.0)] {
        let still = of("still", way);
        assert!(still.difference < 1e-9 && still.flicker < 1e-9, "{still:?}");
        assert_eq!(still.lag, None);
        assert!((still.rays - rays).abs() < 1e-9, "{still:?}");
        assert!(of("camera", way).difference > 1e-3);
    }
    assert!(of("clouds", "in place").lag.expect("they move") > 1.0);
    // Nothing is measured twice, and what is written is what was found.
    let again = run();
    assert_eq!(again, found);
    let text = std::fs::read_to_string(folder.path().join("sequence.json")).expect("it is there");
    assert_eq!(serde_json::from_str::<sequence::Results>(&text).expect("results"), found);
    let csv = std::fs::read_to_string(folder.path().join("sequence.csv")).expect("it is there");
    assert_eq!(csv.lines().count(), 16);
}

#[test]
fn ablations_are_differences_of_runs() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = r#"
        format = "cloudparity-study/1"
        title = "small"
        resolution = [16, 9]
        truth = { samples = 1, replicas = 6, tracking = "adaptive" }
        timing = { repeats = 1 }
        [axes]
        scenes = [{ file = "cloud-layer.scene.json" }]
        densities = ["bfwe coverage=0.8", "graph"]
        lights = ["own"]
        steps = [8]
        light_steps = [2]
        defects = ["none", "each", "all-but-each", "all"]
    "#;
    let file = StudyFile::parse(text, "test").expect("a study");
    let scenes = file.scenes(&support::project("parity/scenes")).expect("scenes");
    let study = Study::new(file, scenes);
    // Of two defects each is what is left without the other; a graph has none.
    assert_eq!(study.wanted.len(), 4 + 1);
    let outcome = study.run(folder.path(), &Settings::default(), &|_, _| ()).expect("results");
    let Outcome::All(found) = outcome else { panic!("there are no shards") };
    let [ablation] = found.ablations.as_slice() else { panic!("one ablation: {:?}", found.ablations) };
    let relmse = |defects: &str| {
        let is_it = |run: &&cloudparity::measure::study::Measured| {
            run.combination.density.starts_with("bfwe") && run.combination.defects.to_string() == defects
        };
        found.runs.iter().find(is_it).expect("it was run").errors.relmse.value
    };
    let [first, second, all] = ablation.rows.as_slice() else { panic!("three rows: {ablation:?}") };
    assert_eq!([&first.defect, &second.defect, &all.defect], ["BF-3", "BF-4", "all"]);
    for (row, without) in [(first, "BF-4"), (second, "BF-3")] {
        let (alone, among_all) = (row.alone.expect("it was run"), row.among_all.expect("it was run"));
        // Sums of the same numbers in another order.
        assert!((alone.relmse.value - (relmse(&row.defect) - relmse("none"))).abs() < 1e-9);
        assert!((among_all.relmse.value - (relmse("all") - relmse(without))).abs() < 1e-9);
        assert!(alone.time > 0.0 && among_all.time > 0.0);
    }
    assert!((all.alone.expect("both were run").relmse.value - (relmse("all") - relmse("none"))).abs() < 1e-9);
    assert!(all.among_all.is_none());
    let csv = std::fs::read_to_string(folder.path().join("ablation.csv")).expect("it is there");
    assert_eq!(csv.lines().count(), 4);
}
