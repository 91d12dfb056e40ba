//! The marching kernels of `shaders/integrate/` and their buffers.
//!
//! The grid is baked and swept on the adapter (that of a mesh by the CPU), then view rays are marched in slices, and in a mesh part by part:
//! parts of rays come from the CPU, which has the exact arithmetic for them. Every
//! submission is small enough to leave the adapter to others: slices start small and grow while
//! they stay below [`SLICE_SECONDS`].

use crate::base::error::{Error, Result};
use crate::gpu::{Bindings, ComputeKernel, Gpu, Layout, Slices};
use crate::graph::constants::{SharedConstants, SharedNumber};
use crate::graph::wgsl::Linker;
use crate::integrators::LightMode;
use crate::integrators::march::light_grid::{LightGrid, Sweep, sweep_axes};
use crate::integrators::march::{Omission, Stage, ViewRay};
use crate::media::density::CELLS;
use crate::media::medium::Medium;
use crate::media::transfer::Integration;
use crate::shader_struct;
use crate::view::lights::{Source, harmonics};
use bytemuck::Zeroable;
use glam::DVec3;
use std::time::Instant;

const BAKE: &str = include_str!("../../../shaders/integrators/march/light_grid_bake.wgsl");
const TRACE: &str = include_str!("../../../shaders/integrators/march/light_grid_trace.wgsl");
const GATHER: &str = include_str!("../../../shaders/integrators/march/light_grid_gather.wgsl");
const MARCH: &str = include_str!("../../../shaders/integrators/march/march.wgsl");

/// Steps of a ray in one dispatch of a software adapter, whose loops end early otherwise
/// ([`crate::gpu::SOFTWARE_LOOPS`]): a step of the cloud with light from the world goes through about 1,000 iterations.
const SOFTWARE_STEPS: usize = 16;

/// Smallest and largest number of invocations of a slice, and that of the first.
const SLICES: std::ops::RangeInclusive<usize> = 256..=1 << 20;
const FIRST_SLICE: usize = 1024;

shader_struct! {
    struct BakeUniform = "Bake" {
        low: [f32; 3],
        first: u32,
        step: [f32; 3],
        count: u32,
        size: [u32; 3],
        padding: u32,
    }
}

shader_struct! {
    struct SweepUniform = "Sweep" {
        size: [u32; 3],
        rising: u32,
        strides: [u32; 3],
        rows: u32,
        slope: [f32; 2],
        distance: f32,
        columns: u32,
        first_row: i32,
        first_column: i32,
        channel: u32,
        padding: u32,
    }
}

shader_struct! {
    struct Offset = "Offset" {
        whole: [i32; 2],
        fraction: [f32; 2],
    }
}

shader_struct! {
    struct WorldUniform = "World" {
        extinction: [f32; 3],
        extinctions: u32,
        weights: [f32; 16],
        harmonics: u32,
        padding: [u32; 7],
    }
}

shader_struct! {
    struct StageUniform = "Stage" {
        extinction: [f32; 3],
        anisotropy: f32,
        scattering: [f32; 3],
        exit_transmittance: f32,
        emission: [f32; 3],
        cells: u32,
        world: [f32; 3],
        lights: u32,
        bounds_low: [f32; 3],
        harmonics: u32,
        bounds_high: [f32; 3],
        vertices: u32,
        grid_low: [f32; 3],
        rays: u32,
        grid_scale: [f32; 3],
        lit_by_world: u32,
        grid_size: [u32; 3],
        first_step: u32,
        extinction_of_channel: [u32; 3],
        end_step: u32,
        emission_of_density: [f32; 3],
        goes_on: u32,
    }
}

shader_struct! {
    struct Ray = "Ray" {
        local: [f32; 3],
        step: f32,
        local_step: [f32; 3],
        steps: u32,
        position: [f32; 3],
        padding: f32,
        direction: [f32; 3],
        more_padding: f32,
    }
}

shader_struct! {
    struct Light = "Light" {
        place: [f32; 3],
        kind: u32,
        axis: [f32; 3],
        edge: f32,
        power: [f32; 3],
        blend: f32,
    }
}

shader_struct! {
    struct Outcome = "Outcome" {
        radiance: [f32; 3],
        padding: f32,
        transmittance: [f32; 3],
        more_padding: f32,
    }
}

/// Kinds of lights in the march: a sun, a point, a spot.
const SUN: u32 = 0;
const POINT: u32 = 1;
const SPOT: u32 = 2;

/// Numbers that the march imports.
pub const CONSTANTS: SharedConstants = SharedConstants {
    path: "cloudparity::march::constants",
    numbers: &[
        ("CELLS", SharedNumber::Unsigned(CELLS as u32)),
        ("POINT", SharedNumber::Unsigned(POINT)),
        ("SPOT", SharedNumber::Unsigned(SPOT)),
    ],
};

/// Layouts of the structs of the march, of the bake, of the sweeps.
pub(crate) const LAYOUTS: &[Layout] =
    &[Layout::of::<StageUniform>(), Layout::of::<Ray>(), Layout::of::<Light>(), Layout::of::<Outcome>()];
const BAKE_LAYOUTS: &[Layout] = &[Layout::of::<BakeUniform>()];
const SWEEP_LAYOUTS: &[Layout] = &[Layout::of::<SweepUniform>(), Layout::of::<Offset>(), Layout::of::<WorldUniform>()];

/// Links an entry text with the density of a medium.
fn link(medium: &Medium, path: &str, source: &str, definitions: &[&str]) -> Result<naga::Module> {
    let mut linker = Linker::new(medium.density.program())?;
    linker.add_constants(&CONSTANTS);
    linker.link_with(path, source, definitions)
}

/// The textures that every kernel linked with the density reads.
fn textures(gpu: &Gpu, medium: &Medium) -> Result<Option<wgpu::Buffer>> {
    gpu.upload_textures(Linker::new(medium.density.program())?.textures())
}

/// The kernel that marches rays, with what the stage leaves out left out.
pub(crate) fn march_module(stage: &Stage<'_>) -> Result<naga::Module> {
    link(&stage.medium, "integrators/march/march.wgsl", MARCH, &definitions(stage))
}

/// Everything on the adapter that marching a ray needs.
pub(crate) struct Kernels<'a> {
    gpu: &'a Gpu,
    march: ComputeKernel,
    /// Textures of the density.
    textures: Option<wgpu::Buffer>,
    uniform: StageUniform,
    lights: wgpu::Buffer,
    cells: wgpu::Buffer,
    grid: wgpu::Buffer,
    anisotropy: f64,
    harmonics: usize,
    view_step: f64,
    /// Middle of the medium's box in world space: the origin of the shader's places, so that a scene far from the origin keeps its accuracy.
    middle: DVec3,
}

impl<'a> Kernels<'a> {
    /// Compiles the kernels and bakes the light grid.
    pub(crate) fn bake(gpu: &'a Gpu, stage: &Stage<'_>, progress: &(dyn Fn(f64) + Sync)) -> Result<Self> {
        if stage.settings.light == LightMode::Exact {
            return Err(Error::new(
                "setting light",
                "the mode exact on the adapter",
                "grid: shadow rays through the density exist on the CPU only",
                "Take the light from a grid, or march on the CPU.",
            )
            .with_setting("light")
            .with_setting("backend"));
        }
        let mut layout = LightGrid::layout(&stage.medium, &stage.settings);
        let textures = textures(gpu, &stage.medium)?;
        let grid = if stage.leaves_out(Omission::InScatter) {
            zeros(gpu, "light", 1)?
        } else if stage.medium.mesh.is_some() {
            upload_light(gpu, stage, progress)?
        } else {
            bake_light(gpu, stage, textures.as_ref(), &mut layout, progress)?
        };
        let medium = &stage.medium;
        let single = |values: [f64; 3]| values.map(|value| value as f32);
        let vector = |value: DVec3| value.as_vec3().to_array();
        let middle =
            medium.to_object.inverse().transform_point3((medium.density.bounds.low + medium.density.bounds.high) / 2.0);
        let uniform = StageUniform {
            extinction: single(medium.extinction),
            anisotropy: medium.anisotropy as f32,
            scattering: single(medium.scattering),
            exit_transmittance: stage.settings.exit_transmittance as f32,
            emission: single(medium.emission),
            cells: CELLS as u32,
            world: single(stage.world),
            lights: stage.lights.len() as u32,
            bounds_low: vector(medium.density.bounds.low),
            harmonics: layout.harmonics as u32,
            bounds_high: vector(medium.density.bounds.high),
            vertices: layout.vertices() as u32,
            grid_low: vector(layout.low),
            rays: 0,
            grid_scale: vector(1.0 / layout.step),
            lit_by_world: (!stage.directions.is_empty()).into(),
            grid_size: layout.size.map(|count| count as u32),
            first_step: 0,
            extinction_of_channel: layout.extinction_of_channel.map(|number| number as u32),
            end_step: 0,
            emission_of_density: single(medium.emission_of_density),
            goes_on: 0,
        };
        // A buffer cannot be empty: a scene without lights has one that is never read.
        let mut lights: Vec<Light> = stage
            .lights
            .iter()
            .map(|light| {
                let power = single(light.power);
                match &light.source {
                    Source::Direction(towards) => {
                        Light { place: vector(*towards), kind: SUN, power, ..Light::zeroed() }
                    }
                    Source::Position(place, None) => {
                        Light { place: vector(*place - middle), kind: POINT, power, ..Light::zeroed() }
                    }
                    Source::Position(place, Some((axis, edge, blend))) => Light {
                        place: vector(*place - middle),
                        kind: SPOT,
                        axis: vector(*axis),
                        edge: *edge as f32,
                        power,
                        blend: *blend as f32,
                    },
                }
            })
            .collect();
        lights.resize(lights.len().max(1), Light::zeroed());
        let cells: Vec<u32> = medium.density.cells().into_iter().map(u32::from).collect();
        let storage = wgpu::BufferUsages::STORAGE;
        let module = march_module(stage)?;
        Ok(Self {
            gpu,
            march: gpu.kernel("march", &module, LAYOUTS)?,
            textures,
            uniform,
            lights: gpu.upload("lights", bytemuck::cast_slice(&lights), storage),
            cells: gpu.upload("cells", bytemuck::cast_slice(&cells), storage),
            grid,
            anisotropy: medium.anisotropy,
            harmonics: layout.harmonics,
            view_step: stage.settings.view_step,
            middle,
        })
    }

    /// Takes rays to their ends.
    pub(crate) fn march(&self, rays: &mut [Option<ViewRay>]) -> Result<()> {
        let mut waiting: Vec<&mut ViewRay> = rays.iter_mut().flatten().collect();
        let mut slices = Slices::within(FIRST_SLICE, SLICES);
        let mut first = 0;
        while first < waiting.len() {
            let begin = Instant::now();
            let last = waiting.len().min(first + slices.size());
            self.march_slice(&mut waiting[first..last])?;
            slices.adapt(begin.elapsed());
            first = last;
        }
        Ok(())
    }

    fn march_slice(&self, rays: &mut [&mut ViewRay]) -> Result<()> {
        let bases: Vec<f32> = rays
            .iter()
            .flat_map(|ray| {
                let basis = harmonics(ray.direction);
                (0..self.harmonics).map(move |harmonic| {
                    let band = (harmonic as f64).sqrt() as i32;
                    (self.anisotropy.powi(band) * basis[harmonic]) as f32
                })
            })
            .collect();
        let gpu = self.gpu;
        let storage = wgpu::BufferUsages::STORAGE;
        // NaN in what no invocation wrote is seen in the picture.
        let nothing = Outcome { radiance: [f32::NAN; 3], transmittance: [f32::NAN; 3], ..Outcome::zeroed() };
        let unwritten = vec![nothing; rays.len()];
        let unwritten: &[u8] = bytemuck::cast_slice(&unwritten);
        let outcomes = gpu.upload("outcomes", unwritten, storage | wgpu::BufferUsages::COPY_SRC);
        let bases = gpu.upload("bases", bytemuck::cast_slice(&bases), storage);
        self.march_part(rays, false, &bases, &outcomes)?;
        // Rays through a mesh may have further parts; those that have none take no step.
        loop {
            let mut goes_on = false;
            for ray in rays.iter_mut() {
                if ray.next_part(self.view_step) {
                    goes_on = true;
                } else {
                    ray.steps = 0;
                }
            }
            if !goes_on {
                break;
            }
            self.march_part(rays, true, &bases, &outcomes)?;
        }
        let bytes = gpu.read_back(&outcomes, unwritten.len() as u64)?;
        let found: Vec<Outcome> = bytemuck::pod_collect_to_vec(&bytes);
        for (ray, outcome) in rays.iter_mut().zip(found) {
            ray.radiance = outcome.radiance.map(f64::from);
            ray.transmittance = outcome.transmittance.map(f64::from);
        }
        Ok(())
    }

    /// Takes rays through their present parts, from what was found before if they go on.
    fn march_part(
        &self,
        rays: &[&mut ViewRay],
        goes_on: bool,
        bases: &wgpu::Buffer,
        outcomes: &wgpu::Buffer,
    ) -> Result<()> {
        let vector = |value: DVec3| value.as_vec3().to_array();
        let data: Vec<Ray> = rays
            .iter()
            .map(|ray| {
                let distance = ray.start + ray.offset * ray.step;
                Ray {
                    local: vector(ray.local_origin + ray.local_direction * distance),
                    step: ray.step as f32,
                    local_step: vector(ray.local_direction * ray.step),
                    steps: ray.steps as u32,
                    position: vector(ray.origin - self.middle + ray.direction * distance),
                    direction: vector(ray.direction),
                    ..Ray::zeroed()
                }
            })
            .collect();
        let gpu = self.gpu;
        let steps = rays.iter().map(|ray| ray.steps).max().unwrap_or(0);
        let together = if gpu.adapter().is_software() { SOFTWARE_STEPS } else { steps.max(1) };
        let data = gpu.upload("rays", bytemuck::cast_slice(&data), wgpu::BufferUsages::STORAGE);
        for first_step in (0..steps).step_by(together) {
            let uniform = StageUniform {
                rays: rays.len() as u32,
                first_step: first_step as u32,
                end_step: (first_step + together) as u32,
                goes_on: goes_on.into(),
                ..self.uniform
            };
            let stage = gpu.upload("stage", bytemuck::bytes_of(&uniform), wgpu::BufferUsages::UNIFORM);
            let buffers = [&stage, &data, &self.lights, bases, &self.cells, &self.grid, outcomes];
            let bindings = Bindings::new().group(0, buffers).group(1, &self.textures);
            gpu.dispatch(&self.march, &bindings, [rays.len() as u32, 1, 1])?;
        }
        Ok(())
    }
}

/// What the marching kernel is compiled with.
fn definitions(stage: &Stage<'_>) -> Vec<&'static str> {
    let mut definitions: Vec<&str> = [
        (Omission::InScatter, "WITHOUT_IN_SCATTER"),
        (Omission::Lights, "WITHOUT_LIGHTS"),
        (Omission::World, "WITHOUT_WORLD"),
        (Omission::Phase, "WITHOUT_PHASE"),
        (Omission::EmptyCells, "WITHOUT_EMPTY_CELLS"),
    ]
    .into_iter()
    .filter_map(|(omission, name)| stage.leaves_out(omission).then_some(name))
    .collect();
    if stage.settings.integration == Integration::Plain {
        definitions.push("PLAIN_INTEGRATION");
    }
    if stage.medium.emission_of_density != [0.0; 3] {
        definitions.push("EMISSION_OF_DENSITY");
    }
    definitions
}

/// Light at the vertices of the grid over a mesh, baked on the CPU.
fn upload_light(gpu: &Gpu, stage: &Stage<'_>, progress: &(dyn Fn(f64) + Sync)) -> Result<wgpu::Buffer> {
    let lit_by_world = !stage.directions.is_empty();
    let grid = LightGrid::bake(&stage.medium, &stage.lights, lit_by_world, &stage.settings, progress)?;
    let light: Vec<f32> = grid.depths.iter().chain(&grid.world).flatten().copied().collect();
    check_size(gpu, "light", 4 * light.len() as u64, "grid_cells")?;
    // A buffer cannot be empty.
    let light = if light.is_empty() { vec![0.0] } else { light };
    Ok(gpu.upload("light", bytemuck::cast_slice(&light), wgpu::BufferUsages::STORAGE))
}

/// Light at the vertices of the grid: depths per light, then coefficients of the world.
fn bake_light(
    gpu: &Gpu,
    stage: &Stage<'_>,
    textures: Option<&wgpu::Buffer>,
    layout: &mut LightGrid,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<wgpu::Buffer> {
    let world_channels = if stage.directions.is_empty() { 0 } else { layout.extinctions.len() * layout.harmonics };
    let channels = (stage.lights.len() + world_channels).max(1);
    let density = bake_density(gpu, &stage.medium, textures, layout, &|done| progress(0.5 * done))?;
    let grid = zeros(gpu, "light", layout.vertices() * channels)?;
    let to_cells = layout.to_cells(&stage.medium);
    let bytes = 4 * layout.vertices() as u64;
    for (number, light) in stage.lights.iter().enumerate() {
        let Source::Position(place, _) = &light.source else { continue };
        // Light from a point has no parallel rays to sweep: the CPU's depths serve.
        if layout.density.is_empty() {
            layout.density = bytemuck::pod_collect_to_vec(&gpu.read_back(&density, bytes)?);
        }
        let depths = layout.depth_to_point(*place, &stage.medium);
        gpu.queue().write_buffer(&grid, number as u64 * bytes, bytemuck::cast_slice(&depths));
    }
    let sweeps = Sweeps::new(gpu, layout, &density, &grid)?;
    for (number, light) in stage.lights.iter().enumerate() {
        if let Source::Direction(towards) = &light.source {
            sweeps.run(to_cells * *towards, number, None)?;
        }
    }
    let solid_angle = 4.0 * std::f64::consts::PI / stage.directions.len().max(1) as f64;
    for (number, &towards) in stage.directions.iter().enumerate() {
        let weights = harmonics(towards).map(|value| (value * solid_angle) as f32);
        sweeps.run(to_cells * towards, stage.lights.len(), Some(weights))?;
        progress(0.5 + 0.5 * (number + 1) as f64 / stage.directions.len() as f64);
    }
    Ok(grid)
}

/// Density at the vertices, on the adapter.
fn bake_density(
    gpu: &Gpu,
    medium: &Medium,
    textures: Option<&wgpu::Buffer>,
    layout: &LightGrid,
    progress: &dyn Fn(f64),
) -> Result<wgpu::Buffer> {
    let module = link(medium, "integrators/march/light_grid_bake.wgsl", BAKE, &[])?;
    let kernel = gpu.kernel("light_grid_bake", &module, BAKE_LAYOUTS)?;
    let density = zeros(gpu, "density", layout.vertices())?;
    let mut slices = Slices::within(FIRST_SLICE, SLICES);
    let mut first = 0;
    while first < layout.vertices() {
        let begin = Instant::now();
        let count = slices.size().min(layout.vertices() - first);
        let uniform = BakeUniform {
            low: layout.low.as_vec3().to_array(),
            first: first as u32,
            step: layout.step.as_vec3().to_array(),
            count: count as u32,
            size: layout.size.map(|count| count as u32),
            padding: 0,
        };
        let bake = gpu.upload("bake", bytemuck::bytes_of(&uniform), wgpu::BufferUsages::UNIFORM);
        let bindings = Bindings::new().group(0, [&bake, &density]).group(1, textures);
        gpu.dispatch(&kernel, &bindings, [count as u32, 1, 1])?;
        gpu.wait()?;
        slices.adapt(begin.elapsed());
        first += count;
        progress(first as f64 / layout.vertices() as f64);
    }
    Ok(density)
}

/// The sweep kernels over one grid.
struct Sweeps<'a> {
    gpu: &'a Gpu,
    layout: &'a LightGrid,
    trace: ComputeKernel,
    gather: ComputeKernel,
    density: &'a wgpu::Buffer,
    light: &'a wgpu::Buffer,
    table: wgpu::Buffer,
}

impl<'a> Sweeps<'a> {
    fn new(gpu: &'a Gpu, layout: &'a LightGrid, density: &'a wgpu::Buffer, light: &'a wgpu::Buffer) -> Result<Self> {
        let [nx, ny, nz] = layout.size;
        // A sweep shears its rays by at most one cell per slice, for any of the three main axes.
        let largest = [[nx, ny, nz], [nx, nz, ny], [ny, nz, nx]]
            .map(|[along, across, slices]| (across + slices + 2) * slices * (along + 1))
            .into_iter()
            .max()
            .unwrap_or(0);
        Ok(Self {
            gpu,
            layout,
            trace: gpu.kernel("light_grid_trace", &plain_module("light_grid_trace.wgsl", TRACE)?, SWEEP_LAYOUTS)?,
            gather: gpu.kernel("light_grid_gather", &plain_module("light_grid_gather.wgsl", GATHER)?, SWEEP_LAYOUTS)?,
            density,
            light,
            table: zeros(gpu, "depths along rays", largest)?,
        })
    }

    /// One direction, in cells per metre: stores depths in a channel, or adds the transmittances of
    /// all extinctions times the weights of the harmonics from that channel on.
    fn run(&self, direction: DVec3, channel: usize, weights: Option<[f32; 16]>) -> Result<()> {
        let axes = sweep_axes(direction);
        let sweep = Sweep::new(self.layout.size, axes, direction);
        let along = || sweep.offsets.iter().map(|(whole, _)| whole[0]);
        let (lowest, highest) = (along().min().unwrap_or(0), along().max().unwrap_or(0));
        let [nx, ny, _] = self.layout.size;
        let [along_rows, across, slices] = sweep.size;
        let uniform = SweepUniform {
            size: sweep.size.map(|count| count as u32),
            rising: sweep.rising.into(),
            strides: axes.map(|axis| [1, nx, nx * ny][axis] as u32),
            rows: sweep.rows as u32,
            slope: sweep.slope,
            distance: sweep.length,
            columns: (along_rows as i64 + 1 + highest - lowest) as u32,
            first_row: sweep.first_row as i32,
            first_column: (-1 - highest) as i32,
            channel: channel as u32,
            padding: 0,
        };
        let mut extinction = [0.0; 3];
        for (value, known) in extinction.iter_mut().zip(&self.layout.extinctions) {
            *value = *known as f32;
        }
        let world = WorldUniform {
            extinction,
            extinctions: weights.map_or(0, |_| self.layout.extinctions.len() as u32),
            weights: weights.unwrap_or_default(),
            harmonics: self.layout.harmonics as u32,
            padding: [0; 7],
        };
        let offsets: Vec<Offset> = sweep
            .offsets
            .iter()
            .map(|(whole, fraction)| Offset { whole: whole.map(|cells| cells as i32), fraction: *fraction })
            .collect();
        let gpu = self.gpu;
        let sweep_buffer = gpu.upload("sweep", bytemuck::bytes_of(&uniform), wgpu::BufferUsages::UNIFORM);
        let offsets = gpu.upload("offsets", bytemuck::cast_slice(&offsets), wgpu::BufferUsages::STORAGE);
        let world = gpu.upload("world", bytemuck::bytes_of(&world), wgpu::BufferUsages::UNIFORM);
        let bindings = Bindings::new().group(0, [&sweep_buffer, &offsets, self.density, &self.table]);
        gpu.dispatch(&self.trace, &bindings, [uniform.columns, uniform.rows, 1])?;
        gpu.wait()?;
        let bindings = Bindings::new().group(0, [&sweep_buffer, &offsets, &self.table, self.light, &world]);
        gpu.dispatch(&self.gather, &bindings, [along_rows as u32, across as u32, slices as u32])?;
        gpu.wait()
    }
}

/// A storage buffer of zeros, which wgpu guarantees for new buffers.
fn zeros(gpu: &Gpu, label: &str, floats: usize) -> Result<wgpu::Buffer> {
    let size = 4 * floats as u64;
    check_size(gpu, label, size, "grid_cells")?;
    Ok(gpu.device().create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    }))
}

/// An error where a storage buffer is larger than the adapter binds; a lower `setting` would make it smaller.
fn check_size(gpu: &Gpu, label: &str, size: u64, setting: &'static str) -> Result<()> {
    let limit = gpu.device().limits().max_storage_buffer_binding_size;
    if size <= limit {
        return Ok(());
    }
    Err(Error::new(
        format!("buffer of {label}"),
        format!("{size} bytes"),
        format!("at most {limit} bytes, the largest that adapter {} binds", gpu.adapter().name),
        format!("Lower the setting {setting}, or march on the CPU."),
    )
    .with_setting(setting)
    .with_setting("backend"))
}

/// A module without imports.
fn plain_module(name: &str, source: &str) -> Result<naga::Module> {
    naga::front::wgsl::parse_str(source).map_err(|cause| {
        Error::new(
            format!("shader integrate/{name}"),
            cause.emit_to_string(source),
            "a module that parses",
            "This is a defect of the program: report it.",
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::layout::{check, check_all};

    #[test]
    fn buffers_lie_in_memory_as_the_kernels_read_them() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/scenes/homogeneous-cube.scene.json");
        let scene = crate::scene::Scene::load(&path).expect("the committed scene loads");
        let medium = Medium::new(&scene).expect("the medium compiles");
        let link = |source: &str| link(&medium, "test", source, &[]).expect("the kernel links");
        check_all(&link(BAKE), BAKE_LAYOUTS).expect("the bake");
        check::<BakeUniform>(&link(BAKE)).expect("Bake is in it");
        for (name, source) in [("trace", TRACE), ("gather", GATHER)] {
            check_all(&plain_module(name, source).expect("it parses"), SWEEP_LAYOUTS).expect(name);
        }
        // A struct that a kernel has lost is passed over: each is looked for by name, too.
        let gather = plain_module("gather", GATHER).expect("it parses");
        check::<WorldUniform>(&gather).expect("World is in it");
        check_all(&link(MARCH), LAYOUTS).expect("the march");
        check::<Light>(&link(MARCH)).expect("Light is in it");
    }
}
