//! The node graph as it stands in a scene file: Blender's nodes, groups and links by name.

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

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

/// Kind of value that a socket carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
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

impl Graph {
    /// The group of that name.
    pub fn group(&self, name: &str) -> Option<&Group> {
        self.groups.iter().find(|group| group.name == name)
    }
}
