//! The march of a real-time engine: a fixed number of equal steps through the domain of a density, lit by a light model.
//!
//! Unlike the deterministic integrator, which computes single scattering as a reference does, this one computes what engines compute: the
//! light at a sample is a model ([`crate::engines::light`]), thin samples are skipped, rays end early, and published forms keep their
//! defects. Arithmetic is f64 but for the density, which is its program's f32; the twin on the adapter is `shaders/engines/march.wgsl`.
//!
//! A ray that crosses the domain over a length L (of all parts together, where it crosses it several times) takes `steps` samples at
//! (i + j) s with s = L / steps and jitter j in [0, 1] (2 j with defect TK-3, where they lie on the ray). With the density's extinction e and source S at a sample, the transmittance T as
//! it was before,
//!
//! - plain: C += T S s;
//! - energy-conserving: C += T S (1 - exp(-e s)) / e (Hillaire 2015, "Physically Based and Unified Volumetric Rendering in
//!   Frostbite");
//!
//! and T *= exp(-e s). Steps that grow by a factor k begin at L (k^i - 1) / (k^steps - 1). Lengths are in the engine's unit ([`Container::unit`]), directions unit vectors of the world; places are in the
//! density's frame, whose axes need not be of one length or at right angles.

pub mod air;
pub mod camera;
pub mod distance_levels;
pub mod gpu;
pub mod light_volume;
pub mod shadow_map;

use crate::base::arrays::Mapped;
use crate::base::choice::choice;
use crate::base::error::{Error, Result};
use crate::engines::domain::{Container, Outline, Parts, unit};
use crate::engines::light::terms::{Ground, ray_powder};
use crate::engines::light::{LightModel, LightTerm, Lit, ShadowExtinction, ShadowLength, SourceFactor};
use crate::engines::march::air::Air;
use crate::engines::march::distance_levels::DistanceLevels;
use crate::engines::march::light_volume::ReadVolume;
use crate::engines::march::shadow_map::ShadowMap;
use crate::media::averages::Averages;
use crate::media::density::{Density, DensityEvaluator};
use crate::media::light_volume::Columns;
use crate::media::region::Region;
use crate::media::transfer::{Integration, smooth, step_weight, transmittance};
use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::cell::OnceCell;
use std::sync::Arc;

/// A crossing shorter than this, in units of length, is left out.
pub(crate) const SHORTEST: f64 = 1e-3;

/// Rays that are marched together, at least and at most: densities are read in batches, and what a batch costs beside its places should be
/// little.
const FEWEST_RAYS: usize = 64;
const MOST_RAYS: usize = 512;

/// Tasks of a core, so that all end at about the same time.
const TASKS_OF_A_CORE: usize = 8;

/// Samples of a ray that are read at a time: a ray that ends has read some for nothing.
const SAMPLES_TOGETHER: usize = 4;

/// How a ray is marched.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RealTimeSettings {
    /// Steps of a ray; at least 1.
    pub steps: u32,
    /// Length of a step over that of the one before, at least 1; 1: equal steps.
    #[serde(default = "equal", skip_serializing_if = "is_equal")]
    pub growth: f64,
    /// How a step adds its light.
    pub integration: Integration,
    /// Whether the source fades to nothing over the last two steps of a ray, while its extinction stays (defect PF-9).
    pub exit_fade: bool,
    /// Samples of at most this density are skipped.
    pub least_density: f64,
    /// A ray ends when its transmittance, as a vector of the channels, is shorter than this.
    pub least_transmittance: f64,
    /// What becomes of the transmittance that an ended ray has left.
    #[serde(default = "kept")]
    pub leftover: Leftover,
    /// Where given, rays that meet the domain far away have other steps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distance_levels: Option<DistanceLevels>,
    /// Whether a ray's jitter counts twice, so that its first sample lies up to two steps in the domain (defect TK-3).
    #[serde(default, skip_serializing_if = "is_off")]
    pub doubled_start: bool,
}

fn is_off(switch: &bool) -> bool {
    !*switch
}

fn equal() -> f64 {
    1.0
}

fn is_equal(growth: &f64) -> bool {
    *growth == 1.0
}

fn kept() -> Leftover {
    Leftover::Kept
}

choice! {
    "kebab-case",
    /// What becomes of the transmittance that a ray has left when it ends early, below a least one m per channel.
    pub enum Leftover {
        /// It stays: the background shines through.
        Kept,
        /// It counts as 0, so that opacity jumps by m (defect BE-9 of `best`).
        Dropped,
        /// Every transmittance T becomes (T - m) / (1 - m), at least 0 (defect TK-12 of `takram`).
        Rescaled,
    }
}

impl RealTimeSettings {
    /// As published systems have it: until the transmittance of all channels falls to 0.01.
    pub fn until_one_percent(steps: f64, integration: Integration) -> Self {
        Self {
            steps: steps as u32,
            growth: 1.0,
            integration,
            exit_fade: false,
            least_density: 0.0,
            least_transmittance: 0.01 * 3.0_f64.sqrt(),
            leftover: Leftover::Kept,
            distance_levels: None,
            doubled_start: false,
        }
    }

    /// The number by which the length of a ray is divided that meets the domain so far away.
    pub(super) fn steps_of(&self, start: f64) -> f64 {
        self.distance_levels.map_or(f64::from(self.steps), |levels| levels.steps_of(self.steps, start))
    }

    /// The most steps of a ray.
    pub(super) fn most_steps(&self) -> u32 {
        self.distance_levels.map_or(self.steps, |levels| levels.most_steps(self.steps))
    }

    /// Part of a step before a ray's first sample.
    fn start_of(&self, jitter: f64) -> f64 {
        if self.doubled_start { 2.0 * jitter } else { jitter }
    }

    /// Transmittance of an ended ray, as it counts.
    fn ended(&self, transmittance: [f64; 3]) -> [f64; 3] {
        let least = self.least_transmittance / 3.0_f64.sqrt();
        match self.leftover {
            Leftover::Kept => transmittance,
            Leftover::Dropped if DVec3::from(transmittance).length() < self.least_transmittance => [0.0; 3],
            Leftover::Dropped => transmittance,
            // What is no number stays to be seen.
            Leftover::Rescaled => transmittance.mapped(|channel| {
                let scaled = (channel - least) / (1.0 - least);
                if scaled < 0.0 { 0.0 } else { scaled }
            }),
        }
    }
}

/// What is marched through: a density in its domain, with what it does to light.
pub struct Marched<'a> {
    /// The domain in the scene.
    pub container: &'a Container,
    /// The density in its frame.
    pub density: &'a Density,
    /// Extinction per unit of density and of length, per channel.
    pub extinction: [f64; 3],
    /// Averages of the density, for light that reads them.
    pub averages: Option<&'a Averages>,
    /// Shadow maps of the suns, for light that reads them.
    pub maps: &'a [ShadowMap],
    /// How it is lit.
    pub light: &'a LightModel,
    /// Further terms of the light.
    pub terms: &'a [Arc<dyn LightTerm>],
    /// Light that was found beforehand, where there is some.
    pub light_volume: Option<ReadVolume<'a>>,
    /// Air between the eye and it, where there is some.
    pub air: Option<&'a Air>,
}

/// A ray to be marched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RealTimeRay {
    /// Start in the density's frame.
    pub origin: DVec3,
    /// Displacement there per unit of length.
    pub way: DVec3,
    /// Unit direction in the world.
    pub direction: DVec3,
    /// Distance along the ray beyond which something opaque hides the cloud; infinite where nothing does.
    pub farthest: f64,
    /// Part of a step before the first sample, 0 to 1; with defect TK-3 half of it.
    pub jitter: f64,
}

/// What a ray came to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RealTimePixel {
    /// Radiance that reaches the camera.
    pub radiance: [f64; 3],
    /// Share of the background that reaches it.
    pub transmittance: [f64; 3],
    /// Samples at which the density was asked for.
    pub samples: u32,
    /// Those of them that were dense enough to count.
    pub dense: u32,
    /// Distance from the ray's start, in units of length, at which the medium takes light away: the mean of T (1 - exp(-e s)) over samples and
    /// channels. None where it takes none, and from an adapter, which does not return it.
    pub distance: Option<f64>,
}

impl RealTimePixel {
    /// Of a ray that meets nothing.
    pub(crate) const NOTHING: Self =
        Self { radiance: [0.0; 3], transmittance: [1.0; 3], samples: 0, dense: 0, distance: None };
}

/// The parts of a ray that lie in the domain.
#[derive(Debug, Clone, PartialEq)]
pub struct Inside {
    /// Where the first part begins: where the ray enters, or its start.
    pub origin: DVec3,
    /// Displacement per unit of length.
    pub way: DVec3,
    /// Unit direction in the world.
    pub direction: DVec3,
    /// Length of all parts; 0 where the ray misses or crosses less than a thousandth of a unit.
    pub length: f64,
    /// The parts; their distances count from `origin`.
    pub parts: Parts,
    /// Distance from `origin` beyond which something opaque hides the cloud.
    pub farthest: f64,
}

impl Inside {
    /// The first and the last of so many steps whose samples may lie in a box, with one more on either side; where it is crossed several
    /// times, all.
    fn steps_within(&self, region: &Region, ladder: &Ladder, begun_by: f64) -> [u32; 2] {
        if !self.parts.gaps.is_empty() {
            return [0, u32::MAX];
        }
        let Some((enter, leave)) = region.segment(self.origin, self.way) else { return [0, 0] };
        // A sample lies within its step, or with defect TK-3 within the next.
        let begun = |distance: f64| ladder.number(distance / self.length);
        match ladder.growth == 0.0 {
            true => [(begun(enter) - begun_by).floor() - 1.0, (begun(leave) - begun_by).ceil() + 1.0]
                .map(|number| number as u32),
            false => [begun(enter).floor() - 2.0, begun(leave).ceil() + 2.0].mapped(|number| number as u32),
        }
    }
}

impl Container {
    /// A ray of the world: a direction of any length but 0, `farthest` in metres.
    pub fn ray(&self, origin: DVec3, direction: DVec3, farthest: f64, jitter: f64) -> RealTimeRay {
        let direction = unit(direction).unwrap_or(DVec3::ZERO);
        RealTimeRay {
            origin: self.to_local.transform_point3(origin),
            way: self.to_local.transform_vector3(direction * self.unit),
            direction,
            farthest: farthest / self.unit,
            jitter,
        }
    }

    /// Displacement in the density's frame per unit of length along a direction of the world, of any length but 0; NaN for 0, so that
    /// it is seen.
    pub fn way(&self, direction: DVec3) -> DVec3 {
        self.to_local.transform_vector3(unit(direction).unwrap_or(DVec3::NAN) * self.unit)
    }
}

impl RealTimeRay {
    /// The parts of the ray in a domain, in f64 for both backends: a start far away costs no accuracy. A ray without a direction
    /// misses.
    pub fn inside(&self, outline: &Outline) -> Inside {
        let mut found = if self.way == DVec3::ZERO || !self.way.is_finite() {
            Parts::default()
        } else {
            outline.parts(self.origin, self.way)
        };
        // A domain without end is cut where the view ends: its steps would be as long as it is.
        if outline.is_endless() {
            found.end_at(self.farthest - found.start);
        }
        let length = found.length;
        let is_missed = length.is_nan() || length < SHORTEST;
        Inside {
            origin: if is_missed { self.origin } else { self.origin + self.way * found.start },
            way: self.way,
            direction: self.direction,
            length: if is_missed { 0.0 } else { length },
            farthest: self.farthest - if is_missed { 0.0 } else { found.start },
            parts: found,
        }
    }
}

/// Where the steps of a ray begin, as parts of its length.
#[derive(Debug, Clone, Copy)]
struct Ladder {
    /// By which the length is divided; the whole steps are done.
    steps: f64,
    /// Logarithm of what a step has over the one before; 0: equal steps.
    growth: f64,
}

impl Ladder {
    /// Begin of a step.
    fn begin(&self, number: f64) -> f64 {
        match self.growth == 0.0 {
            true => number / self.steps,
            false => (number * self.growth).exp_m1() / (self.steps * self.growth).exp_m1(),
        }
    }

    /// The number of the step, and part of it, in which a part of the length ends.
    fn number(&self, part: f64) -> f64 {
        match self.growth == 0.0 {
            true => part * self.steps,
            false => (part * (self.steps * self.growth).exp_m1()).max(-1.0).ln_1p() / self.growth,
        }
    }
}

/// A sample of a ray.
struct Sample {
    /// The ray's, among those that are on their way.
    index: usize,
    /// Of the step.
    number: u32,
    place: DVec3,
    /// Length of the step that it stands for.
    step: f64,
    /// Length of the ray behind it.
    left: f64,
    /// From where the ray enters.
    distance: f64,
    density: f64,
    /// What of its light arrives at the begin of the ray.
    before: [f64; 3],
}

/// A ray on its way.
struct Way {
    /// The ray's.
    index: usize,
    inside: Inside,
    jitter: f64,
    /// Part of a step before its first sample, and whether that is twice the jitter.
    start: f64,
    is_doubled: bool,
    /// What light comes along it, once a sample asks: most rays meet nothing.
    lit: OnceCell<LitWay>,
    /// Sums of what was taken away, and of it times its distance.
    taken: [f64; 2],
    steps: Ladder,
    /// The next of them.
    next: u32,
    /// After which one the ray leaves the part of the domain that may hold something.
    last: u32,
    /// It has no more samples, or what is behind is no longer seen.
    is_done: bool,
    /// What is behind is no longer seen.
    has_ended: bool,
    pixel: RealTimePixel,
}

/// What a light model knows of a ray's direction.
struct LitWay {
    /// Of the octaves of the light of each sun, phase functions included.
    weights: Vec<Vec<f64>>,
    /// To each sun.
    cosines: Vec<f64>,
    /// Of the coefficients of a light volume.
    of_volume: Vec<f32>,
}

impl LitWay {
    fn new(marched: &Marched<'_>, direction: DVec3) -> Self {
        let suns = &marched.light.suns;
        let cosines: Vec<f64> = suns.iter().map(|sun| direction.dot(sun.towards()).clamp(-1.0, 1.0)).collect();
        Self {
            weights: cosines.iter().map(|&cosine| marched.light.weights(cosine)).collect(),
            cosines,
            of_volume: marched.light_volume.as_ref().map_or_else(Vec::new, |volume| volume.weights(direction)),
        }
    }
}

/// A march whose light has what it reads; tasks share it.
pub(crate) struct ReadyMarch<'a> {
    marched: &'a Marched<'a>,
    settings: &'a RealTimeSettings,
    averages: [Option<Density>; 2],
}

/// What one task needs at a time to march rays.
pub(crate) struct Marcher<'a> {
    ready: &'a ReadyMarch<'a>,
    read: Read<'a>,
    ways: Vec<Way>,
    samples: Vec<Sample>,
    places: Vec<DVec3>,
}

impl ReadyMarch<'_> {
    /// For a task.
    pub fn marcher(&self) -> Result<Marcher<'_>> {
        let read = Read::new(self.marched, &self.averages)?;
        Ok(Marcher { ready: self, read, ways: Vec::new(), samples: Vec::new(), places: Vec::new() })
    }

    /// Rays of a task, where there are so many in all.
    pub fn rays_of_task(rays: usize) -> usize {
        (rays / (TASKS_OF_A_CORE * rayon::current_num_threads())).clamp(FEWEST_RAYS, MOST_RAYS)
    }
}

impl Marcher<'_> {
    /// Marches rays on this core; pixels in their order, whatever they held.
    pub fn march(&mut self, rays: &[RealTimeRay], pixels: &mut [RealTimePixel]) -> Result<()> {
        pixels.fill(RealTimePixel::NOTHING);
        for (rays, pixels) in rays.chunks(MOST_RAYS).zip(pixels.chunks_mut(MOST_RAYS)) {
            self.march_together(rays, pixels);
            self.ready.marched.air.map_or(Ok(()), |air| air.apply(self.ready.marched, rays, pixels))?;
        }
        Ok(())
    }

    /// Marches rays together, a few samples of each at a time, so that the density gets batches; `pixels` are those of rays that meet nothing.
    fn march_together(&mut self, rays: &[RealTimeRay], pixels: &mut [RealTimePixel]) {
        let Self { ready, read, ways, samples, places } = self;
        let ReadyMarch { marched, settings, .. } = *ready;
        let crossing = |(index, ray): (usize, &RealTimeRay)| {
            let inside = ray.inside(&marched.container.outline);
            (inside.length > 0.0).then(|| Way::new(index, inside, ray.jitter, marched, settings))
        };
        ways.clear();
        ways.extend(rays.iter().enumerate().filter_map(crossing));
        while ways.iter().any(|way| !way.is_done) {
            samples.clear();
            for (index, way) in ways.iter_mut().enumerate().filter(|(_, way)| !way.is_done) {
                way.ask(index, marched.density, samples);
            }
            places.clear();
            places.extend(samples.iter().map(|sample| sample.place));
            for (sample, density) in samples.iter_mut().zip(read.density.values_of_held(places.iter().copied())) {
                sample.density = density;
            }
            // Light is asked for where some of it still arrives, and only there.
            samples.retain_mut(|sample| ways[sample.index].pass(sample, settings, marched.extinction));
            if !samples.is_empty() {
                marched.light_up(settings, ways, samples, read);
            }
        }
        for way in ways.iter() {
            let [taken, distances] = way.taken;
            pixels[way.index] = RealTimePixel {
                transmittance: settings.ended(way.pixel.transmittance),
                distance: (taken > 0.0).then(|| way.inside.parts.start + distances / taken),
                ..way.pixel
            };
        }
    }
}

/// What is read while rays are marched: the density, averages around a place and along the way to a sun where the light asks for them.
struct Read<'a> {
    density: DensityEvaluator<'a>,
    around: Option<DensityEvaluator<'a>>,
    along: Option<DensityEvaluator<'a>>,
    ways_to_suns: Vec<DVec3>,
}

impl<'a> Read<'a> {
    fn new(marched: &Marched<'a>, [around, along]: &'a [Option<Density>; 2]) -> Result<Self> {
        let ways = marched.light.suns.iter().map(|sun| marched.container.way(DVec3::from(sun.direction)));
        Ok(Self {
            density: DensityEvaluator::new(marched.density)?,
            around: around.as_ref().map(DensityEvaluator::new).transpose()?,
            along: along.as_ref().map(DensityEvaluator::new).transpose()?,
            ways_to_suns: ways.collect(),
        })
    }
}

impl Marched<'_> {
    /// Refuses a light that reads averages or shadow maps which are not there.
    pub fn check(&self) -> Result<()> {
        let wanted = self.light.shadow.map.map_or(0, |map| map.cascades as usize) * self.light.suns.len();
        if self.light.shadow.map.is_some() && self.maps.len() != wanted {
            return Err(Error::new(
                "the march of an engine",
                format!("{} shadow maps of {} suns that have {wanted}", self.maps.len(), self.light.suns.len()),
                "a map of each, which the light reads",
                "Make them (march::shadow_map::ShadowMap::of), or leave them out of the light.",
            ));
        }
        let outline = &self.container.outline;
        if matches!(outline, Outline::Mesh(_))
            && (self.air.is_some_and(|air| air.rays.is_some()) || self.light.terms.ground.is_some())
        {
            return Err(Error::new(
                "the march of an engine",
                "rays of the march, or light from the ground, in a mesh",
                "a box or a slab: they ask for places outside of the domain",
                "Set march_ray_intensity or ground_steps to 0, or take a box.",
            ));
        }
        if self.light_volume.is_some() && self.air.is_some_and(|air| air.haze.is_some() || air.aerial.is_some()) {
            return Err(Error::new(
                "the march of an engine",
                "haze or aerial perspective beside a light volume, which has taken the light of the world",
                "either",
                "Set haze and aerial_perspective to 0, or leave the light volume out.",
            ));
        }
        if self.air.is_some() && matches!(outline, Outline::Shell { .. }) {
            return Err(Error::new(
                "the march of an engine",
                "air in the domain of a shell",
                "a slab or an object: air knows one direction that is up",
                "Leave haze, aerial perspective and rays of the march out, or take another domain.",
            ));
        }
        if self.air.is_some_and(|air| air.shafts.is_some()) && self.light.shadow.map.is_none() {
            return Err(Error::new(
                "the march of an engine",
                "shafts under a light without shadow maps",
                "a light with shadow maps, which shafts read",
                "Set shadow_map to a number of texels, or shafts to 0.",
            ));
        }
        if self.light_volume.is_some() && (self.light.terms.imitates_orders() || !self.terms.is_empty()) {
            return Err(Error::new(
                "the march of an engine",
                "a light model that imitates orders of scattering, or a system's own light, beside a light volume",
                "light model single: a light volume has all orders behind the first and the light of the world",
                "Take the light model single, or leave the light volume out.",
            ));
        }
        if let Some(volume) = &self.light_volume {
            volume.check(self.light)?;
        }
        if !self.light.terms.needs_coarse() || self.averages.is_some() {
            return Ok(());
        }
        Err(Error::new(
            "the march of an engine",
            "a density without averages",
            "averages, which the light terms body and coarse shadow read",
            "Make them (media::averages::Averages), or leave these terms out.",
        ))
    }

    /// Marches rays on all cores; pixels in the order of the rays. An error where the light reads averages that are not there.
    pub fn march(&self, settings: &RealTimeSettings, rays: &[RealTimeRay]) -> Result<Vec<RealTimePixel>> {
        let ready = self.ready(settings)?;
        let together = ReadyMarch::rays_of_task(rays.len());
        let mut pixels = vec![RealTimePixel::NOTHING; rays.len()];
        let tasks = rays.par_chunks(together).zip(pixels.par_chunks_mut(together));
        tasks.try_for_each_init(
            || None,
            |marcher, (rays, pixels)| {
                let marcher = match marcher {
                    Some(marcher) => marcher,
                    None => marcher.insert(ready.marcher()?),
                };
                marcher.march(rays, pixels)
            },
        )?;
        Ok(pixels)
    }

    /// A march that tasks of the caller do ray by ray. An error where the light reads averages that are not there.
    pub(crate) fn ready<'a>(&'a self, settings: &'a RealTimeSettings) -> Result<ReadyMarch<'a>> {
        self.check()?;
        Ok(ReadyMarch { marched: self, settings, averages: self.averages_read() })
    }

    /// Averages around a place and along the way to a sun, where the light reads them.
    fn averages_read(&self) -> [Option<Density>; 2] {
        let body = &self.light.terms.body;
        // Averages are 0 where the density is provably 0 only if their cells are: nothing is left out of them.
        let everywhere = |program: &Arc<_>| Density::filling(Arc::clone(program), self.density.bounds);
        [
            self.averages.filter(|_| body.strength > 0.0).map(|averages| everywhere(&averages.around)),
            self.averages.filter(|_| body.shadow).map(|averages| everywhere(&averages.along)),
        ]
    }

    /// Adds the light that samples send to the begins of their rays.
    fn light_up(&self, settings: &RealTimeSettings, ways: &mut [Way], samples: &[Sample], read: &mut Read<'_>) {
        let light = self.light;
        let outline = &self.container.outline;
        let mean_extinction = self.extinction.iter().sum::<f64>() / 3.0;
        let places: Vec<DVec3> = samples.iter().map(|sample| sample.place).collect();
        let jitters: Vec<f64> = samples.iter().map(|sample| ways[sample.index].jitter).collect();
        let depths: Vec<Vec<[f64; 3]>> = (0..light.suns.len())
            .map(|sun| {
                let cosines: Vec<f64> =
                    samples.iter().map(|sample| ways[sample.index].lit(self).cosines[sun]).collect();
                let to_sun = read.ways_to_suns[sun];
                let density = read.along.as_mut().unwrap_or(&mut read.density);
                self.shadow_depths(density, (sun, to_sun), &places, &cosines, &jitters)
            })
            .collect();
        let from_ground = light.terms.ground.map(|ground| self.ground_light(&mut read.density, &ground, &places));
        let surroundings = read.around.as_mut().map(|around| around.values(&places));
        for (order, sample) in samples.iter().enumerate() {
            let &Sample { index, place, step, left, density, before, .. } = sample;
            let fade = if settings.exit_fade { smooth(0.0, 2.0 * step, left) } else { 1.0 };
            let Way { lit, inside, pixel, .. } = &mut ways[index];
            let lit = lit.get_or_init(|| LitWay::new(self, inside.direction));
            let powder = light.terms.powder.factor(density * mean_extinction);
            let share = light.terms.powder.ambient;
            let body =
                surroundings.as_ref().map_or(1.0, |around| light.terms.body.factor(around[order] * mean_extinction));
            let height = outline.height(place);
            let sun_factor = fade * powder * body;
            let ambient_factor = fade * light.ambient_factor(height) * (1.0 + (powder - 1.0) * share);
            let ground_factor = fade * (1.0 + (powder - 1.0) * share);
            let boost = &light.terms.boost;
            let cosine = lit.cosines.first().copied().unwrap_or(0.0);
            let [boosted, added] = match boost.is_on() {
                true => boost.factors(density * mean_extinction, cosine),
                false => [1.0, 0.0],
            };
            let at_place = Lit { place, height, extinction: density * mean_extinction };
            let mut further = [0.0; 3];
            if let Some(volume) = &self.light_volume {
                let found = volume.volume.read(place, &lit.of_volume);
                (0..3).for_each(|channel| further[channel] += fade * found[channel]);
            }
            for term in self.terms {
                let found = term.source(&at_place);
                (0..3).for_each(|channel| further[channel] += fade * found[channel]);
            }
            for channel in 0..3 {
                let extinct = density * self.extinction[channel];
                let factor = match light.source {
                    SourceFactor::Density => density,
                    SourceFactor::Albedo(albedo) => albedo[channel] * extinct,
                };
                let mut from_suns = 0.0;
                for (number, (sun, weights)) in light.suns.iter().zip(&lit.weights).enumerate() {
                    let depth = depths[number][order][channel];
                    let mut scattered = light.terms.octaves.sum(weights, depth);
                    if light.terms.ray_powder {
                        scattered = ray_powder(scattered, depth, lit.cosines[number]);
                    }
                    from_suns += sun.irradiance[channel] * scattered * sun_factor;
                }
                let below = from_ground.as_ref().map_or(0.0, |found| found[order][channel]);
                let ambient = light.ambient[channel] * ambient_factor + below * ground_factor;
                let mut all = from_suns + ambient + further[channel];
                if boost.is_on() {
                    all = all * boosted + fade * light.ambient[channel] * added;
                }
                let source = factor * all;
                let weight = step_weight(settings.integration, extinct, step);
                pixel.radiance[channel] += before[channel] * source * weight;
            }
        }
    }

    /// Light from the ground at each place, before powder.
    fn ground_light(&self, read: &mut DensityEvaluator<'_>, ground: &Ground, places: &[DVec3]) -> Vec<[f64; 3]> {
        let outline = &self.container.outline;
        let down = self.container.way(DVec3::NEG_Z);
        let (mut owners, mut asked) = (Vec::new(), Vec::new());
        for (index, &place) in places.iter().enumerate() {
            let (mut begin, mut step) = (0.0, ground.first);
            for _ in 0..ground.steps {
                let at = place + down * (begin + 0.5 * step);
                if outline.holds(at) {
                    owners.push((index, step));
                    asked.push(at);
                }
                begin += step;
                step *= 2.0;
            }
        }
        let mut sums = vec![0.0; places.len()];
        for ((owner, step), found) in owners.into_iter().zip(read.values(&asked)) {
            sums[owner] += found * step;
        }
        let radiance = self.light.ground_radiance(ground);
        let of = |(sum, &place): (f64, &DVec3)| match outline.height(place) > ground.highest {
            true => [0.0; 3],
            false => std::array::from_fn(|channel| radiance[channel] * transmittance(self.extinction[channel] * sum)),
        };
        sums.into_iter().zip(places).map(of).collect()
    }

    /// The shadow maps of a sun, where the light reads them.
    pub(crate) fn maps_of(&self, sun: usize) -> &[ShadowMap] {
        let each = self.light.shadow.map.map_or(0, |map| map.cascades as usize);
        self.maps.get(sun * each..(sun + 1) * each).unwrap_or_default()
    }

    /// Density times length towards the suns, where a light volume has it.
    pub(crate) fn columns(&self) -> Option<&Columns> {
        self.light_volume.as_ref().and_then(|read| read.volume.columns())
    }

    /// Optical depth towards a sun at each place, per channel, as it counts for the octaves. The sun's number and way;
    /// `read` evaluates the density, or its averages; `cosines` are those of the view rays to the sun, `jitters` those of the view rays.
    fn shadow_depths(
        &self,
        read: &mut DensityEvaluator<'_>,
        (sun, to_sun): (usize, DVec3),
        places: &[DVec3],
        cosines: &[f64],
        jitters: &[f64],
    ) -> Vec<[f64; 3]> {
        let maps = self.maps_of(sun);
        let light = self.light;
        let outline = &self.container.outline;
        let shadow = &light.shadow;
        let steps = shadow.parts();
        let scale = match light.shadow.extinction {
            ShadowExtinction::Density => [1.0; 3],
            ShadowExtinction::View => self.extinction,
            ShadowExtinction::Of(extinction) => [extinction; 3],
        };
        let octaves = &light.terms.octaves;
        let whole = |column: &dyn Fn(DVec3) -> f64| -> Vec<[f64; 3]> {
            let depths = places.iter().zip(cosines).map(|(&place, &cosine)| {
                let depth = column(place) * shadow.angle_factor(cosine);
                scale.mapped(|scale| octaves.compressed(scale * depth))
            });
            depths.collect()
        };
        if let Some(columns) = self.columns() {
            return whole(&|place| columns.read(sun, place));
        }
        if let Some(map) = maps.first().filter(|map| map.layers > 0) {
            return whole(&|place| map.read(place, 0.0));
        }
        let mut lengths = Vec::with_capacity(places.len());
        let mut owners = Vec::new();
        let mut asked = Vec::new();
        for (index, &place) in places.iter().enumerate() {
            // Asked for where its length counts, and of a mesh, whose parts say what is inside.
            let is_mesh = matches!(outline, Outline::Mesh(_));
            let parts = match light.shadow.length {
                ShadowLength::Fixed(_) if !is_mesh => Parts::default(),
                _ => outline.parts_to_light(place, to_sun),
            };
            let length = shadow.length.of(parts.length);
            lengths.push(length);
            for &[begin, step] in &steps {
                let passed = length * (begin + step * shadow.sample.part());
                let distance = match shadow.length {
                    ShadowLength::Fixed(_) => passed,
                    ShadowLength::ToExit | ShadowLength::ToExitAtMost(_) => parts.start + parts.distance(passed),
                };
                let at = place + to_sun * distance;
                let is_inside = if is_mesh { parts.holds(distance - parts.start) } else { outline.holds(at) };
                if is_inside {
                    owners.push((index, step));
                    asked.push(at);
                }
            }
        }
        let mut sums = vec![0.0; places.len()];
        for ((owner, step), found) in owners.into_iter().zip(read.values(&asked)) {
            sums[owner] += found * step;
        }
        let map_from = shadow.map_from();
        let depths = sums.iter().zip(lengths).zip(places.iter().zip(cosines)).enumerate().map(
            |(index, ((sum, length), (&place, &cosine)))| {
                let beyond = match maps {
                    [] => 0.0,
                    [map] => map.read(place, length * map_from),
                    several => ShadowMap::chosen(several, place, jitters[index])
                        .map_or(0.0, |map| map.read_below(place, length * map_from)),
                };
                sum * length * shadow.angle_factor(cosine) + beyond
            },
        );
        depths.map(|depth| scale.map(|scale| octaves.compressed(scale * depth))).collect()
    }
}

impl Way {
    fn new(index: usize, inside: Inside, jitter: f64, marched: &Marched<'_>, settings: &RealTimeSettings) -> Self {
        let steps = Ladder { steps: settings.steps_of(inside.parts.start), growth: settings.growth.ln() };
        let start = settings.start_of(jitter);
        let [next, last] = inside.steps_within(&marched.density.occupied, &steps, start);
        let mut way = Self {
            index,
            jitter,
            start,
            is_doubled: settings.doubled_start,
            lit: OnceCell::new(),
            is_done: false,
            has_ended: false,
            steps,
            next,
            last,
            inside,
            taken: [0.0; 2],
            pixel: RealTimePixel::NOTHING,
        };
        // Something opaque stands before them.
        if next > 0 && way.reach(next - 1).is_none() {
            way.next = 0;
        }
        way
    }

    fn lit(&self, marched: &Marched<'_>) -> &LitWay {
        self.lit.get_or_init(|| LitWay::new(marched, self.inside.direction))
    }

    /// Adds the next samples that may hold something; where the ray has no more, it is done.
    fn ask(&mut self, index: usize, density: &Density, samples: &mut Vec<Sample>) {
        let mut asked = 0;
        while asked < SAMPLES_TOGETHER {
            let number = self.next;
            let whole = self.steps.steps as u32;
            if number > self.last && number < whole && self.reach(whole - 1).is_some() {
                // Nothing is left on the way, whose end is in the domain.
                self.next = whole;
                continue;
            }
            let Some([left, distance, step]) = self.reach(number) else {
                self.is_done = true;
                break;
            };
            self.next += 1;
            let place = self.inside.origin + self.inside.way * distance;
            if number <= self.last && density.may_hold(place) {
                samples.push(Sample { index, number, place, step, left, distance, density: 0.0, before: [0.0; 3] });
                asked += 1;
            }
        }
        // So many unless an earlier one ends the ray.
        self.pixel.samples = self.next;
    }

    /// Length of the ray behind the sample of a step, its distance from where the ray enters, and the step's length; None of a step that there
    /// is not.
    fn reach(&self, number: u32) -> Option<[f64; 3]> {
        let Ladder { steps, growth } = self.steps;
        let [passed, step] = match growth == 0.0 {
            true => {
                let step = self.inside.length / steps;
                [(f64::from(number) + self.start) * step, step]
            }
            false => {
                let [begin, end] =
                    [0.0, 1.0].mapped(|more| self.inside.length * self.steps.begin(f64::from(number) + more));
                [begin + self.start * (end - begin), end - begin]
            }
        };
        let left = self.inside.length - passed;
        let distance = self.inside.parts.distance(passed);
        // By number, and without one at the very end: at a start of a whole step the last lies on the face where the ray leaves, in the domain or not by a
        // rounding, and a profile may rise there without bound.
        let is_behind = if self.is_doubled { f64::from(number) + self.start >= steps } else { left < 0.0 };
        let is_beyond = distance > self.inside.farthest || is_behind || number >= steps as u32;
        (!is_beyond).then_some([left, distance, step])
    }

    /// Takes away what a sample keeps of the light from behind it; whether its own light counts.
    fn pass(&mut self, sample: &mut Sample, settings: &RealTimeSettings, extinction: [f64; 3]) -> bool {
        let Sample { number, density, step, distance, .. } = *sample;
        // What is no number counts, so that it is seen in the picture.
        let is_dense = density > settings.least_density || density.is_nan();
        if self.has_ended || !is_dense {
            return false;
        }
        self.pixel.dense += 1;
        sample.before = self.pixel.transmittance;
        for (left, extinction) in self.pixel.transmittance.iter_mut().zip(extinction) {
            let through = transmittance(density * extinction * step);
            let taken = *left * (1.0 - through);
            self.taken[0] += taken;
            self.taken[1] += taken * distance;
            *left *= through;
        }
        self.has_ended = DVec3::from(self.pixel.transmittance).length() < settings.least_transmittance;
        if self.has_ended {
            self.is_done = true;
            self.pixel.samples = number + 1;
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engines::domain::Domain;
    use glam::DMat4;

    fn container() -> Container {
        let region = Region { low: DVec3::splat(-0.5), high: DVec3::splat(0.5) };
        Container { domain: Domain::Object, to_local: DMat4::IDENTITY, outline: Outline::Box(region), unit: 1.0 }
    }

    #[test]
    fn steps_that_grow_fill_the_length_and_are_found_again() {
        for growth in [1.0, 1.0 + 1e-12, 1.001, 1.05, 1.3] {
            let ladder = Ladder { steps: 37.0, growth: f64::ln(growth) };
            assert!(ladder.begin(0.0) == 0.0 && (ladder.begin(37.0) - 1.0).abs() < 1e-15, "{growth}");
            for number in 1..37 {
                let [before, begin, end] = [-1.0, 0.0, 1.0].map(|more| ladder.begin(f64::from(number) + more));
                // 1 + 1e-12 is known to 2^-53 of 1, and the logarithm to 1e-4 of itself: which moves all alike.
                let ratio = (end - begin) / (begin - before);
                assert!((ratio - growth).abs() < 1e-9, "{growth}, step {number}: {ratio}");
                assert!((ladder.number(begin) - f64::from(number)).abs() < 1e-9, "{growth}, step {number}");
            }
        }
    }

    #[test]
    fn rays_of_any_length_and_start_cross_alike() {
        let container = container();
        let direction = DVec3::new(0.6, -0.3, 0.7).normalize();
        let inside =
            |origin: DVec3, direction: DVec3| container.ray(origin, direction, 1e7, 0.5).inside(&container.outline);
        let near = inside(-direction, direction);
        assert!(near.length > 0.5 && (near.direction.length() - 1.0).abs() < 1e-15);
        for scale in [1e-200, 1e-6, 3.0, 1e200] {
            let found = inside(-direction, direction * scale);
            assert!(
                (found.length - near.length).abs() < 1e-12 && found.origin.distance(near.origin) < 1e-12,
                "{scale}"
            );
        }
        // 1e6 sides away f64 holds places to 1e-10.
        let far = inside(-direction * 1e6, direction);
        assert!((far.length - near.length).abs() < 1e-9 && far.origin.distance(near.origin) < 1e-9);
        assert!((far.farthest - (1e7 - 1e6)).abs() < 1.0);
    }

    #[test]
    fn a_domain_without_end_is_cut_where_the_view_ends() {
        let slab = Domain::Slab { bottom: -1.0, top: 1.0 };
        let scene = crate::scene::Scene::load(std::path::Path::new("parity/scenes/homogeneous-cube.scene.json"));
        let container = slab.place(&scene.expect("the committed scene loads")).expect("a slab");
        let level = container.ray(DVec3::ZERO, DVec3::X, 100.0, 0.5).inside(&container.outline);
        assert!(level.length == 100.0 && level.parts.gaps.is_empty());
        let shell = Outline::Shell { inner: 1.0, outer: 2.0 };
        let ray = |farthest: f64| container.ray(DVec3::new(-5.0, 0.0, 0.0), DVec3::X, farthest, 0.5).inside(&shell);
        assert_eq!([1.0, 3.5, 5.0, 6.5, 9.0].map(|farthest| ray(farthest).length), [0.0, 0.5, 1.0, 1.5, 2.0]);
    }

    #[test]
    fn what_misses_grazes_or_goes_nowhere_has_no_length() {
        let container = container();
        let none = |origin: [f64; 3], direction: [f64; 3]| {
            let (origin, direction) = (DVec3::from(origin), DVec3::from(direction));
            let found = container.ray(origin, direction, 1.0, 0.5).inside(&container.outline);
            assert_eq!(found.length, 0.0, "{origin} {direction}");
        };
        none([3.0, 3.0, 3.0], [0.0, 1.0, 0.0]);
        none([0.0; 3], [0.0; 3]);
        none([0.0; 3], [f64::NAN, 0.0, 1.0]);
        none([0.5, 0.0, 0.0], [1.0, 0.0, 0.0]);
        none([0.4999, 0.5001, 0.0], [1.0, -1.0, 0.0]);
        assert_eq!(unit(DVec3::ZERO), None);
    }
}
