//! Which of many objects hold a place, meet a box or lie along a ray, without asking each: a bounding volume hierarchy over their boxes in the
//! world.
//!
//! Answers are candidates in ascending order. None is missed; whether one really is there is for the caller to look at.

use crate::media::mesh::Leaf;
use crate::media::objects::ObjectMedium;
use crate::media::region::Region;
use bvh::aabb::Aabb;
use bvh::bvh::{Bvh, BvhNode};
use glam::DVec3;
use std::sync::Arc;

/// Widening of boxes relative to their largest coordinate: far above what matrices and their inverses are rounded by, unless they take lengths
/// of 1e9 to 1.
const PADDING: f64 = 1e-6;

/// The boxes of objects, in a tree.
pub struct ObjectIndex {
    tree: Bvh<f64, 3>,
}

impl ObjectIndex {
    /// An index of objects, by their numbers.
    pub fn new(objects: &[Arc<ObjectMedium>]) -> Self {
        let mut leaves: Vec<Leaf> = objects
            .iter()
            .map(|object| {
                let Region { low, high } = object.bounds.surrounding(&object.to_object.inverse());
                let pad = PADDING * low.abs().max(high.abs()).max_element();
                Leaf::new(low - pad, high + pad)
            })
            .collect();
        Self { tree: Bvh::build(&mut leaves) }
    }

    /// Objects that may hold a place of the world.
    pub fn at(&self, place: DVec3, found: &mut Vec<usize>) {
        self.find(|region| place.cmpge(region.low).all() && place.cmple(region.high).all(), found);
    }

    /// Objects that may meet a box of the world.
    pub fn meeting(&self, wanted: &Region, found: &mut Vec<usize>) {
        self.find(|region| region.low.cmple(wanted.high).all() && region.high.cmpge(wanted.low).all(), found);
    }

    /// Objects that a ray of the world may meet between two distances, which may be infinite.
    pub fn along(&self, origin: DVec3, direction: DVec3, [from, to]: [f64; 2], found: &mut Vec<usize>) {
        let meets = |region: &Region| {
            region.segment(origin, direction).is_some_and(|(enter, leave)| enter <= to && leave >= from)
        };
        self.find(meets, found);
    }

    fn find(&self, meets: impl Fn(&Region) -> bool, found: &mut Vec<usize>) {
        found.clear();
        let region = |bounds: &Aabb<f64, 3>| Region {
            low: DVec3::new(bounds.min.x, bounds.min.y, bounds.min.z),
            high: DVec3::new(bounds.max.x, bounds.max.y, bounds.max.z),
        };
        self.descend(0, &|bounds| meets(&region(bounds)), found);
        found.sort_unstable();
    }

    /// Collects what is below a node. A tree of a single object is a leaf, whose box nobody knows any more: a candidate for everything.
    fn descend(&self, node: usize, meets: &impl Fn(&Aabb<f64, 3>) -> bool, found: &mut Vec<usize>) {
        match &self.tree.nodes[node] {
            BvhNode::Node { child_l_index, child_l_aabb, child_r_index, child_r_aabb, .. } => {
                if meets(child_l_aabb) {
                    self.descend(*child_l_index, meets, found);
                }
                if meets(child_r_aabb) {
                    self.descend(*child_r_index, meets, found);
                }
            }
            BvhNode::Leaf { shape_index, .. } => found.push(*shape_index),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use glam::{DMat4, DQuat};
    use rand::{Rng as _, SeedableRng as _};

    fn objects(count: usize) -> Vec<Arc<ObjectMedium>> {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/scenes/homogeneous-cube.scene.json");
        let scene = Scene::load(&path).expect("a committed scene");
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        (0..count)
            .map(|_| {
                let mut vector = |size: f64| DVec3::from([(); 3].map(|()| random.random_range(-size..size)));
                let axis = vector(1.0).normalize();
                let (angle, scale, place) = (vector(3.0).x, vector(1.0).abs() + 0.05, vector(8.0));
                let to_world =
                    DMat4::from_scale_rotation_translation(scale, DQuat::from_axis_angle(axis, angle), place);
                let mut medium = ObjectMedium::new(scene.graph(), &scene.volume).expect("a medium");
                medium.to_object = to_world.inverse();
                Arc::new(medium)
            })
            .collect()
    }

    #[test]
    fn whatever_is_there_is_found_and_little_else() {
        for count in [1, 2, 3, 300] {
            let objects = objects(count);
            let index = ObjectIndex::new(&objects);
            let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(2);
            let (mut found, mut candidates, mut there) = (Vec::new(), 0, 0);
            for _ in 0..2000 {
                let mut vector = |size: f64| DVec3::from([(); 3].map(|()| random.random_range(-size..size)));
                let (place, direction, half) = (vector(9.0), vector(1.0), vector(0.5).abs());
                index.at(place, &mut found);
                assert!(found.is_sorted());
                candidates += found.len();
                for (number, object) in objects.iter().enumerate().filter(|(_, object)| object.holds(place)) {
                    there += 1;
                    assert!(found.contains(&number), "{} at {place}", object.object);
                }
                index.meeting(&Region { low: place - half, high: place + half }, &mut found);
                for (number, object) in objects.iter().enumerate() {
                    // Some place of the box is in the object.
                    let nearest = object.to_object.inverse().transform_point3(DVec3::ZERO);
                    let nearest = nearest.clamp(place - half, place + half);
                    assert!(!object.holds(nearest) || found.contains(&number), "{place} {half}");
                }
                let [from, to] = [-2.0, 7.0];
                index.along(place, direction, [from, to], &mut found);
                for (number, object) in objects.iter().enumerate() {
                    let origin = object.to_object.transform_point3(place);
                    let way = object.to_object.transform_vector3(direction);
                    let met =
                        object.bounds.segment(origin, way).is_some_and(|(enter, leave)| enter <= to && leave >= from);
                    assert!(!met || found.contains(&number), "{place} {direction}");
                }
            }
            // The box around a turned cube is at most 3 sqrt 3 = 5.2 times as large.
            assert!(count < 300 || there > 100 && candidates < 6 * there, "{candidates} candidates for {there}");
        }
    }
}
