//! Light at the vertices of a grid: how much density lies towards each light and around.
//!
//! The density is baked at the vertices of a grid over the occupied part of the medium. For one
//! direction, all vertices are served by one sweep: rays parallel to the direction start on a
//! lattice of the slice nearest to the light and cross the slices of the direction's main axis one
//! by one. A slice cuts all rays at the same fraction of a cell, so density is read there and
//! optical depth handed back to the vertices by bilinear interpolation with constant weights; along
//! the ray the trapezoid rule adds up. Rays are never merged, so nothing smears with distance.
//!
//! Errors: second order in the cell size, first order within a cell of a face of a medium that does
//! not end before the face.
//!
//! In a mesh, each ray of a sweep is a line towards the light whose parts in the mesh are known exactly, and from slice to slice it adds
//! the length inside times the density in the middle; light from a point goes to every vertex by itself. Vertices outside have depths like
//! others, continuous across faces, and serve the samples beside a face. The error is of second order where depth is smooth, and of first
//! order within a cell of where light grazes the mesh. A line comes from outside: in a mesh that is not closed, or whose parts overlap, a
//! shadow ray may begin with another mark, and the light `exact` says what Cycles shows.
//!
//! The world is a mean over directions of a Fibonacci lattice, projected
//! on spherical harmonics when the phase function is not isotropic.

use crate::base::arrays::Mapped;
use crate::base::error::Result;
use crate::integrators::MarchSettings;
use crate::media::lattice::{BAKE_CHUNK, vertex, vertices_of};
use crate::media::medium::Medium;
use crate::media::mesh::{PlacedMesh, Span};
use crate::view::lights::{DeltaLight, Source, harmonics, sphere_directions};
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// Density and light at the vertices of a grid in the object's frame.
pub struct LightGrid {
    /// Vertices per axis.
    pub size: [usize; 3],
    /// The first vertex in the object's frame.
    pub(crate) low: DVec3,
    /// Object units between vertices.
    pub(crate) step: DVec3,
    /// Baked density; x runs fastest.
    pub density: Vec<f32>,
    /// Per delta light: integral of the density over world length towards it.
    pub depths: Vec<Vec<f32>>,
    /// Per distinct extinction, per harmonic: coefficient of the transmittance to the world.
    pub world: Vec<Vec<f32>>,
    /// Number of harmonics.
    pub harmonics: usize,
    /// The distinct extinctions per unit density.
    pub extinctions: Vec<f64>,
    /// Index among the distinct extinctions of each channel.
    pub extinction_of_channel: [usize; 3],
}

/// Eight vertices and their weights.
#[derive(Debug, Clone, Copy)]
pub struct Corners {
    indices: [usize; 8],
    weights: [f32; 8],
}

impl LightGrid {
    /// Bakes density and light. `progress` receives the fraction done.
    pub fn bake(
        medium: &Medium,
        lights: &[DeltaLight],
        with_world: bool,
        settings: &MarchSettings,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Self> {
        let mut grid = Self::layout(medium, settings);
        let count = grid.vertices();
        for start in (0..count).step_by(BAKE_CHUNK) {
            let positions: Vec<[f32; 3]> = (start..count.min(start + BAKE_CHUNK))
                .map(|index| vertex(index, grid.size, grid.low, grid.step).as_vec3().to_array())
                .collect();
            grid.density.extend(medium.density.values(&positions)?);
            progress(0.5 * grid.density.len() as f64 / count as f64);
        }
        let to_cells = grid.to_cells(medium);
        let in_mesh = medium.mesh.as_ref().map(|mesh| InMesh { grid: &grid, medium, mesh });
        let depth = |light: &DeltaLight| match (&light.source, &in_mesh) {
            (Source::Direction(towards), _) => grid.depth_towards(to_cells * *towards, in_mesh.as_ref()),
            (Source::Position(place, _), None) => grid.depth_to_point(*place, medium),
            (Source::Position(place, _), Some(in_mesh)) => in_mesh.depths_to_point(*place),
        };
        let depths = lights.iter().map(depth).collect();
        let world =
            if with_world { grid.bake_world(to_cells, settings, in_mesh.as_ref(), progress) } else { Vec::new() };
        (grid.depths, grid.world) = (depths, world);
        Ok(grid)
    }

    /// The vertices and what is stored there, with nothing baked yet.
    pub(crate) fn layout(medium: &Medium, settings: &MarchSettings) -> Self {
        let (size, step) = vertices_of(&medium.density.occupied, &medium.to_object, settings.grid_cells);
        let mut extinctions: Vec<f64> = Vec::new();
        let extinction_of_channel = medium.extinction.mapped(|extinction| {
            extinctions.iter().position(|&known| known == extinction).unwrap_or_else(|| {
                extinctions.push(extinction);
                extinctions.len() - 1
            })
        });
        let bands = if medium.anisotropy.abs() < 0.001 { 0 } else { settings.world_bands as usize };
        Self {
            size,
            low: medium.density.occupied.low,
            step,
            density: Vec::new(),
            depths: Vec::new(),
            world: Vec::new(),
            harmonics: (bands + 1).pow(2),
            extinctions,
            extinction_of_channel,
        }
    }

    /// Number of vertices.
    pub(crate) fn vertices(&self) -> usize {
        self.size.iter().product()
    }

    /// World directions to cells per metre.
    pub(crate) fn to_cells(&self, medium: &Medium) -> DMat3 {
        DMat3::from_diagonal(1.0 / self.step) * DMat3::from_mat4(medium.to_object)
    }

    /// The vertices around a position of the object's frame, which is clamped to the grid.
    pub fn corners(&self, position: DVec3) -> Corners {
        let place = (position - self.low) / self.step;
        let mut base = [0; 3];
        let mut fraction = [0.0_f32; 3];
        for axis in 0..3 {
            let clamped = place[axis].clamp(0.0, (self.size[axis] - 1) as f64);
            base[axis] = (clamped as usize).min(self.size[axis] - 2);
            fraction[axis] = (clamped - base[axis] as f64) as f32;
        }
        let [nx, ny, _] = self.size;
        let first = (base[2] * ny + base[1]) * nx + base[0];
        let mut corners = Corners { indices: [0; 8], weights: [0.0; 8] };
        for corner in 0..8 {
            let up = [corner & 1, corner >> 1 & 1, corner >> 2];
            corners.indices[corner] = first + (up[2] * ny + up[1]) * nx + up[0];
            corners.weights[corner] =
                (0..3).map(|axis| if up[axis] == 1 { fraction[axis] } else { 1.0 - fraction[axis] }).product();
        }
        corners
    }

    /// Depths of density towards a sun, at all vertices; `direction` is in cells per metre.
    fn depth_towards(&self, direction: DVec3, in_mesh: Option<&InMesh<'_>>) -> Vec<f32> {
        let axes = sweep_axes(direction);
        let density = permute(&self.density, self.size, axes);
        let sweep = Sweep::new(self.size, axes, direction);
        let mut table = Vec::new();
        match in_mesh {
            Some(in_mesh) => in_mesh.trace(&sweep, axes, direction, &mut table),
            None => sweep.trace(&density, &mut table),
        }
        let mut depths = vec![0.0; self.density.len()];
        let [nf, nm, _] = sweep.size;
        depths.par_chunks_mut(nf * nm).enumerate().for_each(|(slice, depths)| {
            depths.chunks_mut(nf).enumerate().for_each(|(row, depths)| sweep.gather(&table, slice, row, depths));
        });
        unpermute(&depths, self.size, axes)
    }

    /// Depths of density between all vertices and a point of the world.
    pub(crate) fn depth_to_point(&self, place: DVec3, medium: &Medium) -> Vec<f32> {
        let target = (medium.to_object.transform_point3(place) - self.low) / self.step;
        self.depth_to_cell(target, self.to_cells(medium).inverse())
    }

    /// Depths of density between all vertices and a point given in cells.
    fn depth_to_cell(&self, target: DVec3, to_metres: DMat3) -> Vec<f32> {
        let high = DVec3::from(self.size.mapped(|count| (count - 1) as f64));
        let region = crate::media::region::Region { low: DVec3::ZERO, high };
        (0..self.density.len())
            .into_par_iter()
            .map(|index| {
                let start = vertex(index, self.size, DVec3::ZERO, DVec3::ONE);
                let way = target - start;
                let end = region.segment(start, way).map_or(0.0, |(_, leave)| leave.clamp(0.0, 1.0));
                let steps = (way.length() * end).ceil();
                let sum: f64 = (0..steps as usize)
                    .map(|step| {
                        let place = start + way * (end * (step as f64 + 0.5) / steps);
                        f64::from(self.corners(self.low + place * self.step).read(&self.density))
                    })
                    .sum();
                if steps == 0.0 { 0.0 } else { (sum / steps * end * (to_metres * way).length()) as f32 }
            })
            .collect()
    }

    /// Coefficients of the transmittance to the world, per distinct extinction and harmonic.
    fn bake_world(
        &self,
        to_cells: DMat3,
        settings: &MarchSettings,
        in_mesh: Option<&InMesh<'_>>,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Vec<Vec<f32>> {
        let directions = sphere_directions(settings.world_directions as usize);
        let channels = self.extinctions.len() * self.harmonics;
        let mut world = vec![vec![0.0; self.density.len()]; channels];
        let solid_angle = 4.0 * std::f64::consts::PI / directions.len() as f64;
        let mut table = Vec::new();
        let mut done = 0;
        for main_axis in 0..3 {
            let axes = axes_of(main_axis);
            let density = permute(&self.density, self.size, axes);
            let [nf, nm, ns] = axes.mapped(|axis| self.size[axis]);
            // Slice by slice, channel by channel within a slice: each worker owns whole slices.
            let mut sums = vec![0.0_f32; nf * nm * ns * channels];
            for &towards in &directions {
                let direction = to_cells * towards;
                if sweep_axes(direction) != axes {
                    continue;
                }
                let sweep = Sweep::new(self.size, axes, direction);
                match in_mesh {
                    Some(in_mesh) => in_mesh.trace(&sweep, axes, direction, &mut table),
                    None => sweep.trace(&density, &mut table),
                }
                let weights = harmonics(towards).mapped(|value| (value * solid_angle) as f32);
                sums.par_chunks_mut(nf * nm * channels).enumerate().for_each(|(slice, sums)| {
                    let mut depths = vec![0.0; nf];
                    for row in 0..nm {
                        sweep.gather(&table, slice, row, &mut depths);
                        for (number, &extinction) in self.extinctions.iter().enumerate() {
                            let extinction = extinction as f32;
                            let transmittances: Vec<f32> =
                                depths.iter().map(|depth| (-extinction * depth).exp()).collect();
                            for (harmonic, weight) in weights[..self.harmonics].iter().enumerate() {
                                let start = ((number * self.harmonics + harmonic) * nm + row) * nf;
                                let sums = &mut sums[start..start + nf];
                                for (sum, transmittance) in sums.iter_mut().zip(&transmittances) {
                                    *sum += weight * transmittance;
                                }
                            }
                        }
                    }
                });
                done += 1;
                progress(0.5 + 0.5 * f64::from(done) / directions.len() as f64);
            }
            for (channel, world) in world.iter_mut().enumerate() {
                let part: Vec<f32> = (0..ns)
                    .flat_map(|slice| {
                        let start = (slice * channels + channel) * nf * nm;
                        sums[start..start + nf * nm].iter().copied()
                    })
                    .collect();
                for (sum, value) in world.iter_mut().zip(unpermute(&part, self.size, axes)) {
                    *sum += value;
                }
            }
        }
        world
    }
}

/// Factor on where lines lie about the middle of a grid: those in its faces, which are faces of meshes that are boxes in part, count as
/// within the mesh, and depths err by a millionth of what changes from end to end.
const WITHIN: f64 = 1.0 - 1e-6;

/// A medium in a mesh, with the grid over it.
struct InMesh<'a> {
    grid: &'a LightGrid,
    medium: &'a Medium,
    mesh: &'a PlacedMesh,
}

impl InMesh<'_> {
    /// [`Sweep::trace`], every ray through the parts of the mesh alone. `direction` points to the light, in cells per metre.
    fn trace(&self, sweep: &Sweep, axes: [usize; 3], direction: DVec3, table: &mut Vec<f32>) {
        let [nf, _, ns] = sweep.size;
        let width = nf + 1;
        table.resize(sweep.rows * ns * width, 0.0);
        let columns = sweep.offsets.iter().map(|(whole, _)| whole[0]);
        let (lowest, highest) = (columns.clone().min().unwrap_or(0), columns.max().unwrap_or(0));
        let middle = DVec3::from(self.grid.size.mapped(|count| (count - 1) as f64 / 2.0));
        table.par_chunks_mut(ns * width).enumerate().for_each(|(row, table)| {
            table.fill(0.0);
            let mut spans = Vec::new();
            for ray in -1 - highest..nf as i64 - lowest {
                let level = if sweep.rising { ns - 1 } else { 0 };
                let mut place = [0.0; 3];
                for (axis, number) in axes.into_iter().zip([ray, sweep.first_row + row as i64, level as i64]) {
                    place[axis] = number as f64;
                }
                let place = middle + (DVec3::from(place) - middle) * WITHIN;
                let line = [f64::NEG_INFINITY, f64::INFINITY];
                self.parts(place, direction, line, false, &mut spans);
                let mut depth = 0.0;
                let mut rest = spans.as_slice();
                for (slice, (whole, _)) in sweep.offsets.iter().enumerate() {
                    // Distances are below 0 on the way from the light.
                    let distance = -f64::from(sweep.length) * slice as f64;
                    while let [others @ .., [from, to]] = rest
                        && *to > distance
                    {
                        let from_here = from.max(distance);
                        let before = -f64::from(sweep.length) * (slice as f64 - 1.0);
                        let to_here = to.min(before);
                        if from_here < to_here {
                            depth += self.depth(place, direction, [from_here, to_here]);
                        }
                        if *from < distance {
                            break;
                        }
                        rest = others;
                    }
                    let cell = ray + whole[0];
                    if (-1..nf as i64).contains(&cell) {
                        table[slice * width + (cell + 1) as usize] = depth as f32;
                    }
                }
            }
        });
    }

    /// Depths of density between all vertices and a point of the world.
    fn depths_to_point(&self, light: DVec3) -> Vec<f32> {
        let Self { grid, medium, mesh } = self;
        let to_cells = grid.to_cells(medium);
        let to_world = medium.to_object.inverse();
        let inside = mesh.begins_inside(light);
        let start = (medium.to_object.transform_point3(light) - grid.low) / grid.step;
        (0..grid.vertices())
            .into_par_iter()
            .map_init(Vec::new, |spans, index| {
                let place = vertex(index, grid.size, grid.low, grid.step);
                let way = to_world.transform_point3(place) - light;
                let distance = way.length();
                if distance == 0.0 {
                    return 0.0;
                }
                // From the light, whose side of the mesh is known once for all.
                let direction = to_cells * (way / distance);
                self.parts(start, direction, [0.0, distance], inside, spans);
                let cells = direction.length();
                let mut sum = 0.0;
                for &[from, to] in spans.iter() {
                    let steps = ((to - from) * cells).ceil().max(1.0);
                    let end = |number: f64| from + (to - from) * number / steps;
                    let part = |step| self.depth(start, direction, [end(f64::from(step)), end(f64::from(step) + 1.0)]);
                    sum += (0..steps as u32).map(part).sum::<f64>();
                }
                sum as f32
            })
            .collect()
    }

    /// The parts of a ray, from a place in cells and of cells per metre, that lie in the mesh and may hold something, between two distances.
    fn parts(&self, place: DVec3, direction: DVec3, [from, to]: Span, inside: bool, spans: &mut Vec<Span>) {
        let Self { grid, medium, mesh } = self;
        spans.clear();
        let (place, way) = (grid.low + place * grid.step, direction * grid.step);
        let Some((enter, leave)) = medium.density.occupied.segment(place, way) else { return };
        mesh.spans_in_object(place, way, [from, to], inside, spans);
        spans.retain_mut(|[from, to]| {
            (*from, *to) = (from.max(enter), to.min(leave));
            *from < *to
        });
    }

    /// Depth of density over a stretch of a ray of no more than a few cells: its length times the density in its middle.
    fn depth(&self, place: DVec3, direction: DVec3, [from, to]: Span) -> f64 {
        let Self { grid, medium, .. } = self;
        let middle = grid.low + (place + direction * f64::midpoint(from, to)) * grid.step;
        let read = || f64::from(grid.corners(middle).read(&grid.density));
        (to - from) * medium.density.homogeneous().unwrap_or_else(read)
    }
}

impl Corners {
    /// Interpolates values of the vertices.
    pub fn read(&self, values: &[f32]) -> f32 {
        (0..8).map(|corner| self.weights[corner] * values[self.indices[corner]]).sum()
    }
}

/// The axes of a sweep along `main`: along rows, along columns, from slice to slice.
fn axes_of(main: usize) -> [usize; 3] {
    [[1, 2, 0], [0, 2, 1], [0, 1, 2]][main]
}

/// The axes of the sweep for a direction in cells: the slices lie across its largest component.
pub(crate) fn sweep_axes(direction: DVec3) -> [usize; 3] {
    let size = direction.abs();
    axes_of(if size.z >= size.x && size.z >= size.y {
        2
    } else if size.y >= size.x {
        1
    } else {
        0
    })
}

/// Values in the order of a sweep.
fn permute(values: &[f32], size: [usize; 3], axes: [usize; 3]) -> Vec<f32> {
    let strides = [1, size[0], size[0] * size[1]];
    let [sf, sm, ss] = axes.mapped(|axis| strides[axis]);
    let [nf, nm, ns] = axes.mapped(|axis| size[axis]);
    let mut result = vec![0.0; values.len()];
    result.par_chunks_mut(nf * nm).enumerate().for_each(|(slice, result)| {
        for (index, value) in result.iter_mut().enumerate() {
            *value = values[slice * ss + index / nf * sm + index % nf * sf];
        }
    });
    debug_assert_eq!(result.len(), nf * nm * ns);
    result
}

/// Values of a sweep in the order of the grid.
fn unpermute(values: &[f32], size: [usize; 3], axes: [usize; 3]) -> Vec<f32> {
    let [nf, nm, _] = axes.mapped(|axis| size[axis]);
    let mut strides = [0; 3];
    for (axis, stride) in axes.into_iter().zip([1, nf, nf * nm]) {
        strides[axis] = stride;
    }
    let [nx, ny, _] = size;
    let mut result = vec![0.0; values.len()];
    result.par_chunks_mut(nx * ny).enumerate().for_each(|(slice, result)| {
        for (index, value) in result.iter_mut().enumerate() {
            *value = values[slice * strides[2] + index / nx * strides[1] + index % nx * strides[0]];
        }
    });
    result
}

/// Parallel rays through the slices of a grid, from the light's side away.
pub(crate) struct Sweep {
    /// Vertices along rows, columns and slices.
    pub(crate) size: [usize; 3],
    /// The first slice that the light reaches is the last one of the grid.
    pub(crate) rising: bool,
    /// Where the lattice of rays lies in each slice, counted from the light: whole cells and the
    /// fraction, along rows and along columns.
    pub(crate) offsets: Vec<([i64; 2], [f32; 2])>,
    /// Cells per slice that rays move along rows and columns, away from the light.
    pub(crate) slope: [f32; 2],
    /// Metres along a ray from slice to slice.
    pub(crate) length: f32,
    /// Lattice rows of rays, and the number of the first.
    pub(crate) rows: usize,
    pub(crate) first_row: i64,
}

/// The lattice points of one row of rays in one slice.
#[derive(Clone)]
struct Wavefront {
    depth: Vec<f32>,
    density: Vec<f32>,
    /// Whole cells and fraction of the lattice along the row.
    place: (i64, f32),
    /// Place among the columns; None outside of the grid by more than a cell.
    column: Option<(i64, f32)>,
}

impl Sweep {
    /// The sweep for a direction towards the light, in cells per metre.
    pub(crate) fn new(size: [usize; 3], axes: [usize; 3], direction: DVec3) -> Self {
        let [along_row, along_column, main] = axes.mapped(|axis| direction[axis]);
        let size = axes.mapped(|axis| size[axis]);
        let slope = [-along_row / main.abs(), -along_column / main.abs()];
        let offsets: Vec<_> = (0..size[2])
            .map(|slice| {
                let shift = slope.mapped(|slope| slope * slice as f64);
                (shift.mapped(|shift| shift.floor() as i64), shift.mapped(|shift| (shift - shift.floor()) as f32))
            })
            .collect();
        let columns = offsets.iter().map(|(whole, _)| whole[1]);
        let (lowest, highest) = (columns.clone().min().unwrap_or(0), columns.max().unwrap_or(0));
        Self {
            size,
            rising: main > 0.0,
            offsets,
            slope: slope.mapped(|slope| slope as f32),
            length: (1.0 / main.abs()) as f32,
            // One row on each side brackets the vertices of the faces.
            rows: (size[1] as i64 + 1 + highest - lowest) as usize,
            first_row: -1 - highest,
        }
    }

    /// Depth along every ray at every slice: by row of rays, slice, and cell along the row from -1.
    fn trace(&self, density: &[f32], table: &mut Vec<f32>) {
        let [nf, _, ns] = self.size;
        let width = nf + 1;
        table.resize(self.rows * ns * width, 0.0);
        table.par_chunks_mut(ns * width).enumerate().for_each(|(row, table)| {
            let mut wavefront =
                Wavefront { depth: vec![0.0; width], density: vec![0.0; width], place: (0, 0.0), column: None };
            for (slice, table) in table.chunks_mut(width).enumerate() {
                let next = self.advance(density, row, slice, &wavefront);
                table.copy_from_slice(&next.depth);
                wavefront = next;
            }
        });
    }

    /// The wavefront of a row of rays in the next slice.
    fn advance(&self, density: &[f32], row: usize, slice: usize, before: &Wavefront) -> Wavefront {
        let [nf, nm, ns] = self.size;
        let (whole, fraction) = self.offsets[slice];
        let column = self.first_row + row as i64 + whole[1];
        let mut wavefront = Wavefront {
            depth: vec![0.0; nf + 1],
            density: vec![0.0; nf + 1],
            place: (whole[0], fraction[0]),
            column: (-1..nm as i64).contains(&column).then_some((column, fraction[1])),
        };
        if wavefront.column.is_none() {
            return wavefront;
        }
        let inside_column = inside(column, fraction[1], nm);
        if inside_column {
            let start = if self.rising { ns - 1 - slice } else { slice } * nf * nm;
            let line = |column: i64| &density[start + column as usize * nf..start + (column as usize + 1) * nf];
            let lower = line(column);
            let upper = line((column + 1).min(nm as i64 - 1));
            let [fx, fy] = fraction;
            for (place, value) in wavefront.density[1..nf].iter_mut().enumerate() {
                let near = lower[place] + fx * (lower[place + 1] - lower[place]);
                let far = upper[place] + fx * (upper[place + 1] - upper[place]);
                *value = near + fy * (far - near);
            }
            if fx == 0.0 {
                wavefront.density[nf] = lower[nf - 1] + fy * (upper[nf - 1] - lower[nf - 1]);
            }
        }
        if slice == 0 {
            return wavefront;
        }
        // A ray at cell p was at cell p - moved one slice before.
        let moved = wavefront.place.0 - before.place.0;
        let both = inside_column && before.column.is_some_and(|(column, fraction)| inside(column, fraction, nm));
        let low = moved.max(0);
        let high = (nf as i64 - 2).min(nf as i64 - 2 + moved);
        if both && low <= high {
            let from = (low + 1) as usize;
            let count = (high - low + 1) as usize;
            let old = (low - moved + 1) as usize;
            let half = 0.5 * self.length;
            for offset in 0..count {
                wavefront.depth[from + offset] = before.depth[old + offset]
                    + half * (before.density[old + offset] + wavefront.density[from + offset]);
            }
        }
        for cell in -1..nf as i64 {
            if !(both && (low..=high).contains(&cell)) {
                wavefront.depth[(cell + 1) as usize] = self.step_at_edge(cell, cell - moved, &wavefront, before);
            }
        }
        wavefront
    }

    /// Depth of a ray near a face: it may have entered or left the grid since the slice before.
    fn step_at_edge(&self, cell: i64, old_cell: i64, wavefront: &Wavefront, before: &Wavefront) -> f32 {
        let [nf, nm, _] = self.size;
        let Some((column, column_fraction)) = wavefront.column else { return 0.0 };
        let now = inside(cell, wavefront.place.1, nf) && inside(column, column_fraction, nm);
        let index = (cell + 1) as usize;
        let known = (-1..nf as i64).contains(&old_cell) && before.column.is_some();
        let Some((old_column, old_fraction)) = before.column.filter(|_| known) else {
            return if now {
                wavefront.density[index] * self.length * self.part_inside(cell, wavefront, 1.0)
            } else {
                0.0
            };
        };
        let old_index = (old_cell + 1) as usize;
        let then = inside(old_cell, before.place.1, nf) && inside(old_column, old_fraction, nm);
        match (then, now) {
            (true, true) => {
                before.depth[old_index] + 0.5 * self.length * (before.density[old_index] + wavefront.density[index])
            }
            (false, true) => wavefront.density[index] * self.length * self.part_inside(cell, wavefront, 1.0),
            (true, false) => {
                before.depth[old_index]
                    + before.density[old_index] * self.length * self.part_inside(old_cell, before, -1.0)
            }
            (false, false) => before.depth[old_index],
        }
    }

    /// Part of a step between a lattice point inside and the face where the ray entered (`way` 1)
    /// or leaves (-1).
    fn part_inside(&self, cell: i64, wavefront: &Wavefront, way: f32) -> f32 {
        let [nf, nm, _] = self.size;
        let column = wavefront.column.unwrap_or_default();
        let places = [cell as f32 + wavefront.place.1, column.0 as f32 + column.1];
        let highs = [(nf - 1) as f32, (nm - 1) as f32];
        (0..2).fold(1.0_f32, |part, axis| {
            let slope = self.slope[axis] * way;
            if slope == 0.0 {
                return part;
            }
            let distance = if slope > 0.0 { places[axis] } else { highs[axis] - places[axis] };
            part.min(distance / slope.abs())
        })
    }

    /// Depths at a row of vertices of the grid's `slice`.
    fn gather(&self, table: &[f32], slice: usize, row: usize, depths: &mut [f32]) {
        let [nf, _, ns] = self.size;
        let counted = if self.rising { ns - 1 - slice } else { slice };
        let (whole, [fx, fy]) = self.offsets[counted];
        let line = |column: i64| {
            let ray_row = (column - whole[1] - self.first_row) as usize;
            let start = (ray_row * ns + counted) * (nf + 1);
            &table[start..start + nf + 1]
        };
        let below = line(row as i64 - 1);
        let above = line(row as i64);
        for (index, depth) in depths.iter_mut().enumerate() {
            let near = above[index + 1] + fx * (above[index] - above[index + 1]);
            let far = below[index + 1] + fx * (below[index] - below[index + 1]);
            *depth = near + fy * (far - near);
        }
    }
}

/// Whether a lattice point lies within the vertices 0 to count - 1.
fn inside(cell: i64, fraction: f32, count: usize) -> bool {
    cell >= 0 && (cell + 1 < count as i64 || (cell + 1 == count as i64 && fraction == 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid of a linear density on [0, 1]^3 with unequal resolution.
    fn grid(density: impl Fn(DVec3) -> f64) -> LightGrid {
        let size = [33, 25, 41];
        let step = 1.0 / DVec3::from(size.map(|count| (count - 1) as f64));
        let density =
            (0..size.iter().product()).map(|index| density(vertex(index, size, DVec3::ZERO, step)) as f32).collect();
        LightGrid {
            size,
            low: DVec3::ZERO,
            step,
            density,
            depths: Vec::new(),
            world: Vec::new(),
            harmonics: 1,
            extinctions: vec![1.0],
            extinction_of_channel: [0; 3],
        }
    }

    const CUBE: crate::media::region::Region = crate::media::region::Region { low: DVec3::ZERO, high: DVec3::ONE };

    /// Length from a vertex to where a ray leaves the cube, and the axis of the face there.
    fn way_out(place: DVec3, direction: DVec3) -> (f64, usize) {
        let length = CUBE.segment(place, direction).map_or(0.0, |(_, leave)| leave.max(0.0));
        let end = (place + direction * length - 0.5).abs();
        let axis = (0..3).max_by(|&a, &b| end[a].total_cmp(&end[b])).expect("three axes");
        (length, axis)
    }

    #[test]
    fn depths_are_exact_where_no_edge_of_the_grid_casts_a_kink() {
        let grid = grid(|_| 2.0);
        let mut compared = 0;
        for direction in sphere_directions(60) {
            let found = grid.depth_towards(DMat3::from_diagonal(1.0 / grid.step) * direction, None);
            for (index, depth) in found.iter().enumerate() {
                let place = vertex(index, grid.size, DVec3::ZERO, grid.step);
                let (length, axis) = way_out(place, direction);
                // Depth is linear in the position among rays that leave by the same face.
                let neighbours = (0..27).map(|number| {
                    let shift = [number % 3, number / 3 % 3, number / 9].map(|part| f64::from(part) - 1.0);
                    place + DVec3::from(shift) * grid.step * 1.01
                });
                let smooth = neighbours.clone().all(|near| {
                    near.cmpgt(DVec3::ZERO).all() && near.cmplt(DVec3::ONE).all() && way_out(near, direction).1 == axis
                });
                if smooth {
                    compared += 1;
                    // Sums over 40 slices in f32, and fractions of cells of about 40 in f32.
                    assert!((f64::from(*depth) - 2.0 * length).abs() < 1e-4, "{place}, {direction}: {depth}");
                }
            }
        }
        assert!(compared > 1_000_000, "only {compared} vertices were compared");
    }

    #[test]
    fn depths_through_a_linear_density_are_its_integral() {
        let slope = DVec3::new(0.5, -0.25, 1.0);
        let grid = grid(|place| 1.0 + slope.dot(place));
        let to_cells = DMat3::from_diagonal(1.0 / grid.step);
        let mut directions = sphere_directions(60);
        directions.extend([DVec3::X, DVec3::NEG_Y, DVec3::Z]);
        for direction in directions {
            let found = grid.depth_towards(to_cells * direction, None);
            let sum: f64 = found
                .iter()
                .enumerate()
                .map(|(index, depth)| {
                    let place = vertex(index, grid.size, DVec3::ZERO, grid.step);
                    let (length, _) = way_out(place, direction);
                    (f64::from(*depth) - length * (1.0 + slope.dot(place + direction * (length / 2.0)))).abs()
                })
                .sum();
            let mean = sum / found.len() as f64;
            // Along an axis nothing is interpolated and the trapezoid rule is exact. Else, across
            // each other axis, depth grows from a face by at most the largest density (2.25) times
            // cell / cosine, and by no more than the whole depth. A vertex in the face may get what
            // belongs just inside it, all of that growth wrong; interpolation over the kink behind it
            // misses at most a quarter. Each concerns one vertex of a row. Where depth is smooth the
            // second order is left, below 1e-3.
            let axes = sweep_axes(to_cells * direction);
            let tolerance = axes[..2].iter().fold(1e-3, |sum, &axis| {
                let growth = 2.25 * (grid.step[axis] / direction[axis].abs()).min(1.0);
                sum + if direction[axis] == 0.0 { 0.0 } else { growth * 1.25 / grid.size[axis] as f64 }
            });
            let tolerance = if direction.abs().max_element() == 1.0 { 1e-5 } else { tolerance };
            assert!(mean < tolerance, "{direction}: mean error {mean}");
        }
    }

    #[test]
    fn the_depth_to_a_point_is_the_integral_to_it() {
        let grid = grid(|_| 2.0);
        let target = DVec3::splat(3.0);
        let found = grid.depth_to_cell(target / grid.step, DMat3::from_diagonal(grid.step));
        for (index, depth) in found.iter().enumerate() {
            let place = vertex(index, grid.size, DVec3::ZERO, grid.step);
            let way = target - place;
            let truth = CUBE.segment(place, way).map_or(0.0, |(_, leave)| leave.max(0.0)) * way.length() * 2.0;
            assert!((f64::from(*depth) - truth).abs() < 1e-5, "{place}: {depth} is not {truth}");
        }
    }
}
