//! The options of the deterministic integrator, for every command that marches.

use super::choice::choice;
use crate::base::choice::Choice;
use crate::base::error::{Error, Result};
use crate::integrators::{Jitter, LightMode, MarchSettings};
use crate::media::density_cache::{CacheFilter, CacheFormat, CacheSettings};
use crate::media::transfer::Integration;

/// What only `--integrator march` takes. Without a value the default holds.
#[derive(clap::Args)]
pub(super) struct MarchArguments {
    /// march: longest step of a view ray in metres; 0: 1/192 of the medium's mean side [default: 0].
    #[arg(long, value_name = "METRES")]
    view_step: Option<f64>,
    /// march: longest step of a shadow ray in metres, with --shadows exact; 0: the view step [default: 0].
    #[arg(long, value_name = "METRES")]
    shadow_step: Option<f64>,
    /// march: how a step adds up [default: energy-conserving].
    #[arg(long, value_parser = choice::<Integration>())]
    integration: Option<Integration>,
    /// march: where within its steps a ray evaluates the medium, none or pixel, with --seed; engine: none, table or blue-noise
    /// [default: none].
    #[arg(long, value_name = "NAME")]
    pub(super) jitter: Option<String>,
    /// march: directions of the quadrature over the world [default: 64].
    #[arg(long, value_name = "N")]
    world_directions: Option<u32>,
    /// march: bands of spherical harmonics for the world in anisotropic media, with --shadows grid [default: 2].
    #[arg(long, value_name = "N")]
    world_bands: Option<u32>,
    /// march, engine: rays per pixel and axis [default: 3; of engine: 1].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    pub(super) sub_pixels: Option<u32>,
    /// march: view rays end below this transmittance [default: 0.0001].
    #[arg(long, value_name = "TRANSMITTANCE")]
    exit_transmittance: Option<f64>,
    /// march: how light reaches the samples: by a shadow ray from each, or by a grid of them [default: grid].
    #[arg(long, value_parser = choice::<LightMode>())]
    shadows: Option<LightMode>,
    /// march: cells along the longest side of the grid of --shadows grid [default: 192].
    #[arg(long, value_name = "CELLS")]
    shadow_cells: Option<u32>,
    /// march: view and shadow densities from a grid with so many cells along its longest side, instead of the graph.
    #[arg(long, value_name = "CELLS")]
    density_cache: Option<u32>,
    /// march: how the density cache stores its values [default: f16].
    #[arg(long, value_parser = choice::<CacheFormat>(), requires = "density_cache")]
    cache_format: Option<CacheFormat>,
    /// march: how the density cache is read [default: trilinear].
    #[arg(long, value_parser = choice::<CacheFilter>(), requires = "density_cache")]
    cache_filter: Option<CacheFilter>,
    /// march: leave nothing out that the scene does not need; slower, the same picture.
    #[arg(long)]
    generic: bool,
}

/// The value of an option that several integrators have, each with names of its own.
pub(super) fn named<T: Choice>(option: &str, name: Option<&str>) -> Result<Option<T>> {
    let Some(name) = name else { return Ok(None) };
    T::named(name).map(Some).ok_or_else(|| {
        let known: Vec<&str> = T::VARIANTS.iter().map(|value| value.name()).collect();
        Error::new(
            option,
            format!("\"{name}\""),
            format!("one of {} with this integrator", known.join(", ")),
            "Correct the option, or give another --integrator.",
        )
    })
}

impl MarchArguments {
    /// Options by name, and whether each is given.
    pub(super) fn given(&self) -> [(&'static str, bool); 14] {
        [
            ("--view-step", self.view_step.is_some()),
            ("--shadow-step", self.shadow_step.is_some()),
            ("--integration", self.integration.is_some()),
            ("--jitter", self.jitter.is_some()),
            ("--world-directions", self.world_directions.is_some()),
            ("--world-bands", self.world_bands.is_some()),
            ("--sub-pixels", self.sub_pixels.is_some()),
            ("--exit-transmittance", self.exit_transmittance.is_some()),
            ("--shadows", self.shadows.is_some()),
            ("--shadow-cells", self.shadow_cells.is_some()),
            ("--density-cache", self.density_cache.is_some()),
            ("--cache-format", self.cache_format.is_some()),
            ("--cache-filter", self.cache_filter.is_some()),
            ("--generic", self.generic),
        ]
    }

    /// The settings, those without an option as in `default`.
    pub(super) fn settings(&self, default: MarchSettings, seed: Option<u32>) -> Result<MarchSettings> {
        let jitter = named("--jitter", self.jitter.as_deref())?.unwrap_or(default.jitter);
        if seed.is_some() && jitter == Jitter::None {
            return Err(Error::new(
                "--seed",
                "no random numbers to choose",
                "--seed only with --jitter pixel or --integrator path",
                "Leave --seed out, or give --jitter pixel.",
            ));
        }
        let cache = CacheSettings::default();
        Ok(MarchSettings {
            view_step: self.view_step.unwrap_or(default.view_step),
            shadow_step: self.shadow_step.unwrap_or(default.shadow_step),
            world_directions: self.world_directions.unwrap_or(default.world_directions),
            world_bands: self.world_bands.unwrap_or(default.world_bands),
            sub_pixels: self.sub_pixels.unwrap_or(default.sub_pixels),
            exit_transmittance: self.exit_transmittance.unwrap_or(default.exit_transmittance),
            light: self.shadows.unwrap_or(default.light),
            grid_cells: self.shadow_cells.unwrap_or(default.grid_cells),
            integration: self.integration.unwrap_or(default.integration),
            jitter,
            seed: seed.unwrap_or(default.seed),
            density_cache: self.density_cache.map(|cells| CacheSettings {
                cells,
                format: self.cache_format.unwrap_or(cache.format),
                filter: self.cache_filter.unwrap_or(cache.filter),
            }),
            specialise: default.specialise && !self.generic,
        })
    }
}
