//! Defects of the skill's mesh clusters that this program can keep.

use crate::engines::defects::Defect;

/// SK-15.
pub const OVERLAPPING_NUMBERS: Defect = Defect {
    id: "SK-15",
    about: "particles draw from one sequence, each a number after the one before: the place of one is the size of another",
    corrected: "each has numbers of its own",
};

/// All of them.
pub const DEFECTS: &[Defect] = &[OVERLAPPING_NUMBERS];
