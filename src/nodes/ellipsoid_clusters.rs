//! Clouds of soft ellipsoids, and of soft spheres: a node type of ours, without a counterpart in Blender.
//!
//! 30 clouds stand on a square of side `Spread` around the origin, in metres, y up. With q the place within an ellipsoid, its centre at 0 and its
//! surface at |q| = 1,
//!
//! ```text
//! value = 1 - product over ellipsoids of (1 - a clamp(1 - |q|, 0, 1)^2)
//! ```
//!
//! * `CLUSTERS`: 25 ellipsoids a cloud, a = 0.6, as the procedural-clouds skill places and sizes them: heaps, layers and streaks.
//! * `OVERLAPPING_CLUSTERS`: the same with one sequence of random numbers, of which each ellipsoid takes six and the next one begins one later:
//!   what one is long is where the next one is (defect SK-15).
//! * `SPHERES`: one sphere a cloud, a = 1, of half to one and a half of `Radius`, its centre up to `Height` above `Base`: a smooth union, for a
//!   coarse field of where clouds are.
//!
//! The original's random numbers are remainders of a large multiple of a sine; here they are those of [`crate::nodes::hash::pcg`].

use crate::base::arrays::{Mapped, each};
use crate::nodes::hash::pcg_values;
use crate::nodes::real::Real;
use crate::nodes::{Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Property, Role, always};
use crate::scene::SocketType;

/// Name of the property that says which ellipsoids.
pub const KIND: &str = "kind";

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "cloudparity.EllipsoidClusters",
    label: "(ellipsoid clusters)",
    module: "ellipsoid_clusters",
    shader: include_str!("../../shaders/nodes/ellipsoid_clusters.wgsl"),
    properties: &[Property::choice(KIND, &["CLUSTERS", "OVERLAPPING_CLUSTERS", "SPHERES"])],
    inputs: &[
        InputSocket::vector("Vector", "Vector", &[0.0; 3], always),
        InputSocket::float("Seed", "Seed", &[0.0], always),
        InputSocket::float("Spread", "Spread", &[500.0], always),
        InputSocket::float("Base", "Base", &[80.0], always),
        InputSocket::float("Height", "Height", &[30.0], always),
        InputSocket::float("Radius", "Radius", &[10.0], always),
        InputSocket::float("Passed", "Passed", &[0.0], always),
    ],
    outputs: &[OutputSocket::new("Value", SocketType::Float, always)],
    role: Role::Evaluated(|mode| {
        Box::new(EllipsoidClusters(match mode.choice(KIND) {
            "CLUSTERS" => Kind::Clusters,
            "OVERLAPPING_CLUSTERS" => Kind::Overlapping,
            _ => Kind::Spheres,
        }))
    }),
};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Clusters,
    Overlapping,
    Spheres,
}

struct EllipsoidClusters(Kind);

/// Clouds of a field.
pub const CLOUDS: i32 = 30;

/// Ellipsoids of a cloud.
const PARTICLES: i32 = 25;

/// What a layer or a heap reaches from its cloud's middle along x and z, and up and down, in metres: 20 + 20 and 15 + 13; 10 + 8.
const REACH: [f32; 3] = [40.0, 18.0, 40.0];

/// Roundings of a value in units of 2^-24 per ellipsoid: its factor takes three, and its share of the product one.
const ROUNDINGS: f64 = 8.0 / (1 << 24) as f64;

/// What is the same at all points.
#[derive(Clone, Copy)]
struct Field<R> {
    seed: i32,
    spread: R,
    base: R,
    height: R,
    radius: R,
    passed: R,
}

/// An ellipsoid.
#[derive(Debug, Clone, Copy)]
struct Ellipsoid<R> {
    centre: [R; 3],
    radii: [R; 3],
}

/// Number of a sequence, in [0, 1].
#[inline(always)]
fn random<R: Real>(index: i32, lane: i32) -> R {
    let [first, _, _]: [R; 3] = pcg_values([index, lane, 0]);
    first
}

impl<R: Real> Field<R> {
    fn of(inputs: &[Column<'_, R>], index: usize) -> Self {
        let value = |input: usize| inputs[input].values[index];
        let [spread, base, height, radius, passed] = [4, 5, 6, 7, 8].mapped(value);
        Self { seed: value(3).to_int(), spread, base, height, radius, passed }
    }

    /// The middle of a cloud.
    #[inline(always)]
    fn middle(&self, cloud: i32) -> [R; 3] {
        let [x, z, up] = [0, 1, 2].mapped(|part| random::<R>(self.seed.wrapping_add(3 * cloud + part), 0));
        let half = R::of(0.5);
        [(x - half) * self.spread, self.base + self.height * up, ((z + self.passed).fraction() - half) * self.spread]
    }

    /// An ellipsoid of a cloud.
    #[inline(always)]
    fn ellipsoid(&self, kind: Kind, cloud: i32, number: i32, middle: [R; 3]) -> Ellipsoid<R> {
        if kind == Kind::Spheres {
            let radius = self.radius * (R::of(0.5) + random::<R>(self.seed.wrapping_add(7 * cloud), 0));
            return Ellipsoid { centre: middle, radii: [radius; 3] };
        }
        let type_of = random::<R>(self.seed.wrapping_add(7 * cloud), 0);
        let key = self.seed.wrapping_add(100 * cloud + number);
        let r = |lane: i32| match kind {
            Kind::Overlapping => random::<R>(key.wrapping_add(lane), 1),
            _ => random::<R>(key, 2 + lane),
        };
        let of = R::of;
        let half = of(0.5);
        let part = of(number as f32) / of(PARTICLES as f32);
        let (offset, radii) = if type_of < of(0.4) {
            let [sine, cosine] = (of(std::f32::consts::TAU) * r(0)).sine_and_cosine();
            let away = of(15.0) * r(1);
            (
                [away * cosine, (of(12.0) * r(2) - of(2.0)).greater(of(0.0)), away * sine],
                [of(5.0) + of(8.0) * r(3), of(3.0) + of(5.0) * r(4) * (of(1.0) - part), of(5.0) + of(8.0) * r(5)],
            )
        } else if type_of < of(0.7) {
            (
                [of(40.0) * (r(0) - half), of(3.0) * (r(1) - half), of(40.0) * (r(2) - half)],
                [of(8.0) + of(12.0) * r(3), of(1.5) + of(2.0) * r(4), of(8.0) + of(12.0) * r(5)],
            )
        } else {
            (
                [
                    of(30.0) * part - of(15.0) + of(5.0) * (r(0) - half),
                    of(2.0) * (r(1) - half),
                    of(4.0) * (r(2) - half),
                ],
                [of(3.0) + of(4.0) * r(3), half + r(4), of(1.5) + of(2.0) * r(5)],
            )
        };
        Ellipsoid { centre: each(|axis| middle[axis] + offset[axis]), radii }
    }

    /// How far a cloud reaches from its middle.
    fn reach(&self, kind: Kind) -> [R; 3] {
        if kind == Kind::Spheres { [self.radius.abs() * R::of(1.5); 3] } else { REACH.mapped(R::of) }
    }
}

/// Of how many ellipsoids a cloud is, and what one takes in its middle.
fn shape(kind: Kind) -> (i32, f32) {
    if kind == Kind::Spheres { (1, 1.0) } else { (PARTICLES, 0.6) }
}

/// The value at a place.
fn value<R: Real>(kind: Kind, field: &Field<R>, place: [R; 3]) -> R {
    let (count, most) = shape(kind);
    let reach = field.reach(kind);
    let mut left = R::of(1.0);
    for cloud in 0..CLOUDS {
        let middle = field.middle(cloud);
        if (0..3).any(|axis| (place[axis] - middle[axis]).abs() > reach[axis]) {
            continue;
        }
        for number in 0..count {
            let Ellipsoid { centre, radii } = field.ellipsoid(kind, cloud, number, middle);
            let q: [R; 3] = each(|axis| (place[axis] - centre[axis]) / radii[axis]);
            let inside = (R::of(1.0) - (q[0] * q[0] + q[1] * q[1] + q[2] * q[2]).sqrt()).saturate();
            left = left * (R::of(1.0) - R::of(most) * (inside * inside));
        }
    }
    R::of(1.0) - left
}

impl Evaluate for EllipsoidClusters {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        for (index, result) in outputs[0].iter_mut().enumerate() {
            let place = [0, 1, 2].mapped(|axis| inputs[axis].values[index]);
            *result = value(self.0, &Field::of(inputs, index), place);
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let may_be_nan = inputs.iter().any(|input| input.may_be_nan || !input.is_finite());
        let everything = Interval::outward(0.0, 1.0, may_be_nan);
        outputs[0] = everything;
        let points: Option<Vec<f64>> = inputs[3..].iter().map(|input| input.as_point().map(f64::from)).collect();
        let (Some(given), false) = (points, may_be_nan) else { return };
        let [seed, spread, base, height, radius, passed] = given[..] else { return };
        let field = Field { seed: (seed as f32).to_int(), spread, base, height, radius, passed };
        let kind = self.0;
        let (count, most) = shape(kind);
        let reach = field.reach(kind);
        let ends: [[f64; 2]; 3] = each(|axis| inputs[axis].ends());
        // What f32 makes of a centre and of its distance from a place: ten roundings of the largest number in it.
        let largest = ends.as_flattened().iter().fold(0.0_f64, |largest, end| largest.max(end.abs()));
        let largest = largest + spread.abs() + base.abs() + height.abs() + 2.0 * radius.abs() + 60.0;
        let error = 10.0 * largest / f64::from(1 << 24);
        let mut left = [1.0_f64; 2];
        let mut met = 1.0;
        for cloud in 0..CLOUDS {
            let middle = field.middle(cloud);
            let is_apart = |axis: usize| {
                let [low, high] = ends[axis];
                low - error > middle[axis] + reach[axis] || high + error < middle[axis] - reach[axis]
            };
            // Its ellipsoids lie within its reach: beyond it they take nothing.
            if (0..3).any(is_apart) {
                continue;
            }
            for number in 0..count {
                let Ellipsoid { centre, radii } = field.ellipsoid(kind, cloud, number, middle);
                let (mut near, mut far) = (0.0_f64, 0.0_f64);
                for axis in 0..3 {
                    let radius = radii[axis].abs();
                    let [low, high] = [ends[axis][0] - centre[axis] - error, ends[axis][1] - centre[axis] + error];
                    let close = if low > 0.0 { low } else { (-high).max(0.0) };
                    near += (close / radius).powi(2);
                    far += (low.abs().max(high.abs()) / radius).powi(2);
                }
                if near.is_nan() || far.is_nan() {
                    // A sphere of no radius is nowhere, or everywhere at its middle.
                    return;
                }
                let taken =
                    [far, near].mapped(|square| f64::from(most) * (1.0 - square.sqrt()).clamp(0.0, 1.0).powi(2));
                met += f64::from(u8::from(taken[1] > 0.0));
                left = [left[0] * (1.0 - taken[1]), left[1] * (1.0 - taken[0])];
            }
        }
        let rounding = met * ROUNDINGS;
        let [low, high] = [1.0 - left[1] - rounding, 1.0 - left[0] + rounding];
        outputs[0] = Interval::outward(low.max(0.0), high.min(1.0), false);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIELD: Field<f64> = Field { seed: 7, spread: 500.0, base: 80.0, height: 30.0, radius: 30.0, passed: 0.25 };

    #[test]
    fn ellipsoids_lie_within_their_clouds_reach() {
        for kind in [Kind::Clusters, Kind::Overlapping, Kind::Spheres] {
            let reach = FIELD.reach(kind);
            for cloud in 0..CLOUDS {
                let middle = FIELD.middle(cloud);
                for number in 0..shape(kind).0 {
                    let found = FIELD.ellipsoid(kind, cloud, number, middle);
                    for axis in 0..3 {
                        let end = (found.centre[axis] - middle[axis]).abs() + found.radii[axis];
                        assert!(
                            end <= reach[axis] && found.radii[axis] > 0.4,
                            "{kind:?} {cloud} {number} {axis}: {end}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn a_lone_sphere_has_its_profile_and_clouds_wrap_along_z() {
        // So small that no two meet.
        let field = Field { radius: 0.5, ..FIELD };
        let middle = field.middle(3);
        let radius = field.ellipsoid(Kind::Spheres, 3, 0, middle).radii[0];
        for part in [0.0, 0.25, 0.9, 1.1] {
            let place = [middle[0] + part * radius, middle[1], middle[2]];
            let truth = (1.0_f64 - part).max(0.0).powi(2);
            assert!((value(Kind::Spheres, &field, place) - truth).abs() < 1e-12, "{part}");
        }
        for cloud in 0..CLOUDS {
            let [before, after] = [0.25, 1.25].map(|passed| Field { passed, ..FIELD }.middle(cloud));
            assert!((0..3).all(|axis| (before[axis] - after[axis]).abs() < 1e-9));
            assert!(before[0].abs() <= 250.0 && before[2].abs() <= 250.0 && (80.0..=110.0).contains(&before[1]));
        }
    }
}
