//! Lights as the path integrator samples them: with their extent.
//!
//! A light is sampled from a place in the medium (next-event estimation), and rays that were sampled
//! by the phase function may hit it; both know the density of a direction under light sampling, so that they can
//! be weighted against each other. Radiometry is Cycles': a sun of irradiance P and half angle a is
//! a cone of radiance P / (pi sin^2 a); a point of power P has intensity P / 4 pi, with a radius r it is a
//! disc that faces the receiver (or a sphere) of radiance P / (4 pi^2 r^2); an area light of area A is one-sided
//! with radiance P / (pi A). Lights stop no rays.

use crate::base::error::{Error, Result};
use crate::scene::{self, Light, LightKind, Scene};
use crate::shader_struct;
use bytemuck::Zeroable;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// A light, ready to be sampled.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledLight {
    shape: Shape,
    /// Irradiance of a sun without extent, intensity in W/sr of a point without, radiance else.
    power: [f64; 3],
    /// The edge of a spot light.
    spot: Option<Spot>,
    /// Roughly what it delivers at distance 1: the basis for choosing among lights.
    strength: f64,
}

/// Kinds of lights in the shader: a sun without extent and with, a point, a spot.
pub(crate) const SUN: u32 = 0;
pub(crate) const SUN_DISC: u32 = 1;
pub(crate) const POINT: u32 = 2;
pub(crate) const SPOT: u32 = 3;

shader_struct! {
    /// A light as `shaders/integrators/path/path.wgsl` reads it.
    pub(crate) struct GpuLight = "Light" {
        pub(crate) place: [f32; 3],
        pub(crate) kind: u32,
        pub(crate) axis: [f32; 3],
        pub(crate) edge: f32,
        pub(crate) power: [f32; 3],
        pub(crate) blend: f32,
        pub(crate) opening: f32,
        pub(crate) strength: f32,
        pub(crate) padding: [f32; 2],
    }
}

#[derive(Debug, Clone, PartialEq)]
enum Shape {
    /// Unit vector towards a sun without extent.
    Direction(DVec3),
    /// Unit vector towards the middle of a sun's disc, and one minus the cosine of its half angle.
    Cone(DVec3, f64),
    Point(DVec3),
    /// Centre and radius of a disc that faces the receiver.
    FacingDisc(DVec3, f64),
    Sphere(DVec3, f64),
    /// Centre, half edges, and the side that shines.
    Rectangle {
        centre: DVec3,
        edges: [DVec3; 2],
        normal: DVec3,
    },
    Ellipse {
        centre: DVec3,
        edges: [DVec3; 2],
        normal: DVec3,
    },
}

/// Where a spot light shines.
#[derive(Debug, Clone, PartialEq)]
struct Spot {
    /// Unit vector of travel.
    axis: DVec3,
    /// Cosine of half the cone.
    edge: f64,
    blend: f64,
}

/// Light that reaches a place from a sampled direction, through empty space.
#[derive(Debug, Clone, Copy)]
pub struct LightSample {
    /// Unit vector towards the light.
    pub direction: DVec3,
    /// Metres to the light.
    pub distance: f64,
    /// Radiance over the density of the direction; for a light without extent what arrives.
    pub radiance: [f64; 3],
    /// Density of the direction per steradian; None for a light without extent, which no ray hits.
    pub density: Option<f64>,
}

/// A ray that hits a light.
#[derive(Debug, Clone, Copy)]
pub struct LightHit {
    /// Metres to the light.
    pub distance: f64,
    /// Radiance towards the ray's origin.
    pub radiance: [f64; 3],
    /// Density per steradian with which the light would have been sampled in this direction.
    pub density: f64,
}

/// The lights of a scene. Lights that deliver nothing are left out.
pub fn sampled_lights(scene: &Scene) -> Result<Vec<SampledLight>> {
    let lights: Result<Vec<SampledLight>> = scene.lights.iter().map(SampledLight::new).collect();
    Ok(lights?.into_iter().filter(|light| light.power != [0.0; 3]).collect())
}

impl SampledLight {
    fn new(light: &Light) -> Result<Self> {
        let wrong = |found: String, expected: &str| {
            Error::new(format!("light {}", light.name), found, expected, "Change the light.")
        };
        let matrix = scene::matrix_to_glam(&light.matrix_world);
        let back = matrix.z_axis.truncate();
        if !(back.length() > 0.0 && matrix.is_finite()) {
            return Err(wrong("a transform without direction".into(), "an invertible object transform"));
        }
        let back = back.normalize();
        let centre = matrix.w_axis.truncate();
        let scale = light.exposed_strength();
        let strength = light.color.map(|channel| f64::from(channel) * scale);
        let largest = strength.iter().copied().fold(0.0, f64::max);
        let times = |factor: f64| strength.map(|channel| channel * factor);
        let made = |shape, power, strength| Ok(Self { shape, power, spot: None, strength });
        match &light.kind {
            LightKind::Sun { angle } => {
                let half = f64::from(*angle) / 2.0;
                if !(0.0..=PI).contains(&half) {
                    return Err(wrong(format!("an angle of {angle}"), "0 to 2 pi"));
                }
                if half == 0.0 {
                    return made(Shape::Direction(back), strength, largest);
                }
                // 1 - cos without cancellation. Above a half angle of 90 degrees Blender's disc no longer grows.
                let half = half.min(PI / 2.0);
                let opening = 2.0 * (half / 2.0).sin().powi(2);
                made(Shape::Cone(back, opening), times(1.0 / (PI * half.sin().powi(2))), largest)
            }
            LightKind::Point { radius, soft_falloff } => {
                Ok(Self::point(centre, f64::from(*radius), *soft_falloff, strength))
            }
            LightKind::Spot { radius, spot_size, blend } => {
                let spot = Spot {
                    axis: -back,
                    edge: (f64::from(*spot_size) / 2.0).cos(),
                    // A hard edge divides by zero; the narrowest blend is as hard as a pixel can show.
                    blend: f64::from(*blend).max(1e-6),
                };
                Ok(Self { spot: Some(spot), ..Self::point(centre, f64::from(*radius), true, strength) })
            }
            LightKind::Area { shape, size } => {
                let edge = |axis: usize, length: f32| matrix.col(axis).truncate() * f64::from(length) / 2.0;
                let round = matches!(shape.as_str(), "DISK" | "ELLIPSE");
                let second = if matches!(shape.as_str(), "SQUARE" | "DISK") { size[0] } else { size[1] };
                if !matches!(shape.as_str(), "SQUARE" | "RECTANGLE" | "DISK" | "ELLIPSE") {
                    return Err(wrong(format!("the shape {shape}"), "SQUARE, RECTANGLE, DISK or ELLIPSE"));
                }
                let edges = [edge(0, size[0]), edge(1, second)];
                let cross = edges[0].cross(edges[1]);
                let area = cross.length() * if round { PI } else { 4.0 };
                if !(area > 0.0 && area.is_finite()) {
                    return Err(wrong(format!("an area of {area} square metres"), "a positive area"));
                }
                let normal = -cross.normalize() * cross.dot(back).signum();
                let shape = if round {
                    Shape::Ellipse { centre, edges, normal }
                } else {
                    Shape::Rectangle { centre, edges, normal }
                };
                made(shape, times(1.0 / (PI * area)), largest / PI)
            }
        }
    }

    /// The light in the form of the shader, whose places are relative to `origin`; it knows suns and points without extent or spots.
    pub(crate) fn on_adapter(&self, origin: DVec3) -> Result<GpuLight> {
        let vector = |value: DVec3| value.as_vec3().to_array();
        let light = GpuLight {
            power: self.power.map(|power| power as f32),
            strength: self.strength as f32,
            ..GpuLight::zeroed()
        };
        match (&self.shape, &self.spot) {
            (Shape::Direction(towards), _) => Ok(GpuLight { place: vector(*towards), kind: SUN, ..light }),
            (Shape::Cone(towards, opening), _) => {
                Ok(GpuLight { place: vector(*towards), kind: SUN_DISC, opening: *opening as f32, ..light })
            }
            (Shape::Point(place), None) => Ok(GpuLight { place: vector(*place - origin), kind: POINT, ..light }),
            (Shape::Point(place), Some(spot)) => Ok(GpuLight {
                place: vector(*place - origin),
                kind: SPOT,
                axis: vector(spot.axis),
                edge: spot.edge as f32,
                blend: spot.blend as f32,
                ..light
            }),
            _ => Err(Error::new(
                "path tracing on the adapter",
                "a point, spot or area light with an extent",
                "suns, and points and spots of radius 0: the adapter knows no other lights yet",
                "Trace on the CPU.",
            )
            .with_setting("backend")),
        }
    }

    fn point(centre: DVec3, radius: f64, facing: bool, strength: [f64; 3]) -> Self {
        let largest = strength.iter().copied().fold(0.0, f64::max) / (4.0 * PI);
        let (shape, factor) = if radius == 0.0 {
            (Shape::Point(centre), 1.0 / (4.0 * PI))
        } else {
            let shape = if facing { Shape::FacingDisc(centre, radius) } else { Shape::Sphere(centre, radius) };
            (shape, 1.0 / (2.0 * PI * radius).powi(2))
        };
        Self { shape, power: strength.map(|channel| channel * factor), spot: None, strength: largest }
    }

    /// Positive weight for choosing among lights at a place: roughly what arrives there.
    pub fn importance(&self, place: DVec3) -> f64 {
        let near = |centre: DVec3, extent: f64| self.strength / ((centre - place).length_squared() + extent);
        match &self.shape {
            Shape::Direction(_) | Shape::Cone(..) => self.strength,
            Shape::Point(centre) => near(*centre, 1e-12),
            Shape::FacingDisc(centre, radius) | Shape::Sphere(centre, radius) => near(*centre, radius * radius),
            Shape::Rectangle { centre, edges, .. } | Shape::Ellipse { centre, edges, .. } => {
                near(*centre, edges[0].length_squared() + edges[1].length_squared())
            }
        }
    }

    /// Samples a direction towards the light from `place` with two numbers in [0, 1); None where nothing
    /// arrives.
    pub fn sample(&self, place: DVec3, [first, second]: [f64; 2]) -> Option<LightSample> {
        match &self.shape {
            Shape::Direction(direction) => Some(LightSample {
                direction: *direction,
                distance: f64::INFINITY,
                radiance: self.power,
                density: None,
            }),
            Shape::Cone(axis, opening) => {
                let direction = in_cone(*axis, *opening, [first, second]);
                Some(self.with_density(direction, f64::INFINITY, 1.0 / (TAU * opening)))
            }
            Shape::Point(centre) => {
                let distance = (*centre - place).length();
                let direction = (*centre - place) / distance;
                let falloff = self.falloff(direction) / (distance * distance);
                let radiance = self.power.map(|intensity| intensity * falloff);
                (falloff > 0.0 && falloff.is_finite()).then_some(LightSample {
                    direction,
                    distance,
                    radiance,
                    density: None,
                })
            }
            Shape::FacingDisc(centre, radius) => {
                let axis = (*centre - place).normalize();
                let frame = frame(axis);
                let [x, y] = in_disc([first, second]);
                self.towards(place, *centre + (frame[0] * x + frame[1] * y) * *radius, -axis, PI * radius * radius)
            }
            Shape::Sphere(centre, radius) => {
                let offset = *centre - place;
                let square = (radius * radius / offset.length_squared()).min(1.0);
                let opening = if square < 1.0 { square / (1.0 + (1.0 - square).sqrt()) } else { 2.0 };
                let direction = in_cone(offset.normalize(), opening, [first, second]);
                let distance = sphere_distance(offset, *radius, direction)?;
                Some(self.with_density(direction, distance, 1.0 / (TAU * opening)))
            }
            Shape::Rectangle { centre, edges, normal } => {
                let point = *centre + edges[0] * (2.0 * first - 1.0) + edges[1] * (2.0 * second - 1.0);
                self.towards(place, point, *normal, 4.0 * edges[0].cross(edges[1]).length())
            }
            Shape::Ellipse { centre, edges, normal } => {
                let [x, y] = in_disc([first, second]);
                self.towards(
                    place,
                    *centre + edges[0] * x + edges[1] * y,
                    *normal,
                    PI * edges[0].cross(edges[1]).length(),
                )
            }
        }
    }

    /// What a ray from `place` meets; None where it misses, and for lights without extent.
    pub fn hit(&self, place: DVec3, direction: DVec3) -> Option<LightHit> {
        let found = |distance: f64, density: f64| {
            let falloff = self.falloff(direction);
            Some(LightHit { distance, radiance: self.power.map(|radiance| radiance * falloff), density })
        };
        let plane = |centre: DVec3, normal: DVec3, area: f64| {
            let cosine = -direction.dot(normal);
            let distance = -(centre - place).dot(normal) / cosine;
            let density = distance * distance / (cosine * area);
            (cosine > 0.0 && distance > 0.0 && density.is_finite())
                .then(|| (distance, density, place + direction * distance - centre))
        };
        match &self.shape {
            Shape::Direction(_) | Shape::Point(_) => None,
            Shape::Cone(axis, opening) => {
                // |direction - axis|^2 / 2 is one minus the cosine, without cancellation.
                let outside = (direction - *axis).length_squared() / 2.0 > *opening;
                if outside { None } else { found(f64::INFINITY, 1.0 / (TAU * opening)) }
            }
            Shape::FacingDisc(centre, radius) => {
                let normal = (place - *centre).normalize();
                let (distance, density, offset) = plane(*centre, normal, PI * radius * radius)?;
                if offset.length_squared() > radius * radius { None } else { found(distance, density) }
            }
            Shape::Sphere(centre, radius) => {
                let offset = *centre - place;
                let square = (radius * radius / offset.length_squared()).min(1.0);
                let opening = if square < 1.0 { square / (1.0 + (1.0 - square).sqrt()) } else { 2.0 };
                let distance = sphere_distance(offset, *radius, direction)?;
                found(distance, 1.0 / (TAU * opening))
            }
            Shape::Rectangle { centre, edges, normal } => {
                let (distance, density, offset) = plane(*centre, *normal, 4.0 * edges[0].cross(edges[1]).length())?;
                let [x, y] = in_basis(offset, edges, *normal);
                if x.abs().max(y.abs()) > 1.0 { None } else { found(distance, density) }
            }
            Shape::Ellipse { centre, edges, normal } => {
                let (distance, density, offset) = plane(*centre, *normal, PI * edges[0].cross(edges[1]).length())?;
                let [x, y] = in_basis(offset, edges, *normal);
                if x * x + y * y > 1.0 { None } else { found(distance, density) }
            }
        }
    }

    /// A sample of a surface of this area at `point`.
    fn towards(&self, place: DVec3, point: DVec3, normal: DVec3, area: f64) -> Option<LightSample> {
        let offset = point - place;
        let distance = offset.length();
        let direction = offset / distance;
        let cosine = -direction.dot(normal);
        let density = distance * distance / (cosine * area);
        (cosine > 0.0 && density > 0.0 && density.is_finite()).then(|| self.with_density(direction, distance, density))
    }

    fn with_density(&self, direction: DVec3, distance: f64, density: f64) -> LightSample {
        let factor = self.falloff(direction) / density;
        let radiance = self.power.map(|radiance| radiance * factor);
        LightSample { direction, distance, radiance, density: Some(density) }
    }

    /// Part of a spot's light that travels against `direction`.
    fn falloff(&self, direction: DVec3) -> f64 {
        self.spot.as_ref().map_or(1.0, |spot| {
            let inside = -direction.dot(spot.axis) - spot.edge;
            let part = (inside / ((1.0 - spot.edge) * spot.blend)).clamp(0.0, 1.0);
            part * part * (3.0 - 2.0 * part)
        })
    }
}

/// Two unit vectors orthogonal to a unit vector and to each other (Duff et al. 2017, "Building an
/// Orthonormal Basis, Revisited").
pub fn frame(axis: DVec3) -> [DVec3; 2] {
    let sign = 1.0_f64.copysign(axis.z);
    let a = -1.0 / (sign + axis.z);
    let b = axis.x * axis.y * a;
    [
        DVec3::new(1.0 + sign * axis.x * axis.x * a, sign * b, -sign * axis.x),
        DVec3::new(b, sign + axis.y * axis.y * a, -axis.y),
    ]
}

/// The direction at an angle of cosine `cosine` from `axis`, turned by `turn` of a full circle.
pub fn around(axis: DVec3, cosine: f64, sine: f64, turn: f64) -> DVec3 {
    let [first, second] = frame(axis);
    let (up, right) = (TAU * turn).sin_cos();
    ((first * right + second * up) * sine + axis * cosine).normalize()
}

/// Uniform over a cone; `opening` is one minus the cosine of its half angle.
fn in_cone(axis: DVec3, opening: f64, [first, second]: [f64; 2]) -> DVec3 {
    let lack = first * opening;
    around(axis, 1.0 - lack, (lack * (2.0 - lack)).sqrt(), second)
}

/// Uniform over the unit disc (Shirley and Chiu 1997: concentric squares to concentric circles).
fn in_disc([first, second]: [f64; 2]) -> [f64; 2] {
    let (x, y) = (2.0 * first - 1.0, 2.0 * second - 1.0);
    if x == 0.0 && y == 0.0 {
        return [0.0; 2];
    }
    let (radius, angle) = if x.abs() > y.abs() { (x, PI / 4.0 * (y / x)) } else { (y, PI / 2.0 - PI / 4.0 * (x / y)) };
    [radius * angle.cos(), radius * angle.sin()]
}

/// Coordinates of a vector of the plane of two edges in their basis.
fn in_basis(offset: DVec3, edges: &[DVec3; 2], normal: DVec3) -> [f64; 2] {
    let area = edges[0].cross(edges[1]).dot(normal);
    [offset.cross(edges[1]).dot(normal) / area, edges[0].cross(offset).dot(normal) / area]
}

/// Distance at which a ray from the origin enters a sphere around `offset`, or leaves it from inside.
fn sphere_distance(offset: DVec3, radius: f64, direction: DVec3) -> Option<f64> {
    let along = offset.dot(direction);
    let lateral = (offset - direction * along).length_squared();
    let half = (radius * radius - lateral).max(0.0).sqrt();
    if lateral > radius * radius * (1.0 + 1e-12) {
        return None;
    }
    let distance = if offset.length_squared() > radius * radius { along - half } else { along + half };
    (distance > 0.0).then_some(distance)
}
