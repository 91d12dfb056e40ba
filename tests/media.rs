//! Media in full: what closures add up to, their bounds and phase mixtures, several objects; and the same scenes
//! rendered by Cycles, against closed forms of single scattering along one central ray of a cube of edge 2.

mod support;

use cloudparity::bridge::reference::{ReferenceSettings, reference};
use cloudparity::graph::bounds::Bounds3;
use cloudparity::media::objects::{Media, MediumAtPoint, ObjectMedium};
use cloudparity::nodes::closure::Coefficients;
use cloudparity::scene::image::Image;
use cloudparity::scene::{Graph, Scene, Volume};
use cloudparity::view::environment::Environment;
use glam::DVec3;
use rand::{Rng as _, SeedableRng as _};
use serde_json::{Value as Json, json};
use support::graphs::{graph, graph_with, link, node};

const SUN: f64 = 10.0;

/// The cube with this graph, lit by a sun from above, before a black world, film transparent.
fn cube(graph: Graph) -> Scene {
    let mut scene = support::scene("homogeneous-cube");
    scene.film.resolution = [16, 16];
    scene.film.transparent = true;
    *scene.graph_mut() = graph;
    scene
}

fn absorbing(name: &str, density: f32) -> Json {
    node(name, "ShaderNodeVolumeAbsorption", json!({}), json!({"Color": [0.0, 0.0, 0.0, 1.0], "Density": density}))
}

fn medium(scene: &Scene) -> ObjectMedium {
    ObjectMedium::new(scene.graph(), &scene.volume).expect("the medium compiles")
}

fn at_centre(scene: &Scene) -> MediumAtPoint {
    let media = Media::new(scene).expect("the media compile");
    media.evaluate(&[DVec3::ZERO]).expect("they evaluate").remove(0)
}

#[track_caller]
fn close(found: [f64; 3], expected: [f64; 3], what: &str) {
    for channel in 0..3 {
        // f32 constants of the file, 6e-8 each, up to a handful multiplied.
        let error = (found[channel] - expected[channel]).abs();
        assert!(error <= 1e-6 * expected[channel].abs().max(1e-3), "{what}: {found:?} is not {expected:?}");
    }
}

/// Radiance per metre of a blackbody of 1500 K and intensity 1 in a channel of this colour.
fn glow(color: f64) -> f64 {
    color * 5.670_373e-8 * 1e-6 / std::f64::consts::PI * 1500.0_f64.powi(4)
}

/// Named graphs of one closure each or several, with the coefficients that Cycles 5.0.1 was measured to have. None
/// both scatters and emits: Cycles also scatters emission, which the closed form of a single ray leaves out.
fn closures() -> Vec<(&'static str, Graph, Coefficients<f64>)> {
    let all = |value: f64| [value; 3];
    let of = |scattering, extinction, emission| Coefficients { scattering, extinction, emission };
    let single = |kind: &str, properties: Json, inputs: Json, output: &str| {
        graph(link("Closure", output), &[node("Closure", kind, properties, inputs)])
    };
    let mut list = vec![
        (
            "principled",
            single(
                "ShaderNodeVolumePrincipled",
                json!({}),
                json!({"Color": [0.2, 0.5, 0.8, 1.0], "Absorption Color": [0.1, 0.3, 0.7, 1.0], "Density": 0.7}),
                "Volume",
            ),
            of(
                [0.14, 0.35, 0.56],
                [
                    0.7 * (0.2 + 0.8 * (1.0 - 0.1_f64.sqrt())),
                    0.7 * (0.5 + 0.5 * (1.0 - 0.3_f64.sqrt())),
                    0.7 * (0.8 + 0.2 * (1.0 - 0.7_f64.sqrt())),
                ],
                all(0.0),
            ),
        ),
        (
            "scatter, coloured",
            single(
                "ShaderNodeVolumeScatter",
                json!({"phase": "HENYEY_GREENSTEIN"}),
                json!({"Color": [0.2, 0.5, 0.8, 1.0], "Density": 0.9, "Anisotropy": 0.4}),
                "Volume",
            ),
            of([0.18, 0.45, 0.72], [0.18, 0.45, 0.72], all(0.0)),
        ),
        (
            "absorption",
            single(
                "ShaderNodeVolumeAbsorption",
                json!({}),
                json!({"Color": [0.2, 0.5, 0.8, 1.0], "Density": 0.9}),
                "Volume",
            ),
            of(all(0.0), [0.72, 0.45, 0.18], all(0.0)),
        ),
        (
            "coefficients",
            single(
                "ShaderNodeVolumeCoefficients",
                json!({"phase": "DRAINE"}),
                json!({"Absorption Coefficients": [0.1, 0.2, 0.3], "Scatter Coefficients": [0.6, 0.3, 0.1],
                    "Anisotropy": 0.3, "Alpha": 2.0}),
                "Volume",
            ),
            of([0.6, 0.3, 0.1], [0.7, 0.5, 0.4], all(0.0)),
        ),
        (
            "coefficients, glowing",
            single(
                "ShaderNodeVolumeCoefficients",
                json!({"phase": "HENYEY_GREENSTEIN"}),
                json!({"Absorption Coefficients": [0.1, 0.2, 0.3], "Scatter Coefficients": [0.0, 0.0, 0.0],
                    "Emission Coefficients": [0.05, 0.06, 0.07]}),
                "Volume",
            ),
            of(all(0.0), [0.1, 0.2, 0.3], [0.05, 0.06, 0.07]),
        ),
        (
            "principled, glowing",
            single(
                "ShaderNodeVolumePrincipled",
                json!({}),
                json!({"Color": [0.0, 0.0, 0.0, 1.0], "Density": 0.7, "Emission Strength": 0.5,
                    "Emission Color": [0.3, 0.2, 0.1, 1.0], "Blackbody Intensity": 1.0,
                    "Blackbody Tint": [0.5, 1.0, 1.0, 1.0], "Temperature": 1500.0}),
                "Volume",
            ),
            of(
                all(0.0),
                all(0.7),
                [0.15 + 0.5 * glow(3.264_305_8), 0.1 + glow(0.434_046_27), 0.05 + glow(-0.064_237_03)],
            ),
        ),
        (
            "emission",
            single(
                "ShaderNodeEmission",
                json!({}),
                json!({"Color": [0.1, 0.2, 0.3, 1.0], "Strength": 2.0}),
                "Emission",
            ),
            of(all(0.0), all(0.0), [0.2, 0.4, 0.6]),
        ),
        (
            "mix of absorption and two lobes",
            graph(
                link("Mix", "Shader"),
                &[
                    absorbing("Absorption", 0.8),
                    node(
                        "Forward",
                        "ShaderNodeVolumeScatter",
                        json!({"phase": "HENYEY_GREENSTEIN"}),
                        json!({"Color": [1.0, 0.5, 0.25, 1.0], "Density": 0.8, "Anisotropy": 0.6}),
                    ),
                    node(
                        "Rayleigh",
                        "ShaderNodeVolumeScatter",
                        json!({"phase": "RAYLEIGH"}),
                        json!({"Color": [0.25, 0.5, 1.0, 1.0], "Density": 0.4}),
                    ),
                    node(
                        "Add",
                        "ShaderNodeAddShader",
                        json!({}),
                        json!({"Shader": link("Forward", "Volume"), "Shader_001": link("Rayleigh", "Volume")}),
                    ),
                    node(
                        "Mix",
                        "ShaderNodeMixShader",
                        json!({}),
                        json!({"Fac": 0.75, "Shader": link("Absorption", "Volume"), "Shader_001": link("Add", "Shader")}),
                    ),
                ],
            ),
            of([0.675, 0.45, 0.45], [0.875, 0.65, 0.65], all(0.0)),
        ),
    ];
    for (phase, inputs) in
        [("FOURNIER_FORAND", json!({"IOR": 1.2, "Backscatter": 0.2})), ("MIE", json!({"Diameter": 2.0}))]
    {
        let mut inputs = inputs;
        inputs["Color"] = json!([1.0, 1.0, 1.0, 1.0]);
        inputs["Density"] = json!(0.5);
        let graph = single("ShaderNodeVolumeScatter", json!({"phase": phase}), inputs, "Volume");
        list.push((phase, graph, of(all(0.5), all(0.5), all(0.0))));
    }
    list
}

#[test]
fn closures_have_the_coefficients_that_were_measured() {
    for (name, graph, expected) in closures() {
        let found = at_centre(&cube(graph)).coefficients;
        close(found.scattering, expected.scattering, name);
        close(found.extinction, expected.extinction, name);
        close(found.emission, expected.emission, name);
    }
}

#[test]
fn colours_and_factors_out_of_range_act_as_measured() {
    let vector = |name: &str, [x, y, z]: [f32; 3]| {
        node(name, "ShaderNodeCombineXYZ", json!({}), json!({"X": x, "Y": y, "Z": z}))
    };
    let colour = vector("Colour", [-0.5, 0.5, 1.5]);
    let colored = |kind: &str| {
        let inputs = json!({"Color": link("Colour", "Vector"), "Density": 1.0});
        at_centre(&cube(graph(link("C", "Volume"), &[node("C", kind, json!({}), inputs), colour.clone()])))
    };
    // The sum of coefficients is negative there; an integrator is told so instead of going on.
    let refused = |kind: &str| {
        let inputs = json!({"Color": link("Colour", "Vector"), "Density": 1.0});
        let scene = cube(graph(link("C", "Volume"), &[node("C", kind, json!({}), inputs), colour.clone()]));
        let medium = medium(&scene);
        let values = medium.evaluate(&[[0.0; 3]]).expect("it evaluates");
        let error = values.checked(0, [0.0; 3]).expect_err("negative extinction is refused");
        assert!(error.to_string().contains("object Cube"), "{error}");
        values.coefficients(0)
    };
    let principled = colored("ShaderNodeVolumePrincipled").coefficients;
    close(principled.extinction, [1.0, 1.0, 1.5], "principled");
    close(principled.scattering, [0.0, 0.5, 1.5], "principled");
    close(refused("ShaderNodeVolumeScatter").extinction, [-0.5, 0.5, 1.5], "scatter");
    close(refused("ShaderNodeVolumeAbsorption").extinction, [1.5, 0.5, -0.5], "absorption");

    for (factor, expected) in [(-0.5, 0.4), (0.25, 0.5), (1.5, 0.8)] {
        let mix = node(
            "Mix",
            "ShaderNodeMixShader",
            json!({}),
            json!({"Fac": factor, "Shader": link("A", "Volume"), "Shader_001": link("B", "Volume")}),
        );
        let scene = cube(graph(link("Mix", "Shader"), &[mix, absorbing("A", 0.4), absorbing("B", 0.8)]));
        close(at_centre(&scene).coefficients.extinction, [expected; 3], "mix");
    }
    let scene = cube(graph(link("A", "Volume"), &[absorbing("A", -1.0)]));
    close(at_centre(&scene).coefficients.extinction, [0.0; 3], "negative density");
}

#[test]
fn closures_pass_groups_reroutes_and_muted_nodes_as_in_blender() {
    let group = |inputs: Json, outputs: Json, nodes: Json| json!({"name": "G", "inputs": inputs, "outputs": outputs, "nodes": nodes});
    let socket = |identifier: &str, kind: &str| json!({"identifier": identifier, "name": identifier, "panel": null, "type": kind});
    let call = |inputs: Json| json!({"name": "Call", "type": "ShaderNodeGroup", "location": [0.0, 0.0], "group": "G", "inputs": inputs});
    let muted = |mut node: Json, bypass: Json| {
        node["muted"] = true.into();
        node["bypass"] = bypass;
        node
    };
    let end = |value: Json| json!({"name": "End", "type": "NodeGroupOutput", "inputs": {"Out": value}});
    let shader_out = json!([socket("Out", "shader")]);
    let extinction = |name: &str, nodes: &[Json], groups: &[Json], from: Json, expected: f64| {
        let scene = cube(graph_with(from, nodes, groups));
        close(at_centre(&scene).coefficients.extinction, [expected; 3], name);
    };
    let inside = group(json!([]), shader_out.clone(), json!([absorbing("A", 0.3), end(link("A", "Volume"))]));
    extinction("closure in a group", &[call(json!({}))], &[inside], link("Call", "Out"), 0.3);

    for kind in ["shader", "color"] {
        let through = group(
            json!([socket("In", kind)]),
            json!([socket("Out", kind)]),
            json!([end(json!({"group_input": "In"}))]),
        );
        let nodes = [call(json!({"In": link("A", "Volume")})), absorbing("A", 0.3)];
        extinction("closure through a group", &nodes, &[through], link("Call", "Out"), 0.3);
    }
    let density = group(
        json!([{"identifier": "D", "name": "D", "panel": null, "type": "float", "default": 0.2}]),
        shader_out.clone(),
        json!([
            node(
                "A",
                "ShaderNodeVolumeAbsorption",
                json!({}),
                json!({"Color": [0.0, 0.0, 0.0, 1.0], "Density": {"group_input": "D"}})
            ),
            end(link("A", "Volume")),
        ]),
    );
    extinction("density from a group", &[call(json!({"D": 0.7}))], &[density], link("Call", "Out"), 0.7);

    let other =
        group(json!([socket("In", "shader")]), shader_out, json!([absorbing("A", 0.9), end(link("A", "Volume"))]));
    let nodes = [muted(call(json!({"In": link("A", "Volume")})), json!({"Out": "In"})), absorbing("A", 0.3)];
    extinction("muted group", &nodes, &[other], link("Call", "Out"), 0.3);

    let add = node(
        "Add",
        "ShaderNodeAddShader",
        json!({}),
        json!({"Shader": link("A", "Volume"), "Shader_001": link("B", "Volume")}),
    );
    let both = [absorbing("A", 0.3), absorbing("B", 0.5)];
    extinction("add", &[&both[..], std::slice::from_ref(&add)].concat(), &[], link("Add", "Shader"), 0.8);
    let silent = muted(add.clone(), json!({"Shader": "Shader"}));
    extinction("muted add", &[&both[..], &[silent]].concat(), &[], link("Add", "Shader"), 0.3);
    let nothing = [absorbing("A", 0.3), muted(absorbing("B", 0.5), json!({})), add];
    extinction("add with a muted closure", &nothing, &[], link("Add", "Shader"), 0.3);
    let reroute =
        json!({"name": "R", "type": "NodeReroute", "socket_type": "shader", "inputs": {"Input": link("A", "Volume")}});
    extinction("reroute", &[absorbing("A", 0.3), reroute], &[], link("R", "Output"), 0.3);
}

#[test]
fn a_value_where_a_closure_belongs_emits() {
    let value = json!({"name": "V", "type": "ShaderNodeCombineXYZ", "inputs": {"X": 0.1, "Y": 0.2, "Z": 0.3}});
    let found = at_centre(&cube(graph(link("V", "Vector"), &[value])));
    close(found.coefficients.emission, [0.1, 0.2, 0.3], "vector");
    close(found.coefficients.extinction, [0.0; 3], "vector");
}

#[test]
fn additions_that_double_without_end_are_refused() {
    let mut nodes = vec![absorbing("0", 0.1)];
    for number in 1..40 {
        let before = link(&(number - 1).to_string(), if number == 1 { "Volume" } else { "Shader" });
        let inputs = json!({"Shader": before, "Shader_001": before});
        nodes.push(node(&number.to_string(), "ShaderNodeAddShader", json!({}), inputs));
    }
    let scene = cube(graph(link("39", "Shader"), &nodes));
    let error = ObjectMedium::new(scene.graph(), &scene.volume).err().expect("it is refused");
    assert!(error.to_string().contains("closures in one material"), "{error}");
}

/// A graph in which everything varies with the position.
fn varying() -> Graph {
    let coordinates =
        node("Coordinates", "ShaderNodeTexCoord", json!({"from_instancer": false, "object": null}), json!({}));
    let noise = node(
        "Noise",
        "ShaderNodeTexNoise",
        json!({"noise_dimensions": "3D", "noise_type": "FBM", "normalize": true}),
        json!({"Vector": link("Coordinates", "Object"), "Scale": 2.0}),
    );
    let split = node("Split", "ShaderNodeSeparateXYZ", json!({}), json!({"Vector": link("Coordinates", "Generated")}));
    let heat = node(
        "Heat",
        "ShaderNodeMath",
        json!({"operation": "MULTIPLY", "use_clamp": false}),
        json!({"Value": link("Split", "Z"), "Value_001": 4000.0}),
    );
    let principled = node(
        "Principled",
        "ShaderNodeVolumePrincipled",
        json!({}),
        json!({"Color": link("Noise", "Color"), "Density": link("Noise", "Fac"), "Anisotropy": link("Split", "X"),
            "Absorption Color": link("Noise", "Color"), "Emission Strength": link("Split", "Y"),
            "Blackbody Intensity": 0.5, "Temperature": link("Heat", "Value")}),
    );
    let scatter = node(
        "Scatter",
        "ShaderNodeVolumeScatter",
        json!({"phase": "MIE"}),
        json!({"Density": link("Split", "Z"), "Diameter": link("Split", "Y")}),
    );
    let mix = node(
        "Mix",
        "ShaderNodeMixShader",
        json!({}),
        json!({"Fac": link("Split", "X"), "Shader": link("Principled", "Volume"), "Shader_001": link("Scatter", "Volume")}),
    );
    graph(link("Mix", "Shader"), &[coordinates, noise, split, heat, principled, scatter, mix])
}

#[test]
fn bounds_hold_every_coefficient_and_tighten_with_the_box() {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    let graphs: Vec<Graph> = closures().into_iter().map(|(_, graph, _)| graph).chain([varying()]).collect();
    for graph in graphs {
        let scene = cube(graph);
        let medium = medium(&scene);
        for size in [2.0_f32, 0.5, 0.01] {
            for _ in 0..20 {
                let low: [f32; 3] = std::array::from_fn(|_| -1.0 + (2.0 - size) * random.random::<f32>());
                let place = Bounds3::new(low, low.map(|corner| corner + size));
                let bounds = medium.bounds_of(&[place], 1).expect("bounds exist").remove(0);
                let points: Vec<[f32; 3]> =
                    (0..100).map(|_| low.map(|corner| corner + size * random.random::<f32>())).collect();
                let values = medium.evaluate(&points).expect("it evaluates");
                for (index, point) in points.iter().enumerate() {
                    let found = values.coefficients(index);
                    for channel in 0..3 {
                        for (value, bound) in [
                            (found.scattering[channel], bounds.scattering[channel]),
                            (found.extinction[channel], bounds.extinction[channel]),
                            (found.emission[channel], bounds.emission[channel]),
                        ] {
                            assert!(bound.contains(value), "{value} at {point:?} is outside of {bound:?}");
                        }
                    }
                }
            }
        }
        // A box of a hundredth of the edge: narrower than a tenth of the largest value.
        let tiny = medium.bounds_of(&[Bounds3::new([0.1; 3], [0.11; 3])], 0).expect("bounds exist").remove(0);
        assert!(tiny.extinction[1].high - tiny.extinction[1].low < 0.1, "{tiny:?}");
    }
}

#[test]
fn what_is_known_without_evaluating_is_true() {
    let character = |graph: Graph| medium(&cube(graph)).character;
    let named = |name: &str| closures().into_iter().find(|(known, ..)| *known == name).expect("it is there").1;
    let of = character(named("principled"));
    assert!(of.homogeneous && of.isotropic && !of.grey && of.dark && !of.absorbing);
    let of = character(named("principled, glowing"));
    assert!(of.homogeneous && of.isotropic && of.grey && !of.dark && of.absorbing);
    let of = character(named("scatter, coloured"));
    assert!(of.homogeneous && !of.isotropic && !of.grey && of.dark && !of.absorbing);
    let of = character(named("absorption"));
    assert!(of.absorbing && of.isotropic && of.dark && !of.grey);
    let of = character(named("MIE"));
    assert!(of.grey && !of.isotropic && of.dark);
    let of = character(named("mix of absorption and two lobes"));
    assert!(of.homogeneous && !of.grey && !of.isotropic && of.dark);
    let of = character(varying());
    assert!(!of.homogeneous && !of.grey && !of.isotropic && !of.dark && !of.absorbing);
}

#[test]
fn constants_cost_no_column_and_common_parts_are_computed_once() {
    for (name, graph, _) in closures() {
        assert_eq!(medium(&cube(graph)).program().output_components(), 0, "{name}");
    }
    let mut scene = cube(varying());
    // Colour (3) and Fac of the noise, X, Y, Z of the split, the heat.
    assert_eq!(medium(&scene).program().output_components(), 8);
    scene.graph_mut().nodes.retain(|node| node.name != "Heat");
    assert!(ObjectMedium::new(scene.graph(), &scene.volume).is_err(), "a missing node is an error");
}

#[test]
fn lobes_mix_in_proportion_to_scattering_and_samples_follow_their_density() {
    let graph = closures().into_iter().find(|(name, ..)| name.starts_with("mix")).expect("it is there").1;
    let mixture = at_centre(&cube(graph)).mixture;
    assert_eq!(mixture.lobes().len(), 2);
    // Means over the channels: the scattering is (0.6, 0.3, 0.15) and (0.075, 0.15, 0.3).
    let (forward, rayleigh) = (0.35, 0.175);
    for cosine in [-0.9, 0.0, 0.7] {
        let [a, b] = [0, 1].map(|lobe: usize| mixture.lobes()[lobe].phase.evaluate(cosine));
        let expected = (forward * a + rayleigh * b) / (forward + rayleigh);
        close([mixture.evaluate(cosine); 3], [expected; 3], "mixture");
    }
    let (count, bins) = (10_000, 10);
    let mut filled = vec![0.0; bins];
    for index in 0..count {
        let cosine = mixture.sample((f64::from(index) + 0.5) / f64::from(count)).expect("it scatters");
        filled[((0.5 * (1.0 + cosine) * bins as f64) as usize).min(bins - 1)] += 1.0 / f64::from(count);
    }
    for (bin, filled) in filled.iter().enumerate() {
        let fine = 1000;
        let step = 2.0 / (bins * fine) as f64;
        let expected: f64 = (0..fine)
            .map(|part| -1.0 + ((bin * fine + part) as f64 + 0.5) * step)
            .map(|cosine| 2.0 * std::f64::consts::PI * mixture.evaluate(cosine) * step)
            .sum();
        // Evenly spaced numbers: each lobe misses a bin's share by at most one count at either side.
        assert!((filled - expected).abs() < 4.0 / f64::from(count) + 1e-6, "bin {bin}: {filled} is not {expected}");
    }
    let empty = cloudparity::media::objects::PhaseMixture::empty();
    assert!(empty.sample(0.5).is_none() && empty.evaluate(0.5) == 0.0);
}

/// A cube of edge 1 in the middle of the first, with its own absorbing material.
fn with_inner_cube(mut scene: Scene) -> Scene {
    let mut inner: Volume = scene.volume.clone();
    inner.object = "Inner".into();
    inner.material = "Other".into();
    for axis in 0..3 {
        inner.matrix_world[axis][axis] = 0.5;
    }
    let mut other = graph(
        link("S", "Volume"),
        &[node(
            "S",
            "ShaderNodeVolumeScatter",
            json!({"phase": "RAYLEIGH"}),
            json!({"Color": [0.5, 0.25, 1.0, 1.0], "Density": 0.8}),
        )],
    );
    other.material = "Other".into();
    scene.other_volumes.push(inner);
    scene.other_graphs.push(other);
    scene
}

#[test]
fn coefficients_of_overlapping_objects_add() {
    let scene = with_inner_cube(cube(closures().remove(3).1));
    let media = Media::new(&scene).expect("the media compile");
    let places = [DVec3::ZERO, DVec3::new(0.5, -0.5, 0.5), DVec3::splat(0.51), DVec3::splat(1.01)];
    let found = media.evaluate(&places).expect("they evaluate");
    close(found[0].coefficients.extinction, [1.1, 0.7, 1.2], "both");
    assert_eq!(found[0].mixture.lobes().len(), 2);
    close(found[1].coefficients.extinction, [1.1, 0.7, 1.2], "a corner of the inner one");
    close(found[2].coefficients.extinction, [0.7, 0.5, 0.4], "the outer one alone");
    close(found[3].coefficients.extinction, [0.0; 3], "outside");
}

#[test]
fn scenes_of_several_volumes_are_checked_and_read_again() {
    let scene = with_inner_cube(cube(closures().remove(0).1));
    let text = serde_json::to_value(&scene).expect("it serialises");
    let again = Scene::from_value(text.clone(), "test").expect("it is legal");
    assert_eq!(again, Scene { folder: std::path::PathBuf::new(), ..scene });
    let refused = |change: &dyn Fn(&mut Json), words: &[&str]| {
        let mut changed = text.clone();
        change(&mut changed);
        let error = Scene::from_value(changed, "test").expect_err("it is refused").to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    };
    refused(
        &|scene| scene["other_volumes"][0]["material"] = "Nobody".into(),
        &["$.other_volumes[0].material", "Nobody"],
    );
    refused(&|scene| scene["other_volumes"][0]["object"] = "Cube".into(), &["two volume objects", "Cube"]);
    refused(&|scene| scene["other_graphs"][0]["material"] = "Material".into(), &["two materials", "Material"]);
    refused(
        &|scene| scene["other_volumes"][0]["matrix_world"][0][0] = 0.0.into(),
        &["$.other_volumes[0].matrix_world"],
    );
    refused(
        &|scene| {
            let nodes = scene["other_graphs"][0]["nodes"].as_array_mut().expect("nodes");
            nodes.push(nodes[0].clone());
        },
        &["$.other_graphs[0].nodes", "two nodes"],
    );
    // A second object may share the first one's material.
    let mut shared = text.clone();
    shared["other_volumes"][0]["material"] = "Material".into();
    shared["other_graphs"] = json!([]);
    let shared = Scene::from_value(shared, "test").expect("it is legal");
    assert!(std::ptr::eq(shared.volumes().expect("materials exist")[1].1, shared.graph()));
}

/// What the central ray sees: a sun at right angles, emission, and the mean opacity. Each piece of the ray has
/// its length and place; the sun's way through the medium is `shadow(t)`.
fn closed_form(place: &MediumAtPoint) -> [f64; 4] {
    let Coefficients { scattering, extinction, emission } = place.coefficients;
    let phase = place.mixture.evaluate(0.0);
    let mut result = [0.0, 0.0, 0.0, 1.0];
    for channel in 0..3 {
        let sigma = extinction[channel];
        let through = (-2.0 * sigma).exp();
        // (1 - exp(-2 sigma)) / sigma, which is 2 at 0.
        let length = if sigma == 0.0 { 2.0 } else { (1.0 - through) / sigma };
        let lit = scattering[channel] * SUN * phase * (-sigma).exp();
        result[channel] = (lit + emission[channel]) * length;
        result[3] -= through / 3.0;
    }
    result
}

fn by_cycles(scene: &Scene, samples: u32) -> (Image, ReferenceSettings) {
    let cache = tempfile::tempdir().expect("a folder");
    let settings = ReferenceSettings { samples, volume_biased: true, ..ReferenceSettings::default() };
    let found = reference(scene, &settings, cache.path(), |_| {}).expect("Cycles renders");
    (Image::read_exr(&found.path).expect("the reference is an image"), settings)
}

/// Mean of the picture against the expectation. Every pixel is the same ray and an independent estimate, so that
/// their scatter gives the standard error; the systematic allowance of homogeneous media by ray marching is 0,
/// 1e-5 covers Cycles' f32.
#[track_caller]
fn cycles_gives(picture: &Image, expected: [f64; 4], name: &str) {
    let mean = picture.mean();
    let count = picture.pixels.len() as f64;
    for channel in 0..4 {
        let square = |pixel: &[f32; 4]| (f64::from(pixel[channel]) - mean[channel]).powi(2);
        let variance = picture.pixels.iter().map(square).sum::<f64>() / (count - 1.0);
        let error = (variance / count).sqrt();
        assert!(error < 5e-3 * expected[channel].abs() + 1e-9, "{name}, channel {channel}: {error} is too noisy");
        let difference = (mean[channel] - expected[channel]).abs();
        assert!(
            difference < 4.0 * error + 1e-5 * expected[channel].abs().max(1e-3),
            "{name}, channel {channel}: Cycles has {}, expected {} +- {error}",
            mean[channel],
            expected[channel]
        );
    }
}

#[test]
fn cycles_has_the_same_coefficients_and_phase_functions() {
    if !support::require("bpy") {
        return;
    }
    for (name, graph, _) in closures() {
        let scene = cube(graph);
        let (picture, _) = by_cycles(&scene, 256);
        cycles_gives(&picture, closed_form(&at_centre(&scene)), name);
    }
}

#[test]
fn cycles_adds_overlapping_objects() {
    if !support::require("bpy") {
        return;
    }
    let mut scene = with_inner_cube(cube(graph(link("A", "Volume"), &[absorbing("A", 0.3)])));
    let media = Media::new(&scene).expect("the media compile");
    let depth = |channel: usize| {
        let at = |place: f64| {
            media.evaluate(&[DVec3::new(0.0, place, 0.0)]).expect("it evaluates")[0].coefficients.extinction[channel]
        };
        at(-0.75) * 0.5 + at(0.0) + at(0.75) * 0.5
    };
    scene.film.transparent = false;
    scene.lights.clear();
    // Without a sun and behind a world of one colour nothing that scatters can be told from what passes; so the
    // film is transparent and alpha counts.
    scene.film.transparent = true;
    let alpha = 1.0 - (0..3).map(|channel| (-depth(channel)).exp()).sum::<f64>() / 3.0;
    let (picture, _) = by_cycles(&scene, 256);
    cycles_gives(&picture, [0.0, 0.0, 0.0, alpha], "overlap");
}

#[test]
fn cycles_has_the_same_environment() {
    if !support::require("bpy") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    let mut sky = Image::new(8, 4);
    for pixel in &mut sky.pixels {
        *pixel = [random.random(), random.random(), random.random(), 1.0];
    }
    let path = folder.path().join("sky.exr");
    sky.write_exr(&path, false).expect("it is written");
    let mut scene = cube(graph(link("A", "Volume"), &[absorbing("A", 0.0)]));
    scene.lights.clear();
    scene.film.transparent = false;
    scene.world.color = [1.0; 3];
    scene.world.strength = 1.5;
    let bytes = std::fs::read(&path).expect("it is read");
    scene.world.image = Some(cloudparity::scene::WorldImage {
        file: "sky.exr".into(),
        sha256: cloudparity::base::files::sha256(&bytes),
    });
    let file = folder.path().join("sky.scene.json");
    let write = |scene: &Scene| {
        std::fs::write(&file, serde_json::to_string(scene).expect("it serialises")).expect("it is written");
        Scene::load(&file)
    };
    let turned = |angle: f32, tilt: f32| {
        // The camera looks down its -Z: first tilted about X, then turned about Z.
        let ((s, c), (t, d)) = (angle.sin_cos(), tilt.sin_cos());
        [[c, -s * d, s * t, 0.0], [s, c * d, -c * t, 0.0], [0.0, t, d, 0.0], [0.0, 0.0, 0.0, 1.0]]
    };
    for (angle, tilt) in [(0.3, 1.2), (1.7, 2.9), (-2.0, 0.1)] {
        let mut scene = scene.clone();
        scene.camera.matrix_world = turned(angle, tilt);
        let scene = write(&scene).expect("the scene loads");
        let environment = Environment::load(&scene).expect("the picture is read").expect("there is one");
        let m = cloudparity::scene::matrix_to_glam(&scene.camera.matrix_world);
        let [red, green, blue] = environment.radiance(-m.z_axis.truncate());
        let (picture, _) = by_cycles(&scene, 1);
        let mean = picture.mean();
        for (found, expected) in mean.into_iter().zip([red, green, blue]) {
            // The f32 rounding of the direction, which was measured to change this picture by up to 1.5e-5.
            assert!((found - expected).abs() < 3e-5, "{found} is not {expected}");
        }
    }
    let mut other = scene.clone();
    other.world.image.as_mut().expect("there is one").sha256 = "0".repeat(64);
    assert!(write(&other).expect_err("another picture").to_string().contains("$.world.image.sha256"));
    scene.world.color = [0.5; 3];
    assert!(write(&scene).expect_err("a colour beside a picture").to_string().contains("$.world.color"));
}
