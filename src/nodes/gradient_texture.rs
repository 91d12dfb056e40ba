//! Gradient Texture (`ShaderNodeTexGradient`): a ramp from 0 to 1 along x, along a diagonal, around z or towards the
//! origin. The coordinate has no scale; Color and Factor are the same value, limited to [0, 1], and 0 for NaN.

use crate::nodes::real::{Real, length};
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Property, Role, always, vector_at,
};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeTexGradient",
    label: "Gradient Texture",
    module: "gradient_texture",
    shader: include_str!("../../shaders/nodes/gradient_texture.wgsl"),
    properties: &[
        Property::other("texture_mapping"),
        Property::choice(
            "gradient_type",
            &["LINEAR", "QUADRATIC", "EASING", "DIAGONAL", "SPHERICAL", "QUADRATIC_SPHERE", "RADIAL"],
        ),
    ],
    inputs: &[InputSocket::coordinate(always)],
    outputs: &[
        OutputSocket::new("Color", SocketType::Color, always),
        OutputSocket::new("Fac", SocketType::Float, always),
    ],
    role: Role::Evaluated(|mode| {
        Box::new(Gradient {
            shape: match mode.choice("gradient_type") {
                "LINEAR" => Shape::Linear,
                "QUADRATIC" => Shape::Quadratic,
                "EASING" => Shape::Easing,
                "DIAGONAL" => Shape::Diagonal,
                "SPHERICAL" => Shape::Spherical,
                "QUADRATIC_SPHERE" => Shape::QuadraticSphere,
                _ => Shape::Radial,
            },
        })
    }),
};

/// The gradient's form.
#[derive(Clone, Copy)]
enum Shape {
    Linear,
    Quadratic,
    Easing,
    Diagonal,
    Spherical,
    QuadraticSphere,
    Radial,
}

/// Distance from the origin at which the spherical gradients end: a bit less than 1, as in the kernel.
const RADIUS: f32 = 0.999_999;

/// The kernel multiplies by the rounded reciprocal of the rounded 2 pi.
const INVERSE_TURN: f32 = 1.0 / std::f32::consts::TAU;

/// The node in one mode.
struct Gradient {
    shape: Shape,
}

impl Shape {
    /// The ramp before it is limited.
    #[inline(always)]
    fn ramp<R: Real>(self, [x, y, z]: [R; 3]) -> R {
        let (zero, half, one) = (R::of(0.0), R::of(0.5), R::of(1.0));
        let square = |value: R| value * value;
        let nearness = || (R::of(RADIUS) - length([x, y, z])).fmax(zero);
        match self {
            Self::Linear => x,
            Self::Quadratic => square(x.fmax(zero)),
            Self::Easing => {
                let position = x.fmax(zero).fmin(one);
                let t = square(position);
                R::of(3.0) * t - (R::of(2.0) * t) * position
            }
            Self::Diagonal => (x + y) * half,
            Self::Spherical => nearness(),
            Self::QuadraticSphere => square(nearness()),
            Self::Radial => y.atan2(x) * R::of(INVERSE_TURN) + half,
        }
    }

    /// Bounds of [`Self::ramp`].
    fn enclose(self, [x, y, z]: [Interval; 3]) -> Interval {
        let half = Interval::point(0.5);
        let nearness = || {
            let distance = ((x.square() + y.square()) + z.square()).sqrt();
            (Interval::point(RADIUS) - distance).fmax(Interval::ZERO)
        };
        match self {
            Self::Linear => x,
            Self::Quadratic => x.fmax(Interval::ZERO).square(),
            Self::Easing => {
                let position = x.fmax(Interval::ZERO).fmin(Interval::ONE);
                let ease = |m: f64| m * m * (3.0 - 2.0 * m);
                // Six roundings of terms up to 3 m^2; the value is at least m^2, so a value of 0 has no error.
                position.increasing(ease, 4e-6 * ease(f64::from(position.high)))
            }
            Self::Diagonal => (x + y) * half,
            Self::Spherical => nearness(),
            Self::QuadraticSphere => nearness().square(),
            Self::Radial => y.atan2(x) * Interval::point(INVERSE_TURN) + half,
        }
    }
}

impl Evaluate for Gradient {
    fn folds_late(&self) -> bool {
        false
    }

    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        for index in 0..outputs[0].len() {
            let value = self.shape.ramp(vector_at(inputs, 0, index)).saturate();
            outputs.iter_mut().for_each(|output| output[index] = value);
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        outputs.fill(self.shape.enclose([inputs[0], inputs[1], inputs[2]]).saturate());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Shape; 7] = [
        Shape::Linear,
        Shape::Quadratic,
        Shape::Easing,
        Shape::Diagonal,
        Shape::Spherical,
        Shape::QuadraticSphere,
        Shape::Radial,
    ];

    fn value(shape: Shape, p: [f32; 3]) -> f32 {
        shape.ramp(p).saturate()
    }

    #[test]
    fn golden_values() {
        assert_eq!(value(Shape::Spherical, [0.3, 0.7, -0.4]), 0.139_766_45);
        assert_eq!(value(Shape::Spherical, [-2.6, 5.15, 1.05]), 0.0);
        assert!((value(Shape::Radial, [0.3, 0.7, -0.4]) - 0.685_559_45).abs() <= 1.2e-7);
        assert!((value(Shape::Radial, [-2.6, 5.15, 1.05]) - 0.824_408_65).abs() <= 1.2e-7);
    }

    #[test]
    fn special_coordinates() {
        for (shape, expected) in ALL.into_iter().zip([
            [0.0, 1.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0; 3],
            [0.0; 3],
            [0.0, 0.5, 1.0],
        ]) {
            let found = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].map(|x| value(shape, [x, 0.5, 0.25]));
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn bounds_hold_and_keep_what_is_empty() {
        let interval = |center: f32, radius: f32| Interval::new(center - radius, center + radius);
        for shape in ALL {
            for step in 0..200 {
                let center = [step as f32 * 0.013 - 1.3, 0.4 - step as f32 * 0.004, 0.1];
                let bounds = shape.enclose(center.map(|x| interval(x, 0.01))).saturate();
                for sign in [-1.0, 0.0, 1.0_f32] {
                    let inside = center.map(|x| (x + sign * 0.01).clamp(x - 0.01, x + 0.01));
                    assert!(bounds.contains(f64::from(value(shape, inside))));
                }
                // The step at negative x apart, no ramp is steep.
                assert!(matches!(shape, Shape::Radial) || bounds.high - bounds.low < 0.1);
            }
        }
        let outside = [interval(-2.0, 0.5), interval(0.1, 0.1), interval(0.1, 0.1)];
        for shape in [Shape::Linear, Shape::Quadratic, Shape::Easing, Shape::Spherical, Shape::QuadraticSphere] {
            assert_eq!(shape.enclose(outside).saturate().as_point(), Some(0.0));
        }
    }
}
