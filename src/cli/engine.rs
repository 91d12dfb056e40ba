//! `cloudparity engine`: a picture as a published cloud engine makes it.

use super::choice::choice;
use crate::base::error::{Error, Result};
use crate::base::identity;
use crate::base::identity::Identity;
use crate::cli::picture::PictureArguments;
use crate::engines;
use crate::engines::defects::Defects;
use crate::engines::light::models;
use crate::engines::render;
use crate::engines::render::{EngineJitter, EngineSettings};
use crate::engines::{Engine, parameters};
use crate::gpu::Backend;
use crate::measure::tuning::preset::Preset;
use crate::scene::Scene;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Render a published cloud engine in the box of a scene, with the scene's camera, sun and world.
#[derive(clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    picture: PictureArguments,
    /// The density model; `cloudparity models` lists them.
    #[arg(long, default_value = "perlin-fbm")]
    model: String,
    #[command(flatten)]
    defects: DefectsArgument,
    /// A level of quality of the engine.
    #[arg(long)]
    quality: Option<String>,
    /// A parameter of the model. May be given several times.
    #[arg(short, long = "parameter", value_name = "NAME=VALUE")]
    parameters: Vec<String>,
    /// A light model in the place of the engine's; `cloudparity lights` lists them.
    #[arg(long)]
    light: Option<String>,
    /// A parameter of the light model. May be given several times.
    #[arg(long = "light-parameter", value_name = "NAME=VALUE")]
    light_parameters: Vec<String>,
    /// Engine, light model, quality and parameters of a tuned preset (*.preset.json).
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with_all = ["model", "defects", "quality", "parameters", "light", "light_parameters", "seconds", "sub_pixels"]
    )]
    preset: Option<PathBuf>,
    /// Seconds of animation.
    #[arg(long, default_value_t = 0.0)]
    seconds: f64,
    /// Where in its steps a ray takes its samples.
    #[arg(long, value_parser = choice::<EngineJitter>(), default_value_t = EngineJitter::None)]
    jitter: EngineJitter,
    /// Frame of the jitter.
    #[arg(long, default_value_t = 0)]
    frame: u32,
    /// Rays per pixel and axis.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    sub_pixels: u32,
    /// Add the engine's god rays.
    #[arg(long)]
    god_rays: bool,
    /// Run on the adapter instead of all cores.
    #[arg(long)]
    gpu: bool,
    /// Write pixels that are NaN or infinite, too.
    #[arg(long)]
    allow_nonfinite: bool,
}

/// Which defects an engine keeps.
#[derive(clap::Args)]
pub(super) struct DefectsArgument {
    /// Defects of the original that are kept: all (as published), none (mended), or some, such as PF-4,PF-6; `cloudparity models` says
    /// what each is.
    #[arg(long, default_value = "none")]
    defects: String,
    /// The option that `--defects` took the place of.
    #[arg(long, hide = true)]
    variant: Option<String>,
}

impl DefectsArgument {
    /// The set, or an error with what is known.
    pub fn read(&self) -> Result<Defects> {
        if let Some(variant) = &self.variant {
            return Err(Error::new(
                "--variant",
                format!("\"{variant}\""),
                "--defects, which has taken its place",
                "Give --defects all for as-published, --defects none for fixed.",
            ));
        }
        self.defects.parse().map_err(|error| Error { place: "--defects".into(), ..error })
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = arguments.picture.load()?;
    if let Some(path) = &arguments.preset {
        let preset = preset(path)?;
        let (scene, engine, combination) = preset.build(&scene)?;
        let settings = EngineSettings {
            jitter: arguments.jitter,
            frame: arguments.frame,
            god_rays: arguments.god_rays,
            ..combination.picture_settings()
        };
        let output = &arguments.picture.output;
        return write((&scene, &engine), &settings, arguments.gpu, Some(&preset), output, arguments.allow_nonfinite);
    }
    let values = (arguments.quality.as_deref(), arguments.parameters.as_slice());
    let mut engine = build(&scene, &arguments.model, &arguments.defects.read()?, values, arguments.seconds)?;
    if let Some(light) = &arguments.light {
        models::find(light)?.apply(&mut engine.light)?;
    }
    for text in &arguments.light_parameters {
        let (name, value) = parameters::assignment(text)?;
        models::set(&mut engine.light, name, value, text)?;
    }
    let settings = EngineSettings {
        jitter: arguments.jitter,
        frame: arguments.frame,
        sub_pixels: arguments.sub_pixels,
        god_rays: arguments.god_rays,
    };
    write((&scene, &engine), &settings, arguments.gpu, None, &arguments.picture.output, arguments.allow_nonfinite)
}

/// A preset; says so where another build found it.
pub(super) fn preset(path: &Path) -> Result<Preset> {
    let preset = Preset::load(path)?;
    if preset.builds != [Identity::current().clone()] {
        eprintln!(
            "note: {}: found by another build ({}) than this one, {}: its errors are not this build's",
            path.display(),
            identity::listed(&preset.builds, ToString::to_string),
            Identity::current()
        );
    }
    Ok(preset)
}

/// Renders and writes a picture, which names the preset that it has its settings from.
pub(super) fn write(
    (scene, engine): (&Scene, &Engine),
    settings: &EngineSettings,
    gpu: bool,
    preset: Option<&Preset>,
    output: &Path,
    allow_nonfinite: bool,
) -> Result<ExitCode> {
    let backend = if gpu { Backend::Gpu } else { Backend::Cpu };
    let bar = super::progress_bar(1000);
    let report = |done: f64, what: &str| {
        bar.set_position((done * 1000.0) as u64);
        bar.set_message(what.to_owned());
    };
    let mut image = render::render(scene, engine, settings, backend, &report)?;
    bar.finish_and_clear();
    if let Some(preset) = preset {
        image.provenance.insert("preset".into(), preset.title.clone());
        image
            .provenance
            .insert("preset_builds".into(), identity::listed(&preset.builds, |build| build.full().to_owned()));
    }
    image.write_exr(output, allow_nonfinite)?;
    Ok(ExitCode::SUCCESS)
}

/// The engine of a model, by its level of quality and parameters `NAME=VALUE`, after `seconds`; warnings go to stderr.
pub(super) fn build(
    scene: &Scene,
    model: &str,
    defects: &Defects,
    (quality, parameters): (Option<&str>, &[String]),
    seconds: f64,
) -> Result<Engine> {
    let model = engines::find(model)?;
    let engine = model.engine(scene, &model.values(quality, parameters)?, defects, seconds)?;
    for warning in &engine.warnings {
        eprintln!("warning: {warning}");
    }
    Ok(engine)
}
