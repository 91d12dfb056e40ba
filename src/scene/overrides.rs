//! Changing stored values by name: `--set "Large Noise/Scale=2"`.

use super::{Graph, Input, Scene};
use crate::error::{Error, Result};

impl Scene {
    /// Applies `NAME=VALUE`. NAME is, of the group nodes in the material's own tree, an input by
    /// `Panel/Label`, `Label` or identifier; or `Node.identifier` of any node there. VALUE is a
    /// number or, for vectors and colours, numbers joined by commas. A name that fits several
    /// inputs is an error that lists them.
    pub fn set(&mut self, assignment: &str) -> Result<()> {
        let place = format!("--set {assignment}");
        let wrong = |found: String, expected: &str, remedy: &str| Error::new(place.clone(), found, expected, remedy);
        let Some((name, text)) = assignment.split_once('=') else {
            return Err(wrong("no \"=\"".into(), "NAME=VALUE", "Write for example --set \"Altitude=0.8\"."));
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
                    "Write the panel and a slash before the label, or the identifier.",
                ));
            }
        };
        if let (Some(minimum), Some(maximum)) = (found.minimum, found.maximum) {
            if let Some(value) = numbers.iter().find(|value| **value < minimum || **value > maximum) {
                return Err(wrong(
                    value.to_string(),
                    &format!("{minimum} to {maximum}, the limits of {}", found.full_name()),
                    "Choose a value within the limits: Blender would not store this one.",
                ));
            }
        }
        let node = &mut self.graph_mut().nodes[found.node];
        let input = node.inputs.get(&found.identifier);
        let value = match (input, numbers.as_slice()) {
            (None | Some(Input::Number(_)), [value]) => Input::Number(*value),
            (Some(Input::List(old)), _) if numbers.len() == 3 || numbers.len() == old.len() => {
                let mut values = numbers.clone();
                values.extend(old.iter().skip(values.len()));
                Input::List(values)
            }
            (Some(Input::Link { node, socket }), _) => {
                return Err(wrong(
                    format!("a link from {node}.{socket}"),
                    "an unlinked input",
                    "Set an input of the node that feeds it.",
                ));
            }
            _ => {
                return Err(wrong(
                    format!("{} numbers", numbers.len()),
                    "as many numbers as the input has",
                    "Correct the value.",
                ));
            }
        };
        node.inputs.insert(found.identifier, value);
        Ok(())
    }
}

/// An input that a name may mean.
#[derive(Debug, Clone)]
struct Candidate {
    node: usize,
    node_name: String,
    identifier: String,
    label: String,
    panel: Option<String>,
    minimum: Option<f32>,
    maximum: Option<f32>,
}

impl Candidate {
    fn full_name(&self) -> String {
        match &self.panel {
            Some(panel) => format!("{panel}/{} ({})", self.label, self.identifier),
            None => format!("{} ({})", self.label, self.identifier),
        }
    }
}

fn everything(graph: &Graph) -> Vec<Candidate> {
    let mut all = Vec::new();
    for (number, node) in graph.nodes.iter().enumerate() {
        if let Some(group) = node.group.as_ref().and_then(|name| graph.group(name)) {
            all.extend(group.inputs.iter().map(|socket| Candidate {
                node: number,
                node_name: node.name.clone(),
                identifier: socket.identifier.clone(),
                label: socket.name.clone(),
                panel: socket.panel.clone(),
                minimum: socket.min,
                maximum: socket.max,
            }));
        } else {
            all.extend(node.inputs.keys().map(|identifier| Candidate {
                node: number,
                node_name: node.name.clone(),
                identifier: identifier.clone(),
                label: format!("{}.{identifier}", node.name),
                panel: None,
                minimum: None,
                maximum: None,
            }));
        }
    }
    all
}

fn candidates(graph: &Graph, name: &str) -> Vec<Candidate> {
    let fits = |candidate: &Candidate| {
        let qualified = candidate.panel.as_ref().map(|panel| format!("{panel}/{}", candidate.label));
        let names = [
            Some(candidate.label.clone()),
            qualified,
            Some(candidate.identifier.clone()).filter(|_| !candidate.label.contains('.')),
            Some(format!("{}.{}", candidate.node_name, candidate.identifier)),
        ];
        names.into_iter().flatten().any(|known| known == name)
    };
    everything(graph).into_iter().filter(fits).collect()
}

fn all_names(graph: &Graph) -> Vec<String> {
    everything(graph).iter().map(Candidate::full_name).collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_name_without_its_panel_is_ambiguous_when_panels_repeat_it() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/scenes/procedural-clouds.scene.json");
        let mut scene = crate::scene::Scene::load(&path).expect("the committed scene loads");
        assert!(scene.set("Scale=2").unwrap_err().found.contains("3 inputs"));
        assert!(scene.set("Nothing=2").unwrap_err().expected.contains("Large Noise/Scale"));
        assert!(scene.set("Altitude=nan").is_err());
        assert!(scene.set("Altitude=-1").unwrap_err().expected.contains("0 to 10000"));
        scene.set("Large Noise/Scale=2").expect("a qualified name works");
        scene.set("Socket_2=0.25").expect("an identifier works");
    }
}
