//! Ray marching of single scattering, deterministic: the CPU twin of `shaders/integrators/march/march.wgsl`.
//!
//! A view ray through the medium is cut into equal steps; the density d in the middle of a step
//! stands for the whole step. With extinction s = e d, scattering c d, incident light I (the phase
//! function applied) and emission j, a step of length h multiplies the transmittance T by exp(-s h) and,
//! with T as it was before the step, adds
//!
//! - energy-conserving: T (c d I + j) (1 - exp(-s h)) / s, exact for constant coefficients (Hillaire 2015,
//!   "Physically Based and Unified Volumetric Rendering in Frostbite", SIGGRAPH course Advances in
//!   Real-Time Rendering). Of second order in h where the medium is smooth.
//! - plain: T (c d I + j) h, the Riemann sum of absorption plus emission with T at the step's begin (Max
//!   1995, "Optical Models for Direct Volume Rendering"). Of first order: T falls along a step, so the sum
//!   is too bright by about s h / 2 of itself, and a step through an opaque medium adds without bound.
//!
//! A density that jumps makes both of first order, because the step with the jump is wrong as a whole.
//! Suns and points arrive as P p(cos) exp(-e depth); a constant world as its radiance times the mean over
//! directions of p exp(-e depth). Alpha is one minus the mean transmittance of the channels.
//!
//! What a scene does not need is left out ([`Omission`]); the picture stays the same.
//!
//! Not here: more than one scattering event, area lights, the penumbra of a sun.

pub(crate) mod gpu;
pub mod light_grid;

pub use gpu::CONSTANTS;

use crate::base::arrays::Mapped;
use crate::base::choice::choice;
use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::gpu::Gpu;
use crate::integrators::march::gpu::Kernels;
use crate::integrators::march::light_grid::LightGrid;
use crate::integrators::{Jitter, LightMode, MarchSettings};
use crate::media::density_cache::{CacheReport, DensityCache, Samples};
use crate::media::medium::Medium;
use crate::media::mesh::Span;
use crate::media::phase::henyey_greenstein;
use crate::media::transfer::Integration;
use crate::media::transfer::{mean_transmittance, transmittance};
use crate::scene::Scene;
use crate::scene::image::Image;
use crate::view::camera::Camera;
use crate::view::film;
use crate::view::lights::{DeltaLight, delta_lights, harmonics, sphere_directions, world_radiance};
use crate::view::sampler::Sampler;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Rays that are marched together, so that the density program gets full batches.
const RAYS: usize = 1 << 14;

/// Steps of every ray between two evaluations of the density.
const STEPS: usize = 16;

/// Shadow samples that are evaluated together in mode `exact`.
const SHADOW_SAMPLES: usize = 1 << 20;

choice! {
    "kebab-case",
    /// A part of the work that a scene does not need. The picture is that of the generic work: to the bit
    /// but where a sum of many steps becomes one product, which moves it by the rounding of that sum.
    pub enum Omission {
        /// Nothing scatters or nothing shines: no light is baked, marched or added.
        InScatter,
        /// No sun, point or spot: no march towards one.
        Lights,
        /// A black world: no quadrature over its directions.
        World,
        /// Anisotropy 0: the phase function is a constant.
        Phase,
        /// A homogeneous medium: the density is not evaluated at view samples.
        Density,
        /// A homogeneous medium without light in it: one exponential per ray. Not with plain integration
        /// of an emission, whose error is that of the steps.
        ViewSteps,
        /// A homogeneous medium with light in mode `exact`: the depth towards the light is a length.
        ShadowSteps,
        /// No part of the medium is provably empty: no lookups of empty cells.
        EmptyCells,
    }
}

/// What all rays share.
pub(crate) struct Stage<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) settings: MarchSettings,
    pub(crate) medium: Medium,
    pub(crate) lights: Vec<DeltaLight>,
    pub(crate) world: [f64; 3],
    pub(crate) directions: Vec<DVec3>,
    pub(crate) grid: Option<LightGrid>,
    pub(crate) left_out: Vec<Omission>,
    cache_report: Option<CacheReport>,
}

/// A view ray on its way through the medium.
pub(crate) struct ViewRay {
    pub(crate) origin: DVec3,
    pub(crate) direction: DVec3,
    /// The same in the object's frame, per metre of world space.
    pub(crate) local_origin: DVec3,
    pub(crate) local_direction: DVec3,
    pub(crate) start: f64,
    pub(crate) step: f64,
    pub(crate) steps: usize,
    /// Part of a step before its sample; 0.5 is the middle.
    pub(crate) offset: f64,
    pub(crate) next: usize,
    /// Further parts in a mesh, the last one first.
    rest: Vec<Span>,
    pub(crate) transmittance: [f64; 3],
    pub(crate) radiance: [f64; 3],
}

/// A step with something in it.
struct Sample {
    ray: usize,
    local: DVec3,
    distance: f64,
    /// Length of the step.
    step: f64,
}

/// Renders on all cores, or on the adapter. `settings` are resolved.
pub fn render(scene: &Scene, settings: &MarchSettings, gpu: Option<&Gpu>, progress: Progress<'_>) -> Result<Image> {
    let (stage, kernels) = Stage::prepare(scene, settings, None, gpu, progress)?;
    stage.picture(kernels.as_ref(), progress)
}

/// Renders on all cores with one preparation: `settings` with each of these view steps and integrations. The
/// density is read from `cache` where one is given.
pub fn render_each(
    scene: &Scene,
    settings: &MarchSettings,
    cache: Option<DensityCache>,
    quadratures: &[(f64, Integration)],
    mut each: impl FnMut(usize, Image),
    progress: Progress<'_>,
) -> Result<()> {
    let count = quadratures.len() as f64;
    let prepared = |done: f64, what: &str| progress(done / (count + 1.0), what);
    let (mut stage, _) = Stage::prepare(scene, settings, cache, None, &prepared)?;
    for (number, &(view_step, integration)) in quadratures.iter().enumerate() {
        stage.settings.view_step = view_step;
        stage.settings.integration = integration;
        stage.left_out = stage.omissions();
        let report = |done: f64, what: &str| progress((number as f64 + 1.0 + done) / (count + 1.0), what);
        each(number, stage.picture(None, &report)?);
    }
    Ok(())
}

impl<'a> Stage<'a> {
    /// The medium and what shines, with what they allow to leave out; without cache, directions or light grid.
    pub(crate) fn new(scene: &'a Scene, settings: &MarchSettings) -> Result<Self> {
        let mut stage = Self {
            scene,
            settings: settings.clone(),
            medium: Medium::new(scene)?,
            lights: delta_lights(scene)?,
            world: world_radiance(scene),
            directions: Vec::new(),
            grid: None,
            left_out: Vec::new(),
            cache_report: None,
        };
        stage.left_out = stage.omissions();
        Ok(stage)
    }

    /// Everything that does not depend on the ray: the medium, its cache and the light in it.
    fn prepare<'g>(
        scene: &'a Scene,
        settings: &MarchSettings,
        cache: Option<DensityCache>,
        gpu: Option<&'g Gpu>,
        progress: Progress<'_>,
    ) -> Result<(Self, Option<Kernels<'g>>)> {
        let bounces = scene.integrator.volume_bounces.min(scene.integrator.max_bounces);
        if bounces != 0 {
            return Err(Error::new(
                "$.integrator.volume_bounces",
                bounces.to_string(),
                "0: ray marching computes single scattering",
                "Set the volume bounces to 0, or trace paths.",
            )
            .with_setting("volume_bounces")
            .with_setting("integrator"));
        }
        if let Some(image) = &scene.world.image {
            return Err(Error::new(
                "$.world.image",
                format!("the picture \"{}\"", image.file),
                "a constant world: ray marching knows no other",
                "Leave the picture out, or trace paths.",
            )
            .with_setting("integrator"));
        }
        if let Some(graph) = &scene.world.graph {
            return Err(Error::new(
                "$.world.graph",
                format!("the nodes of the world \"{}\"", graph.material),
                "a constant world: ray marching knows no other",
                "Leave the graph out, or trace paths.",
            )
            .with_setting("integrator"));
        }
        let mut stage = Self::new(scene, settings)?;
        let empty = stage.medium.density.occupied.is_empty();
        let cached = if settings.density_cache.is_some() { 0.25 } else { 0.0 };
        let cache = match (cache, settings.density_cache) {
            (Some(cache), _) => Some(cache),
            (None, Some(wanted)) if !empty => {
                let report = |done: f64| progress(cached * done, "density cache");
                let Medium { density, to_object, .. } = &stage.medium;
                let samples = Samples::bake(density, to_object, wanted.cells, wanted.format, &report)?;
                Some(DensityCache::new(&samples, wanted.format, wanted.filter)?)
            }
            _ => None,
        };
        if let Some(cache) = cache {
            stage.cache_report = Some(cache.measure(&stage.medium.density)?);
            stage.medium.density = cache.density;
        }
        stage.left_out = stage.omissions();
        if !stage.leaves_out(Omission::World) {
            stage.directions = sphere_directions(settings.world_directions as usize);
        }
        let report = |done: f64| progress(cached + (0.5 - cached) * done, "light grid");
        // Where nothing is, no ray asks for light; one exponential per ray needs no kernel.
        let nothing_to_bake = empty || stage.leaves_out(Omission::ViewSteps);
        let kernels = match gpu {
            _ if nothing_to_bake => None,
            Some(gpu) => Some(Kernels::bake(gpu, &stage, &report)?),
            None => {
                if settings.light == LightMode::Grid && !stage.leaves_out(Omission::InScatter) {
                    let lit_by_world = !stage.directions.is_empty();
                    let grid = LightGrid::bake(&stage.medium, &stage.lights, lit_by_world, settings, &report)?;
                    stage.grid = Some(grid);
                }
                None
            }
        };
        Ok((stage, kernels))
    }

    /// What the scene and the settings allow to leave out.
    fn omissions(&self) -> Vec<Omission> {
        if !self.settings.specialise {
            return Vec::new();
        }
        let medium = &self.medium;
        let dark_world = self.world == [0.0; 3];
        let unlit = medium.scattering == [0.0; 3] || self.lights.is_empty() && dark_world;
        let homogeneous = medium.density.homogeneous().is_some();
        let emits = medium.emission != [0.0; 3] || medium.emission_of_density != [0.0; 3];
        let one_step = self.settings.integration == Integration::EnergyConserving || !emits;
        [
            (Omission::InScatter, unlit),
            (Omission::Lights, unlit || self.lights.is_empty()),
            (Omission::World, unlit || dark_world),
            (Omission::Phase, henyey_greenstein(medium.anisotropy, 0.0) == henyey_greenstein(0.0, 0.0)),
            (Omission::Density, homogeneous),
            // A ray may have several parts in a mesh.
            (Omission::ViewSteps, homogeneous && unlit && one_step && medium.mesh.is_none()),
            (Omission::ShadowSteps, homogeneous && !unlit && self.settings.light == LightMode::Exact),
            (Omission::EmptyCells, medium.density.fills_all_cells()),
        ]
        .into_iter()
        .filter_map(|(omission, possible)| possible.then_some(omission))
        .collect()
    }

    /// Whether a part of the work is left out.
    pub(crate) fn leaves_out(&self, omission: Omission) -> bool {
        self.left_out.contains(&omission)
    }

    /// The picture, by the kernels where there are any.
    fn picture(&self, kernels: Option<&Kernels<'_>>, progress: Progress<'_>) -> Result<Image> {
        let size = self.scene.image_size();
        let camera = Camera::new(self.scene, size)?;
        let begun = if self.settings.light == LightMode::Grid { 0.5 } else { 0.0 };
        let [width, height] = size.mapped(|side| side as usize);
        let mut image = Image::new(width, height);
        let strata = self.settings.sub_pixels as usize;
        let film = &self.scene.film;
        let offsets = film::offsets(film.pixel_filter, f64::from(film.filter_width), strata);
        let per_pixel = strata * strata;
        let pixels_per_pass = (RAYS / per_pixel).max(1);
        for first in (0..image.pixels.len()).step_by(pixels_per_pass) {
            let pixels = first..image.pixels.len().min(first + pixels_per_pass);
            let mut rays: Vec<Option<ViewRay>> = pixels
                .clone()
                .flat_map(|pixel| (0..per_pixel).map(move |part| (pixel, part)))
                .map(|(pixel, part)| {
                    let column = (pixel % width) as f64 + 0.5 + offsets[part % strata];
                    let line = (height - 1 - pixel / width) as f64 + 0.5 + offsets[part / strata];
                    let offset = match self.settings.jitter {
                        Jitter::None => 0.5,
                        Jitter::Pixel => Sampler::new(pixel as u32, part as u32, self.settings.seed).step_offset(),
                    };
                    self.view_ray(&camera, DVec2::new(column, line), offset)
                })
                .collect();
            match (kernels, self.medium.density.homogeneous()) {
                (_, Some(density)) if self.leaves_out(Omission::ViewSteps) => {
                    rays.iter_mut().flatten().for_each(|ray| ray.cross(self, density));
                }
                (Some(kernels), _) => kernels.march(&mut rays)?,
                (None, _) => self.march(&mut rays)?,
            }
            for (pixel, rays) in pixels.zip(rays.chunks(per_pixel)) {
                image.pixels[pixel] = self.pixel(rays);
            }
            let done = (first + pixels_per_pass) as f64 / image.pixels.len() as f64;
            progress(begun + (1.0 - begun) * done.min(1.0), "view rays");
        }
        image.provenance.insert("left_out".to_owned(), super::json(&self.left_out));
        if let Some(report) = &self.cache_report {
            image.provenance.insert("density_cache".to_owned(), super::json(report));
        }
        Ok(image)
    }
}

impl Stage<'_> {
    /// The part of a camera ray that lies in the medium, cut into steps; None where it misses.
    fn view_ray(&self, camera: &Camera, raster: DVec2, offset: f64) -> Option<ViewRay> {
        let ray = camera.ray(raster);
        let local_origin = self.medium.to_object.transform_point3(ray.origin);
        let local_direction = self.medium.to_object.transform_vector3(ray.direction);
        let mut rest = Vec::new();
        if let Some(mesh) = &self.medium.mesh {
            // Cycles leaves out a medium behind the last face before the far clip.
            let last = mesh.last_face(ray.origin, ray.direction, ray.far)?;
            let inside = mesh.begins_inside(ray.origin + ray.direction * ray.near);
            mesh.spans(ray.origin, ray.direction, [ray.near, last], inside, &mut rest);
            rest.reverse();
        } else {
            let (_, leave) = self.medium.density.bounds.segment(local_origin, local_direction)?;
            // Cycles leaves out a medium that reaches across the far clip.
            if leave > ray.far {
                return None;
            }
            rest.push([ray.near, f64::INFINITY]);
        }
        let (enter, leave) = self.medium.density.occupied.segment(local_origin, local_direction)?;
        let mut ray = ViewRay {
            origin: ray.origin,
            direction: ray.direction,
            local_origin,
            local_direction,
            start: 0.0,
            step: 0.0,
            steps: 0,
            offset,
            next: 0,
            rest: Vec::new(),
            transmittance: [1.0; 3],
            radiance: [0.0; 3],
        };
        // The part of each that may hold something.
        rest.retain_mut(|[from, to]| {
            (*from, *to) = (enter.max(*from), leave.min(*to));
            *from < *to
        });
        ray.rest = rest;
        ray.next_part(self.settings.view_step).then_some(ray)
    }

    /// Takes all rays to their ends.
    fn march(&self, rays: &mut [Option<ViewRay>]) -> Result<()> {
        let all_may_hold = self.leaves_out(Omission::EmptyCells);
        let constant = self.medium.density.homogeneous().filter(|_| self.leaves_out(Omission::Density));
        let lit = !self.leaves_out(Omission::InScatter);
        loop {
            let mut samples = Vec::new();
            for (number, ray) in rays.iter_mut().enumerate() {
                let Some(ray) = ray.as_mut().filter(|ray| ray.is_open(&self.settings)) else { continue };
                // Empty cells cost nothing: go on until a step holds something.
                let mut found = 0;
                while found < STEPS && (ray.next < ray.steps || ray.next_part(self.settings.view_step)) {
                    let distance = ray.start + (ray.next as f64 + ray.offset) * ray.step;
                    let local = ray.local_origin + ray.local_direction * distance;
                    if all_may_hold || self.medium.density.may_hold(local) {
                        samples.push(Sample { ray: number, local, distance, step: ray.step });
                        found += 1;
                    }
                    ray.next += 1;
                }
            }
            if samples.is_empty() {
                return Ok(());
            }
            let densities = match constant {
                Some(density) => vec![density as f32; samples.len()],
                None => {
                    let positions: Vec<[f32; 3]> =
                        samples.iter().map(|sample| sample.local.as_vec3().to_array()).collect();
                    self.medium.density.values(&positions)?
                }
            };
            let incident = if lit { self.incident(&samples, &densities, rays)? } else { vec![[0.0; 3]; samples.len()] };
            for ((sample, &density), incident) in samples.iter().zip(&densities).zip(&incident) {
                let ray = rays[sample.ray].as_mut().expect("samples belong to rays in the medium");
                // Samples of a batch behind the end of a ray add nothing, as on the adapter, which looks before every step.
                if ray.is_dark(&self.settings) {
                    continue;
                }
                ray.advance(&self.medium, self.settings.integration, sample.step, f64::from(density), incident);
            }
        }
    }

    /// The phase function; a constant where it is left out.
    fn phase(&self) -> impl Fn(f64) -> f64 + Sync {
        let isotropic = self.leaves_out(Omission::Phase).then(|| henyey_greenstein(0.0, 0.0));
        let anisotropy = self.medium.anisotropy;
        move |cosine| isotropic.unwrap_or_else(|| henyey_greenstein(anisotropy, cosine))
    }

    /// Light that a unit of scattering sends towards the camera, per sample and channel.
    fn incident(&self, samples: &[Sample], densities: &[f32], rays: &[Option<ViewRay>]) -> Result<Vec<[f64; 3]>> {
        let ray_of = |sample: &Sample| rays[sample.ray].as_ref().expect("samples belong to rays in the medium");
        let Some(grid) = &self.grid else { return self.incident_by_shadow_rays(samples, densities, &ray_of) };
        let phase = self.phase();
        Ok(samples
            .par_iter()
            .zip(densities)
            .map(|(sample, &density)| {
                // NaN is not skipped: it has to reach the picture.
                if density == 0.0 {
                    return [0.0; 3];
                }
                let ray = ray_of(sample);
                let corners = grid.corners(sample.local);
                let depths = grid.depths.iter().map(|depths| f64::from(corners.read(depths)));
                let mut light = self.delta_light(ray, sample.distance, depths, &phase);
                if !grid.world.is_empty() {
                    let basis = harmonics(ray.direction);
                    let mut transmittances = vec![0.0; grid.world.len() / grid.harmonics];
                    for (index, values) in grid.world.iter().enumerate() {
                        let harmonic = index % grid.harmonics;
                        let band = (harmonic as f64).sqrt() as i32;
                        // A harmonic of band l convolved with Henyey-Greenstein shrinks by g^l.
                        transmittances[index / grid.harmonics] +=
                            self.medium.anisotropy.powi(band) * basis[harmonic] * f64::from(corners.read(values));
                    }
                    for channel in 0..3 {
                        light[channel] += self.world[channel] * transmittances[grid.extinction_of_channel[channel]];
                    }
                }
                light
            })
            .collect())
    }

    /// Light of suns and points, given the depth of density towards each.
    fn delta_light(
        &self,
        ray: &ViewRay,
        distance: f64,
        depths: impl Iterator<Item = f64>,
        phase: &impl Fn(f64) -> f64,
    ) -> [f64; 3] {
        let position = ray.origin + ray.direction * distance;
        let mut light = [0.0; 3];
        for (source, depth) in self.lights.iter().zip(depths) {
            let (towards, _, power) = source.arriving(position);
            let phase = phase(towards.dot(ray.direction));
            for channel in 0..3 {
                light[channel] += power[channel] * phase * (-self.medium.extinction[channel] * depth).exp();
            }
        }
        light
    }

    /// [`Self::incident`] with the density evaluated along each shadow ray.
    fn incident_by_shadow_rays<'r>(
        &self,
        samples: &[Sample],
        densities: &[f32],
        ray_of: &(impl Fn(&Sample) -> &'r ViewRay + Sync),
    ) -> Result<Vec<[f64; 3]>> {
        let mut incident = vec![[0.0; 3]; samples.len()];
        let lit: Vec<usize> = (0..samples.len()).filter(|&index| densities[index] != 0.0).collect();
        let rays_per_sample = self.lights.len() + self.directions.len();
        if rays_per_sample == 0 {
            return Ok(incident);
        }
        let phase = self.phase();
        // A homogeneous medium's depth is its density times the length.
        let constant = self.medium.density.homogeneous().filter(|_| self.leaves_out(Omission::ShadowSteps));
        let longest = (self.medium.density.occupied.high - self.medium.density.occupied.low).length()
            / self.medium.to_object.x_axis.truncate().length().min(1e300);
        let per_ray = (longest / self.settings.shadow_step).ceil().max(1.0) as usize;
        let together = (SHADOW_SAMPLES / (rays_per_sample * per_ray)).max(1);
        for lit in lit.chunks(together) {
            let mut positions = Vec::new();
            // Number of samples, length of a step and depth besides, part by part, and how many parts each ray has.
            let (mut shadows, mut counts) = (Vec::new(), Vec::new());
            let mut parts: Vec<Span> = Vec::new();
            for &index in lit {
                let sample = &samples[index];
                let ray = ray_of(sample);
                let position = ray.origin + ray.direction * sample.distance;
                let ways = self
                    .lights
                    .iter()
                    .map(|light| {
                        let (towards, distance, _) = light.arriving(position);
                        (towards, distance)
                    })
                    .chain(self.directions.iter().map(|&towards| (towards, f64::INFINITY)));
                for (towards, distance) in ways {
                    let way = self.medium.to_object.transform_vector3(towards);
                    let segment = self.medium.density.occupied.segment(sample.local, way);
                    let length = segment.map_or(0.0, |(_, leave)| leave.clamp(0.0, distance));
                    let whole = [[0.0, length]];
                    parts.clear();
                    if let Some(mesh) = self.medium.mesh.as_ref().filter(|_| length > 0.0) {
                        mesh.spans(position, towards, [0.0, length], true, &mut parts);
                    }
                    let parts = if self.medium.mesh.is_some() { parts.as_slice() } else { &whole };
                    if let Some(density) = constant {
                        let length: f64 = parts.iter().map(|[from, to]| to - from).sum();
                        shadows.push((0, 0.0, density * length));
                        counts.push(1);
                        continue;
                    }
                    let steps_of = |&[from, to]: &Span| {
                        let length = to - from;
                        let steps = (length / self.settings.shadow_step).ceil();
                        let step = if steps == 0.0 { 0.0 } else { length / steps };
                        for number in 0..steps as usize {
                            let place = sample.local + way * (from + (number as f64 + 0.5) * step);
                            positions.push(place.as_vec3().to_array());
                        }
                        (steps as usize, step, 0.0)
                    };
                    shadows.extend(parts.iter().map(steps_of));
                    counts.push(parts.len());
                }
            }
            let found = self.medium.density.values(&positions)?;
            let mut rest = found.as_slice();
            let mut others = shadows.iter();
            let depths: Vec<f64> = counts
                .iter()
                .map(|&count| {
                    let depth = |&(steps, step, known): &(usize, f64, f64)| {
                        let (own, others) = rest.split_at(steps);
                        rest = others;
                        known + own.iter().map(|&density| f64::from(density)).sum::<f64>() * step
                    };
                    others.by_ref().take(count).map(depth).sum()
                })
                .collect();
            for (&index, depths) in lit.iter().zip(depths.chunks(rays_per_sample)) {
                let ray = ray_of(&samples[index]);
                let (near, around) = depths.split_at(self.lights.len());
                let mut light = self.delta_light(ray, samples[index].distance, near.iter().copied(), &phase);
                // Divided by its own sum, the quadrature of the phase function is exact in total.
                let phases: Vec<f64> =
                    self.directions.iter().map(|towards| phase(towards.dot(ray.direction))).collect();
                let total: f64 = phases.iter().sum();
                for (channel, light) in light.iter_mut().enumerate() {
                    let extinction = self.medium.extinction[channel];
                    let sum: f64 =
                        phases.iter().zip(around).map(|(phase, depth)| phase * (-extinction * depth).exp()).sum();
                    *light += if total > 0.0 { self.world[channel] * sum / total } else { 0.0 };
                }
                incident[index] = light;
            }
        }
        Ok(incident)
    }

    /// Mean of the rays of a pixel, with what lies behind the medium.
    fn pixel(&self, rays: &[Option<ViewRay>]) -> [f32; 4] {
        let mut radiance = [0.0; 3];
        let mut transmittance = [0.0; 3];
        for ray in rays {
            for channel in 0..3 {
                let (light, through) =
                    ray.as_ref().map_or((0.0, 1.0), |ray| (ray.radiance[channel], ray.transmittance[channel]));
                radiance[channel] += light;
                transmittance[channel] += through;
            }
        }
        let count = rays.len() as f64;
        let film = &self.scene.film;
        let exposure = f64::from(film.exposure);
        let mut pixel = [1.0; 4];
        for channel in 0..3 {
            let behind = if film.transparent { 0.0 } else { transmittance[channel] * self.world[channel] };
            pixel[channel] = (exposure * (radiance[channel] + behind) / count) as f32;
        }
        if film.transparent {
            pixel[3] = (1.0 - transmittance.iter().sum::<f64>() / (3.0 * count)) as f32;
        }
        pixel
    }
}

impl ViewRay {
    fn is_open(&self, settings: &MarchSettings) -> bool {
        (self.next < self.steps || !self.rest.is_empty()) && !self.is_dark(settings)
    }

    /// Whether too little is left of its light to go on.
    fn is_dark(&self, settings: &MarchSettings) -> bool {
        // NaN counts as open: it has to reach the picture.
        self.transmittance.iter().all(|&through| through < settings.exit_transmittance)
    }

    /// Cuts the next part of the ray into steps; false where there is none.
    pub(crate) fn next_part(&mut self, view_step: f64) -> bool {
        let Some([start, end]) = self.rest.pop() else { return false };
        let steps = ((end - start) / view_step).ceil().max(1.0);
        self.start = start;
        self.step = (end - start) / steps;
        self.steps = steps as usize;
        self.next = 0;
        true
    }

    /// Goes one step through constant coefficients.
    fn advance(&mut self, medium: &Medium, integration: Integration, step: f64, density: f64, incident: &[f64; 3]) {
        for (channel, incident) in incident.iter().enumerate() {
            let depth = medium.extinction[channel] * density * step;
            let mut source = medium.scattering[channel] * density * incident + medium.emission[channel];
            if medium.emission_of_density[channel] != 0.0 {
                source += medium.emission_of_density[channel] * density;
            }
            let length = match integration {
                Integration::Plain => step,
                Integration::EnergyConserving => mean_transmittance(depth) * step,
            };
            self.radiance[channel] += self.transmittance[channel] * source * length;
            self.transmittance[channel] *= transmittance(depth);
        }
    }

    /// Goes through a homogeneous medium without light at once, as far as steps would have gone: the early exit is
    /// part of the picture.
    fn cross(&mut self, stage: &Stage<'_>, density: f64) {
        let medium = &stage.medium;
        let slowest = medium.extinction.iter().copied().fold(f64::INFINITY, f64::min) * density * self.step;
        let exit = stage.settings.exit_transmittance;
        if slowest > 0.0 && exit > 0.0 {
            // The first number of steps after which the most transparent channel is below the exit.
            let needed = ((-exit.ln() / slowest).floor() + 1.0).clamp(0.0, self.steps as f64);
            self.steps = needed as usize;
        }
        let length = self.step * self.steps as f64;
        self.steps = 1;
        self.advance(medium, Integration::EnergyConserving, length, density, &[0.0; 3]);
    }
}
