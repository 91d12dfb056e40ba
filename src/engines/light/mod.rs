//! Light models: what stands in for light transport in a real-time march, as source terms that combine with any density model.
//!
//! A light model says how much radiance a unit of medium sends towards the camera: light of a sun, dimmed on its way by a short
//! march ([`ShadowMarch`]) and turned by a phase function ([`TwoLobes`]), and an ambient radiance. It knows nothing of
//! what makes the density; [`crate::engines::march`] brings the two together. What imitates multiple scattering is in [`terms`].

pub mod models;
pub mod terms;

use crate::base::choice::choice;
use crate::engines::domain::unit;
use crate::media::light_volume::MOST_BANDS;
use crate::media::phase::{ScatteringLobe, draine, henyey_greenstein};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use terms::{Ground, Terms};

/// A sum of two phase functions of Henyey and Greenstein or, with an alpha, of Draine: Cornette and Shanks' for alpha 1, the fit to Mie's of
/// droplets where one lobe has an alpha and the other none. Normalised to 1 over the sphere, but for what published systems add.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TwoLobes {
    /// Anisotropy of each lobe; of Henyey and Greenstein's it is the mean cosine.
    pub anisotropy: [f64; 2],
    /// Share of the second lobe.
    pub second: f64,
    /// Draine's alpha of each lobe; 0 is Henyey and Greenstein's.
    #[serde(default)]
    pub alpha: [f64; 2],
    /// What both are multiplied with: 1, or the sum of weights that a system did not normalise.
    #[serde(default = "one")]
    pub gain: f64,
    /// Added at right angles to the light: this times (1 - |cosine|)^4, per steradian.
    #[serde(default)]
    pub rim: f64,
    /// Anisotropies of two lobes with the same shares, Henyey and Greenstein's, by which, times 4 pi, everything is multiplied once more
    /// (defect BE-1 of `best`).
    #[serde(default)]
    pub again: Option<[f64; 2]>,
}

fn one() -> f64 {
    1.0
}

impl TwoLobes {
    /// Henyey and Greenstein's with mean cosines and the share of the second.
    pub const fn new(anisotropy: [f64; 2], second: f64) -> Self {
        Self { anisotropy, second, alpha: [0.0; 2], gain: 1.0, rim: 0.0, again: None }
    }

    /// Per steradian, for the cosine between the view ray and the direction to the light.
    pub fn evaluate(&self, cosine: f64) -> f64 {
        let [first, second] = std::array::from_fn(|lobe| match (self.anisotropy[lobe], self.alpha[lobe]) {
            (anisotropy, 0.0) => henyey_greenstein(anisotropy, cosine),
            (anisotropy, alpha) => draine(anisotropy, alpha, cosine),
        });
        let lobes = self.gain * (first * (1.0 - self.second) + second * self.second);
        let all = if self.rim == 0.0 { lobes } else { lobes + self.rim * (1.0 - cosine.abs()).max(0.0).powi(4) };
        self.again.map_or(all, |again| {
            let [first, second] = again.map(|anisotropy| henyey_greenstein(anisotropy, cosine));
            all * 4.0 * std::f64::consts::PI * (first * (1.0 - self.second) + second * self.second)
        })
    }

    /// The lobes that light transport knows, without gain, rim and what is multiplied once more: those with a share, two of one shape as one.
    pub fn lobes(&self) -> Vec<ScatteringLobe> {
        let [first, second] = [0, 1].map(|lobe| (self.anisotropy[lobe], self.alpha[lobe]));
        let shares = if first == second { [1.0, 0.0] } else { [1.0 - self.second, self.second] };
        let lobes = shares.into_iter().zip([first, second]);
        let lobes = lobes.map(|(share, (anisotropy, alpha))| ScatteringLobe { share, anisotropy, alpha });
        lobes.filter(|lobe| lobe.share > 0.0).collect()
    }

    /// 2 pi times the integral of it times each Legendre polynomial up to that of a band (at most [`MOST_BANDS`]): what it does to spherical
    /// harmonics. Of Henyey and Greenstein's these are powers of the mean cosine; others are integrated by Simpson's rule over parts that
    /// become short towards both ends, where lobes have their peaks, to 1e-6 for anisotropies up to 0.99.
    pub fn moments(&self, band: u32) -> Vec<f64> {
        if self.alpha == [0.0; 2] && self.rim == 0.0 && self.again.is_none() {
            let [first, second] = self.anisotropy;
            let power = |anisotropy: f64, band: u32| anisotropy.powi(band as i32);
            let of = |band| power(first, band) * (1.0 - self.second) + power(second, band) * self.second;
            return (0..=band).map(|band| self.gain * of(band)).collect();
        }
        self.integrated_moments(band)
    }

    fn integrated_moments(&self, band: u32) -> Vec<f64> {
        const PARTS: usize = 2000;
        let legendre = |band: u32, c: f64| match band {
            0 => 1.0,
            1 => c,
            2 => 0.5 * (3.0 * c * c - 1.0),
            _ => 0.5 * c * (5.0 * c * c - 3.0),
        };
        // c = 1 - s^4 on both sides of 0.
        let both = |band: u32, s: f64| {
            let c = 1.0 - s.powi(4);
            let at = |c: f64| self.evaluate(c) * legendre(band, c);
            (at(c) + at(-c)) * 4.0 * s.powi(3)
        };
        let weight = |part: usize| match part {
            0 | PARTS => 1.0,
            part if part % 2 == 1 => 4.0,
            _ => 2.0,
        };
        let sum =
            |band: u32| (0..=PARTS).map(|part| weight(part) * both(band, part as f64 / PARTS as f64)).sum::<f64>();
        (0..=band.min(MOST_BANDS)).map(|band| std::f64::consts::TAU * sum(band) / (3.0 * PARTS as f64)).collect()
    }

    /// Mean cosine of the lobes.
    pub fn mean_cosine(&self) -> f64 {
        let [first, second] = std::array::from_fn(|lobe| {
            let (g, alpha) = (self.anisotropy[lobe], self.alpha[lobe]);
            let square = g * g;
            g * (1.0 + alpha * (3.0 + 2.0 * square) / 5.0) / (1.0 + alpha * (1.0 + 2.0 * square) / 3.0)
        });
        first * (1.0 - self.second) + second * self.second
    }
}

/// How far the march towards the sun goes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShadowLength {
    /// That many units of length, whether or not they leave the domain; samples outside of it are empty.
    Fixed(f64),
    /// Until the ray leaves the domain.
    ToExit,
    /// The same, but at most that many units of length.
    ToExitAtMost(f64),
}

impl ShadowLength {
    /// Of a ray that leaves the domain after `exit`.
    pub fn of(self, exit: f64) -> f64 {
        match self {
            Self::Fixed(length) => length,
            Self::ToExit => exit,
            Self::ToExitAtMost(most) => exit.min(most),
        }
    }
}

/// What dims the light per unit of density and length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShadowExtinction {
    /// The density itself, alike for all channels: not what dims the view ray.
    Density,
    /// The extinction of the view ray, per channel.
    View,
    /// This much per unit of density and length, alike for all channels.
    Of(f64),
}

choice! {
    "kebab-case",
    /// Where in a step towards the sun the density is read that stands for all of it.
    pub enum ShadowSample {
        /// At its begin: the first is the shaded place itself.
        Left,
        /// In its middle.
        Middle,
        /// At its end.
        Right,
    }
}

impl ShadowSample {
    /// Part of the step before the place.
    pub fn part(self) -> f64 {
        match self {
            Self::Left => 0.0,
            Self::Middle => 0.5,
            Self::Right => 1.0,
        }
    }
}

/// Most shadow maps of a sun.
pub const MOST_CASCADES: u32 = 4;

fn single() -> u32 {
    1
}

fn is_single(cascades: &u32) -> bool {
    *cascades == 1
}

const fn practical() -> f64 {
    0.6
}

fn is_practical(split: &f64) -> bool {
    *split == practical()
}

/// How a shadow map is made ([`crate::engines::march::shadow_map`]).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ShadowMapSettings {
    /// Texels along a side, at least 2.
    pub size: u32,
    /// Maps of a sun: 1 over the whole domain, or as many, at most [`MOST_CASCADES`], each over a part of the view.
    #[serde(default = "single", skip_serializing_if = "is_single")]
    pub cascades: u32,
    /// Where these parts of the view meet: 0 at depths that are even, 1 at such whose logarithms are, between them in proportion (the practical
    /// split of Zhang et al. 2006, "Parallel-Split Shadow Maps for Large-scale Virtual Environments").
    #[serde(default = "practical", skip_serializing_if = "is_practical")]
    pub split: f64,
    /// Steps of a texel's ray.
    pub steps: u32,
    /// Transmittance at which such a ray ends.
    pub least_transmittance: f64,
    /// Factor on the tail of a ray that ended early.
    pub tail: f64,
    /// Metres of the unit of length, for the tail and for half floats.
    pub metres: f64,
    /// Whether distances are kept as half floats of metres (defect TK-8).
    pub half_floats: bool,
    /// Whether the front depth weighs distances by what a step leaves, not by what it takes (defect TK-14).
    pub front_by_what_is_left: bool,
    /// Whether the march towards the sun is taken to end at its last sample, not at its last step's end (defect TK-10).
    pub marched_to_last_sample: bool,
}

impl ShadowMapSettings {
    /// A map without defects.
    pub const fn new(size: u32, steps: u32, metres: f64) -> Self {
        Self {
            size,
            cascades: 1,
            split: practical(),
            steps,
            least_transmittance: 1e-4,
            tail: 0.0,
            metres,
            half_floats: false,
            front_by_what_is_left: false,
            marched_to_last_sample: false,
        }
    }
}

/// A march from a sample towards the sun; the density at one place of a step stands for all of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ShadowMarch {
    /// Number of steps; at least 1.
    pub steps: u32,
    /// Which place of a step is read.
    #[serde(default = "middle")]
    pub sample: ShadowSample,
    /// Length of a step over that of the one before, above 0; 1: equal steps.
    #[serde(default = "one")]
    pub growth: f64,
    /// The depth is multiplied with 1 minus this times the cosine between view ray and sun; 0 as light has it.
    #[serde(default)]
    pub by_angle: f64,
    /// Their length together.
    pub length: ShadowLength,
    /// What dims the light.
    pub extinction: ShadowExtinction,
    /// A map that knows what lies beyond the march, where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<ShadowMapSettings>,
    /// Layers of the map at whose ends it has the density times length up to the sun, so that nothing is marched for; 0: a Beer map.
    #[serde(default, skip_serializing_if = "is_none")]
    pub layers: u32,
}

/// Whether there are no layers.
fn is_none(layers: &u32) -> bool {
    *layers == 0
}

fn middle() -> ShadowSample {
    ShadowSample::Middle
}

impl ShadowMarch {
    /// Equal steps, read in their middle.
    pub const fn new(steps: u32, length: ShadowLength, extinction: ShadowExtinction) -> Self {
        Self {
            steps,
            sample: ShadowSample::Middle,
            growth: 1.0,
            by_angle: 0.0,
            length,
            extinction,
            map: None,
            layers: 0,
        }
    }

    /// The march of published slabs: as long as the slab is thick however low the sun stands, read at the ends of its steps
    /// (`is_vertical`, BO-6 and SK-8), or to the exit, at most four thicknesses, read in the middles.
    pub fn of_slab(steps: u32, thickness: f64, is_vertical: bool, extinction: ShadowExtinction) -> Self {
        match is_vertical {
            true => {
                Self { sample: ShadowSample::Right, ..Self::new(steps, ShadowLength::Fixed(thickness), extinction) }
            }
            false => Self::new(steps, ShadowLength::ToExitAtMost(4.0 * thickness), extinction),
        }
    }

    /// Begin and length of each step as parts of the whole march.
    pub fn parts(&self) -> Vec<[f64; 2]> {
        let count = f64::from(self.steps);
        if self.growth == 1.0 {
            return (0..self.steps).map(|number| [f64::from(number) / count, 1.0 / count]).collect();
        }
        let upto = |number: u32| self.growth.powi(number as i32) - 1.0;
        let all = upto(self.steps);
        (0..self.steps).map(|number| [upto(number) / all, (upto(number + 1) - upto(number)) / all]).collect()
    }

    /// Part of the march's length beyond which a map is asked.
    pub fn map_from(&self) -> f64 {
        match (&self.map, self.parts().last()) {
            (Some(map), Some([begin, step])) if map.marched_to_last_sample => begin + step * self.sample.part(),
            _ => 1.0,
        }
    }

    /// Factor on the depth for the cosine between view ray and sun.
    pub fn angle_factor(&self, cosine: f64) -> f64 {
        1.0 - self.by_angle * cosine
    }
}

/// What the radiance of the light is multiplied with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SourceFactor {
    /// The density: the albedo is then one over the extinction per unit density, and may be above 1.
    Density,
    /// Extinction times this single-scattering albedo of each channel.
    Albedo([f64; 3]),
}

/// Most suns of a light model; the kernel holds weights of each.
pub const MOST_SUNS: usize = 8;

/// Light from one direction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sun {
    /// Direction towards it in the world; of any length but 0.
    pub direction: [f64; 3],
    /// Colour times intensity: irradiance in the units of the scene.
    pub irradiance: [f64; 3],
}

impl Sun {
    /// Unit vector towards it; of NaN where the direction has no length, so that it is seen.
    pub fn towards(&self) -> DVec3 {
        unit(DVec3::from(self.direction)).unwrap_or(DVec3::NAN)
    }

    /// Irradiance of its brightest channel.
    pub fn brightest(&self) -> f64 {
        self.irradiance.into_iter().fold(0.0, f64::max)
    }
}

/// A place where light is scattered, for terms of the light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lit {
    /// In the density's frame.
    pub place: DVec3,
    /// 0 at the bottom of the domain, 1 at its top.
    pub height: f64,
    /// Mean extinction of the channels, per unit of length.
    pub extinction: f64,
}

/// A term of a system's own in the light at a sample: it is added to what the suns and the ambient light send, before all of it is
/// multiplied by what scatters.
pub trait LightTerm: Send + Sync {
    /// Import path of its module.
    fn import_path(&self) -> &'static str;

    /// Radiance per unit of scattering.
    fn source(&self, at: &Lit) -> [f64; 3];

    /// Its twin: the text of a WGSL module that defines [`Self::import_path`] and
    /// `fn source(place: vec3f, height: f32, extinction: f32) -> vec3f`.
    fn shader(&self) -> String;
}

/// A light model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LightModel {
    /// Suns, at most [`MOST_SUNS`]. A scene brings its own.
    pub suns: Vec<Sun>,
    /// Colour times intensity of light from everywhere.
    pub ambient: [f64; 3],
    /// How light is turned.
    pub phase: TwoLobes,
    /// How the sun is dimmed.
    pub shadow: ShadowMarch,
    /// What the light is multiplied with.
    pub source: SourceFactor,
    /// What imitates multiple scattering.
    pub terms: Terms,
}

impl LightModel {
    /// Weights of the octaves for a ray whose cosine to the sun is given: phase functions and the silver lining, per steradian.
    pub fn weights(&self, cosine: f64) -> Vec<f64> {
        let octaves = &self.terms.octaves;
        let mut phase = self.phase;
        let mut share = 1.0;
        let mut weights = Vec::with_capacity(octaves.count as usize);
        for _ in 0..octaves.count {
            weights.push(share * phase.evaluate(cosine));
            share *= octaves.contribution;
            phase.anisotropy = phase.anisotropy.map(|anisotropy| anisotropy * octaves.eccentricity);
        }
        if self.terms.silver.strength > 0.0 {
            weights[0] += self.terms.silver.value(cosine);
        }
        weights
    }

    /// Radiance from the ground at a place which nothing dims.
    pub fn ground_radiance(&self, ground: &Ground) -> [f64; 3] {
        std::array::from_fn(|channel| {
            let suns: f64 = self.suns.iter().map(|sun| sun.irradiance[channel]).sum();
            ground.of_world * std::f64::consts::PI * self.ambient[channel] + ground.of_suns * suns
        })
    }

    /// Factor on the ambient light at a height of the domain, 0 to 1.
    pub fn ambient_factor(&self, height: f64) -> f64 {
        let [bottom, top] = self.terms.ambient;
        bottom + (top - bottom) * height
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_powers_of_the_mean_cosine_and_the_same_by_quadrature() {
        for (anisotropy, second) in [([0.0, 0.0], 0.0), ([0.85, -0.3], 0.25), ([0.99, -0.99], 0.5), ([-0.6, 0.1], 0.9)]
        {
            let phase = TwoLobes { gain: 1.5, ..TwoLobes::new(anisotropy, second) };
            for (band, (closed, sum)) in phase.moments(3).into_iter().zip(phase.integrated_moments(3)).enumerate() {
                assert!((closed - sum).abs() < 1e-6, "{anisotropy:?}, band {band}: {sum}, not {closed}");
            }
        }
        let draine = TwoLobes { alpha: [1.0, 0.0], ..TwoLobes::new([0.7, 0.2], 0.3) };
        let found = draine.moments(1);
        assert!((found[0] - 1.0).abs() < 1e-6 && (found[1] - draine.mean_cosine()).abs() < 1e-6, "{found:?}");
        // The rim adds 2 pi 0.5 times the integral of (1 - |c|)^4, which is 2 / 5.
        let rimmed = TwoLobes { rim: 0.5, ..TwoLobes::new([0.0; 2], 0.0) };
        assert!((rimmed.moments(0)[0] - 1.0 - 0.4 * std::f64::consts::PI).abs() < 1e-6);
    }
}
