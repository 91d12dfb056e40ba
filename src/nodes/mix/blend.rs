//! The 19 blend modes of two colours, for the colour mode of Mix and for the node of old files.
//!
//! Source: Blender's blend modes as Cycles orders them. [`super::formulas`] holds what they do to one component.

use crate::base::arrays::{Mapped, each};
use crate::nodes::color_space::{
    enclose_hsv_to_rgb, enclose_rgb_to_hsv, hsv_to_rgb, rgb_to_hsv, rgb_to_hsv_of_constant,
};
use crate::nodes::mix::folding;
use crate::nodes::mix::formulas::*;
use crate::nodes::{Column, Evaluate, Interval, Real, Simplified, map, vector_at};
use crate::scene::Release;
use std::ops::{Add, Mul, Sub};

/// Blender's names of the blend modes; the first is the default.
pub const BLEND_TYPES: &[&str] = &[
    "MIX",
    "DARKEN",
    "MULTIPLY",
    "BURN",
    "LIGHTEN",
    "SCREEN",
    "DODGE",
    "ADD",
    "OVERLAY",
    "SOFT_LIGHT",
    "LINEAR_LIGHT",
    "DIFFERENCE",
    "EXCLUSION",
    "SUBTRACT",
    "DIVIDE",
    "HUE",
    "SATURATION",
    "COLOR",
    "VALUE",
];

/// [`linear`] on each component.
#[inline(always)]
fn linear_each<R: Real>(a: [R; 3], b: [R; 3], t: R) -> [R; 3] {
    each(|axis| linear(a[axis], b[axis], t))
}

/// The hue of b; grey has none.
fn hue<R: Real>(a: [R; 3], b: [R; 3], t: R, to_hsv: fn([R; 3]) -> [R; 3]) -> [R; 3] {
    let [hue, saturation, _] = to_hsv(b);
    if saturation == R::of(0.0) {
        return a;
    }
    let [_, saturation, value] = to_hsv(a);
    linear_each(a, hsv_to_rgb([hue, saturation, value]), t)
}

/// The saturation of b; grey stays grey.
fn saturation<R: Real>(a: [R; 3], b: [R; 3], t: R, to_hsv: fn([R; 3]) -> [R; 3]) -> [R; 3] {
    let [hue, saturation, value] = to_hsv(a);
    if saturation == R::of(0.0) {
        return a;
    }
    hsv_to_rgb([hue, weighted(saturation, to_hsv(b)[1], t), value])
}

/// The hue and the saturation of b.
fn color<R: Real>(a: [R; 3], b: [R; 3], t: R, to_hsv: fn([R; 3]) -> [R; 3]) -> [R; 3] {
    let [hue, saturation, _] = to_hsv(b);
    if saturation == R::of(0.0) {
        return a;
    }
    linear_each(a, hsv_to_rgb([hue, saturation, to_hsv(a)[2]]), t)
}

/// The value of b.
fn value<R: Real>(a: [R; 3], b: [R; 3], t: R, to_hsv: fn([R; 3]) -> [R; 3]) -> [R; 3] {
    let [hue, saturation, value] = to_hsv(a);
    hsv_to_rgb([hue, saturation, weighted(value, to_hsv(b)[2], t)])
}

// ---------------------------------------------------------------------------------------------------------------------
// Enclosures

/// Rounding of the formulas relative to the sum of their terms' magnitudes. A term passes at most eight operations,
/// each with an error of 1 ulp (a division alone 2.5), and an ulp is at most 2^-23 of the value.
const ROUNDING: f64 = 10.0 / 8_388_608.0;

/// What a product or a sum that is flushed to zero loses, in units of [`ROUNDING`].
const FLUSHED: f64 = f32::MIN_POSITIVE as f64 / ROUNDING;

/// A formula's exact value at one point, and the sum of its terms' magnitudes, to which rounding is relative.
#[derive(Clone, Copy)]
pub struct Corner {
    value: f64,
    size: f64,
}

impl Corner {
    fn at(value: f64) -> Self {
        Self { value, size: value.abs() }
    }
}

impl Add for Corner {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { value: self.value + other.value, size: self.size + other.size + FLUSHED }
    }
}

impl Sub for Corner {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { value: self.value - other.value, size: self.size + other.size + FLUSHED }
    }
}

impl Mul for Corner {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self { value: self.value * other.value, size: self.size * other.size + FLUSHED }
    }
}

impl Arithmetic for Corner {
    fn constant(value: f32) -> Self {
        Self::at(f64::from(value))
    }
    fn over(self, divisor: Self) -> Self {
        let size = self.size * divisor.size / (divisor.value * divisor.value);
        Self { value: self.value / divisor.value, size: size + FLUSHED }
    }
    fn smaller(self, other: Self) -> Self {
        Self { value: self.value.min(other.value), size: self.size.max(other.size) }
    }
    fn larger(self, other: Self) -> Self {
        Self { value: self.value.max(other.value), size: self.size.max(other.size) }
    }
    fn absolute(self) -> Self {
        Self { value: self.value.abs(), ..self }
    }
}

/// Encloses a formula that is monotone in each operand alone, but for turns where a = b and at `turns` of a: it is
/// extreme at corners of the box, on its diagonal's ends, or there. `plain` and `corner` are the same formula.
pub fn enclose(
    plain: impl Fn(Interval, Interval, Interval) -> Interval,
    corner: impl Fn(Corner, Corner, Corner) -> Corner,
    [a, b, t]: [Interval; 3],
    turns: &[f64],
) -> Interval {
    // Holds for NaN, infinities and overflow, but takes operands that occur twice for independent.
    let rough = plain(a, b, t);
    if !rough.is_finite() || ![a, b, t].iter().all(|operand| operand.is_finite()) {
        return rough;
    }
    let ([a_low, a_high], [b_low, b_high]) = (a.ends(), b.ends());
    let (mut low, mut high, mut size) = (f64::INFINITY, f64::NEG_INFINITY, 0.0_f64);
    let mut visit = |a: f64, b: f64| {
        for t in t.ends() {
            let found = corner(Corner::at(a), Corner::at(b), Corner::at(t));
            low = low.min(found.value);
            high = high.max(found.value);
            size = size.max(found.size);
        }
    };
    let inside = turns.iter().copied().filter(|turn| a_low < *turn && *turn < a_high);
    for a in [a_low, a_high].into_iter().chain(inside) {
        visit(a, b_low);
        visit(a, b_high);
    }
    let (first, last) = (a_low.max(b_low), a_high.min(b_high));
    if first <= last {
        visit(first, first);
        visit(last, last);
    }
    rough.meet(Interval::with_error(low, high, ROUNDING * size, false))
}

/// [`enclose`] of a formula by its name.
macro_rules! enclose_formula {
    ($formula:ident, $operands:expr) => {
        enclose($formula::<Interval>, $formula::<Corner>, $operands, &[])
    };
}

fn enclose_overlay(a: Interval, b: Interval, t: Interval) -> Interval {
    let dark = Interval { high: a.high.min(0.5), ..a };
    let light = Interval { low: a.low.max(0.5), ..a };
    if a.high < 0.5 {
        enclose_formula!(overlay_dark, [a, b, t])
    } else if a.low >= 0.5 {
        enclose_formula!(overlay_light, [a, b, t])
    } else {
        enclose_formula!(overlay_dark, [dark, b, t]).hull(enclose_formula!(overlay_light, [light, b, t]))
    }
}

fn enclose_soft_light(a: Interval, b: Interval, t: Interval) -> Interval {
    // At each corner of (b, t) a parabola t (1 - 2b) a^2 + (1 - t + 2 t b) a, which turns at its vertex.
    let mut turns = [f64::NAN; 4];
    for (index, turn) in turns.iter_mut().enumerate() {
        let (b, t) = (b.ends()[index & 1], t.ends()[index >> 1]);
        *turn = -(1.0 - t + 2.0 * t * b) / (2.0 * t * (1.0 - 2.0 * b));
    }
    enclose(soft_light::<Interval>, soft_light::<Corner>, [a, b, t], &turns)
}

/// [`quotient`] on each side of 0 of a divisor that has both signs or ends there. For one a and t it is monotone in b on a side: from its value at the end of
/// b it goes to an infinity of the sign of t a / b. Rounding is largest at that end, beside what the quotient grows by towards 0.
fn beside_zero(a: Interval, b: Interval, t: Interval) -> [Option<Interval>; 2] {
    let weight = t * a;
    let side = |end: f32, rises: bool, falls: bool| {
        let at_end = enclose_formula!(quotient, [a, Interval::point(end), t]);
        let [low, high] = at_end.ends();
        let (low, high) = (if falls { f64::NEG_INFINITY } else { low }, if rises { f64::INFINITY } else { high });
        Interval::outward(low, high, at_end.may_be_nan)
    };
    let (positive, negative) = (weight.high > 0.0, weight.low < 0.0);
    [(b.high > 0.0).then(|| side(b.high, positive, negative)), (b.low < 0.0).then(|| side(b.low, negative, positive))]
}

fn enclose_divide(a: Interval, b: Interval, t: Interval) -> Interval {
    // (Of a divisor that an implementation flushes to zero there is no quotient either.)
    let b = b.flushed();
    if b.as_point() == Some(0.0) {
        a
    } else if b.has_zero() {
        let rough = ((Interval::ONE - t) * a + (t * a).safe_divide(b)).hull(a);
        if [a, b, t].iter().all(|operand| operand.is_finite()) {
            rough.meet(beside_zero(a, b, t).into_iter().flatten().fold(a, Interval::hull))
        } else {
            rough
        }
    } else {
        enclose_formula!(quotient, [a, b, t])
    }
}

/// Quotients by the positive part of the divisor; none where it has no such part.
fn over_positive(dividend: Interval, divisor: Interval) -> Option<Interval> {
    if divisor.low > 0.0 {
        return Some(dividend.divide(divisor));
    }
    let ([low, high], [_, largest]) = (dividend.ends(), divisor.ends());
    let nan = dividend.may_be_nan || divisor.may_be_nan || !(dividend.is_finite() || divisor.is_finite());
    (largest > 0.0).then(|| {
        // As the divisor nears 0, quotients grow without bound.
        let low = if low < 0.0 { f64::NEG_INFINITY } else { low / largest };
        let high = if high > 0.0 { f64::INFINITY } else { high / largest };
        Interval::outward(low, high, nan)
    })
}

fn enclose_dodge(a: Interval, b: Interval, t: Interval) -> Interval {
    if a.as_point() == Some(0.0) {
        return Interval::ZERO;
    }
    let divisor = enclose_formula!(dodge_divisor, [Interval::ZERO, b, t]);
    let divided = over_positive(a, divisor).map(|quotient| Interval::ONE.lesser(quotient));
    let beyond = (divisor.low <= 0.0).then_some(Interval::ONE);
    let black = a.flushed().has_zero().then_some(Interval::ZERO);
    let parts = [divided, beyond, black].into_iter().flatten().reduce(Interval::hull);
    parts.unwrap_or(Interval::EVERYTHING).or_nan(a.may_be_nan || divisor.may_be_nan)
}

fn enclose_burn(a: Interval, b: Interval, t: Interval) -> Interval {
    let divisor = enclose_formula!(burn_divisor, [Interval::ZERO, b, t]);
    let divided = over_positive(Interval::ONE - a, divisor)
        .map(|quotient| Interval::ONE.lesser(Interval::ZERO.greater(Interval::ONE - quotient)));
    let beyond = (divisor.low <= 0.0).then_some(Interval::ZERO);
    let parts = [divided, beyond].into_iter().flatten().reduce(Interval::hull);
    parts.unwrap_or(Interval::EVERYTHING).or_nan(a.may_be_nan || divisor.may_be_nan)
}

/// Hue, saturation and value. Where no component is negative, neither is the saturation, nor is it above 1.
fn enclose_hsv(color: [Interval; 3]) -> [Interval; 3] {
    let [hue, saturation, value] = enclose_rgb_to_hsv(color);
    if color.iter().all(|component| component.low >= 0.0 && component.is_finite()) {
        return [hue, saturation.meet(Interval::new(0.0, 1.0 + ROUNDING as f32)), value];
    }
    [hue, saturation, value]
}

/// `changed`, and `a` as it is where the saturation that decides may be 0.
fn unless_grey(saturation: Interval, a: [Interval; 3], changed: impl FnOnce() -> [Interval; 3]) -> [Interval; 3] {
    if saturation.as_point() == Some(0.0) {
        return a;
    }
    let changed = changed();
    if saturation.flushed().has_zero() { each(|axis| changed[axis].hull(a[axis])) } else { changed }
}

fn enclose_linear_each(a: [Interval; 3], b: [Interval; 3], t: Interval) -> [Interval; 3] {
    each(|axis| enclose_formula!(linear, [a[axis], b[axis], t]))
}

fn enclose_hue(a: [Interval; 3], b: [Interval; 3], t: Interval) -> [Interval; 3] {
    let [hue, saturation, _] = enclose_hsv(b);
    unless_grey(saturation, a, || {
        let [_, saturation, value] = enclose_hsv(a);
        // Another hue leaves the smallest and the largest component.
        let span = a[0].hull(a[1]).hull(a[2]);
        let ([low, high], error) = (span.ends(), 4.0 * ROUNDING * span.magnitude());
        let turned = enclose_hsv_to_rgb([hue, saturation, value]).mapped(|component| {
            let within = Interval::with_error(low, high, error, span.may_be_nan);
            if component.is_finite() { component.meet(within) } else { component }
        });
        enclose_linear_each(a, turned, t)
    })
}

fn enclose_saturation(a: [Interval; 3], b: [Interval; 3], t: Interval) -> [Interval; 3] {
    let [hue, saturation, value] = enclose_hsv(a);
    unless_grey(saturation, a, || {
        let mixed = enclose_formula!(weighted, [saturation, enclose_hsv(b)[1], t]);
        enclose_hsv_to_rgb([hue, mixed, value])
    })
}

fn enclose_color(a: [Interval; 3], b: [Interval; 3], t: Interval) -> [Interval; 3] {
    let [hue, saturation, _] = enclose_hsv(b);
    unless_grey(saturation, a, || enclose_linear_each(a, enclose_hsv_to_rgb([hue, saturation, enclose_hsv(a)[2]]), t))
}

fn enclose_value(a: [Interval; 3], b: [Interval; 3], t: Interval) -> [Interval; 3] {
    let [hue, saturation, value] = enclose_hsv(a);
    let mixed = enclose_formula!(weighted, [value, enclose_hsv(b)[2], t]);
    enclose_hsv_to_rgb([hue, saturation, mixed])
}

// ---------------------------------------------------------------------------------------------------------------------
// Evaluation

/// Applies a function of a component of both colours and of the factor.
#[inline(always)]
fn each_component<R: Real>(inputs: &[Column<'_, R>], outputs: &mut [&mut [R]], function: impl Fn(R, R, R) -> R) {
    for (axis, output) in outputs.iter_mut().enumerate() {
        map(inputs, [1 + axis, 4 + axis, 0], output, |[a, b, t]| function(a, b, t));
    }
}

/// A blend of two colours. Inputs: the factor, three components of a, three of b.
#[derive(Debug)]
pub struct Blend {
    /// One of [`BLEND_TYPES`].
    pub kind: &'static str,
    /// The factor is limited to [0, 1].
    pub clamp_factor: bool,
    /// The components of the result are.
    pub clamp_result: bool,
    /// Whose values it has: Mix, Multiply, Add and Subtract have another order of operations since Blender 5.3.
    pub release: Release,
}

impl Blend {
    #[inline(always)]
    fn factor<R: Real>(&self, inputs: &[Column<'_, R>], index: usize) -> R {
        let factor = inputs[0].values[index];
        if self.clamp_factor { factor.saturate() } else { factor }
    }

    #[inline(always)]
    fn finished<R: Real>(&self, value: R) -> R {
        if self.clamp_result { value.saturate() } else { value }
    }

    /// Applies a formula of components. Limits are known where the loops are compiled, which then hold no decisions.
    fn each<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]], formula: impl Fn(R, R, R) -> R) {
        match (self.clamp_factor, self.clamp_result) {
            (false, false) => each_component(inputs, outputs, formula),
            (true, false) => each_component(inputs, outputs, |a, b, t| formula(a, b, t.saturate())),
            (false, true) => each_component(inputs, outputs, |a, b, t| formula(a, b, t).saturate()),
            (true, true) => each_component(inputs, outputs, |a, b, t| formula(a, b, t.saturate()).saturate()),
        }
    }

    /// Applies a formula of colours.
    fn whole<R: Real>(
        &self,
        inputs: &[Column<'_, R>],
        outputs: &mut [&mut [R]],
        formula: impl Fn([R; 3], [R; 3], R) -> [R; 3],
    ) {
        for index in 0..outputs[0].len() {
            let (a, b) = (vector_at(inputs, 1, index), vector_at(inputs, 4, index));
            let result = formula(a, b, self.factor(inputs, index));
            for (output, value) in outputs.iter_mut().zip(result) {
                output[index] = self.finished(value);
            }
        }
    }

    fn enclose_component(&self, a: Interval, b: Interval, t: Interval) -> Interval {
        let operands = [a, b, t];
        let since_5_3 = self.release >= Release::V5_3;
        match self.kind {
            "MIX" if since_5_3 => enclose_formula!(weighted, operands),
            "MULTIPLY" if since_5_3 => enclose_formula!(multiply_since_5_3, operands),
            "ADD" if since_5_3 => enclose_formula!(add_since_5_3, operands),
            "SUBTRACT" if since_5_3 => enclose_formula!(subtract_since_5_3, operands),
            "MIX" => enclose_formula!(linear, operands),
            "DARKEN" => enclose_formula!(darken, operands),
            "MULTIPLY" => enclose_formula!(multiply, operands),
            "BURN" => enclose_burn(a, b, t),
            "LIGHTEN" => enclose_formula!(lighten, operands),
            "SCREEN" => enclose_formula!(screen, operands),
            "DODGE" => enclose_dodge(a, b, t),
            "ADD" => enclose_formula!(add, operands),
            "OVERLAY" => enclose_overlay(a, b, t),
            "SOFT_LIGHT" => enclose_soft_light(a, b, t),
            "LINEAR_LIGHT" => enclose_formula!(linear_light, operands),
            "DIFFERENCE" => enclose_formula!(difference, operands),
            "EXCLUSION" => enclose_formula!(excluded, operands).greater(Interval::ZERO),
            "SUBTRACT" => enclose_formula!(subtract, operands),
            "DIVIDE" => enclose_divide(a, b, t),
            other => unreachable!("{other} is not a blend of components"),
        }
    }
}

impl Evaluate for Blend {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        let since_5_3 = self.release >= Release::V5_3;
        match self.kind {
            "MIX" if since_5_3 => self.each(inputs, outputs, weighted),
            "MULTIPLY" if since_5_3 => self.each(inputs, outputs, multiply_since_5_3),
            "ADD" if since_5_3 => self.each(inputs, outputs, add_since_5_3),
            "SUBTRACT" if since_5_3 => self.each(inputs, outputs, subtract_since_5_3),
            "MIX" => self.each(inputs, outputs, linear),
            "DARKEN" => self.each(inputs, outputs, darken),
            "MULTIPLY" => self.each(inputs, outputs, multiply),
            "BURN" => self.each(inputs, outputs, burn),
            "LIGHTEN" => self.each(inputs, outputs, lighten),
            "SCREEN" => self.each(inputs, outputs, screen),
            "DODGE" => self.each(inputs, outputs, dodge),
            "ADD" => self.each(inputs, outputs, add),
            "OVERLAY" => self.each(inputs, outputs, overlay),
            "SOFT_LIGHT" => self.each(inputs, outputs, soft_light),
            "LINEAR_LIGHT" => self.each(inputs, outputs, linear_light),
            "DIFFERENCE" => self.each(inputs, outputs, difference),
            "EXCLUSION" => self.each(inputs, outputs, exclusion),
            "SUBTRACT" => self.each(inputs, outputs, subtract),
            "DIVIDE" => self.each(inputs, outputs, divide),
            "HUE" => self.whole(inputs, outputs, |a, b, t| hue(a, b, t, rgb_to_hsv)),
            "SATURATION" => self.whole(inputs, outputs, |a, b, t| saturation(a, b, t, rgb_to_hsv)),
            "COLOR" => self.whole(inputs, outputs, |a, b, t| color(a, b, t, rgb_to_hsv)),
            "VALUE" => self.whole(inputs, outputs, |a, b, t| value(a, b, t, rgb_to_hsv)),
            other => unreachable!("{other} is not in BLEND_TYPES"),
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let factor = if self.clamp_factor { inputs[0].saturate() } else { inputs[0] };
        let [a, b] = [1, 4].mapped(|first| [inputs[first], inputs[first + 1], inputs[first + 2]]);
        let result = match self.kind {
            "HUE" => enclose_hue(a, b, factor),
            "SATURATION" => enclose_saturation(a, b, factor),
            "COLOR" => enclose_color(a, b, factor),
            "VALUE" => enclose_value(a, b, factor),
            _ => each(|axis| self.enclose_component(a[axis], b[axis], factor)),
        };
        for (output, value) in outputs.iter_mut().zip(result) {
            *output = if self.clamp_result { value.saturate() } else { value };
        }
    }

    fn fold_constants(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        let [factor, a_red, a_green, a_blue, b_red, b_green, b_blue] = *inputs else {
            return None;
        };
        let factor = folding::limited(factor, self.clamp_factor);
        let result = folding::blended(self.kind, [a_red, a_green, a_blue], [b_red, b_green, b_blue], factor);
        Some(result.map(|value| folding::limited(value, self.clamp_result)).to_vec())
    }

    fn fold_constants_late(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        let blend = match self.kind {
            "HUE" => hue,
            "SATURATION" => saturation,
            "COLOR" => color,
            "VALUE" => value,
            _ => return None,
        };
        let [factor, a_red, a_green, a_blue, b_red, b_green, b_blue] = *inputs else { return None };
        let factor = if self.clamp_factor { factor.saturate() } else { factor };
        let result = blend([a_red, a_green, a_blue], [b_red, b_green, b_blue], factor, rgb_to_hsv_of_constant);
        Some(result.map(|value| self.finished(value)).to_vec())
    }

    fn simplify_constants(&self, inputs: &[Option<f32>]) -> Option<Simplified> {
        let factor = inputs[0].map(|factor| if self.clamp_factor { factor.saturate() } else { factor });
        let whole =
            |first: usize| -> Option<[f32; 3]> { Some([inputs[first]?, inputs[first + 1]?, inputs[first + 2]?]) };
        let (a, b) = (whole(1), whole(4));
        let kept = match simplify(self.kind, factor, a, b)? {
            Kept::First => (vec![1, 2, 3], a),
            Kept::Second => (vec![4, 5, 6], b),
            Kept::Black => return Some(Simplified::Constant(vec![0.0; 3])),
        };
        match kept {
            (_, Some(color)) => Some(Simplified::Constant(color.map(|value| self.finished(value)).to_vec())),
            (indices, None) => (!self.clamp_result).then_some(Simplified::Inputs(indices)),
        }
    }

    fn simplify_linked(&self, inputs: &[Option<f32>], equal: &dyn Fn(usize, usize) -> bool) -> Option<Simplified> {
        if !same_output(&[[1, 4], [2, 5], [3, 6]], inputs, equal) {
            return None;
        }
        let factor = inputs[0].map(|factor| if self.clamp_factor { factor.saturate() } else { factor });
        match self.kind {
            // A result that is limited keeps the formula.
            "MIX" if !self.clamp_result => Some(Simplified::Inputs(vec![1, 2, 3])),
            // Zeros whether limited or not.
            "SUBTRACT" if factor == Some(1.0) => Some(Simplified::Constant(vec![0.0; 3])),
            _ => None,
        }
    }
}

/// Whether the pairs of input components are those of one output that is linked twice. Some of its components may be
/// constants (Combine XYZ), but not all.
pub(super) fn same_output(
    pairs: &[[usize; 2]],
    constants: &[Option<f32>],
    equal: &dyn Fn(usize, usize) -> bool,
) -> bool {
    let bits = |component: usize| constants[component].map(f32::to_bits);
    let agree = |a: usize, b: usize| equal(a, b) || (bits(a).is_some() && bits(a) == bits(b));
    pairs.iter().all(|&[a, b]| agree(a, b)) && pairs.iter().any(|&[a, b]| equal(a, b))
}

/// What remains of a blend with constant operands.
enum Kept {
    /// The colour below.
    First,
    /// The colour on top.
    Second,
    /// Zeros.
    Black,
}

/// Cycles' rules for neutral and absorbing constants (measured, for each blend mode). Beside NaN and infinities they
/// show where the formula rounds (Screen by 0 is 1 - (1 - a)) or limits (Exclusion by 0 would cut off negative values).
/// An input that is not limited passes; a result that is limited keeps the formula.
fn simplify(kind: &str, factor: Option<f32>, a: Option<[f32; 3]>, b: Option<[f32; 3]>) -> Option<Kept> {
    let is = |color: Option<[f32; 3]>, value: f32| color == Some([value; 3]);
    let full = factor == Some(1.0);
    if factor == Some(0.0) && !matches!(kind, "LIGHTEN" | "DODGE" | "BURN") {
        return Some(Kept::First);
    }
    match kind {
        "MIX" if a.is_some() && a == b => Some(Kept::First),
        "MIX" if full => Some(Kept::Second),
        "ADD" | "SUBTRACT" if is(b, 0.0) => Some(Kept::First),
        "MULTIPLY" if full && is(a, 1.0) => Some(Kept::Second),
        "MULTIPLY" | "DIVIDE" if is(b, 1.0) => Some(Kept::First),
        "MULTIPLY" | "DIVIDE" if is(a, 0.0) => Some(Kept::Black),
        "MULTIPLY" if full && is(b, 0.0) => Some(Kept::Black),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blend(kind: &'static str) -> Blend {
        Blend { kind, clamp_factor: false, clamp_result: false, release: Release::V5_0 }
    }

    fn values<R: Real>(blend: &Blend, inputs: [f32; 7]) -> [R; 3] {
        let inputs = inputs.map(R::of);
        let columns = inputs.each_ref().map(|value| Column { values: std::slice::from_ref(value), uniform: true });
        let mut result = [R::default(); 3];
        blend.evaluate(&columns, &mut result.each_mut().map(std::slice::from_mut));
        result
    }

    #[test]
    fn cycles_values() {
        // Measured; exact but for the last digits of decimals. a = (0.3, 0.7, -0.4), b = (0.6, -0.2, 1.7).
        let golden: [(&str, [f32; 3]); 15] = [
            ("MIX", [0.6, -0.2, 1.7]),
            ("DARKEN", [0.3, -0.199_999_99, -0.4]),
            ("MULTIPLY", [0.18, -0.139_999_99, -0.68]),
            ("BURN", [0.0, 0.0, 0.176_470_64]),
            ("LIGHTEN", [0.6, 0.7, 1.700_000_2]),
            ("SCREEN", [0.72, 0.64, 1.98]),
            ("DODGE", [0.750_000_06, 0.583_333_3, 1.0]),
            ("ADD", [0.900_000_04, 0.5, 1.300_000_1]),
            ("OVERLAY", [0.36, 0.279_999_97, -1.36]),
            ("SOFT_LIGHT", [0.342_000_04, 0.406, -1.744_000_1]),
            ("LINEAR_LIGHT", [0.500_000_06, -0.7, 2.0]),
            ("DIFFERENCE", [0.3, 0.9, 2.100_000_1]),
            ("EXCLUSION", [0.54, 0.78, 2.66]),
            ("SUBTRACT", [-0.3, 0.9, -2.100_000_1]),
            ("DIVIDE", [0.5, -3.5, -0.235_294_12]),
        ];
        for (kind, expected) in golden {
            let found: [f32; 3] = values(&blend(kind), [1.0, 0.3, 0.7, -0.4, 0.6, -0.2, 1.7]);
            for axis in 0..3 {
                assert!(
                    (found[axis] - expected[axis]).abs() <= 1.2e-7 * expected[axis].abs().max(1.0),
                    "{kind} {found:?}"
                );
            }
        }
        // Grey has no hue to give, and black no saturation.
        let grey = [0.5, 0.1, 0.2, 0.3, 0.4, 0.4, 0.4];
        assert_eq!(values::<f32>(&blend("HUE"), grey), [0.1, 0.2, 0.3]);
        assert_eq!(values::<f32>(&blend("COLOR"), grey), [0.1, 0.2, 0.3]);
        assert_eq!(values::<f32>(&blend("SATURATION"), [0.5, 0.0, 0.0, 0.0, 0.4, 0.1, 0.4]), [0.0; 3]);
    }

    #[test]
    fn special_values() {
        let at = |kind, inputs| values::<f32>(&blend(kind), inputs);
        // The first colour stands where nothing can be divided; dodging leaves 0 and the sign of negative values.
        assert_eq!(at("DIVIDE", [1.0, 0.3, 2.0, -1.0, 0.0, -0.0, 2.0]), [0.3, 2.0, -0.5]);
        assert_eq!(at("DODGE", [1.0, 0.0, 0.3, -1.0, 5.0, 5.0, 0.5]), [0.0, 1.0, -2.0]);
        assert_eq!(at("BURN", [1.0, 0.3, 2.0, -9.0, 0.0, 0.5, 0.5]), [0.0, 1.0, 0.0]);
        // A NaN passes, but not the limit of Exclusion nor that of the result.
        assert!(at("BURN", [1.0, f32::NAN, 0.0, 0.0, 0.5, 0.5, 0.5])[0].is_nan());
        assert!(at("DODGE", [1.0, 0.5, 0.0, 0.0, f32::NAN, 0.5, 0.5])[0].is_nan());
        assert_eq!(at("EXCLUSION", [1.0, f32::NAN, 0.0, 0.0, 0.5, 0.5, 0.5])[0], 0.0);
        let limited = Blend { kind: "MIX", clamp_factor: true, clamp_result: true, release: Release::V5_0 };
        assert_eq!(values::<f32>(&limited, [7.0, 0.0, 0.0, 0.0, 3.0, -3.0, f32::NAN]), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn neutral_factors_pass_an_input() {
        let inputs = [Some(0.0), None, None, None, None, None, None];
        assert_eq!(blend("SCREEN").simplify_constants(&inputs), Some(Simplified::Inputs(vec![1, 2, 3])));
        assert_eq!(blend("BURN").simplify_constants(&inputs), None);
        let limited = Blend { kind: "MIX", clamp_factor: true, clamp_result: true, release: Release::V5_0 };
        assert_eq!(limited.simplify_constants(&inputs), None);
        let constant = [Some(5.0), None, None, None, Some(0.25), Some(2.0), Some(-1.0)];
        assert_eq!(limited.simplify_constants(&constant), Some(Simplified::Constant(vec![0.25, 1.0, 0.0])));
        assert_eq!(blend("MIX").simplify_constants(&constant), None);
    }

    #[test]
    fn constants_fold_in_the_order_of_blender() {
        let at = |kind, inputs: [f32; 7]| blend(kind).fold_constants(&inputs).expect("every mode has a rule");
        let (t, a, b) = (0.3_f32, 0.1_f32, 0.7_f32);
        let inputs = [t, a, 0.25, 0.75, b, 0.5, 1.0];
        for (kind, expected) in [
            ("MIX", (1.0 - t) * a + t * b),
            ("DARKEN", a * t + a * (1.0 - t)),
            ("LIGHTEN", b * t + a * (1.0 - t)),
            ("MULTIPLY", a * ((1.0 - t) + t * b)),
            ("ADD", a + t * b),
            ("SUBTRACT", a - t * b),
            ("DIFFERENCE", (1.0 - t) * a + t * (a - b).abs()),
            ("EXCLUSION", (1.0 - t) * a + t * ((a + b) - (2.0 * a) * b)),
        ] {
            assert_eq!(at(kind, inputs)[0], expected, "{kind}");
        }
        // Measured; the kernels give a hue of (0.357_143_04, 0.459_999_98, 0.34).
        let inputs = [0.4, 0.3, 0.7, 0.1, 0.6, 0.2, 0.9];
        assert_eq!(at("HUE", inputs), [0.357_142_8, 0.460_000_04, 0.34]);
        assert_eq!(at("SATURATION", inputs), [0.314_814_78, 0.7, 0.122_222_25]);
        assert_eq!(at("COLOR", inputs), [0.366_666_62, 0.482_222_23, 0.34]);
        assert_eq!(at("VALUE", inputs), [0.334_285_68, 0.78, 0.111_428_6]);
        // Every mode stays near the kernels' value, and seven modes are equal to it.
        let mut different = Vec::new();
        for &kind in BLEND_TYPES {
            let mut equal = true;
            for step in 0..200_u16 {
                let inputs: [f32; 7] =
                    each(|index| f32::from((step * 7 + index as u16 + 1).wrapping_mul(40_503)) / 65_537.0);
                let (folded, evaluated) = (at(kind, inputs), values::<f32>(&blend(kind), inputs));
                equal &= folded == evaluated;
                let near = folded.iter().zip(evaluated).all(|(folded, evaluated)| (folded - evaluated).abs() < 2e-5);
                assert!(near, "{kind} {inputs:?}: {folded:?}, {evaluated:?}");
            }
            if !equal {
                different.push(kind);
            }
        }
        assert_eq!(
            different,
            [
                "MIX",
                "DARKEN",
                "MULTIPLY",
                "LIGHTEN",
                "ADD",
                "DIFFERENCE",
                "EXCLUSION",
                "SUBTRACT",
                "HUE",
                "SATURATION",
                "COLOR",
                "VALUE"
            ]
        );
    }

    #[test]
    fn limits_of_constants_keep_missing_numbers() {
        let limited = Blend { kind: "ADD", clamp_factor: true, clamp_result: true, release: Release::V5_0 };
        assert_eq!(limited.fold_constants(&[7.0, 0.5, 0.0, 0.0, 3.0, -3.0, 0.25]), Some(vec![1.0, 0.0, 0.25]));
        let folded = limited.fold_constants(&[0.5, f32::NAN, 0.0, 0.5, 0.0, 0.0, 0.0]).expect("a rule");
        assert!(folded[0].is_nan() && folded[1..] == [0.0, 0.5]);
        assert!(limited.fold_constants(&[f32::NAN; 7]).expect("a rule").iter().all(|value| value.is_nan()));
    }

    #[test]
    fn one_output_linked_twice_simplifies() {
        let linked = |a: usize, b: usize| a + 3 == b;
        let unknown = [None; 7];
        let at = |blend: &Blend, constants: &[Option<f32>]| blend.simplify_linked(constants, &linked);
        assert_eq!(at(&blend("MIX"), &unknown), Some(Simplified::Inputs(vec![1, 2, 3])));
        assert_eq!(at(&Blend { clamp_result: true, ..blend("MIX") }, &unknown), None);
        assert_eq!(at(&blend("DIFFERENCE"), &unknown), None);
        // Only the whole difference vanishes.
        assert_eq!(at(&blend("SUBTRACT"), &unknown), None);
        let mut constants = unknown;
        constants[0] = Some(2.0);
        assert_eq!(at(&blend("SUBTRACT"), &constants), None);
        for clamp_result in [false, true] {
            let limited = Blend { kind: "SUBTRACT", clamp_factor: true, clamp_result, release: Release::V5_0 };
            assert_eq!(at(&limited, &constants), Some(Simplified::Constant(vec![0.0; 3])));
        }
        // Equal constants count beside a link, but not alone.
        let but_green = |a: usize, b: usize| a != 2 && a + 3 == b;
        assert_eq!(blend("MIX").simplify_linked(&unknown, &but_green), None);
        let green = |b: f32| [None, None, Some(0.5), None, None, Some(b), None];
        assert!(blend("MIX").simplify_linked(&green(0.5), &but_green).is_some());
        assert_eq!(blend("MIX").simplify_linked(&green(0.25), &but_green), None);
        assert_eq!(blend("MIX").simplify_linked(&[Some(f32::NAN); 7], &|_, _| false), None);
    }

    #[test]
    fn a_quotient_beside_a_divisor_of_zero_keeps_its_finite_end() {
        let mut enclosed = [Interval::EVERYTHING; 3];
        let [half, unit, two] = [[0.5, 1.0], [0.0, 1.0], [0.0, 2.0]].map(|[low, high]| Interval::new(low, high));
        blend("DIVIDE").enclose(&[unit, half, half, half, two, two, two], &mut enclosed);
        // a ((1 - t) + t / b) is least at b = 2: a half of a half.
        assert!(enclosed[0].low > 0.249_99 && enclosed[0].low <= 0.25, "{enclosed:?}");
        let limited = Blend { kind: "DIVIDE", clamp_factor: true, clamp_result: true, release: Release::default() };
        limited.enclose(&[unit, half, half, half, two, two, two], &mut enclosed);
        assert!(enclosed[0].low > 0.249_99 && enclosed[0].high == 1.0, "{enclosed:?}");
    }

    /// Boxes of all modes: random ones, and such with ends where formulas branch.
    #[test]
    fn enclosures_of_every_mode_hold_over_many_boxes() {
        const BOXES: usize = 100_000;
        const ENDS: [f32; 12] =
            [0.0, 1.0, 0.5, -1.0, 2.0, -0.0, 1e-30, 0.999_999_94, 1.000_000_1, 1e-39, 0.499_999_97, -1e-7];
        let mut state = 7_u32;
        let mut next = move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 16_777_216.0
        };
        for &kind in BLEND_TYPES {
            let (mut ratios, mut unbounded) = (Vec::new(), 0);
            for round in 0..BOXES {
                let (clamp_factor, clamp_result) = (round % 2 == 0, round % 5 == 0);
                let blend = Blend { kind, clamp_factor, clamp_result, release: Release::default() };
                let boxes: [Interval; 7] = each(|_| {
                    let mut end = || match round % 3 {
                        0 => next(),
                        1 => next() * 4.0 - 2.0,
                        _ => ENDS[(next() * 12.0) as usize],
                    };
                    let (first, second) = (end(), end());
                    let near = first + 0.1 * (second - first);
                    let other = if round % 4 == 0 { near } else { second };
                    Interval::new(first.min(other), first.max(other))
                });
                let mut enclosed = [Interval::EVERYTHING; 3];
                blend.enclose(&boxes, &mut enclosed);
                let mut range = [f64::INFINITY, f64::NEG_INFINITY];
                for _ in 0..6 {
                    let inputs = boxes.map(|range| match next() {
                        x if x < 0.35 => range.low,
                        x if x < 0.7 => range.high,
                        _ => (range.low + next() * (range.high - range.low)).clamp(range.low, range.high),
                    });
                    let (single, double) = (values::<f32>(&blend, inputs), values::<f64>(&blend, inputs));
                    for axis in 0..3 {
                        for value in [f64::from(single[axis]), double[axis]] {
                            assert!(enclosed[axis].contains(value), "{blend:?} {inputs:?} {value} {enclosed:?}");
                        }
                    }
                    range = [range[0].min(double[0]), range[1].max(double[0])];
                }
                let width = f64::from(enclosed[0].high) - f64::from(enclosed[0].low);
                if !width.is_finite() {
                    unbounded += 1;
                } else if range[1] - range[0] > 1e-3 {
                    ratios.push(width / (range[1] - range[0]));
                }
            }
            ratios.sort_by(f64::total_cmp);
            let [median, most] = [0.5, 0.9].map(|share| ratios[(ratios.len() as f64 * share) as usize]);
            log::info!(
                "{kind}: bound over sampled range {median:.2} (90 % below {most:.2}), unbounded {unbounded} of {BOXES}"
            );
        }
    }

    #[test]
    fn enclosures_hold_and_are_tight() {
        // A fixed sequence of boxes; points on their corners and inside.
        let mut state = 1_u32;
        let mut next = move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 16_777_216.0
        };
        for &kind in BLEND_TYPES {
            let blend = blend(kind);
            for round in 0..300 {
                let scale = if round % 2 == 0 { 1.0 } else { 4.0 };
                let shift = if round % 2 == 0 { 0.0 } else { -2.0 };
                let boxes: [Interval; 7] = each(|_| {
                    let (x, width) = (next() * scale + shift, if round % 3 == 0 { 0.0 } else { next() });
                    Interval::new(x, x + width)
                });
                let mut enclosed = [Interval::EVERYTHING; 3];
                blend.enclose(&boxes, &mut enclosed);
                for _ in 0..30 {
                    let inputs = boxes.map(|range| match next() {
                        x if x < 0.25 => range.low,
                        x if x < 0.5 => range.high,
                        _ => (range.low + next() * (range.high - range.low)).clamp(range.low, range.high),
                    });
                    let (single, double) = (values::<f32>(&blend, inputs), values::<f64>(&blend, inputs));
                    for axis in 0..3 {
                        assert!(enclosed[axis].contains(f64::from(single[axis])), "{kind} {inputs:?} {enclosed:?}");
                        assert!(enclosed[axis].contains(double[axis]), "{kind} {inputs:?} {enclosed:?}");
                    }
                }
            }
        }
        // With operands that occur twice taken for independent, the middle would reach from 0.25 to 1.75.
        let unit = Interval::new(0.5, 1.0);
        let mut enclosed = [Interval::EVERYTHING; 3];
        for kind in ["MIX", "DARKEN", "LIGHTEN"] {
            blend(kind).enclose(&[unit; 7], &mut enclosed);
            assert!(enclosed[0].low > 0.499_99 && enclosed[0].high < 1.000_01, "{kind} {enclosed:?}");
        }
    }
}
