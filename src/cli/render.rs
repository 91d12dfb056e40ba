//! `cloudparity render`: a picture of a scene.

use super::picture::{Filter, PictureArguments};
use crate::error::Result;
use crate::integrate::{self, Backend, LightMode, MarchSettings};
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
    /// Longest step of a view ray in metres; 0: 1/192 of the medium's mean side.
    #[arg(long, default_value_t = MarchSettings::default().view_step)]
    view_step: f64,
    /// Longest step of a shadow ray in metres, with --light exact; 0: the view step.
    #[arg(long, default_value_t = MarchSettings::default().shadow_step)]
    shadow_step: f64,
    /// Directions of the quadrature over the world.
    #[arg(long, default_value_t = MarchSettings::default().world_directions)]
    world_directions: u32,
    /// Bands of spherical harmonics for the world in anisotropic media, with --light grid.
    #[arg(long, default_value_t = MarchSettings::default().world_bands)]
    world_bands: u32,
    /// Rays per pixel and axis.
    #[arg(long, default_value_t = MarchSettings::default().sub_pixels)]
    sub_pixels: u32,
    /// View rays end below this transmittance.
    #[arg(long, default_value_t = MarchSettings::default().exit_transmittance)]
    exit_transmittance: f64,
    /// How light reaches the samples.
    #[arg(long, value_enum, default_value_t = LightName::Grid)]
    light: LightName,
    /// Cells along the longest side of the light grid.
    #[arg(long, default_value_t = MarchSettings::default().grid_cells)]
    grid_cells: u32,
    /// Write pixels that are NaN or infinite, too.
    #[arg(long)]
    allow_nonfinite: bool,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Integrator {
    /// Deterministic ray marching of single scattering.
    March,
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
    let Integrator::March = arguments.integrator;
    let settings = MarchSettings {
        view_step: arguments.view_step,
        shadow_step: arguments.shadow_step,
        world_directions: arguments.world_directions,
        world_bands: arguments.world_bands,
        sub_pixels: arguments.sub_pixels,
        exit_transmittance: arguments.exit_transmittance,
        light: match arguments.light {
            LightName::Exact => LightMode::Exact,
            LightName::Grid => LightMode::Grid,
        },
        grid_cells: arguments.grid_cells,
    };
    let backend = match arguments.backend {
        BackendName::Cpu => Backend::Cpu,
        BackendName::Gpu => Backend::Gpu,
    };
    let bar = super::progress_bar(1000);
    let report = |done: f64, what: &str| {
        bar.set_position((done * 1000.0) as u64);
        bar.set_message(what.to_owned());
    };
    let image = integrate::render(&scene, &settings, backend, &report)?;
    bar.finish_and_clear();
    image.write_exr(&arguments.picture.output, arguments.allow_nonfinite)?;
    Ok(ExitCode::SUCCESS)
}
