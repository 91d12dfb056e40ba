//! Scenes as files of studies and tunings list them: committed scenes with other values, suns and cameras.

use crate::base::error::{Error, Result};
use crate::scene::{self, Scene};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneAxis {
    /// The scene file, relative to the study file.
    pub file: String,
    /// Its name in the results; the scene's own if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Changes of stored values: `"Density=10"`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub set: Vec<String>,
    /// Scattering events beyond the first, instead of the scene's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub volume_bounces: Option<u32>,
    /// Azimuth from +x towards +y and elevation, in degrees, from where the suns shine.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sun: Option<[f64; 2]>,
    /// The same of the camera, which looks at the centre of the volume's bounds from the distance that it has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<[f64; 2]>,
}

/// The scenes of a list, which have different names, at a resolution; `place` says where the list stands.
pub fn load_scenes(axes: &[SceneAxis], folder: &Path, resolution: [u32; 2], place: &str) -> Result<Vec<Scene>> {
    let mut scenes: Vec<Scene> = Vec::new();
    for axis in axes {
        let mut scene = Scene::load(&folder.join(&axis.file))?;
        axis.prepare(&mut scene, resolution)?;
        if scenes.iter().any(|other| other.name == scene.name) {
            return Err(Error::new(
                format!("{place}, {}", axis.file),
                format!("a second scene named \"{}\"", scene.name),
                "scenes of different names, by which results are told apart",
                "Give one of them another name, or take it out.",
            ));
        }
        scenes.push(scene);
    }
    Ok(scenes)
}

impl SceneAxis {
    /// A file as it is.
    pub fn new(file: String) -> Self {
        Self { file, name: None, set: Vec::new(), volume_bounces: None, sun: None, camera: None }
    }

    /// Makes a scene the one that is asked for, at a resolution.
    pub fn prepare(&self, scene: &mut Scene, resolution: [u32; 2]) -> Result<()> {
        self.set.iter().try_for_each(|assignment| scene.set(assignment))?;
        if let Some(name) = &self.name {
            scene.name.clone_from(name);
        }
        if let Some(bounces) = self.volume_bounces {
            scene.set_volume_bounces(bounces);
        }
        if let Some(angles) = self.sun {
            let axes = scene::axes_from(angles);
            for light in &mut scene.lights {
                scene::put_axes(&mut light.matrix_world, axes, None);
            }
        }
        if let Some(angles) = self.camera {
            let axes = scene::axes_from(angles);
            let bounds = &scene.volume.bounds;
            let [low, high] = [bounds.min, bounds.max].map(|corner| DVec3::from(corner.map(f64::from)));
            let centre = scene::matrix_to_glam(&scene.volume.matrix_world).transform_point3((low + high) / 2.0);
            let eye = scene::matrix_to_glam(&scene.camera.matrix_world).transform_point3(DVec3::ZERO);
            let place = centre + axes.z_axis * eye.distance(centre);
            scene::put_axes(&mut scene.camera.matrix_world, axes, Some(place));
        }
        scene.film.resolution = resolution;
        scene.film.resolution_percentage = 100;
        Ok(())
    }
}

/// Refuses a picture without pixels, or one that no file holds.
pub(crate) fn check_resolution(resolution: [u32; 2], place: &str) -> Result<()> {
    if resolution.iter().all(|side| (1..=16384).contains(side)) {
        return Ok(());
    }
    let found = format!("{resolution:?}");
    Err(Error::new(format!("{place}, resolution"), found, "1 to 16384 pixels per side", "Correct the file."))
}

#[cfg(test)]
mod tests {
    use super::*;
    use indexmap::IndexMap;

    #[test]
    fn suns_and_cameras_stand_where_the_angles_say() {
        let text = r#"{ file = "x", sun = [90.0, 30.0], camera = [0.0, 0.0] }"#;
        let axis: SceneAxis =
            toml::from_str::<IndexMap<String, SceneAxis>>(&format!("scene = {text}")).unwrap()["scene"].clone();
        let mut scene = Scene::load(Path::new("parity/scenes/clouds-in-daylight.scene.json")).expect("a scene");
        let before = scene::matrix_to_glam(&scene.camera.matrix_world).w_axis.truncate().length();
        axis.prepare(&mut scene, [8, 4]).expect("prepared");
        let light = scene::matrix_to_glam(&scene.lights[0].matrix_world);
        let towards = DVec3::new(0.0, 30f64.to_radians().cos(), 0.5);
        assert!((light.z_axis.truncate() - towards).length() < 1e-6, "{light}");
        let camera = scene::matrix_to_glam(&scene.camera.matrix_world);
        // The box is centred at the origin: the camera stands on the x axis, level, and looks along -x.
        assert!((camera.w_axis.truncate() - DVec3::X * before).length() < 1e-5, "{camera}");
        assert!(
            (camera.z_axis.truncate() - DVec3::X).length() < 1e-6
                && (camera.y_axis.truncate() - DVec3::Z).length() < 1e-6
        );
        assert!((camera.determinant() - 1.0).abs() < 1e-6, "no mirror");
        assert_eq!(scene.film.resolution, [8, 4]);
    }
}
