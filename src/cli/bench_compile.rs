//! `cloudparity bench-compile`: how long kernels take to compile.

use crate::base::error::Result;
use crate::base::files;
use crate::base::identity::Identity;
use crate::gpu::Gpu;
use crate::measure::speed::compile_times;
use crate::measure::speed::compile_times::CompileTime;
use crate::scene::Scene;
use std::path::PathBuf;
use std::process::ExitCode;

/// Measure how long the kernels of scenes take to compile (graph, linking, naga, pipeline), beside the first scene's.
///
/// Scenes without kernels, which are rendered on the CPU only, are named and left out. Some adapters make their machine code only
/// when a kernel first runs (Mesa's llvmpipe): their pipelines seem to cost little.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity bench-compile CLOUD.scene.json OTHER.scene.json")]
pub(super) struct Arguments {
    /// The scene files; the first one is what the others are compared with.
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// Repetitions; the median counts.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=100))]
    repeats: u32,
    /// Leave the adapter, and with it its pipelines, out.
    #[arg(long)]
    without_gpu: bool,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
    /// Also write the JSON to this file.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scenes = arguments.scenes.iter().map(|path| Scene::load(path)).collect::<Result<Vec<_>>>()?;
    let mut with_kernels = Vec::new();
    for scene in scenes {
        match compile_times::density(&scene) {
            Ok(_) => with_kernels.push(scene),
            // Without the first scene there is nothing to compare with.
            Err(error) if with_kernels.is_empty() => return Err(error),
            Err(error) => eprintln!("left out: {}: no kernels: {error}", scene.name),
        }
    }
    let scenes = with_kernels;
    let gpu = if arguments.without_gpu { None } else { Some(Gpu::open()) };
    if let Some(Err(error)) = &gpu {
        eprintln!("left out: pipelines: {error}");
    }
    let opened = gpu.as_ref().and_then(|found| found.as_ref().ok());
    let repeats = arguments.repeats as usize;
    let bar = super::progress_bar(1000);
    let rows = compile_times::run(&scenes, repeats, opened, &|done, what| {
        bar.set_position((done * 1000.0) as u64);
        bar.set_message(what.to_owned());
    })?;
    bar.finish_and_clear();
    let adapter = opened.map_or("none", |gpu| gpu.adapter().name.as_str());
    let result =
        serde_json::json!({"builds": [Identity::current()], "adapter": adapter, "repeats": repeats, "rows": rows});
    let json = serde_json::to_string_pretty(&result).expect("figures serialise") + "\n";
    if let Some(path) = &arguments.output {
        files::write_atomically(path, json.as_bytes())?;
    }
    super::print(&if arguments.json { json } else { table(&rows, adapter, repeats) })?;
    Ok(ExitCode::SUCCESS)
}

fn table(rows: &[CompileTime], adapter: &str, repeats: usize) -> String {
    let mut text = format!(
        "{:<30}{:<8}{:>6}{:>10}{:>9}{:>9}{:>9}{:>10}{:>10}{:>8}\n",
        "milliseconds", "kernel", "nodes", "bytes", "graph", "link", "naga", "pipeline", "total", "ratio"
    );
    for row in rows {
        text += &format!(
            "{:<30}{:<8}{:>6}{:>10}{:>9.1}{:>9.1}{:>9.1}{:>10}{:>10.1}{:>8.2}\n",
            row.scene,
            row.kernel,
            row.instructions,
            row.bytes,
            row.graph_ms,
            row.link_ms,
            row.validate_ms,
            row.pipeline_ms.map_or("-".to_owned(), |time| format!("{time:.1}")),
            row.total_ms,
            row.ratio
        );
    }
    text + &format!(
        "Medians of {repeats}, each of a text that no cache holds. Adapter: {adapter}. Ratios: totals over the first scene's.\n"
    )
}
