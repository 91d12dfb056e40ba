//! The published engine's own results, from a directory with a `manifest.json`: `GOLDEN_DIR`, else the shared one where it is there.
//!
//! What the original computes on the CPU in double precision is met to the byte; what it computes on the GPU was
//! evaluated in double precision too, and is met to rounding.

mod support;

use cloudparity::density::perlin_fbm::bake::Bake;
use cloudparity::density::perlin_fbm::mask::{Baked, Deformation, Mask};
use cloudparity::density::perlin_fbm::noise::{Field, Octaves, noise, octaves};
use cloudparity::density::perlin_fbm::random::{Random, permutation};
use cloudparity::density::perlin_fbm::{Cloud, Parameters, Volume};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Double precision in another order of operations: some ten roundings of values up to 50.
const ROUNDING: f64 = 1e-12;

/// Largest errors of single precision for coordinates below 64 and below 1000: one noise, and five octaves of lacunarity 3,
/// whose fractional parts lose bits. Measured for the reference data.
const SINGLE_NOISE: [f64; 2] = [4e-6, 8e-5];
const SINGLE_OCTAVES: [f64; 2] = [3e-5, 5e-4];

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
fn noise_is_exact_in_double_precision_and_within_its_error_in_single() {
    let Some(golden) = Golden::open() else { return };
    let points = golden.doubles("noise_points.f64");
    let values = golden.doubles("noise_values.f64");
    let columns: Vec<&str> = golden.manifest["files"]["noise_values.f64"]["columns"]
        .as_array()
        .expect("columns")
        .iter()
        .map(|column| column.as_str().expect("a name"))
        .collect();
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
        let field = if name.contains("mask noise") { Field::Mask } else { Field::Volume };
        for (point, row) in points.chunks_exact(3).zip(values.chunks_exact(columns.len())) {
            let place = [point[0], point[1], point[2]];
            let (double, single) = match &sum {
                Some(sum) => (octaves(&table, place, sum), octaves(&table, place.map(|x| x as f32), sum)),
                None => (noise(field, &table, place), noise(field, &table, place.map(|x| x as f32))),
            };
            assert_eq!(double, row[column], "{name} at {place:?}");
            let is_far = usize::from(place.iter().any(|coordinate| coordinate.abs() >= 64.0));
            let limit = if sum.is_some() { SINGLE_OCTAVES[is_far] } else { SINGLE_NOISE[is_far] };
            // Rounding to single precision may put an integer's neighbour on the integer: noise is continuous there.
            let error = (f64::from(single) - row[column]).abs();
            assert!(error <= limit, "{name} at {place:?}: error {error:e} in single precision");
        }
    }
}

#[test]
fn bakes_are_the_engines_byte_for_byte() {
    let Some(golden) = Golden::open() else { return };
    for (name, entry) in golden.files("bake_", ".u8") {
        let parameters = bake(&entry["parameters"]);
        let side = entry["shape"][0].as_u64().expect("a size") as usize;
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
        let side = entry["shape"][0].as_u64().expect("a size") as usize;
        let table = permutation(parameters.seed);
        let expected = golden.bytes(name);
        for (index, bytes) in expected.chunks_exact(4).enumerate() {
            let place = [index % side, index / side % side, index / side / side];
            let value = parameters.blend(&table, place.map(|number| number as f64 / (side - 1) as f64));
            assert_eq!(value as f32, f32::from_le_bytes(bytes.try_into().expect("four")), "{name} at {place:?}");
        }
    }
}

#[test]
fn mask_textures_are_the_engines_byte_for_byte() {
    let Some(golden) = Golden::open() else { return };
    let hashes = golden.json("masknoise_hashes.json");
    for (name, entry) in golden.files("masknoise_", "_sub32.u8") {
        let deformation =
            Deformation { seed: number(entry, "seed"), strength: 0.0, frequency: number(entry, "frequency") };
        let Volume { side, texels } = deformation.texture();
        let short = name.trim_start_matches("masknoise_").trim_end_matches("_sub32.u8");
        assert_eq!(hash(&texels), hashes[short]["fnv1a"], "{short}");
        let coarse = side / 4;
        let every_fourth: Vec<u8> = (0..coarse.pow(3))
            .map(|index| {
                let [x, y, z] = [index % coarse, index / coarse % coarse, index / coarse / coarse].map(|n| 4 * n + 1);
                texels[(z * side + y) * side + x]
            })
            .collect();
        same_texels(name, &every_fourth, &golden.bytes(name), true);
    }
}

#[test]
fn mask_and_density_are_the_engines() {
    let Some(golden) = Golden::open() else { return };
    let points = golden.doubles("mask_points.f64");
    for (name, entry) in golden.files("mask_values_", ".f64") {
        let size = number(&entry["volume"], "size") as usize;
        let of = entry["volume"]["bake"].as_str().expect("the name of a bake");
        let parameters = golden
            .files(&format!("bake_{of}_"), ".u8")
            .map(|(_, entry)| bake(&entry["parameters"]))
            .next()
            .unwrap_or_else(|| panic!("no bake {of} in the manifest"));
        let cloud = Cloud::new(Parameters {
            bake: parameters,
            texture_size: size,
            mask: mask(&entry["mask"]),
            tiling: number(entry, "tiling"),
            offset: std::array::from_fn(|axis| entry["offset"][axis].as_f64().expect("a number")),
            threshold: number(entry, "threshold"),
            density_multiplier: number(entry, "density_multiplier"),
        })
        .expect("parameters in range");
        let masked: &Baked = cloud.mask();
        let expected = golden.doubles(name);
        for (point, row) in points.chunks_exact(3).zip(expected.chunks_exact(5)) {
            let place = [point[0], point[1], point[2]];
            let found = cloud.at(place);
            let bare = masked.distance_without_textures(place);
            for (ours, expected) in [found.distance, bare, found.mask, found.texel, found.density].iter().zip(row) {
                let error = (ours - expected).abs();
                assert!(error <= ROUNDING * expected.abs().max(1.0), "{name} at {place:?}: {ours}, not {expected}");
            }
        }
    }
}
