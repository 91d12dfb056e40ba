//! Defects of the published Perlin-FBM engine that this program can keep. Those that cannot be kept (nothing would be drawn) or that are
//! no error of the engine are in docs/density-models.md.

use crate::engines::defects::Defect;

/// PF-1.
pub const FLATTENING_BY_ZERO: Defect = Defect {
    id: "PF-1",
    about: "a flattening that is not above 0 divides by zero: no cloud",
    corrected: "it counts as 1: no flattening",
};

/// PF-2.
pub const MASK_NOT_UPLOADED: Defect = Defect {
    id: "PF-2",
    about: "the mask's textures are never uploaded, both read 0: a smaller sphere without deformations",
    corrected: "the textures are read",
};

/// PF-3.
pub const MASK_NOISE_KEPT: Defect = Defect {
    id: "PF-3",
    about: "the mask's noise is made once: later seeds and frequencies never reach it",
    corrected: "they reach it",
};

/// PF-4.
pub const SHORT_SHADOW: Defect = Defect {
    id: "PF-4",
    about: "the march towards the sun is one side of the box long, without the opacity and tint of the view ray",
    corrected: "it ends where the box does, with the view ray's extinction",
};

/// PF-5.
pub const SOURCE_OF_DENSITY: Defect = Defect {
    id: "PF-5",
    about: "the source is the density alone, so that the albedo is one over opacity and tint",
    corrected: "it is extinction times the parameter albedo",
};

/// PF-6.
pub const PLAIN_SUM: Defect = Defect {
    id: "PF-6",
    about: "a step adds its source times its length, however dense it is",
    corrected: "it adds the integral over the step",
};

/// PF-7.
pub const ALPHA_OF_RED: Defect = Defect {
    id: "PF-7",
    about: "alpha is what red loses, the channel that loses least",
    corrected: "each channel has its own",
};

/// PF-8.
pub const ALPHA_TWICE: Defect = Defect {
    id: "PF-8",
    about: "the colour, weighted already, is multiplied by alpha again over a background",
    corrected: "colour + transmittance x background",
};

/// PF-9.
pub const EXIT_FADE: Defect = Defect {
    id: "PF-9",
    about: "the source fades over the last two steps of a ray, extinction does not: a dark rim",
    corrected: "no fade",
};

/// PF-13.
pub const GOD_RAYS_FROM_BEHIND: Defect = Defect {
    id: "PF-13",
    about: "god rays of a sun beside or behind the camera come from the mirrored point",
    corrected: "they fade out before the sun stands in the image plane",
};

/// All of them.
pub const DEFECTS: &[Defect] = &[
    FLATTENING_BY_ZERO,
    MASK_NOT_UPLOADED,
    MASK_NOISE_KEPT,
    SHORT_SHADOW,
    SOURCE_OF_DENSITY,
    PLAIN_SUM,
    ALPHA_OF_RED,
    ALPHA_TWICE,
    EXIT_FADE,
    GOD_RAYS_FROM_BEHIND,
];
