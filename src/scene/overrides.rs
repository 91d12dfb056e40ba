//! Changing stored values by name: `Large Noise/Scale=2`.

use crate::base::error::{Error, Result};
use crate::scene::{Graph, Input, Scene, SocketType};
use serde::Serialize;

impl Scene {
    /// Applies `NAME=VALUE`. NAME is, of the group nodes in the material's own tree, an input by
    /// `Panel/Label`, `Label` or identifier; or `Node.identifier` of any node there: an input, or
    /// the output in which a Value node keeps its number. VALUE is a number or, for vectors and
    /// colours, three or four numbers joined by commas. A name that fits several inputs is an error
    /// that lists them.
    pub fn set(&mut self, assignment: &str) -> Result<()> {
        let place = format!("value {assignment}");
        let wrong = |found: String, expected: &str, remedy: &str| {
            Error::new(place.clone(), found, expected, remedy).with_setting("set")
        };
        let Some((name, text)) = assignment.split_once('=') else {
            return Err(wrong("no \"=\"".into(), "NAME=VALUE", "Write for example Altitude=0.8."));
        };
        let numbers: Vec<f32> = text
            .split(',')
            .map(|part| part.trim().parse::<f32>().ok().filter(|value| value.is_finite()))
            .collect::<Option<_>>()
            .ok_or_else(|| {
                wrong(
                    format!("the value \"{text}\""),
                    "a finite number in the f32 range, or three joined by commas",
                    "Correct the value.",
                )
            })?;
        let finds = candidates(self.graph(), name.trim());
        let found = match finds.as_slice() {
            [one] => one.clone(),
            [] => {
                return Err(wrong(
                    format!("no input called \"{}\"", name.trim()),
                    &format!("one of: {}", all_names(self.graph()).join("; ")),
                    "Correct the name.",
                ));
            }
            several => {
                let names: Vec<_> = several.iter().map(|find| find.full_name()).collect();
                return Err(wrong(
                    format!("{} inputs of that name", several.len()),
                    &format!("one of: {}", names.join("; ")),
                    "Write the panel and a slash before the label, or the name in brackets.",
                ));
            }
        };
        let (low, high) = (found.minimum.unwrap_or(f32::MIN), found.maximum.unwrap_or(f32::MAX));
        if let Some(value) = numbers.iter().find(|value| **value < low || **value > high) {
            return Err(wrong(
                value.to_string(),
                &format!("{low} to {high}, the limits of {}", found.full_name()),
                "Choose a value within the limits: Blender would not store this one.",
            ));
        }
        let node = &mut self.graph_mut().nodes[found.node];
        let values = if found.is_output { &mut node.outputs } else { &mut node.inputs };
        let stored = values.get(&found.identifier);
        if let Some(Input::Link { node, socket }) = stored {
            return Err(wrong(
                format!("a link from {node}.{socket}"),
                "an unlinked input",
                "Set an input of the node that feeds it.",
            ));
        }
        let kind = found.kind.or(match stored {
            Some(Input::Number(_)) => Some(SocketType::Float),
            Some(Input::List(old)) => Some(if old.len() == 4 { SocketType::Color } else { SocketType::Vector }),
            _ => None,
        });
        let value = match (kind, numbers.as_slice()) {
            (Some(SocketType::Integer), [value]) if value.fract() != 0.0 => {
                return Err(wrong(value.to_string(), "a whole number", "Round the value."));
            }
            (Some(SocketType::Boolean), [value]) if *value != 0.0 && *value != 1.0 => {
                return Err(wrong(value.to_string(), "0 (off) or 1 (on)", "Choose one of them."));
            }
            (Some(kind), [value]) if kind.components() == 1 => Input::Number(*value),
            (Some(SocketType::Vector), [_, _, _]) | (Some(SocketType::Color), [_, _, _, _]) => Input::List(numbers),
            (Some(SocketType::Color), [red, green, blue]) => {
                // Alpha has no effect in Cycles; the stored one stays.
                let alpha = match stored {
                    Some(Input::List(old)) => old.get(3).copied().unwrap_or(1.0),
                    _ => 1.0,
                };
                Input::List(vec![*red, *green, *blue, alpha])
            }
            (Some(kind), _) => {
                return Err(wrong(
                    format!("{} numbers", numbers.len()),
                    &format!("{} for {}", if kind.components() == 1 { "one" } else { "three" }, found.full_name()),
                    "Give as many numbers as the input has.",
                ));
            }
            (None, _) => {
                return Err(wrong(
                    "a socket that holds no numbers".into(),
                    "a number, vector or colour",
                    "Choose another input.",
                ));
            }
        };
        values.insert(found.identifier, value);
        Ok(())
    }
}

impl Scene {
    /// The number that is stored under an exact name of [`Self::settable_numbers`]; a group's input that its node does not store has that
    /// of the group's interface. None where there is no number.
    pub fn stored_number(&self, exact_name: &str) -> Option<f32> {
        let graph = self.graph();
        let found = everything(graph).into_iter().find(|candidate| candidate.exact_name() == exact_name)?;
        let node = &graph.nodes[found.node];
        match if found.is_output { &node.outputs } else { &node.inputs }.get(&found.identifier) {
            Some(Input::Number(value)) => Some(*value),
            Some(_) => None,
            None => {
                let group = graph.group(node.group.as_ref()?)?;
                let socket = group.inputs.iter().find(|socket| socket.identifier == found.identifier)?;
                socket.default.as_ref()?.as_f64().map(|value| value as f32)
            }
        }
    }

    /// Everything that [`Self::set`] may change, in the order of the graph.
    pub fn settable(&self) -> Vec<Settable> {
        let graph = self.graph();
        let all = everything(graph);
        let mut found = Vec::new();
        for candidate in &all {
            let node = &graph.nodes[candidate.node];
            let stored = if candidate.is_output { &node.outputs } else { &node.inputs }.get(&candidate.identifier);
            let value = match stored {
                Some(Input::Number(value)) => shortest(*value),
                Some(Input::List(values)) => values.iter().copied().map(shortest).collect(),
                Some(_) => continue,
                None if candidate.kind.is_some() => candidate.default.clone().unwrap_or_default(),
                None => continue,
            };
            // The shortest name that means it alone.
            let short = [candidate.label.clone(), candidate.qualified_label()];
            let is_its_own = |name: &String| all.iter().filter(|other| other.is_called(name)).count() == 1;
            let name = short.into_iter().flatten().find(is_its_own).unwrap_or_else(|| candidate.exact_name());
            found.push(Settable {
                name,
                exact_name: candidate.exact_name(),
                value,
                limits: [candidate.minimum, candidate.maximum],
                unit: candidate.unit.clone(),
                about: candidate.about.clone(),
            });
        }
        found
    }

    /// Every number that [`Self::set`] may change: its exact name, and its label (its identifier where it has none).
    pub fn settable_numbers(&self) -> Vec<(String, String)> {
        let graph = self.graph();
        everything(graph)
            .into_iter()
            .filter(|candidate| {
                let node = &graph.nodes[candidate.node];
                let stored = if candidate.is_output { &node.outputs } else { &node.inputs }.get(&candidate.identifier);
                match stored {
                    Some(Input::Number(_)) => true,
                    // A group's input whose value is the interface's own.
                    None => candidate.kind == Some(SocketType::Float),
                    Some(_) => false,
                }
            })
            .map(|candidate| {
                let label = candidate.label.clone().unwrap_or_else(|| candidate.identifier.clone());
                (candidate.exact_name(), label)
            })
            .collect()
    }
}

/// A number of JSON with the digits that tell it from other f32.
fn shortest(value: f32) -> serde_json::Value {
    value.to_string().parse::<f64>().map_or(serde_json::Value::Null, Into::into)
}

/// Something that [`Scene::set`] may change.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Settable {
    /// The shortest name that means it alone: `Panel/Label`, `Label` or `Node.identifier`.
    pub name: String,
    /// `Node.identifier`.
    pub exact_name: String,
    /// What is stored: a number, or a vector or colour as a list. Null where the interface of a group names no default.
    pub value: serde_json::Value,
    /// Smallest and largest value that Blender stores there; none where there is no limit but that of f32.
    pub limits: [Option<f32>; 2],
    /// Blender's hint at the unit, such as FACTOR or DISTANCE.
    pub unit: Option<String>,
    /// The tooltip.
    pub about: Option<String>,
}

/// An input that a name may mean.
#[derive(Debug, Clone)]
struct Candidate {
    node: usize,
    node_name: String,
    identifier: String,
    /// Of a group's interface; the sockets of other nodes are named by their node and identifier.
    label: Option<String>,
    panel: Option<String>,
    /// Known from a group's interface, else told by the value that is stored.
    kind: Option<SocketType>,
    minimum: Option<f32>,
    maximum: Option<f32>,
    /// Of a group's interface.
    default: Option<serde_json::Value>,
    unit: Option<String>,
    about: Option<String>,
    /// A value that the node keeps in an output.
    is_output: bool,
}

impl Candidate {
    /// `Node.identifier`.
    fn exact_name(&self) -> String {
        format!("{}.{}", self.node_name, self.identifier)
    }

    /// `Panel/Label`.
    fn qualified_label(&self) -> Option<String> {
        Some(format!("{}/{}", self.panel.as_ref()?, self.label.as_ref()?))
    }

    fn full_name(&self) -> String {
        match self.qualified_label().or_else(|| self.label.clone()) {
            Some(label) => format!("{label} ({})", self.exact_name()),
            None => self.exact_name(),
        }
    }

    fn is_called(&self, name: &str) -> bool {
        self.label.as_deref() == Some(name)
            || self.qualified_label().as_deref() == Some(name)
            || (self.label.is_some() && self.identifier == name)
            || self.exact_name() == name
    }
}

fn everything(graph: &Graph) -> Vec<Candidate> {
    let mut all = Vec::new();
    for (number, node) in graph.nodes.iter().enumerate() {
        let plain = |identifier: &String, is_output: bool| Candidate {
            node: number,
            node_name: node.name.clone(),
            identifier: identifier.clone(),
            label: None,
            panel: None,
            kind: None,
            minimum: None,
            maximum: None,
            default: None,
            unit: None,
            about: None,
            is_output,
        };
        if let Some(group) = node.group.as_ref().and_then(|name| graph.group(name)) {
            all.extend(group.inputs.iter().map(|socket| Candidate {
                label: Some(socket.name.clone()),
                panel: socket.panel.clone(),
                kind: Some(socket.kind).filter(|kind| *kind != SocketType::Shader),
                minimum: socket.min,
                maximum: socket.max,
                default: socket.default.clone(),
                unit: socket.subtype.clone().filter(|unit| unit != "NONE"),
                about: socket.description.clone().filter(|text| !text.is_empty()),
                ..plain(&socket.identifier, false)
            }));
        } else {
            all.extend(node.inputs.keys().map(|identifier| plain(identifier, false)));
            all.extend(node.outputs.keys().map(|identifier| plain(identifier, true)));
        }
    }
    all
}

fn candidates(graph: &Graph, name: &str) -> Vec<Candidate> {
    everything(graph).into_iter().filter(|candidate| candidate.is_called(name)).collect()
}

fn all_names(graph: &Graph) -> Vec<String> {
    everything(graph).iter().map(Candidate::full_name).collect()
}

#[cfg(test)]
mod tests {
    use crate::scene::{Input, Scene};
    use serde_json::json;

    fn cloud() -> Scene {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/scenes/procedural-clouds.scene.json");
        Scene::load(&path).expect("the committed scene loads")
    }

    /// The cloud's scene with two nodes of one group, a Value node and a linked Math node.
    fn sockets_of_every_type() -> Scene {
        let mut document = serde_json::to_value(cloud()).expect("a scene serialises");
        let input = |identifier: &str, kind: &str, default: serde_json::Value| {
            json!({"identifier": identifier, "name": identifier.to_uppercase(), "panel": null, "type": kind,
                   "default": default})
        };
        document["graph"] = json!({
            "material": "Material",
            "nodes": [
                {"name": "One", "type": "ShaderNodeGroup", "group": "G", "inputs": {"tint": [0.1, 0.2, 0.3, 0.4]}},
                {"name": "Two", "type": "ShaderNodeGroup", "group": "G", "inputs": {"low": 3.0}},
                {"name": "Number", "type": "ShaderNodeValue", "outputs": {"Value": 1.0}},
                {"name": "Math", "type": "ShaderNodeMath",
                 "inputs": {"Value": {"node": "Number", "socket": "Value"}, "Value_001": 0.5}},
                {"name": "Shift", "type": "ShaderNodeVectorMath", "inputs": {"Vector": [1.0, 2.0, 3.0]}},
            ],
            "groups": [{"name": "G", "outputs": [], "nodes": [], "inputs": [
                input("tint", "color", json!([1.0, 1.0, 1.0, 1.0])),
                input("place", "vector", json!([0.0, 0.0, 0.0])),
                input("count", "integer", json!(1)),
                input("on", "boolean", json!(true)),
                {"identifier": "low", "name": "LOW", "type": "float", "default": 0.0, "min": -1.0},
            ]}],
        });
        Scene::from_value(document, "test").expect("a legal scene")
    }

    fn stored(scene: &Scene, node: usize, identifier: &str) -> Option<Input> {
        scene.graph().nodes[node].inputs.get(identifier).cloned()
    }

    #[test]
    fn a_name_without_its_panel_is_ambiguous_when_panels_repeat_it() {
        let mut scene = cloud();
        assert!(scene.set("Scale=2").unwrap_err().found.contains("3 inputs"));
        assert!(scene.set("Nothing=2").unwrap_err().expected.contains("Large Noise/Scale"));
        assert!(scene.set("Altitude=nan").is_err());
        assert!(scene.set("Altitude=-1").unwrap_err().expected.contains("0 to 10000"));
        scene.set("Large Noise/Scale=2").expect("a qualified name works");
        scene.set("Socket_2=0.25").expect("an identifier works");
        assert_eq!(stored(&scene, 2, "Socket_5"), Some(Input::Number(2.0)));
        assert_eq!(stored(&scene, 2, "Socket_2"), Some(Input::Number(0.25)));
    }

    #[test]
    fn an_input_of_two_group_nodes_needs_the_name_of_its_node() {
        let mut scene = sockets_of_every_type();
        let error = scene.set("PLACE=1,2,3").unwrap_err();
        assert!(error.expected.contains("One.place") && error.expected.contains("Two.place"), "{error}");
        scene.set("Two.place = 1, 2,3").expect("a vector");
        assert_eq!(stored(&scene, 1, "place"), Some(Input::List(vec![1.0, 2.0, 3.0])));
        assert_eq!(stored(&scene, 0, "place"), None);
    }

    #[test]
    fn values_have_the_length_and_type_of_their_socket() {
        let mut scene = sockets_of_every_type();
        scene.set("One.tint=0.5,0.6,0.7").expect("a colour");
        assert_eq!(stored(&scene, 0, "tint"), Some(Input::List(vec![0.5, 0.6, 0.7, 0.4])));
        scene.set("Two.tint=0.5,0.6,0.7").expect("a colour that the node does not store yet");
        assert_eq!(stored(&scene, 1, "tint"), Some(Input::List(vec![0.5, 0.6, 0.7, 1.0])));
        scene.set("Shift.Vector=3,2,1").expect("the vector of a node");
        for (assignment, expected) in [
            ("One.place=1", "three"),
            ("One.place=1,2", "three"),
            ("One.place=1,2,3,4", "three"),
            ("One.low=1,2,3", "one"),
            ("One.count=1.5", "a whole number"),
            ("One.on=2", "0 (off) or 1 (on)"),
            ("One.low=-1.5", "-1 to"),
            ("Shift.Vector=1", "three"),
            ("Math.Value=1", "an unlinked input"),
            ("Math.Value_001=1e39", "finite"),
            ("Math.Value_001=", "finite"),
            ("Math.Value_001", "NAME=VALUE"),
        ] {
            let error = scene.set(assignment).expect_err(assignment);
            assert!(error.expected.contains(expected), "{assignment}: {error}");
        }
    }

    #[test]
    fn numbers_that_can_be_set_are_listed_with_their_labels() {
        let found = cloud().settable_numbers();
        assert_eq!(found.iter().filter(|(_, label)| label == "Scale").count(), 3);
        assert!(found.contains(&("Principled Volume.Anisotropy".into(), "Anisotropy".into())), "{found:?}");
        // A link is no number.
        assert!(!found.iter().any(|(name, _)| name == "Principled Volume.Density"));
        for (name, _) in found {
            cloud().set(&format!("{name}=0.5")).expect("a listed number can be set");
        }
    }

    #[test]
    fn everything_that_can_be_set_is_listed_under_a_name_that_sets_it() {
        let found = cloud().settable();
        let scale = found.iter().find(|one| one.name == "Large Noise/Scale").expect("a name with its panel");
        assert_eq!(scale.value, json!(cloud().stored_number(&scale.exact_name).expect("a number")));
        assert!(found.iter().any(|one| one.name == "Altitude" && one.limits == [Some(0.0), Some(10000.0)]));
        for scene in [cloud(), sockets_of_every_type()] {
            for one in scene.settable() {
                let numbers: Vec<String> = match &one.value {
                    serde_json::Value::Array(values) => values.iter().map(ToString::to_string).collect(),
                    serde_json::Value::Bool(is_on) => vec![i32::from(*is_on).to_string()],
                    value => vec![value.to_string()],
                };
                let mut again = scene.clone();
                again.set(&format!("{}={}", one.name, numbers.join(","))).unwrap_or_else(|error| panic!("{error}"));
            }
        }
    }

    #[test]
    fn the_number_of_a_value_node_can_be_set() {
        let mut scene = sockets_of_every_type();
        scene.set("Number.Value=7").expect("a number kept in an output");
        assert_eq!(scene.graph().nodes[2].outputs["Value"], Input::Number(7.0));
    }
}
