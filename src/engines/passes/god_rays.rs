//! Rays of light as a radial blur of the picture of what hides the sun (after Mitchell 2007, "Volumetric Light Scattering as a
//! Post-Process", GPU Gems 3, with the weights of the published Perlin-FBM engine).
//!
//! After the book, a pixel may also count itself, and the reads may span a part of the way (`centre`, `reach`).
//!
//! A pixel sums `samples` reads on the way to the sun, the i-th of them with weight `weight` decay^i; the sum is multiplied by
//! `density`, `exposure` and the sun's colour. `density` does not shorten the way here, unlike in the book.
//!
//! What is blurred is the sun's glow times what the medium lets through, at half the resolution, rounded down. The original never
//! renders it (defect PF-11). The glow stands where the original's sun does: at the point of the screen that the pass knows. With a sun
//! behind the camera that point is a mirrored one (defect PF-13), and so are glow and rays; corrected, they fade out before.
//!
//! Twin on the adapter: `shaders/engines/passes/god_rays.wgsl`.

use crate::base::error::{Error, Result};
use crate::base::files::json;
use crate::engines::passes::compositing::Compositing;
use crate::engines::passes::frame::{Frame, missing};
use crate::engines::passes::{Channels, Compiling, Pass, PassKernel, View};
use crate::gpu::{Bindings, ComputeKernel, Gpu, Layout};
use crate::graph::wgsl::Linker;
use crate::media::transfer::smooth;
use crate::scene::image::Image;
use crate::shader_struct;
use crate::view::camera::RasterPlane;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Distance of the point that stands for the sun on the screen, in sides of the box: 9000 units where the box has 120.
const SUN_DISTANCE: f64 = 75.0;

/// Radius of the sun's glow in the occlusion picture, as the distance of unit vectors, which is the angle to a part in 10,000: at half
/// resolution a true disc would fall between pixels.
pub const SUN_GLOW: f64 = 0.05;

/// Cosine to the view axis below which god rays fade, to nothing where the sun stands in the image plane.
const FADE: f64 = 0.2;

/// What is farther away than this, in texels, is taken to be here: f32 has no more, and the way there leaves the picture at once.
const FARTHEST: f64 = 1e30;

/// Reads of one submission: some 50 ms on a software adapter.
const READS: u32 = 1 << 22;

/// How the blur is made.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GodRays {
    /// A factor on the result.
    pub density: f64,
    /// Weight of a read over that of the one before, 0 to 1.
    pub decay: f64,
    /// Weight of the first read.
    pub weight: f64,
    /// Another factor on the result.
    pub exposure: f64,
    /// Reads per pixel.
    pub samples: u32,
    /// Part of the way to the sun that the reads span.
    #[serde(default = "whole")]
    pub reach: f64,
    /// Weight of the pixel's own read beside the sum, which does not decay; 0 in the published Perlin-FBM engine. Where it is not 0, the sum
    /// begins one read farther, as in the book.
    #[serde(default)]
    pub centre: f64,
    /// Whether they stay as they are when the sun stands beside or behind the camera, where its point on the screen is a mirrored one;
    /// else they fade out before.
    pub from_behind: bool,
}

impl Default for GodRays {
    /// The published engine's.
    fn default() -> Self {
        Self {
            density: 0.96,
            decay: 0.95,
            weight: 0.5,
            exposure: 0.6,
            samples: 100,
            reach: 1.0,
            centre: 0.0,
            from_behind: false,
        }
    }
}

fn whole() -> f64 {
    1.0
}

/// A picture of one channel, top row first.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Row by row from the top.
    pub pixels: Vec<f64>,
}

impl Layer {
    /// Bilinear read at a place in texels from the centre of the top-left one, x to the right and y down; outside is the nearest texel.
    pub fn sample(&self, place: [f64; 2]) -> f64 {
        let sizes = [self.width, self.height];
        let ends: [[usize; 2]; 2] = std::array::from_fn(|axis| {
            let last = (sizes[axis] - 1) as f64;
            [0.0, 1.0].map(|step| (place[axis].floor() + step).clamp(0.0, last) as usize)
        });
        let [x, y] = place.map(|coordinate| coordinate - coordinate.floor());
        let at = |column: usize, row: usize| self.pixels[ends[1][row] * self.width + ends[0][column]];
        let along = |row: usize| at(0, row) * (1.0 - x) + at(1, row) * x;
        along(0) * (1.0 - y) + along(1) * y
    }
}

/// Size of the occlusion picture: half of the frame's, rounded down, and at least 1.
pub fn half([width, height]: [usize; 2]) -> [usize; 2] {
    [width, height].map(|side| (side / 2).max(1))
}

/// Pixels along an axis of `full` pixels that the texel `index` of `half` texels covers: the first one, and the share of the texel that
/// it and the two after it are. For half of an even size that is a half and a half.
fn covered(index: usize, half: usize, full: usize) -> (usize, [f64; 3]) {
    // In parts of a pixel, `half` of them: everything is whole.
    let (begin, end) = (index * full, (index + 1) * full);
    let first = begin / half;
    let shares = [0, 1, 2].map(|step| {
        let pixel = first + step;
        let overlap = ((pixel + 1) * half).min(end).saturating_sub((pixel * half).max(begin));
        overlap as f64 / full as f64
    });
    (first, shares)
}

impl GodRays {
    /// Number of the first read on the way to the sun.
    fn first(&self) -> f64 {
        if self.centre == 0.0 { 0.0 } else { 1.0 }
    }

    /// The rays that an occlusion picture makes, before the sun's colour. `sun` is the sun's place in its texels, as [`Layer::sample`]
    /// counts them.
    pub fn render(&self, occlusion: &Layer, sun: [f64; 2]) -> Layer {
        let pixels = (0..occlusion.pixels.len())
            .into_par_iter()
            .map(|index| {
                let own = [(index % occlusion.width) as f64, (index / occlusion.width) as f64];
                let mut sum = if self.centre == 0.0 { 0.0 } else { self.centre * occlusion.pixels[index] };
                let mut weight = self.weight;
                for number in 0..self.samples {
                    let part = self.reach * (f64::from(number) + self.first()) / f64::from(self.samples);
                    sum += weight * occlusion.sample([0, 1].map(|axis| own[axis] + part * (sun[axis] - own[axis])));
                    weight *= self.decay;
                }
                self.density * self.exposure * sum
            })
            .collect();
        Layer { width: occlusion.width, height: occlusion.height, pixels }
    }
}

/// The place of a point in device coordinates, -1 to 1 from left to right and from bottom to top, in texels of a layer.
pub fn texel_of(device: [f64; 2], [width, height]: [usize; 2]) -> [f64; 2] {
    let [u, v] = device.map(|coordinate| (coordinate + 1.0) / 2.0);
    [u * width as f64 - 0.5, (1.0 - v) * height as f64 - 0.5].map(|texel| texel.clamp(-FARTHEST, FARTHEST))
}

/// God rays of every sun, added to a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GodRayPass {
    /// How the blur is made.
    pub rays: GodRays,
    /// What of the transmittance counts as seen through.
    pub compositing: Compositing,
}

/// What of a sun counts for a frame.
struct Shining {
    /// Where the camera's rays go.
    plane: RasterPlane,
    /// Its place in device coordinates.
    device: DVec2,
    /// Unit vector to the middle of its glow.
    glow: DVec3,
    /// Colour, over its brightest channel, times fade and the film's exposure.
    colour: [f64; 3],
}

impl GodRayPass {
    /// The suns that shine on a frame, one after the other. An error in a panorama, where there is any.
    fn suns(&self, size: [u32; 2], view: &View<'_>) -> Result<Vec<Shining>> {
        let mut shining = Vec::new();
        for sun in view.suns {
            let brightest = sun.brightest();
            if brightest == 0.0 {
                continue;
            }
            let place = view.centre + sun.towards() * (SUN_DISTANCE * view.side);
            let (Some(plane), Some((device, cosine))) = (view.camera.plane(), view.camera.device_coordinates(place))
            else {
                return Err(Error::new(
                    "$.camera.projection",
                    "a panorama",
                    "a picture on a plane: god rays are straight there only",
                    "Leave the god rays out, or take another camera.",
                )
                .with_setting("god_rays"));
            };
            let fade = if self.rays.from_behind { 1.0 } else { smooth(0.0, FADE, cosine) };
            // The ray through the sun's point, which leads away from a sun behind the camera. Parallel rays know no point.
            let raster = (device + 1.0) / 2.0 * DVec2::from(size.map(f64::from));
            let glow = if plane.is_parallel() { sun.towards() } else { plane.direction(raster) };
            // A sun in the image plane itself has no point on the screen.
            if fade != 0.0 && device.is_finite() && glow.is_finite() {
                let colour = sun.irradiance.map(|channel| channel / brightest * fade * view.exposure);
                shining.push(Shining { plane, device, glow, colour });
            }
        }
        Ok(shining)
    }

    /// The glow of a sun times what the medium lets through, at half the resolution.
    fn occlusion(&self, frame: &Image, transmittance: &[[f32; 3]], sun: &Shining) -> Layer {
        let [width, height] = half([frame.width, frame.height]);
        let pixels = (0..width * height)
            .map(|index| {
                let (column, row) = (index % width, index / width);
                let (left, across) = covered(column, width, frame.width);
                let (top, down) = covered(row, height, frame.height);
                let mut through = 0.0;
                for (y, down) in (top..).zip(down).filter(|(_, share)| *share > 0.0) {
                    for (x, across) in (left..).zip(across).filter(|(_, share)| *share > 0.0) {
                        let seen = self.compositing.through(transmittance[y * frame.width + x].map(f64::from));
                        through += across * down * seen;
                    }
                }
                let raster = DVec2::new(
                    (column as f64 + 0.5) / width as f64 * frame.width as f64,
                    (1.0 - (row as f64 + 0.5) / height as f64) * frame.height as f64,
                );
                through * smooth(SUN_GLOW, 0.0, sun.plane.direction(raster).distance(sun.glow))
            })
            .collect();
        Layer { width, height, pixels }
    }
}

impl Pass for GodRayPass {
    fn id(&self) -> &'static str {
        "god-rays"
    }

    fn settings(&self) -> String {
        json(&self.rays)
    }

    fn needs(&self) -> Channels {
        Channels { transmittance: true }
    }

    fn run(&self, frame: &mut Image, view: &View<'_>) -> Result<()> {
        let size = [frame.width, frame.height];
        let suns = self.suns(size.map(|side| side as u32), view)?;
        let transmittance = frame.transmittance.take().ok_or_else(|| missing(self.id()))?;
        let [width, height] = half(size);
        let scale = [width as f64 / frame.width as f64, height as f64 / frame.height as f64];
        for sun in suns {
            let occlusion = self.occlusion(frame, &transmittance, &sun);
            let rays = self.rays.render(&occlusion, texel_of(sun.device.to_array(), [width, height]));
            for (index, pixel) in frame.pixels.iter_mut().enumerate() {
                let place = [index % size[0], index / size[0]];
                let found = rays.sample([0, 1].map(|axis| (place[axis] as f64 + 0.5) * scale[axis] - 0.5));
                for channel in 0..3 {
                    pixel[channel] = (f64::from(pixel[channel]) + sun.colour[channel] * found) as f32;
                }
            }
        }
        frame.transmittance = Some(transmittance);
        Ok(())
    }

    fn compile<'a>(&self, gpu: &'a Gpu) -> Compiling<'a> {
        let pass = *self;
        Box::pin(async move {
            let kernel: Box<dyn PassKernel + 'a> = Box::new(GodRayKernel::new_async(gpu, pass).await?);
            Ok(kernel)
        })
    }
}

shader_struct! {
    /// Uniforms of the kernels.
    struct GodRayUniform = "GodRays" {
        corner: [f32; 3],
        width: u32,
        across: [f32; 3],
        height: u32,
        up: [f32; 3],
        half_width: u32,
        glow: [f32; 3],
        half_height: u32,
        colour: [f32; 3],
        samples: u32,
        sun: [f32; 2],
        scale: [f32; 2],
        inverse_samples: f32,
        weight: f32,
        decay: f32,
        gain: f32,
        sun_glow: f32,
        first: u32,
        count: u32,
        centre: f32,
    }
}

/// God rays on the adapter: three kernels, over two layers at half the resolution that are made when a frame comes.
pub struct GodRayKernel<'a> {
    gpu: &'a Gpu,
    pass: GodRayPass,
    occlusion: ComputeKernel,
    blur: ComputeKernel,
    add: ComputeKernel,
}

impl<'a> GodRayKernel<'a> {
    /// Compiles it.
    pub async fn new_async(gpu: &'a Gpu, pass: GodRayPass) -> Result<Self> {
        let source = include_str!("../../../shaders/engines/passes/god_rays.wgsl");
        let kernel = async |label: &str, definitions: &[&str]| {
            let module = Linker::bare().link_with("engines/passes/god_rays.wgsl", source, definitions)?;
            gpu.kernel_async(label, &module, &[Layout::of::<GodRayUniform>()]).await
        };
        let of_red: &[&str] =
            if pass.compositing.alpha_of_red { &["OCCLUSION", "ALPHA_OF_RED"] } else { &["OCCLUSION"] };
        Ok(Self {
            gpu,
            pass,
            occlusion: kernel("god_ray_occlusion", of_red).await?,
            blur: kernel("god_ray_blur", &["BLUR"]).await?,
            add: kernel("god_ray_add", &[]).await?,
        })
    }

    /// [`Self::new_async`] for callers that may wait.
    pub fn new(gpu: &'a Gpu, pass: GodRayPass) -> Result<Self> {
        gpu.block_on(Self::new_async(gpu, pass))?
    }

    /// Uniforms that no sun changes.
    fn uniform(&self, [half_width, half_height]: [usize; 2]) -> GodRayUniform {
        let GodRays { density, decay, weight, exposure, samples, reach, centre, .. } = self.pass.rays;
        GodRayUniform {
            half_width: half_width as u32,
            half_height: half_height as u32,
            samples,
            inverse_samples: (reach / f64::from(samples)) as f32,
            centre: centre as f32,
            weight: weight as f32,
            decay: decay as f32,
            gain: (density * exposure) as f32,
            sun_glow: SUN_GLOW as f32,
            ..bytemuck::Zeroable::zeroed()
        }
    }

    /// A layer on the adapter: `array<f32>`.
    fn layer(&self, [width, height]: [usize; 2]) -> wgpu::Buffer {
        self.gpu.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some("god rays"),
            size: (4 * width * height).max(16) as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        })
    }

    /// Submits a kernel over texels or pixels, `each` reads for each of them.
    fn submit(
        &self,
        kernel: &ComputeKernel,
        uniform: GodRayUniform,
        total: u32,
        each: u32,
        buffers: &[(u32, &wgpu::Buffer)],
    ) -> Result<()> {
        let group = kernel.workgroup()[0];
        let groups =
            (READS / each.max(1) / group).clamp(1, self.gpu.device().limits().max_compute_workgroups_per_dimension);
        for first in (0..total).step_by((groups * group) as usize) {
            let count = (groups * group).min(total - first);
            let uniform = GodRayUniform { first, count, ..uniform };
            let uniform = self.gpu.upload("god rays", bytemuck::bytes_of(&uniform), wgpu::BufferUsages::UNIFORM);
            let mut bindings = Bindings::new().group(0, [&uniform]);
            for (binding, buffer) in buffers {
                bindings = bindings.bind(0, *binding, buffer.as_entire_binding());
            }
            self.gpu.dispatch(kernel, &bindings, [count, 1, 1])?;
        }
        Ok(())
    }

    /// Submits the blur of an occlusion picture, `array<f32>`, towards a sun in device coordinates: what [`GodRays::render`] gives, on
    /// the adapter. Waits for nothing.
    pub fn blur(&self, occlusion: &wgpu::Buffer, size: [usize; 2], device: [f64; 2]) -> Result<wgpu::Buffer> {
        let rays = self.layer(size);
        let uniform = GodRayUniform { sun: texel_of(device, size).map(|texel| texel as f32), ..self.uniform(size) };
        let texels = (size[0] * size[1]) as u32;
        self.submit(&self.blur, uniform, texels, self.pass.rays.samples, &[(1, occlusion), (2, &rays)])?;
        Ok(rays)
    }
}

impl PassKernel for GodRayKernel<'_> {
    fn run(&self, frame: &Frame, view: &View<'_>) -> Result<()> {
        let size = [frame.width, frame.height];
        let suns = self.pass.suns(size, view)?;
        let transmittance = frame.needed_transmittance(self.pass.id())?;
        let half = half(size.map(|side| side as usize));
        let single = |vector: DVec3| vector.as_vec3().to_array();
        for sun in suns {
            let uniform = GodRayUniform {
                corner: single(sun.plane.corner),
                width: frame.width,
                across: single(sun.plane.across),
                height: frame.height,
                up: single(sun.plane.up),
                glow: single(sun.glow),
                colour: sun.colour.map(|channel| channel as f32),
                scale: std::array::from_fn(|axis| (half[axis] as f64 / f64::from(size[axis])) as f32),
                ..self.uniform(half)
            };
            let occlusion = self.layer(half);
            let texels = (half[0] * half[1]) as u32;
            self.submit(&self.occlusion, uniform, texels, 9, &[(2, &occlusion), (4, transmittance)])?;
            let rays = self.blur(&occlusion, half, sun.device.to_array())?;
            self.submit(&self.add, uniform, frame.pixels(), 4, &[(1, &rays), (3, &frame.colour)])?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_of_the_half_cover_every_pixel_once() {
        for full in 1..40 {
            let [half, _] = half([full, 1]);
            assert_eq!(half, if full == 1 { 1 } else { full / 2 });
            let mut sums = vec![0.0; full];
            for index in 0..half {
                let (first, shares) = covered(index, half, full);
                assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-15, "{full}: {shares:?}");
                for (pixel, share) in (first..).zip(shares).filter(|(_, share)| *share > 0.0) {
                    sums[pixel] += share * full as f64 / half as f64;
                }
                if full == 2 * half {
                    assert_eq!((first, shares), (2 * index, [0.5, 0.5, 0.0]));
                }
            }
            assert!(sums.iter().all(|sum| (sum - 1.0).abs() < 1e-14), "{full}: {sums:?}");
        }
    }

    #[test]
    fn a_layer_is_read_between_its_texels_and_held_beyond_them() {
        let layer = Layer { width: 3, height: 2, pixels: vec![0.0, 1.0, 4.0, 10.0, 20.0, 40.0] };
        assert_eq!(layer.sample([1.0, 1.0]), 20.0);
        assert_eq!(layer.sample([0.5, 0.5]), (0.0 + 1.0 + 10.0 + 20.0) / 4.0);
        assert_eq!(layer.sample([-7.0, 1e30]), 10.0);
        assert_eq!(layer.sample([2.25, -0.5]), 4.0);
        // The corners of the screen are the corners of the outermost texels.
        assert_eq!(texel_of([-1.0, 1.0], [3, 2]), [-0.5, -0.5]);
        assert_eq!(texel_of([1.0, -1.0], [3, 2]), [2.5, 1.5]);
        assert_eq!(texel_of([f64::MAX, 0.0], [3, 2])[0], FARTHEST);
    }
}
