//! `cloudparity modes`: every node in every mode against live Cycles.

mod graphs;

use crate::base::error::Result;
use crate::base::files;
use crate::cli::choice::choice;
use crate::cli::resume::ResumeArguments;
use crate::gpu::Gpu;
use crate::measure::nodes::measurements::NodeErrors;
use crate::measure::nodes::suite;
use crate::measure::nodes::suite::{ModeComparison, Selection};
use crate::measure::nodes::{constants, folded_textures};
use crate::scene::Release;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Compare every mode of every node with live Cycles, on the CPU and in WGSL.
///
/// Exit status 0: all within their limits; 1: not so; 2: could not tell.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  cloudparity modes --node \"Voronoi Texture\"\n  cloudparity modes --graphs 500 -o GRAPHS"
)]
pub(super) struct Arguments {
    /// Points per mode (Voronoi Texture: two ninths of it).
    #[arg(long, value_name = "N", default_value_t = suite::POINTS)]
    points: usize,
    /// Seed of the values.
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    seed: u64,
    /// Only this node, by Blender's label: "Math", "Voronoi Texture".
    #[arg(long, value_name = "LABEL")]
    node: Option<String>,
    /// Compare our values of this release of Blender with its Cycles, which is fetched where it is not the usual one.
    #[arg(long, value_name = "RELEASE", value_parser = choice::<Release>(), default_value_t, conflicts_with = "graphs")]
    blender: Release,
    /// Only modes with outputs that jump (Voronoi Color and Position, Snap), at ordinary points.
    #[arg(long)]
    jumping: bool,
    /// Also measure how far Cycles' own AVX2 kernel is from its SSE4.2 kernel at the same points.
    #[arg(long)]
    avx2: bool,
    /// Leave the adapter, and with it the WGSL, out.
    #[arg(long)]
    without_gpu: bool,
    /// Instead compare every mode with constant inputs alone, this many sets of them: what Blender and Cycles fold.
    #[arg(long, value_name = "N", conflicts_with_all = ["graphs", "jumping", "avx2", "summary"])]
    constants: Option<usize>,
    /// Instead compare this many random graphs of 4 to 40 nodes: the CPU with Cycles, WGSL with the CPU, samples with bounds.
    /// Failing graphs are made small and saved.
    #[arg(long, value_name = "N", conflicts_with_all = ["node", "jumping", "avx2"])]
    graphs: Option<u64>,
    /// Stop the random graphs when this many have failed.
    #[arg(long, value_name = "K", requires = "graphs")]
    first: Option<usize>,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
    /// Also write the JSON to this file; with --graphs a folder, for graphs.json and for failing graphs.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Also write a line per mode to this file, as `parity/node-errors.json` holds them; with --node, only its lines change.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["graphs", "jumping"])]
    summary: Option<PathBuf>,
    #[command(flatten)]
    resume: ResumeArguments,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    super::need_bpy("the nodes are")?;
    if let Some(count) = arguments.graphs {
        return graphs::run(arguments, count);
    }
    if let Some(sets) = arguments.constants {
        return run_constants(arguments, sets);
    }
    let selection = if arguments.jumping { Selection::Jumping } else { Selection::Everything };
    let node = arguments.node.as_deref();
    let cases = suite::cases_of(arguments.blender, arguments.points, arguments.seed, node, selection)?;
    let gpu = if arguments.without_gpu { None } else { Some(Gpu::open()) };
    let opened = gpu.as_ref().and_then(|found| found.as_ref().ok());
    let bar = super::progress_bar(1000);
    let mut outcome = suite::ModeComparisons { rows: Vec::new(), blender: String::new() };
    for part in cases.chunks((POINTS_TOGETHER / arguments.points.max(1)).max(1)) {
        let found = suite::run(part, opened, arguments.avx2, super::report_to(&bar))?;
        outcome.rows.extend(found.rows);
        outcome.blender = found.blender;
    }
    bar.finish_and_clear();
    let json = serde_json::to_string_pretty(&outcome.rows).expect("rows serialise") + "\n";
    if let Some(path) = &arguments.output {
        files::write_atomically(path, json.as_bytes())?;
    }
    if let Some(path) = &arguments.summary {
        let adapter = opened.map(|gpu| format!("{} ({})", gpu.adapter().name, gpu.adapter().driver));
        let found = NodeErrors::of_rows(&outcome.rows, &outcome.blender, arguments.points, adapter);
        let summary = if arguments.node.is_some() && path.exists() {
            let mut known = NodeErrors::load(path)?;
            known.replace(found, &path.display().to_string(), &arguments.resume.resume())?;
            known
        } else {
            found
        };
        files::write_atomically(path, summary.to_text().as_bytes())?;
    }
    super::print(&if arguments.json { json } else { describe(&outcome.rows, &outcome.blender) })?;
    if let Some(Err(error)) = &gpu {
        eprintln!("left out: WGSL: {error}");
    }
    Ok(match (outcome.rows.iter().all(|row| row.pass), gpu) {
        (false, _) => ExitCode::FAILURE,
        (true, Some(Err(_))) => ExitCode::from(super::COULD_NOT),
        _ => ExitCode::SUCCESS,
    })
}

fn run_constants(arguments: &Arguments, sets: usize) -> Result<ExitCode> {
    let mut cases = constants::cases(sets.max(1), arguments.seed, arguments.node.as_deref(), arguments.blender)?;
    let bar = super::progress_bar(1000);
    let mut subjects: Vec<_> = cases.iter_mut().map(constants::Case::subject).collect();
    folded_textures::store_for(&mut subjects, super::report_to(&bar))?;
    let outcome = constants::run(&cases, super::report_to(&bar))?;
    bar.finish_and_clear();
    let json = serde_json::to_string_pretty(&outcome.rows).expect("rows serialise") + "\n";
    if let Some(path) = &arguments.output {
        files::write_atomically(path, json.as_bytes())?;
    }
    super::print(&if arguments.json { json } else { describe(&outcome.rows, &outcome.blender) })?;
    Ok(if outcome.rows.iter().all(|row| row.pass) { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Points of all modes that one Blender process evaluates: bounds its memory.
const POINTS_TOGETHER: usize = 2_000_000;

/// The rows that fail or are not equal, and the counts of the rest.
fn describe(rows: &[ModeComparison], blender: &str) -> String {
    let equal = rows.iter().filter(|row| row.cpu_differing == 0).count();
    let failed = rows.iter().filter(|row| !row.pass).count();
    let mut text = format!(
        "{} outputs of all modes against Cycles {blender} (sse42 kernel): {equal} equal on the CPU at every point, \
         {failed} beyond their limits\n",
        rows.len()
    );
    let notable = |row: &&ModeComparison| !row.pass || row.cpu_differing > 0 || row.wgsl_beyond.unwrap_or(0) > 0;
    for row in rows.iter().filter(notable) {
        write!(
            text,
            "  {} {} [{}] {}: cpu {} of {} differ, error {:.2e}, limit {:.1e}",
            if row.pass { "ok  " } else { "FAIL" },
            row.node,
            row.mode,
            row.output,
            row.cpu_differing,
            row.points,
            row.cpu_max_error,
            row.limit,
        )
        .expect("writing to a string cannot fail");
        if let (Some(error), Some(ulp), Some(beyond)) = (row.wgsl_max_error, row.wgsl_max_ulp, row.wgsl_beyond) {
            let (points, explained) = (row.wgsl_points.unwrap_or(0), row.wgsl_explained.unwrap_or(0));
            write!(
                text,
                "; WGSL error {error:.2e}, {ulp} ulp, {beyond} of {points} beyond {} ({explained} of them within their \
                 rounding bound)",
                row.wgsl_limit
            )
            .expect("writing to a string cannot fail");
        }
        if let Some(error) = row.avx2_max_error {
            write!(text, "; Cycles' AVX2 kernel {error:.2e}").expect("writing to a string cannot fail");
        }
        text.push('\n');
        for worst in [&row.cpu_worst, &row.wgsl_worst].into_iter().flatten() {
            writeln!(text, "       {worst}").expect("writing to a string cannot fail");
        }
    }
    text
}
