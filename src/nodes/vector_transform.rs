//! Vector Transform (`ShaderNodeVectorTransform`): a vector of the world in the space of the shaded object, or back.
//!
//! Points are moved, vectors are not; normals are transformed by the transpose of the opposite matrix and normalised, which
//! towards the world has no guard: a normal of length 0 is NaN there. From a space to itself nothing happens. The space of the
//! camera is refused. Neither Blender nor Cycles folds the node.

use crate::base::arrays::Mapped;
use crate::base::error::{Error, Result};
use crate::nodes::real::{Real, dot, length, safe_unit};
use crate::nodes::rotation::enclose_unit;
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, Mode, NodeType, OutputSocket, Property, Role, Simplified, always,
    vector_at, vector_output,
};
use crate::scene::{Matrix, Release, SocketType};
use std::fmt::Write;

/// The node type. Its mode carries the object's [`Frame`].
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeVectorTransform",
    label: "Vector Transform",
    module: "vector_transform",
    shader: include_str!("../../shaders/nodes/vector_transform.wgsl"),
    properties: &[
        Property::choice("vector_type", &["VECTOR", "POINT", "NORMAL"]),
        Property::choice("convert_from", &["WORLD", "OBJECT"]),
        Property::choice("convert_to", &["OBJECT", "WORLD"]),
    ],
    inputs: &[InputSocket::vector("Vector", "Vector", &[0.5; 3], always).zero_in_cycles()],
    outputs: &[OutputSocket::new("Vector", SocketType::Vector, always)],
    role: Role::Evaluated(|mode| Box::new(VectorTransform::new(mode))),
};

/// Three rows of four: a linear part and a translation.
pub type Rows = [[f32; 4]; 3];

/// Where an object is: the matrices that Cycles transforms with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Object to world.
    pub to_world: Rows,
    /// World to object.
    pub to_object: Rows,
}

impl Default for Frame {
    fn default() -> Self {
        let identity = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        Self { to_world: identity, to_object: identity }
    }
}

impl Frame {
    /// The frame of an object with this world matrix, as a release of Blender has it. `place` names the node in errors.
    pub fn of(matrix_world: &Matrix, release: Release, place: &str) -> Result<Self> {
        let to_world = [matrix_world[0], matrix_world[1], matrix_world[2]];
        let to_object = inverse(&to_world, release);
        if to_object.as_flattened().iter().all(|x| x.is_finite()) {
            return Ok(Self { to_world, to_object });
        }
        Err(Error::new(
            place.to_owned(),
            "an object whose matrix has no inverse in f32",
            "an object of moderate size",
            "Change the scale of the object.",
        ))
    }
}

/// The inverse bit for bit as Cycles has it: cofactors with one fused product, times the reciprocal of the determinant. In 5.0.1
/// determinant and translation have fused products, too, in this order (measured: equal for 56 random matrices); since 5.1 they
/// have none (equal for 80 random matrices in 5.1.2 and 5.3.0).
fn inverse(rows: &Rows, release: Release) -> Rows {
    let since_5_1 = release >= Release::V5_1;
    let column = |number: usize| rows.mapped(|row| row[number]);
    let [x, y, z, translation] = [0, 1, 2, 3].mapped(column);
    // A component of the cross product; one of its two products is rounded before they are subtracted.
    let cofactor = |a: [f32; 3], b: [f32; 3], axis: usize, rounds_second: bool| {
        let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
        if rounds_second { a[j].mul_add(b[k], -(a[k] * b[j])) } else { (-a[k]).mul_add(b[j], a[j] * b[k]) }
    };
    let sum_of_products = |a: [f32; 3], b: [f32; 3]| {
        if since_5_1 { dot(a, b) } else { a[2].mul_add(b[2], a[0].mul_add(b[0], a[1] * b[1])) }
    };
    let adjugate: [[f32; 3]; 3] = [
        [0, 1, 2].mapped(|axis| cofactor(y, z, axis, since_5_1 || axis == 0)),
        [0, 1, 2].mapped(|axis| cofactor(z, x, axis, true)),
        [0, 1, 2].mapped(|axis| cofactor(x, y, axis, true)),
    ];
    let reciprocal = 1.0 / sum_of_products(x, adjugate[0]);
    adjugate.mapped(|row| {
        let row = row.mapped(|entry| entry * reciprocal);
        [row[0], row[1], row[2], -sum_of_products(row, translation)]
    })
}

/// What the vector is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Point,
    Vector,
    Normal,
}

struct VectorTransform {
    kind: Kind,
    /// From a space to itself.
    stays: bool,
    /// The rows that the vector is multiplied with: of a normal, those of the opposite matrix' transpose.
    rows: Rows,
    /// A normal without length stays what it is.
    guarded: bool,
}

impl VectorTransform {
    fn new(mode: &Mode) -> Self {
        let kind = match mode.choice("vector_type") {
            "POINT" => Kind::Point,
            "VECTOR" => Kind::Vector,
            _ => Kind::Normal,
        };
        let frame = mode.frame();
        let to_object = mode.choice("convert_to") == "OBJECT";
        let [along, against] =
            if to_object { [frame.to_object, frame.to_world] } else { [frame.to_world, frame.to_object] };
        let rows = if kind == Kind::Normal {
            [0, 1, 2].mapped(|axis| [against[0][axis], against[1][axis], against[2][axis], 0.0])
        } else {
            along
        };
        Self { kind, stays: mode.choice("convert_from") == mode.choice("convert_to"), rows, guarded: to_object }
    }

    /// `kind` is the node's, known where this is compiled.
    #[inline(always)]
    fn transformed<R: Real>(&self, kind: Kind, rows: &[[R; 4]; 3], [x, y, z]: [R; 3]) -> [R; 3] {
        match kind {
            Kind::Point => rows.mapped(|row| ((row[3] + z * row[2]) + y * row[1]) + x * row[0]),
            Kind::Vector => rows.mapped(|row| (z * row[2] + y * row[1]) + x * row[0]),
            Kind::Normal => {
                let normal = rows.mapped(|row| dot([x, y, z], [row[0], row[1], row[2]]));
                if self.guarded {
                    return safe_unit(normal);
                }
                let norm = length(normal);
                normal.mapped(|x| x / norm)
            }
        }
    }

    #[inline(always)]
    fn evaluate_as<R: Real>(&self, kind: Kind, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        let outputs = vector_output(outputs);
        let rows = self.rows.mapped(|row| row.mapped(R::of));
        for index in 0..outputs[0].len() {
            let vector = vector_at(inputs, 0, index);
            let result = if self.stays { vector } else { self.transformed(kind, &rows, vector) };
            for axis in 0..3 {
                outputs[axis][index] = result[axis];
            }
        }
    }
}

impl Evaluate for VectorTransform {
    fn folds_late(&self) -> bool {
        false
    }

    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        match self.kind {
            Kind::Point => self.evaluate_as(Kind::Point, inputs, outputs),
            Kind::Vector => self.evaluate_as(Kind::Vector, inputs, outputs),
            Kind::Normal => self.evaluate_as(Kind::Normal, inputs, outputs),
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let [x, y, z] = [inputs[0], inputs[1], inputs[2]];
        let rows = self.rows.mapped(|row| row.mapped(Interval::point));
        let result = match (self.stays, self.kind) {
            (true, _) => [x, y, z],
            (_, Kind::Point) => rows.mapped(|row| ((row[3] + z * row[2]) + y * row[1]) + x * row[0]),
            (_, Kind::Vector) => rows.mapped(|row| (z * row[2] + y * row[1]) + x * row[0]),
            (_, Kind::Normal) => {
                let normal = rows.mapped(|row| (x * row[0] + y * row[1]) + z * row[2]);
                if self.guarded { super::vector_math::bounds::safe_unit(normal) } else { enclose_unit(normal) }
            }
        };
        outputs.copy_from_slice(&result);
    }

    fn folds_early(&self) -> bool {
        false
    }

    fn simplify_constants(&self, _inputs: &[Option<f32>]) -> Option<Simplified> {
        self.stays.then(|| Simplified::Renames(vec![0, 1, 2]))
    }

    fn shader_constants(&self) -> String {
        let mut text = String::new();
        for (name, [x, y, z, w]) in ["X", "Y", "Z"].into_iter().zip(self.rows) {
            writeln!(text, "const MATRIX_{name}: vec4f = vec4f({x:?}f, {y:?}f, {z:?}f, {w:?}f);")
                .expect("writing to a string cannot fail");
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::NodeEvaluator;
    use serde_json::json;

    /// A sheared, turned and moved object.
    const MATRIX: Matrix = [[0.9, -1.1, 0.3, 2.5], [0.7, 1.3, -0.2, -1.25], [0.1, 0.4, 1.9, 3.3], [0.0, 0.0, 0.0, 1.0]];

    fn evaluator(kind: &str, from: &str, to: &str) -> Box<dyn NodeEvaluator> {
        let properties = json!({"vector_type": kind, "convert_from": from, "convert_to": to});
        let mode = Mode::read(&TYPE, properties.as_object().expect("properties"), "test").expect("a mode");
        let Role::Evaluated(build) = TYPE.role else { unreachable!("it evaluates") };
        build(&mode.with_frame(Frame::of(&MATRIX, Release::V5_0, "test").expect("an invertible matrix")))
    }

    fn value(evaluator: &dyn NodeEvaluator, vector: [f32; 3]) -> [f32; 3] {
        let columns = vector.each_ref().map(|value| Column { values: std::slice::from_ref(value), uniform: true });
        let mut result = [0.0; 3];
        let mut outputs: Vec<&mut [f32]> = result.iter_mut().map(std::slice::from_mut).collect();
        evaluator.evaluate_f32(&columns, &mut outputs);
        result
    }

    #[test]
    fn a_unit_vector_comes_out_as_in_cycles() {
        // Values of Cycles' SSE4.2 kernel, nine digits.
        for (kind, from, to, wanted) in [
            ("POINT", "WORLD", "OBJECT", [-0.131_111_09, 0.741_960_76, -1.886_143_7]),
            ("POINT", "OBJECT", "WORLD", [3.4, -0.55, 3.399_999_9]),
            ("VECTOR", "WORLD", "OBJECT", [0.666_666_6, -0.352_941_13, 0.039_215_684]),
            ("NORMAL", "WORLD", "OBJECT", [0.619_585_6, -0.757_271_23, 0.206_528_53]),
            ("NORMAL", "OBJECT", "WORLD", [0.754_731_9, 0.654_101, -0.050_315_46]),
        ] {
            assert_eq!(value(&*evaluator(kind, from, to), [1.0, 0.0, 0.0]), wanted, "{kind} {from} {to}");
        }
    }

    #[test]
    fn only_normals_towards_the_world_have_no_guard() {
        assert_eq!(value(&*evaluator("NORMAL", "WORLD", "OBJECT"), [0.0; 3]), [0.0; 3]);
        assert!(value(&*evaluator("NORMAL", "OBJECT", "WORLD"), [0.0; 3]).iter().all(|x| x.is_nan()));
        assert_eq!(value(&*evaluator("NORMAL", "WORLD", "WORLD"), [0.0, 3.0, 0.0]), [0.0, 3.0, 0.0]);
    }

    #[test]
    fn bounds_hold_in_a_frame_that_shears() {
        for kind in ["POINT", "VECTOR", "NORMAL"] {
            for (from, to) in [("WORLD", "OBJECT"), ("OBJECT", "WORLD"), ("OBJECT", "OBJECT")] {
                let evaluator = evaluator(kind, from, to);
                let inputs = [Interval::new(-1.0, 2.0), Interval::new(0.5, 0.75), Interval::point(-3.0)];
                let mut bounds = [Interval::ZERO; 3];
                evaluator.bounds(&inputs, &mut bounds);
                for step in 0..=8_u8 {
                    let t = f32::from(step) / 8.0;
                    let found = value(&*evaluator, [3.0 * t - 1.0, 0.75 - 0.25 * t, -3.0]);
                    for (x, interval) in found.into_iter().zip(bounds) {
                        assert!(interval.contains(f64::from(x)), "{kind} {from} {to}: {x} in {interval:?}");
                        assert!(interval.high - interval.low < 20.0);
                    }
                }
            }
        }
    }
}
