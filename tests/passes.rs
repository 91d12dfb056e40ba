//! Passes over pictures: each twin on the adapter against the one on the CPU, within what f32 may be off by; where god rays come from.

mod support;

use cloudparity::engines::light::Sun;
use cloudparity::engines::march::RealTimePixel;
use cloudparity::engines::march::gpu::Pixel;
use cloudparity::engines::passes::compositing::{Background, CompositeKernel, Compositing, Part, mean_transmittance};
use cloudparity::engines::passes::frame::Frame;
use cloudparity::engines::passes::god_rays::{GodRayKernel, GodRayPass, GodRays, SUN_GLOW, half};
use cloudparity::engines::passes::height_fog::HeightFog;
use cloudparity::engines::passes::{Channels, Pass, PassKernel, View};
use cloudparity::gpu::Gpu;
use cloudparity::scene::image::Image;
use cloudparity::scene::{Projection, Scene};
use cloudparity::view::camera::Camera;
use glam::{DVec2, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;
use support::rounding::{U, blur_error};

/// Sizes of frames: one pixel, one row or column, odd and even sides, more than a workgroup.
const SIZES: [[u32; 2]; 7] = [[1, 1], [1, 9], [7, 1], [2, 2], [5, 3], [33, 17], [40, 24]];

/// Numbers that f32 holds.
fn single(value: f64) -> f64 {
    f64::from(value as f32)
}

/// Rays at random; one in five lets nothing through, one in five everything.
fn random_rays(random: &mut ChaCha8Rng, count: usize) -> Vec<RealTimePixel> {
    (0..count)
        .map(|_| {
            let kind = random.random_range(0..5);
            let radiance = std::array::from_fn(|_| single(random.random_range(0.0..20.0_f64).powi(2)));
            let transmittance = std::array::from_fn(|_| match kind {
                0 => 0.0,
                1 => 1.0,
                _ => single(random.random()),
            });
            RealTimePixel { radiance, transmittance, samples: 1, dense: 1, distance: None }
        })
        .collect()
}

#[test]
fn compositing_is_the_same_on_the_adapter() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("the adapter that was just there");
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let constant = [0.25, 3.0, 40.0];
    for number in 0..12 {
        let compositing = Compositing { alpha_of_red: number & 1 == 1, alpha_twice: number & 2 == 2 };
        let channels = Channels { transmittance: number % 3 == 0 };
        for (at, [width, height]) in SIZES.into_iter().enumerate() {
            let rays = [1, 4, 9][at % 3];
            let count = width * height;
            let mut marched = random_rays(&mut random, (count * rays) as usize);
            // One ray of one pixel is no number; the pixel has to show it, and no other.
            let broken = (count / 2) as usize;
            marched[broken * rays as usize].radiance[1] = f64::NAN;
            let behind: Vec<f32> = (0..3 * count).map(|_| random.random()).collect();
            let background = match number / 4 {
                0 => Background::None,
                1 => Background::Constant(constant),
                _ => Background::PerPixel(gpu.upload(
                    "behind",
                    bytemuck::cast_slice(&behind),
                    wgpu::BufferUsages::STORAGE,
                )),
            };
            let kernel = CompositeKernel::new(&gpu, compositing, background.clone(), channels).expect("a kernel");
            let frame = Frame::new(&gpu, [width, height], channels).expect("a frame");
            let exposure = 1.75;
            // In two parts, as a march goes on.
            let parts = [0..count / 3, count / 3..count];
            for pixels in parts.into_iter().filter(|pixels| !pixels.is_empty()) {
                let data: Vec<Pixel> = marched[(pixels.start * rays) as usize..(pixels.end * rays) as usize]
                    .iter()
                    .map(Pixel::from)
                    .collect();
                let buffer = gpu.upload("marched", bytemuck::cast_slice(&data), wgpu::BufferUsages::STORAGE);
                let part = Part { first: pixels.start, count: pixels.end - pixels.start, rays };
                kernel.run(&frame, &buffer, part, exposure).expect("submitted");
            }
            let found = frame.read_back(&gpu).expect("a picture");
            for (pixel, own) in marched.chunks_exact(rays as usize).enumerate() {
                let behind = match background {
                    Background::None => None,
                    Background::Constant(radiance) => Some(radiance),
                    Background::PerPixel(_) => Some([0, 1, 2].map(|channel| f64::from(behind[3 * pixel + channel]))),
                };
                let expected = compositing.compose(own, behind, exposure);
                for channel in 0..4 {
                    // A ray has four roundings (the weight, two products, their sum), the mean one per ray, six of its division and its
                    // product, and two of the exposure; alpha has eight, of its sum, its division and its difference.
                    let terms: f64 = own
                        .iter()
                        .map(|ray| match channel {
                            3 => 1.0,
                            _ => {
                                let behind = behind.map_or(0.0, |behind| behind[channel]);
                                let through = ray.transmittance.into_iter().fold(0.0, f64::max);
                                ray.radiance[channel].abs() + through * behind
                            }
                        })
                        .sum();
                    let bound = f64::from(rays + 12) * U * terms / f64::from(rays) * exposure;
                    let [ours, theirs] = [found.pixels[pixel][channel], expected[channel]].map(f64::from);
                    if pixel == broken && channel == 1 {
                        assert!(ours.is_nan() && theirs.is_nan(), "{ours} {theirs}");
                    } else {
                        let error = (ours - theirs).abs();
                        // The CPU's result is rounded once.
                        assert!(
                            error <= bound + U * theirs.abs(),
                            "{compositing:?}, {width} x {height}: {error:e} of {bound:e}"
                        );
                    }
                }
                if let Some(transmittance) = &found.transmittance {
                    for (ours, theirs) in transmittance[pixel].into_iter().zip(mean_transmittance(own)) {
                        let error = f64::from((ours - theirs).abs());
                        assert!(error <= f64::from(rays + 8) * U, "{error:e}");
                    }
                }
            }
            assert_eq!(found.transmittance.is_some(), channels.transmittance, "what is not asked for is not there");
        }
    }
}

#[test]
fn compositing_refuses_what_does_not_fit() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("the adapter that was just there");
    let channels = Channels { transmittance: true };
    let mut kernel =
        CompositeKernel::new(&gpu, Compositing::default(), Background::Constant([1.0; 3]), channels).expect("a kernel");
    let marched = gpu.upload(
        "marched",
        bytemuck::cast_slice(&[Pixel::from(&random_rays(&mut ChaCha8Rng::seed_from_u64(1), 1)[0]); 4]),
        wgpu::BufferUsages::STORAGE,
    );
    let frame = Frame::new(&gpu, [2, 2], channels).expect("a frame");
    let run = |kernel: &CompositeKernel<'_>, frame: &Frame, first, count, rays| {
        kernel.run(frame, &marched, Part { first, count, rays }, 1.0).map_err(|error| error.to_string())
    };
    assert_eq!(run(&kernel, &frame, 0, 4, 1), Ok(()));
    for (first, count, rays) in [(1, 4, 1), (0, 4, 2), (0, 1, 0), (u32::MAX, 1, 1)] {
        let error = run(&kernel, &frame, first, count, rays).expect_err("refused");
        assert!(error.contains("4 of the frame") && error.contains("4 that were marched"), "{error}");
    }
    let bare = Frame::new(&gpu, [2, 2], Channels::default()).expect("a frame");
    assert!(run(&kernel, &bare, 0, 4, 1).expect_err("refused").contains("without transmittance"));
    assert!(
        kernel.set_background(Background::None).is_err()
            && kernel.set_background(Background::Constant([2.0; 3])).is_ok()
    );
    for size in [[0, 4], [u32::MAX, u32::MAX]] {
        let error = Frame::new(&gpu, size, channels).map(|_| ()).expect_err("no such frame").to_string();
        assert!(error.contains("pixels"), "{error}");
    }
}

/// A camera that looks along +y from the origin.
fn camera(size: [u32; 2], focal_length: f32, projection: Projection) -> Camera {
    let mut scene: Scene = support::scene("linear-ramp");
    scene.camera.matrix_world =
        [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    scene.camera.focal_length = focal_length;
    scene.camera.projection = projection;
    Camera::new(&scene, size).expect("a camera")
}

/// A view of a camera whose place is the middle of the medium, so that a sun's point is in its direction.
fn view<'a>(camera: &'a Camera, suns: &'a [Sun]) -> View<'a> {
    View { camera, exposure: 1.5, suns, centre: DVec3::ZERO, side: 2.0 }
}

fn pass(from_behind: bool, samples: u32) -> GodRayPass {
    let rays = GodRays { from_behind, samples, ..GodRays::default() };
    GodRayPass { rays, compositing: Compositing { alpha_of_red: from_behind, alpha_twice: false } }
}

/// What the pass adds to a black frame.
fn added(pass: GodRayPass, frame: &Image, view: &View<'_>) -> Image {
    let mut frame = frame.clone();
    pass.run(&mut frame, view).expect("a picture");
    frame
}

fn clear(size: [u32; 2]) -> Image {
    let mut frame = Image::new(size[0] as usize, size[1] as usize);
    frame.transmittance = Some(vec![[1.0; 3]; frame.pixels.len()]);
    frame
}

/// The brightest pixel's centre in device coordinates, and its value.
fn brightest(image: &Image) -> (DVec2, f32) {
    let value = |index: &usize| image.pixels[*index][0];
    let at = (0..image.pixels.len()).max_by(|a, b| value(a).total_cmp(&value(b))).expect("there are pixels");
    let [x, y] = [at % image.width, at / image.width].map(|place| place as f64 + 0.5);
    (DVec2::new(2.0 * x / image.width as f64 - 1.0, 1.0 - 2.0 * y / image.height as f64), value(&at))
}

#[test]
fn a_sun_behind_the_camera_shines_from_the_mirrored_point_with_the_defect_alone() {
    let size = [64, 36];
    let camera = camera(size, 50.0, Projection::Perspective);
    let sun = |towards: [f64; 3]| {
        [Sun { direction: DVec3::from(towards).normalize().to_array(), irradiance: [2.0, 1.0, 0.5] }]
    };
    let mirrored = DVec2::new(-0.15 / 0.36, -0.05 / (0.36 * 36.0 / 64.0));
    // Before the camera at these device coordinates, and right behind that place.
    for (towards, is_behind) in [([-0.15, 1.0, -0.05], false), ([0.15, -1.0, 0.05], true)] {
        for from_behind in [false, true] {
            let image = added(pass(from_behind, 100), &clear(size), &view(&camera, &sun(towards)));
            let (place, value) = brightest(&image);
            if is_behind && !from_behind {
                assert!(image.pixels.iter().all(|pixel| *pixel == [0.0; 4]), "corrected, nothing shines from behind");
                continue;
            }
            // A texel of the half is a ninth of the picture's height here, and rays are brightest in the sun's or beside it.
            assert!(value > 0.5 && (place - mirrored).abs().max_element() < 0.12, "{towards:?}: {value} at {place}");
        }
    }
    // One picture: the mirrored sun and the sun at the mirrored place.
    let [before, behind] = [[-0.15, 1.0, -0.05], [0.15, -1.0, 0.05]]
        .map(|towards| added(pass(true, 100), &clear(size), &view(&camera, &sun(towards))));
    let differences = before.pixels.as_flattened().iter().zip(behind.pixels.as_flattened()).map(|(a, b)| (a - b).abs());
    assert!(differences.fold(0.0, f32::max) < 1e-6);
    // In the image plane there is no point on the screen; beside it the point lies outside.
    for towards in [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1e-9, 0.5], [1.0, -1e-300, 0.5]] {
        let image = added(pass(true, 100), &clear(size), &view(&camera, &sun(towards)));
        assert!(image.pixels.iter().all(|pixel| pixel.iter().all(|value| *value == 0.0)), "{towards:?}");
    }
}

#[test]
fn god_rays_need_a_plane_and_their_channel() {
    let mut scene = support::scene("linear-ramp");
    scene.camera.projection = Projection::Equirectangular;
    scene.camera.panorama = Some(cloudparity::scene::Panorama {
        longitude_min: -1.0,
        longitude_max: 1.0,
        latitude_min: -0.5,
        latitude_max: 0.5,
    });
    let panorama = Camera::new(&scene, [8, 4]).expect("a camera");
    let sun = [Sun { direction: [0.0, 1.0, 0.0], irradiance: [1.0; 3] }];
    let error = pass(true, 10).run(&mut clear([8, 4]), &view(&panorama, &sun)).expect_err("refused").to_string();
    assert!(error.contains("panorama"), "{error}");
    // Without light there is nothing to draw.
    let dark = [Sun { direction: [0.0, 1.0, 0.0], irradiance: [0.0; 3] }];
    pass(true, 10).run(&mut clear([8, 4]), &view(&panorama, &dark)).expect("nothing to do");
    let flat = camera([8, 4], 50.0, Projection::Perspective);
    let error = pass(true, 10).run(&mut Image::new(8, 4), &view(&flat, &sun)).expect_err("refused").to_string();
    assert!(error.contains("without transmittance"), "{error}");
    // What is not listed needs nothing.
    assert_eq!(Channels::of::<Arc<dyn Pass>>(&[]), Channels { transmittance: false });
    let passes: [Arc<dyn Pass>; 1] = [Arc::new(pass(true, 10))];
    assert_eq!(Channels::of(&passes), Channels { transmittance: true });
}

/// Sum of the sides of the picture in the plane at distance 1, at most: 36 mm over 50 mm along the longer one.
const EXTENT: f64 = 1.44;

/// How far f32 may be off in what god rays add to a pixel, for a transmittance from 0 to 1 and a colour of at most `colour`.
///
/// `extent` is the sum of the picture's sides in the plane at distance 1. A direction through a texel is the sum of three vectors that are
/// rounded once each, times raster coordinates with 7 roundings, so off by 13 u extent + 4 u, and its length by 16 u. Distances to the
/// glow's middle, at most its radius, add 2 u and 12 u of it. The glow's steepest slope is 1.5 over its radius.
fn bound(rays: &GodRays, size: [u32; 2], extent: f64, colour: f64) -> f64 {
    let [width, height] = half(size.map(|side| side as usize));
    let direction = 3.0_f64.sqrt() * (13.0 * extent + 20.0) * U;
    let glow = 1.5 * (direction + 2.0 * U + 12.0 * U * SUN_GLOW) / SUN_GLOW + 20.0 * U;
    // Nine texels, each with the mean of three channels and two shares, summed.
    let occlusion = glow + 24.0 * U;
    let blurred = blur_error(rays, [width, height], occlusion);
    // Added: rays differ by at most their largest value from texel to texel, and the place is rounded three times.
    let weights: f64 = (0..rays.samples as i32).map(|number| rays.weight * rays.decay.powi(number)).sum();
    let largest = rays.density * rays.exposure * weights;
    colour * (blurred + 3.0 * U * (width + height) as f64 * largest + 12.0 * U * largest)
}

#[test]
fn god_rays_are_the_same_on_the_adapter() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("the adapter that was just there");
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let mut shone = 0;
    for from_behind in [false, true] {
        for samples in [1, 37, 100] {
            let mut pass = pass(from_behind, samples);
            if samples == 37 {
                // As the book has them.
                (pass.rays.reach, pass.rays.centre) = (0.8, 0.5);
            }
            let kernel = GodRayKernel::new(&gpu, pass).expect("a kernel");
            for size in SIZES {
                let camera = camera(size, 50.0, Projection::Perspective);
                let mut frame = clear(size);
                for pixel in frame.transmittance.as_mut().expect("it is there") {
                    let kind = random.random_range(0..4);
                    *pixel = std::array::from_fn(|_| if kind == 0 { 0.0 } else { random.random() });
                }
                for pixel in &mut frame.pixels {
                    *pixel = std::array::from_fn(|_| random.random());
                }
                let middle = camera.ray(DVec2::new(0.5, f64::from(size[1]) - 0.5)).direction;
                let mut directions = vec![
                    // On a pixel, on the edge of the picture, behind the camera, in the image plane and next to it.
                    middle,
                    camera.ray(DVec2::new(f64::from(size[0]), 0.0)).direction,
                    -middle,
                    DVec3::X,
                    DVec3::new(1.0, 1e-12, 0.3),
                    DVec3::new(1.0, -1e-12, 0.3),
                ];
                directions.push(DVec3::new(random.random_range(-0.3..0.3), 1.0, random.random_range(-0.2..0.2)));
                for towards in directions {
                    let suns = [Sun { direction: towards.normalize().to_array(), irradiance: [2.0, 1.0, 0.5] }];
                    let view = view(&camera, &suns);
                    let on_adapter = Frame::upload(&gpu, &frame).expect("a frame");
                    kernel.run(&on_adapter, &view).expect("submitted");
                    let found = on_adapter.read_back(&gpu).expect("a picture");
                    let expected = added(pass, &frame, &view);
                    let limit = bound(&pass.rays, size, EXTENT, view.exposure);
                    for (index, (ours, theirs)) in found.pixels.iter().zip(&expected.pixels).enumerate() {
                        shone += usize::from(theirs[0] > frame.pixels[index][0] + 0.1);
                        for (ours, theirs) in ours.iter().zip(theirs) {
                            let error = f64::from((ours - theirs).abs());
                            // Both are rounded when they are added.
                            let limit = limit + 2.0 * U * f64::from(theirs.abs());
                            assert!(error <= limit, "{size:?}, {samples}, {towards}: {error:e} of {limit:e}");
                        }
                    }
                    assert_eq!(found.transmittance, frame.transmittance);
                }
            }
        }
    }
    assert!(shone > 1000, "hardly anything shines: {shone}");
}

#[test]
fn limits_find_one_read_and_one_texel() {
    let size = [33, 17];
    let camera = camera(size, 50.0, Projection::Perspective);
    let suns = [Sun { direction: DVec3::new(0.02, 1.0, 0.01).normalize().to_array(), irradiance: [1.0; 3] }];
    let view = view(&camera, &suns);
    let whole = pass(false, 100);
    let limit = bound(&whole.rays, size, EXTENT, view.exposure);
    assert!(limit < 2e-3, "{limit:e}");
    let expected = added(whole, &clear(size), &view);
    let largest = |found: &Image| {
        let pairs = found.pixels.as_flattened().iter().zip(expected.pixels.as_flattened());
        pairs.map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max)
    };
    let one_read_less = added(pass(false, 99), &clear(size), &view);
    assert!(largest(&one_read_less) > limit, "{:e} of {limit:e}", largest(&one_read_less));
    let mut darker = clear(size);
    darker.transmittance.as_mut().expect("it is there")[8 * 33 + 17] = [0.95; 3];
    let darker = added(whole, &darker, &view);
    assert!(largest(&darker) > limit, "{:e} of {limit:e}", largest(&darker));
}

#[test]
fn what_is_no_number_stays_to_be_seen() {
    let size = [24, 13];
    let camera = camera(size, 50.0, Projection::Perspective);
    let suns = [Sun { direction: DVec3::new(0.05, 1.0, 0.02).normalize().to_array(), irradiance: [1.0; 3] }];
    let view = view(&camera, &suns);
    let mut frame = clear(size);
    frame.transmittance.as_mut().expect("it is there")[5 * 24 + 9] = [f32::NAN; 3];
    frame.pixels[3] = [f32::NAN; 4];
    let is_broken = |image: &Image| -> Vec<bool> { image.pixels.iter().map(|pixel| pixel[0].is_nan()).collect() };
    let expected = is_broken(&added(pass(true, 100), &frame, &view));
    assert!(expected[5 * 24 + 9] && expected[3]);
    // Rays that come past it, and no others.
    assert!(expected.iter().any(|broken| !broken));
    if support::require("vulkan") {
        let gpu = Gpu::open().expect("the adapter that was just there");
        let compiled = gpu.block_on(pass(true, 100).compile(&gpu)).expect("it waits").expect("a kernel");
        let on_adapter = Frame::upload(&gpu, &frame).expect("a frame");
        compiled.run(&on_adapter, &view).expect("submitted");
        assert_eq!(is_broken(&on_adapter.read_back(&gpu).expect("a picture")), expected);
    }
}

#[test]
fn height_fog_is_the_same_on_the_adapter_and_closes_forms() {
    let fog = HeightFog {
        density: 1e-4,
        distance: 20_000.0,
        falloff: 4.0,
        colour: [0.6, 0.7, 0.9],
        sun_gain: 0.5,
        without_parentheses: false,
    };
    // Level everything that a depth of 2 hides; the zenith e^-4 of it, or nearly all without the parentheses.
    let whole = 1.0 - (-2.0_f64).exp();
    assert!((fog.amount(DVec3::X) - whole).abs() < 1e-15 && (fog.amount(DVec3::NEG_Z) - whole).abs() < 1e-15);
    assert!((fog.amount(DVec3::Z) - whole * (-4.0_f64).exp()).abs() < 1e-15);
    let wrong = HeightFog { without_parentheses: true, ..fog };
    assert!((wrong.amount(DVec3::Z) - (1.0 - (-6.0_f64).exp())).abs() < 1e-15);
    // The specification's example: d k = 0.5 and y h = 0.6.
    let example = HeightFog { distance: 5000.0, falloff: 0.6, ..wrong };
    assert!((example.amount(DVec3::Z) - 0.67).abs() < 0.005);
    assert!((HeightFog { without_parentheses: false, ..example }.amount(DVec3::Z) - 0.22).abs() < 0.005);
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("the adapter that was just there");
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let sun = [Sun { direction: [0.1, 1.0, 0.05], irradiance: [4.0, 3.0, 2.0] }];
    for (number, fog) in [fog, wrong].into_iter().enumerate() {
        let kernel = gpu.block_on(fog.compile(&gpu)).expect("no wait is interrupted").expect("a kernel");
        for size in SIZES {
            for suns in [&sun[..], &[]] {
                let camera = camera(size, 90.0, Projection::Perspective);
                let view = view(&camera, suns);
                let mut frame = clear(size);
                if number == 1 {
                    frame.transmittance = None;
                }
                for pixel in &mut frame.pixels {
                    *pixel = std::array::from_fn(|_| random.random());
                }
                let on_adapter = Frame::upload(&gpu, &frame).expect("a frame");
                kernel.run(&on_adapter, &view).expect("submitted");
                let found = on_adapter.read_back(&gpu).expect("a picture");
                fog.run(&mut frame, &view).expect("a picture");
                // A direction is off by 13 roundings of its corner, as for god rays; the exponent is 4 times it, the eighth power 8 times, and
                // what is mixed is at most 4 times the exposure.
                let largest = 4.0 * view.exposure.max(1.0);
                let bound = largest * (4.0 + 8.0) * (13.0 * EXTENT + 20.0) * U;
                for (ours, theirs) in found.pixels.as_flattened().iter().zip(frame.pixels.as_flattened()) {
                    let error = f64::from((ours - theirs).abs());
                    assert!(error <= bound, "{size:?}: {ours}, not {theirs}: {error:e} of {bound:e}");
                }
                let [ours, theirs] = [&found, &frame].map(|image| image.transmittance.clone().unwrap_or_default());
                for (ours, theirs) in ours.as_flattened().iter().zip(theirs.as_flattened()) {
                    assert!(f64::from((ours - theirs).abs()) <= bound, "{size:?}: {ours}, not {theirs} shines through");
                }
                assert_eq!(ours.is_empty(), number == 1);
            }
        }
    }
}
