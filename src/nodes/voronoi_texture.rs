//! Voronoi Texture (`ShaderNodeTexVoronoi`): cellular noise in 1 to 4 dimensions (Worley 1996), as
//! a fractal of octaves.
//!
//! Features F1, F2, smooth F1 (polynomial smooth minimum over the 5^n neighbourhood), distance to
//! edge and n-sphere radius; metrics Euclidean, Manhattan, Chebychev, Minkowski. Each cell holds
//! one point at a hashed position. Only cells within one step are searched, so a distance above 1
//! may miss a nearer point and the field can jump at cell faces: Blender's field does so too.
//!
//! Up to Blender 4.5 a cell of 2 to 4 dimensions had other numbers than since 5.0 (`Hashing`).
//!
//! Coordinates are `Vector * Scale`, `W * Scale`; octaves multiply the rounded coordinate.

mod bounds;
mod lanes;

use crate::base::arrays::{Mapped, each};
use crate::nodes::hash::{hash_floats, pcg_values};
use crate::nodes::noise_texture::dimensions;
use crate::nodes::real::{Real, dot, length};
use crate::nodes::white_noise_texture;
use crate::nodes::{Column, Evaluate, InputSocket, Interval, Mode, NodeType, OutputSocket, Property, Role, always};
use crate::scene::{Release, SocketType};

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeTexVoronoi",
    label: "Voronoi Texture",
    module: "voronoi_texture",
    shader: include_str!("../../shaders/nodes/voronoi_texture.wgsl"),
    properties: &[
        Property::choice("voronoi_dimensions", &["3D", "1D", "2D", "4D"]),
        Property::choice("distance", &["EUCLIDEAN", "MANHATTAN", "CHEBYCHEV", "MINKOWSKI"]),
        Property::choice("feature", &["F1", "F2", "SMOOTH_F1", "DISTANCE_TO_EDGE", "N_SPHERE_RADIUS"]),
        Property::flag("normalize", false),
        Property::other("texture_mapping"),
    ],
    inputs: &[
        InputSocket::coordinate(|mode| mode.choice("voronoi_dimensions") != "1D"),
        InputSocket::float("W", "W", &[0.0], has_w),
        InputSocket::float("Scale", "Scale", &[5.0], always),
        InputSocket::float("Detail", "Detail", &[0.0], is_fractal),
        InputSocket::float("Roughness", "Roughness", &[0.5], is_fractal),
        InputSocket::float("Lacunarity", "Lacunarity", &[2.0], is_fractal),
        InputSocket::float("Smoothness", "Smoothness", &[1.0], |mode| mode.choice("feature") == "SMOOTH_F1"),
        InputSocket::float("Exponent", "Exponent", &[0.5], has_exponent),
        InputSocket::float("Randomness", "Randomness", &[1.0], always),
    ],
    outputs: &[
        OutputSocket::new("Distance", SocketType::Float, is_fractal),
        OutputSocket::new("Color", SocketType::Color, has_color),
        OutputSocket::new("Position", SocketType::Vector, |mode| {
            has_color(mode) && mode.choice("voronoi_dimensions") != "1D"
        }),
        OutputSocket::new("W", SocketType::Float, |mode| has_color(mode) && has_w(mode)),
        OutputSocket::new("Radius", SocketType::Float, |mode| !is_fractal(mode)),
    ],
    role: Role::Evaluated(|mode| {
        Box::new(VoronoiTexture {
            dimensions: dimensions(mode.choice("voronoi_dimensions")),
            metric: Metric::read(mode.choice("distance")),
            feature: Feature::read(mode.choice("feature")),
            hashing: Hashing::of(mode.release()),
            hashes_negative_zero: mode.release() >= Release::V5_3 && mode.choice("voronoi_dimensions") == "1D",
            normalize: mode.flag("normalize"),
            has_exponent: has_exponent(mode),
            distance: mode.wants("Distance"),
            color: mode.wants("Color"),
            position: mode.wants("Position"),
            w: mode.wants("W"),
        })
    }),
};

fn has_w(mode: &Mode) -> bool {
    matches!(mode.choice("voronoi_dimensions"), "1D" | "4D")
}

fn is_fractal(mode: &Mode) -> bool {
    mode.choice("feature") != "N_SPHERE_RADIUS"
}

fn has_color(mode: &Mode) -> bool {
    matches!(mode.choice("feature"), "F1" | "F2" | "SMOOTH_F1")
}

fn has_exponent(mode: &Mode) -> bool {
    has_color(mode) && mode.choice("distance") == "MINKOWSKI" && mode.choice("voronoi_dimensions") != "1D"
}

/// Distance between a point and a cell's point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Metric {
    Euclidean,
    Manhattan,
    Chebychev,
    Minkowski,
}

impl Metric {
    fn read(name: &str) -> Self {
        match name {
            "EUCLIDEAN" => Self::Euclidean,
            "MANHATTAN" => Self::Manhattan,
            "CHEBYCHEV" => Self::Chebychev,
            _ => Self::Minkowski,
        }
    }

    /// Distance of the offset `v`.
    fn distance<R: Real, const N: usize>(self, v: [R; N], exponent: R) -> R {
        if N == 1 {
            return v[0].abs();
        }
        match self {
            Self::Euclidean => length(v),
            Self::Minkowski => self.compared(v, exponent).powf(R::of(1.0) / exponent),
            _ => self.compared(v, exponent),
        }
    }

    /// A quantity that orders offsets as the distance does: without the root.
    fn compared<R: Real, const N: usize>(self, v: [R; N], exponent: R) -> R {
        if N == 1 {
            return v[0].abs();
        }
        match self {
            Self::Euclidean => dot(v, v),
            Self::Manhattan => sum(v.mapped(Real::abs)),
            Self::Chebychev => {
                let v = v.mapped(Real::abs);
                // The order decides what a NaN does: 4-vectors are compared backwards, in pairs.
                match N {
                    2 => v[0].greater(v[1]),
                    3 => v[0].greater(v[1]).greater(v[2]),
                    _ => v[3].greater(v[2]).greater(v[1].greater(v[0])),
                }
            }
            Self::Minkowski => sum(v.mapped(|x| x.abs().powf(exponent))),
        }
    }
}

/// Sum in the kernel's association.
fn sum<R: Real, const N: usize>(v: [R; N]) -> R {
    match N {
        1 => v[0],
        2 => v[0] + v[1],
        3 => (v[0] + v[1]) + v[2],
        _ => (v[0] + v[1]) + (v[2] + v[3]),
    }
}

/// What is measured in each octave.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Feature {
    F1,
    F2,
    SmoothF1,
    DistanceToEdge,
    NSphereRadius,
}

impl Feature {
    fn read(name: &str) -> Self {
        match name {
            "F1" => Self::F1,
            "F2" => Self::F2,
            "SMOOTH_F1" => Self::SmoothF1,
            "DISTANCE_TO_EDGE" => Self::DistanceToEdge,
            _ => Self::NSphereRadius,
        }
    }
}

/// What the random numbers of a cell in 2 to 4 dimensions are the hash of. In one dimension it is the corner as a float.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Hashing {
    /// Since Blender 5.0: whole numbers.
    WholeNumbers,
    /// Up to 4.5: the corner as floats; the colour is that of White Noise Texture there.
    Floats,
}

impl Hashing {
    fn of(release: Release) -> Self {
        match release {
            Release::V4_5 => Self::Floats,
            _ => Self::WholeNumbers,
        }
    }
}

/// The node in one mode.
pub(super) struct VoronoiTexture {
    dimensions: usize,
    hashing: Hashing,
    /// Since Blender 5.3 the searches for the nearest and the second nearest point of one dimension hash the middle cell's own corner,
    /// so that at the coordinate -0 the cell has another point than at 0. Its colour is that at 0.
    hashes_negative_zero: bool,
    metric: Metric,
    feature: Feature,
    normalize: bool,
    has_exponent: bool,
    distance: bool,
    color: bool,
    position: bool,
    w: bool,
}

/// Parameters of one point, clamped as the kernel does.
#[derive(Clone, Copy)]
struct Parameters<R> {
    scale: R,
    detail: R,
    roughness: R,
    lacunarity: R,
    smoothness: R,
    exponent: R,
    randomness: R,
}

/// Result of a feature.
#[derive(Clone, Copy)]
struct Found<R, const N: usize> {
    distance: R,
    color: [R; 3],
    position: [R; N],
    /// Third component of a 2D position: 0, but NaN where the octaves' scale underflows.
    third: R,
}

/// A coordinate taken apart: the cell that holds it and its place within.
#[derive(Clone, Copy)]
struct Cell<R, const N: usize> {
    hashing: Hashing,
    /// The middle cell's corner is hashed as it is.
    hashes_negative_zero: bool,
    floor: [R; N],
    index: [i32; N],
    local: [R; N],
}

impl<R: Real, const N: usize> Cell<R, N> {
    fn of(x: [R; N], hashing: Hashing) -> Self {
        let floor = x.mapped(Real::lattice_floor);
        Self {
            hashing,
            hashes_negative_zero: false,
            floor,
            index: floor.mapped(Real::to_int),
            local: each(|axis| (x[axis] - floor[axis]).round_coordinate()),
        }
    }

    /// Point of the cell at `offset`, relative to this cell's corner.
    fn point(&self, offset: [i32; N], randomness: R) -> [R; N] {
        let hash: [R; N] = if N == 1 && self.hashes_negative_zero && offset == [0; N] {
            cell_of_floats(self.floor)
        } else if N == 1 || self.hashing == Hashing::Floats {
            cell_of_floats(self.corner(offset))
        } else {
            pcg_values(each(|axis| self.index[axis].wrapping_add(offset[axis])))
        };
        each(|axis| R::of(offset[axis] as f32) + hash[axis] * randomness)
    }

    /// Corner of the cell at `offset`, which is never -0.
    fn corner(&self, offset: [i32; N]) -> [R; N] {
        each(|axis| self.floor[axis] + R::of(offset[axis] as f32))
    }

    /// [`Self::point`] relative to the coordinate.
    fn offset_to(&self, offset: [i32; N], randomness: R) -> [R; N] {
        let point = self.point(offset, randomness);
        each(|axis| point[axis] - self.local[axis])
    }

    /// Colour of the cell at `offset`.
    fn color(&self, offset: [i32; N]) -> [R; 3] {
        if N == 1 || self.hashing == Hashing::Floats {
            return color_of_floats(self.corner(offset));
        }
        let cell: [i32; N] = each(|axis| self.index[axis].wrapping_add(offset[axis]));
        match N {
            2 => pcg_values([cell[0], cell[1], 0]),
            3 => pcg_values([cell[0], cell[1], cell[2]]),
            _ => {
                let [x, y, z, _] = pcg_values([cell[0], cell[1], cell[2], cell[3]]);
                [x, y, z]
            }
        }
    }
}

/// Colour of a cell whose corner is known as floats: that of White Noise Texture there.
#[inline(always)]
fn color_of_floats<R: Real, const N: usize>(corner: [R; N]) -> [R; 3] {
    white_noise_texture::color(N, each(|axis| corner.get(axis).copied().unwrap_or(R::of(0.0))))
}

/// Values in [0, 1] of the point of a cell whose corner is known as floats: those of its colour, but in 4D hashes of the coordinates,
/// each time rotated by one more.
#[inline(always)]
fn cell_of_floats<R: Real, const N: usize>(corner: [R; N]) -> [R; N] {
    if N == 4 {
        return each(|turn| hash_floats::<R, 4>(each(|axis| corner[(axis + 4 - turn) % 4])));
    }
    let color = color_of_floats(corner);
    each(|axis| color[axis])
}

/// Offsets of the (2 radius + 1)^N cells around one, first axis fastest.
fn neighbours<const N: usize>(radius: i32) -> impl Iterator<Item = [i32; N]> {
    let side = 2 * radius + 1;
    (0..side.pow(N as u32)).map(move |mut index| {
        each(|_| {
            let offset = index % side - radius;
            index /= side;
            offset
        })
    })
}

impl VoronoiTexture {
    fn f1<R: Real, const N: usize>(&self, x: [R; N], parameters: &Parameters<R>) -> Found<R, N> {
        let cell = Cell { hashes_negative_zero: self.hashes_negative_zero, ..Cell::of(x, self.hashing) };
        let mut smallest = R::of(f32::MAX);
        let (mut nearest, mut target) = ([R::of(0.0); N], [0; N]);
        for offset in neighbours::<N>(1) {
            let point = cell.point(offset, parameters.randomness);
            let v: [R; N] = each(|axis| point[axis] - cell.local[axis]);
            let compared = self.metric.compared(v, parameters.exponent);
            if compared < smallest {
                (smallest, nearest, target) = (compared, point, offset);
            }
        }
        let v: [R; N] = each(|axis| nearest[axis] - cell.local[axis]);
        Found {
            // In one dimension the search keeps the distance itself, its start value where all are NaN.
            distance: if N == 1 { smallest } else { self.metric.distance(v, parameters.exponent) },
            color: cell.color(target),
            position: each(|axis| nearest[axis] + cell.floor[axis]),
            third: R::of(0.0),
        }
    }

    fn f2<R: Real, const N: usize>(&self, x: [R; N], parameters: &Parameters<R>) -> Found<R, N> {
        let cell = Cell { hashes_negative_zero: self.hashes_negative_zero, ..Cell::of(x, self.hashing) };
        let start = (R::of(f32::MAX), [R::of(0.0); N], [0; N]);
        let (mut first, mut second) = (start, start);
        for offset in neighbours::<N>(1) {
            let point = cell.point(offset, parameters.randomness);
            let v: [R; N] = each(|axis| point[axis] - cell.local[axis]);
            let distance = self.metric.distance(v, parameters.exponent);
            if distance < first.0 {
                second = first;
                first = (distance, point, offset);
            } else if distance < second.0 {
                second = (distance, point, offset);
            }
        }
        Found {
            distance: second.0,
            color: cell.color(second.2),
            position: each(|axis| second.1[axis] + cell.floor[axis]),
            third: R::of(0.0),
        }
    }

    fn smooth_f1<R: Real, const N: usize>(&self, x: [R; N], parameters: &Parameters<R>) -> Found<R, N> {
        let cell = Cell::of(x, self.hashing);
        let (half, one, smoothness) = (R::of(0.5), R::of(1.0), parameters.smoothness);
        let mut found =
            Found { distance: R::of(0.0), color: [R::of(0.0); 3], position: [R::of(0.0); N], third: R::of(0.0) };
        for (count, offset) in neighbours::<N>(2).enumerate() {
            let point = cell.point(offset, parameters.randomness);
            let v: [R; N] = each(|axis| point[axis] - cell.local[axis]);
            let distance = self.metric.distance(v, parameters.exponent);
            let h = if count == 0 {
                one
            } else {
                (half + (half * (found.distance - distance)) / smoothness).smooth_step(R::of(0.0), one)
            };
            let mut correction = (smoothness * h) * (one - h);
            found.distance = found.distance.lerp(distance, h) - correction;
            correction = correction / (one + R::of(3.0) * smoothness);
            let color = cell.color(offset);
            for channel in 0..3 {
                found.color[channel] = found.color[channel].lerp(color[channel], h) - correction;
            }
            for axis in 0..N {
                found.position[axis] = found.position[axis].lerp(point[axis], h) - correction;
            }
        }
        for axis in 0..N {
            found.position[axis] = found.position[axis] + cell.floor[axis];
        }
        found
    }

    fn edge<R: Real, const N: usize>(&self, x: [R; N], parameters: &Parameters<R>) -> R {
        let cell = Cell::of(x, self.hashing);
        let randomness = parameters.randomness;
        if N == 1 {
            // The middle cell hashes its own floor, sign of zero included.
            let point = |offset: i32| {
                let place = if offset == 0 { cell.floor[0] } else { cell.floor[0] + R::of(offset as f32) };
                R::of(offset as f32) + hash_floats::<R, 1>([place]) * randomness
            };
            let [left, middle, right] = [-1, 0, 1].mapped(point);
            let to = |other: R| ((middle + other) / R::of(2.0) - cell.local[0]).abs();
            return to(left).lesser(to(right));
        }
        let mut smallest = R::of(f32::MAX);
        let mut nearest = [R::of(0.0); N];
        for offset in neighbours::<N>(1) {
            let v = cell.offset_to(offset, randomness);
            let square = dot(v, v);
            if square < smallest {
                (smallest, nearest) = (square, v);
            }
        }
        let mut edge = R::of(f32::MAX);
        for offset in neighbours::<N>(1) {
            let v = cell.offset_to(offset, randomness);
            let across: [R; N] = each(|axis| v[axis] - nearest[axis]);
            if dot(across, across) > R::of(0.0001) {
                let norm = length(across);
                let direction = if N == 3 {
                    across.mapped(|x| x / norm)
                } else {
                    let inverse = R::of(1.0) / norm;
                    across.mapped(|x| x * inverse)
                };
                let middle: [R; N] = each(|axis| (nearest[axis] + v[axis]) * R::of(0.5));
                edge = edge.lesser(dot(middle, direction));
            }
        }
        edge
    }

    fn n_sphere_radius<R: Real, const N: usize>(&self, x: [R; N], parameters: &Parameters<R>) -> R {
        let cell = Cell::of(x, self.hashing);
        let nearest_of = |centre: [i32; N], to: [R; N], skip_centre: bool| {
            let mut smallest = R::of(f32::MAX);
            let (mut nearest, mut target) = ([R::of(0.0); N], [0; N]);
            for offset in neighbours::<N>(1) {
                if skip_centre && offset == [0; N] {
                    continue;
                }
                let place: [i32; N] = each(|axis| centre[axis] + offset[axis]);
                let point = cell.point(place, parameters.randomness);
                let v: [R; N] = each(|axis| point[axis] - to[axis]);
                let compared = if N == 1 { v[0].abs() } else { dot(v, v) };
                if compared < smallest {
                    (smallest, nearest, target) = (compared, point, place);
                }
            }
            (nearest, target)
        };
        let (closest, target) = nearest_of([0; N], cell.local, false);
        let (neighbour, _) = nearest_of(target, closest, true);
        let v: [R; N] = each(|axis| neighbour[axis] - closest[axis]);
        (if N == 1 { v[0].abs() } else { length(v) }) / R::of(2.0)
    }

    fn feature<R: Real, const N: usize>(&self, x: [R; N], parameters: &Parameters<R>) -> Found<R, N> {
        match self.feature {
            Feature::F2 => self.f2(x, parameters),
            Feature::SmoothF1 if parameters.smoothness != R::of(0.0) => self.smooth_f1(x, parameters),
            _ => self.f1(x, parameters),
        }
    }

    /// The fractal sum of F1, F2 or smooth F1.
    fn fractal<R: Real, const N: usize>(&self, q: [R; N], parameters: &Parameters<R>) -> Found<R, N> {
        let (zero, one) = (R::of(0.0), R::of(1.0));
        let single = parameters.detail == zero || parameters.roughness == zero;
        let whole = parameters.detail.floor().to_int();
        let rest = parameters.detail - parameters.detail.floor();
        let (mut amplitude, mut total, mut scale) = (one, zero, one);
        let mut sum = Found { distance: zero, color: [zero; 3], position: [zero; N], third: zero };
        for octave in 0..=parameters.detail.ceil().to_int() {
            let found = self.feature(q.mapped(|x| (x * scale).round_coordinate()), parameters);
            if single {
                (sum, total) = (found, one);
                break;
            }
            let inverse = one / scale;
            if octave <= whole {
                total = total + amplitude;
                sum.distance = sum.distance + found.distance * amplitude;
                for channel in 0..3 {
                    sum.color[channel] = sum.color[channel] + found.color[channel] * amplitude;
                }
                for axis in 0..N {
                    sum.position[axis] = sum.position[axis].lerp(found.position[axis] * inverse, amplitude);
                }
                sum.third = sum.third.lerp(found.third * inverse, amplitude);
                scale = (scale * parameters.lacunarity).round_coordinate();
                amplitude = amplitude * parameters.roughness;
            } else if rest != zero {
                total = total.lerp(total + amplitude, rest);
                sum.distance = sum.distance.lerp(sum.distance + found.distance * amplitude, rest);
                for channel in 0..3 {
                    let next = sum.color[channel] + found.color[channel] * amplitude;
                    sum.color[channel] = sum.color[channel].lerp(next, rest);
                }
                for axis in 0..N {
                    let next = sum.position[axis].lerp(found.position[axis] * inverse, amplitude);
                    sum.position[axis] = sum.position[axis].lerp(next, rest);
                }
                let next = sum.third.lerp(found.third * inverse, amplitude);
                sum.third = sum.third.lerp(next, rest);
            }
        }
        if self.normalize {
            sum.distance = sum.distance / (total * self.largest_distance::<R, N>(parameters));
            let inverse = one / total;
            sum.color = sum.color.mapped(|x| x * inverse);
        }
        let inverse = if parameters.scale != zero { one / parameters.scale } else { zero };
        let unscaled = |x: R| if parameters.scale != zero { x * inverse } else { zero };
        sum.position = sum.position.mapped(unscaled);
        sum.third = unscaled(sum.third);
        sum
    }

    /// Distance that `normalize` divides by.
    fn largest_distance<R: Real, const N: usize>(&self, parameters: &Parameters<R>) -> R {
        let half = R::of(0.5) + R::of(0.5) * parameters.randomness;
        let distance = self.metric.distance([half; N], parameters.exponent);
        if self.feature == Feature::F2 { distance * R::of(2.0) } else { distance }
    }

    /// The fractal of the distance to edge.
    fn fractal_edge<R: Real, const N: usize>(&self, q: [R; N], parameters: &Parameters<R>) -> R {
        let (zero, one) = (R::of(0.0), R::of(1.0));
        let single = parameters.detail == zero || parameters.roughness == zero;
        let whole = parameters.detail.floor().to_int();
        let rest = parameters.detail - parameters.detail.floor();
        let largest = R::of(0.5) + R::of(0.5) * parameters.randomness;
        let (mut amplitude, mut scale, mut maximum, mut distance) = (one, one, largest, R::of(8.0));
        for octave in 0..=parameters.detail.ceil().to_int() {
            let found = self.edge(q.mapped(|x| (x * scale).round_coordinate()), parameters);
            if single {
                distance = found;
                break;
            }
            let next_maximum = maximum.lerp(largest / scale, amplitude);
            let next_distance = distance.lerp(distance.lesser(found / scale), amplitude);
            if octave <= whole {
                (maximum, distance) = (next_maximum, next_distance);
                scale = (scale * parameters.lacunarity).round_coordinate();
                amplitude = amplitude * parameters.roughness;
            } else if rest != zero {
                maximum = maximum.lerp(next_maximum, rest);
                distance = distance.lerp(distance.lesser(next_distance), rest);
            }
        }
        if self.normalize { distance / maximum } else { distance }
    }

    /// First column of each parameter, `None` where the mode lacks it: scale, detail, roughness,
    /// lacunarity, smoothness, exponent, randomness.
    fn parameter_columns(&self) -> [Option<usize>; 7] {
        let mut next = if self.dimensions == 1 { 1 } else { 3 + usize::from(self.dimensions == 4) };
        let fractal = self.feature != Feature::NSphereRadius;
        let exists = [true, fractal, fractal, fractal, self.feature == Feature::SmoothF1, self.has_exponent, true];
        exists.mapped(|exists| {
            exists.then(|| {
                next += 1;
                next - 1
            })
        })
    }

    /// Parameters of point `index`, clamped as the kernel does.
    fn parameters<R: Real>(&self, inputs: &[Column<'_, R>], index: usize) -> Parameters<R> {
        let at = |column: Option<usize>| column.map_or(R::of(0.0), |column| inputs[column].values[index]);
        let [scale, detail, roughness, lacunarity, smoothness, exponent, randomness] =
            self.parameter_columns().mapped(at);
        Parameters {
            scale,
            detail: detail.clamped(R::of(0.0), R::of(15.0)),
            roughness: roughness.saturate(),
            lacunarity,
            smoothness: (smoothness / R::of(2.0)).clamped(R::of(0.0), R::of(0.5)),
            exponent,
            randomness: randomness.saturate(),
        }
    }

    fn evaluate_points<R: Real, const N: usize>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        for index in 0..outputs[0].len() {
            let parameters = self.parameters(inputs, index);
            let q: [R; N] = each(|axis| (inputs[axis].values[index] * parameters.scale).round_coordinate());
            match self.feature {
                Feature::DistanceToEdge => outputs[0][index] = self.fractal_edge(q, &parameters),
                Feature::NSphereRadius => outputs[0][index] = self.n_sphere_radius(q, &parameters),
                _ => self.store(index, &self.fractal(q, &parameters), outputs),
            }
        }
    }

    fn store<R: Real, const N: usize>(&self, index: usize, found: &Found<R, N>, outputs: &mut [&mut [R]]) {
        let mut next = 0;
        let mut put = |value: R| {
            outputs[next][index] = value;
            next += 1;
        };
        if self.distance {
            put(found.distance);
        }
        if self.color {
            found.color.into_iter().for_each(&mut put);
        }
        if self.position {
            for axis in 0..3 {
                put(if axis < N { found.position[axis] } else { found.third });
            }
        }
        if self.w {
            put(found.position[N - 1]);
        }
    }
}

impl Evaluate for VoronoiTexture {
    fn folds_late(&self) -> bool {
        false
    }

    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        match self.dimensions {
            1 => self.evaluate_points::<R, 1>(inputs, outputs),
            2 => self.evaluate_points::<R, 2>(inputs, outputs),
            3 => self.evaluate_points::<R, 3>(inputs, outputs),
            _ => self.evaluate_points::<R, 4>(inputs, outputs),
        }
    }

    fn evaluate_fast(&self, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) -> bool {
        lanes::evaluate(self, inputs, outputs)
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        bounds::enclose(self, inputs, outputs);
    }

    fn fold_constants(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        // Blender folds without clamping Detail: a negative one leaves no octave at all, and a normalised
        // distance is 0 / 0 then.
        let detail = inputs[self.parameter_columns()[1]?];
        if detail >= 0.0 {
            return None;
        }
        let empty = match (self.feature, self.normalize) {
            (Feature::DistanceToEdge, _) => 8.0,
            (_, true) => f32::NAN,
            (_, false) => 0.0,
        };
        let color = usize::from(self.color) * 3;
        let position = usize::from(self.position) * 3;
        let mut values = vec![0.0; usize::from(self.distance) + color + position + usize::from(self.w)];
        if self.distance {
            values[0] = empty;
        }
        Some(values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value as Json, json};

    /// Distance and colour of F1 at a point, with a scale and a randomness of 1.
    fn f1(dimensions: &str, release: Release, place: [f32; 4]) -> [f32; 4] {
        let Json::Object(properties) = json!({"voronoi_dimensions": dimensions}) else { unreachable!("an object") };
        let mode = Mode::read(&TYPE, &properties, "test").expect("a mode").with_release(release);
        let mode = mode.with_wanted(vec!["Distance", "Color"]);
        let Role::Evaluated(build) = TYPE.role else { unreachable!("it evaluates") };
        let coordinates = if dimensions == "4D" { &place[..] } else { &place[..3] };
        let values: Vec<[f32; 1]> =
            coordinates.iter().chain(&[1.0, 0.0, 0.5, 2.0, 1.0]).map(|value| [*value]).collect();
        let inputs: Vec<Column<'_, f32>> = values.iter().map(|values| Column { values, uniform: true }).collect();
        let mut found = [[0.0]; 4];
        let mut outputs: Vec<&mut [f32]> = found.iter_mut().map(|output| &mut output[..]).collect();
        build(&mode).evaluate_f32(&inputs, &mut outputs);
        found.map(|[value]| value)
    }

    /// As Cycles 4.5.15 gives them, bit for bit.
    #[test]
    fn cells_of_blender_4_5_have_its_numbers() {
        let places = [[0.3, 0.7, -0.4, 0.9], [-12.25, 3.5, 8.75, 0.9], [1000.6, -0.2, 0.1, 0.9]];
        let expected = [
            (
                "2D",
                [
                    [0.476_619_12, 0.149_559_54, 0.152_253_76, 0.818_496_94],
                    [0.432_566_23, 0.145_068_82, 0.323_835, 0.359_003_87],
                    [0.502_639_23, 0.358_147, 0.240_641_73, 0.003_468_018_5],
                ],
            ),
            (
                "3D",
                [
                    [0.707_542_1, 0.479_313_43, 0.030_472_752, 0.457_887_77],
                    [0.608_731_75, 0.515_026_45, 0.342_920_9, 0.210_863_71],
                    [0.563_466_67, 0.683_670_64, 0.748_228_25, 0.545_194_2],
                ],
            ),
            (
                "4D",
                [
                    [0.809_308_6, 0.606_350_96, 0.739_733_9, 0.522_699_6],
                    [0.384_076_24, 0.047_180_68, 0.144_101, 0.904_811_4],
                    [0.595_041_8, 0.478_987_16, 0.465_584_6, 0.902_855_4],
                ],
            ),
        ];
        for (dimensions, expected) in expected {
            for (place, expected) in places.into_iter().zip(expected) {
                assert_eq!(f1(dimensions, Release::V4_5, place), expected, "{dimensions} {place:?}");
                assert_ne!(f1(dimensions, Release::V5_0, place), expected, "{dimensions} {place:?}");
            }
        }
    }
}
