//! Rotations of vectors, as the Mapping, Vector Rotate and texture nodes make them from angles.
//!
//! Matrices are rows that act on column vectors. Sums stand in the order of Cycles' kernels: matrices of Euler angles add
//! from the right, their transposes and rotations about an axis from the left. Everything is written once for the evaluators'
//! numbers and for intervals.

use crate::base::arrays::{Mapped, each};
use crate::nodes::bounds::Interval;
use crate::nodes::real::Real;
use crate::nodes::vector_math::bounds;
use std::ops::{Add, Mul, Neg, Sub};

/// What rotations are computed with: numbers and intervals.
pub trait Arithmetic: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self> {}

impl<T: Copy + Add<Output = T> + Sub<Output = T> + Mul<Output = T> + Neg<Output = T>> Arithmetic for T {}

/// Three rows.
pub type Rows<T> = [[T; 3]; 3];

/// Sine and cosine of an angle in radians.
#[inline]
pub fn sine_and_cosine<R: Real>(angle: R) -> [R; 2] {
    angle.sine_and_cosine()
}

/// Encloses [`sine_and_cosine`]. The angle 0 is exact everywhere.
pub fn enclose_sine_and_cosine(angle: Interval) -> [Interval; 2] {
    if angle.as_point() == Some(0.0) { [Interval::ZERO, Interval::ONE] } else { [angle.sin(), angle.cos()] }
}

/// The matrix of Euler angles, each as its sine and cosine: about X first, then Y, then Z.
#[inline]
pub fn euler<T: Arithmetic>([[sx, cx], [sy, cy], [sz, cz]]: [[T; 2]; 3]) -> Rows<T> {
    [
        [cy * cz, (sy * sx) * cz - cx * sz, (sy * cx) * cz + sx * sz],
        [cy * sz, (sy * sx) * sz + cx * cz, (sy * cx) * sz - sx * cz],
        [-sy, cy * sx, cy * cx],
    ]
}

/// The matrix of a rotation about a unit axis by an angle, given as its sine and cosine; right-handed. `one` is the number 1.
#[inline]
pub fn about_axis<T: Arithmetic>([x, y, z]: [T; 3], [sine, cosine]: [T; 2], one: T) -> Rows<T> {
    let rest = one - cosine;
    [
        [cosine + (rest * x) * x, (rest * x) * y - z * sine, (rest * x) * z + y * sine],
        [(rest * x) * y + z * sine, cosine + (rest * y) * y, (rest * y) * z - x * sine],
        [(rest * x) * z - y * sine, (rest * y) * z + x * sine, cosine + (rest * z) * z],
    ]
}

/// The product of a matrix and a vector, added from the right.
#[inline]
pub fn apply<T: Arithmetic>(rows: &Rows<T>, [x, y, z]: [T; 3]) -> [T; 3] {
    rows.mapped(|row| x * row[0] + (y * row[1] + z * row[2]))
}

/// The product of a matrix and a vector, added from the left.
#[inline]
pub fn apply_from_left<T: Arithmetic>(rows: &Rows<T>, [x, y, z]: [T; 3]) -> [T; 3] {
    rows.mapped(|row| (row[0] * x + row[1] * y) + row[2] * z)
}

/// Rows and columns exchanged.
#[inline]
pub fn transposed<T: Copy>(rows: &Rows<T>) -> Rows<T> {
    each(|row| each(|column| rows[column][row]))
}

/// Keeps each component of a rotated vector within the length that the vector can have.
pub fn no_longer_than(rotated: [Interval; 3], vector: [Interval; 3]) -> [Interval; 3] {
    let limit = vector.iter().map(|x| x.magnitude() * x.magnitude()).sum::<f64>().sqrt();
    if !limit.is_finite() {
        return rotated;
    }
    // Entries of the matrix are good to 4e-6, and there are three of them.
    let shell = Interval::with_error(-limit, limit, 2e-5 * limit, true);
    rotated.mapped(|x| x.meet(shell))
}

/// Encloses a vector divided by its length without a guard.
pub fn enclose_unit(vector: [Interval; 3]) -> [Interval; 3] {
    if bounds::is_sound(vector) { bounds::safe_unit(vector) } else { [Interval::EVERYTHING; 3] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn euler_angles_turn_about_x_then_y_then_z() {
        let quarter = std::f64::consts::FRAC_PI_2;
        let turned = |angles: [f64; 3], v: [f64; 3]| {
            apply(&euler(angles.map(sine_and_cosine)), v).map(|x| (x * 1e9).round() / 1e9 + 0.0)
        };
        assert_eq!(turned([quarter, 0.0, 0.0], [0.0, 1.0, 0.0]), [0.0, 0.0, 1.0]);
        assert_eq!(turned([quarter, quarter, 0.0], [0.0, 1.0, 0.0]), [1.0, 0.0, 0.0]);
        assert_eq!(turned([quarter, quarter, quarter], [0.0, 1.0, 0.0]), [0.0, 1.0, 0.0]);
    }

    #[test]
    fn an_axis_turns_right_handed_and_stays() {
        let axis = [2.0_f64 / 7.0, 3.0 / 7.0, 6.0 / 7.0];
        let rows = about_axis(axis, sine_and_cosine(1.25_f64), 1.0);
        for (found, wanted) in apply_from_left(&rows, axis).into_iter().zip(axis) {
            assert!((found - wanted).abs() < 1e-15);
        }
        let rows = about_axis([0.0, 0.0, 1.0], sine_and_cosine(0.5_f64), 1.0);
        assert!(apply_from_left(&rows, [1.0, 0.0, 0.0])[1] > 0.4);
    }
}
