//! Scene files: camera, film, lights, world, volume and the node graph of its material.
//!
//! One `*.scene.json` drives every renderer, so that "the same camera" is true by construction.
//! Conventions are Blender's: metres, Z up, a camera and a light look down their local -Z,
//! matrices act on column vectors and are written row by row. All numbers are f32.

mod bare;
mod defaults;
mod graph_file;
pub mod image;
pub mod overrides;
#[cfg(feature = "tools")]
mod schema_errors;
pub mod volume_grid;

pub(crate) use graph_file::DEEPEST_NESTING;
pub use graph_file::{Folded, Graph, Group, Input, Node, Release, Socket, SocketType};

pub use bare::bare_scene;

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::json;
use crate::base::kinds::{self, FileKind};
use crate::scene::volume_grid::{DENSITY, GridHandle};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The format that this version reads and writes.
pub const FORMAT: &str = "cloudparity-scene/1";

/// Row-major 4x4 matrix for column vectors.
pub type Matrix = [[f32; 4]; 4];

/// A complete scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Always `cloudparity-scene/1`.
    pub format: String,
    /// Short name, used for output files and titles; the file's own where none is given.
    #[serde(default)]
    pub name: String,
    /// The camera of the picture.
    pub camera: Camera,
    /// Resolution, pixel filter, exposure.
    #[serde(default)]
    pub film: Film,
    /// Bounce limits.
    #[serde(default)]
    pub integrator: Integrator,
    /// How a picture is shown; never touches scene-linear values.
    #[serde(default)]
    pub display: Display,
    /// Sun, point, spot and area lights.
    #[serde(default)]
    pub lights: Vec<Light>,
    /// The background: black where none is given.
    #[serde(default)]
    pub world: World,
    /// The object that holds the medium.
    #[serde(default)]
    pub volume: Volume,
    /// The node graph of the volume's material, here or in a file beside this one.
    pub graph: GraphSource,
    /// Further objects that hold a medium; where objects overlap their coefficients add.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub other_volumes: Vec<Volume>,
    /// The graphs of their materials, each once; those that share the material of `graph` need none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub other_graphs: Vec<Graph>,
    /// The folder that file names are relative to; the scene file's own. Not part of the file.
    #[serde(skip)]
    pub folder: std::path::PathBuf,
}

/// The graph itself or the file that holds it.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum GraphSource {
    /// `{"file": "name.graph.json"}`, relative to the scene file.
    File {
        /// Path of the graph file, or of another scene file that holds its graph in place.
        file: String,
    },
    /// The graph in place.
    Inline(Graph),
}

/// Reads either form key by key: an untagged enum would lose the place of an error in the graph.
impl<'de> Deserialize<'de> for GraphSource {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        deserializer.deserialize_map(GraphSourceVisitor)
    }
}

struct GraphSourceVisitor;

impl<'de> serde::de::Visitor<'de> for GraphSourceVisitor {
    type Value = GraphSource;

    fn expecting(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("a graph (material, nodes, groups) or {\"file\": \"name.graph.json\"}")
    }

    fn visit_map<A: serde::de::MapAccess<'de>>(self, mut map: A) -> std::result::Result<GraphSource, A::Error> {
        use serde::de::Error as _;
        let (mut file, mut material, mut nodes, mut groups, mut blender) = (None, None, None, None, None);
        while let Some(key) = map.next_key::<String>()? {
            match key.as_str() {
                "file" => file = Some(map.next_value()?),
                "material" => material = Some(map.next_value()?),
                "nodes" => nodes = Some(map.next_value()?),
                "groups" => groups = Some(map.next_value()?),
                "blender" => blender = Some(map.next_value()?),
                other => {
                    return Err(A::Error::unknown_field(other, &["file", "material", "nodes", "groups", "blender"]));
                }
            }
        }
        match (file, material, nodes, groups) {
            (Some(file), None, None, None) if blender.is_none() => Ok(GraphSource::File { file }),
            (Some(_), ..) => Err(A::Error::custom("a file and a graph in place, which exclude each other")),
            (None, Some(material), Some(nodes), groups) => Ok(GraphSource::Inline(Graph {
                material,
                nodes,
                groups: groups.unwrap_or_default(),
                blender: blender.unwrap_or_default(),
            })),
            (None, None, ..) => Err(A::Error::missing_field("material")),
            (None, Some(_), None, _) => Err(A::Error::missing_field("nodes")),
        }
    }
}

/// Camera projection and lens.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Object name.
    #[serde(default = "defaults::camera")]
    pub name: String,
    /// Kind of projection.
    #[serde(default = "defaults::projection")]
    pub projection: Projection,
    /// Camera to world; its scale is ignored, as in Cycles.
    pub matrix_world: Matrix,
    /// Millimetres.
    #[serde(default = "defaults::focal_length")]
    pub focal_length: f32,
    /// Which sensor side fits the picture.
    #[serde(default = "defaults::sensor_fit")]
    pub sensor_fit: SensorFit,
    /// Millimetres.
    #[serde(default = "defaults::sensor_width")]
    pub sensor_width: f32,
    /// Millimetres.
    #[serde(default = "defaults::sensor_height")]
    pub sensor_height: f32,
    /// Width of the view in metres, orthographic only.
    #[serde(default = "defaults::ortho_scale")]
    pub ortho_scale: f32,
    /// View shift as a fraction of the fitted sensor length.
    #[serde(default)]
    pub shift: [f32; 2],
    /// Metres along the view axis at which rays start.
    #[serde(default = "defaults::clip_start")]
    pub clip_start: f32,
    /// Metres along the view axis at which rays end.
    #[serde(default = "defaults::clip_end")]
    pub clip_end: f32,
    /// Angles in radians, equirectangular only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub panorama: Option<Panorama>,
}

/// Kind of projection.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Projection {
    /// Pinhole.
    Perspective,
    /// Parallel.
    Orthographic,
    /// Longitude and latitude.
    Equirectangular,
}

/// Blender's sensor fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "UPPERCASE")]
pub enum SensorFit {
    /// The longer side of the picture.
    Auto,
    /// The width.
    Horizontal,
    /// The height.
    Vertical,
}

/// Angular range of an equirectangular camera in radians.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Panorama {
    /// Left edge.
    pub longitude_min: f32,
    /// Right edge.
    pub longitude_max: f32,
    /// Bottom edge.
    pub latitude_min: f32,
    /// Top edge.
    pub latitude_max: f32,
}

/// The picture to make.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Film {
    /// Width and height in pixels before the percentage.
    #[serde(default = "defaults::resolution")]
    pub resolution: [u32; 2],
    /// Percent; the result is truncated, as in Blender.
    #[serde(default = "defaults::percentage")]
    pub resolution_percentage: u32,
    /// Width and height of a pixel.
    #[serde(default = "defaults::square")]
    pub pixel_aspect: [f32; 2],
    /// Reconstruction filter.
    #[serde(default = "defaults::pixel_filter")]
    pub pixel_filter: PixelFilter,
    /// Filter width in pixels; ignored by the box filter.
    #[serde(default = "defaults::filter_width")]
    pub filter_width: f32,
    /// Factor on radiance.
    #[serde(default = "defaults::one")]
    pub exposure: f32,
    /// Leave the world out of what the camera sees directly.
    #[serde(default)]
    pub transparent: bool,
}

/// Reconstruction filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum PixelFilter {
    /// Uniform over the pixel.
    Box,
    /// Gaussian.
    Gaussian,
    /// Blackman-Harris.
    BlackmanHarris,
}

/// Bounce limits as Cycles means them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Integrator {
    /// `n` allows `n + 1` scattering events; 0 is single scattering.
    #[serde(default)]
    pub volume_bounces: u32,
    /// Cap on all bounces; the smaller of both wins.
    #[serde(default = "defaults::max_bounces")]
    pub max_bounces: u32,
}

/// Display transform.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Display {
    /// For example `AgX` or `Standard`.
    #[serde(default = "defaults::view_transform")]
    pub view_transform: String,
    /// For example `None`.
    #[serde(default = "defaults::look")]
    pub look: String,
    /// Stops.
    #[serde(default)]
    pub exposure: f32,
    /// Power after the view transform.
    #[serde(default = "defaults::one")]
    pub gamma: f32,
}

/// A light; it shines along its local -Z.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Light {
    /// Object name.
    #[serde(default = "defaults::light")]
    pub name: String,
    /// Light to world.
    pub matrix_world: Matrix,
    /// Linear Rec. 709.
    #[serde(default = "defaults::white")]
    pub color: [f32; 3],
    /// Irradiance for a sun, watts else.
    pub strength: f32,
    /// Stops on the strength.
    #[serde(default)]
    pub exposure: f32,
    /// Kind and its own settings.
    #[serde(flatten)]
    pub kind: LightKind,
}

impl Light {
    /// Its strength with its exposure, before its colour.
    pub fn exposed_strength(&self) -> f64 {
        f64::from(self.strength) * f64::from(self.exposure).exp2()
    }
}

/// Kinds of light with their own settings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "lowercase")]
pub enum LightKind {
    /// Parallel light.
    Sun {
        /// Angular diameter in radians.
        #[serde(default = "defaults::sun_angle")]
        angle: f32,
    },
    /// Point or soft sphere.
    Point {
        /// Metres.
        #[serde(default = "defaults::radius")]
        radius: f32,
        /// A disc facing the receiver instead of a sphere.
        #[serde(default = "defaults::yes")]
        soft_falloff: bool,
    },
    /// Cone.
    Spot {
        /// Metres.
        #[serde(default = "defaults::radius")]
        radius: f32,
        /// Full angle in radians.
        #[serde(default = "defaults::spot_size")]
        spot_size: f32,
        /// Softness of the edge, 0 to 1.
        #[serde(default = "defaults::blend")]
        blend: f32,
    },
    /// One-sided rectangle or ellipse.
    Area {
        /// Blender's shape name.
        #[serde(default = "defaults::area")]
        shape: String,
        /// Metres before the object's scale.
        size: [f32; 2],
    },
}

/// Background radiance: `color * strength`, that of a picture times `strength`, or what a node graph sends.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct World {
    /// Linear Rec. 709.
    #[serde(default)]
    pub color: [f32; 3],
    /// Factor.
    #[serde(default = "defaults::one")]
    pub strength: f32,
    /// A picture in place of the colour, which has to be white then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<WorldImage>,
    /// The world's node tree in place of the colour, which has to be white then, with strength 1. It ends in a World Output,
    /// and its `material` is the world's name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub graph: Option<Graph>,
}

/// An equirectangular picture around the scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WorldImage {
    /// EXR in linear Rec. 709, relative to the scene file.
    pub file: String,
    /// SHA-256 of that file: the picture is part of the scene's identity.
    pub sha256: String,
}

/// The object with the volume material.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Volume {
    /// Object name.
    #[serde(default = "defaults::volume")]
    pub object: String,
    /// Object to world.
    #[serde(default = "defaults::identity")]
    pub matrix_world: Matrix,
    /// Outline of the medium in object space.
    #[serde(default = "defaults::shape")]
    pub shape: Shape,
    /// Axis-aligned bounds of the shape in object space.
    #[serde(default = "defaults::bounds")]
    pub bounds: Bounds,
    /// The mesh's texture space, for Generated coordinates; that of the bounds where none is given.
    #[serde(default = "defaults::texture_space")]
    pub texture_space: TextureSpace,
    /// Material name; that of the graph where none is given.
    #[serde(default = "defaults::material")]
    pub material: String,
    /// Blender's per-material factor on ray-marching steps.
    #[serde(default = "defaults::one")]
    pub volume_step_rate: f32,
    /// Colour and alpha of the object, for Object Info.
    #[serde(default = "white", skip_serializing_if = "is_white")]
    pub color: [f32; 4],
    /// Pass index of the object, for Object Info.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub pass_index: u32,
    /// Pass index of the material, for Object Info.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub material_pass_index: u32,
    /// The grid of a shape `grid`, read when the scene is loaded.
    #[serde(skip)]
    #[schemars(skip)]
    pub grid: Option<GridHandle>,
}

/// What an empty object of a scene file stands for.
macro_rules! default_of_empty_object {
    ($($name:ident),*) => {
        $(impl Default for $name {
            fn default() -> Self {
                serde_json::from_value(serde_json::json!({})).expect("every field has a default")
            }
        })*
    };
}
default_of_empty_object!(Film, Integrator, Display, World, Volume);

fn white() -> [f32; 4] {
    [1.0; 4]
}

fn is_white(color: &[f32; 4]) -> bool {
    *color == white()
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "the signature that serde calls")]
fn is_zero(index: &u32) -> bool {
    *index == 0
}

/// Outline of a medium.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "lowercase")]
pub enum Shape {
    /// Exactly the bounds.
    Box,
    /// A closed triangle mesh with outward normals.
    Mesh {
        /// Object-space positions.
        vertices: Vec<[f32; 3]>,
        /// Vertex indices.
        triangles: Vec<[u32; 3]>,
    },
    /// A Volume object with an OpenVDB grid "density"; the bounds enclose its active voxels and one more on each side.
    Grid {
        /// The .vdb, relative to the scene file.
        file: String,
        /// SHA-256 of that file: the grid is part of the scene's identity.
        sha256: String,
    },
}

/// Axis-aligned box.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Bounds {
    /// Lower corner.
    pub min: [f32; 3],
    /// Upper corner.
    pub max: [f32; 3],
}

/// Location and half size of the box that Generated maps to 0..1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TextureSpace {
    /// Centre.
    pub location: [f32; 3],
    /// Half size.
    pub size: [f32; 3],
}

/// Refuses a file beside the scene that is not the one the scene was made with. `what` it is, and where the hash `wanted` stands.
fn check_hash(path: &Path, what: &str, wanted_at: &str, wanted: &str) -> Result<()> {
    let found = files::sha256(&files::read_bytes(path, what)?);
    if found == wanted {
        return Ok(());
    }
    Err(Error::new(
        wanted_at,
        format!("\"{wanted}\" where {} has {found}", path.display()),
        format!("the hash of {what}"),
        "Restore the file, or write its own hash if another one is meant.",
    ))
}

impl GraphSource {
    /// The graph, to change it; none where it is in a file that is not read yet.
    pub fn inline_mut(&mut self) -> Option<&mut Graph> {
        match self {
            Self::Inline(graph) => Some(graph),
            Self::File { .. } => None,
        }
    }
}

impl Scene {
    /// Reads and checks a scene file; a graph in a file of its own is read into the scene.
    pub fn load(path: &Path) -> Result<Self> {
        kinds::want(path, FileKind::Scene)?;
        let text = files::read_text(path, "a scene file (*.scene.json)")?;
        let mut scene = Self::parse(&text, &path.display().to_string())?;
        if let GraphSource::File { file } = &scene.graph {
            let graph_path = path.parent().unwrap_or(Path::new(".")).join(file);
            scene.graph = GraphSource::Inline(load_graph(&graph_path)?);
        }
        scene.complete();
        let folder = path.parent().unwrap_or(Path::new("."));
        scene.folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
        scene.check_world_image(&path.display().to_string())?;
        scene.read_grids(&path.display().to_string())?;
        scene.check(&path.display().to_string())?;
        Ok(scene)
    }

    /// Reads a document, completed by what follows from the rest of it. All that the schema refuses stands in the error.
    fn parse(text: &str, place: &str) -> Result<Self> {
        let mut document = read_json(text, place)?;
        let file = place.rsplit(['/', '\\']).next().unwrap_or(place);
        defaults::complete(&mut document, file.split('.').next().unwrap_or(file));
        #[cfg(feature = "tools")]
        return from_json(document.clone(), place, SCHEMA)
            .map_err(|error| schema_errors::all(&document, place).unwrap_or(error));
        #[cfg(not(feature = "tools"))]
        from_json(document, place, SCHEMA)
    }

    /// [`Self::load`] with stored values changed, each `NAME=VALUE` as [`Self::set`] takes it.
    pub fn load_with(path: &Path, assignments: &[String]) -> Result<Self> {
        let mut scene = Self::load(path)?;
        for assignment in assignments {
            scene.set(assignment)?;
        }
        let folded = scene.all_nodes().filter(|node| !node.folded.is_empty()).count();
        if folded > 0 && !assignments.is_empty() {
            log::warn!(
                "{}: {folded} textures with constant inputs have values that Blender folded; of those whose inputs are changed, \
                 ours are taken (cloudparity explain lists them)",
                path.display()
            );
        }
        Ok(scene)
    }

    /// Changes `volume_bounces`, and raises `max_bounces` to it, which would cap it otherwise.
    pub fn set_volume_bounces(&mut self, bounces: u32) {
        self.integrator.volume_bounces = bounces;
        self.integrator.max_bounces = self.integrator.max_bounces.max(bounces);
    }

    /// Reads a scene from a JSON value, for example from the exporter; `place` names its source.
    pub fn from_value(value: serde_json::Value, place: &str) -> Result<Self> {
        let mut scene = Self::parse(&value.to_string(), place)?;
        if let GraphSource::File { file } = &scene.graph {
            return Err(Error::new(
                format!("{place}: $.graph.file"),
                format!("\"{file}\""),
                "the graph in place: what is not read from a folder has no files beside it",
                "Write the scene to a file beside the graph file, or put the graph in place.",
            ));
        }
        scene.complete();
        scene.check(place)?;
        Ok(scene)
    }

    /// The graph. [`Scene::load`] has resolved files by then.
    pub fn graph(&self) -> &Graph {
        match &self.graph {
            GraphSource::Inline(graph) => graph,
            GraphSource::File { file } => unreachable!("the graph file {file} is read when the scene is loaded"),
        }
    }

    /// The graph, to change it.
    pub fn graph_mut(&mut self) -> &mut Graph {
        match &mut self.graph {
            GraphSource::Inline(graph) => graph,
            GraphSource::File { file } => unreachable!("the graph file {file} is read when the scene is loaded"),
        }
    }

    /// Fills in what follows from the graph: the material of the volume that names none, and a place in the editor for nodes that have
    /// none, in a row: a .blend needs one.
    fn complete(&mut self) {
        if self.volume.material.is_empty() {
            self.volume.material = self.graph().material.clone();
        }
        let Self { graph, other_graphs, world, .. } = self;
        let first = match graph {
            GraphSource::Inline(graph) => Some(graph),
            GraphSource::File { .. } => None,
        };
        for graph in first.into_iter().chain(other_graphs).chain(&mut world.graph) {
            let groups = graph.groups.iter_mut().flat_map(|group| &mut group.nodes);
            for (number, node) in graph.nodes.iter_mut().chain(groups).enumerate() {
                node.location.get_or_insert([200.0 * number as f32, 0.0]);
            }
        }
    }

    /// The nodes of all graphs and groups.
    fn all_nodes(&self) -> impl Iterator<Item = &Node> {
        let graphs = std::iter::once(self.graph()).chain(&self.other_graphs);
        graphs.flat_map(|graph| graph.nodes.iter().chain(graph.groups.iter().flat_map(|group| &group.nodes)))
    }

    /// Every volume object with the graph of its material.
    pub fn volumes(&self) -> Result<Vec<(&Volume, &Graph)>> {
        let first = std::iter::once(Ok((&self.volume, self.graph())));
        let others = self.other_volumes.iter().enumerate().map(|(number, volume)| {
            let mut graphs = std::iter::once(self.graph()).chain(&self.other_graphs);
            match graphs.find(|graph| graph.material == volume.material) {
                Some(graph) => Ok((volume, graph)),
                None => Err(Error::new(
                    format!("$.other_volumes[{number}].material"),
                    format!("\"{}\"", volume.material),
                    "a material of $.graph or $.other_graphs",
                    "Correct the name, or export the scene again.",
                )),
            }
        });
        first.chain(others).collect()
    }

    /// Where the picture around the scene is, if it has one.
    pub fn world_image_path(&self) -> Option<std::path::PathBuf> {
        self.world.image.as_ref().map(|image| self.folder.join(&image.file))
    }

    /// The node graph of the world; an error where it has none.
    pub fn world_graph(&self) -> Result<&Graph> {
        self.world.graph.as_ref().ok_or_else(|| {
            Error::new(
                "$.world.graph",
                "a world of one colour or of a picture",
                "a world of nodes",
                "Export a .blend whose world has nodes that vary with the direction.",
            )
        })
    }

    /// Reads the grids of volume objects, which have to be those that the scene was made with.
    fn read_grids(&mut self, place: &str) -> Result<()> {
        let folder = self.folder.clone();
        for volume in std::iter::once(&mut self.volume).chain(&mut self.other_volumes) {
            let Shape::Grid { file, sha256 } = &volume.shape else { continue };
            let path = folder.join(file);
            let wanted_at = format!("{place}: object {}: shape.sha256", volume.object);
            check_hash(&path, "the grid of a volume object (shape grid)", &wanted_at, sha256)?;
            let grid = volume_grid::read(&path, DENSITY)?;
            let [low, high] = grid.extent();
            let [wrong_low, wrong_high] =
                [(low, volume.bounds.min), (high, volume.bounds.max)].map(|(wanted, given)| {
                    let size = (high - low).abs().max_element();
                    !wanted.abs_diff_eq(glam::DVec3::from(given.map(f64::from)), 1e-5 * size)
                });
            if wrong_low || wrong_high {
                return Err(Error::new(
                    format!("{place}: object {}: bounds", volume.object),
                    format!("{:?} to {:?}", volume.bounds.min, volume.bounds.max),
                    format!("{low} to {high}: the grid's active voxels and one more on each side"),
                    "Write these bounds.",
                ));
            }
            volume.grid = Some(GridHandle::new(&grid, sha256.clone()));
        }
        Ok(())
    }

    /// The picture around the scene has to be the one that the scene was made with.
    fn check_world_image(&self, place: &str) -> Result<()> {
        let (Some(image), Some(path)) = (&self.world.image, self.world_image_path()) else { return Ok(()) };
        let wanted_at = format!("{place}: $.world.image.sha256");
        check_hash(&path, "the picture around the scene ($.world.image)", &wanted_at, &image.sha256)
    }

    /// SHA-256 of the compact JSON form: the identity of the scene in every result.
    pub fn content_hash(&self) -> String {
        files::sha256(serde_json::to_string(self).expect("scene types serialise").as_bytes())
    }

    /// Width and height in pixels after the percentage (truncated, as Blender does).
    pub fn image_size(&self) -> [u32; 2] {
        let percentage = u64::from(self.film.resolution_percentage);
        self.film.resolution.map(|side| u32::try_from(u64::from(side) * percentage / 100).unwrap_or(u32::MAX))
    }

    fn check(&self, place: &str) -> Result<()> {
        if self.format != FORMAT {
            return Err(Error::new(
                format!("{place}: $.format"),
                format!("\"{}\"", self.format),
                format!("\"{FORMAT}\""),
                "Export the scene again with this version, or use the version that wrote it.",
            ));
        }
        let [width, height] = self.image_size();
        if width == 0 || height == 0 || width > 16384 || height > 16384 {
            return Err(Error::new(
                format!("{place}: $.film.resolution"),
                format!("a picture of {width} x {height} pixels"),
                "1 to 16384 pixels per side",
                "Change resolution or resolution_percentage.",
            ));
        }
        if self.world.image.is_some() && self.world.color != [1.0; 3] {
            return Err(Error::new(
                format!("{place}: $.world.color"),
                format!("{:?} beside a picture", self.world.color),
                "[1, 1, 1]: the picture takes the place of the colour",
                "Set the colour to white; strength is a factor on the picture.",
            ));
        }
        self.check_world_graph(place)?;
        check_invertible(&self.camera.matrix_world, &format!("{place}: $.camera.matrix_world"))?;
        self.volume.check(&format!("{place}: $.volume"))?;
        for (number, volume) in self.other_volumes.iter().enumerate() {
            volume.check(&format!("{place}: $.other_volumes[{number}]"))?;
        }
        self.check_names(place)?;
        self.volumes()?;
        self.graph().check(&format!("{place}: $.graph"), place)?;
        for (number, graph) in self.other_graphs.iter().enumerate() {
            let own_place = format!("{place}: $.other_graphs[{number}]");
            graph.check(&own_place, place)?;
            let first = self.graph().blender;
            if graph.blender != first {
                return Err(Error::new(
                    format!("{own_place}.blender"),
                    format!("\"{}\"", graph.blender),
                    format!("\"{first}\", as in $.graph: one Blender renders the scene"),
                    "Give all graphs one release.",
                ));
            }
        }
        Ok(())
    }

    /// A world of nodes is what they say, and has the release of the other graphs.
    fn check_world_graph(&self, place: &str) -> Result<()> {
        let Some(graph) = &self.world.graph else { return Ok(()) };
        let own_place = format!("{place}: $.world.graph");
        let wrong = |key: &str, found: String, expected: &str, remedy: &str| {
            Err(Error::new(format!("{place}: $.world.{key}"), found, expected.to_owned(), remedy.to_owned()))
        };
        if self.world.image.is_some() {
            let found = "a picture and a node graph".to_owned();
            return wrong("graph", found, "one of them", "Take the picture or the graph out.");
        }
        if (self.world.color, self.world.strength) != ([1.0; 3], 1.0) {
            let found = format!("{:?} and strength {} beside a graph", self.world.color, self.world.strength);
            let expected = "[1, 1, 1] and 1: the graph has the colours and strengths";
            return wrong("color", found, expected, "Change the Background of the graph instead.");
        }
        graph.check(&own_place, place)?;
        let first = self.graph().blender;
        if graph.blender != first {
            let expected = format!("\"{first}\", as in $.graph: one Blender renders the scene");
            return wrong("graph.blender", format!("\"{}\"", graph.blender), &expected, "Give all graphs one release.");
        }
        Ok(())
    }

    /// Volume objects and materials are found by their names.
    fn check_names(&self, place: &str) -> Result<()> {
        let mut objects = std::collections::HashSet::from([&self.volume.object]);
        let mut materials = std::collections::HashSet::from([&self.graph().material]);
        let objects = self
            .other_volumes
            .iter()
            .map(|volume| ("volume object", &volume.object))
            .filter(|(_, name)| !objects.insert(name));
        let repeated = objects.chain(
            self.other_graphs
                .iter()
                .map(|graph| ("material", &graph.material))
                .filter(|(_, name)| !materials.insert(name)),
        );
        match repeated.into_iter().next() {
            None => Ok(()),
            Some((what, name)) => Err(Error::new(
                place.to_owned(),
                format!("two {what}s called \"{name}\""),
                format!("a name of its own for every {what}"),
                "Rename one of them.",
            )),
        }
    }
}

impl Volume {
    fn check(&self, place: &str) -> Result<()> {
        let bounds = &self.bounds;
        if (0..3).any(|axis| bounds.min[axis] > bounds.max[axis]) {
            return Err(Error::new(
                format!("{place}.bounds"),
                format!("min {:?}, max {:?}", bounds.min, bounds.max),
                "min not above max on any axis",
                "Swap the corners.",
            ));
        }
        check_invertible(&self.matrix_world, &format!("{place}.matrix_world"))?;
        if let Shape::Mesh { vertices, triangles } = &self.shape {
            check_mesh(&format!("{place}.shape"), vertices, triangles)?;
            let outside = vertices
                .iter()
                .position(|vertex| (0..3).any(|axis| !(bounds.min[axis]..=bounds.max[axis]).contains(&vertex[axis])));
            if let Some(number) = outside {
                return Err(Error::new(
                    format!("{place}.shape.vertices[{number}]"),
                    format!("{:?}", vertices[number]),
                    format!("a place within $.bounds of the volume, {:?} to {:?}", bounds.min, bounds.max),
                    "Write the bounds of the vertices, or export the scene again.",
                ));
            }
        }
        Ok(())
    }
}

/// Refuses a mesh that bounds nothing: without triangles, with vertices that are no numbers, or with triangles of vertices that are not
/// there. `place` is where its shape stands.
pub(crate) fn check_mesh(place: &str, vertices: &[[f32; 3]], triangles: &[[u32; 3]]) -> Result<()> {
    let wrong = |at: String, found: String, expected: String| {
        let remedy = "Give the object a closed mesh, and export the scene again.";
        Err(Error::new(format!("{place}.{at}"), found, expected, remedy))
    };
    if triangles.is_empty() {
        let found = format!("a mesh of {} vertices without triangles", vertices.len());
        return wrong("triangles".into(), found, "the triangles of a closed mesh".into());
    }
    if let Some(number) = vertices.iter().position(|vertex| !vertex.iter().all(|coordinate| coordinate.is_finite())) {
        let found = format!("{:?}", vertices[number]);
        return wrong(format!("vertices[{number}]"), found, "finite coordinates of a vertex of the mesh".into());
    }
    let known = |vertex: &u32| usize::try_from(*vertex).is_ok_and(|vertex| vertex < vertices.len());
    match triangles.iter().position(|triangle| !triangle.iter().all(known)) {
        None => Ok(()),
        Some(number) => wrong(
            format!("triangles[{number}]"),
            format!("the vertices {:?}", triangles[number]),
            format!("indices below {}, the number of vertices", vertices.len()),
        ),
    }
}

fn check_invertible(matrix: &Matrix, place: &str) -> Result<()> {
    if matrix_to_glam(matrix).determinant().abs() < 1e-30 {
        return Err(Error::new(
            place.to_owned(),
            "a matrix that cannot be inverted",
            "an invertible object transform",
            "Remove the zero scale of the object.",
        ));
    }
    Ok(())
}

/// Axes of a camera or light that looks along -z: z points to where it stands, by azimuth and elevation in degrees; x is level.
pub fn axes_from([azimuth, elevation]: [f64; 2]) -> glam::DMat3 {
    let (sine, cosine) = azimuth.to_radians().sin_cos();
    let (rise, level) = elevation.to_radians().sin_cos();
    let x = glam::DVec3::new(-sine, cosine, 0.0);
    let z = glam::DVec3::new(level * cosine, level * sine, rise);
    glam::DMat3::from_cols(x, z.cross(x), z)
}

/// Replaces the axes of a matrix and, if there is one, its place.
pub fn put_axes(matrix: &mut Matrix, axes: glam::DMat3, place: Option<glam::DVec3>) {
    for row in 0..3 {
        for column in 0..3 {
            matrix[row][column] = axes.col(column)[row] as f32;
        }
        if let Some(place) = place {
            matrix[row][3] = place[row] as f32;
        }
    }
}

/// Row-major f32 matrix as a `glam` f64 matrix.
pub fn matrix_to_glam(matrix: &Matrix) -> glam::DMat4 {
    let flat: Vec<f64> = matrix.iter().flatten().map(|&x| f64::from(x)).collect();
    glam::DMat4::from_cols_slice(&flat).transpose()
}

/// The same the other way round; each number is rounded.
pub fn matrix_from_glam(matrix: glam::DMat4) -> Matrix {
    matrix.transpose().to_cols_array_2d().map(|row| row.map(|number| number as f32))
}

/// JSON Schema of scene files, generated from these types.
pub fn schema() -> serde_json::Value {
    let mut value = schemars::schema_for!(Scene).to_value();
    value["title"] = "cloudparity scene".into();
    value
}

/// The graph of a graph file, or that of another scene file that holds one in place.
fn load_graph(path: &Path) -> Result<Graph> {
    let text = files::read_text(path, "the graph file that the scene names")?;
    let place = path.display().to_string();
    let value: serde_json::Value = parse(&text, &place, SCHEMA)?;
    if value.get("format").is_none() {
        return parse(&text, &place, SCHEMA);
    }
    match Scene::parse(&text, &place)?.graph {
        GraphSource::Inline(graph) => Ok(graph),
        GraphSource::File { file } => Err(Error::new(
            format!("{place}: $.graph.file"),
            format!("\"{file}\""),
            "the graph in place, in a scene whose graph another scene takes",
            "Name the file that holds the graph.",
        )),
    }
}

/// What files of scenes and graphs are expected to hold.
const SCHEMA: &str = "what the scene schema says (cloudparity schema prints it)";

/// Reads a document of the project. Errors tell line and column, or the JSON path, in `place`; `expected` says what it should be.
pub(crate) fn parse<T: serde::de::DeserializeOwned>(text: &str, place: &str, expected: &str) -> Result<T> {
    from_json(read_json(text, place)?, place, expected)
}

/// Reads JSON, with line and column in errors, and refuses numbers beyond the f32 range, which would otherwise turn into infinities
/// without a word.
fn read_json(text: &str, place: &str) -> Result<serde_json::Value> {
    let value = json::parse(text).map_err(|cause| {
        let message = cause.to_string();
        let (expected, remedy) = match message.starts_with(json::REPEATED) {
            true => ("every key once in an object", "Remove one of the two: which is meant cannot be told."),
            false => (
                "complete JSON with finite numbers (NaN and Infinity do not exist in JSON)",
                "Repair the file or export it again.",
            ),
        };
        Error::new(format!("{place}: line {}, column {}", cause.line(), cause.column()), message, expected, remedy)
    })?;
    check_numbers(&value, &mut String::from("$"), place)?;
    Ok(value)
}

fn from_json<T: serde::de::DeserializeOwned>(value: serde_json::Value, place: &str, expected: &str) -> Result<T> {
    serde_path_to_error::deserialize(value).map_err(|cause| {
        let path = cause.path().to_string();
        let message = cause.inner().to_string();
        Error::new(format!("{place}: $.{path}"), message, expected, "Correct the value at this path.")
    })
}

fn check_numbers(value: &serde_json::Value, path: &mut String, place: &str) -> Result<()> {
    let length = path.len();
    match value {
        serde_json::Value::Number(number)
            // Rounded first: the shortest decimal of the largest f32 lies above it.
            if !number.as_f64().is_some_and(|value| (value as f32).is_finite()) => {
                return Err(Error::new(
                    format!("{place}: {path}"),
                    number.to_string(),
                    "a finite number in the f32 range (magnitude at most 3.4028235e38)",
                    "Choose a finite value.",
                ));
            }
        serde_json::Value::Array(items) => {
            for (index, item) in items.iter().enumerate() {
                path.push_str(&format!("[{index}]"));
                check_numbers(item, path, place)?;
                path.truncate(length);
            }
        }
        serde_json::Value::Object(fields) => {
            for (key, item) in fields {
                path.push('.');
                path.push_str(key);
                check_numbers(item, path, place)?;
                path.truncate(length);
            }
        }
        _ => {}
    }
    Ok(())
}
