//! Curves of unbiased renderers beside a study's runs: error against time by the number of samples, for path tracing and for Cycles.
//!
//! Path tracing renders each number of samples anew. Cycles pays its evaluation of the density on a grid for every render, minutes for a
//! heavy graph, so it renders once, at [`CELLS`] times the resolution per axis: with the box filter, by which a sample counts for the
//! part of the pixel in which it lies, a pixel's samples are those of its [`CELLS`]^2 parts. A picture of n samples draws n parts in
//! each pixel, without putting back, seeded; so its samples lie anywhere in the pixel, as those of a render of n samples do. The parts
//! give several such pictures, which share no sample: their mean error is given, with its spread over them in the standard error. Time is
//! what the render took until its first sample per part was done, and the share n / [`CELLS`]^2 of what it took from there on; with one
//! sample per part the two are not told apart.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity;
use crate::base::numbers::uncertain;
use crate::bridge::reference::{ReferenceSettings, cache_folder, references};
use crate::engines::Selection;
use crate::engines::defects::Defects;
use crate::integrators::path::{PathSettings, Subject};
use crate::measure::combination::Combination;
use crate::measure::errors;
use crate::measure::errors::{Errors, Uncertain};
use crate::measure::experiment::Desk;
use crate::measure::seeds;
use crate::measure::study::curve_points::{CELLS, CurvePoint, PARTS, Renderer};
use crate::measure::study::running::Running;
use crate::measure::timing::{cycles_seconds, timed_picture};
use crate::measure::truth::{PixelRays, Truth, TruthRecord};
use crate::measure::voxels;
use crate::scene::image::Image;
use crate::scene::volume_grid::VolumeGrid;
use crate::scene::{PixelFilter, Scene, Shape};
use rand::{SeedableRng as _, seq::SliceRandom as _};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Seed of Cycles, by which its cached picture is known.
const CYCLES_SEED: u32 = 6500;

/// Seed by which parts are drawn.
const DRAWING_SEED: u64 = 6600;

impl Running<'_> {
    /// A point of path tracing's curve.
    pub(super) fn path_point(&mut self, of: &Combination, samples: u32, desk: &Desk<'_>) -> Result<CurvePoint> {
        let (scene, rays) = (self.study.scene(&of.scene), self.study.rays());
        let truth = self.truth(of, rays, desk)?;
        let medium = Truth::medium(scene, &of.density)?;
        let subject = Subject { scene, medium: medium.as_ref() };
        // No seed that a truth has.
        let seed = seeds::first(&json!({"curve of": truth.scene_sha256, "density": of.density, "samples": samples}));
        let settings = PathSettings { samples, seed, ..self.study.file.truth.path_settings(rays) };
        let (image, [prepare_seconds, seconds]) = timed_picture(subject, &settings)?;
        let made = Made {
            samples,
            seconds: Some(seconds),
            prepare_seconds,
            errors: errors::measure(&image, self.replicas(&truth, desk)?)?,
            pictures: 1,
        };
        keep(desk, &truth, Renderer::Path, &made, image)
    }

    /// The points of Cycles: from its render, which the cache of references keeps.
    pub(super) fn cycles_curve(&mut self, of: &Combination, desk: &Desk<'_>) -> Result<Vec<CurvePoint>> {
        let most = self.study.file.curves.cycles[&of.density];
        let file = self.cycles_picture(of, most, desk)?;
        let large = Image::read_exr(&file)?;
        let [prepare_seconds, sampling] = cycles_seconds(&large, &file)?;
        // Cycles says when its first sample is done: with a single one nothing is left to be measured.
        let sampling = (most > PARTS).then_some(sampling);
        let truth = self.truth(of, PixelRays::Filtered, desk)?;
        let replicas = self.replicas(&truth, desk)?;
        let mut points = Vec::new();
        for level in 0..=PARTS.ilog2() {
            let samples = (most / PARTS) << level;
            let mut pictures = draw(&large, 1 << level);
            let found: Vec<Errors> =
                pictures.iter().map(|picture| errors::measure(picture, replicas)).collect::<Result<_>>()?;
            let made = Made {
                samples,
                seconds: sampling.map(|seconds| seconds * f64::from(samples) / f64::from(most)),
                prepare_seconds,
                errors: mean_of(&found),
                pictures: pictures.len() as u32,
            };
            points.push(keep(desk, &truth, Renderer::Cycles, &made, pictures.swap_remove(0))?);
        }
        Ok(points)
    }

    /// Cycles' picture of a scene and density at [`CELLS`] times the resolution: from the cache, or rendered into it.
    fn cycles_picture(&self, of: &Combination, most: u32, desk: &Desk<'_>) -> Result<PathBuf> {
        let scene = self.study.scene(&of.scene);
        if scene.film.pixel_filter != PixelFilter::Box {
            return Err(Error::new(
                format!("$.film.pixel_filter of {}", scene.name),
                format!("{:?}", scene.film.pixel_filter),
                "Box, with which the parts of a pixel make up the pixel",
                "Leave the curve of Cycles out, or give the scene the box filter.",
            ));
        }
        let cache = cache_folder()?;
        let selection = Selection::parse(&of.density)?;
        let mut large = if selection.model.is_of_scene {
            scene.clone()
        } else {
            let engine = selection.engine(scene, &[], &Defects::NONE)?;
            let (mut large, grid) = voxels::scene(scene, &engine, self.study.file.truth.voxels)?;
            put_grid_into(&cache, &mut large, &grid)?;
            large
        };
        large.film.resolution = large.film.resolution.map(|side| side * CELLS);
        let settings = ReferenceSettings { samples: most / PARTS, ..ReferenceSettings::default() };
        let found = references(&large, &settings, &[CYCLES_SEED], &cache, |message| {
            desk.report(message.done, &message.what);
        })?;
        Ok(found[0].path.clone())
    }
}

/// Gives the grid of a scene that was made in memory a file in the cache, by the hash of its values.
fn put_grid_into(cache: &Path, scene: &mut Scene, grid: &VolumeGrid) -> Result<()> {
    let Shape::Grid { file, sha256 } = &mut scene.volume.shape else { return Ok(()) };
    let name = format!("{sha256}.vdb");
    let path = cache.join(&name);
    if !path.exists() {
        files::make_folder(cache, "a folder for references")?;
        crate::bridge::volume_grid::write(grid, &path, false)?;
    }
    let bytes = std::fs::read(&path).map_err(|cause| Error::io(&path, "an OpenVDB file", &cause))?;
    *sha256 = files::sha256(&bytes);
    *file = name;
    scene.folder = cache.to_owned();
    Ok(())
}

/// Pictures of `count` parts per pixel that share no part, from a picture at [`CELLS`] times the resolution.
fn draw(large: &Image, count: usize) -> Vec<Image> {
    let (cells, parts) = (CELLS as usize, PARTS as usize);
    let (width, height) = (large.width / cells, large.height / cells);
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(DRAWING_SEED);
    let mut pictures = vec![Image::new(width, height); parts / count];
    let mut order: Vec<usize> = (0..parts).collect();
    for pixel in 0..width * height {
        let (column, row) = (pixel % width, pixel / width);
        order.shuffle(&mut random);
        for (picture, drawn) in pictures.iter_mut().zip(order.chunks_exact(count)) {
            let mut sum = [0.0_f64; 4];
            for part in drawn {
                let at = (row * cells + part / cells) * large.width + column * cells + part % cells;
                (0..4).for_each(|channel| sum[channel] += f64::from(large.pixels[at][channel]));
            }
            picture.pixels[pixel] = sum.map(|value| (value / count as f64) as f32);
        }
    }
    pictures
}

/// Mean figures of several pictures. The truth's noise is common to them; their own is not.
fn mean_of(found: &[Errors]) -> Errors {
    let count = found.len() as f64;
    let mean = |figure: &dyn Fn(&Errors) -> Uncertain| {
        let value = found.iter().map(|one| figure(one).value).sum::<f64>() / count;
        let common = found.iter().map(|one| figure(one).standard_error).sum::<f64>() / count;
        let spread: f64 = found.iter().map(|one| (figure(one).value - value).powi(2)).sum();
        let own = if count > 1.0 { (spread / (count * (count - 1.0))).sqrt() } else { 0.0 };
        Uncertain { value, standard_error: common.hypot(own) }
    };
    Errors { relmse: mean(&|one| one.relmse), rms: mean(&|one| one.rms), bias: mean(&|one| one.bias) }
}

/// What a point's picture came to.
struct Made {
    samples: u32,
    seconds: Option<f64>,
    prepare_seconds: f64,
    errors: Errors,
    pictures: u32,
}

/// A point, with its picture in the folder.
fn keep(desk: &Desk<'_>, truth: &TruthRecord, renderer: Renderer, made: &Made, mut image: Image) -> Result<CurvePoint> {
    let id = format!("{}-{}", desk.key, made.samples);
    let picture = format!("pictures/{id}.exr");
    // A picture that was drawn from Cycles' is this build's, too.
    image.provenance.entry(identity::ATTRIBUTE.to_owned()).or_insert_with(|| desk.ledger.own().full().to_owned());
    image.write_exr(&desk.folder()?.join(&picture), false)?;
    Ok(CurvePoint {
        renderer,
        scene: truth.scene.clone(),
        density: truth.density.clone(),
        samples: made.samples,
        pictures: made.pictures,
        errors: made.errors,
        flip: None,
        seconds: made.seconds,
        prepare_seconds: made.prepare_seconds,
        cost: made.errors.relmse.value * (made.seconds.unwrap_or(0.0) + made.prepare_seconds),
        picture,
        truth: truth.id.clone(),
        id,
    })
}

impl CurvePoint {
    /// Renderer, samples, time and errors in a line.
    pub fn describe(&self) -> String {
        format!(
            "{} in {}: {}, {} samples: {:.1} + {} s, relMSE {}, bias {:+.2} %",
            self.density,
            self.scene,
            self.renderer.label(),
            self.samples,
            self.prepare_seconds,
            self.seconds.map_or("(no time of their own)".into(), |seconds| format!("{seconds:.2}")),
            uncertain(self.errors.relmse.value, self.errors.relmse.standard_error),
            100.0 * self.errors.bias.value,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawn_pictures_share_no_part_and_make_up_the_pixel() {
        let mut large = Image::new(8, 4);
        for (index, pixel) in large.pixels.iter_mut().enumerate() {
            *pixel = [index as f32, 0.0, 0.0, 1.0];
        }
        for count in [1, 2, 4, 8, 16] {
            let pictures = draw(&large, count);
            assert_eq!(pictures.len(), 16 / count);
            for pixel in 0..2 {
                // The parts of pixel 0 are in columns 0 to 3, those of pixel 1 in 4 to 7, rows 8 apart: means 13.5 and 17.5.
                let mean: f32 =
                    pictures.iter().map(|picture| picture.pixels[pixel][0]).sum::<f32>() / pictures.len() as f32;
                assert_eq!(mean, 13.5 + 4.0 * pixel as f32, "{count}");
            }
        }
        // With one part each, the pictures hold every part once.
        let mut parts: Vec<f32> = draw(&large, 1).iter().map(|picture| picture.pixels[0][0]).collect();
        parts.sort_by(f32::total_cmp);
        let expected: Vec<f32> = (0..16).map(|part| (part / 4 * 8 + part % 4) as f32).collect();
        assert_eq!(parts, expected);
    }
}
