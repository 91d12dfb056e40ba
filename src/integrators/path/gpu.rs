//! The path integrator on the adapter: buffers and slices of `shaders/integrators/path/path.wgsl`.
//!
//! An invocation makes the samples of one pixel one after the other. Every dispatch ends after a number of
//! tentative collisions per pixel that follows the adapter's speed, so that none holds it for long; the
//! state waits in a buffer. Sums of up to 64 samples are f32, the rest is f64.
//!
//! Places of world space are relative to the middle of the medium's box, so that a scene far from the origin keeps its accuracy in f32.
//!
//! The random numbers along rays are those of the CPU, the others are not stratified: pictures of the same seed
//! are neither equal nor independent. Compare them with different seeds. The first event of a camera ray is one of its tentative collisions in every
//! pixel, kept by a reservoir.

use crate::base::arrays::{Mapped, each};
use crate::base::error::{Error, Result};
use crate::gpu::{Bindings, ComputeKernel, Gpu, Layout, Slices, layout};
use crate::graph::constants::{SharedConstants, SharedNumber};
use crate::graph::wgsl::Linker;
use crate::integrators::path::tracer::{Counters, EVENTS_BEFORE_ROULETTE, FAINT, Tracer, World, violation};
use crate::media::majorant::{LEVELS, TABLE_LEVEL};
use crate::media::medium::Medium;
use crate::shader_struct;
use crate::view::sampled_lights::{GpuLight, POINT, SPOT, SUN_DISC};
use bytemuck::Zeroable;
use glam::{DMat4, DVec3};
use rayon::prelude::*;
use std::time::Instant;

const PATH: &str = include_str!("../../../shaders/integrators/path/path.wgsl");

/// Import path of the world's nodes.
pub const WORLD_PATH: &str = "cloudparity::surroundings";

/// The shader's stage of a pixel without a path.
const FINISHED: u32 = 4;

/// Pixels of one dispatch: enough for every lane of an adapter, at 300 bytes each.
const PIXELS: usize = 1 << 17;

/// Pixels of one dispatch of a software adapter, which has few lanes.
const SOFTWARE_PIXELS: usize = 1 << 13;

/// Bytes of the camera rays of some pixels and samples.
const RAY_BYTES: usize = 64 << 20;

/// Samples that are summed in f32: the sum of 64 errs by 64 roundings of itself at most, 4e-6.
const SAMPLES_TOGETHER: u32 = 64;

/// Tentative collisions per pixel of the first dispatch, before anything is known of the adapter.
const FIRST_BUDGET: usize = 4;

/// Tentative collisions per pixel of one dispatch.
const BUDGETS: std::ops::RangeInclusive<usize> = 1..=1 << 16;

/// The same of a software adapter, whose loops end early otherwise ([`crate::gpu::SOFTWARE_LOOPS`]): a
/// texture of 16 octaves of 625 cells goes through 10,000 iterations, the way to a collision through some thousand.
const SOFTWARE_BUDGETS: std::ops::RangeInclusive<usize> = 1..=4;

/// Nodes of the tree of a mesh after which an invocation waits for the next dispatch: below the loops of a software adapter
/// ([`crate::gpu::SOFTWARE_LOOPS`]) with room for those of the way to a collision and of the search that is on its way.
const MOST_VISITS: u32 = 1 << 13;

shader_struct! {
    struct Stage = "Stage" {
        scattering: [f32; 3],
        anisotropy: f32,
        extinction: [f32; 3],
        events: u32,
        share: [f32; 3],
        lights: u32,
        emission: [f32; 3],
        scatters: u32,
        world: [f32; 3],
        transparent: u32,
        low: [f32; 3],
        pixels: u32,
        cells_per_metre: [f32; 3],
        samples: u32,
        cell: [f32; 3],
        budget: u32,
        to_object: [[f32; 4]; 3],
        first_pixel: u32,
        first_sample: u32,
        seed: u32,
        table: u32,
        inside: [u32; 3],
        end_padding: u32,
    }
}

shader_struct! {
    struct Ray = "Ray" {
        origin: [f32; 3],
        length: f32,
        direction: [f32; 3],
        padding: f32,
    }
}

/// Numbers that the kernel imports.
pub const CONSTANTS: SharedConstants = SharedConstants {
    path: "cloudparity::path::constants",
    numbers: &[
        ("FINISHED", SharedNumber::Unsigned(FINISHED)),
        ("LEVELS", SharedNumber::Unsigned(LEVELS)),
        ("TABLE_LEVEL", SharedNumber::Unsigned(TABLE_LEVEL)),
        ("FAINT", SharedNumber::Float(FAINT as f32)),
        ("EVENTS_BEFORE_ROULETTE", SharedNumber::Unsigned(EVENTS_BEFORE_ROULETTE)),
        ("SUN_DISC", SharedNumber::Unsigned(SUN_DISC)),
        ("POINT", SharedNumber::Unsigned(POINT)),
        ("SPOT", SharedNumber::Unsigned(SPOT)),
        ("MOST_VISITS", SharedNumber::Unsigned(MOST_VISITS)),
    ],
};

/// A path's state, which only the shader knows.
const STATE: &str = "Path";

/// Layouts of the kernel's structs.
pub(crate) const LAYOUTS: &[Layout] = &[
    Layout::of::<Stage>(),
    Layout::of::<Ray>(),
    Layout::of::<GpuLight>(),
    Layout::of::<Outcome>(),
    Layout::unread(STATE),
];

shader_struct! {
    struct Outcome = "Outcome" {
        radiance: [f32; 3],
        opacity: f32,
        collisions: u32,
        scatterings: u32,
        null_collisions: f32,
        finished: u32,
        place: [f32; 3],
        extinction: f32,
        majorant: f32,
        padding: [u32; 7],
    }
}

/// The kernel with what all its dispatches read.
pub(super) struct PathKernel<'a> {
    tracer: &'a Tracer,
    gpu: &'a Gpu,
    kernel: ComputeKernel,
    stage: Stage,
    /// Words of a path's state, and which of them is its stage.
    state_words: usize,
    state_stage: usize,
    tree: wgpu::Buffer,
    rates: wgpu::Buffer,
    lights: wgpu::Buffer,
    /// Textures of the density.
    textures: Option<wgpu::Buffer>,
    /// The mesh that the medium fills, if it does not fill a box.
    mesh: Option<wgpu::Buffer>,
    pixels: usize,
    /// Middle of the medium's box in world space: the origin of the shader's places.
    middle: DVec3,
}

impl<'a> PathKernel<'a> {
    /// Compiles the kernel; None where no ray can meet the medium. It knows one object whose coefficients are one
    /// density times constants, one Henyey-Greenstein lobe and a world that is constant or of nodes, and rejects the rest. A world
    /// of nodes is found by scattered rays alone, not sampled as a light: small bright parts of it are noisier than on the CPU.
    pub(crate) fn new(tracer: &'a Tracer, gpu: &'a Gpu) -> Result<Option<Self>> {
        let Some(majorants) = &tracer.volume.majorants else { return Ok(None) };
        let medium = tracer.volume.single().and_then(Medium::of).map_err(|cause| {
            Error::new(
                format!("path tracing on the adapter, {}", cause.place),
                cause.found,
                "one object whose coefficients are one density times constants, and one Henyey-Greenstein lobe",
                "Trace on the CPU, which knows all media.",
            )
            .with_setting("backend")
        })?;
        if medium.emission_of_density != [0.0; 3] {
            return Err(Error::new(
                "path tracing on the adapter",
                "an emission whose strength is the density",
                "a constant emission: the adapter knows no other yet",
                "Trace on the CPU.",
            )
            .with_setting("backend"));
        }
        let nodes = match &tracer.world {
            World::Constant(_) => None,
            World::Picture(around) => Some(around.program().ok_or_else(|| {
                Error::new(
                    "path tracing on the adapter, $.world.image",
                    "a picture around the scene",
                    "a constant world, or one of nodes: the adapter knows no other yet",
                    "Trace on the CPU.",
                )
                .with_setting("backend")
            })?),
        };
        // Nodes may send something from anywhere: no ray is left out.
        let world = if let World::Constant(radiance) = tracer.world { radiance } else { [1.0; 3] };
        let flat = majorants.flat();
        let single = |values: [f64; 3]| values.mapped(|value| value as f32);
        let vector = |value: DVec3| value.as_vec3().to_array();
        let middle =
            tracer.volume.to_frame.inverse().transform_point3(flat.low + flat.cell * flat.inside.as_dvec3() / 2.0);
        let transform = tracer.volume.to_frame * DMat4::from_translation(middle);
        let mut lights =
            tracer.lights.iter().map(|light| light.on_adapter(middle)).collect::<Result<Vec<GpuLight>>>()?;
        let stage = Stage {
            scattering: single(medium.scattering),
            anisotropy: medium.anisotropy as f32,
            extinction: single(medium.extinction),
            events: tracer.events,
            share: single(tracer.volume.share),
            lights: lights.len() as u32,
            emission: single(tracer.volume.emission),
            scatters: tracer.volume.scatters().into(),
            world: single(world),
            transparent: tracer.transparent.into(),
            low: vector(flat.low),
            cells_per_metre: vector(1.0 / flat.cell),
            cell: vector(flat.cell),
            to_object: each(|row| transform.row(row).as_vec4().to_array()),
            table: flat.nodes,
            inside: flat.inside.to_array(),
            ..Stage::zeroed()
        };
        // A buffer cannot be empty: a scene without lights has one that is never read.
        lights.resize(lights.len().max(1), GpuLight::zeroed());
        let storage = wgpu::BufferUsages::STORAGE;
        let mut linker = Linker::new(medium.density.program())?;
        if let Some(nodes) = nodes {
            linker.add_program(WORLD_PATH, nodes)?;
        }
        let textures = gpu.upload_textures(linker.textures())?;
        linker.add_constants(&CONSTANTS);
        let conditions = [(medium.mesh.is_some(), "MESH"), (nodes.is_some(), "WORLD")];
        let definitions: Vec<&str> = conditions.into_iter().filter_map(|(holds, name)| holds.then_some(name)).collect();
        let module = linker.link_with("integrators/path/path.wgsl", PATH, &definitions)?;
        // The walk counts cells.
        let mesh = medium.mesh.as_ref().map(|mesh| mesh.mesh().upload(gpu, flat.low, flat.cell)).transpose()?;
        let (state_bytes, stage_byte) = layout::place(&module, STATE, "stage")?;
        let software = gpu.adapter().is_software();
        Ok(Some(Self {
            tracer,
            gpu,
            kernel: gpu.kernel("path", &module, LAYOUTS)?,
            stage,
            state_words: state_bytes / size_of::<u32>(),
            state_stage: stage_byte / size_of::<u32>(),
            tree: gpu.upload("majorant tree", bytemuck::cast_slice(&flat.tree), storage),
            rates: gpu.upload("rates and majorants", bytemuck::cast_slice(&flat.rates), storage),
            lights: gpu.upload("lights", bytemuck::cast_slice(&lights), storage),
            textures,
            mesh,
            pixels: if software { SOFTWARE_PIXELS } else { PIXELS },
            middle,
        }))
    }

    /// The adapter's description.
    pub(crate) fn adapter(&self) -> &crate::gpu::Adapter {
        self.gpu.adapter()
    }

    /// Sums over some samples of every pixel, and what was counted.
    pub(crate) fn pass(&self, first_sample: u32, samples: u32, seed: u32) -> Result<(Vec<[f64; 4]>, Counters)> {
        let total = self.tracer.size.iter().map(|&side| side as usize).product::<usize>();
        let mut sums = vec![[0.0; 4]; total];
        let mut counters = Counters { paths: total as u64 * u64::from(samples), ..Counters::default() };
        let budgets = if self.gpu.adapter().is_software() { SOFTWARE_BUDGETS } else { BUDGETS };
        let mut budget = Slices::within(FIRST_BUDGET, budgets);
        let together = (RAY_BYTES / size_of::<Ray>() / self.pixels).clamp(1, SAMPLES_TOGETHER as usize) as u32;
        for first_pixel in (0..total).step_by(self.pixels) {
            let pixels = self.pixels.min(total - first_pixel);
            for sample in (0..samples).step_by(together as usize) {
                let stage = Stage {
                    pixels: pixels as u32,
                    samples: together.min(samples - sample),
                    first_pixel: first_pixel as u32,
                    first_sample: first_sample + sample,
                    seed,
                    ..self.stage
                };
                for (outcome, sum) in self.trace(stage, &mut budget)?.iter().zip(&mut sums[first_pixel..]) {
                    for (sum, found) in sum.iter_mut().zip(outcome.radiance) {
                        *sum += f64::from(found);
                    }
                    sum[3] += f64::from(outcome.opacity);
                    counters.collisions += u64::from(outcome.collisions);
                    counters.scatterings += u64::from(outcome.scatterings);
                    counters.null_collisions += f64::from(outcome.null_collisions);
                }
            }
        }
        Ok((sums, counters))
    }

    /// The samples of some pixels, slice by slice.
    fn trace(&self, stage: Stage, budget: &mut Slices) -> Result<Vec<Outcome>> {
        let gpu = self.gpu;
        let pixels = stage.pixels as usize;
        let storage = wgpu::BufferUsages::STORAGE;
        let of_slot = |slot: u32| {
            let samples = stage.first_sample..stage.first_sample + stage.samples;
            samples.map(move |sample| self.camera_ray(stage.first_pixel + slot, sample, stage.seed))
        };
        let rays: Vec<Ray> = (0..stage.pixels).into_par_iter().flat_map_iter(of_slot).collect();
        let rays = gpu.upload("rays", bytemuck::cast_slice(&rays), storage);
        let mut states = vec![0_u32; pixels * self.state_words];
        let stages = states.iter_mut().skip(self.state_stage).step_by(self.state_words);
        stages.for_each(|word| *word = FINISHED);
        let states = gpu.upload("paths", bytemuck::cast_slice(&states), storage);
        let outcomes = vec![Outcome::zeroed(); pixels];
        let bytes = size_of_val(outcomes.as_slice()) as u64;
        let outcomes = gpu.upload("outcomes", bytemuck::cast_slice(&outcomes), storage | wgpu::BufferUsages::COPY_SRC);
        loop {
            let begin = Instant::now();
            let stage = Stage { budget: budget.size() as u32, ..stage };
            let stage = gpu.upload("stage", bytemuck::bytes_of(&stage), wgpu::BufferUsages::UNIFORM);
            let buffers = [&stage, &rays, &self.tree, &self.rates, &self.lights, &states, &outcomes];
            gpu.dispatch(
                &self.kernel,
                &Bindings::new().group(0, buffers.into_iter().chain(&self.mesh)).group(1, &self.textures),
                [pixels as u32, 1, 1],
            )?;
            let found: Vec<Outcome> = bytemuck::pod_collect_to_vec(&gpu.read_back(&outcomes, bytes)?);
            budget.adapt(begin.elapsed());
            if let Some(wrong) = found.iter().find(|outcome| outcome.majorant != 0.0) {
                return Err(violation(wrong.place, f64::from(wrong.extinction), f64::from(wrong.majorant)));
            }
            if found.iter().all(|outcome| outcome.finished != 0) {
                return Ok(found);
            }
        }
    }

    /// The part of a camera ray that lies in the medium.
    fn camera_ray(&self, pixel: u32, sample: u32, seed: u32) -> Ray {
        let path = self.tracer.begin(pixel, sample, seed);
        let vector = |value: DVec3| value.as_vec3().to_array();
        let end = path.end_of_parts().unwrap_or(path.walk.end);
        Ray {
            origin: vector(path.origin - self.middle + path.direction * path.walk.distance),
            length: (end - path.walk.distance) as f32,
            direction: vector(path.direction),
            padding: 0.0,
        }
    }
}
