//! Camera rays as Cycles casts them.
//!
//! Raster coordinates run from the bottom-left corner, in pixels; the camera looks along its local
//! -Z with +Y up; the scale of the camera object is ignored. Everything is f64: a twin on the
//! adapter receives finished numbers.

use crate::base::arrays::Mapped;
use crate::base::error::{Error, Result};
use crate::scene::{self, Projection, Scene, SensorFit};
use glam::{DMat3, DVec2, DVec3};

/// A ray in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Start in metres.
    pub origin: DVec3,
    /// Unit direction.
    pub direction: DVec3,
    /// Distance along the ray at which the near clip lies.
    pub near: f64,
    /// Distance along the ray at which the far clip lies. A medium that reaches across it is not
    /// seen at all.
    pub far: f64,
}

/// Where a camera's rays go, as a plane in world space: the direction through a raster position (x, y), in pixels from the bottom-left
/// corner, is that of corner + x across + y up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RasterPlane {
    /// Through the bottom-left corner of the picture.
    pub corner: DVec3,
    /// What a pixel to the right adds; nothing where all rays are parallel.
    pub across: DVec3,
    /// What a pixel upwards adds.
    pub up: DVec3,
}

impl RasterPlane {
    /// Unit direction of the ray through a raster position.
    pub fn direction(&self, raster: DVec2) -> DVec3 {
        (self.corner + self.across * raster.x + self.up * raster.y).normalize()
    }

    /// Whether all rays go one way.
    pub fn is_parallel(&self) -> bool {
        self.across == DVec3::ZERO
    }
}

/// A camera for one picture size.
#[derive(Debug, Clone)]
pub struct Camera {
    origin: DVec3,
    rotation: DMat3,
    projection: Projection,
    size: DVec2,
    /// Scale of the normalised coordinates, and what the shift adds, in the plane at distance 1
    /// (perspective) or in metres (orthographic).
    scale: DVec2,
    offset: DVec2,
    longitude: [f64; 2],
    latitude: [f64; 2],
    clip: [f64; 2],
}

impl Camera {
    /// The camera of `scene` for a picture of `width` x `height` pixels.
    pub fn new(scene: &Scene, [width, height]: [u32; 2]) -> Result<Self> {
        let camera = &scene.camera;
        let matrix = scene::matrix_to_glam(&camera.matrix_world);
        let columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis].mapped(|column| column.truncate().normalize());
        let size = DVec2::new(f64::from(width), f64::from(height));
        let frame = size * DVec2::from(scene.film.pixel_aspect.mapped(f64::from));
        let horizontal = match camera.sensor_fit {
            SensorFit::Auto => frame.x > frame.y,
            SensorFit::Horizontal => true,
            SensorFit::Vertical => false,
        };
        // With the fit AUTO the sensor width is the fitted length even when the height is fitted.
        let sensor = match camera.sensor_fit {
            SensorFit::Vertical => camera.sensor_height,
            _ => camera.sensor_width,
        };
        let extent = if horizontal { DVec2::new(1.0, frame.y / frame.x) } else { DVec2::new(frame.x / frame.y, 1.0) };
        let half = match camera.projection {
            Projection::Orthographic => f64::from(camera.ortho_scale) / 2.0,
            _ => f64::from(sensor) / (2.0 * f64::from(camera.focal_length)),
        };
        let panorama = match (&camera.panorama, camera.projection) {
            (Some(panorama), _) => panorama.clone(),
            (None, Projection::Equirectangular) => {
                return Err(Error::new(
                    "$.camera.panorama",
                    "nothing",
                    "the angular range of an equirectangular camera",
                    "Export the scene again.",
                ));
            }
            (None, _) => {
                scene::Panorama { longitude_min: 0.0, longitude_max: 0.0, latitude_min: 0.0, latitude_max: 0.0 }
            }
        };
        Ok(Self {
            origin: matrix.w_axis.truncate(),
            rotation: DMat3::from_cols(columns[0], columns[1], columns[2]),
            projection: camera.projection,
            size,
            scale: extent * half,
            offset: DVec2::from(camera.shift.mapped(f64::from)) * 2.0 * half,
            longitude: [panorama.longitude_min, panorama.longitude_max].mapped(f64::from),
            latitude: [panorama.latitude_min, panorama.latitude_max].mapped(f64::from),
            clip: [camera.clip_start, camera.clip_end].mapped(f64::from),
        })
    }

    /// Where a point of world space is in the picture, -1 to 1 from left to right and from bottom to top, and the cosine between the
    /// view axis and the direction to it. Points behind a perspective camera appear mirrored. None in a panorama.
    pub fn device_coordinates(&self, point: DVec3) -> Option<(DVec2, f64)> {
        let local = self.rotation.transpose() * (point - self.origin);
        let plane = match self.projection {
            Projection::Perspective => local.truncate() / -local.z,
            Projection::Orthographic => local.truncate(),
            Projection::Equirectangular => return None,
        };
        Some(((plane - self.offset) / self.scale, -local.z / local.length()))
    }

    /// Pixels of the picture along its axes.
    pub fn size(&self) -> [f64; 2] {
        self.size.into()
    }

    /// Unit vector along the view axis. None in a panorama.
    pub fn forward(&self) -> Option<DVec3> {
        (self.projection != Projection::Equirectangular).then_some(-self.rotation.z_axis)
    }

    /// The directions of all rays as a plane that the raster lies in. None in a panorama.
    pub fn plane(&self) -> Option<RasterPlane> {
        let step = 2.0 * self.scale / self.size;
        let plane = |corner: DVec3, step: DVec2| RasterPlane {
            corner: self.rotation * corner,
            across: self.rotation * DVec3::X * step.x,
            up: self.rotation * DVec3::Y * step.y,
        };
        match self.projection {
            Projection::Perspective => Some(plane((self.offset - self.scale).extend(-1.0), step)),
            Projection::Orthographic => Some(plane(DVec3::NEG_Z, DVec2::ZERO)),
            Projection::Equirectangular => None,
        }
    }

    /// The ray through a raster position, in pixels from the bottom-left corner.
    pub fn ray(&self, raster: DVec2) -> Ray {
        let normalised = raster / self.size;
        let plane = (normalised * 2.0 - 1.0) * self.scale + self.offset;
        // Clip distances are planar, except in a panorama.
        let (local_origin, local_direction, stretch) = match self.projection {
            Projection::Perspective => {
                let direction = plane.extend(-1.0);
                (DVec3::ZERO, direction.normalize(), direction.length())
            }
            Projection::Orthographic => (plane.extend(0.0), DVec3::NEG_Z, 1.0),
            Projection::Equirectangular => {
                let longitude = self.longitude[0] + (self.longitude[1] - self.longitude[0]) * normalised.x;
                let latitude = self.latitude[0] + (self.latitude[1] - self.latitude[0]) * normalised.y;
                let direction =
                    DVec3::new(latitude.cos() * longitude.sin(), latitude.sin(), -latitude.cos() * longitude.cos());
                (DVec3::ZERO, direction, 1.0)
            }
        };
        Ray {
            origin: self.origin + self.rotation * local_origin,
            direction: self.rotation * local_direction,
            near: self.clip[0] * stretch,
            far: self.clip[1] * stretch,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    /// f32 settings enter f64 arithmetic: their rounding (6e-8) times a few operations.
    const TOLERANCE: f64 = 1e-6;

    fn scene() -> Scene {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/scenes/procedural-clouds.scene.json");
        let mut scene = Scene::load(&path).expect("the committed scene loads");
        scene.camera.matrix_world =
            [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        scene
    }

    fn close(found: DVec3, expected: [f64; 3]) {
        assert!((found - DVec3::from(expected)).length() < TOLERANCE, "{found} is not {expected:?}");
    }

    #[test]
    fn the_edge_of_a_perspective_frame_is_at_half_the_sensor_over_the_focal_length() {
        let mut scene = scene();
        for (size, fit, expected) in [
            // Half of 36 mm over 50 mm across the fitted side, in proportion across the other.
            ([320, 180], SensorFit::Auto, [0.36, 0.36 * 180.0 / 320.0]),
            ([180, 320], SensorFit::Auto, [0.36 * 180.0 / 320.0, 0.36]),
            ([180, 320], SensorFit::Horizontal, [0.36, 0.36 * 320.0 / 180.0]),
            ([320, 180], SensorFit::Vertical, [0.24 * 320.0 / 180.0, 0.24]),
        ] {
            scene.camera.sensor_fit = fit;
            let camera = Camera::new(&scene, size).expect("a camera");
            let corner = camera.ray(DVec2::new(f64::from(size[0]), f64::from(size[1])));
            close(corner.direction / -corner.direction.z, [expected[0], expected[1], -1.0]);
            // The near plane is planar: 0.1 m deep, farther along the slanted ray.
            assert!((corner.near * -corner.direction.z - 0.1).abs() < TOLERANCE);
            let centre = camera.ray(DVec2::new(f64::from(size[0]) / 2.0, f64::from(size[1]) / 2.0));
            close(centre.direction, [0.0, 0.0, -1.0]);
        }
    }

    #[test]
    fn a_shift_of_one_moves_the_view_by_a_sensor_length() {
        let mut scene = scene();
        scene.camera.shift = [1.0, 0.0];
        let camera = Camera::new(&scene, [320, 180]).expect("a camera");
        let centre = camera.ray(DVec2::new(160.0, 90.0)).direction;
        close(centre / -centre.z, [36.0 / 50.0, 0.0, -1.0]);
    }

    #[test]
    fn pixel_aspect_changes_the_fitted_side() {
        let mut scene = scene();
        scene.film.pixel_aspect = [1.0, 2.0];
        // 100 x 80 pixels of double height are a frame of 100 x 160: the height is fitted.
        let camera = Camera::new(&scene, [100, 80]).expect("a camera");
        let corner = camera.ray(DVec2::new(100.0, 80.0)).direction;
        close(corner / -corner.z, [0.36 * 100.0 / 160.0, 0.36, -1.0]);
    }

    #[test]
    fn the_plane_of_the_raster_holds_the_rays() {
        let mut scene = scene();
        scene.camera.matrix_world =
            [[0.36, 0.48, -0.8, 1.0], [-0.8, 0.6, 0.0, -5.0], [0.48, 0.64, 0.6, 0.25], [0.0, 0.0, 0.0, 1.0]];
        scene.camera.shift = [0.3, -0.2];
        for projection in [Projection::Perspective, Projection::Orthographic] {
            scene.camera.projection = projection;
            let camera = Camera::new(&scene, [31, 18]).expect("a camera");
            let plane = camera.plane().expect("no panorama");
            for raster in [DVec2::ZERO, DVec2::new(31.0, 0.0), DVec2::new(3.25, 17.5)] {
                close(plane.direction(raster), camera.ray(raster).direction.to_array());
            }
            assert_eq!(plane.is_parallel(), projection == Projection::Orthographic);
        }
    }

    #[test]
    fn the_scale_of_the_camera_is_ignored_and_its_rotation_is_not() {
        let mut scene = scene();
        // Quarter turn about X with scale (2, 3, 0.5): the view goes along +Y, its up along +Z.
        scene.camera.matrix_world =
            [[2.0, 0.0, 0.0, 1.0], [0.0, 0.0, -0.5, -5.0], [0.0, 3.0, 0.0, 0.25], [0.0, 0.0, 0.0, 1.0]];
        let camera = Camera::new(&scene, [320, 180]).expect("a camera");
        let ray = camera.ray(DVec2::new(320.0, 90.0));
        close(ray.origin, [1.0, -5.0, 0.25]);
        close(ray.direction / ray.direction.y, [0.36, 1.0, 0.0]);
    }

    #[test]
    fn an_orthographic_view_is_as_wide_as_its_scale() {
        let mut scene = scene();
        scene.camera.projection = Projection::Orthographic;
        scene.camera.ortho_scale = 6.0;
        scene.camera.shift = [0.0, 0.5];
        let camera = Camera::new(&scene, [320, 160]).expect("a camera");
        let corner = camera.ray(DVec2::new(320.0, 160.0));
        close(corner.origin, [3.0, 1.5 + 3.0, 0.0]);
        close(corner.direction, [0.0, 0.0, -1.0]);
        assert!((corner.far - 100.0).abs() < TOLERANCE);
    }

    #[test]
    fn a_panorama_looks_along_minus_z_in_its_centre_and_right_grows_in_longitude() {
        let mut scene = scene();
        scene.camera.projection = Projection::Equirectangular;
        assert!(Camera::new(&scene, [8, 4]).is_err());
        let [pi, quarter] = [PI, FRAC_PI_2].map(|angle| angle as f32);
        scene.camera.panorama = Some(scene::Panorama {
            longitude_min: -pi,
            longitude_max: pi,
            latitude_min: -quarter,
            latitude_max: quarter,
        });
        let camera = Camera::new(&scene, [8, 4]).expect("a camera");
        close(camera.ray(DVec2::new(4.0, 2.0)).direction, [0.0, 0.0, -1.0]);
        close(camera.ray(DVec2::new(6.0, 2.0)).direction, [1.0, 0.0, 0.0]);
        close(camera.ray(DVec2::new(4.0, 4.0)).direction, [0.0, 1.0, 0.0]);
    }
}
