//! An engine's frame in one kernel on the adapter: rays, march and compositing (`shaders/engines/frame.wgsl`), with nothing between them in memory.
//!
//! For frames whose pixels have a ray each through their middle, without jitter, of a camera that [`ViewUniform`] knows, over one colour or none,
//! and whose rays a dispatch marches at once ([`goes_at_once`](crate::engines::march::gpu::goes_at_once)). On Mesa's llvmpipe, where each lane reads and writes memory on its own, what
//! the three kernels hand to each other takes longer than a march through a cached density.

use crate::base::error::Result;
use crate::base::progress::Progress;
use crate::engines::march::camera::{self, ViewUniform};
use crate::engines::march::gpu::{Form, MarchKernel, MarchParts};
use crate::engines::march::{Marched, RealTimeSettings};
use crate::engines::passes::Channels;
use crate::engines::passes::compositing::{self, Background, CompositeUniform, Compositing};
use crate::engines::passes::frame::Frame;
use crate::gpu::{Gpu, Layout};
use wgpu::BufferUsages;

/// How a frame shows what its rays came to.
pub(crate) struct Look {
    pub compositing: Compositing,
    /// One colour or none.
    pub background: Background,
    pub channels: Channels,
    /// The film's factor on radiance.
    pub exposure: f64,
}

/// The kernel, compiled.
pub(crate) struct FrameKernel<'a> {
    gpu: &'a Gpu,
    march: MarchKernel<'a>,
    view: ViewUniform,
    composite: CompositeUniform,
}

impl<'a> FrameKernel<'a> {
    /// Compiles it.
    pub async fn new_async(
        gpu: &'a Gpu,
        marched: &Marched<'_>,
        settings: &RealTimeSettings,
        view: ViewUniform,
        look: &Look,
    ) -> Result<Self> {
        let constants = camera::CONSTANTS.text();
        let form = Form::Frame {
            has_numbers: gpu.keeps_kernels(),
            around: &[("generated/camera.wgsl", &constants), camera::SOURCE, compositing::SOURCE],
            entry: ("engines/frame.wgsl", include_str!("../../shaders/engines/frame.wgsl")),
            definitions: &compositing::definitions(look.compositing, &look.background, look.channels),
        };
        let around = [
            Layout::of::<ViewUniform>().imported("camera_View"),
            Layout::of::<CompositeUniform>().imported("compositing_Composite"),
        ];
        let layouts = [&MarchParts::LAYOUTS_IN_FRAME[..], &around].concat();
        let march = MarchKernel::in_form(gpu, marched, settings, &form, &layouts).await?;
        let colour = match look.background {
            Background::Constant(radiance) => radiance,
            Background::None | Background::PerPixel(_) => [0.0; 3],
        };
        Ok(Self { gpu, march, view, composite: CompositeUniform::over(colour, look.exposure as f32) })
    }

    /// Submits the work that makes a frame.
    pub fn run(&self, frame: &Frame, progress: Progress<'_>) -> Result<()> {
        let upload = |label, bytes: &[u8]| self.gpu.upload(label, bytes, BufferUsages::UNIFORM);
        let composite = upload("composite", bytemuck::bytes_of(&self.composite));
        let around = |first, count| {
            let view = upload("view", bytemuck::bytes_of(&self.view.of_pixels(first, count)));
            let buffers =
                [Some(view), Some(composite.clone()), Some(frame.colour.clone()), frame.transmittance.clone()];
            (0..).zip(buffers).filter_map(|(binding, buffer)| Some(((2, binding), buffer?))).collect()
        };
        self.march.run_frame(frame.pixels(), around, progress)
    }
}
