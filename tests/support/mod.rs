//! What integration tests share: optional requirements and the committed scenes.
#![allow(dead_code, reason = "each test file uses a part of it")]

pub mod cloud;
pub mod cube;
pub mod estimate;
pub mod graphs;
pub mod meshes;
pub mod published;
pub mod rounding;

use cloudparity::scene::Scene;
use std::path::{Path, PathBuf};

/// Whether an optional requirement ("bpy", "vulkan", "cma", "unshare", "spirv-tools", "pdflatex") is there. When it is not, says so and returns
/// false; panics instead when `CLOUDPARITY_REQUIRE` names it, so that CI cannot skip by accident.
pub fn require(what: &str) -> bool {
    let there = match what {
        "bpy" => {
            cloudparity::bridge::install();
            cloudparity::bridge::has_bpy()
        }
        "vulkan" => cloudparity::gpu::Gpu::open().is_ok(),
        // What the optimiser of a tuning imports.
        "cma" => cloudparity::bridge::module_version("cma, flip_evaluator, scipy", "cma.__version__").is_ok(),
        // Disks of its own for a process without privileges.
        "unshare" => std::process::Command::new("unshare")
            .args(["--user", "--map-root-user", "--mount", "mount", "-t", "tmpfs", "tmpfs", "/mnt"])
            .output()
            .is_ok_and(|output| output.status.success()),
        // Debian packages spirv-tools and glslang-tools.
        "spirv-tools" => ["spirv-val", "glslangValidator"].iter().all(|program| {
            std::process::Command::new(program).arg("--version").output().is_ok_and(|output| output.status.success())
        }),
        // Debian packages texlive-latex-extra and texlive-science (booktabs, tabularx, longtable, siunitx), poppler-utils.
        "pdflatex" => {
            let packages = ["siunitx.sty", "booktabs.sty", "longtable.sty", "tabularx.sty"];
            let found = std::process::Command::new("kpsewhich").args(packages).output();
            let lines = found.map_or(0, |found| String::from_utf8_lossy(&found.stdout).lines().count());
            let answers = |program: &str, argument: &str| {
                std::process::Command::new(program).arg(argument).output().is_ok_and(|output| output.status.success())
            };
            lines == packages.len() && answers("pdflatex", "--version") && answers("pdffonts", "-v")
        }
        other => panic!("unknown requirement {other}"),
    };
    if !there {
        let required = std::env::var("CLOUDPARITY_REQUIRE").unwrap_or_default();
        assert!(!required.split(',').any(|name| name.trim() == what), "{what} is required and missing");
        eprintln!("skipped: {what} is missing");
    }
    there
}

/// A path inside the project.
pub fn project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// A committed scene by its stem.
pub fn scene(stem: &str) -> Scene {
    Scene::load(&project(&format!("parity/scenes/{stem}.scene.json"))).expect("a committed scene loads")
}
