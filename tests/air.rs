//! Air between the eye and a cloud, light from the ground, and steps that grow, in closed forms: a slab of one density in metres above a ground, the
//! same on the adapter.

mod support;

use cloudparity::engines::domain::{Container, Domain, Outline};
use cloudparity::engines::light::terms::{Ground, Terms};
use cloudparity::engines::light::{
    LightModel, ShadowExtinction, ShadowLength, ShadowMapSettings, ShadowMarch, SourceFactor, Sun, TwoLobes,
};
use cloudparity::engines::march::air::{Air, Haze, MarchRays, Shafts};
use cloudparity::engines::march::gpu::MarchKernel;
use cloudparity::engines::march::shadow_map::ShadowMap;
use cloudparity::engines::march::{Marched, RealTimeRay, RealTimeSettings};
use cloudparity::engines::render::EngineRenderer;
use cloudparity::gpu::Gpu;
use cloudparity::graph::Program;
use cloudparity::media::density::Density;
use cloudparity::media::region::Region;
use cloudparity::media::transfer::Integration;
use cloudparity::view::camera::Camera;
use glam::{DMat4, DVec2, DVec3};
use rand::{Rng as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::PI;
use std::sync::Arc;

/// A box of 2 km x 2 km from 1000 m to 1500 m, of density 1.
struct Slab {
    container: Container,
    density: Density,
    extinction: f64,
    light: LightModel,
}

impl Slab {
    fn new(extinction: f64, sun: DVec3) -> Self {
        let region = Region { low: DVec3::new(-1000.0, -1000.0, 1000.0), high: DVec3::new(1000.0, 1000.0, 1500.0) };
        let outline = Outline::Box(region);
        let shadow = ShadowMarch {
            map: Some(ShadowMapSettings::new(64, 64, 1.0)),
            ..ShadowMarch::new(4, ShadowLength::ToExit, ShadowExtinction::View)
        };
        Self {
            container: Container { domain: Domain::Object, to_local: DMat4::IDENTITY, outline, unit: 1.0 },
            density: Density::filling(Arc::new(Program::constant("one", 1.0)), region),
            extinction,
            light: LightModel {
                suns: vec![Sun { direction: sun.to_array(), irradiance: [1.0; 3] }],
                ambient: [0.0; 3],
                phase: TwoLobes::new([0.0; 2], 0.0),
                shadow,
                source: SourceFactor::Albedo([0.0; 3]),
                terms: Terms::NONE,
            },
        }
    }

    /// What a march goes through, without maps.
    fn marched<'a>(&'a self, air: Option<&'a Air>) -> Marched<'a> {
        Marched {
            container: &self.container,
            density: &self.density,
            extinction: [self.extinction; 3],
            averages: None,
            maps: &[],
            light: &self.light,
            terms: &[],
            light_volume: None,
            air,
        }
    }

    /// Red of a ray from a place along a direction, on the CPU and on the adapter; what lies beyond `farthest` is hidden.
    fn seen(&self, air: Option<&Air>, from: DVec3, along: DVec3, farthest: f64) -> Vec<f64> {
        let mut marched = self.marched(air);
        let maps = ShadowMap::of(&marched, None).expect("maps");
        marched.maps = &maps;
        let settings = RealTimeSettings {
            least_transmittance: 0.0,
            ..RealTimeSettings::until_one_percent(64.0, Integration::EnergyConserving)
        };
        let ray: RealTimeRay = self.container.ray(from, along, farthest, 0.5);
        let mut found = marched.march(&settings, &[ray]).expect("marched");
        if support::require("vulkan") {
            let gpu = Gpu::open().expect("the adapter that was just there");
            found
                .extend(MarchKernel::new(&gpu, &marched, &settings).expect("a kernel").march(&[ray]).expect("marched"));
        }
        found.iter().map(|pixel| pixel.radiance[0]).collect()
    }
}

/// Haze that sends back all that it takes of a sun of irradiance 1, alike in all directions.
fn haze(density: f64) -> Haze {
    Haze { density, albedo: 4.0 * PI, is_level: true }
}

/// Air whose height is the third coordinate.
fn air() -> Air {
    Air::none(1.0, [1.0, 0.0], 1500.0)
}

#[test]
fn shafts_are_as_long_as_the_shadow() {
    let density = 1e-4;
    let farthest = 3000.0;
    // Level at 500 m from below the middle towards +x: the shadow ends under the edge, or with a sun at 45 degrees over +x half a kilometre before.
    for (sun, expected) in [(DVec3::Z, 1000.0), (DVec3::new(1.0, 0.0, 1.0), 500.0)] {
        let slab = Slab::new(10.0, sun);
        let at_eye = density * (-0.5_f64).exp();
        let of = |shafts: Option<Shafts>| -> Vec<f64> {
            let air = Air { haze: Some(haze(density)), shafts, ..air() };
            let found = slab.seen(Some(&air), DVec3::new(0.0, 0.0, 500.0), DVec3::X, farthest);
            // Of the length that is lit.
            found.iter().map(|radiance| farthest + (-radiance).ln_1p() / at_eye).collect()
        };
        // Published haze takes a level ray for one that rises by 1e-5: 1.5e-5 of the length, and f32 knows 1 - exp(-0.18) to 1e-6.
        assert!(of(None).iter().all(|shadow| shadow.abs() < 0.2), "{:?}", of(None));
        for (fades, least) in [(false, 1.0), (true, 0.98)] {
            for shadow in of(Some(Shafts { fades, strength: 1.0 })) {
                // A step is in the shadow or not by its middle; the last is 50 m + 1 % of the way. A texel is 31 m wide, 45 m with the sun aslant.
                let bound = (50.0 + 0.01 * expected) / 2.0 + 45.0;
                let [low, high] = [least * expected - bound, expected + bound];
                assert!(low < shadow && shadow < high, "{sun}, {fades}: {shadow} m, not {expected} m");
            }
        }
        // Steps lie in the shadow or do not: their number follows from their sum, and what they count from their number.
        let [plain, faded] = [false, true].map(|fades| of(Some(Shafts { fades, strength: 1.0 })));
        // A third of the strength is a third of the length; f32 knows the lit rest to 2e-3 m.
        let third = of(Some(Shafts { fades: false, strength: 1.0 / 3.0 }));
        assert!(
            plain.iter().zip(&third).all(|(plain, third)| (plain - 3.0 * third).abs() < 1.0),
            "{plain:?}, {third:?}"
        );
        for (plain, faded) in plain.into_iter().zip(faded) {
            let (mut step, mut share, mut sums) = (50.0, 1.0, [0.0; 2]);
            while sums[0] + step / 2.0 < plain {
                sums = [sums[0] + step, sums[1] + share * step];
                (step, share) = (step * 1.01, share * 0.999);
            }
            // As above, and what a texel at the edge lets through.
            assert!(
                (plain - sums[0]).abs() < 1.0 && (faded - sums[1]).abs() < 1.0,
                "{plain} m, {faded} m, not {sums:?}"
            );
            assert!(sums[0] - sums[1] > 2.0);
        }
    }
}

#[test]
fn rays_of_the_march_lie_in_the_shadow_only_when_corrected() {
    let slab = Slab::new(10.0, DVec3::Z);
    let of = |counts_samples: bool, from: DVec3| {
        let rays = MarchRays { intensity: 2.0, density: 3.0, samples: 16, counts_samples };
        slab.seen(Some(&Air { rays: Some(rays), ..air() }), from, DVec3::X, 1e5)
    };
    // Outside the shadow and at the height 0, where fog does not fall: 0.01 / pi x 2 x 3 x (1 - 0.95^16) / 0.05.
    let whole = 0.06 / PI * (1.0 - 0.95_f64.powi(16)) / 0.05;
    for (counts_samples, x, expected) in
        [(true, -400.0, whole), (false, -400.0, 0.0), (true, 2000.0, whole), (false, 2000.0, whole)]
    {
        for found in of(counts_samples, DVec3::new(x, 0.0, 0.0)) {
            // Sixteen sums in f32 of terms with three roundings each.
            assert!(
                (found - expected).abs() < 40.0 / 8_388_608.0 * whole,
                "{counts_samples}, {x}: {found}, not {expected}"
            );
        }
    }
    // Inside the cloud, which hides nothing of them as published but half: over 500 m the density is 1.
    let inside = DVec3::new(-900.0, 0.0, 1250.0);
    let clear = Slab { extinction: 0.0, ..Slab::new(0.0, DVec3::Z) };
    let rays = MarchRays { intensity: 2.0, density: 3.0, samples: 16, counts_samples: true };
    for found in clear.seen(Some(&Air { rays: Some(rays), ..air() }), inside, DVec3::X, 1e5) {
        let expected = 0.5 * (-1.25_f64).exp() * whole;
        assert!((found - expected).abs() < 40.0 / 8_388_608.0 * whole, "{found}, not {expected}");
    }
}

#[test]
fn haze_and_air_over_an_opaque_cloud_are_those_up_to_its_front() {
    // Level in the layer's height towards its face 4 km away, whose extinction stops light within a metre: the cloud, which is black, is hidden by what
    // the air up to there sends back.
    let slab = Slab::new(10.0, DVec3::Z);
    let from = DVec3::new(-5000.0, 0.0, 1250.0);
    let density = 1e-4;
    let hazy = Air { haze: Some(haze(density)), ..air() };
    // Steps are 31 m long: the front lies in the middle of the first.
    let front = 4000.0 + 2000.0 / 64.0 / 2.0;
    for found in slab.seen(Some(&hazy), from, DVec3::X, 1e5) {
        let expected = -(-density * (-1.25_f64).exp() * front).exp_m1();
        // LEAST_RISE, and f32.
        assert!((found / expected - 1.0).abs() < 5e-5, "{found}, not {expected}");
    }
    let aerial = Air { aerial: Some(5.0), ..air() };
    for found in slab.seen(Some(&aerial), from, DVec3::X, 1e5) {
        // Red, at right angles to the sun: Rayleigh's 3 / 16 pi, and Cornette and Shanks' of 0.8.
        let [air, haze] = [8000.0_f64, 1200.0].map(|fall| 5.0 * (-1250.0 / fall).exp() * front);
        let g: f64 = 0.8;
        let shanks = 3.0 / (8.0 * PI) * (1.0 - g * g) / (2.0 + g * g) / (1.0 + g * g).powf(1.5);
        let depth = 5.802e-6 * air + 3.996e-6 / 0.9 * haze;
        let scattered = 5.802e-6 * air * 3.0 / (16.0 * PI) + 3.996e-6 * haze * shanks;
        let expected = scattered * -(-depth).exp_m1() / depth;
        assert!((found / expected - 1.0).abs() < 1e-5, "{found}, not {expected}");
    }
}

#[test]
fn light_from_the_ground_is_dimmed_by_what_lies_below() {
    let extinction = 1e-3;
    let mut slab = Slab::new(extinction, DVec3::Z);
    slab.light.source = SourceFactor::Albedo([1.0; 3]);
    slab.light.suns[0].irradiance = [0.0; 3];
    slab.light.ambient = [2.0; 3];
    slab.light.terms.ambient = [0.0; 2];
    slab.light.terms.ground =
        Some(Ground { of_world: 0.5 / PI, of_suns: 0.0, steps: 3, first: 100.0 / 3.0, highest: 0.5 });
    // 200 m above the base: three steps of 33, 67 and 133 m, whose middles are all inside.
    for found in slab.seen(None, DVec3::new(-5000.0, 0.0, 1200.0), DVec3::X, 1e5) {
        let expected = (-extinction * 700.0 / 3.0).exp() * -(-extinction * 2000.0).exp_m1();
        assert!((found / expected - 1.0).abs() < 1e-5, "{found}, not {expected}");
    }
    // None above the highest place.
    assert_eq!(slab.seen(None, DVec3::new(-5000.0, 0.0, 1300.0), DVec3::X, 1e5)[0], 0.0);
    // 50 m above it only those of the first.
    for found in slab.seen(None, DVec3::new(-5000.0, 0.0, 1050.0), DVec3::X, 1e5) {
        let expected = (-extinction * 100.0 / 3.0).exp() * -(-extinction * 2000.0).exp_m1();
        assert!((found / expected - 1.0).abs() < 1e-5, "{found}, not {expected}");
    }
}

#[test]
fn air_is_refused_where_it_has_no_meaning() {
    let mut slab = Slab::new(1.0, DVec3::Z);
    slab.light.shadow.map = None;
    let air = Air { haze: Some(haze(1e-4)), shafts: Some(Shafts { fades: false, strength: 1.0 }), ..air() };
    let marched = slab.marched(Some(&air));
    let error = marched.check().expect_err("no map").to_string();
    assert!(error.contains("shadow_map") && error.contains("shafts"), "{error}");
    let round = Container { outline: Outline::Shell { inner: 1.0, outer: 2.0 }, ..slab.container.clone() };
    let error = Marched { container: &round, ..slab.marched(Some(&air)) }.check().expect_err("a shell").to_string();
    assert!(error.contains("a shell"), "{error}");
    // Meshes have no inside that both know where rays of the march and light from the ground ask for it.
    let mesh = support::scene("mesh-sphere");
    for (model, change) in [("bolt", "march_ray_intensity=1"), ("takram", "ground_steps=3")] {
        let model = cloudparity::engines::find(model).expect("it is there");
        let none = cloudparity::engines::defects::Defects::NONE;
        let of = |changes: &[String]| {
            let values = model.values(None, changes).expect("in range");
            let engine = model.engine(&mesh, &values, &none, 0.0).expect("an engine");
            EngineRenderer::new(&mesh, &engine, None).map(|_| ()).err().map(|error| error.to_string())
        };
        assert_eq!(of(&["march_steps=4".into()]), None);
        let error = of(&[change.into()]).expect("refused");
        assert!(error.contains("in a mesh"), "{error}");
    }
    let scene = support::scene("cloud-layer");
    let model = cloudparity::engines::find("takram").expect("it is there");
    let values = model.values(None, &["step_growth=1.1".into(), "march_steps=500".into()]).expect("in range");
    let none = cloudparity::engines::defects::Defects::NONE;
    let error = model.engine(&scene, &values, &none, 0.0).err().expect("too much").to_string();
    assert!(error.contains("step_growth"), "{error}");
}

#[test]
fn maps_of_parts_of_a_view_are_those_of_the_whole() {
    let mut slab = Slab::new(1e-3, DVec3::Z);
    let mut scene = support::scene("cloud-layer");
    scene.camera.clip_end = 1e5;
    // From its inside.
    let looking =
        DMat4::from_cols(DVec3::X.extend(0.0), DVec3::Z.extend(0.0), DVec3::NEG_Y.extend(0.0), DVec3::ZERO.extend(1.0));
    // Turned against the axes of the maps.
    let looking = DMat4::from_translation(DVec3::new(200.0, -400.0, 1250.0)) * DMat4::from_rotation_z(0.6) * looking;
    scene.camera.matrix_world = cloudparity::scene::matrix_from_glam(looking);
    let camera = Camera::new(&scene, [64, 36]).expect("a camera");
    let maps = |slab: &Slab, camera| ShadowMap::of(&slab.marched(None), camera);
    let whole = maps(&slab, None).expect("a map").remove(0);
    for (cascades, split) in [(2, 0.6), (3, 0.6), (3, 0.9), (4, 0.3), (4, 0.6)] {
        slab.light.shadow.map = Some(ShadowMapSettings { cascades, split, ..ShadowMapSettings::new(128, 64, 1.0) });
        let parts = maps(&slab, Some(&camera)).expect("maps");
        assert_eq!(parts.len(), cascades as usize);
        let mut used = vec![0; parts.len()];
        let mut random = ChaCha8Rng::seed_from_u64(7);
        for _ in 0..4000 {
            let raster = DVec2::new(random.random_range(0.0..64.0), random.random_range(0.0..36.0));
            let ray = camera.ray(raster);
            let place = ray.origin + ray.direction * random.random_range(1.0..1000.0);
            // Half a kilometre from its sides, more than a texel of the widest map.
            if place.x.abs() > 500.0 || place.y.abs() > 500.0 || !slab.container.outline.holds(place) {
                continue;
            }
            let map = ShadowMap::chosen(&parts, place, random.random_range(0.0..1.0)).expect("a part of the view");
            used[parts.iter().position(|part| std::ptr::eq(part, map)).expect("one of them")] += 1;
            let [found, expected] = [map.read_below(place, 100.0), whole.read(place, 100.0)];
            assert!((found - expected).abs() <= 1e-4 * 500.0, "{cascades}, {place}: {found}, not {expected}");
        }
        assert!(used.iter().all(|&count| count > 10), "{cascades}: {used:?}");
    }
    // Even depths, and even logarithms: of the last, a cut is the geometric mean of its neighbours.
    let ends = |slab: &mut Slab, split| {
        slab.light.shadow.map = Some(ShadowMapSettings { cascades: 3, split, ..ShadowMapSettings::new(8, 4, 1.0) });
        let parts = maps(slab, Some(&camera)).expect("maps");
        [0, 1, 2].map(|part: usize| parts[part].cascade.expect("a part of the view").ends[1])
    };
    let even = ends(&mut slab, 0.0);
    // The near clip is a ten-thousandth of the far one.
    assert!(
        (even[0] - 1.0 / 3.0).abs() < 1e-3 && (even[1] - 2.0 / 3.0).abs() < 1e-3 && (even[2] - 1.0).abs() < 1e-12,
        "{even:?}"
    );
    let logarithmic = ends(&mut slab, 1.0);
    assert!(logarithmic[0] < 0.1 && (logarithmic[1].powi(2) - logarithmic[0]).abs() < 1e-9, "{logarithmic:?}");
    slab.light.shadow.map = Some(ShadowMapSettings { cascades: 4, ..ShadowMapSettings::new(128, 64, 1.0) });
    // Between two parts the jitter decides, over a quarter of the square of the depth on both sides.
    let maps = maps(&slab, Some(&camera)).expect("maps");
    let cut = maps[0].cascade.expect("a part of the view").ends[1];
    let at = |depth: f64, jitter: f64| {
        let cascade = maps[0].cascade.expect("a part of the view");
        let (view, middle) = (cascade.view.truncate(), DVec3::new(0.0, 0.0, 1250.0));
        let place = middle + view * ((depth - cascade.view.w - view.dot(middle)) / view.length_squared());
        let map = ShadowMap::chosen(&maps, place, jitter).expect("a part");
        maps.iter().position(|part| std::ptr::eq(part, map)).expect("one of them")
    };
    let margin = 0.25 * cut * cut;
    assert_eq!(
        [at(cut - 1.01 * margin, 0.99), at(cut, 0.4), at(cut, 0.6), at(cut + 1.01 * margin, 0.99)],
        [0, 1, 0, 1]
    );
    let mut panorama = scene.clone();
    panorama.camera.projection = cloudparity::scene::Projection::Equirectangular;
    panorama.camera.panorama = Some(cloudparity::scene::Panorama {
        longitude_min: -3.0,
        longitude_max: 3.0,
        latitude_min: -1.5,
        latitude_max: 1.5,
    });
    let panorama = Camera::new(&panorama, [64, 36]).expect("a camera");
    for (cascades, layers, size, camera, named) in [
        (5, 0, 8, Some(&camera), "up to 4"),
        (2, 4, 8, Some(&camera), "with layers"),
        (2, 0, 8, Some(&panorama), "looks at a plane"),
        (2, 0, 8, None, "looks at a plane"),
        (4, 0, 4096, Some(&camera), "128 MiB"),
    ] {
        slab.light.shadow.map = Some(ShadowMapSettings { cascades, ..ShadowMapSettings::new(size, 8, 1.0) });
        slab.light.shadow.layers = layers;
        let error = ShadowMap::of(&slab.marched(None), camera).expect_err("refused").to_string();
        assert!(error.contains(named), "{error}");
    }
}
