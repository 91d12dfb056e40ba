//! The medium as `march` and the adapter know it: one varying density, constant factors, one lobe, in one object.
//!
//! [`super::objects`] knows media in full.

use crate::base::error::{Error, Result};
use crate::graph::closures::{Closure, ClosureSum, Value};
use crate::graph::evaluate::Points;
use crate::graph::{Operand, Output, Program};
use crate::media::density_cache::CacheSettings;
use crate::media::density_cache::{DensityCache, Samples};
use crate::media::objects::box_of;
use crate::media::phase::PhaseFunction;
use crate::nodes::closure::Coefficients;
use crate::scene::{self, Scene, SocketType};
use glam::{DMat4, DVec3};

/// Cells per side of the table of provably empty parts.
pub(crate) const CELLS: usize = 16;

/// Padding of a cell as a fraction of its side: rounding of f32 positions is far below it.
const PADDING: f32 = 1e-3;

/// Sockets that emission is linear in.
const STRENGTHS: [&str; 2] = ["Emission Strength", "Strength"];

/// A sum of closures in a box that share one varying density and are constant else.
///
/// Coefficients are per metre of world space whatever the object's scale: a ray carries its world
/// length along when it is taken into the object's frame.
pub struct Medium {
    /// Density at object-space positions.
    pub density: Program,
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
    /// The box in the object's frame.
    pub bounds: Region,
    /// The part of the box outside of which there is provably nothing.
    pub occupied: Region,
    /// Whether each of the `CELLS`^3 cells may hold something; x runs fastest.
    pub(crate) cells: Vec<bool>,
    /// Answers for the density where there is one.
    pub(crate) cache: Option<DensityCache>,
}

/// An axis-aligned box in the object's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Lower corner.
    pub low: DVec3,
    /// Upper corner.
    pub high: DVec3,
}

impl Region {
    /// Whether it has no volume.
    pub fn is_empty(&self) -> bool {
        !self.low.cmplt(self.high).all()
    }

    /// Parameters at which `origin + t direction` enters and leaves, or None where it misses.
    pub fn segment(&self, origin: DVec3, direction: DVec3) -> Option<(f64, f64)> {
        let mut enter = f64::NEG_INFINITY;
        let mut leave = f64::INFINITY;
        for axis in 0..3 {
            // A ray that runs in a face is inside; the division below would make it NaN.
            if direction[axis] == 0.0 {
                if (self.low[axis]..=self.high[axis]).contains(&origin[axis]) {
                    continue;
                }
                return None;
            }
            let first = (self.low[axis] - origin[axis]) / direction[axis];
            let second = (self.high[axis] - origin[axis]) / direction[axis];
            enter = enter.max(first.min(second));
            leave = leave.min(first.max(second));
        }
        (enter < leave).then_some((enter, leave))
    }
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
        let volume = &scene.volume;
        let bounds = box_of(volume)?;
        let ClosureSum { program, closures } = ClosureSum::compile(scene.graph(), volume)?;
        let (density, parts, emission_of_density) = common_density(program, &closures)?;
        let total = |channel: fn(&Coefficients<f64>) -> [f64; 3]| {
            std::array::from_fn(|index| parts.iter().map(|part| channel(part)[index]).sum())
        };
        let mut medium = Self {
            density,
            extinction: total(|part| part.extinction),
            scattering: total(|part| part.scattering),
            anisotropy: only_anisotropy(&closures, &parts)?,
            emission: total(|part| part.emission),
            emission_of_density,
            to_object: scene::matrix_to_glam(&volume.matrix_world).inverse(),
            bounds,
            occupied: bounds,
            cells: vec![true; CELLS.pow(3)],
            cache: None,
        };
        if medium.emission == [0.0; 3] {
            medium.find_empty_cells()?;
        }
        Ok(medium)
    }

    /// Marks the cells over which the density is provably zero, and shrinks [`Self::occupied`].
    fn find_empty_cells(&mut self) -> Result<()> {
        let side = (self.bounds.high - self.bounds.low) / CELLS as f64;
        let mut first = [CELLS; 3];
        let mut last = [0; 3];
        for (index, cell) in self.cells.iter_mut().enumerate() {
            let place = [index % CELLS, index / CELLS % CELLS, index / CELLS / CELLS];
            let low = self.bounds.low + side * DVec3::from(place.map(|number| number as f64));
            let pad = side.as_vec3() * PADDING;
            let found =
                self.density.bounds((low.as_vec3() - pad).to_array(), ((low + side).as_vec3() + pad).to_array())?[0];
            *cell = found.may_be_nan || found.high > 0.0;
            if *cell {
                for axis in 0..3 {
                    first[axis] = first[axis].min(place[axis]);
                    last[axis] = last[axis].max(place[axis] + 1);
                }
            }
        }
        let corner = |place: [usize; 3]| self.bounds.low + side * DVec3::from(place.map(|number| number as f64));
        self.occupied = if first[0] < last[0] {
            Region { low: corner(first), high: corner(last) }
        } else {
            Region { low: self.bounds.low, high: self.bounds.low }
        };
        Ok(())
    }

    /// Whether there may be something at a position of the object's frame.
    pub fn may_hold(&self, position: DVec3) -> bool {
        let part = (position - self.bounds.low) / (self.bounds.high - self.bounds.low) * CELLS as f64;
        let place: [usize; 3] = std::array::from_fn(|axis| (part[axis].max(0.0) as usize).min(CELLS - 1));
        self.cells[(place[2] * CELLS + place[1]) * CELLS + place[0]]
    }

    /// The density where it is the same everywhere and no cache changes it.
    pub fn homogeneous(&self) -> Option<f64> {
        match self.density.outputs[0].operands[0] {
            Operand::Constant(value) if self.cache.is_none() && value.is_finite() => Some(f64::from(value.max(0.0))),
            _ => None,
        }
    }

    /// Bakes a cache of the density, which answers from then on.
    pub fn read_from_cache(&mut self, settings: CacheSettings) -> Result<()> {
        let samples = Samples::bake(self, settings.cells, settings.format, &|_| ())?;
        self.cache = Some(DensityCache::new(&samples, settings.format, settings.filter)?);
        Ok(())
    }

    /// Density at object-space positions, from the cache where there is one.
    pub fn densities(&self, positions: &[[f32; 3]]) -> Result<Vec<f32>> {
        match &self.cache {
            Some(cache) => Ok(cache.densities(positions)),
            None => self.exact_densities(positions),
        }
    }

    /// Evaluated density at object-space positions: negative values act as 0, NaN stays to be seen.
    pub fn exact_densities(&self, positions: &[[f32; 3]]) -> Result<Vec<f32>> {
        let mut values = self.density.evaluate_single(Points::new(positions))?;
        for value in &mut values {
            if *value < 0.0 {
                *value = 0.0;
            }
        }
        Ok(values)
    }
}

/// A program of a single output, coefficients per unit of it and closure, and emission per unit of it.
type CommonDensity = (Program, Vec<Coefficients<f64>>, [f64; 3]);

/// The one density that all closures share, as a program of a single output, and each closure's coefficients
/// per unit of it (emission as it is, but where the density is its strength: that part comes last).
fn common_density(mut program: Program, closures: &[Closure]) -> Result<CommonDensity> {
    let densities: Vec<Option<Value>> =
        closures.iter().map(|closure| closure.input("Density").map(|index| closure.inputs[index])).collect();
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
    for (closure, own) in closures.iter().zip(&densities) {
        let [dark, unit] = [0.0, 1.0].map(|strength| unit_coefficients(closure, *own, density, strength));
        let (dark, unit) = (dark?, unit?);
        // Emission is linear in its strength.
        for (channel, sum) in emission_of_density.iter_mut().enumerate() {
            *sum += unit.emission[channel] - dark.emission[channel];
        }
        parts.push(dark);
    }
    let operand = match density {
        Value::Constant(value) => Operand::Constant(value),
        Value::Column(column) => program.outputs[column].operands[0].clone(),
    };
    program.outputs = vec![Output { name: "Density".into(), kind: SocketType::Float, operands: vec![operand] }];
    Ok((program, parts, emission_of_density))
}

/// A closure's coefficients where the common density is 1, and `strength` the strength of an emission that is linked
/// to it.
fn unit_coefficients(
    closure: &Closure,
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
    let mut weight = 1.0;
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
fn only_anisotropy(closures: &[Closure], parts: &[Coefficients<f64>]) -> Result<f64> {
    let mut found: Option<f64> = None;
    for (closure, _) in closures.iter().zip(parts).filter(|(_, part)| part.scattering != [0.0; 3]) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_crosses_a_box_at_its_faces() {
        let region = Region { low: DVec3::splat(-1.0), high: DVec3::splat(1.0) };
        assert_eq!(region.segment(DVec3::new(0.0, -5.0, 0.0), DVec3::Y), Some((4.0, 6.0)));
        assert_eq!(region.segment(DVec3::new(0.0, -5.0, 2.0), DVec3::Y), None);
        assert_eq!(region.segment(DVec3::ZERO, DVec3::Z * 2.0), Some((-0.5, 0.5)));
        assert_eq!(region.segment(DVec3::new(1.0, 0.0, -5.0), DVec3::Z), Some((4.0, 6.0)));
    }
}
