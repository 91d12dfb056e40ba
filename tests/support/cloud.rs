//! The Perlin-FBM cloud in a box of its own, as its published engine has it.

use cloudparity::engines::domain::{Container, Domain, Outline};
use cloudparity::engines::light::LightModel;
use cloudparity::engines::march::Marched;
use cloudparity::engines::perlin_fbm;
use cloudparity::graph::Program;
use cloudparity::media::density::Density;
use cloudparity::media::region::Region;
use cloudparity::nodes::perlin_fbm::{Cloud, PARAMETERS, TYPE};
use cloudparity::nodes::{Data, Mode};
use glam::{DMat4, DVec3, DVec4};
use std::sync::Arc;

/// A box of side 1 around the origin, in a world whose y axis points up, as the published engine's does: x is x, y is z and z is -y.
pub fn local_box() -> Container {
    let to_local = DMat4::from_cols(DVec4::X, DVec4::Z, DVec4::NEG_Y, DVec4::W);
    Container { domain: Domain::Object, to_local, outline: Outline::Box(region()), unit: 1.0 }
}

fn region() -> Region {
    Region { low: DVec3::splat(-0.5), high: DVec3::splat(0.5) }
}

/// The program of a cloud at places of its own local box, or at places that rows of four lead to such.
pub fn program(cloud: Arc<Cloud>, to_local: [[f32; 4]; 3]) -> Program {
    let mode = Mode::of_data(&TYPE, vec![(PARAMETERS, Data::PerlinFbm(cloud))]);
    Program::of_node("Perlin-FBM cloud", &TYPE, mode, to_local)
}

/// A cloud in a box, ready to be marched.
pub struct Boxed {
    container: Container,
    density: Density,
    extinction: [f64; 3],
}

impl Boxed {
    /// As the engine has it, of an opacity per unit of density and side of the box.
    pub fn new(cloud: Cloud, opacity: f64) -> Self {
        let container = local_box();
        let density = perlin_fbm::density(cloud, &container).expect("a density");
        Self { container, density, extinction: perlin_fbm::TINT.map(|tint| tint * opacity) }
    }

    /// The same without a table of empty cells, which costs far more time than a small picture.
    pub fn filling(cloud: &Arc<Cloud>, opacity: f64) -> Self {
        let turned = [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0]];
        let density = Density::filling(Arc::new(program(Arc::clone(cloud), turned)), region());
        Self { container: local_box(), density, extinction: perlin_fbm::TINT.map(|tint| tint * opacity) }
    }

    /// What a march goes through.
    pub fn marched<'a>(&'a self, light: &'a LightModel) -> Marched<'a> {
        let Self { container, density, extinction } = self;
        Marched {
            container,
            density,
            extinction: *extinction,
            averages: None,
            maps: &[],
            light,
            terms: &[],
            light_volume: None,
            air: None,
        }
    }
}
