//! Colour of a blackbody: the Blackbody node (`ShaderNodeBlackbody`), and the radiance that Principled Volume emits.
//!
//! The colour of temperature T is linear Rec. 709 of luminance 1. Cycles computes it piece by piece: a/T + b T + c in
//! red and green, a cubic in blue, constant below 800 K and from 12000 K on. Cool temperatures have negative channels:
//! the node drops them, Principled Volume keeps them.
//!
//! Principled Volume emits, with T = max(Temperature, 0) and b = Blackbody Intensity, per metre:
//! tint * colour(T) * (s / pi) * 1e-6 * ((1 - b) + b T^4), s = 5.670373e-8 W/m^2/K^4 being the constant of Stefan and
//! Boltzmann. It is 0 where b is not above 0.

use crate::base::arrays::{Mapped, each};
use crate::nodes::closure::{Quantity, per_channel};
use crate::nodes::color_space::fill;
use crate::nodes::real::Real;
use crate::nodes::{Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Role, always};
use crate::scene::{Release, SocketType};

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeBlackbody",
    label: "Blackbody",
    module: "blackbody",
    shader: include_str!("../../shaders/nodes/blackbody.wgsl"),
    properties: &[],
    inputs: &[InputSocket::float("Temperature", "Temperature", &[6_500.0], always)],
    outputs: &[OutputSocket::new("Color", SocketType::Color, always)],
    role: Role::Evaluated(|mode| Box::new(Blackbody { converts: converts(mode.release()) })),
};

/// Kelvins at which the pieces begin.
const KNOTS: [f32; 8] = [800.0, 965.0, 1_167.0, 1_449.0, 1_902.0, 3_315.0, 6_365.0, 12000.0];

/// Colour below the first knot.
const COLDEST: [f32; 3] = [5.413_294_3, -0.203_193_9, -0.082_253_52];
/// Colour from the last knot on.
const HOTTEST: [f32; 3] = [0.826_295_5, 0.994_508, 1.566_307_7];

/// Red and green of each piece: factor of 1/T, factor of T, constant.
const RED: [[f32; 3]; 7] = [
    [1_619.191, -0.002_050_109_2, 5.029_958],
    [2_488.454_6, -0.001_113_309_1, 3.226_215_4],
    [3_341.432, -0.000_486_551_2, 1.764_867_7],
    [4_094.617_4, -0.000_127_446_58, 0.725_731_6],
    [4_670.280_3, 0.000_029_125_82, 0.126_703_44],
    [4_595.092, 0.000_028_749_564, 0.150_345_03],
    [3_787.174_6, 9.359_078e-6, 0.399_075_87],
];
const GREEN: [[f32; 3]; 7] = [
    [-488.999_76, 0.000_604_330_74, -0.075_580_75],
    [-755.994_26, 0.000_316_730_1, 0.478_306_14],
    [-1_023.639_8, 0.000_120_223_47, 0.936_662_3],
    [-1_265.713_1, 4.873_409e-6, 1.270_545],
    [-1_425.293_3, -0.000_040_115_043, 1.439_727_8],
    [-1_175.548_2, -0.000_021_637_805, 1.304_080_2],
    [-500.799_56, -4.598_32e-6, 1.090_987_7],
];
/// Blue of each piece: factors of T^3, T^2, T and 1.
const BLUE: [[f32; 4]; 7] = [
    [5.969_453_4e-11, -4.857_429e-8, -0.000_097_062_23, -0.004_079_361_4],
    [2.404_303_7e-11, 5.550_210_6e-8, -0.000_198_503_71, 0.028_931_286],
    [-1.409_497_35e-11, 1.898_789_7e-7, -0.000_356_632_84, 0.091_076_78],
    [-3.614_608_6e-11, 2.848_220_2e-7, -0.000_493_211_3, 0.156_723_44],
    [-1.970_757_4e-11, 1.753_593_5e-7, -0.000_250_542_83, -0.022_278_327],
    [-1.619_979_5e-13, -1.642_16e-8, 0.000_386_216_27, -0.738_077_4],
    [6.726_503e-13, -2.730_788e-8, 0.000_424_098_25, -0.752_335_67],
];

struct Blackbody {
    /// The fit is converted to the working space.
    converts: bool,
}

/// Blender 5.1 and 5.2 convert the fit wherever it is evaluated, in Principled Volume as well; 5.0 and 5.3 only where Cycles folds the node.
fn converts(release: Release) -> bool {
    (Release::V5_1..Release::V5_3).contains(&release)
}

/// What the kernels of 5.1 and 5.2 multiply the fit with. Fitted to 10^6 temperatures of Blender 5.1.2 from 700 to 12100 K, of which it
/// has every bit; see [`FOLDED_PRIMARIES`] for what it is.
const PRIMARIES: [[f32; 3]; 3] = [
    [1.000_158_9, -9.872_019e-7, -7.748_603e-7],
    [-8.550_705e-8, 0.999_976_63, -3.241_002e-7],
    [1.676_377_4e-8, 2.086_164e-7, 0.999_759_6],
];

/// Colour of `temperature` kelvins in the order of operations of Cycles' kernels. NaN falls into the first piece.
fn color_in_order<R: Real>(temperature: R) -> [R; 3] {
    if temperature >= R::of(KNOTS[7]) {
        return HOTTEST.mapped(R::of);
    }
    if temperature < R::of(KNOTS[0]) {
        return COLDEST.mapped(R::of);
    }
    let piece = KNOTS[1..7].iter().filter(|&&knot| temperature >= R::of(knot)).count();
    let inverse = R::of(1.0) / temperature;
    let ratio = |[a, b, c]: [f32; 3]| (R::of(a) * inverse + R::of(b) * temperature) + R::of(c);
    let [a, b, c, d] = BLUE[piece].mapped(R::of);
    let cubic = ((a * temperature + b) * temperature + c) * temperature + d;
    [ratio(RED[piece]), ratio(GREEN[piece]), cubic]
}

/// What Cycles multiplies the fit with where it folds the node by itself: from its own Rec. 709 to the working space of
/// Blender's configuration, which differ by roundings of their published matrices. Fitted to 55 temperatures of Blender
/// 5.0.1, which it reproduces to 2.1e-7.
const FOLDED_PRIMARIES: [[f32; 3]; 3] = [
    [1.000_158_9, -9.454_259e-7, -7.201_281e-7],
    [-7.467_542e-8, 0.999_976_5, -3.306_253e-7],
    [3.060_857e-9, 2.486_49e-7, 0.999_759_5],
];

/// A colour of the fit times [`PRIMARIES`].
fn converted<R: Real>([red, green, blue]: [R; 3]) -> [R; 3] {
    PRIMARIES.mapped(|[r, g, b]| (R::of(r) * red + R::of(g) * green) + R::of(b) * blue)
}

impl Evaluate for Blackbody {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        fill(outputs, |index| {
            let color = color_in_order(inputs[0].values[index]);
            let color = if self.converts { converted(color) } else { color };
            color.mapped(|channel| channel.greater(R::of(0.0)))
        });
    }

    fn fold_constants_late(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        let [red, green, blue] = color_in_order(inputs[0]);
        let channel = |[r, g, b]: [f32; 3]| (red * r + green * g) + blue * b;
        Some(FOLDED_PRIMARIES.map(|row| channel(row).max(0.0)).to_vec())
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let [red, green, blue] = color(inputs[0]);
        let point = Interval::point;
        let color = if self.converts {
            PRIMARIES.mapped(|[r, g, b]| (point(r) * red + point(g) * green) + point(b) * blue)
        } else {
            [red, green, blue]
        };
        for (output, channel) in outputs.iter_mut().zip(color) {
            let positive = channel.greater(Interval::ZERO);
            // NaN becomes 0, also where the pieces that the numbers reach are constant.
            *output = if inputs[0].may_be_nan { positive.hull(Interval::ZERO) } else { positive };
        }
    }
}

/// Colour of a blackbody of `temperature` kelvins, with luminance 1.
pub fn color<Q: Quantity>(temperature: Q) -> [Q; 3] {
    // Piece 0 lies below the first knot, piece 8 above the last one.
    let knots: [f64; 9] = each(|piece| if piece == 0 { 0.0 } else { f64::from(KNOTS[piece - 1]) });
    let of = |constant: f32| Q::of(f64::from(constant));
    temperature.piecewise(&knots, |piece, t| match piece {
        0 => COLDEST.mapped(of),
        8 => HOTTEST.mapped(of),
        _ => {
            let (red, green, blue) = (RED[piece - 1], GREEN[piece - 1], BLUE[piece - 1]);
            let ratio = |[a, b, c]: [f32; 3]| of(a) * t.reciprocal() + of(b) * t + of(c);
            let cubic = ((of(blue[0]) * t + of(blue[1])) * t + of(blue[2])) * t + of(blue[3]);
            [ratio(red), ratio(green), cubic]
        }
    })
}

/// Radiance per metre of a blackbody with the values of a release of Blender; see the module's text.
pub fn emission<Q: Quantity>(intensity: Q, tint: [Q; 3], temperature: Q, release: Release) -> [Q; 3] {
    const SCALE: f64 = 5.670_373e-8 * 1e-6 / std::f64::consts::PI;
    let temperature = temperature.positive_part();
    let intensity = intensity.positive_part();
    let square = temperature * temperature;
    // At intensity 0 nothing is left, not the first summand.
    let on =
        intensity.increasing_in_both(Q::of(0.0), |intensity, _| if intensity > 0.0 { 1.0 } else { 0.0 * intensity });
    let power = Q::of(SCALE) * (on * (Q::of(1.0) - intensity) + intensity * (square * square));
    let mut color = color(temperature);
    if converts(release) {
        let [red, green, blue] = color;
        let of = |factor: f32| Q::of(f64::from(factor));
        color = PRIMARIES.mapped(|[r, g, b]| (of(r) * red + of(g) * green) + of(b) * blue);
    }
    per_channel(|channel| tint[channel] * color[channel] * power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_those_of_cycles() {
        // Rendered by Cycles 5.0.1 through Principled Volume, from which some 1e-6 can be read off.
        for (temperature, expected) in [
            (500.0, [5.413_292_8, -0.203_193_85, -0.082_253_51]),
            (1_000.0, [4.601_359_9, 0.039_041_93, -0.090_027_25]),
            (1_500.0, [3.264_305_8, 0.434_046_27, -0.064_237_03]),
            (3_000.0, [1.770_840_5, 0.844_284_57, 0.272_222_74]),
            (6_500.0, [1.042_551_8, 0.984_052_15, 1.035_271_1]),
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
    fn releases_5_1_and_5_2_convert_the_fit() {
        // Rendered by Cycles 5.1.2 through Principled Volume, from which some 1e-5 can be read off; by 5.3.0 it is that of 5.0.1.
        let square = 6_500.0_f64 * 6_500.0;
        let unit = 5.670_373e-8 * 1e-6 / std::f64::consts::PI * square * square;
        let at = |release| emission(1.0, [1.0; 3], 6_500.0, release).map(|radiance| radiance / unit);
        for (release, expected) in [
            (Release::V5_0, [1.042_552, 0.984_053, 1.035_272]),
            (Release::V5_1, [1.042_716, 0.984_029, 1.035_023]),
            (Release::V5_2, [1.042_716, 0.984_029, 1.035_023]),
            (Release::V5_3, [1.042_552, 0.984_053, 1.035_272]),
        ] {
            for (found, expected) in at(release).into_iter().zip(expected) {
                assert!((found - expected).abs() < 2e-6, "{release}: {found}");
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
    fn both_orders_of_operations_agree() {
        for temperature in
            [500.0_f32, 799.999, 800.0, 965.0, 1_166.999, 1_167.0, 1_902.0, 3_315.0, 6_365.0, 11_999.0, 12e3]
        {
            let (single, double) = (color_in_order(temperature), color(f64::from(temperature)));
            for (a, b) in single.iter().zip(double) {
                assert!((f64::from(*a) - b).abs() < 1e-6, "{temperature} K: {single:?}, {double:?}");
            }
        }
    }

    #[test]
    fn the_node_drops_what_is_negative() {
        let node = Blackbody { converts: false };
        let evaluated = |temperature: f32| {
            let mut output = [[0.0_f32]; 3];
            let mut outputs: Vec<&mut [f32]> = output.iter_mut().map(|values| values.as_mut_slice()).collect();
            node.evaluate(&[Column { values: &[temperature], uniform: true }], &mut outputs);
            output.map(|[channel]| channel)
        };
        assert_eq!(evaluated(0.0), [5.413_294_5, 0.0, 0.0]);
        assert_eq!(evaluated(f32::INFINITY), HOTTEST);
        assert_eq!(evaluated(f32::NAN), [0.0; 3]);
        let mut bounds = [Interval::ZERO; 3];
        node.enclose(&[Interval::new(0.0, 100.0).or_nan(true)], &mut bounds);
        assert!(bounds.iter().all(|bound| bound.has_zero() && !bound.may_be_nan));
        for (low, high) in [(700.0_f32, 900.0), (1_000.0, 1_000.0), (1_890.0, 3_400.0), (-1e9, 1e9)] {
            node.enclose(&[Interval::new(low, high)], &mut bounds);
            for step in 0..=20 {
                let temperature = (low + (high - low) * step as f32 / 20.0).clamp(low, high);
                let found = evaluated(temperature);
                let holds = found.iter().zip(bounds).all(|(channel, bound)| bound.contains(f64::from(*channel)));
                assert!(holds, "{temperature} K: {found:?} outside of {bounds:?}");
            }
        }
    }

    #[test]
    fn bounds_hold_the_values() {
        for (low, high) in
            [(0.0_f32, 20_000.0), (900.0, 1_000.0), (1_499.0, 1_501.0), (-5.0, 790.0), (11_990.0, 12_010.0)]
        {
            let tint = [Interval::point(1.0), Interval::point(0.5), Interval::point(2.0)];
            let enclosed = emission(Interval::new(0.0, 1.5), tint, Interval::new(low, high), Release::V5_0);
            for step in 0..=200 {
                let temperature = f64::from(low) + f64::from(high - low) * f64::from(step) / 200.0;
                for intensity in [0.0, 1e-6, 0.5, 1.0, 1.5] {
                    let found = emission(intensity, [1.0, 0.5, 2.0], temperature, Release::V5_0);
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
