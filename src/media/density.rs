//! A density that an engine marches.

use crate::base::error::Result;
use crate::gpu::ModelShader;
use crate::media::averages::CoarseDensity;
use glam::DVec3;
use std::sync::Arc;

/// A density in the local box.
pub trait DensityModel: Send + Sync {
    /// Densities at places of the local box, in their order; never negative. NaN only where a graph gives NaN.
    fn densities(&self, places: &[DVec3]) -> Vec<f64>;

    /// Extinction of a view ray per unit of density and unit of length, per channel.
    fn extinction(&self) -> [f64; 3];

    /// The same for the adapter, or why there is none.
    fn shader(&self) -> Result<ModelShader>;

    /// Its averages, where they were made: light models that ask for them need them.
    fn coarse(&self) -> Option<&CoarseDensity> {
        None
    }
}

/// A density shared by several engines.
impl<T: DensityModel + ?Sized> DensityModel for Arc<T> {
    fn densities(&self, places: &[DVec3]) -> Vec<f64> {
        self.as_ref().densities(places)
    }

    fn extinction(&self) -> [f64; 3] {
        self.as_ref().extinction()
    }

    fn shader(&self) -> Result<ModelShader> {
        self.as_ref().shader()
    }

    fn coarse(&self) -> Option<&CoarseDensity> {
        self.as_ref().coarse()
    }
}
