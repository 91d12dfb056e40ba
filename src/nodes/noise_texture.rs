//! Noise Texture (`ShaderNodeTexNoise`): fractal gradient noise in 1 to 4 dimensions.
//!
//! Types fBM, multifractal, hybrid multifractal, ridged multifractal and hetero terrain (Musgrave,
//! in Ebert et al., "Texturing and Modeling", 3rd ed., ch. 16). Coordinates are `Vector * Scale`
//! and `W * Scale`; Detail is clamped to [0, 15] and its fraction blends the last octave. Factor is
//! the fractal at the coordinate; Color repeats it at two more offsets.
//!
//! Octaves multiply the *rounded* f32 coordinate, so the field is only reproducible in f32
//! coordinates; see [`Real::round_coordinate`].

mod bounds;
mod lanes;

pub(super) use bounds::fbm as enclose_fbm;
pub(super) use lanes::fbm_values;

use crate::base::arrays::{Mapped, each};
use crate::nodes::gradient_noise::{random_offset, signed_noise};
use crate::nodes::real::Real;
use crate::nodes::{Column, Evaluate, InputSocket, Interval, Mode, NodeType, OutputSocket, Property, Role, always};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeTexNoise",
    label: "Noise Texture",
    module: "noise_texture",
    shader: include_str!("../../shaders/nodes/noise_texture.wgsl"),
    properties: &[
        Property::choice("noise_dimensions", &["3D", "1D", "2D", "4D"]),
        Property::choice(
            "noise_type",
            &["FBM", "MULTIFRACTAL", "RIDGED_MULTIFRACTAL", "HYBRID_MULTIFRACTAL", "HETERO_TERRAIN"],
        ),
        Property::flag("normalize", true),
        Property::other("texture_mapping"),
    ],
    inputs: &[
        InputSocket::coordinate(|mode| mode.choice("noise_dimensions") != "1D"),
        InputSocket::float("W", "W", &[0.0], |mode| matches!(mode.choice("noise_dimensions"), "1D" | "4D")),
        InputSocket::float("Scale", "Scale", &[5.0], always),
        InputSocket::float("Detail", "Detail", &[2.0], always),
        InputSocket::float("Roughness", "Roughness", &[0.5], always),
        InputSocket::float("Lacunarity", "Lacunarity", &[2.0], always),
        InputSocket::float("Offset", "Offset", &[0.0], has_offset),
        InputSocket::float("Gain", "Gain", &[1.0], has_gain),
        InputSocket::float("Distortion", "Distortion", &[0.0], always),
    ],
    outputs: &[
        OutputSocket::new("Fac", SocketType::Float, always),
        OutputSocket::new("Color", SocketType::Color, always),
    ],
    role: Role::Evaluated(|mode| {
        Box::new(NoiseTexture {
            dimensions: dimensions(mode.choice("noise_dimensions")),
            fractal: mode.choice("noise_type"),
            normalize: mode.flag("normalize"),
            has_offset: has_offset(mode),
            has_gain: has_gain(mode),
            factor: mode.wants("Fac"),
            color: mode.wants("Color"),
        })
    }),
};

fn has_offset(mode: &Mode) -> bool {
    matches!(mode.choice("noise_type"), "RIDGED_MULTIFRACTAL" | "HYBRID_MULTIFRACTAL" | "HETERO_TERRAIN")
}

fn has_gain(mode: &Mode) -> bool {
    matches!(mode.choice("noise_type"), "RIDGED_MULTIFRACTAL" | "HYBRID_MULTIFRACTAL")
}

/// Number in front of the D.
pub(super) fn dimensions(name: &str) -> usize {
    usize::from(name.as_bytes()[0] - b'0')
}

/// The node in one mode.
pub(super) struct NoiseTexture {
    dimensions: usize,
    fractal: &'static str,
    normalize: bool,
    has_offset: bool,
    has_gain: bool,
    factor: bool,
    color: bool,
}

/// Parameters of one point, clamped as the kernel does.
#[derive(Clone, Copy)]
pub(super) struct Fractal<R> {
    pub(super) detail: R,
    pub(super) roughness: R,
    pub(super) lacunarity: R,
    pub(super) offset: R,
    pub(super) gain: R,
}

/// Multiplies a coordinate and rounds it.
#[inline(always)]
fn scaled<R: Real, const N: usize>(p: [R; N], factor: R) -> [R; N] {
    p.mapped(|x| (x * factor).round_coordinate())
}

impl<R: Real> Fractal<R> {
    fn octaves(&self) -> (i32, R) {
        (self.detail.to_int(), self.detail - self.detail.floor())
    }

    /// The sum of octaves and a part of one more. No octave at all (a Detail of -1 and below) normalises to NaN.
    pub(super) fn fbm<const N: usize>(&self, p: [R; N], normalize: bool) -> R {
        let (octaves, rest) = self.octaves();
        let (half, one) = (R::of(0.5), R::of(1.0));
        let (mut sum, mut total, mut amplitude, mut scale) = (R::of(0.0), R::of(0.0), one, one);
        for _ in 0..=octaves {
            sum = sum + signed_noise(scaled(p, scale)) * amplitude;
            total = total + amplitude;
            amplitude = amplitude * self.roughness;
            scale = (scale * self.lacunarity).round_coordinate();
        }
        let normalized = |sum: R, total: R| if normalize { (half * sum) / total + half } else { sum };
        if rest == R::of(0.0) {
            return normalized(sum, total);
        }
        let next = sum + signed_noise(scaled(p, scale)) * amplitude;
        normalized(sum, total).lerp(normalized(next, total + amplitude), rest)
    }

    fn multifractal<const N: usize>(&self, mut p: [R; N]) -> R {
        let (octaves, rest) = self.octaves();
        let one = R::of(1.0);
        let (mut value, mut amplitude) = (one, one);
        for _ in 0..=octaves {
            value = value * (amplitude * signed_noise(p) + one);
            amplitude = amplitude * self.roughness;
            p = scaled(p, self.lacunarity);
        }
        if rest != R::of(0.0) {
            value = value * ((rest * amplitude) * signed_noise(p) + one);
        }
        value
    }

    fn hetero_terrain<const N: usize>(&self, mut p: [R; N]) -> R {
        let (octaves, rest) = self.octaves();
        let mut amplitude = self.roughness;
        let mut value = self.offset + signed_noise(p);
        p = scaled(p, self.lacunarity);
        for _ in 0..octaves {
            value = value + ((signed_noise(p) + self.offset) * amplitude) * value;
            amplitude = amplitude * self.roughness;
            p = scaled(p, self.lacunarity);
        }
        if rest != R::of(0.0) {
            let increment = ((signed_noise(p) + self.offset) * amplitude) * value;
            value = value + rest * increment;
        }
        value
    }

    fn hybrid<const N: usize>(&self, mut p: [R; N]) -> R {
        let (octaves, rest) = self.octaves();
        let (one, threshold) = (R::of(1.0), R::of(0.001));
        let (mut amplitude, mut value, mut weight) = (one, R::of(0.0), one);
        for _ in 0..=octaves {
            // A NaN weight ends the sum, too.
            if weight <= threshold || weight.is_nan() {
                break;
            }
            weight = weight.fmin(one);
            let signal = (signed_noise(p) + self.offset) * amplitude;
            amplitude = amplitude * self.roughness;
            value = value + weight * signal;
            weight = weight * (self.gain * signal);
            p = scaled(p, self.lacunarity);
        }
        if rest != R::of(0.0) && weight > threshold {
            weight = weight.fmin(one);
            let signal = (signed_noise(p) + self.offset) * amplitude;
            value = value + (rest * weight) * signal;
        }
        value
    }

    fn ridged<const N: usize>(&self, mut p: [R; N]) -> R {
        let (octaves, _) = self.octaves();
        let mut amplitude = self.roughness;
        let mut signal = self.offset - signed_noise(p).abs();
        signal = signal * signal;
        let mut value = signal;
        for _ in 0..octaves {
            p = scaled(p, self.lacunarity);
            let weight = (signal * self.gain).saturate();
            signal = self.offset - signed_noise(p).abs();
            signal = (signal * signal) * weight;
            value = value + signal * amplitude;
            amplitude = amplitude * self.roughness;
        }
        value
    }
}

impl NoiseTexture {
    fn fractal<R: Real, const N: usize>(&self, fractal: &Fractal<R>, p: [R; N]) -> R {
        match self.fractal {
            "FBM" => fractal.fbm(p, self.normalize),
            "MULTIFRACTAL" => fractal.multifractal(p),
            "HETERO_TERRAIN" => fractal.hetero_terrain(p),
            "HYBRID_MULTIFRACTAL" => fractal.hybrid(p),
            _ => fractal.ridged(p),
        }
    }

    /// First column of each input after the coordinates: scale, detail, roughness, lacunarity,
    /// offset, gain, distortion.
    fn parameter_columns(&self) -> [usize; 7] {
        let vector = if self.dimensions == 1 { 0 } else { 3 };
        let first = vector + usize::from(matches!(self.dimensions, 1 | 4));
        let offset = first + 4;
        let gain = offset + usize::from(self.has_offset);
        let distortion = gain + usize::from(self.has_gain);
        [first, first + 1, first + 2, first + 3, offset, gain, distortion]
    }

    fn evaluate_points<R: Real, const N: usize>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        let [scale, detail, roughness, lacunarity, offset, gain, distortion] = self.parameter_columns();
        let seeds = [N as f32, (N + 1) as f32].mapped(random_offset::<R, N>);
        let distortions: [[R; N]; N] = each(|axis| random_offset(axis as f32));
        for index in 0..outputs[0].len() {
            let at = |column: usize| inputs[column].values[index];
            let mut p: [R; N] = each(|axis| (at(axis) * at(scale)).round_coordinate());
            let strength = at(distortion);
            if strength != R::of(0.0) {
                let undistorted = p;
                p = each(|axis| {
                    let shifted = add(undistorted, distortions[axis]);
                    (undistorted[axis] + signed_noise(shifted) * strength).round_coordinate()
                });
            }
            let fractal = Fractal {
                detail: at(detail).clamped(R::of(0.0), R::of(15.0)),
                roughness: at(roughness).fmax(R::of(0.0)),
                lacunarity: at(lacunarity),
                offset: if self.has_offset { at(offset) } else { R::of(0.0) },
                gain: if self.has_gain { at(gain) } else { R::of(1.0) },
            };
            let value = self.fractal(&fractal, p);
            let mut next = 0;
            if self.factor {
                outputs[0][index] = value;
                next = 1;
            }
            if self.color {
                outputs[next][index] = value;
                for (channel, seed) in seeds.iter().enumerate() {
                    outputs[next + 1 + channel][index] = self.fractal(&fractal, add(p, *seed));
                }
            }
        }
    }
}

fn add<R: Real, const N: usize>(p: [R; N], offset: [R; N]) -> [R; N] {
    each(|axis| (p[axis] + offset[axis]).round_coordinate())
}

impl Evaluate for NoiseTexture {
    fn folds_late(&self) -> bool {
        false
    }

    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        match self.dimensions {
            1 => self.evaluate_points::<R, 1>(inputs, outputs),
            2 => self.evaluate_points::<R, 2>(inputs, outputs),
            3 => self.evaluate_points::<R, 3>(inputs, outputs),
            _ => self.evaluate_points::<R, 4>(inputs, outputs),
        }
    }

    fn evaluate_fast(&self, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) -> bool {
        lanes::evaluate(self, inputs, outputs)
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        bounds::enclose(self, inputs, outputs);
    }
}
