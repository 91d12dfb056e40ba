//! The certificate of a run: what was found, with what settings and versions, and the hashes of the files that say so.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::report::inputs::Inputs;
use crate::report::summary::Summary;
use serde_json::{Value, json};
use std::path::Path;

/// Format of `certificate.json`.
pub const FORMAT: &str = "cloudparity-certificate/1";

/// Files that a certificate stands on, where they are there.
const FILES: [&str; 14] = [
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
    "explain.txt",
];

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
    for name in FILES {
        let path = directory.join(name);
        if path.exists() {
            let bytes = std::fs::read(&path).map_err(|cause| Error::io(&path, "a readable file", &cause))?;
            hashes.insert(name.to_owned(), files::sha256(&bytes).into());
        }
    }
    Ok(json!({
        "format": FORMAT,
        "title": summary.title,
        "verdict": summary.verdict,
        "sentence": summary.sentence,
        "parts": summary.parts,
        "scene": run.scene,
        "scene_sha256": run.scene_sha256,
        "command": run.command,
        "versions": run.versions,
        "adapter": run.adapter,
        "field": fields,
        "picture": picture,
        "left_out": inputs.left_out,
        "sha256": hashes,
    }))
}
