//! The options of engines, for every command that has one, and the pictures that engines make.

use crate::base::error::{Error, Result};
use crate::base::identity;
use crate::base::identity::Identity;
use crate::engines;
use crate::engines::defects::Defects;
use crate::engines::domain::Domain;
use crate::engines::light::models;
use crate::engines::render;
use crate::engines::render::{EngineJitter, EngineSettings};
use crate::engines::{Engine, parameters};
use crate::gpu::Backend;
use crate::measure::light_volume;
use crate::measure::tuning::preset::Preset;
use crate::media::light_volume::LightVolumeSettings;
use crate::scene::Scene;
use std::path::Path;
use std::process::ExitCode;

/// What says which engine it is.
#[derive(Clone, clap::Args)]
pub(super) struct EngineArguments {
    /// engine: the cloud system; `cloudparity models` lists them [default of render: graph, the scene's own; of bench-voxels: perlin-fbm].
    #[arg(long, value_name = "MODEL")]
    model: Option<String>,
    /// engine: a light model in the place of the system's; `cloudparity lights` lists them.
    #[arg(long, value_name = "MODEL")]
    light: Option<String>,
    #[command(flatten)]
    defects: DefectsArgument,
    /// engine: a level of quality of the system, or several of its value sets: high,cirrus.
    #[arg(long, value_name = "LEVEL")]
    quality: Option<String>,
    /// engine: a parameter of the system. May be given several times.
    #[arg(short = 'p', long = "parameter", id = "engine_parameters", value_name = "NAME=VALUE")]
    parameters: Vec<String>,
    /// engine: a parameter of the light model. May be given several times.
    #[arg(long = "light-parameter", value_name = "NAME=VALUE")]
    light_parameters: Vec<String>,
    /// engine: seconds of animation; of a scene's own graph every number called Time is moved by them [default: 0].
    #[arg(long, value_name = "SECONDS")]
    seconds: Option<f64>,
    /// engine: where the density is: object (the scene's box), slab:BOTTOM,TOP, or shell:X,Y,Z,INNER,OUTER, in metres [default: the system's].
    #[arg(long, value_name = "DOMAIN")]
    domain: Option<String>,
    /// engine: frame of the jitter [default: 0].
    #[arg(long, value_name = "N")]
    jitter_frame: Option<u32>,
    /// engine: add the system's god rays.
    #[arg(long)]
    god_rays: bool,
    #[command(flatten)]
    light_volume: LightVolumeArguments,
}

/// Light that path tracing finds before an engine marches.
#[derive(Clone, clap::Args)]
struct LightVolumeArguments {
    /// engine: find all light behind the suns' first scattering beforehand, by path tracing at the vertices of a grid with so many cells along its
    /// longest side; for light models without orders of their own, such as single.
    #[arg(long, value_name = "CELLS")]
    light_volume: Option<u32>,
    /// engine: paths from each vertex of the light volume [default: 16].
    #[arg(long, value_name = "N", requires = "light_volume")]
    light_volume_paths: Option<u32>,
    /// engine: largest band of spherical harmonics that the light volume keeps, 0 to 3 [default: 1].
    #[arg(long, value_name = "N", requires = "light_volume")]
    light_volume_bands: Option<u32>,
    /// engine: cells along the longest side of the grid of what lies towards the suns, in the place of a march towards them; 0 leaves the march
    /// [default: 128].
    #[arg(long, value_name = "CELLS", requires = "light_volume")]
    light_volume_shadow_cells: Option<u32>,
}

impl LightVolumeArguments {
    fn settings(&self) -> Option<LightVolumeSettings> {
        let default = LightVolumeSettings::of_cells(self.light_volume?);
        Some(LightVolumeSettings {
            paths: self.light_volume_paths.unwrap_or(default.paths),
            bands: self.light_volume_bands.unwrap_or(default.bands),
            shadow_cells: self.light_volume_shadow_cells.unwrap_or(default.shadow_cells),
            ..default
        })
    }
}

impl EngineArguments {
    /// Options by name, and whether each is given.
    pub(super) fn given(&self) -> [(&'static str, bool); 14] {
        [
            ("--model", self.model.is_some()),
            ("--light", self.light.is_some()),
            ("--defects", self.defects.given()),
            ("--quality", self.quality.is_some()),
            ("--parameter", !self.parameters.is_empty()),
            ("--light-parameter", !self.light_parameters.is_empty()),
            ("--seconds", self.seconds.is_some()),
            ("--domain", self.domain.is_some()),
            ("--jitter-frame", self.jitter_frame.is_some()),
            ("--god-rays", self.god_rays),
            ("--light-volume", self.light_volume.light_volume.is_some()),
            ("--light-volume-paths", self.light_volume.light_volume_paths.is_some()),
            ("--light-volume-bands", self.light_volume.light_volume_bands.is_some()),
            ("--light-volume-shadow-cells", self.light_volume.light_volume_shadow_cells.is_some()),
        ]
    }

    /// An error where options are given that a picture in motion has not: jitter, god rays, light of suns that stand still; or any of them beside a preset.
    pub(super) fn refuse_for_views(&self, has_preset: bool) -> Result<()> {
        let given: Vec<&str> = self.given().into_iter().filter(|(_, given)| *given).map(|(name, _)| name).collect();
        let of_pictures = ["--jitter-frame", "--god-rays", "--light-volume"];
        if let Some(name) = given.iter().find(|name| of_pictures.contains(name)) {
            return Err(Error::new(
                *name,
                "an option of pictures",
                "options of the engine: here there is no jitter, there are no god rays, and suns and parameters may move",
                format!("Leave {name} out."),
            ));
        }
        match given.first().filter(|_| has_preset) {
            None => Ok(()),
            Some(name) => Err(Error::new(
                *name,
                "an option beside --preset",
                "a preset alone, which says all of the engine",
                format!("Leave {name} or --preset out."),
            )),
        }
    }

    /// The same with other values for parameters of the system, `NAME=VALUE`.
    pub(super) fn with_parameters(&self, texts: &[String]) -> Self {
        let mut changed = self.clone();
        changed.parameters.extend_from_slice(texts);
        changed
    }

    /// The engine, of `model` where no other is given; warnings go to stderr.
    pub(super) fn engine(&self, scene: &Scene, model: &str) -> Result<Engine> {
        self.silent(scene, model).map(warned)
    }

    /// The same without warnings.
    pub(super) fn silent(&self, scene: &Scene, model: &str) -> Result<Engine> {
        let domain = self.domain.as_deref().map(str::parse::<Domain>).transpose();
        let domain = domain.map_err(|error| Error { place: "--domain".into(), ..error })?;
        let model = engines::find(self.model.as_deref().unwrap_or(model))?;
        let values = model.values(self.quality.as_deref(), &self.parameters)?;
        let seconds = self.seconds.unwrap_or(0.0);
        if !seconds.is_finite() {
            return Err(Error::new("--seconds", seconds.to_string(), "a finite number", "Correct the option."));
        }
        let mut engine = model.engine_in(domain, scene, &values, &self.defects.read()?, seconds)?;
        if let Some(settings) = self.light_volume.settings() {
            let bar = super::progress_bar(1000);
            engine.light_volume = Some(light_volume::found(scene, &engine, &settings, &super::progress_on(&bar))?);
            bar.finish_and_clear();
        }
        if let Some(light) = &self.light {
            models::find(light)?.apply(&mut engine.light)?;
        }
        for text in &self.light_parameters {
            let (name, value) = parameters::assignment(text)?;
            models::set(&mut engine.light, name, value, text)?;
        }
        Ok(engine)
    }

    /// The options as they would be for the engine with changes.
    #[cfg(feature = "viewer")]
    pub(super) fn changed(&self, changes: &crate::viewer::Changes) -> Self {
        let texts = |values: &indexmap::IndexMap<String, f64>| -> Vec<String> {
            values.iter().map(|(name, value)| format!("{name}={value}")).collect()
        };
        let mut changed = self.clone();
        changed.quality = changes.quality.clone().or(changed.quality);
        changed.light = changes.light.clone().or(changed.light);
        changed.parameters.extend(texts(&changes.density));
        changed.light_parameters.extend(texts(&changes.of_light));
        if changes.seconds != 0.0 {
            changed.seconds = Some(self.seconds.unwrap_or(0.0) + changes.seconds);
        }
        changed
    }

    /// The same without defects.
    #[cfg(feature = "viewer")]
    pub(super) fn corrected(&self) -> Self {
        Self { defects: DefectsArgument { defects: None, variant: None }, ..self.clone() }
    }

    /// The model that is asked for, or one that stands in its place.
    #[cfg(feature = "viewer")]
    pub(super) fn model<'a>(&'a self, other: &'a str) -> &'a str {
        self.model.as_deref().unwrap_or(other)
    }

    /// Seconds of animation.
    #[cfg(feature = "viewer")]
    pub(super) fn seconds(&self) -> f64 {
        self.seconds.unwrap_or(0.0)
    }

    /// The light model's name and the parameters that were given for it.
    #[cfg(feature = "viewer")]
    pub(super) fn light(&self) -> (&str, &[String]) {
        (self.light.as_deref().unwrap_or(models::OWN), &self.light_parameters)
    }

    /// How its picture is made.
    pub(super) fn settings(&self, jitter: EngineJitter, sub_pixels: u32) -> EngineSettings {
        EngineSettings { jitter, frame: self.jitter_frame.unwrap_or(0), sub_pixels, god_rays: self.god_rays }
    }
}

/// Which defects an engine keeps.
#[derive(Clone, clap::Args)]
pub(super) struct DefectsArgument {
    /// Defects of the original that are kept: all (as published), none (corrected), or some, such as PF-4,PF-6; `cloudparity models` says
    /// what each is [default: none].
    #[arg(long, value_name = "NAMES")]
    defects: Option<String>,
    /// The option that `--defects` took the place of.
    #[arg(long, hide = true)]
    variant: Option<String>,
}

impl DefectsArgument {
    fn given(&self) -> bool {
        self.defects.is_some() || self.variant.is_some()
    }

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
        let defects = self.defects.as_deref().unwrap_or("none");
        defects.parse().map_err(|error| Error { place: "--defects".into(), ..error })
    }
}

/// A preset for a scene; says so where another build found it, or in other scenes.
pub(super) fn preset(path: &Path, scene: &Scene) -> Result<Preset> {
    let preset = Preset::load(path)?;
    let found_in = preset.scenes();
    if !found_in.is_empty() && !found_in.contains(&scene.name.as_str()) {
        eprintln!(
            "note: {}: found in {}, and this scene is {}: what it was chosen by is not seen here",
            path.display(),
            found_in.join(", "),
            scene.name
        );
    }
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
    backend: Backend,
    preset: Option<&Preset>,
    output: &Path,
    allow_nonfinite: bool,
) -> Result<ExitCode> {
    let bar = super::progress_bar(1000);
    let report = super::progress_on(&bar);
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
    Ok(warned(model.engine(scene, &model.values(quality, parameters)?, defects, seconds)?))
}

/// An engine whose warnings went to stderr.
fn warned(engine: Engine) -> Engine {
    for warning in &engine.warnings {
        eprintln!("warning: {warning}");
    }
    engine
}
