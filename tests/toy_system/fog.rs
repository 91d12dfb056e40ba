//! A toy system as a folder of its own: fog of one density between two heights, which glows towards its top, seen through grey glass.

use cloudparity::base::error::Result;
use cloudparity::engines::defects::{Defect, Defects};
use cloudparity::engines::domain::{Domain, DomainKind};
use cloudparity::engines::light::terms::Terms;
use cloudparity::engines::light::{
    LightModel, LightTerm, Lit, ShadowExtinction, ShadowLength, ShadowMarch, SourceFactor, TwoLobes,
};
use cloudparity::engines::march::{Leftover, RealTimeSettings};
use cloudparity::engines::parameters::{Parameter, Range};
use cloudparity::engines::passes::compositing::Compositing;
use cloudparity::engines::passes::frame::Frame;
use cloudparity::engines::passes::god_rays::GodRays;
use cloudparity::engines::passes::{Channels, Compiling, Pass, PassKernel, View};
use cloudparity::engines::{Engine, Model, Request};
use cloudparity::gpu::{Bindings, ComputeKernel, Gpu};
use cloudparity::graph::Program;
use cloudparity::graph::wgsl::Linker;
use cloudparity::media::density::Density;
use cloudparity::media::transfer::Integration;
use cloudparity::scene::image::Image;
use std::sync::{Arc, OnceLock};

/// The system.
pub static MODEL: Model = Model {
    id: "toy-fog",
    title: "Fog between two heights",
    about: "A toy: one density, a glow that grows with the height, and a grey glass before the camera.",
    parameters: &[
        parameter("density", 0.25, "extinction in 1/m"),
        parameter("glow", 2.0, "radiance of the glow at the top"),
        parameter("glass", 0.5, "what the glass lets through"),
        parameter("march_steps", 64.0, "steps of a view ray"),
    ],
    qualities: &[("low", &[("march_steps", 4.0)])],
    defects: &[BRIGHT_GLASS],
    is_of_scene: false,
    domains: &[DomainKind::Slab, DomainKind::Object],
    sky: None,
    build,
};

/// The toy's only defect.
pub const BRIGHT_GLASS: Defect =
    Defect { id: "TF-1", about: "the glass lets everything through", corrected: "it lets through what it should" };

const fn parameter(name: &'static str, default: f64, about: &'static str) -> Parameter {
    Parameter { name, about, unit: "", range: Range::NotNegative, default, usual: [0.0, 2.0] }
}

fn build(request: &Request<'_>) -> Result<Engine> {
    let Request { values, defects, .. } = *request;
    let container = request.domain_or(Domain::Slab { bottom: -1.0, top: 1.0 })?;
    let density = Arc::new(Program::constant("fog", values.get("density") as f32));
    let glass = if defects.has(&BRIGHT_GLASS) { 1.0 } else { values.get("glass") as f32 };
    Ok(Engine {
        model: MODEL.id,
        defects: Defects::clone(defects),
        values: values.clone(),
        density: Density::filling(density, container.outline.region()),
        container,
        extinction: [1.0; 3],
        light: LightModel {
            suns: Vec::new(),
            ambient: [0.0; 3],
            phase: TwoLobes::new([0.0; 2], 0.0),
            shadow: ShadowMarch::new(1, ShadowLength::ToExit, ShadowExtinction::View),
            source: SourceFactor::Albedo([1.0; 3]),
            terms: Terms::NONE,
        },
        graph: None,
        terms: vec![Arc::new(Glow(values.get("glow")))],
        march: RealTimeSettings {
            steps: values.get("march_steps") as u32,
            integration: Integration::EnergyConserving,
            growth: 1.0,
            exit_fade: false,
            least_density: 0.0,
            leftover: Leftover::Kept,
            distance_levels: None,
            doubled_start: false,
            least_transmittance: 0.0,
        },
        compositing: Compositing::default(),
        passes: vec![Arc::new(Glass(glass))],
        god_rays: GodRays::default(),
        warnings: Vec::new(),
        averages: OnceLock::new(),
        light_volume: None,
        air: None,
    })
}

/// Radiance that grows linearly from the bottom to the top.
struct Glow(f64);

impl LightTerm for Glow {
    fn import_path(&self) -> &'static str {
        "toy::glow"
    }

    fn source(&self, at: &Lit) -> [f64; 3] {
        [self.0 * at.height; 3]
    }

    fn shader(&self) -> String {
        format!(
            "#define_import_path toy::glow\n\n\
             fn source(place: vec3f, height: f32, extinction: f32) -> vec3f {{ return vec3f({:?}f * height); }}\n",
            self.0 as f32
        )
    }
}

/// A pass that multiplies the colour by a factor.
struct Glass(f32);

impl Pass for Glass {
    fn id(&self) -> &'static str {
        "toy-glass"
    }

    fn settings(&self) -> String {
        self.0.to_string()
    }

    fn needs(&self) -> Channels {
        Channels::default()
    }

    fn run(&self, frame: &mut Image, _: &View<'_>) -> Result<()> {
        for pixel in &mut frame.pixels {
            pixel[..3].iter_mut().for_each(|channel| *channel *= self.0);
        }
        Ok(())
    }

    fn compile<'a>(&self, gpu: &'a Gpu) -> Compiling<'a> {
        let source = format!(
            "@group(0) @binding(0) var<storage, read_write> colour: array<vec4f>;\n\n\
             @compute @workgroup_size(64)\n\
             fn main(@builtin(global_invocation_id) invocation: vec3u) {{\n\
                 if invocation.x >= arrayLength(&colour) {{ return; }}\n\
                 let pixel = colour[invocation.x];\n\
                 colour[invocation.x] = vec4f(pixel.rgb * {:?}f, pixel.a);\n\
             }}\n",
            self.0
        );
        Box::pin(async move {
            let module = Linker::bare().link("toy/glass.wgsl", &source)?;
            let kernel = gpu.kernel_async("toy_glass", &module, &[]).await?;
            Ok(Box::new(GlassKernel { gpu, kernel }) as Box<dyn PassKernel + 'a>)
        })
    }
}

struct GlassKernel<'a> {
    gpu: &'a Gpu,
    kernel: ComputeKernel,
}

impl PassKernel for GlassKernel<'_> {
    fn run(&self, frame: &Frame, _: &View<'_>) -> Result<()> {
        self.gpu.dispatch(&self.kernel, &Bindings::new().group(0, [&frame.colour]), [frame.pixels(), 1, 1])
    }
}
