//! The density sampled to a grid, as games keep it in a 3D texture: a quality setting of marches.
//!
//! Values lie at the vertices of a grid over the occupied part of the medium, faces included, so that
//! trilinear filtering is exact for a linear density. They are evaluated on the CPU with Cycles' bits,
//! stored in 32, 16 or 8 bits, and read by the CPU and by its twin `shaders/media/density_cache.wgsl`
//! in f32 with the same operations in the same order. What the twins may differ by is rounding: WGSL may
//! fuse, which moves a trilinear value by a few 2^-24 of its largest corner; a position within 2^-22 of
//! the grid's size from the middle between two vertices may go to either with nearest filtering.
//!
//! View samples, shadow rays and the bake of the light grid all read the cache, so its field error
//! reaches the picture through both. The error is measured after every bake ([`CacheReport`]).

use crate::base::error::{Error, Result};
use crate::media::lattice::{BAKE_CHUNK, vertex, vertices_of};
use crate::media::medium::Medium;
use crate::scene::image::Image;
use glam::DVec3;
use half::f16;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// How the values of a density cache are stored.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Serialize,
    Deserialize,
    strum::Display,
    strum::EnumMessage,
    strum::IntoStaticStr,
    strum::VariantArray,
)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum CacheFormat {
    /// 32 bits, as evaluated.
    F32,
    /// IEEE 754 binary16: relative error up to 2^-11, values up to 65504.
    F16,
    /// 8 bits between the smallest and the largest value: error up to 1/510 of that range.
    Unorm8,
}

/// How a density cache is read between its vertices.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Serialize,
    Deserialize,
    strum::Display,
    strum::EnumMessage,
    strum::IntoStaticStr,
    strum::VariantArray,
)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum CacheFilter {
    /// The value of the nearest vertex.
    Nearest,
    /// Linear along each axis, in f32: the filter of graphics hardware has 8 bits for its weights.
    Trilinear,
}

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

/// Positions per task when reading: a read takes some ten nanoseconds.
const READ_CHUNK: usize = 1 << 12;

/// The density at the vertices, before it is stored in a format.
pub struct Samples {
    cells: u32,
    size: [usize; 3],
    low: DVec3,
    step: DVec3,
    values: Vec<f32>,
    seconds: f64,
}

/// Values as they are stored; x runs fastest.
enum Texels {
    F32(Vec<f32>),
    /// Bits of binary16.
    F16(Vec<u16>),
    /// Parts of 255 of the range above its low end.
    Unorm8(Vec<u8>),
}

/// A density that is read instead of evaluated.
pub struct DensityCache {
    settings: CacheSettings,
    size: [usize; 3],
    low: [f32; 3],
    /// Vertices per object unit.
    scale: [f32; 3],
    /// Smallest and largest value, between which `unorm8` divides.
    range: [f32; 2],
    texels: Texels,
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
    /// Evaluates the density at the vertices; a grid beyond the memory is refused. The medium is not empty.
    pub fn bake(medium: &Medium, cells: u32, format: CacheFormat, progress: &(dyn Fn(f64) + Sync)) -> Result<Self> {
        let begin = std::time::Instant::now();
        let (size, step) = vertices_of(medium, cells);
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
        let low = medium.occupied.low;
        let mut values = Vec::with_capacity(count);
        for start in (0..count).step_by(BAKE_CHUNK) {
            let positions: Vec<[f32; 3]> = (start..count.min(start + BAKE_CHUNK))
                .map(|index| vertex(index, size, low, step).as_vec3().to_array())
                .collect();
            values.extend(medium.exact_densities(&positions)?);
            progress(values.len() as f64 / count as f64);
        }
        Ok(Self { cells, size, low, step, values, seconds: begin.elapsed().as_secs_f64() })
    }
}

impl CacheFormat {
    /// Bytes of a value.
    pub fn bytes(self) -> usize {
        match self {
            Self::F32 => 4,
            Self::F16 => 2,
            Self::Unorm8 => 1,
        }
    }
}

impl DensityCache {
    /// Stores samples in a format; values that it cannot hold are refused.
    pub fn new(samples: &Samples, format: CacheFormat, filter: CacheFilter) -> Result<Self> {
        let values = &samples.values;
        let low = values.iter().copied().fold(f32::INFINITY, f32::min);
        let high = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let most = match format {
            CacheFormat::F32 => f32::INFINITY,
            CacheFormat::F16 => f16::MAX.to_f32(),
            CacheFormat::Unorm8 => f32::MAX,
        };
        // f32 and f16 carry NaN into the picture, where it is seen; 8 bits have none.
        let nan = format == CacheFormat::Unorm8 && values.iter().any(|value| value.is_nan());
        if nan || high > most {
            return Err(Error::new(
                format!("density cache, format {}", format.name()),
                if nan { "NaN at a vertex".to_owned() } else { format!("a density of {high:e}") },
                format!("numbers up to {most:e}"),
                "Store the cache in f32, or correct the density (cloudparity eval shows it).",
            )
            .with_setting("cache_format"));
        }
        let parts = (high - low).max(0.0);
        let texels = match format {
            CacheFormat::F32 => Texels::F32(values.clone()),
            CacheFormat::F16 => Texels::F16(values.iter().map(|&value| f16::from_f32(value).to_bits()).collect()),
            CacheFormat::Unorm8 => Texels::Unorm8(
                values
                    .iter()
                    .map(|&value| if parts > 0.0 { ((value - low) / parts * 255.0).round() as u8 } else { 0 })
                    .collect(),
            ),
        };
        Ok(Self {
            settings: CacheSettings { cells: samples.cells, format, filter },
            size: samples.size,
            low: samples.low.as_vec3().to_array(),
            scale: (1.0 / samples.step).as_vec3().to_array(),
            range: [low, high],
            texels,
            bake_seconds: samples.seconds,
        })
    }

    /// Cached densities at object-space positions.
    pub fn densities(&self, positions: &[[f32; 3]]) -> Vec<f32> {
        positions.par_iter().with_min_len(READ_CHUNK).map(|&position| self.read(position)).collect()
    }

    /// The cached density at a position, which is clamped to the grid.
    fn read(&self, position: [f32; 3]) -> f32 {
        let place: [f32; 3] = std::array::from_fn(|axis| {
            ((position[axis] - self.low[axis]) * self.scale[axis]).clamp(0.0, (self.size[axis] - 1) as f32)
        });
        let [nx, ny, _] = self.size;
        if self.settings.filter == CacheFilter::Nearest {
            let [x, y, z] = place.map(|part| (part + 0.5) as usize);
            return self.texel((z * ny + y) * nx + x);
        }
        let base: [usize; 3] = std::array::from_fn(|axis| (place[axis] as usize).min(self.size[axis] - 2));
        let fraction: [f32; 3] = std::array::from_fn(|axis| place[axis] - base[axis] as f32);
        let mut value = 0.0;
        for corner in 0..8 {
            let up = [corner & 1, corner >> 1 & 1, corner >> 2];
            let weight: [f32; 3] =
                std::array::from_fn(|axis| if up[axis] == 1 { fraction[axis] } else { 1.0 - fraction[axis] });
            let index = ((base[2] + up[2]) * ny + base[1] + up[1]) * nx + base[0] + up[0];
            value += weight[0] * weight[1] * weight[2] * self.texel(index);
        }
        value
    }

    fn texel(&self, index: usize) -> f32 {
        match &self.texels {
            Texels::F32(values) => values[index],
            Texels::F16(values) => f16::from_bits(values[index]).to_f32(),
            Texels::Unorm8(values) => {
                let [low, high] = self.range;
                low + (high - low) * (f32::from(values[index]) / 255.0)
            }
        }
    }

    /// Measures the field error at points that are the same in every run.
    pub fn measure(&self, medium: &Medium) -> Result<CacheReport> {
        let extent = medium.occupied.high - medium.occupied.low;
        let mut random = ChaCha8Rng::seed_from_u64(0);
        let positions: Vec<[f32; 3]> = (0..POINTS)
            .map(|_| {
                let part = DVec3::from(std::array::from_fn(|_| random.random::<f64>()));
                (medium.occupied.low + extent * part).as_vec3().to_array()
            })
            .collect();
        let exact = medium.exact_densities(&positions)?;
        let cached = self.densities(&positions);
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

    /// What the kernel's instance is compiled with.
    pub(crate) fn definitions(&self) -> Vec<&'static str> {
        let mut definitions = Vec::new();
        match self.settings.format {
            CacheFormat::F32 => {}
            CacheFormat::F16 => definitions.push("CACHE_F16"),
            CacheFormat::Unorm8 => definitions.push("CACHE_UNORM8"),
        }
        if self.settings.filter == CacheFilter::Nearest {
            definitions.push("CACHE_NEAREST");
        }
        definitions
    }

    /// The stored values as the kernel reads them, filled up to whole words.
    pub(crate) fn words(&self) -> Vec<u8> {
        let mut bytes: Vec<u8> = match &self.texels {
            Texels::F32(values) => bytemuck::cast_slice(values).to_vec(),
            Texels::F16(values) => bytemuck::cast_slice(values).to_vec(),
            Texels::Unorm8(values) => values.clone(),
        };
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        bytes
    }

    /// Where the values lie: low corner and vertices per object unit, vertices per axis, range.
    pub(crate) fn layout(&self) -> ([f32; 3], [f32; 3], [u32; 3], [f32; 2]) {
        (self.low, self.scale, self.size.map(|count| count as u32), self.range)
    }
}

impl CacheFormat {
    /// The name in settings.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

impl CacheFilter {
    /// The name in settings.
    pub fn name(self) -> &'static str {
        self.into()
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
