//! Measurements: an experiment per question, and what they share.
//!
//! [`experiment`] runs all of them: plan, jobs, records, summary. What they share stands beside it: truths and errors against them, timing, seeds,
//! scenes and settings of engines as files list them, parity suites, the evaluators of fields and where their points lie, what is asked of
//! pictures. Each question has a folder, and none uses another's (`tests/arrows.rs`).

pub mod combination;
pub mod domain;
pub mod errors;
pub mod evaluators;
pub mod experiment;
pub mod images;
pub mod light_volume;
pub mod scenes;
pub mod seeds;
pub mod sequence;
pub mod suite;
pub mod timing;
pub mod toml_files;
pub mod truth;
pub mod voxels;

pub mod attribution;
pub mod convergence;
pub mod densities;
pub mod fields;
pub mod findings;
pub mod nodes;
pub mod pictures;
pub mod provenance;
pub mod speed;
pub mod stability;
pub mod study;
pub mod tuning;
