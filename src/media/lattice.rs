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

/// The eight vertices around a place, or around the nearest place of a grid of so many per axis, at least 2 each, with the share of each. The place is in
/// numbers of vertices.
pub fn vertices_around(place: DVec3, size: [usize; 3]) -> [(usize, f32); 8] {
    let mut corner = [0; 3];
    let mut part = [0.0_f32; 3];
    for axis in 0..3 {
        let at = place[axis].clamp(0.0, (size[axis] - 1) as f64);
        corner[axis] = (at as usize).min(size[axis] - 2);
        part[axis] = (at - corner[axis] as f64) as f32;
    }
    let first = (corner[2] * size[1] + corner[1]) * size[0] + corner[0];
    std::array::from_fn(|number| {
        let which = [number & 1, number >> 1 & 1, number >> 2];
        let share = (0..3).map(|axis| if which[axis] == 1 { part[axis] } else { 1.0 - part[axis] }).product();
        (first + which[0] + (which[1] + which[2] * size[1]) * size[0], share)
    })
}
