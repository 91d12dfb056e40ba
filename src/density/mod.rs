//! Density models beside the node graph: clouds of published engines, rebuilt from what they compute.

pub mod perlin_fbm;
