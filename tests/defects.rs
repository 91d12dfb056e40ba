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
use sha2::{Digest, Sha256};

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

/// The first 16 bytes of the SHA-256 of a picture's pixels.
fn digest(image: &Image) -> String {
    let mut hash = Sha256::new();
    for value in image.pixels.as_flattened() {
        hash.update(value.to_le_bytes());
    }
    hash.finalize().iter().take(16).map(|byte| format!("{byte:02x}")).collect()
}

/// Parameters, whether the film is transparent, and digests of the corrected picture and of the one as published. They were written when an
/// engine had two forms and no defect could be kept by itself, its mask had seeds of its own, and the sun of its god rays, which is not
/// seen in these pictures, stood nowhere else.
const PICTURES: [(&[&str], bool, [&str; 2]); 4] = [
    (&["mask_seed=1"], false, ["cc7143aa3a619753f5c705195311e647", "52a7a4841ecad022426acb8f4d9c9196"]),
    (&["mask_seed=1"], true, ["b84b7839e0e10ab3b55778d240d1c5b9", "d82fe50d75e7839fd8868a45b2e91e6d"]),
    (
        &["mask_seed=7", "detail_frequency=6"],
        false,
        ["74012dc2d57d37be53ddf4afe3eb2460", "52a7a4841ecad022426acb8f4d9c9196"],
    ),
    (
        &["mask_seed=1", "opacity=1.5", "light_steps=3", "flatten_top=0"],
        true,
        ["352e5500f19125b86413c1464eae5321", "2d07a41ae992770085117e9815300bfd"],
    ),
];

#[test]
fn all_and_none_are_the_two_forms_to_the_bit() {
    for (changes, transparent, digests) in PICTURES {
        let mut scene = scene();
        scene.film.transparent = transparent;
        let changes: Vec<&str> = changes.iter().copied().chain(["detail_seed=10"]).collect();
        for (defects, expected) in [Defects::NONE, Defects::ALL].iter().zip(digests) {
            let found = picture_with(&scene, defects, &changes, &EngineSettings { god_rays: false, ..SETTINGS });
            assert_eq!(digest(&found), expected, "{defects}, {changes:?}, transparent: {transparent}");
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
        command.arg("engine").arg(support::project("parity/scenes/linear-ramp.scene.json"));
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
