//! The seeded, baked, masked Perlin-FBM cloud of a published three.js engine. Its density is the node [`crate::nodes::perlin_fbm`].

pub mod defects;
pub mod gpu;
pub mod settings;

use crate::base::error::Result;
use crate::base::recent::Recent;
use crate::engines::domain::{Container, Domain, DomainKind, Outline};
use crate::engines::{Engine, Model, Request};
use crate::graph::Program;
use crate::media::density::Density;
use crate::nodes::perlin_fbm::{Cloud, PARAMETERS, TYPE};
use crate::nodes::{Data, Mode};
use std::sync::{Arc, OnceLock};

/// Extinction of the channels, relative to each other: blue is dimmed most.
pub const TINT: [f64; 3] = [0.6, 0.65, 0.7];

/// The model under its name.
pub static MODEL: Model = Model {
    id: "perlin-fbm",
    title: "Baked Perlin noise with a deformed-sphere mask",
    about: "The seeded cloud of a published three.js engine: octaves of gradient noise, made periodic, thresholded and baked to a \
            byte texture, tiled across a box, and masked by a flattened sphere that two more textures deform.",
    parameters: settings::PARAMETERS,
    qualities: settings::QUALITIES,
    defects: defects::DEFECTS,
    is_of_scene: false,
    domains: &[DomainKind::Object],
    sky: None,
    build: engine,
};

/// The last cloud: the next one often has its textures, which take a second and more.
static LAST: Recent<(), Cloud> = Recent::new(1);

fn engine(request: &Request<'_>) -> Result<Engine> {
    let Request { values, defects, .. } = *request;
    let container = request.domain_or(Domain::Object)?;
    let (parameters, warnings) = settings::parameters(values, defects, request.seconds)?;
    let opacity = settings::opacity(values)?;
    let cloud = Cloud::new_after(parameters, LAST.get(&()).as_ref())?;
    LAST.keep((), cloud.clone());
    Ok(Engine {
        model: MODEL.id,
        defects: defects.clone(),
        values: values.clone(),
        density: density(cloud, &container)?,
        container,
        extinction: TINT.map(|tint| tint * opacity),
        light: settings::light(values, defects),
        graph: None,
        terms: Vec::new(),
        passes: Vec::new(),
        march: settings::march(values, defects),
        compositing: settings::compositing(defects),
        god_rays: settings::god_rays(values, defects),
        warnings,
        averages: OnceLock::new(),
        light_volume: None,
        air: None,
    })
}

/// A cloud in the box of a container, whose z axis is the cloud's y axis and whose -y axis is its z axis.
pub fn density(cloud: Cloud, container: &Container) -> Result<Density> {
    Density::new(Arc::new(program(cloud, &container.outline)), container.outline.region())
}

/// The program of a cloud in the box of an outline.
fn program(cloud: Cloud, outline: &Outline) -> Program {
    let region = outline.region();
    let scale = 1.0 / (region.high - region.low);
    let middle = (region.high + region.low) / 2.0;
    let row = |axis: usize, sign: f64| {
        let mut row = [0.0; 4];
        row[axis] = (sign * scale[axis]) as f32;
        row[3] = (-sign * middle[axis] * scale[axis]) as f32;
        row
    };
    let mode = Mode::of_data(&TYPE, vec![(PARAMETERS, Data::PerlinFbm(Arc::new(cloud)))]);
    Program::of_node("Perlin-FBM cloud", &TYPE, mode, [row(0, 1.0), row(2, 1.0), row(1, -1.0)])
}
