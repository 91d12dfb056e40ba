//! The table of jitter that the reference pictures of the Perlin-FBM engine are made with: 16 x 16 bytes of white noise.
//!
//! The engine names an image of blue noise that its document does not hold, and falls back to white noise without a seed (defect PF-16);
//! its reference data come with this table in their place. tests/golden.rs compares it with them.

use crate::view::blue_noise::in_frame;

/// Fragments per side, after which the table repeats.
pub const SIDE: usize = 16;

/// 255 times the value of a fragment, row by row from the bottom.
#[rustfmt::skip]
const TABLE: [[u8; SIDE]; SIDE] = [
    [244, 171, 202, 163, 123, 248, 244, 39, 51, 40, 197, 73, 234, 233, 187, 84],
    [231, 235, 157, 192, 184, 79, 45, 253, 73, 253, 174, 112, 229, 80, 134, 125],
    [9, 236, 32, 172, 253, 188, 93, 220, 87, 71, 211, 190, 48, 197, 189, 6],
    [245, 212, 185, 221, 142, 48, 107, 100, 110, 168, 116, 179, 125, 114, 138, 59],
    [37, 17, 75, 32, 24, 19, 247, 51, 16, 126, 143, 7, 4, 66, 125, 139],
    [33, 231, 153, 27, 30, 199, 82, 179, 252, 84, 28, 106, 3, 70, 90, 218],
    [18, 57, 229, 242, 195, 67, 194, 138, 51, 129, 155, 166, 67, 244, 155, 70],
    [201, 72, 113, 191, 167, 179, 243, 135, 99, 103, 78, 85, 157, 193, 178, 28],
    [184, 180, 188, 153, 235, 7, 169, 174, 125, 203, 23, 128, 35, 186, 170, 166],
    [16, 123, 91, 113, 219, 187, 143, 142, 194, 249, 124, 205, 45, 54, 166, 58],
    [213, 116, 212, 99, 160, 176, 210, 124, 158, 164, 255, 168, 103, 232, 132, 210],
    [82, 213, 52, 245, 255, 41, 153, 218, 180, 31, 9, 115, 91, 181, 40, 31],
    [71, 119, 188, 131, 111, 136, 130, 237, 87, 204, 198, 232, 85, 204, 24, 220],
    [104, 155, 210, 106, 234, 13, 232, 88, 71, 163, 191, 2, 2, 203, 0, 222],
    [113, 89, 145, 107, 112, 46, 169, 106, 136, 168, 85, 14, 195, 37, 33, 142],
    [160, 161, 73, 112, 163, 1, 142, 234, 188, 104, 227, 204, 156, 210, 181, 3],
];

/// The value in [0, 1] of a fragment, counted from the bottom-left corner, in a frame.
pub fn value(column: usize, row: usize, frame: u32) -> f64 {
    in_frame(f64::from(TABLE[row % SIDE][column % SIDE]) / 255.0, frame)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_frame_is_the_table_and_later_ones_are_moved() {
        assert_eq!(value(0, 0, 0), 244.0 / 255.0);
        assert_eq!(value(1 + SIDE, 2 + 5 * SIDE, 0), 236.0 / 255.0);
        // The largest byte is a whole step: the sample lies where the step ends.
        assert_eq!(value(10, 10, 0), 1.0);
        for frame in 1..50 {
            let found = value(10, 10, frame);
            assert!((0.0..1.0).contains(&found) && found != value(10, 10, frame - 1), "{found}");
        }
    }
}
