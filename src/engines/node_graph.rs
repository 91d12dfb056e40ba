//! Densities of published systems as node graphs: put together from Blender's own nodes, they have their evaluators, bounds and shaders,
//! and Blender renders them as they are. Noises that Blender does not have are nodes of ours ([`crate::nodes::lattice_noise`]).

use crate::base::error::{Error, Result};
use crate::graph::Program;
use crate::media::phase::ScatteringLobe;
use crate::nodes;
use crate::nodes::cloud_texture::bakes::FeaturePoints;
use crate::nodes::cloud_texture::{FEATURE_POINTS, TEXTURE};
use crate::scene::{Graph, GraphSource, Scene};
use serde_json::{Map, Value, json};
use std::collections::HashMap;

/// What goes into a node: a number, or another node's output.
#[derive(Debug, Clone, PartialEq)]
pub enum Input {
    /// The same everywhere.
    Number(f64),
    /// An output by its node and identifier.
    Output(String, &'static str),
}

/// A field of clouds of ellipsoids, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClusterField {
    /// Which clouds; a whole number.
    pub seed: f64,
    /// Side of the square on which they stand, around the origin.
    pub spread: f64,
    /// Least height of their middles, and what is added to it at most.
    pub base: f64,
    /// See `base`.
    pub height: f64,
    /// Of a sphere, in the mean.
    pub radius: f64,
    /// Motion along z in spreads.
    pub passed: f64,
}

impl From<f64> for Input {
    fn from(number: f64) -> Self {
        Self::Number(number)
    }
}

impl From<&Input> for Input {
    fn from(input: &Self) -> Self {
        input.clone()
    }
}

impl Input {
    fn json(&self) -> Value {
        match self {
            // Stored numbers are f32.
            Self::Number(number) => json!(*number as f32),
            Self::Output(node, socket) => json!({ "node": node, "socket": socket }),
        }
    }
}

/// A graph under construction.
#[derive(Debug, Clone, Default)]
pub struct NodeGraph {
    nodes: Vec<Value>,
    /// How many nodes there are of each type.
    counts: HashMap<String, usize>,
}

impl NodeGraph {
    /// Adds a node; `inputs` by their identifiers.
    fn node(&mut self, kind: &str, properties: Value, inputs: &[(&str, Value)], output: &'static str) -> Input {
        // As Blender names new nodes: Math, Math.001, Math.002.
        let label = nodes::find(kind).map_or(kind, |found| found.label);
        let count = self.counts.entry(label.to_owned()).or_default();
        let name = if *count == 0 { label.to_owned() } else { format!("{label}.{count:03}") };
        *count += 1;
        let column = self.nodes.len() as f32;
        let inputs: Map<String, Value> =
            inputs.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
        self.nodes.push(json!({
            "name": name,
            "type": kind,
            "location": [160.0 * column, 0.0],
            "properties": properties,
            "inputs": inputs,
        }));
        Input::Output(name, output)
    }

    /// The place in the object.
    pub fn place(&mut self) -> Input {
        self.node("ShaderNodeTexCoord", json!({}), &[], "Object")
    }

    /// A Math node's operation on one to three inputs.
    pub fn math(&mut self, operation: &str, inputs: &[Input]) -> Input {
        self.calculated(operation, inputs, false)
    }

    fn calculated(&mut self, operation: &str, inputs: &[Input], clamps: bool) -> Input {
        let given: Vec<(&str, Value)> =
            ["Value", "Value_001", "Value_002"].into_iter().zip(inputs.iter().map(Input::json)).collect();
        self.node("ShaderNodeMath", json!({ "operation": operation, "use_clamp": clamps }), &given, "Value")
    }

    /// a + b.
    pub fn add(&mut self, a: impl Into<Input>, b: impl Into<Input>) -> Input {
        self.math("ADD", &[a.into(), b.into()])
    }

    /// a - b.
    pub fn subtract(&mut self, a: impl Into<Input>, b: impl Into<Input>) -> Input {
        self.math("SUBTRACT", &[a.into(), b.into()])
    }

    /// a b.
    pub fn multiply(&mut self, a: impl Into<Input>, b: impl Into<Input>) -> Input {
        self.math("MULTIPLY", &[a.into(), b.into()])
    }

    /// a b, kept within [0, 1].
    pub fn multiply_clamped(&mut self, a: impl Into<Input>, b: impl Into<Input>) -> Input {
        self.calculated("MULTIPLY", &[a.into(), b.into()], true)
    }

    /// a b + c.
    pub fn multiply_add(&mut self, a: impl Into<Input>, b: impl Into<Input>, c: impl Into<Input>) -> Input {
        self.math("MULTIPLY_ADD", &[a.into(), b.into(), c.into()])
    }

    /// The larger.
    pub fn maximum(&mut self, a: impl Into<Input>, b: impl Into<Input>) -> Input {
        self.math("MAXIMUM", &[a.into(), b.into()])
    }

    /// `to[0] + (x - from[0]) (to[1] - to[0]) / (from[1] - from[0])`, which is 0 for an empty range, as Blender has it; kept within `to` where asked for.
    pub fn remap(&mut self, x: &Input, from: [Input; 2], to: [f64; 2], clamps: bool) -> Input {
        self.mapped(x, from, to, "LINEAR", clamps)
    }

    /// The cubic step from 0 at `from` to 1 at `to`.
    pub fn smooth(&mut self, from: f64, to: f64, x: &Input) -> Input {
        self.mapped(x, [from.into(), to.into()], [0.0, 1.0], "SMOOTHSTEP", true)
    }

    /// 1 in the middle of [0, 1], falling to 0 over 0.15 at both ends, and 0 outside.
    pub fn trapezoid(&mut self, height: &Input) -> Input {
        let low = self.remap(height, [0.0.into(), 0.15.into()], [0.0, 1.0], true);
        let high = self.remap(height, [0.85.into(), 1.0.into()], [1.0, 0.0], true);
        self.multiply(low, high)
    }

    /// From 1 at `from` to 0 at `to`, as [`Self::smooth`] rises.
    pub fn fall(&mut self, from: f64, to: f64, x: &Input) -> Input {
        let rise = self.smooth(from, to, x);
        self.subtract(1.0, rise)
    }

    /// 1 in the middle of [0, 1], rising over `bottom` at its beginning and falling over `top` at its end by cubic steps. `rising` is the height
    /// that counts at the bottom.
    pub fn fades(&mut self, rising: &Input, height: &Input, [bottom, top]: [f64; 2]) -> Input {
        let rise = self.smooth(0.0, bottom, rising);
        let fall = self.fall(1.0 - top, 1.0, height);
        self.multiply(rise, fall)
    }

    /// (2 x^bias - 1)^2 of x kept within [0, 1]: 1 minus it is `takram`'s semicircle over the height of a layer.
    pub fn off_middle(&mut self, height: &Input, bias: f64) -> Input {
        let bent = self.math("POWER", &[height.clone(), bias.into()]);
        let bent = self.multiply_add(bent, 2.0, -1.0);
        self.multiply(&bent, &bent)
    }

    /// Distance of (x, z) to a polyline of two points or more.
    pub fn distance_to_line(&mut self, [x, z]: [&Input; 2], line: &[[f64; 2]]) -> Input {
        let mut nearest: Option<Input> = None;
        for ends in line.windows(2) {
            let ([ax, az], [bx, bz]) = (ends[0], ends[1]);
            let (dx, dz) = (bx - ax, bz - az);
            let square = dx * dx + dz * dz;
            let (from_x, from_z) = (self.subtract(x, ax), self.subtract(z, az));
            // Of a segment without a length the part is 0.
            let [px, pz] = [dx, dz].map(|part| if square > 0.0 { part / square } else { 0.0 });
            let along = self.multiply(&from_x, px);
            let part = self.calculated("MULTIPLY_ADD", &[from_z.clone(), pz.into(), along], true);
            let away_x = self.multiply_add(&part, -dx, from_x);
            let away_z = self.multiply_add(&part, -dz, from_z);
            let of_x = self.multiply(&away_x, &away_x);
            let found = self.multiply_add(&away_z, &away_z, of_x);
            nearest = Some(match nearest {
                None => found,
                Some(before) => self.math("MINIMUM", &[before, found]),
            });
        }
        let nearest = nearest.unwrap_or(Input::Number(f64::from(f32::MAX)));
        self.math("SQRT", &[nearest])
    }

    /// The mask of a spine: 1 on a polyline, falling to 0 at `radius` from it, over the part `softness` of the radius.
    pub fn spine_band(&mut self, place: [&Input; 2], line: &[[f64; 2]], radius: f64, softness: f64) -> Input {
        let distance = self.distance_to_line(place, line);
        let inside = self.multiply_add(distance, -1.0 / radius.max(1e-5), 1.0);
        self.smooth(0.0, softness, &inside)
    }

    fn mapped(&mut self, x: &Input, from: [Input; 2], to: [f64; 2], interpolation: &str, clamps: bool) -> Input {
        let inputs = [
            ("Value", x.json()),
            ("From Min", from[0].json()),
            ("From Max", from[1].json()),
            ("To Min", Input::Number(to[0]).json()),
            ("To Max", Input::Number(to[1]).json()),
        ];
        let properties = json!({ "interpolation_type": interpolation, "data_type": "FLOAT", "clamp": clamps });
        self.node("ShaderNodeMapRange", properties, &inputs, "Result")
    }

    /// Coordinates of a vector.
    pub fn separate(&mut self, vector: &Input) -> [Input; 3] {
        let Input::Output(name, _) = self.node("ShaderNodeSeparateXYZ", json!({}), &[("Vector", vector.json())], "X")
        else {
            unreachable!("a node has outputs")
        };
        ["X", "Y", "Z"].map(|axis| Input::Output(name.clone(), axis))
    }

    /// A vector of coordinates.
    pub fn combine(&mut self, [x, y, z]: [Input; 3]) -> Input {
        let inputs = [("X", x.json()), ("Y", y.json()), ("Z", z.json())];
        self.node("ShaderNodeCombineXYZ", json!({}), &inputs, "Vector")
    }

    /// `factor v + added`, component by component.
    pub fn affine(&mut self, vector: &Input, factor: [f64; 3], added: [f64; 3]) -> Input {
        let inputs = [
            ("Vector", vector.json()),
            ("Vector_001", json!(factor.map(|part| part as f32))),
            ("Vector_002", json!(added.map(|part| part as f32))),
        ];
        self.node("ShaderNodeVectorMath", json!({ "operation": "MULTIPLY_ADD" }), &inputs, "Vector")
    }

    /// A vector's length.
    pub fn length(&mut self, vector: &Input) -> Input {
        self.node("ShaderNodeVectorMath", json!({ "operation": "LENGTH" }), &[("Vector", vector.json())], "Value")
    }

    /// Gradient noise of `scale` times a place, as 0.5 + 0.5 g with g in about [-1, 1], of octaves with half the amplitude each.
    pub fn gradient_noise(&mut self, place: &Input, scale: f64, octaves: u32) -> Input {
        let inputs = [
            ("Vector", place.json()),
            ("Scale", Input::Number(scale).json()),
            ("Detail", json!(octaves.saturating_sub(1) as f32)),
            ("Roughness", json!(0.5)),
            ("Lacunarity", json!(2.0)),
            ("Distortion", json!(0.0)),
        ];
        let properties = json!({ "noise_dimensions": "3D", "noise_type": "FBM", "normalize": true });
        self.node("ShaderNodeTexNoise", properties, &inputs, "Fac")
    }

    /// 1 minus the distance to the nearest feature point, at most 1, of `scale` times a place: one point in each cell.
    pub fn cells(&mut self, place: &Input, scale: f64) -> Input {
        let inputs = [
            ("Vector", place.json()),
            ("Scale", Input::Number(scale).json()),
            ("Detail", json!(0.0)),
            ("Randomness", json!(1.0)),
        ];
        let properties = json!({
            "voronoi_dimensions": "3D", "distance": "EUCLIDEAN", "feature": "F1", "normalize": false
        });
        let distance = self.node("ShaderNodeTexVoronoi", properties, &inputs, "Distance");
        self.calculated("SUBTRACT", &[1.0.into(), distance], true)
    }

    /// Noise on a lattice of ours ([`crate::nodes::lattice_noise`]).
    pub fn lattice_noise(&mut self, kind: &str, place: &Input) -> Input {
        self.node("cloudparity.LatticeNoise", json!({ "kind": kind }), &[("Vector", place.json())], "Value")
    }

    /// Soft ellipsoids, or spheres, of a field at a place in metres, y up ([`crate::nodes::ellipsoid_clusters`]).
    pub fn ellipsoids(&mut self, kind: &str, place: &Input, field: &ClusterField) -> Input {
        let ClusterField { seed, spread, base, height, radius, passed } = *field;
        let number = |value: f64| Input::Number(value).json();
        let inputs = [
            ("Vector", place.json()),
            ("Seed", number(seed)),
            ("Spread", number(spread)),
            ("Base", number(base)),
            ("Height", number(height)),
            ("Radius", number(radius)),
            ("Passed", number(passed)),
        ];
        self.node("cloudparity.EllipsoidClusters", json!({ "kind": kind }), &inputs, "Value")
    }

    /// Distances of (x, z), in cells, to the nearest and the second nearest of random points, one in each cell of a plane.
    pub fn nearest_two(&mut self, [x, z]: [&Input; 2]) -> [Input; 2] {
        let place = self.combine([x.clone(), z.clone(), 0.0.into()]);
        ["F1", "F2"].map(|feature| {
            let inputs =
                [("Vector", place.json()), ("Scale", json!(1.0)), ("Detail", json!(0.0)), ("Randomness", json!(1.0))];
            let properties = json!({
                "voronoi_dimensions": "2D", "distance": "EUCLIDEAN", "feature": feature, "normalize": false
            });
            self.node("ShaderNodeTexVoronoi", properties, &inputs, "Distance")
        })
    }

    /// `factor v + added` of two vectors.
    pub fn affine_to(&mut self, vector: &Input, factor: f64, added: &Input) -> Input {
        let factor = json!([factor as f32, factor as f32, factor as f32]);
        let inputs = [("Vector", vector.json()), ("Vector_001", factor), ("Vector_002", added.json())];
        self.node("ShaderNodeVectorMath", json!({ "operation": "MULTIPLY_ADD" }), &inputs, "Vector")
    }

    /// A published texture, read at a place in its periods ([`crate::nodes::cloud_texture`]).
    pub fn cloud_texture(&mut self, texture: &str, points: FeaturePoints, place: &Input) -> Input {
        let properties = json!({ TEXTURE: texture, FEATURE_POINTS: points.name() });
        self.node("cloudparity.CloudTexture", properties, &[("Vector", place.json())], "Value")
    }

    /// Sum of terms with weights.
    pub fn weighted(&mut self, terms: &[(f64, Input)]) -> Input {
        let mut sum: Option<Input> = None;
        for (weight, term) in terms {
            sum = Some(match sum {
                None => self.multiply(term, *weight),
                Some(sum) => self.multiply_add(term, *weight, sum),
            });
        }
        sum.unwrap_or(Input::Number(0.0))
    }

    /// The sum of two volumes.
    fn add_volumes(&mut self, a: &Input, b: &Input) -> Input {
        self.node("ShaderNodeAddShader", json!({}), &[("Shader", a.json()), ("Shader_001", b.json())], "Shader")
    }

    /// The graph of a material with a volume.
    fn finish(mut self, name: &str, volume: &Input) -> Result<Graph> {
        let properties = json!({ "is_active_output": true, "target": "ALL" });
        self.node("ShaderNodeOutputMaterial", properties, &[("Volume", volume.json())], "");
        serde_json::from_value(json!({ "material": name, "nodes": self.nodes, "groups": [] })).map_err(|cause| {
            Error::new(
                format!("the node graph of {name}"),
                cause.to_string(),
                "a graph of nodes",
                "Please report this: it is a mistake of the program.",
            )
        })
    }
}

/// The density of a system as a graph.
#[derive(Debug, Clone)]
pub struct GraphDensity {
    /// The nodes.
    pub graph: NodeGraph,
    /// The density.
    pub density: Input,
}

impl GraphDensity {
    /// As a program of the places in the object.
    pub fn program(&self, name: &str, scene: &Scene) -> Result<Program> {
        let mut graph = self.graph.clone();
        let inputs = [("Density", self.density.json())];
        let volume = graph.node("ShaderNodeVolumeScatter", json!({ "phase": "HENYEY_GREENSTEIN" }), &inputs, "Volume");
        Program::density(&scene_of(scene, graph.finish(name, &volume)?))
    }

    /// As a material: extinction and scattering per unit of density and metre, alike for all channels up to their colour, and the lobes of
    /// a phase function.
    pub fn material(
        &self,
        name: &str,
        extinction: [f64; 3],
        scattering: [f64; 3],
        lobes: &[ScatteringLobe],
    ) -> Result<Graph> {
        let mut graph = self.graph.clone();
        let mut volumes = Vec::new();
        let largest = |channels: [f64; 3]| channels.into_iter().fold(0.0, f64::max);
        let color = |channels: [f64; 3], whole: f64| {
            let part = |channel: usize| if whole > 0.0 { (channels[channel] / whole) as f32 } else { 0.0 };
            json!([part(0), part(1), part(2), 1.0])
        };
        let most = largest(scattering);
        for &ScatteringLobe { share, anisotropy, alpha } in lobes.iter().filter(|_| most > 0.0) {
            let density = graph.multiply(&self.density, most * share);
            let kind = if alpha == 0.0 { "HENYEY_GREENSTEIN" } else { "DRAINE" };
            let mut inputs = vec![
                ("Color", color(scattering, most)),
                ("Density", density.json()),
                ("Anisotropy", json!(anisotropy as f32)),
            ];
            if alpha != 0.0 {
                inputs.push(("Alpha", json!(alpha as f32)));
            }
            volumes.push(graph.node("ShaderNodeVolumeScatter", json!({ "phase": kind }), &inputs, "Volume"));
        }
        let absorbed: [f64; 3] = std::array::from_fn(|channel| (extinction[channel] - scattering[channel]).max(0.0));
        // What is left of roundings is nothing that absorbs.
        if largest(absorbed) > 1e-12 * largest(extinction) {
            let most = largest(absorbed);
            let density = graph.multiply(&self.density, most);
            // Blender's node absorbs 1 - colour.
            let kept = std::array::from_fn::<f64, 3, _>(|channel| most - absorbed[channel]);
            let inputs = [("Color", color(kept, most)), ("Density", density.json())];
            volumes.push(graph.node("ShaderNodeVolumeAbsorption", json!({}), &inputs, "Volume"));
        }
        let first = volumes.first().cloned().ok_or_else(|| {
            Error::new(
                format!("the material of {name}"),
                "a cloud that neither scatters nor absorbs",
                "an extinction above 0",
                "Raise the extinction.",
            )
        })?;
        let sum = volumes[1..].iter().fold(first, |sum, volume| graph.add_volumes(&sum, volume));
        graph.finish(name, &sum)
    }
}

/// The scene with a graph as the material of its only volume.
pub fn scene_of(scene: &Scene, graph: Graph) -> Scene {
    let mut changed = scene.clone();
    changed.volume.material.clone_from(&graph.material);
    changed.graph = GraphSource::Inline(graph);
    changed.other_volumes.clear();
    changed.other_graphs.clear();
    changed
}
