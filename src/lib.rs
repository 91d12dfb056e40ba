//! cloudparity: procedural volumes from Blender, exact in Rust and WGSL, compared with Cycles.
//!
//! The way of the data: [`scene`] (files) to [`graph`] (flat, specialised programs of [`nodes`]) to values on the CPU, WGSL on the GPU
//! and bounds; from there to [`integrators`] (truth) and [`engines`] (what runs in real time), to [`measure`] and to [`report`]. A module
//! uses what stands before it in that way and nothing behind it (`tests/arrows.rs`). `ARCHITECTURE.md` is the map.

pub mod base;
pub mod bridge;
pub mod cli;
pub mod engines;
pub mod gpu;
pub mod graph;
pub mod integrators;
pub mod measure;
pub mod media;
pub mod nodes;
pub mod report;
pub mod scene;
pub mod view;

pub use base::error::{Error, Result};
