//! Defects of @takram/three-clouds that this program can keep.

use crate::engines::defects::Defect;

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

/// TK-18, of chapter 6.6; the number is ours.
pub const SHORT_LIGHT_MARCH: Defect = Defect {
    id: "TK-18",
    about: "two steps towards the sun, 150 m together: what lies beyond is left to shadow maps, which are not here",
    corrected: "six steps to the exit, at most four thicknesses, each twice as long as the one before",
};

/// All of them.
pub const DEFECTS: &[Defect] = &[DIAGONAL_FEATURES, RESCALED_ALPHA, SHORT_LIGHT_MARCH];
