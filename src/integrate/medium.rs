//! The medium of a scene: its density program, constant closure inputs, place and empty parts.

use crate::error::{Error, Result};
use crate::graph::evaluate::Points;
use crate::graph::{Operand, Program, Target, target};
use crate::nodes::principled_volume::coefficients_per_density;
use crate::scene::{self, Scene, Shape};
use glam::{DMat4, DVec3};

/// Cells per side of the table of provably empty parts.
pub(super) const CELLS: usize = 16;

/// Padding of a cell as a fraction of its side: rounding of f32 positions is far below it.
const PADDING: f32 = 1e-3;

/// A Principled Volume in a box whose density varies and whose other inputs are constant.
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
    /// World to object.
    pub to_object: DMat4,
    /// The box in the object's frame.
    pub bounds: Region,
    /// The part of the box outside of which there is provably nothing.
    pub occupied: Region,
    /// Whether each of the `CELLS`^3 cells may hold something; x runs fastest.
    pub(super) cells: Vec<bool>,
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
        let volume = &scene.volume;
        if !matches!(volume.shape, Shape::Box) {
            return Err(Error::new(
                "$.volume.shape",
                "a mesh",
                "\"box\": this integrator knows media that fill exactly their bounding box",
                "Use a cube as the volume's object.",
            ));
        }
        let closure = target::closing_node(scene)?.name.clone();
        let constant = |socket: &str| constant(scene, &closure, socket);
        let color = constant("Color")?;
        let absorption_color = constant("Absorption Color")?;
        let coefficients: [_; 3] = std::array::from_fn(|c| coefficients_per_density(color[c], absorption_color[c]));
        if constant("Blackbody Intensity")?[0] != 0.0 {
            return Err(Error::new(
                format!("node {closure}, socket Blackbody Intensity"),
                "a value other than 0",
                "0: blackbody emission is not supported",
                "Use Emission Strength and Emission Color.",
            ));
        }
        let strength = f64::from(constant("Emission Strength")?[0].max(0.0));
        let emission = constant("Emission Color")?;
        let bounds = Region {
            low: DVec3::from(volume.bounds.min.map(f64::from)),
            high: DVec3::from(volume.bounds.max.map(f64::from)),
        };
        let mut medium = Self {
            density: Program::density(scene)?,
            extinction: coefficients.map(|(extinction, _)| f64::from(extinction)),
            scattering: coefficients.map(|(_, scattering)| f64::from(scattering)),
            anisotropy: f64::from(constant("Anisotropy")?[0].clamp(-0.999, 0.999)),
            emission: std::array::from_fn(|channel| strength * f64::from(emission[channel])),
            to_object: scene::matrix_to_glam(&volume.matrix_world).inverse(),
            bounds,
            occupied: bounds,
            cells: vec![true; CELLS.pow(3)],
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

    /// Density at object-space positions: negative values act as 0, NaN stays to be seen.
    pub fn densities(&self, positions: &[[f32; 3]]) -> Result<Vec<f32>> {
        let mut values = self.density.evaluate_single(Points::new(positions))?;
        for value in &mut values {
            if *value < 0.0 {
                *value = 0.0;
            }
        }
        Ok(values)
    }
}

/// A closure input that does not vary over the object; scalars fill the first component.
fn constant(scene: &Scene, closure: &str, socket: &str) -> Result<[f32; 3]> {
    let program = Program::compile(scene, &[Target::input(closure, socket)])?;
    let mut values = [0.0; 3];
    for (value, operand) in values.iter_mut().zip(&program.outputs[0].operands) {
        let Operand::Constant(found) = operand else {
            return Err(Error::new(
                format!("node {closure}, socket {socket}"),
                "a value that varies over the volume",
                "a constant: of this closure only the density may vary here",
                "Unlink the socket, or link it to constant nodes only.",
            ));
        };
        *value = *found;
    }
    Ok(values)
}

/// Henyey-Greenstein phase function in 1/sr for the cosine between the directions of travel before
/// and after; isotropic below |g| = 0.001, as in Cycles.
pub fn henyey_greenstein(anisotropy: f64, cosine: f64) -> f64 {
    let sphere = 4.0 * std::f64::consts::PI;
    if anisotropy.abs() < 0.001 {
        return 1.0 / sphere;
    }
    let square = anisotropy * anisotropy;
    (1.0 - square) / (sphere * (1.0 + square - 2.0 * anisotropy * cosine).powf(1.5))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_phase_function_integrates_to_one() {
        for anisotropy in [0.0, 0.6, -0.3, 0.9] {
            let count = 100_000;
            let sum: f64 = (0..count)
                .map(|index| henyey_greenstein(anisotropy, -1.0 + 2.0 * (f64::from(index) + 0.5) / f64::from(count)))
                .sum();
            // Midpoint rule: h^2/24 times the change of slope between the ends, 4e-7 at g = 0.9.
            let integral = sum * 4.0 * std::f64::consts::PI / f64::from(count);
            assert!((integral - 1.0).abs() < 1e-6, "g = {anisotropy}: {integral}");
        }
    }

    #[test]
    fn a_ray_crosses_a_box_at_its_faces() {
        let region = Region { low: DVec3::splat(-1.0), high: DVec3::splat(1.0) };
        assert_eq!(region.segment(DVec3::new(0.0, -5.0, 0.0), DVec3::Y), Some((4.0, 6.0)));
        assert_eq!(region.segment(DVec3::new(0.0, -5.0, 2.0), DVec3::Y), None);
        assert_eq!(region.segment(DVec3::ZERO, DVec3::Z * 2.0), Some((-0.5, 0.5)));
        assert_eq!(region.segment(DVec3::new(1.0, 0.0, -5.0), DVec3::Z), Some((4.0, 6.0)));
    }
}
