//! Two densities side by side: fields, their statistics, pictures.

pub mod comparison;
pub mod statistics;
