//! Magic Texture (`ShaderNodeTexMagic`): sines and cosines of sums of the coordinates, fed into each other up to ten
//! times.
//!
//! Up to Blender 5.1 coordinates are reduced modulo 2 pi before they are scaled, so the field is periodic only where five times
//! the scale is a whole number. Since 5.2 they are reduced after that, and the field is periodic. Color is 1/2 minus the three waves, unclamped; Factor is the mean of its channels. An error in a
//! wave grows with the power of the distortion that the depth says: beyond a distortion of 1 that limits how far any
//! two implementations agree.

use crate::base::arrays::Mapped;
use crate::nodes::real::{Library, Real};
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Property, Role, always, vector_at,
};
use crate::scene::{Release, SocketType};

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeTexMagic",
    label: "Magic Texture",
    module: "magic_texture",
    shader: include_str!("../../shaders/nodes/magic_texture.wgsl"),
    properties: &[
        Property::other("texture_mapping"),
        Property::integer("turbulence_depth", 2, [0, 10], &[2, 0, 1, 3, 4, 5, 6, 7, 8, 9, 10]),
    ],
    inputs: &[
        InputSocket::coordinate(always),
        InputSocket::float("Scale", "Scale", &[5.0], always),
        InputSocket::float("Distortion", "Distortion", &[1.0], always),
    ],
    outputs: &[
        OutputSocket::new("Color", SocketType::Color, always),
        OutputSocket::new("Fac", SocketType::Float, always),
    ],
    role: Role::Evaluated(|mode| {
        Box::new(Magic {
            depth: mode.integer("turbulence_depth"),
            scales_first: mode.release() >= Release::V5_2,
            color: mode.wants("Color"),
            factor: mode.wants("Fac"),
        })
    }),
};

/// Columns of the inputs after the coordinate.
const SCALE: usize = 3;
const DISTORTION: usize = 4;

/// Coordinates repeat after this length.
const TURN: f32 = std::f32::consts::TAU;

const THIRD: f32 = 1.0 / 3.0;

/// Distortions outside of these magnitudes make the reciprocal of twice the distortion overflow or vanish.
const REGULAR_DISTORTION: [f32; 2] = [1e-30, 1e30];

/// The node in one mode.
struct Magic {
    depth: i32,
    /// Coordinates are scaled before they are reduced.
    scales_first: bool,
    color: bool,
    factor: bool,
}

/// `(a + b) + c`, rounded as an argument of a wave has to be.
#[inline(always)]
fn sum<R: Real>(a: R, b: R, c: R) -> R {
    ((a + b).round_coordinate() + c).round_coordinate()
}

#[inline(always)]
fn sin<R: Real>(x: R) -> R {
    x.library(Library::Sin)
}

#[inline(always)]
fn cos<R: Real>(x: R) -> R {
    x.library(Library::Cos)
}

/// Points whose waves are computed side by side, since those of one point wait for one another.
const ABREAST: usize = 16;

impl Magic {
    /// Turns coordinates into colours; every point has a scale and a distortion.
    #[inline(always)]
    fn color_all<R: Real>(&self, points: &mut [[R; 3]], scale: &[R], distortion: &[R]) {
        for (p, &scale) in points.iter_mut().zip(scale) {
            let scaled = if self.scales_first { p.mapped(|x| (x * scale).round_coordinate()) } else { *p };
            let [a, b, c] = scaled.mapped(|x| x.fmod(R::of(TURN)));
            let argument = |sum: R| {
                let five = (sum * R::of(5.0)).round_coordinate();
                if self.scales_first { five } else { (five * scale).round_coordinate() }
            };
            *p = [argument(sum(a, b, c)), argument(sum(-a, b, -c)), argument(sum(-a, -b, c))];
        }
        for p in &mut *points {
            *p = [sin(p[0]), cos(p[1]), -cos(p[2])];
        }
        if self.depth > 0 {
            for (p, &distortion) in points.iter_mut().zip(distortion) {
                *p = p.mapped(|wave| wave * distortion);
            }
        }
        for step in 1..=self.depth {
            macro_rules! set {
                ($axis:expr, |$x:ident, $y:ident, $z:ident| $wave:expr) => {
                    for (p, &distortion) in points.iter_mut().zip(distortion) {
                        let [$x, $y, $z] = *p;
                        p[$axis] = $wave * distortion;
                    }
                };
            }
            match step {
                1 => set!(1, |x, y, z| -cos(sum(x, -y, z))),
                2 => set!(0, |x, y, z| cos(sum(x, -y, -z))),
                3 => set!(2, |x, y, z| sin(sum(-x, -y, -z))),
                4 => set!(0, |x, y, z| -cos(sum(-x, y, -z))),
                5 => set!(1, |x, y, z| -sin(sum(-x, y, z))),
                6 => set!(1, |x, y, z| -cos(sum(-x, y, z))),
                7 => set!(0, |x, y, z| cos(sum(x, y, z))),
                8 => set!(2, |x, y, z| sin(sum(x, y, -z))),
                9 => set!(0, |x, y, z| -cos(sum(-x, -y, z))),
                _ => set!(1, |x, y, z| -sin(sum(x, -y, z))),
            }
        }
        for (p, &distortion) in points.iter_mut().zip(distortion) {
            if distortion != R::of(0.0) {
                // The kernel's division by a scalar: one reciprocal for three products.
                let inverse = R::of(1.0) / (distortion * R::of(2.0));
                *p = p.mapped(|wave| wave * inverse);
            }
            *p = p.mapped(|wave| R::of(0.5) - wave);
        }
    }

    /// Bounds of the waves that the colour is 1/2 minus of.
    fn enclose_waves(&self, p: [Interval; 3], scale: Interval, distortion: Interval) -> [Interval; 3] {
        let still = distortion.as_point() == Some(0.0);
        let magnitude = distortion.abs();
        let regular =
            distortion.is_finite() && magnitude.low >= REGULAR_DISTORTION[0] && magnitude.high <= REGULAR_DISTORTION[1];
        if !still && !regular {
            return [Interval::EVERYTHING; 3];
        }
        let scaled = if self.scales_first { p.mapped(|x| x * scale) } else { p };
        let [a, b, c] = scaled.mapped(enclose_remainder);
        let argument = |sum: Interval| {
            let five = sum * Interval::point(5.0);
            if self.scales_first { five } else { five * scale }
        };
        let sum = |a: Interval, b: Interval, c: Interval| (a + b) + c;
        // What the distortion multiplies.
        let mut waves = [argument(sum(a, b, c)).sin(), argument(sum(-a, b, -c)).cos(), -argument(sum(-a, -b, c)).cos()];
        for step in 1..=self.depth {
            let [x, y, z] = waves.mapped(|wave| wave * distortion);
            match step {
                1 => waves[1] = -sum(x, -y, z).cos(),
                2 => waves[0] = sum(x, -y, -z).cos(),
                3 => waves[2] = sum(-x, -y, -z).sin(),
                4 => waves[0] = -sum(-x, y, -z).cos(),
                5 => waves[1] = -sum(-x, y, z).sin(),
                6 => waves[1] = -sum(-x, y, z).cos(),
                7 => waves[0] = sum(x, y, z).cos(),
                8 => waves[2] = sum(x, y, -z).sin(),
                9 => waves[0] = -sum(-x, -y, z).cos(),
                _ => waves[1] = -sum(x, -y, z).sin(),
            }
        }
        match (self.depth > 0, still) {
            // NaN stays NaN, also when it is multiplied by 0.
            (true, true) => waves.mapped(|wave| Interval::ZERO.or_nan(wave.may_be_nan)),
            (false, true) => waves,
            // The distortion cancels but for the roundings of three operations.
            (true, false) => waves.mapped(|wave| {
                let exact = wave * Interval::point(0.5);
                let [low, high] = exact.ends();
                Interval::with_error(low, high, 3e-6 * exact.magnitude(), wave.may_be_nan)
            }),
            (false, false) => {
                let inverse = Interval::ONE.divide(distortion * Interval::point(2.0));
                waves.mapped(|wave| wave * inverse)
            }
        }
    }
}

/// Bounds of the remainder modulo 2 pi, which has the sign of `x` and is exact.
fn enclose_remainder(x: Interval) -> Interval {
    let turn = f64::from(TURN);
    if x.is_finite() {
        let [low, high] = x.ends();
        let [first, last] = [low % turn, high % turn];
        // The remainder grows with x but for steps of a whole turn: no step, no difference.
        if ((last - first) - (high - low)).abs() < 1.0 {
            return Interval::outward(first, last, false);
        }
    }
    let low = if x.low >= 0.0 { 0.0 } else { -turn };
    let high = if x.high <= 0.0 { 0.0 } else { turn };
    Interval::outward(low, high, !x.is_finite())
}

impl Evaluate for Magic {
    fn folds_late(&self) -> bool {
        false
    }

    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        let count = outputs[0].len();
        for start in (0..count).step_by(ABREAST) {
            let range = start..count.min(start + ABREAST);
            let mut colors = [[R::of(0.0); 3]; ABREAST];
            let colors = &mut colors[..range.len()];
            for (p, index) in colors.iter_mut().zip(range.clone()) {
                *p = vector_at(inputs, 0, index);
            }
            let [scale, distortion] = [SCALE, DISTORTION].mapped(|column| &inputs[column].values[range.clone()]);
            self.color_all(colors, scale, distortion);
            for (color, index) in colors.iter().zip(range) {
                if self.color {
                    for axis in 0..3 {
                        outputs[axis][index] = color[axis];
                    }
                }
                if self.factor {
                    let mean = ((color[0] + color[1]) + color[2]) * R::of(THIRD);
                    outputs[if self.color { 3 } else { 0 }][index] = mean;
                }
            }
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let waves = self.enclose_waves([inputs[0], inputs[1], inputs[2]], inputs[SCALE], inputs[DISTORTION]);
        let color = waves.mapped(|wave| Interval::point(0.5) - wave);
        if self.color {
            outputs[..3].copy_from_slice(&color);
        }
        if self.factor {
            let mean = ((color[0] + color[1]) + color[2]) * Interval::point(THIRD);
            outputs[if self.color { 3 } else { 0 }] = mean;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Magic {
        /// The colour of one point.
        fn at<R: Real>(&self, p: [R; 3], scale: R, distortion: R) -> [R; 3] {
            let mut points = [p];
            self.color_all(&mut points, &[scale], &[distortion]);
            points[0]
        }
    }

    fn node(depth: i32) -> Magic {
        Magic { depth, scales_first: false, color: true, factor: true }
    }

    #[test]
    fn golden_values() {
        let close =
            |found: [f32; 3], expected: [f32; 3]| found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= 2.4e-7);
        let first = node(2).at([0.3_f32, 0.7, -0.4], 5.0, 1.0);
        assert!(close(first, [0.006_293_148, 0.706_114_9, 0.048_153_907]), "{first:?}");
        let second = node(2).at([-2.6_f32, 5.15, 1.05], 5.0, 1.0);
        assert!(close(second, [0.966_107_85, 0.948_522, 0.990_121_7]), "{second:?}");
    }

    #[test]
    fn without_distortion() {
        let p = [0.3_f32, 0.7, -0.4];
        assert_eq!(node(3).at(p, 5.0, 0.0), [0.5; 3]);
        // Depth 0 loses the division by 2 only.
        let plain = node(0).at(p, 5.0, 0.0);
        assert!(plain.iter().zip(node(0).at(p, 5.0, 0.5)).all(|(a, b)| *a == b));
        assert!(node(2).at([f32::INFINITY, 0.0, 0.0], 5.0, 1.0).iter().all(|value| value.is_nan()));
        assert!(node(2).at([1e7_f32, 0.0, 0.0], 5.0, 1.0).iter().all(|value| value.is_finite()));
    }

    #[test]
    fn bounds_hold_and_narrow_with_the_box() {
        for depth in 0..=10 {
            for step in 0..100 {
                let radius = if step % 2 == 0 { 1e-3 } else { 1e-5 };
                let center = [step as f32 * 0.13 - 6.5, 7.0 - step as f32 * 0.17, 1.1];
                let distortion = if step % 3 == 0 { 0.7 } else { -1.0 };
                let place = center.map(|x| Interval::new(x - radius, x + radius));
                let point = Interval::point;
                let waves = node(depth).enclose_waves(place, point(0.9), point(distortion));
                for sign in [-1.0, 0.0, 1.0_f32] {
                    let inside = center.map(|x| (x + sign * radius).clamp(x - radius, x + radius));
                    let color = node(depth).at(inside, 0.9, distortion);
                    assert!((0..3).all(|axis| waves[axis].contains(f64::from(0.5 - color[axis]))), "depth {depth}");
                }
                let turns = place.iter().any(|x| enclose_remainder(*x).high - enclose_remainder(*x).low > 1.0);
                if depth <= 2 && step % 2 == 1 && !turns {
                    assert!(waves.iter().all(|wave| wave.high - wave.low < 0.02), "depth {depth}: {waves:?}");
                }
            }
        }
        let whole = enclose_remainder(Interval::new(5.0, 8.0));
        assert!(whole.low == 0.0 && whole.high >= TURN);
        let within = enclose_remainder(Interval::new(-7.0, -6.5));
        assert!(within.contains(-7.0 + f64::from(TURN)) && within.high < -0.2);
    }
}
