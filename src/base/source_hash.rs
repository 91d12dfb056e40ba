//! The hash of the sources, from which a build has its identity. The build script computes it; the program holds the result.
//!
//! It is the SHA-256 over the files of [`PARTS`] in the order of their paths: for each the length of its path, the path below the
//! checkout with `/` between its parts, the length of its content and the content. Line ends count as `\n`, so that a checkout with
//! `\r\n` has the same hash. What programs leave beside sources (hidden files, `__pycache__`, names that end in `~`) does not count, and
//! neither do times, permissions, the place of the checkout or whether git is there.

use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// What decides a result: files and folders below the checkout.
pub const PARTS: [&str; 4] = ["src", "shaders", "blend", "Cargo.lock"];

/// The hash of the sources below `root`, as 64 hexadecimal digits. A part that is not there has no files.
pub fn of_tree(root: &Path) -> std::io::Result<String> {
    let mut files = Vec::new();
    for part in PARTS {
        let path = root.join(part);
        if path.exists() {
            collect(&path, part.to_owned(), &mut files)?;
        }
    }
    files.sort();
    let mut hash = Sha256::new();
    for (name, path) in files {
        let content = with_plain_line_ends(std::fs::read(path)?);
        for bytes in [name.as_bytes(), &content] {
            hash.update((bytes.len() as u64).to_le_bytes());
            hash.update(bytes);
        }
    }
    Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Files at and below `path`, with their names below the checkout.
fn collect(path: &Path, name: String, files: &mut Vec<(String, PathBuf)>) -> std::io::Result<()> {
    if !path.is_dir() {
        files.push((name, path.to_owned()));
        return Ok(());
    }
    for entry in std::fs::read_dir(path)? {
        let entry = entry?;
        let own = entry.file_name().to_string_lossy().into_owned();
        if own.starts_with('.') || own.ends_with('~') || own == "__pycache__" {
            continue;
        }
        collect(&entry.path(), format!("{name}/{own}"), files)?;
    }
    Ok(())
}

/// `\r\n` as `\n`.
fn with_plain_line_ends(content: Vec<u8>) -> Vec<u8> {
    let mut plain = Vec::with_capacity(content.len());
    for (index, &byte) in content.iter().enumerate() {
        if !(byte == b'\r' && content.get(index + 1) == Some(&b'\n')) {
            plain.push(byte);
        }
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checkout() -> &'static Path {
        Path::new(env!("CARGO_MANIFEST_DIR"))
    }

    /// A copy of the sources, each file changed by `change`.
    fn copied(change: impl Fn(&str, Vec<u8>) -> Vec<u8>) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        let mut files = Vec::new();
        for part in PARTS {
            collect(&checkout().join(part), part.to_owned(), &mut files).expect("the sources are read");
        }
        assert!(files.len() > 300, "{} files", files.len());
        for (name, path) in files {
            let copy = folder.path().join(&name);
            std::fs::create_dir_all(copy.parent().expect("a folder above it")).expect("made");
            std::fs::write(&copy, change(&name, std::fs::read(path).expect("read"))).expect("written");
        }
        folder
    }

    #[test]
    fn the_programs_identity_is_the_hash_of_these_sources_wherever_they_lie() {
        let copy = copied(|_, content| content);
        let found = of_tree(copy.path()).expect("a hash");
        assert_eq!(found, of_tree(checkout()).expect("a hash"));
        assert!(crate::base::identity::Identity::current().full().ends_with(&found));
    }

    #[test]
    fn a_constant_of_one_shader_makes_another_identity() {
        let whole = of_tree(checkout()).expect("a hash");
        let changed = copied(|name, content| {
            if name != "shaders/nodes/voronoi_texture.wgsl" {
                return content;
            }
            let text = String::from_utf8(content).expect("a shader is text");
            let other = text.replacen("1.0", "1.5", 1);
            assert_ne!(text, other, "the shader has a constant");
            other.into_bytes()
        });
        assert_ne!(of_tree(changed.path()).expect("a hash"), whole);
    }

    #[test]
    fn a_file_more_or_renamed_counts_and_line_ends_and_leftovers_do_not() {
        let whole = of_tree(checkout()).expect("a hash");
        let copy = copied(|_, content| {
            let text = String::from_utf8(content).expect("sources are text");
            text.replace("\r\n", "\n").replace('\n', "\r\n").into_bytes()
        });
        let root = copy.path();
        std::fs::create_dir(root.join("blend/__pycache__")).expect("made");
        for left in ["blend/__pycache__/rna.pyc", "src/.lib.rs.swp", "src/lib.rs~", "README.md"] {
            std::fs::write(root.join(left), "left over").expect("written");
        }
        assert_eq!(of_tree(root).expect("a hash"), whole);
        std::fs::rename(root.join("blend/rna.py"), root.join("blend/rna2.py")).expect("renamed");
        let renamed = of_tree(root).expect("a hash");
        assert_ne!(renamed, whole);
        std::fs::rename(root.join("blend/rna2.py"), root.join("blend/rna.py")).expect("renamed");
        std::fs::write(root.join("shaders/more.wgsl"), "").expect("written");
        assert_ne!(of_tree(root).expect("a hash"), whole);
    }
}
