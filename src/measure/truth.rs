//! What errors are measured against: path tracing of the same medium, in independent replicas that a folder keeps.

use crate::base::error::{Error, Result};
use crate::base::ledger::Ledger;
use crate::base::progress::Progress;
use crate::engines::Selection;
use crate::engines::defects::Defects;
use crate::gpu::Backend;
use crate::integrators::path;
use crate::integrators::path::{GivenMedium, PathSettings, Subject, Tracking};
use crate::measure::errors::FEWEST_REPLICAS;
use crate::measure::seeds;
use crate::scene::Scene;
use crate::scene::image::Image;
use cpu_time::ProcessTime;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::path::Path;
use std::sync::Arc;

/// Part of a ledger that holds truths.
pub const PART: &str = "truth";

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
    /// Where in a pixel its rays pass.
    #[serde(default, skip_serializing_if = "PixelRays::are_filtered")]
    pub rays: PixelRays,
}

/// Where in a pixel the rays of a truth pass. A picture of one ray per pixel, through its centre, samples radiance at points, while the scene's
/// pixel filter takes means over pixels and their neighbours; against a filtered truth that difference would count as an error of
/// the light model.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PixelRays {
    /// Drawn by the scene's pixel filter: what pictures of several rays per pixel converge to.
    #[default]
    Filtered,
    /// All through the pixel's centre: what pictures of one ray per pixel converge to.
    Centres,
}

impl PixelRays {
    /// Those of pictures with so many rays per pixel and axis.
    pub fn of(sub_pixels: u32) -> Self {
        if sub_pixels == 1 { Self::Centres } else { Self::Filtered }
    }

    /// Whether they are of the pixel filter; also what keeps the keys of truths from before there was a choice.
    pub fn are_filtered(&self) -> bool {
        *self == Self::Filtered
    }

    /// Name for readers.
    pub fn label(self) -> &'static str {
        match self {
            Self::Filtered => "through the scene's pixel filter",
            Self::Centres => "through pixel centres",
        }
    }
}

impl TruthRecord {
    /// The replicas.
    pub fn read(&self, folder: &Path) -> Result<Vec<Image>> {
        self.replicas.iter().map(|name| Image::read_exr(&folder.join(name))).collect()
    }

    /// Refuses a record of another scene or density.
    pub fn check(&self, scene: &Scene, density: &str, ledger: &Ledger) -> Result<()> {
        if self.scene_sha256 == scene.content_hash() && self.density == density {
            return Ok(());
        }
        Err(Error::new(
            ledger.file(PART, &self.id).unwrap_or_default().display().to_string(),
            format!("the truth of {} in a scene with the hash {}", self.density, self.scene_sha256),
            format!("that of {density} in {}, {}", scene.name, scene.content_hash()),
            "Remove the file: the truth is rendered again.",
        ))
    }
}

/// Path tracing of the same medium, in independent replicas.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Truth {
    /// Paths per pixel and replica.
    pub samples: u32,
    /// Replicas, at least 6: they say how uncertain the truth is.
    pub replicas: u32,
    /// Voxels per axis of the grid by which path tracing sees a published density model.
    pub voxels: usize,
    /// How its paths find their collisions; all ways have the same mean.
    #[serde(skip_serializing_if = "is_default")]
    pub tracking: Tracking,
}

/// Also what keeps the keys of truths from before there was a choice.
fn is_default(tracking: &Tracking) -> bool {
    *tracking == Tracking::default()
}

impl Default for Truth {
    fn default() -> Self {
        Self { samples: 64, replicas: 8, voxels: 128, tracking: Tracking::default() }
    }
}

impl Truth {
    /// Refuses what is no truth; `place` is the file.
    pub(crate) fn check(&self, place: &str) -> Result<()> {
        let Self { samples, replicas, voxels, .. } = *self;
        if samples > 0 && (FEWEST_REPLICAS as u32..=64).contains(&replicas) && (8..=512).contains(&voxels) {
            return Ok(());
        }
        Err(Error::new(
            format!("{place}, truth"),
            format!("{samples} samples, {replicas} replicas, {voxels} voxels"),
            format!("at least 1 sample, {FEWEST_REPLICAS} to 64 replicas, 8 to 512 voxels"),
            "Correct the file.",
        ))
    }

    /// All that the truth of a density in a scene depends on, but for the build. `purpose` keeps truths apart that must not share their
    /// noise: what was measured or searched with one is judged by another.
    pub fn inputs(&self, scene: &Scene, density: &str, purpose: &str, rays: PixelRays) -> Json {
        let mut inputs = json!({"scene": scene.content_hash(), "density": density, "truth": self, "purpose": purpose});
        // Truths by the filter keep the names that they had before there was a choice.
        if !rays.are_filtered() {
            inputs["rays"] = json!(rays);
        }
        inputs
    }

    /// The truth with these inputs: from its record in a ledger, or rendered there, the replicas that are missing.
    pub fn obtain(
        &self,
        scene: &Scene,
        density: &str,
        purpose: &str,
        rays: PixelRays,
        ledger: &Ledger,
        progress: Progress<'_>,
    ) -> Result<TruthRecord> {
        let inputs = self.inputs(scene, density, purpose, rays);
        let key = ledger.key(&inputs);
        let make = || self.render(scene, density, &inputs, ledger, progress);
        let record: TruthRecord = ledger.obtain(PART, &key, make)?;
        record.check(scene, density, ledger)?;
        Ok(record)
    }

    /// Renders the replicas that a folder lacks, of a truth with these [`Self::inputs`]; the record is the caller's to keep.
    pub fn render(
        &self,
        scene: &Scene,
        density: &str,
        inputs: &Json,
        ledger: &Ledger,
        progress: Progress<'_>,
    ) -> Result<TruthRecord> {
        let id = ledger.key(inputs);
        let rays: PixelRays = serde_json::from_value(inputs["rays"].clone()).unwrap_or_default();
        let folder = ledger.folder().ok_or_else(|| {
            Error::new("the truth", "no folder", "one that keeps its replicas", "Name a folder for the results.")
        })?;
        let name = |seed: u32| format!("{PART}/{id}.seed-{seed}.exr");
        let first = seeds::first(inputs);
        let seeds = first..first + self.replicas;
        let missing: Vec<u32> = seeds.clone().filter(|&seed| !folder.join(name(seed)).exists()).collect();
        if !missing.is_empty() {
            let report = |done: f64, _: &str| progress(done, &format!("truth of {density} in {}", scene.name));
            report(0.0, "");
            let medium = Self::medium(scene, density)?;
            let subject = Subject { scene, medium: medium.as_ref() };
            let settings = self.path_settings(rays);
            let mut begin = ProcessTime::now();
            path::render_each(subject, &settings, Backend::Cpu, &missing, &report, &mut |seed, mut image| {
                image.provenance.insert(PROCESSOR_SECONDS.into(), format!("{:.3}", begin.elapsed().as_secs_f64()));
                begin = ProcessTime::now();
                image.write_exr(&folder.join(name(seed)), false)
            })?;
        }
        let mut record = TruthRecord {
            id: id.clone(),
            scene: scene.name.clone(),
            scene_sha256: scene.content_hash(),
            density: density.to_owned(),
            seconds: 0.0,
            replicas: seeds.map(name).collect(),
            rays,
        };
        let seconds = |image: &Image| image.provenance.get(PROCESSOR_SECONDS).and_then(|text| text.parse::<f64>().ok());
        record.seconds = record.read(folder)?.iter().filter_map(seconds).sum();
        Ok(record)
    }

    /// How its pictures are path traced.
    pub fn path_settings(&self, rays: PixelRays) -> PathSettings {
        PathSettings {
            samples: self.samples,
            pixel_centres: !rays.are_filtered(),
            tracking: self.tracking,
            ..PathSettings::default()
        }
    }

    /// The medium that path tracing sees: that of the scene, or of a published system with its defects corrected, so that what a defect does
    /// to the medium is an error, too.
    pub fn medium(scene: &Scene, density: &str) -> Result<Option<GivenMedium>> {
        Self::medium_at(scene, density, 0.0)
    }

    /// The same after `seconds` of a published system's animation.
    pub fn medium_at(scene: &Scene, density: &str, seconds: f64) -> Result<Option<GivenMedium>> {
        let selection = Selection::parse(density)?;
        if selection.model.is_of_scene {
            return Ok(None);
        }
        let engine = selection.engine_at(scene, &[], &Defects::NONE, seconds)?;
        let mut identity = engine.medium_identity();
        if seconds != 0.0 {
            identity += &format!(" after {seconds} s");
        }
        Ok(Some(GivenMedium { identity, object: Arc::new(engine.medium()?) }))
    }
}
