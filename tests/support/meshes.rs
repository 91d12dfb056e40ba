//! Closed meshes made from formulas, and two other answers to where a ray is inside one: the triangles one by one, and the solid angle.

use cloudparity::scene::{Bounds, Scene, Shape};
use glam::DVec3;
use std::collections::HashMap;
use std::f64::consts::TAU;

/// Vertices and triangles, which look out of the mesh.
#[derive(Debug, Clone, Default)]
pub struct TestMesh {
    pub vertices: Vec<[f32; 3]>,
    pub triangles: Vec<[u32; 3]>,
}

impl TestMesh {
    /// A sphere of radius 1 from an icosahedron whose triangles are divided into four `levels` times.
    pub fn icosphere(levels: u32) -> Self {
        let golden = f64::midpoint(1.0, 5.0_f64.sqrt());
        let mut places: Vec<DVec3> = [(1.0, golden), (-1.0, golden), (1.0, -golden), (-1.0, -golden)]
            .iter()
            .flat_map(|&(a, b)| [DVec3::new(0.0, a, b), DVec3::new(a, b, 0.0), DVec3::new(b, 0.0, a)])
            .map(DVec3::normalize)
            .collect();
        let near = |a: DVec3, b: DVec3| a.dot(b) > 0.4 && a.dot(b) < 0.5;
        let mut triangles = Vec::new();
        for a in 0..12_u32 {
            for b in a + 1..12 {
                for c in b + 1..12 {
                    let [x, y, z] = [a, b, c].map(|number| places[number as usize]);
                    if near(x, y) && near(y, z) && near(z, x) {
                        triangles.push(if (y - x).cross(z - x).dot(x) > 0.0 { [a, b, c] } else { [a, c, b] });
                    }
                }
            }
        }
        for _ in 0..levels {
            let mut middles = HashMap::new();
            let mut middle = |a: u32, b: u32| {
                *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    places.push((places[a as usize] + places[b as usize]).normalize());
                    places.len() as u32 - 1
                })
            };
            let divided = triangles.iter().flat_map(|&[a, b, c]| {
                let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
                [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
            });
            triangles = divided.collect();
        }
        Self { vertices: places.iter().map(|place| place.as_vec3().to_array()).collect(), triangles }
    }

    /// A torus about Z of radius 1 with a tube of radius 0.3, of as many rings as corners of the tube.
    pub fn torus(count: u32) -> Self {
        let mut mesh = Self::default();
        let angle = |number: u32| f64::from(number % count) / f64::from(count) * TAU;
        for ring in 0..count {
            for corner in 0..count {
                let (along, around) = (angle(ring), angle(corner));
                let radius = 1.0 + 0.3 * around.cos();
                let place = DVec3::new(radius * along.cos(), radius * along.sin(), 0.3 * around.sin());
                mesh.vertices.push(place.as_vec3().to_array());
                let vertex = |ring: u32, corner: u32| ring % count * count + corner % count;
                let [a, b] = [vertex(ring, corner), vertex(ring + 1, corner)];
                let [c, d] = [vertex(ring, corner + 1), vertex(ring + 1, corner + 1)];
                mesh.triangles.extend([[a, b, d], [a, d, c]]);
            }
        }
        mesh
    }

    /// The box between two corners, of twelve triangles.
    pub fn cuboid(low: [f32; 3], high: [f32; 3]) -> Self {
        let corner =
            |number: usize| std::array::from_fn(|axis| if number >> axis & 1 == 1 { high[axis] } else { low[axis] });
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        Self {
            vertices: (0..8).map(corner).collect(),
            triangles: faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        }
    }

    /// Every triangle in four, each with vertices of its own.
    pub fn divided(&self) -> Self {
        let mut mesh = Self::default();
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|vertex| glam::Vec3::from(self.vertices[vertex as usize]));
            let [ab, bc, ca] = [(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0];
            for corners in [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]] {
                let first = mesh.vertices.len() as u32;
                mesh.vertices.extend(corners.map(|corner| corner.to_array()));
                mesh.triangles.push([first, first + 1, first + 2]);
            }
        }
        mesh
    }

    /// The same with every vertex moved.
    pub fn moved(mut self, to: impl Fn(DVec3) -> DVec3) -> Self {
        for vertex in &mut self.vertices {
            *vertex = to(DVec3::from(vertex.map(f64::from))).as_vec3().to_array();
        }
        self
    }

    /// The same with its faces looking inward.
    pub fn turned_inside_out(mut self) -> Self {
        for triangle in &mut self.triangles {
            triangle.swap(1, 2);
        }
        self
    }

    /// Both as one mesh.
    pub fn with(mut self, other: &Self) -> Self {
        let first = self.vertices.len() as u32;
        self.vertices.extend(&other.vertices);
        self.triangles.extend(other.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
        self
    }

    pub fn corners(&self) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        let place = |vertex: u32| DVec3::from(self.vertices[vertex as usize].map(f64::from));
        self.triangles.iter().map(move |triangle| triangle.map(place))
    }

    /// Makes it the outline of a scene's volume.
    pub fn fill(&self, scene: &mut Scene) {
        let ends = |choose: fn(f32, f32) -> f32, start: f32| {
            std::array::from_fn(|axis| self.vertices.iter().map(|vertex| vertex[axis]).fold(start, choose))
        };
        let volume = &mut scene.volume;
        volume.bounds = Bounds { min: ends(f32::min, f32::INFINITY), max: ends(f32::max, f32::NEG_INFINITY) };
        volume.shape = Shape::Mesh { vertices: self.vertices.clone(), triangles: self.triangles.clone() };
    }

    /// Distances at which a line crosses triangles, in their order, and whether from the front: each by itself (Moeller and Trumbore 1997).
    pub fn crossings(&self, origin: DVec3, direction: DVec3) -> Vec<(f64, bool)> {
        let mut found: Vec<(f64, bool)> = self
            .corners()
            .filter_map(|[a, b, c]| {
                let (first, second) = (b - a, c - a);
                let p = direction.cross(second);
                let determinant = first.dot(p);
                let away = origin - a;
                let u = away.dot(p) / determinant;
                let q = away.cross(first);
                let v = direction.dot(q) / determinant;
                let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
                inside.then_some((second.dot(q) / determinant, determinant > 0.0))
            })
            .collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        found
    }

    /// Distance of a place from the nearest triangle.
    pub fn distance(&self, place: DVec3) -> f64 {
        let to_edge = |a: DVec3, b: DVec3| {
            let along = b - a;
            let part = ((place - a).dot(along) / along.length_squared()).clamp(0.0, 1.0);
            place.distance(a + along * part)
        };
        let to_triangle = |[a, b, c]: [DVec3; 3]| {
            let normal = (b - a).cross(c - a).normalize();
            let above = [(a, b), (b, c), (c, a)].iter().all(|&(a, b)| (b - a).cross(place - a).dot(normal) >= 0.0);
            let edges = to_edge(a, b).min(to_edge(b, c)).min(to_edge(c, a));
            if above { (place - a).dot(normal).abs() } else { edges }
        };
        self.corners().map(to_triangle).fold(f64::INFINITY, f64::min)
    }

    /// How often the mesh goes around a place: the solid angle of its triangles over that of the sphere (van Oosterom and Strackee 1983).
    pub fn winding(&self, place: DVec3) -> f64 {
        let angle = |[a, b, c]: [DVec3; 3]| {
            let [a, b, c] = [a - place, b - place, c - place];
            let [x, y, z] = [a.length(), b.length(), c.length()];
            2.0 * a.dot(b.cross(c)).atan2(x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y)
        };
        self.corners().map(angle).sum::<f64>() / (2.0 * TAU)
    }
}
