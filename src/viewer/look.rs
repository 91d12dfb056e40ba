//! What is looked at: the scene's camera moved around the density, its suns turned, the size of the picture.

use crate::scene::{LightKind, Projection, Scene, matrix_from_glam, matrix_to_glam};
use glam::{DMat3, DMat4, DVec3};
use std::f64::consts::FRAC_PI_2;

/// A view. The default is the scene's own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// Radians around the world's z axis, and above where the camera is in the scene.
    pub orbit: [f64; 2],
    /// Distance from the middle of the density over that of the scene's camera, above 0.
    pub distance: f64,
    /// What the camera is moved by to the right and up, in distances from the middle of the density.
    pub pan: [f64; 2],
    /// Radians that the suns are turned by around the world's z axis, and upwards.
    pub sun: [f64; 2],
    /// Factor on the strength of the suns.
    pub sun_strength: f64,
    /// Pixels of the picture over those of the scene's along an axis, above 0.
    pub scale: f64,
}

impl Default for Look {
    fn default() -> Self {
        Self { orbit: [0.0; 2], distance: 1.0, pan: [0.0; 2], sun: [0.0; 2], sun_strength: 1.0, scale: 1.0 }
    }
}

/// Closest to the zenith that a sun is turned, in radians.
const FROM_ZENITH: f64 = 1e-3;

impl Look {
    /// Whether the camera is the scene's.
    pub fn is_home(&self) -> bool {
        let Self { orbit, distance, pan, .. } = Self::default();
        (self.orbit, self.distance, self.pan) == (orbit, distance, pan)
    }

    /// Whether the picture is one of the scene as it is.
    pub fn is_of_scene(&self) -> bool {
        *self == Self::default()
    }

    /// Pixels of a picture.
    pub fn size(&self, scene: &Scene) -> [u32; 2] {
        scene.image_size().map(|side| (f64::from(side) * self.scale).round().max(1.0) as u32)
    }

    /// The scene as it is looked at; `centre` is what the camera goes around. The scene itself, to the bit, for its own view.
    pub fn scene(&self, scene: &Scene, centre: DVec3) -> Scene {
        let mut seen = scene.clone();
        if self.scale != 1.0 {
            seen.film.resolution = self.size(scene);
            seen.film.resolution_percentage = 100;
        }
        if !self.is_home() {
            self.move_camera(&mut seen, centre);
        }
        for light in &mut seen.lights {
            if matches!(light.kind, LightKind::Sun { .. }) {
                light.strength *= self.sun_strength as f32;
                if self.sun != [0.0; 2] {
                    light.matrix_world = matrix_from_glam(self.turned_sun(matrix_to_glam(&light.matrix_world)));
                }
            }
        }
        seen
    }

    fn move_camera(&self, scene: &mut Scene, centre: DVec3) {
        let matrix = matrix_to_glam(&scene.camera.matrix_world);
        let [longitude, latitude] = self.orbit;
        let away = matrix.w_axis.truncate() - centre;
        let side = DVec3::Z.cross(away).try_normalize().unwrap_or(DVec3::X);
        let turn = DMat3::from_rotation_z(longitude) * DMat3::from_axis_angle(side, -latitude);
        let distance = if scene.camera.projection == Projection::Orthographic { 1.0 } else { self.distance };
        if scene.camera.projection == Projection::Orthographic {
            scene.camera.ortho_scale *= self.distance as f32;
        }
        let [right, up, back] = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|axis| turn * axis.truncate());
        let pan = |axis: DVec3, part: f64| axis.normalize_or_zero() * part * away.length() * self.distance;
        let place = centre + turn * away * distance + pan(right, self.pan[0]) + pan(up, self.pan[1]);
        scene.camera.matrix_world =
            matrix_from_glam(DMat4::from_cols(right.extend(0.0), up.extend(0.0), back.extend(0.0), place.extend(1.0)));
    }

    /// A sun's matrix, turned: it shines along its -z axis.
    fn turned_sun(&self, matrix: DMat4) -> DMat4 {
        let [around, upwards] = self.sun;
        let towards = matrix.z_axis.truncate().normalize_or_zero();
        let height = towards.z.clamp(-1.0, 1.0).asin();
        let most = FRAC_PI_2 - FROM_ZENITH;
        let raised = (height + upwards).clamp(-most, most) - height;
        let side = towards.cross(DVec3::Z).try_normalize().unwrap_or(DVec3::X);
        let turn = DMat3::from_rotation_z(around) * DMat3::from_axis_angle(side, raised);
        DMat4::from_mat3(turn) * matrix
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene() -> Scene {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/parity/scenes/procedural-clouds.scene.json");
        Scene::load(std::path::Path::new(folder)).expect("a scene of the project")
    }

    fn place(scene: &Scene) -> DVec3 {
        matrix_to_glam(&scene.camera.matrix_world).w_axis.truncate()
    }

    #[test]
    fn the_scenes_own_view_is_the_scene() {
        let scene = scene();
        assert_eq!(Look::default().scene(&scene, DVec3::ONE).content_hash(), scene.content_hash());
    }

    /// An orbit keeps the distance and where the camera looks relative to the centre; going around once is going nowhere. Roundings: the
    /// file's f32, some 1e-7 of places of a few metres.
    #[test]
    fn an_orbit_goes_around() {
        let scene = scene();
        let centre = DVec3::new(0.3, -0.2, 0.1);
        let look = |orbit, distance| Look { orbit, distance, ..Look::default() }.scene(&scene, centre);
        let home = (place(&scene) - centre).length();
        for orbit in [[0.5, 0.0], [0.0, 0.2], [-2.0, -0.4]] {
            for distance in [0.5, 1.0, 3.0] {
                let moved = look(orbit, distance);
                assert!(((place(&moved) - centre).length() - distance * home).abs() < 1e-5 * home * distance);
                let [before, after] = [&scene, &moved].map(|scene| {
                    let matrix = matrix_to_glam(&scene.camera.matrix_world);
                    let ahead = -matrix.z_axis.truncate().normalize();
                    ahead.dot((centre - matrix.w_axis.truncate()).normalize())
                });
                assert!((before - after).abs() < 1e-5, "{before} {after}");
            }
        }
        let around = look([2.0 * std::f64::consts::PI, 0.0], 1.0);
        assert!((place(&around) - place(&scene)).length() < 1e-5 * home);
        let above = look([0.0, 0.3], 1.0);
        assert!(place(&above).z > place(&scene).z, "a latitude above 0 is upwards");
    }

    #[test]
    fn a_sun_is_raised_and_stops_at_the_zenith() {
        let scene = scene();
        let height = |sun| {
            let turned = Look { sun, ..Look::default() }.scene(&scene, DVec3::ZERO);
            let light = turned.lights.iter().find(|light| matches!(light.kind, LightKind::Sun { .. })).expect("a sun");
            matrix_to_glam(&light.matrix_world).z_axis.truncate().normalize().z.asin()
        };
        let own = height([0.0, 0.0]);
        assert!((height([1.0, 0.2]) - own - 0.2).abs() < 1e-5);
        assert!((height([1.0, 9.0]) - FRAC_PI_2).abs() < 2.0 * FROM_ZENITH);
        assert!((height([0.0, -9.0]) + FRAC_PI_2).abs() < 2.0 * FROM_ZENITH);
    }
}
