//! What a certificate claims, one statement per subject that was measured: the claim, where it holds, what was asked, the worst that was
//! found and where, the errors that seeds share, what took part, and what it does not show.
//!
//! Nothing is measured here: every figure is one that a file of the run holds, and what the files do not say is said to be unknown.

use crate::base::numbers::{figure, plain};
use crate::measure::attribution;
use crate::measure::pictures::{DiffResult, Verdict};
use crate::measure::stability;
use crate::measure::study;
use crate::measure::tuning::TuningResults;
use crate::report::inputs::{Evaluator, Inputs, Mode, Probe};
use crate::report::summary::evaluator_name;
use serde::Serialize;
use serde_json::{Value, json};

/// A claim and its limits.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Statement {
    /// What it is about: `picture`, `field (CPU, box)`.
    pub subject: String,
    /// What is claimed, whether or not it was found to hold: [`Statement::verdict`] says that.
    pub claim: String,
    /// Whether it holds; none where something was measured and nothing judged.
    pub verdict: Option<Verdict>,
    /// For what it is claimed.
    pub domain: String,
    /// What was asked: points, pixels, modes, runs.
    pub population: Population,
    /// The worst that was found; none where every value is equal or no file says.
    pub worst: Option<Worst>,
    /// Errors that all seeds have in common, which more replicas therefore do not show.
    pub shared_by_seeds: String,
    /// What took part, as the file says.
    pub versions: Value,
    /// What the claim does not show.
    pub not_shown: Vec<String>,
}

/// What was asked.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Population {
    /// How many.
    pub count: u64,
    /// Of what, and how it was drawn.
    pub of: String,
    /// The seed that it follows from, where there is one.
    pub seed: Option<Value>,
}

/// The worst case.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Worst {
    /// Its size.
    pub value: f64,
    /// What that measures.
    pub measure: String,
    /// Where it was found, as far as the file says.
    pub place: String,
}

/// What is said of a place that no file names.
const UNKNOWN_PLACE: &str = "the file does not say where";

/// No part of a claim is random.
const NO_SEEDS: &str = "none: nothing but the choice of points is random, and at each point the values are compared";

/// All statements of a run.
pub fn of(inputs: &Inputs) -> Vec<Statement> {
    let mut found: Vec<Statement> = inputs.diff.iter().map(of_picture).collect();
    for probe in &inputs.probes {
        found.extend(probe.evaluators.iter().map(|(name, evaluator)| of_field(probe, name, evaluator)));
    }
    if !inputs.modes.is_empty() {
        found.push(of_modes(&inputs.modes, &inputs.run.versions));
    }
    found.extend(inputs.stability.as_ref().map(of_stability));
    found.extend(inputs.study.as_ref().map(of_study));
    found.extend(inputs.tuning.as_ref().map(of_tuning));
    found.extend(inputs.attribution.as_ref().map(of_attribution));
    found
}

/// What no statement of a certificate shows, whatever was measured.
pub fn not_shown(inputs: &Inputs) -> Vec<String> {
    let mut found = vec![
        "Other scenes, views, settings and versions than those named.".to_owned(),
        "Other adapters and processors: WGSL and the functions of a C library round otherwise there.".to_owned(),
    ];
    if inputs.diff.is_none() {
        found.push("The picture: no comparison of pictures is in the folder.".to_owned());
    }
    if inputs.probes.is_empty() {
        found.push("The field: no comparison of values is in the folder.".to_owned());
    }
    found
}

fn sentences(texts: &[&str]) -> Vec<String> {
    texts.iter().map(|&text| text.to_owned()).collect()
}

/// The block, or the channel of the mean, that is farthest off.
fn worst_of_picture(diff: &DiffResult) -> Option<Worst> {
    let blocks = diff.statistics.iter().flat_map(|statistics| &statistics.blocks);
    let least = blocks.filter(|block| block.tests > 0).min_by(|a, b| a.smallest_p.total_cmp(&b.smallest_p));
    if let Some(block) = least {
        let bias = block.worst_relative_bias.map_or_else(String::new, |bias| format!(", bias {}", figure(Some(bias))));
        return Some(Worst {
            value: block.worst_t,
            measure: format!("t of a block's mean, in standard errors{bias}"),
            place: format!(
                "block of {size} x {size} pixels at x {}, y {} from the upper left, channel {}",
                block.worst_x,
                block.worst_y,
                block.worst_channel,
                size = block.size
            ),
        });
    }
    let colour = diff.colour.as_ref()?;
    let pixel = colour.max_at.as_ref()?;
    Some(Worst {
        value: colour.max_error,
        measure: "absolute difference of a pixel's radiance, noise of both sides included".into(),
        place: format!("pixel x {}, y {} from the upper left, channel {}", pixel.x, pixel.y, pixel.channel),
    })
}

fn of_picture(diff: &DiffResult) -> Statement {
    let images = diff.images.as_ref();
    let size =
        images.map_or_else(|| "an unknown size".into(), |found| format!("{} x {} pixels", found.width, found.height));
    let replicas = images.map_or_else(
        || "replicas of both sides".into(),
        |found| format!("{} replicas of ours and {} of the reference", found.ours.replicas, found.reference.replicas),
    );
    let (claim, shared, mut not_shown) = match &diff.statistics {
        Some(found) => (
            format!(
                "Ours and the reference have the same expectation: image mean, blocks, pixels and the structure of their difference, {} checks, \
                 each family of tests at level {}",
                diff.checks.len(),
                found.significance
            ),
            format!(
                "up to {} of the reference is allowed for what its seeds share ({}); an error of ours that all seeds share would be taken for \
                 a difference, or hide in that",
                figure(Some(found.systematic_allowance)),
                found.allowance_rule
            ),
            sentences(&["That the pictures are equal: differences within noise and allowance remain possible."]),
        ),
        None => (
            format!("The pictures are within the tolerances that were set, {} of them", diff.checks.len()),
            "unknown: without replicas noise and shared errors are not told apart".to_owned(),
            sentences(&["How much of the difference is noise."]),
        ),
    };
    not_shown.push("That the reference is right: both could be wrong together.".to_owned());
    not_shown.push("Other views, resolutions, sample counts and lights.".to_owned());
    Statement {
        subject: "picture".into(),
        claim,
        verdict: Some(diff.verdict),
        domain: format!("one view of one scene at {size}, scene-linear"),
        population: Population {
            count: images.map_or(0, |found| u64::from(found.width) * u64::from(found.height)),
            of: format!("pixels; {replicas}"),
            seed: None,
        },
        worst: worst_of_picture(diff),
        shared_by_seeds: shared,
        versions: json!(diff.versions),
        not_shown,
    }
}

/// Where points of a domain lie.
fn domain_in_words(domain: Option<&Value>) -> String {
    match domain.and_then(Value::as_str) {
        Some("box") => "the volume's bounds, where the field is not provably constant".into(),
        Some("wide") => "bounds 100 times as large as the volume's, where the field is not provably constant".into(),
        Some("adversarial") => {
            "where evaluators go wrong: cell borders, special numbers, edges of remaps, far points of Voronoi cells"
                .into()
        }
        Some(other) => other.into(),
        None => domain.map_or_else(|| "the file does not say where the points lie".into(), plain),
    }
}

fn of_field(probe: &Probe, name: &str, found: &Evaluator) -> Statement {
    let place = probe.domain.as_ref().and_then(Value::as_str).map_or_else(String::new, |name| format!(", {name}"));
    let reference = probe.reference.get("renderer").map_or_else(|| "the reference".into(), plain);
    let claim = match (name, found.limit) {
        (_, Some(limit)) => format!("Values are within {} of those of {reference}, or equal", figure(Some(limit))),
        ("oracle", None) => format!("None: how well conditioned the field is beside {reference}"),
        (_, None) => {
            format!("Values have the bits of those of {reference}; both zeros count as equal, and so do all NaN")
        }
    };
    let error = |worst: &&crate::report::inputs::WorstPoint| worst.error.unwrap_or(f64::NEG_INFINITY);
    let point = found.worst.iter().max_by(|a, b| error(a).total_cmp(&error(b)));
    let at = |point: &[f64]| point.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    let place_of_worst = match point {
        Some(worst) => format!("the point ({}) in object space, metres", at(&worst.point)),
        None => UNKNOWN_PLACE.into(),
    };
    let is_equal = found.differing == Some(0);
    Statement {
        subject: format!("field ({}{place})", evaluator_name(name)),
        claim,
        verdict: found.verdict(),
        domain: domain_in_words(probe.domain.as_ref()),
        population: Population {
            count: found.points.unwrap_or(probe.points),
            of: "points".into(),
            seed: probe.seed.clone(),
        },
        worst: found.max_error.filter(|_| !is_equal).map(|value| Worst {
            value,
            measure: "error |ours - reference| as the probe defines it".into(),
            place: place_of_worst,
        }),
        shared_by_seeds: NO_SEEDS.into(),
        versions: json!({"build": probe.build, "reference": probe.reference}),
        not_shown: sentences(&[
            "Points that were not asked: another seed asks others.",
            "Other values of the graph's parameters.",
        ]),
    }
}

fn of_modes(modes: &[Mode], versions: &indexmap::IndexMap<String, Value>) -> Statement {
    let of_either = |mode: &Mode| mode.cpu_max_error.unwrap_or(0.0).max(mode.wgsl_max_error.unwrap_or(0.0));
    let errors = modes.iter().map(|mode| (mode, of_either(mode)));
    let worst = errors.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, error)| *error > 0.0);
    let judged: Vec<bool> = modes.iter().filter_map(|mode| mode.pass).collect();
    let points: u64 = modes.iter().filter_map(|mode| mode.points).sum();
    Statement {
        subject: "node modes".into(),
        claim: "Each node in each mode is within its limit, on the CPU and in WGSL".into(),
        verdict: match judged.as_slice() {
            [] => None,
            judged if judged.iter().all(|&pass| pass) => Some(Verdict::Agrees),
            _ => Some(Verdict::Differs),
        },
        domain:
            "nodes by themselves, their inputs numbers of many sizes; graphs of several nodes are the field's subject"
                .into(),
        population: Population {
            count: modes.len() as u64,
            of: format!("outputs of modes, {points} points in all, {} judged", judged.len()),
            seed: None,
        },
        worst: worst.map(|(mode, value)| Worst {
            value,
            measure: "largest error of either evaluator, relative to max(1, |reference|)".into(),
            place: format!("{} ({}), output {}", mode.node, plain(&mode.mode), plain(&mode.output)),
        }),
        shared_by_seeds: NO_SEEDS.into(),
        versions: json!(versions),
        not_shown: sentences(&["Points that were not asked.", "Graphs in which a value depends on several nodes."]),
    }
}

fn of_stability(table: &stability::Table) -> Statement {
    let [failed, limited] = [stability::Verdict::Fails, stability::Verdict::Limit].map(|verdict| table.count(verdict));
    let share = |row: &stability::Judgement| row.share_of_bound;
    let rows = table.rows.iter().filter_map(|row| Some((row, share(row)?)));
    let worst = rows.max_by(|a, b| a.1.total_cmp(&b.1));
    Statement {
        subject: "numerical stability".into(),
        claim:
            "f32 is within its limit of f64, or within a bound derived from its operations, and never NaN or infinite"
                .into(),
        verdict: Some(match (failed, &table.adapter) {
            (0, Some(_)) => Verdict::Agrees,
            (0, None) => Verdict::CouldNotTell,
            _ => Verdict::Differs,
        }),
        domain: "stiff and extreme cases: optical depths, densities, eccentricities, coordinates and times of each row"
            .into(),
        population: Population {
            count: table.rows.iter().map(|row| row.values as u64).sum(),
            of: format!("values in {} rows, {limited} of them at the limit of f32", table.rows.len()),
            seed: None,
        },
        worst: worst.map(|(row, value)| Worst {
            value,
            measure: format!("share of the derived bound that was used; error {:e}", row.max_error),
            place: format!("{}: {}", row.id, row.varied),
        }),
        shared_by_seeds: "of rows of path tracing, which compare means: a bias that f32 and f64 have in common".into(),
        versions: json!({"builds": table.builds, "adapter": table.adapter}),
        not_shown: sentences(&[
            "That f64 is right: it is the same formula with more digits.",
            "Combinations of extremes that no row has.",
        ]),
    }
}

/// What is common to everything measured against path tracing in replicas.
fn truth_in_words(replicas: usize) -> String {
    format!(
        "the {replicas} replicas of a truth share its scene, its density and our path tracing: an error of those is in all of them, and no \
         standard error holds it"
    )
}

fn of_study(found: &study::Results) -> Statement {
    let worst = found.runs.iter().max_by(|a, b| a.errors.relmse.value.total_cmp(&b.errors.relmse.value));
    let replicas = found.truths.iter().map(|truth| truth.replicas.len()).min().unwrap_or(0);
    let [width, height] = found.study.resolution;
    Statement {
        subject: "study".into(),
        claim:
            "Each run has the stated error against path tracing, within its standard error, and took the stated time"
                .into(),
        verdict: None,
        domain: format!("the settings of the study's axes, at {width} x {height} pixels"),
        population: Population {
            count: found.runs.len() as u64,
            of: format!(
                "runs; {} truths of {replicas} replicas or more; {} combinations left out",
                found.truths.len(),
                found.skipped.len()
            ),
            seed: None,
        },
        worst: worst.map(|run| Worst {
            value: run.errors.relmse.value,
            measure: format!("relMSE without the truth's noise, standard error {:e}", run.errors.relmse.standard_error),
            place: run.describe(),
        }),
        shared_by_seeds: truth_in_words(replicas),
        versions: json!({"program": found.version, "builds": found.builds, "machine": found.machine}),
        not_shown: sentences(&[
            "Times on other machines, or beside other work.",
            "Settings between or beyond those of the axes.",
            "What a viewer sees: relMSE and HDR-FLIP are numbers.",
        ]),
    }
}

fn of_tuning(found: &TuningResults) -> Statement {
    let worst = found.tuned.held_out.iter().max_by(|a, b| a.flip.total_cmp(&b.flip));
    let replicas = found.truths.iter().map(|truth| truth.replicas.len()).min().unwrap_or(0);
    let [width, height] = found.file.resolution;
    Statement {
        subject: "tuning".into(),
        claim: "On views that the search has not seen the tuned engine has the stated errors".into(),
        verdict: None,
        domain: format!("views of the file at {width} x {height} pixels, an engine of fixed quality"),
        population: Population {
            count: found.tuned.held_out.len() as u64,
            of: format!("held-out views; {} for training; {} evaluations", found.tuned.train.len(), found.evaluations),
            seed: Some(json!(found.file.search.seed)),
        },
        worst: worst.map(|view| Worst {
            value: view.flip,
            measure: "HDR-FLIP, the truth's noise included".into(),
            place: format!("the held-out view {}", view.view),
        }),
        shared_by_seeds: format!("{}; one search from one seed found the parameters", truth_in_words(replicas)),
        versions: json!({"program": found.version, "builds": found.builds, "machine": found.machine, "optimiser": found.optimiser}),
        not_shown: sentences(&[
            "That no other parameters are better: the search is random and ends.",
            "Suns, cameras and densities unlike those of the views.",
        ]),
    }
}

fn of_attribution(found: &attribution::Results) -> Statement {
    let off =
        |one: &attribution::Attributed| one.remainder.value.abs() / one.remainder.standard_error.max(f64::MIN_POSITIVE);
    let worst = found.attributed.iter().max_by(|a, b| off(a).total_cmp(&off(b)));
    Statement {
        subject: "attribution".into(),
        claim:
            "The shares of the stages add up to the engine's whole error: what is left is 0 within two standard errors"
                .into(),
        verdict: None,
        domain: "the engines and scenes of the file".into(),
        population: Population { count: found.attributed.len() as u64, of: "engines in a scene".into(), seed: None },
        worst: worst.map(|one| Worst {
            value: off(one),
            measure: format!("what is left of relMSE, in its standard errors; relMSE {:e}", one.remainder.value),
            place: format!("{} in {}", one.engine, one.scene),
        }),
        shared_by_seeds: truth_in_words(found.attribution.truth.replicas as usize),
        versions: json!({"builds": found.builds, "machine": found.machine}),
        not_shown: sentences(&[
            "What replacing one stage alone would give: a share is a mean over orders of replacement.",
        ]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn inputs(files: &[(&str, Value)]) -> Inputs {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, value) in files {
            std::fs::write(folder.path().join(name), value.to_string()).expect("a writable folder");
        }
        Inputs::read(folder.path(), &[]).expect("files of a run")
    }

    /// What `diff` writes; with statistics, of replicas.
    fn picture(statistics: Option<Value>) -> Value {
        let side = |replicas: u32| json!({"files": [], "replicas": replicas, "colour_space": null});
        json!({
            "verdict": "agrees", "reasons": [], "checks": [], "tolerances": {}, "notes": [], "files": {},
            "versions": {"OpenImageIO": "3.0"},
            "images": {"ours": side(8), "reference": side(6), "width": 48, "height": 27, "channels": ["R", "G", "B"], "part": null},
            "colour": {
                "mean_error": 0.1, "rms_error": 0.1, "psnr": null, "max_error": 0.75, "threshold": 0.1, "failing_pixels": 0,
                "failing_share": 0.0, "pixels": 1296, "max_at": {"x": 5, "y": 7, "channel": "G", "ours": 1.0, "reference": 0.25},
            },
            "statistics": statistics,
        })
    }

    fn statistics() -> Value {
        let block = |size: u32, smallest_p: f64| {
            json!({
                "size": size, "tests": 40, "level": 0.001, "rejected": 0, "smallest_p": smallest_p, "worst_x": 16, "worst_y": 24,
                "worst_channel": "B", "worst_t": -2.5, "worst_relative_bias": -0.012,
            })
        };
        json!({
            "design": "unpaired", "replicas": {"ours": 8, "reference": 6}, "significance": 0.01, "systematic_allowance": 0.005,
            "allowance_rule": "measured of Cycles at 256 samples", "interval": 0.99, "means": [], "t_range": 4.0, "formulas": {},
            "blocks": [block(8, 0.5), block(4, 0.02)], "structure": [], "tails": [], "alpha": null,
            "pixels": {"tests": 10, "exact": 0, "level": 0.01, "rejected_share": 0.0, "spread": 1.0, "spread_limit": 1.1, "floored_share": 0.0},
            "relmse": {"epsilon": 0.1, "limit": 0.001, "mean_squared_difference": 0.0, "mean_squared_noise": 0.0, "mean_squared_bias": 0.0},
        })
    }

    #[test]
    fn a_picture_of_replicas_names_its_worst_block_and_what_seeds_share() {
        let found = of(&inputs(&[("diff.json", picture(Some(statistics())))]));
        let [statement] = found.as_slice() else { panic!("{found:?}") };
        assert_eq!((statement.subject.as_str(), statement.verdict), ("picture", Some(Verdict::Agrees)));
        assert_eq!(
            (statement.population.count, statement.population.of.contains("8 replicas of ours and 6")),
            (1296, true)
        );
        let worst = statement.worst.as_ref().expect("a block");
        assert_eq!(
            (worst.value, worst.place.as_str()),
            (-2.5, "block of 4 x 4 pixels at x 16, y 24 from the upper left, channel B")
        );
        assert!(
            statement.shared_by_seeds.contains("0.005") && statement.shared_by_seeds.contains("at 256 samples"),
            "{statement:?}"
        );
        assert!(statement.not_shown.iter().any(|text| text.contains("both could be wrong")));
        assert_eq!(statement.versions, json!({"OpenImageIO": "3.0"}));
    }

    #[test]
    fn a_picture_without_replicas_names_its_worst_pixel_and_knows_nothing_of_seeds() {
        let found = of(&inputs(&[("diff.json", picture(None))]));
        let worst = found[0].worst.as_ref().expect("a pixel");
        assert_eq!((worst.value, worst.place.as_str()), (0.75, "pixel x 5, y 7 from the upper left, channel G"));
        assert!(found[0].shared_by_seeds.starts_with("unknown"), "{found:?}");
    }

    #[test]
    fn a_field_names_the_point_with_the_largest_error_and_its_population() {
        let point = |at: f64, error: f64| json!({"point": [at, 0.5, -1.0], "error": error});
        let probe = json!({"points": 100, "domain": "adversarial", "seed": 7, "reference": {"renderer": "Cycles", "kernel": "sse42"}, "build": "b",
            "evaluators": {"cpu": {"points": 90, "differing": 2, "max_error": 0.25, "worst": [point(1.0, 0.125), point(2.0, 0.25)]}}});
        let found = of(&inputs(&[("probe.json", probe)]));
        let [statement] = found.as_slice() else { panic!("{found:?}") };
        assert_eq!(statement.subject, "field (CPU, adversarial)");
        assert!(
            statement.claim.contains("bits of those of Cycles") && statement.domain.contains("cell borders"),
            "{statement:?}"
        );
        assert_eq!((statement.population.count, &statement.population.seed), (90, &Some(json!(7))));
        let worst = statement.worst.as_ref().expect("a point");
        assert_eq!((worst.value, worst.place.as_str()), (0.25, "the point (2, 0.5, -1) in object space, metres"));
        assert_eq!(statement.versions["reference"]["kernel"], "sse42");
    }

    #[test]
    fn modes_name_the_worst_of_both_evaluators() {
        let mode = |node: &str, cpu: f64, wgsl: f64, pass: bool| json!({"node": node, "mode": {"operation": "ADD"}, "output": "Value", "points": 10, "cpu_max_error": cpu, "wgsl_max_error": wgsl, "pass": pass});
        let of_modes = |last: bool| {
            let modes = [mode("Math", 0.0, 1e-7, true), mode("Mix", 2e-7, 0.0, true), mode("Wave", 0.0, 1e-8, last)];
            of(&inputs(&[("modes.json", json!(modes))])).remove(0)
        };
        let statement = of_modes(true);
        assert_eq!((statement.verdict, statement.population.count), (Some(Verdict::Agrees), 3));
        let worst = statement.worst.expect("a mode");
        assert!(worst.value == 2e-7 && worst.place.starts_with("Mix (") && worst.place.contains("ADD"), "{worst:?}");
        assert_eq!(of_modes(false).verdict, Some(Verdict::Differs));
    }

    #[test]
    fn stability_names_the_row_that_used_most_of_its_bound() {
        let row = |id: &str, share: Option<f64>, verdict: &str| {
            json!({"id": id, "subject": "function", "varied": "depth", "evaluator": "f32", "values": 5, "nonfinite": 0, "max_error": 0.5,
                "share_of_bound": share, "limit": 1e-6, "reason": "r", "guards": [], "cycles": "", "verdict": verdict})
        };
        let table = |adapter: Option<&str>| {
            json!({"scene": "s", "pictures_of": "s", "scene_sha256": "", "adapter": adapter, "seconds": 1.0, "left_out": [], "guards": [],
                "rows": [row("a", Some(0.25), "pass"), row("b", Some(0.75), "limit"), row("c", None, "pass")]})
        };
        let statement = of(&inputs(&[("stability.json", table(Some("llvmpipe")))])).remove(0);
        assert_eq!((statement.verdict, statement.population.count), (Some(Verdict::Agrees), 15));
        let worst = statement.worst.expect("a row");
        assert_eq!((worst.value, worst.place.as_str()), (0.75, "b: depth"));
        assert_eq!(of(&inputs(&[("stability.json", table(None))]))[0].verdict, Some(Verdict::CouldNotTell));
    }

    #[test]
    fn what_is_not_in_the_folder_is_not_shown() {
        let nothing = inputs(&[]);
        assert_eq!(of(&nothing), vec![]);
        let said = not_shown(&nothing).join(" ");
        assert!(said.contains("no comparison of pictures") && said.contains("no comparison of values"), "{said}");
        assert!(!not_shown(&inputs(&[("diff.json", picture(None))])).join(" ").contains("no comparison of pictures"));
    }
}
