//! Fewer steps far away, as boltbestclouds32 has them: by the distance of the camera from the cloud, and by that of the cloud along each ray.
//!
//! Distances are the system's own metres. The second rule has floors: below 64 steps it takes *more* steps at 5 to 10 km than near by.

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

/// Of a ray that meets the cloud so far away: the number by which its length is divided, of which the whole steps are done.
pub fn ray_steps(steps: u32, distance: f64) -> f64 {
    let steps = f64::from(steps);
    RAY.iter()
        .find(|(beyond, ..)| distance > *beyond)
        .map_or(steps, |(_, divisor, least)| (steps / divisor).max(*least))
}
