//! Defects of published engines: each is kept by itself, all together are the engine as published, none the corrected one.

mod support;

use assert_cmd::cargo::cargo_bin_cmd;
use cloudparity::engines;
use cloudparity::engines::defects::Defects;
use cloudparity::engines::perlin_fbm::MODEL;
use cloudparity::engines::perlin_fbm::defects::{DEFECTS, GOD_RAYS_FROM_BEHIND, MASK_NOISE_KEPT};
use cloudparity::engines::render::{EngineJitter, EngineSettings, render};
use cloudparity::gpu::Backend;
use cloudparity::scene::Scene;
use cloudparity::scene::image::Image;

const SETTINGS: EngineSettings =
    EngineSettings { jitter: EngineJitter::BlueNoise, frame: 3, sub_pixels: 1, god_rays: true };

/// A small scene with a background.
fn scene() -> Scene {
    let mut scene = support::scene("linear-ramp");
    scene.film.resolution = [32, 18];
    scene.world.color = [0.2, 0.3, 0.5];
    scene
}

/// The engine's picture with small textures.
fn picture(scene: &Scene, defects: &Defects, changes: &[&str]) -> Image {
    picture_with(scene, defects, changes, &SETTINGS)
}

fn picture_with(scene: &Scene, defects: &Defects, changes: &[&str], settings: &EngineSettings) -> Image {
    let changes: Vec<String> =
        ["texture_size=32", "octaves=3"].iter().chain(changes).map(|&text| text.into()).collect();
    let values = MODEL.values(Some("low"), &changes).expect("in range");
    let engine = MODEL.engine(scene, &values, defects, 2.0).expect("an engine");
    render(scene, &engine, settings, Backend::Cpu, &|_, _| ()).expect("a picture")
}

/// Means of a picture's channels over its pixels, with four weights: 1, the column and the row from 0 to 1, and 1 and -1 as on a chessboard.
type Means = [[f64; 4]; 4];

fn means(image: &Image) -> Means {
    let mut means = Means::default();
    for (index, pixel) in image.pixels.iter().enumerate() {
        let [column, row] = [index % image.width, index / image.width];
        let part = |at: usize, side: usize| (at as f64 + 0.5) / side as f64;
        let sign = if (column + row) % 2 == 0 { 1.0 } else { -1.0 };
        let weights = [1.0, part(column, image.width), part(row, image.height), sign];
        for (sums, weight) in means.iter_mut().zip(weights) {
            for (sum, value) in sums.iter_mut().zip(pixel) {
                *sum += weight * f64::from(*value) / image.pixels.len() as f64;
            }
        }
    }
    means
}

/// Largest error of a mean. A pixel may be off by 1e-4 with textures filtered in f32, times the sun's strength of 6 in this scene; errors of
/// 576 pixels that go both ways leave a 24th of that, and 1e-9 are the digits below.
const MEAN: f64 = 6e-4 / 24.0 + 1e-9;

/// Parameters, whether the film is transparent, and means of the corrected picture and of the one as published. They are those of pictures of
/// an engine that had two forms and no defect could be kept by itself, whose density was f64, its mask had seeds of its own, and the sun of
/// its god rays, which is not seen in these pictures, stood nowhere else.
const PICTURES: [(&[&str], bool, [Means; 2]); 4] = [
    (
        &["mask_seed=1"],
        false,
        [
            [
                [0.260235532, 0.360669407, 0.561045988, 1.0],
                [0.130410349, 0.180645492, 0.280850964, 0.5],
                [0.126917278, 0.177120928, 0.277297929, 0.5],
                [0.002851581, 0.002885629, 0.002911924, 0.0],
            ],
            [
                [0.227070692, 0.323008047, 0.515656508, 1.0],
                [0.113258295, 0.161243928, 0.257597457, 0.5],
                [0.11378979, 0.162209386, 0.259399026, 0.5],
                [0.00360516, 0.004254155, 0.005551547, 0.0],
            ],
        ],
    ),
    (
        &["mask_seed=1"],
        true,
        [
            [
                [0.099504558, 0.119967292, 0.160450185, 0.197604394],
                [0.050146826, 0.06045949, 0.080846212, 0.099350966],
                [0.044956406, 0.054371874, 0.072997191, 0.090810223],
                [0.003086274, 0.003258364, 0.003561517, 0.001238367],
            ],
            [
                [0.053205053, 0.06153314, 0.07897874, 0.12043347],
                [0.026150471, 0.030237904, 0.038802795, 0.059242461],
                [0.025692917, 0.029756037, 0.038239423, 0.054839716],
                [0.003850652, 0.004514893, 0.00584165, -0.000513903],
            ],
        ],
    ),
    (
        &["mask_seed=7", "detail_frequency=6"],
        false,
        [
            [
                [0.261020779, 0.361455379, 0.561829419, 1.0],
                [0.131103845, 0.181330471, 0.281525704, 0.5],
                [0.127055688, 0.177249689, 0.277416604, 0.5],
                [0.002987753, 0.003124171, 0.00324243, 0.0],
            ],
            [
                [0.227070692, 0.323008047, 0.515656508, 1.0],
                [0.113258295, 0.161243928, 0.257597457, 0.5],
                [0.11378979, 0.162209386, 0.259399026, 0.5],
                [0.00360516, 0.004254155, 0.005551547, 0.0],
            ],
        ],
    ),
    (
        &["mask_seed=1", "opacity=1.5", "light_steps=3", "flatten_top=0"],
        true,
        [
            [
                [0.076441474, 0.097752099, 0.1402966, 0.203580346],
                [0.038540774, 0.04918657, 0.070428295, 0.101473972],
                [0.030423136, 0.038976094, 0.056057161, 0.081811635],
                [0.000257159, 0.000433929, 0.00071948, 0.000751478],
            ],
            [[0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]],
        ],
    ),
];

#[test]
fn all_and_none_are_the_two_forms() {
    for (changes, transparent, expected) in PICTURES {
        let mut scene = scene();
        scene.film.transparent = transparent;
        let changes: Vec<&str> = changes.iter().copied().chain(["detail_seed=10"]).collect();
        for (defects, expected) in [Defects::NONE, Defects::ALL].iter().zip(expected) {
            let found = picture_with(&scene, defects, &changes, &EngineSettings { god_rays: false, ..SETTINGS });
            let found = means(&found);
            let pairs = found.as_flattened().iter().zip(expected.as_flattened());
            let largest = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(largest <= MEAN, "{defects}, {changes:?}, transparent: {transparent}: {largest:e}\n{found:?}");
        }
    }
}

#[test]
fn the_mask_has_the_seed_unless_it_has_its_own() {
    let scene = scene();
    let [own, followed, other] = [["seed=42", "mask_seed=5", "detail_seed=15"].as_slice(), &["seed=5"], &["seed=42"]]
        .map(|changes| picture(&scene, &Defects::NONE, changes));
    assert_ne!(own.pixels, followed.pixels, "the volume has another seed");
    // With the mask alone nothing but its seeds is left.
    let mask = |changes: &[&str], defects: &str| {
        let changes: Vec<&str> = changes.iter().copied().chain(["show_mask=1"]).collect();
        picture(&scene, &defects.parse().expect("known"), &changes).pixels
    };
    assert_eq!(mask(&["seed=5"], "none"), mask(&["seed=42", "mask_seed=5", "detail_seed=15"], "none"));
    assert_ne!(mask(&["seed=5"], "none"), mask(&["seed=5", "detail_seed=16"], "none"));
    assert_ne!(own.pixels, other.pixels);
    // As published they never arrive.
    assert_eq!(mask(&["seed=5"], "PF-3"), mask(&["seed=42", "mask_seed=1", "detail_seed=10"], "none"));
}

/// What a picture must hold for a defect to be seen in it, and what else has to be kept.
fn revealing(id: &str) -> (Scene, &'static [&'static str]) {
    let mut scene = scene();
    match id {
        // Only a flattening that is not above 0 divides by it.
        "PF-1" => (scene, &["flatten_top=0"]),
        // Only settings other than those that the mask begins with can fail to reach it.
        "PF-3" => (scene, &["mask_seed=7", "detail_frequency=6"]),
        // Only a cloud that reaches the box's far side and that a ray comes through; of four steps the fade takes two.
        "PF-9" => (scene, &["opacity=0.5", "mask_radius=1.2", "march_steps=4"]),
        // Only a sun behind the camera, whose mirrored point is seen: a sixth of a radian off the axis. A thin cloud lets it through.
        "PF-13" => {
            let camera = cloudparity::scene::matrix_to_glam(&scene.camera.matrix_world);
            let angle = std::f64::consts::PI - 1.0 / 6.0;
            let towards = camera.x_axis.truncate() * angle.sin() - camera.z_axis.truncate() * angle.cos();
            for (row, part) in towards.normalize().to_array().into_iter().enumerate() {
                scene.lights[0].matrix_world[row][2] = part as f32;
            }
            (scene, &["opacity=0.2"])
        }
        _ => (scene, &[]),
    }
}

#[test]
fn each_defect_alone_changes_a_picture() {
    for defect in DEFECTS {
        let (scene, changes) = revealing(defect.id);
        let [corrected, kept] =
            [Defects::NONE, Defects::only(defect)].map(|defects| picture(&scene, &defects, changes));
        let differences =
            corrected.pixels.as_flattened().iter().zip(kept.pixels.as_flattened()).map(|(a, b)| (a - b).abs());
        let largest = differences.fold(0.0, f32::max);
        // What is seen: half a step of 8 bits at least.
        assert!(largest > 0.5 / 255.0, "{}: {largest}", defect.id);
        assert_eq!(kept.provenance["defects"], defect.id);
        assert_eq!(corrected.provenance["defects"], "none");
    }
}

#[test]
fn a_defect_that_another_hides_changes_nothing_beside_it() {
    // Of the mask's textures nothing is seen that is never uploaded.
    let (scene, changes) = revealing(MASK_NOISE_KEPT.id);
    let [one, both] = ["PF-2", "PF-2,PF-3"].map(|text| picture(&scene, &text.parse().expect("known"), changes));
    assert_eq!(one.pixels, both.pixels);
    // And no god rays, no defect of theirs.
    let (scene, changes) = revealing(GOD_RAYS_FROM_BEHIND.id);
    let away = Scene { lights: Vec::new(), ..scene };
    let [corrected, kept] =
        [Defects::NONE, Defects::only(&GOD_RAYS_FROM_BEHIND)].map(|defects| picture(&away, &defects, changes));
    assert_eq!(corrected.pixels, kept.pixels);
}

#[test]
fn a_list_of_all_is_all() {
    let ids: Vec<&str> = DEFECTS.iter().map(|defect| defect.id).collect();
    let list: Defects = ids.join(",").parse().expect("known");
    let [listed, all] = [list, Defects::ALL].map(|defects| picture(&scene(), &defects, &[]));
    assert_eq!(listed.pixels, all.pixels);
    assert_eq!(all.provenance["defects"], ids.join(","));
}

#[test]
fn an_engine_without_defects_refuses_one() {
    let model = engines::find("graph").expect("it is there");
    let values = model.values(None, &[]).expect("in range");
    let refused = |text: &str| model.engine(&scene(), &values, &text.parse().expect("known"), 0.0).err();
    assert!(refused("PF-4").expect("refused").to_string().contains("no defects"));
    assert!(refused("all").is_none() && refused("none").is_none());
}

#[test]
fn the_command_takes_names_of_defects() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("out.exr");
    let run = |arguments: &[&str]| {
        let mut command = cargo_bin_cmd!("cloudparity");
        command
            .arg("render")
            .arg(support::project("parity/scenes/linear-ramp.scene.json"))
            .args(["--model", "perlin-fbm"]);
        command.args(["--resolution", "8x8", "-p", "texture_size=32", "-o"]).arg(&path).args(arguments);
        let output = command.output().expect("it runs");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    assert_eq!(run(&["--defects", "PF-6,PF-4"]).0, Some(0));
    assert_eq!(Image::read_exr(&path).expect("a picture").provenance["defects"], "PF-4,PF-6");
    for (arguments, expected) in [
        (&["--defects", "PF-99"][..], "PF-4, PF-5"),
        (&["--defects", ""], "all, none, or some of"),
        (&["--variant", "as-published"], "--defects all for as-published"),
    ] {
        let (code, message) = run(arguments);
        assert!(code == Some(2) && message.contains(expected), "{arguments:?}: {message}");
    }
    let listed = cargo_bin_cmd!("cloudparity").args(["models", "perlin-fbm"]).output().expect("it runs").stdout;
    let listed = String::from_utf8(listed).expect("text");
    assert!(DEFECTS.iter().all(|defect| listed.contains(&format!("defect {}: {}", defect.id, defect.about))));
}
