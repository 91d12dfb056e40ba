//! The certificate of a run: what is claimed and within which limits ([`statements`]), what was found, with what settings and versions, and
//! the hashes of the files that say so.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::{COMPILER, Identity};
use crate::measure::provenance::Provenance;
use crate::report::inputs::Inputs;
use crate::report::statements;
use crate::report::summary::Summary;
use serde_json::{Value, json};
use std::path::Path;

/// Format of `certificate.json`.
pub const FORMAT: &str = "cloudparity-certificate/2";

/// The format before it, which has no statements.
const BEFORE: &str = "cloudparity-certificate/1";

/// Files that a certificate stands on, where they are there.
const FILES: [&str; 34] = [
    "run.json",
    "scene.json",
    "probe.json",
    "modes.json",
    "bounds.json",
    "bench.json",
    "diff.json",
    "models.json",
    "stability.json",
    "study/results.json",
    "tuning/tuning.json",
    "results.json",
    "tuning.json",
    "attribution/attribution.json",
    "attribution.json",
    "explain.txt",
    "ours.exr",
    "reference.exr",
    "ours.png",
    "reference.png",
    "difference.png",
    "slices.json",
    "models.svg",
    "models.pdf",
    "study/results.csv",
    "results.csv",
    "attribution/attribution.csv",
    "attribution.csv",
    // What the report wrote before the certificate.
    "index.html",
    "report.md",
    "figures.csv",
    "tables.tex",
    "tables-long.tex",
    "figures.tex",
];

/// Figures of studies, tunings and attributions, without folder and extension.
const FIGURES: [&str; 5] = ["study", "study_convergence", "study_pictures", "tuning", "attribution"];

/// All files that a certificate stands on, as far as they are there.
fn files_of(directory: &Path) -> Vec<String> {
    let mut names: Vec<String> = FILES.iter().map(|&name| name.to_owned()).collect();
    for folder in ["", "study/", "tuning/", "attribution/"] {
        let figures =
            FIGURES.iter().flat_map(|stem| ["svg", "png", "pdf"].map(|kind| format!("{folder}{stem}.{kind}")));
        names.extend(figures);
    }
    names.retain(|name| directory.join(name).is_file());
    names
}

/// The hash of a file.
fn hash(path: &Path) -> Result<String> {
    files::read_bytes(path, "a readable file").map(|bytes| files::sha256(&bytes))
}

/// The certificate of a run directory.
pub fn of(directory: &Path, inputs: &Inputs, summary: &Summary) -> Result<Value> {
    let run = &inputs.run;
    let fields: Vec<Value> = inputs
        .probes
        .iter()
        .flat_map(|probe| probe.evaluators.iter().map(move |entry| (probe, entry)))
        .map(|(probe, (name, found))| {
            json!({
                "evaluator": name,
                "target": probe.target,
                "domain": probe.domain,
                "seed": probe.seed,
                "reference": probe.reference,
                "points": found.points.unwrap_or(probe.points),
                "differing": found.differing,
                "max_error": found.max_error,
                "p999_error": found.p999_error,
                "limit": found.limit,
                "verdict": found.verdict(),
            })
        })
        .collect();
    let picture = inputs.diff.as_ref().map(|diff| {
        json!({
            "verdict": diff.verdict,
            "reasons": diff.reasons,
            "checks": diff.checks,
            "relmse": diff.relmse,
            "statistics": diff.statistics,
        })
    });
    let mut hashes = serde_json::Map::new();
    for name in files_of(directory) {
        let found = hash(&directory.join(&name))?;
        hashes.insert(name, found.into());
    }
    let made_by = |found: Option<&Provenance>| json!(found);
    Ok(json!({
        "format": FORMAT,
        "title": summary.title,
        "verdict": summary.verdict,
        "sentence": summary.sentence,
        "parts": summary.parts,
        "statements": statements::of(inputs),
        "not_shown": statements::not_shown(inputs),
        "scene": run.scene,
        "scene_sha256": run.scene_sha256,
        "command": run.command,
        "versions": run.versions,
        "adapter": run.adapter,
        "made_by": {
            "study": made_by(inputs.study.as_ref().and_then(|study| study.provenance.as_ref())),
            "tuning": made_by(inputs.tuning.as_ref().and_then(|tuning| tuning.provenance.as_ref())),
        },
        "written_by": {"build": Identity::current(), "compiler": COMPILER},
        "field": fields,
        "picture": picture,
        "left_out": inputs.left_out,
        "sha256": hashes,
    }))
}

/// What a certificate says that is not so, and what could not be told.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Findings {
    /// What was compared, and how many of each.
    pub compared: Vec<(&'static str, usize)>,
    /// What differs, a sentence each.
    pub differing: Vec<String>,
    /// What could not be told, and why.
    pub untold: Vec<String>,
}

/// Reads a certificate.
pub fn read(path: &Path) -> Result<Value> {
    let text = files::read_text(path, "a certificate")?;
    let wrong = |found: String| {
        Error::new(
            path.display().to_string(),
            found,
            format!("a certificate, format {FORMAT}"),
            "Give the certificate.json that a report wrote. Those of bundles are checked by cloudparity diff: its figures of bundle.exr and \
             double-precision.exr, beside it, are theirs.",
        )
    };
    let value: Value = serde_json::from_str(&text).map_err(|cause| wrong(format!("no JSON ({cause})")))?;
    if value["format"] == BEFORE {
        return Err(Error::new(
            path.display().to_string(),
            format!("the format {BEFORE}"),
            format!("a certificate, format {FORMAT}"),
            "It is from an earlier version and does not say what is claimed. Write the report again: cloudparity report FOLDER.",
        ));
    }
    if value["format"] != FORMAT || !value["sha256"].is_object() {
        return Err(wrong(format!("the format {}", value["format"])));
    }
    Ok(value)
}

/// Compares a certificate with what its folder holds: the hashes of the files; its statements with those made now from the same files; and the
/// errors of a study with what its pictures and truths give. `again`: the certificate made now.
pub fn compare(claimed: &Value, again: &Value, directory: &Path, inputs: &Inputs) -> Findings {
    let mut findings = Findings::default();
    let empty = serde_json::Map::new();
    let hashes = claimed["sha256"].as_object().unwrap_or(&empty);
    for (name, before) in hashes {
        let is_inside = Path::new(name).components().all(|part| matches!(part, std::path::Component::Normal(_)));
        match hash(&directory.join(name)) {
            _ if !is_inside => findings.differing.push(format!("{name}: a file outside the folder of the certificate")),
            Err(_) => findings.untold.push(format!("{name}: the file is not there, or cannot be read")),
            Ok(now) if *before != *now => {
                findings.differing.push(format!("{name}: SHA-256 {now}, certified {}", one_line(before)))
            }
            Ok(_) => {}
        }
    }
    findings.compared.push(("files", hashes.len()));
    let statements = |value: &Value| -> serde_json::Map<String, Value> {
        let kept =
            value.as_object().into_iter().flatten().filter(|(name, _)| *name != "sha256" && *name != "written_by");
        kept.map(|(name, value)| (name.clone(), value.clone())).collect()
    };
    let (before, now) = (Value::Object(statements(claimed)), Value::Object(statements(again)));
    let mut count = 0;
    differences("$", &before, &now, &mut count, &mut findings.differing);
    findings.compared.push(("statements", count));
    if let Some(study) = &inputs.study {
        let nested = directory.join("study");
        let folder = if nested.join("results.json").is_file() { nested } else { directory.to_owned() };
        let (differing, untold) = study.errors_again(&folder);
        findings.differing.extend(differing);
        findings.untold.extend(untold);
        findings.compared.push(("runs of the study, from their pictures", study.runs.len()));
    }
    findings
}

/// Where two JSON values differ, by path.
fn differences(path: &str, before: &Value, now: &Value, count: &mut usize, found: &mut Vec<String>) {
    match (before, now) {
        (Value::Object(a), Value::Object(b)) => {
            let added = b.keys().filter(|key| !a.contains_key(*key));
            for key in a.keys().chain(added) {
                let [a, b] = [a, b].map(|map| map.get(key).unwrap_or(&Value::Null));
                differences(&format!("{path}.{key}"), a, b, count, found);
            }
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            for (index, (a, b)) in a.iter().zip(b).enumerate() {
                differences(&format!("{path}[{index}]"), a, b, count, found);
            }
        }
        _ => {
            *count += 1;
            if before != now {
                found.push(format!("{path}: {} now, certified {}", one_line(now), one_line(before)));
            }
        }
    }
}

/// A JSON value as text that is no order to a terminal.
fn one_line(value: &Value) -> String {
    crate::base::plain_text::one_line(&value.to_string())
}
