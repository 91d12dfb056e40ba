//! `cloudparity measure drift`: what other releases of Blender make of the same nodes.

use crate::base::error::Result;
use crate::bridge::releases::RELEASES;
use crate::cli::resume::{ExperimentArguments, whole};
use crate::measure::nodes::drift::{Asked, measure};
use std::path::PathBuf;
use std::process::ExitCode;

/// Compare every mode of every node with several releases of Blender, each by its own Cycles, at equal points.
///
/// A release gets an environment of its own, made when it is first asked for: some 400 MB are fetched from the Python package index. Writes
/// drift.json and the table drift.md. A release that cannot be had is left out with the reason; exit status 2 then.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity drift --releases 4.2.23,4.5.15 -o DRIFT")]
pub(super) struct Arguments {
    /// Releases, by the numbers of their packages.
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_values = RELEASES)]
    releases: Vec<String>,
    /// Points per mode (Voronoi Texture: two ninths of it).
    #[arg(long, value_name = "N", default_value_t = 1152)]
    points: usize,
    /// Seed of the values.
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    seed: u64,
    /// Only this node, by Blender's label: "Math", "Voronoi Texture".
    #[arg(long, value_name = "LABEL")]
    node: Option<String>,
    /// The folder for the results.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    experiment: ExperimentArguments,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let Arguments { releases, points, seed, node, output, experiment } = arguments;
    let asked = Asked { releases: releases.clone(), points: *points, seed: *seed, node: node.clone() };
    let bar = super::progress_bar(1000);
    let progress = super::progress_on(&bar);
    let outcome = measure(asked, output, &experiment.settings(), &progress)?;
    bar.finish_and_clear();
    let Some(drift) = whole(outcome) else { return Ok(ExitCode::SUCCESS) };
    super::print(&drift.summary())?;
    Ok(if drift.left_out.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(super::COULD_NOT) })
}
