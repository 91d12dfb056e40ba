//! Defects of the procedural-clouds skill's slab that this program can keep. Those of its meshes, billboards and skies, and those that cannot
//! be kept, are in docs/published-systems.md.

use crate::engines::defects::Defect;

/// SK-1.
pub const SIGNED_LATTICE: Defect = Defect {
    id: "SK-1",
    about: "lattice values keep the sign of a remainder: from -1 to 1, so that the threshold cuts deeper",
    corrected: "they lie from 0 to 1",
};

/// SK-4.
pub const RIM_AT_RIGHT_ANGLES: Defect = Defect {
    id: "SK-4",
    about: "the silver lining is brightest at right angles to the sun",
    corrected: "it is towards the sun, cosine^8",
};

/// SK-6.
pub const PHASE_OF_ONE_AND_A_HALF: Defect = Defect {
    id: "SK-6",
    about: "the phase function's lobes have weights of 1.5 together",
    corrected: "they are divided by it",
};

/// SK-7.
pub const HALF_POWDER: Defect = Defect {
    id: "SK-7",
    about: "half beer-powder: half of the sun's light where nothing stands before it",
    corrected: "Beer's law",
};

/// SK-8.
pub const VERTICAL_LIGHT_STEP: Defect = Defect {
    id: "SK-8",
    about: "the march towards the sun is as long as the layer is thick, however low the sun stands, and reads the ends of its steps",
    corrected: "it goes to the exit, at most four thicknesses, and reads the middles",
};

/// All of them.
pub const DEFECTS: &[Defect] =
    &[SIGNED_LATTICE, RIM_AT_RIGHT_ANGLES, PHASE_OF_ONE_AND_A_HALF, HALF_POWDER, VERTICAL_LIGHT_STEP];
