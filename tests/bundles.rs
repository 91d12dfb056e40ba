//! Shader bundles: what their files draw is what the engine draws, a changed number is a changed picture, and what a bundle has not is said.

mod support;

/// The program in wgpu that bundles of WGSL carry.
#[path = "../src/engines/bundle/wgsl/rust/src/cloud.rs"]
mod cloud;

use cloudparity::engines;
use cloudparity::engines::Engine;
use cloudparity::engines::bundle::field::FieldBundle;
use cloudparity::engines::bundle::one_shader::OneShader;
use cloudparity::engines::bundle::run_time::{Candidate, RunTime};
use cloudparity::engines::bundle::targets::Program;
use cloudparity::engines::bundle::{Bundle, languages};
use cloudparity::engines::defects::Defects;
use cloudparity::engines::domain::Domain;
use cloudparity::engines::render::{EngineJitter, EngineRenderer, EngineSettings};
use cloudparity::gpu::Gpu;
use cloudparity::graph::wgsl::Language;
use cloudparity::scene::image::Image;
use cloudparity::scene::{Projection, Scene};
use rand::{Rng as _, SeedableRng as _};
use std::path::Path;

const SETTINGS: EngineSettings =
    EngineSettings { jitter: EngineJitter::None, frame: 0, sub_pixels: 1, god_rays: false };

/// A unit in the last place of f32, relative to the value, at most.
const ULP: f64 = 1.0 / 8_388_608.0;

fn engine(scene: &Scene, model: &str, domain: Option<Domain>, changes: &[&str]) -> Engine {
    let model = engines::find(model).expect("it is there");
    let changes: Vec<String> = changes.iter().map(|&text| text.into()).collect();
    let values = model.values(None, &changes).expect("in range");
    model.engine_in(domain, scene, &values, &Defects::NONE, 0.0).expect("an engine")
}

fn small(mut scene: Scene) -> Scene {
    scene.film.resolution = [16, 9];
    scene.film.resolution_percentage = 100;
    scene
}

fn values(image: &Image) -> Vec<f64> {
    image.pixels.as_flattened().iter().map(|&value| f64::from(value)).collect()
}

fn on_cores(scene: &Scene, engine: &Engine) -> Vec<f64> {
    let renderer = EngineRenderer::new(scene, engine, None).expect("a renderer");
    values(&renderer.picture(&SETTINGS, &|_, _| ()).expect("a picture"))
}

fn adapter() -> Option<Gpu> {
    support::require("vulkan").then(|| Gpu::open().expect("the adapter that was just there"))
}

/// What a bundle in a folder draws.
fn drawn(folder: &Path, gpu: &Gpu) -> Vec<f64> {
    values(&Bundle::load(folder).expect("it reads back").picture(gpu).expect("a picture"))
}

/// Pictures that are compared value by value.
struct Compared {
    truths: Vec<f64>,
    bounds: Vec<f64>,
}

impl Compared {
    /// The largest part of its bound that a value is off by.
    fn share(&self, found: &[f64]) -> f64 {
        let triples = found.iter().zip(&self.truths).zip(&self.bounds);
        triples.map(|((found, truth), bound)| (found - truth).abs() / bound).fold(0.0, f64::max)
    }

    /// Values that are further off than their bound.
    fn beyond(&self, found: &[f64]) -> usize {
        let triples = found.iter().zip(&self.truths).zip(&self.bounds);
        triples.filter(|((found, truth), bound)| (**found - **truth).abs() > **bound).count()
    }
}

/// The CPU's picture in f64, and what a bundle's may differ by; the bound is that of the engine on the adapter
/// (tests/engine_graph.rs) with places that are known less well: a bundle's rays begin where f32 knows the camera's place, the sum of three
/// products of some size, so that a place is off by 8 roundings of the camera's distance in all. The camera is moved by that much along each axis,
/// both ways; twice the largest change of a value bounds what places do, 200 roundings of the brightest value the arithmetic.
fn bounded(what: &str, scene: &Scene, engine: &Engine) -> Compared {
    let truths = on_cores(scene, engine);
    let brightest = truths.iter().copied().fold(0.0, f64::max);
    assert!(brightest > 0.01, "{what}: nothing is seen");
    let arithmetic = 200.0 * ULP * brightest;
    let away = scene.camera.matrix_world.iter().map(|row| f64::from(row[3]).powi(2)).sum::<f64>().sqrt();
    let step = 8.0 * ULP * (away + engine.container.unit.min(1e4));
    let mut bounds = vec![arithmetic; truths.len()];
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut moved = scene.clone();
            let place = &mut moved.camera.matrix_world[axis][3];
            *place = (f64::from(*place) + sign * step) as f32;
            for ((bound, found), truth) in bounds.iter_mut().zip(on_cores(&moved, engine)).zip(&truths) {
                *bound = bound.max(arithmetic + 2.0 * (found - truth).abs());
            }
        }
    }
    Compared { truths, bounds }
}

/// What a bundle's kernels draw, and its one shader; each with a planted change.
fn check(what: &str, scene: &Scene, engine: &Engine, gpu: &Gpu) {
    let folder = tempfile::tempdir().expect("a folder");
    Bundle::new(scene, engine).expect("a bundle").write(folder.path()).expect("written");
    let compared = bounded(what, scene, engine);
    let share = compared.share(&drawn(folder.path(), gpu));
    println!("{what} on {}: {share:.2} of the bound", gpu.adapter().name);
    assert!(share <= 1.0, "{what}: {share} of the bound");

    // A hundredth more extinction is no rounding.
    let path = folder.path().join("bundle.json");
    let mut manifest: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(&path).expect("it is there")).expect("JSON");
    let fields = manifest["kernels"][1]["uniform"].as_array_mut().expect("fields");
    let field = fields.iter_mut().find(|field| field["name"] == "extinction").expect("it has one");
    for value in field["values"].as_array_mut().expect("numbers") {
        *value = (value.as_f64().expect("a number") * 1.01).into();
    }
    std::fs::write(&path, manifest.to_string()).expect("written");
    let few = compared.truths.len() / 100;
    assert!(compared.beyond(&drawn(folder.path(), gpu)) > few, "{what}: a planted change is not seen");

    let mut shader = OneShader::new(scene, engine).expect("a shader");
    let share = compared.share(&values(&shader.picture(gpu).expect("a picture")));
    println!("{what} as one shader: {share:.2} of the bound");
    assert!(share <= 1.0, "{what}: {share} of the bound");
    let extinction = shader.number("march", 0, "extinction").expect("it has one").to_vec();
    let more: Vec<f64> = extinction.iter().map(|value| value * 1.01).collect();
    shader.set_number("march", 0, "extinction", &more).expect("three numbers");
    let found = values(&shader.picture(gpu).expect("a picture"));
    assert!(compared.beyond(&found) > few, "{what}: a planted change is not seen");
    assert!(shader.set_number("march", 0, "extinction", &[1.0]).is_err() && shader.number("march", 0, "way").is_none());
}

#[test]
fn a_bundle_draws_what_the_engine_draws() {
    let Some(gpu) = adapter() else { return };
    let clouds = small(support::scene("procedural-clouds"));
    check("cloud", &clouds, &engine(&clouds, "graph", None, &["march_steps=24", "light_steps=3"]), &gpu);
    let mut parallel = clouds.clone();
    parallel.camera.projection = Projection::Orthographic;
    parallel.camera.ortho_scale = 3.0;
    check("parallel rays", &parallel, &engine(&parallel, "graph", None, &["march_steps=24", "light_steps=3"]), &gpu);
    let mut stretched = clouds.clone();
    stretched.volume.matrix_world[0][0] *= 1.7;
    stretched.volume.matrix_world[0][2] = 0.4;
    check("a box that is sheared", &stretched, &engine(&stretched, "perlin-fbm", None, &[]), &gpu);
    let mut alone = clouds.clone();
    alone.film.transparent = true;
    check("a transparent film", &alone, &engine(&alone, "perlin-fbm", None, &[]), &gpu);
}

/// The engine at values of parameters, as presets name them.
fn changed(scene: &Scene, model: &str, fixed: &[&str], values: &[(&str, f64)]) -> cloudparity::Result<(Scene, Engine)> {
    let mut scene = scene.clone();
    let mut texts: Vec<String> = fixed.iter().map(|&text| text.into()).collect();
    for (name, value) in values {
        match name.split_once('.').expect("its owner stands first") {
            ("scene", name) => scene.set(&format!("{name}={value}"))?,
            (_, name) => texts.push(format!("{name}={value}")),
        }
    }
    let model = engines::find(model)?;
    let engine = model.engine(&scene, &model.values(None, &texts)?, &Defects::NONE, 0.0)?;
    Ok((scene, engine))
}

/// A bundle whose parameters are moved draws what an engine that is put together for them draws. Its constants are off from the engine's by some
/// roundings: each parameter is moved by 64 of them (of the larger end of its range), both ways, and twice the change of a value, summed over the
/// parameters, is added to its bound.
fn check_parameters(model: &str, scene: &Scene, fixed: &[&str], wanted: &[&str], gpu: &Gpu) {
    let build = |values: &[(&str, f64)]| changed(scene, model, fixed, values);
    let (own, engine) = build(&[]).expect("an engine");
    let candidates = Candidate::all(&own, &engine).expect("candidates");
    let found =
        RunTime::find(&candidates, engine.density.bounds, &build, &|_| ()).expect("a search").expect("parameters");
    let names: Vec<&str> = found.tunables.iter().map(|one| one.field.as_str()).collect();
    println!("{model}: {names:?}");
    for name in wanted {
        assert!(names.contains(name), "{model}: {name} is none of {names:?}");
    }
    // What is no number of the density is none of them.
    for name in ["march_steps", "light_steps", "cache_cells", "octaves"] {
        assert!(!names.contains(&name), "{model}: {name}");
    }
    let mut bundle = Bundle::with_parameters(&own, &engine, Some(&found)).expect("a bundle");
    let mut shader = OneShader::with_parameters(&own, &engine, Some(&found)).expect("a shader");
    let compared = bounded(model, &own, &engine);
    let home = values(&bundle.picture(gpu).expect("a picture"));
    let share = compared.share(&home);
    println!("{model}, its own values: {share:.2} of the bound");
    assert!(share <= 1.0, "{model}: {share} of the bound");

    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    let mut moved = Vec::new();
    for one in &found.tunables {
        // Near the bundle's own: a density that is nowhere is no picture.
        let [low, high] = one.range;
        let value =
            f64::from((one.value + 0.2 * (high - low) * (random.random::<f64>() - 0.5)).clamp(low, high) as f32);
        bundle.set_density(&one.field, value).expect("it is one of its");
        shader.set_number("density", 0, &one.field, &[value]).expect("it is one of its");
        moved.push((one.name.as_str(), value));
    }
    shader.set_number("march", 0, "everywhere", &[1.0]).expect("every march has it");
    let (there, engine) = build(&moved).expect("an engine");
    let mut compared = bounded(model, &there, &engine);
    for place in 0..moved.len() {
        let [low, high] = found.tunables[place].range;
        let step = 64.0 * ULP * low.abs().max(high.abs());
        let mut most = vec![0.0_f64; compared.truths.len()];
        for sign in [-1.0, 1.0] {
            let mut nudged = moved.clone();
            nudged[place].1 += sign * step;
            // Beyond what is allowed there is nothing to compare.
            let Ok((scene, engine)) = build(&nudged) else { continue };
            for ((most, found), truth) in most.iter_mut().zip(on_cores(&scene, &engine)).zip(&compared.truths) {
                *most = most.max((found - truth).abs());
            }
        }
        compared.bounds.iter_mut().zip(&most).for_each(|(bound, change)| *bound += 2.0 * change);
    }
    let few = compared.truths.len() / 100;
    assert!(compared.beyond(&home) > few, "{model}: other values are another picture");
    for (form, picture) in [("kernels", bundle.picture(gpu)), ("one shader", shader.picture(gpu))] {
        let share = compared.share(&values(&picture.expect("a picture")));
        println!("{model} as {form}, other values: {share:.2} of the bound");
        assert!(share <= 1.0, "{model} as {form}: {share} of the bound");
    }
    assert!(bundle.set_density("none", 1.0).is_err());
    // Other programs are given the same.
    let folder = tempfile::tempdir().expect("a folder");
    bundle.write(folder.path()).expect("written");
    let mut cloud = cloud::Cloud::load(folder.path(), gpu.device(), gpu.queue()).expect("it reads back");
    let wanted = bundle.picture(gpu).expect("a picture").pixels;
    assert!(cloud.draw(gpu.device(), gpu.queue()).expect("a picture") == wanted, "{model}: the program in wgpu");
    let (name, value) = cloud.density()[0].clone();
    assert!((f64::from(value) - found.tunables[0].value).abs() <= ULP * f64::from(value.abs()));
    cloud.set_density(gpu.queue(), &name, 0.9 * value + 0.01).expect("it is one of its");
    assert!(cloud.draw(gpu.device(), gpu.queue()).expect("a picture") != wanted, "{model}: the program in wgpu");
    assert!(languages::godot(&shader).expect("Godot").0.contains(&format!("cloud_density_{}", names[0])));
    if support::require("spirv-tools") {
        std::fs::write(folder.path().join("whole.frag"), whole(&languages::glsl(&shader).expect("GLSL")))
            .expect("written");
        shader.write(folder.path(), Program::Hlsl.files(&shader).expect("texts")).expect("written");
        let hlsl =
            ["-D", "-S", "frag", "-e", "main", "-I.", "--aml", "--amb", "-V", "-o", "picture.spv", "picture.hlsl"];
        // The density alone, as `cloudparity shader --parameters` writes it.
        let alone = found.shader(Language::Glsl).expect("GLSL");
        assert!(String::from_utf8_lossy(&alone).contains(&format!("// {} = ", names[0])), "{model}");
        std::fs::write(folder.path().join("alone.comp"), alone).expect("written");
        for arguments in [&["whole.frag"][..], &["-V", "-o", "alone.spv", "alone.comp"], &hlsl] {
            let output = glslang(folder.path(), arguments);
            assert!(output.status.success(), "{model}: {}", String::from_utf8_lossy(&output.stdout));
        }
    }
}

#[test]
fn parameters_of_a_density_are_changed_without_compiling() {
    let Some(gpu) = adapter() else { return };
    let clouds = small(support::scene("procedural-clouds"));
    let wanted = ["density", "low_altitude_density", "large_noise_factor", "large_noise_time", "medium_noise_scale"];
    check_parameters("graph", &clouds, &["march_steps=12", "light_steps=2"], &wanted, &gpu);
    check_parameters("skill", &clouds, &[], &["coverage", "detail"], &gpu);
    check_parameters("bolt", &clouds, &[], &["coverage", "density", "scale"], &gpu);
    check_parameters("clusters", &clouds, &[], &["spread"], &gpu);
}

#[test]
fn what_a_bundle_has_not_is_refused() {
    let clouds = small(support::scene("procedural-clouds"));
    let shell = Domain::Shell { centre: [0.0, 0.0, -100.0], inner: 100.0, outer: 102.0 };
    let refused = |scene: &Scene, engine: &Engine, word: &str| {
        let error = Bundle::new(scene, engine).err().expect("refused").to_string();
        assert!(error.contains(word), "{error}");
    };
    refused(&clouds, &engine(&clouds, "graph", Some(shell), &[]), "a box or a slab");
    let mut panorama = clouds.clone();
    panorama.camera.projection = Projection::Equirectangular;
    panorama.camera.panorama = Some(cloudparity::scene::Panorama {
        longitude_min: -1.0,
        longitude_max: 1.0,
        latitude_min: -1.0,
        latitude_max: 1.0,
    });
    refused(&panorama, &engine(&panorama, "graph", None, &[]), "a panorama");
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("bundle.json"), "{\"format\": 3").expect("written");
    let error = Bundle::load(folder.path()).err().expect("refused").to_string();
    assert!(error.contains("line 1"), "{error}");
}

#[test]
fn the_program_in_wgpu_draws_the_same_bits() {
    let Some(gpu) = adapter() else { return };
    let clouds = small(support::scene("procedural-clouds"));
    for model in ["graph", "skill", "perlin-fbm"] {
        let folder = tempfile::tempdir().expect("a folder");
        let bundle = Bundle::new(&clouds, &engine(&clouds, model, None, &[])).expect("a bundle");
        bundle.write(folder.path()).expect("written");
        let wanted = bundle.picture(&gpu).expect("a picture").pixels;
        let mut cloud = cloud::Cloud::load(folder.path(), gpu.device(), gpu.queue()).expect("it reads back");
        assert_eq!(cloud.resolution(), [16, 9]);
        assert!(cloud.draw(gpu.device(), gpu.queue()).expect("a picture") == wanted, "{model}");
        let extinction = cloud.number("march", "extinction").expect("it has one");
        extinction.iter_mut().for_each(|value| *value *= 1.01);
        assert!(cloud.draw(gpu.device(), gpu.queue()).expect("a picture") != wanted, "{model}");
        assert!(cloud.number("march", "nothing").is_none());
    }
}

/// Files of a program's bundle, written.
fn written(scene: &Scene, model: &str, program: Program) -> (tempfile::TempDir, OneShader) {
    let shader = OneShader::new(scene, &engine(scene, model, None, &[])).expect("a shader");
    let folder = tempfile::tempdir().expect("a folder");
    shader.write(folder.path(), program.files(&shader).expect("files")).expect("written");
    (folder, shader)
}

fn glslang(folder: &Path, arguments: &[&str]) -> std::process::Output {
    std::process::Command::new("glslangValidator").current_dir(folder).args(arguments).output().expect("it is there")
}

/// Every system: names of their functions meet those of hosts.
const MODELS: [&str; 8] = ["graph", "skill", "perlin-fbm", "bolt", "bfwe", "best", "takram", "clusters"];

/// A fragment shader of WebGL 2 with the functions of a bundle.
fn whole(text: &str) -> String {
    format!(
        "#version 300 es\nprecision highp float;\nprecision highp int;\nlayout(location = 0) out vec4 colour;\n{text}\n\
         void main() {{ colour = picture(gl_FragCoord.xy); }}\n"
    )
}

#[test]
fn compilers_take_the_shaders_of_programs() {
    if !support::require("spirv-tools") {
        return;
    }
    let clouds = small(support::scene("procedural-clouds"));
    let passes = |what: &str, folder: &Path, arguments: &[&str]| {
        let output = glslang(folder, arguments);
        assert!(output.status.success(), "{what}: {}", String::from_utf8_lossy(&output.stdout));
    };
    for model in MODELS {
        let (folder, _) = written(&clouds, model, Program::Three);
        let text = std::fs::read_to_string(folder.path().join("cloud.glsl")).expect("it is there");
        std::fs::write(folder.path().join("whole.frag"), whole(&text)).expect("written");
        passes(model, folder.path(), &["whole.frag"]);
        std::fs::write(folder.path().join("damaged.frag"), whole(&text.replacen("float", "flaot", 1)))
            .expect("written");
        assert!(!glslang(folder.path(), &["damaged.frag"]).status.success(), "a damaged shader passes");

        let (folder, _) = written(&clouds, model, Program::Hlsl);
        let hlsl = ["-D", "-S", "frag", "-e", "main", "-I.", "--aml", "--amb"];
        passes(model, folder.path(), &[&hlsl[..], &["-V", "-o", "picture.spv", "picture.hlsl"]].concat());
        // As a custom node of Unreal calls it: the file is included, the node's function gets its inputs.
        let node = "#include \"cloud.ush\"\nTexture2D<float4> Data;\n\
                    float4 Custom(float3 Place, float3 Direction, float Depth, Texture2D<float4> Data) {\n\
                    return cloud_from_unreal(Place, Direction, Depth, Data); }\n\
                    float4 main(float4 place : SV_Position) : SV_Target { return Custom(place.xyz, place.yzx, place.w, Data); }\n";
        std::fs::write(folder.path().join("node.hlsl"), node).expect("written");
        passes(model, folder.path(), &[&hlsl[..], &["-V", "-o", "node.spv", "node.hlsl"]].concat());
    }
}

#[test]
fn every_number_of_a_shader_has_a_place_in_each_language() {
    let clouds = small(support::scene("procedural-clouds"));
    for model in MODELS {
        let shader = OneShader::new(&clouds, &engine(&clouds, model, None, &[])).expect("a shader");
        let (godot, of_godot) = languages::godot(&shader).expect("a text");
        let (functions, entry, of_nodes) = languages::wgsl_node(&shader).expect("a text");
        for parameter in &of_godot {
            let declared = format!("uniform {} {}", parameter.kind, parameter.name);
            let ends = [";", "["].map(|end| godot.matches(&format!("{declared}{end}")).count());
            assert_eq!(ends[0] + ends[1], 1, "{model}: {declared}");
        }
        let numbers = |block: &str| shader.manifest.blocks.iter().filter(|one| one.name == block).count();
        for parameter in &of_nodes {
            assert!(entry.contains(&format!("{}: ", parameter.name)), "{model}: {}", parameter.name);
            assert!(shader.number(&parameter.block, parameter.element, &parameter.field).is_some());
            assert_eq!(numbers(&parameter.block), 1);
        }
        let all: usize = shader.manifest.blocks.iter().flat_map(|block| &block.elements).map(Vec::len).sum();
        assert_eq!(of_nodes.len(), all, "{model}");
        // A node's module has no bindings of its own, and its texture is an argument.
        assert!(!functions.contains("@group") && !functions.contains("var<uniform>"), "{model}");
        let module =
            naga::front::wgsl::parse_str(&(functions + &entry)).unwrap_or_else(|cause| panic!("{model}: {cause}"));
        let all = naga::valid::Capabilities::empty();
        let mut validator = naga::valid::Validator::new(naga::valid::ValidationFlags::all(), all);
        validator.validate(&module).unwrap_or_else(|cause| panic!("{model}: {cause}"));
    }
}

#[test]
fn a_field_is_stored_as_its_manifest_says() {
    let clouds = small(support::scene("procedural-clouds"));
    let built = engine(&clouds, "graph", None, &[]);
    let field = FieldBundle::new(&clouds, &built, 24, &|_| ()).expect("a field");
    let manifest = &field.manifest;
    let files = field.textures();
    let [x, y, z] = manifest.size;
    assert_eq!(x.max(y).max(z), 24);
    let world = glam::DMat4::from_cols_array_2d(&manifest.to_world).transpose();
    let half = |bytes: &[u8]| half::f16::from_le_bytes([bytes[0], bytes[1]]).to_f32();
    let byte = |bytes: &[u8]| f32::from(bytes[0]) / 255.0;
    type Form<'a> = (&'a str, usize, &'a dyn Fn(&[u8]) -> f32, f64);
    let forms: [Form<'_>; 2] = [
        // Half a unit in the last of 11 bits of the largest value; half a 255th of the range.
        ("f16", 2, &half, f64::from(manifest.range[1]) / 2048.0),
        ("unorm8", 1, &byte, f64::from(manifest.range[1] - manifest.range[0]) / 510.0),
    ];
    for ((name, bytes, decode, bound), stored) in forms.into_iter().zip(&manifest.stored) {
        assert_eq!(stored.format, name);
        let file = &files[&format!("density.{name}.ktx2")];
        let reader = ktx2::Reader::new(file).expect("KTX2");
        let header = reader.header();
        assert_eq!([header.pixel_width, header.pixel_height, header.pixel_depth], [x as u32, y as u32, z as u32]);
        let wanted = if bytes == 2 { ktx2::Format::R16_SFLOAT } else { ktx2::Format::R8_UNORM };
        assert_eq!((header.format, header.level_count, header.type_size), (Some(wanted), 1, bytes as u32));
        let level = reader.levels().next().expect("a level");
        assert_eq!(level.data, &files[&format!("density.{name}.raw")]);
        let mut largest = 0.0_f64;
        for index in (0..x * y * z).step_by(7) {
            let place = glam::DVec3::new((index % x) as f64, (index / x % y) as f64, (index / (x * y)) as f64);
            let local = built.container.to_local.transform_point3(world.transform_point3(place));
            let truth = built.density.values(&[local.as_vec3().to_array()]).expect("a value")[0];
            let found = stored.offset + stored.scale * decode(&level.data[bytes * index..]);
            assert!(
                (f64::from(found) - f64::from(truth)).abs() <= bound * 1.001 + 1e-6,
                "{name} at {place}: {found}, not {truth}"
            );
            largest = largest.max(truth.into());
        }
        assert!(largest > 0.1, "nothing is dense");
    }
    let majorants = ktx2::Reader::new(&files["majorant.f16.ktx2"]).expect("KTX2");
    let levels: Vec<_> = majorants.levels().collect();
    assert_eq!(levels.len(), manifest.majorant_levels.len());
    assert!(
        manifest.majorant_levels.last() == Some(&[1, 1, 1]) && half(levels[levels.len() - 1].data) >= manifest.range[1]
    );
    // Unreal's is the same in centimetres, its largest value 1.
    let (metres, unreal) = (field.grid(), field.grid_of_unreal());
    let corner = |grid: &cloudparity::scene::volume_grid::VolumeGrid| grid.to_object.transform_point3(glam::DVec3::ONE);
    assert!((corner(&metres) * 100.0 - corner(&unreal)).length() < 1e-9);
    assert!((unreal.values.iter().copied().fold(0.0_f32, f32::max) - 1.0).abs() < 1e-3);
    let per_metre = manifest.extinction_per_metre[0] * f64::from(manifest.range[1]);
    assert!((manifest.extinction_per_centimetre_of_largest[0] * 100.0 - per_metre).abs() < 1e-9 * per_metre);

    let shell = Domain::Shell { centre: [0.0, 0.0, -100.0], inner: 100.0, outer: 102.0 };
    let refused = FieldBundle::new(&clouds, &engine(&clouds, "graph", Some(shell), &[]), 24, &|_| ());
    assert!(refused.err().expect("refused").to_string().contains("a box"));
}
