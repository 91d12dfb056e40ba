//! What everything else stands on: the error type, files, numbers as text, progress.

pub mod error;
pub mod files;
pub mod numbers;
pub mod progress;
