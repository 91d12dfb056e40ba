//! OpenVDB files of grids, written and read by the OpenVDB library that Blender carries.

use super::CyclesKernel;
use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::temporary;
use crate::scene::volume_grid::{DENSITY, MOST_VOXELS, VolumeGrid};
use glam::{DAffine3, DMat3, DVec3};
use ndarray::Array3;
use serde_json::{Value as Json, json};
use std::path::Path;

/// Writes an OpenVDB file with one grid; `half` stores binary16.
pub fn write(grid: &VolumeGrid, path: &Path, half: bool) -> Result<()> {
    let folder = temporary::folder()?;
    let values = folder.path().join("values.npy");
    files::write_array(&values, &grid.values)?;
    // Written beside and moved, so that an interruption leaves no half file.
    let unfinished = folder.path().join("grid.vdb");
    let columns = grid.to_object.matrix3.to_cols_array_2d();
    let origin = grid.to_object.translation;
    let mut rows: Vec<[f64; 4]> =
        (0..3).map(|row| [columns[0][row], columns[1][row], columns[2][row], origin[row]]).collect();
    rows.push([0.0, 0.0, 0.0, 1.0]);
    let request = json!({
        "write": unfinished, "values": values, "to_object": rows, "name": DENSITY, "half": half,
    });
    run(&request)?;
    let bytes = std::fs::read(&unfinished).map_err(|cause| file_error("temporary file", &cause))?;
    files::write_atomically(path, &bytes)
}

/// Reads the active part of a grid of an OpenVDB file.
pub fn read(path: &Path, name: &str) -> Result<VolumeGrid> {
    files::check_input(path, "an OpenVDB file")?;
    let folder = temporary::folder()?;
    let values = folder.path().join("values.npy");
    let found = run(&json!({ "read": path, "name": name, "values": values, "most": MOST_VOXELS }))?;
    let (values, shape) = files::read_values(&values)?;
    let shape = [0, 1, 2].map(|axis| shape[axis]);
    let values = Array3::from_shape_vec(shape, values).expect("a file holds as many values as its shape says");
    let number = |value: &Json| value.as_f64().expect("the script answers with numbers");
    let row = |row: usize| -> [f64; 4] { std::array::from_fn(|column| number(&found["to_object"][row][column])) };
    let rows = [row(0), row(1), row(2)];
    let matrix3 = DMat3::from_cols_array_2d(&[0, 1, 2].map(|column| rows.map(|row| row[column])));
    let origin = DVec3::from(rows.map(|row| row[3]));
    let first = DVec3::from([0, 1, 2].map(|axis| number(&found["first"][axis])));
    Ok(VolumeGrid { values, to_object: DAffine3 { matrix3, translation: origin + matrix3 * first } })
}

fn run(request: &Json) -> Result<Json> {
    super::run_script("volume_grid.py", request, CyclesKernel::Default, |_| ())
}

fn file_error(place: &str, cause: &dyn std::fmt::Display) -> Error {
    Error::new(place, cause.to_string(), "a place to write to", "Make room, or set TMPDIR to another folder.")
}
