//! `cloudparity reference`: the picture of a scene by Cycles, rendered once.

use super::picture::PictureArguments;
use crate::blender::reference::{ReferenceSettings, cache_folder, reference};
use crate::blender::report_to;
use crate::error::{Error, Result};
use crate::files;
use std::process::ExitCode;

/// Render a scene with Cycles under the settings of a comparison; the same request is rendered once.
#[derive(clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    picture: PictureArguments,
    /// Samples per pixel.
    #[arg(long, default_value_t = ReferenceSettings::default().samples)]
    samples: u32,
    /// Seed; other seeds give independent replicas.
    #[arg(long, default_value_t = ReferenceSettings::default().seed)]
    seed: u32,
    /// Ray marching instead of null collision.
    #[arg(long)]
    volume_biased: bool,
    /// Factor on the step of ray marching.
    #[arg(long, default_value_t = ReferenceSettings::default().step_rate)]
    step_rate: f64,
    /// Threads; 0 takes all.
    #[arg(long, default_value_t = ReferenceSettings::default().threads)]
    threads: u32,
    /// Write all passes as parts of one file.
    #[arg(long)]
    multilayer: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = arguments.picture.load()?;
    let settings = ReferenceSettings {
        samples: arguments.samples,
        seed: arguments.seed,
        volume_biased: arguments.volume_biased,
        step_rate: arguments.step_rate,
        threads: arguments.threads,
        multilayer: arguments.multilayer,
    };
    let bar = super::progress_bar(1000);
    let found = reference(&scene, &settings, &cache_folder()?, report_to(&bar))?;
    bar.finish_and_clear();
    let bytes = std::fs::read(&found.path).map_err(|cause| Error::io(&found.path, "the cached reference", &cause))?;
    files::write_atomically(&arguments.picture.output, &bytes)?;
    let source = if found.cached { "from the cache" } else { "rendered" };
    super::print(&format!("{} {source} ({})\n", arguments.picture.output.display(), found.key))?;
    Ok(ExitCode::SUCCESS)
}
