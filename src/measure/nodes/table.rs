//! The table of nodes: everything that the registry knows of each node, with what was measured of it, and everything refused.
//!
//! It is made from the registry alone, so that it cannot list what is not there: `cloudparity nodes` prints it, and
//! `docs/nodes.md` is its Markdown.

use crate::base::error::Result;
use crate::measure::nodes::costs::NodeCost;
use crate::measure::nodes::measurements;
use crate::measure::nodes::measurements::ErrorRow;
use crate::measure::nodes::node_releases;
use crate::measure::nodes::suite;
use crate::nodes::closure::ClosureRole;
use crate::nodes::refused::{self, Part};
use crate::nodes::{self, Mode, NodeType, Property, PropertyValues, Role, socket_limits};
use crate::scene::SocketType;
use serde::Serialize;
use serde_json::{Map, Value as Json};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Format of the JSON.
pub const FORMAT: &str = "cloudparity-nodes/1";

/// All nodes.
#[derive(Debug, Serialize)]
pub struct Table {
    /// [`FORMAT`].
    pub format: &'static str,
    /// What the errors were measured with; none before they were.
    pub errors: Option<ErrorsFrom>,
    /// What the costs were measured on; none before they were.
    pub costs_from: Option<String>,
    /// The nodes of the registry, in its order.
    pub nodes: Vec<NodeEntry>,
    /// Refused node types that the registry does not hold.
    pub refused: Vec<RefusedEntry>,
}

/// What errors were measured with.
#[derive(Debug, Serialize)]
pub struct ErrorsFrom {
    /// Blender's version.
    pub blender: String,
    /// Points per mode that were asked for.
    pub points: usize,
    /// Adapter and driver of the WGSL; none where it was left out.
    pub adapter: Option<String>,
}

/// A node.
#[derive(Debug, Serialize)]
pub struct NodeEntry {
    /// Blender's `bl_idname`.
    #[serde(rename = "type")]
    pub type_name: &'static str,
    /// Blender's label.
    pub label: &'static str,
    /// What the compiler does with it.
    pub role: &'static str,
    /// What it computes: the head of its shader module.
    pub about: String,
    /// What evaluates it.
    pub evaluators: Vec<&'static str>,
    /// Properties that decide its mode.
    pub properties: Vec<PropertyEntry>,
    /// Inputs in Blender's order.
    pub inputs: Vec<InputEntry>,
    /// Outputs in Blender's order.
    pub outputs: Vec<OutputEntry>,
    /// What of it is refused, and what to do instead.
    pub restrictions: Vec<String>,
    /// Releases of Blender that have its values, in words; empty where none was measured.
    pub releases: Vec<String>,
    /// Its modes, as comparisons with Cycles try them.
    pub modes: Vec<ModeEntry>,
}

/// A property.
#[derive(Debug, Serialize)]
pub struct PropertyEntry {
    /// Blender's identifier.
    pub identifier: &'static str,
    /// Legal values in words; for choices, the names.
    pub values: Vec<String>,
    /// Blender's default, where it is a name or a number.
    pub default: Option<String>,
}

/// An input.
#[derive(Debug, Serialize)]
pub struct InputEntry {
    /// Blender's identifier.
    pub identifier: &'static str,
    /// Blender's label.
    pub label: &'static str,
    /// Kind of value.
    pub kind: SocketType,
    /// Components where the file stores none; empty for closures and texts.
    pub default: &'static [f32],
    /// Reads Generated coordinates when nothing is linked.
    pub generated_when_unlinked: bool,
    /// Least stored value that Blender takes, if there is one.
    pub stored_from: Option<f32>,
    /// Range that the node limits the value to, stored or linked.
    pub used: Option<String>,
    /// Modes in which it exists; empty: all.
    pub exists: String,
}

/// An output.
#[derive(Debug, Serialize)]
pub struct OutputEntry {
    /// Blender's identifier.
    pub identifier: &'static str,
    /// Kind of value.
    pub kind: SocketType,
    /// Whether a link from it is refused.
    pub refused: bool,
    /// Modes in which it exists; empty: all.
    pub exists: String,
}

/// A mode and what was measured of it.
#[derive(Debug, Serialize)]
pub struct ModeEntry {
    /// In words, as `cloudparity modes` names it.
    pub mode: String,
    /// How far it is from Cycles.
    pub errors: Option<&'static ErrorRow>,
    /// What a point costs.
    pub cost: Option<&'static NodeCost>,
}

/// A refused node type.
#[derive(Debug, Serialize)]
pub struct RefusedEntry {
    /// Blender's `bl_idname`.
    #[serde(rename = "type")]
    pub type_name: &'static str,
    /// Blender's label.
    pub label: &'static str,
    /// Why: the node ...
    pub reason: &'static str,
    /// The nearest thing that is possible.
    pub instead: &'static str,
}

/// The evaluators that every kernel has, by its trait.
const KERNEL: [&str; 5] = ["f32", "f64 oracle", "f64", "rounding bound", "bounds"];

/// Makes the table.
pub fn table() -> Result<Table> {
    let (errors, costs) = (measurements::errors(), measurements::costs());
    let mut words: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    // The names of modes are those of the cases that are measured; their points do not matter here.
    for case in suite::cases(2, 1, None, suite::Selection::Everything)? {
        words.entry(case.node).or_default().push(case.mode);
    }
    let mut entries = Vec::new();
    for node_type in nodes::registry() {
        let modes = suite::modes(node_type)
            .into_iter()
            .map(|properties| Ok((Mode::read(node_type, &properties, node_type.label)?, properties)))
            .collect::<Result<Vec<_>>>()?;
        let names = words.remove(node_type.label).unwrap_or_default();
        entries.push(entry(node_type, &modes, names));
    }
    Ok(Table {
        format: FORMAT,
        errors: (!errors.rows.is_empty()).then(|| ErrorsFrom {
            blender: errors.blender.clone(),
            points: errors.points,
            adapter: errors.adapter.clone(),
        }),
        costs_from: (!costs.rows.is_empty()).then(|| format!("{}; Cycles: {}", costs.machine, costs.cycles)),
        nodes: entries,
        refused: refused::NODES
            .iter()
            .filter(|node| nodes::find(node.type_name).is_none())
            .map(|node| RefusedEntry {
                type_name: node.type_name,
                label: node.label,
                reason: node.reason,
                instead: node.instead,
            })
            .collect(),
    })
}

/// A mode and the properties that it was read from.
type Known = (Mode, Map<String, Json>);

fn entry(node_type: &'static NodeType, modes: &[Known], names: Vec<String>) -> NodeEntry {
    let (role, mut evaluators) = match node_type.role {
        Role::Evaluated(_) => ("evaluated", KERNEL.to_vec()),
        Role::Source(_) => ("source: the compiler puts a coordinate, a constant or a grid in its place", Vec::new()),
        Role::Closure(ClosureRole::Medium(_)) => ("closure: a formula of the integrators", vec!["f64", "bounds"]),
        Role::Closure(_) => ("closure: the compiler resolves it into factors of closures", Vec::new()),
    };
    evaluators.extend((!node_type.shader.is_empty()).then_some("WGSL"));
    let refused_output = |identifier: &'static str| {
        refused::parts(node_type.type_name).any(|refused| refused.part == Part::Output(identifier))
    };
    NodeEntry {
        type_name: node_type.type_name,
        label: node_type.label,
        role,
        about: head_of(node_type.shader),
        evaluators,
        properties: node_type.properties.iter().map(property).collect(),
        inputs: node_type
            .inputs
            .iter()
            .map(|socket| InputEntry {
                identifier: socket.identifier,
                label: socket.label,
                kind: socket.kind,
                default: socket.default,
                generated_when_unlinked: socket.generated_when_unlinked,
                stored_from: Some(socket_limits::stored(socket.kind)[0]).filter(|low| low.is_finite()),
                used: socket_limits::used_of(node_type.type_name, socket.identifier).map(|used| {
                    format!(
                        "{}{}{}",
                        range(used.range),
                        if used.condition.is_empty() { "" } else { " " },
                        used.condition
                    )
                }),
                exists: existence(node_type, modes, socket.exists),
            })
            .collect(),
        outputs: node_type
            .outputs
            .iter()
            .map(|socket| OutputEntry {
                identifier: socket.identifier,
                kind: socket.kind,
                refused: refused_output(socket.identifier),
                exists: existence(node_type, modes, socket.exists),
            })
            .collect(),
        restrictions: refused::parts(node_type.type_name)
            .map(|refused| {
                let what = match refused.part {
                    Part::Output(identifier) => format!("Output {identifier}"),
                    Part::Setting(property, value) => format!("{property} {value}"),
                };
                format!("{what} {}. {}", refused.reason, refused.instead)
            })
            .collect(),
        releases: node_releases::committed().in_words(node_type.label),
        modes: names
            .into_iter()
            .map(|mode| ModeEntry {
                errors: measurements::errors().find(node_type.label, &mode),
                cost: measurements::costs().rows.iter().find(|row| row.node == node_type.label && row.mode == mode),
                mode,
            })
            .collect(),
    }
}

/// The comment at the head of a shader module, joined into one paragraph.
fn head_of(shader: &str) -> String {
    let lines = shader.lines().map_while(|line| line.strip_prefix("//"));
    lines.map(str::trim).collect::<Vec<_>>().join(" ").trim().to_owned()
}

fn range([low, high]: [f32; 2]) -> String {
    match (low.is_finite(), high.is_finite()) {
        (true, true) => format!("{low} to {high}"),
        (true, false) => format!("from {low}"),
        (false, true) => format!("up to {high}"),
        (false, false) => "any".to_owned(),
    }
}

fn property(property: &Property) -> PropertyEntry {
    let (values, default) = match property.values {
        PropertyValues::Choice(names) => {
            (names.iter().map(|&name| name.to_owned()).collect(), Some(names[0].to_owned()))
        }
        PropertyValues::Flag(default) => (vec!["true or false".to_owned()], Some(default.to_string())),
        PropertyValues::Integer { default, limits: [low, high], .. } => {
            (vec![format!("{low} to {high}, whole")], Some(default.to_string()))
        }
        PropertyValues::Number { default, limits, .. } => (vec![range(limits)], Some(default.to_string())),
        PropertyValues::Data { .. } => (vec!["a ramp or curves".to_owned()], None),
        PropertyValues::StoredOutput(default) => {
            (vec!["a vector that the output keeps".to_owned()], Some(components(&default)))
        }
        PropertyValues::Other => (vec!["see docs/scene-format.md".to_owned()], None),
    };
    PropertyEntry { identifier: property.identifier, values, default }
}

fn components(values: &[f32]) -> String {
    values.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

/// In which modes a socket exists, by the values of properties: "operation: ADD, SUBTRACT"; empty for all.
fn existence(node_type: &NodeType, modes: &[Known], exists: fn(&Mode) -> bool) -> String {
    let there: Vec<bool> = modes.iter().map(|(mode, _)| exists(mode)).collect();
    if there.iter().all(|&exists| exists) {
        return String::new();
    }
    if !there.contains(&true) {
        return "never".to_owned();
    }
    // The values of each property with which it exists in some mode.
    let mut conditions: Vec<(&str, Vec<&Json>, Vec<&Json>)> = Vec::new();
    for property in node_type.properties {
        let (mut all, mut some): (Vec<&Json>, Vec<&Json>) = (Vec::new(), Vec::new());
        for ((_, properties), &exists) in modes.iter().zip(&there) {
            let Some(value) = properties.get(property.identifier) else { continue };
            if !all.contains(&value) {
                all.push(value);
            }
            if exists && !some.contains(&value) {
                some.push(value);
            }
        }
        if some.len() < all.len() {
            conditions.push((property.identifier, all, some));
        }
    }
    let fits = |properties: &Map<String, Json>| {
        conditions.iter().all(|(name, _, some)| properties.get(*name).is_some_and(|value| some.contains(&value)))
    };
    if modes.iter().zip(&there).any(|((_, properties), &exists)| fits(properties) != exists) {
        let count = there.iter().filter(|&&exists| exists).count();
        return format!("{count} of {} modes", modes.len());
    }
    let word = |value: &Json| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    let words = |values: &[&Json]| values.iter().map(|value| word(value)).collect::<Vec<_>>().join(", ");
    let texts: Vec<String> = conditions
        .iter()
        .map(|(name, all, some)| {
            let missing: Vec<&Json> = all.iter().copied().filter(|value| !some.contains(value)).collect();
            if missing.len() < some.len() {
                format!("{name}: not {}", words(&missing))
            } else {
                format!("{name}: {}", words(some))
            }
        })
        .collect();
    texts.join("; ")
}

/// What a node's modes have in common.
#[derive(Default)]
struct Worst {
    measured: usize,
    differing_modes: usize,
    cpu: f64,
    wgsl: Option<f64>,
    failing: usize,
    cost: Option<[f64; 2]>,
    /// Cycles' cost over ours.
    ratio: Option<[f64; 2]>,
}

/// The range with a further value in it.
fn widened(range: Option<[f64; 2]>, value: f64) -> Option<[f64; 2]> {
    let [low, high] = range.unwrap_or([value; 2]);
    Some([low.min(value), high.max(value)])
}

/// A range in words, each end by `words`; one of them where they are equal.
fn in_words([low, high]: [f64; 2], words: fn(f64) -> String) -> String {
    if words(low) == words(high) { words(low) } else { format!("{} to {}", words(low), words(high)) }
}

impl NodeEntry {
    fn worst(&self) -> Worst {
        let mut worst = Worst::default();
        for errors in self.modes.iter().filter_map(|mode| mode.errors) {
            worst.measured += 1;
            worst.differing_modes += usize::from(errors.cpu_differing > 0);
            worst.failing += usize::from(!errors.pass);
            worst.cpu = worst.cpu.max(errors.cpu_max_error);
            if let Some(error) = errors.wgsl_max_error {
                worst.wgsl = Some(worst.wgsl.unwrap_or(0.0).max(error));
            }
        }
        for cost in self.modes.iter().filter_map(|mode| mode.cost) {
            worst.cost = widened(worst.cost, cost.cloudparity_ns);
            if let Some(ratio) = cost.ratio {
                worst.ratio = widened(worst.ratio, ratio);
            }
        }
        worst
    }

    fn summary_cells(&self) -> [String; COLUMNS] {
        let worst = self.worst();
        let unmeasured = || if self.modes.is_empty() { String::new() } else { NOT_MEASURED.to_owned() };
        let (cpu, wgsl) = match (worst.measured, worst.differing_modes) {
            (0, _) => (unmeasured(), unmeasured()),
            (1, 0) => ("equal".to_owned(), worst.wgsl.map_or_else(unmeasured, error)),
            (measured, 0) => (format!("equal in {measured} modes"), worst.wgsl.map_or_else(unmeasured, error)),
            (_, differing) => {
                (format!("{} in {differing} modes", error(worst.cpu)), worst.wgsl.map_or_else(unmeasured, error))
            }
        };
        let cost = worst.cost.map_or_else(unmeasured, |range| in_words(range, nanoseconds));
        let ratio = worst.ratio.map_or_else(String::new, |range| in_words(range, ratio_in_words));
        let modes = if self.modes.is_empty() { String::new() } else { self.modes.len().to_string() };
        let failing =
            if worst.failing > 0 { format!("; {} beyond their limits", worst.failing) } else { String::new() };
        let releases = node_releases::committed().cell(self.label);
        [self.label.to_owned(), modes, cpu + &failing, wgsl, cost, ratio, releases]
    }
}

const NOT_MEASURED: &str = "not measured";

fn error(error: f64) -> String {
    if error == 0.0 { "0".to_owned() } else { format!("{error:.1e}") }
}

fn nanoseconds(time: f64) -> String {
    if time < 100.0 { format!("{time:.1} ns") } else { format!("{time:.0} ns") }
}

fn ratio_in_words(ratio: f64) -> String {
    if ratio < 10.0 { format!("{ratio:.1}") } else { format!("{ratio:.0}") }
}

/// Writes one line.
fn line(text: &mut String, parts: std::fmt::Arguments<'_>) {
    writeln!(text, "{parts}").expect("writing to a string cannot fail");
}

/// A row of a Markdown table. A bar within a cell would end it.
fn row<S: AsRef<str>>(text: &mut String, cells: &[S]) {
    let cells: Vec<String> = cells.iter().map(|cell| cell.as_ref().replace('|', "\\|")).collect();
    line(text, format_args!("| {} |", cells.join(" | ")));
}

/// The head of a Markdown table.
fn head(text: &mut String, names: &[&str]) {
    row(text, names);
    row(text, &vec!["---"; names.len()]);
}

const COLUMNS: usize = 7;

const SUMMARY_HEAD: [&str; COLUMNS] = [
    "node",
    "modes",
    "f32 against Cycles",
    "WGSL: largest error",
    "CPU per point",
    "Cycles / CPU",
    "equal in releases",
];

impl Table {
    /// Labels that the compiler gives its own nodes begin with a parenthesis.
    fn blenders(&self) -> impl Iterator<Item = &NodeEntry> {
        self.nodes.iter().filter(|node| !node.label.starts_with('('))
    }

    /// A line per node.
    pub fn text(&self) -> String {
        let rows: Vec<[String; COLUMNS]> = self.blenders().map(NodeEntry::summary_cells).collect();
        let widths: [usize; COLUMNS] = std::array::from_fn(|column| {
            rows.iter().map(|row| row[column].chars().count()).chain([SUMMARY_HEAD[column].len()]).max().unwrap_or(0)
        });
        let mut text = String::new();
        for row in std::iter::once(SUMMARY_HEAD.map(str::to_owned)).chain(rows) {
            let cells: Vec<String> = row.iter().zip(widths).map(|(cell, width)| format!("{cell:<width$}")).collect();
            line(&mut text, format_args!("{}", cells.join("  ").trim_end()));
        }
        line(&mut text, format_args!("\nrefused where they reach the volume:"));
        for node in &self.refused {
            line(&mut text, format_args!("  {} {}. {}", node.label, node.reason, node.instead));
        }
        text
    }

    /// The text of `docs/nodes.md`.
    pub fn markdown(&self) -> String {
        let mut text = String::from(
            "# Nodes\n\n\
             Every node that this version knows, from its registry: what it computes, its sockets by identifier, its modes, how far\n\
             it was measured to be from Cycles, and what a point costs. Made by `cloudparity nodes`; a test compares.\n\n",
        );
        match &self.errors {
            Some(from) => line(
                &mut text,
                format_args!(
                    "Errors are the largest of a mode's outputs against Blender {} (Cycles' SSE4.2 kernel), relative to \
                     max(1, |Cycles|),\nover {} points of each mode (`cloudparity modes`): half of those of textures lie far \
                     beyond every limit, and arithmetic nodes\nget special values, too. WGSL ran on {} and is judged at \
                     ordinary points.",
                    from.blender,
                    from.points,
                    from.adapter.as_deref().unwrap_or("no adapter")
                ),
            ),
            None => line(&mut text, format_args!("Errors: not measured (the summary of `cloudparity modes`).")),
        }
        match &self.costs_from {
            Some(machine) => line(
                &mut text,
                format_args!(
                    "Costs are nanoseconds per point on one thread, and on the adapter with the transfer of values taken off: \
                     {machine}.\nAfter ± stands how far Cycles' two least times are apart. Both sides see the same points again and \
                     again, so that processors have\nlearnt their decisions."
                ),
            ),
            None => line(&mut text, format_args!("Costs: not measured (`cloudparity bench-nodes`).")),
        }
        text.push_str(
            "\nA *range* is what the node limits a value to, stored or linked; beyond it, the value at its end holds. Colours stored \
             in Blender are\nat least 0; other sockets take every finite number.\n\n",
        );
        text.push_str(
            "*Equal in releases* says which releases of Blender have the same values in all modes, bit for bit (`cloudparity measure \
             drift`, [releases](releases.md));\nin brackets: at ordinary values. *By the values of 4.5*: of scenes that ask for them.\n\n",
        );
        head(&mut text, &SUMMARY_HEAD);
        for node in self.blenders() {
            let [label, rest @ ..] = node.summary_cells();
            let cells: Vec<String> = std::iter::once(format!("[{label}](#{})", anchor(&label))).chain(rest).collect();
            row(&mut text, &cells);
        }
        for node in self.blenders() {
            node.markdown(&mut text);
        }
        let inserted: Vec<&NodeEntry> = self.nodes.iter().filter(|node| node.label.starts_with('(')).collect();
        if !inserted.is_empty() {
            text.push_str(
                "\n## Inserted by the compiler\n\nNot Blender's: conversions between sockets, and coordinates.\n\n",
            );
            head(&mut text, &SUMMARY_HEAD);
            for node in inserted {
                row(&mut text, &node.summary_cells());
            }
        }
        text.push_str(
            "\n## Refused\n\nA graph that holds one of these where it reaches the volume is an error; elsewhere they do not matter.\n\n",
        );
        head(&mut text, &["node", "type", "why: it ...", "instead"]);
        for node in &self.refused {
            row(&mut text, &[node.label, &format!("`{}`", node.type_name), node.reason, node.instead]);
        }
        text
    }
}

/// What a heading is linked by.
fn anchor(label: &str) -> String {
    let kept = label.chars().filter(|&c| c.is_alphanumeric() || c == ' ' || c == '-');
    kept.map(|c| if c == ' ' { '-' } else { c.to_ascii_lowercase() }).collect()
}

impl NodeEntry {
    fn markdown(&self, text: &mut String) {
        line(text, format_args!("\n## {}\n", self.label));
        let evaluators =
            if self.evaluators.is_empty() { String::new() } else { format!(" ({})", self.evaluators.join(", ")) };
        line(text, format_args!("`{}`, {}{evaluators}.", self.type_name, self.role));
        if !self.about.is_empty() {
            // A name in angle brackets would be read as HTML.
            line(text, format_args!("\n{}", self.about.replace('<', "\\<")));
        }
        if !self.properties.is_empty() {
            text.push('\n');
            head(text, &["property", "values", "default"]);
            for property in &self.properties {
                let default = property.default.as_deref().unwrap_or_default();
                row(text, &[property.identifier, &property.values.join(", "), default]);
            }
        }
        // Blender's unused weights exist nowhere.
        let inputs: Vec<&InputEntry> = self.inputs.iter().filter(|input| input.exists != "never").collect();
        if !inputs.is_empty() {
            text.push('\n');
            head(text, &["input", "label", "kind", "default", "range", "exists"]);
            for input in inputs {
                let default = if input.generated_when_unlinked {
                    "Generated coordinates".to_owned()
                } else {
                    components(input.default)
                };
                let kind = if input.default.is_empty() { "closure or text".to_owned() } else { input.kind.to_string() };
                let used = input.used.clone().unwrap_or_default();
                row(text, &[input.identifier, input.label, &kind, &default, &used, &input.exists]);
            }
        }
        text.push('\n');
        head(text, &["output", "kind", "exists"]);
        for output in &self.outputs {
            let exists = if output.refused { "refused" } else { &output.exists };
            row(text, &[output.identifier, &output.kind.to_string(), exists]);
        }
        if !self.releases.is_empty() {
            line(text, format_args!("\nEqual in releases: {}.", self.releases.join("; ")));
        }
        if !self.restrictions.is_empty() {
            text.push('\n');
            for restriction in &self.restrictions {
                line(text, format_args!("- {restriction}"));
            }
        }
        let measured = |mode: &&ModeEntry| mode.errors.is_some() || mode.cost.is_some();
        let modes: Vec<&ModeEntry> = self.modes.iter().filter(measured).collect();
        if modes.is_empty() {
            return;
        }
        line(text, format_args!("\n<details><summary>Errors and costs of {} modes</summary>\n", modes.len()));
        head(
            text,
            &[
                "mode",
                "f32: points that differ",
                "f32: largest error",
                "WGSL: largest error",
                "WGSL: ulp",
                "WGSL: beyond its limit",
                "f32",
                "f64",
                "WGSL",
                "Cycles",
                "Cycles / f32",
            ],
        );
        for mode in modes {
            row(text, &mode.cells());
        }
        line(text, format_args!("\n</details>"));
    }
}

impl ModeEntry {
    fn cells(&self) -> Vec<String> {
        let mut cells = vec![if self.mode.is_empty() { "(one mode)".to_owned() } else { self.mode.clone() }];
        match self.errors {
            None => cells.extend(std::iter::once(NOT_MEASURED.to_owned()).chain(vec![String::new(); 4])),
            Some(errors) => {
                let differing = errors.cpu_differing;
                cells.push(if differing == 0 { "0".to_owned() } else { format!("{differing} of {}", errors.points) });
                cells.push(error(errors.cpu_max_error));
                cells.push(errors.wgsl_max_error.map(error).unwrap_or_default());
                cells.push(errors.wgsl_max_ulp.map(|ulp| ulp.to_string()).unwrap_or_default());
                let points = errors.wgsl_points.unwrap_or(0);
                cells.push(match (errors.wgsl_beyond, errors.wgsl_explained) {
                    (None, _) => String::new(),
                    (Some(0), _) => "0".to_owned(),
                    (Some(beyond), explained) => {
                        format!("{beyond} of {points} ({} within their rounding bound)", explained.unwrap_or(0))
                    }
                });
            }
        }
        match self.cost {
            None => cells.extend(std::iter::once(NOT_MEASURED.to_owned()).chain(vec![String::new(); 4])),
            Some(cost) => {
                // What is taken off an evaluation in WGSL may be more than its spread leaves.
                let all = [Some(cost.cloudparity_ns), Some(cost.oracle_ns), cost.wgsl_ns.map(|time| time.max(0.0))];
                cells.extend(all.map(|time| time.map(nanoseconds).unwrap_or_default()));
                let spread =
                    cost.cycles_spread_ns.map(|spread| format!(" ± {}", nanoseconds(spread))).unwrap_or_default();
                cells.push(cost.cycles_ns.map(|time| nanoseconds(time) + &spread).unwrap_or_default());
                cells.push(cost.ratio.map(ratio_in_words).unwrap_or_default());
            }
        }
        cells
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry_of(label: &str) -> NodeEntry {
        table().expect("the table").nodes.into_iter().find(|node| node.label == label).expect("a registered node")
    }

    #[test]
    fn existence_is_told_by_properties() {
        let range = entry_of("Map Range");
        let exists = |identifier: &str| {
            let input = range.inputs.iter().find(|input| input.identifier == identifier);
            input.expect("an input of Map Range").exists.clone()
        };
        assert_eq!(exists("Value"), "data_type: FLOAT");
        assert_eq!(exists("Steps"), "interpolation_type: STEPPED; data_type: FLOAT");
        let math = entry_of("Math");
        assert_eq!(math.inputs[0].exists, "");
        assert!(math.inputs[2].exists.starts_with("operation: MULTIPLY_ADD, COMPARE"), "{}", math.inputs[2].exists);
    }

    #[test]
    fn heads_of_shaders_become_paragraphs() {
        assert_eq!(head_of("// One\n// two.\n#import x\n\n// not this\nfn f() {}\n"), "One two.");
        assert!(entry_of("Clamp").about.starts_with("Clamp node (ShaderNodeClamp): limits"));
    }

    #[test]
    fn refused_outputs_and_settings_are_restrictions() {
        let coordinate = entry_of("Texture Coordinate");
        let refused: Vec<&str> =
            coordinate.outputs.iter().filter(|output| output.refused).map(|output| output.identifier).collect();
        assert_eq!(refused, ["Normal", "UV", "Camera", "Window", "Reflection"]);
        assert!(coordinate.restrictions.iter().any(|text| text.starts_with("from_instancer true takes")));
    }
}
