//! What everything else stands on: the error type, named choices, files, numbers as text, progress.

pub mod choice;
pub mod error;
pub mod files;
pub mod numbers;
pub mod progress;
