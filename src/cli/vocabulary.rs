//! The words of the command line: an option means one thing, whatever the command. docs/options.md is their list.

use clap::Command;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// Options of several commands: the name, the values, and words of which each description has one.
const SHARED: &[(&str, &[&str], &[&str])] = &[
    ("backend", &["BACKEND"], &["where it runs", "all cores, the adapter"]),
    ("background", &["R,G,B"], &["behind a transparent film"]),
    ("blender", &["RELEASE"], &["release of blender", "release whose values"]),
    ("summary", &["FILE"], &["line per mode", "which releases have the values"]),
    ("cache-filter", &["CACHE_FILTER"], &["density cache is read"]),
    ("cache-format", &["CACHE_FORMAT"], &["density cache stores"]),
    ("camera", &["NAME"], &["camera to look through"]),
    ("defects", &["NAMES"], &["defects of the original that are kept"]),
    ("density-cache", &["CELLS"], &["cells along its longest side"]),
    ("domain", &["DOMAIN"], &["where the density is"]),
    ("exit-transmittance", &["TRANSMITTANCE"], &["view rays end below"]),
    ("exposure", &["STOPS"], &["stops"]),
    ("light-volume", &["CELLS"], &["beforehand"]),
    ("light-volume-bands", &["N"], &["largest band of spherical harmonics"]),
    ("light-volume-paths", &["N"], &["paths from each vertex"]),
    ("light-volume-shadow-cells", &["CELLS"], &["what lies towards the suns"]),
    ("film-transparent", &["true|false"], &["world out of what the camera sees"]),
    ("frame", &["FRAME"], &["frame of the .blend"]),
    ("gamma", &["GAMMA"], &["raised to 1 / gamma"]),
    ("generic", &[], &["leave nothing out"]),
    ("god-rays", &[], &["god rays"]),
    ("integration", &["INTEGRATION"], &["how a step adds up"]),
    ("jitter", &["NAME"], &["where within its steps"]),
    ("jitter-frame", &["N"], &["frame of the jitter"]),
    ("include-hidden", &[], &["volumes, too, that are hidden"]),
    ("json", &[], &["json instead of text"]),
    ("light", &["MODEL"], &["light model in the place of the system's"]),
    ("light-parameter", &["NAME=VALUE"], &["parameter of the light model"]),
    ("look", &["NAME"], &["look"]),
    ("material", &["NAME"], &["this material on a cube"]),
    ("max-relmse", &["ERROR"], &["relative mean squared error"]),
    ("merge", &["DIR"], &["take over the records"]),
    ("mix-builds", &[], &["what another build of the program left"]),
    ("model", &["MODEL"], &["density model", "cloud system"]),
    ("node", &["LABEL"], &["only this node"]),
    ("object", &["NAME"], &["an object with a volume material"]),
    ("only", &["NAME", "LIST"], &["only this entry", "by name"]),
    ("only-merge", &[], &["do no job"]),
    ("output", &["FILE", "DIR"], &["write", "file", "folder"]),
    ("parameter", &["NAME=VALUE"], &["parameter of the model", "parameter of the system"]),
    ("part", &["PART"], &["layer or pass"]),
    ("points", &["N", "FILE"], &["points"]),
    ("preset", &["FILE"], &["as a tuned preset"]),
    ("quality", &["LEVEL"], &["level of quality"]),
    ("releases", &["LIST"], &["releases"]),
    ("repeats", &["N"], &["repetitions"]),
    ("replicas", &["N"], &["replicas of each way", "replicas of each side", "as many pictures with seeds"]),
    ("resolution", &["WxH"], &["pixels"]),
    ("samples", &["N"], &["samples per pixel"]),
    ("scenes", &["FILE"], &["scenes of which"]),
    ("seconds", &["SECONDS"], &["seconds of animation"]),
    ("seed", &["SEED"], &["seed of", "random numbers"]),
    ("set", &["NAME=VALUE"], &["stored value"]),
    ("shadow-cells", &["CELLS"], &["cells along the longest side"]),
    ("shadow-step", &["METRES"], &["step of a shadow ray"]),
    ("shadows", &["SHADOWS"], &["how light reaches the samples"]),
    ("shard", &["NUMBER/COUNT"], &["only this part of the plan"]),
    ("sub-pixels", &["N"], &["rays per pixel and axis"]),
    ("target", &["NODE.SOCKET"], &["node.socket"]),
    ("tracking", &["TRACKING"], &["find their collisions"]),
    ("truth", &["FILE"], &["that are right"]),
    ("truth-part", &["PART"], &["layer or pass of --truth"]),
    ("view", &["NAME"], &["view transform"]),
    ("view-step", &["METRES"], &["step of a view ray"]),
    ("volume-bounces", &["N"], &["scattering events beyond the first"]),
    ("voxels", &["N"], &["voxels"]),
    ("without-cycles", &[], &["leave cycles out"]),
    ("without-gpu", &[], &["leave the adapter"]),
    ("world", &["FORM"], &["a world that is no colour and no picture"]),
    ("world-bands", &["N"], &["bands of spherical harmonics"]),
    ("world-directions", &["N"], &["quadrature over the world"]),
];

/// Words that mean what another word means, on the command line and in files: `--backend`, `--output`, `--without-X`.
const RETIRED: &[&str] = &[
    "adapter",
    "cpu-only",
    "device",
    "evaluator",
    "gpu",
    "no-caches",
    "no-marching",
    "on",
    "out",
    "output-file",
    "time",
];

/// An option of a command, as its help shows it.
struct Word {
    command: String,
    option: String,
    values: Vec<String>,
    help: String,
}

/// All commands without those that only group, with their full names.
fn commands(command: &Command, name: &str, found: &mut Vec<(String, Command)>) {
    for below in command.get_subcommands() {
        commands(below, &format!("{name} {}", below.get_name()), found);
    }
    if !command.has_subcommands() {
        found.push((name.to_owned(), command.clone()));
    }
}

pub(super) fn all_commands() -> Vec<(String, Command)> {
    let mut all = super::command_line();
    all.build();
    let mut found = Vec::new();
    commands(&all, "cloudparity", &mut found);
    found
}

fn words() -> Vec<Word> {
    let mut words = Vec::new();
    for (name, command) in all_commands() {
        for argument in command.get_arguments().filter(|argument| !argument.is_hide_set()) {
            let Some(option) = argument.get_long().filter(|long| *long != "help") else { continue };
            let values = match argument.get_action().takes_values() {
                true => argument.get_value_names().unwrap_or_default().iter().map(ToString::to_string).collect(),
                false => Vec::new(),
            };
            let help = argument.get_help().map(ToString::to_string).unwrap_or_default();
            let command = name.trim_start_matches("cloudparity ").to_owned();
            words.push(Word { command, option: option.to_owned(), values, help });
        }
    }
    words
}

#[test]
fn an_option_means_one_thing_in_all_commands() {
    let words = words();
    let mut by_option: BTreeMap<&str, Vec<&Word>> = BTreeMap::new();
    for word in &words {
        by_option.entry(&word.option).or_default().push(word);
    }
    let mut faults = String::new();
    for (option, uses) in by_option {
        if RETIRED.contains(&option) {
            writeln!(faults, "--{option} of {}: another word means this", uses[0].command).expect("a string");
        }
        let Some((_, values, meanings)) = SHARED.iter().find(|(name, ..)| *name == option) else {
            if uses.len() > 1 {
                let of: Vec<&str> = uses.iter().map(|word| word.command.as_str()).collect();
                writeln!(faults, "--{option} of {} is not in the list of shared words", of.join(", "))
                    .expect("a string");
            }
            continue;
        };
        for word in uses {
            let is_named = match word.values.as_slice() {
                [] => values.is_empty(),
                [name] => values.contains(&name.as_str()),
                _ => false,
            };
            let help = word.help.to_lowercase();
            if !is_named || !meanings.iter().any(|meaning| help.contains(meaning)) {
                let Word { command, values, help, .. } = word;
                writeln!(faults, "--{option} of {command}, {values:?}: {help}").expect("a string");
            }
        }
    }
    assert!(faults.is_empty(), "{faults}");
}

#[test]
fn files_use_the_same_words() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let scene = crate::scene::Scene::load(&root.join("parity/scenes/linear-ramp.scene.json")).expect("a scene");
    let mut files = vec![
        ("init's study".to_owned(), super::first_files::study(&scene, "a.scene.json").expect("a study")),
        ("init's tuning".to_owned(), super::first_files::tuning(&scene, "a.scene.json").expect("a tuning")),
    ];
    for entry in std::fs::read_dir(root.join("parity/studies")).expect("the studies") {
        let path = entry.expect("an entry").path();
        files.push((path.display().to_string(), std::fs::read_to_string(path).expect("a study")));
    }
    for page in ["docs/studies.md", "docs/tuning.md"] {
        files.push((page.into(), std::fs::read_to_string(root.join(page)).expect("a page")));
    }
    for (name, text) in files {
        let keys = text.lines().filter_map(|line| line.split_once(" = ")).map(|(key, _)| key.trim());
        for key in keys {
            assert!(!RETIRED.contains(&key.replace('_', "-").as_str()), "{name}: {key}: another word means this");
        }
    }
}

#[test]
fn there_are_a_dozen_commands_on_one_screen() {
    let mut all = super::command_line();
    let names: Vec<&str> = super::TASKS.iter().flat_map(|(_, names)| names.iter().map(|(name, _)| *name)).collect();
    let existing: Vec<&str> = all.get_subcommands().map(Command::get_name).collect();
    assert!(names.len() <= 12 && names.len() == existing.len(), "{names:?}, {existing:?}");
    assert!(existing.iter().all(|name| names.contains(name)), "{names:?}, {existing:?}");
    for text in [all.render_help().to_string(), all.render_long_help().to_string()] {
        // The screen that every terminal has.
        assert!(text.lines().count() <= 24 && text.lines().all(|line| line.chars().count() <= 80), "{text}");
    }
}

#[test]
fn every_command_has_an_example_that_it_takes() {
    let mut all = super::command_line();
    for (name, command) in all_commands() {
        let text = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        let examples: Vec<&str> = text.lines().filter_map(|line| Some(&line[line.find("cloudparity ")?..])).collect();
        assert!(text.starts_with("Example") && !examples.is_empty(), "{name}: {text}");
        let own = name.rsplit(' ').next().unwrap_or_default();
        for example in examples {
            let line = example.split(" > ").next().unwrap_or_default();
            let line = shell_words(line);
            assert_eq!(line[1], own, "{example}");
            let words = super::with_group(&all, line.into_iter().map(Into::into).collect());
            let found = all.try_get_matches_from_mut(words);
            assert!(found.is_ok(), "{example}: {}", found.expect_err("an error"));
        }
    }
}

/// Words of a line, with those in double quotes kept together.
fn shell_words(line: &str) -> Vec<String> {
    let parts = line.split('"').enumerate();
    parts
        .flat_map(|(number, part)| match number % 2 {
            0 => part.split_whitespace().map(str::to_owned).collect(),
            _ => vec![part.to_owned()],
        })
        .collect()
}

#[test]
fn a_subcommand_is_called_with_its_group_or_without() {
    let all = super::command_line();
    let with = |line: &str| super::with_group(&all, line.split(' ').map(Into::into).collect());
    assert_eq!(
        with("cloudparity study A -o B"),
        ["cloudparity", "measure", "study", "A", "-o", "B"].map(std::ffi::OsString::from)
    );
    assert_eq!(
        with("cloudparity measure study A"),
        ["cloudparity", "measure", "study", "A"].map(std::ffi::OsString::from)
    );
    assert_eq!(with("cloudparity rendr A"), ["cloudparity", "rendr", "A"].map(std::ffi::OsString::from));
    // A name says one command: no two groups have it, and no command of its own.
    let mut names: Vec<String> =
        all_commands().iter().map(|(name, _)| name.rsplit(' ').next().unwrap().to_owned()).collect();
    let count = names.len();
    names.sort();
    names.dedup();
    assert_eq!(names.len(), count, "{names:?}");
}

/// The list of all options as docs/options.md has it.
fn page() -> String {
    let mut rows: BTreeMap<(String, String), Vec<(String, String)>> = BTreeMap::new();
    for word in words() {
        let values = word.values.join(" ");
        rows.entry((word.option, values)).or_default().push((word.help, word.command));
    }
    let mut text = String::from(
        "# Options\n\nThe words of the command line. One means the same in every command that has it; files of studies and tunings use the \
         same words with `_` for `-`.\nA test keeps this page and the words as they are.\n\n| option | what | commands |\n| --- | --- | --- |\n",
    );
    for ((option, values), uses) in rows {
        let name = format!("`--{option}{}{values}`", if values.is_empty() { "" } else { " " });
        let mut meanings: Vec<(String, Vec<String>)> = Vec::new();
        for (help, command) in uses {
            let command = format!("`{}`", command.rsplit(' ').next().unwrap_or_default());
            match meanings.iter_mut().find(|(known, _)| *known == help) {
                Some((_, of)) => of.push(command),
                None => meanings.push((help, vec![command])),
            }
        }
        for (help, of) in meanings {
            let help = help.replace('|', "\\|").replace('\n', " ");
            writeln!(text, "| {} | {help} | {} |", name.replace('|', "\\|"), of.join(", ")).expect("a string");
        }
    }
    text
}

#[test]
fn the_page_of_options_is_theirs() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/options.md");
    let known = std::fs::read_to_string(&path).unwrap_or_default();
    let now = page();
    if known != now {
        let fresh = std::env::temp_dir().join("options.md");
        std::fs::write(&fresh, &now).expect("a temporary folder");
        panic!("docs/options.md is not what the commands say; the text is in {}", fresh.display());
    }
}
