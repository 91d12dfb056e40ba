//! Map Range (`ShaderNodeMapRange`): remaps a float or a vector from one range to another.
//!
//! Interpolation linear, stepped, smoothstep or smootherstep; `clamp` limits the result to the
//! target range. An empty source range gives 0 for floats and the target's lower end for vectors.

use crate::nodes::real::Real;
use crate::nodes::{Column, Evaluate, InputSocket, Interval, Mode, NodeType, OutputSocket, Property, Role};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeMapRange",
    label: "Map Range",
    module: "map_range",
    shader: include_str!("../../shaders/nodes/map_range.wgsl"),
    properties: &[
        Property::flag("clamp", true),
        Property::choice("interpolation_type", &["LINEAR", "STEPPED", "SMOOTHSTEP", "SMOOTHERSTEP"]),
        Property::choice("data_type", &["FLOAT", "FLOAT_VECTOR"]),
    ],
    inputs: &[
        InputSocket::float("Value", "Value", &[1.0], is_float),
        InputSocket::float("From Min", "From Min", &[0.0], is_float),
        InputSocket::float("From Max", "From Max", &[1.0], is_float),
        InputSocket::float("To Min", "To Min", &[0.0], is_float),
        InputSocket::float("To Max", "To Max", &[1.0], is_float),
        InputSocket::float("Steps", "Steps", &[4.0], |mode| is_float(mode) && is_stepped(mode)),
        InputSocket::vector("Vector", "Vector", &[0.0; 3], is_vector).hiding_value(),
        InputSocket::vector("From_Min_FLOAT3", "From Min", &[0.0; 3], is_vector),
        InputSocket::vector("From_Max_FLOAT3", "From Max", &[1.0; 3], is_vector),
        InputSocket::vector("To_Min_FLOAT3", "To Min", &[0.0; 3], is_vector),
        InputSocket::vector("To_Max_FLOAT3", "To Max", &[1.0; 3], is_vector),
        InputSocket::vector("Steps_FLOAT3", "Steps", &[4.0; 3], |mode| is_vector(mode) && is_stepped(mode)),
    ],
    outputs: &[
        OutputSocket::new("Result", SocketType::Float, is_float),
        OutputSocket::new("Vector", SocketType::Vector, is_vector),
    ],
    role: Role::Evaluated(|mode| {
        Box::new(MapRange {
            interpolation: Interpolation::of(mode.choice("interpolation_type")),
            clamp: mode.flag("clamp"),
            vector: is_vector(mode),
        })
    }),
};

fn is_float(mode: &Mode) -> bool {
    mode.choice("data_type") == "FLOAT"
}

fn is_vector(mode: &Mode) -> bool {
    !is_float(mode)
}

fn is_stepped(mode: &Mode) -> bool {
    mode.choice("interpolation_type") == "STEPPED"
}

/// How the factor follows the place in the range.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Interpolation {
    Linear,
    Stepped,
    Smooth,
    Smoother,
}

impl Interpolation {
    fn of(name: &str) -> Self {
        match name {
            "LINEAR" => Self::Linear,
            "STEPPED" => Self::Stepped,
            "SMOOTHSTEP" => Self::Smooth,
            _ => Self::Smoother,
        }
    }

    fn is_smooth(self) -> bool {
        matches!(self, Self::Smooth | Self::Smoother)
    }
}

struct MapRange {
    interpolation: Interpolation,
    clamp: bool,
    vector: bool,
}

/// Limits `value` to the range between `a` and `b`, whichever is lower.
#[inline(always)]
fn clamp_to<R: Real>(value: R, a: R, b: R) -> R {
    // Ends are sorted first: which one is lower is not worth predicting.
    let (low, high) = if a > b { (b, a) } else { (a, b) };
    value.clamped(low, high)
}

/// Factor of a stepped remap.
#[inline(always)]
fn stepped<R: Real>(t: R, steps: R) -> R {
    let step = (t * (steps + R::of(1.0))).floor() / steps;
    if steps > R::of(0.0) { step } else { R::of(0.0) }
}

/// Smootherstep between two edges.
fn smoother_step<R: Real>(value: R, edge0: R, edge1: R) -> R {
    (value - edge0).safe_divide(edge1 - edge0).clamped(R::of(0.0), R::of(1.0)).quintic()
}

/// The factor of one value, whose way is known where this is compiled: loops over points hold no decision then.
#[inline(always)]
fn factor<R: Real>(interpolation: Interpolation, value: R, from: [R; 2], steps: R) -> R {
    let linear = (value - from[0]) / (from[1] - from[0]);
    // Smooth factors of a reversed range are mirrored, not divided by a negative width.
    let is_reversed = from[0] > from[1];
    let [low, high] = if is_reversed { [from[1], from[0]] } else { from };
    let mirrored = |step: R| if is_reversed { R::of(1.0) - step } else { step };
    match interpolation {
        Interpolation::Linear => linear,
        Interpolation::Stepped => stepped(linear, steps),
        Interpolation::Smooth => mirrored(value.smooth_step(low, high)),
        Interpolation::Smoother => mirrored(smoother_step(value, low, high)),
    }
}

/// [`factor`] of a vector's component, which has rules of its own.
#[inline(always)]
fn component_factor<R: Real>(interpolation: Interpolation, value: R, from: [R; 2], steps: R) -> R {
    let t = (value - from[0]).safe_divide(from[1] - from[0]);
    let limited = t.saturate();
    match interpolation {
        Interpolation::Linear => t,
        Interpolation::Stepped => stepped(t, steps),
        Interpolation::Smooth => (R::of(3.0) - R::of(2.0) * limited) * (limited * limited),
        Interpolation::Smoother => limited.quintic(),
    }
}

impl MapRange {
    /// The node of a mode that is known where this is compiled, smooth vectors without limits: see [`factor`].
    #[inline(always)]
    fn evaluate_as<R: Real, const VECTOR: bool, const CLAMP: bool>(
        interpolation: Interpolation,
        inputs: &[Column<'_, R>],
        outputs: &mut [&mut [R]],
    ) {
        let remapped = |value: R, from: [R; 2], to: [R; 2], steps: R| {
            let result = if VECTOR {
                to[0] + component_factor(interpolation, value, from, steps) * (to[1] - to[0])
            } else {
                let result = to[0] + factor(interpolation, value, from, steps) * (to[1] - to[0]);
                // An empty source range of a float gives 0.
                if from[0] == from[1] { R::of(0.0) } else { result }
            };
            if CLAMP && !(VECTOR && interpolation.is_smooth()) { clamp_to(result, to[0], to[1]) } else { result }
        };
        let width = if VECTOR { 3 } else { 1 };
        for (axis, output) in outputs.iter_mut().enumerate() {
            // A slice of its own: the loop need not ask where it stands after every value.
            let output = &mut **output;
            let count = output.len();
            let column = |socket: usize| inputs.get(socket * width + axis).map(|column| &column.values[..count]);
            let [value, from_min, from_max, to_min, to_max] =
                [0, 1, 2, 3, 4].map(|socket| column(socket).expect("five inputs in every mode"));
            // Only the stepped modes have the sixth input.
            let steps = column(5).unwrap_or(value);
            for index in 0..count {
                let (from, to) = ([from_min[index], from_max[index]], [to_min[index], to_max[index]]);
                output[index] = remapped(value[index], from, to, steps[index]);
            }
        }
    }

    fn evaluate_mode<R: Real, const VECTOR: bool, const CLAMP: bool>(
        &self,
        inputs: &[Column<'_, R>],
        outputs: &mut [&mut [R]],
    ) {
        match self.interpolation {
            Interpolation::Linear => Self::evaluate_as::<R, VECTOR, CLAMP>(Interpolation::Linear, inputs, outputs),
            Interpolation::Stepped => Self::evaluate_as::<R, VECTOR, CLAMP>(Interpolation::Stepped, inputs, outputs),
            Interpolation::Smooth => Self::evaluate_as::<R, VECTOR, CLAMP>(Interpolation::Smooth, inputs, outputs),
            Interpolation::Smoother => Self::evaluate_as::<R, VECTOR, CLAMP>(Interpolation::Smoother, inputs, outputs),
        }
    }
}

/// Encloses [`clamp_to`].
fn enclose_clamp_to(value: Interval, a: Interval, b: Interval) -> Interval {
    if a.low > b.high && !a.may_be_nan && !b.may_be_nan {
        value.clamped(b, a)
    } else if a.high <= b.low {
        value.clamped(a, b)
    } else {
        value.clamped(a, b).hull(value.clamped(b, a))
    }
}

/// Encloses [`stepped`].
fn enclose_stepped(t: Interval, steps: Interval) -> Interval {
    if steps.high <= 0.0 {
        return Interval::ZERO;
    }
    let positive = Interval { low: steps.low.max(0.0), ..steps };
    let factor = (t * (steps + Interval::ONE)).floor().divide(positive);
    if steps.low <= 0.0 || steps.may_be_nan { factor.hull(Interval::ZERO) } else { factor }
}

impl MapRange {
    /// Linear in the value, so tight where the ranges are points: the value occurs once.
    fn enclose_component(&self, value: Interval, from: [Interval; 2], to: [Interval; 2], steps: Interval) -> Interval {
        let width = from[1] - from[0];
        let empty = from[0].as_point().is_some() && from[0].as_point() == from[1].as_point();
        let may_be_empty = empty || (from[0].low <= from[1].high && from[1].low <= from[0].high);
        let linear = match (self.vector, empty && from[0].is_finite()) {
            // (The difference of equal infinities is NaN, not 0.)
            (_, true) => Interval::ZERO.or_nan(value.may_be_nan),
            (true, false) => (value - from[0]).safe_divide(width),
            (false, false) => (value - from[0]).divide(width),
        };
        // Both polynomials rise from 0 to 1. Their terms reach 15, which bounds the rounding.
        let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
        let smoother = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
        let unit = Interval::new(-2e-5, 1.0 + 2e-5);
        let rising = |function: &dyn Fn(f64) -> f64| {
            if !linear.is_finite() || !width.is_finite() {
                // A NaN takes either end, by the direction of the range, or passes through; a width
                // that overflows makes its own quotient 0, mirrored or not.
                return unit.or_nan(linear.may_be_nan || !width.is_finite());
            }
            linear.saturate().increasing(function, 1e-5).meet(unit)
        };
        let factor = match self.interpolation {
            Interpolation::Linear => linear,
            Interpolation::Stepped => enclose_stepped(linear, steps),
            Interpolation::Smooth => rising(&smooth),
            _ => rising(&smoother),
        };
        let mut result = to[0] + factor * (to[1] - to[0]);
        if !self.vector && empty {
            result = Interval::ZERO;
        } else if !self.vector && may_be_empty {
            result = result.hull(Interval::ZERO);
        }
        let clamps = self.clamp && (!self.vector || !self.interpolation.is_smooth());
        if clamps { enclose_clamp_to(result, to[0], to[1]) } else { result }
    }
}

impl Evaluate for MapRange {
    fn folds_late(&self) -> bool {
        false
    }

    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        match (self.vector, self.clamp) {
            (false, false) => self.evaluate_mode::<R, false, false>(inputs, outputs),
            (false, true) => self.evaluate_mode::<R, false, true>(inputs, outputs),
            (true, false) => self.evaluate_mode::<R, true, false>(inputs, outputs),
            (true, true) => self.evaluate_mode::<R, true, true>(inputs, outputs),
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let width = if self.vector { 3 } else { 1 };
        for (axis, output) in outputs.iter_mut().enumerate() {
            let at = |socket: usize| inputs[socket * width + axis];
            let steps = inputs.get(5 * width + axis).copied().unwrap_or(Interval::ONE);
            let (from, to) = ([at(1), at(2)], [at(3), at(4)]);
            *output = self.enclose_component(at(0), from, to, steps);
        }
    }

    fn fold_constants(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        // Blender's own rules for an empty source range and for negative step counts.
        if self.vector {
            if self.interpolation != Interpolation::Stepped || inputs[15..18].iter().all(|&steps| steps >= 0.0) {
                return None;
            }
            return Some(
                (0..3)
                    .map(|axis| {
                        let at = |socket: usize| inputs[3 * socket + axis];
                        let t = (at(0) - at(1)).safe_divide(at(2) - at(1));
                        let result = at(3) + folded_step(t, at(5)) * (at(4) - at(3));
                        if self.clamp { clamp_to(result, at(3), at(4)) } else { result }
                    })
                    .collect(),
            );
        }
        let [value, from_min, from_max, to_min, to_max] = inputs[..5] else { return None };
        let result = if from_min == from_max {
            to_min
        } else if self.interpolation == Interpolation::Stepped && inputs[5] < 0.0 {
            to_min + folded_step((value - from_min) / (from_max - from_min), inputs[5]) * (to_max - to_min)
        } else if self.interpolation.is_smooth() {
            // Blender divides by a negative width where Cycles mirrors.
            let t = ((value - from_min) / (from_max - from_min)).saturate();
            let factor =
                if self.interpolation == Interpolation::Smooth { (3.0 - 2.0 * t) * (t * t) } else { t.quintic() };
            to_min + factor * (to_max - to_min)
        } else {
            return None;
        };
        Some(vec![if self.clamp { clamp_to(result, to_min, to_max) } else { result }])
    }
}

/// Blender's own stepped factor, which takes negative counts as they are.
fn folded_step(t: f32, steps: f32) -> f32 {
    (t * (steps + 1.0)).floor().safe_divide(steps)
}
