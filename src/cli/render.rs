//! `cloudparity render`: a picture of a scene.

use super::choice::choice;
use crate::base::error::{Error, Result};
use crate::cli::engine::EngineArguments;
use crate::cli::march::{MarchArguments, named};
use crate::cli::picture::{Filter, PictureArguments};
use crate::cli::resume::ResumeArguments;
use crate::engines::render::EngineJitter;
use crate::gpu::Backend;
use crate::integrators;
use crate::integrators::MarchSettings;
use crate::integrators::path;
use crate::integrators::path::{PathSettings, State, Tracking};
use crate::media::density_cache::CacheReport;
use crate::media::medium::Medium;
use crate::scene::Scene;
use crate::scene::image::Image;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Render a scene: a scene-linear EXR, or a PNG with the EXR beside it.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity render CLOUD.scene.json -o CLOUD.png")]
pub(super) struct Arguments {
    #[command(flatten)]
    picture: PictureArguments,
    /// The method. Without it that which its options are of; else march where the scene scatters once in one medium, and path
    /// where there is more.
    #[arg(long, value_enum)]
    integrator: Option<Integrator>,
    /// Instead of a method, an engine as a tuned preset (*.preset.json) has it.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["integrator", "seed"])]
    preset: Option<PathBuf>,
    /// Where it runs.
    #[arg(long, value_enum, default_value_t = BackendName::Cpu)]
    backend: BackendName,
    /// Pixel filter instead of the scene's.
    #[arg(long, value_enum)]
    pixel_filter: Option<Filter>,
    /// Chooses the random numbers of path, and of march with --jitter; pictures of different seeds are independent
    /// [default: 0].
    #[arg(long)]
    seed: Option<u32>,
    #[command(flatten)]
    march: MarchArguments,
    #[command(flatten)]
    path: PathArguments,
    #[command(flatten)]
    engine: EngineArguments,
    /// Write pixels that are NaN or infinite, too.
    #[arg(long)]
    allow_nonfinite: bool,
}

/// What only `--integrator path` takes.
#[derive(clap::Args)]
struct PathArguments {
    /// path: paths per pixel [default: 64].
    #[arg(long)]
    samples: Option<u32>,
    /// path: as many pictures with seeds that count on from --seed. OUTPUT is their mean, each is OUTPUT.seed-N.exr,
    /// which `cloudparity diff --ours` takes.
    #[arg(long, conflicts_with_all = ["time", "error"], value_parser = clap::value_parser!(u32).range(2..=1024))]
    replicas: Option<u32>,
    /// path: stop after so many seconds, preparation not counted; --samples is the most then [default: 16777216].
    #[arg(long, value_name = "SECONDS")]
    time: Option<f64>,
    /// path: stop where the estimated relative mean squared error is this small; --samples as with --time.
    #[arg(long, value_name = "RELMSE")]
    error: Option<f64>,
    /// path: how rays find their collisions [default: proven].
    #[arg(long, value_parser = choice::<Tracking>())]
    tracking: Option<Tracking>,
    #[command(flatten)]
    resume: ResumeArguments,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Integrator {
    /// Deterministic ray marching of single scattering.
    March,
    /// Path tracing without bias.
    Path,
    /// The march of a cloud system's engine: the scene's own graph, or a published system.
    Engine,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum BackendName {
    /// All cores.
    Cpu,
    /// The adapter.
    Gpu,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let begin = std::time::Instant::now();
    let mut scene = arguments.picture.load()?;
    let output = &Output::new(&arguments.picture.output);
    if let Some(filter) = arguments.pixel_filter {
        scene.film.pixel_filter = filter.into();
    }
    if let Some(path) = &arguments.preset {
        refuse("path", &arguments.path.given())?;
        refuse("march", &arguments.march.given())?;
        refuse("engine", &arguments.engine.given())?;
        let is_gpu = matches!(arguments.backend, BackendName::Gpu);
        let preset = super::engine::preset(path)?;
        let (scene, engine, combination) = preset.build(&scene)?;
        let settings = combination.picture_settings();
        super::engine::write(
            (&scene, &engine),
            &settings,
            is_gpu,
            Some(&preset),
            &output.exr,
            arguments.allow_nonfinite,
        )?;
        return output.finish(&scene, &format!("engine {}, preset {}", engine.model, preset.title), begin);
    }
    let (integrator, why) = arguments.chosen(&scene);
    if integrator == Integrator::Engine {
        let what = engine(arguments, &scene, &output.exr)?;
        return output.finish(&scene, &what, begin);
    }
    refuse("engine", &arguments.engine.given())?;
    let bar = super::progress_bar(1000);
    let report = |done: f64, what: &str| {
        bar.set_position((done * 1000.0) as u64);
        bar.set_message(what.to_owned());
    };
    let backend = match arguments.backend {
        BackendName::Cpu => Backend::Cpu,
        BackendName::Gpu => Backend::Gpu,
    };
    let image = match integrator {
        Integrator::March => {
            refuse("path", &arguments.path.given())?;
            let settings = arguments.march.settings(MarchSettings::default(), arguments.seed)?;
            integrators::render(&scene, &settings, backend, &report)?
        }
        Integrator::Path => {
            refuse("march", &arguments.march.given())?;
            if let Some(count) = arguments.path.replicas {
                return replicas(arguments, &scene, backend, count, &report);
            }
            let mut state = output.exr.clone().into_os_string();
            state.push(".state");
            let state = State { path: state.as_ref(), resume: arguments.path.resume.resume() };
            path::render(&scene, &arguments.path.settings(arguments.seed), backend, Some(&state), &report)?
        }
        Integrator::Engine => unreachable!("it has returned"),
    };
    bar.finish_and_clear();
    image.write_exr(&output.exr, arguments.allow_nonfinite)?;
    if let Some(report) = CacheReport::of(&image) {
        super::print(&format!("{report}\n"))?;
    }
    let what = match integrator {
        Integrator::Path => {
            format!("path tracing, {} samples{why}", image.provenance.get("samples").map_or("?", |s| s))
        }
        _ => format!("ray marching of single scattering{why}"),
    };
    output.finish(&scene, &what, begin)
}

impl Arguments {
    /// The method, and why it was taken where nobody named it.
    fn chosen(&self, scene: &Scene) -> (Integrator, String) {
        let is_given = |options: &[(&str, bool)]| options.iter().any(|(_, given)| *given);
        if let Some(named) = self.integrator {
            return (named, String::new());
        }
        if is_given(&self.engine.given()) {
            return (Integrator::Engine, String::new());
        }
        if is_given(&self.path.given()) {
            return (Integrator::Path, String::new());
        }
        if is_given(&self.march.given()) {
            return (Integrator::March, String::new());
        }
        if scene.integrator.volume_bounces.min(scene.integrator.max_bounces) > 0 {
            return (Integrator::Path, ", as the scene scatters more than once".into());
        }
        match Medium::new(scene) {
            Ok(_) => (Integrator::March, ", as the scene scatters once".into()),
            Err(error) => (Integrator::Path, format!(", as ray marching cannot: {error}")),
        }
    }
}

/// Where the picture goes.
struct Output {
    /// The scene-linear picture.
    exr: PathBuf,
    /// The picture as it is shown, where one is wanted.
    png: Option<PathBuf>,
}

impl Output {
    fn new(path: &Path) -> Self {
        let is_png = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
        let (exr, png) =
            if is_png { (path.with_extension("exr"), Some(path.to_owned())) } else { (path.to_owned(), None) };
        Self { exr, png }
    }

    /// Makes the PNG through Blender's colour management, and says what was written.
    fn finish(&self, scene: &Scene, what: &str, begin: std::time::Instant) -> Result<ExitCode> {
        let [width, height] = scene.image_size();
        let seconds = begin.elapsed().as_secs_f64();
        super::print(&format!("{}: {width} x {height}, {what}, {seconds:.1} s\n", self.exr.display()))?;
        if let Some(png) = &self.png {
            let view = super::display::show(&self.exr, png, &scene.display)?;
            super::print(&format!("{}: as Blender shows it ({view})\n", png.display()))?;
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// Renders by the march of an engine; returns what it is.
fn engine(arguments: &Arguments, scene: &Scene, output: &Path) -> Result<String> {
    refuse("path", &arguments.path.given())?;
    let shared = ["--jitter", "--sub-pixels", "--light"];
    let of_march: Vec<(&str, bool)> =
        arguments.march.given().into_iter().filter(|(name, _)| !shared.contains(name)).collect();
    refuse("march", &of_march)?;
    refuse("path", &[("--seed", arguments.seed.is_some())])?;
    let engine = arguments.engine.engine(scene, "graph", arguments.march.light.as_deref())?;
    let jitter = named("--jitter", arguments.march.jitter.as_deref())?.unwrap_or(EngineJitter::None);
    let sub_pixels = arguments.march.sub_pixels.unwrap_or(1);
    if !(1..=64).contains(&sub_pixels) {
        return Err(Error::new("--sub-pixels", sub_pixels.to_string(), "1 to 64", "Correct the option."));
    }
    let settings = arguments.engine.settings(jitter, sub_pixels);
    let is_gpu = matches!(arguments.backend, BackendName::Gpu);
    super::engine::write((scene, &engine), &settings, is_gpu, None, output, arguments.allow_nonfinite)?;
    Ok(format!("engine {}", engine.model))
}

/// Renders and writes several pictures and their mean.
fn replicas(
    arguments: &Arguments,
    scene: &Scene,
    backend: Backend,
    count: u32,
    report: crate::base::progress::Progress<'_>,
) -> Result<ExitCode> {
    let settings = arguments.path.settings(arguments.seed);
    let seeds: Vec<u32> = (0..count).map(|number| settings.seed.wrapping_add(number)).collect();
    let images = path::render_replicas(scene, &settings, backend, &seeds, report)?;
    let output = &arguments.picture.output;
    for (image, seed) in images.iter().zip(&seeds) {
        let file = super::beside(output, &format!("seed-{seed}"));
        image.write_exr(&file, arguments.allow_nonfinite)?;
        super::print(&format!("{}\n", file.display()))?;
    }
    Image::mean_of(&images)?.write_exr(output, arguments.allow_nonfinite)?;
    super::print(&format!("{} mean\n", output.display()))?;
    Ok(ExitCode::SUCCESS)
}

/// An error where an option of the other integrator is given, which would otherwise do nothing.
fn refuse(integrator: &str, options: &[(&str, bool)]) -> Result<()> {
    match options.iter().find(|(_, given)| *given) {
        None => Ok(()),
        Some((name, _)) => Err(Error::new(
            *name,
            "an option of the other integrator",
            format!("{name} only with --integrator {integrator}"),
            format!("Leave {name} out, or give --integrator {integrator}."),
        )),
    }
}

impl PathArguments {
    fn given(&self) -> [(&'static str, bool); 6] {
        [
            ("--replicas", self.replicas.is_some()),
            ("--samples", self.samples.is_some()),
            ("--time", self.time.is_some()),
            ("--error", self.error.is_some()),
            ("--tracking", self.tracking.is_some()),
            ("--mix-builds", self.resume.given()),
        ]
    }

    fn settings(&self, seed: Option<u32>) -> PathSettings {
        let default = PathSettings::default();
        let otherwise_stopped = self.time.is_some() || self.error.is_some();
        let most = if otherwise_stopped { path::MOST_SAMPLES } else { default.samples };
        PathSettings {
            samples: self.samples.unwrap_or(most),
            seed: seed.unwrap_or(default.seed),
            time: self.time,
            error: self.error,
            tracking: self.tracking.unwrap_or_default(),
            ..default
        }
    }
}
