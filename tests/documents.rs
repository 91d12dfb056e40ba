//! What the documents list is what the program has.

mod support;

use cloudparity::nodes::registry;
use std::collections::BTreeSet;
use support::project;

fn read(path: &str) -> String {
    std::fs::read_to_string(project(path)).expect("the document is committed")
}

/// The names in the lists that a help shows, with what stands before them.
fn listed(command: &[&str]) -> Vec<String> {
    let output = assert_cmd::cargo::cargo_bin_cmd!("cloudparity")
        .args(command)
        .arg("--help")
        .output()
        .expect("the program runs");
    let text = String::from_utf8(output.stdout).expect("help is UTF-8");
    let names = text.lines().take_while(|line| !line.starts_with("Options:"));
    let names = names.filter_map(|line| line.strip_prefix("  ")?.split(' ').next()).filter(|name| !name.is_empty());
    names.map(|name| [command, &[name]].concat().join(" ")).collect()
}

#[test]
fn the_table_of_commands_lists_every_command_and_no_other() {
    let text = read("docs/commands.md");
    let rows: BTreeSet<String> = text
        .lines()
        .filter_map(|line| line.strip_prefix("| `cloudparity ")?.split('`').next())
        .map(|row| {
            row.split(' ')
                .take_while(|word| word.chars().all(|c| c.is_lowercase() || c == '-') && !word.starts_with('-'))
        })
        .map(|words| words.collect::<Vec<_>>().join(" "))
        .collect();
    let mut known = BTreeSet::new();
    for group in [&[][..], &["show"], &["measure"]] {
        let names = listed(group);
        assert!(names.len() > 6, "{names:?}");
        known.extend(names);
    }
    assert_eq!(rows, known);
}

#[test]
fn the_first_commands_of_the_readme_work() {
    if !support::require("bpy") {
        return;
    }
    let text = read("README.md");
    let (_, block) = text.split_once("## Your own .blend\n\n```sh\n").expect("the section");
    let (block, _) = block.split_once("```").expect("its end");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let run = |arguments: &[&str]| {
        let mut command = assert_cmd::cargo::cargo_bin_cmd!("cloudparity");
        let output = command.current_dir(folder.path()).args(arguments).output().expect("the program runs");
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).expect("text")
    };
    let scene = project("parity/scenes/noise-anisotropic.scene.json");
    run(&["export", &scene.to_string_lossy(), "-o", "CLOUD.blend"]);
    let mut commands = Vec::new();
    for line in block.lines() {
        let (command, _) = line.split_once('#').expect("each says what it does");
        let mut arguments: Vec<&str> = command.split_whitespace().skip(1).collect();
        commands.push(arguments[0]);
        // As the README has it, but small.
        match arguments[0] {
            "render" => arguments.extend(["--resolution", "16x9", "--samples", "2"]),
            "study" => arguments.push("--list"),
            "report" => continue,
            _ => {}
        }
        run(&arguments);
    }
    assert_eq!(commands, ["init", "render", "study", "report"]);
    assert!(folder.path().join("CLOUD/picture.png").is_file() && folder.path().join("CLOUD/picture.exr").is_file());
}

#[test]
fn the_scene_of_the_documentation_is_rendered() {
    let text = read("docs/scene-format.md");
    let (_, example) = text.split_once("```json\n").expect("an example");
    let (example, _) = example.split_once("```").expect("its end");
    assert!(example.lines().count() <= 20, "a short example");
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("fog.scene.json"), example).expect("written");
    let run = |arguments: &[&str]| {
        let mut command = assert_cmd::cargo::cargo_bin_cmd!("cloudparity");
        let output = command.current_dir(folder.path()).args(arguments).output().expect("the program runs");
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).expect("text")
    };
    let params = run(&["params", "fog.scene.json"]);
    assert!(params.lines().any(|line| line.starts_with("Noise.Scale ") && line.contains(" 2")), "{params}");
    run(&["explain", "fog.scene.json"]);
    run(&[
        "render",
        "fog.scene.json",
        "-o",
        "fog.exr",
        "--integrator",
        "path",
        "--samples",
        "4",
        "--resolution",
        "32x18",
    ]);
    let scene = cloudparity::scene::Scene::load(&folder.path().join("fog.scene.json")).expect("it loads");
    assert_eq!((scene.name.as_str(), scene.volume.material.as_str()), ("fog", "Fog"));
    let picture = cloudparity::scene::image::Image::read_exr(&folder.path().join("fog.exr")).expect("a picture");
    // The middle is seen through two metres of fog, the corners are the world's.
    assert!(picture.pixels[9 * 32 + 16] != picture.pixels[0], "the fog is seen");
}

#[test]
fn the_scene_format_lists_every_node_of_blender_that_evaluates_and_no_other() {
    let text = read("docs/scene-format.md");
    let (_, table) = text.split_once("### Nodes that evaluate").expect("the section is there");
    let rows: BTreeSet<(&str, &str)> = table
        .lines()
        .filter(|line| line.starts_with("| `"))
        .map(|line| {
            let cells: Vec<&str> = line.split('|').map(str::trim).collect();
            (cells[1].trim_matches('`'), cells[2])
        })
        .collect();
    let known: BTreeSet<(&str, &str)> = registry()
        .iter()
        .filter(|node| node.type_name.starts_with("ShaderNode"))
        .map(|node| (node.type_name, node.label))
        .collect();
    assert_eq!(rows, known);
}

#[test]
fn the_architecture_gives_a_reason_for_every_dependency() {
    let text = read("ARCHITECTURE.md");
    let (_, tables) = text.split_once("## Dependencies").expect("the section is there");
    let named: BTreeSet<&str> = tables
        .lines()
        .filter_map(|line| line.strip_prefix('|')?.split('|').next())
        .flat_map(|cell| cell.split('`').skip(1).step_by(2))
        .collect();
    let manifest = read("Cargo.toml");
    let crates = manifest
        .split("\n[")
        // Those of some systems alone have a section that begins with `target`.
        .filter(|section| {
            ["dependencies]", "dev-dependencies]", "target."].iter().any(|head| section.starts_with(head))
        })
        .flat_map(|section| section.lines().skip(1))
        .filter_map(|line| Some(line.split_once(" = ")?.0));
    let requirements =
        ["", "-dev", "-sweep", "-third-opinion"].map(|part| read(&format!("requirements{part}.txt"))).concat();
    let packages = requirements.lines().filter_map(|line| Some(line.split_once("==")?.0));
    let used: BTreeSet<&str> = crates.chain(packages).collect();
    assert_eq!(named, used);
}
