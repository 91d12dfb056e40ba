//! What lights a medium: lights of a single direction or position, and the constant world.

use crate::base::error::{Error, Result};
use crate::scene::{self, LightKind, Scene};
use glam::DVec3;
use std::f64::consts::PI;

/// A light that reaches each point of the medium from one direction.
#[derive(Debug, Clone, PartialEq)]
pub struct DeltaLight {
    /// Where the light comes from.
    pub source: Source,
    /// Sun: what it delivers, in W/m^2. Point and spot: intensity in W/sr.
    pub power: [f64; 3],
}

/// Where a light comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// Unit vector towards a sun.
    Direction(DVec3),
    /// A point; for a spot its axis of travel, the cosine of half its cone, and its blend.
    Position(DVec3, Option<(DVec3, f64, f64)>),
}

impl DeltaLight {
    /// At a position: unit vector towards the light, distance, and what would arrive through empty
    /// space.
    pub fn arriving(&self, position: DVec3) -> (DVec3, f64, [f64; 3]) {
        match &self.source {
            Source::Direction(towards) => (*towards, f64::INFINITY, self.power),
            Source::Position(place, spot) => {
                let distance = (*place - position).length();
                let towards = (*place - position) / distance;
                let cone = spot.map_or(1.0, |(axis, edge, blend)| {
                    let inside = -towards.dot(axis) - edge;
                    let part = (inside / ((1.0 - edge) * blend)).clamp(0.0, 1.0);
                    part * part * (3.0 - 2.0 * part)
                });
                (towards, distance, self.power.map(|power| power * cone / (distance * distance)))
            }
        }
    }
}

/// The lights of a scene. A sun's disc counts as one direction with the fluence of the whole disc,
/// `2 / (1 + cos(angle / 2))` times its irradiance; shadows are as sharp as those of a point.
pub fn delta_lights(scene: &Scene) -> Result<Vec<DeltaLight>> {
    scene
        .lights
        .iter()
        .map(|light| {
            let matrix = scene::matrix_to_glam(&light.matrix_world);
            let towards = matrix.z_axis.truncate().normalize();
            let position = matrix.w_axis.truncate();
            let strength = light.exposed_strength();
            let power = light.color.map(|channel| f64::from(channel) * strength);
            let unsupported = |found: String| {
                Error::new(
                    format!("light {}", light.name),
                    found,
                    "a sun, or a point or spot light of radius 0",
                    "Render by path tracing, which knows every light, or give the light the radius 0; a sun counts as one \
                     direction here.",
                )
            };
            let intensity = power.map(|power| power / (4.0 * PI));
            match light.kind {
                LightKind::Sun { angle } => {
                    let fluence = 2.0 / (1.0 + (f64::from(angle) / 2.0).cos());
                    Ok(DeltaLight { source: Source::Direction(towards), power: power.map(|power| power * fluence) })
                }
                LightKind::Point { radius, .. } | LightKind::Spot { radius, .. } if radius != 0.0 => {
                    Err(unsupported(format!("a light of radius {radius}")))
                }
                LightKind::Point { .. } => {
                    Ok(DeltaLight { source: Source::Position(position, None), power: intensity })
                }
                LightKind::Spot { spot_size, blend, .. } => {
                    let edge = (f64::from(spot_size) / 2.0).cos();
                    // A hard edge divides by zero; the narrowest blend is as hard as a pixel can show.
                    let blend = f64::from(blend).max(1e-6);
                    let source = Source::Position(position, Some((-towards, edge, blend)));
                    Ok(DeltaLight { source, power: intensity })
                }
                LightKind::Area { .. } => Err(unsupported("an area light".into())),
            }
        })
        .collect()
}

/// Radiance of the world's constant background.
pub fn world_radiance(scene: &Scene) -> [f64; 3] {
    scene.world.color.map(|channel| f64::from(channel) * f64::from(scene.world.strength))
}

/// Unit vectors towards the suns of a scene, each with what it delivers ([`DeltaLight::power`]), in the order of the lights.
pub fn suns(scene: &Scene) -> Result<Vec<(DVec3, [f64; 3])>> {
    let of_sun = |light: DeltaLight| match light.source {
        Source::Direction(towards) => Some((towards, light.power)),
        Source::Position(..) => None,
    };
    Ok(delta_lights(scene)?.into_iter().filter_map(of_sun).collect())
}

/// `count` directions of equal weight on the sphere: a Fibonacci lattice.
pub fn sphere_directions(count: usize) -> Vec<DVec3> {
    let golden_angle = PI * (3.0 - 5.0_f64.sqrt());
    (0..count)
        .map(|index| {
            let height = 1.0 - (2.0 * index as f64 + 1.0) / count as f64;
            let radius = (1.0 - height * height).sqrt();
            let (sine, cosine) = (golden_angle * index as f64).sin_cos();
            DVec3::new(radius * cosine, radius * sine, height)
        })
        .collect()
}

/// Largest band of [`harmonics`].
pub const LARGEST_BAND: usize = 3;

/// Real orthonormal spherical harmonics of bands 0 to 3 in a unit direction, band by band.
pub fn harmonics(direction: DVec3) -> [f64; 16] {
    let DVec3 { x, y, z } = direction;
    let root = |value: f64| (value / PI).sqrt();
    [
        0.5 * root(1.0),
        0.5 * root(3.0) * y,
        0.5 * root(3.0) * z,
        0.5 * root(3.0) * x,
        0.5 * root(15.0) * x * y,
        0.5 * root(15.0) * y * z,
        0.25 * root(5.0) * (3.0 * z * z - 1.0),
        0.5 * root(15.0) * x * z,
        0.25 * root(15.0) * (x * x - y * y),
        0.25 * root(35.0 / 2.0) * y * (3.0 * x * x - y * y),
        0.5 * root(105.0) * x * y * z,
        0.25 * root(21.0 / 2.0) * y * (5.0 * z * z - 1.0),
        0.25 * root(7.0) * z * (5.0 * z * z - 3.0),
        0.25 * root(21.0 / 2.0) * x * (5.0 * z * z - 1.0),
        0.25 * root(105.0) * z * (x * x - y * y),
        0.25 * root(35.0 / 2.0) * x * (x * x - 3.0 * y * y),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn harmonics_are_orthonormal() {
        let count = 4096;
        let directions = sphere_directions(count);
        for first in 0..16 {
            for second in 0..=first {
                let mean: f64 = directions
                    .iter()
                    .map(|&direction| harmonics(direction)[first] * harmonics(direction)[second])
                    .sum::<f64>()
                    / count as f64;
                let expected = if first == second { 1.0 } else { 0.0 };
                // The lattice integrates polynomials of degree 6 to about 1/count.
                assert!((4.0 * PI * mean - expected).abs() < 2e-3, "{first}, {second}: {}", 4.0 * PI * mean);
            }
        }
    }
}
