//! Fewer steps far away, as boltbestclouds32 has them: by the distance of the camera from the cloud, and by that of the cloud along each ray.
//!
//! Distances are the system's own metres. The second rule has floors: as published it takes *more* steps
//! at 5 to 10 km than near by where these are fewer than 32.

use serde::{Deserialize, Serialize};

/// Distances below which a camera has so many steps along a ray and towards the sun.
const CAMERA: [(f64, [u32; 2]); 4] = [(2000.0, [96, 8]), (5000.0, [64, 6]), (10_000.0, [48, 4]), (20_000.0, [32, 3])];

/// What a camera beyond has.
const FARTHEST: [u32; 2] = [8, 1];

/// Beyond which distance the steps of a ray are divided by what, and the least steps then; the farthest first.
const RAY: [(f64, f64, f64); 3] = [(20_000.0, 4.0, 8.0), (10_000.0, 3.0, 16.0), (5000.0, 2.0, 32.0)];

/// Steps of a view ray, and towards the sun, of a camera so far from the cloud.
pub fn camera_level(distance: f64) -> [u32; 2] {
    CAMERA.iter().find(|(below, _)| distance < *below).map_or(FARTHEST, |(_, steps)| *steps)
}

/// How a march takes fewer steps along rays that meet the domain far away.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DistanceLevels {
    /// The system's metres in a unit of length.
    pub metres: f64,
    /// Whether a ray is divided by a number with a rest, of which the whole steps are done: its end is not marched (defect BO-4).
    pub with_rest: bool,
    /// Whether the floors hold for a march of fewer steps, too, which takes more of them far away than near by (defect BO-5).
    pub beyond_asked: bool,
}

impl DistanceLevels {
    /// The same without defects.
    pub fn corrected(self) -> Self {
        Self { with_rest: false, beyond_asked: false, ..self }
    }

    /// The number by which the length of a ray is divided that meets the domain so many units away.
    pub fn steps_of(&self, steps: u32, distance: f64) -> f64 {
        let published = ray_steps(steps, distance * self.metres);
        let whole = if self.with_rest { published } else { published.round() };
        if self.beyond_asked { whole } else { whole.min(f64::from(steps)) }
    }

    /// The most that it is.
    pub fn most_steps(&self, steps: u32) -> u32 {
        if self.beyond_asked { RAY.iter().fold(steps, |most, (.., least)| most.max(*least as u32)) } else { steps }
    }
}

/// As published, of a ray that meets the cloud so far away: the number by which its length is divided, of which the whole steps are done.
pub fn ray_steps(steps: u32, distance: f64) -> f64 {
    let steps = f64::from(steps);
    RAY.iter()
        .find(|(beyond, ..)| distance > *beyond)
        .map_or(steps, |(_, divisor, least)| (steps / divisor).max(*least))
}
