//! Pictures of a sequence from fewer rays, and from the pictures before: resolution, checkerboard, 4 x 4 upscaling, temporal blend.
//!
//! A frame shoots some of its rays ([`Rays`]), and fills the other pixels from the nearest ones or from the frame before, its *history*, read where the place
//! that a pixel shows stood then. That place is the mean distance at which the medium takes light away along the ray (weights
//! T (1 - exp(-e s)), chapter 3.6 of the systems' descriptions); of a ray without medium it is far away. The medium's own motion is
//! not known, as in the published systems.
//!
//! A history is *clipped* towards the values around, where asked for: mean m and standard deviation s of each channel over them make a
//! box m +- (gamma s + 1e-7), and a value outside is moved towards m until it lies in the box (Salvi 2016, "An excursion in temporal
//! supersampling").

use crate::base::choice::choice;
use crate::base::error::{Error, Result};
use crate::view::camera::{Camera, Ray};
use glam::DVec2;
use serde::{Deserialize, Serialize};

choice! {
    "kebab-case",
    /// Which rays a frame shoots.
    #[derive(Default)]
    pub enum Rays {
        /// One through the centre of every pixel.
        #[default]
        Every,
        /// One for 2 x 2 pixels, through their middle.
        Half,
        /// One for 4 x 4 pixels.
        Quarter,
        /// Every other pixel, the others in the next frame.
        Checkerboard,
        /// One pixel of 4 x 4, another one in each of 16 frames, in the order of a Bayer matrix.
        Bayer,
    }
}

choice! {
    "kebab-case",
    /// How pixels are filled between the rays of a frame of half or quarter resolution.
    #[derive(Default)]
    pub enum Upsampling {
        /// Bilinear.
        #[default]
        Bilinear,
        /// Bilinear, less across edges of the domain: weights fall with the difference of the distances at which rays enter it (Kopf et al.
        /// 2007, "Joint bilateral upsampling").
        Bilateral,
    }
}

/// How frames are made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reconstruction {
    /// Which rays.
    #[serde(default)]
    pub rays: Rays,
    /// How half and quarter resolution are filled up.
    #[serde(default)]
    pub upsampling: Upsampling,
    /// Weight of the history in every pixel, 0 to below 1; not for checkerboard and Bayer, whose pixels are either new or history.
    #[serde(default)]
    pub history: f64,
    /// Whether the history is read where a place stood then; else at the same pixel.
    #[serde(default = "yes")]
    pub reprojects: bool,
    /// Half side of the box that a history is clipped to, in standard deviations; not clipped where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clip: Option<f64>,
}

fn yes() -> bool {
    true
}

impl Default for Reconstruction {
    /// Every ray, no history.
    fn default() -> Self {
        Self { rays: Rays::Every, upsampling: Upsampling::Bilinear, history: 0.0, reprojects: true, clip: None }
    }
}

/// Frames whose Bayer offsets are all pixels of a block, by their position in it.
const BAYER: [usize; 16] = [0, 8, 2, 10, 12, 4, 14, 6, 3, 11, 1, 9, 15, 7, 13, 5];

/// Added to half the side of a clipping box.
const LEAST_BOX: f64 = 1e-7;

/// Difference of entry distances, relative to the nearer, over which the weight of a bilateral neighbour falls to 1/e.
const EDGE: f64 = 0.1;

/// What axes from f32 may move a place, as a share of the picture's larger side.
const AXES: f64 = 8.0 * f32::EPSILON as f64;

/// Where a ray without medium ends for reprojection, in metres: beyond any scene, within f64's accuracy.
const FAR: f64 = 1e9;

impl Reconstruction {
    /// Whether it shoots every ray and takes nothing from before.
    pub fn is_plain(&self) -> bool {
        self.rays == Rays::Every && self.history == 0.0
    }

    /// Refuses what means nothing; `place` says where it stands.
    pub fn check(&self, place: &str) -> Result<()> {
        let wrong = |name: &str, found: String, expected: &str| {
            Err(Error::new(format!("{place}.{name}"), found, expected, "Correct the value, or leave it out."))
        };
        let takes_turns = matches!(self.rays, Rays::Checkerboard | Rays::Bayer);
        if !(0.0..1.0).contains(&self.history) {
            return wrong("history", self.history.to_string(), "0 to below 1: the weight of the history");
        }
        if takes_turns && self.history != 0.0 {
            return wrong(
                "history",
                self.history.to_string(),
                "none: pixels of checkerboard and Bayer are either new or history",
            );
        }
        if self.upsampling != Upsampling::Bilinear && !matches!(self.rays, Rays::Half | Rays::Quarter) {
            return wrong("upsampling", self.upsampling.to_string(), "rays = \"half\" or \"quarter\" beside it");
        }
        if let Some(clip) = self.clip {
            if !(clip > 0.0 && clip <= 100.0) {
                return wrong("clip", clip.to_string(), "above 0 to 100 standard deviations");
            }
            if !takes_turns && self.history == 0.0 {
                return wrong("clip", clip.to_string(), "a history beside it, which it clips");
            }
        }
        Ok(())
    }
}

/// What a ray found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shot {
    /// Radiance, background included.
    pub color: [f64; 3],
    /// Metres to what it shows; infinite where there is no medium.
    pub distance: f64,
}

/// What frames are made of.
pub trait Shooter {
    /// What rays through raster positions find, in pixels from the bottom-left corner.
    fn shoot(&self, rasters: &[DVec2]) -> Result<Vec<Shot>>;

    /// Metres along the ray through a raster position to the domain of the medium; infinite where it misses.
    fn entry(&self, raster: DVec2) -> f64;

    /// The camera.
    fn camera(&self) -> &Camera;
}

/// A picture with distances, in rows from the top.
#[derive(Debug, Clone)]
struct Frame {
    size: [usize; 2],
    shots: Vec<Shot>,
}

/// Frames of a sequence, each made with those before.
pub struct Sequence {
    how: Reconstruction,
    number: usize,
    before: Option<(Frame, Camera)>,
}

/// A frame.
pub struct Reconstructed {
    /// Radiance, in rows from the top.
    pub pixels: Vec<[f64; 3]>,
    /// Rays that were shot.
    pub rays: usize,
}

/// The raster position of a pixel's centre.
fn centre([_, height]: [usize; 2], column: usize, row: usize) -> DVec2 {
    DVec2::new(column as f64 + 0.5, (height - row) as f64 - 0.5)
}

impl Frame {
    fn at(&self, column: usize, row: usize) -> &Shot {
        &self.shots[row * self.size[0] + column]
    }

    /// The pixel nearest to an index that may lie outside.
    fn clamped(&self, column: i64, row: i64) -> &Shot {
        let inside = |index: i64, side: usize| index.clamp(0, side as i64 - 1) as usize;
        self.at(inside(column, self.size[0]), inside(row, self.size[1]))
    }

    /// Interpolated at a place in pixels from the top-left corner, where pixel 0 has its centre at 0.5; `weight` is multiplied to that of each
    /// of the four pixels.
    fn interpolated(&self, place: DVec2, weight: impl Fn(i64, i64) -> f64) -> Option<[f64; 3]> {
        let low = (place - 0.5).floor();
        let part = place - 0.5 - low;
        let (mut sum, mut weights) = ([0.0; 3], 0.0);
        for corner in 0..4 {
            let (right, down) = (corner & 1, corner >> 1);
            let (column, row) = (low.x as i64 + right, low.y as i64 + down);
            let along = |part: f64, far: i64| if far == 1 { part } else { 1.0 - part };
            let share = along(part.x, right) * along(part.y, down) * weight(column, row);
            let color = self.clamped(column, row).color;
            (0..3).for_each(|channel| sum[channel] += share * color[channel]);
            weights += share;
        }
        (weights > 0.0).then(|| sum.map(|channel| channel / weights))
    }
}

/// Moves a value into the box around others.
fn clipped(value: [f64; 3], around: &[[f64; 3]], gamma: f64) -> [f64; 3] {
    let count = around.len() as f64;
    let mean: [f64; 3] = std::array::from_fn(|channel| around.iter().map(|one| one[channel]).sum::<f64>() / count);
    let beyond = (0..3).map(|channel| {
        let variance = around.iter().map(|one| (one[channel] - mean[channel]).powi(2)).sum::<f64>() / count;
        (value[channel] - mean[channel]).abs() / (gamma * variance.sqrt() + LEAST_BOX)
    });
    let factor = beyond.fold(1.0, f64::max);
    std::array::from_fn(|channel| mean[channel] + (value[channel] - mean[channel]) / factor)
}

impl Sequence {
    /// Before its first frame.
    pub fn new(how: Reconstruction) -> Self {
        Self { how, number: 0, before: None }
    }

    /// Forgets the history, as at a cut.
    pub fn reset(&mut self) {
        self.before = None;
    }

    /// The next frame, of so many columns and rows.
    pub fn next(&mut self, size: [usize; 2], shooter: &dyn Shooter) -> Result<Reconstructed> {
        if self.before.as_ref().is_some_and(|(frame, _)| frame.size != size) {
            self.reset();
        }
        let (mut frame, rays) = match self.how.rays {
            Rays::Every => self.every(size, shooter)?,
            Rays::Half => self.scaled(size, 2, shooter)?,
            Rays::Quarter => self.scaled(size, 4, shooter)?,
            Rays::Checkerboard => self.checkerboard(size, shooter)?,
            Rays::Bayer => self.bayer(size, shooter)?,
        };
        if self.how.history > 0.0 {
            self.blend(&mut frame, shooter.camera());
        }
        self.number += 1;
        let pixels = frame.shots.iter().map(|shot| shot.color).collect();
        self.before = Some((frame, shooter.camera().clone()));
        Ok(Reconstructed { pixels, rays })
    }

    fn every(&self, size: [usize; 2], shooter: &dyn Shooter) -> Result<(Frame, usize)> {
        let rasters: Vec<DVec2> =
            (0..size[0] * size[1]).map(|pixel| centre(size, pixel % size[0], pixel / size[0])).collect();
        let shots = shooter.shoot(&rasters)?;
        Ok((Frame { size, shots }, rasters.len()))
    }

    /// Rays through one place of each block of so many pixels, `place` from its top-left corner.
    fn blocks(&self, size: [usize; 2], side: usize, place: DVec2, shooter: &dyn Shooter) -> Result<Frame> {
        let coarse = size.map(|pixels| pixels.div_ceil(side));
        let raster = |block: usize| {
            let corner = DVec2::new((block % coarse[0]) as f64, (block / coarse[0]) as f64) * side as f64;
            let at = corner + place;
            DVec2::new(at.x, size[1] as f64 - at.y)
        };
        let rasters: Vec<DVec2> = (0..coarse[0] * coarse[1]).map(raster).collect();
        Ok(Frame { size: coarse, shots: shooter.shoot(&rasters)? })
    }

    fn scaled(&self, size: [usize; 2], side: usize, shooter: &dyn Shooter) -> Result<(Frame, usize)> {
        let middle = DVec2::splat(side as f64 / 2.0);
        let coarse = self.blocks(size, side, middle, shooter)?;
        let entry_of_block = |column: i64, row: i64| {
            let at = DVec2::new(column as f64, row as f64) * side as f64 + middle;
            shooter.entry(DVec2::new(at.x, size[1] as f64 - at.y))
        };
        let is_bilateral = self.how.upsampling == Upsampling::Bilateral;
        let pixel = |pixel: usize| {
            let (column, row) = (pixel % size[0], pixel / size[0]);
            let place = (DVec2::new(column as f64, row as f64) + 0.5) / side as f64;
            let entry = if is_bilateral { shooter.entry(centre(size, column, row)) } else { 0.0 };
            let edge = |column: i64, row: i64| {
                if !is_bilateral {
                    return 1.0;
                }
                let other = entry_of_block(column, row);
                let nearer = entry.min(other);
                // Both miss, or both begin at the camera.
                let is_alike = entry == other;
                if is_alike { 1.0 } else { (-(entry - other).abs() / (EDGE * nearer.max(1e-9))).exp() }
            };
            let color = coarse.interpolated(place, edge).or_else(|| coarse.interpolated(place, |_, _| 1.0));
            let nearest = coarse.clamped(place.x.floor() as i64, place.y.floor() as i64);
            Shot { color: color.unwrap_or(nearest.color), distance: nearest.distance }
        };
        let shots = (0..size[0] * size[1]).map(pixel).collect();
        Ok((Frame { size, shots }, coarse.shots.len()))
    }

    /// The history of a pixel that shows what is so far away; none at the first frame, and where it was outside.
    fn history(&self, size: [usize; 2], camera: &Camera, [column, row]: [usize; 2], distance: f64) -> Option<[f64; 3]> {
        let (frame, camera_before) = self.before.as_ref()?;
        if !self.how.reprojects {
            return Some(frame.at(column, row).color);
        }
        let Ray { origin, direction, .. } = camera.ray(centre(size, column, row));
        let point = origin + direction * distance.min(FAR);
        let (device, cosine) = camera_before.device_coordinates(point)?;
        let [width, height] = size.map(|side| side as f64);
        let place = DVec2::new((device.x + 1.0) / 2.0 * width, (1.0 - device.y) / 2.0 * height);
        let is_inside = (0.0..=width).contains(&place.x) && (0.0..=height).contains(&place.y);
        if !(is_inside && cosine > 0.0) {
            return None;
        }
        // Where nothing moved, rounding must not blur: a camera's axes, from f32, are at right angles within some 1e-7.
        let nearest = (place - 0.5).round() + 0.5;
        let place = if place.distance(nearest) < AXES * width.max(height) { nearest } else { place };
        frame.interpolated(place, |_, _| 1.0)
    }

    fn clipped(&self, history: [f64; 3], around: &[[f64; 3]]) -> [f64; 3] {
        self.how.clip.map_or(history, |gamma| clipped(history, around, gamma))
    }

    fn checkerboard(&self, size: [usize; 2], shooter: &dyn Shooter) -> Result<(Frame, usize)> {
        let [width, height] = size;
        let is_shot = |column: usize, row: usize| (column + row + self.number).is_multiple_of(2);
        let pixels = || (0..width * height).map(|pixel| (pixel % width, pixel / width));
        let shot: Vec<(usize, usize)> = pixels().filter(|&(column, row)| is_shot(column, row)).collect();
        let found = shooter.shoot(&shot.iter().map(|&(x, y)| centre(size, x, y)).collect::<Vec<_>>())?;
        let nothing = Shot { color: [0.0; 3], distance: f64::INFINITY };
        let mut frame = Frame { size, shots: vec![nothing; width * height] };
        for (&(column, row), shot) in shot.iter().zip(found) {
            frame.shots[row * width + column] = shot;
        }
        for (column, row) in pixels().filter(|&(column, row)| !is_shot(column, row)) {
            let steps: [(i64, i64); 4] = [(-1, 0), (1, 0), (0, -1), (0, 1)];
            let around: Vec<Shot> = steps
                .iter()
                .map(|(x, y)| (column as i64 + x, row as i64 + y))
                .filter(|&(x, y)| (0..width as i64).contains(&x) && (0..height as i64).contains(&y))
                .map(|(x, y)| *frame.at(x as usize, y as usize))
                .collect();
            let distance = around.iter().map(|shot| shot.distance).fold(f64::INFINITY, f64::min);
            let colors: Vec<[f64; 3]> = around.iter().map(|shot| shot.color).collect();
            let mean = |channel: usize| colors.iter().map(|color| color[channel]).sum::<f64>() / colors.len() as f64;
            let color = match self.history(size, shooter.camera(), [column, row], distance) {
                Some(history) if !colors.is_empty() => self.clipped(history, &colors),
                Some(history) => history,
                None if colors.is_empty() => [0.0; 3],
                None => [0, 1, 2].map(mean),
            };
            frame.shots[row * width + column] = Shot { color, distance };
        }
        Ok((frame, shot.len()))
    }

    fn bayer(&self, size: [usize; 2], shooter: &dyn Shooter) -> Result<(Frame, usize)> {
        const SIDE: usize = 4;
        let offset = BAYER[self.number % BAYER.len()];
        let new = [offset % SIDE, offset / SIDE];
        let coarse = self.blocks(size, SIDE, DVec2::new(new[0] as f64, new[1] as f64) + 0.5, shooter)?;
        let pixel = |pixel: usize| {
            let (column, row) = (pixel % size[0], pixel / size[0]);
            let (x, y) = ((column / SIDE) as i64, (row / SIDE) as i64);
            let shot = *coarse.clamped(x, y);
            if [column % SIDE, row % SIDE] == new {
                return shot;
            }
            let near = (0..9).map(|number| coarse.clamped(x + number % 3 - 1, y + number / 3 - 1).distance);
            let distance = near.fold(f64::INFINITY, f64::min);
            let around =
                [(0, 0), (-1, 0), (1, 0), (0, -1), (0, 1)].map(|(dx, dy)| coarse.clamped(x + dx, y + dy).color);
            let history = self.history(size, shooter.camera(), [column, row], distance);
            let color = history.map_or(shot.color, |history| self.clipped(history, &around));
            Shot { color, distance }
        };
        let shots = (0..size[0] * size[1]).map(pixel).collect();
        Ok((Frame { size, shots }, coarse.shots.len()))
    }

    /// Blends the history into a frame.
    fn blend(&self, frame: &mut Frame, camera: &Camera) {
        let size = frame.size;
        let new = frame.clone();
        for (pixel, shot) in frame.shots.iter_mut().enumerate() {
            let (column, row) = (pixel % size[0], pixel / size[0]);
            let Some(history) = self.history(size, camera, [column, row], shot.distance) else { continue };
            let place = |number: i64| (column as i64 + number % 3 - 1, row as i64 + number / 3 - 1);
            let around: [[f64; 3]; 9] = std::array::from_fn(|number| {
                let (x, y) = place(number as i64);
                new.clamped(x, y).color
            });
            let history = self.clipped(history, &around);
            let weight = self.how.history;
            shot.color =
                std::array::from_fn(|channel| shot.color[channel] + weight * (history[channel] - shot.color[channel]));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use glam::DVec3;
    use std::path::Path;

    /// A pattern in the directions of rays, far away.
    struct Pattern {
        camera: Camera,
        factor: f64,
    }

    impl Shooter for Pattern {
        fn shoot(&self, rasters: &[DVec2]) -> Result<Vec<Shot>> {
            let shot = |raster: &DVec2| {
                let direction: DVec3 = self.camera.ray(*raster).direction;
                let color = [0.0, 1.0, 2.0]
                    .map(|phase| self.factor * (2.0 + (6.0 * direction.x + phase + 4.0 * direction.z).sin()));
                Shot { color, distance: f64::INFINITY }
            };
            Ok(rasters.iter().map(shot).collect())
        }

        fn entry(&self, _raster: DVec2) -> f64 {
            f64::INFINITY
        }

        fn camera(&self) -> &Camera {
            &self.camera
        }
    }

    const SIZE: [usize; 2] = [33, 18];

    fn pattern(turned: f64, factor: f64) -> Pattern {
        let mut scene = Scene::load(Path::new("parity/scenes/linear-ramp.scene.json")).expect("a scene");
        scene.film.resolution = SIZE.map(|side| side as u32);
        let turn = glam::DMat4::from_rotation_z(turned);
        let matrix = turn * crate::scene::matrix_to_glam(&scene.camera.matrix_world);
        scene.camera.matrix_world = crate::scene::matrix_from_glam(matrix);
        Pattern { camera: Camera::new(&scene, scene.image_size()).expect("a camera"), factor }
    }

    fn exact(shooter: &Pattern) -> Vec<[f64; 3]> {
        Sequence::new(Reconstruction::default()).next(SIZE, shooter).expect("a frame").pixels
    }

    fn largest(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
        a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    fn all() -> Vec<Reconstruction> {
        let plain = Reconstruction::default();
        let mut all = vec![plain.clone()];
        for rays in [Rays::Half, Rays::Quarter, Rays::Checkerboard, Rays::Bayer] {
            all.push(Reconstruction { rays, ..plain.clone() });
        }
        all.push(Reconstruction { rays: Rays::Half, upsampling: Upsampling::Bilateral, ..plain.clone() });
        all.push(Reconstruction { history: 0.9, ..plain.clone() });
        all.push(Reconstruction { history: 0.9, clip: Some(1.0), ..plain.clone() });
        all.push(Reconstruction { rays: Rays::Bayer, clip: Some(2.0), ..plain });
        all
    }

    #[test]
    fn what_stands_still_is_exact_after_all_rays_of_a_cycle() {
        let still = pattern(0.0, 1.0);
        let expected = exact(&still);
        for how in all() {
            assert!(how.check("test").is_ok());
            let mut sequence = Sequence::new(how.clone());
            let mut shot = 0;
            for _ in 0..16 {
                shot += sequence.next(SIZE, &still).expect("a frame").rays;
            }
            let found = sequence.next(SIZE, &still).expect("a frame").pixels;
            let error = largest(&found, &expected);
            match (how.rays, how.clip) {
                // Interpolated between rays: the pattern bends by at most 52 per radian squared, over a pixel of 0.03, two or four of them.
                (Rays::Half | Rays::Quarter, _) => assert!(error > 1e-4 && error < 0.3, "{how:?}: {error}"),
                // Clipping knows a block's neighbours only.
                (_, Some(_)) => assert!(error < 0.3, "{how:?}: {error}"),
                _ => assert!(error < 1e-9, "{how:?}: {error}"),
            }
            let pixels = SIZE[0] * SIZE[1];
            let expected = match how.rays {
                Rays::Every => 16 * pixels,
                Rays::Half => 16 * 17 * 9,
                Rays::Quarter | Rays::Bayer => 16 * 9 * 5,
                Rays::Checkerboard => 8 * pixels,
            };
            assert_eq!(shot, expected, "{how:?}");
        }
    }

    #[test]
    fn reprojection_follows_the_camera() {
        // Blending a history that lags behind by a hundredth of a radian per frame.
        let errors = [true, false].map(|reprojects| {
            let mut sequence = Sequence::new(Reconstruction { history: 0.9, reprojects, ..Reconstruction::default() });
            let mut error = 0.0;
            for number in 0..20 {
                let shooter = pattern(0.01 * f64::from(number), 1.0);
                let found = sequence.next(SIZE, &shooter).expect("a frame").pixels;
                let inside = |pixels: &[[f64; 3]]| -> Vec<[f64; 3]> {
                    let kept = |pixel: &usize| (4..SIZE[0] - 4).contains(&(pixel % SIZE[0]));
                    (0..pixels.len()).filter(kept).map(|pixel| pixels[pixel]).collect()
                };
                error = largest(&inside(&found), &inside(&exact(&shooter)));
            }
            error
        });
        // Without it the pattern lags by 9 frames, 0.09 radian, at a slope of up to 7. With it interpolation, again and again, blurs.
        assert!(errors[0] < 0.05 && errors[1] > 0.3, "{errors:?}");
    }

    #[test]
    fn clipping_ends_the_past() {
        for clip in [None, Some(1.0)] {
            let mut sequence = Sequence::new(Reconstruction { history: 0.9, clip, ..Reconstruction::default() });
            sequence.next(SIZE, &pattern(0.0, 100.0)).expect("a frame");
            let new = pattern(0.0, 1.0);
            let error = largest(&sequence.next(SIZE, &new).expect("a frame").pixels, &exact(&new));
            assert_eq!(error < 1.0, clip.is_some(), "{clip:?}: {error}");
            let mut fresh = Sequence::new(Reconstruction { history: 0.9, clip, ..Reconstruction::default() });
            fresh.next(SIZE, &pattern(0.0, 100.0)).expect("a frame");
            fresh.reset();
            assert_eq!(largest(&fresh.next(SIZE, &new).expect("a frame").pixels, &exact(&new)), 0.0);
        }
    }

    #[test]
    fn what_means_nothing_is_refused() {
        let plain = Reconstruction::default();
        for (wrong, name) in [
            (Reconstruction { history: 1.0, ..plain.clone() }, "history"),
            (Reconstruction { history: f64::NAN, ..plain.clone() }, "history"),
            (Reconstruction { history: 0.5, rays: Rays::Bayer, ..plain.clone() }, "history"),
            (Reconstruction { clip: Some(1.0), ..plain.clone() }, "clip"),
            (Reconstruction { clip: Some(0.0), rays: Rays::Bayer, ..plain.clone() }, "clip"),
            (Reconstruction { upsampling: Upsampling::Bilateral, ..plain }, "upsampling"),
        ] {
            let error = wrong.check("file, reconstructions[1]").expect_err("refused");
            assert_eq!(error.place, format!("file, reconstructions[1].{name}"));
        }
    }
}
