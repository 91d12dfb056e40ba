//! A picture that stays on the adapter until somebody reads it: twin of [`Image`].

use crate::base::error::{Error, Result};
use crate::engines::passes::Channels;
use crate::gpu::Gpu;
use crate::scene::image::Image;

/// Bytes of a pixel's colour, four floats, and of its transmittance, three.
const COLOUR_BYTES: u64 = 16;
const TRANSMITTANCE_BYTES: u64 = 12;

/// A picture in the adapter's memory, row by row from the top.
pub struct Frame {
    /// Pixels per row.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// Premultiplied red, green, blue, and alpha of each pixel: `array<vec4f>`.
    pub colour: wgpu::Buffer,
    /// Share of a background that each channel lets through, three numbers per pixel: `array<f32>`.
    pub transmittance: Option<wgpu::Buffer>,
}

impl Frame {
    /// A frame of zeros. An error where the adapter has no buffer of that size.
    pub fn new(gpu: &Gpu, [width, height]: [u32; 2], channels: Channels) -> Result<Self> {
        let pixels = u64::from(width) * u64::from(height);
        let limits = gpu.device().limits();
        let most = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        if pixels == 0 || pixels * COLOUR_BYTES > most {
            return Err(Error::new(
                "a frame on the adapter",
                format!("{width} x {height} pixels"),
                format!("1 to {} pixels: adapter {} binds {most} bytes", most / COLOUR_BYTES, gpu.adapter().name),
                "Take a smaller picture, or the CPU.",
            ));
        }
        let buffer = |label: &str, size: u64| {
            gpu.device().create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        Ok(Self {
            width,
            height,
            colour: buffer("frame colour", pixels * COLOUR_BYTES),
            transmittance: channels.transmittance.then(|| buffer("frame transmittance", pixels * TRANSMITTANCE_BYTES)),
        })
    }

    /// A picture brought to the adapter, with the channels that it has.
    pub fn upload(gpu: &Gpu, image: &Image) -> Result<Self> {
        let channels = Channels { transmittance: image.transmittance.is_some() };
        let frame = Self::new(gpu, [image.width as u32, image.height as u32], channels)?;
        gpu.queue().write_buffer(&frame.colour, 0, bytemuck::cast_slice(&image.pixels));
        if let (Some(buffer), Some(transmittance)) = (&frame.transmittance, &image.transmittance) {
            gpu.queue().write_buffer(buffer, 0, bytemuck::cast_slice(transmittance));
        }
        Ok(frame)
    }

    /// Number of its pixels.
    pub fn pixels(&self) -> u32 {
        self.width * self.height
    }

    /// What it holds beside the colour.
    pub fn channels(&self) -> Channels {
        Channels { transmittance: self.transmittance.is_some() }
    }

    /// Its transmittance, for a pass that needs it.
    pub fn needed_transmittance(&self, pass: &str) -> Result<&wgpu::Buffer> {
        self.transmittance.as_ref().ok_or_else(|| missing(pass))
    }

    /// The picture in memory, after all work that was submitted before this call.
    pub async fn read_back_async(&self, gpu: &Gpu) -> Result<Image> {
        let pixels = u64::from(self.pixels());
        // Both copies are submitted before the first is waited for.
        let colour = gpu.read_back_async(&self.colour, pixels * COLOUR_BYTES);
        let transmittance =
            self.transmittance.as_ref().map(|buffer| gpu.read_back_async(buffer, pixels * TRANSMITTANCE_BYTES));
        let mut image = Image::new(self.width as usize, self.height as usize);
        image.pixels = bytemuck::pod_collect_to_vec(&colour.await?);
        if let Some(transmittance) = transmittance {
            image.transmittance = Some(bytemuck::pod_collect_to_vec(&transmittance.await?));
        }
        Ok(image)
    }

    /// [`Self::read_back_async`] for callers that may wait.
    pub fn read_back(&self, gpu: &Gpu) -> Result<Image> {
        gpu.block_on(self.read_back_async(gpu))?
    }
}

/// What a pass says that needs a channel that is not there.
pub(super) fn missing(pass: &str) -> Error {
    Error::new(
        format!("pass {pass}"),
        "a frame without transmittance",
        "a frame with the channels that the pass needs",
        "This is a defect of the program: report it with the command.",
    )
}
