//! One path as a state machine, and thousands of them side by side.
//!
//! A path is a row of rays: the camera ray, then per scattering event a shadow ray to one light and the ray that
//! the phase function sampled. A ray walks through the majorants to its next tentative collision; then the
//! density there is needed. So paths wait for each other: all walk, one batch of densities is
//! evaluated, all handle their collision. The state of a path is small and fixed, nothing recurses.
//!
//! With extinction e and control c per channel (c the control of the channel with the
//! most, times the channel's share), tentative collisions at rate r. Both come from the leaf where the ray is (see
//! `majorant::Rates`): c and r > 0 may be any numbers for the sake of the mean; few collisions and little noise come of a c near e and an r
//! not much above what is left. Where e > r a weight changes its sign:
//!
//! * *Camera ray*: an expected-value estimator (Novak et al. 2014), which finds the event if a ray meets any: there are *candidates* of weight T s / r
//!   with s the scattering, one of which is kept with probability in proportion to its weight, and goes on with the sum of all. The number
//!   that chooses goes through them from the nearest to the farthest, so that it stratifies depth over the samples of a pixel. Candidates are
//!   of one of two kinds. Where much of the medium is seen they are the tentative collisions, with T = prod(1 - e/r): their weights add up to 1 - T,
//!   without noise where nothing is seen through the medium. Where little is seen (`opacity`) that sum would be all noise, for a ray has a collision or two;
//!   there candidates lie at equal distances of the integral of a rate of their own, of one offset that is stratified, and T is that of
//!   the collisions, which are independent of them. Each is uniform in its stretch, so that their sum is the integral of T s whatever T is.
//! * *Transmittance* of camera, shadow and last rays: residual ratio tracking (Novak et al. 2014),
//!   exp(-integral of c) prod(1 - (e - c)/r). Without noise where e is constant.
//! * *Rays between scattering events*: tracking with null collisions. A collision scatters or is null with
//!   probabilities in proportion to the sums over channels of |b s| and |b (r - e)|, b the path's weight;
//!   absorption only lowers the weight. These are the probabilities of the mixture of
//!   one technique per channel, conditional on the path so far, so that the weights are those of
//!   multiple importance sampling over channels with the path's densities in the balance heuristic (Miller,
//!   Georgiev and Jarosz 2019; Wilkie et al. 2014): where e <= r, the sum of b over channels never grows.
//! * *Emission* j that is the same everywhere, along a flight of length l: b j l, or b j (1 - exp(-c l))/c with a
//!   control. Emission that varies: b j / r at every tentative collision (of a camera ray with spaced candidates, at those), before anything else; a
//!   part of the majorant, which r then is, in proportion to the bound of j makes r > 0 wherever j is not 0 (Novak et al. 2018, section 5).
//! * *Lights*: next-event estimation towards one light per event, chosen in proportion to what it roughly delivers; if it has an
//!   extent, weighted against hits of the sampled ray on that light (balance heuristic; Veach 1997). A picture around
//!   the scene is chosen like a light; rays that leave the medium see it whatever was chosen, and the chance that
//!   it was counts in the weights of both.
//!
//! Where phase functions vary, or several mix in proportions that do, a path waits once more at a scattering event: the batch evaluates
//! the lobes there, and they are used up before the path goes on. So a path carries none, however many there are.

use crate::base::arrays::{Mapped, each};
use crate::base::error::{Error, Result};
use crate::integrators::path::opacity::Thin;
use crate::integrators::path::volume::{CoefficientEvaluator, Lobes, Part, Volume};
use crate::media::majorant::{Majorants, Rates, Residual, Walk, not_finite};
use crate::media::mesh::PlacedMesh;
use crate::media::objects::PhaseMixture;
use crate::media::phase::{PhaseFunction, turned};
use crate::media::transfer::{mean_transmittance, transmittance};
use crate::nodes::closure::Coefficients;
use crate::view::camera::{Camera, Ray};
use crate::view::environment::Environment;
use crate::view::film::Warp;
use crate::view::sampled_lights::SampledLight;
use crate::view::sampler::{Redraw, Sampler};
use glam::{DVec2, DVec3};

/// Paths side by side on a thread: batches of the density program are full.
const PATHS: usize = 1024;

/// Below this transmittance a ray goes on with half the chance and twice the weight.
pub(super) const FAINT: f64 = 0.1;

/// Scattering events before roulette may end a path.
pub(super) const EVENTS_BEFORE_ROULETTE: u32 = 4;

/// What all paths share.
pub(crate) struct Tracer {
    pub(crate) camera: Camera,
    pub(crate) size: [u32; 2],
    pub(crate) filter: Warp,
    pub(crate) transparent: bool,
    pub(crate) exposure: f64,
    pub(crate) volume: Volume,
    pub(crate) lights: Vec<SampledLight>,
    pub(crate) world: World,
    /// Most scattering events of a path.
    pub(crate) events: u32,
    /// What is drawn again.
    pub(crate) redraw: Redraw,
    /// The pixels in which little of the medium is seen.
    pub(crate) thin: Thin,
}

/// What lies around the scene.
pub(crate) enum World {
    /// Radiance, the same from everywhere.
    Constant([f64; 3]),
    /// A picture that is not black.
    Picture(Environment),
}

/// How light scatters at an event.
enum Scattering<'a> {
    Single(&'a PhaseFunction),
    Mixture(&'a PhaseMixture),
}

/// What next-event estimation turns to.
enum Source<'a> {
    Light(&'a SampledLight),
    Picture(&'a Environment),
    Nothing,
}

/// A source, with the chance of its choice.
struct Choice<'a> {
    source: Source<'a>,
    probability: f64,
    /// The chance that the picture around the scene is chosen.
    picture: f64,
}

/// What a path does after the end of a ray.
enum Then {
    Travel,
    /// Waits at an event for its lobes.
    Wait,
    End,
}

/// What paths did.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Counters {
    /// Camera rays.
    pub paths: u64,
    /// Tentative collisions, each an evaluation of the density.
    pub collisions: u64,
    /// Of these, how many are null: the sum of 1 - extinction / majorant.
    pub null_collisions: f64,
    /// Scattering events.
    pub scatterings: u64,
    /// Densities above their majorant. Any is an error, so this is 0 in every picture.
    pub violations: u64,
}

impl Counters {
    /// Adds what others counted.
    pub fn add(&mut self, other: &Self) {
        self.paths += other.paths;
        self.collisions += other.collisions;
        self.null_collisions += other.null_collisions;
        self.scatterings += other.scatterings;
        self.violations += other.violations;
    }
}

/// A range of camera rays: numbers count the samples of the first pixel, then those of the second.
#[derive(Debug, Clone)]
pub(crate) struct Work {
    pub(crate) items: std::ops::Range<u64>,
    pub(crate) first_sample: u32,
    pub(crate) samples: u32,
    pub(crate) seed: u32,
}

/// Sums over samples of radiance and opacity, for consecutive pixels.
pub(crate) struct Sums {
    pub(crate) first_pixel: usize,
    pub(crate) pixels: Vec<[f64; 4]>,
    pub(crate) counters: Counters,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Camera,
    /// A camera ray whose transmittance alone is wanted.
    Look,
    /// Towards a light.
    Shadow,
    /// Between two scattering events.
    Bounce,
    /// After the last event that is allowed.
    Last,
    /// At a scattering event whose lobes have to be evaluated.
    Event,
    Finished,
}

/// Where a camera ray may scatter first.
#[derive(Clone, Copy)]
struct Candidate {
    distance: f64,
    /// What the path would go on with, were this the only one.
    weight: [f64; 3],
    /// Its chance, and that of it or one before it, in the same unknown unit.
    share: f64,
    up_to: f64,
}

/// Where the ray of a path lies in meshes.
#[derive(Default)]
struct InMeshes {
    /// Its parts, and how many of a single mesh's the walk has begun.
    parts: Vec<Part>,
    begun: usize,
    /// Meshes that hold the last scattering event, by the numbers of their objects.
    around: Vec<usize>,
}

/// The state of a path.
pub(crate) struct Path {
    pub(super) pixel: u32,
    pub(super) sampler: Sampler,
    stage: Stage,
    /// The ray, in world space.
    pub(crate) origin: DVec3,
    pub(crate) direction: DVec3,
    pub(crate) walk: Walk,
    /// Where the ray lies in meshes; none where no object fills one.
    in_meshes: Option<Box<InMeshes>>,
    /// What arrives at the end of the ray counts this much, but for the ray's own weight.
    carried: [f64; 3],
    /// The ray's own weight: 1 at its start.
    weight: [f64; 3],
    /// Optical depth, of the channel with the most, of the control along the flights that the weight does not know yet.
    control_depth: f64,
    /// Camera ray with candidates at its collisions: the weight without control.
    analog: [f64; 3],
    /// Camera ray: how many candidates are spaced evenly per event that is expected at most; 0 where they are the tentative collisions.
    candidates_per_event: f64,
    /// Integrals of the rates up to the next tentative collision and candidate, and whether the path is at a candidate.
    until_collision: f64,
    until_candidate: f64,
    at_candidate: bool,
    /// The tentative collision: rate and control there, the leaf's majorant, random numbers.
    rate: f64,
    control: f64,
    majorant: f64,
    numbers: [f64; 4],
    /// Camera ray: where it may scatter first, nearest first, and the number in [0, 1) that chooses among them.
    candidates: Vec<Candidate>,
    choice: f64,
    /// Where the next event is, along the ray.
    kept_distance: f64,
    /// Whether a ray between events ended in one, at the kept distance.
    scattered: bool,
    /// The last scattering event.
    vertex: DVec3,
    throughput: [f64; 3],
    next: DVec3,
    /// Weight of what the sampled ray sees of a picture around the scene.
    escape: f64,
    scatterings: u32,
    /// Largest throughput after the first event.
    reference: f64,
    /// Where the sampled ray hits the light of this event (NaN: nowhere), and what that adds.
    hit_distance: f64,
    hit: [f64; 3],
    pub(super) radiance: [f64; 3],
    pub(super) opacity: f64,
}

impl Tracer {
    /// Traces a range of paths on the calling thread. The result depends on nothing else.
    pub(crate) fn trace(&self, work: &Work) -> Result<Sums> {
        let per_pixel = u64::from(work.samples);
        let first_pixel = (work.items.start / per_pixel) as usize;
        let end_pixel = work.items.end.div_ceil(per_pixel) as usize;
        let mut sums =
            Sums { first_pixel, pixels: vec![[0.0; 4]; end_pixel - first_pixel], counters: Counters::default() };
        let items = work.items.clone().map(|item| {
            let sample = work.first_sample + (item % per_pixel) as u32;
            self.begin((item / per_pixel) as u32, sample, work.seed)
        });
        let counters = self.trace_paths(items, &mut |path| sums.add(path))?;
        sums.counters = Counters { paths: work.items.end - work.items.start, ..counters };
        Ok(sums)
    }

    /// Traces paths on the calling thread, and hands each over when it has ended, in no order.
    pub(super) fn trace_paths(
        &self,
        mut items: impl Iterator<Item = Path>,
        ended: &mut impl FnMut(&Path),
    ) -> Result<Counters> {
        let mut counters = Counters::default();
        let mut evaluator = self.volume.evaluator()?;
        let mut paths: Vec<Path> = Vec::with_capacity(PATHS);
        let mut positions = Vec::with_capacity(PATHS);
        let mut coefficients = Vec::with_capacity(PATHS);
        loop {
            // Finished paths make room for new ones.
            positions.clear();
            let mut index = 0;
            loop {
                if index == paths.len() {
                    if paths.len() == PATHS {
                        break;
                    }
                    let Some(path) = items.next() else { break };
                    paths.push(path);
                }
                let path = &mut paths[index];
                if self.advance(path, &mut counters) {
                    positions.push(self.position(path));
                    index += 1;
                    continue;
                }
                ended(path);
                match items.next() {
                    Some(mut next) => {
                        next.candidates = std::mem::take(&mut path.candidates);
                        next.candidates.clear();
                        *path = next;
                    }
                    None => drop(paths.swap_remove(index)),
                }
            }
            if paths.is_empty() {
                return Ok(counters);
            }
            let inside = |lane: usize, object: usize| paths[lane].is_in(object);
            evaluator.evaluate(&positions, &inside, &mut coefficients)?;
            self.collide_all(&evaluator, &mut paths, &positions, &coefficients, &mut counters)?;
        }
    }

    fn collide_all(
        &self,
        evaluator: &CoefficientEvaluator<'_>,
        paths: &mut [Path],
        positions: &[DVec3],
        coefficients: &[Coefficients<f64>],
        counters: &mut Counters,
    ) -> Result<()> {
        for (lane, ((path, found), position)) in paths.iter_mut().zip(coefficients).zip(positions).enumerate() {
            if path.stage == Stage::Event {
                let mixture = evaluator.mixture(lane)?;
                if !self.scatter(path, &Scattering::Mixture(&mixture), counters) {
                    path.stage = Stage::Finished;
                }
                continue;
            }
            counters.collisions += 1;
            let extinction = found
                .extinction
                .iter()
                .copied()
                .fold(0.0, |most: f64, value| if value.is_nan() { value } else { most.max(value) });
            // NaN is not below the majorant.
            if extinction.is_nan() || extinction > path.majorant {
                let is_capped = self.volume.majorants.as_ref().is_some_and(|tree| tree.is_capped(&path.walk));
                if !(is_capped && extinction.is_finite()) {
                    return Err(violation(position.as_vec3().to_array(), extinction, path.majorant));
                }
                // Where no bound is proven, extinction beyond the cap counts as the cap.
                let share = path.majorant / extinction;
                let limited = Coefficients {
                    scattering: found.scattering.mapped(|value| value * share),
                    extinction: found.extinction.mapped(|value| value * share),
                    emission: found.emission,
                };
                self.collide(path, &limited);
                continue;
            }
            counters.null_collisions += 1.0 - extinction / path.majorant;
            self.collide(path, found);
        }
        Ok(())
    }

    /// A path at its camera ray.
    pub(crate) fn begin(&self, pixel: u32, sample: u32, seed: u32) -> Path {
        let sampler = Sampler::new(pixel, sample, seed).redrawing(self.redraw);
        let [x, y, offset, choice] = sampler.camera();
        let [width, height] = self.size;
        let column = f64::from(pixel % width) + 0.5 + self.filter.offset(x);
        let line = f64::from(height - 1 - pixel / width) + 0.5 + self.filter.offset(y);
        let ray = self.camera.ray(DVec2::new(column, line));
        self.begin_at(&ray, pixel, sampler, [offset, choice], self.thin.candidates(pixel))
    }

    /// A path at the begin of a ray from anywhere, which counts for `pixel`. Two numbers are those of its first flight and of the choice of its first
    /// event; `candidates_per_event` is that of [`Thin::candidates`], 0 where nothing is known. Of a medium in which nothing is to be
    /// scattered the ray is the only one.
    pub(super) fn begin_at(
        &self,
        ray: &Ray,
        pixel: u32,
        sampler: Sampler,
        [offset, choice]: [f64; 2],
        candidates_per_event: f64,
    ) -> Path {
        let mut path = Path {
            pixel,
            sampler,
            stage: if self.events > 0 { Stage::Camera } else { Stage::Last },
            origin: ray.origin,
            direction: ray.direction,
            walk: Walk::default(),
            in_meshes: None,
            carried: [1.0; 3],
            weight: [1.0; 3],
            control_depth: 0.0,
            analog: [1.0; 3],
            candidates_per_event,
            until_collision: 0.0,
            until_candidate: offset,
            at_candidate: false,
            rate: 0.0,
            control: 0.0,
            majorant: 0.0,
            numbers: [0.0; 4],
            candidates: Vec::new(),
            choice,
            kept_distance: 0.0,
            scattered: false,
            vertex: DVec3::ZERO,
            throughput: [0.0; 3],
            next: DVec3::ZERO,
            escape: 1.0,
            scatterings: 0,
            reference: 0.0,
            hit_distance: f64::NAN,
            hit: [0.0; 3],
            radiance: [0.0; 3],
            opacity: 0.0,
        };
        path.until_collision = optical_depth(if path.spaced() { path.sampler.next4()[0] } else { offset });
        let end = self.volume.last_face(ray.origin, ray.direction, ray.far);
        if self.volume.has_mesh {
            let near = ray.origin + ray.direction * ray.near;
            let begins_inside = |_, mesh: &PlacedMesh| mesh.begins_inside(near);
            let mut state = InMeshes::default();
            self.volume.parts(ray.origin, ray.direction, [ray.near, end], begins_inside, &mut state.parts);
            path.in_meshes = Some(Box::new(state));
        }
        self.set_out(&mut path, ray.near, end);
        path
    }

    /// A path that finds the opacity along its camera ray and nothing else.
    pub(super) fn begin_looking(&self, pixel: u32, sample: u32, seed: u32) -> Path {
        let mut path = self.begin(pixel, sample, seed);
        path.stage = Stage::Look;
        path
    }

    /// Puts a path whose parts are known at the begin of its ray.
    fn set_out(&self, path: &mut Path, from: f64, to: f64) {
        if self.volume.is_mesh {
            path.walk = Walk::default();
            self.next_part(path);
        } else {
            path.walk = self.walk(path.origin, path.direction, from, to).unwrap_or_default();
        }
    }

    /// Goes on with the next part of a ray through a single mesh; false where there is none.
    #[cold]
    fn next_part(&self, path: &mut Path) -> bool {
        while let Some(state) = &mut path.in_meshes
            && let Some(&Part { span: [from, to], .. }) = state.parts.get(state.begun)
        {
            state.begun += 1;
            let Some(walk) = self.walk(path.origin, path.direction, from, to) else { continue };
            // Light between two parts arrives through those before it alone.
            if path.stage != Stage::Shadow && path.hit_distance > 0.0 && path.hit_distance <= walk.distance {
                self.settle(path);
                for channel in 0..3 {
                    path.radiance[channel] += path.carried[channel] * path.weight[channel] * path.hit[channel];
                }
                path.hit_distance = f64::NAN;
            }
            path.walk = walk;
            return true;
        }
        false
    }

    /// A ray's way through the medium between two distances.
    fn walk(&self, origin: DVec3, direction: DVec3, from: f64, to: f64) -> Option<Walk> {
        let origin = self.volume.to_frame.transform_point3(origin);
        let direction = self.volume.to_frame.transform_vector3(direction);
        self.volume.majorants.as_ref()?.enter(origin, direction, from, to)
    }

    /// Where the path waits for coefficients, in the frame of the media.
    fn position(&self, path: &Path) -> DVec3 {
        let majorants = self.volume.majorants.as_ref().expect("a path waits in a medium");
        majorants.position(&path.walk)
    }

    /// Goes to where coefficients are needed next; false where the path ends.
    fn advance(&self, path: &mut Path, counters: &mut Counters) -> bool {
        if path.stage == Stage::Finished {
            return false;
        }
        loop {
            if let Some(majorants) = &self.volume.majorants
                && self.travel(path, majorants)
            {
                return true;
            }
            match self.end_ray(path, counters) {
                Then::Travel => {}
                Then::Wait => return true,
                Then::End => return false,
            }
        }
    }

    /// Goes along the ray to its next tentative collision or candidate; false at the end of the ray.
    fn travel(&self, path: &mut Path, majorants: &Majorants) -> bool {
        while path.walk.distance < path.walk.end || self.volume.is_mesh && self.next_part(path) {
            let crossing = majorants.crossing(&path.walk);
            let Rates { residual, seen, event } = crossing.rates;
            let Residual { control, rate } = if path.is_seen() { seen } else { residual };
            let (rate, control, candidates) = match path.stage {
                Stage::Camera if path.spaced() => (rate, control, path.candidates_per_event * f64::from(event)),
                Stage::Camera if self.volume.scatters() => (event, control, 0.0),
                Stage::Bounce => (event, 0.0, 0.0),
                _ => (rate, control, 0.0),
            };
            let (rate, control) = (f64::from(rate), f64::from(control));
            let length = crossing.exit - path.walk.distance;
            let collides = path.until_collision < rate * length;
            let mut step = if collides { path.until_collision / rate } else { length };
            path.at_candidate = path.until_candidate < candidates * step;
            if path.at_candidate {
                step = path.until_candidate / candidates;
            }
            self.fly(path, control, step);
            // Rounding must not put them before the place where the ray is.
            path.until_collision = (path.until_collision - rate * step).max(0.0);
            path.until_candidate = (path.until_candidate - candidates * step).max(0.0);
            if !(collides || path.at_candidate) {
                if !majorants.cross(&mut path.walk, &crossing) {
                    path.walk.distance = path.walk.end;
                }
                continue;
            }
            path.walk.distance += step;
            path.control = control;
            path.majorant = crossing.majorant;
            if path.at_candidate {
                path.rate = candidates;
                path.until_candidate = 1.0;
            } else {
                path.rate = rate;
                path.numbers = path.sampler.next4();
                path.until_collision = optical_depth(path.numbers[3]);
            }
            return true;
        }
        false
    }

    /// Lets the weight go through the control of the flights so far: once for all flights up to where the weight is needed, since most end at the
    /// face of a leaf.
    fn settle(&self, path: &mut Path) {
        if path.control_depth == 0.0 {
            return;
        }
        let depth = std::mem::take(&mut path.control_depth);
        let mut last = (1.0, transmittance(depth));
        for (weight, share) in path.weight.iter_mut().zip(self.volume.share) {
            if share != last.0 {
                last = (share, transmittance(share * depth));
            }
            *weight *= last.1;
        }
    }

    /// Emission and light along a flight, and its transmittance through the control.
    fn fly(&self, path: &mut Path, control: f64, length: f64) {
        // A shadow ray brings its own light and nothing else.
        let collects = path.stage != Stage::Shadow;
        let hit = path.hit_distance - path.walk.distance;
        let light = collects && hit > 0.0 && hit <= length;
        let emission = if collects { self.volume.emission } else { [0.0; 3] };
        if light {
            path.hit_distance = f64::NAN;
        }
        if !light && emission == [0.0; 3] {
            path.control_depth += control * length;
            return;
        }
        self.settle(path);
        for channel in 0..3 {
            let extinction = control * self.volume.share[channel];
            let arriving = path.carried[channel] * path.weight[channel];
            let depth = extinction * length;
            let reach = mean_transmittance(depth) * length;
            path.radiance[channel] += arriving * emission[channel] * reach;
            if light {
                path.radiance[channel] += arriving * (-extinction * hit).exp() * path.hit[channel];
            }
            path.weight[channel] *= transmittance(depth);
        }
    }

    /// Handles a tentative collision whose coefficients are known.
    fn collide(&self, path: &mut Path, found: &Coefficients<f64>) {
        self.settle(path);
        if self.volume.emission_varies && path.stage != Stage::Shadow && path.at_candidate == path.spaced() {
            for channel in 0..3 {
                path.radiance[channel] +=
                    path.carried[channel] * path.weight[channel] * found.emission[channel] / path.rate;
            }
        }
        if path.stage == Stage::Bounce {
            return collide_between_events(path, found);
        }
        if path.at_candidate {
            return path.note_candidate(path.weight, found);
        }
        if path.stage == Stage::Camera && !path.spaced() && self.volume.scatters() {
            path.note_candidate(path.analog, found);
        }
        for channel in 0..3 {
            let residual = found.extinction[channel] - path.control * self.volume.share[channel];
            path.weight[channel] *= 1.0 - residual / path.rate;
            path.analog[channel] *= 1.0 - found.extinction[channel] / path.rate;
        }
        let mut most = largest(&path.weight);
        if path.stage == Stage::Camera && !path.spaced() {
            most = most.max(largest(&path.analog));
        }
        if most < FAINT {
            let factor = if path.numbers[2] < 0.5 { 2.0 } else { 0.0 };
            path.weight = path.weight.mapped(|weight| weight * factor);
            path.analog = path.analog.mapped(|weight| weight * factor);
            if factor == 0.0 || most == 0.0 {
                path.stop();
            }
        }
    }

    /// What the ray finds at its end, and what comes next.
    fn end_ray(&self, path: &mut Path, counters: &mut Counters) -> Then {
        self.settle(path);
        let arriving: [f64; 3] = each(|channel| path.carried[channel] * path.weight[channel]);
        let found = match path.stage {
            Stage::Camera if self.transparent => [0.0; 3],
            Stage::Camera => self.world(path.direction),
            Stage::Look => [0.0; 3],
            Stage::Shadow => [1.0; 3],
            _ if arriving == [0.0; 3] => [0.0; 3],
            _ => {
                let world = self.world(path.direction);
                let hit = if path.hit_distance > 0.0 { path.hit } else { [0.0; 3] };
                each(|channel| path.escape * world[channel] + hit[channel])
            }
        };
        for channel in 0..3 {
            path.radiance[channel] += arriving[channel] * found[channel];
        }
        let travel = |goes_on: bool| if goes_on { Then::Travel } else { Then::End };
        match path.stage {
            Stage::Look => {
                path.opacity = path.opacity_so_far();
                Then::End
            }
            Stage::Camera => {
                path.opacity = path.opacity_so_far();
                if !path.choose_candidate() {
                    return Then::End;
                }
                path.reference = largest(&path.throughput);
                self.meet_event(path, counters)
            }
            Stage::Shadow => travel(self.leave_event(path)),
            Stage::Bounce => {
                if path.scattered && survives(path) {
                    self.meet_event(path, counters)
                } else {
                    Then::End
                }
            }
            Stage::Last | Stage::Event | Stage::Finished => Then::End,
        }
    }

    /// Whether behind the medium there is nothing that a picture shows.
    pub(super) fn shows_nothing_behind(&self) -> bool {
        self.transparent || matches!(self.world, World::Constant([0.0, 0.0, 0.0]))
    }

    /// What the world sends against a direction of travel.
    fn world(&self, direction: DVec3) -> [f64; 3] {
        match &self.world {
            World::Constant(radiance) => *radiance,
            World::Picture(picture) => picture.radiance(direction),
        }
    }

    /// A scattering event at the kept distance: scatters, or waits for its lobes at the very position where the
    /// coefficients were evaluated.
    fn meet_event(&self, path: &mut Path, counters: &mut Counters) -> Then {
        let phase = match &self.volume.lobes {
            Lobes::Single(phase) => Scattering::Single(phase),
            Lobes::Constant(mixture) => Scattering::Mixture(mixture),
            Lobes::Varying => {
                path.stage = Stage::Event;
                path.walk.distance = path.kept_distance;
                return Then::Wait;
            }
        };
        if self.scatter(path, &phase, counters) { Then::Travel } else { Then::End }
    }

    /// Samples the phase function at an event and sends a shadow ray; false where the path ends.
    fn scatter(&self, path: &mut Path, phase: &Scattering<'_>, counters: &mut Counters) -> bool {
        counters.scatterings += 1;
        let [[first, second, third, fourth], [choice, ..]] = path.sampler.scattering(path.scatterings);
        path.scatterings += 1;
        path.vertex = path.origin + path.direction * path.kept_distance;
        if let Some(state) = &mut path.in_meshes {
            state.note_surroundings(path.kept_distance, self.volume.is_mesh);
        }
        let before = path.direction;
        path.next = turned(before, phase.sample(first), second);
        path.hit_distance = f64::NAN;
        let Choice { source, probability, picture } = self.choose(path.vertex, choice);
        if let World::Picture(world) = &self.world {
            path.escape = balance(phase.evaluate(before, path.next), picture * world.density(path.next));
        }
        let (direction, distance, radiance, density) = match source {
            Source::Nothing => return self.leave_event(path),
            Source::Picture(picture) => {
                let Some((direction, density)) = picture.sample([third, fourth]) else {
                    return self.leave_event(path);
                };
                let radiance = picture.radiance(direction).mapped(|radiance| radiance / density);
                // The sampled ray sees the picture whatever was chosen: the choice belongs to the density.
                (direction, f64::INFINITY, radiance, Some(probability * density))
            }
            Source::Light(light) => {
                if let Some(hit) = light.hit(path.vertex, path.next) {
                    let share = balance(phase.evaluate(before, path.next), hit.density) / probability;
                    path.hit_distance = hit.distance;
                    path.hit = hit.radiance.mapped(|radiance| radiance * share);
                }
                let Some(sample) = light.sample(path.vertex, [third, fourth]) else { return self.leave_event(path) };
                (sample.direction, sample.distance, sample.radiance, sample.density)
            }
        };
        let phase = phase.evaluate(before, direction);
        let share = density.map_or(1.0, |density| balance(density, phase)) * phase / probability;
        let arriving = each(|channel| path.throughput[channel] * radiance[channel] * share);
        self.send(path, Stage::Shadow, direction, distance, arriving);
        true
    }

    /// Sends the ray that the phase function sampled; false where it cannot find anything.
    fn leave_event(&self, path: &mut Path) -> bool {
        let last = path.scatterings >= self.events;
        let black = matches!(self.world, World::Constant([0.0, 0.0, 0.0]));
        let dark = black && !self.volume.emits() && path.hit_distance.is_nan();
        if last && dark {
            return false;
        }
        let stage = if last { Stage::Last } else { Stage::Bounce };
        self.send(path, stage, path.next, f64::INFINITY, path.throughput);
        true
    }

    /// Starts a ray at the last event.
    fn send(&self, path: &mut Path, stage: Stage, direction: DVec3, end: f64, carried: [f64; 3]) {
        path.stage = stage;
        path.origin = path.vertex;
        path.direction = direction;
        path.carried = carried;
        path.weight = [1.0; 3];
        path.control_depth = 0.0;
        path.scattered = false;
        // Of each event one ray to a light and one that goes on.
        let is_transmittance = stage != Stage::Bounce;
        path.sampler.begin_ray(2 * path.scatterings + u32::from(stage != Stage::Shadow), is_transmittance);
        path.until_collision = optical_depth(path.sampler.next4()[0]);
        path.candidates_per_event = 0.0;
        path.at_candidate = false;
        if let Some(state) = &mut path.in_meshes {
            let InMeshes { parts, begun, around } = &mut **state;
            self.volume.parts(path.vertex, direction, [0.0, end], |object, _| around.contains(&object), parts);
            *begun = 0;
        }
        self.set_out(path, 0.0, end);
    }

    /// A light or the picture around the scene, in proportion to what it roughly delivers.
    fn choose(&self, place: DVec3, choice: f64) -> Choice<'_> {
        let (picture, fluence) = match &self.world {
            World::Constant(_) => (Source::Nothing, 0.0),
            World::Picture(picture) => (Source::Picture(picture), picture.fluence()),
        };
        if let ([light], Source::Nothing) = (self.lights.as_slice(), &picture) {
            return Choice { source: Source::Light(light), probability: 1.0, picture: 0.0 };
        }
        let total = fluence + self.lights.iter().map(|light| light.importance(place)).sum::<f64>();
        if total == 0.0 {
            return Choice { source: Source::Nothing, probability: 1.0, picture: 0.0 };
        }
        let mut rest = choice * total - fluence;
        if rest < 0.0 || self.lights.is_empty() {
            return Choice { source: picture, probability: fluence / total, picture: fluence / total };
        }
        let last = self.lights.len() - 1;
        for light in &self.lights[..last] {
            let importance = light.importance(place);
            if rest < importance {
                let probability = importance / total;
                return Choice { source: Source::Light(light), probability, picture: fluence / total };
            }
            rest -= importance;
        }
        let light = &self.lights[last];
        let probability = light.importance(place) / total;
        Choice { source: Source::Light(light), probability, picture: fluence / total }
    }
}

impl Scattering<'_> {
    /// Phase function in 1/sr between two directions of travel, which is the density of [`Self::sample`].
    fn evaluate(&self, before: DVec3, after: DVec3) -> f64 {
        let cosine = before.dot(after).clamp(-1.0, 1.0);
        match self {
            Self::Single(phase) => phase.evaluate(cosine),
            Self::Mixture(mixture) => mixture.evaluate(cosine),
        }
    }

    /// Samples the cosine between the directions with a number in [0, 1).
    fn sample(&self, uniform: f64) -> f64 {
        match self {
            Self::Single(phase) => phase.sample(uniform),
            // Where nothing scatters there is no event.
            Self::Mixture(mixture) => mixture.sample(uniform).unwrap_or(1.0),
        }
    }
}

/// Weight of a sample by the balance heuristic: its density over the sum with that of the other way to sample.
fn balance(own: f64, other: f64) -> f64 {
    if own > 0.0 { own / (own + other) } else { 0.0 }
}

impl InMeshes {
    /// Notes which meshes hold an event at a distance. An event in the `only` object lies in it, even if rounding puts it behind the end of
    /// its part.
    fn note_surroundings(&mut self, distance: f64, only: bool) {
        self.around.clear();
        if only {
            self.around.push(0);
        } else {
            self.around.extend(self.parts.iter().filter(|part| part.holds(distance)).map(|part| part.object));
        }
    }
}

impl Path {
    /// Where the last part of the ray in a mesh ends; none without one.
    pub(crate) fn end_of_parts(&self) -> Option<f64> {
        self.in_meshes.as_ref()?.parts.last().map(|part| part.span[1])
    }

    /// Mean over channels of what does not come through.
    fn opacity_so_far(&self) -> f64 {
        1.0 - self.weight.iter().sum::<f64>() / 3.0
    }

    /// Notes that the camera ray, of a weight here, may scatter here first.
    fn note_candidate(&mut self, weight: [f64; 3], found: &Coefficients<f64>) {
        let weight: [f64; 3] = each(|channel| weight[channel] * found.scattering[channel] / self.rate);
        let share = weight.iter().map(|channel| channel.abs()).sum::<f64>() / 3.0;
        if share > 0.0 {
            let up_to = share + self.candidates.last().map_or(0.0, |last| last.up_to);
            self.candidates.push(Candidate { distance: self.walk.distance, weight, share, up_to });
        }
    }

    /// Chooses one of the candidates; false without one.
    fn choose_candidate(&mut self) -> bool {
        let Some(last) = self.candidates.last() else { return false };
        let (total, most) = (last.up_to, self.candidates.len() - 1);
        let place = self.candidates.partition_point(|candidate| candidate.up_to <= self.choice * total).min(most);
        let Candidate { distance, weight, share, .. } = self.candidates[place];
        self.kept_distance = distance;
        self.throughput = weight.mapped(|weight| weight * (total / share));
        true
    }

    /// Whether the ray's opacity is asked.
    fn is_seen(&self) -> bool {
        matches!(self.stage, Stage::Camera | Stage::Look)
    }

    /// Whether candidates are spaced evenly.
    fn spaced(&self) -> bool {
        self.candidates_per_event > 0.0
    }

    /// Goes no further along the ray.
    fn stop(&mut self) {
        self.walk.distance = self.walk.end;
        if let Some(state) = &mut self.in_meshes {
            state.begun = state.parts.len();
        }
    }

    /// Whether the ray, where it is, lies in the mesh of an object.
    fn is_in(&self, object: usize) -> bool {
        let holds = |part: &Part| part.object == object && part.holds(self.walk.distance);
        self.in_meshes.as_ref().is_some_and(|state| state.parts.iter().any(holds))
    }
}

impl Sums {
    fn add(&mut self, path: &Path) {
        let sum = &mut self.pixels[path.pixel as usize - self.first_pixel];
        for channel in 0..3 {
            sum[channel] += path.radiance[channel];
        }
        sum[3] += path.opacity;
    }
}

/// A tentative collision of a ray between scattering events: scattering or null.
fn collide_between_events(path: &mut Path, found: &Coefficients<f64>) {
    let weight: [f64; 3] = each(|channel| path.carried[channel] * path.weight[channel]);
    let scattering: f64 = (0..3).map(|channel| (weight[channel] * found.scattering[channel]).abs()).sum();
    let null: f64 = (0..3).map(|channel| (weight[channel] * (path.rate - found.extinction[channel])).abs()).sum();
    let both = scattering + null;
    if path.numbers[1] * both < scattering {
        let factor = both / (scattering * path.rate);
        path.throughput = each(|channel| weight[channel] * found.scattering[channel] * factor);
        // The event takes over; nothing is left for the end of this ray.
        path.weight = [0.0; 3];
        path.kept_distance = path.walk.distance;
        path.stop();
        path.scattered = true;
    } else if null > 0.0 {
        let factor = both / (null * path.rate);
        for channel in 0..3 {
            path.weight[channel] *= (path.rate - found.extinction[channel]) * factor;
        }
    } else {
        path.weight = [0.0; 3];
        path.stop();
    }
}

/// The optical depth that a ray goes to its next tentative collision, by a number in [0, 1).
fn optical_depth(uniform: f64) -> f64 {
    -(-uniform).ln_1p()
}

/// Roulette by what is left of the throughput: unbiased, since survivors carry more.
fn survives(path: &mut Path) -> bool {
    if path.scatterings < EVENTS_BEFORE_ROULETTE {
        return true;
    }
    let chance = largest(&path.throughput) / path.reference;
    if chance >= 1.0 {
        return true;
    }
    path.throughput = path.throughput.mapped(|weight| weight / chance);
    path.numbers[2] < chance
}

/// The largest magnitude.
fn largest(values: &[f64; 3]) -> f64 {
    values.iter().fold(0.0, |most, value| most.max(value.abs()))
}

pub(crate) fn violation(position: [f32; 3], extinction: f64, majorant: f64) -> Error {
    if !extinction.is_finite() {
        return not_finite(position, extinction);
    }
    Error::new(
        format!("the object-space position {position:?}"),
        format!("an extinction of {extinction} per metre"),
        format!("at most the majorant {majorant} that was proven for its surroundings"),
        "This is a defect of the bounds: please report it with the scene file.",
    )
}
