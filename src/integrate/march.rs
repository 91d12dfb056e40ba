//! Ray marching of single scattering, deterministic: the CPU twin of `shaders/integrate/march.wgsl`.
//!
//! A view ray through the medium is cut into equal steps; the density d in the middle of a step
//! stands for the whole step. With extinction s = e d, scattering c d, incident light I (the phase
//! function applied) and emission j, a step of length h adds T (c d I + j) (1 - exp(-s h)) / s and
//! multiplies the transmittance T by exp(-s h): exact for constant coefficients. Suns and points
//! arrive as P p(cos) exp(-e depth); a constant world as its radiance times the mean over directions
//! of p exp(-e depth). Alpha is one minus the mean transmittance of the channels.
//!
//! Not here: more than one scattering event, area lights, the penumbra of a sun.

use super::adapter::Kernels;
use super::camera::Camera;
use super::light_grid::LightGrid;
use super::lights::{DeltaLight, delta_lights, harmonics, sphere_directions, world_radiance};
use super::medium::Medium;
use super::phase::henyey_greenstein;
use super::{LightMode, MarchSettings, Progress, film};
use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::image::Image;
use crate::scene::Scene;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Rays that are marched together, so that the density program gets full batches.
const RAYS: usize = 1 << 14;

/// Steps of every ray between two evaluations of the density.
const STEPS: usize = 16;

/// Shadow samples that are evaluated together in mode `exact`.
const SHADOW_SAMPLES: usize = 1 << 20;

/// What all rays share.
pub(super) struct Stage<'a> {
    pub(super) scene: &'a Scene,
    pub(super) settings: &'a MarchSettings,
    pub(super) medium: Medium,
    pub(super) lights: Vec<DeltaLight>,
    pub(super) world: [f64; 3],
    pub(super) directions: Vec<DVec3>,
    pub(super) grid: Option<LightGrid>,
}

/// A view ray on its way through the medium.
pub(super) struct ViewRay {
    pub(super) origin: DVec3,
    pub(super) direction: DVec3,
    /// The same in the object's frame, per metre of world space.
    pub(super) local_origin: DVec3,
    pub(super) local_direction: DVec3,
    pub(super) start: f64,
    pub(super) step: f64,
    pub(super) steps: usize,
    pub(super) next: usize,
    pub(super) transmittance: [f64; 3],
    pub(super) radiance: [f64; 3],
}

/// A step with something in it.
struct Sample {
    ray: usize,
    local: DVec3,
    distance: f64,
}

/// Renders on all cores, or on the adapter. `settings` are resolved.
pub fn render(scene: &Scene, settings: &MarchSettings, gpu: Option<&Gpu>, progress: Progress<'_>) -> Result<Image> {
    let bounces = scene.integrator.volume_bounces.min(scene.integrator.max_bounces);
    if bounces != 0 {
        return Err(Error::new(
            "$.integrator.volume_bounces",
            bounces.to_string(),
            "0: ray marching computes single scattering",
            "Give --volume-bounces 0.",
        ));
    }
    if let Some(image) = &scene.world.image {
        return Err(Error::new(
            "$.world.image",
            format!("the picture \"{}\"", image.file),
            "a constant world: ray marching knows no other",
            "Leave the picture out, or give --integrator path.",
        ));
    }
    let size = scene.image_size();
    let camera = Camera::new(scene, size)?;
    let world = world_radiance(scene);
    let directions = if world == [0.0; 3] { Vec::new() } else { sphere_directions(settings.world_directions as usize) };
    let mut stage = Stage {
        scene,
        settings,
        medium: Medium::new(scene)?,
        lights: delta_lights(scene)?,
        world,
        directions,
        grid: None,
    };
    let report = |done: f64| progress(0.5 * done, "light grid");
    // Where nothing is, no ray asks for light.
    let kernels = match (gpu, settings.light) {
        _ if stage.medium.occupied.is_empty() => None,
        (Some(gpu), _) => Some(Kernels::bake(gpu, &stage, &report)?),
        (None, LightMode::Grid) => {
            let lit_by_world = !stage.directions.is_empty();
            stage.grid = Some(LightGrid::bake(&stage.medium, &stage.lights, lit_by_world, settings, &report)?);
            None
        }
        (None, LightMode::Exact) => None,
    };
    let begun = if settings.light == LightMode::Grid { 0.5 } else { 0.0 };
    let [width, height] = size.map(|side| side as usize);
    let mut image = Image::new(width, height);
    let strata = settings.sub_pixels as usize;
    let offsets = film::offsets(scene.film.pixel_filter, f64::from(scene.film.filter_width), strata);
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
                stage.view_ray(&camera, DVec2::new(column, line))
            })
            .collect();
        match &kernels {
            Some(kernels) => kernels.march(&mut rays)?,
            None => stage.march(&mut rays)?,
        }
        for (pixel, rays) in pixels.zip(rays.chunks(per_pixel)) {
            image.pixels[pixel] = stage.pixel(rays);
        }
        let done = (first + pixels_per_pass) as f64 / image.pixels.len() as f64;
        progress(begun + (1.0 - begun) * done.min(1.0), "view rays");
    }
    Ok(image)
}

impl Stage<'_> {
    /// The part of a camera ray that lies in the medium, cut into steps; None where it misses.
    fn view_ray(&self, camera: &Camera, raster: DVec2) -> Option<ViewRay> {
        let ray = camera.ray(raster);
        let local_origin = self.medium.to_object.transform_point3(ray.origin);
        let local_direction = self.medium.to_object.transform_vector3(ray.direction);
        let (_, leave) = self.medium.bounds.segment(local_origin, local_direction)?;
        // Cycles leaves out a medium that reaches across the far clip.
        if leave > ray.far {
            return None;
        }
        let (enter, leave) = self.medium.occupied.segment(local_origin, local_direction)?;
        let start = enter.max(ray.near);
        if start >= leave {
            return None;
        }
        let steps = ((leave - start) / self.settings.view_step).ceil().max(1.0);
        Some(ViewRay {
            origin: ray.origin,
            direction: ray.direction,
            local_origin,
            local_direction,
            start,
            step: (leave - start) / steps,
            steps: steps as usize,
            next: 0,
            transmittance: [1.0; 3],
            radiance: [0.0; 3],
        })
    }

    /// Takes all rays to their ends.
    fn march(&self, rays: &mut [Option<ViewRay>]) -> Result<()> {
        loop {
            let mut samples = Vec::new();
            for (number, ray) in rays.iter_mut().enumerate() {
                let Some(ray) = ray.as_mut().filter(|ray| ray.is_open(self.settings)) else { continue };
                // Empty cells cost nothing: go on until a step holds something.
                let mut found = 0;
                while found < STEPS && ray.next < ray.steps {
                    let distance = ray.start + (ray.next as f64 + 0.5) * ray.step;
                    let local = ray.local_origin + ray.local_direction * distance;
                    if self.medium.may_hold(local) {
                        samples.push(Sample { ray: number, local, distance });
                        found += 1;
                    }
                    ray.next += 1;
                }
            }
            if samples.is_empty() {
                return Ok(());
            }
            let positions: Vec<[f32; 3]> = samples.iter().map(|sample| sample.local.as_vec3().to_array()).collect();
            let densities = self.medium.densities(&positions)?;
            let incident = self.incident(&samples, &densities, rays)?;
            for ((sample, &density), incident) in samples.iter().zip(&densities).zip(&incident) {
                let ray = rays[sample.ray].as_mut().expect("samples belong to rays in the medium");
                ray.advance(&self.medium, f64::from(density), incident);
            }
        }
    }

    /// Light that a unit of scattering sends towards the camera, per sample and channel.
    fn incident(&self, samples: &[Sample], densities: &[f32], rays: &[Option<ViewRay>]) -> Result<Vec<[f64; 3]>> {
        let ray_of = |sample: &Sample| rays[sample.ray].as_ref().expect("samples belong to rays in the medium");
        let Some(grid) = &self.grid else { return self.incident_by_shadow_rays(samples, densities, &ray_of) };
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
                let mut light = self.delta_light(ray, sample.distance, depths);
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
    fn delta_light(&self, ray: &ViewRay, distance: f64, depths: impl Iterator<Item = f64>) -> [f64; 3] {
        let position = ray.origin + ray.direction * distance;
        let mut light = [0.0; 3];
        for (source, depth) in self.lights.iter().zip(depths) {
            let (towards, _, power) = source.arriving(position);
            let phase = henyey_greenstein(self.medium.anisotropy, towards.dot(ray.direction));
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
        let longest = (self.medium.occupied.high - self.medium.occupied.low).length()
            / self.medium.to_object.x_axis.truncate().length().min(1e300);
        let per_ray = (longest / self.settings.shadow_step).ceil().max(1.0) as usize;
        let together = (SHADOW_SAMPLES / (rays_per_sample * per_ray)).max(1);
        for lit in lit.chunks(together) {
            let mut positions = Vec::new();
            // Number of samples and length of a step, ray by ray.
            let mut shadows = Vec::new();
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
                    let segment = self.medium.occupied.segment(sample.local, way);
                    let length = segment.map_or(0.0, |(_, leave)| leave.clamp(0.0, distance));
                    let steps = (length / self.settings.shadow_step).ceil();
                    let step = if steps == 0.0 { 0.0 } else { length / steps };
                    for number in 0..steps as usize {
                        let place = sample.local + way * ((number as f64 + 0.5) * step);
                        positions.push(place.as_vec3().to_array());
                    }
                    shadows.push((steps as usize, step));
                }
            }
            let found = self.medium.densities(&positions)?;
            let mut rest = found.as_slice();
            let depths: Vec<f64> = shadows
                .iter()
                .map(|&(steps, step)| {
                    let (own, others) = rest.split_at(steps);
                    rest = others;
                    own.iter().map(|&density| f64::from(density)).sum::<f64>() * step
                })
                .collect();
            for (&index, depths) in lit.iter().zip(depths.chunks(rays_per_sample)) {
                let ray = ray_of(&samples[index]);
                let (near, around) = depths.split_at(self.lights.len());
                let mut light = self.delta_light(ray, samples[index].distance, near.iter().copied());
                // Divided by its own sum, the quadrature of the phase function is exact in total.
                let phases: Vec<f64> = self
                    .directions
                    .iter()
                    .map(|towards| henyey_greenstein(self.medium.anisotropy, towards.dot(ray.direction)))
                    .collect();
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
        // NaN counts as open: it has to reach the picture.
        let dark = self.transmittance.iter().all(|&through| through < settings.exit_transmittance);
        self.next < self.steps && !dark
    }

    /// Goes one step through constant coefficients.
    fn advance(&mut self, medium: &Medium, density: f64, incident: &[f64; 3]) {
        for (channel, incident) in incident.iter().enumerate() {
            let depth = medium.extinction[channel] * density * self.step;
            let source = medium.scattering[channel] * density * incident + medium.emission[channel];
            // (1 - exp(-depth)) / extinction, without the division by zero.
            let length = if depth < 1e-8 { self.step } else { -(-depth).exp_m1() / depth * self.step };
            self.radiance[channel] += self.transmittance[channel] * source * length;
            self.transmittance[channel] *= (-depth).exp();
        }
    }
}
