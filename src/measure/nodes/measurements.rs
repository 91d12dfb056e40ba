//! What was measured of every node in every mode, as committed: how far it is from Cycles, and what a point costs.
//!
//! `cloudparity modes` writes the errors as its summary, `cloudparity bench-nodes` the costs ([`super::costs`]). Both are compiled in, for
//! the table of nodes ([`super::table`]). A mode is named as [`super::suite::Case`] names it.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::{Identity, Resume};
use crate::measure::nodes::costs::Costs;
use crate::measure::nodes::suite::ModeComparison;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::LazyLock;

/// Format of the file of errors.
pub const ERRORS_FORMAT: &str = "cloudparity-node-errors/1";

/// Errors of all nodes and what they were measured with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeErrors {
    /// [`ERRORS_FORMAT`].
    pub format: String,
    /// The builds that measured the rows.
    pub builds: Vec<Identity>,
    /// Blender's version.
    pub blender: String,
    /// Points per mode that were asked for.
    pub points: usize,
    /// Adapter and driver of the WGSL; none where it was left out.
    pub adapter: Option<String>,
    /// One per node and mode.
    pub rows: Vec<ErrorRow>,
}

/// Errors of one node in one mode: the largest of its outputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ErrorRow {
    /// Blender's label of the node.
    pub node: String,
    /// The mode in words.
    pub mode: String,
    /// Points compared.
    pub points: usize,
    /// Points where f32 on the CPU does not equal Cycles.
    pub cpu_differing: usize,
    /// Largest |ours - Cycles| / max(1, |Cycles|) of f32 on the CPU where both are finite.
    pub cpu_max_error: f64,
    /// Points that WGSL was judged on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wgsl_points: Option<usize>,
    /// Largest error of WGSL, as `cpu_max_error`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wgsl_max_error: Option<f64>,
    /// The same in units in the last place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wgsl_max_ulp: Option<u32>,
    /// Points of WGSL beyond its limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wgsl_beyond: Option<usize>,
    /// Those of them that their own rounding bound explains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wgsl_explained: Option<usize>,
    /// Whether all outputs are within their limits.
    pub pass: bool,
}

/// The committed errors.
pub fn errors() -> &'static NodeErrors {
    static ERRORS: LazyLock<NodeErrors> = LazyLock::new(|| {
        serde_json::from_str(include_str!("../../../parity/node-errors.json"))
            .expect("the committed file is well formed")
    });
    &ERRORS
}

/// The committed costs.
pub fn costs() -> &'static Costs {
    static COSTS: LazyLock<Costs> = LazyLock::new(|| {
        serde_json::from_str(include_str!("../../../parity/node-costs.json"))
            .expect("the committed file is well formed")
    });
    &COSTS
}

/// Three digits: more are noise of the points that were drawn.
fn rounded(error: f64) -> f64 {
    format!("{error:.2e}").parse().unwrap_or(error)
}

/// A value as JSON on one line.
fn line(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("plain values serialise")
}

fn larger<T: PartialOrd + Copy>(a: Option<T>, b: Option<T>) -> Option<T> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if b > a { b } else { a }),
        (a, b) => a.or(b),
    }
}

impl NodeErrors {
    /// Summarises the rows of a suite.
    pub fn of_rows(rows: &[ModeComparison], blender: &str, points: usize, adapter: Option<String>) -> Self {
        let mut summary = Self {
            format: ERRORS_FORMAT.to_owned(),
            builds: vec![Identity::current().clone()],
            blender: blender.to_owned(),
            points,
            adapter,
            rows: Vec::<ErrorRow>::new(),
        };
        for row in rows {
            let of_mode = ErrorRow::of_output(row);
            // The outputs of a mode follow one another.
            match summary.rows.last_mut().filter(|last| last.node == row.node && last.mode == row.mode) {
                Some(known) => known.join(&of_mode),
                None => summary.rows.push(of_mode),
            }
        }
        summary
    }

    /// The row of a node and mode.
    pub fn find(&self, node: &str, mode: &str) -> Option<&ErrorRow> {
        self.rows.iter().find(|row| row.node == node && row.mode == mode)
    }

    /// Reads a file.
    pub fn load(path: &Path) -> Result<Self> {
        let text = files::read_text(path, "a summary of node errors")?;
        let wrong = |found: String| {
            Error::new(
                path.display().to_string(),
                found,
                format!("a file of the format {ERRORS_FORMAT}"),
                "Remove the file and measure all nodes.",
            )
        };
        let read: Self = serde_json::from_str(&text).map_err(|cause| wrong(cause.to_string()))?;
        if read.format == ERRORS_FORMAT { Ok(read) } else { Err(wrong(format!("the format {}", read.format))) }
    }

    /// Puts the rows of the nodes that `newer` holds into their places; refuses rows that were measured otherwise, or by another build
    /// unless these may be mixed.
    pub fn replace(&mut self, newer: Self, place: &str, resume: &Resume) -> Result<()> {
        let measured_with = |summary: &Self| {
            let adapter = summary.adapter.as_deref().unwrap_or("no adapter");
            format!("{} points, Blender {}, {adapter}", summary.points, summary.blender)
        };
        if measured_with(self) != measured_with(&newer) {
            return Err(Error::new(
                place,
                format!("rows measured with {}", measured_with(self)),
                format!("rows measured with {}", measured_with(&newer)),
                "Measure all nodes, not one alone.",
            )
            .with_setting("node"));
        }
        self.builds = resume.join(place, &self.builds)?;
        self.rows.retain(|row| !newer.rows.iter().any(|new| new.node == row.node));
        self.rows.extend(newer.rows);
        Ok(())
    }

    /// The file: one line per row, so that a difference shows what changed.
    pub fn to_text(&self) -> String {
        let rows: Vec<String> = self.rows.iter().map(|row| format!("\n  {}", line(row))).collect();
        format!(
            "{{\n \"format\": {},\n \"builds\": {},\n \"blender\": {},\n \"points\": {},\n \"adapter\": {},\n \"rows\": [{}\n ]\n}}\n",
            line(&self.format),
            line(&self.builds),
            line(&self.blender),
            self.points,
            line(&self.adapter),
            rows.join(",")
        )
    }
}

impl ErrorRow {
    fn of_output(row: &ModeComparison) -> Self {
        Self {
            node: row.node.clone(),
            mode: row.mode.clone(),
            points: row.points,
            cpu_differing: row.cpu_differing,
            cpu_max_error: rounded(row.cpu_max_error),
            wgsl_points: row.wgsl_points,
            wgsl_max_error: row.wgsl_max_error.map(rounded),
            wgsl_max_ulp: row.wgsl_max_ulp,
            wgsl_beyond: row.wgsl_beyond,
            wgsl_explained: row.wgsl_explained,
            pass: row.pass,
        }
    }

    /// Joins another output of the same mode.
    fn join(&mut self, other: &Self) {
        self.points = self.points.max(other.points);
        self.cpu_differing = self.cpu_differing.max(other.cpu_differing);
        self.cpu_max_error = self.cpu_max_error.max(other.cpu_max_error);
        self.wgsl_points = larger(self.wgsl_points, other.wgsl_points);
        self.wgsl_max_error = larger(self.wgsl_max_error, other.wgsl_max_error);
        self.wgsl_max_ulp = larger(self.wgsl_max_ulp, other.wgsl_max_ulp);
        // Of the output with most points beyond its limit.
        if other.wgsl_beyond > self.wgsl_beyond {
            (self.wgsl_beyond, self.wgsl_explained) = (other.wgsl_beyond, other.wgsl_explained);
        }
        self.pass &= other.pass;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(node: &str, mode: &str, output: &str, differing: usize, error: f64) -> ModeComparison {
        ModeComparison {
            node: node.into(),
            mode: mode.into(),
            output: output.into(),
            points: 9,
            cpu_max_error: 0.0,
            cpu_differing: differing,
            cpu_one_sided_nonfinite: 0,
            ordinary_points: 0,
            ordinary_differing: 0,
            ordinary_max_error: 0.0,
            ordinary_worst: None,
            wgsl_points: Some(5),
            wgsl_max_error: Some(error),
            wgsl_max_ulp: Some(2),
            wgsl_beyond: Some(differing),
            wgsl_explained: Some(0),
            avx2_max_error: None,
            limit: 0.0,
            limit_source: "",
            wgsl_limit: String::new(),
            pass: differing == 0,
            cpu_worst: None,
            wgsl_worst: None,
        }
    }

    fn summary(rows: &[ModeComparison]) -> NodeErrors {
        NodeErrors::of_rows(rows, "5.0.1", 9, Some("adapter".into()))
    }

    #[test]
    fn a_row_holds_the_largest_of_the_outputs_of_its_mode() {
        let rows = [row("A", "x", "One", 0, 1.23456e-7), row("A", "x", "Two", 3, 1e-8), row("A", "y", "One", 0, 0.0)];
        let found = summary(&rows);
        assert_eq!(found.rows.len(), 2);
        let first = found.find("A", "x").expect("a row");
        assert_eq!(
            (first.cpu_differing, first.wgsl_max_error, first.wgsl_beyond, first.pass),
            (3, Some(1.23e-7), Some(3), false)
        );
        assert!(found.find("A", "y").expect("a row").pass);
    }

    #[test]
    fn the_text_is_read_back_and_rows_of_one_node_are_replaced() {
        let mut known = summary(&[row("A", "x", "One", 0, 1e-7), row("B", "x", "One", 0, 2e-7)]);
        assert_eq!(serde_json::from_str::<NodeErrors>(&known.to_text()).expect("JSON"), known);
        let resume = Resume::default();
        known.replace(summary(&[row("A", "x", "One", 0, 3e-7)]), "here", &resume).expect("measured alike");
        assert_eq!(known.find("A", "x").and_then(|row| row.wgsl_max_error), Some(3e-7));
        assert_eq!(known.find("B", "x").and_then(|row| row.wgsl_max_error), Some(2e-7));
        let other = NodeErrors { adapter: None, ..summary(&[]) };
        assert!(known.replace(other, "here", &resume).is_err());
        // Rows of another build beside which new ones would stand.
        known.builds = vec![Identity::of("0.1.0", "another")];
        let error = known.replace(summary(&[]), "here", &resume).expect_err("another build").to_string();
        assert!(error.contains("0.1.0+another") && error.contains(&Identity::current().to_string()), "{error}");
        known.replace(summary(&[]), "here", &Resume::mixing()).expect("knowingly");
        assert_eq!(known.builds.len(), 2);
    }

    #[test]
    fn the_committed_files_have_their_formats() {
        assert_eq!(errors().format, ERRORS_FORMAT);
        assert_eq!(costs().format, crate::measure::nodes::costs::COSTS_FORMAT);
    }
}
