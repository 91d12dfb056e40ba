//! The density sampled to a grid, as games keep it in a 3D texture: a quality setting of marches.
//!
//! Values lie at the vertices of a grid over the occupied part of the medium, faces included, so that
//! trilinear filtering is exact for a linear density. They are evaluated on the CPU with Cycles' bits,
//! stored in 32, 16 or 8 bits, and read as any texture is ([`crate::nodes::texture_lookup`]): the cached density is a program like the one
//! that it stands for, on the CPU and in WGSL, with bounds and an f64 oracle. What the twins may differ by is rounding: WGSL may
//! fuse, which moves a trilinear value by a few 2^-24 of its largest corner; a position within 2^-22 of
//! the grid's size from the middle between two vertices may go to either with nearest filtering.
//!
//! View samples, shadow rays and the bake of the light grid all read the cache, so its field error
//! reaches the picture through both. The error is measured after every bake ([`CacheReport`]).

use crate::base::error::{Error, Result};
use crate::base::texture::{Outside, Texture, TextureHandle};
use crate::graph::Program;
use crate::media::density::Density;
use crate::media::lattice::{BAKE_CHUNK, vertex, vertices_of};
use crate::scene::image::Image;
use glam::{DMat4, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

pub use crate::base::texture::{TexelFormat as CacheFormat, TextureFilter as CacheFilter};

/// The density sampled to a grid; [the module](self) describes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CacheSettings {
    /// Cells along the longest world side of the occupied part of the medium, at least 1.
    pub cells: u32,
    /// How values are stored.
    pub format: CacheFormat,
    /// How values are read.
    pub filter: CacheFilter,
}

impl Default for CacheSettings {
    fn default() -> Self {
        Self { cells: 128, format: CacheFormat::F16, filter: CacheFilter::Trilinear }
    }
}

/// What a bake may take: the samples in f32 and their stored form.
const MOST_BYTES: f64 = 4.0 * GIBIBYTE;

const GIBIBYTE: f64 = (1_u64 << 30) as f64;

/// Points at which the field error is measured: the largest error of 2^16 points is exceeded by about
/// one part in 2^16 of the volume.
const POINTS: usize = 1 << 16;

/// The density at the vertices, before it is stored in a format.
pub struct Samples {
    exact: Density,
    cells: u32,
    size: [usize; 3],
    low: DVec3,
    step: DVec3,
    values: Vec<f32>,
    seconds: f64,
}

/// A density that is read instead of evaluated.
pub struct DensityCache {
    /// The density.
    pub density: Density,
    /// What is stored.
    pub texture: TextureHandle,
    /// Place of the first vertex, in the frame of the density.
    pub low: DVec3,
    /// From a vertex to the next along each axis.
    pub step: DVec3,
    settings: CacheSettings,
    size: [usize; 3],
    /// Smallest and largest value at a vertex.
    range: [f32; 2],
    bake_seconds: f64,
}

/// Size and field error of a cache, measured at random points of the occupied part of the medium.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CacheReport {
    /// What was asked for.
    pub settings: CacheSettings,
    /// Vertices per axis.
    pub vertices: [usize; 3],
    /// Bytes of the stored values.
    pub bytes: usize,
    /// Smallest and largest value at a vertex.
    pub range: [f32; 2],
    /// Points of the measurement.
    pub points: usize,
    /// Points at which the cached or the exact density is NaN or infinite; no figure counts them.
    pub not_finite: usize,
    /// Largest exact density at a point.
    pub largest_density: f64,
    /// Largest |cached - exact| / max(1, largest density).
    pub max_error: f64,
    /// Root of the mean of (|cached - exact| / max(1, largest density))^2.
    pub rms_error: f64,
    /// Largest |cached - exact| / largest density; 0 where nothing is dense.
    pub relative_max_error: f64,
    /// Root of the mean of (|cached - exact| / largest density)^2.
    pub relative_rms_error: f64,
    /// Seconds of wall time that the evaluation at the vertices took.
    pub bake_seconds: f64,
}

impl CacheReport {
    /// The report that a picture carries if a cache was read for it.
    pub fn of(image: &Image) -> Option<Self> {
        let text = image.provenance.get("density_cache")?;
        Some(serde_json::from_str(text).expect("the integrator wrote it"))
    }
}

impl Samples {
    /// Evaluates the density of an object at the vertices; a grid beyond the memory is refused. The density is not empty.
    pub fn bake(
        density: &Density,
        to_object: &DMat4,
        cells: u32,
        format: CacheFormat,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Self> {
        let begin = std::time::Instant::now();
        let (size, step) = vertices_of(&density.occupied, to_object, cells);
        // In floating point: the product of absurd sizes has no room in 64 bits.
        let vertices: f64 = size.iter().map(|&count| count as f64).product();
        let bytes = vertices * (4 + format.bytes()) as f64;
        if bytes > MOST_BYTES {
            let fitting = (f64::from(cells) * (MOST_BYTES / bytes).cbrt()).floor();
            return Err(Error::new(
                "setting density_cache",
                format!("{cells} cells, {vertices:.3e} vertices, which need {:.1} GiB", bytes / GIBIBYTE),
                format!("a grid that needs at most {:.0} GiB", MOST_BYTES / GIBIBYTE),
                format!("Take {fitting} cells or less."),
            )
            .with_setting("density_cache"));
        }
        let count = vertices as usize;
        let low = density.occupied.low;
        let mut values = Vec::with_capacity(count);
        for start in (0..count).step_by(BAKE_CHUNK) {
            let positions: Vec<[f32; 3]> = (start..count.min(start + BAKE_CHUNK))
                .map(|index| vertex(index, size, low, step).as_vec3().to_array())
                .collect();
            values.extend(density.values(&positions)?);
            progress(values.len() as f64 / count as f64);
        }
        let seconds = begin.elapsed().as_secs_f64();
        Ok(Self { exact: density.clone(), cells, size, low, step, values, seconds })
    }
}

impl DensityCache {
    /// Stores samples in a format; values that it cannot hold are refused.
    pub fn new(samples: &Samples, format: CacheFormat, filter: CacheFilter) -> Result<Self> {
        let Samples { size, values, .. } = samples;
        let low = values.iter().copied().fold(f32::INFINITY, f32::min);
        let high = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let texture = Texture::store(*size, values.clone(), format, filter, Outside::Clamp, "density cache")?;
        let scale = 1.0 / samples.step;
        let origin = -samples.low * scale;
        let rows: [[f32; 4]; 3] = std::array::from_fn(|axis| {
            let mut row = [0.0; 4];
            row[axis] = scale[axis] as f32;
            row[3] = origin[axis] as f32;
            row
        });
        let texture = TextureHandle::new(texture);
        let program = Program::of_texture("density cache", texture.clone(), rows);
        Ok(Self {
            texture,
            low: samples.low,
            step: samples.step,
            density: samples.exact.with_program(Arc::new(program)),
            settings: CacheSettings { cells: samples.cells, format, filter },
            size: *size,
            range: [low, high],
            bake_seconds: samples.seconds,
        })
    }

    /// Measures the field error against the density that was cached, at points that are the same in every run.
    pub fn measure(&self, exact: &Density) -> Result<CacheReport> {
        let extent = exact.occupied.high - exact.occupied.low;
        let mut random = ChaCha8Rng::seed_from_u64(0);
        let positions: Vec<[f32; 3]> = (0..POINTS)
            .map(|_| {
                let part = DVec3::from(std::array::from_fn(|_| random.random::<f64>()));
                (exact.occupied.low + extent * part).as_vec3().to_array()
            })
            .collect();
        let exact = exact.values(&positions)?;
        let cached = self.density.values(&positions)?;
        let mut largest = 0.0_f64;
        let mut max = 0.0_f64;
        let mut squares = 0.0;
        let mut not_finite = 0;
        for (exact, cached) in exact.iter().zip(&cached) {
            if !(exact.is_finite() && cached.is_finite()) {
                not_finite += 1;
                continue;
            }
            let error = (f64::from(*cached) - f64::from(*exact)).abs();
            largest = largest.max(f64::from(*exact));
            max = max.max(error);
            squares += error * error;
        }
        let rms = (squares / (POINTS - not_finite).max(1) as f64).sqrt();
        let relative = |error: f64| if largest > 0.0 { error / largest } else { 0.0 };
        Ok(CacheReport {
            settings: self.settings,
            vertices: self.size,
            bytes: self.size.iter().product::<usize>() * self.settings.format.bytes(),
            range: self.range,
            points: POINTS,
            not_finite,
            largest_density: largest,
            max_error: max / largest.max(1.0),
            rms_error: rms / largest.max(1.0),
            relative_max_error: relative(max),
            relative_rms_error: relative(rms),
            bake_seconds: self.bake_seconds,
        })
    }
}

impl std::fmt::Display for CacheReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [x, y, z] = self.vertices;
        write!(
            f,
            "density cache {x} x {y} x {z} {}, {}, {:.1} MiB: of a largest density of {:.4}, {} random points are off by \
             at most {:.2e} (RMS {:.2e}) of max(1, largest), {:.2e} (RMS {:.2e}) of the largest",
            self.settings.format.name(),
            self.settings.filter.name(),
            self.bytes as f64 / (1 << 20) as f64,
            self.largest_density,
            self.points,
            self.max_error,
            self.rms_error,
            self.relative_max_error,
            self.relative_rms_error,
        )?;
        if self.not_finite > 0 {
            write!(f, "; {} points are not finite", self.not_finite)?;
        }
        Ok(())
    }
}
