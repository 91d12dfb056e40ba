//! `cloudparity bench-bake`: speed of the Perlin-FBM bake.

use crate::base::error::Result;
use crate::base::identity::Identity;
use crate::gpu::Gpu;
use crate::measure::speed::perlin_fbm;
use std::process::ExitCode;

/// Measure the bake of the Perlin-FBM cloud beside a straightforward one: byte-exact, in single precision, and on the adapter.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity bench-bake --texels 96")]
pub(super) struct Arguments {
    /// Texels per axis.
    #[arg(long, default_value_t = 96, value_parser = clap::value_parser!(u32).range(2..=256))]
    texels: u32,
    /// Repetitions; the median counts.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=100))]
    repeats: u32,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let gpu = Gpu::open().ok();
    let bar = super::progress_bar(1000);
    let progress = super::progress_on(&bar);
    let rows = perlin_fbm::run(arguments.texels as usize, arguments.repeats as usize, gpu.as_ref(), &progress)?;
    bar.finish_and_clear();
    let adapter = gpu.as_ref().map_or("none", |gpu| gpu.adapter().name.as_str());
    if arguments.json {
        let result = serde_json::json!({ "builds": [Identity::current()], "texels": arguments.texels, "adapter": adapter, "rows": rows });
        super::print(&(serde_json::to_string_pretty(&result).expect("figures serialise") + "\n"))?;
        return Ok(ExitCode::SUCCESS);
    }
    let mut text = format!("{:<34}{:>10}{:>8}{:>12}{:>10}\n", "bake", "seconds", "ratio", "differing", "largest");
    for row in &rows {
        text += &format!(
            "{:<34}{:>10.3}{:>8.1}{:>12}{:>10}\n",
            row.what, row.seconds, row.ratio, row.differing, row.largest_difference
        );
    }
    text +=
        &format!("{}^3 texels, wall time, median of {}. Adapter: {adapter}.\n", arguments.texels, arguments.repeats);
    super::print(&text)?;
    Ok(ExitCode::SUCCESS)
}
