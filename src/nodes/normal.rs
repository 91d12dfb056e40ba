//! Normal (`ShaderNodeNormal`): a stored direction, and its dot product with a vector.
//!
//! Both are divided by their lengths without a guard: a vector of length 0 gives NaN. Blender never folds the node.

use crate::base::arrays::Mapped;
use crate::nodes::real::{Real, dot, length};
use crate::nodes::rotation::enclose_unit;
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Property, Role, always, vector_at,
};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeNormal",
    label: "Normal",
    module: "normal",
    shader: include_str!("../../shaders/nodes/normal.wgsl"),
    properties: &[Property::stored_output("Normal", [0.0, 0.0, 1.0])],
    inputs: &[InputSocket::vector("Normal", "Normal", &[0.0, 0.0, 1.0], always).zero_in_cycles()],
    outputs: &[
        OutputSocket::new("Normal", SocketType::Vector, always),
        OutputSocket::new("Dot", SocketType::Float, always),
    ],
    role: Role::Evaluated(|mode| {
        Box::new(Normal {
            direction: mode.stored_output("Normal"),
            normal: mode.wants("Normal"),
            dot: mode.wants("Dot"),
        })
    }),
};

struct Normal {
    /// As stored, of any length.
    direction: [f32; 3],
    normal: bool,
    dot: bool,
}

fn unit<R: Real>(v: [R; 3]) -> [R; 3] {
    let norm = length(v);
    v.mapped(|x| x / norm)
}

impl Evaluate for Normal {
    fn folds_late(&self) -> bool {
        false
    }

    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        let direction = unit(self.direction.mapped(R::of));
        if self.normal {
            for axis in 0..3 {
                outputs[axis].fill(direction[axis]);
            }
        }
        if self.dot {
            let column = if self.normal { 3 } else { 0 };
            for (index, result) in outputs[column].iter_mut().enumerate() {
                *result = dot(direction, unit(vector_at(inputs, 0, index)));
            }
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let direction = enclose_unit(self.direction.mapped(Interval::point));
        if self.normal {
            outputs[..3].copy_from_slice(&direction);
        }
        if self.dot {
            let vector = enclose_unit([inputs[0], inputs[1], inputs[2]]);
            let product = (direction[0] * vector[0] + direction[1] * vector[1]) + direction[2] * vector[2];
            // Of two unit vectors, unless one of them is none.
            let unit = direction.iter().chain(&vector).all(|x| x.is_finite());
            let within = Interval::new(-1.00002, 1.00002);
            outputs[if self.normal { 3 } else { 0 }] = if unit { product.meet(within) } else { product };
        }
    }

    fn folds_early(&self) -> bool {
        false
    }

    fn shader_constants(&self) -> String {
        // WGSL has no NaN: a direction without length is 0 there.
        let [x, y, z] = unit(self.direction).mapped(|x| if x.is_finite() { x } else { 0.0 });
        format!("const DIRECTION: vec3f = vec3f({x:?}f, {y:?}f, {z:?}f);\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::Mode;

    fn value(direction: [f32; 3], input: [f32; 3]) -> [f32; 4] {
        let node: crate::scene::Node = serde_json::from_value(serde_json::json!({
            "name": "Normal", "type": TYPE.type_name, "outputs": {"Normal": direction},
        }))
        .expect("a node");
        let mode = Mode::of_node(&TYPE, &node, "test").expect("a mode").with_wanted(vec!["Normal", "Dot"]);
        let Role::Evaluated(build) = TYPE.role else { unreachable!("it evaluates") };
        let columns = input.each_ref().map(|value| Column { values: std::slice::from_ref(value), uniform: true });
        let mut result = [0.0; 4];
        let mut outputs: Vec<&mut [f32]> = result.iter_mut().map(std::slice::from_mut).collect();
        build(&mode).evaluate_f32(&columns, &mut outputs);
        result
    }

    #[test]
    fn both_vectors_are_normalised() {
        // Cycles' SSE4.2 kernel gives 0.98270762 for these.
        assert_eq!(value([3.0, 4.0, 5.0], [1.0, 2.0, 3.0])[3], 0.982_707_6);
        assert_eq!(value([0.0, 0.0, 2.0], [0.0, 3.0, 4.0]), [0.0, 0.0, 1.0, 0.8]);
    }

    #[test]
    fn no_length_is_no_number() {
        assert!(value([0.0, 0.0, 1.0], [0.0; 3])[3].is_nan());
        assert!(value([0.0; 3], [1.0, 0.0, 0.0]).iter().all(|x| x.is_nan()));
        // The square vanishes in f32, the number does not.
        assert_eq!(value([1e-25, 0.0, 0.0], [1.0, 0.0, 0.0])[0], f32::INFINITY);
    }
}
