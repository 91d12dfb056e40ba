//! Axis-aligned boxes and the rays through them.

use glam::{DMat4, DVec3};

/// An axis-aligned box in the object's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Lower corner.
    pub low: DVec3,
    /// Upper corner.
    pub high: DVec3,
}

impl Region {
    /// Whether it has no volume.
    pub fn is_empty(&self) -> bool {
        !self.low.cmplt(self.high).all()
    }

    /// The box around it in the frame that a matrix takes it to.
    pub fn surrounding(&self, transform: &DMat4) -> Self {
        let corners = self.corners().into_iter().map(|corner| transform.transform_point3(corner));
        let nowhere = Self { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };
        corners.fold(nowhere, |known, corner| Self { low: known.low.min(corner), high: known.high.max(corner) })
    }

    /// Its corners, those of the lower face first; x changes fastest.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|corner| {
            let upper = |axis: usize| corner >> axis & 1 == 1;
            DVec3::from(std::array::from_fn(|axis| if upper(axis) { self.high[axis] } else { self.low[axis] }))
        })
    }

    /// Parameters at which `origin + t direction` enters and leaves, or None where it misses.
    pub fn segment(&self, origin: DVec3, direction: DVec3) -> Option<(f64, f64)> {
        let mut enter = f64::NEG_INFINITY;
        let mut leave = f64::INFINITY;
        for axis in 0..3 {
            // A ray that runs in a face is inside; the division below would make it NaN.
            if direction[axis] == 0.0 {
                if (self.low[axis]..=self.high[axis]).contains(&origin[axis]) {
                    continue;
                }
                return None;
            }
            let first = (self.low[axis] - origin[axis]) / direction[axis];
            let second = (self.high[axis] - origin[axis]) / direction[axis];
            enter = enter.max(first.min(second));
            leave = leave.min(first.max(second));
        }
        (enter < leave).then_some((enter, leave))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_crosses_a_box_at_its_faces() {
        let region = Region { low: DVec3::splat(-1.0), high: DVec3::splat(1.0) };
        assert_eq!(region.segment(DVec3::new(0.0, -5.0, 0.0), DVec3::Y), Some((4.0, 6.0)));
        assert_eq!(region.segment(DVec3::new(0.0, -5.0, 2.0), DVec3::Y), None);
        assert_eq!(region.segment(DVec3::ZERO, DVec3::Z * 2.0), Some((-0.5, 0.5)));
        assert_eq!(region.segment(DVec3::new(1.0, 0.0, -5.0), DVec3::Z), Some((4.0, 6.0)));
    }
}
