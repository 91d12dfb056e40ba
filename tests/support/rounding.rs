//! What f32 may be off by, on the CPU and on an adapter: bounds that are derived, not measured.

use cloudparity::engines::passes::god_rays::GodRays;
use cloudparity::nodes::perlin_fbm::bake::Bake;
use cloudparity::nodes::perlin_fbm::random::{Permutation, permutation};
use cloudparity::nodes::running_error::RunningError;
use rayon::prelude::*;

/// Largest relative error of one rounding to f32. WGSL's division is off by 5 of them, its square root by 9 (2 ulp of `inverseSqrt` and a
/// division).
pub const U: f64 = 1.0 / 16_777_216.0;

/// Who computes in f32.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Single {
    /// Rust, in the order that is written.
    Cpu,
    /// An adapter, as WGSL lets it.
    Adapter,
}

/// How far the blended noise of a bake in f32 may be from the exact one at a place of the unit box.
///
/// Running error analysis follows every operation of the CPU's text. The adapter sums in another order: amplitudes are over their sum
/// before (one rounding each), octaves are added (one each), a place is a quotient (5), and so are its three weights (6 each with the
/// difference), with two products, four copies, and the last sum: at most 2 octaves + 28 roundings of numbers up to 1, halved at the end.
fn blend_error(bake: &Bake, table: &Permutation, place: [f64; 3], by: Single) -> f64 {
    let own = bake.blend::<RunningError>(table, place).error();
    own + if by == Single::Adapter { (f64::from(bake.octaves.count) + 14.0) * U } else { 0.0 }
}

/// Bytes, lowest and highest, that a bake in f32 may give where the blended noise is `value`, known to `error`.
///
/// The threshold is monotonic in a value that is not negative; below 0 a power is no number and the byte 0, or it is even. What is lost on
/// the way from the value to the byte: the power (below), its difference from the threshold's begin, which is rounded itself (2), over the
/// width (7, of the quotient), a slope of at most 1.5, and the cubic with the factor 255 (6).
fn bytes_within(bake: &Bake, value: f64, error: f64, by: Single) -> [u8; 2] {
    let width = 2.0 * bake.softness;
    let slack = 1.5 * ((power_error(bake.intensity, value, by) + 2.0 * U) / width + 7.0 * U) + 6.0 * U;
    let nearest_to_0 = value.signum() * (value.abs() - error).max(0.0);
    let ends = [value - error, value + error, nearest_to_0].map(|value| bake.density(value));
    let low = ends.into_iter().fold(f64::INFINITY, f64::min) - slack;
    let high = ends.into_iter().fold(0.0, f64::max) + slack;
    [low, high].map(|value| (value * 255.0).floor().clamp(0.0, 255.0) as u8)
}

/// Holds a bake in single precision against the double one, texel by texel: both have to be bytes that rounding leaves open, which must
/// not be more than two. The number of texels that differ.
pub fn check_bake(what: &str, bake: &Bake, side: usize, [ours, double]: [&[u8]; 2], by: Single) -> usize {
    assert!(ours.len() == side.pow(3) && double.len() == ours.len(), "{what}");
    let table = permutation(bake.seed);
    let differs = |index: usize| {
        let place = [index % side, index / side % side, index / side / side];
        let place = place.map(|number| number as f64 / (side - 1) as f64);
        let error = blend_error(bake, &table, place, by);
        let [low, high] = bytes_within(bake, bake.blend::<f64>(&table, place), error, by);
        assert!(high - low <= 1, "{what} at {place:?}: the limit leaves {low} to {high} open, {bake:?}");
        for byte in [ours[index], double[index]] {
            assert!((low..=high).contains(&byte), "{what} at {place:?}: {byte}, not {low} to {high}, {bake:?}");
        }
        ours[index] != double[index]
    };
    (0..ours.len()).into_par_iter().filter(|&index| differs(index)).count()
}

/// Of a power of a number up to about 1 in f32. The exponent is rounded, which counts p |ln x| x^p, at most 1/e. The C library is within
/// an ulp. An adapter's power is `exp2(p log2(x))`: the logarithm is off by 2^-21 or 3 ulp, the product by a rounding, the exponential by
/// 3 + 2 |p log2(x)| ulp.
fn power_error(exponent: f64, base: f64, by: Single) -> f64 {
    if exponent == 1.0 {
        return 0.0;
    }
    let base = base.clamp(f64::MIN_POSITIVE, 1.0);
    let power = base.powf(exponent);
    let logarithm = base.log2().abs();
    match by {
        Single::Cpu => U + 2.0 * U * power,
        Single::Adapter => {
            let off = exponent * (2.0_f64.powi(-21)).max(6.0 * U * logarithm) + U * exponent * logarithm;
            U + power * (std::f64::consts::LN_2 * off + (3.0 + 2.0 * exponent * logarithm) * 2.0 * U)
        }
    }
}

/// How far an adapter's blur of a layer of `size` texels from 0 to 1 may be off, where each texel is off by `texel` already.
///
/// Neighbours differ by at most 1. A place on the way has 4 roundings, of numbers up to the side, and as many of the way; a read six. The
/// weight of a read is a product of so many rounded numbers, and the sum has a rounding for each.
pub fn blur_error(rays: &GodRays, [width, height]: [usize; 2], texel: f64) -> f64 {
    let read = texel + 8.0 * U * (width as f64 + 1.0 + height as f64 + 1.0) + 6.0 * U;
    let (mut weight, mut sum, mut error) = (rays.weight, rays.centre, rays.centre * texel);
    for number in 0..rays.samples {
        error += weight * (read + 2.0 * (f64::from(number) + 2.0) * U);
        sum += weight;
        weight *= rays.decay;
    }
    rays.density * rays.exposure * (error + (f64::from(rays.samples) + 3.0) * U * sum)
}
