//! Colour spaces: linear Rec. 709 to and from HSV (hue, saturation, value) and HSL (hue, saturation, lightness).
//!
//! Smith, "Color Gamut Transform Pairs" (1978), in the order of operations of Cycles' kernels. Hue is in turns, red
//! at 0 and 1. Nothing is clamped: negative and bright channels give saturations outside of [0, 1], and
//! a hue outside of [0, 1] falls into the last of the six sectors between two pure hues.

use crate::base::arrays::{Mapped, each};
use crate::nodes::bounds::Interval;
use crate::nodes::real::Real;
use crate::nodes::vector_output;
use crate::scene::Release;

/// Luminance weights of linear Rec. 709 primaries.
const LUMINANCE: [f32; 3] = [0.212_639_12, 0.715_169_13, 0.072_192_76];

/// The weights of RGB to BW since Blender 5.1, as it gives them for pure colours: a last digit of two of them differs. (A color's
/// conversion to a number keeps those of 5.0.)
const LUMINANCE_OF_NODE_SINCE_5_1: [f32; 3] = [0.212_639_1, 0.715_169_13, 0.072_192_74];

/// The weights of Blender 4.5, as its RGB to BW gives them for pure colours.
const LUMINANCE_BEFORE_5: [f32; 3] = [0.212_674_04, 0.715_151_6, 0.072_175_42];

/// What an implementation may change in a saturation or a place within a sector, absolute: a few units in
/// the last place of 1.
const ROUNDING: f64 = 1e-6;

/// A way to write a colour as three numbers, as Separate Color and Combine Color offer them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColorSpace {
    /// Red, green and blue themselves.
    Rgb,
    /// Hue, saturation and value.
    Hsv,
    /// Hue, saturation and lightness.
    Hsl,
}

impl ColorSpace {
    /// The space of the nodes' property `mode`: `RGB`, `HSV` or `HSL`.
    pub fn of(mode: &str) -> Self {
        match mode {
            "HSV" => Self::Hsv,
            "HSL" => Self::Hsl,
            _ => Self::Rgb,
        }
    }

    /// Coordinates of a colour.
    #[inline(always)]
    pub fn separate<R: Real>(self, color: [R; 3]) -> [R; 3] {
        match self {
            Self::Rgb => color,
            Self::Hsv => rgb_to_hsv(color),
            Self::Hsl => rgb_to_hsl(color),
        }
    }

    /// The colour of these coordinates.
    #[inline(always)]
    pub fn combine<R: Real>(self, coordinates: [R; 3]) -> [R; 3] {
        match self {
            Self::Rgb => coordinates,
            Self::Hsv => hsv_to_rgb(coordinates),
            Self::Hsl => hsl_to_rgb(coordinates),
        }
    }

    /// Encloses [`Self::separate`].
    pub fn enclose_separate(self, color: [Interval; 3]) -> [Interval; 3] {
        match self {
            Self::Rgb => color,
            Self::Hsv => enclose_rgb_to_hsv(color),
            Self::Hsl => enclose_rgb_to_hsl(color),
        }
    }

    /// Encloses [`Self::combine`].
    pub fn enclose_combine(self, coordinates: [Interval; 3]) -> [Interval; 3] {
        match self {
            Self::Rgb => coordinates,
            Self::Hsv => enclose_hsv_to_rgb(coordinates),
            Self::Hsl => enclose_hsl_to_rgb(coordinates),
        }
    }
}

/// Luminance of a colour by these weights.
#[inline(always)]
pub fn luminance<R: Real>([red, green, blue]: [R; 3], weights: [f32; 3]) -> R {
    let [r, g, b] = weights.mapped(R::of);
    (red * r + green * g) + blue * b
}

/// Encloses [`luminance`].
pub fn enclose_luminance([red, green, blue]: [Interval; 3], weights: [f32; 3]) -> Interval {
    let [r, g, b] = weights.mapped(Interval::point);
    (red * r + green * g) + blue * b
}

/// Luminance weights of a colour's conversion to a number.
pub fn conversion_weights(release: Release) -> [f32; 3] {
    if release < Release::V5_0 { LUMINANCE_BEFORE_5 } else { LUMINANCE }
}

/// Luminance weights of RGB to BW.
pub fn node_weights(release: Release) -> [f32; 3] {
    if release >= Release::V5_1 { LUMINANCE_OF_NODE_SINCE_5_1 } else { conversion_weights(release) }
}

/// Largest channel, which is NaN only if all are, and smallest one.
#[inline(always)]
fn extremes<R: Real>([red, green, blue]: [R; 3]) -> [R; 2] {
    [red.fmax(green.fmax(blue)), red.lesser(green.lesser(blue))]
}

/// Hue, saturation and value of a colour.
#[inline(always)]
pub fn rgb_to_hsv<R: Real>(color: [R; 3]) -> [R; 3] {
    hsv(color, |lacking, chroma| lacking / chroma)
}

/// [`rgb_to_hsv`] as Cycles folds constants with it: the machine code that it has for that multiplies by the reciprocal of
/// the chroma (measured).
pub fn rgb_to_hsv_of_constant(color: [f32; 3]) -> [f32; 3] {
    hsv(color, |lacking, chroma| lacking * (1.0 / chroma))
}

#[inline(always)]
fn hsv<R: Real>([red, green, blue]: [R; 3], quotient: impl Fn(R, R) -> R) -> [R; 3] {
    let (zero, one) = (R::of(0.0), R::of(1.0));
    let [value, smallest] = extremes([red, green, blue]);
    let chroma = value - smallest;
    let saturation = if value != zero { chroma / value } else { zero };
    let [lacks_red, lacks_green, lacks_blue] = [red, green, blue].mapped(|channel| quotient(value - channel, chroma));
    // Selections, no branches: which channel is the largest is not worth predicting.
    let [from_red, from_green, from_blue] =
        [lacks_blue - lacks_green, (R::of(2.0) + lacks_red) - lacks_blue, (R::of(4.0) + lacks_green) - lacks_red];
    let sixths = if green == value { from_green } else { from_blue };
    let sixths = if red == value { from_red } else { sixths };
    let hue = sixths * R::of(1.0 / 6.0);
    let hue = if hue < zero { hue + one } else { hue };
    [if saturation == zero { zero } else { hue }, saturation, value]
}

/// The colour of a hue, saturation and value.
#[inline(always)]
pub fn hsv_to_rgb<R: Real>([hue, saturation, value]: [R; 3]) -> [R; 3] {
    let (zero, one) = (R::of(0.0), R::of(1.0));
    let sixths = (if hue == one { zero } else { hue }) * R::of(6.0);
    // Within a turn the sectors meet without a jump.
    let turns_once = sixths > zero && sixths < R::of(6.0);
    let sector = if turns_once { sixths.lattice_floor() } else { sixths.floor() };
    let place = sixths - sector;
    let least = value * (one - saturation);
    let falling = value * (one - saturation * place);
    let rising = value * (one - saturation * (one - place));
    // Selections, no branches: sectors are not worth predicting. All that are not the first five are as the sixth.
    let is = |number: f32| sector == R::of(number);
    let chosen = |condition: bool, a: R, b: R| if condition { a } else { b };
    let red = chosen(is(4.0), rising, value);
    let red = chosen(is(1.0), falling, chosen(is(2.0) | is(3.0), least, red));
    let green = chosen(is(3.0), falling, least);
    let green = chosen(is(0.0), rising, chosen(is(1.0) | is(2.0), value, green));
    let blue = chosen(is(2.0), rising, falling);
    let blue = chosen(is(0.0) | is(1.0), least, chosen(is(3.0) | is(4.0), value, blue));
    [red, green, blue].mapped(|channel| chosen(saturation == zero, value, channel))
}

/// Hue, saturation and lightness of a colour.
#[inline(always)]
pub fn rgb_to_hsl<R: Real>([red, green, blue]: [R; 3]) -> [R; 3] {
    let (zero, two) = (R::of(0.0), R::of(2.0));
    let [largest, smallest] = extremes([red, green, blue]);
    let lightness = R::of(1.0).lesser((largest + smallest) / two);
    if largest == smallest {
        return [zero, zero, lightness];
    }
    let chroma = largest - smallest;
    let saturation =
        if lightness > R::of(0.5) { chroma / ((two - largest) - smallest) } else { chroma / (largest + smallest) };
    let sixths = if largest == red {
        (green - blue) / chroma + R::of(if green < blue { 6.0 } else { 0.0 })
    } else if largest == green {
        (blue - red) / chroma + two
    } else {
        (red - green) / chroma + R::of(4.0)
    };
    [sixths * R::of(1.0 / 6.0), saturation, lightness]
}

/// The colour of a hue, saturation and lightness.
#[inline(always)]
pub fn hsl_to_rgb<R: Real>([hue, saturation, lightness]: [R; 3]) -> [R; 3] {
    let (one, two) = (R::of(1.0), R::of(2.0));
    let sixths = hue * R::of(6.0);
    let pure = [
        ((sixths - R::of(3.0)).abs() - one).saturate(),
        (two - (sixths - two).abs()).saturate(),
        (two - (sixths - R::of(4.0)).abs()).saturate(),
    ];
    let chroma = (one - (two * lightness - one).abs()) * saturation;
    pure.mapped(|channel| (channel - R::of(0.5)) * chroma + lightness)
}

/// Fills the columns of a colour output, point by point.
#[inline(always)]
pub(super) fn fill<R: Real>(outputs: &mut [&mut [R]], color_at: impl Fn(usize) -> [R; 3]) {
    let [red, green, blue] = vector_output(outputs);
    for index in 0..red.len() {
        [red[index], green[index], blue[index]] = color_at(index);
    }
}

/// Encloses [`extremes`].
fn enclose_extremes([red, green, blue]: [Interval; 3]) -> [Interval; 2] {
    [red.fmax(green.fmax(blue)), red.lesser(green.lesser(blue))]
}

/// Encloses both hues, HSV's and HSL's: they are the same number, rounded differently.
fn enclose_hue(color: [Interval; 3], largest: Interval, smallest: Interval) -> Interval {
    // The six sixths are multiplied by a rounded 1/6.
    let turn = Interval::outward(0.0, 1.0, false);
    let chroma = largest - smallest;
    if color.iter().any(|channel| !channel.is_finite()) || !chroma.is_finite() {
        // Infinite chroma divides infinite differences.
        return turn.or_nan(true);
    }
    if chroma.low <= 0.0 {
        return turn;
    }
    let mut result: Option<Interval> = None;
    for (index, channel) in color.iter().enumerate() {
        let (next, last) = (color[(index + 1) % 3], color[(index + 2) % 3]);
        if channel.high < next.low || channel.high < last.low {
            continue;
        }
        // From the hue of the largest channel towards the larger one of the others.
        let offset = (next - last).divide(chroma).meet(Interval::outward(-1.0, 1.0, false));
        let [low, high] = offset.ends();
        let found = if index > 0 || low > ROUNDING || offset.as_point() == Some(0.0) {
            let begin = 2.0 * index as f64;
            let error = if begin + low == 0.0 && begin + high == 0.0 { 0.0 } else { ROUNDING };
            Interval::with_error((begin + low) / 6.0, (begin + high) / 6.0, error, false).meet(turn)
        } else if high < -ROUNDING {
            Interval::with_error((6.0 + low) / 6.0, (6.0 + high) / 6.0, ROUNDING, false).meet(turn)
        } else {
            // Across red, where the hue jumps between 0 and 1.
            turn
        };
        result = Some(result.map_or(found, |known| known.hull(found)));
    }
    let result = result.unwrap_or(turn);
    // Black has no hue.
    if largest.flushed().has_zero() { result.hull(Interval::ZERO) } else { result }
}

/// Encloses HSV's saturation.
fn enclose_saturation(largest: Interval, smallest: Interval) -> Interval {
    if !largest.is_finite() || !smallest.is_finite() {
        return Interval::EVERYTHING;
    }
    // Below this, flushed channels would count.
    const DARK: f32 = 1e-30;
    let ([a, b], [c, d]) = (largest.ends(), smallest.ends());
    let corners = || [1.0 - c / a, 1.0 - c / b, 1.0 - d / a, 1.0 - d / b];
    let low = || corners().into_iter().fold(f64::INFINITY, f64::min);
    let high = || corners().into_iter().fold(f64::NEG_INFINITY, f64::max);
    if largest.low > DARK {
        // The difference of the two may overflow although the quotient does not.
        let high = if (largest - smallest).is_finite() { high() } else { f64::INFINITY };
        Interval::with_error(low(), high, ROUNDING, false).greater(Interval::ZERO)
    } else if largest.high < -DARK {
        Interval::with_error(low(), high(), ROUNDING, false).lesser(Interval::ZERO)
    } else {
        let high = match (largest.high > 0.0, smallest.low >= 0.0) {
            (false, _) => 0.0,
            (true, true) => 1.0,
            (true, false) => f64::INFINITY,
        };
        Interval::outward(if largest.low < 0.0 { f64::NEG_INFINITY } else { 0.0 }, high, false)
    }
}

/// Encloses [`rgb_to_hsv`].
pub fn enclose_rgb_to_hsv(color: [Interval; 3]) -> [Interval; 3] {
    let [largest, smallest] = enclose_extremes(color);
    [enclose_hue(color, largest, smallest), enclose_saturation(largest, smallest), largest]
}

/// Encloses [`hsv_to_rgb`]: the hull over the sectors that the hue reaches.
pub fn enclose_hsv_to_rgb([hue, saturation, value]: [Interval; 3]) -> [Interval; 3] {
    let least = value * (Interval::ONE - saturation);
    let within = |sector: usize, place: Interval| {
        let falling = value * (Interval::ONE - saturation * place);
        let rising = value * (Interval::ONE - saturation * (Interval::ONE - place));
        match sector {
            0 => [value, rising, least],
            1 => [falling, value, least],
            2 => [least, value, rising],
            3 => [least, falling, value],
            4 => [rising, least, value],
            _ => [value, least, falling],
        }
    };
    let mut result: Option<[Interval; 3]> = None;
    let mut add = |part: [Interval; 3]| {
        result = Some(result.map_or(part, |known| each(|channel| known[channel].hull(part[channel]))));
    };
    if saturation.flushed().has_zero() {
        add([value; 3]);
    }
    if hue.contains(1.0) {
        add(within(0, Interval::ZERO));
    }
    let sixths = hue * Interval::point(6.0);
    if !sixths.is_finite() {
        // Infinity has no place within its sector.
        add(within(5, Interval::EVERYTHING));
    }
    if hue.as_point() != Some(1.0) {
        let low = f64::from(sixths.low);
        // A hue below 1 stays below six sixths when it is rounded.
        let high = if hue.high <= 1.0 { f64::from(sixths.high).min(6.0) } else { f64::from(sixths.high) };
        for sector in 0..6 {
            let begin = f64::from(sector);
            if low < begin + 1.0 && high >= begin {
                let (first, last) = (low.max(begin) - begin, high.min(begin + 1.0) - begin);
                add(within(sector as usize, Interval::with_error(first, last, ROUNDING, false)));
            }
        }
        if low < 0.0 || high > 6.0 {
            // A fused product keeps what the rounding of the sixths took.
            let error = ROUNDING * (1.0 + sixths.magnitude());
            add(within(5, Interval::with_error(0.0, 1.0, error, false)));
        }
    }
    result.unwrap_or([Interval::EVERYTHING; 3])
}

/// Encloses [`rgb_to_hsl`].
pub fn enclose_rgb_to_hsl(color: [Interval; 3]) -> [Interval; 3] {
    let [largest, smallest] = enclose_extremes(color);
    let chroma = largest - smallest;
    let sum = largest + smallest;
    let lightness = Interval::ONE.lesser(sum * Interval::point(0.5));
    let mut saturation: Option<Interval> = None;
    let mut add = |part: Interval| saturation = Some(saturation.map_or(part, |known| known.hull(part)));
    if chroma.has_zero() || chroma.may_be_nan {
        add(Interval::ZERO);
    }
    if lightness.high > 0.5 {
        add(chroma.divide((Interval::point(2.0) - largest) - smallest));
    }
    if lightness.low <= 0.5 || lightness.may_be_nan {
        add(chroma.divide(sum));
    }
    let mut saturation = saturation.unwrap_or(Interval::EVERYTHING);
    let is_finite = color.iter().all(|channel| channel.is_finite());
    if is_finite && smallest.low >= 0.0 && largest.high <= 1.0 {
        // Neither divisor is smaller than the chroma.
        saturation = saturation.meet(Interval::outward(0.0, 1.0, false));
    }
    [enclose_hue(color, largest, smallest), saturation, lightness]
}

/// Encloses [`hsl_to_rgb`].
pub fn enclose_hsl_to_rgb([hue, saturation, lightness]: [Interval; 3]) -> [Interval; 3] {
    let (one, two) = (Interval::ONE, Interval::point(2.0));
    let sixths = hue * Interval::point(6.0);
    let pure = [
        ((sixths - Interval::point(3.0)).abs() - one).saturate(),
        (two - (sixths - two).abs()).saturate(),
        (two - (sixths - Interval::point(4.0)).abs()).saturate(),
    ];
    let chroma = (one - (two * lightness - one).abs()) * saturation;
    let is_ordinary =
        saturation.low >= 0.0 && saturation.high <= 1.000_002 && saturation.is_finite() && lightness.is_finite();
    pure.mapped(|channel| {
        let amount = channel - Interval::point(0.5);
        let result = amount * chroma + lightness;
        if !is_ordinary || !result.is_finite() {
            return result;
        }
        // For a fixed factor of the chroma, at most 1/2 in magnitude, a channel does not fall as the lightness rises.
        let factors = (amount * saturation).ends();
        let [darkest, lightest] = lightness.ends();
        let at = |lightness: f64, factor: f64| lightness + factor * (1.0 - (2.0 * lightness - 1.0).abs());
        let low = at(darkest, factors[0]).min(at(darkest, factors[1]));
        let high = at(lightest, factors[0]).max(at(lightest, factors[1]));
        let error = 4.0 * ROUNDING * (1.0 + 4.0 * lightness.magnitude());
        Interval::with_error(low, high, error, false).meet(result)
    })
}

// ---------------------------------------------------------------------------------------------------------------------
// As Blender's own library converts

/// The conversions of Blender's own library, which makes the tables of colour ramps and folds constants before Cycles
/// sees a graph. The same colours as the kernels' conversions up to the last bits, in f32 only; a hue below 0 or
/// beyond a turn is not brought back.
pub mod blender {
    /// Hue, saturation and value, found by sorting the channels.
    pub fn rgb_to_hsv([mut red, mut green, mut blue]: [f32; 3]) -> [f32; 3] {
        let mut offset = 0.0;
        if green < blue {
            std::mem::swap(&mut green, &mut blue);
            offset = -1.0;
        }
        let mut least = blue;
        if red < green {
            std::mem::swap(&mut red, &mut green);
            offset = -2.0 / 6.0 - offset;
            least = if green < blue { green } else { blue };
        }
        let chroma = red - least;
        let hue = (offset + (green - blue) / (6.0 * chroma + 1e-20)).abs();
        [hue, chroma / (red + 1e-20), red]
    }

    /// The colour of a hue, saturation and value.
    pub fn hsv_to_rgb([hue, saturation, value]: [f32; 3]) -> [f32; 3] {
        pure(hue).map(|channel| ((channel - 1.0) * saturation + 1.0) * value)
    }

    /// Hue, saturation and lightness, with a true division by 6.
    pub fn rgb_to_hsl([red, green, blue]: [f32; 3]) -> [f32; 3] {
        let most = red.max(green).max(blue);
        let least = red.min(green).min(blue);
        let lightness = ((most + least) / 2.0).min(1.0);
        if most == least {
            return [0.0, 0.0, lightness];
        }
        let chroma = most - least;
        let saturation = if lightness > 0.5 { chroma / ((2.0 - most) - least) } else { chroma / (most + least) };
        let sixths = if most == red {
            (green - blue) / chroma + if green < blue { 6.0 } else { 0.0 }
        } else if most == green {
            (blue - red) / chroma + 2.0
        } else {
            (red - green) / chroma + 4.0
        };
        [sixths / 6.0, saturation, lightness]
    }

    /// The colour of a hue, saturation and lightness.
    pub fn hsl_to_rgb([hue, saturation, lightness]: [f32; 3]) -> [f32; 3] {
        let chroma = (1.0 - (2.0 * lightness - 1.0).abs()) * saturation;
        pure(hue).map(|channel| (channel - 0.5) * chroma + lightness)
    }

    /// The three channels of a pure hue.
    fn pure(hue: f32) -> [f32; 3] {
        let turns = hue * 6.0;
        [(turns - 3.0).abs() - 1.0, 2.0 - (turns - 2.0).abs(), 2.0 - (turns - 4.0).abs()]
            .map(|channel| channel.clamp(0.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::real::Oracle;

    #[test]
    fn hues_beyond_a_turn_stay_in_the_last_sector() {
        // 1.25 turns are seven and a half sixths: the half of the last sector, not of the second one.
        assert_eq!(hsv_to_rgb([1.25_f32, 1.0, 1.0]), [1.0, 0.0, 0.5]);
        assert_eq!(hsv_to_rgb([-0.25_f32, 1.0, 1.0]), [1.0, 0.0, 0.5]);
        assert_eq!(hsv_to_rgb([1.0_f32, 1.0, 1.0]), [1.0, 0.0, 0.0]);
        assert_eq!(hsv_to_rgb([f32::NAN, 0.0, 0.5]), [0.5; 3]);
        let [red, green, blue] = hsv_to_rgb([f32::NAN, 0.5, 1.0]);
        assert!(red == 1.0 && green == 0.5 && blue.is_nan());
    }

    #[test]
    fn library_and_kernels_convert_to_nearly_the_same() {
        type Convert = fn([f32; 3]) -> [f32; 3];
        let pairs: [[Convert; 2]; 4] = [
            [blender::rgb_to_hsv, rgb_to_hsv],
            [blender::hsv_to_rgb, hsv_to_rgb],
            [blender::rgb_to_hsl, rgb_to_hsl],
            [blender::hsl_to_rgb, hsl_to_rgb],
        ];
        let levels = [0.0_f32, 0.2, 0.45, 0.7, 0.95];
        for number in 0..125 {
            let values = [levels[number % 5], levels[number / 5 % 5], levels[number / 25]];
            for [library, kernel] in pairs {
                let (found, expected) = (library(values), kernel(values));
                let near = found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6);
                assert!(near, "{values:?}: {found:?}, {expected:?}");
            }
        }
        // Grey has no hue, and black no saturation to divide by.
        assert_eq!(blender::rgb_to_hsv([0.4; 3]), [0.0, 0.0, 0.4]);
        assert_eq!(blender::rgb_to_hsv([0.0; 3]), [0.0; 3]);
        // Beyond a turn the hue is red.
        assert_eq!(blender::hsv_to_rgb([1.25, 1.0, 1.0]), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn negative_and_bright_channels_are_not_clamped() {
        let [hue, saturation, value] = rgb_to_hsv([-1.0_f32, 2.0, 0.5]);
        assert_eq!((saturation, value), (1.5, 2.0));
        assert!((hue - 5.0 / 12.0).abs() < 1e-7);
        assert_eq!(rgb_to_hsv([-1.0_f32, -2.0, -4.0])[1..], [-3.0, -1.0]);
        assert_eq!(rgb_to_hsv([0.0_f32, -2.0, -4.0]), [0.0, 0.0, 0.0]);
        // Lightness ends at 1; the saturation of bright colours may be negative.
        assert_eq!(rgb_to_hsl([3.0_f32, 1.0, 1.0]), [0.0, -1.0, 1.0]);
        assert_eq!(rgb_to_hsl([0.0_f32, 0.25, 0.5])[1..], [1.0, 0.25]);
    }

    #[test]
    fn a_missing_number_is_not_the_largest_channel() {
        let [hue, saturation, value] = rgb_to_hsv([f32::NAN, 1.0, 0.5]);
        assert!(hue.is_nan());
        assert_eq!((saturation, value), (0.5, 1.0));
        assert!(rgb_to_hsv([1.0_f32, 0.5, f32::NAN])[1].is_nan());
        assert_eq!(rgb_to_hsv([0.0_f32, 0.0, f32::NAN])[..2], [0.0, 0.0]);
    }

    #[test]
    fn colours_come_back() {
        let levels = [0.0_f64, 0.2, 0.45, 0.5, 0.7, 1.0];
        for red in levels {
            for green in levels {
                for blue in levels {
                    let color = [red, green, blue];
                    for space in [ColorSpace::Hsv, ColorSpace::Hsl] {
                        let found = space.combine(space.separate(color));
                        // The rounded 1/6 is 5e-9 off, times 24.
                        let near = found.iter().zip(color).all(|(a, b)| (a - b).abs() < 2e-7);
                        assert!(near, "{space:?} {color:?}: {found:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn bounds_hold_the_values() {
        let infinity = f32::INFINITY;
        let ends = [
            [0.0_f32, 0.0],
            [0.25, 0.25],
            [0.3, 0.300_001],
            [0.2, 0.9],
            [0.0, 1.0],
            [1.0, 1.0],
            [0.999_999_9, 1.5],
            [-0.4, 0.1],
            [-3.0, -0.5],
            [2.0, 4e7],
            [-1e-40, 1e-38],
            [-3e38, 3e38],
            [1.0, infinity],
        ];
        type Pair<R> = (fn([R; 3]) -> [R; 3], fn([Interval; 3]) -> [Interval; 3]);
        fn check<R: Real>(input: [Interval; 3], values: [f32; 3], number: usize) {
            let functions: [Pair<R>; 4] = [
                (rgb_to_hsv, enclose_rgb_to_hsv),
                (hsv_to_rgb, enclose_hsv_to_rgb),
                (rgb_to_hsl, enclose_rgb_to_hsl),
                (hsl_to_rgb, enclose_hsl_to_rgb),
            ];
            let (function, enclose) = functions[number];
            let (found, bounds) = (function(values.map(R::of)).map(R::to_f64), enclose(input));
            for (value, bound) in found.iter().zip(bounds) {
                assert!(bound.contains(*value), "function {number}, {values:?} of {input:?}: {found:?}, {bounds:?}");
            }
        }
        for first in ends {
            for second in ends {
                for third in ends {
                    let boxes = [first, second, third];
                    let input = boxes.map(|[low, high]| Interval::new(low, high));
                    for point in 0..27_usize {
                        let values = std::array::from_fn(|axis| {
                            let [low, high] = boxes[axis];
                            [low, 0.5 * low + 0.5 * high, high][point / 3_usize.pow(axis as u32) % 3]
                        });
                        for number in 0..4 {
                            check::<f32>(input, values, number);
                            check::<Oracle>(input, values, number);
                            check::<f64>(input, values, number);
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn bounds_of_small_boxes_are_tight() {
        let color = [0.6_f32, 0.3, 0.5];
        let around = color.map(|channel| Interval::new(channel - 1e-4, channel + 1e-4));
        for bounds in
            [enclose_rgb_to_hsv, enclose_hsv_to_rgb, enclose_rgb_to_hsl, enclose_hsl_to_rgb].map(|f| f(around))
        {
            assert!(bounds.iter().all(|bound| bound.high - bound.low < 4e-3), "{bounds:?}");
        }
    }
}
