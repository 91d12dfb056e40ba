//! `cloudparity measure growth`: how time and memory grow.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::ledger::to_json;
use crate::cli::resume::{ExperimentArguments, whole};
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
  cloudparity growth CLOUD.scene.json --objects 1,10,100,1000 --only objects -o GROWTH
  cloudparity growth CLOUD.scene.json --input \"Density=1,10,100\" --only input -o GROWTH")]
pub(super) struct Arguments {
    /// The scene file.
    scene: PathBuf,
    /// The folder for the results.
    #[arg(short, long, value_name = "DIR", default_value = "out/growth")]
    output: PathBuf,
    /// Ladders to measure, instead of all that have values.
    #[arg(long, value_name = "LADDER", value_delimiter = ',',
        value_parser = ["widths", "samples", "bounces", "objects", "sizes", "threads", "input"])]
    only: Vec<String>,
    /// Pixels along the longer side; the first is that of all other ladders.
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "64,128,256,512")]
    widths: Vec<u32>,
    /// Samples of a pixel; the first is that of all other ladders.
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "16,64,256,1024")]
    samples: Vec<u32>,
    /// Scattering events beyond the first.
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "0,1,2,4,8,16,32,64")]
    bounces: Vec<u32>,
    /// Copies of the object, in its box.
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "1,8,64,216,512,1000")]
    objects: Vec<u32>,
    /// Lengths of the scene over those that it has, at the same optical thickness (a stored Density is divided).
    #[arg(long, value_name = "FACTOR", value_delimiter = ',', default_value = "1,10,100,1000,10000")]
    sizes: Vec<f64>,
    /// Threads; 1, 2, 4 and so on to those of this machine if not given.
    #[arg(long, value_name = "N", value_delimiter = ',')]
    threads: Vec<u32>,
    /// A stored number and its values, named as for --set: "Density=1,10,100".
    #[arg(long, value_name = "NAME=VALUES")]
    input: Vec<String>,
    /// Rounds; the median counts.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100))]
    repeats: u32,
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
    let ladders = arguments.ladders()?;
    let first = |values: &[u32]| values.first().copied().unwrap_or(1);
    let settings =
        Settings { width: first(&arguments.widths), samples: first(&arguments.samples), repeats: arguments.repeats };
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
        let numbers = |values: &[u32]| values.iter().copied().map(f64::from).collect::<Vec<f64>>();
        let threads = if self.threads.is_empty() {
            let most = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
            let powers = std::iter::successors(Some(1), |count| Some(2 * count)).take_while(|&count| count < most);
            powers.chain([most]).map(|count| count as f64).collect()
        } else {
            numbers(&self.threads)
        };
        let mut ladders = vec![
            ("widths", Quantity::Width, numbers(&self.widths)),
            ("samples", Quantity::Samples, numbers(&self.samples)),
            ("bounces", Quantity::Bounces, numbers(&self.bounces)),
            ("objects", Quantity::Objects, numbers(&self.objects)),
            ("sizes", Quantity::Size, self.sizes.clone()),
            ("threads", Quantity::Threads, threads),
        ];
        for text in &self.input {
            let found = text.split_once('=').and_then(|(name, values)| {
                let values = values.split(',').map(|value| value.trim().parse().ok()).collect::<Option<Vec<f64>>>()?;
                Some((name.trim().to_owned(), values))
            });
            let (name, values) = found.ok_or_else(|| {
                Error::new("--input", format!("\"{text}\""), "NAME=V,V,...: a name and numbers", "Correct the option.")
            })?;
            ladders.push(("input", Quantity::Input(name), values));
        }
        ladders
            .into_iter()
            .filter(|(name, ..)| self.only.is_empty() || self.only.iter().any(|only| only == name))
            .map(|(name, quantity, values)| {
                if values.is_empty() || !values.is_sorted_by(|a, b| a < b) {
                    let found = values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
                    let expected = "values that rise";
                    return Err(Error::new(format!("--{name}"), found, expected, "Bring them into their order."));
                }
                Ok(Ladder { quantity, values })
            })
            .collect()
    }

    /// A rung by this program once more: its memory is its own.
    fn in_a_process(&self, rung: &Rung) -> Result<Once> {
        let failed = |cause: String| {
            Error::new(
                format!("{} {}", rung.value, rung.quantity.label()),
                cause,
                "a measurement",
                "Measure this ladder alone (--only) to see why.",
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
