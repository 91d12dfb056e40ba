//! Where the density of an engine is: in the scene's object, between two heights, or between two spheres.

use crate::base::choice::choice;
use crate::base::error::{Error, Result};
use crate::media::mesh::{PlacedMesh, Span};
use crate::media::objects::outline_of;
use crate::media::region::Region;
use crate::scene::{self, Scene};
use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

/// Half of what an endless side of a slab is, in units of the density's frame: beyond what a camera sees, and within what f32 squares.
const ENDLESS: f64 = 1e9;

/// Where a density is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Domain {
    /// The scene's volume object, a box or a mesh: turned, stretched, sheared.
    Object,
    /// Between two heights, without end to the sides: metres of the world.
    Slab {
        /// The lower height.
        bottom: f64,
        /// The upper height.
        top: f64,
    },
    /// Between two spheres around a point: metres of the world.
    Shell {
        /// Middle of both.
        centre: [f64; 3],
        /// Radius of the inner sphere, above 0.
        inner: f64,
        /// Radius of the outer sphere.
        outer: f64,
    },
}

choice! {
    "kebab-case",
    /// A kind of domain: what a density knows.
    pub enum DomainKind {
        /// [`Domain::Object`].
        Object,
        /// [`Domain::Slab`].
        Slab,
        /// [`Domain::Shell`].
        Shell,
    }
}

/// What bounds a density in its own frame.
#[derive(Clone)]
pub enum Outline {
    /// A box.
    Box(Region),
    /// Between spheres around the origin.
    Shell {
        /// Radius of the inner sphere.
        inner: f64,
        /// Radius of the outer sphere.
        outer: f64,
    },
    /// A mesh of an object, whose frame is the density's.
    Mesh(Arc<PlacedMesh>),
}

/// A domain in a scene.
#[derive(Clone)]
pub struct Container {
    /// The domain.
    pub domain: Domain,
    /// World to the frame in which the density is evaluated: the object's, or the world's around the centre of a shell.
    pub to_local: DMat4,
    /// What bounds the density there.
    pub outline: Outline,
    /// Metres of the engine's unit of length. Of a box, or that around a mesh: the side of the cube of its volume, so that of a cube the
    /// side.
    pub unit: f64,
}

impl Container {
    /// The middle of the region in world space.
    pub fn centre(&self) -> DVec3 {
        let region = self.outline.region();
        self.to_local.inverse().transform_point3((region.low + region.high) / 2.0)
    }
}

/// The parts of a ray in a domain, in units of length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Parts {
    /// Distance at which the first part begins.
    pub start: f64,
    /// Length of all parts together; 0 where there is none.
    pub length: f64,
    /// What lies between the parts, in their order.
    pub gaps: Vec<Gap>,
}

/// What lies between two parts of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// Length of the parts before it.
    pub passed: f64,
    /// Length of it and of the gaps before it.
    pub outside: f64,
}

impl Parts {
    /// One part.
    fn single(start: f64, length: f64) -> Self {
        Self { start, length, gaps: Vec::new() }
    }

    /// Of parts in their order.
    fn of(spans: &[Span]) -> Self {
        let mut parts = Self::default();
        let mut end = None;
        for &[from, to] in spans {
            match end {
                None => parts.start = from,
                Some(end) => {
                    let before = parts.gaps.last().map_or(0.0, |gap| gap.outside);
                    parts.gaps.push(Gap { passed: parts.length, outside: before + (from - end) });
                }
            }
            parts.length += to - from;
            end = Some(to);
        }
        parts
    }

    /// Distance from the start after so much of the length.
    pub fn distance(&self, passed: f64) -> f64 {
        let before = self.gaps.iter().take_while(|gap| passed > gap.passed).last();
        before.map_or(passed, |gap| passed + gap.outside)
    }

    /// Whether a distance from the start lies in a part.
    pub fn holds(&self, distance: f64) -> bool {
        let mut outside = 0.0;
        for gap in &self.gaps {
            if distance < gap.passed + gap.outside {
                return (0.0..=gap.passed + outside).contains(&distance);
            }
            outside = gap.outside;
        }
        (0.0..=self.length + outside).contains(&distance)
    }

    /// Cuts off what lies behind a distance from the start.
    pub fn end_at(&mut self, limit: f64) {
        let limit = limit.max(0.0);
        let mut outside = 0.0;
        for number in 0..self.gaps.len() {
            let gap = self.gaps[number];
            if limit <= gap.passed + gap.outside {
                self.length = gap.passed.min(limit - outside);
                self.gaps.truncate(number);
                return;
            }
            outside = gap.outside;
        }
        self.length = self.length.min(limit - outside);
    }
}

impl Domain {
    /// Its kind.
    pub fn kind(&self) -> DomainKind {
        match self {
            Self::Object => DomainKind::Object,
            Self::Slab { .. } => DomainKind::Slab,
            Self::Shell { .. } => DomainKind::Shell,
        }
    }

    /// The domain in a scene. An error where it has no volume.
    pub fn place(self, scene: &Scene) -> Result<Container> {
        let wrong = |found: String, expected: &str| {
            Err(Error::new(format!("domain {self}"), found, expected, "Correct the domain."))
        };
        match self {
            Self::Object => {
                let volume = &scene.volume;
                let (region, mesh) = outline_of(volume)?;
                let outline = mesh.map_or(Outline::Box(region), Outline::Mesh);
                let to_world = scene::matrix_to_glam(&volume.matrix_world);
                let size = to_world.determinant().abs() * (region.high - region.low).element_product();
                let unit = size.cbrt();
                if !(unit > 0.0 && unit.is_finite()) {
                    return Err(Error::new(
                        format!("object {}", volume.object),
                        format!("a box of {size} cubic metres"),
                        "a box with a volume",
                        "Give the object an extent along each axis.",
                    ));
                }
                Ok(Container { domain: self, to_local: to_world.inverse(), outline, unit })
            }
            Self::Slab { bottom, top } => {
                if !(bottom < top && bottom.is_finite() && top.is_finite()) {
                    return wrong(format!("heights from {bottom} to {top}"), "finite heights, the lower one first");
                }
                let region =
                    Region { low: DVec3::new(-ENDLESS, -ENDLESS, bottom), high: DVec3::new(ENDLESS, ENDLESS, top) };
                Ok(Container { domain: self, to_local: DMat4::IDENTITY, outline: Outline::Box(region), unit: 1.0 })
            }
            Self::Shell { centre, inner, outer } => {
                let centre = DVec3::from(centre);
                if !(centre.is_finite() && 0.0 < inner && inner < outer && outer.is_finite()) {
                    return wrong(
                        format!("radii from {inner} to {outer} around {centre}"),
                        "finite radii above 0, the inner one first",
                    );
                }
                let outline = Outline::Shell { inner, outer };
                Ok(Container { domain: self, to_local: DMat4::from_translation(-centre), outline, unit: 1.0 })
            }
        }
    }
}

impl fmt::Display for Domain {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Object => write!(out, "object"),
            Self::Slab { bottom, top } => write!(out, "slab:{bottom},{top}"),
            Self::Shell { centre: [x, y, z], inner, outer } => write!(out, "shell:{x},{y},{z},{inner},{outer}"),
        }
    }
}

impl FromStr for Domain {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let (kind, numbers) = text.split_once(':').unwrap_or((text, ""));
        let parts = numbers.split(',').filter(|part| !part.is_empty());
        let numbers: Option<Vec<f64>> = parts.map(|part| part.trim().parse().ok()).collect();
        match (kind.trim(), numbers.as_deref()) {
            ("object", Some([])) => Ok(Self::Object),
            ("slab", Some(&[bottom, top])) => Ok(Self::Slab { bottom, top }),
            ("shell", Some(&[x, y, z, inner, outer])) => Ok(Self::Shell { centre: [x, y, z], inner, outer }),
            _ => Err(Error::new(
                "domain",
                format!("\"{text}\""),
                "object, slab:BOTTOM,TOP, or shell:X,Y,Z,INNER,OUTER in metres",
                "Correct it.",
            )),
        }
    }
}

impl Outline {
    /// The parts of a ray from a place on, `way` being the displacement per unit of length. Of a mesh that is not closed: those before the
    /// last face, as Cycles has it of camera rays.
    pub fn parts(&self, origin: DVec3, way: DVec3) -> Parts {
        match self {
            Self::Box(region) => match region.segment(origin, way) {
                Some((enter, leave)) if leave > 0.0 => {
                    let start = enter.max(0.0);
                    Parts::single(start, leave - start)
                }
                _ => Parts::default(),
            },
            Self::Shell { inner, outer } => {
                let Some([enter, leave]) = sphere(origin, way, *outer).filter(|[_, leave]| *leave > 0.0) else {
                    return Parts::default();
                };
                let start = enter.max(0.0);
                match sphere(origin, way, *inner).filter(|[_, end]| *end > 0.0) {
                    None => Parts::single(start, leave - start),
                    // Within the inner sphere there is nothing before its far side.
                    Some([begin, end]) if begin <= start => Parts::single(end, (leave - end).max(0.0)),
                    Some([begin, end]) => Parts::of(&[[start, begin], [end, leave.max(end)]]),
                }
            }
            Self::Mesh(mesh) => {
                let Some(last) = mesh.last_face_in_object(origin, way, f64::INFINITY) else { return Parts::default() };
                let mut spans = Vec::new();
                let inside = mesh.begins_inside_in_object(origin);
                mesh.spans_in_object(origin, way, [0.0, last], inside, &mut spans);
                Parts::of(&spans)
            }
        }
    }

    /// The parts through which light arrives at a place inside, `way` pointing towards it: up to where it leaves a box, or a shell for the
    /// first time, which has the ground behind; all of those in a mesh. None outside.
    pub fn parts_to_light(&self, place: DVec3, way: DVec3) -> Parts {
        match self {
            Self::Box(region) => {
                Parts::single(0.0, region.segment(place, way).map_or(0.0, |(_, leave)| leave.max(0.0)))
            }
            Self::Shell { .. } => {
                let Parts { start, length, gaps } = self.parts(place, way);
                let first = gaps.first().map_or(length, |gap| gap.passed);
                Parts::single(0.0, if start == 0.0 { first } else { 0.0 })
            }
            Self::Mesh(mesh) => {
                let mut spans = Vec::new();
                mesh.spans_in_object(place, way, [0.0, f64::INFINITY], true, &mut spans);
                Parts::of(&spans)
            }
        }
    }

    /// Whether a place is inside; on a face is outside. Of a mesh: whether the first face above it, along +Z of the world, shows its back.
    pub fn holds(&self, place: DVec3) -> bool {
        match self {
            Self::Box(region) => place.cmpgt(region.low).all() && place.cmplt(region.high).all(),
            Self::Shell { inner, outer } => {
                let radius = place.length();
                *inner < radius && radius < *outer
            }
            Self::Mesh(mesh) => mesh.begins_inside_in_object(place),
        }
    }

    /// The height of a place as a part of the domain's, 0 at its bottom and 1 at its top.
    pub fn height(&self, place: DVec3) -> f64 {
        match self {
            Self::Shell { inner, outer } => (place.length() - inner) / (outer - inner),
            Self::Box(_) | Self::Mesh(_) => {
                let Region { low, high } = self.region();
                (place.z - low.z) / (high.z - low.z)
            }
        }
    }

    /// Whether it reaches farther than anything that a camera frames: a slab, a shell.
    pub fn is_endless(&self) -> bool {
        match self {
            Self::Box(region) => (region.high - region.low).max_element() >= ENDLESS,
            Self::Shell { .. } => true,
            Self::Mesh(_) => false,
        }
    }

    /// The box around it.
    pub fn region(&self) -> Region {
        match self {
            Self::Box(region) => *region,
            Self::Shell { outer, .. } => Region { low: DVec3::splat(-outer), high: DVec3::splat(*outer) },
            Self::Mesh(mesh) => mesh.mesh().bounds(),
        }
    }
}

/// Where a ray meets a sphere around the origin; none where it misses or grazes it.
fn sphere(origin: DVec3, way: DVec3, radius: f64) -> Option<[f64; 2]> {
    let square = way.length_squared();
    let middle = -origin.dot(way) / square;
    // The distance from the middle of the sphere as a difference of two squares, which keeps its digits far out.
    let nearest = (origin + way * middle).length();
    let half = (radius - nearest) * (radius + nearest) / square;
    (half > 0.0).then(|| [middle - half.sqrt(), middle + half.sqrt()])
}

/// A vector of length 1 in its direction, whatever its length: the square of a short one would be 0. None for 0 and for what is not finite.
pub fn unit(vector: DVec3) -> Option<DVec3> {
    let largest = vector.abs().max_element();
    (largest > 0.0 && vector.is_finite()).then(|| (vector / largest).normalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_and_domains_are_one() {
        for text in ["object", "slab:-3,700.5", "shell:0,0,-6360000,6361500,6365000"] {
            assert_eq!(text.parse::<Domain>().expect("known").to_string(), text);
        }
        for text in ["", "cube", "slab", "slab:1", "slab:a,b", "shell:1,2", "object:1"] {
            assert!(text.parse::<Domain>().expect_err("refused").to_string().contains("slab:BOTTOM,TOP"), "{text}");
        }
    }

    #[test]
    fn rays_through_a_shell_have_up_to_two_parts() {
        let shell = Outline::Shell { inner: 1.0, outer: 2.0 };
        let two = |start: f64, first: f64, gap: f64, second: f64| Parts {
            start,
            length: first + second,
            gaps: vec![Gap { passed: first, outside: gap }],
        };
        let found = shell.parts(DVec3::new(-5.0, 0.0, 0.0), DVec3::X);
        assert_eq!(found, two(3.0, 1.0, 2.0, 1.0));
        let found = shell.parts(DVec3::ZERO, DVec3::X);
        assert_eq!(found, Parts::single(1.0, 1.0));
        let found = shell.parts(DVec3::new(0.0, 1.5, 0.0), DVec3::X);
        assert!(found.start == 0.0 && (found.length - 1.75_f64.sqrt()).abs() < 1e-15 && found.gaps.is_empty());
        let found = shell.parts(DVec3::new(1.5, 0.0, 0.0), -2.0 * DVec3::X);
        assert_eq!(found, two(0.0, 0.25, 1.0, 0.5));
        assert_eq!(shell.parts(DVec3::new(0.0, 2.5, 0.0), DVec3::X), Parts::default());
        assert_eq!(shell.parts(DVec3::new(3.0, 0.0, 0.0), DVec3::X), Parts::default());
        assert_eq!(shell.parts_to_light(DVec3::new(1.5, 0.0, 0.0), DVec3::NEG_X), Parts::single(0.0, 0.5));
        assert_eq!(shell.height(DVec3::new(0.0, 1.25, 0.0)), 0.25);
        assert!(shell.holds(DVec3::new(0.0, 1.25, 0.0)) && !shell.holds(DVec3::X) && !shell.holds(DVec3::ZERO));
    }

    #[test]
    fn distances_skip_the_gaps_between_any_number_of_parts() {
        let parts = Parts::of(&[[1.0, 2.0], [4.0, 4.5], [5.0, 8.0]]);
        assert_eq!((parts.start, parts.length), (1.0, 4.5));
        assert_eq!(
            [0.5, 1.0, 1.25, 1.5, 1.75, 4.5].map(|passed| parts.distance(passed)),
            [0.5, 1.0, 3.25, 3.5, 4.25, 7.0]
        );
        let held = [0.0, 0.5, 1.0, 2.0, 3.0, 3.5, 3.75, 4.0, 7.0].map(|distance| parts.holds(distance));
        assert_eq!(held, [true, true, true, false, true, true, false, true, true]);
        assert!(!parts.holds(-0.1) && !parts.holds(7.1));
        for (limit, length, gaps) in
            [(-1.0, 0.0, 0), (0.5, 0.5, 0), (2.0, 1.0, 0), (3.25, 1.25, 1), (5.0, 2.5, 2), (9.0, 4.5, 2)]
        {
            let mut cut = parts.clone();
            cut.end_at(limit);
            assert_eq!((cut.length, cut.gaps.len()), (length, gaps), "{limit}");
        }
    }
}
