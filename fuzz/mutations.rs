//! Mutations that keep a document a document: values, keys and parts of JSON and TOML are changed, so that inputs come past the parser.

use cloudparity::engines::{self, light::models};
use cloudparity::nodes::{self, PropertyValues};
use fastrand::Rng;
use serde_json::{Map, Number, Value as Json};
use std::sync::LazyLock;

/// How a document is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Text {
    /// JSON.
    Json,
    /// TOML.
    Toml,
}

/// Names that the library knows: of node types, sockets, modes, models and parameters.
static WORDS: LazyLock<Vec<String>> = LazyLock::new(|| {
    let mut words: Vec<&str> = vec![
        "NodeFrame",
        "NodeGroupInput",
        "NodeGroupOutput",
        "NodeReroute",
        "ShaderNodeGroup",
        "ShaderNodeOutputMaterial",
        "CYCLES",
        "",
        "../scenes/linear-ramp.scene.json",
        "density.cache_cells",
        "scene.Density",
        "all",
        "none",
        "nan",
        "inf",
        "a/b.c",
        "é\u{0}\n\u{202e}😀",
    ];
    for node_type in nodes::registry() {
        words.push(node_type.type_name);
        words.extend(node_type.inputs.iter().map(|socket| socket.identifier));
        words.extend(node_type.outputs.iter().map(|socket| socket.identifier));
        for property in node_type.properties {
            words.push(property.identifier);
            if let PropertyValues::Choice(names) = &property.values {
                words.extend(*names);
            }
        }
    }
    for model in engines::models() {
        words.push(model.id);
        words.extend(model.parameters.iter().map(|parameter| parameter.name));
        words.extend(model.defects.iter().map(|defect| defect.id));
    }
    words.extend(models::PARAMETERS.iter().map(|parameter| parameter.name));
    words.extend(models::LIGHTS.iter().map(|light| light.id));
    words.sort_unstable();
    words.dedup();
    words.into_iter().map(str::to_owned).collect()
});

/// Numbers at which arithmetic turns over.
const NUMBERS: [f64; 34] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    2.0,
    3.0,
    7.0,
    8.0,
    10.0,
    64.0,
    100.0,
    255.0,
    256.0,
    1024.0,
    16384.0,
    65535.0,
    100_000.0,
    1_000_000.0,
    2_147_483_647.0,
    -2_147_483_648.0,
    4_294_967_295.0,
    9_007_199_254_740_993.0,
    1.8446744073709552e19,
    -9.3e18,
    1e-3,
    1e-7,
    1.1754944e-38,
    1e-45,
    1e-300,
    3.4028235e38,
    -3.4028235e38,
    3.5e38,
    1e308,
];

fn parse(text: Text, bytes: &[u8]) -> Option<Json> {
    match text {
        Text::Json => serde_json::from_slice(bytes).ok(),
        Text::Toml => {
            let table: toml::Table = toml::from_str(std::str::from_utf8(bytes).ok()?).ok()?;
            serde_json::to_value(table).ok()
        }
    }
}

fn written(text: Text, document: &Json) -> Option<Vec<u8>> {
    match text {
        Text::Json => serde_json::to_vec(document).ok(),
        Text::Toml => toml::to_string(document).ok().map(String::into_bytes),
    }
}

/// A few mutations of a document; none where the bytes hold no document.
pub fn mutated(text: Text, bytes: &[u8], random: &mut Rng) -> Option<Vec<u8>> {
    let mut document = parse(text, bytes)?;
    let before = document.clone();
    for _ in 0..=random.u32(0..3) {
        let (number, words) = (random.usize(..count(&document)), strings(&before));
        let donor = pick(&before, random.usize(..count(&before))).clone();
        change(nth(&mut document, number), &donor, &words, random);
    }
    written(text, &document)
}

/// A document with a part of another in it.
pub fn crossed(text: Text, one: &[u8], other: &[u8], random: &mut Rng) -> Option<Vec<u8>> {
    let (mut document, other) = (parse(text, one)?, parse(text, other)?);
    let donor = pick(&other, random.usize(..count(&other))).clone();
    let number = random.usize(..count(&document));
    let place = nth(&mut document, number);
    match (place, donor) {
        (Json::Array(items), Json::Array(more)) => items.extend(more),
        (Json::Object(fields), Json::Object(more)) => fields.extend(more),
        (Json::Array(items), donor) => items.push(donor),
        (place, donor) => *place = donor,
    }
    written(text, &document)
}

/// Values in a document, itself included.
fn count(value: &Json) -> usize {
    1 + match value {
        Json::Array(items) => items.iter().map(count).sum(),
        Json::Object(fields) => fields.values().map(count).sum(),
        _ => 0,
    }
}

/// The value of a number below [`count`].
fn nth(value: &mut Json, number: usize) -> &mut Json {
    if number == 0 {
        return value;
    }
    let mut left = number - 1;
    let children: Vec<&mut Json> = match value {
        Json::Array(items) => items.iter_mut().collect(),
        Json::Object(fields) => fields.values_mut().collect(),
        _ => unreachable!("the number is below the count"),
    };
    for child in children {
        let inside = count(child);
        if left < inside {
            return nth(child, left);
        }
        left -= inside;
    }
    unreachable!("the number is below the count")
}

fn pick(value: &Json, number: usize) -> &Json {
    if number == 0 {
        return value;
    }
    let mut left = number - 1;
    let children: Vec<&Json> = match value {
        Json::Array(items) => items.iter().collect(),
        Json::Object(fields) => fields.values().collect(),
        _ => unreachable!("the number is below the count"),
    };
    for child in children {
        let inside = count(child);
        if left < inside {
            return pick(child, left);
        }
        left -= inside;
    }
    unreachable!("the number is below the count")
}

/// All texts and keys of a document.
fn strings(value: &Json) -> Vec<String> {
    match value {
        Json::String(text) => vec![text.clone()],
        Json::Array(items) => items.iter().flat_map(strings).collect(),
        Json::Object(fields) => {
            fields.iter().flat_map(|(key, item)| [vec![key.clone()], strings(item)].concat()).collect()
        }
        _ => Vec::new(),
    }
}

/// A text of the document, or one that the library knows.
fn word(words: &[String], random: &mut Rng) -> String {
    let known = if random.bool() && !words.is_empty() { words } else { WORDS.as_slice() };
    known[random.usize(..known.len())].clone()
}

fn number(random: &mut Rng) -> Json {
    let value = NUMBERS[random.usize(..NUMBERS.len())];
    let exact = value.fract() == 0.0 && value.abs() < 9e18 && random.bool();
    if exact { Json::from(value as i64) } else { Number::from_f64(value).map_or(Json::Null, Json::Number) }
}

fn change(value: &mut Json, donor: &Json, words: &[String], random: &mut Rng) {
    match random.u8(0..16) {
        // Of any kind: another part of the document, or a value of another type.
        0 => *value = donor.clone(),
        1 => {
            *value = match random.u8(0..6) {
                0 => Json::Null,
                1 => Json::Bool(random.bool()),
                2 => number(random),
                3 => Json::String(word(words, random)),
                4 => Json::Array(Vec::new()),
                _ => Json::Object(Map::new()),
            }
        }
        _ => change_within(value, donor, words, random),
    }
}

fn change_within(value: &mut Json, donor: &Json, words: &[String], random: &mut Rng) {
    match value {
        Json::Null => *value = donor.clone(),
        Json::Bool(flag) => *flag = !*flag,
        Json::Number(found) => {
            let old = found.as_f64().unwrap_or(0.0);
            let was_whole = found.is_i64() || found.is_u64();
            let new = match random.u8(0..8) {
                0 => -old,
                1 => old * 2.0,
                2 => old / 2.0,
                3 => old + 1.0,
                4 => old - 1.0,
                5 => old * (random.f64() * 4.0 - 2.0),
                _ => {
                    *value = number(random);
                    return;
                }
            };
            *value = if was_whole && new.abs() < 9e18 {
                Json::from(new as i64)
            } else {
                Number::from_f64(new).map_or(Json::Null, Json::Number)
            };
        }
        Json::String(text) => match random.u8(0..8) {
            0 => text.push_str(&word(words, random)),
            1 => text.clear(),
            2 => {
                text.pop();
            }
            3 => *text = format!("{text} {}={}", word(words, random), NUMBERS[random.usize(..NUMBERS.len())]),
            _ => *text = word(words, random),
        },
        Json::Array(items) => match random.u8(0..8) {
            0 if !items.is_empty() => {
                items.remove(random.usize(..items.len()));
            }
            1 if items.len() > 1 => {
                let [a, b] = [random.usize(..items.len()), random.usize(..items.len())];
                items.swap(a, b);
            }
            2 => items.clear(),
            3 | 4 if !items.is_empty() => {
                let copy = items[random.usize(..items.len())].clone();
                for _ in 0..[1, 1, 2, 4, 16][random.usize(..5)] {
                    items.push(copy.clone());
                }
            }
            5 => items.push(number(random)),
            _ => items.insert(random.usize(..=items.len()), donor.clone()),
        },
        Json::Object(fields) => {
            let key = |random: &mut Rng, fields: &Map<String, Json>| -> Option<String> {
                let at = random.usize(..fields.len().max(1));
                fields.keys().nth(at).cloned()
            };
            match random.u8(0..8) {
                0 => {
                    if let Some(key) = key(random, fields) {
                        fields.shift_remove(&key);
                    }
                }
                1 => {
                    if let Some(value) = key(random, fields).and_then(|key| fields.shift_remove(&key)) {
                        fields.insert(word(words, random), value);
                    }
                }
                2 => {
                    fields.insert(word(words, random), number(random));
                }
                3 => {
                    let [node, socket] = [word(words, random), word(words, random)];
                    fields.insert(word(words, random), serde_json::json!({"node": node, "socket": socket}));
                }
                4 => {
                    if let Some(key) = key(random, fields) {
                        fields.insert(key, donor.clone());
                    }
                }
                5 => {
                    fields.insert(word(words, random), Json::String(word(words, random)));
                }
                _ => {
                    fields.insert(word(words, random), donor.clone());
                }
            }
        }
    }
}
