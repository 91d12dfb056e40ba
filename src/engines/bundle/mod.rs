//! A shader bundle: an engine in a scene as files that run without this program. Three kernels in plain WGSL (rays of a camera, the march,
//! compositing), what is in their buffers, and `bundle.json`, which says how they go together; a page in plain WebGPU runs them.
//!
//! The kernels are those of this program, with nothing of a scene left in them that it does not use. What they are given lies in uniforms by
//! name: a number is changed at run time, without compiling. [`Bundle::picture`] runs the files on an adapter as a host does, from the texts and
//! bytes that were written.

use crate::base::display_table::DisplayTable;
use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::texture;
use crate::engines::Engine;
use crate::engines::march::gpu::{Form, MarchParts, Pixel, Ray};
use crate::engines::march::{camera, camera::ViewUniform};
use crate::engines::passes::compositing::{self, Background, CompositeUniform};
use crate::engines::passes::{Channels, frame::Frame};
use crate::engines::render::EngineRenderer;
use crate::gpu::{Bindings, ComputeKernel, Gpu, Layout};
use crate::graph::wgsl::{self, Language, ProgramParameters};
use crate::scene::Scene;
use crate::scene::image::Image;
use run_time::RunTime;
use std::collections::BTreeMap;
use std::path::Path;

pub mod field;
pub mod languages;
pub mod manifest;
pub mod one_shader;
pub mod run_time;
pub mod targets;

pub use manifest::{Binding, CameraFrame, FORMAT, Field, Kernel, Manifest, Origin, Other, Shown};
use manifest::{Uniform, refuse_beyond_bundles, truth_of, write_into};

/// The file of the right picture.
const TRUTH: &str = "truth.bin";

/// Role and file of the parameters of the density.
const DENSITY: &str = "density";

/// The file of display values.
const DISPLAY: &str = "display.bin";

/// The page and its program, and a program in wgpu.
const HOSTS: [(&str, &str); 5] = [
    ("index.html", include_str!("wgsl/index.html")),
    ("host.js", include_str!("wgsl/host.js")),
    ("rust/Cargo.toml", include_str!("wgsl/rust/Cargo.toml")),
    ("rust/src/main.rs", include_str!("wgsl/rust/src/main.rs")),
    ("rust/src/cloud.rs", include_str!("wgsl/rust/src/cloud.rs")),
];

/// A bundle in memory.
pub struct Bundle {
    /// What `bundle.json` says.
    pub manifest: Manifest,
    /// The other files by name.
    pub files: BTreeMap<String, Vec<u8>>,
}

impl Bundle {
    /// The bundle of an engine in a scene: one ray per pixel, samples in the middle of their steps. An error where the engine needs what a
    /// bundle has not: passes over the picture, a domain that is no box, a picture of a world.
    pub fn new(scene: &Scene, engine: &Engine) -> Result<Self> {
        Self::with_parameters(scene, engine, None)
    }

    /// The same with parameters of the density that a host changes.
    pub fn with_parameters(scene: &Scene, engine: &Engine, run_time: Option<&RunTime>) -> Result<Self> {
        refuse_beyond_bundles(engine)?;
        let tuned = run_time.map(|run_time| run_time.engine(engine));
        let engine = tuned.as_ref().unwrap_or(engine);
        let renderer = EngineRenderer::new(scene, engine, None)?;
        let size = scene.image_size();
        let march = renderer.march_parts(&match run_time {
            Some(run_time) => Form::KernelWithParameters(&run_time.parameters),
            None => Form::Kernel,
        })?;
        let background = renderer.constant_background()?;
        let view = ViewUniform::new(renderer.camera(), &engine.container, size)?;
        let kind = background.map_or(Background::None, Background::Constant);
        let composite = CompositeUniform::over(background.unwrap_or_default(), scene.film.exposure);
        let mut files = BTreeMap::new();
        let mut kernel = |name: &str, module: &naga::Module, uniform: Uniform, contents: Vec<Content>| {
            kernel(&mut files, name, module, uniform, contents)
        };
        let no_gaps: [[f32; 2]; 2] = [[0.0; 2]; 2];
        let mut of_march = vec![
            Content::role(1, "rays"),
            Content::role(2, "pixels"),
            Content::bytes(0, 3, "suns", bytemuck::cast_slice(&march.suns)),
            Content::bytes(0, 4, "cells", bytemuck::cast_slice(&march.cells)),
            Content::bytes(0, 5, "gaps", bytemuck::cast_slice(&no_gaps)),
            Content::bytes(0, 6, "shadow-maps", bytemuck::cast_slice(&march.maps)),
        ];
        of_march.push(Content::bytes(1, 0, "textures", &texture::words_of(&march.textures)));
        if let Some(run_time) = run_time {
            of_march.push(Content::bytes(0, ProgramParameters::BINDING, DENSITY, &run_time.bytes()));
        }
        let kernels = [
            kernel("camera", &camera::module()?, Uniform::of(&view), vec![Content::role(1, "rays")])?,
            kernel("march", &march.module, Uniform::of(&march.uniform), of_march)?,
            kernel(
                "compose",
                &compositing::module(engine.compositing, &kind, Channels::default())?,
                Uniform::of(&composite),
                vec![Content::role(1, "pixels"), Content::role(2, "colour")],
            )?,
        ];
        for (name, text) in HOSTS {
            files.insert(name.into(), text.into());
        }
        let steps_together = march.together;
        let manifest = Manifest {
            format: FORMAT.into(),
            origin: Origin::of(scene, engine, &renderer),
            steps_together,
            rays_together: march.rays_together(steps_together) as u32,
            kernels,
            truth: None,
            display: None,
            presets: Vec::new(),
            density: run_time.map_or_else(Vec::new, |run_time| run_time.tunables.clone()),
        };
        Ok(Self { manifest, files })
    }

    /// The same for a page that shows colours through a table, or by the curve of sRGB without one, after an exposure in stops.
    pub fn with_display(mut self, exposure: f64, table: Option<&DisplayTable>) -> Self {
        if let Some(table) = table {
            self.files.insert(DISPLAY.into(), bytemuck::cast_slice(&table.words()).to_vec());
        }
        self.manifest.display = Some(Shown {
            view: table.map_or("Standard", DisplayTable::name).into(),
            exposure,
            file: table.map(|_| DISPLAY.into()),
            side: table.map_or(0, |table| table.side() as u32),
        });
        self
    }

    /// The same without a page of its own: one that a page of another bundle offers ([`Manifest::presets`]).
    pub fn without_hosts(mut self) -> Self {
        HOSTS.iter().for_each(|(name, _)| drop(self.files.remove(*name)));
        self
    }

    /// The same with the right picture of the scene beside it. An error where it has another size.
    pub fn with_truth(mut self, truth: &Image) -> Result<Self> {
        let floats = truth_of(self.manifest.origin.resolution, truth)?;
        self.files.insert(TRUTH.into(), floats);
        self.manifest.truth = Some(TRUTH.into());
        Ok(self)
    }

    /// Changes a parameter of the density, as hosts do while they run. An error where there is none of the field's name.
    pub fn set_density(&mut self, field: &str, value: f64) -> Result<()> {
        let missing = || {
            Error::new(format!("parameter {field}"), "no such field", "one that bundle.json names", "Correct the name.")
        };
        let place = self.manifest.density.iter().position(|one| one.field == field).ok_or_else(missing)?;
        let march = &mut self.manifest.kernels[1];
        let binding = march.bindings.iter().find(|binding| binding.role == DENSITY).ok_or_else(missing)?;
        let bytes = binding.file.as_ref().and_then(|file| self.files.get_mut(file)).ok_or_else(missing)?;
        bytes[4 * place..4 * place + 4].copy_from_slice(&(value as f32).to_le_bytes());
        // Which cells may hold something is no longer known.
        let everywhere = march.uniform.iter_mut().find(|one| one.name == "everywhere").ok_or_else(missing)?;
        everywhere.values = vec![1.0];
        Ok(())
    }

    /// Writes it into a folder, `bundle.json` last.
    pub fn write(&self, folder: &Path) -> Result<()> {
        write_into(folder, &self.files, &self.manifest, "bundle.json")
    }

    /// Reads it from a folder.
    pub fn load(folder: &Path) -> Result<Self> {
        let path = folder.join("bundle.json");
        let text = files::read_text(&path, "the manifest of a bundle")?;
        let manifest: Manifest = serde_json::from_str(&text).map_err(|cause| {
            let place = format!("{}, line {}", path.display(), cause.line());
            Error::new(place, cause.to_string(), "the manifest of a bundle", "Publish the scene again.")
        })?;
        if manifest.format != FORMAT {
            return Err(Error::new(
                path.display().to_string(),
                format!("format \"{}\"", manifest.format),
                format!("\"{FORMAT}\""),
                "Publish the scene again.",
            ));
        }
        let mut found = BTreeMap::new();
        for kernel in &manifest.kernels {
            for name in kernel.bindings.iter().filter_map(|binding| binding.file.as_ref()).chain([&kernel.file]) {
                let path = folder.join(name);
                let bytes = files::read_bytes(&path, "a file of the bundle")?;
                found.insert(name.clone(), bytes);
            }
        }
        Ok(Self { manifest, files: found })
    }

    /// The scene's picture, from the texts and bytes of the bundle alone.
    pub fn picture(&self, gpu: &Gpu) -> Result<Image> {
        self.ready(gpu)?.picture()
    }

    /// Compiled, with its data on the adapter: for pictures whose time is measured.
    pub fn ready<'a>(&'a self, gpu: &'a Gpu) -> Result<ReadyBundle<'a>> {
        let [camera, march, compose] = &self.manifest.kernels;
        let kernels = [
            self.compiled(gpu, camera, &camera::LAYOUTS)?,
            self.compiled(gpu, march, &MarchParts::LAYOUTS)?,
            self.compiled(gpu, compose, &compositing::LAYOUTS)?,
        ];
        let files = march.bindings.iter().filter_map(|binding| Some((binding, binding.file.as_ref()?)));
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::UNIFORM;
        let upload = |name: &String| gpu.upload(name, &self.files[name], usage);
        let held = files.map(|(binding, name)| ((binding.group, binding.binding), upload(name))).collect();
        Ok(ReadyBundle { bundle: self, gpu, kernels, held })
    }

    fn compiled(&self, gpu: &Gpu, kernel: &Kernel, layouts: &[Layout]) -> Result<ComputeKernel> {
        let text = String::from_utf8_lossy(&self.files[&kernel.file]);
        let module = naga::front::wgsl::parse_str(&text).map_err(|cause| {
            Error::new(
                format!("shader {}", kernel.file),
                cause.emit_to_string(&text),
                "a shader in WGSL",
                "Publish the scene again.",
            )
        })?;
        gpu.block_on(gpu.kernel_async(&kernel.name, &module, layouts))?
    }
}

/// A bundle on an adapter.
pub struct ReadyBundle<'a> {
    bundle: &'a Bundle,
    gpu: &'a Gpu,
    /// Of the camera, the march, compositing.
    kernels: [ComputeKernel; 3],
    /// Buffers of the march by group and binding.
    held: BTreeMap<(u32, u32), wgpu::Buffer>,
}

impl ReadyBundle<'_> {
    /// The scene's picture.
    pub fn picture(&self) -> Result<Image> {
        let Self { gpu, kernels: [ready_camera, ready_march, ready_compose], .. } = self;
        let manifest = &self.bundle.manifest;
        let Manifest { origin: Origin { resolution: [width, height], .. }, kernels: [camera, march, compose], .. } =
            manifest;
        let total = width * height;
        let together = manifest.rays_together.max(1);
        let buffer = |label, size| {
            gpu.device().create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let rays = buffer("rays", u64::from(together) * size_of::<Ray>() as u64);
        let frame = Frame::new(gpu, [*width, *height], Channels::default())?;
        let steps = march.number("steps");
        for first in (0..total).step_by(together as usize) {
            let count = together.min(total - first);
            // A buffer of its own: a march goes on from what its pixels hold.
            let pixels = buffer("pixels", u64::from(together) * size_of::<Pixel>() as u64);
            let run = |kernel: &Kernel, ready: &ComputeKernel, changed: &[(&str, u32)]| -> Result<()> {
                let uniform = kernel.packed(changed)?;
                let uniform = gpu.upload(&kernel.name, &uniform, wgpu::BufferUsages::UNIFORM);
                let mut bindings = Bindings::new().bind(0, 0, uniform.as_entire_binding());
                for binding in &kernel.bindings {
                    let buffer = match binding.role.as_str() {
                        "rays" => &rays,
                        "pixels" => &pixels,
                        "colour" => &frame.colour,
                        // A file, or the parameters of the density.
                        role => self.held.get(&(binding.group, binding.binding)).ok_or_else(|| unknown(role))?,
                    };
                    bindings = bindings.bind(binding.group, binding.binding, buffer.as_entire_binding());
                }
                gpu.dispatch(ready, &bindings, [count, 1, 1])
            };
            run(camera, ready_camera, &[("first", first), ("count", count)])?;
            for begin in (0..steps).step_by(manifest.steps_together.max(1) as usize) {
                let end = begin.saturating_add(manifest.steps_together);
                run(march, ready_march, &[("count", count), ("first_step", begin), ("end_step", end)])?;
            }
            run(compose, ready_compose, &[("first", first), ("count", count), ("rays", 1), ("begin", 0)])?;
        }
        frame.read_back(gpu)
    }
}

fn unknown(role: &str) -> Error {
    Error::new("bundle.json", format!("role \"{role}\""), "rays, pixels, colour or file", "Publish the scene again.")
}

impl Kernel {
    /// A whole number of the uniform; 0 where there is none of the name.
    fn number(&self, name: &str) -> u32 {
        let field = self.uniform.iter().find(|field| field.name == name);
        field.and_then(|field| field.values.first()).map_or(0, |&value| value as u32)
    }

    /// The uniform as bytes, with other whole numbers for some of its fields.
    fn packed(&self, changed: &[(&str, u32)]) -> Result<Vec<u8>> {
        let mut bytes = vec![0; self.bytes as usize];
        for field in &self.uniform {
            for (number, &value) in field.values.iter().enumerate() {
                let other = changed.iter().find(|(name, _)| *name == field.name);
                let word = match field.kind.as_str() {
                    "f32" => (value as f32).to_le_bytes(),
                    _ => other.map_or(value as u32, |(_, value)| *value).to_le_bytes(),
                };
                let at = field.offset as usize + 4 * number;
                let place = bytes.get_mut(at..at + 4).ok_or_else(|| {
                    Error::new(
                        format!("bundle.json, field {} of {}", field.name, self.name),
                        format!("{at} bytes before it"),
                        format!("a place within the {} bytes of the uniform", self.bytes),
                        "Publish the scene again.",
                    )
                })?;
                place.copy_from_slice(&word);
            }
        }
        Ok(bytes)
    }
}

/// What a binding holds.
struct Content {
    group: u32,
    binding: u32,
    role: &'static str,
    bytes: Vec<u8>,
}

impl Content {
    fn role(binding: u32, role: &'static str) -> Self {
        Self { group: 0, binding, role, bytes: Vec::new() }
    }

    /// A file of its name; a buffer cannot be empty.
    fn bytes(group: u32, binding: u32, role: &'static str, bytes: &[u8]) -> Self {
        let mut bytes = bytes.to_vec();
        bytes.resize(bytes.len().next_multiple_of(4).max(16), 0);
        Self { group, binding, role, bytes }
    }
}

/// Writes a kernel's text and the contents of those bindings that are left in it.
fn kernel(
    files: &mut BTreeMap<String, Vec<u8>>,
    name: &str,
    module: &naga::Module,
    uniform: Uniform,
    contents: Vec<Content>,
) -> Result<Kernel> {
    let file = format!("{name}.wgsl");
    files.insert(file.clone(), wgsl::write(module, Language::Wgsl)?);
    let is_left = |content: &Content| {
        let wanted = (content.group, content.binding);
        let mut places = module.global_variables.iter().filter_map(|(_, variable)| variable.binding);
        places.any(|place| (place.group, place.binding) == wanted)
    };
    let mut bindings = Vec::new();
    for content in contents.into_iter().filter(is_left) {
        let Content { group, binding, role, bytes } = content;
        let (role, file) = match bytes.is_empty() {
            true => (role.to_owned(), None),
            false => (if role == DENSITY { role } else { "file" }.to_owned(), Some(format!("{role}.bin"))),
        };
        if let Some(file) = &file {
            files.insert(file.clone(), bytes);
        }
        bindings.push(Binding { group, binding, role, file });
    }
    Ok(Kernel {
        name: name.into(),
        file,
        workgroup: module.entry_points[0].workgroup_size[0],
        bytes: uniform.bytes.len() as u32,
        uniform: uniform.described(),
        bindings,
    })
}
