//! The density of a scene at extreme places and under extreme values of its inputs, f32 on the CPU and WGSL against f64.
//!
//! The f64 value is that of the oracle, which rounds to f32 only where a texture is a function of the rounded coordinate. What f32 may be off
//! by is bounded point by point by running error analysis ([`Program::rounding_bounds`]): at a coordinate of 1e6 an ulp is 0.06, and the
//! bound is what an ulp of every intermediate moves the field by, no guess. Where it knows nothing, because the error of a coordinate
//! reaches a jump, the enclosure of the point holds for every evaluator ([`Program::bounds`]): its width is the bound.

use crate::base::error::Result;
use crate::gpu::Gpu;
use crate::graph::Program;
use crate::graph::bounds::Bounds3;
use crate::graph::evaluate::{Arithmetic, Points};
use crate::measure::domain;
use crate::measure::domain::Domain;
use crate::measure::evaluators;
use crate::measure::evaluators::Evaluator;
use crate::measure::stability::{Bound, Head, Judgement, Subject};
use crate::scene::Scene;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Points of a case.
const POINTS: usize = 512;

/// Seed of the points.
const SEED: u64 = 19;

/// Values that inputs are set to, by their labels in the material. Those beyond what the interface of a group admits are set all the same:
/// a script may, and so may a link.
const EXTREMES: &[(&str, &[f32])] = &[
    ("Density", &[0.0, 1e-6, 1e4, 1e8]),
    ("Low Altitude Density", &[0.0, 1.0]),
    ("Altitude", &[0.0, 1e-8, 1e6]),
    ("Thickness", &[0.0, 1e-8]),
    ("Scale", &[0.0, 1e-8, 1e6]),
    ("Time", &[1e6, -1e6]),
    ("W", &[1e6, -1e6]),
    ("Factor", &[0.0, 1.0]),
    ("Detail", &[0.0, 15.0]),
    ("Strength", &[0.0, 1e8]),
];

/// A case: a scene and the places at which its density is asked for.
pub struct Case {
    /// Its name.
    pub name: String,
    /// What is varied.
    pub varied: String,
    /// The scene.
    pub scene: Scene,
    /// Object-space positions.
    pub positions: Vec<[f32; 3]>,
}

/// A scene with every number of a label set to a value, and how many there are; None without one.
pub(super) fn with(scene: &Scene, label: &str, value: f32) -> Result<Option<(Scene, usize)>> {
    let names: Vec<String> =
        scene.settable_numbers().into_iter().filter(|(_, own)| own == label).map(|(name, _)| name).collect();
    if names.is_empty() {
        return Ok(None);
    }
    let mut scene = scene.clone();
    for socket in scene.graph_mut().groups.iter_mut().flat_map(|group| &mut group.inputs) {
        (socket.min, socket.max) = (None, None);
    }
    for name in &names {
        scene.set(&format!("{name}={value}"))?;
    }
    Ok(Some((scene, names.len())))
}

/// All cases of a scene.
pub fn cases(scene: &Scene) -> Result<Vec<Case>> {
    let program = Program::density(scene)?;
    let inside = |scene: &Scene| domain::points(Domain::Box, scene, &program, POINTS, SEED);
    let mut cases = vec![
        Case {
            name: "box".into(),
            varied: "places in the box: nothing extreme".into(),
            scene: scene.clone(),
            positions: inside(scene)?,
        },
        Case {
            name: "adversarial".into(),
            varied: "cell corners, edges of remaps, zeros of both signs, denormal and huge coordinates".into(),
            scene: scene.clone(),
            positions: domain::points(Domain::Adversarial, scene, &program, POINTS, SEED)?,
        },
    ];
    for exponent in [3, 6] {
        let most = 10_f32.powi(exponent);
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        cases.push(Case {
            name: format!("coordinates-1e{exponent}"),
            varied: format!("object-space coordinates from -1e{exponent} to 1e{exponent}"),
            scene: scene.clone(),
            positions: (0..POINTS)
                .map(|_| std::array::from_fn(|_| most * (2.0 * random.random::<f32>() - 1.0)))
                .collect(),
        });
    }
    for &(label, values) in EXTREMES {
        for &value in values {
            let Some((changed, count)) = with(scene, label, value)? else { continue };
            cases.push(Case {
                name: format!("{}={value:e}", label.to_lowercase().replace(' ', "-")),
                varied: format!("{label} {value:e} ({count} of the material's numbers), places in the box"),
                positions: inside(scene)?,
                scene: changed,
            });
        }
    }
    Ok(cases)
}

/// The rows of a case; that of WGSL where there is an adapter.
pub(super) fn rows(case: &Case, gpu: Option<&Gpu>) -> Result<Vec<Judgement>> {
    let program = Program::density(&case.scene)?;
    let bounds = bounds(&program, &case.positions)?;
    let scale = bounds.iter().map(|bound| bound.truth.abs()).fold(1.0, f64::max);
    let points = Points::new(&case.positions);
    let single: Vec<f64> = program.evaluate(points, Arithmetic::Single)?;
    let mut rows = vec![head(case, Evaluator::Cpu).judge(scale, &single, &bounds)];
    if let Some(gpu) = gpu {
        let (values, _) = evaluators::evaluate(&program, points, Evaluator::Gpu, Some(gpu))?;
        let values: Vec<f64> = values.into_iter().map(f64::from).collect();
        rows.push(head(case, Evaluator::Gpu).judge(scale, &values, &bounds));
    }
    Ok(rows)
}

/// The f64 values, and how far f32 may be from them.
fn bounds(program: &Program, positions: &[[f32; 3]]) -> Result<Vec<Bound>> {
    let points = Points::new(positions);
    let truths = program.evaluate(points, Arithmetic::Oracle)?;
    let mut bounds: Vec<Bound> = truths
        .into_iter()
        .zip(program.rounding_bounds(points)?)
        .map(|(truth, distance)| Bound { truth, distance })
        .collect();
    let unknown: Vec<usize> = (0..bounds.len()).filter(|&index| !bounds[index].distance.is_finite()).collect();
    let boxes: Vec<Bounds3> =
        unknown.iter().map(|&index| Bounds3 { low: positions[index], high: positions[index] }).collect();
    for (&index, enclosure) in unknown.iter().zip(program.bounds_many(&boxes)?) {
        if !enclosure.may_be_nan {
            bounds[index].distance = f64::from(enclosure.high) - f64::from(enclosure.low);
        }
    }
    Ok(bounds)
}

fn head(case: &Case, evaluator: Evaluator) -> Head {
    let (mark, words) = match evaluator {
        Evaluator::Gpu => ("wgsl", "WGSL against the f64 oracle"),
        _ => ("cpu", "f32 on the CPU against the f64 oracle"),
    };
    Head {
        id: format!("field-{}/{mark}", case.name),
        subject: Subject::Field,
        varied: case.varied.clone(),
        evaluator: words.into(),
        limit: evaluators::GPU_LIMIT,
        reason: "limit: what the kernels of Cycles differ by among themselves; bound: running error analysis of every \
                 operation at the point, or the width of its enclosure where that is infinite"
            .into(),
        guards: vec!["safe-division", "safe-power", "negative-density"],
        cycles: match evaluator {
            Evaluator::Gpu => "within the limit or bound of the CPU, which is Cycles' own f32".into(),
            _ => "yes by design: the bits of Cycles' SSE4.2 kernel; asking Cycles measures it".into(),
        },
    }
}

/// Asks live Cycles for the values of the CPU's rows and writes into each how many are equal.
pub fn ask_cycles(scene: &Scene, rows: &mut [Judgement], receive: impl FnMut(crate::bridge::Message)) -> Result<()> {
    let cases = cases(scene)?;
    let requests = cases
        .iter()
        .map(|case| {
            Ok(evaluators::Request {
                scene: &case.scene,
                target: crate::graph::target::density(&case.scene)?,
                positions: &case.positions,
                evaluators: &[Evaluator::Cpu],
                rounding_bound: false,
            })
        })
        .collect::<Result<Vec<_>>>()?;
    let (found, reference) = evaluators::compare(&requests, receive)?;
    for (case, comparisons) in cases.iter().zip(found) {
        let id = head(case, Evaluator::Cpu).id;
        let Some(row) = rows.iter_mut().find(|row| row.id == id) else { continue };
        for figures in evaluators::figures(comparisons).into_values() {
            let equal = figures.points - figures.differing;
            row.cycles = format!("measured: {equal} of {} values equal Cycles {}'s", figures.points, reference.blender);
        }
    }
    Ok(())
}
