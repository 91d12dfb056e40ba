//! The march of a real-time engine on the adapter: `shaders/engines/march.wgsl`, in f32.

use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::base::texture::TextureHandle;
use crate::engines::domain::Outline;
use crate::engines::light::{MOST_SUNS, ShadowExtinction, ShadowLength, SourceFactor};
use crate::engines::march::air::AirUniform;
use crate::engines::march::light_volume::ReadVolume;
use crate::engines::march::shadow_map::{Cascade, ShadowMap};
use crate::engines::march::{Inside, Leftover, Marched, RealTimePixel, RealTimeRay, RealTimeSettings};
use crate::gpu::{Bindings, ComputeKernel, Gpu, Layout, SOFTWARE_LOOPS, Slices};
use crate::graph::Program;
use crate::graph::constants::{SharedConstants, SharedNumber};
use crate::graph::wgsl::{Linker, ProgramParameters};
use crate::media::density::CELLS;
use crate::media::light_volume::LightGrid;
use crate::media::transfer::Integration;
use crate::shader_struct;
use bytemuck::Zeroable;
use glam::DVec3;
use rayon::prelude::*;
use std::fmt::Write;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Numbers that the kernel imports.
pub const CONSTANTS: SharedConstants = SharedConstants {
    path: "cloudparity::engines::constants",
    numbers: &[
        ("CELLS", SharedNumber::Unsigned(CELLS as u32)),
        ("MOST_SUNS", SharedNumber::Unsigned(MOST_SUNS as u32)),
    ],
};

/// Densities per submission, at most: some 50 ms on a software adapter.
const DENSITIES: usize = 1 << 18;

shader_struct! {
    /// Uniforms of the kernel.
    pub(crate) struct MarchUniform = "March" {
        extinction: [f32; 3],
        steps: u32,
        ambient: [f32; 3],
        shadow_steps: u32,
        low: [f32; 3],
        shadow_length: f32,
        high: [f32; 3],
        depth_compression: f32,
        albedo: [f32; 3],
        powder_ambient: f32,
        anisotropy: [f32; 2],
        second: f32,
        least_density: f32,
        least_transmittance: f32,
        count: u32,
        first_step: u32,
        end_step: u32,
        octaves: u32,
        contribution: f32,
        attenuation: f32,
        eccentricity: f32,
        powder_strength: f32,
        powder_length: f32,
        silver_strength: f32,
        silver_exponent: f32,
        ambient_bottom: f32,
        ambient_top: f32,
        body_strength: f32,
        body_length: f32,
        inner: f32,
        outer: f32,
        suns: u32,
        phase_gain: f32,
        alpha: [f32; 2],
        again: [f32; 2],
        rim: f32,
        shadow_sample: f32,
        shadow_growth: f32,
        shadow_first: f32,
        shadow_by_angle: f32,
        boost_light: f32,
        boost_ambient: f32,
        boost_length: f32,
        shadow_extinction: f32,
        map_from: f32,
        map_size: u32,
        everywhere: u32,
        volume_low: [f32; 3],
        volume_first: u32,
        volume_scale: [f32; 3],
        volume_coefficients: u32,
        volume_size: [f32; 3],
        columns_first: u32,
        volume_moments: [f32; 3],
        volume_last_moment: f32,
        columns_scale: [f32; 3],
        map_layers: u32,
        columns_size: [f32; 3],
        step_growth: f32,
    }
}

shader_struct! {
    /// A sun as the kernel knows it.
    pub(crate) struct Sun = "Sun" {
        way: [f32; 3],
        padding: f32,
        direction: [f32; 3],
        more_padding: f32,
        irradiance: [f32; 3],
        end_padding: f32,
    }
}

shader_struct! {
    /// Parts of the view that have a shadow map each.
    struct CascadesUniform = "Cascades" {
        view: [f32; 3],
        view_end: f32,
        ends: [f32; 3],
        count: u32,
    }
}

shader_struct! {
    /// Light from below.
    struct GroundUniform = "Ground" {
        radiance: [f32; 3],
        steps: u32,
        down: [f32; 3],
        first: f32,
        highest: f32,
        padding: f32,
        more_padding: f32,
        end_padding: f32,
    }
}

shader_struct! {
    /// A ray in the domain.
    pub(crate) struct Ray = "rays_Ray" {
        origin: [f32; 3],
        length: f32,
        way: [f32; 3],
        jitter: f32,
        direction: [f32; 3],
        farthest: f32,
        first: f32,
        gap: f32,
        further: u32,
        further_end: u32,
    }
}

shader_struct! {
    /// What a ray came to, on the adapter; [`RealTimePixel`] says what is in it.
    pub struct Pixel = "rays_Pixel" {
        /// Radiance that reaches the camera.
        pub radiance: [f32; 3],
        /// Samples at which the density was asked for.
        pub samples: u32,
        /// Share of the background that reaches it.
        pub transmittance: [f32; 3],
        /// Samples that were dense enough to count.
        pub dense: u32,
    }
}

impl From<&RealTimePixel> for Pixel {
    fn from(pixel: &RealTimePixel) -> Self {
        let single = |values: [f64; 3]| values.map(|value| value as f32);
        Self {
            radiance: single(pixel.radiance),
            samples: pixel.samples,
            transmittance: single(pixel.transmittance),
            dense: pixel.dense,
        }
    }
}

/// A march compiled for a density, a light model and settings.
pub struct MarchKernel<'a> {
    gpu: &'a Gpu,
    outline: Outline,
    kernel: ComputeKernel,
    uniform: MarchUniform,
    suns: wgpu::Buffer,
    cells: wgpu::Buffer,
    textures: Option<wgpu::Buffer>,
    mesh: Option<wgpu::Buffer>,
    maps: Option<wgpu::Buffer>,
    numbers: Option<wgpu::Buffer>,
    air: Option<wgpu::Buffer>,
    ground: Option<wgpu::Buffer>,
    cascades: Option<wgpu::Buffer>,
    /// Where the steps of a ray follow from its distance.
    levels: Option<RealTimeSettings>,
    /// Steps of one dispatch.
    together: u32,
    /// Samples of rays in the march, all and of one dispatch.
    ray_samples: u32,
    samples_together: u32,
    /// Rays of one dispatch.
    slices: Mutex<Slices>,
}

/// What some marches know of each ray beside itself.
#[derive(Default)]
pub(crate) struct OfRays {
    /// Of air: the length from the eye, and a sum that goes on from dispatch to dispatch.
    ways: Option<wgpu::Buffer>,
    /// The number by which its length is divided, of which the whole steps are done.
    steps: Option<wgpu::Buffer>,
}

/// What lies beside the rays of a buffer.
#[derive(Default)]
struct BesideRays {
    /// Gaps behind the first, those of a ray one behind the other.
    gaps: Vec<[f32; 2]>,
    /// As [`OfRays`] has them.
    ways: Vec<[f32; 2]>,
    steps: Vec<f32>,
}

impl BesideRays {
    /// A ray as the kernel knows it, with its further gaps put here.
    fn packed(&mut self, ray: &RealTimeRay, inside: &Inside) -> Ray {
        let gap = inside.parts.gaps.first();
        let further = self.gaps.len() as u32;
        self.gaps.extend(inside.parts.gaps.iter().skip(1).map(|gap| [gap.passed as f32, gap.outside as f32]));
        Ray {
            origin: inside.origin.as_vec3().to_array(),
            length: inside.length as f32,
            way: inside.way.as_vec3().to_array(),
            jitter: ray.jitter as f32,
            direction: inside.direction.as_vec3().to_array(),
            farthest: inside.farthest as f32,
            first: gap.map_or(inside.length, |gap| gap.passed) as f32,
            gap: gap.map_or(0.0, |gap| gap.outside) as f32,
            further,
            further_end: self.gaps.len() as u32,
        }
    }
}

/// Rays that a core makes for the adapter at a time.
const PACKED_TOGETHER: usize = 512;

/// Rays of one dispatch of hardware at most: whole workgroups of 64, as many as an adapter takes along an axis by WebGPU's own limits.
const MOST_RAYS_TOGETHER: usize = 65_535 * 64;

/// Iterations that a node of a program may take in a kernel: a smooth Voronoi texture in four dimensions goes through 625 cells in each
/// of its octaves.
const NODE_ITERATIONS: u32 = 700;

/// Iterations of the loops of a program at a point, roughly and from above.
fn iterations(program: &Program) -> u32 {
    let loops = program.instructions.iter().filter(|node| node.node_type.shader.contains("for (")).count() as u32;
    loops.saturating_mul(NODE_ITERATIONS)
}

/// Searches of a ray towards a sun through a mesh, each of which may look at all of its tree: for two faces, twice each, once for lengths and
/// once for samples. More faces are met by rays that look at less of it.
const SEARCHES: u32 = 8;

/// Whether a software adapter marches a ray in one dispatch, as hardware does, without anything that is kept of it between two.
pub(crate) fn goes_at_once(gpu: &Gpu, marched: &Marched<'_>, settings: &RealTimeSettings) -> bool {
    let is_short = !gpu.adapter().is_software() || settings.most_steps() <= steps_at_once(marched);
    is_short && marched.air.is_none() && settings.distance_levels.is_none()
}

/// Steps of one dispatch that end within the loops of a software adapter ([`SOFTWARE_LOOPS`]).
fn steps_at_once(marched: &Marched<'_>) -> u32 {
    let light = marched.light;
    let iterations = iterations(marched.density.program());
    // A read of a light volume goes through eight vertices.
    let volume = marched.light_volume.as_ref().map_or(0, |read| 8 * read.volume.settings().coefficients() as u32);
    let down = light.terms.ground.map_or(0, |ground| ground.steps.saturating_mul(1 + iterations));
    let density = iterations.saturating_add(volume).saturating_add(down);
    let visits = match &marched.container.outline {
        Outline::Mesh(mesh) => u32::try_from(mesh.mesh().nodes()).unwrap_or(u32::MAX).saturating_mul(SEARCHES),
        Outline::Box(_) | Outline::Shell { .. } => 0,
    };
    steps_together(density, light.shadow.steps, light.suns.len() as u32, light.terms.octaves.count, visits)
}

/// Steps of one dispatch of a software adapter, whose loops end early otherwise ([`SOFTWARE_LOOPS`]): a step goes through the density, the
/// samples towards the suns with the density at each, the three axes of a crossing and the octaves.
fn steps_together(density: u32, shadow_steps: u32, suns: u32, octaves: u32, visits: u32) -> u32 {
    let each_sun =
        4_u32.saturating_add(octaves).saturating_add(visits).saturating_add(shadow_steps.saturating_mul(1 + density));
    let step = density.saturating_add(each_sun.saturating_mul(suns));
    (SOFTWARE_LOOPS / 2 / step.max(1)).max(1)
}

impl<'a> MarchKernel<'a> {
    /// [`Self::new_async`] for callers that may wait.
    pub fn new(gpu: &'a Gpu, marched: &Marched<'_>, settings: &RealTimeSettings) -> Result<Self> {
        gpu.block_on(Self::new_async(gpu, marched, settings))?
    }

    /// Compiles it: what the settings do not ask for is left out.
    pub async fn new_async(gpu: &'a Gpu, marched: &Marched<'_>, settings: &RealTimeSettings) -> Result<Self> {
        let form = if gpu.keeps_kernels() { Form::KernelWithNumbers } else { Form::Kernel };
        Self::in_form(gpu, marched, settings, &form, &MarchParts::LAYOUTS).await
    }

    /// Compiles it in a form of a kernel, with the structs of all its buffers.
    pub(crate) async fn in_form(
        gpu: &'a Gpu,
        marched: &Marched<'_>,
        settings: &RealTimeSettings,
        form: &Form<'_>,
        layouts: &[Layout],
    ) -> Result<Self> {
        let parts = MarchParts::new(marched, settings, form)?;
        let textures = gpu.upload_textures(&parts.textures)?;
        let mesh = match &parts.outline {
            Outline::Mesh(mesh) => Some(mesh.mesh().upload(gpu, DVec3::ZERO, DVec3::ONE)?),
            Outline::Box(_) | Outline::Shell { .. } => None,
        };
        let together = match gpu.adapter().is_software() {
            true => parts.together,
            false => parts.uniform.steps.max(1),
        };
        let ray_samples = parts.air.map_or(0, |air| air.ray_samples);
        let samples_together = if gpu.adapter().is_software() { parts.samples_together() } else { ray_samples.max(1) };
        let upload = |label, contents: &[u8]| gpu.upload(label, contents, wgpu::BufferUsages::STORAGE);
        Ok(Self {
            gpu,
            kernel: gpu.kernel_async("engine_march", &parts.module, layouts).await?,
            suns: upload("suns", bytemuck::cast_slice(&parts.suns)),
            cells: upload("cells", bytemuck::cast_slice(&parts.cells)),
            textures,
            mesh,
            maps: (!parts.maps.is_empty()).then(|| upload("maps", bytemuck::cast_slice(&parts.maps))),
            numbers: (!parts.numbers.is_empty()).then(|| upload("numbers", bytemuck::cast_slice(&parts.numbers))),
            air: parts.air.map(|air| gpu.upload("air", bytemuck::bytes_of(&air), wgpu::BufferUsages::UNIFORM)),
            cascades: parts
                .cascades
                .map(|cascades| gpu.upload("cascades", bytemuck::bytes_of(&cascades), wgpu::BufferUsages::UNIFORM)),
            ground: parts
                .ground
                .map(|ground| gpu.upload("ground", bytemuck::bytes_of(&ground), wgpu::BufferUsages::UNIFORM)),
            levels: settings.distance_levels.map(|_| settings.clone()),
            together,
            ray_samples,
            samples_together,
            // What takes a software adapter 50 ms is little for hardware: there the size follows what the adapter takes.
            slices: Mutex::new(match (parts.rays_together(together), gpu.adapter().is_software()) {
                (rays, true) => Slices::within(rays, rays..=rays),
                (rays, false) => Slices::within(rays, rays.min(MOST_RAYS_TOGETHER)..=MOST_RAYS_TOGETHER),
            }),
            uniform: parts.uniform,
            outline: parts.outline,
        })
    }

    /// Marches rays, as many as fit a buffer; their [`Pixel`]s stay on the adapter, in their order.
    pub fn march_on_adapter(&self, rays: &[RealTimeRay]) -> Result<wgpu::Buffer> {
        self.march_made(rays.len(), |number| rays[number])
    }

    /// [`Self::march_on_adapter`] of rays that are made where they are needed, by their number.
    pub(crate) fn march_made(&self, count: usize, ray: impl Fn(usize) -> RealTimeRay + Sync) -> Result<wgpu::Buffer> {
        let mut data = vec![Ray::zeroed(); count];
        let beside = |(task, data): (usize, &mut [Ray])| {
            let mut beside = BesideRays::default();
            for (index, data) in data.iter_mut().enumerate() {
                let ray = ray(task * PACKED_TOGETHER + index);
                let inside = ray.inside(&self.outline);
                if self.air.is_some() {
                    // From the eye to where a ray enters; one that misses begins at the eye.
                    let start = if inside.length > 0.0 { inside.parts.start } else { 0.0 };
                    beside.ways.push([start as f32, 0.0]);
                }
                if let Some(settings) = &self.levels {
                    beside.steps.push(settings.steps_of(inside.parts.start) as f32);
                }
                *data = beside.packed(&ray, &inside);
            }
            beside
        };
        let mut all = BesideRays::default();
        let tasks = data.par_chunks_mut(PACKED_TOGETHER).enumerate();
        let tasks: Vec<BesideRays> = tasks.map(beside).collect();
        for (task, data) in tasks.into_iter().zip(data.chunks_mut(PACKED_TOGETHER)) {
            let before = all.gaps.len() as u32;
            if before > 0 {
                data.iter_mut().for_each(|ray| {
                    ray.further += before;
                    ray.further_end += before;
                });
            }
            all.gaps.extend(task.gaps);
            all.ways.extend(task.ways);
            all.steps.extend(task.steps);
        }
        let upload = |label, contents: &[u8]| self.gpu.upload(label, contents, wgpu::BufferUsages::STORAGE);
        let of_rays = OfRays {
            ways: self.air.is_some().then(|| upload("ways", bytemuck::cast_slice(&all.ways))),
            steps: self.levels.is_some().then(|| upload("ray steps", bytemuck::cast_slice(&all.steps))),
        };
        let rays = upload("rays", bytemuck::cast_slice(&data));
        self.march_buffer(&rays, count, &all.gaps, &of_rays)
    }

    /// Marches the first rays of a buffer that lies on the adapter; gaps are those that rays name.
    pub(crate) fn march_buffer(
        &self,
        rays: &wgpu::Buffer,
        count: usize,
        gaps: &[[f32; 2]],
        of_rays: &OfRays,
    ) -> Result<wgpu::Buffer> {
        let gpu = self.gpu;
        // A buffer cannot be empty.
        let gaps = if gaps.is_empty() { &[[0.0; 2]] } else { gaps };
        let gaps = gpu.upload("gaps", bytemuck::cast_slice(gaps), wgpu::BufferUsages::STORAGE);
        let output = gpu.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some("pixels"),
            size: (count * size_of::<Pixel>()) as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        // Offsets of bindings are multiples of 256 bytes, which whole workgroups of rays and pixels are.
        let part = |buffer, first: usize, count: usize, bytes: usize| {
            wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer,
                offset: (first * bytes) as u64,
                size: std::num::NonZeroU64::new((count * bytes) as u64),
            })
        };
        let mut first = 0;
        while first < count {
            let together = self.slices.lock().unwrap_or_else(PoisonError::into_inner).size().min(count - first);
            let begin = Instant::now();
            let steps = self.uniform.steps;
            let marches = (0..steps).step_by(self.together as usize).map(|first| [first, self.together]);
            // Behind the steps are numbered the samples of rays in the march.
            let samples = (0..self.ray_samples).step_by(self.samples_together as usize);
            let behind = samples.map(|first| [steps + first, self.samples_together]);
            for [first_step, together_steps] in marches.chain(behind) {
                let end_step = first_step.saturating_add(together_steps);
                let uniform = MarchUniform { count: together as u32, first_step, end_step, ..self.uniform };
                let uniform = gpu.upload("march", bytemuck::bytes_of(&uniform), wgpu::BufferUsages::UNIFORM);
                let mut bindings = self.bindings();
                if let Some(steps) = &of_rays.steps {
                    bindings = bindings.bind(0, 12, part(steps, first, together, size_of::<f32>()));
                }
                if let (Some(air), Some(ways)) = (&self.air, &of_rays.ways) {
                    bindings = bindings.bind(0, 8, part(ways, first, together, size_of::<[f32; 2]>()));
                    bindings = bindings.bind(0, 9, air.as_entire_binding());
                }
                let bindings = bindings
                    .bind(0, 0, uniform.as_entire_binding())
                    .bind(0, 1, part(rays, first, together, size_of::<Ray>()))
                    .bind(0, 2, part(&output, first, together, size_of::<Pixel>()))
                    .bind(0, 5, gaps.as_entire_binding());
                gpu.dispatch(&self.kernel, &bindings, [together as u32, 1, 1])?;
            }
            if !gpu.adapter().is_software() {
                gpu.wait()?;
                self.slices.lock().unwrap_or_else(PoisonError::into_inner).adapt(begin.elapsed());
            }
            first += together;
        }
        Ok(output)
    }

    /// What the kernel reads that no ray changes, but its uniforms.
    fn bindings(&self) -> Bindings<'_> {
        let held = [
            (0, 3, Some(&self.suns)),
            (0, 4, Some(&self.cells)),
            (0, 6, self.maps.as_ref()),
            (0, 7, self.mesh.as_ref()),
            (0, 10, self.ground.as_ref()),
            (0, 11, self.cascades.as_ref()),
            (1, 1, self.numbers.as_ref()),
        ];
        let held = held.into_iter().filter_map(|(group, binding, buffer)| Some((group, binding, buffer?)));
        held.fold(Bindings::new().group(1, &self.textures), |bindings, (group, binding, buffer)| {
            bindings.bind(group, binding, buffer.as_entire_binding())
        })
    }

    /// Runs a kernel of [`Form::Frame`] over so many pixels, a slice after the other; `around` gives what the modules around the march read, by the
    /// first pixel of a slice and their number. What is reported is done, but for the last slice of a software adapter, which nobody waits for here.
    pub(crate) fn run_frame(
        &self,
        pixels: u32,
        around: impl Fn(u32, u32) -> Vec<((u32, u32), wgpu::Buffer)>,
        progress: Progress<'_>,
    ) -> Result<()> {
        let gpu = self.gpu;
        let uniform = MarchUniform { count: pixels, end_step: self.uniform.steps, ..self.uniform };
        let uniform = gpu.upload("march", bytemuck::bytes_of(&uniform), wgpu::BufferUsages::UNIFORM);
        let mut first = 0;
        while first < pixels {
            let together =
                self.slices.lock().unwrap_or_else(PoisonError::into_inner).size().min((pixels - first) as usize);
            let begin = Instant::now();
            let around = around(first, together as u32);
            let bindings = self.bindings().bind(0, 0, uniform.as_entire_binding());
            let bindings = around.iter().fold(bindings, |bindings, ((group, binding), buffer)| {
                bindings.bind(*group, *binding, buffer.as_entire_binding())
            });
            gpu.dispatch(&self.kernel, &bindings, [together as u32, 1, 1])?;
            first += together as u32;
            let is_software = gpu.adapter().is_software();
            if !is_software || first < pixels {
                gpu.wait()?;
            }
            if !is_software {
                self.slices.lock().unwrap_or_else(PoisonError::into_inner).adapt(begin.elapsed());
            }
            progress(f64::from(first) / f64::from(pixels), "view rays");
        }
        Ok(())
    }

    /// Marches rays; pixels in their order.
    pub fn march(&self, rays: &[RealTimeRay]) -> Result<Vec<RealTimePixel>> {
        if rays.is_empty() {
            return Ok(Vec::new());
        }
        let output = self.march_on_adapter(rays)?;
        let bytes = self.gpu.read_back(&output, (rays.len() * size_of::<Pixel>()) as u64)?;
        let found: Vec<Pixel> = bytemuck::pod_collect_to_vec(&bytes);
        let widened = |pixel: Pixel| RealTimePixel {
            radiance: pixel.radiance.map(f64::from),
            transmittance: pixel.transmittance.map(f64::from),
            samples: pixel.samples,
            dense: pixel.dense,
            distance: None,
        };
        Ok(found.into_iter().map(widened).collect())
    }
}

/// What a march is linked as.
pub(crate) enum Form<'a> {
    /// A kernel.
    Kernel,
    /// A kernel whose programs have their constants in a buffer.
    KernelWithNumbers,
    /// A kernel whose programs compute theirs from parameters in a uniform.
    KernelWithParameters(&'a ProgramParameters),
    /// A part of a kernel that makes a frame, in which a ray is done at once ([`goes_at_once`]).
    Frame {
        /// Whether programs have their constants in a buffer.
        has_numbers: bool,
        /// Modules beside the march, in dependency order: path and text.
        around: &'a [(&'a str, &'a str)],
        /// Path and text of the entry.
        entry: (&'a str, &'a str),
        /// Definitions of the modules around it.
        definitions: &'a [&'static str],
    },
    /// A part of a fragment shader that has all its data in one texture ([`MarchParts::words`]).
    Fragment {
        /// Modules beside the march, and constants of theirs, in dependency order: path and text.
        around: &'a [(&'a str, &'a str)],
        /// Path and text of the entry.
        entry: (&'a str, &'a str),
        /// Definitions of the modules around it.
        definitions: &'a [&'static str],
        /// What constants of its programs are computed from, where they are.
        parameters: Option<&'a ProgramParameters>,
    },
}

/// What a march on an adapter is made of, before there is one: its kernel, and what is in its buffers.
pub(crate) struct MarchParts {
    pub(crate) outline: Outline,
    pub(crate) module: naga::Module,
    pub(crate) uniform: MarchUniform,
    /// One at least: a buffer cannot be empty.
    pub(crate) suns: Vec<Sun>,
    /// Whether each cell may hold something.
    pub(crate) cells: Vec<u32>,
    pub(crate) textures: Vec<TextureHandle>,
    /// Rows and texels of shadow maps, then those of a light volume.
    pub(crate) maps: Vec<[f32; 4]>,
    /// Constants of the programs, where they are in a buffer.
    pub(crate) numbers: Vec<f32>,
    /// Air, where there is some.
    air: Option<AirUniform>,
    /// Light from below, where there is some.
    ground: Option<GroundUniform>,
    /// Parts of the view, where there are several.
    cascades: Option<CascadesUniform>,
    iterations: u32,
    /// Steps of one dispatch of a software adapter.
    pub(crate) together: u32,
}

impl MarchParts {
    /// Of the structs in the kernel's buffers.
    pub(crate) const LAYOUTS: [Layout; 8] = [
        Layout::of::<CascadesUniform>(),
        Layout::of::<GroundUniform>(),
        Layout::of::<MarchUniform>(),
        Layout::of::<AirUniform>(),
        Layout::of::<Ray>(),
        Layout::of::<Pixel>(),
        Layout::of::<Sun>(),
        Layout::unread(ProgramParameters::STRUCT),
    ];

    /// The same where a frame imports the march.
    pub(crate) const LAYOUTS_IN_FRAME: [Layout; 5] = [
        Layout::of::<CascadesUniform>().imported("march_Cascades"),
        Layout::of::<GroundUniform>().imported("march_Ground"),
        Layout::of::<MarchUniform>().imported("march_March"),
        Layout::of::<Sun>().imported("march_Sun"),
        Layout::unread(ProgramParameters::STRUCT),
    ];

    /// Links the march in a form: what the settings do not ask for is left out.
    pub(crate) fn new(marched: &Marched<'_>, settings: &RealTimeSettings, form: &Form<'_>) -> Result<Self> {
        marched.check()?;
        let Marched { light, density, container, .. } = *marched;
        if light.suns.len() > MOST_SUNS {
            return Err(Error::new(
                "the lights of the scene",
                format!("{} suns", light.suns.len()),
                format!("at most {MOST_SUNS}"),
                "Take suns away.",
            ));
        }
        let has_levels = settings.distance_levels.is_some();
        let goes_with_levels =
            settings.growth == 1.0 && !settings.doubled_start && matches!(form, Form::Kernel | Form::KernelWithNumbers);
        if has_levels && !goes_with_levels {
            return Err(Error::new(
                "the march on the adapter",
                "steps by the distance of each ray, beside steps that grow or defect TK-3, or where no program hands rays to it",
                "one number of steps for all rays",
                "Render on the CPU, or leave the parameter distance_levels at 0.",
            ));
        }
        let mut definitions = Vec::new();
        let mut define = |is_wanted: bool, name: &'static str| definitions.extend(is_wanted.then_some(name));
        define(settings.integration == Integration::Plain, "PLAIN");
        define(settings.exit_fade, "EXIT_FADE");
        define(settings.leftover == Leftover::Dropped, "LEFTOVER_DROPPED");
        define(settings.leftover == Leftover::Rescaled, "LEFTOVER_RESCALED");
        define(!matches!(light.shadow.length, ShadowLength::Fixed(_)), "SHADOW_TO_EXIT");
        define(matches!(light.shadow.length, ShadowLength::ToExitAtMost(_)), "SHADOW_AT_MOST");
        define(light.shadow.growth != 1.0, "SHADOW_GROWTH");
        define(light.shadow.by_angle != 0.0, "SHADOW_BY_ANGLE");
        let has_map = light.shadow.map.is_some() && !light.suns.is_empty();
        define(has_map && light.shadow.layers == 0, "SHADOW_MAP");
        define(has_map && light.shadow.layers > 0, "SHADOW_LAYERS");
        define(has_map && light.shadow.map.is_some_and(|map| map.cascades > 1), "SHADOW_CASCADES");
        define(light.phase.alpha != [0.0; 2], "DRAINE");
        define(light.phase.gain != 1.0 || light.phase.rim != 0.0, "OWN_PHASE");
        define(light.phase.again.is_some(), "PHASE_TWICE");
        define(light.shadow.extinction == ShadowExtinction::View, "SHADOW_VIEW");
        define(light.source == SourceFactor::Density, "SOURCE_DENSITY");
        let terms = &light.terms;
        define(terms.octaves.count > 1, "OCTAVES");
        define(terms.octaves.compression > 0.0, "COMPRESSION");
        define(terms.powder.strength > 0.0, "POWDER");
        define(terms.silver.strength > 0.0, "SILVER");
        define(terms.ambient != [1.0; 2], "AMBIENT_GRADIENT");
        define(terms.ray_powder, "RAY_POWDER");
        define(terms.boost.is_on(), "BOOST");
        define(terms.boost.is_on() && terms.boost.by_angle, "BOOST_BY_ANGLE");
        define(terms.body.strength > 0.0, "BODY");
        define(terms.body.shadow, "COARSE_SHADOW");
        define(!density.fills_all_cells(), "EMPTY_CELLS");
        define(light.suns.is_empty(), "NO_SUN");
        define(light.suns.len() > 1, "SEVERAL_SUNS");
        define(matches!(container.outline, Outline::Shell { .. }), "SHELL");
        define(matches!(container.outline, Outline::Mesh(_)), "MESH");
        define(!marched.terms.is_empty(), "TERMS");
        define(marched.light_volume.is_some(), "LIGHT_VOLUME");
        define(marched.columns().is_some() && !light.suns.is_empty(), "COLUMNS");
        define(terms.ground.is_some(), "GROUND");
        define(settings.growth != 1.0, "STEP_GROWTH");
        define(has_levels, "RAY_STEPS");
        define(settings.doubled_start, "DOUBLED_START");
        if let Some(air) = marched.air {
            definitions.extend(air.definitions(has_map));
        }
        let mut linker = match form {
            Form::KernelWithNumbers | Form::Frame { has_numbers: true, .. } => Linker::with_numbers(density.program())?,
            Form::KernelWithParameters(parameters) | Form::Fragment { parameters: Some(parameters), .. } => {
                Linker::with_parameters(density.program(), parameters)?
            }
            Form::Kernel | Form::Frame { .. } | Form::Fragment { parameters: None, .. } => {
                Linker::new(density.program())?
            }
        };
        linker.add_constants(&CONSTANTS);
        match marched.averages {
            Some(averages) => {
                linker.add_program(ALONG, &averages.along)?;
                linker.add_program(AROUND, &averages.around)?;
            }
            None => {
                for path in [ALONG, AROUND] {
                    linker.add_program(path, &Program::constant("averages", 0.0))?;
                }
            }
        }
        for term in marched.terms {
            linker.add(term.import_path(), &term.shader());
        }
        linker.add("generated/terms.wgsl", &terms_module(marched));
        let textures = linker.textures().to_vec();
        let numbers = linker.numbers().to_vec();
        let single = |values: [f64; 3]| values.map(|value| value as f32);
        let vector = |value: DVec3| value.as_vec3().to_array();
        let region = container.outline.region();
        let [inner, outer] = match container.outline {
            Outline::Box(_) | Outline::Mesh(_) => [0.0; 2],
            Outline::Shell { inner, outer } => [inner as f32, outer as f32],
        };
        let mut suns: Vec<Sun> = light
            .suns
            .iter()
            .map(|sun| Sun {
                way: vector(container.way(DVec3::from(sun.direction))),
                direction: vector(sun.towards()),
                irradiance: single(sun.irradiance),
                ..Sun::zeroed()
            })
            .collect();
        // A buffer cannot be empty.
        suns.resize(suns.len().max(1), Sun::zeroed());
        let cells: Vec<u32> = match density.fills_all_cells() {
            true => vec![1],
            false => density.cells().into_iter().map(u32::from).collect(),
        };
        let mut uniform = MarchUniform {
            extinction: single(marched.extinction),
            steps: settings.most_steps(),
            ambient: single(light.ambient),
            shadow_steps: light.shadow.steps,
            low: vector(region.low),
            shadow_length: match light.shadow.length {
                ShadowLength::Fixed(length) | ShadowLength::ToExitAtMost(length) => length as f32,
                ShadowLength::ToExit => 0.0,
            },
            high: vector(region.high),
            depth_compression: terms.octaves.compression as f32,
            albedo: match light.source {
                SourceFactor::Density => [0.0; 3],
                SourceFactor::Albedo(albedo) => single(albedo),
            },
            powder_ambient: terms.powder.ambient as f32,
            anisotropy: light.phase.anisotropy.map(|anisotropy| anisotropy as f32),
            second: light.phase.second as f32,
            least_density: settings.least_density as f32,
            least_transmittance: settings.least_transmittance as f32,
            octaves: terms.octaves.count,
            contribution: terms.octaves.contribution as f32,
            attenuation: terms.octaves.attenuation as f32,
            eccentricity: terms.octaves.eccentricity as f32,
            powder_strength: terms.powder.strength as f32,
            powder_length: terms.powder.length as f32,
            silver_strength: terms.silver.strength as f32,
            silver_exponent: terms.silver.exponent as f32,
            ambient_bottom: terms.ambient[0] as f32,
            ambient_top: terms.ambient[1] as f32,
            body_strength: terms.body.strength as f32,
            body_length: terms.body.length as f32,
            inner,
            outer,
            suns: light.suns.len() as u32,
            phase_gain: light.phase.gain as f32,
            alpha: light.phase.alpha.map(|alpha| alpha as f32),
            rim: light.phase.rim as f32,
            again: light.phase.again.unwrap_or_default().map(|anisotropy| anisotropy as f32),
            shadow_sample: light.shadow.sample.part() as f32,
            shadow_growth: light.shadow.growth as f32,
            shadow_first: light.shadow.parts()[0][1] as f32,
            shadow_by_angle: light.shadow.by_angle as f32,
            map_from: light.shadow.map_from() as f32,
            map_size: light.shadow.map.map_or(0, |map| map.size),
            map_layers: light.shadow.layers,
            step_growth: settings.growth.ln() as f32,
            boost_light: terms.boost.light as f32,
            boost_ambient: terms.boost.ambient as f32,
            boost_length: terms.boost.length as f32,
            shadow_extinction: match light.shadow.extinction {
                ShadowExtinction::Of(extinction) => extinction as f32,
                ShadowExtinction::Density | ShadowExtinction::View => 1.0,
            },
            ..MarchUniform::zeroed()
        };
        let mut maps: Vec<[f32; 4]> = marched
            .maps
            .iter()
            .flat_map(|map| map.rows.iter().map(|row| row.as_vec4().to_array()).chain(map.texels.iter().copied()))
            .collect();
        if let Some(ReadVolume { volume, moments }) = &marched.light_volume {
            let LightGrid { size, low, step, .. } = volume.grid();
            uniform.volume_low = vector(*low);
            uniform.volume_first = maps.len() as u32;
            uniform.volume_scale = vector(1.0 / *step);
            uniform.volume_coefficients = volume.settings().coefficients() as u32;
            uniform.volume_size = size.map(|side| side as f32);
            let moment = |band: usize| moments.get(band).map_or(0.0, |&moment| moment as f32);
            uniform.volume_moments = [0, 1, 2].map(moment);
            uniform.volume_last_moment = moment(3);
            maps.extend_from_slice(volume.rows());
            if let Some(columns) = volume.columns() {
                uniform.columns_first = maps.len() as u32;
                uniform.columns_scale = vector(1.0 / columns.grid.step);
                uniform.columns_size = columns.grid.size.map(|side| side as f32);
                maps.extend(columns.values.chunks(4).map(|some| {
                    let mut row = [0.0; 4];
                    row[..some.len()].copy_from_slice(some);
                    row
                }));
            }
        }
        const SOURCE: (&str, &str) = ("engines/march.wgsl", include_str!("../../../shaders/engines/march.wgsl"));
        let module = match *form {
            Form::Kernel | Form::KernelWithNumbers | Form::KernelWithParameters(_) => {
                linker.link_with(SOURCE.0, SOURCE.1, &definitions)?
            }
            Form::Frame { around, entry, definitions: own, .. } => {
                // A module is known with all that it may import.
                linker.add(DATA, &data_module(0, 0, suns.len()));
                linker.add(SOURCE.0, SOURCE.1);
                around.iter().for_each(|(path, source)| linker.add(path, source));
                definitions.extend(own);
                definitions.extend(["IN_PICTURE", "IN_FRAME"]);
                linker.link_with(entry.0, entry.1, &definitions)?
            }
            Form::Fragment { around, entry, definitions: own, .. } => {
                // Behind the textures lie a bit per cell, and the shadow maps.
                let first: usize = textures.iter().map(|texture| texture.texels().word_count()).sum();
                let maps = first + cells.len().div_ceil(32);
                linker.add(DATA, &data_module(first, maps, suns.len()));
                linker.add(SOURCE.0, SOURCE.1);
                around.iter().for_each(|(path, source)| linker.add(path, source));
                definitions.extend(own);
                definitions.extend(["IN_PICTURE", "IN_FRAGMENT"]);
                linker.link_with(entry.0, entry.1, &definitions)?
            }
        };
        Ok(Self {
            outline: container.outline.clone(),
            module,
            uniform,
            suns,
            cells,
            textures,
            numbers,
            maps,
            air: marched.air.map(AirUniform::new),
            cascades: cascades_of(marched.maps_of(0)),
            ground: terms.ground.map(|ground| GroundUniform {
                radiance: single(light.ground_radiance(&ground)),
                steps: ground.steps,
                down: vector(container.way(DVec3::NEG_Z)),
                first: ground.first as f32,
                highest: ground.highest as f32,
                ..GroundUniform::zeroed()
            }),
            iterations: iterations(density.program()),
            together: steps_at_once(marched),
        })
    }

    /// What a fragment shader has in its texture: texels of the programs, a bit per cell, shadow maps.
    pub(crate) fn words(&self) -> Vec<u8> {
        let mut words = crate::base::texture::words_of(&self.textures);
        for cells in self.cells.chunks(32) {
            let bits = cells.iter().enumerate().fold(0_u32, |bits, (place, &cell)| bits | (cell << place));
            words.extend(bits.to_le_bytes());
        }
        words.extend(bytemuck::cast_slice::<_, u8>(&self.maps));
        words
    }

    /// The same of samples of rays in the march, of which each goes through the samples towards all suns.
    fn samples_together(&self) -> u32 {
        let MarchUniform { shadow_steps, suns, .. } = self.uniform;
        let each = 4_u32.saturating_add((1 + shadow_steps).saturating_mul(1 + self.iterations));
        (SOFTWARE_LOOPS / 2 / each.saturating_mul(suns).max(1)).max(1)
    }

    /// Rays of one dispatch of so many steps, whole workgroups, so that a submission takes a software adapter some 50 ms. A density with loops
    /// costs some hundred times what a texture does.
    pub(crate) fn rays_together(&self, together: u32) -> usize {
        let densities = if self.iterations > 0 { DENSITIES / 16 } else { DENSITIES };
        let MarchUniform { steps, suns, shadow_steps, .. } = self.uniform;
        let down = self.ground.map_or(0, |ground| ground.steps);
        let samples = self.air.map_or(0, |air| air.ray_samples.min(self.samples_together()));
        let per_ray = (steps.min(together).max(samples)) as usize * (1 + (suns * shadow_steps + down) as usize);
        // A fragment has no workgroups.
        let workgroup = self.module.entry_points[0].workgroup_size[0].max(1) as usize;
        (densities / per_ray).max(1).next_multiple_of(workgroup)
    }
}

/// Parts of the view, of the maps of a sun; none where there is one.
fn cascades_of(maps: &[ShadowMap]) -> Option<CascadesUniform> {
    let all: Vec<Cascade> = maps.iter().filter_map(|map| map.cascade).collect();
    let first = all.first()?;
    let view = first.view.as_vec4().to_array();
    let end = |number: usize| all.get(number).map_or(1.0, |cascade| cascade.ends[1] as f32);
    Some(CascadesUniform {
        view: [view[0], view[1], view[2]],
        view_end: view[3],
        ends: [0, 1, 2].map(end),
        count: all.len() as u32,
    })
}

/// Import paths of the averages.
const ALONG: &str = "cloudparity::averages::along";
const AROUND: &str = "cloudparity::averages::around";

/// Path of [`data_module`].
const DATA: &str = "generated/data.wgsl";

/// Where cells and maps begin in the data of a fragment, in words, and the number of suns.
fn data_module(cells: usize, maps: usize, suns: usize) -> String {
    let mut text = String::from("#define_import_path cloudparity::engines::data\n");
    for (name, value) in [("CELLS", cells), ("MAPS", maps), ("SUNS", suns)] {
        writeln!(text, "const {name}: u32 = {value}u;").expect("writing to a string cannot fail");
    }
    text
}

/// The sum of a system's own terms as a module; 0 without any.
fn terms_module(marched: &Marched<'_>) -> String {
    let mut text = String::from("#define_import_path cloudparity::engines::own_terms\n");
    let mut sum = String::from("vec3f(0.0)");
    for term in marched.terms {
        let path = term.import_path();
        let name = path.rsplit("::").next().unwrap_or(path);
        writeln!(text, "#import {path}").expect("writing to a string cannot fail");
        write!(sum, " + {name}::source(place, height, extinction)").expect("writing to a string cannot fail");
    }
    text + &format!("fn source(place: vec3f, height: f32, extinction: f32) -> vec3f {{ return {sum}; }}\n")
}
