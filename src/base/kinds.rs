//! What kind of file a path is, told by its first bytes or its name: so that a .blend where a scene is wanted is not called broken JSON.

use crate::base::error::{Error, Result};
use crate::base::files;
use std::io::Read;
use std::path::Path;

/// A kind of file, or a folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// Blender's.
    Blend,
    /// An OpenEXR picture.
    Exr,
    /// A PNG picture.
    Png,
    /// An OpenVDB file.
    Vdb,
    /// A NumPy array.
    Npy,
    /// `*.scene.json`.
    Scene,
    /// `*.study.toml`.
    Study,
    /// `*.sequence.toml`.
    Sequence,
    /// `*.attribution.toml`.
    Attribution,
    /// `*.tune.toml`.
    Tuning,
    /// `*.preset.json`.
    Preset,
    /// A folder.
    Folder,
}

impl FileKind {
    /// The kind of what lies at a path; none where that is not known, or nothing can be read there.
    pub fn of(path: &Path) -> Option<Self> {
        if path.is_dir() {
            return Some(Self::Folder);
        }
        let mut start = Vec::new();
        files::open_input(path, "").ok()?.take(16).read_to_end(&mut start).ok()?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        // The OpenEXR and PNG signatures; OpenVDB's first four of eight bytes; Blender's name, or a compressed file that is called so.
        let by_bytes: [(&[u8], Self); 5] = [
            (b"\x76\x2f\x31\x01", Self::Exr),
            (b"\x89PNG\r\n\x1a\n", Self::Png),
            (b"\x20\x42\x44\x56", Self::Vdb),
            (b"\x93NUMPY", Self::Npy),
            (b"BLENDER", Self::Blend),
        ];
        let by_name = [
            (".scene.json", Self::Scene),
            (".study.toml", Self::Study),
            (".sequence.toml", Self::Sequence),
            (".attribution.toml", Self::Attribution),
            (".tune.toml", Self::Tuning),
            (".preset.json", Self::Preset),
            (".blend", Self::Blend),
        ];
        let found = by_bytes.into_iter().find(|(bytes, _)| start.starts_with(bytes)).map(|(_, kind)| kind);
        found.or_else(|| by_name.into_iter().find(|(ending, _)| name.ends_with(ending)).map(|(_, kind)| kind))
    }

    /// In words.
    pub fn described(self) -> &'static str {
        match self {
            Self::Blend => "a .blend",
            Self::Exr => "an OpenEXR picture",
            Self::Png => "a PNG picture",
            Self::Vdb => "an OpenVDB file",
            Self::Npy => "a NumPy array",
            Self::Scene => "a scene file (*.scene.json)",
            Self::Study => "a study file (*.study.toml)",
            Self::Sequence => "a sequence file (*.sequence.toml)",
            Self::Attribution => "an attribution file (*.attribution.toml)",
            Self::Tuning => "a tuning file (*.tune.toml)",
            Self::Preset => "a preset (*.preset.json)",
            Self::Folder => "a folder",
        }
    }

    /// What is done with it.
    fn use_of(self, path: &Path) -> String {
        let path = path.display();
        match self {
            Self::Blend => format!("Make a scene file of it first: cloudparity init {path}"),
            Self::Exr => {
                "Pictures are compared by cloudparity diff, and made PNGs by cloudparity export; name the other file here"
                    .into()
            }
            Self::Png => "A PNG has no scene-linear values; name the EXR beside it, or the other file".into(),
            Self::Vdb => {
                "A grid is read through the scene file of its Volume object; cloudparity export makes it".into()
            }
            Self::Npy => "Points go to cloudparity eval, beside a scene; name the other file here".into(),
            Self::Scene => format!("A scene is rendered by cloudparity render {path} -o PICTURE.exr"),
            Self::Study => format!("A study is run by cloudparity study {path} -o FOLDER"),
            Self::Sequence => format!("A sequence is run by cloudparity measure sequence {path} -o FOLDER"),
            Self::Attribution => format!("An attribution is run by cloudparity measure attribution {path} -o FOLDER"),
            Self::Tuning => format!("A tuning is run by cloudparity tune {path} -o FOLDER"),
            Self::Preset => {
                "A preset is rendered by cloudparity render, beside a scene; name the other file here".into()
            }
            Self::Folder => "Name the file in it".into(),
        }
    }
}

/// Refuses a file of another kind than is wanted, and says what it is for. What has no kind that is known is left to its reader.
/// What is no file at all, such as a pipe, is refused, too.
pub fn want(path: &Path, wanted: FileKind) -> Result<()> {
    files::check_input(path, wanted.described())?;
    match FileKind::of(path) {
        Some(found) if found != wanted => {
            Err(Error::new(path.display().to_string(), found.described(), wanted.described(), found.use_of(path) + "."))
        }
        _ => Ok(()),
    }
}
