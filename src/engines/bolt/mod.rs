//! boltbestclouds32: a procedural slab of Perlin-Worley noise, with single scattering of Cornette and Shanks' phase function, powder and a
//! boost for a second order of scattering.
//!
//! With the published place p in metres (y up), the height h in the slab, coverage c, and noises of [`NodeGraph`]:
//!
//! ```text
//! p  <- p + t speed (10, 0, 5);   p <- p + 100 w ( sin(t w + 0.01 p_z), 0, cos(t w + 0.01 p_x) )
//! G  = sat(h / 0.15) sat((1 - h) / 0.15);   q = 0.00015 scale p
//! PW = w' + (0.5 + 0.5 g(q)) (1 - w'),   w' = 0.625 W(2 q) + 0.375 W(8 q)
//! WF = 0.625 W(3 q) + 0.25 W(6 q) + 0.125 W(12 q)
//! d  = ( (PW - 0.3 WF) / (1 - 0.3 WF) - (1 - c) ) / c
//! density = sat( k (1 + 0.4 precipitation) G d ),   extinction = 0.01 A density per metre
//! ```

pub mod defects;
mod sky;

use crate::base::error::Result;
use crate::engines::defects::Defects;
use crate::engines::domain::DomainKind;
use crate::engines::frame::SlabFrame;
use crate::engines::light::terms::{Boost, Powder, SilverLining, Terms};
use crate::engines::light::{LightModel, ShadowExtinction, ShadowMarch, SourceFactor, Sun, TwoLobes};
use crate::engines::march::air::{Air, MarchRays};
use crate::engines::march::distance_levels::DistanceLevels;
use crate::engines::march::{RealTimeSettings, distance_levels};
use crate::engines::node_graph::{ClusterField, Input, NodeGraph};
use crate::engines::parameters::{Parameter, Range, Values, parameter};
use crate::engines::passes::height_fog::HeightFog;
use crate::engines::sky::white;
use crate::engines::{Engine, GraphParts, Model, Request};
use crate::media::transfer::Integration;
use crate::scene;
use std::f64::consts::PI;
use std::sync::Arc;

const UNIT: Range = Range::Between(0.0, 1.0);

/// All parameters.
pub const PARAMETERS: &[Parameter] = &[
    parameter("coverage", 0.5, UNIT, [0.0, 1.0], "", "share of the noise that is cloud; 0 is no cloud"),
    parameter("density", 1.0, Range::NotNegative, [0.1, 3.0], "", "factor on the density before it is cut at 1"),
    parameter("scale", 1.0, Range::Positive, [0.1, 5.0], "", "factor on the frequency of the noise"),
    parameter("speed", 0.05, UNIT, [0.0, 1.0], "", "factor on the wind of (10, 0, 5) metres per second"),
    parameter("height", 1500.0, Range::NotNegative, [500.0, 5000.0], "m", "height of the base"),
    parameter("thickness", 1000.0, Range::Positive, [200.0, 3000.0], "m", "from the base to the top"),
    parameter("light_absorption", 0.3, Range::Positive, [0.1, 1.0], "per 100 m", "extinction at a density of 1"),
    parameter("silver", 0.5, Range::NotNegative, [0.0, 2.0], "per steradian", "silver lining, cosine^8"),
    parameter("wind_influence", 0.3, UNIT, [0.0, 1.0], "", "displacement by the wind, of up to 100 m"),
    parameter("precipitation", 0.0, UNIT, [0.0, 1.0], "", "makes the cloud up to 1.4 times as dense"),
    parameter("multi_scattering", 1.0, Range::Whole(0, 1), [0.0, 1.0], "", "1: a boost for a second order"),
    parameter(
        "thunderstorm",
        0.0,
        Range::Whole(0, 1),
        [0.0, 1.0],
        "",
        "1: less light, and half as much extinction more",
    ),
    parameter(
        "spine_radius",
        0.0,
        Range::NotNegative,
        [0.0, 5000.0],
        "m",
        "half width of a street of clouds; 0: everywhere",
    ),
    parameter(
        "spine_length",
        30_000.0,
        Range::NotNegative,
        [5000.0, 50_000.0],
        "m",
        "length of the street, about the middle",
    ),
    parameter(
        "spine_direction",
        0.0,
        Range::Any,
        [-180.0, 180.0],
        "degrees",
        "where the street leads in its middle, from x",
    ),
    parameter(
        "spine_bend",
        0.0,
        Range::Between(-360.0, 360.0),
        [-180.0, 180.0],
        "degrees",
        "by which it turns from end to end",
    ),
    parameter(
        "spine_softness",
        0.5,
        Range::Between(0.01, 1.0),
        [0.1, 1.0],
        "",
        "share of the half width over which it fades",
    ),
    parameter("cell_size", 0.0, Range::NotNegative, [0.0, 20_000.0], "m", "of cells of weather; 0 is none"),
    parameter("cell_width", 0.3, Range::Between(0.01, 2.0), [0.05, 1.0], "cells", "of their borders"),
    parameter("cell_sharpness", 1.0, Range::Between(0.1, 8.0), [0.5, 4.0], "", "exponent of their borders"),
    parameter("cell_updraft", 0.0, Range::NotNegative, [0.0, 2.0], "", "more density along the borders"),
    parameter("cell_downdraft", 0.0, UNIT, [0.0, 1.0], "", "less coverage along the borders"),
    parameter("cell_warp", 0.0, Range::NotNegative, [0.0, 1.0], "cells", "by which noise bends the borders"),
    parameter(
        "ball_radius",
        0.0,
        Range::NotNegative,
        [0.0, 5000.0],
        "m",
        "of spheres, in the mean, that clouds keep to; 0 is none",
    ),
    parameter(
        "ball_spread",
        30_000.0,
        Range::Positive,
        [5000.0, 50_000.0],
        "m",
        "side of the square with thirty of them",
    ),
    parameter("ball_seed", 0.0, Range::Whole(0, 1_000_000), [0.0, 100.0], "", "which spheres"),
    parameter(
        "distance_levels",
        0.0,
        Range::Whole(0, 1),
        [0.0, 1.0],
        "",
        "1: steps by distance, of the camera instead of the steps below",
    ),
    parameter("fog", 0.0, Range::NotNegative, [0.0, 3.0], "1/10 km", "height fog over the picture; 0 is none"),
    parameter("fog_height", 4.0, Range::NotNegative, [0.0, 10.0], "", "its fall with the sine of the view's elevation"),
    parameter(
        "fog_distance",
        20_000.0,
        Range::NotNegative,
        [0.0, 1e5],
        "m",
        "how far away the background stands in it",
    ),
    parameter(
        "march_ray_intensity",
        0.0,
        Range::NotNegative,
        [0.0, 2.0],
        "",
        "god rays summed up over the first 500 m; 0 is none",
    ),
    parameter("march_ray_density", 1.0, Range::NotNegative, [0.0, 3.0], "", "of the fog that they light"),
    parameter("march_ray_samples", 16.0, Range::Whole(1, 1000), [8.0, 32.0], "", "their samples"),
    parameter("march_steps", 64.0, Range::Whole(1, 100_000), [8.0, 128.0], "", "steps of a view ray"),
    parameter("light_steps", 6.0, Range::Whole(1, 1000), [1.0, 8.0], "", "steps towards the sun"),
    parameter("albedo", 1.0, UNIT, [0.0, 1.0], "", "single-scattering albedo; without defect BO-1 only"),
];

/// Levels of quality of the document's hardware tiers, then its presets.
const QUALITIES: &[(&str, &[(&str, f64)])] = &[
    ("mobile", &[("march_steps", 20.0), ("light_steps", 2.0)]),
    ("low", &[("march_steps", 32.0), ("light_steps", 4.0)]),
    ("medium", &[("march_steps", 64.0), ("light_steps", 6.0)]),
    ("high", &[("march_steps", 96.0), ("light_steps", 8.0)]),
    ("morning", &[("coverage", 0.4), ("density", 0.8), ("silver", 0.8)]),
    ("storm", &[("coverage", 0.9), ("density", 2.0), ("silver", 0.2), ("thunderstorm", 1.0)]),
    ("cirrus", &[("coverage", 0.3), ("density", 0.5), ("height", 4000.0), ("thickness", 500.0), ("scale", 2.0)]),
];

/// The model under its name.
pub static MODEL: Model = Model {
    id: "bolt",
    title: "Procedural Perlin-Worley slab (boltbestclouds32)",
    about: "A layer of gradient noise and inverted cells between two heights, eroded by finer cells; single scattering with powder, a \
            silver lining and a boost where the cloud is dense.",
    parameters: PARAMETERS,
    qualities: QUALITIES,
    defects: defects::DEFECTS,
    is_of_scene: false,
    domains: &[DomainKind::Object, DomainKind::Slab],
    sky: Some(&sky::SKY),
    build: engine,
};

/// Frequency of the noise per metre.
const FREQUENCY: f64 = 0.00015;

/// Extinction per metre and unit of density and absorption.
const EXTINCTION: f64 = 0.01;

fn engine(request: &Request<'_>) -> Result<Engine> {
    let Request { values, defects, seconds, .. } = *request;
    let (container, frame) = SlabFrame::of(request, "height")?;
    let mut graph = NodeGraph::default();
    let density = density(&mut graph, &frame, values, defects, seconds);
    let is_storm = values.get("thunderstorm") == 1.0;
    // Per unit of length, without the storm's factor and with it.
    let calm = EXTINCTION * values.get("light_absorption") * frame.unit;
    let extinction = if is_storm { 1.5 * calm } else { calm };
    let integration = match defects.has(&defects::PLAIN_SUM) {
        true => Integration::Plain,
        false => Integration::EnergyConserving,
    };
    let mut steps = [values.get("march_steps"), values.get("light_steps")].map(|steps| steps as u32);
    let levels = values.get("distance_levels") == 1.0;
    if levels {
        // From the place above the camera, at the height of the base.
        let eye = scene::matrix_to_glam(&request.scene.camera.matrix_world).w_axis.truncate();
        let above = (container.to_local.transform_point3(eye).z - frame.origin[2]) * frame.scale[2];
        steps = distance_levels::camera_level(above.abs());
    }
    let march = RealTimeSettings {
        distance_levels: levels.then(|| DistanceLevels {
            metres: frame.unit,
            with_rest: defects.has(&defects::STEPS_WITH_REST),
            beyond_asked: defects.has(&defects::STEPS_BEYOND_ASKED),
        }),
        ..RealTimeSettings::until_one_percent(f64::from(steps[0]), integration)
    };
    let light = light(values, steps[1], defects, &frame, [calm, extinction]);
    let mut engine = request.engine_of_graph(
        MODEL.id,
        GraphParts {
            container,
            graph,
            density,
            extinction: [extinction; 3],
            light,
            march: RealTimeSettings { least_density: 0.001, ..march },
        },
    )?;
    let fog = values.get("fog");
    if fog > 0.0 {
        let white = white(request.scene);
        engine.passes.push(Arc::new(HeightFog {
            density: 1e-4 * fog,
            distance: values.get("fog_distance"),
            falloff: values.get("fog_height"),
            colour: sky::HORIZON.map(|channel| white * channel),
            sun_gain: 1.0 / PI,
            without_parentheses: defects.has(&defects::FOG_AT_THE_ZENITH),
        }));
    }
    let is_twice = defects.has(&defects::ALPHA_TWICE);
    engine.compositing.alpha_twice = is_twice;
    let intensity = values.get("march_ray_intensity");
    if intensity > 0.0 {
        let rays = MarchRays {
            intensity,
            density: values.get("march_ray_density"),
            samples: values.get("march_ray_samples") as u32,
            counts_samples: defects.has(&defects::RAYS_BY_NUMBER),
        };
        // Rays are added behind the compositing that multiplies the cloud by its opacity where there is a background.
        let alpha_twice = is_twice && !request.scene.film.transparent;
        engine.compositing.alpha_twice = is_twice && !alpha_twice;
        engine.air = Some(Air { rays: Some(rays), alpha_twice, ..frame.air() });
    }
    Ok(engine)
}

/// The density of the slab.
fn density(graph: &mut NodeGraph, frame: &SlabFrame, values: &Values, kept: &Defects, seconds: f64) -> Input {
    let get = |name: &str| values.get(name);
    let coverage = get("coverage");
    // Where nothing is covered there is no cloud; the document divides by the coverage.
    if coverage <= 0.0 {
        return 0.0.into();
    }
    let (place, height) = frame.place(graph);
    let drift = seconds * get("speed");
    let influence = get("wind_influence");
    let mut moved = graph.affine(&place, [1.0; 3], [10.0 * drift, 0.0, 5.0 * drift]);
    if influence > 0.0 {
        let [x, y, z] = graph.separate(&moved);
        let phase = seconds * influence;
        let of_z = graph.multiply_add(&z, 0.01, phase);
        let of_x = graph.multiply_add(&x, 0.01, phase);
        let sine = graph.math("SINE", &[of_z]);
        let cosine = graph.math("COSINE", &[of_x]);
        let x = graph.multiply_add(sine, 100.0 * influence, x);
        let z = graph.multiply_add(cosine, 100.0 * influence, z);
        moved = graph.combine([x, y, z]);
    }
    let q = graph.affine(&moved, [FREQUENCY * get("scale"); 3], [0.0; 3]);
    let base = match kept.has(&defects::BIASED_GRADIENTS) {
        true => {
            let signed = graph.lattice_noise("GRADIENT_289", &q);
            graph.multiply_add(signed, 0.5, 0.5)
        }
        false => graph.gradient_noise(&q, 1.0, 1),
    };
    let cells = |graph: &mut NodeGraph, parts: &[(f64, f64)]| {
        let terms: Vec<(f64, Input)> = parts.iter().map(|&(weight, scale)| (weight, graph.cells(&q, scale))).collect();
        graph.weighted(&terms)
    };
    let coarse = cells(graph, &[(0.625, 2.0), (0.375, 8.0)]);
    let rest = graph.subtract(1.0, &coarse);
    let perlin_worley = graph.multiply_add(base, rest, &coarse);
    let fine = cells(graph, &[(0.625, 3.0), (0.25, 6.0), (0.125, 12.0)]);
    let eroded_from = graph.multiply(fine, 0.3);
    let eroded = graph.remap(&perlin_worley, [eroded_from, 1.0.into()], [0.0, 1.0], false);
    let profile = graph.trapezoid(&height);
    let factor = get("density") * (1.0 + 0.4 * get("precipitation"));
    let mut profile = graph.multiply(profile, factor);
    let mut threshold: Input = (1.0 - coverage).into();
    if get("cell_size") > 0.0 {
        let border = border_of_cells(graph, &place, values);
        let denser = graph.multiply_add(&border, get("cell_updraft"), 1.0);
        profile = graph.multiply(&profile, denser);
        // Nothing is divided by a coverage of 0.
        let covered = graph.multiply_add(border, -get("cell_downdraft") * coverage, coverage);
        let covered = graph.maximum(covered, 1e-4);
        threshold = graph.subtract(1.0, covered);
    }
    let shape = graph.remap(&eroded, [threshold, 1.0.into()], [0.0, 1.0], false);
    let mut density = graph.multiply_clamped(profile, shape);
    let radius = get("ball_radius");
    if radius > 0.0 {
        let [base, thickness] = [get("height"), get("thickness")];
        let field = ClusterField {
            seed: get("ball_seed"),
            spread: get("ball_spread"),
            base: base + 0.25 * thickness,
            height: 0.5 * thickness,
            radius,
            passed: 0.0,
        };
        // A body and not a fog of it: whole from a quarter of the way inside on.
        let occupied = graph.ellipsoids("SPHERES", &place, &field);
        let body = graph.smooth(0.0, 0.0625, &occupied);
        density = graph.multiply(density, body);
    }
    let radius = get("spine_radius");
    if radius == 0.0 {
        return density;
    }
    let softness = if kept.has(&defects::UNUSED_SOFTNESS) { 1.0 } else { get("spine_softness") };
    let [x, _, z] = graph.separate(&place);
    let band = graph.spine_band([&x, &z], &spine(values), radius, softness);
    graph.multiply(density, band)
}

/// How near a place is to the border of its cell: 1 on it, 0 in the middle. With the distances F1 and F2 to the two nearest centres, in cells,
/// and e = F2 - F1, 1 - clamp(e / width, 0, 1)^sharpness.
fn border_of_cells(graph: &mut NodeGraph, place: &Input, values: &Values) -> Input {
    let get = |name: &str| values.get(name);
    let per_metre = 1.0 / get("cell_size");
    let [x, _, z] = graph.separate(place);
    let mut in_cells = [x, z].map(|coordinate| graph.multiply(coordinate, per_metre));
    let warp = get("cell_warp");
    if warp > 0.0 {
        // Two slices of noise, half a cell coarse.
        let at = graph.combine([in_cells[0].clone(), 0.5.into(), in_cells[1].clone()]);
        let other = graph.affine(&at, [1.0; 3], [0.0, 17.0, 0.0]);
        for (coordinate, at) in in_cells.iter_mut().zip([at, other]) {
            let noise = graph.gradient_noise(&at, 2.0, 1);
            let moved = graph.multiply_add(noise, 2.0 * warp, -warp);
            *coordinate = graph.add(&*coordinate, moved);
        }
    }
    let [first, second] = graph.nearest_two([&in_cells[0], &in_cells[1]]);
    let apart = graph.subtract(second, first);
    let part = graph.multiply_clamped(apart, 1.0 / get("cell_width"));
    let edge = graph.math("POWER", &[part, get("cell_sharpness").into()]);
    graph.subtract(1.0, edge)
}

/// The middle of a street of clouds over (x, z): an arc in straight pieces through the origin.
fn spine(values: &Values) -> Vec<[f64; 2]> {
    const PIECES: u32 = 8;
    let [length, bend, direction] = ["spine_length", "spine_bend", "spine_direction"].map(|name| values.get(name));
    let piece = length / f64::from(PIECES);
    let turn = bend.to_radians() / f64::from(PIECES);
    let mut place = [0.0, 0.0];
    let mut line = vec![place];
    for number in 0..PIECES {
        let along = direction.to_radians() + turn * (f64::from(number) - f64::from(PIECES - 1) / 2.0);
        place = [place[0] + piece * along.cos(), place[1] + piece * along.sin()];
        line.push(place);
    }
    let [middle_x, middle_z] = line[PIECES as usize / 2];
    line.iter().map(|[x, z]| [x - middle_x, z - middle_z]).collect()
}

/// The engine's light. `calm` and `extinction` are per unit of density and length, for the march to the sun and for that of the view.
fn light(values: &Values, steps: u32, kept: &Defects, frame: &SlabFrame, [calm, extinction]: [f64; 2]) -> LightModel {
    let thickness = values.get("thickness") / frame.unit;
    // As a length over which extinction counts twice the density.
    let twice_density = if extinction > 0.0 { 2.0 / extinction } else { 0.0 };
    let is_vertical = kept.has(&defects::VERTICAL_LIGHT_STEP);
    let dims = if is_vertical { ShadowExtinction::Of(calm) } else { ShadowExtinction::View };
    let shadow = ShadowMarch::of_slab(steps, thickness, is_vertical, dims);
    let powder = if kept.has(&defects::POWDER_ON_ALL) { 1.0 } else { 0.0 };
    let boost = values.get("multi_scattering");
    LightModel {
        suns: vec![Sun { direction: [0.417, 0.558, 0.717], irradiance: [2.0, 1.9, 1.6] }],
        ambient: [0.6, 0.7, 0.9].map(|channel| 0.3 * channel),
        phase: TwoLobes { alpha: [1.0; 2], ..TwoLobes::new([0.3; 2], 0.0) },
        shadow,
        source: match kept.has(&defects::SOURCE_WITHOUT_ABSORPTION) {
            true => SourceFactor::Albedo([1.0 / values.get("light_absorption"); 3]),
            false => SourceFactor::Albedo([values.get("albedo"); 3]),
        },
        terms: Terms {
            exposure: if values.get("thunderstorm") == 1.0 { 0.4 } else { 1.0 },
            powder: Powder { strength: powder, length: twice_density, ambient: 1.0 },
            silver: SilverLining { strength: values.get("silver"), exponent: 8.0 },
            boost: Boost { light: 0.6 * boost, ambient: 0.3 * boost, length: twice_density, by_angle: true },
            ..Terms::NONE
        },
    }
}
