//! `cloudparity render`: a picture of a scene.

use super::choice::choice;
use crate::base::destination::Destination;
use crate::base::error::{Error, Result};
use crate::cli::cycles::CyclesArguments;
use crate::cli::engine::EngineArguments;
use crate::cli::march::{MarchArguments, named};
use crate::cli::picture::{Filter, PictureArguments};
use crate::cli::resume::ResumeArguments;
use crate::engines::render::{EngineJitter, EngineSettings};
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

/// Render a scene, by our own methods or by Cycles: a scene-linear EXR, or a PNG with the EXR beside it.
///
/// Options that begin with the name of a method are of that method. With --replicas, OUTPUT is the mean; beside it lies every replica as
/// OUTPUT.seed-N.exr, which `cloudparity diff` takes, and of Cycles OUTPUT.variance.exr (of one replica, per pixel). What Cycles
/// rendered is kept: the same request is rendered once.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  cloudparity render CLOUD.scene.json -o CLOUD.png
  cloudparity render CLOUD.scene.json -o CYCLES.exr --integrator cycles --effort ci
  cloudparity render CLOUD.scene.json -o GAME.png --integrator engine --light octaves --backend gpu")]
pub(super) struct Arguments {
    #[command(flatten)]
    picture: PictureArguments,
    /// The method. Without it that which its options are of; else march where the scene scatters once in one medium, and path
    /// where there is more.
    #[arg(long, value_enum)]
    integrator: Option<Integrator>,
    /// Instead of a method, an engine as a tuned preset (*.preset.json) has it.
    #[arg(long, value_name = "FILE", conflicts_with = "integrator")]
    preset: Option<PathBuf>,
    /// Where it runs.
    #[arg(long, value_parser = choice::<Backend>(), default_value_t = Backend::Cpu)]
    backend: Backend,
    /// Pixel filter instead of the scene's.
    #[arg(long, value_enum)]
    pixel_filter: Option<Filter>,
    /// march with --jitter, path, cycles: chooses the random numbers; pictures of different seeds are independent [default: 0; of
    /// cycles 101, of several replicas 5000].
    #[arg(long, value_name = "SEED")]
    seed: Option<u32>,
    /// path, cycles: samples per pixel [default: path 64, cycles 256].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=16_777_216))]
    samples: Option<u32>,
    /// path, cycles: as many pictures with seeds that count on from --seed.
    #[arg(long, value_name = "N", conflicts_with_all = ["max_seconds", "max_relmse"], value_parser = clap::value_parser!(u32).range(1..=1024))]
    replicas: Option<u32>,
    #[command(flatten)]
    march: MarchArguments,
    #[command(flatten)]
    path: PathArguments,
    #[command(flatten)]
    engine: EngineArguments,
    #[command(flatten)]
    cycles: CyclesArguments,
    /// Write pixels that are NaN or infinite, too.
    #[arg(long)]
    allow_nonfinite: bool,
}

/// What only `--integrator path` takes.
#[derive(clap::Args)]
struct PathArguments {
    /// path: stop after so many seconds, preparation not counted; --samples is the most then [default: 16777216].
    #[arg(long, value_name = "SECONDS")]
    max_seconds: Option<f64>,
    /// path: stop where the estimated relative mean squared error is this small; --samples as with --max-seconds.
    #[arg(long, value_name = "ERROR")]
    max_relmse: Option<f64>,
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
    /// Blender's own renderer, under the settings of a comparison.
    Cycles,
}

impl Integrator {
    fn name(self) -> &'static str {
        match self {
            Self::March => "march",
            Self::Path => "path",
            Self::Engine => "engine",
            Self::Cycles => "cycles",
        }
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let begin = std::time::Instant::now();
    let mut scene = arguments.picture.load()?;
    let output = &Output::new(&arguments.picture.output);
    if let Some(filter) = arguments.pixel_filter {
        scene.film.pixel_filter = filter.into();
    }
    if let Some(path) = &arguments.preset {
        arguments.refuse_beside_preset()?;
        let preset = super::engine::preset(path, &scene)?;
        let (scene, engine, combination) = preset.build(&scene)?;
        let settings = arguments.engine_settings(combination.picture_settings().sub_pixels)?;
        let made = (&scene, &engine);
        let (backend, nonfinite) = (arguments.backend, arguments.allow_nonfinite);
        super::engine::write(made, &settings, backend, Some(&preset), &output.exr, nonfinite)?;
        return output.finish(&scene, &format!("engine {}, preset {}", engine.model, preset.title), begin);
    }
    let (integrator, why) = arguments.chosen(&scene);
    arguments.refuse_of_others(integrator)?;
    let what = match integrator {
        Integrator::March => arguments.by_march(&scene, &output.exr)?,
        Integrator::Path => arguments.by_path(&scene, &output.exr)?,
        Integrator::Engine => {
            let engine = arguments.engine.engine(&scene, "graph")?;
            let settings = arguments.engine_settings(arguments.march.sub_pixels.unwrap_or(1))?;
            let made = (&scene, &engine);
            super::engine::write(made, &settings, arguments.backend, None, &output.exr, arguments.allow_nonfinite)?;
            format!("engine {}", engine.model)
        }
        Integrator::Cycles => {
            let drawn = (arguments.samples, arguments.replicas, arguments.seed);
            arguments.cycles.render(&scene, drawn, &output.exr)?
        }
    };
    output.finish(&scene, &format!("{what}{why}"), begin)
}

impl Arguments {
    /// Options that only some methods have: name, whether it is given, the methods.
    fn given(&self) -> Vec<(&'static str, bool, Vec<Integrator>)> {
        use Integrator::{Cycles, Engine, March, Path};
        let march = self.march.given().into_iter().map(|(name, given)| match name {
            "--jitter" | "--sub-pixels" => (name, given, vec![March, Engine]),
            _ => (name, given, vec![March]),
        });
        let path = self.path.given().into_iter().map(|(name, given)| (name, given, vec![Path]));
        let engine = self.engine.given().into_iter().map(|(name, given)| (name, given, vec![Engine]));
        let cycles = self.cycles.given().into_iter().map(|(name, given)| (name, given, vec![Cycles]));
        let shared = [
            ("--samples", self.samples.is_some(), vec![Path, Cycles]),
            ("--replicas", self.replicas.is_some(), vec![Path, Cycles]),
            ("--seed", self.seed.is_some(), vec![March, Path, Cycles]),
            ("--backend", !self.backend.is_cpu(), vec![March, Path, Engine]),
            ("--allow-nonfinite", self.allow_nonfinite, vec![March, Path, Engine]),
        ];
        march.chain(engine).chain(path).chain(cycles).chain(shared).collect()
    }

    /// The method, and why it was taken where nobody named it.
    fn chosen(&self, scene: &Scene) -> (Integrator, String) {
        if let Some(named) = self.integrator {
            return (named, String::new());
        }
        // Of an option that several have, the first: nobody means Cycles who does not say so.
        let of_options = [Integrator::Engine, Integrator::Path, Integrator::March, Integrator::Cycles];
        let only: Vec<Integrator> =
            self.given().into_iter().filter(|(_, given, of)| *given && of.len() == 1).map(|(_, _, of)| of[0]).collect();
        if let Some(found) = of_options.into_iter().find(|one| only.contains(one)) {
            return (found, String::new());
        }
        if self.samples.is_some() || self.replicas.is_some() {
            return (Integrator::Path, String::new());
        }
        if self.march.jitter.is_some() || self.march.sub_pixels.is_some() {
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

    /// An error where an option of other methods is given, which would otherwise do nothing.
    fn refuse_of_others(&self, integrator: Integrator) -> Result<()> {
        let other = self.given().into_iter().find(|(_, given, of)| *given && !of.contains(&integrator));
        let Some((name, _, of)) = other else { return Ok(()) };
        let names: Vec<&str> = of.iter().map(|one| one.name()).collect();
        let names = names.join(" or ");
        Err(Error::new(
            name,
            format!("an option of {names}, where {} renders", integrator.name()),
            format!("{name} only with --integrator {names}"),
            format!("Leave {name} out, or give --integrator {}.", of[0].name()),
        ))
    }

    /// An error where an option is given that a preset decides.
    fn refuse_beside_preset(&self) -> Result<()> {
        let free = ["--jitter", "--jitter-frame", "--god-rays", "--backend", "--allow-nonfinite"];
        let other = self.given().into_iter().find(|(name, given, _)| *given && !free.contains(name));
        let Some((name, ..)) = other else { return Ok(()) };
        Err(Error::new(
            name,
            "an option beside --preset",
            format!("a preset alone, which says all of the engine; beside it {}", free.join(", ")),
            format!("Leave {name} or --preset out."),
        ))
    }

    fn engine_settings(&self, sub_pixels: u32) -> Result<EngineSettings> {
        let jitter = named("--jitter", self.march.jitter.as_deref())?.unwrap_or(EngineJitter::None);
        Ok(self.engine.settings(jitter, sub_pixels))
    }

    /// Ray marching; returns what it was.
    fn by_march(&self, scene: &Scene, exr: &Path) -> Result<String> {
        let settings = self.march.settings(MarchSettings::default(), self.seed)?;
        let bar = super::progress_bar(1000);
        let image = integrators::render(scene, &settings, self.backend, &super::progress_on(&bar))?;
        bar.finish_and_clear();
        image.write_exr(exr, self.allow_nonfinite)?;
        if let Some(report) = CacheReport::of(&image) {
            super::print(&format!("{report}\n"))?;
        }
        Ok("ray marching of single scattering".into())
    }

    /// Path tracing, of one picture or of several and their mean; returns what it was.
    fn by_path(&self, scene: &Scene, exr: &Path) -> Result<String> {
        let settings = self.path.settings(self.samples, self.seed);
        let bar = super::progress_bar(1000);
        let report = super::progress_on(&bar);
        let Some(count) = self.replicas else {
            let mut state = exr.to_owned().into_os_string();
            state.push(".state");
            let state = State { path: state.as_ref(), resume: self.path.resume.resume() };
            // Beside a device or a pipe nothing is kept.
            let is_file = matches!(Destination::find(exr)?, Destination::File(_));
            let image = path::render(scene, &settings, self.backend, is_file.then_some(&state), &report)?;
            bar.finish_and_clear();
            image.write_exr(exr, self.allow_nonfinite)?;
            return Ok(format!("path tracing, {} samples", image.provenance.get("samples").map_or("?", |s| s)));
        };
        let seeds: Vec<u32> = (0..count).map(|number| settings.seed.wrapping_add(number)).collect();
        let images = path::render_replicas(scene, &settings, self.backend, &seeds, &report)?;
        bar.finish_and_clear();
        for (image, seed) in images.iter().zip(&seeds) {
            let file = super::beside(exr, &format!("seed-{seed}"));
            image.write_exr(&file, self.allow_nonfinite)?;
            super::print(&format!("{}\n", file.display()))?;
        }
        Image::mean_of(&images)?.write_exr(exr, self.allow_nonfinite)?;
        Ok(format!("mean of {count} replicas: path tracing, {} samples", settings.samples))
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

impl PathArguments {
    /// Options by name, and whether each is given.
    fn given(&self) -> [(&'static str, bool); 4] {
        [
            ("--max-seconds", self.max_seconds.is_some()),
            ("--max-relmse", self.max_relmse.is_some()),
            ("--tracking", self.tracking.is_some()),
            ("--mix-builds", self.resume.given()),
        ]
    }

    fn settings(&self, samples: Option<u32>, seed: Option<u32>) -> PathSettings {
        let default = PathSettings::default();
        let otherwise_stopped = self.max_seconds.is_some() || self.max_relmse.is_some();
        let most = if otherwise_stopped { path::MOST_SAMPLES } else { default.samples };
        PathSettings {
            samples: samples.unwrap_or(most),
            seed: seed.unwrap_or(default.seed),
            time: self.max_seconds,
            error: self.max_relmse,
            tracking: self.tracking.unwrap_or_default(),
            ..default
        }
    }
}
