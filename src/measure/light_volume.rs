//! Light volumes of engines: the cloud of an engine under the lights of a scene, path traced beforehand.

use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::engines::Engine;
use crate::engines::march::light_volume::columns;
use crate::integrators::path::incoming::incoming;
use crate::integrators::path::{GivenMedium, Subject};
use crate::media::light_volume::{LightGrid, LightVolume, LightVolumeSettings, MOST_BANDS, MOST_CELLS, MOST_PATHS};
use crate::scene::Scene;
use crate::view::lights::suns;
use glam::DVec3;
use std::sync::Arc;
use std::time::Instant;

/// Refuses settings out of range; `place` says where they stand.
pub fn check(settings: &LightVolumeSettings, place: &str) -> Result<()> {
    let LightVolumeSettings { cells, paths, bands, shadow_cells, .. } = *settings;
    for (name, value, least, most) in [
        ("cells", cells, 1, MOST_CELLS),
        ("paths", paths, 1, MOST_PATHS),
        ("bands", bands, 0, MOST_BANDS),
        ("shadow_cells", shadow_cells, 0, MOST_CELLS),
    ] {
        if !(least..=most).contains(&value) {
            let expected = format!("a whole number from {least} to {most}");
            return Err(Error::new(format!("{place}.{name}"), value.to_string(), expected, "Correct the number."));
        }
    }
    Ok(())
}

/// The light of a scene in the cloud of an engine, whose density and phase function are as they are in it. An error where the engine has no medium
/// that light transport knows.
pub fn found(
    scene: &Scene,
    engine: &Engine,
    settings: &LightVolumeSettings,
    progress: Progress<'_>,
) -> Result<Arc<LightVolume>> {
    check(settings, "light volume")?;
    let begin = Instant::now();
    let medium = GivenMedium { identity: engine.medium_identity(), object: Arc::new(engine.medium()?) };
    let grid = LightGrid::over(&engine.density, &engine.container.to_local, settings.cells);
    let to_world = engine.container.to_local.inverse();
    let places: Vec<DVec3> = grid.read.iter().map(|&index| to_world.transform_point3(grid.place(index))).collect();
    let light = match places.is_empty() {
        true => Vec::new(),
        false => incoming(Subject { scene, medium: Some(&medium) }, settings, &places, progress)?,
    };
    let suns: Vec<DVec3> = suns(scene)?.into_iter().map(|(towards, _)| towards).collect();
    let columns = match settings.shadow_cells {
        0 => None,
        cells => Some(columns(&engine.container, &engine.density, &suns, cells)?),
    };
    Ok(Arc::new(LightVolume::new(grid, *settings, &light, suns, columns, begin.elapsed().as_secs_f64())))
}
