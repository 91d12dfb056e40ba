//! Enclosing a program over a box.

use super::{Operand, Program};
use crate::error::{Error, Result};
use crate::nodes::Interval;

impl Program {
    /// Encloses every output component over a box of object-space positions. Programs that read
    /// per-point attributes have no bounds: nothing is known of the attributes.
    pub fn bounds(&self, low: [f32; 3], high: [f32; 3]) -> Result<Vec<Interval>> {
        if let Some(name) = self.attributes.first() {
            return Err(Error::new(
                format!("attribute {name}"),
                "a per-point attribute",
                "a program of the position alone",
                "Bounds exist for scenes, not for probe graphs with attributes.",
            ));
        }
        let mut registers = vec![Interval::EVERYTHING; self.registers];
        let read = |registers: &[Interval], operand: &Operand| match operand {
            Operand::Constant(value) => Interval::point(*value),
            Operand::Position(axis) => Interval::new(low[*axis], high[*axis]),
            Operand::Attribute(..) => Interval::EVERYTHING,
            Operand::Register(register) => registers[*register],
        };
        for instruction in &self.instructions {
            let inputs: Vec<Interval> = instruction.inputs.iter().map(|operand| read(&registers, operand)).collect();
            let range = instruction.first_register..instruction.first_register + instruction.components();
            instruction.kernel.bounds(&inputs, &mut registers[range]);
        }
        Ok(self.outputs.iter().flat_map(|output| &output.operands).map(|operand| read(&registers, operand)).collect())
    }
}
