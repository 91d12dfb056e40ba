//! The node on SIMD lanes, one point per lane; the same bits as the scalar evaluation, which the sums of the
//! octaves follow operation by operation. What is searched in each octave is in [`cells`] and, for one
//! dimension, in [`line`].

mod cells;
mod distances;
mod line;

use crate::base::arrays::each;
use crate::nodes::lanes;
use crate::nodes::voronoi_texture::{Feature, Hashing, Metric, Parameters, VoronoiTexture};
use crate::nodes::{Column, Evaluate, Real, columns_at, lane_level};
use fearless_simd::{dispatch, prelude::*};

/// Cells beyond this magnitude are left to the scalar evaluation, which knows what x86 does there.
const LARGEST_COORDINATE: f32 = 1.0e9;

/// The same where cells are hashed as floats: beyond 2^24 the sum of a corner and two steps depends on their order.
const LARGEST_FLOAT_COORDINATE: f32 = 1.0e7;

/// Exponents of Minkowski's metric for which bounds on powers and roots are derived. Others are left to the scalar evaluation.
const EXPONENTS: std::ops::RangeInclusive<f32> = 0.05..=64.0;

/// Evaluates if this mode and these inputs have a lane version: parameters equal at all points and
/// finite, the exponent of Minkowski's metric in [`EXPONENTS`].
pub(super) fn evaluate(node: &VoronoiTexture, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) -> bool {
    let Some(plan) = Plan::new(node, inputs) else { return false };
    let level = lane_level();
    let mut redone = Vec::new();
    match node.dimensions {
        1 => dispatch!(level, simd => run::<_, 1>(simd, &plan, inputs, outputs, &mut redone)),
        2 => dispatch!(level, simd => run::<_, 2>(simd, &plan, inputs, outputs, &mut redone)),
        3 => dispatch!(level, simd => run::<_, 3>(simd, &plan, inputs, outputs, &mut redone)),
        _ => dispatch!(level, simd => run::<_, 4>(simd, &plan, inputs, outputs, &mut redone)),
    }
    let limit = match node.hashing {
        Hashing::WholeNumbers => LARGEST_COORDINATE,
        Hashing::Floats => LARGEST_FLOAT_COORDINATE,
    };
    let coordinates = &inputs[..node.dimensions];
    let near = |value: f32| (value * plan.largest_factor).abs() < limit;
    // Without a branch per point, since hardly any is that far.
    if !coordinates.iter().all(|column| column.values.iter().fold(true, |all, &value| all & near(value))) {
        redone.extend(
            (0..outputs[0].len()).filter(|&index| !coordinates.iter().all(|column| near(column.values[index]))),
        );
    }
    for index in redone {
        let mut point: Vec<&mut [f32]> = outputs.iter_mut().map(|output| &mut output[index..=index]).collect();
        node.evaluate(&columns_at(inputs, index), &mut point);
    }
    true
}

/// A metric with its exponent, which only Minkowski's has.
#[derive(Clone, Copy)]
struct Measure {
    metric: Metric,
    exponent: f32,
}

impl Measure {
    const EUCLIDEAN: Self = Self { metric: Metric::Euclidean, exponent: 2.0 };
}

/// What is equal in all searches.
#[derive(Clone, Copy)]
struct Search {
    measure: Measure,
    hashing: Hashing,
    randomness: f32,
    smoothness: f32,
    /// Whether the colour is wanted.
    color: bool,
    /// Whether the position is wanted.
    position: bool,
}

/// Result of a search. What is not wanted has no meaning.
struct Found<S: Simd, const N: usize> {
    distance: S::f32s,
    color: [S::f32s; 3],
    position: [S::f32s; N],
}

impl<S: Simd, const N: usize> Found<S, N> {
    #[inline(always)]
    fn of_distance(simd: S, distance: S::f32s) -> Self {
        let zero = S::f32s::splat(simd, 0.0);
        Self { distance, color: [zero; 3], position: [zero; N] }
    }
}

/// One octave: factor on the scaled coordinate, and how what is found joins the sum.
struct Octave {
    scale: f32,
    amplitude: f32,
    /// Blend factor of the fractional last octave, none for whole ones.
    rest: Option<f32>,
}

impl Octave {
    /// The octaves of a fractal; a single one where the kernel takes the first as it is.
    fn all(parameters: &Parameters<f32>, single: bool) -> Vec<Self> {
        let (mut amplitude, mut scale) = (1.0_f32, 1.0_f32);
        if single {
            return vec![Self { scale, amplitude, rest: None }];
        }
        let mut octaves = Vec::new();
        for _ in 0..=parameters.detail.floor() as i32 {
            octaves.push(Self { scale, amplitude, rest: None });
            scale *= parameters.lacunarity;
            amplitude *= parameters.roughness;
        }
        let rest = parameters.detail - parameters.detail.floor();
        if rest != 0.0 {
            octaves.push(Self { scale, amplitude, rest: Some(rest) });
        }
        octaves
    }
}

/// Sum over the octaves that starts with `start`, each octave giving the next from the last.
fn folded(octaves: &[Octave], start: f32, next: impl Fn(f32, &Octave) -> f32) -> f32 {
    octaves.iter().fold(start, |sum, octave| match octave.rest {
        None => next(sum, octave),
        Some(rest) => Real::lerp(sum, next(sum, octave), rest),
    })
}

/// What is equal at all points.
struct Plan {
    feature: Feature,
    search: Search,
    distance: bool,
    /// Whether the position is an output, not only its last component.
    position: bool,
    w: bool,
    scale: f32,
    octaves: Vec<Octave>,
    /// The single octave counts as it is, without amplitude.
    single: bool,
    /// Divisor of the normalised distance.
    distance_divisor: Option<f32>,
    /// Factor on the normalised colour.
    color_factor: Option<f32>,
    /// Factor on the position, none where it is zero.
    position_factor: Option<f32>,
    /// Third component of a 2D position.
    third: f32,
    /// Largest factor on an input coordinate, for the range check.
    largest_factor: f32,
    /// Scaled coordinates below this magnitude, which an octave may turn into -0, are left to the scalar evaluation; 0 where it hashes
    /// -0 as 0.
    smallest: f32,
}

impl Plan {
    fn new(node: &VoronoiTexture, inputs: &[Column<'_, f32>]) -> Option<Self> {
        let mut columns = node.parameter_columns().into_iter().flatten();
        if !columns.all(|column| inputs[column].uniform) {
            return None;
        }
        let parameters = node.parameters(inputs, 0);
        if !parameters.scale.is_finite() || !parameters.lacunarity.is_finite() {
            return None;
        }
        if node.has_exponent && !EXPONENTS.contains(&parameters.exponent) {
            return None;
        }
        let single = parameters.detail == 0.0 || parameters.roughness == 0.0;
        let octaves = Octave::all(&parameters, single);
        let total = if single { 1.0 } else { folded(&octaves, 0.0, |sum, octave| sum + octave.amplitude) };
        let third = |sum: f32, octave: &Octave| Real::lerp(sum, 0.0 * (1.0 / octave.scale), octave.amplitude);
        let third = if single { 0.0 } else { folded(&octaves, 0.0, third) };
        let position_factor = (parameters.scale != 0.0).then(|| 1.0 / parameters.scale);
        let largest_scale = octaves.iter().map(|octave| octave.scale.abs()).fold(1.0, f32::max);
        Some(Self {
            feature: match node.feature {
                Feature::SmoothF1 if parameters.smoothness == 0.0 => Feature::F1,
                feature => feature,
            },
            search: Search {
                // The exponent of a mode that has none is not read.
                measure: Measure { metric: node.metric, exponent: parameters.exponent },
                randomness: parameters.randomness,
                smoothness: parameters.smoothness,
                hashing: node.hashing,
                color: node.color,
                position: node.position || node.w,
            },
            distance: node.distance,
            position: node.position,
            w: node.w,
            scale: parameters.scale,
            single,
            distance_divisor: node.normalize.then(|| match node.feature {
                Feature::DistanceToEdge => largest_edge(&parameters, &octaves, single),
                _ => total * largest_distance(node, &parameters),
            }),
            color_factor: node.normalize.then(|| 1.0 / total),
            position_factor,
            third: position_factor.map_or(0.0, |factor| third * factor),
            largest_factor: parameters.scale.abs() * largest_scale,
            smallest: if node.hashes_negative_zero {
                1e-30 / octaves.iter().map(|octave| octave.scale.abs()).fold(1.0, f32::min)
            } else {
                0.0
            },
            octaves,
        })
    }
}

fn largest_distance(node: &VoronoiTexture, parameters: &Parameters<f32>) -> f32 {
    match node.dimensions {
        1 => node.largest_distance::<f32, 1>(parameters),
        2 => node.largest_distance::<f32, 2>(parameters),
        3 => node.largest_distance::<f32, 3>(parameters),
        _ => node.largest_distance::<f32, 4>(parameters),
    }
}

/// Divisor of the normalised distance to edge.
fn largest_edge(parameters: &Parameters<f32>, octaves: &[Octave], single: bool) -> f32 {
    let largest = 0.5 + 0.5 * parameters.randomness;
    if single {
        return largest;
    }
    folded(octaves, largest, |maximum, octave| Real::lerp(maximum, largest / octave.scale, octave.amplitude))
}

#[inline(always)]
fn run<S: Simd, const N: usize>(
    simd: S,
    plan: &Plan,
    inputs: &[Column<'_, f32>],
    outputs: &mut [&mut [f32]],
    redone: &mut Vec<usize>,
) {
    simd.vectorize(
        #[inline(always)]
        || run_vectorized::<S, N>(simd, plan, inputs, outputs, redone),
    );
}

/// Evaluates all points; `redone` receives those that the scalar evaluation must do again.
#[inline(always)]
fn run_vectorized<S: Simd, const N: usize>(
    simd: S,
    plan: &Plan,
    inputs: &[Column<'_, f32>],
    outputs: &mut [&mut [f32]],
    redone: &mut Vec<usize>,
) {
    if N >= 3 && plan.feature == Feature::F1 && !plan.search.color && !plan.search.position {
        return distances::run::<S, N>(simd, plan, inputs, outputs);
    }
    let width = S::f32s::LEN;
    let count = outputs[0].len();
    for start in (0..count).step_by(width) {
        let used = width.min(count - start);
        let q: [S::f32s; N] = each(
            #[inline(always)]
            |axis| lanes::load::<S>(simd, &inputs[axis].values[start..start + used]) * plan.scale,
        );
        let mut sink = Sink { outputs: &mut *outputs, start, used };
        match plan.feature {
            Feature::DistanceToEdge => {
                let (edge, is_doubtful) = fractal_edge::<S, N>(simd, plan, q);
                sink.put::<S>(edge);
                redone.extend(lanes::marked::<S>(is_doubtful, true, used).map(|lane| start + lane));
            }
            Feature::NSphereRadius => sink.put::<S>(n_sphere_radius::<S, N>(simd, plan, q)),
            _ => {
                sink.put_found(simd, plan, &fractal::<S, N>(simd, plan, q));
                if plan.smallest > 0.0 {
                    let is_small = q[0].abs().simd_lt(plan.smallest);
                    redone.extend(lanes::marked::<S>(is_small, true, used).map(|lane| start + lane));
                }
            }
        }
    }
}

/// Where the values of one group of points go.
struct Sink<'a, 'b> {
    /// The components that are still to come.
    outputs: &'a mut [&'b mut [f32]],
    start: usize,
    used: usize,
}

impl Sink<'_, '_> {
    /// Stores the next component.
    #[inline(always)]
    fn put<S: Simd>(&mut self, value: S::f32s) {
        let (output, rest) = std::mem::take(&mut self.outputs).split_first_mut().expect("an output for each component");
        lanes::store::<S>(value, &mut output[self.start..self.start + self.used]);
        self.outputs = rest;
    }

    /// Stores the wanted outputs' components, in socket order.
    #[inline(always)]
    fn put_found<S: Simd, const N: usize>(&mut self, simd: S, plan: &Plan, found: &Found<S, N>) {
        if plan.distance {
            self.put::<S>(found.distance);
        }
        if plan.search.color {
            for channel in found.color {
                self.put::<S>(channel);
            }
        }
        if plan.position {
            for axis in 0..3 {
                self.put::<S>(if axis < N { found.position[axis] } else { S::f32s::splat(simd, plan.third) });
            }
        }
        if plan.w {
            self.put::<S>(found.position[N - 1]);
        }
    }
}

/// `sum + t*(next - sum)`.
#[inline(always)]
fn lerp<S: Simd>(sum: S::f32s, next: S::f32s, t: f32) -> S::f32s {
    sum + (next - sum) * t
}

/// `next`, in the fractional octave blended with `sum`.
#[inline(always)]
fn blended<S: Simd>(sum: S::f32s, next: S::f32s, octave: &Octave) -> S::f32s {
    match octave.rest {
        None => next,
        Some(rest) => lerp::<S>(sum, next, rest),
    }
}

/// F1, F2 or smooth F1 of one octave.
#[inline(always)]
fn feature<S: Simd, const N: usize>(simd: S, plan: &Plan, x: [S::f32s; N]) -> Found<S, N> {
    match (N, plan.feature) {
        (1, Feature::F2) => line::f2(simd, x[0], plan.search),
        (1, Feature::SmoothF1) => line::smooth_f1(simd, x[0], plan.search),
        (1, _) => line::f1(simd, x[0], plan.search),
        (_, Feature::F2) => cells::f2(simd, x, plan.search),
        (_, Feature::SmoothF1) => cells::smooth_f1(simd, x, plan.search),
        _ => cells::f1(simd, x, plan.search),
    }
}

/// The fractal sum of F1, F2 or smooth F1.
#[inline(always)]
fn fractal<S: Simd, const N: usize>(simd: S, plan: &Plan, q: [S::f32s; N]) -> Found<S, N> {
    let mut sum = Found::of_distance(simd, S::f32s::splat(simd, 0.0));
    for octave in &plan.octaves {
        let found = feature::<S, N>(simd, plan, each(|axis| q[axis] * octave.scale));
        if plan.single {
            sum = found;
            break;
        }
        add(plan.search, &mut sum, &found, octave);
    }
    if let Some(divisor) = plan.distance_divisor {
        sum.distance /= divisor;
    }
    if let Some(factor) = plan.color_factor {
        sum.color = each(|channel| sum.color[channel] * factor);
    }
    sum.position = match plan.position_factor {
        Some(factor) => each(|axis| sum.position[axis] * factor),
        None => [S::f32s::splat(simd, 0.0); N],
    };
    sum
}

/// Adds an octave.
#[inline(always)]
fn add<S: Simd, const N: usize>(search: Search, sum: &mut Found<S, N>, found: &Found<S, N>, octave: &Octave) {
    let amplitude = octave.amplitude;
    sum.distance = blended::<S>(sum.distance, sum.distance + found.distance * amplitude, octave);
    if search.color {
        for channel in 0..3 {
            let next = sum.color[channel] + found.color[channel] * amplitude;
            sum.color[channel] = blended::<S>(sum.color[channel], next, octave);
        }
    }
    if search.position {
        let inverse = 1.0 / octave.scale;
        for axis in 0..N {
            let next = lerp::<S>(sum.position[axis], found.position[axis] * inverse, amplitude);
            sum.position[axis] = blended::<S>(sum.position[axis], next, octave);
        }
    }
}

/// The fractal of the distance to edge, and where the sign of a zero may differ from the scalar evaluation's.
#[inline(always)]
fn fractal_edge<S: Simd, const N: usize>(simd: S, plan: &Plan, q: [S::f32s; N]) -> (S::f32s, S::mask32s) {
    let lesser = |a: S::f32s, b: S::f32s| a.simd_lt(b).select(a, b);
    let mut distance = S::f32s::splat(simd, 8.0);
    let mut is_doubtful = S::mask32s::splat(simd, false);
    for octave in &plan.octaves {
        let x: [S::f32s; N] = each(|axis| q[axis] * octave.scale);
        let found = if N == 1 { line::edge(simd, x[0], plan.search) } else { cells::edge(simd, x, plan.search) };
        is_doubtful |= found.simd_eq(0.0);
        if plan.single {
            distance = found;
            break;
        }
        let next = lerp::<S>(distance, lesser(distance, found / octave.scale), octave.amplitude);
        distance = match octave.rest {
            None => next,
            Some(rest) => lerp::<S>(distance, lesser(distance, next), rest),
        };
    }
    (if let Some(divisor) = plan.distance_divisor { distance / divisor } else { distance }, is_doubtful)
}

#[inline(always)]
fn n_sphere_radius<S: Simd, const N: usize>(simd: S, plan: &Plan, x: [S::f32s; N]) -> S::f32s {
    if N == 1 { line::n_sphere_radius(simd, x[0], plan.search) } else { cells::n_sphere_radius(simd, x, plan.search) }
}

#[cfg(test)]
mod tests {
    use super::{Feature, Hashing, Metric, VoronoiTexture, evaluate};
    use crate::nodes::lane_tests::adversarial_coordinates;
    use crate::nodes::{Column, Evaluate as _};

    const METRICS: [Metric; 4] = [Metric::Euclidean, Metric::Manhattan, Metric::Chebychev, Metric::Minkowski];

    /// Of Minkowski's metric, the ends of what has lanes among them.
    const SAMPLE_EXPONENTS: [f32; 7] = [0.5, 2.0, 0.05, 1.0, 64.0, 3.7, 0.2];

    /// Scale, detail, roughness, lacunarity, smoothness, randomness.
    const PARAMETERS: [[f32; 6]; 8] = [
        [5.0, 0.0, 0.5, 2.0, 1.0, 1.0],
        [-2.0, 4.0, 0.75, 2.5, 0.3, 1.0],
        [0.3, 2.4, 1.0, 3.0, 0.0, 0.6],
        [7.0, 0.25, 0.5, -1.5, 1.0, 0.0],
        [1.0, 0.0, 0.5, 2.0, 0.3, 0.0],
        [0.0, 1.5, 0.5, 2.0, 1e-38, 1.0],
        [-0.5, 2.0, 0.5, 0.0, f32::NAN, f32::NAN],
        [3.0, f32::NAN, f32::INFINITY, -2.0, 1e-12, f32::INFINITY],
    ];

    /// Asserts that the lanes evaluate this mode, and that every bit agrees with the scalar evaluation.
    fn assert_lanes_equal_scalar(
        node: &VoronoiTexture,
        [scale, detail, roughness, lacunarity, smoothness, randomness]: [f32; 6],
        exponent: f32,
        coordinates: &[[f32; 4]],
    ) {
        let parameters = [scale, detail, roughness, lacunarity, smoothness, exponent, randomness];
        let count = coordinates.len();
        let [coordinate_columns, components] = columns_and_components(node);
        let exists = [
            true,
            is_fractal(node),
            is_fractal(node),
            is_fractal(node),
            node.feature == Feature::SmoothF1,
            node.has_exponent,
            true,
        ];
        let values: Vec<Vec<f32>> = (0..coordinate_columns)
            .map(|axis| coordinates.iter().map(|row| row[axis]).collect())
            .chain(parameters.iter().zip(exists).filter(|(_, exists)| *exists).map(|(&value, _)| vec![value; count]))
            .collect();
        let columns: Vec<Column<'_, f32>> = values
            .iter()
            .enumerate()
            .map(|(index, values)| Column { values, uniform: index >= coordinate_columns })
            .collect();
        let [mut lanes, mut scalar] = [(); 2].map(|()| vec![vec![0.0_f32; count]; components]);
        let mut slices: Vec<&mut [f32]> = lanes.iter_mut().map(Vec::as_mut_slice).collect();
        assert!(evaluate(node, &columns, &mut slices), "no lane version");
        let mut slices: Vec<&mut [f32]> = scalar.iter_mut().map(Vec::as_mut_slice).collect();
        node.evaluate(&columns, &mut slices);
        for component in 0..components {
            for index in 0..count {
                let (found, expected) = (lanes[component][index], scalar[component][index]);
                assert!(
                    found.to_bits() == expected.to_bits() || (found.is_nan() && expected.is_nan()),
                    "{}D {:?} {:?} {parameters:?}, component {component} at {:?}: lanes {found:?}, scalar {expected:?}",
                    node.dimensions,
                    node.feature,
                    node.metric,
                    coordinates[index]
                );
            }
        }
    }

    fn is_fractal(node: &VoronoiTexture) -> bool {
        node.feature != Feature::NSphereRadius
    }

    /// Number of coordinate columns, of which 2D reads two out of three, and of output components.
    fn columns_and_components(node: &VoronoiTexture) -> [usize; 2] {
        let columns = match node.dimensions {
            1 => 1,
            4 => 4,
            _ => 3,
        };
        let color = 3 * usize::from(node.color);
        let position = 3 * usize::from(node.position);
        let distance = usize::from(node.distance || !is_fractal(node));
        [columns, distance + color + position + usize::from(node.w)]
    }

    /// Distance, colour, position, W: every subset that the dimensions have.
    fn wanted_subsets(dimensions: usize, has_color: bool) -> Vec<[bool; 4]> {
        let subsets = (1..16).map(|bits: u32| [0, 1, 2, 3].map(|bit| bits >> bit & 1 != 0));
        let legal = |&[distance, color, position, w]: &[bool; 4]| {
            let only_distance = distance && !color && !position && !w;
            (has_color || only_distance) && !(position && dimensions == 1) && !(w && matches!(dimensions, 2 | 3))
        };
        subsets.filter(legal).collect()
    }

    #[test]
    fn every_mode_equals_the_scalar_evaluation() {
        for dimensions in 1..=4 {
            // Smooth F1 searches 5^n cells.
            let coordinates = adversarial_coordinates([1024, 512, 256, 64][dimensions - 1]);
            for feature in
                [Feature::F1, Feature::F2, Feature::SmoothF1, Feature::DistanceToEdge, Feature::NSphereRadius]
            {
                let has_color = matches!(feature, Feature::F1 | Feature::F2 | Feature::SmoothF1);
                let metrics = if has_color && dimensions > 1 { &METRICS[..] } else { &[Metric::Minkowski] };
                for &metric in metrics {
                    for (number, [distance, color, position, w]) in
                        wanted_subsets(dimensions, has_color).into_iter().enumerate()
                    {
                        for (set, parameters) in PARAMETERS.into_iter().enumerate() {
                            let normalize = (number + set) % 2 == 0;
                            let node = VoronoiTexture {
                                dimensions,
                                hashing: [Hashing::WholeNumbers, Hashing::Floats][(number + set / 2) % 2],
                                hashes_negative_zero: dimensions == 1 && set % 2 == 1,
                                metric,
                                feature,
                                normalize,
                                has_exponent: has_color && dimensions > 1 && metric == Metric::Minkowski,
                                distance,
                                color,
                                position,
                                w,
                            };
                            let exponent = SAMPLE_EXPONENTS[(number + 3 * set) % SAMPLE_EXPONENTS.len()];
                            assert_lanes_equal_scalar(&node, parameters, exponent, &coordinates);
                        }
                    }
                }
            }
        }
    }
}
