//! The system of a scene's own material, `graph`: its node graph as the density, with the extinction and albedo per channel and the phase
//! function that the material says. So a Blender material is seen as an engine would show it, beside what path tracing of the same
//! material shows.

use crate::base::error::{Error, Result};
use crate::base::recent::Recent;
use crate::engines::defects::Defects;
use crate::engines::domain::{Domain, DomainKind};
use crate::engines::light::terms::Terms;
use crate::engines::light::{
    LightModel, ShadowExtinction, ShadowLength, ShadowMapSettings, ShadowMarch, SourceFactor, TwoLobes,
};
use crate::engines::march::{Leftover, RealTimeSettings};
use crate::engines::parameters::{Parameter, Range};
use crate::engines::passes::compositing::Compositing;
use crate::engines::passes::god_rays::GodRays;
use crate::engines::{Engine, Model, Request};
use crate::media::density::Density;
use crate::media::density_cache::{CacheFilter, CacheFormat, DensityCache, Samples};
use crate::media::medium::Medium;
use crate::media::region::Region;
use crate::media::transfer::Integration;
use crate::scene::Scene;
use glam::DMat4;
use std::sync::Arc;

/// What group inputs and Value nodes are called whose number is the time of an animation, in seconds.
const TIME: &str = "Time";

/// The scene after some seconds: every stored number called Time is moved by them. An error where there is none.
pub fn at_time(scene: &Scene, seconds: f64) -> Result<Scene> {
    let mut moved = scene.clone();
    if seconds == 0.0 {
        return Ok(moved);
    }
    let times = scene
        .settable_numbers()
        .into_iter()
        .filter(|(name, label)| label == TIME || name.strip_suffix(".Value").is_some_and(|node| node == TIME));
    let mut count = 0;
    for (name, _) in times {
        let stored = scene.stored_number(&name).unwrap_or(0.0);
        moved.set(&format!("{name}={}", f64::from(stored) + seconds))?;
        count += 1;
    }
    if count == 0 {
        return Err(Error::new(
            "seconds",
            format!("{seconds} of a graph that reads no time"),
            format!("a stored number called {TIME}: of a Value node, or of an input of a node group"),
            format!("Leave the seconds out, or name the number that moves the cloud {TIME}."),
        ));
    }
    Ok(moved)
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
        name: "shadow_map",
        about: "texels along a side of a map of what lies towards the sun, which is read in the place of steps; 0: none",
        unit: "",
        range: Range::Whole(0, 4096),
        default: 0.0,
        usual: [0.0, 128.0],
    },
    Parameter {
        name: "shadow_layers",
        about: "layers of the map",
        unit: "",
        range: Range::Whole(1, 4096),
        default: 64.0,
        usual: [16.0, 128.0],
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
        ("shadow-map", &[("shadow_map", 64.0), ("shadow_layers", 64.0)]),
    ],
    defects: &[],
    is_of_scene: true,
    domains: &[DomainKind::Object, DomainKind::Slab, DomainKind::Shell],
    sky: None,
    build: engine,
};

/// Which cache it is: the density's program and where it is not empty, the object's frame, cells and format.
type CacheKey = (String, Region, DMat4, u32, CacheFormat);

/// The last caches: who changes the light, or looks from another place, has the same density again.
static CACHES: Recent<CacheKey, Density> = Recent::new(2);

/// A medium's density, read from a cache.
fn cached(medium: &Medium, cells: u32, format: CacheFormat) -> Result<Density> {
    let Medium { density, to_object, .. } = medium;
    let key = (density.program().content_hash(), density.occupied, *to_object, cells, format);
    if let Some(density) = CACHES.get(&key) {
        return Ok(density);
    }
    let samples = Samples::bake(density, to_object, cells, format, &|_| ())?;
    let cached = DensityCache::new(&samples, format, CacheFilter::Trilinear)?.density;
    CACHES.keep(key, cached.clone());
    Ok(cached)
}

/// The engine of a scene's own material.
fn engine(request: &Request<'_>) -> Result<Engine> {
    let values = request.values;
    let scene = &at_time(request.scene, request.seconds)?;
    let medium = Medium::new(scene)?;
    let container = request.domain_or(Domain::Object)?;
    if medium.emission != [0.0; 3] || medium.emission_of_density != [0.0; 3] {
        return Err(Error::new(
            format!("the material of object {}", scene.volume.object),
            "a medium that emits light",
            "one that scatters and absorbs: light models of engines know no emission",
            "Set the emission to 0, or give another integrator.",
        ));
    }
    let cells = values.get("cache_cells") as u32;
    let is_in_object = container.domain == Domain::Object;
    let density = if !is_in_object {
        if cells > 0 {
            return Err(Error::new(
                "parameter cache_cells",
                cells.to_string(),
                "0: a cache is of an object's box",
                "Leave the cache out, or take the domain of the object.",
            ));
        }
        Density::filling(Arc::clone(medium.density.program()), container.outline.region())
    } else if cells > 0 && !medium.density.occupied.is_empty() {
        cached(&medium, cells, FORMATS[values.get("cache_format") as usize])?
    } else {
        medium.density.clone()
    };
    let extinction = medium.extinction.map(|channel| channel * container.unit);
    // A channel without extinction scatters nothing.
    let albedo = std::array::from_fn(|channel| match medium.extinction[channel] {
        0.0 => 0.0,
        whole => medium.scattering[channel] / whole,
    });
    let [size, layers] = ["shadow_map", "shadow_layers"].map(|name| values.get(name) as u32);
    let march = ShadowMarch::new(values.get("light_steps") as u32, ShadowLength::ToExit, ShadowExtinction::View);
    // A map with layers has no march of its own.
    let map = (size > 0).then(|| ShadowMapSettings::new(size.max(2), 1, 1.0));
    let light = LightModel {
        suns: Vec::new(),
        ambient: [0.0; 3],
        phase: TwoLobes::new([medium.anisotropy; 2], 0.0),
        shadow: ShadowMarch { map, layers: if size > 0 { layers } else { 0 }, ..march },
        source: SourceFactor::Albedo(albedo),
        terms: Terms::NONE,
    };
    Ok(Engine {
        model: MODEL.id,
        defects: Defects::NONE,
        values: values.clone(),
        container,
        density,
        extinction,
        light,
        graph: None,
        terms: Vec::new(),
        passes: Vec::new(),
        march: RealTimeSettings {
            steps: values.get("march_steps") as u32,
            integration: Integration::EnergyConserving,
            growth: 1.0,
            exit_fade: false,
            least_density: 0.0,
            least_transmittance: 0.01,
            leftover: Leftover::Kept,
            distance_levels: None,
            doubled_start: false,
        },
        compositing: Compositing::default(),
        god_rays: GodRays::default(),
        warnings: Vec::new(),
        averages: std::sync::OnceLock::new(),
        light_volume: None,
        air: None,
    })
}
