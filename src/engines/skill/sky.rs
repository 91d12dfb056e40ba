//! Times of day of the procedural-clouds skill: a gradient from zenith to horizon, tinted by the sun's height, and the sun's colour.

use crate::engines::parameters::{Range, Values, parameter};
use crate::engines::sky::{Look, Sky, mix, of_web};
use glam::DVec3;

/// Of the system's document.
pub static SKY: Sky = Sky {
    about: "a gradient from zenith to horizon in the tint of the time of day, which the sun's height tells; the sun in its colour",
    parameters: &[parameter(
        "jumps",
        0.0,
        Range::Whole(0, 1),
        [0.0, 1.0],
        "",
        "1: colours jump at heights of 0, 0.1 and 0.3 (defect SK-12); 0: they blend over 0.05",
    )],
    look,
};

/// Sun and tint below a sine of the sun's height, and above all.
const TIMES: [(f64, [u32; 2]); 4] = [
    (0.0, [0x112244, 0x1a1a2e]),
    (0.1, [0xff6622, 0xff8844]),
    (0.3, [0xffcc88, 0xffeedd]),
    (2.0, [0xfff8e7, 0xffffff]),
];

/// Colours at parts of the way from the zenith to the horizon.
const GRADIENT: [(f64, u32); 4] = [(0.0, 0x0a4a8a), (0.5, 0x5b9bd5), (0.8, 0xc8ddf0), (1.0, 0xe8dcc8)];

/// Over which sines of the sun's height colours blend.
const BLEND: f64 = 0.05;

/// Colours of sun and tint at a sine of the sun's height.
fn time_of_day(up: f64, jumps: bool) -> [[f64; 3]; 2] {
    let mut found = TIMES[0].1.map(of_web);
    for pair in TIMES.windows(2) {
        let (limit, next) = (pair[0].0, pair[1].1.map(of_web));
        let part = if jumps { f64::from(u8::from(up >= limit)) } else { ((up - limit) / BLEND + 0.5).clamp(0.0, 1.0) };
        found = [0, 1].map(|which| mix(found[which], next[which], part));
    }
    found
}

fn look(values: &Values, sun: DVec3) -> Look {
    let [colour, tint] = time_of_day(sun.z, values.get("jumps") == 1.0);
    let gradient = GRADIENT.map(|(part, colour)| (part, of_web(colour)));
    let radiance = move |direction: DVec3| {
        // Below the horizon its colour goes on.
        let down = 1.0 - direction.z.clamp(0.0, 1.0);
        let above = gradient.windows(2).find(|pair| down <= pair[1].0).unwrap_or(&gradient[2..]);
        let [(from, first), (to, last)] = [above[0], above[1]];
        let sky = mix(first, last, (down - from) / (to - from));
        [0, 1, 2].map(|channel| sky[channel] * tint[channel])
    };
    Look { sun: colour, radiance: Box::new(radiance) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_jump_as_published_and_blend_else() {
        for (limit, _) in &TIMES[..3] {
            let [below, above] = [-1e-9, 1e-9].map(|step| time_of_day(limit + step, true));
            assert_ne!(below, above, "at {limit}");
            let [below, above] = [-1e-9, 1e-9].map(|step| time_of_day(limit + step, false));
            let apart = below.as_flattened().iter().zip(above.as_flattened()).map(|(a, b)| (a - b).abs());
            assert!(apart.fold(0.0, f64::max) < 1e-6, "at {limit}");
            // Away from the limit both are the table's.
            assert_eq!(time_of_day(limit + BLEND, true), time_of_day(limit + BLEND, false));
        }
    }
}
