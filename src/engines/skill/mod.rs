//! The procedural-clouds skill: a slab of value noise with a coverage threshold, and ten genera of clouds as value sets.
//!
//! With the published place p in metres (y up), wind w, coverage c, V value noise and fbm(p, o) the sum of V(2^k p) 2^-k over o octaves,
//! divided by the sum of weights:
//!
//! ```text
//! s = ( fbm(0.0003 (p + w t), 3) - (1 - c) ) / c      d = fbm(0.003 (p + 2 w t), 5)
//! density = max( (s - a d) profile(h), 0 ),   extinction = absorption x density per metre
//! ```
//!
//! For a genus the noise coordinate is stretched along the wind, up and across it, and the profile over the height h is one of
//! [`PROFILES`].

pub mod defects;
mod sky;

use crate::base::error::Result;
use crate::engines::defects::Defects;
use crate::engines::domain::DomainKind;
use crate::engines::frame::SlabFrame;
use crate::engines::light::terms::{Octaves, SilverLining, Terms};
use crate::engines::light::{LightModel, ShadowExtinction, ShadowMarch, SourceFactor, Sun, TwoLobes};
use crate::engines::march::RealTimeSettings;
use crate::engines::node_graph::{Input, NodeGraph};
use crate::engines::parameters::{Parameter, Range, Values, parameter};
use crate::engines::passes::god_rays::GodRays;
use crate::engines::{Engine, GraphParts, Model, Request};
use crate::media::transfer::Integration;

const UNIT: Range = Range::Between(0.0, 1.0);

/// Names of the vertical profiles by their number.
pub const PROFILES: [&str; 5] = ["slab", "dome", "anvil", "ragged base", "shear"];

/// All parameters.
pub const PARAMETERS: &[Parameter] = &[
    parameter("coverage", 0.45, UNIT, [0.0, 1.0], "", "1 minus the threshold on the noise; 0 is no cloud"),
    parameter("detail", 0.35, Range::NotNegative, [0.0, 1.0], "", "what fine noise takes away"),
    parameter("absorption", 0.04, Range::NotNegative, [0.001, 0.1], "1/m", "extinction per unit of density"),
    parameter("base", 1500.0, Range::Any, [300.0, 9000.0], "m", "height of the base"),
    parameter("thickness", 2000.0, Range::Positive, [300.0, 11000.0], "m", "from the base to the top"),
    parameter("profile", 0.0, Range::Whole(0, 4), [0.0, 4.0], "", "0 slab, 1 dome, 2 anvil, 3 ragged base, 4 shear"),
    parameter("stretch_wind", 1.0, Range::Positive, [0.03, 8.0], "", "length of features along the wind"),
    parameter("stretch_up", 1.0, Range::Positive, [0.03, 2.0], "", "length of features upwards"),
    parameter("stretch_across", 1.0, Range::Positive, [0.03, 8.0], "", "length of features across the wind"),
    parameter("wind_speed", 15.0, Range::Any, [0.0, 30.0], "m/s", "along (1, 0, 0.3)"),
    parameter("first_lobe", 0.3, Range::Between(-0.999, 0.999), [-0.9, 0.9], "", "mean cosine of the first lobe"),
    parameter(
        "second_lobe",
        0.8,
        Range::Between(-0.999, 0.999),
        [-0.9, 0.9],
        "",
        "mean cosine of the second, half as strong",
    ),
    parameter("march_steps", 64.0, Range::Whole(1, 100_000), [1.0, 128.0], "", "steps of a view ray"),
    parameter("light_steps", 6.0, Range::Whole(1, 1000), [1.0, 12.0], "", "steps towards the sun"),
];

/// A genus as a value set.
macro_rules! genus {
    ($name:literal, $base:literal, $top:literal, $coverage:literal, [$wind:literal, $up:literal, $across:literal],
     $detail:literal, $absorption:literal, $profile:literal, $lobe:literal) => {
        (
            $name,
            &[
                ("base", $base),
                ("thickness", $top - $base),
                ("coverage", $coverage),
                ("stretch_wind", $wind),
                ("stretch_up", $up),
                ("stretch_across", $across),
                ("detail", $detail),
                ("absorption", $absorption),
                ("profile", $profile),
                ("first_lobe", $lobe),
                ("second_lobe", $lobe),
            ],
        )
    };
}

/// A named set of values.
type ValueSet = (&'static str, &'static [(&'static str, f64)]);

/// Levels of quality, the ten genera, and the document's presets.
const QUALITIES: &[ValueSet] = &[
    ("performance", &[("march_steps", 32.0)]),
    ("quality", &[("march_steps", 64.0)]),
    genus!("cumulus", 1000.0, 2500.0, 0.40, [0.35, 0.35, 0.35], 0.35, 0.04, 1.0, 0.85),
    genus!("stratus", 300.0, 800.0, 0.90, [3.0, 0.3, 3.0], 0.15, 0.03, 0.0, 0.85),
    genus!("stratocumulus", 900.0, 1600.0, 0.75, [0.6, 0.3, 0.45], 0.25, 0.05, 0.0, 0.85),
    genus!("cumulonimbus", 800.0, 12000.0, 0.30, [1.2, 1.8, 1.2], 0.50, 0.08, 2.0, 0.85),
    genus!("altocumulus", 3000.0, 3600.0, 0.50, [0.08, 0.08, 0.06], 0.30, 0.02, 1.0, 0.85),
    genus!("altostratus", 3000.0, 5000.0, 0.95, [6.0, 0.5, 6.0], 0.10, 0.004, 0.0, 0.80),
    genus!("nimbostratus", 700.0, 5000.0, 1.00, [5.0, 0.8, 5.0], 0.15, 0.06, 3.0, 0.85),
    genus!("cirrus", 8000.0, 10000.0, 0.30, [4.0, 0.4, 0.5], 0.60, 0.004, 4.0, 0.75),
    genus!("cirrostratus", 9000.0, 10000.0, 0.90, [8.0, 0.5, 8.0], 0.05, 0.0008, 0.0, 0.75),
    genus!("cirrocumulus", 7000.0, 7300.0, 0.35, [0.03, 0.03, 0.025], 0.20, 0.002, 1.0, 0.75),
    ("clear-day", &[("coverage", 0.15), ("base", 2000.0), ("thickness", 1000.0), ("detail", 0.4)]),
    ("partly-cloudy", &[("coverage", 0.45), ("base", 1500.0), ("thickness", 2000.0), ("detail", 0.3)]),
    ("overcast", &[("coverage", 0.85), ("base", 800.0), ("thickness", 1200.0), ("detail", 0.2), ("absorption", 0.06)]),
    ("dramatic", &[("coverage", 0.6), ("base", 1000.0), ("thickness", 5000.0), ("detail", 0.5), ("absorption", 0.08)]),
    ("sunset", &[("coverage", 0.4), ("base", 1500.0), ("thickness", 1500.0), ("detail", 0.35), ("absorption", 0.03)]),
    (
        "high-cirrus",
        &[("coverage", 0.3), ("base", 8000.0), ("thickness", 4000.0), ("detail", 0.6), ("absorption", 0.01)],
    ),
    (
        "mackerel-sky",
        &[("coverage", 0.5), ("base", 3000.0), ("thickness", 2000.0), ("detail", 0.45), ("absorption", 0.03)],
    ),
];

/// The model under its name.
pub static MODEL: Model = Model {
    id: "skill",
    title: "Value-noise slab with ten genera (procedural-clouds skill)",
    about: "A layer of value noise above a coverage threshold, thinned out by finer noise, with vertical profiles and stretches for each of \
            the ten genera; single scattering with half beer-powder.",
    parameters: PARAMETERS,
    qualities: QUALITIES,
    defects: defects::DEFECTS,
    is_of_scene: false,
    domains: &[DomainKind::Object, DomainKind::Slab],
    sky: Some(&sky::SKY),
    build: engine,
};

/// Frequencies of the shape's and the detail's noise per metre.
const FREQUENCIES: [f64; 2] = [0.0003, 0.003];

/// Height over which the slab fades, but for thin layers.
const FADE: f64 = 200.0;

/// How far the shear of a cirrus moves its base along the wind, in metres.
const SHEAR: f64 = 1500.0;

/// Most by which a ragged base is raised, in metres.
const RAGGED: f64 = 400.0;

fn engine(request: &Request<'_>) -> Result<Engine> {
    let Request { values, defects, seconds, .. } = *request;
    let (container, frame) = SlabFrame::of(request, "base")?;
    let mut graph = NodeGraph::default();
    let density = density(&mut graph, &frame, values, defects, seconds);
    let light = light(values, defects, &frame);
    // Laying a colour over another with 1 - exp(-e s) conserves energy, too, for an albedo of 1.
    let march = RealTimeSettings::until_one_percent(values.get("march_steps"), Integration::EnergyConserving);
    let engine = request.engine_of_graph(
        MODEL.id,
        GraphParts {
            container,
            graph,
            density,
            extinction: [values.get("absorption") * frame.unit; 3],
            light,
            march: RealTimeSettings { least_density: 0.001, ..march },
        },
    )?;
    Ok(Engine { god_rays: GOD_RAYS, ..engine })
}

/// The document's, with the pixel's own read and a part of the way as the book has them.
const GOD_RAYS: GodRays = GodRays {
    density: 1.0,
    decay: 0.96,
    weight: 0.4,
    exposure: 0.3,
    samples: 60,
    reach: 0.8,
    centre: 1.0,
    from_behind: false,
};

/// The density of the slab.
fn density(graph: &mut NodeGraph, frame: &SlabFrame, values: &Values, kept: &Defects, seconds: f64) -> Input {
    let get = |name: &str| values.get(name);
    let coverage = get("coverage");
    let profile = get("profile") as usize;
    // The anvil has more coverage at its top.
    if coverage <= 0.0 && profile != 2 {
        return 0.0.into();
    }
    let signed = kept.has(&defects::SIGNED_LATTICE);
    let (place, height) = frame.place(graph);
    // Across and along the wind, which comes from (1, 0, 0.3).
    let length = 1.09_f64.sqrt();
    let [along, across] = [1.0 / length, 0.3 / length];
    let [x, y, z] = graph.separate(&place);
    let part = graph.multiply(&z, across);
    let mut windward = graph.multiply_add(&x, along, part);
    let part = graph.multiply(&x, -across);
    let sideward = graph.multiply_add(&z, along, part);
    let drift = get("wind_speed") * seconds;
    if profile == 4 {
        let lack = graph.subtract(1.0, &height);
        let square = graph.multiply(&lack, &lack);
        windward = graph.multiply_add(square, SHEAR, windward);
    }
    let turned = graph.combine([windward, y, sideward]);
    let stretch = ["stretch_wind", "stretch_up", "stretch_across"].map(get);
    let coordinate = |graph: &mut NodeGraph, frequency: f64, drift: f64| {
        let factor = stretch.map(|stretch| frequency / stretch);
        graph.affine(&turned, factor, [drift * factor[0], 0.0, 0.0])
    };
    let shape_at = coordinate(graph, FREQUENCIES[0], drift);
    let shape = fbm(graph, &shape_at, 3, signed);
    let detail_at = coordinate(graph, FREQUENCIES[1], 2.0 * drift);
    let detail = fbm(graph, &detail_at, 5, signed);
    let covered = match profile {
        2 => {
            let more = graph.smooth(0.78, 0.88, &height);
            let sum = graph.multiply_add(more, 0.35, coverage);
            // Nothing is divided by a coverage of 0.
            let sum = graph.maximum(sum, 1e-4);
            graph.math("MINIMUM", &[sum, 1.0.into()])
        }
        _ => coverage.into(),
    };
    let threshold = graph.subtract(1.0, &covered);
    let shape = graph.remap(&shape, [threshold, 1.0.into()], [0.0, 1.0], false);
    let thin = graph.multiply(&detail, get("detail"));
    let difference = graph.subtract(shape, thin);
    let faded = profile_over(graph, &height, values, &shape_at, signed);
    let density = graph.multiply(difference, faded);
    graph.maximum(density, 0.0)
}

/// Octaves of value noise, divided by the sum of their weights.
fn fbm(graph: &mut NodeGraph, place: &Input, octaves: u32, signed: bool) -> Input {
    let kind = if signed { "SIGNED_VALUE" } else { "VALUE" };
    let whole: f64 = (0..octaves).map(|octave| 0.5_f64.powi(octave as i32)).sum();
    let terms: Vec<(f64, Input)> = (0..octaves)
        .map(|octave| {
            let at = graph.affine(place, [2.0_f64.powi(octave as i32); 3], [0.0; 3]);
            (0.5_f64.powi(octave as i32) / whole, graph.lattice_noise(kind, &at))
        })
        .collect();
    graph.weighted(&terms)
}

/// The profile over the height, a part of the slab's.
fn profile_over(graph: &mut NodeGraph, height: &Input, values: &Values, shape_at: &Input, signed: bool) -> Input {
    let thickness = values.get("thickness");
    // A quarter of a thin layer.
    let fade = FADE.min(thickness / 4.0) / thickness;
    match values.get("profile") as usize {
        1 => {
            let rise = graph.smooth(0.0, 0.08, height);
            let square = graph.multiply(height, height);
            let lack = graph.subtract(1.0, square);
            let lack = graph.maximum(lack, 0.0);
            let dome = graph.math("POWER", &[lack, 0.7.into()]);
            graph.multiply(rise, dome)
        }
        2 => {
            let rise = graph.smooth(0.0, 0.03, height);
            let narrow = graph.smooth(0.1, 0.6, height);
            let narrow = graph.multiply_add(narrow, -0.45, 1.0);
            // Above 0.8 the anvil has its whole density again.
            let is_above = graph.math("GREATER_THAN", &[height.clone(), 0.8.into()]);
            let narrow = graph.maximum(narrow, is_above);
            let top = graph.fall(0.95, 1.0, height);
            let both = graph.multiply(rise, narrow);
            graph.multiply(both, top)
        }
        3 => {
            let raised = fbm(graph, shape_at, 3, signed);
            let part = graph.multiply_add(raised, -RAGGED / thickness, height);
            graph.fades(&part, height, [fade; 2])
        }
        _ => graph.fades(height, height, [fade; 2]),
    }
}

/// The engine's light.
fn light(values: &Values, kept: &Defects, frame: &SlabFrame) -> LightModel {
    let thickness = values.get("thickness") / frame.unit;
    let steps = values.get("light_steps") as u32;
    let is_vertical = kept.has(&defects::VERTICAL_LIGHT_STEP);
    let shadow = ShadowMarch::of_slab(steps, thickness, is_vertical, ShadowExtinction::View);
    let rims = kept.has(&defects::RIM_AT_RIGHT_ANGLES);
    // exp(-t) (0.5 + 0.5 (1 - exp(-2 t))) = exp(-t) - 0.5 exp(-3 t): a second octave that takes away.
    let octaves = match kept.has(&defects::HALF_POWDER) {
        true => Octaves { count: 2, contribution: -0.5, attenuation: 3.0, eccentricity: 1.0, compression: 0.0 },
        false => Terms::NONE.octaves,
    };
    LightModel {
        suns: vec![Sun { direction: [0.3, -0.5, 0.8], irradiance: [1.0, 0.939, 0.799] }],
        ambient: [0.133, 0.319, 0.604].map(|channel| 0.15 * channel),
        phase: TwoLobes {
            gain: if kept.has(&defects::PHASE_OF_ONE_AND_A_HALF) { 1.5 } else { 1.0 },
            rim: if rims { 0.3 } else { 0.0 },
            ..TwoLobes::new([values.get("first_lobe"), values.get("second_lobe")], 1.0 / 3.0)
        },
        shadow,
        source: SourceFactor::Albedo([1.0; 3]),
        terms: Terms {
            octaves,
            silver: SilverLining { strength: if rims { 0.0 } else { 0.3 }, exponent: 8.0 },
            ..Terms::NONE
        },
    }
}
