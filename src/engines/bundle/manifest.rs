//! What the files of bundles say of themselves.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::Identity;
use crate::engines::Engine;
use crate::engines::render::EngineRenderer;
use crate::gpu::layout::ShaderStruct;
use crate::scene::Scene;
use crate::scene::image::Image;
use naga::ScalarKind;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// What `bundle.json` begins with.
pub const FORMAT: &str = "cloudparity bundle 1";

/// `bundle.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// [`FORMAT`].
    pub format: String,
    /// What it was made of.
    #[serde(flatten)]
    pub origin: Origin,
    /// Steps of a dispatch of the march, at most: a software adapter cuts off loops that are longer. The pixels keep what a ray came to
    /// between dispatches.
    pub steps_together: u32,
    /// Rays of a dispatch, at most, so that a software adapter is done in some 50 ms.
    pub rays_together: u32,
    /// `camera`, `march` and `compose`, in this order.
    pub kernels: [Kernel; 3],
    /// The right picture of the scene as it is, where there is one: a file of `vec4f` each, from the top-left corner.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub truth: Option<String>,
    /// How a page shows linear colours; by the curve of sRGB alone where nothing is said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub display: Option<Shown>,
    /// Bundles that a page offers, itself among them; of other presets for the same scene.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub presets: Vec<Other>,
    /// Parameters of the density, in the order of the floats of the march's uniform with the role `density`. Who changes one sets the march's
    /// `everywhere` to 1: which cells may hold something is no longer known.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub density: Vec<Tunable>,
}

/// From linear colours to those of the screen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Shown {
    /// The view transform and look.
    pub view: String,
    /// Stops: colours are multiplied by 2^exposure first.
    pub exposure: f64,
    /// Display values as a table of words, ten bits each for red (lowest), green and blue; blue fastest. Without it the curve of sRGB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Colours along each axis of the table, at (e^(t s) - 1) / 4096 with t = ln(1 + 4096 * 64) and s from 0 to 1; 0 without one.
    pub side: u32,
}

/// A parameter of a bundle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tunable {
    /// The field of the uniform.
    pub field: String,
    /// Its name in presets: `scene.NAME` or `density.NAME`.
    pub name: String,
    /// What readers call it.
    pub title: String,
    /// What it is.
    pub about: String,
    /// Its value in the bundle's picture.
    pub value: f64,
    /// What makes sense, low and high. The shader takes any number that Blender or the system takes.
    pub range: [f64; 2],
}

/// A bundle beside others.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Other {
    /// What the page calls it.
    pub title: String,
    /// Its folder, from this one.
    pub folder: String,
}

/// What a bundle was made of, and the picture that it draws.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Origin {
    /// The cloud system.
    pub model: String,
    /// Defects of the original that it has.
    pub defects: String,
    /// Its parameters, as the shaders were made for.
    pub parameters: serde_json::Value,
    /// The scene's name.
    pub scene: String,
    /// SHA-256 of the scene's content.
    pub scene_sha256: String,
    /// The build that wrote it.
    pub build: String,
    /// Width and height of the scene's picture.
    pub resolution: [u32; 2],
    /// The scene's camera and the frame of its density, for hosts whose camera moves.
    pub camera: CameraFrame,
}

impl Origin {
    pub(super) fn of(scene: &Scene, engine: &Engine, renderer: &EngineRenderer<'_>) -> Self {
        Self {
            model: engine.model.into(),
            defects: engine.defects.to_string(),
            parameters: serde_json::to_value(&engine.values).unwrap_or_default(),
            scene: scene.name.clone(),
            scene_sha256: scene.content_hash(),
            build: Identity::current().full().to_owned(),
            resolution: scene.image_size(),
            camera: CameraFrame {
                place: scene.camera.matrix_world.map(|row| f64::from(row[3]))[..3].try_into().unwrap_or_default(),
                target: renderer.view().centre.to_array(),
                to_local: engine.container.to_local.transpose().to_cols_array_2d(),
                unit: engine.container.unit,
                near: scene.camera.clip_start.into(),
                far: scene.camera.clip_end.into(),
            },
        }
    }
}

/// What a host needs to make the uniforms of the camera for another place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraFrame {
    /// The camera's place in the world.
    pub place: [f64; 3],
    /// The middle of the density's box in the world.
    pub target: [f64; 3],
    /// World to the density's frame, row by row.
    pub to_local: [[f64; 4]; 4],
    /// Metres of the engine's unit of length.
    pub unit: f64,
    /// Metres from the camera before which nothing is seen, along its axis.
    pub near: f64,
    /// Metres beyond which nothing is seen.
    pub far: f64,
}

/// A compute kernel; its entry point is `main`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Kernel {
    /// Its name.
    pub name: String,
    /// Its text.
    pub file: String,
    /// Invocations of a workgroup.
    pub workgroup: u32,
    /// Bytes of the uniform, binding 0 of group 0.
    pub bytes: u32,
    /// Fields of the uniform with the numbers of the scene.
    pub uniform: Vec<Field>,
    /// Further bindings.
    pub bindings: Vec<Binding>,
}

/// A field of a uniform.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Field {
    /// Its name in the shader, where its meaning stands.
    pub name: String,
    /// Bytes before it.
    pub offset: u32,
    /// `f32` or `u32`.
    pub kind: String,
    /// Its numbers, one or a vector's.
    pub values: Vec<f64>,
}

/// A storage buffer of a kernel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Binding {
    /// Its group.
    pub group: u32,
    /// Its number there.
    pub binding: u32,
    /// `rays` (64 bytes each), `pixels` (32 bytes each), `colour` (`vec4f` each, from the top-left corner), `file`, or `density`: a uniform with
    /// the parameters of the density, whose content is a file, too.
    pub role: String,
    /// Its content, where the role is `file`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
}

/// An error where an engine has what bundles do not carry: passes over its picture, air before it, a light volume, steps by the distance of each ray.
pub(super) fn refuse_beyond_bundles(engine: &Engine) -> Result<()> {
    if engine.light_volume.is_some() {
        return Err(Error::new(
            "the engine of a bundle",
            "a light volume",
            "an engine without one: hosts move suns, and change the density, whose light it would not be",
            "Leave it out.",
        ));
    }
    if engine.air.is_some() || engine.light.terms.ground.is_some() {
        return Err(Error::new(
            "the engine of a bundle",
            "air before the cloud (haze, aerial perspective, rays of the march), or light from the ground",
            "an engine without them: bundles carry none",
            "Set their parameters to 0.",
        ));
    }
    if engine.light.shadow.map.is_some_and(|map| map.cascades > 1) {
        return Err(Error::new(
            "the engine of a bundle",
            "shadow maps of parts of the view",
            "one map over the whole cloud: the camera of a bundle moves",
            "Set cascades to 1.",
        ));
    }
    if engine.march.distance_levels.is_some() {
        return Err(Error::new(
            "the engine of a bundle",
            "steps by the distance of each ray",
            "one number of steps for all rays",
            "Set distance_levels to 0.",
        ));
    }
    let Some(pass) = engine.passes.first() else { return Ok(()) };
    Err(Error::new(
        format!("pass {}", pass.id()),
        "a pass over the picture",
        "an engine without passes: bundles carry none",
        "Switch the pass off by its parameter, or take another model.",
    ))
}

/// The floats of the right picture, checked against the size of a bundle's.
pub(super) fn truth_of(resolution: [u32; 2], truth: &Image) -> Result<Vec<u8>> {
    let [width, height] = resolution.map(|side| side as usize);
    if (truth.width, truth.height) != (width, height) {
        return Err(Error::new(
            "the truth of a bundle",
            format!("{} x {} pixels", truth.width, truth.height),
            format!("{width} x {height}, as the scene's picture"),
            "Give it in the size of the bundle.",
        ));
    }
    Ok(bytemuck::cast_slice(&truth.pixels).to_vec())
}

/// Writes files into a folder, the manifest last.
pub(super) fn write_into(
    folder: &Path,
    files: &BTreeMap<String, Vec<u8>>,
    manifest: &impl Serialize,
    name: &str,
) -> Result<()> {
    for (name, bytes) in files {
        let path = folder.join(name);
        let parent = path.parent().unwrap_or(folder);
        files::make_folder(parent, "a folder that can be made")?;
        files::write_atomically(&path, bytes)?;
    }
    let text = serde_json::to_string_pretty(manifest).expect("a manifest is JSON");
    files::write_atomically(&folder.join(name), (text + "\n").as_bytes())
}

/// A uniform as bytes, and where its fields lie.
pub(super) struct Uniform {
    pub(super) bytes: Vec<u8>,
    fields: &'static [crate::gpu::layout::Field],
}

impl Uniform {
    pub(super) fn of<T: ShaderStruct>(value: &T) -> Self {
        Self { bytes: bytemuck::bytes_of(value).to_vec(), fields: T::FIELDS }
    }

    /// Its fields with their numbers; gaps are left out.
    pub(super) fn described(&self) -> Vec<Field> {
        let of = |field: &crate::gpu::layout::Field| {
            let is_float = field.kind == Some(ScalarKind::Float);
            let word = |bytes: &[u8]| -> f64 {
                let bytes: [u8; 4] = bytes.try_into().unwrap_or_default();
                if is_float { f64::from(f32::from_le_bytes(bytes)) } else { f64::from(u32::from_le_bytes(bytes)) }
            };
            Field {
                name: field.name.into(),
                offset: field.offset as u32,
                kind: if is_float { "f32" } else { "u32" }.into(),
                values: self.bytes[field.offset..field.offset + field.size].chunks_exact(4).map(word).collect(),
            }
        };
        self.fields.iter().filter(|field| !crate::gpu::layout::Field::is_padding(field.name)).map(of).collect()
    }
}
