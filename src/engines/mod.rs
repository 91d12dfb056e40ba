//! Cloud engines: density x domain x light x march x passes.
//!
//! An engine is put together from parts that combine freely: a density (a program), the [`domain`] that it fills, a light model
//! ([`light`]), a march ([`march`]) and passes over the finished picture ([`passes`]). A published system is one folder that names its
//! parts, its parameters, its presets and its defects; the scene's own material is one of them ([`graph`]).

pub mod best;
pub mod bfwe;
pub mod bolt;
pub mod bundle;
pub mod clusters;
pub mod defects;
pub mod domain;
pub mod frame;
mod frame_kernel;
pub mod graph;
pub mod light;
pub mod march;
pub mod node_graph;
pub mod parameters;
pub mod passes;
pub mod perlin_fbm;
pub mod reconstruction;
pub mod render;
pub mod skill;
pub mod sky;
pub mod takram;

use crate::base::error::{Error, Result};
use crate::engines::defects::{Defect, Defects};
use crate::engines::domain::{Container, Domain, DomainKind, Outline};
use crate::engines::light::{LightModel, LightTerm, SourceFactor};
use crate::engines::march::air::Air;
use crate::engines::march::light_volume::ReadVolume;
use crate::engines::march::{Marched, RealTimeSettings};
use crate::engines::node_graph::{GraphDensity, Input, NodeGraph};
use crate::engines::passes::Pass;
use crate::engines::passes::compositing::Compositing;
use crate::engines::passes::god_rays::GodRays;
use crate::media::averages::Averages;
use crate::media::density::Density;
use crate::media::light_volume::LightVolume;
use crate::media::objects::ObjectMedium;
use crate::scene::Scene;
use std::sync::{Arc, OnceLock, PoisonError, RwLock};

/// A cloud system by name: of a published engine, or a scene's own.
pub struct Model {
    /// Name on the command line.
    pub id: &'static str,
    /// Name in words.
    pub title: &'static str,
    /// What it is, in a sentence or two.
    pub about: &'static str,
    /// Its parameters.
    pub parameters: &'static [parameters::Parameter],
    /// Levels of quality: a name, and the parameters that it sets.
    pub qualities: &'static [(&'static str, &'static [(&'static str, f64)])],
    /// What the original does wrong and can be kept, in the order of their numbers.
    pub defects: &'static [Defect],
    /// Whether the density is that of the scene's own material.
    pub is_of_scene: bool,
    /// Domains that its density knows; the first is its own where none is asked for.
    pub domains: &'static [DomainKind],
    /// Its sky, where it has one.
    pub sky: Option<&'static sky::Sky>,
    /// How it is put together.
    pub build: fn(&Request<'_>) -> Result<Engine>,
}

/// What an engine is asked for.
pub struct Request<'a> {
    /// The scene that it is put into.
    pub scene: &'a Scene,
    /// Its parameters.
    pub values: &'a parameters::Values,
    /// The defects that it keeps, those of the system alone.
    pub defects: &'a Defects,
    /// Seconds of animation.
    pub seconds: f64,
    /// The domain, placed in the scene; none where nobody asked for one.
    pub domain: Option<Container>,
}

impl Request<'_> {
    /// The domain that was asked for, else another one.
    pub fn domain_or(&self, own: Domain) -> Result<Container> {
        self.domain.clone().map_or_else(|| own.place(self.scene), Ok)
    }

    /// An engine whose density is a node graph, without passes.
    pub fn engine_of_graph(&self, model: &'static str, parts: GraphParts) -> Result<Engine> {
        let GraphParts { container, graph, density, extinction, light, march } = parts;
        let graph = GraphDensity { graph, density };
        let program = Arc::new(graph.program(model, self.scene)?);
        let region = container.outline.region();
        Ok(Engine {
            model,
            defects: self.defects.clone(),
            values: self.values.clone(),
            density: match container.outline {
                // Its cells would be as large as a planet.
                Outline::Shell { .. } => Density::filling(program, region),
                _ => Density::new(program, region)?,
            },
            container,
            extinction,
            light,
            graph: Some(graph),
            terms: Vec::new(),
            passes: Vec::new(),
            march,
            compositing: Compositing::default(),
            god_rays: GodRays::default(),
            warnings: Vec::new(),
            averages: OnceLock::new(),
            light_volume: None,
            air: None,
        })
    }
}

/// What an engine whose density is a node graph is put together from.
pub struct GraphParts {
    /// Where it is.
    pub container: Container,
    /// The nodes.
    pub graph: NodeGraph,
    /// The one that gives the density.
    pub density: Input,
    /// Extinction per unit of density and of length, per channel.
    pub extinction: [f64; 3],
    /// The light.
    pub light: LightModel,
    /// The march.
    pub march: RealTimeSettings,
}

/// An engine, put together.
pub struct Engine {
    /// Name of the model.
    pub model: &'static str,
    /// The defects that it keeps, as a list.
    pub defects: Defects,
    /// The parameters that it was built from.
    pub values: parameters::Values,
    /// Where its density is.
    pub container: Container,
    /// The density, in the frame of the container.
    pub density: Density,
    /// The density as a node graph, where it is one.
    pub graph: Option<GraphDensity>,
    /// Extinction of a view ray per unit of density and of length, per channel.
    pub extinction: [f64; 3],
    /// The engine's light; a scene brings its own suns and world.
    pub light: LightModel,
    /// Terms of the light that are the system's own.
    pub terms: Vec<Arc<dyn LightTerm>>,
    /// How the engine marches.
    pub march: RealTimeSettings,
    /// How its pixels are put over a background.
    pub compositing: Compositing,
    /// Passes over every picture.
    pub passes: Vec<Arc<dyn Pass>>,
    /// The engine's god rays, a pass where a picture asks for it.
    pub god_rays: GodRays,
    /// What is to be said about the parameters.
    pub warnings: Vec<String>,
    /// Averages of the density, made when a light model asks for them.
    pub averages: OnceLock<Averages>,
    /// Light of all suns behind the first order of scattering, and of the world: what path tracing found in this cloud under the lights of a
    /// scene, for its pictures alone. In its place no ambient light counts.
    pub light_volume: Option<Arc<LightVolume>>,
    /// Air between the eye and the cloud, where the engine has some.
    pub air: Option<Air>,
}

impl Engine {
    /// Averages of the density.
    pub fn averages(&self) -> Result<&Averages> {
        if let Some(known) = self.averages.get() {
            return Ok(known);
        }
        let made = Averages::of(&self.density)?;
        Ok(self.averages.get_or_init(|| made))
    }

    /// What a march goes through, under a light; averages are made where it reads them, shadow maps are not.
    pub fn marched<'a>(&'a self, light: &'a LightModel) -> Result<Marched<'a>> {
        let averages = if light.terms.needs_coarse() { Some(self.averages()?) } else { None };
        let Self { container, density, extinction, terms, .. } = self;
        let light_volume = self.light_volume.as_deref().map(|volume| ReadVolume::new(volume, light));
        let air = self.air.as_ref();
        Ok(Marched {
            container,
            density,
            extinction: *extinction,
            averages,
            maps: &[],
            light,
            terms,
            light_volume,
            air,
        })
    }

    /// Extinction and scattering per unit of density and metre, for light transport. An error where the source is no albedo times
    /// extinction, or where the domain is no object.
    fn coefficients(&self) -> Result<[[f64; 3]; 2]> {
        let wrong = |found: &str, expected: &str, remedy: &str| {
            Err(Error::new(format!("the medium of model {}", self.model), found, expected, remedy))
        };
        let SourceFactor::Albedo(albedo) = self.light.source else {
            return wrong(
                "a source that is no albedo times extinction",
                "one that has an albedo",
                "Leave out the defect that takes it away.",
            );
        };
        if albedo.iter().any(|&channel| channel > 1.0) {
            return wrong(
                "an albedo above 1: light that comes from nowhere",
                "an albedo of at most 1",
                "Leave out the defect that makes it.",
            );
        }
        if self.container.domain != Domain::Object {
            return wrong("a domain without end", "an object", "Take the domain of the object.");
        }
        let extinction = self.extinction.map(|channel| channel / self.container.unit);
        Ok([extinction, std::array::from_fn(|channel| extinction[channel] * albedo[channel])])
    }

    /// The scene with the system's cloud as the material of its only volume, which any renderer takes that knows the nodes: the light
    /// transport that the light model stands for, as in [`Self::medium`].
    pub fn scene(&self, scene: &Scene) -> Result<Scene> {
        let Some(graph) = &self.graph else {
            return Err(Error::new(
                format!("model {}", self.model),
                "a density that is no node graph",
                "a density made of nodes, as that of bolt",
                "Take an OpenVDB grid of it, or another model.",
            ));
        };
        let [extinction, scattering] = self.coefficients()?;
        let material = graph.material(self.model, extinction, scattering, &self.light.phase.lobes())?;
        Ok(node_graph::scene_of(scene, material))
    }

    /// The medium as path tracing knows it: the light transport that the light model stands for. An error where it has none, because the
    /// source is no albedo times extinction, or where the domain is no object.
    pub fn medium(&self) -> Result<ObjectMedium> {
        let [extinction, scattering] = self.coefficients()?;
        let lobes = self.light.phase.lobes();
        let Container { to_local, outline, .. } = &self.container;
        let mesh = if let Outline::Mesh(mesh) = outline { Some(Arc::clone(mesh)) } else { None };
        let medium = ObjectMedium::of_density(self.model, *to_local, &self.density, extinction, scattering, &lobes);
        Ok(medium.in_mesh(mesh))
    }

    /// Everything that [`Self::medium`] depends on besides the scene, as text.
    pub fn medium_identity(&self) -> String {
        let values: Vec<String> = self.values.iter().map(|(name, value)| format!("{name}={value}")).collect();
        format!(
            "{} defects {} {} extinction {:?} source {:?} phase {:?} domain {}",
            self.model,
            self.defects,
            values.join(" "),
            self.extinction,
            self.light.source,
            self.light.phase,
            self.container.domain
        )
    }

    /// The same engine with another density in the same domain; a light volume stays, as the light is that of the same cloud.
    pub fn with_density(&self, density: Density) -> Self {
        Self {
            density,
            defects: self.defects.clone(),
            values: self.values.clone(),
            container: self.container.clone(),
            light: self.light.clone(),
            // It is that of the other density.
            graph: None,
            terms: self.terms.clone(),
            passes: self.passes.clone(),
            march: self.march.clone(),
            warnings: self.warnings.clone(),
            averages: OnceLock::new(),
            light_volume: self.light_volume.clone(),
            ..*self
        }
    }
}

/// Systems that were added at run time.
static REGISTERED: RwLock<Vec<&'static Model>> = RwLock::new(Vec::new());

/// All models: those of this program, and then those that [`register`] has added.
pub fn models() -> Vec<&'static Model> {
    static MODELS: [&Model; 8] = [
        &graph::MODEL,
        &perlin_fbm::MODEL,
        &bolt::MODEL,
        &best::MODEL,
        &bfwe::MODEL,
        &takram::MODEL,
        &skill::MODEL,
        &clusters::MODEL,
    ];
    let added = REGISTERED.read().unwrap_or_else(PoisonError::into_inner);
    MODELS.iter().chain(added.iter()).copied().collect()
}

/// Adds a system of another crate. Its name, and the names of its defects, must be new.
pub fn register(model: &'static Model) -> Result<()> {
    let taken = |what: &str, name: &str| {
        Err(Error::new(format!("system {name}"), format!("{what} that is taken"), "a new name", "Choose another."))
    };
    if models().iter().any(|known| known.id == model.id) {
        return taken("a name", model.id);
    }
    let known = models();
    let known = known.iter().flat_map(|model| model.defects).map(|defect| defect.id);
    if let Some(defect) = known.into_iter().find(|id| model.defects.iter().any(|defect| defect.id == *id)) {
        return taken("the name of a defect", defect);
    }
    REGISTERED.write().unwrap_or_else(PoisonError::into_inner).push(model);
    Ok(())
}

/// A model by its name.
pub fn find(id: &str) -> Result<&'static Model> {
    models().into_iter().find(|model| model.id == id).ok_or_else(|| {
        let known: Vec<&str> = models().iter().map(|model| model.id).collect();
        Error::new("density model", format!("\"{id}\""), format!("one of {}", known.join(", ")), "Correct the name.")
    })
}

/// A model by its name with parameters of it: `perlin-fbm coverage=0.4 octaves=3`, as files and axes of studies name densities.
pub struct Selection {
    /// The model.
    pub model: &'static Model,
    /// Its parameters, `NAME=VALUE`.
    pub settings: Vec<String>,
}

impl Selection {
    /// Reads a text. An error where the model, a parameter or its value is not known.
    pub fn parse(text: &str) -> Result<Self> {
        let mut words = text.split_whitespace();
        let model = find(words.next().unwrap_or_default())?;
        let settings: Vec<String> = words.map(str::to_owned).collect();
        model.values(None, &settings)?;
        Ok(Self { model, settings })
    }

    /// Its engine in a scene with further parameters, which count after its own.
    pub fn engine(&self, scene: &Scene, further: &[String], defects: &Defects) -> Result<Engine> {
        self.engine_at(scene, further, defects, 0.0)
    }

    /// The same after `seconds` of animation.
    pub fn engine_at(&self, scene: &Scene, further: &[String], defects: &Defects, seconds: f64) -> Result<Engine> {
        let values = self.model.values(None, &[self.settings.as_slice(), further].concat())?;
        self.model.engine(scene, &values, defects, seconds)
    }
}

impl Model {
    /// Whether it has a parameter of this name.
    pub fn has_parameter(&self, name: &str) -> bool {
        self.parameters.iter().any(|parameter| parameter.name == name)
    }

    /// Its engine for a scene, after `seconds` of animation, in its own domain. An error where a defect to be kept is not the model's.
    pub fn engine(
        &self,
        scene: &Scene,
        values: &parameters::Values,
        defects: &Defects,
        seconds: f64,
    ) -> Result<Engine> {
        self.engine_in(None, scene, values, defects, seconds)
    }

    /// The same in another domain, which the density must know.
    pub fn engine_in(
        &self,
        domain: Option<Domain>,
        scene: &Scene,
        values: &parameters::Values,
        defects: &Defects,
        seconds: f64,
    ) -> Result<Engine> {
        let defects = &defects.of_model(self)?;
        if let Some(domain) = domain.filter(|domain| !self.domains.contains(&domain.kind())) {
            let known: Vec<String> = self.domains.iter().map(DomainKind::to_string).collect();
            return Err(Error::new(
                format!("domain {domain}"),
                format!("a domain that the density of {} does not know", self.id),
                format!("one of {}", known.join(", ")),
                "Take another domain, or another model.",
            ));
        }
        let domain = domain.map(|domain| domain.place(scene)).transpose()?;
        (self.build)(&Request { scene, values, defects, seconds, domain })
    }

    /// The default values, changed by a level of quality (or several, `high,cirrus`, one after the other) and by texts `NAME=VALUE`, in this
    /// order.
    pub fn values(&self, quality: Option<&str>, texts: &[String]) -> Result<parameters::Values> {
        let mut values = parameters::Values::defaults(self.parameters);
        for wanted in quality.iter().flat_map(|names| names.split(',')).map(str::trim) {
            let Some((_, settings)) = self.qualities.iter().find(|(name, _)| *name == wanted) else {
                let known: Vec<&str> = self.qualities.iter().map(|(name, _)| *name).collect();
                return Err(Error::new(
                    "level of quality",
                    format!("\"{wanted}\""),
                    format!("one of {}", known.join(", ")),
                    "Correct the name.",
                )
                .with_setting("quality"));
            };
            for &(name, value) in *settings {
                values.set(self.parameters, name, value, "a level of quality")?;
            }
        }
        values.set_texts(self.parameters, texts)?;
        Ok(values)
    }
}
