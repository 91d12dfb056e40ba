//! Vector Rotate (`ShaderNodeVectorRotate`): a vector turned about a centre, by an angle about an axis or by Euler angles.
//!
//! The axis is divided by its length; with an axis of length 0 the vector stays what it is. `invert` turns the other way. The
//! vector is a stored value where nothing is linked, not a texture coordinate (measured).

use crate::base::arrays::{Mapped, each};
use crate::nodes::real::{Real, dot, length};
use crate::nodes::rotation;
use crate::nodes::rotation::Rows;
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, Mode, NodeType, OutputSocket, Property, Role, always, vector_at,
    vector_output,
};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeVectorRotate",
    label: "Vector Rotate",
    module: "vector_rotate",
    shader: include_str!("../../shaders/nodes/vector_rotate.wgsl"),
    properties: &[
        Property::choice("rotation_type", &["AXIS_ANGLE", "X_AXIS", "Y_AXIS", "Z_AXIS", "EULER_XYZ"]),
        Property::flag("invert", false),
    ],
    inputs: &[
        InputSocket::vector("Vector", "Vector", &[0.0; 3], always).hiding_value(),
        InputSocket::vector("Center", "Center", &[0.0; 3], always),
        InputSocket::vector("Axis", "Axis", &[0.0, 0.0, 1.0], has_axis),
        InputSocket::float("Angle", "Angle", &[0.0], |mode| !is_euler(mode)),
        InputSocket::vector("Rotation", "Rotation", &[0.0; 3], is_euler),
    ],
    outputs: &[OutputSocket::new("Vector", SocketType::Vector, always)],
    role: Role::Evaluated(|mode| {
        Box::new(VectorRotate { turn: Turn::of(mode.choice("rotation_type")), invert: mode.flag("invert") })
    }),
};

fn has_axis(mode: &Mode) -> bool {
    mode.choice("rotation_type") == "AXIS_ANGLE"
}

fn is_euler(mode: &Mode) -> bool {
    mode.choice("rotation_type") == "EULER_XYZ"
}

/// What says how to turn.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Turn {
    /// An axis and an angle.
    AboutVector,
    /// An angle about a coordinate axis.
    About(usize),
    /// Euler angles.
    Euler,
}

impl Turn {
    fn of(name: &str) -> Self {
        match name {
            "AXIS_ANGLE" => Self::AboutVector,
            "X_AXIS" => Self::About(0),
            "Y_AXIS" => Self::About(1),
            "Z_AXIS" => Self::About(2),
            _ => Self::Euler,
        }
    }

    /// Number of columns that it takes.
    fn columns(self) -> usize {
        match self {
            Self::AboutVector => 4,
            Self::About(_) => 1,
            Self::Euler => 3,
        }
    }

    /// The coordinate axis, where there is one.
    #[inline(always)]
    fn fixed_axis(self) -> Option<[f32; 3]> {
        match self {
            Self::About(0) => Some([1.0, 0.0, 0.0]),
            Self::About(1) => Some([0.0, 1.0, 0.0]),
            Self::About(_) => Some([0.0, 0.0, 1.0]),
            _ => None,
        }
    }
}

struct VectorRotate {
    turn: Turn,
    invert: bool,
}

/// Column of the centre.
const CENTER: usize = 3;

/// First column of what says how to turn.
const TURN: usize = 6;

/// Square of the length up to which Blender's own functions take a vector for 0.
const SMALLEST_FOLDED_SQUARE: f32 = 1e-35;

impl VectorRotate {
    /// The rotation; none for an axis without length. `kind` is the node's, known where this is compiled.
    #[inline(always)]
    fn matrix<R: Real>(&self, kind: Turn, inputs: &[Column<'_, R>], index: usize) -> Option<Rows<R>> {
        if kind == Turn::Euler {
            let rows = rotation::euler(vector_at(inputs, TURN, index).mapped(rotation::sine_and_cosine));
            return Some(if self.invert { rotation::transposed(&rows) } else { rows });
        }
        let angle = inputs[TURN + kind.columns() - 1].values[index];
        let turn = rotation::sine_and_cosine(if self.invert { -angle } else { angle });
        let axis = match kind.fixed_axis() {
            Some(axis) => axis.map(R::of),
            None => {
                let axis = vector_at(inputs, TURN, index);
                let norm = length(axis);
                if norm == R::of(0.0) {
                    return None;
                }
                axis.mapped(|x| x / norm)
            }
        };
        Some(rotation::about_axis(axis, turn, R::of(1.0)))
    }

    #[inline(always)]
    fn evaluate_as<R: Real>(&self, kind: Turn, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        let outputs = vector_output(outputs);
        // Angles and axes are constants nearly always.
        let is_fixed = inputs[TURN..TURN + kind.columns()].iter().all(|column| column.uniform);
        let fixed = (is_fixed && !outputs[0].is_empty()).then(|| self.matrix(kind, inputs, 0));
        for index in 0..outputs[0].len() {
            let (vector, center) = (vector_at(inputs, 0, index), vector_at(inputs, CENTER, index));
            let result: [R; 3] = match fixed.unwrap_or_else(|| self.matrix(kind, inputs, index)) {
                Some(rows) => {
                    let from_center = each(|axis| vector[axis] - center[axis]);
                    let turned = if self.adds_from_right() {
                        rotation::apply(&rows, from_center)
                    } else {
                        rotation::apply_from_left(&rows, from_center)
                    };
                    each(|axis| turned[axis] + center[axis])
                }
                None => vector,
            };
            for axis in 0..3 {
                outputs[axis][index] = result[axis];
            }
        }
    }

    /// Whether sums go from the right: the plain matrix of Euler angles.
    fn adds_from_right(&self) -> bool {
        self.turn == Turn::Euler && !self.invert
    }

    /// Encloses the rotation, and says whether it is one: not a vanishing axis, nor one that overflows.
    fn enclose_matrix(&self, inputs: &[Interval]) -> (Rows<Interval>, bool) {
        if self.turn == Turn::Euler {
            let angles = [inputs[TURN], inputs[TURN + 1], inputs[TURN + 2]];
            let rows = rotation::euler(angles.mapped(rotation::enclose_sine_and_cosine));
            return (if self.invert { rotation::transposed(&rows) } else { rows }, true);
        }
        let angle = inputs[TURN + self.turn.columns() - 1];
        let turn = rotation::enclose_sine_and_cosine(if self.invert { -angle } else { angle });
        let (axis, sound) = match self.turn.fixed_axis() {
            Some(axis) => (axis.map(Interval::point), true),
            None => {
                let axis = [inputs[TURN], inputs[TURN + 1], inputs[TURN + 2]];
                // Guarded or not, where the length is no problem a unit vector is the same.
                (super::vector_math::bounds::safe_unit(axis), super::vector_math::bounds::is_sound(axis))
            }
        };
        let rows = rotation::about_axis(axis, turn, Interval::ONE);
        if !sound {
            return (rows, false);
        }
        let entry = Interval::new(-1.00001, 1.00001).or_nan(true);
        (rows.mapped(|row| row.mapped(|x| x.meet(entry))), true)
    }
}

/// The rotation of Euler angles as Blender folds it: products of the f32 sines and cosines are formed in f64.
fn folded_euler(angles: [f32; 3]) -> Rows<f32> {
    let [[si, ci], [sj, cj], [sh, ch]] = angles.mapped(|angle| [f64::from(angle.sin()), f64::from(angle.cos())]);
    let (cc, cs, sc, ss) = (ci * ch, ci * sh, si * ch, si * sh);
    [[cj * ch, sj * sc - cs, sj * cc + ss], [cj * sh, sj * ss + cc, sj * cs - sc], [-sj, cj * si, cj * ci]]
        .map(|row| row.map(|entry| entry as f32))
}

/// Blender inverts the matrix of Euler angles as any other: the adjugate times the reciprocal of the determinant.
fn folded_inverse(m: &Rows<f32>) -> Rows<f32> {
    let determinant = m[0][0] * (m[1][1] * m[2][2] - m[2][1] * m[1][2])
        - m[0][1] * (m[1][0] * m[2][2] - m[2][0] * m[1][2])
        + m[0][2] * (m[1][0] * m[2][1] - m[2][0] * m[1][1]);
    let scale = 1.0 / determinant;
    [
        [
            m[1][1] * m[2][2] - m[1][2] * m[2][1],
            -m[0][1] * m[2][2] + m[0][2] * m[2][1],
            m[0][1] * m[1][2] - m[0][2] * m[1][1],
        ],
        [
            -m[1][0] * m[2][2] + m[1][2] * m[2][0],
            m[0][0] * m[2][2] - m[0][2] * m[2][0],
            -m[0][0] * m[1][2] + m[0][2] * m[1][0],
        ],
        [
            m[1][0] * m[2][1] - m[1][1] * m[2][0],
            -m[0][0] * m[2][1] + m[0][1] * m[2][0],
            m[0][0] * m[1][1] - m[0][1] * m[1][0],
        ],
    ]
    .map(|row| row.map(|entry| entry * scale))
}

/// The rotation about an axis as Blender folds it; none about an axis that counts as zero.
fn folded_about(axis: [f32; 3], angle: f32) -> Rows<f32> {
    let square = dot(axis, axis);
    if square <= SMALLEST_FOLDED_SQUARE {
        return [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    }
    let scale = 1.0 / square.sqrt();
    let [x, y, z] = axis.mapped(|component| component * scale);
    let (sine, cosine) = (angle.sin(), angle.cos());
    let rest = 1.0 - cosine;
    let [sx, sy, sz] = [x, y, z].mapped(|component| component * sine);
    let [xx, xy, yy] = [(x * x) * rest, (x * y) * rest, (y * y) * rest];
    let [xz, yz, zz] = [(x * z) * rest, (y * z) * rest, (z * z) * rest];
    [[xx + cosine, xy - sz, xz + sy], [xy + sz, yy + cosine, yz - sx], [xz - sy, yz + sx, zz + cosine]]
}

impl Evaluate for VectorRotate {
    fn folds_late(&self) -> bool {
        false
    }

    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        match self.turn {
            Turn::AboutVector => self.evaluate_as(Turn::AboutVector, inputs, outputs),
            Turn::About(0) => self.evaluate_as(Turn::About(0), inputs, outputs),
            Turn::About(1) => self.evaluate_as(Turn::About(1), inputs, outputs),
            Turn::About(_) => self.evaluate_as(Turn::About(2), inputs, outputs),
            Turn::Euler => self.evaluate_as(Turn::Euler, inputs, outputs),
        }
    }

    fn fold_constants(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        let rows = match self.turn {
            Turn::Euler => {
                let rows = folded_euler([inputs[TURN], inputs[TURN + 1], inputs[TURN + 2]]);
                if self.invert { folded_inverse(&rows) } else { rows }
            }
            Turn::AboutVector => {
                let angle = inputs[TURN + 3];
                folded_about(
                    [inputs[TURN], inputs[TURN + 1], inputs[TURN + 2]],
                    if self.invert { -angle } else { angle },
                )
            }
            Turn::About(_) => return None,
        };
        // Blender goes through the centre in any case.
        let turned = rotation::apply_from_left(&rows, each(|axis| inputs[axis] - inputs[CENTER + axis]));
        Some((0..3).map(|axis| turned[axis] + inputs[CENTER + axis]).collect())
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let (rows, sound) = self.enclose_matrix(inputs);
        let from_center: [Interval; 3] = each(|axis| inputs[axis] - inputs[CENTER + axis]);
        let turned = if self.adds_from_right() {
            rotation::apply(&rows, from_center)
        } else {
            rotation::apply_from_left(&rows, from_center)
        };
        let turned = if sound { rotation::no_longer_than(turned, from_center) } else { turned };
        for axis in 0..3 {
            let result = turned[axis] + inputs[CENTER + axis];
            // Without a length of the axis the vector stays.
            outputs[axis] = if sound { result } else { result.hull(inputs[axis]) };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn value(properties: serde_json::Value, inputs: &[f32]) -> [f32; 3] {
        let properties = properties.as_object().expect("properties");
        let mode = Mode::read(&TYPE, properties, "test").expect("a mode");
        let Role::Evaluated(build) = TYPE.role else { unreachable!("it evaluates") };
        let columns: Vec<Column<'_, f32>> =
            inputs.iter().map(|value| Column { values: std::slice::from_ref(value), uniform: true }).collect();
        let mut result = [0.0; 3];
        let mut outputs: Vec<&mut [f32]> = result.iter_mut().map(std::slice::from_mut).collect();
        build(&mode).evaluate_f32(&columns, &mut outputs);
        result
    }

    #[test]
    fn a_stored_vector_turns_about_z_as_in_cycles() {
        // Values of Cycles' SSE4.2 kernel; the angles 1 and 0.3.
        let z = json!({"rotation_type": "Z_AXIS"});
        for (angle, wanted) in [(1.0, [-0.285_659_9, 0.480_518_88, 0.75]), (0.3, [0.091_074_02, 0.551_548_3, 0.75])] {
            let found = value(z.clone(), &[0.25, 0.5, 0.75, 0.0, 0.0, 0.0, angle]);
            assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-7), "{found:?}");
        }
    }

    #[test]
    fn an_axis_without_length_leaves_the_vector() {
        let inputs = |axis: f32| [1.0, 2.0, 3.0, 1e7, 0.0, 0.0, axis, 0.0, 0.0, 1.0];
        assert_eq!(value(json!({}), &inputs(0.0)), [1.0, 2.0, 3.0]);
        // Its square is 0 in f32.
        assert_eq!(value(json!({}), &inputs(1e-30)), [1.0, 2.0, 3.0]);
        assert_ne!(value(json!({}), &inputs(1e-10)), [1.0, 2.0, 3.0]);
    }

    #[test]
    fn blender_goes_through_the_center_with_an_axis_that_it_takes_for_none() {
        let evaluator = VectorRotate { turn: Turn::AboutVector, invert: false };
        let fold = |axis: f32| evaluator.fold_constants(&[0.3, -0.7, 0.4, 1e3, 2.0, 3.0, axis, 0.0, 0.0, 1.0]);
        assert_eq!(fold(0.0), Some(vec![0.299_987_8, -0.700_000_05, 0.400_000_1]));
        assert_eq!(fold(1e-20), fold(0.0));
        let turned = fold(1e-10).expect("a rotation about x");
        assert!((turned[0] - 0.3).abs() < 1e-4 && (turned[1] + 0.7).abs() > 0.1, "{turned:?}");
    }

    #[test]
    fn inverting_undoes() {
        for kind in ["AXIS_ANGLE", "X_AXIS", "Y_AXIS", "Z_AXIS", "EULER_XYZ"] {
            let (vector, center) = ([0.3, 0.7, -0.4], [0.5, -1.0, 2.0]);
            let turn: &[f32] = match kind {
                "AXIS_ANGLE" => &[1.0, -2.0, 0.5, 0.8],
                "EULER_XYZ" => &[0.4, -1.1, 2.3],
                _ => &[0.8],
            };
            let there = value(json!({"rotation_type": kind}), &[&vector[..], &center[..], turn].concat());
            let back = value(json!({"rotation_type": kind, "invert": true}), &[&there[..], &center[..], turn].concat());
            assert!(back.iter().zip(vector).all(|(a, b)| (a - b).abs() < 1e-6), "{kind}: {back:?}");
            assert!(there.iter().zip(vector).any(|(a, b)| (a - b).abs() > 0.1), "{kind}: {there:?}");
        }
    }
}
