//! Points of the curves of unbiased renderers: what [`super::curves`] measures and everything else reads.

use crate::measure::errors::Errors;
use serde::{Deserialize, Serialize};

/// Parts of a pixel per axis, of which each is a pixel of Cycles' render.
pub const CELLS: u32 = 4;

/// Parts of a pixel.
pub const PARTS: u32 = CELLS * CELLS;

/// A renderer whose pictures converge to the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Renderer {
    /// Our path tracing.
    Path,
    /// Cycles' null collision.
    Cycles,
}

impl Renderer {
    /// Name for readers.
    pub fn label(self) -> &'static str {
        match self {
            Self::Path => "path tracing",
            Self::Cycles => "Cycles",
        }
    }
}

/// A point of a curve.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    /// Hash of all that it depends on.
    pub id: String,
    /// Who renders.
    pub renderer: Renderer,
    /// Name of the scene.
    pub scene: String,
    /// Density model.
    pub density: String,
    /// Samples per pixel.
    pub samples: u32,
    /// Pictures that share no sample, over which the errors are means.
    pub pictures: u32,
    /// Errors against the truth.
    pub errors: Errors,
    /// HDR-FLIP of the picture against the mean of the truth, where it could be computed.
    pub flip: Option<f64>,
    /// Processor seconds of the samples; none where the render does not tell them from its preparation: Cycles with one sample per part.
    pub seconds: Option<f64>,
    /// Processor seconds before the first sample, which every render pays.
    pub prepare_seconds: f64,
    /// relMSE times all seconds.
    pub cost: f64,
    /// The picture (the first, where there are several), relative to the folder.
    pub picture: String,
    /// The truth, by its hash.
    pub truth: String,
}

/// A curve that could not be made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MissingCurve {
    /// Who would have rendered.
    pub renderer: Renderer,
    /// Name of the scene.
    pub scene: String,
    /// Density model.
    pub density: String,
    /// Why it is not there.
    pub reason: String,
}
