//! Densities on a regular grid, and their OpenVDB files.
//!
//! A voxel's value stands *at* its index, as in OpenVDB; between voxels a reader interpolates, and beyond the last one the value falls
//! to the background along one more voxel.

use crate::base::error::{Error, Result};
use glam::{DAffine3, DMat3, DVec3};
use ndarray::{Array3, s};
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// Most voxels: 1 GiB.
pub const MOST_VOXELS: usize = 1 << 28;

/// Name of a grid of densities.
pub const DENSITY: &str = "density";

/// A grid that several parts of the program share, known by the hash of its file.
#[derive(Clone)]
pub struct GridHandle {
    grid: Arc<PyramidGrid>,
    sha256: String,
}

impl GridHandle {
    /// Prepares a grid to be read.
    pub fn new(grid: VolumeGrid, sha256: String) -> Self {
        Self { grid: Arc::new(PyramidGrid::new(grid)), sha256 }
    }

    /// The grid.
    pub fn grid(&self) -> &PyramidGrid {
        &self.grid
    }
}

impl PartialEq for GridHandle {
    fn eq(&self, other: &Self) -> bool {
        self.sha256 == other.sha256
    }
}

impl std::fmt::Debug for GridHandle {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "grid {}", self.sha256)
    }
}

/// A grid with the smallest and largest values of its blocks.
pub struct PyramidGrid {
    grid: VolumeGrid,
    /// Level l: blocks of 2^(l+1) voxels per axis, x slowest.
    levels: Vec<Array3<[f32; 2]>>,
}

/// Blocks per axis that a question for a range looks at, at most.
const BLOCKS: i64 = 4;

impl PyramidGrid {
    fn new(grid: VolumeGrid) -> Self {
        let mut levels: Vec<Array3<[f32; 2]>> = Vec::new();
        let voxels = grid.values.mapv(|value| [value; 2]);
        loop {
            let finer = levels.last().unwrap_or(&voxels);
            if finer.len() == 1 {
                break;
            }
            let [x, y, z] = [0, 1, 2].map(|axis| finer.shape()[axis].div_ceil(2));
            let coarser = Array3::from_shape_fn((x, y, z), |(x, y, z)| {
                let ends = [x, y, z].map(|index| 2 * index);
                let part = finer.slice(s![
                    ends[0]..finer.shape()[0].min(ends[0] + 2),
                    ends[1]..finer.shape()[1].min(ends[1] + 2),
                    ends[2]..finer.shape()[2].min(ends[2] + 2)
                ]);
                part.iter().copied().reduce(hull).expect("a block has a voxel")
            });
            levels.push(coarser);
        }
        Self { grid, levels }
    }

    /// Values and place.
    pub fn grid(&self) -> &VolumeGrid {
        &self.grid
    }

    /// The value at an index; 0 outside.
    pub fn value(&self, index: [i64; 3]) -> f32 {
        let inside = [0, 1, 2].map(|axis| usize::try_from(index[axis]).unwrap_or(usize::MAX));
        self.grid.values.get(inside).copied().unwrap_or(0.0)
    }

    /// Enclosure of the values from one index to another, both included: exact for few voxels, else that of the blocks they lie in.
    pub fn range(&self, first: [i64; 3], last: [i64; 3]) -> [f32; 2] {
        let size: [i64; 3] = std::array::from_fn(|axis| self.grid.values.shape()[axis] as i64);
        let is_inside = (0..3).all(|axis| first[axis] >= 0 && last[axis] < size[axis]);
        let mut found: Option<[f32; 2]> = (!is_inside).then_some([0.0; 2]);
        let first = first.map(|index| index.max(0));
        let last: [i64; 3] = std::array::from_fn(|axis| last[axis].min(size[axis] - 1));
        if (0..3).any(|axis| first[axis] > last[axis]) {
            return found.unwrap_or([0.0; 2]);
        }
        let widest = (0..3).map(|axis| last[axis] - first[axis] + 1).max().unwrap_or(1);
        let mut level = 0;
        while widest >> level > BLOCKS && level < self.levels.len() {
            level += 1;
        }
        let (begin, end) = (first.map(|index| index >> level), last.map(|index| index >> level));
        for x in begin[0]..=end[0] {
            for y in begin[1]..=end[1] {
                for z in begin[2]..=end[2] {
                    let place = [x as usize, y as usize, z as usize];
                    let value = if level == 0 { [self.grid.values[place]; 2] } else { self.levels[level - 1][place] };
                    found = Some(found.map_or(value, |found| hull(found, value)));
                }
            }
        }
        found.unwrap_or([0.0; 2])
    }
}

fn hull(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
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
