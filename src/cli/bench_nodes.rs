//! `cloudparity bench-nodes`: what every node costs, beside Cycles.

use crate::base::error::Result;
use crate::bridge;
use crate::cli::resume::ResumeArguments;
use crate::gpu::Gpu;
use crate::measure::nodes::costs;
use crate::measure::nodes::costs::{Costs, Settings};
use std::path::PathBuf;
use std::process::ExitCode;

/// Measure nanoseconds per point of every node in every mode: f32 and f64 on one thread, WGSL, and Cycles on one thread, in one run.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity bench-nodes --node Math")]
pub(super) struct Arguments {
    /// Write the rows here as they come; those that the file holds are not measured again.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Only this node, by Blender's label: "Math", "Voronoi Texture".
    #[arg(long, value_name = "LABEL")]
    node: Option<String>,
    /// Only modes whose words, as the table shows them, hold this text: "MINKOWSKI".
    #[arg(long, value_name = "TEXT")]
    mode: Option<String>,
    /// Points at most, of which Cycles evaluates each several times; modes that cost much get fewer.
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(1024..=1_048_576))]
    points: u32,
    /// Repetitions; the least time counts (of WGSL, the median).
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=100))]
    repeats: u32,
    /// Leave the adapter, and with it the WGSL, out.
    #[arg(long)]
    without_gpu: bool,
    /// Leave Cycles out.
    #[arg(long)]
    without_cycles: bool,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    resume: ResumeArguments,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let with_cycles = !arguments.without_cycles && bridge::has_bpy();
    if !with_cycles && !arguments.without_cycles {
        eprintln!("warning: bpy is missing: Cycles is not measured, so there are no ratios (make setup installs it)");
    }
    let gpu = if arguments.without_gpu { None } else { Some(Gpu::open()) };
    if let Some(Err(error)) = &gpu {
        eprintln!("left out: WGSL: {error}");
    }
    let settings = Settings {
        points: arguments.points as usize,
        repeats: arguments.repeats as usize,
        node: arguments.node.clone(),
        mode: arguments.mode.clone(),
        with_cycles,
        resume: arguments.resume.resume(),
    };
    let bar = super::progress_bar(1000);
    let opened = gpu.as_ref().and_then(|found| found.as_ref().ok());
    let found = costs::run(&settings, opened, arguments.output.as_deref(), &|done, what| {
        bar.set_position((done * 1000.0) as u64);
        bar.set_message(what.to_owned());
    })?;
    bar.finish_and_clear();
    super::print(&if arguments.json {
        serde_json::to_string_pretty(&found).expect("figures serialise") + "\n"
    } else {
        table(&found)
    })?;
    Ok(ExitCode::SUCCESS)
}

fn table(costs: &Costs) -> String {
    let show = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.1}"));
    let mut text = format!(
        "{:<22}{:>10}{:>10}{:>10}{:>10}{:>8}{:>8}  {}\n",
        "ns per point", "f32", "f64", "WGSL", "Cycles", "spread", "ratio", "mode"
    );
    for row in &costs.rows {
        text += &format!(
            "{:<22}{:>10}{:>10}{:>10}{:>10}{:>8}{:>8}  {}\n",
            row.node,
            show(Some(row.cloudparity_ns)),
            show(Some(row.oracle_ns)),
            show(row.wgsl_ns),
            show(row.cycles_ns),
            show(row.cycles_spread_ns),
            show(row.ratio),
            row.mode
        );
    }
    text + &format!(
        "{}. f32, f64 and Cycles on one thread; Cycles without what its render costs for the same graph without the node. \
         The least of {}.\n",
        costs.machine, costs.repeats
    )
}
