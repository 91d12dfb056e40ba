//! Light models: what stands in for light transport in a real-time march, as source terms that combine with any density model.
//!
//! A light model says how much radiance a unit of medium sends towards the camera: light of a sun, dimmed on its way by a short
//! march ([`ShadowMarch`]) and turned by a phase function ([`TwoLobes`]), and an ambient radiance. It knows nothing of
//! what makes the density; [`crate::engines::march`] brings the two together. What imitates multiple scattering is in [`terms`].

pub mod models;
pub mod terms;

use crate::engines::march::unit;
use crate::media::phase::henyey_greenstein;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use terms::Terms;

/// A sum of two Henyey-Greenstein phase functions, normalised to 1 over the sphere.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TwoLobes {
    /// Mean cosine of each lobe.
    pub anisotropy: [f64; 2],
    /// Share of the second lobe.
    pub second: f64,
}

impl TwoLobes {
    /// Per steradian, for the cosine between the view ray and the direction to the light.
    pub fn evaluate(&self, cosine: f64) -> f64 {
        let [first, second] = self.anisotropy.map(|anisotropy| henyey_greenstein(anisotropy, cosine));
        first * (1.0 - self.second) + second * self.second
    }

    /// Mean cosine.
    pub fn mean_cosine(&self) -> f64 {
        self.anisotropy[0] * (1.0 - self.second) + self.anisotropy[1] * self.second
    }
}

/// How far the march towards the sun goes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShadowLength {
    /// That many units of the model's box, whether or not they leave it; samples outside of it are empty.
    Fixed(f64),
    /// Until the ray leaves the box.
    ToExit,
}

/// What dims the light per unit of density and length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShadowExtinction {
    /// The density itself, alike for all channels: not what dims the view ray.
    Density,
    /// The extinction of the view ray, per channel.
    View,
}

/// A march of equal steps from a sample towards the sun; the density in the middle of a step stands for all of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ShadowMarch {
    /// Number of steps; at least 1.
    pub steps: u32,
    /// Their length together.
    pub length: ShadowLength,
    /// What dims the light.
    pub extinction: ShadowExtinction,
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

/// A light model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LightModel {
    /// Direction to the sun in the model's frame; of any length but 0.
    pub sun_direction: [f64; 3],
    /// Colour times intensity of the sun: irradiance in the units of the scene.
    pub sun: [f64; 3],
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

    /// Unit vector towards the sun; of NaN where the direction has no length, so that it is seen.
    pub fn to_sun(&self) -> DVec3 {
        unit(DVec3::from(self.sun_direction)).unwrap_or(DVec3::NAN)
    }

    /// Factor on the ambient light at a height of the box, -0.5 to 0.5.
    pub fn ambient_factor(&self, height: f64) -> f64 {
        let [bottom, top] = self.terms.ambient;
        bottom + (top - bottom) * (height + 0.5)
    }
}
