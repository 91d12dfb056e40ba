//! Measurements: a module per question, from what experiments share to what each of them asks.

pub mod convergence;
pub mod densities;
pub mod fields;
pub mod nodes;
pub mod parity;
pub mod pictures;
pub mod speed;
pub mod stability;
pub mod study;
pub mod time_to_error;
pub mod tuning;
pub mod voxels;
