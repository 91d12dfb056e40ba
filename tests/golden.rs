//! The published engine's own results, from a directory with a `manifest.json`: `GOLDEN_DIR`, else the shared one where it is there.
//!
//! What the original computes on the CPU in double precision is met to the byte; what it computes on the GPU was
//! evaluated in double precision too, and is met to rounding.

mod support;

use cloudparity::engines::defects::Defects;
use cloudparity::engines::light::LightModel;
use cloudparity::engines::light::Sun;
use cloudparity::engines::march::gpu::MarchKernel;
use cloudparity::engines::march::{RealTimeRay, RealTimeSettings};
use cloudparity::engines::parameters::Values;
use cloudparity::engines::passes::compositing::Compositing;
use cloudparity::engines::passes::god_rays::{GodRayKernel, GodRayPass, GodRays, Layer, texel_of};
use cloudparity::engines::perlin_fbm::gpu::BakeKernel;
use cloudparity::engines::perlin_fbm::settings;
use cloudparity::engines::render::EngineJitter;
use cloudparity::gpu::Gpu;
use cloudparity::nodes::perlin_fbm::bake::Bake;
use cloudparity::nodes::perlin_fbm::mask::{Deformation, Mask};
use cloudparity::nodes::perlin_fbm::noise::{Field, Octaves, noise, octaves};
use cloudparity::nodes::perlin_fbm::random::{Random, permutation};
use cloudparity::nodes::perlin_fbm::{Cloud, Evaluation, Parameters};
use cloudparity::nodes::running_error::RunningError;
use cloudparity::view::jitter_table;
use glam::DVec3;
use serde_json::{Value, json};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use support::cloud::{Boxed, local_box};
use support::rounding::{Single, blur_error, check_bake};

/// Double precision in another order of operations: some ten roundings of values up to 50.
const ROUNDING: f64 = 1e-12;

struct Golden {
    folder: PathBuf,
    manifest: Value,
}

impl Golden {
    fn open() -> Option<Self> {
        let folder = match std::env::var_os("GOLDEN_DIR") {
            Some(folder) => PathBuf::from(folder),
            None => {
                let shared = support::project("../shared/golden/perlin-fbm");
                if !shared.exists() {
                    eprintln!("skipped: {} is missing", shared.display());
                    return None;
                }
                shared
            }
        };
        let manifest = read_json(&folder.join("manifest.json"));
        Some(Self { folder, manifest })
    }

    fn json(&self, name: &str) -> Value {
        read_json(&self.folder.join(name))
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        let path = self.folder.join(name);
        std::fs::read(&path).unwrap_or_else(|cause| panic!("{}: {cause}", path.display()))
    }

    fn doubles(&self, name: &str) -> Vec<f64> {
        self.bytes(name).chunks_exact(8).map(|bytes| f64::from_le_bytes(bytes.try_into().expect("eight"))).collect()
    }

    /// The parameters of a bake of the manifest by its name, `P0`.
    fn bake(&self, name: &Value) -> Bake {
        let name = name.as_str().unwrap_or_else(|| panic!("no name of a bake: {name}"));
        let begin = format!("bake_{name}_");
        let entry = self.files(&begin, ".u8").map(|(_, entry)| entry).next();
        bake(&entry.unwrap_or_else(|| panic!("no bake {name} in the manifest"))["parameters"])
    }

    /// Names of the manifest's files that begin and end so, with their entries.
    fn files<'a>(&'a self, begin: &str, end: &'a str) -> impl Iterator<Item = (&'a str, &'a Value)> {
        let begin = begin.to_owned();
        let files = self.manifest["files"].as_object().expect("a manifest lists files");
        files
            .iter()
            .map(|(name, entry)| (name.as_str(), entry))
            .filter(move |(name, _)| name.starts_with(&begin) && name.ends_with(end))
    }
}

fn read_json(path: &Path) -> Value {
    let text = std::fs::read_to_string(path).unwrap_or_else(|cause| panic!("{}: {cause}", path.display()));
    serde_json::from_str(&text).unwrap_or_else(|cause| panic!("{}: {cause}", path.display()))
}

/// Names of the columns of an entry.
fn columns(entry: &Value) -> Vec<&str> {
    let names = entry["columns"].as_array().unwrap_or_else(|| panic!("no columns in {entry}"));
    names.iter().map(|name| name.as_str().expect("a column's name")).collect()
}

/// Sides of an entry's picture: rows and columns.
fn sides(entry: &Value) -> [usize; 2] {
    [0, 1].map(|axis| entry["shape"][axis].as_u64().unwrap_or_else(|| panic!("no shape in {entry}")) as usize)
}

fn number(value: &Value, name: &str) -> f64 {
    value[name].as_f64().unwrap_or_else(|| panic!("no number {name} in {value}"))
}

fn bake(value: &Value) -> Bake {
    Bake {
        coverage: number(value, "cloudCoverage"),
        softness: number(value, "cloudSoftness"),
        noise_scale: number(value, "noiseScale"),
        octaves: Octaves {
            count: number(value, "octaves") as u32,
            persistence: number(value, "persistence"),
            lacunarity: number(value, "lacunarity"),
        },
        intensity: number(value, "noiseIntensity"),
        seed: number(value, "seed"),
    }
}

fn mask(value: &Value) -> Mask {
    let of = |names: [&str; 3]| names.map(|name| number(value, name));
    Mask {
        reads_textures: true,
        radius: number(value, "radius"),
        softness: number(value, "softness"),
        flattening: [
            of(["flatten_x_neg", "flatten_bottom", "flatten_z_neg"]),
            of(["flatten_x_pos", "flatten_top", "flatten_z_pos"]),
        ],
        deformations: ["noise", "detail"].map(|kind| Deformation {
            seed: number(value, if kind == "noise" { "seed" } else { "detail_seed" }),
            strength: number(value, &format!("{kind}_strength")),
            frequency: number(value, &format!("{kind}_frequency")),
        }),
    }
}

/// FNV-1a of 32 bits.
fn hash(bytes: &[u8]) -> String {
    let sum = bytes.iter().fold(0x811c_9dc5_u32, |hash, &byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193));
    format!("{sum:08x}")
}

/// Equal to the byte, but for a power that may differ in its last bit where the intensity is not 1.
fn same_texels(name: &str, ours: &[u8], expected: &[u8], is_exact: bool) {
    assert_eq!(ours.len(), expected.len(), "{name}");
    let differing: Vec<u8> = ours.iter().zip(expected).map(|(a, b)| a.abs_diff(*b)).filter(|&d| d > 0).collect();
    if is_exact {
        assert!(differing.is_empty(), "{name}: {} texels differ", differing.len());
    } else {
        assert!(differing.iter().all(|&d| d == 1), "{name}: a texel differs by more than 1");
        // A last bit moves a value over one of 255 thresholds with a chance of some 1e-14.
        assert!(differing.len() <= 2, "{name}: {} texels differ", differing.len());
    }
}

#[test]
fn random_numbers_and_permutations_are_those_of_the_engine() {
    let Some(golden) = Golden::open() else { return };
    for sequence in golden.json("random.json")["sequences"].as_array().expect("sequences") {
        let mut random = Random::new(number(sequence, "seed"));
        let draws: Vec<u32> = (0..100_000).map(|_| random.draw()).collect();
        for (index, expected) in sequence["first"].as_array().expect("draws").iter().enumerate() {
            assert_eq!(u64::from(draws[index]), expected.as_u64().expect("whole"), "{}: {index}", sequence["seed"]);
        }
        for (name, expected) in sequence.as_object().expect("an object") {
            let Some(at) = name.strip_prefix("at_") else { continue };
            let at: usize = at.parse().expect("a number");
            assert_eq!(u64::from(draws[at - 1]), expected.as_u64().expect("whole"), "{}: {at}", sequence["seed"]);
        }
    }
    for expected in golden.json("permutations.json")["tables"].as_array().expect("tables") {
        let table: Vec<Value> = permutation(number(expected, "seed")).iter().map(|&entry| entry.into()).collect();
        assert_eq!(&Value::from(table), &expected["table"], "seed {}", expected["seed"]);
    }
}

#[test]
fn noise_is_exact_in_double_precision_and_within_its_rounding_in_single() {
    let Some(golden) = Golden::open() else { return };
    let points = golden.doubles("noise_points.f64");
    let values = golden.doubles("noise_values.f64");
    let columns = columns(&golden.manifest["files"]["noise_values.f64"]);
    for (column, name) in columns.iter().enumerate() {
        let after = |word: &str| -> Option<f64> {
            let (_, rest) = name.split_once(word)?;
            rest.trim_start().split(',').next()?.trim().parse().ok()
        };
        let table = permutation(after("seed").unwrap_or_else(|| panic!("no seed in \"{name}\"")));
        let sum = after("octaves").map(|count| Octaves {
            count: count as u32,
            persistence: after("persistence").expect("a persistence"),
            lacunarity: after("lacunarity").expect("a lacunarity"),
        });
        let field = match ["mask noise", "volume noise"].map(|kind| name.contains(kind)) {
            [true, false] => Field::Mask,
            [false, true] => Field::Volume,
            _ => panic!("which noise is \"{name}\"?"),
        };
        assert!(sum.is_none() || field == Field::Volume, "octaves are of the volume's noise: {name}");
        for (point, row) in points.chunks_exact(3).zip(values.chunks_exact(columns.len())) {
            let place = [point[0], point[1], point[2]];
            let (double, single, bound): (f64, f32, RunningError) = match &sum {
                Some(sum) => (octaves(&table, place, sum), octaves(&table, place, sum), octaves(&table, place, sum)),
                None => (noise(field, &table, place), noise(field, &table, place), noise(field, &table, place)),
            };
            assert_eq!(double, row[column], "{name} at {place:?}");
            let error = (f64::from(single) - row[column]).abs();
            let limit = bound.error();
            assert!(error <= limit, "{name} at {place:?}: error {error:e} of {limit:e} in single precision");
        }
    }
}

#[test]
fn bakes_are_the_engines_byte_for_byte() {
    let Some(golden) = Golden::open() else { return };
    for (name, entry) in golden.files("bake_", ".u8") {
        let parameters = bake(&entry["parameters"]);
        let side = sides(entry)[0];
        let ours = parameters.volume(side).expect("parameters in range");
        same_texels(name, &ours.texels, &golden.bytes(name), parameters.intensity == 1.0);
    }
    for (name, entry) in golden.json("bake_hashes.json").as_object().expect("an object") {
        let parameters = bake(&entry["parameters"]);
        let ours = parameters.volume(number(entry, "size") as usize).expect("parameters in range");
        if parameters.intensity == 1.0 {
            assert_eq!(hash(&ours.texels), entry["fnv1a"], "{name}");
        }
        let mean = ours.texels.iter().map(|&texel| f64::from(texel)).sum::<f64>() / ours.texels.len() as f64;
        // Two texels that differ by 1.
        assert!((mean - number(entry, "mean")).abs() <= 2.0 / ours.texels.len() as f64 + 1e-9, "{name}: mean {mean}");
    }
    for (name, entry) in golden.files("bake_", "_blend.f32") {
        let parameters = bake(&entry["parameters"]);
        let side = sides(entry)[0];
        let table = permutation(parameters.seed);
        let expected = golden.bytes(name);
        for (index, bytes) in expected.chunks_exact(4).enumerate() {
            let place = [index % side, index / side % side, index / side / side];
            let value = parameters.blend::<f64>(&table, place.map(|number| number as f64 / (side - 1) as f64));
            assert_eq!(value as f32, f32::from_le_bytes(bytes.try_into().expect("four")), "{name} at {place:?}");
        }
    }
}

#[test]
fn bakes_in_single_precision_are_within_their_rounding() {
    let Some(golden) = Golden::open() else { return };
    for (name, entry) in golden.files("bake_", ".u8") {
        let side = sides(entry)[0];
        let bake = bake(&entry["parameters"]);
        let ours = bake.volume_in::<f32>(side).expect("parameters in range");
        check_bake(name, &bake, side, [&ours.texels, &golden.bytes(name)], Single::Cpu);
    }
}

#[test]
fn bakes_on_the_adapter_are_within_their_rounding() {
    let Some(golden) = Golden::open() else { return };
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("the adapter that was just there");
    let kernel = BakeKernel::new(&gpu).expect("a kernel");
    for (name, entry) in golden.files("bake_", ".u8") {
        let side = sides(entry)[0];
        let bake = bake(&entry["parameters"]);
        let ours = kernel.volume(&bake, side).expect("parameters in range");
        check_bake(name, &bake, side, [&ours.texels, &golden.bytes(name)], Single::Adapter);
    }
}

#[test]
fn the_plain_bake_is_the_bake() {
    for (seed, side) in [(42.0, 17), (-3.75, 9), (1e9 + 0.5, 12)] {
        let bake = Bake { seed, noise_scale: 7.3, intensity: 1.7, ..Bake::default() };
        let [fast, plain] = [bake.volume(side), bake.volume_plain(side)].map(|volume| volume.expect("in range").texels);
        assert_eq!(fast, plain, "seed {seed}");
    }
}

#[test]
fn mask_textures_are_the_engines_byte_for_byte() {
    let Some(golden) = Golden::open() else { return };
    let hashes = golden.json("masknoise_hashes.json");
    for (name, entry) in golden.files("masknoise_", "_sub32.u8") {
        let deformation =
            Deformation { seed: number(entry, "seed"), strength: 0.0, frequency: number(entry, "frequency") };
        let volume = deformation.texture();
        let (side, texels) = (volume.side, &volume.texels);
        let short = name.trim_start_matches("masknoise_").trim_end_matches("_sub32.u8");
        assert_eq!(hash(texels), hashes[short]["fnv1a"], "{short}");
        // Which texels the file holds: "texels (4i+1,4j+1,4k+1) of the 128^3 texture".
        let [step, begin, whole] = numbers(entry, "texels (", "^3 texture")[..] else {
            panic!("which texels are {}?", entry["what"])
        };
        assert_eq!(whole as usize, side, "{name}");
        let coarse = sides(entry)[0];
        let every_fourth: Vec<u8> = (0..coarse.pow(3))
            .map(|index| {
                let place = [index % coarse, index / coarse % coarse, index / coarse / coarse];
                let [x, y, z] = place.map(|number| step as usize * number + begin as usize);
                texels[(z * side + y) * side + x]
            })
            .collect();
        same_texels(name, &every_fourth, &golden.bytes(name), true);
    }
}

/// The different numbers in an entry's words from `begin` to `end`, in their order.
fn numbers(entry: &Value, begin: &str, end: &str) -> Vec<f64> {
    let words = entry["what"].as_str().unwrap_or_else(|| panic!("no words in {entry}"));
    let inside = words.split_once(begin).and_then(|(_, rest)| rest.split_once(end));
    let (inside, _) = inside.unwrap_or_else(|| panic!("no \"{begin} .. {end}\" in \"{words}\""));
    let mut found: Vec<f64> = Vec::new();
    for number in inside.split(|letter: char| !letter.is_ascii_digit()).filter_map(|text| text.parse().ok()) {
        if !found.contains(&number) {
            found.push(number);
        }
    }
    found
}

/// The cloud of an entry: its volume's bake and size, its mask and `from`'s other parameters.
fn cloud(entry: &Value, bake: Bake, size: usize, density_multiplier: &str) -> Cloud {
    Cloud::new(parameters(entry, bake, size, density_multiplier)).expect("parameters in range")
}

fn parameters(entry: &Value, bake: Bake, size: usize, density_multiplier: &str) -> Parameters {
    Parameters {
        bake,
        texture_size: size,
        mask: mask(&entry["mask"]),
        tiling: number(entry, "tiling"),
        offset: triple(&entry["offset"]),
        threshold: number(entry, "threshold"),
        density_multiplier: number(entry, density_multiplier),
        evaluation: Evaluation::Baked,
        shows_mask: entry["mask"]["visualize"].as_bool().unwrap_or(false),
    }
}

fn triple(value: &Value) -> [f64; 3] {
    std::array::from_fn(|axis| value[axis].as_f64().unwrap_or_else(|| panic!("no three numbers in {value}")))
}

#[test]
fn mask_and_density_are_the_engines() {
    let Some(golden) = Golden::open() else { return };
    let points = golden.doubles("mask_points.f64");
    for (name, entry) in golden.files("mask_values_", ".f64") {
        let size = number(&entry["volume"], "size") as usize;
        let volume = golden.bake(&entry["volume"]["bake"]);
        let cloud = cloud(entry, volume, size, "density_multiplier");
        let bare = Parameters { mask: Mask { reads_textures: false, ..mask(&entry["mask"]) }, ..*cloud.parameters() };
        let never_uploaded = Cloud::new_after(bare, Some(&cloud)).expect("parameters in range");
        let expected = golden.doubles(name);
        let [distance, bare_distance, rest @ ..] = &columns(entry)[..] else { panic!("columns of {name}") };
        assert!(*distance == "sdf" && bare_distance.contains("reading 0"), "{name}");
        assert_eq!(rest, ["mask factor", "volume texel", "density"], "{name}");
        for (point, row) in points.chunks_exact(3).zip(expected.chunks_exact(5)) {
            let place = [point[0], point[1], point[2]];
            let found = cloud.at(place);
            let bare = never_uploaded.at(place).distance;
            // A texel is an f32, the byte's quotient below 1 rounded once; the rest is f64. Two of them move the distance, twice their strength,
            // the smooth step by a slope of at most 1.5 over the softness, the density by its factors.
            let texel = 0.5_f64.powi(25);
            let Parameters { mask: Mask { softness, deformations, .. }, density_multiplier, .. } = cloud.parameters();
            let distance = 2.0 * texel * deformations.iter().map(|deformation| deformation.strength.abs()).sum::<f64>();
            let mask = 1.5 / softness * distance;
            let bounds = [distance, 0.0, mask, texel, density_multiplier * (texel + mask)];
            let values = [found.distance, bare, found.mask, found.texel, found.density];
            for ((ours, bound), expected) in values.iter().zip(bounds).zip(row) {
                let error = (ours - expected).abs();
                let limit = bound + ROUNDING * expected.abs().max(1.0);
                assert!(error <= limit, "{name} at {place:?}: {ours}, not {expected}: {error:e} of {limit:e}");
            }
        }
    }
}

/// The jitter of a picture, as the manifest names it.
enum Jitter {
    Constant(f64),
    Table,
}

impl Jitter {
    fn read(value: &Value) -> Self {
        let words = value.as_str().unwrap_or_else(|| panic!("no words for the jitter: {value}"));
        match words.strip_prefix("const ") {
            Some(number) => Self::Constant(number.parse().unwrap_or_else(|cause| panic!("jitter {words}: {cause}"))),
            None if words == "table" => Self::Table,
            None => panic!("jitter \"{words}\""),
        }
    }

    fn at(&self, column: usize, row: usize) -> f64 {
        match self {
            Self::Constant(value) => *value,
            Self::Table => EngineJitter::Table.value([column, row], 0),
        }
    }
}

/// Depth values 0 to 1 by columns of a picture, as the manifest's words say: "all 1.0 (nothing in front)", or clauses such as "columns
/// 16..31: depth value of a plane at view distance 60", whose last column is part of them.
fn read_depths(config: &Value) -> Vec<(RangeInclusive<usize>, f64)> {
    let words = config["depth"].as_str().unwrap_or_else(|| panic!("no words for the depth: {}", config["depth"]));
    let [near, far] = ["near", "far"].map(|name| number(config, name));
    let clause = |text: &str| -> Option<(RangeInclusive<usize>, f64)> {
        let text = text.trim();
        if let Some(value) = text.strip_prefix("all ") {
            return Some((0..=usize::MAX, value.split_whitespace().next()?.parse().ok()?));
        }
        let (range, what) = text.strip_prefix("columns ")?.split_once(':')?;
        let (first, last) = range.split_once("..")?;
        let depth = match what.trim().strip_prefix("depth value of a plane at view distance ") {
            // The inverse of near far / (far + d (near - far)).
            Some(distance) => far / (far - near) * (1.0 - near / distance.trim().parse::<f64>().ok()?),
            None => what.trim().parse().ok()?,
        };
        Some((first.trim().parse().ok()?..=last.trim().parse().ok()?, depth))
    };
    let depths =
        words.split(';').map(|text| clause(text).unwrap_or_else(|| panic!("what depth is \"{text}\"?"))).collect();
    if let Some(expected) = config["depth_value_of_plane"].as_f64() {
        let found: &Vec<(RangeInclusive<usize>, f64)> = &depths;
        let is_there = found.iter().any(|(_, depth)| (depth - expected).abs() <= ROUNDING);
        assert!(is_there, "no depth of {expected} in \"{words}\"");
    }
    depths
}

#[test]
fn depths_are_those_of_the_words() {
    let depths = |words: &str| read_depths(&json!({"depth": words, "near": 0.5, "far": 100.0}));
    assert_eq!(depths("all 1.0 (nothing in front)"), [(0..=usize::MAX, 1.0)]);
    let found = depths("columns 3..9: depth value of a plane at view distance 40; columns 0..2: 0.25");
    assert_eq!(found.iter().map(|(columns, _)| columns.clone()).collect::<Vec<_>>(), [3..=9, 0..=2]);
    assert!((0.5 * 100.0 / (100.0 + found[0].1 * (0.5 - 100.0)) - 40.0).abs() < 1e-12 && found[1].1 == 0.25);
    for words in ["half 1.0", "columns 3: 1.0", "columns 0..4: far away"] {
        assert!(std::panic::catch_unwind(|| depths(words)).is_err(), "{words}");
    }
}

#[test]
fn the_table_of_jitter_is_the_manifests() {
    let Some(golden) = Golden::open() else { return };
    let [height, width] = sides(&golden.manifest["files"]["jitter_16x16.u8"]);
    assert_eq!([height, width], [jitter_table::SIDE; 2]);
    for (index, byte) in golden.bytes("jitter_16x16.u8").into_iter().enumerate() {
        let found = EngineJitter::Table.value([index % width, index / width + 3 * height], 0);
        assert_eq!(found, f64::from(byte) / 255.0, "fragment {index}");
    }
}

/// A picture of the manifest: how it is marched, and its rays.
struct Picture {
    light: LightModel,
    settings: RealTimeSettings,
    rays: Vec<RealTimeRay>,
    width: usize,
}

impl Picture {
    fn of(entry: &Value) -> Self {
        let config = &entry["config"];
        let [height, width] = sides(entry);
        let [origin, target] = ["pos", "target"].map(|name| DVec3::from(triple(&config[name])));
        let forward = (target - origin).normalize();
        let right = forward.cross(DVec3::Y).normalize();
        let up = right.cross(forward);
        let half = (number(config, "fovDeg").to_radians() / 2.0).tan();
        let scale = number(config, "scale");
        let [near, far] = ["near", "far"].map(|name| number(config, name));
        let jitter = Jitter::read(&config["jitter"]);
        let depths = read_depths(config);
        let rays = (0..width * height)
            .map(|index| {
                let (column, row) = (index % width, index / width);
                let across = (2.0 * (column as f64 + 0.5) / width as f64 - 1.0) * width as f64 / height as f64;
                let along = 1.0 - 2.0 * (row as f64 + 0.5) / height as f64;
                let direction = (forward + half * (across * right + along * up)).normalize();
                let depth = depths.iter().find(|(columns, _)| columns.contains(&column)).map(|(_, depth)| *depth);
                let depth = depth.unwrap_or_else(|| panic!("no depth for column {column} in {}", config["depth"]));
                let view_distance = near * far / (far + depth * (near - far));
                // Fragments are counted from the bottom.
                let jitter = jitter.at(column, height - 1 - row);
                local_box().ray(origin / scale, direction, view_distance / direction.dot(forward) / scale, jitter)
            })
            .collect();
        let mut values = Values::defaults(settings::PARAMETERS);
        for (name, theirs) in [("march_steps", "steps"), ("light_steps", "lightSteps")] {
            values.set(settings::PARAMETERS, name, number(config, theirs), "manifest").expect("steps in range");
        }
        let scaled =
            |colour: &str, intensity: &str| triple(&config[colour]).map(|part| part * number(config, intensity));
        let light = LightModel {
            suns: vec![Sun { direction: triple(&config["lightDir"]), irradiance: scaled("sunColor", "sunIntensity") }],
            ambient: scaled("ambColor", "ambIntensity"),
            ..settings::light(&values, &Defects::ALL)
        };
        let settings = settings::march(&values, &Defects::ALL);
        Self { light, settings, rays, width }
    }
}

#[test]
fn pictures_are_the_engines() {
    let Some(golden) = Golden::open() else { return };
    for (name, entry) in golden.files("image_", ".f64") {
        let config = &entry["config"];
        let size = number(config, "size") as usize;
        let cloud = Boxed::new(cloud(config, bake(&config["bake"]), size, "mult"), number(config, "opacity"));
        let picture = Picture::of(entry);
        let pixels = cloud.marched(&picture.light).march(&picture.settings, &picture.rays).expect("marched");
        let expected = golden.doubles(name);
        check_columns(name, entry);
        let mut largest = 0.0_f64;
        for (index, (pixel, row)) in pixels.iter().zip(expected.chunks_exact(9)).enumerate() {
            let [red, green, blue] = pixel.radiance;
            let [through_red, through_green, through_blue] = pixel.transmittance;
            let ours = [red, green, blue, 1.0 - through_red, through_red, through_green, through_blue];
            for (found, expected) in ours.iter().zip(row) {
                let place = [index % picture.width, index / picture.width];
                // The march is f64, but the density is f32: the limit is that of single precision.
                let error = (found - expected).abs();
                assert!(error <= PICTURE, "{name} at {place:?}: {found}, not {expected}");
                largest = largest.max(error);
            }
            // With a jitter of 1 the last sample lies on the box's far face, and rounding decides whether it counts.
            let slack = f64::from(u8::from(picture.rays[index].jitter == 1.0));
            for (found, expected) in [pixel.samples, pixel.dense].into_iter().zip([row[7], row[8]]) {
                assert!((f64::from(found) - expected).abs() <= slack, "{name}: pixel {index}: {found}, not {expected}");
            }
        }
        eprintln!("{name} on the CPU: largest error {largest:.2e}");
    }
}

/// What the columns of a picture hold.
fn check_columns(name: &str, entry: &Value) {
    let columns = columns(entry);
    let expected = ["r", "g", "b", "alpha", "transmittance r", "transmittance g", "transmittance b"];
    assert_eq!(columns[..7], expected, "{name}");
    let counts = ["passed both break tests", "with density > 0.01"];
    assert!(
        columns.len() == 9 && columns[7..].iter().zip(counts).all(|(column, words)| column.contains(words)),
        "{name}"
    );
}

/// Largest error of a picture in single precision with textures filtered in full: the limit of the reference data. What f32 may be off by at
/// worst is more: a place is rounded to 2^-26 of the box along each axis, with which the value between 128 texels changes by up to 6e-6, with the
/// extinction of 200 a depth by up to 1e-3.
const PICTURE: f64 = 1e-4;

#[test]
fn pictures_on_the_adapter_are_the_engines() {
    let Some(golden) = Golden::open() else { return };
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("the adapter that was just there");
    for (name, entry) in golden.files("image_", ".f64") {
        let config = &entry["config"];
        let size = number(config, "size") as usize;
        let cloud = Boxed::new(cloud(config, bake(&config["bake"]), size, "mult"), number(config, "opacity"));
        let picture = Picture::of(entry);
        let marched = cloud.marched(&picture.light);
        let kernel = MarchKernel::new(&gpu, &marched, &picture.settings).expect("a kernel");
        let pixels = kernel.march(&picture.rays).expect("pixels");
        let mut largest = 0.0_f64;
        for (pixel, row) in pixels.iter().zip(golden.doubles(name).chunks_exact(9)) {
            let alpha = 1.0 - pixel.transmittance[0];
            let ours = pixel.radiance.iter().chain([&alpha]).chain(&pixel.transmittance);
            largest = ours.zip(row).map(|(found, expected)| (found - expected).abs()).fold(largest, f64::max);
        }
        eprintln!("{name}: largest error {largest:.2e}");
        assert!(largest <= PICTURE, "{name}: error {largest:e}");
    }
}

#[test]
fn god_rays_are_the_engines() {
    let Some(golden) = Golden::open() else { return };
    let gpu = support::require("vulkan").then(|| Gpu::open().expect("the adapter that was just there"));
    for (name, entry) in golden.files("godrays_output", ".f64") {
        let input = &golden.manifest["files"]["godrays_input.f32"];
        let [height, width] = sides(input);
        let singles: Vec<f32> = bytemuck::pod_collect_to_vec(&golden.bytes("godrays_input.f32"));
        // The blur has one channel: the picture of what hides the sun is grey.
        let grey: Vec<f32> = singles.chunks_exact(4).map(|pixel| pixel[0]).collect();
        assert!(singles.chunks_exact(4).all(|pixel| pixel[..3] == [pixel[0]; 3]), "{name}");
        let device: [f64; 2] = std::array::from_fn(|axis| entry["light_ndc"][axis].as_f64().expect("a number"));
        let rays = GodRays {
            density: number(entry, "density"),
            decay: number(entry, "decay"),
            weight: number(entry, "weight"),
            exposure: number(entry, "exposure"),
            samples: number(entry, "samples") as u32,
            ..GodRays::default()
        };
        let layer = Layer { width, height, pixels: grey.iter().map(|&value| f64::from(value)).collect() };
        let output = rays.render(&layer, texel_of(device, [width, height]));
        let colour = triple(&entry["sun_colour"]);
        assert_eq!(columns(entry), ["r", "g", "b"]);
        let expected = golden.doubles(name);
        for (found, expected) in output.pixels.iter().zip(expected.chunks_exact(3)) {
            for (expected, colour) in expected.iter().zip(colour) {
                // A hundred reads, summed.
                let found = colour * found;
                assert!((found - expected).abs() <= 100.0 * ROUNDING, "{name}: {found}, not {expected}");
            }
        }
        let Some(gpu) = &gpu else { continue };
        let pass = GodRayPass { rays, compositing: Compositing::default() };
        let kernel = GodRayKernel::new(gpu, pass).expect("a kernel");
        let occlusion = gpu.upload("occlusion", bytemuck::cast_slice(&grey), wgpu::BufferUsages::STORAGE);
        let blurred = kernel.blur(&occlusion, [width, height], device).expect("submitted");
        let bytes = gpu.read_back(&blurred, (4 * width * height) as u64).expect("numbers");
        let limit = blur_error(&rays, [width, height], 0.0);
        for (&found, expected) in bytemuck::pod_collect_to_vec::<u8, f32>(&bytes).iter().zip(output.pixels) {
            let error = (f64::from(found) - expected).abs();
            assert!(error <= limit, "{name} on the adapter: {error:e} of {limit:e}");
        }
    }
}
