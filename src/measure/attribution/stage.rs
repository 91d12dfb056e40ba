//! Stages of an engine's picture.

use crate::base::choice::choice;
use std::collections::BTreeSet;

choice! {
    "kebab-case",
    /// A stage of a picture.
    #[derive(PartialOrd, Ord, Hash)]
    pub enum Stage {
        /// The medium: density with its cache, filter, octaves and defects, extinction, single-scattering albedo.
        Field,
        /// Transmittance towards the suns.
        Shadow,
        /// The phase function.
        Phase,
        /// Orders of scattering behind the first, and what imitates them.
        Orders,
        /// Light of the world that the medium scatters.
        Ambient,
        /// Integration along the view ray.
        ViewRay,
        /// The pixel filter and where samples lie in their steps.
        Filter,
        /// How rays are put over the background, passes over the picture, god rays.
        Compositing,
        /// What is done to finished values.
        Display,
    }
}

impl Stage {
    /// In words, for charts.
    pub fn title(self) -> &'static str {
        match self {
            Self::Field => "field and medium",
            Self::Shadow => "transmittance to the sun",
            Self::Phase => "phase function",
            Self::Orders => "orders of scattering",
            Self::Ambient => "light of the world",
            Self::ViewRay => "view-ray integration",
            Self::Filter => "pixel filter and jitter",
            Self::Compositing => "compositing and passes",
            Self::Display => "display",
        }
    }

    /// Every stage.
    pub const ALL: &[Self] = <Self as strum::VariantArray>::VARIANTS;
}

/// Stages that are exact.
pub type Stages = BTreeSet<Stage>;
