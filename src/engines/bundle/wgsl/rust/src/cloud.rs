//! A cloud as a bundle of cloudparity has it, in wgpu: three kernels that are dispatched one after the other, and numbers that change at run time.
//!
//! [`Cloud::submit`] is for a program that has a device of its own and wants the colours in a buffer, such as a render graph's node.

use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

type Failure = Box<dyn std::error::Error>;

/// Bytes of a ray, and of what it comes to.
const RAY: u64 = 64;
const PIXEL: u64 = 32;

/// A kernel with its uniform.
struct Kernel {
    pipeline: wgpu::ComputePipeline,
    workgroup: u32,
    bytes: usize,
    /// Name, place, whether it is a whole number, numbers.
    fields: Vec<(String, usize, bool, Vec<f64>)>,
    /// Group, binding, role and content of its storage buffers.
    bindings: Vec<(u32, u32, String, Option<wgpu::Buffer>)>,
}

/// A cloud on a device.
pub struct Cloud {
    resolution: [u32; 2],
    rays_together: u32,
    steps_together: u32,
    /// Of the camera, the march, compositing.
    kernels: BTreeMap<String, Kernel>,
    /// Names and values of the parameters of the density.
    density: Vec<(String, f32)>,
}

impl Cloud {
    /// Reads a folder.
    pub fn load(folder: &Path, device: &wgpu::Device, queue: &wgpu::Queue) -> Result<Self, Failure> {
        let read = |name: &str| {
            let path = folder.join(name);
            std::fs::read(&path).map_err(|cause| format!("{}: {cause}", path.display()))
        };
        let manifest: Value = serde_json::from_slice(&read("bundle.json")?)?;
        if manifest["format"] != "cloudparity bundle 1" {
            return Err("bundle.json is no \"cloudparity bundle 1\"".into());
        }
        let mut kernels = BTreeMap::new();
        for kernel in list(&manifest["kernels"]) {
            let name = text(&kernel["name"]);
            let source = String::from_utf8(read(&text(&kernel["file"]))?)?;
            let source = wgpu::ShaderSource::Wgsl(source.into());
            let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(&name), source });
            let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(&name),
                layout: None,
                module: &module,
                entry_point: Some("main"),
                compilation_options: Default::default(),
                cache: None,
            });
            let fields = list(&kernel["uniform"]).iter().map(|field| {
                let values = list(&field["values"]).iter().filter_map(Value::as_f64).collect();
                (text(&field["name"]), whole(&field["offset"]) as usize, field["kind"] == "u32", values)
            });
            let mut bindings = Vec::new();
            for binding in list(&kernel["bindings"]) {
                let content = match binding["file"].as_str() {
                    Some(file) => {
                        let bytes = read(file)?;
                        let kind = match binding["role"] == "density" {
                            true => wgpu::BufferUsages::UNIFORM,
                            false => wgpu::BufferUsages::STORAGE,
                        };
                        let usage = kind | wgpu::BufferUsages::COPY_DST;
                        let made = buffer(device, bytes.len() as u64, usage);
                        queue.write_buffer(&made, 0, &bytes);
                        Some(made)
                    }
                    None => None,
                };
                bindings.push((whole(&binding["group"]), whole(&binding["binding"]), text(&binding["role"]), content));
            }
            let fields = fields.collect();
            let (workgroup, bytes) = (whole(&kernel["workgroup"]), whole(&kernel["bytes"]) as usize);
            kernels.insert(name, Kernel { pipeline, workgroup, bytes, fields, bindings });
        }
        let side = |index: usize| whole(&manifest["resolution"][index]);
        let of_density = |one: &Value| (text(&one["field"]), one["value"].as_f64().unwrap_or_default() as f32);
        Ok(Self {
            resolution: [side(0), side(1)],
            rays_together: whole(&manifest["rays_together"]).max(1),
            steps_together: whole(&manifest["steps_together"]).max(1),
            kernels,
            density: list(&manifest["density"]).iter().map(of_density).collect(),
        })
    }

    /// Width and height.
    pub fn resolution(&self) -> [u32; 2] {
        self.resolution
    }

    /// The numbers of a field of a kernel's uniform, to be read and changed; bundle.json names them.
    pub fn number(&mut self, kernel: &str, field: &str) -> Option<&mut Vec<f64>> {
        let fields = &mut self.kernels.get_mut(kernel)?.fields;
        fields.iter_mut().find(|one| one.0 == field).map(|one| &mut one.3)
    }

    /// Names and values of the parameters of the density; bundle.json says what they are.
    pub fn density(&self) -> &[(String, f32)] {
        &self.density
    }

    /// Changes one of them; an error where there is none of the name.
    pub fn set_density(&mut self, queue: &wgpu::Queue, name: &str, value: f32) -> Result<(), Failure> {
        let one = self.density.iter_mut().find(|one| one.0 == name);
        one.ok_or_else(|| format!("the bundle has no parameter {name}"))?.1 = value;
        let bytes: Vec<u8> = self.density.iter().flat_map(|one| one.1.to_le_bytes()).collect();
        let march = self.kernels.get("march").ok_or("bundle.json has no march")?;
        for (_, _, role, content) in &march.bindings {
            if let Some(buffer) = content.as_ref().filter(|_| role == "density") {
                queue.write_buffer(buffer, 0, &bytes);
            }
        }
        // Which cells may hold something is no longer known.
        if let Some(everywhere) = self.number("march", "everywhere") {
            *everywhere = vec![1.0];
        }
        Ok(())
    }

    /// Submits the dispatches that draw the picture into a storage buffer of four floats a pixel, from the top-left corner.
    pub fn submit(&self, device: &wgpu::Device, queue: &wgpu::Queue, colour: &wgpu::Buffer) -> Result<(), Failure> {
        let total = self.resolution[0] * self.resolution[1];
        let together = self.rays_together.min(total);
        let storage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let rays = buffer(device, u64::from(together) * RAY, storage);
        let march = self.kernels.get("march").ok_or("bundle.json has no march")?;
        let steps = march.fields.iter().find(|field| field.0 == "steps").map_or(0, |field| field.3[0] as u32);
        for first in (0..total).step_by(together as usize) {
            let count = together.min(total - first);
            // Zero when it is made: a march goes on from what its pixels hold.
            let pixels = buffer(device, u64::from(together) * PIXEL, storage);
            let given = |role: &str| match role {
                "rays" => Some(&rays),
                "pixels" => Some(&pixels),
                "colour" => Some(colour),
                _ => None,
            };
            let run = |name: &str, changed: &[(&str, u32)]| -> Result<(), Failure> {
                let kernel = self.kernels.get(name).ok_or_else(|| format!("bundle.json has no {name}"))?;
                kernel.submit(device, queue, changed, count, given)
            };
            run("camera", &[("first", first), ("count", count)])?;
            for begin in (0..steps).step_by(self.steps_together as usize) {
                let end = begin.saturating_add(self.steps_together);
                run("march", &[("count", count), ("first_step", begin), ("end_step", end)])?;
            }
            run("compose", &[("first", first), ("count", count), ("rays", 1), ("begin", 0)])?;
        }
        Ok(())
    }

    /// Draws the picture and reads it back: linear colours and alpha, from the top-left corner.
    pub fn draw(&self, device: &wgpu::Device, queue: &wgpu::Queue) -> Result<Vec<[f32; 4]>, Failure> {
        let size = 16 * u64::from(self.resolution[0]) * u64::from(self.resolution[1]);
        let colour = buffer(device, size, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
        self.submit(device, queue, &colour)?;
        let back = buffer(device, size, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
        let mut encoder = device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(&colour, 0, &back, 0, size);
        queue.submit([encoder.finish()]);
        let (sender, receiver) = std::sync::mpsc::channel();
        back.slice(..).map_async(wgpu::MapMode::Read, move |result| sender.send(result).unwrap_or_default());
        device.poll(wgpu::PollType::wait_indefinitely())?;
        receiver.recv()??;
        let bytes = back.slice(..).get_mapped_range()?;
        let float = |bytes: &[u8]| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        let pixel = |bytes: &[u8]| std::array::from_fn(|channel| float(&bytes[4 * channel..]));
        Ok(bytes.chunks_exact(16).map(pixel).collect())
    }
}

impl Kernel {
    fn submit<'a>(
        &'a self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        changed: &[(&str, u32)],
        count: u32,
        given: impl Fn(&str) -> Option<&'a wgpu::Buffer>,
    ) -> Result<(), Failure> {
        let mut bytes = vec![0_u8; self.bytes];
        for (name, place, is_whole, values) in &self.fields {
            let own = changed.iter().find(|one| one.0 == name).map(|one| [f64::from(one.1)]);
            for (index, &value) in own.as_ref().map_or(values.as_slice(), |own| own).iter().enumerate() {
                let word = if *is_whole { (value as u32).to_le_bytes() } else { (value as f32).to_le_bytes() };
                bytes[place + 4 * index..place + 4 * index + 4].copy_from_slice(&word);
            }
        }
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let uniform = buffer(device, bytes.len() as u64, usage);
        queue.write_buffer(&uniform, 0, &bytes);
        let mut entries: BTreeMap<u32, Vec<wgpu::BindGroupEntry<'_>>> = BTreeMap::new();
        let own = wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() };
        entries.entry(0).or_default().push(own);
        for (group, binding, role, content) in &self.bindings {
            let bound = content.as_ref().or_else(|| given(role)).ok_or_else(|| format!("no buffer for {role}"))?;
            let entry = wgpu::BindGroupEntry { binding: *binding, resource: bound.as_entire_binding() };
            entries.entry(*group).or_default().push(entry);
        }
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&self.pipeline);
            for (group, entries) in &entries {
                let layout = &self.pipeline.get_bind_group_layout(*group);
                let descriptor = wgpu::BindGroupDescriptor { label: None, layout, entries };
                pass.set_bind_group(*group, &device.create_bind_group(&descriptor), &[]);
            }
            pass.dispatch_workgroups(count.div_ceil(self.workgroup), 1, 1);
        }
        queue.submit([encoder.finish()]);
        Ok(())
    }
}

fn buffer(device: &wgpu::Device, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or_default().to_owned()
}

fn whole(value: &Value) -> u32 {
    value.as_u64().unwrap_or_default() as u32
}
