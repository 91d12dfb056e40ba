//! The folder that keeps what is fetched or rendered once: references, releases of Blender.

use crate::base::error::{Error, Result};
use std::path::{Path, PathBuf};

/// Environment variable that names the folder.
pub const CACHE_VARIABLE: &str = "CLOUDPARITY_CACHE";

/// `CLOUDPARITY_CACHE`, else `~/.cache/cloudparity`.
pub fn cache_folder() -> Result<PathBuf> {
    if let Some(folder) = std::env::var_os(CACHE_VARIABLE) {
        return Ok(PathBuf::from(folder));
    }
    std::env::home_dir().map(|home| Path::new(&home).join(".cache/cloudparity")).ok_or_else(|| {
        Error::new(
            "cache folder",
            "no home folder",
            "a place to keep references",
            format!("Set {CACHE_VARIABLE} to a folder."),
        )
    })
}
