//! Checker Texture (`ShaderNodeTexChecker`): two colours by the parity of the lattice cell.
//!
//! The cell is that of `displaced` coordinates. Factor is 1 and Color the first colour where the sum of the cell's
//! numbers is odd; the cell at the origin is even.

use crate::base::arrays::Mapped;
use crate::nodes::real::Real;
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Property, Role, always, lane_level,
};
use crate::scene::SocketType;
use fearless_simd::{dispatch, prelude::*};

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeTexChecker",
    label: "Checker Texture",
    module: "checker_texture",
    shader: include_str!("../../shaders/nodes/checker_texture.wgsl"),
    properties: &[Property::other("texture_mapping")],
    inputs: &[
        InputSocket::coordinate(always),
        InputSocket::color("Color1", "Color1", &[0.8; 3]),
        InputSocket::color("Color2", "Color2", &[0.2; 3]),
        InputSocket::float("Scale", "Scale", &[5.0], always),
    ],
    outputs: &[
        OutputSocket::new("Color", SocketType::Color, always),
        OutputSocket::new("Fac", SocketType::Float, always),
    ],
    role: Role::Evaluated(|mode| Box::new(Checker { color: mode.wants("Color"), factor: mode.wants("Fac") })),
};

/// First columns of the inputs after the coordinate.
const COLORS: [usize; 2] = [3, 6];
const SCALE: usize = 9;

/// What the kernel adds to scaled coordinates and multiplies them by: small whole numbers then lie beside the faces of
/// the cells and not on them.
const DISPLACEMENT: [f32; 2] = [0.000_001, 0.999_999];

/// Scaled coordinates, moved a little as the kernel does for Checker and Wave.
#[inline(always)]
pub(super) fn displaced<R: Real>(p: [R; 3], scale: R) -> [R; 3] {
    p.mapped(|x| {
        let moved = ((x * scale).round_coordinate() + R::of(DISPLACEMENT[0])).round_coordinate();
        (moved * R::of(DISPLACEMENT[1])).round_coordinate()
    })
}

/// Bounds of [`displaced`].
pub(super) fn enclose_displaced(p: [Interval; 3], scale: Interval) -> [Interval; 3] {
    p.mapped(|x| (x * scale + Interval::point(DISPLACEMENT[0])) * Interval::point(DISPLACEMENT[1]))
}

/// Whether the sum of a cell's numbers is odd. Cells that no i32 holds have the even number -2^31.
#[inline(always)]
fn is_odd<R: Real>(floors: [R; 3]) -> bool {
    let [x, y, z] = floors.mapped(Real::to_int);
    (x ^ y ^ z) & 1 == 1
}

/// The node with its wanted outputs.
struct Checker {
    color: bool,
    factor: bool,
}

/// Points whose cells are looked at before their colours.
const ABREAST: usize = 64;

impl Checker {
    #[inline(always)]
    fn evaluate_points<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        let count = outputs[0].len();
        let columns: [&[R]; 4] = [0, 1, 2, SCALE].mapped(|column| &inputs[column].values[..count]);
        let colors = COLORS.mapped(|first| [0, 1, 2].mapped(|axis| &inputs[first + axis].values[..count]));
        for start in (0..count).step_by(ABREAST) {
            let range = start..count.min(start + ABREAST);
            let mut odd = [false; ABREAST];
            for (odd, index) in odd.iter_mut().zip(range.clone()) {
                let [x, y, z, scale] = columns.mapped(|column| column[index]);
                *odd = is_odd(displaced([x, y, z], scale).mapped(Real::floor));
            }
            if self.color {
                for axis in 0..3 {
                    let [first, second] = [colors[0][axis], colors[1][axis]].mapped(|column| &column[range.clone()]);
                    let results = outputs[axis][range.clone()].iter_mut();
                    for (((result, &odd), &first), &second) in results.zip(&odd).zip(first).zip(second) {
                        *result = if odd { first } else { second };
                    }
                }
            }
            if self.factor {
                for (result, &odd) in outputs[if self.color { 3 } else { 0 }][range].iter_mut().zip(&odd) {
                    *result = R::of(if odd { 1.0 } else { 0.0 });
                }
            }
        }
    }
}

impl Evaluate for Checker {
    fn folds_late(&self) -> bool {
        false
    }

    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        self.evaluate_points(inputs, outputs);
    }

    /// The same, compiled for this machine's instructions, of which one rounds down.
    fn evaluate_fast(&self, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) -> bool {
        dispatch!(lane_level(), simd => simd.vectorize(
            #[inline(always)]
            || self.evaluate_points(inputs, outputs),
        ));
        true
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let place = enclose_displaced([inputs[0], inputs[1], inputs[2]], inputs[SCALE]);
        let floors = place.mapped(|x| if x.is_finite() { x.floor().as_point() } else { None });
        let odd = match floors {
            [Some(x), Some(y), Some(z)] => Some(is_odd([x, y, z])),
            _ => None,
        };
        let choose = |first: Interval, second: Interval| match odd {
            Some(true) => first,
            Some(false) => second,
            None => first.hull(second),
        };
        if self.color {
            for axis in 0..3 {
                outputs[axis] = choose(inputs[COLORS[0] + axis], inputs[COLORS[1] + axis]);
            }
        }
        if self.factor {
            outputs[if self.color { 3 } else { 0 }] = choose(Interval::ONE, Interval::ZERO);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn factor(p: [f32; 3], scale: f32) -> f32 {
        f32::from(is_odd(displaced(p, scale).map(Real::floor)))
    }

    #[test]
    fn golden_values() {
        assert_eq!(factor([0.3, 0.7, -0.4], 5.0), 0.0);
        assert_eq!(factor([-2.6, 5.15, 1.05], 5.0), 1.0);
        // Positive whole numbers are in the lower cell; zero and what lies a little below it, in the upper one.
        assert_eq!(factor([1.0, 0.0, 0.0], 1.0), 0.0);
        assert_eq!(factor([1.000_01, 0.0, 0.0], 1.0), 1.0);
        assert_eq!(factor([0.0, 0.0, 0.0], 1.0), 0.0);
        assert_eq!(factor([-5e-7, 0.0, 0.0], 1.0), 0.0);
        assert_eq!(factor([-5e-6, 0.0, 0.0], 1.0), 1.0);
    }

    #[test]
    fn cells_without_a_number_are_even() {
        for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 3e9, -1e30] {
            assert_eq!(factor([x, 0.5, 0.25], 5.0), 1.0);
            assert_eq!(factor([x, 0.5, 0.45], 5.0), 0.0);
        }
    }

    #[test]
    fn this_machines_instructions_give_the_same_cells() {
        let coordinates = crate::nodes::lane_tests::adversarial_coordinates(4096);
        let mut columns: Vec<Vec<f32>> = (0..3).map(|axis| coordinates.iter().map(|p| p[axis]).collect()).collect();
        columns.extend([0.7, 0.8, 0.9, 0.1, 0.2, 0.3, 2.5].map(|value| vec![value; coordinates.len()]));
        let inputs: Vec<_> = columns.iter().map(|values| Column { values, uniform: false }).collect();
        let node = Checker { color: true, factor: true };
        let run = |fast: bool| {
            let mut outputs = vec![vec![0.0_f32; coordinates.len()]; 4];
            let mut slices: Vec<&mut [f32]> = outputs.iter_mut().map(Vec::as_mut_slice).collect();
            if fast {
                assert!(node.evaluate_fast(&inputs, &mut slices));
            } else {
                node.evaluate(&inputs, &mut slices);
            }
            outputs
        };
        assert_eq!(run(true), run(false));
    }

    #[test]
    fn bounds_know_the_colour_within_a_cell() {
        let node = Checker { color: true, factor: true };
        let point = Interval::point;
        let color = [point(0.7), point(0.8), point(0.9), point(0.1), point(0.2), point(0.3)];
        let bounds = |x: [f32; 2]| {
            let mut inputs = vec![Interval::new(x[0], x[1]), point(0.5), point(0.5)];
            inputs.extend(color);
            inputs.push(point(1.0));
            let mut outputs = [Interval::EVERYTHING; 4];
            node.enclose(&inputs, &mut outputs);
            outputs
        };
        assert_eq!(bounds([1.1, 1.9]), [color[0], color[1], color[2], Interval::ONE]);
        assert_eq!(bounds([2.1, 2.9]), [color[3], color[4], color[5], Interval::ZERO]);
        assert_eq!(bounds([1.1, 2.9])[3], Interval::UNIT);
    }
}
