//! What light meets: objects with their outlines, phase functions, the transfer of a step, majorants, cached and averaged densities, light that was found beforehand.

pub mod averages;
pub mod density;
pub mod density_cache;
pub mod lattice;
pub mod light_volume;
pub mod majorant;
pub mod medium;
pub mod mesh;
pub mod object_index;
pub mod objects;
pub mod phase;
pub mod region;
pub mod transfer;
