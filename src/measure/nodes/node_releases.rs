//! Which releases of Blender have the values of our evaluators, node by node: the committed summary of [`super::drift`], for the table of nodes.

use crate::base::error::Result;
use crate::base::files;
use crate::measure::nodes::drift::{Drift, Status};
use crate::scene::{self, Release};
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::LazyLock;

/// Format of the file.
pub const FORMAT: &str = "cloudparity-node-releases/1";

/// Outputs of all modes of a node in a release.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeRelease {
    /// Blender's label of the node.
    pub node: String,
    /// The release, as 4.5.15.
    pub release: String,
    /// The release whose values our evaluators had.
    pub values: Release,
    /// Outputs of all modes.
    pub outputs: usize,
    /// Of these, equal bit for bit at every point.
    pub equal: usize,
    /// Of these, equal at every ordinary point: normal numbers and, of textures, parameters as one sets them.
    pub ordinary: usize,
}

/// What is known of all nodes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeReleases {
    /// [`FORMAT`].
    pub format: String,
    /// By values, release and node.
    pub rows: Vec<NodeRelease>,
}

/// The committed rows.
pub fn committed() -> &'static NodeReleases {
    static ROWS: LazyLock<NodeReleases> = LazyLock::new(|| {
        serde_json::from_str(include_str!("../../../parity/node-releases.json"))
            .expect("the committed file is well formed")
    });
    &ROWS
}

impl NodeReleases {
    /// Reads a file; one that is not there yet is empty.
    pub fn load(path: &Path) -> Result<Self> {
        if !path.exists() {
            return Ok(Self { format: FORMAT.into(), rows: Vec::new() });
        }
        let text = files::read_text(path, "releases of nodes (node-releases.json)")?;
        scene::parse(&text, &path.display().to_string(), "releases of nodes (parity/node-releases.json is one)")
    }

    /// Puts what was measured in the place of what was known of the same values, releases and nodes.
    pub fn put(&mut self, drift: &Drift) {
        for release in &drift.releases {
            let mut nodes: IndexMap<&str, NodeRelease> = IndexMap::new();
            for row in &release.rows {
                let node = nodes.entry(&row.node).or_insert_with(|| NodeRelease {
                    node: row.node.clone(),
                    release: release.release.clone(),
                    values: drift.asked.blender,
                    outputs: 0,
                    equal: 0,
                    ordinary: 0,
                });
                node.outputs += 1;
                node.equal += usize::from(row.status == Status::Equal);
                node.ordinary += usize::from(matches!(row.status, Status::Equal | Status::Strange));
            }
            for found in nodes.into_values() {
                let same = |known: &&mut NodeRelease| {
                    (&known.node, &known.release, known.values) == (&found.node, &found.release, found.values)
                };
                match self.rows.iter_mut().find(same) {
                    Some(known) => *known = found,
                    None => self.rows.push(found),
                }
            }
        }
    }

    /// The file: a row a line.
    pub fn to_text(&self) -> String {
        let line = |row: &NodeRelease| serde_json::to_string(row).expect("plain values serialise");
        let rows: Vec<String> = self.rows.iter().map(line).collect();
        format!("{{\n\"format\": \"{}\",\n\"rows\": [\n{}\n]\n}}\n", self.format, rows.join(",\n"))
    }

    /// What each release has of a node, oldest first: by the values that fit it best, the newest where several do.
    fn best_of(&self, label: &str) -> Vec<&NodeRelease> {
        let mut releases: IndexMap<&str, &NodeRelease> = IndexMap::new();
        for row in self.rows.iter().filter(|row| row.node == label) {
            let rank = |row: &NodeRelease| (row.equal, row.ordinary, row.values.is_default());
            let best = releases.entry(&row.release).or_insert(row);
            if rank(row) > rank(best) {
                *best = row;
            }
        }
        let mut rows: Vec<&NodeRelease> = releases.into_values().collect();
        rows.sort_by_key(|row| row.release.split('.').map(|part| part.parse().unwrap_or(0)).collect::<Vec<u32>>());
        rows
    }

    /// Releases and how much of a node's values they have, in words; empty where nothing was measured.
    pub fn in_words(&self, label: &str) -> Vec<String> {
        let words = |row: &NodeRelease| {
            let NodeRelease { release, outputs, equal, ordinary, .. } = row;
            let option = row.option();
            if equal == outputs {
                format!("{release}{option}")
            } else if ordinary == outputs {
                format!("{release}{option} at ordinary values")
            } else {
                format!("{release}{option}: {ordinary} of {outputs} outputs at ordinary values")
            }
        };
        self.best_of(label).into_iter().map(words).collect()
    }

    /// The same for a cell of a table: those that are equal, in brackets those that are at ordinary values.
    pub fn cell(&self, label: &str) -> String {
        let short = |row: &NodeRelease| {
            let line = row.release.rsplit_once('.').map_or(row.release.as_str(), |(line, _)| line);
            let text = format!("{line}{}", row.option());
            match (row.equal == row.outputs, row.ordinary == row.outputs) {
                (true, _) => Some(text),
                (_, true) => Some(format!("({text})")),
                _ => None,
            }
        };
        self.best_of(label).into_iter().filter_map(short).collect::<Vec<_>>().join(", ")
    }
}

impl NodeRelease {
    /// Which of our values they are, unless the newest.
    fn option(&self) -> String {
        if self.values.is_default() { String::new() } else { format!(" by the values of {}", self.values) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_release_is_told_by_the_values_that_fit_it_best() {
        let row = |release: &str, values, [outputs, equal, ordinary]: [usize; 3]| NodeRelease {
            node: "Mix".into(),
            release: release.into(),
            values,
            outputs,
            equal,
            ordinary,
        };
        let known = NodeReleases {
            format: FORMAT.into(),
            rows: vec![
                row("5.0.1", Release::V5_0, [4, 4, 4]),
                row("4.5.15", Release::V5_0, [4, 1, 2]),
                row("4.5.15", Release::V4_5, [4, 4, 4]),
                row("4.4.0", Release::V5_0, [4, 4, 4]),
                row("4.4.0", Release::V4_5, [4, 4, 4]),
                row("4.2.23", Release::V5_0, [4, 0, 3]),
                row("4.3.0", Release::V5_0, [4, 0, 4]),
            ],
        };
        let expected = [
            "4.2.23: 3 of 4 outputs at ordinary values",
            "4.3.0 at ordinary values",
            "4.4.0",
            "4.5.15 by the values of 4.5",
            "5.0.1",
        ];
        assert_eq!(known.in_words("Mix"), expected);
        assert_eq!(known.cell("Mix"), "(4.3), 4.4, 4.5 by the values of 4.5, 5.0");
        assert!(known.in_words("Math").is_empty());
        assert_eq!(serde_json::from_str::<NodeReleases>(&known.to_text()).expect("it is one"), known);
    }

    #[test]
    fn every_evaluated_node_of_blender_is_known() {
        use crate::nodes::{Role, registry};
        let evaluated = registry().iter().filter(|node| matches!(node.role, Role::Evaluated(_)));
        for node in evaluated.filter(|node| node.type_name.starts_with("ShaderNode")) {
            let words = committed().in_words(node.label);
            assert!(words.iter().any(|word| word.starts_with("5.0")), "{}: {words:?}", node.label);
        }
    }
}
