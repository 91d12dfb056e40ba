//! What long work tells while it runs.

/// What a run tells while it works: the fraction done, and of what.
pub type Progress<'a> = &'a (dyn Fn(f64, &str) + Sync);
