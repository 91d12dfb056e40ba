//! What everything else stands on: the error type, named choices, files, numbers as text, progress, textures.

pub mod choice;
pub mod error;
pub mod files;
pub mod interpolation;
pub mod numbers;
pub mod progress;
pub mod texture;
