//! Path tracing of the lights of a scene apart: what no engine computes, and the truth itself.
//!
//! Light transport is linear in the lights. So the truth is the sum of a picture of the suns alone and one of the world alone; the first minus single
//! scattering of the suns is what orders behind the first add; and the world before a transparent film is what the medium scatters of it. All
//! pictures of a replica have the same seed, and so the same rays from the camera: what noise they have in common goes out of differences.

use crate::base::error::Result;
use crate::gpu::Backend;
use crate::integrators::path;
use crate::integrators::path::Subject;
use crate::measure::attribution::stages::scatters_world;
use crate::measure::errors::numbers;
use crate::measure::experiment::Desk;
use crate::measure::seeds;
use crate::measure::truth::{PixelRays, Truth};
use crate::scene::Scene;
use crate::scene::image::Image;
use cpu_time::ProcessTime;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::collections::BTreeMap;

/// Part of a ledger that holds them.
pub const PART: &str = "light";

/// Replicas of each picture, by the name of the lights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rendered {
    /// Processor time of all.
    pub seconds: f64,
    /// The seed of the first replica, the same for all lights.
    pub first_seed: u32,
    /// Files, relative to the folder.
    pub files: BTreeMap<String, Vec<String>>,
}

/// Pictures of the lights of a scene.
pub struct Components {
    /// The seed of the first replica.
    pub first_seed: u32,
    /// All light: what is measured against.
    pub truth: Vec<Image>,
    /// Of the suns, behind the first order.
    pub orders: Vec<Vec<f64>>,
    /// Of the world, scattered.
    pub ambient: Vec<Vec<f64>>,
}

/// The inputs of all of them.
pub(super) fn inputs(scene: &Scene, density: &str, truth: &Truth) -> Json {
    json!({"scene": scene.content_hash(), "density": density, "truth": truth, "purpose": "lights apart"})
}

/// A picture's name and scene.
fn asked(scene: &Scene) -> Vec<(&'static str, Scene)> {
    let mut suns = scene.clone();
    suns.world.strength = 0.0;
    let mut first = suns.clone();
    first.integrator.volume_bounces = 0;
    let mut world = scene.clone();
    world.lights.clear();
    let mut scattered = world.clone();
    scattered.film.transparent = true;
    let mut all = Vec::new();
    if !scene.lights.is_empty() {
        all.push(("suns", suns));
        all.push(("suns-first-order", first));
    }
    if scatters_world(scene) {
        all.push(("world", world));
        all.push(("world-scattered", scattered));
    }
    all
}

/// Renders what is missing.
pub(super) fn render(scene: &Scene, density: &str, truth: &Truth, key: &str, desk: &Desk<'_>) -> Result<Rendered> {
    let folder = desk.folder()?;
    let medium = Truth::medium(scene, density)?;
    let begin = ProcessTime::now();
    let mut files = BTreeMap::new();
    let first = seeds::first(&inputs(scene, density, truth));
    let all = asked(scene);
    for (number, (name, scene)) in all.iter().enumerate() {
        let file = |seed: u32| format!("{PART}/{key}.{name}.seed-{seed}.exr");
        let seeds: Vec<u32> = (first..first + truth.replicas).collect();
        let missing: Vec<u32> = seeds.iter().copied().filter(|&seed| !folder.join(file(seed)).exists()).collect();
        files.insert((*name).to_owned(), seeds.iter().map(|&seed| file(seed)).collect());
        let report = |done: f64, _: &str| desk.report((number as f64 + done) / all.len() as f64, name);
        let settings = truth.path_settings(PixelRays::Filtered);
        let subject = Subject { scene, medium: medium.as_ref() };
        if !missing.is_empty() {
            path::render_each(subject, &settings, Backend::Cpu, &missing, &report, &mut |seed, image| {
                image.write_exr(&folder.join(file(seed)), false)
            })?;
        }
    }
    Ok(Rendered { seconds: begin.elapsed().as_secs_f64(), first_seed: first, files })
}

impl Rendered {
    /// Reads the pictures and puts them together.
    pub(super) fn components(&self, desk: &Desk<'_>, truth: &Truth, size: [usize; 2]) -> Result<Components> {
        let folder = desk.folder()?;
        let black = || vec![Image::new(size[0], size[1]); truth.replicas as usize];
        let read = |name: &str| -> Result<Vec<Image>> {
            let Some(files) = self.files.get(name) else { return Ok(black()) };
            files.iter().map(|file| Image::read_exr(&folder.join(file))).collect()
        };
        let [suns, first, world, scattered] = ["suns", "suns-first-order", "world", "world-scattered"].map(read);
        let (suns, first, world, scattered) = (suns?, first?, world?, scattered?);
        let difference = |(all, one): (&Image, &Image)| {
            numbers(all).into_iter().zip(numbers(one)).map(|(all, one)| all - one).collect::<Vec<f64>>()
        };
        let sum = |(suns, world): (&Image, &Image)| {
            let mut sum = suns.clone();
            for (pixel, other) in sum.pixels.iter_mut().zip(&world.pixels) {
                (0..3).for_each(|channel| pixel[channel] += other[channel]);
            }
            sum
        };
        Ok(Components {
            first_seed: self.first_seed,
            truth: suns.iter().zip(&world).map(sum).collect(),
            orders: suns.iter().zip(&first).map(difference).collect(),
            ambient: scattered.iter().map(numbers).collect(),
        })
    }
}
