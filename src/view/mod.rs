//! What looks and what shines: camera, film, samplers, lights, the environment.

pub mod blue_noise;
pub mod camera;
pub mod environment;
pub mod film;
pub mod jitter_table;
pub mod lights;
pub mod memory;
pub mod sampled_lights;
pub mod sampler;
