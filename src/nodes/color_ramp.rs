//! Color Ramp (`ShaderNodeValToRGB`): a colour and an alpha for a factor, between stops.
//!
//! The property `color_ramp` holds the stops and how colours between them are found. Cycles reads a table of
//! 257 colours ([`Ramp::table`]), which is built here as Blender builds it, in f32 and in its order of
//! operations; constant factors are folded by Blender, which evaluates the ramp itself ([`Ramp::color`]).

use crate::base::arrays::{Mapped, each};
use crate::base::error::{Error, Result};
use crate::nodes::color_space::blender::{hsl_to_rgb, hsv_to_rgb, rgb_to_hsl, rgb_to_hsv};
use crate::nodes::lookup_table::{CELLS, Table};
use crate::nodes::object_property::Part;
use crate::nodes::real::Real;
use crate::nodes::{
    Column, Data, Evaluate, InputSocket, Interval, Mode, NodeType, OutputSocket, Property, Role, always, lane_level,
};
use crate::scene::SocketType;
use fearless_simd::{dispatch, prelude::*};
use serde_json::{Value as Json, json};
use std::sync::Arc;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeValToRGB",
    label: "Color Ramp",
    module: "color_ramp",
    shader: include_str!("../../shaders/nodes/color_ramp.wgsl"),
    properties: &[Property::data("color_ramp", read, probes)],
    inputs: &[InputSocket::float("Fac", "Factor", &[0.5], always)],
    outputs: &[
        OutputSocket::new("Color", SocketType::Color, always),
        OutputSocket::new("Alpha", SocketType::Float, always),
    ],
    role: Role::Evaluated(|mode| Box::new(ColorRamp::new(mode))),
};

/// Names of the interpolations between two stops; the first is Blender's default. They hold in colour mode
/// RGB; the other modes interpolate linearly.
pub const INTERPOLATIONS: &[&str] = &["LINEAR", "EASE", "CARDINAL", "B_SPLINE", "CONSTANT"];

/// Names of the ways around the circle of hues; the first is Blender's default.
pub const HUE_INTERPOLATIONS: &[&str] = &["NEAR", "FAR", "CW", "CCW"];

/// Names of the colour modes; the first is Blender's default.
pub const COLOR_MODES: &[&str] = &["RGB", "HSV", "HSL"];

/// Blender keeps no more stops.
const MOST_STOPS: usize = 32;

/// Tension of the cardinal spline.
const TENSION: f32 = 0.71;

/// A stop of a ramp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stop {
    /// Place, from 0 to 1.
    pub position: f32,
    /// Red, green, blue and alpha; not negative.
    pub color: [f32; 4],
}

/// A colour ramp and its table.
#[derive(Clone, PartialEq)]
pub struct Ramp {
    interpolation: &'static str,
    hue_interpolation: &'static str,
    color_mode: &'static str,
    stops: Vec<Stop>,
    table: Table,
}

/// What it was made from: the table follows from it.
impl std::fmt::Debug for Ramp {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names = [self.interpolation, self.hue_interpolation, self.color_mode];
        write!(f, "Ramp({names:?}, {:?})", self.stops)
    }
}

impl Ramp {
    /// A ramp of these stops, in Blender's stored order; `place` is for errors. The names are some of
    /// [`INTERPOLATIONS`], [`HUE_INTERPOLATIONS`] and [`COLOR_MODES`].
    pub fn new(
        [interpolation, hue_interpolation, color_mode]: [&'static str; 3],
        stops: Vec<Stop>,
        place: &str,
    ) -> Result<Self> {
        let empty = Table::new(0, false, |_| Vec::new());
        let mut ramp = Self { interpolation, hue_interpolation, color_mode, stops, table: empty };
        // The stored interpolation decides about the lookup, whatever the colour mode makes of the table.
        let interpolates = interpolation != "CONSTANT";
        ramp.table = Table::new(4, interpolates, |index| ramp.color(index as f32 / CELLS as f32).to_vec());
        if ramp.table.is_finite() {
            return Ok(ramp);
        }
        Err(Error::new(
            place,
            format!("colours that {color_mode} mode turns into infinity or NaN"),
            "colours between which every colour is finite",
            "Choose colours between 0 and 1, or the colour mode RGB.",
        ))
    }

    /// The table that Cycles reads: channels red, green, blue and alpha.
    pub fn table(&self) -> &Table {
        &self.table
    }

    /// In a few words.
    pub fn describe(&self) -> String {
        let way = match self.color_mode {
            "RGB" => self.interpolation.to_owned(),
            // A stored CONSTANT still makes steps.
            _ if self.interpolation == "CONSTANT" => format!("{} CONSTANT", self.hue_interpolation),
            _ => self.hue_interpolation.to_owned(),
        };
        let positions: Vec<String> = self.stops.iter().map(|stop| stop.position.to_string()).collect();
        format!("{} {way} stops {}", self.color_mode, positions.join(" "))
    }

    /// The colour and alpha at a position, as Blender evaluates the ramp.
    pub fn color(&self, position: f32) -> [f32; 4] {
        let stops = &self.stops;
        let count = stops.len();
        let kind = if self.color_mode == "RGB" { self.interpolation } else { "LINEAR" };
        let is_spline = matches!(kind, "CARDINAL" | "B_SPLINE");
        if count == 1 || (!is_spline && position <= stops[0].position) {
            return stops[0].color;
        }
        // The stops around the position; the first and the last one reach to the ends.
        let after = stops.iter().position(|stop| stop.position > position).unwrap_or(count);
        let left = match after {
            0 => Stop { position: 0.0, ..stops[0] },
            _ => stops[after - 1],
        };
        let right = if after == count { Stop { position: 1.0, ..stops[count - 1] } } else { stops[after] };
        if kind == "CONSTANT" || (after == count && !is_spline) {
            return left.color;
        }
        // From 0 at the right stop to 1 at the left one.
        let f = if left.position != right.position {
            (position - right.position) / (left.position - right.position)
        } else if after != count {
            0.0
        } else {
            1.0
        };
        if is_spline {
            let beyond_right = if after >= count - 1 { right } else { stops[after + 1] };
            let beyond_left = if after < 2 { left } else { stops[after - 2] };
            let weights = spline_weights(kind, f.clamp(0.0, 1.0));
            let control = [beyond_right, right, left, beyond_left].mapped(|stop| stop.color);
            return each(|channel| {
                let term = |number: usize| weights[number] * control[number][channel];
                (((term(3) + term(2)) + term(1)) + term(0)).clamp(0.0, 1.0)
            });
        }
        let f = if kind == "EASE" { ease(f) } else { f };
        let mixed_channel = |channel: usize| between(f, right.color[channel], left.color[channel]);
        if self.color_mode == "RGB" {
            return each(mixed_channel);
        }
        let [from, to] = [right, left].mapped(|stop| {
            let [red, green, blue, _] = stop.color;
            if self.color_mode == "HSV" { rgb_to_hsv([red, green, blue]) } else { rgb_to_hsl([red, green, blue]) }
        });
        let mixed = [
            hue_between(self.hue_interpolation, f, from[0], to[0]),
            between(f, from[1], to[1]),
            between(f, from[2], to[2]),
        ];
        let [red, green, blue] = if self.color_mode == "HSV" { hsv_to_rgb(mixed) } else { hsl_to_rgb(mixed) };
        [red, green, blue, mixed_channel(3)]
    }
}

/// `a` for f = 0, `b` for f = 1.
fn between(f: f32, a: f32, b: f32) -> f32 {
    (1.0 - f) * a + f * b
}

/// Cubic step.
fn ease(f: f32) -> f32 {
    let square = f * f;
    3.0 * square - (2.0 * square) * f
}

/// Weights of four neighbouring colours, from right to left.
fn spline_weights(kind: &str, f: f32) -> [f32; 4] {
    let f2 = f * f;
    let f3 = f2 * f;
    if kind == "CARDINAL" {
        let k = TENSION;
        return [
            (-k * f3 + (2.0 * k) * f2) - k * f,
            ((2.0 - k) * f3 + (k - 3.0) * f2) + 1.0,
            ((k - 2.0) * f3 + (3.0 - 2.0 * k) * f2) + k * f,
            k * f3 - k * f2,
        ];
    }
    let (sixth, two_thirds) = (0.166_666_66_f32, 2.0 / 3.0);
    [
        ((-sixth * f3 + 0.5 * f2) - 0.5 * f) + sixth,
        (0.5 * f3 - f2) + two_thirds,
        ((-0.5 * f3 + 0.5 * f2) + 0.5 * f) + sixth,
        sixth * f3,
    ]
}

/// A hue in turns, brought below 1.
fn reduced(hue: f32) -> f32 {
    if hue < 1.0 { hue } else { hue - 1.0 }
}

/// The hue between two, along the chosen way around the circle.
fn hue_between(way: &str, f: f32, from: f32, to: f32) -> f32 {
    let (mut from, mut to) = (reduced(from), reduced(to));
    let ahead = to - from;
    let (raise_from, raise_to) = match way {
        "NEAR" => (from < to && ahead > 0.5, from > to && ahead < -0.5),
        "FAR" => (from == to || (from < to && ahead < 0.5), from > to && ahead > -0.5),
        "CCW" => (false, from > to),
        _ => (from < to, false),
    };
    if raise_from {
        from += 1.0;
    }
    if raise_to {
        to += 1.0;
    }
    let hue = between(f, from, to);
    if raise_from || raise_to { reduced(hue) } else { hue }
}

/// Reads the property; nothing means Blender's default, black to white.
fn read(given: Option<&Json>, place: &str) -> Result<Data> {
    let default = json!({
        "interpolation": "LINEAR", "hue_interpolation": "NEAR", "color_mode": "RGB",
        "elements": [
            {"position": 0.0, "color": [0.0, 0.0, 0.0, 1.0]},
            {"position": 1.0, "color": [1.0, 1.0, 1.0, 1.0]},
        ],
    });
    let value = given.unwrap_or(&default);
    let [interpolation, hue_interpolation, color_mode, elements] =
        Part::new(value, place).members(["interpolation", "hue_interpolation", "color_mode", "elements"])?;
    let names = [
        interpolation.part().name(INTERPOLATIONS)?,
        hue_interpolation.part().name(HUE_INTERPOLATIONS)?,
        color_mode.part().name(COLOR_MODES)?,
    ];
    let mut stops = Vec::new();
    for element in elements.part().items([1, MOST_STOPS], "stops")? {
        let [position, color] = element.part().members(["position", "color"])?;
        let position = position.part().number([0.0, 1.0])?;
        stops.push(Stop { position, color: color.part().numbers([0.0, f32::MAX])? });
    }
    Ramp::new(names, stops, place).map(|ramp| Data::Ramp(Arc::new(ramp)))
}

/// What the comparison with Cycles tries: the default, every interpolation, colour mode and way between hues, one to
/// seven stops, at places between the entries of the table, coincident, and at neither end.
fn probes() -> Vec<Json> {
    let stop = |position: f64, color: [f64; 4]| json!({"position": position, "color": color});
    let grey = vec![stop(0.0, [0.0, 0.0, 0.0, 1.0]), stop(1.0, [1.0, 1.0, 1.0, 1.0])];
    let one = vec![stop(0.35, [0.2, 0.7, 1.5, 0.4])];
    let three =
        vec![stop(0.12, [0.9, 0.1, 0.05, 1.0]), stop(0.47, [0.02, 0.6, 0.9, 0.25]), stop(0.83, [0.3, 0.9, 0.2, 0.75])];
    let sharp = vec![
        stop(0.0, [0.1, 0.0, 0.8, 0.0]),
        stop(0.4, [1.0, 1.0, 0.0, 1.0]),
        stop(0.4, [0.0, 0.2, 0.3, 0.5]),
        stop(0.401, [2.0, 0.5, 0.25, 0.1]),
        stop(1.0, [0.6, 0.6, 0.6, 0.9]),
    ];
    let seven: Vec<Json> = (0..7)
        .map(|number| {
            let t = f64::from(number);
            stop(0.07 + 0.14 * t, [0.5 + 0.5 * (2.0 * t).sin(), 0.5 + 0.5 * (3.0 * t).cos(), 0.15 * t, 1.0 - 0.1 * t])
        })
        .collect();
    let probe = |color_mode: &str, interpolation: &str, way: &str, elements: &Vec<Json>| {
        let elements = elements.iter().map(single_precision).collect::<Vec<_>>();
        json!({
            "interpolation": interpolation, "hue_interpolation": way, "color_mode": color_mode, "elements": elements,
        })
    };
    vec![
        probe("RGB", "LINEAR", "NEAR", &grey),
        probe("RGB", "LINEAR", "NEAR", &one),
        probe("RGB", "LINEAR", "NEAR", &sharp),
        probe("RGB", "EASE", "NEAR", &three),
        probe("RGB", "CARDINAL", "NEAR", &three),
        probe("RGB", "CARDINAL", "NEAR", &seven),
        probe("RGB", "B_SPLINE", "NEAR", &sharp),
        probe("RGB", "B_SPLINE", "NEAR", &seven),
        probe("RGB", "CONSTANT", "NEAR", &three),
        probe("RGB", "CONSTANT", "NEAR", &sharp),
        probe("HSV", "LINEAR", "NEAR", &three),
        probe("HSV", "B_SPLINE", "FAR", &seven),
        probe("HSV", "CONSTANT", "CW", &three),
        probe("HSL", "EASE", "CCW", &three),
        probe("HSL", "LINEAR", "FAR", &three),
        probe("HSL", "LINEAR", "CW", &seven),
    ]
}

/// A stop with its numbers rounded to f32, as scene files have them.
fn single_precision(stop: &Json) -> Json {
    let single = |value: &Json| {
        let shortest = (value.as_f64().unwrap_or(0.0) as f32).to_string();
        shortest.parse::<f64>().map_or(Json::Null, Json::from)
    };
    let color: Vec<Json> = stop["color"].as_array().into_iter().flatten().map(single).collect();
    json!({"position": single(&stop["position"]), "color": color})
}

struct ColorRamp {
    ramp: Arc<Ramp>,
    /// Channels of the wanted outputs.
    channels: Vec<usize>,
}

impl ColorRamp {
    fn new(mode: &Mode) -> Self {
        let Data::Ramp(ramp) = mode.data("color_ramp") else { unreachable!("this property reads ramps") };
        let color = if mode.wants("Color") { 0..3 } else { 0..0 };
        let alpha = if mode.wants("Alpha") { 3..4 } else { 3..3 };
        Self { ramp: Arc::clone(ramp), channels: color.chain(alpha).collect() }
    }
}

/// Points that are looked up before their channels are written.
const ABREAST: usize = 64;

impl ColorRamp {
    #[inline(always)]
    fn evaluate_points<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        let table = self.ramp.table();
        let factors = &inputs[0].values[..outputs[0].len()];
        for (batch, factors) in factors.chunks(ABREAST).enumerate() {
            // Finding places takes several points at once, looking up does not.
            let mut positions = [R::of(0.0); ABREAST];
            for (position, &factor) in positions.iter_mut().zip(factors) {
                *position = Table::position(factor);
            }
            let cells = positions.mapped(R::to_int);
            let rests: [R; ABREAST] = each(|index| positions[index] - R::of(cells[index] as f32));
            let mut colors = [[R::of(0.0); 4]; ABREAST];
            for (index, color) in colors[..factors.len()].iter_mut().enumerate() {
                *color = table.values(table.place_of(positions[index], cells[index], rests[index]));
            }
            for (output, &channel) in outputs.iter_mut().zip(&self.channels) {
                let results = &mut output[batch * ABREAST..][..factors.len()];
                results.iter_mut().zip(&colors).for_each(|(result, color)| *result = color[channel]);
            }
        }
    }
}

impl Evaluate for ColorRamp {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        self.evaluate_points(inputs, outputs);
    }

    /// The same, compiled for this machine's instructions.
    fn evaluate_fast(&self, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) -> bool {
        dispatch!(lane_level(), simd => simd.vectorize(
            #[inline(always)]
            || self.evaluate_points(inputs, outputs),
        ));
        true
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        for (output, &channel) in outputs.iter_mut().zip(&self.channels) {
            *output = self.ramp.table().enclose(channel, inputs[0]);
        }
    }

    fn fold_constants(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        let color = self.ramp.color(inputs[0]);
        Some(self.channels.iter().map(|&channel| color[channel]).collect())
    }

    fn shader_constants(&self) -> String {
        self.ramp.table().shader()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(given: &Json) -> Arc<Ramp> {
        match read(Some(given), "ramp").expect("a ramp") {
            Data::Ramp(ramp) => ramp,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn colours_are_those_of_blender() {
        // `ColorRamp.evaluate` of Blender 5.0.1: probe, position, colour.
        let golden: [(usize, f32, [f32; 4]); 14] = [
            (2, 0.4375, [1.914_691_2, 0.506_093_5, 0.271_327_2, 0.148_747_86]),
            (3, 0.3, [0.441_147_95, 0.360_711_4, 0.493_209_3, 0.608_932_9]),
            (4, 0.4375, [0.069_018_945, 0.547_241_2, 0.875_956_36, 0.277_597_72]),
            (5, 0.9, [0.228_93, 0.788_452_45, 0.892_263_23, 0.405_157_83]),
            (6, 0.4375, [1.0, 0.478_486_15, 0.326_521_25, 0.314_339_4]),
            (7, 0.9, [0.230_997_38, 0.684_790_97, 0.869_269_25, 0.420_487_14]),
            (8, 0.4375, [0.9, 0.1, 0.05, 1.0]),
            (9, 0.9, [2.0, 0.5, 0.25, 0.1]),
            (10, 0.4375, [0.022_785_686, 0.379_560_35, 0.9, 0.319_642_84]),
            (11, 0.3, [0.079_263_71, 0.518_326_2, 0.971_000_73, 0.835_714_34]),
            (12, 0.3, [0.253_738_4, 0.9, 0.034_571_42, 0.614_285_7]),
            (13, 0.4375, [0.022_707_641, 0.379_545_6, 0.900_078_06, 0.319_642_84]),
            (14, 0.3, [0.253_623_96, 0.900_231_5, 0.034_339_905, 0.614_285_7]),
            (15, 0.9, [0.216_634_36, 0.896_396_4, 0.727_903, 0.407_142_9]),
        ];
        for (probe, position, color) in golden {
            let ramp = ramp(&probes()[probe]);
            let found = ramp.color(position);
            assert_eq!(found, color, "{ramp:?} at {position}");
            // At entries the table is the ramp; between them it is near, apart from sharp stops.
            let table = ramp.table();
            let looked_up: [f32; 4] = std::array::from_fn(|channel| table.value(channel, table.place(position)));
            if position == 0.4375 {
                assert_eq!(looked_up, color, "{ramp:?}");
            } else if ramp.interpolation != "CONSTANT" {
                assert!(looked_up.iter().zip(color).all(|(a, b)| (a - b).abs() < 5e-3), "{looked_up:?} {color:?}");
            }
        }
    }

    #[test]
    fn steps_are_taken_at_the_next_entry() {
        // The stop at 0.47 lies between the entries 120 and 121.
        let ramp = ramp(&probes()[8]);
        let red = |factor: f32| ramp.table().value(0, ramp.table().place(factor));
        assert_eq!([red(0.4726), red(0.472_656_25)], [0.9, 0.02]);
    }

    #[test]
    fn every_probe_is_a_ramp_of_its_own() {
        let ramps: Vec<_> = probes().iter().map(ramp).collect();
        for (number, one) in ramps.iter().enumerate() {
            assert!(ramps[..number].iter().all(|other| other != one && other.describe() != one.describe()));
        }
        assert_eq!(read(None, "ramp").expect("the default"), Data::Ramp(Arc::clone(&ramps[0])));
    }

    #[test]
    fn wrong_ramps_are_refused_at_their_place() {
        for (path, wrong, place) in [
            ("/interpolation", json!("CUBIC"), "ramp.interpolation"),
            ("/elements", json!([]), "ramp.elements"),
            ("/elements/0/position", json!(1.5), "ramp.elements[0].position"),
            ("/elements/1/color/2", json!(-1), "ramp.elements[1].color[2]"),
            ("/elements/1/color", json!([1, 1, 1]), "ramp.elements[1].color"),
            ("/elements/0", json!({"position": 0}), "ramp.elements[0]"),
        ] {
            let mut value = probes()[3].clone();
            *value.pointer_mut(path).expect("it is there") = wrong;
            assert_eq!(read(Some(&value), "ramp").expect_err(path).place, place);
        }
        // The lightness of such a pair has saturation 1 / 0.
        let mut value = probes()[14].clone();
        value["elements"][0]["color"] = json!([1.5, 0.5, 0.5, 1.0]);
        assert!(read(Some(&value), "ramp").is_err());
    }
}
