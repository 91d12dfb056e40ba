//! What the specialised march of a scene leaves out, and what that is worth: size of its kernel, time, and the same picture.
//!
//! The generic kernel does all work of `march` whatever the scene: it looks up empty cells, evaluates a phase function, asks for light of suns
//! and of the world. The specialised one lacks what [`Omission`] lists. Both are linked with the same specialised density program, so what
//! the graph's own passes leave out is not counted here; `cloudparity explain` lists that by node.

use crate::base::error::Result;
use crate::gpu::Backend;
use crate::gpu::Gpu;
use crate::graph::wgsl::{self, Language};
use crate::integrators::march::gpu::march_module;
use crate::integrators::march::{Omission, Stage};
use crate::integrators::{MarchSettings, render};
use crate::measure::errors::values::ulp_distance;
use crate::scene::Scene;
use crate::scene::image::Image;
use cpu_time::ProcessTime;
use serde::{Deserialize, Serialize};

/// Timed renders of each kind, in turns; their medians count.
const REPEATS: usize = 3;

/// Cells of the light grid along the longest side: the kernels are compared, not pictures with the truth.
const GRID_CELLS: u32 = 24;

/// Directions from which the world shines.
const WORLD_DIRECTIONS: u32 = 16;

/// Columns of the timed pictures.
const WIDTH: u32 = 96;

/// First word of a SPIR-V module's instructions.
const SPIRV_HEADER: usize = 5;

/// A marching kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct KernelSize {
    /// Bytes of its WGSL, density program included.
    pub wgsl_bytes: usize,
    /// SPIR-V instructions.
    pub spirv_instructions: usize,
}

/// Specialised against generic on one worker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Race {
    /// What renders.
    pub worker: String,
    /// Median processor seconds of a picture by the generic march.
    pub generic_seconds: f64,
    /// By the specialised one.
    pub specialised_seconds: f64,
    /// How often the specialised one is faster.
    pub ratio: f64,
    /// Largest difference of a value, in units in the last place; 0 is the same bits.
    pub largest_ulp: u32,
}

/// What leaving out is worth in a scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LeavingOut {
    /// Name of the scene.
    pub scene: String,
    /// What is left out.
    pub left_out: Vec<Omission>,
    /// The generic kernel.
    pub generic: KernelSize,
    /// The specialised one; none where no step is marched.
    pub specialised: Option<KernelSize>,
    /// On all cores, and on the adapter where there is one.
    pub races: Vec<Race>,
}

/// Measures a scene's march: single scattering at a small size and quality, whatever the scene's.
pub fn measure(scene: &Scene, with_adapter: bool) -> Result<LeavingOut> {
    let mut scene = scene.clone();
    scene.set_volume_bounces(0);
    let [width, height] = scene.image_size();
    scene.film.resolution = [WIDTH, (WIDTH * height).div_ceil(width).max(1)];
    scene.film.resolution_percentage = 100;
    let settings = MarchSettings {
        grid_cells: GRID_CELLS,
        world_directions: WORLD_DIRECTIONS,
        sub_pixels: 1,
        ..MarchSettings::default()
    };
    let special = settings.resolved(&scene)?;
    let generic = MarchSettings { specialise: false, ..special.clone() };
    let stage = Stage::new(&scene, &special)?;
    let mut races = vec![race(&scene, [&special, &generic], Backend::Cpu, "CPU".to_owned())?];
    if with_adapter {
        races.push(race(&scene, [&special, &generic], Backend::Gpu, Gpu::open()?.adapter().name.clone())?);
    }
    let specialised = if stage.leaves_out(Omission::ViewSteps) { None } else { Some(kernel(&stage)?) };
    Ok(LeavingOut {
        scene: scene.name.clone(),
        left_out: stage.left_out.clone(),
        generic: kernel(&Stage::new(&scene, &generic)?)?,
        specialised,
        races,
    })
}

fn kernel(stage: &Stage<'_>) -> Result<KernelSize> {
    let module = march_module(stage)?;
    Ok(KernelSize {
        wgsl_bytes: wgsl::write(&module, Language::Wgsl)?.len(),
        spirv_instructions: instructions(&wgsl::write(&module, Language::Spirv)?),
    })
}

/// Number of instructions of a SPIR-V module: the upper half of an instruction's first word is its length in words.
fn instructions(bytes: &[u8]) -> usize {
    let words: Vec<u32> =
        bytes.chunks_exact(4).map(|word| u32::from_le_bytes(word.try_into().expect("4 bytes"))).collect();
    let (mut at, mut count) = (SPIRV_HEADER, 0);
    while at < words.len() {
        at += (words[at] >> 16).max(1) as usize;
        count += 1;
    }
    count
}

fn race(scene: &Scene, settings: [&MarchSettings; 2], backend: Backend, worker: String) -> Result<Race> {
    let picture = |settings: &MarchSettings| render(scene, settings, backend, &|_, _| ());
    // The first of each does not count: caches are cold, pipelines are compiled.
    let pictures = [picture(settings[0])?, picture(settings[1])?];
    let mut times = [Vec::new(), Vec::new()];
    for _ in 0..REPEATS {
        for side in 0..2 {
            let begin = ProcessTime::now();
            picture(settings[side])?;
            times[side].push(begin.elapsed().as_secs_f64());
        }
    }
    let [specialised_seconds, generic_seconds] = times.map(|mut times| {
        times.sort_by(f64::total_cmp);
        times[REPEATS / 2]
    });
    Ok(Race {
        worker,
        generic_seconds,
        specialised_seconds,
        ratio: generic_seconds / specialised_seconds,
        largest_ulp: largest_ulp(&pictures[0], &pictures[1]),
    })
}

/// Largest distance of two values on the line of f32.
fn largest_ulp(a: &Image, b: &Image) -> u32 {
    let pairs = a.pixels.iter().flatten().zip(b.pixels.iter().flatten());
    pairs.map(|(&a, &b)| ulp_distance(a, b)).max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instructions_are_counted_by_their_lengths() {
        let words: [u32; 9] = [0, 0, 0, 0, 0, (2 << 16) | 17, 1, (1 << 16) | 253, (1 << 16) | 56];
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        assert_eq!(instructions(&bytes), 3);
    }

    #[test]
    fn distances_count_numbers_between() {
        assert_eq!(ulp_distance(0.0, -0.0), 0);
        assert_eq!(ulp_distance(1.0f32.next_up(), 1.0), 1);
        assert_eq!(ulp_distance(0.0f32.next_up(), 0.0f32.next_down()), 2);
    }
}
