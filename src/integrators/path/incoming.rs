//! The light that arrives at places, in spherical harmonics, by path tracing: what a light volume is made of.
//!
//! From every place rays go out in directions that are uniform over the sphere (Sobol points of the place's own), and each brings the radiance that
//! arrives along it: of the world as it is dimmed, and of all lights after at least one scattering. A light without extent itself lies on no ray,
//! so that the suns' own light at the place, single scattering of a march, is none of it. A camera's path scatters before it is at such a place: as
//! many scatterings are left as the scene allows, less one.

use super::{PathSettings, Subject, Tracer};
use crate::base::error::Result;
use crate::base::progress::Progress as Report;
use crate::media::light_volume::LightVolumeSettings;
use crate::view::camera::Ray;
use crate::view::lights::harmonics;
use crate::view::sampler::Sampler;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Paths of one range: the last paths of a range share batches with nobody.
const RANGE_PATHS: usize = 1 << 15;

/// Ranges between two reports.
const RANGES: usize = 16;

/// A unit direction, uniform over the sphere, from two numbers in [0, 1).
fn direction([first, second]: [f64; 2]) -> DVec3 {
    let height = 1.0 - 2.0 * first;
    let radius = (1.0 - height * height).max(0.0).sqrt();
    let (sine, cosine) = (TAU * second).sin_cos();
    DVec3::new(radius * cosine, radius * sine, height)
}

/// Coefficients of the radiance that arrives at places of the world, those of each place one after the other. Equal settings give equal bits,
/// whatever the number of threads.
pub fn incoming(
    subject: Subject<'_>,
    settings: &LightVolumeSettings,
    places: &[DVec3],
    progress: Report<'_>,
) -> Result<Vec<[f64; 3]>> {
    let count = settings.coefficients();
    let per_place = settings.paths.max(1);
    let paths = places.len() as f64 * f64::from(per_place);
    let mut tracer = Tracer::with_paths(subject, &PathSettings::default(), paths)?;
    tracer.events -= 1;
    // The world is seen from inside of the medium whatever the film does with it.
    tracer.transparent = false;
    let share = 4.0 * PI / f64::from(per_place);
    let together = (RANGE_PATHS / per_place as usize).max(1);
    let ranges: Vec<(usize, &[DVec3])> =
        places.chunks(together).enumerate().map(|(number, places)| (number * together, places)).collect();
    let trace = |&(first, places): &(usize, &[DVec3])| -> Result<Vec<[f64; 3]>> {
        let mut sums = vec![[0.0; 3]; count * places.len()];
        let begun = (0..places.len() * per_place as usize).map(|item| {
            let (place, sample) = (item / per_place as usize, item as u32 % per_place);
            let sampler = Sampler::new((first + place) as u32, sample, settings.seed);
            let [across, around, offset, choice] = sampler.camera();
            let direction = direction([across, around]);
            let ray = Ray { origin: places[place], direction, near: 0.0, far: f64::INFINITY };
            tracer.begin_at(&ray, (first + place) as u32, sampler, [offset, choice], 0.0)
        });
        tracer.trace_paths(begun, &mut |path| {
            let [across, around, ..] = path.sampler.camera();
            let basis = harmonics(direction([across, around]));
            let at = count * (path.pixel as usize - first);
            for (sum, value) in sums[at..at + count].iter_mut().zip(basis) {
                (0..3).for_each(|channel| sum[channel] += share * value * path.radiance[channel]);
            }
        })?;
        Ok(sums)
    };
    let mut found = Vec::with_capacity(count * places.len());
    for ranges in ranges.chunks(RANGES) {
        let parts: Vec<Vec<[f64; 3]>> = ranges.par_iter().map(trace).collect::<Result<_>>()?;
        found.extend(parts.concat());
        progress(found.len() as f64 / (count * places.len()) as f64, "light volume");
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use std::path::Path;

    fn cube() -> Scene {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/scenes/homogeneous-cube.scene.json");
        Scene::load(&file).expect("the committed scene loads")
    }

    /// Outside of the medium, far from it, a world that is the same everywhere arrives from everywhere.
    #[test]
    fn a_constant_world_far_from_the_medium_is_the_first_harmonic() {
        let mut scene = cube();
        scene.lights.clear();
        scene.world.color = [1.0, 0.5, 0.25];
        scene.world.strength = 2.0;
        let radiance = crate::view::lights::world_radiance(&scene);
        assert_eq!(radiance, [2.0, 1.0, 0.5]);
        let settings = LightVolumeSettings { paths: 1024, bands: 2, seed: 7, ..LightVolumeSettings::of_cells(1) };
        let far = [DVec3::splat(1e5)];
        let found = incoming(Subject::from(&scene), &settings, &far, &|_, _| ()).expect("light");
        for channel in 0..3 {
            let whole = radiance[channel] * (4.0 * PI).sqrt();
            // The medium covers 1e-10 of the sphere.
            assert!((found[0][channel] / whole - 1.0).abs() < 1e-6, "{found:?}");
            // The Sobol points integrate the other harmonics to some 1/N: 1024 of them to a hundredth of the first.
            assert!(found[1..].iter().all(|one| one[channel].abs() < 0.01 * whole), "{found:?}");
        }
    }

    #[test]
    fn the_order_of_places_and_threads_changes_nothing() {
        let scene = cube();
        let settings = LightVolumeSettings { paths: 64, seed: 3, ..LightVolumeSettings::of_cells(1) };
        let places: Vec<DVec3> = (0..5).map(|number| DVec3::splat(0.1 * f64::from(number))).collect();
        let light = |places: &[DVec3]| incoming(Subject::from(&scene), &settings, places, &|_, _| ()).expect("light");
        let found = light(&places);
        assert_eq!(found.len(), 20);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
        assert_eq!(pool.install(|| light(&places)), found);
        assert_eq!(light(&places[..2]), found[..8], "a place's numbers are its own");
    }
}
