//! Light models by name, and the parameters that all of them share.
//!
//! A named light model is a set of values on top of what a density model brings along: its sun, shadow march and phase function.

use crate::base::error::{Error, Result};
use crate::engines::light::terms::{MOST_OCTAVES, Terms};
use crate::engines::light::{
    LightModel, ShadowExtinction, ShadowLength, ShadowMapSettings, ShadowMarch, ShadowSample, SourceFactor, TwoLobes,
};
use crate::engines::parameters::{Parameter, Range};

/// A light model by name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NamedLight {
    /// Name on the command line and in files.
    pub id: &'static str,
    /// What it is, in a sentence.
    pub about: &'static str,
    /// Parameters that it sets.
    pub settings: &'static [(&'static str, f64)],
}

/// Steps of a shadow map's rays.
const SHADOW_MAP_STEPS: u32 = 50;

const UNIT: Range = Range::Between(0.0, 1.0);
const COSINE: Range = Range::Between(-0.999, 0.999);

/// Parameters of light models. A default is the value that changes nothing, but for the last four, which are the density model's own
/// where they are not set: those of perlin-fbm are shown.
pub const PARAMETERS: &[Parameter] = &[
    Parameter {
        name: "exposure",
        about: "factor on the light of the scene's sun and world that the medium scatters",
        unit: "",
        range: Range::NotNegative,
        default: Terms::NONE.exposure,
        usual: [0.5, 2.0],
    },
    Parameter {
        name: "octaves",
        about: "octaves of multiple scattering; 1 is single scattering",
        unit: "",
        range: Range::Whole(1, MOST_OCTAVES),
        default: Terms::NONE.octaves.count as f64,
        usual: [1.0, 8.0],
    },
    Parameter {
        name: "contribution",
        about: "weight of an octave over that of the one before; below 0 it takes light away",
        unit: "",
        range: Range::Any,
        default: Terms::NONE.octaves.contribution,
        usual: [0.2, 1.0],
    },
    Parameter {
        name: "attenuation",
        about: "optical depth of an octave over that of the one before",
        unit: "",
        range: Range::NotNegative,
        default: Terms::NONE.octaves.attenuation,
        usual: [0.1, 1.0],
    },
    Parameter {
        name: "eccentricity",
        about: "mean cosines of an octave's phase function over those of the one before",
        unit: "",
        range: UNIT,
        default: Terms::NONE.octaves.eccentricity,
        usual: [0.1, 1.0],
    },
    Parameter {
        name: "depth_compression",
        about: "how much great depths towards the sun count less, in all octaves",
        unit: "",
        range: Range::NotNegative,
        default: Terms::NONE.octaves.compression,
        usual: [0.0, 2.0],
    },
    Parameter {
        name: "powder_strength",
        about: "what a part without extinction loses of its light",
        unit: "",
        range: UNIT,
        default: Terms::NONE.powder.strength,
        usual: [0.0, 1.0],
    },
    Parameter {
        name: "powder_length",
        about: "length over which extinction counts for powder",
        unit: "sides of the box",
        range: Range::NotNegative,
        default: Terms::NONE.powder.length,
        usual: [0.0, 1.0],
    },
    Parameter {
        name: "powder_ambient",
        about: "share of powder that ambient light has, too",
        unit: "",
        range: UNIT,
        default: Terms::NONE.powder.ambient,
        usual: [0.0, 1.0],
    },
    Parameter {
        name: "body_strength",
        about: "what surroundings without extinction lose of the sun's light",
        unit: "",
        range: UNIT,
        default: Terms::NONE.body.strength,
        usual: [0.0, 1.0],
    },
    Parameter {
        name: "body_length",
        about: "length over which the extinction around a place counts",
        unit: "sides of the box",
        range: Range::NotNegative,
        default: Terms::NONE.body.length,
        usual: [0.0, 1.0],
    },
    Parameter {
        name: "coarse_shadow",
        about: "1: the march towards the sun reads averages of the density",
        unit: "",
        range: Range::Whole(0, 1),
        default: 0.0,
        usual: [0.0, 1.0],
    },
    Parameter {
        name: "silver_strength",
        about: "added to the phase function towards the sun",
        unit: "per steradian",
        range: Range::NotNegative,
        default: Terms::NONE.silver.strength,
        usual: [0.0, 2.0],
    },
    Parameter {
        name: "silver_exponent",
        about: "exponent of the cosine of the silver lining",
        unit: "",
        range: Range::Positive,
        default: Terms::NONE.silver.exponent,
        usual: [1.0, 32.0],
    },
    Parameter {
        name: "ambient_bottom",
        about: "factor on the ambient light at the bottom of the box",
        unit: "",
        range: Range::NotNegative,
        default: Terms::NONE.ambient[0],
        usual: [0.0, 2.0],
    },
    Parameter {
        name: "ambient_top",
        about: "the same at the top, linear between",
        unit: "",
        range: Range::NotNegative,
        default: Terms::NONE.ambient[1],
        usual: [0.0, 2.0],
    },
    Parameter {
        name: "ray_powder",
        about: "1: light from behind loses what has no depth before it",
        unit: "",
        range: Range::Whole(0, 1),
        default: 0.0,
        usual: [0.0, 1.0],
    },
    Parameter {
        name: "boost_light",
        about: "share by which the light grows where extinction is high, for a second order",
        unit: "",
        range: Range::NotNegative,
        default: Terms::NONE.boost.light,
        usual: [0.0, 1.0],
    },
    Parameter {
        name: "boost_ambient",
        about: "ambient light that a second order adds where extinction is high",
        unit: "",
        range: Range::NotNegative,
        default: Terms::NONE.boost.ambient,
        usual: [0.0, 1.0],
    },
    Parameter {
        name: "boost_length",
        about: "length over which extinction counts for the boost",
        unit: "sides of the box",
        range: Range::NotNegative,
        default: Terms::NONE.boost.length,
        usual: [0.0, 1.0],
    },
    Parameter {
        name: "boost_by_angle",
        about: "1: the ambient boost follows (1 + cosine^2) / 2",
        unit: "",
        range: Range::Whole(0, 1),
        default: 1.0,
        usual: [0.0, 1.0],
    },
    Parameter {
        name: "rim_strength",
        about: "added to the phase function at right angles to the sun, times (1 - |cosine|)^4",
        unit: "per steradian",
        range: Range::NotNegative,
        default: 0.0,
        usual: [0.0, 0.5],
    },
    Parameter {
        name: "phase_gain",
        about: "factor on the phase function's lobes; light transport has 1",
        unit: "",
        range: Range::NotNegative,
        default: 1.0,
        usual: [0.5, 2.0],
    },
    Parameter {
        name: "first_alpha",
        about: "Draine's alpha of the first lobe: 0 Henyey and Greenstein, 1 Cornette and Shanks",
        unit: "",
        range: Range::NotNegative,
        default: 0.0,
        usual: [0.0, 30.0],
    },
    Parameter {
        name: "second_alpha",
        about: "the same of the second lobe",
        unit: "",
        range: Range::NotNegative,
        default: 0.0,
        usual: [0.0, 30.0],
    },
    Parameter {
        name: "shadow_sample",
        about: "where a step towards the sun reads the density: 0 begin, 1 middle, 2 end",
        unit: "",
        range: Range::Whole(0, 2),
        default: 1.0,
        usual: [0.0, 2.0],
    },
    Parameter {
        name: "shadow_growth",
        about: "length of a step towards the sun over that of the one before",
        unit: "",
        range: Range::Between(0.1, 10.0),
        default: 1.0,
        usual: [1.0, 3.0],
    },
    Parameter {
        name: "shadow_length",
        about: "length of the march towards the sun in units of length; 0: its own. What lies beyond counts by a shadow map alone",
        unit: "",
        range: Range::NotNegative,
        default: 0.0,
        usual: [0.01, 1.0],
    },
    Parameter {
        name: "shadow_map",
        about: "texels along a side of a map of what lies beyond the march towards the sun; 0 is none, 1 counts as 2",
        unit: "",
        range: Range::Whole(0, 4096),
        default: 0.0,
        usual: [0.0, 64.0],
    },
    Parameter {
        name: "shadow_layers",
        about: "layers of a map that knows what lies between each and the sun, in the place of the march; 0: a Beer map's front and mean. \
                Without a shadow_map it counts for nothing",
        unit: "",
        range: Range::Whole(0, 4096),
        default: 0.0,
        usual: [0.0, 64.0],
    },
    Parameter {
        name: "shadow_by_angle",
        about: "the depth towards the sun is multiplied with 1 minus this times the cosine",
        unit: "",
        range: UNIT,
        default: 0.0,
        usual: [0.0, 0.5],
    },
    Parameter {
        name: "first_lobe",
        about: "mean cosine of the first lobe of the phase function",
        unit: "",
        range: COSINE,
        default: -0.3,
        usual: [-0.9, 0.9],
    },
    Parameter {
        name: "second_lobe",
        about: "mean cosine of the second lobe",
        unit: "",
        range: COSINE,
        default: 0.3,
        usual: [-0.9, 0.9],
    },
    Parameter {
        name: "second_share",
        about: "share of the second lobe",
        unit: "",
        range: UNIT,
        default: 0.8,
        usual: [0.0, 1.0],
    },
    Parameter {
        name: "source_albedo",
        about: "single-scattering albedo of the source",
        unit: "",
        range: UNIT,
        default: 1.0,
        usual: [0.9, 1.0],
    },
];

/// The light that a density model brings along.
pub const OWN: &str = "own";

/// All light models by name.
pub const LIGHTS: &[NamedLight] = &[
    NamedLight {
        id: OWN,
        about: "the density model's own, as its system has it; of a scene's graph that of single",
        settings: &[],
    },
    NamedLight { id: "single", about: "single scattering of the sun and a constant ambient light", settings: &[] },
    NamedLight {
        id: "octaves",
        about: "eight octaves, each with half the light, half the depth and half the eccentricity of the one before",
        settings: &[("octaves", 8.0), ("contribution", 0.5), ("attenuation", 0.5), ("eccentricity", 0.5)],
    },
    NamedLight {
        id: "octaves-deep",
        about: "four octaves, each with half the light and a quarter of the depth of the one before",
        settings: &[("octaves", 4.0), ("contribution", 0.5), ("attenuation", 0.25), ("eccentricity", 0.5)],
    },
    NamedLight {
        id: "powder",
        about: "single scattering, thin parts darkened",
        settings: &[("powder_strength", 0.8), ("powder_length", 0.1)],
    },
    NamedLight {
        id: "silver",
        about: "single scattering with a silver lining around the sun",
        settings: &[("silver_strength", 0.5), ("silver_exponent", 8.0)],
    },
    NamedLight {
        id: "half-powder",
        about: "single scattering times (1 + powder of the depth towards the sun) / 2, as the procedural-clouds skill has it",
        settings: &[("octaves", 2.0), ("contribution", -0.5), ("attenuation", 3.0), ("eccentricity", 1.0)],
    },
    NamedLight {
        id: "light-ray",
        about: "four octaves with powder of the light ray, as bestclouds has it",
        settings: &[
            ("octaves", 4.0),
            ("contribution", 0.5),
            ("attenuation", 0.25),
            ("eccentricity", 0.5),
            ("ray_powder", 1.0),
        ],
    },
    NamedLight {
        id: "boosted",
        about: "single scattering with powder and a boost for a second order, as boltbestclouds32 has it",
        settings: &[
            ("powder_strength", 1.0),
            ("powder_length", 0.1),
            ("boost_light", 0.6),
            ("boost_ambient", 0.3),
            ("boost_length", 0.1),
        ],
    },
    NamedLight {
        id: "gradient",
        about: "single scattering, ambient light that falls to 0.3 at the bottom",
        settings: &[("ambient_bottom", 0.3)],
    },
    NamedLight {
        id: "combined",
        about: "octaves, powder and an ambient gradient together",
        settings: &[
            ("octaves", 8.0),
            ("contribution", 0.5),
            ("attenuation", 0.5),
            ("eccentricity", 0.5),
            ("powder_strength", 0.8),
            ("powder_length", 0.1),
            ("ambient_bottom", 0.3),
        ],
    },
];

/// A light model by its name.
pub fn find(id: &str) -> Result<&'static NamedLight> {
    LIGHTS.iter().find(|light| light.id == id).ok_or_else(|| {
        let known: Vec<&str> = LIGHTS.iter().map(|light| light.id).collect();
        Error::new("light model", format!("\"{id}\""), format!("one of {}", known.join(", ")), "Correct the name.")
    })
}

/// Refuses a text that [`apply`] would refuse.
pub fn check(text: &str) -> Result<()> {
    let mut words = text.split_whitespace();
    find(words.next().unwrap_or_default())?;
    for word in words {
        let (name, value) = crate::engines::parameters::assignment(word)?;
        Parameter::check(PARAMETERS, name, value, text)?;
    }
    Ok(())
}

/// Whether a light model with parameters, a text that [`check`] took, imitates orders of scattering behind the first. A system's own light may or may
/// not: whoever marches it says so.
pub fn imitates_orders(text: &str) -> bool {
    let mut light = LightModel {
        suns: Vec::new(),
        ambient: [0.0; 3],
        phase: TwoLobes::new([0.0; 2], 0.0),
        shadow: ShadowMarch::new(1, ShadowLength::ToExit, ShadowExtinction::View),
        source: SourceFactor::Albedo([1.0; 3]),
        terms: Terms::NONE,
    };
    apply(&mut light, text).is_ok() && light.terms.imitates_orders()
}

/// Puts a light model with parameters, such as `octaves contribution=0.7`, into a light.
pub fn apply(light: &mut LightModel, text: &str) -> Result<()> {
    let mut words = text.split_whitespace();
    find(words.next().unwrap_or_default())?.apply(light)?;
    for word in words {
        let (name, value) = crate::engines::parameters::assignment(word)?;
        set(light, name, value, text)?;
    }
    Ok(())
}

impl NamedLight {
    /// Puts its terms into a light model, in the place of those that it has; sun, phase function and the march towards the sun stay.
    pub fn apply(&self, light: &mut LightModel) -> Result<()> {
        if self.id != OWN {
            light.terms = Terms::NONE;
        }
        self.settings.iter().try_for_each(|&(name, value)| set(light, name, value, self.id))
    }
}

/// Sets a parameter of a light model, after its name and range are checked; `place` says where the value stands.
pub fn set(light: &mut LightModel, name: &str, value: f64, place: &str) -> Result<()> {
    Parameter::check(PARAMETERS, name, value, place)?;
    match name {
        "exposure" => light.terms.exposure = value,
        "octaves" => light.terms.octaves.count = value as u32,
        "contribution" => light.terms.octaves.contribution = value,
        "attenuation" => light.terms.octaves.attenuation = value,
        "eccentricity" => light.terms.octaves.eccentricity = value,
        "depth_compression" => light.terms.octaves.compression = value,
        "powder_strength" => light.terms.powder.strength = value,
        "powder_length" => light.terms.powder.length = value,
        "powder_ambient" => light.terms.powder.ambient = value,
        "body_strength" => light.terms.body.strength = value,
        "body_length" => light.terms.body.length = value,
        "coarse_shadow" => light.terms.body.shadow = value == 1.0,
        "silver_strength" => light.terms.silver.strength = value,
        "silver_exponent" => light.terms.silver.exponent = value,
        "ambient_bottom" => light.terms.ambient[0] = value,
        "ambient_top" => light.terms.ambient[1] = value,
        "ray_powder" => light.terms.ray_powder = value == 1.0,
        "boost_light" => light.terms.boost.light = value,
        "boost_ambient" => light.terms.boost.ambient = value,
        "boost_length" => light.terms.boost.length = value,
        "boost_by_angle" => light.terms.boost.by_angle = value == 1.0,
        "rim_strength" => light.phase.rim = value,
        "phase_gain" => light.phase.gain = value,
        "first_alpha" => light.phase.alpha[0] = value,
        "second_alpha" => light.phase.alpha[1] = value,
        "shadow_sample" => {
            light.shadow.sample = [ShadowSample::Left, ShadowSample::Middle, ShadowSample::Right][value as usize];
        }
        "shadow_growth" => light.shadow.growth = value,
        "shadow_length" if value == 0.0 => (),
        "shadow_length" => light.shadow.length = ShadowLength::Fixed(value),
        "shadow_map" => light.shadow.map = map_of(value as u32, light.shadow.map),
        "shadow_layers" => light.shadow.layers = value as u32,
        "shadow_by_angle" => light.shadow.by_angle = value,
        "first_lobe" => light.phase.anisotropy[0] = value,
        "second_lobe" => light.phase.anisotropy[1] = value,
        "second_share" => light.phase.second = value,
        "source_albedo" => light.source = SourceFactor::Albedo([value; 3]),
        _ => unreachable!("{name} is in the list of parameters"),
    }
    Ok(())
}

/// The value of a parameter in a light model: what [`set`] would leave as it is. None of a name that is not in the list.
pub fn value(light: &LightModel, name: &str) -> Option<f64> {
    let LightModel { terms, phase, shadow, source, .. } = light;
    Some(match name {
        "exposure" => terms.exposure,
        "octaves" => f64::from(terms.octaves.count),
        "contribution" => terms.octaves.contribution,
        "attenuation" => terms.octaves.attenuation,
        "eccentricity" => terms.octaves.eccentricity,
        "depth_compression" => terms.octaves.compression,
        "powder_strength" => terms.powder.strength,
        "powder_length" => terms.powder.length,
        "powder_ambient" => terms.powder.ambient,
        "body_strength" => terms.body.strength,
        "body_length" => terms.body.length,
        "coarse_shadow" => f64::from(u8::from(terms.body.shadow)),
        "silver_strength" => terms.silver.strength,
        "silver_exponent" => terms.silver.exponent,
        "ambient_bottom" => terms.ambient[0],
        "ambient_top" => terms.ambient[1],
        "ray_powder" => f64::from(u8::from(terms.ray_powder)),
        "boost_light" => terms.boost.light,
        "boost_ambient" => terms.boost.ambient,
        "boost_length" => terms.boost.length,
        "boost_by_angle" => f64::from(u8::from(terms.boost.by_angle)),
        "rim_strength" => phase.rim,
        "phase_gain" => phase.gain,
        "first_alpha" => phase.alpha[0],
        "second_alpha" => phase.alpha[1],
        "shadow_sample" => match shadow.sample {
            ShadowSample::Left => 0.0,
            ShadowSample::Middle => 1.0,
            ShadowSample::Right => 2.0,
        },
        "shadow_growth" => shadow.growth,
        // A length that goes by where a ray ends is the system's own.
        "shadow_length" => {
            if let ShadowLength::Fixed(length) = shadow.length {
                length
            } else {
                0.0
            }
        }
        "shadow_map" => shadow.map.map_or(0.0, |map| f64::from(map.size)),
        "shadow_layers" => f64::from(shadow.layers),
        "shadow_by_angle" => shadow.by_angle,
        "first_lobe" => phase.anisotropy[0],
        "second_lobe" => phase.anisotropy[1],
        "second_share" => phase.second,
        // Of a source that is none, the green is as good as any.
        "source_albedo" => {
            if let SourceFactor::Albedo(albedo) = source {
                albedo[1]
            } else {
                1.0
            }
        }
        _ => return None,
    })
}

/// A shadow map of a size, with the settings of the one that is there; none for 0.
fn map_of(size: u32, there: Option<ShadowMapSettings>) -> Option<ShadowMapSettings> {
    let settings = there.unwrap_or(ShadowMapSettings::new(size, SHADOW_MAP_STEPS, 1.0));
    (size > 0).then_some(ShadowMapSettings { size: size.max(2), ..settings })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engines::defects::Defects;
    use crate::engines::parameters::Values;
    use crate::engines::perlin_fbm::settings;

    fn light() -> LightModel {
        settings::light(&Values::defaults(settings::PARAMETERS), &Defects::NONE)
    }

    #[test]
    fn defaults_change_nothing() {
        let mut changed = light();
        for parameter in PARAMETERS {
            set(&mut changed, parameter.name, parameter.default, "test").expect("a default is in range");
        }
        assert_eq!(changed, light());
    }

    #[test]
    fn what_was_set_is_read_back() {
        for parameter in PARAMETERS {
            for &wanted in &parameter.usual {
                let mut changed = light();
                set(&mut changed, parameter.name, wanted, "test").expect("usual");
                let found = value(&changed, parameter.name).expect("it is in the list");
                let is_own = parameter.name == "shadow_length" && wanted == 0.0;
                let wanted = if is_own { value(&light(), "shadow_length").expect("known") } else { wanted };
                assert_eq!(found, wanted, "{}", parameter.name);
            }
        }
        assert_eq!(value(&light(), "no such name"), None);
    }

    #[test]
    fn every_parameter_changes_something_and_every_light_differs() {
        for parameter in PARAMETERS {
            let mut changed = light();
            let [low, high] = parameter.usual;
            set(&mut changed, parameter.name, if parameter.default == high { low } else { high }, "test")
                .expect("usual");
            assert_ne!(changed, light(), "{}", parameter.name);
        }
        let mut seen: Vec<LightModel> = Vec::new();
        // A system with terms of its own: they stay with its own light, and all others take their place.
        let own = || LightModel { terms: Terms { exposure: 0.7, ray_powder: true, ..Terms::NONE }, ..light() };
        for named in LIGHTS {
            let mut changed = own();
            named.apply(&mut changed).expect("in range");
            assert_eq!(changed == own(), named.id == OWN, "{}", named.id);
            assert!(!seen.contains(&changed), "{}", named.id);
            seen.push(changed);
        }
    }

    #[test]
    fn unknown_names_and_values_are_refused() {
        let error = find("moonlight").expect_err("unknown").to_string();
        assert!(error.contains("octaves-deep"), "{error}");
        let mut changed = light();
        let error = set(&mut changed, "octave", 2.0, "a parameter of the light").expect_err("unknown").to_string();
        assert!(error.contains("a parameter of the light") && error.contains("contribution"), "{error}");
        for (name, value) in [("octaves", 2.5), ("octaves", 0.0), ("attenuation", -0.5), ("contribution", f64::NAN)] {
            assert!(set(&mut changed, name, value, "test").is_err(), "{name} {value}");
        }
    }
}
