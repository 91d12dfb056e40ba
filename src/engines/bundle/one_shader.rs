//! An engine in a scene as one fragment shader, for programs that have no compute kernels or no storage buffers: what it reads lies in uniforms
//! and in one texture of 8 bits a channel.
//!
//! The functions are those of the kernels, linked by `shaders/engines/picture.wgsl`. [`languages`](super::languages) writes them for a program.

use super::manifest::{Field, Origin, Tunable, Uniform, refuse_beyond_bundles, truth_of, write_into};
use super::run_time::RunTime;
use crate::base::error::{Error, Result};
use crate::base::files;
use crate::engines::Engine;
use crate::engines::march::camera::{self, ViewUniform};
use crate::engines::march::gpu::Form;
use crate::engines::passes::Channels;
use crate::engines::passes::compositing::{self, Background, CompositeUniform};
use crate::engines::render::EngineRenderer;
use crate::gpu::Gpu;
use crate::gpu::draw::{Drawing, ReadyDrawing};
use crate::graph::wgsl::{ProgramParameters, ROW};
use crate::scene::Scene;
use crate::scene::image::Image;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// What `cloud.json` begins with.
pub const FORMAT: &str = "cloudparity shader 1";

/// `cloud.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ShaderManifest {
    /// [`FORMAT`].
    pub format: String,
    /// What it was made of.
    #[serde(flatten)]
    pub origin: Origin,
    /// Uniforms of the shader.
    pub blocks: Vec<Block>,
    /// Its texture.
    pub data: Data,
    /// Pixels that a software adapter draws in some 50 ms: hosts draw so many in one go.
    pub pixels_together: u32,
    /// Parameters of the density, in the order of the block's fields. Who changes one sets the march's `everywhere` to 1: which cells may hold
    /// something is no longer known.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub density: Vec<Tunable>,
    /// The right picture of the scene as it is, where there is one: a file of four floats a pixel, from the top-left corner.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub truth: Option<String>,
}

/// Uniforms that belong together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Block {
    /// `view`, `march`, `composite`, `suns` or `density`.
    pub name: String,
    /// Its struct in the shader.
    pub kind: String,
    /// Its binding in group 0, where the language has such.
    pub binding: u32,
    /// Elements of an array of such structs, 0 where it is none.
    pub count: u32,
    /// Bytes of one.
    pub bytes: u32,
    /// Fields of each element with the numbers of the scene.
    pub elements: Vec<Vec<Field>>,
}

/// The texture of a shader: words of 32 bits, a texel each, along rows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Data {
    /// Its texels: red, green, blue, alpha, 8 bits each, as they are: no curve of sRGB, no alpha that is multiplied in, no filter.
    pub file: String,
    /// Width.
    pub width: u32,
    /// Height.
    pub height: u32,
}

/// The shader and what it reads.
pub struct OneShader {
    /// Entry `main`, a fragment; functions `picture` and `cloud` are for other entries.
    pub module: naga::Module,
    /// What `cloud.json` says.
    pub manifest: ShaderManifest,
    /// Bytes of each block.
    uniforms: Vec<Vec<u8>>,
    /// Bytes of the texture.
    data: Vec<u8>,
    truth: Option<Vec<u8>>,
}

impl OneShader {
    /// Of an engine in a scene: one ray per pixel, samples in the middle of their steps. An error where the engine needs what a bundle has not:
    /// passes over the picture, a domain that is no box, a picture of a world.
    pub fn new(scene: &Scene, engine: &Engine) -> Result<Self> {
        Self::with_parameters(scene, engine, None)
    }

    /// The same with parameters of the density that a host changes, in the block `density`.
    pub fn with_parameters(scene: &Scene, engine: &Engine, run_time: Option<&RunTime>) -> Result<Self> {
        refuse_beyond_bundles(engine)?;
        let tuned = run_time.map(|run_time| run_time.engine(engine));
        let engine = tuned.as_ref().unwrap_or(engine);
        let renderer = EngineRenderer::new(scene, engine, None)?;
        let size = scene.image_size();
        let view = ViewUniform::new(renderer.camera(), &engine.container, size)?;
        let background = renderer.constant_background()?;
        let composite = CompositeUniform::over(background.unwrap_or_default(), scene.film.exposure);
        let kind = background.map_or(Background::None, Background::Constant);
        let constants = camera::CONSTANTS.text();
        let form = Form::Fragment {
            around: &[("generated/camera.wgsl", &constants), camera::SOURCE, compositing::SOURCE],
            entry: ("engines/picture.wgsl", include_str!("../../../shaders/engines/picture.wgsl")),
            definitions: &compositing::definitions(engine.compositing, &kind, Channels::default()),
            parameters: run_time.map(|run_time| &run_time.parameters),
        };
        let march = renderer.march_parts(&form)?;
        let mut data = march.words();
        data.resize(data.len().max(4).next_multiple_of(4 * ROW as usize), 0);
        let module = with_own_names(march.module.clone());
        let blocks = [
            ("view", "camera_View", 0, vec![Uniform::of(&view)], false),
            ("march", "march_March", 1, vec![Uniform::of(&march.uniform)], false),
            ("composite", "compositing_Composite", 2, vec![Uniform::of(&composite)], false),
            ("suns", "march_Sun", 3, march.suns.iter().map(Uniform::of).collect(), true),
        ];
        let is_left = |binding: u32| {
            let mut places = module.global_variables.iter().filter_map(|(_, variable)| variable.binding);
            places.any(|place| (place.group, place.binding) == (0, binding))
        };
        let (mut described, mut uniforms) = (Vec::new(), Vec::new());
        for (name, kind, binding, elements, is_array) in blocks.into_iter().filter(|block| is_left(block.2)) {
            described.push(Block {
                name: name.into(),
                kind: kind.into(),
                binding,
                count: if is_array { elements.len() as u32 } else { 0 },
                bytes: elements[0].bytes.len() as u32,
                elements: elements.iter().map(Uniform::described).collect(),
            });
            uniforms.push(elements.into_iter().flat_map(|element| element.bytes).collect());
        }
        if let Some(run_time) = run_time.filter(|_| is_left(ProgramParameters::BINDING)) {
            let bytes = run_time.bytes();
            described.push(Block {
                name: "density".into(),
                kind: ProgramParameters::STRUCT.into(),
                binding: ProgramParameters::BINDING,
                count: 0,
                bytes: bytes.len() as u32,
                elements: vec![run_time.fields()],
            });
            uniforms.push(bytes);
        }
        let manifest = ShaderManifest {
            format: FORMAT.into(),
            origin: Origin::of(scene, engine, &renderer),
            blocks: described,
            data: Data { file: "data.bin".into(), width: ROW, height: (data.len() / (4 * ROW as usize)) as u32 },
            pixels_together: march.rays_together(u32::MAX) as u32,
            density: run_time.map_or_else(Vec::new, |run_time| run_time.tunables.clone()),
            truth: None,
        };
        Ok(Self { module, manifest, uniforms, data, truth: None })
    }

    /// The same with the right picture of the scene beside it. An error where it has another size.
    pub fn with_truth(mut self, truth: &Image) -> Result<Self> {
        self.truth = Some(truth_of(self.manifest.origin.resolution, truth)?);
        self.manifest.truth = Some("truth.bin".into());
        Ok(self)
    }

    /// Writes it into a folder with further files, the manifest last. Each block is there as a uniform buffer has it, `view.bin` and so on.
    pub fn write(&self, folder: &Path, mut others: BTreeMap<String, Vec<u8>>) -> Result<()> {
        others.insert(self.manifest.data.file.clone(), self.data.clone());
        for (block, bytes) in self.manifest.blocks.iter().zip(&self.uniforms) {
            others.insert(format!("{}.bin", block.name), bytes.clone());
        }
        if let (Some(name), Some(truth)) = (&self.manifest.truth, &self.truth) {
            others.insert(name.clone(), truth.clone());
        }
        write_into(folder, &others, &self.manifest, "cloud.json")
    }

    /// A number or a vector of a uniform; none where there is no such field.
    pub fn number(&self, block: &str, element: usize, field: &str) -> Option<&[f64]> {
        let block = self.manifest.blocks.iter().find(|one| one.name == block)?;
        Some(&block.elements.get(element)?.iter().find(|one| one.name == field)?.values)
    }

    /// Changes it, as hosts do while they run. An error where there is no such field, or it has another number of numbers.
    pub fn set_number(&mut self, block: &str, element: usize, field: &str, values: &[f64]) -> Result<()> {
        let missing = || {
            let place = format!("{block} {element} {field}");
            let hint = "Take one that cloud.json names.";
            Error::new(place, format!("{} numbers", values.len()), "a field of the shader with as many", hint)
        };
        let index = self.manifest.blocks.iter().position(|one| one.name == block).ok_or_else(missing)?;
        let block = &mut self.manifest.blocks[index];
        let fields = block.elements.get_mut(element).ok_or_else(missing)?;
        let found = fields.iter_mut().find(|one| one.name == field && one.values.len() == values.len());
        let found = found.ok_or_else(missing)?;
        found.values = values.to_vec();
        let first = element * block.bytes as usize + found.offset as usize;
        for (bytes, &value) in self.uniforms[index][first..].chunks_exact_mut(4).zip(values) {
            bytes.copy_from_slice(&if found.kind == "u32" {
                (value as u32).to_le_bytes()
            } else {
                (value as f32).to_le_bytes()
            });
        }
        Ok(())
    }

    /// The scene's picture on an adapter, from the module and the bytes that are written.
    pub fn picture(&self, gpu: &Gpu) -> Result<Image> {
        self.ready(gpu)?.picture()
    }

    /// Compiled, with its data on the adapter: for pictures whose time is measured.
    pub fn ready<'a>(&self, gpu: &'a Gpu) -> Result<ReadyShader<'a>> {
        let Data { width, height, .. } = self.manifest.data;
        let blocks = self.manifest.blocks.iter().zip(&self.uniforms);
        let size = self.manifest.origin.resolution;
        let drawing = gpu.ready_to_draw(&Drawing {
            module: &self.module,
            uniforms: blocks.map(|(block, bytes)| (block.binding, bytes.as_slice())).collect(),
            texels: (&self.data, [width, height]),
            size,
        })?;
        Ok(ReadyShader { drawing, size })
    }

    /// Reads the manifest of a folder.
    pub fn manifest_of(folder: &Path) -> Result<ShaderManifest> {
        let path = folder.join("cloud.json");
        let text = files::read_text(&path, "the manifest of a shader")?;
        serde_json::from_str(&text).map_err(|cause| {
            let place = format!("{}, line {}", path.display(), cause.line());
            Error::new(place, cause.to_string(), "the manifest of a shader", "Publish the scene again.")
        })
    }
}

/// Functions that hosts call.
const CALLED: [&str; 2] = ["cloud", "picture"];

/// Renames what has the name of a function that hosts call: a writer would keep the name of the one that comes first.
fn with_own_names(mut module: naga::Module) -> naga::Module {
    let mend = |name: &mut String| {
        if CALLED.contains(&name.as_str()) {
            name.push_str("_here");
        }
    };
    for (_, function) in module.functions.iter_mut() {
        function.arguments.iter_mut().filter_map(|one| one.name.as_mut()).for_each(mend);
        function.local_variables.iter_mut().filter_map(|(_, one)| one.name.as_mut()).for_each(mend);
        function.named_expressions.values_mut().for_each(mend);
    }
    module
}

/// A shader that can be drawn.
pub struct ReadyShader<'a> {
    drawing: ReadyDrawing<'a>,
    size: [u32; 2],
}

impl ReadyShader<'_> {
    /// The scene's picture.
    pub fn picture(&self) -> Result<Image> {
        let [columns, rows] = self.size;
        let mut image = Image::new(columns as usize, rows as usize);
        image.pixels = self.drawing.pixels()?;
        Ok(image)
    }
}
