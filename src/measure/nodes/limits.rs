//! How far an output may be from Cycles, per node, mode and output, and why.
//!
//! The CPU must equal Cycles' SSE4.2 kernel except where the C library computes: both call one, but
//! not necessarily the same build, and such functions are within 1 ulp of each other. WGSL may fuse,
//! reassociate and divide with 2.5 ulp, so its limits are what Cycles' own two kernels (SSE4.2 without,
//! AVX2 with fused operations) were measured to differ by, or ulps where WGSL states an accuracy.

use crate::measure::errors::values::{equal, ulp_distance};
use crate::nodes::{Mode, NodeType};

/// A largest difference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limit {
    /// Largest |ours - Cycles| / max(1, |Cycles|).
    pub error: f64,
    /// Enough by itself: this many units in the last place.
    pub ulps: u32,
    /// The output jumps: a difference in the last bit of an intermediate puts a point on the other
    /// side, so 1e-5 of the points may be beyond the limit.
    pub jumps: bool,
    /// Where it comes from.
    pub source: &'static str,
}

/// Share of points that an output that jumps may have beyond its limit.
const JUMPING_SHARE: f64 = 1e-5;

/// Equal bits.
pub const EQUAL: Limit = limit(0.0, "plain f32 arithmetic in Cycles' order: equal bits");

/// Sums of products of an implicit conversion, which WGSL may fuse.
pub const CONVERSION: Limit = limit(2.4e-7, "fused sums of three products: 2 ulp of the largest term");

const fn limit(error: f64, source: &'static str) -> Limit {
    Limit { error, ulps: 0, jumps: false, source }
}

const fn ulps(ulps: u32, source: &'static str) -> Limit {
    Limit { error: 0.0, ulps, jumps: false, source }
}

const fn jumping(error: f64, source: &'static str) -> Limit {
    Limit { error, ulps: 0, jumps: true, source }
}

/// |ours - theirs| / max(1, |theirs|).
pub fn relative_error(ours: f32, theirs: f32) -> f64 {
    (f64::from(ours) - f64::from(theirs)).abs() / f64::from(theirs.abs()).max(1.0)
}

impl Limit {
    /// Whether one pair of values is within the limit.
    pub fn allows(&self, ours: f32, theirs: f32) -> bool {
        equal(ours, theirs)
            || (ours.is_finite()
                && theirs.is_finite()
                && (relative_error(ours, theirs) <= self.error || ulp_distance(ours, theirs) <= self.ulps))
    }

    /// How many of `points` may be beyond the limit.
    pub fn allowed_points(&self, points: usize) -> usize {
        if self.jumps { (points as f64 * JUMPING_SHARE).ceil() as usize } else { 0 }
    }

    /// In words.
    pub fn describe(&self) -> String {
        let mut text = match (self.error, self.ulps) {
            (0.0, 0) => "equal".to_owned(),
            (0.0, ulps) => format!("{ulps} ulp"),
            (error, 0) => format!("{error:.1e}"),
            (error, ulps) => format!("{error:.1e} or {ulps} ulp"),
        };
        if self.jumps {
            text += " but for 1e-5 of the points";
        }
        format!("{text}: {}", self.source)
    }
}

/// Functions of the C library, measured against Cycles (relative to max(1, |value|)).
const LIBRARY: &str = "C library function: 1 ulp between builds";

/// The limit of f32 on the CPU.
pub fn cpu(node_type: &NodeType, mode: &Mode, output: &str) -> Limit {
    match node_type.module {
        "math" => match mode.choice("operation") {
            "LOGARITHM" | "EXPONENT" | "TANGENT" => limit(1.1e-7, LIBRARY),
            "SINE" | "COSINE" | "TANH" => limit(6.0e-8, LIBRARY),
            "ARCSINE" | "ARCCOSINE" | "ARCTANGENT" | "ARCTAN2" | "SINH" | "COSH" => limit(1.2e-7, LIBRARY),
            _ => EQUAL,
        },
        "vector_math" => match mode.choice("operation") {
            "POWER" | "SINE" | "COSINE" | "TANGENT" => limit(1.2e-7, LIBRARY),
            _ => EQUAL,
        },
        // Sines and cosines of the angles; a division by a small scale magnifies them.
        "mapping" => match mode.choice("vector_type") {
            "TEXTURE" => limit(3.0e-5, LIBRARY),
            _ => limit(9.5e-7, LIBRARY),
        },
        "vector_rotate" => limit(4.0e-7, LIBRARY),
        "gamma" => limit(1.2e-7, LIBRARY),
        "gradient_texture" if mode.choice("gradient_type") == "RADIAL" => limit(1.2e-7, LIBRARY),
        "wave_texture" if mode.choice("wave_profile") == "SIN" => limit(6.0e-8, LIBRARY),
        // At Distortions up to 2.7: an ulp of the library in every sine, amplified once per step. (The specification measured
        // 7.2e-7, 1.1e-5 and 2.5e-4 at depths 2, 5 and 10; these are the largest of 4608 points with nudged sines.)
        "magic_texture" => limit(
            match mode.integer("turbulence_depth") {
                0..=2 => 2.6e-6,
                3..=5 => 1.6e-5,
                6..=7 => 9.0e-5,
                8..=9 => 5.1e-4,
                _ => 1.9e-3,
            },
            "C library's sine, amplified with Distortion^depth",
        ),
        "gabor_texture" => match output {
            // Jumps from 1 to 0 on the negative real axis.
            "Phase" => jumping(1.6e-6, LIBRARY),
            _ => limit(1.5e-7, LIBRARY),
        },
        "voronoi_texture" if is_minkowski(mode) => {
            limit(4.8e-7, "C library's pow, twice per cell: measured at exponents 0.5 and 2.7")
        }
        _ => EQUAL,
    }
}

fn is_minkowski(mode: &Mode) -> bool {
    mode.choice("distance") == "MINKOWSKI"
}

const EXACT: &str = "exact in WGSL";
/// Of nodes without an entry: those that a program adds at run time are held to equality.
const NO_ENTRY: &str = "no entry: equal values";
const DIVISION: &str = "WGSL divides with 2.5 ulp and takes square roots through inverseSqrt";
const HUE: &str = "WGSL divides with 2.5 ulp, which a hue of six sixths multiplies";
const TRANSCENDENTAL: &str = "own elementary functions of the shader modules";
const KERNELS: &str = "what Cycles' SSE4.2 and AVX2 kernels differ by: fused operations";

/// The limit of WGSL on ordinary points; `distorted` is the noise variant with distortion, fractional
/// detail and lacunarity.
pub fn wgsl(node_type: &NodeType, mode: &Mode, output: &str, distorted: bool) -> Limit {
    match node_type.module {
        "math" => math(mode.choice("operation")),
        "vector_math" => vector_math(mode.choice("operation")),
        "map_range" => match mode.choice("interpolation_type") {
            "LINEAR" => limit(2.6e-7, KERNELS),
            "STEPPED" => jumping(2.6e-7, KERNELS),
            "SMOOTHSTEP" => limit(6.4e-7, KERNELS),
            _ => limit(3.9e-6, KERNELS),
        },
        "noise_texture" => match (distorted, output) {
            (false, _) => limit(1.7e-6, KERNELS),
            (true, "Color") => limit(5.2e-4, KERNELS),
            (true, _) => limit(6.7e-5, KERNELS),
        },
        "voronoi_texture" => voronoi(mode, output),
        "mix" if mode.choice("data_type") != "RGBA" => limit(2.3e-6, KERNELS),
        "mix" | "mix_rgb" => match mode.choice("blend_type") {
            // Near the pole of the quotient.
            "DODGE" => limit(1.3e-4, KERNELS),
            _ => limit(4.3e-6, KERNELS),
        },
        "separate_color" => match (mode.choice("mode"), output) {
            ("HSV", "Red") => jumping(4.8e-7, HUE),
            ("HSL", "Red") => limit(4.8e-7, HUE),
            ("HSV" | "HSL", "Green") => ulps(4, DIVISION),
            _ => limit(0.0, EXACT),
        },
        "combine_color" => match mode.choice("mode") {
            "RGB" => limit(0.0, EXACT),
            _ => limit(2.4e-7, KERNELS),
        },
        "invert" | "bright_contrast" => limit(3.6e-7, KERNELS),
        "gamma" => ulps(16, TRANSCENDENTAL),
        "hue_saturation" => limit(1.2e-6, HUE),
        "rgb_to_bw" => CONVERSION,
        "blackbody" => limit(7.2e-7, DIVISION),
        "gradient_texture" => match mode.choice("gradient_type") {
            "LINEAR" => limit(0.0, EXACT),
            // Distances up to 1: 4.5 ulp of the square root, which the square doubles.
            "SPHERICAL" => limit(2.7e-7, DIVISION),
            "QUADRATIC_SPHERE" => limit(5.4e-7, DIVISION),
            // 5 ulp of pi, over 2 pi, and two roundings.
            "RADIAL" => limit(2.6e-7, TRANSCENDENTAL),
            _ => limit(1.2e-7, KERNELS),
        },
        "wave_texture" => match mode.choice("wave_profile") {
            "SAW" => jumping(1.1e-5, KERNELS),
            _ => limit(1.1e-5, KERNELS),
        },
        // At Distortions from 0.5 to 1: 2 ulp per sine.
        "magic_texture" => limit(if mode.integer("turbulence_depth") <= 2 { 6.0e-7 } else { 1.5e-6 }, TRANSCENDENTAL),
        // A fused product may put a point on the other side of a face (Cycles' kernels do not differ).
        "checker_texture" => jumping(0.0, KERNELS),
        // Continuous across faces while there is mortar on both sides.
        "brick_texture" => match output {
            "Color" => limit(8.9e-6, KERNELS),
            _ => limit(4.2e-6, KERNELS),
        },
        "gabor_texture" => match output {
            "Phase" => jumping(2.6e-5, KERNELS),
            _ => limit(1.9e-7, KERNELS),
        },
        "mapping" => match mode.choice("vector_type") {
            "TEXTURE" => limit(3.0e-5, TRANSCENDENTAL),
            _ => limit(1.1e-6, TRANSCENDENTAL),
        },
        "vector_rotate" => limit(1.1e-6, TRANSCENDENTAL),
        "vector_transform" => limit(1.7e-6, KERNELS),
        "normal" => limit(2.4e-7, DIVISION),
        "color_ramp" => limit(1.2e-7, KERNELS),
        "float_curve" | "rgb_curve" | "vector_curve" => limit(2.4e-7, KERNELS),
        "affine" | "clamp" | "combine_xyz" | "separate_xyz" | "white_noise_texture" => limit(0.0, EXACT),
        "conversion" => CONVERSION,
        _ => limit(0.0, NO_ENTRY),
    }
}

fn math(operation: &str) -> Limit {
    match operation {
        "DIVIDE" | "SQRT" | "INVERSE_SQRT" => ulps(4, DIVISION),
        "MULTIPLY_ADD" => limit(2.2e-7, KERNELS),
        "SMOOTH_MIN" | "SMOOTH_MAX" => limit(2.4e-7, KERNELS),
        "FLOORED_MODULO" | "WRAP" => jumping(4.8e-7, KERNELS),
        "SNAP" => jumping(0.0, DIVISION),
        "PINGPONG" => limit(4.8e-7, DIVISION),
        "POWER" | "LOGARITHM" | "EXPONENT" | "SINE" | "COSINE" | "TANGENT" | "ARCSINE" | "ARCCOSINE" | "ARCTANGENT"
        | "ARCTAN2" | "SINH" | "COSH" | "TANH" => ulps(16, TRANSCENDENTAL),
        _ => limit(0.0, EXACT),
    }
}

fn vector_math(operation: &str) -> Limit {
    match operation {
        "DIVIDE" => ulps(4, DIVISION),
        "MULTIPLY_ADD" | "CROSS_PRODUCT" | "REFLECT" => limit(8.9e-7, KERNELS),
        "REFRACT" => limit(3.1e-6, KERNELS),
        "PROJECT" | "DOT_PRODUCT" | "DISTANCE" | "LENGTH" | "NORMALIZE" => limit(8.9e-7, KERNELS),
        "MODULO" | "WRAP" => jumping(4.8e-7, KERNELS),
        "SNAP" => jumping(0.0, DIVISION),
        "POWER" | "SINE" | "COSINE" | "TANGENT" => ulps(16, TRANSCENDENTAL),
        _ => limit(0.0, EXACT),
    }
}

fn voronoi(mode: &Mode, output: &str) -> Limit {
    let smooth = mode.choice("feature") == "SMOOTH_F1";
    match (mode.choice("feature"), output) {
        ("DISTANCE_TO_EDGE", _) => limit(1.2e-6, KERNELS),
        ("N_SPHERE_RADIUS", _) => jumping(1.2e-7, KERNELS),
        (_, "Distance") if smooth => limit(4.8e-7, KERNELS),
        (_, "Distance") => limit(7.2e-7, KERNELS),
        (_, "Color") if smooth => limit(7.2e-7, KERNELS),
        (_, "Color") => jumping(if is_minkowski(mode) { 6.0e-7 } else { 2.4e-7 }, KERNELS),
        (_, _) if smooth => limit(9.5e-7, KERNELS),
        _ => jumping(1.9e-6, KERNELS),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_of_zero_allows_equal_values_only() {
        assert!(EQUAL.allows(0.0, -0.0));
        assert!(EQUAL.allows(f32::NAN, f32::NAN));
        assert!(!EQUAL.allows(1.0, 1.000_000_1));
        assert!(!limit(1.0, "").allows(f32::INFINITY, 1.0));
    }

    #[test]
    fn jumping_outputs_may_miss_ten_points_in_a_million() {
        assert_eq!(jumping(0.0, "").allowed_points(1_000_000), 10);
        assert_eq!(EQUAL.allowed_points(1_000_000), 0);
    }
}
