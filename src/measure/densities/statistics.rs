//! What a density field looks like in numbers: moments, histogram, covered share, power spectrum.

use ndarray::{Array3, Axis};
use rustfft::FftPlannerScalar;
use rustfft::num_complex::Complex;
use serde::{Deserialize, Serialize};

/// Bins of the histogram, from 0 to [`HISTOGRAM_END`], and one more for what lies beyond.
const BINS: usize = 60;

/// End of the histogram, in means over the places that hold something.
const HISTOGRAM_END: f64 = 6.0;

/// Optical depth from which on a vertical line counts as covered: 10 % of the light is lost.
const COVERED_DEPTH: f64 = 0.105_360_515_657_826_3;

/// Figures of a field on a grid of n^3 places, whose box has side 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FieldStatistics {
    /// Places per axis.
    pub places: usize,
    /// Mean density.
    pub mean: f64,
    /// Standard deviation over the places.
    pub standard_deviation: f64,
    /// Largest density.
    pub largest: f64,
    /// Share of places with a density above 0.
    pub filled: f64,
    /// Share of vertical lines that lose 10 % of the light or more.
    pub covered: f64,
    /// Mean optical depth of the vertical lines, mean of the channels.
    pub mean_depth: f64,
    /// Of the places that hold something, the share per bin of density over their mean: 60 from 0 to 6, and what lies beyond.
    pub histogram: Vec<f64>,
    /// Power of density over mean per wave number 1, 2, ... in waves per side: the mean of |F|^2 over the shell, with F the
    /// discrete transform divided by the number of places. A box that is no period leaks: edges add power that falls as
    /// the square of the wave number.
    pub spectrum: Vec<f64>,
}

impl FieldStatistics {
    /// Measures densities by place x, y, z (z up); `extinction` per unit of density and side.
    pub fn of(densities: &Array3<f64>, extinction: f64) -> Self {
        let places = densities.len() as f64;
        let side = densities.shape()[0];
        let mean = densities.sum() / places;
        let variance = densities.iter().map(|density| (density - mean).powi(2)).sum::<f64>() / places;
        let depths = densities.sum_axis(Axis(2)) * (extinction / side as f64);
        let filled = densities.iter().filter(|&&density| density > 0.0).count() as f64;
        let mut histogram = vec![0.0; BINS + 1];
        for density in densities.iter().filter(|&&density| density > 0.0) {
            let bin = density * filled / (mean * places) / HISTOGRAM_END * BINS as f64;
            histogram[(bin as usize).min(BINS)] += 1.0 / filled;
        }
        Self {
            places: side,
            mean,
            standard_deviation: variance.sqrt(),
            largest: densities.iter().copied().fold(0.0, f64::max),
            filled: filled / places,
            covered: depths.iter().filter(|&&depth| depth >= COVERED_DEPTH).count() as f64 / depths.len() as f64,
            mean_depth: depths.sum() / depths.len() as f64,
            histogram,
            spectrum: spectrum(&densities.mapv(|density| density / mean)),
        }
    }
}

/// Power per whole wave number up to half the places per axis, averaged over shells of width 1.
fn spectrum(field: &Array3<f64>) -> Vec<f64> {
    let side = field.shape()[0];
    let mut transformed = field.mapv(|value| Complex::new(value, 0.0));
    let transform = FftPlannerScalar::new().plan_fft_forward(side);
    for axis in 0..3 {
        for mut lane in transformed.lanes_mut(Axis(axis)) {
            let mut values = lane.to_vec();
            transform.process(&mut values);
            lane.iter_mut().zip(values).for_each(|(place, value)| *place = value);
        }
    }
    let count = field.len() as f64;
    let wave = |index: usize| index.min(side - index) as f64;
    let mut shells = vec![(0.0, 0.0); side / 2 + 1];
    for ((x, y, z), value) in transformed.indexed_iter() {
        let number = (wave(x).powi(2) + wave(y).powi(2) + wave(z).powi(2)).sqrt().round() as usize;
        if let Some((sum, members)) = shells.get_mut(number) {
            *sum += value.norm_sqr() / (count * count);
            *members += 1.0;
        }
    }
    shells.into_iter().skip(1).map(|(sum, members)| sum / f64::max(members, 1.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn a_wave_has_its_power_at_its_number() {
        let side = 16;
        let field =
            Array3::from_shape_fn((side, side, side), |(x, _, _)| 1.0 + 0.5 * (TAU * 3.0 * x as f64 / 16.0).cos());
        let found = FieldStatistics::of(&field, 2.0);
        assert!((found.mean - 1.0).abs() < 1e-12 && (found.mean_depth - 2.0).abs() < 1e-12);
        // Two of the shell's members have (1/4)^2 each; cos^2 has mean 1/2.
        let members = (0..side.pow(3))
            .filter(|index| {
                let wave = |index: usize| index.min(side - index) as f64;
                let place = [index % side, index / side % side, index / side / side].map(wave);
                place.iter().map(|part| part * part).sum::<f64>().sqrt().round() == 3.0
            })
            .count() as f64;
        assert!((found.spectrum[2] * members - 2.0 / 16.0).abs() < 1e-12, "{:?}", found.spectrum);
        assert!(found.spectrum.iter().enumerate().all(|(index, power)| index == 2 || *power < 1e-20));
        assert!((found.standard_deviation - 0.5 / 2.0_f64.sqrt()).abs() < 1e-12);
        assert!((found.histogram.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert_eq!((found.filled, found.covered), (1.0, 1.0));
    }
}
