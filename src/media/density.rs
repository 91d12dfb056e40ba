//! A density: a program of one number in a box, with the parts of the box where it is provably nothing.
//!
//! There is one answer to "what is at this point?", the program's: of a material's graph, of a published system, of a grid, of a cache
//! ([`crate::media::density_cache`]). Values below 0 count as 0; NaN stays to be seen.

use crate::base::error::{Error, Result};
use crate::base::recent::Recent;
use crate::graph::bounds::Bounds3;
use crate::graph::evaluate::{Evaluator, Points};
use crate::graph::{Operand, Program};
use crate::media::region::Region;
use glam::DVec3;
use std::sync::Arc;

/// Cells per side of the table of provably empty parts.
pub const CELLS: usize = 16;

/// Cells per side of the table from which the others follow, each a half of the one before: bounds of large cells are wide, and dear.
const FIRST_CELLS: usize = 8;

/// Padding of a cell as a fraction of its side: rounding of f32 positions is far below it.
const PADDING: f32 = 1e-3;

/// Tables of the last densities.
const MOST_KNOWN: usize = 32;

/// Which cells may hold something, by the program and the box of the last densities: who changes the light, or looks from another place, has the same
/// density again.
static KNOWN: Recent<(String, Region), Arc<[bool]>> = Recent::new(MOST_KNOWN);

/// Which way densities are moved, each by as much as two evaluations in f32 may be apart at its place ([`Program::rounding_bounds`]): what the
/// rounding of a field changes in a picture is measured so.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rounding {
    /// All up.
    Up,
    /// All down.
    Down,
    /// Up at one place and down at another, by the last bits of its coordinates.
    ByPlace,
    /// The other way round.
    AgainstPlace,
}

impl Rounding {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Up, Self::Down, Self::ByPlace, Self::AgainstPlace];

    /// Moves the values of a program at places; NaN where nothing bounds its rounding.
    fn apply(self, program: &Program, positions: &[[f32; 3]], values: &mut [f32]) -> Result<()> {
        let bounds = program.rounding_bounds(Points::new(positions))?;
        for ((value, bound), position) in values.iter_mut().zip(bounds).zip(positions) {
            let is_odd = position.iter().fold(0, |bits, part| bits ^ part.to_bits()).count_ones() % 2 == 1;
            let is_up = match self {
                Self::Up => true,
                Self::Down => false,
                Self::ByPlace => is_odd,
                Self::AgainstPlace => !is_odd,
            };
            let bound = if bound.is_finite() { bound } else { f64::NAN };
            *value = (f64::from(*value) + if is_up { bound } else { -bound }) as f32;
        }
        Ok(())
    }
}

/// A density in a box of the program's frame.
#[derive(Clone)]
pub struct Density {
    program: Arc<Program>,
    /// The box that it fills.
    pub bounds: Region,
    /// The part of the box outside of which there is provably nothing.
    pub occupied: Region,
    /// Whether each of the [`CELLS`]^3 cells may hold something, x fastest; none where all of them may.
    cells: Option<Arc<[bool]>>,
    /// Cells of the table per length of the frame.
    cells_per_length: DVec3,
    /// How values are moved, where a measurement asks for it.
    rounding: Option<Rounding>,
}

impl Density {
    /// The density that a program of one number and no attributes computes, with the empty parts of its box found by its bounds.
    pub fn new(program: Arc<Program>, bounds: Region) -> Result<Self> {
        check(&program)?;
        let mut density = Self::filling(program, bounds);
        density.find_empty_cells()?;
        Ok(density)
    }

    /// The same, of which nothing is left out: for boxes without end, and for media that emit where they are not dense.
    pub fn filling(program: Arc<Program>, bounds: Region) -> Self {
        let cells_per_length = CELLS as f64 / (bounds.high - bounds.low);
        Self { program, bounds, occupied: bounds, cells: None, cells_per_length, rounding: None }
    }

    /// The same place with another program that is nothing where this one is: its cache.
    pub fn with_program(&self, program: Arc<Program>) -> Self {
        Self { program, ..self.clone() }
    }

    /// The same, whose values are moved by what rounding allows: for measurements on the CPU.
    pub fn rounded(&self, rounding: Rounding) -> Self {
        Self { rounding: Some(rounding), ..self.clone() }
    }

    /// The same times a factor that is not negative.
    pub fn scaled(&self, factor: f64) -> Self {
        self.with_program(Arc::new(self.program.scaled(factor as f32)))
    }

    /// The program that computes it.
    pub fn program(&self) -> &Arc<Program> {
        &self.program
    }

    /// Marks the cells over which the density is provably zero, and shrinks [`Self::occupied`].
    fn find_empty_cells(&mut self) -> Result<()> {
        let key = (self.program.content_hash(), self.bounds);
        let cells = match KNOWN.get(&key) {
            Some(cells) => cells,
            None => {
                let cells = full_cells(&self.program, &self.bounds)?;
                KNOWN.keep(key, Arc::clone(&cells));
                cells
            }
        };
        let mut first = [CELLS; 3];
        let mut last = [0; 3];
        for (index, _) in cells.iter().enumerate().filter(|(_, is_full)| **is_full) {
            let place = place_of(index, CELLS);
            for axis in 0..3 {
                first[axis] = first[axis].min(place[axis]);
                last[axis] = last[axis].max(place[axis] + 1);
            }
        }
        let side = (self.bounds.high - self.bounds.low) / CELLS as f64;
        let corner = |place: [usize; 3]| self.bounds.low + side * DVec3::from(place.map(|number| number as f64));
        self.occupied = if first[0] < last[0] {
            Region { low: corner(first), high: corner(last) }
        } else {
            Region { low: self.bounds.low, high: self.bounds.low }
        };
        self.cells = cells.contains(&false).then_some(cells);
        Ok(())
    }

    /// Whether every part of the box may hold something.
    pub fn fills_all_cells(&self) -> bool {
        self.cells.is_none()
    }

    /// Whether each of the [`CELLS`]^3 cells may hold something; x runs fastest.
    pub fn cells(&self) -> Vec<bool> {
        self.cells.as_ref().map_or_else(|| vec![true; CELLS.pow(3)], |cells| cells.to_vec())
    }

    /// Whether there may be something at a position.
    pub fn may_hold(&self, position: DVec3) -> bool {
        let Some(cells) = &self.cells else { return true };
        let part = (position - self.bounds.low) * self.cells_per_length;
        let place: [usize; 3] = std::array::from_fn(|axis| (part[axis].max(0.0) as usize).min(CELLS - 1));
        cells[(place[2] * CELLS + place[1]) * CELLS + place[0]]
    }

    /// Whether there may be something in a box of the program's frame.
    pub fn may_hold_within(&self, region: &Region) -> bool {
        let Some(cells) = &self.cells else { return true };
        let side = (self.bounds.high - self.bounds.low) / CELLS as f64;
        let [first, last] = [region.low, region.high].map(|corner| (corner - self.bounds.low) / side);
        let cell = |at: f64| (at.max(0.0) as usize).min(CELLS - 1);
        let mut places = (cell(first.z)..=cell(last.z)).flat_map(|z| {
            let row = move |y: usize| (z * CELLS + y) * CELLS;
            (cell(first.y)..=cell(last.y)).map(row)
        });
        places.any(|row| cells[row + cell(first.x)..=row + cell(last.x)].contains(&true))
    }

    /// The density where it is the same everywhere.
    pub fn homogeneous(&self) -> Option<f64> {
        match self.program.outputs[0].operands[0] {
            Operand::Constant(value) if value.is_finite() => Some(f64::from(value.max(0.0))),
            _ => None,
        }
    }

    /// Values of the program, moved where that is asked for.
    fn moved<'v>(&self, values: &'v [f32], positions: &[[f32; 3]], moved: &'v mut Vec<f32>) -> &'v [f32] {
        let Some(rounding) = self.rounding else { return values };
        moved.clear();
        moved.extend_from_slice(values);
        rounding.apply(&self.program, positions, moved).expect("a program that reads the place alone");
        moved
    }

    /// Densities at positions, on all cores.
    pub fn values(&self, positions: &[[f32; 3]]) -> Result<Vec<f32>> {
        let mut values = self.program.evaluate_single(Points::new(positions))?;
        if let Some(rounding) = self.rounding {
            rounding.apply(&self.program, positions, &mut values)?;
        }
        for value in &mut values {
            if *value < 0.0 {
                *value = 0.0;
            }
        }
        Ok(values)
    }
}

/// Evaluates a density on the calling thread and keeps its memory between calls: for callers that are parallel themselves.
pub struct DensityEvaluator<'a> {
    density: &'a Density,
    evaluator: Evaluator<'a>,
    asked: Vec<usize>,
    positions: Vec<[f32; 3]>,
    /// Values that are moved by what rounding allows.
    moved: Vec<f32>,
}

impl<'a> DensityEvaluator<'a> {
    /// An evaluator of a density; an error where its program reads attributes.
    pub fn new(density: &'a Density) -> Result<Self> {
        let evaluator = Evaluator::new(&density.program)?;
        Ok(Self { density, evaluator, asked: Vec::new(), positions: Vec::new(), moved: Vec::new() })
    }

    /// Densities at places all of which [may hold](Density::may_hold) something, in their order.
    pub fn values_of_held(&mut self, places: impl Iterator<Item = DVec3>) -> impl Iterator<Item = f64> {
        self.positions.clear();
        self.positions.extend(places.map(|place| place.as_vec3().to_array()));
        let found = self.evaluator.evaluate(&self.positions);
        self.density.moved(found, &self.positions, &mut self.moved).iter().map(|&value| not_negative(value))
    }

    /// Densities at places, in their order; where there is provably nothing, nothing is asked.
    pub fn values(&mut self, places: &[DVec3]) -> Vec<f64> {
        self.asked.clear();
        self.positions.clear();
        for (index, &place) in places.iter().enumerate() {
            if self.density.may_hold(place) {
                self.asked.push(index);
                self.positions.push(place.as_vec3().to_array());
            }
        }
        let found = self.evaluator.evaluate(&self.positions);
        let found = self.density.moved(found, &self.positions, &mut self.moved);
        let mut values = vec![0.0; places.len()];
        for (&index, &value) in self.asked.iter().zip(found) {
            values[index] = not_negative(value);
        }
        values
    }
}

/// A value as a density: what is no number stays to be seen.
fn not_negative(value: f32) -> f64 {
    if value < 0.0 { 0.0 } else { f64::from(value) }
}

/// Column, row and layer of a cell among so many per side.
fn place_of(index: usize, cells: usize) -> [usize; 3] {
    [index % cells, index / cells % cells, index / cells / cells]
}

/// Whether each cell of a box may hold something, x fastest. Bounds of a Voronoi texture take some 60 microseconds: on all cores, and only of
/// cells that lie in such a cell of twice the side.
fn full_cells(program: &Program, bounds: &Region) -> Result<Arc<[bool]>> {
    let mut cells = FIRST_CELLS;
    let mut full = full_among(program, bounds, cells, &vec![true; cells.pow(3)])?;
    while cells < CELLS {
        let finer = 2 * cells;
        let in_full = |index: usize| {
            let [x, y, z] = place_of(index, finer).map(|number| number / 2);
            full[(z * cells + y) * cells + x]
        };
        let asked: Vec<bool> = (0..finer.pow(3)).map(in_full).collect();
        full = full_among(program, bounds, finer, &asked)?;
        cells = finer;
    }
    Ok(full.into())
}

/// Whether each of so many cells per side may hold something, where that is asked; else it does not.
fn full_among(program: &Program, bounds: &Region, cells: usize, asked: &[bool]) -> Result<Vec<bool>> {
    let side = (bounds.high - bounds.low) / cells as f64;
    let pad = side.as_vec3() * PADDING;
    let asked: Vec<usize> = (0..asked.len()).filter(|&index| asked[index]).collect();
    let boxes: Vec<Bounds3> = asked
        .iter()
        .map(|&index| {
            let low = bounds.low + side * DVec3::from(place_of(index, cells).map(|number| number as f64));
            Bounds3 { low: (low.as_vec3() - pad).to_array(), high: ((low + side).as_vec3() + pad).to_array() }
        })
        .collect();
    let found = program.bounds_many(&boxes)?;
    let mut full = vec![false; cells.pow(3)];
    for (index, found) in asked.into_iter().zip(found) {
        full[index] = found.may_be_nan || found.high > 0.0;
    }
    Ok(full)
}

/// Refuses what is no density of the place alone.
fn check(program: &Program) -> Result<()> {
    let wrong = |found: String| {
        Err(Error::new(
            "a density",
            found,
            "a program of one number that reads the place alone",
            "Take the rest out of the graph.",
        ))
    };
    if let Some(name) = program.attributes.first() {
        return wrong(format!("one that reads the attribute \"{name}\""));
    }
    match program.output_components() {
        1 => Ok(()),
        several => wrong(format!("a program of {several} numbers")),
    }
}
