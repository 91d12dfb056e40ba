//! Evaluating a program at points on the adapter.

use crate::base::error::{Error, Result};
use crate::gpu::exact::{EXACT, REACHED};
use crate::gpu::{Bindings, ComputeKernel, Gpu};
use crate::graph::Program;
use crate::graph::evaluate::Points;
use crate::graph::wgsl::Linker;
use std::fmt::Write;

/// Invocations per workgroup.
const WORKGROUP: u32 = 64;

/// Points per submission: on a software adapter well below a tenth of a second for the cloud.
const SOFTWARE_SLICE: usize = 1 << 16;

/// Points per submission of hardware: several for each of its lanes.
const SLICE: usize = 1 << 21;

/// A program compiled for the adapter.
pub struct FieldKernel<'a> {
    gpu: &'a Gpu,
    kernel: ComputeKernel,
    attributes: Vec<String>,
    components: usize,
    /// Textures of the program.
    textures: Option<wgpu::Buffer>,
}

impl Gpu {
    /// Compiles a program for evaluation at points, with arithmetic that the driver leaves as it is written where it can be told to.
    pub fn field(&self, program: &Program) -> Result<FieldKernel<'_>> {
        let widths: Vec<usize> = program.outputs.iter().map(|output| output.operands.len()).collect();
        let mut linker = Linker::new(program)?;
        let textures = self.upload_textures(linker.textures())?;
        // The processor's quotients and roots round to the nearest.
        let stands_in = self.has_exact_kernels() && !self.adapter().is_software();
        if stands_in {
            linker.add(EXACT.0, EXACT.1);
        }
        let module = linker.link("generated/field.wgsl", &entry(program.attributes.len(), &widths, stands_in))?;
        Ok(FieldKernel {
            gpu: self,
            kernel: self.exact_kernel("field", &module, &[])?,
            attributes: program.attributes.clone(),
            components: program.output_components(),
            textures,
        })
    }
}

/// The entry text, by the number of attributes and the components of each output: positions and attributes lie one after the other,
/// point by point. It may have functions that stand in for quotients and roots.
fn entry(attributes: usize, outputs: &[usize], stands_in: bool) -> String {
    let inputs = 3 + 3 * attributes;
    let width: usize = outputs.iter().sum();
    let mut text = String::from(if stands_in { "#import cloudparity::exact\n" } else { "" });
    text.push_str(
        "#import cloudparity::graph\n\n\
         @group(0) @binding(0) var<storage, read> points: array<f32>;\n\
         @group(0) @binding(1) var<storage, read_write> results: array<f32>;\n\n",
    );
    let mut line = |parts: std::fmt::Arguments<'_>| {
        writeln!(text, "{parts}").expect("writing to a string cannot fail");
    };
    line(format_args!("@compute @workgroup_size({WORKGROUP})"));
    line(format_args!("fn main(@builtin(global_invocation_id) invocation: vec3u) {{"));
    line(format_args!("    let index = invocation.x;"));
    line(format_args!("    if index >= arrayLength(&points) / {inputs}u {{ return; }}"));
    let vectors: Vec<String> = (0..inputs / 3)
        .map(|vector| {
            let at = |axis: usize| format!("points[{inputs}u * index + {}u]", 3 * vector + axis);
            format!("vec3f({}, {}, {})", at(0), at(1), at(2))
        })
        .collect();
    if stands_in {
        line(format_args!("    if index == 0xffffffffu {{ {REACHED} }}"));
    }
    line(format_args!("    let value = graph::evaluate({});", vectors.join(", ")));
    let mut component = 0;
    for (number, &components) in outputs.iter().enumerate() {
        let value = if outputs.len() == 1 { "value".to_owned() } else { format!("value.o{number}v") };
        for axis in 0..components {
            let part = if components == 1 { "" } else { [".x", ".y", ".z"][axis] };
            line(format_args!("    results[{width}u * index + {component}u] = {value}{part};"));
            component += 1;
        }
    }
    line(format_args!("}}"));
    text
}

impl FieldKernel<'_> {
    /// Evaluates every output at every point: the components of all outputs, point by point.
    pub fn evaluate(&self, points: Points<'_>) -> Result<Vec<f32>> {
        let mut columns: Vec<&[[f32; 3]]> = vec![points.positions];
        for name in &self.attributes {
            let found = points.attributes.iter().find(|(given, _)| given == name);
            let values =
                found.map(|(_, values)| values.as_slice()).filter(|values| values.len() == points.positions.len());
            columns.push(values.ok_or_else(|| {
                Error::new(
                    format!("attribute {name}"),
                    "no values, or not one per point",
                    "three numbers per point",
                    "Give as many attribute values as points.",
                )
            })?);
        }
        let mut results = Vec::with_capacity(points.positions.len() * self.components);
        let slice = if self.gpu.adapter().is_software() { SOFTWARE_SLICE } else { SLICE };
        for start in (0..points.positions.len()).step_by(slice) {
            let count = slice.min(points.positions.len() - start);
            let mut data: Vec<f32> = Vec::with_capacity(count * columns.len() * 3);
            for index in start..start + count {
                columns.iter().for_each(|column| data.extend(column[index]));
            }
            results.extend(self.slice(&data, count)?);
        }
        Ok(results)
    }

    fn slice(&self, data: &[f32], count: usize) -> Result<Vec<f32>> {
        let gpu = self.gpu;
        let points = gpu.upload("points", bytemuck::cast_slice(data), wgpu::BufferUsages::STORAGE);
        // A signalling pattern: a cell that no invocation wrote is seen, not taken for a zero.
        let unwritten = vec![f32::from_bits(0x7FA0_0BAD); count * self.components];
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let results = gpu.upload("results", bytemuck::cast_slice(&unwritten), usage);
        let bindings = Bindings::new()
            .bind(0, 0, bound(&points, data.len()))
            .bind(0, 1, bound(&results, unwritten.len()))
            .group(1, &self.textures);
        gpu.dispatch(&self.kernel, &bindings, [count as u32, 1, 1])?;
        let bytes = gpu.read_back(&results, (unwritten.len() * 4) as u64)?;
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }
}

/// Exactly `floats` numbers of a buffer, so that `arrayLength` counts them and no padding.
fn bound(buffer: &wgpu::Buffer, floats: usize) -> wgpu::BindingResource<'_> {
    wgpu::BindingResource::Buffer(wgpu::BufferBinding {
        buffer,
        offset: 0,
        size: std::num::NonZeroU64::new(4 * floats as u64),
    })
}
