//! Provable majorants and minorants of the extinction of media: an octree that rays walk through.
//!
//! The box of the medium, or of several in world space, is halved along its three axes, level by level. Each node knows an interval that
//! encloses the extinction (of the channel with the most) over its part of the box, from interval
//! arithmetic through the node graph: proven, never sampled. A node is divided where that pays: the
//! null collisions that a render is expected to spend in it, `rays / area * volume * (majorant -
//! minorant)` with the number of rays and the mean area that the box shows to them, have to cost
//! more than bounding eight children. (Optical depth decides, not density, and the number of rays: Fong
//! 2023, "Volume rendering for Elemental".)
//!
//! Three flat arrays hold the tree, ready for an adapter: the first child of each node, the ends of
//! its interval. A dense table enters it at level `TABLE_LEVEL`.

use super::medium::Region;
use crate::error::{Error, Result};
use crate::graph::bounds::Bounds3;
use crate::nodes::Interval;
use glam::{DMat4, DVec3};

/// Finest level: cells of 1/512 of the box's sides.
const LEVELS: u32 = 9;

/// Level of the dense table that leads into the tree.
const TABLE_LEVEL: u32 = 4;

/// Expected null collisions that make dividing a node pay. Bounding a box of the cloud takes as long
/// as evaluating 20 to 40 points, eight of them up to 320, and dividing saves a part of the null
/// collisions. Measured at 320 x 180 pixels of 64 samples: with 600 here 197017 boxes and 1.7e6 collisions
/// (20.5 s of processor time), with 3000 44681 boxes and 3.4e6 collisions (14.9 s).
const WORTHWHILE: f64 = 2000.0;

/// Most boxes that a build bounds: tens of seconds of the heaviest graphs.
const MOST_BOXES: usize = 1 << 19;

/// Padding of a node's box as a fraction of its side. Positions are rounded to f32 before the density
/// is evaluated there: 2^-24 of a coordinate, [`COORDINATE_PADDING`], and a shader's walk errs by a few of these.
const PADDING: f64 = 1e-3;

/// Padding as a fraction of the largest coordinate: 4 ulps.
pub(super) const COORDINATE_PADDING: f64 = 4.0 / 16_777_216.0;

/// Cells of the finest level along a side.
const FINEST: f64 = (1_u32 << LEVELS) as f64;

/// The octree.
#[derive(Debug, Clone)]
pub struct Majorants {
    /// Corner and sides of the box in the object's frame.
    low: DVec3,
    size: DVec3,
    /// First of eight children of each node (x is the lowest bit of their order); 0 for a leaf.
    children: Vec<u32>,
    levels: Vec<u8>,
    /// Ends of each node's extinction, per metre.
    majorants: Vec<f32>,
    minorants: Vec<f32>,
    /// Node over each cell of level [`TABLE_LEVEL`], x fastest.
    table: Vec<u32>,
    /// Boxes that were bounded.
    pub boxes: usize,
}

/// The octree as the shader reads it.
pub(super) struct Flat {
    /// Lower corner of the box in the object's frame.
    pub(super) low: DVec3,
    /// Sides of a cell of the finest level.
    pub(super) cell: DVec3,
    /// Where the nodes begin in `tree`.
    pub(super) nodes: u32,
    /// The node over each cell of the table; then per node its first child, and its level in the upper
    /// four bits.
    pub(super) tree: Vec<u32>,
    /// Minorant and majorant of each node, per metre.
    pub(super) bounds: Vec<[f32; 2]>,
}

/// A leaf and where a ray leaves it.
#[derive(Debug, Clone, Copy)]
pub struct Crossing {
    /// Most extinction in the leaf, per metre.
    pub majorant: f64,
    /// Least extinction.
    pub minorant: f64,
    /// Distance along the ray at which it leaves the leaf.
    pub exit: f64,
    axis: usize,
    base: [i32; 3],
    span: i32,
}

/// A ray on its way through the leaves. Coordinates count cells of the finest level.
#[derive(Debug, Clone, Copy, Default)]
pub struct Walk {
    origin: DVec3,
    direction: DVec3,
    cell: [i32; 3],
    /// Metres from the ray's origin.
    pub distance: f64,
    /// Where the ray leaves the box, or ends inside.
    pub end: f64,
}

/// A node that may be divided, and its place among the cells of its level.
#[derive(Debug, Clone, Copy)]
struct Pending {
    node: usize,
    place: [i32; 3],
}

impl Majorants {
    /// Encloses the extinction over the box from `low` to `high` of the object's frame. `enclose` bounds
    /// it over boxes, per metre; `to_world` is the object's transform; `rays` is how many rays are
    /// expected to cross the box. A part whose extinction cannot be bounded is an error that says where.
    pub fn build(
        [low, high]: [DVec3; 2],
        to_world: &DMat4,
        rays: f64,
        enclose: impl Fn(&[Bounds3]) -> Result<Vec<Interval>>,
    ) -> Result<Self> {
        let size = high - low;
        let mut tree = Self {
            low,
            size,
            children: vec![0],
            levels: vec![0],
            majorants: vec![f32::INFINITY],
            minorants: vec![0.0],
            table: Vec::new(),
            boxes: 1,
        };
        tree.narrow(0, enclose(&[tree.bounds_of([0; 3], 0)])?[0]);
        let density = rays_per_area(size, to_world) * rays;
        let volume = to_world.determinant().abs() * size.element_product();
        let mut pending = vec![Pending { node: 0, place: [0; 3] }];
        for level in 0..=LEVELS {
            let gain = |pending: &Pending| {
                let [low, high] = [tree.minorants[pending.node], tree.majorants[pending.node]].map(f64::from);
                density * volume * 0.125_f64.powi(level as i32) * (high - low)
            };
            let mut wanted: Vec<_> = pending.iter().map(|node| (gain(node), *node)).collect();
            wanted.retain(|(gain, _)| *gain > WORTHWHILE);
            // Where not all can be divided, those that pay most are; equal ones in their order.
            wanted.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.node.cmp(&b.1.node)));
            let most = if level == LEVELS { 0 } else { (MOST_BOXES - tree.boxes.min(MOST_BOXES)) / 8 };
            if let Some((_, node)) = wanted.get(most).filter(|(gain, _)| !gain.is_finite()) {
                return Err(tree.unbounded(node.place, level));
            }
            wanted.truncate(most);
            if wanted.is_empty() {
                break;
            }
            pending = tree.divide(wanted.into_iter().map(|(_, node)| node), level, &enclose)?;
        }
        tree.make_table();
        Ok(tree)
    }

    /// Gives each node of `level` eight children, bounds them, and says which they are.
    fn divide(
        &mut self,
        parents: impl Iterator<Item = Pending>,
        level: u32,
        enclose: &impl Fn(&[Bounds3]) -> Result<Vec<Interval>>,
    ) -> Result<Vec<Pending>> {
        let mut parents: Vec<Pending> = parents.collect();
        parents.sort_by_key(|parent| parent.node);
        let mut children = Vec::with_capacity(8 * parents.len());
        for parent in parents {
            self.children[parent.node] = self.children.len() as u32;
            for octant in 0..8 {
                let place = std::array::from_fn(|axis| 2 * parent.place[axis] + (octant >> axis & 1));
                children.push(Pending { node: self.children.len(), place });
                self.children.push(0);
                self.levels.push(level as u8 + 1);
                self.majorants.push(self.majorants[parent.node]);
                self.minorants.push(self.minorants[parent.node]);
            }
        }
        let boxes: Vec<Bounds3> = children.iter().map(|child| self.bounds_of(child.place, level + 1)).collect();
        self.boxes += boxes.len();
        for (child, interval) in children.iter().zip(enclose(&boxes)?) {
            self.narrow(child.node, interval);
        }
        Ok(children)
    }

    fn unbounded(&self, place: [i32; 3], level: u32) -> Error {
        let bounds = self.bounds_of(place, level);
        Error::new(
            format!("extinction between {:?} and {:?} of the object's frame", bounds.low, bounds.high),
            "a density, a coefficient or an emission that may be infinite or NaN there",
            "one with a finite bound",
            "Look at the density there (cloudparity eval), and clamp it in the material.",
        )
    }

    /// The box of a node in the object's frame, padded.
    fn bounds_of(&self, place: [i32; 3], level: u32) -> Bounds3 {
        let side = self.size / f64::from(1_u32 << level);
        let low = self.low + side * DVec3::from(place.map(f64::from));
        let largest = self.low.abs().max((self.low + self.size).abs()).max_element();
        let pad = side * PADDING + COORDINATE_PADDING * largest;
        Bounds3::new((low - pad).as_vec3().to_array(), (low + side + pad).as_vec3().to_array())
    }

    /// Narrows a node's interval, which is its parent's so far. Negative extinction acts as 0.
    fn narrow(&mut self, node: usize, interval: Interval) {
        if interval.may_be_nan || !interval.high.is_finite() {
            return;
        }
        self.majorants[node] = self.majorants[node].min(interval.high.max(0.0));
        self.minorants[node] = self.minorants[node].max(interval.low).min(self.majorants[node]);
    }

    /// Notes which node, at level [`TABLE_LEVEL`] or above, lies over each cell of the table.
    fn make_table(&mut self) {
        let side = 1_i32 << TABLE_LEVEL;
        let cells = (0..side).flat_map(|z| (0..side).flat_map(move |y| (0..side).map(move |x| [x, y, z])));
        self.table = cells
            .map(|cell| {
                let mut node = 0;
                for level in 0..TABLE_LEVEL {
                    if self.children[node] == 0 {
                        break;
                    }
                    node = self.child(node, cell, TABLE_LEVEL - level - 1);
                }
                node as u32
            })
            .collect();
    }

    /// The child of an inner node that holds `cell`, of which bit `bit` decides on each axis.
    #[inline]
    fn child(&self, node: usize, cell: [i32; 3], bit: u32) -> usize {
        let upper = |axis: usize| (cell[axis] >> bit & 1) as usize;
        self.children[node] as usize + (upper(0) | upper(1) << 1 | upper(2) << 2)
    }

    /// The leaf that holds a cell of the finest level.
    #[inline]
    fn leaf(&self, cell: [i32; 3]) -> usize {
        let [x, y, z] = cell.map(|number| (number >> (LEVELS - TABLE_LEVEL)) as usize);
        let mut node = self.table[(z << TABLE_LEVEL | y) << TABLE_LEVEL | x] as usize;
        while self.children[node] != 0 {
            node = self.child(node, cell, LEVELS - u32::from(self.levels[node]) - 1);
        }
        node
    }

    /// Least and most extinction in the leaf that holds a position of the object's frame.
    pub fn at(&self, position: DVec3) -> [f64; 2] {
        let cell = cell_of((position - self.low) / self.size * FINEST);
        let leaf = self.leaf(cell);
        [f64::from(self.minorants[leaf]), f64::from(self.majorants[leaf])]
    }

    /// Least and most extinction in the whole box.
    pub fn range(&self) -> [f64; 2] {
        let leaves = || (0..self.children.len()).filter(|&node| self.children[node] == 0);
        let least = leaves().map(|leaf| self.minorants[leaf]).fold(f32::INFINITY, f32::min);
        let most = leaves().map(|leaf| self.majorants[leaf]).fold(0.0, f32::max);
        [f64::from(least), f64::from(most)]
    }

    /// The tree in the form of the shader.
    pub(super) fn flat(&self) -> Flat {
        let nodes = self.children.iter().zip(&self.levels).map(|(&child, &level)| child | u32::from(level) << 28);
        Flat {
            low: self.low,
            cell: self.size / FINEST,
            nodes: self.table.len() as u32,
            tree: self.table.iter().copied().chain(nodes).collect(),
            bounds: self.minorants.iter().zip(&self.majorants).map(|(&low, &high)| [low, high]).collect(),
        }
    }

    /// Number of leaves.
    pub fn leaves(&self) -> usize {
        self.children.iter().filter(|&&child| child == 0).count()
    }

    /// A ray of the object's frame, its direction per metre of world space, between two distances;
    /// None where it misses the box.
    pub fn enter(&self, origin: DVec3, direction: DVec3, from: f64, to: f64) -> Option<Walk> {
        let region = Region { low: self.low, high: self.low + self.size };
        let (enter, leave) = region.segment(origin, direction)?;
        let (from, to) = (from.max(enter), to.min(leave));
        if from >= to {
            return None;
        }
        let origin = (origin - self.low) / self.size * FINEST;
        let direction = direction / self.size * FINEST;
        Some(Walk { origin, direction, cell: cell_of(origin + direction * from), distance: from, end: to })
    }

    /// The leaf where the ray is.
    #[inline]
    pub fn crossing(&self, walk: &Walk) -> Crossing {
        let leaf = self.leaf(walk.cell);
        let span = 1_i32 << (LEVELS - u32::from(self.levels[leaf]));
        let base = walk.cell.map(|number| number & !(span - 1));
        let mut exit = f64::INFINITY;
        let mut axis = 0;
        for candidate in 0..3 {
            let direction = walk.direction[candidate];
            if direction == 0.0 {
                continue;
            }
            let face = if direction > 0.0 { base[candidate] + span } else { base[candidate] };
            let distance = (f64::from(face) - walk.origin[candidate]) / direction;
            if distance < exit {
                exit = distance;
                axis = candidate;
            }
        }
        Crossing {
            majorant: f64::from(self.majorants[leaf]),
            minorant: f64::from(self.minorants[leaf]),
            // Rounding may put the exit before the place where the ray is.
            exit: exit.clamp(walk.distance, walk.end),
            axis,
            base,
            span,
        }
    }

    /// Goes to the end of a leaf; false where the ray ends.
    #[inline]
    pub fn cross(&self, walk: &mut Walk, crossing: &Crossing) -> bool {
        walk.distance = crossing.exit;
        if crossing.exit >= walk.end {
            return false;
        }
        let place = walk.origin + walk.direction * crossing.exit;
        for axis in 0..3 {
            let base = crossing.base[axis];
            walk.cell[axis] = if axis != crossing.axis {
                (place[axis] as i32).clamp(base, base + crossing.span - 1)
            } else if walk.direction[axis] > 0.0 {
                base + crossing.span
            } else {
                base - 1
            };
        }
        (0..1 << LEVELS).contains(&walk.cell[crossing.axis])
    }

    /// Where the ray is, in the object's frame.
    #[inline]
    pub fn position(&self, walk: &Walk) -> DVec3 {
        self.low + (walk.origin + walk.direction * walk.distance) * (self.size / FINEST)
    }
}

/// Rays per square metre where one ray crosses the box: one over the mean area that a convex body
/// shows, a quarter of its surface (Cauchy).
fn rays_per_area(size: DVec3, to_world: &DMat4) -> f64 {
    let edge = |axis: usize| to_world.col(axis).truncate() * size[axis];
    let face = |first: usize, second: usize| edge(first).cross(edge(second)).length();
    2.0 / (face(0, 1) + face(1, 2) + face(2, 0))
}

/// The cell of the finest level that holds a place, or the nearest.
#[inline]
fn cell_of(place: DVec3) -> [i32; 3] {
    std::array::from_fn(|axis| (place[axis] as i32).clamp(0, (1 << LEVELS) - 1))
}
