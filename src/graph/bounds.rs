//! Enclosing a program over boxes: every node's intervals in evaluation order.

use crate::base::error::{Error, Result};
use crate::graph::{Operand, Program};
use crate::nodes::Interval;
use rayon::prelude::*;

/// An axis-aligned box in the object's frame, both faces included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds3 {
    /// Lower corner.
    pub low: [f32; 3],
    /// Upper corner, nowhere below the lower one.
    pub high: [f32; 3],
}

impl Bounds3 {
    /// From corner to corner.
    pub fn new(low: [f32; 3], high: [f32; 3]) -> Self {
        Self { low, high }
    }

    /// The eight (or fewer, along axes without extent) halves of halves.
    pub fn octants(&self) -> impl Iterator<Item = Self> + use<> {
        let (low, high) = (self.low, self.high);
        let middle: [f32; 3] = std::array::from_fn(|axis| 0.5 * low[axis] + 0.5 * high[axis]);
        (0..8_u32).filter_map(move |octant| {
            let upper = |axis: usize| octant >> axis & 1 == 1;
            // An axis without extent has one half.
            if (0..3).any(|axis| upper(axis) && middle[axis] >= high[axis]) {
                return None;
            }
            Some(Self {
                low: std::array::from_fn(|axis| if upper(axis) { middle[axis] } else { low[axis] }),
                high: std::array::from_fn(|axis| if upper(axis) { high[axis] } else { middle[axis] }),
            })
        })
    }
}

/// Registers and inputs of one box, reused for the next.
pub(crate) struct Workspace {
    registers: Vec<Interval>,
    inputs: Vec<Interval>,
}

impl Workspace {
    pub(crate) fn new(program: &Program) -> Self {
        Self { registers: vec![Interval::EVERYTHING; program.registers], inputs: Vec::new() }
    }

    /// [`Self::run`], divided `depth` times.
    pub(crate) fn run_refined(&mut self, program: &Program, place: &Bounds3, depth: u32, results: &mut [Interval]) {
        if depth == 0 {
            self.run(program, place, results);
        } else {
            refine(program, self, place, depth, results);
        }
    }

    /// Encloses every output component over `place`.
    pub(crate) fn run(&mut self, program: &Program, place: &Bounds3, results: &mut [Interval]) {
        for instruction in &program.instructions {
            self.inputs.clear();
            let registers = &self.registers;
            self.inputs.extend(instruction.inputs.iter().map(|operand| read(operand, registers, place)));
            let range = instruction.first_register..instruction.first_register + instruction.components();
            instruction.evaluator.bounds(&self.inputs, &mut self.registers[range]);
        }
        let operands = program.outputs.iter().flat_map(|output| &output.operands);
        for (result, operand) in results.iter_mut().zip(operands) {
            *result = read(operand, &self.registers, place);
        }
    }
}

fn read(operand: &Operand, registers: &[Interval], place: &Bounds3) -> Interval {
    match operand {
        Operand::Constant(value) => Interval::point(*value).flushed(),
        Operand::Position(axis) => Interval::new(place.low[*axis], place.high[*axis]),
        Operand::Attribute(..) => Interval::EVERYTHING,
        Operand::Register(register) => registers[*register],
    }
}

impl Program {
    /// Encloses every output component over a box of object-space positions. Programs that read
    /// per-point attributes have no bounds: nothing is known of the attributes.
    pub fn bounds(&self, low: [f32; 3], high: [f32; 3]) -> Result<Vec<Interval>> {
        self.check_bounds()?;
        let mut results = vec![Interval::EVERYTHING; self.output_components()];
        Workspace::new(self).run(self, &Bounds3 { low, high }, &mut results);
        Ok(results)
    }

    /// [`Self::bounds`] of many boxes on all cores: box by box, the components of all outputs.
    pub fn bounds_many(&self, boxes: &[Bounds3]) -> Result<Vec<Interval>> {
        self.bounds_refined(boxes, 0)
    }

    /// [`Self::bounds_many`], each box divided `depth` times into eight: the union of the parts,
    /// which is narrower because coarse and fine structure are bounded at one place. Parts that add
    /// nothing to what is known of the others are not divided further.
    pub fn bounds_refined(&self, boxes: &[Bounds3], depth: u32) -> Result<Vec<Interval>> {
        self.check_bounds()?;
        let width = self.output_components();
        let mut results = vec![Interval::EVERYTHING; boxes.len() * width];
        if width == 0 {
            return Ok(results);
        }
        results.par_chunks_mut(width).zip(boxes).for_each_init(
            || Workspace::new(self),
            |workspace, (results, place)| workspace.run_refined(self, place, depth, results),
        );
        Ok(results)
    }

    fn check_bounds(&self) -> Result<()> {
        match self.attributes.first() {
            None => Ok(()),
            Some(name) => Err(Error::new(
                format!("attribute {name}"),
                "a per-point attribute",
                "a program of the position alone",
                "Bounds exist for scenes, not for probe graphs with attributes.",
            )),
        }
    }
}

/// Divides the parts of a box that stick out of the union of the finest ones, largest first.
fn refine(program: &Program, workspace: &mut Workspace, place: &Bounds3, depth: u32, results: &mut [Interval]) {
    let width = results.len();
    let mut whole = vec![Interval::EVERYTHING; width];
    workspace.run(program, place, &mut whole);
    let mut known: Option<Vec<Interval>> = None;
    let mut pending = vec![(*place, whole, depth)];
    while let Some((place, bounds, depth)) = pending.pop() {
        let inside =
            |known: &Vec<Interval>| known.iter().zip(&bounds).all(|(known, bounds)| known.hull(*bounds) == *known);
        let point_like = bounds.iter().all(|bounds| bounds.as_point().is_some());
        if known.as_ref().is_some_and(inside) {
            continue;
        }
        if depth == 0 || point_like {
            known = Some(match known {
                None => bounds,
                Some(known) => known.iter().zip(&bounds).map(|(known, bounds)| known.hull(*bounds)).collect(),
            });
            continue;
        }
        let start = pending.len();
        for part in place.octants() {
            let mut parts = vec![Interval::EVERYTHING; width];
            workspace.run(program, &part, &mut parts);
            let met = parts.iter().zip(&bounds).map(|(part, whole)| part.meet(*whole)).collect();
            pending.push((part, met, depth - 1));
        }
        // The part with the highest upper end comes next: the others then often add nothing.
        pending[start..].sort_by(|a, b| a.1[0].high.total_cmp(&b.1[0].high));
    }
    if let Some(known) = known {
        results.copy_from_slice(&known);
    }
}
