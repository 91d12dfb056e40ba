//! What published clouds' textures hold.
//!
//! - `BEST_NOISE`: 32 x 32 x 36 texels of tiling Perlin-Worley noise. The original's generator is not published: this is the Perlin-Worley
//!   noise of `bolt` made periodic, four cells to a period.
//! - `TAKRAM_SHAPE` (128^3), `TAKRAM_DETAIL` (32^3), `TAKRAM_WEATHER_*` (512^2) and `TAKRAM_TURBULENCE_*` (128^2, components of a unit curl
//!   as 0.5 + 0.5 c): the procedural textures of @takram/three-clouds, after their formulas. Its pre-made files differ from these texel by
//!   texel, and so do its own shaders from machine to machine, since they hash by the sine of large numbers.

use crate::base::arrays::{Mapped, each};
use crate::base::interpolation::smooth;
use crate::base::texture::{Outside, Texels, Texture, TextureFilter, TextureHandle};
use crate::nodes::hash::pcg_values;
use crate::nodes::perlin_fbm::noise::{fade, lerp};
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::{LazyLock, Mutex, PoisonError};

/// An enumeration whose names are those of a node's property.
macro_rules! named {
    ($(#[$about:meta])* $name:ident { $($(#[$of:meta])* $variant:ident = $text:literal,)* }) => {
        $(#[$about])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum $name { $($(#[$of])* $variant,)* }

        impl $name {
            /// All names.
            pub const NAMES: &[&str] = &[$($text),*];

            /// Its name.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $text,)*
                }
            }

            /// By its name, which the node's property has checked.
            pub fn of_name(name: &str) -> Self {
                match name {
                    $($text => Self::$variant,)*
                    _ => unreachable!("the property knows its choices"),
                }
            }
        }
    };
}

named! {
    /// A texture.
    CloudTexture {
        /// Of `best`.
        BestNoise = "BEST_NOISE",
        /// Of `takram`, 3-D.
        TakramShape = "TAKRAM_SHAPE",
        /// Of `takram`, 3-D.
        TakramDetail = "TAKRAM_DETAIL",
        /// Of `takram`: low clouds.
        TakramWeatherR = "TAKRAM_WEATHER_R",
        /// Of `takram`: clouds of the second layer.
        TakramWeatherG = "TAKRAM_WEATHER_G",
        /// Of `takram`: high clouds.
        TakramWeatherB = "TAKRAM_WEATHER_B",
        /// Of `takram`: x of the turbulence.
        TakramTurbulenceX = "TAKRAM_TURBULENCE_X",
        /// Its y.
        TakramTurbulenceY = "TAKRAM_TURBULENCE_Y",
        /// Its z.
        TakramTurbulenceZ = "TAKRAM_TURBULENCE_Z",
    }
}

named! {
    /// Where `takram`'s cellular noise has its feature points.
    FeaturePoints {
        /// Anywhere in their cells.
        Even = "EVEN",
        /// On the diagonals of their cells: one number for all coordinates (defect TK-7).
        Diagonal = "DIAGONAL",
    }
}

/// A texture, made where nobody has asked for it before.
pub fn texture(texture: CloudTexture, points: FeaturePoints) -> TextureHandle {
    static MADE: LazyLock<Mutex<HashMap<(CloudTexture, FeaturePoints), TextureHandle>>> = LazyLock::new(Mutex::default);
    // What does not read the points is the same for both.
    let points = match texture {
        CloudTexture::BestNoise
        | CloudTexture::TakramWeatherB
        | CloudTexture::TakramTurbulenceX
        | CloudTexture::TakramTurbulenceY
        | CloudTexture::TakramTurbulenceZ => FeaturePoints::Even,
        _ => points,
    };
    let made = || MADE.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = made().get(&(texture, points)) {
        return known.clone();
    }
    // Not under the lock: a bake runs on the thread pool, whose threads may wait for this very lock. Two that ask at once may both bake it.
    let baked = bake(texture, points);
    made().entry((texture, points)).or_insert(baked).clone()
}

fn bake(texture: CloudTexture, points: FeaturePoints) -> TextureHandle {
    match texture {
        CloudTexture::BestNoise => best_noise(),
        CloudTexture::TakramShape => takram_shape(points),
        CloudTexture::TakramDetail => takram_detail(points),
        CloudTexture::TakramWeatherR => {
            let [low, high] = [16, 8].map(|cells| Spots::new(cells, points));
            takram_flat(512, |p| (smooth(0.8, 1.4, low.at(p)) - second_layer(&high, p)).clamp(0.0, 1.0))
        }
        CloudTexture::TakramWeatherG => {
            let spots = Spots::new(8, points);
            takram_flat(512, |p| second_layer(&spots, p))
        }
        CloudTexture::TakramWeatherB => takram_flat(512, |p| smooth(-0.5, 0.5, perlin_octaves(p, [6, 12, 1], 8))),
        CloudTexture::TakramTurbulenceX => takram_flat(128, |p| 0.5 + 0.5 * curl(p)[0]),
        CloudTexture::TakramTurbulenceY => takram_flat(128, |p| 0.5 + 0.5 * curl(p)[1]),
        CloudTexture::TakramTurbulenceZ => takram_flat(128, |p| 0.5 + 0.5 * curl(p)[2]),
    }
}

/// Texels from values in [0, 1], on all cores.
fn bytes(size: [usize; 3], value: impl Fn([f64; 3]) -> f64 + Sync) -> TextureHandle {
    let [x, y, z] = size;
    let texel = |index: usize| {
        let place = [index % x, index / x % y, index / (x * y)].mapped(|number| number as f64);
        (value(place).clamp(0.0, 1.0) * 255.0).round() as u8
    };
    let bytes: Vec<u8> = (0..x * y * z).into_par_iter().with_min_len(1024).map(texel).collect();
    let texels = Texels::Unorm8 { bytes: bytes.into(), range: [0.0, 1.0] };
    TextureHandle::new(Texture::new(size, texels, TextureFilter::Trilinear, Outside::Repeat))
}

/// Interpolates eight numbers, x first.
fn between(corners: [f64; 8], [x, y, z]: [f64; 3]) -> f64 {
    let [low, high] = [0, 4].mapped(|begin| {
        let row = |first: usize| lerp(x, corners[first], corners[first + 1]);
        lerp(y, row(begin), row(begin + 2))
    });
    lerp(z, low, high)
}

/// The corner of a cell by its number: x in the lowest bit.
fn corner_of(index: usize) -> [i32; 3] {
    [0, 1, 2].mapped(|axis| (index >> axis & 1) as i32)
}

/// Least squared distance from a place, in cells, to the feature points of the cells around.
fn nearest(place: [f64; 3], point: impl Fn([i32; 3]) -> [f64; 3]) -> f64 {
    let cell = place.mapped(|coordinate| coordinate.floor() as i32);
    // Squares of what separates the place from the cells around it. A point's own differences are roundings of numbers that are at
    // least as large, and rounding keeps the order, as squares and sums do: no cell that is left out has a nearer point, to the bit.
    let square = |difference: f64| difference * difference;
    let apart: [[f64; 3]; 3] = each(|axis| {
        let low = f64::from(cell[axis]);
        [square(low - place[axis]), 0.0, square(low + 1.0 - place[axis])]
    });
    let mut least = f64::INFINITY;
    // The cell itself first, before those below and above it.
    for z in [1, 0, 2] {
        for y in [1, 0, 2] {
            for x in [1, 0, 2] {
                if apart[0][x] + apart[1][y] + apart[2][z] >= least {
                    continue;
                }
                let around = [x, y, z];
                let at: [i32; 3] = each(|axis| cell[axis] + around[axis] as i32 - 1);
                let offset = point(at);
                let along = |axis: usize| square(f64::from(at[axis]) + offset[axis] - place[axis]);
                least = least.min(along(0) + along(1) + along(2));
            }
        }
    }
    least
}

/// Gradient noise and inverted cells of `bolt`, of four cells to a period.
fn best_noise() -> TextureHandle {
    const SIZE: [usize; 3] = [32, 32, 36];
    const CELLS: i32 = 4;
    let gradient_noise = |place: [f64; 3]| {
        let cell = place.mapped(|coordinate| coordinate.floor() as i32);
        let part: [f64; 3] = each(|axis| place[axis] - f64::from(cell[axis]));
        let corners = each(|index| {
            let corner = corner_of(index);
            let at: [i32; 3] = each(|axis| (cell[axis] + corner[axis]).rem_euclid(CELLS));
            let direction = pcg_values::<f64, 3>(at).mapped(|value| 2.0 * value - 1.0);
            let length = direction.iter().map(|part| part * part).sum::<f64>().sqrt();
            let along = |axis: usize| direction[axis] * (part[axis] - f64::from(corner[axis]));
            (along(0) + along(1) + along(2)) / length
        });
        between(corners, part.mapped(fade))
    };
    let cells = |place: [f64; 3], factor: i32| {
        let period = CELLS * factor;
        let place = place.mapped(|coordinate| coordinate * f64::from(factor));
        1.0 - nearest(place, |cell| pcg_values(cell.mapped(|number| number.rem_euclid(period)))).min(1.0).sqrt()
    };
    bytes(SIZE, |texel| {
        let place: [f64; 3] = each(|axis| (texel[axis] + 0.5) / SIZE[axis] as f64 * f64::from(CELLS));
        let worley = 0.625 * cells(place, 2) + 0.375 * cells(place, 8);
        worley + (0.5 + 0.5 * gradient_noise(place)) * (1.0 - worley)
    })
}

/// `takram`'s cellular noise of n cells to a period.
struct Cells {
    count: i32,
    /// Feature points of all cells, x fastest.
    points: Vec<[f32; 3]>,
}

impl Cells {
    fn new(count: i32, kind: FeaturePoints) -> Self {
        let side = count as usize;
        let point = |index: usize| {
            let cell = [index % side, index / side % side, index / (side * side)].mapped(|number| number as i32);
            match kind {
                FeaturePoints::Even => pcg_values::<f32, 3>(cell),
                FeaturePoints::Diagonal => {
                    let number = f64::from(cell[0]) + 57.0 * f64::from(cell[1]) + 113.0 * f64::from(cell[2]);
                    let large = 43758.5453 * (number + 1.951).sin();
                    [(large - large.floor()) as f32; 3]
                }
            }
        };
        Self { count, points: (0..side.pow(3)).into_par_iter().with_min_len(1024).map(point).collect() }
    }

    /// 1 minus the squared distance to the nearest feature point, at most 1, at a place in periods.
    fn at(&self, place: [f64; 3]) -> f64 {
        let side = self.count as usize;
        let found = nearest(place.mapped(|coordinate| coordinate * f64::from(self.count)), |cell| {
            let [x, y, z] = cell.mapped(|number| number.rem_euclid(self.count) as usize);
            self.points[(z * side + y) * side + x].mapped(f64::from)
        });
        1.0 - found.min(1.0)
    }
}

/// Weights of three sizes of cells.
fn three(a: f64, b: f64, c: f64) -> f64 {
    0.625 * a + 0.25 * b + 0.125 * c
}

/// Three sums of sizes in the ratio 1, 2, 4, 8.
fn finer([a, b, c, d]: [f64; 4]) -> f64 {
    three(three(a, b, c), three(b, c, d), 0.75 * c + 0.25 * d)
}

fn takram_shape(points: FeaturePoints) -> TextureHandle {
    let [c8, c16, c32, c56, c64] = [8, 16, 32, 56, 64].map(|count| Cells::new(count, points));
    bytes([128; 3], |texel| {
        // As published: half a texel in the plane, none along the slices.
        let p = [(texel[0] + 0.5) / 128.0, (texel[1] + 0.5) / 128.0, texel[2] / 128.0];
        let [w8, w16, w32, w56, w64] = [&c8, &c16, &c32, &c56, &c64].mapped(|cells| cells.at(p));
        let coarse = three(w8, w32, w56);
        let both = coarse + perlin_octaves(p, [8; 3], 3).clamp(0.0, 1.0) * (1.0 - coarse);
        let fine = finer([w8, w16, w32, w64]);
        (both - fine + 1.0) / (2.0 - fine)
    })
}

fn takram_detail(points: FeaturePoints) -> TextureHandle {
    let cells = [2, 4, 8, 16].map(|count| Cells::new(count, points));
    bytes([32; 3], |texel| {
        let p = [(texel[0] + 0.5) / 32.0, (texel[1] + 0.5) / 32.0, texel[2] / 32.0];
        finer(each(|number| cells[number].at(p)))
    })
}

/// A texture over (u, v, 0).
fn takram_flat(side: usize, value: impl Fn([f64; 3]) -> f64 + Sync) -> TextureHandle {
    let part = |number: f64| (number + 0.5) / side as f64;
    bytes([side, side, 1], |texel| value([part(texel[0]), part(texel[1]), 0.0]))
}

/// Four sizes of cells, each twice as many as the one before.
struct Spots([Cells; 4]);

impl Spots {
    fn new(cells: i32, points: FeaturePoints) -> Self {
        Self([1, 2, 4, 8].map(|factor| Cells::new(cells * factor, points)))
    }

    fn at(&self, place: [f64; 3]) -> f64 {
        self.0.iter().enumerate().map(|(octave, cells)| 0.4 * 0.95_f64.powi(octave as i32) * cells.at(place)).sum()
    }
}

fn second_layer(spots: &Spots, place: [f64; 3]) -> f64 {
    smooth(1.0, 1.4, spots.at(place.mapped(|coordinate| coordinate + 0.5)))
}

/// Perlin's classic noise in four dimensions at w = 0, periodic (Gustavson, with the permutation polynomial 34 x^2 + x modulo 289): in
/// about [-1, 1].
struct Perlin {
    /// The polynomial of a sum of two numbers below 289.
    permuted: [usize; 578],
    /// The gradient's first three components by the number of its lattice point.
    gradients: [[f64; 3]; 289],
}

static PERLIN: LazyLock<Perlin> =
    LazyLock::new(|| Perlin { permuted: each(|x| (34 * x + 1) * x % 289), gradients: each(perlin_gradient) });

fn perlin_gradient(number: usize) -> [f64; 3] {
    let fraction = |x: f64| x - x.floor();
    let x = number as f64 / 7.0;
    let y = x.floor() / 7.0;
    let z = y.floor() / 6.0;
    let mut direction = [x, y, z].mapped(|coordinate| fraction(coordinate) - 0.5);
    let w = 0.75 - direction.iter().map(|coordinate| coordinate.abs()).sum::<f64>();
    if w <= 0.0 {
        for coordinate in direction.iter_mut().take(2) {
            *coordinate -= if *coordinate >= 0.0 { 0.5 } else { -0.5 };
        }
    }
    let length = (direction.iter().map(|part| part * part).sum::<f64>() + w * w).sqrt();
    direction.mapped(|part| part / length)
}

impl Perlin {
    /// The noise at a place in cells, of so many cells to a period.
    fn at(&self, place: [f64; 3], period: [i64; 3]) -> f64 {
        let floors = place.mapped(f64::floor);
        let part: [f64; 3] = each(|axis| place[axis] - floors[axis]);
        // Along each axis the cells of the two lattice points.
        let cells: [[usize; 2]; 3] =
            each(|axis| [0, 1].mapped(|step| ((floors[axis] as i64 + step).rem_euclid(period[axis]) % 289) as usize));
        let corners = each(|index| {
            let corner = corner_of(index);
            let cell = |axis: usize| cells[axis][corner[axis] as usize];
            let number = (0..3).fold(0, |number, axis| self.permuted[number + cell(axis)]);
            let gradient = self.gradients[self.permuted[number]];
            let along = |axis: usize| gradient[axis] * (part[axis] - f64::from(corner[axis]));
            along(0) + along(1) + along(2)
        });
        2.2 * between(corners, part.mapped(fade))
    }
}

/// Octaves of it at `frequency` times a place in periods, each twice as fine and half as strong, divided by the sum of weights.
fn perlin_octaves(place: [f64; 3], frequency: [i64; 3], octaves: u32) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for octave in 0..octaves {
        let weight = 0.5_f64.powi(octave as i32);
        let period = frequency.mapped(|frequency| frequency << octave);
        sum += weight * PERLIN.at(each(|axis| place[axis] * period[axis] as f64), period);
        weights += weight;
    }
    sum / weights
}

/// The curl of three noises, as a unit vector; 0 where they have none.
fn curl(place: [f64; 3]) -> [f64; 3] {
    const STEP: f64 = 0.1;
    let field = |[x, y, z]: [f64; 3]| {
        let at = |p: [f64; 3]| perlin_octaves(p, [12; 3], 3);
        [at([x, y, z]), at([y - 19.1, z + 33.4, x + 47.2]), at([z + 74.2, x - 124.5, y + 99.4])]
    };
    let change = |axis: usize| {
        let [mut low, mut high] = [place; 2];
        low[axis] -= STEP;
        high[axis] += STEP;
        let [low, high] = [low, high].mapped(field);
        std::array::from_fn::<f64, 3, _>(|component| high[component] - low[component])
    };
    let [by_x, by_y, by_z] = [0, 1, 2].mapped(change);
    let found = [by_y[2] - by_z[1], by_z[0] - by_x[2], by_x[1] - by_y[0]];
    let length = found.iter().map(|part| part * part).sum::<f64>().sqrt();
    if length > 0.0 { found.mapped(|part| part / length) } else { found }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean and standard deviation of a texture's bytes.
    fn statistics(kind: CloudTexture, points: FeaturePoints) -> [f64; 2] {
        let made = texture(kind, points);
        let Texels::Unorm8 { bytes, .. } = made.texels() else { panic!("textures are bytes") };
        let count = bytes.len() as f64;
        let mean = bytes.iter().map(|&byte| f64::from(byte)).sum::<f64>() / count;
        let variance = bytes.iter().map(|&byte| (f64::from(byte) - mean).powi(2)).sum::<f64>() / count;
        [mean, variance.sqrt()]
    }

    /// The noise repeats exactly, and between neighbours of a period's ends it changes as anywhere.
    #[test]
    fn textures_tile() {
        for place in [[0.2, 3.7, 7.9], [7.99, 0.01, 4.4]] {
            let there = PERLIN.at(place, [8; 3]);
            for axis in 0..3 {
                let mut beyond = place;
                beyond[axis] += 8.0;
                assert!((PERLIN.at(beyond, [8; 3]) - there).abs() < 1e-9);
            }
        }
        for points in [FeaturePoints::Even, FeaturePoints::Diagonal] {
            let cells = Cells::new(8, points);
            let [a, b] = [[0.1, 0.999, 0.4], [1.1, -0.001, 2.4]].map(|place| cells.at(place));
            assert!((a - b).abs() < 1e-9);
        }
    }

    /// Values of the formulas in the specification's chapter 6.5: the pre-made shape has a mean of 203 of 255 and its detail 182, where the
    /// formula in single or double precision gives 179 to 182.
    #[test]
    fn takrams_textures_have_the_published_statistics() {
        let [mean, deviation] = statistics(CloudTexture::TakramDetail, FeaturePoints::Diagonal);
        assert!((179.0..=183.0).contains(&mean) && (20.0..=30.0).contains(&deviation), "{mean} {deviation}");
        let [mean, deviation] = statistics(CloudTexture::TakramShape, FeaturePoints::Diagonal);
        assert!((195.0..=210.0).contains(&mean) && (15.0..=25.0).contains(&deviation), "{mean} {deviation}");
    }
}
