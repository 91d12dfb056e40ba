//! How long the bake takes beside a straightforward one.

use crate::base::error::Result;
use crate::engines::perlin_fbm::adapter::BakeKernel;
use crate::gpu::Gpu;
use crate::nodes::perlin_fbm::Volume;
use crate::nodes::perlin_fbm::bake::Bake;
use serde::Serialize;
use std::time::Instant;

/// Bakes once.
type Way<'a> = Box<dyn Fn() -> Result<Volume> + 'a>;

/// What one way of baking took.
#[derive(Debug, Clone, Serialize)]
pub struct BakeRow {
    /// Which way.
    pub what: &'static str,
    /// Seconds of wall time, the median of the repeats.
    pub seconds: f64,
    /// Seconds of the plain bake over these, within one run.
    pub ratio: f64,
    /// Texels that differ from the plain bake's.
    pub differing: usize,
    /// Largest difference of a byte.
    pub largest_difference: u8,
}

/// Bakes of the default parameters with `side` texels per axis: in double precision, texel by texel on one core; then each other
/// way. Those are repeated and interleaved, so that other work on the machine meets all of them; the adapter's kernel is
/// compiled before.
pub fn run(side: usize, repeats: usize, gpu: Option<&Gpu>, mut receive: impl FnMut(&str)) -> Result<Vec<BakeRow>> {
    let bake = Bake::default();
    let kernel = gpu.map(BakeKernel::new).transpose()?;
    let mut ways: Vec<(&str, Way)> = vec![
        ("f64, one core, texel by texel", Box::new(|| bake.volume_plain(side))),
        ("f64, all cores, row by row", Box::new(|| bake.volume(side))),
        ("f32, all cores, row by row", Box::new(|| bake.volume_in::<f32>(side))),
    ];
    if let Some(kernel) = &kernel {
        ways.push(("WGSL", Box::new(|| kernel.volume(&bake, side))));
    }
    let mut seconds = vec![Vec::new(); ways.len()];
    let mut volumes = Vec::new();
    for repeat in 0..repeats.max(1) {
        for (number, (what, way)) in ways.iter().enumerate() {
            receive(what);
            let begin = Instant::now();
            let volume = way()?;
            seconds[number].push(begin.elapsed().as_secs_f64());
            if repeat == 0 {
                volumes.push(volume);
            }
        }
    }
    let medians: Vec<f64> = seconds
        .into_iter()
        .map(|mut seconds| {
            seconds.sort_by(f64::total_cmp);
            seconds[seconds.len() / 2]
        })
        .collect();
    Ok(ways
        .iter()
        .enumerate()
        .map(|(number, (what, _))| {
            let pairs = volumes[number].texels.iter().zip(&volumes[0].texels);
            let differences: Vec<u8> = pairs.map(|(a, b)| a.abs_diff(*b)).collect();
            BakeRow {
                what,
                seconds: medians[number],
                ratio: medians[0] / medians[number],
                differing: differences.iter().filter(|&&difference| difference > 0).count(),
                largest_difference: differences.into_iter().max().unwrap_or(0),
            }
        })
        .collect())
}
