//! The node graph as it stands in a scene file: Blender's nodes, groups and links by name.

use crate::base::choice::choice;
use crate::base::error::{Error, Result as Checked};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::{HashMap, HashSet};

/// A material's node tree and the groups that it uses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Graph {
    /// Material name.
    pub material: String,
    /// Nodes of the material's own tree.
    pub nodes: Vec<Node>,
    /// Every node group in use, each once.
    #[serde(default)]
    pub groups: Vec<Group>,
    /// The release of Blender whose values the nodes have.
    #[serde(default, skip_serializing_if = "Release::is_default")]
    pub blender: Release,
}

choice! {
    "kebab-case",
    /// A release of Blender whose values our nodes have.
    #[derive(Default, Hash, PartialOrd, Ord, JsonSchema)]
    pub enum Release {
        /// Blender 4.5: Voronoi textures in 2D to 4D, weights of luminance, powers of zero and remainders of vectors differ from 5.0.
        #[serde(rename = "4.5")]
        #[strum(serialize = "4.5")]
        V4_5,
        /// Blender 5.0.
        #[default]
        #[serde(rename = "5.0")]
        #[strum(serialize = "5.0")]
        V5_0,
        /// Blender 5.1: Blackbody differs from 5.0 (2.4e-4), RGB to BW and Vector Transform in last digits, Vector Math has Round.
        #[serde(rename = "5.1")]
        #[strum(serialize = "5.1")]
        V5_1,
        /// Blender 5.2 LTS: as 5.1, and Magic Texture scales before it repeats.
        #[serde(rename = "5.2")]
        #[strum(serialize = "5.2")]
        V5_2,
        /// Blender 5.3: as 5.2, but Blackbody is that of 5.0, and Mix Color differs in last digits.
        #[serde(rename = "5.3")]
        #[strum(serialize = "5.3")]
        V5_3,
    }
}

impl Release {
    /// Whether it is the release that is meant where none is named: what every older scene file was written for.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// A node group: an interface and a tree.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Group {
    /// Name of the group.
    pub name: String,
    /// Interface inputs in order.
    pub inputs: Vec<Socket>,
    /// Interface outputs in order.
    pub outputs: Vec<Socket>,
    /// Nodes; the one of type `NodeGroupOutput` feeds the outputs.
    pub nodes: Vec<Node>,
}

/// A socket of a group's interface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Socket {
    /// Unique within the group.
    pub identifier: String,
    /// Label; may repeat.
    pub name: String,
    /// Panel that the socket is shown in.
    #[serde(default)]
    pub panel: Option<String>,
    /// Kind of value.
    #[serde(rename = "type")]
    pub kind: SocketType,
    /// Blender's unit or range hint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub subtype: Option<String>,
    /// Value where the group node stores none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub default: Option<serde_json::Value>,
    /// Lower limit of a stored value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<f32>,
    /// Upper limit of a stored value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<f32>,
    /// Tooltip.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub description: Option<String>,
}

choice! {
    "lowercase",
    /// Kind of value that a socket carries.
    #[derive(Hash, JsonSchema)]
    pub enum SocketType {
        /// One number.
        Float,
        /// A number that Blender keeps whole; evaluates as a float.
        Integer,
        /// 0 or 1; evaluates as a float.
        Boolean,
        /// Three numbers.
        Vector,
        /// Linear Rec. 709; alpha is dropped.
        Color,
        /// A closure.
        Shader,
    }
}

impl SocketType {
    /// Number of scalar components in evaluation.
    pub fn components(self) -> usize {
        match self {
            Self::Float | Self::Integer | Self::Boolean => 1,
            Self::Vector | Self::Color => 3,
            Self::Shader => 0,
        }
    }
}

/// One node.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Node {
    /// Unique within its tree.
    pub name: String,
    /// Blender's type, such as `ShaderNodeMath`.
    #[serde(rename = "type")]
    pub kind: String,
    /// User's label.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
    /// Place in the editor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub location: Option<[f32; 2]>,
    /// A muted node passes inputs on as `bypass` says.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub muted: bool,
    /// Output identifier to input identifier, muted nodes only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bypass: Option<indexmap::IndexMap<String, String>>,
    /// Group name, `ShaderNodeGroup` only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
    /// Type of a `NodeReroute`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub socket_type: Option<SocketType>,
    /// Modes and flags by Blender's property identifier.
    #[serde(default)]
    pub properties: serde_json::Map<String, serde_json::Value>,
    /// Values that the node stores in its outputs (Value), by socket identifier.
    #[serde(default, skip_serializing_if = "indexmap::IndexMap::is_empty")]
    pub outputs: indexmap::IndexMap<String, Input>,
    /// Inputs by socket identifier.
    #[serde(default)]
    pub inputs: indexmap::IndexMap<String, Input>,
    /// Blender's own values of a texture whose inputs are all constant, one entry for each set of inputs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub folded: Vec<Folded>,
}

/// A node's values for constant inputs, as Blender folds them. They count for these inputs in this mode and for no others.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Folded {
    /// Words of the mode: choices, flags that are on, numbers.
    pub mode: Vec<String>,
    /// Components of all inputs of the mode, in the order of the sockets.
    pub inputs: Vec<f32>,
    /// Components of all outputs of the mode, in the order of the sockets.
    pub outputs: Vec<f32>,
}

impl Folded {
    /// Whether these are the inputs, to the bit, and the mode that the values were asked for.
    pub fn is_for(&self, mode: &[String], inputs: &[f32]) -> bool {
        self.mode == mode
            && self.inputs.iter().map(|value| value.to_bits()).eq(inputs.iter().map(|value| value.to_bits()))
    }
}

/// What feeds an input.
#[derive(Debug, Clone, PartialEq)]
pub enum Input {
    /// A stored number.
    Number(f32),
    /// A stored vector (3) or colour (4).
    List(Vec<f32>),
    /// A stored text.
    Text(String),
    /// An output of another node of the same tree.
    Link {
        /// Name of that node.
        node: String,
        /// Identifier of its output.
        socket: String,
    },
    /// An input of the group that this node is in.
    GroupInput(String),
}

/// The JSON shape of [`Input`].
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
#[allow(dead_code, reason = "only its schema is used")]
enum InputSchema {
    Number(f32),
    List(Vec<f32>),
    Text(String),
    Link { node: String, socket: String },
    GroupInput { group_input: String },
}

impl JsonSchema for Input {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Input".into()
    }
    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        InputSchema::json_schema(generator)
    }
}

impl Serialize for Input {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.clone() {
            Self::Number(value) => InputSchema::Number(value),
            Self::List(values) => InputSchema::List(values),
            Self::Text(text) => InputSchema::Text(text),
            Self::Link { node, socket } => InputSchema::Link { node, socket },
            Self::GroupInput(group_input) => InputSchema::GroupInput { group_input },
        }
        .serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Input {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        use serde::de::Error as _;
        let value = serde_json::Value::deserialize(deserializer)?;
        let wrong = || {
            D::Error::custom(format!(
                "{value}, which is none of: a number, a list of numbers, {{\"node\", \"socket\"}}, {{\"group_input\"}}"
            ))
        };
        Ok(match &value {
            serde_json::Value::Number(number) => Self::Number(number.as_f64().ok_or_else(wrong)? as f32),
            serde_json::Value::Bool(flag) => Self::Number(f32::from(u8::from(*flag))),
            serde_json::Value::String(text) => Self::Text(text.clone()),
            serde_json::Value::Array(items) => Self::List(
                items.iter().map(|item| item.as_f64().map(|x| x as f32)).collect::<Option<_>>().ok_or_else(wrong)?,
            ),
            serde_json::Value::Object(fields) => {
                let text = |key: &str| fields.get(key).and_then(|x| x.as_str()).map(str::to_owned);
                match (fields.len(), text("node"), text("socket"), text("group_input")) {
                    (2, Some(node), Some(socket), None) => Self::Link { node, socket },
                    (1, None, None, Some(identifier)) => Self::GroupInput(identifier),
                    _ => return Err(wrong()),
                }
            }
            serde_json::Value::Null => return Err(wrong()),
        })
    }
}

/// Groups may be nested this deep.
pub(crate) const DEEPEST_NESTING: usize = 32;

/// A graph may hold this many nodes once every group is put in the place of its nodes. A file of a
/// few lines can ask for billions: groups that each use the next one twice.
const MOST_INLINED: u64 = 1_000_000;

impl Graph {
    /// The group of that name.
    pub fn group(&self, name: &str) -> Option<&Group> {
        self.groups.iter().find(|group| group.name == name)
    }

    /// Checks what the types do not say: names are unique, interface defaults have the type of their
    /// socket, and the groups do not hold themselves. `own_place` names the graph, `place` the file.
    pub(super) fn check(&self, own_place: &str, place: &str) -> Checked<()> {
        unique(self.groups.iter().map(|group| &group.name), "group", &format!("{own_place}.groups"))?;
        unique(self.nodes.iter().map(|node| &node.name), "node", &format!("{own_place}.nodes"))?;
        for group in &self.groups {
            let place = format!("{place}: group {}", group.name);
            unique(group.nodes.iter().map(|node| &node.name), "node", &place)?;
            unique(group.inputs.iter().map(|socket| &socket.identifier), "input", &place)?;
            unique(group.outputs.iter().map(|socket| &socket.identifier), "output", &place)?;
            for socket in group.inputs.iter().chain(&group.outputs) {
                socket.check_default(&place)?;
            }
        }
        let inlined = self.inlined(&self.nodes, &mut HashMap::new(), &mut Vec::new(), place)?;
        if inlined > MOST_INLINED {
            return Err(Error::new(
                own_place,
                format!("{inlined} nodes once all groups are put in place"),
                format!("at most {MOST_INLINED}"),
                "Use fewer groups within groups.",
            ));
        }
        Ok(())
    }

    /// Number of nodes with all groups in place; refuses rings of groups.
    fn inlined<'a>(
        &'a self,
        nodes: &'a [Node],
        known: &mut HashMap<&'a str, u64>,
        open: &mut Vec<&'a str>,
        place: &str,
    ) -> Checked<u64> {
        let mut count = 0_u64;
        for node in nodes {
            // A group that the file lacks only matters where it is reached; it is refused there.
            let Some(group) = node.group.as_deref().and_then(|name| self.group(name)) else {
                count = count.saturating_add(1);
                continue;
            };
            let name = group.name.as_str();
            if open.contains(&name) || open.len() >= DEEPEST_NESTING {
                let path = open.iter().map(|name| format!("{name} -> ")).collect::<String>();
                return Err(Error::new(
                    format!("{place}: group {}: node {}", open.last().unwrap_or(&""), node.name),
                    format!("groups within groups: {path}{name}"),
                    format!("groups that do not hold themselves, at most {DEEPEST_NESTING} deep"),
                    "Break the ring of groups.",
                ));
            }
            let inner = match known.get(name) {
                Some(&inner) => inner,
                None => {
                    open.push(name);
                    let inner = self.inlined(&group.nodes, known, open, place)?;
                    open.pop();
                    known.insert(name, inner);
                    inner
                }
            };
            count = count.saturating_add(inner).saturating_add(1);
        }
        Ok(count)
    }
}

impl Socket {
    /// The value where a group node stores none, by component; none where the interface has none or
    /// where it has another type than the socket.
    pub(crate) fn default_components(&self) -> Option<Vec<f32>> {
        use serde_json::Value as Json;
        let number = |value: &Json| value.as_f64().map(|value| value as f32);
        match (self.default.as_ref()?, self.kind.components()) {
            (Json::Bool(flag), 1) => Some(vec![f32::from(u8::from(*flag))]),
            (value, 1) => Some(vec![number(value)?]),
            (Json::Array(items), 3) if (3..=4).contains(&items.len()) => items[..3].iter().map(number).collect(),
            _ => None,
        }
    }

    fn check_default(&self, place: &str) -> Checked<()> {
        match &self.default {
            Some(value) if self.kind != SocketType::Shader && self.default_components().is_none() => Err(Error::new(
                format!("{place}: socket {}: default", self.identifier),
                value.to_string(),
                if self.kind.components() == 1 { "a number" } else { "a list of three or four numbers" },
                "Correct the default's type.",
            )),
            _ => Ok(()),
        }
    }
}

/// Refuses a name that stands twice.
fn unique<'a>(names: impl Iterator<Item = &'a String>, what: &str, place: &str) -> Checked<()> {
    let mut seen = HashSet::new();
    for name in names {
        if !seen.insert(name) {
            return Err(Error::new(
                place.to_owned(),
                format!("two {what}s called \"{name}\""),
                format!("a name of its own for every {what}"),
                "Rename one of them; links find their node by its name.",
            ));
        }
    }
    Ok(())
}
