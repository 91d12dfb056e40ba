//! Passes over a finished picture.

pub mod compositing;
pub mod god_rays;
