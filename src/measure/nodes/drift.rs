//! Drift: what other releases of Blender make of the same nodes at the same points.
//!
//! Our evaluators have the values of 5.0 or, where a graph says so, of 4.5 ([`crate::scene::Release`]). Every mode of every node is asked
//! of each release, by its own Cycles, at equal points: it is equal bit for bit, within its limit, different, different at strange values alone (NaN,
//! infinities, denormals, parameters beyond their limits), or not there. Pictures of scenes by each release's Cycles, in replicas, are compared with path
//! tracing. A release runs in an environment of its own, which is made when it is first asked for.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::Identity;
use crate::base::ledger::{Found, Purpose, to_json};
use crate::base::numbers::uncertain;
use crate::base::progress::Progress;
use crate::bridge::reference::{self, FIRST_REPLICA_SEED, ReferenceSettings};
use crate::bridge::{Message, releases};
use crate::gpu::Backend;
use crate::integrators::path;
use crate::integrators::path::PathSettings;
use crate::measure::errors::{self, FEWEST_REPLICAS, Uncertain};
use crate::measure::experiment;
use crate::measure::experiment::{Desk, Done, Experiment, Outcome, Settings};
use crate::measure::nodes::suite::{self, Case, ModeComparison, ModeComparisons, Selection};
use crate::measure::seeds;
use crate::scene::image::Image;
use crate::scene::{self, Scene};
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::path::Path;
use std::time::Instant;

/// Format of the results.
pub const FORMAT: &str = "cloudparity-drift/1";

const PURPOSE: Purpose = Purpose { mark: "drift-folder.json", format: FORMAT, of: Json::Null };

/// What is asked of each release.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Asked {
    /// Releases, as 4.5.15.
    pub releases: Vec<String>,
    /// Points per mode (Voronoi Texture: two ninths of it).
    pub points: usize,
    /// Of the values.
    pub seed: u64,
    /// Only this node, by Blender's label.
    pub node: Option<String>,
    /// Samples per pixel and replica of pictures.
    pub samples: u32,
    /// Replicas of each side, at least 6.
    pub replicas: u32,
    /// The release whose values our evaluators have.
    #[serde(default)]
    pub blender: scene::Release,
}

/// A scene by a release's Cycles, beside path tracing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Picture {
    /// The scene.
    pub scene: String,
    /// The release.
    pub release: String,
    /// Cycles' mean over path tracing's, minus 1.
    pub brightness: Uncertain,
    /// relMSE of Cycles against path tracing, without the noise of either.
    pub relmse: Uncertain,
    /// Seconds of a replica, with its part of the start of Blender; none where all were rendered before.
    pub seconds: Option<f64>,
}

/// How an output of a mode compares.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// Equal at every point.
    Equal,
    /// Not everywhere, but within the limit.
    Within,
    /// Equal at ordinary points, beyond the limit at strange ones.
    Strange,
    /// Beyond the limit, at ordinary points, too.
    Differs,
    /// The release has no such node, mode or socket.
    Absent,
}

/// An output of a mode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Blender's label of the node.
    pub node: String,
    /// The mode in words.
    pub mode: String,
    /// Output socket.
    pub output: String,
    /// How it compares.
    pub status: Status,
    /// Points compared, and those that are not equal.
    pub points: [usize; 2],
    /// The same of ordinary points.
    pub ordinary_points: [usize; 2],
    /// Largest |ours - Cycles| / max(1, |Cycles|) of ordinary points.
    pub largest_error: f64,
    /// The point with that error, or why there is none.
    pub note: Option<String>,
}

/// A release.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Release {
    /// As it was asked for.
    pub release: String,
    /// As Blender calls itself.
    pub blender: String,
    /// Seconds that its Cycles took, with starting Blender.
    pub seconds: f64,
    /// One per output of a mode.
    pub rows: Vec<Row>,
}

/// Everything that was found: `drift.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Drift {
    /// [`FORMAT`].
    pub format: String,
    /// The builds that measured it.
    pub builds: Vec<Identity>,
    /// What was asked.
    pub asked: Asked,
    /// By release.
    pub releases: Vec<Release>,
    /// Pictures, by scene and release.
    pub pictures: Vec<Picture>,
    /// Releases that could not be asked, with the reason.
    pub left_out: Vec<[String; 2]>,
}

/// Counts of a node in a release.
#[derive(Debug, Default, Clone, Copy)]
struct Counts {
    equal: usize,
    within: usize,
    strange: usize,
    differs: usize,
    absent: usize,
    largest: f64,
}

impl Counts {
    fn of<'a>(rows: impl Iterator<Item = &'a Row>) -> Self {
        let mut counts = Self::default();
        for row in rows {
            match row.status {
                Status::Equal => counts.equal += 1,
                Status::Within => counts.within += 1,
                Status::Strange => counts.strange += 1,
                Status::Differs => counts.differs += 1,
                Status::Absent => counts.absent += 1,
            }
            counts.largest = counts.largest.max(row.largest_error);
        }
        counts
    }

    fn all(self) -> usize {
        self.equal + self.within + self.strange + self.differs + self.absent
    }

    /// In words.
    fn text(self) -> String {
        if self.equal == self.all() {
            return "equal".into();
        }
        let mut parts = Vec::new();
        for (count, word) in [
            (self.differs, "differ"),
            (self.within, "within limits"),
            (self.strange, "at strange values"),
            (self.absent, "absent"),
        ] {
            if count > 0 {
                parts.push(format!("{count} {word}"));
            }
        }
        let error = if self.differs > 0 { format!(", up to {:.1e}", self.largest) } else { String::new() };
        format!("{} of {}{error}", parts.join(", "), self.all())
    }
}

impl Drift {
    /// Nodes in the order of the suite.
    fn nodes(&self) -> Vec<&str> {
        let rows = self.releases.iter().flat_map(|release| &release.rows);
        rows.map(|row| (row.node.as_str(), ())).collect::<IndexMap<_, _>>().into_keys().collect()
    }

    /// The table of nodes and releases as Markdown: a row per node that is not equal everywhere.
    pub fn markdown(&self) -> String {
        let of = |release: &Release| Counts::of(release.rows.iter());
        let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
        let heads: Vec<String> = self.releases.iter().map(|release| release.blender.clone()).collect();
        let mut text = line([vec!["node".to_owned()], heads].concat());
        text += &line(vec!["---".to_owned(); self.releases.len() + 1]);
        let counts: Vec<String> = self
            .releases
            .iter()
            .map(|release| {
                let counts = of(release);
                format!(
                    "{} of {} equal, {} at ordinary values",
                    counts.equal,
                    counts.all(),
                    counts.equal + counts.strange
                )
            })
            .collect();
        text += &line([vec!["outputs of all modes".to_owned()], counts].concat());
        let mut same = 0;
        for node in self.nodes() {
            let cells: Vec<String> = self
                .releases
                .iter()
                .map(|release| Counts::of(release.rows.iter().filter(|row| row.node == node)).text())
                .collect();
            if cells.iter().all(|cell| cell == "equal") {
                same += 1;
                continue;
            }
            text += &line([vec![node.to_owned()], cells].concat());
        }
        text += &line([vec![format!("{same} other nodes")], vec!["equal".to_owned(); self.releases.len()]].concat());
        if self.pictures.is_empty() {
            return text;
        }
        text += "\n| scene | release | brightness, % | relMSE | seconds |\n| --- | --- | --- | --- | --- |\n";
        for picture in &self.pictures {
            let Picture { scene, release, brightness, relmse, seconds } = picture;
            text += &line(vec![
                scene.clone(),
                release.clone(),
                uncertain(100.0 * brightness.value, 100.0 * brightness.standard_error),
                uncertain(relmse.value, relmse.standard_error),
                seconds.map_or_else(String::new, |seconds| format!("{seconds:.1}")),
            ]);
        }
        text
    }

    /// The table, and an example of every node that differs, in each release.
    pub fn summary(&self) -> String {
        let mut text = self.markdown();
        for release in &self.releases {
            for node in self.nodes() {
                let rows = || release.rows.iter().filter(|row| row.node == node);
                for wanted in [Status::Differs, Status::Strange, Status::Absent] {
                    let found = rows()
                        .filter(|row| row.status == wanted)
                        .max_by(|a, b| a.largest_error.total_cmp(&b.largest_error));
                    if let Some(row) = found {
                        let note = row.note.as_deref().unwrap_or("");
                        let note: String = note.chars().take(160).collect();
                        text += &format!("{}: {} [{}] {}: {note}\n", release.blender, row.node, row.mode, row.output);
                    }
                }
            }
        }
        for [release, reason] in &self.left_out {
            text += &format!("left out: {release}: {reason}\n");
        }
        text
    }
}

/// Asks the releases, in a folder.
///
/// Scenes have the size that their pictures have.
pub fn measure(
    asked: Asked,
    scenes: Vec<Scene>,
    folder: &Path,
    settings: &Settings,
    progress: Progress<'_>,
) -> Result<Outcome<Drift>> {
    asked.releases.iter().try_for_each(|release| releases::check(release))?;
    if (asked.replicas as usize) < FEWEST_REPLICAS || asked.samples == 0 {
        return Err(Error::new(
            "the pictures",
            format!("{} replicas of {} samples", asked.replicas, asked.samples),
            format!("at least {FEWEST_REPLICAS} replicas of at least 1 sample"),
            "Give more.",
        ));
    }
    let node = asked.node.as_deref();
    let cases = suite::cases_of(asked.blender, asked.points, asked.seed, node, Selection::Everything)?;
    experiment::run(&mut Running { asked, cases, scenes }, Some(folder), settings, progress)
}

struct Running {
    asked: Asked,
    cases: Vec<Case>,
    scenes: Vec<Scene>,
}

/// A release, by its position in the list; the second: a scene's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Job {
    Nodes(usize),
    Picture(usize, usize),
}

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Record {
    Nodes(Release),
    Picture(Picture),
}

impl Row {
    fn of(row: ModeComparison) -> Self {
        let status = match (row.cpu_differing, row.pass, row.ordinary_differing) {
            (0, _, _) => Status::Equal,
            (_, true, _) => Status::Within,
            (_, _, 0) => Status::Strange,
            _ => Status::Differs,
        };
        Self {
            node: row.node,
            mode: row.mode,
            output: row.output,
            status,
            points: [row.points, row.cpu_differing],
            ordinary_points: [row.ordinary_points, row.ordinary_differing],
            largest_error: row.ordinary_max_error,
            note: if status == Status::Differs { row.ordinary_worst } else { row.cpu_worst },
        }
    }
}

/// Rows of cases, all at once or, where a release cannot build the graph of one of them, in halves.
fn rows_of(cases: &[Case], blender: &mut String, report: &dyn Fn(usize)) -> Result<Vec<Row>> {
    match suite::run(cases, None, false, |_| ()) {
        Ok(ModeComparisons { rows, blender: found }) => {
            *blender = found;
            report(cases.len());
            Ok(rows.into_iter().map(Row::of).collect())
        }
        Err(error) if is_absence(&error) => {
            let [only] = cases else {
                let (first, second) = cases.split_at(cases.len() / 2);
                let mut rows = rows_of(first, blender, report)?;
                rows.extend(rows_of(second, blender, report)?);
                return Ok(rows);
            };
            report(1);
            let absent = |target: &crate::graph::Target| Row {
                node: only.node.to_owned(),
                mode: only.mode.clone(),
                output: target.output.clone().unwrap_or_default(),
                status: Status::Absent,
                points: [0, 0],
                ordinary_points: [0, 0],
                largest_error: 0.0,
                note: Some(error.found.clone()),
            };
            Ok(only.targets.iter().map(absent).collect())
        }
        Err(error) => Err(error),
    }
}

/// Whether a release could not build a graph: the place is in the graph.
fn is_absence(error: &Error) -> bool {
    error.place.starts_with("graph") || error.place.contains(".graph") || error.place.contains("targets[")
}

impl Running {
    fn nodes(&self, release: &str, desk: &Desk<'_>) -> Result<Release> {
        let (begin, done) = (Instant::now(), std::cell::Cell::new(0));
        let total = self.cases.len();
        let report = |count: usize| {
            done.set(done.get() + count);
            desk.report(done.get() as f64 / total as f64, "modes");
        };
        let mut blender = String::new();
        // One process per node: what a release lacks is found among fewer.
        let parts = self.cases.chunk_by(|a, b| a.node == b.node);
        let ask = || parts.map(|cases| rows_of(cases, &mut blender, &report)).collect::<Result<Vec<_>>>();
        let rows = releases::within(release, ask)?.concat();
        Ok(Release { release: release.to_owned(), blender, seconds: begin.elapsed().as_secs_f64(), rows })
    }

    fn inputs_of_truth(&self, scene: &Scene) -> Json {
        let Asked { samples, replicas, .. } = self.asked;
        json!({"scene": scene.content_hash(), "samples": samples, "replicas": replicas, "purpose": "beside releases"})
    }

    fn picture(&self, release: &str, scene: &Scene, desk: &Desk<'_>) -> Result<Picture> {
        let Asked { samples, replicas, .. } = self.asked;
        let names: Vec<String> = desk.obtain(TRUTHS, &self.inputs_of_truth(scene), |key| {
            let settings = PathSettings { samples, ..PathSettings::default() };
            let first = seeds::first(&self.inputs_of_truth(scene));
            let seeds: Vec<u32> = (first..first + replicas).collect();
            let mut names = Vec::new();
            path::render_each(
                scene,
                &settings,
                Backend::Cpu,
                &seeds,
                &|done, _| desk.report(done, "path tracing"),
                &mut |seed, image| {
                    let name = format!("{TRUTHS}/{key}.seed-{seed}.exr");
                    image.write_exr(&desk.folder()?.join(&name), false)?;
                    names.push(name);
                    Ok(())
                },
            )?;
            Ok(names)
        })?;
        let folder = desk.folder()?;
        let truth: Vec<Image> = names.iter().map(|name| Image::read_exr(&folder.join(name))).collect::<Result<_>>()?;
        let settings = ReferenceSettings { samples, ..ReferenceSettings::default() };
        let seeds: Vec<u32> = (FIRST_REPLICA_SEED..FIRST_REPLICA_SEED + replicas).collect();
        let cache = reference::cache_folder()?;
        let receive = |message: Message| desk.report(message.done, "Cycles");
        let begin = Instant::now();
        let found = releases::within(release, || reference::references(scene, &settings, &seeds, &cache, receive))?;
        let rendered = found.iter().filter(|one| !one.cached).count();
        let seconds = (rendered > 0).then(|| begin.elapsed().as_secs_f64() / rendered as f64);
        let theirs: Vec<Image> = found.iter().map(|one| Image::read_exr(&one.path)).collect::<Result<_>>()?;
        let difference = |(theirs, ours): (&Image, &Image)| {
            errors::numbers(theirs).iter().zip(errors::numbers(ours)).map(|(theirs, ours)| theirs - ours).collect()
        };
        let differences: Vec<Vec<f64>> = theirs.iter().zip(&truth).map(difference).collect();
        Ok(Picture {
            scene: scene.name.clone(),
            release: release.to_owned(),
            brightness: errors::from_left_out(&errors::brightness_of_differences(&differences, &truth)),
            relmse: errors::from_left_out(&errors::relmse_of_differences(&differences, &truth)?),
            seconds,
        })
    }
}

/// Part of the ledger that holds path tracing.
const TRUTHS: &str = "truth";

impl Experiment for Running {
    type Job = Job;
    type Record = Record;
    type Summary = Drift;

    fn purpose(&self) -> Purpose {
        PURPOSE
    }

    fn plan(&self) -> Result<Vec<Job>> {
        let releases = 0..self.asked.releases.len();
        let pictures =
            (0..self.scenes.len()).flat_map(|scene| releases.clone().map(move |release| Job::Picture(release, scene)));
        Ok(releases.clone().map(Job::Nodes).chain(pictures).collect())
    }

    fn inputs(&self, job: &Job) -> Result<Json> {
        let Asked { releases, points, seed, node, blender, .. } = &self.asked;
        Ok(match *job {
            Job::Nodes(release) => {
                let mut inputs = json!({"release": releases[release], "points": points, "seed": seed, "node": node});
                if !blender.is_default() {
                    inputs["blender"] = json!(blender);
                }
                inputs
            }
            Job::Picture(release, scene) => {
                json!({"release": releases[release], "picture": self.inputs_of_truth(&self.scenes[scene])})
            }
        })
    }

    fn label(&self, job: &Job) -> String {
        match *job {
            Job::Nodes(release) => format!("Blender {}", self.asked.releases[release]),
            Job::Picture(release, scene) => {
                format!("{} by Blender {}", self.scenes[scene].name, self.asked.releases[release])
            }
        }
    }

    fn run(&mut self, job: &Job, desk: &Desk<'_>) -> Result<Found<Record>> {
        let found = match *job {
            Job::Nodes(release) => self.nodes(&self.asked.releases[release], desk).map(Record::Nodes),
            Job::Picture(release, scene) => {
                self.picture(&self.asked.releases[release], &self.scenes[scene], desk).map(Record::Picture)
            }
        };
        // The others can still be asked.
        Ok(found.map_or_else(|error| Found::LeftOut(error.to_string()), Found::Record))
    }

    fn summary(&mut self, found: Vec<Done<Self>>, desk: &Desk<'_>) -> Result<Drift> {
        let (mut releases, mut pictures, mut left_out) = (Vec::new(), Vec::new(), Vec::new());
        for Done { job, found } in found {
            match found {
                Found::Record(Record::Nodes(release)) => releases.push(release),
                Found::Record(Record::Picture(picture)) => pictures.push(picture),
                Found::LeftOut(reason) => left_out.push([self.label(&job), reason]),
            }
        }
        let (format, builds, asked) = (FORMAT.into(), desk.ledger.builds(), self.asked.clone());
        let drift = Drift { format, builds, asked, releases, pictures, left_out };
        let folder = desk.folder()?;
        files::write_atomically(&folder.join("drift.json"), to_json(&drift).as_bytes())?;
        files::write_atomically(&folder.join("drift.md"), drift.markdown().as_bytes())?;
        Ok(drift)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(node: &str, status: Status, largest_error: f64) -> Row {
        let (mode, output) = (String::new(), "Value".to_owned());
        Row {
            node: node.into(),
            mode,
            output,
            status,
            points: [8, 2],
            ordinary_points: [4, 1],
            largest_error,
            note: None,
        }
    }

    #[test]
    fn the_table_has_what_differs_and_counts_the_rest() {
        let release = |name: &str, statuses: [Status; 3]| Release {
            release: name.into(),
            blender: name.into(),
            seconds: 1.0,
            rows: vec![row("Math", statuses[0], 0.0), row("Mix", statuses[1], 0.25), row("Mix", statuses[2], 0.5)],
        };
        let asked = Asked {
            releases: Vec::new(),
            points: 8,
            seed: 1,
            node: None,
            samples: 1,
            replicas: 6,
            blender: scene::Release::V5_0,
        };
        let drift = Drift {
            format: FORMAT.into(),
            builds: Vec::new(),
            asked,
            releases: vec![
                release("4.5.15", [Status::Equal, Status::Strange, Status::Differs]),
                release("5.0.1", [Status::Equal; 3]),
            ],
            pictures: Vec::new(),
            left_out: Vec::new(),
        };
        let text = drift.markdown();
        assert!(
            text.contains(
                "| outputs of all modes | 1 of 3 equal, 2 at ordinary values | 3 of 3 equal, 3 at ordinary values |"
            ),
            "{text}"
        );
        assert!(text.contains("| Mix | 1 differ, 1 at strange values of 2, up to 5.0e-1 | equal |"), "{text}");
        assert!(text.contains("| 1 other nodes | equal | equal |"), "{text}");
        assert_eq!(serde_json::from_str::<Drift>(&to_json(&drift)).expect("a drift"), drift);
    }

    #[test]
    fn what_cannot_be_had_is_refused_before_anything_is_made() {
        let folder = tempfile::tempdir().expect("a folder");
        let asked = |release: &str, replicas: u32| Asked {
            releases: vec![release.into()],
            points: 8,
            seed: 1,
            node: None,
            samples: 1,
            replicas,
            blender: scene::Release::V5_0,
        };
        let ask = |asked: Asked| measure(asked, Vec::new(), folder.path(), &Settings::default(), &|_, _| ());
        assert!(ask(asked("five", 6)).expect_err("refused").found.contains("five"));
        assert!(ask(asked("5.0.1", 5)).expect_err("refused").expected.contains("6"));
    }
}
