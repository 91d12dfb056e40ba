//! Densities on a regular grid, and their OpenVDB files.
//!
//! A voxel's value stands *at* its index, as in OpenVDB; between voxels a reader interpolates, and beyond the last one the value falls
//! to the background along one more voxel.

use crate::base::error::{Error, Result};
use crate::base::texture::{Outside, Texels, Texture, TextureFilter, TextureHandle};
use glam::{DAffine3, DMat3, DVec3};
use ndarray::Array3;
use std::path::Path;
use std::sync::OnceLock;

/// Most voxels: 1 GiB.
pub const MOST_VOXELS: usize = 1 << 28;

/// Name of a grid of densities.
pub const DENSITY: &str = "density";

/// A grid that several parts of the program share, known by the hash of its file.
#[derive(Debug, Clone, PartialEq)]
pub struct GridHandle {
    /// Its values; nothing is outside.
    pub texture: TextureHandle,
    /// Index of the first value to the object's frame.
    pub to_object: DAffine3,
}

impl GridHandle {
    /// Prepares a grid to be read.
    pub fn new(grid: &VolumeGrid, sha256: String) -> Self {
        let [x, y, z] = [0, 1, 2].map(|axis| grid.values.shape()[axis]);
        let values = grid.values.view().reversed_axes().iter().copied().collect();
        let texture =
            Texture::new([x, y, z], Texels::F32(values), TextureFilter::Trilinear, Outside::Zero).with_identity(sha256);
        Self { texture: TextureHandle::new(texture), to_object: grid.to_object }
    }

    /// Rows that take a position of the object's frame to an index, in f32: they define where a point lies in the grid.
    pub fn to_index(&self) -> [[f32; 4]; 3] {
        let to_index = self.to_object.inverse();
        let columns = to_index.matrix3.to_cols_array_2d();
        let origin = to_index.translation;
        std::array::from_fn(|row| {
            [columns[0][row], columns[1][row], columns[2][row], origin[row]].map(|value| value as f32)
        })
    }

    /// The values by index x, y, z.
    pub fn values(&self) -> Array3<f32> {
        let [x, y, z] = self.texture.size();
        Array3::from_shape_fn((x, y, z), |(x, y, z)| self.texture.value([Some(x), Some(y), Some(z)]))
    }
}

/// Values on a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct VolumeGrid {
    /// Values by index x, y, z.
    pub values: Array3<f32>,
    /// Index of the first value to the object's frame.
    pub to_object: DAffine3,
}

impl VolumeGrid {
    /// A grid whose outermost voxels lie on the faces of a box, with `voxels` of them along the longest side; `densities` answers for
    /// positions in the object's frame.
    pub fn sample(
        low: DVec3,
        high: DVec3,
        voxels: u32,
        mut densities: impl FnMut(&[DVec3]) -> Result<Vec<f32>>,
    ) -> Result<Self> {
        let extent = high - low;
        let step = extent.max_element() / f64::from(voxels.max(2) - 1);
        if !(step > 0.0 && step.is_finite()) {
            return Err(Error::new("box of the grid", format!("{low} to {high}"), "a box with a volume", "Give one."));
        }
        let size = (extent / step).round().max(DVec3::ONE) + 1.0;
        if size.element_product() > MOST_VOXELS as f64 {
            return Err(Error::new(
                "setting voxels",
                format!("{voxels} along the longest side, {:.3e} in all", size.element_product()),
                format!("at most {MOST_VOXELS} in all"),
                "Give fewer.",
            ));
        }
        let step = extent / (size - 1.0);
        let [x, y, z] = size.to_array().map(|count| count as usize);
        let mut values = Array3::zeros((x, y, z));
        for mut plane in values.axis_iter_mut(ndarray::Axis(0)).enumerate() {
            let places: Vec<DVec3> = (0..y * z)
                .map(|index| low + step * DVec3::new(plane.0 as f64, (index / z) as f64, (index % z) as f64))
                .collect();
            let found = densities(&places)?;
            plane.1.iter_mut().zip(found).for_each(|(value, density)| *value = density);
        }
        Ok(Self { values, to_object: DAffine3 { matrix3: DMat3::from_diagonal(step), translation: low } })
    }

    /// Where the interpolated values are not the background: the voxels and one more on each side, in the object's frame. A rotated
    /// grid's corners are enclosed.
    pub fn extent(&self) -> [DVec3; 2] {
        let last = DVec3::from([0, 1, 2].map(|axis| self.values.shape()[axis] as f64));
        let corners = (0..8).map(|corner| {
            let index: [f64; 3] = std::array::from_fn(|axis| if corner >> axis & 1 == 1 { last[axis] } else { -1.0 });
            self.to_object.transform_point3(DVec3::from(index))
        });
        corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], corner| [low.min(corner), high.max(corner)])
    }
}

/// Reads the active part of a grid of an OpenVDB file: path of the file, name of the grid.
pub type GridReader = fn(&Path, &str) -> Result<VolumeGrid>;

static READER: OnceLock<GridReader> = OnceLock::new();

/// Tells scenes how OpenVDB files are read: the library that reads them is Blender's, so this part of the program does not know it.
/// The first call counts.
pub fn register_reader(reader: GridReader) {
    let _ = READER.set(reader);
}

/// A grid of a file, by the reader that was registered.
pub fn read(path: &Path, name: &str) -> Result<VolumeGrid> {
    match READER.get() {
        Some(reader) => reader(path, name),
        None => Err(Error::new(
            format!("{}", path.display()),
            "an OpenVDB file, and no reader of such files",
            "a program with its Python side",
            "Register a reader first (bridge::install).",
        )),
    }
}
