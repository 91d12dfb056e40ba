//! Where the density of an engine is: in the scene's object, between two heights, or between two spheres.

use crate::base::choice::choice;
use crate::base::error::{Error, Result};
use crate::media::objects::box_of;
use crate::media::region::Region;
use crate::scene::{self, Scene};
use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Half of what an endless side of a slab is, in units of the density's frame: beyond what a camera sees, and within what f32 squares.
const ENDLESS: f64 = 1e9;

/// Where a density is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Domain {
    /// The box of the scene's volume object, whatever its shape: turned, stretched, sheared.
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
#[derive(Debug, Clone, Copy, PartialEq)]
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
}

/// A domain in a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Container {
    /// The domain.
    pub domain: Domain,
    /// World to the frame in which the density is evaluated: the object's, or the world's around the centre of a shell.
    pub to_local: DMat4,
    /// What bounds the density there.
    pub outline: Outline,
    /// Metres of the engine's unit of length. Of a box: the side of the cube of its volume, so that of a cube the side.
    pub unit: f64,
}

/// Up to two parts of a ray, in units of length.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Segments {
    /// Distance at which the first part begins.
    pub start: f64,
    /// Length of the first part.
    pub first: f64,
    /// Length of what lies between the parts.
    pub gap: f64,
    /// Length of the second part; 0 where there is none.
    pub second: f64,
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
                let region = box_of(volume)?;
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
                Ok(Container { domain: self, to_local: to_world.inverse(), outline: Outline::Box(region), unit })
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
    /// The parts of a ray from a place on, `way` being the displacement per unit of length.
    pub fn segments(&self, origin: DVec3, way: DVec3) -> Segments {
        match self {
            Self::Box(region) => match region.segment(origin, way) {
                Some((enter, leave)) if leave > 0.0 => {
                    let start = enter.max(0.0);
                    Segments { start, first: leave - start, gap: 0.0, second: 0.0 }
                }
                _ => Segments::default(),
            },
            Self::Shell { inner, outer } => {
                let Some([enter, leave]) = sphere(origin, way, *outer).filter(|[_, leave]| *leave > 0.0) else {
                    return Segments::default();
                };
                let start = enter.max(0.0);
                match sphere(origin, way, *inner).filter(|[_, end]| *end > 0.0) {
                    None => Segments { start, first: leave - start, gap: 0.0, second: 0.0 },
                    // Within the inner sphere there is nothing before its far side.
                    Some([begin, end]) if begin <= start => {
                        Segments { start: end, first: (leave - end).max(0.0), gap: 0.0, second: 0.0 }
                    }
                    Some([begin, end]) => {
                        Segments { start, first: begin - start, gap: end - begin, second: (leave - end).max(0.0) }
                    }
                }
            }
        }
    }

    /// Length of a ray from a place inside until it leaves for the first time; 0 outside.
    pub fn exit(&self, place: DVec3, way: DVec3) -> f64 {
        match self {
            Self::Box(region) => region.segment(place, way).map_or(0.0, |(_, leave)| leave.max(0.0)),
            Self::Shell { .. } => {
                let Segments { start, first, .. } = self.segments(place, way);
                if start == 0.0 { first } else { 0.0 }
            }
        }
    }

    /// Whether a place is inside; on a face is outside.
    pub fn holds(&self, place: DVec3) -> bool {
        match self {
            Self::Box(region) => place.cmpgt(region.low).all() && place.cmplt(region.high).all(),
            Self::Shell { inner, outer } => {
                let radius = place.length();
                *inner < radius && radius < *outer
            }
        }
    }

    /// The height of a place as a part of the domain's, 0 at its bottom and 1 at its top.
    pub fn height(&self, place: DVec3) -> f64 {
        match self {
            Self::Box(region) => (place.z - region.low.z) / (region.high.z - region.low.z),
            Self::Shell { inner, outer } => (place.length() - inner) / (outer - inner),
        }
    }

    /// Whether it reaches farther than anything that a camera frames: a slab, a shell.
    pub fn is_endless(&self) -> bool {
        match self {
            Self::Box(region) => (region.high - region.low).max_element() >= ENDLESS,
            Self::Shell { .. } => true,
        }
    }

    /// The box around it.
    pub fn region(&self) -> Region {
        match self {
            Self::Box(region) => *region,
            Self::Shell { outer, .. } => Region { low: DVec3::splat(-outer), high: DVec3::splat(*outer) },
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
        let found = shell.segments(DVec3::new(-5.0, 0.0, 0.0), DVec3::X);
        assert_eq!(found, Segments { start: 3.0, first: 1.0, gap: 2.0, second: 1.0 });
        let found = shell.segments(DVec3::ZERO, DVec3::X);
        assert_eq!(found, Segments { start: 1.0, first: 1.0, gap: 0.0, second: 0.0 });
        let found = shell.segments(DVec3::new(0.0, 1.5, 0.0), DVec3::X);
        assert!(found.start == 0.0 && (found.first - 1.75_f64.sqrt()).abs() < 1e-15 && found.second == 0.0);
        let found = shell.segments(DVec3::new(1.5, 0.0, 0.0), -2.0 * DVec3::X);
        assert_eq!(found, Segments { start: 0.0, first: 0.25, gap: 1.0, second: 0.5 });
        assert_eq!(shell.segments(DVec3::new(0.0, 2.5, 0.0), DVec3::X), Segments::default());
        assert_eq!(shell.segments(DVec3::new(3.0, 0.0, 0.0), DVec3::X), Segments::default());
        assert_eq!(shell.exit(DVec3::new(1.5, 0.0, 0.0), DVec3::NEG_X), 0.5);
        assert_eq!(shell.height(DVec3::new(0.0, 1.25, 0.0)), 0.25);
        assert!(shell.holds(DVec3::new(0.0, 1.25, 0.0)) && !shell.holds(DVec3::X) && !shell.holds(DVec3::ZERO));
    }
}
