//! Writes the inputs that fuzzing begins with, `FOLDER/TARGET/NAME`: the project's own files, every node in its modes, random graphs.
//!
//! A target that ends before its first input: crates compiled to count their edges link with the fuzzer's runtime alone.
#![no_main]

use cloudparity::measure::nodes::random_graphs::generate;
use cloudparity::measure::nodes::suite::{Selection, cases};
use cloudparity::scene::Scene;
use std::path::{Path, PathBuf};

/// Random graphs.
const GRAPHS: u64 = 100;

/// Modes of a node, the first of its list.
const MODES: usize = 12;

fn write(folder: &Path, target: &str, name: &str, bytes: &[u8]) {
    let folder = folder.join(target);
    std::fs::create_dir_all(&folder).expect("a folder for seeds");
    std::fs::write(folder.join(name), bytes).expect("a seed is written");
}

fn files(folder: &str, ending: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|cause| panic!("{folder}: {cause}"));
    let paths = entries.map(|entry| entry.expect("an entry").path());
    paths.filter(|path| path.to_string_lossy().ends_with(ending)).collect()
}

fn name(path: &Path) -> String {
    path.file_name().expect("a file").to_string_lossy().into_owned()
}

fn npy(descriptor: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let mut header = format!("{{'descr': '{descriptor}', 'fortran_order': False, 'shape': {shape}, }}");
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let length = u16::try_from(header.len()).expect("a short header").to_le_bytes();
    [b"\x93NUMPY\x01\x00", length.as_slice(), header.as_bytes(), data].concat()
}

fn write_all_and_end() {
    let folder = PathBuf::from(std::env::args().nth(1).expect("the folder for seeds"));
    for path in files("parity/scenes", ".scene.json") {
        write(&folder, "scene", &name(&path), &std::fs::read(&path).expect("a committed scene"));
        // Scenes with grids and pictures of others are read by Python; the graphs of those that name no file are seeds in themselves.
        if let Ok(scene) = Scene::load(&path) {
            let graph = serde_json::to_vec(scene.graph()).expect("a graph is JSON");
            write(&folder, "graph", &name(&path), &graph);
        }
    }
    for seed in 0..GRAPHS {
        let graph = generate(seed, 4).expect("a graph").trial.scene;
        write(&folder, "graph", &format!("random-{seed}.json"), &serde_json::to_vec(graph.graph()).expect("JSON"));
        if seed < 20 {
            write(&folder, "scene", &format!("random-{seed}.json"), &serde_json::to_vec(&graph).expect("JSON"));
        }
    }
    let mut known = std::collections::HashMap::<&str, usize>::new();
    for case in cases(8, 1, None, Selection::Everything).expect("the modes of all nodes") {
        let number = known.entry(case.node).and_modify(|number| *number += 1).or_default();
        if *number < MODES {
            let file = format!("{}-{number}.json", case.node.replace(['/', ' '], "-"));
            write(&folder, "graph", &file, &serde_json::to_vec(case.scene.graph()).expect("JSON"));
        }
    }
    for (target, directory, ending) in [
        ("study", "parity/studies", ".study.toml"),
        ("tuning", "parity/studies", ".tune.toml"),
        ("preset", "parity/presets", ".preset.json"),
        ("records", "fuzz/seeds/records", ".json"),
    ] {
        for path in files(directory, ending) {
            let text = std::fs::read_to_string(&path).expect("a committed file");
            write(&folder, target, &name(&path), text.as_bytes());
            // The same over scenes that are there, and with densities that need no textures.
            let own = [
                "clouds-in-daylight",
                "procedural-clouds",
                "clouds-at-low-sun",
                "clouds-close",
                "clouds-against-the-sun",
            ]
            .iter()
            .fold(text, |text, scene| text.replace(scene, "linear-ramp"))
            .replace("perlin-fbm", "graph");
            write(&folder, target, &format!("ramp-{}", name(&path)), own.as_bytes());
        }
    }
    let values: Vec<u8> = (0..12).flat_map(|value: i16| f32::from(value).to_le_bytes()).collect();
    for (number, (descriptor, shape)) in [
        ("<f4", "(4, 3)"),
        ("<f4", "(12,)"),
        (">f4", "(4, 3)"),
        ("<f8", "(2, 3)"),
        ("<f4", "(2, 2, 3)"),
        ("|O", "(1,)"),
    ]
    .into_iter()
    .enumerate()
    {
        write(&folder, "npy", &format!("{number}.npy"), &npy(descriptor, shape, &values));
    }
    std::process::exit(0)
}

libfuzzer_sys::fuzz_target!(
    init: write_all_and_end(),
    |_bytes: &[u8]| {}
);
