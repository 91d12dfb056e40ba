//! bestclouds(faster): a box of tiling noise below a map of three discs.
//!
//! In published units (y up, the box |x|, |z| at most E and 0 to E high, E = 1000), with the height h above the base as a part of the cloud's
//! thickness, which follows the map, m = map fade(edges) and A the noise ([`crate::nodes::cloud_texture`]):
//!
//! ```text
//! m' = m smooth(0, bottom, h) (1 - smooth(1 - top, 1, h))
//! m'' = ( m' - s ) / (1 - s),   s = a (1 - A(0.05 p))        then the same with d = b A(0.3 p) in place of s
//! extinction = density x m'' per unit
//! ```
//!
//! In a container of other proportions the noise keeps its scale, which follows the height; map and edges follow the sides.

pub mod defects;

use crate::base::error::Result;
use crate::engines::defects::Defects;
use crate::engines::domain::{Domain, DomainKind};
use crate::engines::frame::SlabFrame;
use crate::engines::light::terms::{Octaves, Terms};
use crate::engines::light::{
    LightModel, ShadowExtinction, ShadowLength, ShadowMarch, ShadowSample, SourceFactor, Sun, TwoLobes,
};
use crate::engines::march::{Leftover, RealTimeSettings};
use crate::engines::node_graph::{Input, NodeGraph};
use crate::engines::parameters::{Parameter, Range, Values, parameter};
use crate::engines::{Engine, GraphParts, Model, Request};
use crate::media::transfer::Integration;
use crate::nodes::cloud_texture::bakes::FeaturePoints;
use std::f64::consts::PI;

const UNIT: Range = Range::Between(0.0, 1.0);

const SPEED: &str = "units/s";

/// All parameters.
pub const PARAMETERS: &[Parameter] = &[
    parameter("density", 0.075, Range::NotNegative, [0.01, 0.5], "1/unit", "extinction where the noise is 1"),
    parameter("shape_speed", -5.0, Range::Any, [-20.0, 20.0], SPEED, "of the shape's noise along x"),
    parameter("detail_speed", -10.0, Range::Any, [-30.0, 30.0], SPEED, "of the detail's along x, and half along z"),
    parameter("shape_strength", 0.7, UNIT, [0.0, 1.0], "", "what the shape's noise takes away"),
    parameter("detail_strength", 0.2, UNIT, [0.0, 1.0], "", "what the detail's noise takes away"),
    parameter("base", 0.0, UNIT, [0.0, 1.0], "", "of the cloud, as a part of the box"),
    parameter("thickness", 1.0, UNIT, [0.0, 1.0], "", "where the map is 1, as a part of the box"),
    parameter("bottom_fade", 0.08, UNIT, [0.0, 0.3], "", "part of the thickness; 0 is a sharp base"),
    parameter("top_fade", 0.12, UNIT, [0.0, 0.3], "", "part of the thickness; 0 is a sharp top"),
    parameter("edge_fade", 0.10, UNIT, [0.0, 0.3], "", "part of half the box's width; 0 is a sharp side"),
    parameter("shape_size", 0.05, Range::Positive, [0.01, 0.2], "1/unit", "texels of the shape's noise"),
    parameter("detail_size", 0.3, Range::Positive, [0.05, 1.0], "1/unit", "texels of the detail's noise"),
    parameter("march_steps", 64.0, Range::Whole(1, 100_000), [8.0, 128.0], "", "steps of a view ray"),
    parameter("light_steps", 10.0, Range::Whole(1, 1000), [1.0, 12.0], "", "steps towards the sun"),
];

/// Levels of quality.
const QUALITIES: &[(&str, &[(&str, f64)])] = &[
    ("full", &[("march_steps", 64.0), ("light_steps", 10.0)]),
    ("fast", &[("march_steps", 32.0), ("light_steps", 8.0)]),
];

/// The model under its name.
pub static MODEL: Model = Model {
    id: "best",
    title: "Noise atlas in a box (bestclouds, faster)",
    about: "A box of tiling Perlin-Worley noise, cut out of a map of three discs that also gives its thickness; four octaves of single \
            scattering with powder of the light ray.",
    parameters: PARAMETERS,
    qualities: QUALITIES,
    defects: defects::DEFECTS,
    is_of_scene: false,
    domains: &[DomainKind::Object],
    sky: None,
    build: engine,
};

/// Height of the box in published units.
const HEIGHT: f64 = 1000.0;

/// Texels of the noise along x, z and the height.
const TEXELS: [f64; 3] = [32.0, 32.0, 36.0];

fn engine(request: &Request<'_>) -> Result<Engine> {
    let Request { values, defects, seconds, .. } = *request;
    let container = request.domain_or(Domain::Object)?;
    let frame = SlabFrame::new(&container, 0.0, HEIGHT);
    let region = container.outline.region();
    let sides = (region.high - region.low) / 2.0;
    let halves = [sides.x * frame.scale[0], sides.y * frame.scale[1]];
    let mut graph = NodeGraph::default();
    let density = density(&mut graph, &frame, halves, values, defects, seconds);
    let march = RealTimeSettings::until_one_percent(values.get("march_steps"), Integration::EnergyConserving);
    let leftover = if defects.has(&defects::LOST_TRANSMITTANCE) { Leftover::Dropped } else { Leftover::Kept };
    request.engine_of_graph(
        MODEL.id,
        GraphParts {
            container,
            graph,
            density,
            extinction: [values.get("density") * frame.unit; 3],
            light: light(values, defects),
            march: RealTimeSettings { leftover, ..march },
        },
    )
}

/// The density of the box; `halves` are half its sides along x and z, in published units.
fn density(
    graph: &mut NodeGraph,
    frame: &SlabFrame,
    halves: [f64; 2],
    values: &Values,
    kept: &Defects,
    seconds: f64,
) -> Input {
    let get = |name: &str| values.get(name);
    let (place, _) = frame.place(graph);
    let [x, y, z] = graph.separate(&place);
    let [u, v] = [(&x, halves[0]), (&z, halves[1])].map(|(coordinate, half)| graph.multiply(coordinate, 1.0 / half));
    let mut covered = cloud_map(graph, &u, &v);
    if get("edge_fade") > 0.0 {
        let [u, v] = [u, v].map(|part| graph.math("ABSOLUTE", &[part]));
        let edge = graph.maximum(u, v);
        let outside = graph.smooth(1.0 - get("edge_fade"), 1.0, &edge);
        let inside = graph.subtract(1.0, outside);
        covered = graph.multiply(covered, inside);
    }
    let base = get("base") * HEIGHT;
    let thickness = graph.multiply(&covered, HEIGHT * get("thickness").max(0.001));
    let thickness = graph.maximum(thickness, 0.001);
    let top = graph.add(thickness, base);
    let height = graph.remap(&y, [base.into(), top], [0.0, 1.0], false);
    let rise = match get("bottom_fade") {
        0.0 => graph.math("GREATER_THAN", &[height.clone(), 0.0.into()]),
        fade => graph.smooth(0.0, fade, &height),
    };
    let fall = match get("top_fade") {
        0.0 => graph.math("LESS_THAN", &[height.clone(), 1.0.into()]),
        fade => graph.fall(1.0 - fade, 1.0, &height),
    };
    let profile = graph.multiply(rise, fall);
    let covered = graph.multiply(covered, profile);
    let half_a_texel = if kept.has(&defects::SHIFTED_SLICES) { 0.5 } else { 0.0 };
    // The height is the slice axis.
    let turned = graph.combine([x, z, y]);
    let noise = |graph: &mut NodeGraph, size: f64, shift: [f64; 3]| {
        let factor: [f64; 3] = TEXELS.map(|texels| size / texels);
        let mut added: [f64; 3] = std::array::from_fn(|axis| factor[axis] * shift[axis]);
        added[2] += half_a_texel / TEXELS[2];
        let at = graph.affine(&turned, factor, added);
        graph.cloud_texture("BEST_NOISE", FeaturePoints::Even, &at)
    };
    let shape = noise(graph, get("shape_size"), [get("shape_speed") * seconds, 0.0, 0.0]);
    let moved = get("detail_speed") * seconds;
    let detail = noise(graph, get("detail_size"), [moved, 0.5 * moved, 0.0]);
    let strength = get("shape_strength");
    let taken = graph.multiply_add(shape, -strength, strength);
    let covered = graph.remap(&covered, [taken, 1.0.into()], [0.0, 1.0], true);
    let taken = graph.multiply(detail, get("detail_strength"));
    graph.remap(&covered, [taken, 1.0.into()], [0.0, 1.0], true)
}

/// The largest of three discs, over the box from -1 to 1.
fn cloud_map(graph: &mut NodeGraph, u: &Input, v: &Input) -> Input {
    // uv = 0.5 + p / (4 E), of which the first disc takes 5 (uv - 0.5); each later one is finer.
    let mut largest: Option<Input> = None;
    for (scale, offset, height) in [(1.25, 0.0, 1.0), (1.25 * 1.2, 0.65, 0.8), (1.25 * 1.2 * 1.3, -0.75, 0.75)] {
        let [a, b] = [u, v].map(|part| graph.multiply_add(part, scale, offset));
        let at = graph.combine([a, b, 0.0.into()]);
        let distance = graph.length(&at);
        let near = graph.subtract(1.0, distance);
        let near = graph.maximum(near, 0.0);
        let lack = graph.subtract(2.0, &near);
        let square = graph.multiply(lack, near);
        let disc = graph.math("SQRT", &[square]);
        let disc = graph.multiply(disc, height);
        largest = Some(match largest {
            None => disc,
            Some(largest) => graph.maximum(largest, disc),
        });
    }
    largest.unwrap_or(Input::Number(0.0))
}

/// The engine's light.
fn light(values: &Values, kept: &Defects) -> LightModel {
    let lobes = TwoLobes::new([-0.1, 0.3], 0.7);
    let twice = kept.has(&defects::PHASE_TWICE).then_some([-0.3, 0.3]);
    let sample = if kept.has(&defects::LEFT_ENDS) { ShadowSample::Left } else { ShadowSample::Middle };
    let by_angle = if kept.has(&defects::DEPTH_BY_ANGLE) { 0.25 } else { 0.0 };
    LightModel {
        suns: vec![Sun { direction: [0.417, 0.558, 0.717], irradiance: [200.0 / (4.0 * PI); 3] }],
        ambient: [0.04; 3],
        phase: TwoLobes { again: twice, ..lobes },
        shadow: ShadowMarch {
            sample,
            by_angle,
            ..ShadowMarch::new(values.get("light_steps") as u32, ShadowLength::ToExit, ShadowExtinction::View)
        },
        source: SourceFactor::Albedo([1.0; 3]),
        terms: Terms {
            octaves: Octaves { count: 4, contribution: 0.5, attenuation: 0.25, eccentricity: 0.5, compression: 0.0 },
            ambient: [0.0, 1.0],
            ray_powder: true,
            ..Terms::NONE
        },
    }
}
