//! The sky of boltbestclouds32: a gradient, lobes of scattered light around the sun and a glow along the horizon. An artist's sky: the
//! Rayleigh term falls towards the zenith, since the gradient has the colour. Layers and stars of the original are not here.

use crate::base::interpolation::smooth;
use crate::engines::parameters::{Range, Values, parameter};
use crate::engines::sky::{Look, Sky, mix};
use crate::media::phase::draine;
use glam::DVec3;
use std::f64::consts::PI;

/// Of the system's document.
pub static SKY: Sky = Sky {
    about: "a gradient from horizon to zenith, Rayleigh and Mie lobes around the sun, a glow along the horizon, dark at night",
    parameters: &[
        parameter("rayleigh", 1.0, Range::NotNegative, [0.0, 2.0], "", "factor on the light that air scatters"),
        parameter("mie", 1.0, Range::NotNegative, [0.0, 2.0], "", "factor on the light that haze scatters"),
    ],
    look,
};

/// Anisotropy of the haze.
const HAZE: f64 = 0.76;

const SUN: [f64; 3] = [1.0, 0.95, 0.8];
/// Radiance along the horizon.
pub const HORIZON: [f64; 3] = [0.6, 0.7, 0.9];
const ZENITH: [f64; 3] = [0.1, 0.3, 0.6];

fn look(values: &Values, sun: DVec3) -> Look {
    let [rayleigh, mie] = ["rayleigh", "mie"].map(|name| values.get(name));
    let up = sun.z;
    let tint = mix([1.0, 0.3, 0.05], SUN, smooth(-0.1, 0.5, up.clamp(-0.1, 1.0)));
    let night = 1.0 - smooth(-0.2, 0.1, up);
    let glow = mix([1.0, 0.4, 0.1], [1.0, 0.8, 0.6], up).map(|channel| 0.5 * smooth(-0.2, 0.1, up) * channel);
    let radiance = move |direction: DVec3| {
        let cosine = direction.dot(sun);
        let height = direction.z.max(0.0);
        let air = 3.0 / (16.0 * PI) * (1.0 + cosine * cosine) * rayleigh * (-3.5 * height).exp() * 50.0;
        let haze = 21e-6 * mie * draine(HAZE, 1.0, cosine) * (-height).exp() * 25.0;
        let gradient = mix(HORIZON, ZENITH, height.min(1.0).sqrt());
        let near = (1.0 - direction.z.abs()).max(0.0).powi(8);
        let air = [5.8e-6, 13.5e-6, 33.1e-6].map(|channel| channel * air);
        let day: [f64; 3] = std::array::from_fn(|channel| {
            gradient[channel] + (air[channel] + haze) * tint[channel] * 2.0 + near * glow[channel]
        });
        mix(day, [0.01, 0.015, 0.03], night)
    };
    Look { sun: tint, radiance: Box::new(radiance) }
}
