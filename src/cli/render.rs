//! `cloudparity render`: a picture of a scene.

use super::picture::{Filter, PictureArguments};
use crate::error::{Error, Result};
use crate::image::Image;
use crate::integrate::path::{self, PathSettings};
use crate::integrate::{self, Backend, LightMode, MarchSettings};
use crate::scene::Scene;
use std::process::ExitCode;

/// Render a scene into a scene-linear EXR.
#[derive(clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    picture: PictureArguments,
    /// The method.
    #[arg(long, value_enum, default_value_t = Integrator::March)]
    integrator: Integrator,
    /// Where it runs.
    #[arg(long, value_enum, default_value_t = BackendName::Cpu)]
    backend: BackendName,
    /// Pixel filter instead of the scene's.
    #[arg(long, value_enum)]
    pixel_filter: Option<Filter>,
    #[command(flatten)]
    march: MarchArguments,
    #[command(flatten)]
    path: PathArguments,
    /// Write pixels that are NaN or infinite, too.
    #[arg(long)]
    allow_nonfinite: bool,
}

/// What only `--integrator march` takes. Without a value the default holds.
#[derive(clap::Args)]
struct MarchArguments {
    /// march: longest step of a view ray in metres; 0: 1/192 of the medium's mean side [default: 0].
    #[arg(long)]
    view_step: Option<f64>,
    /// march: longest step of a shadow ray in metres, with --light exact; 0: the view step [default: 0].
    #[arg(long)]
    shadow_step: Option<f64>,
    /// march: directions of the quadrature over the world [default: 64].
    #[arg(long)]
    world_directions: Option<u32>,
    /// march: bands of spherical harmonics for the world in anisotropic media, with --light grid [default: 2].
    #[arg(long)]
    world_bands: Option<u32>,
    /// march: rays per pixel and axis [default: 3].
    #[arg(long)]
    sub_pixels: Option<u32>,
    /// march: view rays end below this transmittance [default: 0.0001].
    #[arg(long)]
    exit_transmittance: Option<f64>,
    /// march: how light reaches the samples [default: grid].
    #[arg(long, value_enum)]
    light: Option<LightName>,
    /// march: cells along the longest side of the light grid [default: 192].
    #[arg(long)]
    grid_cells: Option<u32>,
}

/// What only `--integrator path` takes.
#[derive(clap::Args)]
struct PathArguments {
    /// path: paths per pixel [default: 64].
    #[arg(long)]
    samples: Option<u32>,
    /// path: chooses the random numbers; pictures of different seeds are independent [default: 0].
    #[arg(long)]
    seed: Option<u32>,
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
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Integrator {
    /// Deterministic ray marching of single scattering.
    March,
    /// Path tracing without bias.
    Path,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum BackendName {
    /// All cores.
    Cpu,
    /// The adapter.
    Gpu,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum LightName {
    /// Shadow rays evaluate the density.
    Exact,
    /// Density and light are interpolated from a grid.
    Grid,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let mut scene = arguments.picture.load()?;
    if let Some(filter) = arguments.pixel_filter {
        scene.film.pixel_filter = filter.into();
    }
    let bar = super::progress_bar(1000);
    let report = |done: f64, what: &str| {
        bar.set_position((done * 1000.0) as u64);
        bar.set_message(what.to_owned());
    };
    let backend = match arguments.backend {
        BackendName::Cpu => Backend::Cpu,
        BackendName::Gpu => Backend::Gpu,
    };
    let image = match arguments.integrator {
        Integrator::March => {
            refuse("path", &arguments.path.given())?;
            integrate::render(&scene, &arguments.march.settings(), backend, &report)?
        }
        Integrator::Path => {
            refuse("march", &arguments.march.given())?;
            if let Some(count) = arguments.path.replicas {
                return replicas(arguments, &scene, backend, count, &report);
            }
            let mut state = arguments.picture.output.clone().into_os_string();
            state.push(".state");
            path::render(&scene, &arguments.path.settings(), backend, Some(state.as_ref()), &report)?
        }
    };
    bar.finish_and_clear();
    image.write_exr(&arguments.picture.output, arguments.allow_nonfinite)?;
    Ok(ExitCode::SUCCESS)
}

/// Renders and writes several pictures and their mean.
fn replicas(
    arguments: &Arguments,
    scene: &Scene,
    backend: Backend,
    count: u32,
    report: integrate::Progress<'_>,
) -> Result<ExitCode> {
    let settings = arguments.path.settings();
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

impl MarchArguments {
    fn given(&self) -> [(&'static str, bool); 8] {
        [
            ("--view-step", self.view_step.is_some()),
            ("--shadow-step", self.shadow_step.is_some()),
            ("--world-directions", self.world_directions.is_some()),
            ("--world-bands", self.world_bands.is_some()),
            ("--sub-pixels", self.sub_pixels.is_some()),
            ("--exit-transmittance", self.exit_transmittance.is_some()),
            ("--light", self.light.is_some()),
            ("--grid-cells", self.grid_cells.is_some()),
        ]
    }

    fn settings(&self) -> MarchSettings {
        let default = MarchSettings::default();
        MarchSettings {
            view_step: self.view_step.unwrap_or(default.view_step),
            shadow_step: self.shadow_step.unwrap_or(default.shadow_step),
            world_directions: self.world_directions.unwrap_or(default.world_directions),
            world_bands: self.world_bands.unwrap_or(default.world_bands),
            sub_pixels: self.sub_pixels.unwrap_or(default.sub_pixels),
            exit_transmittance: self.exit_transmittance.unwrap_or(default.exit_transmittance),
            light: match self.light {
                None => default.light,
                Some(LightName::Exact) => LightMode::Exact,
                Some(LightName::Grid) => LightMode::Grid,
            },
            grid_cells: self.grid_cells.unwrap_or(default.grid_cells),
        }
    }
}

impl PathArguments {
    fn given(&self) -> [(&'static str, bool); 5] {
        [
            ("--replicas", self.replicas.is_some()),
            ("--samples", self.samples.is_some()),
            ("--seed", self.seed.is_some()),
            ("--time", self.time.is_some()),
            ("--error", self.error.is_some()),
        ]
    }

    fn settings(&self) -> PathSettings {
        let default = PathSettings::default();
        let otherwise_stopped = self.time.is_some() || self.error.is_some();
        let most = if otherwise_stopped { path::MOST_SAMPLES } else { default.samples };
        PathSettings {
            samples: self.samples.unwrap_or(most),
            seed: self.seed.unwrap_or(default.seed),
            time: self.time,
            error: self.error,
        }
    }
}
