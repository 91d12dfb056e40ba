//! Rays of a camera, made on the adapter (`shaders/engines/camera.wgsl`): for pictures whose camera moves while one looks, and for frames of
//! one ray a pixel without jitter; others have their rays in f64 ([`crate::engines::render`]).
//!
//! A place is that of f64 but for f32's rounding of the distance from the frame's origin to the camera: some 2^-22 of it.

use crate::base::error::{Error, Result};
use crate::engines::domain::{Container, Outline};
use crate::engines::march::SHORTEST;
use crate::engines::march::gpu::Ray;
use crate::gpu::{Bindings, ComputeKernel, Gpu, Layout};
use crate::graph::constants::{SharedConstants, SharedNumber};
use crate::graph::wgsl::Linker;
use crate::shader_struct;
use crate::view::camera::Camera;
use bytemuck::Zeroable;
use glam::{DVec2, DVec3};

/// Numbers that the kernel imports.
pub const CONSTANTS: SharedConstants = SharedConstants {
    path: "cloudparity::camera::constants",
    numbers: &[("SHORTEST", SharedNumber::Float(SHORTEST as f32))],
};

shader_struct! {
    /// Uniforms of the kernel; the shader says what they are.
    pub(crate) struct ViewUniform = "View" {
        start: [f32; 3],
        width: u32,
        start_across: [f32; 3],
        height: u32,
        start_up: [f32; 3],
        farthest: f32,
        way: [f32; 3],
        first: u32,
        way_across: [f32; 3],
        count: u32,
        way_up: [f32; 3],
        jitter: f32,
        direction: [f32; 3],
        is_endless: u32,
        direction_across: [f32; 3],
        padding: f32,
        direction_up: [f32; 3],
        more_padding: f32,
        low: [f32; 3],
        further_padding: f32,
        high: [f32; 3],
        end_padding: f32,
    }
}

impl ViewUniform {
    /// The same of so many pixels from one on, row by row from the top.
    pub(crate) fn of_pixels(self, first: u32, count: u32) -> Self {
        Self { first, count, ..self }
    }

    /// Whether rays begin so near to the box that f32's roundings of a place, four of up to 2^-24 of its distance, stay within 2^-20 of the box's side
    /// along each axis: within four sides. Of what has no end some rays come from far away.
    pub(crate) fn is_near(&self, container: &Container) -> bool {
        let region = container.outline.region();
        let start = DVec3::from(self.start.map(f64::from));
        !container.outline.is_endless() && start.abs().cmple(4.0 * (region.high - region.low)).all()
    }

    /// A camera's view of a container, samples in the middle of their steps. An error where rays are no plane, and where the container is
    /// no box.
    pub(crate) fn new(camera: &Camera, container: &Container, [width, height]: [u32; 2]) -> Result<Self> {
        let Outline::Box(region) = container.outline else {
            return Err(Error::new(
                "the domain of a moving picture",
                "a shell or a mesh",
                "a box or a slab",
                "Take the object's bounds, or another domain.",
            ));
        };
        let Some(plane) = camera.plane() else {
            return Err(Error::new(
                "the camera of a moving picture",
                "a panorama",
                "a perspective or an orthographic camera",
                "Give the scene another camera.",
            ));
        };
        // Where rays begin is linear in the raster position, too: three of them tell it.
        let first = camera.ray(DVec2::ZERO);
        let begin = |raster: DVec2| {
            let ray = camera.ray(raster);
            container.to_local.transform_point3(ray.origin + ray.direction * ray.near)
        };
        let start = begin(DVec2::ZERO);
        let way = |direction: DVec3| container.to_local.transform_vector3(direction * container.unit);
        let single = |value: DVec3| value.as_vec3().to_array();
        // Clip distances stretch with the direction.
        let range = (first.far - first.near) / plane.corner.length();
        Ok(Self {
            start: single(start),
            width,
            start_across: single(begin(DVec2::X) - start),
            height,
            start_up: single(begin(DVec2::Y) - start),
            farthest: (range / container.unit) as f32,
            way: single(way(plane.corner)),
            way_across: single(way(plane.across)),
            way_up: single(way(plane.up)),
            jitter: 0.5,
            direction: single(plane.corner),
            is_endless: u32::from(container.outline.is_endless()),
            direction_across: single(plane.across),
            direction_up: single(plane.up),
            low: single(region.low),
            high: single(region.high),
            ..Self::zeroed()
        })
    }
}

/// The kernel, compiled, with a camera's view of a container.
pub(crate) struct CameraKernel<'a> {
    gpu: &'a Gpu,
    kernel: ComputeKernel,
    view: ViewUniform,
}

impl<'a> CameraKernel<'a> {
    /// Compiles it.
    pub async fn new_async(gpu: &'a Gpu, view: ViewUniform) -> Result<Self> {
        Ok(Self { gpu, kernel: gpu.kernel_async("camera", &module()?, &LAYOUTS).await?, view })
    }

    /// Rays of so many pixels from one on, row by row from the top: `array<Ray>`.
    pub fn rays(&self, first: u32, count: u32) -> Result<wgpu::Buffer> {
        let gpu = self.gpu;
        let rays = gpu.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some("rays"),
            size: u64::from(count) * size_of::<Ray>() as u64,
            usage: wgpu::BufferUsages::STORAGE,
            mapped_at_creation: false,
        });
        let view = self.view.of_pixels(first, count);
        let view = gpu.upload("view", bytemuck::bytes_of(&view), wgpu::BufferUsages::UNIFORM);
        gpu.dispatch(&self.kernel, &Bindings::new().group(0, [&view, &rays]), [count, 1, 1])?;
        Ok(rays)
    }
}

/// Of the structs in the kernel's buffers.
pub(crate) const LAYOUTS: [Layout; 2] = [Layout::of::<ViewUniform>(), Layout::of::<Ray>()];

/// The kernel.
pub(crate) fn module() -> Result<naga::Module> {
    let mut linker = Linker::bare();
    linker.add_constants(&CONSTANTS);
    linker.link(SOURCE.0, SOURCE.1)
}

/// Path and text of the kernel, which a picture in a fragment shader has, too.
pub(crate) const SOURCE: (&str, &str) = ("engines/camera.wgsl", include_str!("../../../shaders/engines/camera.wgsl"));
