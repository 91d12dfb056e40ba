//! The committed schema is the program's own, and it judges scene files as the program does.

mod support;

use serde_json::Value;
use support::project;

fn committed_schema() -> Value {
    let text = std::fs::read_to_string(project("docs/scene.schema.json")).expect("the schema is committed");
    serde_json::from_str(&text).expect("the schema is JSON")
}

fn committed_scenes() -> Vec<(String, Value)> {
    let folder = project("parity/scenes");
    let mut scenes: Vec<(String, Value)> = std::fs::read_dir(folder)
        .expect("the folder of scenes is committed")
        .map(|entry| entry.expect("a readable folder").path())
        .filter(|path| path.to_string_lossy().ends_with(".scene.json"))
        .map(|path| {
            let text = std::fs::read_to_string(&path).expect("a readable scene");
            (path.display().to_string(), serde_json::from_str(&text).expect("a scene is JSON"))
        })
        .collect();
    scenes.sort_by(|a, b| a.0.cmp(&b.0));
    scenes
}

#[test]
fn the_committed_schema_is_what_the_program_prints() {
    let output = assert_cmd::cargo::cargo_bin_cmd!("cloudparity").arg("schema").output().expect("the program runs");
    assert!(output.status.success());
    let committed = std::fs::read(project("docs/scene.schema.json")).expect("the schema is committed");
    assert!(
        output.stdout == committed,
        "docs/scene.schema.json is not of this version: cloudparity schema > docs/scene.schema.json"
    );
}

#[test]
fn every_committed_scene_fits_the_schema() {
    let validator = jsonschema::validator_for(&committed_schema()).expect("the schema is a JSON Schema");
    let scenes = committed_scenes();
    assert!(!scenes.is_empty(), "there are scenes to check");
    for (place, scene) in scenes {
        let faults: Vec<String> =
            validator.iter_errors(&scene).map(|fault| format!("{}: {fault}", fault.instance_path())).collect();
        assert!(faults.is_empty(), "{place}: {}", faults.join("; "));
    }
}

/// What is wrong, and how to make it so.
type Mutation = (&'static str, fn(&mut Value));

#[test]
fn the_schema_refuses_what_the_program_refuses() {
    let validator = jsonschema::validator_for(&committed_schema()).expect("the schema is a JSON Schema");
    let (_, good) = committed_scenes().swap_remove(0);
    let mutations: [Mutation; 5] = [
        ("an unknown key", |scene| scene["camera"]["zoom"] = 1.into()),
        ("a missing key", |scene| drop(scene.as_object_mut().expect("an object").remove("camera"))),
        ("a word for a number", |scene| scene["camera"]["focal_length"] = "long".into()),
        ("an unknown projection", |scene| scene["camera"]["projection"] = "fisheye".into()),
        ("a matrix of three rows", |scene| drop(scene["volume"]["matrix_world"].as_array_mut().expect("rows").pop())),
    ];
    for (what, mutate) in mutations {
        let mut scene = good.clone();
        mutate(&mut scene);
        assert!(!validator.is_valid(&scene), "the schema accepts {what}");
        assert!(cloudparity::scene::Scene::from_value(scene, "test").is_err(), "the program accepts {what}");
    }
}
