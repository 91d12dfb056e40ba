//! Parameters of a density that a bundle's host changes while it runs.
//!
//! The constants of a program follow from parameters: of a graph through nodes that are folded, of a system through its own arithmetic. Where
//! they do so affinely, a shader can have the parameters in a uniform and compute its constants from them. Which these are is found by asking:
//! the engine is put together for several values of each parameter, and where nothing but numbers of its program changes, in proportion, also
//! when others change at once, the parameter is one of the bundle's. Others (octaves, what is baked into textures) are constants of its text.

use super::manifest::{Field, Tunable};
use crate::base::error::{Error, Result};
use crate::base::texture::TextureHandle;
use crate::engines::march::gpu::Form;
use crate::engines::render::EngineRenderer;
use crate::engines::{self, Engine};
use crate::graph::Program;
use crate::graph::evaluate::Evaluator;
use crate::graph::wgsl::{self, Computed, Language, ProgramParameters};
use crate::media::density::Density;
use crate::media::region::Region;
use crate::scene::Scene;
use glam::DVec3;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

/// A number of the material or the system that may be one of the bundle's.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Its name, as the engine's builder takes it.
    pub name: String,
    /// What readers call it.
    pub title: String,
    /// What it is.
    pub about: String,
    /// Its value in the bundle's picture.
    pub value: f64,
    /// What makes sense, low and high.
    pub range: [f64; 2],
}

impl Candidate {
    /// Numbers of the material, where the system is its own (`scene.NAME`), and of the system (`density.NAME`), as presets name them.
    pub fn all(scene: &Scene, engine: &Engine) -> Result<Vec<Self>> {
        let model = engines::find(engine.model)?;
        let mut found = Vec::new();
        for one in scene.settable().into_iter().filter(|_| model.is_of_scene) {
            let Some(value) = one.value.as_f64() else { continue };
            let around = value.abs().max(1.0);
            // Blender's limits are often far from what is used.
            let end = |limit: Option<f32>, usual: f64| {
                limit.map(f64::from).filter(|limit| (limit - value).abs() <= 20.0 * around).unwrap_or(usual)
            };
            let range = [end(one.limits[0], value - around), end(one.limits[1], value + around)];
            let name = format!("scene.{}", one.exact_name);
            found.push(Self { name, title: one.name, about: one.about.unwrap_or_default(), value, range });
        }
        for one in model.parameters {
            let Some(value) = engine.values.given(one.name) else { continue };
            let [low, high] = one.usual;
            let range = [low.min(value), high.max(value)];
            let about = if one.unit.is_empty() { one.about.into() } else { format!("{} ({})", one.about, one.unit) };
            found.push(Self { name: format!("density.{}", one.name), title: one.name.into(), about, value, range });
        }
        found.retain(|one| one.range[0] < one.range[1]);
        Ok(found)
    }
}

/// What a bundle needs for its parameters.
pub struct RunTime {
    /// The parameters, in the order of the uniform's fields.
    pub tunables: Vec<Tunable>,
    pub(super) parameters: ProgramParameters,
    /// The density at values at which no constant is one that leaves something out.
    program: Arc<Program>,
}

/// Puts the engine together with other values for parameters, by their names.
pub type Builder<'a> = &'a dyn Fn(&[(&str, f64)]) -> Result<(Scene, Engine)>;

/// Roundings of f32 between the parameters and a constant, at most: folded nodes and the system's arithmetic.
const ROUNDINGS: f64 = 64.0;

/// Rounds after which a search gives up, each without the parameters that failed in the one before.
const ROUNDS: usize = 8;

impl RunTime {
    /// Finds the parameters; none where there are none. `bounds` is the box of the density in its frame. `progress` hears the part that is done; an
    /// engine that bakes textures takes its time.
    pub fn find(
        candidates: &[Candidate],
        bounds: Region,
        build: Builder<'_>,
        progress: &dyn Fn(f64),
    ) -> Result<Option<Self>> {
        let mut search = Search { candidates, build, known: HashMap::new() };
        // What a march on an adapter has not is said by what is written next.
        let Ok((own, program)) = search.probed(&[]) else { return Ok(None) };
        if own.numbers.is_empty() {
            return Ok(None);
        }
        let reference = Reference::new(&program, bounds)?;
        let mut left = Vec::new();
        for number in 0..candidates.len() {
            progress(number as f64 / candidates.len() as f64);
            let value = search.at(number, GENERIC);
            let probe = search.probe(&[(number, value)]);
            let is_of_program =
                probe.is_ok_and(|probe| probe.rest == own.rest && probe.textures == own.textures && *probe != *own);
            // Alone, so that one that means something else at its own value, such as a radius of 0, is not blamed on others.
            if is_of_program
                && let Found::Affine(values, constants) = search.affine(&[number])?
                && search.is_met(&[number], &values, &constants, &reference)?
            {
                left.push(number);
            }
        }
        for _ in 0..ROUNDS {
            if left.is_empty() {
                return Ok(None);
            }
            match search.affine(&left)? {
                Found::Without(wrong) => left.retain(|number| !wrong.contains(number)),
                Found::Affine(values, constants) => {
                    let is_met = search.is_met(&left, &values, &constants, &reference)?;
                    return Ok(is_met.then(|| search.run_time(&left, &values, constants)));
                }
            }
        }
        Ok(None)
    }

    /// The density alone as a standalone shader with an entry point that computes it at points, in a language. In a text, what each parameter is
    /// stands first.
    pub fn shader(&self, language: Language) -> Result<Vec<u8>> {
        let shader = wgsl::standalone_with_parameters(&self.program, &self.parameters, language)?;
        if language == Language::Spirv {
            return Ok(shader);
        }
        let mut head = String::from("// Parameters of the density, in the order of their struct:\n");
        for Tunable { field, title, about, value, range: [low, high], .. } in &self.tunables {
            let about =
                if about.is_empty() { String::new() } else { format!(": {}", about.replace(['\n', '\r'], " ")) };
            head += &format!("// {field} = {value} ({low} to {high}): {}{about}\n", title.replace(['\n', '\r'], " "));
        }
        // A version has to come first in GLSL.
        let text = String::from_utf8_lossy(&shader);
        Ok(match text.split_once('\n').filter(|(first, _)| first.starts_with("#version")) {
            Some((version, rest)) => format!("{version}\n{head}{rest}"),
            None => head + &text,
        }
        .into_bytes())
    }

    /// The engine with the program whose constants are computed.
    pub(super) fn engine(&self, engine: &Engine) -> Engine {
        engine.with_density(engine.density.with_program(Arc::clone(&self.program)))
    }

    /// The uniform's fields with the values of the bundle's picture.
    pub(super) fn fields(&self) -> Vec<Field> {
        let of = |(place, tunable): (usize, &Tunable)| Field {
            name: tunable.field.clone(),
            offset: 4 * place as u32,
            kind: "f32".into(),
            values: vec![tunable.value],
        };
        self.tunables.iter().enumerate().map(of).collect()
    }

    /// The uniform's content.
    pub(super) fn bytes(&self) -> Vec<u8> {
        let mut bytes: Vec<u8> =
            self.tunables.iter().flat_map(|tunable| (tunable.value as f32).to_le_bytes()).collect();
        bytes.resize(self.parameters.bytes(), 0);
        bytes
    }
}

/// Where in the ranges parameters are first put, and next: apart from each other, as nodes that are equal become one.
const GENERIC: f64 = 0.3;
const SECOND: f64 = 0.84;
const SPREAD: f64 = 0.12;

/// A program at some values, and itself.
type Probed = (Arc<Probe>, Arc<Program>);

/// What a program is at some values.
#[derive(PartialEq)]
struct Probe {
    text: Vec<u8>,
    numbers: Vec<f32>,
    /// What else the march is given.
    rest: Vec<u8>,
    textures: Vec<TextureHandle>,
}

struct Search<'a> {
    candidates: &'a [Candidate],
    build: Builder<'a>,
    /// By the values that were asked for; none where they were refused.
    known: HashMap<Vec<(usize, u64)>, Option<Probed>>,
}

/// The density of the bundle's picture at places, by its own program.
struct Reference {
    places: Vec<[f32; 3]>,
    values: Vec<f32>,
}

/// Places of a reference.
const PLACES: usize = 4096;

/// Part of the largest density by which a value may be off, and of the places at which more is: where a density has a step, a rounding moves it.
const OFF: f32 = 1e-3;
const AT_STEPS: f64 = 0.01;

impl Reference {
    fn new(program: &Program, bounds: Region) -> Result<Self> {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let places: Vec<[f32; 3]> = (0..PLACES)
            .map(|_| {
                let part = DVec3::new(random.random(), random.random(), random.random());
                (bounds.low + part * (bounds.high - bounds.low)).as_vec3().to_array()
            })
            .collect();
        let values = Evaluator::new(program)?.evaluate(&places).to_vec();
        Ok(Self { places, values })
    }

    /// Whether a program computes the same.
    fn is_of(&self, program: &Program) -> Result<bool> {
        let largest = self.values.iter().fold(0.0_f32, |most, value| most.max(value.abs()));
        let mut evaluator = Evaluator::new(program)?;
        let found = evaluator.evaluate(&self.places);
        let is_off =
            |(found, own): &(&f32, &f32)| (*found - *own).abs() > OFF * largest || found.is_nan() != own.is_nan();
        let off = found.iter().zip(&self.values).filter(is_off).count();
        Ok(off as f64 <= AT_STEPS * PLACES as f64)
    }
}

enum Found {
    /// The generic values, and what constants of the program there are computed from.
    Affine(Vec<f64>, Vec<Option<Computed>>),
    /// Without these.
    Without(BTreeSet<usize>),
}

impl Search<'_> {
    /// A part of a parameter's range, a little different for each.
    fn at(&self, number: usize, part: f64) -> f64 {
        let [low, high] = self.candidates[number].range;
        // The fractional parts of multiples of the golden section are far from each other.
        let own = (0.618_033_988_749_895 * (number + 1) as f64).fract();
        f64::from((low + (high - low) * (part + SPREAD * own)) as f32)
    }

    fn probe(&mut self, values: &[(usize, f64)]) -> Result<Arc<Probe>> {
        self.probed(values).map(|(probe, _)| probe)
    }

    fn probed(&mut self, values: &[(usize, f64)]) -> Result<Probed> {
        let key: Vec<(usize, u64)> = values.iter().map(|(number, value)| (*number, value.to_bits())).collect();
        let found = match self.known.get(&key) {
            Some(known) => known.clone(),
            None => {
                let named: Vec<(&str, f64)> =
                    values.iter().map(|(number, value)| (self.candidates[*number].name.as_str(), *value)).collect();
                // A value that is refused is no defect: the parameter has a smaller range than it says.
                let found = (self.build)(&named).and_then(|(scene, engine)| of_engine(&scene, &engine)).ok();
                self.known.insert(key, found.clone());
                found
            }
        };
        found.ok_or_else(|| {
            Error::new("a parameter", "a value that is refused", "one that is taken", "Nothing has to be done.")
        })
    }

    /// Tries these parameters together.
    fn affine(&mut self, left: &[usize]) -> Result<Found> {
        let all = |search: &Self, part: f64| -> Vec<(usize, f64)> {
            left.iter().map(|&number| (number, search.at(number, part))).collect()
        };
        let generic = all(self, GENERIC);
        let Ok(base) = self.probe(&generic) else { return Ok(Found::Without(left.iter().copied().collect())) };
        let mut wrong = BTreeSet::new();
        // Of each parameter what each number grows by.
        let mut slopes: Vec<Vec<f64>> = Vec::new();
        for (place, &number) in left.iter().enumerate() {
            let mut values = generic.clone();
            values[place].1 = self.at(number, SECOND);
            let step = values[place].1 - generic[place].1;
            match self.probe(&values) {
                Ok(probe) if probe.is_like(&base) => slopes.push(
                    probe
                        .numbers
                        .iter()
                        .zip(&base.numbers)
                        .map(|(&now, &before)| (f64::from(now) - f64::from(before)) / step)
                        .collect(),
                ),
                _ => {
                    wrong.insert(number);
                    slopes.push(vec![0.0; base.numbers.len()]);
                }
            }
        }
        if !wrong.is_empty() {
            return Ok(Found::Without(wrong));
        }
        // One after the other joins those that were moved before, each to another part of its range: a product of two shows.
        let mut values = generic.clone();
        for (place, &number) in left.iter().enumerate() {
            let before = values[place].1;
            values[place].1 = self.at(number, 0.02 + 0.8 * (0.754_877_666_246_693 * (place + 1) as f64).fract());
            let is_so = self.probe(&values).is_ok_and(|probe| {
                probe.is_like(&base)
                    && (0..base.numbers.len()).all(|constant| {
                        let (mut expected, mut size) =
                            (f64::from(base.numbers[constant]), f64::from(base.numbers[constant]).abs());
                        for (slopes, (now, then)) in slopes.iter().zip(values.iter().zip(&generic)) {
                            expected += slopes[constant] * (now.1 - then.1);
                            size += (slopes[constant] * now.1).abs().max((slopes[constant] * then.1).abs());
                        }
                        let off = (f64::from(probe.numbers[constant]) - expected).abs();
                        off <= ROUNDINGS * f64::from(f32::EPSILON) * size
                    })
            });
            if !is_so {
                wrong.insert(number);
                values[place].1 = before;
            }
        }
        if !wrong.is_empty() {
            return Ok(Found::Without(wrong));
        }
        let constants = (0..base.numbers.len())
            .map(|constant| {
                let parts: Vec<(usize, f64)> = (0..left.len())
                    .map(|place| (place, slopes[place][constant]))
                    .filter(|(_, slope)| *slope != 0.0)
                    .collect();
                if parts.is_empty() {
                    return None;
                }
                let at_zero = parts
                    .iter()
                    .fold(f64::from(base.numbers[constant]), |sum, (place, slope)| sum - slope * generic[*place].1);
                Some(Computed { at_zero, slopes: parts })
            })
            .collect();
        Ok(Found::Affine(generic.into_iter().map(|(_, value)| value).collect(), constants))
    }

    /// Whether the program whose constants are computed is the bundle's own at its own values.
    fn is_met(
        &mut self,
        left: &[usize],
        generic: &[f64],
        constants: &[Option<Computed>],
        reference: &Reference,
    ) -> Result<bool> {
        let values: Vec<(usize, f64)> = left.iter().copied().zip(generic.iter().copied()).collect();
        let (probe, program) = self.probed(&values)?;
        let own = |Computed { at_zero, slopes }: &Computed| {
            let sum = slopes.iter().map(|(place, slope)| slope * self.candidates[left[*place]].value).sum::<f64>();
            (at_zero + sum) as f32
        };
        let computed = probe.numbers.iter().zip(constants);
        let numbers: Vec<f32> = computed.map(|(&number, computed)| computed.as_ref().map_or(number, own)).collect();
        reference.is_of(&program.with_constants(&numbers))
    }

    fn run_time(&mut self, left: &[usize], generic: &[f64], constants: Vec<Option<Computed>>) -> RunTime {
        let values: Vec<(usize, f64)> = left.iter().copied().zip(generic.iter().copied()).collect();
        let (_, program) = self.probed(&values).expect("it was asked for before");
        let mut fields: Vec<String> = Vec::new();
        for &number in left {
            let field = field_of(&self.candidates[number].title);
            let is_free = |name: &String| !fields.contains(name);
            let mut names = std::iter::once(field.clone()).chain(('a'..='z').map(|letter| format!("{field}_{letter}")));
            fields.push(names.find(is_free).expect("fewer than 27 of one name"));
        }
        let tunables = left
            .iter()
            .zip(&fields)
            .map(|(&number, field)| {
                let Candidate { name, title, about, value, range } = self.candidates[number].clone();
                Tunable { field: field.clone(), name, title, about, value, range }
            })
            .collect();
        RunTime { tunables, parameters: ProgramParameters { fields, constants }, program }
    }
}

impl Probe {
    /// Whether nothing but numbers differs.
    fn is_like(&self, other: &Self) -> bool {
        self.text == other.text
            && self.rest == other.rest
            && self.textures == other.textures
            && self.numbers.len() == other.numbers.len()
    }
}

fn of_engine(scene: &Scene, engine: &Engine) -> Result<Probed> {
    let program = Arc::clone(engine.density.program());
    // Which cells are empty is no part of the text here.
    let filling = engine.with_density(Density::filling(Arc::clone(&program), engine.density.bounds));
    let parts = EngineRenderer::new(scene, &filling, None)?.march_parts(&Form::KernelWithNumbers)?;
    let mut rest = bytemuck::bytes_of(&parts.uniform).to_vec();
    rest.extend(bytemuck::cast_slice::<_, u8>(&parts.suns));
    rest.extend(bytemuck::cast_slice::<_, u8>(&parts.maps));
    let text = wgsl::write(&parts.module, Language::Wgsl)?;
    Ok((Arc::new(Probe { text, numbers: parts.numbers, rest, textures: parts.textures }), program))
}

/// A name as a field: letters, digits and underscores, no digit last, and no word of a language.
fn field_of(title: &str) -> String {
    let plain: String =
        title.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' }).collect();
    let plain = plain.trim_matches('_').to_owned();
    let plain = if plain.starts_with(|c: char| c.is_ascii_alphabetic()) { plain } else { format!("of_{plain}") };
    let is_word = naga::keywords::wgsl::RESERVED.contains(&plain.as_str());
    // The composer keeps two underscores for itself.
    let plain = plain.split('_').filter(|part| !part.is_empty()).collect::<Vec<_>>().join("_");
    if is_word || plain.ends_with(|c: char| c.is_ascii_digit()) { plain + "_value" } else { plain }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_fields() {
        for (title, field) in [
            ("Large Noise/Factor", "large_noise_factor"),
            ("Octave 2", "octave_2_value"),
            ("active", "active_value"),
            ("  3D  ", "of_3d"),
            ("Dichte (außen)", "dichte_au_en"),
            ("A__b", "a_b"),
        ] {
            assert_eq!(field_of(title), field);
            let text = format!("struct S {{ {field}: f32 }}");
            naga::front::wgsl::parse_str(&text).expect("WGSL takes it");
        }
    }
}
