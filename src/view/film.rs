//! Where in a pixel the rays pass: a stratified grid, warped by the pixel filter.
//!
//! Cycles displaces each sample by an offset drawn with the filter as density. The deterministic
//! counterpart puts N x N equal strata of probability through the inverse distribution of each
//! axis, so every ray has weight 1 and pixels share no samples.

use crate::scene::PixelFilter;

/// Cells of the table that inverts a distribution; its error is far below a stratum.
const TABLE: usize = 4096;

/// The inverse distribution of a pixel filter along one axis.
#[derive(Debug, Clone)]
pub struct Warp {
    /// Half width of the filter in pixels.
    support: f64,
    /// Mass of the table's cells before each, and of all; empty for the box filter.
    cumulative: Vec<f64>,
    /// For every [`TABLE`]th part of the mass, and for all of it, the first cell whose end reaches it: where the search of a quantile begins and ends.
    guide: Vec<u16>,
}

impl Warp {
    /// The filter of `width` pixels; the box is always one pixel wide, whatever the width says.
    pub fn new(filter: PixelFilter, width: f64) -> Self {
        let pi = std::f64::consts::PI;
        match filter {
            PixelFilter::Box => Self { support: 0.5, cumulative: Vec::new(), guide: Vec::new() },
            PixelFilter::Gaussian => Self::tabulate(|offset| (-8.0 * (offset / width).powi(2)).exp(), 1.5 * width),
            PixelFilter::BlackmanHarris => {
                let density = |offset: f64| {
                    let angle = pi * offset / width;
                    0.35875 + 0.48829 * angle.cos() + 0.14128 * (2.0 * angle).cos() + 0.01168 * (3.0 * angle).cos()
                };
                Self::tabulate(density, width)
            }
        }
    }

    /// No filter: every ray passes through the centre of its pixel, as the one ray of a pixel does that has no more.
    pub fn centre() -> Self {
        Self { support: 0.0, cumulative: vec![0.0; TABLE + 1], guide: Vec::new() }
    }

    /// Tabulates an even density on `[-support, support]`.
    fn tabulate(density: impl Fn(f64) -> f64, support: f64) -> Self {
        let cell = 2.0 * support / TABLE as f64;
        let mut total = 0.0;
        let mut cumulative = vec![0.0];
        for index in 0..TABLE {
            total += density(-support + (index as f64 + 0.5) * cell);
            cumulative.push(total);
        }
        let ends = &cumulative[1..TABLE];
        // TABLE is a power of two, so that these products round as those of quantiles do, in the same order.
        let reached = |part: usize| ends.partition_point(|&mass| mass < part as f64 / TABLE as f64 * total) as u16;
        let guide = (0..=TABLE).map(reached).collect();
        Self { support, cumulative, guide }
    }

    /// Offset from the pixel centre, in pixels, below which the part `quantile` of the filter lies.
    pub fn offset(&self, quantile: f64) -> f64 {
        let Some(&total) = self.cumulative.last() else { return quantile - 0.5 };
        if self.support == 0.0 {
            return 0.0;
        }
        let wanted = quantile * total;
        let index = self.cell(quantile, wanted);
        let part = (wanted - self.cumulative[index]) / (self.cumulative[index + 1] - self.cumulative[index]);
        -self.support + (index as f64 + part) * (2.0 * self.support / TABLE as f64)
    }

    /// Offsets from the pixel centre, in pixels, at the middle of so many parts of equal probability.
    pub fn strata(&self, strata: usize) -> Vec<f64> {
        (0..strata).map(|stratum| self.offset((stratum as f64 + 0.5) / strata as f64)).collect()
    }

    /// The first cell whose end reaches the mass `wanted`, the part `quantile` of all.
    fn cell(&self, quantile: f64, wanted: f64) -> usize {
        let part = ((quantile * TABLE as f64) as usize).min(TABLE - 1);
        let [first, last] = [self.guide[part], self.guide[part + 1]].map(usize::from);
        first + self.cumulative[1 + first..1 + last].partition_point(|&mass| mass < wanted)
    }
}

/// [`Warp::strata`] of a filter.
pub fn offsets(filter: PixelFilter, width: f64, strata: usize) -> Vec<f64> {
    Warp::new(filter, width).strata(strata)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn deviation(offsets: &[f64]) -> f64 {
        (offsets.iter().map(|offset| offset * offset).sum::<f64>() / offsets.len() as f64).sqrt()
    }

    #[test]
    fn the_guide_finds_what_a_search_of_all_cells_finds() {
        for (filter, width) in [(PixelFilter::BlackmanHarris, 1.5), (PixelFilter::Gaussian, 0.7)] {
            let warp = Warp::new(filter, width);
            let total = warp.cumulative[TABLE];
            // Where the guide changes, next to it, between, and where no quantile should be.
            let parts = (0..=TABLE).map(|part| part as f64 / TABLE as f64);
            let ends =
                parts.flat_map(|part| [part.next_down().max(0.0), part, part.next_up(), part + 0.3 / TABLE as f64]);
            for quantile in ends.chain([f64::MIN_POSITIVE, 1.0, 1.1, -0.1, f64::NAN]) {
                let wanted = quantile * total;
                let expected = warp.cumulative[1..TABLE].partition_point(|&mass| mass < wanted);
                assert_eq!(warp.cell(quantile, wanted), expected, "{filter:?}, {quantile}");
            }
        }
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
        // One ray per pixel passes through its centre under every filter, as all rays do without one.
        for filter in [PixelFilter::Box, PixelFilter::BlackmanHarris, PixelFilter::Gaussian] {
            assert!(offsets(filter, 1.5, 1)[0].abs() < 1e-12);
        }
        assert!([0.0, 0.3, 1.0].into_iter().all(|quantile| Warp::centre().offset(quantile) == 0.0));
    }
}
