mod support;
use cloudparity::engines;
use cloudparity::engines::light::Variant;
use cloudparity::engines::render::{EngineJitter, EngineSettings, render};
use cloudparity::gpu::Backend;
use sha2::{Digest, Sha256};

const CASES: [(&str, &[&str], bool); 4] = [
    ("plain", &[], false),
    ("transparent", &[], true),
    ("mask", &["mask_seed=7", "detail_frequency=6"], false),
    ("thin", &["opacity=1.5", "light_steps=3", "flatten_top=0"], true),
];

#[test]
fn golden() {
    for variant in [Variant::Fixed, Variant::AsPublished] {
        for (name, changes, transparent) in CASES {
            let model = engines::find("perlin-fbm").unwrap();
            let changes: Vec<String> = ["texture_size=32", "octaves=3"].iter().chain(changes).map(|&t| t.into()).collect();
            let mut scene = support::scene("linear-ramp");
            scene.film.resolution = [32, 18];
            scene.film.transparent = transparent;
            scene.world.color = [0.2, 0.3, 0.5];
            let values = model.values(Some("low"), &changes).unwrap();
            let engine = model.engine(&scene, &values, variant, 2.0).unwrap();
            let settings = EngineSettings { jitter: EngineJitter::BlueNoise, frame: 3, sub_pixels: 1, god_rays: true };
            let image = render(&scene, &engine, &settings, Backend::Cpu, &|_, _| ()).unwrap();
            let mut hash = Sha256::new();
            for value in image.pixels.as_flattened() { hash.update(value.to_le_bytes()); }
            let sum: f32 = image.pixels.as_flattened().iter().sum();
            println!("{variant:?} {name} {} {sum}", hash.finalize().iter().take(16).map(|b| format!("{b:02x}")).collect::<String>());
        }
    }
}
