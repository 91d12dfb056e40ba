//! Published engines in scenes: both backends, god rays, the box, the commands.

mod support;

use assert_cmd::cargo::cargo_bin_cmd;
use cloudparity::base::texture::TextureHandle;
use cloudparity::engines;
use cloudparity::engines::Engine;
use cloudparity::engines::defects::Defects;
use cloudparity::engines::light::MOST_SUNS;
use cloudparity::engines::light::models;
use cloudparity::engines::light::models::{LIGHTS, OWN};
use cloudparity::engines::render::{EngineJitter, EngineRenderer, EngineSettings, RayMaker, render};
use cloudparity::gpu::{Backend, Gpu};
use cloudparity::graph::wgsl::Linker;
use cloudparity::integrators::MarchSettings;
use cloudparity::nodes::texture_lookup;
use cloudparity::scene::image::Image;
use cloudparity::scene::{LightKind, PixelFilter, Projection, Scene};
use glam::DVec3;

const SETTINGS: EngineSettings =
    EngineSettings { jitter: EngineJitter::BlueNoise, frame: 3, sub_pixels: 1, god_rays: false };

fn engine(defects: &Defects, changes: &[&str]) -> Engine {
    engine_of("perlin-fbm", &[&["texture_size=32", "octaves=3"], changes].concat(), defects, 2.0)
}

/// An engine of the ramp, from its lowest quality on.
fn engine_of(model: &str, changes: &[&str], defects: &Defects, seconds: f64) -> Engine {
    let model = engines::find(model).expect("it is there");
    let changes: Vec<String> = changes.iter().map(|&text| text.into()).collect();
    let values = model.values(Some("low"), &changes).expect("in range");
    model.engine(&support::scene("linear-ramp"), &values, defects, seconds).expect("in range")
}

fn scene() -> Scene {
    let mut scene = support::scene("linear-ramp");
    scene.film.resolution = [32, 18];
    scene
}

fn picture(scene: &Scene, engine: &Engine, settings: &EngineSettings, backend: Backend) -> Image {
    render(scene, engine, settings, backend, &|_, _| ()).expect("a picture")
}

/// Turns the sun: it then shines from the direction `towards`.
fn with_sun_from(mut scene: Scene, towards: DVec3) -> Scene {
    for (row, part) in towards.normalize().to_array().into_iter().enumerate() {
        scene.lights[0].matrix_world[row][2] = part as f32;
    }
    scene
}

fn camera_place(scene: &Scene) -> DVec3 {
    DVec3::from([0, 1, 2].map(|row| f64::from(scene.camera.matrix_world[row][3])))
}

/// The textures that a density reads.
fn textures(engine: &Engine) -> Vec<TextureHandle> {
    Linker::new(engine.density.program()).expect("it links").textures().to_vec()
}

#[test]
fn what_a_density_reads_is_made_once() {
    let of_graph = |changes: &[&str]| engine_of("graph", changes, &Defects::NONE, 0.0);
    for [first, again, other] in [
        [engine(&Defects::NONE, &[]), engine(&Defects::NONE, &["opacity=2"]), engine(&Defects::NONE, &["octaves=2"])],
        [of_graph(&["cache_cells=8"]), of_graph(&["cache_cells=8", "light_steps=2"]), of_graph(&["cache_cells=9"])],
    ] {
        let [first, again, other] = [first, again, other].map(|engine| textures(&engine));
        assert!(!first.is_empty() && first.len() == again.len());
        assert!(first.iter().zip(&again).all(|(one, two)| std::ptr::eq(one.texels(), two.texels())));
        assert_ne!(first, other, "they would read another");
    }
}

#[test]
fn both_backends_show_one_picture() {
    if !support::require("vulkan") {
        return;
    }
    for defects in [Defects::NONE, Defects::ALL] {
        let engine = engine(&defects, &["light_steps=3"]);
        let [cpu, gpu] = [Backend::Cpu, Backend::Gpu].map(|backend| picture(&scene(), &engine, &SETTINGS, backend));
        let largest = cpu.pixels.as_flattened().iter().zip(gpu.pixels.as_flattened()).map(|(a, b)| (a - b).abs());
        let largest = largest.fold(0.0, f32::max);
        // The tolerance of the reference data for software filtering, times the sun's strength of 6 in this scene.
        assert!(largest < 6e-4, "{defects}: {largest}");
        assert!(cpu.pixels.iter().any(|pixel| pixel[0] > 0.1), "{defects}: a cloud is seen");
    }
}

#[test]
fn rays_of_the_adapter_are_those_of_the_processor() {
    if !support::require("vulkan") {
        return;
    }
    let (gpu, engine) = (Gpu::open().expect("an adapter"), engine(&Defects::NONE, &[]));
    // Large enough for several workgroups, and no square.
    let mut perspective = scene();
    perspective.film.resolution = [75, 41];
    let mut parallel = perspective.clone();
    parallel.camera.projection = Projection::Orthographic;
    parallel.camera.ortho_scale = 3.0;
    // With all that a frame holds, and a pass over it.
    let mut transparent = perspective.clone();
    transparent.film.transparent = true;
    for (scene, god_rays) in [(&perspective, false), (&parallel, false), (&transparent, true)] {
        let pictures = |jitter: EngineJitter| {
            let settings = EngineSettings { jitter, god_rays, ..SETTINGS };
            [RayMaker::Processor, RayMaker::Adapter].map(|maker| {
                let renderer = EngineRenderer::on_adapter(scene, &engine, &gpu, maker).expect("a renderer");
                let picture = renderer.picture(&settings, &|_, _| ()).expect("a picture");
                assert_eq!(picture.transmittance.is_some(), scene.film.transparent);
                let through = picture.transmittance.unwrap_or_default();
                [picture.pixels.as_flattened(), through.as_flattened()].concat()
            })
        };
        let [ours, theirs] = pictures(EngineJitter::None);
        let largest = ours.iter().zip(&theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        // A place moves by 2^-22 of the distance to the camera, some 1e-6 of the box; half a pixel would move it by 1e-2.
        assert!(ours.len() == theirs.len() && largest < 6e-4, "{largest}");
        let [width, height] = scene.film.resolution.map(|side| side as usize);
        assert!(ours[..4 * width * height].chunks(4).any(|pixel| pixel[0] > 0.1), "a cloud is seen");
        // Rays with jitter are the processor's, whoever is asked.
        let [ours, theirs] = pictures(EngineJitter::BlueNoise);
        assert_eq!(ours, theirs);
    }
}

#[test]
fn software_has_the_rays_of_a_far_camera_from_the_processor() {
    if !support::require("vulkan") {
        return;
    }
    let (gpu, engine) = (Gpu::open().expect("an adapter"), engine(&Defects::NONE, &[]));
    let settings = EngineSettings { jitter: EngineJitter::None, ..SETTINGS };
    for factor in [1.0, 100.0] {
        let mut scene = scene();
        scene.camera.focal_length *= factor;
        scene.camera.clip_end *= factor;
        (0..3).for_each(|row| scene.camera.matrix_world[row][3] *= factor);
        let picture = |maker: Option<RayMaker>| {
            let renderer = match maker {
                Some(maker) => EngineRenderer::on_adapter(&scene, &engine, &gpu, maker),
                None => EngineRenderer::new(&scene, &engine, Some(&gpu)),
            };
            renderer.expect("a renderer").picture(&settings, &|_, _| ()).expect("a picture").pixels
        };
        let is_far = factor > 1.0 && gpu.adapter().is_software();
        let [by_choice, expected, other] = [None, Some(is_far), Some(!is_far)].map(|by_processor| {
            picture(by_processor.map(|is_so| if is_so { RayMaker::Processor } else { RayMaker::Adapter }))
        });
        assert_eq!(by_choice, expected, "{factor}");
        assert_ne!(by_choice, other, "{factor}: it makes a difference");
        assert!(by_choice.iter().any(|pixel| pixel[0] > 0.1), "{factor}: a cloud is seen");
    }
}

#[test]
fn a_renderer_makes_any_picture_after_any_other() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("an adapter");
    let plain = EngineSettings { jitter: EngineJitter::None, ..SETTINGS };
    let all = [
        plain.clone(),
        EngineSettings { god_rays: true, ..plain.clone() },
        plain.clone(),
        SETTINGS,
        EngineSettings { sub_pixels: 2, ..plain.clone() },
        EngineSettings { god_rays: true, ..SETTINGS },
        plain,
    ];
    // One has a picture behind the cloud, which is read along the rays.
    for name in ["linear-ramp", "environment-image"] {
        let mut scene = support::scene(name);
        scene.film.resolution = [32, 18];
        scene.lights = support::scene("linear-ramp").lights;
        // Before the camera, so that god rays are seen.
        let scene = with_sun_from(scene.clone(), -camera_place(&scene));
        let engine = engine(&Defects::NONE, &["opacity=0.2"]);
        for gpu in [Some(&gpu), None] {
            let renderer = || EngineRenderer::new(&scene, &engine, gpu).expect("a renderer");
            let one = renderer();
            let mut pictures = Vec::new();
            for settings in &all {
                let [again, new] = [&one, &renderer()]
                    .map(|renderer| renderer.picture(settings, &|_, _| ()).expect("a picture").pixels);
                assert_eq!(again, new, "{name}: {settings:?}");
                pictures.push(again);
            }
            assert_eq!(pictures[0], pictures[2]);
            for other in [1, 3, 4, 5] {
                assert_ne!(pictures[0], pictures[other], "{name}: {:?}", all[other]);
            }
        }
    }
}

#[test]
fn jitter_moves_with_the_frame() {
    let engine = engine(&Defects::NONE, &[]);
    let one = picture(&scene(), &engine, &SETTINGS, Backend::Cpu);
    let other = picture(&scene(), &engine, &EngineSettings { frame: 4, ..SETTINGS }, Backend::Cpu);
    assert_ne!(one.pixels, other.pixels);
    assert_eq!(one.pixels, picture(&scene(), &engine, &SETTINGS, Backend::Cpu).pixels);
}

#[test]
fn the_rays_of_a_pixel_have_a_jitter_each() {
    let mut fine = scene();
    fine.film.pixel_filter = PixelFilter::Box;
    let mut coarse = fine.clone();
    coarse.film.resolution = [16, 9];
    let engine = engine(&Defects::NONE, &[]);
    for jitter in [EngineJitter::Table, EngineJitter::BlueNoise] {
        let settings = EngineSettings { jitter, ..SETTINGS };
        let fine = picture(&fine, &engine, &settings, Backend::Cpu);
        let coarse = picture(&coarse, &engine, &EngineSettings { sub_pixels: 2, ..settings }, Backend::Cpu);
        // Four rays of a pixel are the rays of four pixels of twice the resolution: fragments of one grid.
        for (index, pixel) in coarse.pixels.iter().enumerate() {
            let (column, row) = (index % 16, index / 16);
            for channel in 0..4 {
                let of = |x: usize, y: usize| fine.pixels[(2 * row + y) * 32 + 2 * column + x][channel];
                let mean = (of(0, 0) + of(1, 0) + of(0, 1) + of(1, 1)) / 4.0;
                // Rays through one raster position of two resolutions differ by roundings in f64, pictures by those of f32.
                assert!((pixel[channel] - mean).abs() <= 1e-6 * mean.max(1.0), "{jitter:?}: {} {mean}", pixel[channel]);
            }
        }
    }
    let fragments: Vec<f64> = (0..4).map(|part| EngineJitter::Table.value([6 + part % 2, 4 + part / 2], 0)).collect();
    assert!((0..4).all(|a| (0..a).all(|b| fragments[a] != fragments[b])), "{fragments:?}");
}

#[test]
fn a_transparent_picture_keeps_what_each_channel_lets_through() {
    let mut opaque = scene();
    opaque.world.color = [0.2, 0.3, 0.5];
    let mut transparent = opaque.clone();
    transparent.film.transparent = true;
    let settings = EngineSettings { god_rays: true, ..SETTINGS };
    let corrected = engine(&Defects::NONE, &["opacity=1.5"]);
    let [over, alone] = [&opaque, &transparent].map(|scene| picture(scene, &corrected, &settings, Backend::Cpu));
    assert_eq!(over.transmittance, None, "what a pass needed is not kept");
    let transmittance = alone.transmittance.as_ref().expect("the channels");
    let mut coloured = 0;
    for ((over, alone), through) in over.pixels.iter().zip(&alone.pixels).zip(transmittance) {
        for channel in 0..3 {
            let behind = opaque.world.color[channel] * opaque.world.strength;
            let composed = alone[channel] + through[channel] * behind;
            // Each of the three is rounded to f32 once.
            let bound = 3.0 * f32::EPSILON * over[channel].max(1.0);
            assert!((over[channel] - composed).abs() <= bound, "{} {composed}", over[channel]);
        }
        assert!((1.0 - alone[3] - through.iter().sum::<f32>() / 3.0).abs() <= 2.0 * f32::EPSILON);
        coloured += usize::from(through[0] > through[2] + 0.01);
    }
    assert!(coloured > 20, "blue is dimmed most, which one alpha cannot say: {coloured}");
    // As published there is one alpha, red's.
    let published = engine(&Defects::ALL, &["opacity=1.5"]);
    assert_eq!(picture(&transparent, &published, &settings, Backend::Cpu).transmittance, None);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("alone.exr");
    alone.write_exr(&path, false).expect("it is written");
    assert_eq!(Image::read_exr(&path).expect("it is read").transmittance, alone.transmittance);
}

#[test]
fn god_rays_shine_from_a_sun_that_is_seen() {
    let before = with_sun_from(scene(), -camera_place(&scene()));
    let behind = with_sun_from(scene(), camera_place(&scene()));
    let added = |scene: &Scene, defects: &Defects| {
        // Thin enough that the sun is not hidden.
        let engine = engine(defects, &["opacity=0.2"]);
        let without = picture(scene, &engine, &SETTINGS, Backend::Cpu);
        let with = picture(scene, &engine, &EngineSettings { god_rays: true, ..SETTINGS }, Backend::Cpu);
        let difference = |column: usize, row: usize| {
            let at = row * with.width + column;
            with.pixels[at][0] - without.pixels[at][0]
        };
        [difference(16, 9), difference(1, 1)]
    };
    let [centre, corner] = added(&before, &Defects::NONE);
    assert!(centre > 0.1 && corner < 0.5 * centre, "{centre} {corner}");
    assert_eq!(added(&behind, &Defects::NONE), [0.0; 2]);
    // As published the sun behind the camera stands at the mirrored point, which is the centre again.
    let [centre, corner] = added(&behind, &Defects::ALL);
    assert!(centre > 0.1 && corner < 0.5 * centre, "{centre} {corner}");
}

#[test]
fn what_an_engine_does_not_know_is_refused() {
    let fixed = engine(&Defects::NONE, &[]);
    let refusal = |scene: &Scene, backend: Backend| {
        render(scene, &fixed, &SETTINGS, backend, &|_, _| ()).expect_err("it is refused").to_string()
    };
    let mut lamp = scene();
    lamp.lights[0].kind = LightKind::Point { radius: 0.0, soft_falloff: false };
    assert!(refusal(&lamp, Backend::Cpu).contains("no sun"), "{}", refusal(&lamp, Backend::Cpu));
    let mut flat = scene();
    flat.volume.bounds.max[2] = flat.volume.bounds.min[2];
    let model = engines::find("perlin-fbm").expect("it is there");
    let error = model.engine(&flat, &fixed.values, &Defects::NONE, 0.0).err().expect("refused").to_string();
    assert!(error.contains("a box with a volume"), "{error}");
    let mut many = scene();
    many.lights.resize(MOST_SUNS + 1, many.lights[0].clone());
    if support::require("vulkan") {
        assert!(refusal(&many, Backend::Gpu).contains("at most 8"), "{}", refusal(&many, Backend::Gpu));
    }
    let exact = engine(&Defects::NONE, &["exact=1"]);
    if support::require("vulkan") {
        let error = render(&scene(), &exact, &SETTINGS, Backend::Gpu, &|_, _| ()).expect_err("on the CPU only");
        assert!(error.to_string().contains("noise at each place"), "{error}");
    }
}

#[test]
fn the_commands_name_parameters_and_refuse_others() {
    let output = cargo_bin_cmd!("cloudparity").args(["models", "perlin-fbm", "--json"]).output().expect("it runs");
    let listed: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let parameters = listed[0]["parameters"].as_array().expect("parameters");
    assert_eq!(parameters.len(), engines::find("perlin-fbm").expect("it is there").parameters.len());
    let folder = tempfile::tempdir().expect("a folder");
    let run = |arguments: &[&str]| {
        cargo_bin_cmd!("cloudparity")
            .args(["render".as_ref(), support::project("parity/scenes/linear-ramp.scene.json").as_os_str()])
            .args(["--resolution", "8x8", "-o"])
            .arg(folder.path().join("out.exr"))
            .args(arguments)
            .output()
            .expect("it runs")
    };
    let published = ["--model", "perlin-fbm", "-p", "texture_size=32"];
    assert!(run(&[&published[..], &["--god-rays"]].concat()).status.success());
    let warned = run(&[&published[..], &["-p", "flatten_top=0"]].concat());
    assert!(warned.status.success() && String::from_utf8_lossy(&warned.stderr).contains("flatten_top is 0"));
    for (arguments, expected) in [
        (&["--model", "perlin-fbm", "-p", "coverage=2"][..], "0 to 1"),
        (&["--model", "perlin-fbm", "-p", "cover=0.5"], "one of texture_size"),
        (&["--model", "perlin-fbm", "-p", "coverage=much"], "NAME=VALUE"),
        (&["--model", "perlin-fbm", "--quality", "best"], "one of low, medium, high"),
        (&["--model", "fog"], "one of graph, perlin-fbm"),
        (&["--seconds", "inf"], "a finite number"),
    ] {
        let refused = run(arguments);
        let message = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(refused.status.code() == Some(2) && message.contains(expected), "{arguments:?}: {message}");
    }
}

#[test]
fn light_models_are_the_same_on_both_backends() {
    if !support::require("vulkan") {
        return;
    }
    // The sun behind the cloud, where a silver lining shows.
    let behind = -camera_place(&scene());
    let mut scene = with_sun_from(scene(), behind);
    scene.world.color = [0.2, 0.3, 0.5];
    let mut pictures: Vec<Image> = Vec::new();
    // This system's own light is single scattering.
    for named in LIGHTS.iter().filter(|named| named.id != OWN) {
        let mut engine = engine(&Defects::NONE, &["light_steps=3"]);
        named.apply(&mut engine.light).expect("in range");
        let [cpu, gpu] = [Backend::Cpu, Backend::Gpu].map(|backend| picture(&scene, &engine, &SETTINGS, backend));
        let largest = cpu.pixels.as_flattened().iter().zip(gpu.pixels.as_flattened()).map(|(a, b)| (a - b).abs());
        let largest = largest.fold(0.0, f32::max);
        // As above: the tolerance of the reference data for software filtering, times the sun's strength of 6.
        assert!(largest < 6e-4, "{}: {largest}", named.id);
        assert!(pictures.iter().all(|other| other.pixels != cpu.pixels), "{} is a light of its own", named.id);
        pictures.push(cpu);
    }
}

#[test]
fn surroundings_and_compressed_depths_are_the_same_on_both_backends() {
    let mut scene = with_sun_from(scene(), DVec3::new(0.3, -0.5, 0.8));
    scene.world.color = [0.2, 0.3, 0.5];
    let plain = picture(&scene, &engine(&Defects::NONE, &["light_steps=3"]), &SETTINGS, Backend::Cpu);
    let has_adapter = support::require("vulkan");
    for settings in [
        &[("body_strength", 0.8), ("body_length", 0.02)][..],
        &[("coarse_shadow", 1.0)],
        &[("depth_compression", 2.0), ("octaves", 4.0)],
        &[
            ("body_strength", 0.5),
            ("coarse_shadow", 1.0),
            ("octaves", 4.0),
            ("powder_strength", 0.7),
            ("powder_ambient", 0.0),
        ],
    ] {
        let mut engine = engine(&Defects::NONE, &["light_steps=3"]);
        for &(name, value) in settings {
            models::set(&mut engine.light, name, value, "test").expect("in range");
        }
        let cpu = picture(&scene, &engine, &SETTINGS, Backend::Cpu);
        assert_ne!(cpu.pixels, plain.pixels, "{settings:?} changes the picture");
        if !has_adapter {
            continue;
        }
        let gpu = picture(&scene, &engine, &SETTINGS, Backend::Gpu);
        let largest = cpu.pixels.as_flattened().iter().zip(gpu.pixels.as_flattened()).map(|(a, b)| (a - b).abs());
        let largest = largest.fold(0.0, f32::max);
        // As for light models above.
        assert!(largest < 6e-4, "{settings:?}: {largest}");
    }
}

#[test]
fn the_command_takes_light_models() {
    let folder = tempfile::tempdir().expect("a folder");
    let render = |arguments: &[&str]| {
        let mut command = cargo_bin_cmd!("cloudparity");
        command.arg("render").arg(support::project("parity/scenes/linear-ramp.scene.json"));
        command.args(["--model", "perlin-fbm"]);
        command.args(["--resolution", "16x9", "-p", "texture_size=32", "-o"]).arg(folder.path().join("light.exr"));
        command.args(arguments).assert()
    };
    render(&["--light", "octaves", "--light-parameter", "contribution=0.7"]).success();
    let refused = |arguments: &[&str]| {
        let output = render(arguments).code(2).get_output().stderr.clone();
        String::from_utf8(output).expect("text")
    };
    assert!(refused(&["--light", "moon"]).contains("octaves-deep"));
    assert!(refused(&["--light-parameter", "octaves=99"]).contains("1 to 16"));
    assert!(refused(&["--light-parameter", "octaves"]).contains("NAME=VALUE"));
    let listed = cargo_bin_cmd!("cloudparity").arg("lights").assert().success().get_output().stdout.clone();
    assert!(String::from_utf8(listed).expect("text").contains("powder_length"));
}

#[test]
fn the_graphs_own_engine_shows_single_scattering_of_its_material() {
    let mut scene = scene();
    scene.world.color = [0.0; 3];
    scene.set_volume_bounces(0);
    let truth = cloudparity::integrators::render(&scene, &MarchSettings::default(), Backend::Cpu, &|_, _| ());
    let truth = truth.expect("a picture");
    let model = engines::find("graph").expect("it is there");
    let engine = |changes: &[&str]| {
        let changes: Vec<String> = changes.iter().map(|&text| text.into()).collect();
        let values = model.values(None, &changes).expect("in range");
        model.engine(&scene, &values, &Defects::NONE, 0.0).expect("an engine")
    };
    let shown = |changes: &[&str]| {
        picture(&scene, &engine(changes), &EngineSettings { sub_pixels: 4, ..SETTINGS }, Backend::Cpu)
    };
    let reads_texture = |changes: &[&str]| {
        let engine = engine(changes);
        let nodes = &engine.density.program().instructions;
        nodes.iter().any(|node| node.node_type.type_name == texture_lookup::TYPE.type_name)
    };
    let mean = |image: &Image| {
        let sum: f64 = image.pixels.iter().flat_map(|pixel| &pixel[..3]).map(|&value| f64::from(value)).sum();
        sum / (3 * image.pixels.len()) as f64
    };
    let fine = shown(&["march_steps=256", "light_steps=64"]);
    // A ray that ends at a transmittance of 0.01 leaves less than 1 % of its light; steps leave far less.
    assert!((mean(&fine) / mean(&truth) - 1.0).abs() < 0.01, "{} and {}", mean(&fine), mean(&truth));
    // Trilinear filtering is exact for a linear density; what is left is its rounding in f32, and in 8 bits half a step of 255.
    for (format, tolerance) in [("cache_format=0", 1e-4), ("cache_format=2", 5e-3)] {
        let cached = shown(&["march_steps=256", "light_steps=64", "cache_cells=32", format]);
        assert!((mean(&cached) / mean(&fine) - 1.0).abs() < tolerance, "{format}: {}", mean(&cached));
        assert!(reads_texture(&["cache_cells=32", format]), "{format}: the cache is read");
    }
    assert!(!reads_texture(&[]), "without one the graph is evaluated");
    let coarse = shown(&["march_steps=2", "light_steps=1"]);
    assert!((mean(&coarse) / mean(&truth) - 1.0).abs() > 0.01, "steps are those that were asked for");
}

#[test]
fn a_material_that_emits_has_no_engine() {
    let scene = support::scene("noise-coloured");
    let model = engines::find("graph").expect("it is there");
    let values = model.values(None, &[]).expect("in range");
    let error = model.engine(&scene, &values, &Defects::NONE, 0.0).err().expect("refused").to_string();
    assert!(error.contains("emi"), "{error}");
}
