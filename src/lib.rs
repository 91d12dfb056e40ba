//! cloudparity: procedural volumes from Blender, exact in Rust and WGSL, compared with Cycles.
//!
//! The way of the data: [`scene`] (files) to [`graph`] (flat, specialised programs of [`nodes`]) to values on the CPU, WGSL on the GPU
//! and bounds; from there to [`integrators`] (truth) and [`engines`] (what runs in real time), to [`measure`] and to [`report`]. A module
//! uses what stands before it in that way and nothing behind it (`tests/arrows.rs`). `ARCHITECTURE.md` is the map.
//!
//! The feature `tools`, which is on by default, adds the bridge to Blender, measurements, reports and the command line; without it nothing
//! needs an operating system. The feature `viewer`, on by default, too, adds the window.

pub mod base;
#[cfg(feature = "tools")]
pub mod bridge;
#[cfg(feature = "tools")]
pub mod cli;
pub mod engines;
pub mod gpu;
pub mod graph;
pub mod integrators;
#[cfg(feature = "tools")]
pub mod measure;
pub mod media;
pub mod nodes;
#[cfg(feature = "tools")]
pub mod report;
pub mod scene;
pub mod view;
#[cfg(feature = "viewer")]
pub mod viewer;

pub use base::error::{Error, Result};
