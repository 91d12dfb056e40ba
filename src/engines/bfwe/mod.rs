//! bfwe-testbed: a shell of gradient noise around a planet. Its document gives the shape, parameters, steps, phase function and powder; the
//! density is the specification's.
//!
//! With the place p in planet radii from the centre, the height h in the shell, coverage c, b = 0.5 + 0.5 fbm(scale p) of four octaves:
//!
//! ```text
//! d = (b - (1 - c)) / c sat(h / 0.15) sat((1 - h) / 0.15),   d <- (d - e) / (1 - e),   e = 0.3 (1 - W(4 scale p))
//! density = k sat(d),   extinction = 400 density per planet radius
//! ```
//!
//! In an object's box the shell is a flat piece of itself: the box is as high as the shell is thick.

pub mod defects;

use crate::base::error::Result;
use crate::engines::defects::Defects;
use crate::engines::domain::{Container, Domain, DomainKind, Outline};
use crate::engines::frame::SlabFrame;
use crate::engines::light::terms::{Powder, Terms};
use crate::engines::light::{LightModel, ShadowExtinction, ShadowLength, ShadowMarch, SourceFactor, Sun, TwoLobes};
use crate::engines::march::RealTimeSettings;
use crate::engines::node_graph::{Input, NodeGraph};
use crate::engines::parameters::{Parameter, Range, Values, parameter};
use crate::engines::{Engine, GraphParts, Model, Request};
use crate::media::transfer::Integration;

const UNIT: Range = Range::Between(0.0, 1.0);

/// All parameters.
pub const PARAMETERS: &[Parameter] = &[
    parameter("density", 0.5, Range::NotNegative, [0.0, 2.0], "", "density of whole cloud"),
    parameter("coverage", 0.5, UNIT, [0.0, 1.0], "", "1 minus the threshold on the noise; 0 is no cloud"),
    parameter("scale", 10.0, Range::Positive, [1.0, 50.0], "cells per radius", "frequency of the noise"),
    parameter("cloud_height", 0.02, Range::NotNegative, [0.0, 0.1], "planet radii", "height of the base"),
    parameter("thickness", 0.01, Range::Positive, [0.001, 0.05], "planet radii", "from the base to the top"),
    parameter("march_steps", 32.0, Range::Whole(1, 100_000), [1.0, 128.0], "", "steps of a view ray"),
    parameter("light_steps", 6.0, Range::Whole(1, 1000), [1.0, 12.0], "", "steps towards the sun"),
    parameter("albedo", 1.0, UNIT, [0.0, 1.0], "", "single-scattering albedo"),
];

/// The model under its name.
pub static MODEL: Model = Model {
    id: "bfwe",
    title: "Shell of gradient noise around a planet (bfwe-testbed)",
    about: "Four octaves of gradient noise above a coverage threshold between two spheres, eroded by cells; single scattering of two lobes \
            with powder. In an object it is a flat piece of the shell.",
    parameters: PARAMETERS,
    qualities: &[("low", &[("march_steps", 16.0), ("light_steps", 3.0)]), ("published", &[("march_steps", 32.0)])],
    defects: defects::DEFECTS,
    is_of_scene: false,
    domains: &[DomainKind::Object, DomainKind::Shell],
    sky: None,
    build: engine,
};

/// Extinction per planet radius and unit of density.
const EXTINCTION: f64 = 400.0;

/// Sum of the amplitudes of four octaves that begin with a half.
const AMPLITUDES: f64 = 0.9375;

fn engine(request: &Request<'_>) -> Result<Engine> {
    let Request { values, defects, .. } = *request;
    let container = request.domain_or(Domain::Object)?;
    let mut graph = NodeGraph::default();
    let (place, height, unit) = placed(&mut graph, &container, values);
    let density = density(&mut graph, &place, &height, values);
    let integration = match defects.has(&defects::PLAIN_SUM) {
        true => Integration::Plain,
        false => Integration::EnergyConserving,
    };
    let march = RealTimeSettings::until_one_percent(values.get("march_steps"), integration);
    let light = light(values, defects, unit);
    let extinction = [EXTINCTION * unit; 3];
    request.engine_of_graph(MODEL.id, GraphParts { container, graph, density, extinction, light, march })
}

/// The place in planet radii, the height as a part of the shell's, and planet radii in the engine's unit of length.
fn placed(graph: &mut NodeGraph, container: &Container, values: &Values) -> (Input, Input, f64) {
    let base = 1.0 + values.get("cloud_height");
    match container.outline {
        Outline::Shell { inner, outer } => {
            // The sphere that was asked for is the shell's base.
            let radius = inner / base;
            let own = graph.place();
            let place = graph.affine(&own, [1.0 / radius; 3], [0.0; 3]);
            let length = graph.length(&own);
            let height = graph.remap(&length, [inner.into(), outer.into()], [0.0, 1.0], false);
            (place, height, container.unit / radius)
        }
        _ => {
            let frame = SlabFrame::new(container, base, base + values.get("thickness"));
            let (place, height) = frame.place(graph);
            (place, height, frame.unit)
        }
    }
}

fn density(graph: &mut NodeGraph, place: &Input, height: &Input, values: &Values) -> Input {
    let coverage = values.get("coverage");
    if coverage <= 0.0 {
        return 0.0.into();
    }
    let scale = values.get("scale");
    let noise = graph.gradient_noise(place, scale, 4);
    let noise = graph.multiply_add(noise, AMPLITUDES, 0.5 * (1.0 - AMPLITUDES));
    let shape = graph.remap(&noise, [(1.0 - coverage).into(), 1.0.into()], [0.0, 1.0], false);
    let profile = graph.trapezoid(height);
    let shape = graph.multiply(shape, profile);
    let cells = graph.cells(place, 4.0 * scale);
    let eroded_from = graph.multiply_add(cells, -0.3, 0.3);
    let eroded = graph.remap(&shape, [eroded_from, 1.0.into()], [0.0, 1.0], false);
    let whole = graph.multiply_clamped(eroded, 1.0);
    graph.multiply(whole, values.get("density"))
}

/// The engine's light; `unit` is planet radii in the engine's unit of length.
fn light(values: &Values, kept: &Defects, unit: f64) -> LightModel {
    let longest = 3.0 * values.get("thickness") / unit;
    let powder = if kept.has(&defects::POWDER) { 1.0 } else { 0.0 };
    LightModel {
        suns: vec![Sun { direction: [1.0, 0.5, 0.3], irradiance: [1.5; 3] }],
        ambient: [0.05, 0.07, 0.1],
        phase: TwoLobes::new([-0.2, 0.6], 0.7),
        shadow: ShadowMarch::new(
            values.get("light_steps") as u32,
            ShadowLength::ToExitAtMost(longest),
            ShadowExtinction::View,
        ),
        source: SourceFactor::Albedo([values.get("albedo"); 3]),
        terms: Terms {
            powder: Powder { strength: powder, length: 2.0 / (EXTINCTION * unit), ambient: 0.0 },
            ..Terms::NONE
        },
    }
}
