//! Passes over a picture that has been marched and composed: each reads and changes a whole frame.
//!
//! A pass has a form for a picture in memory and a kernel for a [`Frame`] on the adapter, where it stays: neither reads back or waits.
//! What a pass needs beside the colour, and what it allocates, is there only where it is listed.

pub mod compositing;
pub mod frame;
pub mod god_rays;
pub mod height_fog;

use crate::base::error::Result;
use crate::engines::light::Sun;
use crate::engines::passes::frame::Frame;
use crate::gpu::Gpu;
use crate::scene::image::Image;
use crate::view::camera::Camera;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::pin::Pin;

/// A pass as a list of them names it.
pub struct NamedPass {
    /// Its name.
    pub id: &'static str,
    /// What it does and where it comes from.
    pub about: &'static str,
    /// How a picture gets it.
    pub how: &'static str,
    /// Beginning of the names of the systems' parameters that are its own; none where it has none.
    pub prefix: Option<&'static str>,
}

/// All passes, those that are made ray by ray included ([`crate::engines::march::air`]).
pub const PASSES: &[NamedPass] = &[
    NamedPass {
        id: "aerial-perspective",
        about: "air that dims and brightens the cloud by its distance: Rayleigh's and haze (takram)",
        how: "the parameter aerial_perspective",
        prefix: Some("aerial_perspective"),
    },
    NamedPass {
        id: "haze",
        about: "haze that falls with the height, in front of cloud and background (takram; defect TK-18)",
        how: "the parameter haze",
        prefix: Some("haze"),
    },
    NamedPass {
        id: "shafts",
        about: "the cloud's shadow in haze and aerial perspective, from its shadow map (takram; defect TK-11)",
        how: "the parameter shafts",
        prefix: Some("shafts"),
    },
    NamedPass {
        id: "march-rays",
        about: "god rays summed up along the first 500 m of each ray (boltbestclouds32; defect BO-15)",
        how: "the parameter march_ray_intensity",
        prefix: Some("march_ray_"),
    },
    NamedPass {
        id: "compositing",
        about: "the cloud over its background: premultiplied, or as published engines do it (defects PF-7, PF-8, BO-2)",
        how: "always",
        prefix: None,
    },
    NamedPass {
        id: "god-rays",
        about: "a radial blur, at half the resolution, of what hides the sun (Mitchell 2007, GPU Gems 3)",
        how: "the option god rays of a picture, god_rays of a study; each system with its own constants",
        prefix: Some("god_ray_"),
    },
    NamedPass {
        id: "height-fog",
        about: "a colour by the distance of the background and the height of the view, tinted by the sun (boltbestclouds32; defect MS-2)",
        how: "the parameter fog",
        prefix: Some("fog"),
    },
    NamedPass {
        id: "reconstruction",
        about: "a frame from fewer rays: half, quarter, checkerboard, 4 x 4 Bayer, temporal blend; reprojected and clipped",
        how: "a sequence file (cloudparity measure sequence)",
        prefix: None,
    },
];

/// What a frame holds beside its colour.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Channels {
    /// Share of a background that red, green and blue let through.
    pub transmittance: bool,
}

impl Channels {
    /// What either asks for.
    pub fn and(self, other: Self) -> Self {
        Self { transmittance: self.transmittance || other.transmittance }
    }

    /// What all passes of a list need.
    pub fn of<P: AsRef<dyn Pass>>(passes: &[P]) -> Self {
        passes.iter().map(|pass| pass.as_ref().needs()).fold(Self::default(), Self::and)
    }
}

/// What passes know of how a frame was made.
pub struct View<'a> {
    /// The camera of the frame, for the frame's size.
    pub camera: &'a Camera,
    /// The film's factor on radiance, which the frame's colour has already.
    pub exposure: f64,
    /// The suns.
    pub suns: &'a [Sun],
    /// Middle of the medium in world space.
    pub centre: DVec3,
    /// Metres of the engine's unit of length.
    pub side: f64,
}

/// A pass.
pub trait Pass: Send + Sync {
    /// Its name in provenance.
    fn id(&self) -> &'static str;

    /// Its settings as JSON, for provenance.
    fn settings(&self) -> String;

    /// What it reads of a frame beside the colour.
    fn needs(&self) -> Channels;

    /// Changes a picture in memory, which holds what the pass needs.
    fn run(&self, frame: &mut Image, view: &View<'_>) -> Result<()>;

    /// Its kernel; what it allocates for frames is allocated when it runs.
    fn compile<'a>(&self, gpu: &'a Gpu) -> Compiling<'a>;
}

/// A pass on its way to an adapter.
pub type Compiling<'a> = Pin<Box<dyn Future<Output = Result<Box<dyn PassKernel + 'a>>> + 'a>>;

/// A pass on the adapter.
pub trait PassKernel: Send + Sync {
    /// Submits the work that changes a frame, which holds what the pass needs; waits for nothing.
    fn run(&self, frame: &Frame, view: &View<'_>) -> Result<()>;
}
