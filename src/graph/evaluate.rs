//! Running a program on the CPU, in batches of points on all cores.

use crate::base::error::{Error, Result};
use crate::graph::{Operand, Program};
use crate::nodes::{Column, NodeEvaluator, Nudge, Nudged, Oracle, Real, RunningError, nudged};
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Points per batch: registers of a batch stay in the caches.
const BATCH: usize = 512;

/// Which arithmetic to evaluate with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arithmetic {
    /// f32, bit for bit as Cycles.
    Single,
    /// f64 with f32 coordinates and hashes.
    Oracle,
    /// f64 throughout.
    Unrounded,
}

/// Points and what is given beside them.
#[derive(Clone, Copy)]
pub struct Points<'a> {
    /// Positions in the object's frame.
    pub positions: &'a [[f32; 3]],
    /// Per-point attributes by name, as long as the positions.
    pub attributes: &'a [(String, Vec<[f32; 3]>)],
}

impl<'a> Points<'a> {
    /// Positions without attributes.
    pub fn new(positions: &'a [[f32; 3]]) -> Self {
        Self { positions, attributes: &[] }
    }
}

/// A number type with its entry point into an evaluator.
pub trait Evaluation: Real {
    /// Evaluates one instruction.
    fn run(evaluator: &dyn NodeEvaluator, inputs: &[Column<'_, Self>], outputs: &mut [&mut [Self]]);
}

impl Evaluation for f32 {
    fn run(evaluator: &dyn NodeEvaluator, inputs: &[Column<'_, Self>], outputs: &mut [&mut [Self]]) {
        evaluator.evaluate_f32(inputs, outputs);
    }
}

impl Evaluation for Oracle {
    fn run(evaluator: &dyn NodeEvaluator, inputs: &[Column<'_, Self>], outputs: &mut [&mut [Self]]) {
        evaluator.evaluate_oracle(inputs, outputs);
    }
}

impl Evaluation for f64 {
    fn run(evaluator: &dyn NodeEvaluator, inputs: &[Column<'_, Self>], outputs: &mut [&mut [Self]]) {
        evaluator.evaluate_unrounded(inputs, outputs);
    }
}

impl Evaluation for RunningError {
    fn run(evaluator: &dyn NodeEvaluator, inputs: &[Column<'_, Self>], outputs: &mut [&mut [Self]]) {
        evaluator.evaluate_running_error(inputs, outputs);
    }
}

impl Evaluation for Nudged {
    fn run(evaluator: &dyn NodeEvaluator, inputs: &[Column<'_, Self>], outputs: &mut [&mut [Self]]) {
        evaluator.evaluate_nudged(inputs, outputs);
    }
}

impl Program {
    /// Evaluates every output at every point. The result holds, point by point, the components of
    /// all outputs in order, as f64 (exact for f32 arithmetic).
    pub fn evaluate(&self, points: Points<'_>, arithmetic: Arithmetic) -> Result<Vec<f64>> {
        Ok(match arithmetic {
            Arithmetic::Single => self.evaluate_as::<f32>(points)?.into_iter().map(f64::from).collect(),
            Arithmetic::Oracle => self.evaluate_as::<Oracle>(points)?.into_iter().map(|value| value.0).collect(),
            Arithmetic::Unrounded => self.evaluate_as::<f64>(points)?,
        })
    }

    /// [`Self::evaluate`] in f32, without the widening.
    pub fn evaluate_single(&self, points: Points<'_>) -> Result<Vec<f32>> {
        self.evaluate_as::<f32>(points)
    }

    /// How far two conforming evaluations may be apart, [`RunningError::between_evaluations`], for
    /// every output component at every point, in the order of [`Self::evaluate`].
    pub fn rounding_bounds(&self, points: Points<'_>) -> Result<Vec<f64>> {
        let found = self.evaluate_as::<RunningError>(points)?;
        Ok(found.into_iter().map(RunningError::between_evaluations).collect())
    }

    fn evaluate_as<R: Evaluation>(&self, points: Points<'_>) -> Result<Vec<R>> {
        let attributes = self.attribute_columns(points)?;
        let width = self.output_components();
        let mut results = vec![R::default(); points.positions.len() * width];
        if width == 0 {
            return Ok(results);
        }
        results.par_chunks_mut(BATCH * width).enumerate().for_each_init(
            || Workspace::<R>::new(self),
            |workspace, (batch, results)| {
                let start = batch * BATCH;
                let count = results.len() / width;
                let positions = &points.positions[start..start + count];
                let attributes: Vec<_> = attributes.iter().map(|values| &values[start..start + count]).collect();
                workspace.run(self, positions, &attributes);
                workspace.collect(self, count, results);
            },
        );
        Ok(results)
    }

    /// [`Self::evaluate_single`] under a nudge, on the calling thread.
    pub fn evaluate_nudged(&self, points: Points<'_>, nudge: Nudge) -> Result<Vec<f32>> {
        let found = nudged::with(nudge, || self.evaluate_observed::<Nudged>(points, |_, _, _| ()))?;
        Ok(found.into_iter().map(|value| value.0).collect())
    }

    /// Per output, whether at these points a function of the C library computes it or anything before it.
    pub fn outputs_of_library(&self, points: Points<'_>) -> Result<Vec<bool>> {
        let mut calling = vec![false; self.instructions.len()];
        let mut known = nudged::calls();
        nudged::with(Nudge::Nothing, || {
            self.evaluate_observed::<Nudged>(points, |_, number, _| {
                calling[number] |= nudged::calls() > known;
                known = nudged::calls();
            })
        })?;
        let mut touched = vec![false; self.registers];
        let is_touched = |operand: &Operand, touched: &[bool]| match operand {
            Operand::Register(register) => touched[*register],
            _ => false,
        };
        for (instruction, calls) in self.instructions.iter().zip(calling) {
            let through = calls || instruction.inputs.iter().any(|operand| is_touched(operand, &touched));
            touched[instruction.first_register..][..instruction.components()].fill(through);
        }
        let any = |operands: &[Operand]| operands.iter().any(|operand| is_touched(operand, &touched));
        Ok(self.outputs.iter().map(|output| any(&output.operands)).collect())
    }

    /// Point by point, for every output, whether `is_ordinary` holds for it and for every value that it is made from.
    pub fn ordinary(&self, points: Points<'_>, is_ordinary: impl Fn(f32) -> bool) -> Result<Vec<bool>> {
        // By register, then by point.
        let mut clean = vec![vec![false; points.positions.len()]; self.registers];
        let values = self.evaluate_observed::<f32>(points, |workspace, number, range| {
            let instruction = &self.instructions[number];
            let slots: Vec<usize> = instruction.inputs.iter().map(|operand| workspace.slot(operand)).collect();
            let registers = instruction.first_register..instruction.first_register + instruction.components();
            for (index, point) in range.enumerate() {
                let input = |(operand, &slot): (&Operand, &usize)| match operand {
                    Operand::Register(register) => clean[*register][point],
                    _ => is_ordinary(workspace.columns[slot][index]),
                };
                let inputs = instruction.inputs.iter().zip(&slots).all(input);
                for register in registers.clone() {
                    let value = workspace.columns[workspace.first_register + register][index];
                    clean[register][point] = inputs && is_ordinary(value);
                }
            }
        })?;
        let mut results = Vec::with_capacity(points.positions.len() * self.outputs.len());
        for (point, values) in values.chunks(self.output_components().max(1)).enumerate() {
            let mut component = 0;
            for output in &self.outputs {
                results.push(output.operands.iter().zip(&values[component..]).all(|(operand, &value)| match operand {
                    Operand::Register(register) => clean[*register][point],
                    _ => is_ordinary(value),
                }));
                component += output.operands.len();
            }
        }
        Ok(results)
    }

    /// Evaluates on the calling thread; after each instruction `observe` is given the columns, the instruction's number
    /// and which points they hold.
    fn evaluate_observed<R: Evaluation>(
        &self,
        points: Points<'_>,
        mut observe: impl FnMut(&Workspace<R>, usize, std::ops::Range<usize>),
    ) -> Result<Vec<R>> {
        let attributes = self.attribute_columns(points)?;
        let width = self.output_components();
        let mut results = vec![R::default(); points.positions.len() * width];
        let mut workspace = Workspace::new(self);
        for start in (0..points.positions.len()).step_by(BATCH) {
            let range = start..points.positions.len().min(start + BATCH);
            let attributes: Vec<_> = attributes.iter().map(|values| &values[range.clone()]).collect();
            workspace.run_observed(self, &points.positions[range.clone()], &attributes, |workspace, number| {
                observe(workspace, number, range.clone());
            });
            workspace.collect(self, range.len(), &mut results[start * width..range.end * width]);
        }
        Ok(results)
    }

    fn attribute_columns<'a>(&self, points: Points<'a>) -> Result<Vec<&'a [[f32; 3]]>> {
        self.attributes
            .iter()
            .map(|name| {
                let found = points.attributes.iter().find(|(given, _)| given == name);
                match found {
                    Some((_, values)) if values.len() == points.positions.len() => Ok(values.as_slice()),
                    Some((_, values)) => Err(Error::new(
                        format!("attribute {name}"),
                        format!("{} values", values.len()),
                        format!("{}, one per point", points.positions.len()),
                        "Give as many attribute values as points.",
                    )),
                    None => Err(Error::new(
                        format!("attribute {name}"),
                        "no values",
                        "three numbers per point",
                        "Attribute nodes only evaluate in probes that carry their data; remove the node from the scene.",
                    )),
                }
            })
            .collect()
    }
}

/// Evaluates in f32 on the calling thread and keeps its memory between calls: for callers that are
/// parallel themselves. The bits are those of [`Program::evaluate_single`].
pub struct Evaluator<'a> {
    program: &'a Program,
    workspace: Workspace<f32>,
    results: Vec<f32>,
}

impl<'a> Evaluator<'a> {
    /// An evaluator of a program of the position alone; one that reads attributes is an error.
    pub fn new(program: &'a Program) -> Result<Self> {
        program.attribute_columns(Points::new(&[]))?;
        Ok(Self { program, workspace: Workspace::new(program), results: Vec::new() })
    }

    /// Point by point, the components of all outputs in order.
    pub fn evaluate(&mut self, positions: &[[f32; 3]]) -> &[f32] {
        let width = self.program.output_components();
        self.results.resize(positions.len() * width, 0.0);
        if width > 0 {
            for (positions, results) in positions.chunks(BATCH).zip(self.results.chunks_mut(BATCH * width)) {
                self.workspace.run(self.program, positions, &[]);
                self.workspace.collect(self.program, positions.len(), results);
            }
        }
        &self.results
    }
}

/// A program with memory to evaluate it in, for callers that ask for few positions at a time and from any thread.
pub struct Shared {
    program: Program,
    /// Memory that no thread uses at present.
    idle: Mutex<Vec<(Workspace<f32>, Vec<f32>)>>,
}

impl Shared {
    /// Of a program of the position alone; one that reads attributes is an error.
    pub fn new(program: Program) -> Result<Self> {
        program.attribute_columns(Points::new(&[]))?;
        Ok(Self { program, idle: Mutex::new(Vec::new()) })
    }

    /// The program.
    pub fn program(&self) -> &Program {
        &self.program
    }

    /// What `read` makes of the components of all outputs, point by point. The bits are those of
    /// [`Program::evaluate_single`].
    pub fn evaluate<T>(&self, positions: &[[f32; 3]], read: impl FnOnce(&[f32]) -> T) -> T {
        let idle = || self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let found = idle().pop();
        let (workspace, results) = found.unwrap_or_else(|| (Workspace::new(&self.program), Vec::new()));
        let mut evaluator = Evaluator { program: &self.program, workspace, results };
        let result = read(evaluator.evaluate(positions));
        let Evaluator { workspace, results, .. } = evaluator;
        idle().push((workspace, results));
        result
    }
}

/// Columns of one batch: positions, attributes, constants, registers.
struct Workspace<R> {
    /// Column of every distinct operand, by [`Workspace::slots`].
    columns: Vec<Vec<R>>,
    uniform: Vec<bool>,
    first_attribute: usize,
    first_constant: usize,
    constants: Vec<u32>,
    first_register: usize,
}

impl<R: Evaluation> Workspace<R> {
    fn new(program: &Program) -> Self {
        let operands = || {
            program
                .instructions
                .iter()
                .flat_map(|instruction| &instruction.inputs)
                .chain(program.outputs.iter().flat_map(|output| &output.operands))
        };
        let mut constants: Vec<u32> = operands()
            .filter_map(|operand| match operand {
                Operand::Constant(value) => Some(value.to_bits()),
                _ => None,
            })
            .collect();
        constants.sort_unstable();
        constants.dedup();
        let first_attribute = 3;
        let first_constant = first_attribute + 3 * program.attributes.len();
        let first_register = first_constant + constants.len();
        let mut columns = vec![vec![R::default(); BATCH]; first_register + program.registers];
        let mut uniform = vec![false; columns.len()];
        for (index, &bits) in constants.iter().enumerate() {
            columns[first_constant + index].fill(R::of(f32::from_bits(bits)));
            uniform[first_constant + index] = true;
        }
        Self { columns, uniform, first_attribute, first_constant, constants, first_register }
    }

    fn slot(&self, operand: &Operand) -> usize {
        match operand {
            Operand::Position(axis) => *axis,
            Operand::Attribute(number, axis) => self.first_attribute + 3 * number + axis,
            Operand::Constant(value) => {
                let found = self.constants.binary_search(&value.to_bits());
                self.first_constant + found.expect("every constant has a column")
            }
            Operand::Register(register) => self.first_register + register,
        }
    }

    fn run(&mut self, program: &Program, positions: &[[f32; 3]], attributes: &[&[[f32; 3]]]) {
        self.run_observed(program, positions, attributes, |_, _| ());
    }

    /// [`Self::run`]; `observe` is told the number of each instruction that was just done.
    fn run_observed(
        &mut self,
        program: &Program,
        positions: &[[f32; 3]],
        attributes: &[&[[f32; 3]]],
        mut observe: impl FnMut(&Self, usize),
    ) {
        let count = positions.len();
        for axis in 0..3 {
            for (value, position) in self.columns[axis].iter_mut().zip(positions) {
                *value = R::of(position[axis]);
            }
            for (number, values) in attributes.iter().enumerate() {
                let column = &mut self.columns[self.first_attribute + 3 * number + axis];
                for (value, attribute) in column.iter_mut().zip(*values) {
                    *value = R::of(attribute[axis]);
                }
            }
        }
        for (number, instruction) in program.instructions.iter().enumerate() {
            let slots: Vec<usize> = instruction.inputs.iter().map(|operand| self.slot(operand)).collect();
            let start = self.first_register + instruction.first_register;
            // Results stand behind everything that an instruction may read.
            let (before, after) = self.columns.split_at_mut(start);
            let inputs: Vec<Column<'_, R>> = slots
                .iter()
                .map(|&slot| Column { values: &before[slot][..count], uniform: self.uniform[slot] })
                .collect();
            let mut outputs: Vec<&mut [R]> =
                after[..instruction.components()].iter_mut().map(|column| &mut column[..count]).collect();
            R::run(instruction.evaluator.as_ref(), &inputs, &mut outputs);
            observe(self, number);
        }
    }

    fn collect(&self, program: &Program, count: usize, results: &mut [R]) {
        let operands = program.outputs.iter().flat_map(|output| &output.operands);
        let width = program.output_components();
        for (component, operand) in operands.enumerate() {
            let column = &self.columns[self.slot(operand)];
            for index in 0..count {
                results[index * width + component] = column[index];
            }
        }
    }
}
