//! Source terms that imitate multiple scattering, on top of single scattering; each is off by default.
//!
//! With the optical depth t towards the sun, the cosine c between the view ray and the direction to the sun, the phase function p with
//! mean cosines that can be scaled, the sun's irradiance E and the ambient radiance A, a light model gives per unit of scattering
//!
//! ```text
//! L = E P B ( sum_n b^n p(c; g^n) exp(-a^n D) + s max(c, 0)^k exp(-D) ) + A (d + (u - d) h) ( 1 + q (P - 1) )
//! P = 1 - w exp(-l e)      B = 1 - v exp(-m f)      D = 2 t / (1 + sqrt(1 + 2 r t))
//! ```
//!
//! and, where they are asked for, with the octaves' sum O as it stands in the brackets,
//!
//! ```text
//! O' = lerp( 2 O (1 - exp(-2 D)), O, (1 + c) / 2 )
//! L' = L (1 + u m) + A v m r      m = 1 - exp(-x e)      r = (1 + c^2) / 2, or 1
//! ```
//!
//! - octaves n = 0..N with contribution b, attenuation a and eccentricity g: Wrenninge, Kulla and Lundqvist 2013, "Oz: The Great and
//!   Volumetric"; one octave is single scattering;
//! - compression r of the depth: scattered light falls more slowly than exp(-t), D grows as t where r t is far below 1 and as sqrt(2 t / r)
//!   far above; 0 is none (a form of ours: any that bends so would serve, and this one loses no digits in f32);
//! - a silver lining of strength s and exponent k, added to the phase function of single scattering;
//! - an ambient light that falls from u at the top of the box (height h = 1) to d at its bottom;
//! - powder of strength w and length l, with the extinction e (mean of the channels): thin parts scatter less because less light has
//!   gathered in them (Schneider and Vos 2015, "The Real-time Volumetric Cloudscapes of Horizon: Zero Dawn"); ambient light has the
//!   share q of it, as published all;
//! - powder of the light ray, O': light from behind loses what has no depth before it (bestclouds);
//! - a boost, L', for scattering of a second order (boltbestclouds32): u on the light that there is, v of the ambient colour, x the length;
//! - light from the ground, where a system has it: added to the ambient light, exp(-depth below) of a radiance ([`Ground`]);
//! - body of strength v and length m, with the extinction f around the place; t may be that of the density's averages, too
//!   ([`crate::media::averages`]).

use crate::media::transfer::{absorbed, transmittance};
use num_traits::Float;
use serde::{Deserialize, Serialize};

/// Most octaves; the kernel holds a weight of each.
pub const MOST_OCTAVES: u32 = 16;

/// Most that compression times depth counts: far above it nothing is left of the light, and f32 would not hold it.
const LARGEST_COMPRESSED: f64 = 1e38;

/// Octaves of dimmed and widened single scattering.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Octaves {
    /// How many, 1 to [`MOST_OCTAVES`]; 1 is single scattering.
    pub count: u32,
    /// Weight of an octave over that of the one before.
    pub contribution: f64,
    /// Optical depth of an octave over that of the one before.
    pub attenuation: f64,
    /// Mean cosines of an octave's phase function over those of the one before.
    pub eccentricity: f64,
    /// How much great depths count less, in all octaves; 0: each as it is.
    pub compression: f64,
}

/// Less light from thin parts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Powder {
    /// What a part without extinction loses, 0 to 1; 0 is no powder.
    pub strength: f64,
    /// Length over which extinction counts, in sides of the box.
    pub length: f64,
    /// Share of it that ambient light has, too, 0 to 1.
    pub ambient: f64,
}

/// Light that thick surroundings keep and thin ones lose: multiple scattering spreads, so that the sun's light at a place follows the
/// density around it (averages: [`crate::media::averages`]), and not only the depth towards the sun.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Body {
    /// What surroundings without extinction lose of the sun's light, 0 to 1; 0 is no such term.
    pub strength: f64,
    /// Length over which the extinction around counts, in sides of the box.
    pub length: f64,
    /// Whether the march towards the sun reads averages of the density, too: shadows without detail.
    pub shadow: bool,
}

/// More light around the sun.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SilverLining {
    /// Per steradian, added to the phase function towards the sun; 0 is none.
    pub strength: f64,
    /// Exponent of the cosine.
    pub exponent: f64,
}

/// More light where extinction is high, for a second order of scattering.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Boost {
    /// Of the light that there is; 0 is none.
    pub light: f64,
    /// Of the ambient light at the top, as radiance without a gradient; 0 is none.
    pub ambient: f64,
    /// Length over which extinction counts, in sides of the box.
    pub length: f64,
    /// Whether the ambient part follows the cosine to the sun.
    pub by_angle: bool,
}

/// Light that the ground sends back: a radiance without direction, dimmed by a march straight down whose steps double, each read in its middle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Ground {
    /// Share of the irradiance of the world, pi times its radiance, that arrives as radiance at a place which nothing dims.
    pub of_world: f64,
    /// The same of the suns' irradiance.
    pub of_suns: f64,
    /// Steps of the march.
    pub steps: u32,
    /// Length of the first, in units of length.
    pub first: f64,
    /// Height as a part of the domain's above which there is none.
    pub highest: f64,
}

/// All of them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Terms {
    /// Factor on the sun and the world of a scene.
    pub exposure: f64,
    /// Octaves of multiple scattering.
    pub octaves: Octaves,
    /// Powder.
    pub powder: Powder,
    /// What surrounds a place.
    pub body: Body,
    /// Silver lining.
    pub silver: SilverLining,
    /// Factor on the ambient light at the bottom of the box and at its top, linear between.
    pub ambient: [f64; 2],
    /// Whether the light ray has powder of its own.
    #[serde(default)]
    pub ray_powder: bool,
    /// A second order of scattering.
    #[serde(default = "Boost::none")]
    pub boost: Boost,
    /// Light from the ground, where there is some.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ground: Option<Ground>,
}

impl Terms {
    /// Single scattering and a constant ambient light.
    pub const NONE: Self = Self {
        exposure: 1.0,
        octaves: Octaves { count: 1, contribution: 0.5, attenuation: 0.5, eccentricity: 0.5, compression: 0.0 },
        powder: Powder { strength: 0.0, length: 0.1, ambient: 1.0 },
        body: Body { strength: 0.0, length: 0.1, shadow: false },
        silver: SilverLining { strength: 0.0, exponent: 8.0 },
        ambient: [1.0; 2],
        ray_powder: false,
        boost: Boost { light: 0.0, ambient: 0.0, length: 0.1, by_angle: true },
        ground: None,
    };
}

impl Terms {
    /// Whether something stands in for orders of scattering behind the first.
    pub fn imitates_orders(&self) -> bool {
        self.octaves.count > 1
            || self.powder.strength > 0.0
            || self.body.strength > 0.0
            || self.silver.strength > 0.0
            || self.ray_powder
            || self.boost.is_on()
            || self.ground.is_some()
    }

    /// Whether averages of the density are read.
    pub fn needs_coarse(&self) -> bool {
        self.body.strength > 0.0 || self.body.shadow
    }
}

impl Octaves {
    /// The sum over octaves of their weights, which hold the phase functions, each dimmed by its part of an optical depth.
    pub fn sum(&self, weights: &[f64], depth: f64) -> f64 {
        octaves(weights, self.attenuation, depth)
    }

    /// The depth towards the sun that counts.
    pub fn compressed(&self, depth: f64) -> f64 {
        compressed(self.compression, depth)
    }
}

impl Powder {
    /// Factor on all light, for an extinction per side of the box.
    pub fn factor(&self, extinction: f64) -> f64 {
        powder(self.strength, self.length, extinction)
    }
}

impl Boost {
    fn none() -> Self {
        Terms::NONE.boost
    }

    /// Whether there is any.
    pub fn is_on(&self) -> bool {
        self.light != 0.0 || self.ambient != 0.0
    }

    /// Factor on the light that there is, and on the ambient light that is added, for an extinction per side of the box and the cosine to
    /// the sun.
    pub fn factors(&self, extinction: f64, cosine: f64) -> [f64; 2] {
        let gathered = absorbed(self.length * extinction);
        let turned = if self.by_angle { (1.0 + cosine * cosine) / 2.0 } else { 1.0 };
        [1.0 + self.light * gathered, self.ambient * gathered * turned]
    }
}

impl Body {
    /// Factor on the sun's light, for an extinction around a place per side of the box.
    pub fn factor(&self, extinction: f64) -> f64 {
        powder(self.strength, self.length, extinction)
    }
}

impl SilverLining {
    /// What is added to the phase function, per steradian.
    pub fn value(&self, cosine: f64) -> f64 {
        silver(self.strength, self.exponent, cosine)
    }
}

/// [`Octaves::sum`] in f32 or f64.
pub fn octaves<T: Float>(weights: &[T], attenuation: T, depth: T) -> T {
    let (mut sum, mut dimmed) = (T::zero(), depth);
    for &weight in weights {
        sum = sum + weight * transmittance(dimmed);
        dimmed = dimmed * attenuation;
    }
    sum
}

/// What the powder of the light ray leaves of the octaves' sum, in f32 or f64.
pub fn ray_powder<T: Float>(sum: T, depth: T, cosine: T) -> T {
    let two = T::one() + T::one();
    let behind = two * absorbed(two * depth);
    sum * (behind + (T::one() - behind) * (T::one() + cosine) / two)
}

/// [`Octaves::compressed`] in f32 or f64: nothing is subtracted, so that each rounding counts once.
pub fn compressed<T: Float>(compression: T, depth: T) -> T {
    let two = T::one() + T::one();
    let bent = (two * compression * depth).min(T::from(LARGEST_COMPRESSED).expect("f32 holds it"));
    two * depth / (T::one() + (T::one() + bent).sqrt())
}

/// [`Powder::factor`] in f32 or f64: of thin parts without the difference of nearly equal numbers.
pub fn powder<T: Float>(strength: T, length: T, extinction: T) -> T {
    (T::one() - strength) + strength * absorbed(length * extinction)
}

/// [`SilverLining::value`] in f32 or f64.
pub fn silver<T: Float>(strength: T, exponent: T, cosine: T) -> T {
    strength * cosine.max(T::zero()).powf(exponent)
}
