//! Drift: what other releases of Blender make of the same nodes at the same points.
//!
//! Our evaluators have the values of one release ([`crate::bridge::releases`] lists them; the last is ours). Every mode of every node is asked
//! of each release, by its own Cycles, at equal points: it is equal bit for bit, within its limit, different, different at strange values alone (NaN,
//! infinities, denormals, parameters beyond their limits), or not there. A release runs in an
//! environment of its own, which is made when it is first asked for.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::Identity;
use crate::base::ledger::{Found, Purpose, to_json};
use crate::base::progress::Progress;
use crate::bridge::releases;
use crate::measure::experiment;
use crate::measure::experiment::{Desk, Done, Experiment, Outcome, Settings};
use crate::measure::nodes::suite::{self, Case, ModeComparison, ModeComparisons, Selection};
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
                format!("{} of {} equal, {} at ordinary values", counts.equal, counts.all(), counts.equal + counts.strange)
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
        text
    }

    /// The table, and an example of every node that differs, in each release.
    pub fn summary(&self) -> String {
        let mut text = self.markdown();
        for release in &self.releases {
            for node in self.nodes() {
                let rows = || release.rows.iter().filter(|row| row.node == node);
                for wanted in [Status::Differs, Status::Strange, Status::Absent] {
                    let found = rows().filter(|row| row.status == wanted).max_by(|a, b| a.largest_error.total_cmp(&b.largest_error));
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
pub fn measure(asked: Asked, folder: &Path, settings: &Settings, progress: Progress<'_>) -> Result<Outcome<Drift>> {
    asked.releases.iter().try_for_each(|release| releases::check(release))?;
    let cases = suite::cases(asked.points, asked.seed, asked.node.as_deref(), Selection::Everything)?;
    experiment::run(&mut Running { asked, cases }, Some(folder), settings, progress)
}

struct Running {
    asked: Asked,
    cases: Vec<Case>,
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

impl Experiment for Running {
    type Job = String;
    type Record = Release;
    type Summary = Drift;

    fn purpose(&self) -> Purpose {
        PURPOSE
    }

    fn plan(&self) -> Result<Vec<String>> {
        Ok(self.asked.releases.clone())
    }

    fn inputs(&self, release: &String) -> Result<Json> {
        Ok(json!({"release": release, "points": self.asked.points, "seed": self.asked.seed, "node": self.asked.node}))
    }

    fn label(&self, release: &String) -> String {
        format!("Blender {release}")
    }

    fn run(&mut self, release: &String, desk: &Desk<'_>) -> Result<Found<Release>> {
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
        match releases::within(release, ask) {
            Ok(rows) => {
                let (release, seconds) = (release.clone(), begin.elapsed().as_secs_f64());
                Ok(Found::Record(Release { release, blender, seconds, rows: rows.concat() }))
            }
            Err(error) => Ok(Found::LeftOut(error.to_string())),
        }
    }

    fn summary(&mut self, found: Vec<Done<Self>>, desk: &Desk<'_>) -> Result<Drift> {
        let (mut releases, mut left_out) = (Vec::new(), Vec::new());
        for Done { job, found } in found {
            match found {
                Found::Record(release) => releases.push(release),
                Found::LeftOut(reason) => left_out.push([job, reason]),
            }
        }
        let drift =
            Drift { format: FORMAT.into(), builds: desk.ledger.builds(), asked: self.asked.clone(), releases, left_out };
        let folder = desk.folder()?;
        files::write_atomically(&folder.join("drift.json"), to_json(&drift).as_bytes())?;
        files::write_atomically(&folder.join("drift.md"), drift.markdown().as_bytes())?;
        Ok(drift)
    }
}
