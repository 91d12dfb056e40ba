//! The bake of the Perlin-FBM cloud on the adapter.

use crate::base::error::Result;
use crate::base::texture::Outside;
use crate::gpu::{Bindings, ComputeKernel, Gpu, Layout};
use crate::graph::wgsl::Linker;
use crate::nodes::perlin_fbm::Volume;
use crate::nodes::perlin_fbm::bake::{Bake, MOST_OCTAVES};
use crate::nodes::perlin_fbm::random::permutation;
use crate::nodes::perlin_fbm::rows::Tables;
use crate::shader_struct;

/// Texels of an invocation, one behind the other.
const DEPTH: usize = 4;

/// Noises per submission: some 40 ms on a software adapter.
const NOISES: usize = 1 << 21;

/// Bytes of a uniform buffer that every adapter allows.
const UNIFORM_BYTES: usize = 1 << 16;

shader_struct! {
    /// Uniforms of `shaders/engines/perlin_fbm/bake.wgsl`.
    struct BakeUniform = "Bake" {
        side: u32,
        octaves: u32,
        first: u32,
        count: u32,
        low: f32,
        width: f32,
        intensity: f32,
        padding: u32,
    }
}

/// The kernel of the bake.
pub struct BakeKernel<'a> {
    gpu: &'a Gpu,
    /// With the tables of the axes in a uniform buffer, and in storage, for those that do not fit.
    kernels: [ComputeKernel; 2],
}

impl<'a> BakeKernel<'a> {
    /// Compiles it.
    pub fn new(gpu: &'a Gpu) -> Result<Self> {
        let source = include_str!("../../../shaders/engines/perlin_fbm/bake.wgsl");
        let kernel = |definitions: &[&str]| {
            let module = Linker::bare().link_with("engines/perlin_fbm/bake.wgsl", source, definitions)?;
            gpu.kernel("perlin_fbm_bake", &module, &[Layout::of::<BakeUniform>()])
        };
        Ok(Self { gpu, kernels: [kernel(&[])?, kernel(&["LARGE_AXES"])?] })
    }

    /// The texture of `side` texels per axis, in single precision over tables of double: texels whose value lies within its rounding of a
    /// byte's edge may differ by 1 from [`Bake::volume`].
    pub fn volume(&self, bake: &Bake, side: usize) -> Result<Volume> {
        bake.check_side(side)?;
        let table = permutation(bake.seed);
        let tables = Tables::<f64>::new(&bake.waves(), &table, side);
        // Words, not floats: a small number's bits are those of a denormal, which an adapter may take for 0.
        let mut axes: Vec<[u32; 2]> = Vec::new();
        for axis in tables.axes.iter().flatten() {
            let places = axis.fractions.iter().zip(&axis.cells);
            axes.extend(places.map(|(&fraction, &cell)| [(fraction as f32).to_bits(), cell as u32]));
        }
        // Coordinates beyond all numbers: what the CPU gives is no number, and its byte is 0.
        if axes.iter().any(|&[fraction, _]| f32::from_bits(fraction).is_nan()) {
            return Ok(Volume::new(side, vec![0; side.pow(3)], Outside::Repeat));
        }
        let pairs: Vec<u8> =
            (0..1 << 16).map(|index| table[(usize::from(table[index & 255]) + (index >> 8)) & 255]).collect();
        let amplitudes: Vec<f32> =
            tables.amplitudes.iter().map(|&amplitude| (amplitude / tables.amplitude_sum) as f32).collect();
        let gradients = tables.last.map(|gradient| {
            let gradient = u32::from(gradient);
            let first_is_x = u32::from(gradient < 8);
            let second = match gradient {
                0..4 => 2,
                12 | 14 => 4,
                _ => 0,
            };
            gradient << 31 | (gradient >> 1 & 1) << 30 | first_is_x | second
        });
        let storage = wgpu::BufferUsages::STORAGE;
        let all = side.pow(3);
        let output = self.gpu.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some("texels"),
            size: 4 * all as u64,
            usage: storage | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let uniform = wgpu::BufferUsages::UNIFORM;
        let are_large = axes.len() * 8 > UNIFORM_BYTES;
        // A uniform binding is as large as its declaration.
        let padded = |bytes: &[u8], size: usize| {
            let mut bytes = bytes.to_vec();
            bytes.resize(size.max(bytes.len()), 0);
            bytes
        };
        let axes = padded(bytemuck::cast_slice(&axes), UNIFORM_BYTES);
        let data = [
            self.gpu.upload("axes", &axes, if are_large { storage } else { uniform }),
            self.gpu.upload(
                "amplitudes",
                &padded(bytemuck::cast_slice(&amplitudes), 4 * MOST_OCTAVES as usize),
                uniform,
            ),
            self.gpu.upload("pairs", &pairs, uniform),
            self.gpu.upload("gradients", bytemuck::cast_slice(&gradients), uniform),
            output,
        ];
        let octaves = bake.octaves.count;
        let [low, high] = bake.threshold();
        let invocations = side * side * side.div_ceil(DEPTH);
        let kernel = &self.kernels[usize::from(are_large)];
        let most = (NOISES / (8 * DEPTH * octaves as usize)).next_multiple_of(kernel.workgroup()[0] as usize);
        for first in (0..invocations).step_by(most) {
            let count = most.min(invocations - first);
            let uniform = BakeUniform {
                side: side as u32,
                octaves,
                first: first as u32,
                count: count as u32,
                low: low as f32,
                // Nothing is divided by 0, however hard the threshold.
                width: ((high - low) as f32).max(f32::MIN_POSITIVE),
                intensity: bake.intensity as f32,
                padding: 0,
            };
            let uniform = self.gpu.upload("bake", bytemuck::bytes_of(&uniform), wgpu::BufferUsages::UNIFORM);
            let bindings = Bindings::new().group(0, std::iter::once(&uniform).chain(&data));
            self.gpu.dispatch(kernel, &bindings, [count as u32, 1, 1])?;
        }
        let [.., output] = &data;
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(&self.gpu.read_back(output, 4 * all as u64)?);
        Ok(Volume::new(side, words.into_iter().map(|word| word as u8).collect(), Outside::Repeat))
    }
}
