//! The march of a real-time engine on the adapter: `shaders/engines/march.wgsl`, in f32.

use crate::base::error::Result;
use crate::engines::light::{LightModel, ShadowExtinction, ShadowLength, SourceFactor};
use crate::engines::march::{RealTimePixel, RealTimeRay, RealTimeSettings, averages};
use crate::gpu::{Bindings, ComputeKernel, Gpu, Layout, SOFTWARE_LOOPS};
use crate::graph::wgsl::Linker;
use crate::media::averages as coarse;
use crate::media::density::DensityModel;
use crate::media::transfer::Integration;
use crate::shader_struct;

/// Densities per submission, at most: some 50 ms on a software adapter.
const DENSITIES: usize = 1 << 18;

shader_struct! {
    /// Uniforms of the kernel.
    struct MarchUniform = "March" {
        extinction: [f32; 3],
        steps: u32,
        sun: [f32; 3],
        shadow_steps: u32,
        ambient: [f32; 3],
        shadow_length: f32,
        to_sun: [f32; 3],
        depth_compression: f32,
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
        albedo: [f32; 3],
        powder_ambient: f32,
    }
}

shader_struct! {
    struct Ray = "Ray" {
        origin: [f32; 3],
        length: f32,
        direction: [f32; 3],
        jitter: f32,
        farthest: f32,
        padding: [f32; 7],
    }
}

shader_struct! {
    /// What a ray came to, on the adapter; [`RealTimePixel`] says what is in it.
    pub struct Pixel = "Pixel" {
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

/// A march compiled for a density model, a light model and settings.
pub struct RealTimeKernel<'a> {
    gpu: &'a Gpu,
    kernel: ComputeKernel,
    uniform: MarchUniform,
    model: Vec<wgpu::Buffer>,
    /// Averages of the density.
    levels: Option<wgpu::Buffer>,
    /// Steps of one dispatch.
    together: u32,
}

/// Steps of one dispatch of a software adapter, whose loops end early otherwise ([`SOFTWARE_LOOPS`]): a step goes through the samples towards
/// the sun, the three axes of a crossing and the octaves; half of what there is stays for the density.
fn steps_together(shadow_steps: u32, octaves: u32) -> u32 {
    (SOFTWARE_LOOPS / 2 / (4 + shadow_steps + octaves)).max(1)
}

impl<'a> RealTimeKernel<'a> {
    /// Compiles it: what the settings do not ask for is left out.
    pub fn new(
        gpu: &'a Gpu,
        density: &dyn DensityModel,
        light: &LightModel,
        settings: &RealTimeSettings,
    ) -> Result<Self> {
        let shader = density.shader()?;
        let mut linker = Linker::bare()?;
        linker.add(shader.path, shader.source)?;
        let mut definitions = Vec::new();
        let mut define = |is_wanted: bool, name: &'static str| definitions.extend(is_wanted.then_some(name));
        define(settings.integration == Integration::Plain, "PLAIN");
        define(settings.exit_fade, "EXIT_FADE");
        define(light.shadow.length == ShadowLength::ToExit, "SHADOW_TO_EXIT");
        define(light.shadow.extinction == ShadowExtinction::View, "SHADOW_VIEW");
        define(light.source == SourceFactor::Density, "SOURCE_DENSITY");
        let terms = &light.terms;
        define(terms.octaves.count > 1, "OCTAVES");
        define(terms.octaves.compression > 0.0, "COMPRESSION");
        define(terms.powder.strength > 0.0, "POWDER");
        define(terms.silver.strength > 0.0, "SILVER");
        define(terms.ambient != [1.0; 2], "AMBIENT_GRADIENT");
        let averages = averages(density, light)?;
        define(averages.is_some() && terms.body.strength > 0.0, "BODY");
        define(averages.is_some() && terms.body.shadow, "COARSE_SHADOW");
        linker.add_constants(&coarse::CONSTANTS)?;
        linker.add("media/averages.wgsl", include_str!("../../../shaders/media/averages.wgsl"))?;
        let levels =
            averages.map(|averages| gpu.upload("coarse density", &averages.bytes(), wgpu::BufferUsages::STORAGE));
        let source = include_str!("../../../shaders/engines/march.wgsl");
        let module = linker.link_with("engines/march.wgsl", source, &definitions)?;
        let single = |values: [f64; 3]| values.map(|value| value as f32);
        let uniform = MarchUniform {
            extinction: single(density.extinction()),
            steps: settings.steps,
            sun: single(light.sun),
            shadow_steps: light.shadow.steps,
            ambient: single(light.ambient),
            shadow_length: match light.shadow.length {
                ShadowLength::Fixed(length) => length as f32,
                ShadowLength::ToExit => 0.0,
            },
            to_sun: light.to_sun().as_vec3().to_array(),
            albedo: match light.source {
                SourceFactor::Density => [0.0; 3],
                SourceFactor::Albedo(albedo) => single(albedo),
            },
            anisotropy: light.phase.anisotropy.map(|anisotropy| anisotropy as f32),
            second: light.phase.second as f32,
            least_density: settings.least_density as f32,
            least_transmittance: settings.least_transmittance as f32,
            count: 0,
            first_step: 0,
            end_step: 0,
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
            powder_ambient: terms.powder.ambient as f32,
            depth_compression: terms.octaves.compression as f32,
        };
        let together = match gpu.adapter().is_software() {
            true => steps_together(uniform.shadow_steps, uniform.octaves),
            false => settings.steps.max(1),
        };
        let mut layouts = vec![Layout::of::<MarchUniform>(), Layout::of::<Ray>(), Layout::of::<Pixel>()];
        layouts.extend(shader.layouts);
        Ok(Self {
            gpu,
            kernel: gpu.kernel("real_time", &module, &layouts)?,
            uniform,
            model: shader.buffers(gpu),
            levels,
            together,
        })
    }

    /// Marches rays; pixels in their order.
    pub fn march(&self, rays: &[RealTimeRay]) -> Result<Vec<RealTimePixel>> {
        let data: Vec<Ray> = rays
            .iter()
            .map(|ray| {
                let inside = ray.inside();
                Ray {
                    origin: inside.origin.as_vec3().to_array(),
                    length: inside.length as f32,
                    direction: inside.direction.as_vec3().to_array(),
                    jitter: ray.jitter as f32,
                    farthest: inside.farthest as f32,
                    padding: [0.0; 7],
                }
            })
            .collect();
        let per_ray = self.uniform.steps as usize * (1 + self.uniform.shadow_steps as usize);
        let most = (DENSITIES / per_ray).max(1).next_multiple_of(self.kernel.workgroup()[0] as usize);
        let mut pixels = Vec::with_capacity(rays.len());
        for part in data.chunks(most) {
            let rays = self.gpu.upload("rays", bytemuck::cast_slice(part), wgpu::BufferUsages::STORAGE);
            let size = (part.len() * size_of::<Pixel>()) as u64;
            let output = self.gpu.device().create_buffer(&wgpu::BufferDescriptor {
                label: Some("pixels"),
                size,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            });
            for first_step in (0..self.uniform.steps).step_by(self.together as usize) {
                let end_step = first_step.saturating_add(self.together);
                let uniform = MarchUniform { count: part.len() as u32, first_step, end_step, ..self.uniform };
                let uniform = self.gpu.upload("march", bytemuck::bytes_of(&uniform), wgpu::BufferUsages::UNIFORM);
                let own = [&uniform, &rays, &output].into_iter().chain(&self.levels);
                let bindings = Bindings::new().group(0, own).group(1, &self.model);
                self.gpu.dispatch(&self.kernel, &bindings, [part.len() as u32, 1, 1])?;
            }
            let found: Vec<Pixel> = bytemuck::pod_collect_to_vec(&self.gpu.read_back(&output, size)?);
            pixels.extend(found.into_iter().map(|pixel| RealTimePixel {
                radiance: pixel.radiance.map(f64::from),
                transmittance: pixel.transmittance.map(f64::from),
                samples: pixel.samples,
                dense: pixel.dense,
            }));
        }
        Ok(pixels)
    }
}
