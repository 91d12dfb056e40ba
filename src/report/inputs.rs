//! What a run directory may hold: the types of its files and how they are read.
//!
//! Every file is optional. One that is missing is listed as left out with what makes it ([`Makers`]);
//! one that is there and cannot be understood is an error with file and place.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::Identity;
use crate::base::numbers::capitalised;
use crate::measure::attribution;
use crate::measure::densities::comparison::{Comparison, FIGURE};
use crate::measure::pictures::{DiffResult, Verdict};
use crate::measure::speed::Rates;
use crate::measure::stability;
use crate::measure::study;
use crate::measure::tuning;
use base64::Engine;
use indexmap::IndexMap;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::{Component, Path};

/// How each file of a run directory is made, by its name in [`FILES`]: a command or a sentence, which whoever writes the report knows.
pub type Makers<'a> = &'a [(&'a str, &'a str)];

/// Files of a run directory: name, what it shows.
pub const FILES: [(&str, &str); 17] = [
    ("run.json", "title, command, versions and timings"),
    ("diff.json", "the figures of the picture"),
    ("ours.png", "our picture"),
    ("reference.png", "the reference's picture"),
    ("difference.png", "the map of the difference"),
    ("probe.json", "field values against Cycles, point by point"),
    ("slices.json", "slices of the field and their error"),
    ("modes.json", "every node in every mode"),
    ("bounds.json", "bounds of the density"),
    ("bench.json", "speed against Cycles"),
    (STUDY_RESULTS, "error against time"),
    (TUNING_RESULTS, "tuned parameters"),
    (ATTRIBUTION_RESULTS, "which stage makes the error"),
    ("models.json", "density models side by side"),
    ("stability.json", "numerical stability"),
    ("explain.txt", "the specialised graph in words"),
    ("scene.json", "the scene"),
];

/// What a study leaves, in the folder of a run; in its own folder it lies without the first part.
const STUDY_RESULTS: &str = "study/results.json";

/// The same of a tuning.
const TUNING_RESULTS: &str = "tuning/tuning.json";

/// The same of an attribution.
const ATTRIBUTION_RESULTS: &str = "attribution/attribution.json";

/// A figure of a study, by its file's stem.
pub fn study_figure(stem: &str) -> String {
    format!("study/{stem}.svg")
}

/// The figure of a tuning.
pub const TUNING_FIGURE: &str = "tuning/tuning.svg";

/// The figure of an attribution.
pub const ATTRIBUTION_FIGURE: &str = "attribution/attribution.svg";

/// Something that a report does not show, why, and what to do about it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeftOut {
    /// What is not shown.
    pub what: String,
    /// The reason.
    #[serde(default)]
    pub why: String,
    /// What brings it into the next report, often a command.
    #[serde(default)]
    pub remedy: String,
}

/// `run.json`: where everything else in the directory comes from.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Run {
    /// Headline of the report.
    pub title: Option<String>,
    /// Name of the scene.
    pub scene: Option<String>,
    /// SHA-256 of the scene file, hexadecimal.
    pub scene_sha256: Option<String>,
    /// The command that made the directory.
    pub command: Option<String>,
    /// Versions of what took part.
    pub versions: IndexMap<String, Value>,
    /// GPU adapter: name, driver, kind.
    pub adapter: IndexMap<String, Value>,
    /// What the run itself left out.
    pub left_out: Vec<LeftOut>,
    /// Seconds of wall time by step.
    pub timings: Vec<Timing>,
}

/// How long one step took.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// The step.
    pub what: String,
    /// Wall time.
    pub seconds: f64,
}

/// `probe.json`, one graph output evaluated at the same points by several evaluators.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Probe {
    /// The build that evaluated ours, where the probe says so.
    #[serde(default)]
    pub build: Option<String>,
    /// Name of the scene.
    #[serde(default)]
    pub scene: Option<String>,
    /// What was evaluated, where the probe says so.
    #[serde(default)]
    pub target: Option<Value>,
    /// Number of points.
    pub points: u64,
    /// Where the points lie: `box`, a slice, a surface.
    #[serde(default)]
    pub domain: Option<Value>,
    /// Seed of the points.
    #[serde(default)]
    pub seed: Option<Value>,
    /// The evaluator that is compared with: renderer, kernel, Blender version.
    #[serde(default)]
    pub reference: IndexMap<String, Value>,
    /// Ours, by name: `cpu`, `gpu`, `oracle`.
    #[serde(default)]
    pub evaluators: IndexMap<String, Evaluator>,
}

/// One evaluator against the reference. Errors are `|o - r| / max(1, |r|)`-like figures as the probe
/// defines them; shares run from 0 to 1.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Evaluator {
    /// Points compared.
    pub points: Option<u64>,
    /// Points whose value is not the same.
    pub differing: Option<u64>,
    /// Largest error.
    pub max_error: Option<f64>,
    /// 99.9th percentile of the error.
    pub p999_error: Option<f64>,
    /// Root mean squared error.
    pub rms_error: Option<f64>,
    /// Mean error.
    pub mean_error: Option<f64>,
    /// Share of points where the reference is not 0.
    pub nonzero_share: Option<f64>,
    /// Points where exactly one side is NaN or infinite.
    pub one_sided_nonfinite: Option<u64>,
    /// Wall time of our evaluation.
    pub seconds: Option<f64>,
    /// Largest error that agrees, where the probe was given one.
    pub limit: Option<f64>,
    /// The points with the largest errors.
    pub worst: Vec<WorstPoint>,
}

impl Evaluator {
    /// Agrees when equal everywhere, or within the limit; differs when over it or when only one side
    /// is finite somewhere. `None` where there is nothing to judge by.
    pub fn verdict(&self) -> Option<Verdict> {
        if self.one_sided_nonfinite.is_some_and(|count| count > 0) {
            return Some(Verdict::Differs);
        }
        if self.differing == Some(0) {
            return Some(Verdict::Agrees);
        }
        let (limit, error) = (self.limit?, self.max_error?);
        Some(if error <= limit { Verdict::Agrees } else { Verdict::Differs })
    }
}

/// One point with a large error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorstPoint {
    /// Object space coordinates, metres.
    pub point: Vec<f64>,
    /// Our value, number or vector.
    #[serde(default)]
    pub ours: Value,
    /// The reference's value.
    #[serde(default)]
    pub reference: Value,
    /// The error.
    #[serde(default)]
    pub error: Option<f64>,
}

/// One entry of `slices.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Slice {
    /// What is sliced, and where.
    pub title: String,
    /// Picture of our field.
    #[serde(default)]
    pub field_png: Option<String>,
    /// Its colour bar (SVG).
    #[serde(default)]
    pub field_legend: Option<String>,
    /// Picture of the error.
    #[serde(default)]
    pub error_png: Option<String>,
    /// Its colour bar (SVG).
    #[serde(default)]
    pub error_legend: Option<String>,
    /// Share of points that are exactly equal, 0 to 1.
    #[serde(default)]
    pub equal_share: Option<f64>,
    /// Largest `|o - r| / max(1, max |r|)`.
    #[serde(default)]
    pub max_error: Option<f64>,
    /// Points where only one side is finite.
    #[serde(default)]
    pub one_sided_nonfinite: Option<u64>,
}

/// One row of `modes.json`: a node in one mode, one output, on the CPU and in WGSL.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Mode {
    /// Blender's name of the node.
    pub node: String,
    /// The mode, as the properties that choose it.
    #[serde(default)]
    pub mode: Value,
    /// Output socket.
    #[serde(default)]
    pub output: Value,
    /// Points compared.
    #[serde(default)]
    pub points: Option<u64>,
    /// Largest error of the CPU evaluator.
    #[serde(default)]
    pub cpu_max_error: Option<f64>,
    /// Points where the CPU's value is not the same.
    #[serde(default)]
    pub cpu_differing: Option<u64>,
    /// Largest error of the generated WGSL.
    #[serde(default)]
    pub wgsl_max_error: Option<f64>,
    /// The same in units in the last place.
    #[serde(default)]
    pub wgsl_max_ulp: Option<f64>,
    /// Largest error that passes.
    #[serde(default)]
    pub limit: Option<f64>,
    /// Where the limit comes from.
    #[serde(default)]
    pub limit_source: Option<String>,
    /// Whether it passes; `None` where it was not judged.
    #[serde(default)]
    pub pass: Option<bool>,
}

/// `bench.json`: rates on one machine in one run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Bench {
    /// The builds that were measured; none in a file from before builds had an identity.
    #[serde(default)]
    pub builds: Vec<Identity>,
    /// GPU adapter.
    #[serde(default)]
    pub adapter: Value,
    /// One row per workload.
    #[serde(default)]
    pub rows: Vec<Rates>,
}

impl Bench {
    /// Whether the "GPU" is a program on the CPU, whose times say nothing about a GPU.
    pub fn software_adapter(&self) -> bool {
        let text = self.adapter.to_string().to_lowercase();
        ["llvmpipe", "lavapipe", "swiftshader", "\"cpu\"", "software"].iter().any(|name| text.contains(name))
    }
}

/// A picture that travels inside the page.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Picture {
    /// File name in the run directory.
    pub file: String,
    /// `data:` address.
    pub uri: String,
    /// Pixels; 0 for SVG.
    pub width: u32,
    /// Pixels; 0 for SVG.
    pub height: u32,
}

/// All that a run directory holds, and what it does not.
#[derive(Debug, Default)]
pub struct Inputs {
    /// `run.json`.
    pub run: Run,
    /// `diff.json`.
    pub diff: Option<DiffResult>,
    /// `probe.json`, one or several.
    pub probes: Vec<Probe>,
    /// `slices.json`.
    pub slices: Vec<Slice>,
    /// `modes.json`.
    pub modes: Vec<Mode>,
    /// `bounds.json`.
    pub bounds: Option<Value>,
    /// `bench.json`.
    pub bench: Option<Bench>,
    /// `study/results.json`.
    pub study: Option<study::Results>,
    /// `tuning/tuning.json`.
    pub tuning: Option<tuning::TuningResults>,
    /// `attribution/attribution.json`.
    pub attribution: Option<attribution::Results>,
    /// `models.json`.
    pub models: Option<Comparison>,
    /// `stability.json`.
    pub stability: Option<stability::Table>,
    /// `explain.txt`.
    pub explain: Option<String>,
    /// `scene.json`.
    pub scene: Option<Value>,
    /// Pictures by file name.
    pub pictures: IndexMap<String, Picture>,
    /// What is missing.
    pub left_out: Vec<LeftOut>,
}

impl Inputs {
    /// Reads a run directory.
    pub fn read(directory: &Path, makers: Makers<'_>) -> Result<Self> {
        if !directory.is_dir() {
            return Err(Error::new(
                directory.display().to_string(),
                "no directory",
                "the folder of a run",
                "Give the folder that cloudparity demo or cloudparity diff wrote.",
            ));
        }
        // The folder of a study, a tuning or an attribution by itself.
        let is_own = |name: &str, nested: &str| directory.join(name).is_file() && !directory.join(nested).exists();
        let is_study = is_own("results.json", STUDY_RESULTS);
        let is_tuning = is_own("tuning.json", TUNING_RESULTS);
        let is_attribution = is_own("attribution.json", ATTRIBUTION_RESULTS);
        let is_by_itself = is_study || is_tuning || is_attribution;
        let mut inputs = Self {
            run: read_json(directory, "run.json")?.unwrap_or_default(),
            diff: read_json(directory, "diff.json")?,
            slices: read_json(directory, "slices.json")?.unwrap_or_default(),
            modes: read_json(directory, "modes.json")?.unwrap_or_default(),
            bounds: read_json(directory, "bounds.json")?,
            bench: read_json(directory, "bench.json")?,
            scene: read_json(directory, "scene.json")?,
            models: read_json(directory, "models.json")?,
            stability: read_json(directory, "stability.json")?,
            study: read_json(directory, if is_study { "results.json" } else { STUDY_RESULTS })?,
            tuning: read_json(directory, if is_tuning { "tuning.json" } else { TUNING_RESULTS })?,
            attribution: read_json(directory, if is_attribution { "attribution.json" } else { ATTRIBUTION_RESULTS })?,
            ..Self::default()
        };
        inputs.probes = match read_json::<Value>(directory, "probe.json")? {
            Some(Value::Array(list)) => parse(Value::Array(list), &directory.join("probe.json"))?,
            Some(one) => vec![parse(one, &directory.join("probe.json"))?],
            None => Vec::new(),
        };
        let explain = directory.join("explain.txt");
        if explain.exists() {
            inputs.explain = Some(files::read_text(&explain, "text in UTF-8")?);
        }
        inputs.left_out = inputs.run.left_out.clone();
        // What such a folder lacks of a whole run it never was to hold.
        for (name, what) in FILES.into_iter().filter(|_| !is_by_itself) {
            if !directory.join(name).exists() {
                let maker = makers.iter().find(|(file, _)| *file == name).map(|(_, maker)| (*maker).to_owned());
                inputs.left_out.push(LeftOut {
                    what: capitalised(what),
                    why: format!("{name} is not in the run directory."),
                    remedy: maker.unwrap_or_default(),
                });
            }
        }
        inputs.read_pictures(directory, is_by_itself)?;
        Ok(inputs)
    }

    /// `own`: figures of a study, a tuning or an attribution lie in the directory itself.
    fn read_pictures(&mut self, directory: &Path, own: bool) -> Result<()> {
        let mut wanted: Vec<(String, bool)> = Vec::new();
        for name in ["ours", "reference", "difference", "difference_absolute", "t", "relmse", "flip"] {
            wanted.push((format!("{name}.png"), false));
            wanted.push((format!("{name}_legend.svg"), false));
        }
        if self.study.is_some() {
            wanted.extend(study::FIGURES.map(|(_, stem)| (study_figure(stem), false)));
        }
        if self.tuning.is_some() {
            wanted.push((TUNING_FIGURE.to_owned(), false));
        }
        if self.attribution.is_some() {
            wanted.push((ATTRIBUTION_FIGURE.to_owned(), false));
        }
        if let Some(models) = &self.models {
            wanted.push((FIGURE.to_owned(), false));
            wanted.extend(models.pictures.iter().filter_map(|picture| Some((picture.png.clone()?, true))));
        }
        for slice in &self.slices {
            let named = [&slice.field_png, &slice.field_legend, &slice.error_png, &slice.error_legend];
            wanted.extend(named.into_iter().flatten().map(|name| (name.clone(), true)));
        }
        for (name, required) in wanted {
            let nested = ["study/", "tuning/", "attribution/"].iter().find_map(|folder| name.strip_prefix(folder));
            let path = directory.join(plain_name(nested.filter(|_| own).unwrap_or(&name))?);
            if path.is_file() {
                self.pictures.insert(name.clone(), read_picture(&path, &name)?);
            } else if required {
                self.left_out.push(LeftOut {
                    what: format!("The picture {name}"),
                    why: "A file of the run names it, and it is not in the run directory.".into(),
                    remedy: "Run the command that made the directory again.".into(),
                });
            }
        }
        Ok(())
    }
}

/// A file name that stays inside the run directory.
fn plain_name(name: &str) -> Result<&Path> {
    let path = Path::new(name);
    if !name.is_empty() && path.components().all(|part| matches!(part, Component::Normal(_))) {
        return Ok(path);
    }
    Err(Error::new(
        "slices.json or models.json",
        format!("the file name {name:?}"),
        "a relative name inside the run directory",
        "Write the pictures into the run directory and name them without folders.",
    ))
}

fn read_json<T: DeserializeOwned>(directory: &Path, name: &str) -> Result<Option<T>> {
    let path = directory.join(name);
    if !path.exists() {
        return Ok(None);
    }
    let text = files::read_text(&path, "JSON in UTF-8")?;
    let value: Value = serde_json::from_str(&text).map_err(|cause| {
        Error::new(
            format!("{}, line {}, column {}", path.display(), cause.line(), cause.column()),
            cause.to_string(),
            "one JSON document",
            "Run the command that writes this file again.",
        )
    })?;
    parse(value, &path).map(Some)
}

fn parse<T: DeserializeOwned>(value: Value, path: &Path) -> Result<T> {
    serde_path_to_error::deserialize(value).map_err(|cause| {
        Error::new(
            format!("{}, {}", path.display(), cause.path()),
            cause.inner().to_string(),
            "the layout that this version writes",
            "Run the command that writes this file again.",
        )
    })
}

fn read_picture(path: &Path, name: &str) -> Result<Picture> {
    let bytes = files::read_bytes(path, "a readable picture")?;
    let encoded = base64::engine::general_purpose::STANDARD.encode(&bytes);
    let file = name.to_owned();
    if name.ends_with(".svg") {
        return Ok(Picture { file, uri: format!("data:image/svg+xml;base64,{encoded}"), width: 0, height: 0 });
    }
    let (width, height) = png_size(&bytes).ok_or_else(|| {
        Error::new(path.display().to_string(), "no PNG header", "a PNG file", "Make the picture again.")
    })?;
    Ok(Picture { file, uri: format!("data:image/png;base64,{encoded}"), width, height })
}

/// Width and height from the first chunk of a PNG file.
fn png_size(bytes: &[u8]) -> Option<(u32, u32)> {
    let header = bytes.strip_prefix(b"\x89PNG\r\n\x1a\n")?.get(4..16)?;
    let (kind, size) = header.split_at(4);
    let number = |part: &[u8]| part.try_into().ok().map(u32::from_be_bytes);
    (kind == b"IHDR").then_some((number(&size[..4])?, number(&size[4..])?))
}
