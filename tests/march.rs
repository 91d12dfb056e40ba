//! Settings of ray marching: integration, jitter, what is left out, and the density cache.

mod support;

use cloudparity::gpu::Backend;
use cloudparity::integrators;
use cloudparity::integrators::march::Omission;
use cloudparity::integrators::{Jitter, LightMode, MarchSettings};
use cloudparity::measure::convergence::{Convergence, ConvergenceSettings, measure};
use cloudparity::measure::experiment::Outcome;
use cloudparity::measure::speed::leaving_out;
use cloudparity::media::density_cache::CacheReport;
use cloudparity::media::density_cache::{CacheFilter, CacheFormat, CacheSettings};
use cloudparity::media::transfer::Integration;
use cloudparity::scene::image::Image;
use cloudparity::scene::{Input, Scene};
use std::collections::BTreeSet;
use std::path::Path;
use support::cube::{SCATTERING, SUN, color, homogeneous, phase, ramp, set, slanted_sun, sphere};

const FORMATS: [CacheFormat; 3] = [CacheFormat::F32, CacheFormat::F16, CacheFormat::Unorm8];

/// Coarse and without interpolation of light.
fn coarse() -> MarchSettings {
    MarchSettings {
        view_step: 0.125,
        shadow_step: 0.125,
        world_directions: 16,
        sub_pixels: 1,
        exit_transmittance: 0.0,
        light: LightMode::Exact,
        grid_cells: 16,
        ..MarchSettings::default()
    }
}

fn picture(scene: &Scene, settings: &MarchSettings, backend: Backend) -> Image {
    integrators::render(scene, settings, backend, &|_, _| {}).expect("the scene renders")
}

fn render(scene: &Scene, settings: &MarchSettings) -> [f64; 4] {
    picture(scene, settings, Backend::Cpu).mean()
}

/// The cloud, small.
fn cloud() -> Scene {
    let mut scene = support::scene("procedural-clouds");
    scene.film.resolution = [32, 18];
    scene
}

#[track_caller]
fn close(found: f64, expected: f64, tolerance: f64) {
    let error = (found / expected - 1.0).abs();
    assert!(error <= tolerance, "{found} is not {expected}: relative error {error:e}");
}

/// Largest difference of two pictures, relative to the brightest value.
fn difference(ours: &Image, reference: &Image) -> f64 {
    let values = |image: &Image| image.pixels.iter().flatten().copied().map(f64::from).collect::<Vec<f64>>();
    let (ours, reference) = (values(ours), values(reference));
    let brightest = reference.iter().copied().fold(0.0, f64::max);
    assert!(brightest > 0.0 && brightest.is_finite(), "the reference is black or not finite");
    let differences = ours.iter().zip(&reference).map(|(o, r)| (o - r).abs() / brightest);
    // NaN has to be seen.
    differences.fold(0.0, |largest, next| if next > largest || next.is_nan() { next } else { largest })
}

#[test]
fn plain_integration_is_its_riemann_sum() {
    // Of n steps h through extinction s: the sum of exp(-s i h) h instead of (1 - exp(-s n h)) / s.
    let sum = |step: f64| step * (1.0 - (-2.0_f64).exp()) / (1.0 - (-step).exp());
    for (step, specialise) in [(0.125, true), (0.125, false), (0.01, true)] {
        let settings = MarchSettings { view_step: step, integration: Integration::Plain, specialise, ..coarse() };
        let found = render(&homogeneous(), &settings);
        for channel in 0..3 {
            let expected = SCATTERING[channel] * SUN * phase(0.0, 0.0) * (-1.0_f64).exp() * sum(step);
            // Beside f32 pixels nothing is rounded.
            close(found[channel], expected, 1e-6);
        }
        let mut scene = homogeneous();
        scene.lights.clear();
        scene.world.color = [1.0; 3];
        set(&mut scene, "Color", color([0.0; 3]));
        set(&mut scene, "Emission Strength", Input::Number(0.5));
        close(render(&scene, &settings)[0], (-2.0_f64).exp() + 0.5 * sum(step), 1e-6);
    }
}

#[test]
fn jitter_has_the_mean_of_its_closed_form_and_is_reproducible() {
    // Density t along the view, 0 to 2: a shift by a part u of a step h = 1/4 moves the depth by 2 h (u - 1/2), so
    // the mean transmittance is exp(-2) sinh(h) / h. The middle of a step is exact.
    let mut scene = homogeneous();
    ramp(&mut scene, "Y", 2.0);
    set(&mut scene, "Color", color([0.0; 3]));
    scene.lights.clear();
    scene.world.color = [1.0; 3];
    let middle = MarchSettings { view_step: 0.25, sub_pixels: 64, ..coarse() };
    close(render(&scene, &middle)[0], (-2.0_f64).exp(), 1e-6);
    let jittered = |seed| MarchSettings { jitter: Jitter::Pixel, seed, ..middle.clone() };
    let step = 0.25_f64;
    let expected = (-2.0_f64).exp() * step.sinh() / step;
    // 4096 numbers, one in each of 4096 strata: off by at most the range 0.5 of the depth over 4096.
    close(render(&scene, &jittered(0))[0], expected, 0.5 / 4096.0);
    let one = |seed| picture(&scene, &MarchSettings { sub_pixels: 1, ..jittered(seed) }, Backend::Cpu).pixels;
    assert_eq!(one(0), one(0));
    assert_ne!(one(0), one(1));
    assert_ne!(one(0)[0], one(0)[1], "neighbours share their shift");
}

/// What was left out of a picture.
fn left_out(image: &Image) -> Vec<Omission> {
    serde_json::from_str(&image.provenance["left_out"]).expect("a list of omissions")
}

#[test]
fn leaving_out_does_not_change_the_picture() {
    use Omission::{Density, EmptyCells, InScatter, Lights, Phase, ShadowSteps, ViewSteps, World};
    let grid = MarchSettings { light: LightMode::Grid, ..coarse() };
    let mut lit_by_world = homogeneous();
    slanted_sun(&mut lit_by_world);
    lit_by_world.world.color = [0.5, 0.7, 0.9];
    set(&mut lit_by_world, "Anisotropy", Input::Number(0.6));
    let mut absorbing = homogeneous();
    absorbing.world.color = [0.5, 0.7, 0.9];
    set(&mut absorbing, "Color", color([0.0; 3]));
    set(&mut absorbing, "Density", Input::Number(20.0));
    set(&mut absorbing, "Emission Strength", Input::Number(0.5));
    let early = MarchSettings { exit_transmittance: 1e-3, view_step: 0.01, ..coarse() };
    let plain = MarchSettings { integration: Integration::Plain, ..coarse() };
    let mut dark = homogeneous();
    dark.lights.clear();
    dark.film.transparent = true;
    // In a sum of n steps in f64, n roundings of 2^-53: only a pixel in f32 may fall to its neighbour.
    let ulp = f64::from(f32::EPSILON);
    let cases: [(&str, Scene, MarchSettings, f64, Vec<Omission>); 7] = [
        ("sun, grid", homogeneous(), grid.clone(), 0.0, vec![World, Phase, Density, EmptyCells]),
        ("sun, exact", homogeneous(), coarse(), ulp, vec![World, Phase, Density, ShadowSteps, EmptyCells]),
        ("anisotropic, world", lit_by_world, coarse(), ulp, vec![Density, ShadowSteps, EmptyCells]),
        (
            "one exponential, early exit",
            absorbing.clone(),
            early,
            ulp,
            vec![InScatter, Lights, World, Phase, Density, ViewSteps, EmptyCells],
        ),
        ("plain emission", absorbing, plain, 0.0, vec![InScatter, Lights, World, Phase, Density, EmptyCells]),
        (
            "nothing shines",
            dark,
            grid.clone(),
            ulp,
            vec![InScatter, Lights, World, Phase, Density, ViewSteps, EmptyCells],
        ),
        ("cloud", cloud(), MarchSettings { view_step: 0.0, ..grid }, 0.0, vec![]),
    ];
    let mut seen = BTreeSet::new();
    for (name, scene, settings, tolerance, expected) in cases {
        let special = picture(&scene, &settings, Backend::Cpu);
        let generic = picture(&scene, &MarchSettings { specialise: false, ..settings }, Backend::Cpu);
        assert!(left_out(&generic).is_empty(), "{name}");
        if name != "cloud" {
            assert_eq!(left_out(&special), expected, "{name}");
        }
        seen.extend(left_out(&special).iter().map(|omission| format!("{omission:?}")));
        assert!(difference(&special, &generic) <= tolerance, "{name}: {:e}", difference(&special, &generic));
    }
    assert_eq!(seen.len(), 8, "an omission is tested nowhere: {seen:?}");
}

#[test]
fn the_adapter_leaves_out_integrates_and_jitters_as_the_cpu_does() {
    if !support::require("vulkan") {
        return;
    }
    let mut scene = cloud();
    let base = MarchSettings { grid_cells: 24, sub_pixels: 1, world_directions: 16, ..MarchSettings::default() };
    // As in tests/transport.rs: 200 steps in f32.
    let tolerance = 5e-5;
    let plain = MarchSettings { integration: Integration::Plain, ..base.clone() };
    let jitter = MarchSettings { jitter: Jitter::Pixel, seed: 3, ..base.clone() };
    // Where rays end early, what lies behind is lost on both sides alike.
    let early = MarchSettings { exit_transmittance: 0.3, ..plain.clone() };
    let twin = picture(&scene, &base, Backend::Cpu);
    for (name, settings) in [("plain", plain), ("jitter", jitter), ("early", early)] {
        let ours = picture(&scene, &settings, Backend::Cpu);
        let theirs = picture(&scene, &settings, Backend::Gpu);
        assert!(difference(&theirs, &ours) <= tolerance, "{name}: {:e}", difference(&theirs, &ours));
        assert!(difference(&ours, &twin) > 10.0 * tolerance, "{name} changes nothing");
    }
    for what in ["all", "no lights", "no world", "nothing"] {
        match what {
            "no lights" => scene.lights.clear(),
            "no world" => {
                scene = cloud();
                scene.world.color = [0.0; 3];
            }
            "nothing" => {
                scene.lights.clear();
                scene.film.transparent = true;
            }
            _ => {}
        }
        let special = picture(&scene, &base, Backend::Gpu);
        let generic = picture(&scene, &MarchSettings { specialise: false, ..base.clone() }, Backend::Gpu);
        // What is left out would add zeros: the same operations on the rest.
        assert_eq!(special.pixels, generic.pixels, "{what}");
    }
}

#[test]
fn what_leaving_out_is_worth_is_measured() {
    let has_adapter = support::require("vulkan");
    // Scenes that need little: no light; a constant density; one sun and no world.
    let mut dark = support::scene("linear-ramp");
    dark.lights.clear();
    dark.world.color = [0.0; 3];
    for (name, scene) in [("dark", dark), ("homogeneous-cube", support::scene("homogeneous-cube"))] {
        let found = leaving_out::measure(&scene, has_adapter).expect("measured");
        assert!(!found.left_out.is_empty(), "{name}");
        if let Some(kernel) = found.specialised {
            assert!(kernel.spirv_instructions < found.generic.spirv_instructions, "{name}: {found:?}");
            assert!(kernel.wgsl_bytes < found.generic.wgsl_bytes, "{name}: {found:?}");
        }
        assert_eq!(found.races.len(), 1 + usize::from(has_adapter));
        for race in &found.races {
            // What is left out would add zeros; no sum becomes a product here.
            assert_eq!(race.largest_ulp, 0, "{name}: {race:?}");
        }
    }
}

fn cache(cells: u32, format: CacheFormat, filter: CacheFilter) -> Option<CacheSettings> {
    Some(CacheSettings { cells, format, filter })
}

fn report(image: &Image) -> CacheReport {
    serde_json::from_str(&image.provenance["density_cache"]).expect("a report")
}

#[test]
fn the_field_error_of_a_cache_is_that_of_its_filter_and_format() {
    // A density 0 to 2 that is linear along the view: trilinear filtering is exact, nearest is off by up to half a cell.
    let mut scene = homogeneous();
    ramp(&mut scene, "Y", 2.0);
    let uncached = render(&scene, &coarse());
    for format in FORMATS {
        let settings = MarchSettings { density_cache: cache(10, format, CacheFilter::Trilinear), ..coarse() };
        let image = picture(&scene, &settings, Backend::Cpu);
        let found = report(&image);
        assert_eq!(found.vertices, [11; 3]);
        assert_eq!(found.bytes, 1331 * format.bytes());
        assert_eq!(found.not_finite, 0);
        // Rounding to 8 bits of a range of 2, to binary16 of a number up to 2, or of the sums in f32; and not less
        // than a tenth of it, for the vertices' values are no round numbers.
        let most = match format {
            CacheFormat::F32 => 4e-7,
            CacheFormat::F16 => 1.0 / 2048.0,
            CacheFormat::Unorm8 => 1.0 / 510.0 + 1e-6,
        };
        let range = 0.1 * most..=most;
        assert!(format == CacheFormat::F32 || range.contains(&found.relative_max_error), "{found}");
        assert!(found.relative_max_error <= most && found.relative_rms_error <= found.relative_max_error, "{found}");
        close(found.largest_density, 2.0, 1e-3);
        close(found.max_error, found.relative_max_error, 1e-9);
        // The picture's relative error is at most that of the density times its change with it, which is below 4.
        close(image.mean()[0], uncached[0], 4.0 * most);
    }
    let settings = MarchSettings { density_cache: cache(10, CacheFormat::F32, CacheFilter::Nearest), ..coarse() };
    let found = report(&picture(&scene, &settings, Backend::Cpu));
    // Of 2^16 random places one is almost in the middle of two vertices.
    assert!((0.049..=0.050001).contains(&found.relative_max_error), "{found}");
    // Uniform up to half a cell: its root mean square is that over the root of 3.
    close(found.relative_rms_error, 0.05 / 3.0_f64.sqrt(), 0.02);
    let [coarse, fine] = [8, 32].map(|cells| {
        let density_cache = cache(cells, CacheFormat::F16, CacheFilter::Trilinear);
        let settings = MarchSettings { density_cache, grid_cells: 8, sub_pixels: 1, ..MarchSettings::default() };
        report(&picture(&cloud(), &settings, Backend::Cpu)).relative_rms_error
    });
    assert!(0.8 * coarse > fine && fine > 1e-3, "{coarse} {fine}");
}

#[test]
fn both_shadows_and_views_read_the_cache() {
    // A cache of one cell with nearest filtering sees density 0 in the lower and 2 in the upper half, where the ramp
    // along Z has 1 at the central ray. The ray lies in the middle and reads the upper vertex.
    let mut scene = homogeneous();
    ramp(&mut scene, "Z", 2.0);
    scene.film.resolution = [1, 1];
    let density_cache = cache(1, CacheFormat::F32, CacheFilter::Nearest);
    let found = render(&scene, &MarchSettings { view_step: 0.01, density_cache, ..coarse() });
    // Extinction 2 for the whole way up and along the view.
    let expected = 0.6 * 2.0 * SUN * phase(0.0, 0.0) * (-2.0_f64).exp() * (1.0 - (-4.0_f64).exp()) / 2.0;
    close(found[0], expected, 1e-6);
}

#[test]
fn a_format_that_cannot_hold_the_density_is_refused() {
    let mut scene = homogeneous();
    ramp(&mut scene, "Y", 1e6);
    for (format, fits) in FORMATS.into_iter().zip([true, false, true]) {
        let settings = MarchSettings { density_cache: cache(4, format, CacheFilter::Trilinear), ..coarse() };
        let result = integrators::render(&scene, &settings, Backend::Cpu, &|_, _| {});
        match result {
            Ok(_) => assert!(fits, "{format:?}"),
            Err(error) => {
                assert!(!fits, "{error}");
                assert!(error.found.contains("1e6") && error.expected.contains("6.5504e4"), "{error}");
            }
        }
    }
}

#[test]
fn the_adapter_reads_caches_as_the_cpu_does() {
    if !support::require("vulkan") {
        return;
    }
    let scene = cloud();
    let base = MarchSettings { grid_cells: 24, sub_pixels: 1, world_directions: 16, ..MarchSettings::default() };
    let uncached = picture(&scene, &base, Backend::Cpu);
    for format in FORMATS {
        for filter in [CacheFilter::Nearest, CacheFilter::Trilinear] {
            let settings = MarchSettings { density_cache: cache(24, format, filter), ..base.clone() };
            let ours = picture(&scene, &settings, Backend::Cpu);
            let theirs = picture(&scene, &settings, Backend::Gpu);
            assert_eq!(report(&ours).settings, report(&theirs).settings);
            let name = format!("{}, {}", format.name(), filter.name());
            // 200 steps in f32, as without a cache.
            let tolerance = 5e-5;
            assert!(difference(&ours, &uncached) > 20.0 * tolerance, "{name} changes nothing");
            if filter == CacheFilter::Trilinear {
                assert!(difference(&theirs, &ours) <= tolerance, "{name}: {:e}", difference(&theirs, &ours));
                continue;
            }
            // A step within rounding of the middle between two vertices (3 axes of 2^-22 of 24 cells and as much of
            // the position: 5e-5 of all steps) may read either: of 576 rays of 200 steps about six, each of which
            // moves its pixel by at most a step's share. Vertices of the light grid may fall alike.
            let brightest = ours.pixels.iter().flatten().copied().fold(0.0_f32, f32::max);
            let far = ours.pixels.iter().zip(&theirs.pixels).filter(|(a, b)| {
                a.iter().zip(b.iter()).any(|(a, b)| f64::from((a - b).abs()) > tolerance * f64::from(brightest))
            });
            let far = far.count();
            assert!(far <= 29, "{name}: {far} of 576 pixels are far off");
            assert!(difference(&theirs, &ours) <= 0.02, "{name}: {:e}", difference(&theirs, &ours));
        }
    }
}

fn measured(scene: &Scene, settings: &ConvergenceSettings, folder: Option<&Path>) -> Convergence {
    let found = measure(scene, settings, folder, &Default::default(), &|_, _| {});
    found.and_then(Outcome::all).expect("it is measured")
}

#[test]
fn an_interrupted_measurement_of_convergence_goes_on() {
    let mut scene = homogeneous();
    ramp(&mut scene, "Y", 2.0);
    scene.film.resolution = [8, 8];
    let settings = ConvergenceSettings {
        steps: vec![2, 4, 8, 16],
        cache_cells: vec![3, 5],
        march: MarchSettings { sub_pixels: 1, light: LightMode::Grid, grid_cells: 8, ..MarchSettings::default() },
    };
    let folder = tempfile::tempdir().expect("a folder");
    let whole = measured(&scene, &settings, Some(folder.path()));
    // Times are measured: equal ones were read.
    assert_eq!(measured(&scene, &settings, Some(folder.path())), whole);
    // Without the record of five cells: they are compared with the picture that was kept.
    let is_of_five = |path: &Path| {
        let text = std::fs::read_to_string(path).expect("a record");
        text.contains("\"cells\": 5")
    };
    let records: Vec<_> = std::fs::read_dir(folder.path().join("records"))
        .expect("a folder")
        .map(|entry| entry.expect("an entry").path())
        .collect();
    assert_eq!(records.len(), 3);
    let lost: Vec<_> = records.into_iter().filter(|path| is_of_five(path)).collect();
    assert_eq!(lost.len(), 1);
    std::fs::remove_file(&lost[0]).expect("removed");
    let again = measured(&scene, &settings, Some(folder.path()));
    assert_eq!(again.points, whole.points);
    for (again, whole) in again.caches.iter().zip(&whole.caches) {
        assert_eq!(again.error, whole.error);
    }
    assert_eq!(again.caches.len(), 12);
}

#[test]
fn orders_of_convergence_are_those_of_theory() {
    // Smooth: density 0 to 2 along the view, lit from above. The midpoint rule is of second order, plain of first.
    let settings = |cells: &[u32]| ConvergenceSettings {
        steps: vec![8, 16, 32, 64, 128],
        cache_cells: cells.to_vec(),
        march: MarchSettings {
            sub_pixels: 1,
            light: LightMode::Grid,
            grid_cells: 16,
            exit_transmittance: 0.0,
            ..MarchSettings::default()
        },
    };
    let mut smooth = homogeneous();
    ramp(&mut smooth, "Y", 2.0);
    let found = measured(&smooth, &settings(&[7]), None);
    assert_eq!(found.points.len(), 10);
    assert_eq!(found.reference_steps, 512);
    let order = |integration: Integration| {
        let mut orders = found.orders.iter().filter(|order| order.integration == integration);
        std::array::from_fn::<f64, 3, _>(|_| {
            let order = orders.next().expect("three figures are fitted");
            assert!(order.asymptotic, "{order:?}");
            order.order
        })
    };
    // The reference's own error steepens the slope by up to log2 of (1 - 1/8) / (1 - 1/16) in the last pair, 0.1.
    for found in order(Integration::EnergyConserving) {
        assert!((found - 2.0).abs() < 0.1, "energy-conserving: {found}");
    }
    for found in order(Integration::Plain) {
        assert!((found - 1.0).abs() < 0.15, "plain: {found}");
    }
    // A trilinear cache in f32 holds a linear density to its rounding; every other is seen (sevenths are no round
    // numbers of any format).
    let bias: Vec<f64> = found.caches.iter().map(|point| point.error.root_relmse).collect();
    assert_eq!(bias.len(), 6);
    assert!(bias[1] < 1e-6, "{bias:?}");
    assert!([0, 2, 3, 4, 5].iter().all(|&number| bias[number] > 1e-5), "{bias:?}");
    assert_eq!(found.csv().lines().count(), 1 + 10 + 6);
    // A jump: the order falls to one.
    let mut jump = homogeneous();
    sphere(&mut jump);
    jump.camera.ortho_scale = 1.2;
    jump.film.resolution = [12, 12];
    let found = measured(&jump, &settings(&[]), None);
    assert!(found.caches.is_empty());
    let by_pixel: Vec<_> = found.orders.iter().filter(|order| order.figure != "relative_mean_error").collect();
    assert_eq!(by_pixel.len(), 4);
    for order in by_pixel {
        assert!((0.7..1.35).contains(&order.order), "{order:?}");
    }
}
