//! `cloudparity measure variance`: where the variance of path tracing comes from.

use crate::base::error::Result;
use crate::base::files;
use crate::base::ledger::to_json;
use crate::cli::choice::choice;
use crate::cli::picture::SceneArguments;
use crate::integrators::path::Tracking;
use crate::measure::speed::variance::{self, Settings};
use std::path::PathBuf;
use std::process::ExitCode;

/// Measure where the variance of path tracing comes from: film, distances, transmittance, direction, light, each drawn again with the rest kept.
///
/// Seven pictures on the CPU for each replica, so take a small --resolution. A share is a total effect: what a perfect decision would take away at
/// most. Shares add up to the whole or more, since decisions act together.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity variance CLOUD.scene.json --resolution 96x54")]
pub(super) struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// Samples per pixel of each picture: those of a pixel are stratified.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=65536))]
    samples: u32,
    /// Replicas of each way of drawing, which give the standard errors.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(2..=1000))]
    replicas: u32,
    /// How rays find their collisions.
    #[arg(long, value_parser = choice::<Tracking>(), default_value_t = Tracking::Proven)]
    tracking: Tracking,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
    /// Also write the JSON to this file.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = arguments.scene.load()?;
    let &Arguments { samples, replicas, tracking, .. } = arguments;
    let bar = super::progress_bar(1000);
    let found = variance::run(&scene, Settings { samples, replicas, tracking }, &super::progress_on(&bar))?;
    bar.finish_and_clear();
    let json = to_json(&found);
    if let Some(path) = &arguments.output {
        files::write_atomically(path, json.as_bytes())?;
    }
    super::print(&if arguments.json { json } else { found.table() })?;
    Ok(ExitCode::SUCCESS)
}
