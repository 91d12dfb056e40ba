//! The value of a volume object's grid at a place, inserted by the compiler for Attribute nodes that name the grid.
//!
//! Coordinates are indices of the grid; values stand at whole ones, are interpolated trilinearly, along x, then y, then z, and are 0
//! outside, so that the outermost value fades over one more voxel. That is what Cycles 5.0 does with a Volume object of interpolation
//! LINEAR (measured; docs/volume-objects.md).

use crate::nodes::real::Real;
use crate::nodes::{Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Role, always};
use crate::scene::SocketType;
use crate::scene::volume_grid::GridHandle;

/// The node type. It has no counterpart in Blender's interface. Its mode carries the grid.
pub static TYPE: NodeType = NodeType {
    type_name: "cloudparity.VolumeGrid",
    label: "(volume grid)",
    module: "volume_grid_lookup",
    shader: "",
    properties: &[],
    inputs: &[InputSocket::vector("Index", "Index", &[0.0; 3], always)],
    outputs: &[OutputSocket::new("Value", SocketType::Float, always)],
    role: Role::Evaluated(|mode| Box::new(Lookup(mode.grid().clone()))),
};

struct Lookup(GridHandle);

/// Rounding of the six interpolations in f32, as a share of the largest value: each rounds a difference, a product and a sum.
const ROUNDING: f64 = 18.0 / (1_u64 << 24) as f64;

impl Evaluate for Lookup {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        let grid = self.0.grid();
        for (index, result) in outputs[0].iter_mut().enumerate() {
            let place: [R; 3] = std::array::from_fn(|axis| inputs[axis].values[index]);
            let floors = place.map(Real::floor);
            let cell = floors.map(|floor| i64::from(floor.to_int()));
            let fraction: [R; 3] = std::array::from_fn(|axis| place[axis] - floors[axis]);
            let value = |x: i64, y: i64, z: i64| R::of(grid.value([cell[0] + x, cell[1] + y, cell[2] + z]));
            let along_x = |y: i64, z: i64| value(0, y, z).lerp(value(1, y, z), fraction[0]);
            let along_y = |z: i64| along_x(0, z).lerp(along_x(1, z), fraction[1]);
            *result = along_y(0).lerp(along_y(1), fraction[2]);
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let may_be_nan = inputs.iter().any(|input| input.may_be_nan || !input.is_finite());
        let range = |pick: fn([f64; 2]) -> f64, step: f64| {
            std::array::from_fn(|axis| (pick(inputs[axis].ends()).floor() + step).clamp(-4.0e9, 4.0e9) as i64)
        };
        let [low, high] = self.0.grid().range(range(|ends| ends[0], 0.0), range(|ends| ends[1], 1.0));
        let error = ROUNDING * f64::from(low.abs().max(high.abs()));
        outputs[0] = Interval::outward(f64::from(low) - error, f64::from(high) + error, may_be_nan);
    }
}
