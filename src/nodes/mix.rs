//! Mix (`ShaderNodeMix`): mixes two floats, vectors or colours.
//!
//! Floats and vectors are weighted by 1 - factor and factor; vectors may have a factor per component. Colours are
//! blended in one of 19 modes and may be limited to [0, 1] after that. `clamp_factor` limits the factor to [0, 1].

pub(super) mod blend;
mod folding;
mod formulas;

use crate::base::arrays::Mapped;
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, Mode, NodeType, OutputSocket, Property, Real, Role, Simplified,
};
use crate::scene::SocketType;
use blend::{BLEND_TYPES, Blend, Corner, same_output};
use formulas::weighted;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeMix",
    label: "Mix",
    module: "mix",
    shader: include_str!("../../shaders/nodes/mix.wgsl"),
    properties: &[
        Property::choice("data_type", &["FLOAT", "VECTOR", "RGBA"]),
        Property::choice("factor_mode", &["UNIFORM", "NON_UNIFORM"]),
        Property::choice("blend_type", BLEND_TYPES),
        Property::flag("clamp_factor", true),
        Property::flag("clamp_result", false),
    ],
    inputs: &[
        InputSocket::float("Factor_Float", "Factor", &[0.5], |mode| !is_non_uniform(mode)),
        InputSocket::vector("Factor_Vector", "Factor", &[0.5; 3], is_non_uniform),
        InputSocket::float("A_Float", "A", &[0.0], is_float),
        InputSocket::float("B_Float", "B", &[0.0], is_float),
        InputSocket::vector("A_Vector", "A", &[0.0; 3], is_vector),
        InputSocket::vector("B_Vector", "B", &[0.0; 3], is_vector),
        InputSocket::color_when("A_Color", "A", &[0.5; 3], is_color),
        InputSocket::color_when("B_Color", "B", &[0.5; 3], is_color),
    ],
    outputs: &[
        OutputSocket::new("Result_Float", SocketType::Float, is_float),
        OutputSocket::new("Result_Vector", SocketType::Vector, is_vector),
        OutputSocket::new("Result_Color", SocketType::Color, is_color),
    ],
    role: Role::Evaluated(|mode| {
        let clamp_factor = mode.flag("clamp_factor");
        if is_color(mode) {
            let (kind, release) = (mode.choice("blend_type"), mode.release());
            return Box::new(Blend { kind, clamp_factor, clamp_result: mode.flag("clamp_result"), release });
        }
        let factors = if is_non_uniform(mode) { 3 } else { 1 };
        Box::new(Mix { factors, components: if is_vector(mode) { 3 } else { 1 }, clamp_factor })
    }),
};

fn is_float(mode: &Mode) -> bool {
    mode.choice("data_type") == "FLOAT"
}

fn is_vector(mode: &Mode) -> bool {
    mode.choice("data_type") == "VECTOR"
}

fn is_color(mode: &Mode) -> bool {
    mode.choice("data_type") == "RGBA"
}

/// A factor for each component; vectors only.
fn is_non_uniform(mode: &Mode) -> bool {
    is_vector(mode) && mode.choice("factor_mode") == "NON_UNIFORM"
}

/// Floats and vectors. Inputs: the factors, the components of a, those of b.
struct Mix {
    factors: usize,
    components: usize,
    clamp_factor: bool,
}

impl Mix {
    /// Columns of the factor and of both operands for a component.
    fn columns(&self, axis: usize) -> [usize; 3] {
        [axis.min(self.factors - 1), self.factors + axis, self.factors + self.components + axis]
    }
}

impl Evaluate for Mix {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        for (axis, output) in outputs.iter_mut().enumerate() {
            super::map(inputs, self.columns(axis), output, |[factor, a, b]| {
                weighted(a, b, if self.clamp_factor { factor.saturate() } else { factor })
            });
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        for (axis, output) in outputs.iter_mut().enumerate() {
            let [factor, a, b] = self.columns(axis).mapped(|column| inputs[column]);
            let factor = if self.clamp_factor { factor.saturate() } else { factor };
            *output = blend::enclose(weighted::<Interval>, weighted::<Corner>, [a, b, factor], &[]);
        }
    }

    fn fold_constants(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        // The kernels' formula; only the limit differs, for NaN.
        let folded = |axis: usize| {
            let [factor, a, b] = self.columns(axis).mapped(|column| inputs[column]);
            weighted(a, b, folding::limited(factor, self.clamp_factor))
        };
        Some((0..self.components).map(folded).collect())
    }

    fn simplify_constants(&self, inputs: &[Option<f32>]) -> Option<Simplified> {
        // Cycles' rules (measured); a factor per component has none. They show where the weighted sum of equal values
        // rounds and where a weight of 0 meets NaN or infinity.
        if self.factors > 1 {
            return None;
        }
        let (a, b): (Vec<usize>, Vec<usize>) =
            (0..self.components).map(|axis| self.columns(axis)).map(|[_, a, b]| (a, b)).unzip();
        let constant = |columns: &[usize]| columns.iter().map(|&column| inputs[column]).collect::<Option<Vec<f32>>>();
        let equal = constant(&a).is_some_and(|a| Some(a) == constant(&b));
        let kept = match inputs[0].map(|factor| if self.clamp_factor { factor.saturate() } else { factor }) {
            Some(0.0) => a,
            _ if equal => a,
            Some(1.0) => b,
            _ => return None,
        };
        Some(Simplified::Inputs(kept))
    }

    fn simplify_linked(&self, inputs: &[Option<f32>], equal: &dyn Fn(usize, usize) -> bool) -> Option<Simplified> {
        // Whatever the factor is, but a factor per component keeps the formula (measured).
        let pairs: Vec<[usize; 2]> =
            (0..self.components).map(|axis| self.columns(axis)).map(|[_, a, b]| [a, b]).collect();
        let passes = self.factors == 1 && same_output(&pairs, inputs, equal);
        passes.then(|| Simplified::Inputs(pairs.iter().map(|[a, _]| *a).collect()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INPUTS: [f32; 9] = [0.25, 1.5, -1.0, 1.0, 2.0, 3.0, 5.0, -2.0, f32::NAN];

    fn mixed(mix: &Mix) -> Vec<f32> {
        let columns = INPUTS.each_ref().map(|value| Column { values: std::slice::from_ref(value), uniform: true });
        let mut result = vec![0.0; mix.components];
        let mut outputs: Vec<&mut [f32]> = result.iter_mut().map(std::slice::from_mut).collect();
        mix.evaluate(&columns, &mut outputs);
        result
    }

    #[test]
    fn components_have_their_own_factors_where_asked() {
        assert_eq!(mixed(&Mix { factors: 1, components: 1, clamp_factor: true }), [1.5 * 0.75 - 0.25]);
        let plain = mixed(&Mix { factors: 3, components: 3, clamp_factor: false });
        assert_eq!(plain[..2], [2.0, 2.0 * -0.5 - 2.0 * 1.5]);
        let clamped = mixed(&Mix { factors: 3, components: 3, clamp_factor: true });
        assert_eq!(clamped[..2], [2.0, -2.0]);
        // A weight of 0 does not stop a NaN.
        assert!(clamped[2].is_nan());
    }

    #[test]
    fn neutral_factors_and_equal_constants_simplify() {
        let mix = Mix { factors: 1, components: 1, clamp_factor: true };
        assert_eq!(mix.simplify_constants(&[Some(-2.0), None, None]), Some(Simplified::Inputs(vec![1])));
        assert_eq!(mix.simplify_constants(&[Some(2.0), None, None]), Some(Simplified::Inputs(vec![2])));
        assert_eq!(mix.simplify_constants(&[None, Some(0.1), Some(0.1)]), Some(Simplified::Inputs(vec![1])));
        let free = Mix { clamp_factor: false, ..mix };
        assert_eq!(free.simplify_constants(&[Some(2.0), None, None]), None);
    }
    #[test]
    fn constants_keep_a_missing_factor() {
        let mix = Mix { factors: 1, components: 1, clamp_factor: true };
        assert_eq!(mix.fold_constants(&[2.0, 1.5, -1.0]), Some(vec![-1.0]));
        // The kernels' limit would make this factor 0.
        assert!(mix.fold_constants(&[f32::NAN, 1.5, -1.0]).expect("a rule")[0].is_nan());
        let each = Mix { factors: 3, components: 3, clamp_factor: false };
        let folded = each.fold_constants(&[0.25, 2.0, 0.0, 1.0, 2.0, 3.0, 5.0, -2.0, 8.0]);
        assert_eq!(folded, Some(vec![2.0, -6.0, 3.0]));
    }

    #[test]
    fn one_output_linked_twice_passes() {
        let float = Mix { factors: 1, components: 1, clamp_factor: true };
        let at = |mix: &Mix, equal: &dyn Fn(usize, usize) -> bool| mix.simplify_linked(&[None; 9], equal);
        assert_eq!(at(&float, &|a, b| [a, b] == [1, 2]), Some(Simplified::Inputs(vec![1])));
        assert_eq!(at(&float, &|_, _| false), None);
        let vector = Mix { components: 3, ..float };
        assert_eq!(at(&vector, &|a, b| a + 3 == b), Some(Simplified::Inputs(vec![1, 2, 3])));
        assert_eq!(at(&vector, &|a, b| a + 3 == b && a != 2), None);
        assert_eq!(at(&Mix { factors: 3, ..vector }, &|a, b| a + 3 == b), None);
    }
}
