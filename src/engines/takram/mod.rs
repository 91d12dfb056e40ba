//! @takram/three-clouds 0.1.0: layers of clouds over a globe, of a weather map, eroded by two volumes of noise.
//!
//! At a height of its layer eta, 0 to 1, with the weather map's channel w of the layer, C the coverage, S, D the shape's and the detail's noise
//! and r(x; a, b) = clamp((x - a) / (b - a), 0, 1):
//!
//! ```text
//! W   = r( lerp(w, 1, f);  c, c + f )       c = 1 - C (1 - (2 eta^0.35 - 1)^2)
//! rho = r( W; (1 - S) A, 1 )                then r( 2 rho; M / 2, 1 ),  M = B lerp(D^6, 1 - D, r(eta; 0.2, 0.4))
//! density = sum over layers of k rho (0.75 eta + 0.25),   extinction = density (scattering + absorption) per metre
//! ```
//!
//! Here the globe is flat: over 30 km its surface falls by 18 m at the sides, and the weather's coordinates, those of the middle of a face of
//! the cube sphere, differ by less than 1e-5 of their distance. Textures are read at their full resolution at every distance.
//!
//! The fog near the ground is the example of the original's manual: a filter of 1 leaves all of it whatever the weather, and a profile e^(0.001 eta), as
//! eta is a part of the layer, is 1 within a thousandth: it does not thin out upwards as an exponential of metres would.

pub mod defects;

use crate::base::error::{Error, Result};
use crate::engines::defects::Defects;
use crate::engines::domain::DomainKind;
use crate::engines::frame::SlabFrame;
use crate::engines::light::terms::{Ground, Octaves, Powder, Terms};
use crate::engines::light::{
    LightModel, ShadowExtinction, ShadowLength, ShadowMapSettings, ShadowMarch, SourceFactor, Sun, TwoLobes,
};
use crate::engines::march::air::{Air, Haze, Shafts};
use crate::engines::march::{Leftover, RealTimeSettings};
use crate::engines::node_graph::{Input, NodeGraph};
use crate::engines::parameters::{Parameter, Range, Values, parameter};
use crate::engines::{Engine, GraphParts, Model, Request};
use crate::media::transfer::Integration;
use crate::nodes::cloud_texture::bakes::FeaturePoints;
use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};

const UNIT: Range = Range::Between(0.0, 1.0);

const SWITCH: Range = Range::Whole(0, 1);

/// All parameters.
pub const PARAMETERS: &[Parameter] = &[
    parameter("coverage", 0.3, UNIT, [0.0, 1.0], "", "share of the weather map that is cloud; 0 is no cloud"),
    parameter("bottom", 750.0, Range::Any, [0.0, 7500.0], "m", "height of the domain's lower face"),
    parameter("thickness", 1450.0, Range::Positive, [500.0, 8000.0], "m", "to the domain's upper face"),
    parameter("scattering", 1.0, Range::NotNegative, [0.1, 2.0], "1/m", "scattering at a density of 1"),
    parameter("absorption", 0.0, Range::NotNegative, [0.0, 1.0], "1/m", "absorption at a density of 1"),
    parameter("weather_repeat", 100.0, Range::Positive, [20.0, 400.0], "", "weather maps to a sixth of the globe"),
    parameter("weather_speed", 0.0, Range::Any, [-1e-3, 1e-3], "1/s", "weather maps that pass along x"),
    parameter("shape_repeat", 0.0003, Range::Positive, [0.0001, 0.001], "1/m", "periods of the shape's noise"),
    parameter("detail_repeat", 0.006, Range::Positive, [0.002, 0.02], "1/m", "periods of the detail's noise"),
    parameter("detail", 1.0, SWITCH, [0.0, 1.0], "", "1: the detail's noise is on"),
    parameter("turbulence", 1.0, SWITCH, [0.0, 1.0], "", "1: the shape is displaced near the base"),
    parameter("displacement", 350.0, Range::NotNegative, [0.0, 1000.0], "m", "of the turbulence"),
    parameter("least_transmittance", 0.01, Range::Between(0.0, 0.5), [0.0, 0.1], "", "where rays end"),
    parameter(
        "shadow_map",
        256.0,
        Range::Whole(0, 4096),
        [0.0, 32.0],
        "",
        "texels along a side of the shadow map; 0: march to the exit instead",
    ),
    parameter(
        "cascades",
        1.0,
        Range::Whole(1, 4),
        [1.0, 4.0],
        "",
        "shadow maps: 1 over the whole cloud, or so many over parts of the view",
    ),
    parameter(
        "cascade_split",
        0.6,
        UNIT,
        [0.0, 1.0],
        "",
        "where cascades meet: 0 at even depths, 1 at even logarithms",
    ),
    parameter("shadow_steps", 50.0, Range::Whole(1, 1000), [4.0, 50.0], "", "steps of the shadow map's rays"),
    parameter("shadow_transmittance", 1e-4, Range::Between(0.0, 0.5), [0.0, 0.1], "", "where its rays end"),
    parameter(
        "sun_steps",
        2.0,
        Range::Whole(1, 12),
        [1.0, 6.0],
        "",
        "steps towards the sun, each twice as long as the one before",
    ),
    parameter(
        "ground_steps",
        0.0,
        Range::Whole(0, 8),
        [0.0, 3.0],
        "",
        "steps down to light from the ground; 0 is none",
    ),
    parameter(
        "step_growth",
        1.0,
        Range::Between(1.0, 1.1),
        [1.0, 1.05],
        "",
        "length of a view step over the one before",
    ),
    parameter("ground_fog", 0.0, SWITCH, [0.0, 1.0], "", "1: a fourth layer, fog from the ground up to 300 m"),
    parameter("haze", 0.0, Range::NotNegative, [0.0, 3.0], "", "haze over that of the document; 0 is none"),
    parameter(
        "aerial_perspective",
        0.0,
        Range::NotNegative,
        [0.0, 3.0],
        "",
        "air between the camera and the cloud, over that of the earth; 0 is none",
    ),
    parameter("shafts", 0.0, UNIT, [0.0, 1.0], "", "strength of the cloud's shadow in haze and aerial perspective"),
    parameter("march_steps", 128.0, Range::Whole(1, 100_000), [16.0, 500.0], "", "steps of a view ray"),
];

/// Levels of quality.
const QUALITIES: &[(&str, &[(&str, f64)])] = &[
    (
        "low",
        &[
            ("detail", 0.0),
            ("turbulence", 0.0),
            ("least_transmittance", 0.1),
            ("march_steps", 64.0),
            ("sun_steps", 1.0),
            ("shadow_steps", 25.0),
            ("shadow_transmittance", 0.01),
        ],
    ),
    ("medium", &[("turbulence", 0.0), ("march_steps", 128.0)]),
    ("high", &[("march_steps", 128.0), ("shadow_map", 512.0)]),
    ("ultra", &[("march_steps", 128.0), ("shadow_map", 1024.0)]),
    ("without-shadow-map", &[("shadow_map", 0.0), ("sun_steps", 6.0)]),
    ("with-air", &[("haze", 1.0), ("aerial_perspective", 1.0), ("shafts", 1.0)]),
    ("with-ground-fog", &[("bottom", 0.0), ("thickness", 2200.0), ("ground_fog", 1.0)]),
    ("with-cirrus", &[("thickness", 7250.0), ("march_steps", 256.0)]),
];

/// The model under its name.
pub static MODEL: Model = Model {
    id: "takram",
    title: "Weather layers (@takram/three-clouds 0.1.0)",
    about: "Layers of clouds from a weather map, each with its heights and profile, eroded by shape and detail noise; eight octaves of single \
            scattering with powder.",
    parameters: PARAMETERS,
    qualities: QUALITIES,
    defects: defects::DEFECTS,
    is_of_scene: false,
    domains: &[DomainKind::Object, DomainKind::Slab],
    sky: None,
    build: engine,
};

/// A layer with its constants.
struct Layer {
    /// Its channel of the weather map; none where its filter is so wide that the weather leaves all of it.
    weather: Option<&'static str>,
    altitude: f64,
    height: f64,
    density: f64,
    shape: f64,
    detail: f64,
    filter: f64,
    /// Exponent of the height in the profile of coverage.
    bias: f64,
    profile: Profile,
}

impl Layer {
    /// Whether something of it lies between two heights.
    fn is_within(&self, [low, high]: [f64; 2]) -> bool {
        self.altitude < high && self.altitude + self.height > low
    }
}

/// What the density is multiplied with over the height of a layer, 0 to 1.
enum Profile {
    /// 0.75 eta + 0.25.
    Rising,
    /// e^(x eta).
    Exponential(f64),
}

/// The layers that have a height, and a fog that the original's manual adds to them.
const LAYERS: [Layer; 4] = [
    Layer {
        weather: Some("TAKRAM_WEATHER_R"),
        altitude: 750.0,
        height: 650.0,
        density: 0.2,
        shape: 1.0,
        detail: 1.0,
        filter: 0.6,
        bias: BIAS,
        profile: Profile::Rising,
    },
    Layer {
        weather: Some("TAKRAM_WEATHER_G"),
        altitude: 1000.0,
        height: 1200.0,
        density: 0.2,
        shape: 1.0,
        detail: 1.0,
        filter: 0.6,
        bias: BIAS,
        profile: Profile::Rising,
    },
    Layer {
        weather: Some("TAKRAM_WEATHER_B"),
        altitude: 7500.0,
        height: 500.0,
        density: 0.003,
        shape: 0.4,
        detail: 0.0,
        filter: 0.5,
        bias: BIAS,
        profile: Profile::Rising,
    },
    Layer {
        weather: None,
        altitude: 0.0,
        height: 300.0,
        density: 0.05,
        shape: 0.2,
        detail: 0.0,
        filter: 1.0,
        bias: 0.5,
        profile: Profile::Exponential(1e-3),
    },
];

/// How many of them are there without the fog.
const WITHOUT_FOG: usize = 3;

/// The exponent of layers that name none.
const BIAS: f64 = 0.35;

/// Radius of the globe in metres.
const RADIUS: f64 = 6.36e6;

/// Periods of the turbulence to one of the weather.
const TURBULENCE_REPEAT: f64 = 20.0;

/// How far clouds sink while one weather map passes, in metres.
const SINKING: f64 = 20_000.0;

/// Logarithm of the last view step over the first, at most.
const MOST_GROWTH: f64 = 39.0;

/// Least extinction that counts, per metre.
const LEAST_EXTINCTION: f64 = 1e-5;

fn engine(request: &Request<'_>) -> Result<Engine> {
    let Request { values, defects, seconds, .. } = *request;
    let (container, frame) = SlabFrame::of(request, "bottom")?;
    let mut graph = NodeGraph::default();
    let density = density(&mut graph, &frame, values, defects, seconds);
    let extinction = values.get("scattering") + values.get("absorption");
    let march = RealTimeSettings::until_one_percent(values.get("march_steps"), Integration::EnergyConserving);
    let growth = values.get("step_growth");
    if f64::from(march.steps) * growth.ln() > MOST_GROWTH {
        return Err(Error::new(
            "parameter step_growth",
            format!(
                "{growth}, over {} steps: the last is {:.1e} times the first",
                march.steps,
                growth.powf(march.steps.into())
            ),
            "a last step that is at most 1e17 times the first: f32 tells no places of shorter ones apart",
            "Take fewer march_steps, or a growth nearer to 1.",
        ));
    }
    let march = RealTimeSettings {
        least_density: if extinction > 0.0 { LEAST_EXTINCTION / extinction } else { 0.0 },
        least_transmittance: values.get("least_transmittance") * 3.0_f64.sqrt(),
        growth,
        doubled_start: defects.has(&defects::DOUBLED_START),
        leftover: if defects.has(&defects::RESCALED_ALPHA) { Leftover::Rescaled } else { Leftover::Kept },
        ..march
    };
    let light = light(values, defects, &frame);
    let extinction = [extinction * frame.unit; 3];
    let engine =
        request.engine_of_graph(MODEL.id, GraphParts { container, graph, density, extinction, light, march })?;
    let mut engine = with_air(engine, values, defects, &frame)?;
    let fog = &LAYERS[WITHOUT_FOG];
    if values.get("ground_fog") == 1.0 && !fog.is_within([frame.base, frame.base + values.get("thickness")]) {
        engine
            .warnings
            .push("ground_fog is 1, and the domain has nothing of 0 to 300 m: there is none in it".to_owned());
    }
    Ok(engine)
}

/// Haze per metre at the height 0 where all is covered.
const HAZE: f64 = 3e-5;

/// The engine with the air of its parameters.
fn with_air(mut engine: Engine, values: &Values, kept: &Defects, frame: &SlabFrame) -> Result<Engine> {
    let [scattering, absorption] = ["scattering", "absorption"].map(|name| values.get(name));
    let covered = ((values.get("coverage") - 0.2) / 0.2).clamp(0.0, 1.0);
    let [haze, aerial] = ["haze", "aerial_perspective"].map(|name| values.get(name));
    let (wants_shafts, has_map) = (values.get("shafts") > 0.0, engine.light.shadow.map.is_some());
    let air = Air {
        haze: (haze > 0.0).then(|| Haze {
            density: haze * HAZE * covered,
            albedo: if scattering + absorption > 0.0 { scattering / (scattering + absorption) } else { 1.0 },
            is_level: kept.has(&defects::LEVEL_HAZE),
        }),
        aerial: (aerial > 0.0).then_some(aerial),
        shafts: (wants_shafts && has_map)
            .then(|| Shafts { fades: kept.has(&defects::FADING_SHAFTS), strength: values.get("shafts") }),
        ..frame.air()
    };
    if wants_shafts && !has_map {
        engine.warnings.push("shafts is above 0 and shadow_map 0, which shafts read: there are none".to_owned());
    } else if wants_shafts && !air.is_seen() {
        engine
            .warnings
            .push("shafts is above 0, and neither haze nor aerial_perspective is there to show them".to_owned());
    }
    engine.air = air.is_seen().then_some(air);
    Ok(engine)
}

/// A layer at a place: its height as a part of the layer, and how much of it the weather leaves.
struct Covered<'a> {
    layer: &'a Layer,
    height: Input,
    left: Input,
}

fn density(graph: &mut NodeGraph, frame: &SlabFrame, values: &Values, kept: &Defects, seconds: f64) -> Input {
    let get = |name: &str| values.get(name);
    let points = match kept.has(&defects::DIAGONAL_FEATURES) {
        true => FeaturePoints::Diagonal,
        false => FeaturePoints::Even,
    };
    let (place, _) = frame.place(graph);
    // East, up, south.
    let [x, up, south] = graph.separate(&place);
    let y = graph.multiply(south, -1.0);
    let repeat = get("weather_repeat");
    let passed = get("weather_speed") * seconds;
    let per_metre = repeat * FRAC_1_SQRT_2 / RADIUS;
    let u = graph.multiply_add(&x, per_metre, (0.5 * repeat).fract() + passed.fract());
    let v = graph.multiply_add(&y, per_metre, (0.5 * repeat).fract());
    let weather_at = graph.combine([u, v, 0.5.into()]);
    let range = [frame.base, frame.base + get("thickness")];
    let count = if get("ground_fog") == 1.0 { LAYERS.len() } else { WITHOUT_FOG };
    let layers: Vec<Covered<'_>> = LAYERS[..count]
        .iter()
        .filter(|layer| layer.is_within(range))
        .map(|layer| {
            let ends = [layer.altitude.into(), (layer.altitude + layer.height).into()];
            let height = graph.remap(&up, ends, [0.0, 1.0], true);
            let square = graph.off_middle(&height, layer.bias);
            // 1 - C (1 - square)
            let least = graph.multiply_add(square, get("coverage"), 1.0 - get("coverage"));
            let lifted = match layer.weather {
                Some(channel) => {
                    let weather = graph.cloud_texture(channel, points, &weather_at);
                    graph.multiply_add(weather, 1.0 - layer.filter, layer.filter)
                }
                None => 1.0.into(),
            };
            let most = graph.add(&least, layer.filter);
            let left = graph.remap(&lifted, [least, most], [0.0, 1.0], true);
            Covered { layer, height, left }
        })
        .collect();
    let own = graph.combine([x, y, up]);
    let sinking = -passed.abs() * SINKING;
    let turbulence = (get("turbulence") == 1.0 && !layers.is_empty())
        .then(|| turbulence(graph, &layers, &weather_at, get("displacement")));
    let shape_repeat = get("shape_repeat");
    let sunk = graph.affine(&own, [shape_repeat; 3], [0.0, 0.0, sinking * shape_repeat]);
    let shape_at = match &turbulence {
        Some(moved) => graph.affine_to(moved, shape_repeat, &sunk),
        None => sunk,
    };
    let shape = graph.cloud_texture("TAKRAM_SHAPE", points, &shape_at);
    let detail = (get("detail") == 1.0).then(|| {
        let detail_repeat = get("detail_repeat");
        let at = graph.affine(&own, [detail_repeat; 3], [0.0; 3]);
        let at = match &turbulence {
            Some(moved) => graph.affine_to(moved, detail_repeat, &at),
            None => at,
        };
        graph.cloud_texture("TAKRAM_DETAIL", points, &at)
    });
    let mut sum: Input = 0.0.into();
    for Covered { layer, height, left } in &layers {
        let gaps = graph.multiply_add(&shape, -layer.shape, layer.shape);
        let mut density = graph.remap(left, [gaps, 1.0.into()], [0.0, 1.0], true);
        // Without any of it, what is left is doubled and cut at 1.
        if let Some(detail) = &detail {
            density = if layer.detail > 0.0 {
                let power = graph.math("POWER", &[detail.clone(), 6.0.into()]);
                let lack = graph.subtract(1.0, detail);
                let change = graph.subtract(lack, &power);
                let above = graph.remap(height, [0.2.into(), 0.4.into()], [0.0, 1.0], true);
                let mixed = graph.multiply_add(change, above, power);
                let least = graph.multiply(mixed, 0.5 * layer.detail);
                let doubled = graph.multiply(density, 2.0);
                graph.remap(&doubled, [least, 1.0.into()], [0.0, 1.0], true)
            } else {
                graph.multiply_clamped(density, 2.0)
            };
        }
        let profile = match layer.profile {
            Profile::Rising => graph.multiply_add(height, 0.75 * layer.density, 0.25 * layer.density),
            Profile::Exponential(exponent) => {
                let power = graph.multiply(height, exponent);
                let grown = graph.math("EXPONENT", &[power]);
                graph.multiply(grown, layer.density)
            }
        };
        let density = graph.multiply_clamped(density, profile);
        sum = graph.add(sum, density);
    }
    sum
}

/// The displacement by turbulence in metres: near the bases of what is covered.
fn turbulence(graph: &mut NodeGraph, layers: &[Covered<'_>], weather_at: &Input, displacement: f64) -> Input {
    let mut near: Input = 0.0.into();
    for Covered { height, left, .. } in layers {
        let low = graph.remap(height, [0.0.into(), 0.3.into()], [1.0, 0.0], true);
        near = graph.multiply_add(low, left, near);
    }
    let near = graph.multiply(near, displacement);
    let at = graph.affine(weather_at, [TURBULENCE_REPEAT, TURBULENCE_REPEAT, 1.0], [0.0; 3]);
    let parts = ["TAKRAM_TURBULENCE_X", "TAKRAM_TURBULENCE_Y", "TAKRAM_TURBULENCE_Z"].map(|texture| {
        let read = graph.cloud_texture(texture, FeaturePoints::Even, &at);
        let signed = graph.multiply_add(read, 2.0, -1.0);
        graph.multiply(signed, &near)
    });
    graph.combine(parts)
}

/// Height of the upper face of the layers that cast shadows, above which the ground sends no light.
const SHADOW_TOP: f64 = 2200.0;

/// Radiance from the ground per irradiance of it: a factor of 3 / (4 pi) on what a reflectance of 0.3 sends back.
const GROUND: f64 = 3.0 / (4.0 * PI) * 0.3 / PI;

/// The engine's light.
fn light(values: &Values, kept: &Defects, frame: &SlabFrame) -> LightModel {
    let [scattering, absorption] = ["scattering", "absorption"].map(|name| values.get(name));
    let whole = scattering + absorption;
    let thickness = values.get("thickness") / frame.unit;
    let [steps, size, map_steps, ground_steps] =
        ["sun_steps", "shadow_map", "shadow_steps", "ground_steps"].map(|name| values.get(name) as u32);
    // The first of n steps is 100 m / n long.
    let marched = 100.0 / f64::from(steps) * (2.0_f64.powi(steps as i32) - 1.0) / frame.unit;
    let (map, length) = match size {
        0 => (None, ShadowLength::ToExitAtMost(4.0 * thickness)),
        _ => {
            let map = ShadowMapSettings {
                cascades: values.get("cascades") as u32,
                split: values.get("cascade_split"),
                least_transmittance: values.get("shadow_transmittance"),
                tail: 2.0,
                half_floats: kept.has(&defects::HALF_FLOATS),
                front_by_what_is_left: kept.has(&defects::FRONT_BY_WHAT_IS_LEFT),
                marched_to_last_sample: kept.has(&defects::TO_LAST_SAMPLE),
                ..ShadowMapSettings::new(size.max(2), map_steps, frame.unit)
            };
            (Some(map), ShadowLength::Fixed(marched))
        }
    };
    LightModel {
        suns: vec![Sun { direction: [0.417, 0.558, 0.717], irradiance: [1.474, 1.8504, 1.91198] }],
        ambient: [0.133, 0.319, 0.604],
        phase: TwoLobes::new([0.7, -0.2], 0.5),
        shadow: ShadowMarch { growth: 2.0, map, ..ShadowMarch::new(steps, length, ShadowExtinction::View) },
        source: SourceFactor::Albedo([if whole > 0.0 { scattering / whole } else { 1.0 }; 3]),
        terms: Terms {
            octaves: Octaves { count: 8, contribution: 0.5, attenuation: 0.5, eccentricity: 0.5, compression: 0.0 },
            powder: Powder { strength: 0.8, length: 150.0 / frame.unit, ambient: 1.0 },
            // 2.5 / (4 pi) of a sky's irradiance, pi times its radiance, times 0.5 + eta: here of the domain's height.
            ambient: [0.3125, 0.9375],
            ground: (ground_steps > 0).then(|| Ground {
                of_world: GROUND,
                of_suns: GROUND * (1.0 - values.get("coverage")) / TAU,
                steps: ground_steps,
                first: 100.0 / f64::from(ground_steps) / frame.unit,
                highest: (SHADOW_TOP - frame.base) / values.get("thickness"),
            }),
            ..Terms::NONE
        },
    }
}
