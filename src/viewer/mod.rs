//! The window: an engine's picture of a scene that one turns with the mouse, beside the truth, with its error against its time.
//!
//! [`look`] is what is looked at; engine and truth run in threads of their own, so that the window answers whatever they do:
//! an engine is put together again for every changed number, and its kernels are compiled again only where their text changed. When the
//! view rests, path tracing accumulates; [`compare`] says what the error is and how sure that is. The window itself knows no files: what
//! is saved goes through a [`Source`].

pub mod compare;
mod controls;

mod engine_thread;
pub mod look;
pub mod quality;
mod truth_thread;
mod window;

pub use engine_thread::Shown;
pub use truth_thread::Truth;
pub use window::{App, open};

use crate::base::display_table::DisplayTable;
use crate::base::error::Result;
use crate::engines::Engine;
use crate::gpu::{Backend, Gpu};
use crate::integrators::path::GivenMedium;
use crate::scene::Scene;
use crate::scene::image::Image;
use indexmap::IndexMap;
use quality::Choice;

/// What was changed in the window, by the names that files and options have; nothing where it is empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Changes {
    /// A setting of [`Source::front`] in the place of the engine that was asked for.
    pub setting: Option<usize>,
    /// A level of quality or another set of values of the system.
    pub quality: Option<String>,
    /// A light model in the place of the one that is there.
    pub light: Option<String>,
    /// Values of the scene's material, by the names of [`Scene::settable`].
    pub scene: IndexMap<String, f64>,
    /// Parameters of the system.
    pub density: IndexMap<String, f64>,
    /// Parameters of its light.
    pub of_light: IndexMap<String, f64>,
    /// Seconds of animation, added to those that were asked for.
    pub seconds: f64,
}

/// What is put on disk: an engine's picture, the truth of the same view, and what their figures were.
pub struct Record<'a> {
    /// The scene as it was looked at.
    pub scene: &'a Scene,
    /// What was changed.
    pub changes: &'a Changes,
    /// Where the engine's picture was made.
    pub backend: Backend,
    /// The engine's picture.
    pub shown: &'a Shown,
    /// Pictures of the truth of equal weight, whose spread is its noise; none where there is no truth yet.
    pub truth: &'a [Image],
}

/// Where the window has its engines from, and what it gives its results to.
pub trait Source: Send + Sync {
    /// The scene as it was asked for.
    fn scene(&self) -> &Scene;

    /// The adapter for the engine's pictures; asked for again where it was lost.
    fn adapter(&self) -> Result<Gpu> {
        Gpu::open()
    }

    /// The engine under changes, and the scene that it is in.
    fn engine(&self, changes: &Changes) -> Result<(Scene, Engine)>;

    /// Whose light transport is right: the scene, and a medium where it is not the scene's own.
    fn truth(&self, changes: &Changes) -> Result<(Scene, Option<GivenMedium>)>;

    /// Pictures of equal weight that are right where camera, light and numbers are those that were asked for, such as Cycles'; often none.
    fn pictures(&self) -> &[Image];

    /// Rays per pixel and axis.
    fn sub_pixels(&self, changes: &Changes) -> u32;

    /// Settings that nothing beats in time and error, by rising time; none where nobody measured.
    fn front(&self) -> &[Choice] {
        &[]
    }

    /// The scene's view transform as a table; none where it is Standard, which has a formula.
    fn view_transform(&self) -> Result<Option<DisplayTable>> {
        Ok(None)
    }

    /// Mean HDR-FLIP of a picture against the truth; none where it is not known.
    fn flip(&self, _ours: &Image, _truth: &Image) -> Result<Option<f64>> {
        Ok(None)
    }

    /// Writes a record; says where and what was found.
    fn record(&self, record: &Record<'_>) -> Result<String>;

    /// Writes the engine as it is now as a preset; says where.
    fn save_preset(&self, changes: &Changes) -> Result<String>;
}
