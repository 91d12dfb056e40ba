//! What everything else stands on: the error type, files, numbers as text, progress, textures.

pub mod error;
pub mod files;
pub mod interpolation;
pub mod numbers;
pub mod progress;
pub mod texture;
