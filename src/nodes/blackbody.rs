//! Radiance of a blackbody as Principled Volume emits it.
//!
//! With temperature T = max(Temperature, 0) and b = Blackbody Intensity, per metre:
//! tint * B(T) * (s / pi) * 1e-6 * ((1 - b) + b T^4), s = 5.670373e-8 W/m^2/K^4 being the constant of Stefan and
//! Boltzmann. It is 0 where b is not above 0.
//! B(T) is the colour in linear Rec. 709, scaled to luminance 1, of which negative components are kept.
//! Cycles computes it piece by piece: a/T + b T + c in red and green, a cubic in blue, constant below 800 K and
//! from 12000 K on. The knots and coefficients here were fitted to values that Cycles 5.0.1 rendered, every
//! kelvin from 500 to 4595 and every second one to 12786, with residuals of at most 1.2e-6.

use super::closure::{Quantity, per_channel};

/// Kelvins at which the pieces begin.
const KNOTS: [f64; 8] = [800.0, 965.0, 1167.0, 1449.0, 1902.0, 3315.0, 6365.0, 12000.0];

/// Colour below the first knot.
const COLDEST: [f64; 3] = [5.413_292_9, -0.203_193_85, -0.082_253_5];
/// Colour from the last knot on.
const HOTTEST: [f64; 3] = [0.826_295_26, 0.994_507_74, 1.566_307_2];

/// Red and green of each piece: factor of 1/T, factor of T, constant.
const RED: [[f64; 3]; 7] = [
    [1619.197, -0.002_050_101_1, 5.029_942_4],
    [2488.4654, -0.001_113_299_3, 3.226_193_7],
    [3341.4326, -0.000_486_550_1, 1.764_864_6],
    [4094.6157, -0.000_127_446_86, 0.725_732_34],
    [4670.2802, 2.912_592_6e-5, 0.126_702_68],
    [4595.0923, 2.874_964_3e-5, 0.150_344_19],
    [3787.1768, 9.359_109_1e-6, 0.399_075_06],
];
const GREEN: [[f64; 3]; 7] = [
    [-488.99936, 0.000_604_330_97, -0.075_581_379],
    [-755.99467, 0.000_316_729_46, 0.478_307_17],
    [-1023.6388, 0.000_120_223_89, 0.936_660_91],
    [-1265.7135, 4.873_137e-6, 1.270_545_6],
    [-1425.293, -4.011_502_9e-5, 1.439_727_4],
    [-1175.5459, -2.163_770_4e-5, 1.304_079],
    [-500.79624, -4.598_287_2e-6, 1.090_986_7],
];
/// Blue of each piece: factors of T^3, T^2, T and 1.
const BLUE: [[f64; 4]; 7] = [
    [5.969_020_9e-11, -4.856_287_4e-8, -9.707_221_8e-5, -0.004_076_440_9],
    [2.404_354_2e-11, 5.550_052_3e-8, -0.000_198_502_08, 0.028_930_756],
    [-1.409_356_6e-11, 1.898_734e-7, -0.000_356_625_5, 0.091_073_593],
    [-3.614_592_8e-11, 2.848_212_4e-7, -0.000_493_210_08, 0.156_722_82],
    [-1.970_757_3e-11, 1.753_593_3e-7, -0.000_250_542_83, -0.022_278_266],
    [-1.620_071_1e-13, -1.642_145_6e-8, 0.000_386_215_47, -0.738_076_09],
    [6.726_496_2e-13, -2.730_785_4e-8, 0.000_424_097_92, -0.752_334_66],
];

/// Colour of a blackbody of `temperature` kelvins, with luminance 1.
pub fn color<Q: Quantity>(temperature: Q) -> [Q; 3] {
    // Piece 0 lies below the first knot, piece 8 above the last one.
    let knots: [f64; 9] = std::array::from_fn(|piece| if piece == 0 { 0.0 } else { KNOTS[piece - 1] });
    temperature.piecewise(&knots, |piece, t| match piece {
        0 => COLDEST.map(Q::of),
        8 => HOTTEST.map(Q::of),
        _ => {
            let (red, green, blue) = (RED[piece - 1], GREEN[piece - 1], BLUE[piece - 1]);
            let ratio = |[a, b, c]: [f64; 3]| Q::of(a) * t.reciprocal() + Q::of(b) * t + Q::of(c);
            let cubic = ((Q::of(blue[0]) * t + Q::of(blue[1])) * t + Q::of(blue[2])) * t + Q::of(blue[3]);
            [ratio(red), ratio(green), cubic]
        }
    })
}

/// Radiance per metre of a blackbody; see the module's text.
pub fn emission<Q: Quantity>(intensity: Q, tint: [Q; 3], temperature: Q) -> [Q; 3] {
    const SCALE: f64 = 5.670_373e-8 * 1e-6 / std::f64::consts::PI;
    let temperature = temperature.positive_part();
    let intensity = intensity.positive_part();
    let square = temperature * temperature;
    // At intensity 0 nothing is left, not the first summand.
    let on =
        intensity.increasing_in_both(Q::of(0.0), |intensity, _| if intensity > 0.0 { 1.0 } else { 0.0 * intensity });
    let power = Q::of(SCALE) * (on * (Q::of(1.0) - intensity) + intensity * (square * square));
    let color = color(temperature);
    per_channel(|channel| tint[channel] * color[channel] * power)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::Interval;

    #[test]
    fn colours_are_those_of_cycles() {
        // Rendered by Cycles 5.0.1 through Principled Volume. The fit's residual is at most 1.2e-6.
        for (temperature, expected) in [
            (500.0, [5.413_292_8, -0.203_193_85, -0.082_253_51]),
            (1000.0, [4.601_359_9, 0.039_041_93, -0.090_027_25]),
            (1500.0, [3.264_305_8, 0.434_046_27, -0.064_237_03]),
            (3000.0, [1.770_840_5, 0.844_284_57, 0.272_222_74]),
            (6500.0, [1.042_551_8, 0.984_052_15, 1.035_271_1]),
            (12000.0, [0.826_295_27, 0.994_507_72, 1.566_307_2]),
        ] {
            let found = color(temperature);
            for channel in 0..3 {
                let error = (found[channel] - expected[channel]).abs();
                assert!(error < 2e-6, "{temperature} K, channel {channel}: {} {error:e}", found[channel]);
            }
        }
    }

    #[test]
    fn the_luminance_is_one() {
        // Cycles' pieces are a fit themselves: 2e-3 is what they keep.
        for temperature in (800..12_000).step_by(37) {
            let [red, green, blue] = color(f64::from(temperature));
            let luminance = 0.212_639 * red + 0.715_169 * green + 0.072_192 * blue;
            assert!((luminance - 1.0).abs() < 2e-3, "{temperature} K: {luminance}");
        }
    }

    #[test]
    fn bounds_hold_the_values() {
        for (low, high) in [(0.0_f32, 20_000.0), (900.0, 1000.0), (1499.0, 1501.0), (-5.0, 790.0), (11_990.0, 12_010.0)]
        {
            let tint = [Interval::point(1.0), Interval::point(0.5), Interval::point(2.0)];
            let enclosed = emission(Interval::new(0.0, 1.5), tint, Interval::new(low, high));
            for step in 0..=200 {
                let temperature = f64::from(low) + f64::from(high - low) * f64::from(step) / 200.0;
                for intensity in [0.0, 1e-6, 0.5, 1.0, 1.5] {
                    let found = emission(intensity, [1.0, 0.5, 2.0], temperature);
                    for channel in 0..3 {
                        assert!(
                            enclosed[channel].contains(found[channel]),
                            "{temperature} K, {intensity}: {} outside of {:?}",
                            found[channel],
                            enclosed[channel]
                        );
                    }
                }
            }
        }
    }
}
