//! `cloudparity modes`: every node in every mode against live Cycles.

use crate::error::Result;
use crate::field::random_graphs;
use crate::field::suite::{self, Row, Selection};
use crate::files;
use crate::gpu::Gpu;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Compare every mode of every node with live Cycles, on the CPU and in WGSL.
///
/// Exit status 0: all within their limits; 1: not so; 2: could not tell.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Points per mode (Voronoi Texture: two ninths of it).
    #[arg(long, default_value_t = suite::POINTS)]
    points: usize,
    /// Seed of the values.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only this node, by Blender's label: "Math", "Voronoi Texture".
    #[arg(long, value_name = "NAME")]
    node: Option<String>,
    /// Only modes with outputs that jump (Voronoi Color and Position, Snap), at ordinary points.
    #[arg(long)]
    jumping: bool,
    /// Also measure how far Cycles' own AVX2 kernel is from its SSE4.2 kernel at the same points.
    #[arg(long)]
    avx2: bool,
    /// Leave the WGSL out.
    #[arg(long)]
    cpu_only: bool,
    /// Instead compare this many random graphs of 4 to 20 nodes, on the CPU.
    #[arg(long, value_name = "N")]
    graphs: Option<u64>,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
    /// Also write the JSON to this file.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    super::need_bpy("the nodes are")?;
    if let Some(count) = arguments.graphs {
        return run_graphs(arguments, count);
    }
    let selection = if arguments.jumping { Selection::Jumping } else { Selection::Everything };
    let cases = suite::cases(arguments.points, arguments.seed, arguments.node.as_deref(), selection)?;
    let gpu = if arguments.cpu_only { None } else { Some(Gpu::open()) };
    let opened = gpu.as_ref().and_then(|found| found.as_ref().ok());
    let bar = super::progress_bar(1000);
    let mut outcome = suite::Outcome { rows: Vec::new(), blender: String::new() };
    for part in cases.chunks((POINTS_TOGETHER / arguments.points.max(1)).max(1)) {
        let found = suite::run(part, opened, arguments.avx2, crate::blender::report_to(&bar))?;
        outcome.rows.extend(found.rows);
        outcome.blender = found.blender;
    }
    bar.finish_and_clear();
    let json = serde_json::to_string_pretty(&outcome.rows).expect("rows serialise") + "\n";
    if let Some(path) = &arguments.output {
        files::write_atomically(path, json.as_bytes())?;
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

/// Points of all modes that one Blender process evaluates: bounds its memory.
const POINTS_TOGETHER: usize = 2_000_000;

/// Points per random graph.
const GRAPH_POINTS: usize = 256;

fn run_graphs(arguments: &Arguments, count: u64) -> Result<ExitCode> {
    let seeds = arguments.seed..arguments.seed.saturating_add(count);
    let graphs = seeds.map(|seed| random_graphs::generate(seed, GRAPH_POINTS)).collect::<Result<Vec<_>>>()?;
    let bar = super::progress_bar(1000);
    let folder = PathBuf::from("failed-graphs");
    let outcomes = random_graphs::run(&graphs, &folder, crate::blender::report_to(&bar))?;
    bar.finish_and_clear();
    let json = serde_json::to_string_pretty(&outcomes).expect("outcomes serialise") + "\n";
    if let Some(path) = &arguments.output {
        files::write_atomically(path, json.as_bytes())?;
    }
    let failed: Vec<_> = outcomes.iter().filter(|outcome| !outcome.pass).collect();
    let exact = outcomes.iter().filter(|outcome| outcome.differing == 0).count();
    let library = outcomes.iter().filter(|outcome| outcome.library).count();
    let mut text = format!(
        "{} random graphs ({library} call the C library): {exact} equal at every point, {} beyond their limits\n",
        outcomes.len(),
        failed.len()
    );
    for outcome in &failed {
        writeln!(
            text,
            "  FAIL seed {}: {} of {} values differ; {}; saved as {}",
            outcome.seed,
            outcome.differing,
            outcome.values,
            outcome.first.as_deref().unwrap_or_default(),
            outcome.saved.as_deref().unwrap_or(&folder).display()
        )
        .expect("writing to a string cannot fail");
    }
    super::print(if arguments.json { &json } else { &text })?;
    Ok(if failed.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The rows that fail or are not equal, and the counts of the rest.
fn describe(rows: &[Row], blender: &str) -> String {
    let equal = rows.iter().filter(|row| row.cpu_differing == 0).count();
    let failed = rows.iter().filter(|row| !row.pass).count();
    let mut text = format!(
        "{} outputs of all modes against Cycles {blender} (sse42 kernel): {equal} equal on the CPU at every point, \
         {failed} beyond their limits\n",
        rows.len()
    );
    let notable = |row: &&Row| !row.pass || row.cpu_differing > 0 || row.wgsl_beyond.unwrap_or(0) > 0;
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
