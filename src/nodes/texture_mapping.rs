//! The mapping that texture nodes of old files carry themselves (`texture_mapping`), inserted by the compiler between the
//! coordinate and the texture.
//!
//! An affine image of the coordinate after a choice of its axes, for normals scaled to length 1. The matrix is made here in
//! f64 and rounded once; Cycles makes it in f32, which differs by up to 1.8e-7 for entries like 1 (measured). Limits of the
//! coordinate (`min`, `max`) do nothing in Cycles. A mapping that changes nothing is left out, that of normals too. Where
//! Blender folds the texture it ignores the mapping (measured).

use crate::base::error::{Error, Result};
use crate::nodes::real::{Real, safe_unit};
use crate::nodes::rotation;
use crate::nodes::{Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Property, Role, always};
use crate::scene::SocketType;
use serde::Deserialize;
use serde_json::Value as Json;

/// The property of texture nodes that holds the mapping.
pub const PROPERTY: &str = "texture_mapping";

/// The node type. It has no counterpart in Blender's interface.
pub static TYPE: NodeType = NodeType {
    type_name: "cloudparity.TextureMapping",
    label: "(texture mapping)",
    module: "texture_mapping",
    shader: include_str!("../../shaders/nodes/texture_mapping.wgsl"),
    properties: &[Property::flag("unit", false)],
    inputs: &[
        InputSocket::vector("Vector", "Vector", &[0.0; 3], always),
        InputSocket::vector("X", "X", &[1.0, 0.0, 0.0], always),
        InputSocket::vector("Y", "Y", &[0.0, 1.0, 0.0], always),
        InputSocket::vector("Z", "Z", &[0.0, 0.0, 1.0], always),
        InputSocket::vector("Translation", "Translation", &[0.0; 3], always),
    ],
    outputs: &[OutputSocket::new("Vector", SocketType::Vector, always)],
    role: Role::Evaluated(|mode| Box::new(Mapped { unit: mode.flag("unit") })),
};

/// A mapping, ready for the node's inputs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TextureMapping {
    /// Images of the coordinate's axes, then the translation.
    pub columns: [[f32; 3]; 4],
    /// The result is scaled to length 1.
    pub unit: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
enum Kind {
    #[default]
    Point,
    Texture,
    Vector,
    Normal,
}

#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
enum Axis {
    #[serde(rename = "NONE")]
    None,
    X,
    Y,
    Z,
}

/// What the file holds.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Stored {
    vector_type: Kind,
    translation: [f32; 3],
    rotation: [f32; 3],
    scale: [f32; 3],
    mapping_x: Axis,
    mapping_y: Axis,
    mapping_z: Axis,
}

impl Default for Stored {
    fn default() -> Self {
        Self {
            vector_type: Kind::Point,
            translation: [0.0; 3],
            rotation: [0.0; 3],
            scale: [1.0; 3],
            mapping_x: Axis::X,
            mapping_y: Axis::Y,
            mapping_z: Axis::Z,
        }
    }
}

/// Smallest magnitude of a scale that is divided by.
const SMALLEST_SCALE: f32 = 1e-5;

impl TextureMapping {
    /// The mapping that the file holds at `place`; none where it changes nothing.
    pub fn read(value: &Json, place: &str) -> Result<Option<Self>> {
        let stored: Stored = serde_json::from_value(value.clone()).map_err(|cause| {
            Error::new(
                place.to_owned(),
                format!("{value} ({cause})"),
                "{\"vector_type\", \"translation\", \"rotation\", \"scale\", \"mapping_x\", \"mapping_y\", \"mapping_z\"} \
                 as Blender's texture mapping has them",
                "Export the scene again.",
            )
        })?;
        let changes_nothing = stored == Stored { vector_type: stored.vector_type, ..Stored::default() };
        Ok((!changes_nothing).then(|| Self::of(&stored)))
    }

    fn of(stored: &Stored) -> Self {
        let inverts = matches!(stored.vector_type, Kind::Texture | Kind::Normal);
        let scale = stored.scale.map(|scale| {
            let limited = if inverts && scale.abs() < SMALLEST_SCALE {
                if scale < 0.0 { -SMALLEST_SCALE } else { SMALLEST_SCALE }
            } else {
                scale
            };
            f64::from(limited)
        });
        let turn = rotation::euler(stored.rotation.map(|angle| rotation::sine_and_cosine(f64::from(angle))));
        let translation = stored.translation.map(f64::from);
        // Of the scaled and turned coordinate; the inverse of a rotation is its transpose.
        let (linear, moved): (rotation::Rows<f64>, [f64; 3]) = match stored.vector_type {
            Kind::Point | Kind::Vector => {
                let linear = turn.map(|row| std::array::from_fn(|axis| row[axis] * scale[axis]));
                (linear, if stored.vector_type == Kind::Point { translation } else { [0.0; 3] })
            }
            Kind::Texture => {
                let back = rotation::transposed(&turn);
                let linear: rotation::Rows<f64> = std::array::from_fn(|axis| back[axis].map(|x| x / scale[axis]));
                (linear, rotation::apply_from_left(&linear, translation).map(|x| -x))
            }
            Kind::Normal => (turn.map(|row| std::array::from_fn(|axis| row[axis] / scale[axis])), [0.0; 3]),
        };
        // Which axis of the coordinate each axis of the mapping reads.
        let axes = [stored.mapping_x, stored.mapping_y, stored.mapping_z];
        let column = |axis: Axis| -> [f32; 3] {
            std::array::from_fn(|row| {
                let parts = axes.iter().zip(linear[row]).filter(|(read, _)| **read == axis);
                parts.map(|(_, entry)| entry).sum::<f64>() as f32
            })
        };
        Self {
            columns: [column(Axis::X), column(Axis::Y), column(Axis::Z), moved.map(|x| x as f32)],
            unit: stored.vector_type == Kind::Normal,
        }
    }
}

struct Mapped {
    unit: bool,
}

impl Evaluate for Mapped {
    fn folds_late(&self) -> bool {
        false
    }

    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        for index in 0..outputs[0].len() {
            let at = |column: usize| inputs[column].values[index];
            let image: [R; 3] = std::array::from_fn(|axis| {
                ((at(12 + axis) + at(2) * at(9 + axis)) + at(1) * at(6 + axis)) + at(0) * at(3 + axis)
            });
            let result = if self.unit { safe_unit(image) } else { image };
            for axis in 0..3 {
                outputs[axis][index] = result[axis];
            }
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let term = |column: usize, axis: usize| inputs[column] * inputs[3 * (column + 1) + axis];
        let image = std::array::from_fn(|axis| ((inputs[12 + axis] + term(2, axis)) + term(1, axis)) + term(0, axis));
        let result = if self.unit { super::vector_math::bounds::safe_unit(image) } else { image };
        outputs.copy_from_slice(&result);
    }

    fn folds_early(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// The image of a coordinate, in f64.
    fn image(value: Json, coordinate: [f64; 3]) -> [f64; 3] {
        let mapping = TextureMapping::read(&value, "test").expect("a mapping").expect("it changes something");
        let inputs: Vec<f64> =
            coordinate.into_iter().chain(mapping.columns.into_iter().flatten().map(f64::from)).collect();
        let columns: Vec<Column<'_, f64>> =
            inputs.iter().map(|value| Column { values: std::slice::from_ref(value), uniform: true }).collect();
        let mut result = [0.0; 3];
        let mut outputs: Vec<&mut [f64]> = result.iter_mut().map(std::slice::from_mut).collect();
        Mapped { unit: mapping.unit }.evaluate(&columns, &mut outputs);
        result
    }

    fn close(found: [f64; 3], wanted: [f64; 3]) -> bool {
        found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-6)
    }

    #[test]
    fn a_texture_undoes_a_point() {
        let with = |kind: &str| {
            json!({
                "vector_type": kind, "translation": [0.2, -1.0, 3.0], "rotation": [0.4, -1.1, 2.3],
                "scale": [2.0, 0.5, -3.0], "mapping_x": "X", "mapping_y": "Y", "mapping_z": "Z",
            })
        };
        let there = image(with("POINT"), [0.3, 0.7, -0.4]);
        assert!(close(image(with("TEXTURE"), there), [0.3, 0.7, -0.4]), "{there:?}");
        let normal = image(with("NORMAL"), [0.3, 0.7, -0.4]);
        assert!((normal.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn axes_are_chosen_before_the_scale() {
        let value = json!({"scale": [2.0, 3.0, 4.0], "mapping_x": "Z", "mapping_y": "Z", "mapping_z": "NONE"});
        assert_eq!(image(value, [1.0, 10.0, 100.0]), [200.0, 300.0, 0.0]);
    }

    #[test]
    fn small_scales_keep_their_sign_and_zero_is_positive() {
        let texture = |scale: f64| image(json!({"vector_type": "TEXTURE", "scale": [scale, 1.0, 1.0]}), [1.0; 3])[0];
        for (scale, wanted) in [(0.0, 1e5), (-0.0, 1e5), (1e-6, 1e5), (-1e-6, -1e5)] {
            assert!((texture(scale) - wanted).abs() < 1.0, "{scale}: {}", texture(scale));
        }
        assert_eq!(image(json!({"scale": [0.0, 1.0, 1.0]}), [1.0; 3])[0], 0.0);
    }

    #[test]
    fn the_identity_is_left_out_and_nonsense_refused() {
        for kind in ["POINT", "TEXTURE", "VECTOR", "NORMAL"] {
            assert_eq!(TextureMapping::read(&json!({"vector_type": kind, "scale": [1, 1, 1]}), "test"), Ok(None));
        }
        for wrong in [json!({"vector_type": "NONE"}), json!({"offset": [0, 0, 0]}), json!({"scale": 2.0}), json!(3)] {
            let error = TextureMapping::read(&wrong, "here").expect_err("no mapping");
            assert_eq!(error.place, "here");
        }
    }
}
