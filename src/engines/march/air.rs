//! Air between the eye and what it sees: haze and aerial perspective of @takram/three-clouds with the cloud's shadows in both (chapters 6.10 and
//! 6.11 of the systems' descriptions), and the god rays that boltbestclouds32 sums up in its march (5.3). What a ray came to is changed before
//! it is put over a background, because each needs the distance at which the cloud stands.
//!
//! Lengths are metres here. A ray starts at a height h and rises by m per metre; D is the *front*, the mean distance at which the cloud takes
//! light away, a its opacity, E a sun's irradiance, A the ambient radiance, P(c) the cloud's phase function, T the cloud's transmittance and C its
//! radiance. A length l of a medium whose density falls by 1/e in H metres holds
//!
//! ```text
//! k(l) = exp(-h / H) l (1 - exp(-l m / H)) / (l m / H)
//! ```
//!
//! - **Aerial perspective**: air scatters as Rayleigh found (H = 8 km) and haze in it (1.2 km); with its depth t(l) and the phase functions p_i
//!   C' = C exp(-t(D)) + a I,  I = sum_i integral_0^(D - s) b_i exp(-z / H_i) (E p_i + A) exp(-t(l)) dl, in sixteen parts of the way, in each of which the shares
//!   of both are constant; they are shortest, by squares, where the ray is lowest. Coefficients: [`RAYLEIGH`], [`MIE`]; the haze keeps a tenth of what it takes, as in Bruneton's air of 2017. Ozone is left out.
//! - **Haze** of a density d at the height 0: w = d k(l), H = 1 km, to the distance l at which the ground or 200 km end the view, as
//!   published the layer's upper face, too, and in so far as the cloud is opaque its front.  C'' = C' exp(-w) + albedo (E P + 0.625 A) (1 - exp(-(w - w(s)))),  T'' = T exp(-w).
//! - **Shafts**: s, the length of the way that lies in the cloud's shadow, sum over steps of (1 - exp(-depth towards the sun)) times their length, which
//!   grows by a hundredth from 50 m on, of a shadow map alone. Without them s = 0. It is taken from the far end of the air and from the near end
//!   of the haze. The way begins and ends at the domain's upper face, as our map has all layers, not at that of the layers that cast shadows.
//! - **Rays in the march**: over at most 500 m, C += 0.01 / pi x intensity x sum over suns of E sum_i v_i f_i 0.95^i, f = density exp(-z / 1 km). As published v is
//!   1 less half the cloud's density there, and the sum depends on the number of its samples (BO-15, a number of ours); corrected v is what the cloud lets
//!   through from the sun, and a sample stands for its length over the 31.25 m of the published sixteen.
//!
//! Where a ray falls, k is that of the way back up from its end, which is the same integral; as published haze counts a falling ray as level (TK-18, of
//! ours, with its end at the upper face). Twin on the adapter: `shaders/engines/air.wgsl`, with what reads the density in `march.wgsl`.

use crate::base::arrays::{Mapped, each};
use crate::base::error::Result;
use crate::engines::domain::Outline;
use crate::engines::light::LightModel;
use crate::engines::march::shadow_map::ShadowMap;
use crate::engines::march::{Marched, Read, RealTimePixel, RealTimeRay};
use crate::media::phase::draine;
use crate::media::transfer::{absorbed, mean_transmittance, transmittance};
use crate::shader_struct;
use bytemuck::Zeroable;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Farthest that air is looked through, in metres.
const FARTHEST: f64 = 200_000.0;

/// Scattering of air at the height 0 per metre.
pub const RAYLEIGH: [f64; 3] = [5.802e-6, 1.3558e-5, 3.31e-5];

/// Scattering of the haze in it, alike for all channels, and what it takes over what it scatters.
pub const MIE: f64 = 3.996e-6;
const MIE_EXTINCTION: f64 = MIE / 0.9;

/// Metres in which air, and the haze in it, fall by 1/e.
const AIR_HEIGHTS: [f64; 2] = [8000.0, 1200.0];

/// Anisotropy of the haze in air, by Cornette and Shanks.
const MIE_ANISOTROPY: f64 = 0.8;

/// Parts of the way through air.
const AIR_PARTS: u32 = 16;

/// Metres in which haze, and that of rays in the march, fall by 1/e.
const HAZE_HEIGHT: f64 = 1000.0;

/// Haze at the eye, per metre, below which published haze is left out.
const LEAST_HAZE: f64 = 1e-7;

/// Sky light in haze: 2.5 / (4 pi) of its irradiance, pi times its radiance.
const HAZE_AMBIENT: f64 = 0.625;

/// Rise of a falling or level ray in published haze.
const LEAST_RISE: f64 = 1e-5;

/// The first step of shafts in metres, what a step has over the one before, and most of them.
const SHAFT_STEP: f64 = 50.0;
const SHAFT_GROWTH: f64 = 1.01;
const SHAFT_STEPS: u32 = 500;

/// What a step of shafts counts over the one before as published (TK-11).
const SHAFT_FADE: f64 = 0.999;

/// Metres over which rays in the march are summed, samples over which their constants hold, and what a sample counts over the one before.
const RAY_LENGTH: f64 = 500.0;
const RAY_SAMPLES: f64 = 16.0;
const RAY_DECAY: f64 = 0.95;

/// Air, where an engine has some.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Air {
    /// Metres of the unit of length.
    pub metres: f64,
    /// A place's height in metres: the third coordinate of the density's frame times the first, plus the second.
    pub height: [f64; 2],
    /// Height of the layer's upper face in metres.
    pub top: f64,
    /// Haze.
    pub haze: Option<Haze>,
    /// Aerial perspective: the density of the air over that of the earth.
    pub aerial: Option<f64>,
    /// Shadows of the cloud in both.
    pub shafts: Option<Shafts>,
    /// God rays in the march.
    pub rays: Option<MarchRays>,
    /// Whether the cloud's radiance, weighted already, is multiplied by its opacity before (defect BO-2, which air in front of it has not).
    pub alpha_twice: bool,
}

/// Haze.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Haze {
    /// At the height 0, per metre.
    pub density: f64,
    /// Single-scattering albedo.
    pub albedo: f64,
    /// Whether it ends at the layer's upper face, and falling rays count as level (defect TK-18).
    pub is_level: bool,
}

/// Shadows of the cloud in the air.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Shafts {
    /// Whether steps count less with their number (defect TK-11).
    pub fades: bool,
    /// What their length is multiplied with, 0 to 1.
    #[serde(default = "whole")]
    pub strength: f64,
}

fn whole() -> f64 {
    1.0
}

/// God rays that are summed up along the first metres of a ray.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MarchRays {
    /// Factor on them.
    pub intensity: f64,
    /// Density of the fog that they light.
    pub density: f64,
    /// Samples of a ray; at least 1.
    pub samples: u32,
    /// Whether a sample loses half the cloud's density where it lies, whatever its length (defect BO-15).
    pub counts_samples: bool,
}

/// A ray as air knows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Where it starts, in metres above the ground.
    pub height: f64,
    /// Metres of height per metre of the ray, -1 to 1.
    pub rise: f64,
    /// Metres to what ends the view.
    pub limit: f64,
}

impl Line {
    /// Length of the part up to `length`, weighted by a density that is 1 at the height 0 and falls by 1/e in `fall` metres. A ray whose lower end
    /// lies below 0 counts as one that has it there.
    fn column(&self, length: f64, fall: f64) -> f64 {
        let lowest = self.height + (self.rise * length).min(0.0);
        transmittance(lowest.max(0.0) / fall) * length * mean_transmittance(length * self.rise.abs() / fall)
    }

    /// Depth of earth's air up to a length, per channel.
    pub fn air_depth(&self, length: f64) -> [f64; 3] {
        let [air, haze] = AIR_HEIGHTS.mapped(|fall| self.column(length, fall));
        RAYLEIGH.mapped(|scattering| scattering * air + MIE_EXTINCTION * haze)
    }

    /// Radiance that the air up to a length sends back, for sources of its two parts per unit of scattering.
    fn air_light(&self, density: f64, length: f64, sources: [[f64; 3]; 2], parts: u32) -> [f64; 3] {
        let mut before = [0.0; 2];
        let mut sum = [0.0; 3];
        let mut left = [1.0; 3];
        for part in 1..=parts {
            let passed = f64::from(part) / f64::from(parts);
            let end = length * if self.rise < 0.0 { 1.0 - (1.0 - passed).powi(2) } else { passed * passed };
            let columns = AIR_HEIGHTS.mapped(|fall| density * self.column(end, fall));
            // A column that falls towards its end is no sum of parts to the last bit.
            let [air, haze] = [0, 1].mapped(|medium: usize| (columns[medium] - before[medium]).max(0.0));
            before = columns;
            for channel in 0..3 {
                let depth = RAYLEIGH[channel] * air + MIE_EXTINCTION * haze;
                let scattered = RAYLEIGH[channel] * air * sources[0][channel] + MIE * haze * sources[1][channel];
                sum[channel] += left[channel] * scattered * mean_transmittance(depth);
                left[channel] *= transmittance(depth);
            }
        }
        sum
    }
}

impl Haze {
    /// Depth of it up to a length of a ray.
    pub fn depth(&self, line: &Line, length: f64) -> f64 {
        if !self.is_level {
            return self.density * line.column(length, HAZE_HEIGHT);
        }
        let at_eye = self.density * transmittance(line.height.max(0.0) / HAZE_HEIGHT);
        if at_eye < LEAST_HAZE {
            return 0.0;
        }
        at_eye * length * mean_transmittance(length * line.rise.max(LEAST_RISE) / HAZE_HEIGHT)
    }
}

impl Air {
    /// Air without any of it, in the frame of a slab: metres of the unit, height of a place, height of the upper face.
    pub fn none(metres: f64, height: [f64; 2], top: f64) -> Self {
        Self { metres, height, top, haze: None, aerial: None, shafts: None, rays: None, alpha_twice: false }
    }

    /// Whether anything is seen of it.
    pub fn is_seen(&self) -> bool {
        self.haze.is_some() || self.aerial.is_some() || self.rays.is_some()
    }

    fn height(&self, place: DVec3) -> f64 {
        self.height[0] * place.z + self.height[1]
    }

    /// A ray in it.
    pub fn line(&self, ray: &RealTimeRay) -> Line {
        Line {
            height: self.height(ray.origin),
            rise: (ray.way.z * self.height[0] / self.metres).clamp(-1.0, 1.0),
            limit: (ray.farthest * self.metres).min(FARTHEST),
        }
    }

    /// Metres to the ground, or to a height above.
    fn end(line: &Line, top: f64) -> f64 {
        let end = if line.rise < 0.0 && line.height > 0.0 {
            line.height / -line.rise
        } else if line.rise > 0.0 {
            (top - line.height).max(0.0) / line.rise
        } else {
            f64::INFINITY
        };
        end.min(line.limit)
    }

    /// Height at which haze ends.
    fn haze_top(&self) -> f64 {
        if self.haze.is_some_and(|haze| haze.is_level) { self.top } else { f64::INFINITY }
    }

    /// Metres of a ray up to `end` that lie in the shadow of the cloud from a sun.
    fn shadow(&self, marched: &Marched<'_>, sun: usize, ray: &RealTimeRay, line: &Line, end: f64) -> f64 {
        let Some(shafts) = &self.shafts else { return 0.0 };
        let maps = marched.maps_of(sun);
        let extinction = marched.extinction.iter().sum::<f64>() / 3.0;
        let mut begin = match line.height > self.top {
            true if line.rise < 0.0 => (line.height - self.top) / -line.rise,
            true => return 0.0,
            false => 0.0,
        };
        let (mut step, mut weight, mut sum) = (SHAFT_STEP, 1.0, 0.0);
        for _ in 0..SHAFT_STEPS {
            if begin >= end {
                break;
            }
            let whole = step.min(end - begin);
            let place = ray.origin + ray.way * ((begin + ray.jitter * whole) / self.metres);
            let dense = ShadowMap::chosen(maps, place, ray.jitter).map_or(0.0, |map| map.read_below(place, 0.0));
            sum += weight * whole * absorbed(extinction * dense);
            begin += step;
            step *= SHAFT_GROWTH;
            weight *= if shafts.fades { SHAFT_FADE } else { 1.0 };
        }
        shafts.strength * sum
    }

    /// Aerial perspective and haze over what a ray came to.
    fn over(&self, marched: &Marched<'_>, ray: &RealTimeRay, pixel: &mut RealTimePixel) {
        let light = marched.light;
        if self.alpha_twice {
            for (radiance, through) in pixel.radiance.iter_mut().zip(pixel.transmittance) {
                *radiance *= 1.0 - through;
            }
        }
        if self.aerial.is_none() && self.haze.is_none() {
            return;
        }
        let line = self.line(ray);
        let opacity = 1.0 - pixel.transmittance.iter().sum::<f64>() / 3.0;
        let front = pixel.distance.map(|distance| distance * self.metres);
        let seen = |end: f64| end + opacity * (front.unwrap_or(f64::INFINITY).min(end) - end);
        let end = seen(Self::end(&line, self.haze_top()));
        let dark = seen(Self::end(&line, self.top));
        let suns = light.suns.len().max(1);
        let shadows: Vec<f64> = (0..suns).map(|sun| self.shadow(marched, sun, ray, &line, dark)).collect();
        if let (Some(density), Some(front)) = (self.aerial, front) {
            let mut scattered = [0.0; 3];
            for (sun, shadow) in shadows.iter().enumerate() {
                let sources = Self::air_sources(light, sun, ray.direction);
                let found = line.air_light(density, (front - shadow).max(0.0), sources, AIR_PARTS);
                (0..3).for_each(|channel| scattered[channel] += found[channel]);
            }
            let depth = line.air_depth(front);
            for channel in 0..3 {
                let own = pixel.radiance[channel] * transmittance(density * depth[channel]);
                pixel.radiance[channel] = own + (1.0 - pixel.transmittance[channel]) * scattered[channel];
            }
        }
        if let Some(haze) = &self.haze {
            let depth = haze.depth(&line, end);
            let mut scattered = [0.0; 3];
            for (sun, shadow) in shadows.iter().enumerate() {
                let lit = absorbed((depth - haze.depth(&line, shadow.min(end))).max(0.0));
                let source = Self::haze_source(light, sun, ray.direction);
                (0..3).for_each(|channel| scattered[channel] += haze.albedo * source[channel] * lit);
            }
            for channel in 0..3 {
                pixel.radiance[channel] = pixel.radiance[channel] * transmittance(depth) + scattered[channel];
                pixel.transmittance[channel] *= transmittance(depth);
            }
        }
    }

    /// What air and the haze in it scatter towards the eye per unit of scattering, of a sun; the ambient light goes with the first.
    fn air_sources(light: &LightModel, number: usize, direction: DVec3) -> [[f64; 3]; 2] {
        let sun = light.suns.get(number);
        let cosine = sun.map_or(0.0, |sun| direction.dot(sun.towards()));
        let phases = [3.0 / (16.0 * PI) * (1.0 + cosine * cosine), draine(MIE_ANISOTROPY, 1.0, cosine)];
        phases.mapped(|phase| {
            each(|channel| {
                let direct = sun.map_or(0.0, |sun| sun.irradiance[channel] * phase);
                direct + if number == 0 { light.ambient[channel] } else { 0.0 }
            })
        })
    }

    /// The same of the cloud's haze, whose albedo it leaves out.
    fn haze_source(light: &LightModel, number: usize, direction: DVec3) -> [f64; 3] {
        let sun = light.suns.get(number);
        let phase = sun.map_or(0.0, |sun| light.phase.evaluate(direction.dot(sun.towards())));
        each(|channel| {
            let direct = sun.map_or(0.0, |sun| sun.irradiance[channel] * phase);
            direct + if number == 0 { HAZE_AMBIENT * light.ambient[channel] } else { 0.0 }
        })
    }

    /// Air over what rays came to.
    pub(super) fn apply(
        &self,
        marched: &Marched<'_>,
        rays: &[RealTimeRay],
        pixels: &mut [RealTimePixel],
    ) -> Result<()> {
        for (ray, pixel) in rays.iter().zip(pixels.iter_mut()) {
            self.over(marched, ray, pixel);
        }
        let Some(of_march) = &self.rays else { return Ok(()) };
        let averages = marched.averages_read();
        let mut read = Read::new(marched, &averages)?;
        let count = f64::from(of_march.samples);
        let mut places = Vec::with_capacity(rays.len() * of_march.samples as usize);
        let mut weights = Vec::with_capacity(places.capacity());
        for ray in rays {
            let length = (ray.farthest * self.metres).min(RAY_LENGTH);
            for number in 0..of_march.samples {
                let part = (f64::from(number) + ray.jitter) / count;
                let place = ray.origin + ray.way * (part * length / self.metres);
                places.push(place);
                let fog = of_march.density * transmittance(self.height(place).max(0.0) / HAZE_HEIGHT);
                weights.push(fog * of_march.weight(number, length));
            }
        }
        let strength = 0.01 / PI * of_march.intensity;
        let samples = of_march.samples as usize;
        let mut add = |sun: usize, let_through: &dyn Fn(usize) -> [f64; 3]| {
            let irradiance = marched.light.suns[sun].irradiance;
            for (index, weight) in weights.iter().enumerate() {
                let through = let_through(index);
                for channel in 0..3 {
                    pixels[index / samples].radiance[channel] +=
                        strength * irradiance[channel] * weight * through[channel];
                }
            }
        };
        let outline = &marched.container.outline;
        if of_march.counts_samples {
            let found = read.density.values(&places);
            let seen: Vec<f64> = found
                .iter()
                .zip(&places)
                .map(|(density, place)| if outline.holds(*place) { 1.0 - 0.5 * density } else { 1.0 })
                .collect();
            (0..marched.light.suns.len()).for_each(|sun| add(sun, &|index| [seen[index]; 3]));
            return Ok(());
        }
        let jitters: Vec<f64> = rays.iter().flat_map(|ray| std::iter::repeat_n(ray.jitter, samples)).collect();
        for sun in 0..marched.light.suns.len() {
            let way = read.ways_to_suns[sun];
            let towards = marched.light.suns[sun].towards();
            let cosines: Vec<f64> = rays
                .iter()
                .flat_map(|ray| std::iter::repeat_n(ray.direction.dot(towards).clamp(-1.0, 1.0), samples))
                .collect();
            let entered: Vec<Option<DVec3>> = places.iter().map(|&place| entered(outline, place, way)).collect();
            // What passes beside the domain is read where nobody looks at it.
            let asked: Vec<DVec3> =
                entered.iter().zip(&places).map(|(entered, place)| entered.unwrap_or(*place)).collect();
            let density = read.along.as_mut().unwrap_or(&mut read.density);
            let depths = marched.shadow_depths(density, (sun, way), &asked, &cosines, &jitters);
            add(sun, &|index| entered[index].map_or([1.0; 3], |_| depths[index].mapped(transmittance)));
        }
        Ok(())
    }
}

impl MarchRays {
    /// What a sample counts of a ray that is so many metres long.
    fn weight(&self, number: u32, length: f64) -> f64 {
        if self.counts_samples {
            return RAY_DECAY.powi(number as i32);
        }
        // Published samples that one of these stands for.
        let share = length / RAY_LENGTH * RAY_SAMPLES / f64::from(self.samples);
        share * RAY_DECAY.powf(share * f64::from(number))
    }
}

/// Where the way from a place towards a sun enters a box, or the place itself in it; none where it passes beside. Rays of the march know no other
/// domain ([`Marched::check`]).
fn entered(outline: &Outline, place: DVec3, way: DVec3) -> Option<DVec3> {
    let (enter, leave) = outline.region().segment(place, way)?;
    let start = enter.max(0.0);
    (leave > start).then(|| place + way * start)
}

shader_struct! {
    /// Uniforms of the twin.
    pub(crate) struct AirUniform = "air_Air" {
        metres: f32,
        slope: f32,
        base: f32,
        top: f32,
        haze_density: f32,
        haze_albedo: f32,
        aerial: f32,
        shaft_fade: f32,
        ray_strength: f32,
        pub(super) ray_samples: u32,
        ray_length: f32,
        ray_decay: f32,
        // Of the whole length.
        ray_weight: f32,
        shaft_strength: f32,
        padding: f32,
        end_padding: f32,
    }
}

impl AirUniform {
    pub(super) fn new(air: &Air) -> Self {
        let mut uniform = Self {
            metres: air.metres as f32,
            slope: air.height[0] as f32,
            base: air.height[1] as f32,
            top: air.top as f32,
            haze_density: air.haze.map_or(0.0, |haze| haze.density as f32),
            haze_albedo: air.haze.map_or(0.0, |haze| haze.albedo as f32),
            aerial: air.aerial.unwrap_or(0.0) as f32,
            shaft_strength: air.shafts.map_or(0.0, |shafts| shafts.strength as f32),
            shaft_fade: if air.shafts.is_some_and(|shafts| shafts.fades) { SHAFT_FADE as f32 } else { 1.0 },
            ..Self::zeroed()
        };
        if let Some(rays) = &air.rays {
            uniform.ray_strength = (0.01 / PI * rays.intensity * rays.density) as f32;
            uniform.ray_samples = rays.samples;
            uniform.ray_length = RAY_LENGTH as f32;
            let share = RAY_SAMPLES / f64::from(rays.samples);
            uniform.ray_weight = if rays.counts_samples { 1.0 } else { share as f32 };
            uniform.ray_decay = if rays.counts_samples { RAY_DECAY } else { RAY_DECAY.powf(share) } as f32;
        }
        uniform
    }
}

impl Air {
    /// Conditions of the twin.
    pub(super) fn definitions(&self, has_map: bool) -> Vec<&'static str> {
        let mut found = vec!["AIR"];
        let mut define = |is_wanted: bool, name: &'static str| found.extend(is_wanted.then_some(name));
        define(self.haze.is_some(), "AIR_HAZE");
        define(self.haze.is_some_and(|haze| haze.is_level), "AIR_LEVEL_HAZE");
        define(self.aerial.is_some(), "AIR_PERSPECTIVE");
        define(self.shafts.is_some() && has_map, "AIR_SHAFTS");
        define(self.rays.is_some(), "AIR_RAYS");
        define(self.rays.is_some_and(|rays| rays.counts_samples), "AIR_RAYS_BY_NUMBER");
        define(self.alpha_twice, "AIR_ALPHA_TWICE");
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The integral of exp(-z / fall) along a ray, by the midpoint rule: off by (length / parts)^2 / 24 fall^2 of it.
    fn integral(line: &Line, length: f64, fall: f64) -> f64 {
        const PARTS: u32 = 20_000;
        let step = length / f64::from(PARTS);
        let at = |part: u32| (-(line.height + line.rise * step * (f64::from(part) + 0.5)) / fall).exp();
        (0..PARTS).map(at).sum::<f64>() * step
    }

    const LINES: [Line; 5] = [
        Line { height: 1700.0, rise: 0.0, limit: 1e5 },
        Line { height: 20.0, rise: 0.3, limit: 1e5 },
        Line { height: 1700.0, rise: -0.05, limit: 1e5 },
        Line { height: 9000.0, rise: -0.9, limit: 1e5 },
        Line { height: 0.0, rise: 1e-7, limit: 1e5 },
    ];

    #[test]
    fn columns_are_integrals_over_rising_level_and_falling_rays() {
        for line in LINES {
            let most = if line.rise < 0.0 { line.height / -line.rise } else { 1e5 };
            for length in [1.0, 300.0, 9000.0, 1e5].map(|length: f64| length.min(most)) {
                for fall in [1000.0, 1200.0, 8000.0] {
                    let [found, wanted] = [line.column(length, fall), integral(&line, length, fall)];
                    let bound = ((length / 20_000.0 / fall).powi(2) / 24.0 + 1e-11) * wanted;
                    assert!((found - wanted).abs() <= bound, "{line:?}, {length} m: {found}, not {wanted}");
                }
            }
        }
    }

    #[test]
    fn published_haze_is_the_integral_where_rays_rise_and_level_where_they_fall() {
        let haze = Haze { density: 1.5e-5, albedo: 1.0, is_level: false };
        let published = Haze { is_level: true, ..haze };
        let rising = LINES[1];
        let [ours, theirs] = [haze, published].map(|haze| haze.depth(&rising, 9000.0));
        assert!((ours - theirs).abs() < 1e-12 && (ours - 1.5e-5 * integral(&rising, 9000.0, 1000.0)).abs() < 1e-9);
        // From 1700 m down to the ground there is more than along the level.
        let falling = LINES[2];
        let [ours, theirs] = [haze, published].map(|haze| haze.depth(&falling, 34_000.0));
        assert!((ours - 1.5e-5 * 1000.0 / 0.05 * (1.0 - (-1.7_f64).exp())).abs() < 1e-12, "{ours}");
        assert!((theirs - 1.5e-5 * (-1.7_f64).exp() * 34_000.0).abs() < 1e-3 * theirs && ours > 2.0 * theirs);
        // From high above, published haze is left out; it lies below all the same.
        let above = Line { height: 9000.0, rise: -0.9, limit: 1e5 };
        let [ours, theirs] = [haze, published].map(|haze| haze.depth(&above, 10_000.0));
        assert!(theirs == 0.0 && (ours - 1.5e-5 * 1000.0 / 0.9 * (1.0 - (-9.0_f64).exp())).abs() < 1e-12);
    }

    #[test]
    fn light_of_air_is_what_it_takes_and_its_parts_are_enough() {
        for line in LINES {
            let most = if line.rise < 0.0 { line.height / -line.rise } else { 1e5 };
            for (density, error) in [(1.0, 0.01), (3.0, 0.01), (20.0, 0.03)] {
                let length = most.min(5e4);
                // Rayleigh alone scatters all that it takes; the haze in it nine tenths.
                let found = line.air_light(density, length, [[1.0; 3], [1.0 / 0.9; 3]], AIR_PARTS);
                let depth = line.air_depth(length);
                for channel in 0..3 {
                    let taken = absorbed(density * depth[channel]);
                    assert!((found[channel] - taken).abs() < 1e-12, "{line:?}: {}, not {taken}", found[channel]);
                }
                // Sources of unlike brightness, as under a low sun: the shares of both change along the way.
                let sources = [[0.06; 3], [1.2; 3]];
                let [few, many] = [AIR_PARTS, 4096].map(|parts| line.air_light(density, length, sources, parts));
                for channel in 0..3 {
                    let off = (few[channel] / many[channel] - 1.0).abs();
                    // Worked out beforehand for eight other lines: at most 0.7 % at a density of 3 and 2.3 % at 20.
                    assert!(off < error, "{line:?}, {density}: {} instead of {}", few[channel], many[channel]);
                }
            }
        }
    }

    #[test]
    fn rays_of_the_march_do_not_depend_on_their_number_when_corrected() {
        let rays = |samples, counts_samples| MarchRays { intensity: 1.0, density: 1.0, samples, counts_samples };
        let sum = |rays: MarchRays| (0..rays.samples).map(|number| rays.weight(number, RAY_LENGTH)).sum::<f64>();
        let [eight, sixteen, many] = [8, 16, 4096].map(|samples| sum(rays(samples, false)));
        // As published with sixteen; with eight a step's begin stands for its middle, half a published step off: 0.95^0.5 of it.
        assert!((sixteen - sum(rays(16, true))).abs() < 1e-12);
        assert!(
            (eight / sixteen - 1.0).abs() < 0.03 && (many / sixteen - 1.0).abs() < 0.03,
            "{eight} {sixteen} {many}"
        );
        assert!(sum(rays(8, true)) < 0.65 * sum(rays(16, true)));
    }
}
