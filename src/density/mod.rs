//! Density models beside the node graph: clouds of published engines, rebuilt from what they compute.
//!
//! All of them answer through [`DensityModel`], in a *local box* from -0.5 to 0.5 on every axis whose side is one unit of length.

pub mod perlin_fbm;
pub mod schema;

use glam::DVec3;

/// A density in the local box.
pub trait DensityModel: Send + Sync {
    /// Densities at places of the local box, in their order; never negative, never NaN.
    fn densities(&self, places: &[DVec3]) -> Vec<f64>;

    /// Extinction of a view ray per unit of density and unit of length, per channel.
    fn extinction(&self) -> [f64; 3];

    /// The same for the adapter.
    fn shader(&self) -> ModelShader;
}

/// A density model as a WGSL module with its data.
pub struct ModelShader {
    /// File in `shaders/`.
    pub path: &'static str,
    /// Its text: defines the import path `cloudparity::density_model` with `fn density(place: vec3f) -> f32`.
    pub source: &'static str,
    /// Contents of binding 0 of group 1, a uniform buffer.
    pub uniform: Vec<u8>,
    /// Contents of the bindings from 1 on, read-only storage buffers.
    pub storage: Vec<Vec<u8>>,
}

/// Cubic Hermite step from 0 below `low` to 1 above `high`.
pub fn smooth<T: num_traits::Float>(low: T, high: T, value: T) -> T {
    let three = T::one() + T::one() + T::one();
    let t = ((value - low) / (high - low)).max(T::zero()).min(T::one());
    t * t * (three - (t + t))
}
