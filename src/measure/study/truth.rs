//! What errors are measured against: path tracing of the same medium, in independent replicas that a folder keeps.

use crate::base::error::{Error, Result};
use crate::base::ledger::Ledger;
use crate::base::progress::Progress;
use crate::engines;
use crate::engines::defects::Defects;
use crate::gpu::Backend;
use crate::integrators::path;
use crate::integrators::path::{GivenMedium, PathSettings, Subject};
use crate::measure::study::file::Truth;
use crate::scene::Scene;
use crate::scene::image::Image;
use cpu_time::ProcessTime;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;
use std::sync::Arc;

/// Part of a ledger that holds truths.
const PART: &str = "truth";

/// Attribute of a replica: processor seconds that it took, preparation included in the first.
const PROCESSOR_SECONDS: &str = "processor_seconds";

/// The truth of a density in a scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TruthRecord {
    /// Hash of all that it depends on.
    pub id: String,
    /// Name of the scene.
    pub scene: String,
    /// Hash of the scene, at the resolution of the study.
    pub scene_sha256: String,
    /// Density model.
    pub density: String,
    /// Processor time of all replicas.
    pub seconds: f64,
    /// Files of the replicas, relative to the folder.
    pub replicas: Vec<String>,
}

impl TruthRecord {
    /// The replicas.
    pub fn read(&self, folder: &Path) -> Result<Vec<Image>> {
        self.replicas.iter().map(|name| Image::read_exr(&folder.join(name))).collect()
    }
}

impl Truth {
    /// Key of the truth of a density in a scene, for seeds that count on from `seed`.
    pub fn id(&self, ledger: &Ledger, scene: &Scene, density: &str, seed: u32) -> String {
        ledger.key(&json!({"scene": scene.content_hash(), "density": density, "truth": self, "seed": seed}))
    }

    /// The truth of that id from its files in a ledger, or rendered there: the replicas that are missing.
    pub fn replicas(
        &self,
        scene: &Scene,
        density: &str,
        id: &str,
        seed: u32,
        ledger: &Ledger,
        progress: Progress<'_>,
    ) -> Result<(TruthRecord, Vec<Image>)> {
        let folder = ledger.folder().expect("truths are kept");
        if let Some(record) = record(scene, density, id, ledger)? {
            let images = record.read(folder)?;
            return Ok((record, images));
        }
        let name = |seed: u32| format!("truth/{id}.seed-{seed}.exr");
        let seeds = seed..seed + self.replicas;
        let missing: Vec<u32> = seeds.clone().filter(|&seed| !folder.join(name(seed)).exists()).collect();
        if !missing.is_empty() {
            let report = |done: f64, _: &str| progress(done, &format!("truth of {density} in {}", scene.name));
            report(0.0, "");
            let medium = Self::medium(scene, density)?;
            let subject = Subject { scene, medium: medium.as_ref() };
            let settings = PathSettings { samples: self.samples, ..PathSettings::default() };
            let mut begin = ProcessTime::now();
            path::render_each(subject, &settings, Backend::Cpu, &missing, &report, &mut |seed, mut image| {
                image.provenance.insert(PROCESSOR_SECONDS.into(), format!("{:.3}", begin.elapsed().as_secs_f64()));
                begin = ProcessTime::now();
                image.write_exr(&folder.join(name(seed)), false)
            })?;
        }
        let mut record = TruthRecord {
            id: id.to_owned(),
            scene: scene.name.clone(),
            scene_sha256: scene.content_hash(),
            density: density.to_owned(),
            seconds: 0.0,
            replicas: seeds.map(name).collect(),
        };
        let images = record.read(folder)?;
        let seconds = |image: &Image| image.provenance.get(PROCESSOR_SECONDS).and_then(|text| text.parse::<f64>().ok());
        record.seconds = images.iter().filter_map(seconds).sum();
        ledger.write(PART, id, &record)?;
        Ok((record, images))
    }

    /// The medium that path tracing sees: that of the scene, or of a published system with its defects corrected, so that what a defect does
    /// to the medium is an error, too.
    pub fn medium(scene: &Scene, density: &str) -> Result<Option<GivenMedium>> {
        let model = engines::find(density)?;
        if model.is_of_scene {
            return Ok(None);
        }
        let engine = model.engine(scene, &model.values(None, &[])?, &Defects::NONE, 0.0)?;
        Ok(Some(GivenMedium { identity: engine.medium_identity(), object: Arc::new(engine.medium()?) }))
    }
}

/// The record of a truth, if it is there. One of another scene or density is refused.
pub(super) fn record(scene: &Scene, density: &str, id: &str, ledger: &Ledger) -> Result<Option<TruthRecord>> {
    let Some(record) = ledger.read::<TruthRecord>(PART, id)? else { return Ok(None) };
    if record.scene_sha256 != scene.content_hash() || record.density != density {
        return Err(Error::new(
            ledger.file(PART, id).unwrap_or_default().display().to_string(),
            format!("the truth of {} in a scene with the hash {}", record.density, record.scene_sha256),
            format!("that of {density} in {}, {}", scene.name, scene.content_hash()),
            "Remove the file: the truth is rendered again.",
        ));
    }
    Ok(Some(record))
}
