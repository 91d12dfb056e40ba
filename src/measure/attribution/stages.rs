//! An engine whose stages can be made exact one by one.
//!
//! A stage is made exact by changing parts of the engine or of how its picture is made: there is no second renderer. What no engine computes, orders
//! of scattering behind the first and the light of the world that the medium scatters, comes from path tracing and is added
//! ([`super::components`]).

use crate::base::error::{Error, Result};
use crate::engines::defects::Defects;
use crate::engines::light::terms::Terms;
use crate::engines::light::{ShadowExtinction, ShadowLength, ShadowMarch, TwoLobes};
use crate::engines::march::distance_levels::DistanceLevels;
use crate::engines::march::{Leftover, RealTimeSettings};
use crate::engines::passes::compositing::Compositing;
use crate::engines::render::{EngineJitter, EngineSettings};
use crate::engines::{Engine, Selection};
use crate::measure::attribution::file::{Exact, Measured, Planted};
use crate::measure::attribution::stage::{Stage, Stages};
use crate::measure::combination::Combination;
use crate::media::transfer::Integration;
use crate::scene::{Projection, Scene, SensorFit};

/// An engine whose stages can be made exact one by one.
pub struct Staged<'a> {
    scene: &'a Scene,
    measured: &'a Measured,
    exact: Exact,
    combination: Combination,
    /// As it is, with what was planted in it: made once, since a density cache is baked for it.
    engine: Engine,
    /// The medium that the truth has: no cache, no defects, and no light model but its own.
    medium: Engine,
    /// Whether light of the suns is scattered more than once.
    has_orders: bool,
}

/// A picture to be made: its scene, its engine, how.
pub struct Made {
    /// Shifted where that was planted.
    pub scene: Scene,
    /// The engine.
    pub engine: Engine,
    /// Rays and jitter.
    pub settings: EngineSettings,
    /// Whether rays are those of path tracing, in every replica others.
    pub is_drawn: bool,
    /// What finished values are raised to.
    pub gamma: f64,
}

impl<'a> Staged<'a> {
    /// Of an engine in a scene.
    pub fn new(scene: &'a Scene, measured: &'a Measured, exact: Exact) -> Result<Self> {
        let combination = measured.combination(scene);
        let selection = Selection::parse(&measured.density)?;
        let medium = selection.engine(scene, &[], &Defects::NONE)?;
        let has_orders =
            scene.integrator.volume_bounces.min(scene.integrator.max_bounces) > 0 && !scene.lights.is_empty();
        let mut engine = combination.engine(scene, &[])?;
        let Planted { extinction, anisotropy, .. } = measured.plant;
        engine.extinction = engine.extinction.map(|channel| channel * extinction);
        engine.light.phase.anisotropy =
            engine.light.phase.anisotropy.map(|mean| (mean + anisotropy).clamp(-0.999, 0.999));
        Ok(Self { scene, measured, exact, combination, engine, medium, has_orders })
    }

    /// Whether a stage is exact: one of those that are made so, or given as exact.
    pub fn is_exact(&self, stages: &Stages, stage: Stage) -> bool {
        stages.contains(&stage) || self.measured.exact.contains(&stage)
    }

    /// The stages whose exact twin differs from what the engine does, without those that the engine is given as exact.
    pub fn differing(&self) -> Result<Vec<Stage>> {
        let engine = &self.engine;
        let exact = self.made(&Stage::ALL.iter().copied().collect())?.engine;
        let differs = |stage: Stage| match stage {
            Stage::Field => {
                self.combination.cache.cells > 0
                    || !engine.defects.is_none()
                    || engine.extinction != exact.extinction
                    || engine.light.source != exact.light.source
                    || engine.march.distance_levels.is_some()
            }
            Stage::Shadow => engine.light.shadow != exact.light.shadow,
            Stage::Phase => engine.light.phase != exact.light.phase,
            Stage::Orders => self.has_orders || engine.light.terms != without_orders(&engine.light.terms),
            Stage::Ambient => {
                scatters_world(self.scene) || !engine.terms.is_empty() || engine.light.terms.ground.is_some()
            }
            Stage::ViewRay => {
                let levels = engine.march.distance_levels;
                levels.is_some_and(|levels| levels != levels.corrected())
                    || RealTimeSettings { distance_levels: None, ..engine.march.clone() } != exact.march
            }
            // Drawn rays are none of an engine.
            Stage::Filter => true,
            Stage::Compositing => {
                engine.compositing != Compositing::default()
                    || !engine.passes.is_empty()
                    || engine.air.is_some()
                    || self.combination.god_rays
            }
            Stage::Display => self.measured.plant.gamma != 1.0,
        };
        Ok(Stage::ALL.iter().copied().filter(|stage| !self.measured.exact.contains(stage) && differs(*stage)).collect())
    }

    /// The picture with some stages exact, besides those that are given as exact.
    pub fn made(&self, stages: &Stages) -> Result<Made> {
        let is_exact = |stage: Stage| self.is_exact(stages, stage);
        let Exact { steps, light_steps, .. } = self.exact;
        let density = if is_exact(Stage::Field) { &self.medium.density } else { &self.engine.density };
        let mut engine = self.engine.with_density(density.clone());
        let mut settings = self.combination.picture_settings();
        let mut scene = self.scene.clone();
        if is_exact(Stage::Field) {
            engine.container = self.medium.container.clone();
            engine.extinction = self.medium.extinction;
            engine.light.source = self.medium.light.source;
            engine.march.distance_levels = None;
        }
        if is_exact(Stage::Shadow) {
            engine.light.shadow = ShadowMarch::new(light_steps, ShadowLength::ToExit, ShadowExtinction::View);
            // They read its map.
            if let Some(air) = &mut engine.air {
                air.shafts = None;
            }
        }
        if is_exact(Stage::Phase) {
            let TwoLobes { anisotropy, second, alpha, .. } = self.medium.light.phase;
            engine.light.phase = TwoLobes { alpha, ..TwoLobes::new(anisotropy, second) };
        }
        if is_exact(Stage::Orders) {
            engine.light.terms = without_orders(&engine.light.terms);
        }
        if is_exact(Stage::Ambient) {
            engine.light.terms.ambient = [0.0; 2];
            engine.light.terms.boost.ambient = 0.0;
            engine.light.terms.ground = None;
            engine.terms.clear();
        }
        if is_exact(Stage::ViewRay) {
            let distance_levels = engine.march.distance_levels.map(DistanceLevels::corrected);
            engine.march = RealTimeSettings {
                steps,
                integration: Integration::EnergyConserving,
                growth: 1.0,
                exit_fade: false,
                least_density: 0.0,
                least_transmittance: 0.0,
                leftover: Leftover::Kept,
                distance_levels,
                doubled_start: false,
            };
        }
        if is_exact(Stage::Filter) {
            // Rays are drawn, and places in their steps.
            settings.jitter = EngineJitter::None;
            settings.sub_pixels = 1;
        } else {
            shift(&mut scene, self.measured.plant.shift)?;
        }
        if is_exact(Stage::Compositing) {
            engine.compositing = Compositing::default();
            engine.passes.clear();
            engine.air = None;
            settings.god_rays = false;
        }
        let gamma = if is_exact(Stage::Display) { 1.0 } else { self.measured.plant.gamma };
        Ok(Made { scene, engine, settings, is_drawn: is_exact(Stage::Filter), gamma })
    }
}

/// Single scattering with the same ambient light.
fn without_orders(terms: &Terms) -> Terms {
    let ambient = terms.ambient.map(|factor| factor * terms.exposure);
    Terms { ambient, ground: terms.ground, ..Terms::NONE }
}

/// Whether a world shines on the medium.
pub fn scatters_world(scene: &Scene) -> bool {
    scene.world.strength != 0.0
        && (scene.world.image.is_some()
            || scene.world.graph.is_some()
            || scene.world.color.iter().any(|&channel| channel != 0.0))
}

/// Moves what the camera sees by so many pixels to the right and up.
fn shift(scene: &mut Scene, by: [f64; 2]) -> Result<()> {
    if by == [0.0; 2] {
        return Ok(());
    }
    if scene.camera.projection == Projection::Equirectangular {
        return Err(Error::new(
            format!("scene {}, camera", scene.name),
            "an equirectangular projection",
            "one that can be shifted by pixels",
            "Leave plant.shift out, or take another scene.",
        ));
    }
    let [width, height] = scene.image_size().map(f64::from);
    let fitted = match scene.camera.sensor_fit {
        SensorFit::Auto => width.max(height),
        SensorFit::Horizontal => width,
        SensorFit::Vertical => height,
    };
    // What the camera sees moves against it.
    (0..2).for_each(|axis| scene.camera.shift[axis] -= (by[axis] / fitted) as f32);
    Ok(())
}
