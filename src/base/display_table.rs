//! Colours of the screen by a table: view transforms of Blender that have no formula here, sampled once by its own colour management. The window
//! and the pages of bundles show them.

/// Where the axis turns from nearly linear to logarithmic, and its end: AgX is at its brightest there.
const KNEE: f64 = 4096.0;
const END: f64 = 64.0;

/// Display values of linear colours, interpolated between those of a grid. Negative values count as 0, those beyond 64 as 64.
#[derive(Debug, Clone, PartialEq)]
pub struct DisplayTable {
    /// Display values 0 to 1 by red, green, blue; blue fastest.
    values: Vec<[f32; 3]>,
    /// Colours along each axis.
    side: usize,
    /// What it is called.
    name: String,
}

impl DisplayTable {
    /// Linear values along each axis of a table of so many: l = (e^(t s) - 1) / 4096 with t = ln(1 + 4096 * 64), s from 0 to 1.
    pub fn axis(side: usize) -> Vec<f64> {
        let end = (KNEE * END).ln_1p();
        (0..side).map(|index| (end * index as f64 / (side - 1) as f64).exp_m1() / KNEE).collect()
    }

    /// Of the display values of all colours of the axis of `side`, blue fastest.
    ///
    /// # Panics
    /// Where there are not as many as the axis has colours: a mistake of the caller.
    pub fn new(name: String, side: usize, values: Vec<[f32; 3]>) -> Self {
        assert_eq!(values.len(), side.pow(3));
        Self { values, side, name }
    }

    /// Colours along each axis.
    pub fn side(&self) -> usize {
        self.side
    }

    /// A word for each colour, blue fastest: red in the lowest ten bits, then green, then blue.
    pub fn words(&self) -> Vec<u32> {
        let ten = |value: f32| (1023.0 * value.clamp(0.0, 1.0) + 0.5) as u32;
        self.values.iter().map(|[red, green, blue]| ten(*red) | ten(*green) << 10 | ten(*blue) << 20).collect()
    }

    /// What the view transform is called.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Display values of a linear colour, each from 0 to 1. What is no number is black.
    pub fn shown(&self, linear: [f32; 3]) -> [f32; 3] {
        let side = self.side;
        let scale = (side - 1) as f32 / (KNEE * END).ln_1p() as f32;
        let place = linear.map(|value| {
            let value = if value.is_nan() { 0.0 } else { value.clamp(0.0, END as f32) };
            (value * KNEE as f32).ln_1p() * scale
        });
        let low = place.map(|place| (place as usize).min(side - 2));
        let mut found = [0.0; 3];
        for corner in 0..8_usize {
            let mut weight = 1.0;
            let mut index = 0;
            for axis in 0..3 {
                let part = place[axis] - low[axis] as f32;
                let is_high = corner >> axis & 1;
                weight *= if is_high == 1 { part } else { 1.0 - part };
                index = index * side + low[axis] + is_high;
            }
            for (found, value) in found.iter_mut().zip(self.values[index]) {
                *found += weight * value;
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grid_is_met_and_what_lies_between_is_between() {
        const SIDE: usize = 97;
        let axis = DisplayTable::axis(SIDE);
        let value = |index: usize| (index as f32 / (SIDE - 1) as f32).sqrt();
        let colours =
            (0..SIDE.pow(3)).map(|index| [value(index / SIDE / SIDE), value(index / SIDE % SIDE), value(index % SIDE)]);
        let cube = DisplayTable::new("a test".into(), SIDE, colours.collect());
        for (red, green, blue) in [(0, 0, 0), (1, 20, 96), (96, 96, 96), (33, 2, 50)] {
            let found = cube.shown([axis[red] as f32, axis[green] as f32, axis[blue] as f32]);
            for (found, wanted) in found.iter().zip([red, green, blue].map(value)) {
                // The logarithm is rounded: a place is off by some 2^-17 of a cell, of which the steepest one is an eighth high.
                assert!((found - wanted).abs() < 1e-5, "{found} {wanted}");
            }
        }
        let [found, ..] = cube.shown([((axis[5] + axis[6]) / 2.0) as f32, 0.0, 0.0]);
        assert!(value(5) < found && found < value(6));
        assert_eq!(cube.shown([f32::NAN, -1.0, f32::INFINITY]), [0.0, 0.0, 1.0]);
    }
}
