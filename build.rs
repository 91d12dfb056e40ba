//! Hands the hash of the sources to the program (`src/base/source_hash.rs` says what counts).

#[path = "src/base/source_hash.rs"]
mod source_hash;

use std::path::PathBuf;

fn main() {
    let root = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").expect("Cargo names the folder of the package"));
    // Cargo looks into folders, and notices files that come and go.
    for part in source_hash::PARTS.iter().filter(|part| root.join(part).exists()) {
        println!("cargo:rerun-if-changed={part}");
    }
    println!("cargo:rerun-if-changed=build.rs");
    let hash = source_hash::of_tree(&root).expect("the sources of the program are readable");
    println!("cargo:rustc-env=CLOUDPARITY_SOURCES_SHA256={hash}");
    // Provenance names the compiler; one that does not answer is not guessed.
    let compiler = std::env::var_os("RUSTC").expect("Cargo names the compiler");
    let answer = std::process::Command::new(compiler).arg("--version").output();
    let version = answer
        .ok()
        .filter(|found| found.status.success())
        .map_or("rustc, version unknown".into(), |found| String::from_utf8_lossy(&found.stdout).trim().to_owned());
    println!("cargo:rustc-env=CLOUDPARITY_COMPILER={version}");
}
