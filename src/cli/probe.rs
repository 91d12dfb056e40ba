//! `cloudparity probe`: field values of live Cycles and of our evaluators at the same points.

use super::choice::choice;
use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::Identity;
use crate::graph::evaluate::Points;
use crate::graph::{Program, Target, closures, target};
use crate::measure::fields;
use crate::measure::fields::{Comparison, Domain, Evaluator, Figures, Reference, Request, Sampling, domain};
use crate::measure::nodes::settings;
use crate::scene::Scene;
use indexmap::IndexMap;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Compare field values with live Cycles (SSE4.2 kernel) at the same points.
///
/// Exit status 0: cpu equals Cycles at every point and gpu is within 3e-6 (or, with
/// --rounding-bound, within its bound at every point); 1: not so; 2: could not
/// tell.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  cloudparity probe CLOUD.scene.json --points 1000000\n  cloudparity probe CLOUD.scene.json --target \"Noise Texture.Fac\" --backend all"
)]
pub(super) struct Arguments {
    /// The scene file.
    scene: PathBuf,
    /// Number of points (per setting with --random-settings).
    #[arg(long, value_name = "N", default_value_t = 100_000)]
    points: usize,
    /// Seed of the points and settings.
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    seed: u64,
    /// Where the points lie.
    #[arg(long, value_parser = choice::<Domain>(), default_value_t = Domain::Box)]
    points_in: Domain,
    /// Which of our evaluators: all cores, the adapter, the oracle in f64, or all of them.
    #[arg(long, alias = "evaluator", value_enum, default_value_t = Choice::Cpu)]
    backend: Choice,
    /// Also compare the WGSL with its own rounding bound at every point (running error analysis), which is what an
    /// adapter that fuses is judged by.
    #[arg(long)]
    rounding_bound: bool,
    /// Change a stored value: "Large Noise/Scale=2". May be given several times.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// NODE.SOCKET to compare instead of the density.
    ///
    /// SOCKET is an output's identifier, or a group output's name. Without it, of several closures each is compared by itself: one row for
    /// Density and for each linked input.
    #[arg(long, value_name = "NODE.SOCKET")]
    target: Option<String>,
    /// Compare with this many random settings of the material's group nodes.
    #[arg(long, value_name = "N")]
    random_settings: Option<usize>,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
    /// Also write the JSON to this file.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// One evaluator or all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Choice {
    Cpu,
    Gpu,
    Oracle,
    All,
}

/// Share of points that must not be 0 for a random setting to say anything.
const NONZERO_SHARE: f64 = 0.05;

/// Points that decide whether a random setting is redrawn.
const TRIAL_POINTS: usize = 4096;

/// Draws per random setting before giving up.
const DRAWS: usize = 1000;

/// One random setting and what was found with it.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Setting {
    values: IndexMap<String, f32>,
    evaluators: IndexMap<&'static str, Figures>,
}

/// The figures of all random settings together, and each.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Settings {
    build: Identity,
    scene: String,
    target: String,
    points: usize,
    domain: &'static str,
    seed: u64,
    reference: Reference,
    evaluators: IndexMap<&'static str, Figures>,
    settings: Vec<Setting>,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = Scene::load_with(&arguments.scene, &arguments.set)?;
    // Without a target each of several closures is compared by itself; random settings are of one.
    let targets = match (&arguments.target, arguments.random_settings) {
        (Some(name), _) => vec![Target::parse(name, scene.graph())?],
        (None, Some(_)) => vec![target::density(&scene)?],
        (None, None) => closures::targets(&scene)?,
    };
    super::need_bpy("the field is")?;
    let (evaluators, left_out) = arguments.backend.available()?;
    let bar = super::progress_bar(1000);
    let (text, json, found): (String, String, Vec<_>) = match arguments.random_settings {
        None => {
            let sampling = Sampling {
                domain: arguments.points_in,
                points: arguments.points,
                seed: arguments.seed,
                rounding_bound: arguments.rounding_bound,
            };
            let probes = fields::probe(&scene, &targets, sampling, &evaluators, super::report_to(&bar))?;
            let text = probes
                .iter()
                .map(|probe| describe(&probe.reference, &probe.target, probe.domain, &probe.evaluators))
                .collect();
            let json = match probes.as_slice() {
                [only] => to_json(only),
                several => to_json(&several),
            };
            (text, json, probes.into_iter().map(|probe| probe.evaluators).collect())
        }
        Some(count) => {
            let settings = random_settings(arguments, &scene, &targets[0], count, &evaluators, &bar)?;
            let mut text = describe(&settings.reference, &settings.target, settings.domain, &settings.evaluators);
            for setting in settings.settings.iter().filter(|setting| verdict(&setting.evaluators) == Some(false)) {
                writeln!(text, "differs with {:?}", setting.values).expect("writing to a string cannot fail");
            }
            (text, to_json(&settings), vec![settings.evaluators])
        }
    };
    bar.finish_and_clear();
    if let Some(path) = &arguments.output {
        files::write_atomically(path, json.as_bytes())?;
    }
    super::print(if arguments.json { &json } else { &text })?;
    if let Some(reason) = &left_out {
        eprintln!("left out: gpu: {reason}");
    }
    let verdicts: Vec<Option<bool>> = found.iter().map(verdict).collect();
    let together = if verdicts.contains(&Some(false)) {
        Some(false)
    } else if verdicts.contains(&None) {
        None
    } else {
        Some(true)
    };
    Ok(match (together, left_out) {
        (Some(false), _) => ExitCode::FAILURE,
        (Some(true), None) => ExitCode::SUCCESS,
        // The oracle alone judges nothing, and a missing evaluator cannot agree.
        _ => ExitCode::from(super::COULD_NOT),
    })
}

impl Choice {
    /// The evaluators, and why the GPU is left out of `all` on a machine without one.
    fn available(self) -> Result<(Vec<Evaluator>, Option<Error>)> {
        Ok(match self {
            Self::Cpu => (vec![Evaluator::Cpu], None),
            Self::Gpu => (vec![Evaluator::Gpu], None),
            Self::Oracle => (vec![Evaluator::Oracle], None),
            Self::All => match crate::gpu::Gpu::open() {
                Ok(_) => (Evaluator::ALL.to_vec(), None),
                Err(error) => (vec![Evaluator::Cpu, Evaluator::Oracle], Some(error)),
            },
        })
    }
}

/// Whether all that can be judged agrees; none where nothing can be judged.
fn verdict(found: &IndexMap<&'static str, Figures>) -> Option<bool> {
    let judged: Vec<bool> = found.values().filter_map(Figures::agrees).collect();
    if judged.is_empty() { None } else { Some(judged.into_iter().all(|agrees| agrees)) }
}

fn to_json(document: &impl Serialize) -> String {
    serde_json::to_string_pretty(document).expect("figures serialise") + "\n"
}

fn random_settings(
    arguments: &Arguments,
    scene: &Scene,
    target: &Target,
    count: usize,
    evaluators: &[Evaluator],
    bar: &indicatif::ProgressBar,
) -> Result<Settings> {
    let mut random = ChaCha8Rng::seed_from_u64(arguments.seed);
    let mut drawn = Vec::new();
    for number in 0..count {
        drawn.push(draw(arguments, scene, target, &mut random, arguments.seed.wrapping_add(number as u64))?);
    }
    let requests: Vec<Request<'_>> = drawn
        .iter()
        .map(|(scene, _, positions)| Request {
            scene,
            target: target.clone(),
            positions,
            evaluators,
            rounding_bound: arguments.rounding_bound,
        })
        .collect();
    let (found, reference) = fields::compare(&requests, super::report_to(bar))?;
    let mut totals: IndexMap<Evaluator, Comparison> = IndexMap::new();
    let mut settings = Vec::new();
    for ((_, values, _), comparisons) in drawn.iter().zip(found) {
        for (evaluator, comparison) in &comparisons {
            totals.entry(*evaluator).or_default().join(comparison.clone());
        }
        settings.push(Setting { values: values.clone(), evaluators: fields::figures(comparisons) });
    }
    Ok(Settings {
        build: Identity::current().clone(),
        scene: scene.name.clone(),
        target: target.name(),
        points: drawn.iter().map(|(_, _, positions)| positions.len()).sum(),
        domain: arguments.points_in.name(),
        seed: arguments.seed,
        reference,
        evaluators: fields::figures(totals.into_iter().collect()),
        settings,
    })
}

/// A scene with random settings, the settings and the points.
type Drawn = (Scene, IndexMap<String, f32>, Vec<[f32; 3]>);

/// Draws until enough of the field is not 0.
fn draw(arguments: &Arguments, scene: &Scene, target: &Target, random: &mut ChaCha8Rng, seed: u64) -> Result<Drawn> {
    for _ in 0..DRAWS {
        let mut changed = scene.clone();
        let values = settings::draw(&mut changed, random)?;
        let density = Program::density(&changed)?;
        let trial = domain::points(arguments.points_in, &changed, &density, TRIAL_POINTS, seed)?;
        let program = Program::compile(&changed, std::slice::from_ref(target))?;
        let (found, _) = fields::evaluate(&program, Points::new(&trial), Evaluator::Cpu, None)?;
        let width = program.output_components().max(1);
        let nonzero = found.chunks(width).filter(|values| values.iter().any(|value| *value != 0.0)).count();
        if nonzero as f64 >= NONZERO_SHARE * trial.len() as f64 {
            let positions = domain::points(arguments.points_in, &changed, &density, arguments.points, seed)?;
            return Ok((changed, values, positions));
        }
    }
    Err(Error::new(
        format!("--random-settings of {}", arguments.scene.display()),
        format!("{DRAWS} draws with less than 5 % of the points non-zero"),
        "settings that leave something to compare",
        "Probe another domain, or the scene without --random-settings.",
    ))
}

fn describe(reference: &Reference, target: &str, domain: &str, evaluators: &IndexMap<&'static str, Figures>) -> String {
    let mut text = format!(
        "{target} against Cycles {} ({} kernel, {:.1} s), domain {domain}\n",
        reference.blender, reference.kernel, reference.seconds
    );
    for (name, found) in evaluators {
        let verdict = match found.agrees() {
            Some(true) => "agrees",
            Some(false) => "DIFFERS",
            None => "not judged",
        };
        let worst: String = found
            .worst
            .iter()
            .map(|worst| {
                format!("\n    at {:?}: ours {}, Cycles {}", worst.point, json(&worst.ours), json(&worst.reference))
            })
            .collect();
        writeln!(
            text,
            "  {name}: {verdict}; {} of {} points differ; error max {:.3e}, p99.9 {:.3e}, RMS {:.3e}, mean {:.3e}; \
             {:.2} % non-zero; non-finite on one side {}; {:.2} s{worst}",
            found.differing,
            found.points,
            found.max_error,
            found.p999_error,
            found.rms_error,
            found.mean_error,
            100.0 * found.nonzero_share,
            found.one_sided_nonfinite,
            found.seconds,
        )
        .expect("writing to a string cannot fail");
        if let Some(bound) = &found.rounding_bound {
            writeln!(
                text,
                "    rounding bound: median {:.2e}, p99.9 {:.2e}, max {:.2e}; {} points beyond their own",
                bound.median, bound.p999, bound.max, bound.beyond
            )
            .expect("writing to a string cannot fail");
        }
    }
    text
}

fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("figures serialise")
}
