//! Light from around the scene: an equirectangular picture, or what the world's node graph sends.
//!
//! For a direction d: u = 1/2 - atan2(d_y, d_x) / 2 pi to the right, v = 1/2 + asin(d_z) / pi upwards; +X is in
//! the middle, the seam at -X, +Z above. Between the centres of pixels the picture is interpolated bilinearly,
//! and it repeats in both directions: above the top row follows the bottom row, as Cycles does (measured with
//! random pictures of 8 x 4 and 16 x 8 pixels: equal to 1.5e-5, the f32 rounding of the direction).
//!
//! Sampling chooses a cell between four pixel centres by its mean luminance times its solid angle, then a
//! direction uniform in solid angle within. The radiance of a picture is 0 wherever the density is.
//!
//! A graph is evaluated in every direction that is asked for. Only sampling goes by a picture of it, the means of
//! `TABLE_SUBPIXELS`^2 values per pixel: what is smaller than that, such as a star, is found by rays that do not
//! follow the picture, and counts in full there.

use crate::base::error::{Error, Result};
use crate::graph::Program;
use crate::graph::world::WorldValues;
use crate::scene::Scene;
use crate::scene::image::Image;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

/// Luminance of linear Rec. 709.
const LUMINANCE: [f64; 3] = [0.212_639, 0.715_169, 0.072_192];

/// Width and height of the picture by which a graph is sampled.
const TABLE: [usize; 2] = [1024, 512];
/// Values along a side of a pixel of that picture.
const TABLE_SUBPIXELS: usize = 4;

/// The picture with what sampling needs.
#[derive(Debug, Clone, PartialEq)]
pub struct Environment {
    width: usize,
    height: usize,
    /// Radiance in W/sr/m^2, row by row from the *bottom*.
    pixels: Vec<[f64; 3]>,
    /// For each band of cells, from the bottom, the running sum of its cells' weights; one more band than
    /// rows, because those at the poles are half as high.
    cells: Vec<Vec<f64>>,
    /// Running sum of the bands' weights.
    bands: Vec<f64>,
    /// What is seen in place of the picture, which sampling alone goes by then.
    values: Option<Arc<WorldValues>>,
}

impl Environment {
    /// Reads the picture that a scene names, or compiles the graph of its world; none if its world is constant.
    pub fn load(scene: &Scene) -> Result<Option<Self>> {
        if let Some(graph) = &scene.world.graph {
            return Ok(Some(Self::of_values(WorldValues::compile(graph)?)));
        }
        let Some(path) = scene.world_image_path() else { return Ok(None) };
        let image = Image::read_exr(&path)?;
        image.check_finite(&path.display().to_string())?;
        Self::new(&image, f64::from(scene.world.strength)).map(Some)
    }

    /// From a picture whose radiance is multiplied by `strength`.
    pub fn new(image: &Image, strength: f64) -> Result<Self> {
        let (width, height) = (image.width, image.height);
        if width == 0 || height == 0 {
            return Err(Error::new(
                "environment image",
                format!("{width} x {height} pixels"),
                "at least one pixel",
                "Choose another picture.",
            ));
        }
        let rows = image.pixels.chunks(width).rev().flatten();
        let pixels = rows.map(|pixel| std::array::from_fn(|channel| f64::from(pixel[channel]) * strength)).collect();
        Ok(Self::with_table([width, height], pixels))
    }

    /// What a graph sends. What is no number, or infinite, counts as 0, as in Cycles (measured with 5.0.1).
    pub fn of_values(values: WorldValues) -> Self {
        let [width, height] = TABLE;
        let [columns, rows] = TABLE.map(|side| side * TABLE_SUBPIXELS);
        let towards = |side: usize, sides: usize| (side as f64 + 0.5) / sides as f64;
        let row_of_pixels = |row: usize| {
            let mut pixels = vec![[0.0; 3]; width];
            for line in row * TABLE_SUBPIXELS..(row + 1) * TABLE_SUBPIXELS {
                let (sine, cosine) = (PI * (towards(line, rows) - 0.5)).sin_cos();
                let directions: Vec<DVec3> = (0..columns)
                    .map(|column| {
                        let (up, right) = (TAU * (0.5 - towards(column, columns))).sin_cos();
                        DVec3::new(cosine * right, cosine * up, sine)
                    })
                    .collect();
                values.radiance(&directions, |column, radiance| {
                    for (pixel, value) in pixels[column / TABLE_SUBPIXELS].iter_mut().zip(radiance) {
                        *pixel += value / (TABLE_SUBPIXELS * TABLE_SUBPIXELS) as f64;
                    }
                });
            }
            pixels
        };
        let pixels: Vec<[f64; 3]> = (0..height).into_par_iter().flat_map_iter(row_of_pixels).collect();
        Self { values: Some(Arc::new(values)), ..Self::with_table([width, height], pixels) }
    }

    fn with_table([width, height]: [usize; 2], pixels: Vec<[f64; 3]>) -> Self {
        let mut environment = Self { width, height, pixels, cells: Vec::new(), bands: Vec::new(), values: None };
        let mut total = 0.0;
        for band in 0..=height {
            let mut sum = 0.0;
            let cells: Vec<f64> = (0..width)
                .map(|column| {
                    sum += environment.weight(band, column);
                    sum
                })
                .collect();
            total += sum;
            environment.cells.push(cells);
            environment.bands.push(total);
        }
        environment
    }

    /// A pixel by column and row from the bottom; both repeat.
    fn pixel(&self, column: i64, row: i64) -> &[f64; 3] {
        let column = column.rem_euclid(self.width as i64) as usize;
        let row = row.rem_euclid(self.height as i64) as usize;
        &self.pixels[row * self.width + column]
    }

    /// Lower and upper sine of the latitude of a band of cells.
    fn sines(&self, band: usize) -> [f64; 2] {
        let height = self.height as f64;
        [band as f64 - 0.5, band as f64 + 0.5].map(|row| (PI * (row / height).clamp(0.0, 1.0) - FRAC_PI_2).sin())
    }

    /// Solid angle of a cell.
    fn solid_angle(&self, band: usize) -> f64 {
        let [low, high] = self.sines(band);
        (high - low) * TAU / self.width as f64
    }

    /// Mean luminance of a cell's corners times its solid angle. Cell (band, column) lies between the pixels of
    /// rows band - 1 and band, columns `column` and `column + 1`.
    fn weight(&self, band: usize, column: usize) -> f64 {
        let (row, column) = (band as i64, column as i64);
        let corners = [(column, row - 1), (column + 1, row - 1), (column, row), (column + 1, row)];
        let luminance: f64 = corners
            .iter()
            .map(|&(column, row)| {
                let pixel = self.pixel(column, row);
                // Negative radiance has to be found, too.
                (0..3).map(|channel| LUMINANCE[channel] * pixel[channel].abs()).sum::<f64>()
            })
            .sum();
        0.25 * luminance * self.solid_angle(band)
    }

    /// Place of a direction on the picture in pixels, from the centre of the pixel at the lower left.
    fn place(&self, direction: DVec3) -> [f64; 2] {
        let u = 0.5 - direction.y.atan2(direction.x) / TAU;
        let v = 0.5 + direction.z.atan2(direction.x.hypot(direction.y)) / PI;
        [u * self.width as f64 - 0.5, v * self.height as f64 - 0.5]
    }

    /// Radiance that arrives from a direction (a unit vector that points away from the scene).
    pub fn radiance(&self, direction: DVec3) -> [f64; 3] {
        if let Some(values) = &self.values {
            let mut found = [0.0; 3];
            values.radiance(&[direction], |_, radiance| found = radiance);
            return found;
        }
        let [x, y] = self.place(direction);
        let (column, row) = (x.floor(), y.floor());
        let (right, up) = (x - column, y - row);
        let (column, row) = (column as i64, row as i64);
        let [a, b] = [self.pixel(column, row), self.pixel(column + 1, row)];
        let [c, d] = [self.pixel(column, row + 1), self.pixel(column + 1, row + 1)];
        std::array::from_fn(|channel| {
            (1.0 - up) * ((1.0 - right) * a[channel] + right * b[channel])
                + up * ((1.0 - right) * c[channel] + right * d[channel])
        })
    }

    /// The program that gives what is seen, of a world of nodes.
    pub fn program(&self) -> Option<&Program> {
        self.values.as_ref().map(|values| values.program())
    }

    /// Whether nothing arrives from anywhere. Of a graph that is not known: something may lie between the places of its table.
    pub fn is_black(&self) -> bool {
        self.values.is_none() && self.total() == 0.0
    }

    /// Roughly the luminance that arrives from all directions together: the sum of the cells' luminance times their
    /// solid angle, the basis for choosing between the picture and lights.
    pub fn fluence(&self) -> f64 {
        self.total()
    }

    /// Mean radiance over all directions, the mean of each cell's corners standing for the cell: what light without a direction is.
    pub fn mean_radiance(&self) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for band in 0..=self.height {
            let share = self.solid_angle(band) / (4.0 * PI);
            for column in 0..self.width {
                let (row, column) = (band as i64, column as i64);
                for (column, row) in [(column, row - 1), (column + 1, row - 1), (column, row), (column + 1, row)] {
                    let pixel = self.pixel(column, row);
                    for channel in 0..3 {
                        sum[channel] += 0.25 * share * pixel[channel];
                    }
                }
            }
        }
        sum
    }

    fn total(&self) -> f64 {
        self.bands[self.height]
    }

    /// Density of [`Self::sample`] over solid angle, 1/sr; 0 for a black picture.
    pub fn density(&self, direction: DVec3) -> f64 {
        if self.total() == 0.0 {
            return 0.0;
        }
        let [x, y] = self.place(direction);
        let column = (x.floor() as i64).rem_euclid(self.width as i64) as usize;
        let band = ((y + 1.0).floor().max(0.0) as usize).min(self.height);
        self.weight(band, column) / (self.total() * self.solid_angle(band))
    }

    /// A direction for two numbers uniform in [0, 1), and its density; none for a black picture.
    pub fn sample(&self, uniform: [f64; 2]) -> Option<(DVec3, f64)> {
        if self.total() == 0.0 {
            return None;
        }
        let (band, up) = choose(&self.bands, uniform[0]);
        let (column, right) = choose(&self.cells[band], uniform[1]);
        let [low, high] = self.sines(band);
        let sine = low + up * (high - low);
        let longitude = TAU * (0.5 - (column as f64 + 0.5 + right) / self.width as f64);
        let cosine = (1.0 - sine * sine).max(0.0).sqrt();
        let density = self.weight(band, column) / (self.total() * self.solid_angle(band));
        Some((DVec3::new(cosine * longitude.cos(), cosine * longitude.sin(), sine), density))
    }
}

/// The entry that a number in [0, 1) falls into by running sums, and where within it, in [0, 1).
fn choose(sums: &[f64], uniform: f64) -> (usize, f64) {
    let target = uniform * sums[sums.len() - 1];
    let found = sums.partition_point(|&sum| sum <= target);
    // Rounding can lead behind the last entry that has a weight.
    let index = if found < sums.len() { found } else { sums.partition_point(|&sum| sum < sums[sums.len() - 1]) };
    let before = if index == 0 { 0.0 } else { sums[index - 1] };
    let within = (target - before) / (sums[index] - before);
    (index, within.clamp(0.0, 1.0 - f64::EPSILON))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng as _, SeedableRng as _};

    /// A dim picture with a bright pixel beside the seam and one at a pole, and a black region.
    fn picture() -> Environment {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let mut image = Image::new(16, 8);
        for (index, pixel) in image.pixels.iter_mut().enumerate() {
            let dark = (40..80).contains(&index);
            *pixel = std::array::from_fn(|_| if dark { 0.0 } else { 0.1 * random.random::<f32>() });
        }
        image.pixels[3 * 16 - 1] = [30.0, 20.0, 10.0, 1.0];
        image.pixels[5] = [5.0, 9.0, 3.0, 1.0];
        Environment::new(&image, 2.0).expect("a legal picture")
    }

    /// Sum over directions of equal solid angle, in cells much finer than the pixels.
    fn quadrature<const C: usize>(function: impl Fn(DVec3) -> [f64; C]) -> [f64; C] {
        let (bands, columns) = (1200, 1600);
        let mut sum = [0.0; C];
        for band in 0..bands {
            let z = -1.0 + 2.0 * (f64::from(band) + 0.5) / f64::from(bands);
            for column in 0..columns {
                let longitude = TAU * (f64::from(column) + 0.5) / f64::from(columns);
                let flat = (1.0 - z * z).sqrt();
                let value = function(DVec3::new(flat * longitude.cos(), flat * longitude.sin(), z));
                for (sum, value) in sum.iter_mut().zip(value) {
                    *sum += value * 4.0 * PI / f64::from(bands * columns);
                }
            }
        }
        sum
    }

    #[test]
    fn pixels_lie_where_cycles_has_them() {
        // The values of a picture whose pixels are their own numbers, at pixel centres.
        let mut image = Image::new(8, 4);
        for (index, pixel) in image.pixels.iter_mut().enumerate() {
            *pixel = [index as f32, 0.0, 0.0, 1.0];
        }
        let environment = Environment::new(&image, 1.0).expect("a legal picture");
        let at = |u: f64, v: f64| {
            let (longitude, latitude) = (TAU * (0.5 - u), PI * (v - 0.5));
            environment.radiance(DVec3::new(
                latitude.cos() * longitude.cos(),
                latitude.cos() * longitude.sin(),
                latitude.sin(),
            ))[0]
        };
        for (row, column) in [(0, 0), (0, 7), (2, 3), (3, 7)] {
            let (u, v) = ((f64::from(column) + 0.5) / 8.0, 1.0 - (f64::from(row) + 0.5) / 4.0);
            assert!((at(u, v) - f64::from(8 * row + column)).abs() < 1e-9);
        }
        // Across the seam, and across the pole to the bottom row.
        assert!((at(0.0, 1.0 - 0.5 / 4.0) - 3.5).abs() < 1e-9);
        let near_pole = at(0.5 / 8.0, 1.0 - 1e-9);
        assert!((near_pole - 12.0).abs() < 1e-6, "{near_pole}: the mean of rows 0 and 3");
    }

    #[test]
    fn the_density_integrates_to_one() {
        let environment = picture();
        let [integral] = quadrature(|direction| [environment.density(direction)]);
        // Midpoint cells that straddle an edge of the density err by up to a whole cell: 34 edges of
        // 2400 half-cells in all, weighted by the share of the bright ones.
        assert!((integral - 1.0).abs() < 5e-3, "{integral}");
    }

    #[test]
    fn samples_find_what_the_quadrature_finds() {
        let environment = picture();
        let found = quadrature(|direction| environment.radiance(direction));
        let side = 600;
        let mut sums = [0.0; 3];
        let mut squares = [0.0; 3];
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(11);
        for index in 0..side * side {
            let uniform =
                [index / side, index % side].map(|place| (f64::from(place) + random.random::<f64>()) / f64::from(side));
            let (direction, density) = environment.sample(uniform).expect("the picture is not black");
            assert!((direction.length() - 1.0).abs() < 1e-12);
            let again = environment.density(direction);
            // Within rounding of an edge the neighbour's density may come back.
            assert!((again / density - 1.0).abs() < 1e-9 || again > 0.0);
            let radiance = environment.radiance(direction);
            for channel in 0..3 {
                sums[channel] += radiance[channel] / density;
                squares[channel] += (radiance[channel] / density).powi(2);
            }
        }
        let count = f64::from(side * side);
        for channel in 0..3 {
            let mean = sums[channel] / count;
            let error = ((squares[channel] / count - mean * mean) / count).sqrt();
            // The quadrature of a continuous function errs by 1e-4 of it at this fineness; stratified samples
            // have less than the standard error of independent ones.
            let tolerance = 4.0 * error + 1e-4 * mean;
            assert!((mean - found[channel]).abs() < tolerance, "{mean} is not {} +- {error}", found[channel]);
            assert!(error < 2e-3 * mean, "too noisy to tell");
        }
    }

    #[test]
    fn a_black_picture_has_no_samples() {
        let environment = Environment::new(&Image::new(4, 2), 1.0).expect("a legal picture");
        assert!(environment.is_black() && environment.sample([0.5, 0.5]).is_none());
        assert_eq!(environment.density(DVec3::Z), 0.0);
    }
}
