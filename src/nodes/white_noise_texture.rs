//! White Noise Texture (`ShaderNodeTexWhiteNoise`): a value in [0, 1] and a colour from the hash of the coordinates'
//! bits.
//!
//! Value is Jenkins' lookup3 of the 1 to 4 coordinates; the colour's first channel repeats it, the others hash the
//! coordinates with a further number behind them, and in 4D the coordinates in other orders. Every bit of an input
//! counts, the sign of a zero too: a coordinate that was computed has to be equal bit for bit. (That of a constant may get lost
//! before: see `graph/zero_signs.rs`.) Unlike the other textures it has no mapping, and an unlinked Vector is the stored one.
//! Blender leaves the node alone where its coordinates are stored in its sockets. It folds those that come from constant nodes,
//! with the same result.

use crate::base::arrays::Mapped;
use crate::base::arrays::each;
use crate::nodes::hash::hash_floats;
use crate::nodes::lanes;
use crate::nodes::noise_texture::dimensions;
use crate::nodes::real::Real;
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Property, Role, always, lane_level,
};
use crate::scene::SocketType;
use fearless_simd::{dispatch, prelude::*};

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeTexWhiteNoise",
    label: "White Noise Texture",
    module: "white_noise_texture",
    shader: include_str!("../../shaders/nodes/white_noise_texture.wgsl"),
    properties: &[Property::choice("noise_dimensions", &["3D", "1D", "2D", "4D"])],
    inputs: &[
        InputSocket::vector("Vector", "Vector", &[0.0; 3], |mode| mode.choice("noise_dimensions") != "1D")
            .folding_only_linked()
            .hiding_value(),
        InputSocket::float("W", "W", &[0.0], |mode| matches!(mode.choice("noise_dimensions"), "1D" | "4D")),
    ],
    outputs: &[
        OutputSocket::new("Value", SocketType::Float, always),
        OutputSocket::new("Color", SocketType::Color, always),
    ],
    role: Role::Evaluated(|mode| {
        Box::new(WhiteNoise {
            dimensions: dimensions(mode.choice("noise_dimensions")),
            value: mode.wants("Value"),
            color: mode.wants("Color"),
        })
    }),
};

/// The node in one mode. Coordinate number `i` is column `i` in every dimension.
struct WhiteNoise {
    dimensions: usize,
    value: bool,
    color: bool,
}

/// The colour at a point; coordinates beyond the dimension are ignored.
#[inline(always)]
pub(super) fn color<R: Real>(dimensions: usize, p: [R; 4]) -> [R; 3] {
    let [green, blue] = further_channels(dimensions, p);
    [first_channel(dimensions, p), green, blue]
}

/// The value, which is the colour's first channel too; coordinates beyond the dimension are ignored.
#[inline(always)]
fn first_channel<R: Real>(dimensions: usize, [x, y, z, w]: [R; 4]) -> R {
    match dimensions {
        1 => hash_floats([x]),
        2 => hash_floats([x, y]),
        3 => hash_floats([x, y, z]),
        _ => hash_floats([x, y, z, w]),
    }
}

/// The colour's second and third channel.
#[inline(always)]
fn further_channels<R: Real>(dimensions: usize, [x, y, z, w]: [R; 4]) -> [R; 2] {
    let extra = [R::of(1.0), R::of(2.0)];
    match dimensions {
        1 => extra.mapped(|number| hash_floats([x, number])),
        2 => extra.mapped(|number| hash_floats([x, y, number])),
        3 => extra.mapped(|number| hash_floats([x, y, z, number])),
        _ => [hash_floats([z, x, w, y]), hash_floats([w, z, y, x])],
    }
}

impl WhiteNoise {
    #[inline(always)]
    fn evaluate_points<R: Real>(&self, dimensions: usize, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        for index in 0..outputs[0].len() {
            let p = each(|axis| if axis < dimensions { inputs[axis].values[index] } else { R::of(0.0) });
            let value = first_channel(dimensions, p);
            if self.value {
                outputs[0][index] = value;
            }
            if self.color {
                let first = usize::from(self.value);
                let [green, blue] = further_channels(dimensions, p);
                outputs[first][index] = value;
                outputs[first + 1][index] = green;
                outputs[first + 2][index] = blue;
            }
        }
    }
}

/// [`color`], one point per lane.
#[inline(always)]
pub(super) fn color_on_lanes<S: Simd, const N: usize>(simd: S, p: [S::u32s; N]) -> [S::f32s; 3] {
    let [green, blue] = further_lanes::<S, N>(simd, p);
    [lanes::hash_value::<S>(lanes::jenkins::<S, N>(simd, p)), green, blue]
}

/// [`further_channels`], one point per lane.
#[inline(always)]
fn further_lanes<S: Simd, const N: usize>(simd: S, p: [S::u32s; N]) -> [S::f32s; 2] {
    let number = |index: usize| S::u32s::splat(simd, [1.0_f32, 2.0][index].to_bits());
    each(
        #[inline(always)]
        |index| {
            let hash = match N {
                1 => lanes::jenkins::<S, 2>(simd, [p[0], number(index)]),
                2 => lanes::jenkins::<S, 3>(simd, [p[0], p[1], number(index)]),
                3 => lanes::jenkins::<S, 4>(simd, [p[0], p[1], p[2], number(index)]),
                _ if index == 0 => lanes::jenkins::<S, 4>(simd, [p[2], p[0], p[3], p[1]]),
                _ => lanes::jenkins::<S, 4>(simd, [p[3], p[2], p[1], p[0]]),
            };
            lanes::hash_value::<S>(hash)
        },
    )
}

impl WhiteNoise {
    #[inline(always)]
    fn run_on_lanes<S: Simd, const N: usize>(&self, simd: S, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) {
        simd.vectorize(
            #[inline(always)]
            || {
                let count = outputs[0].len();
                for start in (0..count).step_by(S::f32s::LEN) {
                    let range = start..count.min(start + S::f32s::LEN);
                    let p: [S::u32s; N] =
                        each(|axis| lanes::load::<S>(simd, &inputs[axis].values[range.clone()]).bitcast());
                    let value = lanes::hash_value::<S>(lanes::jenkins::<S, N>(simd, p));
                    if self.value {
                        lanes::store::<S>(value, &mut outputs[0][range.clone()]);
                    }
                    if self.color {
                        let first = usize::from(self.value);
                        let [green, blue] = further_lanes::<S, N>(simd, p);
                        for (channel, value) in [value, green, blue].into_iter().enumerate() {
                            lanes::store::<S>(value, &mut outputs[first + channel][range.clone()]);
                        }
                    }
                }
            },
        );
    }
}

impl Evaluate for WhiteNoise {
    fn folds_late(&self) -> bool {
        false
    }

    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        match self.dimensions {
            1 => self.evaluate_points(1, inputs, outputs),
            2 => self.evaluate_points(2, inputs, outputs),
            3 => self.evaluate_points(3, inputs, outputs),
            _ => self.evaluate_points(4, inputs, outputs),
        }
    }

    fn evaluate_fast(&self, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) -> bool {
        match self.dimensions {
            1 => dispatch!(lane_level(), simd => self.run_on_lanes::<_, 1>(simd, inputs, outputs)),
            2 => dispatch!(lane_level(), simd => self.run_on_lanes::<_, 2>(simd, inputs, outputs)),
            3 => dispatch!(lane_level(), simd => self.run_on_lanes::<_, 3>(simd, inputs, outputs)),
            _ => dispatch!(lane_level(), simd => self.run_on_lanes::<_, 4>(simd, inputs, outputs)),
        }
        true
    }

    /// Anything in [0, 1], except where all coordinates are known: the common use hashes the number of a cell, which is
    /// one value over the whole cell.
    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        // Evaluators may flush subnormal coordinates, or not.
        let known = |x: &Interval| x.as_point().filter(|value| *value == 0.0 || value.is_normal());
        let Some(places) = inputs[..self.dimensions].iter().map(known).collect::<Option<Vec<f32>>>() else {
            outputs.fill(Interval::UNIT);
            return;
        };
        let mut channels: Option<[Interval; 3]> = None;
        // An interval does not know the sign of a zero, which the hash does.
        for signs in 0..1 << self.dimensions {
            let p = each(|axis| match places.get(axis) {
                Some(0.0) if signs >> axis & 1 == 1 => -0.0,
                Some(0.0) | None => 0.0,
                Some(&place) => place,
            });
            let [green, blue] = further_channels::<f32>(self.dimensions, p);
            let found = [first_channel(self.dimensions, p), green, blue].mapped(|value| {
                let value = f64::from(value);
                Interval::outward(value, value, false).meet(Interval::UNIT)
            });
            channels = Some(channels.map_or(found, |all| each(|axis| all[axis].hull(found[axis]))));
        }
        let channels = channels.unwrap_or([Interval::UNIT; 3]);
        if self.value {
            outputs[0] = channels[0];
        }
        if self.color {
            let first = usize::from(self.value);
            outputs[first..first + 3].copy_from_slice(&channels);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::lane_tests::adversarial_coordinates;

    #[test]
    fn golden_values() {
        let p = [0.3_f32, 0.7, -0.4, 0.9];
        let w = [0.9_f32, 0.0, 0.0, 0.0];
        let channels = |dimensions: usize, p: [f32; 4]| {
            let [green, blue] = further_channels(dimensions, p);
            [first_channel(dimensions, p), green, blue]
        };
        assert_eq!(channels(1, w), [0.927_299_3, 0.822_748_4, 0.274_371_24]);
        assert_eq!(channels(2, p), [0.565_657_56, 0.878_959_6, 0.479_961_34]);
        assert_eq!(channels(3, p), [0.878_745_9, 0.826_490_4, 0.987_038_55]);
        assert_eq!(channels(4, p), [0.067_933_1, 0.098_606_94, 0.443_117_53]);
    }

    #[test]
    fn lanes_equal_the_scalar_evaluation() {
        let rows = adversarial_coordinates(1000);
        let values: [Vec<f32>; 4] = std::array::from_fn(|axis| rows.iter().map(|row| row[axis]).collect());
        for dimensions in 1..=4 {
            for (value, color) in [(true, true), (true, false), (false, true)] {
                let node = WhiteNoise { dimensions, value, color };
                let inputs: Vec<Column<'_, f32>> =
                    values[..dimensions].iter().map(|values| Column { values, uniform: false }).collect();
                let evaluate = |on_lanes: bool| {
                    let mut outputs = vec![vec![0.0; rows.len()]; usize::from(value) + 3 * usize::from(color)];
                    let mut slices: Vec<&mut [f32]> = outputs.iter_mut().map(Vec::as_mut_slice).collect();
                    match on_lanes {
                        true => assert!(node.evaluate_fast(&inputs, &mut slices)),
                        false => node.evaluate(&inputs, &mut slices),
                    }
                    outputs
                };
                assert_eq!(evaluate(true), evaluate(false), "{dimensions} dimensions");
            }
        }
    }

    #[test]
    fn special_values_have_hashes_of_their_own() {
        let at = |x: f32| first_channel(3, [x, 0.5, 0.25, 0.0]);
        let specials = [f32::from_bits(0x7FC0_0000), f32::INFINITY, f32::NEG_INFINITY, 1e7];
        for (x, expected) in specials.into_iter().zip([0.577_974, 0.582_034, 0.856_059, 0.547_803]) {
            assert!((at(x) - expected).abs() < 1e-6);
        }
        assert_ne!(at(0.0), at(-0.0));
    }

    #[test]
    fn the_bounds_of_a_cell_are_the_hashes_of_both_zeros() {
        let node = WhiteNoise { dimensions: 1, value: true, color: false };
        let mut outputs = [Interval::EVERYTHING];
        node.enclose(&[Interval::new(0.1, 0.9).floor()], &mut outputs);
        for zero in [0.0_f32, -0.0] {
            assert!(outputs[0].contains(f64::from(first_channel(1, [zero, 1.0, 1.0, 1.0]))));
        }
        node.enclose(&[Interval::new(3.1, 3.9).floor()], &mut outputs);
        assert!(outputs[0].contains(f64::from(first_channel(1, [3.0_f32, 0.0, 0.0, 0.0]))));
        assert!(outputs[0].high - outputs[0].low < 1e-5);
        node.enclose(&[Interval::new(3.1, 4.9).floor()], &mut outputs);
        assert_eq!(outputs[0], Interval::UNIT);
    }
}
