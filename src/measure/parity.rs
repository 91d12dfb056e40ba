//! Parity suites: scenes rendered by Cycles and by path tracing under the same settings, judged by statistics.
//!
//! A suite file lists entries; [`run`] takes each through reference (cached), render and comparison, and keeps what
//! it finds per entry, so that an interrupted run goes on. A table sums up.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::{Identity, Resume};
use crate::base::ledger::{Ledger, Purpose, Sharing};
use crate::base::numbers::signed_percent;
use crate::base::progress::Progress as Report;
use crate::bridge;
use crate::bridge::Kernel;
use crate::bridge::reference::{
    FIRST_REPLICA_SEED, Reference, ReferenceSettings, WorldSampling, cache_folder, references,
};
use crate::gpu::Backend;
use crate::integrators::path;
use crate::integrators::path::{PathSettings, State};
use crate::measure::pictures::{DiffRequest, DiffResult, DisplaySettings, StatisticsSettings, Tolerances, Verdict};
use crate::scene::image::Image;
use crate::scene::{self, Scene};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// The format that this version reads.
pub const FORMAT: &str = "cloudparity-suite/1";

/// Seed of our first replica. Cycles' begin at [`FIRST_REPLICA_SEED`], so the two sides' are disjoint.
const FIRST_SEED: u32 = 100;

/// Fewest replicas: below, a single pixel can hardly be told from another (section 8.2 of the specification of
/// transport: the critical t for 64 x 64 pixels is 8.4 with 8 replicas, 20.7 with 4).
const FEWEST_REPLICAS: u32 = 8;

/// A suite file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Suite {
    /// Always `cloudparity-suite/1`.
    pub format: String,
    /// What is compared.
    pub entries: Vec<Entry>,
}

/// A scene, what is changed in it, and how much is rendered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// Short name, used for files.
    pub name: String,
    /// What it shows, in a line.
    pub about: String,
    /// The scene file, relative to the suite file.
    pub scene: String,
    /// Stored values to change, each `NAME=VALUE`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub set: Vec<String>,
    /// Scattering events beyond the first, instead of the scene's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub volume_bounces: Option<u32>,
    /// Width and height of a replica in pixels, instead of the scene's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resolution: Option<[u32; 2]>,
    /// Samples per pixel of each replica, on both sides.
    pub samples: u32,
    /// How replicas are made.
    pub replicas: Replicas,
    /// Whether Cycles samples the world as a light: needed for a picture as world, wrong with several lobes.
    #[serde(default)]
    pub sample_world: bool,
}

/// How replicas are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Replicas {
    /// That many renders per side, each with its own seed.
    Seeds(u32),
    /// One render per side at that many times the resolution per axis; the images at each position of the sub-pixels are the
    /// replicas, in pairs. For scenes whose preparation in Cycles takes minutes.
    SubPixels(u32),
}

/// What an entry came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Name of the entry.
    pub name: String,
    /// What it shows.
    pub about: String,
    /// The answer.
    pub verdict: Verdict,
    /// Why, where it is not "agrees".
    pub reasons: Vec<String>,
    /// Relative difference of the image mean per colour channel, with its interval and standard error.
    pub bias: Vec<Bias>,
    /// Share of the reference that a difference may have besides noise.
    pub systematic_allowance: f64,
    /// Replicas per side.
    pub replicas: u32,
    /// Samples per pixel of a replica.
    pub samples: u32,
    /// Checks that agree, and all.
    pub checks: [usize; 2],
    /// relMSE without noise.
    pub debiased_relmse: Option<f64>,
    /// What identifies the entry's inputs; a row with another identity is made anew.
    pub identity: String,
    /// The builds that rendered and judged it.
    pub builds: Vec<Identity>,
}

/// Difference of the image mean of one channel, as shares of the reference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Bias {
    /// Channel name.
    pub channel: String,
    /// (ours - reference) / reference.
    pub relative: Option<f64>,
    /// Ends of the interval.
    pub interval: [Option<f64>; 2],
    /// Standard error.
    pub standard_error: Option<f64>,
}

impl Suite {
    /// Reads and checks a suite file.
    pub fn load(path: &Path) -> Result<Self> {
        let text = files::read_text(path, "a parity suite (*.suite.json)")?;
        let place = path.display().to_string();
        let suite: Self = scene::parse(&text, &place, "a parity suite (parity/parity.suite.json is one)")?;
        if suite.format != FORMAT {
            return Err(Error::new(
                format!("{place}: $.format"),
                format!("\"{}\"", suite.format),
                format!("\"{FORMAT}\""),
                "Use the version of the program that wrote the file.",
            ));
        }
        for (number, entry) in suite.entries.iter().enumerate() {
            let wrong = |field: &str, found: String, expected: &str| {
                Err(Error::new(format!("{place}: $.entries[{number}].{field}"), found, expected, "Correct the value."))
            };
            let plain = |letter: char| letter.is_ascii_alphanumeric() || "-_".contains(letter);
            if entry.name.is_empty() || !entry.name.chars().all(plain) {
                return wrong("name", format!("\"{}\"", entry.name), "letters, digits, - and _: it names a folder");
            }
            if suite.entries[..number].iter().any(|other| other.name == entry.name) {
                return wrong("name", format!("\"{}\" a second time", entry.name), "names that differ");
            }
            if !(1..=path::MOST_SAMPLES).contains(&entry.samples) {
                return wrong("samples", entry.samples.to_string(), "1 to 16777216");
            }
            let (count, most) = match entry.replicas {
                Replicas::Seeds(count) => (count, 1024),
                Replicas::SubPixels(factor) => (factor.saturating_mul(factor), 64 * 64),
            };
            if !(FEWEST_REPLICAS..=most).contains(&count) {
                return wrong("replicas", format!("{count} replicas"), "8 or more; 3 to 64 sub-pixels per axis");
            }
        }
        Ok(suite)
    }

    /// All entries, or those named.
    pub(crate) fn chosen(&self, only: &[String]) -> Result<Vec<&Entry>> {
        if let Some(name) = only.iter().find(|name| self.entries.iter().all(|entry| entry.name != **name)) {
            let known: Vec<&str> = self.entries.iter().map(|entry| entry.name.as_str()).collect();
            return Err(Error::new(
                format!("entry {name}"),
                "no such entry",
                known.join(", "),
                "Give the name of an entry of the suite.",
            )
            .with_setting("only"));
        }
        Ok(self.entries.iter().filter(|entry| only.is_empty() || only.contains(&entry.name)).collect())
    }
}

impl Entry {
    /// The scene with its changes, at the resolution of the renders.
    fn load(&self, folder: &Path) -> Result<Scene> {
        let mut scene = Scene::load_with(&folder.join(&self.scene), &self.set)?;
        if let Some(bounces) = self.volume_bounces {
            scene.set_volume_bounces(bounces);
        }
        let size = self.resolution.unwrap_or_else(|| scene.image_size());
        let factor = self.sub_pixels().unwrap_or(1);
        scene.film.resolution = size.map(|side| side * factor);
        scene.film.resolution_percentage = 100;
        Ok(scene)
    }

    /// How Cycles renders it.
    pub(crate) fn reference_settings(&self) -> ReferenceSettings {
        ReferenceSettings {
            samples: self.samples,
            world_sampling: if self.sample_world { WorldSampling::Automatic } else { WorldSampling::None },
            ..ReferenceSettings::default()
        }
    }

    pub(crate) fn sub_pixels(&self) -> Option<u32> {
        match self.replicas {
            Replicas::Seeds(_) => None,
            Replicas::SubPixels(factor) => Some(factor),
        }
    }

    /// How many renders each side takes.
    fn renders(&self) -> u32 {
        match self.replicas {
            Replicas::Seeds(count) => count,
            Replicas::SubPixels(_) => 1,
        }
    }
}

/// The ledger of a folder of results: `name` is that of the file with its mark.
pub(crate) fn open(output: &Path, resume: &Resume) -> Result<Ledger> {
    let purpose = Purpose { mark: "experiment.json", format: FORMAT, of: serde_json::Value::Null };
    Ledger::open(output, purpose, resume, Sharing::Alone)
}

/// Runs the entries of a suite file, all or those named, into folders of `output`. Rows come in the order of the
/// suite; `done` hears of each as soon as it is there.
pub fn run(
    file: &Path,
    only: &[String],
    output: &Path,
    resume: &Resume,
    progress: Report<'_>,
    mut done: impl FnMut(&Row),
) -> Result<Vec<Row>> {
    let ledger = open(output, resume)?;
    let suite = Suite::load(file)?;
    let folder = file.parent().unwrap_or(Path::new("."));
    let chosen = suite.chosen(only)?;
    let mut rows = Vec::new();
    for (number, entry) in chosen.iter().enumerate() {
        let report = |share: f64, what: &str| {
            progress((number as f64 + share) / chosen.len() as f64, &format!("{}: {what}", entry.name));
        };
        let row = run_entry(entry, folder, &ledger, resume, &report)?;
        done(&row);
        rows.push(row);
        files::write_atomically(&output.join("parity.json"), pretty(&rows)?.as_bytes())?;
        files::write_atomically(&output.join("parity.md"), table(&rows).as_bytes())?;
    }
    Ok(rows)
}

/// Both sides' pictures of an entry.
pub(crate) struct Pictures {
    pub(crate) scene: Scene,
    pub(crate) references: Vec<Reference>,
    pub(crate) ours: Vec<PathBuf>,
    /// What identifies the entry's inputs.
    identity: String,
}

/// Cycles' pictures from the cache, rendered where it lacks them, and ours in `output`, which are rendered where others
/// or none lie there.
pub(crate) fn pictures(
    entry: &Entry,
    folder: &Path,
    ledger: &Ledger,
    resume: &Resume,
    report: Report<'_>,
) -> Result<Pictures> {
    let output = &ledger.folder().expect("pictures are kept").join(&entry.name);
    let scene = entry.load(folder)?;
    let settings = entry.reference_settings();
    let seeds: Vec<u32> = match entry.replicas {
        Replicas::Seeds(count) => (FIRST_REPLICA_SEED..FIRST_REPLICA_SEED + count).collect(),
        Replicas::SubPixels(_) => vec![settings.seed],
    };
    let references = references(&scene, &settings, &seeds, &cache_folder()?, |message| {
        report(0.5 * message.done, &message.what);
    })?;
    let keys: Vec<&str> = references.iter().map(|reference| reference.key.as_str()).collect();
    let identity = ledger.key(&json!({"entry": entry, "references": keys, "scene": scene}));
    let ours = our_files(entry, output);
    let note = output.join("ours.sha256");
    let there = std::fs::read_to_string(&note).is_ok_and(|noted| noted == identity);
    if !(there && ours.iter().all(|file| file.exists())) {
        std::fs::create_dir_all(output).map_err(|cause| Error::io(output, "a folder for the results", &cause))?;
        render(entry, &scene, output, resume, &|share, what| report(0.5 + 0.4 * share, what))?;
        files::write_atomically(&note, identity.as_bytes())?;
    }
    Ok(Pictures { scene, references, ours, identity })
}

fn run_entry(entry: &Entry, folder: &Path, ledger: &Ledger, resume: &Resume, report: Report<'_>) -> Result<Row> {
    let Pictures { scene, references, ours, identity } = pictures(entry, folder, ledger, resume, report)?;
    let output = &ledger.folder().expect("rows are kept").join(&entry.name);
    if let Some(row) = ledger.read("rows", &identity)? {
        return Ok(row);
    }
    report(0.9, "comparison");
    let references = references.into_iter().map(|reference| reference.path).collect();
    let request = DiffRequest {
        out: Some(output.to_owned()),
        display: Some(DisplaySettings::of(&scene.display, None)),
        statistics: Some(StatisticsSettings { sub_pixels: entry.sub_pixels(), ..StatisticsSettings::default() }),
        ..DiffRequest::new(ours, references, Tolerances::default())
    };
    let result = request.run(|script, request| bridge::run_script(script, request, Kernel::Default, |_| ()))?;
    let row = row(entry, &result, identity, ledger.builds());
    ledger.write("rows", &row.identity, &row)?;
    Ok(row)
}

/// Where our replicas lie, one per seed.
fn our_files(entry: &Entry, output: &Path) -> Vec<PathBuf> {
    our_seeds(entry).map(|seed| output.join(format!("ours.seed-{seed}.exr"))).collect()
}

fn our_seeds(entry: &Entry) -> std::ops::Range<u32> {
    FIRST_SEED..FIRST_SEED + entry.renders()
}

/// Our replicas, written beside each other.
fn render(entry: &Entry, scene: &Scene, output: &Path, resume: &Resume, report: Report<'_>) -> Result<()> {
    let settings = PathSettings { samples: entry.samples, seed: FIRST_SEED, ..PathSettings::default() };
    let seeds: Vec<u32> = our_seeds(entry).collect();
    let images: Vec<Image> = match seeds.as_slice() {
        [_] => {
            let state = output.join("ours.state");
            let state = State { path: &state, resume: resume.clone() };
            vec![path::render(scene, &settings, Backend::Cpu, Some(&state), report)?]
        }
        seeds => path::render_replicas(scene, &settings, Backend::Cpu, seeds, report)?,
    };
    images.iter().zip(our_files(entry, output)).try_for_each(|(image, file)| image.write_exr(&file, false))
}

fn row(entry: &Entry, result: &DiffResult, identity: String, builds: Vec<Identity>) -> Row {
    let statistics = result.statistics.as_ref();
    let bias = statistics.map_or_else(Vec::new, |statistics| {
        statistics
            .means
            .iter()
            .map(|mean| Bias {
                channel: mean.channel.clone(),
                relative: mean.relative_bias,
                interval: [mean.relative_low, mean.relative_high],
                standard_error: mean.relative_standard_error,
            })
            .collect()
    });
    let agreeing = result.checks.iter().filter(|check| check.outcome == Verdict::Agrees).count();
    Row {
        name: entry.name.clone(),
        about: entry.about.clone(),
        verdict: result.verdict,
        reasons: if result.verdict == Verdict::Agrees { Vec::new() } else { result.reasons.clone() },
        bias,
        systematic_allowance: statistics.map_or(0.0, |statistics| statistics.systematic_allowance),
        replicas: statistics.map_or(0, |statistics| statistics.replicas.ours),
        samples: entry.samples,
        checks: [agreeing, result.checks.len()],
        debiased_relmse: statistics.and_then(|statistics| statistics.relmse.debiased),
        identity,
        builds,
    }
}

fn pretty(value: &impl Serialize) -> Result<String> {
    let text = serde_json::to_string_pretty(value)
        .map_err(|cause| Error::new("parity", cause.to_string(), "finite figures", "Report this defect."))?;
    Ok(text + "\n")
}

/// The rows as a Markdown table.
pub fn table(rows: &[Row]) -> String {
    let mut text = String::from(
        "| scene | verdict | checks | replicas x samples | bias of the mean (99 % interval), per channel | largest \
         standard error | allowance |\n| --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for row in rows {
        let biases: Vec<String> = row
            .bias
            .iter()
            .map(|bias| {
                let [low, high] = bias.interval.map(signed_percent);
                format!("{} {} ({low} to {high})", bias.channel, signed_percent(bias.relative))
            })
            .collect();
        let error = row.bias.iter().filter_map(|bias| bias.standard_error).fold(0.0, f64::max);
        writeln!(
            text,
            "| {}: {} | {} | {} of {} | {} x {} | {} | {:.3} % | {:.1} % |",
            row.name,
            row.about,
            row.verdict.words(),
            row.checks[0],
            row.checks[1],
            row.replicas,
            row.samples,
            biases.join("; "),
            100.0 * error,
            100.0 * row.systematic_allowance
        )
        .expect("writing to a string cannot fail");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn loaded(change: impl FnOnce(&mut serde_json::Value)) -> Result<Suite> {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/parity.suite.json");
        let text = std::fs::read_to_string(file).expect("the committed suite");
        let mut value: serde_json::Value = serde_json::from_str(&text).expect("it is JSON");
        change(&mut value);
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("changed.suite.json");
        std::fs::write(&file, value.to_string()).expect("it is written");
        Suite::load(&file)
    }

    #[test]
    fn the_committed_suite_loads_and_so_do_its_scenes() {
        let suite = loaded(|_| ()).expect("the committed suite is one");
        assert!(suite.entries.len() >= 10);
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("parity");
        for entry in &suite.entries {
            let scene = entry.load(&folder).expect("its scene loads");
            let size = scene.image_size();
            let factor = entry.sub_pixels().unwrap_or(1);
            assert!(size[0] >= 128 * factor && size[1] >= 72 * factor, "{}: {size:?}", entry.name);
        }
    }

    #[test]
    fn a_wrong_entry_is_refused_by_its_place() {
        for (field, value, place) in [
            ("name", json!("../x"), "$.entries[1].name"),
            ("samples", json!(0), "$.entries[1].samples"),
            ("replicas", json!({"seeds": 2}), "$.entries[1].replicas"),
            ("replicas", json!({"sub_pixels": 1000}), "$.entries[1].replicas"),
            ("colour", json!(1), "$.entries[1]"),
        ] {
            let error = loaded(|suite| suite["entries"][1][field] = value).expect_err(field);
            assert!(error.to_string().contains(place), "{error}");
        }
        let twice = |suite: &mut serde_json::Value| suite["entries"][1]["name"] = suite["entries"][0]["name"].clone();
        assert!(loaded(twice).expect_err("a name twice").found.contains("second time"));
    }
}
