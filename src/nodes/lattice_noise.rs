//! Noise on a lattice as published clouds have it: a node type of ours, without a counterpart in Blender.
//!
//! * `VALUE`: a number of [0, 1] at each lattice point, cubic fade t^2 (3 - 2 t), trilinear: value noise.
//! * `SIGNED_VALUE`: the same with numbers of [-1, 1]: what a remainder that keeps its sign makes of it (defect SK-1 of `skill`).
//! * `GRADIENT_289`: gradient noise with quintic fade, whose gradients come from a permutation polynomial modulo 289:
//!   n = ((17 x + y) 17 + z) mod 289, n = (34 n + 1) n mod 289, components 2 (floor(n / 7^i) mod 7) - 1 + 0.0001, made unit vectors. They
//!   lie mostly in the positive octant (defect BO-8 of `bolt`).
//!
//! The originals' value noise takes the remainder of a large multiple of a sine, whose bits no two machines share; here the numbers are
//! the first of [`crate::nodes::hash::pcg`]'s of the cell, as Blender's Voronoi Texture has them.

use crate::base::arrays::Mapped;
use crate::base::arrays::each;
use crate::nodes::hash::pcg_values;
use crate::nodes::real::Real;
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Property, Role, always, lane_level,
};
use crate::scene::SocketType;
use fearless_simd::{dispatch, prelude::*};

/// Name of the property that says which noise.
pub const KIND: &str = "kind";

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "cloudparity.LatticeNoise",
    label: "(lattice noise)",
    module: "lattice_noise",
    shader: include_str!("../../shaders/nodes/lattice_noise.wgsl"),
    properties: &[Property::choice(KIND, &["VALUE", "SIGNED_VALUE", "GRADIENT_289"])],
    inputs: &[InputSocket::vector("Vector", "Vector", &[0.0; 3], always)],
    outputs: &[OutputSocket::new("Value", SocketType::Float, always)],
    role: Role::Evaluated(|mode| {
        Box::new(LatticeNoise(match mode.choice(KIND) {
            "VALUE" => Kind::Value,
            "SIGNED_VALUE" => Kind::SignedValue,
            _ => Kind::Gradient,
        }))
    }),
};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Value,
    SignedValue,
    Gradient,
}

struct LatticeNoise(Kind);

/// Cells beyond this distance from the origin are not told apart by f32's fractions, and their numbers would not fit a hash's words.
const FARTHEST: f64 = 1e9;

/// Lattice points that an enclosure looks at, at most; beyond it stands the whole range.
const MOST_POINTS: f64 = 125.0;

/// What rounding may add to an interpolated value, relative to the largest: seven interpolations of three roundings each.
const ROUNDING: f64 = 32.0 * f32::EPSILON as f64;

/// The number at a lattice point.
#[inline(always)]
fn value<R: Real>(kind: Kind, cell: [i32; 3]) -> R {
    let [first, _, _]: [R; 3] = pcg_values(cell);
    if kind == Kind::SignedValue { R::of(2.0) * first - R::of(1.0) } else { first }
}

/// The gradient at a lattice point, a unit vector.
fn gradient<R: Real>(cell: [i32; 3]) -> [R; 3] {
    let [x, y, z] = cell.mapped(|coordinate| coordinate.rem_euclid(289));
    let first = ((17 * x + y) * 17 + z) % 289;
    let mixed = (34 * first + 1) * first % 289;
    let parts = [1, 7, 49].mapped(|divisor| R::of((2 * (mixed / divisor % 7) - 1) as f32) + R::of(0.0001));
    let [a, b, c] = parts;
    let length = (a * a + b * b + c * c).sqrt();
    parts.mapped(|part| part / length)
}

/// The noise at a place.
#[inline(always)]
fn noise<R: Real>(kind: Kind, place: [R; 3]) -> R {
    let floors = place.mapped(Real::lattice_floor);
    let cell = floors.mapped(Real::to_int);
    let fraction: [R; 3] = each(
        #[inline(always)]
        |axis| place[axis] - floors[axis],
    );
    let weight = fraction.mapped(|f| match kind {
        Kind::Gradient => (f * f) * (f * (f * (f * R::of(6.0) - R::of(15.0)) + R::of(10.0))),
        _ => (f * f) * (R::of(3.0) - R::of(2.0) * f),
    });
    let mut corners: [R; 8] = each(
        #[inline(always)]
        |index| {
            let bit = |axis: usize| ((index >> axis) & 1) as i32;
            let corner = [0, 1, 2].mapped(|axis| cell[axis].wrapping_add(bit(axis)));
            if kind == Kind::Gradient {
                let [x, y, z] = gradient::<R>(corner);
                let offset: [R; 3] = each(|axis| fraction[axis] - R::of(bit(axis) as f32));
                x * offset[0] + y * offset[1] + z * offset[2]
            } else {
                value(kind, corner)
            }
        },
    );
    for (axis, count) in [4, 2, 1].into_iter().enumerate() {
        for index in 0..count {
            corners[index] = corners[2 * index].lerp(corners[2 * index + 1], weight[axis]);
        }
    }
    corners[0]
}

#[inline(always)]
fn for_each_point<R: Real>(kind: Kind, inputs: &[Column<'_, R>], results: &mut [R]) {
    let count = results.len();
    let [x, y, z] = [0, 1, 2].mapped(|axis| &inputs[axis].values[..count]);
    for (index, result) in results.iter_mut().enumerate() {
        *result = noise(kind, [x[index], y[index], z[index]]);
    }
}

impl LatticeNoise {
    /// Everything that the noise can be. Of unit gradients: each corner's product is at most its distance, and distances of up to
    /// root 3 have weights that keep the sum below 1 (0.87 in the middle of a cell).
    fn range(&self) -> [f64; 2] {
        match self.0 {
            Kind::Value => [0.0, 1.0],
            Kind::SignedValue | Kind::Gradient => [-1.0, 1.0],
        }
    }

    /// The smallest and largest number at the lattice points around a box, none where they are too many.
    fn corners(&self, place: &[Interval]) -> Option<[f64; 2]> {
        if self.0 == Kind::Gradient {
            return None;
        }
        // Rounding of the place may put it into the next cell.
        let spans: [[f64; 2]; 3] = each(|axis| {
            let [low, high] = place[axis].ends();
            [low.floor(), high.floor() + 1.0]
        });
        let count: f64 = spans.iter().map(|[low, high]| high - low + 1.0).product();
        let is_near = spans.as_flattened().iter().all(|end| end.abs() < FARTHEST);
        if !(is_near && count <= MOST_POINTS) {
            return None;
        }
        let [xs, ys, zs] = spans.map(|[low, high]| low as i32..=high as i32);
        let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
        for z in zs {
            for y in ys.clone() {
                for x in xs.clone() {
                    let found: f64 = value(self.0, [x, y, z]);
                    ends = [ends[0].min(found), ends[1].max(found)];
                }
            }
        }
        Some(ends)
    }
}

impl Evaluate for LatticeNoise {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        for_each_point(self.0, inputs, outputs[0]);
    }

    /// The same code, compiled for the widest vectors of this machine: a loop without branches, of which compilers make lanes themselves.
    fn evaluate_fast(&self, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) -> bool {
        match self.0 {
            Kind::Value => dispatch!(lane_level(), simd => simd.vectorize(
                #[inline(always)]
                || for_each_point(Kind::Value, inputs, outputs[0])
            )),
            Kind::SignedValue => dispatch!(lane_level(), simd => simd.vectorize(
                #[inline(always)]
                || for_each_point(Kind::SignedValue, inputs, outputs[0])
            )),
            // Its remainders have no vector instruction.
            Kind::Gradient => return false,
        }
        true
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let may_be_nan = inputs.iter().any(|coordinate| coordinate.may_be_nan || !coordinate.is_finite());
        let whole = self.range();
        let [low, high] = if may_be_nan { whole } else { self.corners(inputs).unwrap_or(whole) };
        let added = if [low, high] == whole && self.0 != Kind::Gradient { 0.0 } else { ROUNDING };
        outputs[0] = Interval::outward(low - added, high + added, may_be_nan);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::hash::pcg;

    #[test]
    fn lattice_points_have_their_numbers() {
        for cell in [[0, 0, 0], [3, -7, 12], [-100, 5, 2]] {
            let place = cell.map(|coordinate| coordinate as f32);
            assert_eq!(noise(Kind::Value, place), pcg_values::<f32, 3>(cell)[0]);
            assert_eq!(noise(Kind::SignedValue, place), 2.0 * pcg_values::<f32, 3>(cell)[0] - 1.0);
            assert_eq!(noise(Kind::Gradient, place), 0.0);
            assert_eq!(pcg(cell)[0] as f32 * 0.5_f32.powi(31), pcg_values::<f32, 3>(cell)[0]);
        }
    }

    #[test]
    fn vectors_give_the_bits_of_single_points() {
        // No multiple of any vector's width.
        let points = crate::nodes::lane_tests::adversarial_coordinates(4099);
        let columns = [0, 1, 2].map(|axis| points.iter().map(|point| point[axis]).collect::<Vec<f32>>());
        let inputs = [0, 1, 2].map(|axis| Column { values: &columns[axis], uniform: false });
        for kind in [Kind::Value, Kind::SignedValue] {
            let mut found = vec![0.0; points.len()];
            assert!(LatticeNoise(kind).evaluate_fast(&inputs, &mut [&mut found]));
            for (point, found) in points.iter().zip(found) {
                let expected: f32 = noise(kind, [point[0], point[1], point[2]]);
                // The sign of what is not a number is the instruction's choice.
                let is_same = found.to_bits() == expected.to_bits() || found.is_nan() && expected.is_nan();
                assert!(is_same, "{kind:?} {point:?}: {found} {expected}");
            }
        }
    }

    #[test]
    fn published_gradients_are_unit_vectors_with_a_bias() {
        let mut mean = [0.0; 3];
        for number in 0..4913 {
            let found: [f64; 3] = gradient([number % 17, number / 17 % 17, number / 289]);
            let length: f64 = found.iter().map(|part| part * part).sum();
            assert!((length - 1.0).abs() < 1e-12);
            (0..3).for_each(|axis| mean[axis] += found[axis] / 4913.0);
        }
        // Components are -1, 1, 3 to 11: of an unbiased set the mean would be within 4 / sqrt(3 x 4913) = 0.03.
        assert!(mean.iter().all(|&part| part > 0.3), "{mean:?}");
    }
}
