//! Mesh clusters of the procedural-clouds skill as a density: clouds of 25 soft ellipsoids each, heaps, layers and streaks.
//!
//! The original draws them as translucent spheres, which scatter nothing. Here (as in the specification) they are a medium: what all ellipsoids
//! leave together, [`crate::nodes::ellipsoid_clusters`], times an extinction of 0.2 per metre, under the skill's light march and its two lobes.
//! Its motion is corrected: each cloud moves once, along z around a square (SK-9).

pub mod defects;

use crate::base::error::Result;
use crate::engines::domain::DomainKind;
use crate::engines::frame::SlabFrame;
use crate::engines::light::terms::Terms;
use crate::engines::light::{LightModel, ShadowExtinction, ShadowMarch, SourceFactor, Sun, TwoLobes};
use crate::engines::march::RealTimeSettings;
use crate::engines::node_graph::{ClusterField, NodeGraph};
use crate::engines::parameters::{Parameter, Range, parameter};
use crate::engines::{Engine, GraphParts, Model, Request};
use crate::media::transfer::Integration;

/// All parameters.
pub const PARAMETERS: &[Parameter] = &[
    parameter("seed", 0.0, Range::Whole(0, 1_000_000), [0.0, 1000.0], "", "which clouds"),
    parameter("spread", 500.0, Range::Positive, [100.0, 1500.0], "m", "side of the square on which they stand"),
    parameter("base", 80.0, Range::Any, [0.0, 100.0], "m", "least height of their middles"),
    parameter("bottom", 70.0, Range::Any, [0.0, 80.0], "m", "height of the domain's lower face"),
    parameter("thickness", 60.0, Range::Positive, [30.0, 200.0], "m", "to the domain's upper face"),
    parameter(
        "speed",
        1.0,
        Range::Any,
        [-10.0, 10.0],
        "",
        "factor on the motion of 0.1 m/s along z and 5 m to and fro along x",
    ),
    parameter("extinction", 0.2, Range::NotNegative, [0.01, 1.0], "1/m", "at a density of 1"),
    parameter("albedo", 1.0, Range::Between(0.0, 1.0), [0.0, 1.0], "", "single-scattering albedo"),
    parameter("march_steps", 64.0, Range::Whole(1, 100_000), [8.0, 128.0], "", "steps of a view ray"),
    parameter("light_steps", 6.0, Range::Whole(1, 1000), [1.0, 8.0], "", "steps towards the sun"),
];

/// The model under its name.
pub static MODEL: Model = Model {
    id: "clusters",
    title: "Mesh clusters (procedural-clouds skill)",
    about: "Thirty clouds of 25 soft ellipsoids, as heaps, layers and streaks; single scattering.",
    parameters: PARAMETERS,
    qualities: &[
        ("quality", &[("march_steps", 64.0), ("light_steps", 6.0)]),
        ("performance", &[("march_steps", 32.0), ("light_steps", 3.0)]),
    ],
    defects: defects::DEFECTS,
    is_of_scene: false,
    domains: &[DomainKind::Object, DomainKind::Slab],
    sky: None,
    build: engine,
};

fn engine(request: &Request<'_>) -> Result<Engine> {
    let Request { values, defects, seconds, .. } = *request;
    let (container, frame) = SlabFrame::of(request, "bottom")?;
    let mut graph = NodeGraph::default();
    let (place, _) = frame.place(&mut graph);
    let moved = values.get("speed") * seconds;
    let place = graph.affine(&place, [1.0; 3], [-5.0 * (0.01 * moved).sin(), 0.0, 0.0]);
    let kind = if defects.has(&defects::OVERLAPPING_NUMBERS) { "OVERLAPPING_CLUSTERS" } else { "CLUSTERS" };
    let spread = values.get("spread");
    let field = ClusterField {
        seed: values.get("seed"),
        spread,
        base: values.get("base"),
        height: 30.0,
        radius: 0.0,
        passed: (0.1 * moved / spread).rem_euclid(1.0),
    };
    let density = graph.ellipsoids(kind, &place, &field);
    let march = RealTimeSettings::until_one_percent(values.get("march_steps"), Integration::EnergyConserving);
    let thickness = values.get("thickness") / frame.unit;
    let steps = values.get("light_steps") as u32;
    let light = LightModel {
        suns: vec![Sun { direction: [0.3, -0.5, 0.8], irradiance: [1.0, 0.939, 0.799] }],
        ambient: [0.133, 0.319, 0.604].map(|channel| 0.15 * channel),
        phase: TwoLobes::new([0.6, -0.3], 0.3),
        shadow: ShadowMarch::of_slab(steps, thickness, false, ShadowExtinction::View),
        source: SourceFactor::Albedo([values.get("albedo"); 3]),
        terms: Terms::NONE,
    };
    let extinction = [values.get("extinction") * frame.unit; 3];
    request.engine_of_graph(MODEL.id, GraphParts { container, graph, density, extinction, light, march })
}
