//! The error of a picture against a truth that has noise, and how sure it is.
//!
//! With the mean m of K independent replicas of the truth, the variance v of that mean (from the replicas), a picture o, the mean M
//! of m over pixels and channels, and epsilon = 0.01 M,
//!
//! ```text
//! relMSE = mean ((o - m)^2 - v) / (m'^2 + epsilon'^2)      MSE = mean ((o - m)^2 - v)      bias = (mean o - M) / M
//! ```
//!
//! Both means of squares are without the truth's noise: (o - m)^2 has the expectation (o - truth)^2 + v. In relMSE m, v are of one half
//! of the replicas and m', epsilon' of the other, so that numerator and denominator are independent (with a common m dark pixels, whose
//! noise is as large as they are, would add an error that is not there); the two ways round are averaged. Figures may fall below 0 where
//! nothing but noise differs. Standard errors are by the jackknife over the replicas: what other replicas would have said.

pub mod values;

use crate::base::error::{Error, Result};
use crate::scene::image::Image;
use serde::{Deserialize, Serialize};

/// Fewest replicas: leaving one out of either half has to leave a variance.
pub const FEWEST_REPLICAS: usize = 6;

/// Share of the mean that epsilon is.
pub(crate) const EPSILON: f64 = 0.01;

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

/// Refuses a truth of too few replicas, or of another size than the picture.
fn check(picture: &Image, truth: &[Image]) -> Result<()> {
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
    Ok(())
}

/// Measures a picture against replicas of the truth.
pub fn measure(picture: &Image, truth: &[Image]) -> Result<Errors> {
    check(picture, truth)?;
    let [relmse, mean_square, bias] = jackknife(truth.len(), |replicas| figures(picture, truth, replicas));
    let root = mean_square.value.max(0.0).sqrt();
    // d sqrt(x) = dx / (2 sqrt(x)); near 0 the root of the uncertainty itself.
    let rms_error = (mean_square.standard_error / (2.0 * root)).min(mean_square.standard_error.sqrt());
    Ok(Errors { relmse, rms: Uncertain { value: root, standard_error: rms_error }, bias })
}

/// relMSE of `picture` minus that of `other` against the same truth. Its standard error is that of the difference: what noise of the truth
/// both have in common is not in it.
pub fn relmse_change(picture: &Image, other: &Image, truth: &[Image]) -> Result<Uncertain> {
    check(other, truth)?;
    check(picture, truth)?;
    let relative = |picture: &Image, replicas: &[usize]| figures(picture, truth, replicas)[0];
    let [change] = jackknife(truth.len(), |replicas| [relative(picture, replicas) - relative(other, replicas)]);
    Ok(change)
}

/// relMSE of a picture that has replicas itself, each with noise of its own or in common with the same replica of the truth: of all of them, and
/// then with each left out ([`from_left_out`]). Neither's noise is in it.
///
/// `differences` are the picture minus the truth, replica by replica, three numbers per pixel.
pub fn relmse_of_differences(differences: &[Vec<f64>], truth: &[Image]) -> Result<Vec<f64>> {
    if let Some(first) = truth.first() {
        check(first, truth)?;
    }
    let numbers = truth.first().map_or(0, |image| 3 * image.pixels.len());
    if differences.len() != truth.len() || differences.iter().any(|one| one.len() != numbers) || truth.is_empty() {
        return Err(Error::new(
            "the replicas of a picture",
            format!("{} of them", differences.len()),
            format!("one for each of the {} of the truth, of its size", truth.len()),
            "Make them together.",
        ));
    }
    let difference = |replica: usize, index: usize| differences[replica][index];
    Ok(selections(truth.len()).map(|replicas| relative(&difference, truth, &replicas, numbers)).collect())
}

/// Mean of such differences over the mean of the truth: of all replicas, and then with each left out.
pub fn brightness_of_differences(differences: &[Vec<f64>], truth: &[Image]) -> Vec<f64> {
    let of_differences: Vec<f64> = differences.iter().map(|one| one.iter().sum()).collect();
    let of_truth: Vec<f64> = truth.iter().map(|image| numbers(image).iter().sum()).collect();
    let ratio = |replicas: Vec<usize>| {
        let sum = |sums: &[f64]| replicas.iter().map(|&replica| sums[replica]).sum::<f64>();
        let whole = sum(&of_truth);
        if whole == 0.0 { 0.0 } else { sum(&of_differences) / whole }
    };
    selections(truth.len()).map(ratio).collect()
}

/// The colours of a picture: three numbers per pixel.
pub fn numbers(image: &Image) -> Vec<f64> {
    (0..3 * image.pixels.len()).map(|index| value(image, index)).collect()
}

/// A figure of all replicas and its standard error, from that figure and those with each replica left out.
pub fn from_left_out(figures: &[f64]) -> Uncertain {
    let without = &figures[1..];
    let count = without.len() as f64;
    let mean = without.iter().sum::<f64>() / count;
    let spread: f64 = without.iter().map(|one| (one - mean).powi(2)).sum();
    Uncertain { value: figures[0], standard_error: ((count - 1.0) / count * spread).sqrt() }
}

/// All replicas, and then all but each one.
fn selections(count: usize) -> impl Iterator<Item = Vec<usize>> {
    let without = move |left: Option<usize>| (0..count).filter(|&replica| Some(replica) != left).collect();
    std::iter::once(None).chain((0..count).map(Some)).map(without)
}

/// Figures of all replicas, with standard errors from leaving out each.
fn jackknife<const N: usize>(count: usize, figures: impl Fn(&[usize]) -> [f64; N]) -> [Uncertain; N] {
    let found: Vec<[f64; N]> = selections(count).map(|replicas| figures(&replicas)).collect();
    std::array::from_fn(|figure| from_left_out(&found.iter().map(|one| one[figure]).collect::<Vec<_>>()))
}

/// Means over replicas and the variances of these, per pixel and colour channel.
struct Moments {
    means: Vec<f64>,
    variances: Vec<f64>,
    /// Mean over pixels and channels.
    mean: f64,
}

impl Moments {
    /// Of some replicas, by their numbers.
    fn of(value: &impl Fn(usize, usize) -> f64, replicas: &[usize], numbers: usize) -> Self {
        let count = replicas.len() as f64;
        let (mut means, mut squares) = (vec![0.0; numbers], vec![0.0; numbers]);
        for &replica in replicas {
            (0..numbers).for_each(|index| means[index] += value(replica, index) / count);
        }
        for &replica in replicas {
            (0..numbers).for_each(|index| squares[index] += (value(replica, index) - means[index]).powi(2));
        }
        let mean = means.iter().sum::<f64>() / numbers as f64;
        Self { means, variances: squares.into_iter().map(|square| square / (count * (count - 1.0))).collect(), mean }
    }

    /// The mean's square without its noise: m^2 - v.
    fn square(&self, index: usize) -> f64 {
        self.means[index].powi(2) - self.variances[index]
    }
}

fn value(image: &Image, index: usize) -> f64 {
    f64::from(image.pixels[index / 3][index % 3])
}

/// relMSE of some replicas of differences from the truth.
fn relative(difference: &impl Fn(usize, usize) -> f64, truth: &[Image], replicas: &[usize], numbers: usize) -> f64 {
    let halves = [0, 1].map(|first| replicas.iter().copied().skip(first).step_by(2).collect::<Vec<usize>>());
    let numerators = halves.each_ref().map(|half| Moments::of(difference, half, numbers));
    let denominators = halves.map(|half| Moments::of(&|replica, index| value(&truth[replica], index), &half, numbers));
    let mut sum = 0.0;
    for (numerator, denominator) in numerators.iter().zip(denominators.iter().rev()) {
        let least = (EPSILON * denominator.mean).powi(2);
        for index in 0..numbers {
            let scale = denominator.means[index].powi(2) + least;
            sum += numerator.square(index) / (2.0 * scale.max(f64::MIN_POSITIVE));
        }
    }
    sum / numbers as f64
}

/// relMSE, mean square and bias, by some replicas.
fn figures(picture: &Image, truth: &[Image], replicas: &[usize]) -> [f64; 3] {
    let numbers = 3 * picture.pixels.len();
    let difference = |replica: usize, index: usize| value(picture, index) - value(&truth[replica], index);
    let all = Moments::of(&difference, replicas, numbers);
    let square = (0..numbers).map(|index| all.square(index)).sum::<f64>() / numbers as f64;
    let count = (numbers * replicas.len()) as f64;
    let truths = replicas.iter().flat_map(|&replica| (0..numbers).map(move |index| value(&truth[replica], index)));
    let mean = truths.sum::<f64>() / count;
    let bias = if mean == 0.0 { 0.0 } else { all.mean / mean };
    [relative(&difference, truth, replicas, numbers), square, bias]
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng as _, SeedableRng as _};

    /// A truth from `dark` to 1 above it, and noisy replicas of it.
    fn replicas(dark: f32, noise: f32, seed: u64) -> Vec<Image> {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        (0..8)
            .map(|_| {
                let mut image = Image::new(64, 32);
                for (index, pixel) in image.pixels.iter_mut().enumerate() {
                    let truth = dark + (index % 64) as f32 / 64.0;
                    *pixel = std::array::from_fn(|_| truth + noise * random.random_range(-1.0..1.0_f32));
                }
                image
            })
            .collect()
    }

    #[test]
    fn the_truths_noise_is_no_error_even_where_it_is_dark() {
        // In the second picture noise is as large as the darkest pixels.
        for dark in [0.5, 0.0] {
            let exact = replicas(dark, 0.0, 1).remove(0);
            let mut within = 0;
            for seed in 0..40 {
                let found = measure(&exact, &replicas(dark, 0.2, seed)).expect("errors");
                within += usize::from(found.relmse.value.abs() <= 2.36 * found.relmse.standard_error);
                // The plain mean square would be 0.2^2 / 3 / 8 = 0.0017.
                assert!(found.rms.value.powi(2) < 2.5e-4, "{found:?}");
            }
            // 2.36 is the two-sided 95 % point of t with 7 degrees of freedom: 38 of 40 are expected, and fewer than 32 have a probability
            // below 0.1 %.
            assert!(within >= 32, "{within} of 40 at {dark}");
        }
    }

    #[test]
    fn an_offset_is_found() {
        let mut offset = replicas(0.5, 0.0, 1).remove(0);
        offset.pixels.iter_mut().for_each(|pixel| *pixel = pixel.map(|value| value + 0.1));
        let found = measure(&offset, &replicas(0.5, 0.2, 7)).expect("errors");
        assert!((found.rms.value - 0.1).abs() < 4.0 * found.rms.standard_error + 1e-4, "{found:?}");
        assert!((found.bias.value - 0.1 / 0.9922).abs() < 4.0 * found.bias.standard_error + 1e-3, "{found:?}");
    }

    #[test]
    fn noise_in_common_cancels() {
        // A picture that is the truth but for an offset has the offset's error, however noisy both are, and without uncertainty.
        let truth = replicas(0.5, 0.2, 3);
        let offset =
            |by: f64| -> Vec<Vec<f64>> { truth.iter().map(|image| vec![by; 3 * image.pixels.len()]).collect() };
        let found = from_left_out(&relmse_of_differences(&offset(0.0), &truth).expect("errors"));
        assert_eq!((found.value, found.standard_error), (0.0, 0.0));
        let exact = replicas(0.5, 0.0, 1).remove(0);
        let scale = |index: usize| 0.01 / (value(&exact, index).powi(2) + (0.01_f64 * 0.9922).powi(2));
        let numbers = 3 * exact.pixels.len();
        let wanted = (0..numbers).map(scale).sum::<f64>() / numbers as f64;
        let found = from_left_out(&relmse_of_differences(&offset(0.1), &truth).expect("errors"));
        // Noise of the denominator alone: 0.2^2 / 3 / 4 over squares from 0.25 on.
        assert!(
            (found.value / wanted - 1.0).abs() < 0.05 && found.standard_error < 0.02 * wanted,
            "{found:?} {wanted}"
        );
        // And one that has no noise is measured as ever.
        let single: Vec<Vec<f64>> = truth
            .iter()
            .map(|image| (0..numbers).map(|index| value(&exact, index) - value(image, index)).collect())
            .collect();
        let same = from_left_out(&relmse_of_differences(&single, &truth).expect("errors"));
        assert_eq!(same, measure(&exact, &truth).expect("errors").relmse);
        assert!(relmse_of_differences(&single[1..], &truth).is_err());
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let truth = replicas(0.5, 0.0, 1);
        assert!(measure(&truth[0], &truth[..5]).is_err());
        assert!(measure(&Image::new(2, 2), &truth).is_err());
    }
}
