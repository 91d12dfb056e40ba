//! Random values for the inputs of a material's group nodes.
//!
//! Ranges come from the interface: labels that procedural clouds use have the ranges that their
//! authors recommend; other inputs have those of their limits, cut to what a picture needs.

use crate::base::error::{Error, Result};
use crate::scene::{Input, Scene, Socket, SocketType};
use indexmap::IndexMap;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// How a value is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Range {
    /// Uniform.
    Uniform(f32, f32),
    /// Uniform in the logarithm.
    Logarithmic(f32, f32),
}

impl Range {
    fn draw(self, random: &mut ChaCha8Rng) -> f32 {
        match self {
            Self::Uniform(low, high) => low + (high - low) * random.random::<f32>(),
            Self::Logarithmic(low, high) => {
                let exponent = f64::from(low).ln() + (f64::from(high) / f64::from(low)).ln() * random.random::<f64>();
                (exponent.exp() as f32).clamp(low, high)
            }
        }
    }
}

/// The range of an input of a group, by its label, else by its limits.
pub fn range(socket: &Socket) -> Range {
    let low = socket.min.unwrap_or(f32::MIN);
    let high = socket.max.unwrap_or(f32::MAX);
    let wished = match socket.name.as_str() {
        "Altitude" => Range::Logarithmic(0.05, 5.0),
        "Scale" => Range::Logarithmic(0.05, 20.0),
        "Density" => Range::Logarithmic(0.01, 100.0),
        "Time" => Range::Uniform(-50.0, 50.0),
        _ if socket.subtype.as_deref() == Some("FACTOR") || (low >= 0.0 && high <= 1.0) => Range::Uniform(low, high),
        _ if low >= 0.0 => Range::Logarithmic(0.05, 20.0),
        _ => Range::Uniform(-50.0, 50.0),
    };
    match wished {
        Range::Uniform(a, b) => Range::Uniform(a.max(low), b.min(high)),
        Range::Logarithmic(a, b) => Range::Logarithmic(a.max(low), b.min(high).max(a.max(low))),
    }
}

/// Draws a value for every unlinked number input of the group nodes in the material's own tree, and
/// stores it. Returns the values by `Panel/Label`, or an error where there is nothing to draw.
pub fn draw(scene: &mut Scene, random: &mut ChaCha8Rng) -> Result<IndexMap<String, f32>> {
    let mut drawn = IndexMap::new();
    let groups = scene.graph().groups.clone();
    for node in &mut scene.graph_mut().nodes {
        let Some(group) = groups.iter().find(|group| Some(&group.name) == node.group.as_ref()) else { continue };
        for socket in &group.inputs {
            let linked = matches!(node.inputs.get(&socket.identifier), Some(Input::Link { .. }));
            if linked || !matches!(socket.kind, SocketType::Float | SocketType::Integer) {
                continue;
            }
            let value = range(socket).draw(random);
            let value = if socket.kind == SocketType::Integer { value.round() } else { value };
            node.inputs.insert(socket.identifier.clone(), Input::Number(value));
            let panel = socket.panel.as_ref().map(|panel| format!("{panel}/")).unwrap_or_default();
            drawn.insert(format!("{panel}{}", socket.name), value);
        }
    }
    if drawn.is_empty() {
        return Err(Error::new(
            format!("material {}", scene.graph().material),
            "no group node with an unlinked number input",
            "inputs to draw random values for",
            "Probe the scene without random settings.",
        )
        .with_setting("random_settings"));
    }
    Ok(drawn)
}
