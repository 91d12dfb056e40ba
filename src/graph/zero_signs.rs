//! Signs of zeros that constants lose on their way into the sockets of Cycles.
//!
//! Cycles sets a socket only to a value that differs from the one that it holds, and to it -0 and +0 do not differ. A vector
//! is compared as a whole: of a socket that holds (0, 0, 0), the constant (-0, 0, 0) leaves +0 and (-0, 0, 1) is taken as
//! it is. What a socket holds:
//!
//! * At first Cycles' own default. Blender then hands over what is stored, and what it folded itself.
//! * After that the stored value, where Blender left a link. What Cycles folds itself goes into that. (Scene files do not
//!   hold the stored values of linked sockets: Blender's default stands in.)
//!
//! Nodes that stand between do the same with their own sockets, which begin with zeros. Cycles puts one before a float that
//! a vector reads, and Blender one before a socket that shows no value in the interface, if the link to it carries a constant:
//! such a socket cannot store it.
//!
//! What Blender folds by itself keeps all signs, and so does what is only known at run time.

use crate::graph::flatten::{FlatNode, Source};
use crate::nodes::InputSocket;
use crate::scene::SocketType;

/// What a socket of Cycles begins with where it is not Blender's default.
const ZEROS: [f32; 3] = [0.0; 3];

/// A constant on its way into a socket.
struct Constant {
    values: Vec<f32>,
    /// Blender hands it over; if not, Cycles folded it.
    is_of_blender: bool,
    /// A colour that Cycles' own Color node holds.
    is_stored_color: bool,
    /// One float that a vector reads.
    is_converted: bool,
}

impl Constant {
    /// Loses the signs of its zeros in a socket that holds the same but for them.
    fn enter(&mut self, held: &[f32]) {
        if self.values.iter().zip(held).all(|(value, held)| value == held) {
            self.lose_signs();
        }
    }

    /// The same with a socket for each component.
    fn enter_apart(&mut self) {
        self.lose_signs();
    }

    fn lose_signs(&mut self) {
        // -0 + 0 is +0, and nothing else changes.
        self.values.iter_mut().for_each(|value| *value += 0.0);
    }

    fn enter_socket(&mut self, socket: &InputSocket, is_linked: bool) {
        if self.is_of_blender && !(is_linked && socket.hides_value) {
            self.enter(if socket.is_zero_in_cycles { &ZEROS } else { socket.default });
            return;
        }
        if self.is_of_blender {
            match socket.kind {
                // Combine XYZ.
                SocketType::Vector => self.enter_apart(),
                // Color, Value.
                _ => self.enter(&ZEROS),
            }
        } else if self.is_stored_color {
            self.enter(&ZEROS);
        } else if self.is_converted {
            self.enter_apart();
        }
        self.enter(socket.default);
    }
}

/// Takes the signs from the constants among the inputs of a node that Blender does not fold. `early` says which nodes it does.
pub(super) fn settle(node: &FlatNode, early: &[bool], inputs: &mut [Source]) {
    let mut first = 0;
    for (socket, &is_linked) in node.node_type.inputs_of(&node.mode).zip(&node.linked) {
        let range = first..first + socket.kind.components();
        first = range.end;
        let values = inputs[range.clone()].iter().map(|source| match source {
            Source::Constant(value) => Some(*value),
            _ => None,
        });
        let Some(values) = values.collect::<Option<Vec<f32>>>() else { continue };
        let given = &node.inputs[range.clone()];
        let Some(start) = given.first() else { continue };
        let mut constant = Constant {
            values,
            is_of_blender: given.iter().all(|source| match source {
                Source::Constant(_) => true,
                Source::Node(number, _) => early[*number],
                _ => false,
            }),
            is_stored_color: matches!(start, Source::LateConstant(_)),
            is_converted: given.len() > 1 && given.iter().all(|source| source == start),
        };
        constant.enter_socket(socket, is_linked);
        for (source, value) in inputs[range].iter_mut().zip(constant.values) {
            *source = Source::Constant(value);
        }
    }
}
