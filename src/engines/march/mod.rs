//! The march of a real-time engine: a fixed number of equal steps through the box of a density model, lit by a light model.
//!
//! Unlike [`super::march`], which computes single scattering as a reference does, this one computes what engines compute: the light
//! at a sample is a model ([`crate::engines::light`]), thin samples are skipped, rays end early, and published forms keep their defects.
//! Everything is f64; the twin on the adapter is `shaders/engines/march.wgsl`.
//!
//! A ray that crosses the box from t0 to t1 takes `steps` samples at t0 + (i + j) s with s = (t1 - t0) / steps and jitter j in
//! [0, 1]. With the density's extinction e and source S at a sample, the transmittance T as it was before,
//!
//! - plain: C += T S s;
//! - energy-conserving: C += T S (1 - exp(-e s)) / e (Hillaire 2015, "Physically Based and Unified Volumetric Rendering in
//!   Frostbite");
//!
//! and T *= exp(-e s).

pub mod adapter;

use crate::base::error::{Error, Result};
use crate::engines::light::{LightModel, ShadowExtinction, ShadowLength, SourceFactor};
use crate::media::averages::CoarseDensity;
use crate::media::density::DensityModel;
use crate::media::medium::Region;
use crate::media::transfer::Integration;
use crate::media::transfer::{step_weight, transmittance};
use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The box that every density model lives in.
pub const BOX: Region = Region { low: DVec3::splat(-0.5), high: DVec3::splat(0.5) };

/// A crossing shorter than this, in sides of the box, is left out.
const SHORTEST: f64 = 1e-3;

/// Rays of a task.
const RAYS: usize = 64;

/// How a ray is marched.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RealTimeSettings {
    /// Steps of a ray; at least 1.
    pub steps: u32,
    /// How a step adds its light.
    pub integration: Integration,
    /// Whether the source fades to nothing over the last two steps of a ray, while its extinction stays (defect PF-9).
    pub exit_fade: bool,
    /// Samples of at most this density are skipped.
    pub least_density: f64,
    /// A ray ends when its transmittance, as a vector of the channels, is shorter than this.
    pub least_transmittance: f64,
}

/// A ray to be marched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RealTimeRay {
    /// Start in the local box's frame.
    pub origin: DVec3,
    /// Direction in the same frame, of any length but 0: distances along the ray are in sides of the box.
    pub direction: DVec3,
    /// Distance along the ray beyond which something opaque hides the cloud; infinite where nothing does.
    pub farthest: f64,
    /// Part of a step before the first sample, 0 to 1.
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
}

/// The part of a ray that lies in the box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inside {
    /// Where it begins: where the ray enters the box, or its start.
    pub origin: DVec3,
    /// Unit direction.
    pub direction: DVec3,
    /// Its length; 0 where the ray misses the box or crosses less than a thousandth of a side.
    pub length: f64,
    /// Distance from `origin` beyond which something opaque hides the cloud.
    pub farthest: f64,
}

impl RealTimeRay {
    /// The part of the ray in the box, in f64 for both backends: a start far away costs no accuracy. A ray without a direction
    /// misses the box.
    pub fn inside(&self) -> Inside {
        let direction = unit(self.direction).unwrap_or(DVec3::ZERO);
        let missed = Inside { origin: self.origin, direction, length: 0.0, farthest: self.farthest };
        let Some((enter, leave)) = BOX.segment(self.origin, direction).filter(|_| direction != DVec3::ZERO) else {
            return missed;
        };
        let start = enter.max(0.0);
        let length = leave - start;
        if length.is_nan() || length < SHORTEST {
            return missed;
        }
        Inside { origin: self.origin + direction * start, direction, length, farthest: self.farthest - start }
    }
}

/// A vector of length 1 in its direction, whatever its length: the square of a short one would be 0. None for 0 and for what is not finite.
pub fn unit(vector: DVec3) -> Option<DVec3> {
    let largest = vector.abs().max_element();
    (largest > 0.0 && vector.is_finite()).then(|| (vector / largest).normalize())
}

/// A ray on its way.
struct Way {
    inside: Inside,
    jitter: f64,
    /// Of the octaves of the light, phase functions included.
    weights: Vec<f64>,
    is_done: bool,
    pixel: RealTimePixel,
}

/// The averages of the density that a light model reads, if it reads any; an error where the density gives none.
pub fn averages<'a>(density: &'a dyn DensityModel, light: &LightModel) -> Result<Option<&'a CoarseDensity>> {
    if !light.terms.needs_coarse() {
        return Ok(None);
    }
    density.coarse().map(Some).ok_or_else(|| {
        Error::new(
            "the march of an engine",
            "a density without averages",
            "averages, which the light terms body and coarse shadow read",
            "Give the density with its averages (density::coarse::WithCoarse), or leave these terms out.",
        )
    })
}

/// Marches rays on all cores; pixels in the order of the rays. An error where the light reads averages that the density does not give.
pub fn march(
    density: &dyn DensityModel,
    light: &LightModel,
    settings: &RealTimeSettings,
    rays: &[RealTimeRay],
) -> Result<Vec<RealTimePixel>> {
    let coarse = averages(density, light)?;
    Ok(rays.par_chunks(RAYS).flat_map_iter(|rays| march_together(density, coarse, light, settings, rays)).collect())
}

/// Marches rays step by step together, so that the density gets batches.
fn march_together(
    density: &dyn DensityModel,
    coarse: Option<&CoarseDensity>,
    light: &LightModel,
    settings: &RealTimeSettings,
    rays: &[RealTimeRay],
) -> Vec<RealTimePixel> {
    let to_sun = light.to_sun();
    let extinction = density.extinction();
    let mean_extinction = extinction.iter().sum::<f64>() / 3.0;
    let body = coarse.filter(|_| light.terms.body.strength > 0.0);
    let mut ways: Vec<Way> = rays.iter().map(|ray| Way::new(ray, light, to_sun)).collect();
    for number in 0..settings.steps {
        let mut samples = Vec::new();
        for (index, way) in ways.iter_mut().enumerate().filter(|(_, way)| !way.is_done) {
            let step = way.inside.length / f64::from(settings.steps);
            let passed = (f64::from(number) + way.jitter) * step;
            let left = way.inside.length - passed;
            if passed > way.inside.farthest || left < 0.0 {
                way.is_done = true;
                continue;
            }
            way.pixel.samples += 1;
            samples.push((index, way.inside.origin + way.inside.direction * passed, step, left));
        }
        if samples.is_empty() {
            break;
        }
        let places: Vec<DVec3> = samples.iter().map(|sample| sample.1).collect();
        let densities = density.densities(&places);
        // What is no number counts, so that it is seen in the picture.
        let is_dense = |&at: &usize| densities[at] > settings.least_density || densities[at].is_nan();
        let dense: Vec<usize> = (0..samples.len()).filter(is_dense).collect();
        let lit: Vec<DVec3> = dense.iter().map(|&at| places[at]).collect();
        let depths = shadow_depths(density, coarse, light, to_sun, &lit);
        for ((&at, depth), place) in dense.iter().zip(depths).zip(lit) {
            let (index, _, step, left) = samples[at];
            let fade = if settings.exit_fade { crate::media::transfer::smooth(0.0, 2.0 * step, left) } else { 1.0 };
            let way = &mut ways[index];
            way.pixel.dense += 1;
            let powder = light.terms.powder.factor(densities[at] * mean_extinction);
            let share = light.terms.powder.ambient;
            let around = body.map_or(1.0, |coarse| light.terms.body.factor(coarse.around(place) * mean_extinction));
            let sun_factor = fade * powder * around;
            let ambient_factor = fade * light.ambient_factor(place.y) * (1.0 + (powder - 1.0) * share);
            for channel in 0..3 {
                let extinct = densities[at] * extinction[channel];
                let factor = match light.source {
                    SourceFactor::Density => densities[at],
                    SourceFactor::Albedo(albedo) => albedo[channel] * extinct,
                };
                let scattered = light.terms.octaves.sum(&way.weights, depth[channel]);
                let ambient = light.ambient[channel] * ambient_factor;
                let source = factor * (light.sun[channel] * scattered * sun_factor + ambient);
                let through = transmittance(extinct * step);
                let weight = step_weight(settings.integration, extinct, step);
                way.pixel.radiance[channel] += way.pixel.transmittance[channel] * source * weight;
                way.pixel.transmittance[channel] *= through;
            }
            way.is_done = DVec3::from(way.pixel.transmittance).length() < settings.least_transmittance;
        }
    }
    ways.into_iter().map(|way| way.pixel).collect()
}

/// Optical depth towards the sun at each place, per channel, as it counts for the octaves.
fn shadow_depths(
    density: &dyn DensityModel,
    coarse: Option<&CoarseDensity>,
    light: &LightModel,
    to_sun: DVec3,
    places: &[DVec3],
) -> Vec<[f64; 3]> {
    let steps = light.shadow.steps;
    let scale = match light.shadow.extinction {
        ShadowExtinction::Density => [1.0; 3],
        ShadowExtinction::View => density.extinction(),
    };
    let lengths: Vec<f64> = places
        .iter()
        .map(|&place| match light.shadow.length {
            ShadowLength::Fixed(length) => length,
            ShadowLength::ToExit => BOX.segment(place, to_sun).map_or(0.0, |(_, leave)| leave.max(0.0)),
        })
        .collect();
    let mut owners = Vec::new();
    let mut asked = Vec::new();
    for (index, (&place, length)) in places.iter().zip(&lengths).enumerate() {
        for number in 0..steps {
            let at = place + to_sun * (length * (f64::from(number) + 0.5) / f64::from(steps));
            // On a face is outside.
            if at.abs().max_element() < 0.5 {
                owners.push(index);
                asked.push(at);
            }
        }
    }
    let mut sums = vec![0.0; places.len()];
    let found = match coarse.filter(|_| light.terms.body.shadow) {
        Some(coarse) => asked.iter().map(|&place| coarse.along(place)).collect(),
        None => density.densities(&asked),
    };
    for (owner, found) in owners.into_iter().zip(found) {
        sums[owner] += found;
    }
    let octaves = &light.terms.octaves;
    let depths = sums.iter().zip(&lengths).map(|(sum, length)| sum * length / f64::from(steps));
    depths.map(|depth| scale.map(|scale| octaves.compressed(scale * depth))).collect()
}

impl Way {
    fn new(ray: &RealTimeRay, light: &LightModel, to_sun: DVec3) -> Self {
        let inside = ray.inside();
        Self {
            inside,
            jitter: ray.jitter,
            weights: light.weights(inside.direction.dot(to_sun)),
            is_done: inside.length == 0.0,
            pixel: RealTimePixel { radiance: [0.0; 3], transmittance: [1.0; 3], samples: 0, dense: 0 },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_of_any_length_and_start_cross_alike() {
        let direction = DVec3::new(0.6, -0.3, 0.7).normalize();
        let ray = |origin: DVec3, direction: DVec3| RealTimeRay { origin, direction, farthest: 1e7, jitter: 0.5 };
        let near = ray(-direction, direction).inside();
        assert!(near.length > 0.5 && (near.direction.length() - 1.0).abs() < 1e-15);
        for scale in [1e-200, 1e-6, 3.0, 1e200] {
            let found = ray(-direction, direction * scale).inside();
            assert!(
                (found.length - near.length).abs() < 1e-12 && found.origin.distance(near.origin) < 1e-12,
                "{scale}"
            );
        }
        // 1e6 sides away f64 holds places to 1e-10.
        let far = ray(-direction * 1e6, direction).inside();
        assert!((far.length - near.length).abs() < 1e-9 && far.origin.distance(near.origin) < 1e-9);
        assert!((far.farthest - (1e7 - 1e6)).abs() < 1.0);
    }

    #[test]
    fn what_misses_grazes_or_goes_nowhere_has_no_length() {
        let none = |origin: [f64; 3], direction: [f64; 3]| {
            let (origin, direction) = (DVec3::from(origin), DVec3::from(direction));
            let found = RealTimeRay { origin, direction, farthest: 1.0, jitter: 0.5 }.inside();
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
