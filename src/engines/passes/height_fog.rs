//! Height fog of boltbestclouds32: a colour blended over a picture by the distance of what is seen and the height of the view.
//!
//! ```text
//! amount = (1 - exp(-distance density)) exp(-falloff max(0, d_up))        colour' = lerp(colour, fog, amount)
//! ```
//!
//! The fog's colour is mixed with the sun's by 0.3 clamp(cosine, 0, 1)^8. The document's line lacks the parentheses: 1 - exp(-distance density)
//! exp(-falloff d_up), which is fog at the zenith, too (defect MS-2). A scene of volumes has nothing else to be seen, so that the distance is one
//! number: that of the background.
//!
//! Twin on the adapter: `shaders/engines/passes/height_fog.wgsl`.

use crate::base::error::{Error, Result};
use crate::base::files::json;
use crate::engines::light::Sun;
use crate::engines::passes::frame::Frame;
use crate::engines::passes::{Channels, Compiling, Pass, PassKernel, View};
use crate::gpu::{Bindings, ComputeKernel, Gpu, Layout};
use crate::graph::wgsl::Linker;
use crate::scene::image::Image;
use crate::shader_struct;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Share of the sun's colour where the view looks into it.
const SUN_SHARE: f64 = 0.3;

/// The fog.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HeightFog {
    /// Per metre.
    pub density: f64,
    /// Metres to the background.
    pub distance: f64,
    /// Fall of the fog with the sine of the view's elevation.
    pub falloff: f64,
    /// Radiance where it hides everything.
    pub colour: [f64; 3],
    /// Colour of the sun's mist per unit of its irradiance.
    pub sun_gain: f64,
    /// Defect MS-2.
    pub without_parentheses: bool,
}

impl HeightFog {
    /// What the depth of it takes of the background: 1 - exp(-distance density).
    fn depth(&self) -> f64 {
        -(-self.distance * self.density).exp_m1()
    }

    /// Share of the fog in a direction whose third coordinate points up.
    pub fn amount(&self, direction: DVec3) -> f64 {
        let above = (-direction.z.max(0.0) * self.falloff).exp();
        match self.without_parentheses {
            true => 1.0 - (1.0 - self.depth()) * above,
            false => self.depth() * above,
        }
    }

    /// Its colour in a direction under a sun.
    pub fn tint(&self, direction: DVec3, sun: Option<&Sun>) -> [f64; 3] {
        let Some(sun) = sun else { return self.colour };
        let part = SUN_SHARE * direction.dot(sun.towards()).clamp(0.0, 1.0).powi(8);
        std::array::from_fn(|channel| {
            self.colour[channel] + part * (self.sun_gain * sun.irradiance[channel] - self.colour[channel])
        })
    }
}

/// The sun that delivers most.
fn brightest<'a>(view: &View<'a>) -> Option<&'a Sun> {
    view.suns.iter().max_by(|a, b| a.brightest().total_cmp(&b.brightest()))
}

impl Pass for HeightFog {
    fn id(&self) -> &'static str {
        "height-fog"
    }

    fn settings(&self) -> String {
        json(self)
    }

    fn needs(&self) -> Channels {
        Channels::default()
    }

    fn run(&self, frame: &mut Image, view: &View<'_>) -> Result<()> {
        let sun = brightest(view);
        let [width, height] = [frame.width, frame.height];
        let fogs: Vec<(f64, [f64; 3])> = (0..width * height)
            .into_par_iter()
            .map(|index| {
                let raster = DVec2::new((index % width) as f64 + 0.5, (height - 1 - index / width) as f64 + 0.5);
                let direction = view.camera.ray(raster).direction;
                (self.amount(direction), self.tint(direction, sun))
            })
            .collect();
        for (pixel, (amount, tint)) in frame.pixels.iter_mut().zip(&fogs) {
            let fog = [0, 1, 2].map(|channel| view.exposure * tint[channel]);
            let fog = [fog[0], fog[1], fog[2], 1.0];
            *pixel = std::array::from_fn(|channel| {
                let before = f64::from(pixel[channel]);
                (before + amount * (fog[channel] - before)) as f32
            });
        }
        if let Some(transmittance) = &mut frame.transmittance {
            for (pixel, (amount, _)) in transmittance.iter_mut().zip(&fogs) {
                *pixel = pixel.map(|channel| (f64::from(channel) * (1.0 - amount)) as f32);
            }
        }
        Ok(())
    }

    fn compile<'a>(&self, gpu: &'a Gpu) -> Compiling<'a> {
        let fog = *self;
        Box::pin(async move {
            let kernel: Box<dyn PassKernel + 'a> = Box::new(HeightFogKernel::new_async(gpu, fog).await?);
            Ok(kernel)
        })
    }
}

shader_struct! {
    /// Uniforms of the kernel.
    struct HeightFogUniform = "HeightFog" {
        corner: [f32; 3],
        width: u32,
        across: [f32; 3],
        height: u32,
        up: [f32; 3],
        depth: f32,
        colour: [f32; 3],
        falloff: f32,
        sun: [f32; 3],
        sun_share: f32,
        sun_colour: [f32; 3],
        first: u32,
    }
}

/// Height fog on the adapter: a kernel for frames without transmittance and one for those with it.
struct HeightFogKernel<'a> {
    gpu: &'a Gpu,
    fog: HeightFog,
    kernels: [ComputeKernel; 2],
}

impl<'a> HeightFogKernel<'a> {
    async fn new_async(gpu: &'a Gpu, fog: HeightFog) -> Result<Self> {
        let source = include_str!("../../../shaders/engines/passes/height_fog.wgsl");
        let kernel = async |further: &[&'static str]| {
            let defect = fog.without_parentheses.then_some("WITHOUT_PARENTHESES");
            let definitions: Vec<&str> = further.iter().copied().chain(defect).collect();
            let module = Linker::bare().link_with("engines/passes/height_fog.wgsl", source, &definitions)?;
            gpu.kernel_async("height_fog", &module, &[Layout::of::<HeightFogUniform>()]).await
        };
        Ok(Self { gpu, fog, kernels: [kernel(&[]).await?, kernel(&["TRANSMITTANCE"]).await?] })
    }
}

impl PassKernel for HeightFogKernel<'_> {
    fn run(&self, frame: &Frame, view: &View<'_>) -> Result<()> {
        let Some(plane) = view.camera.plane() else {
            return Err(Error::new(
                "$.camera.projection",
                "a panorama, under height fog on the adapter",
                "a picture on a plane",
                "Render on the CPU, or leave the fog out.",
            ));
        };
        let single = |vector: DVec3| vector.as_vec3().to_array();
        let scaled = |colour: [f64; 3], factor: f64| colour.map(|channel| (channel * factor) as f32);
        let sun = brightest(view);
        let uniform = HeightFogUniform {
            corner: single(plane.corner),
            width: frame.width,
            across: single(plane.across),
            height: frame.height,
            up: single(plane.up),
            depth: self.fog.depth() as f32,
            colour: scaled(self.fog.colour, view.exposure),
            falloff: self.fog.falloff as f32,
            sun: sun.map_or([0.0; 3], |sun| single(sun.towards())),
            sun_colour: sun.map_or([0.0; 3], |sun| scaled(sun.irradiance, self.fog.sun_gain * view.exposure)),
            sun_share: sun.map_or(0.0, |_| SUN_SHARE as f32),
            first: 0,
        };
        let kernel = &self.kernels[usize::from(frame.transmittance.is_some())];
        let most = self.gpu.device().limits().max_compute_workgroups_per_dimension * kernel.workgroup()[0];
        for first in (0..frame.pixels()).step_by(most as usize) {
            let uniform = HeightFogUniform { first, ..uniform };
            let uniform = self.gpu.upload("height fog", bytemuck::bytes_of(&uniform), wgpu::BufferUsages::UNIFORM);
            let mut bindings = Bindings::new().group(0, [&uniform]).bind(0, 1, frame.colour.as_entire_binding());
            if let Some(transmittance) = &frame.transmittance {
                bindings = bindings.bind(0, 2, transmittance.as_entire_binding());
            }
            self.gpu.dispatch(kernel, &bindings, [most.min(frame.pixels() - first), 1, 1])?;
        }
        Ok(())
    }
}
