//! What the path integrator asks of a medium, in one place: coefficients at a batch of positions,
//! how they are bounded, and the phase function.

use crate::error::{Error, Result};
use crate::graph::Operand;
use crate::graph::evaluate::Evaluator;
use crate::integrate::majorant::Majorants;
use crate::integrate::medium::Medium;
use crate::integrate::phase::henyey_greenstein;
use crate::integrate::sampled_lights::around;
use crate::nodes::Interval;
use crate::scene::{self, Scene};
use glam::{DMat4, DVec3};

/// Scattering and extinction per metre of the three channels.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Coefficients {
    pub(super) scattering: [f64; 3],
    pub(super) extinction: [f64; 3],
}

/// The medium of a scene with its majorants.
pub(super) struct Volume {
    medium: Medium,
    /// The density where it is the same everywhere.
    uniform: Option<f32>,
    /// None where the box has no inside.
    pub(super) majorants: Option<Majorants>,
    /// Per channel, extinction over that of the channel with the most: a minorant of that one times this
    /// is a minorant of each.
    pub(super) share: [f64; 3],
    /// Radiance per metre, the same in the whole box.
    pub(super) emission: [f64; 3],
    /// World to object.
    pub(super) to_object: DMat4,
}

impl Volume {
    /// The medium of a scene; `rays` is how many rays are expected to cross it.
    pub(super) fn new(scene: &Scene, rays: f64) -> Result<Self> {
        let medium = Medium::new(scene)?;
        let most = medium.extinction.iter().copied().fold(0.0, f64::max);
        for (name, values) in
            [("extinction", medium.extinction), ("scattering", medium.scattering), ("emission", medium.emission)]
        {
            if values.iter().any(|value| !(value.is_finite() && *value >= 0.0)) {
                return Err(Error::new(
                    "$.graph, the closure's colours",
                    format!("{name} {values:?}"),
                    "finite coefficients, none below 0",
                    "Correct Color, Absorption Color or the emission.",
                ));
            }
        }
        let uniform = match medium.density.outputs[0].operands[0] {
            Operand::Constant(value) => Some(value.max(0.0)),
            _ => None,
        };
        let region = medium.bounds;
        let majorants = if region.is_empty() {
            None
        } else {
            let to_world = scene::matrix_to_glam(&scene.volume.matrix_world);
            let scaled = |interval: Interval| Interval {
                // Rounded outwards: the product is rounded to f32.
                low: (f64::from(interval.low.max(0.0)) * most) as f32 * (1.0 - f32::EPSILON),
                high: (f64::from(interval.high.max(0.0)) * most) as f32 * (1.0 + f32::EPSILON),
                may_be_nan: interval.may_be_nan,
            };
            let enclose = |boxes: &[_]| -> Result<Vec<Interval>> {
                Ok(medium.density.bounds_many(boxes)?.into_iter().map(scaled).collect())
            };
            Some(Majorants::build([region.low, region.high], &to_world, rays, enclose)?)
        };
        Ok(Self {
            uniform,
            majorants,
            share: medium.extinction.map(|extinction| if most > 0.0 { extinction / most } else { 0.0 }),
            emission: medium.emission,
            to_object: medium.to_object,
            medium,
        })
    }

    /// Coefficients per density.
    pub(super) fn medium(&self) -> &Medium {
        &self.medium
    }

    /// Whether any channel scatters anywhere.
    pub(super) fn scatters(&self) -> bool {
        self.medium.scattering.iter().any(|&scattering| scattering > 0.0)
    }

    /// Whether any channel emits.
    pub(super) fn emits(&self) -> bool {
        self.emission.iter().any(|&emission| emission > 0.0)
    }

    /// Evaluates coefficients on the calling thread.
    pub(super) fn evaluator(&self) -> Result<CoefficientEvaluator<'_>> {
        Ok(CoefficientEvaluator { volume: self, density: Evaluator::new(&self.medium.density)? })
    }

    /// Phase function in 1/sr between two directions of travel.
    pub(super) fn phase(&self, before: DVec3, after: DVec3) -> f64 {
        henyey_greenstein(self.medium.anisotropy, before.dot(after))
    }

    /// Samples a direction of travel after scattering by the phase function (Henyey and Greenstein's
    /// distribution inverted); the density is [`Self::phase`].
    pub(super) fn sample_phase(&self, before: DVec3, [first, second]: [f64; 2]) -> DVec3 {
        let anisotropy = self.medium.anisotropy;
        let cosine = if anisotropy.abs() < 0.001 {
            1.0 - 2.0 * first
        } else {
            let square = anisotropy * anisotropy;
            let part = (1.0 - square) / (1.0 + anisotropy - 2.0 * anisotropy * first);
            ((1.0 + square - part * part) / (2.0 * anisotropy)).clamp(-1.0, 1.0)
        };
        around(before, cosine, (1.0 - cosine * cosine).max(0.0).sqrt(), second)
    }
}

/// Coefficients at batches of positions.
pub(super) struct CoefficientEvaluator<'a> {
    volume: &'a Volume,
    density: Evaluator<'a>,
}

impl CoefficientEvaluator<'_> {
    /// One entry per position of the object's frame, into `results`. NaN stays to be seen.
    pub(super) fn evaluate(&mut self, positions: &[[f32; 3]], results: &mut Vec<Coefficients>) {
        results.clear();
        let medium = &self.volume.medium;
        let coefficients = |density: f32| {
            // Negative density acts as 0, and NaN is not below 0.
            let density = if density < 0.0 { 0.0 } else { f64::from(density) };
            Coefficients {
                scattering: medium.scattering.map(|per_density| per_density * density),
                extinction: medium.extinction.map(|per_density| per_density * density),
            }
        };
        match self.volume.uniform {
            Some(density) => results.resize(positions.len(), coefficients(density)),
            None => results.extend(self.density.evaluate(positions).iter().map(|&density| coefficients(density))),
        }
    }
}
