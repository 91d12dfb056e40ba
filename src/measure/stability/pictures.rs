//! Small pictures by every integrator under extreme cameras, lights, objects and settings.
//!
//! Ray marching and the march of engines exist twice, in f64 on the CPU and in f32 in WGSL: a row compares them value by value. What f32
//! may be off by is measured where the limit is not kept: the CPU makes the picture again with the camera moved by 2^-20 of the box
//! along each axis, both ways. What that changes, f32 changes, whose rays start within less than that. Path tracing is random: a
//! row compares the means of both sides, with replicas for the standard error. In a uniform medium the march of engines has closed forms,
//! which judge the CPU, too.

use crate::base::error::Result;
use crate::engines::domain::{Container, Domain, Outline};
use crate::engines::light::terms::Terms;
use crate::engines::light::{LightModel, ShadowExtinction, ShadowLength, ShadowMarch, SourceFactor, Sun, TwoLobes};
use crate::engines::march::gpu::MarchKernel;
use crate::engines::march::{Leftover, Marched, RealTimePixel, RealTimeRay, RealTimeSettings};
use crate::gpu::Backend;
use crate::gpu::Gpu;
use crate::graph::Program;
use crate::integrators::path;
use crate::integrators::path::PathSettings;
use crate::integrators::{MarchSettings, march, mean_world_side};
use crate::measure::stability::{Bound, Head, Judgement, Subject, fields};
use crate::media::density::Density;
use crate::media::region::Region;
use crate::media::transfer::Integration;
use crate::scene::image::Image;
use crate::scene::{self, LightKind, Matrix, PixelFilter, Projection, Scene};
use glam::{DMat4, DVec3};
use std::sync::Arc;

/// Pixels of a picture.
const SIZE: [u32; 2] = [32, 18];

/// The same of a picture of 10,000 steps.
const SMALL: [u32; 2] = [8, 4];

/// Steps of a ray that the limit is for.
const LIMIT_STEPS: f64 = 200.0;

/// Largest error of a picture in f32 that passes: some 200 steps of a few roundings each, relative to the brightest value.
const PICTURE_LIMIT: f64 = 5e-5;

/// Seeds of a side, and paths per pixel of each. Eight are too few for a standard error: one set of eight of the adapter's was 5.8 of them off (4.6
/// before controls), with five sets beside it within 1.3, and all 48 within 0.1.
const REPLICAS: u32 = 32;
const SAMPLES: u32 = 4;

/// Standard errors of the difference of two means that are no difference: 5 in a million differ more at 62 degrees of freedom.
const STANDARD_ERRORS: f64 = 5.0;

/// A case of a scene's pictures.
pub(super) struct Case {
    pub(super) name: String,
    varied: String,
    scene: Scene,
    march: MarchSettings,
    guards: Vec<&'static str>,
    cycles: &'static str,
    /// Whether paths are traced, too: what is varied is not the march itself.
    pub(super) has_paths: bool,
}

/// The rows of a case, those of WGSL where there is an adapter; and why paths are not traced on it, where it does not know the scene.
pub(super) fn rows(case: &Case, gpu: Option<&Gpu>) -> Result<(Vec<Judgement>, Option<String>)> {
    let mut rows = Vec::new();
    let settings = case.march.resolved(&case.scene)?;
    let ours = march::render(&case.scene, &settings, None, &|_, _| ())?;
    let truths = values(&ours);
    let scale = truths.iter().copied().fold(f64::from(f32::MIN_POSITIVE), f64::max);
    let exact: Vec<Bound> = truths.iter().map(|&truth| Bound { truth, distance: 0.0 }).collect();
    rows.push(case.head("march", "cpu", 0.0, "counted only: this is the f64 side").judge(scale, &truths, &exact));
    if let Some(gpu) = gpu {
        let theirs = values(&march::render(&case.scene, &settings, Some(gpu), &|_, _| ())?);
        let far = theirs.iter().zip(&truths).any(|(a, b)| (a - b).abs() > PICTURE_LIMIT * scale);
        let bounds = if far { sensitivity(case, &settings, &truths, scale)? } else { exact };
        let reason = "limit: a few roundings of each of some 200 steps; bound: what moving the camera by 2^-20 of the box changes, \
                      each way along each axis, and the limit, times the steps over 200 where there are more";
        rows.push(case.head("march", "wgsl", PICTURE_LIMIT, reason).judge(scale, &theirs, &bounds));
    }
    if !case.has_paths {
        return Ok((rows, None));
    }
    let (own, means) = paths(&case.scene, Backend::Cpu)?;
    let exact: Vec<Bound> = own.iter().map(|&truth| Bound { truth, distance: 0.0 }).collect();
    rows.push(case.head("path", "cpu", 0.0, "counted only: this is the f64 side").judge(1.0, &own, &exact));
    if gpu.is_none() {
        return Ok((rows, None));
    }
    match paths(&case.scene, Backend::Gpu) {
        Ok((theirs, their_means)) => rows.push(case.compare_paths(&theirs, &means, &their_means)),
        Err(cause) => return Ok((rows, Some(format!("path tracing in WGSL: {cause}")))),
    }
    Ok((rows, None))
}

fn values(image: &Image) -> Vec<f64> {
    image.pixels.iter().flatten().map(|&value| f64::from(value)).collect()
}

/// Every value of every replica, and the mean of each replica over pixels and channels.
fn paths(scene: &Scene, backend: Backend) -> Result<(Vec<f64>, Vec<f64>)> {
    let settings = PathSettings { samples: SAMPLES, ..PathSettings::default() };
    // Seeds of the sides differ: equal seeds are neither equal nor independent.
    let first = if backend == Backend::Cpu { 100 } else { 500 };
    let seeds: Vec<u32> = (first..first + REPLICAS).collect();
    let images = path::render_replicas(scene, &settings, backend, &seeds, &|_, _| ())?;
    let all: Vec<Vec<f64>> = images.iter().map(values).collect();
    let means = all.iter().map(|image| image.iter().sum::<f64>() / image.len() as f64).collect();
    Ok((all.concat(), means))
}

/// Mean, and squared standard error of it.
fn mean_of(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (mean, variance / count)
}

/// Bounds of a marched picture in f32, by moving the camera.
fn sensitivity(case: &Case, settings: &MarchSettings, truths: &[f64], scale: f64) -> Result<Vec<Bound>> {
    let side = mean_world_side(&case.scene);
    let step = side / f64::from(1 << 20);
    // A sum and a product of n numbers are each off by n roundings at most: more than the limit's 200 steps have more of them.
    let longer = (side / settings.view_step / LIMIT_STEPS).max(1.0);
    let mut distances = vec![longer * PICTURE_LIMIT * scale; truths.len()];
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut scene = case.scene.clone();
            let place = &mut scene.camera.matrix_world[axis][3];
            let moved = f64::from(*place) + sign * step;
            // The neighbour where the step is below an ulp.
            *place = match moved as f32 {
                same if same == *place && sign > 0.0 => place.next_up(),
                same if same == *place => place.next_down(),
                other => other,
            };
            let found = values(&march::render(&scene, settings, None, &|_, _| ())?);
            for (distance, (found, truth)) in distances.iter_mut().zip(found.iter().zip(truths)) {
                *distance = distance.max(2.0 * (found - truth).abs());
            }
        }
    }
    Ok(truths.iter().zip(distances).map(|(&truth, distance)| Bound { truth, distance }).collect())
}

impl Case {
    fn head(&self, integrator: &str, mark: &str, limit: f64, reason: &str) -> Head {
        Head {
            id: format!("{integrator}-{}/{mark}", self.name),
            subject: Subject::Picture,
            varied: self.varied.clone(),
            evaluator: match (integrator, mark) {
                ("path", "cpu") => "path tracing on the CPU (f64)",
                ("path", _) => "path tracing in WGSL against the CPU, by means",
                (_, "cpu") => "ray marching on the CPU (f64)",
                _ => "ray marching in WGSL against the CPU",
            }
            .into(),
            limit,
            reason: reason.into(),
            guards: self.guards.clone(),
            cycles: self.cycles.into(),
        }
    }

    /// Judges the means of both sides; every value of the adapter's is counted.
    fn compare_paths(&self, theirs: &[f64], ours: &[f64], means: &[f64]) -> Judgement {
        let ((own, own_error), (other, other_error)) = (mean_of(ours), mean_of(means));
        let noise = STANDARD_ERRORS * (own_error + other_error).sqrt();
        let reason = format!(
            "bound: {STANDARD_ERRORS} standard errors of the difference of the means of {REPLICAS} pictures each; limit: 1e-5, f32"
        );
        let bound = Bound { truth: own, distance: noise };
        let mut row = self.head("path", "wgsl", 1e-5, &reason).judge(f64::from(f32::MIN_POSITIVE), &[other], &[bound]);
        row.values = theirs.len();
        row.nonfinite += theirs.iter().filter(|value| !value.is_finite()).count();
        if row.nonfinite > 0 {
            row.verdict = super::Verdict::Fails;
        }
        row
    }
}

/// The cases of a scene.
pub(super) fn cases(scene: &Scene) -> Result<Vec<Case>> {
    let mut base = scene.clone();
    base.film.resolution = SIZE;
    base.film.resolution_percentage = 100;
    base.film.pixel_filter = PixelFilter::Box;
    base.set_volume_bounces(0);
    let settings = MarchSettings { grid_cells: 16, sub_pixels: 1, world_directions: 16, ..MarchSettings::default() };
    let case = |name: &str, varied: &str, guards: &[&'static str], cycles: &'static str, scene: Scene| Case {
        name: name.into(),
        varied: varied.into(),
        scene,
        march: settings.clone(),
        guards: guards.to_vec(),
        cycles,
        has_paths: true,
    };
    const SAME: &str = "yes: the committed scenes' pictures agree with Cycles' within noise (docs/parity.md)";
    let mut cases = vec![case(
        "base",
        "nothing: the scene as it is",
        &["negative-density", "mean-transmittance"],
        SAME,
        base.clone(),
    )];
    let to_world = scene::matrix_to_glam(&base.volume.matrix_world);
    let [low, high] = [base.volume.bounds.min, base.volume.bounds.max].map(|corner| DVec3::from(corner.map(f64::from)));
    let middle = (low + high) / 2.0;
    const INSIDE: &str = "yes: the medium begins at the near plane (measured with a camera in one and several media)";
    for (name, varied, place) in [
        ("camera-inside", "camera in the middle of the box", middle),
        ("camera-on-face", "camera on a face of the box", DVec3::new(middle.x, middle.y, high.z)),
        ("camera-on-corner", "camera on a corner of the box", high),
    ] {
        let mut scene = base.clone();
        let world = to_world.transform_point3(place);
        for axis in 0..3 {
            scene.camera.matrix_world[axis][3] = world[axis] as f32;
        }
        if scene.camera.projection != Projection::Perspective {
            scene.camera.projection = Projection::Perspective;
        }
        cases.push(case(name, varied, &["near-clip", "ray-inside"], INSIDE, scene));
    }
    cases.push(case(
        "rays-parallel",
        "orthographic rays along an axis of the box, the outermost in its faces",
        &["parallel-rays"],
        "yes by design: the interior of a closed mesh; Cycles' rays in a face itself were not measured",
        parallel(&base, to_world, low, high),
    ));
    if base.lights.iter().any(|light| matches!(light.kind, LightKind::Sun { .. })) {
        let mut below = base.clone();
        let mut scaled = base.clone();
        for light in below.lights.iter_mut().filter(|light| matches!(light.kind, LightKind::Sun { .. })) {
            // Straight up through the ground that is not there: the columns x, y and -z.
            light.matrix_world =
                [[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        }
        scale_axes(&mut scaled.camera.matrix_world, 1e-6);
        scaled.lights.iter_mut().for_each(|light| scale_axes(&mut light.matrix_world, 1e6));
        const NO_HORIZON: &str =
            "yes: Cycles knows no horizon; a sun from below shines as from above (spec: a sun is a direction)";
        cases.push(case("sun-below", "sun from straight below", &["camera-scale"], NO_HORIZON, below));
        const NO_SCALE: &str = "yes: Cycles ignores the scale of cameras and lights (measured)";
        let varied = "camera axes of length 1e-6, light axes of length 1e6: directions that are not normalised";
        cases.push(case("not-normalised", varied, &["camera-scale"], NO_SCALE, scaled));
    }
    let mut far = base.clone();
    move_all(&mut far, [1e6, -1e6, 1e6]);
    cases.push(case(
        "far-away",
        "camera, lights and object moved by 1e6 along every axis",
        &["relative-places"],
        "no: Cycles computes world space in f32, ours stays relative to the box (not measured)",
        far,
    ));
    for thickness in [1e-3_f32, 1e-6] {
        let mut thin = base.clone();
        for row in &mut thin.volume.matrix_world[..3] {
            row[2] *= thickness;
        }
        cases.push(case(
            &format!("thickness-{thickness:e}"),
            &format!("the object's z scaled by {thickness:e}"),
            &["mean-transmittance", "parallel-rays"],
            "yes in the limit: a sheet lets everything through; Cycles' sampled majorant misses sheets below 1/1000 of the box (measured)",
            thin,
        ));
    }
    const OPAQUE: &str =
        "yes in the limit: an opaque medium; Cycles stops after 1024 candidate collisions of a segment (spec)";
    for (label, values, cycles) in [
        ("Density", &[0.0, 1e-6, 1e4, 1e8][..], OPAQUE),
        ("Altitude", &[0.0], SAME),
        ("Scale", &[0.0, 1e-8], SAME),
        ("Time", &[1e6], SAME),
        ("Anisotropy", &[0.999, 0.999999, -0.999999], "yes: Cycles limits |g| to 0.999 (measured)"),
    ] {
        for &value in values {
            let Some((changed, _)) = fields::with(&base, label, value)? else { continue };
            let name = format!("{}={value:e}", label.to_lowercase());
            let guards: &[&'static str] = match label {
                "Anisotropy" => &["anisotropy-limit", "phase-base", "sampled-cosine"],
                "Density" => &["exponential", "mean-transmittance"],
                _ => &["safe-division", "negative-density"],
            };
            cases.push(case(&name, &format!("{label} {value:e}"), guards, cycles, changed));
        }
    }
    let side = mean_world_side(&base);
    const STEPS: &str = "not to compare: Cycles' march has random steps of its own size; null collision has none";
    for (name, varied, view_step, size) in [
        ("one-step", "one step per ray", 1e9, SIZE),
        ("10000-steps", "10,000 steps over a side of the box", side / 10_000.0, SMALL),
    ] {
        let mut scene = base.clone();
        scene.film.resolution = size;
        let mut stepped = case(name, varied, &["loop-budget", "mean-transmittance"], STEPS, scene);
        stepped.march.view_step = view_step;
        stepped.has_paths = false;
        cases.push(stepped);
    }
    let mut plain = case("plain", "plain integration", &["exponential"], "no: an engine's rule", base.clone());
    plain.march.integration = Integration::Plain;
    plain.has_paths = false;
    cases.push(plain);
    Ok(cases)
}

fn scale_axes(matrix: &mut Matrix, factor: f32) {
    for row in &mut matrix[..3] {
        row[..3].iter_mut().for_each(|value| *value *= factor);
    }
}

fn move_all(scene: &mut Scene, by: [f32; 3]) {
    let matrices = std::iter::once(&mut scene.camera.matrix_world)
        .chain(std::iter::once(&mut scene.volume.matrix_world))
        .chain(scene.lights.iter_mut().map(|light| &mut light.matrix_world));
    for matrix in matrices {
        for axis in 0..3 {
            matrix[axis][3] += by[axis];
        }
    }
}

/// An orthographic camera that looks along the box's -z, its outermost columns of rays in two faces.
fn parallel(base: &Scene, to_world: DMat4, low: DVec3, high: DVec3) -> Scene {
    let mut scene = base.clone();
    let columns = [to_world.x_axis, to_world.y_axis, to_world.z_axis].map(|axis| axis.truncate());
    let sides: [f64; 3] = std::array::from_fn(|axis| columns[axis].length() * (high[axis] - low[axis]));
    let middle = to_world.transform_point3((low + high) / 2.0);
    let place = middle + columns[2].normalize() * (2.0 * sides[2]);
    for row in 0..3 {
        for (axis, column) in columns.iter().enumerate() {
            scene.camera.matrix_world[row][axis] = column.normalize()[row] as f32;
        }
        scene.camera.matrix_world[row][3] = place[row] as f32;
    }
    scene.camera.projection = Projection::Orthographic;
    scene.camera.shift = [0.0; 2];
    scene.camera.clip_start = 0.0;
    scene.camera.clip_end = (10.0 * sides[2]) as f32;
    // Middles of pixels reach from face to face where the view is a pixel wider than the box.
    let pixels = f64::from(SIZE[0]);
    scene.camera.ortho_scale = (sides[0] * pixels / (pixels - 1.0)) as f32;
    scene
}

/// A density that is the same everywhere in a box from -0.5 to 0.5.
pub struct Uniform {
    /// The density.
    pub density: f64,
    /// Extinction per unit of density and side of the box.
    pub extinction: [f64; 3],
    container: Container,
    program: Density,
}

impl Uniform {
    /// A density that f32 holds.
    pub fn new(density: f64, extinction: [f64; 3]) -> Self {
        let region = Region { low: DVec3::splat(-0.5), high: DVec3::splat(0.5) };
        let program = Arc::new(Program::constant("Density", density as f32));
        Self { density, extinction, container: unit_box(), program: Density::filling(program, region) }
    }

    /// What whoever reads the density is given.
    pub fn value(&self) -> Result<f64> {
        Ok(self.program.values(&[[0.0; 3]])?[0].into())
    }

    /// What an engine marches through.
    pub fn marched<'a>(&'a self, light: &'a LightModel) -> Marched<'a> {
        Marched {
            container: &self.container,
            density: &self.program,
            extinction: self.extinction,
            averages: None,
            maps: &[],
            light,
            terms: &[],
            light_volume: None,
            air: None,
        }
    }

    /// Marches rays on the CPU.
    pub fn march(
        &self,
        light: &LightModel,
        settings: &RealTimeSettings,
        rays: &[RealTimeRay],
    ) -> Result<Vec<RealTimePixel>> {
        self.marched(light).march(settings, rays)
    }

    /// Marches rays on the adapter.
    pub fn march_on(
        &self,
        gpu: &Gpu,
        light: &LightModel,
        settings: &RealTimeSettings,
        rays: &[RealTimeRay],
    ) -> Result<Vec<RealTimePixel>> {
        MarchKernel::new(gpu, &self.marched(light), settings)?.march(rays)
    }
}

/// A box from -0.5 to 0.5 in the world.
fn unit_box() -> Container {
    let region = Region { low: DVec3::splat(-0.5), high: DVec3::splat(0.5) };
    Container { domain: Domain::Object, to_local: DMat4::IDENTITY, outline: Outline::Box(region), unit: 1.0 }
}

/// Ambient light alone, or a sun in the direction given, of one lobe.
pub fn light(sun_direction: Option<[f64; 3]>, anisotropy: f64) -> LightModel {
    LightModel {
        suns: sun_direction.map(|direction| Sun { direction, irradiance: [10.0, 9.0, 8.0] }).into_iter().collect(),
        ambient: if sun_direction.is_some() { [0.0; 3] } else { [1.0, 0.5, 0.25] },
        phase: TwoLobes::new([anisotropy; 2], 0.0),
        shadow: ShadowMarch::new(6, ShadowLength::ToExit, ShadowExtinction::View),
        source: SourceFactor::Albedo([1.0; 3]),
        terms: Terms::NONE,
    }
}

/// A march of equal steps without early end.
pub fn steps(steps: u32, integration: Integration) -> RealTimeSettings {
    RealTimeSettings {
        steps,
        integration,
        growth: 1.0,
        exit_fade: false,
        least_density: 0.0,
        least_transmittance: 0.0,
        leftover: Leftover::Kept,
        distance_levels: None,
        doubled_start: false,
    }
}

/// Rays through the box of engines: through it, in a face, along an edge, from inside, from a face, from 1e6 sides away, grazing a corner,
/// past it, and with directions of length 1e-6 and 1e6.
pub fn rays() -> Vec<RealTimeRay> {
    let container = unit_box();
    let ray = |origin: [f64; 3], direction: [f64; 3]| {
        container.ray(DVec3::from(origin), DVec3::from(direction), f64::INFINITY, 0.5)
    };
    let diagonal = DVec3::new(0.6, -0.3, 0.7).normalize();
    let far = -diagonal * 1e6;
    vec![
        ray([0.1, 0.2, -3.0], [0.0, 0.0, 1.0]),
        ray((-diagonal * 2.0).to_array(), diagonal.to_array()),
        ray([0.1, 0.5, -3.0], [0.0, 0.0, 1.0]),
        ray([0.5, 0.5, -3.0], [0.0, 0.0, 1.0]),
        ray([0.1, -0.2, 0.3], diagonal.to_array()),
        ray([0.5, 0.1, 0.2], [-1.0, 0.0, 0.0]),
        ray(far.to_array(), diagonal.to_array()),
        ray([0.499, -0.6, 0.4], [0.0078, 0.9999, 0.0]),
        ray([3.0, 3.0, 3.0], [0.0, 1.0, 0.0]),
        ray((-diagonal * 2.0).to_array(), (diagonal * 1e-6).to_array()),
        ray((-diagonal * 2.0).to_array(), (diagonal * 1e6).to_array()),
        ray([0.1, 0.2, -3.0], [1e-30, -1e-38, 1.0]),
    ]
}

/// All numbers of some pixels.
fn numbers(pixels: &[RealTimePixel]) -> Vec<f64> {
    pixels.iter().flat_map(|pixel| pixel.radiance.into_iter().chain(pixel.transmittance)).collect()
}

/// Optical depths per step of the rows in a uniform medium.
const DEPTHS: [f64; 8] = [0.0, 1e-6, 1e-3, 0.1, 1.0, 1e2, 1e4, 1e6];

/// Steps of these rows.
const STEPS: u32 = 64;

/// A unit in the last place of f32, relative to the value, at most.
const ULP: f64 = 1.0 / 8_388_608.0;

/// Rows of the march of engines, in a uniform medium.
pub(super) fn engine_rows(gpu: Option<&Gpu>) -> Result<Vec<Judgement>> {
    let mut rows = Vec::new();
    let rays = rays();
    for integration in [Integration::EnergyConserving, Integration::Plain] {
        let name = match integration {
            Integration::EnergyConserving => "conserving",
            Integration::Plain => "plain",
        };
        let (mut ours, mut exact, mut theirs, mut loose) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for depth in DEPTHS {
            let density = uniform(depth, STEPS);
            let settings = steps(STEPS, integration);
            let ambient = light(None, 0.0);
            ours.extend(numbers(&density.march(&ambient, &settings, &rays)?));
            for ray in &rays {
                let length = ray.inside(&unit_box().outline).length;
                exact.extend(closed_form(&density, &ambient, STEPS, length, integration, false));
                loose.extend(closed_form(&density, &ambient, STEPS, length, integration, true));
            }
            if let Some(gpu) = gpu {
                theirs.extend(numbers(&density.march_on(gpu, &ambient, &settings, &rays)?));
            }
        }
        let head = |mark: &str, limit: f64, reason: &str| Head {
            id: format!("engine-{name}/{mark}"),
            subject: Subject::Picture,
            varied: format!(
                "uniform medium, optical depth 0 and 1e-6 to 1e6 per step, {name} integration; rays in faces and edges, from inside, \
                 from 1e6 sides away, of any length"
            ),
            evaluator: format!(
                "the march of engines, {} against its closed form",
                if mark == "cpu" { "CPU" } else { "WGSL" }
            ),
            limit,
            reason: reason.into(),
            guards: vec!["mean-transmittance", "exponential", "ray-inside", "unit-direction", "parallel-rays"],
            cycles: match integration {
                Integration::EnergyConserving => "yes: a homogeneous medium in one exact step (measured)".into(),
                Integration::Plain => {
                    "no: Cycles never sums plainly; this rule adds d / (1 - exp(-d)) times the truth".into()
                }
            },
        };
        let scale = f64::from(f32::MIN_POSITIVE);
        let reason = "limit: 64 steps of a few roundings of f64; bound: none";
        rows.push(head("cpu", 1e-12, reason).judge(scale, &ours, &exact));
        if gpu.is_some() {
            let reason = "limit: 64 steps of 3 roundings; bound: error of WGSL's exponentials and of the depth, added up over the steps, each \
                          with what is left of the light";
            rows.push(head("wgsl", 192.0 * ULP / 2.0, reason).judge(scale, &theirs, &loose));
        }
    }
    rows.extend(plain_over_truth()?);
    rows.extend(sun_rows(gpu)?);
    rows.extend(step_rows(gpu)?);
    Ok(rows)
}

/// A medium of a depth per step, along a side of the box, of the green channel.
fn uniform(depth: f64, steps: u32) -> Uniform {
    // The density is one that f32 holds; extinctions are powers of two.
    Uniform::new(f64::from((depth * f64::from(steps)) as f32), [0.5, 1.0, 2.0])
}

/// Radiance of the channels and transmittance of the channels of a ray, with ambient light alone; with the bounds of f32, or exact.
fn closed_form(
    density: &Uniform,
    light: &LightModel,
    steps: u32,
    length: f64,
    integration: Integration,
    single: bool,
) -> [Bound; 6] {
    let count = f64::from(steps);
    let mut found = [Bound { truth: 0.0, distance: 0.0 }; 6];
    for channel in 0..3 {
        let extinction = density.density * density.extinction[channel];
        let depth = extinction * length / count;
        let source = light.ambient[channel] * extinction;
        let kept = -(-depth).exp_m1();
        let weight = match integration {
            Integration::EnergyConserving if depth == 0.0 => length / count,
            Integration::EnergyConserving => kept / extinction,
            Integration::Plain => length / count,
        };
        // The geometric sum of the transmittances before each step.
        let sum = if depth == 0.0 { count } else { -(-depth * count).exp_m1() / kept };
        let radiance = source * weight * sum;
        let through = (-depth * count).exp();
        // Of a step: the exponential, the product, and the depth itself (three roundings), of which its transmittance is a power.
        let of_step = (3.0 + 2.0 * depth) * ULP + ULP + 2.0 * depth * ULP;
        let of_weight = if depth < 0.06 { 8.0 * ULP } else { (of_step * (-depth).exp() + ULP) / kept + 8.0 * ULP };
        // Step n brings the errors of n steps; its share of the light falls with the transmittance.
        let mean_steps: f64 = if depth == 0.0 {
            (count - 1.0) / 2.0
        } else {
            let (mut own, mut weighted, mut left) = (0.0, 0.0, 1.0);
            for number in 0..steps {
                own += left;
                weighted += left * f64::from(number);
                left *= 1.0 - kept;
            }
            weighted / own
        };
        let flushed = f64::from(f32::MIN_POSITIVE);
        let bound = |truth: f64, relative: f64| Bound {
            truth,
            distance: if single { truth * relative + count * flushed } else { 0.0 },
        };
        found[channel] = bound(radiance, mean_steps * of_step + of_weight + count * ULP / 2.0);
        found[3 + channel] = bound(through, count * of_step);
    }
    found
}

/// Plain integration over energy-conserving integration, on the CPU: what a step adds too much.
fn plain_over_truth() -> Result<Vec<Judgement>> {
    let ray = &rays()[..1];
    DEPTHS[1..]
        .iter()
        .map(|&depth| {
            let density = uniform(depth, STEPS);
            let ambient = light(None, 0.0);
            let of = |integration| -> Result<f64> {
                Ok(numbers(&density.march(&ambient, &steps(STEPS, integration), ray)?)[1])
            };
            let (plain, truth) = (of(Integration::Plain)?, of(Integration::EnergyConserving)?);
            let depth = density.density / f64::from(STEPS);
            let excess = depth / -(-depth).exp_m1() - 1.0;
            let head = Head {
                id: format!("engine-plain-over-conserving-{:e}/cpu", DEPTHS.iter().copied().find(|own| (own / depth - 1.0).abs() < 1e-3).unwrap_or(depth)),
                subject: Subject::Picture,
                varied: format!("plain against energy-conserving integration, extinction x step = {depth:.1e}"),
                evaluator: "the march of engines with one rule against the other, CPU".into(),
                limit: 1e-3,
                reason: format!(
                    "bound: the Riemann sum of a falling exponential is d / (1 - exp(-d)) times its integral, {:.3e} times here",
                    1.0 + excess
                ),
                guards: vec!["mean-transmittance"],
                cycles: "no: Cycles has no plain sum".into(),
            };
            let distance = truth * excess * (1.0 + 1e-9) + truth * 1e-12;
            Ok(head.judge(f64::MIN_POSITIVE, &[plain], &[Bound { truth, distance }]))
        })
        .collect()
}

/// What moving rays by 2^-20 of the box and the sun by a rounding changes, each way along each axis: twice the largest change of each
/// number.
fn of_places(
    density: &Uniform,
    light: &LightModel,
    settings: &RealTimeSettings,
    rays: &[RealTimeRay],
    truths: &[f64],
) -> Result<Vec<f64>> {
    let mut distances = vec![0.0_f64; truths.len()];
    let mut take = |light: &LightModel, rays: &[RealTimeRay]| -> Result<()> {
        let found = numbers(&density.march(light, settings, rays)?);
        for (distance, (found, truth)) in distances.iter_mut().zip(found.iter().zip(truths)) {
            *distance = distance.max(2.0 * (found - truth).abs());
        }
        Ok(())
    };
    for by in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| [axis, -axis]) {
        let aside = by / f64::from(1 << 20);
        let moved: Vec<RealTimeRay> =
            rays.iter().map(|ray| RealTimeRay { origin: ray.origin + aside, ..*ray }).collect();
        take(light, &moved)?;
        let mut turned = light.clone();
        for sun in &mut turned.suns {
            sun.direction = (sun.towards() + by * ULP).to_array();
        }
        take(&turned, rays)?;
    }
    Ok(distances)
}

/// Suns from above, from the side, along the rays, from below, and of directions of any length; phase functions near 1.
fn sun_rows(gpu: Option<&Gpu>) -> Result<Vec<Judgement>> {
    let Some(gpu) = gpu else { return Ok(Vec::new()) };
    let rays = rays();
    let settings = steps(STEPS, Integration::EnergyConserving);
    let mut rows = Vec::new();
    for (name, varied, suns, eccentricities) in [
        (
            "sun-below",
            "sun straight below, on the horizon and 1e-9 below it",
            [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [1.0, -1e-9, 0.0]],
            [0.0, 0.5],
        ),
        (
            "sun-not-normalised",
            "direction to the sun of length 1e-200, 1e-6 and 1e200",
            [[0.0, 1e-200, 0.0], [3e-7, 9e-7, 1e-7], [6e199, 8e199, 1e199]],
            [0.0, 0.5],
        ),
        (
            "eccentricity",
            "eccentricity 0.999 and 1 - 1e-6, sun along, against and 1e-3 beside a ray",
            [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1e-3, 0.0, 1.0]],
            [0.999, 0.999999],
        ),
    ] {
        let (mut theirs, mut bounds) = (Vec::new(), Vec::new());
        for sun in suns {
            for eccentricity in eccentricities {
                // As f32 holds it, so that both sides have the same lobe.
                let light = light(Some(sun), f64::from(eccentricity as f32));
                let density = uniform(0.03, STEPS);
                let ours = numbers(&density.march(&light, &settings, &rays)?);
                theirs.extend(numbers(&density.march_on(gpu, &light, &settings, &rays)?));
                let moved = of_places(&density, &light, &settings, &rays, &ours)?;
                for ((ray, truths), moved) in rays.iter().zip(ours.chunks(6)).zip(moved.chunks(6)) {
                    let relative =
                        of_directions(ray.inside(&unit_box().outline).direction, light.suns[0].towards(), eccentricity)
                            + 400.0 * ULP;
                    let both = truths.iter().zip(moved);
                    bounds.extend(both.map(|(&truth, moved)| Bound { truth, distance: truth * relative + moved }));
                }
            }
        }
        let head = Head {
            id: format!("engine-{name}/wgsl"),
            subject: Subject::Picture,
            varied: varied.into(),
            evaluator: "the march of engines, WGSL against the CPU".into(),
            limit: 400.0 * ULP,
            reason: "limit: 64 steps with 6 towards the sun, of a rounding each; bound: that, what a rounding of both directions moves the \
                     phase function by, and what rays that start 2^-20 of the box aside see, or another sun by a \
                     rounding: one in a face is inside or outside"
                .into(),
            guards: vec!["unit-direction", "phase-base", "parallel-rays"],
            cycles: match name {
                "eccentricity" => "to 0.999: Cycles limits g there (measured); engines go on".into(),
                _ => "yes: Cycles knows no horizon, and normalises directions (measured)".into(),
            },
        };
        rows.push(head.judge(f64::from(f32::MIN_POSITIVE), &theirs, &bounds));
    }
    Ok(rows)
}

/// Relative change of Henyey-Greenstein when every part of both directions is rounded to f32.
fn of_directions(before: DVec3, after: DVec3, eccentricity: f64) -> f64 {
    let apart = (before - after).length();
    // Three parts of two vectors, half an ulp of 1 each; their difference is exact to a rounding.
    let moved = 6.0_f64.sqrt() * ULP / 2.0;
    let base = |apart: f64| (1.0 - eccentricity).powi(2) + eccentricity * apart * apart;
    (base(apart + moved) / base((apart - moved).max(0.0))).powf(1.5) - 1.0
}

/// One step and ten thousand.
fn step_rows(gpu: Option<&Gpu>) -> Result<Vec<Judgement>> {
    let rays = rays();
    let mut rows = Vec::new();
    for count in [1, 10_000] {
        let density = uniform(4.0 / f64::from(count), count);
        let (settings, ambient) = (steps(count, Integration::EnergyConserving), light(None, 0.0));
        let forms = |single: bool| -> Vec<Bound> {
            let of = |ray: &RealTimeRay| {
                closed_form(
                    &density,
                    &ambient,
                    count,
                    ray.inside(&unit_box().outline).length,
                    Integration::EnergyConserving,
                    single,
                )
            };
            rays.iter().flat_map(of).collect()
        };
        let head = |mark: &str, limit: f64, reason: &str| Head {
            id: format!("engine-{count}-steps/{mark}"),
            subject: Subject::Picture,
            varied: format!("{count} steps per ray through a uniform medium of depth 4"),
            evaluator: format!(
                "the march of engines, {} against its closed form",
                if mark == "cpu" { "CPU" } else { "WGSL" }
            ),
            limit,
            reason: reason.into(),
            guards: vec!["loop-budget", "mean-transmittance"],
            cycles: "yes: a homogeneous medium does not depend on steps (measured)".into(),
        };
        let ours = numbers(&density.march(&ambient, &settings, &rays)?);
        let scale = f64::from(f32::MIN_POSITIVE);
        let reason = "limit: a few roundings of f64 per step";
        rows.push(head("cpu", 1e-15 * f64::from(10 * count + 100), reason).judge(scale, &ours, &forms(false)));
        if let Some(gpu) = gpu {
            let theirs = numbers(&density.march_on(gpu, &ambient, &settings, &rays)?);
            let reason = "limit: 64 steps of 3 roundings; bound: error of WGSL's exponentials, added up over the steps";
            rows.push(head("wgsl", 192.0 * ULP / 2.0, reason).judge(scale, &theirs, &forms(true)));
        }
    }
    Ok(rows)
}
