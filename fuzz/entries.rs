//! What fuzzing feeds: for every kind of file that people hand on, bytes are written to such a file, read as the program reads it, and a
//! valid one is put to its first use, within bounds. The fuzz targets and `tests/fuzz_corpus.rs` share this text.
//!
//! Each entry gives the error of bad input; a panic, ten seconds or two gibibytes are defects of the library.

use cloudparity::base::error::{Error, Result};
use cloudparity::base::files;
use cloudparity::base::identity::Resume;
use cloudparity::base::ledger::{Ledger, Purpose, Sharing};
use cloudparity::graph::evaluate::{Arithmetic, Points};
use cloudparity::graph::{Program, Target};
use cloudparity::measure::combination::Combination;
use cloudparity::measure::study::{self, Measured, Study};
use cloudparity::measure::truth::TruthRecord;
use cloudparity::measure::tuning::file::TuningFile;
use cloudparity::measure::tuning::preset::{self, Preset};
use cloudparity::measure::tuning::{Scored, Tuning, TuningResults};
use cloudparity::media::objects::Media;
use cloudparity::report::write_report;
use cloudparity::scene::{Scene, matrix_to_glam};
use cloudparity::view::camera::Camera;
use cloudparity::view::{lights, sampled_lights};
use glam::{DVec2, DVec3};
use indexmap::IndexMap;
use serde_json::Value as Json;
use std::path::{Component, Path};
use std::sync::LazyLock;

/// Seconds that an input may take.
pub const MOST_SECONDS: u64 = 10;

/// Bytes of memory that an input may take.
pub const MOST_BYTES: u64 = 2 << 30;

/// Reads bytes as one kind of file, in a folder of its own.
pub type Entry = fn(&[u8], &Path) -> Result<()>;

/// The entries by the names of their fuzz targets.
pub const ENTRIES: [(&str, Entry); 7] = [
    ("npy", npy),
    ("tuning", tuning),
    ("study", study),
    ("preset", preset),
    ("records", records),
    ("graph", graph),
    ("scene", scene),
];

/// What an error of the library has to say: all of its four parts.
pub fn check_error(error: &Error) {
    for (part, text) in
        [("place", &error.place), ("found", &error.found), ("expected", &error.expected), ("remedy", &error.remedy)]
    {
        assert!(!text.trim().is_empty(), "an error without {part}: {error}");
    }
}

/// The scene that graphs, presets and points are tried in, and the one that studies name.
const RAMP: &str = include_str!("../parity/scenes/linear-ramp.scene.json");
const CUBE: &str = include_str!("../parity/scenes/homogeneous-cube.scene.json");

static RAMP_SCENE: LazyLock<Scene> = LazyLock::new(|| {
    let document = serde_json::from_str(RAMP).expect("the committed scene is JSON");
    Scene::from_value(document, "the ramp").expect("the committed scene is valid")
});

static RAMP_DENSITY: LazyLock<Program> =
    LazyLock::new(|| Program::density(&RAMP_SCENE).expect("the committed scene has a density"));

/// Places of an object's frame: inside, on faces, far out.
const PLACES: [[f32; 3]; 8] = [
    [0.0, 0.0, 0.0],
    [0.25, -0.5, 0.75],
    [-1.0, 1.0, -1.0],
    [0.1, 0.2, 0.3],
    [1.5, -2.5, 3.5],
    [-0.7, 0.9, 0.05],
    [1e4, -1e4, 1e4],
    [-3e8, 3e8, 1e-30],
];

fn write(path: &Path, bytes: &[u8]) {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).expect("the folder of the input can be made");
    }
    std::fs::write(path, bytes).expect("the input can be written");
}

/// The first error of several tries, all of which are made.
fn all<const N: usize>(tries: [Result<()>; N]) -> Result<()> {
    tries.into_iter().collect()
}

fn scene(bytes: &[u8], folder: &Path) -> Result<()> {
    let path = folder.join("input.scene.json");
    write(&path, bytes);
    use_scene(&Scene::load(&path)?)
}

fn graph(bytes: &[u8], folder: &Path) -> Result<()> {
    static AROUND: LazyLock<String> = LazyLock::new(|| {
        let mut document: Json = serde_json::from_str(RAMP).expect("the committed scene is JSON");
        document["graph"] = serde_json::json!({"file": "input.graph.json"});
        document.to_string()
    });
    write(&folder.join("input.graph.json"), bytes);
    let path = folder.join("graph.scene.json");
    if !path.exists() {
        write(&path, AROUND.as_bytes());
    }
    use_scene(&Scene::load(&path)?)
}

/// What every command does with a scene before it renders: camera, lights, names of values, the density, the medium, at a few places.
fn use_scene(scene: &Scene) -> Result<()> {
    let _ = (scene.content_hash(), scene.settable());
    all([use_view(scene), use_density(scene), use_media(scene), use_outputs(scene)])
}

fn use_view(scene: &Scene) -> Result<()> {
    let size = scene.image_size();
    let camera = Camera::new(scene, size)?;
    for raster in [DVec2::ZERO, DVec2::new(f64::from(size[0]) / 2.0, 0.3), DVec2::from(size.map(f64::from))] {
        let _ = (camera.ray(raster), camera.device_coordinates(DVec3::new(0.1, 0.2, 0.3)));
    }
    for light in lights::delta_lights(scene)? {
        let _ = light.arriving(DVec3::new(0.3, 0.2, 0.1));
    }
    for light in sampled_lights::sampled_lights(scene)? {
        let place = DVec3::new(0.3, 0.2, 0.1);
        let _ = (light.importance(place), light.sample(place, [0.25, 0.75]), light.hit(place, DVec3::Z));
    }
    Ok(())
}

fn use_program(program: &Program, scene: &Scene) -> Result<()> {
    let attributes: Vec<(String, Vec<[f32; 3]>)> =
        program.attributes.iter().map(|name| (name.clone(), PLACES.to_vec())).collect();
    let points = Points { positions: &PLACES, attributes: &attributes };
    for arithmetic in [Arithmetic::Single, Arithmetic::Oracle, Arithmetic::Unrounded] {
        program.evaluate(points, arithmetic)?;
    }
    let bounds = &scene.volume.bounds;
    program.bounds(bounds.min, bounds.max).map(drop)
}

fn use_density(scene: &Scene) -> Result<()> {
    use_program(&Program::density(scene)?, scene)
}

/// The first outputs of the graph's nodes, each of which can be asked for by its name.
fn use_outputs(scene: &Scene) -> Result<()> {
    let graph = scene.graph();
    for node in graph.nodes.iter().take(4) {
        let Some(node_type) = cloudparity::nodes::find(&node.kind) else { continue };
        for output in node_type.outputs.iter().take(2) {
            let name = format!("/{}.{}", node.name, output.identifier);
            let target = Target::parse(&name, graph)?;
            use_program(&Program::compile(scene, &[target])?, scene)?;
        }
    }
    Ok(())
}

fn use_media(scene: &Scene) -> Result<()> {
    let media = Media::new(scene)?;
    let to_world = matrix_to_glam(&scene.volume.matrix_world);
    let places = PLACES.map(|place| to_world.transform_point3(DVec3::from(place.map(f64::from))));
    media.evaluate(&places).map(drop)
}

/// Lays the committed scenes where the study and tuning files look for them, and the input beside.
fn write_beside_scenes(bytes: &[u8], folder: &Path, name: &str) -> std::path::PathBuf {
    for (stem, text) in [("linear-ramp", RAMP), ("homogeneous-cube", CUBE)] {
        let path = folder.join(format!("scenes/{stem}.scene.json"));
        if !path.exists() {
            write(&path, text.as_bytes());
        }
    }
    let path = folder.join("studies").join(name);
    write(&path, bytes);
    path
}

fn study(bytes: &[u8], folder: &Path) -> Result<()> {
    let study = Study::load(&write_beside_scenes(bytes, folder, "input.study.toml"))?;
    for combination in study.wanted.iter().take(4) {
        let _ = (combination.describe(), combination.picture_settings());
    }
    match study.wanted.iter().find(|combination| is_cheap(combination)) {
        Some(combination) => use_engine(combination.engine(&RAMP_SCENE, &[])),
        None => Ok(()),
    }
}

/// Whether an engine of these settings bakes no texture and no cache: what takes seconds by design.
fn is_cheap(combination: &Combination) -> bool {
    let is_graph = combination.density.split_whitespace().next() == Some("graph");
    is_graph && combination.cache.cells == 0 && !combination.density.contains("cache_cells")
}

fn use_engine(engine: Result<cloudparity::engines::Engine>) -> Result<()> {
    engine?.density.values(&PLACES).map(drop)
}

fn tuning(bytes: &[u8], folder: &Path) -> Result<()> {
    let path = write_beside_scenes(bytes, folder, "input.tune.toml");
    let file = TuningFile::load(&path)?;
    let mut parameters = file.fixed.clone();
    for (name, searched) in &file.parameters {
        let begin = searched.value(searched.begin());
        let [low, high] = searched.range;
        assert!((low..=high).contains(&begin), "{name} begins at {begin}, outside of {low} to {high}");
        let _ = (searched.value(0.3), searched.value(-1.0), searched.value(2.0));
        parameters.insert(name.clone(), begin);
    }
    let start = Preset {
        format: preset::FORMAT.into(),
        builds: Vec::new(),
        title: file.title.clone(),
        engine: file.engine.clone(),
        parameters,
        provenance: Json::Null,
    };
    all([Tuning::load(&path).map(drop), use_preset(&start)])
}

fn preset(bytes: &[u8], folder: &Path) -> Result<()> {
    let path = folder.join("input.preset.json");
    write(&path, bytes);
    use_preset(&Preset::load(&path)?)
}

fn use_preset(preset: &Preset) -> Result<()> {
    if !is_cheap(&preset.engine.combination("ramp")) || preset.parameters.contains_key("density.cache_cells") {
        return Ok(());
    }
    use_engine(preset.build(&RAMP_SCENE).map(|(_, engine, _)| engine))
}

fn npy(bytes: &[u8], folder: &Path) -> Result<()> {
    let path = folder.join("input.npy");
    write(&path, bytes);
    let values = files::read_values(&path).map(drop);
    let points = files::read_points(&path).and_then(|points| {
        let some = &points[..points.len().min(64)];
        for arithmetic in [Arithmetic::Single, Arithmetic::Oracle, Arithmetic::Unrounded] {
            RAMP_DENSITY.evaluate(Points::new(some), arithmetic)?;
        }
        Ok(())
    });
    all([points, values])
}

/// The folder of a run as one document, from file names to their contents: `{"results.json": {}, "runs/key.json": {}}`.
fn records(bytes: &[u8], folder: &Path) -> Result<()> {
    let folder = &folder.join("run");
    let _ = std::fs::remove_dir_all(folder);
    let parsed: std::result::Result<IndexMap<String, Json>, _> = serde_json::from_slice(bytes);
    match parsed {
        Ok(contents) => {
            for (name, content) in contents.iter().filter(|(name, _)| is_plain(name)) {
                match content {
                    Json::String(text) => write(&folder.join(name), text.as_bytes()),
                    _ => write(&folder.join(name), content.to_string().as_bytes()),
                }
            }
            std::fs::create_dir_all(folder).expect("the folder of the input can be made");
        }
        Err(_) => write(&folder.join("results.json"), bytes),
    }
    all([use_ledger(folder), use_results(folder), use_tuning_results(folder), write_report(folder, &[]).map(drop)])
}

/// Whether a name stays in the folder, and is not one of two that exclude each other there (a file and a folder).
fn is_plain(name: &str) -> bool {
    let path = Path::new(name);
    let known = |text: &str| text.is_ascii() && !text.contains('\0') && text.len() < 64;
    let parts: Vec<Component<'_>> = path.components().collect();
    let is_file = |part: &Component<'_>| part.as_os_str().to_string_lossy().contains('.');
    known(name)
        && matches!(parts.len(), 1 | 2)
        && parts.iter().all(|part| matches!(part, Component::Normal(_)))
        && is_file(&parts[parts.len() - 1])
        && (parts.len() == 1 || !is_file(&parts[0]))
        && !name.ends_with('/')
}

fn use_ledger(folder: &Path) -> Result<()> {
    let purpose = Purpose { mark: "study.json", format: study::FORMAT, of: Json::Null };
    let _ = (purpose.builds(folder)?, study::is_of_another_build(folder)?);
    let ledger = Ledger::open(folder, purpose, &Resume::mixing(), Sharing::Alone)?;
    let truth = ledger.find::<TruthRecord>("truth", "key").map(drop);
    let run = ledger.find::<Measured>("runs", "key").map(|found| {
        if let Some(cloudparity::base::ledger::Found::Record(run)) = found {
            let _ = run.describe();
        }
    });
    let maker = ledger.maker("runs", "key").map(drop);
    let _ = ledger.builds();
    all([truth, run, maker])
}

fn use_results(folder: &Path) -> Result<()> {
    if !folder.join("results.json").exists() {
        return Ok(());
    }
    let results = study::Results::load(folder)?;
    let _ = (results.groups(), results.csv());
    for run in &results.runs {
        let _ = run.describe();
    }
    Ok(())
}

fn use_tuning_results(folder: &Path) -> Result<()> {
    if let Some(results) = TuningResults::load(folder)? {
        let _ = (results.improvement(), Preset::of(&results), Scored::mean_relmse(&results.tuned.held_out));
    }
    Ok(())
}
