//! `cloudparity measure findings`: where Cycles' pictures are not what light transport says.

use crate::base::error::Result;
use crate::bridge::releases::USUAL;
use crate::cli::resume::{ExperimentArguments, whole};
use crate::measure::findings::{Asked, measure};
use std::path::PathBuf;
use std::process::ExitCode;

/// Measure errors of the reference itself: each finding with its smallest scenes, closed forms of what is expected, and replicas by seed or by
/// disjoint subsets of samples.
///
/// Writes findings.json, .csv and .md, figures, and the scenes as .blend files. Exit status 1 where a claim does not hold.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity findings --only lobes,draine -o FINDINGS")]
pub(super) struct Arguments {
    /// Releases, by the numbers of their packages; another than Blender's own here gets an environment that is made when it is first asked for.
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = USUAL)]
    releases: Vec<String>,
    /// Findings, by name: order, expectation, marching, grids, learning, lobes, draine, majorants, overlaps; all if left out.
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    only: Vec<String>,
    /// Scenes of which it is measured, too, by the last release, how much of their references' error all seeds share.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    scenes: Vec<PathBuf>,
    /// Of scenes: width and height in pixels.
    #[arg(long, value_name = "WxH", default_value = "48x27", value_parser = super::picture::parse_resolution)]
    resolution: [u32; 2],
    /// The folder for the results.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    experiment: ExperimentArguments,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let Arguments { releases, only, output, experiment, .. } = arguments;
    let load = |path: &PathBuf| super::drift::of_size(path, arguments.resolution);
    let scenes = arguments.scenes.iter().map(load).collect::<Result<Vec<_>>>()?;
    let asked = Asked { releases: releases.clone(), only: only.clone() };
    let bar = super::progress_bar(1000);
    let progress = super::progress_on(&bar);
    let outcome = measure(asked, &scenes, output, &experiment.settings(), &progress)?;
    bar.finish_and_clear();
    let Some(findings) = whole(outcome) else { return Ok(ExitCode::SUCCESS) };
    super::print(&findings.markdown())?;
    findings.draw(output)?;
    let all = findings.left_out.is_empty() && findings.findings.iter().all(|finding| finding.confirmed);
    Ok(if all { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
