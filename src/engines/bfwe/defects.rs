//! Defects of bfwe-testbed that this program can keep. The specification names two that cannot be; the numbers of these are ours.

use crate::engines::defects::Defect;

/// BF-3.
pub const POWDER: Defect =
    Defect { id: "BF-3", about: "powder leaves nothing of the sun's light in thin cloud", corrected: "no powder" };

/// BF-4.
pub const PLAIN_SUM: Defect = Defect {
    id: "BF-4",
    about: "a step adds its source times its length, however dense it is",
    corrected: "it adds the integral over the step",
};

/// All of them.
pub const DEFECTS: &[Defect] = &[POWDER, PLAIN_SUM];
