//! Mapping (`ShaderNodeMapping`): scales, rotates (Euler angles) and moves a vector.
//!
//! Point does so in this order, Texture undoes it in the opposite one, Vector leaves the location out, and Normal divides by
//! the scale, rotates and normalises. Blender never folds the node; Cycles leaves out one that changes nothing, and makes one
//! with a constant scale of exactly 0 the constant 0, location included (measured).

use crate::base::arrays::{Mapped, each};
use crate::nodes::real::{Real, safe_unit};
use crate::nodes::rotation;
use crate::nodes::rotation::Rows;
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, Mode, NodeType, OutputSocket, Property, Role, Simplified, always,
    vector_at, vector_output,
};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeMapping",
    label: "Mapping",
    module: "mapping",
    shader: include_str!("../../shaders/nodes/mapping.wgsl"),
    properties: &[Property::choice("vector_type", &["POINT", "TEXTURE", "VECTOR", "NORMAL"])],
    inputs: &[
        InputSocket::vector("Vector", "Vector", &[0.0; 3], always),
        InputSocket::vector("Location", "Location", &[0.0; 3], has_location),
        InputSocket::vector("Rotation", "Rotation", &[0.0; 3], always),
        InputSocket::vector("Scale", "Scale", &[1.0; 3], always),
    ],
    outputs: &[OutputSocket::new("Vector", SocketType::Vector, always)],
    role: Role::Evaluated(|mode| {
        Box::new(Mapping {
            kind: Kind::of(mode.choice("vector_type")),
            rotation: if has_location(mode) { 6 } else { 3 },
        })
    }),
};

fn has_location(mode: &Mode) -> bool {
    matches!(mode.choice("vector_type"), "POINT" | "TEXTURE")
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Point,
    Texture,
    Vector,
    Normal,
}

impl Kind {
    fn of(name: &str) -> Self {
        match name {
            "POINT" => Self::Point,
            "TEXTURE" => Self::Texture,
            "VECTOR" => Self::Vector,
            _ => Self::Normal,
        }
    }
}

struct Mapping {
    kind: Kind,
    /// First column of the rotation; the scale follows it. The location stands before it, if there is one.
    rotation: usize,
}

/// The first column of the location, where there is one.
const LOCATION: usize = 3;

impl Mapping {
    fn scale(&self) -> usize {
        self.rotation + 3
    }

    #[inline(always)]
    fn matrix<R: Real>(&self, inputs: &[Column<'_, R>], index: usize) -> Rows<R> {
        rotation::euler(vector_at(inputs, self.rotation, index).mapped(rotation::sine_and_cosine))
    }

    #[inline(always)]
    fn mapped<R: Real>(&self, inputs: &[Column<'_, R>], rows: &Rows<R>, index: usize) -> [R; 3] {
        let (vector, scale) = (vector_at(inputs, 0, index), vector_at(inputs, self.scale(), index));
        let location = || vector_at(inputs, LOCATION, index);
        let each = |a: [R; 3], b: [R; 3], function: fn(R, R) -> R| each(|axis| function(a[axis], b[axis]));
        match self.kind {
            Kind::Point => each(rotation::apply(rows, each(vector, scale, R::mul)), location(), R::add),
            Kind::Texture => {
                let moved = each(vector, location(), R::sub);
                each(rotation::apply_from_left(&rotation::transposed(rows), moved), scale, R::safe_divide)
            }
            Kind::Vector => rotation::apply(rows, each(vector, scale, R::mul)),
            Kind::Normal => safe_unit(rotation::apply(rows, each(vector, scale, R::safe_divide))),
        }
    }
}

impl Evaluate for Mapping {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        let outputs = vector_output(outputs);
        // Angles are constants nearly always.
        let angles = &inputs[self.rotation..self.rotation + 3];
        let is_fixed = angles.iter().all(|column| column.uniform) && !outputs[0].is_empty();
        let fixed = is_fixed.then(|| self.matrix(inputs, 0));
        for index in 0..outputs[0].len() {
            let rows = fixed.unwrap_or_else(|| self.matrix(inputs, index));
            let result = self.mapped(inputs, &rows, index);
            for axis in 0..3 {
                outputs[axis][index] = result[axis];
            }
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let at = |first: usize| [inputs[first], inputs[first + 1], inputs[first + 2]];
        let (vector, scale) = (at(0), at(self.scale()));
        let rows = rotation::euler(at(self.rotation).mapped(rotation::enclose_sine_and_cosine));
        let each = |a: [Interval; 3], b: [Interval; 3], function: fn(Interval, Interval) -> Interval| {
            each(|axis| function(a[axis], b[axis]))
        };
        let rotated = |vector: [Interval; 3]| rotation::no_longer_than(rotation::apply(&rows, vector), vector);
        let result: [Interval; 3] = match self.kind {
            Kind::Point => each(rotated(each(vector, scale, |a, b| a * b)), at(LOCATION), |a, b| a + b),
            Kind::Texture => {
                let moved = each(vector, at(LOCATION), |a, b| a - b);
                let turned = rotation::apply_from_left(&rotation::transposed(&rows), moved);
                each(rotation::no_longer_than(turned, moved), scale, Interval::safe_divide)
            }
            Kind::Vector => rotated(each(vector, scale, |a, b| a * b)),
            Kind::Normal => super::vector_math::bounds::safe_unit(rotated(each(vector, scale, Interval::safe_divide))),
        };
        outputs.copy_from_slice(&result);
    }

    fn folds_early(&self) -> bool {
        false
    }

    fn fold_constants_late(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        // Cycles adds from the left where it folds the node by itself.
        let at = |first: usize| [inputs[first], inputs[first + 1], inputs[first + 2]];
        let (vector, scale) = (at(0), at(self.scale()));
        let rows = rotation::euler(at(self.rotation).mapped(rotation::sine_and_cosine));
        let scaled = |function: fn(f32, f32) -> f32| each(|axis| function(vector[axis], scale[axis]));
        let result: [f32; 3] = match self.kind {
            Kind::Point => {
                let rotated = rotation::apply_from_left(&rows, scaled(|value, factor| value * factor));
                each(|axis| rotated[axis] + inputs[LOCATION + axis])
            }
            Kind::Vector => rotation::apply_from_left(&rows, scaled(|value, factor| value * factor)),
            Kind::Normal => safe_unit(rotation::apply_from_left(&rows, scaled(f32::safe_divide))),
            Kind::Texture => return None,
        };
        Some(result.to_vec())
    }

    fn simplify_constants(&self, inputs: &[Option<f32>]) -> Option<Simplified> {
        let is = |first: usize, value: f32| inputs[first..first + 3].iter().all(|input| *input == Some(value));
        if is(self.scale(), 0.0) {
            return Some(Simplified::Constant(vec![0.0; 3]));
        }
        let stays = self.rotation == LOCATION || is(LOCATION, 0.0);
        let changes_nothing = stays && is(self.rotation, 0.0) && is(self.scale(), 1.0);
        (self.kind != Kind::Normal && changes_nothing).then(|| Simplified::Inputs(vec![0, 1, 2]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::NodeEvaluator;

    fn evaluator(kind: &str) -> Box<dyn NodeEvaluator> {
        let mut properties = serde_json::Map::new();
        properties.insert("vector_type".into(), kind.into());
        let mode = Mode::read(&TYPE, &properties, "test").expect("a mode");
        let Role::Evaluated(build) = TYPE.role else { unreachable!("it evaluates") };
        build(&mode)
    }

    fn value(kind: &str, inputs: &[f32]) -> [f32; 3] {
        let columns: Vec<Column<'_, f32>> =
            inputs.iter().map(|value| Column { values: std::slice::from_ref(value), uniform: true }).collect();
        let mut result = [0.0; 3];
        let mut outputs: Vec<&mut [f32]> = result.iter_mut().map(std::slice::from_mut).collect();
        evaluator(kind).evaluate_f32(&columns, &mut outputs);
        result
    }

    #[test]
    fn a_texture_mapping_undoes_that_of_a_point() {
        let (vector, rest) = ([0.3, 0.7, -0.4], [1.5, -2.0, 0.25, 0.4, -1.1, 2.3, 2.0, 0.5, -3.0]);
        let mapped = value("POINT", &[&vector[..], &rest[..]].concat());
        let back = value("TEXTURE", &[&mapped[..], &rest[..]].concat());
        for (found, wanted) in back.into_iter().zip(vector) {
            assert!((found - wanted).abs() < 1e-6, "{back:?}");
        }
    }

    #[test]
    fn a_linked_scale_of_zero_gives_the_location_and_a_stored_one_zero() {
        let rest = [5.0, 6.0, 7.0, 0.4, -1.1, 2.3, 0.0, 0.0, 0.0];
        assert_eq!(value("POINT", &[&[1.0, 2.0, 3.0][..], &rest[..]].concat()), [5.0, 6.0, 7.0]);
        assert_eq!(value("TEXTURE", &[&[1.0, 2.0, 3.0][..], &rest[..]].concat()), [0.0; 3]);
        assert_eq!(value("NORMAL", &[1.0, 2.0, 3.0, 0.4, -1.1, 2.3, 0.0, 0.0, 0.0]), [0.0; 3]);
        let known = [&[None; 3][..], &rest.map(Some)[..]].concat();
        assert_eq!(evaluator("POINT").simplify(&known), Some(Simplified::Constant(vec![0.0; 3])));
    }

    #[test]
    fn what_changes_nothing_is_left_out_but_for_normals() {
        let neutral = [None, None, None, Some(-0.0), Some(0.0), Some(0.0), Some(1.0), Some(1.0), Some(1.0)];
        assert_eq!(evaluator("VECTOR").simplify(&neutral), Some(Simplified::Inputs(vec![0, 1, 2])));
        assert_eq!(evaluator("NORMAL").simplify(&neutral), None);
        // The location counts.
        let moved = [&neutral[..3], &[Some(1.0), Some(0.0), Some(0.0)], &neutral[3..]].concat();
        assert_eq!(evaluator("POINT").simplify(&moved), None);
    }
}
