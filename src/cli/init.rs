//! `cloudparity init`: from a .blend to a scene, a study and a tuning file, and the commands to go on.

use super::first_files;
use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::kinds::FileKind;
use crate::cli::choice::choice;
use crate::cli::export::AroundAs;
use crate::scene::{Release, Scene};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Begin with a .blend: write its scene file, a study and a tuning file that fit it, and print the commands to go on.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity init CLOUD.blend -o cloud")]
pub(super) struct Arguments {
    /// The .blend, or a scene file that is there already.
    file: PathBuf,
    /// An object with a volume material, repeatable; without it all that render are exported.
    #[arg(long, value_name = "NAME")]
    object: Vec<String>,
    /// The frame of the .blend to read it at, one of its scene's; without it the file's current one.
    #[arg(long, value_name = "FRAME", allow_negative_numbers = true)]
    frame: Option<i32>,
    /// Of a .blend: the release of Blender whose values the nodes get, for who works with an older one.
    #[arg(long, value_name = "RELEASE", value_parser = choice::<Release>(), default_value_t)]
    blender: Release,
    /// Of a .blend: a world that is no colour and no picture as its nodes, where all of them are supported, or as a picture of them.
    #[arg(long, value_name = "FORM", value_enum, default_value_t = AroundAs::Nodes)]
    world: AroundAs,
    /// The folder to write; without it one beside the .blend that is named after it.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let file = &arguments.file;
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let name = name.strip_suffix(".blend").or_else(|| name.strip_suffix(".scene.json")).unwrap_or(&name).to_owned();
    let folder = match &arguments.output {
        Some(folder) => folder.clone(),
        None => file.with_file_name(&name),
    };
    let [scene_file, study_file, tuning_file] =
        ["scene.json", "study.toml", "tune.toml"].map(|kind| folder.join(format!("{name}.{kind}")));
    let is_scene = FileKind::of(file) == Some(FileKind::Scene);
    if let (true, Some(frame)) = (is_scene, arguments.frame) {
        return Err(Error::new(
            file.display().to_string(),
            format!("a scene file, of which frame {frame} is asked for"),
            "a .blend: a scene file is of one frame",
            "Give the .blend, or leave the frame away.",
        ));
    }
    for path in [&study_file, &tuning_file].into_iter().chain((!is_scene).then_some(&scene_file)) {
        if path.exists() {
            return Err(Error::new(
                path.display().to_string(),
                "a file that is there already",
                "a new name: what was edited is not written over",
                "Take it away, or name another folder (-o).",
            ));
        }
    }
    let scene = if is_scene {
        Scene::load(file)?
    } else {
        super::export::export(
            file,
            &arguments.object,
            arguments.frame,
            arguments.blender,
            arguments.world,
            &scene_file,
        )?
    };
    // A scene that is there already stays where it is.
    let scene_file = if is_scene { file.clone() } else { scene_file };
    let from_folder = if is_scene {
        std::path::absolute(file).unwrap_or_else(|_| file.clone())
    } else {
        PathBuf::from(format!("{name}.scene.json"))
    };
    super::print(&format!("{}: {}\n", scene_file.display(), super::export::describe(&scene)))?;
    let beside = from_folder.to_string_lossy();
    let texts =
        first_files::study(&scene, &beside).and_then(|study| Ok((study, first_files::tuning(&scene, &beside)?)));
    match texts {
        Ok((study, tuning)) => {
            files::write_atomically(&study_file, study.as_bytes())?;
            files::write_atomically(&tuning_file, tuning.as_bytes())?;
            super::print(&format!(
                "{}: light models, steps and caches against path tracing, minutes\n{}: an engine's light fitted to path \
                 tracing, longer\n",
                study_file.display(),
                tuning_file.display()
            ))?;
            go_on(&scene_file, Some((&study_file, &tuning_file)), &folder)?;
        }
        Err(error) => {
            eprintln!("note: no study and no tuning file: engines cannot show this scene: {error}");
            go_on(&scene_file, None, &folder)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Prints what comes next.
fn go_on(scene: &Path, engine_files: Option<(&Path, &Path)>, folder: &Path) -> Result<()> {
    let in_folder = |name: &str| super::quoted(&folder.join(name));
    let scene = super::quoted(scene);
    let mut lines = vec![
        (format!("cloudparity render {scene} -o {}", in_folder("picture.png")), "the picture"),
        (format!("cloudparity params {scene}"), "what --set changes"),
    ];
    if let Some((study, tuning)) = engine_files {
        let [runs, tuned] = ["study", "tuning"].map(in_folder);
        lines.push((format!("cloudparity study {} -o {runs}", super::quoted(study)), "error against time"));
        lines.push((format!("cloudparity report {runs}"), "one page of it"));
        lines
            .push((format!("cloudparity tune {} -o {tuned}", super::quoted(tuning)), "a preset that looks most alike"));
    }
    let width = lines.iter().map(|(command, _)| command.chars().count()).max().unwrap_or(0);
    let text: String = lines.iter().map(|(command, what)| format!("  {command:<width$}  # {what}\n")).collect();
    super::print(&format!("\nGo on with\n{text}"))
}
