//! Defects of bestclouds that this program can keep.

use crate::engines::defects::Defect;

/// BE-1.
pub const PHASE_TWICE: Defect = Defect {
    id: "BE-1",
    about: "the phase function is applied twice: in the octaves and to their sum",
    corrected: "once",
};

/// BE-2.
pub const LEFT_ENDS: Defect = Defect {
    id: "BE-2",
    about: "the march towards the sun reads the begins of its steps, the shaded place first",
    corrected: "it reads the middles",
};

/// BE-3.
pub const DEPTH_BY_ANGLE: Defect = Defect {
    id: "BE-3",
    about: "the optical depth towards the sun shrinks by a quarter of the cosine to it",
    corrected: "it is what it is",
};

/// BE-7.
pub const SHIFTED_SLICES: Defect = Defect {
    id: "BE-7",
    about: "the noise lies half a texel off along the height",
    corrected: "it lies alike on all axes",
};

/// BE-9.
pub const LOST_TRANSMITTANCE: Defect =
    Defect { id: "BE-9", about: "below 0.01 the transmittance counts as 0", corrected: "it stays" };

/// All of them.
pub const DEFECTS: &[Defect] = &[PHASE_TWICE, LEFT_ENDS, DEPTH_BY_ANGLE, SHIFTED_SLICES, LOST_TRANSMITTANCE];
