//! Beer shadow maps: what a density lets through towards a sun, marched once for all samples (Högfeldt 2016 and Hillaire 2020 for the kind of
//! map; the four channels are those of @takram/three-clouds).
//!
//! The map lies across the sun's light, above the whole domain. A texel's ray goes through the domain away from the sun, and keeps of it
//!
//! - the front depth c0: the mean distance from the map at which light is lost;
//! - c1, the mean density over the steps that meet any;
//! - c2, the density times length until the ray ends;
//! - c3, a tail where it ended early.
//!
//! At a place D below the map, from which o has been marched towards the sun, the density times length beyond is taken to be
//! min(c2 + c3, c1 max(0, D - o - c0)), of the four texels around it, mixed. So a density is a slab behind its front, and what a place close to a
//! front loses is less than it should be: that is the method, not a defect.
//!
//! With layers the map keeps instead, at the end of each, the density times length up to it (a deep shadow map on a lattice; Lokovic and Veach 2000),
//! each layer by one sample in the middle of what the domain has of it. Then nothing is marched for: the depth of a place is that of the eight
//! vertices around it, mixed. Its error is that of the lattice, which spans the occupied part of the domain; light's angle does not change it. Maps of
//! a box are kept for the next picture of the same density under the same sun.
//!
//! One map spans the domain, or several span parts of the view (*cascades*): the view from the near to the far clip, or to the farthest corner of the
//! domain, is cut at depths between even and even in their logarithm (Zhang et al. 2006, "Parallel-split shadow maps", with the weight
//! 0.6 of the latter). A map is as wide as its part is long or its far end is, wider by 0.25 z^2 of the view for a far end at the part z of it,
//! and moves by whole texels. Depths near the end z of a part, within 0.25 z^2 of it, take the map of either side by the jitter of their ray; what lies
//! beside its map, or in none of both where a part is shorter than that, has no shadow. The original's percentage-closer filter and its blend over frames are left out. Twins of the reading:
//! `shaders/engines/march.wgsl`, `from_map` and `from_layers`.

use crate::base::error::{Error, Result};
use crate::base::recent::Recent;
use crate::engines::domain::Outline;
use crate::engines::light::{MOST_CASCADES, ShadowMapSettings, Sun};
use crate::engines::march::{Inside, Marched};
use crate::media::density::DensityEvaluator;
use crate::media::lattice::vertices_around;
use crate::media::region::Region;
use crate::view::camera::{Camera, Ray};
use glam::{DMat4, DVec2, DVec3, DVec4};
use rayon::prelude::*;

/// Texels of a task.
const TEXELS: usize = 256;

/// Largest half float.
const LARGEST_HALF: f64 = 65_504.0;

/// The map of a sun.
#[derive(Debug, Clone, PartialEq)]
pub struct ShadowMap {
    /// Texels along a side.
    pub size: usize,
    /// Layers; 0 of a Beer map.
    pub layers: usize,
    /// A place of the density's frame, with 1 behind it, times these: its column and row from the centre of the first texel, and its distance below
    /// the map in units of length, or in layers.
    pub rows: [DVec4; 3],
    /// Part of the view that it is for, where it is one of several.
    pub cascade: Option<Cascade>,
    /// Row by row: distance, density, density times length, and the same of the tail. With layers: the density times length above each of their
    /// ends, row by row and layer by layer, four in one.
    pub texels: Vec<[f32; 4]>,
}

/// A part of a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cascade {
    /// A place of the density's frame, with 1 behind it, times this: its depth in the view as a part of the whole.
    pub view: DVec4,
    /// The depths at which it begins and ends; the last has no end.
    pub ends: [f64; 2],
}

/// What a map with layers follows from: the density's program and box, the frame of the domain, the sun, texels and layers.
type Key = (String, Region, DMat4, f64, DVec3, [u32; 2]);

/// Such maps of the last pictures.
static KNOWN: Recent<Key, ShadowMap> = Recent::new(MOST_KNOWN);

/// Maps that are kept, and the texels of those that are.
const MOST_KNOWN: usize = 8;
const MOST_KEPT_TEXELS: usize = 1 << 20;

/// Bytes of the maps of all suns: what every adapter binds at once, by WebGPU's default limit.
const MOST_BYTES: f64 = (1_u64 << 27) as f64;

impl ShadowMap {
    /// The maps of all suns of a light that asks for them, those of each one behind the other; none where it does not. An error where the
    /// domain has no end, and where several are asked for without a camera on a plane, or with layers.
    pub fn of(marched: &Marched<'_>, camera: Option<&Camera>) -> Result<Vec<Self>> {
        let Some(settings) = marched.light.shadow.map else { return Ok(Vec::new()) };
        if marched.container.outline.is_endless() {
            return Err(Error::new(
                format!("domain {}", marched.container.domain),
                "a shadow map over a domain without end",
                "the domain of an object",
                "Set shadow_map to 0, or take the object's domain.",
            ));
        }
        let layers = marched.light.shadow.layers;
        let suns = marched.light.suns.len() as f64;
        // A float per layer, or four in each of the cascades.
        let of_texel = if layers > 0 { 4.0 * f64::from(layers + 1) } else { 16.0 * f64::from(settings.cascades) };
        let of_column = suns * of_texel;
        let bytes = of_column * f64::from(settings.size).powi(2);
        if bytes > MOST_BYTES {
            let fitting = (MOST_BYTES / of_column).sqrt().floor();
            return Err(Error::new(
                "parameter shadow_map",
                format!(
                    "{} texels along a side with {layers} layers, {} cascades and {suns} suns: {bytes:.3e} bytes",
                    settings.size, settings.cascades
                ),
                "maps of at most 128 MiB",
                format!("Take at most {fitting} texels along a side, or fewer layers or cascades."),
            ));
        }
        if settings.cascades == 1 {
            return marched.light.suns.iter().map(|sun| Self::kept_of_sun(marched, &settings, sun)).collect();
        }
        let refused = |found: &str| {
            Error::new(
                "parameter cascades",
                format!("{} shadow maps of a sun {found}", settings.cascades),
                format!("1, or up to {MOST_CASCADES} Beer maps under a perspective or an orthographic camera"),
                "Set cascades to 1.",
            )
        };
        if layers > 0 || settings.cascades > MOST_CASCADES || settings.cascades == 0 {
            return Err(refused("with layers, or none, or more"));
        }
        if !(0.0..=1.0).contains(&settings.split) {
            return Err(Error::new(
                "parameter cascade_split",
                settings.split.to_string(),
                "0 to 1",
                "Take 0 for even depths, 1 for even logarithms, or a number between them.",
            ));
        }
        let slices = camera.and_then(|camera| slices(marched, camera, &settings));
        let slices = slices.ok_or_else(|| refused("without a camera that looks at a plane"))?;
        let suns = marched.light.suns.iter();
        suns.flat_map(|sun| slices.iter().map(move |slice| Self::of_sun(marched, &settings, sun, Some(slice))))
            .collect()
    }

    /// Of the maps of a sun that for a place, by the jitter of its ray; none where no part of the view has it.
    pub fn chosen(maps: &[Self], place: DVec3, jitter: f64) -> Option<&Self> {
        if let [map] = maps {
            return Some(map);
        }
        let (mut chosen, mut before, mut share) = (None, None, 1.0);
        for (number, map) in maps.iter().enumerate() {
            let Some(Cascade { view, ends: [from, to] }) = map.cascade else { continue };
            let is_last = number + 1 == maps.len();
            let depth = view.dot(place.extend(1.0));
            let near = if depth < (from + to) / 2.0 { from } else { to };
            let margin = 0.5 * near * near;
            let [begin, end] = [from - margin / 2.0, if is_last { f64::INFINITY } else { to + margin / 2.0 }];
            if depth >= begin && depth < end {
                before = chosen;
                chosen = Some(map);
                share = if margin > 0.0 { ((depth - begin).min(end - depth) / margin).clamp(0.0, 1.0) } else { 1.0 };
            }
        }
        if jitter <= share { chosen } else { before }
    }

    /// A map that was made for an earlier picture, or a new one.
    fn kept_of_sun(marched: &Marched<'_>, settings: &ShadowMapSettings, sun: &Sun) -> Result<Self> {
        let Marched { container, density, light, .. } = marched;
        if light.shadow.layers == 0 || !matches!(container.outline, Outline::Box(_)) {
            return Self::of_sun(marched, settings, sun, None);
        }
        let size = [settings.size, light.shadow.layers];
        let key =
            (density.program().content_hash(), density.bounds, container.to_local, container.unit, sun.towards(), size);
        if let Some(map) = KNOWN.get(&key) {
            return Ok(map);
        }
        let map = Self::of_sun(marched, settings, sun, None)?;
        if map.texels.len() <= MOST_KEPT_TEXELS {
            KNOWN.keep(key, map.clone());
        }
        Ok(map)
    }

    fn of_sun(marched: &Marched<'_>, settings: &ShadowMapSettings, sun: &Sun, slice: Option<&Slice>) -> Result<Self> {
        let container = marched.container;
        let to_world = container.to_local.inverse();
        let up = sun.towards();
        let (across, along) = up.any_orthonormal_pair();
        let axes = [across, along, up];
        let layers = marched.light.shadow.layers as usize;
        let occupied = marched.density.occupied;
        let region = if layers > 0 && !occupied.is_empty() { occupied } else { container.outline.region() };
        let mut low = [f64::INFINITY; 3];
        let mut high = [f64::NEG_INFINITY; 3];
        for corner in region.corners().map(|corner| to_world.transform_point3(corner)) {
            for (axis, direction) in axes.iter().enumerate() {
                let at = corner.dot(*direction);
                low[axis] = low[axis].min(at);
                high[axis] = high[axis].max(at);
            }
        }
        let size = settings.size as usize;
        if let Some(slice) = slice {
            let texel = slice.width / size as f64;
            for axis in 0..2 {
                let along = slice.corners.map(|corner| corner.dot(axes[axis]));
                let middle = (along.iter().copied().fold(f64::INFINITY, f64::min)
                    + along.iter().copied().fold(f64::NEG_INFINITY, f64::max))
                    / 2.0;
                let middle = (middle / texel).round() * texel;
                (low[axis], high[axis]) = (middle - slice.width / 2.0, middle + slice.width / 2.0);
            }
        }
        let cascade = slice.map(|slice| slice.cascade);
        let row = |direction: DVec3, scale: f64, shift: f64| {
            let of = |axis: DVec4| axis.truncate().dot(direction) * scale;
            let end = to_world.w_axis.truncate().dot(direction) * scale + shift;
            DVec4::new(of(to_world.x_axis), of(to_world.y_axis), of(to_world.z_axis), end)
        };
        let flat = |axis: usize| {
            let scale = size as f64 / (high[axis] - low[axis]);
            row(axes[axis], scale, -low[axis] * scale - 0.5)
        };
        let per_metre = if layers > 0 { layers as f64 / (high[2] - low[2]) } else { 1.0 / container.unit };
        let rows = [flat(0), flat(1), row(up, -per_metre, high[2] * per_metre)];
        let ray = |index: usize| {
            let part =
                |axis: usize, texel: usize| low[axis] + (texel as f64 + 0.5) / size as f64 * (high[axis] - low[axis]);
            let start = across * part(0, index % size) + along * part(1, index / size) + up * high[2];
            container.ray(start, -up, f64::INFINITY, 0.5).inside(&container.outline)
        };
        let numbers: Vec<usize> = (0..size * size).collect();
        let some = numbers
            .par_chunks(TEXELS)
            .map(|numbers| -> Vec<Inside> { numbers.iter().map(|&index| ray(index)).collect() });
        if layers > 0 {
            let layer = 1.0 / (per_metre * container.unit);
            let columns: Vec<Vec<f32>> =
                some.map(|rays| columns(marched, &rays, layers, layer)).collect::<Result<_>>()?;
            let mut values = vec![0.0; (size * size * (layers + 1)).next_multiple_of(4)];
            for (texel, column) in columns.iter().flat_map(|some| some.chunks_exact(layers + 1)).enumerate() {
                for (end, &value) in column.iter().enumerate() {
                    values[end * size * size + texel] = value;
                }
            }
            let texels = values.chunks_exact(4).map(|four| [four[0], four[1], four[2], four[3]]).collect();
            return Ok(Self { size, layers, rows, cascade, texels });
        }
        let texels: Vec<Vec<[f32; 4]>> = some.map(|rays| march(marched, settings, &rays)).collect::<Result<_>>()?;
        Ok(Self { size, layers: 0, rows, cascade, texels: texels.concat() })
    }

    /// Density times length from a place towards the sun beyond what has been `marched` of it, in units of length; with layers all of it.
    pub fn read(&self, place: DVec3, marched: f64) -> f64 {
        let place = place.extend(1.0);
        if self.layers > 0 {
            return self.read_layers(place);
        }
        let last = (self.size - 1) as f64;
        let [x, y] = [self.rows[0], self.rows[1]].map(|row| row.dot(place).clamp(0.0, last));
        let [left, top] = [x, y].map(|at| (at as usize).min(self.size - 2));
        let mixed: [f64; 4] = std::array::from_fn(|channel| {
            let texel = |column: usize, row: usize| f64::from(self.texels[row * self.size + column][channel]);
            let [right, down] = [x - left as f64, y - top as f64];
            let along = |row: usize| texel(left, row) * (1.0 - right) + texel(left + 1, row) * right;
            along(top) * (1.0 - down) + along(top + 1) * down
        });
        let [front, density, whole, tail] = mixed;
        (whole + tail).min(density * (self.rows[2].dot(place) - marched - front).max(0.0))
    }

    /// The same, 0 beside the map: for places outside the domain, and for maps of a part of the view.
    pub fn read_below(&self, place: DVec3, marched: f64) -> f64 {
        let last = self.size as f64 - 0.5;
        let is_below = self.rows[..2].iter().all(|row| (-0.5..=last).contains(&row.dot(place.extend(1.0))));
        if is_below { self.read(place, marched) } else { 0.0 }
    }

    fn read_layers(&self, place: DVec4) -> f64 {
        let numbers = DVec3::from(self.rows.map(|row| row.dot(place)));
        let texels = self.texels.as_flattened();
        let around = vertices_around(numbers, [self.size, self.size, self.layers + 1]);
        f64::from(around.into_iter().map(|(index, share)| share * texels[index]).sum::<f32>())
    }
}

/// A part of a view as its maps need it.
struct Slice {
    cascade: Cascade,
    corners: [DVec3; 8],
    /// In metres, of a map's side.
    width: f64,
}

/// The parts of a view; none of a panorama.
fn slices(marched: &Marched<'_>, camera: &Camera, settings: &ShadowMapSettings) -> Option<Vec<Slice>> {
    let count = settings.cascades;
    let to_world = marched.container.to_local.inverse();
    let [width, height] = camera.size();
    let rays = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]].map(|[x, y]| camera.ray(DVec2::new(x, y)));
    let forward = camera.forward()?;
    let eye = rays[0].origin;
    let region = marched.container.outline.region();
    let depth = |corner: DVec3| (to_world.transform_point3(corner) - eye).dot(forward);
    let farthest = region.corners().into_iter().map(depth).fold(f64::NEG_INFINITY, f64::max);
    let [clip_near, clip_far] = [rays[0].near, rays[0].far].map(|clip| clip * rays[0].direction.dot(forward));
    let near = clip_near.max(1e-6 * farthest.abs()).max(f64::MIN_POSITIVE);
    let far = clip_far.min(farthest).max(2.0 * near);
    let row = |axis: DVec4| axis.truncate().dot(forward) / far;
    let behind = (to_world.w_axis.truncate() - eye).dot(forward) / far;
    let view = DVec4::new(row(to_world.x_axis), row(to_world.y_axis), row(to_world.z_axis), behind);
    let cut = |number: u32| {
        let part = f64::from(number) / f64::from(count);
        let even = (near + (far - near) * part) / far;
        let logarithmic = near * (far / near).powf(part) / far;
        even + (logarithmic - even) * settings.split
    };
    let at = |ray: &Ray, depth: f64| ray.origin + ray.direction * (depth / ray.direction.dot(forward));
    let slice = |number: u32| {
        let ends = [if number == 0 { 0.0 } else { cut(number) }, cut(number + 1)];
        let depths = [ends[0] * far, ends[1] * far];
        let corners: [DVec3; 8] = std::array::from_fn(|index| at(&rays[index % 4], depths[index / 4]));
        let diagonal = corners[4].distance(corners[7]).max(corners[0].distance(corners[7]));
        // Moving by whole texels takes half of one from each side.
        let width = diagonal + 0.25 * ends[1] * ends[1] * (far - near);
        let width = width * (1.0 + 1.0 / f64::from(settings.size));
        Slice { cascade: Cascade { view, ends }, corners, width }
    };
    Some((0..count).map(slice).collect())
}

/// Density times length along rays up to the end of each layer, one ray after the other, beginning with none; layers begin at the map and
/// are so long.
fn columns(marched: &Marched<'_>, rays: &[Inside], layers: usize, layer: f64) -> Result<Vec<f32>> {
    let mut density = DensityEvaluator::new(marched.density)?;
    let (mut owners, mut places) = (Vec::new(), Vec::new());
    for (index, ray) in rays.iter().enumerate().filter(|(_, ray)| ray.length > 0.0) {
        let [begin, end] = [ray.parts.start, ray.parts.start + ray.parts.distance(ray.length)];
        for number in 0..layers {
            let from = (number as f64 * layer).max(begin);
            let to = ((number + 1) as f64 * layer).min(end);
            let middle = 0.5 * (from + to) - begin;
            if from < to && ray.parts.holds(middle) {
                owners.push((index * (layers + 1) + number + 1, to - from));
                places.push(ray.origin + ray.way * middle);
            }
        }
    }
    let mut values = vec![0.0_f64; rays.len() * (layers + 1)];
    for ((owner, length), found) in owners.into_iter().zip(density.values(&places)) {
        values[owner] = found * length;
    }
    for column in values.chunks_exact_mut(layers + 1) {
        let mut sum = 0.0;
        for value in column {
            sum += *value;
            *value = sum;
        }
    }
    Ok(values.into_iter().map(|value| value as f32).collect())
}

/// A ray on its way.
#[derive(Clone, Default)]
struct Texel {
    /// Density times length so far.
    whole: f64,
    /// Sum of the densities of steps that met any, and their number.
    met: (f64, u32),
    /// Sums of weights, and of them times the distance from the map.
    front: [f64; 2],
    ended: bool,
}

/// The texels of rays, step by step together.
fn march(marched: &Marched<'_>, settings: &ShadowMapSettings, rays: &[Inside]) -> Result<Vec<[f32; 4]>> {
    let mut density = DensityEvaluator::new(marched.density)?;
    let extinction = marched.extinction.iter().sum::<f64>() / 3.0;
    let mut texels = vec![Texel::default(); rays.len()];
    for number in 0..settings.steps {
        let asked: Vec<usize> =
            (0..rays.len()).filter(|&index| rays[index].length > 0.0 && !texels[index].ended).collect();
        let distance =
            |ray: &Inside| ray.parts.distance((f64::from(number) + 0.5) * ray.length / f64::from(settings.steps));
        let places: Vec<DVec3> =
            asked.iter().map(|&index| rays[index].origin + rays[index].way * distance(&rays[index])).collect();
        for (&index, found) in asked.iter().zip(density.values(&places)) {
            if found == 0.0 {
                continue;
            }
            let ray = &rays[index];
            let texel = &mut texels[index];
            let before = (-extinction * texel.whole).exp();
            texel.whole += found * ray.length / f64::from(settings.steps);
            texel.met = (texel.met.0 + found, texel.met.1 + 1);
            let after = (-extinction * texel.whole).exp();
            let weight = if settings.front_by_what_is_left { after } else { before - after };
            texel.front[0] += weight;
            texel.front[1] += weight * (ray.parts.start + distance(ray));
            texel.ended = after < settings.least_transmittance;
        }
    }
    let finished = rays.iter().zip(texels).map(|(ray, texel)| {
        let step = ray.length / f64::from(settings.steps);
        let end = ray.parts.start + ray.parts.distance(ray.length);
        let Texel { whole, met: (sum, count), front: [weights, distances], ended } = texel;
        let front = if weights > 0.0 { (distances / weights).min(end) } else { end };
        let front = match settings.half_floats {
            true => half::f16::from_f64((front * settings.metres).min(LARGEST_HALF)).to_f64() / settings.metres,
            false => front,
        };
        // As published a number of metres beside an optical depth: that many metres of a density that dims by 1 in a metre.
        let tail = if ended && extinction > 0.0 {
            let metres = step * settings.metres;
            (settings.tail * metres * (1.0 - f64::from(count)).exp()).min(0.5 * metres) / extinction
        } else {
            0.0
        };
        let mean = if count > 0 { sum / f64::from(count) } else { 0.0 };
        [front, mean, whole, tail].map(|value| value as f32)
    });
    Ok(finished.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engines::domain::{Container, Domain, Outline};
    use crate::engines::light::terms::Terms;
    use crate::engines::light::{LightModel, ShadowExtinction, ShadowLength, ShadowMarch, SourceFactor, TwoLobes};
    use crate::graph::Program;
    use crate::media::density::Density;
    use crate::media::region::Region;
    use glam::DMat4;
    use std::sync::Arc;

    /// A map over a box of 2 x 3 x 1 m of one density, in a frame of its own, under a sun; the unit of length is half a metre.
    fn map_over(sun: [f64; 3], settings: ShadowMapSettings) -> (ShadowMap, Container) {
        map_with_layers(sun, settings, 0)
    }

    fn map_with_layers(sun: [f64; 3], settings: ShadowMapSettings, layers: u32) -> (ShadowMap, Container) {
        let region = Region { low: DVec3::splat(-1.0), high: DVec3::splat(1.0) };
        let to_local = DMat4::from_scale(DVec3::new(1.0, 2.0 / 3.0, 2.0)) * DMat4::from_rotation_z(0.3);
        let outline = Outline::Box(region);
        let container = Container { domain: Domain::Object, to_local, outline, unit: 0.5 };
        let density = Density::filling(Arc::new(Program::constant("one", 1.5)), region);
        let shadow = ShadowMarch::new(1, ShadowLength::ToExit, ShadowExtinction::View);
        let light = LightModel {
            suns: vec![Sun { direction: sun, irradiance: [1.0; 3] }],
            ambient: [0.0; 3],
            phase: TwoLobes::new([0.0; 2], 0.0),
            shadow: ShadowMarch { map: Some(settings), layers, ..shadow },
            source: SourceFactor::Density,
            terms: Terms::NONE,
        };
        let extinction = [2.0; 3];
        let marched = Marched {
            container: &container,
            density: &density,
            extinction,
            averages: None,
            maps: &[],
            light: &light,
            terms: &[],
            light_volume: None,
            air: None,
        };
        let maps = ShadowMap::of(&marched, None).expect("a map");
        (maps[0].clone(), container)
    }

    #[test]
    fn a_box_of_one_density_is_a_slab_behind_its_front() {
        let settings = ShadowMapSettings { least_transmittance: 0.0, ..ShadowMapSettings::new(8, 2000, 0.5) };
        let (map, _) = map_over([0.0, 0.0, 1.0], settings);
        // Two units high, extinction 2 x 1.5 = 3 per unit: light is lost, in the mean, at 1 / 3 - 2 e^-6 / (1 - e^-6).
        let front = 1.0 / 3.0 - 2.0 * (-6.0_f64).exp() / (1.0 - (-6.0_f64).exp());
        for (height, marched) in [(-1.0, 0.0), (0.0, 0.0), (0.5, 0.2), (0.99, 0.0), (0.0, 3.0)] {
            let below = 1.0 - height - marched;
            let truth = 1.5 * (below - front).max(0.0);
            // A step of a 2000th of the way puts the middle of what it takes off by less than itself; texels are floats.
            let found = map.read(DVec3::new(0.1, -0.2, height), marched);
            assert!((found - truth).abs() < 2e-3, "{height}: {found}, not {truth}");
        }
    }

    /// Depths of a map with layers of a box of one density are those of the ways through it, but for its lattice: less than half of its diagonal
    /// of some 1/64 of the box; and the next map is the same.
    #[test]
    fn layers_know_the_way_through_a_box() {
        let sun = DVec3::new(0.3, -0.5, 0.6);
        let (map, container) = map_with_layers(sun.into(), ShadowMapSettings::new(64, 1, 0.5), 64);
        let way = container.way(sun);
        for place in [[0.1, 0.05, -0.9], [-0.2, 0.1, -0.3], [0.0, -0.1, 0.2], [0.5, 0.5, 0.9], [-0.9, 0.9, 0.0]] {
            let place = DVec3::from(place);
            let truth = 1.5 * container.outline.parts_to_light(place, way).length;
            let found = map.read(place, 0.0);
            assert!((found - truth).abs() < 1.5 * 8.0 / 64.0, "{place}: {found}, not {truth}");
        }
        assert_eq!(map.texels.len(), (64 * 64 * 65) / 4);
        assert_eq!(map_with_layers(sun.into(), ShadowMapSettings::new(64, 1, 0.5), 64).0, map);
        let (other, _) = map_with_layers([0.0, 0.0, 1.0], ShadowMapSettings::new(64, 1, 0.5), 64);
        assert_ne!(other, map);
        // Straight down a layer's end is exact: a unit is half a metre, the box a metre high.
        assert!((other.read(DVec3::new(0.0, 0.0, -1.0), 0.0) - 1.5 * 2.0).abs() < 1e-5);
        assert!((other.read(DVec3::new(0.0, 0.0, 0.25), 0.0) - 1.5 * 0.75).abs() < 1e-5);
    }

    #[test]
    fn maps_that_no_adapter_binds_are_refused() {
        let (_, container) = map_over([0.0, 0.0, 1.0], ShadowMapSettings::new(2, 1, 0.5));
        let density = Density::filling(Arc::new(Program::constant("one", 1.0)), container.outline.region());
        let mut light = LightModel {
            suns: vec![Sun { direction: [0.0, 0.0, 1.0], irradiance: [1.0; 3] }],
            ambient: [0.0; 3],
            phase: TwoLobes::new([0.0; 2], 0.0),
            shadow: ShadowMarch::new(1, ShadowLength::ToExit, ShadowExtinction::View),
            source: SourceFactor::Density,
            terms: Terms::NONE,
        };
        light.shadow.map = Some(ShadowMapSettings::new(4096, 1, 0.5));
        light.shadow.layers = 4096;
        let marched = Marched {
            container: &container,
            density: &density,
            extinction: [1.0; 3],
            averages: None,
            maps: &[],
            light: &light,
            terms: &[],
            light_volume: None,
            air: None,
        };
        let error = ShadowMap::of(&marched, None).expect_err("256 GiB").to_string();
        assert!(error.contains("shadow_map") && error.contains("Take at most 90 texels"), "{error}");
    }

    #[test]
    fn a_slanting_sun_goes_through_what_stands_in_its_way() {
        let sun = DVec3::new(0.3, -0.5, 0.6);
        let settings = ShadowMapSettings { least_transmittance: 0.0, ..ShadowMapSettings::new(256, 400, 0.5) };
        let (map, container) = map_over(sun.into(), settings);
        for place in [DVec3::new(0.1, 0.05, -0.9), DVec3::new(-0.2, 0.1, -0.3), DVec3::new(0.0, -0.1, 0.2)] {
            let way = container.way(sun);
            let up = container.outline.parts_to_light(place, way).length;
            let down = container.outline.parts_to_light(place, -way).length;
            let shift = map.rows[2].dot(place.extend(1.0)) - up;
            // From where the ray enters: the mean depth of what is lost along all of it.
            let whole = up + down;
            let front = 1.0 / 3.0 - whole * (-3.0 * whole).exp() / (1.0 - (-3.0 * whole).exp());
            let truth = 1.5 * (up - front).max(0.0);
            let found = map.read(place, 0.0);
            // A texel is a 60th of a unit; lengths change by less than twice that over it, and a step is shorter.
            assert!((found - truth).abs() < 0.05, "{place}: {found}, not {truth}, entered {shift} below the map");
            assert!(truth > 0.1 || up < 0.5, "something is told at {place}");
        }
    }

    #[test]
    fn rays_that_end_early_have_a_tail_and_half_floats_are_coarse() {
        let early = ShadowMapSettings { least_transmittance: 0.5, tail: 2.0, ..ShadowMapSettings::new(2, 4, 8000.0) };
        let texel = |settings: ShadowMapSettings| map_over([0.0, 0.0, 1.0], settings).0.texels[0];
        // One step of half a unit takes 1 - e^-1.5; half of its 4000 m bounds the tail, over an extinction of 2.
        assert_eq!(texel(early), [0.25, 1.5, 0.75, 1000.0]);
        let whole = texel(ShadowMapSettings { least_transmittance: 0.0, ..early });
        assert_eq!([whole[2], whole[3]], [3.0, 0.0]);
        // Steps of one density take alike shares of what they leave: there the weights do not matter.
        let left = texel(ShadowMapSettings { least_transmittance: 0.0, front_by_what_is_left: true, ..early });
        assert!((left[0] - whole[0]).abs() < 1e-6 && left[0] > 0.25, "{left:?}, {whole:?}");
        let coarse = texel(ShadowMapSettings { least_transmittance: 0.0, half_floats: true, ..early });
        let metres = f64::from(coarse[0]) * 8000.0;
        // From 2048 m to 4096 m half floats are 2 m apart.
        assert!((2048.0..4096.0).contains(&metres) && (metres / 2.0 - (metres / 2.0).round()).abs() < 1e-3, "{metres}");
    }
}
