//! What long work tells while it runs.
//!
//! Beside it there is one way for what a caller should know and did not ask for, such as a part that is left out: a warning of the facade
//! [`log`], `log::warn!("PLACE: TEXT")`. The library prints nothing; the command line shows warnings on stderr, a window where it likes.

/// What a run tells while it works: the fraction done, and of what.
pub type Progress<'a> = &'a (dyn Fn(f64, &str) + Sync);
