//! Where in a pixel the rays pass: a stratified grid, warped by the pixel filter.
//!
//! Cycles displaces each sample by an offset drawn with the filter as density. The deterministic
//! counterpart puts N x N equal strata of probability through the inverse distribution of each
//! axis, so every ray has weight 1 and pixels share no samples.

use crate::scene::PixelFilter;

/// Cells of the table that inverts a distribution; its error is far below a stratum.
const TABLE: usize = 4096;

/// Offsets from the pixel centre, in pixels, at the middle of `strata` parts of equal probability.
pub fn offsets(filter: PixelFilter, width: f64, strata: usize) -> Vec<f64> {
    let quantiles = (0..strata).map(|stratum| (stratum as f64 + 0.5) / strata as f64);
    let pi = std::f64::consts::PI;
    match filter {
        // Always one pixel wide, whatever the width says.
        PixelFilter::Box => quantiles.map(|quantile| quantile - 0.5).collect(),
        PixelFilter::Gaussian => invert(|offset| (-8.0 * (offset / width).powi(2)).exp(), 1.5 * width, quantiles),
        PixelFilter::BlackmanHarris => {
            let density = |offset: f64| {
                let angle = pi * offset / width;
                0.35875 + 0.48829 * angle.cos() + 0.14128 * (2.0 * angle).cos() + 0.01168 * (3.0 * angle).cos()
            };
            invert(density, width, quantiles)
        }
    }
}

/// Inverts the distribution of an even density on `[-support, support]` at rising quantiles.
fn invert(density: impl Fn(f64) -> f64, support: f64, quantiles: impl Iterator<Item = f64>) -> Vec<f64> {
    let cell = 2.0 * support / TABLE as f64;
    let masses: Vec<f64> = (0..TABLE).map(|index| density(-support + (index as f64 + 0.5) * cell)).collect();
    let total: f64 = masses.iter().sum();
    let mut index = 0;
    let mut before = 0.0;
    quantiles
        .map(|quantile| {
            let wanted = quantile * total;
            while index + 1 < TABLE && before + masses[index] < wanted {
                before += masses[index];
                index += 1;
            }
            -support + (index as f64 + (wanted - before) / masses[index]) * cell
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn deviation(offsets: &[f64]) -> f64 {
        (offsets.iter().map(|offset| offset * offset).sum::<f64>() / offsets.len() as f64).sqrt()
    }

    #[test]
    fn offsets_have_the_spread_of_their_filter() {
        // Ideal standard deviations; 1000 strata leave out less than 2e-3 of the tails' second moment.
        for (filter, width, expected) in [
            (PixelFilter::Box, 1.5, 0.28868),
            (PixelFilter::BlackmanHarris, 1.0, 0.27702),
            (PixelFilter::BlackmanHarris, 1.5, 0.41552),
            (PixelFilter::Gaussian, 1.5, 0.375),
        ] {
            let found = offsets(filter, width, 1000);
            assert!((deviation(&found) / expected - 1.0).abs() < 2e-3, "{filter:?}: {}", deviation(&found));
            assert!(found.iter().sum::<f64>().abs() < 1e-9, "{filter:?} is not centred");
        }
        assert_eq!(offsets(PixelFilter::Box, 1.0, 2), [-0.25, 0.25]);
    }
}
