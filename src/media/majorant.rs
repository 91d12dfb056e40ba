//! Provable majorants and minorants of the extinction of media: an octree that rays walk through.
//!
//! The box of the medium, or of several in world space, is halved along its three axes, level by level. Each node knows an interval that
//! encloses the extinction (of the channel with the most) over its part of the box, from interval
//! arithmetic through the node graph: proven, never sampled. A node is divided where that pays: the
//! null collisions that a render is expected to spend in it, `rays / area * volume * (majorant -
//! minorant)` with the number of rays and the mean area that the box shows to them, have to cost
//! more than the rays' longer way through eight children, and the part of them that dividing is expected to spare more than bounding
//! these: as large a part as its own and its siblings' bounds took off their parent's. (Optical depth
//! decides, not density, and the number of rays: Fong 2023, "Volume rendering for Elemental".)
//!
//! A leaf also has [`Rates`] of tentative collisions. [`Tracking`] says where they come from: from the majorant, so that no
//! weight of a path becomes negative, or from what a few densities in the leaf suggest. These also choose the control of proven
//! rates ([`Majorants::pilot`]).
//!
//! Where no division finds a finite bound, a leaf is *capped*: its majorant is the most extinction that is found at as many places as
//! Cycles looks at there ([`Majorants::cap`]), and extinction beyond it counts as the majorant.
//!
//! Of a flat box, whose sides differ by more than twice, the tree's own box may be larger: its short sides are doubled until cells are as nearly
//! cubes as `shifts` finds that bounds are tight. What lies beyond the medium's box is empty, is not bounded, and no ray goes there.
//!
//! Flat arrays hold the tree, ready for an adapter: the first child of each node, the ends of
//! its interval, its rates. A dense table enters it at level `TABLE_LEVEL`.

use crate::base::arrays::{Mapped, each};
use crate::base::choice::choice;
use crate::base::error::{Error, Result};
use crate::graph::bounds::Bounds3;
use crate::media::region::Region;
use crate::nodes::Interval;
use glam::{DMat4, DVec3, UVec3};

/// Finest level: cells of 1/512 of the box's sides.
pub(crate) const LEVELS: u32 = 9;

/// Level of the dense table that leads into the tree.
pub(crate) const TABLE_LEVEL: u32 = 4;

/// Null collisions that take as long as bounding eight boxes: what dividing a node has to spare. Processor time in all, seconds, of the cloud from close by
/// at 128 x 72 pixels with 60, 120 and 240 here and a [`MOST_KEPT`] of 0.95, and when nodes were divided for 700 null collisions without a look at what that
/// spared: 4 samples 1.8, 1.9, 2.2, 2.0; 46 samples 11.0, 11.0, 11.5, 11.2.
const DIVISION_COST: f64 = 120.0;

/// Most of a node's gap that its children are expected to keep: 667 null collisions always divide it. Where bounds of a level are no tighter than those before,
/// features are smaller than its boxes, and those of a later one may be tight. With 0.95 two published clouds, whose bounds are dear beside their values, took
/// 0.4 and 1.1 times as long at 8 samples as when 700 divided it, but the transmittance of a torus within a cube was noisier: time is not all that divisions save.
const MOST_KEPT: f64 = 0.82;

/// Least difference of the ends of a node's optical depth, along its mean chord, that makes dividing it pay: a ray that expects fewer null collisions
/// crosses one leaf faster than the two or three that it finds instead. Processor time in all of 512 samples of 96 x 54 pixels, with 0, 0.4, 0.8, 1.6 and 3
/// here: the cloud from close by 16.6, 16.8, 17.7, 21.8, 27.7 s; in daylight 8.1, 7.0, 6.3, 6.6, 7.9 s; against the sun 8.7, 7.5, 6.9, 7.6, 9.3 s; a Noise
/// Texture 11.1, 5.8, 4.1, 3.4, 2.9 s; a grid 5.3, 3.3, 3.1, 3.2, 3.4 s. Values that are cheap beside a step ask for more, dear ones for less.
const LEAST_DEPTH: f64 = 0.6;

/// Most boxes that a build bounds: tens of seconds of the heaviest graphs.
const MOST_BOXES: usize = 1 << 19;

/// Padding of a node's box as a fraction of its side. Positions are rounded to f32 before the density
/// is evaluated there: 2^-24 of a coordinate, [`COORDINATE_PADDING`], and a shader's walk errs by a few of these.
const PADDING: f64 = 1e-3;

/// Padding as a fraction of the largest coordinate: 4 ulps.
pub(crate) const COORDINATE_PADDING: f64 = 4.0 / 16_777_216.0;

/// [`DIVISION_COST`] with [`Tracking::Adaptive`], for which bounds matter less. The cloud from close by, 8 and 106 samples, when nodes were divided for 8000,
/// 2000 and 1000 null collisions, half of which a division of it spares: 1.31, 1.14, 1.07 s and 13.5, 11.7, 11.4 s.
const DIVISION_COST_ADAPTIVE: f64 = 1000.0;

/// Expected collisions in a leaf that make dividing it pay, by looking into the parts and not by bounding them.
const WORTH_DIVIDING: f64 = 256.0;

/// Most nodes of a tree: 64 MB of rates and majorants, half of what software adapters bind.
const MOST_NODES: usize = 1 << 22;

/// How often a short side is doubled at most, boxes that are tried for it, and their sides as parts of the box's: those of cells of level 7, where trees end.
const MOST_SHIFTS: u32 = 4;
const TRIED: usize = 64;
const TRIED_SIDE: f64 = 1.0 / 128.0;

/// Densities that are looked up in a leaf to choose its rates.
const PILOTS: usize = 8;

/// Places that are looked at in each cell of level `CAP_LEVEL` of a leaf without a bound: what Cycles 5.0 looks at for its majorants, 16 in each of 128^3 cells.
const CAP_PLACES: usize = 16;
const CAP_LEVEL: u32 = 7;

/// Places that are evaluated at once for caps.
const CAP_BATCH: usize = 1 << 18;

/// Expected null collisions in a leaf that make looking into it pay, where its rates follow from that.
const WORTH_A_PILOT: f64 = 64.0;

/// The same where only its control does: then no leaf is divided in turn. What it takes was not to be seen beside bounding the leaves.
const WORTH_A_CONTROL: f64 = 16.0;

/// Least share of the bounds' gap that the residual rate of proven tracking is: a weight grows by 10 at most where the control is too high. Where few
/// densities look the same, their spread says nothing. Shares of 0.03, 0.1 and 0.3 give the same noise in the cloud from close by.
const PROVEN_FLOOR: f64 = 0.1;

/// Rate of events over the largest extinction that was met, and its least share of the majorant. The second bounds what the
/// weight of a path may grow by where the few densities missed a peak: 19 times, at the peak alone.
const EVENT_RATE: f64 = 3.0;
const EVENT_FLOOR: f64 = 0.1;

/// Residual rate over the largest deviation from the control that was met, and its least share of what the bounds allow.
const RESIDUAL_RATE: f64 = 1.5;
const RESIDUAL_FLOOR: f64 = 0.03;

/// Cells of the finest level along a side.
pub(crate) const FINEST: f64 = (1_u32 << LEVELS) as f64;

/// The octree.
#[derive(Debug, Clone)]
pub struct Majorants {
    /// Corner of the box in the object's frame, its sides, and those of the tree's own box.
    low: DVec3,
    extent: DVec3,
    size: DVec3,
    /// Cells of the finest level along each side of the box; the tree may have more, which are empty.
    inside: [i32; 3],
    /// First of eight children of each node (x is the lowest bit of their order); 0 for a leaf.
    children: Vec<u32>,
    levels: Vec<u8>,
    /// Ends of each node's extinction, per metre.
    majorants: Vec<f32>,
    minorants: Vec<f32>,
    rates: Vec<Rates>,
    /// Whether a node's majorant is a cap, not a bound.
    capped: Vec<bool>,
    /// Node over each cell of level [`TABLE_LEVEL`], x fastest.
    table: Vec<u32>,
    /// Boxes that were bounded.
    pub boxes: usize,
}

/// What [`Majorants::cap`] did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Caps {
    /// Share of the box's volume in leaves without a bound, above 0.
    pub share: f64,
    /// The largest of their caps, per metre.
    pub most: f64,
}

choice! {
    "kebab-case",
    /// Where the rates of tentative collisions come from. All give pictures with the same mean.
    #[derive(Default)]
    pub enum Tracking {
        /// From proven majorants of an octree: no path has a negative weight, so no pixel is negative.
        #[default]
        Proven,
        /// From a few densities in each leaf: the same noise in less than half the time where bounds are loose. A path whose
        /// density is above the rate has a negative weight there, so a few pixels of few samples may be negative.
        Adaptive,
        /// From one proven majorant of the whole medium, to compare with.
        Global,
    }
}

/// What decides how far a tree is divided, and its rates.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Rays that are expected to cross the box.
    pub rays: f64,
    /// Where rates come from.
    pub tracking: Tracking,
}

/// Around which extinction the transmittance of a ray is corrected in a leaf, and how often, both per metre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// Extinction that is taken to be everywhere in the leaf, and corrected at collisions (the control of residual ratio
    /// tracking; Novak et al. 2014).
    pub control: f32,
    /// Tentative collisions.
    pub rate: f32,
}

/// How often a ray stops in a leaf, per metre. Estimates are unbiased for any rate that is above 0 wherever the
/// extinction (for a residual rate: what it deviates from the control) is not 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    /// Of rays whose transmittance is asked, as those to lights.
    pub residual: Residual,
    /// Of rays whose opacity a picture shows: where rates are proven the minorant is the control, so that no transmittance is above 1 and no
    /// opacity below 0. An adapter has this for all rays.
    pub seen: Residual,
    /// Tentative collisions of rays that look for scattering events.
    pub event: f32,
}

impl Rates {
    /// Rates under which no weight becomes negative: minorant as control, majorant.
    fn proven(minorant: f32, majorant: f32) -> Self {
        let residual = Residual { control: minorant, rate: majorant - minorant };
        Self { residual, seen: residual, event: majorant }
    }

    /// Proven rates with a control that a few extinctions in the leaf suggest for rays to lights. No weight becomes negative if the residual rate is
    /// majorant - control; what a ray then adds to the relative variance of its transmittance is the integral of (e - control)^2 over that
    /// rate, which for extinctions of mean m and variance v is least where the rate is the root of (majorant - m)^2 + v.
    fn controlled(found: &[f64], [minorant, majorant]: [f64; 2]) -> Self {
        let count = found.len() as f64;
        let mean = found.iter().sum::<f64>() / count;
        let variance = found.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
        let gap = majorant - minorant;
        let rate = (majorant - mean).hypot(variance.sqrt()).max(PROVEN_FLOOR * gap).min(gap) as f32;
        let [minorant, majorant] = [minorant as f32, majorant as f32];
        // Bounds are widened by more than what these roundings take off the sum of both.
        let residual = Residual { control: (majorant - rate).max(minorant), rate };
        Self { residual, ..Self::proven(minorant, majorant) }
    }

    /// Rates that a few extinctions in the leaf suggest.
    fn suggested(found: &[f64], [minorant, majorant]: [f64; 2]) -> Self {
        let most = found.iter().copied().fold(0.0, f64::max);
        let least = found.iter().copied().fold(f64::INFINITY, f64::min);
        let control = found.iter().sum::<f64>() / found.len() as f64;
        let deviation = (most - control).max(control - least);
        let farthest = (majorant - control).max(control - minorant);
        let rate = (RESIDUAL_RATE * deviation).max(RESIDUAL_FLOOR * farthest).min(farthest) as f32;
        let residual = Residual { control: control as f32, rate };
        Self { residual, seen: residual, event: (EVENT_RATE * most).max(EVENT_FLOOR * majorant).min(majorant) as f32 }
    }
}

/// The octree as the shader reads it.
pub(crate) struct Flat {
    /// Lower corner of the box in the object's frame.
    pub(crate) low: DVec3,
    /// Sides of a cell of the finest level.
    pub(crate) cell: DVec3,
    /// Such cells along each side of the box.
    pub(crate) inside: UVec3,
    /// Where the nodes begin in `tree`.
    pub(crate) nodes: u32,
    /// The node over each cell of the table; then per node its first child, and its level in the upper
    /// four bits.
    pub(crate) tree: Vec<u32>,
    /// Rates of each node and its majorant, per metre; a majorant that is a cap has a minus sign.
    pub(crate) rates: Vec<[f32; 4]>,
}

/// A leaf and where a ray leaves it.
#[derive(Debug, Clone, Copy)]
pub struct Crossing {
    /// Most extinction in the leaf, per metre.
    pub majorant: f64,
    /// How often rays stop in it.
    pub rates: Rates,
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
    /// Metres per cell along each axis; NaN along those on which the ray does not move.
    inverse: DVec3,
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
    /// Share of its parent's gap between the bounds that it and its siblings kept on average; 0 where that is not known.
    kept: f64,
}

/// The whole box.
const ROOT: Pending = Pending { node: 0, place: [0; 3], kept: 0.0 };

impl Majorants {
    /// Encloses the extinction over the box from `low` to `high` of the object's frame. `enclose` bounds
    /// it over boxes, per metre; `to_world` is the object's transform. A leaf whose extinction cannot be bounded has an infinite majorant until
    /// [`Self::cap`].
    pub fn build(
        [low, high]: [DVec3; 2],
        to_world: &DMat4,
        effort: Effort,
        enclose: impl Fn(&[Bounds3]) -> Result<Vec<Interval>>,
    ) -> Result<Self> {
        let extent = high - low;
        let shifts = shifts([low, extent], to_world, &enclose)?;
        let size = extent * DVec3::from(shifts.map(|shift| f64::from(1_u32 << shift)));
        let mut tree = Self {
            low,
            extent,
            size,
            inside: shifts.map(|shift| 1 << (LEVELS - shift)),
            children: vec![0],
            levels: vec![0],
            majorants: vec![f32::INFINITY],
            minorants: vec![0.0],
            rates: vec![Rates::proven(0.0, f32::INFINITY)],
            capped: vec![false],
            table: Vec::new(),
            boxes: 1,
        };
        tree.narrow(0, enclose(&[tree.bounds_of([0; 3], 0)])?[0]);
        let density = rays_per_area(extent, to_world) * effort.rays;
        let cost = match effort.tracking {
            Tracking::Proven => DIVISION_COST,
            Tracking::Adaptive => DIVISION_COST_ADAPTIVE,
            Tracking::Global => f64::INFINITY,
        };
        let volume = to_world.determinant().abs() * size.element_product();
        // Of a ray that crosses the tree's own box: its volume over the mean area that it shows.
        let chord = volume * rays_per_area(size, to_world);
        let mut pending = vec![ROOT];
        for level in 0..=LEVELS {
            let collisions =
                |pending: &Pending| density * volume * 0.125_f64.powi(level as i32) * tree.gap(pending.node);
            let saving = |pending: &Pending| collisions(pending) * (1.0 - pending.kept.min(MOST_KEPT));
            let depth = |pending: &Pending| chord * 0.5_f64.powi(level as i32) * tree.gap(pending.node);
            let mut wanted: Vec<_> = pending.iter().map(|node| (saving(node), *node)).collect();
            wanted.retain(|(saving, node)| *saving > cost && depth(node) > LEAST_DEPTH);
            // Where not all can be divided, those that pay most are; equal ones in their order.
            wanted.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.node.cmp(&b.1.node)));
            let most = if level == LEVELS { 0 } else { (MOST_BOXES - tree.boxes.min(MOST_BOXES)) / 8 };
            wanted.truncate(most);
            if wanted.is_empty() {
                break;
            }
            pending = tree.divide(wanted.into_iter().map(|(_, node)| node), level, &enclose)?;
        }
        tree.merge_empty();
        tree.make_table();
        tree.rates = tree.minorants.iter().zip(&tree.majorants).map(|(&low, &high)| Rates::proven(low, high)).collect();
        Ok(tree)
    }

    /// Gives each leaf whose extinction has no bound a cap: the most that `extinction`, per metre, has at `CAP_PLACES` places of each of its cells of
    /// level `CAP_LEVEL`; `added` per metre is what its majorant has beside extinction. The answer is `None` where every leaf has a bound. An extinction
    /// that is infinite or NaN at such a place is an error that names it.
    pub fn cap(&mut self, added: f64, extinction: impl Fn(&[DVec3]) -> Result<Vec<f64>>) -> Result<Option<Caps>> {
        let mut leaves = self.all_leaves();
        leaves.retain(|(leaf, level)| !self.majorants[leaf.node].is_finite() && self.is_inside(leaf.place, *level));
        let mut caps: Option<Caps> = None;
        for (Pending { node, place, .. }, level) in leaves {
            let side = self.size / f64::from(1_u32 << level);
            let low = self.low + side * DVec3::from(place.map(f64::from));
            let side = side.min(self.low + self.extent - low);
            let count = CAP_PLACES << (3 * CAP_LEVEL.saturating_sub(level));
            let mut most = 0.0_f64;
            for first in (0..count).step_by(CAP_BATCH) {
                let numbers = first..count.min(first + CAP_BATCH);
                let places: Vec<DVec3> = numbers.map(|number| low + side * additive_recurrence(number)).collect();
                let found = extinction(&places)?;
                let of_a_place = found.len() / places.len();
                if let Some(wrong) = found.iter().position(|value| !value.is_finite()) {
                    return Err(not_finite(places[wrong / of_a_place].as_vec3().to_array(), found[wrong]));
                }
                most = found.iter().copied().fold(most, f64::max);
            }
            self.majorants[node] = (most + added) as f32 * (1.0 + f32::EPSILON);
            self.minorants[node] = self.minorants[node].min(self.majorants[node]);
            self.rates[node] = Rates::proven(self.minorants[node], self.majorants[node]);
            self.capped[node] = true;
            let share = side.element_product() / self.extent.element_product();
            let known = caps.unwrap_or(Caps { share: 0.0, most: 0.0 });
            caps = Some(Caps { share: known.share + share, most: known.most.max(most) });
        }
        Ok(caps)
    }

    /// Whether the majorant of the leaf where a ray is is a cap.
    pub fn is_capped(&self, walk: &Walk) -> bool {
        self.capped[self.leaf(walk.cell)]
    }

    /// Chooses the rates of leaves in which more null collisions are expected than looking into them costs: from the
    /// extinction at a few places of each, in the object's frame. Proven rates stay proven, with another control. `to_world` and `effort` as for
    /// [`Self::build`]; `extinction` has as many values for each place as there are extinctions that one control stands for.
    pub fn pilot(
        &mut self,
        to_world: &DMat4,
        effort: Effort,
        extinction: impl Fn(&[DVec3]) -> Result<Vec<f64>>,
    ) -> Result<()> {
        let worth = match effort.tracking {
            Tracking::Proven => WORTH_A_CONTROL,
            Tracking::Adaptive => WORTH_A_PILOT,
            Tracking::Global => return Ok(()),
        };
        let density = rays_per_area(self.extent, to_world) * effort.rays;
        let volume = to_world.determinant().abs() * self.size.element_product();
        let mut wanted = self.all_leaves();
        loop {
            wanted.retain(|&(Pending { node, .. }, level)| {
                density * volume * 0.125_f64.powi(level as i32) * self.gap(node) > worth
            });
            if wanted.is_empty() {
                break;
            }
            let places: Vec<DVec3> = wanted
                .iter()
                .flat_map(|&(Pending { place, .. }, level)| {
                    let side = self.size / f64::from(1_u32 << level);
                    let low = self.low + side * DVec3::from(place.map(f64::from));
                    // A cell may reach beyond the box.
                    let side = side.min(self.low + self.extent - low);
                    (0..PILOTS).map(move |number| low + side * additive_recurrence(number))
                })
                .collect();
            let found = extinction(&places)?;
            let mut divided = Vec::new();
            let of_a_leaf = found.len() / wanted.len();
            for (&(pending, level), found) in wanted.iter().zip(found.chunks(of_a_leaf)) {
                let Pending { node, .. } = pending;
                let ends = [self.minorants[node], self.majorants[node]].map(f64::from);
                // What is outside of its bounds is reported where a path meets it.
                if !found.iter().all(|value| (0.0..=ends[1]).contains(value)) {
                    continue;
                }
                if effort.tracking == Tracking::Proven {
                    self.rates[node] = Rates::controlled(found, ends);
                    continue;
                }
                self.rates[node] = Rates::suggested(found, ends);
                let Rates { residual, event, .. } = self.rates[node];
                let collisions = density * volume * 0.125_f64.powi(level as i32) * f64::from(residual.rate + event);
                if collisions > WORTH_DIVIDING && level < LEVELS && self.children.len() + 8 <= MOST_NODES {
                    divided.extend(self.give_children(pending, level).map(|child| (child, level + 1)));
                }
            }
            wanted = divided;
        }
        self.make_table();
        Ok(())
    }

    /// All leaves with their levels.
    fn all_leaves(&self) -> Vec<(Pending, u32)> {
        let mut leaves = Vec::new();
        let mut pending = vec![ROOT];
        while let Some(next) = pending.pop() {
            let Pending { node, place, .. } = next;
            if self.children[node] == 0 {
                leaves.push((next, u32::from(self.levels[node])));
                continue;
            }
            pending.extend((0..8).map(|octant| child_of(&place, self.children[node] as usize, octant)));
        }
        leaves
    }

    /// Gives a node of `level` eight children that know of the extinction what it knows.
    fn give_children(&mut self, parent: Pending, level: u32) -> impl Iterator<Item = Pending> + use<> {
        let first = self.children.len();
        self.children[parent.node] = first as u32;
        for _ in 0..8 {
            self.children.push(0);
            self.levels.push(level as u8 + 1);
            self.majorants.push(self.majorants[parent.node]);
            self.minorants.push(self.minorants[parent.node]);
            self.rates.push(self.rates[parent.node]);
            self.capped.push(self.capped[parent.node]);
        }
        (0..8).map(move |octant| child_of(&parent.place, first, octant))
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
            children.extend(self.give_children(parent, level));
        }
        let (mut children, empty): (Vec<_>, Vec<_>) =
            children.into_iter().partition(|child| self.is_inside(child.place, level + 1));
        for Pending { node, .. } in empty {
            (self.majorants[node], self.minorants[node]) = (0.0, 0.0);
        }
        let boxes: Vec<Bounds3> = children.iter().map(|child| self.bounds_of(child.place, level + 1)).collect();
        self.boxes += boxes.len();
        let intervals = enclose(&boxes)?;
        let mut intervals = intervals.iter();
        // Behind the root nodes stand in eights, those of one parent.
        for siblings in children.chunk_by_mut(|a, b| (a.node - 1) / 8 == (b.node - 1) / 8) {
            let gaps =
                |tree: &Self, siblings: &[Pending]| siblings.iter().map(|child| tree.gap(child.node)).sum::<f64>();
            let before = gaps(self, siblings);
            for (child, interval) in siblings.iter().zip(intervals.by_ref()) {
                self.narrow(child.node, *interval);
            }
            let kept = gaps(self, siblings) / before;
            // Of infinite gaps and of none that says nothing.
            let kept = if kept.is_finite() { kept } else { 0.0 };
            siblings.iter_mut().for_each(|child| child.kept = kept);
        }
        Ok(children)
    }

    /// Between a node's bounds, per metre: what its tentative collisions are null by.
    fn gap(&self, node: usize) -> f64 {
        f64::from(self.majorants[node]) - f64::from(self.minorants[node])
    }

    /// Whether a cell of a level meets the box.
    fn is_inside(&self, place: [i32; 3], level: u32) -> bool {
        (0..3).all(|axis| place[axis] << (LEVELS - level) < self.inside[axis])
    }

    /// The box of a node in the object's frame, padded.
    fn bounds_of(&self, place: [i32; 3], level: u32) -> Bounds3 {
        let side = self.size / f64::from(1_u32 << level);
        let low = self.low + side * DVec3::from(place.map(f64::from));
        let end = self.low + self.extent;
        let largest = self.low.abs().max(end.abs()).max_element();
        let pad = side * PADDING + COORDINATE_PADDING * largest;
        Bounds3::new((low - pad).as_vec3().to_array(), ((low + side).min(end) + pad).as_vec3().to_array())
    }

    /// Narrows a node's interval, which is its parent's so far. Negative extinction acts as 0.
    fn narrow(&mut self, node: usize, interval: Interval) {
        if interval.may_be_nan || !interval.high.is_finite() {
            return;
        }
        self.majorants[node] = self.majorants[node].min(interval.high.max(0.0));
        self.minorants[node] = self.minorants[node].max(interval.low).min(self.majorants[node]);
    }

    /// Makes leaves of nodes whose children are all empty leaves: bounds of parts are tighter than those of the whole, and a
    /// ray crosses one leaf faster than several.
    fn merge_empty(&mut self) {
        // Children stand behind their parents.
        for node in (0..self.children.len()).rev() {
            let first = self.children[node] as usize;
            let is_empty = |child: usize| self.children[child] == 0 && self.majorants[child] == 0.0;
            if first != 0 && (first..first + 8).all(is_empty) {
                self.children[node] = 0;
                (self.minorants[node], self.majorants[node]) = (0.0, 0.0);
            }
        }
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
        let [x, y, z] = cell.mapped(|number| (number >> (LEVELS - TABLE_LEVEL)) as usize);
        let mut node = self.table[(z << TABLE_LEVEL | y) << TABLE_LEVEL | x] as usize;
        while self.children[node] != 0 {
            node = self.child(node, cell, LEVELS - u32::from(self.levels[node]) - 1);
        }
        node
    }

    /// Least and most extinction in the leaf that holds a position of the object's frame.
    pub fn at(&self, position: DVec3) -> [f64; 2] {
        let cell = self.cell_of((position - self.low) / self.size * FINEST);
        let leaf = self.leaf(cell);
        [f64::from(self.minorants[leaf]), f64::from(self.majorants[leaf])]
    }

    /// Least and most extinction in the whole box.
    pub fn range(&self) -> [f64; 2] {
        let leaves = self.all_leaves().into_iter().filter(|(leaf, level)| self.is_inside(leaf.place, *level));
        let leaves: Vec<usize> = leaves.map(|(leaf, _)| leaf.node).collect();
        let least = leaves.iter().map(|&leaf| self.minorants[leaf]).fold(f32::INFINITY, f32::min);
        let most = leaves.iter().map(|&leaf| self.majorants[leaf]).fold(0.0, f32::max);
        [f64::from(least), f64::from(most)]
    }

    /// The tree in the form of the shader.
    pub(crate) fn flat(&self) -> Flat {
        let nodes = self.children.iter().zip(&self.levels).map(|(&child, &level)| child | u32::from(level) << 28);
        Flat {
            low: self.low,
            cell: self.size / FINEST,
            inside: UVec3::from(self.inside.map(|cells| cells as u32)),
            nodes: self.table.len() as u32,
            tree: self.table.iter().copied().chain(nodes).collect(),
            rates: self
                .rates
                .iter()
                .zip(self.majorants.iter().zip(&self.capped))
                .map(|(rates, (&majorant, &capped))| {
                    [rates.seen.control, rates.seen.rate, rates.event, if capped { -majorant } else { majorant }]
                })
                .collect(),
        }
    }

    /// Number of leaves.
    pub fn leaves(&self) -> usize {
        self.all_leaves().len()
    }

    /// A ray of the object's frame, its direction per metre of world space, between two distances;
    /// None where it misses the box.
    pub fn enter(&self, origin: DVec3, direction: DVec3, from: f64, to: f64) -> Option<Walk> {
        let region = Region { low: self.low, high: self.low + self.extent };
        let (enter, leave) = region.segment(origin, direction)?;
        let (from, to) = (from.max(enter), to.min(leave));
        if from >= to {
            return None;
        }
        let origin = (origin - self.low) / self.size * FINEST;
        let direction = direction / self.size * FINEST;
        let inverse = DVec3::select(direction.cmpeq(DVec3::ZERO), DVec3::NAN, direction.recip());
        Some(Walk {
            origin,
            direction,
            inverse,
            cell: self.cell_of(origin + direction * from),
            distance: from,
            end: to,
        })
    }

    /// The leaf where the ray is.
    #[inline]
    pub fn crossing(&self, walk: &Walk) -> Crossing {
        let leaf = self.leaf(walk.cell);
        let span = 1_i32 << (LEVELS - u32::from(self.levels[leaf]));
        let base = walk.cell.mapped(|number| number & !(span - 1));
        let mut exit = f64::INFINITY;
        let mut axis = 0;
        for candidate in 0..3 {
            let face = base[candidate] + span * i32::from(walk.direction[candidate] > 0.0);
            let distance = (f64::from(face) - walk.origin[candidate]) * walk.inverse[candidate];
            // Not where the distance is NaN.
            let is_nearer = distance < exit;
            exit = if is_nearer { distance } else { exit };
            axis = if is_nearer { candidate } else { axis };
        }
        Crossing {
            majorant: f64::from(self.majorants[leaf]),
            rates: self.rates[leaf],
            // Rounding may put the exit before the place where the ray is.
            exit: exit.clamp(walk.distance, walk.end),
            axis,
            base,
            span,
        }
    }

    /// The cell of the finest level in the box that holds a place, or the nearest.
    #[inline]
    fn cell_of(&self, place: DVec3) -> [i32; 3] {
        each(|axis| (place[axis] as i32).clamp(0, self.inside[axis] - 1))
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
        (0..self.inside[crossing.axis]).contains(&walk.cell[crossing.axis])
    }

    /// Where the ray is, in the object's frame.
    #[inline]
    pub fn position(&self, walk: &Walk) -> DVec3 {
        self.low + (walk.origin + walk.direction * walk.distance) * (self.size / FINEST)
    }
}

/// How often each side of a box is doubled for the tree: as often as its longest side is twice as long, or less, by what bounds tell. A layer of
/// even noise has cells of even sides; one that was stretched with its box has cells that are stretched, too. Tried are boxes of one volume, whose
/// sides are those of each way's cells, at the same places.
fn shifts(
    [low, extent]: [DVec3; 2],
    to_world: &DMat4,
    enclose: &impl Fn(&[Bounds3]) -> Result<Vec<Interval>>,
) -> Result<[u32; 3]> {
    let sides: [f64; 3] = std::array::from_fn(|axis| (to_world.col(axis).truncate() * extent[axis]).length());
    let longest = sides.iter().copied().fold(0.0, f64::max);
    // What is no number or flat has no shape to follow.
    let most = sides.map(|side| {
        let doublings = (longest / side).log2().floor();
        if doublings.is_finite() { doublings.clamp(0.0, f64::from(MOST_SHIFTS)) as u32 } else { 0 }
    });
    let mut best = ([0; 3], f64::INFINITY);
    for limit in 0..=most.into_iter().max().unwrap_or(0) {
        if most == [0; 3] {
            break;
        }
        let shifts = most.map(|shift| shift.min(limit));
        let whole = f64::from(shifts.iter().sum::<u32>());
        let part = DVec3::from(shifts.map(|shift| TRIED_SIDE * (f64::from(shift) - whole / 3.0).exp2()));
        let side = extent * part.min(DVec3::ONE);
        let boxes: Vec<Bounds3> = (0..TRIED)
            .map(|number| {
                let low = low + (extent - side) * additive_recurrence(number);
                Bounds3::new(low.as_vec3().to_array(), (low + side).as_vec3().to_array())
            })
            .collect();
        let gap = |interval: &Interval| match interval.may_be_nan {
            true => f64::INFINITY,
            false => f64::from(interval.high).max(0.0) - f64::from(interval.low).max(0.0),
        };
        let gaps: f64 = enclose(&boxes)?.iter().map(gap).sum();
        if gaps < best.1 {
            best = (shifts, gaps);
        }
    }
    Ok(best.0)
}

/// Rays per square metre where one ray crosses the box: one over the mean area that a convex body
/// shows, a quarter of its surface (Cauchy).
fn rays_per_area(size: DVec3, to_world: &DMat4) -> f64 {
    let edge = |axis: usize| to_world.col(axis).truncate() * size[axis];
    let face = |first: usize, second: usize| edge(first).cross(edge(second)).length();
    2.0 / (face(0, 1) + face(1, 2) + face(2, 0))
}

/// Points of the unit cube that cover it evenly: multiples of the powers of 1/p with p^4 = p + 1 (Roberts 2018, "The
/// unreasonable effectiveness of quasirandom sequences").
fn additive_recurrence(number: usize) -> DVec3 {
    const STEPS: DVec3 = DVec3::new(0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_2);
    (STEPS * (number as f64 + 0.5)).fract()
}

/// An extinction that no path can be traced through.
pub(crate) fn not_finite(position: [f32; 3], extinction: f64) -> Error {
    Error::new(
        format!("the object-space position {position:?}"),
        format!("an extinction of {extinction} per metre"),
        "a finite extinction",
        "Look at the density there (cloudparity eval), and clamp it in the material.",
    )
}

/// A child of a node, whose first child is known.
fn child_of(parent: &[i32; 3], first: usize, octant: usize) -> Pending {
    let place = std::array::from_fn(|axis| 2 * parent[axis] + (octant >> axis & 1) as i32);
    Pending { node: first + octant, place, ..ROOT }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box of 8 x 8 x 0.5 m, [-1, 1] in its object's frame.
    fn flat_box() -> ([DVec3; 2], DMat4) {
        ([DVec3::NEG_ONE, DVec3::ONE], DMat4::from_scale(DVec3::new(4.0, 4.0, 0.25)))
    }

    /// Distance of the nearest and the farthest place of an interval from 0.
    fn magnitudes(low: f64, high: f64) -> [f64; 2] {
        [if low > 0.0 { low } else { (-high).max(0.0) }, low.abs().max(high.abs())]
    }

    /// Per metre of distance: thick enough for many leaves.
    const SLOPE: f64 = 20.0;

    /// Bounds of the distance from the middle in metres, times [`SLOPE`].
    fn distance(boxes: &[Bounds3]) -> Result<Vec<Interval>> {
        let of = |part: &Bounds3| {
            let ends = [0, 1, 2].map(|axis| magnitudes(part.low[axis].into(), part.high[axis].into()));
            let length = |end: usize| DVec3::new(4.0 * ends[0][end], 4.0 * ends[1][end], 0.25 * ends[2][end]).length();
            Interval::outward(SLOPE * length(0), SLOPE * length(1), false)
        };
        Ok(boxes.iter().map(of).collect())
    }

    /// Bounds of the height in the object's frame.
    fn height(boxes: &[Bounds3]) -> Result<Vec<Interval>> {
        let of = |part: &Bounds3| {
            let [least, most] = magnitudes(part.low[2].into(), part.high[2].into());
            Interval::outward(least, most, false)
        };
        Ok(boxes.iter().map(of).collect())
    }

    #[test]
    fn cells_are_cubes_where_the_medium_has_no_direction_and_follow_it_where_it_has() {
        let ([low, high], to_world) = flat_box();
        assert_eq!(shifts([low, high - low], &to_world, &distance).expect("bounds"), [0, 0, 4]);
        assert_eq!(shifts([low, high - low], &to_world, &height).expect("bounds"), [0; 3]);
        assert_eq!(shifts([low, high - low], &DMat4::IDENTITY, &distance).expect("bounds"), [0; 3], "a cube");
    }

    #[test]
    fn a_node_is_divided_for_what_its_parts_are_expected_to_spare() {
        let effort = Effort { rays: 3700.0, tracking: Tracking::Proven };
        // Bounds of the cells of a level, from 0 to this.
        let boxes = |most: fn(i32) -> f32| {
            let enclose = |boxes: &[Bounds3]| {
                let level = |part: &Bounds3| -(part.high[0] - part.low[0]).log2().round() as i32;
                Ok(boxes.iter().map(|part| Interval::new(0.0, most(level(part)))).collect())
            };
            Majorants::build([DVec3::ZERO, DVec3::ONE], &DMat4::IDENTITY, effort, enclose).expect("a tree").boxes
        };
        // Two thirds of 3.7e6 null collisions in the whole box, 8^-level of them in a cell. Where parts keep all of the gap, 0.18 of that has
        // to be more than a division costs: 867 at level 3, 108 at level 4.
        let to_level_4 = (0..=4).map(|level| 8_usize.pow(level)).sum::<usize>();
        assert_eq!(boxes(|_| 1000.0), to_level_4);
        // Parts that keep a half promise to spare the other half, 151 of 301 in a cell of level 4; then 9 of 19.
        assert_eq!(boxes(|level| 1000.0 * 0.5_f32.powi((level - 3).clamp(0, 2))), to_level_4 + 8_usize.pow(5));
    }

    #[test]
    fn rays_through_a_flat_box_miss_no_part_of_it() {
        let ([low, high], to_world) = flat_box();
        let effort = Effort { rays: 1e6, tracking: Tracking::Proven };
        let tree = Majorants::build([low, high], &to_world, effort, distance).expect("a tree");
        assert_eq!(tree.inside, [512, 512, 32]);
        assert!(tree.leaves() > 1000);
        let mut longest = 0_usize;
        for number in 0..400 {
            let [from, to] = [number, number + 57].map(|index| additive_recurrence(index) * 2.4 - 1.2);
            let way = (to - from).normalize();
            let segment = Region { low, high }.segment(from, way).filter(|(enter, leave)| enter < leave);
            let walk = tree.enter(from, way, -100.0, 100.0);
            assert_eq!(walk.is_some(), segment.is_some(), "{from} to {to}");
            let (Some(mut walk), Some((enter, leave))) = (walk, segment) else { continue };
            let mut length = 0.0;
            let mut crossings = 0;
            loop {
                let before = walk.distance;
                let crossing = tree.crossing(&walk);
                // In its middle a leaf's bounds hold, and they are those of the place.
                let middle = from + way * ((before + crossing.exit) / 2.0);
                let extinction = SLOPE * to_world.transform_vector3(middle).length();
                let [least, most] = tree.at(middle);
                if crossing.exit - before > 1e-9 {
                    assert!(least <= extinction && extinction <= most, "{middle}: {least} {extinction} {most}");
                    assert_eq!(most, crossing.majorant, "{middle}");
                }
                length += crossing.exit - before;
                crossings += 1;
                if !tree.cross(&mut walk, &crossing) {
                    break;
                }
            }
            assert!((length - (leave - enter)).abs() < 1e-9, "{from} to {to}: {length} of {}", leave - enter);
            longest = longest.max(crossings);
        }
        assert!(longest > 20, "rays go through many leaves: {longest}");
        let [least, most] = tree.range();
        assert!(least < 0.1 * SLOPE && (5.6..6.2).contains(&(most / SLOPE)), "{least} to {most}");
    }

    #[test]
    fn controls_take_noise_away_and_no_weight_below_zero() {
        let ([low, high], to_world) = flat_box();
        let effort = Effort { rays: 1e5, tracking: Tracking::Proven };
        // Bounds as loose as those of a graph are.
        let loose = |boxes: &[Bounds3]| {
            let widened =
                |found: Interval| Interval::outward(0.3 * f64::from(found.low), 2.0 * f64::from(found.high), false);
            Ok(distance(boxes)?.into_iter().map(widened).collect())
        };
        let extinction = |place: DVec3| SLOPE * to_world.transform_vector3(place).length();
        let plain = Majorants::build([low, high], &to_world, effort, loose).expect("a tree");
        let mut tree = plain.clone();
        tree.pilot(&to_world, effort, |places| Ok(places.iter().copied().map(extinction).collect())).expect("controls");
        assert_eq!(tree.leaves(), plain.leaves(), "no leaf is divided");
        let mut noise = [0.0; 2];
        for number in 0..4096 {
            let place = low + (high - low) * additive_recurrence(number);
            let leaf = tree.leaf(tree.cell_of((place - tree.low) / tree.size * FINEST));
            let [least, most] = tree.at(place);
            let rates @ Rates { residual: Residual { control, rate }, event, .. } = tree.rates[leaf];
            let [control, residual] = [control, rate].map(f64::from);
            // What two roundings to f32 take off is less than what bounds are widened by.
            assert!(
                control >= least && control + residual >= most * (1.0 - f64::from(f32::EPSILON)),
                "{place}: {rates:?}"
            );
            assert!(residual >= 0.0999 * (most - least) && f64::from(event) == most, "{place}: {rates:?}");
            for (noise, tree) in noise.iter_mut().zip([&plain, &tree]) {
                let Residual { control, rate } = tree.rates[leaf].residual;
                *noise += (extinction(place) - f64::from(control)).powi(2) / f64::from(rate);
            }
        }
        // The variance of a cell is some hundredth of its mean's distance from either bound.
        assert!(noise[1] < 0.1 * noise[0], "{noise:?}");
    }

    #[test]
    fn a_control_stays_within_what_is_proven_whatever_was_met() {
        for (found, ends) in [
            ([1.0; 8], [1.0, 1.0]),
            ([2.0; 8], [1.0, 2.0]),
            ([1.0; 8], [1.0, 2.0]),
            ([0.0; 8], [0.0, 3.0]),
            ([0.0, 3.0, 0.0, 3.0, 0.0, 3.0, 0.0, 3.0], [0.0, 3.0]),
            ([1e-30; 8], [0.0, 1e30]),
        ] {
            let Rates { residual: Residual { control, rate: residual }, seen, event } = Rates::controlled(&found, ends);
            let [least, most] = ends.map(|end| end as f32);
            assert!(
                control >= least && control + residual >= most && residual <= most - least,
                "{found:?}: {control} {residual}"
            );
            assert!(residual >= 0.0999 * (most - least), "{found:?}: {residual}");
            assert_eq!([event, seen.control, seen.rate], [most, least, most - least]);
        }
    }
}
