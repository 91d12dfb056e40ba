//! Bad input through the program: exit status 2, one error line that names place, found, expected and
//! what to do, no panic, and no file left behind.

mod support;

use assert_cmd::Command;
use serde_json::{Value as Json, json};
use std::path::Path;
use tempfile::TempDir;

/// A run of the program.
struct Run {
    status: Option<i32>,
    stdout: String,
    stderr: String,
}

fn run_with(folder: &Path, arguments: &[&str], environment: &[(&str, &str)]) -> Run {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cloudparity"));
    command.current_dir(folder).args(arguments).envs(environment.iter().copied());
    let output = command.output().expect("the program starts");
    Run {
        status: output.status.code(),
        stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

fn run(folder: &Path, arguments: &[&str]) -> Run {
    run_with(folder, arguments, &[])
}

impl Run {
    /// Asserts that the run ended with an error of the usual form, whose text holds all `parts`.
    #[track_caller]
    fn is_refused(&self, what: &str, parts: &[&str]) {
        let Self { status, stdout, stderr } = self;
        assert!(!stderr.contains("panicked"), "{what}: {stderr}");
        assert_eq!(*status, Some(2), "{what}: {stdout}{stderr}");
        assert!(stdout.is_empty(), "{what}: {stdout}");
        // Warnings may stand before it.
        let message = stderr.find("error: ").map_or("", |start| stderr[start..].trim_end());
        let (place, rest) =
            message.split_once(": found ").unwrap_or_else(|| panic!("{what}: no found part: {message}"));
        let place = place.strip_prefix("error: ").unwrap_or_else(|| panic!("{what}: {message}"));
        let (found, rest) = rest.split_once("; expected ").unwrap_or_else(|| panic!("{what}: no expected: {message}"));
        let (expected, remedy) = rest.rsplit_once(". ").unwrap_or_else(|| panic!("{what}: no remedy: {message}"));
        for (name, text) in [("place", place), ("found", found), ("expected", expected), ("remedy", remedy)] {
            assert!(!text.trim().is_empty(), "{what}: empty {name}: {message}");
        }
        for part in parts {
            assert!(message.contains(part), "{what}: \"{part}\" is not in: {message}");
        }
    }

    #[track_caller]
    fn succeeds(&self, what: &str) {
        assert_eq!(self.status, Some(0), "{what}: {}", self.stderr);
        assert!(!self.stderr.contains("panicked"), "{what}: {}", self.stderr);
    }
}

fn cloud() -> Json {
    let text = std::fs::read_to_string(support::project("parity/scenes/procedural-clouds.scene.json"));
    serde_json::from_str(&text.expect("the committed scene")).expect("the committed scene is JSON")
}

/// The cloud's scene with another graph: these nodes, and what Density of the closing node is.
fn scene_with(density: Json, nodes: Vec<Json>, groups: Vec<Json>) -> Json {
    let mut scene = cloud();
    let mut all = vec![
        json!({"name": "Material Output", "type": "ShaderNodeOutputMaterial",
               "inputs": {"Volume": {"node": "Principled Volume", "socket": "Volume"}}}),
        json!({"name": "Principled Volume", "type": "ShaderNodeVolumePrincipled", "inputs": {"Density": density}}),
    ];
    all.extend(nodes);
    scene["graph"] = json!({"material": "Material", "nodes": all, "groups": groups});
    scene
}

fn link(node: &str, socket: &str) -> Json {
    json!({"node": node, "socket": socket})
}

fn math(name: &str, operation: &str, inputs: Json) -> Json {
    json!({"name": name, "type": "ShaderNodeMath", "properties": {"operation": operation}, "inputs": inputs})
}

/// A density of one Math node with these inputs.
fn one_math(inputs: Json) -> Json {
    scene_with(link("Math", "Value"), vec![math("Math", "ADD", inputs)], vec![])
}

fn coordinates() -> Json {
    json!({"name": "Texture Coordinate", "type": "ShaderNodeTexCoord"})
}

fn write(folder: &TempDir, name: &str, text: &str) {
    std::fs::write(folder.path().join(name), text).expect("a temporary file");
}

fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// Runs `explain` on a scene.
fn explained(scene: &Json) -> Run {
    let folder = folder();
    write(&folder, "x.scene.json", &scene.to_string());
    run(folder.path(), &["explain", "x.scene.json"])
}

/// A `.npy` file, version 1.0, with any header.
fn npy(descriptor: &str, order: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let mut header = format!("{{'descr': '{descriptor}', 'fortran_order': {order}, 'shape': {shape}, }}");
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(u16::try_from(header.len()).expect("a short header").to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

fn save_points(folder: &TempDir, name: &str, points: &[[f32; 3]]) {
    let data: Vec<u8> = points.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
    let bytes = npy("<f4", "False", &format!("({}, 3)", points.len()), &data);
    std::fs::write(folder.path().join(name), bytes).expect("a temporary file");
}

/// Runs `eval` of a scene at points with more arguments; the values when it succeeds.
fn evaluated(scene: &Json, points: &[[f32; 3]], more: &[&str]) -> (Run, Vec<f32>, Vec<usize>) {
    let folder = folder();
    write(&folder, "x.scene.json", &scene.to_string());
    save_points(&folder, "p.npy", points);
    let arguments = [&["eval", "x.scene.json", "--points", "p.npy", "-o", "v.npy"], more].concat();
    let run = run(folder.path(), &arguments);
    let result = folder.path().join("v.npy");
    if run.status != Some(0) {
        assert!(!result.exists(), "a failed run leaves no file");
        return (run, Vec::new(), Vec::new());
    }
    let (values, shape) = cloudparity::base::files::read_values(&result).expect("values");
    (run, values, shape)
}

#[test]
fn no_such_file() {
    let folder = folder();
    write(&folder, "x.scene.json", &cloud().to_string());
    for arguments in [
        vec!["explain", "no.scene.json"],
        vec!["shader", "no.scene.json", "-o", "x.wgsl"],
        vec!["export", "no.scene.json", "-o", "x.blend"],
        vec!["eval", "no.scene.json", "--points", "p.npy", "-o", "v.npy"],
    ] {
        let run = run(folder.path(), &arguments);
        run.is_refused(&arguments.join(" "), &["no.scene.json", "No such file", "a scene file"]);
    }
    let missing_points = run(folder.path(), &["eval", "x.scene.json", "--points", "p.npy", "-o", "v.npy"]);
    missing_points.is_refused("points", &["p.npy", "No such file", "a float32 .npy file"]);
    run(folder.path(), &["explain", "."]).is_refused("a folder", &["a folder", "a scene file"]);
    std::fs::write(folder.path().join("binary.scene.json"), [0xff, 0xfe, 0x00]).expect("a temporary file");
    run(folder.path(), &["explain", "binary.scene.json"]).is_refused("binary", &["binary.scene.json", "UTF-8"]);
}

#[test]
fn a_scene_that_names_a_missing_or_broken_graph_file() {
    let folder = folder();
    let mut scene = cloud();
    let graph = scene["graph"].take();
    scene["graph"] = json!({"file": "g.graph.json"});
    write(&folder, "x.scene.json", &scene.to_string());
    run(folder.path(), &["explain", "x.scene.json"]).is_refused("missing", &["g.graph.json", "No such file"]);
    write(&folder, "g.graph.json", "{\"material\": \"M\"}");
    run(folder.path(), &["explain", "x.scene.json"]).is_refused("broken", &["g.graph.json", "nodes"]);
    write(&folder, "g.graph.json", &graph.to_string());
    run(folder.path(), &["explain", "x.scene.json"]).succeeds("a graph file beside the scene");
}

#[test]
fn truncated_and_damaged_json() {
    let folder = folder();
    let whole =
        std::fs::read_to_string(support::project("parity/scenes/procedural-clouds.scene.json")).expect("a scene");
    for length in [0, 1, 2, 100, whole.len() / 2, whole.trim_end().len() - 1] {
        write(&folder, "x.scene.json", &whole[..length]);
        let run = run(folder.path(), &["explain", "x.scene.json"]);
        run.is_refused(&format!("cut after {length} bytes"), &["x.scene.json: line", "column", "complete JSON"]);
    }
    write(&folder, "x.scene.json", &format!("{whole}{{}}"));
    run(folder.path(), &["explain", "x.scene.json"]).is_refused("more behind the end", &["line", "trailing"]);
    let deep = format!("{}{}", "[".repeat(100_000), "]".repeat(100_000));
    write(&folder, "x.scene.json", &deep);
    run(folder.path(), &["explain", "x.scene.json"]).is_refused("deep nesting", &["recursion limit"]);
}

#[test]
fn numbers_that_are_none() {
    let folder = folder();
    let whole =
        std::fs::read_to_string(support::project("parity/scenes/procedural-clouds.scene.json")).expect("a scene");
    assert!(whole.contains("\"focal_length\": 50.0"));
    for (number, parts) in [
        ("NaN", ["line 13", "finite numbers"]),
        ("Infinity", ["line 13", "finite numbers"]),
        ("-Infinity", ["line 13", "finite numbers"]),
        ("1e39", ["$.camera.focal_length", "f32 range"]),
        ("-1e39", ["$.camera.focal_length", "f32 range"]),
        ("1e999", ["line 13", "finite numbers"]),
        ("\"50\"", ["$.camera.focal_length", "invalid type: string"]),
        ("null", ["$.camera.focal_length", "invalid type: null"]),
        ("[50.0]", ["$.camera.focal_length", "invalid type: sequence"]),
    ] {
        write(
            &folder,
            "x.scene.json",
            &whole.replace("\"focal_length\": 50.0", &format!("\"focal_length\": {number}")),
        );
        run(folder.path(), &["explain", "x.scene.json"]).is_refused(number, &parts);
    }
    // The largest f32 and what rounds to it are finite.
    for number in ["3.4028235e38", "-3.4028235e38", "1e-60"] {
        write(
            &folder,
            "x.scene.json",
            &whole.replace("\"focal_length\": 50.0", &format!("\"focal_length\": {number}")),
        );
        run(folder.path(), &["explain", "x.scene.json"]).succeeds(number);
    }
}

#[test]
fn all_errors_of_a_scene_are_named_at_once() {
    let folder = folder();
    let mut scene = cloud();
    let remove = |part: &mut Json, key: &str| drop(part.as_object_mut().map(|fields| fields.remove(key)));
    remove(&mut scene, "format");
    remove(&mut scene["camera"], "matrix_world");
    scene["camera"]["zoom"] = 2.into();
    scene["camera"]["projection"] = "fisheye".into();
    scene["film"]["resolution"] = json!([320]);
    scene["integrator"]["volume_bounces"] = (-1).into();
    remove(&mut scene["lights"][0], "strength");
    scene["world"]["strength"] = "bright".into();
    remove(&mut scene["graph"]["nodes"][1], "type");
    scene["graph"]["nodes"][0]["inputs"]["Volume"] = json!({"node": "Principled Volume"});
    write(&folder, "x.scene.json", &scene.to_string());
    run(folder.path(), &["explain", "x.scene.json"]).is_refused(
        "ten errors",
        &[
            "10 errors",
            "$: no format",
            "$.camera: no matrix_world",
            "$.camera: \"zoom\"",
            "$.camera.projection",
            "$.film.resolution",
            "$.integrator.volume_bounces",
            "$.lights[0]: no strength",
            "$.world.strength",
            "$.graph.nodes[1]: no type",
            "$.graph.nodes[0].inputs.Volume",
        ],
    );
}

#[test]
fn files_in_the_wrong_place_are_recognised() {
    let folder = folder();
    write(&folder, "cloud.blend", "BLENDER-v500");
    write(&folder, "compressed.blend", "\u{28}\u{b5}");
    write(&folder, "x.scene.json", &cloud().to_string());
    write(&folder, "x.study.toml", "format = 1");
    std::fs::write(folder.path().join("x.png"), b"\x89PNG\r\n\x1a\n").expect("written");
    std::fs::write(folder.path().join("x.exr"), b"\x76\x2f\x31\x01").expect("written");
    std::fs::create_dir(folder.path().join("run")).expect("made");
    let cases: &[(&[&str], &[&str])] = &[
        (&["explain", "cloud.blend"], &["a .blend", "a scene file", "cloudparity init cloud.blend"]),
        (&["render", "compressed.blend", "-o", "a.exr"], &["a .blend", "cloudparity init compressed.blend"]),
        (&["probe", "x.exr"], &["an OpenEXR picture", "a scene file", "cloudparity diff"]),
        (&["params", "x.png"], &["a PNG picture", "a scene file"]),
        (&["eval", "run", "--points", "p.npy", "-o", "v.npy"], &["a folder", "a scene file"]),
        (&["study", "x.scene.json", "-o", "out"], &["a scene file", "a study file", "cloudparity render x.scene.json"]),
        (&["tune", "x.study.toml", "-o", "out"], &["a study file", "a tuning file", "cloudparity study x.study.toml"]),
        (&["export", "x.scene.json", "-o", "y.scene.json"], &["a scene file", "a .blend"]),
        (&["render", "x.scene.json", "-o", "a.exr", "--preset", "x.exr"], &["an OpenEXR picture", "a preset"]),
        (&["export", "x.scene.json", "--model", "bolt", "-o", "y.blend"], &["y.blend", "a scene file", "afterwards"]),
        (&["export", "x.scene.json", "--model", "bolt", "-o", "y.png"], &["y.png", "NAME.scene.json"]),
    ];
    for (arguments, parts) in cases {
        run(folder.path(), arguments).is_refused(&arguments.join(" "), parts);
    }
    // What belongs to a .blend or to a picture is not passed over for a cloud system.
    for unfit in [["--object", "Cloud"], ["--frame", "3"], ["--view", "Filmic"], ["--exposure", "1"]] {
        let line = ["export", "x.scene.json", "--model", "bolt", unfit[0], unfit[1], "-o", "y.scene.json"];
        let found = run(folder.path(), &line);
        assert_eq!(found.status, Some(2), "{}", found.stdout);
        assert!(found.stderr.contains("cannot be used with") && found.stderr.contains(unfit[0]), "{}", found.stderr);
    }
    assert!(!folder.path().join("y.scene.json").exists() && !folder.path().join("y.blend").exists());
    assert!(!folder.path().join("out").exists() && !folder.path().join("a.exr").exists());
}

#[test]
fn the_beginning_writes_over_nothing() {
    let folder = folder();
    write(&folder, "x.scene.json", &cloud().to_string());
    run(folder.path(), &["init", "x.scene.json", "-o", "new"]).succeeds("a scene that is there");
    for name in ["x.study.toml", "x.tune.toml"] {
        assert!(folder.path().join("new").join(name).is_file(), "{name}");
    }
    run(folder.path(), &["init", "x.scene.json", "-o", "new"]).is_refused("again", &["x.study.toml", "there already"]);
    // What it wrote is a study of the scene.
    let listed = run(folder.path(), &["study", "new/x.study.toml", "-o", "runs", "--list"]);
    listed.succeeds("the study that was written");
    assert!(listed.stdout.contains("octaves"), "{}", listed.stdout);
}

#[test]
fn wrong_fields_of_the_scene() {
    type Edit = fn(&mut Json);
    let cases: &[(&str, Edit, &[&str])] = &[
        ("format", |scene| scene["format"] = "cloudparity-scene/9".into(), &["$.format", "cloudparity-scene/1"]),
        (
            "no camera",
            |scene| drop(scene.as_object_mut().map(|fields| fields.remove("camera"))),
            &["missing field `camera`"],
        ),
        ("unknown field", |scene| scene["colour"] = 1.into(), &["colour", "unknown field"]),
        ("name", |scene| scene["name"] = 3.into(), &["$.name", "integer `3`"]),
        ("projection", |scene| scene["camera"]["projection"] = "fisheye".into(), &["$.camera.projection", "fisheye"]),
        ("matrix rows", |scene| scene["camera"]["matrix_world"] = json!([[1, 0, 0, 0]]), &["$.camera.matrix_world"]),
        (
            "flat matrix",
            |scene| scene["volume"]["matrix_world"] = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]]),
            &["$.volume.matrix_world", "cannot be inverted"],
        ),
        ("no pixels", |scene| scene["film"]["resolution"] = json!([0, 10]), &["$.film.resolution", "0 x 10"]),
        ("negative pixels", |scene| scene["film"]["resolution"] = json!([-1, 10]), &["$.film.resolution[0]"]),
        (
            "more pixels than fit into 32 bits",
            |scene| {
                scene["film"]["resolution"] = json!([4_294_967_295_u32, 1080]);
                scene["film"]["resolution_percentage"] = json!(4_294_967_295_u32);
            },
            &["$.film.resolution", "1 to 16384"],
        ),
        ("half a pixel", |scene| scene["film"]["resolution"] = json!([1.5, 10]), &["$.film.resolution[0]"]),
        ("light", |scene| scene["lights"][0]["type"] = "hemi".into(), &["$.lights[0]", "hemi"]),
        ("angle", |scene| scene["lights"][0]["angle"] = "wide".into(), &["$.lights[0]"]),
        ("bounds", |scene| scene["volume"]["bounds"]["min"][1] = 5.into(), &["$.volume.bounds", "min not above max"]),
        ("shape", |scene| scene["volume"]["shape"]["type"] = "sphere".into(), &["$.volume.shape", "sphere"]),
        (
            "triangle",
            |scene| {
                scene["volume"]["shape"] =
                    json!({"type": "mesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "triangles": [[0, 1, 3]]});
            },
            &["$.volume.shape.triangles[0]", "indices below 3"],
        ),
        ("graph", |scene| scene["graph"] = json!([1]), &["$.graph", "sequence"]),
        ("graph and file", |scene| scene["graph"]["file"] = "x".into(), &["$.graph", "exclude each other"]),
        ("no nodes", |scene| scene["graph"] = json!({"material": "M"}), &["$.graph", "missing field `nodes`"]),
        ("nodes", |scene| scene["graph"]["nodes"] = json!({}), &["$.graph.nodes"]),
        ("node", |scene| scene["graph"]["nodes"][1] = json!("x"), &["$.graph.nodes[1]"]),
        (
            "unknown key of a node",
            |scene| scene["graph"]["nodes"][1]["mutted"] = true.into(),
            &["$.graph.nodes[1].mutted", "unknown field"],
        ),
        (
            "type of a group's socket",
            |scene| scene["graph"]["groups"][0]["inputs"][2]["type"] = "matrix".into(),
            &["$.graph.groups[0].inputs[2].type", "matrix"],
        ),
        (
            "default of a group's socket",
            |scene| scene["graph"]["groups"][0]["inputs"][2]["default"] = json!("much"),
            &["group Procedural Clouds Shader: socket Socket_2: default", "\"much\"", "a number"],
        ),
        (
            "two sockets of one identifier",
            |scene| scene["graph"]["groups"][0]["inputs"][2]["identifier"] = "Socket_23".into(),
            &["group Procedural Clouds Shader", "two inputs called \"Socket_23\""],
        ),
        (
            "two nodes of one name",
            |scene| scene["graph"]["nodes"][1]["name"] = "Material Output".into(),
            &["$.graph.nodes", "two nodes called \"Material Output\""],
        ),
        (
            "two nodes of one name in a group",
            |scene| scene["graph"]["groups"][0]["nodes"][1]["name"] = "Group Output".into(),
            &["group Procedural Clouds Shader", "two nodes called \"Group Output\""],
        ),
        (
            "two groups of one name",
            |scene| {
                let group = scene["graph"]["groups"][0].clone();
                scene["graph"]["groups"].as_array_mut().expect("a list").push(group);
            },
            &["$.graph.groups", "two groups called"],
        ),
    ];
    for (what, edit, parts) in cases {
        let mut scene = cloud();
        edit(&mut scene);
        let run = explained(&scene);
        run.is_refused(what, parts);
        assert!(run.stderr.contains("x.scene.json"), "{what}: the file is named: {}", run.stderr);
    }
}

#[test]
fn wrong_inputs_of_a_node() {
    for (value, parts) in [
        (json!([1.0, 2.0, 3.0]), vec!["node Math: input Value", "a list of 3 numbers", "a number or a link"]),
        (json!([]), vec!["node Math: input Value", "a list of 0 numbers"]),
        (json!("one"), vec!["node Math: input Value", "the text \"one\""]),
        (json!(null), vec!["inputs.Value", "null"]),
        (json!({"node": "Math"}), vec!["inputs.Value", "node"]),
        (json!({"node": 3, "socket": "Value"}), vec!["inputs.Value"]),
        (json!([1, "x"]), vec!["inputs.Value"]),
        (json!({"node": "Nobody", "socket": "Value"}), vec!["node Math: input Value", "\"Nobody\"", "does not exist"]),
        (json!({"node": "Texture Coordinate", "socket": "Objekt"}), vec!["\"Objekt\"", "Object"]),
        (json!({"node": "Texture Coordinate", "socket": "UV"}), vec!["the UV output", "Use the Object output"]),
        (json!({"group_input": "Socket_1"}), vec!["node Math: input Value", "outside of a group"]),
        (json!({"node": "Principled Volume", "socket": "Volume"}), vec!["a closure"]),
    ] {
        let mut scene = one_math(json!({"Value": value}));
        scene["graph"]["nodes"].as_array_mut().expect("a list").push(coordinates());
        explained(&scene).is_refused(&value.to_string(), &parts);
    }
    let misspelt = one_math(json!({"Value_1": 1.0}));
    explained(&misspelt).is_refused("misspelt", &["node Math: input Value_1", "Value, Value_001, Value_002"]);
    let mut closure = one_math(json!({}));
    closure["graph"]["nodes"][1]["inputs"]["Densty"] = 1.0.into();
    explained(&closure).is_refused("misspelt", &["node Principled Volume: input Densty", "Density"]);
    let vector = json!({"name": "V", "type": "ShaderNodeVectorMath", "properties": {"operation": "LENGTH"},
                        "inputs": {"Vector": [1.0, 2.0]}});
    explained(&scene_with(link("V", "Value"), vec![vector], vec![]))
        .is_refused("two of three", &["node V: input Vector", "a list of 2 numbers", "three numbers"]);
}

#[test]
fn wrong_properties_of_a_node() {
    for (properties, parts) in [
        (json!({"operation": "PLUS"}), vec!["node Math: property operation", "\"PLUS\"", "ADD, SUBTRACT"]),
        (json!({"operation": 3}), vec!["property operation", "found 3"]),
        (json!({"operation": null}), vec!["property operation", "found null"]),
        (json!({"use_clamp": 1}), vec!["property use_clamp", "true or false"]),
        (json!({"clamp": true}), vec!["property clamp", "operation, use_clamp"]),
        (json!([]), vec!["properties"]),
    ] {
        let mut scene = one_math(json!({}));
        scene["graph"]["nodes"][2]["properties"] = properties.clone();
        explained(&scene).is_refused(&properties.to_string(), &parts);
    }
    let object = |matrix: Json| {
        let node = json!({"name": "T", "type": "ShaderNodeTexCoord",
                          "properties": {"object": {"name": "Empty", "matrix_world": matrix}}});
        scene_with(link("T", "Object"), vec![node], vec![])
    };
    explained(&object(json!([[1]]))).is_refused("no matrix", &["node T: property object", "4x4"]);
    explained(&object(json!(vec![vec![0; 4]; 4]))).is_refused("flat", &["node T: property object", "inverted"]);
    let value = json!({"name": "N", "type": "ShaderNodeValue"});
    explained(&scene_with(link("N", "Value"), vec![value], vec![])).is_refused("no number", &["node N", "outputs"]);
}

#[test]
fn unknown_nodes() {
    let musgrave = json!({"name": "Old", "type": "ShaderNodeTexMusgrave", "inputs": {}});
    let scene = scene_with(link("Old", "Fac"), vec![musgrave.clone()], vec![]);
    explained(&scene).is_refused("reached", &["node Old", "ShaderNodeTexMusgrave", "Noise Texture", "Replace"]);
    let scene = scene_with(json!(1.0), vec![musgrave], vec![]);
    explained(&scene).succeeds("an unknown node that reaches nothing");
}

#[test]
fn materials_without_a_volume() {
    let mut scene = cloud();
    scene["graph"]["nodes"] = json!([]);
    explained(&scene).is_refused("empty", &["material Material", "no Material Output", "Principled Volume"]);
    let mut scene = cloud();
    scene["graph"]["nodes"][0]["inputs"] = json!({});
    explained(&scene).is_refused("unlinked", &["no link to its Volume input"]);
    let mut scene = cloud();
    scene["graph"]["nodes"][0]["inputs"]["Volume"]["node"] = "Nobody".into();
    explained(&scene).is_refused("missing closure", &["node Material Output", "\"Nobody\", which does not exist"]);
    let mut scene = cloud();
    scene["graph"]["nodes"][1]["type"] = "ShaderNodeAddShader".into();
    explained(&scene).is_refused("other closure", &["node Principled Volume", "input Color", "Shader_001"]);
    let mut scene = cloud();
    scene["graph"]["nodes"][1]["muted"] = true.into();
    explained(&scene).is_refused("muted closure", &["a muted ShaderNodeVolumePrincipled"]);
    let reroute = |name: &str, from: &str| json!({"name": name, "type": "NodeReroute", "socket_type": "shader", "inputs": {"Input": link(from, "Output")}});
    let mut scene = scene_with(json!(1.0), vec![reroute("A", "B"), reroute("B", "A")], vec![]);
    scene["graph"]["nodes"][0]["inputs"]["Volume"] = link("A", "Output");
    explained(&scene).is_refused("ring of reroutes", &["node A", "a cycle of links: A -> B -> A"]);
}

#[test]
fn the_material_output_of_cycles_counts() {
    let other = json!({"name": "Other", "type": "ShaderNodeOutputMaterial", "inputs": {}});
    let scene = |first: Json, second: Json| {
        let mut scene = scene_with(json!(1.0), vec![other.clone()], vec![]);
        scene["graph"]["nodes"][0]["properties"] = second;
        scene["graph"]["nodes"][2]["properties"] = first;
        scene["graph"]["nodes"].as_array_mut().expect("a list").swap(0, 2);
        scene
    };
    let plain = json!({"is_active_output": false, "target": "ALL"});
    let active = json!({"is_active_output": true, "target": "ALL"});
    let cycles = json!({"is_active_output": false, "target": "CYCLES"});
    let eevee = json!({"is_active_output": true, "target": "EEVEE"});
    explained(&scene(plain.clone(), active.clone())).succeeds("the active one");
    explained(&scene(active, cycles)).succeeds("the one for Cycles");
    explained(&scene(eevee, plain.clone())).succeeds("not the one for EEVEE");
    explained(&scene(plain.clone(), plain)).is_refused("the first", &["no link to its Volume input"]);
}

#[test]
fn cycles_of_links() {
    let ring = |length: usize| {
        let nodes = (0..length)
            .map(|number| {
                math(
                    &format!("N{number}"),
                    "ADD",
                    json!({"Value": link(&format!("N{}", (number + 1) % length), "Value")}),
                )
            })
            .collect();
        scene_with(link("N0", "Value"), nodes, vec![])
    };
    explained(&ring(1)).is_refused("itself", &["node N0", "a cycle of links: N0 -> N0", "Remove one"]);
    explained(&ring(3)).is_refused("three", &["a cycle of links: N0 -> N1 -> N2 -> N0"]);
    explained(&ring(5000)).is_refused("5000", &["a cycle of links", "4992 more"]);
    let reroute = |name: &str, from: &str| json!({"name": name, "type": "NodeReroute", "socket_type": "float", "inputs": {"Input": link(from, "Output")}});
    let reroutes = scene_with(link("A", "Output"), vec![reroute("A", "B"), reroute("B", "A")], vec![]);
    explained(&reroutes).is_refused("reroutes", &["a cycle of links: A -> B -> A"]);
    let muted = |name: &str, from: &str| {
        json!({"name": name, "type": "ShaderNodeMath", "muted": true, "bypass": {"Value": "Value"},
               "inputs": {"Value": link(from, "Value")}})
    };
    let muted = scene_with(link("A", "Value"), vec![muted("A", "B"), muted("B", "A")], vec![]);
    explained(&muted).is_refused("muted nodes", &["a cycle of links: A -> B -> A"]);
    // A group's output that leads back to its own input.
    let group = json!({"name": "G", "nodes": [
            {"name": "End", "type": "NodeGroupOutput", "inputs": {"out": {"group_input": "in"}}}],
        "inputs": [{"identifier": "in", "name": "in", "type": "float", "default": 0.0}],
        "outputs": [{"identifier": "out", "name": "out", "type": "float"}]});
    let node =
        json!({"name": "Group", "type": "ShaderNodeGroup", "group": "G", "inputs": {"in": link("Group", "out")}});
    explained(&scene_with(link("Group", "out"), vec![node], vec![group])).is_refused("group", &["a cycle of links"]);
}

/// A group whose output is its node `inner`, a group node of `of`, or an input.
fn group_of(name: &str, of: &str) -> Json {
    json!({"name": name, "inputs": [], "outputs": [{"identifier": "out", "name": "out", "type": "float"}], "nodes": [
        {"name": "a", "type": "ShaderNodeGroup", "group": of, "inputs": {}},
        {"name": "b", "type": "ShaderNodeGroup", "group": of, "inputs": {}},
        {"name": "sum", "type": "ShaderNodeMath", "inputs": {"Value": link("a", "out"), "Value_001": link("b", "out")}},
        {"name": "End", "type": "NodeGroupOutput", "inputs": {"out": link("sum", "Value")}},
    ]})
}

#[test]
fn groups_that_cannot_be_put_in_place() {
    let use_of = |group: &str| json!({"name": "Group", "type": "ShaderNodeGroup", "group": group, "inputs": {}});
    let scene = |groups: Vec<Json>, first: &str| scene_with(link("Group", "out"), vec![use_of(first)], groups);
    explained(&scene(vec![group_of("G", "G")], "G")).is_refused("itself", &["group G: node a", "G -> G", "ring"]);
    let ring = vec![group_of("A", "B"), group_of("B", "A")];
    explained(&scene(ring, "A")).is_refused("ring", &["A -> B -> A", "Break the ring"]);
    // 2^31 nodes from 31 groups.
    let mut doubling: Vec<Json> =
        (0..30).map(|number| group_of(&format!("G{number}"), &format!("G{}", number + 1))).collect();
    doubling.push(json!({"name": "G30", "inputs": [], "nodes": [{"name": "End", "type": "NodeGroupOutput", "inputs": {"out": 1.0}}],
                         "outputs": [{"identifier": "out", "name": "out", "type": "float"}]}));
    explained(&scene(doubling.clone(), "G0")).is_refused("doubling", &["$.graph", "nodes once all groups", "1000000"]);
    let deep: Vec<Json> = (0..40).map(|number| group_of(&format!("G{number}"), &format!("G{}", number + 1))).collect();
    explained(&scene(deep, "G0")).is_refused("deep", &["at most 32 deep"]);
    explained(&scene(vec![], "G")).is_refused("missing", &["node Group", "a group \"G\"", "$.graph.groups"]);
    let no_end = json!({"name": "G", "inputs": [], "nodes": [], "outputs": [{"identifier": "out", "name": "out", "type": "float"}]});
    // Cycles takes 0 for what has no end, whatever the default of the interface is.
    let (run, values, _) = evaluated(&scene(vec![no_end], "G"), &[[0.1, 0.2, 0.3]], &[]);
    assert_eq!((run.status, values), (Some(0), vec![0.0]), "{}", run.stderr);
    let other = json!({"name": "G", "inputs": [], "nodes": [], "outputs": []});
    explained(&scene(vec![other.clone()], "G")).is_refused("no output", &["output \"out\"", "group \"G\""]);
    let mut unknown = scene(vec![other], "G");
    unknown["graph"]["nodes"][2]["inputs"] = json!({"in": 1.0});
    explained(&unknown).is_refused("unknown input", &["node Group: input in"]);
    let mut muted = scene(vec![], "G");
    muted["graph"]["nodes"][2]["muted"] = true.into();
    explained(&muted).is_refused("muted and missing", &["a group \"G\""]);
}

#[test]
fn long_chains_compile_or_say_their_limit() {
    let chain = |length: usize| {
        let mut nodes = vec![coordinates()];
        nodes.extend((0..length).map(|number| {
            let before = if number == 0 {
                link("Texture Coordinate", "Object")
            } else {
                link(&format!("N{}", number - 1), "Value")
            };
            math(&format!("N{number}"), "SINE", json!({"Value": before}))
        }));
        scene_with(link(&format!("N{}", length - 1), "Value"), nodes, vec![])
    };
    let (run, values, _) = evaluated(&chain(20_000), &[[0.1, 0.2, 0.3], [1.0, 2.0, 3.0]], &[]);
    run.succeeds("20,000 nodes");
    assert_eq!(values.len(), 2);
    assert!(values.iter().all(|value| (0.0..0.1).contains(value)), "{values:?}");
    explained(&chain(30_000)).is_refused("30,000 nodes", &["a chain of links through more than 25000 nodes"]);
}

#[test]
fn node_names_of_any_script() {
    for name in [
        "Wölkchen ☁",
        "雲",
        "a\nb",
        "a\u{2028}b",
        "#import x",
        "a /* b",
        "*/",
        "X::Y",
        "%n{}",
        " ",
        "'\"\\",
        "/",
        "A.B",
    ] {
        let mut scene = one_math(json!({"Value": link("T", "Object")}));
        scene["graph"]["nodes"][1]["inputs"]["Density"] = link(name, "Value");
        scene["graph"]["nodes"][2]["name"] = name.into();
        scene["graph"]["nodes"]
            .as_array_mut()
            .expect("a list")
            .push(json!({"name": "T", "type": "ShaderNodeTexCoord"}));
        scene["graph"]["material"] = name.into();
        explained(&scene).succeeds(name);
        let (run, values, _) = evaluated(&scene, &[[0.25, 0.25, 0.25]], &["--target", &format!("{name}.Value")]);
        run.succeeds(name);
        assert_eq!(values, [0.75], "{name}");
        let folder = folder();
        write(&folder, "x.scene.json", &scene.to_string());
        let shader = crate::run(folder.path(), &["shader", "x.scene.json", "-o", "x.wgsl"]);
        shader.succeeds(name);
    }
}

#[test]
fn points_of_another_form() {
    let scene = cloud();
    let folder = folder();
    write(&folder, "x.scene.json", &scene.to_string());
    let zeros = [0_u8; 64];
    for (what, bytes, parts) in [
        ("f64", npy("<f8", "False", "(1, 3)", &zeros[..24]), vec!["p.npy", "float32"]),
        ("integers", npy("<i4", "False", "(1, 3)", &zeros[..12]), vec!["p.npy", "float32"]),
        ("text", npy("<U4", "False", "(1, 3)", &zeros[..48]), vec!["p.npy", "float32"]),
        ("objects", npy("|O", "False", "(1, 3)", &zeros[..24]), vec!["p.npy", "float32"]),
        ("one axis", npy("<f4", "False", "(3,)", &zeros[..12]), vec!["p.npy", "[n, 3]"]),
        ("no axis", npy("<f4", "False", "()", &zeros[..4]), vec!["p.npy", "[n, 3]"]),
        ("three axes", npy("<f4", "False", "(1, 1, 3)", &zeros[..12]), vec!["p.npy", "[n, 3]"]),
        ("pairs", npy("<f4", "False", "(2, 2)", &zeros[..16]), vec!["p.npy", "[2, 2]", "[n, 3]"]),
        ("fours", npy("<f4", "False", "(2, 4)", &zeros[..32]), vec!["p.npy", "[2, 4]"]),
        ("no columns", npy("<f4", "False", "(2, 0)", &[]), vec!["p.npy", "[2, 0]"]),
        ("too short", npy("<f4", "False", "(9, 3)", &zeros[..12]), vec!["p.npy"]),
        ("too long", npy("<f4", "False", "(1, 3)", &zeros[..16]), vec!["p.npy"]),
        ("huge", npy("<f4", "False", "(100000000000, 3)", &zeros[..12]), vec!["p.npy"]),
        ("more than memory holds", npy("<f4", "False", "(4611686018427387904, 3)", &[]), vec!["p.npy"]),
        ("negative", npy("<f4", "False", "(-1, 3)", &zeros[..12]), vec!["p.npy"]),
        ("no numpy file", b"x,y,z\n0,0,0\n".to_vec(), vec!["p.npy"]),
        ("empty", Vec::new(), vec!["p.npy"]),
    ] {
        std::fs::write(folder.path().join("p.npy"), bytes).expect("a temporary file");
        let run = run(folder.path(), &["eval", "x.scene.json", "--points", "p.npy", "-o", "v.npy"]);
        run.is_refused(what, &parts);
        assert!(!folder.path().join("v.npy").exists(), "{what}");
    }
    // Column-major order and the other byte order are ways to write the same array.
    let points = [[0.1_f32, 0.2, 0.3], [0.4, 0.5, 0.6]];
    let expected = evaluated(&scene, &points, &[]).1;
    let columns: Vec<u8> = (0..3).flat_map(|axis| points.map(|point| point[axis])).flat_map(f32::to_le_bytes).collect();
    let big_end_first: Vec<u8> = points.as_flattened().iter().flat_map(|value| value.to_be_bytes()).collect();
    for (what, bytes) in [
        ("column-major", npy("<f4", "True", "(2, 3)", &columns)),
        ("big end first", npy(">f4", "False", "(2, 3)", &big_end_first)),
    ] {
        std::fs::write(folder.path().join("p.npy"), bytes).expect("a temporary file");
        run(folder.path(), &["eval", "x.scene.json", "--points", "p.npy", "-o", "v.npy"]).succeeds(what);
        let (values, _) = cloudparity::base::files::read_values(&folder.path().join("v.npy")).expect("values");
        assert_eq!(values, expected, "{what}");
    }
}

#[test]
fn no_points_give_no_values() {
    for evaluator in ["cpu", "oracle"] {
        let (run, values, shape) = evaluated(&cloud(), &[], &["--backend", evaluator]);
        run.succeeds(evaluator);
        assert_eq!((values.len(), shape), (0, vec![0]), "{evaluator}");
    }
    let scene = scene_with(json!(1.0), vec![coordinates()], vec![]);
    let (run, _, shape) = evaluated(&scene, &[], &["--target", "Texture Coordinate.Object"]);
    run.succeeds("vectors");
    assert_eq!(shape, [0, 3]);
    if support::require("vulkan") {
        let (run, values, _) = evaluated(&cloud(), &[], &["--backend", "gpu"]);
        run.succeeds("gpu");
        assert!(values.is_empty());
    }
}

/// Points that a field need not be defined at.
fn wild_points() -> Vec<[f32; 3]> {
    let values = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, 1e20, -1e20, 3e9, 1e-45, -0.0, 0.3];
    values.iter().flat_map(|&x| [[x, 0.1, 0.2], [0.1, x, 0.2], [0.1, 0.2, x], [x, x, x]]).collect()
}

#[test]
fn wild_points_give_a_value_each() {
    for evaluator in ["cpu", "oracle"] {
        let (run, values, _) = evaluated(&cloud(), &wild_points(), &["--backend", evaluator]);
        run.succeeds(evaluator);
        assert_eq!(values.len(), wild_points().len(), "{evaluator}");
    }
}

#[test]
fn names_that_eval_does_not_find() {
    let scene = cloud();
    let points = [[0.1, 0.2, 0.3]];
    for (more, parts) in [
        (
            ["--target", "Nobody.Value"],
            vec!["target Nobody.Value", "no node of that name", "NODE.SOCKET", "(--target)"],
        ),
        (["--target", "Math"], vec!["target Math", "no node of that name"]),
        (["--target", ""], vec!["target ", "no node of that name"]),
        (["--target", "Math.016.Nothing"], vec!["node Group.001/Math.016", "output \"Nothing\"", "Value"]),
        (["--target", "Principled Volume.Volume"], vec!["node Principled Volume", "a closure"]),
        (["--target", "Material Output.Volume"], vec!["node Material Output", "ShaderNodeOutputMaterial"]),
        (["--set", "Scale=2"], vec!["value Scale=2", "3 inputs", "Large Noise/Scale", "(--set)"]),
        (["--set", "Nothing=2"], vec!["value Nothing=2", "no input called", "Altitude"]),
        (["--set", "Altitude=NaN"], vec!["value Altitude=NaN", "a finite number"]),
        (["--set", "Altitude=inf"], vec!["a finite number"]),
        (["--set", "Altitude=1e39"], vec!["a finite number"]),
        (["--set", "Altitude=-1"], vec!["0 to 10000", "limits"]),
        (["--set", "Altitude=1,2,3"], vec!["3 numbers", "one for Altitude"]),
        (["--set", "Altitude"], vec!["no \"=\"", "NAME=VALUE"]),
        (["--set", "Principled Volume.Density=1"], vec!["a link from Group.001.Socket_0"]),
    ] {
        evaluated(&scene, &points, &more).0.is_refused(&more.join(" "), &parts);
    }
    let unrounded = evaluated(&scene, &points, &["--unrounded"]).0;
    unrounded.is_refused("--unrounded", &["--backend oracle"]);
}

#[test]
fn an_output_that_stands_in_several_trees_is_named_by_its_path() {
    let group = json!({"name": "G", "inputs": [], "outputs": [{"identifier": "out", "name": "out", "type": "float"}],
        "nodes": [math("Math", "ADD", json!({"Value": 1.0, "Value_001": 2.0})),
                  {"name": "End", "type": "NodeGroupOutput", "inputs": {"out": link("Math", "Value")}}]});
    let use_of = |name: &str| json!({"name": name, "type": "ShaderNodeGroup", "group": "G", "inputs": {}});
    let nodes = vec![use_of("A"), use_of("B"), math("Math", "ADD", json!({"Value": 5.0, "Value_001": 2.0}))];
    let scene = scene_with(link("A", "out"), nodes, vec![group]);
    let points = [[0.0; 3]];
    let ambiguous = evaluated(&scene, &points, &["--target", "Math.Value"]).0;
    ambiguous.is_refused("ambiguous", &["3 nodes of that name", "/A/Math.Value or /B/Math.Value or /Math.Value"]);
    for (name, value) in [("/Math.Value", 7.0), ("A/Math.Value", 3.0), ("/B/Math.Value", 3.0), ("B.out", 3.0)] {
        let (run, values, _) = evaluated(&scene, &points, &["--target", name]);
        run.succeeds(name);
        assert_eq!(values, [value], "{name}");
    }
}

#[test]
fn places_that_cannot_be_written() {
    let folder = folder();
    write(&folder, "x.scene.json", &cloud().to_string());
    write(&folder, "file", "not a folder");
    save_points(&folder, "p.npy", &[[0.0; 3]]);
    let into_file = run(folder.path(), &["eval", "x.scene.json", "--points", "p.npy", "-o", "file/v.npy"]);
    into_file.is_refused("a file as folder", &["file/v.npy", "a writable file", "permissions"]);
    let into_file = run(folder.path(), &["shader", "x.scene.json", "-o", "file/x.wgsl"]);
    into_file.is_refused("a file as folder", &["file/x.wgsl", "a writable file"]);
    std::fs::create_dir(folder.path().join("taken")).expect("a folder");
    let onto_folder = run(folder.path(), &["shader", "x.scene.json", "-o", "taken"]);
    onto_folder.is_refused("a folder as file", &["taken", "a writable file"]);
    let nowhere = run(folder.path(), &["shader", "x.scene.json", "-o", "/proc/none/x.wgsl"]);
    nowhere.is_refused("a folder that cannot be made", &["/proc/none/x.wgsl", "a writable file"]);
    let names: Vec<_> = std::fs::read_dir(folder.path())
        .expect("a folder")
        .map(|entry| entry.expect("an entry").file_name().into_string().expect("a plain name"))
        .filter(|name| name.starts_with(".cloudparity"))
        .collect();
    assert!(names.is_empty(), "temporary files are left: {names:?}");
}

#[test]
fn command_lines_that_make_no_sense() {
    let folder = folder();
    for arguments in [&["paint"][..], &[], &["eval"], &["shader", "x.scene.json", "--language", "cuda", "-o", "x"]] {
        let run = run(folder.path(), arguments);
        assert_eq!(run.status, Some(2), "{arguments:?}");
        assert!(!run.stderr.contains("panicked"), "{}", run.stderr);
    }
}

#[test]
fn settings_of_ray_marching_that_make_no_sense() {
    let folder = folder();
    write(&folder, "x.scene.json", &cloud().to_string());
    let render = |more: &[&str]| {
        let begin = ["render", "x.scene.json", "-o", "x.exr", "--volume-bounces", "0", "--resolution", "4x4"];
        run(folder.path(), &[&begin, more].concat())
    };
    for (more, parts) in [
        (&["--density-cache", "0"][..], &["density_cache", "0 cells", "at least 1"][..]),
        // The memory that it would need, and how many cells fit.
        (
            &["--density-cache", "100000"],
            &["density_cache", "100000 cells", "GiB", "at most 4 GiB", "(--density-cache)"],
        ),
        (&["--density-cache", "4294967295", "--cache-format", "f32"], &["4294967295 cells", "GiB"]),
        (&["--seed", "3"], &["--seed", "--jitter pixel"]),
        (&["--exit-transmittance=-1"], &["exit_transmittance", "-1", "at least 0"]),
        (&["--integrator", "path", "--jitter", "pixel"], &["--jitter", "--integrator march"]),
        (&["--integrator", "path", "--density-cache", "8"], &["--density-cache", "--integrator march"]),
        (&["--integrator", "path", "--generic"], &["--generic", "--integrator march"]),
    ] {
        render(more).is_refused(&format!("{more:?}"), parts);
    }
    // Refused by the parser of the command line, which names what is possible.
    for (more, possible) in [
        (&["--density-cache", "8", "--cache-format", "bf16"][..], "unorm8"),
        (&["--density-cache", "8", "--cache-filter", "cubic"], "trilinear"),
        (&["--cache-format", "f16"], "--density-cache"),
        (&["--integration", "euler"], "energy-conserving"),
        (&["--jitter", "blue"], "pixel"),
        (&["--density-cache", "-3"], "-3"),
    ] {
        let run = render(more);
        assert_eq!(run.status, Some(2), "{more:?}: {}", run.stderr);
        assert!(run.stderr.contains(possible) && !run.stderr.contains("panicked"), "{more:?}: {}", run.stderr);
    }
    assert!(!folder.path().join("x.exr").exists());
    let run = render(&["--density-cache", "8", "--sub-pixels", "1", "--shadow-cells", "4"]);
    run.succeeds("a cache of 8 cells");
    assert!(
        run.stdout.starts_with("density cache 9 x 9 x ") && run.stdout.contains("f16, trilinear"),
        "{}",
        run.stdout
    );
}

/// The committed homogeneous cube, 8 x 8 pixels, with a world of radiance 1, and a change.
fn cube(change: impl Fn(&mut Json)) -> Json {
    let text = std::fs::read_to_string(support::project("parity/scenes/cube-multiple-scattering.scene.json"));
    let mut scene: Json = serde_json::from_str(&text.expect("the committed scene")).expect("it is JSON");
    scene["film"]["resolution"] = json!([8, 8]);
    scene["world"] = json!({"color": [1.0, 1.0, 1.0], "strength": 1.0});
    change(&mut scene);
    scene
}

/// Sets an input of the cube's Principled Volume.
fn principled(scene: &mut Json, input: &str, value: Json) {
    let nodes = scene["graph"]["nodes"].as_array_mut().expect("a list of nodes");
    let closure = nodes.iter_mut().find(|node| node["type"] == "ShaderNodeVolumePrincipled").expect("the closure");
    closure["inputs"][input] = value;
}

/// The pixels of a scene by each integrator.
#[track_caller]
fn pictures(what: &str, scene: &Json) -> [cloudparity::scene::image::Image; 2] {
    let folder = folder();
    write(&folder, "x.scene.json", &scene.to_string());
    [vec!["path", "--samples", "16"], vec!["march", "--volume-bounces", "0", "--shadow-cells", "8"]].map(|settings| {
        let arguments = [vec!["render", "x.scene.json", "-o", "x.exr", "--integrator"], settings].concat();
        run(folder.path(), &arguments).succeeds(what);
        let image = cloudparity::scene::image::Image::read_exr(&folder.path().join("x.exr")).expect("a picture");
        image.check_finite(what).expect("finite pixels");
        image
    })
}

#[test]
fn pictures_without_a_medium_show_the_world() {
    // Both integrators add numbers whose exact sum is 1.
    let only_world = |what: &str, scene: &Json| {
        for image in pictures(what, scene) {
            assert!(image.pixels.iter().flatten().all(|value| (value - 1.0).abs() < 1e-6), "{what}");
        }
    };
    only_world("zero density", &cube(|scene| principled(scene, "Density", json!(0.0))));
    only_world("below zero", &cube(|scene| principled(scene, "Density", json!(-1.0))));
    let outside = |scene: &mut Json| scene["volume"]["matrix_world"][2][3] = json!(50.0);
    only_world("outside of the frame", &cube(outside));
}

#[test]
fn extreme_media_and_cameras_give_finite_pictures() {
    let on_a_face = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]]);
    let on_an_edge = json!([[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]]);
    for (what, matrix) in [("camera on a face", on_a_face), ("camera on an edge", on_an_edge)] {
        pictures(what, &cube(|scene| scene["camera"]["matrix_world"] = matrix.clone()));
    }
    for anisotropy in [1.0, -1.0, 2.0, -2.0, 0.999_999] {
        let scene = cube(|scene| principled(scene, "Anisotropy", json!(anisotropy)));
        pictures(&format!("anisotropy {anisotropy}"), &scene);
    }
    for density in [1e-30, 1e8, 1e30] {
        pictures(&format!("density {density:e}"), &cube(|scene| principled(scene, "Density", json!(density))));
    }
    // More light than arrives: as bright as four events can make it, and no brighter.
    let bright = cube(|scene| principled(scene, "Color", json!([1.5, 1.0, 2.0, 1.0])));
    for image in pictures("albedo above 1", &bright) {
        assert!(image.pixels.iter().flatten().all(|value| *value < 100.0));
    }
}

#[test]
fn pictures_of_no_size_or_too_large_a_size() {
    let folder = folder();
    for (size, percentage, parts) in [
        (json!([0, 72]), 100, vec!["$.film.resolution", "0 x 72"]),
        (json!([3, 3]), 1, vec!["$.film.resolution", "0 x 0"]),
        (json!([2_000_000, 9]), 100, vec!["$.film.resolution", "16384"]),
    ] {
        let scene = cube(|scene| {
            scene["film"]["resolution"] = size.clone();
            scene["film"]["resolution_percentage"] = json!(percentage);
        });
        write(&folder, "x.scene.json", &scene.to_string());
        for integrator in ["path", "march"] {
            let arguments = ["render", "x.scene.json", "-o", "x.exr", "--integrator", integrator];
            run(folder.path(), &arguments).is_refused(integrator, &parts);
        }
    }
    assert!(!folder.path().join("x.exr").exists());
}

#[test]
fn convergence_of_what_cannot_converge() {
    let folder = folder();
    write(&folder, "x.scene.json", &cloud().to_string());
    let measured = |more: &[&str]| {
        let begin = ["convergence", "x.scene.json", "-o", "out", "--volume-bounces", "0", "--resolution", "2x2"];
        run(folder.path(), &[&begin, more].concat())
    };
    for (more, parts) in [
        (&["--steps-per-side", "4,8,16"][..], &["steps", "[4, 8, 16]", "at least four rising"][..]),
        (&["--steps-per-side", "4,8,8,16"], &["steps", "rising"]),
        (&["--steps-per-side", "0,1,2,3"], &["steps", "from 1 to"]),
        (&["--steps-per-side", "1,2,3,4294967295"], &["steps", "from 1 to 262144"]),
        (&["--cache-cells", "0,8"], &["cache_cells", "at least 1"]),
        (&["--view-step", "0.1"], &["--view-step", "varies by itself", "Leave --view-step out"]),
        (&["--integration", "plain"], &["--integration", "--steps-per-side"]),
        (&["--volume-bounces", "3", "--steps-per-side", "1,2,3,4"], &["cannot be used multiple times"]),
    ] {
        let run = measured(more);
        if parts == ["cannot be used multiple times"] {
            assert!(run.status == Some(2) && run.stderr.contains(parts[0]), "{}", run.stderr);
        } else {
            run.is_refused(&format!("{more:?}"), parts);
        }
    }
    assert!(!folder.path().join("out").exists());
}

#[test]
fn without_an_adapter_the_cpu_serves() {
    let folder = folder();
    write(&folder, "x.scene.json", &cloud().to_string());
    save_points(&folder, "p.npy", &[[0.1, 0.2, 0.3]]);
    let no_driver = [("VK_ICD_FILENAMES", "/nonexistent"), ("VK_DRIVER_FILES", "/nonexistent")];
    for environment in [&no_driver[..], &[("WGPU_ADAPTER_NAME", "no adapter has this name")]] {
        let evaluate = |evaluator: &str| {
            let arguments = ["eval", "x.scene.json", "--points", "p.npy", "-o", "v.npy", "--backend", evaluator];
            run_with(folder.path(), &arguments, environment)
        };
        evaluate("gpu").is_refused("gpu", &["graphics adapter", "no adapter", "mesa-vulkan-drivers", "CPU evaluator"]);
        assert!(!folder.path().join("v.npy").exists());
        evaluate("cpu").succeeds("cpu");
        std::fs::remove_file(folder.path().join("v.npy")).expect("the CPU wrote its values");
    }
}

#[test]
fn without_blender_it_says_so() {
    let folder = folder();
    write(&folder, "x.scene.json", &cloud().to_string());
    write(&folder, "x.blend", "no Blender file");
    let python = |path: &str, arguments: &[&str]| run_with(folder.path(), arguments, &[("CLOUDPARITY_PYTHON", path)]);
    for arguments in [&["export", "x.blend", "-o", "y.scene.json"], &["export", "x.scene.json", "-o", "y.blend"]] {
        python("/nonexistent/python", arguments)
            .is_refused("no interpreter", &["interpreter /nonexistent/python", "No such file", "CLOUDPARITY_PYTHON"]);
        if Path::new("/bin/false").exists() {
            python("/bin/false", arguments).is_refused("no Python", &["left without an answer", "exit status: 1"]);
            // Output that is no protocol, without end and not even text.
            python("/bin/cat", arguments).is_refused("no Python", &["without an answer"]);
        }
        // -S leaves out the packages of the interpreter, bpy among them.
        let bare = folder.path().join("bare-python");
        std::fs::write(&bare, "#!/bin/sh\nexec python3 -S -E \"$@\"\n").expect("a temporary file");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            std::fs::set_permissions(&bare, std::fs::Permissions::from_mode(0o755)).expect("a mode");
            let run = python(&bare.display().to_string(), arguments);
            run.is_refused("no bpy", &["bpy cannot be imported", "bpy==5.0.1"]);
        }
        assert!(!folder.path().join("y.scene.json").exists() && !folder.path().join("y.blend").exists());
    }
}

/// Runs Python code with bpy; false where there is no bpy.
fn in_blender(code: &str) -> bool {
    if !support::require("bpy") {
        return false;
    }
    let output = std::process::Command::new(cloudparity::bridge::interpreter()).args(["-c", code]).output();
    let output = output.expect("the interpreter starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    true
}

#[test]
fn blend_files_that_hold_no_volume() {
    let folder = folder();
    let save = |name: &str, change: &str| {
        let path = folder.path().join(name).display().to_string();
        in_blender(&format!("import bpy\n{change}\nbpy.ops.wm.save_as_mainfile(filepath={path:?})"))
    };
    // The start-up file has a cube with a surface material.
    if !save("surface.blend", "") {
        return;
    }
    let export = |arguments: &[&str]| run(folder.path(), &[&["export"], arguments, &["-o", "x.scene.json"]].concat());
    export(&["surface.blend"]).is_refused("surface", &["surface.blend", "volume"]);
    export(&["surface.blend", "--object", "Nobody"]).is_refused("object", &["Nobody"]);
    save("empty.blend", "bpy.ops.wm.read_factory_settings(use_empty=True)");
    export(&["empty.blend"])
        .is_refused("empty", &["empty.blend", "no volume that renders", "no material whose Volume is linked"]);
    export(&["none.blend"]).is_refused("missing", &["none.blend"]);
    write(&folder, "text.blend", "no Blender file");
    export(&["text.blend"]).is_refused("text", &["text.blend"]);
    let whole = std::fs::read(folder.path().join("surface.blend")).expect("a file");
    std::fs::write(folder.path().join("cut.blend"), &whole[..whole.len() / 2]).expect("a temporary file");
    export(&["cut.blend"]).is_refused("cut", &["cut.blend"]);
    let volume = "m = bpy.data.materials['Material']; t = m.node_tree\n\
                  n = t.nodes.new('ShaderNodeVolumePrincipled')\n\
                  t.links.new(n.outputs[0], t.nodes['Material Output'].inputs['Volume'])\n\
                  k = t.nodes.new('ShaderNodeLightPath')\n\
                  t.links.new(k.outputs['Ray Length'], n.inputs['Density'])";
    save("ray.blend", volume);
    export(&["ray.blend"]).is_refused("unsupported node", &["node Light Path", "ShaderNodeLightPath"]);
    export(&["ray.blend", "--frame", "-3"]).is_refused("frame", &["ray.blend", "found -3", "1 to 250"]);
    let picture = "m = bpy.data.materials['Material']; t = m.node_tree\n\
                   n = t.nodes.new('ShaderNodeVolumePrincipled')\n\
                   t.links.new(n.outputs[0], t.nodes['Material Output'].inputs['Volume'])\n\
                   k = t.nodes.new('ShaderNodeTexImage'); k.image = bpy.data.images.new('p', 4, 4)\n\
                   t.links.new(k.outputs['Color'], n.inputs['Density'])";
    save("picture.blend", picture);
    // The node cannot even be written to a scene file; the way out is that of the table of refused nodes.
    let image = cloudparity::nodes::refused::find("ShaderNodeTexImage").expect("a refused node");
    export(&["picture.blend"]).is_refused("picture", &["picture.blend", "Image Texture", image.reason, image.instead]);
    assert!(!folder.path().join("x.scene.json").exists());
}

#[cfg(unix)]
#[test]
fn a_pipe_a_device_or_a_socket_as_an_input_is_rejected_and_not_waited_for() {
    let folder = folder();
    write(&folder, "x.scene.json", &cloud().to_string());
    save_points(&folder, "p.npy", &[[0.0; 3]]);
    let _socket = std::os::unix::net::UnixListener::bind(folder.path().join("socket")).expect("a socket");
    let fifo = |name: &str| std::process::Command::new("mkfifo").arg(folder.path().join(name)).status();
    for name in ["pipe", "pipe.scene.json", "pipe.npy", "pipe.preset.json", "pipe.study.toml", "pipe.exr", "pipe.blend"]
    {
        assert!(fifo(name).is_ok_and(|status| status.success()));
    }
    std::fs::create_dir(folder.path().join("folder.npy")).expect("a folder");
    let commands: &[(&[&str], &str)] = &[
        (&["explain", "pipe"], "a pipe"),
        (&["explain", "pipe.scene.json"], "a pipe"),
        (&["explain", "socket"], "a socket"),
        (&["explain", "/dev/zero"], "a device"),
        (&["init", "pipe.scene.json"], "a pipe"),
        (&["export", "pipe.blend", "-o", "o.scene.json"], "a pipe"),
        (&["eval", "x.scene.json", "--points", "pipe.npy", "-o", "v.npy"], "a pipe"),
        (&["eval", "x.scene.json", "--points", "folder.npy", "-o", "v.npy"], "a folder"),
        (&["render", "x.scene.json", "--preset", "pipe.preset.json", "-o", "o.exr"], "a pipe"),
        (&["study", "pipe.study.toml", "-o", "out"], "a pipe"),
        (&["publish", "x.scene.json", "--truth", "pipe.exr", "-o", "out"], "a pipe"),
        (&["parity", "pipe", "-o", "out"], "a pipe"),
        (&["bench-quick", "x.scene.json", "--baseline", "pipe"], "a pipe"),
    ];
    for (arguments, found) in commands {
        run(folder.path(), arguments).is_refused(&arguments.join(" "), &[found]);
    }
    let mut scene = cloud();
    scene["graph"] = json!({"file": "pipe"});
    write(&folder, "g.scene.json", &scene.to_string());
    run(folder.path(), &["explain", "g.scene.json"]).is_refused("a graph", &["pipe", "a pipe"]);
    scene = cloud();
    scene["world"]["image"] = json!({"file": "pipe.exr", "sha256": "0".repeat(64)});
    write(&folder, "w.scene.json", &scene.to_string());
    run(folder.path(), &["explain", "w.scene.json"]).is_refused("a picture", &["pipe.exr", "a pipe"]);
}

#[test]
fn a_repeated_key_is_rejected_with_its_place() {
    let folder = folder();
    let text = serde_json::to_string_pretty(&cloud()).expect("JSON");
    let (head, tail) = text.split_once("\n  \"film\"").expect("a film");
    write(&folder, "x.scene.json", &format!("{head}\n  \"name\": \"other\",\n  \"film\"{tail}"));
    let line = format!("x.scene.json: line {}", head.lines().count() + 1);
    run(folder.path(), &["explain", "x.scene.json"]).is_refused("a key", &[&line, "repeated key, \"name\"", "once"]);
    let preset = std::fs::read_to_string(support::project("parity/presets/clouds.preset.json")).expect("a preset");
    let key = "\"format\":";
    write(&folder, "x.preset.json", &preset.replacen(key, "\"build\": null, \"build\": null, \"format\":", 1));
    write(&folder, "y.scene.json", &cloud().to_string());
    let arguments = ["render", "y.scene.json", "--preset", "x.preset.json", "-o", "o.exr"];
    run(folder.path(), &arguments).is_refused("a preset", &["x.preset.json, line", "repeated key, \"build\""]);
    let study = std::fs::read_to_string(support::project("parity/studies/small.study.toml")).expect("a study");
    let first = study.lines().find(|line| line.contains(" = ") && !line.starts_with('#')).expect("a key");
    write(&folder, "x.study.toml", &study.replacen(first, &format!("{first}\n{first}"), 1));
    run(folder.path(), &["study", "x.study.toml", "-o", "out"]).is_refused("a study", &["line", "duplicate key"]);
}

#[test]
fn a_byte_order_mark_is_read_over() {
    let folder = folder();
    write(&folder, "x.scene.json", &format!("\u{feff}{}", cloud()));
    write(&folder, "y.scene.json", &cloud().to_string());
    let marked = run(folder.path(), &["explain", "x.scene.json"]);
    marked.succeeds("a mark");
    assert_eq!(marked.stdout, run(folder.path(), &["explain", "y.scene.json"]).stdout);
    write(&folder, "x.scene.json", &format!("\u{feff}\u{feff}{}", cloud()));
    run(folder.path(), &["explain", "x.scene.json"]).is_refused("two marks", &["line 1"]);
    let study = std::fs::read_to_string(support::project("parity/studies/small.study.toml")).expect("a study");
    write(&folder, "x.study.toml", &format!("\u{feff}{study}x"));
    run(folder.path(), &["study", "x.study.toml", "-o", "out"]).is_refused("its text is read", &["x.study.toml, line"]);
}

#[cfg(unix)]
#[test]
fn a_name_with_a_line_break_is_escaped_in_messages() {
    let folder = folder();
    write(&folder, "a\nb.scene.json", "{");
    let run_of = |arguments: &[&str]| run(folder.path(), arguments);
    let broken = run_of(&["explain", "a\nb.scene.json"]);
    broken.is_refused("a file", &["a\\nb.scene.json"]);
    assert_eq!(broken.stderr.trim_end().lines().count(), 1, "{}", broken.stderr);
    let no_such = run_of(&["explain", "c\x1b[31m\nd.scene.json"]);
    no_such.is_refused("no file", &["c\\u{1b}[31m\\nd.scene.json"]);
    assert!(!no_such.stderr.contains('\x1b'));
    let mut scene = one_math(json!({"Value": 1.0}));
    scene["graph"]["nodes"][2]["name"] = "Ma\nth".into();
    write(&folder, "x.scene.json", &scene.to_string());
    let dangling = run_of(&["explain", "x.scene.json"]);
    dangling.is_refused("a node", &[]);
    assert_eq!(dangling.stderr.trim_end().lines().count(), 1, "{}", dangling.stderr);
}

#[cfg(unix)]
#[test]
fn what_a_killed_probe_left_is_removed_by_the_next_run() {
    if !support::require("bpy") {
        return;
    }
    let folder = folder();
    write(&folder, "x.scene.json", &cloud().to_string());
    let temporary = folder.path().join("tmp");
    std::fs::create_dir(&temporary).expect("a folder");
    let left = || -> Vec<String> {
        let entries = std::fs::read_dir(&temporary).expect("a folder");
        entries.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned()).collect()
    };
    let mut probe = std::process::Command::new(env!("CARGO_BIN_EXE_cloudparity"))
        .current_dir(folder.path())
        .env("TMPDIR", &temporary)
        .args(["probe", "x.scene.json", "--points", "1000"])
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .expect("the program starts");
    let begin = std::time::Instant::now();
    while left().len() < 2 && begin.elapsed().as_secs() < 60 {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    probe.kill().expect("it is killed");
    probe.wait().expect("it has ended");
    assert!(!left().is_empty(), "a probe keeps its points in a temporary folder");
    std::fs::create_dir(temporary.join("cloudparity-of-another-kind")).expect("a folder");
    let environment = [("TMPDIR", temporary.to_str().expect("UTF-8"))];
    run_with(
        folder.path(),
        &["render", "x.scene.json", "--resolution", "2x2", "--integrator", "march", "-o", "o.png"],
        &environment,
    )
    .succeeds("a picture that needs a temporary folder");
    assert_eq!(left(), ["cloudparity-of-another-kind"]);
}
