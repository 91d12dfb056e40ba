//! How what a march came to is put over a background, and its rays are averaged: on the CPU, and on the adapter
//! (`shaders/engines/passes/compositing.wgsl`), where neither rays nor frame leave it.

use crate::base::error::{Error, Result};
use crate::engines::march::RealTimePixel;
use crate::engines::march::gpu::Pixel;
use crate::engines::passes::Channels;
use crate::engines::passes::frame::{Frame, missing};
use crate::gpu::{Bindings, ComputeKernel, Gpu, Layout};
use crate::graph::wgsl::Linker;
use crate::shader_struct;
use serde::{Deserialize, Serialize};

/// How a pixel is put over a background. Nothing set is right: radiance + transmittance x background, channel by channel.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Compositing {
    /// Alpha is what red loses, for all channels.
    pub alpha_of_red: bool,
    /// Radiance, which is weighted already, is multiplied by alpha where there is a background.
    pub alpha_twice: bool,
}

impl Compositing {
    /// The rays of a pixel over the background, or with their alpha where there is none: their mean, with `exposure` on the radiance.
    pub fn compose(self, rays: &[RealTimePixel], background: Option<[f64; 3]>, exposure: f64) -> [f32; 4] {
        let mut mean = [0.0; 4];
        for ray in rays {
            let shown = self.composite(ray, background);
            for channel in 0..4 {
                mean[channel] += shown[channel] / rays.len() as f64;
            }
        }
        [mean[0] * exposure, mean[1] * exposure, mean[2] * exposure, mean[3]].map(|value| value as f32)
    }

    /// A ray over the background, or with its alpha where there is none.
    pub fn composite(self, ray: &RealTimePixel, background: Option<[f64; 3]>) -> [f64; 4] {
        let [red, green, blue] = ray.radiance;
        let Some(background) = background else {
            return [red, green, blue, 1.0 - self.through(ray.transmittance)];
        };
        let mixed: [f64; 3] = std::array::from_fn(|channel| {
            let through = if self.alpha_of_red { ray.transmittance[0] } else { ray.transmittance[channel] };
            let weight = if self.alpha_twice { 1.0 - through } else { 1.0 };
            ray.radiance[channel] * weight + through * background[channel]
        });
        [mixed[0], mixed[1], mixed[2], 1.0]
    }

    /// Share of the background that is seen, of all channels together: their mean, or red's. One minus alpha.
    pub fn through(self, transmittance: [f64; 3]) -> f64 {
        if self.alpha_of_red { transmittance[0] } else { transmittance.iter().sum::<f64>() / 3.0 }
    }

    /// Whether a finished picture holds the transmittance of each channel: where there is no background yet, so that one can be put
    /// behind it channel by channel. The original has red's alpha instead.
    pub fn keeps_transmittance(self, transparent: bool) -> bool {
        transparent && !self.alpha_of_red
    }
}

/// Mean transmittance of the rays of a pixel.
pub fn mean_transmittance(rays: &[RealTimePixel]) -> [f32; 3] {
    std::array::from_fn(|channel| {
        (rays.iter().map(|ray| ray.transmittance[channel] / rays.len() as f64).sum::<f64>()) as f32
    })
}

/// What stands behind the medium, on the adapter.
#[derive(Debug, Clone)]
pub enum Background {
    /// Nothing: the frame has an alpha.
    None,
    /// Radiance of every pixel.
    Constant([f64; 3]),
    /// Radiance of each pixel, three numbers: `array<f32>`.
    PerPixel(wgpu::Buffer),
}

impl Background {
    /// The definitions of the kernel for it.
    fn definitions(&self) -> &'static [&'static str] {
        match self {
            Self::None => &[],
            Self::Constant(_) => &["BACKGROUND"],
            Self::PerPixel(_) => &["BACKGROUND", "PER_PIXEL"],
        }
    }
}

/// Pixels of a frame that are composed together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    /// The first one's number in the frame.
    pub first: u32,
    /// How many.
    pub count: u32,
    /// Rays of each, which lie one behind the other.
    pub rays: u32,
}

shader_struct! {
    /// Uniforms of the kernel.
    pub(crate) struct CompositeUniform = "Composite" {
        background: [f32; 3],
        exposure: f32,
        first: u32,
        count: u32,
        rays: u32,
        begin: u32,
    }
}

impl CompositeUniform {
    /// Over a background, with a factor on radiance; no pixels yet.
    pub(crate) fn over(background: [f64; 3], exposure: f32) -> Self {
        Self { background: background.map(|channel| channel as f32), exposure, first: 0, count: 0, rays: 0, begin: 0 }
    }
}

/// Of the structs in the kernel's buffers.
pub(crate) const LAYOUTS: [Layout; 2] = [Layout::of::<CompositeUniform>(), Layout::of::<Pixel>()];

/// The kernel for a kind of background and for frames with these channels. What is not asked for is left out.
pub(crate) fn module(compositing: Compositing, background: &Background, channels: Channels) -> Result<naga::Module> {
    Linker::bare().link_with(SOURCE.0, SOURCE.1, &definitions(compositing, background, channels))
}

/// Path and text of the kernel, which a picture in a fragment shader has, too.
pub(crate) const SOURCE: (&str, &str) =
    ("engines/passes/compositing.wgsl", include_str!("../../../shaders/engines/passes/compositing.wgsl"));

/// What the text is specialised by.
pub(crate) fn definitions(compositing: Compositing, background: &Background, channels: Channels) -> Vec<&'static str> {
    let mut definitions = background.definitions().to_vec();
    definitions.extend(compositing.alpha_of_red.then_some("ALPHA_OF_RED"));
    definitions.extend(compositing.alpha_twice.then_some("ALPHA_TWICE"));
    definitions.extend(channels.transmittance.then_some("TRANSMITTANCE"));
    definitions
}

/// Compositing on the adapter.
pub struct CompositeKernel<'a> {
    gpu: &'a Gpu,
    kernel: ComputeKernel,
    background: Background,
    channels: Channels,
}

impl<'a> CompositeKernel<'a> {
    /// Compiles it for a kind of background and for frames with these channels. What is not asked for is left out.
    pub async fn new_async(
        gpu: &'a Gpu,
        compositing: Compositing,
        background: Background,
        channels: Channels,
    ) -> Result<Self> {
        let module = module(compositing, &background, channels)?;
        let kernel = gpu.kernel_async("compositing", &module, &LAYOUTS).await?;
        Ok(Self { gpu, kernel, background, channels })
    }

    /// [`Self::new_async`] for callers that may wait.
    pub fn new(gpu: &'a Gpu, compositing: Compositing, background: Background, channels: Channels) -> Result<Self> {
        gpu.block_on(Self::new_async(gpu, compositing, background, channels))?
    }

    /// Another background of the same kind.
    pub fn set_background(&mut self, background: Background) -> Result<()> {
        if background.definitions() != self.background.definitions() {
            return Err(Error::new(
                "compositing on the adapter",
                "a background of another kind",
                "one of the kind that the kernel was compiled for",
                "Compile another kernel.",
            ));
        }
        self.background = background;
        Ok(())
    }

    /// Submits the work that composes a part of a frame from what its rays came to: `array<Pixel>` of the march, the rays of each pixel one
    /// behind the other, beginning with those of the part's first pixel. `exposure` is the film's factor on radiance. Waits for nothing.
    pub fn run(&self, frame: &Frame, marched: &wgpu::Buffer, part: Part, exposure: f64) -> Result<()> {
        let Part { first, count, rays } = part;
        if self.channels.transmittance && !frame.channels().transmittance {
            return Err(missing("compositing"));
        }
        let needed = u64::from(count) * u64::from(rays) * size_of::<Pixel>() as u64;
        let end = u64::from(first) + u64::from(count);
        let backgrounds = match &self.background {
            Background::PerPixel(buffer) => buffer.size() / 12,
            _ => u64::from(frame.pixels()),
        };
        if rays == 0 || end > u64::from(frame.pixels()) || needed > marched.size() || backgrounds < end {
            return Err(Error::new(
                "compositing on the adapter",
                format!("{count} pixels of {rays} rays from pixel {first} on, and {backgrounds} backgrounds"),
                format!(
                    "pixels of the {} of the frame, with rays among the {} that were marched and a background each",
                    frame.pixels(),
                    marched.size() / size_of::<Pixel>() as u64
                ),
                "This is a defect of the program: report it with the command.",
            ));
        }
        let background = match &self.background {
            Background::Constant(radiance) => radiance.map(|channel| channel as f32),
            _ => [0.0; 3],
        };
        let most =
            self.gpu.device().limits().max_compute_workgroups_per_dimension.saturating_mul(self.kernel.workgroup()[0]);
        for begin in (0..count).step_by(most as usize) {
            let count = most.min(count - begin);
            let uniform =
                CompositeUniform { background, exposure: exposure as f32, first: first + begin, count, rays, begin };
            let uniform = self.gpu.upload("composite", bytemuck::bytes_of(&uniform), wgpu::BufferUsages::UNIFORM);
            let mut bindings = Bindings::new().group(0, [&uniform, marched, &frame.colour]);
            if let Some(transmittance) = &frame.transmittance {
                bindings = bindings.bind(0, 3, transmittance.as_entire_binding());
            }
            if let Background::PerPixel(buffer) = &self.background {
                bindings = bindings.bind(0, 4, buffer.as_entire_binding());
            }
            self.gpu.dispatch(&self.kernel, &bindings, [count, 1, 1])?;
        }
        Ok(())
    }
}
