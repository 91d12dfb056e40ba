//! What the path integrator asks of the media of a scene, in one place: coefficients at a batch of positions, how
//! they are bounded, and how they scatter.
//!
//! Everything happens in a *frame*: the object's own where there is one object, the world where there are several.
//! Three things are found out beforehand, because they make paths cheaper or less noisy:
//!
//! * whether the coefficients are one density times constants: then all channels share its bounds;
//! * whether phase functions and their proportions are constant: then no event has to look them up;
//! * whether emission is the same in the whole medium: then it is integrated in closed form along flights.

use crate::base::arrays::Mapped;
use crate::base::error::{Error, Result};
use crate::graph::Program;
use crate::graph::bounds::Bounds3;
use crate::graph::evaluate::Evaluator;
use crate::media::majorant::{COORDINATE_PADDING, Caps, Effort, Majorants};
use crate::media::mesh::{PlacedMesh, Span};
use crate::media::object_index::ObjectIndex;
use crate::media::objects::{ObjectMedium, PhaseMixture, Values};
use crate::media::phase::PhaseFunction;
use crate::media::region::Region;
use crate::nodes::Interval;
use crate::nodes::closure::Coefficients;
use glam::{DMat4, DVec3};
use indexmap::IndexMap;
use rayon::prelude::*;
use std::sync::Arc;

/// Tentative collisions that are added, for the sake of emission that varies, to a ray along the diagonal of a
/// medium that emits as much as its bound everywhere. More make emission less noisy and rays slower.
const EMISSION_COLLISIONS: f64 = 16.0;

/// How often the box of a medium is divided into eight to bound its emission.
const EMISSION_DEPTH: u32 = 3;

/// Widening of bounds, relative: their rounding to f32, and what an adapter's f32 product is rounded by.
const WIDENING: f64 = 2.0 * f32::EPSILON as f64;

/// Positions that a thread looks up before the rays begin.
const PILOT_BATCH: usize = 4096;

const NOTHING: Coefficients<f64> = Coefficients { scattering: [0.0; 3], extinction: [0.0; 3], emission: [0.0; 3] };

/// A part of a ray that lies in a mesh.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Part {
    /// Number of the object.
    pub(crate) object: usize,
    /// Where along the ray.
    pub(crate) span: Span,
}

impl Part {
    /// Whether a distance along the ray belongs to it.
    pub(crate) fn holds(&self, distance: f64) -> bool {
        (self.span[0]..=self.span[1]).contains(&distance)
    }
}

/// What is known beforehand of how light scatters.
pub(crate) enum Lobes {
    /// By one constant phase function.
    Single(PhaseFunction),
    /// By several constant ones in constant proportions.
    Constant(PhaseMixture),
    /// Only known at a position.
    Varying,
}

/// The media of a scene with their majorants.
pub(crate) struct Volume {
    /// Those that have an inside.
    objects: Vec<Arc<ObjectMedium>>,
    /// Where they are, if there are several.
    index: Option<ObjectIndex>,
    /// Objects with one program, by their numbers in ascending order.
    groups: Vec<Vec<usize>>,
    /// Of each object the group.
    group_of: Vec<usize>,
    /// Coefficients per unit density, of one object in which only the density varies.
    proportional: Option<Coefficients<f64>>,
    /// None where no object has an inside.
    pub(crate) majorants: Option<Majorants>,
    /// Per channel, what a control is multiplied by to be one of that channel: the channel's extinction over that
    /// of the channel with the most where coefficients are proportional to a density, else 1.
    pub(crate) share: [f64; 3],
    /// Radiance per metre that is the same in the whole medium; 0 if it varies.
    pub(crate) emission: [f64; 3],
    /// Whether emission varies, and so is collected at tentative collisions.
    pub(crate) emission_varies: bool,
    /// Tentative collisions per metre for each unit of varying emission.
    emission_rate: f64,
    /// Varying emission beyond this adds no more collisions: infinity where emission has a bound.
    emission_cap: f64,
    /// Where extinction has no bound, and what it is capped at.
    pub(crate) caps: Option<Caps>,
    /// Whether any object fills a mesh, and whether there is no other.
    pub(crate) has_mesh: bool,
    pub(crate) is_mesh: bool,
    /// How light scatters.
    pub(crate) lobes: Lobes,
    /// World to frame.
    pub(crate) to_frame: DMat4,
}

impl Volume {
    /// The volume of media.
    pub(crate) fn new(mut objects: Vec<Arc<ObjectMedium>>, effort: Effort) -> Result<Self> {
        objects.retain(|object| !object.bounds.is_empty());
        let proportional = match objects.as_slice() {
            [only] => only.proportional(),
            _ => None,
        };
        if let Some(unit) = &proportional {
            check(unit)?;
        }
        let most = proportional.map_or(0.0, |unit| largest(&unit.extinction));
        let constant_emission = match objects.as_slice() {
            [] => Some([0.0; 3]),
            [only] => only.constant_emission(),
            several if several.iter().all(|object| object.character.dark) => Some([0.0; 3]),
            _ => None,
        };
        let groups = groups(&objects);
        let mut volume = Self {
            share: proportional.filter(|_| most > 0.0).map_or([1.0; 3], |unit| unit.extinction.map(|own| own / most)),
            emission: constant_emission.unwrap_or([0.0; 3]),
            emission_varies: constant_emission.is_none(),
            emission_rate: 0.0,
            emission_cap: f64::INFINITY,
            caps: None,
            has_mesh: objects.iter().any(|object| object.mesh.is_some()),
            is_mesh: matches!(objects.as_slice(), [only] if only.mesh.is_some()),
            lobes: lobes(&objects, proportional.is_some())?,
            to_frame: if let [only] = objects.as_slice() { only.to_object } else { DMat4::IDENTITY },
            majorants: None,
            index: (objects.len() > 1).then(|| ObjectIndex::new(&objects)),
            group_of: group_of(&groups, objects.len()),
            groups,
            proportional,
            objects,
        };
        let Some(region) = volume.region() else { return Ok(volume) };
        let to_world = volume.to_frame.inverse();
        let mut added = 0.0;
        if volume.emission_varies {
            let (most, is_bound) = volume.most_emission()?;
            volume.emission_varies = most > 0.0;
            if volume.emission_varies {
                volume.emission_rate = EMISSION_COLLISIONS / (most * diagonal(&region, &to_world));
            }
            if !is_bound {
                volume.emission_cap = most;
            }
            added = volume.emission_rate * most;
        }
        let enclose = |boxes: &[Bounds3]| volume.enclose(boxes);
        let mut majorants = Majorants::build([region.low, region.high], &to_world, effort, enclose)?;
        volume.caps = majorants.cap(added, |places| volume.extinctions(places))?;
        if let Some(Caps { share, most }) = volume.caps {
            log::warn!(
                "the extinction has no bound in {:.2e} % of the volume: beyond {most:.4} per metre, the most that was found there, \
                 it counts as that",
                100.0 * share
            );
        }
        // Emission that varies is collected at tentative collisions, whose rate is above 0 by its majorant.
        if !volume.emission_varies {
            majorants.pilot(&to_world, effort, |places| volume.extinctions(places))?;
        }
        volume.majorants = Some(majorants);
        Ok(volume)
    }

    /// The only object, or what stands in the way.
    pub(crate) fn single(&self) -> Result<&ObjectMedium> {
        match self.objects.as_slice() {
            [only] => Ok(only),
            several => Err(Error::new(
                "the media of the scene",
                format!("{} objects", several.len()),
                "one object",
                "Leave the other objects out, or use the CPU.",
            )),
        }
    }

    /// The box of the frame that holds all objects; none without an object.
    fn region(&self) -> Option<Region> {
        match self.objects.as_slice() {
            [] => None,
            [only] => Some(only.bounds),
            several => several
                .iter()
                .map(|object| object.bounds.surrounding(&object.to_object.inverse()))
                .reduce(|a, b| Region { low: a.low.min(b.low), high: a.high.max(b.high) }),
        }
    }

    /// The magnitude of varying emission to which the rate of collisions refers, and whether it is a bound. Any rate above 0 gives the right mean, so none
    /// is needed: where emission has no bound, this is the largest of the finite ones of parts of the box, or 1 where no part has one.
    fn most_emission(&self) -> Result<(f64, bool)> {
        let (mut sum, mut is_bound) = (0.0, true);
        for object in &self.objects {
            let whole = Bounds3::new(object.bounds.low.as_vec3().into(), object.bounds.high.as_vec3().into());
            let most = magnitude(&object.bounds_of(&[whole], EMISSION_DEPTH)?[0].emission);
            if most.is_finite() {
                sum += most;
                continue;
            }
            is_bound = false;
            let mut parts = vec![whole];
            for _ in 0..EMISSION_DEPTH {
                parts = parts.iter().flat_map(Bounds3::octants).collect();
            }
            let bounds = object.bounds_of(&parts, 0)?.into_iter().map(|part| magnitude(&part.emission));
            let largest = bounds.filter(|bound| bound.is_finite()).fold(0.0, f64::max);
            sum += if largest > 0.0 { largest } else { 1.0 };
        }
        Ok((sum, is_bound))
    }

    /// Encloses, over boxes of the frame, the extinction and what is added to it for the sake of emission. The
    /// upper end holds for every channel; the lower one for the channel with the most where coefficients are
    /// proportional to a density, else for every channel.
    fn enclose(&self, boxes: &[Bounds3]) -> Result<Vec<Interval>> {
        let widened = |low: f64, high: f64, may_be_nan: bool| Interval {
            low: (low * (1.0 - WIDENING)) as f32,
            high: (high * (1.0 + WIDENING)) as f32,
            may_be_nan,
        };
        if let Some(unit) = &self.proportional {
            let most = largest(&unit.extinction);
            let scaled = |density: Interval| {
                let [low, high] = density.ends().mapped(|end| end.max(0.0) * most);
                widened(low, high, density.may_be_nan)
            };
            let program = self.objects[0].program();
            if program.output_components() == 0 {
                return Ok(vec![scaled(Interval::ONE); boxes.len()]);
            }
            return Ok(program.bounds_many(boxes)?.into_iter().map(scaled).collect());
        }
        // Of each object the boxes that it may meet, and how.
        let mut parts: Vec<Vec<(usize, Bounds3, bool)>> = vec![Vec::new(); self.objects.len()];
        let mut candidates = Vec::new();
        for (number, place) in boxes.iter().enumerate() {
            self.candidates(&mut candidates, |index, found| index.meeting(&region_of(place), found));
            for &object in &candidates {
                let part = self.part_inside(&self.objects[object], place);
                parts[object].extend(part.map(|(part, whole)| (number, part, whole)));
            }
        }
        let mut found: Vec<Vec<Coefficients<Interval>>> = vec![Vec::new(); self.objects.len()];
        for group in &self.groups {
            let program = self.objects[group[0]].program();
            let places: Vec<Bounds3> =
                group.iter().flat_map(|&object| &parts[object]).map(|(_, part, _)| *part).collect();
            let rows = program.bounds_refined(&places, 0)?;
            let width = program.output_components();
            let mut place = 0;
            for &object in group {
                let enclosed = |number: usize| self.objects[object].enclosed(&rows[number * width..][..width]);
                found[object] = (place..place + parts[object].len()).map(enclosed).collect();
                place += parts[object].len();
            }
        }
        let mut sums = vec![Enclosed::default(); boxes.len()];
        for (parts, found) in parts.iter().zip(&found) {
            for ((number, _, whole), found) in parts.iter().zip(found) {
                sums[*number].add(found, *whole);
            }
        }
        let together = |sum: &Enclosed| {
            let least = sum.low.iter().copied().fold(f64::INFINITY, f64::min);
            // Without varying emission the rate is 0, and its product with an infinite bound would be NaN.
            let counted = largest(&sum.emission).min(self.emission_cap);
            let emission = if self.emission_varies { self.emission_rate * counted } else { 0.0 };
            widened(least, largest(&sum.high) + emission, sum.may_be_nan)
        };
        Ok(sums.iter().map(together).collect())
    }

    /// Extinctions at positions of the frame that a control stands for, on all cores: of the channel with the most where coefficients are
    /// proportional to a density, else three for each position.
    fn extinctions(&self, positions: &[DVec3]) -> Result<Vec<f64>> {
        let parts: Vec<Vec<f64>> = positions
            .par_chunks(PILOT_BATCH)
            .map(|part| {
                let mut found = Vec::new();
                self.evaluator()?.evaluate(
                    part,
                    &|place, object| self.objects[object].holds(part[place]),
                    &mut found,
                )?;
                let extinctions = found.iter().map(|coefficients| coefficients.extinction);
                Ok(match self.proportional {
                    Some(_) => extinctions.map(|channels| largest(&channels)).collect(),
                    None => extinctions.flatten().collect(),
                })
            })
            .collect::<Result<_>>()?;
        Ok(parts.concat())
    }

    /// The part of a box of the frame that may lie inside an object, in the object's frame, and whether all of
    /// the box does; none where they are apart.
    fn part_inside(&self, object: &ObjectMedium, place: &Bounds3) -> Option<(Bounds3, bool)> {
        if let [_] = self.objects.as_slice() {
            return Some((*place, true));
        }
        let around = region_of(place).surrounding(&object.to_object);
        let own = object.bounds;
        // What part of its box a mesh fills is not known.
        let whole = object.mesh.is_none() && around.low.cmpge(own.low).all() && around.high.cmple(own.high).all();
        // Positions are rounded to f32 in the object's frame.
        let pad = COORDINATE_PADDING * own.low.abs().max(own.high.abs()).max_element();
        let (low, high) = (around.low.max(own.low) - pad, around.high.min(own.high) + pad);
        low.cmple(high).all().then(|| (Bounds3::new(low.as_vec3().into(), high.as_vec3().into()), whole))
    }

    /// Distance along a ray of the last face of an object up to `far`; negative infinity where there is none. A
    /// camera ray of Cycles goes from face to face, and leaves out the medium behind the last one that it finds.
    /// (Measured for one object, where it leaves out all of an object that reaches across the far clip.)
    pub(crate) fn last_face(&self, origin: DVec3, direction: DVec3, far: f64) -> f64 {
        let faces = |object: &Arc<ObjectMedium>| {
            if let Some(mesh) = &object.mesh {
                return mesh.last_face(origin, direction, far).map(|face| (face, face));
            }
            let origin = object.to_object.transform_point3(origin);
            let direction = object.to_object.transform_vector3(direction);
            object.bounds.segment(origin, direction)
        };
        let later = |last: f64, object: &Arc<ObjectMedium>| {
            let faces = faces(object).into_iter().flat_map(|(enter, leave)| [enter, leave]);
            faces.filter(|&face| face <= far).fold(last, f64::max)
        };
        let Some(index) = &self.index else { return self.objects.iter().fold(f64::NEG_INFINITY, later) };
        let mut candidates = Vec::new();
        index.along(origin, direction, [f64::NEG_INFINITY, far], &mut candidates);
        candidates.iter().map(|&object| &self.objects[object]).fold(f64::NEG_INFINITY, later)
    }

    /// The parts of a ray that lie in meshes, each with the number of its object, between two distances. `inside` says of which objects the
    /// ray comes from inside.
    pub(crate) fn parts(
        &self,
        origin: DVec3,
        direction: DVec3,
        between: Span,
        inside: impl Fn(usize, &PlacedMesh) -> bool,
        parts: &mut Vec<Part>,
    ) {
        parts.clear();
        let (mut spans, mut candidates) = (Vec::new(), Vec::new());
        self.candidates(&mut candidates, |index, found| index.along(origin, direction, between, found));
        for object in candidates {
            let Some(mesh) = &self.objects[object].mesh else { continue };
            mesh.spans(origin, direction, between, inside(object, mesh), &mut spans);
            parts.extend(spans.drain(..).map(|span| Part { object, span }));
        }
    }

    /// Whether any channel scatters anywhere.
    pub(crate) fn scatters(&self) -> bool {
        self.objects.iter().any(|object| !object.character.absorbing)
    }

    /// Whether any channel emits.
    pub(crate) fn emits(&self) -> bool {
        self.emission_varies || self.emission != [0.0; 3]
    }

    /// The objects that an index finds, in ascending order; the only one where there are not several.
    fn candidates(&self, found: &mut Vec<usize>, find: impl FnOnce(&ObjectIndex, &mut Vec<usize>)) {
        match &self.index {
            Some(index) => find(index, found),
            None => {
                found.clear();
                found.extend(0..self.objects.len());
            }
        }
    }

    /// Evaluates coefficients on the calling thread.
    pub(crate) fn evaluator(&self) -> Result<CoefficientEvaluator<'_>> {
        let programs = self.groups.iter().map(|group| Evaluator::new(self.objects[group[0]].program()));
        Ok(CoefficientEvaluator {
            volume: self,
            programs: programs.collect::<Result<_>>()?,
            shares: self.objects.iter().map(|_| Share::default()).collect(),
            met: Vec::new(),
            by_group: Vec::new(),
            candidates: Vec::new(),
            positions: Vec::new(),
        })
    }
}

/// Numbers of objects by their program, in the order of the first of each.
fn groups(objects: &[Arc<ObjectMedium>]) -> Vec<Vec<usize>> {
    let mut groups: IndexMap<*const Program, Vec<usize>> = IndexMap::new();
    for (number, object) in objects.iter().enumerate() {
        groups.entry(Arc::as_ptr(object.program())).or_default().push(number);
    }
    groups.into_values().collect()
}

/// Of each object the group that it is in.
fn group_of(groups: &[Vec<usize>], count: usize) -> Vec<usize> {
    let mut found = vec![0; count];
    for (group, objects) in groups.iter().enumerate() {
        objects.iter().for_each(|&object| found[object] = group);
    }
    found
}

/// A box of the frame in f64.
fn region_of(place: &Bounds3) -> Region {
    let corner = |corner: [f32; 3]| DVec3::from(corner.mapped(f64::from));
    Region { low: corner(place.low), high: corner(place.high) }
}

/// Refuses coefficients that make no sense.
fn check(unit: &Coefficients<f64>) -> Result<()> {
    for (name, values, least) in [
        ("extinction", unit.extinction, 0.0),
        ("scattering", unit.scattering, 0.0),
        // A cool blackbody's blue is below 0.
        ("emission", unit.emission, f64::MIN),
    ] {
        if values.iter().any(|value| !(value.is_finite() && *value >= least)) {
            return Err(Error::new(
                "$.graph, the closure's colours",
                format!("{name} {values:?}"),
                "finite coefficients, extinction and scattering not below 0",
                "Correct Color, Absorption Color or the emission.",
            ));
        }
    }
    Ok(())
}

/// How objects scatter. Lobes of coefficients that are proportional to a density are constant, and so are their
/// proportions.
fn lobes(objects: &[Arc<ObjectMedium>], proportional: bool) -> Result<Lobes> {
    let mut lobes = objects.iter().flat_map(|object| object.phases());
    // Where nothing scatters any will do.
    let Some(first) = lobes.next() else { return Ok(Lobes::Single(PhaseFunction::ISOTROPIC)) };
    if let Some(first) = first
        && lobes.all(|lobe| lobe == Some(first))
    {
        return Ok(Lobes::Single(first));
    }
    if !proportional {
        return Ok(Lobes::Varying);
    }
    let row = vec![1.0; objects[0].program().output_components()];
    let mixture = objects[0].values(&row).mixture(0);
    check_phase(&mixture, format!("object {}", objects[0].object))?;
    Ok(Lobes::Constant(mixture))
}

/// Refuses phase functions with parameters that are no numbers.
fn check_phase(mixture: &PhaseMixture, place: String) -> Result<()> {
    if mixture.evaluate(0.0).is_finite() {
        return Ok(());
    }
    Err(Error::new(
        place,
        "a phase function without a finite value",
        "finite parameters of scattering",
        "Look at what Anisotropy and its like are (cloudparity eval).",
    ))
}

fn largest(values: &[f64; 3]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

/// A bound of the magnitude of all channels; infinity where there is none.
fn magnitude(channels: &[Interval]) -> f64 {
    let of = |channel: &Interval| if channel.may_be_nan { f64::INFINITY } else { channel.magnitude() };
    channels.iter().map(of).fold(0.0, f64::max)
}

/// Length in metres that no edge of a box exceeds, near that of its diagonal: the root of the sum of their squares.
fn diagonal(region: &Region, to_world: &DMat4) -> f64 {
    let size = region.high - region.low;
    (0..3).map(|axis| (to_world.col(axis).truncate() * size[axis]).length_squared()).sum::<f64>().sqrt()
}

/// Bounds over a box, summed over objects.
#[derive(Debug, Clone, Copy, Default)]
struct Enclosed {
    low: [f64; 3],
    high: [f64; 3],
    /// Magnitude.
    emission: [f64; 3],
    may_be_nan: bool,
}

impl Enclosed {
    /// Adds an object that fills the whole box, or perhaps only a part.
    fn add(&mut self, found: &Coefficients<Interval>, whole: bool) {
        for channel in 0..3 {
            let [low, high] = found.extinction[channel].ends();
            // Negative extinction is refused where it is met.
            self.low[channel] += if whole { low.max(0.0) } else { 0.0 };
            self.high[channel] += high.max(0.0);
            self.emission[channel] += magnitude(&found.emission[channel..=channel]);
            self.may_be_nan |= found.extinction[channel].may_be_nan;
        }
    }
}

/// Coefficients at batches of positions.
pub(crate) struct CoefficientEvaluator<'a> {
    volume: &'a Volume,
    /// Of each group of objects.
    programs: Vec<Evaluator<'a>>,
    /// Of each object.
    shares: Vec<Share<'a>>,
    /// Objects that have a share of the batch, in ascending order.
    met: Vec<usize>,
    /// The same by group and number.
    by_group: Vec<(usize, usize)>,
    candidates: Vec<usize>,
    positions: Vec<[f32; 3]>,
}

/// One object's share of a batch.
#[derive(Default)]
struct Share<'a> {
    /// Positions inside, in the object's frame, and which of the batch they are (in ascending order).
    positions: Vec<[f32; 3]>,
    lanes: Vec<usize>,
    values: Option<Values<'a>>,
}

impl CoefficientEvaluator<'_> {
    /// Deals positions out to the objects that they lie in; faces of boxes count as inside. `inside` says of a position and an object, by their
    /// numbers, whether it lies in the object's mesh; it is asked where there are several objects.
    fn deal_out(&mut self, positions: &[DVec3], inside: &dyn Fn(usize, usize) -> bool) {
        for object in self.met.drain(..) {
            let Share { positions, lanes, values } = &mut self.shares[object];
            positions.clear();
            lanes.clear();
            *values = None;
        }
        for (lane, position) in positions.iter().enumerate() {
            let several = self.volume.index.is_some();
            self.volume.candidates(&mut self.candidates, |index, found| index.at(*position, found));
            for &object in &self.candidates {
                let medium = &self.volume.objects[object];
                let local = if several { medium.to_object.transform_point3(*position) } else { *position };
                let Region { low, high } = medium.bounds;
                let holds = || match &medium.mesh {
                    None => local.cmpge(low).all() && local.cmple(high).all(),
                    Some(_) => inside(lane, object),
                };
                if !several || holds() {
                    let share = &mut self.shares[object];
                    if share.lanes.is_empty() {
                        self.met.push(object);
                    }
                    share.positions.push(local.as_vec3().to_array());
                    share.lanes.push(lane);
                }
            }
        }
        self.met.sort_unstable();
    }

    /// Sums of the objects' coefficients; objects with one program are evaluated together.
    fn sum_objects(
        &mut self,
        positions: &[DVec3],
        inside: &dyn Fn(usize, usize) -> bool,
        results: &mut [Coefficients<f64>],
    ) -> Result<()> {
        self.deal_out(positions, inside);
        self.by_group.clear();
        self.by_group.extend(self.met.iter().map(|&object| (self.volume.group_of[object], object)));
        self.by_group.sort_unstable();
        for met in self.by_group.chunk_by(|a, b| a.0 == b.0) {
            self.positions.clear();
            self.positions.extend(met.iter().flat_map(|&(_, object)| &self.shares[object].positions));
            let rows = self.programs[met[0].0].evaluate(&self.positions);
            let mut begin = 0;
            for &(_, object) in met {
                let (medium, share) = (&self.volume.objects[object], &mut self.shares[object]);
                let end = begin + share.lanes.len() * medium.program().output_components();
                share.values = Some(medium.values(&rows[begin..end]));
                begin = end;
            }
        }
        // In the order of the objects: the sum of each position is the same whatever it is evaluated beside.
        for &object in &self.met {
            let Share { positions, lanes, values } = &self.shares[object];
            let values = values.as_ref().expect("every object that is met is of a group");
            for (row, (&lane, &position)) in lanes.iter().zip(positions).enumerate() {
                let found = values.checked(row, position)?;
                let sum = &mut results[lane];
                for channel in 0..3 {
                    sum.scattering[channel] += found.scattering[channel];
                    sum.extinction[channel] += found.extinction[channel];
                    sum.emission[channel] += found.emission[channel];
                }
            }
        }
        Ok(())
    }

    /// One entry per position of the frame, into `results`. `inside` says whether a position, by its number, lies in the mesh of an object, by
    /// its number; it is asked where there are several objects. Where coefficients are proportional to a density, NaN
    /// stays to be seen and emission is left out.
    pub(crate) fn evaluate(
        &mut self,
        positions: &[DVec3],
        inside: &dyn Fn(usize, usize) -> bool,
        results: &mut Vec<Coefficients<f64>>,
    ) -> Result<()> {
        results.clear();
        let Some(unit) = &self.volume.proportional else {
            results.resize(positions.len(), NOTHING);
            return self.sum_objects(positions, inside, results);
        };
        let coefficients = |density: f64| Coefficients {
            scattering: unit.scattering.mapped(|per_density| per_density * density),
            extinction: unit.extinction.mapped(|per_density| per_density * density),
            emission: [0.0; 3],
        };
        if self.volume.objects[0].program().output_components() == 0 {
            results.resize(positions.len(), coefficients(1.0));
            return Ok(());
        }
        self.positions.clear();
        self.positions.extend(positions.iter().map(|position| position.as_vec3().to_array()));
        let densities = self.programs[0].evaluate(&self.positions).iter();
        // Negative density acts as 0, and NaN is not below 0.
        results.extend(densities.map(|&density| coefficients(if density < 0.0 { 0.0 } else { f64::from(density) })));
        Ok(())
    }

    /// The lobes at a position of the last batch, by its number; asked only where they are [`Lobes::Varying`].
    pub(crate) fn mixture(&self, lane: usize) -> Result<PhaseMixture> {
        let mut mixture = PhaseMixture::empty();
        for &object in &self.met {
            let Share { positions, lanes, values } = &self.shares[object];
            let (Some(values), Ok(row)) = (values, lanes.binary_search(&lane)) else { continue };
            mixture.append(values.mixture(row));
            let (name, place) = (&self.volume.objects[object].object, positions[row]);
            check_phase(&mixture, format!("object {name}, object-space position {place:?}"))?;
        }
        Ok(mixture)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::media::majorant::Tracking;
    use crate::media::objects::Media;
    use crate::scene::Scene;
    use glam::DQuat;
    use rand::{Rng as _, SeedableRng as _};

    /// A scene of many turned boxes in two materials, some in others.
    fn crowd(count: usize) -> Scene {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/scenes/overlapping-cubes.scene.json");
        let mut scene = Scene::load(&path).expect("a committed scene");
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let kinds: Vec<_> = scene.volumes().expect("volumes").iter().map(|(volume, _)| (*volume).clone()).collect();
        for number in 0..count {
            let mut vector = |size: f64| DVec3::from([(); 3].map(|()| random.random_range(-size..size)));
            let turned = DQuat::from_axis_angle(vector(1.0).normalize(), vector(3.0).x);
            let scale = vector(0.6).abs() + 0.1;
            let matrix = DMat4::from_scale_rotation_translation(scale, turned, vector(2.5));
            let mut copy = kinds[number % kinds.len()].clone();
            copy.object = format!("copy {number}");
            copy.matrix_world = matrix.transpose().to_cols_array_2d().map(|row| row.map(|value| value as f32));
            scene.other_volumes.push(copy);
        }
        scene
    }

    #[test]
    fn many_objects_are_the_sum_of_each_by_itself() {
        let scene = crowd(200);
        let media = Media::new(&scene).expect("media");
        let effort = Effort { tracking: Tracking::Proven, rays: 1.0 };
        let volume = Volume::new(media.objects.clone(), effort).expect("a volume");
        assert_eq!(volume.objects.len(), scene.volumes().expect("volumes").len());
        // Copies of one material share its program.
        assert!(volume.groups.len() <= 2, "{} programs", volume.groups.len());
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(6);
        let positions: Vec<DVec3> =
            (0..3000).map(|_| DVec3::from([(); 3].map(|()| random.random_range(-3.0..3.0)))).collect();
        let mut found = Vec::new();
        let mut evaluator = volume.evaluator().expect("an evaluator");
        // Once more with other positions: nothing is left of a batch.
        for positions in [&positions[..1000], &positions[1000..]] {
            evaluator.evaluate(positions, &|_, _| false, &mut found).expect("coefficients");
            let expected = media.evaluate(positions).expect("coefficients");
            let boxes: Vec<Bounds3> = positions
                .iter()
                .map(|place| Bounds3::new((*place - 0.01).as_vec3().into(), (*place + 0.01).as_vec3().into()))
                .collect();
            let bounds = volume.enclose(&boxes).expect("bounds");
            let mut several = 0;
            for (lane, ((found, expected), bounds)) in found.iter().zip(&expected).zip(bounds).enumerate() {
                assert_eq!(found, &expected.coefficients, "{}", positions[lane]);
                let most = largest(&found.extinction);
                assert!(most <= f64::from(bounds.high), "{most} {bounds:?}");
                let least = found.extinction.iter().copied().fold(f64::INFINITY, f64::min);
                assert!(least >= f64::from(bounds.low), "{least} {bounds:?}");
                let lobes = expected.mixture.lobes().len();
                several += usize::from(lobes > 1);
                if matches!(volume.lobes, Lobes::Varying) {
                    assert_eq!(evaluator.mixture(lane).expect("lobes"), expected.mixture);
                }
            }
            assert!(several > 20, "{several} places lie in several objects");
        }
    }
}
