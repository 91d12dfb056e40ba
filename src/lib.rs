//! cloudparity: procedural volumes from Blender, exact in Rust and WGSL, compared with Cycles.
//!
//! The way of the data: [`scene`] (files) to [`graph`] (flat, specialised programs of [`nodes`]) to
//! values on the CPU, WGSL on the GPU and bounds. `ARCHITECTURE.md` is the map.

pub mod bench;
pub mod blender;
pub mod cli;
pub mod compare;
pub mod demo;
pub mod density;
pub mod error;
pub mod field;
pub mod files;
pub mod gpu;
pub mod graph;
pub mod image;
pub mod integrate;
pub mod lighting;
pub mod nodes;
pub mod parity;
pub mod post;
pub mod report;
pub mod scene;
pub mod stability;
pub mod study;
pub mod time_to_error;
pub mod tuning;
pub mod volume_grid;

pub use error::{Error, Result};
