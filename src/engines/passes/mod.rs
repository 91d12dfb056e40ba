//! Passes over a finished picture.

pub mod god_rays;
