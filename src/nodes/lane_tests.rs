//! What the tests of the lane versions share: coordinates that look for trouble, and the comparison
//! of the lane version with the scalar one.

use crate::nodes::{Column, Mode, NodeType, Role};
use rand::{Rng as _, SeedableRng as _};

/// `count` rows of x, y, z, w: half random, half on cell faces, near zero, huge or not finite.
pub(super) fn adversarial_coordinates(count: usize) -> Vec<[f32; 4]> {
    let special = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        0.5,
        -0.5,
        0.2,
        1e-9,
        -1e-9,
        1e-40,
        3.0,
        -7.0,
        1e3,
        -1e3,
        1e5,
        -1e5,
        1e6,
        1e7,
        1.6e7,
        2.5e8,
        1e9,
        3e9,
        -3e9,
        1e30,
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
    ];
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    (0..count)
        .map(|index| {
            std::array::from_fn(|_| {
                if index % 2 == 0 || random.random_bool(0.6) {
                    random.random_range(-20.0..20.0)
                } else {
                    special[random.random_range(0..special.len())]
                }
            })
        })
        .collect()
}

/// Evaluates with equal parameters at all points (lanes) and with parameters that count as varying
/// (scalar), and asserts that every bit agrees.
pub(super) fn assert_lanes_equal_scalar(
    node_type: &'static NodeType,
    properties: &serde_json::Value,
    wanted: Vec<&'static str>,
    coordinates: &[[f32; 4]],
    parameters: &[f32],
) {
    let properties = properties.as_object().expect("an object of properties");
    let mode = Mode::read(node_type, properties, "test").expect("legal properties").with_wanted(wanted);
    let Role::Evaluated(build) = node_type.role else { panic!("a node that evaluates") };
    let evaluator = build(&mode);
    let count = coordinates.len();
    let components: usize = node_type
        .outputs_of(&mode)
        .filter(|output| mode.wants(output.identifier))
        .map(|output| output.kind.components())
        .sum();
    // A vector input carries three columns even where two are read; W follows it in 4D and stands alone in 1D.
    let vectors: Vec<usize> =
        match node_type.inputs_of(&mode).take(2).map(|socket| socket.identifier).collect::<Vec<_>>()[..] {
            ["Vector", "W"] => vec![0, 1, 2, 3],
            ["W", _] => vec![3],
            _ => vec![0, 1, 2],
        };
    let values: Vec<Vec<f32>> = vectors
        .iter()
        .map(|&axis| coordinates.iter().map(|row| row[axis]).collect())
        .chain(parameters.iter().map(|&parameter| vec![parameter; count]))
        .collect();
    let evaluate = |uniform: bool| {
        let columns: Vec<Column<'_, f32>> = values
            .iter()
            .enumerate()
            .map(|(index, values)| Column { values, uniform: uniform && index >= vectors.len() })
            .collect();
        let mut outputs = vec![vec![0.0_f32; count]; components];
        let mut slices: Vec<&mut [f32]> = outputs.iter_mut().map(Vec::as_mut_slice).collect();
        evaluator.evaluate_f32(&columns, &mut slices);
        outputs
    };
    let (lanes, scalar) = (evaluate(true), evaluate(false));
    for component in 0..components {
        for index in 0..count {
            let (lane, expected) = (lanes[component][index], scalar[component][index]);
            assert!(
                lane.to_bits() == expected.to_bits() || (lane.is_nan() && expected.is_nan()),
                "{:?} at {:?}: lanes {lane:?}, scalar {expected:?}",
                mode.words(),
                coordinates[index]
            );
        }
    }
}
