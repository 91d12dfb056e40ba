//! Regular lattices of vertices over the occupied part of a medium.

use crate::media::region::Region;
use glam::{DMat4, DVec3};

/// Vertices per call of the density program: enough for every core, small beside the memory.
pub(crate) const BAKE_CHUNK: usize = 1 << 18;

/// Vertices per axis of a grid over the occupied part of a medium in an object with so many cells along its longest world side,
/// and the object units between them.
pub(crate) fn vertices_of(occupied: &Region, to_object: &DMat4, cells: u32) -> ([usize; 3], DVec3) {
    let to_world = to_object.inverse();
    let extent = occupied.high - occupied.low;
    let stretch = DVec3::new(to_world.x_axis.length(), to_world.y_axis.length(), to_world.z_axis.length());
    let world_extent = extent * stretch;
    let cell = world_extent.max_element() / f64::from(cells.max(1));
    let size: [usize; 3] = std::array::from_fn(|axis| ((world_extent[axis] / cell).ceil() as usize).max(1) + 1);
    (size, extent / DVec3::from(size.map(|count| (count - 1) as f64)))
}

/// Position of a vertex.
pub(crate) fn vertex(index: usize, size: [usize; 3], low: DVec3, step: DVec3) -> DVec3 {
    let place = [index % size[0], index / size[0] % size[1], index / size[0] / size[1]];
    low + step * DVec3::from(place.map(|number| number as f64))
}
