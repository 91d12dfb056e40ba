//! How what a march came to is put over a background.

use crate::engines::march::RealTimePixel;
use serde::{Deserialize, Serialize};

/// How a pixel is put over a background. Nothing set is right: radiance + transmittance x background, channel by channel.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Compositing {
    /// Alpha is what red loses, for all channels.
    pub alpha_of_red: bool,
    /// Radiance, which is weighted already, is multiplied by alpha where there is a background.
    pub alpha_twice: bool,
}

impl Compositing {
    /// A pixel over the background, or with its alpha where there is none.
    pub fn composite(self, pixel: &RealTimePixel, background: Option<[f64; 3]>) -> [f64; 4] {
        let [red, green, blue] = pixel.radiance;
        let Some(background) = background else { return [red, green, blue, self.alpha(pixel)] };
        let mixed: [f64; 3] = std::array::from_fn(|channel| {
            let (alpha, through) = if self.alpha_of_red {
                let alpha = self.alpha(pixel);
                (alpha, 1.0 - alpha)
            } else {
                (1.0 - pixel.transmittance[channel], pixel.transmittance[channel])
            };
            let weight = if self.alpha_twice { alpha } else { 1.0 };
            pixel.radiance[channel] * weight + through * background[channel]
        });
        [mixed[0], mixed[1], mixed[2], 1.0]
    }

    /// Share of the background that is hidden, of all channels together: their mean, or red's.
    pub fn alpha(self, pixel: &RealTimePixel) -> f64 {
        if self.alpha_of_red {
            1.0 - pixel.transmittance[0]
        } else {
            1.0 - pixel.transmittance.iter().sum::<f64>() / 3.0
        }
    }
}
