//! Triangle meshes as outlines of media, and the parts of rays that lie inside.
//!
//! What "inside" means is what Cycles 5.0.1 makes of it (measured, docs/mesh-outlines.md): a ray keeps for each object one mark, set where
//! it crosses a face from its front and taken away where it crosses one from its back, however often it was set before. Of a closed
//! mesh whose parts do not overlap that is the interior. Where parts of one mesh do overlap, leaving one of them leaves the medium.
//! A scattered ray begins with the mark of the ray before it; a camera ray with what the first face above it shows ([`PlacedMesh::begins_inside`]).
//!
//! No ray is lost at edges and vertices. Vertices are taken into a frame in which the ray is the third axis, as Woop, Benthin and Wald
//! do (2013, "Watertight Ray/Triangle Intersection", JCGT 2(1)); each vertex is rounded once, so that triangles which share it
//! agree. What the axis passes is then decided without error: the sign of an edge function is exact, and a zero is given a sign by
//! moving the axis by (e, e^2) with an infinitesimal e (Edelsbrunner and Muecke 1990, "Simulation of Simplicity", ACM TOG 9(1)). So a
//! line crosses a closed mesh as often from the front as from the back, at vertices and in faces that it grazes, too.
//!
//! Distances do round. Crossings that lie closer together than their rounding could put them in any order are one: the side of
//! the majority counts, and as many of one side as of the other are none, as at a silhouette.

use crate::base::arrays::Mapped;
use crate::base::error::{Error, Result};
use crate::gpu::Gpu;
use crate::media::region::Region;
use crate::scene::check_mesh;
use bvh::aabb::{Aabb, Bounded};
use bvh::bounding_hierarchy::BHShape;
use bvh::bvh::{Bvh, BvhNode};
use glam::{DMat4, DVec3};
use nalgebra::Point3;
use std::collections::HashMap;

/// How far a corner of a box may be from where it belongs, over the largest coordinate: 4 units in the last place of f32. Turning a cube
/// by right angles rounds the entry of 1, the corner, their product and two sums by half a unit each, and two entries that should be
/// 0 are up to 0.4 units, the cosine of f32's pi/2: 3.3 units together.
const BOX_TOLERANCE: f64 = 4.0 * f32::EPSILON as f64;

/// Error of a distance from the rounding of the edge functions, in units of `extent * reach * depth / determinant`: vertices are off
/// by 4 units of 2^-53 of their distance, an edge function by 16 units of these and 2 of its own, three of them share the depth.
const WEIGHT_ROUNDING: f64 = 32.0 * f64::EPSILON;

/// The same of depths, over the largest.
const DEPTH_ROUNDING: f64 = 4.0 * f64::EPSILON;

/// Padding of boxes over the largest coordinate: many times the rounding of a vertex in the ray's frame and of a slab test.
const BOX_PADDING: f64 = 32.0 * f64::EPSILON;

/// Rounding of where a ray begins over the sum of magnitudes that it is made of: a product and a sum for the place in the world,
/// three of each into the frame, each off by half of f64's epsilon, with a factor of 2 to spare.
const BEGIN_ROUNDING: f64 = 8.0 * f64::EPSILON;

/// Marks a node of the tree on an adapter that is a triangle.
const LEAF: u32 = 1 << 31;

/// A part of a ray: distances at which it begins and ends.
pub type Span = [f64; 2];

/// A triangle mesh that bounds a medium, in the object's frame. Its faces look out of the medium.
pub struct Mesh {
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    tree: Bvh<f64, 3>,
    bounds: Region,
}

/// A face that a ray crosses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Face {
    /// Distance in units of the ray's direction.
    pub distance: f64,
    /// Whether the ray comes from its front, and so goes into the medium.
    pub enters: bool,
}

/// A crossing with a triangle, before near ones are taken together.
#[derive(Debug, Clone, Copy)]
struct Crossing {
    distance: f64,
    /// How far the distance may be off.
    error: f64,
    enters: bool,
}

/// A box, as a tree is built of it: a triangle's here, an object's in [`super::object_index`].
pub(super) struct Leaf {
    bounds: Aabb<f64, 3>,
    node: usize,
}

impl Leaf {
    pub(super) fn new(low: DVec3, high: DVec3) -> Self {
        let point = |place: DVec3| Point3::new(place.x, place.y, place.z);
        Self { bounds: Aabb::with_bounds(point(low), point(high)), node: 0 }
    }
}

impl Bounded<f64, 3> for Leaf {
    fn aabb(&self) -> Aabb<f64, 3> {
        self.bounds
    }
}

impl BHShape<f64, 3> for Leaf {
    fn set_bh_node_index(&mut self, index: usize) {
        self.node = index;
    }

    fn bh_node_index(&self) -> usize {
        self.node
    }
}

/// The box that a mesh is, up to the rounding of its corners; none where it is no box. Faces may be divided in any way whose
/// triangles meet edge to edge, and vertices may stand there twice.
pub(crate) fn as_box(vertices: &[[f32; 3]], triangles: &[[u32; 3]]) -> Option<Region> {
    let place = |vertex: u32| DVec3::from(vertices[vertex as usize].mapped(f64::from));
    let used = || triangles.iter().flatten().map(|&vertex| place(vertex));
    let low = used().fold(DVec3::INFINITY, DVec3::min);
    let high = used().fold(DVec3::NEG_INFINITY, DVec3::max);
    let region = Region { low, high };
    let tolerance = BOX_TOLERANCE * low.abs().max(high.abs()).max_element();
    // Sides of a few units would let every vertex belong to both ends.
    if region.is_empty() || (high - low).min_element() <= 4.0 * tolerance {
        return None;
    }
    let snapped = |vertex: u32| {
        let place = place(vertex);
        DVec3::from_array(std::array::from_fn(|axis| match place[axis] {
            x if x - low[axis] <= tolerance => low[axis],
            x if high[axis] - x <= tolerance => high[axis],
            x => x,
        }))
    };
    let corners: Vec<[DVec3; 3]> = triangles.iter().map(|triangle| triangle.map(snapped)).collect();
    // A closed surface of outward triangles covers each face of the box the same number of times everywhere: that of its area.
    let mut areas = [0.0; 6];
    for [a, b, c] in &corners {
        let side = (0..6).find(|side| {
            let (axis, end) = (side / 2, if side % 2 == 0 { low } else { high });
            [a, b, c].iter().all(|corner| corner[axis] == end[axis])
        })?;
        let outward = if side % 2 == 0 { -1.0 } else { 1.0 };
        let area = (*b - *a).cross(*c - *a)[side / 2] * outward / 2.0;
        if area < 0.0 {
            return None;
        }
        areas[side] += area;
    }
    let size = high - low;
    let once = (0..6).all(|side| {
        let whole = size.element_product() / size[side / 2];
        (areas[side] / whole).round() == 1.0
    });
    (once && is_closed(corners.iter().copied())).then_some(region)
}

/// Whether every edge is run through as often in one direction as in the other. Vertices at the same place are one.
fn is_closed(corners: impl Iterator<Item = [DVec3; 3]>) -> bool {
    let key = |corner: DVec3| corner.to_array().mapped(|x| (x + 0.0).to_bits());
    let mut edges: HashMap<[[u64; 3]; 2], i64> = HashMap::new();
    for corners in corners {
        for number in 0..3 {
            let (from, to) = (key(corners[number]), key(corners[(number + 1) % 3]));
            let (edge, step) = if from <= to { ([from, to], 1) } else { ([to, from], -1) };
            if from != to {
                *edges.entry(edge).or_default() += step;
            }
        }
    }
    edges.values().all(|&sum| sum == 0)
}

impl Mesh {
    /// The mesh of a scene file. `place` is where the shape stands, for errors.
    pub fn new(place: &str, vertices: &[[f32; 3]], triangles: &[[u32; 3]]) -> Result<Self> {
        check_mesh(place, vertices, triangles)?;
        let vertices: Vec<DVec3> = vertices.iter().map(|vertex| DVec3::from(vertex.map(f64::from))).collect();
        let mut bounds = Region { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };
        let mut leaves: Vec<Leaf> = triangles
            .iter()
            .map(|triangle| {
                let corners = triangle.mapped(|vertex| vertices[vertex as usize]);
                let low = corners[0].min(corners[1]).min(corners[2]);
                let high = corners[0].max(corners[1]).max(corners[2]);
                bounds = Region { low: bounds.low.min(low), high: bounds.high.max(high) };
                Leaf::new(low, high)
            })
            .collect();
        let tree = Bvh::build(&mut leaves);
        Ok(Self { vertices, triangles: triangles.to_vec(), tree, bounds })
    }

    /// The box around its triangles.
    pub fn bounds(&self) -> Region {
        self.bounds
    }

    /// Whether no edge is left open.
    pub fn is_closed(&self) -> bool {
        is_closed(self.triangles.iter().map(|triangle| triangle.map(|vertex| self.vertices[vertex as usize])))
    }

    /// The volume that it encloses: below 0 where its faces look inward.
    pub fn volume(&self) -> f64 {
        let middle = (self.bounds.low + self.bounds.high) / 2.0;
        let sixth = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.mapped(|vertex| self.vertices[vertex as usize] - middle);
            a.cross(b).dot(c) / 6.0
        };
        self.triangles.iter().map(sixth).sum()
    }

    /// Puts it on an adapter as `shaders/media/mesh.wgsl` reads it: with its tree, in a frame of places `(place - low) / unit`. An error
    /// where the adapter binds no buffer of that size.
    pub fn upload(&self, gpu: &Gpu, low: DVec3, unit: DVec3) -> Result<wgpu::Buffer> {
        let elements = self.elements(low, unit);
        let bytes: &[u8] = bytemuck::cast_slice(&elements);
        let limit = gpu.device().limits().max_storage_buffer_binding_size;
        if bytes.len() as u64 > limit {
            return Err(Error::new(
                "the mesh of the medium on the adapter",
                format!("{} triangles, {} bytes with their tree", self.triangles.len(), bytes.len()),
                format!("at most {limit} bytes, the largest that adapter {} binds", gpu.adapter().name),
                "Take a mesh of fewer triangles (a Decimate modifier), or the CPU.",
            )
            .with_setting("backend"));
        }
        Ok(gpu.upload("mesh", bytes, wgpu::BufferUsages::STORAGE))
    }

    /// A head, the nodes of the tree, each with where to go on, and the corners of the triangles.
    fn elements(&self, low: DVec3, unit: DVec3) -> Vec<[u32; 4]> {
        let words = |place: DVec3, last: u32| {
            let [x, y, z] = ((place - low) / unit).as_vec3().to_array().mapped(f32::to_bits);
            [x, y, z, last]
        };
        let corner = |point: Point3<f64>| DVec3::new(point.x, point.y, point.z);
        // Boxes round by less than what the shader pads.
        let nodes = self.tree.flatten_custom(&|bounds: &Aabb<f64, 3>, entry: u32, exit: u32, shape: u32| match entry {
            u32::MAX => [[0, 0, 0, LEAF | shape], [0, 0, 0, exit]],
            _ => [words(corner(bounds.min), entry), words(corner(bounds.max), exit)],
        });
        let ends = [self.bounds.low, self.bounds.high].mapped(|end| ((end - low) / unit).abs().max_element());
        let largest = (ends[0].max(ends[1]) as f32).to_bits();
        let mut elements = vec![[nodes.len() as u32, 1 + 2 * nodes.len() as u32, largest, 0]];
        elements.extend(nodes.as_flattened());
        let corners = self.triangles.as_flattened().iter().map(|&vertex| words(self.vertices[vertex as usize], 0));
        elements.extend(corners);
        elements
    }

    /// Nodes of its tree on an adapter.
    pub(crate) fn nodes(&self) -> usize {
        // Every triangle is a leaf with a box of its own, and every two are joined by another.
        3 * self.triangles.len()
    }

    /// The faces that a ray crosses between two distances, in their order. Crossings whose order is lost in rounding are one, or none where
    /// they take each other away.
    pub fn faces(&self, origin: DVec3, direction: DVec3, from: f64, to: f64) -> Vec<Face> {
        let mut crossings = self.crossings(&Frame::new(origin, direction), from, to);
        crossings.sort_by(|a, b| (a.distance - a.error).total_cmp(&(b.distance - b.error)));
        let mut faces = Vec::with_capacity(crossings.len());
        let mut rest = crossings.as_slice();
        while let Some(first) = rest.first() {
            let mut end = first.distance + first.error;
            let mut count = 1;
            while let Some(next) = rest.get(count).filter(|next| next.distance - next.error <= end) {
                end = end.max(next.distance + next.error);
                count += 1;
            }
            let (group, others) = rest.split_at(count);
            rest = others;
            let balance: i64 = group.iter().map(|crossing| if crossing.enters { 1 } else { -1 }).sum();
            let enters = balance > 0;
            let sharpest = group.iter().filter(|crossing| crossing.enters == enters);
            if balance != 0
                && let Some(found) = sharpest.min_by(|a, b| a.error.total_cmp(&b.error))
            {
                faces.push(Face { distance: found.distance, enters });
            }
        }
        // The sharpest of a wide group may lie beside another group.
        faces.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        faces
    }

    /// Every triangle that a ray crosses between two distances.
    fn crossings(&self, frame: &Frame, from: f64, to: f64) -> Vec<Crossing> {
        let mut found = Vec::new();
        let padding =
            BOX_PADDING * self.bounds.low.abs().max(self.bounds.high.abs()).max(frame.origin.abs()).max_element();
        let meets = |place: &Aabb<f64, 3>| frame.meets(place, padding, from, to);
        let mut pending = Vec::with_capacity(64);
        pending.push(0);
        while let Some(node) = pending.pop() {
            match &self.tree.nodes[node] {
                BvhNode::Node { child_l_index, child_l_aabb, child_r_index, child_r_aabb, .. } => {
                    if meets(child_l_aabb) {
                        pending.push(*child_l_index);
                    }
                    if meets(child_r_aabb) {
                        pending.push(*child_r_index);
                    }
                }
                BvhNode::Leaf { shape_index, .. } => {
                    let corners = self.triangles[*shape_index].mapped(|vertex| self.vertices[vertex as usize]);
                    let crossing = frame.crossing(corners);
                    found.extend(crossing.filter(|found| found.distance + found.error >= from && found.distance <= to));
                }
            }
        }
        found
    }
}

/// A mesh in the world.
pub struct PlacedMesh {
    mesh: Mesh,
    to_object: DMat4,
    to_world: DMat4,
}

impl PlacedMesh {
    /// A mesh with the matrix from the world into its frame.
    pub fn new(mesh: Mesh, to_object: DMat4) -> Self {
        Self { mesh, to_object, to_world: to_object.inverse() }
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Distance of the last face up to `far` along a ray of the world; none without one.
    pub fn last_face(&self, origin: DVec3, direction: DVec3, far: f64) -> Option<f64> {
        let [origin, direction] = self.local(origin, direction);
        self.last_face_in_object(origin, direction, far)
    }

    /// [`Self::last_face`] of a ray of the object's frame.
    pub fn last_face_in_object(&self, origin: DVec3, direction: DVec3, far: f64) -> Option<f64> {
        self.mesh.faces(origin, direction, f64::NEG_INFINITY, far).last().map(|face| face.distance)
    }

    /// Appends the parts of a ray of the world that lie inside, between two distances. `inside` says whether it comes from inside. A medium
    /// that a mesh leaves open ends with the box around it.
    pub fn spans(&self, origin: DVec3, direction: DVec3, between: Span, inside: bool, spans: &mut Vec<Span>) {
        let [local_origin, local_direction] = self.local(origin, direction);
        self.spans_of([local_origin, local_direction], self.rounding(origin), between, inside, spans);
    }

    /// [`Self::spans`] of a ray of the object's frame.
    pub fn spans_in_object(&self, origin: DVec3, direction: DVec3, between: Span, inside: bool, spans: &mut Vec<Span>) {
        let rounded = self.rounding(self.to_world.transform_point3(origin));
        self.spans_of([origin, direction], rounded, between, inside, spans);
    }

    /// How far a place of the world may be off after its way into the object's frame.
    fn rounding(&self, place: DVec3) -> f64 {
        let DMat4 { x_axis, y_axis, z_axis, w_axis } = self.to_object;
        let sums: DVec3 = [x_axis, y_axis, z_axis]
            .into_iter()
            .zip(place.to_array())
            .map(|(axis, coordinate)| axis.truncate().abs() * coordinate.abs())
            .sum();
        BEGIN_ROUNDING * (sums + w_axis.truncate().abs()).max_element()
    }

    fn spans_of(
        &self,
        [origin, direction]: [DVec3; 2],
        rounded: f64,
        [from, to]: Span,
        inside: bool,
        spans: &mut Vec<Span>,
    ) {
        let Some((enter, leave)) = self.mesh.bounds.segment(origin, direction) else { return };
        let (from, to) = (from.max(enter), to.min(leave));
        if from >= to {
            return;
        }
        // A begin at a face may be rounded to its other side: as a place of the world, and on its way into the frame. Faces that far
        // behind it count.
        let slack = rounded / direction.abs().max_element();
        let (mut inside, mut begin) = (inside, from);
        for Face { distance, enters } in self.mesh.faces(origin, direction, from - slack, to) {
            let distance = distance.clamp(from, to);
            if inside && !enters && begin < distance {
                spans.push([begin, distance]);
            }
            if !inside && enters {
                begin = distance;
            }
            inside = enters;
        }
        if inside && begin < to {
            spans.push([begin, to]);
        }
    }

    /// Whether a camera ray that begins at a place of the world begins inside: Cycles asks whether the first face above, along +Z of the
    /// world, shows its back.
    pub fn begins_inside(&self, place: DVec3) -> bool {
        self.begins_inside_in_object(self.to_object.transform_point3(place))
    }

    /// [`Self::begins_inside`] of a place of the object's frame.
    pub fn begins_inside_in_object(&self, place: DVec3) -> bool {
        let up = self.to_object.transform_vector3(DVec3::Z);
        let Region { low, high } = self.mesh.bounds;
        if !(place.cmpge(low).all() && place.cmple(high).all()) {
            return false;
        }
        self.mesh.faces(place, up, 0.0, f64::INFINITY).first().is_some_and(|face| !face.enters)
    }

    fn local(&self, origin: DVec3, direction: DVec3) -> [DVec3; 2] {
        [self.to_object.transform_point3(origin), self.to_object.transform_vector3(direction)]
    }
}

/// A ray with the frame in which it is the third axis.
struct Frame {
    origin: DVec3,
    direction: DVec3,
    axes: [usize; 3],
    shear: [f64; 3],
}

impl Frame {
    fn new(origin: DVec3, direction: DVec3) -> Self {
        let longest = |a: usize, b: usize| if direction[b].abs() > direction[a].abs() { b } else { a };
        let last = longest(longest(0, 1), 2);
        let [mut first, mut second] = [(last + 1) % 3, (last + 2) % 3];
        // The frame stays right-handed along the ray.
        if direction[last] < 0.0 {
            (first, second) = (second, first);
        }
        let shear = [direction[first] / direction[last], direction[second] / direction[last], 1.0 / direction[last]];
        Self { origin, direction, axes: [first, second, last], shear }
    }

    /// Whether the ray may pass a box between two distances.
    fn meets(&self, place: &Aabb<f64, 3>, padding: f64, from: f64, to: f64) -> bool {
        let (mut enter, mut leave) = (from, to);
        for axis in 0..3 {
            let [low, high] =
                [place.min[axis] - padding, place.max[axis] + padding].mapped(|end| end - self.origin[axis]);
            if self.direction[axis] == 0.0 {
                if low > 0.0 || high < 0.0 {
                    return false;
                }
                continue;
            }
            let [first, second] = [low / self.direction[axis], high / self.direction[axis]];
            enter = enter.max(first.min(second));
            leave = leave.min(first.max(second));
        }
        // A ray that begins or ends at the box may round to either side of it.
        enter <= leave + padding * self.shear[2].abs()
    }

    /// Where the ray crosses a triangle.
    fn crossing(&self, corners: [DVec3; 3]) -> Option<Crossing> {
        let [first, second, last] = self.axes;
        let mut reach = 0.0_f64;
        let corners = corners.mapped(|corner| {
            let away = corner - self.origin;
            reach = reach.max(away.abs().max_element());
            let x = away[first] - self.shear[0] * away[last];
            let y = away[second] - self.shear[1] * away[last];
            [x, y, self.shear[2] * away[last]]
        });
        let [a, b, c] = corners;
        let turn = turn(a, b);
        if turn == 0 || self::turn(b, c) != turn || self::turn(c, a) != turn {
            return None;
        }
        let weight = |[px, py, _]: [f64; 3], [qx, qy, _]: [f64; 3]| px * qy - py * qx;
        let weights = [weight(b, c), weight(c, a), weight(a, b)];
        let determinant: f64 = weights.iter().sum();
        let depths = corners.mapped(|[_, _, depth]| depth);
        let least = depths.iter().copied().fold(f64::INFINITY, f64::min);
        let most = depths.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let extent = corners.iter().flat_map(|[x, y, _]| [x.abs(), y.abs()]).fold(0.0, f64::max);
        let depth = most - least;
        // A triangle that is seen from its edge is crossed anywhere in it.
        let blurred = (WEIGHT_ROUNDING * extent * reach * depth / determinant.abs()).min(depth);
        let mean: f64 = weights.iter().zip(depths).map(|(weight, depth)| weight * depth).sum::<f64>() / determinant;
        let distance = if mean.is_nan() { f64::midpoint(least, most) } else { mean.clamp(least, most) };
        let blurred = if blurred.is_nan() { depth } else { blurred };
        let error = blurred + DEPTH_ROUNDING * least.abs().max(most.abs());
        // Counter-clockwise about the ray looks along it.
        Some(Crossing { distance, error, enters: turn < 0 })
    }
}

/// On which side of the origin the line from `p` to `q` runs in the plane: the exact sign of the edge function, for an origin that is moved
/// by (e, e^2), so that only a line without length has none.
fn turn([px, py, _]: [f64; 3], [qx, qy, _]: [f64; 3]) -> i8 {
    let sign = |a: f64, b: f64| i8::from(a > b) - i8::from(a < b);
    let (left, right) = (px * qy, py * qx);
    let mut found = sign(left, right);
    if found == 0 {
        // Products are rounded in their order; of equal ones the remainders decide, which are numbers.
        found = sign(px.mul_add(qy, -left), py.mul_add(qx, -right));
    }
    if found == 0 {
        found = -sign(qy, py);
    }
    if found == 0 {
        found = sign(qx, px);
    }
    found
}
