//! Vector Math (`ShaderNodeVectorMath`): 30 operations on 3-vectors; Round came with Blender 5.1.
//!
//! Inputs a = `Vector`, b = `Vector_001`, c = `Vector_002`, s = `Scale`; result `Vector`, or
//! `Value` for dot product, distance and length. Component-wise where nothing else is said.

pub(super) mod bounds;

use crate::base::arrays::{self, Mapped};
use crate::nodes::math::{Kept, sign, simplify};
use crate::nodes::real::{Library, Real, dot, length, safe_unit};
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, Mode, NodeType, OutputSocket, Property, Role, Simplified, always,
    vector_at, vector_output,
};
use crate::scene::{Release, SocketType};

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeVectorMath",
    label: "Vector Math",
    module: "vector_math",
    shader: include_str!("../../shaders/nodes/vector_math.wgsl"),
    properties: &[Property::choice("operation", OPERATIONS)],
    inputs: &[
        InputSocket::vector("Vector", "Vector", &[0.0; 3], always),
        InputSocket::vector("Vector_001", "Vector", &[0.0; 3], |mode| vectors_of(mode) >= 2),
        InputSocket::vector("Vector_002", "Vector", &[0.0; 3], |mode| vectors_of(mode) >= 3),
        InputSocket::float("Scale", "Scale", &[1.0], |mode| matches!(mode.choice("operation"), "SCALE" | "REFRACT")),
    ],
    outputs: &[
        OutputSocket::new("Vector", SocketType::Vector, |mode| !gives_value(mode.choice("operation"))),
        OutputSocket::new("Value", SocketType::Float, |mode| gives_value(mode.choice("operation"))),
    ],
    role: Role::Evaluated(|mode| {
        let (operation, vectors) = (mode.choice("operation"), vectors_of(mode));
        Box::new(VectorMath { operation, vectors, release: mode.release() })
    }),
};

/// Blender's names of the operations; later ones are in [`crate::nodes::additions`].
pub const OPERATIONS: &[&str] = &[
    "ADD",
    "SUBTRACT",
    "MULTIPLY",
    "DIVIDE",
    "MULTIPLY_ADD",
    "CROSS_PRODUCT",
    "PROJECT",
    "REFLECT",
    "REFRACT",
    "FACEFORWARD",
    "DOT_PRODUCT",
    "DISTANCE",
    "LENGTH",
    "SCALE",
    "NORMALIZE",
    "ABSOLUTE",
    "POWER",
    "SIGN",
    "MINIMUM",
    "MAXIMUM",
    "FLOOR",
    "CEIL",
    "FRACTION",
    "MODULO",
    "WRAP",
    "SNAP",
    "SINE",
    "COSINE",
    "TANGENT",
];

fn gives_value(operation: &str) -> bool {
    matches!(operation, "DOT_PRODUCT" | "DISTANCE" | "LENGTH")
}

fn vectors_of(mode: &Mode) -> usize {
    match mode.choice("operation") {
        "LENGTH" | "SCALE" | "NORMALIZE" | "ABSOLUTE" | "SIGN" | "ROUND" | "FLOOR" | "CEIL" | "FRACTION" | "SINE"
        | "COSINE" | "TANGENT" => 1,
        "MULTIPLY_ADD" | "FACEFORWARD" | "WRAP" => 3,
        _ => 2,
    }
}

struct VectorMath {
    operation: &'static str,
    vectors: usize,
    release: Release,
}

/// `function` on each component of two vectors.
fn each<R: Real>(a: [R; 3], b: [R; 3], function: impl Fn(R, R) -> R) -> [R; 3] {
    arrays::each(|axis| function(a[axis], b[axis]))
}

fn cross<R: Real>(a: [R; 3], b: [R; 3]) -> [R; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Unit vector as Blender folds it: divided by the length, 0 where that is hardly a number.
fn folded_unit(v: [f32; 3]) -> [f32; 3] {
    let square = dot(v, v);
    if square > 1e-35 { v.mapped(|x| x / square.sqrt()) } else { [0.0; 3] }
}

fn reflect<R: Real>(a: [R; 3], b: [R; 3]) -> [R; 3] {
    reflect_at(a, safe_unit(b))
}

fn reflect_at<R: Real>(a: [R; 3], normal: [R; 3]) -> [R; 3] {
    let product = dot(a, normal);
    each(a, normal, |x, n| x - (R::of(2.0) * n) * product)
}

fn refract<R: Real>(a: [R; 3], b: [R; 3], eta: R) -> [R; 3] {
    refract_at(a, safe_unit(b), eta)
}

fn refract_at<R: Real>(a: [R; 3], normal: [R; 3], eta: R) -> [R; 3] {
    let one = R::of(1.0);
    let cosine = dot(normal, a);
    let k = one - (eta * eta) * (one - cosine * cosine);
    if k < R::of(0.0) {
        return [R::of(0.0); 3];
    }
    let along = eta * cosine + k.sqrt();
    each(a, normal, |x, n| eta * x - along * n)
}

fn project<R: Real>(a: [R; 3], b: [R; 3]) -> [R; 3] {
    let square = dot(b, b);
    if square != R::of(0.0) {
        let factor = dot(a, b) / square;
        b.mapped(|x| factor * x)
    } else {
        [R::of(0.0); 3]
    }
}

fn wrap<R: Real>(a: R, maximum: R, minimum: R) -> R {
    let value = a - minimum;
    let range = maximum - minimum;
    let wrapped = (value - (value / range).floor() * range) + minimum;
    if range == R::of(0.0) { minimum } else { wrapped }
}

impl Evaluate for VectorMath {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        let zero = R::of(0.0);
        let before_5 = self.release == Release::V4_5;
        let scale = 3 * self.vectors;
        if gives_value(self.operation) {
            for index in 0..outputs[0].len() {
                let a = vector_at(inputs, 0, index);
                outputs[0][index] = match self.operation {
                    "LENGTH" => length(a),
                    "DOT_PRODUCT" => dot(a, vector_at(inputs, 3, index)),
                    _ => length(each(a, vector_at(inputs, 3, index), |x, y| x - y)),
                };
            }
            return;
        }
        let outputs = vector_output(outputs);
        macro_rules! vectors {
            (|$index:ident| $body:expr) => {
                for $index in 0..outputs[0].len() {
                    let result: [R; 3] = $body;
                    for axis in 0..3 {
                        outputs[axis][$index] = result[axis];
                    }
                }
            };
        }
        macro_rules! unary {
            ($function:expr) => {
                vectors!(|index| $function(vector_at(inputs, 0, index)))
            };
        }
        macro_rules! binary {
            ($function:expr) => {
                vectors!(|index| $function(vector_at(inputs, 0, index), vector_at(inputs, 3, index)))
            };
        }
        match self.operation {
            "ADD" => binary!(|a, b| each(a, b, |x, y| x + y)),
            "SUBTRACT" => binary!(|a, b| each(a, b, |x, y| x - y)),
            "MULTIPLY" => binary!(|a, b| each(a, b, |x, y| x * y)),
            "DIVIDE" => binary!(|a, b| each(a, b, R::safe_divide)),
            "MULTIPLY_ADD" => vectors!(|index| {
                let product = each(vector_at(inputs, 0, index), vector_at(inputs, 3, index), |x, y| x * y);
                each(product, vector_at(inputs, 6, index), |x, y| x + y)
            }),
            "CROSS_PRODUCT" => binary!(cross),
            "PROJECT" => binary!(project),
            "REFLECT" => binary!(reflect),
            "REFRACT" => vectors!(|index| refract(
                vector_at(inputs, 0, index),
                vector_at(inputs, 3, index),
                inputs[scale].values[index]
            )),
            "FACEFORWARD" => vectors!(|index| {
                let a = vector_at(inputs, 0, index);
                if dot(vector_at(inputs, 6, index), vector_at(inputs, 3, index)) < zero { a } else { a.mapped(|x| -x) }
            }),
            "SCALE" => vectors!(|index| {
                let factor = inputs[scale].values[index];
                vector_at(inputs, 0, index).mapped(|x| x * factor)
            }),
            "NORMALIZE" => unary!(safe_unit),
            "ABSOLUTE" => unary!(|a: [R; 3]| a.mapped(R::abs)),
            "POWER" if before_5 => binary!(|a, b| each(a, b, R::safe_power_before_5)),
            "POWER" if self.release >= Release::V5_1 => binary!(|a, b| each(a, b, R::safe_power_since_5_1)),
            "POWER" => binary!(|a, b| each(a, b, R::safe_power)),
            "SIGN" => unary!(|a: [R; 3]| a.mapped(sign)),
            "MINIMUM" => binary!(|a, b| each(a, b, R::lesser)),
            "MAXIMUM" => binary!(|a, b| each(a, b, R::greater)),
            "ROUND" => unary!(|a: [R; 3]| a.mapped(|x| (x + R::of(0.5)).floor())),
            "FLOOR" => unary!(|a: [R; 3]| a.mapped(R::floor)),
            "CEIL" => unary!(|a: [R; 3]| a.mapped(R::ceil)),
            "FRACTION" => unary!(|a: [R; 3]| a.mapped(R::fraction)),
            "MODULO" if before_5 => {
                binary!(|a, b| each(a, b, |x: R, y: R| if y != zero { x.fmod(y) } else { zero }))
            }
            // Not the exact remainder: the rounded quotient is truncated.
            "MODULO" => {
                binary!(|a, b| each(a, b, |x: R, y: R| { if y != zero { x - (x / y).trunc() * y } else { zero } }))
            }
            "WRAP" => vectors!(|index| {
                let [a, b, c] = [0, 3, 6].mapped(|first| vector_at(inputs, first, index));
                let wrap = if before_5 { super::math::wrap } else { wrap };
                arrays::each(|axis| wrap(a[axis], b[axis], c[axis]))
            }),
            "SNAP" => binary!(|a, b| each(a, b, |x: R, y: R| x.safe_divide(y).floor() * y)),
            "SINE" => unary!(|a: [R; 3]| a.mapped(|x| x.library(Library::Sin))),
            "COSINE" => unary!(|a: [R; 3]| a.mapped(|x| x.library(Library::Cos))),
            "TANGENT" => unary!(|a: [R; 3]| a.mapped(|x| x.library(Library::Tan))),
            other => unreachable!("{other} is not in OPERATIONS"),
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        // Operations with fewer operands do not read the others.
        let vector = |number: usize| {
            let first = if number < self.vectors { 3 * number } else { 0 };
            arrays::each(|axis| inputs[first + axis])
        };
        let scale = inputs.get(3 * self.vectors).copied().unwrap_or(Interval::ONE);
        let result = bounds::operation(self.operation, self.release, [vector(0), vector(1), vector(2)], scale);
        outputs.copy_from_slice(&result[..outputs.len()]);
    }

    fn fold_constants_late(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        // By itself Cycles takes the exact remainder, too, but 0 for a zero divisor.
        let remainder = |a: f32, b: f32| if b == 0.0 { 0.0 } else { a % b };
        (self.operation == "MODULO").then(|| (0..3).map(|axis| remainder(inputs[axis], inputs[3 + axis])).collect())
    }

    fn fold_constants(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        let vector = |first: usize| [inputs[first], inputs[first + 1], inputs[first + 2]];
        let special =
            |function: fn(f32, f32) -> f32| Some((0..3).map(|axis| function(inputs[axis], inputs[3 + axis])).collect());
        match self.operation {
            "POWER" => special(|a, b| if a == 0.0 && b < 0.0 { f32::INFINITY } else { a.safe_power(b) }),
            // Blender folds with the exact remainder, NaN for a zero divisor.
            "MODULO" => special(|a, b| a % b),
            // Units by division, cross products in f64, and Math's form of the wrap.
            "NORMALIZE" => Some(folded_unit(vector(0)).to_vec()),
            "REFLECT" => Some(reflect_at(vector(0), folded_unit(vector(3))).to_vec()),
            "REFRACT" => Some(refract_at(vector(0), folded_unit(vector(3)), inputs[6]).to_vec()),
            "CROSS_PRODUCT" => {
                Some(cross(vector(0).map(f64::from), vector(3).map(f64::from)).map(|x| x as f32).to_vec())
            }
            "WRAP" => {
                Some((0..3).map(|axis| super::math::wrap(inputs[axis], inputs[3 + axis], inputs[6 + axis])).collect())
            }
            _ => None,
        }
    }

    fn simplify_constants(&self, inputs: &[Option<f32>]) -> Option<Simplified> {
        let whole = |first: usize| -> Option<[f32; 3]> {
            Some([inputs.get(first).copied()??, inputs.get(first + 1).copied()??, inputs.get(first + 2).copied()??])
        };
        // A vector counts as the constant 0 or 1 when all its components are.
        let single = |vector: Option<[f32; 3]>| vector.filter(|v| v[0] == v[1] && v[1] == v[2]).map(|v| v[0]);
        let a = single(whole(0));
        let b = if self.vectors >= 2 { single(whole(3)) } else { None };
        let zero = |x: Option<f32>| x == Some(0.0);
        match self.operation {
            // (Of floats Cycles evaluates this.)
            "DIVIDE" if zero(b) => Some(Simplified::Constant(vec![0.0; 3])),
            "ADD" | "SUBTRACT" | "MULTIPLY" | "DIVIDE" => simplify(self.operation, a, b).map(|kept| match kept {
                Kept::First => Simplified::Inputs(vec![0, 1, 2]),
                Kept::Second => Simplified::Inputs(vec![3, 4, 5]),
                Kept::Value(value) => Simplified::Constant(vec![value; 3]),
            }),
            "DOT_PRODUCT" if zero(a) || zero(b) => Some(Simplified::Constant(vec![0.0])),
            "CROSS_PRODUCT" if zero(a) || zero(b) => Some(Simplified::Constant(vec![0.0; 3])),
            "SCALE" if zero(a) || zero(inputs[3]) => Some(Simplified::Constant(vec![0.0; 3])),
            "SCALE" if inputs[3] == Some(1.0) => Some(Simplified::Inputs(vec![0, 1, 2])),
            _ => None,
        }
    }
}
