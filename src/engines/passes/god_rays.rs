//! Rays of light as a radial blur of the picture of what hides the sun (after Mitchell 2007, "Volumetric Light Scattering as a
//! Post-Process", GPU Gems 3, with the weights of the published Perlin-FBM engine).
//!
//! A pixel sums `samples` reads on the way to the sun, the i-th of them with weight `weight` decay^i; the sum is multiplied by
//! `density`, `exposure` and the sun's colour. `density` does not shorten the way here, unlike in the book.

use serde::{Deserialize, Serialize};

/// How the blur is made.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GodRays {
    /// A factor on the result.
    pub density: f64,
    /// Weight of a read over that of the one before, 0 to 1.
    pub decay: f64,
    /// Weight of the first read.
    pub weight: f64,
    /// Another factor on the result.
    pub exposure: f64,
    /// Reads per pixel.
    pub samples: u32,
    /// Whether they stay as they are when the sun stands beside or behind the camera, where its point on the screen is a mirrored one;
    /// else they fade out before.
    pub from_behind: bool,
}

impl Default for GodRays {
    /// The published engine's.
    fn default() -> Self {
        Self { density: 0.96, decay: 0.95, weight: 0.5, exposure: 0.6, samples: 100, from_behind: false }
    }
}

/// A picture of three channels, top row first.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Row by row from the top.
    pub pixels: Vec<[f64; 3]>,
}

impl Layer {
    /// Bilinear read at texture coordinates, whose origin is the bottom-left corner; outside is the nearest pixel.
    pub fn sample(&self, [u, v]: [f64; 2]) -> [f64; 3] {
        let place = [u * self.width as f64 - 0.5, (1.0 - v) * self.height as f64 - 0.5];
        let sizes = [self.width, self.height];
        let ends: [[usize; 2]; 2] = std::array::from_fn(|axis| {
            let last = (sizes[axis] - 1) as f64;
            [0.0, 1.0].map(|step| (place[axis].floor() + step).clamp(0.0, last) as usize)
        });
        let [x, y] = place.map(|coordinate| coordinate - coordinate.floor());
        let at = |column: usize, row: usize| self.pixels[ends[1][row] * self.width + ends[0][column]];
        std::array::from_fn(|channel| {
            let along = |row: usize| at(0, row)[channel] * (1.0 - x) + at(1, row)[channel] * x;
            along(0) * (1.0 - y) + along(1) * y
        })
    }
}

impl GodRays {
    /// The rays that an occlusion picture makes, to be added to the frame. `sun` is the sun's place in device coordinates, -1 to 1
    /// from left to right and from bottom to top.
    pub fn render(&self, occlusion: &Layer, sun: [f64; 2], sun_colour: [f64; 3]) -> Layer {
        let towards = sun.map(|coordinate| (coordinate + 1.0) / 2.0);
        let pixels = (0..occlusion.pixels.len())
            .map(|index| {
                let (column, row) = (index % occlusion.width, index / occlusion.width);
                let place = [
                    (column as f64 + 0.5) / occlusion.width as f64,
                    1.0 - (row as f64 + 0.5) / occlusion.height as f64,
                ];
                let mut sum = [0.0; 3];
                let mut weight = self.weight;
                for number in 0..self.samples {
                    let part = f64::from(number) / f64::from(self.samples);
                    let read = occlusion
                        .sample(std::array::from_fn(|axis| place[axis] + part * (towards[axis] - place[axis])));
                    for channel in 0..3 {
                        sum[channel] += weight * read[channel];
                    }
                    weight *= self.decay;
                }
                std::array::from_fn(|channel| self.density * self.exposure * sun_colour[channel] * sum[channel])
            })
            .collect();
        Layer { width: occlusion.width, height: occlusion.height, pixels }
    }
}
