//! Wave Texture (`ShaderNodeTexWave`): bands along an axis or the diagonal, or rings around an axis or the origin, with
//! a sine, saw or triangle profile, bent by fractal noise.
//!
//! Coordinates are those of `displaced`. The noise is the normalised fBM of Noise Texture with a lacunarity of 2;
//! unlike there, its Detail and its Roughness are not limited: a Detail of 20 gives 21 octaves, one of -1 and below the
//! quotient 0/0, and a negative Roughness alternates signs. Cycles evaluates every octave, however many a linked Detail
//! asks for. Octave number 128 multiplies coordinates by 2^128, infinite in f32, and its noise is NaN wherever the point
//! lies; so is then the sum. From a Detail of 128 on this file gives that NaN without evaluating any octave: the same
//! value, and at most 129 octaves of work. Color and Factor are the same value.

use crate::base::arrays::{Mapped, each};
use crate::nodes::checker_texture::{displaced, enclose_displaced};
use crate::nodes::noise_texture::{Fractal, enclose_fbm, fbm_values};
use crate::nodes::real::{Library, Real, length};
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, Mode, NodeType, OutputSocket, Property, Role, always, vector_at,
};
use crate::scene::SocketType;
use std::ops::Range;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeTexWave",
    label: "Wave Texture",
    module: "wave_texture",
    shader: include_str!("../../shaders/nodes/wave_texture.wgsl"),
    properties: &[
        Property::other("texture_mapping"),
        Property::choice("wave_type", &["BANDS", "RINGS"]),
        Property::choice("bands_direction", &["X", "Y", "Z", "DIAGONAL"]),
        Property::choice("rings_direction", &["X", "Y", "Z", "SPHERICAL"]),
        Property::choice("wave_profile", &["SIN", "SAW", "TRI"]),
    ],
    inputs: &[
        InputSocket::coordinate(always),
        InputSocket::float("Scale", "Scale", &[5.0], always),
        InputSocket::float("Distortion", "Distortion", &[0.0], always),
        InputSocket::float("Detail", "Detail", &[2.0], always),
        InputSocket::float("Detail Scale", "Detail Scale", &[1.0], always),
        InputSocket::float("Detail Roughness", "Detail Roughness", &[0.5], always),
        InputSocket::float("Phase Offset", "Phase Offset", &[0.0], always),
    ],
    outputs: &[
        OutputSocket::new("Color", SocketType::Color, always),
        OutputSocket::new("Fac", SocketType::Float, always),
    ],
    role: Role::Evaluated(|mode| Box::new(Wave::of(mode))),
};

/// Columns of the inputs after the coordinate.
const SCALE: usize = 3;
const DISTORTION: usize = 4;
const DETAIL: usize = 5;
const DETAIL_SCALE: usize = 6;
const DETAIL_ROUGHNESS: usize = 7;
const PHASE_OFFSET: usize = 8;

/// From this many whole octaves on the noise is NaN; see the module's head.
const INFINITE_OCTAVE: i32 = 128;

/// The kernel multiplies by the rounded reciprocal of the rounded 2 pi.
const INVERSE_TURN: f32 = 1.0 / std::f32::consts::TAU;

/// Where the wave's crests lie.
#[derive(Clone, Copy)]
enum Shape {
    /// Planes across an axis.
    Bands(usize),
    /// Planes across (1, 1, 1).
    DiagonalBands,
    /// Cylinders around an axis.
    Rings(usize),
    /// Spheres around the origin.
    Spheres,
}

/// The value along the wave.
#[derive(Clone, Copy)]
enum Profile {
    Sine,
    Saw,
    Triangle,
}

/// The node in one mode.
struct Wave {
    shape: Shape,
    profile: Profile,
}

/// The fractal of the noise that bends the wave.
fn fractal<R: Real>(detail: R, roughness: R) -> Fractal<R> {
    Fractal { detail, roughness, lacunarity: R::of(2.0), offset: R::of(0.0), gain: R::of(1.0) }
}

/// Normalised fBM with any Detail.
#[inline(always)]
fn noise<R: Real>(place: [R; 3], detail: R, roughness: R) -> R {
    if detail.to_int() >= INFINITE_OCTAVE {
        return R::of(f32::NAN);
    }
    fractal(detail, roughness).fbm(place, true)
}

/// Bounds of [`noise`].
fn enclose_noise(place: [Interval; 3], detail: Interval, roughness: Interval) -> Interval {
    // Elsewhere there are no octaves, half an octave, or so many that bounds would be slow and void.
    if !detail.is_finite() || detail.low < 0.0 || detail.high > 31.0 {
        return Interval::EVERYTHING;
    }
    let parameters =
        Fractal { detail, roughness, lacunarity: Interval::point(2.0), offset: Interval::ZERO, gain: Interval::ONE };
    enclose_fbm(&parameters, place, true)
}

/// Where the noise is read.
#[inline(always)]
fn noise_place<R: Real>(p: [R; 3], detail_scale: R) -> [R; 3] {
    p.mapped(|x| (x * detail_scale).round_coordinate())
}

/// The phase, moved by noise.
#[inline(always)]
fn bent<R: Real>(phase: R, distortion: R, noise: R) -> R {
    (phase + distortion * (noise * R::of(2.0) - R::of(1.0))).round_coordinate()
}

impl Shape {
    /// Phase of the wave without distortion, in radians.
    #[inline(always)]
    fn phase<R: Real>(self, p: [R; 3], offset: R) -> R {
        let phase = match self {
            Self::Bands(axis) => p[axis] * R::of(20.0),
            Self::DiagonalBands => ((p[0] + p[1]) + p[2]) * R::of(10.0),
            Self::Rings(axis) => {
                let around: [R; 3] = each(|other| if other == axis { R::of(0.0) } else { p[other] });
                length(around) * R::of(20.0)
            }
            Self::Spheres => length(p) * R::of(20.0),
        };
        (phase.round_coordinate() + offset).round_coordinate()
    }

    /// Bounds of [`Self::phase`].
    fn enclose(self, p: [Interval; 3], offset: Interval) -> Interval {
        let length = |p: [Interval; 3]| ((p[0].square() + p[1].square()) + p[2].square()).sqrt();
        let phase = match self {
            Self::Bands(axis) => p[axis] * Interval::point(20.0),
            Self::DiagonalBands => ((p[0] + p[1]) + p[2]) * Interval::point(10.0),
            Self::Rings(axis) => {
                let mut around = p;
                around[axis] = Interval::ZERO;
                length(around) * Interval::point(20.0)
            }
            Self::Spheres => length(p) * Interval::point(20.0),
        };
        phase + offset
    }
}

impl Profile {
    /// Turns phases into values. The profile is known where the loops are compiled.
    fn apply<R: Real>(self, phases: &mut [R]) {
        match self {
            Self::Sine => phases.iter_mut().for_each(|phase| *phase = Self::Sine.value(*phase)),
            Self::Saw => phases.iter_mut().for_each(|phase| *phase = Self::Saw.value(*phase)),
            Self::Triangle => phases.iter_mut().for_each(|phase| *phase = Self::Triangle.value(*phase)),
        }
    }

    /// Value at a phase.
    #[inline(always)]
    fn value<R: Real>(self, phase: R) -> R {
        let half = R::of(0.5);
        match self {
            Self::Sine => {
                let argument = (phase - R::of(std::f32::consts::FRAC_PI_2)).round_coordinate();
                half + half * argument.library(Library::Sin)
            }
            Self::Saw => (phase * R::of(INVERSE_TURN)).round_coordinate().fraction(),
            Self::Triangle => {
                let turns = (phase * R::of(INVERSE_TURN)).round_coordinate();
                (turns - (turns + half).floor()).abs() * R::of(2.0)
            }
        }
    }

    /// Bounds of [`Self::value`].
    fn enclose(self, phase: Interval) -> Interval {
        let half = Interval::point(0.5);
        match self {
            Self::Sine => half + half * (phase - Interval::point(std::f32::consts::FRAC_PI_2)).sin(),
            Self::Saw => (phase * Interval::point(INVERSE_TURN)).fraction(),
            Self::Triangle => enclose_triangle(phase * Interval::point(INVERSE_TURN)),
        }
    }
}

/// Bounds of twice the distance from the nearest whole number.
fn enclose_triangle(turns: Interval) -> Interval {
    // From here on f32 holds no halves: the nearest number's search rounds, and an odd number is 1 away from its
    // result.
    const COARSE: f64 = 4_194_304.0;
    if !turns.is_finite() || turns.magnitude() >= COARSE {
        return Interval::new(0.0, 2.0).or_nan(!turns.is_finite());
    }
    let [low, high] = turns.ends();
    let value = |t: f64| 2.0 * (t - (t + 0.5).floor()).abs();
    let meets = |phase: f64| (high - phase).floor() >= (low - phase).ceil();
    let least = if meets(0.0) { 0.0 } else { value(low).min(value(high)) };
    let greatest = if meets(0.5) { 1.0 } else { value(low).max(value(high)) };
    // The nearest number may belong to turns that were rounded otherwise than those it is subtracted from.
    let error = 1e-6 + 2.5e-7 * turns.magnitude();
    Interval::outward((least - error).max(0.0), (greatest + error).min(2.0), false)
}

impl Wave {
    fn of(mode: &Mode) -> Self {
        let axis = |direction: &str| ["X", "Y", "Z"].iter().position(|name| *name == direction);
        let shape = match mode.choice("wave_type") {
            "BANDS" => axis(mode.choice("bands_direction")).map_or(Shape::DiagonalBands, Shape::Bands),
            _ => axis(mode.choice("rings_direction")).map_or(Shape::Spheres, Shape::Rings),
        };
        let profile = match mode.choice("wave_profile") {
            "SIN" => Profile::Sine,
            "SAW" => Profile::Saw,
            _ => Profile::Triangle,
        };
        Self { shape, profile }
    }
}

/// Phases without distortion of the points in a range.
#[inline(always)]
fn phases_of<R: Real>(shape: Shape, inputs: &[Column<'_, R>], range: Range<usize>, phases: &mut [R]) {
    for (phase, index) in phases.iter_mut().zip(range) {
        *phase = shape.phase(displaced_place(inputs, index), inputs[PHASE_OFFSET].values[index]);
    }
}

/// The scaled and displaced coordinate of a point.
#[inline(always)]
fn displaced_place<R: Real>(inputs: &[Column<'_, R>], index: usize) -> [R; 3] {
    displaced(vector_at(inputs, 0, index), inputs[SCALE].values[index])
}

impl Wave {
    /// [`phases_of`] with the shape known where the loop is compiled.
    fn phases<R: Real>(&self, inputs: &[Column<'_, R>], range: Range<usize>, phases: &mut [R]) {
        match self.shape {
            Shape::Bands(0) => phases_of(Shape::Bands(0), inputs, range, phases),
            Shape::Bands(1) => phases_of(Shape::Bands(1), inputs, range, phases),
            Shape::Bands(_) => phases_of(Shape::Bands(2), inputs, range, phases),
            Shape::DiagonalBands => phases_of(Shape::DiagonalBands, inputs, range, phases),
            Shape::Rings(0) => phases_of(Shape::Rings(0), inputs, range, phases),
            Shape::Rings(1) => phases_of(Shape::Rings(1), inputs, range, phases),
            Shape::Rings(_) => phases_of(Shape::Rings(2), inputs, range, phases),
            Shape::Spheres => phases_of(Shape::Spheres, inputs, range, phases),
        }
    }
}

/// Points that are taken through the steps of the evaluation together.
const ABREAST: usize = 64;

impl Evaluate for Wave {
    fn folds_late(&self) -> bool {
        false
    }

    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        let count = outputs[0].len();
        for start in (0..count).step_by(ABREAST) {
            let range = start..count.min(start + ABREAST);
            let mut values = [R::of(0.0); ABREAST];
            let values = &mut values[..range.len()];
            self.phases(inputs, range.clone(), values);
            for (phase, index) in values.iter_mut().zip(range.clone()) {
                let at = |column: usize| inputs[column].values[index];
                let distortion = at(DISTORTION);
                if distortion != R::of(0.0) {
                    let place = noise_place(displaced_place(inputs, index), at(DETAIL_SCALE));
                    *phase = bent(*phase, distortion, noise(place, at(DETAIL), at(DETAIL_ROUGHNESS)));
                }
            }
            self.profile.apply(values);
            for output in outputs.iter_mut() {
                output[range.clone()].copy_from_slice(values);
            }
        }
    }

    /// Noise on SIMD lanes where the fractal is the same at all points.
    fn evaluate_fast(&self, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) -> bool {
        let count = outputs[0].len();
        let same = inputs[DETAIL].uniform && inputs[DETAIL_ROUGHNESS].uniform;
        if count == 0 || !same || (inputs[DISTORTION].uniform && inputs[DISTORTION].values[0] == 0.0) {
            return false;
        }
        let fractal = fractal(inputs[DETAIL].values[0], inputs[DETAIL_ROUGHNESS].values[0]);
        let few = fractal.detail.abs() < INFINITE_OCTAVE as f32;
        if !few || !fractal.roughness.is_finite() {
            return false;
        }
        let mut values = vec![0.0; count];
        self.phases(inputs, 0..count, &mut values);
        let mut places = [vec![0.0; count], vec![0.0; count], vec![0.0; count]];
        for index in 0..count {
            let place = noise_place(displaced_place(inputs, index), inputs[DETAIL_SCALE].values[index]);
            for axis in 0..3 {
                places[axis][index] = place[axis];
            }
        }
        let mut noise = vec![0.0; count];
        fbm_values(&fractal, [&places[0], &places[1], &places[2]], &mut noise);
        for ((phase, noise), &distortion) in values.iter_mut().zip(noise).zip(inputs[DISTORTION].values) {
            if distortion != 0.0 {
                *phase = bent(*phase, distortion, noise);
            }
        }
        self.profile.apply(&mut values);
        outputs.iter_mut().for_each(|output| output.copy_from_slice(&values));
        true
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let p = enclose_displaced([inputs[0], inputs[1], inputs[2]], inputs[SCALE]);
        let mut phase = self.shape.enclose(p, inputs[PHASE_OFFSET]);
        let distortion = inputs[DISTORTION];
        if distortion.as_point() != Some(0.0) {
            let place = p.mapped(|x| x * inputs[DETAIL_SCALE]);
            let noise = enclose_noise(place, inputs[DETAIL], inputs[DETAIL_ROUGHNESS]);
            let moved = phase + distortion * (noise * Interval::point(2.0) - Interval::ONE);
            // A distortion of 0 reads no noise.
            phase = if distortion.has_zero() { moved.hull(phase) } else { moved };
        }
        outputs.fill(self.profile.enclose(phase));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::lane_tests::{adversarial_coordinates, assert_lanes_equal_scalar};
    use serde_json::json;

    const DEFAULTS: [f32; 6] = [5.0, 0.0, 2.0, 1.0, 0.5, 0.0];

    fn wave(shape: Shape, profile: Profile, p: [f32; 3], parameters: [f32; 6]) -> f32 {
        let values: Vec<f32> = p.into_iter().chain(parameters).collect();
        let columns: Vec<_> = values.chunks(1).map(|values| Column { values, uniform: false }).collect();
        let mut value = [0.0];
        Wave { shape, profile }.evaluate(&columns, &mut [&mut value]);
        value[0]
    }

    #[test]
    fn golden_values() {
        let points = [[0.3, 0.7, -0.4], [-2.6, 5.15, 1.05]];
        for (p, expected) in points.into_iter().zip([0.422_880_23_f32, 0.865_004_8]) {
            let found = wave(Shape::Bands(0), Profile::Sine, p, DEFAULTS);
            assert!((found - expected).abs() <= 6e-8, "{found}");
        }
        let parameters = [5.0, 2.0, 2.0, 1.0, 0.5, 0.0];
        for (p, expected) in points.into_iter().zip([0.662_626_27_f32, 0.623_001_1]) {
            assert_eq!(wave(Shape::Spheres, Profile::Triangle, p, parameters), expected);
        }
    }

    #[test]
    fn coordinates_without_a_fraction() {
        let at = |profile: Profile, x: f32| wave(Shape::Bands(0), profile, [x, 0.5, 0.25], DEFAULTS);
        assert_eq!([at(Profile::Saw, 1e7), at(Profile::Triangle, 1e7)], [0.0, 0.0]);
        assert!((at(Profile::Sine, 1e7) - 0.8359).abs() < 1e-4);
        for profile in [Profile::Sine, Profile::Saw, Profile::Triangle] {
            for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                assert!(at(profile, x).is_nan());
            }
        }
    }

    #[test]
    fn the_octave_that_is_infinite_makes_nan_whatever_follows() {
        let p = [0.3_f32, 0.7, -0.4];
        for roughness in [0.0, 0.5, -1.5] {
            for p in [p, [0.0; 3], [1e-38; 3]] {
                // The first sum that is not evaluated, written out.
                assert!(fractal(128.0, roughness).fbm(p, true).is_nan());
                assert!(noise(p, 128.0, roughness).is_nan());
            }
        }
        assert!(noise(p, 1e9, 0.5).is_nan() && noise(p, 1e30, 0.5).is_nan());
        assert!(noise(p, 20.0, 0.5).is_finite() && noise(p, -0.5, 0.5).is_finite());
        assert!(noise(p, -1.0, 0.5).is_nan() && noise(p, -1.5, 0.5).is_nan() && noise(p, f32::NAN, 0.5).is_nan());
    }

    #[test]
    fn lanes_equal_the_scalar_evaluation() {
        let coordinates = adversarial_coordinates(2048);
        for profile in ["SIN", "SAW", "TRI"] {
            for parameters in [
                [5.0, 2.0, 2.0, 1.0, 0.5, 0.3],
                [1.0, -0.7, 3.7, 2.3, -0.8, 0.0],
                [0.3, 1.0, 20.0, 1.0, 1.0, 0.0],
                [2.0, 1.0, -0.5, 1e-3, 0.5, 0.0],
                [2.0, 1.0, -1.0, 1.0, 0.5, 0.0],
                [2.0, 1.0, -7.5, 1.0, 0.5, 0.0],
                [1.0, 1.0, 127.5, 1.0, 0.5, 0.0],
            ] {
                assert_lanes_equal_scalar(
                    &TYPE,
                    &json!({"wave_type": "RINGS", "wave_profile": profile}),
                    vec!["Color", "Fac"],
                    &coordinates,
                    &parameters,
                );
            }
        }
    }

    #[test]
    fn bounds_hold_and_narrow_with_the_box() {
        let parameters = [2.0, 1.5, 2.5, 1.0, 0.5, 0.2];
        for shape in [Shape::Bands(1), Shape::DiagonalBands, Shape::Rings(0), Shape::Spheres] {
            for profile in [Profile::Sine, Profile::Saw, Profile::Triangle] {
                let mut narrow = 0;
                for step in 0..200 {
                    let center = [step as f32 * 0.013 - 1.3, 0.4 - step as f32 * 0.004, 0.1];
                    let radius = 2e-4;
                    let inputs: Vec<Interval> = center
                        .map(|x| Interval::new(x - radius, x + radius))
                        .into_iter()
                        .chain(parameters.map(Interval::point))
                        .collect();
                    let mut bounds = [Interval::EVERYTHING];
                    Wave { shape, profile }.enclose(&inputs, &mut bounds);
                    for sign in [-1.0, 0.0, 1.0_f32] {
                        let inside = center.map(|x| (x + sign * radius).clamp(x - radius, x + radius));
                        let value = wave(shape, profile, inside, parameters);
                        assert!(bounds[0].contains(f64::from(value)), "{inside:?}: {value} in {bounds:?}");
                    }
                    narrow += usize::from(bounds[0].high - bounds[0].low < 0.1);
                }
                assert!(narrow > 150, "{narrow}");
            }
        }
    }

    #[test]
    fn a_triangle_knows_its_corners() {
        assert!(enclose_triangle(Interval::new(3.4, 3.6)).high >= 1.0);
        assert!(enclose_triangle(Interval::new(3.4, 3.6)).low > 0.79);
        assert_eq!(enclose_triangle(Interval::new(-0.1, 0.2)).low, 0.0);
        assert!(enclose_triangle(Interval::new(-0.1, 0.2)).high < 0.41);
        // An odd number whose half above rounds up.
        let odd = 8_388_609.0_f32;
        assert!(enclose_triangle(Interval::point(odd)).contains(f64::from((odd - (odd + 0.5).floor()).abs() * 2.0)));
    }
}
