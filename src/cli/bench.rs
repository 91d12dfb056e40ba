//! `cloudparity bench`: speed beside Cycles, in one run.

use crate::base::error::Result;
use crate::base::files;
use crate::base::identity::Identity;
use crate::gpu::Gpu;
use crate::measure::speed;
use crate::measure::speed::Settings;
use crate::report::inputs::Bench;
use crate::scene::Scene;
use std::path::PathBuf;
use std::process::ExitCode;

/// Measure the evaluators' rates beside Cycles' on the same points.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity bench CLOUD.scene.json")]
pub(super) struct Arguments {
    /// The scene file.
    scene: PathBuf,
    /// Points of the larger sample.
    #[arg(long, value_name = "N", default_value_t = 500_000, value_parser = clap::value_parser!(u32).range(1000..=20_000_000))]
    points: u32,
    /// Repetitions; the median counts.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=100))]
    repeats: u32,
    /// Leave Cycles out.
    #[arg(long)]
    without_cycles: bool,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
    /// Also write the JSON to this file.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = Scene::load(&arguments.scene)?;
    let with_cycles = !arguments.without_cycles && speed::can_ask_cycles();
    if !with_cycles && !arguments.without_cycles {
        eprintln!("warning: bpy is missing: Cycles is not measured, so there are no ratios (make setup installs it)");
    }
    let settings = Settings { points: arguments.points as usize, repeats: arguments.repeats as usize, with_cycles };
    let bar = super::progress_bar(1000);
    let rows = speed::run(&scene, &settings, &|done, what| {
        bar.set_position((done * 1000.0) as u64);
        bar.set_message(what.to_owned());
    })?;
    bar.finish_and_clear();
    let adapter = Gpu::open()
        .map_or(serde_json::Value::Null, |gpu| serde_json::to_value(gpu.adapter()).expect("an adapter serialises"));
    let result = Bench { builds: vec![Identity::current().clone()], adapter, rows };
    let json = serde_json::to_string_pretty(&result).expect("figures serialise") + "\n";
    if let Some(path) = &arguments.output {
        files::write_atomically(path, json.as_bytes())?;
    }
    super::print(&if arguments.json { json } else { table(&result) })?;
    Ok(ExitCode::SUCCESS)
}

fn table(bench: &Bench) -> String {
    let rate = |value: Option<f64>| value.map_or("-".to_owned(), |rate| format!("{:.3}", rate / 1e6));
    let ratio = |value: Option<f64>| value.map_or("-".to_owned(), |ratio| format!("{ratio:.1}"));
    let mut text = format!(
        "{:<24}{:>10}{:>14}{:>12}{:>12}{:>12}{:>13}\n",
        "million points/s", "points", "Cycles", "CPU", "WGSL", "CPU ratio", "WGSL ratio"
    );
    for row in &bench.rows {
        text += &format!(
            "{:<24}{:>10}{:>14}{:>12}{:>12}{:>12}{:>13}\n",
            row.what,
            row.points.unwrap_or(0),
            rate(row.cycles_rate),
            rate(row.cpu_rate),
            rate(row.gpu_rate),
            ratio(row.cpu_ratio),
            ratio(row.gpu_ratio)
        );
    }
    for row in &bench.rows {
        let (Some(kernel), Some(limits)) = (row.kernel_rate, row.limits) else { continue };
        text += &format!(
            "{}, by the adapter's own clock: {:.0} million points/s, {:.1} % of what it reads and writes ({:.0}); a point takes the time of {:.0} integer \
             multiply-adds (of {:.1} x 10^12 a second) or {:.0} of f32 ({:.1} x 10^12)\n",
            row.what,
            kernel / 1e6,
            100.0 * kernel / limits.points,
            limits.points / 1e6,
            limits.integer_multiply_adds / kernel,
            limits.integer_multiply_adds / 1e12,
            limits.float_multiply_adds / kernel,
            limits.float_multiply_adds / 1e12,
        );
    }
    let adapter = bench.adapter["name"].as_str().unwrap_or("none");
    text + &format!(
        "Adapter: {adapter}. Rates are slopes between two point counts; Cycles' is without what its render costs for an empty graph.\n"
    )
}
