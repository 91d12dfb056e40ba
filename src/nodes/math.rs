//! Math (`ShaderNodeMath`): 41 operations on floats, with an optional clamp to [0, 1].
//!
//! Inputs a = `Value`, b = `Value_001`, c = `Value_002`. Division by zero, remainders by zero and
//! logarithms outside their domain give 0; see the formula beside each operation.

pub(super) mod bounds;

use crate::nodes::real::{Library, Real};
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Property, Role, Simplified, always, map,
};
use crate::scene::{Release, SocketType};

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeMath",
    label: "Math",
    module: "math",
    shader: include_str!("../../shaders/nodes/math.wgsl"),
    properties: &[Property::choice("operation", OPERATIONS), Property::flag("use_clamp", false)],
    inputs: &[
        InputSocket::float("Value", "Value", &[0.5], always),
        InputSocket::float("Value_001", "Value", &[0.5], |mode| inputs_of(mode.choice("operation")) >= 2),
        InputSocket::float("Value_002", "Value", &[0.5], |mode| inputs_of(mode.choice("operation")) >= 3)
            .zero_in_cycles(),
    ],
    outputs: &[OutputSocket::new("Value", SocketType::Float, always)],
    role: Role::Evaluated(|mode| {
        let (operation, clamp) = (mode.choice("operation"), mode.flag("use_clamp"));
        Box::new(Math { operation, clamp, release: mode.release() })
    }),
};

/// Blender's names of the operations.
pub const OPERATIONS: &[&str] = &[
    "ADD",
    "SUBTRACT",
    "MULTIPLY",
    "DIVIDE",
    "MULTIPLY_ADD",
    "POWER",
    "LOGARITHM",
    "SQRT",
    "INVERSE_SQRT",
    "ABSOLUTE",
    "EXPONENT",
    "MINIMUM",
    "MAXIMUM",
    "LESS_THAN",
    "GREATER_THAN",
    "SIGN",
    "COMPARE",
    "SMOOTH_MIN",
    "SMOOTH_MAX",
    "ROUND",
    "FLOOR",
    "CEIL",
    "TRUNC",
    "FRACT",
    "MODULO",
    "FLOORED_MODULO",
    "WRAP",
    "SNAP",
    "PINGPONG",
    "SINE",
    "COSINE",
    "TANGENT",
    "ARCSINE",
    "ARCCOSINE",
    "ARCTANGENT",
    "ARCTAN2",
    "SINH",
    "COSH",
    "TANH",
    "RADIANS",
    "DEGREES",
];

fn inputs_of(operation: &str) -> usize {
    match operation {
        "SQRT" | "INVERSE_SQRT" | "ABSOLUTE" | "EXPONENT" | "SIGN" | "ROUND" | "FLOOR" | "CEIL" | "TRUNC" | "FRACT"
        | "SINE" | "COSINE" | "TANGENT" | "ARCSINE" | "ARCCOSINE" | "ARCTANGENT" | "SINH" | "COSH" | "TANH"
        | "RADIANS" | "DEGREES" => 1,
        "MULTIPLY_ADD" | "COMPARE" | "SMOOTH_MIN" | "SMOOTH_MAX" | "WRAP" => 3,
        _ => 2,
    }
}

struct Math {
    operation: &'static str,
    clamp: bool,
    release: Release,
}

/// Smallest tolerance of Compare: the f32 machine epsilon.
const EPSILON: f32 = f32::EPSILON;

/// Sign with the kernel's NaN rule: anything that is neither 0 nor negative gives 1.
pub(super) fn sign<R: Real>(a: R) -> R {
    // Two selections: signs of random values are not worth predicting.
    let zero = R::of(0.0);
    let below = a.decided(zero, a < zero);
    // Neither above nor below is 0 alone: NaN is above.
    let above = a.decided(zero, !((a < zero) | (a == zero)));
    above - below
}

/// Polynomial smooth minimum of width `k`; the plain minimum for `k` = 0.
fn smooth_minimum<R: Real>(a: R, b: R, k: R) -> R {
    if k == R::of(0.0) {
        return a.fmin(b);
    }
    let h = (k - (a - b).abs()).fmax(R::of(0.0)) / k;
    a.fmin(b) - (((h * h) * h) * k) * R::of(1.0 / 6.0)
}

/// Rounds towards zero through floor and ceil.
fn truncate<R: Real>(a: R) -> R {
    if a >= R::of(0.0) { a.floor() } else { a.ceil() }
}

/// Triangle wave between 0 and `b`.
fn pingpong<R: Real>(a: R, b: R) -> R {
    if b == R::of(0.0) {
        return R::of(0.0);
    }
    // Halved before the division, not divided by 2 b: the same but for denormal and huge b.
    let periods = ((a - b) * R::of(0.5)) / b;
    ((periods.fraction() * b) * R::of(2.0) - b).abs()
}

/// `a` brought into [minimum, maximum).
pub(super) fn wrap<R: Real>(a: R, maximum: R, minimum: R) -> R {
    let range = maximum - minimum;
    if range != R::of(0.0) { a - range * ((a - minimum) / range).floor() } else { minimum }
}

impl Math {
    /// Calls `$one`, `$two` or `$three` with the operation as a closure of its arity.
    fn apply<R: Real>(&self, inputs: &[Column<'_, R>], output: &mut [R]) {
        let zero = R::of(0.0);
        let one = R::of(1.0);
        macro_rules! unary {
            ($function:expr) => {
                map(inputs, [0], output, |[a]: [R; 1]| $function(a))
            };
        }
        macro_rules! binary {
            ($function:expr) => {
                map(inputs, [0, 1], output, |[a, b]: [R; 2]| $function(a, b))
            };
        }
        macro_rules! ternary {
            ($function:expr) => {
                map(inputs, [0, 1, 2], output, |[a, b, c]: [R; 3]| $function(a, b, c))
            };
        }
        match self.operation {
            "ADD" => binary!(|a, b| a + b),
            "SUBTRACT" => binary!(|a, b| a - b),
            "MULTIPLY" => binary!(|a, b| a * b),
            "DIVIDE" => binary!(R::safe_divide),
            "MULTIPLY_ADD" => ternary!(|a, b, c| a * b + c),
            // Each a loop of its own: a function that is chosen at run time would not be inlined.
            "POWER" if self.release == Release::V4_5 => binary!(R::safe_power_before_5),
            "POWER" if self.release >= Release::V5_1 => binary!(R::safe_power_since_5_1),
            "POWER" => binary!(R::safe_power),
            "LOGARITHM" => binary!(|a: R, b: R| {
                if a <= zero || b <= zero { zero } else { a.library(Library::Ln).safe_divide(b.library(Library::Ln)) }
            }),
            "SQRT" => unary!(|a: R| a.greater(zero).sqrt()),
            "INVERSE_SQRT" => unary!(|a: R| if a > zero { one / a.sqrt() } else { zero }),
            "ABSOLUTE" => unary!(R::abs),
            "EXPONENT" => unary!(|a: R| a.library(Library::Exp)),
            "MINIMUM" => binary!(R::fmin),
            "MAXIMUM" => binary!(R::fmax),
            "LESS_THAN" => binary!(|a: R, b: R| a.decided(b, a < b)),
            "GREATER_THAN" => binary!(|a: R, b: R| a.decided(b, a > b)),
            "SIGN" => unary!(sign),
            "COMPARE" => ternary!(|a: R, b: R, c: R| {
                let (apart, most) = ((a - b).abs(), c.fmax(R::of(EPSILON)));
                apart.decided(most, (a == b) | (apart <= most))
            }),
            "SMOOTH_MIN" => ternary!(smooth_minimum),
            "SMOOTH_MAX" => ternary!(|a: R, b: R, c: R| -smooth_minimum(-a, -b, c)),
            "ROUND" => unary!(|a: R| (a + R::of(0.5)).floor()),
            "FLOOR" => unary!(R::floor),
            "CEIL" => unary!(R::ceil),
            "TRUNC" => unary!(truncate),
            "FRACT" => unary!(R::fraction),
            "MODULO" => binary!(|a: R, b: R| if b != zero { a.fmod(b) } else { zero }),
            "FLOORED_MODULO" => binary!(|a: R, b: R| if b != zero { a - (a / b).floor() * b } else { zero }),
            "WRAP" => ternary!(wrap),
            "SNAP" => binary!(|a: R, b: R| a.safe_divide(b).floor() * b),
            "PINGPONG" => binary!(pingpong),
            "SINE" => unary!(|a: R| a.library(Library::Sin)),
            "COSINE" => unary!(|a: R| a.library(Library::Cos)),
            "TANGENT" => unary!(|a: R| a.library(Library::Tan)),
            "ARCSINE" => unary!(|a: R| a.clamped(-one, one).library(Library::Asin)),
            "ARCCOSINE" => unary!(|a: R| a.clamped(-one, one).library(Library::Acos)),
            "ARCTANGENT" => unary!(|a: R| a.library(Library::Atan)),
            "ARCTAN2" => binary!(|a: R, b: R| if a == zero && b == zero { zero } else { a.atan2(b) }),
            "SINH" => unary!(|a: R| a.library(Library::Sinh)),
            "COSH" => unary!(|a: R| a.library(Library::Cosh)),
            "TANH" => unary!(|a: R| a.library(Library::Tanh)),
            "RADIANS" => unary!(|a: R| a * R::of(std::f32::consts::PI / 180.0)),
            "DEGREES" => unary!(|a: R| a * R::of(180.0 / std::f32::consts::PI)),
            other => unreachable!("{other} is not in OPERATIONS"),
        }
    }
}

impl Evaluate for Math {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        let output = &mut *outputs[0];
        self.apply(inputs, output);
        if self.clamp {
            for value in output {
                *value = value.saturate();
            }
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let value = match (self.operation, inputs) {
            ("POWER", &[base, exponent]) => base.power_of(self.release, exponent),
            _ => bounds::operation(self.operation, inputs),
        };
        outputs[0] = if self.clamp { value.saturate() } else { value };
    }

    fn fold_constants(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        // Blender's own power knows no special case for a zero base; its angles convert in f64.
        let value = match self.operation {
            "POWER" if inputs[0] == 0.0 && inputs[1] < 0.0 => f32::INFINITY,
            "RADIANS" => (f64::from(inputs[0]) * (std::f64::consts::PI / 180.0)) as f32,
            "DEGREES" => (f64::from(inputs[0]) * (180.0 / std::f64::consts::PI)) as f32,
            _ => return None,
        };
        Some(vec![if self.clamp { value.saturate() } else { value }])
    }

    fn simplify_constants(&self, inputs: &[Option<f32>]) -> Option<Simplified> {
        if self.clamp {
            return None;
        }
        simplify(self.operation, inputs[0], inputs.get(1).copied().flatten()).map(|kept| match kept {
            Kept::First => Simplified::Inputs(vec![0]),
            Kept::Second => Simplified::Inputs(vec![1]),
            Kept::Value(value) => Simplified::Constant(vec![value]),
        })
    }
}

/// What remains of an operation with a constant operand.
pub(super) enum Kept {
    /// The first operand.
    First,
    /// The second operand.
    Second,
    /// A constant.
    Value(f32),
}

/// Cycles' rules for neutral and absorbing constants; visible where the other operand is NaN or infinite, because there
/// `x*0` would not be 0, and in what reads the result: of a constant, or of a link that is passed on.
pub(super) fn simplify(operation: &str, a: Option<f32>, b: Option<f32>) -> Option<Kept> {
    match (operation, a, b) {
        ("ADD", Some(0.0), _) => Some(Kept::Second),
        ("ADD" | "SUBTRACT", _, Some(0.0)) => Some(Kept::First),
        ("MULTIPLY", Some(1.0), _) => Some(Kept::Second),
        ("MULTIPLY" | "DIVIDE", _, Some(1.0)) => Some(Kept::First),
        ("MULTIPLY", Some(0.0), _) | ("MULTIPLY", _, Some(0.0)) | ("DIVIDE", Some(0.0), _) => Some(Kept::Value(0.0)),
        ("POWER", Some(1.0), _) | ("POWER", _, Some(0.0)) => Some(Kept::Value(1.0)),
        ("POWER", _, Some(1.0)) => Some(Kept::First),
        _ => None,
    }
}
