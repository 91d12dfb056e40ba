//! `cloudparity bench-quick`: has anything become slower?

use crate::base::error::{Error, Result};
use crate::base::identity::Identity;
use crate::base::ledger::to_json;
use crate::gpu::Gpu;
use crate::measure::speed::quick::{self, Baseline, Change, Compared, Row, Settings};
use crate::measure::timing;
use crate::scene::Scene;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::process::{Command, ExitCode};

/// Measure fields, bounds, path tracing and frames in minutes, each over a yardstick, beside a baseline.
///
/// Exit status 1 where something is slower than the baseline beyond chance. A baseline is of one kind of machine: on another one ratios differ for
/// reasons of their own, which is said.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  cloudparity bench-quick CLOUD.scene.json --baseline BASELINE.json
  cloudparity bench-quick CLOUD.scene.json --write-baseline BASELINE.json --rounds 8")]
pub(super) struct Arguments {
    /// The scene file.
    scene: PathBuf,
    /// What to compare with.
    #[arg(long, value_name = "FILE", conflicts_with = "write_baseline")]
    baseline: Option<PathBuf>,
    /// Write a baseline of this machine and build.
    #[arg(long, value_name = "FILE")]
    write_baseline: Option<PathBuf>,
    /// Rounds of a baseline, each a process of its own; their spread is the baseline's.
    #[arg(long, value_name = "N", default_value_t = 8, requires = "write_baseline", value_parser = clap::value_parser!(u32).range(2..=100))]
    rounds: u32,
    /// Repetitions; the median counts.
    #[arg(long, value_name = "N", default_value_t = 15, value_parser = clap::value_parser!(u32).range(3..=1000))]
    repeats: u32,
    /// Have a workload do a part more than it should, such as "field, tiles=0.2": to see that it is found.
    #[arg(long, value_name = "NAME=PART")]
    plant: Option<String>,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = Scene::load(&arguments.scene)?;
    let planted = arguments.plant.as_deref().map(|text| {
        let found = text.rsplit_once('=').and_then(|(name, part)| Some((name, part.parse::<f64>().ok()?)));
        found.ok_or_else(|| Error::new("--plant", format!("\"{text}\""), "NAME=PART", "Correct the option."))
    });
    let settings = Settings { repeats: arguments.repeats, planted: planted.transpose()? };
    let baseline = arguments.baseline.as_ref().map(|path| Baseline::load(path, &scene)).transpose()?;
    let adapter = Gpu::open().ok().map(|gpu| gpu.adapter().name.clone());
    let bar = super::progress_bar(1000);
    let progress = super::progress_on(&bar);
    if let Some(path) = &arguments.write_baseline {
        let rounds = (0..arguments.rounds)
            .map(|round| {
                progress(f64::from(round) / f64::from(arguments.rounds), "rounds");
                arguments.round()
            })
            .collect::<Result<Vec<_>>>()?;
        bar.finish_and_clear();
        Baseline::of(&rounds, &scene, adapter)?.write(path)?;
        super::print(&format!("{}: {} workloads, {} rounds\n", path.display(), rounds[0].len(), rounds.len()))?;
        return Ok(ExitCode::SUCCESS);
    }
    let rows = quick::run(&scene, &settings, &progress)?;
    bar.finish_and_clear();
    let machine = timing::machine();
    if let Some(baseline) = &baseline
        && (baseline.machine != machine || baseline.adapter != adapter)
    {
        eprintln!(
            "note: the baseline is of another machine ({}), whose ratios differ for reasons of their own",
            baseline.machine
        );
    }
    let found: Vec<Compared> = rows.into_iter().map(|row| row.beside(baseline.as_ref())).collect();
    super::print(&if arguments.json {
        to_json(&json!({"build": Identity::current(), "machine": machine, "adapter": adapter, "rows": found}))
    } else {
        table(&found)
    })?;
    let is_slower = found.iter().any(|one| one.verdict == Change::Slower);
    Ok(if is_slower { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

impl Arguments {
    /// A round in a process of its own: where its memory lies is part of what differs from one run to the next.
    fn round(&self) -> Result<Vec<Row>> {
        let failed = |cause: String| {
            Error::new("a round of the baseline", cause, "a run of bench-quick that ends", "Run it alone to see why.")
        };
        let program = std::env::current_exe().map_err(|cause| failed(cause.to_string()))?;
        let output = Command::new(program)
            .arg("bench-quick")
            .arg(&self.scene)
            .args(["--json", "--repeats", &self.repeats.to_string()])
            .output()
            .map_err(|cause| failed(cause.to_string()))?;
        if !output.status.success() {
            return Err(failed(String::from_utf8_lossy(&output.stderr).trim().to_owned()));
        }
        let mut found: Value = serde_json::from_slice(&output.stdout).map_err(|cause| failed(cause.to_string()))?;
        serde_json::from_value(found["rows"].take()).map_err(|cause| failed(cause.to_string()))
    }
}

fn table(rows: &[Compared]) -> String {
    let mut text = format!(
        "{:<28}{:>10}{:>12}{:>10}{:>14}{:>9}  {}\n",
        "workload", "ms", "ratio", "+-", "baseline", "change", "verdict"
    );
    for Compared { row, baseline, change, verdict } in rows {
        let then =
            baseline.as_ref().map_or_else(|| "-".to_owned(), |then| format!("{:.3}({:.3})", then.ratio, then.spread));
        let change = change.map_or_else(|| "-".to_owned(), |change| format!("{:+.1} %", 100.0 * change));
        text += &format!(
            "{:<28}{:>10.1}{:>12.3}{:>10.3}{:>14}{:>9}  {verdict}\n",
            row.what,
            1e3 * row.seconds,
            row.ratio,
            row.standard_error,
            then,
            change
        );
    }
    text + "Ratios of processor time to that of a fixed piece of arithmetic; +- is a standard error, in brackets the spread of the baseline's rounds.\n"
}
