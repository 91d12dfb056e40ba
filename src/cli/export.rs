//! `cloudparity export`: a .blend as a scene file, a scene file as a .blend, a picture as a PNG.

use crate::base::destination::Destination;
use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::kinds::{self, FileKind};
use crate::base::temporary;
use crate::bridge;
use crate::bridge::CyclesKernel;
use crate::bridge::releases::Reading;
use crate::cli::choice::choice;
use crate::cli::display::DisplayArguments;
use crate::cli::{build, display};
use crate::engines;
use crate::engines::defects::Defects;
use crate::engines::parameters::Values;
use crate::graph::closures::ClosureSum;
use crate::graph::world::{self, WorldValues};
use crate::measure::nodes::folded_textures;
use crate::nodes::refused;
use crate::scene::{Graph, Node, Release, Scene, Shape};
use serde_json::{Value as Json, json};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// What of a .blend is read.
#[derive(Clone, clap::Args)]
pub(super) struct Wish {
    /// Of a .blend: an object with a volume material, repeatable; without it all that render are exported.
    #[arg(long, value_name = "NAME", conflicts_with = "material")]
    object: Vec<String>,
    /// The frame of the .blend to read it at, one of its scene's; without it the file's current one.
    #[arg(long, value_name = "FRAME", allow_negative_numbers = true)]
    pub(super) frame: Option<i32>,
    /// Of a .blend: the camera to look through; without it the active one, or one of ours that frames all volumes.
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Of a .blend: show this material on a cube of 2 m, in place of the objects: for libraries of materials.
    #[arg(long, value_name = "NAME")]
    material: Option<String>,
    /// Of a .blend: show volumes, too, that are hidden in renders or in hidden collections.
    #[arg(long)]
    include_hidden: bool,
    /// Of a .blend: the release of Blender whose values the nodes get; without it 5.0 for files of 5.0 and older, and the release
    /// that saved it for others. It is read by a release that is not older than either.
    #[arg(long, value_name = "RELEASE", value_parser = choice::<Release>())]
    blender: Option<Release>,
    /// Of a .blend: a world that is no colour and no picture as its nodes, where all of them are supported, or as a picture of them.
    #[arg(long, value_name = "FORM", value_enum, default_value_t = AroundAs::Nodes)]
    world: AroundAs,
}

/// Convert a file: a .blend to a scene file, a scene file to a .blend, an EXR to a PNG, a published cloud to a scene file.
///
/// Of a .blend: its volumes, camera, film, lights, world and node graphs; scripts in it never run. A scene file becomes a .blend that
/// exports to the same bytes. Of a picture: a PNG through Blender's own colour management, equal to the one that Blender saves
/// without dither. With --model, a published system's cloud takes the place of the scene's material: as nodes, which Cycles renders. With
/// --sky, a published sky takes the place of its world: as a picture that engines, path tracing and Cycles see alike.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  cloudparity export CLOUD.blend -o CLOUD.scene.json
  cloudparity export CLOUD.blend --blender 4.5 -o CLOUD-OF-4.5.scene.json
  cloudparity export MATERIALS.blend --material Nebula -o NEBULA.scene.json
  cloudparity export CLOUD.scene.json -o CLOUD.blend
  cloudparity export CLOUD.scene.json --model bolt -o BOLT.scene.json
  cloudparity export CLOUD.scene.json --sky bolt --sun-elevation 5 -o DUSK.scene.json
  cloudparity export CLOUD.exr -o CLOUD.png --view Filmic")]
pub(super) struct Arguments {
    /// The .blend, the scene file (*.scene.json), or the scene-linear EXR; several pictures are averaged.
    #[arg(required = true, num_args = 1.., value_name = "FILE")]
    inputs: Vec<PathBuf>,
    #[command(flatten)]
    wish: Wish,
    /// The file to write.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Of a scene file: a cloud system whose density is a node graph, in place of the scene's material.
    #[arg(
        long,
        value_name = "MODEL",
        conflicts_with_all = ["object", "frame", "camera", "material", "include_hidden", "view", "look", "exposure", "gamma", "background", "rgb", "part"]
    )]
    model: Option<String>,
    /// Value sets of the system, such as a level of quality or a genus: high,cirrus.
    #[arg(long, value_name = "LEVEL", requires = "model")]
    quality: Option<String>,
    /// A parameter of the system. May be given several times.
    #[arg(long = "parameter", value_name = "NAME=VALUE", requires = "model")]
    parameters: Vec<String>,
    /// Of a scene file: the sky of a cloud system around the scene, in place of its world, and the colour of its first sun.
    #[arg(
        long,
        value_name = "MODEL",
        conflicts_with_all = ["object", "frame", "camera", "material", "include_hidden", "view", "look", "exposure", "gamma", "background", "rgb", "part"]
    )]
    sky: Option<String>,
    /// A parameter of the sky. May be given several times.
    #[arg(long = "sky-parameter", value_name = "NAME=VALUE", requires = "sky")]
    sky_parameters: Vec<String>,
    /// Height of the sun above the horizon, in degrees; without it where the scene has it.
    #[arg(long, value_name = "DEGREES", requires = "sky", allow_negative_numbers = true)]
    sun_elevation: Option<f64>,
    #[command(flatten)]
    display: DisplayArguments,
}

/// How the world of a .blend comes into the scene file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub(super) enum AroundAs {
    /// Evaluated.
    #[default]
    Nodes,
    /// Rendered into a picture.
    Baked,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let [first, others @ ..] = arguments.inputs.as_slice() else { unreachable!("one is required") };
    let output = &arguments.output;
    let extension = output.extension().map(|extension| extension.to_string_lossy().to_lowercase());
    // What is wanted decides; each way refuses what it cannot be made of.
    let is_picture = extension.as_deref() == Some("png");
    if let (false, [second, ..]) = (is_picture, others) {
        return Err(Error::new(
            second.display().to_string(),
            "a second file",
            "one .blend or one scene file; of pictures several",
            "Convert them one by one.",
        ));
    }
    if arguments.model.is_some() || arguments.sky.is_some() {
        if extension.as_deref() != Some("json") {
            return Err(Error::new(
                output.display().to_string(),
                "a name of another file than a scene file",
                "NAME.scene.json: a cloud system or its sky becomes a scene file",
                "Name a scene file; export that to a .blend afterwards.",
            ));
        }
        let done = published(arguments, Scene::load(first)?)?;
        super::print(&format!("{}: {done}\n", output.display()))?;
        return Ok(ExitCode::SUCCESS);
    }
    if is_picture {
        let view = display::convert(&arguments.inputs, output, &arguments.display)?;
        super::print(&format!("{}: as Blender shows it ({view})\n", output.display()))?;
    } else if extension.as_deref() == Some("blend") {
        build::build(first, output)?;
        super::print(&format!("{}\n", output.display()))?;
    } else {
        let scene = export(first, &arguments.wish, output)?;
        super::print(&format!("{}: {}\n", output.display(), describe(&scene)))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The scene with a published system's cloud or sky in it, written; says what it holds.
fn published(arguments: &Arguments, mut scene: Scene) -> Result<String> {
    let output = &arguments.output;
    let mut done = Vec::new();
    if let Some(model) = &arguments.model {
        let given = (arguments.quality.as_deref(), arguments.parameters.as_slice());
        let engine = super::engine::build(&scene, model, &Defects::NONE, given, 0.0)?;
        scene = engine.scene(&scene)?;
        done.push(format!("the cloud of {model} as nodes"));
    }
    let Some(model) = &arguments.sky else {
        files::write_atomically(output, files::json(&scene).as_bytes())?;
        return Ok(done.join(", "));
    };
    if let Some(degrees) = arguments.sun_elevation.filter(|degrees| !(-90.0..=90.0).contains(degrees)) {
        return Err(Error::new("--sun-elevation", degrees.to_string(), "-90 to 90 degrees", "Correct the height."));
    }
    let Some(sky) = engines::find(model)?.sky else {
        let known: Vec<&str> =
            engines::models().iter().filter(|model| model.sky.is_some()).map(|model| model.id).collect();
        return Err(Error::new(
            format!("--sky {model}"),
            "a system without a sky",
            format!("one of {}", known.join(", ")),
            "Take another system's sky.",
        ));
    };
    let mut values = Values::defaults(sky.parameters);
    values.set_texts(sky.parameters, &arguments.sky_parameters)?;
    let written = sky.write(&scene, &values, arguments.sun_elevation, output)?;
    done.push(format!("the sky of {model}"));
    Ok(format!("{} ({})", done.join(", "), written.world.image.map(|image| image.file).unwrap_or_default()))
}

/// Reads what is wished of a .blend, and writes the scene file with what belongs beside it. An error holds all faults of the file.
pub(super) fn export(blend: &Path, wish: &Wish, output: &Path) -> Result<Scene> {
    let place = blend.display().to_string();
    kinds::want(blend, FileKind::Blend)?;
    let bar = super::progress_bar(1000);
    let blend = std::path::absolute(blend).unwrap_or_else(|_| blend.to_owned());
    let chosen = (!wish.object.is_empty()).then_some(&wish.object);
    // What has to be made for the scene, such as a picture of its world, waits here.
    let folder = temporary::folder()?;
    let reasons: serde_json::Map<_, _> =
        refused::NODES.iter().map(|node| (node.type_name.to_owned(), json!([node.reason, node.instead]))).collect();
    let world_nodes = (wish.world == AroundAs::Nodes).then(world::vocabulary);
    let request = json!({
        "blend": blend, "object": chosen, "frame": wish.frame, "camera": wish.camera, "material": wish.material,
        "include_hidden": wish.include_hidden, "folder": folder.path(), "refused": reasons,
        "world_nodes": world_nodes,
    });
    // Blender names objects and nodes; which file they are in is known here.
    let in_file = |error: Error| {
        error.map_place(|found| if found.contains(&place) { found } else { format!("{place}: {found}") })
    };
    let reading = Reading::of(&blend, wish.blender)?;
    let read = || bridge::run_script("export_scene.py", &request, CyclesKernel::Default, super::report_to(&bar));
    let mut result = reading.run(&blend, read).map_err(in_file)?;
    bar.finish_and_clear();
    let release = reading.values;
    if !release.is_default() {
        let scene = &mut result["scene"];
        scene["graph"]["blender"] = json!(release);
        let others = scene.get_mut("other_graphs").and_then(serde_json::Value::as_array_mut);
        others.into_iter().flatten().for_each(|graph| graph["blender"] = json!(release));
        if let Some(graph) = scene["world"].get_mut("graph") {
            graph["blender"] = json!(release);
        }
    }
    let mut text = serde_json::to_string_pretty(&result["scene"]).expect("JSON serialises") + "\n";
    let mut beside = Vec::new();
    for (name, source) in result["files"].as_object().into_iter().flatten() {
        let source = Path::new(source.as_str().unwrap_or_default());
        let bytes = std::fs::read(source)
            .map_err(|cause| Error::io(source, "a file that belongs beside the scene file", &cause))?;
        beside.push((name.clone(), bytes));
    }
    let mut scene = Scene::from_value(result["scene"].clone(), &place)?;
    let is_grid = |shape: &Shape| matches!(shape, Shape::Grid { .. });
    if std::iter::once(&scene.volume).chain(&scene.other_volumes).any(|volume| is_grid(&volume.shape)) {
        // Grids are read with the file that names them.
        for (name, bytes) in &beside {
            files::write_atomically(&folder.path().join(name), bytes)?;
        }
        let file = folder.path().join(output.file_name().unwrap_or_else(|| "scene.json".as_ref()));
        files::write_atomically(&file, text.as_bytes())?;
        scene = Scene::load(&file).map_err(in_file)?;
    }
    // What the evaluators do not support is said now, by node, and not when a picture is wanted.
    let compiled = scene.volumes()?.into_iter().map(|(volume, graph)| ClosureSum::compile(graph, volume));
    if let Some(faults) = Error::of_all(compiled.filter_map(Result::err)) {
        return Err(in_file(faults));
    }
    if let (Some((name, _)), Destination::Stream(_)) = (beside.first(), Destination::find(output)?) {
        return Err(Error::new(
            output.display().to_string(),
            "a device or a pipe",
            format!("a file in a folder, beside which the scene's file {name} can lie"),
            "Name a file to write.",
        ));
    }
    if let Some(graph) = &scene.world.graph
        && let Err(error) = WorldValues::compile(graph)
    {
        // A mode that only the compiler knows.
        eprintln!("warning: {}: the world is not evaluated as nodes but as a picture of them", in_file(error));
        return export(&blend, &Wish { world: AroundAs::Baked, ..wish.clone() }, output);
    }
    if folded_textures::store(&mut scene, |_| ()).map_err(in_file)? > 0 {
        write_folded(&scene, &mut result["scene"]);
        text = serde_json::to_string_pretty(&result["scene"]).expect("JSON serialises") + "\n";
    }
    for (name, bytes) in &beside {
        write_beside(bytes, &output.with_file_name(name))?;
    }
    files::write_atomically(output, text.as_bytes())?;
    scene.folder = output.parent().map_or_else(PathBuf::new, Path::to_owned);
    Ok(scene)
}

/// Puts the stored values of folded textures of a scene into the document that it was read from.
fn write_folded(scene: &Scene, document: &mut Json) {
    let put = |nodes: &[Node], entries: &mut Json| {
        for (node, entry) in nodes.iter().zip(entries.as_array_mut().into_iter().flatten()) {
            if !node.folded.is_empty() {
                entry["folded"] = json!(node.folded);
            }
        }
    };
    let write = |graph: &Graph, entry: &mut Json| {
        put(&graph.nodes, &mut entry["nodes"]);
        for (group, entry) in graph.groups.iter().zip(entry["groups"].as_array_mut().into_iter().flatten()) {
            put(&group.nodes, &mut entry["nodes"]);
        }
    };
    write(scene.graph(), &mut document["graph"]);
    if let Some(entries) = document.get_mut("other_graphs").and_then(Json::as_array_mut) {
        scene.other_graphs.iter().zip(entries).for_each(|(graph, entry)| write(graph, entry));
    }
}

/// What a scene holds, in a line.
pub(super) fn describe(scene: &Scene) -> String {
    let [width, height] = scene.image_size();
    let volumes: Vec<&str> =
        std::iter::once(&scene.volume).chain(&scene.other_volumes).map(|volume| volume.object.as_str()).collect();
    let graph = scene.graph();
    let nodes = graph.nodes.len() + graph.groups.iter().map(|group| group.nodes.len()).sum::<usize>();
    let lights = match scene.lights.len() {
        0 => "no light".to_owned(),
        1 => format!("light {}", scene.lights[0].name),
        several => format!("{several} lights"),
    };
    let world = match (&scene.world.image, scene.world.strength * scene.world.color.iter().sum::<f32>() > 0.0) {
        _ if scene.world.graph.is_some() => "a world of nodes".to_owned(),
        (Some(image), _) => format!("the world {}", image.file),
        (None, true) => "a world of one colour".to_owned(),
        (None, false) => "a black world".to_owned(),
    };
    let values = match graph.blender {
        release if release.is_default() => String::new(),
        release => format!(", the values of Blender {release}"),
    };
    format!(
        "{width} x {height} pixels, {} {}, material {} of {nodes} nodes, {lights}, {world}{values}",
        if volumes.len() == 1 { "volume" } else { "volumes" },
        volumes.join(", "),
        graph.material
    )
}

/// Puts a file of the scene beside the scene file; another one of that name is not overwritten.
fn write_beside(bytes: &[u8], target: &Path) -> Result<()> {
    files::check_input(target, "a file of the scene, or none")?;
    match std::fs::read(target) {
        Ok(there) if there == bytes => Ok(()),
        Ok(_) => Err(Error::new(
            target.display().to_string(),
            "another file of the same name as a file that belongs to the scene",
            "no such file, or the same",
            "Write the scene to another folder.",
        )),
        Err(_) => files::write_atomically(target, bytes),
    }
}
