//! Gabor Texture (`ShaderNodeTexGabor`): sparse convolution noise in 2 or 3 dimensions (Lagae et al.,
//! "Procedural Noise using Sparse Gabor Convolution", 2009; phasors after Tavernier et al., "Making
//! Gabor Noise Fast and Normalized", 2019).
//!
//! Each cell of the lattice holds eight impulses at hashed places, with hashed signs and directions
//! that scatter about the orientation by what Anisotropy leaves. An impulse within distance 1 adds a
//! wave under an envelope that ends there; Value, Phase and Intensity are views of the complex sum.

mod bounds;
mod lanes;

use crate::base::arrays::{Mapped, each};
use crate::nodes::hash::hash_floats;
use crate::nodes::noise_texture::dimensions;
use crate::nodes::real::{Library, Real, dot, length};
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Property, Role, always, vector_at,
};
use crate::scene::SocketType;
use std::f32::consts::{FRAC_PI_4, PI, SQRT_2, TAU};

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeTexGabor",
    label: "Gabor Texture",
    module: "gabor_texture",
    shader: include_str!("../../shaders/nodes/gabor_texture.wgsl"),
    properties: &[Property::other("texture_mapping"), Property::choice("gabor_type", &["2D", "3D"])],
    inputs: &[
        InputSocket::coordinate(always),
        InputSocket::float("Scale", "Scale", &[5.0], always),
        InputSocket::float("Frequency", "Frequency", &[2.0], always),
        InputSocket::float("Anisotropy", "Anisotropy", &[1.0], always),
        InputSocket::float("Orientation 2D", "Orientation", &[FRAC_PI_4], |mode| mode.choice("gabor_type") == "2D"),
        InputSocket::vector("Orientation 3D", "Orientation", &[SQRT_2, SQRT_2, 0.0], |mode| {
            mode.choice("gabor_type") == "3D"
        }),
    ],
    outputs: &[
        OutputSocket::new("Value", SocketType::Float, always),
        OutputSocket::new("Phase", SocketType::Float, always),
        OutputSocket::new("Intensity", SocketType::Float, always),
    ],
    role: Role::Evaluated(|mode| {
        Box::new(GaborTexture {
            dimensions: dimensions(mode.choice("gabor_type")),
            value: mode.wants("Value"),
            phase: mode.wants("Phase"),
            intensity: mode.wants("Intensity"),
        })
    }),
};

/// Columns of the inputs after the coordinate.
const SCALE: usize = 3;
const FREQUENCY: usize = 4;
const ANISOTROPY: usize = 5;
const ORIENTATION: usize = 6;

/// Impulses per cell.
const IMPULSES: usize = 8;

/// Smallest frequency.
const LEAST_FREQUENCY: f32 = 0.001;

/// Rounded reciprocal that the kernel multiplies the angle with.
const INVERSE_TAU: f32 = 1.0 / TAU;

/// What the complex sum is divided by, in 2 and 3 dimensions: six standard deviations.
fn normalization<R: Real>(dimensions: usize) -> R {
    R::of(6.0) * R::of(if dimensions == 2 { 1.0 } else { 0.840_896_4 })
}

/// The node in one mode.
struct GaborTexture {
    dimensions: usize,
    value: bool,
    phase: bool,
    intensity: bool,
}

/// The waves of one point: what is equal for all of its impulses.
#[derive(Clone, Copy)]
struct Waves<R, const N: usize> {
    frequency: R,
    /// How far directions scatter: 0 where all have `common`.
    isotropy: R,
    /// Angle in the plane, or inclination and azimuth, that directions scatter about.
    angles: [R; 2],
    /// The wave vector where nothing scatters.
    common: [R; N],
}

/// Scales a direction; its third component does not exist in the plane.
#[inline(always)]
fn wave_vector<R: Real, const N: usize>(frequency: R, direction: [R; 3]) -> [R; N] {
    each(|axis| frequency * direction[axis])
}

impl<R: Real, const N: usize> Waves<R, N> {
    fn new(inputs: &[Column<'_, R>], index: usize) -> Self {
        let at = |column: usize| inputs[column].values[index];
        let zero = R::of(0.0);
        let frequency = R::of(LEAST_FREQUENCY).greater(at(FREQUENCY));
        let isotropy = R::of(1.0) - at(ANISOTROPY).saturate();
        let mut waves = Self { frequency, isotropy, angles: [zero; 2], common: [zero; N] };
        if N == 2 {
            let angle = at(ORIENTATION);
            if isotropy == zero {
                let [sine, cosine] = angle.sine_and_cosine();
                let direction = [cosine, sine, zero];
                waves.common = wave_vector(frequency, direction);
            } else {
                waves.angles[0] = angle;
            }
            return waves;
        }
        let orientation = vector_at(inputs, ORIENTATION, index);
        let norm = length(orientation);
        let [x, y, z] = orientation.mapped(|component| component / norm);
        if isotropy == zero {
            waves.common = wave_vector(frequency, [x, y, z]);
        } else {
            let azimuth = (x / length([x, y])).library(Library::Acos);
            let azimuth = if y < zero { -azimuth } else { azimuth };
            // Where the orientation's length underflows, both angles are NaN, of unlike signs; Cycles' is the azimuth's.
            let inclination = if azimuth.is_nan() { azimuth } else { z.library(Library::Acos) };
            waves.angles = [inclination, azimuth];
        }
        waves
    }

    /// Wave vector of an impulse with these random numbers (the second counts in 3D).
    #[inline(always)]
    fn scattered(&self, random: [R; 2]) -> [R; N] {
        let pi = R::of(PI);
        let [first, second] = self.angles;
        if N == 2 {
            let angle = first + ((random[0] - R::of(0.5)) * pi) * self.isotropy;
            let [sine, cosine] = angle.sine_and_cosine();
            return wave_vector(self.frequency, [cosine, sine, R::of(0.0)]);
        }
        let inclination = first + (random[0] * pi) * self.isotropy;
        let azimuth = second + (random[1] * pi) * self.isotropy;
        let [[sine, cosine], [azimuth_sine, azimuth_cosine]] = [inclination, azimuth].mapped(R::sine_and_cosine);
        wave_vector(self.frequency, [sine * azimuth_cosine, sine * azimuth_sine, cosine])
    }
}

/// Number of a cell's hash by a float seed. The variants hash the same numbers in another order.
#[inline]
fn random<R: Real, const N: usize>(cell: [R; N], seed: usize, variant: usize) -> R {
    let seed = R::of(seed as f32);
    match (N, variant) {
        (2, 0) => hash_floats([cell[0], cell[1], seed]),
        (2, _) => hash_floats([seed, cell[0], cell[1]]),
        (_, 0) => hash_floats([cell[0], cell[1], cell[2], seed]),
        (_, 1) => hash_floats([cell[2], cell[0], seed, cell[1]]),
        _ => hash_floats([seed, cell[2], cell[1], cell[0]]),
    }
}

/// Real and imaginary part of an impulse's wave at a squared distance below 1, where `projection` is the offset times the
/// wave vector. To be added to a sum that began with +0.
#[inline(always)]
fn phasor<R: Real>(square: R, projection: R, negative: bool) -> [R; 2] {
    let half = R::of(0.5);
    let bell = half + half * (R::of(PI) * square).library(Library::Cos);
    let envelope = (R::of(-PI) * square).library(Library::Exp) * bell;
    let [sine, cosine] = (R::of(TAU) * projection).sine_and_cosine();
    let parts = [envelope * cosine, envelope * sine];
    // Cycles multiplies by -1, which leaves a NaN its sign: White Noise shows it. A negation does not. (The sign of a zero is
    // nothing to the sum.)
    if negative { parts.mapped(|part| R::of(0.0) - part) } else { parts }
}

/// Offsets of the searched cells, first axis fastest.
#[inline(always)]
fn neighbours<const N: usize>() -> impl Iterator<Item = [f32; N]> {
    (0..3_usize.pow(N as u32)).map(|number| {
        let step = |axis: usize| (number / 3_usize.pow(axis as u32) % 3) as f32 - 1.0;
        each(step)
    })
}

impl<R: Real, const N: usize> Waves<R, N> {
    /// Real and imaginary part of the sum over the impulses around a point.
    fn sum(&self, p: [R; N]) -> [R; 2] {
        let corner = p.mapped(Real::lattice_floor);
        let fraction: [R; N] = each(|axis| (p[axis] - corner[axis]).round_coordinate());
        let scatters = self.isotropy != R::of(0.0);
        let mut total = [R::of(0.0); 2];
        for offset in neighbours::<N>() {
            let cell = each(|axis| (corner[axis] + R::of(offset[axis])).round_coordinate());
            let local: [R; N] = each(|axis| (fraction[axis] - R::of(offset[axis])).round_coordinate());
            let mut sum = [R::of(0.0); 2];
            for impulse in 0..IMPULSES {
                let seeds = [3 * impulse, 3 * impulse + 1, 3 * impulse + 2];
                let d: [R; N] = each(|axis| local[axis] - random(cell, seeds[1], axis));
                let square = dot(d, d);
                if square >= R::of(1.0) {
                    continue;
                }
                let wave = if scatters {
                    self.scattered([random(cell, seeds[0], 0), random(cell, seeds[0], 1)])
                } else {
                    self.common
                };
                let negative = random::<R, N>(cell, seeds[2], 0) < R::of(0.5);
                let parts = phasor(square, dot(d, wave), negative);
                sum = [sum[0] + parts[0], sum[1] + parts[1]];
            }
            total = [total[0] + sum[0], total[1] + sum[1]];
        }
        total
    }
}

impl GaborTexture {
    /// Stores the wanted views of the sum (real part, imaginary part) of point `index`.
    fn store<R: Real>(&self, [real, imaginary]: [R; 2], outputs: &mut [&mut [R]], index: usize) {
        let half = R::of(0.5);
        let divisor = normalization::<R>(self.dimensions);
        let mut next = 0;
        let mut add = |value: R| {
            outputs[next][index] = value;
            next += 1;
        };
        if self.value {
            add((imaginary / divisor) * half + half);
        }
        if self.phase {
            add((imaginary.atan2(real) + R::of(PI)) * R::of(INVERSE_TAU));
        }
        if self.intensity {
            add(length([real, imaginary]) / divisor);
        }
    }

    fn evaluate_points<R: Real, const N: usize>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        for index in 0..outputs[0].len() {
            let at = |column: usize| inputs[column].values[index];
            let p: [R; N] = each(|axis| (at(axis) * at(SCALE)).round_coordinate());
            self.store(Waves::new(inputs, index).sum(p), outputs, index);
        }
    }
}

impl Evaluate for GaborTexture {
    fn folds_late(&self) -> bool {
        false
    }

    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        match self.dimensions {
            2 => self.evaluate_points::<R, 2>(inputs, outputs),
            _ => self.evaluate_points::<R, 3>(inputs, outputs),
        }
    }

    fn evaluate_fast(&self, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) -> bool {
        lanes::evaluate(self, inputs, outputs);
        true
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        bounds::enclose(self, inputs, outputs);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All outputs at a point, by the evaluation of every number type.
    fn at<R: Real>(dimensions: usize, point: [f32; 3], changes: &[(usize, f32)]) -> [R; 3] {
        let node = GaborTexture { dimensions, value: true, phase: true, intensity: true };
        let mut values = [point[0], point[1], point[2], 5.0, 2.0, 1.0, FRAC_PI_4, 0.0, 0.0];
        if dimensions == 3 {
            values[ORIENTATION..].copy_from_slice(&[SQRT_2, SQRT_2, 0.0]);
        }
        for (column, value) in changes {
            values[*column] = *value;
        }
        let values = values.map(|value| [R::of(value)]);
        let columns = values.each_ref().map(|values| Column { values, uniform: true });
        let mut outputs = [[R::of(0.0)]; 3];
        node.evaluate(&columns, &mut outputs.each_mut().map(|output| &mut output[..]));
        outputs.map(|[value]| value)
    }

    #[test]
    fn golden_values() {
        let golden = [
            (2, [0.3, 0.7, -0.4], [0.435_293_08, 0.078_057_826, 0.274_749_76]),
            (2, [-2.6, 5.15, 1.05], [0.420_771_84, 0.428_542_8, 0.365_068_23]),
            (3, [0.3, 0.7, -0.4], [0.419_330_15, 0.400_055_4, 0.274_619_07]),
            (3, [-2.6, 5.15, 1.05], [0.584_994_85, 0.775_202, 0.172_143_43]),
        ];
        for (dimensions, point, expected) in golden {
            let found = at::<f32>(dimensions, point, &[]);
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found - expected).abs() < 1.6e-6, "{dimensions}D at {point:?}: {found} {expected}");
            }
            let exact = at::<crate::nodes::Oracle>(dimensions, point, &[]);
            assert!((exact[0].0 - f64::from(expected[0])).abs() < 1e-6, "{exact:?} {expected:?}");
        }
    }

    #[test]
    fn what_is_undefined_is_nan() {
        for dimensions in [2, 3] {
            for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                assert!(at::<f32>(dimensions, [value, 0.1, 0.2], &[]).iter().all(|x| x.is_nan()));
            }
            assert!(at::<f32>(dimensions, [0.3, 0.7, 0.2], &[(FREQUENCY, f32::NAN)])[0].is_nan());
            assert!(!at::<f32>(dimensions, [1e7, 0.7, 0.2], &[])[0].is_nan());
        }
        let along_z = [(ORIENTATION, 0.0), (ORIENTATION + 1, 0.0), (ORIENTATION + 2, 1.0)];
        assert!(!at::<f32>(3, [0.3, 0.7, 0.2], &along_z)[0].is_nan());
        let scattered = [along_z.as_slice(), &[(ANISOTROPY, 0.5)]].concat();
        assert!(at::<f32>(3, [0.3, 0.7, 0.2], &scattered)[0].is_nan());
    }

    #[test]
    fn a_tiny_frequency_is_the_least_one() {
        let at = |frequency| at::<f32>(2, [0.3, 0.7, 0.0], &[(FREQUENCY, frequency)]);
        assert_eq!(at(-3.0), at(LEAST_FREQUENCY));
        assert_ne!(at(0.002), at(LEAST_FREQUENCY));
    }
}
