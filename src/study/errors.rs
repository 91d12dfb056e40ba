//! The error of a picture against a truth that has noise, and how sure it is.
//!
//! With the mean m of K independent replicas of the truth, the variance v of that mean (from the replicas), a picture o, the mean M
//! of m over pixels and channels, and epsilon = 0.01 M,
//!
//! ```text
//! relMSE = mean ((o - m)^2 - v) / (m^2 + epsilon^2)      MSE = mean ((o - m)^2 - v)      bias = (mean o - M) / M
//! ```
//!
//! Both means of squares are without the truth's noise: (o - m)^2 has the expectation (o - truth)^2 + v (as m^2 in the denominator is
//! noisy too, what is left is of second order). They may fall below 0 where nothing but noise differs. Standard errors are by the
//! jackknife over the replicas: what other replicas would have said.

use crate::error::{Error, Result};
use crate::image::Image;
use serde::{Deserialize, Serialize};

/// Fewest replicas: leaving one out has to leave a variance.
pub const FEWEST_REPLICAS: usize = 3;

/// Share of the mean that epsilon is.
const EPSILON: f64 = 0.01;

/// A figure and its standard error, from the noise of the truth alone.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Uncertain {
    /// The figure.
    pub value: f64,
    /// Its standard error.
    pub standard_error: f64,
}

/// Errors of a picture over all pixels and colour channels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Relative mean squared error without the truth's noise.
    pub relmse: Uncertain,
    /// Root of the mean squared error without the truth's noise; 0 where that is negative.
    pub rms: Uncertain,
    /// Relative difference of the image means.
    pub bias: Uncertain,
}

/// Measures a picture against replicas of the truth.
pub fn measure(picture: &Image, truth: &[Image]) -> Result<Errors> {
    if truth.len() < FEWEST_REPLICAS {
        return Err(Error::new(
            "the truth",
            format!("{} replicas", truth.len()),
            format!("at least {FEWEST_REPLICAS}"),
            "Give more.",
        ));
    }
    if let Some(other) = truth.iter().find(|other| (other.width, other.height) != (picture.width, picture.height)) {
        return Err(Error::new(
            "the truth",
            format!("{} x {} pixels", other.width, other.height),
            format!("{} x {}", picture.width, picture.height),
            "Render it again.",
        ));
    }
    let all = figures(picture, &truth.iter().collect::<Vec<_>>());
    let without: Vec<[f64; 3]> = (0..truth.len())
        .map(|left| {
            let rest: Vec<&Image> =
                truth.iter().enumerate().filter(|(index, _)| *index != left).map(|(_, replica)| replica).collect();
            figures(picture, &rest)
        })
        .collect();
    let count = truth.len() as f64;
    let [relmse, mean_square, bias] = std::array::from_fn(|figure| {
        let mean = without.iter().map(|one| one[figure]).sum::<f64>() / count;
        let spread: f64 = without.iter().map(|one| (one[figure] - mean).powi(2)).sum();
        Uncertain { value: all[figure], standard_error: ((count - 1.0) / count * spread).sqrt() }
    });
    let root = mean_square.value.max(0.0).sqrt();
    // d sqrt(x) = dx / (2 sqrt(x)); near 0 the root of the uncertainty itself.
    let rms_error = (mean_square.standard_error / (2.0 * root)).min(mean_square.standard_error.sqrt());
    Ok(Errors { relmse, rms: Uncertain { value: root, standard_error: rms_error }, bias })
}

/// relMSE, mean square and bias.
fn figures(picture: &Image, truth: &[&Image]) -> [f64; 3] {
    let count = truth.len() as f64;
    let numbers = 3 * picture.pixels.len();
    let value = |image: &Image, index: usize| f64::from(image.pixels[index / 3][index % 3]);
    let means: Vec<f64> =
        (0..numbers).map(|index| truth.iter().map(|image| value(image, index)).sum::<f64>() / count).collect();
    let mean = means.iter().sum::<f64>() / numbers as f64;
    let epsilon = EPSILON * mean;
    let (mut relative, mut square, mut sum) = (0.0, 0.0, 0.0);
    for (index, m) in means.iter().enumerate() {
        let spread: f64 = truth.iter().map(|image| (value(image, index) - m).powi(2)).sum();
        let variance = spread / (count * (count - 1.0));
        let o = value(picture, index);
        let excess = (o - m).powi(2) - variance;
        square += excess;
        relative += excess / (m * m + epsilon * epsilon).max(f64::MIN_POSITIVE);
        sum += o;
    }
    let numbers = numbers as f64;
    [relative / numbers, square / numbers, if mean == 0.0 { 0.0 } else { sum / numbers / mean - 1.0 }]
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng as _, SeedableRng as _};

    /// A truth of 0.5 to 1.5 and noisy replicas of it.
    fn replicas(noise: f32, seed: u64) -> Vec<Image> {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        (0..4)
            .map(|_| {
                let mut image = Image::new(64, 32);
                for (index, pixel) in image.pixels.iter_mut().enumerate() {
                    let truth = 0.5 + (index % 64) as f32 / 64.0;
                    *pixel = std::array::from_fn(|_| truth + noise * random.random_range(-1.0..1.0_f32));
                }
                image
            })
            .collect()
    }

    #[test]
    fn the_truths_noise_is_no_error_and_an_offset_is() {
        let exact = replicas(0.0, 1).remove(0);
        let mut within = 0;
        for seed in 0..40 {
            let found = measure(&exact, &replicas(0.2, seed)).expect("errors");
            within += usize::from(found.relmse.value.abs() <= 3.2 * found.relmse.standard_error);
            // The plain mean square would be 0.2^2 / 3 / 4 = 0.0033.
            assert!(found.rms.value.powi(2) < 5e-4, "{found:?}");
        }
        // 3.2 is the two-sided 95 % point of t with 3 degrees of freedom: 38 expected, 33 with the probability 0.99 or more.
        assert!(within >= 33, "{within} of 40");
        let mut offset = exact.clone();
        offset.pixels.iter_mut().for_each(|pixel| *pixel = pixel.map(|value| value + 0.1));
        let found = measure(&offset, &replicas(0.2, 7)).expect("errors");
        assert!((found.rms.value - 0.1).abs() < 4.0 * found.rms.standard_error + 1e-4, "{found:?}");
        assert!((found.bias.value - 0.1 / 0.9922).abs() < 4.0 * found.bias.standard_error + 1e-3, "{found:?}");
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let truth = replicas(0.0, 1);
        assert!(measure(&truth[0], &truth[..2]).is_err());
        assert!(measure(&Image::new(2, 2), &truth).is_err());
    }
}
