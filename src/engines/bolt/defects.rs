//! Defects of boltbestclouds32 that this program can keep. Those of passes and levels of detail that are not here, and those that cannot be
//! kept, are in docs/published-systems.md.

use crate::engines::defects::Defect;

/// BO-1.
pub const SOURCE_WITHOUT_ABSORPTION: Defect = Defect {
    id: "BO-1",
    about: "the source is 0.01 times the density, whatever the light absorption A of the extinction is: an albedo of 1 / A",
    corrected: "it is extinction times the parameter albedo",
};

/// MS-1, of the document that describes the system.
pub const UNUSED_SOFTNESS: Defect = Defect {
    id: "MS-1",
    about: "the softness of a street's edge is not used: it fades over the whole half width",
    corrected: "it fades over that share of it",
};

/// BO-2.
pub const ALPHA_TWICE: Defect = Defect {
    id: "BO-2",
    about: "the colour, weighted already, is multiplied by alpha again over a background",
    corrected: "colour + transmittance x background",
};

/// BO-6.
pub const VERTICAL_LIGHT_STEP: Defect = Defect {
    id: "BO-6",
    about: "the march towards the sun is as long as the layer is thick, however low the sun stands, and reads the ends of its steps",
    corrected: "it goes to the exit, at most four thicknesses, and reads the middles",
};

/// BO-7.
pub const POWDER_ON_ALL: Defect = Defect {
    id: "BO-7",
    about: "powder dims the ambient light, too, and leaves nothing of thin cloud",
    corrected: "no powder",
};

/// BO-8.
pub const BIASED_GRADIENTS: Defect = Defect {
    id: "BO-8",
    about: "gradients of the noise lie mostly in the positive octant",
    corrected: "they are even (Blender's Noise Texture)",
};

/// BO-14, of chapter 2.6; the number is ours.
pub const PLAIN_SUM: Defect = Defect {
    id: "BO-14",
    about: "a step adds its source times its length, however dense it is",
    corrected: "it adds the integral over the step",
};

/// MS-2.
pub const FOG_AT_THE_ZENITH: Defect = Defect {
    id: "MS-2",
    about: "height fog by the document's line, which lacks parentheses: 1 - exp(-distance) exp(-height)",
    corrected: "(1 - exp(-distance)) exp(-height), as the source has it",
};

/// BO-15, of chapter 5.3; the number is ours.
pub const RAYS_BY_NUMBER: Defect = Defect {
    id: "BO-15",
    about: "god rays of the march count their samples, whatever their length, and know no shadow: each loses half the cloud's density where it lies",
    corrected: "an integral over the way, of what the cloud lets through from the sun",
};

/// BO-4.
pub const STEPS_WITH_REST: Defect = Defect {
    id: "BO-4",
    about: "steps by distance divide a ray by a number with a rest, whose whole steps are done: the end of the ray is not marched",
    corrected: "by the nearest whole number",
};

/// BO-5.
pub const STEPS_BEYOND_ASKED: Defect = Defect {
    id: "BO-5",
    about: "the floors of steps by distance hold whatever number is asked for: far away it takes more steps than near by",
    corrected: "never more than near by",
};

/// All of them.
pub const DEFECTS: &[Defect] = &[
    SOURCE_WITHOUT_ABSORPTION,
    ALPHA_TWICE,
    STEPS_WITH_REST,
    STEPS_BEYOND_ASKED,
    VERTICAL_LIGHT_STEP,
    POWDER_ON_ALL,
    BIASED_GRADIENTS,
    PLAIN_SUM,
    UNUSED_SOFTNESS,
    FOG_AT_THE_ZENITH,
    RAYS_BY_NUMBER,
];
