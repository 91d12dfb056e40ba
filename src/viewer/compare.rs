//! Two pictures: what one differs by from the other, and both on a screen.

use crate::base::choice::choice;
use crate::base::display_table::DisplayTable;
use crate::scene::image::Image;
use rayon::prelude::*;
use std::sync::Arc;

/// Part of the mean of the truth below which a difference is not taken relative to the pixel: that of `cloudparity diff`.
const RELATIVE_EPSILON: f64 = 0.01;

/// Error of a picture against replicas of the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Statistics {
    /// relMSE against the mean of the replicas: the mean over pixels and channels of d^2 / (t^2 + e^2), with the difference d, the truth t
    /// and e = 1 % of its mean. The truth's noise is in it.
    pub relmse: f64,
    /// What noise of the truth alone is expected to add: the variance of the mean of the replicas in the place of d^2.
    pub noise: f64,
    /// Standard error of relMSE without the noise: jackknife over the replicas.
    pub standard_error: f64,
}

impl Statistics {
    /// Of a picture against at least two replicas of equal weight and its size; none where there are fewer, and where the truth is black.
    pub fn of(ours: &Image, truth: &[Image]) -> Option<Self> {
        let count = truth.len();
        if count < 2 || truth.iter().any(|image| image.pixels.len() != ours.pixels.len()) {
            return None;
        }
        let (relmse, noise) = without(ours, truth, None)?;
        let others: Option<Vec<f64>> =
            (0..count).map(|left_out| without(ours, truth, Some(left_out)).map(|(all, noise)| all - noise)).collect();
        let standard_error = match others {
            // The variance of a mean needs two.
            Some(others) if count > 2 => {
                let mean = others.iter().sum::<f64>() / count as f64;
                let squares: f64 = others.iter().map(|other| (other - mean).powi(2)).sum();
                (squares * (count - 1) as f64 / count as f64).sqrt()
            }
            _ => f64::NAN,
        };
        Some(Self { relmse, noise, standard_error })
    }

    /// relMSE without the noise of the truth; may be a little below 0.
    pub fn error(&self) -> f64 {
        self.relmse - self.noise
    }
}

/// relMSE and its part by noise, with one of the replicas left out.
fn without(ours: &Image, truth: &[Image], left_out: Option<usize>) -> Option<(f64, f64)> {
    let used: Vec<&Image> =
        truth.iter().enumerate().filter(|(number, _)| Some(*number) != left_out).map(|(_, image)| image).collect();
    let count = used.len() as f64;
    let values = 3.0 * ours.pixels.len() as f64;
    let mean = used.iter().map(|image| image.mean()[..3].iter().sum::<f64>()).sum::<f64>() / (3.0 * count);
    let floor = (RELATIVE_EPSILON * mean.abs()).powi(2);
    if floor == 0.0 {
        return None;
    }
    let (error, noise) = (0..ours.pixels.len())
        .into_par_iter()
        .with_min_len(4096)
        .map(|pixel| {
            let mut sums = (0.0, 0.0);
            for channel in 0..3 {
                let at = |image: &&Image| f64::from(image.pixels[pixel][channel]);
                let truth = used.iter().map(at).sum::<f64>() / count;
                let squares: f64 = used.iter().map(|image| (at(image) - truth).powi(2)).sum();
                let scale = truth * truth + floor;
                sums.0 += (f64::from(ours.pixels[pixel][channel]) - truth).powi(2) / scale;
                // Of one replica nothing is known.
                sums.1 += if count > 1.0 { squares / (count - 1.0) / count / scale } else { f64::NAN };
            }
            sums
        })
        .reduce(|| (0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    Some((error / values, noise / values))
}

choice! {
    "kebab-case",
    /// What is on the screen.
    pub enum Mode {
        /// The engine's picture.
        Engine,
        /// The truth.
        Truth,
        /// The engine's left of the truth.
        SideBySide,
        /// The engine's left of a line, the truth right of it.
        Wipe,
        /// One after the other.
        Flip,
        /// Their difference in luminance over the truth's: blue where the engine is darker, red where it is brighter.
        Difference,
    }
}

impl Mode {
    /// All of them with their titles.
    pub const ALL: [(Self, &'static str); 6] = [
        (Self::Engine, "Engine"),
        (Self::Truth, "Truth"),
        (Self::SideBySide, "Side by side"),
        (Self::Wipe, "Wipe"),
        (Self::Flip, "Flip"),
        (Self::Difference, "Difference"),
    ];
}

/// Relative difference that has full colour.
pub const FULL_DIFFERENCE: f64 = 0.25;

/// A picture on a screen: pixels of sRGB, row by row from the top.
pub struct Screen {
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Red, green and blue.
    pub pixels: Vec<[u8; 3]>,
}

/// How linear colours become those of the screen.
#[derive(Debug, Clone)]
pub struct Curve {
    colours: Colours,
    factor: f32,
}

#[derive(Debug, Clone)]
enum Colours {
    /// Display values by the square root of linear ones up to 1.
    Standard(Vec<u8>),
    DisplayTable(Arc<DisplayTable>),
}

/// Values of the table; between two of them lies less than half a display value but in the last few of darkness.
const TABLE: usize = 4096;

impl Curve {
    /// The curve of sRGB (IEC 61966-2-1) after an exposure in stops: Blender's view transform Standard.
    pub fn standard(stops: f64) -> Self {
        let encoded = |index: usize| {
            let linear = (index as f64 / (TABLE - 1) as f64).powi(2);
            let value = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
            (value * 255.0).round() as u8
        };
        Self { colours: Colours::Standard((0..TABLE).map(encoded).collect()), factor: stops.exp2() as f32 }
    }

    /// Another view transform, after an exposure in stops.
    pub fn of(cube: Arc<DisplayTable>, stops: f64) -> Self {
        Self { colours: Colours::DisplayTable(cube), factor: stops.exp2() as f32 }
    }

    /// A colour. What is no number is black.
    pub fn shown(&self, color: [f32; 4]) -> [u8; 3] {
        let [red, green, blue, _] = color.map(|value| value * self.factor);
        match &self.colours {
            Colours::Standard(table) => [red, green, blue].map(|linear| {
                let root = if linear.is_nan() { 0.0 } else { linear.clamp(0.0, 1.0).sqrt() };
                table[(root * (TABLE - 1) as f32).round() as usize]
            }),
            Colours::DisplayTable(cube) => cube.shown([red, green, blue]).map(|value| (255.0 * value + 0.5) as u8),
        }
    }
}

/// Composes what is seen; `wipe` is the part of the width that is the engine's. A truth of another size, or none, is not shown.
pub fn screen(mode: Mode, ours: &Image, truth: Option<&Image>, wipe: f64, curve: &Curve) -> Screen {
    let (width, height) = (ours.width, ours.height);
    let truth = truth.filter(|truth| (truth.width, truth.height) == (width, height));
    let Some(truth) = truth.filter(|_| mode != Mode::Engine) else {
        return Screen { width, height, pixels: ours.pixels.par_iter().map(|&pixel| curve.shown(pixel)).collect() };
    };
    let split = match mode {
        Mode::Wipe => (wipe.clamp(0.0, 1.0) * width as f64).round() as usize,
        _ => 0,
    };
    let wide = if mode == Mode::SideBySide { 2 * width } else { width };
    let floor = RELATIVE_EPSILON * luminance(truth.mean().map(|value| value as f32));
    let pixel = |index: usize| {
        let (column, row) = (index % wide, index / wide);
        let at = |image: &Image, column: usize| image.pixels[row * width + column];
        match mode {
            Mode::SideBySide if column < width => curve.shown(at(ours, column)),
            Mode::SideBySide => curve.shown(at(truth, column - width)),
            Mode::Difference => {
                let [ours, truth] = [ours, truth].map(|image| luminance(at(image, column)));
                diverging((ours - truth) / (truth.abs() + floor.abs()).max(f64::MIN_POSITIVE) / FULL_DIFFERENCE)
            }
            // A line between the two.
            Mode::Wipe if column == split => [255, 176, 32],
            Mode::Wipe if column < split => curve.shown(at(ours, column)),
            _ => curve.shown(at(truth, column)),
        }
    };
    Screen { width: wide, height, pixels: (0..wide * height).into_par_iter().map(pixel).collect() }
}

/// Of Rec. 709.
fn luminance(color: [f32; 4]) -> f64 {
    0.2126 * f64::from(color[0]) + 0.7152 * f64::from(color[1]) + 0.0722 * f64::from(color[2])
}

/// Dark grey at 0, blue at -1, red at 1.
fn diverging(value: f64) -> [u8; 3] {
    let value = if value.is_nan() { 0.0 } else { value.clamp(-1.0, 1.0) };
    const MIDDLE: [f64; 3] = [36.0, 38.0, 42.0];
    let end = if value < 0.0 { [64.0, 150.0, 255.0] } else { [255.0, 84.0, 56.0] };
    std::array::from_fn(|channel| (MIDDLE[channel] + (end[channel] - MIDDLE[channel]) * value.abs()).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(values: &[[f32; 3]]) -> Image {
        let mut image = Image::new(values.len(), 1);
        for (pixel, value) in image.pixels.iter_mut().zip(values) {
            *pixel = [value[0], value[1], value[2], 1.0];
        }
        image
    }

    /// By hand: truth 1 and 3 of mean 2, ours 2 everywhere in two pixels.
    #[test]
    fn an_error_known_by_hand() {
        let truth = [image(&[[0.9; 3], [2.9; 3]]), image(&[[1.1; 3], [3.1; 3]])];
        let found = Statistics::of(&image(&[[2.0; 3]; 2]), &truth).expect("an error");
        let floor = 0.02_f64.powi(2);
        let relmse = (1.0 / (1.0 + floor) + 1.0 / (9.0 + floor)) / 2.0;
        // The variance of the mean of 0.9 and 1.1 is 0.02 / 2.
        let noise = (0.01 / (1.0 + floor) + 0.01 / (9.0 + floor)) / 2.0;
        assert!((found.relmse - relmse).abs() < 1e-6 && (found.noise - noise).abs() < 1e-6, "{found:?}");
        assert!(found.standard_error.is_nan(), "two replicas give it none");
        assert_eq!(Statistics::of(&image(&[[2.0; 3]; 2]), &truth[..1]), None);
        assert_eq!(Statistics::of(&image(&[[2.0; 3]; 3]), &truth), None, "of another size");
    }

    /// Noise of known variance: the error without it is 0 within four standard errors, and the planted one is found.
    #[test]
    fn noise_is_taken_out() {
        use rand::{Rng as _, SeedableRng as _};
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let mut replica = || {
            let values: Vec<[f32; 3]> =
                (0..4000).map(|_| std::array::from_fn(|_| 1.0 + 0.2 * (random.random::<f32>() - 0.5))).collect();
            image(&values)
        };
        let truth: Vec<Image> = (0..8).map(|_| replica()).collect();
        let right = Statistics::of(&image(&[[1.0; 3]; 4000]), &truth).expect("an error");
        assert!(right.error().abs() < 4.0 * right.standard_error, "{right:?}");
        let wrong = Statistics::of(&image(&[[1.03; 3]; 4000]), &truth).expect("an error");
        assert!((wrong.error() - 0.0009).abs() < 4.0 * wrong.standard_error, "{wrong:?}");
        assert!(wrong.error() > 4.0 * wrong.standard_error);
    }

    #[test]
    fn screens_show_what_they_say() {
        let (ours, truth) = (image(&[[0.0; 3], [0.0; 3]]), image(&[[1.0; 3], [1.0; 3]]));
        let curve = Curve::standard(0.0);
        let of = |mode, wipe| screen(mode, &ours, Some(&truth), wipe, &curve).pixels;
        assert_eq!(of(Mode::Engine, 0.0), [[0; 3]; 2]);
        assert_eq!(of(Mode::Truth, 0.0), [[255; 3]; 2]);
        assert_eq!(of(Mode::SideBySide, 0.0), [[0; 3], [0; 3], [255; 3], [255; 3]]);
        assert_eq!(of(Mode::Wipe, 0.5), [[0; 3], [255, 176, 32]]);
        assert_eq!(of(Mode::Difference, 0.0), [[64, 150, 255]; 2], "darker is blue");
        assert_eq!(screen(Mode::Truth, &ours, None, 0.0, &curve).pixels, [[0; 3]; 2]);
    }

    /// Against the curve itself: half a display value of the table's rounding and half of the curve's own.
    #[test]
    fn the_curve_is_that_of_srgb() {
        for index in 0..=1000 {
            let linear = f64::from(index) / 1000.0;
            let value = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
            let [found, ..] = Curve::standard(1.0).shown([linear as f32 / 2.0; 4]);
            assert!((f64::from(found) - 255.0 * value).abs() <= 1.0, "{linear}: {found}");
        }
        assert_eq!(Curve::standard(0.0).shown([f32::NAN, f32::INFINITY, -1.0, 0.0]), [0, 255, 0]);
    }
}
