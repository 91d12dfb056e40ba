//! The medium as `march` and the adapter know it: one varying density, constant factors, one lobe, in one object.
//!
//! [`super::objects`] knows media in full.

use crate::base::error::{Error, Result};
use crate::graph::Program;
use crate::graph::closures::{Closure, Value};
use crate::media::density::Density;
use crate::media::mesh::PlacedMesh;
use crate::media::objects::ObjectMedium;
use crate::media::phase::PhaseFunction;
use crate::nodes::closure::Coefficients;
use crate::scene::Scene;
use glam::DMat4;
use std::sync::Arc;

/// Sockets that emission is linear in.
const STRENGTHS: [&str; 2] = ["Emission Strength", "Strength"];

/// A sum of closures in a box or a mesh that share one varying density and are constant else.
///
/// Coefficients are per metre of world space whatever the object's scale: a ray carries its world
/// length along when it is taken into the object's frame.
pub struct Medium {
    /// Density at object-space positions.
    pub density: Density,
    /// Extinction per unit density, per channel.
    pub extinction: [f64; 3],
    /// Scattering per unit density, per channel.
    pub scattering: [f64; 3],
    /// Henyey-Greenstein g, clamped as Cycles does.
    pub anisotropy: f64,
    /// Radiance per metre, independent of the density.
    pub emission: [f64; 3],
    /// Radiance per metre and unit density: of closures whose emission strength is the density.
    pub emission_of_density: [f64; 3],
    /// World to object.
    pub to_object: DMat4,
    /// The mesh that it fills, if it does not fill the box of the density.
    pub mesh: Option<Arc<PlacedMesh>>,
}

impl Medium {
    /// Reads the medium of a scene; what `march` cannot do is an error that says so.
    pub fn new(scene: &Scene) -> Result<Self> {
        if let Some(second) = scene.other_volumes.first() {
            return Err(Error::new(
                format!("object {}", second.object),
                "a second volume object",
                "one: ray marching knows a single medium",
                "Leave the other objects out, or trace paths.",
            )
            .with_setting("integrator"));
        }
        Self::of(&ObjectMedium::new(scene.graph(), &scene.volume)?)
    }

    /// The medium of one object, where that is all there is to it; else an error that says what is more.
    pub fn of(object: &ObjectMedium) -> Result<Self> {
        let (density, parts, emission_of_density) = common_density(object)?;
        let total = |channel: fn(&Coefficients<f64>) -> [f64; 3]| {
            std::array::from_fn(|index| parts.iter().map(|part| channel(part)[index]).sum())
        };
        let emission = total(|part| part.emission);
        let bounds = object.bounds;
        Ok(Self {
            // What emits everywhere is nowhere empty.
            density: if emission == [0.0; 3] {
                Density::new(density, bounds)?
            } else {
                Density::filling(density, bounds)
            },
            extinction: total(|part| part.extinction),
            scattering: total(|part| part.scattering),
            anisotropy: only_anisotropy(object, &parts)?,
            emission,
            emission_of_density,
            to_object: object.to_object,
            mesh: object.mesh.clone(),
        })
    }
}

/// A program of a single output, coefficients per unit of it and closure, and emission per unit of it.
type CommonDensity = (Arc<Program>, Vec<Coefficients<f64>>, [f64; 3]);

/// The one density that all closures share, as a program of a single output, and each closure's coefficients
/// per unit of it (emission as it is, but where the density is its strength: that part comes last).
fn common_density(object: &ObjectMedium) -> Result<CommonDensity> {
    let densities: Vec<Option<Value>> =
        object.closures().map(|(closure, _)| closure.input("Density").map(|index| closure.inputs[index])).collect();
    let varying = |value: &&Value| matches!(value, Value::Column(_));
    let density = match densities.iter().flatten().find(varying) {
        Some(&column) => column,
        // One constant density stays a density; different ones are multiplied into the coefficients.
        None => match densities.as_slice() {
            [Some(only)] => *only,
            _ => Value::Constant(1.0),
        },
    };
    let mut parts: Vec<Coefficients<f64>> = Vec::new();
    let mut emission_of_density = [0.0; 3];
    for ((closure, scale), own) in object.closures().zip(&densities) {
        let [dark, unit] = [0.0, 1.0].map(|strength| unit_coefficients(closure, scale, *own, density, strength));
        let (dark, unit) = (dark?, unit?);
        // Emission is linear in its strength.
        for (channel, sum) in emission_of_density.iter_mut().enumerate() {
            *sum += unit.emission[channel] - dark.emission[channel];
        }
        parts.push(dark);
    }
    let program = match density {
        Value::Constant(value) => Arc::new(Program::constant("Density", value)),
        // The object's own program where it computes nothing else.
        Value::Column(column) if object.program().outputs.len() == 1 && column == 0 => Arc::clone(object.program()),
        Value::Column(column) => {
            let mut program = Program::clone(object.program());
            program.outputs = vec![program.outputs.swap_remove(column)];
            Arc::new(program)
        }
    };
    Ok((program, parts, emission_of_density))
}

/// A closure's coefficients where the common density is 1, and `strength` the strength of an emission that is linked
/// to it.
fn unit_coefficients(
    closure: &Closure,
    scale: f64,
    own: Option<Value>,
    density: Value,
    strength: f64,
) -> Result<Coefficients<f64>> {
    let refused = |found: String| {
        Error::new(
            format!("node {}", closure.label),
            found,
            "one density that may vary, the same for all closures and for the strength of emission, and constants else",
            "Link only densities and strengths of emission, all to the same output; ray marching knows no more.",
        )
    };
    let mut inputs = Vec::new();
    for socket in closure.node_type.inputs_of(&closure.mode) {
        for value in &closure.inputs[inputs.len()..inputs.len() + socket.kind.components()] {
            inputs.push(match value {
                _ if socket.identifier == "Density" && own == Some(density) => 1.0,
                Value::Constant(value) => f64::from(*value),
                Value::Column(_) if *value == density && STRENGTHS.contains(&socket.identifier) => strength,
                Value::Column(_) => {
                    return Err(refused(format!("socket {}: a value that varies over the volume", socket.identifier)));
                }
            });
        }
    }
    let mut weight = scale;
    for factor in &closure.factors {
        let Value::Constant(share) = factor.value else {
            return Err(refused("a Mix Shader with a factor that varies over the volume".into()));
        };
        let share = f64::from(share).clamp(0.0, 1.0);
        weight *= if factor.complement { 1.0 - share } else { share };
    }
    let found = closure.formula.coefficients(&inputs);
    let scaled = |values: [f64; 3]| values.map(|value| value * weight);
    if own != Some(density) && density != Value::Constant(1.0) && found.extinction != [0.0; 3] {
        return Err(refused("a closure beside one with another, varying density".into()));
    }
    Ok(Coefficients {
        scattering: scaled(found.scattering),
        extinction: scaled(found.extinction),
        emission: scaled(found.emission),
    })
}

/// The anisotropy of the only lobe; 0 where nothing scatters.
fn only_anisotropy(object: &ObjectMedium, parts: &[Coefficients<f64>]) -> Result<f64> {
    let mut found: Option<f64> = None;
    for ((closure, _), _) in object.closures().zip(parts).filter(|(_, part)| part.scattering != [0.0; 3]) {
        // Everything but the density is constant by now, and no phase function reads the density.
        let inputs: Vec<f64> = closure
            .inputs
            .iter()
            .map(|value| match value {
                Value::Constant(value) => f64::from(*value),
                Value::Column(_) => f64::NAN,
            })
            .collect();
        let phase = closure.formula.phase(&inputs).map(PhaseFunction::new);
        let anisotropy = phase.and_then(|phase| phase.henyey_greenstein());
        match (anisotropy, found) {
            (Some(anisotropy), None) => found = Some(anisotropy),
            (Some(anisotropy), Some(known)) if anisotropy == known => {}
            _ => {
                return Err(Error::new(
                    format!("node {}", closure.label),
                    if anisotropy.is_none() { "another phase function" } else { "a second lobe" },
                    "one Henyey-Greenstein lobe: ray marching knows no other",
                    "Give all closures the same anisotropy, or trace paths.",
                )
                .with_setting("integrator"));
            }
        }
    }
    Ok(found.unwrap_or(0.0))
}
