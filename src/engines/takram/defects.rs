//! Defects of @takram/three-clouds that this program can keep.

use crate::engines::defects::Defect;

/// TK-3.
pub const DOUBLED_START: Defect = Defect {
    id: "TK-3",
    about: "the jitter of a view ray's start counts twice: its first sample lies up to two steps in the domain",
    corrected: "once",
};

/// TK-7.
pub const DIAGONAL_FEATURES: Defect = Defect {
    id: "TK-7",
    about: "feature points of the cellular noise lie on the diagonals of their cells",
    corrected: "they lie anywhere in them",
};

/// TK-12.
pub const RESCALED_ALPHA: Defect = Defect {
    id: "TK-12",
    about: "opacity is stretched so that the transmittance at which rays end counts as 0",
    corrected: "it is 1 minus the transmittance",
};

/// TK-8.
pub const HALF_FLOATS: Defect = Defect {
    id: "TK-8",
    about: "the shadow map keeps its front depth as half floats of metres: 2 m apart from 2 km on",
    corrected: "as floats",
};

/// TK-10.
pub const TO_LAST_SAMPLE: Defect = Defect {
    id: "TK-10",
    about: "the march towards the sun is taken to end at its last sample: the shadow map counts the rest of its step again",
    corrected: "it ends where its last step does",
};

/// TK-14.
pub const FRONT_BY_WHAT_IS_LEFT: Defect = Defect {
    id: "TK-14",
    about: "the front depth weighs distances by the light that a step leaves, so that an opaque first step hardly counts",
    corrected: "by the light that it takes",
};

/// TK-11.
pub const FADING_SHAFTS: Defect = Defect {
    id: "TK-11",
    about: "each step of the shadow's length along a view ray counts a thousandth less than the one before",
    corrected: "all count alike",
};

/// TK-18; the number is ours.
pub const LEVEL_HAZE: Defect = Defect {
    id: "TK-18",
    about: "haze ends at the top of the layers, and below the horizon it is that of the camera's height, however far down a ray goes",
    corrected: "it thickens towards the ground and thins out above",
};

/// All of them.
pub const DEFECTS: &[Defect] = &[
    DOUBLED_START,
    DIAGONAL_FEATURES,
    HALF_FLOATS,
    TO_LAST_SAMPLE,
    FADING_SHAFTS,
    RESCALED_ALPHA,
    FRONT_BY_WHAT_IS_LEFT,
    LEVEL_HAZE,
];
