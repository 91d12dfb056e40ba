//! `cloudparity measure growth`: how time and memory grow.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::ledger::to_json;
use crate::cli::choice::choice;
use crate::cli::resume::{ExperimentArguments, whole};
use crate::gpu::Backend;
use crate::measure::speed::growth::{self, Ladder, Once, Quantity, Rung, Settings};
use crate::scene::Scene;
use std::path::PathBuf;
use std::process::{Command, ExitCode};

/// Measure how time and memory of path tracing grow with pixels, samples, bounces, objects, the size of the scene, threads, and stored numbers.
///
/// Each rung of each ladder is a process of its own on all cores, so nothing else should run. Writes growth.json and the figure
/// (growth.svg, .png, .pdf), and prints the table; what was interrupted goes on.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  cloudparity growth CLOUD.scene.json -o GROWTH
  cloudparity growth CLOUD.scene.json --ladder objects=1,10,100,1000 -o GROWTH
  cloudparity growth CLOUD.scene.json --ladder \"Density=1,10,100\" -o GROWTH
  cloudparity growth CLOUD.scene.json --ladder width=16,32,64 --backend gpu -o GROWTH-ON-THE-ADAPTER")]
pub(super) struct Arguments {
    /// The scene file.
    scene: PathBuf,
    /// The folder for the results.
    #[arg(short, long, value_name = "DIR", default_value = "out/growth")]
    output: PathBuf,
    /// A ladder, instead of all: width, samples, bounces, objects (copies in the object's box), size (lengths, at the same optical thickness),
    /// threads, or a stored number named as for --set. May be given several times.
    #[arg(long, value_name = "NAME=VALUES")]
    ladder: Vec<String>,
    /// Pixels along the longer side, where they do not grow.
    #[arg(long, value_name = "PIXELS", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=16384))]
    width: u32,
    /// Samples per pixel, where they do not grow.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=65536))]
    samples: u32,
    /// Repetitions; the median counts.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100))]
    repeats: u32,
    /// Where it runs.
    #[arg(long, value_parser = choice::<Backend>(), default_value_t = Backend::Cpu)]
    backend: Backend,
    #[command(flatten)]
    experiment: ExperimentArguments,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
    /// Measure one rung, given as JSON, in this process.
    #[arg(long, hide = true, value_name = "JSON")]
    rung: Option<String>,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = Scene::load(&arguments.scene)?;
    if let Some(text) = &arguments.rung {
        let rung: Rung = serde_json::from_str(text)
            .map_err(|cause| Error::new("the rung", cause.to_string(), "a rung as JSON", "Leave the option out."))?;
        super::print(&to_json(&rung.measure(&scene)?))?;
        return Ok(ExitCode::SUCCESS);
    }
    let Arguments { width, samples, repeats, backend, .. } = *arguments;
    let settings = Settings { width, samples, repeats, backend };
    let mut ladders = arguments.ladders()?;
    if arguments.ladder.is_empty() {
        ladders.retain(|ladder| match ladder.check(&scene, settings) {
            Err(error) if ladder.quantity == Quantity::Size => {
                eprintln!("left out: {}: {error}", ladder.quantity.label());
                false
            }
            _ => true,
        });
    }
    let bar = super::progress_bar(1000);
    let progress = super::progress_on(&bar);
    let measure = |rung: &Rung| arguments.in_a_process(rung);
    let how = arguments.experiment.settings();
    let outcome = growth::run(&scene, &ladders, settings, &measure, &arguments.output, &how, &progress)?;
    bar.finish_and_clear();
    let Some(found) = whole(outcome) else { return Ok(ExitCode::SUCCESS) };
    let text = to_json(&found);
    files::write_atomically(&arguments.output.join("growth.json"), text.as_bytes())?;
    super::print(&if arguments.json { text } else { found.table() })?;
    found.draw(&arguments.output)?;
    Ok(ExitCode::SUCCESS)
}

impl Arguments {
    fn ladders(&self) -> Result<Vec<Ladder>> {
        if self.ladder.is_empty() {
            return Ok(every_ladder());
        }
        let wrong = |text: &str, expected: &str| {
            Error::new("--ladder", format!("\"{text}\""), expected.to_owned(), "Correct the option.")
        };
        let read = |text: &String| {
            let found = text.rsplit_once('=').and_then(|(name, values)| {
                let values = values.split(',').map(|value| value.trim().parse().ok()).collect::<Option<Vec<f64>>>()?;
                Some((name.trim(), values))
            });
            let (name, values) = found.ok_or_else(|| wrong(text, "NAME=V,V,...: a name and numbers"))?;
            if values.is_empty() || !values.is_sorted_by(|a, b| a < b) {
                return Err(wrong(text, "values that rise"));
            }
            Ok(Ladder { quantity: Quantity::named(name), values })
        };
        self.ladder.iter().map(read).collect()
    }

    /// A rung by this program once more: its memory is its own.
    fn in_a_process(&self, rung: &Rung) -> Result<Once> {
        let failed = |cause: String| {
            Error::new(
                format!("{} {}", rung.value, rung.quantity.label()),
                cause,
                "a measurement",
                "Measure this ladder alone (--ladder) to see why.",
            )
        };
        let program = std::env::current_exe().map_err(|cause| failed(cause.to_string()))?;
        let mut command = Command::new(program);
        command.args(["measure", "growth"]).arg(&self.scene).args(["--rung", &to_json(rung)]);
        if rung.quantity == Quantity::Threads {
            command.env("RAYON_NUM_THREADS", rung.value.to_string());
        }
        let output = command.output().map_err(|cause| failed(cause.to_string()))?;
        if !output.status.success() {
            return Err(failed(String::from_utf8_lossy(&output.stderr).trim().to_owned()));
        }
        serde_json::from_slice(&output.stdout).map_err(|cause| failed(cause.to_string()))
    }
}

/// What is measured where nothing is chosen.
fn every_ladder() -> Vec<Ladder> {
    let most = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let powers = std::iter::successors(Some(1), |count| Some(2 * count)).take_while(|&count| count < most);
    let threads: Vec<f64> = powers.chain([most]).map(|count| count as f64).collect();
    [
        (Quantity::Width, [64.0, 128.0, 256.0, 512.0].to_vec()),
        (Quantity::Samples, [16.0, 64.0, 256.0, 1024.0].to_vec()),
        (Quantity::Bounces, [0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0].to_vec()),
        (Quantity::Objects, [1.0, 8.0, 64.0, 216.0, 512.0, 1000.0].to_vec()),
        (Quantity::Size, [1.0, 10.0, 100.0, 1000.0, 10_000.0].to_vec()),
        (Quantity::Threads, threads),
    ]
    .map(|(quantity, values)| Ladder { quantity, values })
    .into()
}
