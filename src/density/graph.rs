//! The density of a scene's node graph as a density model: what engines' light models and marches take.

use super::{DensityModel, ModelShader};
use crate::error::{Error, Result};
use crate::graph::Program;
use crate::graph::evaluate::Points;
use crate::integrate::engine::box_of;
use crate::scene::Scene;
use glam::{DAffine3, DVec3};

/// The graph's density in the box of its volume, under an extinction that is given.
pub struct GraphDensity {
    program: Program,
    from_box: DAffine3,
    factor: f64,
    extinction: [f64; 3],
}

impl GraphDensity {
    /// Compiles the density of a scene whose closures share one; `factor` on it, and the extinction per unit of what that gives and
    /// side of the box, stand for the material's own.
    pub fn new(scene: &Scene, factor: f64, extinction: [f64; 3]) -> Result<Self> {
        let program = Program::density(scene)?;
        if let Some(name) = program.attributes.first() {
            return Err(Error::new(
                format!("the density of scene {}", scene.name),
                format!("the attribute \"{name}\", whose values are not known"),
                "a density of the place alone",
                "Take the attribute out of the graph.",
            ));
        }
        Ok(Self { program, from_box: box_of(&scene.volume.bounds).inverse(), factor, extinction })
    }

    /// The program that it evaluates, in the object's frame.
    pub fn program(&self) -> &Program {
        &self.program
    }

    /// Object-space positions of places of the local box.
    pub fn positions(&self, places: &[DVec3]) -> Vec<[f32; 3]> {
        places.iter().map(|&place| self.from_box.transform_point3(place).as_vec3().to_array()).collect()
    }
}

impl DensityModel for GraphDensity {
    fn densities(&self, places: &[DVec3]) -> Vec<f64> {
        let positions = self.positions(places);
        let values = self.program.evaluate_single(Points::new(&positions)).expect("a density without attributes");
        // Negative densities act as 0; NaN stays to be seen.
        let density = |value: f32| if value < 0.0 { 0.0 } else { f64::from(value) * self.factor };
        values.into_iter().map(density).collect()
    }

    fn extinction(&self) -> [f64; 3] {
        self.extinction
    }

    fn shader(&self) -> Result<ModelShader> {
        Err(Error::new(
            "--gpu",
            "the density of a node graph",
            "a density model with a shader of its own: engines march graphs on the CPU",
            "Leave --gpu out.",
        ))
    }
}
