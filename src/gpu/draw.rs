//! Pictures of fragment shaders, as programs draw them that have no compute kernels.

use super::{Gpu, trusted_module};
use crate::base::error::{Error, Result};
use wgpu::util::{DeviceExt, TextureDataOrder};

/// Pixels of one submission, at most, so that a software adapter answers in between.
const PIXELS_TOGETHER: u32 = 4096;

/// A triangle over the whole picture.
const CORNERS: &str = "@vertex fn main(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    return vec4f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}";

/// What a fragment shader reads, and the picture that it draws.
pub struct Drawing<'a> {
    /// The module; its fragment entry `main` gives one colour.
    pub module: &'a naga::Module,
    /// Uniforms of group 0 by binding.
    pub uniforms: Vec<(u32, &'a [u8])>,
    /// Binding 0 of group 1: texels of 8 bits a channel, whole rows, with width and height.
    pub texels: (&'a [u8], [u32; 2]),
    /// Width and height.
    pub size: [u32; 2],
}

/// A fragment shader that is compiled, with what it reads on the adapter: for pictures whose time is measured.
pub struct ReadyDrawing<'a> {
    gpu: &'a Gpu,
    pipeline: wgpu::RenderPipeline,
    groups: Vec<wgpu::BindGroup>,
    target: wgpu::Texture,
}

impl Gpu {
    /// Compiles it. An error where the driver refuses the shader.
    pub fn ready_to_draw(&self, drawing: &Drawing<'_>) -> Result<ReadyDrawing<'_>> {
        crate::graph::wgsl::validate(drawing.module)?;
        let [width, height] = drawing.size;
        let most = self.device.limits().max_texture_dimension_2d;
        let (texels, data_size) = drawing.texels;
        if let Some(side) = [width, height, data_size[0], data_size[1]].into_iter().find(|&side| side > most) {
            return Err(Error::new(
                "a picture of a fragment shader",
                format!("a texture {side} texels long"),
                format!("at most {most}, the adapter's limit"),
                "Take fewer pixels, or fewer texels of the model.",
            ));
        }
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let fragment = self.module("picture", drawing.module);
        let source = wgpu::ShaderSource::Wgsl(CORNERS.into());
        let vertex = trusted_module(&self.device, wgpu::ShaderModuleDescriptor { label: Some("corners"), source });
        let format = wgpu::TextureFormat::Rgba32Float;
        let pipeline = self.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("picture"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &vertex,
                entry_point: None,
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &fragment,
                entry_point: Some("main"),
                compilation_options: Default::default(),
                targets: &[Some(format.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        if let Some(cause) = self.block_on(scope.pop())? {
            return Err(Error::new(
                "a picture of a fragment shader",
                cause.to_string(),
                "a pipeline that the driver accepts",
                "Report it with the adapter's name.",
            ));
        }
        let is_left = |group, binding| {
            let mut places = drawing.module.global_variables.iter().filter_map(|(_, variable)| variable.binding);
            places.any(|place| (place.group, place.binding) == (group, binding))
        };
        let uniforms: Vec<(u32, wgpu::Buffer)> = drawing
            .uniforms
            .iter()
            .filter(|(binding, _)| is_left(0, *binding))
            .map(|(binding, bytes)| (*binding, self.upload("uniform", bytes, wgpu::BufferUsages::UNIFORM)))
            .collect();
        let group = |number, entries: &[wgpu::BindGroupEntry<'_>]| {
            let layout = &pipeline.get_bind_group_layout(number);
            self.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries })
        };
        let entries: Vec<wgpu::BindGroupEntry<'_>> = uniforms
            .iter()
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding: *binding, resource: buffer.as_entire_binding() })
            .collect();
        let mut groups = vec![group(0, &entries)];
        if is_left(1, 0) {
            let data = self.device.create_texture_with_data(
                &self.queue,
                &texture("data", data_size, wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureUsages::TEXTURE_BINDING),
                TextureDataOrder::LayerMajor,
                texels,
            );
            let view = data.create_view(&Default::default());
            let resource = wgpu::BindingResource::TextureView(&view);
            groups.push(group(1, &[wgpu::BindGroupEntry { binding: 0, resource }]));
        }
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let target = self.device.create_texture(&texture("picture", drawing.size, format, usage));
        Ok(ReadyDrawing { gpu: self, pipeline, groups, target })
    }
}

impl ReadyDrawing<'_> {
    /// Draws it: colours row by row from the top, as f32.
    pub fn pixels(&self) -> Result<Vec<[f32; 4]>> {
        let Self { gpu, pipeline, groups, target } = self;
        let [width, height] = [target.width(), target.height()];
        let view = target.create_view(&Default::default());
        let rows = (PIXELS_TOGETHER / width.max(1)).max(1);
        for first in (0..height).step_by(rows as usize) {
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            {
                let load = if first == 0 { wgpu::LoadOp::Clear(wgpu::Color::BLACK) } else { wgpu::LoadOp::Load };
                let attachment = wgpu::RenderPassColorAttachment {
                    view: &view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
                };
                let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                    color_attachments: &[Some(attachment)],
                    ..Default::default()
                });
                pass.set_pipeline(pipeline);
                for (number, group) in (0..).zip(groups) {
                    pass.set_bind_group(number, group, &[]);
                }
                pass.set_scissor_rect(0, first, width, rows.min(height - first));
                pass.draw(0..3, 0..1);
            }
            gpu.queue.submit([encoder.finish()]);
        }
        // Rows of a copy are multiples of 256 bytes.
        let pitch = (16 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let size = u64::from(pitch) * u64::from(height);
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("picture"),
            size,
            usage: wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(pitch), rows_per_image: None };
        encoder.copy_texture_to_buffer(
            target.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
            target.size(),
        );
        gpu.queue.submit([encoder.finish()]);
        let bytes = gpu.read_back(&buffer, size)?;
        Ok(bytes
            .chunks(pitch as usize)
            .flat_map(|row| bytemuck::pod_collect_to_vec(&row[..16 * width as usize]))
            .collect())
    }
}

fn texture(
    label: &str,
    [width, height]: [u32; 2],
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
) -> wgpu::TextureDescriptor<'_> {
    wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    }
}
