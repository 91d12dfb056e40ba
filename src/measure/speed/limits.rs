//! What an adapter could do at most, measured by its own timestamps: points that are read and written, and multiply-adds. A field's rate beside
//! them says whether memory or arithmetic limits it.

use crate::base::error::Result;
use crate::gpu::Gpu;
use crate::gpu::arithmetic::MULTIPLY_ADDS;
use crate::graph::Program;
use crate::graph::evaluate::Points;
use crate::measure::speed::idle_scene;
use crate::measure::timing::{Clock, repeated};
use crate::scene::Scene;
use serde::{Deserialize, Serialize};

/// Limits of an adapter, each a second.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// Points of a field that is nothing but a coordinate: 12 bytes are read and 4 written for each.
    pub points: f64,
    /// Multiply-adds of 32-bit integers, of which hashes are made.
    pub integer_multiply_adds: f64,
    /// Fused multiply-adds of f32.
    pub float_multiply_adds: f64,
}

/// The rate of a kernel by the adapter's own clock: work over the median time of so many repeats, after one that is not counted. None where
/// the adapter has no clock of its own.
pub(super) fn rate(gpu: &Gpu, work: f64, repeats: usize, mut run: impl FnMut() -> Result<()>) -> Result<Option<f64>> {
    if Clock::of(Some(gpu)) != Clock::Timestamps {
        return Ok(None);
    }
    run()?;
    let seconds = repeated(repeats, Some(gpu), run)?.0.median;
    Ok((seconds > 0.0).then(|| work / seconds))
}

/// Measures an adapter; none where it has no clock of its own, as software, whose limits are the processor's.
pub(super) fn measure(gpu: &Gpu, scene: &Scene, points: &[[f32; 3]], repeats: usize) -> Result<Option<Limits>> {
    let kernel = gpu.field(&Program::density(&idle_scene(scene)?)?)?;
    let read = rate(gpu, points.len() as f64, repeats, || kernel.evaluate(Points::new(points)).map(drop))?;
    let of = |integers: bool| rate(gpu, MULTIPLY_ADDS, repeats, gpu.multiply_adds(integers)?);
    let (Some(points), Some(integer_multiply_adds), Some(float_multiply_adds)) = (read, of(true)?, of(false)?) else {
        return Ok(None);
    };
    Ok(Some(Limits { points, integer_multiply_adds, float_multiply_adds }))
}
