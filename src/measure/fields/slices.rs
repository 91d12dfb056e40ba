//! Planes of the field as arrays, for pictures of the field and of its error.

use crate::base::error::Result;
use crate::base::files;
use crate::bridge::{CyclesKernel, Message, probe};
use crate::graph::evaluate::Points;
use crate::graph::{Program, target};
use crate::measure::fields::{Evaluator, evaluate};
use crate::scene::{Bounds, Scene};
use std::path::{Path, PathBuf};

/// A plane through the field.
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    /// `z = 0.25`, also the stem of the files.
    pub name: String,
    /// Height and width in points.
    pub shape: [usize; 2],
    /// Points, row by row; the first row is the upper edge of a picture.
    pub positions: Vec<[f32; 3]>,
}

/// A plane with the files that hold its values.
#[derive(Debug, Clone, PartialEq)]
pub struct Slice {
    /// The plane.
    pub plane: Plane,
    /// Evaluator or `cycles`, and a float32 `.npy` file of shape [height, width].
    pub files: Vec<(&'static str, PathBuf)>,
}

/// Planes of constant z at these fractions of the box's height, and one of constant x through its
/// middle; the longer side of each has `side` points, at the centres of square cells.
pub fn planes(bounds: &Bounds, fractions: &[f32], side: usize) -> Vec<Plane> {
    let at = |axis: usize, fraction: f32| bounds.min[axis] + (bounds.max[axis] - bounds.min[axis]) * fraction;
    let mut planes: Vec<Plane> =
        fractions.iter().map(|&fraction| plane(bounds, [0, 1, 2], at(2, fraction), side)).collect();
    planes.push(plane(bounds, [1, 2, 0], at(0, 0.5), side));
    planes
}

/// One plane: `axes` are those of the columns, of the rows, and the constant one.
fn plane(bounds: &Bounds, [column, row, constant]: [usize; 3], value: f32, side: usize) -> Plane {
    let extent = |axis: usize| bounds.max[axis] - bounds.min[axis];
    let cell = extent(column).max(extent(row)) / side as f32;
    let count = |axis: usize| if cell > 0.0 { ((extent(axis) / cell).round() as usize).clamp(1, side) } else { 1 };
    let shape = [count(row), count(column)];
    let mut positions = Vec::with_capacity(shape[0] * shape[1]);
    for v in 0..shape[0] {
        for u in 0..shape[1] {
            let mut position = [value; 3];
            position[column] = bounds.min[column] + extent(column) * ((u as f32 + 0.5) / shape[1] as f32);
            position[row] = bounds.max[row] - extent(row) * ((v as f32 + 0.5) / shape[0] as f32);
            positions.push(position);
        }
    }
    Plane { name: format!("{} = {value}", ["x", "y", "z"][constant]), shape, positions }
}

/// Evaluates the density on planes with our evaluators and, where `cycles` says so, with Cycles;
/// writes `FOLDER/NAME-EVALUATOR.npy`.
pub fn save(
    scene: &Scene,
    planes: Vec<Plane>,
    evaluators: &[Evaluator],
    cycles: bool,
    folder: &Path,
    receive: impl FnMut(Message),
) -> Result<Vec<Slice>> {
    let density = target::density(scene)?;
    let program = Program::compile(scene, std::slice::from_ref(&density))?;
    let mut slices: Vec<Slice> = planes.into_iter().map(|plane| Slice { plane, files: Vec::new() }).collect();
    for slice in &mut slices {
        for &evaluator in evaluators {
            let (values, _) = evaluate(&program, Points::new(&slice.plane.positions), evaluator, None)?;
            slice.write(folder, evaluator.name(), &values)?;
        }
    }
    if cycles {
        let jobs: Vec<probe::Job<'_>> = slices
            .iter()
            .map(|slice| probe::Job {
                scene,
                positions: &slice.plane.positions,
                attributes: &[],
                targets: vec![density.clone()],
                repeat: 1,
                samples: 1,
            })
            .collect();
        let answers = probe::ask(&jobs, CyclesKernel::Sse42, receive)?;
        for (slice, answer) in slices.iter_mut().zip(&answers.jobs) {
            slice.write(folder, "cycles", &answer.values[0])?;
        }
    }
    Ok(slices)
}

impl Slice {
    fn write(&mut self, folder: &Path, evaluator: &'static str, values: &[f32]) -> Result<()> {
        let stem: String = self.plane.name.chars().filter(|letter| !letter.is_whitespace()).collect();
        let path = folder.join(format!("{stem}-{evaluator}.npy"));
        // An image is an array of rows: `width` components per row.
        files::write_values(&path, values, self.plane.shape[1])?;
        self.files.push((evaluator, path));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_have_square_cells_and_the_upper_edge_first() {
        let bounds = Bounds { min: [-1.0, -1.0, 0.0], max: [1.0, 1.0, 0.5] };
        let planes = planes(&bounds, &[0.5], 8);
        assert_eq!(planes[0].shape, [8, 8]);
        assert_eq!(planes[0].positions[0], [-0.875, 0.875, 0.25]);
        assert_eq!(planes[1].shape, [2, 8]);
        assert_eq!(planes[1].positions[0], [0.0, -0.875, 0.375]);
        assert_eq!(planes[1].name, "x = 0");
    }
}
