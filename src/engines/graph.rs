//! The density of a scene's node graph as a density model: what engines' light models and marches take.
//!
//! As a model of its own, `graph`, it brings along what its material says: extinction and albedo per channel and one phase function.
//! So a Blender material is seen as an engine would show it, beside what path tracing of the same material shows.

use crate::base::error::{Error, Result};
use crate::engines::defects::Defects;
use crate::engines::light::terms::Terms;
use crate::engines::light::{LightModel, ShadowExtinction, ShadowLength, ShadowMarch, SourceFactor, TwoLobes};
use crate::engines::march::RealTimeSettings;
use crate::engines::parameters::{Parameter, Range, Values};
use crate::engines::passes::compositing::Compositing;
use crate::engines::passes::god_rays::GodRays;
use crate::engines::render::{box_of, container_side};
use crate::engines::{Build, Engine, Model};
use crate::gpu::ModelShader;
use crate::media::density::DensityModel;
use crate::media::density_cache::{CacheFilter, CacheFormat, CacheSettings};
use crate::media::medium::Medium;
use crate::media::transfer::Integration;
use crate::scene::Scene;
use glam::{DAffine3, DVec3};

/// The graph's density in the box of its volume.
pub struct GraphDensity {
    medium: Medium,
    from_box: DAffine3,
    extinction: [f64; 3],
}

impl GraphDensity {
    /// The density of a scene whose closures share one, under an extinction (per unit of it and side of the box) in the place of the
    /// material's own.
    pub fn new(scene: &Scene, extinction: [f64; 3]) -> Result<Self> {
        Self::of_medium(Medium::new(scene)?, scene, extinction)
    }

    fn of_medium(medium: Medium, scene: &Scene, extinction: [f64; 3]) -> Result<Self> {
        if let Some(name) = medium.density.attributes.first() {
            return Err(Error::new(
                format!("the density of scene {}", scene.name),
                format!("the attribute \"{name}\""),
                "a density of the place alone",
                "Take the attribute out of the graph.",
            ));
        }
        Ok(Self { medium, from_box: box_of(&scene.volume.bounds).inverse(), extinction })
    }

    /// The medium that it reads, in the object's frame.
    pub fn medium(&self) -> &Medium {
        &self.medium
    }

    /// Object-space positions of places of the local box.
    pub fn positions(&self, places: &[DVec3]) -> Vec<[f32; 3]> {
        places.iter().map(|&place| self.from_box.transform_point3(place).as_vec3().to_array()).collect()
    }
}

impl DensityModel for GraphDensity {
    fn densities(&self, places: &[DVec3]) -> Vec<f64> {
        // Where there is provably nothing, nothing is asked.
        let (asked, held): (Vec<usize>, Vec<[f32; 3]>) = self
            .positions(places)
            .into_iter()
            .enumerate()
            .filter(|(_, position)| self.medium.may_hold(DVec3::from(position.map(f64::from))))
            .unzip();
        let found = self.medium.densities(&held).expect("a density without attributes");
        let mut densities = vec![0.0; places.len()];
        for (index, value) in asked.into_iter().zip(found) {
            densities[index] = f64::from(value);
        }
        densities
    }

    fn extinction(&self) -> [f64; 3] {
        self.extinction
    }

    fn shader(&self) -> Result<ModelShader> {
        Err(Error::new(
            "density model graph on the adapter",
            "the density of a node graph",
            "a density model with a shader of its own: engines march graphs on the CPU",
            "March on the CPU.",
        )
        .with_setting("backend"))
    }
}

/// Formats of the density cache by their number in a parameter.
const FORMATS: [CacheFormat; 3] = [CacheFormat::F32, CacheFormat::F16, CacheFormat::Unorm8];

/// Parameters of the march through a graph's density.
pub const PARAMETERS: &[Parameter] = &[
    Parameter {
        name: "march_steps",
        about: "steps of a view ray",
        unit: "",
        range: Range::Whole(1, 100_000),
        default: 64.0,
        usual: [1.0, 256.0],
    },
    Parameter {
        name: "light_steps",
        about: "steps towards the sun",
        unit: "",
        range: Range::Whole(1, 1000),
        default: 6.0,
        usual: [1.0, 16.0],
    },
    Parameter {
        name: "cache_cells",
        about: "cells of a density cache along the longest side; 0 evaluates the graph at each place",
        unit: "cells",
        range: Range::Whole(0, 1024),
        default: 0.0,
        usual: [0.0, 128.0],
    },
    Parameter {
        name: "cache_format",
        about: "how the cache stores values: 0 in 32 bits, 1 in 16, 2 in 8",
        unit: "",
        range: Range::Whole(0, 2),
        default: 1.0,
        usual: [0.0, 2.0],
    },
];

/// The model under its name.
pub static MODEL: Model = Model {
    id: "graph",
    title: "The scene's own node graph and material",
    about: "The density of the scene's volume material, with its own extinction, albedo and phase function, marched as an engine \
            does: evaluated at each place, or read from a density cache.",
    parameters: PARAMETERS,
    qualities: &[
        ("low", &[("march_steps", 24.0), ("light_steps", 2.0), ("cache_cells", 48.0), ("cache_format", 2.0)]),
        ("medium", &[("march_steps", 48.0), ("light_steps", 4.0), ("cache_cells", 96.0), ("cache_format", 2.0)]),
        ("high", &[("march_steps", 96.0), ("light_steps", 8.0), ("cache_cells", 0.0)]),
    ],
    defects: &[],
    build: Build::OfScene(engine),
};

/// The engine of a scene's own material.
fn engine(scene: &Scene, values: &Values) -> Result<Engine> {
    let mut medium = Medium::new(scene)?;
    let side = container_side(scene)?;
    if medium.emission != [0.0; 3] || medium.emission_of_density != [0.0; 3] {
        return Err(Error::new(
            format!("the material of object {}", scene.volume.object),
            "a medium that emits light",
            "one that scatters and absorbs: light models of engines know no emission",
            "Set the emission to 0, or give another integrator.",
        ));
    }
    let cells = values.get("cache_cells") as u32;
    if cells > 0 && !medium.occupied.is_empty() {
        let format = FORMATS[values.get("cache_format") as usize];
        medium.read_from_cache(CacheSettings { cells, format, filter: CacheFilter::Trilinear })?;
    }
    let extinction = medium.extinction.map(|channel| channel * side);
    // A channel without extinction scatters nothing.
    let albedo = std::array::from_fn(|channel| match medium.extinction[channel] {
        0.0 => 0.0,
        whole => medium.scattering[channel] / whole,
    });
    let light = LightModel {
        sun_direction: [1.0; 3],
        sun: [1.0; 3],
        ambient: [0.0; 3],
        phase: TwoLobes { anisotropy: [medium.anisotropy; 2], second: 0.0 },
        shadow: ShadowMarch {
            steps: values.get("light_steps") as u32,
            length: ShadowLength::ToExit,
            extinction: ShadowExtinction::View,
        },
        source: SourceFactor::Albedo(albedo),
        terms: Terms::NONE,
    };
    Ok(Engine {
        model: MODEL.id,
        defects: Defects::NONE,
        values: values.clone(),
        density: Box::new(GraphDensity::of_medium(medium, scene, extinction)?),
        light,
        march: RealTimeSettings {
            steps: values.get("march_steps") as u32,
            integration: Integration::EnergyConserving,
            exit_fade: false,
            least_density: 0.0,
            least_transmittance: 0.01,
        },
        compositing: Compositing::default(),
        god_rays: GodRays::default(),
        warnings: Vec::new(),
        averages: std::sync::OnceLock::new(),
    })
}
